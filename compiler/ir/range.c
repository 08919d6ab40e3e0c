/* The range column of ops.def as code, and the analyses over it. */
#include "compiler/ir/range.h"

#include <string.h>

/* ---- the vocabulary of the column */

static IrRange between(double lo, double hi, uint8_t beyond) {
    IrRange r = {isnan(lo) ? -INFINITY : lo, isnan(hi) ? INFINITY : hi, beyond};
    if (r.lo > -INFINITY && r.hi < INFINITY) r.beyond &= IR_NAN;
    return r;
}

static IrRange join(IrRange a, IrRange b) { return between(fmin(a.lo, b.lo), fmax(a.hi, b.hi), a.beyond | b.beyond); }

IrRange ir_range_const(double v) {
    return isfinite(v) ? (IrRange){v, v, 0}
           : isnan(v)  ? (IrRange){-INFINITY, INFINITY, IR_NAN}
                       : (IrRange){v, v, IR_POLE};
}

static uint8_t nan_of(IrRange a) { return a.beyond & IR_NAN; }
static uint8_t nan_if(bool may) { return may ? IR_NAN : 0; }
/* What makes a NaN where it meets its like. */
static bool may_be_inf(IrRange a) { return a.beyond & (IR_OVERFLOW | IR_POLE); }
static bool may_be_zero(IrRange a) { return !ir_range_nonzero(a); }
static IrRange with(IrRange r, uint8_t beyond) { return r.beyond |= beyond, r; }

/* Of a product: the degree in what loops carry, up to 2. */
static uint8_t growth(IrRange x, IrRange y) {
    enum { GROWS = IR_CARRIED | IR_SQUARED };
    if (!(x.beyond & GROWS) || !(y.beyond & GROWS)) return 0;
    return (x.beyond | y.beyond) & IR_SQUARED ? IR_OVERFLOW : IR_SQUARED;
}

/* x + y: infinities of both signs meet? */
static uint8_t nan_of_sum(IrRange x, IrRange y) {
    bool both = may_be_inf(x) && may_be_inf(y);
    return nan_if(both && ((x.hi == INFINITY && y.lo == -INFINITY) || (x.lo == -INFINITY && y.hi == INFINITY)));
}

static double times(double a, double b) { return a == 0 || b == 0 ? 0 : a * b; }

/* A bound this small may underflow to 0 in binary32, so it proves nothing. */
static double solid(double lo) { return fabs(lo) < 1e-37 ? 0 : lo; }

static IrRange product(IrRange a, IrRange b, bool same) {
    bool zero_times_inf = (may_be_inf(a) && may_be_zero(b)) || (may_be_zero(a) && may_be_inf(b));
    uint8_t beyond = a.beyond | b.beyond | nan_if(zero_times_inf && !same) | growth(a, b);
    double p[4] = {times(a.lo, b.lo), times(a.lo, b.hi), times(a.hi, b.lo), times(a.hi, b.hi)};
    if (same) {
        double low = a.lo > 0 ? a.lo * a.lo : a.hi < 0 ? a.hi * a.hi : 0;
        return between(solid(low), fmax(a.lo * a.lo, a.hi * a.hi), beyond);
    }
    return between(solid(fmin(fmin(p[0], p[1]), fmin(p[2], p[3]))), solid(fmax(fmax(p[0], p[1]), fmax(p[2], p[3]))),
                   beyond);
}

static IrRange quotient(IrRange a, IrRange b) {
    uint8_t nan = nan_of(a) | nan_of(b) | nan_if(may_be_inf(a) && may_be_inf(b));
    if (may_be_zero(b)) return (IrRange){-INFINITY, INFINITY, IR_OVERFLOW | IR_POLE | nan | nan_if(may_be_zero(a))};
    IrRange finite = {a.lo, a.hi, 0}, r = product(finite, (IrRange){1 / b.hi, 1 / b.lo, 0}, false);
    return between(r.lo, r.hi, nan | (a.beyond & ~IR_NAN));
}

static double magnitude(IrRange a) { return fmax(fabs(a.lo), fabs(a.hi)); }

static IrRange root(IrRange a) {
    uint8_t beyond = a.beyond & IR_SQUARED ? (a.beyond & ~IR_SQUARED) | IR_CARRIED : a.beyond;
    return between(a.lo > 0 ? sqrt(a.lo) : 0, a.hi > 0 ? sqrt(a.hi) : INFINITY, beyond | nan_if(a.lo < 0));
}

