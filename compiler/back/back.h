/* The back end: SPMD emission of kernels through LLVM.
 *
 * One Fn becomes `void name(SltKernelArgs *, uint32_t n)`: W samples side by side, lanes = consecutive samples, values
 * that are the same in all lanes kept scalar. LLVM is given no fast-math flag. Compilation is a pure function of IR and
 * options; with the build of this library and LLVM's version they are the cache key. */
#ifndef SALTUS_BACK_BACK_H
#define SALTUS_BACK_BACK_H

#include "compiler/ir/ir.h"
#include "saltus/kernel.h"

typedef enum AdjLayout { ADJ_LANES, ADJ_FLAT } AdjLayout; /* of SltKernelArgs.adj, which explains both */

typedef struct Target {
    char cpu[64];          /* "native" is resolved by target_host */
    char features[1024];   /* LLVM feature string; "" for the CPU's own */
    uint32_t vector_bytes; /* 16, 32, 64 */
    bool has_fma;
    bool slow_divider; /* a root or a quotient of 64 bytes takes as long as two of 32, a sum or a product as one */
} Target;
/* The processor that runs this; SALTUS_TARGET=sse2|avx2|avx512 in the environment narrows it (for tests). */
void target_host(Target *t);
bool target_named(Target *t, const char *name);        /* "sse2", "avx2", "avx512", "native" (SALTUS_TARGET or not) */
bool target_runs(const Target *t, const Target *here); /* do t's kernels run on a processor that is `here`? */

/* What the value kernel writes: its floats, or all channels as packed 8-bit pixels in out[0] (uint32_t), as they are or
 * through the curve of sRGB. */
/* The polynomial of pixels' curve, in the square root: emit_pixels.c. */
enum { BACK_SRGB_TERMS = 7 };
extern const double BACK_SRGB[BACK_SRGB_TERMS];
typedef enum BackPixels { BACK_FLOATS, BACK_PIXELS_RAW, BACK_PIXELS_SRGB } BackPixels;

typedef struct BackOptions {
    Target target;
    uint32_t width; /* lanes; 0: chosen kernel by kernel, from the program and the target */
    uint32_t lanes; /* of these kernels, while rows of adjoints are those of `width`; 0: as that says */
    uint64_t few; /* bit by kernel: it is called for few samples at a time, and takes one vector a value; not where the
                     width is given */
    uint64_t plain; /* bit by kernel: compiled at level 0, since it is long and seldom run */
    AdjLayout adj;
    bool no_cache;
    const char *cache_dir; /* NULL: $XDG_CACHE_HOME/saltus or ~/.cache/saltus */
    unsigned opt_level;    /* 0..3, default 2 */
    BackPixels pixels;
    uint32_t threads; /* to compile with; 0: one a core. The code is the same */
} BackOptions;

typedef struct KernelRequest {
    const char *name; /* symbol */
    Fn *fn;
} KernelRequest;

/* Of an entry of the cache. */
typedef struct CacheKey {
    uint64_t hi, lo; /* XXH3-128 of everything that decides what is in it */
    size_t len;      /* bytes hashed, compared as well; 0: no entry */
} CacheKey;

/* Why a kernel has the lanes that it has. */
typedef enum WidthWhy {
    WIDTH_GIVEN,      /* BackOptions.width says so */
    WIDTH_FEW,        /* BackOptions.few: a call has few samples */
    WIDTH_MOST_CODE,  /* it has `found` operations, above `limit` */
    WIDTH_MUCH_CODE,  /* likewise */
    WIDTH_STRAIGHT,   /* it has no loop */
    WIDTH_NEIGHBOURS, /* it compares neighbouring lanes */
    WIDTH_LONG_LOOP,  /* a loop of `found` operations, above `limit` */
    WIDTH_MUCH_KEPT,  /* a loop that keeps `found` values, above `limit`, from iteration to iteration */
    WIDTH_MANY_MASKS, /* a loop whose lanes have `found` masks if there are four vectors, above `limit` */
    WIDTH_IMAGE,      /* it has no such loop, nor a short one, and is of images: of all samples of a tile at once */
    WIDTH_CHAIN,      /* likewise, and a loop's iterations wait for `found` quotients and roots in a row */
    WIDTH_SHORT_LOOP  /* no such loop, and there is one: all of them keep `found` values at most, up to `limit` */
} WidthWhy;
typedef struct WidthChoice {
    uint32_t lanes, vectors; /* vectors a value; 0 of a given width */
    WidthWhy why;
    uint32_t found, limit;
} WidthChoice;
/* Of kernel j: its lanes, and why it has them. */
WidthChoice back_width_choice(const KernelRequest *k, uint32_t j, const BackOptions *o);

