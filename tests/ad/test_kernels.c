/* Compiled reverse kernels of random programs against the interpreter: the same values, the same adjoints, with tapes,
 * with checkpoints, at several widths. */
#include "compiler/back/back.h"
#include "tests/ad/ad_test.h"
#include "tests/ad/random_program.c"

enum { N = 64, PARAMS = 12 };

typedef struct Sums {
    double out[4][N], adj[PARAMS];
} Sums;

static void set_up(SltKernelArgs *a, double *memory, const double *params, Sums *to) {
    memset(a, 0, sizeof *a);
    double *at = memory;
    uint64_t state = 99;
    for (int i = 0; i < 2; i++, at += 2 * N) a->in[IN_X0 + i] = at;
    for (int i = 0; i < 2; i++, at += 2 * N) a->in[IN_SEED0 + i] = at;
    for (int k = 0; k < 8 * N; k++) memory[k] = 2 * uniform(&state) - 1;
    for (int i = 0; i < 4; i++) a->out[i] = to->out[i];
    a->params = params;
    a->adj = to->adj;
    a->n_valid = N;
}

static void try_program(Session *s, uint64_t seed, uint32_t budget, uint32_t width, uint8_t replay) {
    ArenaMark m = arena_mark(&s->module);
    PassCtx ctx = {.session = s, .has_fma = true, .verify = {.pass = PASS_ALL}};
    Fn *f = random_program(s, &s->module, PREC_F64, seed, (RandomShape){0});
    pipeline_primal(&ctx, f);
    TapeReport tape;
    Fn *v = ad_vjp(&ctx, f, &(AdOptions){.wrt_x = true, .tape_budget = budget, .replay = replay}, &tape);
    pipeline_kernel(&ctx, v);
    double params[PARAMS], *memory = aligned_alloc(64, 16 * N * sizeof *memory);
    uint64_t state = seed;
    for (int k = 0; k < PARAMS; k++) params[k] = 2 * uniform(&state) - 1;
    size_t sums = (sizeof(Sums) + 63) / 64 * 64;
    Sums *want = aligned_alloc(64, sums), *got = aligned_alloc(64, sums);
    memset(want, 0, sizeof *want);
    memset(got, 0, sizeof *got);
    SltKernelArgs a;
    set_up(&a, memory, params, want);
    assert_int_equal(ir_interpret(v, &a, N, width), SLT_OK);

    BackOptions o = {.width = width, .adj = ADJ_FLAT, .no_cache = true, .opt_level = 1};
    target_host(&o.target);
    CompiledModule *module = NULL;
    const char *why = NULL;
    int status = back_compile(s, &(KernelRequest){"vjp", v}, 1, &o, &module, &why);
    if (status) print_error("seed %llu: %s\n", (unsigned long long)seed, why);
    assert_int_equal(status, SLT_OK);
    set_up(&a, memory, params, got);
    uint64_t tape_bytes = (tape.bytes_per_lane * width + 63) & ~(uint64_t)63; /* the report is a bound for any width */
    a.tape = aligned_alloc(64, (tape_bytes + 127) / 64 * 64);
    a.tape_bytes = tape_bytes;
    a.log_cap = 1u << 18;
    a.log_index = malloc((a.log_cap + SLT_PAD) * sizeof *a.log_index);
    double *log = a.log_value = malloc((a.log_cap + SLT_PAD) * sizeof *log);
    back_kernel(module, "vjp")(&a, N);
    assert_true(a.log_len <= a.log_cap);
    assert_int_equal(a.counters[SLT_COUNT_TAPE_OVERFLOW], 0);
    for (uint64_t k = 0; k < a.log_len; k++) got->adj[a.log_index[k]] += log[k];
    for (int i = 0; i < 4; i++)
        for (int l = 0; l < N; l++) {
            if (!near(got->out[i][l], want->out[i][l], 1e-12))
                print_error("seed %llu, output %d, lane %d: %.17g, interpreter %.17g\n", (unsigned long long)seed, i, l,
                            got->out[i][l], want->out[i][l]);
            assert_true(near(got->out[i][l], want->out[i][l], 1e-12));
        }
    for (int k = 0; k < PARAMS; k++) {
        if (!near(got->adj[k], want->adj[k], 1e-9))
            print_error("seed %llu, parameter %d: %.17g, interpreter %.17g\n", (unsigned long long)seed, k, got->adj[k],
                        want->adj[k]);
        assert_true(near(got->adj[k], want->adj[k], 1e-9));
    }
    back_free(module);
    free(a.tape), free(a.log_index), free(log), free(memory), free(want), free(got);
    arena_reset(&s->module, m);
}

TEST(tapes) {
    for (uint64_t seed = 3000; seed < 3016; seed++) try_program(s, seed, 0, 1u << seed % 5, AD_REPLAY_AUTO);
}
TEST(checkpointed) {
    for (uint64_t seed = 3000; seed < 3016; seed++) try_program(s, seed, 64, seed & 1 ? 4 : 16, AD_REPLAY_AUTO);
}
TEST(replayed) {
    for (uint64_t seed = 3000; seed < 3020; seed++)
        try_program(s, seed, seed % 3 ? 100 : 0, 1u << seed % 5, seed & 1 ? AD_REPLAY_ALWAYS : AD_REPLAY_KEEP);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(tapes), cmocka_unit_test(checkpointed),
                                       cmocka_unit_test(replayed)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
