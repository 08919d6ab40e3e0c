/* The rows of kernel.def as enums: what compiler, runtime and compiled kernels agree on by number. */
#ifndef SALTUS_CONTRACT_H
#define SALTUS_CONTRACT_H

typedef enum SltKernelKind {
#define SLT_KERNEL(id, ...) SLT_K_##id,
#include "saltus/kernel.def"
    SLT_KERNELS
} SltKernelKind;

/* Numbers that vary from sample to sample, in SltKernelArgs.in by their enumerator; behind them those that are the same
 * for all samples, which lie in members of SltKernelArgs. */
typedef enum SltInput {
#define SLT_INPUT(id, ...) SLT_IN_##id,
#include "saltus/kernel.def"
    SLT_IN_VARYING, /* how many lie in SltKernelArgs.in */
    SLT_IN_LAST_VARYING = SLT_IN_VARYING - 1,
#define SLT_UNIFORM(id, ...) SLT_IN_##id,
#include "saltus/kernel.def"
    SLT_INPUTS
} SltInput;

/* What an output of a kernel is: SltLayout.out says where each role lies. */
typedef enum SltRole {
#define SLT_ROLE(id, ...) SLT_OUT_##id,
#include "saltus/kernel.def"
    SLT_ROLES
} SltRole;

typedef enum SltCounter {
#define SLT_COUNTER(id, ...) SLT_COUNT_##id,
#include "saltus/kernel.def"
    SLT_COUNTERS
} SltCounter;

typedef enum SltSiteKind {
#define SLT_SITE(id, ...) SLT_SITE_##id,
#include "saltus/kernel.def"
    SLT_SITE_KINDS
} SltSiteKind;

enum {
#define SLT_LIMIT(id, value, ...) SLT_##id = value,
#include "saltus/kernel.def"
};

/* What keeps a box from being settled besides its open events (SLT_OUT_BOX_STATE). */
enum {
    SLT_BOX_UNKNOWN = 1, /* a decision that is no event may go either way, or f or what decides has no bound */
    SLT_BOX_ROUGH = 2    /* f, or a g, may be not smooth inside, at no seam: a root of 0, a pole */
};
/* Of g of one event on a box (SLT_OUT_G_STATE). */
enum {
    SLT_EDGE_JUMPS = 1, /* g may jump on the box: its gradient proves nothing, and a change of sign is no root */
    SLT_EDGE_BENDS = 2  /* g is continuous, but its gradient may jump */
};

#endif
