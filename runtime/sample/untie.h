/* Whose jump it is where several boundaries coincide: untie.c. An Untie belongs to the worker whose batch it uses. */
#ifndef SALTUS_SAMPLE_UNTIE_H
#define SALTUS_SAMPLE_UNTIE_H

#include "runtime/sample/difference.h"
#include "runtime/sample/finder.h"

enum {
    UNTIE_WAYS = 4,  /* moves of the parameters: two directions, forth and back */
    UNTIE_MOST = 64, /* crossings at once */
    UNTIE_EVENTS = 6 /* of a tie, of which each has a part of the jump */
};

/* Scenes with moved parameters. */
typedef struct Apart {
    Moved move[UNTIE_WAYS];
    double step; /* by how much a parameter of size 1 was moved */
} Apart;
/* A parameter p is moved by about step * max(0.1, |p|). *out stays NULL where there is nothing to move, or so much that
 * it would cost more than it tells. False when memory runs out. */
bool apart_new(const SltScene *s, uint32_t seed, double step, Apart **out);
void apart_free(Apart *a);
/* Kernels of the batch see the parameters of this scene. */
void untie_use(Batch *b, const SltScene *s);

/* What a crossing's jump consists of; n = 0: it is all its own event's, as far as one can tell. */
typedef struct Tie {
    uint32_t n;
    Event event[UNTIE_EVENTS];
    double jump[UNTIE_EVENTS][SLT_MAX_CHANNELS]; /* towards growing g of the crossing: the mean of the orders */
    double half[UNTIE_EVENTS][SLT_MAX_CHANNELS]; /* kink: half of how much forth and back differ */
    bool whole;  /* one event has all of it, whatever the order: the jump is that of the crossing */
    bool kink;   /* it depends on the order: the integral has no derivative */
    bool untold; /* n = 0, and it may be another's all the same */
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

#endif
