/* The policy table of docs/ad.md is the policy column of ops.def. BLESS=1 rewrites it. */
#include <setjmp.h>
#include <stdbool.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

static const char *const policies[][2] = {
#define FOP1(name, value, partials, bounds, events, range, cost, domain, lowering, policy) {#name, policy},
#define FOP2(name, value, partials, bounds, events, range, cost, domain, lowering, policy) {#name, policy},
#define FOP3(name, value, partials, bounds, events, range, cost, domain, lowering, policy) {#name, policy},
#define FCMP2(name, ...)
#define FSEL(name, ...)
#define IOP1(name, ...)
#define IOP2(name, ...)
#define ICMP2(name, ...)
#define BOP1(name, ...)
#define BOP2(name, ...)
#define CONV(name, ...)
#define SPECIAL(name, ...)
#include "compiler/ir/ops.def"
#include "compiler/ir/ops_undef.h"
};

static const char begin[] = "<!-- policy table: generated from compiler/ir/ops.def -->\n",
                  end[] = "<!-- end of policy table -->\n";

static char *read_all(const char *path) {
    FILE *f = fopen(path, "rb");
    assert_non_null(f);
    char *text = calloc(1, 1 << 20);
    size_t n = fread(text, 1, (1 << 20) - 1, f);
    text[n] = 0;
    fclose(f);
    return text;
}

static char *table(void) {
    char *text = calloc(1, 1 << 16);
    size_t at = (size_t)sprintf(text, "| operation | at kinks and poles |\n|---|---|\n");
    for (size_t k = 0; k < sizeof policies / sizeof *policies; k++)
        if (*policies[k][1]) at += (size_t)sprintf(text + at, "| `%s` | %s |\n", policies[k][0], policies[k][1]);
    return text;
}

static void documented(void **state) {
    (void)state;
    static const char path[] = SALTUS_TEST_DIR "/../docs/ad.md";
    char *doc = read_all(path), *want = table();
    char *from = strstr(doc, begin), *to = strstr(doc, end);
    assert_non_null(from);
    assert_non_null(to);
    from += sizeof begin - 1;
    bool same = (size_t)(to - from) == strlen(want) && !memcmp(from, want, strlen(want));
    if (!same && getenv("BLESS")) {
        FILE *f = fopen(path, "wb");
        assert_non_null(f);
        fprintf(f, "%.*s%s%s", (int)(from - doc), doc, want, to);
        fclose(f);
        same = true;
    }
    if (!same) print_error("docs/ad.md is out of date: run this test with BLESS=1\n");
    assert_true(same);
    free(doc), free(want);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(documented)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
