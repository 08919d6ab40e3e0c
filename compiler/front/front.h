/* The front end's product: a Program, one entry point as primal IR with the tables that people and the runtime need. */
#ifndef SALTUS_FRONT_FRONT_H
#define SALTUS_FRONT_FRONT_H

#include "compiler/front/ast.h"
#include "compiler/ir/ir.h"

/* One parameter (of any type). Its scalars lie in the two flat vectors of the program: float components in order of
 * declaration in `floats`, int, uint and bool components in `ints`. An element of an array of structs is `fstride`
 * floats and `istride` ints. */
typedef struct Param {
    const char *name; /* "radius", "module.name" */
    Type *type;
    Symbol *sym;
    uint32_t fbase, fcount; /* slice of the float vector; textures: [d*]h*w*c numbers, row 0 the top */
    uint32_t ibase, icount; /* slice of the int vector */
    bool differentiable;    /* has floats, no [NoDiff] */
    ParamAttrs attrs;
    bool is_texture, is_geometry, is_mesh; /* a mesh is a geometry; its numbers are float3[vertices] */
    uint32_t tbase, tcount;                /* of a mesh: its topology (saltus/mesh.h) in the int vector */
    uint32_t vertex_parts, rings;          /* likewise, behind all topologies; 0: nobody asks */
    uint32_t tex_w, tex_h, tex_d, tex_c;   /* columns, rows, slices of a texture3D (else 0), channels */
    const char *asset; /* file of the first values, which the caller loads; NULL: they are in init_floats, init_ints */
} Param;

/* Are the parameter's values an image or a volume, tex_w x tex_h [x tex_d] x tex_c? */
static inline bool param_is_image(const Param *q) { return q->tex_w > 0; }
/* Its sizes as a nested list has them, outermost first: [slices,] rows, columns[, channels]. Returns how many. */
static inline uint32_t param_texel_sizes(const Param *q, uint32_t n[4]) {
    uint32_t k = 0;
    if (q->tex_d) n[k++] = q->tex_d;
    n[k++] = q->tex_h, n[k++] = q->tex_w;
    if (q->tex_c > 1) n[k++] = q->tex_c;
    return k;
}

/* One geometry that some query searches; its index in Program.geometries is the query's imm.query.geometry. */
typedef struct GeometryInfo {
    SltGeometryKind kind;
    uint32_t param;         /* index in Program.params */
    uint32_t base, count;   /* its slice of the float vector */
    uint32_t size[2];       /* of its grid: columns, rows */
    uint32_t nfaces, tbase; /* of a mesh: triangles; its topology in the int vector */
    double band;      /* how near a ray has to come for its distance to count: one cell's size, in the values' unit */
    uint32_t queries; /* bit (1 << SltQuery): asked for somewhere in the primal */
} GeometryInfo;

typedef enum JumpKind {
    JUMP_COMPARE,
    JUMP_EQUALITY, /* == or !=: jumps only where it holds on an area */
    JUMP_BUILTIN,
    JUMP_ALWAYS,  /* a value that jumps and cannot be a site */
    JUMP_TRACE,   /* likewise a value that jumps, which [Disc] makes a site of */
    JUMP_PIECES,  /* a query of visible pieces: jumps where not all of them count by their area */
    JUMP_INTEGER, /* a comparison of integers under [Disc], which jumps where they do */
    JUMP_SKIPPED  /* of one iteration, under [SkipLoop]: tagged, and no site by itself; opt_skips.c */
} JumpKind;

/* A place that may jump and is no site. The front end records them; pass/warn.c judges. */
typedef struct Untracked {
    Inst *at;      /* the comparison, or the value that jumps */
    Inst *g0, *g1; /* g = g0 - g1; g1 may be NULL */
    Span span;
    JumpKind kind;
} Untracked;

/* An array of float3 that is computed from parameters, and from such arrays before it, whenever these change: where a
 * mesh's vertices are, its normals. Its numbers lie behind those of all parameters; kernels, derivatives and geometries
 * take it for one, and what a derivative in its numbers is worth in the parameters, its own program says. */
typedef struct Derived {
    const char *what;        /* "placed vertices" */
    uint32_t param;          /* of the mesh: index in Program.params */
    uint32_t base, n;        /* its slice of the float vector: n times 3 */
    struct Program *of;      /* of element k0, the only input: three channels */
    uint32_t *reads, nreads; /* parameters with floats that it depends on, through other arrays too */
    bool reads_ints;         /* a parameter's integers */
} Derived;

