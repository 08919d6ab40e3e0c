/* The bounds column: no point of a box contradicts the bound of its row, for every value row, in both precisions, by
 * the interpreter and by compiled kernels, which agree bit for bit. Samples are edges of the number formats and of the
 * rows, boxes of a few units in the last place, wide ones, those of one point, unknown ones, and arguments that are one
 * value. ROUNDS=n in the environment: n times as many pairs, on every target at every width. */
#include "compiler/back/back.h"
#include "tests/ir/bounds_pairs.h"

static bool interpreted(const Case *c, void *user) {
    Run *run_ = user;
    ArenaMark m = arena_mark(&run_->s->module);
    Fn *fn = lowered(run_->s, c, true, true);
    bool ok = true;
    for (uint32_t k = 0; k < run_->rounds && ok; k++) {
        fill(run_->d, c);
        SltKernelArgs a = args_of(run_->d, 0, N);
        assert_int_equal(run(fn, &a, N, WIDTH), SLT_OK);
        run_->pairs += N;
        ok = !contradictions(run_->d, c, 0, N, true);
    }
    arena_reset(&run_->s->module, m);
    return ok;
}

static void test_rows(void **state) {
    (void)state;
    rng = 1;
    Run r = {.s = session_create(0), .d = make_data(), .rounds = rounds(1)};
    uint32_t bad = each_case(interpreted, &r);
    printf("%llu pairs\n", (unsigned long long)r.pairs);
    free_data(r.d);
    session_destroy(r.s);
    assert_int_equal(bad, 0);
}

/* ---- the same in compiled kernels: some cases to a module */

enum { MODULE = 24 };

typedef struct Compiled {
    Run run;
    Case c[MODULE];
    Fn *fn[MODULE];
    uint32_t n, module, seen;
    ArenaMark mark;
    bool everywhere; /* every case on every target at every width, and not a few here and there */
} Compiled;

static bool same_bits(const void *a, const void *b, IrType t, Precision p) {
    double x = get(a, t, p, 0), y = get(b, t, p, 0);
    return (isnan(x) && isnan(y)) || !memcmp(a, b, t == TY_FLT && p == PREC_F64 ? 8 : 4);
}

static bool module_on(Compiled *m, const Target *target, uint32_t width, bool fma) {
    if (target->has_fma != fma) return true;
    KernelRequest k[MODULE];
    char names[MODULE][12];
    for (uint32_t j = 0; j < m->n; j++) {
        snprintf(names[j], sizeof names[j], "f%u", j);
        k[j] = (KernelRequest){names[j], m->fn[j]};
    }
    BackOptions o = {.target = *target, .width = width, .no_cache = true, .opt_level = 2};
    CompiledModule *module = NULL;
    const char *why = "";
    if (back_compile(m->run.s, k, m->n, &o, &module, &why)) fail_msg("%s", why);
    bool ok = true;
    for (uint32_t j = 0; j < m->n; j++) {
        const Case *c = &m->c[j];
        IrType t = (IrType)ir_ops[c->op].result, types[OUTS] = {t, t, t, TY_BOOL, TY_BOOL};
        size_t bytes = t == TY_FLT && c->p == PREC_F64 ? 8 : 4;
        for (uint32_t round = 0; round < m->run.rounds && ok; round++) {
            fill(m->run.d, c);
            SltKernelArgs a = args_of(m->run.d, 1, N);
            back_kernel(module, names[j])(&a, N);
            m->run.pairs += N;
            ok &= !contradictions(m->run.d, c, 1, N, true);
            if (round) continue;
            SltKernelArgs b = args_of(m->run.d, 0, N);
            assert_int_equal(run(m->fn[j], &b, N, WIDTH), SLT_OK);
            for (uint32_t out = 0; out < OUTS; out++)
                for (uint32_t n = 0; n < N; n++) {
                    size_t at = n * (out < OUT_JUMPS ? bytes : 4);
                    const char *x = (const char *)m->run.d->out[0][out] + at,
                               *y = (const char *)m->run.d->out[1][out] + at;
                    if (same_bits(x, y, types[out], c->p) || !ok) continue;
                    ok = false;
                    printf(
                        "%s, width %u: output %u is %.17g in a kernel and %.17g in the interpreter at %.17g of [%.17g, %.17g]\n",
                        ir_ops[c->op].name, width, out, get(y, types[out], c->p, 0), get(x, types[out], c->p, 0),
                        m->run.d->sample[0][n].v, m->run.d->sample[0][n].lo, m->run.d->sample[0][n].hi);
                }
        }
    }
    back_free(module);
    return ok;
}

