/* `const` and `param` at file scope: values, overrides, assets, attributes. */
#include "compiler/front/check/internal.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "saltus/mesh.h"

/* Symbol.id of file-scope symbols is the state of their check. */
enum { FRESH, BUSY, DONE };

static const char *qualified(Checker *c, const Symbol *sym, const Module *m) {
    return m->is_main ? sym->name : arena_printf(&c->s->session, "%s.%s", m->name, sym->name);
}

/* ---- constants */

/* Parses a literal of the command line. Returns what is wrong with it, or NULL. */
static const char *parse_override(const char *text, TypeKind k, ConstVal *out) {
    out->n = 1;
    if (k == T_BOOL) {
        if (strcmp(text, "true") && strcmp(text, "false")) return "a bool is `true` or `false`";
        out->v[0].i = text[0] == 't';
        return NULL;
    }
    bool negative = text[0] == '-';
    const char *digits = text + (negative || text[0] == '+');
    if (!(*digits >= '0' && *digits <= '9') && !(k == T_FLOAT && *digits == '.')) return "this is no number";
    char *end;
    errno = 0;
    if (k == T_FLOAT) {
        if (digits[0] == '0' && (digits[1] == 'x' || digits[1] == 'X')) return "this is no float";
        double v = plain_strtod(digits, &end);
        if (*end == 'f' && end[1] == 0) end++;
        if (*end || isinf(v)) return "this is no float";
        out->v[0].f = negative ? -v : v;
        return NULL;
    }
    bool hex = digits[0] == '0' && (digits[1] == 'x' || digits[1] == 'X');
    unsigned long long v = strtoull(digits, &end, hex ? 16 : 10);
    if (k == T_UINT && (*end == 'u' || *end == 'U') && !end[1]) end++;
    if (*end || errno) return k == T_INT ? "this is no int" : "this is no uint";
    if (k == T_UINT && (negative || v > UINT32_MAX)) return "this is outside of uint";
    if (k == T_INT && v > (negative ? 2147483648ull : hex ? UINT32_MAX : 2147483647ull))
        return "this is outside of int";
    out->v[0].i = const_wrap(k, negative ? -(int64_t)v : (int64_t)v);
    return NULL;
}

static void apply_override(Checker *c, Symbol *sym, Type *t, const Module *m) {
    const char *name = qualified(c, sym, m);
    for (uint32_t i = 0; c->opt && i < c->opt->noverrides; i++) {
        ConstOverride *o = &c->opt->overrides[i];
        if (strcmp(o->name, name)) continue;
        o->used = true;
        const char *why = is_scalar(t) ? NULL : "only scalar constants can be set";
        ConstVal v = {0};
        if (!why) why = parse_override(o->text, t->kind, &v);
        if (why) {
            diag_emit(c->s, DIAG_bad_set, sym->span, o->name, o->text, why);
            c->s->bad_usage = true;
            return;
        }
        Expr at = {.span = sym->span, .op_span = sym->span};
        Expr *e = new_expr(c, E_LITERAL, &at, t);
        e->cval = v;
        e->is_const = true;
        sym->init = e;
        return;
    }
}

/* Notes where a value stops being constant: the first name in it that is none. */
typedef struct Culprit {
    Expr *e;
} Culprit;
static void find_culprit(Expr *e, void *user) {
    Culprit *found = user;
    if (!found->e && !e->is_const &&
        ((e->kind == E_NAME && e->sym) || e->kind == E_CALL || e->kind == E_METHOD ||
         (e->kind == E_BUILTIN && !e->nargs)))
        found->e = e;
}

static void report_not_constant(Checker *c, Expr *e, const char *what) {
    Culprit found = {0};
    visit_expr(e, find_culprit, &found);
    Span at = found.e ? found.e->span : e->span;
    Diag *d = diag_emit(c->s, DIAG_not_constant, at, what);
    if (found.e && found.e->kind == E_NAME)
        diag_note(c->s, d, found.e->sym->span, "`%s` is a %s", found.e->sym->name,
                  found.e->sym->kind == SYM_PARAM ? "param" : "variable");
    else if (found.e && found.e->kind == E_CALL && found.e->func)
        diag_note(c->s, d, found.e->func->name_span, "functions are not evaluated at compile time");
}

