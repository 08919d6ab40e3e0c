/* The insides of gen: nobody else includes this.
 *
 * gen.c            the program: parameters, entry, cull bounds, limits, outputs
 * env.c            local variables as SSA: journal, ifs, loops, ranges of integers
 * call.c           inlining, [Tangent]
 * stmt.c           statements and jumps
 * loop.c           loops and their trip counts
 * expr.c           expressions
 * place.c          what can be indexed and assigned: variables, arrays, parameters
 * builtin.c        builtin functions
 * texture.c        textures
 * derived.c        arrays that are computed from parameters: placed vertices, normals of vertices
 * geometry.c       rays that meet a geometry: queries, and what follows from all of them
 * NAME.c           a geometry: NAME is that of its row in saltus/geometries.def
 * site.c           sites, [SkipLoop], the record of what is untagged
 * init.c           first values of parameters
 *
 * A local variable is one Var per scalar (or per array); its `value` is the SSA value at the point being generated.
 * Every change is written into a journal: from it an if_ learns what its first branch changed, takes that back before
 * the second, and merges what either changed. */
#ifndef SALTUS_FRONT_GEN_INTERNAL_H
#define SALTUS_FRONT_GEN_INTERNAL_H

#include <setjmp.h>

#include "compiler/front/front.h"
#include "compiler/ir/range.h"

typedef struct Var {
    Inst *value; /* NULL: not assigned yet; an alloc for arrays, which never changes */
    IrType type;
    uint32_t born;  /* Lower.clock when made: an if_ merges only what is older than it */
    uint32_t stamp; /* Lower.stamps of the walk over variables that saw this one last */
} Var;

typedef struct Change {
    Var *var;
    Inst *old;
} Change;

/* One scalar of a type, or one array of scalars: struct { float3 p; float w[3]; } s[4] is p.x[4] p.y[4] p.z[4] w[12].
 */
typedef struct LeafType {
    IrType type;
    uint32_t count; /* 0: a scalar */
} LeafType;
typedef struct Layout {
    Type *type;
    uint32_t n; /* leaves */
    LeafType *leaf;
    uint32_t nfloats, nints; /* scalars of each kind in a parameter of this type */
} Layout;

/* A value: one instruction a leaf (an alloc where the leaf is an array). */
typedef struct Val {
    Type *type;
    uint32_t n;
    Inst **c; /* [n] */
} Val;

typedef enum PlaceKind { PLACE_VARS, PLACE_PARAM } PlaceKind;
typedef struct Place {
    PlaceKind kind;
    Type *type;
    Var *vars;           /* PLACE_VARS: first leaf */
    Inst *index;         /* of the arrays indexed so far, flattened */
    Symbol *param;       /* PLACE_PARAM */
    uint32_t foff, ioff; /* constant part of the offset in the parameter's floats and ints */
    Inst *fdyn, *idyn;   /* dynamic part, in [0, fspan] and [0, ispan] */
    uint32_t fspan, ispan;
    bool selected; /* part of a vector or matrix: component j of the value is comp[j] (+ dyn * dyn_step) */
    uint8_t comp[16], ncomp;
    Inst *dyn; /* in [0, dyn_count) */
    uint32_t dyn_step, dyn_count;
    bool permuted; /* dyn chooses among perm[] instead: v.wzyx[i] = ... */
    uint8_t perm[4];
} Place;

typedef enum BindKind { BIND_NONE, BIND_VARS, BIND_PLACE, BIND_RESOURCE } BindKind;
typedef struct Bind {
    BindKind kind;
    Var *vars;
    Place place;
    Symbol *resource;
    bool ready; /* the variable exists before its declaration is reached (gen_flat) */
} Bind;

typedef struct Frame Frame;
typedef struct LoopCtx LoopCtx;

/* A site of a skipped loop: kept in carried values, emitted where the outermost loop ends. */
typedef struct SkipRec {
    Var *any, *g, *decision; /* decision NULL: `any` is the decision */
    SiteKind kind;
    Span span;
} SkipRec;

