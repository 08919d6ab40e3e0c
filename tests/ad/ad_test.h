/* What the tests of automatic differentiation share: a small language for writing IR, and the oracles.
 *
 *   Prog p = prog_begin(s, PREC_F64, nfloats);  Inst *x = input_x(&p, 0);  ...  prog_end(&p, 1, &out);
 *
 * check_ad compares: lanes together with lanes alone (values, adjoints), <w, Jv> with <J'w, v>, Jv with central
 * differences, all in f64 by the interpreter; and the same again after the clean-up passes that kernels get. */
#ifndef SALTUS_TESTS_AD_TEST_H
#define SALTUS_TESTS_AD_TEST_H

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "compiler/pass/ad.h"
#include "saltus/kernel.h"
#include "saltus/status.h"

enum { MAX_FLOATS = 2048, LANES = 8, MAX_OUT = 12 };

/* ---- building */

typedef struct Prog {
    Session *s;
    Fn *fn;
    Builder b;
    struct Open {
        Inst *inst;
        Builder outer;
    } open[16];
    int depth;
} Prog;

static inline Prog prog_begin(Session *s, Precision precision, uint32_t nfloats) {
    Prog p = {.s = s, .fn = ir_fn(s, &s->module, "f", precision)};
    p.fn->nfloats = nfloats;
    p.fn->dim = 2;
    p.b = ir_at_end(p.fn, p.fn->body);
    return p;
}
static inline void prog_end(Prog *p, uint32_t n, Inst *const *out) {
    ir_yield(&p->b, n, out);
    p->fn->channels = n;
    ir_name_outputs(p->fn, SLT_OUT_F);
}
static inline Inst *cf(Prog *p, double v) { return ir_constf(&p->b, v); }
static inline Inst *ci(Prog *p, int32_t v) { return ir_consti(&p->b, v); }
static inline Inst *input_x(Prog *p, int d) { return ir_input(&p->b, (InputSlot)(IN_X0 + d)); }
static inline Inst *par_at(Prog *p, uint32_t base, uint32_t count, Inst *index) {
    Imm m = {0};
    m.slot.base = base;
    m.slot.count = count;
    return ir_special(&p->b, OP_param, TY_FLT, 1, &index, m);
}
static inline Inst *par(Prog *p, uint32_t i) { return par_at(p, i, 1, ci(p, 0)); }
#define DEF1(name, op) static inline Inst *name(Prog *p, Inst *x) { return ir_emit1(&p->b, OP_##op, x); }
#define DEF2(name, op) static inline Inst *name(Prog *p, Inst *x, Inst *y) { return ir_emit2(&p->b, OP_##op, x, y); }
// clang-format off
DEF2(add, fadd) DEF2(sub, fsub) DEF2(mul, fmul) DEF2(dvd, fdiv) DEF2(mn, fmin)
DEF2(mx, fmax) DEF2(lt, flt) DEF1(neg, fneg) DEF1(root, fsqrt) DEF1(sine, fsin)
DEF1(expo, fexp) DEF1(tanh_, ftanh) DEF1(i2f_, i2f) DEF2(iadd_, iadd) DEF2(imul_, imul)
DEF2(ilt_, ilt) DEF2(band_, band)
    // clang-format on
    static inline Inst *sel(Prog *p, Inst *c, Inst *x, Inst *y) {
    return ir_select(&p->b, c, x, y);
}