/* Replaces sym->init by its checked value of the type; false if it was reported. */
static bool constant_value(Checker *c, Symbol *sym, Type *t, const char *what) {
    sym->init = check_init(c, sym->init, t);
    if (sym->init->type->kind == T_ERROR) return false;
    if (!sym->init->is_const) {
        report_not_constant(c, sym->init, what);
        return false;
    }
    if (is_aggregate(t)) {
        sym->array_init = const_list(sym->init);
        if (!sym->array_init) return false;
        sym->init = sym->array_init;
    } else {
        sym->cval = sym->init->cval;
    }
    return true;
}

void check_const_decl(Checker *c, Symbol *sym, ModuleScope *scope) {
    if (sym->id != FRESH)
        return; /* BUSY: the symbol has no type yet, so the name that led here is reported as a cycle */
    sym->id = BUSY;
    enter_depth(c);
    Context old = context_enter(c, scope, NULL);
    sym->module = scope->module;
    bool open = sym->type_ref->ndims && !sym->type_ref->dims[0] && sym->init && sym->init->kind == E_LIST;
    Type *t = resolve_type(c, sym->type_ref, open, CHECK_MAX_CONST);
    if (open && t->kind == T_ARRAY) t = type_array(c->s, t->elem, sym->init->nargs ? sym->init->nargs : 1);
    if (type_is_resource(t)) {
        diag_emit(c->s, DIAG_bad_resource, sym->span,
                  arena_printf(&c->s->session, "a %s is declared with `param`", t->name));
        t = c->t_error;
    } else if (t->kind == T_VOID) {
        diag_emit(c->s, DIAG_void_value, sym->span, "constant");
        t = c->t_error;
    }
    bool ok = t->kind != T_ERROR && sym->init; /* the parser reports a missing value */
    if (ok) apply_override(c, sym, t, scope->module);
    if (ok) ok = constant_value(c, sym, t, "the value of a `const` at file scope");
    sym->type = ok ? t : c->t_error;
    context_leave(c, old);
    c->depth--;
    sym->id = DONE;
}

/* ---- parameters */

static const char *asset_path(Checker *c, const Symbol *sym, const Module *m) {
    const char *text = sym->asset_text, *dir = c->s->sources[m->file].dir;
    if (text[0] == '/' || !dir || !*dir) return text;
    size_t n = strlen(dir);
    return arena_printf(&c->s->session, "%s%s%s", dir, dir[n - 1] == '/' ? "" : "/", text);
}

static ParamFile *file_override(Checker *c, const char *name) {
    for (uint32_t i = 0; c->opt && i < c->opt->nfiles; i++)
        if (!strcmp(c->opt->files[i].name, name)) return &c->opt->files[i];
    return NULL;
}

/* The file of a path that may name a part of it, `spot.obj:normals`. */
static const char *file_of(Checker *c, const char *path) {
    const char *colon = strrchr(path, ':');
    return !colon || strchr(colon, '/') ? path : arena_strndup(&c->s->session, path, (size_t)(colon - path));
}

/* Readers of files begin with `cannot read 'FILE': `, as the message does. */
static const char *without_file(const char *why) {
    static const char begin[] = "cannot read '";
    const char *end = strncmp(why, begin, sizeof begin - 1) ? NULL : strstr(why, "': ");
    return end ? end + strlen("': ") : why;
}

static bool probe_asset(Checker *c, const Symbol *sym, uint32_t dims[4], uint32_t *ndims) {
    const char *why = NULL;
    bool ok = false;
    *ndims = 0;
    bool own = !file_override(c, sym->doc_name); /* the source names it, and not the caller */
    if (!c->opt || !c->opt->probe) why = "files cannot be read here";
    else if (!own || (session_allows(c->s, sym->asset_text, sym->asset, &why) &&
                      session_allows(c->s, sym->asset_text, file_of(c, sym->asset), &why)))
        ok = c->opt->probe(c->opt->probe_user, sym->asset, sym, dims, ndims, &why);
    if (ok) return true;
    diag_emit(c->s, DIAG_bad_asset, sym->value_span.file >= 0 ? sym->value_span : sym->span, sym->asset,
              why ? without_file(why) : "unknown reason");
    c->s->bad_input = true;
    return false;
}