static IrRange inverse_root(IrRange a) {
    uint8_t nan = nan_of(a) | nan_if(a.lo < 0);
    if (a.lo <= 0) return (IrRange){0, INFINITY, IR_POLE | nan};
    return between(a.hi < INFINITY ? 1 / sqrt(a.hi) : 0, 1 / sqrt(a.lo), nan);
}

static IrRange logarithm(IrRange a, double lo, double hi) {
    return a.lo > 0 ? between(lo, hi, a.beyond) : with(IR_RANGE_WIDE, nan_of(a) | nan_if(a.lo < 0));
}

/* exp and its kin: infinite unless bounded above (80 serves both precisions). */
static IrRange exponential(IrRange a, double base) {
    double scale = log(base), hi = a.hi * scale;
    return between(a.lo * scale > -80 ? pow(base, a.lo) : 0, hi < 80 ? pow(base, a.hi) : INFINITY,
                   (hi >= 80 ? IR_OVERFLOW : 0) | nan_of(a));
}

static bool moderate(IrRange a) { return a.lo > -80 && a.hi < 80; }

static IrRange power(IrRange a, IrRange b) {
    bool fixed = b.lo == b.hi, real = a.lo >= 0 || (fixed && b.lo == trunc(b.lo));
    return between(a.lo >= 0 ? 0 : -INFINITY, INFINITY,
                   (fixed && b.lo >= 0 ? a.beyond | (b.lo > 1 ? growth(a, a) : 0) : IR_POLE | IR_OVERFLOW) | nan_of(a) |
                       nan_of(b) | nan_if(!real));
}

/* min and max give a where b is NaN. */
static IrRange least(IrRange a, IrRange b) {
    return between(fmin(a.lo, b.lo), nan_of(b) ? a.hi : fmin(a.hi, b.hi), a.beyond | (b.beyond & ~IR_NAN));
}
static IrRange greatest(IrRange a, IrRange b) {
    return between(nan_of(b) ? a.lo : fmax(a.lo, b.lo), fmax(a.hi, b.hi), a.beyond | (b.beyond & ~IR_NAN));
}

/* Of integers; nothing is known if the divisor may be 0 or negative. Doubles hold quotients of 32-bit integers exactly
 * enough to truncate. */
static IrRange int_quotient(IrRange a, IrRange b) {
    if (!(b.lo > 0)) return IR_RANGE_FINITE;
    return between(trunc(a.lo / (a.lo < 0 ? b.lo : b.hi)), trunc(a.hi / (a.hi < 0 ? b.hi : b.lo)), 0);
}

static IrRange int_remainder(IrRange a, IrRange b) {
    if (!(b.lo > 0)) return IR_RANGE_FINITE;
    return between(a.lo >= 0 ? 0 : 1 - b.hi, fmin(fmax(a.hi, 0), b.hi - 1), 0);
}

/* a & b is at most an operand that is not negative. */
static IrRange int_and(IrRange a, IrRange b) {
    if (a.lo < 0 && b.lo < 0) return IR_RANGE_FINITE;
    return between(0, a.lo < 0 ? b.hi : b.lo < 0 ? a.hi : fmin(a.hi, b.hi), 0);
}

/* A shift by a known count, modulo 32: to the left (direction 1) or to the right (-1). */
static IrRange int_shift(IrRange a, IrRange b, int direction) {
    if (b.lo != b.hi) return IR_RANGE_FINITE;
    int n = direction * (int)((int64_t)b.lo & 31);
    return between(floor(ldexp(a.lo, n)), floor(ldexp(a.hi, n)), 0);
}

/* As unsigned, a negative number is larger than all others. */
static IrRange unsigned_min(IrRange a, IrRange b) {
    if (a.lo < 0 && b.lo < 0) return IR_RANGE_FINITE;
    if (a.lo < 0 || b.lo < 0) return between(0, a.lo < 0 ? b.hi : a.hi, 0);
    return between(fmin(a.lo, b.lo), fmin(a.hi, b.hi), 0);
}

static IrRange sum(IrRange a, IrRange b) {
    return between(a.lo + b.lo, a.hi + b.hi, a.beyond | b.beyond | nan_of_sum(a, b));
}
static IrRange negated(IrRange a) { return between(-a.hi, -a.lo, a.beyond); }

