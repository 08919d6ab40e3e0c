/* The Image itself: making, naming, converting, resizing. */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* strdup */
#endif
#include "internal.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

SltStatus image_create(Image *out, int width, int height, int channels, SltError *err) {
    *out = (Image){0};
    if (width < 1 || height < 1 || channels < 1)
        return status_fail(err, SLT_USAGE, "an image of %d x %d pixels and %d channels", width, height, channels);
    if (width > IMAGE_MAX_SIDE || height > IMAGE_MAX_SIDE || channels > IMAGE_MAX_CHANNELS ||
        (double)width * height * channels > IMAGE_MAX_SAMPLES) {
        return status_fail(err, SLT_LIMIT,
                           "an image of %d x %d pixels and %d channels is too large (at most 2^28 "
                           "samples)",
                           width, height, channels);
    }
    Image im = {.width = width, .height = height, .channels = channels};
    im.data = calloc((size_t)width * (size_t)height * (size_t)channels, sizeof *im.data);
    im.names = calloc((size_t)channels, sizeof *im.names);
    if (!im.data || !im.names) {
        image_free(&im);
        return status_fail(err, SLT_LIMIT, "out of memory for an image of %d x %d pixels and %d channels", width,
                           height, channels);
    }
    for (int c = 0; c < channels; c++) {
        const Image unnamed = {.channels = channels};
        char buf[IMAGE_NAME_SIZE];
        image_set_name(&im, c, image_get_name(&unnamed, c, buf));
    }
    *out = im;
    return SLT_OK;
}

void image_free(Image *im) {
    if (!im) return;
    free(im->data);
    free(im->names);
    for (int i = 0; i < im->attr_count; i++) {
        free(im->attrs[i].name);
        free(im->attrs[i].text);
    }
    free(im->attrs);
    *im = (Image){0};
}

void image_set_name(Image *im, int c, const char *name) { snprintf(im->names[c], IMAGE_NAME_SIZE, "%s", name); }

const char *image_get_name(const Image *im, int c, char buf[IMAGE_NAME_SIZE]) {
    static const char *const usual[5][4] = {{""}, {"Y"}, {"Y", "A"}, {"R", "G", "B"}, {"R", "G", "B", "A"}};
    if (im->names) snprintf(buf, IMAGE_NAME_SIZE, "%s", im->names[c]);
    else if (im->channels <= 4) snprintf(buf, IMAGE_NAME_SIZE, "%s", usual[im->channels][c]);
    else snprintf(buf, IMAGE_NAME_SIZE, "c%d", c);
    return buf;
}

int image_find_channel(const Image *im, const char *name) {
    char buf[IMAGE_NAME_SIZE];
    for (int c = 0; c < im->channels; c++)
        if (strcmp(image_get_name(im, c, buf), name) == 0) return c;
    return -1;
}

const ImageAttr *image_find_attr(const Image *im, const char *name) {
    for (int i = 0; i < im->attr_count; i++)
        if (strcmp(im->attrs[i].name, name) == 0) return &im->attrs[i];
    return NULL;
}

/* The attribute of that name, made if need be; NULL when out of memory. */
static ImageAttr *touch_attr(Image *im, const char *name) {
    for (int i = 0; i < im->attr_count; i++)
        if (strcmp(im->attrs[i].name, name) == 0) return &im->attrs[i];
    char *copy = strdup(name);
    ImageAttr *grown = realloc(im->attrs, (size_t)(im->attr_count + 1) * sizeof *grown);
    if (grown) im->attrs = grown;
    if (!copy || !grown) {
        free(copy);
        return NULL;
    }
    grown[im->attr_count] = (ImageAttr){.name = copy};
    return &grown[im->attr_count++];
}

bool image_set_text(Image *im, const char *name, const char *text) {
    char *copy = strdup(text);
    ImageAttr *a = copy ? touch_attr(im, name) : NULL;
    if (!a) {
        free(copy);
        return !(im->incomplete = true);
    }
    free(a->text);
    a->text = copy;
    return true;
}

bool image_set_number(Image *im, const char *name, double number) {
    ImageAttr *a = touch_attr(im, name);
    if (!a) return !(im->incomplete = true);
    free(a->text);
    a->text = NULL;
    a->number = number;
    return true;
}

SltStatus image_check_claim(const char *name, double width, double height, double channels, size_t file_size,
                            SltError *err) {
    double samples = width * height * channels;
    if (!(width >= 1 && height >= 1 && channels >= 1)) {
        return status_fail(err, SLT_INPUT, "'%s' is empty or damaged: it claims %.0f x %.0f pixels, %.0f channels",
                           name, width, height, channels);
    }
    if (width > IMAGE_MAX_SIDE || height > IMAGE_MAX_SIDE || channels > IMAGE_MAX_CHANNELS ||
        samples > IMAGE_MAX_SAMPLES) {
        return status_fail(err, SLT_LIMIT,
                           "'%s' is too large: %.0f x %.0f pixels, %.0f channels (at most 2^28 "
                           "samples)",
                           name, width, height, channels);
    }
    /* deflate shrinks at most 1032 to 1, so beyond this ratio the claimed size is a lie (or a bomb) */
    if (samples * 4 > 64.0 * (1 << 20) + 2048.0 * (double)file_size) {
        return status_fail(err, SLT_INPUT, "'%s' is damaged: %zu bytes cannot hold %.0f x %.0f pixels, %.0f channels",
                           name, file_size, width, height, channels);
    }
    return SLT_OK;
}

