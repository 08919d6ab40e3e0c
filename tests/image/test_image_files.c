/* Images from elsewhere and from nowhere good: foreign EXR layouts, truncated and flipped files,
 * limits, full disks. */
#include <dirent.h>
#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "tests/scratch.h"

#if defined(__has_include) && __has_include(<openexr.h>)
#include <openexr.h>
#else
#include <OpenEXR/openexr.h>
#endif

#include <png.h>
#include <zlib.h>

#include "runtime/image/image.h"

static void must(SltStatus status, const SltError *err) {
    if (status != SLT_OK) fail_msg("status %d: %s", status, err->text);
}

/* A file as another program might write it. */
typedef struct Foreign {
    int width, height, x0, y0; /* data window */
    int display[4];            /* min x, min y, max x, max y; all zero: as the data window */
    exr_storage_t storage;
    exr_compression_t compression;
    exr_pixel_type_t type;
    const char *channels[6];
    int sampling;
    int parts;
    int shift; /* of each part's data window from that of the part before it */
} Foreign;

enum { TILE = 16 };

static void check(exr_result_t rc) {
    if (rc != EXR_ERR_SUCCESS) fail_msg("while making a file: %s", exr_get_default_error_message(rc));
}

/* Channel c of pixel (x, y): a whole number below 2048, exact in half, float and uint. */
static unsigned value_of(int part, int c, int x, int y) {
    return (unsigned)(part * 700 + c * 300 + x * 7 + y * 3) % 2048;
}

static uint16_t to_half(unsigned v) { /* whole numbers up to 2048 */
    int e = 0;
    if (v == 0) return 0;
    while ((v << e) < 1024) e++;
    return (uint16_t)((25 - e) << 10 | ((v << e) & 1023));
}

static void fill(void *to, const Foreign *f, int part, int c, int w, int h, int x0, int y0) {
    for (int i = 0; i < w * h; i++) {
        unsigned v = value_of(part, c, x0 + i % w, y0 + i / w);
        if (f->type == EXR_PIXEL_HALF) ((uint16_t *)to)[i] = to_half(v);
        else if (f->type == EXR_PIXEL_UINT) ((uint32_t *)to)[i] = v;
        else ((float *)to)[i] = (float)v;
    }
}

static void encode_chunk(exr_context_t ctx, const Foreign *f, int part, exr_chunk_info_t *info, int x0, int y0) {
    exr_encode_pipeline_t pipe = EXR_ENCODE_PIPELINE_INITIALIZER;
    check(exr_encoding_initialize(ctx, part, info, &pipe));
    void *buffers[8] = {0};
    for (int k = 0; k < pipe.channel_count; k++) {
        exr_coding_channel_info_t *c = &pipe.channels[k];
        buffers[k] = calloc((size_t)c->width * (size_t)c->height + 1, 4);
        fill(buffers[k], f, part, k, c->width, c->height, x0, y0);
        c->user_pixel_stride = (uint8_t)c->bytes_per_element;
        c->user_line_stride = (uint8_t)c->bytes_per_element * c->width;
        c->encode_from_ptr = buffers[k];
    }
    check(exr_encoding_choose_default_routines(ctx, part, &pipe));
    check(exr_encoding_run(ctx, part, &pipe));
    check(exr_encoding_destroy(ctx, &pipe));
    for (int k = 0; k < 8; k++) free(buffers[k]);
}

