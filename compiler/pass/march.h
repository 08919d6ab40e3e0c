/* A loop that opt_marches.c knows: what it asks, and what of what it carries is the place. */
#ifndef SALTUS_PASS_MARCH_H
#define SALTUS_PASS_MARCH_H

#include "compiler/pass/walk.h"

enum { MOST_CARRIED = 64, MOST_CHAIN = 32, MOST_ASKED = 4 };

typedef struct Asked {
    Inst *site;          /* of `h < eps`, or of `eps < h` */
    Inst *h, *magnitude; /* magnitude: abs(h), or h */
    Inst *eps;
} Asked;

typedef struct March {
    Fn *fn;
    Inst *loop;
    Block *body;
    uint32_t ncarried, depth; /* depth: loops around it */
    Asked asked[MOST_ASKED];
    uint32_t nasked;
    bool goes[MOST_CARRIED];             /* carried i is the place: next = this + way * h */
    Inst *way[MOST_CARRIED][MOST_CHAIN]; /* factors of it, from outside of the loop */
    uint32_t nway[MOST_CARRIED];
    bool sees;   /* what is behind it, where it ended */
    bool counts; /* what is behind it, how many steps it took */
} March;

/* opt_marches_rewrite.c: puts what the march means in the place of what it does. */
void march_rewrite(March *m, Arena *scratch);

#endif
