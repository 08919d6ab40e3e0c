/* Decimals beside printf and strtod: what is printed is the shortest that reads back, and what is read is what strtod
 * reads. An argument is how many times more random numbers are looked at: with 35, ten million doubles. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <cmocka.h>
#include <float.h>
#include <locale.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/base/decimal.h"
#include "tests/scratch.h"

static uint64_t times = 1;

static uint64_t next(void) { /* splitmix64 */
    static uint64_t state;
    uint64_t z = state += UINT64_C(0x9e3779b97f4a7c15);
    z = (z ^ z >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ z >> 27) * UINT64_C(0x94d049bb133111eb);
    return z ^ z >> 31;
}

static double of_bits(uint64_t bits) {
    double v;
    memcpy(&v, &bits, sizeof v);
    return v;
}

static uint64_t bits_of(double v) {
    uint64_t bits;
    memcpy(&bits, &v, sizeof bits);
    return bits;
}

static unsigned digits_of(const char *text) {
    unsigned n = 0, zeros = 0;
    for (; *text && *text != 'e'; text++) {
        if (*text < '0' || *text > '9') continue;
        if (n || *text != '0') n++;
        zeros = *text == '0' ? zeros + 1 : 0;
    }
    return n > zeros ? n - zeros : 1;
}

static void reads_as_strtod(const char *text) {
    char *end;
    const char *after;
    double want = strtod(text, &end), got = decimal_read(text, &after);
    if (after != end) fail_msg("'%s' ends after %d, not %d", text, (int)(after - text), (int)(end - text));
    if (bits_of(got) != bits_of(want) && !(isnan(got) && isnan(want))) fail_msg("'%s' is %a, not %a", text, want, got);
}

/* `regular`: a number whose neighbours are equally far, of full precision. There the digits are those of printf. */
static void prints_shortest(double v, bool regular) {
    char text[DECIMAL_SIZE + 1], want[40], *end;
    int digits = regular ? 15 : 1;
    text[decimal_print(text, v)] = 0;
    if (bits_of(strtod(text, &end)) != bits_of(v) || *end) fail_msg("%a is printed as %s", v, text);
    for (; digits <= 17; digits++) {
        snprintf(want, sizeof want, "%.*g", digits, v);
        if (strtod(want, NULL) == v) break;
    }
    if (regular && strcmp(text, want) != 0) fail_msg("%a is printed as %s, not %s", v, text, want);
    if (digits_of(text) > digits_of(want)) fail_msg("%a is printed as %s, longer than %s", v, text, want);
    reads_as_strtod(text);
}

static void prints_shortest_f32(float v, bool regular) {
    char text[DECIMAL_SIZE + 1], want[40], *end;
    int digits = regular ? 6 : 1;
    text[decimal_print_f32(text, v)] = 0;
    float got = strtof(text, &end);
    if (memcmp(&got, &v, sizeof v) != 0 || *end) fail_msg("%a is printed as %s", (double)v, text);
    for (; digits <= 9; digits++) {
        snprintf(want, sizeof want, "%.*g", digits, (double)v);
        if (strtof(want, NULL) == v) break;
    }
    if (regular && strcmp(text, want) != 0) fail_msg("%a is printed as %s, not %s", (double)v, text, want);
    if (digits_of(text) > digits_of(want)) fail_msg("%a is printed as %s, longer than %s", (double)v, text, want);
}

static void powers(void **state) {
    (void)state;
    for (int e = -1074; e <= 1023; e++) {
        double v = ldexp(1, e);
        prints_shortest(v, false);
        prints_shortest(-v, false);
        prints_shortest(nextafter(v, 0), e > -1021);
        prints_shortest(nextafter(v, 1e308), e >= -1022);
        if (e >= -149 && e <= 127) prints_shortest_f32((float)v, false);
        if (e >= -149 && e <= 127) prints_shortest_f32(nextafterf((float)v, 0), e > -125);
    }
    char text[32];
    for (int e = -400; e <= 400; e++)
        for (int d = 1; d < 100; d += 7) {
            snprintf(text, sizeof text, "%de%d", d, e);
            reads_as_strtod(text);
            snprintf(text, sizeof text, "%d.e%+d", d, e);
            reads_as_strtod(text);
        }
}

