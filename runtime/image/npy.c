/* NumPy's array files: a Python dictionary as a header, then the numbers. */
#include "internal.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct Header {
    char kind; /* f i u b */
    int width; /* bytes of an element */
    bool big, fortran;
    int rank;
    size_t shape[4];
    size_t count;
    size_t offset; /* of the data */
} Header;

static const char *skip_blanks(const char *p, const char *end) {
    while (p < end && isspace((unsigned char)*p)) p++;
    return p;
}

/* A quoted string at p into buf; returns past it or NULL. */
static const char *quoted(const char *p, const char *end, char buf[32]) {
    if (p >= end || (*p != '\'' && *p != '"')) return NULL;
    char quote = *p++;
    size_t n = 0;
    while (p < end && *p != quote && n < 31) buf[n++] = *p++;
    buf[n] = 0;
    return p < end && *p == quote ? p + 1 : NULL;
}

static bool parse_type(const char *text, Header *h) {
    char order = text[0];
    if (order != '<' && order != '>' && order != '|' && order != '=') return false;
    h->big = order == '>';
    h->kind = text[1];
    h->width = text[1] ? text[2] - '0' : 0;
    if (!text[1] || !text[2] || text[3]) return false;
    switch (h->kind) {
    case 'f': return h->width == 2 || h->width == 4 || h->width == 8;
    case 'i':
    case 'u': return h->width == 1 || h->width == 2 || h->width == 4 || h->width == 8;
    case 'b': return h->width == 1;
    default: return false;
    }
}

static const char *parse_shape(const char *p, const char *end, Header *h, int *rank) {
    *rank = 0;
    if (p >= end || *p++ != '(') return NULL;
    for (;;) {
        p = skip_blanks(p, end);
        if (p < end && *p == ')') return p + 1;
        size_t v = 0;
        const char *start = p;
        while (p < end && isdigit((unsigned char)*p) && p - start < 12) v = v * 10 + (size_t)(*p++ - '0');
        if (p == start) return NULL;
        if (*rank < 4) h->shape[*rank] = v;
        ++*rank;
        p = skip_blanks(p, end);
        if (p < end && *p == ',') p++;
        else if (p >= end || *p != ')') return NULL;
    }
}

/* NULL when the header is fine, else what is wrong with it. */
static const char *parse_dictionary(const char *p, const char *end, Header *h, int *rank) {
    bool has_type = false, has_order = false, has_shape = false;
    char key[32], text[32];
    p = skip_blanks(p, end);
    if (p >= end || *p++ != '{') return "the header is damaged";
    for (;;) {
        p = skip_blanks(p, end);
        if (p < end && *p == '}') break;
        p = quoted(p, end, key);
        p = p ? skip_blanks(p, end) : NULL;
        if (!p || p >= end || *p++ != ':') return "the header is damaged";
        p = skip_blanks(p, end);
        if (strcmp(key, "descr") == 0) {
            p = quoted(p, end, text);
            if (!p || !parse_type(text, h)) return "its elements are not plain numbers";
            has_type = true;
        } else if (strcmp(key, "fortran_order") == 0) {
            bool yes = end - p >= 4 && strncmp(p, "True", 4) == 0, no = end - p >= 5 && strncmp(p, "False", 5) == 0;
            if (!yes && !no) return "the header is damaged";
            h->fortran = yes;
            p += yes ? 4 : 5;
            has_order = true;
        } else if (strcmp(key, "shape") == 0) {
            p = parse_shape(p, end, h, rank);
            has_shape = true;
        } else {
            return "the header has an unknown key";
        }
        p = p ? skip_blanks(p, end) : NULL;
        if (!p || p >= end) return "the header is damaged";
        if (*p == ',') p++;
    }
    return has_type && has_order && has_shape ? NULL : "the header is incomplete";
}

