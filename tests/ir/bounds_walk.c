/* All boxes of all f32 arguments, for elementary functions of one argument: target bounds-walk, some minutes.
 *
 * Where a row rises, its bound on a box is sound for every box if, along all floats in order, no value is above the
 * upper end that any later argument gives, nor below the lower end that any earlier one gives: two running maxima prove
 * it. Also tells how far the row falls where it should rise, in units of 2^-24 (f64: 2^-53) of the value: what
 * widening is for. sin, cos
 * and tan are walked in boxes of consecutive floats. f64: stretches around the borders of reductions. */
#include "compiler/back/back.h"
#include "tests/ir/bounds_pairs.h"

enum { CHUNK = 1 << 16 };

typedef struct Walk {
    Session *s;
    CompiledModule *module;
    SltKernel *kernel;
    Case c;
    uint32_t along;
    void *lo, *hi, *at, *other, *out[OUTS];
} Walk;

/* along: which of two arguments is walked; the other is a point. */
static void open_walk(Walk *w, Op op, Precision p, const char *target_name, uint32_t along) {
    *w = (Walk){.s = session_create(0), .c = {.op = op, .p = p}, .along = along};
    w->c.kind[1 - along] = POINT;
    Target target;
    target_named(&target, target_name);
    KernelRequest k = {"f", lowered(w->s, &w->c, target.has_fma, false)};
    BackOptions o = {.target = target, .no_cache = true, .opt_level = 2};
    const char *why = "";
    if (back_compile(w->s, &k, 1, &o, &w->module, &why)) fail_msg("%s", why);
    w->kernel = back_kernel(w->module, "f");
    size_t bytes = (CHUNK + SLT_PAD) * sizeof(double);
    w->lo = aligned_alloc(64, bytes), w->hi = aligned_alloc(64, bytes), w->at = aligned_alloc(64, bytes),
    w->other = aligned_alloc(64, bytes);
    for (int j = 0; j < OUTS; j++) w->out[j] = aligned_alloc(64, bytes);
}

static void close_walk(Walk *w) {
    free(w->lo), free(w->hi), free(w->at), free(w->other);
    for (int j = 0; j < OUTS; j++) free(w->out[j]);
    back_free(w->module);
    session_destroy(w->s);
}

static void evaluate(Walk *w) {
    SltKernelArgs a = {.n_valid = CHUNK};
    a.in[IN_X0 + w->along] = w->lo, a.in[IN_H0 + w->along] = w->hi, a.in[IN_SEED0 + w->along] = w->at;
    a.in[IN_SEED1 - w->along] = w->other;
    for (int j = 0; j < OUTS; j++) a.out[j] = w->out[j];
    w->kernel(&a, CHUNK);
}

/* The k-th float from -inf upwards: k = 0 is -inf. */
enum { FLOATS = 2 * 0x7f800001u - 1 };
static float float_number(uint32_t k) {
    uint32_t infinity = 0x7f800000u, bits = k <= infinity ? 0x80000000u | (infinity - k) : k - infinity - 1;
    float v;
    memcpy(&v, &bits, sizeof v);
    return v;
}

typedef struct Running {
    double most, least_end; /* of the values, of the lower ends so far */
    double drop;            /* the greatest fall of a value below an earlier one, in units of 2^-24 or 2^-53 */
    uint64_t n, bad;
} Running;

/* Values, lower and upper ends at ascending arguments of a row that rises (sign 1) or falls (-1). */
static void follow(Running *g, const Walk *w, double sign, uint32_t n) {
    bool f32 = w->c.p == PREC_F32;
    for (uint32_t k = 0; k < n; k++) {
        double v = get(w->out[OUT_VALUE], TY_FLT, w->c.p, k), lo = get(w->out[OUT_LO], TY_FLT, w->c.p, k),
               hi = get(w->out[OUT_HI], TY_FLT, w->c.p, k);
        if (isnan(v) || isnan(lo) || isnan(hi)) continue; /* nothing is known of boxes that end here */
        if (sign < 0) {
            double swap = lo;
            v = -v, lo = -hi, hi = -swap;
        }
        g->n++;
        if (v < g->most && isfinite(g->most)) {
            double drop = (g->most - v) / fmax(ldexp(fabs(g->most), f32 ? -24 : -53), f32 ? 0x1p-149 : 0x1p-1074);
            if (drop > g->drop) g->drop = drop;
        }
        if (v > g->most) g->most = v;
        if (g->most > hi || v < g->least_end) {
            if (!g->bad++)
                printf("%s at %.9g: %.9g, earlier %.9g, [%.9g, %.9g]\n", ir_ops[w->c.op].name,
                       get(w->at, TY_FLT, w->c.p, k), v, g->most, lo, hi);
        }
        if (lo > g->least_end) g->least_end = lo;
    }
}