static void write_foreign(const char *path, const Foreign *f) {
    exr_context_t ctx;
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
    exr_attr_box2i_t data, display;
    exr_attr_v2f_t centre;
    memset(&centre, 0, sizeof centre);
    data.min.x = f->x0;
    data.min.y = f->y0;
    data.max.x = f->x0 + f->width - 1;
    data.max.y = f->y0 + f->height - 1;
    display = data;
    int parts = f->parts ? f->parts : 1;
    if (f->display[2] > f->display[0]) {
        display.min.x = f->display[0];
        display.min.y = f->display[1];
        display.max.x = f->display[2];
        display.max.y = f->display[3];
    }
    check(exr_start_write(&ctx, path, EXR_WRITE_FILE_DIRECTLY, &init));
    for (int p = 0; p < parts; p++) {
        static const char *const names[] = {"left", "right"};
        int index;
        check(exr_add_part(ctx, names[p], f->storage, &index));
        exr_attr_box2i_t own = data;
        own.min.x += p * f->shift, own.max.x += p * f->shift, own.min.y += p * f->shift, own.max.y += p * f->shift;
        check(exr_initialize_required_attr(ctx, p, &display, &own, 1, &centre, 1, EXR_LINEORDER_INCREASING_Y,
                                           f->compression));
        if (f->storage == EXR_STORAGE_TILED || f->storage == EXR_STORAGE_DEEP_TILED)
            check(exr_set_tile_descriptor(ctx, p, TILE, TILE, EXR_TILE_ONE_LEVEL, EXR_TILE_ROUND_DOWN));
        for (int c = 0; c < 6 && f->channels[c]; c++) {
            int s = c == 1 && f->sampling ? f->sampling : 1;
            check(exr_add_channel(ctx, p, f->channels[c], f->type, EXR_PERCEPTUALLY_LOGARITHMIC, s, s));
        }
    }
    check(exr_write_header(ctx));
    for (int p = 0; p < parts && f->storage == EXR_STORAGE_SCANLINE; p++) {
        int lines;
        check(exr_get_scanlines_per_chunk(ctx, p, &lines));
        for (int y = 0; y < f->height; y += lines) {
            exr_chunk_info_t info;
            check(exr_write_scanline_chunk_info(ctx, p, f->y0 + p * f->shift + y, &info));
            encode_chunk(ctx, f, p, &info, 0, y);
        }
    }
    for (int p = 0; p < parts && f->storage == EXR_STORAGE_TILED; p++) {
        for (int ty = 0; ty * TILE < f->height; ty++) {
            for (int tx = 0; tx * TILE < f->width; tx++) {
                exr_chunk_info_t info;
                check(exr_write_tile_chunk_info(ctx, p, tx, ty, 0, 0, &info));
                encode_chunk(ctx, f, p, &info, tx * TILE, ty * TILE);
            }
        }
    }
    exr_result_t rc = exr_finish(&ctx);
    if (f->storage == EXR_STORAGE_SCANLINE || f->storage == EXR_STORAGE_TILED) check(rc);
}

/* In the file channels are sorted: A B G R. */
static void expect_rgba(const char *path, const Foreign *f, double tolerance) {
    Image im;
    SltError err = {0};
    static const int sorted_index[4] = {3, 2, 1, 0};
    must(image_read(path, NULL, &im, &err), &err);
    assert_int_equal(im.width, f->width);
    assert_int_equal(im.height, f->height);
    assert_int_equal(im.channels, 4);
    assert_string_equal(im.names[0], "R");
    assert_string_equal(im.names[3], "A");
    for (int y = 0; y < im.height; y++) {
        for (int x = 0; x < im.width; x++) {
            for (int c = 0; c < 4; c++) {
                double want = value_of(0, sorted_index[c], x, y), got = im.data[(y * im.width + x) * 4 + c];
                if (!(fabs(got - want) <= tolerance * 2048)) {
                    fail_msg("compression %d storage %d type %d at %d %d channel %d: %g, want %g", f->compression,
                             f->storage, f->type, x, y, c, got, want);
                }
            }
        }
    }
    image_free(&im);
}

static const exr_compression_t lossless[] = {EXR_COMPRESSION_NONE, EXR_COMPRESSION_RLE, EXR_COMPRESSION_ZIPS,
                                             EXR_COMPRESSION_ZIP, EXR_COMPRESSION_PIZ};

static void exr_layouts(void **state) {
    (void)state;
    for (size_t c = 0; c < 5; c++) {
        for (int tiled = 0; tiled < 2; tiled++) {
            for (int type = 0; type < 3; type++) {
                Foreign f = {.width = 37,
                             .height = 41,
                             .x0 = -5,
                             .y0 = 9,
                             .compression = lossless[c],
                             .storage = tiled ? EXR_STORAGE_TILED : EXR_STORAGE_SCANLINE,
                             .type = (exr_pixel_type_t)type,
                             .channels = {"R", "G", "B", "A"}};
                write_foreign(scratch_path("f.exr"), &f);
                expect_rgba(scratch_path("f.exr"), &f, 0);
            }
        }
    }
    Foreign lossy = {.width = 37,
                     .height = 41,
                     .compression = EXR_COMPRESSION_PXR24,
                     .type = EXR_PIXEL_FLOAT,
                     .storage = EXR_STORAGE_SCANLINE,
                     .channels = {"R", "G", "B", "A"}};
    write_foreign(scratch_path("f.exr"), &lossy);
    expect_rgba(scratch_path("f.exr"), &lossy, 1e-4);
    lossy.compression = EXR_COMPRESSION_B44;
    lossy.type = EXR_PIXEL_HALF;
    write_foreign(scratch_path("f.exr"), &lossy);
    expect_rgba(scratch_path("f.exr"), &lossy, 0.2);
}