static bool module_ends(Compiled *m, bool fma) {
    static const char *const names[] = {"sse2", "avx2", "avx512"};
    static const uint32_t widths[] = {8, 16, 1, 32, 4, 64, 2};
    bool ok = true;
    Target host;
    target_named(&host, "native");
    for (uint32_t t = 0; t < 3 && m->n; t++) {
        Target target;
        target_named(&target, names[t]);
        if (!target_runs(&target, &host)) continue;
        for (uint32_t w = 0; w < 7; w++)
            if (m->everywhere || w == (m->module + 3 * t) % 7) ok &= module_on(m, &target, widths[w], fma);
    }
    m->n = 0;
    m->module++;
    arena_reset(&m->run.s->module, m->mark);
    return ok;
}

static bool compiled(const Case *c, void *user, bool fma) {
    Compiled *m = user;
    if ((c->op == OP_ffma && !fma) || (!m->everywhere && m->seen++ % 5)) return true;
    m->c[m->n] = *c;
    m->fn[m->n++] = lowered(m->run.s, c, fma, true);
    return m->n < MODULE || module_ends(m, fma);
}
static bool compiled_fma(const Case *c, void *user) { return compiled(c, user, true); }
static bool compiled_plain(const Case *c, void *user) { return compiled(c, user, false); }

static void kernels(Check *check, bool fma) {
    rng = 2;
    Compiled m = {.run = {.s = session_create(0), .d = make_data(), .rounds = rounds(1)}, .everywhere = rounds(1) > 1};
    m.mark = arena_mark(&m.run.s->module);
    uint32_t bad = each_case(check, &m);
    bad += !module_ends(&m, fma);
    printf("%llu pairs\n", (unsigned long long)m.run.pairs);
    free_data(m.run.d);
    session_destroy(m.run.s);
    assert_int_equal(bad, 0);
}

static void test_kernels(void **state) { (void)state, kernels(compiled_fma, true); }
static void test_kernels_without_fma(void **state) { (void)state, kernels(compiled_plain, false); }

/* ---- events: what may jump or bend inside these boxes */

typedef struct Event {
    Op op;
    double lo, hi, lo2, hi2;
    bool jumps, bends;
} Event;

static const Event event_list[] = {
    {OP_fadd, -1, 1, -1, 1, false, false},
    {OP_ffloor, 0.25, 0.75, 0, 0, false, false},
    {OP_ffloor, 0.25, 1, 0, 0, true, false},
    {OP_ffloor, NAN, 0.5, 0, 0, true, false},
    {OP_fceil, 0.25, 0.75, 0, 0, false, false},
    {OP_fceil, 1, 1.5, 0, 0, true, false},
    {OP_fround, 0.6, 1.4, 0, 0, false, false},
    {OP_fround, 0.4, 0.6, 0, 0, true, false},
    {OP_ftrunc, -0.9, 0.9, 0, 0, false, false},
    {OP_ftrunc, -1, 0.9, 0, 0, true, false},
    {OP_fdiv, 1, 2, 1, 2, false, false},
    {OP_fdiv, 1, 2, -2, -1, false, false},
    {OP_fdiv, 1, 2, 0, 1, true, false},
    {OP_fdiv, 1, 2, -1, 1, true, false},
    {OP_fdiv, 1, 2, NAN, -1, true, false},
    {OP_zdiv, 0, 2, -1, 0, true, false},
    {OP_fabs, 0, 2, 0, 0, false, false},
    {OP_fabs, -1, 1, 0, 0, false, true},
    {OP_fabs, NAN, 3, 0, 0, false, true},
    {OP_fmin, 0, 1, 2, 3, false, false},
    {OP_fmin, 2, 3, 0, 1, false, false},
    {OP_fmin, 0, 2, 1, 3, false, true},
    {OP_fmin, 0, 1, 1, 2, false, true},
    {OP_fmax, 0, 1, NAN, 7, true, true},
    {OP_fmax, 0, 1, -INFINITY, INFINITY, true, true},
    {OP_fmax, 0, 1, 2, INFINITY, false, false},
    {OP_fcopysign, 1, 2, 1, 2, false, false},
    {OP_fcopysign, 1, 2, 0, 1, true, false},
    {OP_fcopysign, -1, 2, -2, -1, false, true},
    {OP_fsqrt, 0.1, 1, 0, 0, false, false},
    {OP_fsqrt, 0, 1, 0, 0, false, true},
    {OP_fsqrt, -1, 1, 0, 0, false, true},
    {OP_frsqrt, 0.5, 1, 0, 0, false, false},
    {OP_frsqrt, 0, 1, 0, 0, true, false},
    {OP_fcbrt, -1, 1, 0, 0, false, true},
    {OP_fcbrt, 1, 2, 0, 0, false, false},
    {OP_flog, 0.5, 1, 0, 0, false, false},
    {OP_flog, 0, 1, 0, 0, true, false},
    {OP_flog2, -1, 1, 0, 0, true, false},
    {OP_ftan, -1.5, 1.5, 0, 0, false, false},
    {OP_ftan, 1.5, 1.6, 0, 0, true, false},
    {OP_ftan, 0, 3.1, 0, 0, true, false},
    {OP_fasin, -0.5, 0.99, 0, 0, false, false},
    {OP_fasin, 0.5, 1, 0, 0, false, true},
    {OP_facos, -1, 0.5, 0, 0, false, true},
    {OP_fatan2, -1, 1, 0.5, 1, false, false},
    {OP_fatan2, 1, 2, -1, 1, false, false},
    {OP_fatan2, -1, 1, -1, -0.5, true, false},
    {OP_fatan2, -1, 1, -1, 1, true, false},
    {OP_fatan2, 0, 1, -1, -0.5, true, false},
    {OP_fpow, 1, 2, -1, 3, false, false},
    {OP_fpow, 0, 1, 1, 2, false, true},
    {OP_fpow, 0, 1, 0, 2, true, true},
    {OP_fpow, -1, 1, 1, 2, true, true},
    {OP_fsin, -9, 9, 0, 0, false, false},
    {OP_flt, 0, 1, 2, 3, false, false},
    {OP_flt, 0, 2, 1, 3, true, false},
    {OP_fle, 0, 1, 1, 2, false, false},
    {OP_f2i, 0.5, 0.9, 0, 0, false, false},
    {OP_f2i, 0.5, 1.5, 0, 0, true, false},
    {OP_f2u, -5, 0.9, 0, 0, false, false},
    {OP_fasuint, 1, 1.5, 0, 0, true, false},
    {OP_fmant, 1, 1.5, 0, 0, true, false},
};