static inline void if_begin(Prog *p, Inst *cond) {
    Inst *i = ir_if(&p->b, cond);
    p->open[p->depth++] = (struct Open){i, p->b};
    p->b = ir_at_end(p->fn, i->region[0]);
}
static inline void if_else(Prog *p, uint32_t n, Inst *const *values) {
    ir_yield(&p->b, n, values);
    p->b = ir_at_end(p->fn, p->open[p->depth - 1].inst->region[1]);
}
static inline void if_end(Prog *p, uint32_t n, Inst *const *values, Inst **results) {
    ir_yield(&p->b, n, values);
    struct Open o = p->open[--p->depth];
    p->b = o.outer;
    for (uint32_t r = 0; r < n; r++) results[r] = ir_proj(&p->b, o.inst, r);
}
/* k and the carried parameters are o->inst->region[0]->params. */
static inline Inst **loop_begin(Prog *p, uint32_t max, bool exact, uint32_t n, Inst *const *init) {
    Inst *i = ir_loop(&p->b, n, init, (LoopInfo){.max_iters = max, .exact = exact});
    p->open[p->depth++] = (struct Open){i, p->b};
    p->b = ir_at_end(p->fn, i->region[0]);
    return i->region[0]->params;
}
/* Goes on while k + 1 < max and `go` (may be NULL). */
static inline void loop_end(Prog *p, Inst *go, uint32_t n, Inst *const *next, Inst **results) {
    struct Open o = p->open[--p->depth];
    Inst *on = ilt_(p, o.inst->region[0]->params[0], ci(p, (int32_t)o.inst->imm.loop.max_iters - 1));
    Inst *args[16] = {go ? band_(p, on, go) : on};
    for (uint32_t r = 0; r < n; r++) args[r + 1] = next[r];
    ir_yield(&p->b, n + 1, args);
    p->b = o.outer;
    for (uint32_t r = 0; r < n; r++) results[r] = ir_proj(&p->b, o.inst, r);
}
static inline Inst *array(Prog *p, uint32_t n) {
    Imm m = {0};
    m.arr.count = n;
    m.arr.elem = TY_FLT;
    return ir_special(&p->b, OP_alloc, TY_ARRAY, 0, NULL, m);
}
static inline Inst *at(Prog *p, Inst *a, Inst *i) {
    return ir_special(&p->b, OP_load, TY_FLT, 2, (Inst *[]){a, i}, (Imm){0});
}
static inline void put(Prog *p, Inst *a, Inst *i, Inst *v) {
    ir_special(&p->b, OP_store, TY_VOID, 3, (Inst *[]){a, i, v}, (Imm){0});
}
static inline void copy(Prog *p, Inst *a, Inst *b) {
    ir_special(&p->b, OP_acopy, TY_VOID, 2, (Inst *[]){a, b}, (Imm){0});
}

/* ---- running: n samples, all arrays double */

typedef struct Run {
    double x[3][64], dx[3][64], seed[4][64], params[MAX_FLOATS], dparams[MAX_FLOATS];
    double out[MAX_OUT][64], adj[MAX_FLOATS];
    int32_t stream[64];
    uint64_t tape_bytes;
} Run;

static inline int run_fn(const Fn *fn, Run *r, uint32_t first, uint32_t n, uint32_t lanes) {
    SltKernelArgs a = {0};
    for (int d = 0; d < 3; d++) a.in[IN_X0 + d] = r->x[d] + first, a.in[IN_DX0 + d] = r->dx[d] + first;
    for (int d = 0; d < 4; d++) a.in[IN_SEED0 + d] = r->seed[d] + first;
    a.in[IN_STREAM] = r->stream + first;
    for (int o = 0; o < MAX_OUT; o++) a.out[o] = r->out[o] + first;
    a.params = r->params;
    a.dparams = r->dparams;
    a.adj = r->adj;
    a.n_valid = n;
    a.tape_bytes = r->tape_bytes;
    return ir_interpret(fn, &a, n, lanes);
}

static inline uint32_t nout(const Fn *fn) { return fn->body->last->nargs; }

static inline void assert_sound(const Fn *fn) {
    const char *text = NULL;
    if (!ir_verify(fn, &fn->session->scratch, &text)) {
        fprintf(stderr, "%s\n", text);
        ir_print(fn, stderr);
        fail();
    }
}

static inline uint32_t count_ops(const Block *b, Op op) {
    uint32_t n = 0;
    for (const Inst *i = b->first; i; i = i->next) {
        n += i->op == op;
        for (uint32_t r = 0; r < i->nregions; r++) n += count_ops(i->region[r], op);
    }
    return n;
}

static inline double uniform(uint64_t *state) {
    *state = *state * 6364136223846793005ull + 1442695040888963407ull;
    return (double)(*state >> 11) * 0x1p-53;
}

/* ---- the oracles */

typedef struct Check {
    double x_lo, x_hi, p_lo, p_hi;
    uint32_t tape_budget;
    uint8_t replay;           /* AD_REPLAY_* */
    bool no_fd;               /* has jumps everywhere: only the adjoint identity */
    double fd_tolerance;      /* 0: 1e-5 */
    TapeReport tape;          /* out */
    Fn *vjp, *jvp;            /* out, cleaned */
    uint32_t kinks, compared; /* out */
} Check;

