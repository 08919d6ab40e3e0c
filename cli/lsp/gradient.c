/* Does a gradient reach what a name stands for? Read off the primal of every shader of the file. */
#include <string.h>

#include "cli/lsp/lsp.h"
#include "compiler/pass/reach.h"

typedef struct Seen {
    const Expr *e;
    Inst **value;
    uint32_t n;
} Seen;
typedef struct Watch {
    Arena *arena;
    Vec(Seen) seen;
} Watch;

static void watch(void *user, const Expr *e, Inst *const *value, uint32_t n) {
    Watch *w = user;
    Seen s = {e, ARENA_ARRAY(w->arena, Inst *, n + 1), n};
    if (n) memcpy(s.value, value, n * sizeof *value);
    vec_push(w->arena, &w->seen, s);
}

/* The variable that a place is part of. */
static const Symbol *root(const Expr *e) {
    while (e && (e->kind == E_FIELD || e->kind == E_INDEX || e->kind == E_SWIZZLE)) e = e->a[0];
    return e && e->kind == E_NAME ? e->sym : NULL;
}

static bool is_of(const Expr *e, const Name *n) {
    if (n->kind != NAME_SYMBOL) return e == n->expr;
    const Expr *place = e->kind == E_ASSIGN || e->kind == E_INCDEC ? e->a[0] : e;
    return (n->sym->init && e == n->sym->init) || root(place) == n->sym;
}

typedef struct Answer {
    uint8_t flags;    /* of all its values together */
    bool both;        /* one of them is varied and reached */
    const Inst *lost; /* of one that is used and not reached: where the derivative ends */
    bool read;        /* the shader has any of it */
} Answer;

static void add(Answer *a, Reach *r, const Inst *i) {
    uint8_t f = reach_flags(r, i);
    a->flags |= f;
    a->read = true;
    a->both |= f & REACH_VARIED && f & (REACH_OUTPUT | REACH_BOUNDARY);
    if (!a->lost && (f & (REACH_USED | REACH_OUTPUT | REACH_BOUNDARY)) == REACH_USED) a->lost = reach_lost_at(r, i);
}

static Answer of_param(Analysis *a, const Program *p, Reach *r, const Symbol *sym) {
    Answer out = {0};
    for (uint32_t i = 0; i < p->nparams; i++) {
        const Param *q = &p->params[i];
        if (q->sym != sym || !q->fcount) continue;
        const Inst *read;
        out.flags = reach_of_param(r, q->fbase, q->fcount, &read);
        out.read = true;
        if (read) out.lost = reach_lost_at(r, read);
        uint8_t *reached = ARENA_ARRAY(&a->s->session, uint8_t, p->nfloats + 1);
        reach_params(r, reached);
        out.both = memchr(reached + q->fbase, 1, q->fcount) != NULL;
        if (out.both && !(out.flags & (REACH_OUTPUT | REACH_BOUNDARY))) out.flags |= REACH_OUTPUT; /* a derived array */
    }
    return out;
}

static const char *place(Analysis *a, Span span) {
    uint32_t line, column;
    if (span.file < 0) return "";
    span_position(a->s, span, &line, &column);
    const char *path = a->s->sources[span.file].path, *slash = strrchr(path, '/');
    if (span.file == a->file) return arena_printf(&a->s->session, " (line %u)", line);
    return arena_printf(&a->s->session, " (%s:%u)", slash ? slash + 1 : path, line);
}

static bool is_tagged(const Inst *comparison) {
    for (const Inst *i = comparison->next; i; i = i->next)
        if (i->op == OP_site && i->args[0] == comparison) return true;
    return false;
}

/* Why no gradient reaches a value that is used. */
static const char *why_lost(Analysis *a, const Inst *lost) {
    Arena *arena = &a->s->session;
    if (!lost) return "what uses it has no derivative";
    const char *at = place(a, lost->span);
    if (ir_ops[lost->op].compares)
        return arena_printf(arena,
                            is_tagged(lost)
                                ? "only a `[Disc]` whose boundary does not depend on the position uses it%s"
                                : "it is only compared%s, and no `[Disc]` marks that as a jump whose motion counts",
                            at);
    switch ((Op)lost->op) {
    case OP_ffloor: return arena_printf(arena, "only `floor` uses it%s, whose slope is 0", at);
    case OP_fceil: return arena_printf(arena, "only `ceil` uses it%s, whose slope is 0", at);
    case OP_fround: return arena_printf(arena, "only `round` uses it%s, whose slope is 0", at);
    case OP_ftrunc: return arena_printf(arena, "only a rounding towards 0 uses it%s, whose slope is 0", at);
    case OP_f2i:
    case OP_f2u: return arena_printf(arena, "it only becomes an integer%s", at);
    case OP_fasuint: return arena_printf(arena, "only its bits are used%s", at);
    case OP_detach: return arena_printf(arena, "`detach` ends its derivative%s", at);
    case OP_query: return arena_printf(arena, "only a search along a ray uses it%s", at);
    default: return arena_printf(arena, "its derivative ends in what uses it%s", at);
    }
}

