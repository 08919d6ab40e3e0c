/* bounds: the primal on a box, in interval arithmetic of the program's own precision; edge_bounds: g and its gradient
 * likewise.
 *
 * Inputs are two corners of a box, both of which belong to it; each value becomes a pair of ends that enclose what any
 * kernel computes for it at any point of the box, rounding included (ir/bounds.h). What f may jump or bend at is told
 * by name: the events of sites and seams that are open and that an output hangs on, or as a bit of the state.
 * variant_bounds.h says how. Moore, "Interval Analysis" (1966); Keeter, "Massively parallel rendering of complex
 * closed-form implicit surfaces" (2020) evaluates expressions so, without control flow. */
#include "compiler/pass/variant_bounds.h"

#include <math.h>

/* ---- room for events */

static Inst *room(Builder *b, IrType elem, uint32_t count) {
    Imm imm = {0};
    imm.arr.count = count;
    imm.arr.elem = elem;
    return ir_special(b, OP_alloc, TY_ARRAY, 0, NULL, imm);
}

typedef struct Census {
    uint64_t events;
    uint32_t depth;
    bool roundings, lines;
} Census;

static void take_census(const Boxes *x, const Block *b, Census *c) {
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) take_census(x, i->region[r], c);
        if (!variant_is_site(i) || !bounds_wide(x, i)) continue;
        const SiteInfo *info = variant_site_info(x->from, i);
        c->events += info->max_events * (ir_site_of_mesh(info->kind) ? SLT_LINES : 1);
        c->lines |= ir_site_of_mesh(info->kind);
        if (c->events > OPEN_SLOTS) c->events = OPEN_SLOTS;
        if (info->depth > c->depth) c->depth = info->depth;
        c->roundings |= info->kind != SITE_COMPARE && !ir_site_of_ray(info->kind);
    }
}

static void make_room(Boxes *x, Builder *b) {
    Census c = {0};
    take_census(x, x->from->body, &c);
    if (!c.events) return;
    x->slots = (uint32_t)c.events, x->depth = c.depth;
    x->known = ARENA_ARRAY(x->arena, Recorded, x->from->nsites);
    x->recorded = room(b, TY_INT, 1);
    x->edge = room(b, TY_INT, x->slots + 1);
    for (uint32_t d = 0; d < c.depth; d++) x->k[d] = room(b, TY_INT, x->slots + 1);
    for (uint32_t k = 0; k < 2 && c.lines; k++) x->line[k] = room(b, TY_FLT, x->slots + 1);
    if (c.roundings) x->first = room(b, TY_FLT, x->slots + 1), x->last = room(b, TY_FLT, x->slots + 1);
}

/* ---- outputs */

static Inst *read(Builder *b, Inst *array, Inst *at) {
    return ir_special(b, OP_load, array->imm.arr.elem, 2, (Inst *[]){array, at}, (Imm){0});
}

enum { MANY = 1 << 20 }; /* boundaries of one rounding that are counted */

