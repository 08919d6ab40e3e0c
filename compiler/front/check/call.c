/* Calls: overloads of users' functions, builtins by their signatures, methods, constructors, lists. */
#include "compiler/front/check/internal.h"

#include <string.h>

static const char *const builtin_names[] = {
    [B_NONE] = "",
#define BUILTIN(id, name, ...) [B_##id] = name,
#include "compiler/front/check/builtins.def"
#undef BUILTIN
};
static const char *const builtin_sigs[] = {
    [B_NONE] = "",
#define BUILTIN(id, name, sig, ...) [B_##id] = sig,
#include "compiler/front/check/builtins.def"
#undef BUILTIN
};

const char *builtin_name(Builtin b) { return builtin_names[b]; }
const char *builtin_signature(Builtin b) { return builtin_sigs[b]; }

const char *types_text(Checker *c, Expr **args, uint32_t n) {
    const char *text = "";
    for (uint32_t i = 0; i < n && i < 32; i++)
        text = arena_printf(&c->s->session, "%s%s%s", text, i ? ", " : "", i == 31 ? "..." : args[i]->type->name);
    return text;
}

static bool check_args(Checker *c, Expr *e, bool resources) {
    bool ok = true;
    for (uint32_t i = 0; i < e->nargs; i++) {
        e->args[i] = resources ? check_expr(c, e->args[i]) : check_value(c, e->args[i]);
        if (e->args[i]->type->kind == T_VOID) {
            diag_emit(c->s, DIAG_void_value, e->args[i]->span, "call");
            fail(c, e->args[i]);
        }
        ok &= e->args[i]->type->kind != T_ERROR;
    }
    return ok;
}

static Expr *bad_count(Checker *c, Expr *e, const char *name, uint32_t want) {
    diag_emit(c->s, DIAG_arg_count, e->op_span.file >= 0 ? e->op_span : e->span, name,
              want ? arena_printf(&c->s->session, "%u argument%s", want, want == 1 ? "" : "s") : "no arguments",
              e->nargs);
    return fail(c, e);
}

static Expr *finish(Checker *c, Expr *e, Type *t) {
    e->type = t;
    const_fold(c, e);
    return e;
}

/* ---- users' functions */

/* Conversions that one argument needs, -1: it does not fit. */
static int argument_cost(Expr *arg, const Symbol *formal) {
    if (formal->type->kind == T_ERROR || arg->type->kind == T_ERROR) return 0;
    if (formal->mode != ARG_IN) return arg->type == formal->type && is_place(arg) ? 0 : -1;
    if (type_is_resource(formal->type)) return arg->type == formal->type && arg->kind == E_NAME ? 0 : -1;
    return conversion_cost(arg, formal->type, CONV_NARROW);
}

static bool viable(const Func *f, Expr *e) {
    if (f->nargs != e->nargs) return false;
    for (uint32_t i = 0; i < e->nargs; i++)
        if (argument_cost(e->args[i], f->args[i]) < 0) return false;
    return true;
}

/* a is at least as good in every argument and better in one. */
static bool better(const Func *a, const Func *b, Expr *e) {
    bool strictly = false;
    for (uint32_t i = 0; i < e->nargs; i++) {
        int ca = argument_cost(e->args[i], a->args[i]), cb = argument_cost(e->args[i], b->args[i]);
        if (ca > cb) return false;
        strictly |= ca < cb;
    }
    return strictly;
}

/* The variables of a GLSL file that it is given, which nobody wrote: the last arguments. */
static uint32_t hidden_args(const Func *f) {
    uint32_t n = 0;
    while (n < f->nargs && f->args[f->nargs - 1 - n]->hidden) n++;
    return n;
}

