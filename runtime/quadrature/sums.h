/* Sums over tiles of what two rules give, and how far they are apart.
 *
 * A tile's adjoints lie in groups of `rows` accumulators (SumGroup). Tiles are added in order, in double; the
 * distance of the two rules is taken tile by tile and its absolute values are added, so that errors of different tiles
 * do not cancel in the stated one. */
#ifndef SALTUS_QUADRATURE_SUMS_H
#define SALTUS_QUADRATURE_SUMS_H

#include <math.h>

#include "runtime/sample/accum.h"

/* Groups of accumulators: buffer group * rows + row. In cells the two rules; in what is left two sets of lines. */
typedef enum SumGroup {
    SUM_BOUNDARY_FINE,
    SUM_BOUNDARY_COARSE,
    SUM_INTERIOR_FINE,
    SUM_INTERIOR_COARSE,
    SUM_SIZE,          /* of the boundary that lines have found, jumps of both signs alike */
    SUM_INTERIOR_BOTH, /* what is the same in both rules; behind SUM_SIZE, which sink_put_size knows by number */
    SUM_GROUPS
} SumGroup;
/* How the groups of a tile are to be read. */
typedef enum SumMode {
    SUM_ONE,    /* the fine groups alone */
    SUM_RULES,  /* fine, and its distance from coarse is the error */
    SUM_SETS,   /* two independent estimates: their mean, and half their distance */
    SUM_CURVES, /* two rules of the boundary, two estimates of the rest */
    SUM_LINE    /* the same, but on one line: the boundary's fine group is exact */
} SumMode;

typedef struct Sums {
    uint32_t rows, nfloats;      /* rows: channels of an integral, 1 of an image's gradient */
    double *boundary, *interior; /* [rows][nfloats] */
    double *error;               /* [rows][nfloats]: of the rules, and of rounding */
    double *variance;            /* [rows][nfloats]: of independent sets */
    double *fourth;              /* [rows][nfloats]: of solids, the sum of its terms' squares; NULL else */
    double *size;                /* [rows][nfloats]: of the tiles' parts, whatever their signs */
    bool begun;                  /* sums_clear was called */
    double rounding;             /* of a sum, in parts of it */
    double curves;               /* what rounding may make of a boundary term, in parts of it */
    double roots; /* and what roots that end at less than the last floats make of it: CellOptions.slack */
} Sums;
/* False when memory runs out. */
bool sums_init(Sums *m, const SltScene *s, uint32_t rows);
void sums_free(Sums *m);
void sums_clear(Sums *m);
/* In `merge`: adds what a tile has gathered, which was folded. lines: SUM_SETS, how many independent ones there are; an
 * estimate is not better than the share of one in the size of the boundary. SUM_RULES: by how much more than a few
 * hundred terms round. */
void sums_merge(Sums *m, Accum *a, SumMode mode, double lines);
/* More may move than was named: a component that lines have hardly met may be as wrong as components are on average,
 * or, if none was met, as the share `left` of the largest, or if all are 0, of `unit`. active: which count; NULL: all.
 */
void sums_unnamed(Sums *m, const uint8_t *active, double left, double unit);
/* f jumps along curves that nothing integrates: jump[channel] is the integral of |jump| along them. How fast these move
 * is not known; what is added is right for curves that move by 1 when a parameter changes by 1. */
void sums_upset(Sums *m, const uint8_t *active, const double jump[SLT_MAX_CHANNELS]);
/* The same of what lines have met and could not integrate. Where nothing at all was integrated, infinite, as of lines:
 * nothing tells what moves. */
void sums_gone(Sums *m, const uint8_t *active, const double jump[SLT_MAX_CHANNELS]);
/* Between a seam and the nearest places f changes as a small power of the distance: rims[channel] is the integral of
 * that along seams. Derivatives by what moves one are then off by as much, and rules, which converge slowly there,
 * by a part of it; those on which rules agree are not. Returns the largest, in parts of the largest derivative. */
double sums_rims(Sums *m, const uint8_t *active, const double rims[SLT_MAX_CHANNELS]);
/* Of a solid's cells that are left few are looked at, and of a face perhaps two: an error that a few terms tell is
 * itself uncertain, and grows as Student's t does beside the normal deviate. Called once, when all is merged. */
void sums_few(Sums *m);
/* In that share of the domain the volume is only sampled: which parameters it belongs to is not known. Adds to each
 * error what a part like it, on average, has of all of them together. */
void sums_sampled(Sums *m, const uint8_t *active, double share);
#define SUM_SURE 2.0 /* standard errors of lines that are stated: independent cells make them nearly normal */
/* The stated error of a component, row * nfloats + parameter. */
static inline double sums_error(const Sums *m, size_t at) {
    double variance = m->variance[at];
    return variance == 0 ? m->error[at] : m->error[at] + SUM_SURE * sqrt(variance);
}

#endif
