/* Value rows on boxes: samples, that is (box, point) pairs, and what a point must not do to its box. One Fn holds a row
 * on a box and on a point of it; the pipeline lowers both as it does for kernels. */
#ifndef SALTUS_TESTS_BOUNDS_PAIRS_H
#define SALTUS_TESTS_BOUNDS_PAIRS_H

#include <float.h>

#include "compiler/ir/bounds_rules.h"
#include "tests/ir/ir_test.h"

enum { N = 4096, WIDTH = 16 };

/* ---- samples */

static uint64_t rng;
static inline uint64_t next_random(void) {
    uint64_t z = rng += 0x9e3779b97f4a7c15u;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}
static inline uint32_t below(uint32_t n) { return (uint32_t)((next_random() >> 32) * n >> 32); }
static inline double uniform(void) { return (double)(next_random() >> 11) * 0x1p-53; }

static const double float_edges[] = {
    0,
    0,
    0x1p-149,
    0x1p-130,
    0x1p-126,
    0x1.8p-126,
    0x1p-1074,
    0x1p-1030,
    0x1p-1022,
    0.25,
    0.5,
    1,
    1.5,
    2,
    3,
    1e-10,
    1e-30,
    100,
    88.5,
    88.72,
    87.3,
    127.9,
    126,
    709.7,
    708,
    1023.5,
    1e5,
    99999,
    1000,
    1001,
    1e8,
    1e30,
    3.4028234e38,
    1e300,
    DBL_MAX,
    INFINITY,
    INFINITY,
    8388607.5,
    2147483520.0,
    0x1p31,
    4294967040.0,
    0x1p32,
    0.78539816339744828,
    1.5707963267948966,
    3.1415926535897931,
    4.71238898038469,
    6.2831853071795862,
    314.15926535897933,
    0.70710678118654757,
    1.4142135623730951,
    0.625,
    0.55,
    0.875,
    6,
    4,
};
static const int32_t int_edges[] = {0,        1,  2,  3,  5,   7,     8,     15,         16,         31,
                                    32,       33, 63, 64, 255, 65535, 65536, 0x3fffffff, 0x40000000, INT32_MAX - 1,
                                    INT32_MAX};

static inline double round_to(Precision p, double v) { return p == PREC_F32 ? (double)(float)v : v; }
static inline double step(Precision p, double v, double to) {
    return p == PREC_F32 ? (double)nextafterf((float)v, (float)to) : nextafter(v, to);
}
static inline double float_of_bits(Precision p) {
    uint64_t bits = next_random();
    uint32_t half = (uint32_t)bits;
    float f;
    double d;
    memcpy(&f, &half, sizeof f);
    memcpy(&d, &bits, sizeof d);
    return p == PREC_F32 ? (double)f : d;
}

/* Where the interesting arguments of a row are. */
typedef enum Domain { ANY, SMALL, UNIT, NORMAL, EXPONENT, COUNT } Domain;

/* Where the reductions of elementary functions change from one piece to the next: there their errors show. */
static inline double border(void) {
    static const double pieces[] = {0.5, 1, 0.41421356237309503, 0.625, 0.55, 0.875, 0.25, 2, 1.4142135623730951};
    enum { PIECES = sizeof pieces / sizeof *pieces };
    double whole = floor(ldexp(uniform(), (int)below(10)));
    switch (below(5)) {
    case 4: return ldexp(1 + uniform(), 22 + (int)below(5)); /* reductions of angles give up */
    case 0: return pieces[below(PIECES)];
    case 1: return (whole + 0.5) * (below(2) ? 0.69314718055994531 : 0.34657359027997264);
    case 2: return ldexp(below(2) ? 0.70710678118654757 : 1, (int)below(200) - 100);
    default: return whole + 0.5;
    }
}

static inline double random_float(Precision p, Domain d) {
    enum { EDGES = sizeof float_edges / sizeof *float_edges };
    double v;
    uint32_t r = below(16);
    if (d == UNIT && r < 8) v = uniform() < 0.5 ? uniform() : 1 - ldexp(uniform(), -(int)below(24));
    else if (r < 4) v = float_edges[below(EDGES)];
    else if (r < 6) v = float_of_bits(p);
    else if (r < 8) v = ldexp(uniform(), (int)below(40) - 20);
    else if (r < 9) v = floor(uniform() * 40) * 0.5;
    else if (r < 10)
        v = floor(ldexp(uniform(), (int)below(26))) * (below(2) ? 1.5707963267948966 : 0.78539816339744831);
    else if (r < 12) v = border();
    else v = uniform() * (r < 14 ? 4 : 100);
    v = round_to(p, below(2) ? v : -v);
    if (d == NORMAL && !(fabs(v) >= (p == PREC_F32 ? FLT_MIN : DBL_MIN) && isfinite(v))) v = round_to(p, 1 + uniform());
    return v;
}

