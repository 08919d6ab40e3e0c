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
#include "saltus/chunks.h"
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

/* A point of the pipeline: behind a pass, of a kernel. */
typedef struct PassPoint {
    PassId pass;        /* PASS_NONE: nowhere */
    const char *kernel; /* one of kernel_names, or "primal"; NULL: any */
} PassPoint;

typedef struct PassCtx {
    Session *session;
    const Program *program; /* whose Fns these are, for warnings; NULL: no warnings */
    bool untracked;         /* set by warn_jumps: some jump that moves is not tagged */
    PassPoint dump;         /* print the IR to standard error */
    PassPoint verify;       /* check the IR, and that the pass did what its row says */
    PassPoint stop_after;   /* print the IR to standard output, then unwind (session_stop) */
    bool has_fma;           /* the target has a fused multiply-add */
} PassCtx;

/* ---- passes.def: every pass */
#define PASS(name, ...) bool name(PassCtx *ctx, Fn *fn);
#define STEP(name, ...)
#include "compiler/pass/passes.def"
#undef PASS
#undef STEP

/* ---- pass.c: the registry and the driver */
typedef enum PassStage { PASS_NEEDS_ANY, PASS_NEEDS_PRIMAL, PASS_NEEDS_KERNEL } PassStage;
enum { PASS_KEEPS_FLOATS = 1, PASS_KEEPS_SITES = 2, PASS_SETTLES = 4, PASS_MAKES_SITES = 8 };
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
/* Reads "opt_fold", "all", "vjp:opt_fold", "primal:all". Returns NULL, or what is wrong with the text, with the nearest
 * name. */
const char *pass_point(Arena *a, const char *text, PassPoint *out);

/* ---- variant_*.c: primal -> new Fn in the same arena */
typedef struct VariantOptions {
    bool near_miss;          /* region: also NEAR_*, the event with the least |g|, for the near-miss probe */
    bool paper_argmin;       /* event: the event with the least |g| (Belhe et al.) instead of the first that differs */
    bool paper_forced;       /* sides: the decision of the event is forced (Belhe et al.); the rest follows from x */
    bool path_hash;          /* region, sides: the decisions of the path (up to 64 events) instead of provenance */
    bool cells;              /* sides is for cells too: wanted also where no boundary moves */
    bool image;              /* bounds is asked for lists and values alone: no event is named */
    bool written;            /* value and bounds: loops around loops with lists are written out */
    uint32_t most_site_size; /* site kernels of more operations are not made: SLT_LIMIT; 0: any */
} VariantOptions;
/* Behind each its outputs by their roles (kernel.def); in brackets those that some programs have. */
Fn *variant_value(PassCtx *ctx, const Fn *primal);                           /* F */
Fn *variant_region(PassCtx *ctx, const Fn *primal, const VariantOptions *o); /* HASH [DEPTH] [WITNESS] [NEAR_*] */
Fn *variant_event(PassCtx *ctx, const Fn *primal, const VariantOptions *o);  /* SITE G K [BOUNDARY] [WINDOW] */
Fn *variant_sides(PassCtx *ctx, const Fn *primal, const VariantOptions *o);  /* F HASH [DEPTH] [WITNESS] */
Fn *variant_site(PassCtx *ctx, const Fn *primal);                            /* G */
/* A primal in which loops of few iterations around loops with lists are written out, for images: each of those loops
 * has a list of its own, behind those that are there; without sites. The primal itself, where there are none. */
const Fn *variant_written(PassCtx *ctx, const Fn *primal);
/* Adds the lists that it will have. */
void variant_written_lists(const Fn *primal, uint32_t counts[SLT_MAX_CULL], uint32_t *n);
uint32_t variant_written_size(const Fn *primal);      /* its instructions */
Fn *variant_seams(PassCtx *ctx, const Fn *primal);    /* a primal in which seams are sites too: of the three below */
bool variant_is_flat(PassCtx *ctx, const Fn *seamed); /* does f change with the position by jumps alone? */
Fn *variant_prune(PassCtx *ctx, const Fn *chunks);    /* F_LO F_HI; notes choices */
/* G, to be differentiated in x; squares: that of a length is that of its square. */
Fn *variant_edge(PassCtx *ctx, const Fn *seamed, bool squares);
Fn *variant_chunk_edges(PassCtx *ctx, const Fn *chunks, const SltChunks *table); /* likewise */
/* image: no event is named; it is asked for lists, and for values alone */
Fn *variant_bounds(PassCtx *ctx, const Fn *seamed, bool image); /* [BOX_STATE [OPEN OPEN_*]] F_LO F_HI */
Fn *variant_edge_bounds(PassCtx *ctx, const Fn *edge);          /* of `edge`: G_LO G_HI DG_LO DG_HI G_STATE G_ERROR */