/* Of the magnitude of the first argument. */
static const Event magnitude_list[] = {
    {OP_fatan2, -1, 1, -1, -0.5, false, false},
    {OP_fatan2, 0, 1, -1, -0.5, false, false},
    {OP_fatan2, -1, 1, -1, 0, true, false},
};

static void test_events(void **state) {
    (void)state;
    Session *s = session_create(0);
    Data *d = make_data();
    uint32_t bad = 0;
    const size_t n = sizeof event_list / sizeof *event_list, more = sizeof magnitude_list / sizeof *magnitude_list;
    for (size_t k = 0; k < n + more; k++) {
        const Event *e = k < n ? &event_list[k] : &magnitude_list[k - n];
        for (int p = PREC_F32; p <= PREC_F64; p++) {
            Case c = {.op = e->op, .p = (Precision)p, .magnitude = k >= n};
            put(d->in[IN_X0], TY_FLT, c.p, 0, e->lo), put(d->in[IN_H0], TY_FLT, c.p, 0, e->hi);
            put(d->in[IN_X1], TY_FLT, c.p, 0, e->lo2), put(d->in[IN_H1], TY_FLT, c.p, 0, e->hi2);
            put(d->in[IN_SEED0], TY_FLT, c.p, 0, e->lo), put(d->in[IN_SEED1], TY_FLT, c.p, 0, e->lo2);
            Fn *fn = lowered(s, &c, true, true);
            SltKernelArgs a = args_of(d, 0, 1);
            assert_int_equal(run(fn, &a, 1, 1), SLT_OK);
            bool jumps = *(int32_t *)d->out[0][OUT_JUMPS], bends = *(int32_t *)d->out[0][OUT_BENDS];
            if (jumps == e->jumps && bends == e->bends && (ir_bound_has_events(e->op) || !(jumps || bends))) continue;
            bad++;
            printf("%s of [%g, %g] [%g, %g]:%s%s\n", ir_ops[e->op].name, e->lo, e->hi, e->lo2, e->hi2,
                   jumps == e->jumps ? ""
                   : jumps           ? " jumps"
                                     : " does not jump",
                   bends == e->bends ? ""
                   : bends           ? " bends"
                                     : " does not bend");
        }
    }
    free_data(d);
    session_destroy(s);
    assert_int_equal(bad, 0);
}

/* ---- tightness: a box that holds one ordinary point has the row's value, or what widening makes of it */