typedef struct Sample {
    double lo, hi, v;
} Sample;

/* An end of the box on the side of `to`. */
static inline double end(Precision p, Domain d, double v, double to) {
    double e = v;
    uint32_t r = below(10);
    if (r < 2) return v;
    if (r < 5) {
        for (uint32_t k = 1 + below(r == 4 ? 40 : 3); k > 0; k--) e = step(p, e, to);
    } else if (r < 9) {
        double other =
            r < 7 ? v + (fabs(v) + 1e-3) * ldexp(uniform(), -(int)below(25)) * (to > 0 ? 1 : -1) : random_float(p, d);
        e = round_to(p, other);
        if (!(to > 0 ? e >= v : e <= v)) e = v;
    } else {
        e = to;
    }
    if (d == NORMAL && !(e * v > 0 && isfinite(e))) e = v;
    return e;
}

static inline Sample float_sample(Precision p, Domain d, bool point) {
    Sample s = {.v = d == NORMAL || below(40) ? random_float(p, d) : (double)NAN};
    s.lo = s.hi = s.v;
    if (point) return s;
    if (isnan(s.v) || !below(40)) {
        uint32_t r = below(4);
        s.lo = r & 1 ? NAN : isnan(s.v) || r < 2 ? -INFINITY : s.v;
        s.hi = r >= 2 ? NAN : isnan(s.v) || r == 1 ? INFINITY : INFINITY;
        if (r == 1) s.hi = isnan(s.v) ? 1 : -INFINITY; /* one NaN makes the other say nothing */
        return s;
    }
    s.lo = end(p, d, s.v, -INFINITY);
    s.hi = end(p, d, s.v, INFINITY);
    if (s.lo == 0 && below(2)) s.lo = -s.lo; /* a zero end stands for both */
    if (s.hi == 0 && below(2)) s.hi = -s.hi;
    return s;
}

static inline Sample int_sample(Precision p, Domain d, bool point) {
    enum { INTS = sizeof int_edges / sizeof *int_edges };
    int64_t v, lo, hi;
    if (d == EXPONENT) v = (int64_t)below(p == PREC_F32 ? 254 : 2046) - (p == PREC_F32 ? 126 : 1022);
    else if (d == COUNT && below(4)) v = below(40);
    else if (below(2)) v = int_edges[below(INTS)] * (int64_t)(below(2) ? 1 : -1) - (int64_t)below(2);
    else v = below(2) ? (int32_t)next_random() : (int64_t)below(200) - 100;
    if (v < INT32_MIN) v = INT32_MIN;
    lo = hi = v;
    if (!point) {
        lo = below(4) ? v - (int64_t)ldexp(uniform(), (int)below(33)) : v;
        hi = below(4) ? v + (int64_t)ldexp(uniform(), (int)below(33)) : v;
    }
    if (d == EXPONENT) {
        int64_t least = p == PREC_F32 ? -126 : -1022, most = 1 - least;
        lo = lo < least ? least : lo, hi = hi > most ? most : hi;
    }
    return (Sample){(double)(lo < INT32_MIN ? INT32_MIN : lo), (double)(hi > INT32_MAX ? INT32_MAX : hi), (double)v};
}

static inline Sample bool_sample(bool point) {
    uint32_t v = below(2), open = below(2) && !point;
    return (Sample){open ? 0 : v, open ? 1 : v, v};
}

/* ---- a row on a box */

typedef enum Kind { BOX, POINT, CONSTANT } Kind;
typedef struct Case {
    Op op;
    Precision p;
    Kind kind[3];
    double constant;
    bool same;      /* the first two arguments are one value */
    bool magnitude; /* the first is |what the pair holds| */
} Case;

static inline IrType type_of(Op op, uint32_t k) {
    return ir_ops[op].selects && k == 0 ? TY_BOOL : (IrType)ir_ops[op].arg;
}

static inline Domain domain_of(Op op, uint32_t k) {
    switch (op) {
    case OP_fasin:
    case OP_facos: return UNIT;
    case OP_fmant:
    case OP_fexpo: return NORMAL;
    case OP_ftwoi: return EXPONENT;
    case OP_ishl:
    case OP_ishr:
    case OP_ushr: return k ? COUNT : ANY;
    default: return ANY;
    }
}

/* The inputs of argument k: near end, far end, point. */
static inline InputSlot slot_of(IrType t, uint32_t k, uint32_t part) {
    static const InputSlot flt[3] = {IN_X0, IN_H0, IN_SEED0}, ints[3] = {IN_K0, IN_K3, IN_SAMPLE};
    return t == TY_FLT ? flt[part] + k : part < 2 ? ints[part] + k : k < 2 ? IN_K6 + k : IN_SAMPLE;
}