static void exr_windows(void **state) {
    (void)state;
    SltError err = {0};
    Image im;
    Foreign f = {.width = 8,
                 .height = 6,
                 .x0 = 2,
                 .y0 = 3,
                 .display = {0, 0, 11, 11},
                 .type = EXR_PIXEL_FLOAT,
                 .storage = EXR_STORAGE_SCANLINE,
                 .compression = EXR_COMPRESSION_ZIP,
                 .channels = {"Y"}};
    write_foreign(scratch_path("w.exr"), &f);
    must(image_read(scratch_path("w.exr"), NULL, &im, &err), &err);
    assert_true(im.width == 12 && im.height == 12 && im.channels == 1);
    assert_true(im.data[0] == 0 && im.data[3 * 12 + 1] == 0);
    assert_true(im.data[3 * 12 + 2] == value_of(0, 0, 0, 0) && im.data[8 * 12 + 9] == value_of(0, 0, 7, 5));
    image_free(&im);
    memcpy(f.display, (int[4]){4, 5, 6, 40}, sizeof f.display); /* overscan left, right and above */
    write_foreign(scratch_path("w.exr"), &f);
    must(image_read(scratch_path("w.exr"), NULL, &im, &err), &err);
    assert_true(im.width == 3 && im.height == 36);
    assert_true(im.data[0] == value_of(0, 0, 2, 2) && im.data[3 * 3 + 2] == value_of(0, 0, 4, 5) &&
                im.data[4 * 3] == 0);
    image_free(&im);
    memcpy(f.display, (int[4]){100, 100, 120, 120}, sizeof f.display);
    write_foreign(scratch_path("w.exr"), &f);
    assert_int_equal(image_read(scratch_path("w.exr"), NULL, &im, &err), SLT_INPUT);
    memcpy(f.display, (int[4]){0, 0, 900000, 900000}, sizeof f.display);
    write_foreign(scratch_path("w.exr"), &f);
    assert_int_equal(image_read(scratch_path("w.exr"), NULL, &im, &err), SLT_LIMIT);
    assert_null(im.data);
}

/* Each part where its window says, in the display window of the first. */
static void exr_windows_of_parts(void **state) {
    (void)state;
    SltError err = {0};
    for (int tiled = 0; tiled < 2; tiled++) {
        Image im;
        Foreign f = {.width = 20,
                     .height = 18,
                     .x0 = 1,
                     .y0 = 2,
                     .display = {0, 0, 25, 25},
                     .storage = tiled ? EXR_STORAGE_TILED : EXR_STORAGE_SCANLINE,
                     .compression = EXR_COMPRESSION_ZIP,
                     .type = EXR_PIXEL_FLOAT,
                     .parts = 2,
                     .shift = 3,
                     .channels = {"Y"}};
        write_foreign(scratch_path("pw.exr"), &f);
        must(image_read(scratch_path("pw.exr"), NULL, &im, &err), &err);
        assert_true(im.width == 26 && im.height == 26 && im.channels == 2);
        for (int y = 0; y < 26; y++)
            for (int x = 0; x < 26; x++)
                for (int p = 0; p < 2; p++) {
                    int u = x - 1 - 3 * p, v = y - 2 - 3 * p;
                    bool inside = u >= 0 && u < 20 && v >= 0 && v < 18;
                    assert_true(im.data[(y * 26 + x) * 2 + p] == (inside ? (float)value_of(p, 0, u, v) : 0));
                }
        image_free(&im);
    }
}

static void exr_parts_and_refusals(void **state) {
    (void)state;
    SltError err = {0};
    Image im;
    Foreign f = {.width = 20,
                 .height = 20,
                 .type = EXR_PIXEL_HALF,
                 .storage = EXR_STORAGE_SCANLINE,
                 .parts = 2,
                 .compression = EXR_COMPRESSION_ZIP,
                 .channels = {"R", "G", "B", "Z"}};
    write_foreign(scratch_path("p.exr"), &f);
    must(image_read(scratch_path("p.exr"), NULL, &im, &err), &err);
    assert_int_equal(im.channels, 8);
    assert_string_equal(im.names[0], "R");
    int at = image_find_channel(&im, "right.G");
    assert_true(at > 3 && im.data[(3 * 20 + 4) * 8 + at] == value_of(1, 1, 4, 3));
    image_free(&im);
    f.parts = 1;
    f.sampling = 2;
    write_foreign(scratch_path("s.exr"), &f);
    assert_int_equal(image_read(scratch_path("s.exr"), NULL, &im, &err), SLT_INPUT);
    assert_non_null(strstr(err.text, "subsampled"));
    assert_non_null(strstr(err.text, "s.exr"));
    f.sampling = 0;
    f.storage = EXR_STORAGE_DEEP_SCANLINE;
    f.compression = EXR_COMPRESSION_ZIPS;
    write_foreign(scratch_path("d.exr"), &f);
    assert_int_equal(image_read(scratch_path("d.exr"), NULL, &im, &err), SLT_INPUT);
    if (access(scratch_path("d.exr"), F_OK) == 0) assert_non_null(strstr(err.text, "d.exr"));
}

