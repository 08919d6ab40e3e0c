/* PNG through libpng, from and to memory. libpng reports errors by longjmp: everything that must
 * survive one lives in a struct on the heap or is volatile-free because it is set before setjmp. */
#include "internal.h"

#include <errno.h>
#include <math.h>
#include <png.h>
#include <setjmp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { CHUNK_LIMIT = 8 << 20, CHUNK_CACHE = 64, SIGNATURE = 8, CHUNK_FRAME = 12 /* length, name, checksum */ };
#define NOT_YET (-1.0f)

typedef struct Png {
    png_structp png;
    png_infop info;
    char message[160];
    const uint8_t *bytes; /* reading */
    size_t size, at;
    uint8_t *row;  /* reading: of the file's samples, 8 or 16 bits in host order */
    float *linear; /* reading: of each level, or NOT_YET */
    int width, height, channels, bits;
    double gamma; /* of the file's chunk gAMA; 0: the curve of sRGB */
    Bytes *out;   /* writing */
    SltStatus status;
    jmp_buf escape;
} Png;

static void on_error(png_structp png, png_const_charp msg) {
    Png *p = png_get_error_ptr(png);
    if (errno == ENOMEM) p->status = SLT_LIMIT, msg = "out of memory"; /* libpng and zlib say many things then */
    if (!p->message[0]) snprintf(p->message, sizeof p->message, "%s", msg);
    longjmp(p->escape, 1);
}

static void on_warning(png_structp png, png_const_charp msg) {
    (void)png;
    (void)msg; /* oddities that do not change pixels */
}

static void read_bytes(png_structp png, png_bytep to, size_t n) {
    Png *p = png_get_io_ptr(png);
    if (n > p->size - p->at) png_error(png, "the file ends too early");
    memcpy(to, p->bytes + p->at, n);
    p->at += n;
}

static void write_bytes(png_structp png, png_bytep from, size_t n) {
    Png *p = png_get_io_ptr(png);
    image_bytes_append(p->out, from, n);
    if (p->out->failed) {
        p->status = SLT_LIMIT;
        png_error(png, "out of memory");
    }
}

static void flush_bytes(png_structp png) { (void)png; }

/* libpng allocates what a chunk claims before it looks at what is there. NULL, or what is wrong. */
static const char *check_chunks(const uint8_t *bytes, size_t size) {
    for (size_t at = SIGNATURE; at < size;) {
        if (size - at < CHUNK_FRAME) return "the file ends too early";
        const uint8_t *c = bytes + at;
        size_t claimed = (size_t)c[0] << 24 | (size_t)c[1] << 16 | (size_t)c[2] << 8 | c[3];
        if (claimed > size - at - CHUNK_FRAME) return "a chunk claims more bytes than the file has";
        at += CHUNK_FRAME + claimed;
        if (!memcmp(c + 4, "IEND", 4)) return NULL;
    }
    return "the file ends too early";
}

/* The curve of the file, level by level: a level is computed when the first sample has it, as most files have fewer
 * samples than 16 bits have levels. */
static void read_curve(Png *p, bool raw) {
    int levels = p->bits == 16 ? 65536 : 256;
    p->linear = malloc((size_t)levels * sizeof *p->linear);
    for (int i = 0; p->linear && i < levels; i++) p->linear[i] = raw ? (float)i / (float)(levels - 1) : NOT_YET;
}

static float level(const Png *p, unsigned q) {
    if (p->linear[q] != NOT_YET) return p->linear[q];
    float v = (float)q / (p->bits == 16 ? 65535 : 255);
    /* 1 / 2.2, as most writers round it, is meant as sRGB's: the standard says to prefer that curve where both are
     * given */
    bool is_srgb = p->gamma == 0 || fabs(p->gamma - 1 / 2.2) < 1e-3;
    return p->linear[q] = is_srgb ? image_decode_srgb(v) : (float)pow(v, 1 / p->gamma);
}

/* Every `step`th pixel of the row, from `first` on. */
static void row_to_floats(const Png *p, int first, int step, float *to) {
    const uint16_t *wide = (const uint16_t *)(const void *)p->row; /* malloc'd, so aligned */
    bool has_alpha = p->channels == 2 || p->channels == 4;
    float top = p->bits == 16 ? 65535 : 255;
    for (size_t x = (size_t)first; x < (size_t)p->width; x += (size_t)step)
        for (int c = 0; c < p->channels; c++) {
            size_t i = x * (size_t)p->channels + (size_t)c;
            unsigned q = p->bits == 16 ? wide[i] : p->row[i];
            to[i] = has_alpha && c == p->channels - 1 ? (float)q / top : level(p, q);
        }
}

