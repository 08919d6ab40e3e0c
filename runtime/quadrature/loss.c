/* A squared loss and its gradient in one sweep. Under the box filter a pixel is what the cells inside it give, so that
 * a tile's pixels, and with them the adjoint of the loss, are known when its cells are done: their points are kept so
 * long, and evaluated once more for the derivatives. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/quadrature/inner.h"
#include "runtime/sample/near.h"

/* The pixels of a tile, by axis: from .. to - 1. */
static void pixels_of(const Sweep *p, uint64_t tile, uint32_t from[3], uint32_t to[3]) {
    const Grid *g = &p->run->grid;
    for (uint32_t d = 0; d < 3; d++) {
        from[d] = 0, to[d] = 1;
        if (d >= g->dim) continue;
        from[d] = (uint32_t)(tile % p->tiles[d]) * p->pixels[d];
        to[d] = from[d] + p->pixels[d] < g->n[d] ? from[d] + p->pixels[d] : g->n[d];
        tile /= p->tiles[d];
    }
}

/* Pixels of the tile, their loss, and the adjoint image there. */
static void weigh(SweepWorker *v, const uint32_t from[3], const uint32_t to[3]) {
    const Sweep *p = v->sweep;
    const Grid *g = &p->run->grid;
    const Splat *sp = &v->splat;
    uint32_t channels = p->run->s->channels;
    double each = 1 / ((double)g->pixels * channels);
    for (uint32_t z = from[2]; z < to[2]; z++)
        for (uint32_t y = from[1]; y < to[1]; y++)
            for (uint32_t x = from[0]; x < to[0]; x++) {
                uint64_t at = grid_index(g, x, y, z) * channels;
                uint64_t own = ((uint64_t)(z - sp->lo[2]) * sp->n[1] + (y - sp->lo[1])) * sp->n[0] + (x - sp->lo[0]);
                for (uint32_t c = 0; c < channels; c++) {
                    double m = p->mask ? (double)p->mask[at + c] : 1, value = sp->value[own * channels + c];
                    double off = value - (double)p->target[at + c];
                    v->loss += m * off * off * each;
                    p->weighed[at + c] = (float)(2 * m * off * each);
                    if (p->image) p->image[at + c] = (float)value;
                }
            }
}

bool loss_tile(SweepWorker *v, uint64_t tile) {
    Sweep *p = v->sweep;
    Kept *k = &v->kept;
    Batch *b = &v->w->batch;
    const SltCullList *given = b->args.cull;
    for (uint64_t i = 0; i < v->nleft; i++) {
        v->left_bound += sweep_hidden(p, &v->left[i]);
        left_samples(v, &v->left[i], p->lines, -1);
    }
    uint32_t from[3], to[3];
    pixels_of(p, tile, from, to);
    weigh(v, from, to);
    /* A point on the far face lies in a pixel of another tile, whose adjoint is not known yet. */
    for (uint64_t i = 0; i < k->ncrossing; i++) grid_into(&p->run->grid, from, to, k->crossing[i].x);
    for (uint64_t i = 0; i < k->npoint; i++) grid_into(&p->run->grid, from, to, k->point[i].x);
    b->again = true;
    for (uint64_t i = 0; i < k->ngroup; i++) {
        const KeptGroup *g = &k->group[i];
        b->args.cull = g->lists ? kept_lists(k, g) : given;
        if (g->curve) sink_put_weighed(&v->w->sink, k->crossing + g->first, g->n);
        else if (p->interior) sweep_volume_reverse(v, k->point + g->first, g->n, CELL_FINE);
    }
    b->args.cull = given, b->again = false;
    for (uint64_t i = 0; i < v->nleft && p->options.curves; i++) {
        LeftCell cell = v->left[i];
        grid_into(&p->run->grid, from, to, cell.box.lo), grid_into(&p->run->grid, from, to, cell.box.end);
        if (!left_lines(v, &cell, p->lines, -1)) return false;
    }
    near_flush(v->w);
    finder_run(&v->w->finder, true);
    return !v->w->finder.failed;
}

SltStatus quadrature_loss(const SltScene *s, const SltJob *j, const float *target, const float *mask, double *loss,
                          double *gradient, float *image, SltStats *stats, SltError *err) {
    Run r;
    SltStatus st = run_begin(&r, s, j, err);
    Sweep p = {.run = &r, .kind = SWEEP_LOSS, .target = target, .mask = mask, .image = image, .options.volume = true};
    p.options.curves = !j->no_boundary && quadrature_has_boundary(s, SLT_K_SITE_VJP);
    p.options.seams = quadrature_compares_seams(s, j);
    p.interior = !j->no_interior && s->kernel[SLT_K_VJP];
    p.weighed = st == SLT_OK ? malloc(r.grid.pixels * s->channels * sizeof *p.weighed) : NULL;
    p.adjoint = p.weighed;
    if (st == SLT_OK && !p.weighed) st = status_fail(err, SLT_LIMIT, "out of memory");
    if (st == SLT_OK) st = sweep_begin(&p);
    if (st == SLT_OK) {
        quadrature_image_options(&p);
        st = sweep_run(&p);
        r.stats.seconds_boundary = pool_now() - r.start;
    }
    for (uint32_t i = 0; i < s->nfloats && st == SLT_OK; i++)
        gradient[i] = !s->active || s->active[i] ? p.sums.boundary[i] + p.sums.interior[i] : 0;
    if (st == SLT_OK && loss) *loss = p.loss;
    st = quadrature_image_end(&r, &p, st, p.counts.spent ? SLT_STOP_EVALUATIONS : SLT_STOP_NONE, stats);
    free(p.weighed);
    return st;
}
