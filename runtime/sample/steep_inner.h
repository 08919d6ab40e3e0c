/* What steep.c and steep_weigh.c share. */
#ifndef SALTUS_SAMPLE_STEEP_INNER_H
#define SALTUS_SAMPLE_STEEP_INNER_H

#include "runtime/sample/difference.h"
#include "runtime/sample/run.h"
#include "runtime/sample/steep.h"

enum { STEEP_STEPS = 64 }; /* changes that are kept, at most */
enum { STEEP_RAND = 3 };   /* the axis of the first random number */

/* A change of f between two points of a line. */
typedef struct SteepStep {
    double x[4], a, b, fa, fb;           /* x[axis] is a's, x[STEEP_RAND] the random number; of its channel */
    double first, excess;                /* |change| between the points of the line; by how much it exceeds the next */
    uint32_t axis, point, channel, hash; /* it lay between this point of its line and the next */
    int32_t stream;                      /* the line */
    uint32_t number;                     /* which random number x[STEEP_RAND] is */
    bool asked, done;                    /* done: halved further it comes apart */
    bool jump;                           /* down to neighbouring floats */
    bool seen;                           /* and integrated: nothing is lost */
} SteepStep;

/* A peak between the lines. */
typedef struct SteepPeak {
    double x[3], f;      /* f is so large, or small, there, in its channel, */
    double over;         /* which is more than anything seen by so much */
    double lo[3], hi[3]; /* around where it is nearly that */
    uint32_t channel;
} SteepPeak;

typedef struct SteepProbe {
    const SltScene *s; /* &quiet: nothing is printed */
    SltScene quiet;
    Batch batch;
    uint32_t points, lines; /* of a line; of an axis */
    SteepStep *step;
    uint32_t n, room, found;          /* found: before only some were kept */
    uint32_t number;                  /* the random number that is varied */
    double largest;                   /* |f| on the lines */
    double seen[SLT_MAX_CHANNELS][2]; /* least and greatest f on them */
} SteepProbe;

double steep_round(const SteepProbe *p, double x);
/* Point i of line `line` of an axis. */
void steep_place(const SteepProbe *p, uint32_t axis, uint32_t line, uint32_t i, double x[3]);
/* Sample i lies at `at` on the line of t. */
void steep_put(SteepProbe *p, uint32_t i, const SteepStep *t, double at);
void steep_evaluate(SteepProbe *p, uint32_t n);
double steep_f(const SteepProbe *p, uint32_t channel, uint32_t i);
/* By how much a parameter is moved to see what moves. */
double steep_move_of(const SltScene *s, uint32_t q);
/* hit[i] becomes true where the change p->step[from + i] is elsewhere with other parameters. */
void steep_moved(SteepProbe *p, const SltScene *moved, uint32_t from, uint32_t n, bool *hit);
/* ---- steep_peak.c: false where there is none, or it is too wide to hide. */
bool steep_find_peak(SteepProbe *p, SteepPeak *peak);
/* ---- steep_weigh.c: a peak that the estimate has not seen joins its errors; *seen: it has. False when memory runs
 * out. */
bool steep_weigh_peak(SteepProbe *p, const SteepPeak *peak, SltIntegral *out, bool *seen);
/* ---- steep_weigh.c: which changes the estimate has seen; and what the others weigh joins its errors. False when
 * memory runs out. */
bool steep_weigh(SteepProbe *p, Run *r, SltIntegral *out);

#endif
