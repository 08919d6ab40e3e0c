/* Bounds of one operation: the row's (ir/bounds.h), and what may go either way in it.
 *
 * Comparisons, roundings, minima and their kin reach this as sites and seams (variant_seams.c), whose events are
 * recorded where they are open. What has none marks the set of its value: OPEN_JUMP, OPEN_BEND. Where nothing is known
 * of an operand (it may be NaN, or pass through a pole) any choice by it may jump as well. */
#include "compiler/pass/variant_bounds.h"

#include <float.h>
#include <math.h>

/* ---- integers and booleans are folded while they are built: it is exact */

static Builder folding(const Builder *b) {
    Builder f = *b;
    f.fold = true;
    return f;
}

Inst *bounds_op1(Builder *b, Op op, Inst *p) {
    Builder f = folding(b);
    return ir_emit1(&f, op, p);
}

Inst *bounds_op2(Builder *b, Op op, Inst *p, Inst *q) {
    Builder f = folding(b);
    return ir_emit2(&f, op, p, q);
}

Inst *bounds_choose(Builder *b, Inst *cond, Inst *p, Inst *q) {
    Builder f = folding(b);
    return ir_select(&f, cond, p, q);
}

Inst *bounds_not(Builder *b, Inst *p) { return bounds_op1(b, OP_bnot, p); }

Inst *bounds_and(Builder *b, Inst *p, Inst *q) { return !p ? q : !q ? p : bounds_op2(b, OP_band, p, q); }

Inst *open_union(Builder *b, Inst *p, Inst *q) { return !p || p == q ? q : !q ? p : bounds_op2(b, OP_ior, p, q); }

Inst *open_where(Builder *b, Inst *cond, Inst *p, Inst *q) {
    if (!cond || p == q) return p;
    return bounds_choose(b, cond, p ? p : ir_consti(b, 0), q ? q : ir_consti(b, 0));
}

static Inst *bits_where(Builder *b, Inst *cond, int32_t bits) {
    return bounds_choose(b, cond, ir_consti(b, bits), ir_consti(b, 0));
}

static Inst *number(Builder *b, double v) { return ir_constf(b, v); }
static Inst *not_above(Builder *b, Inst *p, Inst *q) { return bounds_op2(b, OP_fle, p, q); }

/* Nothing is known of it: it may be NaN. */
static Inst *is_unknown(Builder *b, Bound v) { return bounds_not(b, ir_bound_is_number(b, v)); }

/* ---- capture */

static double most(const Builder *b) { return b->fn->precision == PREC_F64 ? DBL_MAX : FLT_MAX; }

Boxed bounds_nothing(Builder *b) { return (Boxed){.is = {number(b, most(b)), number(b, -most(b))}}; }

Inst *bounds_is_nothing(Builder *b, Bound v) {
    Bound none = bounds_nothing(b).is;
    return bounds_op2(b, OP_band, bounds_op2(b, OP_feq, v.lo, none.lo), bounds_op2(b, OP_feq, v.hi, none.hi));
}

/* The value with which a capture begins: made of VARIANT_UNCAPTURED alone. */
static bool is_first_nothing(const Boxes *x, const Inst *i) {
    if (i->op == OP_constf) return true;
    if (i->op == OP_fmul) return variant_is_uncaptured(i->args[0]) || variant_is_uncaptured(i->args[1]);
    return i->op == OP_fadd && (x->fact[i->args[0]->id] & x->fact[i->args[1]->id] & FACT_CAPTURE) &&
           is_first_nothing(x, i->args[0]) && is_first_nothing(x, i->args[1]);
}

/* ---- choices */

static const Inst *comparison(const Boxes *x, const Inst *cond) {
    while (cond->op == OP_site || bounds_may_be_given(x, cond)) cond = cond->args[cond->op == OP_site ? 0 : 2];
    return cond;
}

static bool is_number(const Inst *v, double n) { return v->op == OP_constf && v->imm.f == n; }

