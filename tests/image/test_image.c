/* Images: every format there and back, resizing, colour, pictures. */
#include <math.h>

#include "tests/scratch.h"

#include "runtime/image/image.h"

static void must(SltStatus status, const SltError *err) {
    if (status != SLT_OK) fail_msg("status %d: %s", status, err->text);
}

/* Awkward values: signed zero, denormals, infinities, NaN. */
static Image sample(int w, int h, int channels) {
    Image im;
    SltError err;
    must(image_create(&im, w, h, channels, &err), &err);
    size_t n = (size_t)w * (size_t)h * (size_t)channels;
    for (size_t i = 0; i < n; i++) im.data[i] = (float)sin((double)i * 0.37) * powf(10, (float)(i % 9) - 4);
    if (n >= 8) {
        im.data[0] = NAN;
        im.data[1] = INFINITY;
        im.data[2] = -INFINITY;
        im.data[3] = -0.0f;
        im.data[4] = 1e-42f;
        im.data[5] = 3.4e38f;
    }
    return im;
}

static void assert_same_bits(const Image *a, const Image *b) {
    char p[IMAGE_NAME_SIZE], q[IMAGE_NAME_SIZE];
    assert_int_equal(a->width, b->width);
    assert_int_equal(a->height, b->height);
    assert_int_equal(a->channels, b->channels);
    for (int c = 0; c < a->channels; c++) assert_string_equal(image_get_name(a, c, p), image_get_name(b, c, q));
    assert_memory_equal(a->data, b->data, sizeof(float) * (size_t)(a->width * a->height * a->channels));
}

static void round_trip(const char *file, int w, int h, int channels) {
    SltError err = {0};
    Image a = sample(w, h, channels), b;
    must(image_write(scratch_path(file), &a, NULL, &err), &err);
    must(image_read(scratch_path(file), NULL, &b, &err), &err);
    assert_same_bits(&a, &b);
    image_free(&a);
    image_free(&b);
}

static void exr_round_trip(void **state) {
    (void)state;
    static const int sizes[][2] = {{1, 1}, {7, 5}, {64, 33}, {300, 17}};
    for (int i = 0; i < 4; i++)
        for (int c = 1; c <= 4; c++) round_trip("a.exr", sizes[i][0], sizes[i][1], c);
}

/* Noise with less and less of it, so that some block compresses to exactly its own size. */
static void exr_noise(void **state) {
    (void)state;
    uint32_t seed = 1;
    for (int trial = 0; trial < 400; trial++) {
        Image im, back;
        SltError err;
        uint8_t *bytes;
        size_t size;
        must(image_create(&im, 16, 16, 1, &err), &err);
        for (int i = 0; i < 256 - trial / 16; i++) {
            seed = seed * 1664525u + 1013904223u;
            uint32_t bits = seed ^ seed >> 15;
            if ((bits >> 23 & 255) != 255) memcpy(&im.data[i], &bits, sizeof bits);
        }
        must(image_encode("noise.exr", &im, NULL, &bytes, &size, &err), &err);
        must(image_decode("noise.exr", bytes, size, NULL, &back, &err), &err);
        assert_memory_equal(im.data, back.data, 256 * sizeof *im.data);
        free(bytes);
        image_free(&im);
        image_free(&back);
    }
}