/* The only declaration does not fit: say which argument and why. */
static void report_single(Checker *c, Expr *e, const Func *f) {
    Diag *d = NULL;
    if (f->nargs != e->nargs) {
        uint32_t hidden = hidden_args(f), want = f->nargs - hidden;
        d = diag_emit(c->s, DIAG_arg_count, e->op_span, f->name,
                      arena_printf(&c->s->session, "%u argument%s", want, want == 1 ? "" : "s"), e->nargs - hidden);
    } else {
        for (uint32_t i = 0; i < e->nargs; i++) {
            const Symbol *formal = f->args[i];
            Expr *arg = e->args[i];
            if (argument_cost(arg, formal) >= 0) continue;
            const char *mode = formal->mode == ARG_OUT || formal->was_out ? "out" : "inout";
            if (formal->mode != ARG_IN && arg->type == formal->type)
                d = diag_emit(c->s, DIAG_out_argument, arg->span,
                              arena_printf(&c->s->session,
                                           "`%s` argument `%s` of `%s` must be something that can be assigned", mode,
                                           formal->name, f->name));
            else if (formal->mode != ARG_IN)
                d = diag_emit(c->s, DIAG_out_argument, arg->span,
                              arena_printf(&c->s->session,
                                           "`%s` argument `%s` of `%s` must be a %s exactly, this is %s", mode,
                                           formal->name, f->name, formal->type->name, arg->type->name));
            else if (type_is_resource(formal->type) || type_is_resource(arg->type) || is_aggregate(formal->type) ||
                     is_aggregate(arg->type))
                d = diag_emit(c->s, DIAG_cannot_convert, arg->span, arg->type->name, formal->type->name, "");
            else convert(c, arg, formal->type, CONV_NARROW);
            if (d) diag_note(c->s, d, f->name_span, "`%s` is declared here", func_text(c, f));
        }
        return;
    }
    diag_note(c->s, d, f->name_span, "`%s` is declared here", func_text(c, f));
}

static Expr *check_builtin_typed(Checker *c, Expr *e, Builtin b);

static Expr *check_user_call(Checker *c, Expr *e, Decl *d);

/* A call that no function of the file takes: of the builtin that has its name in GLSL. NULL: there is none. */
static Expr *check_other(Checker *c, Expr *e) {
    Builtin b = (Builtin)(uintptr_t)map_get(&c->builtin_funcs, e->other);
    if (b) return check_builtin_typed(c, e, b);
    Decl *d = e->other != e->name ? scope_find(c, e->other, e->op_span) : NULL;
    if (!d || d->kind != DECL_FUNC) return NULL;
    e->other = NULL;
    return check_user_call(c, e, d);
}

static bool any_viable(Checker *c, const Decl *d, Expr *e) {
    for (uint32_t i = 0; i < d->nfuncs; i++)
        if (!func_info(c, d->funcs[i])->signature_ok || viable(d->funcs[i], e)) return true;
    return false;
}

/* Do all want the same number of arguments, and another than this? Then that is what to say. */
static bool none_takes(const Decl *d, uint32_t nargs) {
    for (uint32_t i = 0; i < d->nfuncs; i++)
        if (d->funcs[i]->nargs == nargs || d->funcs[i]->nargs != d->funcs[0]->nargs) return false;
    return true;
}

static Expr *check_user_call(Checker *c, Expr *e, Decl *d) {
    for (uint32_t i = 0; i < d->nfuncs; i++) func_signature(c, d->funcs[i]);
    if (!check_args(c, e, true)) return fail(c, e);
    if (e->other && !any_viable(c, d, e)) {
        Expr *other = check_other(c, e);
        if (other) return other;
    }
    Func *best = NULL;
    bool tie = false;
    for (uint32_t i = 0; i < d->nfuncs; i++) {
        Func *f = d->funcs[i];
        if (!viable(f, e)) continue;
        if (!best || better(f, best, e)) best = f;
    }
    for (uint32_t i = 0; best && i < d->nfuncs; i++)
        if (d->funcs[i] != best && viable(d->funcs[i], e) && !better(best, d->funcs[i], e)) tie = true;
    if (!best || tie) {
        for (uint32_t i = 0; i < d->nfuncs; i++) /* a broken signature may have been the one */
            if (!func_info(c, d->funcs[i])->signature_ok || name_lost(c, d->funcs[i]->name)) return fail(c, e);
        if (!best && (d->nfuncs == 1 || none_takes(d, e->nargs))) {
            report_single(c, e, d->funcs[0]);
            return fail(c, e);
        }
        Diag *diag = diag_emit(c->s, best ? DIAG_ambiguous_call : DIAG_no_overload, e->op_span, d->name,
                               types_text(c, e->args, e->nargs - hidden_args(d->funcs[0])));
        uint32_t shown = 0;
        for (uint32_t i = 0; i < d->nfuncs && shown < 8; i++)
            if (!best || viable(d->funcs[i], e)) {
                diag_note(c->s, diag, d->funcs[i]->name_span, "candidate: `%s`", func_text(c, d->funcs[i]));
                shown++;
            }
        return fail(c, e);
    }
    e->func = best;
    if (best->is_shader) {
        Diag *diag = diag_emit(c->s, DIAG_call_shader, e->op_span, best->name);
        diag_note(c->s, diag, best->name_span, "`%s` is declared here", best->name);
        return fail(c, e);
    }
    for (uint32_t i = 0; i < e->nargs; i++)
        if (best->args[i]->mode == ARG_IN) e->args[i] = convert(c, e->args[i], best->args[i]->type, CONV_NARROW);
    if (c->at.func) vec_push(c->arena, &c->at.func->calls, ((CallEdge){best, e->op_span}));
    e->type = best->ret;
    return e;
}