/* The events of the set: edge, k.., [first, last] of each, and how many in all. */
static void name_events(Boxes *x, Builder *b, Inst *open, Outputs *o) {
    uint32_t rounds = x->first ? 2 : 0, per = 1 + x->depth + rounds + (x->line[0] ? 2 : 0),
             n = x->slots < SLT_MAX_OPEN ? x->slots : SLT_MAX_OPEN;
    Inst *told = bounds_op2(b, OP_iand, open, ir_consti(b, (int32_t)((1u << x->slots) - 1u)));
    Inst *any =
        bounds_op2(b, OP_ine, bounds_op2(b, OP_iand, open, ir_consti(b, OPEN_MORE | (OPEN_MORE - 1))), ir_consti(b, 0));
    Inst *br = ir_if(b, any);
    br->imm.i = IR_IF_RARE;
    Builder in = ir_at_end(x->to, br->region[0]), out = ir_at_end(x->to, br->region[1]);
    Vec(Inst *) yes = {0}, no = {0};
    Inst *zero = ir_consti(&in, 0), *none = ir_consti(&in, -1), *one = ir_consti(&in, 1);
    Inst *count =
        bounds_choose(&in, bounds_op2(&in, OP_ine, bounds_op2(&in, OP_iand, open, ir_consti(&in, OPEN_MORE)), zero),
                      ir_consti(&in, SLT_MAX_OPEN + 1), zero);
    vec_push(x->arena, &yes, count);
    vec_push(x->arena, &no, ir_consti(&out, 0));
    Inst *rest = told;
    for (uint32_t e = 0; e < n; e++) {
        Inst *some = bounds_op2(&in, OP_ine, rest, zero);
        Inst *lowest = bounds_op2(&in, OP_iand, rest, bounds_op1(&in, OP_ineg, rest));
        Inst *at = bounds_op1(&in, OP_fexpo, bounds_op1(&in, OP_i2f, lowest)); /* its position; of none 0 */
        vec_push(x->arena, &yes, bounds_choose(&in, some, read(&in, x->edge, at), none));
        vec_push(x->arena, &no, ir_consti(&out, -1));
        for (uint32_t d = 0; d < x->depth; d++) {
            vec_push(x->arena, &yes, read(&in, x->k[d], at));
            vec_push(x->arena, &no, ir_consti(&out, 0));
        }
        Inst *times = one;
        if (x->first) {
            Inst *first = read(&in, x->first, at), *last = read(&in, x->last, at);
            vec_push(x->arena, &yes, first);
            vec_push(x->arena, &yes, last);
            vec_push(x->arena, &no, ir_constf(&out, 0));
            vec_push(x->arena, &no, ir_constf(&out, 0));
            Inst *more = bounds_op1(&in, OP_f2i, ir_emit2(&in, OP_fsub, last, first));
            more = bounds_op2(&in, OP_imin, bounds_op2(&in, OP_imax, more, zero), ir_consti(&in, MANY));
            times = bounds_op2(&in, OP_iadd, more, one);
        }
        for (uint32_t k = 0; k < 2 && x->line[0]; k++) {
            vec_push(x->arena, &yes, read(&in, x->line[k], at));
            vec_push(x->arena, &no, ir_constf(&out, 0));
        }
        count = bounds_op2(&in, OP_iadd, count, bounds_choose(&in, some, times, zero));
        rest = bounds_op2(&in, OP_iand, rest, bounds_op2(&in, OP_isub, rest, one));
    }
    /* What is left has one boundary each, at least. */
    yes.data[0] = bounds_op2(&in, OP_iadd, count, bounds_choose(&in, bounds_op2(&in, OP_ine, rest, zero), one, zero));
    ir_yield(&in, yes.len, yes.data);
    ir_yield(&out, no.len, no.data);
    variant_output(o, SLT_OUT_OPEN, 0, ir_proj(b, br, 0));
    for (uint32_t e = 0; e < n; e++) variant_output(o, SLT_OUT_OPEN_EDGE, e, ir_proj(b, br, 1 + e * per));
    for (uint32_t e = 0; e < n; e++)
        for (uint32_t d = 0; d < x->depth; d++)
            variant_output(o, SLT_OUT_OPEN_K, e * x->depth + d, ir_proj(b, br, 2 + e * per + d));
    for (uint32_t which = 0; x->first && which < 2; which++)
        for (uint32_t e = 0; e < n; e++)
            variant_output(o, which ? SLT_OUT_OPEN_LAST : SLT_OUT_OPEN_FIRST, e,
                           ir_proj(b, br, 2 + e * per + x->depth + which));
    for (uint32_t k = 0; x->line[0] && k < 2 * n; k++)
        variant_output(o, SLT_OUT_OPEN_LINE, k, ir_proj(b, br, 2 + k / 2 * per + x->depth + rounds + k % 2));
}

static Inst *has(Builder *b, Inst *open, int32_t bits) {
    return bounds_op2(b, OP_ine, bounds_op2(b, OP_iand, open, ir_consti(b, bits)), ir_consti(b, 0));
}

static Inst *bit(Builder *b, Inst *cond, int32_t value) {
    return bounds_choose(b, cond, ir_consti(b, value), ir_consti(b, 0));
}

/* Both ends are finite numbers. */
static Inst *is_bounded(Builder *b, Bound v) {
    return bounds_op2(b, OP_band, bounds_op2(b, OP_flt, ir_constf(b, -INFINITY), v.lo),
                      bounds_op2(b, OP_flt, v.hi, ir_constf(b, INFINITY)));
}