static Type *shape_error(Checker *c, const Symbol *sym, const char *text) {
    diag_emit(c->s, DIAG_asset_shape, sym->value_span.file >= 0 ? sym->value_span : sym->span, text);
    c->s->bad_input = true;
    return c->t_error;
}

static bool array_limit(Checker *c, const Symbol *sym, uint64_t scalars) {
    if (scalars <= CHECK_MAX_ARRAY) return true;
    diag_emit(c->s, DIAG_array_limit, sym->span,
              arena_printf(&c->s->session, "%llu scalars", (unsigned long long)scalars), "268435456 (2^28)");
    return false;
}

/* The sizes of the file against those of the array: elements along the first, the numbers of one element along the
 * rest. */
static Type *array_from_asset(Checker *c, Symbol *sym, Type *t) {
    Session *s = c->s;
    uint32_t dims[4] = {0}, nd = 0;
    if (!probe_asset(c, sym, dims, &nd)) return c->t_error;
    uint64_t total = 1;
    const char *shape = "";
    for (uint32_t i = 0; i < nd && i < 4; i++) {
        total *= dims[i];
        shape = arena_printf(&s->session, "%s%s%u", shape, i ? " x " : "", dims[i]);
    }
    uint64_t per = type_components(t->elem), first = nd ? dims[0] : 0;
    if (per && total % per == 0 && (nd == 1 || (nd == 2 && dims[0] == 1)))
        first = total / per; /* one line of numbers */
    if (!first || total != first * per)
        return shape_error(c, sym,
                           arena_printf(&s->session, "`%s` has %s numbers, `%s` has %llu in an element of type %s",
                                        sym->asset, nd ? shape : "no", sym->name, (unsigned long long)per,
                                        t->elem->name));
    if (t->n && first != t->n)
        return shape_error(c, sym,
                           arena_printf(&s->session, "`%s` has %llu rows, `%s` has %u elements", sym->asset,
                                        (unsigned long long)first, sym->name, t->n));
    if (!array_limit(c, sym, total)) return c->t_error;
    return t->n ? t : type_array(s, t->elem, (uint32_t)first);
}

/* The row of a geometry's type; of a texture, NULL. */
static const GeometryType *geometry_of(const Type *t) { return t->kind == T_GEOMETRY ? &geometry_types[t->n] : NULL; }

/* "8 x 4 with 3 channels", "8 x 4 x 2 with 1 channel". */
static const char *texture_shape(Checker *c, const Symbol *sym) {
    const char *depth = sym->type->kind == T_TEXTURE3D ? arena_printf(&c->s->session, " x %u", sym->tex_d) : "";
    return arena_printf(&c->s->session, "%u x %u%s with %u channels", sym->tex_w, sym->tex_h, depth, sym->tex_c);
}

/* what: of which the sizes are. */
static bool texture_fits(Checker *c, const Symbol *sym, const GeometryType *grid, const char *what) {
    uint32_t least = grid ? grid->least : 1;
    bool volume = sym->type->kind == T_TEXTURE3D;
    if (sym->tex_w < least || sym->tex_h < least || (volume && !sym->tex_d) || sym->tex_c < 1 ||
        sym->tex_c > (grid ? 1 : 4) ||
        (double)sym->tex_w * sym->tex_h * (volume ? sym->tex_d : 1) * sym->tex_c > (double)CHECK_MAX_TEXELS) {
        shape_error(
            c, sym,
            arena_printf(&c->s->session, "%s is %s, which is no %s", what, texture_shape(c, sym), sym->type->name));
        return false;
    }
    return true;
}

static bool texture_from_asset(Checker *c, Symbol *sym, const GeometryType *grid) {
    uint32_t dims[4] = {0}, nd = 0;
    bool volume = sym->type->kind == T_TEXTURE3D;
    if (!probe_asset(c, sym, dims, &nd)) return false;
    sym->tex_w = dims[0];
    sym->tex_h = nd > 1 ? dims[1] : 0;
    sym->tex_d = volume ? dims[2] : 0;
    sym->tex_c = grid ? 1 : volume ? dims[3] : nd > 2 ? dims[2] : 1;
    return texture_fits(c, sym, grid, arena_printf(&c->s->session, "`%s`", sym->asset));
}