/* ---- builtins */

static Expr *bad_builtin(Checker *c, Expr *e, const char *name, Span at, const char *want) {
    diag_emit(c->s, DIAG_bad_argument, at,
              arena_printf(&c->s->session, "`%s` takes %s, not (%s)", name, want, types_text(c, e->args, e->nargs)));
    return fail(c, e);
}

static Type *fixed_type(Checker *c, char letter) {
    switch (letter) {
    case 'f': return c->t_float;
    case 'i': return c->t_int;
    case 'u': return c->t_uint;
    case 'b': return c->t_bool;
    case '2': return type_vector(c->s, T_FLOAT, 2);
    case '3': return type_vector(c->s, T_FLOAT, 3);
    case 'w': return type_vector(c->s, T_UINT, 2);
    case 'W': return type_vector(c->s, T_UINT, 3);
    case 'x': return type_vector(c->s, T_INT, 2);
    case 'y': return type_vector(c->s, T_INT, 3);
    case '4': return type_vector(c->s, T_FLOAT, 4);
    case 'H': return c->t_hit;
    case 'S': return c->t_silhouette;
    case 'M': return c->t_mesh_hit;
    case 'E': return c->t_beam;
    case 'P': return c->t_piece;
    case 'A': return c->t_area_light;
    default: return NULL;
    }
}

static const char *letter_text(char letter) {
    switch (letter) {
    case 'F': return "floats or float vectors of one size";
    case 'N': return "numbers or vectors of one size";
    case 'I': return "integers or integer vectors of one size";
    case 'B': return "bools or a bool vector";
    case 'v': return "float vectors of one size";
    case 'm': return "a matrix";
    case 's': return "a square matrix";
    case '3': return "float3";
    default: return "other arguments";
    }
}

/* The common type of the arguments of one generic letter, or NULL. Texture results of four channels follow the others
 * where these are narrower vectors. */
static Type *generic_type(Checker *c, Expr *e, const char *letters, char letter) {
    Type *t = NULL;
    for (int pass = 0; pass < 2; pass++)
        for (uint32_t i = 0; i < e->nargs; i++) {
            if (letters[i] != letter || is_texture_result(e->args[i]) != (pass == 1)) continue;
            Type *a = e->args[i]->type;
            if (pass && t && width_of(t) > 1 && width_of(t) < 4) {
                t = with_width(c, T_FLOAT, width_of(t));
                e->args[i] = convert(c, e->args[i], t, CONV_NARROW);
                a = e->args[i]->type;
            }
            bool square = a->kind == T_MATRIX && a->n == a->columns;
            if (letter == 's'   ? !square
                : letter == 'm' ? a->kind != T_MATRIX
                : letter == 'v' ? a->kind != T_VECTOR
                                : !width_of(a))
                return NULL;
            if (t && letter == 'v' && t->n != a->n) return NULL;
            if (t && !(t = unify(c, t, a))) return NULL;
            if (!t) t = a;
        }
    if (!t) return NULL;
    TypeKind k = scalar_kind(t);
    if (letter == 'B') return k == T_BOOL ? t : NULL;
    if (k == T_BOOL) return NULL;
    if (letter == 'I') return k == T_FLOAT ? NULL : t;
    if (letter == 'F' || letter == 'v') return with_width(c, T_FLOAT, width_of(t));
    return t;
}

static Expr *check_builtin_sig(Checker *c, Expr *e, Builtin b) {
    const char *name = builtin_names[b], *sig = builtin_sigs[b], *letters = sig + 1;
    uint32_t want = (uint32_t)strlen(letters);
    if (e->nargs != want) return bad_count(c, e, name, want);
    Type *group = NULL;
    for (uint32_t i = 0; i < want; i++)
        if (strchr("FNIBvms", letters[i])) {
            group = generic_type(c, e, letters, letters[i]);
            if (!group) return bad_builtin(c, e, name, e->op_span, letter_text(letters[i]));
            break;
        }
    for (uint32_t i = 0; i < want; i++) {
        Type *t = strchr("FNIBvms", letters[i]) ? group : fixed_type(c, letters[i]);
        if (!t) ice(c->s, "builtin %s has signature %s", name, sig);
        if (conversion_cost(e->args[i], t, CONV_BROADCAST | CONV_NARROW) < 0 ||
            (t != group && width_of(t) > 1 && width_of(e->args[i]->type) == 1))
            return bad_builtin(c, e, name, e->args[i]->span, t->name);
        e->args[i] = convert(c, e->args[i], t, CONV_BROADCAST | CONV_NARROW);
    }
    e->kind = E_BUILTIN;
    e->builtin = b;
    Type *t = strchr("FNIvs", sig[0]) ? group
              : sig[0] == 'm'         ? type_matrix(c->s, group->columns, group->n)
              : sig[0] == 'B'         ? with_width(c, T_BOOL, width_of(group))
                                      : fixed_type(c, sig[0]);
    return finish(c, e, t);
}

