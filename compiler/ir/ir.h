/* The intermediate representation: structured SSA of scalars.
 *
 * One Fn is one kernel to be: straight lists of instructions in blocks, control flow only by the structured operations
 * if_, loop, revloop and custom, whose regions are blocks. Vectors, matrices, structs are gone (split into scalars);
 * parameters are read by index; local arrays are the only memory. An instruction *is* its value (at most one); the
 * several results of a structured operation are proj instructions right behind it. The last instruction of every block
 * is a yield; the yield of the top block lists the outputs.
 *
 *     %1 = flt %0, %c
 *     %2 = if_ %1 { yield %a } { yield %b }                                 the regions then and else
 *     %3 = proj %2 #0                                                       the first result of %2
 *     %4 = loop %init { (%k, %carried) ... yield %continue, %next }
 *     %5 = proj %4 #0                                                       the last %next
 *
 * Ownership: everything lives in fn->arena (module arena); passes edit in place or clone. Dominance is by nesting: a
 * value is visible after its definition in its block and in the regions below. Not thread-safe. */
#ifndef SALTUS_IR_IR_H
#define SALTUS_IR_IR_H

#include "compiler/base/session.h"
#include "compiler/ir/query.h"
#include "saltus/contract.h"

typedef enum Op {
#define FOP1(name, ...) OP_##name,
#define FOP2(name, ...) OP_##name,
#define FOP3(name, ...) OP_##name,
#define FCMP2(name, ...) OP_##name,
#define FSEL(name, ...) OP_##name,
#define IOP1(name, ...) OP_##name,
#define IOP2(name, ...) OP_##name,
#define ICMP2(name, ...) OP_##name,
#define BOP1(name, ...) OP_##name,
#define BOP2(name, ...) OP_##name,
#define CONV(name, ...) OP_##name,
#define SPECIAL(name, ...) OP_##name,
#include "compiler/ir/ops.def"
#include "compiler/ir/ops_undef.h"
    OP_COUNT
} Op;

typedef enum IrType { TY_VOID, TY_BOOL, TY_INT, TY_FLT, TY_ARRAY, TY_TAPE } IrType;
typedef enum Precision { PREC_F32, PREC_F64 } Precision;

/* The rows of the contract by the names that the compiler uses: IN_X0 is SLT_IN_X0. */
typedef enum InputSlot {
#define SLT_INPUT(id, ...) IN_##id = SLT_IN_##id,
#define SLT_UNIFORM(id, ...) IN_##id = SLT_IN_##id,
#include "saltus/kernel.def"
} InputSlot;

typedef enum CounterSlot {
#define SLT_COUNTER(id, ...) COUNTER_##id = SLT_COUNT_##id,
#include "saltus/kernel.def"
} CounterSlot;

/* Kinds of sites. */
typedef enum SiteKind {
#define SLT_SITE(id, ...) SITE_##id = SLT_SITE_##id,
#include "saltus/kernel.def"
} SiteKind;
/* Sites of a ray that meets a mesh, whose g is that of a line which `event` has found. */
static inline bool ir_site_of_mesh(SiteKind kind) { return kind >= SITE_MESH && kind <= SITE_MESH_SHADOW; }
/* Sites of a ray that meets a geometry: also those whose g looks along a window of the ray. */
static inline bool ir_site_of_ray(SiteKind kind) {
    return kind == SITE_SILHOUETTE || kind == SITE_SHADOW || ir_site_of_mesh(kind);
}

#define IR_IF_RARE 1         /* imm.i of an if_ whose condition hardly ever holds: always a real branch */
#define IR_MAX_OPS (1u << 18)
#define IR_MAX_PLACES 16 /* of a value that chunks hand to each other: ends and more, of it and of its derivatives */

typedef struct Inst Inst;
typedef struct Block Block;
typedef struct Fn Fn;

typedef struct LoopInfo {
    uint32_t max_iters; /* bound on the iterations of one execution, always > 0 */
    bool exact;         /* the trip count is this constant */
    bool cull;          /* the runtime's list of iterations may replace 0..max_iters-1 */
    bool found;         /* no [Cull] says so but opt_lists: a pass may take the list away */
    bool told;          /* an iteration for each of what a query tells: max_iters is far beyond how many there are */
    uint32_t cull_id;   /* the list's number: [Cull] loops first, whose bounds are Program.cull_bounds */
    uint32_t loop_id;   /* dense number of the source loop, for explain */
} LoopInfo;