static void exr_layers_and_attributes(void **state) {
    (void)state;
    static const char *const names[] = {"R",
                                        "G",
                                        "B",
                                        "d.radius.R",
                                        "d.radius.G",
                                        "d.radius.B",
                                        "d.discs[3].centre.x.with_a_rather_long_name.R",
                                        "stderr.R",
                                        "crossings.Y"};
    SltError err = {0};
    Image a = sample(13, 21, 9), b, layer;
    for (int c = 0; c < 9; c++) image_set_name(&a, c, names[c]);
    assert_true(image_set_text(&a, "shader", "disc.salt"));
    assert_true(image_set_text(&a, "parameters", "{\"radius\": 0.4}"));
    assert_true(image_set_number(&a, "spp", 16));
    assert_true(image_set_number(&a, "seed", 4294967296.0));
    must(image_write(scratch_path("layers.exr"), &a, NULL, &err), &err);
    must(image_read(scratch_path("layers.exr"), NULL, &b, &err), &err);
    assert_int_equal(b.channels, 9);
    assert_string_equal(b.names[0], "R");
    assert_string_equal(b.names[1], "G");
    assert_string_equal(b.names[2], "B");
    for (int c = 0; c < 9; c++) { /* the file sorts its channels; find each by name */
        int at = image_find_channel(&b, names[c]);
        assert_true(at >= 0);
        for (int p = 0; p < 13 * 21; p++) assert_memory_equal(&a.data[p * 9 + c], &b.data[p * 9 + at], sizeof(float));
    }
    assert_string_equal(image_find_attr(&b, "shader")->text, "disc.salt");
    assert_string_equal(image_find_attr(&b, "parameters")->text, "{\"radius\": 0.4}");
    assert_true(image_find_attr(&b, "spp")->number == 16);
    assert_true(image_find_attr(&b, "seed")->number == 4294967296.0);
    must(image_extract_layer(&b, "d.radius", &layer, &err), &err);
    assert_int_equal(layer.channels, 3);
    assert_string_equal(layer.names[2], "B");
    assert_memory_equal(&layer.data[3 * 40 + 2], &a.data[40 * 9 + 5], sizeof(float));
    image_free(&layer);
    assert_int_equal(image_extract_layer(&b, "d.nothing", &layer, &err), SLT_INPUT);
    assert_non_null(strstr(err.text, "d.nothing"));
    image_set_name(&a, 1, "R");
    assert_int_equal(image_write(scratch_path("layers.exr"), &a, NULL, &err), SLT_USAGE);
    assert_non_null(strstr(err.text, "'R'"));
    image_free(&a);
    image_free(&b);
}

static void pfm_and_npy_round_trip(void **state) {
    (void)state;
    for (int i = 1; i < 20; i += 6) {
        round_trip("a.pfm", i, 8, 1);
        round_trip("a.pfm", 8, i, 3);
        for (int c = 1; c <= 5; c++) round_trip("a.npy", i, 9, c);
    }
}

static void png_round_trip(void **state) {
    (void)state;
    SltError err = {0};
    for (int c = 1; c <= 4; c++) {
        for (int wide = 0; wide < 2; wide++) {
            for (int raw = 0; raw < 2; raw++) {
                Image a, b, again;
                must(image_create(&a, 37, 11, c, &err), &err);
                for (int i = 0; i < 37 * 11 * c; i++) a.data[i] = (float)i / (37 * 11 * (float)c);
                ImageWriteOptions w = {.raw = raw, .bits = wide ? 16 : 8};
                ImageReadOptions r = {.raw = raw};
                must(image_write(scratch_path("a.png"), &a, &w, &err), &err);
                must(image_read(scratch_path("a.png"), &r, &b, &err), &err);
                assert_int_equal(b.channels, c);
                double worst = 0, bound = wide ? 3e-5 : 6e-3; /* half a step, times the steepest slope of sRGB */
                for (int i = 0; i < 37 * 11 * c; i++) worst = fmax(worst, fabs((double)a.data[i] - b.data[i]));
                assert_true(worst > 0 && worst < bound);
                /* what came from a PNG goes back into it without loss */
                must(image_write(scratch_path("b.png"), &b, &w, &err), &err);
                must(image_read(scratch_path("b.png"), &r, &again, &err), &err);
                assert_same_bits(&b, &again);
                image_free(&a);
                image_free(&b);
                image_free(&again);
            }
        }
    }
    Image odd = sample(3, 3, 3), back; /* NaN and infinities have no place in PNG but must not trap */
    must(image_write(scratch_path("odd.png"), &odd, NULL, &err), &err);
    must(image_read(scratch_path("odd.png"), NULL, &back, &err), &err);
    assert_true(back.data[0] == 0 && back.data[1] == 1 && back.data[2] == 0);
    image_free(&odd);
    image_free(&back);
}