/* Its sizes are known now, its numbers and faces are read when all is well. */
static bool mesh_from_asset(Checker *c, Symbol *sym) {
    uint32_t dims[4] = {0}, nd = 0;
    if (!probe_asset(c, sym, dims, &nd)) return false;
    sym->nvertices = dims[0], sym->nfaces = dims[1], sym->has_uv = dims[2], sym->valence = dims[3];
    return array_limit(c, sym, 3 * (uint64_t)dims[0]) && array_limit(c, sym, SLT_MESH_TOPOLOGY(dims[1], dims[2]));
}

static bool texture_zeros(Checker *c, Symbol *sym, const GeometryType *grid) {
    Session *s = c->s;
    bool volume = sym->type->kind == T_TEXTURE3D, ok = true;
    uint32_t sides = volume ? 3 : 2;
    int64_t v[4] = {0}, least = grid ? grid->least : 1;
    v[sides] = grid ? 1 : 4;
    double total = 1;
    const char *why = NULL, *what = sym->type->kind == T_TEXTURE ? "texture" : sym->type->name;
    for (uint32_t i = 0; i < sym->nzeros_args && i <= sides; i++) {
        sym->zeros_args[i] = check_value(c, sym->zeros_args[i]);
        ok &= const_int(c, sym->zeros_args[i], "an argument of `zeros`", &v[i]);
    }
    if (!ok) return false;
    for (uint32_t i = 0; i <= sides; i++) total *= (double)v[i];
    for (uint32_t i = 0; i < sides; i++)
        if (v[i] < least)
            why = arena_printf(&s->session, "a %s is at least %d x %d%s", what, (int)least, (int)least,
                               volume ? " x 1" : "");
    if (sym->nzeros_args < sides || sym->nzeros_args > sides + 1)
        why = arena_printf(&s->session, "a %s is `zeros(width, height%s)`, or with the number of channels behind", what,
                           volume ? ", depth" : "");
    else if (grid && v[sides] != 1) why = arena_printf(&s->session, "a %s has one channel", grid->name);
    else if (v[sides] < 1 || v[sides] > 4) why = arena_printf(&s->session, "a %s has 1 to 4 channels", what);
    else if (!why && total > (double)CHECK_MAX_TEXELS) why = "more than 2^28 numbers";
    if (why) {
        diag_emit(s, DIAG_bad_zeros, sym->value_span.file >= 0 ? sym->value_span : sym->span, why);
        return false;
    }
    sym->tex_w = (uint32_t)v[0], sym->tex_h = (uint32_t)v[1], sym->tex_d = volume ? (uint32_t)v[2] : 0;
    sym->tex_c = (uint32_t)v[sides];
    return true;
}

/* param T a[N][M] = init(f): T f(int, int). */
static bool check_init_func(Checker *c, Symbol *sym) {
    Session *s = c->s;
    uint32_t nd = 0;
    Type *elem = sym->type;
    for (; elem->kind == T_ARRAY; elem = elem->elem) nd++;
    Span at = sym->value_span.file >= 0 ? sym->value_span : sym->span;
    if (!nd) {
        diag_emit(s, DIAG_bad_init, at, "`init(f)` fills an array; this is none");
        return false;
    }
    Decl *d = scope_find(c, sym->init_name, at);
    if (d && d->kind == DECL_ERROR) return false;
    if (!d || d->kind != DECL_FUNC) {
        diag_emit(s, DIAG_bad_init, at,
                  arena_printf(&s->session, "`%s` is %s", sym->init_name,
                               d ? "not a function"
                                 : arena_printf(&s->session, "unknown%s", suggest(c, sym->init_name, false))));
        return false;
    }
    for (uint32_t i = 0; i < d->nfuncs; i++) {
        Func *f = d->funcs[i];
        func_signature(c, f);
        if (!func_info(c, f)->signature_ok) return false;
        bool fits = f->nargs == nd && !f->is_shader;
        for (uint32_t j = 0; fits && j < nd; j++) fits = f->args[j]->type == c->t_int && f->args[j]->mode == ARG_IN;
        if (!fits) continue;
        if (f->ret != elem) {
            Diag *diag = diag_emit(s, DIAG_bad_init, at,
                                   arena_printf(&s->session, "`%s` returns %s, an element of `%s` is %s", f->name,
                                                f->ret->name, sym->name, elem->name));
            diag_note(s, diag, f->name_span, "`%s` is declared here", func_text(c, f));
            return false;
        }
        sym->init_func = f;
        return true;
    }
    Diag *diag = diag_emit(s, DIAG_bad_init, at,
                           arena_printf(&s->session, "`init` needs `%s %s(int%s)`: one int for each dimension",
                                        elem->name, sym->init_name,
                                        nd == 1   ? ""
                                        : nd == 2 ? ", int"
                                                  : ", int, ..."));
    for (uint32_t i = 0; i < d->nfuncs && i < 8; i++)
        diag_note(s, diag, d->funcs[i]->name_span, "candidate: `%s`", func_text(c, d->funcs[i]));
    return false;
}