struct LoopCtx {
    LoopCtx *outer; /* through calls */
    Frame *frame;
    Inst *op, *k;
    Vec(Var *) carried;  /* parameter i + 1 */
    uint32_t ninitial;   /* of `carried` at the start; var_hidden adds more */
    uint32_t mark, born; /* journal length and clock at the start */
    uint64_t iters;      /* at most */
    Builder after;       /* behind the loop */
    Vec(SkipRec) skips;  /* of the outermost loop of a function */
};

struct Frame {
    Func *func;
    Frame *caller;
    Span call_span;
    const Span *shown; /* of a function behind GLSL's names: where the source calls it, for messages; else NULL */
    /* Of a function of the standard library; else `library` is NULL. */
    const Span *library;        /* where a source calls it */
    bool asked, by_auto, quiet; /* the tag of the statement that calls it: [Disc], --disc auto, [NoDisc] */
    Bind *bind;
    Var *ret;                  /* one a leaf of the result */
    Var *ret_flag, *brk, *cnt; /* a return, break or continue was taken; brk and cnt: to the innermost target */
    LoopCtx *first_loop;       /* outermost of this function */
    uint32_t depth;            /* of calls */
};

typedef struct Tag {
    bool disc, nodisc;
    bool by_auto;  /* disc by --disc auto alone */
    bool own;      /* [Disc] stands before the statement itself */
    LoopCtx *skip; /* sites go to this loop's records */
} Tag;

/* The distance of a ray from a geometry; the distance jumps where the geometry's box ends. */
typedef struct Clearance {
    Inst *value, *search; /* the distance; the query behind it */
    Inst *gap;            /* how much of the ray's t is missing to touch the box; negative inside */
    Inst *cell;           /* the t in which the ray covers a cell's length */
} Clearance;

/* A height of a geometry that was looked up at (x, y) of the world. */
typedef struct Surface {
    const Symbol *sym;
    const Inst *height, *x, *y;
} Surface;

typedef struct ConstArray {
    Symbol *sym;
    Var *vars;
} ConstArray;

/* Facts about a function that do not depend on the call. */
typedef struct FuncFacts {
    Func *func;
    uint64_t ops, own; /* estimated operations, with all calls inlined and without them */
    uint64_t copies;   /* how often the function is inlined in all */
    bool rand, done;
} FuncFacts;

typedef struct Lower {
    Session *s;
    Arena *arena;
    const ProgramOptions *opt;
    Program *program;
    Fn *fn;
    Builder b;
    Frame *frame;
    LoopCtx *loop;
    Tag tag;
    Inst *anchor;      /* first instruction of the Fn */
    Inst *begun;       /* SLT_QUERY_BEGIN, once at the top; NULL: no pieces are looked for */
    Var *rand_counter; /* the number that the next rand() takes */
    Vec(Change) journal;
    uint32_t clock, stamps; /* counters behind Var.born, Var.stamp */
    Vec(IrRange) ranges;    /* of integers, by Inst.tag: what ir_range_of cannot see; 0 is unused */
    Vec(SiteInfo) sites;
    Vec(Untracked) untracked;
    Vec(Span) silenced;
    Vec(ConstArray) const_arrays;
    Vec(FuncFacts *) facts; /* in order of discovery: callees first */
    FuncFacts **fact_table; /* by hash of the Func */
    uint32_t fact_cap;
    Vec(Fn *) culls;
    Vec(GeometryInfo) geometries;
    Vec(Derived) derived;
    Vec(Surface) surfaces;
    Vec(Clearance) clearances;
    Vec(Val) met; /* MeshHits as rays have met them */
    uint32_t nops, nloops;
    uint32_t depth;  /* regions around this place */
    bool in_tangent; /* in a function that [Tangent] names: no sites, no records */
    bool quiet;      /* not the shader itself (initialisers, bounds): no sites, no records */
    bool records;    /* quiet, but for records */
    Layout *layout_cache[256];
    jmp_buf *giveup;
} Lower;