static void png8_keeps_encoded_bytes(void **state) {
    (void)state;
    uint8_t pixels[4 * 256];
    SltError err = {0};
    Image im;
    for (int i = 0; i < 1024; i++) pixels[i] = (uint8_t)(i * 7);
    must(image_write_png8(scratch_path("rgba.png"), 16, 16, 4, pixels, &err), &err);
    ImageReadOptions raw = {.raw = true};
    must(image_read(scratch_path("rgba.png"), &raw, &im, &err), &err);
    assert_int_equal(im.channels, 4);
    for (int i = 0; i < 1024; i++) assert_int_equal((int)lrintf(im.data[i] * 255), pixels[i]);
    image_free(&im);
}

static void srgb(void **state) {
    (void)state;
    for (int i = 0; i < 256; i++)
        assert_int_equal(lrintf(image_encode_srgb(image_decode_srgb((float)i / 255)) * 255), i);
    assert_true(fabs(image_decode_srgb(0.5f) - 0.21404114) < 1e-6);
    assert_true(fabs(image_encode_srgb(0.18f) - 0.46135613) < 1e-6);
    assert_true(image_encode_srgb(NAN) == 0 && image_encode_srgb(-3) == 0 && image_encode_srgb(9) == 1);
}

static void pfm_both_endians(void **state) {
    (void)state;
    SltError err = {0};
    Image im;
    /* 1 x 2: the first row in the file is the bottom one */
    static const uint8_t big[] = "Pf\n1 2\n1.0\n\x3f\x80\x00\x00\x40\x00\x00\x00";
    static const uint8_t little[] = "Pf 1 2 -1\n\x00\x00\x80\x3f\x00\x00\x00\x40";
    must(image_decode("b.pfm", big, sizeof big - 1, NULL, &im, &err), &err);
    assert_true(im.data[0] == 2 && im.data[1] == 1);
    image_free(&im);
    must(image_decode("l.PFM", little, sizeof little - 1, NULL, &im, &err), &err);
    assert_true(im.data[0] == 2 && im.data[1] == 1);
    image_free(&im);
}

static size_t build_npy(uint8_t *to, const char *dict, const void *data, size_t size) {
    size_t n = strlen(dict);
    memcpy(to, "\x93NUMPY\x01\x00", 8);
    to[8] = (uint8_t)n;
    to[9] = 0;
    memcpy(to + 10, dict, n);
    memcpy(to + 10 + n, data, size);
    return 10 + n + size;
}

