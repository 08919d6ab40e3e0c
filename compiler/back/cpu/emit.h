/* The insides of the emitter for x86-64: its state and the seams between its files. Nobody outside compiler/back/cpu
 * includes this.
 *
 * A value of the IR is P LLVM values, its parts: the W lanes of a varying value are cut into P vectors of L lanes that
 * fit one register, so LLVM sees only legal types and never has to split a mask; a uniform value is one scalar in part
 * 0. With W = 1 everything is a scalar. Masks are P parts of <L x i1>; the mask "all lanes" is NULL and costs nothing.
 */
#ifndef SALTUS_BACK_CPU_EMIT_H
#define SALTUS_BACK_CPU_EMIT_H

#include "compiler/back/core/core.h"
#include "compiler/back/cpu/llvm_api.h"

/* ---- the emitter's state, one per kernel */
typedef LLVMValueRef Part;

typedef struct CullSlot {
    Part items, count;
    Part place; /* of the iteration that is being emitted: in the list if there is one, else its number */
    Part notes; /* address of the notes; NULL: the kernel makes none */
    Part noted; /* i64: all ones where notes are wanted, else 0, and `notes` are scratch */
} CullSlot;

typedef struct ChunkState ChunkState;

typedef struct Emit {
    const LlvmApi *ll;
    const BackOptions *opt;
    Session *session;
    Arena *arena; /* scratch */
    Fn *fn;
    LLVMContextRef ctx;
    LLVMModuleRef mod;
    LLVMBuilderRef b;
    LLVMValueRef func;
    LLVMBasicBlockRef entry, exit;
    Plan plan;
    uint32_t W, P, L; /* the plan's: lanes, parts, lanes of a part */
    LLVMTypeRef t_void, t_i1, t_i8, t_i16, t_i32, t_i64, t_ptr, t_f32, t_f64, t_flt;
    Part args, n, i; /* the arguments and the first lane's sample index (i64) */
    Part in[SLT_INPUTS], out[SLT_OUT_MAX], params, iparams, dparams, adj, tape, tape_end, tape_top /* i64 in memory */;
    Part told;  /* a pointer in memory: what queries have found */
    Part lanes; /* in memory, one part of integers; NULL: not wanted yet */
    CullSlot cull[BACK_MAX_CULL];
    Part *mask; /* P parts, or NULL: all lanes */
    struct {
        const Inst *root; /* the integer whose runs these are, in `block`; NULL: none are known */
        const Block *block;
        Part like[BACK_MAX_PARTS][6], end[BACK_MAX_PARTS];
    } runs;               /* lanes side by side whose adjoints go to one place: emit_param.c */
    bool spread;          /* lanes are not those of samples, but of what emit_spread has listed */
    Part *val;            /* by id * P + part */
    uint32_t *uses;       /* by id; NULL: nobody has asked */
    bool *by_steps;       /* by id: a root that the divider does not take; NULL: there is none */
    bool *hidden;         /* by id: an integer on which nothing hangs where its argument is NaN; NULL: there is none */
    ChunkState *chunks;   /* of a straight-line program in chunks; NULL: it is not */
    uint64_t frame_bytes; /* of local arrays so far */
    uint32_t since_split; /* instructions since the current block began */
    uint32_t nsplits;
    unsigned md_invariant; /* LLVM's number of "invariant.load" */
    bool sse2_only;        /* no roundps: floor and friends are spelled out */
    const char *error;     /* set when the kernel cannot be compiled */
} Emit;

#define LL(name) (e->ll->name)

/* ---- emit.c */
/* Emits one kernel into the module. Returns an error text (scratch arena) or NULL. */
const char *back_emit_kernel(const LlvmApi *ll, LLVMContextRef ctx, LLVMModuleRef mod, const KernelRequest *k,
                             const BackOptions *o, uint32_t width);
