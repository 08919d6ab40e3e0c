/* Bounds of local arrays and of parameters at an index that is not one number.
 *
 * An array becomes two, of low and of high ends, and a third for sets of what is open. A store replaces elements only
 * where path and index are settled; else every element that it may hit is joined with the value. */
#include "compiler/pass/variant_bounds.h"

enum { SPAN = 64 }; /* parameters that are read one by one for bounds; of more, nothing is said */

static Inst *load(Builder *b, Inst *array, Inst *at) {
    return ir_special(b, OP_load, array->imm.arr.elem, 2, (Inst *[]){array, at}, (Imm){0});
}

static void store(Builder *b, Inst *array, Inst *at, Inst *v) {
    ir_special(b, OP_store, TY_VOID, 3, (Inst *[]){array, at, v}, (Imm){0});
}

static Boxed load_element(Builder *b, const BoxedArray *a, Inst *at) {
    Boxed v = {0};
    v.is.lo = v.is.hi = load(b, a->lo, at);
    if (a->hi) v.is.hi = load(b, a->hi, at);
    if (a->open) v.open = load(b, a->open, at);
    if (a->error) v.error = load(b, a->error, at);
    return v;
}

static void store_element(Builder *b, const BoxedArray *a, Inst *at, Boxed v) {
    store(b, a->lo, at, v.is.lo);
    if (a->hi) store(b, a->hi, at, v.is.hi);
    if (a->open) store(b, a->open, at, v.open ? v.open : ir_consti(b, 0));
    if (a->error) store(b, a->error, at, v.error ? v.error : ir_constf(b, 0));
}

static Inst *alloc(Builder *b, uint32_t count, IrType elem) {
    Imm imm = {0};
    imm.arr.count = count;
    imm.arr.elem = elem;
    return ir_special(b, OP_alloc, TY_ARRAY, 0, NULL, imm);
}

void bounds_alloc(Boxes *x, Builder *b, const Inst *i) {
    BoxedArray *a = &x->array[i->id];
    uint8_t fact = x->fact[i->id];
    *a = (BoxedArray){.lo = alloc(b, i->imm.arr.count, i->imm.arr.elem), .path = x->path.len};
    if (fact & FACT_WIDE) a->hi = alloc(b, i->imm.arr.count, i->imm.arr.elem);
    if (fact & FACT_OPEN) a->open = alloc(b, i->imm.arr.count, TY_INT);
    if (fact & FACT_ERROR) a->error = alloc(b, i->imm.arr.count, TY_FLT);
}

/* An index within an array or a range of parameters. */
static Inst *clamped(Builder *b, Inst *at, uint32_t count) {
    return bounds_op2(b, OP_imin, bounds_op2(b, OP_imax, at, ir_consti(b, 0)), ir_consti(b, (int32_t)count - 1));
}

static Inst *next_index(Builder *b, Inst *at) { return ir_emit2(b, OP_iadd, at, ir_consti(b, 1)); }

/* What holds of the path since the array's alloc: certain (NULL: surely), and the set of what it hangs on. */
static PathStep path_since(Boxes *x, Builder *b, uint32_t from) {
    PathStep p = {0};
    for (uint32_t s = from; s < x->path.len; s++) {
        p.certain = bounds_and(b, p.certain, x->path.data[s].certain);
        p.open = open_union(b, p.open, x->path.data[s].open);
    }
    return p;
}

void bounds_load(Boxes *x, Builder *b, const Inst *i) {
    const BoxedArray *a = &x->array[i->args[0]->id];
    uint32_t count = i->args[0]->imm.arr.count;
    Boxed at = x->value[i->args[1]->id];
    if (!bounds_wide(x, i->args[1])) {
        x->value[i->id] = load_element(b, a, at.is.lo);
        return;
    }
    Inst *from = clamped(b, at.is.lo, count), *to = clamped(b, at.is.hi, count);
    Boxed first = load_element(b, a, from);
    Inst *init[5] = {from, first.is.lo, first.is.hi, first.open ? first.open : ir_consti(b, 0), first.error};
    Inst *loop = ir_loop(b, first.error ? 5 : 4, init, (LoopInfo){.max_iters = count});
    Inst **p = loop->region[0]->params;
    Builder in = ir_at_end(x->to, loop->region[0]);
    Boxed v = load_element(&in, a, p[1]);
    Bound hull = ir_bound_hull(&in, (Bound){p[2], p[3]}, v.is);
    Inst *yield[6] = {ir_emit2(&in, OP_ilt, p[1], to),
                      next_index(&in, p[1]),
                      hull.lo,
                      hull.hi,
                      open_union(&in, p[4], v.open),
                      first.error ? error_larger(&in, p[5], v.error) : NULL};
    ir_yield(&in, first.error ? 6 : 5, yield);
    Boxed r = {.is = {ir_proj(b, loop, 1), ir_proj(b, loop, 2)}};
    r.open = open_union(b, ir_proj(b, loop, 3), at.open);
    if (first.error) r.error = ir_proj(b, loop, 4);
    x->value[i->id] = r;
}

