/* Inside the library's face: a program object owns its session, its parameter values and the kernels compiled so far.
 */
#ifndef SALTUS_BINDINGS_C_API_H
#define SALTUS_BINDINGS_C_API_H

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

    double *floats; /* master values */
    void *flt;      /* the same in the program's precision */
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
    void *print_user;
    double ms_front, ms_passes, ms_llvm;
    bool cached; /* every module so far came from the cache */

    SltError error;
    char *text[4]; /* malloc'd strings handed out: diagnostics text, JSON */
};

/* kernels.c: makes sure that these kernels exist (those that the program needs), then fills p->scene. */
SltStatus api_kernels(SltProgram *p, const bool needs[K_KINDS], SltError *err);
void api_forget_gradients(SltProgram *p); /* the kernels that depend on what is differentiated */
void api_free_kernels(SltProgram *p);
/* geometry.c */
bool api_geometries_init(SltProgram *p);
void api_geometries_free(SltProgram *p);
/* floats[base..] are new, flt[base..] still old: tells geometries which of their numbers become others. */
void api_geometries_watch(SltProgram *p, uint32_t base, uint32_t count);
uint32_t api_geometry_queries(const Fn *fn, uint32_t geometry); /* bit (1 << SltQuery) for every query on it */
void api_geometries_want(SltProgram *p, const Fn *fn);  /* fn will run: the next api_geometries makes what it asks */
SltStatus api_geometries(SltProgram *p, SltError *err); /* makes what compiled kernels ask, or has it follow */
/* values.c */
void api_params_changed(SltProgram *p, uint32_t base, uint32_t count);
SltStatus api_load_assets(SltProgram *p, SltError *err);
bool api_probe_asset(void *user, const char *path, char kind, uint32_t dims[4], uint32_t *ndims, const char **why);
/* Upper bound on the events of one sample. */
uint64_t api_event_bound(const SltProgram *p);

#endif
