/* Types as written become Type pointers; conversions become nodes. */
#include "compiler/front/check/internal.h"

#include <string.h>

TypeKind scalar_kind(const Type *t) {
    if (t->kind >= T_BOOL && t->kind <= T_FLOAT) return t->kind;
    return t->kind == T_VECTOR || t->kind == T_MATRIX ? t->elem->kind : T_ERROR;
}

uint32_t width_of(const Type *t) { return is_scalar(t) ? 1 : t->kind == T_VECTOR ? t->n : 0; }
bool is_scalar(const Type *t) { return t->kind >= T_BOOL && t->kind <= T_FLOAT; }
bool is_numeric(const Type *t) { return width_of(t) && scalar_kind(t) != T_BOOL; }
bool is_aggregate(const Type *t) { return t->kind == T_ARRAY || t->kind == T_STRUCT; }

Type *with_width(Checker *c, TypeKind kind, uint32_t width) {
    return width == 1 ? type_scalar(kind) : type_vector(c->s, kind, width);
}

Expr *new_expr(Checker *c, ExprKind kind, const Expr *at, Type *type) {
    Expr *e = ARENA_NEW(c->arena, Expr);
    e->kind = kind;
    e->span = at->span;
    e->op_span = at->op_span;
    e->type = type;
    return e;
}

Expr *fail(Checker *c, Expr *e) {
    e->type = c->t_error;
    e->is_const = false;
    return e;
}

/* ---- names of types */

static Type *resolve_struct(Checker *c, StructDecl *d, Span use) {
    if (d->check_state == 2) return d->type;
    if (d->check_state == 1) {
        Diag *diag =
            diag_emit(c->s, DIAG_bad_struct, use, arena_printf(&c->s->session, "struct `%s` contains itself", d->name));
        diag_note(c->s, diag, d->span, "`%s` is declared here", d->name);
        return c->t_error;
    }
    enter_depth(c);
    d->check_state = 1;
    Context old = context_enter(c, scope_of(c, d->module), NULL);
    Type *t = ARENA_NEW(&c->s->session, Type);
    t->kind = T_STRUCT;
    t->name = d->name;
    t->fields = ARENA_ARRAY(&c->s->session, Field, d->nfields ? d->nfields : 1);
    bool ok = true;
    uint64_t total = 0;
    if (!d->nfields && c->s->nerrors) {
        ok = false; /* the parser reported the fields, or skipped them */
    } else if (!d->nfields) {
        diag_emit(c->s, DIAG_bad_struct, d->span, arena_printf(&c->s->session, "struct `%s` has no fields", d->name));
        ok = false;
    }
    NameMap seen = {0};
    for (uint32_t i = 0; i < d->nfields; i++) {
        FieldDecl *f = &d->fields[i];
        Type *ft = resolve_type(c, f->type_ref, false, CHECK_MAX_LOCAL);
        if (type_is_resource(ft)) {
            diag_emit(c->s, DIAG_bad_resource, f->type_ref->span,
                      arena_printf(&c->s->session, "a struct cannot hold a %s", ft->name));
            ft = c->t_error;
        } else if (ft->kind == T_VOID) {
            diag_emit(c->s, DIAG_void_value, f->type_ref->span, "field");
            ft = c->t_error;
        }
        FieldDecl *first = map_get(&seen, f->name);
        if (first) {
            Diag *diag = diag_emit(c->s, DIAG_bad_struct, f->span,
                                   arena_printf(&c->s->session, "struct `%s` has two fields `%s`", d->name, f->name));
            diag_note(c->s, diag, first->span, "the first is here");
            ft = c->t_error;
        } else {
            map_put(c->arena, &seen, f->name, f);
        }
        ok &= ft->kind != T_ERROR;
        t->fields[t->nfields++] = (Field){f->name, ft, f->span, f->attrs};
        if (f->attrs && ft->kind != T_ERROR) check_field_attrs(c, f->attrs, ft, f->span);
        if (ft->kind != T_ERROR) total += type_components(ft);
    }
    /* The bound also keeps type_components cheap: structs that double each other would take exponential time. */
    if (ok && total > CHECK_MAX_LOCAL) {
        diag_emit(c->s, DIAG_bad_struct, d->span,
                  arena_printf(&c->s->session, "struct `%s` has %llu scalars, the limit is 65536", d->name,
                               (unsigned long long)total));
        ok = false;
    }
    context_leave(c, old);
    d->type = ok ? t : c->t_error;
    d->check_state = 2;
    c->depth--;
    return d->type;
}