/* a == 0 ? 0 : sqrt(a), as in `length` */
static bool is_root_of(const Inst *cond, const Inst *yes, const Inst *no) {
    return cond->op == OP_feq && no->op == OP_fsqrt && no->args[0] == cond->args[0] && is_number(cond->args[1], 0) &&
           is_number(yes, 0);
}

static bool is_stored(const Block *b, const Inst *array) {
    for (const Inst *i = b->first; i; i = i->next) {
        if ((i->op == OP_store || i->op == OP_acopy) && i->args[0] == array) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (is_stored(i->region[r], array)) return true;
    }
    return false;
}

/* One value, or one element read twice while nothing is stored. */
static bool is_same(const Inst *v, const Inst *w) {
    if (v == w) return true;
    if (v->op != OP_load || w->op != OP_load || v->args[0] != w->args[0] || v->args[1] != w->args[1]) return false;
    return walk_inside(w->block, v->block) && !is_stored(v->block, v->args[0]);
}

Inst *bounds_choice_open(Boxes *x, Builder *b, const Inst *cond, const Inst *yes, const Inst *no) {
    Boxed c = x->value[cond->id];
    const Inst *cmp = comparison(x, cond);
    bool order = cmp->op == OP_flt || cmp->op == OP_fle;
    bool meets = order && ((is_same(cmp->args[0], yes) && is_same(cmp->args[1], no)) ||
                           (is_same(cmp->args[0], no) && is_same(cmp->args[1], yes)));
    if (!meets || !x->edges) return c.open;
    Boxed p = x->value[yes->id], q = x->value[no->id];
    Inst *nan = bounds_op2(b, OP_bor, is_unknown(b, p.is), is_unknown(b, q.is));
    Inst *own = bounds_choose(b, nan, ir_consti(b, OPEN_JUMP), ir_consti(b, OPEN_BEND));
    return open_union(b, open_where(b, bounds_undecided(b, c.is), own, NULL), open_union(b, p.open, q.open));
}

static Boxed value_of(const Boxes *x, const Inst *v) { return x->value[v->id]; }

static bool uses(const Inst *cond, const Inst *v, uint32_t depth) {
    if (cond == v) return true;
    for (uint32_t a = 0; depth && cond->type == TY_BOOL && a < cond->nargs; a++)
        if (uses(cond->args[a], v, depth - 1)) return true;
    return false;
}

static void select_value(Boxes *x, Builder *b, const Inst *i) {
    const Inst *cond = i->args[0];
    Boxed c = value_of(x, cond), v[2], r = {0};
    if (is_root_of(cond, i->args[1], i->args[2])) {
        x->value[i->id] = value_of(x, i->args[2]);
        return;
    }
    Inst *joined = bounds_choice_open(x, b, cond, i->args[1], i->args[2]);
    for (uint32_t s = 0; s < 2; s++) {
        bool learns = uses(cond, i->args[1 + s], 4);
        uint32_t mark = learns ? bounds_learn(x, b, cond, s == 0) : x->undo.len;
        v[s] = value_of(x, i->args[1 + s]);
        bounds_forget(x, mark);
    }
    r.is = ir_bound_row(b, (Op)i->op, (Bound[]){c.is, v[0].is, v[1].is}, 3, 0);
    Inst *open = open_union(b, joined, open_union(b, v[0].open, v[1].open));
    r.open = open_where(b, c.is.lo, v[0].open, open_where(b, c.is.hi, open, v[1].open));
    Inst *larger = error_larger(b, v[0].error, v[1].error);
    r.error = error_where(b, c.is.lo, v[0].error, error_where(b, c.is.hi, larger, v[1].error));
    x->value[i->id] = r;
}

/* ---- events */

static void put(Builder *b, Inst *array, Inst *at, Inst *v) {
    ir_special(b, OP_store, TY_VOID, 3, (Inst *[]){array, at, v}, (Imm){0});
}