static void random_doubles(void **state) {
    (void)state;
    char text[64];
    for (uint64_t i = 0; i < 100000 * times; i++) {
        uint64_t bits = next();
        double v = of_bits(bits);
        if (!isfinite(v)) continue;
        bool regular = fabs(v) >= DBL_MIN && (bits << 12) != 0;
        prints_shortest(v, regular);
        prints_shortest((double)(int64_t)bits * 0x1p-63, true);
        /* Few digits, as people type; 17, 18 and 19, as programs print; and more than there is room for. */
        snprintf(text, sizeof text, "%.*e", (int)(i % 6), v);
        reads_as_strtod(text);
        snprintf(text, sizeof text, "%.*e", 15 + (int)(i % 10), v);
        reads_as_strtod(text);
        double typed = (double)(int64_t)(bits % 2000000) / 1000.0;
        prints_shortest(typed, typed != 0 && (bits_of(typed) << 12) != 0);
    }
    for (uint64_t i = 0; i < 20000 * times; i++) prints_shortest(of_bits(next() >> (12 + i % 50)), false);
}

static void random_floats(void **state) {
    (void)state;
    for (uint64_t i = 1; i < 0x7f800000u; i += 8009 / times + 1) {
        uint32_t bits = (uint32_t)i;
        float v;
        memcpy(&v, &bits, sizeof v);
        prints_shortest_f32(i & 1 ? v : -v, v >= FLT_MIN && (bits << 9) != 0);
    }
}

/* The middle between two doubles, exactly, a little below and a little above; and the like among the smallest. */
static void ties(void **state) {
    (void)state;
    char text[1200];
    for (int i = 0; i < 20000; i++) {
        uint64_t bits = i % 4 == 0 ? next() >> (12 + i % 50) : next();
        /* Some with an exponent where a middle has few digits. */
        if (i % 4 == 1) bits = (bits & ((UINT64_C(1) << 52) - 1)) | (uint64_t)(1023 + 40 + i % 60) << 52;
        double v = fabs(of_bits(bits));
        if (!isfinite(v) || v >= DBL_MAX / 2 || v == 0) continue;
        int e;
        double part = frexp(v, &e), unit = ldexp(1, (e < -1021 ? -1074 : e - 53) - 1);
        (void)part;
        if (unit == 0) { /* half of the smallest: v + unit is not a long double of 64 bits everywhere */
            long double middle = (long double)v + (long double)0x1p-1075L;
            snprintf(text, sizeof text, "%.*Le", 780, middle);
        } else {
            snprintf(text, sizeof text, "%.*Le", 780, (long double)v + (long double)unit);
        }
        reads_as_strtod(text);
        char *exponent = strchr(text, 'e'), tail[16];
        snprintf(tail, sizeof tail, "%s", exponent);
        snprintf(exponent, (size_t)(text + sizeof text - exponent), "00001%s", tail);
        reads_as_strtod(text);
        snprintf(text, sizeof text, "%.18Le", (long double)v + (long double)unit);
        reads_as_strtod(text);
        snprintf(text, sizeof text, "%.0Lf", (long double)v + (long double)unit); /* all digits before the point */
        reads_as_strtod(text);
    }
}

static const char *const odd[] = {
    "0",
    "-0",
    "+0",
    "0.0",
    "-0e999",
    "00",
    "007",
    "1",
    "+1",
    "-1",
    "1.",
    ".5",
    "-.5",
    ".",
    "",
    "-",
    "+",
    "e5",
    ".e5",
    "1e",
    "1e+",
    "1e-",
    "1ex",
    "1e5x",
    "1e400",
    "-1e400",
    "1e-400",
    "1e999",
    "-1e999",
    "1e309",
    "1e308",
    "1.8e308",
    "1.7976931348623157e308",
    "1.7976931348623158e308",
    "1.7976931348623159e308",
    "4.9e-324",
    "2.4703282292062327e-324",
    "2.4703282292062328e-324",
    "2.5e-324",
    "2.2250738585072014e-308",
    "2.2250738585072011e-308",
    "2.225073858507201136057409796709131975934819546351645648023426109724822222021076945516529523908135087914149158913039"
    "6211068700864386945946455276572074078206217433799881410632673292535522868813721490129811224514518898490572223072852"
    "5513313556501591442747e-308",
    "0x1p3",
    "0X.8p1",
    "0x",
    "inf",
    "-inf",
    "infinity",
    "nan",
    "nan(12)",
    "NaN",
    " 1",
    "\t-2.5",
    "\n3",
    "1,5",
    "1.5,2",
    "1..2",
    "1.2.3",
    "--1",
    "+-1",
    "1e5.5",
    "123456789012345678",
    "1234567890123456789",
    "12345678901234567890",
    "123456789012345678901234567890",
    "9007199254740993",
    "9007199254740993.0000000000000000000000000000000000000000001",
    "9007199254740992.9999999999999999999999999999999",
    "0.000000000000000000000000000000000000000000000000000000000001",
    "100000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000e-50",
    "1e99999999999999999999",
    "1e-99999999999999999999",
    "0e99999999999999999999",
    "18446744073709551615",
    "18446744073709551616",
    "9999999999999999999",
    "9999999999999999999999e-4",
    "5e-324",
    "179769313486231580793e289"};