static Expr *check_select(Checker *c, Expr *e) {
    Type *cond = e->args[0]->type, *t = unify(c, e->args[1]->type, e->args[2]->type);
    if (scalar_kind(cond) != T_BOOL || !t || is_aggregate(t))
        return bad_builtin(c, e, "select", e->op_span, "a bool or bool vector and two values of one type");
    uint32_t w = width_of(t), wc = width_of(cond);
    if (wc > 1 && w != wc) {
        if (w != 1) return bad_builtin(c, e, "select", e->op_span, "a condition of the size of its values");
        t = with_width(c, scalar_kind(t), wc);
    }
    if (wc == 1 && w > 1) e->args[0] = convert(c, e->args[0], type_vector(c->s, T_BOOL, w), CONV_BROADCAST);
    e->args[1] = convert(c, e->args[1], t, CONV_BROADCAST);
    e->args[2] = convert(c, e->args[2], t, CONV_BROADCAST);
    e->kind = E_BUILTIN;
    e->builtin = B_select;
    return finish(c, e, t);
}

/* mul(a, b) is a * b, except that two vectors make their dot product, as in HLSL. */
static Expr *check_mul(Checker *c, Expr *e) {
    e->a[0] = e->args[0];
    e->a[1] = e->args[1];
    Type *a = e->a[0]->type, *b = e->a[1]->type;
    if (a->kind == T_VECTOR && b->kind == T_VECTOR) return check_builtin_sig(c, e, B_dot);
    e->kind = E_BINARY;
    e->op = OPR_MUL;
    e->nargs = 0;
    return check_binary_typed(c, e);
}

static Expr *check_bits(Checker *c, Expr *e, Builtin b) {
    Type *t = e->args[0]->type;
    TypeKind k = scalar_kind(t), to = b == B_asuint ? T_UINT : T_FLOAT;
    if (!width_of(t) || k == T_BOOL)
        return bad_builtin(c, e, builtin_names[b], e->op_span, "a number or a vector of numbers");
    if (k == to) return e->args[0];
    if (b == B_asuint && k == T_INT) return convert_scalar_kind(c, e->args[0], T_UINT, false);
    if (b == B_asfloat && k == T_INT) e->args[0] = convert_scalar_kind(c, e->args[0], T_UINT, false);
    e->kind = E_BUILTIN;
    e->builtin = b;
    return finish(c, e, with_width(c, to, width_of(t)));
}

static Expr *check_hash(Checker *c, Expr *e) {
    Type *t = e->args[0]->type;
    TypeKind k = scalar_kind(t);
    if (!width_of(t) || width_of(t) > 3 || (k != T_INT && k != T_UINT))
        return bad_builtin(c, e, "hash", e->op_span, "uint, uint2 or uint3");
    e->args[0] = convert_scalar_kind(c, e->args[0], T_UINT, false);
    e->kind = E_BUILTIN;
    e->builtin = B_hash;
    return finish(c, e, c->t_uint);
}

static Expr *check_len(Checker *c, Expr *e) {
    if (e->nargs != 1) return bad_count(c, e, "len", 1);
    e->args[0] = check_expr(c, e->args[0]);
    Type *t = e->args[0]->type;
    if (t->kind == T_ERROR) return fail(c, e);
    bool counted = t->kind == T_ARRAY || (in_glsl(c) && (t->kind == T_VECTOR || t->kind == T_MATRIX));
    if (!counted) return bad_builtin(c, e, "len", e->args[0]->span, "an array");
    e->kind = E_LEN;
    e->a[0] = e->args[0];
    e->nargs = 0;
    e->cval.n = 1;
    e->cval.v[0].i = t->n;
    return finish(c, e, c->t_int);
}

