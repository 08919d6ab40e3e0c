/* Several rows of adjoints from one sweep, interpreted and compiled, against a kernel of one row with one seed at a
 * time: of a number that has several seeds, and of numbers whose adjoints do not mix. */
#include "compiler/back/back.h"
#include "tests/ad/ad_test.h"
#include "tests/ad/random_program.c"

enum { N = 64, PARAMS = 12, ROWS = 3, WIDEST = 16 };

typedef struct Sums {
    double out[4][N], adj[ROWS * PARAMS * WIDEST];
} Sums;
typedef struct Case {
    Session *s;
    double *memory, params[PARAMS]; /* memory: [2 + ROWS][2 * N], x and the seeds, of which some are 0, then zeros */
    Sums *want, *got;
} Case;

static Case case_begin(Session *s) {
    Case c = {.s = s, .memory = aligned_alloc(64, (3 + ROWS) * 2 * N * sizeof(double))};
    uint64_t state = 7;
    for (int k = 0; k < (2 + ROWS) * 2 * N; k++) c.memory[k] = 2 * uniform(&state) - 1;
    for (int k = 0; k < N; k += 5) c.memory[(2 + k % ROWS) * 2 * N + k] = 0;
    memset(c.memory + (2 + ROWS) * 2 * N, 0, 2 * N * sizeof *c.memory);
    for (int k = 0; k < PARAMS; k++) c.params[k] = 2 * uniform(&state) - 1;
    c.want = aligned_alloc(64, (sizeof(Sums) + 63) / 64 * 64), c.got = aligned_alloc(64, (sizeof(Sums) + 63) / 64 * 64);
    return c;
}

static void case_end(Case *c) { free(c->memory), free(c->want), free(c->got); }

static double *seed(const Case *c, uint32_t row) { return c->memory + (size_t)(2 + row) * 2 * N; }

static SltKernelArgs set_up(const Case *c, Sums *to, int32_t rows) {
    SltKernelArgs a = {.params = c->params, .adj = to->adj, .n_valid = N, .rows = rows};
    memset(to, 0, sizeof *to);
    for (int d = 0; d < 2; d++) a.in[IN_X0 + d] = c->memory + (size_t)2 * N * d;
    for (uint32_t r = 0; r < ROWS; r++) a.in[IN_SEED0 + r] = seed(c, r);
    for (int o = 0; o < 4; o++) a.out[o] = to->out[o];
    return a;
}

static void run_compiled(Session *s, Fn *v, const TapeReport *tape, SltKernelArgs *a, uint32_t width, AdjLayout adj) {
    BackOptions o = {.width = width, .adj = adj, .no_cache = true, .opt_level = 1};
    target_host(&o.target);
    CompiledModule *module = NULL;
    const char *why = NULL;
    assert_int_equal(back_compile(s, &(KernelRequest){"vjp", v}, 1, &o, &module, &why), SLT_OK);
    a->tape_bytes = (tape->bytes_per_lane * width + 63) & ~(uint64_t)63;
    a->tape = aligned_alloc(64, (a->tape_bytes + 127) / 64 * 64), a->log_cap = 1u << 18;
    a->log_index = malloc((a->log_cap + SLT_PAD) * sizeof *a->log_index);
    double *log = a->log_value = malloc((a->log_cap + SLT_PAD) * sizeof *log), *sum = a->adj;
    back_kernel(module, "vjp")(a, N);
    uint32_t lanes = back_adjoint_lanes(&o, PREC_F64);
    for (uint32_t p = 0; p < ROWS * PARAMS; p++) {
        double all = 0;
        for (uint32_t l = 0; l < lanes; l++) all += sum[p * lanes + l];
        sum[p] = all;
    }
    assert_true(a->log_len <= a->log_cap);
    for (uint64_t k = 0; k < a->log_len; k++) sum[a->log_index[k]] += log[k];
    back_free(module);
    free(a->tape), free(a->log_index), free(log);
}

/* The wanted adjoints of a row, by the kernel without rows. */
static void want_row(const Case *c, const Fn *one, bool of_g, uint32_t row, uint32_t rows) {
    SltKernelArgs a = set_up(c, c->want, 0);
    for (uint32_t r = 0; r < ROWS; r++) /* one row of f is the sum of all channels */
        a.in[IN_SEED0 + r] = of_g ? seed(c, row) : r == row || rows == 1 ? seed(c, r) : seed(c, ROWS);
    if (row < rows) assert_int_equal(ir_interpret(one, &a, N, 8), SLT_OK);
}

static void compare(Case *c, const Fn *one, Fn *all, const TapeReport *tape, bool of_g, uint32_t width) {
    for (uint32_t rows = 1; rows <= ROWS; rows += ROWS - 1)
        for (int how = 0; how < (rows == 1 ? 2 : 3); how++) {
            SltKernelArgs a = set_up(c, c->got, (int32_t)rows);
            if (how == 0) assert_int_equal(ir_interpret(all, &a, N, width), SLT_OK);
            else run_compiled(c->s, all, tape, &a, width, how == 1 ? ADJ_LANES : ADJ_FLAT);
            for (uint32_t r = 0; r < ROWS; r++) {
                want_row(c, one, of_g, r, rows);
                for (uint32_t k = 0; k < PARAMS; k++) {
                    double x = c->got->adj[r * PARAMS + k], y = c->want->adj[k];
                    if (!near(x, y, 1e-9)) print_error("row %u, parameter %u: %.17g, alone %.17g\n", r, k, x, y);
                    assert_true(near(x, y, 1e-9));
                }
            }
        }
}

