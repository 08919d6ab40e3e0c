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
 * The library has no global state and never exits or aborts. Different program objects may be used by different threads
 * at once; one object serves one call at a time: a call that finds its program in another call, of another thread or of
 * the call whose callback makes it, does nothing and returns SLT_USAGE (NULL, 0, false or "" where it has no status).
 * Facts of the program and slt_floats may be read at any time; the numbers that slt_floats points at may be changing.
 * Work inside a call is spread over job.threads threads; callbacks come from any of these.
 *
 * What a function returns by pointer belongs to the program and lives until slt_program_free, unless said otherwise.
 * What the caller passes by pointer is copied or used during the call only.
 *
 * An image is float[height][width][channels], top row first; a volume float[depth][height][width][channels]. */
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

/* A name and a value. This struct has no size member and will never change. */
typedef struct SltSet {
    const char *name;  /* of a constant ("N" or "module.N") or of a parameter */
    const char *value; /* of a constant, a literal of its type; of a parameter, what slt_set_text takes, or a file */
} SltSet;

/* What finds where a ray meets a heightfield. All structures give the same answers, bit for bit. */
typedef enum SltStructure {
    SLT_STRUCTURE_AUTO,   /* the same as MIPMAP: docs/command.md has the measurement */
    SLT_STRUCTURE_MIPMAP, /* maxima of blocks of cells; follows changing heights in milliseconds */
    SLT_STRUCTURE_CONE,   /* safety shapes: slow to make, for heights that stay */
    SLT_STRUCTURE_NAIVE   /* cell by cell: the oracle */
} SltStructure;

typedef enum SltLanguage {
    SLT_LANGUAGE_AUTO, /* by the file's name: GLSL for .frag, .fs, .fsh and .glsl */
    SLT_LANGUAGE_SALTUS,
    SLT_LANGUAGE_GLSL /* a fragment shader, as for OpenGL ES, WebGL or Shadertoy */
} SltLanguage;

/* How a program is compiled. slt_compile_* copies the struct with all that its members point at. */
typedef struct SltOptions {
    size_t struct_size;
    const char *entry; /* name of the shader; NULL: main, or the only one */
    const SltSet *set; /* [nset]: values of constants at file scope */
    uint32_t nset;
    const SltSet *param_files; /* [nparam_files]: files as values of parameters, to decide the size of open arrays */
    uint32_t nparam_files;
    const char *const *import_dirs; /* [nimport_dirs]: searched after the importing file's folder */
    uint32_t nimport_dirs;
    const char *stdlib_dir;          /* NULL: $SALTUS_STDLIB, else where the standard library was installed */
    bool f64, disc_auto;             /* f64: `float` is double. disc_auto: every comparison counts as [Disc] */
    uint32_t seed;                   /* of rand() in initialiser functions */
    uint32_t width;                  /* SIMD lanes: a power of two up to 64; 0: chosen from program and target */
    bool interpret;                  /* run in the interpreter: slow, the oracle */
    bool no_cache;                   /* compile afresh, and keep nothing on disk */
    const char *target;              /* "native", "avx512", "avx2", "sse2"; NULL: $SALTUS_TARGET or native. One that the
                                        processor lacks compiles, but what would run its kernels is SLT_USAGE */
    int near_miss;                   /* the near-miss probe: 0 off, 1 on, -1 on up to 64 events a sample */
    bool rgba8;                      /* the value kernel writes 8-bit pixels, for slt_render_rgba8 */
    bool paper_argmin, paper_forced; /* for comparison: the branch index and the two-sided variant of Belhe et al. */
    bool path_hash;                  /* regions by the path taken, not (as above 64 events a sample) by provenance */
    const char *dump;         /* [KERNEL:]PASS behind which the IR is printed to standard error; PASS may be "all" */
    bool verify;              /* verify the IR after every pass */
    SltStructure field;       /* what searches heightfields */
    const char *verify_after; /* [KERNEL:]PASS: verify the IR after this pass only */
    const char *stop_after;   /* [KERNEL:]PASS: print the IR to standard output and stop compiling: SLT_STOPPED, here or
                                 from the call that first needs the kernel */
    bool sandbox; /* the source is not trusted: files that it names must lie below its own folder, where no link leads
                     out; what the caller names (import_dirs, param_files, values) is free */
    SltLanguage language;
    uint32_t
        size[2]; /* of the image that a GLSL shader is for, columns and rows: its domain and `iResolution`; 0: 512 */
    /* Values that slt_set_params_json will set, as text: an open array without a file in param_files gets the length of
     * the list that is there under its name, a texture or heightfield the size of its rows, whose first one is looked
     * at. NULL: none. */
    const char *lengths;
} SltOptions;
#define SLT_OPTIONS_INIT ((SltOptions){.struct_size = sizeof(SltOptions), .near_miss = -1})

