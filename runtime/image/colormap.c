/* Colour maps, and the picture of a signed image with its scale in it. */
#include "internal.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MARGIN = 8, BAR_HEIGHT = 12, TEXT_HEIGHT = 9, SMALLEST_WIDTH = 256 };

static void interpolate(const uint8_t (*knots)[3], int count, double t, uint8_t rgb[3]) {
    if (isnan(t)) {
        rgb[0] = 255;
        rgb[1] = 0;
        rgb[2] = 255;
        return;
    }
    t = fmin(fmax(t, 0), 1) * (count - 1);
    int i = (int)t;
    i = i > count - 2 ? count - 2 : i;
    for (int c = 0; c < 3; c++) rgb[c] = (uint8_t)lrint(knots[i][c] + (t - i) * (knots[i + 1][c] - knots[i][c]));
}

void colormap_diverging(double t, uint8_t rgb[3]) {
    /* lightness falls evenly to both sides of a neutral middle, so that equal magnitudes look equal
     */
    static const uint8_t knots[][3] = {{16, 44, 108},   {40, 92, 168},   {92, 146, 208},
                                       {164, 198, 232}, {246, 246, 244}, {240, 186, 160},
                                       {218, 122, 96},  {178, 56, 56},   {104, 14, 36}};
    interpolate(knots, 9, 0.5 + 0.5 * t, rgb);
}

void colormap_sequential(double t, uint8_t rgb[3]) {
    static const uint8_t knots[][3] = {{8, 8, 28},    {48, 20, 88},   {108, 30, 108}, {168, 44, 96},
                                       {218, 80, 62}, {244, 140, 40}, {250, 204, 88}, {252, 252, 214}};
    interpolate(knots, 8, t, rgb);
}

static double value_at(const Image *im, size_t pixel, int channel, const int *root, int n) {
    const float *p = im->data + pixel * (size_t)im->channels;
    if (channel >= 0) return p[channel];
    return n >= 3 ? ((double)p[root[0]] + p[root[1]] + p[root[2]]) / 3 : p[root[0]];
}

/* A short number with its sign, with a point in every locale. */
static void print_scale(double v, char out[32]) {
    snprintf(out, 32, "%+.3g", v);
    for (char *p = out; *p; p++) *p = *p == ',' ? '.' : *p;
}

static void draw_bar(uint8_t *rgb, int width, int height, int top, double scale, const char *title) {
    static const uint8_t ink[3] = {40, 40, 40};
    int left = MARGIN, right = width - MARGIN;
    for (int x = left; x < right; x++) {
        uint8_t colour[3];
        colormap_diverging(2.0 * (x - left) / (right - 1 - left) - 1, colour);
        for (int y = top; y < top + BAR_HEIGHT; y++)
            memcpy(rgb + ((size_t)y * (size_t)width + (size_t)x) * 3, colour, 3);
    }
    int text_y = top + BAR_HEIGHT + 4;
    char lo[32], hi[32];
    print_scale(-scale, lo);
    print_scale(scale, hi);
    font_draw(rgb, width, height, left, text_y, lo, 1, ink);
    font_draw(rgb, width, height, (left + right - font_measure("0", 1)) / 2, text_y, "0", 1, ink);
    font_draw(rgb, width, height, right - font_measure(hi, 1), text_y, hi, 1, ink);
    if (title && title[0]) {
        char cut[200];
        int room = (right - left + 1) / 6;
        snprintf(cut, sizeof cut, "%s", title);
        if (room < (int)strlen(cut)) snprintf(cut + (room > 2 ? room - 2 : 0), 3, "..");
        font_draw(rgb, width, height, (left + right - font_measure(cut, 1)) / 2, text_y + TEXT_HEIGHT + 4, cut, 1, ink);
    }
}

SltStatus image_draw_diverging(const Image *im, int channel, double scale, const char *title, uint8_t **pixels,
                               int *width, int *height, SltError *err) {
    int root[4];
    int n = image_root_channels(im, root);
    *pixels = NULL;
    if (channel < -1 || channel >= im->channels)
        return status_fail(err, SLT_USAGE, "the image has no channel %d", channel);
    size_t count = (size_t)im->width * (size_t)im->height;
    if (!(scale > 0) || !isfinite(scale)) {
        scale = 0;
        for (size_t i = 0; i < count; i++) {
            double v = fabs(value_at(im, i, channel, root, n));
            scale = isfinite(v) && v > scale ? v : scale;
        }
        scale = scale > 0 ? scale : 1;
    }
    int zoom = im->width < SMALLEST_WIDTH ? (SMALLEST_WIDTH + im->width - 1) / im->width : 1;
    while (zoom > 1 && (double)im->height * zoom > 4096) zoom--; /* a tall sliver is not worth a huge picture */
    int drawn = im->width * zoom, w = drawn < SMALLEST_WIDTH ? SMALLEST_WIDTH : drawn, x0 = (w - drawn) / 2;
    int band = MARGIN + BAR_HEIGHT + 4 + TEXT_HEIGHT + (title && title[0] ? TEXT_HEIGHT + 4 : 0) + MARGIN;
    int h = im->height * zoom + band;
    uint8_t *rgb = malloc((size_t)w * (size_t)h * 3);
    if (!rgb) return status_fail(err, SLT_LIMIT, "out of memory for a picture of %d x %d pixels", w, h);
    memset(rgb, 255, (size_t)w * (size_t)h * 3);
    for (int y = 0; y < im->height * zoom; y++) {
        for (int x = 0; x < drawn; x++) {
            size_t pixel = (size_t)(y / zoom) * (size_t)im->width + (size_t)(x / zoom);
            colormap_diverging(value_at(im, pixel, channel, root, n) / scale,
                               rgb + ((size_t)y * (size_t)w + (size_t)(x0 + x)) * 3);
        }
    }
    draw_bar(rgb, w, h, im->height * zoom + MARGIN, scale, title);
    *pixels = rgb;
    *width = w;
    *height = h;
    return SLT_OK;
}

SltStatus image_write_diverging(const char *path, const Image *im, int channel, double scale, const char *title,
                                SltError *err) {
    uint8_t *rgb;
    int w, h;
    SltStatus status = image_draw_diverging(im, channel, scale, title, &rgb, &w, &h, err);
    if (status == SLT_OK) status = image_write_png8(path, w, h, 3, rgb, err);
    free(rgb);
    return status;
}