static const char *tell(Analysis *a, const Answer *x) {
    Arena *arena = &a->s->session;
    bool output = x->flags & REACH_OUTPUT, boundary = x->flags & REACH_BOUNDARY;
    if (x->both)
        return arena_printf(arena, "A gradient reaches this: %s.",
                            output && boundary ? "through values, and through a boundary that `[Disc]` marks"
                            : boundary         ? "through a boundary that `[Disc]` marks"
                                               : "through values");
    if (output || boundary)
        return x->flags & REACH_MOVES
                   ? "No gradient passes here: it changes with a parameter by jumps or decisions alone."
                   : "No gradient passes here: it depends on no parameter that has one.";
    if (x->flags & REACH_USED) return arena_printf(arena, "No gradient reaches this: %s.", why_lost(a, x->lost));
    return "No gradient reaches this: no output depends on it.";
}

/* What is known without a program; NULL: nothing. */
static const char *early(Analysis *a, const Name *n) {
    const Type *t = n->kind == NAME_SYMBOL ? n->sym->type : n->type;
    const Symbol *sym = n->kind == NAME_SYMBOL ? n->sym : n->expr ? root(n->expr) : NULL;
    while (t && t->kind == T_ARRAY) t = t->elem;
    if (sym && sym->kind == SYM_CONST) return "A constant: it has no gradient.";
    if (t && (t->kind == T_VECTOR || t->kind == T_MATRIX)) t = t->elem;
    if (t && (t->kind == T_INT || t->kind == T_UINT || t->kind == T_BOOL))
        return arena_printf(&a->s->session, "No gradient: %s.",
                            t->kind == T_BOOL ? "a bool has none" : "an integer has none");
    if (sym && sym->kind == SYM_PARAM && sym->attrs.nodiff) return "No gradient: `[NoDiff]`.";
    if (n->expr && n->kind != NAME_SYMBOL && n->expr->is_const) return "A constant: it has no gradient.";
    return NULL;
}

static bool has_sense(const Name *n) {
    const Type *t = n->kind == NAME_SYMBOL ? n->sym->type : n->type;
    if (n->kind == NAME_SYMBOL) return t && t->kind != T_ERROR;
    return n->expr && t && t->kind != T_ERROR && t->kind != T_VOID && n->kind != NAME_TYPE && n->kind != NAME_STRUCT;
}

const char *gradient_text(Analysis *a, const Name *n) {
    Arena *arena = &a->s->session;
    if (!has_sense(n) || a->document->glsl) return NULL;
    const char *known = early(a, n), *text = NULL, *reached = NULL;
    if (known) return known;
    if (a->has_errors) return "Whether a gradient reaches this is known once the errors are mended.";
    uint32_t shaders = 0;
    for (Func *f = a->main->funcs; f; f = f->next) {
        if (!f->is_shader) continue;
        shaders++;
        Watch w = {.arena = &a->s->module};
        a->options.watch = watch, a->options.watch_user = &w;
        Program *p = analyse_program(a, f);
        a->options.watch = NULL;
        if (!p) continue;
        Reach *r = reach_of(p, &a->s->module);
        Answer x = {0};
        if (n->kind == NAME_SYMBOL && n->sym->kind == SYM_PARAM) x = of_param(a, p, r, n->sym);
        for (uint32_t i = 0; i < w.seen.len && !(n->kind == NAME_SYMBOL && n->sym->kind == SYM_PARAM); i++)
            for (uint32_t k = 0; is_of(w.seen.data[i].e, n) && k < w.seen.data[i].n; k++)
                add(&x, r, w.seen.data[i].value[k]);
        if (!x.read) continue;
        if (x.both) {
            reached = reached ? arena_printf(arena, "%s, `%s`", reached, f->name)
                              : arena_printf(arena, "%s In `%s`", tell(a, &x), f->name);
        } else if (!text || x.flags & REACH_USED) {
            text = tell(a, &x);
        }
    }
    if (!shaders) return "Whether a gradient reaches this is known where a shader uses it: this file has none.";
    if (reached)
        return shaders == 1 ? arena_strndup(arena, reached, strcspn(reached, ".") + 1)
                            : arena_printf(arena, "%s.", reached);
    return text ? text : "No gradient reaches this: no shader of this file uses it.";
}