/* Where `open` holds, records the event of a site and gives its bit and `more`; elsewhere nothing. An event that was
 * recorded before, by a seam of the same number, keeps its bit. first, last: the boundaries of an integer, or NULL. */
static Inst *record(Boxes *x, Builder *b, const Inst *site, Inst *open, Bound arg, Bound arg2, Inst *first, Inst *last,
                    Inst *more) {
    Recorded *known = &x->known[site->imm.i];
    bool again = known->site && walk_inside(site->block, known->site->block);
    Inst *br = ir_if(b, open);
    br->imm.i = IR_IF_RARE;
    Builder in = ir_at_end(x->to, br->region[0]), out = ir_at_end(x->to, br->region[1]);
    Inst *zero = ir_consti(&in, 0), *trash = ir_consti(&in, (int32_t)x->slots);
    Inst *n = ir_special(&in, OP_load, TY_INT, 2, (Inst *[]){x->recorded, zero}, (Imm){0});
    Inst *has = again ? bounds_op2(&in, OP_ine, known->bit, zero) : NULL,
         *at = again ? ir_select(&in, has, trash, n) : n;
    put(&in, x->edge, at, ir_consti(&in, (int32_t)site->imm.i));
    for (uint32_t d = 0; d + 2 < site->nargs; d++) put(&in, x->k[d], at, value_of(x, site->args[d + 2]).is.lo);
    if (x->first) {
        put(&in, x->first, at, first ? first : number(&in, 0));
        put(&in, x->last, at, last ? last : number(&in, 0));
    }
    Inst *next = ir_emit2(&in, OP_iadd, n, ir_consti(&in, 1));
    put(&in, x->recorded, zero, again ? ir_select(&in, has, n, next) : next);
    Inst *told = ir_emit2(&in, OP_ilt, n, trash);
    Inst *bit = ir_select(&in, told, ir_emit2(&in, OP_ishl, ir_consti(&in, 1), n), ir_consti(&in, OPEN_MORE));
    if (again) bit = ir_select(&in, has, known->bit, bit);
    Inst *unknown = is_unknown(&in, arg);
    if (arg2.lo) unknown = bounds_op2(&in, OP_bor, unknown, is_unknown(&in, arg2));
    Inst *set = open_union(&in, open_union(&in, bit, bits_where(&in, unknown, OPEN_JUMP)), more);
    ir_yield(&in, 2, (Inst *[]){bit, set});
    Inst *none = ir_consti(&out, 0);
    ir_yield(&out, 2, (Inst *[]){none, none});
    if (!again) *known = (Recorded){site, ir_proj(b, br, 0)};
    return ir_proj(b, br, 1);
}

/* The bit of the next event, from n on. */
static Inst *next_bit(const Boxes *x, Builder *b, Inst *n) {
    Inst *told = ir_emit2(b, OP_ilt, n, ir_consti(b, (int32_t)x->slots));
    return ir_select(b, told, ir_emit2(b, OP_ishl, ir_consti(b, 1), n), ir_consti(b, OPEN_MORE));
}

/* Where `open` holds, records that line n of those that part the rays of `search` is an event of the site. */
static Inst *record_line(Boxes *x, Builder *b, const Inst *site, Inst *open, const Inst *search, uint32_t n) {
    Inst *br = ir_if(b, open);
    br->imm.i = IR_IF_RARE;
    Builder in = ir_at_end(x->to, br->region[0]), out = ir_at_end(x->to, br->region[1]);
    Inst *zero = ir_consti(&in, 0), *at = ir_special(&in, OP_load, TY_INT, 2, (Inst *[]){x->recorded, zero}, (Imm){0}),
         *slot = at;
    put(&in, x->edge, slot, ir_consti(&in, (int32_t)site->imm.i));
    for (uint32_t d = 0; d + 2 < site->nargs; d++) put(&in, x->k[d], slot, value_of(x, site->args[d + 2]).is.lo);
    if (x->first) put(&in, x->first, slot, number(&in, 0)), put(&in, x->last, slot, number(&in, 0));
    for (uint32_t k = 0; k < 2; k++)
        put(&in, x->line[k], slot, ir_emit1(&in, OP_i2f, bounds_line(x, &in, search, 2 * n + k)));
    put(&in, x->recorded, zero, ir_emit2(&in, OP_iadd, at, ir_consti(&in, 1)));
    Inst *bit = next_bit(x, &in, at), *none = ir_consti(&out, 0);
    ir_yield(&in, 1, &bit);
    ir_yield(&out, 1, &none);
    return ir_proj(b, br, 0);
}

