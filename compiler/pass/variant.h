/* What the variants share: preparing a clone, keys of events, the outputs. */
#ifndef SALTUS_PASS_VARIANT_H
#define SALTUS_PASS_VARIANT_H

#include "compiler/pass/walk.h"

/* A clone of the primal with [Tangent] regions inlined; without prints and counters when `silent`. */
Fn *variant_clone(PassCtx *ctx, const Fn *primal, const char *name, bool silent);
/* A silent clone in which [Tangent] regions stay for the derivative, except those with sites inside. */
Fn *variant_differentiable_clone(PassCtx *ctx, const Fn *primal, const char *name);
/* The program, in which `stands` is known: a clone if it asks. */
const Fn *variant_standing(const Fn *primal, bool stands);
/* Sites become their decision (or integer) again. */
void variant_drop_sites(Fn *fn);
void variant_drop_still(Fn *fn); /* only those that are not tagged, and stand still */
static inline bool variant_is_site(const Inst *i) { return i->op == OP_site || i->op == OP_siten; }
static inline const SiteInfo *variant_site_info(const Fn *fn, const Inst *i) { return &fn->sites[i->imm.i]; }

/* How many loop indices the deepest site has. */
uint32_t variant_site_depth(const Block *b);
/* variant_lead.c: where the event of IN_SITE and IN_K0.. is one of a site that is wanted[], the conditions on the way
 * lead to it. */
void variant_lead_to_events(Fn *fn, const uint8_t *wanted);
/* variant_given.c: decisions, minima and their kin of a seamed Fn become what the inputs GIVEN0.. say of them. */
void variant_take_given(Fn *fn);
/* What a comparison gives where g < 0: `truth`. False: g does not tell. */
bool variant_truth_below(const Inst *decision, const Inst *g, bool *truth);
/* A Thread.touches that answers true for sites. */
bool variant_touches_site(Thread *t, const Inst *i);

/* Key of an event: its site number and loop indices, mixed; only equality counts. */
Inst *variant_event_key(Builder *b, const Inst *site);
/* Is any site of a kind from..to, in the order of kernel.def? */
bool variant_has_site(const Fn *fn, SiteKind from, SiteKind to);
/* The boundary of an integer-valued site between n and n + 1. */
Inst *variant_boundary(Builder *b, SiteKind kind, Inst *n);
/* variant_waves.c: in a seamed Fn the sites whose g is a wave get the kind WAVE, and as g that of one of its levels. */
void variant_waves(PassCtx *ctx, Fn *seamed);
/* Of such a site: u, and where its levels lie: pi m + (-1)^m angle + phase. */
void variant_wave_of(const Inst *site, const Inst **u, const Inst **angle, const Inst **phase);
/* The least and the greatest of the levels that lie on [lo, hi]. */
void variant_wave_levels(Builder *b, Inst *lo, Inst *hi, Inst *angle, Inst *phase, Inst **first, Inst **last);
/* variant_squares.c: in a seamed Fn in f64 g of a length becomes that of its square. Did any? */
bool variant_squares(PassCtx *ctx, Fn *seamed);
/* Outputs of a variant, as they are collected to replace those of the top block. */
typedef struct Outputs {
    Inst *value[SLT_OUT_MAX];
    Output name[SLT_OUT_MAX];
    uint32_t n;
} Outputs;
void variant_output(Outputs *o, SltRole role, uint32_t index, Inst *value);
void variant_set_outputs(Fn *fn, const Outputs *o);
/* Adds the region hash to a clone (sites stay in place): returns its final value at the end of the top block. */
Inst *variant_hash(PassCtx *ctx, Fn *fn, const VariantOptions *o);
/* Is that of provenance alone, which forgets what is overwritten? */
bool variant_tells_origin(const Fn *fn, const VariantOptions *o);

/* Edge kernels that run the program up to their event have this NaN, and in each component of the gradient, until they
 * are there: a number that no arithmetic makes. On boxes it is the bound of nothing. */
#define VARIANT_UNCAPTURED 0x7ffcull << 48
bool variant_is_uncaptured(const Inst *i);