static void test_points_are_tight(void **state) {
    (void)state;
    rng = 8;
    Session *s = session_create(0);
    Data *d = make_data();
    uint32_t bad = 0;
    for (int op = 0; op < OP_COUNT; op++)
        for (int p = PREC_F32; p <= PREC_F64; p++) {
            const OpInfo *o = &ir_ops[op];
            if (o->special || op == OP_fmant || ir_is_log_part((Op)op)) continue; /* a mantissa is in [1, 2] */
            Case c = {.op = (Op)op, .p = (Precision)p};
            ArenaMark m = arena_mark(&s->module);
            Fn *fn = lowered(s, &c, true, false);
            fill(d, &c);
            for (uint32_t k = 0; k < o->nargs; k++)
                for (uint32_t n = 0; n < N; n++) {
                    IrType t = type_of((Op)op, k);
                    double v = t == TY_FLT   ? round_to(c.p, 0.1 + 0.8 * uniform())
                               : t == TY_INT ? 1 + below(90)
                                             : below(2);
                    for (uint32_t part = 0; part < 3; part++) put(d->in[slot_of(t, k, part)], t, c.p, n, v);
                }
            SltKernelArgs a = args_of(d, 0, N);
            assert_int_equal(run(fn, &a, N, WIDTH), SLT_OK);
            double slack = !o->math ? 0 : (p == PREC_F32 ? FLT_EPSILON : DBL_EPSILON) * 20;
            bool ok = true;
            for (uint32_t n = 0; n < N && ok; n++) {
                IrType t = (IrType)o->result;
                double lo = get(d->out[0][OUT_LO], t, c.p, n), hi = get(d->out[0][OUT_HI], t, c.p, n),
                       v = get(d->out[0][OUT_VALUE], t, c.p, n);
                if (t == TY_BOOL) ok = lo == v && hi == v;
                else ok = v - lo <= fabs(v) * slack && hi - v <= fabs(v) * slack;
                if (!ok) printf("%s: %.17g has the bound [%.17g, %.17g]\n", o->name, v, lo, hi);
            }
            bad += !ok;
            arena_reset(&s->module, m);
        }
    free_data(d);
    session_destroy(s);
    assert_int_equal(bad, 0);
}

/* ---- costs */

/* Additions that the bound of a row takes after the pipeline (constants are free), its arguments being boxes, or the
 * second a point. */
static uint32_t bound_cost(Session *s, const Case *c) {
    ArenaMark m = arena_mark(&s->module);
    Fn *fn = row_fn(s, c, false);
    Inst *out[2] = {ir_yield_of(fn->body)->args[OUT_LO], ir_yield_of(fn->body)->args[OUT_HI]};
    ir_unlink(ir_yield_of(fn->body));
    Builder b = ir_at_end(fn, fn->body);
    ir_yield(&b, 2, out);
    PassCtx ctx = {.session = s, .has_fma = true};
    pipeline_kernel(&ctx, fn);
    uint32_t cost = 0;
    for (const Inst *i = fn->body->first; i; i = i->next)
        if (i->op != OP_input) cost += ir_ops[i->op].cost;
    arena_reset(&s->module, m);
    return cost;
}

typedef enum Shape { BOXES, SAME, BY_POINT, BY_THREE } Shape;

static const struct {
    Op op;
    Shape shape;
    uint32_t cost;
} costs[] = {
    {OP_fadd, BOXES, 2},     {OP_fmul, BY_THREE, 2}, {OP_fmul, BY_POINT, 5}, {OP_fmul, SAME, 7},
    {OP_fmul, BOXES, 13},    {OP_ffma, SAME, 7},     {OP_ffma, BY_THREE, 2}, {OP_ffma, BOXES, 17},
    {OP_fdiv, BY_THREE, 10}, {OP_fdiv, BOXES, 28},   {OP_fmin, BOXES, 7},    {OP_fmax, BY_THREE, 5},
    {OP_fabs, BOXES, 6},     {OP_fsqrt, BOXES, 10},  {OP_ffloor, BOXES, 2},  {OP_flt, BOXES, 7},
    {OP_fexp, BOXES, 45},    {OP_flog, BOXES, 63},   {OP_fsin, BOXES, 76},   {OP_fatan2, BOXES, 96},
    {OP_iadd, BY_THREE, 5},  {OP_ilt, BOXES, 2},     {OP_i2f, BOXES, 2},     {OP_ixor, BOXES, 6},
};

static void test_costs(void **state) {
    (void)state;
    Session *s = session_create(0);
    for (size_t k = 0; k < sizeof costs / sizeof *costs; k++) {
        Case c = {.op = costs[k].op, .p = PREC_F32, .same = costs[k].shape == SAME, .constant = 3};
        if (costs[k].shape == BY_POINT) c.kind[1] = POINT;
        if (costs[k].shape == BY_THREE) c.kind[1] = CONSTANT;
        uint32_t cost = bound_cost(s, &c);
        if (cost > costs[k].cost) fail_msg("the bound of %s costs %u, not %u", ir_ops[c.op].name, cost, costs[k].cost);
    }
    session_destroy(s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_rows),
        cmocka_unit_test(test_kernels),
        cmocka_unit_test(test_kernels_without_fma),
        cmocka_unit_test(test_events),
        cmocka_unit_test(test_points_are_tight),
        cmocka_unit_test(test_costs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
