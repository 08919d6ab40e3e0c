/* Compiled kernels against the interpreter, bit for bit: every operation, random structured programs, every width,
 * precision and target. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>

#include "compiler/back/back.h"
#include "generate.h"
#include "saltus/kernel.h"

enum { N = 192, PAD = 192 + 64 };

typedef struct Data {
    void *in[SLT_IN_VARYING];
    double params[GEN_FLOATS], dparams[GEN_FLOATS];
    float fparams[GEN_FLOATS], fdparams[GEN_FLOATS];
    int32_t iparams[GEN_INTS];
    SltCullList cull[2];
} Data;

static const int32_t cull_items[3] = {0, 2, 3};

static uint64_t rng = 12345;
static uint32_t next_random(void) {
    rng = rng * 6364136223846793005ull + 1442695040888963407ull;
    uint32_t x = (uint32_t)(rng >> 32);
    return x ^ (x >> 13);
}

static double random_float(bool f32) {
    static const double special[] = {0.0,
                                     -0.0,
                                     1,
                                     -1,
                                     0.5,
                                     -0.5,
                                     1.5,
                                     2.5,
                                     -2.5,
                                     1e30,
                                     -1e30,
                                     2147483648.0,
                                     -2147483648.0,
                                     2147483520.0,
                                     4294967296.0,
                                     4294967040.0,
                                     8388607.5,
                                     -8388608.5,
                                     4503599627370495.5,
                                     1e-42,
                                     -1e-42,
                                     1e-310,
                                     3e9,
                                     -3e9,
                                     0.49999997,
                                     -0.99999994,
                                     255,
                                     1e300};
    uint32_t r = next_random() % 8;
    double v;
    if (r == 0) {
        uint32_t k = next_random() % (sizeof special / sizeof *special + 3);
        v = k == 0 ? (double)INFINITY : k == 1 ? -(double)INFINITY : k == 2 ? (double)NAN : special[k - 3];
    } else if (r == 1) {
        v = ldexp((double)(int32_t)next_random(), (int)(next_random() % 80) - 70);
    } else {
        v = ((double)next_random() / 4294967296.0 - 0.5) * (r < 5 ? 4 : 300);
    }
    return f32 ? (double)(float)v : v;
}

static int32_t random_int(void) {
    static const int32_t special[] = {0, 1, -1, INT32_MIN, INT32_MAX, 31, 32, 33, 2, 3, 7, -7, 65536};
    uint32_t r = next_random() % 4;
    return r == 0   ? special[next_random() % (sizeof special / sizeof *special)]
           : r == 1 ? (int32_t)next_random()
                    : (int32_t)(next_random() % 16) - 3;
}

static void make_data(Data *d, Precision p) {
    bool f32 = p == PREC_F32;
    for (int s = 0; s < SLT_IN_VARYING; s++) {
        d->in[s] = aligned_alloc(64, PAD * 8);
        bool is_int = ir_input_type((InputSlot)s) == TY_INT;
        for (int k = 0; k < PAD; k++)
            if (is_int) ((int32_t *)d->in[s])[k] = random_int();
            else if (f32) ((float *)d->in[s])[k] = (float)random_float(true);
            else ((double *)d->in[s])[k] = random_float(false);
    }
    for (int k = 0; k < GEN_FLOATS; k++) {
        d->params[k] = random_float(f32);
        d->fparams[k] = (float)d->params[k];
        d->dparams[k] = random_float(f32);
        d->fdparams[k] = (float)d->dparams[k];
    }
    for (int k = 0; k < GEN_INTS; k++) d->iparams[k] = random_int();
    d->cull[0] = (SltCullList){.items = cull_items, .count = (int32_t)(next_random() % 5) - 1};
    d->cull[1] = (SltCullList){.items = cull_items, .count = (int32_t)(next_random() % 5) - 1};
    for (int k = 0; k < 2; k++)
        if (d->cull[k].count > 3) d->cull[k].count = 0;
}

static void free_data(Data *d) {
    for (int s = 0; s < SLT_IN_VARYING; s++) free(d->in[s]);
}

typedef struct Result {
    unsigned char *out[SLT_OUT_MAX];
    uint64_t counters[SLT_COUNTERS];
    double adj[GEN_FLOATS];
    double adj_scale; /* sum of magnitudes: tolerance of the sums */
    int status;
} Result;