int image_root_channels(const Image *im, int index[4]) {
    int r = image_find_channel(im, "R"), g = image_find_channel(im, "G"), b = image_find_channel(im, "B");
    int y = image_find_channel(im, "Y"), a = image_find_channel(im, "A"), n = 0;
    if (r >= 0 && g >= 0 && b >= 0) {
        index[n++] = r;
        index[n++] = g;
        index[n++] = b;
    } else if (y >= 0) {
        index[n++] = y;
    } else {
        char buf[IMAGE_NAME_SIZE];
        for (int c = 0; c < im->channels && n < 4; c++)
            if (!strchr(image_get_name(im, c, buf), '.')) index[n++] = c;
        if (n == 0) index[n++] = 0;
        return n;
    }
    if (a >= 0) index[n++] = a;
    return n;
}

SltStatus image_extract_layer(const Image *im, const char *layer, Image *out, SltError *err) {
    *out = (Image){0};
    int *picked = malloc((size_t)im->channels * sizeof *picked);
    if (!picked) return status_fail(err, SLT_LIMIT, "out of memory");
    int n = 0;
    size_t prefix = strlen(layer);
    char buf[IMAGE_NAME_SIZE];
    for (int c = 0; c < im->channels; c++) {
        const char *name = image_get_name(im, c, buf), *dot = strrchr(name, '.');
        size_t length = dot ? (size_t)(dot - name) : 0;
        if (length == prefix && strncmp(name, layer, prefix) == 0) picked[n++] = c;
    }
    if (n == 0) {
        free(picked);
        return status_fail(err, SLT_INPUT, "the image has no layer '%s'", layer);
    }
    SltStatus status = image_create(out, im->width, im->height, n, err);
    if (status == SLT_OK) {
        size_t pixels = (size_t)im->width * (size_t)im->height;
        for (int k = 0; k < n; k++) {
            const char *name = image_get_name(im, picked[k], buf), *dot = strrchr(name, '.');
            image_set_name(out, k, dot ? dot + 1 : name);
            for (size_t p = 0; p < pixels; p++)
                out->data[p * (size_t)n + (size_t)k] = im->data[p * (size_t)im->channels + (size_t)picked[k]];
        }
    }
    free(picked);
    return status;
}

SltStatus image_convert_channels(const Image *im, int channels, Image *out, SltError *err) {
    *out = (Image){0};
    if (channels < 1 || channels > 4)
        return status_fail(err, SLT_USAGE, "an image cannot be converted to %d channels", channels);
    int src[4];
    int n = image_root_channels(im, src);
    SltStatus status = image_create(out, im->width, im->height, channels, err);
    if (status != SLT_OK) return status;
    bool colour = n >= 3, wants_colour = channels >= 3;
    size_t pixels = (size_t)im->width * (size_t)im->height;
    for (size_t p = 0; p < pixels; p++) {
        const float *from = im->data + p * (size_t)im->channels;
        float *to = out->data + p * (size_t)channels;
        float alpha = n == 4 ? from[src[3]] : n == 2 ? from[src[1]] : 1.0f;
        float grey = colour ? 0 : from[src[0]];
        if (wants_colour)
            for (int c = 0; c < 3; c++) to[c] = colour ? from[src[c]] : grey;
        else to[0] = colour ? image_luminance(from[src[0]], from[src[1]], from[src[2]]) : grey;
        if (channels == 2 || channels == 4) to[channels - 1] = alpha;
    }
    return SLT_OK;
}

SltStatus image_take_channels(Image *im, int channels, Image *out, SltError *err) {
    int src[4];
    bool same = im->channels == channels && channels <= 4 && image_root_channels(im, src) == channels;
    for (int c = 0; same && c < channels; c++) same = src[c] == c;
    if (same) {
        *out = *im, *im = (Image){0};
        return SLT_OK;
    }
    SltStatus status = image_convert_channels(im, channels, out, err);
    image_free(im);
    return status;
}

/* One axis of a resize: for each output cell the first input cell and its weights. */
typedef struct Taps {
    int *first, *count;
    double *weight; /* `stride` for each output cell */
    int stride;
} Taps;

static void free_taps(Taps *t) {
    free(t->first);
    free(t->count);
    free(t->weight);
}