/* ---- ad_*.c. wrt[i] != 0: element i of the float vector is differentiated (NULL: all). */
/* Which loops are replayed: run again in the sweep, iteration by iteration, from carried values and witnesses. */
enum {
    AD_REPLAY_AUTO, /* those with queries, where the frame gets smaller by it */
    AD_REPLAY_NEVER,
    AD_REPLAY_ALWAYS, /* all that can be */
    AD_REPLAY_KEEP    /* as ALWAYS, and inner loops are not run again, as if they searched */
};
typedef struct AdOptions {
    const uint8_t *wrt;
    bool wrt_x;           /* also (or only, with wrt_none) with respect to the position */
    bool wrt_none;        /* with respect to no parameter */
    bool wrt_seeds;       /* also with respect to seeds: opt_marches.c */
    bool no_value;        /* ad_vjp: without the float outputs themselves */
    bool guarded;         /* pipeline_kernels: `vjp` keeps its guards (opt_bare.c) */
    uint32_t tape_budget; /* bytes a lane above which loops are checkpointed, in as many levels as it takes; 0: 64 KiB,
                             of which loops with queries 4 KiB */
    uint8_t replay;       /* AD_REPLAY_* */
    bool dense;           /* ad_vjp: long straight-line programs as others: one sweep over all (tests) */
    uint32_t rows; /* > 1: the one float output has this many seeds, and a row of adjoints for each. Not with wrt_x */
} AdOptions;
/* Forward: outputs the primal's outputs that are float, then their tangents. Tangents come in as dparam and IN_DX*. */
Fn *ad_jvp(PassCtx *ctx, const Fn *fn, const AdOptions *o);
/* Reverse: seeds IN_SEED0.. for the float outputs; adds to parameter adjoints (adj); outputs the float outputs unless
 * no_value [then, with wrt_x, the adjoints of x]. */
typedef struct TapeReport {
    uint32_t frame_values;   /* numbers in all frames, counted once a loop */
    uint64_t bytes_per_lane; /* worst case */
    bool grows;              /* of one iteration of loops that go over what queries tell: more with each */
    const char *text;        /* what is stored, what recomputed, and why: for explain */
} TapeReport;
Fn *ad_vjp(PassCtx *ctx, const Fn *fn, const AdOptions *o, TapeReport *report);
/* Of such a Fn of several outputs: where each adjoint hangs on the seed of one output, and IN_ROWS asks for rows, it
 * goes to the row of that output. False: some hang on several, and nothing has changed. */
bool ad_part_rows(Fn *fn);
/* Gradient of the single float output in x by dim forward sweeps in one kernel: outputs g, dg/dx0.. */
Fn *ad_grad_x(PassCtx *ctx, const Fn *fn);
/* In place: every `along` becomes the code of its derivative, and seeds what they are seeds of. */
void ad_along(PassCtx *ctx, Fn *fn);
/* active[(nfloats + 7) / 8]: a bit for each element of the float vector that can influence the outputs differentiably.
 */
void ad_activity(const Fn *fn, uint8_t *active);

/* ---- pipeline.c */
/* Its beginning, which says all that is said of a primal: warnings need no more. */
void pipeline_warn(PassCtx *ctx, Fn *primal);
/* Runs once, on the primal, before variants are cut from it. */
void pipeline_primal(PassCtx *ctx, Fn *primal);
/* Lowers and cleans one kernel, cut and differentiated. */
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
    const SltChunks *chunks; /* of prune and pruned; NULL: the program has no use for them */
    bool hides;              /* of region: see SltScene */
    bool bare;               /* of vjp: it had guards, and has none now */
    bool chunked;            /* bounds and the edge kernels have them too; set with edges */
    const SiteInfo *edges;   /* sites, then seams; only where bounds or an edge kernel was asked for */
    uint32_t nedges;
    bool told; /* likewise: nothing but sites makes f jump, so that places of one hash have one f and one derivative, if
                  flat */
    bool flat; /* likewise: between the jumps of sites and seams neither f nor its derivatives change with the position
                */
} KernelSet;
/* What a finished kernel reads and where its outputs are. */
SltLayout pipeline_layout(const Fn *fn);
/* Of what is seen through windows nothing is known of boxes, least of all how many pieces loops go over. */
bool pipeline_has_bounds(const Block *primal);
/* Everything between the front end and the back end. needs[kind]: which kernels are wanted; those that the program has
 * no use for stay NULL (no site: no boundary kernel). */
void pipeline_kernels(PassCtx *ctx, Program *p, const bool needs[K_KINDS], const VariantOptions *vo,
                      const AdOptions *ad, KernelSet *out);

#endif