/* gen.c */
_Noreturn void gen_giveup(Lower *l);
Lower gen_fresh(Lower *l, const char *name); /* for another, quiet Fn of the same program */
const Layout *gen_layout(Lower *l, Type *t);
FuncFacts *gen_facts(Lower *l, Func *f);
/* Parts [first, first + count) of what f returns; its int arguments are the inputs from `arg` on. */
Fn *gen_function(Lower *l, Func *f, const char *name, InputSlot arg, uint32_t first, uint32_t count);
/* Makes n, of the floats or the integers of all parameters, larger; their number is limited. */
void gen_reserve(Lower *l, uint32_t *n, uint64_t more, Span span);
_Noreturn void gen_too_large(Lower *l, Span span);
IrType gen_ir_type(const Type *t);

/* env.c: emitting */
Inst *op1(Lower *l, Op op, Inst *a);
Inst *op2(Lower *l, Op op, Inst *a, Inst *b);
Inst *op3(Lower *l, Op op, Inst *a, Inst *b, Inst *c);
Inst *special(Lower *l, Op op, IrType t, uint32_t n, Inst *const *args, Imm imm);
Inst *kf(Lower *l, double v);
Inst *ki(Lower *l, int64_t v);
Inst *kb(Lower *l, bool v);
static inline bool is_true(const Inst *i) { return i->op == OP_constb && i->imm.i; }
static inline bool is_false(const Inst *i) { return i->op == OP_constb && !i->imm.i; }
Inst *sel(Lower *l, Inst *c, Inst *x, Inst *y);
Inst *alloc_array(Lower *l, IrType elem, uint32_t count);
/* variables */
Var *var_new(Lower *l, IrType t, uint32_t n);
Var *vars_for(Lower *l, Type *t); /* arrays allocated */
Inst *var_get(Lower *l, Var *v);
void var_set(Lower *l, Var *v, Inst *x);
Var *var_hidden(Lower *l, LoopCtx *root, Inst *(*init)(Lower *, Builder *), IrType t);
typedef struct IfCtx {
    Inst *op;
    Builder outer, then_end;
    uint32_t mark, born; /* journal length and clock at the start */
    Vec(Var *) changed;
    Vec(Inst *) first; /* values of `changed` at the end of the first branch */
} IfCtx;
void if_begin(Lower *l, IfCtx *c, Inst *cond);
void if_else(Lower *l, IfCtx *c);
void if_end(Lower *l, IfCtx *c);
typedef Vec(Var *) VarList;
void loop_begin(Lower *l, LoopCtx *c, const VarList *carried, LoopInfo info);
void loop_end(Lower *l, LoopCtx *c, Inst *go_on);
void gen_prune_loops(Lower *l);
/* integers: bounds of what an instruction can be */
void range_set(Lower *l, Inst *i, int64_t lo, int64_t hi);
void range_get(Lower *l, const Inst *i, int64_t *lo, int64_t *hi);
Inst *clamp_index(Lower *l, Inst *i, bool is_unsigned, uint32_t n);

/* expr.c */
Val gen_expr(Lower *l, Expr *e);
Inst *gen_scalar(Lower *l, Expr *e);
Val val_new(Lower *l, Type *t);
Val gen_binary(Lower *l, Operator op, Val a, Val b, Type *type, Span span);
Inst *convert_scalar(Lower *l, Inst *v, const Type *from, const Type *to, Span span);
Type *scalar_of(Type *t);
uint32_t expr_cost(Lower *l, const Expr *e, uint32_t limit); /* operations, roughly; > limit when dear or not pure */
bool expr_has_site(const Expr *e);
bool expr_assigns(const Expr *e);
Val const_val(Lower *l, Type *t, const ConstVal *c);

