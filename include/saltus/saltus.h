/* libsaltus: shaders with discontinuous branches, compiled, and the derivatives of their integrals.
 *
 *     SltProgram *p;
 *     SltOptions opt = SLT_OPTIONS_INIT;
 *     if (slt_compile_file("circle.salt", &opt, &p) == SLT_OK) {
 *         SltJob job = SLT_JOB_INIT;
 *         job.size[0] = job.size[1] = 256, job.spp = 4;
 *         float *image = malloc(256 * 256 * slt_channels(p) * sizeof *image);
 *         slt_render(p, &job, image, NULL, &err);
 *     } else fputs(slt_diagnostics_text(p), stderr);
 *     slt_program_free(p);
 *
 * No global state, never exits or aborts. Different program objects may be used from different threads at once, and one
 * by one thread at a time: a call that finds its program in another call, be it of another thread or the one whose
 * callback it is made from, returns SLT_USAGE and does nothing. (Facts of the program and slt_floats may be read at any
 * time; what they point at may be changing.) Work inside a call is spread over job.threads threads, and callbacks come
 * from any of these. Everything returned by pointer belongs to the program and lives until it is freed, unless said
 * otherwise; what is given by pointer is copied or used during the call only. */
#ifndef SALTUS_H
#define SALTUS_H

#include <stddef.h>
#include <stdint.h>
#include <stdbool.h>

#include "saltus/job.h"
#include "saltus/status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct SltProgram SltProgram;

/* A name and a value, in lists. Has no size, and will have no more members. */
typedef struct SltSet {
    const char *name;  /* "N" or "module.N" */
    const char *value; /* a literal of the constant's type */
} SltSet;

/* What finds where a ray meets a heightfield. All give the same answers, bit for bit. */
typedef enum SltStructure {
    SLT_STRUCTURE_AUTO,   /* the maximum mipmap: docs/command.md has the measurement */
    SLT_STRUCTURE_MIPMAP, /* maxima of blocks of cells; follows changing heights in milliseconds */
    SLT_STRUCTURE_CONE,   /* safety shapes: slow to make, for heights that stay */
    SLT_STRUCTURE_NAIVE   /* cell by cell: the oracle */
} SltStructure;

/* Begins with its size, as job.h explains. Copied, with all that it points at. */
typedef struct SltOptions {
    size_t struct_size;
    const char *entry; /* NULL: main, or the only one */
    const SltSet *set; /* specialisation constants */
    uint32_t nset;
    const SltSet *param_files; /* values given as files, where they decide the size of an open array */
    uint32_t nparam_files;
    const char *const *import_dirs; /* searched behind the importing file's folder */
    uint32_t nimport_dirs;
    const char *stdlib_dir; /* NULL: $SALTUS_STDLIB, else where it was installed */
    bool f64, disc_auto;
    uint32_t seed;  /* of rand() in initialiser functions */
    uint32_t width; /* SIMD lanes; 0: chosen from program and target */
    bool interpret; /* run in the interpreter: slow, the oracle */
    bool no_cache;
    const char *target;              /* "native", "avx512", "avx2", "sse2"; NULL: $SALTUS_TARGET or native */
    int near_miss;                   /* -1: by the program's number of events; 0 off; 1 on */
    bool rgba8;                      /* the value kernel writes 8-bit pixels (slt_render_rgba8) */
    bool paper_argmin, paper_forced; /* the paper's branch index and two-sided variants, for comparison */
    bool path_hash;                  /* regions by the path taken, not by where the output came from */
    const char *dump;         /* [KERNEL:]PASS behind which the IR is printed to standard error; PASS may be "all" */
    bool verify;              /* verify the IR after every pass */
    SltStructure field;       /* of heightfields that are searched */
    const char *verify_after; /* [KERNEL:]PASS: verify behind this one only */
    const char *stop_after;   /* [KERNEL:]PASS: print the IR to standard output and stop compiling: SLT_STOPPED, here or
                                 from the call that first needs the kernel */
} SltOptions;
#define SLT_OPTIONS_INIT ((SltOptions){.struct_size = sizeof(SltOptions), .near_miss = -1})

