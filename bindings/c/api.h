/* Inside the library's face: a program object, which owns its session, its parameter values and the kernels compiled so
 * far; and what the files of this folder share. One call at a time uses a program: in_use. */
#ifndef SALTUS_BINDINGS_C_API_H
#define SALTUS_BINDINGS_C_API_H

#include <pthread.h>
#include <stdatomic.h>

#include "compiler/back/back.h"
#include "compiler/pass/pass.h"
#include "runtime/base/status.h"
#include "runtime/geometry/geometry.h"
#include "runtime/sample/estimate.h"
#include "saltus/saltus.h"

/* What kernels ask of a geometry, and what was made for that. */
typedef struct GeometryState {
    uint32_t wanted, built; /* bit (1 << SltQuery): queries of compiled kernels; those that the geometry was made for */
    uint32_t made, followed;  /* for tests: how often it was made, and how often it followed its numbers */
    uint64_t followed_values; /* for tests: numbers that it looked at to follow */
} GeometryState;

typedef struct DerivedState DerivedState;       /* derived.h */
typedef struct GradientKernels GradientKernels; /* turns.c */

/* Kernels that may never be called: those of lines, where cells integrate; that of the value, where f comes with its
 * adjoints; the guarded one of adjoints. Their layouts and geometries are known, from their IR or recalled (fn is NULL
 * then); LLVM compiles them when one of them is called, these two alone and all others together. */
typedef struct LateKernels {
    pthread_mutex_t lock; /* of all, while an estimate runs */
    KernelRequest request[K_KINDS];
    SltKernelKind kind[K_KINDS];
    uint32_t n, guarded_lanes; /* how many wait; lanes of vjp_guarded, which are those of vjp */
    uint64_t few, plain;
    unsigned level;
    SltKernel *kernel[K_KINDS]; /* compiled, and not yet in the scene */
    CompiledModule *module[K_KINDS];
    SltError error;
} LateKernels;

struct SltProgram {
    Session *session;
    Program *prog;  /* NULL where the shader did not compile */
    SltOptions opt; /* what it points at lies in the session */
    PassCtx passes;
    Target target;
    int source;       /* of session->sources: the file or string that was compiled */
    bool has_lengths; /* open arrays have those of opt.lengths, which is kept */

    atomic_bool in_use;           /* by a public function that reads or writes what follows */
    _Atomic(const void *) holder; /* the thread whose fit holds the program, as call.c names threads; NULL: none */
    atomic_bool in_fit;           /* like in_use, of calls on the holder's thread */
    atomic_bool fitted;           /* between slt_fit_begin and slt_fit_end: slt_wrt and another fit must wait */
    uint32_t most_site_size;      /* VariantOptions.most_site_size */
    bool few_samples; /* kernels will run for milliseconds: one vector a value, which compiles in half the time. Not
                         where they add up adjoints: in which order hangs on the lanes */
    size_t side_room; /* Side.room: of whoever keeps what is freed */
    bool ready;       /* compiled, with values: else only diagnostics may be asked for */

    double *floats; /* [nfloats]: the values; of derived arrays the last that were computed */
    void *flt;      /* flt[nfloats]: the values in the program's precision; while flt_lent those of the last call */
    bool flt_lent;  /* the last call had values of its own (SltJob.floats) */
    int32_t *ints;  /* [nints] */
    const int32_t *lent_ints; /* [nints]: those of the call in hand, where it has its own (SltJob.ints); else NULL */
    uint8_t *wrt;             /* [nfloats]: 1 where a gradient is wanted */
    bool *asset_loaded;       /* by parameter: its file has been read */
    bool keeps_probed;        /* the compilation will want the values of images, too, whose sizes the front end asks */
    struct ProbedImage *probed; /* the last of them; NULL: none */

