/* Sites: the places whose jumps are integrated, and the record of those that are not. */
#include <string.h>

#include "compiler/front/gen/internal.h"

/* The source text of a span on one line, at most 60 bytes. */
static const char *short_text(Lower *l, Span span) {
    if (span.file < 0 || (uint32_t)span.file >= l->s->nsources) return "";
    const Source *src = &l->s->sources[span.file];
    if (span.pos >= src->len) return "";
    uint32_t n = span.len < src->len - span.pos ? span.len : src->len - span.pos;
    char text[64];
    uint32_t at = 0;
    bool cut = false;
    for (uint32_t i = 0; i < n; i++) {
        char c = src->text[span.pos + i];
        if (c == '\n' || c == '\r' || c == '\t') c = ' ';
        if (c == ' ' && at && text[at - 1] == ' ') continue;
        if (at >= 57) {
            cut = true;
            break;
        }
        text[at++] = c;
    }
    while (cut && at && ((unsigned char)text[at - 1] & 0xC0) == 0x80) at--; /* do not cut a UTF-8 sequence */
    if (cut && at && (unsigned char)text[at - 1] >= 0xC0) at--;
    return arena_printf(l->arena, "%.*s%s", (int)at, text, cut ? "..." : "");
}

/* The indices of the loops around `inner`, outermost first, into args; *events is the product of their bounds. */
static uint32_t loop_indices(Lower *l, const LoopCtx *inner, Inst **args, uint64_t *events, Span span) {
    uint32_t n = 0;
    *events = 1;
    for (const LoopCtx *c = inner; c; c = c->outer) n++;
    if (n > SLT_MAX_K) {
        diag_emit(l->s, DIAG_site_depth, span, n, (unsigned)SLT_MAX_K);
        gen_giveup(l);
    }
    uint32_t at = n;
    for (const LoopCtx *c = inner; c; c = c->outer) {
        args[--at] = c->k;
        uint64_t iters = c->iters ? c->iters : 1;
        *events = *events > UINT64_MAX / iters ? UINT64_MAX : *events * iters;
    }
    return n;
}

static Inst *emit_site(Lower *l, Op op, SiteKind kind, Inst *value, Inst *g, const LoopCtx *inner, Span span,
                       bool skip) {
    Inst *args[2 + SLT_MAX_K] = {value, g};
    span = gen_shown(l, span);
    SiteInfo info = {.kind = kind, .span = span, .skip_loop = skip, .by_auto = l->tag.by_auto};
    info.depth = loop_indices(l, inner, args + 2, &info.max_events, span);
    info.path = gen_path(l);
    info.text = short_text(l, span);
    Imm imm = {.i = l->sites.len};
    vec_push(l->arena, &l->sites, info);
    return special(l, op, op == OP_site ? TY_BOOL : TY_FLT, 2 + info.depth, args, imm);
}

void site_untracked(Lower *l, Inst *at, Inst *g0, Inst *g1, Span span, JumpKind kind) {
    if ((l->quiet && !l->records) || l->in_tangent || ir_is_const(at)) return;
    span = gen_shown(l, span);
    if (l->tag.nodisc) vec_push(l->arena, &l->silenced, span);
    else vec_push(l->arena, &l->untracked, ((Untracked){at, g0, g1, span, kind}));
}

/* ---- [SkipLoop]
 *
 * One site stands for all iterations. Its boundary function must be continuous in x, and change sign exactly where the
 * decision "true in any iteration" changes. With s > 0 where an iteration is true, the running maximum of s is that, as
 * long as no iteration was true; then s is frozen: the boundary is that of the iteration that was true first.
 * && || and ! of comparisons are min, max and minus of their s. */

static Inst *init_minus_infinity(Lower *l, Builder *b) {
    (void)l;
    return ir_constf(b, -__builtin_inf());
}
static Inst *init_false(Lower *l, Builder *b) {
    (void)l;
    return ir_constb(b, false);
}
static Inst *init_zero(Lower *l, Builder *b) {
    (void)l;
    return ir_constf(b, 0);
}

typedef struct Oriented {
    Inst *decision, *s;
} Oriented;

static void note_skipped(Lower *l, Inst *decision, Inst *a, Inst *b, Span span) {
    if (l->quiet || l->in_tangent || ir_is_const(decision)) return;
    vec_push(l->arena, &l->untracked, ((Untracked){decision, a, b, gen_shown(l, span), JUMP_SKIPPED}));
}

static Oriented skip_truth(Lower *l, Expr *e);

static Oriented skip_logic(Lower *l, Expr *e) {
    bool is_and = e->op == OPR_LAND;
    Oriented a = skip_truth(l, e->a[0]);
    Var *d = var_new(l, TY_BOOL, 1), *s = var_new(l, TY_FLT, 1);
    d->value = a.decision, s->value = a.s;
    IfCtx c;
    if_begin(l, &c, is_and ? a.decision : op1(l, OP_bnot, a.decision));
    Oriented b = skip_truth(l, e->a[1]);
    var_set(l, d, b.decision);
    var_set(l, s, op2(l, is_and ? OP_fmin : OP_fmax, a.s, b.s));
    if_else(l, &c);
    if_end(l, &c);
    return (Oriented){d->value, s->value};
}