static bool param_error(Checker *c, const Symbol *sym, const char *text) {
    diag_emit(c->s, DIAG_param_value, sym->value_span.file >= 0 && sym->value_span.len ? sym->value_span : sym->span,
              text);
    return false;
}

/* The sizes of the values that the caller has for a parameter, at most `most` of them; 0: it has no list. */
static uint32_t given_sizes(Checker *c, Symbol *sym, uint32_t most, uint64_t *sizes) {
    if (!c->opt || !c->opt->given) return 0;
    uint32_t n = c->opt->given(c->opt->probe_user, sym->doc_name, most, sizes);
    sym->sized = n > 0;
    return n;
}

/* An open array whose values the caller has: as many elements as there. */
static bool array_by_values(Checker *c, Symbol *sym, bool *ok) {
    uint64_t n = 0;
    if (!given_sizes(c, sym, 1, &n)) return false;
    *ok = n ? n <= UINT32_MAX && array_limit(c, sym, n * type_components(sym->type->elem))
            : param_error(c, sym, "an array has at least one element, and the values that were given for it have none");
    if (!n) c->s->bad_input = true;
    if (*ok) sym->type = type_array(c->s, sym->type->elem, (uint32_t)n);
    return true;
}

/* A texture or a geometry whose texels the caller has: [slices,] rows, columns[, channels]. A shorter list, as of one
 * colour for all texels, says nothing of sizes. */
static bool texture_by_values(Checker *c, Symbol *sym, const GeometryType *grid, bool *ok) {
    uint64_t n[4] = {0};
    bool volume = sym->type->kind == T_TEXTURE3D;
    uint32_t sides = volume ? 3 : 2, nd = given_sizes(c, sym, sides + 1, n), size[4];
    sym->sized = nd >= sides;
    if (!sym->sized) return false;
    for (uint32_t i = 0; i < 4; i++) size[i] = n[i] < UINT32_MAX ? (uint32_t)n[i] : UINT32_MAX;
    sym->tex_d = volume ? size[0] : 0;
    sym->tex_h = size[sides - 2], sym->tex_w = size[sides - 1];
    sym->tex_c = nd == sides ? 1 : size[sides];
    *ok = texture_fits(c, sym, grid, arena_printf(&c->s->session, "what was given for `%s`", sym->name));
    return true;
}

