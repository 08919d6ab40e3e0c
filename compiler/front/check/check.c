/* The program as a whole: tables of every module, functions, the call graph, entry points. */
#include "compiler/front/check/internal.h"

#include <math.h>
#include <string.h>

void enter_depth(Checker *c) {
    if (++c->depth > CHECK_MAX_DEPTH)
        session_limit(c->s, "the program nests expressions and declarations deeper than %d", CHECK_MAX_DEPTH);
}

Context context_enter(Checker *c, ModuleScope *scope, FuncInfo *func) {
    Context old = c->at;
    c->at = (Context){.scope = scope, .func = func};
    return old;
}
void context_leave(Checker *c, Context old) { c->at = old; }

/* ---- file scope */

const char *decl_what(const Decl *d) {
    switch (d->kind) {
    case DECL_ERROR: break;
    case DECL_CONST: return "constant";
    case DECL_PARAM: return "parameter";
    case DECL_FUNC: return d->funcs[0]->is_shader ? "shader" : "function";
    case DECL_STRUCT: return "struct";
    case DECL_TYPEDEF: return "type";
    }
    return "name";
}

ModuleScope *scope_of(Checker *c, const Module *m) {
    for (uint32_t i = 0; i < c->nscopes; i++)
        if (c->scopes[i].module == m) return &c->scopes[i];
    ice(c->s, "module %s is not loaded", m->name);
}

bool in_glsl(const Checker *c) { return c->at.scope->module->glsl; }
FuncInfo *func_info(Checker *c, const Func *f) { return &c->info[f->check_state - 1]; }

Type *soft_type(Checker *c, const char *name) {
    Type *const structs[] = {c->t_hit, c->t_silhouette, c->t_mesh_hit, c->t_beam, c->t_piece, c->t_area_light};
    for (size_t i = 0; i < sizeof structs / sizeof *structs; i++)
        if (structs[i] && !strcmp(name, structs[i]->name)) return structs[i];
    for (int k = 0; k < SLT_GEOMETRIES; k++)
        if (geometry_types[k].attributes & SOFT_NAME && !strcmp(name, geometry_types[k].name))
            return type_geometry((SltGeometryKind)k);
    return NULL;
}

static bool is_language_name(Checker *c, const char *name) {
    return map_get(&c->builtin_funcs, name) || name == c->name_len || name == c->name_pi || name == c->name_tau ||
           name == c->name_infinity || name == c->name_epsilon || soft_type(c, name);
}

bool name_lost(const Checker *c, const char *name) {
    for (const Module *m = c->main; m; m = m->next)
        for (uint32_t i = 0; i < m->nlost; i++)
            if (m->lost[i] == name) return true;
    return false;
}

Decl *scope_find(Checker *c, const char *name, Span use) {
    ModuleScope *scope = c->at.scope;
    Decl *d = map_get(&scope->names, name), *other = NULL;
    if (d) return d;
    for (uint32_t i = 0; i < scope->nimports; i++) {
        Decl *found = map_get(&scope->imports[i]->names, name);
        if (!found) continue;
        if (!d) d = found;
        else if (!other) other = found;
    }
    if (!d && name_lost(c, name) && !is_language_name(c, name)) return &c->poison;
    if (!d && scope->incomplete && !is_language_name(c, name))
        return &c->poison; /* the name may come from the module that is missing */
    if (!other) return d;
    Diag *diag = diag_emit(c->s, DIAG_ambiguous_import, use, name);
    diag_note(c->s, diag, d->span, "declared in `%s`", d->module->name);
    diag_note(c->s, diag, other->span, "declared in `%s`", other->module->name);
    return &c->poison;
}

static void collect(const NameMap *m, Checker *c, const char **names, uint32_t *n, uint32_t cap, bool types_only,
                    bool decls) {
    for (uint32_t i = 0; i < m->cap && *n < cap; i++) {
        if (!m->keys[i]) continue;
        if (decls && types_only) {
            const Decl *d = m->values[i];
            if (d->kind != DECL_STRUCT && d->kind != DECL_TYPEDEF) continue;
        }
        if (!decls && !m->values[i]) continue;
        names[(*n)++] = m->keys[i];
    }
    (void)c;
}