static SltStatus parse_header(const char *name, const uint8_t *bytes, size_t size, Header *h, SltError *err) {
    *h = (Header){.shape = {1, 1, 1, 1}, .count = 1};
    if (size < 10 || memcmp(bytes, "\x93NUMPY", 6) != 0)
        return status_fail(err, SLT_INPUT, "cannot read '%s': it is not a NumPy array file", name);
    size_t start = bytes[6] >= 2 ? 12 : 10;
    size_t length = bytes[8] | (size_t)bytes[9] << 8;
    if (bytes[6] < 1 || bytes[6] > 3 || size < start)
        return status_fail(err, SLT_INPUT, "cannot read '%s': unknown NumPy format version %d", name, bytes[6]);
    if (start == 12) length |= (size_t)bytes[10] << 16 | (size_t)bytes[11] << 24;
    if (length > size - start)
        return status_fail(err, SLT_INPUT, "cannot read '%s': the file ends in its header", name);
    const char *text = (const char *)bytes + start;
    int rank = 0;
    const char *wrong = parse_dictionary(text, text + length, h, &rank);
    if (wrong) return status_fail(err, SLT_INPUT, "cannot read '%s': %s", name, wrong);
    if (rank > 4) return status_fail(err, SLT_INPUT, "cannot read '%s': %d dimensions (at most 4)", name, rank);
    double count = 1;
    for (int i = 0; i < rank; i++) count *= (double)h->shape[i];
    if (count < 1) return status_fail(err, SLT_INPUT, "cannot read '%s': the array is empty", name);
    if (count > IMAGE_MAX_SAMPLES)
        return status_fail(err, SLT_LIMIT, "'%s' is too large: %.0f numbers (at most 2^28)", name, count);
    h->rank = rank < 1 ? 1 : rank;
    h->count = (size_t)count;
    h->offset = start + length;
    if ((size - h->offset) / (size_t)h->width < h->count) {
        return status_fail(err, SLT_INPUT,
                           "cannot read '%s': the file ends too early: %zu bytes of numbers, %zu expected", name,
                           size - h->offset, h->count * (size_t)h->width);
    }
    return SLT_OK;
}

static double half_to_double(uint16_t v) {
    int exponent = v >> 10 & 31, mantissa = v & 1023;
    double m = exponent == 31 ? (mantissa ? (double)NAN : (double)INFINITY)
               : exponent     ? ldexp(mantissa + 1024, exponent - 25)
                              : ldexp(mantissa, -24);
    return v & 0x8000 ? -m : m;
}

static double element(const Header *h, const uint8_t *p) {
    uint64_t v = 0;
    for (int i = 0; i < h->width; i++) v |= (uint64_t)p[h->big ? h->width - 1 - i : i] << 8 * i;
    if (h->kind == 'f' && h->width == 8) {
        double d;
        memcpy(&d, &v, sizeof d);
        return d;
    }
    if (h->kind == 'f' && h->width == 4) {
        uint32_t w = (uint32_t)v;
        float f;
        memcpy(&f, &w, sizeof f);
        return f;
    }
    if (h->kind == 'f') return half_to_double((uint16_t)v);
    if (h->kind == 'i') {
        int shift = 64 - 8 * h->width;
        return (double)((int64_t)(v << shift) >> shift);
    }
    return h->kind == 'b' ? v != 0 : (double)v;
}

/* The file index of C-ordered element i. */
static size_t file_index(const Header *h, size_t i) {
    if (!h->fortran) return i;
    size_t index = 0, at[4];
    for (int d = h->rank - 1; d >= 0; d--) {
        at[d] = i % h->shape[d];
        i /= h->shape[d];
    }
    for (int d = h->rank - 1; d >= 0; d--) index = index * h->shape[d] + at[d];
    return index;
}

SltStatus npy_decode(const char *name, const void *bytes, size_t size, NumArray *out, SltError *err) {
    Header h;
    *out = (NumArray){0};
    SltStatus status = parse_header(name, bytes, size, &h, err);
    if (status != SLT_OK) return status;
    double *data = malloc(h.count * sizeof *data);
    if (!data) return status_fail(err, SLT_LIMIT, "cannot read '%s': out of memory", name);
    const uint8_t *from = (const uint8_t *)bytes + h.offset;
    for (size_t i = 0; i < h.count; i++) data[i] = element(&h, from + file_index(&h, i) * (size_t)h.width);
    *out = (NumArray){.rank = h.rank, .data = data};
    memcpy(out->shape, h.shape, sizeof out->shape);
    return SLT_OK;
}

SltStatus npy_read(const char *path, NumArray *out, SltError *err) {
    uint8_t *bytes;
    size_t size;
    *out = (NumArray){0};
    SltStatus status = file_read_all(path, &image_find_format(".npy")->kind, &bytes, &size, err);
    status = status ? status : npy_decode(path, bytes, size, out, err);
    free(bytes);
    return status;
}