/* Bounds of f, behind the outputs that are there. */
static void value_outputs(Boxes *x, Builder *b, Outputs *o) {
    const Inst *yield = x->from->body->last;
    for (uint32_t end = 0; end < 2; end++)
        for (uint32_t c = 0; c < yield->nargs; c++) {
            Bound v = ir_bound_ends(b, x->value[yield->args[c]->id].is);
            variant_output(o, end ? SLT_OUT_F_HI : SLT_OUT_F_LO, c, end ? v.hi : v.lo);
        }
    ir_yield(b, 0, NULL);
    variant_set_outputs(x->to, o);
}

static void box_outputs(Boxes *x, Builder *b) {
    const Inst *yield = x->from->body->last;
    Inst *open = NULL, *bounded = NULL;
    for (uint32_t c = 0; c < yield->nargs; c++) {
        Boxed v = x->value[yield->args[c]->id];
        open = open_union(b, open, v.open);
        bounded = bounds_and(b, bounded, is_bounded(b, v.is));
    }
    if (!open) open = ir_consti(b, 0);
    Inst *jumps = bounds_op2(b, OP_bor, has(b, open, OPEN_JUMP), bounds_not(b, bounded));
    Inst *state = bounds_op2(b, OP_ior, bit(b, jumps, SLT_BOX_UNKNOWN), bit(b, has(b, open, OPEN_BEND), SLT_BOX_ROUGH));
    Outputs o = {0};
    variant_output(&o, SLT_OUT_BOX_STATE, 0, state);
    if (x->edge) name_events(x, b, open, &o);
    value_outputs(x, b, &o);
}

/* Of g and each component of its gradient: how far from what exact arithmetic gives. */
static Inst *error_of(Builder *b, Boxed v) {
    return v.error ? ir_emit2(b, OP_fadd, v.error, v.error) : ir_constf(b, 0);
}

/* What the edge kernel was derived from once more: g and its gradient, then the gradients of each of these. */
static bool has_second(const Fn *from) { return from->body->last->nargs > 1 + from->dim; }

/* Second derivatives, by row from the diagonal on: whole lines where g bends, for there they bound nothing. */
static void second_outputs(Boxes *x, Builder *b, Inst *state, Outputs *o) {
    const Inst *const *arg = (const Inst *const *)x->from->body->last->args;
    uint32_t dim = x->from->dim;
    Inst *smooth = bounds_op2(b, OP_ieq, state, ir_consti(b, 0));
    for (uint32_t d = 1; d <= dim; d++) {
        Inst *open = x->value[arg[d]->id].open;
        if (open) smooth = bounds_op2(b, OP_band, smooth, bounds_not(b, has(b, open, OPEN_JUMP)));
    }
    for (uint32_t end = 0; end < 2; end++)
        for (uint32_t row = 0, n = 0; row < dim; row++)
            for (uint32_t d = row; d < dim; d++, n++) {
                Bound v = ir_bound_ends(b, x->value[arg[1 + dim + (1 + row) * dim + d]->id].is);
                Inst *whole = ir_constf(b, end ? INFINITY : -INFINITY);
                variant_output(o, end ? SLT_OUT_DDG_HI : SLT_OUT_DDG_LO, n,
                               bounds_choose(b, smooth, end ? v.hi : v.lo, whole));
            }
    for (uint32_t d = 0; d < dim; d++) variant_output(o, SLT_OUT_DG_ERROR, d, error_of(b, x->value[arg[1 + d]->id]));
}

/* g, then its gradient */
static void edge_outputs(Boxes *x, Builder *b) {
    const Inst *yield = x->from->body->last;
    Boxed g = x->value[yield->args[0]->id];
    Inst *open = g.open ? g.open : ir_consti(b, 0);
    Inst *jumps = bounds_op2(b, OP_bor, has(b, open, OPEN_JUMP), bounds_not(b, is_bounded(b, g.is)));
    Inst *state = bounds_op2(b, OP_ior, bit(b, jumps, SLT_EDGE_JUMPS), bit(b, has(b, open, OPEN_BEND), SLT_EDGE_BENDS));
    Outputs o = {0};
    Bound ends = ir_bound_ends(b, g.is);
    variant_output(&o, SLT_OUT_G_LO, 0, ends.lo);
    variant_output(&o, SLT_OUT_G_HI, 0, ends.hi);
    for (uint32_t end = 0; end < 2; end++)
        for (uint32_t d = 1; d <= x->from->dim; d++) {
            Bound v = ir_bound_ends(b, x->value[yield->args[d]->id].is);
            Inst *whole = ir_constf(b, end ? INFINITY : -INFINITY);
            variant_output(&o, end ? SLT_OUT_DG_HI : SLT_OUT_DG_LO, d - 1,
                           bounds_choose(b, jumps, whole, end ? v.hi : v.lo));
        }
    variant_output(&o, SLT_OUT_G_STATE, 0, state);
    variant_output(&o, SLT_OUT_G_ERROR, 0, error_of(b, g));
    if (has_second(x->from)) second_outputs(x, b, state, &o);
    ir_yield(b, 0, NULL);
    variant_set_outputs(x->to, &o);
}

