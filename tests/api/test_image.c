/* saltus/image.h, and slt_warning: what callers without the command need of it. */
#include "saltus/image.h"
#include "saltus/saltus.h"
#include "tests/scratch.h"

static const uint32_t two_by_one[2] = {2, 1};
static const float red_and_grey[6] = {1, 0, 0, 0.5f, 0.5f, 0.5f};

static void there_and_back(void **state) {
    (void)state;
    static const char *const names[] = {"a.exr", "a.npy", "a.pfm", "a.png"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        SltError err;
        uint32_t size[2] = {0}, channels = 0;
        float *pixels;
        assert_int_equal(slt_image_write(scratch_path(names[i]), false, two_by_one, 3, red_and_grey, &err), SLT_OK);
        assert_int_equal(slt_image_read(scratch_path(names[i]), false, size, &channels, &pixels, &err), SLT_OK);
        assert_int_equal(size[0], 2);
        assert_int_equal(size[1], 1);
        assert_int_equal(channels, 3);
        for (int k = 0; k < 6; k++) /* a step of 8 bits in sRGB is .004 at a half */
            assert_float_equal(pixels[k], red_and_grey[k], (strstr(names[i], "png") ? 0.004 : 0));
        free(pixels);
    }
}

static void raw_png_has_its_numbers(void **state) {
    (void)state;
    SltError err;
    uint32_t size[2] = {0}, channels = 1;
    float *pixels, half = 128 / 255.0f;
    assert_int_equal(slt_image_write(scratch_path("r.png"), true, (uint32_t[2]){1, 1}, 1, &half, &err), SLT_OK);
    assert_int_equal(slt_image_read(scratch_path("r.png"), true, size, &channels, &pixels, &err), SLT_OK);
    assert_float_equal(*pixels, half, 1e-6);
    free(pixels);
}

static void wishes(void **state) {
    (void)state;
    SltError err;
    uint32_t size[2] = {1, 1}, channels = 1;
    float *pixels;
    assert_int_equal(slt_image_write(scratch_path("w.exr"), false, two_by_one, 3, red_and_grey, &err), SLT_OK);
    assert_int_equal(slt_image_read(scratch_path("w.exr"), false, size, &channels, &pixels, &err), SLT_OK);
    assert_float_equal(*pixels, (0.2126 + 0.5) / 2, 1e-4); /* the mean of two luminances */
    free(pixels);
}

static void in_memory(void **state) {
    (void)state;
    SltError err;
    uint8_t *bytes;
    size_t n;
    assert_int_equal(slt_image_encode(".png", false, two_by_one, 3, red_and_grey, &bytes, &n, &err), SLT_OK);
    assert_memory_equal(bytes, "\x89PNG", 4);
    free(bytes);
    assert_int_equal(slt_image_encode_signed(0, "d/dr", two_by_one, 3, red_and_grey, &bytes, &n, &err), SLT_OK);
    assert_memory_equal(bytes, "\x89PNG", 4);
    free(bytes);
}

static void refusals(void **state) {
    (void)state;
    SltError err;
    uint8_t *bytes;
    size_t n;
    uint32_t size[2] = {0}, channels = 0;
    float *pixels;
    assert_int_equal(slt_image_read(scratch_path("none.png"), false, size, &channels, &pixels, &err), SLT_INPUT);
    assert_non_null(strstr(err.text, "none.png"));
    assert_null(pixels);
    assert_int_equal(slt_image_write(scratch_path("a.bmp"), false, two_by_one, 3, red_and_grey, &err), SLT_USAGE);
    assert_int_equal(slt_image_write("/nowhere/a.png", false, two_by_one, 3, red_and_grey, &err), SLT_OUTPUT);
    assert_int_equal(slt_image_write(scratch_path("a.png"), false, two_by_one, 5, red_and_grey, &err), SLT_USAGE);
    assert_int_equal(slt_image_write(scratch_path("a.png"), false, (uint32_t[2]){0, 1}, 3, red_and_grey, &err),
                     SLT_USAGE);
    assert_int_equal(slt_image_encode(".bmp", false, two_by_one, 3, red_and_grey, &bytes, &n, &err), SLT_USAGE);
    assert_int_equal(slt_image_encode(".a name that is much too long for any format", false, two_by_one, 3,
                                      red_and_grey, &bytes, &n, &err),
                     SLT_USAGE);
}

static void warnings(void **state) {
    (void)state;
    SltStats s = SLT_STATS_INIT;
    SltWarning w = SLT_WARNING_INIT;
    assert_false(slt_warning(&s, 0, &w));
    s.nonfinite = 3, s.asserts = 2;
    assert_true(slt_warning(&s, 0, &w));
    assert_string_equal(w.code, "nonfinite");
    assert_int_equal(w.severity, 2);
    assert_true(slt_warning(&s, 1, &w));
    assert_string_equal(w.code, "assert");
    assert_int_equal(w.severity, 1);
    assert_string_equal(w.text, "assert failed 2 times");
    assert_false(slt_warning(&s, 2, &w));
    w.struct_size = 0;
    assert_false(slt_warning(&s, 0, &w));
    assert_false(slt_warning(NULL, 0, &w));
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(there_and_back), cmocka_unit_test(raw_png_has_its_numbers),
                                       cmocka_unit_test(wishes),         cmocka_unit_test(in_memory),
                                       cmocka_unit_test(refusals),       cmocka_unit_test(warnings)};
    return cmocka_run_group_tests(tests, scratch_make, scratch_drop);
}