static void free_result(Result *r) {
    for (int j = 0; j < SLT_OUT_MAX; j++) free(r->out[j]);
}

static SltKernelArgs make_args(const Fn *fn, Data *d, Result *r, uint32_t n, uint32_t n_valid) {
    SltKernelArgs a = {.params = fn->precision == PREC_F32 ? (void *)d->fparams : d->params,
                       .iparams = d->iparams,
                       .dparams = fn->precision == PREC_F32 ? (void *)d->fdparams : d->dparams,
                       .resolution = {64, 48},
                       .site = 3,
                       .n_valid = n_valid,
                       .cull = d->cull};
    memcpy(a.in, d->in, sizeof d->in);
    (void)n;
    *r = (Result){0};
    for (uint32_t j = 0; j < ir_yield_of(fn->body)->nargs; j++) a.out[j] = r->out[j] = aligned_alloc(64, PAD * 8);
    return a;
}

static void run_interpreter(const Fn *fn, Data *d, Result *r, uint32_t n, uint32_t n_valid, uint32_t lanes) {
    SltKernelArgs a = make_args(fn, d, r, n, n_valid);
    float adj32[GEN_FLOATS] = {0};
    double adj64[GEN_FLOATS] = {0};
    a.adj = fn->precision == PREC_F32 ? (void *)adj32 : adj64;
    r->status = ir_interpret(fn, &a, n, lanes);
    memcpy(r->counters, a.counters, sizeof a.counters);
    for (int k = 0; k < GEN_FLOATS; k++) r->adj[k] = fn->precision == PREC_F32 ? (double)adj32[k] : adj64[k];
}

static void run_kernel(const Fn *fn, SltKernel *kernel, uint32_t lanes, Data *d, Result *r, uint32_t n,
                       uint32_t n_valid) {
    SltKernelArgs a = make_args(fn, d, r, n, n_valid);
    bool f32 = fn->precision == PREC_F32;
    a.adj = aligned_alloc(64, (GEN_FLOATS * lanes * 8 + 63) / 64 * 64);
    memset(a.adj, 0, GEN_FLOATS * lanes * 8);
    a.log_cap = 1 << 20;
    a.log_index = malloc((a.log_cap + SLT_PAD) * sizeof *a.log_index);
    a.log_value = malloc((a.log_cap + SLT_PAD) * sizeof(double));
    a.tape_bytes = 1 << 21;
    a.tape = aligned_alloc(64, a.tape_bytes);
    kernel(&a, n);
    memcpy(r->counters, a.counters, sizeof a.counters);
    assert_true(a.log_len <= a.log_cap);
    for (uint32_t k = 0; k < GEN_FLOATS * lanes; k++)
        r->adj[k / lanes] += f32 ? (double)((float *)a.adj)[k] : ((double *)a.adj)[k];
    for (uint64_t k = 0; k < a.log_len; k++) {
        assert_true(a.log_index[k] < GEN_FLOATS);
        r->adj[a.log_index[k]] += f32 ? (double)((float *)a.log_value)[k] : ((double *)a.log_value)[k];
    }
    free(a.adj);
    free(a.log_index);
    free(a.log_value);
    free(a.tape);
}

static bool same(const unsigned char *a, const unsigned char *b, IrType t, Precision p) {
    if (t != TY_FLT) return !memcmp(a, b, 4);
    if (p == PREC_F64) {
        double x, y;
        memcpy(&x, a, 8);
        memcpy(&y, b, 8);
        return !memcmp(a, b, 8) || (x != x && y != y);
    }
    float x, y;
    memcpy(&x, a, 4);
    memcpy(&y, b, 4);
    return !memcmp(a, b, 4) || (x != x && y != y);
}

static void print_value(const unsigned char *a, IrType t, Precision p) {
    if (t != TY_FLT) fprintf(stderr, "%d", *(const int32_t *)a);
    else if (p == PREC_F32) fprintf(stderr, "%a", (double)*(const float *)a);
    else fprintf(stderr, "%a", *(const double *)a);
}