/* The immediate of an operation: ops.def says which has which. */
typedef union Imm {
    double f;  /* constf */
    int64_t i; /* consti, constb; others: the number of an input, result, site, counter */
    struct {
        uint32_t base, count;
    } slot; /* param, iparam, dparam, adj */
    struct {
        uint32_t count;
        IrType elem;
    } arr; /* alloc */
    LoopInfo loop;
    struct {
        const char *text;
        uint32_t len;
    } text; /* print */
    struct {
        uint32_t which, place, places; /* give, take: a value may have several places, its lower and upper ends */
    } frame;
    struct {
        uint32_t geometry, what, base;
    } query; /* what: SltQuery; base: the geometry's first float parameter */
} Imm;

struct Inst {
    Inst *prev, *next; /* in block */
    Block *block;
    Inst **args;
    Block *region[2];
    Imm imm;
    Span span;
    uint32_t id; /* dense after ir_number(); printed name */
    uint32_t nargs;
    uint8_t op, type; /* Op, IrType */
    uint8_t nregions;
    uint8_t flags; /* for the pass that runs; undefined between passes */
    uint32_t tag;  /* likewise */
};

struct Block {
    Inst *first, *last; /* last is the yield once complete */
    Inst **params;      /* arg instructions, not in the list */
    uint32_t nparams;
    Inst *owner; /* the structured operation; NULL for the top block */
};

/* One static site: one place in the source inlined through one chain of calls. */
/* What a seam that moves with a parameter may change at its jump, though nothing crosses 0 there. */
typedef enum SeamUpset {
    UPSETS_NOTHING,
    UPSETS_SITES, /* decisions of sites */
    UPSETS_UNSEEN /* f, whatever decides */
} SeamUpset;

typedef struct SiteInfo {
    SiteKind kind;
    Span span;           /* the comparison or the jumping builtin */
    const char *path;    /* "main > sd_scene" */
    uint32_t depth;      /* how many loop indices tell the site's events apart, <= SLT_MAX_K */
    uint64_t max_events; /* product of the loop bounds */
    bool skip_loop;
    bool by_auto;     /* no [Disc] stands there: --disc auto */
    bool still;       /* untagged, and does not move: opt_masks.c; where bounds hold it is a seam like others */
    bool jumps;       /* of a seam: more than a bend */
    int8_t argmin;    /* in a seamed Fn: the sign of g with which an iteration takes over; 0: variant_argmin.c */
    SeamUpset upsets; /* likewise */
    const char *text; /* short source text for explain: "d < 0.0" */
} SiteInfo;

/* What an output is; index: which of several of its role. In text "f.0", "hash", "k1". */
typedef struct Output {
    SltRole role;
    uint32_t index;
} Output;

struct Fn {
    const char *name;
    Session *session;
    Arena *arena;
    Block *body;
    Precision precision;
    uint32_t dim, channels;  /* of the position, 1..3; of f, 1..SLT_MAX_CHANNELS */
    uint32_t nfloats, nints; /* sizes of the parameter vectors */
    SiteInfo *sites;
    uint32_t nsites;
    Fn *next_part;         /* a site kernel may come in parts, each for some sites; NULL: the last */
    const uint8_t *serves; /* [nsites]: 1 where this part is for the site; NULL: for all */
    Output *outputs;       /* what each value of the top yield is; NULL: they have no roles */
    uint64_t same;         /* bit by input: samples of one call all have one value, which the caller sees to */
    uint32_t ninsts;       /* after ir_number */
};

/* ---- ops.c: facts of the table */
#define IR_MANY 255 /* OpInfo.nargs: any number */
/* The kind column of special rows; value rows are pure. */
typedef enum OpKind { KIND_PURE, KIND_READ, KIND_LINK, KIND_PLACED, KIND_EFFECT } OpKind;
#define IR_COST_DIVISION 5 /* OpInfo.cost of a float division: what costs as much is dear */
typedef struct OpInfo {
    const char *name;
    uint8_t nargs;  /* IR_MANY: any number */
    uint8_t result; /* IrType; for SPECIAL with '?': TY_VOID and the instruction says */
    uint8_t arg;    /* IrType of a value row's arguments (a select's condition is TY_BOOL); else TY_VOID */
    uint8_t kind;   /* OpKind */
    bool special, math;
    bool compares, selects; /* a comparison; a choice between the second and the third argument */
    uint16_t cost;          /* in vector additions of the same width */
} OpInfo;
extern const OpInfo ir_ops[OP_COUNT];
IrType ir_input_type(InputSlot slot);
size_t ir_uniform_offset(InputSlot slot); /* bytes from the start of SltKernelArgs; slot: an SLT_UNIFORM */