static void npy_types(void **state) {
    (void)state;
    uint8_t file[512];
    SltError err = {0};
    NumArray a;
    static const struct {
        const char *dict;
        const char *bytes;
        size_t size;
        double want[3];
    } cases[] = {
        {"{'descr': '<i2', 'fortran_order': False, 'shape': (3,), }", "\xff\xff\x00\x01\x02\x00", 6, {-1, 256, 2}},
        {"{'descr': '>i2', 'fortran_order': False, 'shape': (3,), }", "\xff\xff\x00\x01\x02\x00", 6, {-1, 1, 512}},
        {"{'descr': '|u1', 'fortran_order': False, 'shape': (3,), }", "\xff\x00\x7f", 3, {255, 0, 127}},
        {"{'descr': '|i1', 'fortran_order': False, 'shape': (3,), }", "\xff\x80\x7f", 3, {-1, -128, 127}},
        {"{'descr': '|b1', 'fortran_order': False, 'shape': (3,), }", "\x01\x00\x01", 3, {1, 0, 1}},
        {"{'descr': '<f2', 'fortran_order': False, 'shape': (3,), }",
         "\x00\x3c\x01\x00\x00\xc4",
         6,
         {1, 5.9604644775390625e-08, -4}},
        {"{\"shape\": (3,), \"fortran_order\": False, \"descr\": \"<i8\"}",
         "\xff\xff\xff\xff\xff\xff\xff\xff\1\0\0\0\0\0\0\0\0\0\0\0\1\0\0\0",
         24,
         {-1, 1, 4294967296.0}},
        {"{'descr': '<u4', 'fortran_order': False, 'shape': (3,), }",
         "\xff\xff\xff\xff\1\0\0\0\2\0\0\0",
         12,
         {4294967295.0, 1, 2}},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        size_t n = build_npy(file, cases[i].dict, cases[i].bytes, cases[i].size);
        must(npy_decode("t.npy", file, n, &a, &err), &err);
        assert_int_equal(a.rank, 1);
        assert_int_equal(a.shape[0], 3);
        for (int k = 0; k < 3; k++) assert_true(a.data[k] == cases[i].want[k]);
        npy_free(&a);
    }
    /* Fortran order of [[0 1 2] [3 4 5]] is 0 3 1 4 2 5 */
    size_t n = build_npy(file, "{'descr': '|u1', 'fortran_order': True, 'shape': (2, 3), }", "\0\3\1\4\2\5", 6);
    must(npy_decode("t.npy", file, n, &a, &err), &err);
    for (int k = 0; k < 6; k++) assert_true(a.data[k] == k);
    npy_free(&a);
    Image im;
    must(image_decode("t.npy", file, n, NULL, &im, &err), &err);
    assert_int_equal(im.width, 3);
    assert_int_equal(im.height, 2);
    assert_true(im.data[4] == 4);
    image_free(&im);
    static const char *const bad[] = {"{'descr': '<c8', 'fortran_order': False, 'shape': (3,), }",
                                      "{'descr': '|O', 'fortran_order': False, 'shape': (3,), }",
                                      "{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (3,), }",
                                      "{'descr': '<f4', 'fortran_order': False, 'shape': (1,1,1,1,1), }",
                                      "{'descr': '<f4', 'fortran_order': False, 'shape': (0, 4), }",
                                      "{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999, 99999999999), }",
                                      "{'descr': '<f4', 'fortran_order': False}",
                                      "{'descr': '<f4', 'shape': (1,), 'fortran_order': Maybe}",
                                      "{}",
                                      "{",
                                      ""};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        n = build_npy(file, bad[i], "\0\0\0\0", 4);
        assert_int_not_equal(npy_decode("bad.npy", file, n, &a, &err), SLT_OK);
        assert_non_null(strstr(err.text, "bad.npy"));
        assert_null(a.data);
    }
}

static void npy_write_ranks(void **state) {
    (void)state;
    SltError err = {0};
    double data[24];
    for (int i = 0; i < 24; i++) data[i] = 1.0 / (i + 1);
    static const size_t shapes[4][4] = {{24}, {4, 6}, {2, 3, 4}, {2, 3, 2, 2}};
    for (int rank = 1; rank <= 4; rank++) {
        NumArray a;
        must(npy_write(scratch_path("r.npy"), rank, shapes[rank - 1], data, true, &err), &err);
        must(npy_read(scratch_path("r.npy"), &a, &err), &err);
        assert_int_equal(a.rank, rank);
        assert_memory_equal(a.data, data, sizeof data);
        for (int d = 0; d < rank; d++) assert_int_equal(a.shape[d], shapes[rank - 1][d]);
        npy_free(&a);
    }
}

