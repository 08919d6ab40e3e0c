/* What is known and decided of a kernel before an emitter writes an instruction, whatever the target: which values are
 * the same in all lanes, how lanes are cut into registers, how an if_ is run, how frames of the tape lie, and the cache
 * of what was emitted. This folder needs no LLVM, and knows of a target only what its Target says.
 *
 * Plans lie in the session's scratch arena; the flags stay on the instructions until the next analysis of the function.
 */
#ifndef SALTUS_BACK_CORE_CORE_H
#define SALTUS_BACK_CORE_CORE_H

#include "compiler/back/back.h"

/* Flags that the analysis leaves on instructions. */
enum {
    BACK_VARYING = 1,  /* the value differs between lanes */
    BACK_DIVERGES = 2, /* lanes part at this if_ or loop */
    BACK_READ = 4      /* something reads the value: a result that nothing does need not be blended */
};

enum { BACK_MAX_WIDTH = 64, BACK_MAX_PARTS = 32, BACK_MAX_CULL = 64 };
#define BACK_MAX_FRAME (4u << 20) /* bytes of local arrays one kernel may keep on the stack */

/* How the frames of one tape signature lie in memory: offsets in bytes from the frame's start. */
typedef struct FrameClass {
    uint32_t n;                           /* values */
    uint8_t *types;                       /* [n] IrType */
    bool *varying;                        /* [n] one element a lane */
    bool masked;                          /* a mask is stored with the frame */
    uint32_t *offset, mask_offset, bytes; /* of each value; of the mask; of the whole frame */
} FrameClass;
typedef Vec(FrameClass *) FrameTable;

/* A kernel at one width on one target. A varying value is W lanes in P parts of L lanes, each of which fits a register:
 * W = P * L. With W = 1 everything is a scalar. */
typedef struct Plan {
    uint32_t W, P, L;
    uint32_t flt_bytes; /* of a float in this kernel's precision */
    bool has_fma;
    FrameTable frames;
} Plan;

/* ---- uniform.c: which values are the same in all lanes, and where lanes part */
/* Sets the flags and collects the signatures of the tape's frames, not yet laid out (scratch arena). */
void back_analyse_frames(Fn *fn, FrameTable *frames);
/* True if lanes that enter `outer` may be inactive in `inner`, a block inside it. */
bool back_diverges_between(const Block *inner, const Block *outer);

/* ---- frames.c: the tape */
/* The class of the signature of these values; a new one if the table has none. */
FrameClass *back_frame_class(FrameTable *t, Arena *arena, uint32_t n, Inst *const *values);
void back_layout_frames(Plan *plan);
unsigned back_type_bytes(const Plan *plan, uint8_t type); /* of one lane in memory; a boolean takes 4 */
uint32_t back_bits_bytes(const Plan *plan);               /* of a stored mask: whole bytes a part */

/* ---- zeros.c */
/* May an element of this alloc be read before it is stored? */
bool back_needs_zeros(const Inst *array);

/* ---- plan.c: lanes, parts and regions */
/* Analyses `fn` and lays out its frames. A kernel that compares neighbouring lanes has a width of 2 at least. */
Plan back_plan(Fn *fn, const Target *target, uint32_t width);
/* SLT_OK, or SLT_USAGE with a text (session arena). */
int back_check_width(Session *s, uint32_t width, const char **why);
uint32_t back_register_lanes(const Target *t, Precision p); /* of a register of floats */
/* Lanes of kernel j, if the options leave them open: enough independent work to hide latency, bounded by registers.
 * Deterministic. */
uint32_t back_choose_width(const KernelRequest *k, uint32_t j, const BackOptions *o);
/* Does this value take one element a lane? False where all lanes share it, and at width 1. */
bool back_is_vector(const Plan *plan, const Inst *i);
uint32_t back_value_parts(const Plan *plan, const Inst *i); /* P or 1 */

/* Of a vector, in vector instructions. */
enum {
    BACK_GATHER_COST = 8,       /* a read whose lanes may want different places */
    BACK_LIBRARY_FMA_COST = 100 /* a fused product without hardware for it */
};

bool back_lacks_rounding(const Target *t); /* to floor, ceil, trunc, round takes several instructions */

/* How an if_ is run. */
typedef enum IfForm {
    IF_PICK,      /* the condition is uniform, the regions cheap: both run, a scalar condition selects */
    IF_JUMP,      /* the condition is uniform: a branch */
    IF_BLEND,     /* both run for every lane, and lanes select */
    IF_THEN_ONLY, /* under a mask if some lane wants it; the other side computes nothing */
    IF_ELSE_ONLY,
    IF_BOTH, /* each side under its mask, if some lane wants it */
} IfForm;
IfForm back_if_form(const Plan *plan, const Inst *i);
bool back_is_empty(const Block *b);        /* constants at most */
uint32_t back_count_insts(const Block *b); /* with those of all regions; what takes several counts so */

/* Is v, the next value of carried parameter c, still c in lanes that have left the loop? */
bool back_keeps_itself(const Plan *plan, const Inst *v, const Inst *c);

/* ---- key.c: the name of what an emitter makes of these kernels */
/* `emitter` names the emitter and the version of what it relies on. False: the build of this library cannot be told, so
 * nothing may be kept. */
bool cache_key(Session *s, const KernelRequest *k, uint32_t n, const BackOptions *o, const char *emitter,
               CacheKey *out);

/* ---- cache.c: the disk cache */
typedef enum CacheKind { CACHE_OBJECTS, CACHE_FACTS } CacheKind;
/* `wanted` (BackOptions.cache_dir) or the default as an arena string; NULL if the folder is not private or usable. */
const char *cache_folder(Arena *arena, const char *wanted);
/* Was the file `source` saved after the last entry was written, or is there no folder? The folder's time is now, then.
 */
bool cache_is_behind(const char *wanted, const char *source);
/* The cached payload (malloc'd, the caller's), or NULL. */
unsigned char *cache_read(Arena *arena, const char *folder, CacheKind kind, const CacheKey *key, size_t *size);
bool cache_write(Arena *arena, const char *folder, CacheKind kind, const CacheKey *key, const unsigned char *bytes,
                 size_t size);

#endif