/* True if equal; says where not. */
static bool compare(const Fn *fn, const Result *want, const Result *got, uint32_t n, bool adjoints, const char *what) {
    const Inst *y = ir_yield_of(fn->body);
    for (uint32_t j = 0; j < y->nargs; j++)
        for (uint32_t k = 0; k < n; k++) {
            IrType t = y->args[j]->type;
            size_t bytes = t == TY_FLT && fn->precision == PREC_F64 ? 8 : 4;
            if (!same(want->out[j] + k * bytes, got->out[j] + k * bytes, t, fn->precision)) {
                fprintf(stderr, "%s: output %u (%s) of sample %u: interpreter ", what, j, ir_ops[y->args[j]->op].name,
                        k);
                print_value(want->out[j] + k * bytes, t, fn->precision);
                fprintf(stderr, ", kernel ");
                print_value(got->out[j] + k * bytes, t, fn->precision);
                fprintf(stderr, "\n");
                return false;
            }
        }
    if (memcmp(want->counters, got->counters, sizeof want->counters)) {
        fprintf(stderr, "%s: counters %llu %llu %llu, kernel %llu %llu %llu\n", what,
                (unsigned long long)want->counters[0], (unsigned long long)want->counters[1],
                (unsigned long long)want->counters[2], (unsigned long long)got->counters[0],
                (unsigned long long)got->counters[1], (unsigned long long)got->counters[2]);
        return false;
    }
    for (int k = 0; adjoints && k < GEN_FLOATS; k++) { /* the summands are in [0, 1], so the sum bounds its own error */
        double tolerance = (fn->precision == PREC_F32 ? 1e-4 : 1e-12) * (1 + fabs(want->adj[k]));
        if (!(fabs(want->adj[k] - got->adj[k]) <= tolerance)) {
            fprintf(stderr, "%s: adjoint %d: %.17g, kernel %.17g\n", what, k, want->adj[k], got->adj[k]);
            return false;
        }
    }
    return true;
}

static const char *const target_names[3] = {"sse2", "avx2", "avx512"};

static bool host_runs(const char *name) {
    Target host, t;
    target_named(&host, "native");
    target_named(&t, name);
    return t.vector_bytes <= host.vector_bytes;
}

static void check(Session *s, Fn *fn, Data *d, const char *target, uint32_t width, AdjLayout layout, unsigned opt,
                  const Result *want, uint32_t n, uint32_t n_valid, const char *what) {
    BackOptions o = {.width = width, .adj = layout, .no_cache = true, .opt_level = opt};
    target_named(&o.target, target);
    KernelRequest k = {"f", fn};
    CompiledModule *m = NULL;
    const char *why = "";
    int status = back_compile(s, &k, 1, &o, &m, &why);
    if (status) fprintf(stderr, "%s: %s\n", what, why);
    assert_int_equal(status, 0);
    Result got;
    run_kernel(fn, back_kernel(m, "f"), back_adjoint_lanes(&o, fn->precision), d, &got, (n + 63) / 64 * 64, n_valid);
    char label[160];
    snprintf(label, sizeof label, "%s %s W=%u %s", what, target, width, fn->precision == PREC_F32 ? "f32" : "f64");
    bool ok = compare(fn, want, &got, n_valid < n ? n_valid : n, n_valid >= n, label);
    if (!ok && getenv("SHOW")) ir_print(fn, stderr);
    assert_true(ok);
    free_result(&got);
    back_free(m);
}

/* ---- every value row, with operands that vary, that are uniform, and constants */
static Inst *operand(Builder *b, IrType t, uint32_t slot, uint32_t kind) {
    Inst *index = ir_consti(b, (int32_t)slot);
    if (t == TY_FLT) {
        if (kind == 0) return ir_input(b, IN_X0 + slot);
        return kind == 1 ? ir_special(b, OP_param, TY_FLT, 1, &index, (Imm){.slot = {2, 9}})
                         : ir_constf(b, slot == 0 ? -2.25 : 7.5);
    }
    if (t == TY_INT) {
        if (kind == 0) return ir_input(b, IN_K0 + slot);
        return kind == 1 ? ir_special(b, OP_iparam, TY_INT, 1, &index, (Imm){.slot = {2, 5}})
                         : ir_consti(b, slot == 0 ? -77 : 10);
    }
    Inst *i = operand(b, TY_INT, slot, kind);
    return ir_emit2(b, OP_ine, ir_emit2(b, OP_iand, i, ir_consti(b, 1)), ir_consti(b, 0));
}

