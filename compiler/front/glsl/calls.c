/* Builtin functions under GLSL's names: ours under another name, ours with another list of arguments, or functions of
 * the standard module `gl`. What the file declares itself stays what it is. */
#include "compiler/front/glsl/glsl.h"

#include <string.h>

typedef struct Rename {
    const char *glsl, *ours; /* `gl_…` is a function of stdlib/gl.salt */
    uint32_t nargs;          /* 0: whatever the number */
} Rename;

static const Rename renames[] = {
    {"mix", "lerp", 0},
    {"fract", "frac", 0},
    {"inversesqrt", "rsqrt", 0},
    {"atan", "atan2", 2},
    {"roundEven", "round", 0},
    {"floatBitsToUint", "asuint", 0},
    {"uintBitsToFloat", "asfloat", 0},
    {"intBitsToFloat", "asfloat", 0},
    {"floatBitsToInt", "gl_bits", 0},
    {"mod", "gl_mod", 0},
    {"modf", "gl_modf", 0},
    {"radians", "gl_radians", 0},
    {"degrees", "gl_degrees", 0},
    {"asinh", "gl_asinh", 0},
    {"acosh", "gl_acosh", 0},
    {"atanh", "gl_atanh", 0},
    {"faceforward", "gl_faceforward", 0},
    {"lessThan", "gl_less", 0},
    {"lessThanEqual", "gl_less_equal", 0},
    {"greaterThan", "gl_greater", 0},
    {"greaterThanEqual", "gl_greater_equal", 0},
    {"equal", "gl_equal", 0},
    {"notEqual", "gl_not_equal", 0},
    {"not", "gl_not", 0},
    {"matrixCompMult", "gl_multiply_components", 0},
    {"outerProduct", "gl_outer", 0},
    {"uaddCarry", "gl_add_carry", 0},
    {"usubBorrow", "gl_sub_borrow", 0},
    {"umulExtended", "gl_mul_wide", 0},
    {"imulExtended", "gl_mul_wide", 0},
    {"fwidth", "gl_fwidth", 0},
    {"dFdxFine", "dFdx", 0},
    {"dFdyFine", "dFdy", 0},
    {"dFdxCoarse", "dFdx", 0},
    {"dFdyCoarse", "dFdy", 0},
    {"fwidthFine", "gl_fwidth", 0},
    {"texture", "gl_texture", 0},
    {"texture2D", "gl_texture", 0},
    {"textureLod", "gl_texture", 0},
    {"texture2DLod", "gl_texture", 0},
    {"texture2DLodEXT", "gl_texture", 0},
    {"textureGrad", "gl_texture", 0},
    {"texelFetch", "gl_texel", 0},
    {"textureSize", "gl_texture_size", 0},
    {"textureOffset", "gl_texture_offset", 0},
    {"textureLodOffset", "gl_texture_offset", 0},
    {"textureProj", "gl_texture_proj", 0},
    {"texture2DProj", "gl_texture_proj", 0},
    {"texelFetchOffset", "gl_texel_offset", 0},
    {"textureGather", "gl_gather", 0},
    {"bitCount", "gl_bit_count", 0},
    {"bitfieldReverse", "gl_reverse", 0},
    {"findLSB", "gl_lowest", 0},
    {"findMSB", "gl_highest", 0},
    {"bitfieldExtract", "gl_extract", 0},
    {"bitfieldInsert", "gl_insert", 0},
    {"packUnorm4x8", "gl_pack_unorm4", 0},
    {"unpackUnorm4x8", "gl_unpack_unorm4", 0},
    {"packUnorm2x16", "gl_pack_unorm2", 0},
    {"unpackUnorm2x16", "gl_unpack_unorm2", 0},
    {"ldexp", "gl_ldexp", 0},
    {"frexp", "gl_frexp", 0},
    {"packHalf2x16", "gl_pack_half2", 0},
    {"unpackHalf2x16", "gl_unpack_half2", 0},
    {"packSnorm2x16", "gl_pack_snorm2", 0},
    {"unpackSnorm2x16", "gl_unpack_snorm2", 0},
};

#define COUNT(a) (sizeof(a) / sizeof *(a))

typedef struct Calls {
    NameMap own;     /* functions and structs of the file -> the name that it has now */
    NameMap builtin; /* -> Rename, the first of its name */
    bool uses_module;
} Calls;