/* ---- build.c
 * New instructions have id UINT32_MAX until the next ir_number. All bytes of imm are defined, so imms
 * compare with memcmp. Functions that return a Builder leave fold false. With fold, besides what is exact, x + 0 gives
 * x, 0 - x gives -x and fma(a, b, 0) gives a*b (only the sign of a zero may differ), and zmul(x, 0) gives 0: for
 * derivatives and keys, not for passes that rewrite primal code. */
typedef struct Builder {
    Fn *fn;
    Block *block;
    Inst *before; /* insert before this; NULL: at the end of block */
    Span span;    /* given to new instructions */
    bool fold;    /* fold constants and identities while building (x*1, x+(-0), select of constants ...) */
} Builder;

Fn *ir_fn(Session *s, Arena *arena, const char *name, Precision p);
Block *ir_block(Fn *fn, Inst *owner); /* empty; becomes the next free region of the owner, if it has one to fill */
Inst *ir_block_param(Fn *fn, Block *b, IrType t);
Inst *ir_emit(Builder *b, Op op, uint32_t nargs, Inst *const *args); /* value rows and detach; type from the table */
Inst *ir_emit1(Builder *b, Op op, Inst *a);
Inst *ir_emit2(Builder *b, Op op, Inst *a, Inst *c);
Inst *ir_emit3(Builder *b, Op op, Inst *a, Inst *c, Inst *d);
Inst *ir_special(Builder *b, Op op, IrType t, uint32_t nargs, Inst *const *args, Imm imm);
Inst *ir_constf(Builder *b, double v); /* rounded to the Fn's precision */
Inst *ir_consti(Builder *b, int32_t v);
Inst *ir_constb(Builder *b, bool v);
Inst *ir_zero(Builder *b, IrType t);
Inst *ir_input(Builder *b, InputSlot slot);
Inst *ir_select(Builder *b, Inst *cond, Inst *x, Inst *y); /* fsel, isel or bsel by type */
Inst *ir_if(Builder *b, Inst *cond);                       /* two empty regions; finish each with ir_yield */
Inst *ir_loop(Builder *b, uint32_t ncarried, Inst *const *init,
              LoopInfo info); /* region[0] has k and the carried parameters */
Inst *ir_yield(Builder *b, uint32_t n, Inst *const *values);
Inst *ir_proj(Builder *b, Inst *structured,
              uint32_t index); /* behind `structured`, or the one that is there; type from the yield */
/* A Builder at the end of a block (before its yield if it has one), before or behind an instruction. */
Builder ir_at_end(Fn *fn, Block *b);
Builder ir_before(Fn *fn, Inst *i);
Builder ir_after(Fn *fn, Inst *i);
static inline Inst *ir_yield_of(const Block *b) { return b->last; }
/* How many results a structured operation has: its yield's values, without the continue flag of loops. */
uint32_t ir_nresults(const Inst *i);
void ir_replace_arg(Inst *i, uint32_t index, Inst *value);
void ir_append_arg(Fn *fn, Inst *i, Inst *value);
void ir_unlink(Inst *i);
void ir_move_before(Inst *i, Inst *at); /* from wherever it stands */
uint32_t ir_number(Fn *fn);             /* dense ids in program order; returns the count */
bool ir_is_numbered(const Fn *fn);      /* ids are what ir_number would give */
Fn *ir_clone(const Fn *fn, Arena *arena, const char *name);
/* Clones instructions of a block to where the builder stands, with their regions, and enters each in `map`: [ninsts] of
 * the source Fn, by dense id. Operands without an entry are kept as they are (for cloning inside the same Fn). */
