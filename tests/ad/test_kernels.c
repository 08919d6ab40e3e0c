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

/* ---- rows: one sweep for several seeds of one output */
enum { ROWS = 3 };

typedef struct RowSums {
    double out[N], adj[ROWS * PARAMS * 16];
} RowSums;

static void seed_rows(SltKernelArgs *a, double *memory, const double *params, RowSums *to, uint32_t seed,
                      int32_t rows) {
    uint64_t state = 7;
    memset(a, 0, sizeof *a), memset(to, 0, sizeof *to);
    for (int k = 0; k < 12 * N; k++) memory[k] = 2 * uniform(&state) - 1;
    for (int k = 0; k < N; k += 5) memory[(4 + 2 * (k % 3)) * N + k] = 0;
    for (int d = 0; d < 2; d++) a->in[IN_X0 + d] = memory + (size_t)2 * N * d;
    for (uint32_t r = 0; r < ROWS; r++) a->in[IN_SEED0 + r] = memory + (size_t)(4 + 2 * ((seed + r) % ROWS)) * N;
    a->out[0] = to->out, a->params = params, a->adj = to->adj, a->n_valid = N, a->rows = rows;
}

static void run_rows(Session *s, const Fn *v, const TapeReport *tape, SltKernelArgs *a, uint32_t width, AdjLayout adj) {
    BackOptions o = {.width = width, .adj = adj, .no_cache = true, .opt_level = 1};
    target_host(&o.target);
    CompiledModule *module = NULL;
    const char *why = NULL;
    assert_int_equal(back_compile(s, &(KernelRequest){"vjp", (Fn *)v}, 1, &o, &module, &why), SLT_OK);
    a->tape_bytes = (tape->bytes_per_lane * width + 63) & ~(uint64_t)63;
    a->tape = aligned_alloc(64, (a->tape_bytes + 127) / 64 * 64), a->log_cap = 1u << 18;
    a->log_index = malloc((a->log_cap + SLT_PAD) * sizeof *a->log_index);
    double *log = a->log_value = malloc((a->log_cap + SLT_PAD) * sizeof *log);
    back_kernel(module, "vjp")(a, N);
    uint32_t lanes = adj == ADJ_FLAT ? 1 : width;
    double *sum = a->adj;
    for (uint32_t p = 0; p < ROWS * PARAMS; p++)
        for (uint32_t l = 1; l < lanes; l++) sum[p * lanes] += sum[p * lanes + l];
    for (uint32_t p = 1; p < ROWS * PARAMS; p++) sum[p] = sum[p * lanes];
    assert_true(a->log_len <= a->log_cap);
    for (uint64_t k = 0; k < a->log_len; k++) sum[a->log_index[k]] += log[k];
    back_free(module);
    free(a->tape), free(a->log_index), free(log);
}

/* Each row is what a kernel of one row gives for its seed; of 1 row the others stay as they are. */
TEST(rows) {
    PassCtx ctx = {.session = s, .has_fma = true, .verify = {.pass = PASS_ALL}};
    double params[PARAMS], *memory = aligned_alloc(64, 12 * N * sizeof *memory);
    RowSums *want = aligned_alloc(64, (sizeof *want + 63) / 64 * 64),
            *got = aligned_alloc(64, (sizeof *got + 63) / 64 * 64);
    uint64_t state = 5;
    for (int k = 0; k < PARAMS; k++) params[k] = 2 * uniform(&state) - 1;
    for (uint32_t seed = 3000; seed < 3012; seed++) {
        TapeReport tape;
        SltKernelArgs a;
        Fn *f = random_program(s, &s->module, PREC_F64, seed, (RandomShape){0});
        f->body->last->nargs = 1;
        pipeline_primal(&ctx, f);
        AdOptions o = {.tape_budget = seed % 3 ? 0 : 64, .replay = seed & 1 ? AD_REPLAY_ALWAYS : AD_REPLAY_AUTO};
        Fn *one = ad_vjp(&ctx, f, &o, NULL);
        o.rows = ROWS;
        Fn *all = ad_vjp(&ctx, f, &o, &tape);
        pipeline_kernel(&ctx, one), pipeline_kernel(&ctx, all);
        for (int32_t rows = 1; rows <= ROWS; rows += ROWS - 1)
            for (int how = 0; how < 3; how++) { /* interpreted, by lanes, flat */
                uint32_t width = 1u << seed % 5;
                seed_rows(&a, memory, params, got, 0, rows);
                if (how == 0) assert_int_equal(ir_interpret(all, &a, N, width), SLT_OK);
                else run_rows(s, all, &tape, &a, width, how == 1 ? ADJ_LANES : ADJ_FLAT);
                for (uint32_t r = 0; r < ROWS; r++) {
                    seed_rows(&a, memory, params, want, r, 0);
                    if ((int32_t)r < rows) assert_int_equal(ir_interpret(one, &a, N, width), SLT_OK);
                    for (uint32_t k = 0; k < PARAMS; k++) {
                        bool same = near(got->adj[r * PARAMS + k], want->adj[k], 1e-9);
                        if (!same)
                            print_error("seed %u, row %u, parameter %u: %.17g, alone %.17g\n", seed, r, k,
                                        got->adj[r * PARAMS + k], want->adj[k]);
                        assert_true(same);
                    }
                }
            }
    }
    free(memory), free(want), free(got);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(tapes), cmocka_unit_test(checkpointed),
                                       cmocka_unit_test(replayed), cmocka_unit_test(rows)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
