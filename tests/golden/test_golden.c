/* The IR of every kernel of small programs, after all passes, against NAME.ir beside NAME.salt. `BLESS=1 ctest -R
 * golden` rewrites the files; the diff is reviewed like code. Golden IR shows what changed, not whether it is right:
 * derivatives meet numbers in tests/ad and tests/sample. */
#include <dirent.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "bindings/c/api.h"
#include "runtime/image/image.h"
#include "tests/blessed.h"

static char *kernels_text(const char *path) {
    SltOptions opt = SLT_OPTIONS_INIT;
    opt.interpret = opt.verify = true;
    opt.target = "avx2"; /* the same contraction on every machine */
    SltProgram *p = NULL;
    if (slt_compile_file(path, &opt, &p) != SLT_OK) {
        print_error("%s: %s\n", path, p ? slt_diagnostics_text(p) : "out of memory");
        slt_program_free(p);
        return NULL;
    }
    bool needs[K_KINDS];
    for (int k = 0; k < K_KINDS; k++)
        needs[k] = k != K_JVP && k != K_SITE_JVP && k != K_EDGE && k != K_EDGE_BOUNDS && k != K_BOUNDS;
    SltError err = {0};
    char *text = NULL;
    size_t size;
    FILE *out = open_memstream(&text, &size);
    assert_non_null(out);
    if (api_kernels(p, needs, &err) == SLT_OK) {
        for (int k = 0; k < K_KINDS; k++) {
            if (!p->fn[k]) continue;
            fprintf(out, "; %s\n", kernel_names[k]);
            ir_print(p->fn[k], out);
        }
    } else {
        print_error("%s: %s\n", path, err.text);
    }
    fclose(out);
    slt_program_free(p);
    return text;
}

static void test_golden(void **state) {
    (void)state;
    const char *folder = SALTUS_TEST_DIR "/golden";
    DIR *d = opendir(folder);
    int files = 0, wrong = 0;
    assert_non_null(d);
    for (struct dirent *e; (e = readdir(d));) {
        size_t n = strlen(e->d_name);
        char path[1024], golden[1100];
        if (n < 6 || strcmp(e->d_name + n - 5, ".salt") != 0) continue;
        snprintf(path, sizeof path, "%s/%s", folder, e->d_name);
        snprintf(golden, sizeof golden, "%.*s.ir", (int)(strlen(path) - 5), path);
        char *got = kernels_text(path);
        SltError err = {0};
        uint8_t *want = NULL;
        size_t size;
        files++;
        if (!got) {
            wrong++;
        } else if (getenv("BLESS")) {
            assert_int_equal(file_write_atomic(golden, got, strlen(got), &err), SLT_OK);
        } else if (file_read_all(golden, &file_binary, &want, &size, &err) != SLT_OK) {
            print_error("%s\n", err.text);
            wrong++;
        } else if (!blessed_same_ir(golden, (const char *)want, got)) {
            wrong++;
        }
        free(want);
        free(got);
    }
    closedir(d);
    assert_true(files > 0);
    assert_int_equal(wrong, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_golden)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
