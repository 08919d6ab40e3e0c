/* Derived arrays of a program: kernels, numbers, and results that the caller gets without them. */
#ifndef SALTUS_BINDINGS_C_DERIVED_H
#define SALTUS_BINDINGS_C_DERIVED_H

#include "bindings/c/api.h"
#include "runtime/sample/derived.h"

struct DerivedState {
    SltProgram *p;
    Fn *fn[K_KINDS]; /* VALUE, JVP, VJP */
    CompiledModule *module[K_KINDS];
    uint8_t *reaches;  /* a bit a float: it is differentiable in that */
    bool stale;        /* what it is computed from has changed */
    uint32_t computed; /* for tests: how often */
};

/* ---- wide.c: arrays of all floats for what the runtime fills, and the caller's, of parameters alone. */
typedef struct Wide {
    double *own;    /* NULL: the caller's are as long */
    double *theirs; /* [rows][parameters] */
    uint32_t rows;
} Wide;
/* Directions in parameters, as the runtime wants them: *out[n], for wide_directions_free, whatever the result. */
SltStatus wide_directions(const SltProgram *p, uint32_t n, const double *const *dirs, double ***out, SltError *err);
void wide_directions_free(uint32_t n, double **dirs);
/* What to fill instead of theirs, which may be NULL; *failed is set when memory runs out. */
double *wide_begin(const SltProgram *p, Wide *w, double *theirs, uint32_t rows, bool *failed);
/* derivatives: pulled back to parameters; errors: as if none cancelled. Fills the caller's where ok. */
void wide_end(const SltProgram *p, Wide *w, bool errors, bool ok, bool *failed);

#endif