/* ---- the column */

#define BETWEEN(lo, hi, beyond) between(lo, hi, beyond)
#define IN(lo, hi) between(lo, hi, 0)
#define AT(v) ir_range_const(v)
#define UNKNOWN IR_RANGE_FINITE
#define WIDE IR_RANGE_WIDE
#define POLE IR_RANGE_ANY
#define IMM UNKNOWN  /* the row alone does not know its constant, */
#define FLOW UNKNOWN /* nor where a value comes from: the analyses do */
#define JOIN(x, y) join(x, y)
#define ADD(x, y) sum(x, y)
#define SUB(x, y) sum(x, NEG(y))
#define NEG(x) negated(x)
#define MUL(x, y) product(x, y, same)
#define DIV(x, y) quotient(x, y)
#define ABS(x) between((x).lo > 0 ? (x).lo : (x).hi < 0 ? -(x).hi : 0, magnitude(x), (x).beyond)
#define MIN(x, y) least(x, y)
#define MAX(x, y) greatest(x, y)
#define EITHER_SIGN(x) between(-magnitude(x), magnitude(x), (x).beyond)
#define WIDER(x, by) between((x).lo - (by), (x).hi + (by), (x).beyond)
#define SQRT(x) root(x)
#define RSQRT(x) inverse_root(x)
#define CBRT(x) between(cbrt((x).lo), cbrt((x).hi), (x).beyond)
#define EXP(x, base) exponential(x, base)
#define LOG(x, log) logarithm(x, log((x).lo), log((x).hi))
#define SINH(x) (moderate(x) ? between(sinh((x).lo), sinh((x).hi), nan_of(x)) : with(IR_RANGE_FINITE, IR_OVERFLOW | nan_of(x)))
#define COSH(x) between(1, moderate(x) ? cosh(magnitude(x)) : INFINITY, IR_OVERFLOW | nan_of(x))
#define NAN_OF(x, range) with(range, nan_of(x))
#define NAN_AT_INF(x, range) with(range, nan_of(x) | nan_if(may_be_inf(x)))
#define NAN_OUTSIDE(x, least, most, range) with(range, nan_of(x) | nan_if((x).lo < (least) || (x).hi > (most)))
#define POW(x, y) power(x, y)
#define IDIV(x, y) int_quotient(x, y)
#define IREM(x, y) int_remainder(x, y)
#define UREM(x, y) ((x).lo < 0 && (y).lo > 0 ? IN(0, (y).hi - 1) : int_remainder(x, y))
#define AND(x, y) int_and(x, y)
#define SHIFT(x, y, direction) int_shift(x, y, direction)
#define UMIN(x, y) unsigned_min(x, y)
#define NONNEG(x, range) ((x).lo >= 0 ? (range) : UNKNOWN) /* of an unsigned row whose argument x means the same signed */

IrRange ir_range_row(Op op, IrRange a, IrRange b, IrRange c, bool same) {
    switch (op) {
#define ROW(name, range)                                                                                               \
    case OP_##name:                                                                                                    \
        return range;
#define FOP1(name, value, partials, bounds, events, range, ...) ROW(name, range)
#define FOP2(name, value, partials, bounds, events, range, ...) ROW(name, range)
#define FOP3(name, value, partials, bounds, events, range, ...) ROW(name, range)
#define FCMP2(name, ...) ROW(name, IN(0, 1))
#define FSEL(name, value, bounds, range, ...) ROW(name, range)
#define IOP1(name, value, bounds, range, ...) ROW(name, range)
#define IOP2(name, value, bounds, range, ...) ROW(name, range)
#define ICMP2(name, ...) ROW(name, IN(0, 1))
#define BOP1(name, ...) ROW(name, IN(0, 1))
#define BOP2(name, ...) ROW(name, IN(0, 1))
#define CONV(name, result, argument, value, bounds, events, range, ...) ROW(name, range)
#define SPECIAL(name, signature, kind, range, ...) ROW(name, range)
#include "compiler/ir/ops.def"
#include "compiler/ir/ops_undef.h"
    case OP_COUNT: break;
    }
    return IR_RANGE_FINITE;
}

