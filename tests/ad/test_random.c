/* Random programs: forward = reverse everywhere, both = differences away from kinks, lanes together = lanes alone, with
 * and without checkpoints; stored = replayed. */
#include "tests/ad/ad_test.h"
#include "tests/ad/random_program.c"

static uint32_t kinks, compared, framed, checkpointed, replayed, deep_levels;

static void try_seed(Session *s, uint64_t seed, RandomShape shape) {
    ArenaMark m = arena_mark(&s->module);
    Prog p = {.s = s, .fn = random_program(s, &s->module, PREC_F64, seed, shape)};
    Check c = {.fd_tolerance = 1e-4};
    check_ad(&p, &c);
    kinks += c.kinks, compared += c.compared;
    framed += c.tape.bytes_per_lane > 0;
    if (c.tape.bytes_per_lane > 100) {
        Check tight = {.tape_budget = (uint32_t)c.tape.bytes_per_lane / 3, .no_fd = true};
        check_ad(&p, &tight);
        checkpointed += tight.tape.bytes_per_lane < c.tape.bytes_per_lane;
        compare_kernels(p.fn, c.vjp, tight.vjp, 4);
    }
    if (c.tape.bytes_per_lane) {
        static const uint32_t budgets[] = {1u << 30, 100, 1};
        Check again = {
            .tape_budget = budgets[seed % 3], .no_fd = true, .replay = seed % 2 ? AD_REPLAY_KEEP : AD_REPLAY_ALWAYS};
        check_ad(&p, &again);
        replayed += strstr(again.tape.text, "replayed") != NULL;
        deep_levels += strstr(again.tape.text, "levels") != NULL;
        compare_kernels(p.fn, c.vjp, again.vjp, 4);
    }
    arena_reset(&s->module, m);
}

static void range_of_seeds(Session *s, uint64_t first, uint64_t n, RandomShape shape) {
    const char *only = getenv("SEED");
    if (only) first = strtoull(only, NULL, 10), n = 1;
    for (uint64_t seed = first; seed < first + n; seed++) {
        if (getenv("VERBOSE")) print_message("seed %llu\n", (unsigned long long)seed);
        try_seed(s, seed, shape);
    }
}

TEST(straight_code) {
    range_of_seeds(s, 1, 60, (RandomShape){.no_arrays = true, .no_loops = true, .no_ifs = true, .statements = 20});
}
TEST(ifs) { range_of_seeds(s, 1000, 60, (RandomShape){.no_arrays = true, .no_loops = true}); }
TEST(loops) { range_of_seeds(s, 2000, 80, (RandomShape){.no_arrays = true}); }
TEST(all) { range_of_seeds(s, 3000, 120, (RandomShape){0}); }
TEST(deep) { range_of_seeds(s, 4000, 20, (RandomShape){.depth = 5, .statements = 6}); }

static int not_vacuous(void **state) {
    (void)state;
    print_message(
        "compared with differences: %u, near a kink or jump: %u, programs with a tape: %u, checkpointed: %u, replayed: %u, in several levels: %u\n",
        compared, kinks, framed, checkpointed, replayed, deep_levels);
    return getenv("SEED") ||
                   (compared > 4 * kinks && framed > 50 && checkpointed > 10 && replayed > 100 && deep_levels > 10)
               ? 0
               : -1;
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(straight_code), cmocka_unit_test(ifs), cmocka_unit_test(loops),
                                       cmocka_unit_test(all), cmocka_unit_test(deep)};
    return cmocka_run_group_tests(tests, NULL, not_vacuous);
}