    SltScene scene;           /* what the runtime sees; points into the members below */
    bool tried[K_KINDS];      /* asked for before */
    bool has[K_KINDS];        /* those of them that are there; of others the program has no use */
    Fn *fn[K_KINDS];          /* their IR; NULL: none, or it was recalled that they need none (api_fn makes it) */
    TapeReport tape[K_KINDS]; /* of the reverse kernels that have IR */
    atomic_bool tape_full;    /* of the call at hand: SltScene.tape_full */
    CompiledModule *modules[16];
    uint32_t nmodules;
    CompiledModule *module_of[K_KINDS];
    LateKernels late;
    GradientKernels *turns; /* kernels of derivatives for other wrt; NULL until there are any */
    uint64_t turn;
    uint8_t compiled_few[K_KINDS], compiled_level[K_KINDS];  /* of BackOptions; 0 where it is plain */
    bool guarded;                                            /* vjp keeps its guards: nobody looks at its sums */
    SltDoubt doubt;                                          /* SltScene.doubt */
    SltKernel **cull_kernels;                                /* by [Cull] loop */
    uint32_t nlists;                                         /* loops with lists, [Cull] loops first */
    uint32_t first_lists;                                    /* of them, before loops were written out */
    uint32_t *list_counts;                                   /* [SLT_MAX_CULL]: iterations of each */
    enum { LISTS_UNASKED, LISTS_USED, LISTS_USELESS } lists; /* listed.c: of parts of images of 8-bit pixels */
    double list_work;                                        /* of images so far: instructions of all samples */
    SltKernel *image_bounds;                                 /* `bounds`, compiled for images; NULL: not yet */
    SltLayout image_layout;                                  /* its */
    uint8_t *list_noted; /* [SLT_MAX_CULL]: 1 where `bounds` notes which can matter */
    uint8_t *site_kind, *site_static, *site_skips, *site_ties; /* by site: see SltScene */
    SltTwins *twins;                                           /* [ntwins] */
    uint32_t ntwins;
    uint8_t *edge_upsets; /* as edge_kind; NULL: no seam does */
    uint32_t *edge_line;  /* likewise: of the source */
    uint8_t *edge_bends;  /* by edge: see SltScene */
    int8_t *edge_argmin;  /* likewise; NULL: none is */
    uint8_t *edge_kind;   /* by edge; NULL until a kernel that knows edges was asked for */
    uint32_t nedges;
    bool flat, told, chunked;         /* see SltScene */
    uint8_t *dense;                   /* [nfloats]: 1 where some reverse kernel adds to adj */
    const SltGeometry **geometries;   /* [prog->ngeometries]; NULL: no compiled kernel asks it anything */
    uint32_t *geometry_base;          /* [prog->ngeometries]: where in flt its numbers begin */
    GeometryState *geometry_state;    /* [prog->ngeometries] */
    DerivedState *derived;            /* [prog->nderived] */
    struct SltDerived *derived_scene; /* likewise: what the runtime sees */
    void (*print)(void *user, const char *text, uint32_t len, const double *values, uint32_t n,
                  uint32_t lane); /* SltKernelArgs.print; NULL: silent */
    void *print_user;             /* of print: this program */
    SltPrint *on_print;           /* the caller's function (slt_set_print), which print calls */
    void *on_print_user;
    uint32_t nonfinite_sought;           /* place.c: searches that found nothing */
    uint32_t scales_sought;              /* scale.c: searches */
    bool steep_looked, steep_told;       /* steep.c: of images; of a change that has no place in the source */
    uint32_t threads;                    /* SltJob.threads of the last call: kernels are compiled on so many */
    double ms_front, ms_passes, ms_llvm; /* milliseconds spent compiling */
    bool cached;                         /* every module so far came from the cache */

    SltError error; /* slt_last_error */
    char *text[4];  /* malloc'd strings handed out: diagnostics as text, as JSON */
};

/* ---- kernels.c: compiles those of the kernels that the program needs and lacks, then fills p->scene. api_kernels also
 * sees to their IR, which the others do without where the cache has what follows from it (recall.h). `late`: which may
 * wait until they are called; NULL: none. */
SltStatus api_kernels(SltProgram *p, const bool needs[K_KINDS], SltError *err);
SltStatus api_kernels_late(SltProgram *p, const bool needs[K_KINDS], const bool *late, SltError *err);
/* `soon`: what a later call will need whatever these say. They are compiled beside, and kept in the cache apart. */
SltStatus api_kernels_beside(SltProgram *p, const bool needs[K_KINDS], const bool soon[K_KINDS], SltError *err);
/* The same for kernels that are not run here: for objects of another machine, and to be shown. api_kernels refuses a
 * target that this processor lacks; this does not. */
SltStatus api_kernels_unrun(SltProgram *p, const bool needs[K_KINDS], SltError *err);
/* The IR of a kernel; NULL: there is none, or no memory for it. */
const Fn *api_fn(SltProgram *p, int kind);
/* In a protected session: makes the IR of kernels that were recalled. wrt: what is differentiated, NULL: anything. */
void api_missing(SltProgram *p, const bool kinds[K_KINDS], const uint8_t *wrt);
/* One module of n kernels; NULL: none, and err says why. few, plain: see BackOptions. width: 0: that of the options. */
CompiledModule *api_compile_module(SltProgram *p, Session *s, const KernelRequest *req, uint32_t n, uint64_t few,
                                   uint64_t plain, unsigned level, uint32_t width, SltError *err);
/* vjp has no guards any more: where a call of it is not finite, a kernel with them is compiled. */
void api_put_off_guarded(SltProgram *p);