/* Gives the symbol its value and, where the size is open, its type. */
static bool param_value(Checker *c, Symbol *sym) {
    Session *s = c->s;
    Type *t = sym->type;
    bool open = t->kind == T_ARRAY && !t->n, ok;
    sym->open = open;
    ParamFile *file = file_override(c, sym->doc_name);
    if (open && !file && array_by_values(c, sym, &ok)) return ok;
    if (type_is_resource(t) && !type_is_mesh(t) && !file && texture_by_values(c, sym, geometry_of(t), &ok)) return ok;
    if (file && (type_is_resource(t) || open || sym->asset_text)) {
        file->used = true;
        sym->asset = file->path;
    } else if (sym->asset_text) {
        sym->asset = asset_path(c, sym, sym->module);
    }
    if (type_is_mesh(t)) {
        if (sym->asset) return mesh_from_asset(c, sym);
        return param_error(c, sym, "the value of a mesh is a file: `\"a.obj\"` or `\"a.ply\"`");
    }
    if (type_is_resource(t)) {
        if (sym->asset) return texture_from_asset(c, sym, geometry_of(t));
        if (sym->zeros) return texture_zeros(c, sym, geometry_of(t));
        return param_error(c, sym,
                           arena_printf(&s->session, "the value of a %s is a file (`\"%s\"`) or `zeros(w, h%s)`",
                                        t->name, t->kind == T_TEXTURE3D ? "a.npy" : "a.exr",
                                        t->kind == T_TEXTURE3D ? ", d" : ""));
    }
    if (sym->zeros)
        return param_error(
            c, sym, arena_printf(&s->session, "`zeros` is a value of textures and geometries, not of %s", t->name));
    if (sym->asset) {
        if (t->kind != T_ARRAY)
            return param_error(
                c, sym,
                arena_printf(&s->session, "a file is a value of arrays, textures and geometries, not of %s", t->name));
        sym->type = array_from_asset(c, sym, t);
        return sym->type->kind != T_ERROR;
    }
    if (sym->init_name) {
        if (open) return param_error(c, sym, "`init(f)` needs the size of the array");
        return check_init_func(c, sym);
    }
    if (!sym->init && sym->starts_zero && !open) sym->init = check_zero(c, sym->span, t);
    if (!sym->init) return false; /* the parser reports a missing value */
    if (open) {
        if (sym->init->kind == E_LIST) {
            if (!sym->init->nargs) return param_error(c, sym, "an array has at least one element");
            if ((uint64_t)sym->init->nargs * type_components(t->elem) > CHECK_MAX_CONST) {
                diag_emit(s, DIAG_array_limit, sym->span, "more than 4194304 scalars", "4194304 (2^22)");
                return false;
            }
            sym->type = type_array(s, t->elem, sym->init->nargs);
        } else {
            sym->init = check_value(c, sym->init);
            Type *ti = sym->init->type;
            if (ti->kind == T_ERROR) return false;
            if (ti->kind != T_ARRAY || ti->elem != t->elem)
                return param_error(c, sym, "an open size comes from a list or a file");
            sym->type = ti;
        }
    }
    ok = constant_value(c, sym, sym->type, "the value of a parameter");
    sym->array_init = NULL; /* a parameter is no constant */
    return ok;
}

/* ---- attributes */

static bool has_scalars(const Type *t, bool floats_only) {
    if (type_is_resource(t)) return true;
    if (t->kind == T_ARRAY) return has_scalars(t->elem, floats_only);
    if (t->kind == T_STRUCT) {
        for (uint32_t i = 0; i < t->nfields; i++)
            if (has_scalars(t->fields[i].type, floats_only)) return true;
        return false;
    }
    TypeKind k = scalar_kind(t);
    return k == T_FLOAT || (!floats_only && (k == T_INT || k == T_UINT));
}

static bool attr_number(Checker *c, Expr **e, const char *what, double *out) {
    if (!*e) return false;
    *e = check_value(c, *e);
    if ((*e)->type->kind == T_ERROR) return false;
    *e = convert(c, *e, c->t_float, 0);
    if ((*e)->type->kind == T_ERROR) return false;
    if (!(*e)->is_const) {
        report_not_constant(c, *e, what);
        return false;
    }
    *out = (*e)->cval.v[0].f;
    if (isnan(*out)) {
        diag_emit(c->s, DIAG_attr_args, (*e)->span, arena_printf(&c->s->session, "%s is not a number", what));
        return false;
    }
    return true;
}

static bool placed_by(const Type *t, uint32_t attribute) {
    return t->kind == T_GEOMETRY && geometry_types[t->n].attributes & attribute;
}

static void misplaced(Checker *c, Span at, const Symbol *sym, const char *name, const Type *t) {
    diag_emit(c->s, DIAG_attr_misplaced, at.file >= 0 ? at : sym->span, name,
              arena_printf(&c->s->session, "a parameter of type %s", t->name));
}