typedef struct Program {
    Session *session;
    const char *entry;
    uint32_t dim, channels; /* 1..3, 1..4 */
    double lo[3], hi[3];    /* the domain */
    bool is_glsl;           /* written in GLSL */
    bool display;           /* its colours are encoded for a screen: sRGB, not linear light */
    Param *params;
    uint32_t nparams;
    uint32_t nfloats, nints;
    uint32_t nplaced;    /* the last of the floats: those of derived arrays, which nobody sets */
    uint32_t ntopology;  /* the last of the ints: what meshes are made of, which nobody sets */
    double *init_floats; /* [nfloats], [nints]: values from the source; 0 where an asset's go */
    int32_t *init_ints;
    Fn *primal;         /* outputs: the channels; MATH rows, custom regions and sites in place */
    uint64_t init_fuel; /* instructions left for all initialiser functions, so that compiling ends */
    bool uses_rand, uses_pixel, uses_prints;
    bool of_elements;         /* of a derived array: the position is the number of an element */
    GeometryInfo *geometries; /* those that some query searches: the others need no structure */
    uint32_t ngeometries;
    Derived *derived; /* in order: each may read those before it */
    uint32_t nderived;
    uint32_t ncull;       /* [Cull] loops */
    Fn **cull_bounds;     /* [ncull] their bounds functions: input iteration, outputs lo.x lo.y hi.x hi.y */
    Untracked *untracked; /* instructions of the primal; valid until a pass edits it */
    uint32_t nuntracked;
    Span *silenced; /* places that would be untracked but for [NoDisc] */
    uint32_t nsilenced;
    Func *entry_func;
} Program;

/* How many of the floats are parameters. */
static inline uint32_t program_floats(const Program *p) { return p->nfloats - p->nplaced; }

/* Sees every expression that is generated, once for each place where it is inlined, with its value: one instruction a
 * scalar, or an alloc. What is constant is not generated. */
typedef void ExprWatch(void *user, const Expr *e, Inst *const *value, uint32_t n);

typedef struct ProgramOptions {
    FrontOptions front;
    Precision precision;
    uint32_t seed;    /* for rand() in initialiser functions */
    ExprWatch *watch; /* NULL: nobody */
    void *watch_user;
} ProgramOptions;

/* gen/gen.c: a checked entry becomes a Program. Inlines every call (beyond 2^18 operations: an error that shows the
 * call tree with counts). NULL after reporting. */
Program *gen_program(Session *s, Module *main, Func *entry, const ProgramOptions *opt);

/* front.c: its first two steps, whose tree is there whatever was reported. *entry: NULL after errors. Of GLSL the
 * caller sets the source's size first, and ends with glsl_speak. */
Module *front_check(Session *s, int file, const FrontOptions *opt, Func **entry);
/* The whole front end: load, check, generate. NULL if any error was reported. */
Program *front_compile(Session *s, int file, const ProgramOptions *opt);

/* glsl/complete.c: a uniform that Shadertoy sets, whether a shader reads it or not. */
bool glsl_host_sets(const char *name);

/* glsl/words.c: messages about what is written in GLSL, in its words. */
void glsl_speak(Session *s);
/* One message about src: its own words stay. */
const char *glsl_in_words(Session *s, const Source *src, const char *text);

/* Component names: "discs[3].centre.x" -> index in the float (or int) vector. */
typedef struct ParamRef {
    const Param *param;
    Type *type;             /* of what was named: a component, an element, a field or the whole */
    uint32_t fbase, fcount; /* the floats named, contiguous */
    uint32_t ibase, icount;
} ParamRef;
/* why suggests the nearest name: a text in the session arena, which a name that is found takes nothing of. */
bool program_find(const Program *p, const char *name, ParamRef *out, const char **why);

/* Of every float of q, arrays of q->fcount: the bounds of [Range] and whether [Log] marks it. A field's attributes come
 * before its parameter's. */
void program_limits(const Param *q, double *lo, double *hi, uint8_t *log);

/* Many at once: an index may be a star, "discs[*].centre". */
enum { PARAM_MAX_STARS = 8 };
typedef struct ParamPattern {
    ParamRef at;                                                      /* with 0 for every star */
    uint32_t nstars, count[PARAM_MAX_STARS], stride[PARAM_MAX_STARS]; /* elements, and floats from one to the next */
} ParamPattern;
bool program_find_pattern(const Program *p, const char *name, ParamPattern *out, const char **why);
void program_mark(const ParamPattern *pattern, uint8_t *floats); /* sets floats[i] to 1 where i is of the pattern */

#endif