/* Rows whose domain is normal numbers. */
static Inst *normal(Builder *b, Inst *x) {
    Inst *m = ir_emit1(b, OP_fabs, x);
    Inst *ok =
        ir_emit2(b, OP_band, ir_emit2(b, OP_flt, ir_constf(b, 1e-30), m), ir_emit2(b, OP_flt, m, ir_constf(b, 1e30)));
    return ir_emit3(b, OP_fsel, ok, x, ir_constf(b, 1.25));
}

static Fn *rows_program(Session *s, Precision p, Op *at, uint32_t kinds, bool fma) {
    Fn *fn = ir_fn(s, &s->module, "f", p);
    fn->nfloats = GEN_FLOATS, fn->nints = GEN_INTS;
    Builder b = ir_at_end(fn, fn->body);
    Inst *out[16];
    uint32_t n = 0;
    for (; *at < OP_COUNT && n < 16; (*at)++) {
        const OpInfo *o = &ir_ops[*at];
        if (o->special || o->math || (*at == OP_ffma && !fma)) continue;
        Inst *args[3];
        for (uint32_t j = 0; j < o->nargs; j++) {
            bool select = o->selects;
            args[j] = operand(&b, select && j == 0 ? TY_BOOL : (IrType)o->arg, j, (kinds >> (2 * j)) & 3);
        }
        if (*at == OP_fmant || *at == OP_fexpo) args[0] = normal(&b, args[0]);
        if (*at == OP_ftwoi)
            args[0] = ir_emit2(&b, OP_isub, ir_emit2(&b, OP_iand, args[0], ir_consti(&b, 127)), ir_consti(&b, 60));
        if (*at == OP_fasuint || *at == OP_flogm) /* the bits of a NaN are nobody's promise */
            args[0] = ir_emit3(&b, OP_fsel, ir_emit1(&b, OP_fisnan, args[0]), ir_constf(&b, 1), args[0]);
        out[n++] = ir_emit(&b, *at, o->nargs, args);
    }
    ir_yield(&b, n, out);
    return fn;
}

static void test_rows(void **state) {
    (void)state;
    static const uint32_t kinds[] = {0, 1, 4, 16, 21, 8, 2};
    Session *s = session_create(0);
    for (int p = 0; p < 2; p++)
        for (uint32_t c = 0; c < sizeof kinds / sizeof *kinds; c++)
            for (int t = 0; t < 3; t++) {
                if (!host_runs(target_names[t])) continue;
                for (Op at = 0; at < OP_COUNT;) {
                    Fn *fn = rows_program(s, (Precision)p, &at, kinds[c], true);
                    if (!ir_yield_of(fn->body)->nargs) continue;
                    Data d;
                    make_data(&d, fn->precision);
                    Result want;
                    run_interpreter(fn, &d, &want, N, N, 16);
                    assert_int_equal(want.status, 0);
                    static const uint32_t widths[] = {1, 8, 32, 2, 16, 4, 64};
                    uint32_t w = widths[(c + (uint32_t)t) % 7];
                    check(s, fn, &d, target_names[t], w, ADJ_LANES, 2, &want, N, N, "rows");
                    if (c == 0) check(s, fn, &d, target_names[t], t == 2 ? 32 : 16, ADJ_LANES, 2, &want, N, N, "rows");
                    free_result(&want);
                    free_data(&d);
                }
            }
    session_destroy(s);
}

/* Integers whose NaN nothing shows (emit_nan.c), beside some whose NaN shows: behind a comparison, in a branch, alone,
 * and beside a sum that is no NaN where the argument is. */
static Fn *noise_program(Session *s, Precision p) {
    Fn *fn = ir_fn(s, &s->module, "f", p);
    Builder b = ir_at_end(fn, fn->body);
    Inst *out[5], *two = ir_constf(&b, 2), *seven = ir_consti(&b, 7);
    for (uint32_t k = 0; k < 5; k++) {
        Inst *x = ir_emit2(&b, OP_fmul, ir_input(&b, (InputSlot)(IN_X0 + k % 2)), ir_constf(&b, k + 1));
        Inst *whole = ir_emit1(&b, OP_ffloor, x), *f = ir_emit2(&b, OP_fsub, x, whole);
        Inst *i = ir_emit1(&b, OP_f2i, whole);
        Inst *next = ir_emit1(&b, OP_i2f, ir_emit2(&b, OP_imul, ir_emit2(&b, OP_iadd, i, ir_consti(&b, 1)), seven));
        Inst *here = ir_emit1(&b, OP_i2f, ir_emit2(&b, OP_imul, i, seven));
        Inst *v = ir_emit3(&b, OP_ffma, f, ir_emit2(&b, OP_fsub, next, here), here);
        if (k == 1) v = ir_emit3(&b, OP_fsel, ir_emit2(&b, OP_flt, here, two), v, two);
        if (k == 2) v = ir_emit2(&b, OP_fmin, two, v);
        if (k == 3) v = ir_emit2(&b, OP_fadd, v, ir_emit2(&b, OP_fmax, two, here)), v = ir_emit2(&b, OP_fmin, here, v);
        if (k == 4) v = ir_emit2(&b, OP_fmul, here, two);
        out[k] = v;
    }
    ir_yield(&b, 5, out);
    return fn;
}