typedef struct Rising {
    Op op;
    double sign;
    bool even; /* from 0 on */
} Rising;
static const Rising rising[] = {
    {OP_frsqrt, -1, false}, {OP_fcbrt, 1, false}, {OP_fexp, 1, false},   {OP_fexp2, 1, false}, {OP_flog, 1, false},
    {OP_flog2, 1, false},   {OP_fasin, 1, false}, {OP_facos, -1, false}, {OP_fatan, 1, false}, {OP_fsinh, 1, false},
    {OP_fcosh, 1, true},    {OP_ftanh, 1, false}, {OP_ferf, 1, false}};
enum { RISING = sizeof rising / sizeof *rising };

static const Running start = {.most = -INFINITY, .least_end = -INFINITY};

static uint64_t walk_all(const Rising *is, const char *target) {
    Walk w;
    open_walk(&w, is->op, PREC_F32, target, 0);
    Running g = start;
    uint32_t first = is->even ? 0x7f800001u : 0;
    for (uint64_t k = first; k < FLOATS; k += CHUNK) {
        for (uint32_t j = 0; j < CHUNK; j++)
            ((float *)w.at)[j] = float_number((uint32_t)(k + j < FLOATS ? k + j : FLOATS - 1));
        memcpy(w.lo, w.at, CHUNK * sizeof(float));
        memcpy(w.hi, w.at, CHUNK * sizeof(float));
        evaluate(&w);
        follow(&g, &w, is->sign, CHUNK);
    }
    printf("%-6s f32 %s: %llu values, falls by %.2f units, %llu outside\n", ir_ops[is->op].name, target,
           (unsigned long long)g.n, g.drop, (unsigned long long)g.bad);
    fflush(stdout);
    close_walk(&w);
    return g.bad;
}

static uint64_t walk_stretches(const Rising *is, const char *target) {
    Walk w;
    open_walk(&w, is->op, PREC_F64, target, 0);
    Running all = start;
    rng = 4;
    for (int stretch = 0; stretch < 400; stretch++) {
        double x = below(4) ? border() : 4 * uniform(), stride = ldexp(1, (int)below(20));
        if (!is->even && below(2)) x = -x;
        Running g = start;
        int64_t bits, from;
        memcpy(&from, &x, sizeof from);
        for (int64_t j = 0; j < CHUNK; j++) {
            bits = from + (int64_t)stride * (signbit(x) ? CHUNK / 2 - j : j - CHUNK / 2);
            memcpy((double *)w.at + j, &bits, sizeof bits);
        }
        memcpy(w.lo, w.at, CHUNK * sizeof(double));
        memcpy(w.hi, w.at, CHUNK * sizeof(double));
        evaluate(&w);
        follow(&g, &w, is->sign, CHUNK);
        all.n += g.n, all.bad += g.bad, all.drop = fmax(all.drop, g.drop);
    }
    printf("%-6s f64 %s: %llu values, falls by %.2f units, %llu outside\n", ir_ops[is->op].name, target,
           (unsigned long long)all.n, all.drop, (unsigned long long)all.bad);
    fflush(stdout);
    close_walk(&w);
    return all.bad;
}

