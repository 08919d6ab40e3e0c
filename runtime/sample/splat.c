/* Rectangles of pixels, and what points add to them. */
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/splat.h"

static uint64_t pixels_of(const Splat *p) { return (uint64_t)p->n[0] * p->n[1] * p->n[2]; }

static bool room(void **v, uint64_t *cap, uint64_t need, size_t size) {
    if (need > *cap) {
        free(*v);
        *v = malloc(need * size);
        *cap = *v ? need : 0;
        if (!*v) return false;
    }
    memset(*v, 0, need * size);
    return true;
}

bool splat_begin(Splat *p, const Grid *g, uint32_t planes, uint32_t channels, const double lo[3], const double hi[3]) {
    p->grid = g, p->planes = planes, p->channels = channels;
    for (uint32_t d = 0; d < 3; d++) {
        p->lo[d] = 0, p->n[d] = 1;
        if (d >= g->dim) continue;
        double reach = (g->filter == SLT_FILTER_BOX ? 1 : g->radius + 1) * g->side[d];
        uint32_t a = grid_cell(g, d, lo[d] - reach), b = grid_cell(g, d, hi[d] + reach);
        p->lo[d] = a, p->n[d] = b - a + 1;
    }
    uint64_t pixels = pixels_of(p);
    return room((void **)&p->value, &p->cap, pixels * planes * channels, sizeof *p->value) &&
           room((void **)&p->count, &p->count_cap, pixels, sizeof *p->count) &&
           room((void **)&p->share, &p->share_cap, (uint64_t)p->n[0] + p->n[1] + p->n[2], sizeof *p->share);
}

void splat_free(Splat *p) {
    free(p->value), free(p->count), free(p->share);
    memset(p, 0, sizeof *p);
}

/* Of the box filter one pixel has it all. */
static void add_to_one(Splat *p, uint32_t plane, const double x[3], const double *value) {
    const Grid *g = p->grid;
    uint64_t at[3] = {0};
    for (uint32_t d = 0; d < g->dim; d++) {
        at[d] = (uint64_t)grid_cell(g, d, x[d]) - p->lo[d];
        if (at[d] >= p->n[d]) return;
    }
    double *to = p->value + (plane * pixels_of(p) + (at[2] * p->n[1] + at[1]) * p->n[0] + at[0]) * p->channels;
    for (uint32_t c = 0; c < p->channels; c++) to[c] += g->density * value[c];
}

void splat_add(Splat *p, uint32_t plane, const double x[3], const double *value) {
    const Grid *g = p->grid;
    if (g->filter == SLT_FILTER_BOX && !g->integral) {
        add_to_one(p, plane, x, value);
        return;
    }
    uint32_t channels = p->channels, first[3] = {0}, n[3] = {1, 1, 1};
    double w[3][GRID_REACH] = {{1}, {1}, {1}};
    for (uint32_t d = 0; d < g->dim; d++) n[d] = grid_reach(g, d, x[d], &first[d], w[d]);
    double *base = p->value + plane * pixels_of(p) * channels;
    for (uint32_t z = 0; z < n[2]; z++)
        for (uint32_t y = 0; y < n[1]; y++)
            for (uint32_t i = 0; i < n[0]; i++) {
                uint64_t rx = first[0] + i - p->lo[0], ry = first[1] + y - p->lo[1], rz = first[2] + z - p->lo[2];
                if (rx >= p->n[0] || ry >= p->n[1] || rz >= p->n[2]) continue;
                double *to = base + ((rz * p->n[1] + ry) * p->n[0] + rx) * channels,
                       weight = w[0][i] * w[1][y] * w[2][z];
                for (uint32_t c = 0; c < channels; c++) to[c] += weight * value[c];
            }
}

void splat_add_box(Splat *p, const double lo[3], const double hi[3], const double *value) {
    const Grid *g = p->grid;
    uint32_t from[3] = {0}, to[3] = {1, 1, 1};
    double *share[3] = {p->share, p->share + p->n[0], p->share + p->n[0] + p->n[1]};
    share[0][0] = share[1][0] = share[2][0] = 1;
    for (uint32_t d = 0; d < g->dim; d++) {
        double reach = (g->filter == SLT_FILTER_BOX ? 0 : g->radius) * g->side[d];
        from[d] = grid_cell(g, d, lo[d] - reach), to[d] = grid_cell(g, d, hi[d] + reach) + 1;
        from[d] = from[d] > p->lo[d] ? from[d] - p->lo[d] : 0;
        to[d] = to[d] > p->lo[d] ? to[d] - p->lo[d] : 0;
        if (to[d] > p->n[d]) to[d] = p->n[d];
        for (uint32_t i = from[d]; i < to[d]; i++) share[d][i] = grid_share(g, d, p->lo[d] + i, lo[d], hi[d]);
    }
    for (uint32_t z = from[2]; z < to[2]; z++)
        for (uint32_t y = from[1]; y < to[1]; y++)
            for (uint32_t i = from[0]; i < to[0]; i++) {
                double weight = share[0][i] * share[1][y] * share[2][z];
                double *at = p->value + (((uint64_t)z * p->n[1] + y) * p->n[0] + i) * p->channels;
                for (uint32_t c = 0; c < p->channels; c++) at[c] += weight * value[c];
            }
}

void splat_count(Splat *p, const double x[3]) {
    uint64_t r[3];
    for (uint32_t d = 0; d < 3; d++) {
        r[d] = grid_cell(p->grid, d, x[d]) - p->lo[d];
        if (r[d] >= p->n[d]) return;
    }
    p->count[(r[2] * p->n[1] + r[1]) * p->n[0] + r[0]] += 1;
}

void splat_merge(const Splat *p, float *const *out, float *counts) {
    uint64_t pixels = pixels_of(p);
    for (uint32_t z = 0; z < p->n[2]; z++)
        for (uint32_t y = 0; y < p->n[1]; y++) {
            uint64_t to = grid_index(p->grid, p->lo[0], p->lo[1] + y, p->lo[2] + z);
            uint64_t from = ((uint64_t)z * p->n[1] + y) * p->n[0];
            for (uint32_t d = 0; d < p->planes; d++) {
                const double *v = p->value + (d * pixels + from) * p->channels;
                float *o = out[d] + to * p->channels;
                for (uint64_t i = 0; i < (uint64_t)p->n[0] * p->channels; i++)
                    if (v[i] != 0) o[i] = (float)((double)o[i] + v[i]);
            }
            if (counts)
                for (uint32_t i = 0; i < p->n[0]; i++) counts[to + i] += p->count[from + i];
        }
}
