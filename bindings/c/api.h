/* Inside the library's face: a program object owns its session, its parameter values and the kernels compiled so far.
 */
#ifndef SALTUS_BINDINGS_C_API_H
#define SALTUS_BINDINGS_C_API_H

#include "compiler/back/back.h"
#include "compiler/pass/pass.h"
#include "runtime/base/status.h"
#include "runtime/geometry/heightfield/field.h"
#include "runtime/sample/estimate.h"
#include "saltus/saltus.h"

/* What a heightfield's structure knows, and which of its heights have changed since (x0 >= x1: none). */
typedef struct FieldState {
    uint32_t wanted, built;   /* bit (1 << SltFieldWhat): in compiled kernels; in the structure */
    uint32_t x0, y0, x1, y1;  /* vertices, y upwards */
    uint32_t made, refreshed; /* how often; tests look */
    uint64_t refreshed_heights;
} FieldState;

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
    uint8_t *dense;          /* per float: some reverse kernel adds to its adjoint in place */
    const SltField **fields; /* [prog->nfields]; NULL: no compiled kernel asks it anything */
    uint32_t *field_base, *field_count;
    FieldState *field_state;
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
/* fields.c */
bool api_fields_init(SltProgram *p);
void api_fields_free(SltProgram *p);
void api_fields_watch(
    SltProgram *p, uint32_t base,
    uint32_t count); /* floats[base..] are new, flt[base..] still old: marks the heights that become others */
uint32_t api_field_queries(const Fn *fn, uint32_t field); /* bit (1 << SltFieldWhat) for every fieldop on it */
void api_fields_want(SltProgram *p, const Fn *fn);        /* fn will run: what it asks is made by the next api_fields */
SltStatus api_fields(SltProgram *p, SltError *err);       /* makes and refreshes what compiled kernels ask */
/* values.c */
void api_params_changed(SltProgram *p, uint32_t base, uint32_t count);
SltStatus api_load_assets(SltProgram *p, SltError *err);
bool api_probe_asset(void *user, const char *path, char kind, uint32_t dims[4], uint32_t *ndims, const char **why);
/* Upper bound on the events of one sample. */
uint64_t api_event_bound(const SltProgram *p);
bool api_near_miss(const SltProgram *p); /* do its kernels look for events that nearly decide differently? */

#endif
