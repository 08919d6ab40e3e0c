/* SRTM tiles (.hgt): a square of big-endian int16 metres, the northern row first, with -32768 where
 * the radar saw nothing.
 *
 * Voids are filled from what is around them: averages of the samples that are there, over blocks of
 * doubling size, and then back down, each void taking the bilinear value of the coarser level. A tile
 * with more than a quarter of voids is refused: so much terrain should not be a guess. */
#include "internal.h"

#include <stdlib.h>

enum { VOID = -32768, MAX_LEVELS = 24 };

/* One level: values without NaN, and for each whether it is known. */
typedef struct Level {
    int side;
    float *value;
    uint8_t *known;
} Level;

static bool level_make(Level *l, int side) {
    size_t n = (size_t)side * (size_t)side;
    *l = (Level){side, malloc(n * sizeof *l->value), malloc(n)};
    return l->value && l->known;
}

static void level_free(Level *l) {
    free(l->value);
    free(l->known);
}

static void average(const Level *fine, Level *coarse) {
    for (int y = 0; y < coarse->side; y++) {
        for (int x = 0; x < coarse->side; x++) {
            float sum = 0;
            int n = 0;
            for (int k = 0; k < 4; k++) {
                int fx = 2 * x + (k & 1), fy = 2 * y + (k >> 1);
                size_t i = (size_t)fy * (size_t)fine->side + (size_t)fx;
                if (fx < fine->side && fy < fine->side && fine->known[i]) {
                    sum += fine->value[i];
                    n++;
                }
            }
            size_t i = (size_t)y * (size_t)coarse->side + (size_t)x;
            coarse->known[i] = n > 0;
            coarse->value[i] = n > 0 ? sum / (float)n : 0;
        }
    }
}

/* The cell of the coarser level on either side of a fine coordinate, and the weight of the second. */
static void neighbours(int fine, int side, int at[2], float *weight) {
    int first = (fine + 1) / 2 - 1; /* fine centre (fine + 0.5) / 2 - 0.5 in coarse units */
    *weight = fine & 1 ? 0.25f : 0.75f;
    at[0] = first < 0 ? 0 : first;
    at[1] = first + 1 < side ? first + 1 : side - 1;
}

/* `coarse` is full. */
static void fill_from(Level *fine, const Level *coarse) {
    for (int y = 0; y < fine->side; y++) {
        for (int x = 0; x < fine->side; x++) {
            size_t i = (size_t)y * (size_t)fine->side + (size_t)x;
            if (fine->known[i]) continue;
            int cx[2], cy[2];
            float wx, wy, row[2];
            neighbours(x, coarse->side, cx, &wx);
            neighbours(y, coarse->side, cy, &wy);
            for (int k = 0; k < 2; k++) {
                const float *v = coarse->value + (size_t)cy[k] * (size_t)coarse->side;
                row[k] = v[cx[0]] + wx * (v[cx[1]] - v[cx[0]]);
            }
            fine->value[i] = row[0] + wy * (row[1] - row[0]);
            fine->known[i] = 1;
        }
    }
}

/* At least one sample is known. False when out of memory. */
static bool fill_voids(Level *base) {
    Level level[MAX_LEVELS] = {*base};
    int n = 1;
    bool memory = true;
    while (memory && level[n - 1].side > 1) {
        memory = level_make(&level[n], (level[n - 1].side + 1) / 2);
        n++;
        if (memory) average(&level[n - 2], &level[n - 1]);
    }
    for (int k = n - 2; memory && k >= 0; k--) fill_from(&level[k], &level[k + 1]);
    for (int k = 1; k < n; k++) level_free(&level[k]);
    return memory;
}

SltStatus image_decode_hgt(const char *name, const uint8_t *bytes, size_t size, const ImageReadOptions *opt, Image *out,
                           SltError *err) {
    (void)opt;
    *out = (Image){0};
    size_t side = 0;
    while ((side + 1) * (side + 1) * 2 <= size && side < IMAGE_MAX_SIDE) side++;
    if (side < 2 || side * side * 2 != size) {
        return status_fail(err, SLT_INPUT,
                           "cannot read '%s': %zu bytes are no square of 16-bit heights (1201 x "
                           "1201 or 3601 x 3601)",
                           name, size);
    }
    SltStatus status = image_check_claim(name, (double)side, (double)side, 1, size, err);
    status = status ? status : image_create(out, (int)side, (int)side, 1, err);
    if (status != SLT_OK) return status;
    size_t n = side * side, voids = 0;
    Level base = {(int)side, out->data, malloc(n)};
    if (!base.known) {
        image_free(out);
        return status_fail(err, SLT_LIMIT, "cannot read '%s': out of memory", name);
    }
    for (size_t i = 0; i < n; i++) {
        int v = (int16_t)(uint16_t)(bytes[2 * i] << 8 | bytes[2 * i + 1]);
        base.known[i] = v != VOID;
        out->data[i] = (float)v;
        voids += v == VOID;
    }
    if (voids > n / 4) {
        status = status_fail(err, SLT_INPUT,
                             "cannot read '%s': %zu of its %zu heights are voids; more than a "
                             "quarter is not filled",
                             name, voids, n);
    } else if (voids && !fill_voids(&base)) {
        status = status_fail(err, SLT_LIMIT, "cannot read '%s': out of memory", name);
    }
    free(base.known);
    if (status != SLT_OK) image_free(out);
    return status;
}