/* Of a parameter or a field; false: it marks what has no scalars. */
static bool check_range(Checker *c, ParamAttrs *a, const Type *t) {
    bool ok = attr_number(c, &a->range_args[0], "an argument of [Range]", &a->lo);
    ok &= attr_number(c, &a->range_args[1], "an argument of [Range]", &a->hi);
    if (!has_scalars(t, false)) return false;
    if (ok && a->lo > a->hi)
        diag_emit(c->s, DIAG_attr_args, a->range_span,
                  arena_printf(&c->s->session, "[Range(lo, hi)] needs lo <= hi, these are %g and %g", a->lo, a->hi));
    return true;
}

void check_field_attrs(Checker *c, ParamAttrs *a, const Type *t, Span at) {
    const char *what = arena_printf(&c->s->session, "a field of type %s", t->name);
    if (a->has_range && !check_range(c, a, t))
        diag_emit(c->s, DIAG_attr_misplaced, a->range_span.file >= 0 ? a->range_span : at, "Range", what);
    if (a->log && !has_scalars(t, true))
        diag_emit(c->s, DIAG_attr_misplaced, a->log_span.file >= 0 ? a->log_span : at, "Log", what);
}

static void param_attrs(Checker *c, Symbol *sym) {
    ParamAttrs *a = &sym->attrs;
    Type *t = sym->type, *elem = t;
    while (elem->kind == T_ARRAY) elem = elem->elem;
    if (t->kind == T_ERROR) return;
    if (a->has_range && !check_range(c, a, t)) misplaced(c, a->range_span, sym, "Range", t);
    if (a->has_extent) {
        bool ok = true;
        for (int i = 0; i < 4; i++) ok &= attr_number(c, &a->extent_args[i], "an argument of [Extent]", &a->extent[i]);
        if (!placed_by(t, PLACED_EXTENT)) misplaced(c, a->extent_span, sym, "Extent", t);
        else if (ok && !(a->extent[0] < a->extent[2] && a->extent[1] < a->extent[3] &&
                         isfinite(a->extent[0] - a->extent[2]) && isfinite(a->extent[1] - a->extent[3])))
            diag_emit(c->s, DIAG_attr_args, a->extent_span,
                      "[Extent(x0, y0, x1, y1)] needs x0 < x1 and y0 < y1, all finite");
    }
    if (a->has_height) {
        bool ok = attr_number(c, &a->height_args[0], "an argument of [Height]", &a->height_scale);
        ok &= attr_number(c, &a->height_args[1], "an argument of [Height]", &a->height_offset);
        if (!placed_by(t, PLACED_HEIGHT)) misplaced(c, a->height_span, sym, "Height", t);
        else if (ok && (!isfinite(a->height_scale) || !isfinite(a->height_offset)))
            diag_emit(c->s, DIAG_attr_args, a->height_span, "[Height(scale, offset)] needs finite numbers");
    }
    if (a->vertex_name && type_is_mesh(t)) check_vertex(c, sym);
    else if (a->vertex_name) misplaced(c, a->vertex_span, sym, "Vertex", t);
    if (a->log && !has_scalars(t, true)) misplaced(c, a->log_span, sym, "Log", t);
    if (a->color && !type_is_texture(elem) && !(elem->kind == T_VECTOR && elem->n >= 3 && scalar_kind(elem) == T_FLOAT))
        misplaced(c, a->color_span, sym, "Color", t);
}

void check_param_decl(Checker *c, Symbol *sym, ModuleScope *scope) {
    if (sym->id != FRESH) return; /* BUSY: the caller sees a symbol without a type */
    sym->id = BUSY;
    enter_depth(c);
    Context old = context_enter(c, scope, NULL);
    sym->doc_name = qualified(c, sym, scope->module);
    sym->module = scope->module;
    Type *t = resolve_type(c, sym->type_ref, true, CHECK_MAX_ARRAY);
    if (t->kind == T_VOID) {
        diag_emit(c->s, DIAG_void_value, sym->span, "parameter");
        t = c->t_error;
    }
    if (t->kind != T_ERROR) {
        sym->type = t;
        if (!param_value(c, sym)) {
            if (sym->type->kind == T_ARRAY && !sym->type->n) sym->type = c->t_error;
        }
        param_attrs(c, sym);
    } else {
        sym->type = c->t_error;
    }
    context_leave(c, old);
    c->depth--;
    sym->id = DONE;
}
