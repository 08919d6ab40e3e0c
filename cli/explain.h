/* What `saltus explain` says of a program, as data: explain_model.c looks inside the program and builds it once,
 * explain.c prints the model as text or as JSON and looks at nothing else. A model lies in the session's arena and is
 * valid as long as its program; its strings may be the program's own. */
#ifndef SALTUS_CLI_EXPLAIN_H
#define SALTUS_CLI_EXPLAIN_H

#include "bindings/c/api.h"
#include "cli/cli.h"
#include "compiler/back/cost.h"
#include "runtime/mesh/mesh.h"
#include "runtime/quadrature/cells.h"

typedef struct ExplainedSite {
    const char *kind, *file, *path, *text; /* file NULL: no place; path: functions that the site was inlined through */
    uint32_t line, column;
    uint64_t max_events;
    bool skip_loop, is_live, is_static; /* live: its jumps reach the output; static: does not depend on x */
} ExplainedSite;

typedef struct ExplainedKernel {
    const char *name, *left_out; /* left_out: why the kernel was not made, or NULL */
    uint32_t lanes;              /* samples side by side */
    uint32_t ops, instructions;  /* operations of our IR, instructions of LLVM's after its passes */
    uint64_t tape_bytes;         /* a lane */
    const char *tape;            /* the report on what is stored, or NULL */
} ExplainedKernel;

/* A parameter that lacks a gradient or a structure, and why. */
typedef struct ExplainedLack {
    const char *param, *why;
} ExplainedLack;

typedef struct ExplainedGeometry {
    const char *name, *structure, *description; /* description NULL: nothing was built */
    uint32_t width, height;                     /* of a grid */
    uint32_t vertices, triangles;               /* of a mesh */
    size_t bytes;
    uint32_t queries, by_kernel[K_KINDS]; /* bit (1 << SltQuery): asked by any kernel, by kernels of a kind */
    uint32_t not_asked;                   /* bit (1 << SltQuery): it would answer, but no kernel asks */
} ExplainedGeometry;

typedef struct ExplainedMesh {
    const char *name;
    MeshCounts counts;
} ExplainedMesh;

/* An array that is computed from parameters: from their names with commas. */
typedef struct ExplainedDerived {
    const char *what, *mesh, *from;
    uint32_t n;
    bool differentiated;
} ExplainedDerived;

/* A place in the source that bounds say something of. */
typedef struct ExplainedPlace {
    const char *file, *what, *text; /* file NULL: no place; what: "kink", "jump", or why there is no bound */
    uint32_t line, column;
} ExplainedPlace;

/* A loop of which the runtime may run listed iterations only. */
typedef struct ExplainedList {
    ExplainedPlace at;
    uint32_t iterations;
    bool cull; /* by [Cull]; else found */
} ExplainedList;

typedef struct ExplainedBounds {
    ExplainedPlace *seams, *unbounded, *wide; /* unbounded: what no box can settle; wide: what only small ones can */
    ExplainedList *lists;
    uint32_t nseams, nunbounded, nwide, nlists;
    bool crowded;             /* it has so many places for seams that some have none */
    uint32_t chunks, choices; /* a straight-line program that is pruned; else 0 */
    /* Of equal boxes that fill the domain: how many there are, settled, with open events and nothing else, unknown or
     * rough. All 0: the kernels do not run here. */
    uint32_t boxes, settled, open, unknown;
} ExplainedBounds;

/* What a compiled kernel costs. */
typedef struct ExplainedKernelCost {
    bool compiled;
    uint32_t lanes, ops, instructions, machine_bytes; /* instructions: of LLVM */
    const char *width_key, *width_text;               /* why it has these lanes, as a word and as a sentence */
    uint64_t tape_bytes;                              /* a lane */
    const char *tape;                                 /* as ExplainedKernel.tape */
    KernelCost estimate;
    Listing listing;
} ExplainedKernelCost;

/* A line of the source in the kernels that run for samples. */
typedef struct DearLine {
    int32_t file; /* of the session */
    uint32_t line;
    const char *path;
    double share;                /* of what all of them cost */
    const CostLine *in[K_KINDS]; /* NULL: not in that kernel */
    int dearest;                 /* the kernel where it costs a sample most */
} DearLine;

typedef struct ExplainedCost {
    const char *target;
    ExplainedKernelCost kernels[K_KINDS];
    DearLine *lines;
    uint32_t nlines;
} ExplainedCost;

typedef struct Explained {
    const char *entry;
    bool display; /* slt_is_display */
    uint32_t dim, channels, nfloats, nints, width, ncull;
    bool f64, near_miss, has_geometry, uses_rand, cached;
    uint64_t events_bound; /* in one sample */
    double ms_front, ms_passes, ms_llvm;
    ExplainedSite *sites;
    ExplainedKernel kernels[K_KINDS];
    ExplainedLack *no_gradient, *no_structure;
    ExplainedGeometry *geometries;
    ExplainedMesh *meshes;
    ExplainedDerived *derived;
    uint32_t nmeshes, nderived;
    uint32_t nsites, nno_gradient, nno_structure, ngeometries;
    ExplainedBounds bounds;
    ExplainedCost *cost; /* NULL: nobody asked */
} Explained;

/* The story of one point. */
typedef struct TracedSite {
    int32_t site, k[SLT_MAX_K]; /* k: indices of the loops around the site, outermost first */
    uint32_t loops;             /* how many of k */
    double g, n;                /* g; of a rounding the number that was rounded, and n its result */
    bool decision, is_rounding;
} TracedSite;
typedef struct ExplainedPoint {
    double x[3], f[SLT_MAX_CHANNELS];
    uint32_t dim, channels;
    TracedSite *trace; /* in the order of execution; malloc'd */
    uint32_t ntrace;
    SltCrossing crossing; /* the nearest along the axes, on segments of an eighth of the domain to both sides */
    uint32_t axis;        /* along which the crossing lies */
} ExplainedPoint;

/* explain_model.c: an SltStatus. Compiles the kernels that the job of `c` needs. */
SltStatus explain_program(const Cli *c, SltProgram *p, Explained *out, SltError *err);
/* explain_bounds.c: of a program whose kernels are compiled. */
SltStatus explain_bounds(SltProgram *p, ExplainedBounds *out, SltError *err);
/* explain_mesh.c */
SltStatus explain_meshes(const SltProgram *p, Arena *arena, Explained *out, SltError *err);
void explain_print_meshes(const Explained *m);
void explain_json_meshes(const Explained *m);
/* explain_cost.c: of a program whose kernels are compiled; compiles each once more, to look at its machine code. */
SltStatus explain_cost(SltProgram *p, ExplainedCost *out, SltError *err);
void explain_print_cost(const ExplainedCost *m);
void explain_json_cost(const ExplainedCost *m);
/* explain_cells.c: writes the picture c->cells; or draws it as SVG, malloc'd, NULL after an error. */
typedef struct ExplainedCells {
    char *svg;
    size_t size, ncells;
    CellCounts counts;
} ExplainedCells;
SltStatus explain_cells(const Cli *c, SltProgram *p, SltError *err);
SltStatus explain_draw_cells(SltProgram *p, ExplainedCells *out, SltError *err);
/* explain_point.c: inside session_protect. *traced, NULL at first, is made by the first call and serves those that
 * follow for the same program. out is empty after an error. */
SltStatus explain_point(SltProgram *p, Fn **traced, const double x[3], ExplainedPoint *out, SltError *err);
void explain_free_point(ExplainedPoint *m);
void explain_print_point(const ExplainedPoint *m);
void explain_json_point(FILE *out, const ExplainedPoint *m); /* an object */

#endif