/* pow and atan2 along one argument, the other a point: they rise or fall by its side. */
static uint64_t walk_lines(Op op, Precision p, const char *target, uint32_t along) {
    Walk w;
    open_walk(&w, op, p, target, along);
    Running all = start;
    rng = 6;
    for (int stretch = 0; stretch < 400; stretch++) {
        double x = below(2) ? 4 * uniform() : border(), y = below(3) ? 8 * uniform() - 4 : border(), sign;
        if (op == OP_fpow) sign = along == 0 ? (y < 0 ? -1 : 1) : (y = fabs(y)) < 1 ? -1 : 1;
        else sign = along == 0 ? 1 : y < 0 ? 1 : -1;
        if (op == OP_fatan2 && along == 0) y = fabs(y);
        x = round_to(p, x), y = round_to(p, y);
        if (op == OP_fpow && along == 1 && y == 1) continue;
        uint32_t stride = 1u << below(p == PREC_F32 ? 6 : 20);
        for (int64_t j = 0; j < CHUNK; j++) {
            int64_t by = (int64_t)stride * (j - CHUNK / 2), bits;
            int32_t bits32;
            double v = x;
            if (p == PREC_F32) {
                float f = (float)x;
                memcpy(&bits32, &f, sizeof f);
                bits32 += (int32_t)by;
                if (bits32 < 0) bits32 = 0;
                memcpy(&f, &bits32, sizeof f);
                v = (double)f;
            } else {
                memcpy(&bits, &v, sizeof v);
                bits += by;
                if (bits < 0) bits = 0;
                memcpy(&v, &bits, sizeof v);
            }
            put(w.at, TY_FLT, p, (uint32_t)j, v), put(w.lo, TY_FLT, p, (uint32_t)j, v),
                put(w.hi, TY_FLT, p, (uint32_t)j, v);
            put(w.other, TY_FLT, p, (uint32_t)j, y);
        }
        evaluate(&w);
        Running g = start;
        follow(&g, &w, sign, CHUNK);
        all.n += g.n, all.bad += g.bad, all.drop = fmax(all.drop, g.drop);
    }
    printf("%-6s %s %s along argument %u: %llu values, falls by %.2f units, %llu outside\n", ir_ops[op].name,
           p == PREC_F32 ? "f32" : "f64", target, along, (unsigned long long)all.n, all.drop,
           (unsigned long long)all.bad);
    fflush(stdout);
    close_walk(&w);
    return all.bad;
}

/* Boxes of `size` consecutive floats, every point of each. */
static uint64_t walk_boxes(Op op, const char *target, uint32_t size, double from, double to) {
    Walk w;
    open_walk(&w, op, PREC_F32, target, 0);
    uint64_t bad = 0, n = 0, unknown = 0;
    uint32_t k = 0x7f800001u;
    for (bool more = true; more;) {
        for (uint32_t j = 0; j < CHUNK; j++, k++) {
            ((float *)w.at)[j] = float_number(k);
            ((float *)w.lo)[j] = float_number(k - j % size);
            ((float *)w.hi)[j] = float_number(k - j % size + size - 1);
        }
        more = (double)((float *)w.at)[CHUNK - 1] < to;
        if ((double)((float *)w.at)[CHUNK - 1] < from) continue;
        evaluate(&w);
        for (uint32_t j = 0; j < CHUNK; j++, n++) {
            float lo = ((float *)w.out[OUT_LO])[j], hi = ((float *)w.out[OUT_HI])[j],
                  v = ((float *)w.out[OUT_VALUE])[j];
            if (isnan(lo) || isnan(hi)) unknown++;
            else if ((v < lo || v > hi) && !bad++)
                printf("%s(%.9g) is %.9g, not in [%.9g, %.9g]\n", ir_ops[op].name, (double)((float *)w.at)[j],
                       (double)v, (double)lo, (double)hi);
        }
    }
    printf("%-6s f32 %s: %llu points of boxes of %u floats, %.4f %% unknown, %llu outside\n", ir_ops[op].name, target,
           (unsigned long long)n, size, 100.0 * (double)unknown / (double)n, (unsigned long long)bad);
    fflush(stdout);
    close_walk(&w);
    return bad;
}

static bool asked(Op op, int argc, char **argv) { return argc < 2 || !strcmp(argv[1], ir_ops[op].name); }

/* bounds-walk [ROW] */
int main(int argc, char **argv) {
    static const char *const targets[] = {"avx2", "sse2"};
    static const Op waves[] = {OP_fsin, OP_fcos, OP_ftan}, pairs[] = {OP_fpow, OP_fatan2};
    uint64_t bad = 0;
    for (int t = 0; t < 2; t++) {
        for (uint32_t k = 0; k < 8; k++)
            if (asked(pairs[k & 1], argc, argv)) bad += walk_lines(pairs[k & 1], k >> 1 & 1, targets[t], k >> 2);
        for (int k = 0; k < RISING; k++)
            if (asked(rising[k].op, argc, argv)) bad += walk_stretches(&rising[k], targets[t]);
        for (int k = 0; k < 3; k++)
            for (uint32_t size = 16; size <= 65536 && asked(waves[k], argc, argv); size *= 64)
                bad += walk_boxes(waves[k], targets[t], size, 1e-3, 1e4);
    }
    for (int t = 0; t < 2; t++)
        for (int k = 0; k < RISING; k++)
            if (asked(rising[k].op, argc, argv)) bad += walk_all(&rising[k], targets[t]);
    return bad > 0;
}