/* place.c */
bool gen_is_place(const Expr *e);
Place gen_place(Lower *l, Expr *e);
Val place_load(Lower *l, const Place *p);
void place_store(Lower *l, const Place *p, Val v);
Val vars_load(Lower *l, Type *t, Var *vars);
/* own: the variable is fresh and may take over the arrays of v. */
void vars_store(Lower *l, Type *t, Var *vars, Val v, bool own);
Place place_of_vars(Type *t, Var *vars);
Symbol *gen_resource(Lower *l, const Expr *e);
Bind *gen_bind(Lower *l, const Symbol *sym);
/* Number offset + dyn of the parameter's floats, or of its integers (of a mesh, of its topology); dyn in [0, span], or
 * NULL. */
Inst *param_int(Lower *l, const Symbol *sym, uint32_t offset, Inst *dyn, uint32_t span, IrType t);
Inst *param_float(Lower *l, const Symbol *sym, uint32_t offset, Inst *dyn, uint32_t span);
/* The same of any slice of the floats or the integers. */
Inst *slice_float(Lower *l, uint32_t base, Inst *dyn, uint32_t span);
Inst *slice_int(Lower *l, uint32_t base, Inst *dyn, uint32_t span);

/* call.c */
Val gen_call(Lower *l, Expr *e);
Val gen_inline(Lower *l, Func *f, const Bind *args, Span span);
Span gen_shown(const Lower *l, Span span); /* what is said of this place is said of … */
const char *gen_path(Lower *l);

/* stmt.c, loop.c */
void gen_stmt(Lower *l, Stmt *s);
void gen_list(Lower *l, Stmt **stmts, uint32_t n);
void gen_loop(Lower *l, Stmt *s);
typedef struct Jumps {
    bool falls, brk, cnt, ret; /* the statement may fall through, break, continue, return */
} Jumps;
Jumps stmt_jumps(const Stmt *s);
Tag tag_for(Lower *l, const Stmt *s);
void scan_assigned_stmt(Lower *l, const Stmt *s, VarList *out);
void scan_assigned_expr(Lower *l, const Expr *e, VarList *out);
bool stmt_uses_rand(Lower *l, const Stmt *s);
bool expr_uses_rand(Lower *l, const Expr *e);

/* builtin.c, texture.c, geometry.c */
Val gen_builtin(Lower *l, Expr *e);
Val gen_texture(Lower *l, Expr *e, const Symbol *sym); /* a method that is not fixed */
Val gen_method(Lower *l, Expr *e);
/* a - b as the boundary function of a comparison, if one of them is a clearance; else NULL. */
Inst *gen_clearance_compare(Lower *l, Inst *a, Inst *b);
void gen_geometry_finish(Lower *l); /* of the whole entry: weaker queries, the table of what is asked */
Val gen_matmul(Lower *l, Val a, Val b, Type *type);
Inst *dot_n(Lower *l, Inst *const *a, Inst *const *b, uint32_t n);

/* site.c: each returns the decision (or integer) to use: a site if the statement is tagged, else one recorded for the
 * warning */
Inst *site_compare(Lower *l, Inst *decision, Inst *a, Inst *b, Span span);
Inst *site_integer(Lower *l, SiteKind kind, Inst *n, Inst *v, Span span);
/* Is this place a site? Then the next site_ray makes it. Else it is recorded for the warning as a jump of this kind,
 * with t as what it depends on. */
bool site_wanted(Lower *l, Inst *hit, Inst *t, Span span, JumpKind kind);
Inst *site_ray(Lower *l, SiteKind kind, Inst *hit, Inst *g, Span span);
void site_untracked(Lower *l, Inst *at, Inst *g0, Inst *g1, Span span, JumpKind kind);
Inst *gen_skip_condition(Lower *l, Expr *cond, LoopCtx *root);
void site_flush_skips(Lower *l, LoopCtx *root);

/* derived.c */
uint32_t gen_placed(Lower *l, const Symbol *mesh);  /* where the float vector has its vertices as rays meet them */
uint32_t gen_normals(Lower *l, const Symbol *mesh); /* and normals of unit length of these */
void gen_derived_finish(Lower *l);                  /* of the whole entry: writes out what was asked for */

/* init.c */
void gen_initial_values(Lower *l);

#endif
