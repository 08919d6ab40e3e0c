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
};

#define COUNT(a) (sizeof(a) / sizeof *(a))

typedef struct Calls {
    NameMap own;     /* functions and structs of the file */
    NameMap builtin; /* -> Rename, the first of its name */
    bool uses_module;
} Calls;

static void rename_call(GlslWalk *w, Expr *e) {
    Calls *c = w->user;
    if (e->kind != E_CALL || map_get(&c->own, e->name) || glsl_is_local(w, e->name)) return;
    const Rename *r = map_get(&c->builtin, e->name);
    if (!r || (r->nargs && r->nargs != e->nargs)) return;
    Session *s = w->p->s;
    /* The levels of detail and derivatives of a lookup mean nothing: a texture has one level. */
    if (!strcmp(r->ours, "gl_texture") && e->nargs > 2) e->nargs = 2;
    if (!strcmp(r->ours, "gl_texel") && e->nargs > 2) e->nargs = 2;
    if (!strcmp(r->ours, "gl_texture_size") && e->nargs > 1) e->nargs = 1;
    c->uses_module |= r->ours[0] == 'g';
    e->name = intern(s, r->ours, strlen(r->ours));
}

void glsl_rename_calls(Parser *p) {
    Calls c = {0};
    Arena *a = &p->s->module;
    for (const Func *f = p->module->funcs; f; f = f->next) map_put(a, &c.own, f->name, p);
    for (const StructDecl *d = p->module->struct_decls; d; d = d->next) map_put(a, &c.own, d->name, p);
    for (size_t i = 0; i < COUNT(renames); i++)
        map_put(a, &c.builtin, intern(p->s, renames[i].glsl, strlen(renames[i].glsl)), (void *)&renames[i]);
    GlslWalk w = {.p = p, .visit = rename_call, .user = &c};
    for (Func *f = p->module->funcs; f; f = f->next) glsl_walk(&w, f);
    w.locals.len = 0;
    for (Symbol *sym = p->module->consts; sym; sym = sym->next) glsl_walk_expr(&w, sym->init);
    for (Symbol *sym = p->module->params; sym; sym = sym->next) glsl_walk_expr(&w, sym->init);
    if (!c.uses_module) return;
    Import im = {.name = intern(p->s, "gl", 2), .span = {p->module->file, 0, 0}};
    vec_push(a, &p->imports, im);
}