/* Where a ray may meet a mesh or not: an event for each line that bounds know; if these are not all, it may also jump
 * elsewhere. */
static Inst *record_lines(Boxes *x, Builder *b, const Inst *site, Inst *open) {
    const Inst *search = x->edge ? bounds_searched(x, site) : NULL;
    Inst *jumps = bits_where(b, open, OPEN_JUMP);
    if (!search) return jumps;
    Inst *answer = x->answer[search->id], *least = ir_consti(b, SLT_RAYS_EITHER),
         *most = ir_consti(b, SLT_RAYS_EITHER + SLT_LINES);
    Inst *all = bounds_op2(b, OP_ile, answer, most);
    Inst *count = bounds_op2(b, OP_isub, answer, bounds_choose(b, all, least, most));
    Inst *known = bounds_op2(b, OP_band, all, bounds_op2(b, OP_ilt, least, answer));
    Inst *set = open_where(b, known, NULL, jumps);
    for (uint32_t n = 0; n < SLT_LINES; n++) {
        Inst *has = bounds_op2(b, OP_band, open, bounds_op2(b, OP_ilt, ir_consti(b, (int32_t)n), count));
        set = open_union(b, set, record_line(x, b, site, has, search, n));
    }
    return set;
}

static void site_value(Boxes *x, Builder *b, const Inst *i) {
    const SiteInfo *info = variant_site_info(x->from, i);
    Boxed v = value_of(x, i->args[0]);
    if (!bounds_wide(x, i->args[0]) || !(x->fact[i->args[1]->id] & FACT_SLOPE)) { /* it follows jumps that are told */
        x->value[i->id] = v;
        return;
    }
    if (ir_site_of_mesh(info->kind) && !info->skip_loop) {
        v.open = record_lines(x, b, i, bounds_undecided(b, v.is));
        x->value[i->id] = v;
        return;
    }
    if (ir_site_of_ray(info->kind) || info->skip_loop || !x->edge) {
        v.open = open_union(b, v.open, bits_where(b, bounds_undecided(b, v.is), OPEN_JUMP));
        x->value[i->id] = v;
        return;
    }
    const Inst *cmp = comparison(x, i->args[0]);
    bool pair = ir_ops[cmp->op].compares && ir_ops[cmp->op].arg == TY_FLT;
    Bound p = value_of(x, pair ? cmp->args[0] : i->args[1]).is, q = {0};
    if (pair) q = value_of(x, cmp->args[1]).is;
    /* The set of an untagged comparison says that it may jump: its event says it better. */
    Inst *more =
        open_union(b, value_of(x, i->args[1]).open,
                   pair ? open_union(b, value_of(x, cmp->args[0]).open, value_of(x, cmp->args[1]).open) : v.open);
    Inst *first = NULL, *last = NULL;
    if (info->kind == SITE_WAVE) { /* what is open are levels of u, and g there is that of one of them */
        const Inst *u, *angle, *phase;
        variant_wave_of(i, &u, &angle, &phase);
        p = value_of(x, u).is, more = open_union(b, more, value_of(x, u).open);
        Inst *at = value_of(x, angle).is.lo;
        if (x->first) variant_wave_levels(b, p.lo, p.hi, at, value_of(x, phase).is.lo, &first, &last);
    }
    v.open = record(x, b, i, bounds_undecided(b, v.is), p, q, first, last, more);
    x->value[i->id] = v;
}

