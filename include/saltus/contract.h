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

#endif