/* ---- compiling. *out is set whatever the status (unless memory is out: then NULL), so that diagnostics can be read.
 * SLT_PROGRAM: see the diagnostics; SLT_INPUT: an asset or the file itself; SLT_USAGE: unknown entry, constant
 * or pass. */
SltStatus slt_compile_file(const char *path, const SltOptions *opt, SltProgram **out);
SltStatus slt_compile_string(const char *source, const char *shown_name, const SltOptions *opt, SltProgram **out);
/* p may be NULL. From a callback of a call that still uses the program this does nothing. */
void slt_program_free(SltProgram *p);
const char *slt_version(void);

typedef struct SltDiagnostic {
    size_t struct_size;
    int severity; /* 1 error, 2 warning, 3 information (LSP) */
    const char *code, *message, *file;
    uint32_t line, column; /* from 1; 0 where there is no place */
} SltDiagnostic;
#define SLT_DIAGNOSTIC_INIT ((SltDiagnostic){.struct_size = sizeof(SltDiagnostic)})
uint32_t slt_diagnostic_count(const SltProgram *p);
bool slt_diagnostic(const SltProgram *p, uint32_t index, SltDiagnostic *out);
/* As the command prints them; one LSP Diagnostic a line. Valid until asked for again. */
const char *slt_diagnostics_text(SltProgram *p);
const char *slt_diagnostics_json(SltProgram *p);
/* What went wrong when there is no diagnostic for it (limits, inputs). */
const char *slt_last_error(const SltProgram *p);

/* ---- what the program is */
uint32_t slt_dim(const SltProgram *p);
uint32_t slt_channels(const SltProgram *p);
const char *slt_entry(const SltProgram *p);
void slt_domain(const SltProgram *p, double lo[3], double hi[3]);
uint32_t slt_site_count(const SltProgram *p);
bool slt_uses_rand(const SltProgram *p);

/* ---- parameters. Floats are one vector of slt_float_count doubles, integers and bools one of int32. */
typedef enum SltKind { SLT_KIND_FLOAT, SLT_KIND_BOOL, SLT_KIND_INT, SLT_KIND_UINT, SLT_KIND_STRUCT } SltKind;
enum { SLT_MAX_RANK = 8 };

/* A parameter, or a part of one: an array of shape[rank] of numbers or structs, row by row, in the vector of floats
 * from fbase on and in that of integers from ibase on. float3 has the shape [3], Disc[200] [200], float2x2[5] [5, 2,
 * 2], a heightfield [rows, columns], a texture [rows, columns] or [rows, columns, channels], a float none (rank 0). */
typedef struct SltParam {
    size_t struct_size;
    const char *name; /* from slt_param_find: the string that was given */
    const char *type; /* as written: "Disc[200]" */
    uint32_t fbase, fcount, ibase, icount;
    bool differentiable, is_texture, is_heightfield;
    bool has_range, log, color;
    double lo, hi;
    const char *doc;
    uint32_t tex_w, tex_h, tex_c;
    SltKind kind;                       /* of what the array holds */
    uint32_t rank, shape[SLT_MAX_RANK]; /* the last takes in all dimensions beyond */
    uint32_t fstride, istride; /* from one element to the next: 1 and 0, or 0 and 1; of a struct: what it holds */
    uint32_t nfields;          /* of a struct, else 0 */
    const void *layout;        /* for slt_param_field */
    bool has_extent;           /* of a heightfield: [Extent], where it lies: x0, y0, x1, y1 */
    double extent[4];
    double height_scale, height_offset; /* of a heightfield: [Height], from raw heights to the shader's; else 1 and 0 */
} SltParam;
#define SLT_PARAM_INIT ((SltParam){.struct_size = sizeof(SltParam)})
uint32_t slt_param_count(const SltProgram *p);
bool slt_param(const SltProgram *p, uint32_t index, SltParam *out);
/* A field of the first struct in `of`; those of the structs after it are fstride and istride of `of` further on. */
bool slt_param_field(const SltParam *of, uint32_t index, SltParam *out);
/* A parameter or component by name ("discs[3].centre.x"); err names the nearest. */
SltStatus slt_param_find(const SltProgram *p, const char *name, SltParam *out, SltError *err);
uint32_t slt_float_count(const SltProgram *p);
uint32_t slt_int_count(const SltProgram *p);
const double *slt_floats(const SltProgram *p);
const int32_t *slt_ints(const SltProgram *p);
SltStatus slt_set_floats(SltProgram *p, uint32_t base, uint32_t count, const double *values, SltError *err);
SltStatus slt_set_ints(SltProgram *p, uint32_t base, uint32_t count, const int32_t *values, SltError *err);
/* "0.3", "[0.1, 0.2]", JSON of the parameter's shape, or "@file" (.csv .json .exr .npy .png ...). */
SltStatus slt_set_text(SltProgram *p, const char *name, const char *value, SltError *err);
/* All parameters as the JSON that `fit` writes, and back. The string is malloc'd. A texture or heightfield may also be
 * {"file": "dem.exr"}, relative to the folder in shown_name. */