/* ---- compiling. *out is a program whatever the status, so that its diagnostics can be read (NULL only when memory ran
 * out); the caller frees it with slt_program_free. opt NULL: SLT_OPTIONS_INIT. SLT_PROGRAM: the shader has errors, see
 * the diagnostics; SLT_INPUT: the file or an asset is missing or bad; SLT_USAGE: unknown entry, constant or pass. */
SltStatus slt_compile_file(const char *path, const SltOptions *opt, SltProgram **out);
/* shown_name: what diagnostics call the source; NULL: "<string>". */
SltStatus slt_compile_string(const char *source, const char *shown_name, const SltOptions *opt, SltProgram **out);
/* p may be NULL. While another call uses the program (a callback of it, too) this does nothing. */
void slt_program_free(SltProgram *p);
const char *slt_version(void);

typedef struct SltDiagnostic {
    size_t struct_size;
    int severity;                      /* 1 error, 2 warning, 3 information (LSP) */
    const char *code, *message, *file; /* code: "E0101"; file "" where there is no place */
    uint32_t line, column;             /* from 1; 0 where there is no place */
} SltDiagnostic;
#define SLT_DIAGNOSTIC_INIT ((SltDiagnostic){.struct_size = sizeof(SltDiagnostic)})
uint32_t slt_diagnostic_count(const SltProgram *p);
bool slt_diagnostic(const SltProgram *p, uint32_t index, SltDiagnostic *out);
/* All diagnostics: as the command prints them; as JSON, one LSP Diagnostic a line. The string is valid until the same
 * function is called again. p may be NULL: then memory had run out, and they say so. */
const char *slt_diagnostics_text(SltProgram *p);
const char *slt_diagnostics_json(SltProgram *p);
/* What went wrong where no diagnostic says so (limits, inputs). p may be NULL, as slt_compile_* leaves it when memory
 * runs out. */
const char *slt_last_error(const SltProgram *p);

/* ---- what the program is; 0, "" or false of one that did not compile */
uint32_t slt_dim(const SltProgram *p);      /* of the domain: 1 to 3 */
uint32_t slt_channels(const SltProgram *p); /* 1 to 4 */
const char *slt_entry(const SltProgram *p);
/* Are its colours encoded for a screen already ([Display], GLSL)? Then a PNG takes them as they are, and textures and
 * targets that are PNG are read as they are; else both go through the curve of sRGB. */
bool slt_is_display(const SltProgram *p);
void slt_domain(const SltProgram *p, double lo[3], double hi[3]); /* by axis; those beyond slt_dim mean nothing */
uint32_t slt_site_count(const SltProgram *p);                     /* places under [Disc] that may jump */
bool slt_uses_rand(const SltProgram *p);

/* ---- parameters. All floats are one vector of slt_float_count doubles, all integers and bools one of slt_int_count
 * int32. */
typedef enum SltKind { SLT_KIND_FLOAT, SLT_KIND_BOOL, SLT_KIND_INT, SLT_KIND_UINT, SLT_KIND_STRUCT } SltKind;
enum { SLT_MAX_RANK = 8 };

/* A parameter, or a part of one: an array of shape[rank] of numbers or structs, row by row, in the vector of floats
 * from fbase on and in that of integers from ibase on. float3 has the shape [3], Disc[200] [200], float2x2[5] [5, 2,
 * 2], a heightfield [rows, columns], a texture [rows, columns] or [rows, columns, channels], a texture3D these behind
 * [slices], a float none (rank 0). */
