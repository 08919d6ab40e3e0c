/* Whose jump it is where several boundaries coincide: untie.c. An Untie belongs to the worker whose batch it uses. */
#ifndef SALTUS_SAMPLE_UNTIE_H
#define SALTUS_SAMPLE_UNTIE_H

#include "runtime/sample/difference.h"
#include "runtime/sample/finder.h"

enum {
    UNTIE_WAYS = 4,   /* moves of the parameters: two directions, forth and back */
    UNTIE_MOST = 64,  /* crossings at once */
    UNTIE_EVENTS = 6, /* of a tie, of which each has a part of the jump */
    UNTIE_AWAY = 2 * UNTIE_WAYS
};

/* Scenes with moved parameters. */
typedef struct Apart {
    Moved move[UNTIE_WAYS];
    double step;   /* by how much a parameter of size 1 was moved */
    uint32_t seed; /* of the directions */
} Apart;
/* Moves that are shorter, each FINER_EACH times; NULL: not made so far. */
enum { FINER_RUNGS = 2, FINER_EACH = 8 };
typedef struct Finer {
    Apart *apart[FINER_RUNGS];
} Finer;
void finer_free(Finer *f);
/* A parameter p is moved by about step * max(0.1, |p|). *out stays NULL where there is nothing to move, or so much that
 * it would cost more than it tells. False when memory runs out. */
bool apart_new(const SltScene *s, uint32_t seed, double step, Apart **out);
void apart_free(Apart *a);
/* Kernels of the batch see the parameters of this scene. */
void untie_use(Batch *b, const SltScene *s);

/* The part of an event whose boundary is there only after a move. Where the parameters are, its g is 0 / 0, say: its
 * slopes are those at two places beside the root that it has after this move, which count so much. */
typedef struct Away {
    Event event;
    uint32_t move;
    double x[2][3], g[2], dg[2][3], part[2];
    double jump[SLT_MAX_CHANNELS], half[SLT_MAX_CHANNELS]; /* as below, and of this move's share */
} Away;

/* What a crossing's jump consists of; n = naway = 0: it is all its own event's, as far as one can tell. */
typedef struct Tie {
    uint32_t n, naway;
    Event event[UNTIE_EVENTS];
    double jump[UNTIE_EVENTS][SLT_MAX_CHANNELS]; /* towards growing g of the crossing: the mean of the orders */
    double half[UNTIE_EVENTS][SLT_MAX_CHANNELS]; /* kink: half of how much forth and back differ; doubted: two
                                                    of the moves */
    Away away[UNTIE_AWAY];
    bool whole;         /* one event has all of it, whatever the order: the jump is that of the crossing */
    bool kink;          /* it depends on the order: the integral has no derivative */
    uint8_t between[2]; /* the two moves that differ by 2 half */
    bool doubted;       /* it does after some moves alone: rounding may make that */
    bool bent;          /* cells_kinks.c: its own g has the kink, */
    bool hidden;        /* or it may be a band that rounding hides */
    bool untold;        /* n = naway = 0, and it may be another's all the same */
} Tie;

typedef struct Untie Untie;
/* NULL when memory runs out. */
Untie *untie_new(Batch *b);
void untie_free(Untie *u);
/* The ties of crossings which[0 .. n) of c, n <= UNTIE_MOST, which have event, place, g and its gradient, jump and
 * hashes; of each, `rising` says whether its jump is towards growing g. room[i]: farther than this other boundaries
 * may be near, which look like a kink; NULL: anything goes. False when memory runs out. */
bool untie(Untie *u, const Apart *apart, const Crossing *c, const uint32_t *which, uint32_t n, const double *room,
           Tie *tie);
/* alone[i]: the regions on both sides of c[which[i]], n <= UNTIE_MOST, are after each move still what they were, where
 * its own boundary has gone. Untying it would say so, and nothing else. */
void untie_alone(Untie *u, const Apart *apart, const Crossing *c, const uint32_t *which, uint32_t n, bool *alone);

#endif
