/* Derivatives in all floats, as the runtime gives them, become those of parameters (runtime/sample/derived.h). */
#include <stdlib.h>
#include <string.h>

#include "bindings/c/derived.h"

SltStatus wide_directions(const SltProgram *p, uint32_t n, const double *const *dirs, double ***out, SltError *err) {
    bool ok = (*out = calloc(n + 1u, sizeof **out)) != NULL;
    for (uint32_t k = 0; k < n && ok; k++) {
        double *dir = (*out)[k] = calloc(p->prog->nfloats + 1u, sizeof *dir);
        if (dir) memcpy(dir, dirs[k], program_floats(p->prog) * sizeof *dir);
        ok = dir && derived_push(&p->scene, dir);
    }
    return ok ? SLT_OK : status_fail(err, SLT_LIMIT, "out of memory");
}

void wide_directions_free(uint32_t n, double **dirs) {
    for (uint32_t k = 0; k < n && dirs; k++) free(dirs[k]);
    free(dirs);
}

double *wide_begin(const SltProgram *p, Wide *w, double *theirs, uint32_t rows, bool *failed) {
    *w = (Wide){.theirs = theirs, .rows = rows};
    if (!theirs || !p->prog->nderived) return theirs;
    w->own = calloc((size_t)rows * p->prog->nfloats + 1, sizeof *w->own);
    *failed |= !w->own;
    return w->own;
}

void wide_end(const SltProgram *p, Wide *w, bool errors, bool ok, bool *failed) {
    const uint32_t all = p->prog->nfloats, n = program_floats(p->prog);
    for (uint32_t row = 0; w->own && ok && row < w->rows; row++) {
        double *from = w->own + (size_t)row * all;
        *failed |= !(errors ? derived_pull_error(&p->scene, from) : derived_pull(&p->scene, from));
        for (uint32_t i = 0; i < n; i++) w->theirs[(size_t)row * n + i] = p->wrt[i] ? from[i] : 0;
    }
    free(w->own);
}