static bool make_taps(Taps *t, int from, int to) {
    double ratio = (double)from / to;
    *t = (Taps){.stride = to <= from ? (int)ceil(ratio) + 2 : 2};
    t->first = malloc((size_t)to * sizeof *t->first);
    t->count = malloc((size_t)to * sizeof *t->count);
    t->weight = malloc((size_t)to * (size_t)t->stride * sizeof *t->weight);
    if (!t->first || !t->count || !t->weight) return false;
    for (int i = 0; i < to; i++) {
        double *w = t->weight + (size_t)i * (size_t)t->stride;
        if (to <= from) { /* area: the overlap of [lo, hi] with each cell */
            double lo = i * ratio, hi = (i + 1) * ratio;
            int a = (int)floor(lo), n = 0;
            for (int j = a; j < from && n < t->stride; j++) {
                double overlap = fmin(hi, j + 1.0) - fmax(lo, j);
                if (overlap <= 1e-9) break;
                w[n++] = overlap / ratio;
            }
            t->first[i] = a;
            t->count[i] = n;
        } else { /* bilinear between cell centres */
            double x = (i + 0.5) * ratio - 0.5;
            int a = (int)floor(x);
            double f = x - a;
            if (a < 0 || a + 1 >= from) {
                t->first[i] = a < 0 ? 0 : from - 1;
                t->count[i] = 1;
                w[0] = 1;
            } else {
                t->first[i] = a;
                t->count[i] = f > 0 ? 2 : 1; /* a weight of zero must not spread a NaN */
                w[0] = 1 - f;
                w[1] = f;
            }
        }
    }
    return true;
}

SltStatus image_resize(const Image *im, int width, int height, Image *out, SltError *err) {
    SltStatus status = image_create(out, width, height, im->channels, err);
    if (status != SLT_OK) return status;
    char buf[IMAGE_NAME_SIZE];
    for (int c = 0; c < im->channels; c++) image_set_name(out, c, image_get_name(im, c, buf));
    int n = im->channels;
    size_t row = (size_t)width * (size_t)n;
    Taps tx = {0}, ty = {0};
    double *middle = malloc(row * sizeof *middle), *sum = malloc(row * sizeof *sum);
    bool ok = make_taps(&tx, im->width, width) && make_taps(&ty, im->height, height) && middle && sum;
    for (int y = 0; ok && y < height; y++) {
        memset(sum, 0, row * sizeof *sum);
        for (int k = 0; k < ty.count[y]; k++) {
            const float *src = im->data + (size_t)(ty.first[y] + k) * (size_t)im->width * (size_t)n;
            double wy = ty.weight[(size_t)y * (size_t)ty.stride + (size_t)k];
            memset(middle, 0, row * sizeof *middle);
            for (int x = 0; x < width; x++) {
                for (int j = 0; j < tx.count[x]; j++) {
                    double wx = tx.weight[(size_t)x * (size_t)tx.stride + (size_t)j];
                    for (int c = 0; c < n; c++) {
                        middle[(size_t)x * (size_t)n + (size_t)c] +=
                            wx * src[(size_t)(tx.first[x] + j) * (size_t)n + (size_t)c];
                    }
                }
            }
            for (size_t i = 0; i < row; i++) sum[i] += wy * middle[i];
        }
        for (size_t i = 0; i < row; i++) out->data[(size_t)y * row + i] = (float)sum[i];
    }
    free_taps(&tx);
    free_taps(&ty);
    free(middle);
    free(sum);
    if (!ok) {
        image_free(out);
        return status_fail(err, SLT_LIMIT, "out of memory for an image of %d x %d pixels", width, height);
    }
    return SLT_OK;
}

SltStatus image_film_strip(const Image *const *images, int count, int gap, Image *out, SltError *err) {
    *out = (Image){0};
    if (count < 1 || gap < 0) return status_fail(err, SLT_USAGE, "a film strip needs at least one image");
    int64_t width = (int64_t)gap * (count - 1);
    int height = 0, channels = images[0]->channels;
    for (int i = 0; i < count; i++) {
        if (images[i]->channels != channels || channels > 4)
            return status_fail(err, SLT_USAGE, "the images of a film strip need the same 1 to 4 channels");
        width += images[i]->width;
        height = images[i]->height > height ? images[i]->height : height;
    }
    SltStatus status = image_create(out, width > INT32_MAX ? INT32_MAX : (int)width, height, channels, err);
    if (status != SLT_OK) return status;
    size_t total = (size_t)width * (size_t)height * (size_t)channels;
    for (size_t i = 0; i < total; i++) out->data[i] = 1;
    size_t x = 0;
    for (int i = 0; i < count; i++) {
        size_t row = (size_t)images[i]->width * (size_t)channels;
        for (int y = 0; y < images[i]->height; y++) {
            memcpy(out->data + ((size_t)y * (size_t)width + x) * (size_t)channels, images[i]->data + (size_t)y * row,
                   row * sizeof *out->data);
        }
        x += (size_t)images[i]->width + (size_t)gap;
    }
    return SLT_OK;
}

float image_encode_srgb(float v) {
    if (!(v > 0)) return 0;
    if (v >= 1) return 1;
    return v <= 0.0031308f ? 12.92f * v : (float)(1.055 * pow(v, 1 / 2.4) - 0.055);
}

float image_decode_srgb(float v) { return v <= 0.04045f ? v / 12.92f : (float)pow((v + 0.055) / 1.055, 2.4); }

float image_luminance(float r, float g, float b) { return 0.2126f * r + 0.7152f * g + 0.0722f * b; }
