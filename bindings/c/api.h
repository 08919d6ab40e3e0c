/* Inside the library's face: a program object owns its session, its parameter values and the kernels compiled so far.
 */
#ifndef SALTUS_BINDINGS_C_API_H
#define SALTUS_BINDINGS_C_API_H

#include <stdatomic.h>

#include "compiler/back/back.h"
#include "compiler/pass/pass.h"
#include "runtime/base/status.h"
#include "runtime/geometry/geometry.h"
#include "runtime/sample/estimate.h"
#include "saltus/saltus.h"

/* What is asked of a geometry. */
typedef struct GeometryState {
    uint32_t wanted, built;  /* bit (1 << SltQuery): in compiled kernels; what it was made for */
    uint32_t made, followed; /* how often; tests look */
    uint64_t followed_values;
} GeometryState;

struct SltProgram {
    Session *session;
    Program *prog;  /* NULL after an error */
    SltOptions opt; /* strings copied into the session */
    PassCtx passes;
    Target target;

    atomic_bool in_use; /* by a public function that reads or writes what follows */
    atomic_uint fits;   /* under way: slt_wrt must not change what they optimise */
    bool ready;         /* compiled, with values: else only diagnostics may be asked for */

    double *floats; /* master values */
    void *flt;      /* the same in the program's precision; or those of the last call, when it had its own */
    bool flt_lent;  /* flt holds a call's own values */
    int32_t *ints;
    uint8_t *wrt;       /* per float: differentiate */
    bool *asset_loaded; /* per parameter */

    SltScene scene; /* kernels compiled so far */
    Fn *fn[K_KINDS];
    bool tried[K_KINDS]; /* asked for before; NULL in fn: the program has no use for it */
    TapeReport tape[K_KINDS];
    CompiledModule *modules[16];
    uint32_t nmodules;
    CompiledModule *module_of[K_KINDS];
    SltKernel **cull_kernels;
    uint32_t *cull_counts;
    uint8_t *site_kind, *site_static, *site_skips;
    uint8_t *dense;                 /* per float: some reverse kernel adds to its adjoint in place */
    const SltGeometry **geometries; /* [prog->ngeometries]; NULL: no compiled kernel asks it anything */
    uint32_t *geometry_base;
    GeometryState *geometry_state;
    void (*print)(void *user, const char *text, uint32_t len, const double *values, uint32_t n,
                  uint32_t lane); /* print(); NULL: silent */
    void *print_user;             /* as kernels call it: this program */
    SltPrint *on_print;           /* the caller's */
    void *on_print_user;
    double ms_front, ms_passes, ms_llvm;
    bool cached; /* every module so far came from the cache */

    SltError error;
    char *text[4]; /* malloc'd strings handed out: diagnostics text, JSON */
};

/* kernels.c: makes sure that these kernels exist (those that the program needs), then fills p->scene. */
SltStatus api_kernels(SltProgram *p, const bool needs[K_KINDS], SltError *err);
void api_forget_gradients(SltProgram *p); /* the kernels that depend on what is differentiated */
void api_free_kernels(SltProgram *p);
/* call.c. Public functions that touch what changes claim the program first; api_enter also fails, with a text, when it
 * did not compile. What succeeds is followed by api_release. */
bool api_claim(const SltProgram *p);
void api_release(const SltProgram *p);
SltStatus api_enter(const SltProgram *p, SltError *err);
/* Structs that begin with their size. `mine` is of this version, `known` bytes long; `theirs` may be of another.
 * api_struct_read leaves alone what theirs lacks; false: theirs has no size, or says what is not known here.
 * api_struct_write wants a size that was checked. */
bool api_struct_sized(const void *theirs);
bool api_struct_read(void *mine, size_t known, const void *theirs);
void api_struct_write(void *theirs, const void *mine, size_t known);
SltStatus api_struct_unknown(SltError *err, const char *name); /* the error for it */
/* A call that samples, from begin (which enters) to end (which is called whatever begin returned). */
typedef struct ApiCall {
    SltProgram *p;                 /* NULL: not entered */
    SltJob job;                    /* of this version */
    SltStats own, *stats, *theirs; /* stats: NULL where the caller wants none */
    SltError *err;
} ApiCall;
SltStatus api_call_begin(ApiCall *c, SltProgram *p, const SltJob *job, SltStats *stats, SltError *err);
SltStatus api_call_kernels(ApiCall *c, const bool needs[K_KINDS]);
SltStatus api_call_end(ApiCall *c, SltStatus status);
/* geometry.c */
bool api_geometries_init(SltProgram *p);
void api_geometries_free(SltProgram *p);
/* values[base..] are new, flt[base..] still old: tells geometries which of their numbers become others. */
void api_geometries_watch(SltProgram *p, const double *values, uint32_t base, uint32_t count);
uint32_t api_geometry_queries(const Fn *fn, uint32_t geometry); /* bit (1 << SltQuery) for every query on it */
void api_geometries_want(SltProgram *p, const Fn *fn);  /* fn will run: the next api_geometries makes what it asks */
SltStatus api_geometries(SltProgram *p, SltError *err); /* makes what compiled kernels ask, or has it follow */
/* values.c */
void api_flt_from(SltProgram *p, const double *values, uint32_t base,
                  uint32_t count);                                     /* flt[base..] = values[base..] */
void api_params_changed(SltProgram *p, uint32_t base, uint32_t count); /* floats[base..] are new */
SltStatus api_wrt(SltProgram *p, const char *const *names, uint32_t n, SltError *err); /* slt_wrt without entering */
SltStatus api_set_text(SltProgram *p, const char *name, const char *value, SltError *err); /* slt_set_text likewise */
SltStatus api_load_assets(SltProgram *p, SltError *err);
bool api_probe_asset(void *user, const char *path, char kind, uint32_t dims[4], uint32_t *ndims, const char **why);
/* Upper bound on the events of one sample. */
uint64_t api_event_bound(const SltProgram *p);
bool api_near_miss(const SltProgram *p); /* do its kernels look for events that nearly decide differently? */

#endif