static Boxed weakened(Builder *b, const BoxedArray *a, Inst *at, Boxed v, Inst *strong, Inst *open) {
    Boxed old = load_element(b, a, at), r = {0};
    Bound hull = ir_bound_hull(b, old.is, v.is);
    r.is.lo = bounds_choose(b, strong, v.is.lo, hull.lo);
    r.is.hi = bounds_choose(b, strong, v.is.hi, hull.hi);
    r.open = open_where(b, strong, v.open, open_union(b, open, open_union(b, old.open, v.open)));
    r.error = error_larger(b, old.error, v.error);
    return r;
}

void bounds_store(Boxes *x, Builder *b, const Inst *i) {
    const BoxedArray *a = &x->array[i->args[0]->id];
    uint32_t count = i->args[0]->imm.arr.count;
    Boxed at = x->value[i->args[1]->id], v = x->value[i->args[2]->id];
    PathStep path = path_since(x, b, a->path);
    Inst *open = open_union(b, path.open, at.open);
    if (!bounds_wide(x, i->args[1])) {
        store_element(b, a, at.is.lo, path.certain ? weakened(b, a, at.is.lo, v, path.certain, open) : v);
        return;
    }
    Inst *from = clamped(b, at.is.lo, count), *to = clamped(b, at.is.hi, count);
    Inst *strong = bounds_and(b, path.certain, bounds_op2(b, OP_ieq, from, to));
    Inst *loop = ir_loop(b, 1, &from, (LoopInfo){.max_iters = count});
    Inst *j = loop->region[0]->params[1];
    Builder in = ir_at_end(x->to, loop->region[0]);
    store_element(&in, a, j, weakened(&in, a, j, v, strong, open));
    Inst *yield[2] = {ir_emit2(&in, OP_ilt, j, to), next_index(&in, j)};
    ir_yield(&in, 2, yield);
}

void bounds_acopy(Boxes *x, Builder *b, const Inst *i) {
    const BoxedArray *to = &x->array[i->args[0]->id], *from = &x->array[i->args[1]->id];
    uint32_t count = i->args[0]->imm.arr.count;
    PathStep path = path_since(x, b, to->path);
    if (!to->hi) {
        if (to->error && from->error) ir_special(b, OP_acopy, TY_VOID, 2, (Inst *[]){to->error, from->error}, (Imm){0});
        ir_special(b, OP_acopy, TY_VOID, 2, (Inst *[]){to->lo, from->lo}, (Imm){0});
        return;
    }
    Inst *loop = ir_loop(b, 0, NULL, (LoopInfo){.max_iters = count, .exact = true});
    Inst *j = loop->region[0]->params[0];
    Builder in = ir_at_end(x->to, loop->region[0]);
    Boxed v = load_element(&in, from, j);
    store_element(&in, to, j, path.certain ? weakened(&in, to, j, v, path.certain, path.open) : v);
    Inst *go_on = ir_emit2(&in, OP_ilt, j, ir_consti(&in, (int32_t)count - 1));
    ir_yield(&in, 1, &go_on);
}

/* ---- parameters */

enum { AXES = 3 };

/* An index as a sum of factors times what has bounds of its own, and of what is one number: slice, row and column of a
 * texture, elements and fields of nested arrays. */
typedef struct Grid {
    struct {
        Bound at;
        int32_t factor;
    } axis[AXES];
    uint32_t axes;
    Inst *rest; /* NULL: nothing */
} Grid;

static Inst *times(Builder *b, Inst *v, int32_t factor) {
    return factor == 1 ? v : bounds_op2(b, OP_imul, v, ir_consti(b, factor));
}

static Inst *plus(Builder *b, Inst *v, Inst *w) { return v ? bounds_op2(b, OP_iadd, v, w) : w; }

