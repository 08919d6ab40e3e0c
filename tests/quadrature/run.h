/* What cells give of a scene: its integral, derivatives in all parameters, and the measure of what is left. */
#ifndef SALTUS_TESTS_QUADRATURE_RUN_H
#define SALTUS_TESTS_QUADRATURE_RUN_H

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "runtime/quadrature/cells.h"
#include "tests/quadrature/scene.h"

enum { RUN_PARAMS = 8 };
typedef struct Run {
    Scene *s;
    double value[CELL_RULES], slope[CELL_RULES][RUN_PARAMS];
    double *many;    /* [np]: derivatives of scenes of many parameters, 3 an event; else NULL */
    double jumps[8]; /* length of the curves of the first events, where f jumps */
    double left;     /* of the domain, as handed over */
    CellCounts counts;
    double seconds;
} Run;

static inline void run_curve(void *user, Crossing *c, uint32_t n) {
    Run *r = user;
    Scene *s = r->s;
    for (uint32_t i = 0; i < n; i++) {
        Num x[3] = {num(c[i].x[0]), num(c[i].x[1]), num(c[i].x[2])};
        uint32_t sites = s->nevents - s->nseams, e = (uint32_t)c[i].event.k[0] % sites;
        double w = c[i].weight * c[i].jump[0], slope = 0;
        for (int d = 0; d < 3; d++) slope += c[i].dg[d] * c[i].dg[d];
        if (e < 8 && c[i].cls == CELL_FINE && c[i].jump[0] != 0) r->jumps[e] += c[i].weight * sqrt(slope);
        if (r->many) {
            for (uint32_t p = 3 * e; p < 3 * e + 3 && c[i].cls == CELL_FINE; p++)
                s->moved = p, r->many[p] += w * s->g(s, e, x).d[3].lo;
            continue;
        }
        for (uint32_t p = 0; p < s->np; p++) s->moved = p, r->slope[c[i].cls][p] += w * s->g(s, e, x).d[3].lo;
    }
    s->moved = s->np;
}
static inline void run_volume(void *user, const CellPoint *p, uint32_t n, CellRule rule, const Box *within) {
    Run *r = user;
    for (uint32_t i = 0; i < n; i++) {
        Look l = {.scene = r->s};
        double f[SLT_MAX_CHANNELS];
        for (int d = 0; d < 3; d++) {
            l.x[d] = p[i].x[d], l.at[d] = num(p[i].x[d]);
            if ((uint32_t)d < r->s->slt.dim && !(p[i].x[d] >= within->lo[d] && p[i].x[d] <= within->end[d]))
                r->left = NAN;
        }
        r->s->f(&l, f);
        r->value[rule] += p[i].weight * f[0];
    }
}
static inline void run_left(void *user, const Box *cell, const double *bounds, double apart) {
    Run *r = user;
    double m = 1;
    (void)bounds, (void)apart;
    for (uint32_t d = 0; d < r->s->slt.dim; d++) m *= cell->end[d] - cell->lo[d];
    r->left += m;
}
static inline void run_constant(void *user, const Box *cell, const double *f) {
    Run *r = user;
    double m = f[0];
    for (uint32_t d = 0; d < r->s->slt.dim; d++) m *= cell->end[d] - cell->lo[d];
    for (int i = 0; i < CELL_RULES; i++) r->value[i] += m;
}

static inline CellOptions run_options(uint32_t gauss) {
    return (CellOptions){.curves = true,
                         .volume = true,
                         .gauss = gauss,
                         .coarse = gauss > 2 ? gauss - 2 : 1,
                         .fixed = true,
                         .tolerance = 1e-10,
                         .least = 0x1p-14};
}
static inline Run run_scene(Scene *s, const CellOptions *o, double *many) {
    Run r = {.s = s, .many = many};
    Batch b;
    CellSink sink = {.curve = run_curve, .volume = run_volume, .constant = run_constant, .left = run_left, .user = &r};
    Box tile = {.lo = {0}};
    for (int d = 0; d < 3; d++) tile.lo[d] = s->slt.lo[d], tile.hi[d] = tile.end[d] = s->slt.hi[d];
    struct timespec t[2];
    if (!batch_init(&b, &s->slt, NULL)) exit(1);
    Cells *c = cells_new(&b, s->slt.lo, s->slt.hi);
    clock_gettime(CLOCK_MONOTONIC, &t[0]);
    if (!cells_run(c, &tile, o, &sink, &r.counts)) exit(1);
    clock_gettime(CLOCK_MONOTONIC, &t[1]);
    r.seconds = (double)(t[1].tv_sec - t[0].tv_sec) + 1e-9 * (double)(t[1].tv_nsec - t[0].tv_nsec);
    cells_free(c), batch_free(&b);
    if (getenv("CELLS_SHOW"))
        printf("  cells %llu boxes %llu points %llu  settled %.4g curved %.4g left %.2g  %.4f s\n",
               (unsigned long long)r.counts.cells, (unsigned long long)r.counts.boxes,
               (unsigned long long)r.counts.points, r.counts.settled, r.counts.curved, r.counts.left, r.seconds);
    static const struct {
        const char *name;
        int kind;
    } kinds[] = {
        {"bounds", SLT_K_BOUNDS}, {"edge_bounds", SLT_K_EDGE_BOUNDS}, {"edge", SLT_K_EDGE}, {"sides", SLT_K_SIDES}};
    if (getenv("CELLS_SHOW"))
        for (int i = 0; i < 4; i++)
            printf("  %s %llu calls of %.1f%s", kinds[i].name, (unsigned long long)s->calls[kinds[i].kind],
                   (double)s->lanes[kinds[i].kind] / (double)(s->calls[kinds[i].kind] + 1e-9), i < 3 ? "," : "\n");
    return r;
}

#endif