/* An integer that may wrap may be any. */
static IrRange fit(const Inst *i, IrRange r) {
    if (i->type == TY_BOOL) return r.lo >= 0 && r.hi <= 1 ? r : (IrRange){0, 1, 0};
    if (i->type != TY_INT) return r;
    return r.lo >= INT32_MIN && r.hi <= INT32_MAX ? r : IR_RANGE_INT;
}

static IrRange constant(const Inst *i) {
    return i->op == OP_constf ? ir_range_const(i->imm.f) : ir_range_const((int32_t)i->imm.i);
}

/* The number of the iteration, which starts every body of a loop. */
static bool is_counter(const Inst *i) {
    return i->op == OP_arg && i->imm.i == 0 && i->block->owner && i->block->owner->op == OP_loop;
}
static IrRange counter(const Inst *loop) { return between(0, (double)loop->imm.loop.max_iters - 1, 0); }

/* ---- forwards, in two sweeps: the first knows nothing of what is carried around loops or kept in arrays, the second
 * uses what the first found to be assigned there, so a clamp in a loop is seen; more follow while a NaN gets farther */

typedef struct Flow {
    uint32_t n;
    IrRange *range;
    IrRange *next;  /* by id of a carried parameter or an array: what is assigned there, found by the sweep before */
    IrRange *found; /* the same, as this sweep finds it */
    const uint8_t *told;
} Flow;

static void sweep(Flow *f, const Block *b);

static void set(Flow *f, const Inst *i, IrRange r) {
    f->range[i->id] = fit(i, r);
    if (f->told && f->told[i->id]) f->range[i->id].beyond &= ~IR_NAN;
}

static void sweep_regions(Flow *f, const Inst *i) {
    for (uint32_t r = 0; r < i->nregions; r++) {
        const Block *body = i->region[r];
        for (uint32_t p = 0; p < body->nparams; p++) set(f, body->params[p], IR_RANGE_CARRIED);
        if (i->op == OP_loop) {
            f->range[body->params[0]->id] = counter(i);
            for (uint32_t p = 1; p < body->nparams; p++)
                set(f, body->params[p], join(f->range[i->args[p - 1]->id], f->next[body->params[p]->id]));
        }
        if (i->op == OP_custom)
            for (uint32_t p = 0; p < body->nparams && p < i->nargs; p++)
                f->range[body->params[p]->id] = f->range[i->args[p]->id];
        sweep(f, body);
        if (i->op == OP_loop)
            for (uint32_t p = 1; p < body->nparams; p++)
                f->found[body->params[p]->id] = f->range[body->last->args[p]->id];
    }
}

/* Of result `index` of a region; a loop yields the flag to go on first. */
static IrRange result_of(const Flow *f, const Inst *i, uint32_t region, int64_t index) {
    return f->range[i->region[region]->last->args[index + (i->op == OP_loop)]->id];
}

static void sweep(Flow *f, const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        IrRange r = IR_RANGE_FINITE;
        switch ((Op)i->op) {
        case OP_constf:
        case OP_consti:
        case OP_constb: r = constant(i); break;
        case OP_load: r = f->next[i->args[0]->id]; break;
        case OP_alloc: f->found[i->id] = ir_range_const(0); break;
        case OP_store: f->found[i->args[0]->id] = join(f->found[i->args[0]->id], f->range[i->args[2]->id]); break;
        case OP_acopy: f->found[i->args[0]->id] = join(f->found[i->args[0]->id], f->next[i->args[1]->id]); break;
        case OP_if_:
        case OP_loop:
        case OP_revloop:
        case OP_custom: sweep_regions(f, i); break;
        case OP_proj:
            r = result_of(f, i->args[0], 0, i->imm.i);
            if (i->args[0]->op == OP_if_) r = join(r, result_of(f, i->args[0], 1, i->imm.i));
            break;
        default: { /* a row: a function of its arguments */
            IrRange a[3] = {IR_RANGE_FINITE, IR_RANGE_FINITE, IR_RANGE_FINITE};
            for (uint32_t k = 0; k < i->nargs && k < 3; k++) a[k] = f->range[i->args[k]->id];
            r = ir_range_row((Op)i->op, a[0], a[1], a[2], i->nargs > 1 && i->args[0] == i->args[1]);
        }
        }
        set(f, i, r);
    }
}

enum { GROWN = IR_OVERFLOW | IR_POLE | IR_NAN };