typedef struct SltParam {
    size_t struct_size;
    const char *name;                      /* from slt_param_find: the string that the caller passed */
    const char *type;                      /* as written: "Disc[200]" */
    uint32_t fbase, fcount, ibase, icount; /* first and number of its floats; of its integers and bools */
    bool differentiable, is_texture, is_heightfield;
    bool has_range, log, color;         /* [Range], [Log], [Color] */
    double lo, hi;                      /* of [Range] */
    const char *doc;                    /* of [Doc], or NULL */
    uint32_t tex_w, tex_h, tex_c;       /* of a texture or heightfield: columns, rows, channels; else 0 */
    SltKind kind;                       /* of what the array holds */
    uint32_t rank, shape[SLT_MAX_RANK]; /* of more than SLT_MAX_RANK dimensions the last is the product of the rest */
    uint32_t fstride, istride; /* floats and integers from one element to the next: 1 and 0, 0 and 1, a struct's own */
    uint32_t nfields;          /* of a struct, else 0 */
    const void *layout;        /* for slt_param_field */
    bool has_extent;           /* of a heightfield: [Extent] was given */
    double extent[4];          /* x0, y0, x1, y1 of [Extent] */
    double height_scale, height_offset; /* of a heightfield: height = scale * raw + offset ([Height]); else 1 and 0 */
    uint32_t tex_d;                     /* slices of a texture3D, else 0 */
} SltParam;
#define SLT_PARAM_INIT ((SltParam){.struct_size = sizeof(SltParam)})
uint32_t slt_param_count(const SltProgram *p);
/* False beyond the last parameter, and for an `out` without its size; so too slt_param_field. */
bool slt_param(const SltProgram *p, uint32_t index, SltParam *out);
/* Field `index` of the first struct in `of`. In each next struct it lies of->fstride floats and of->istride integers
 * further on. */
bool slt_param_field(const SltParam *of, uint32_t index, SltParam *out);
/* A parameter or component by name ("discs[3].centre.x"). SLT_USAGE: there is none; err names the nearest. */
SltStatus slt_param_find(const SltProgram *p, const char *name, SltParam *out, SltError *err);
/* What a parameter that is a mesh is made of, which never changes (saltus/mesh.h says how it lies there): the program's
 * own. Its positions are shape[0] vertices of 3 floats. NULL: the parameter is no mesh. */
const int32_t *slt_mesh(const SltProgram *p, uint32_t index, uint32_t *nfaces, bool *has_uv);
uint32_t slt_float_count(const SltProgram *p);
uint32_t slt_int_count(const SltProgram *p);
const double *slt_floats(const SltProgram *p); /* [slt_float_count]: the values now */
const int32_t *slt_ints(const SltProgram *p);  /* [slt_int_count] */
/* Values of numbers base .. base + count - 1 of the vector, taken as they are ([Range] binds fits only). */
SltStatus slt_set_floats(SltProgram *p, uint32_t base, uint32_t count, const double *values, SltError *err);
SltStatus slt_set_ints(SltProgram *p, uint32_t base, uint32_t count, const int32_t *values, SltError *err);
/* The value of a parameter or component as text: "0.3", "[0.1, 0.2]", JSON of its shape, or "@file" (.csv .json .exr
 * .npy .png ...). */
SltStatus slt_set_text(SltProgram *p, const char *name, const char *value, SltError *err);
/* All parameters as the JSON that `saltus fit` writes: a malloc'd string, the caller's to free; NULL when memory is out
 * or the program in use. Back: the same JSON, or part of it; an error changes nothing. A texture or heightfield may
 * also be {"file": "dem.exr"}, relative to the folder of the path shown_name. */
char *slt_params_json(const SltProgram *p);
SltStatus slt_set_params_json(SltProgram *p, const char *text, const char *shown_name, SltError *err);

/* ---- which parameters or components are differentiated: those named, "discs[*].centre" of every element, or with n =
 * 0 all that are differentiable. */
SltStatus slt_wrt(SltProgram *p, const char *const *names, uint32_t n, SltError *err);
const uint8_t *slt_wrt_mask(const SltProgram *p); /* [slt_float_count]: 1 where a gradient is wanted */