static inline Inst *argument(Builder *b, IrType t, uint32_t k, uint32_t part) {
    Inst *i = ir_input(b, slot_of(t, k, part));
    return t == TY_BOOL ? ir_emit2(b, OP_ine, i, ir_consti(b, 0)) : i;
}

enum { OUT_LO, OUT_HI, OUT_VALUE, OUT_JUMPS, OUT_BENDS, OUTS };

static inline Fn *row_fn(Session *s, const Case *c, bool events) {
    Fn *fn = ir_fn(s, &s->module, "f", c->p);
    Builder b = ir_at_end(fn, fn->body);
    const OpInfo *o = &ir_ops[c->op];
    Bound a[3];
    Inst *v[3];
    for (uint32_t k = 0; k < o->nargs; k++) {
        IrType t = type_of(c->op, k);
        uint32_t from = c->same && k == 1 ? 0 : k;
        if (c->kind[k] == CONSTANT) {
            v[k] = t == TY_FLT   ? ir_constf(&b, c->constant)
                   : t == TY_INT ? ir_consti(&b, (int32_t)c->constant)
                                 : ir_constb(&b, c->constant > 0);
            a[k] = ir_bound_point(v[k]);
        } else {
            v[k] = argument(&b, t, from, 2);
            a[k] = c->kind[k] == POINT ? ir_bound_point(v[k])
                                       : (Bound){argument(&b, t, from, 0), argument(&b, t, from, 1)};
        }
    }
    if (c->same) a[1] = a[0], v[1] = v[0];
    if (c->magnitude) a[0] = ir_bound_row(&b, OP_fabs, a, 1, 0), v[0] = ir_emit1(&b, OP_fabs, v[0]);
    uint32_t known = (c->same ? BOUND_SAME : 0) | (c->magnitude ? BOUND_NO_MINUS_0 : 0);
    Bound r = ir_bound_row(&b, c->op, a, o->nargs, known);
    BoundEvents e = {0};
    if (events) e = ir_bound_events(&b, c->op, a, o->nargs, known);
    Inst *no = ir_constb(&b, false);
    Inst *out[OUTS] = {r.lo, r.hi, ir_emit(&b, c->op, o->nargs, v), e.jumps ? e.jumps : no, e.bends ? e.bends : no};
    ir_yield(&b, OUTS, out);
    return fn;
}

typedef struct Data {
    void *in[SLT_IN_VARYING];
    void *out[2][OUTS]; /* of the interpreter, of the kernel */
    Sample sample[3][N];
} Data;

static inline Data *make_data(void) {
    Data *d = calloc(1, sizeof *d);
    for (int s = 0; s < SLT_IN_VARYING; s++)
        d->in[s] = aligned_alloc(64, (N + SLT_PAD) * 8), memset(d->in[s], 0, (N + SLT_PAD) * 8);
    for (int j = 0; j < OUTS; j++)
        for (int w = 0; w < 2; w++) d->out[w][j] = aligned_alloc(64, (N + SLT_PAD) * 8);
    return d;
}

static inline void free_data(Data *d) {
    for (int s = 0; s < SLT_IN_VARYING; s++) free(d->in[s]);
    for (int j = 0; j < OUTS; j++) free(d->out[0][j]), free(d->out[1][j]);
    free(d);
}

static inline void put(void *to, IrType t, Precision p, uint32_t n, double v) {
    if (t != TY_FLT) ((int32_t *)to)[n] = (int32_t)v;
    else if (p == PREC_F32) ((float *)to)[n] = (float)v;
    else ((double *)to)[n] = v;
}

static inline double get(const void *from, IrType t, Precision p, uint32_t n) {
    return t != TY_FLT     ? ((const int32_t *)from)[n]
           : p == PREC_F32 ? (double)((const float *)from)[n]
                           : ((const double *)from)[n];
}

static inline void fill(Data *d, const Case *c) {
    for (uint32_t k = 0; k < ir_ops[c->op].nargs; k++) {
        IrType t = type_of(c->op, k);
        for (uint32_t n = 0; n < N; n++) {
            bool point = c->kind[k] == POINT;
            Sample s = t == TY_FLT   ? float_sample(c->p, domain_of(c->op, k), point)
                       : t == TY_INT ? int_sample(c->p, domain_of(c->op, k), point)
                                     : bool_sample(point);
            if (c->kind[k] == CONSTANT) s.lo = s.hi = s.v = c->constant;
            if (c->same && k == 1) s = d->sample[0][n];
            /* the bits of a NaN are nobody's promise */
            if ((c->op == OP_fasuint || c->op == OP_flogm) && isnan(s.v)) s = (Sample){1, 1, 1};
            d->sample[k][n] = s;
            if (c->same && k == 1) continue;
            put(d->in[slot_of(t, k, 0)], t, c->p, n, s.lo);
            put(d->in[slot_of(t, k, 1)], t, c->p, n, s.hi);
            put(d->in[slot_of(t, k, 2)], t, c->p, n, s.v);
        }
    }
}