/* One row at a time: the floats alone may be as large as images may be. Of an interlaced file each pass has some pixels
 * of some rows, and leaves those of the others as they are. */
static void read_rows(Png *p, int passes, float *to) {
    size_t length = (size_t)p->width * (size_t)p->channels;
    for (int pass = 0; pass < passes; pass++)
        for (int y = 0; y < p->height; y++) {
            png_read_row(p->png, p->row, NULL);
            if (passes == 1) row_to_floats(p, 0, 1, to + (size_t)y * length);
            else if (PNG_ROW_IN_INTERLACE_PASS((unsigned)y, pass))
                row_to_floats(p, PNG_PASS_START_COL(pass), 1 << PNG_PASS_COL_SHIFT(pass), to + (size_t)y * length);
        }
}

/* Reads header and pixels. Longjmps on error. */
static void read_image(Png *p, const char *name, bool raw, Image *out, SltError *err) {
    png_set_read_fn(p->png, p, read_bytes);
    png_set_user_limits(p->png, IMAGE_MAX_SIDE, IMAGE_MAX_SIDE);
    png_set_chunk_malloc_max(p->png, CHUNK_LIMIT);
    png_set_chunk_cache_max(p->png, CHUNK_CACHE);
    /* Of what is not needed to decode pixels only the two that tell the curve are looked into. */
    static const png_byte curve[] = "gAMA\0sRGB";
    png_set_keep_unknown_chunks(p->png, PNG_HANDLE_CHUNK_NEVER, NULL, -1);
    png_set_keep_unknown_chunks(p->png, PNG_HANDLE_CHUNK_AS_DEFAULT, curve, 2);
    png_read_info(p->png, p->info);
    int intent;
    double gamma = 0;
    if (!png_get_sRGB(p->png, p->info, &intent) && png_get_gAMA(p->png, p->info, &gamma) && gamma > 0) p->gamma = gamma;
    double width = png_get_image_width(p->png, p->info), height = png_get_image_height(p->png, p->info);
    p->status = image_check_claim(name, width, height, 4, p->size, err);
    if (p->status != SLT_OK) longjmp(p->escape, 1);
    p->status = SLT_INPUT;
    png_set_expand(p->png); /* palette to colour, 1-4 bits to 8, tRNS to alpha */
    if (png_get_bit_depth(p->png, p->info) == 16) {
        const uint16_t probe = 1;
        if (*(const uint8_t *)&probe) png_set_swap(p->png);
    }
    int passes = png_set_interlace_handling(p->png);
    png_read_update_info(p->png, p->info);
    p->width = (int)width;
    p->height = (int)height;
    p->channels = png_get_channels(p->png, p->info);
    p->bits = png_get_bit_depth(p->png, p->info);
    size_t row = png_get_rowbytes(p->png, p->info);
    if (p->channels < 1 || p->channels > 4 || (p->bits != 8 && p->bits != 16) ||
        row != (size_t)p->width * (size_t)p->channels * (size_t)(p->bits / 8)) {
        png_error(p->png, "unexpected pixel layout");
    }
    p->status = image_create(out, p->width, p->height, p->channels, err);
    if (p->status != SLT_OK) longjmp(p->escape, 1);
    p->status = SLT_INPUT;
    p->row = malloc(row);
    read_curve(p, raw);
    if (!p->row || !p->linear) {
        p->status = SLT_LIMIT;
        png_error(p->png, "out of memory");
    }
    read_rows(p, passes, out->data);
    png_read_end(p->png, NULL);
}

SltStatus image_decode_png(const char *name, const uint8_t *bytes, size_t size, const ImageReadOptions *opt, Image *out,
                           SltError *err) {
    *out = (Image){0};
    if (size < SIGNATURE || png_sig_cmp(bytes, 0, SIGNATURE) != 0)
        return status_fail(err, SLT_INPUT, "cannot read '%s': it is not a PNG file", name);
    const char *wrong = check_chunks(bytes, size);
    if (wrong) return status_fail(err, SLT_INPUT, "cannot read '%s': %s", name, wrong);
    Png *p = calloc(1, sizeof *p);
    if (p) {
        *p = (Png){.bytes = bytes, .size = size, .status = SLT_INPUT};
        p->png = png_create_read_struct(PNG_LIBPNG_VER_STRING, p, on_error, on_warning);
        p->info = p->png ? png_create_info_struct(p->png) : NULL;
    }
    if (!p || !p->info) {
        if (p) png_destroy_read_struct(&p->png, NULL, NULL);
        free(p);
        return status_fail(err, SLT_LIMIT, "cannot read '%s': out of memory", name);
    }
    SltStatus status;
    errno = 0;
    if (setjmp(p->escape) == 0) {
        read_image(p, name, opt->raw, out, err);
        status = SLT_OK;
    } else { /* without a message, err is filled already */
        image_free(out);
        status = p->message[0] ? status_fail(err, p->status, "cannot read '%s': %s", name, p->message) : p->status;
    }
    png_destroy_read_struct(&p->png, &p->info, NULL);
    free(p->row);
    free(p->linear);
    free(p);
    return status;
}