/* ---- print() of shaders: nothing is printed without it. line: the text with its values in place, without a newline,
 * valid during the call; at most 1023 characters. values: the n numbers alone. Called while an estimating function
 * samples the value of the shader, by any of its threads, several at once. print NULL: silent again. */
typedef void SltPrint(void *user, const char *line, const double *values, uint32_t n);
SltStatus slt_set_print(SltProgram *p, SltPrint *print, void *user, SltError *err);

/* ---- estimating: job.h has the job and the results. job NULL: SLT_JOB_INIT. stats and err may be NULL. Kernels are
 * compiled on first need. Arrays are the caller's, of the shapes named; gradients are double[slt_float_count], 0 where
 * slt_wrt asks for none. */
/* The image, or with job.integral the integral: float[channels]. */
SltStatus slt_render(SltProgram *p, const SltJob *job, float *image, SltStats *stats, SltError *err);
/* pixels[height][width], R in the lowest byte, then G, B and 255: f in the middle of each pixel, one sample, through
 * the curve of sRGB as in a PNG (not of slt_is_display). SLT_USAGE unless compiled with SltOptions.rgba8, in 1D or 2D,
 * without rand(). */
SltStatus slt_render_rgba8(SltProgram *p, const SltJob *job, uint32_t *pixels, SltStats *stats, SltError *err);
/* Derivative images out[ndir] along directions dirs[ndir], each double[slt_float_count]. crossings (may be NULL):
 * float[height][width], how many crossings each pixel has. */
SltStatus slt_grad_images(SltProgram *p, const SltJob *job, uint32_t ndir, const double *const *dirs, float *const *out,
                          float *crossings, SltStats *stats, SltError *err);
/* Gradient of the sum of adjoint * image over pixels and channels. stderr_bound (may be NULL): for each float an upper
 * bound of its standard error. */
SltStatus slt_grad_adjoint(SltProgram *p, const SltJob *job, const float *adjoint, double *gradient,
                           double *stderr_bound, SltStats *stats, SltError *err);
/* Loss: the mean over pixels and channels of mask * (image - target)^2, and its gradient. mask (an image; NULL: 1),
 * loss, gradient, stderr_bound and image may be NULL. */
SltStatus slt_grad_loss(SltProgram *p, const SltJob *job, const float *target, const float *mask, double *loss,
                        double *gradient, double *stderr_bound, float *image, SltStats *stats, SltError *err);
/* The integral over the domain and its gradient, whether job.integral is set or not. */
SltStatus slt_grad_integral(SltProgram *p, const SltJob *job, SltIntegral *out, SltStats *stats, SltError *err);
/* Warning `index` of what calls have counted; false beyond the last. `at` points at strings of the program that was
 * sampled. */
bool slt_warning(const SltStats *stats, uint32_t index, SltWarning *out);
/* f at n points: x[n][slt_dim], out[n][slt_channels]. The points are rounded to the precision of the program and may
 * lie anywhere: f is evaluated outside the domain as it is inside. rand() at point i depends on job.seed and on the
 * point's stream, streams[i] (i where streams is NULL), and on nothing else. To the shader the domain is one pixel, as
 * in an integral. Of the job only seed, threads, time_limit, cancel, progress, floats and ints count. */
SltStatus slt_eval(SltProgram *p, const SltJob *job, uint64_t n, const double *x, const uint32_t *streams, double *out,
                   SltStats *stats, SltError *err);
/* The crossing nearest to a on the segment from a to b, with rand() of that stream. Of the job only floats and ints
 * count. */
SltStatus slt_crossing(SltProgram *p, const SltJob *job, const double a[3], const double b[3], uint32_t stream,
                       SltCrossing *out, SltError *err);
/* What is known of n boxes, from interval arithmetic: lo[n][slt_dim] and hi[n][slt_dim] are their corners, which belong
 * to them, anywhere, finite, rounded to the precision of the program as points are. Never wrong for any point that
 * slt_eval takes, but not always all that is true: smaller boxes tell more (docs/bounds.md). Every out[n] has its size.
 * Of the job only threads, time_limit, cancel, progress, floats and ints count. */
SltStatus slt_bound(SltProgram *p, const SltJob *job, uint32_t n, const double *lo, const double *hi, SltBound *out,
                    SltError *err);

#ifdef __cplusplus
}
#endif
#endif
