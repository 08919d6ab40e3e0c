/* Crossings on which another boundary lies: coincide.c says how they are told, untie.c what becomes of them. The run
 * owns the scenes with moved parameters, a sink the crossings in question. */
#ifndef SALTUS_SAMPLE_COINCIDE_H
#define SALTUS_SAMPLE_COINCIDE_H

#include "runtime/sample/untie.h"

/* Crossings whose g bends where the parameters are: kink.c. */
typedef struct Kinks {
    Finer finer;
    Crossing *at[UNTIE_WAYS / 2]; /* [n]: by the pair of moves that shows it, room for BATCH each */
    uint32_t n[UNTIE_WAYS / 2];
} Kinks;
typedef struct Coincide {
    const Apart *apart;    /* scenes with moved parameters; NULL: nothing is looked for */
    const uint8_t *tied;   /* [sites]: not 0 where another site's g is the same, but for other parameters; NULL: of none */
    bool no_kinks;         /* of one g: in small parts of a domain its corners are never far */
    Untie *untie;          /* NULL: not needed so far */
    Crossing *part, *half; /* [nparts], [nhalves]: of crossings that were untied the parts, and their errors */
    uint32_t nparts, nhalves, part_cap, half_cap;
    Kinks kinks;
} Coincide;
typedef struct Run Run;
typedef struct Sink Sink;

/* Before the first crossing: moves the parameters, one of size 1 by `step`. False when memory runs out. */
bool coincide_begin(Run *r, double step);
void coincide_end(Run *r);
/* twins.c. Sets Run.tied, to bits: the other g rises as this one does, or against it. False when memory runs out. */
enum { TWINS_OPPOSED = 1, TWINS_ALIKE };
bool twins_begin(Run *r);
/* The step where roots are known to this part of the domain; at least `least`. */
double coincide_step(double bracket, double least);
void coincide_free(Coincide *q);
/* Crossings whose event is another's get theirs. */
void coincide_name(const Sink *k, Crossing *c, uint32_t n);
/* Silent crossings that no other boundary may lie on leave the list; returns how many stay. */
uint32_t coincide_sift(const Sink *k, Crossing *c, uint32_t n);
/* After all n of a batch have their weights: asks some of those at which other events decide differently too. If
 * something has come apart at one of them, all of these are untied: those that are not their own event's alone are kept
 * no longer, their parts are, as crossings with weights. Counts SLT_DROP_COINCIDENT. keep[i] is of order[i], which goes
 * by site. */
void coincide_settle(Sink *k, const Crossing *c, const uint64_t *order, bool *keep, uint32_t n);
/* Weighs crossings anew; those whose weight is known move to the front. Returns how many. */
uint32_t coincide_weigh(Sink *k, Crossing *c, uint32_t n);
/* Another point of the crossing's boundary, a little further along: *x, with g and its gradient. Not in 1D. */
bool coincide_aside(Sink *k, const Crossing *c, Crossing *x);

/* kink.c. Of the kept crossings those whose g bends are kept no longer, but in Coincide.kinks. Counts
 * SLT_DROP_COINCIDENT. */
void kink_settle(Sink *k, const Crossing *c, const uint64_t *order, bool *keep, uint32_t n);
void kink_free(Kinks *q);
enum { KINK_NONE = UNTIE_WAYS / 2 };
/* pair[i]: the moves, 2 pair[i] and the next, that show a kink at crossing at[i]; KINK_NONE: none do. Their changes of
 * g then do not make up for each other, to this part of them and to least[i]. How many have one. The n <= BATCH
 * crossings go by site. */
/* Is what `pair` of moves shows at a crossing beside the parameters, and not at them? Of max(r, q) the bend is where
 * r = q; if these are apart by less than moves go it looks the same, but after shorter moves it is gone. False where
 * shorter moves are no more than `noise`, what rounding may make of g. *memory: false when it runs out. */
bool kink_is_beside(Batch *b, const Apart *apart, Finer *finer, const Crossing *c, uint32_t pair, double noise,
                    bool *memory);
uint32_t kink_find(Batch *b, const Apart *apart, const Crossing *const *at, const double *least, double bent,
                   uint32_t n, uint32_t *pair);

#endif
