/* Inside of the back end: the emitter's state and the seams between its files. Nobody outside compiler/back includes
 * this.
 *
 * A value of the IR is P LLVM values, its parts: the W lanes of a varying value are cut into P vectors of L lanes that
 * fit one register, so LLVM sees only legal types and never has to split a mask; a uniform value is one scalar in part
 * 0. With W = 1 everything is a scalar. Masks are P parts of <L x i1>; the mask "all lanes" is NULL and costs nothing.
 */
#ifndef SALTUS_BACK_CPU_EMIT_H
#define SALTUS_BACK_CPU_EMIT_H

#include "compiler/back/back.h"
#include "compiler/back/cpu/llvm_api.h"

/* Flags that uniform.c leaves on instructions. */
enum { BACK_VARYING = 1, BACK_DIVERGES = 2 };

enum { BACK_MAX_WIDTH = 64, BACK_MAX_PARTS = 32, BACK_MAX_CULL = 64 };
#define BACK_MAX_FRAME (4u << 20) /* bytes of local arrays one kernel may keep on the stack */

/* ---- uniform.c */
/* How the frames of one tape signature lie in memory: offsets in bytes from the frame's start; filled by the emitter.
 */
typedef struct FrameClass {
    uint32_t n;
    uint8_t *types; /* IrType of each value */
    bool *varying;
    bool masked; /* a mask is stored with the frame */
    uint32_t *offset, mask_offset, bytes;
} FrameClass;
typedef Vec(FrameClass *) FrameTable;
FrameClass *back_frame_class(FrameTable *t, Arena *arena, uint32_t n, Inst *const *values);
/* Sets the flags and collects the layouts of the tape (scratch arena). */
void back_analyse_frames(Fn *fn, FrameTable *frames);
/* True if lanes that enter `outer` may be inactive in `inner`, a block inside it. */
bool back_diverges_between(const Block *inner, const Block *outer);

/* ---- the emitter's state, one per kernel */
typedef LLVMValueRef Part;

typedef struct CullSlot {
    Part items, count;
} CullSlot;

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
    uint32_t W, P, L; /* lanes, parts, lanes of a part: W = P * L */
    LLVMTypeRef t_void, t_i1, t_i8, t_i16, t_i32, t_i64, t_ptr, t_f32, t_f64, t_flt;
    Part args, n, i; /* the arguments and the first lane's sample index (i64) */
    Part in[IN_COUNT], out[SLT_OUT_MAX], params, iparams, dparams, adj, tape, tape_end, tape_top /* i64 in memory */;
    CullSlot cull[BACK_MAX_CULL];
    Part *mask; /* P parts, or NULL: all lanes */
    Part *val;  /* by id * P + part */
    FrameTable frames;
    uint64_t frame_bytes; /* of local arrays so far */
    uint32_t since_split; /* instructions since the current block began */
    uint32_t nsplits;
    unsigned md_invariant;
    bool sse2_only;    /* no roundps: floor and friends are spelled out */
    const char *error; /* set when the kernel cannot be compiled */
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
/* A constant of the same shape (scalar or vector) as `like`. */
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
/* mask & m for the current mask; the result may be m itself. */
void emit_and_mask(Emit *e, const Part *m, Part *out);
void emit_block(Emit *e, Block *b); /* instructions of a block without its yield */

/* ---- emit_ops.c: value rows */
void emit_value_op(Emit *e, Inst *i);

/* ---- emit_memory.c: parameters, arrays, adjoints, tape, effects */
void emit_memory_op(Emit *e, Inst *i);
bool emit_pairs_apart(Emit *e, Inst *i); /* a band that asks for pairs that disagree: emitted as one, if it is one */
void emit_revloop(Emit *e, Inst *i);
void emit_layout_frames(Emit *e);
/* Stores the outputs of the top yield. */
void emit_outputs(Emit *e, const Inst *yield);

/* ---- codegen.c: LLVM module -> text, object or assembly. All errors in *why (malloc-free: scratch arena). */
typedef struct Codegen {
    unsigned char *bytes; /* malloc'd; NULL on error */
    size_t size;
    double emit_ms, llvm_ms;
    uint32_t *instructions; /* scratch arena: LLVM instructions of each kernel after optimisation */
} Codegen;
int back_codegen(Session *s, const KernelRequest *k, uint32_t n, const BackOptions *o, uint32_t width, char kind,
                 Codegen *out, const char **why);

/* ---- load.c: a small loader for ELF64 x86-64 relocatable objects */
typedef struct Loaded Loaded;
/* Maps the object's sections, resolves relocations (externals: fma, fmaf, memcpy, memmove, memset only) and makes the
 * code executable. Never trusts a field of the object: a bad one gives NULL and a text. */
Loaded *load_object(const unsigned char *bytes, size_t size, const char **why);
void *load_symbol(const Loaded *l, const char *name, uint64_t *size);
void load_free(Loaded *l);

/* ---- cache.c: the disk cache of objects */
typedef struct CacheKey {
    uint64_t hi, lo; /* XXH3-128 of everything that decides the code */
    size_t len;      /* how much that was: a second opinion */
} CacheKey;
/* NULL if there is no usable private folder; arena string otherwise. */
const char *cache_folder(Arena *arena, const char *wanted);
/* The cached payload (malloc'd), or NULL. */
unsigned char *cache_read(Arena *arena, const char *folder, const CacheKey *key, size_t *size);
bool cache_write(Arena *arena, const char *folder, const CacheKey *key, const unsigned char *bytes, size_t size);

#endif