/* In GLSL lengths and dot are of scalars too, and `mix` chooses by bools. */
static Builtin glsl_builtin(Checker *c, Expr *e, Builtin b) {
    bool scalar = e->nargs && is_scalar(e->args[0]->type);
    if (b == B_lerp && e->nargs == 3 && scalar_kind(e->args[2]->type) == T_BOOL) {
        Expr *chosen = e->args[1];
        e->args[1] = e->args[0], e->args[0] = e->args[2], e->args[2] = e->args[1], e->args[1] = chosen;
        return B_select;
    }
    if (b == B_distance && scalar && e->nargs == 2) {
        Expr *gap = new_expr(c, E_BINARY, e, NULL);
        gap->op = OPR_SUB;
        gap->a[0] = e->args[0], gap->a[1] = e->args[1];
        e->args[0] = check_binary_typed(c, gap);
        e->nargs = 1;
        return B_abs;
    }
    return b == B_length && scalar ? B_abs : b == B_normalize && scalar ? B_sign : b;
}

static Expr *check_builtin(Checker *c, Expr *e, Builtin b) {
    if (!check_args(c, e, false)) return fail(c, e);
    return check_builtin_typed(c, e, b);
}

static Expr *check_builtin_typed(Checker *c, Expr *e, Builtin b) {
    if (b == B_rand || b == B_rand2 || b == B_rand3) {
        if (c->at.func && c->at.func->rand_span.file < 0) c->at.func->rand_span = e->span;
        if (!c->at.func) {
            diag_emit(c->s, DIAG_not_constant, e->span, "a value at file scope");
            return fail(c, e);
        }
    }
    if (in_glsl(c) && b == B_dot && e->nargs == 2 && is_scalar(e->args[0]->type) && is_scalar(e->args[1]->type))
        return check_mul(c, e);
    if (in_glsl(c)) b = glsl_builtin(c, e, b);
    if (builtin_sigs[b][0] != '*') return check_builtin_sig(c, e, b);
    uint32_t want = b == B_select ? 3 : b == B_mul ? 2 : 1;
    if (e->nargs != want) return bad_count(c, e, builtin_names[b], want);
    switch (b) {
    case B_select: return check_select(c, e);
    case B_mul: return check_mul(c, e);
    case B_asuint:
    case B_asfloat: return check_bits(c, e, b);
    case B_hash: return check_hash(c, e);
    case B_detach:
        if (is_aggregate(e->args[0]->type))
            return bad_builtin(c, e, "detach", e->op_span, "a scalar, vector or matrix");
        e->kind = E_BUILTIN;
        e->builtin = b;
        return finish(c, e, e->args[0]->type);
    default: ice(c->s, "builtin %s is special and unknown", builtin_names[b]);
    }
}

Expr *check_call(Checker *c, Expr *e) {
    if (e->is_builtin) return check_builtin(c, e, (Builtin)(uintptr_t)map_get(&c->builtin_funcs, e->name));
    Binding *local = map_get(&c->at.locals, e->name);
    if (local) {
        check_args(c, e, true);
        Diag *d = diag_emit(c->s, DIAG_not_a_function, e->op_span, e->name,
                            local->sym->kind == SYM_ARG ? "argument" : "local variable");
        diag_note(c->s, d, local->sym->span, "`%s` is declared here", e->name);
        return fail(c, e);
    }
    Decl *d = scope_find(c, e->name, e->op_span);
    if (d) switch (d->kind) {
        case DECL_FUNC: return check_user_call(c, e, d);
        case DECL_STRUCT:
        case DECL_TYPEDEF: {
            TypeRef ref = {.name = e->name, .span = e->op_span};
            return check_construct(c, e, resolve_type(c, &ref, false, CHECK_MAX_ARRAY));
        }
        case DECL_ERROR: check_args(c, e, true); return fail(c, e);
        case DECL_CONST:
        case DECL_PARAM: {
            check_args(c, e, true);
            Diag *diag = diag_emit(c->s, DIAG_not_a_function, e->op_span, e->name, decl_what(d));
            diag_note(c->s, diag, d->span, "`%s` is declared here", e->name);
            return fail(c, e);
        }
        }
    if (e->name == c->name_len) return check_len(c, e);
    Builtin b = (Builtin)(uintptr_t)map_get(&c->builtin_funcs, e->name);
    if (b) return check_builtin(c, e, b);
    check_args(c, e, true);
    diag_emit(c->s, DIAG_unknown_name, e->op_span, e->name, suggest(c, e->name, false));
    return fail(c, e);
}

/* ---- methods */

static bool takes(Checker *c, const MethodInfo *m, const Expr *e) {
    const char *letters = m->signature + 1;
    if (strlen(letters) != e->nargs) return false;
    for (uint32_t i = 0; i < e->nargs; i++)
        if (e->args[i]->type != fixed_type(c, letters[i])) return false;
    return true;
}