char *slt_params_json(const SltProgram *p);
SltStatus slt_set_params_json(SltProgram *p, const char *text, const char *shown_name, SltError *err);

/* ---- which parameters are differentiated: NULL or 0 names: all that are differentiable. Names are parameters or
 * components. */
SltStatus slt_wrt(SltProgram *p, const char *const *names, uint32_t n, SltError *err);
const uint8_t *slt_wrt_mask(const SltProgram *p); /* per float: 1 where a gradient is wanted */

/* ---- print() of shaders: nothing is printed without it. line: the text with its values in place, without a newline,
 * valid during the call; at most 1023 characters. values: the n numbers alone. Called while an estimating function
 * samples the value of the shader, by any of its threads, several at once. print NULL: silent again. */
typedef void SltPrint(void *user, const char *line, const double *values, uint32_t n);
SltStatus slt_set_print(SltProgram *p, SltPrint *print, void *user, SltError *err);

/* ---- estimating: see job.h for the job and the results. job NULL: SLT_JOB_INIT. stats and err may be NULL. Kernels
 * are compiled on first need. */
SltStatus slt_render(SltProgram *p, const SltJob *job, float *image, SltStats *stats, SltError *err);
SltStatus slt_render_rgba8(SltProgram *p, const SltJob *job, uint32_t *pixels, SltStats *stats, SltError *err);
/* Derivative images in ndir directions of the float vector (each double[slt_float_count]). */
SltStatus slt_grad_images(SltProgram *p, const SltJob *job, uint32_t ndir, const double *const *dirs, float *const *out,
                          float *crossings, SltStats *stats, SltError *err);
/* Gradient of sum adjoint * image. */
SltStatus slt_grad_adjoint(SltProgram *p, const SltJob *job, const float *adjoint, double *gradient,
                           double *stderr_bound, SltStats *stats, SltError *err);
/* Loss mean mask*(I - T)^2 and its gradient. */
SltStatus slt_grad_loss(SltProgram *p, const SltJob *job, const float *target, const float *mask, double *loss,
                        double *gradient, double *stderr_bound, float *image, SltStats *stats, SltError *err);
/* The integral over the domain and its gradient, whether job.integral is set or not. */
SltStatus slt_grad_integral(SltProgram *p, const SltJob *job, SltIntegral *out, SltStats *stats, SltError *err);
/* f at n points: x[n][slt_dim], out[n][slt_channels]. The points are rounded to the precision of the program and may
 * lie anywhere: f is evaluated outside the domain as it is inside. rand() of a point depends on job.seed and on its
 * stream: streams[i], or i where streams is NULL, and on nothing else. To the shader the domain is one pixel, as in an
 * integral. Of the job only seed, threads, time_limit, cancel, progress, floats and ints count. */
SltStatus slt_eval(SltProgram *p, const SltJob *job, uint64_t n, const double *x, const uint32_t *streams, double *out,
                   SltStats *stats, SltError *err);
/* The first crossing on the segment from a to b. Of the job only floats and ints count. */
SltStatus slt_crossing(SltProgram *p, const SltJob *job, const double a[3], const double b[3], uint32_t stream,
                       SltCrossing *out, SltError *err);

#ifdef __cplusplus
}
#endif
#endif