/* Has the sweep found an infinity or a NaN where the one before did not know of any? Then the next will. */
static bool found_more(Flow *f, bool everywhere) {
    bool more = false;
    for (uint32_t k = 0; k < f->n; k++) {
        uint8_t found = everywhere ? GROWN : f->found[k].beyond & GROWN;
        if (f->found[k].beyond & IR_SQUARED) found |= IR_OVERFLOW; /* what squares itself, again and again */
        more |= found & ~f->next[k].beyond;
        f->next[k].beyond |= found;
    }
    return more;
}

void ir_ranges(const Fn *fn, Arena *scratch, const uint8_t *told, IrRange *range) {
    enum { PATIENCE = 6 }; /* sweeps until what is still on its way is believed to get anywhere */
    uint32_t n = fn->ninsts;
    Flow f = {n, range, ARENA_ARRAY(scratch, IrRange, n + 1), ARENA_ARRAY(scratch, IrRange, n + 1), told};
    for (uint32_t k = 0; k < n; k++) f.next[k] = f.found[k] = IR_RANGE_CARRIED;
    sweep(&f, fn->body);
    IrRange *first = f.found;
    f.found = f.next;
    f.next = first;
    for (uint32_t k = 0; k < n; k++) f.next[k].beyond &= ~(GROWN | IR_SQUARED); /* by bounds that were too wide */
    uint32_t sweeps = 0;
    do sweep(&f, fn->body);
    while (found_more(&f, ++sweeps == PATIENCE));
}

/* ---- backwards */

enum { MAX_DEPTH = 8 };

static IrRange range_of(const Inst *i, const IrRange *known, uint32_t nknown, uint32_t depth) {
    if (i->op == OP_consti) return constant(i);
    if (i->tag && i->tag < nknown) return known[i->tag];
    if (is_counter(i)) return counter(i->block->owner);
    if (i->type != TY_INT || depth > MAX_DEPTH || ir_ops[i->op].special) return fit(i, IR_RANGE_FINITE);
    IrRange a[3] = {IR_RANGE_FINITE, IR_RANGE_FINITE, IR_RANGE_FINITE};
    for (uint32_t k = 0; k < i->nargs; k++) a[k] = range_of(i->args[k], known, nknown, depth + 1);
    return fit(i, ir_range_row((Op)i->op, a[0], a[1], a[2], i->nargs > 1 && i->args[0] == i->args[1]));
}

IrRange ir_range_of(const Inst *i, const IrRange *known, uint32_t nknown) { return range_of(i, known, nknown, 0); }

static IrRange range_rounded(const Inst *v, uint32_t depth) {
    if (v->type != TY_FLT || depth > MAX_DEPTH || (ir_ops[v->op].special && v->op != OP_constf)) return IR_RANGE_FINITE;
    IrRange a[3] = {IR_RANGE_FINITE, IR_RANGE_FINITE, IR_RANGE_FINITE};
    for (uint32_t k = 0; k < v->nargs; k++) a[k] = range_rounded(v->args[k], depth + 1);
    IrRange r = v->op == OP_constf
                    ? ir_range_const(v->imm.f)
                    : ir_range_row((Op)v->op, a[0], a[1], a[2], v->nargs > 1 && v->args[0] == v->args[1]);
    r.lo -= fabs(r.lo) * 0x1p-23, r.hi += fabs(r.hi) * 0x1p-23; /* rounding is monotone */
    return r;
}

IrRange ir_range_rounded(const Inst *v) { return range_rounded(v, 0); }

static bool never_negative(const Inst *v, uint32_t depth) {
    switch ((Op)v->op) {
    case OP_constf: return !signbit(v->imm.f);
    case OP_fabs:
    case OP_fexp:
    case OP_fexp2:
    case OP_facos:
    case OP_fcosh: return true;
    case OP_fsqrt: return depth && never_negative(v->args[0], depth - 1);
    case OP_fmul:
        if (v->args[0] == v->args[1]) return true;
        return depth && never_negative(v->args[0], depth - 1) && never_negative(v->args[1], depth - 1);
    case OP_fadd:
    case OP_fdiv:
    case OP_fmin: return depth && never_negative(v->args[0], depth - 1) && never_negative(v->args[1], depth - 1);
    case OP_fmax: return v->args[1]->op == OP_constf && v->args[1]->imm.f > 0;
    default: return false;
    }
}

bool ir_is_never_negative(const Inst *v) {
    enum { DEPTH = 4 };
    return never_negative(v, DEPTH);
}