Expr *check_method(Checker *c, Expr *e) {
    e->a[0] = check_expr(c, e->a[0]);
    bool args_ok = check_args(c, e, false);
    Type *t = e->a[0]->type;
    if (t->kind == T_ERROR) return fail(c, e);
    const MethodInfo *m = NULL;
    const char *names[M_COUNT];
    uint32_t n = 0, object = t->kind == T_GEOMETRY ? T_GEOMETRY + t->n : t->kind;
    for (int i = 0; i < M_COUNT; i++) {
        if (methods[i].object != object) continue;
        names[n++] = methods[i].name;
        if (!strcmp(methods[i].name, e->name) && (!m || takes(c, &methods[i], e))) m = &methods[i];
    }
    if (!m) {
        const char *near = n ? suggest_nearest(e->name, names, n) : NULL;
        diag_emit(c->s, DIAG_unknown_method, e->op_span, t->name, e->name,
                  near ? arena_printf(&c->s->session, ", did you mean `%s`?", near) : "");
        return fail(c, e);
    }
    if (e->a[0]->kind != E_NAME) {
        diag_emit(c->s, DIAG_bad_resource, e->a[0]->span,
                  "methods are called on a `param` or an argument, by its name");
        return fail(c, e);
    }
    const char *letters = m->signature + 1;
    uint32_t want = (uint32_t)strlen(letters);
    if (e->nargs != want) return bad_count(c, e, m->name, want);
    if (!args_ok) return fail(c, e);
    for (uint32_t i = 0; i < want; i++) {
        Type *a = fixed_type(c, letters[i]);
        e->args[i] = convert(c, e->args[i], a, CONV_NARROW);
        if (e->args[i]->type->kind == T_ERROR) return fail(c, e);
    }
    e->method = (Method)(m - methods);
    e->type = fixed_type(c, m->signature[0]);
    return e;
}

/* ---- constructors and lists */

static Expr *bad_construct(Checker *c, Expr *e, Span at, const char *text) {
    diag_emit(c->s, DIAG_bad_constructor, at, text);
    return fail(c, e);
}

Expr *check_zero(Checker *c, Span at, Type *t) {
    Expr where = {.span = at, .op_span = at}, *e = new_expr(c, E_LITERAL, &where, t);
    if (is_aggregate(t)) {
        e->kind = E_LIST;
        e->nargs = t->kind == T_ARRAY ? t->n : t->nfields;
        e->args = ARENA_ARRAY(c->arena, Expr *, e->nargs);
        for (uint32_t i = 0; i < e->nargs; i++)
            e->args[i] = t->kind == T_ARRAY && i ? e->args[0]
                                                 : check_zero(c, at, t->kind == T_ARRAY ? t->elem : t->fields[i].type);
    } else if (!is_scalar(t)) {
        e->kind = E_CONSTRUCT;
        e->nargs = type_components(t);
        e->args = ARENA_ARRAY(c->arena, Expr *, e->nargs);
        for (uint32_t i = 0; i < e->nargs; i++) e->args[i] = check_zero(c, at, t->elem);
    } else {
        e->cval.n = 1;
    }
    return finish(c, e, t);
}

static Expr *construct_aggregate(Checker *c, Expr *e, Type *t) {
    if (e->explicit_cast && e->nargs == 1 && e->args[0]->kind == E_LITERAL && e->args[0]->type == c->t_int &&
        !e->args[0]->cval.v[0].i) {
        if (type_components(t) <= CHECK_MAX_CONST) return check_zero(c, e->span, t);
        diag_emit(c->s, DIAG_array_limit, e->span,
                  arena_printf(&c->s->session, "a zero of %u scalars", type_components(t)), "4194304 (2^22)");
        return fail(c, e);
    }
    if (t->kind == T_STRUCT && !e->explicit_cast) { /* Disc(a, b) is the list { a, b } */
        e->kind = E_LIST;
        return check_list(c, e, t);
    }
    check_args(c, e, false);
    if (e->nargs == 1 && e->args[0]->type == t) return e->args[0];
    return bad_construct(c, e, e->span,
                         arena_printf(&c->s->session, "there is no constructor of %s: use a list, `{ ... }`", t->name));
}

/* args -> the scalar kind of t, explicitly. */
static bool convert_components(Checker *c, Expr *e, TypeKind k) {
    for (uint32_t i = 0; i < e->nargs; i++) {
        Expr *arg = e->args[i];
        if (arg->type->kind == T_MATRIX) continue;
        e->args[i] = convert_scalar_kind(c, arg, k, true);
    }
    return true;
}