typedef enum BoxKernel { OF_VALUE, OF_IMAGE, OF_EDGE, OF_CHUNKS } BoxKernel;

static Fn *on_boxes(PassCtx *ctx, const Fn *from, const char *name, BoxKernel kind) {
    Arena *scratch = &ctx->session->scratch;
    ArenaMark mark = arena_mark(scratch);
    uint32_t n = ir_number((Fn *)from);
    Fn *to = ir_fn(ctx->session, from->arena, name, from->precision);
    to->dim = from->dim, to->channels = from->channels;
    to->nfloats = from->nfloats, to->nints = from->nints;
    to->sites = from->sites, to->nsites = from->nsites;
    to->serves = from->serves;
    Boxes x = {.ctx = ctx,
               .from = from,
               .to = to,
               .arena = scratch,
               .edges = kind == OF_EDGE || kind == OF_CHUNKS,
               .ends_alone = kind == OF_CHUNKS};
    x.fact = ARENA_ARRAY(scratch, uint8_t, n + 1);
    x.value = ARENA_ARRAY(scratch, Boxed, n + 1);
    x.answer = ARENA_ARRAY(scratch, Inst *, n + 1);
    x.goal = ARENA_ARRAY(scratch, Goal, n + 1);
    x.given = ARENA_ARRAY(scratch, Boxed, n + 1);
    x.array = ARENA_ARRAY(scratch, BoxedArray, n + 1);
    if (kind == OF_EDGE) {
        x.wanted = ARENA_ARRAY(scratch, bool, n + 1);
        uint32_t wanted = has_second(from) ? 1 + from->dim : 1;
        for (uint32_t k = 0; k < wanted; k++) bounds_want_error(&x, from->body->last->args[k]);
    }
    bounds_facts(&x);
    if (kind == OF_IMAGE) bounds_want_lean(&x, n);
    if (x.leans) bounds_facts(&x);
    bounds_find_compared(&x);
    Builder b = ir_at_end(to, to->body);
    if (kind == OF_VALUE) make_room(&x, &b);
    bounds_block(&x, &b, from->body);
    b.span = SPAN_NONE;
    Outputs none = {0};
    if (kind == OF_EDGE) edge_outputs(&x, &b);
    else if (kind == OF_VALUE) box_outputs(&x, &b);
    else value_outputs(&x, &b, &none); /* what is open concerns nobody, and goes */
    arena_reset(scratch, mark);
    opt_dce(ctx, to);
    return to;
}

Fn *variant_bounds(PassCtx *ctx, const Fn *seamed, bool image) {
    Fn *noting = ir_clone(seamed, seamed->arena, "bounds.from");
    variant_note_lists(ctx, noting, image);
    return on_boxes(ctx, noting, "bounds", image ? OF_IMAGE : OF_VALUE);
}

bool variant_is_flat(PassCtx *ctx, const Fn *seamed) {
    Arena *scratch = &ctx->session->scratch;
    ArenaMark mark = arena_mark(scratch);
    uint32_t n = ir_number((Fn *)seamed);
    Boxes x = {.ctx = ctx, .from = seamed, .arena = scratch, .fact = ARENA_ARRAY(scratch, uint8_t, n + 1)};
    bounds_facts(&x);
    const Inst *yield = seamed->body->last;
    bool flat = true;
    for (uint32_t c = 0; c < yield->nargs; c++) flat &= !(x.fact[yield->args[c]->id] & FACT_SLOPE);
    arena_reset(scratch, mark);
    return flat;
}

Fn *variant_edge_bounds(PassCtx *ctx, const Fn *edge) { return on_boxes(ctx, edge, "edge_bounds", OF_EDGE); }

Fn *variant_prune(PassCtx *ctx, const Fn *chunks) { return on_boxes(ctx, chunks, "prune", OF_CHUNKS); }
