/* The two formats that are a short header and floats: PFM, and raw NAME_WxH.f32. */
#include "internal.h"

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static float load_float(const uint8_t *p, bool big) {
    uint32_t v = big ? (uint32_t)p[0] << 24 | (uint32_t)p[1] << 16 | (uint32_t)p[2] << 8 | p[3]
                     : (uint32_t)p[3] << 24 | (uint32_t)p[2] << 16 | (uint32_t)p[1] << 8 | p[0];
    float f;
    memcpy(&f, &v, sizeof f);
    return f;
}

/* One header word of at most 31 bytes; moves *at past the single blank that ends it. */
static bool next_word(const uint8_t *bytes, size_t size, size_t *at, char word[32]) {
    while (*at < size && isspace(bytes[*at])) ++*at;
    size_t n = 0;
    while (*at < size && !isspace(bytes[*at]) && n < 31) word[n++] = (char)bytes[(*at)++];
    word[n] = 0;
    if (n == 0 || *at >= size || !isspace(bytes[*at])) return false;
    ++*at;
    return true;
}

static bool whole_number(const char *word, double *out) {
    double v = 0;
    if (!*word || strlen(word) > 9) return false;
    for (; *word; word++) {
        if (!isdigit((unsigned char)*word)) return false;
        v = v * 10 + (*word - '0');
    }
    *out = v;
    return true;
}

SltStatus image_decode_pfm(const char *name, const uint8_t *bytes, size_t size, const ImageReadOptions *opt, Image *out,
                           SltError *err) {
    (void)opt;
    char magic[32], w[32], h[32], scale[32];
    size_t at = 0;
    double width = 0, height = 0;
    *out = (Image){0};
    if (!next_word(bytes, size, &at, magic) || (strcmp(magic, "PF") != 0 && strcmp(magic, "Pf") != 0))
        return status_fail(err, SLT_INPUT, "cannot read '%s': it is not a PFM file", name);
    if (!next_word(bytes, size, &at, w) || !next_word(bytes, size, &at, h) || !next_word(bytes, size, &at, scale) ||
        !whole_number(w, &width) || !whole_number(h, &height)) {
        return status_fail(err, SLT_INPUT, "cannot read '%s': the PFM header is damaged", name);
    }
    /* Only the scale's sign matters (negative: little-endian); its magnitude is a unit that no
     * reader applies. */
    const char *digits = scale + (scale[0] == '-' || scale[0] == '+');
    if (!isdigit((unsigned char)digits[0]) && digits[0] != '.')
        return status_fail(err, SLT_INPUT, "cannot read '%s': the PFM scale '%s' is not a number", name, scale);
    int channels = magic[1] == 'F' ? 3 : 1;
    SltStatus status = image_check_claim(name, width, height, channels, size, err);
    if (status != SLT_OK) return status;
    size_t row = (size_t)width * (size_t)channels;
    if (size - at < row * (size_t)height * 4) {
        return status_fail(err, SLT_INPUT,
                           "cannot read '%s': the file ends too early: %zu bytes of pixels, %zu expected", name,
                           size - at, row * (size_t)height * 4);
    }
    status = image_create(out, (int)width, (int)height, channels, err);
    for (int y = 0; status == SLT_OK && y < out->height; y++) { /* the bottom row comes first */
        const uint8_t *from = bytes + at + (size_t)(out->height - 1 - y) * row * 4;
        for (size_t i = 0; i < row; i++) out->data[(size_t)y * row + i] = load_float(from + i * 4, scale[0] != '-');
    }
    return status;
}

SltStatus image_encode_pfm(const char *name, const Image *im, const ImageWriteOptions *opt, Bytes *out, SltError *err) {
    (void)opt;
    int src[4];
    int n = image_root_channels(im, src);
    if (n == 2 || n == 4) n--; /* PFM has no alpha */
    if (n == 2) return status_fail(err, SLT_USAGE, "cannot write '%s': PFM has 1 or 3 channels", name);
    image_bytes_printf(out, "%s\n%d %d\n-1.0\n", n == 3 ? "PF" : "Pf", im->width, im->height);
    image_bytes_reserve(out, out->size + (size_t)im->width * (size_t)im->height * (size_t)n * 4);
    for (int y = im->height - 1; y >= 0 && !out->failed; y--) {
        for (int x = 0; x < im->width; x++) {
            const float *p = im->data + ((size_t)y * (size_t)im->width + (size_t)x) * (size_t)im->channels;
            for (int c = 0; c < n; c++) {
                uint32_t v;
                memcpy(&v, &p[src[c]], sizeof v);
                uint8_t little[4] = {(uint8_t)v, (uint8_t)(v >> 8), (uint8_t)(v >> 16), (uint8_t)(v >> 24)};
                image_bytes_append(out, little, 4);
            }
        }
    }
    return SLT_OK;
}

/* Finds the last "_WxH" or "_WxHxC" before the extension. */
static bool parse_size(const char *name, double *w, double *h, double *c) {
    const char *mark = strrchr(name, '_');
    unsigned a, b, d;
    int end = 0;
    *c = 1;
    if (!mark) return false;
    if (sscanf(mark, "_%7ux%7ux%4u%n", &a, &b, &d, &end) == 3 && mark[end] == '.') *c = d;
    else if (sscanf(mark, "_%7ux%7u%n", &a, &b, &end) != 2 || mark[end] != '.') return false;
    *w = a;
    *h = b;
    return true;
}

SltStatus image_decode_f32(const char *name, const uint8_t *bytes, size_t size, const ImageReadOptions *opt, Image *out,
                           SltError *err) {
    (void)opt;
    double w, h, c;
    *out = (Image){0};
    if (!parse_size(name, &w, &h, &c)) {
        return status_fail(err, SLT_INPUT, "cannot read '%s': a raw file is called NAME_WxH.f32 or NAME_WxHxC.f32",
                           name);
    }
    SltStatus status = image_check_claim(name, w, h, c, size, err);
    if (status == SLT_OK && w * h * c * 4 != (double)size) {
        return status_fail(err, SLT_INPUT, "cannot read '%s': %zu bytes, but its name says %.0f", name, size,
                           w * h * c * 4);
    }
    status = status ? status : image_create(out, (int)w, (int)h, (int)c, err);
    for (size_t i = 0; status == SLT_OK && i < size / 4; i++) out->data[i] = load_float(bytes + i * 4, false);
    return status;
}