/* Adds factor * i; false where there are more axes than that. */
static bool add_axes(Boxes *x, Builder *b, Grid *g, const Inst *i, int64_t factor) {
    if (factor > INT32_MAX || factor < INT32_MIN) return false;
    if (!bounds_wide(x, i)) {
        g->rest = plus(b, g->rest, times(b, x->value[i->id].is.lo, (int32_t)factor));
        return true;
    }
    if (i->op == OP_iadd) return add_axes(x, b, g, i->args[0], factor) && add_axes(x, b, g, i->args[1], factor);
    if (i->op == OP_imul)
        for (uint32_t k = 0; k < 2; k++)
            if (ir_is_const(i->args[k])) return add_axes(x, b, g, i->args[1 - k], factor * i->args[k]->imm.i);
    Bound at = x->value[i->id].is;
    for (uint32_t k = 0; k < g->axes; k++)
        if (g->axis[k].factor == factor) {
            g->axis[k].at = ir_bound_row(b, OP_iadd, (Bound[]){g->axis[k].at, at}, 2, 0);
            return true;
        }
    if (g->axes == AXES) return false;
    g->axis[g->axes].at = at, g->axis[g->axes++].factor = (int32_t)factor;
    return true;
}

static Grid grid_of(Boxes *x, Builder *b, const Inst *index, uint32_t count) {
    Grid g = {0};
    if (add_axes(x, b, &g, index, 1) && (g.axes != 1 || g.rest || g.axis[0].factor != 1)) return g;
    Bound at = x->value[index->id].is;
    return (Grid){.axis = {{{clamped(b, at.lo, count), clamped(b, at.hi, count)}, 1}}, .axes = 1};
}

static Inst *grid_index(Builder *b, const Grid *g, Inst *const at[]) {
    Inst *sum = g->rest;
    for (uint32_t k = 0; k < g->axes; k++) sum = plus(b, sum, times(b, at[k], g->axis[k].factor));
    return sum;
}

/* All that index may be, joined, one by one; whole where that is too many. */
void bounds_param(Boxes *x, Builder *b, const Inst *i) {
    Boxed at = x->value[i->args[0]->id];
    if (!bounds_wide(x, i->args[0])) {
        Inst *v = ir_special(b, (Op)i->op, (IrType)i->type, 1, &at.is.lo, i->imm);
        x->value[i->id] = (Boxed){.is = {v, v}};
        return;
    }
    Grid g = grid_of(x, b, i->args[0], i->imm.slot.count);
    Inst *most = ir_consti(b, SPAN), *few = NULL, *cells = NULL, *init[AXES + 2], *last[AXES];
    for (uint32_t k = 0; k < g.axes; k++) {
        Inst *steps = bounds_op2(b, OP_isub, g.axis[k].at.hi, g.axis[k].at.lo);
        few = bounds_and(b, few, bounds_op2(b, OP_ult, steps, most));
        cells = cells ? bounds_op2(b, OP_imul, cells, next_index(b, steps)) : next_index(b, steps);
    }
    if (g.axes > 1) few = bounds_and(b, few, bounds_op2(b, OP_ile, cells, most));
    for (uint32_t k = 0; k < g.axes; k++) {
        init[k] = g.axis[k].at.lo;
        last[k] = bounds_choose(b, few, g.axis[k].at.hi, g.axis[k].at.lo);
    }
    Inst *start = grid_index(b, &g, init);
    init[g.axes] = init[g.axes + 1] = ir_special(b, (Op)i->op, (IrType)i->type, 1, &start, i->imm);
    Inst *loop = ir_loop(b, g.axes + 2, init, (LoopInfo){.max_iters = SPAN});
    Inst **p = loop->region[0]->params + 1, *yield[AXES + 3];
    Builder in = ir_at_end(x->to, loop->region[0]);
    Inst *index = grid_index(&in, &g, p);
    Inst *v = ir_special(&in, (Op)i->op, (IrType)i->type, 1, &index, i->imm);
    Bound hull = ir_bound_hull(&in, (Bound){p[g.axes], p[g.axes + 1]}, (Bound){v, v});
    /* As an odometer: an axis goes on where all before it begin again. */
    Inst *carry = NULL, *any = NULL;
    for (uint32_t k = 0; k < g.axes; k++) {
        Inst *more = ir_emit2(&in, OP_ilt, p[k], last[k]), *step = bounds_and(&in, carry, more);
        Inst *again = bounds_choose(&in, more, next_index(&in, p[k]), init[k]);
        yield[k + 1] = carry ? bounds_choose(&in, carry, again, p[k]) : again;
        any = any ? bounds_op2(&in, OP_bor, any, step) : step;
        carry = bounds_and(&in, carry, ir_emit1(&in, OP_bnot, more));
    }
    yield[0] = any, yield[g.axes + 1] = hull.lo, yield[g.axes + 2] = hull.hi;
    ir_yield(&in, g.axes + 3, yield);
    Bound whole = ir_bound_whole(b, (IrType)i->type);
    Boxed r = {.open = at.open};
    r.is.lo = bounds_choose(b, few, ir_proj(b, loop, g.axes), whole.lo);
    r.is.hi = bounds_choose(b, few, ir_proj(b, loop, g.axes + 1), whole.hi);
    x->value[i->id] = r;
}