/* How many of n samples contradict; what is told of the first. */
static inline uint32_t contradictions(const Data *d, const Case *c, uint32_t from, uint32_t n, bool tell) {
    IrType t = (IrType)ir_ops[c->op].result;
    uint32_t bad = 0;
    for (uint32_t k = 0; k < n; k++) {
        double lo = get(d->out[from][OUT_LO], t, c->p, k), hi = get(d->out[from][OUT_HI], t, c->p, k),
               v = get(d->out[from][OUT_VALUE], t, c->p, k);
        bool ok;
        if (t == TY_FLT && (isnan(lo) || isnan(hi))) ok = true;
        else if (t == TY_FLT && isnan(v)) ok = lo == -INFINITY && hi == INFINITY;
        else if (t == TY_BOOL) ok = v ? hi : !lo;
        else ok = lo <= v && v <= hi;
        if (ok) continue;
        if (!bad++ && tell) {
            printf("%s %s: %.17g is not in [%.17g, %.17g] at", ir_ops[c->op].name, c->p == PREC_F32 ? "f32" : "f64", v,
                   lo, hi);
            for (uint32_t j = 0; j < ir_ops[c->op].nargs; j++)
                printf(" %.17g of [%.17g, %.17g]%s", d->sample[j][k].v, d->sample[j][k].lo, d->sample[j][k].hi,
                       c->kind[j] == CONSTANT ? " constant"
                       : c->kind[j] == POINT  ? " point"
                                              : "");
            printf("%s\n", c->same ? " (the same)" : c->magnitude ? " (of a magnitude)" : "");
        }
    }
    return bad;
}

static inline SltKernelArgs args_of(Data *d, int which, uint32_t n) {
    SltKernelArgs a = {.n_valid = n};
    memcpy(a.in, d->in, sizeof a.in);
    for (int j = 0; j < OUTS; j++) a.out[j] = d->out[which][j];
    return a;
}

static inline Fn *lowered(Session *s, const Case *c, bool fma, bool events) {
    Fn *fn = row_fn(s, c, events);
    PassCtx ctx = {.session = s, .has_fma = fma};
    pipeline_kernel(&ctx, fn);
    check_sound(fn);
    return fn;
}

/* ---- the cases: every row, its arguments boxes, points, constants, or one value */

typedef bool Check(const Case *c, void *user);

static const double constants[] = {0, 1, -1, 2, -3, 0.5, -2.5, 7, 1e30, INFINITY, NAN};

static inline uint32_t each_case(Check *check, void *user) {
    uint32_t bad = 0;
    for (int op = 0; op < OP_COUNT; op++) {
        const OpInfo *o = &ir_ops[op];
        if (o->special || (getenv("ROW") && strcmp(getenv("ROW"), o->name))) continue;
        for (int p = PREC_F32; p <= PREC_F64; p++) {
            Case c = {.op = (Op)op, .p = (Precision)p};
            bad += !check(&c, user);
            for (uint32_t k = 0; k < o->nargs && o->nargs > 1; k++) {
                Case one = c;
                one.kind[k] = POINT;
                bad += !check(&one, user);
                one.kind[k] = CONSTANT;
                for (size_t j = 0; j < sizeof constants / sizeof *constants; j++) {
                    one.constant = constants[j];
                    bool is_float = type_of((Op)op, k) == TY_FLT;
                    if (!is_float && (one.constant != floor(one.constant) || fabs(one.constant) > 1e9)) continue;
                    if ((j + (uint32_t)op) % 3 && !o->math) bad += !check(&one, user);
                }
            }
            if (o->nargs > 1 && !o->selects) {
                c.same = true;
                bad += !check(&c, user);
                c.same = false, c.magnitude = (IrType)o->arg == TY_FLT;
                if (c.magnitude) bad += !check(&c, user);
            }
        }
    }
    return bad;
}

/* How many times N pairs a case gets. */
static inline uint32_t rounds(uint32_t few) { return getenv("ROUNDS") ? (uint32_t)atoi(getenv("ROUNDS")) : few; }

/* The pairs of each case. */
typedef struct Run {
    Session *s;
    Data *d;
    uint64_t pairs;
    uint32_t rounds;
} Run;

#endif
