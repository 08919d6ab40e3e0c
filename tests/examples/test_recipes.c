/* The commands of a README, run as they stand there, in a copy of the example's folder: fewer samples and iterations,
 * nothing else. The fit must get somewhere, and the derivatives at what it read must agree with finite differences. */
#include <stdbool.h>

#include "tests/scratch.h"

#define EXAMPLES SALTUS_TEST_DIR "/../examples"

typedef struct Recipe {
    const char *folder;
    int iters;
    double factor;     /* of the first loss: what the best must be below after so many iterations, and never is with
                          --interior-only */
    const char *check; /* arguments of `saltus check` after the commands */
} Recipe;

static const Recipe recipes[] = {
    {"shadow_art", 60, 0.1, "shadow.salt --param h=@rocks.exr --wrt h --samples 65536"},
    {"two_suns", 60, 0.33, "sign.salt --param h=@rough.exr --wrt h,skylight --samples 65536"},
    {"shadow_edit", 25, 0.4, "edit.salt --param h=@land.exr --wrt h,skylight --samples 65536"},
    {"glossy_edit", 20, 0.3, "lake.salt --param h=@land.exr --wrt h,rock --samples 65536"},
};
enum { RECIPES_N = sizeof recipes / sizeof *recipes };

static int set_up(void **state) { return access(SALTUS_BIN, X_OK) == 0 ? scratch_make(state) : -1; }

/* Runs `saltus ARGS` in the copy of an example's folder. */
static int run(char *out, size_t size, const char *folder, const char *arguments) {
    char line[4096];
    assert_true(snprintf(line, sizeof line, "cd '%s' && saltus %s", folder, arguments) < (int)sizeof line);
    return scratch_run(out, size, line);
}

/* One command of the README. Later options win, so that the cheaper ones go last. */
static void step(const Recipe *r, const char *arguments, bool *fitted) {
    char cheap[2048], iters[32], out[16384];
    bool fit = !strncmp(arguments, "fit ", 4);
    snprintf(iters, sizeof iters, "--iters %d", r->iters);
    /* What is only looked at needs one sample a pixel; what is read again keeps its own, within reason. */
    int n = snprintf(cheap, sizeof cheap, "%s %s", arguments,
                     fit                              ? iters
                     : strstr(arguments, ".png")      ? "--spp 1"
                     : strstr(arguments, "--spp 256") ? "--spp 16"
                                                      : "");
    assert_true(n > 0 && n < (int)sizeof cheap);
    if (run(out, sizeof out, r->folder, cheap) != 0 || strstr(out, ": warning:"))
        fail_msg("%s: saltus %s: %s", r->folder, cheap, out);
    if (!fit) return;
    double before = 0, after = 0;
    scratch_fit_losses(out, &before, &after);
    if (!(after < r->factor * before) || !(before > 0)) fail_msg("%s: %s", r->folder, out);
    *fitted = true;
}

static void test_recipes(void **state) {
    (void)state;
    for (int i = 0; i < RECIPES_N; i++) {
        const Recipe *r = &recipes[i];
        char line[4096], out[16384];
        snprintf(line, sizeof line, "mkdir '%s' && cp " EXAMPLES "/%s/*.salt " EXAMPLES "/%s/*.json '%s'", r->folder,
                 r->folder, r->folder, r->folder);
        assert_int_equal(scratch_run(out, sizeof out, line), 0);
        snprintf(line, sizeof line, EXAMPLES "/%s/README.md", r->folder);
        FILE *f = fopen(line, "r");
        assert_non_null(f);
        bool fitted = false;
        while (fgets(line, sizeof line, f)) {
            line[strcspn(line, "\n")] = 0;
            if (!strncmp(line, "saltus ", 7)) step(r, line + 7, &fitted);
        }
        fclose(f);
        assert_true(fitted);
        char check[1024];
        snprintf(check, sizeof check, "check %s", r->check);
        if (run(out, sizeof out, r->folder, check) != 0 || !strstr(out, "PASS"))
            fail_msg("%s: saltus %s: %s", r->folder, check, out);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_recipes),
    };
    return cmocka_run_group_tests(tests, set_up, scratch_drop);
}