/* `pixels` holds samples of 8 bits, or of 16 bits with the high byte first. */
static SltStatus png_encode(const char *name, int width, int height, int channels, int bits, const uint8_t *pixels,
                            Bytes *out, SltError *err) {
    static const int types[] = {0, PNG_COLOR_TYPE_GRAY, PNG_COLOR_TYPE_GRAY_ALPHA, PNG_COLOR_TYPE_RGB,
                                PNG_COLOR_TYPE_RGB_ALPHA};
    if (width < 1 || height < 1 || channels < 1 || channels > 4 || width > IMAGE_MAX_SIDE || height > IMAGE_MAX_SIDE) {
        return status_fail(err, SLT_USAGE, "cannot write '%s': %d x %d pixels of %d channels", name, width, height,
                           channels);
    }
    Png *p = calloc(1, sizeof *p);
    if (p) {
        *p = (Png){.out = out, .status = SLT_OUTPUT};
        p->png = png_create_write_struct(PNG_LIBPNG_VER_STRING, p, on_error, on_warning);
        p->info = p->png ? png_create_info_struct(p->png) : NULL;
    }
    if (!p || !p->info) {
        if (p) png_destroy_write_struct(&p->png, NULL);
        free(p);
        return status_fail(err, SLT_LIMIT, "cannot write '%s': out of memory", name);
    }
    SltStatus status = SLT_OK;
    errno = 0;
    if (setjmp(p->escape) == 0) {
        size_t row = (size_t)width * (size_t)channels * (size_t)(bits / 8);
        png_set_write_fn(p->png, p, write_bytes, flush_bytes);
        png_set_user_limits(p->png, IMAGE_MAX_SIDE, IMAGE_MAX_SIDE);
        png_set_IHDR(p->png, p->info, (png_uint_32)width, (png_uint_32)height, bits, types[channels],
                     PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
        png_write_info(p->png, p->info);
        for (int y = 0; y < height; y++) png_write_row(p->png, pixels + (size_t)y * row);
        png_write_end(p->png, p->info);
    } else {
        status = status_fail(err, p->status, "cannot write '%s': %s", name, p->message);
    }
    png_destroy_write_struct(&p->png, &p->info);
    free(p);
    return status;
}

SltStatus image_encode_png(const char *name, const Image *im, const ImageWriteOptions *opt, Bytes *out, SltError *err) {
    int src[4];
    int n = image_root_channels(im, src), bits = opt->bits == 16 ? 16 : 8;
    bool raw = opt->raw;
    size_t pixels = (size_t)im->width * (size_t)im->height, wide = bits / 8;
    uint8_t *packed = malloc(pixels * (size_t)n * wide);
    if (!packed) return status_fail(err, SLT_LIMIT, "cannot write '%s': out of memory", name);
    uint8_t *to = packed;
    for (size_t p = 0; p < pixels; p++) {
        for (int c = 0; c < n; c++) {
            float v = im->data[p * (size_t)im->channels + (size_t)src[c]];
            bool alpha = (n == 2 || n == 4) && c == n - 1;
            v = raw || alpha ? (v > 0 ? fminf(v, 1) : 0) : image_encode_srgb(v);
            if (bits == 16) {
                unsigned q = (unsigned)lrintf(v * 65535.0f);
                *to++ = (uint8_t)(q >> 8);
                *to++ = (uint8_t)q;
            } else {
                *to++ = (uint8_t)lrintf(v * 255.0f);
            }
        }
    }
    SltStatus status = png_encode(name, im->width, im->height, n, bits, packed, out, err);
    free(packed);
    return status;
}

SltStatus image_encode_png8(const char *name, int width, int height, int channels, const uint8_t *pixels,
                            uint8_t **bytes, size_t *size, SltError *err) {
    Bytes b = {0};
    SltStatus status = png_encode(name, width, height, channels, 8, pixels, &b, err);
    if (status != SLT_OK) image_bytes_free(&b);
    *bytes = b.data;
    *size = b.size;
    return status;
}

SltStatus image_write_png8(const char *path, int width, int height, int channels, const uint8_t *pixels,
                           SltError *err) {
    uint8_t *bytes;
    size_t size;
    SltStatus status = image_encode_png8(path, width, height, channels, pixels, &bytes, &size, err);
    if (status == SLT_OK) status = file_write_atomic(path, bytes, size, err);
    free(bytes);
    return status;
}