static Expr *part(Checker *c, Expr *v, uint32_t n) {
    Expr *e = new_expr(c, E_SWIZZLE, v, NULL);
    e->a[0] = v;
    e->nswz = (uint8_t)n;
    for (uint32_t i = 0; i < n; i++) e->swz[i] = (uint8_t)i;
    return finish(c, e, with_width(c, scalar_kind(v->type), n));
}

/* Column i, of n numbers, of a matrix made of another matrix or of what its diagonal holds. */
static Expr *column(Checker *c, Expr *from, uint32_t i, uint32_t n) {
    uint32_t has = from->type->kind == T_MATRIX ? from->type->columns : 0;
    Expr *col = NULL;
    if (has && i < from->type->n) {
        Expr *index = check_zero(c, from->span, c->t_int);
        index->cval.v[0].i = i;
        col = new_expr(c, E_INDEX, from, NULL);
        col->a[0] = from, col->a[1] = index;
        col = finish(c, col, type_row(from->type));
        if (has >= n) return has > n ? part(c, col, n) : col;
    }
    Expr *e = new_expr(c, E_CONSTRUCT, from, NULL);
    e->args = ARENA_ARRAY(c->arena, Expr *, n);
    if (col) e->args[e->nargs++] = col;
    for (uint32_t k = col ? has : 0; k < n; k++) {
        Expr *one = check_zero(c, from->span, c->t_float);
        one->cval.v[0].f = k == i;
        e->args[e->nargs++] = has || k != i ? one : convert_scalar_kind(c, from, T_FLOAT, true);
    }
    return finish(c, e, type_vector(c->s, T_FLOAT, n));
}

/* GLSL's constructors: a scalar is a matrix's diagonal, a matrix the corner of another, and what the last argument has
 * too much is left out. Returns how many components are given now. */
static uint32_t glsl_components(Checker *c, Expr *e, Type *t, uint32_t given) {
    uint32_t want = type_components(t);
    Expr *only = e->nargs == 1 ? e->args[0] : NULL;
    if (t->kind == T_MATRIX && only && only->type != t && (is_scalar(only->type) || only->type->kind == T_MATRIX)) {
        e->nargs = t->n;
        e->args = ARENA_ARRAY(c->arena, Expr *, t->n);
        for (uint32_t i = 0; i < t->n; i++) e->args[i] = column(c, only, i, t->columns);
        return want;
    }
    Expr *last = e->nargs ? e->args[e->nargs - 1] : NULL;
    if (!last || last->type->kind != T_VECTOR || given <= want || given - last->type->n >= want) return given;
    e->args[e->nargs - 1] = part(c, last, last->type->n - (given - want));
    return want;
}

Expr *check_construct(Checker *c, Expr *e, Type *t) {
    Session *s = c->s;
    if (t->kind == T_ERROR) {
        check_args(c, e, true);
        return fail(c, e);
    }
    if (type_is_resource(t) || t->kind == T_VOID) {
        check_args(c, e, true);
        return bad_construct(c, e, e->span, arena_printf(&s->session, "there is no constructor of %s", t->name));
    }
    if (is_aggregate(t)) return construct_aggregate(c, e, t);
    if (!check_args(c, e, false)) return fail(c, e);
    uint32_t want = type_components(t), given = 0;
    for (uint32_t i = 0; i < e->nargs; i++) {
        Type *a = e->args[i]->type;
        if (is_aggregate(a))
            return bad_construct(c, e, e->args[i]->span,
                                 arena_printf(&s->session, "%s is no component of %s", a->name, t->name));
        given += type_components(a);
    }
    if (in_glsl(c)) given = glsl_components(c, e, t, given);
    Expr *only = e->nargs == 1 ? e->args[0] : NULL;
    if (only && only->type == t) { /* stays a node: `float3(v)` is no place */
        e->kind = E_CONSTRUCT;
        return finish(c, e, t);
    }
    if (only && t->kind != T_MATRIX && only->type->kind != T_MATRIX) {
        uint32_t w = width_of(only->type);
        if (w == width_of(t)) return convert_scalar_kind(c, only, scalar_kind(t), true);
        if (w == 1) { /* one scalar fills a vector */
            e->kind = E_BROADCAST;
            e->a[0] = convert_scalar_kind(c, only, scalar_kind(t), true);
            e->nargs = 0;
            return finish(c, e, t);
        }
        if (is_texture_result(only) && w > width_of(t)) {
            return convert_scalar_kind(c, convert(c, only, with_width(c, T_FLOAT, width_of(t)), CONV_NARROW),
                                       scalar_kind(t), true);
        }
        if (w > width_of(t) && e->explicit_cast) /* a C cast cuts a vector off, as in HLSL: (float2)v3 */
            return bad_construct(c, e, e->span,
                                 arena_printf(&s->session, "%s does not become %s: take components, as `.%.*s`",
                                              only->type->name, t->name, (int)width_of(t), "xyzw"));
    }
    if (t->kind == T_MATRIX && only && is_scalar(only->type))
        return bad_construct(c, e, e->span,
                             arena_printf(&s->session,
                                          "a matrix does not come from a scalar: %s lists %u components in row order",
                                          t->name, want));
    if (t->kind == T_MATRIX)
        for (uint32_t i = 0; i < e->nargs; i++)
            if (e->args[i]->type->kind == T_MATRIX)
                return bad_construct(c, e, e->args[i]->span,
                                     arena_printf(&s->session, "%s is no component of %s: list its rows",
                                                  e->args[i]->type->name, t->name));
    if (given != want)
        return bad_construct(
            c, e, e->span,
            arena_printf(&s->session, "%s has %u component%s, %u given", t->name, want, want == 1 ? "" : "s", given));
    convert_components(c, e, scalar_kind(t));
    e->kind = E_CONSTRUCT;
    return finish(c, e, t);
}