/* What GLSL, HLSL and Slang call things that have another name here. */
static const char *elsewhere(const char *name) {
    static const char *const words[][2] = {
        {"mix", "lerp"},
        {"fract", "frac"},
        {"mod", "fmod"},
        {"inversesqrt", "rsqrt"},
        {"vec2", "float2"},
        {"vec3", "float3"},
        {"vec4", "float4"},
        {"half", "float"},
        {"half2", "float2"},
        {"half3", "float3"},
        {"half4", "float4"},
        {"double", "float"},
        {"ivec2", "int2"},
        {"ivec3", "int3"},
        {"mat2", "float2x2"},
        {"mat3", "float3x3"},
        {"mat4", "float4x4"},
        {"Texture2D", "texture2D"},
        {"Texture3D", "texture3D"},
        {"sampler2D", "texture2D"},
        {"sampler3D", "texture3D"},
    };
    for (size_t i = 0; i < sizeof words / sizeof *words; i++)
        if (!strcmp(words[i][0], name)) return words[i][1];
    return NULL;
}

const char *suggest(Checker *c, const char *name, bool types_only) {
    enum { ENOUGH = 100 };
    if (c->s->nerrors > ENOUGH) return ""; /* thousands of errors with thousands of names would take seconds */
    const char *known = elsewhere(name);
    if (known) return arena_printf(&c->s->session, ", which is `%s` here", known);
    ArenaMark mark = arena_mark(&c->s->scratch);
    enum { CAP = 4096 };
    const char **names = ARENA_ARRAY(&c->s->scratch, const char *, CAP);
    uint32_t n = 0;
    if (!types_only) collect(&c->at.locals, c, names, &n, CAP, false, false);
    collect(&c->at.scope->names, c, names, &n, CAP, types_only, true);
    for (uint32_t i = 0; i < c->at.scope->nimports; i++)
        collect(&c->at.scope->imports[i]->names, c, names, &n, CAP, types_only, true);
    collect(types_only ? &c->builtin_types : &c->builtin_funcs, c, names, &n, CAP, false, false);
    if (!types_only && n + 5 < CAP) {
        names[n++] = c->name_len;
        names[n++] = c->name_pi;
        names[n++] = c->name_tau;
        names[n++] = c->name_infinity;
        names[n++] = c->name_epsilon;
    }
    const char *near = suggest_nearest(name, names, n);
    const char *text = near ? arena_printf(&c->s->session, ", did you mean `%s`?", near) : "";
    arena_reset(&c->s->scratch, mark);
    return text;
}

/* The error stands at the later of the two, whatever order the tables are filled in. */
static void redeclared(Checker *c, Span at, const char *name, Span first) {
    if (first.pos > at.pos) {
        Span t = at;
        at = first;
        first = t;
    }
    Diag *d = diag_emit(c->s, DIAG_redeclared, at, name);
    diag_note(c->s, d, first, "the first is here");
}

static Decl *declare(Checker *c, ModuleScope *scope, DeclKind kind, const char *name, Span span) {
    Decl *d = map_get(&scope->names, name);
    if (d && kind == DECL_FUNC && d->kind == DECL_FUNC) return d;
    if (d) {
        redeclared(c, span, name, d->span);
        return NULL;
    }
    d = ARENA_NEW(c->arena, Decl);
    *d = (Decl){.kind = kind, .name = name, .span = span, .module = scope->module};
    map_put(c->arena, &scope->names, name, d);
    return d;
}

static void declare_func(Checker *c, ModuleScope *scope, Func *f) {
    Decl *d = declare(c, scope, DECL_FUNC, f->name, f->name_span);
    if (!d) return;
    if (d->nfuncs && (f->is_shader || d->funcs[0]->is_shader)) {
        redeclared(c, f->name_span, f->name, d->funcs[0]->name_span);
        return;
    }
    if (d->nfuncs == d->cap_funcs) {
        d->cap_funcs = d->cap_funcs ? d->cap_funcs * 2 : 2;
        Func **funcs = ARENA_ARRAY(c->arena, Func *, d->cap_funcs);
        for (uint32_t i = 0; i < d->nfuncs; i++) funcs[i] = d->funcs[i];
        d->funcs = funcs;
    }
    d->funcs[d->nfuncs++] = f;
}

