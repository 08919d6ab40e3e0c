/* What warn_probe.c and warn_watch.c share: the program is run on 64 points at once, and of some of its instructions it
 * is noted what they decided. */
#ifndef SALTUS_PASS_WARN_WATCH_H
#define SALTUS_PASS_WARN_WATCH_H

#include "compiler/pass/warn.h"

enum { WARN_LANES = 64 };
/* A place: a point of the domain, and a whole number that random numbers are made from. */
enum { PLACE = 4, PLACE_RANDOM = 3 };

typedef enum WatchKind {
    WATCH_VALUE,    /* what it is */
    WATCH_SIGN,     /* of its argument: the cut of atan2 */
    WATCH_ROUNDING, /* an integer, by its argument */
    WATCH_ORDER     /* of a and b: a comparison, a minimum */
} WatchKind;

typedef struct Watched {
    const Inst *at, *a, *b; /* b may be NULL */
    WatchKind kind;
} Watched;

typedef struct Probe {
    const Program *program;
    Fn fn; /* the primal, in double precision */
    Interp *interp;
    Watched *watched;
    uint32_t nlist, n; /* the first of them are the jumps in question; the others, guides, show where to look */
    uint32_t *which;   /* by id: index + 1 */
    /* [n][WARN_LANES], of the last run: a hash of all that it decided; sums of a rounding and of its argument over all
     * that were made; the least |a - b|. */
    uint32_t *seen;
    double *value, *argument, *near;
    double *params; /* [nfloats] */
    double x[3][WARN_LANES], first[WARN_LANES], f[SLT_MAX_CHANNELS][WARN_LANES];
    int32_t stream[WARN_LANES];
    uint64_t fuel;
    bool failed;
} Probe;

/* The list and the guides. The Fn is numbered; dep by id. */
void watch_init(Probe *p, PassCtx *ctx, const Fn *fn, const Depend *dep, const Untracked **list, uint32_t n);
void watch_place(Probe *p, uint32_t lane, const double x[PLACE]);
bool watch_run(Probe *p);

static inline uint32_t watch_at(uint32_t k, uint32_t lane) { return k * WARN_LANES + lane; }

#endif