void emit_fail(Emit *e, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
bool emit_is_vector(const Emit *e, const Inst *i);
LLVMTypeRef emit_scalar_type(Emit *e, IrType t);
LLVMTypeRef emit_vector_type(Emit *e, LLVMTypeRef scalar); /* of one part; the scalar itself at W = 1 */
Part *emit_slot(Emit *e, const Inst *i);                   /* the parts of i, to be filled */
Part emit_scalar(Emit *e, const Inst *i);                  /* a uniform value */
/* All P parts of a value as vectors, splatting uniform ones; `out` has room for P. */
void emit_parts(Emit *e, const Inst *i, Part *out);
Part emit_splat(Emit *e, Part scalar);
Part emit_int(Emit *e, LLVMTypeRef t, uint64_t v);
/* A constant of type `shape`, which is `scalar` or a vector of it: f if is_float, else i. */
Part emit_const_like(Emit *e, LLVMTypeRef shape, LLVMTypeRef scalar, double f, uint64_t i, bool is_float);
Part emit_intrinsic(Emit *e, const char *name, LLVMTypeRef overload, Part *args, unsigned n);
Part emit_field_ptr(Emit *e, size_t offset);
Part emit_load(Emit *e, LLVMTypeRef t, Part ptr, unsigned align, bool invariant);
void emit_store(Emit *e, Part value, Part ptr, unsigned align);
Part emit_gep(Emit *e, LLVMTypeRef elem, Part base, Part index);
Part emit_alloca(Emit *e, LLVMTypeRef t, uint64_t count, unsigned align); /* in the entry block */
LLVMBasicBlockRef emit_new_block(Emit *e, const char *name);
void emit_at(Emit *e, LLVMBasicBlockRef bb);
LLVMBasicBlockRef emit_here(Emit *e);
Part emit_phi(Emit *e, LLVMTypeRef t, const char *name);
void emit_incoming(Emit *e, Part phi, Part v, LLVMBasicBlockRef from);
Part emit_any(Emit *e, const Part *mask); /* i1: some lane is on */
const uint32_t *emit_uses(Emit *e);       /* how often each value is read, by id */
/* mask & m for the current mask; the result may be m itself. */
void emit_and_mask(Emit *e, const Part *m, Part *out);
void emit_block(Emit *e, Block *b); /* instructions of a block without its yield */
void emit_range(Emit *e, Inst *from,
                const Inst *end);              /* those of a block from `from` to before `end`, NULL: to its end */
void emit_outputs(Emit *e, const Inst *yield); /* stores the outputs of the top yield */

/* ---- emit_ops.c: value rows */
void emit_value_op(Emit *e, Inst *i);
/* Has the processor an instruction that makes integers of a part's floats? Then emit_converted uses it: 2^31
 * (unsigned: all ones) where the integer does not fit or is that of a NaN, 0 in lanes out of `keep` (NULL: none). Else
 * it gives NULL, also of unsigned ones where only signed ones are converted. */
bool emit_converts(const Emit *e);
Part emit_converted(Emit *e, Part a, Part keep, bool is_signed);
void emit_value_run(Emit *e, Inst *const *run, uint32_t n); /* varying values, none of which is emitted yet */
/* A run that is being emitted: the operands that all lanes share are there. */
typedef struct EmitRun {
    Inst *const *at;
    uint32_t n;
    Part (*same)[3];    /* operands that all parts share */
    const Inst **first; /* operand 0, where it is another's */
} EmitRun;
void emit_run_part(Emit *e, const EmitRun *run, uint32_t k, uint32_t p); /* value k, part p, behind those it reads */

/* ---- emit_lookup.c: what hangs on an integer that hardly differs between lanes, looked up */
bool emit_looks_up(Emit *e, Inst *const *run, uint32_t n); /* is anything in it? */
bool emit_lookup(Emit *e, const EmitRun *run);             /* false: nothing is, and the run is not emitted */

/* ---- emit_newton.c: roots by Newton's steps, where the divider would be waited for */
void emit_choose_roots(Emit *e, const Block *body); /* of a loop: which of them, into by_steps */
Part emit_root_by_steps(Emit *e, Part v);           /* one part, of 64 bytes; every bit is that of the root */

/* ---- emit_nan.c */
void emit_find_hidden(Emit *e); /* integers whose NaN nobody can tell, into hidden */

/* ---- emit_quotient.c: quotients by constants, as two products; every bit is that of the quotient */
bool emit_divides_by_products(const Emit *e, const Inst *i, float inverse[2]);
Part emit_quotient_by_products(Emit *e, Part a, const float inverse[2]);

/* ---- emit_memory.c: sizes, addresses and lanes for the files below, and which of them emits an operation */
void emit_memory_op(Emit *e, Inst *i);
unsigned emit_part_align(const Emit *e, unsigned element); /* of one part whose elements have so many bytes; <= 64 */
Part emit_i64(Emit *e, uint64_t v);
Part emit_at_byte(Emit *e, Part base, uint64_t offset);
Part emit_all_on(Emit *e); /* the mask of one part, all lanes on */
Part emit_gather(Emit *e, LLVMTypeRef scalar, Part pointers, unsigned align);
void emit_scatter(Emit *e, Part value, Part pointers, unsigned align, Part mask); /* mask NULL: all lanes */
/* `index` clamped to [0, count - 1], as cheaply as its range allows; v: one part of its value. */
Part emit_clamped_index(Emit *e, const Inst *index, Part v, uint32_t count);
Part emit_scalar_index(Emit *e, const Inst *index, uint32_t count); /* a uniform index, clamped, as i64 */
/* The executing lanes of part p whose sample the caller asked for, further narrowed by `cond` (may be NULL). */
Part emit_counting_lanes(Emit *e, uint32_t p, Part cond);

/* ---- emit_param.c: parameters, and their adjoints */
void emit_param(Emit *e, Inst *i);
void emit_adjoint(Emit *e, Inst *i);
Part emit_compressed(Emit *e, Part v, Part mask); /* the lanes that are on, in front: one instruction of AVX-512 */

/* ---- emit_rows.c: reads that lie side by side */
/* Reads i and those behind it that lie beside it, from base[index + place] on, index in numbers; false: it is alone. Of
 * what is behind the index, `readable` numbers can be read. */
bool emit_beside(Emit *e, Inst *i, Part base, const Part *index, uint64_t readable);

/* ---- emit_spread.c: a loop over items of all lanes, one over frames; false: the loop is another */
bool emit_spread(Emit *e, Inst *loop);
bool emit_spread_frames(Emit *e, Inst *loop);

/* ---- emit_root.c: a root that is only compared with a number that lanes share */
/* What is under the root, and the bound that it is below instead; NULL: i is no such comparison. */
const Inst *emit_compared_root(Emit *e, const Inst *i, Part *bound);

/* ---- emit_array.c: local arrays */
void emit_alloc(Emit *e, Inst *i);
void emit_array_load(Emit *e, Inst *i);
void emit_array_store(Emit *e, Inst *i);
void emit_array_copy(Emit *e, Inst *i);

/* ---- emit_tape.c: frames of reverse mode */
void emit_tapepush(Emit *e, Inst *i);
void emit_revloop(Emit *e, Inst *i);
void emit_load_bits(Emit *e, Part *bits, Part at); /* a mask of a frame */

/* ---- emit_pixels.c: 8-bit pixels */
bool emit_packs_pixels(const Emit *e, const Inst *yield); /* BackOptions.pixels, and the outputs are f alone */
void emit_pixels(Emit *e, const Inst *yield);

/* ---- emit_pair.c: pairs of lanes */
void emit_partner(Emit *e, const Part *in, Part *out);
void emit_both(Emit *e, Inst *i);
bool emit_pairs_apart(Emit *e, Inst *i); /* band of "lanes differ" and `both` as one operation; false: i is another */

/* ---- emit_chunks.c: straight-line programs in chunks */
void emit_chunks_setup(Emit *e);         /* once a kernel, in its setup */
Inst *emit_chunks(Emit *e, Inst *first); /* a run of them; returns its last instruction */
void emit_give(Emit *e, const Inst *i);
void emit_take(Emit *e, Inst *i);
void emit_settled(Emit *e, Inst *i);
void emit_choice(Emit *e, const Inst *i);

/* ---- emit_effect.c: counters, notes and print */
void emit_count(Emit *e, Inst *i);
void emit_note(Emit *e, Inst *i);
void emit_item(Emit *e, Inst *i); /* item, items */
void emit_print(Emit *e, Inst *i);

/* ---- emit_query.c: searches along rays */
void emit_query(Emit *e, Inst *i);
void emit_told(Emit *e, Inst *i);
void emit_setup_told(Emit *e, const Inst *i); /* where the kernel begins, for the first of them */

/* ---- masks.c: vectors of i1 that travel, as vectors of integers; false: memory is out */
bool masks_widen(const LlvmApi *ll, LLVMContextRef ctx, LLVMValueRef f, uint32_t vector_bytes);

/* ---- codegen.c: kernels that are one LLVM module, from IR to text, object or assembly. Kinds as for back_emit. */
/* What LLVM knows of the processor: of one thread and by level, made when it is wanted, for all units of the thread. */
enum { MACHINE_LEVELS = 4 };
typedef struct Machines {
    LLVMTargetMachineRef of[MACHINE_LEVELS];
} Machines;
void machines_init(const LlvmApi *ll); /* before the first, on one thread */
void machines_dispose(const LlvmApi *ll, Machines *m);

typedef struct CodeUnit {
    const LlvmApi *ll;
    KernelRequest *k; /* [n], as are `width`, in lanes, and `instructions`; not read after unit_emit, like o */
    uint32_t n, *width;
    const BackOptions *o;
    const Target *target; /* of o; outlives the caller */
    unsigned opt_level;
    char kind;
    Session *session; /* whose protection is in force, and which has the text of an error */
    LLVMContextRef ctx;
    LLVMModuleRef mod;
    LLVMTargetDataRef layout;
    struct UnitFunction {
        LLVMValueRef f;
        uint32_t kernel;
    } *functions; /* of kernels and their parts */
    uint32_t nfunctions;
    uint32_t *instructions; /* of LLVM, by kernel, after optimisation */
    unsigned char *bytes;   /* malloc'd; NULL on error */
    size_t size;
    int status;
    const char *why;
} CodeUnit;
bool unit_init(CodeUnit *u, uint32_t n, uint32_t nfunctions);
/* Kernels to LLVM's IR; under guard_begin, as the next two. */
void unit_emit(Session *s, CodeUnit *u, Machines *m);
/* Passes and bytes: reads nothing that the caller of back_compile owns. */
void unit_write(Session *s, CodeUnit *u, Machines *m);
void unit_dispose(CodeUnit *u); /* what LLVM holds */
void unit_free(CodeUnit *u);    /* the rest */

/* ---- units.c: kernels shared out to modules, which several threads compile */
typedef struct CodeObject {
    unsigned char *bytes; /* malloc'd */
    size_t size;
} CodeObject;
typedef struct Codegen {
    CodeObject *object; /* [n]; session arena, as the next is */
    uint32_t n;
    uint32_t *instructions; /* of LLVM, by kernel of the request, after optimisation */
    double emit_ms, llvm_ms;
} Codegen;
typedef struct CodegenJob {
    const KernelRequest *k;
    uint32_t n;
    const BackOptions *o;
    Codegen out;
} CodegenJob;
/* Each job is one unit where it is to be the `whole`, else as many as its kernels are worth, whatever the number of
 * threads, which is the first job's. An SltStatus, with a text in *why (session arena); each `out` is to be freed after
 * SLT_OK. Runs under session_protect, or where a spent budget may end the process. */
int back_codegen(Session *s, CodegenJob *jobs, uint32_t njobs, char kind, bool whole, const char **why);
void back_codegen_free(Codegen *g);

/* ---- load.c: a small loader for ELF64 x86-64 relocatable objects */
typedef struct Loaded Loaded;
/* Maps the object's sections, resolves relocations (externals: fma, fmaf, memcpy, memmove, memset only) and makes the
 * code executable. Never trusts a field of the object: a bad one gives NULL and a text. */
Loaded *load_object(const unsigned char *bytes, size_t size, const char **why);
void *load_symbol(const Loaded *l, const char *name, uint64_t *size);
void load_free(Loaded *l);

#endif