/* A list that initialises a vector (components) or a matrix (rows or components) becomes a constructor. */
static Expr *list_to_construct(Checker *c, Expr *e, Type *t) {
    bool rows = t->kind == T_MATRIX && e->nargs == t->n;
    uint32_t want = rows ? t->n : type_components(t);
    Type *item = rows ? type_row(t) : type_scalar(scalar_kind(t));
    if (e->nargs != want) {
        diag_emit(c->s, DIAG_bad_list, e->span,
                  arena_printf(&c->s->session, "%s has %u components, the list has %u", t->name, want, e->nargs));
        for (uint32_t i = 0; i < e->nargs; i++)
            if (e->args[i]->kind != E_LIST) check_expr(c, e->args[i]);
        return fail(c, e);
    }
    bool ok = true;
    for (uint32_t i = 0; i < e->nargs; i++) {
        Expr *arg = e->args[i];
        bool scalar_row = rows && arg->kind != E_LIST && is_scalar((arg = e->args[i] = check_value(c, arg))->type);
        if (scalar_row) {
            diag_emit(c->s, DIAG_cannot_convert, arg->span, arg->type->name, item->name,
                      ": a matrix lists its rows or all its components");
            ok = false;
            continue;
        }
        e->args[i] = check_init(c, arg, item);
        ok &= e->args[i]->type->kind != T_ERROR;
    }
    if (!ok) return fail(c, e);
    e->kind = E_CONSTRUCT;
    return finish(c, e, t);
}

Expr *check_list(Checker *c, Expr *e, Type *t) {
    enter_depth(c);
    Expr *r = e;
    if (t->kind == T_VECTOR || t->kind == T_MATRIX) {
        r = list_to_construct(c, e, t);
    } else if (!is_aggregate(t)) {
        if (t->kind != T_ERROR)
            diag_emit(
                c->s, DIAG_bad_list, e->span,
                arena_printf(&c->s->session, "a list initialises an array, a struct or a vector, not %s", t->name));
        for (uint32_t i = 0; i < e->nargs; i++)
            if (e->args[i]->kind != E_LIST) e->args[i] = check_expr(c, e->args[i]);
        fail(c, e);
    } else {
        uint32_t want = t->kind == T_ARRAY ? t->n : t->nfields;
        bool ok = e->nargs == want;
        if (!ok)
            diag_emit(c->s, DIAG_bad_list, e->span,
                      arena_printf(&c->s->session, "%s%s has %u %s%s, %u given",
                                   in_glsl(c) ? "" : "a list names every element: ", t->name, want,
                                   t->kind == T_ARRAY ? "element" : "field", want == 1 ? "" : "s", e->nargs));
        for (uint32_t i = 0; i < e->nargs; i++) {
            Type *item = i >= want ? c->t_error : t->kind == T_ARRAY ? t->elem : t->fields[i].type;
            e->args[i] = check_init(c, e->args[i], item);
            ok &= e->args[i]->type->kind != T_ERROR;
            Expr *list = ok ? const_list(e->args[i]) : NULL;
            if (list) e->args[i] = list; /* constants of constants are plain lists */
        }
        e->type = ok ? t : c->t_error;
        if (ok) const_fold(c, e);
    }
    c->depth--;
    return r;
}