static inline bool near(double a, double b, double tol) {
    if (isnan(a) || isnan(b)) return isnan(a) && isnan(b);
    return a == b || fabs(a - b) <= tol * (1 + fabs(a) + fabs(b));
}

static inline double directional(const Fn *fn, Run *r, uint32_t lane, uint32_t out, double h) {
    Run *t = malloc(sizeof *t);
    double v[2];
    for (int side = 0; side < 2; side++) {
        *t = *r;
        double e = side ? -h : h;
        for (int d = 0; d < 3; d++) t->x[d][lane] += e * t->dx[d][lane];
        for (uint32_t k = 0; k < fn->nfloats; k++) t->params[k] += e * t->dparams[k];
        assert_int_equal(run_fn(fn, t, lane, 1, 1), SLT_OK);
        v[side] = t->out[out][lane];
    }
    free(t);
    return (v[0] - v[1]) / (2 * h);
}

static inline void compare_modes(const Fn *fn, const Fn *jvp, const Fn *vjp, Run *r, Check *c, bool differences) {
    uint32_t n = nout(fn);
    Run *j = malloc(sizeof *j), *v = malloc(sizeof *v), *one = malloc(sizeof *one);
    *j = *v = *r;
    assert_int_equal(run_fn(fn, r, 0, LANES, LANES), SLT_OK);
    assert_int_equal(run_fn(jvp, j, 0, LANES, LANES), SLT_OK);
    assert_int_equal(run_fn(vjp, v, 0, LANES, LANES), SLT_OK);
    double sum[MAX_FLOATS] = {0};
    for (uint32_t l = 0; l < LANES; l++) {
        double lane_forward = 0, lane_reverse = 0, scale = 0;
        for (uint32_t o = 0; o < n; o++) {
            assert_true(near(r->out[o][l], j->out[o][l], 0) && near(r->out[o][l], v->out[o][l], 0));
            lane_forward += r->seed[o][l] * j->out[n + o][l];
            scale += fabs(r->seed[o][l] * j->out[n + o][l]);
        }
        *one = *r;
        memset(one->adj, 0, sizeof one->adj);
        assert_int_equal(run_fn(vjp, one, l, 1, 1), SLT_OK);
        for (uint32_t o = 0; o < nout(vjp); o++) assert_true(near(one->out[o][l], v->out[o][l], 1e-14));
        for (uint32_t k = 0; k < fn->nfloats; k++) {
            sum[k] += one->adj[k];
            lane_reverse += one->adj[k] * r->dparams[k];
            scale += fabs(one->adj[k] * r->dparams[k]);
        }
        for (uint32_t d = 0; d < fn->dim; d++) lane_reverse += v->out[n + d][l] * r->dx[d][l];
        bool same = near(lane_forward, lane_reverse, 1e-9) || fabs(lane_forward - lane_reverse) < 1e-10 * scale;
        if (!same) print_error("lane %u: <w,Jv> = %.17g, <J'w,v> = %.17g\n", l, lane_forward, lane_reverse);
        assert_true(same);
        for (uint32_t o = 0; differences && o < n; o++) {
            double a = directional(fn, r, l, o, 1e-5), b = directional(fn, r, l, o, 2.5e-6), t = j->out[n + o][l];
            double tol = c->fd_tolerance > 0 ? c->fd_tolerance : 1e-5;
            if (!near(a, b, tol)) {
                c->kinks++;
                continue;
            }
            c->compared++;
            if (!near(b, t, tol)) print_error("lane %u output %u: differences %.12g, tangent %.12g\n", l, o, b, t);
            assert_true(near(b, t, tol));
        }
    }
    for (uint32_t k = 0; k < fn->nfloats; k++) {
        if (!near(sum[k], v->adj[k], 1e-9))
            print_error("parameter %u: lanes alone %.17g, together %.17g\n", k, sum[k], v->adj[k]);
        assert_true(near(sum[k], v->adj[k], 1e-9));
    }
    free(j), free(v), free(one);
}