/* A PNG of 8 x 4 pixels in one of libpng's other layouts; sample i of a row is i. */
static void write_odd_png(const char *path, int type, int depth, int interlace) {
    static const png_color colours[16] = {{0, 0, 0}, {255, 0, 0}, {0, 255, 0}, {10, 20, 30}};
    static const png_byte alpha[3] = {255, 128, 0};
    FILE *f = fopen(path, "wb");
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png_create_info_struct(png);
    if (!f || setjmp(png_jmpbuf(png))) fail_msg("cannot make %s", path);
    png_init_io(png, f);
    png_set_IHDR(png, info, 8, 4, depth, type, interlace, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    if (type == PNG_COLOR_TYPE_PALETTE) {
        png_set_PLTE(png, info, colours, 16);
        png_set_tRNS(png, info, alpha, 3, NULL);
    }
    png_write_info(png, info);
    png_set_packing(png);
    png_byte row[8 * 8], *rows[4] = {row, row, row, row};
    for (int i = 0; i < 64; i++) row[i] = (png_byte)(depth == 16 ? (i & 1 ? i / 2 : 0) : i % (1 << depth));
    png_write_image(png, rows);
    png_write_end(png, info);
    png_destroy_write_struct(&png, &info);
    fclose(f);
}

static void png_layouts(void **state) {
    (void)state;
    SltError err = {0};
    Image im;
    const ImageReadOptions raw = {.raw = true};
    write_odd_png(scratch_path("l.png"), PNG_COLOR_TYPE_PALETTE, 4, PNG_INTERLACE_NONE);
    must(image_read(scratch_path("l.png"), &raw, &im, &err), &err);
    assert_int_equal(im.channels, 4);
    assert_true(im.data[4] == 1 && im.data[5] == 0 && fabs(im.data[7] - 128 / 255.0) < 1e-6);
    assert_true(im.data[11] == 0 && fabs(im.data[14] - 30 / 255.0) < 1e-6 && im.data[15] == 1);
    image_free(&im);
    for (int interlace = PNG_INTERLACE_NONE; interlace <= PNG_INTERLACE_ADAM7; interlace++) {
        for (int depth = 1; depth <= 4; depth *= 2) {
            write_odd_png(scratch_path("l.png"), PNG_COLOR_TYPE_GRAY, depth, interlace);
            must(image_read(scratch_path("l.png"), &raw, &im, &err), &err);
            assert_int_equal(im.channels, 1);
            for (int i = 0; i < 32; i++) {
                int top = (1 << depth) - 1;
                assert_true(fabs(im.data[i] - (double)(i % 8 & top) / top) < 1e-6);
            }
            image_free(&im);
        }
        write_odd_png(scratch_path("l.png"), PNG_COLOR_TYPE_RGB, 16, interlace);
        must(image_read(scratch_path("l.png"), &raw, &im, &err), &err);
        assert_int_equal(im.channels, 3);
        for (int i = 0; i < 96; i++) assert_true(fabs(im.data[i] - (i % 24) / 65535.0) < 1e-9);
        image_free(&im);
    }
}

/* Reads every truncation and some flips; whatever happens must be a clean answer. Returns how many
 * were accepted. */
static int torture(const char *name, const uint8_t *bytes, size_t size, bool must_refuse_truncation) {
    Image im;
    SltError err;
    int accepted = 0;
    uint8_t *copy = malloc(size);
    size_t stride = size > 3000 ? size / 1500 : 1;
    for (size_t n = 0; n < size; n += n < 512 ? 1 : stride) {
        uint8_t *exact = malloc(n ? n : 1); /* of exact size, so that the sanitizer sees a read past the end */
        memcpy(exact, bytes, n);
        err = (SltError){0};
        SltStatus status = image_decode(name, exact, n, NULL, &im, &err);
        if (status == SLT_OK) {
            if (must_refuse_truncation) fail_msg("%s: %zu of %zu bytes were accepted", name, n, size);
            image_free(&im);
        } else {
            assert_non_null(strstr(err.text, name));
            assert_null(im.data);
            assert_int_equal(err.status, status);
        }
        free(exact);
    }
    for (size_t at = 0; at < size; at += at < 700 ? 1 : stride) {
        static const uint8_t masks[] = {0x01, 0x80, 0xff};
        for (int m = 0; m < 3; m++) {
            memcpy(copy, bytes, size);
            copy[at] ^= masks[m];
            err = (SltError){0};
            if (image_decode(name, copy, size, NULL, &im, &err) == SLT_OK) {
                accepted++;
                image_free(&im);
            } else {
                assert_non_null(strstr(err.text, name));
            }
        }
    }
    free(copy);
    return accepted;
}

static void torture_file(const char *path, bool refuse) {
    uint8_t *bytes;
    size_t size;
    SltError err = {0};
    must(file_read_all(path, &file_binary, &bytes, &size, &err), &err);
    torture(path, bytes, size, refuse);
    free(bytes);
}

static void damaged_exr(void **state) {
    (void)state;
    for (size_t c = 0; c < 8; c++) {
        static const exr_compression_t all[] = {EXR_COMPRESSION_NONE, EXR_COMPRESSION_RLE, EXR_COMPRESSION_ZIPS,
                                                EXR_COMPRESSION_ZIP,  EXR_COMPRESSION_PIZ, EXR_COMPRESSION_PXR24,
                                                EXR_COMPRESSION_B44,  EXR_COMPRESSION_B44A};
        for (int tiled = 0; tiled < 2; tiled++) {
            Foreign f = {.width = 19,
                         .height = 21,
                         .compression = all[c],
                         .type = EXR_PIXEL_HALF,
                         .storage = tiled ? EXR_STORAGE_TILED : EXR_STORAGE_SCANLINE,
                         .channels = {"R", "G", "B"}};
            write_foreign(scratch_path("x.exr"), &f);
            torture_file(scratch_path("x.exr"), true);
        }
    }
}

static void damaged_png(void **state) {
    (void)state;
    SltError err = {0};
    Image im;
    for (int c = 1; c <= 4; c++) {
        must(image_create(&im, 23, 9, c, &err), &err);
        for (int i = 0; i < 23 * 9 * c; i++) im.data[i] = (float)((i * 37) % 101) / 101;
        ImageWriteOptions o = {.bits = c & 1 ? 16 : 8};
        must(image_write(scratch_path("x.png"), &im, &o, &err), &err);
        torture_file(scratch_path("x.png"), true);
        image_free(&im);
    }
}

static void damaged_flat(void **state) {
    (void)state;
    SltError err = {0};
    Image im;
    must(image_create(&im, 5, 7, 3, &err), &err);
    must(image_write(scratch_path("x.pfm"), &im, NULL, &err), &err);
    must(image_write(scratch_path("x.npy"), &im, NULL, &err), &err);
    torture_file(scratch_path("x.pfm"), true);
    torture_file(scratch_path("x.npy"), true);
    float raw[35] = {0};
    torture("x_5x7.f32", (const uint8_t *)raw, sizeof raw, true);
    image_free(&im);
}

/* Height of the ramp of the tile below, in metres. */
static int ramp(int x, int y) { return 4 * x - 2 * y - 100; }

static void tile(uint8_t *to, int side, int x0, int x1, int y0, int y1) {
    for (int y = 0; y < side; y++) {
        for (int x = 0; x < side; x++) {
            bool hole = x >= x0 && x < x1 && y >= y0 && y < y1;
            unsigned v = (uint16_t)(int16_t)(hole ? -32768 : ramp(x, y));
            *to++ = (uint8_t)(v >> 8);
            *to++ = (uint8_t)v;
        }
    }
}

/* SRTM: big-endian, negative heights, the first row on top; voids become what is around them. */
static void hgt_tiles(void **state) {
    (void)state;
    enum { SIDE = 33 };
    static uint8_t bytes[SIDE * SIDE * 2];
    SltError err = {0};
    Image im;
    tile(bytes, SIDE, 0, 0, 0, 0);
    must(image_decode("N36W085.HGT", bytes, sizeof bytes, NULL, &im, &err), &err);
    assert_int_equal(im.width, SIDE);
    assert_int_equal(im.height, SIDE);
    assert_int_equal(im.channels, 1);
    for (int i = 0; i < SIDE * SIDE; i++) assert_int_equal((int)im.data[i], ramp(i % SIDE, i / SIDE));
    image_free(&im);
    /* A hole of 6 x 5, and one at the corner: known heights stay, filled ones lie between those around. */
    tile(bytes, SIDE, 10, 16, 20, 25);
    bytes[0] = 0x80, bytes[1] = 0;
    must(image_decode("a.hgt", bytes, sizeof bytes, NULL, &im, &err), &err);
    double worst = 0;
    for (int i = 0; i < SIDE * SIDE; i++) {
        int x = i % SIDE, y = i / SIDE;
        bool hole = (x >= 10 && x < 16 && y >= 20 && y < 25) || i == 0;
        if (!hole) assert_int_equal((int)im.data[i], ramp(x, y));
        worst = fmax(worst, fabs((double)im.data[i] - ramp(x, y)));
    }
    assert_true(worst > 0 && worst < 16); /* four cells' slope */
    image_free(&im);
    /* More than a quarter, all of them, no square, and every truncation. */
    tile(bytes, SIDE, 0, 20, 0, 20);
    assert_int_equal(image_decode("a.hgt", bytes, sizeof bytes, NULL, &im, &err), SLT_INPUT);
    assert_non_null(strstr(err.text, "400 of its 1089"));
    tile(bytes, SIDE, 0, SIDE, 0, SIDE);
    assert_int_equal(image_decode("a.hgt", bytes, sizeof bytes, NULL, &im, &err), SLT_INPUT);
    tile(bytes, SIDE, 3, 5, 3, 5);
    for (size_t n = 0; n < sizeof bytes; n++) {
        SltStatus status = image_decode("a.hgt", bytes, n, NULL, &im, &err);
        size_t side = (size_t)lround(sqrt((double)n / 2));
        bool square = side >= 2 && side * side * 2 == n;
        assert_int_equal(status, square ? SLT_OK : SLT_INPUT);
        image_free(&im);
    }
}

/* Headers of more attributes or channels than OpenEXR's core reads in a bearable time. */
static void crowded_exr(void **state) {
    (void)state;
    enum { MANY = 40000, ROOM = 20 * MANY + 64 };
    SltError err = {0};
    Image im;
    uint8_t *bytes = calloc(1, ROOM);
    memcpy(bytes, "\x76\x2f\x31\x01\x02", 5);
    size_t at = 8;
    for (int i = 0; i < MANY; i++)
        at += (size_t)sprintf((char *)bytes + at, "a%05d%cint%c\x04%c%c%c%c%c%c%c", i, 0, 0, 0, 0, 0, 0, 0, 0, 0);
    assert_int_equal(image_decode("a.exr", bytes, at, NULL, &im, &err), SLT_LIMIT);
    assert_non_null(strstr(err.text, "attributes"));
    memset(bytes + 8, 0, ROOM - 8);
    uint32_t size = 5000 * 18 + 1;
    at = 8 + (size_t)sprintf((char *)bytes + 8, "channels%cchlist%c", 0, 0);
    memcpy(bytes + at, &size, 4), at += 4;
    for (int i = 0; i < 5000; i++, at += 18) bytes[at] = 'R';
    assert_int_equal(image_decode("c.exr", bytes, at + 2, NULL, &im, &err), SLT_LIMIT);
    assert_non_null(strstr(err.text, "channels"));
    free(bytes);
}

static void huge_claims(void **state) {
    (void)state;
    SltError err = {0};
    Image im;
    static const char *const claims[] = {
        "PF\n999999 999999\n-1\n", "PF\n100000 100000\n-1\n", "Pf\n16000 16000\n-1\n", "PF\n0 5\n-1\n",
        "PF\n-3 5\n-1\n",          "PF\n3e3 5\n-1\n",         "PF\n3 5\nx\n",          "P6\n3 5\n255\n"};
    for (size_t i = 0; i < sizeof claims / sizeof *claims; i++) {
        SltStatus status = image_decode("c.pfm", claims[i], strlen(claims[i]), NULL, &im, &err);
        assert_true(status == SLT_INPUT || status == SLT_LIMIT);
        assert_null(im.data);
    }
    /* a header edited to claim 16384 x 16384 in a file of some hundred bytes */
    Foreign f = {.width = 4,
                 .height = 4,
                 .compression = EXR_COMPRESSION_ZIP,
                 .type = EXR_PIXEL_HALF,
                 .storage = EXR_STORAGE_SCANLINE,
                 .channels = {"Y"}};
    write_foreign(scratch_path("h.exr"), &f);
    uint8_t *bytes;
    size_t size;
    must(file_read_all(scratch_path("h.exr"), &file_binary, &bytes, &size, &err), &err);
    int edited = 0;
    for (size_t i = 0; i + 16 <= size; i++) {
        static const uint8_t window[16] = {0, 0, 0, 0, 0, 0, 0, 0, 3, 0, 0, 0, 3, 0, 0, 0};
        if (memcmp(bytes + i, window, 16) == 0) {
            bytes[i + 9] = bytes[i + 13] = 0x3f;
            edited++;
        }
    }
    assert_true(edited >= 2);
    assert_int_equal(image_decode("h.exr", bytes, size, NULL, &im, &err), SLT_INPUT);
    free(bytes);
    static const uint8_t bomb[] = "\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\x0f\xff\xff\0\x0f\xff\xff\x08\x06\0\0\0";
    assert_int_not_equal(image_decode("b.png", bomb, sizeof bomb - 1, NULL, &im, &err), SLT_OK);
}

static int count_entries(const char *path) {
    int n = 0;
    DIR *d = opendir(path);
    assert_non_null(d);
    while (readdir(d)) n++;
    closedir(d);
    return n;
}

/* Whoever waits for the other end of a pipe, or reads what a hole claims, waits or pays for nothing. */
static void no_plain_files(void **state) {
    (void)state;
    SltError err = {0};
    Image im;
    Table t;
    const char *path = scratch_path("pipe.png");
    assert_int_equal(mkfifo(path, 0600), 0);
    assert_int_equal(image_read(path, NULL, &im, &err), SLT_INPUT);
    assert_non_null(strstr(err.text, "pipe"));
    path = scratch_path("hole.csv");
    assert_int_equal(close(open(path, O_CREAT | O_WRONLY, 0600)), 0);
    assert_int_equal(truncate(path, 1 << 30), 0);
    assert_int_equal(table_read(path, &t, &err), SLT_INPUT);
    assert_non_null(strstr(err.text, "sparse"));
    path = scratch_path("text.png"); /* its first bytes are enough to know */
    must(file_write_atomic(path, "not a picture", 13, &err), &err);
    assert_int_equal(image_read(path, NULL, &im, &err), SLT_INPUT);
    assert_non_null(strstr(err.text, "not a PNG file"));
}

static void put_be32(uint8_t *p, uint32_t v) {
    for (int i = 0; i < 4; i++) p[i] = (uint8_t)(v >> (24 - 8 * i));
}

/* 57 bytes: a header, and a chunk that claims two gigabytes. None of them is allocated. */
static void png_claims(void **state) {
    (void)state;
    static const char *const names[] = {"IDAT", "PLTE", "iCCP", "zTXt", "tRNS", "eXIf", "abCd"};
    uint8_t bytes[57] = "\x89PNG\r\n\x1a\n\0\0\0\rIHDR";
    SltError err = {0};
    Image im;
    bytes[19] = 8, bytes[23] = 8, bytes[24] = 8;
    put_be32(bytes + 29, (uint32_t)crc32(0, bytes + 12, 17));
    for (size_t k = 0; k < sizeof names / sizeof *names; k++) {
        struct rlimit old, tight;
        put_be32(bytes + 33, 0x7fffffff);
        memcpy(bytes + 37, names[k], 4);
        assert_int_equal(getrlimit(RLIMIT_DATA, &old), 0);
        tight = old;
#ifndef __SANITIZE_ADDRESS__
        tight.rlim_cur = 256 << 20;
#endif
        assert_int_equal(setrlimit(RLIMIT_DATA, &tight), 0);
        SltStatus status = image_decode("a.png", bytes, sizeof bytes, NULL, &im, &err);
        assert_int_equal(setrlimit(RLIMIT_DATA, &old), 0);
        assert_int_equal(status, SLT_INPUT);
        assert_non_null(strstr(err.text, "claims"));
    }
}

/* A file's gamma decides its curve: 1.0 means linear; 1/2.2 means sRGB. */
static void png_gamma(void **state) {
    (void)state;
    SltError err = {0};
    Image im, back;
    uint8_t *bytes, *with;
    size_t size;
    must(image_create(&im, 2, 2, 1, &err), &err);
    for (int i = 0; i < 4; i++) im.data[i] = 0.25f;
    must(image_encode("a.png", &im, &(ImageWriteOptions){.raw = true}, &bytes, &size, &err), &err);
    for (int kind = 0; kind < 2; kind++) {
        with = malloc(size + 16); /* gAMA belongs before IDAT; ours ends with it right behind the header */
        memcpy(with, bytes, 33);
        put_be32(with + 33, 4), memcpy(with + 37, "gAMA", 4), put_be32(with + 41, kind ? 45455 : 100000);
        put_be32(with + 45, (uint32_t)crc32(0, with + 37, 8));
        memcpy(with + 49, bytes + 33, size - 33);
        must(image_decode("a.png", with, size + 16, NULL, &back, &err), &err);
        float v = 64 / 255.0f;
        assert_float_equal(back.data[0], kind ? image_decode_srgb(v) : v, 1e-6);
        image_free(&back);
        must(image_decode("a.png", with, size + 16, &(ImageReadOptions){.raw = true}, &back, &err), &err);
        assert_float_equal(back.data[0], v, 1e-6);
        image_free(&back);
        free(with);
    }
    image_free(&im);
    free(bytes);
}

static void missing_files(void **state) {
    (void)state;
    SltError err = {0};
    Image im;
    Table t;
    assert_int_equal(image_read(scratch_path("nowhere.exr"), NULL, &im, &err), SLT_INPUT);
    assert_non_null(strstr(err.text, "No such file"));
    assert_int_equal(image_read(scratch, NULL, &im, &err), SLT_INPUT);
    assert_non_null(strstr(err.text, "folder"));
    assert_int_equal(image_read("/dev/zero", NULL, &im, &err), SLT_INPUT); /* and at once */
    assert_non_null(strstr(err.text, "device"));
    assert_int_equal(image_read(scratch_path("a.bmp"), NULL, &im, &err), SLT_INPUT);
    assert_non_null(strstr(err.text, "No such file"));
    assert_int_equal(table_read(scratch_path("a.xyz"), &t, &err), SLT_INPUT);
    must(image_create(&im, 2, 2, 1, &err), &err);
    assert_int_equal(image_write(scratch_path("a.bmp"), &im, NULL, &err), SLT_USAGE);
    assert_int_equal(image_write(scratch_path("none/a.exr"), &im, NULL, &err), SLT_OUTPUT);
    assert_non_null(strstr(err.text, "No such file"));
    image_free(&im);
}

static void atomic_write(void **state) {
    (void)state;
    SltError err = {0};
    uint8_t *bytes;
    size_t size;
    const char *path = scratch_path("atom");
    char keep[256];
    snprintf(keep, sizeof keep, "%s", path);
    must(file_write_atomic(keep, "old", 3, &err), &err);
    assert_int_equal(chmod(keep, 0640), 0);
    must(file_write_atomic(keep, "newer", 5, &err), &err);
    struct stat st;
    assert_int_equal(stat(keep, &st), 0);
    assert_int_equal(st.st_mode & 0777, 0640);
    int before = count_entries(scratch);
    /* a limit on file size stands for a full disk: the write fails half-way */
    struct rlimit old, tiny;
    getrlimit(RLIMIT_FSIZE, &old);
    tiny = old;
    tiny.rlim_cur = 4096;
    void (*handler)(int) = signal(SIGXFSZ, SIG_IGN);
    setrlimit(RLIMIT_FSIZE, &tiny);
    uint8_t *large = calloc(1, 100000);
    SltStatus status = file_write_atomic(keep, large, 100000, &err);
    setrlimit(RLIMIT_FSIZE, &old);
    signal(SIGXFSZ, handler);
    assert_int_equal(status, SLT_OUTPUT);
    assert_non_null(strstr(err.text, "File too large"));
    assert_int_equal(count_entries(scratch), before); /* no temporary file stays */
    must(file_read_all(keep, &file_binary, &bytes, &size, &err), &err);
    assert_int_equal(size, 5);
    assert_memory_equal(bytes, "newer", 5);
    free(bytes);
    if (access("/dev/full", W_OK) == 0) {
        assert_int_equal(file_write_atomic("/dev/full", large, 100000, &err), SLT_OUTPUT);
        assert_non_null(strstr(err.text, "No space left"));
    }
    must(file_write_atomic("/dev/null", large, 100000, &err), &err);
    assert_int_equal(stat("/dev/null", &st), 0);
    assert_true(S_ISCHR(st.st_mode));
    free(large);
    assert_int_equal(symlink("atom", scratch_path("link")), 0);
    must(file_write_atomic(scratch_path("link"), "via link", 8, &err), &err);
    assert_int_equal(lstat(scratch_path("link"), &st), 0);
    assert_true(S_ISLNK(st.st_mode));
    must(file_read_all(keep, &file_binary, &bytes, &size, &err), &err);
    assert_memory_equal(bytes, "via link", 8);
    free(bytes);
    assert_int_equal(file_write_atomic(scratch, "x", 1, &err), SLT_OUTPUT);
    assert_int_equal(file_write_atomic("", "x", 1, &err), SLT_OUTPUT);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(exr_layouts),
        cmocka_unit_test(png_layouts),
        cmocka_unit_test(exr_windows),
        cmocka_unit_test(exr_windows_of_parts),
        cmocka_unit_test(exr_parts_and_refusals),
        cmocka_unit_test(damaged_exr),
        cmocka_unit_test(damaged_png),
        cmocka_unit_test(damaged_flat),
        cmocka_unit_test(hgt_tiles),
        cmocka_unit_test(huge_claims),
        cmocka_unit_test(crowded_exr),
        cmocka_unit_test(missing_files),
        cmocka_unit_test(no_plain_files),
        cmocka_unit_test(png_claims),
        cmocka_unit_test(png_gamma),
        cmocka_unit_test(atomic_write),
    };
    return cmocka_run_group_tests(tests, scratch_make, scratch_drop);
}