void ir_clone_insts(Builder *b, const Block *from, Inst *first, Inst *last_exclusive, Inst **map);
/* Replaces every use of the instructions with map[id] != NULL, in the whole Fn. */
void ir_replace_all(Fn *fn, Inst **map);
void ir_name_outputs(Fn *fn, SltRole role); /* gives all outputs this role, numbered from 0 */
bool ir_is_const(const Inst *i);
bool ir_has(const Block *b, Op op);                 /* in it or in a region below */
void ir_count_uses(const Block *b, uint32_t *uses); /* likewise; adds to uses[id] */
/* g == 0 ? 0 : zmul(x, g): a product that is 0 where either factor is, whatever the other. */
bool ir_is_guarded_twice(const Inst *i);
/* Pieces of a logarithm (logs.h), which lowering makes. */
static inline bool ir_is_log_part(Op op) { return op == OP_flogm || op == OP_flogh || op == OP_flogl; }
/* 32-bit mixing used for the region hash, the same in kernels (as IR) and in C. */
uint32_t ir_mix(uint32_t h, uint32_t v);
Inst *ir_mix_inst(Builder *b, Inst *h, Inst *v);
/* 32 random bits: number n of a stream (Philox2x32-7). rand is (bits >> 8) * 2^-24 in both precisions, except number 0,
 * which is input IN_RAND0. */
enum { IR_RAND_ROUNDS = 7 };
#define IR_RAND_MUL 0xd256d193u
#define IR_RAND_WEYL 0x9e3779b9u
uint32_t ir_rand_u32(uint32_t stream, uint32_t n);

/* ---- build_fold.c: the value of a row by identities and constants; may emit a cheaper row. NULL: there is none. */
Inst *ir_simplify(Builder *b, Op op, Inst *const *args);

/* ---- fold.c */
/* The value of a value row on constants (imm.f of floats, imm.i of the others), MATH rows by the C library. */
Imm ir_row(Op op, Precision p, const Imm args[3]);
/* The value of i, if its arguments are constants; false where it must not be folded (MATH rows: lower_math makes
 * foldable ones of them). */
bool ir_fold(const Inst *i, Precision p, Imm *out);

/* ---- print.c, parse.c: the text form; parse(print(fn)) is structurally equal. Parse errors become diagnostics. */
void ir_print(const Fn *fn, FILE *out);
char *ir_print_string(const Fn *fn, Arena *arena);
Fn *ir_parse(Session *s, Arena *arena, int file);

/* ---- verify.c: reports everything that is wrong, into *text; true if sound. */
bool ir_verify(const Fn *fn, Arena *arena, const char **text);
/* Verifies what we made ourselves. Broken: the whole report goes to standard error, and the session ends with an
 * internal error that names `when` ("lowering", "opt_fold") and the Fn. */
void ir_require(const Fn *fn, const char *when);

/* ---- interp.c: the oracle. Runs lanes in lockstep under masks, as the SPMD kernels do, in f32 or f64 (fn->precision),
 * W lanes at a time (W even where partner is used). Same arguments as a compiled kernel, except that adjoints always
 * have the FLAT layout (varying indices too, never the log), arrays need no padding beyond n, and tape_bytes is a limit
 * (0: 256 MiB) on memory that the call allocates itself. MATH rows that are still there use the C library; rand is
 * exact. Several threads may run the same Fn if its ids are dense (ir_number). lanes: a power of two up to 64. Returns
 * an SltStatus: SLT_LIMIT (tape, memory), SLT_USAGE (an array or a geometry that the Fn needs is NULL, bad lanes),
 * SLT_INTERNAL (broken IR). */
struct SltKernelArgs;
int ir_interpret(const Fn *fn, struct SltKernelArgs *args, uint32_t n, uint32_t lanes);
/* The same within *fuel instructions, each counted once a vector; leaves in *fuel what was not used, and returns
 * SLT_LIMIT when all was. SLT_LIMIT with fuel left: the system refused memory; with none: one of the Fn's own limits.
 */
int ir_interpret_within(const Fn *fn, struct SltKernelArgs *args, uint32_t n, uint32_t lanes, uint64_t *fuel);
/* The same; after each instruction `watch` sees the values so far, slot[id][lane], and which lanes are active. `first`
 * is the random number that SLT_IN_RAND0 holds, 0 in kernels; the others are those of the stream. */
typedef void IrWatch(void *user, const Inst *i, const void *const *slot, const uint8_t *on);
int ir_interpret_watched(const Fn *fn, struct SltKernelArgs *args, uint32_t n, uint32_t lanes, uint64_t *fuel,
                         uint32_t first, IrWatch *watch, void *user);
/* The same, for a Fn without parts that runs again and again: where its values lie is settled once, in the arena. NULL:
 * they take more than 64 MiB. One thread at a time. */
typedef struct Interp Interp;
Interp *ir_interp(Arena *arena, const Fn *fn, uint32_t lanes);
int ir_interp_run(Interp *in, struct SltKernelArgs *args, uint32_t n, uint64_t *fuel, uint32_t first, IrWatch *watch,
                  void *user);

#endif
