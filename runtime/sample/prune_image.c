/* Boxes of pixels: up to 64 parts of a box in one call of `prune`, each with what runs in it; of the last parts only
 * whether f is one value there.
 */

#include "runtime/sample/prune.h"

/* Parts along a side, so that they fill a vector or a few, and the most of a call; and sides of the boxes that are
 * picked last and of their parts: to pick what runs in a smaller box costs more than it saves, but a smaller box more
 * often has one value, and to see that costs little. */
static const uint32_t parts[4] = {1, 16, 4, 4}, most[4] = {1, 64, 8, 4}, picked[4] = {1, 256, 16, 16},
                      least[4] = {1, 16, 4, 4};

bool prune_can(const SltScene *s) { return s->chunks && s->kernel[SLT_K_PRUNE] && s->kernel[SLT_K_PRUNED]; }

uint32_t prune_tile(uint32_t dim, const uint32_t n[3]) {
    enum { ENOUGH = 16 };
    uint32_t side = parts[dim] * parts[dim] * parts[dim] * picked[dim];
    for (; side > parts[dim] * picked[dim]; side /= 2) {
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

/* Cuts r, the box of this level, and fills the parts in which f has one value. The others come to the front of
 * part; returns them as bits of the call, which they are in order. */
static uint64_t cut_and_fill(Pruner *p, Batch *b, const PruneImage *image, const PixelRect *r, uint32_t side,
                             uint32_t level, PixelRect *part) {
    double value[SLT_MAX_CHANNELS];
    uint32_t n = cut(image, r, side, part), kept = 0;
    uint64_t boxes = 0;
    for (uint32_t i = 0; i < n; i++) set_box(b, image, i, &part[i]);
    prune_boxes(p, b, level, n);
    for (uint32_t i = 0; i < n; i++)
        if (!p->c->effects && batch_is_constant(b, i, value)) image->constant(image->user, &part[i], value);
        else boxes |= (uint64_t)1 << i, part[kept++] = part[i];
    return boxes;
}

/* r, the box of this level. */
static void visit(Pruner *p, Batch *b, const PruneImage *image, const PixelRect *r, uint32_t level) {
    PixelRect part[SLT_CHOICE_BOXES];
    uint32_t dim = image->dim, longest = longest_side(image, r), side = least[dim];
    while (side * most[dim] < longest) side *= parts[dim];
    uint64_t boxes = cut_and_fill(p, b, image, r, side, level, part);
    if (!boxes) return;
    if (side < picked[dim] || level + 1 == PRUNE_LEVELS) {
        image->sample(image->user, part, (uint32_t)__builtin_popcountll(boxes), &p->level[level].pruned);
        return;
    }
    prune_walk(p, level, boxes);
    for (uint32_t i = 0; boxes; i++, boxes &= boxes - 1) {
        prune_pick(p, level, (uint32_t)__builtin_ctzll(boxes));
        visit(p, b, image, &part[i], level + 1);
    }
}

void prune_image(Pruner *p, Batch *b, const PruneImage *image, const PixelRect *r) { visit(p, b, image, r, 0); }