static Type *resolve_typedef(Checker *c, TypedefDecl *d, Span use) {
    if (d->check_state == 2) return d->type;
    if (d->check_state == 1) {
        diag_emit(c->s, DIAG_cyclic_const, use, d->name);
        return c->t_error;
    }
    enter_depth(c);
    d->check_state = 1;
    Context old = context_enter(c, scope_of(c, d->module), NULL);
    d->type = resolve_type(c, d->type_ref, false, CHECK_MAX_ARRAY);
    context_leave(c, old);
    d->check_state = 2;
    c->depth--;
    return d->type;
}

static Type *resolve_name(Checker *c, const char *name, Span span) {
    Type *t = map_get(&c->builtin_types, name);
    if (t) return t;
    Decl *d = scope_find(c, name, span);
    if (!d) {
        if ((t = soft_type(c, name))) return t;
        diag_emit(c->s, DIAG_unknown_type, span, name, suggest(c, name, true));
        return c->t_error;
    }
    switch (d->kind) {
    case DECL_ERROR: return c->t_error;
    case DECL_STRUCT: return resolve_struct(c, d->structure, span);
    case DECL_TYPEDEF: return resolve_typedef(c, d->type_def, span);
    case DECL_CONST:
    case DECL_PARAM:
    case DECL_FUNC: {
        Diag *diag = diag_emit(c->s, DIAG_unknown_type, span, name, "");
        diag_note(c->s, diag, d->span, "`%s` is a %s", name, decl_what(d));
        return c->t_error;
    }
    }
    return c->t_error;
}

Type *resolve_type(Checker *c, TypeRef *ref, bool allow_open, uint32_t limit) {
    Session *s = c->s;
    Type *t = resolve_name(c, ref->name, ref->span);
    if (!ref->ndims) return t;
    bool ok = t->kind != T_ERROR;
    if (type_is_resource(t) || t->kind == T_VOID) {
        if (type_is_resource(t))
            diag_emit(s, DIAG_bad_resource, ref->span, arena_printf(&s->session, "there are no arrays of %s", t->name));
        else diag_emit(s, DIAG_void_value, ref->span, "array element");
        ok = false;
    }
    int64_t dims[16];
    for (uint32_t i = 0; i < ref->ndims; i++) {
        dims[i] = 0;
        if (!ref->dims[i]) {
            if (!(allow_open && i == 0)) {
                diag_emit(s, DIAG_array_size, ref->span,
                          i ? "only the first size of an array may be left open"
                            : "only the first size of a `param` array may be left open; write the size");
                ok = false;
            }
            continue;
        }
        ref->dims[i] = check_value(c, ref->dims[i]);
        int64_t n;
        if (!const_int(c, ref->dims[i], "the size of an array", &n)) {
            ok = false;
            continue;
        }
        if (n < 1) {
            diag_emit(s, DIAG_array_size, ref->dims[i]->span,
                      arena_printf(&s->session, "the size of an array is at least 1, this is %lld", (long long)n));
            ok = false;
        }
        dims[i] = n;
    }
    if (!ok) return c->t_error;
    uint64_t total = type_components(t);
    for (uint32_t i = ref->ndims; i-- > 0;) {
        if (dims[i] > CHECK_MAX_ARRAY) dims[i] = (int64_t)CHECK_MAX_ARRAY + 1;
        total *= dims[i] ? (uint64_t)dims[i] : 1;
        if (total > limit) {
            diag_emit(s, DIAG_array_limit, ref->dims[i] ? ref->dims[i]->span : ref->span,
                      total > CHECK_MAX_ARRAY ? "more than 268435456 scalars"
                                              : arena_printf(&s->session, "%llu scalars", (unsigned long long)total),
                      limit == CHECK_MAX_LOCAL   ? "65536 (2^16)"
                      : limit == CHECK_MAX_CONST ? "4194304 (2^22)"
                                                 : "268435456 (2^28)");
            return c->t_error;
        }
        t = type_array(s, t, (uint32_t)dims[i]);
    }
    return t;
}

/* ---- conversions */

Type *unify(Checker *c, Type *a, Type *b) {
    if (a == b) return a;
    uint32_t wa = width_of(a), wb = width_of(b);
    if (!wa || !wb) return NULL;
    TypeKind ka = scalar_kind(a), kb = scalar_kind(b);
    if ((ka == T_BOOL) != (kb == T_BOOL)) return NULL;
    if (wa != wb && wa != 1 && wb != 1) return NULL;
    return with_width(c, ka > kb ? ka : kb, wa > wb ? wa : wb);
}