/* variant_ray.c: sites of rays. */
Inst *variant_window_of(Fn *fn, Inst *site); /* the OP_window; args: t (INFINITY: free), top, margin */
void variant_windows_of_pairs(Fn *fn);       /* event: windows from the hits of the two lanes */
void variant_windows_of_inputs(Fn *fn);      /* site: windows that event found */
bool variant_has_windows(const Fn *fn);      /* or lines of meshes, which take their place */
bool variant_has_depth(const Fn *fn);        /* are there silhouettes? They need DEPTH, the signature of ray depths */
Inst *variant_depth(Fn *fn);                 /* the signature, threaded through a clone; sites stay */
/* Do the rays of the two lanes both hit, at depths whose signatures differ by more than IN_THRESHOLD? */
Inst *variant_depths_apart(Builder *b, Inst *site, Inst *window);
/* And if so, is there a ridge between the two hits? */
Inst *variant_ridge_between(Builder *b, Inst *window);

/* variant_mesh.c: sites of rays that meet meshes. */
/* The queries for the two numbers of its line, behind its g. */
typedef struct MeshLine {
    Inst *number[2];
} MeshLine;
MeshLine variant_mesh_line(Fn *fn, Inst *site);
/* event: of each number, which both lanes of a pair ask where they differ and `unless` does not hold: the answers. */
MeshLine variant_mesh_ask(Fn *fn, Inst *query, SiteKind kind, Inst *unless);
void variant_mesh_inputs(Fn *fn); /* site: lines that event found */
Inst *variant_mesh_input(Builder *b, const Inst *query);
/* Of the primal, last: a site at which only whether rays hit counts becomes one of the kind MESH_HIT. */
void variant_mesh_settle(Fn *fn);
/* FACE, threaded through a clone; sites stay. NULL: nobody looks at faces. */
Inst *variant_faces(Fn *fn);
bool variant_asks_line(const Inst *i);

enum { VARIANT_FOUND = 8 };
/* The first searches for hits that stand in no loop, in program order: the same ones in every clone of a primal.
 * `region` and `sides` output their witnesses, so that `event`, at the same point, need not search again. */
uint32_t variant_searches(const Fn *fn, Inst *search[SLT_WITNESSES]);
/* region, sides: outputs VARIANT_FOUND + witness of each search; 0 where it did not run. */
void variant_witnesses(Fn *fn, uint32_t n, Inst *const *search, Outputs *o);
/* event: a search runs only where its input, IN_WITNESS0 and on, is 0. */
void variant_use_witnesses(Fn *fn);

/* variant_chunks.c: the primal with its long stretches of operations in chunks; NULL where it has none. */
Fn *variant_chunks(PassCtx *ctx, const Fn *primal, const SltChunks **table); /* table: in the Fn's arena */
void variant_drop_choices(Fn *fn);                                           /* for kernels that note none */
/* The comparison that alone decides a choice, and which operand it is where that holds; NULL: there is none. */
const Inst *variant_choice_comparison(const Inst *choice, uint32_t *operand);
/* variant_chunk_edges.c */
void variant_give_differences(Fn *chunks, const SltChunks *table); /* in the place of choices */
/* captured, g of a site, or the difference of the choice that is asked for. */
Inst *variant_take_difference(Builder *b, const SltChunks *table, Inst *captured);

/* variant_provenance.c: the hash of the outputs' origin, or NULL where the program keeps the path hash. */
Inst *variant_provenance(PassCtx *ctx, Fn *fn);
bool variant_has_provenance(const Fn *fn);

/* variant_argmin.c: loops that keep one iteration. */
typedef struct Argmin {
    const Inst *loop, *key;
    int8_t sign; /* of g, with which an iteration takes over */
    bool least;  /* the key is the least one, not the greatest */
} Argmin;
/* Is it by this site of a seamed Fn that the loop around it keeps one? Numbers the Fn. */
bool variant_argmin(PassCtx *ctx, Fn *fn, const Inst *site, Argmin *found);
void variant_find_argmins(PassCtx *ctx, Fn *fn); /* sets SiteInfo.argmin */

/* variant_lists.c: which values of a loop's body hang on those marked in old[], by id, of memory or of each other. */
void variant_find_carried(const Block *body, uint8_t *old);
/* Puts a `note` into every loop with a list whose iterations can be left out. */
void variant_note_lists(PassCtx *ctx, Fn *fn, bool image);

#endif