/* ---- late.c */
/* Those that wait and are needed now; late: which may go on waiting, NULL: none. */
SltStatus api_late_compile(SltProgram *p, const bool needs[K_KINDS], const bool *late, SltError *err);
SltKernel *api_late_make(void *program, int kind); /* SltScene.make */
void api_late_settle(SltProgram *p);               /* behind a call: what it made takes its place in the scene */
void api_late_drop_guarded(SltProgram *p);         /* another one will wait, or none */
void api_late_free(SltProgram *p);

/* cull_check.c: warns of [Cull] loops that do something outside their boxes. After the bounds of these are lowered. */
void api_check_cull(SltProgram *p);
void api_forget_gradients(SltProgram *p); /* frees the kernels that depend on p->wrt */
void api_free_kernels(SltProgram *p);

/* ---- turns.c: p->wrt becomes wrt[nfloats], and the kernels that depend on it follow. */
void api_differentiate(SltProgram *p, const uint8_t *wrt);
void api_turns_forget(SltProgram *p); /* kernels are freed */
void api_turns_free(SltProgram *p);

/* ---- call.c. A public function that reads or writes what changes claims the program first: api_claim is false where
 * another call has it; api_enter also fails where the program did not compile, with a text. api_release follows what
 * succeeded. */
bool api_claim(const SltProgram *p);
void api_release(const SltProgram *p);
SltStatus api_enter(const SltProgram *p, SltError *err);
SltStatus api_enter_to_set(const SltProgram *p, SltError *err); /* and not from a callback of a fit */
/* A fit holds its program while one of its functions runs: other threads are refused, calls from its callbacks may
 * look. api_hold fails, with a text, where the program is in use; api_let_go ends it. */
SltStatus api_hold(SltProgram *p, SltError *err);
void api_let_go(SltProgram *p);
/* Structs that begin with their size: `mine` is of this version, `known` bytes long; `theirs`, the caller's, may be of
 * another. api_struct_read copies theirs to mine, but for members that theirs lacks; false: theirs has no size, or sets
 * members that are not known here. api_struct_write copies mine to theirs, whose size was checked. */
bool api_struct_sized(const void *theirs);
bool api_struct_read(void *mine, size_t known, const void *theirs);
void api_struct_write(void *theirs, const void *mine, size_t known);
SltStatus api_struct_unknown(SltError *err, const char *name); /* the error where these are false */
/* A call that samples: api_call_begin enters the program; api_call_end releases it, whatever begin returned. */
typedef struct ApiCall {
    SltProgram *p; /* NULL: not entered */
    SltJob job;    /* the caller's, as a struct of this version */
    SltStats own;
    int32_t *ints;            /* with integers of its own: all of them, where meshes have some */
    SltStats *stats, *theirs; /* &own, and the caller's, which gets own at the end; both NULL where none are wanted */
    SltError *err;
    Side side; /* SltScene.side */
} ApiCall;
SltStatus api_call_begin(ApiCall *c, SltProgram *p, const SltJob *job, SltStats *stats, SltError *err);
SltStatus api_call_kernels(ApiCall *c, const bool needs[K_KINDS]);
SltStatus api_call_kernels_late(ApiCall *c, const bool needs[K_KINDS], const bool *late);
SltStatus api_call_kernels_beside(ApiCall *c, const bool needs[K_KINDS], const bool soon[K_KINDS]);
SltStatus api_call_end(ApiCall *c, SltStatus status);
/* steep.c: after an estimate that took so many evaluations: warns of changes of f that nothing explains, and adds what
 * they weigh to the errors of `out`. NULL: of an image, of which only the first is looked at. */
SltStatus api_steep(ApiCall *c, SltIntegral *out, uint64_t spent);
/* ---- pixels.c, squares.c: images of 8-bit pixels */
double api_middle(const SltProgram *p, const SltJob *job, uint32_t axis, uint32_t cell); /* of a pixel; cells go up */
SltStatus api_render_squares(SltProgram *p, const SltJob *job, uint32_t *pixels, SltStats *stats, SltError *err);
/* ---- listed.c: lists of iterations for parts of images. After api_site_facts, before kernels are asked for: is it
 * worth while to compile `bounds` for an image of so many samples, and those that were before it? */
bool api_lists_pay(SltProgram *p, double samples);
/* kernels.c: for this image alone; no other call sees it. False: it is not to be had, and the image does without. */
bool api_lists_begin(SltProgram *p);
void api_lists_end(SltProgram *p);
bool api_wants_lists(SltProgram *p, const SltJob *job); /* the same for 8-bit pixels, whose value kernel may change */
/* ---- geometry.c */
bool api_geometries_init(SltProgram *p);
void api_geometries_free(SltProgram *p);
/* Says to geometries which of their numbers will change: those among base .. base + count - 1 where values[] differs
 * from flt[], which is still old. */