/* HLSL's names, which the language has: a shader that calls one runs nowhere else. */
static void refuse_other_names(Parser *p, const Expr *e) {
    static const char *const names[][2] = {{"lerp", "`mix`"},
                                           {"frac", "`fract`"},
                                           {"rsqrt", "`inversesqrt`"},
                                           {"atan2", "`atan`"},
                                           {"fmod", "`mod`"},
                                           {"mul", "`*`"},
                                           {"saturate", "`clamp(x, 0.0, 1.0)`"},
                                           {"ddx", "`dFdx`"},
                                           {"tex2D", "`texture`"},
                                           {"asuint", "`floatBitsToUint`"},
                                           {"asfloat", "`uintBitsToFloat`"},
                                           {"ddy", "`dFdy`"}};
    for (size_t i = 0; i < COUNT(names); i++)
        if (!strcmp(e->name, names[i][0]))
            diag_emit(p->s, DIAG_unknown_name, e->op_span, e->name,
                      arena_printf(&p->s->session, ": GLSL has %s", names[i][1]));
}

static void rename_call(GlslWalk *w, Expr *e) {
    Calls *c = w->user;
    if (e->kind != E_CALL || glsl_is_local(w, e->name)) return;
    const char *own = map_get(&c->own, e->name);
    const Rename *r = map_get(&c->builtin, e->name);
    if (own) { /* the builtin is still there for arguments that the file's own do not take */
        e->other = r && (!r->nargs || r->nargs == e->nargs) ? intern(w->p->s, r->ours, strlen(r->ours)) : e->name;
        c->uses_module |= e->other != e->name && r->ours[0] == 'g';
        e->name = own;
        return;
    }
    if (!r) refuse_other_names(w->p, e);
    if (!r || (r->nargs && r->nargs != e->nargs)) return;
    Session *s = w->p->s;
    /* The levels of detail and derivatives of a lookup mean nothing: a texture has one level. */
    if (!strcmp(r->ours, "gl_texture") && e->nargs > 2) e->nargs = 2;
    if (!strcmp(r->ours, "gl_texel") && e->nargs > 2) e->nargs = 2;
    if (!strcmp(r->ours, "gl_texture_size") && e->nargs > 1) e->nargs = 1;
    c->uses_module |= r->ours[0] == 'g';
    e->name = intern(s, r->ours, strlen(r->ours));
    e->is_builtin = r->ours[0] != 'g';
}

const char *glsl_function_behind(const char *ours, size_t n) {
    static const char *const same[] = {"round", "dFdx", "dFdy"};
    if (n == 3 && !strncmp(ours, "len", n)) return "length";
    for (size_t i = 0; i < COUNT(same); i++)
        if (strlen(same[i]) == n && !strncmp(same[i], ours, n)) return NULL;
    for (size_t i = 0; i < COUNT(renames); i++)
        if (strlen(renames[i].ours) == n && !strncmp(renames[i].ours, ours, n)) return renames[i].glsl;
    return NULL;
}

bool glsl_is_function_of_module(const char *name) {
    for (size_t i = 0; i < COUNT(renames); i++)
        if (!strcmp(renames[i].glsl, name)) return renames[i].ours[0] == 'g';
    return false;
}

/* A function of the file that is called as a builtin is here and not in GLSL (`frac`, `lerp`) gets a name that is not
 * interned: it must not stand before the builtin that GLSL calls `fract`. */
static void own_names(Parser *p, NameMap *own) {
    Arena *a = &p->s->module;
    for (const StructDecl *d = p->module->struct_decls; d; d = d->next) map_put(a, own, d->name, (void *)d->name);
    for (Func *f = p->module->funcs; f; f = f->next) {
        const char *name = map_get(own, f->name);
        for (size_t i = 0; !name && i < COUNT(renames); i++)
            if (!strcmp(renames[i].ours, f->name)) name = arena_strndup(a, f->name, strlen(f->name));
        if (!name) name = f->name;
        map_put(a, own, f->name, (void *)name);
        f->name = name;
    }
}

void glsl_rename_calls(Parser *p) {
    Calls c = {0};
    Arena *a = &p->s->module;
    own_names(p, &c.own);
    for (size_t i = 0; i < COUNT(renames); i++)
        map_put(a, &c.builtin, intern(p->s, renames[i].glsl, strlen(renames[i].glsl)), (void *)&renames[i]);
    GlslWalk w = {.p = p, .visit = rename_call, .user = &c};
    for (Func *f = p->module->funcs; f; f = f->next) glsl_walk(&w, f);
    w.locals.len = 0;
    for (Symbol *sym = p->module->consts; sym; sym = sym->next) glsl_walk_expr(&w, sym->init);
    for (Symbol *sym = p->module->params; sym; sym = sym->next) glsl_walk_expr(&w, sym->init);
    if (!c.uses_module) return;
    Import im = {.name = intern(p->s, "gl", 2), .of_stdlib = true, .span = {p->module->file, 0, 0}};
    vec_push(a, &p->imports, im);
}
