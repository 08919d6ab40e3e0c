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
    char names[MODULE][8];
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

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_rows),
        cmocka_unit_test(test_kernels),
        cmocka_unit_test(test_kernels_without_fma),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