void api_geometries_watch(SltProgram *p, const double *values, uint32_t base, uint32_t count);
uint32_t api_geometry_queries(const Fn *fn, uint32_t geometry); /* bit (1 << SltQuery): what fn asks that geometry */
void api_geometries_want(SltProgram *p, const Fn *fn); /* fn will run: the next api_geometries makes what fn asks for */
void api_geometries_ask(SltProgram *p, const uint32_t *queries); /* likewise; by geometry, a bit a query */
/* Makes the geometries that compiled kernels ask for; those that are there follow their numbers in flt. */
SltStatus api_geometries(SltProgram *p, SltError *err);
bool api_geometries_lost(const SltProgram *p); /* geometry_lost of any */
/* geometry_blind: of how many meshes, and the declaration of the first. */
uint32_t api_geometries_blind(const SltProgram *p, SltPlace *at);
/* geometry_unmet of all, and the declaration of the first that has any. */
void api_geometries_unmet(const SltProgram *p, SltStats *stats);

/* ---- derived.c */
void api_derived_lower(SltProgram *p); /* with the shader's primal */
/* Marks those that move with what is marked among the parameters of wrt[nfloats]. */
void api_derived_mark(const SltProgram *p, uint8_t *wrt);
/* The parameters base .. base + count - 1 will be values[]: flt is still old. */
void api_derived_watch(SltProgram *p, const double *values, uint32_t base, uint32_t count);
SltStatus api_derived_kernels(SltProgram *p, const bool needs[K_KINDS], SltError *err);
/* Brings those up to date whose parameters have changed. */
SltStatus api_derived_follow(SltProgram *p, const int32_t *ints, SltError *err);
void api_derived_forget(SltProgram *p); /* the kernels that depend on p->wrt */
void api_derived_free(SltProgram *p);

/* ---- program.c: the folder of the standard library; is a file of this name written in GLSL? */
const char *api_stdlib(Session *s, const SltOptions *opt);
bool api_is_glsl(const char *path, SltLanguage language);
/* The source of p with more text behind it and another entry, under the options of p. As
 * slt_compile_string. */
SltStatus api_compile_beside(const SltProgram *p, const char *more, const char *entry, SltProgram **out);
/* The same source, entry and options again, with open arrays as long as in these values (SltOptions.lengths). */
SltStatus api_compile_resized(const SltProgram *p, const char *lengths, SltProgram **out);

/* ---- values.c */
void api_flt_from(SltProgram *p, const double *values, uint32_t base,
                  uint32_t count);                                     /* flt[base..] = values[base..] */
void api_params_changed(SltProgram *p, uint32_t base, uint32_t count); /* floats[base..] are new: flt follows */
/* What `name` names; where there is none, fails with the status `wrong` and a text, which begins with `what` unless
 * that is NULL. Nothing of it stays in memory, so that a program may be asked for ever. */
SltStatus api_find(const SltProgram *p, const char *name, SltStatus wrong, const char *what, ParamRef *out,
                   SltError *err);
SltStatus api_find_pattern(const SltProgram *p, const char *name, const char *what, ParamPattern *out, SltError *err);
SltStatus api_wrt(SltProgram *p, const char *const *names, uint32_t n, SltError *err); /* slt_wrt, program entered */
/* Leaves out what the names stand for, of what is differentiated; program entered. */
SltStatus api_wrt_without(SltProgram *p, const char *const *names, uint32_t n, SltError *err);

/* ---- values_read.c */
SltStatus api_set_text(SltProgram *p, const char *name, const char *value, SltError *err); /* slt_set_text, entered */
/* By the words that only such a source has. */
bool api_looks_like_glsl(const char *text);
/* The files that declarations name as values; the front end asks for their dimensions by api_probe_asset. */
SltStatus api_load_assets(SltProgram *p, SltError *err);
AssetProbe api_probe_asset;
void api_forget_probed(SltProgram *p); /* the image that it kept */
GivenSizes api_given_sizes;            /* of opt.lengths */

/* ---- kernels.c: facts of the program */
uint64_t api_event_bound(const SltProgram *p); /* the most events that one sample may meet */
/* What the scene knows before any kernel is compiled: kinds of sites, lists, geometries. */
SltStatus api_site_facts(SltProgram *p, SltError *err);
bool api_too_many_sites(const SltProgram *p);                 /* written out, to compile what looks for boundaries */
uint32_t api_adjoint_lanes(const SltProgram *p);              /* SltScene.adj_lanes */
BackOptions api_compiled_with(const SltProgram *p, int kind); /* of a kernel that was compiled, as if alone */
BackPixels api_pixels(const SltProgram *p); /* what its value kernel writes: 8-bit pixels for a screen, or floats */
bool api_near_miss(const SltProgram *p);    /* do its kernels note the nearest event, for the near-miss probe? */

#endif