/* The set of a minimum or maximum: `any` where it may be either, else that of the one that wins. */
static Inst *open_unless_settled(Builder *b, Op op, Inst *either, Inst *any, Boxed p, Boxed q) {
    Inst *below = not_above(b, p.is.hi, q.is.lo), *above = not_above(b, q.is.hi, p.is.lo);
    return open_where(b, either, any, open_where(b, op == OP_fmin ? below : above, p.open, q.open));
}

/* A rounding, or a seam around a minimum or its kin, whose value it passes on. */
static void siten_value(Boxes *x, Builder *b, const Inst *i) {
    const SiteInfo *info = variant_site_info(x->from, i);
    const Inst *of = i->args[0];
    Boxed v = value_of(x, of);
    if (!bounds_wide(x, of) || !(x->fact[i->args[1]->id] & FACT_SLOPE)) {
        x->value[i->id] = v;
        return;
    }
    if (info->kind != SITE_COMPARE) {
        Boxed arg = value_of(x, i->args[1]);
        Inst *open = bounds_op2(b, OP_fne, v.is.lo, v.is.hi);
        Builder f = folding(b);
        Inst *last = x->first ? variant_boundary(&f, info->kind, ir_emit2(&f, OP_fsub, v.is.hi, number(b, 1))) : NULL;
        Inst *first = x->first ? variant_boundary(&f, info->kind, v.is.lo) : NULL;
        if (x->edge && !info->skip_loop) v.open = record(x, b, i, open, arg.is, (Bound){0}, first, last, arg.open);
        else v.open = bits_where(b, open, OPEN_JUMP);
    } else {
        Boxed p = value_of(x, of->args[0]), q;
        q = of->nargs > 1 ? value_of(x, of->args[1]) : p;
        BoundEvents events = ir_bound_events(b, (Op)of->op, (Bound[]){p.is, q.is}, of->nargs, 0);
        bool chooses = of->op == OP_fmin || of->op == OP_fmax;
        Inst *open = of->op == OP_fatan2 ? events.jumps : events.bends;
        Inst *event = open && x->edge ? record(x, b, i, open, p.is, q.is, NULL, NULL, NULL) : NULL;
        Inst *any = open_union(b, event, open_union(b, p.open, q.open));
        v.open = open && chooses ? open_unless_settled(b, of->op, open, any, p, q) : any;
    }
    x->value[i->id] = v;
}

/* ---- rows */

/* BOUND_*. */
static uint32_t known_of_arguments(const Inst *i) {
    const Inst *first = i->args[0];
    bool same = i->nargs > 1 && first == i->args[1];
    while (first->op == OP_siten) first = first->args[0]; /* a seam */
    bool square = first->op == OP_fmul && first->args[0] == first->args[1];
    return (same ? BOUND_SAME : 0) | (first->op == OP_fabs || square ? BOUND_NO_MINUS_0 : 0);
}

/* What may go either way in the row itself, where no site or seam tells; NULL: nothing. */
static Inst *own_open(const Boxes *x, Builder *b, const Inst *i, const Bound *a, Bound r) {
    if (ir_ops[i->op].arg != TY_FLT || ir_ops[i->op].selects || !bounds_slopes(x, i)) return NULL;
    if (ir_ops[i->op].result == TY_BOOL) return bits_where(b, bounds_undecided(b, r), OPEN_JUMP);
    BoundEvents events = ir_bound_events(b, (Op)i->op, a, i->nargs, known_of_arguments(i));
    Inst *open = events.bends ? bits_where(b, events.bends, OPEN_BEND) : NULL;
    if (events.jumps) open = open_union(b, open, bits_where(b, events.jumps, OPEN_JUMP));
    return open;
}