bool is_texture_result(const Expr *e) {
    return e->kind == E_METHOD && methods[e->method].signature[0] == '4' && e->type && e->type->kind == T_VECTOR;
}

int conversion_cost(Expr *e, const Type *to, unsigned flags) {
    const Type *from = e->type;
    if (from == to || from->kind == T_ERROR || to->kind == T_ERROR) return 0;
    uint32_t wf = width_of(from), wt = width_of(to);
    if (!wf || !wt) return -1;
    if ((flags & CONV_NARROW) && is_texture_result(e) && scalar_kind(to) == T_FLOAT && wt < 4) return 1;
    TypeKind kf = scalar_kind(from), kt = scalar_kind(to);
    if (kf != kt && (kf == T_BOOL || kt == T_BOOL || kf > kt)) return -1;
    if (wf != wt && !(wf == 1 && (flags & CONV_BROADCAST))) return -1;
    return 1;
}

Expr *convert_scalar_kind(Checker *c, Expr *e, TypeKind kind, bool explicit_cast) {
    if (e->type->kind == T_ERROR || scalar_kind(e->type) == kind) return e;
    Expr *n = new_expr(c, E_CONVERT, e, with_width(c, kind, width_of(e->type)));
    n->a[0] = e;
    n->explicit_cast = explicit_cast;
    const_fold(c, n);
    return n;
}

/* Why a conversion does not exist, and what to write instead. */
static const char *conversion_hint(Checker *c, const Expr *e, const Type *to) {
    const Type *from = e->type;
    uint32_t wf = width_of(from), wt = width_of(to);
    TypeKind kf = scalar_kind(from), kt = scalar_kind(to);
    if (to->kind == T_MATRIX && is_scalar(from)) return ": a matrix does not come from a scalar, list its components";
    if (!strcmp(from->name, to->name))
        return ": the language has one of this name, the program another; give its own another name";
    if (!wf || !wt) return "";
    if (wf == wt && kt == T_BOOL) return ": compare, as in `v != 0`";
    if (wf == wt && kf == T_BOOL)
        return in_glsl(c) ? arena_printf(&c->s->session, ": write `%s(...)`", to->name) : ": use `?:` or `select`";
    if (wf == wt && kf > kt) return arena_printf(&c->s->session, ": write `%s(...)`", to->name);
    if (wf > wt)
        return wt == 1 ? ": take one component, as `.x`"
                       : arena_printf(&c->s->session, ": take components, as `.%.*s`", (int)wt, "xyzw");
    if (wf == 1) return arena_printf(&c->s->session, ": a scalar does not broadcast here, write `%s(...)`", to->name);
    return "";
}

Expr *convert(Checker *c, Expr *e, Type *to, unsigned flags) {
    if (e->type == to) return e;
    if (e->type->kind == T_ERROR || to->kind == T_ERROR) return e;
    if (e->type->kind == T_VOID) {
        diag_emit(c->s, DIAG_void_value, e->span, "call");
        return fail(c, e);
    }
    if (conversion_cost(e, to, flags) < 0) {
        diag_emit(c->s, DIAG_cannot_convert, e->span, e->type->name, to->name, conversion_hint(c, e, to));
        Expr *n = new_expr(c, E_CONVERT, e, c->t_error); /* keeps the operand for the passes that follow */
        n->a[0] = e;
        return n;
    }
    if (width_of(to) < width_of(e->type)) {
        Expr *n = new_expr(c, E_CONVERT, e, to); /* narrowing of a texture's result */
        n->a[0] = e;
        return n;
    }
    e = convert_scalar_kind(c, e, scalar_kind(to), false);
    if (e->type != to) {
        Expr *n = new_expr(c, E_BROADCAST, e, to);
        n->a[0] = e;
        const_fold(c, n);
        e = n;
    }
    return e;
}

/* ---- places */

bool is_place(Expr *e) {
    switch (e->kind) {
    case E_NAME:
        return e->sym && (e->sym->kind == SYM_ARG || (e->sym->kind == SYM_LOCAL && !e->sym->is_const)) &&
               !type_is_resource(e->type);
    case E_INDEX:
    case E_FIELD: return is_place(e->a[0]);
    case E_SWIZZLE:
        for (int i = 0; i < e->nswz; i++)
            for (int j = 0; j < i; j++)
                if (e->swz[i] == e->swz[j]) return false;
        return is_place(e->a[0]);
    default: return false;
    }
}

Symbol *place_root(Expr *e) {
    while (e && (e->kind == E_INDEX || e->kind == E_FIELD || e->kind == E_SWIZZLE)) e = e->a[0];
    return e && e->kind == E_NAME ? e->sym : NULL;
}
