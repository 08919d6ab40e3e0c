/* Passes over the IR: optimisations (opt_*), required lowerings (lower_*), variants (variant_*) and automatic
 * differentiation (ad_*).
 *
 * A pass is a row of passes.def: it edits its Fn in place and says whether it changed anything. A variant makes a new
 * Fn from a primal, which it leaves alone. pipeline.c is the order of everything; pass.c runs each row, and dumps,
 * verifies and stops behind it. */
#ifndef SALTUS_PASS_PASS_H
#define SALTUS_PASS_PASS_H

#include "compiler/front/front.h"
#include "compiler/ir/ir.h"
#include "saltus/kernel.h"

typedef enum PassId {
    PASS_NONE,
#define PASS(name, ...) PASS_##name,
#define STEP(name, ...) PASS_##name,
#include "compiler/pass/passes.def"
#undef PASS
#undef STEP
    PASS_ALL
} PassId;

/* Behind which pass, of which kernel. */
typedef struct PassPoint {
    PassId pass;        /* PASS_NONE: nowhere */
    const char *kernel; /* one of kernel_names, or "primal"; NULL: any */
} PassPoint;

typedef struct PassCtx {
    Session *session;
    const Program *program; /* whose Fns these are: names for warnings; NULL: no warnings */
    PassPoint dump;         /* print the IR to standard error */
    PassPoint verify;       /* check the IR, and that the pass did what its row says */
    PassPoint stop_after;   /* print the IR to standard output, then unwind (session_stop) */
    bool has_fma;           /* the target contracts */
} PassCtx;

/* ---- passes.def: every pass */
#define PASS(name, ...) bool name(PassCtx *ctx, Fn *fn);
#define STEP(name, ...)
#include "compiler/pass/passes.def"
#undef PASS
#undef STEP

/* ---- pass.c: the registry and the driver */
typedef enum PassStage { PASS_NEEDS_ANY, PASS_NEEDS_PRIMAL, PASS_NEEDS_KERNEL } PassStage;
enum { PASS_KEEPS_FLOATS = 1, PASS_KEEPS_SITES = 2, PASS_SETTLES = 4 };
typedef struct PassInfo {
    const char *name, *what;
    bool (*run)(PassCtx *, Fn *); /* NULL: a step */
    PassStage needs;
    uint8_t ends, keeps; /* the columns of passes.def */
} PassInfo;
extern const PassInfo pass_info[PASS_ALL]; /* [PASS_NONE] is empty */
/* Runs a pass on the primal or on a kernel (stage). */
bool pass_run(PassCtx *ctx, PassStage stage, Fn *fn, PassId pass);
/* Dumps, verifies and stops at a step. */
void pass_step(PassCtx *ctx, PassStage stage, Fn *fn, PassId step);
/* "opt_fold", "all", "vjp:opt_fold", "primal:all". NULL, or what is wrong with the text, with the nearest name. */
const char *pass_point(Arena *a, const char *text, PassPoint *out);

/* ---- variant_*.c: primal -> new Fn in the same arena */
typedef struct VariantOptions {
    bool near_miss;    /* region: also the nearest event (near-miss probe) */
    bool paper_argmin; /* event: the paper's argmin |g| instead of the first differing decision */
    bool paper_forced; /* sides: the paper's forced branch */
    bool path_hash;    /* region: decisions of the path instead of the provenance of the output */
} VariantOptions;
/* Outputs are named by their roles; in brackets, where the program has such. */
Fn *variant_value(PassCtx *ctx, const Fn *primal);                           /* F */
Fn *variant_region(PassCtx *ctx, const Fn *primal, const VariantOptions *o); /* HASH [DEPTH] [WITNESS] [NEAR_*] */
Fn *variant_event(PassCtx *ctx, const Fn *primal, const VariantOptions *o);  /* SITE G K [BOUNDARY] [WINDOW] */
Fn *variant_sides(PassCtx *ctx, const Fn *primal, const VariantOptions *o);  /* F, and HASH .. WITNESS of region */
Fn *variant_site(PassCtx *ctx, const Fn *primal);                            /* G */

/* ---- ad_*.c. wrt[i] != 0: float parameter i is differentiated (NULL: all). */
enum {
    AD_REPLAY_AUTO,
    AD_REPLAY_NEVER,
    AD_REPLAY_ALWAYS,
    AD_REPLAY_KEEP
}; /* ALWAYS: every loop that can be; KEEP: and inner loops are treated as if they searched */
typedef struct AdOptions {
    const uint8_t *wrt;
    bool wrt_x; /* also (or only, with wrt_none) with respect to the position */
    bool wrt_none;
    uint32_t tape_budget; /* bytes per lane above which loops are checkpointed, in as many levels as it takes; 0: 64
                             KiB, loops with queries 4 KiB */
    uint8_t replay;       /* AD_REPLAY_*: iterations run again in the sweep, from their carried values and witnesses */
} AdOptions;
/* Forward: outputs the primal's outputs that are float, then their tangents. Tangents come from dparam and IN_DX*. */
Fn *ad_jvp(PassCtx *ctx, const Fn *fn, const AdOptions *o);
/* Reverse: seeds IN_SEED0.. for the float outputs; adds to parameter adjoints (adj); outputs the float outputs [then,
 * with wrt_x, the adjoints of x]. */
typedef struct TapeReport {
    uint32_t frame_values;
    uint64_t bytes_per_lane; /* worst case */
    const char *text;        /* what is stored, what recomputed, and why: for explain */
} TapeReport;
Fn *ad_vjp(PassCtx *ctx, const Fn *fn, const AdOptions *o, TapeReport *report);
/* Gradient of the single float output in x by dim forward sweeps in one kernel: outputs g, dg/dx0.. */
Fn *ad_grad_x(PassCtx *ctx, const Fn *fn);
/* Parameters (float indices) that can influence the outputs differentiably; bit per float. */
void ad_activity(const Fn *fn, uint8_t *active);

/* ---- pipeline.c */
/* Passes that may change floats or shape, once, on the primal, before variants are cut. */
void pipeline_primal(PassCtx *ctx, Fn *primal);
/* Cleans and lowers one kernel: slice, fold, cse, lower_custom, lower_rand, lower_math, fold, cse, dce. */
void pipeline_kernel(PassCtx *ctx, Fn *fn);

/* Kinds of kernels of which a program has one: all but CULL, of which it has one a loop. */
enum {
#define SLT_KERNEL(id, ...) K_##id = SLT_K_##id,
#include "saltus/kernel.def"
    K_KINDS = K_CULL
};
extern const char *const kernel_names[SLT_KERNELS];

typedef struct KernelSet {
    Fn *fn[K_KINDS]; /* NULL: not needed */
    TapeReport tape[K_KINDS];
    SltLayout layout[K_KINDS];
} KernelSet;
/* What a finished kernel reads and where its outputs are. */
SltLayout pipeline_layout(const Fn *fn);
/* The whole middle: needs[kind] says which kernels are wanted; those that the program has no use for stay NULL (no
 * site: no boundary kernel). */
void pipeline_kernels(PassCtx *ctx, Program *p, const bool needs[K_KINDS], const VariantOptions *vo,
                      const AdOptions *ad, KernelSet *out);

#endif