static void row_value(Boxes *x, Builder *b, const Inst *i) {
    Bound a[3];
    Boxed arg[3] = {0};
    Inst *open = NULL;
    for (uint32_t k = 0; k < i->nargs; k++) {
        arg[k] = value_of(x, i->args[k]);
        a[k] = arg[k].is;
        open = open_union(b, open, arg[k].open);
    }
    Boxed r = {.is = ir_bound_row(b, (Op)i->op, a, i->nargs, known_of_arguments(i))};
    r.is = bounds_mix(x, b, i, bounds_remainder(x, b, i, r.is));
    if (i->op == OP_flt || i->op == OP_fle) r.is = bounds_lean_order(x, b, i, arg, r.is);
    if (x->fact[i->id] & FACT_LEAN) r.lean = bounds_lean(x, b, i, arg), r.is = bounds_lean_meets(x, b, r.is, r.lean);
    Inst *own = own_open(x, b, i, a, r.is);
    if (own && !(x->fact[i->id] & FACT_OPEN)) ice(x->to->session, "%s may jump or bend", ir_ops[i->op].name);
    r.open = open_union(b, open, own);
    Inst *either =
        r.open && (i->op == OP_fmin || i->op == OP_fmax) ? ir_bound_events(b, (Op)i->op, a, 2, 0).bends : NULL;
    if (either) r.open = open_unless_settled(b, (Op)i->op, either, r.open, arg[0], arg[1]);
    if (ir_ops[i->op].selects)
        r.open = open_where(b, a[0].lo, arg[1].open, arg[2].open); /* by a condition of one value */
    IrType t = (IrType)ir_ops[i->op].result;
    if (r.open && t == TY_BOOL) r.open = open_where(b, bounds_undecided(b, r.is), r.open, NULL);
    if (r.open && t == TY_INT) r.open = open_where(b, ir_bound_is_point(b, r.is), NULL, r.open);
    if (x->fact[i->id] & FACT_ERROR) r.error = bounds_error(x, b, i, arg, r.is);
    x->value[i->id] = r;
}

static Boxed unknown_value(Builder *b, const Inst *i) {
    return (Boxed){.is = ir_bound_whole(b, (IrType)i->type), .open = ir_consti(b, OPEN_JUMP)};
}

static Boxed point(Inst *v) { return (Boxed){.is = {v, v}}; }

static void copy(Boxes *x, Builder *b, const Inst *i) {
    Inst *args[8];
    for (uint32_t a = 0; a < i->nargs; a++) args[a] = value_of(x, i->args[a]).is.lo;
    Inst *c = ir_special(b, (Op)i->op, (IrType)i->type, i->nargs, args, i->imm);
    x->value[i->id] = point(c);
    if (!(x->fact[i->id] & FACT_ERROR)) return;
    Boxed arg[3] = {0};
    for (uint32_t a = 0; a < i->nargs && a < 3; a++) arg[a] = value_of(x, i->args[a]);
    x->value[i->id].error = bounds_error(x, b, i, arg, (Bound){c, c});
}

/* ---- chunks: a lower and an upper end lie side by side, for the value and each of its tangents; behind them all what
 * the value hangs on, and its error */

static Imm place(const Boxes *x, const Inst *i, uint32_t p) {
    Imm imm = i->imm;
    imm.frame.place = p, imm.frame.places = 2 * i->imm.frame.places + (x->ends_alone ? 0 : 2);
    return imm;
}

static void give(Boxes *x, Builder *b, const Inst *i) {
    const Inst *of = i->args[0];
    Boxed v = value_of(x, of);
    uint32_t p = i->imm.frame.place, behind = 2 * i->imm.frame.places;
    ir_special(b, OP_give, TY_VOID, 1, &v.is.lo, place(x, i, 2 * p));
    ir_special(b, OP_give, TY_VOID, 1, &v.is.hi, place(x, i, 2 * p + 1));
    if (p > 0 || x->ends_alone) return;
    if (!v.open) v.open = ir_consti(b, 0);
    ir_special(b, OP_give, TY_VOID, 1, &v.open, place(x, i, behind));
    if (of->type != TY_FLT || !x->wanted) return;
    if (!v.error) v.error = number(b, 0);
    ir_special(b, OP_give, TY_VOID, 1, &v.error, place(x, i, behind + 1));
}