static void fill_scope(Checker *c, ModuleScope *scope) {
    Module *m = scope->module;
    scope->imports = ARENA_ARRAY(c->arena, ModuleScope *, m->nimports + 1);
    for (uint32_t i = 0; i < m->nimports; i++) {
        if (!m->imports[i].module || m->imports[i].module->missing) { /* not found or cyclic, and reported */
            scope->incomplete = true;
            continue;
        }
        ModuleScope *to = scope_of(c, m->imports[i].module);
        bool seen = false;
        for (uint32_t j = 0; j < scope->nimports; j++) seen |= scope->imports[j] == to;
        if (!seen) scope->imports[scope->nimports++] = to;
    }
    for (StructDecl *d = m->struct_decls; d; d = d->next) {
        d->module = m;
        Decl *decl = declare(c, scope, DECL_STRUCT, d->name, d->span);
        if (decl) decl->structure = d;
    }
    for (TypedefDecl *d = m->typedefs; d; d = d->next) {
        d->module = m;
        Decl *decl = declare(c, scope, DECL_TYPEDEF, d->name, d->span);
        if (decl) decl->type_def = d;
    }
    for (int params = 0; params < 2; params++)
        for (Symbol *sym = params ? m->params : m->consts; sym; sym = sym->next) {
            sym->module = m;
            sym->kind = params ? SYM_PARAM : SYM_CONST;
            sym->id = 0;
            Decl *decl = declare(c, scope, params ? DECL_PARAM : DECL_CONST, sym->name, sym->span);
            if (decl) decl->sym = sym;
        }
    for (Func *f = m->funcs; f; f = f->next) {
        f->module = m;
        FuncInfo *info = &c->info[c->ninfo++];
        info->func = f;
        info->scope = scope;
        info->rand_span = info->cull_span = SPAN_NONE;
        f->check_state = c->ninfo;
        declare_func(c, scope, f);
    }
}

static Type *predeclared_struct(Checker *c, const char *name, Field *fields, uint32_t n) {
    Type *t = ARENA_NEW(&c->s->session, Type);
    t->kind = T_STRUCT;
    t->name = name;
    t->nfields = n;
    t->fields = arena_copy(&c->s->session, fields, sizeof *fields * n);
    for (uint32_t i = 0; i < n; i++) t->fields[i].name = intern(c->s, fields[i].name, strlen(fields[i].name));
    return t;
}