static void raw_floats(void **state) {
    (void)state;
    SltError err = {0};
    Image im;
    float data[12];
    for (int i = 0; i < 12; i++) data[i] = (float)i - 5.5f;
    must(image_decode("dir_9x9/h_4x3.f32", data, sizeof data, NULL, &im, &err), &err);
    assert_true(im.width == 4 && im.height == 3 && im.channels == 1);
    assert_memory_equal(im.data, data, sizeof data);
    image_free(&im);
    must(image_decode("h_2x2x3.f32", data, sizeof data, NULL, &im, &err), &err);
    assert_true(im.width == 2 && im.height == 2 && im.channels == 3);
    image_free(&im);
    static const char *const bad[] = {"h_4x4.f32",           "h.f32",      "h_4.f32", "h_4x.f32", "h_0x0.f32",
                                      "h_999999x999999.f32", "h_-4x-3.f32"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        assert_int_not_equal(image_decode(bad[i], data, sizeof data, NULL, &im, &err), SLT_OK);
}

static void tables(void **state) {
    (void)state;
    SltError err = {0};
    Table t;
    static const char *const good[] = {"1,2,3\n4,5,6\n", "# comment\nx,y,z\n1;2;3\n\n4;5;6",
                                       "\xef\xbb\xbf\"a\",\"b\",\"c\"\r\n1.0, 2, 3\r\n4e0,+5,6.000 # tail\r\n",
                                       "1\t2\t3\n  4\t5 6\n", "1,2,3,\n4,5,6,\n"};
    for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
        must(table_decode_csv("t.csv", good[i], strlen(good[i]), &t, &err), &err);
        assert_int_equal(t.rows, 2);
        assert_int_equal(t.cols, 3);
        for (int k = 0; k < 6; k++) assert_true(t.data[k] == k + 1);
        table_free(&t);
    }
    must(table_decode_csv("t.csv", "nan -inf 0.1\n", 13, &t, &err), &err);
    assert_true(isnan(t.data[0]) && t.data[1] == -INFINITY && t.data[2] == 0.1);
    table_free(&t);
    static const struct {
        const char *text, *says;
    } bad[] = {{"1,2\n3\n", "line 2"}, {"1,2\n3,x\n", "'x'"},   {"1,,2\n", "column 2"},
               {"", "no numbers"},     {"a,b\n", "no numbers"}, {"a,b\nc,d\n", "line 2"},
               {"1,2abc\n", "2abc"},   {"a,1\n", "'a'"},        {"0x10,1\n", "0x10"}};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_int_equal(table_decode_csv("t.csv", bad[i].text, strlen(bad[i].text), &t, &err), SLT_INPUT);
        if (!strstr(err.text, bad[i].says) || !strstr(err.text, "t.csv")) fail_msg("case %zu: %s", i, err.text);
    }
    assert_int_equal(table_decode_csv("t.csv", "1\0002", 3, &t, &err), SLT_INPUT);
    size_t shape[3] = {2, 2, 3};
    double data[12] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11};
    must(npy_write(scratch_path("t.npy"), 3, shape, data, false, &err), &err);
    must(table_read(scratch_path("t.npy"), &t, &err), &err);
    assert_true(t.rows == 2 && t.cols == 6 && t.data[11] == 11);
    table_free(&t);
}

static void resize(void **state) {
    (void)state;
    SltError err = {0};
    Image a, b;
    must(image_create(&a, 40, 30, 2, &err), &err);
    double sum = 0;
    for (int i = 0; i < 40 * 30; i++) {
        a.data[2 * i] = (float)(i % 40); /* a ramp in x */
        a.data[2 * i + 1] = (float)(i % 17);
        sum += a.data[2 * i + 1];
    }
    must(image_resize(&a, 8, 11, &b, &err), &err);
    double mean = 0;
    for (int i = 0; i < 88; i++) {
        mean += b.data[2 * i + 1] / 88;
        /* the mean of a ramp over a cell is its value in the middle */
        assert_true(fabs(b.data[2 * i] - ((i % 8 + 0.5) * 5 - 0.5)) < 1e-5);
    }
    assert_true(fabs(mean - sum / 1200) < 1e-5);
    image_free(&b);
    must(image_resize(&a, 160, 30, &b, &err), &err);
    for (int x = 2; x < 158; x++) /* and bilinear keeps it */
        assert_true(fabs(b.data[2 * x] - ((x + 0.5) / 4 - 0.5)) < 1e-5);
    assert_true(b.data[0] == 0 && b.data[2 * 159] == 39);
    image_free(&b);
    must(image_resize(&a, 40, 30, &b, &err), &err);
    assert_memory_equal(a.data, b.data, 40 * 30 * 2 * sizeof(float));
    image_free(&b);
    assert_int_equal(image_resize(&a, 0, 5, &b, &err), SLT_USAGE);
    assert_int_equal(image_resize(&a, 1 << 19, 1 << 19, &b, &err), SLT_LIMIT);
    image_free(&a);
}