static inline Run *random_run(const Fn *fn, const Check *c, uint64_t *state) {
    Run *r = calloc(1, sizeof *r);
    for (int d = 0; d < 3; d++)
        for (int l = 0; l < LANES; l++) {
            r->x[d][l] = c->x_lo + (c->x_hi - c->x_lo) * uniform(state);
            r->dx[d][l] = 2 * uniform(state) - 1;
        }
    for (int d = 0; d < 4; d++)
        for (int l = 0; l < LANES; l++) r->seed[d][l] = 2 * uniform(state) - 1;
    for (int l = 0; l < LANES; l++) r->stream[l] = l * 7 + 1;
    for (uint32_t k = 0; k < fn->nfloats; k++) {
        r->params[k] = c->p_lo + (c->p_hi - c->p_lo) * uniform(state);
        r->dparams[k] = 2 * uniform(state) - 1;
    }
    return r;
}

static inline void clean(PassCtx *ctx, Fn *fn) {
    opt_fold(ctx, fn);
    assert_sound(fn);
    opt_cse(ctx, fn);
    assert_sound(fn);
    opt_licm(ctx, fn);
    assert_sound(fn);
    opt_dce(ctx, fn);
    assert_sound(fn);
}

static inline void check_ad(Prog *p, Check *c) {
    if (c->x_lo == c->x_hi) c->x_lo = -1, c->x_hi = 1;
    if (c->p_lo == c->p_hi) c->p_lo = -1, c->p_hi = 1;
    assert_sound(p->fn);
    PassCtx ctx = {.session = p->s, .has_fma = true};
    while (opt_fold(&ctx, p->fn)) {
    } /* as in the pipeline: conditions that are constants are gone */
    AdOptions o = {.wrt_x = true, .tape_budget = c->tape_budget, .replay = c->replay};
    Fn *jvp = ad_jvp(&ctx, p->fn, &o);
    assert_sound(jvp);
    Fn *vjp = ad_vjp(&ctx, p->fn, &o, &c->tape);
    assert_sound(vjp);
    uint64_t state = 1;
    for (int round = 0; round < 3; round++) {
        Run *r = random_run(p->fn, c, &state);
        compare_modes(p->fn, jvp, vjp, r, c, !c->no_fd && round < 2);
        free(r);
    }
    clean(&ctx, jvp);
    clean(&ctx, vjp);
    for (int round = 0; round < 2; round++) {
        Run *r = random_run(p->fn, c, &state);
        compare_modes(p->fn, jvp, vjp, r, c, false);
        free(r);
    }
    c->vjp = vjp;
    c->jvp = jvp;
}

/* Two reverse kernels of one program: the same outputs to the bit, the same adjoints within rounding, lanes together
 * and every lane alone. */
static inline void compare_kernels(const Fn *fn, const Fn *a, const Fn *b, uint32_t rounds) {
    uint64_t state = 77;
    for (uint32_t round = 0; round < rounds; round++) {
        Run *ra = random_run(fn, &(Check){.x_lo = -1, .x_hi = 1, .p_lo = -1, .p_hi = 1}, &state),
            *rb = malloc(sizeof *rb);
        *rb = *ra;
        uint32_t lanes = 1u << round % 4;
        assert_int_equal(run_fn(a, ra, 0, LANES, lanes), SLT_OK);
        assert_int_equal(run_fn(b, rb, 0, LANES, lanes), SLT_OK);
        for (uint32_t o = 0; o < nout(a); o++)
            for (uint32_t l = 0; l < LANES; l++)
                assert_true(near(ra->out[o][l], rb->out[o][l], o < nout(fn) ? 0 : 1e-12));
        for (uint32_t k = 0; k < fn->nfloats; k++) {
            if (!near(ra->adj[k], rb->adj[k], 1e-12))
                print_error("parameter %u: %.17g and %.17g\n", k, ra->adj[k], rb->adj[k]);
            assert_true(near(ra->adj[k], rb->adj[k], 1e-12));
        }
        free(ra), free(rb);
    }
}

/* Runs a test body inside a session. */
typedef void TestBody(Session *s);
static inline void in_session_body(Session *s, void *arg) { (*(TestBody **)arg)(s); }
static inline void in_session(TestBody *body) {
    Session *s = session_create(0);
    int status = session_protect(s, in_session_body, &body);
    if (status) print_error("%s\n", s->unwind_text);
    assert_int_equal(status, 0);
    session_destroy(s);
}
#define TEST(name)                                                                                                                          \
    static void name##_body(Session *s);                                                                                                    \
    static void name(void **state) {                                                                                                        \
        (void)state;                                                                                                                        \
        in_session(name##_body);                                                                                                            \
    }                                                                                                                                       \
    static void name##_body(Session *s)

#endif
