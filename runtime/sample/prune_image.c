/* Boxes of pixels: the whole rectangle, then up to 64 parts of it in one call of `prune`, each with what runs in it.
 */
#include <math.h>

#include "runtime/sample/prune.h"

/* Parts along a side, so that a few vectors of them make a call; and the side below which more boxes cost more than
 * they save. */
static const uint32_t parts[4] = {1, 16, 8, 2}, least[4] = {1, 64, 8, 8};

bool prune_can(const SltScene *s) { return s->chunks && s->kernel[SLT_K_PRUNE] && s->kernel[SLT_K_PRUNED]; }

uint32_t prune_tile(uint32_t dim, const uint32_t n[3]) {
    enum { ENOUGH = 16 };
    uint32_t side = parts[dim] * parts[dim] * least[dim];
    for (; side > parts[dim] * least[dim]; side /= 2) {
        uint64_t tiles = 1;
        for (uint32_t d = 0; d < dim; d++) tiles *= (n[d] + side - 1) / side;
        if (tiles >= ENOUGH) break;
    }
    return side;
}

static void set_box(Batch *b, const PruneImage *image, uint32_t i, const PixelRect *r) {
    /* Some more than the pixels, so that no sample falls out by rounding. */
    double grow = image->reach + 0.01;
    for (uint32_t d = 0; d < image->dim; d++) {
        batch_set(b, SLT_IN_X0 + d, i, image->lo[d] + (r->lo[d] - grow) * image->side[d]);
        batch_set(b, SLT_IN_H0 + d, i, image->lo[d] + (r->lo[d] + r->n[d] + grow) * image->side[d]);
    }
}

static bool is_constant(const Batch *b, const PruneImage *image, uint32_t i, double *value) {
    for (uint32_t c = 0; c < image->channels; c++) {
        double lo = batch_get(b, SLT_OUT_F_LO, c, i);
        if (!(lo == batch_get(b, SLT_OUT_F_HI, c, i)) || !isfinite(lo)) return false;
        value[c] = lo;
    }
    return true;
}

/* The boxes of one call: r in equal parts of `side` pixels. */
static uint32_t cut(const PruneImage *image, const PixelRect *r, uint32_t side, PixelRect *part) {
    uint32_t n = 0, at[3];
    for (at[2] = 0; at[2] < r->n[2]; at[2] += side)
        for (at[1] = 0; at[1] < r->n[1]; at[1] += side)
            for (at[0] = 0; at[0] < r->n[0]; at[0] += side, n++)
                for (uint32_t d = 0; d < 3; d++) {
                    uint32_t left = r->n[d] - at[d];
                    part[n].lo[d] = r->lo[d] + at[d], part[n].n[d] = d < image->dim && left > side ? side : left;
                }
    return n;
}

static uint32_t longest_side(const PruneImage *image, const PixelRect *r) {
    uint32_t longest = 1;
    for (uint32_t d = 0; d < image->dim; d++) longest = r->n[d] > longest ? r->n[d] : longest;
    return longest;
}

/* r, the box of this level, by parts with sides of so many pixels. */
static void visit(Pruner *p, Batch *b, const PruneImage *image, const PixelRect *r, uint32_t side, uint32_t level) {
    PixelRect part[SLT_CHOICE_BOXES];
    double value[SLT_CHOICE_BOXES][SLT_MAX_CHANNELS];
    bool constant[SLT_CHOICE_BOXES];
    uint32_t n = cut(image, r, side, part);
    for (uint32_t i = 0; i < n; i++) set_box(b, image, i, &part[i]);
    prune_boxes(p, b, level, n);
    for (uint32_t i = 0; i < n; i++) constant[i] = !p->c->effects && is_constant(b, image, i, value[i]);
    for (uint32_t i = 0; i < n; i++) {
        if (constant[i]) {
            image->constant(image->user, &part[i], value[i]);
            continue;
        }
        prune_pick(p, level, i);
        uint32_t longest = longest_side(image, &part[i]), below = (longest + parts[image->dim] - 1) / parts[image->dim];
        if (longest > least[image->dim] && level + 2 < PRUNE_LEVELS)
            visit(p, b, image, &part[i], below > least[image->dim] ? below : least[image->dim], level + 1);
        else image->sample(image->user, &part[i], &p->level[level + 1].pruned);
    }
}

void prune_image(Pruner *p, Batch *b, const PruneImage *image, const PixelRect *r) {
    visit(p, b, image, r, longest_side(image, r), 0);
}