static Oriented skip_truth(Lower *l, Expr *e) {
    if (e->kind == E_LOGIC) return skip_logic(l, e);
    if (e->kind == E_UNARY && e->op == OPR_NOT) {
        Oriented a = skip_truth(l, e->a[0]);
        return (Oriented){op1(l, OP_bnot, a.decision), op1(l, OP_fneg, a.s)};
    }
    bool ordered = e->kind == E_BINARY && (e->op == OPR_LT || e->op == OPR_LE || e->op == OPR_GT || e->op == OPR_GE);
    if (ordered && e->a[0]->type->kind == T_FLOAT) {
        Inst *a = gen_scalar(l, e->a[0]), *b = gen_scalar(l, e->a[1]);
        bool greater = e->op == OPR_GT || e->op == OPR_GE, or_equal = e->op == OPR_LE || e->op == OPR_GE;
        Inst *d = op2(l, or_equal ? OP_fle : OP_flt, greater ? b : a, greater ? a : b);
        note_skipped(l, d, a, b, e->span);
        return (Oriented){d, greater ? op2(l, OP_fsub, a, b) : op2(l, OP_fsub, b, a)};
    }
    Inst *d = gen_scalar(l, e); /* not a comparison of floats: no boundary of its own */
    return (Oriented){d, sel(l, d, kf(l, __builtin_inf()), kf(l, -__builtin_inf()))};
}

Inst *gen_skip_condition(Lower *l, Expr *cond, LoopCtx *root) {
    Var *any = var_hidden(l, root, init_false, TY_BOOL), *g = var_hidden(l, root, init_minus_infinity, TY_FLT);
    Oriented o = skip_truth(l, cond);
    var_set(l, g, sel(l, any->value, g->value, op2(l, OP_fmax, g->value, o.s)));
    var_set(l, any, op2(l, OP_bor, any->value, o.decision));
    vec_push(l->arena, &root->skips, ((SkipRec){any, g, NULL, SITE_COMPARE, gen_shown(l, cond->span)}));
    return o.decision;
}

/* A site in the guarded statement: its first execution is kept. */
static void record_guarded(Lower *l, Inst *decision, Inst *g, Span span) {
    LoopCtx *root = l->tag.skip;
    Var *ran = var_hidden(l, root, init_false, TY_BOOL), *kept = var_hidden(l, root, init_false, TY_BOOL);
    Var *kept_g = var_hidden(l, root, init_zero, TY_FLT);
    var_set(l, kept, sel(l, ran->value, kept->value, decision));
    var_set(l, kept_g, sel(l, ran->value, kept_g->value, g));
    var_set(l, ran, kb(l, true));
    vec_push(l->arena, &root->skips, ((SkipRec){ran, kept_g, kept, SITE_COMPARE, gen_shown(l, span)}));
}

void site_flush_skips(Lower *l, LoopCtx *root) {
    for (uint32_t i = 0; i < root->skips.len; i++) {
        SkipRec *r = &root->skips.data[i];
        if (!r->decision) {
            emit_site(l, OP_site, r->kind, var_get(l, r->any), var_get(l, r->g), root->outer, r->span, true);
            continue;
        }
        IfCtx c;
        if_begin(l, &c, var_get(l, r->any));
        emit_site(l, OP_site, r->kind, var_get(l, r->decision), var_get(l, r->g), root->outer, r->span, true);
        if_else(l, &c);
        if_end(l, &c);
    }
}

/* ---- what expressions call */

Inst *site_compare(Lower *l, Inst *decision, Inst *a, Inst *b, Span span) {
    if (ir_is_const(decision)) return decision;
    if (!l->tag.disc || l->quiet || l->in_tangent) {
        site_untracked(l, decision, a, b, span, JUMP_COMPARE);
        return decision;
    }
    Inst *g = gen_clearance_compare(l, a, b);
    if (!g) g = op2(l, OP_fsub, a, b);
    if (l->tag.skip) {
        note_skipped(l, decision, a, b, span);
        record_guarded(l, decision, g, span);
        return decision;
    }
    return emit_site(l, OP_site, SITE_COMPARE, decision, g, l->loop, span, false);
}

bool site_wanted(Lower *l, Inst *hit, Inst *t, Span span, JumpKind kind) {
    /* A skipped loop keeps one g for all its iterations; a window along a ray has no such sum. */
    if (l->tag.disc && !l->quiet && !l->in_tangent && !l->tag.skip) return true;
    site_untracked(l, hit, t, NULL, span, kind);
    return false;
}

Inst *site_ray(Lower *l, SiteKind kind, Inst *hit, Inst *g, Span span) {
    return emit_site(l, OP_site, kind, hit, g, l->loop, span, false);
}

Inst *site_integer(Lower *l, SiteKind kind, Inst *n, Inst *v, Span span) {
    if (ir_is_const(n)) return n;
    if (!l->tag.disc || l->quiet || l->in_tangent) {
        site_untracked(l, n, v, NULL, span, JUMP_BUILTIN);
        return n;
    }
    return emit_site(l, OP_siten, kind, n, v, l->loop, span, false);
}