void npy_free(NumArray *a) {
    if (a) {
        free(a->data);
        *a = (NumArray){0};
    }
}

SltStatus image_decode_npy(const char *name, const uint8_t *bytes, size_t size, const ImageReadOptions *opt, Image *out,
                           SltError *err) {
    (void)opt;
    Header h;
    *out = (Image){0};
    SltStatus status = parse_header(name, bytes, size, &h, err);
    if (status != SLT_OK) return status;
    if (h.rank > 3) {
        return status_fail(err, SLT_INPUT,
                           "cannot read '%s' as an image: it has %d dimensions (rows, columns and channels "
                           "are 3)",
                           name, h.rank);
    }
    size_t height = h.rank == 1 ? 1 : h.shape[0], width = h.rank == 1 ? h.shape[0] : h.shape[1];
    size_t channels = h.rank == 3 ? h.shape[2] : 1;
    status = image_check_claim(name, (double)width, (double)height, (double)channels, size, err);
    status = status ? status : image_create(out, (int)width, (int)height, (int)channels, err);
    for (size_t i = 0; status == SLT_OK && i < h.count; i++) {
        const uint8_t *from = bytes + h.offset + file_index(&h, i) * (size_t)h.width;
        if (h.kind == 'f' && h.width == 4 && !h.big) {
            uint32_t v = (uint32_t)from[3] << 24 | (uint32_t)from[2] << 16 | (uint32_t)from[1] << 8 | from[0];
            memcpy(&out->data[i], &v, 4); /* bit for bit, also the payload of a signalling NaN */
        } else {
            out->data[i] = (float)element(&h, from);
        }
    }
    return status;
}

SltStatus npy_encode(int rank, const size_t *shape, const float *narrow, const double *wide, bool as_double, Bytes *out,
                     SltError *err) {
    char dims[128] = "", header[256];
    size_t count = 1;
    if (rank < 1 || rank > 4)
        return status_fail(err, SLT_USAGE, "an array of %d dimensions (1 to 4 can be written)", rank);
    for (int i = 0; i < rank; i++) {
        size_t at = strlen(dims);
        snprintf(dims + at, sizeof dims - at, "%s%zu%s", i ? " " : "", shape[i], i + 1 < rank || rank == 1 ? "," : "");
        count *= shape[i];
    }
    int n = snprintf(header, sizeof header, "{'descr': '<f%d', 'fortran_order': False, 'shape': (%s), }",
                     as_double ? 8 : 4, dims);
    int padded = (10 + n + 1 + 63) / 64 * 64 - 10; /* data starts at a multiple of 64 */
    memset(header + n, ' ', (size_t)(padded - n));
    header[padded - 1] = '\n';
    uint8_t preamble[10] = {0x93, 'N', 'U', 'M', 'P', 'Y', 1, 0, (uint8_t)padded, (uint8_t)(padded >> 8)};
    image_bytes_append(out, preamble, sizeof preamble);
    image_bytes_append(out, header, (size_t)padded);
    image_bytes_reserve(out, out->size + count * (as_double ? 8 : 4));
    for (size_t i = 0; i < count && !out->failed; i++) {
        uint8_t little[8];
        uint64_t v = 0;
        int bytes = as_double ? 8 : 4;
        if (as_double) {
            double d = wide ? wide[i] : (double)narrow[i];
            memcpy(&v, &d, 8);
        } else if (narrow) {
            uint32_t w;
            memcpy(&w, &narrow[i], 4);
            v = w;
        } else {
            float f = (float)wide[i];
            uint32_t w;
            memcpy(&w, &f, 4);
            v = w;
        }
        for (int b = 0; b < bytes; b++) little[b] = (uint8_t)(v >> 8 * b);
        image_bytes_append(out, little, (size_t)bytes);
    }
    return SLT_OK;
}

SltStatus image_encode_npy(const char *name, const Image *im, const ImageWriteOptions *opt, Bytes *out, SltError *err) {
    (void)name;
    size_t shape[3] = {(size_t)im->height, (size_t)im->width, (size_t)im->channels};
    return npy_encode(3, shape, im->data, NULL, opt->wide, out, err);
}

SltStatus npy_write(const char *path, int rank, const size_t *shape, const double *data, bool wide, SltError *err) {
    Bytes b = {0};
    return image_bytes_save(&b, path, npy_encode(rank, shape, NULL, data, wide, &b, err), err);
}