static void fill_language(Checker *c) {
    Session *s = c->s;
    c->t_error = type_scalar(T_ERROR), c->t_void = type_scalar(T_VOID), c->t_bool = type_scalar(T_BOOL),
    c->t_int = type_scalar(T_INT);
    c->t_uint = type_scalar(T_UINT), c->t_float = type_scalar(T_FLOAT);
    Type *types[32] = {c->t_void, c->t_bool, c->t_int, c->t_uint, c->t_float};
    uint32_t n = 5;
    types[n++] = type_scalar(T_TEXTURE), types[n++] = type_scalar(T_TEXTURE3D);
    for (int k = 0; k < SLT_GEOMETRIES; k++)
        if (!(geometry_types[k].attributes & SOFT_NAME)) types[n++] = type_geometry((SltGeometryKind)k);
    for (uint32_t w = 2; w <= 4; w++) {
        for (TypeKind k = T_BOOL; k <= T_FLOAT; k++) types[n++] = type_vector(s, k, w);
        for (uint32_t k = 2; k <= 4; k++) types[n++] = type_matrix(s, w, k);
    }
    for (uint32_t i = 0; i < n; i++)
        map_put(c->arena, &c->builtin_types, intern(s, types[i]->name, strlen(types[i]->name)), types[i]);
#define BUILTIN(id, text, ...) \
    map_put(c->arena, &c->builtin_funcs, intern(s, text, strlen(text)), (void *)(uintptr_t)B_##id);
#include "compiler/front/check/builtins.def"
#undef BUILTIN
    c->name_len = intern(s, "len", 3);
    c->name_pi = intern(s, "PI", 2);
    c->name_tau = intern(s, "TAU", 3);
    c->name_infinity = intern(s, "INFINITY", 8);
    c->name_epsilon = intern(s, "EPSILON", 7);
    Type *f2 = type_vector(s, T_FLOAT, 2), *f3 = type_vector(s, T_FLOAT, 3);
    Field hit[] = {{"hit", c->t_bool, SPAN_NONE, NULL},
                   {"t", c->t_float, SPAN_NONE, NULL},
                   {"p", f2, SPAN_NONE, NULL},
                   {"normal", f3, SPAN_NONE, NULL}};
    Field silhouette[] = {{"found", c->t_bool, SPAN_NONE, NULL},
                          {"t", c->t_float, SPAN_NONE, NULL},
                          {"slope", c->t_float, SPAN_NONE, NULL}};
    /* The last has a name that nobody can write: the face, for what is continuous over edges. */
    Field mesh_hit[] = {{"hit", c->t_bool, SPAN_NONE, NULL}, {"t", c->t_float, SPAN_NONE, NULL},
                        {"p", f3, SPAN_NONE, NULL},          {"normal", f3, SPAN_NONE, NULL},
                        {"uv", f2, SPAN_NONE, NULL},         {"tri", c->t_int, SPAN_NONE, NULL},
                        {"part", c->t_int, SPAN_NONE, NULL}, {"the face", c->t_int, SPAN_NONE, NULL}};
    c->t_mesh_hit = predeclared_struct(c, "MeshHit", mesh_hit, 8);
    Field beam[] = {{"eye", f3, SPAN_NONE, NULL},
                    {"corner", f3, SPAN_NONE, NULL},
                    {"u", f3, SPAN_NONE, NULL},
                    {"v", f3, SPAN_NONE, NULL}};
    c->t_beam = predeclared_struct(c, "Beam", beam, 4);
    /* The last three have names that nobody can write: where it is told of, and of which mesh, and the beam, which its
     * derivatives need. */
    Field piece[] = {{"found", c->t_bool, SPAN_NONE, NULL},   {"area", c->t_float, SPAN_NONE, NULL},
                     {"centre", f2, SPAN_NONE, NULL},         {"p", f3, SPAN_NONE, NULL},
                     {"normal", f3, SPAN_NONE, NULL},         {"tri", c->t_int, SPAN_NONE, NULL},
                     {"part", c->t_int, SPAN_NONE, NULL},     {"the unit", c->t_int, SPAN_NONE, NULL},
                     {"the mesh", c->t_int, SPAN_NONE, NULL}, {"the beam", c->t_beam, SPAN_NONE, NULL}};
    c->t_piece = predeclared_struct(c, "Piece", piece, 10);
    Field area_light[] = {{"corner", f3, SPAN_NONE, NULL}, {"u", f3, SPAN_NONE, NULL}, {"v", f3, SPAN_NONE, NULL}};
    c->t_area_light = predeclared_struct(c, "AreaLight", area_light, 3);
    c->t_hit = predeclared_struct(c, "Hit", hit, 4);
    c->t_silhouette = predeclared_struct(c, "Silhouette", silhouette, 3);
}

/* ---- functions */

const char *func_text(Checker *c, const Func *f) {
    Session *s = c->s;
    const char *text = arena_printf(&s->session, "%s %s(", f->ret ? f->ret->name : "?", f->name);
    for (uint32_t i = 0; i < f->nargs && i < 32 && !f->args[i]->hidden; i++) {
        static const char *const mode[] = {[ARG_IN] = "", [ARG_OUT] = "out ", [ARG_INOUT] = "inout "};
        const Symbol *arg = f->args[i];
        text = arena_printf(&s->session, "%s%s%s%s", text, i ? ", " : "", mode[arg->was_out ? ARG_OUT : arg->mode],
                            arg->type ? arg->type->name : "?");
    }
    return arena_printf(&s->session, "%s)", text);
}

void func_signature(Checker *c, Func *f) {
    if (f->ret) return;
    FuncInfo *info = func_info(c, f);
    Session *s = c->s;
    Context old = context_enter(c, info->scope, NULL);
    f->ret = c->t_error; /* sizes in the signature cannot depend on the function */
    Type *ret = resolve_type(c, f->ret_ref, false, CHECK_MAX_LOCAL);
    if (type_is_resource(ret)) {
        diag_emit(s, DIAG_bad_resource, f->ret_ref->span,
                  arena_printf(&s->session, "a function cannot return a %s", ret->name));
        ret = c->t_error;
    }
    info->signature_ok = ret->kind != T_ERROR;
    for (uint32_t i = 0; i < f->nargs; i++) {
        Symbol *a = f->args[i];
        a->kind = SYM_ARG;
        a->type = resolve_type(c, a->type_ref, false, a->mode == ARG_IN ? CHECK_MAX_ARRAY : CHECK_MAX_LOCAL);
        if (a->type->kind == T_VOID) {
            diag_emit(s, DIAG_void_value, a->span, "argument");
            a->type = c->t_error;
        } else if (type_is_resource(a->type) && a->mode != ARG_IN) {
            diag_emit(s, DIAG_bad_resource, a->span,
                      arena_printf(&s->session, "a %s is passed `in` only", a->type->name));
            a->type = c->t_error;
        }
        info->signature_ok &= a->type->kind != T_ERROR;
    }
    f->ret = ret;
    context_leave(c, old);
}

static bool same_arguments(const Func *a, const Func *b) {
    if (a->nargs != b->nargs) return false;
    for (uint32_t i = 0; i < a->nargs; i++)
        if (a->args[i]->type != b->args[i]->type) return false;
    return true;
}

static void check_overload_set(Checker *c, Decl *d) {
    for (uint32_t i = 0; i < d->nfuncs; i++)
        for (uint32_t j = 0; j < i; j++)
            if (func_info(c, d->funcs[i])->signature_ok && func_info(c, d->funcs[j])->signature_ok &&
                same_arguments(d->funcs[i], d->funcs[j])) {
                Diag *diag = diag_emit(c->s, DIAG_same_function, d->funcs[i]->name_span, d->name);
                diag_note(c->s, diag, d->funcs[j]->name_span, "the first is here");
                func_info(c, d->funcs[i])->duplicate = true;
                break;
            }
    /* Calls see the first declaration, so that a duplicate causes no further errors. */
    uint32_t kept = 0;
    for (uint32_t i = 0; i < d->nfuncs; i++)
        if (!func_info(c, d->funcs[i])->duplicate) d->funcs[kept++] = d->funcs[i];
    d->nfuncs = kept;
}

/* A bound of [Domain]: a scalar or one number a dimension. */
static bool domain_bound(Checker *c, Func *f, Expr **e, double out[3]) {
    if (!*e) return false;
    *e = check_value(c, *e);
    if ((*e)->type->kind == T_ERROR) return false;
    *e = convert(c, *e, with_width(c, T_FLOAT, f->dim), CONV_BROADCAST);
    if ((*e)->type->kind == T_ERROR) return false;
    if (!(*e)->is_const) {
        diag_emit(c->s, DIAG_not_constant, (*e)->span, "an argument of [Domain]");
        return false;
    }
    for (uint32_t i = 0; i < f->dim; i++) out[i] = (*e)->cval.v[i].f;
    return true;
}

static void check_shader(Checker *c, Func *f) {
    Session *s = c->s;
    FuncInfo *info = func_info(c, f);
    if (info->signature_ok && (scalar_kind(f->ret) != T_FLOAT || !width_of(f->ret)))
        diag_emit(s, DIAG_bad_shader, f->ret_ref->span,
                  arena_printf(&s->session, "a shader returns float, float2, float3 or float4, not %s", f->ret->name));
    if (f->nargs != 1) {
        diag_emit(s, DIAG_bad_shader, f->name_span,
                  arena_printf(&s->session, "a shader takes one argument, its point x; this takes %u", f->nargs));
        return;
    }
    Symbol *x = f->args[0];
    if (x->type->kind == T_ERROR) return;
    if (scalar_kind(x->type) != T_FLOAT || !width_of(x->type) || width_of(x->type) > 3) {
        diag_emit(
            s, DIAG_bad_shader, x->span,
            arena_printf(&s->session, "the argument of a shader is float, float2 or float3, not %s", x->type->name));
        return;
    }
    if (x->mode != ARG_IN) diag_emit(s, DIAG_bad_shader, x->span, "the argument of a shader is `in`");
    f->dim = width_of(x->type);
    for (uint32_t i = 0; i < f->dim; i++) f->lo[i] = 0, f->hi[i] = 1;
    if (!f->has_domain) return;
    Context old = context_enter(c, info->scope, NULL);
    bool ok = domain_bound(c, f, &f->domain_lo, f->lo);
    ok &= domain_bound(c, f, &f->domain_hi, f->hi);
    for (uint32_t i = 0; ok && i < f->dim; i++)
        if (!(f->lo[i] < f->hi[i]) || !isfinite(f->hi[i] - f->lo[i])) {
            diag_emit(s, DIAG_attr_args, f->domain_span,
                      "[Domain(lo, hi)] needs lo < hi in every dimension, both finite");
            break;
        }
    context_leave(c, old);
}

/* [Tangent(df)] f: df takes f's arguments, then a tangent for every float-typed one. */
static void check_tangent(Checker *c, Func *f) {
    Session *s = c->s;
    if (f->is_shader) {
        diag_emit(s, DIAG_attr_misplaced, f->tangent_span, "Tangent", "a shader");
        return;
    }
    FuncInfo *info = func_info(c, f);
    if (!info->signature_ok) return;
    bool any = false;
    for (uint32_t i = 0; i < f->nargs; i++) {
        any |= type_is_float(f->args[i]->type);
        if (f->args[i]->mode != ARG_IN) {
            diag_emit(s, DIAG_bad_tangent, f->tangent_span,
                      arena_printf(&s->session, "[Tangent] needs `in` arguments only, `%s` is not", f->args[i]->name));
            return;
        }
    }
    if (!type_is_float(f->ret) || !any) {
        diag_emit(s, DIAG_bad_tangent, f->tangent_span,
                  "[Tangent] needs a float-typed result and a float-typed argument");
        return;
    }
    Context old = context_enter(c, info->scope, NULL);
    Decl *d = scope_find(c, f->tangent_name, f->tangent_span);
    context_leave(c, old);
    if (d && d->kind == DECL_ERROR) return;
    const char *want = arena_printf(&s->session, "%s %s(", f->ret->name, f->tangent_name);
    for (int pass = 0; pass < 2; pass++)
        for (uint32_t i = 0; i < f->nargs; i++)
            if (!pass || type_is_float(f->args[i]->type))
                want = arena_printf(&s->session, "%s%s%s", want, pass || i ? ", " : "", f->args[i]->type->name);
    for (uint32_t k = 0; d && d->kind == DECL_FUNC && k < d->nfuncs; k++) {
        Func *df = d->funcs[k];
        func_signature(c, df);
        if (!func_info(c, df)->signature_ok) return;
        uint32_t at = 0;
        bool fits = !df->is_shader && df->ret == f->ret && df != f;
        for (int pass = 0; pass < 2; pass++)
            for (uint32_t i = 0; i < f->nargs; i++)
                if (!pass || type_is_float(f->args[i]->type)) {
                    fits = fits && at < df->nargs && df->args[at]->type == f->args[i]->type &&
                           df->args[at]->mode == ARG_IN;
                    at++;
                }
        if (!fits || at != df->nargs) continue;
        f->tangent = df;
        return;
    }
    Diag *diag = diag_emit(s, DIAG_bad_tangent, f->tangent_span,
                           arena_printf(&s->session, "there is no `%s)` for [Tangent(%s)]", want, f->tangent_name));
    if (d) diag_note(s, diag, d->span, "`%s` is declared here", f->tangent_name);
}

/* What was skipped may have been a `return` or an assignment. */
static bool syntax_error_in(const Checker *c, const Func *f) {
    uint32_t end = f->end_span.len ? f->end_span.pos + f->end_span.len : UINT32_MAX;
    for (const Diag *d = c->s->diags; d; d = d->next)
        if (d->severity == SEV_ERROR && d->span.file == f->name_span.file) {
            bool inside = d->span.pos >= f->name_span.pos && d->span.pos <= end;
            if (d->code == DIAG_unbalanced ||
                (inside && (d->code == DIAG_unknown_type || !strncmp(diag_code_name(d->code), "E00", 3))))
                return true;
        }
    return false;
}

static void check_function(Checker *c, Func *f) {
    if (f->is_shader) check_shader(c, f);
    else if (f->has_domain)
        diag_emit(c->s, DIAG_attr_misplaced, f->domain_span, "Domain", "a function that is no shader");
    if (f->tangent_name) check_tangent(c, f);
    if (!f->body) return;
    FuncInfo *info = func_info(c, f);
    Context old = context_enter(c, info->scope, info);
    check_body(c, f);
    context_leave(c, old);
    check_loops(c, f);
    if (!f->module->glsl && !syntax_error_in(c, f)) check_flow(c, f); /* GLSL reads what has no value: zero */
}

/* ---- the call graph */

typedef struct Frame {
    FuncInfo *info;
    uint32_t next;
} Frame;

static void report_recursion(Checker *c, Frame *stack, uint32_t depth, FuncInfo *to, Span at) {
    uint32_t first = depth;
    while (first > 0 && stack[first - 1].info != to) first--;
    const char *chain = "";
    for (uint32_t i = first ? first - 1 : 0, shown = 0; i < depth; i++, shown++) {
        if (shown == 8 && i + 1 < depth) {
            chain = arena_printf(&c->s->session, "%s ... ->", chain);
            i = depth - 1;
        }
        chain = arena_printf(&c->s->session, "%s%s -> ", chain, stack[i].info->func->name);
    }
    chain = arena_printf(&c->s->session, "%s%s", chain, to->func->name);
    diag_emit(c->s, DIAG_recursion, at, to->func->name, chain);
}

/* Depth first with a stack of its own: a chain of calls may be as long as a file. Facts of the callees flow up. */
static void walk_calls(Checker *c, FuncInfo *root, Frame *stack) {
    uint32_t depth = 0;
    stack[depth++] = (Frame){root, 0};
    root->color = 1;
    while (depth) {
        Frame *f = &stack[depth - 1];
        if (f->next < f->info->calls.len) {
            CallEdge *edge = &f->info->calls.data[f->next++];
            FuncInfo *to = func_info(c, edge->callee);
            if (to->color == 1) report_recursion(c, stack, depth, to, edge->span);
            if (to->color) continue;
            to->color = 1;
            stack[depth++] = (Frame){to, 0};
            continue;
        }
        FuncInfo *info = f->info;
        info->func->uses_rand |= info->rand_span.file >= 0;
        for (uint32_t i = 0; i < info->calls.len; i++) {
            FuncInfo *to = func_info(c, info->calls.data[i].callee);
            info->func->uses_rand |= to->func->uses_rand;
            if (info->cull_span.file < 0) info->cull_span = to->cull_span;
        }
        info->color = 2;
        depth--;
    }
}

typedef struct FindRand {
    Span span;
} FindRand;
static void find_rand(Expr *e, void *user) {
    FindRand *found = user;
    if (found->span.file >= 0) return;
    if (e->kind == E_BUILTIN && (e->builtin == B_rand || e->builtin == B_rand2 || e->builtin == B_rand3))
        found->span = e->span;
    if (e->kind == E_CALL && e->func && e->func->uses_rand) found->span = e->op_span;
}

static void check_culls(Checker *c) {
    for (uint32_t i = 0; i < c->culls.len; i++) {
        Stmt *loop = c->culls.data[i].loop;
        FindRand found = {SPAN_NONE};
        visit_stmt(loop, find_rand, &found);
        if (found.span.file >= 0) {
            Diag *d =
                diag_emit(c->s, DIAG_bad_cull, found.span,
                          "a loop under [Cull] may not call `rand()`: skipped iterations would shift the numbers");
            diag_note(c->s, d, loop->attrs.cull_span, "[Cull] is here");
        }
        if (loop->attrs.cull && loop->attrs.cull->uses_rand)
            diag_emit(c->s, DIAG_bad_cull, loop->attrs.cull_span,
                      arena_printf(&c->s->session, "`%s` may not call `rand()`", loop->attrs.cull_name));
    }
    for (uint32_t i = 0; i < c->ninfo; i++) {
        FuncInfo *info = &c->info[i];
        if (info->func->is_shader && info->func->dim && info->func->dim != 2 && info->cull_span.file >= 0) {
            Diag *d = diag_emit(c->s, DIAG_bad_cull, info->cull_span,
                                arena_printf(&c->s->session, "[Cull] works in 2D, but the entry point `%s` is %uD",
                                             info->func->name, info->func->dim));
            diag_note(c->s, d, info->func->name_span, "`%s` is declared here", info->func->name);
        }
    }
}

/* ---- entry */

static Func *choose_entry(Checker *c) {
    Session *s = c->s;
    Func *named_main = NULL, *only = NULL, *found = NULL;
    uint32_t n = 0;
    const char *names[256];
    for (Func *f = c->main->funcs; f; f = f->next) {
        if (!f->is_shader) continue;
        if (n < 256) names[n] = f->name;
        n++;
        only = f;
        if (!strcmp(f->name, "main")) named_main = f;
        if (c->opt && c->opt->entry && !found && !strcmp(f->name, c->opt->entry)) found = f;
    }
    Span top = {c->main->file, 0, 0};
    if (c->opt && c->opt->entry) {
        if (found) return found;
        const char *near = suggest_nearest(c->opt->entry, names, n < 256 ? n : 256);
        diag_emit(s, DIAG_unknown_entry, top, c->opt->entry,
                  near ? arena_printf(&s->session, ", did you mean `%s`?", near) : "");
        s->bad_usage = true;
        return NULL;
    }
    if (!n) {
        /* after a syntax error the shader may be there and was only not understood */
        for (const Diag *d = s->diags; d; d = d->next)
            if (d->severity == SEV_ERROR && d->span.file == c->main->file &&
                !strncmp(diag_code_name(d->code), "E00", 3))
                return NULL;
        diag_emit(s, DIAG_no_entry, top);
        return NULL;
    }
    if (named_main) return named_main;
    if (n == 1) return only;
    diag_emit(s, DIAG_several_entries, only->name_span);
    return NULL;
}

Func *check_program(Session *s, Module *main, const FrontOptions *opt) {
    Checker *c = ARENA_NEW(&s->module, Checker);
    c->s = s;
    c->arena = &s->module;
    c->opt = opt;
    c->main = main;
    c->poison.kind = DECL_ERROR;
    fill_language(c);
    uint32_t nfuncs = 0;
    for (Module *m = main; m; m = m->next) {
        c->nscopes++;
        for (Func *f = m->funcs; f; f = f->next) nfuncs++;
    }
    c->scopes = ARENA_ARRAY(c->arena, ModuleScope, c->nscopes);
    c->info = ARENA_ARRAY(c->arena, FuncInfo, nfuncs + 1);
    uint32_t at = 0;
    for (Module *m = main; m; m = m->next) c->scopes[at++].module = m;
    for (uint32_t i = 0; i < c->nscopes; i++) fill_scope(c, &c->scopes[i]);
    for (uint32_t i = 0; i < c->nscopes; i++) {
        ModuleScope *scope = &c->scopes[i];
        Module *m = scope->module;
        context_enter(c, scope, NULL);
        uint32_t ns = 0;
        for (StructDecl *d = m->struct_decls; d; d = d->next) ns++;
        m->structs = ARENA_ARRAY(c->arena, Type *, ns + 1);
        for (StructDecl *d = m->struct_decls; d; d = d->next) {
            TypeRef ref = {.name = d->name, .span = d->span};
            resolve_type(c, &ref, false, CHECK_MAX_ARRAY);
            if (d->type && d->type->kind == T_STRUCT) m->structs[m->nstructs++] = d->type;
        }
        for (TypedefDecl *d = m->typedefs; d; d = d->next) {
            TypeRef ref = {.name = d->name, .span = d->span};
            resolve_type(c, &ref, false, CHECK_MAX_ARRAY);
        }
        for (Symbol *sym = m->consts; sym; sym = sym->next) check_const_decl(c, sym, scope);
        for (Symbol *sym = m->params; sym; sym = sym->next) check_param_decl(c, sym, scope);
        for (Func *f = m->funcs; f; f = f->next) func_signature(c, f);
        for (uint32_t j = 0; j < scope->names.cap; j++) {
            Decl *d = scope->names.keys[j] ? scope->names.values[j] : NULL;
            if (d && d->kind == DECL_FUNC) check_overload_set(c, d);
        }
    }
    for (uint32_t i = 0; i < c->ninfo; i++) check_function(c, c->info[i].func);
    for (uint32_t i = 0; i < c->ninfo; i++) check_discs(c, c->info[i].func); /* looks into functions: all have types */
    Frame *stack = ARENA_ARRAY(c->arena, Frame, c->ninfo + 1);
    for (uint32_t i = 0; i < c->ninfo; i++)
        if (!c->info[i].color) walk_calls(c, &c->info[i], stack);
    check_culls(c);
    return choose_entry(c);
}