static void test_hidden_integers(void **state) {
    (void)state;
    Session *s = session_create(0);
    for (int p = 0; p < 2; p++)
        for (int t = 0; t < 3; t++) {
            if (!host_runs(target_names[t])) continue;
            Fn *fn = noise_program(s, (Precision)p);
            Data d;
            make_data(&d, fn->precision);
            const double odd[] = {NAN, INFINITY, -INFINITY, 3e9, -3e9, 2147483648.0, -0.0};
            for (int k = 0; k < 14; k++)
                if (p == PREC_F32) ((float *)d.in[IN_X0 + k % 2])[3 * k] = (float)odd[k / 2];
                else ((double *)d.in[IN_X0 + k % 2])[3 * k] = odd[k / 2];
            Result want;
            run_interpreter(fn, &d, &want, N, N, 16);
            for (uint32_t w = 1; w <= 64; w *= 4)
                check(s, fn, &d, target_names[t], w, ADJ_LANES, 2, &want, N, N, "noise");
            free_result(&want);
            free_data(&d);
        }
    session_destroy(s);
}

/* ---- random programs */
static void one_program(Session *s, uint64_t seed, uint32_t size) {
    rng = seed * 77 + 5;
    Precision p = seed & 1 ? PREC_F64 : PREC_F32;
    bool pairs = seed % 5 == 0;
    Fn *fn = gen_wild(s, seed, p, size, seed % 4 == 3, pairs);
    const char *text = "";
    if (!ir_verify(fn, &s->module, &text)) {
        fprintf(stderr, "seed %llu: %s\n", (unsigned long long)seed, text);
        fail();
    }
    Data d;
    make_data(&d, p);
    /* with padding, callers give zero seeds there; these programs have none, so adjoints are compared where nothing is
     * padded */
    uint32_t n_valid = seed % 3 ? 128 : 64 + (uint32_t)seed % 65;
    for (int t = 0; t < 3; t++) {
        if (!host_runs(target_names[t])) continue;
        uint32_t width = 1u << ((seed + 3 * (uint64_t)t + seed / 7) % 7);
        if (pairs && width == 1) width = 2;
        Result want;
        run_interpreter(fn, &d, &want, 128, n_valid, width);
        assert_int_equal(want.status, 0);
        char what[64];
        snprintf(what, sizeof what, "seed %llu", (unsigned long long)seed);
        check(s, fn, &d, target_names[t], width, seed & 2 ? ADJ_FLAT : ADJ_LANES, 2, &want, 128, n_valid, what);
        free_result(&want);
    }
    free_data(&d);
}

static void test_random_programs(void **state) {
    (void)state;
    uint64_t first = getenv("SEED") ? strtoull(getenv("SEED"), NULL, 10) : 1,
             count = getenv("COUNT") ? strtoull(getenv("COUNT"), NULL, 10) : 40;
    for (uint64_t k = 0; k < count; k++) {
        Session *s = session_create(0);
        one_program(s, first + k, 20 + (uint32_t)(k % 9) * 15);
        session_destroy(s);
    }
}

/* ---- shapes that random programs meet too rarely */
static Inst *flt_param(Builder *b, Inst *index, uint32_t base, uint32_t count) {
    return ir_special(b, OP_param, TY_FLT, 1, &index, (Imm){.slot = {base, count}});
}

/* A uniform value stored at a uniform place, but only by some lanes; then the array copied, by other lanes, over
 * another. */