TEST(one_number) {
    PassCtx ctx = {.session = s, .has_fma = true, .verify = {.pass = PASS_ALL}};
    Case c = case_begin(s);
    for (uint32_t n = 3000; n < 3005; n++) {
        TapeReport tape;
        Fn *f = random_program(s, &s->module, PREC_F64, n, (RandomShape){0});
        f->body->last->nargs = 1;
        pipeline_primal(&ctx, f);
        AdOptions o = {.tape_budget = n % 3 ? 0 : 64, .replay = n & 1 ? AD_REPLAY_ALWAYS : AD_REPLAY_AUTO};
        Fn *one = ad_vjp(&ctx, f, &o, NULL);
        o.rows = ROWS;
        Fn *all = ad_vjp(&ctx, f, &o, &tape);
        pipeline_kernel(&ctx, one), pipeline_kernel(&ctx, all);
        compare(&c, one, all, &tape, true, 1u << n % 5);
    }
    case_end(&c);
}

/* The square root of a parameter that is 0 moves nothing where the seed is 0. */
TEST(pole) {
    PassCtx ctx = {.session = s, .has_fma = true};
    Case c = case_begin(s);
    for (int k = 0; k < PARAMS; k++) c.params[k] = 0;
    for (int k = 0; k < N; k++) seed(&c, 1)[k] = 0;
    Prog p = prog_begin(s, PREC_F64, PARAMS);
    Inst *g = root(&p, par(&p, 2));
    prog_end(&p, 1, &g);
    TapeReport tape;
    Fn *all = ad_vjp(&ctx, p.fn, &(AdOptions){.rows = ROWS}, &tape);
    pipeline_kernel(&ctx, all);
    SltKernelArgs a = set_up(&c, c.got, ROWS);
    run_compiled(s, all, &tape, &a, 8, ADJ_LANES);
    assert_true(c.got->adj[PARAMS + 2] == 0 && !isfinite(c.got->adj[2]));
    case_end(&c);
}

/* Three inks painted one over the other where x decides, behind an if, through an array and at varying indices; `mix`:
 * the last channel has something of the first. */
static Fn *painting(Session *s, bool mix) {
    Prog p = prog_begin(s, PREC_F64, PARAMS);
    Inst *f[ROWS], *x = input_x(&p, 0), *held = array(&p, ROWS);
    for (int ch = 0; ch < ROWS; ch++) f[ch] = par(&p, (uint32_t)ch);
    Inst **in = loop_begin(&p, 3, true, ROWS, f), *next[ROWS];
    Inst *k = in[0], *inside = lt(&p, mul(&p, x, i2f_(&p, k)), input_x(&p, 1));
    for (int ch = 0; ch < ROWS; ch++) {
        Inst *ink = par_at(&p, 0, PARAMS, iadd_(&p, imul_(&p, ci(&p, 3), k), ci(&p, ch)));
        next[ch] = sel(&p, inside, mul(&p, ink, x), in[1 + ch]);
    }
    loop_end(&p, NULL, ROWS, next, f);
    if_begin(&p, lt(&p, x, cf(&p, 0.2)));
    for (int ch = 0; ch < ROWS; ch++) next[ch] = mul(&p, f[ch], par(&p, (uint32_t)(9 + ch)));
    if_else(&p, ROWS, next);
    if_end(&p, ROWS, f, next);
    for (int ch = 0; ch < ROWS; ch++) f[ch] = next[ch];
    if (mix) put(&p, held, ci(&p, 0), f[0]), f[2] = add(&p, f[2], at(&p, held, ci(&p, 0)));
    prog_end(&p, ROWS, f);
    return p.fn;
}

TEST(numbers_apart) {
    PassCtx ctx = {.session = s, .has_fma = true, .verify = {.pass = PASS_ALL}};
    Case c = case_begin(s);
    for (uint32_t width = 1; width <= WIDEST; width *= 4) {
        TapeReport tape;
        Fn *one = ad_vjp(&ctx, painting(s, false), NULL, NULL), *all = ad_vjp(&ctx, painting(s, false), NULL, &tape);
        assert_true(ad_part_rows(all));
        pipeline_kernel(&ctx, one), pipeline_kernel(&ctx, all);
        assert_true(pipeline_layout(all).reads >> IN_ROWS & 1);
        compare(&c, one, all, &tape, false, width);
    }
    case_end(&c);
}

TEST(numbers_mixed) {
    PassCtx ctx = {.session = s, .has_fma = true};
    Fn *v = ad_vjp(&ctx, painting(s, true), NULL, NULL);
    uint32_t before = ir_number(v);
    assert_false(ad_part_rows(v));
    assert_int_equal(ir_number(v), before);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(one_number), cmocka_unit_test(pole),
                                       cmocka_unit_test(numbers_apart), cmocka_unit_test(numbers_mixed)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