/* dense[nfloats]: sets 1 for each element of the float vector whose adjoint a reverse kernel (all its parts) adds in
 * place; the adjoints of those read only at varying indices go to the log. Are there any? */
bool back_dense_adjoints(Fn *fn, uint8_t *dense);

/* Sets Fn.same to what pixels of a row share, or to nothing if pixels of a square had better be side by side: where
 * lanes part at branches, or search along rays, those of a square more often want the same. Rows are worth it where
 * they save more vector instructions than branches go around. */
void back_share_row(Fn *fn, const Target *target, uint32_t width);

typedef struct CompiledModule CompiledModule;
/* How many sums a parameter SltKernelArgs.adj has. Of ADJ_LANES as many as fill a cache line, or the width if it is
 * less. */
uint32_t back_adjoint_lanes(const BackOptions *o, Precision p);
/* JIT (or from the disk cache, without loading LLVM where the build allows it). Returns an SltStatus; text in `why`
 * (arena of the session). */
int back_compile(Session *s, const KernelRequest *k, uint32_t n, const BackOptions *o, CompiledModule **out,
                 const char **why);
/* The same of several modules, which the cache keeps apart: what it lacks is compiled together, so that no thread waits
 * between them. All have their `out`, or none has. The target and the number of threads are the first one's. */
enum { BACK_MAX_JOBS = 2 };
typedef struct BackJob {
    const KernelRequest *k;
    uint32_t n;
    BackOptions o;
    CompiledModule *out;
} BackJob;
int back_compile_all(Session *s, BackJob *jobs, uint32_t n, const char **why);
/* ---- what else the cache keeps, of which objects follow, so that a process that finds it need not make their IR */
/* The key of what this build makes of so much text and the meaning of `primal`. False: the build cannot be told. */
bool back_facts_key(const void *text, size_t size, const Fn *primal, CacheKey *out);
/* What was kept (malloc'd, the caller's); NULL: nothing, or o says no_cache. */
unsigned char *back_recall(Session *s, const BackOptions *o, const CacheKey *key, size_t *size);
void back_keep(Session *s, const BackOptions *o, const CacheKey *key, const void *bytes, size_t size);
/* Where the cache has the objects of a module; .len 0: nowhere. */
CacheKey back_key(const CompiledModule *m);
/* The module of this key, of n kernels of so many lanes; NULL: it is not there any more. */
CompiledModule *back_find(Session *s, const BackOptions *o, const CacheKey *key, uint32_t n, const char *const *names,
                          const uint32_t *lanes);

SltKernel *back_kernel(const CompiledModule *m, const char *name);
uint32_t back_width(const CompiledModule *m, const char *name);         /* of a kernel, in lanes; 0: there is none */
uint32_t back_instructions(const CompiledModule *m, const char *name);  /* of LLVM IR, after optimisation */
uint32_t back_machine_bytes(const CompiledModule *m, const char *name); /* of all its parts */
void back_times(const CompiledModule *m, double *emit_ms, double *llvm_ms, bool *cached);
void back_free(CompiledModule *m);
/* Ahead of time, the bytes of a file: kind 'o' object, 's' assembly, 'a' assembly in which LLVM notes what it spills,
 * 'l' LLVM IR text. They are malloc'd. Returns an
 * SltStatus. */
int back_emit(Session *s, const KernelRequest *k, uint32_t n, const BackOptions *o, char kind, unsigned char **bytes,
              size_t *size, const char **why);
const char *back_llvm_version(void); /* of the headers; another major version at run time is refused */
const char *back_llvm_file(void);    /* the library tried first, or the name the loader is asked for; loads nothing */
/* Loads LLVM on a thread of its own, once a process, if kernels of this source file will probably be compiled: parsing
 * and passes run meanwhile. With the cache that is where the file was saved after the last entry was; the first who
 * asks makes the folder as new as an entry would, since not every change of a file is one of its kernels. NULL: of no
 * file. What goes wrong with LLVM is said by whoever compiles. For one thread, the
 * one that then calls back_open_end before it calls exit or returns from main: the library's constructors must not run
 * beside its destructors. */
void back_open_early(const char *source, bool no_cache);
void back_open_end(void);
bool back_opens_llvm(void); /* this thread loads LLVM: what aborts now has no memory */

#endif