static void take(Boxes *x, Builder *b, const Inst *i) {
    Boxed *v = &x->value[i->id];
    IrType type = (IrType)i->type;
    uint32_t p = i->imm.frame.place, behind = 2 * i->imm.frame.places;
    *v = (Boxed){.is.lo = ir_special(b, OP_take, type, 0, NULL, place(x, i, 2 * p)),
                 .is.hi = ir_special(b, OP_take, type, 0, NULL, place(x, i, 2 * p + 1))};
    if (x->fact[i->id] & FACT_OPEN) v->open = ir_special(b, OP_take, TY_INT, 0, NULL, place(x, i, behind));
    if (x->fact[i->id] & FACT_ERROR) v->error = ir_special(b, OP_take, TY_FLT, 0, NULL, place(x, i, behind + 1));
}

static void position(Boxes *x, Builder *b, const Inst *i) {
    const uint32_t axis = (uint32_t)(i->imm.i - IN_X0);
    const Bound is = {ir_input(b, (InputSlot)i->imm.i), ir_input(b, (InputSlot)(IN_H0 + axis))};
    x->value[i->id] = (Boxed){.is = is};
    if (x->fact[i->id] & FACT_LEAN) x->value[i->id].lean = bounds_lean_input(x, b, axis, is);
}

void bounds_value(Boxes *x, Builder *b, const Inst *i) {
    switch ((Op)i->op) {
    case OP_input:
        if (i->imm.i <= IN_X2) position(x, b, i);
        else if (bounds_wide(x, i)) x->value[i->id] = unknown_value(b, i);
        else copy(x, b, i);
        return;
    case OP_rand:
        x->value[i->id] = (Boxed){.is = {number(b, 0), number(b, 1)}, .open = ir_consti(b, OPEN_JUMP)};
        return;
    case OP_query: bounds_query(x, b, i); return;
    case OP_ieq:
    case OP_ine:
        if (bounds_wide(x, i) && bounds_found(x, b, i)) return;
        break;
    case OP_live:
    case OP_settled: copy(x, b, i); return;
    case OP_give: give(x, b, i); return;
    case OP_take: take(x, b, i); return;
    case OP_choice: {
        Inst *may[2] = {value_of(x, i->args[0]).is.hi, value_of(x, i->args[1]).is.hi};
        ir_special(b, OP_choice, TY_VOID, 2, may, i->imm);
        return;
    }
    case OP_told:
    case OP_window: x->value[i->id] = unknown_value(b, i); return;
    case OP_ghost: x->value[i->id] = (Boxed){.is = {number(b, 0), number(b, 0)}}; return;
    case OP_param:
    case OP_dparam:
    case OP_iparam: bounds_param(x, b, i); return;
    case OP_detach: x->value[i->id] = value_of(x, i->args[0]); return;
    case OP_site: site_value(x, b, i); return;
    case OP_siten: siten_value(x, b, i); return;
    case OP_fsel:
    case OP_isel:
    case OP_bsel:
        if (bounds_wide(x, i->args[0])) {
            select_value(x, b, i);
            return;
        }
        break;
    default: break;
    }
    if ((x->fact[i->id] & FACT_CAPTURE) && is_first_nothing(x, i)) {
        x->value[i->id] = bounds_nothing(b);
        return;
    }
    if (!bounds_wide(x, i)) {
        if (ir_ops[i->op].special && !ir_is_const(i)) ice(x->to->session, "bounds of %s", ir_ops[i->op].name);
        copy(x, b, i);
        return;
    }
    row_value(x, b, i);
}