static void odd_texts(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof odd / sizeof *odd; i++) reads_as_strtod(odd[i]);
    char text[400];
    for (int zeros = 0; zeros < 360; zeros += 7) {
        snprintf(text, sizeof text, "0.%0*d", zeros + 1, 7);
        reads_as_strtod(text);
        snprintf(text, sizeof text, "3%0*de-%d", zeros + 1, 0, zeros);
        reads_as_strtod(text);
    }
}

/* Both signs of 0, whole numbers, and where the form changes. */
static void forms(void **state) {
    (void)state;
    static const struct {
        double v;
        const char *text;
    } list[] = {{0.0, "0"},
                {-0.0, "-0"},
                {1, "1"},
                {-10, "-10"},
                {100, "100"},
                {0.1, "0.1"},
                {1e-4, "0.0001"},
                {1.5e-5, "1.5e-05"},
                {123456, "123456"},
                {1e14, "100000000000000"},
                {1e15, "1e+15"},
                {1e22, "1e+22"},
                {1234567890123456, "1234567890123456"},
                {12345678901234568, "12345678901234568"},
                {123456789012345680, "1.2345678901234568e+17"},
                {5e-324, "5e-324"},
                {-2.5e100, "-2.5e+100"},
                {9007199254740992, "9007199254740992"},
                {1.0 / 3, "0.3333333333333333"},
                {2e-100, "2e-100"},
                {DBL_MAX, "1.7976931348623157e+308"},
                {DBL_MIN, "2.2250738585072014e-308"}};
    char text[DECIMAL_SIZE + 1];
    for (size_t i = 0; i < sizeof list / sizeof *list; i++) {
        text[decimal_print(text, list[i].v)] = 0;
        assert_string_equal(text, list[i].text);
    }
    text[decimal_print_f32(text, 0.1f)] = 0;
    assert_string_equal(text, "0.1");
    text[decimal_print_f32(text, 16777216.0f)] = 0;
    assert_string_equal(text, "16777216");
    text[decimal_print_f32(text, 1e6f)] = 0;
    assert_string_equal(text, "1e+06");
    text[decimal_print_f32(text, -FLT_MAX)] = 0;
    assert_string_equal(text, "-3.4028235e+38");
}

/* A host may have chosen a locale in which numbers have a comma: here one is made, where the system has the means. */
static void comma(void **state) {
    (void)state;
    char line[400];
    snprintf(line, sizeof line, "localedef -i de_DE -f ISO-8859-1 '%s' >'%s' 2>&1", scratch_path("de_DE"),
             scratch_path("log"));
    bool made = system(line) == 0;
    setenv("LOCPATH", scratch, 1);
    if (!setlocale(LC_NUMERIC, "de_DE") || strcmp(localeconv()->decimal_point, ",") != 0)
        print_message("%s\n", made ? "the locale cannot be chosen" : "no locale with a comma");
    char text[DECIMAL_SIZE + 1];
    const char *after;
    text[decimal_print(text, -1234.5)] = 0;
    assert_string_equal(text, "-1234.5");
    static const char *const points[] = {"1.5", "0x1.8p0", "1.50000000000000000000000000000000000000000001"};
    for (size_t i = 0; i < sizeof points / sizeof *points; i++) {
        assert_true(decimal_read(points[i], &after) == 1.5);
        assert_int_equal(*after, 0);
    }
    assert_true(decimal_read("1,5", &after) == 1);
    assert_int_equal(*after, ',');
    setlocale(LC_NUMERIC, "C");
}

int main(int argc, char **argv) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(forms), cmocka_unit_test(odd_texts),      cmocka_unit_test(powers),
        cmocka_unit_test(ties),  cmocka_unit_test(random_doubles), cmocka_unit_test(random_floats),
        cmocka_unit_test(comma),
    };
    if (argc > 1) times = strtoull(argv[1], NULL, 10);
    return cmocka_run_group_tests(tests, scratch_make, scratch_drop);
}