static Fn *array_shapes(Session *s) {
    Fn *fn = ir_fn(s, &s->module, "f", PREC_F32);
    fn->nfloats = GEN_FLOATS, fn->nints = GEN_INTS;
    Builder b = ir_at_end(fn, fn->body);
    Inst *x = ir_input(&b, IN_X0), *zero = ir_consti(&b, 0), *one = ir_consti(&b, 1);
    Inst *a = ir_special(&b, OP_alloc, TY_ARRAY, 0, NULL, (Imm){.arr = {3, TY_FLT}}),
         *c = ir_special(&b, OP_alloc, TY_ARRAY, 0, NULL, (Imm){.arr = {3, TY_FLT}});
    Inst *base[3] = {c, one, ir_constf(&b, 9)};
    ir_special(&b, OP_store, TY_VOID, 3, base, (Imm){0});
    Inst *side = ir_if(&b, ir_emit2(&b, OP_flt, x, ir_constf(&b, 0.25)));
    Builder t = ir_at_end(fn, side->region[0]), e = ir_at_end(fn, side->region[1]);
    Inst *store[3] = {a, one, ir_constf(&t, 5)}, *copy[2] = {c, a};
    ir_special(&t, OP_store, TY_VOID, 3, store, (Imm){0});
    ir_yield(&t, 0, NULL);
    ir_special(&e, OP_acopy, TY_VOID, 2, copy, (Imm){0});
    ir_yield(&e, 0, NULL);
    Inst *outs[4];
    for (int k = 0; k < 4; k++) {
        Inst *load[2] = {k & 1 ? a : c, k & 2 ? zero : one};
        outs[k] = ir_special(&b, OP_load, TY_FLT, 2, load, (Imm){0});
    }
    ir_yield(&b, 4, outs);
    return fn;
}

/* Parameters read at the edge of their range by the number of the iteration. */
static Fn *range_shapes(Session *s) {
    Fn *fn = ir_fn(s, &s->module, "f", PREC_F32);
    fn->nfloats = GEN_FLOATS, fn->nints = GEN_INTS;
    Builder b = ir_at_end(fn, fn->body);
    Inst *init[2] = {ir_input(&b, IN_X0), ir_constf(&b, 0)};
    Inst *loop = ir_loop(&b, 2, init, (LoopInfo){.max_iters = 5, .exact = true});
    Block *body = loop->region[0];
    Builder t = ir_at_end(fn, body);
    Inst *k = body->params[0],
         *twice = ir_emit2(&t, OP_iadd, ir_emit2(&t, OP_imul, k, ir_consti(&t, 2)), ir_consti(&t, -1));
    Inst *sum = body->params[2];
    static const uint32_t counts[3] = {4, 5, 6};
    for (int j = 0; j < 3; j++)
        sum = ir_emit2(&t, OP_fadd, sum,
                       ir_emit2(&t, OP_fadd, flt_param(&t, k, 3, counts[j]), flt_param(&t, twice, 2, counts[j] + 2)));
    Inst *y[3] = {ir_emit2(&t, OP_ilt, k, ir_consti(&t, 4)), ir_emit2(&t, OP_fadd, body->params[1], sum), sum};
    ir_yield(&t, 3, y);
    Inst *outs[2] = {ir_proj(&b, loop, 0), ir_proj(&b, loop, 1)};
    ir_yield(&b, 2, outs);
    return fn;
}

static void test_shapes(void **state) {
    (void)state;
    Session *s = session_create(0);
    Fn *fns[2] = {array_shapes(s), range_shapes(s)};
    static const char *const what[2] = {"arrays", "ranges"};
    for (int f = 0; f < 2; f++) {
        Data d;
        make_data(&d, PREC_F32);
        for (int k = 0; k < GEN_FLOATS; k++) d.fparams[k] = (float)(k * k);
        for (int k = 0; k < PAD; k++) /* all of a vector on, all off, mixed */
            ((float *)d.in[IN_X0])[k] = k < 64 ? 0 : k < 128 ? 1 : (float)(k % 3) / 2;
        for (int t = 0; t < 3; t++)
            for (uint32_t w = 1; w <= 64 && host_runs(target_names[t]); w *= 2) {
                Result want;
                run_interpreter(fns[f], &d, &want, N, N, w);
                check(s, fns[f], &d, target_names[t], w, ADJ_LANES, 2, &want, N, N, what[f]);
                free_result(&want);
            }
        free_data(&d);
    }
    session_destroy(s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_rows),
        cmocka_unit_test(test_hidden_integers),
        cmocka_unit_test(test_shapes),
        cmocka_unit_test(test_random_programs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
