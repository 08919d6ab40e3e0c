/* Passes over the IR: optimisations (opt_*), required lowerings (lower_*), variants (variant_*) and automatic
 * differentiation (ad_*).
 *
 * A pass edits its Fn in place and says whether it changed anything; a variant makes a new Fn from a primal, which it
 * leaves alone. pipeline.c is the order of everything, in one function. Dumps: ctx->dump names a pass (or "all") whose
 * result is printed to stderr. */
#ifndef SALTUS_PASS_PASS_H
#define SALTUS_PASS_PASS_H

#include "compiler/front/front.h"
#include "compiler/ir/ir.h"

typedef struct PassCtx {
    Session *session;
    const char *dump; /* -d NAME */
    bool verify_each; /* verify after every pass */
    bool has_fma;     /* the target contracts */
} PassCtx;

/* ---- opt_*.c: none of them may change the value of a float that decides, except contract, which runs once, before
 * variants are cut */
bool opt_dce(
    PassCtx *ctx,
    Fn *fn); /* dead instructions, unused results of structured operations, unused carried values, dead arrays */
bool opt_fold(PassCtx *ctx, Fn *fn);      /* constants, exact identities, if_ on constants, loops that run once */
bool opt_cse(PassCtx *ctx, Fn *fn);       /* value numbering by scope */
bool opt_licm(PassCtx *ctx, Fn *fn);      /* loop invariants out */
bool opt_induction(PassCtx *ctx, Fn *fn); /* carried i += step becomes init + k*step */
bool opt_sink(PassCtx *ctx, Fn *fn);      /* what one branch alone uses goes there */
bool opt_hits(PassCtx *ctx, Fn *fn);      /* rays over heightfields of which only the hit counts */
bool opt_unroll(PassCtx *ctx, Fn *fn);    /* tiny exact loops */
bool opt_contract(PassCtx *ctx, Fn *fn);  /* a*b + c -> ffma: the only pass that changes floats */
bool lower_custom(PassCtx *ctx, Fn *fn);  /* [Tangent] regions: keep the primal */
bool lower_custom_sites(PassCtx *ctx,
                        Fn *fn); /* the same for those that hold sites; the others keep their derivative */
bool lower_rand(PassCtx *ctx, Fn *fn);
bool lower_math(PassCtx *ctx, Fn *fn); /* elementary functions to polynomials: the one arithmetic */

/* ---- variant_*.c: primal -> new Fn in the same arena */
typedef struct VariantOptions {
    bool near_miss;    /* region: also the nearest event (near-miss probe) */
    bool paper_argmin; /* event: the paper's argmin |g| instead of the first differing decision */
    bool paper_forced; /* sides: the paper's forced branch */
    bool path_hash;    /* region: decisions of the path instead of the provenance of the output */
} VariantOptions;
/* Outputs of each, in order: */
Fn *variant_value(PassCtx *ctx, const Fn *primal); /* f.0 .. f.C-1 */
Fn *variant_region(PassCtx *ctx, const Fn *primal,
                   const VariantOptions *o); /* hash:int [, near_site:int, near_g:flt, near_k0.. :int] [, depth:flt] */
Fn *variant_event(
    PassCtx *ctx, const Fn *primal,
    const VariantOptions *o); /* site:int (-1 none), g:flt (own end), aux:flt, k0..kD-1:int [, aux1:flt] */
Fn *variant_sides(PassCtx *ctx, const Fn *primal,
                  const VariantOptions *o); /* f.0.., hash:int (the same hash as region's) [, depth:flt] */
Fn *variant_site(PassCtx *ctx,
                 const Fn *primal); /* g:flt; inputs site (uniform), k0.., boundary or window, x, stream */

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
                             KiB, loops with heightfield queries 4 KiB */
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
    uint32_t event_depth; /* D: number of k outputs of event */
    bool near_miss;
    bool has_depth;    /* region and sides end with one more output, depth: h.trace is a site */
    uint32_t nwitness; /* region and sides end with this many more outputs, which event reads as IN_WITNESS0 and on:
                          what its searches would find, or 0 */
    bool has_window; /* event ends with one more output, aux1, and reads IN_THRESHOLD; site kernels read IN_WINDOW0, 1:
                        h.trace or h.occluded is a site */
} KernelSet;
/* The whole middle: needs[kind] says which kernels are wanted; those that the program has no use for stay NULL (no
 * site: no boundary kernel). */
void pipeline_kernels(PassCtx *ctx, Program *p, const bool needs[K_KINDS], const VariantOptions *vo,
                      const AdOptions *ad, KernelSet *out);

#endif