static void channels_and_strip(void **state) {
    (void)state;
    SltError err = {0};
    Image a, b, strip;
    must(image_create(&a, 2, 1, 3, &err), &err);
    float rgb[6] = {1, 0, 0, 0, 1, 0.5f};
    memcpy(a.data, rgb, sizeof rgb);
    must(image_convert_channels(&a, 1, &b, &err), &err);
    assert_true(fabs(b.data[0] - 0.2126) < 1e-6 && fabs(b.data[1] - 0.7513) < 1e-6);
    image_free(&b);
    must(image_convert_channels(&a, 4, &b, &err), &err);
    assert_true(b.data[3] == 1 && b.data[6] == 0.5f && b.data[7] == 1);
    image_free(&b);
    must(image_create(&b, 1, 3, 3, &err), &err);
    const Image *const two[] = {&a, &b};
    must(image_film_strip(two, 2, 1, &strip, &err), &err);
    assert_true(strip.width == 4 && strip.height == 3);
    assert_true(strip.data[0] == 1 && strip.data[1] == 0 && strip.data[2 * 3] == 1 && strip.data[3 * 3] == 0);
    assert_true(strip.data[4 * 3] == 1); /* below the shorter image it is white */
    image_free(&strip);
    image_free(&b);
    /* What has its channels already is not copied; what has others, or in another order, is. */
    const float *was = a.data;
    must(image_take_channels(&a, 3, &b, &err), &err);
    assert_true(b.data == was && !a.data);
    image_set_name(&b, 0, "B"), image_set_name(&b, 2, "R");
    must(image_take_channels(&b, 3, &a, &err), &err);
    assert_true(!b.data && a.data[0] == 0 && a.data[2] == 1 && a.data[3] == 0.5f);
    must(image_take_channels(&a, 1, &b, &err), &err);
    assert_true(!a.data && b.channels == 1);
    must(image_convert_channels(&b, 2, &a, &err), &err);
    image_free(&b), was = a.data;
    must(image_take_channels(&a, 2, &b, &err), &err);
    assert_true(b.data == was);
    assert_int_equal(image_take_channels(&b, 5, &a, &err), SLT_USAGE);
    assert_true(!b.data);
}

static void diverging_picture(void **state) {
    (void)state;
    uint8_t lo[3], mid[3], hi[3], nan[3];
    SltError err = {0};
    Image im;
    colormap_diverging(-1, lo);
    colormap_diverging(0, mid);
    colormap_diverging(1, hi);
    colormap_diverging(NAN, nan);
    assert_true(lo[2] > lo[0] && hi[0] > hi[2] && mid[0] > 240 && mid[1] > 240 && mid[2] > 240);
    assert_true(nan[0] == 255 && nan[1] == 0 && nan[2] == 255);
    must(image_create(&im, 300, 40, 1, &err), &err);
    for (int i = 0; i < 300 * 40; i++) im.data[i] = (float)(i % 300 - 150) / 150 * 2.5f;
    im.data[5] = NAN;
    uint8_t *rgb;
    int w, h;
    must(image_draw_diverging(&im, 0, 0, "d.radius.Y", &rgb, &w, &h, &err), &err);
    assert_int_equal(w, 300);
    assert_true(h > 60);
    assert_memory_equal(rgb, lo, 3);
    assert_memory_equal(rgb + 15, nan, 3);
    assert_memory_equal(rgb + 150 * 3, mid, 3);
    int ink = 0; /* the printed scale and title */
    for (int i = 300 * 50; i < w * h; i++) ink += rgb[3 * i] == 40 && rgb[3 * i + 1] == 40;
    assert_true(ink > 100);
    free(rgb);
    must(image_write_diverging(scratch_path("d.png"), &im, -1, 1.0, NULL, &err), &err);
    assert_int_equal(image_draw_diverging(&im, 3, 0, NULL, &rgb, &w, &h, &err), SLT_USAGE);
    image_free(&im);
}

static void plot(void **state) {
    (void)state;
    SltError err = {0};
    double x[8], y[8], e[8];
    for (int i = 0; i < 8; i++) {
        x[i] = pow(4, i);
        y[i] = i == 3 ? NAN : 1e-2 / x[i];
        e[i] = y[i] * 0.3;
    }
    PlotSeries s[2] = {{.name = "lattice <&>", .x = x, .y = y, .error = e, .count = 8},
                       {.name = "slope -1", .x = x, .y = y, .count = 8, .dashed = true}};
    PlotOptions o = {
        .title = "error against time", .x_label = "samples", .y_label = "error", .log_x = true, .log_y = true};
    char *svg = plot_svg(&o, s, 2, &err);
    assert_non_null(svg);
    assert_non_null(strstr(svg, "lattice &lt;&amp;&gt;"));
    assert_non_null(strstr(svg, "</svg>"));
    assert_null(strstr(svg, "nan"));
    assert_null(strstr(svg, "inf"));
    free(svg);
    /* a curve between 0.0016 and 0.06, as of a fit: more than the one power of ten is beside it */
    double loss[2] = {0.06, 0.0016};
    PlotSeries fit[1] = {{.x = x, .y = loss, .count = 2}};
    svg = plot_svg(&(PlotOptions){.log_y = true}, fit, 1, &err);
    assert_non_null(svg);
    assert_non_null(strstr(svg, ">0.002<"));
    assert_non_null(strstr(svg, ">0.05<"));
    free(svg);
    double few[2] = {0.003, 0.06}; /* one power of ten between them is not enough to read values by */
    PlotSeries falls = {.x = x, .y = few, .count = 2};
    svg = plot_svg(&(PlotOptions){.log_y = true}, &falls, 1, &err);
    assert_non_null(svg);
    assert_true(strstr(svg, ">0.005<") && strstr(svg, ">0.01<") && strstr(svg, ">0.02<") && !strstr(svg, ">0.03<"));
    free(svg);
    double flat[2] = {3, 3}, zero[2] = {0, 0};
    PlotSeries odd[1] = {{.x = flat, .y = zero, .count = 2}};
    PlotOptions modes[3] = {
        {.log_x = false}, {.log_x = true, .log_y = true}, {.log_x = true, .width = 10, .height = 10}};
    for (int i = 0; i < 3; i++) {
        svg = plot_svg(&modes[i], odd, i == 1 ? 0 : 1, &err);
        assert_non_null(svg);
        assert_null(strstr(svg, "nan"));
        free(svg);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(exr_round_trip),
        cmocka_unit_test(exr_layers_and_attributes),
        cmocka_unit_test(exr_noise),
        cmocka_unit_test(pfm_and_npy_round_trip),
        cmocka_unit_test(png_round_trip),
        cmocka_unit_test(png8_keeps_encoded_bytes),
        cmocka_unit_test(srgb),
        cmocka_unit_test(pfm_both_endians),
        cmocka_unit_test(npy_types),
        cmocka_unit_test(npy_write_ranks),
        cmocka_unit_test(raw_floats),
        cmocka_unit_test(tables),
        cmocka_unit_test(resize),
        cmocka_unit_test(channels_and_strip),
        cmocka_unit_test(diverging_picture),
        cmocka_unit_test(plot),
    };
    return cmocka_run_group_tests(tests, scratch_make, scratch_drop);
}
