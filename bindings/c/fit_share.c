/* Parameters that another program, of a view or of a loss, has in common with the program of the fit: the same name and
 * shape. Before each estimate they take the fit's values, and behind it their derivatives join the fit's. */
#include <stdlib.h>
#include <string.h>

#include "bindings/c/fit_inner.h"

static const Param *param_named(const Program *p, const char *name) {
    for (uint32_t k = 0; k < p->nparams; k++)
        if (!strcmp(p->params[k].name, name)) return &p->params[k];
    return NULL;
}

SltStatus fit_share_begin(Share *s, const SltProgram *mine, SltProgram *other, SltError *err) {
    const Program *a = mine->prog, *b = other->prog;
    uint8_t *wrt = calloc(b->nfloats + 1, 1);
    s->p = other;
    s->part = calloc(b->nparams + 1, sizeof *s->part);
    if (!s->part || !wrt) {
        free(wrt);
        return fit_out_of_memory(err);
    }
    for (uint32_t k = 0; k < b->nparams; k++) {
        const Param *to = &b->params[k], *from = param_named(a, to->name);
        if (!from) continue;
        if (from->fcount != to->fcount || from->icount != to->icount) {
            free(wrt);
            return status_fail(err, SLT_USAGE, "`%s` has another shape in the shader `%s` of the fit", to->name,
                               b->entry);
        }
        s->part[s->nparts++] = (SharedParam){from, to};
        memcpy(wrt + to->fbase, mine->wrt + from->fbase, to->fcount);
    }
    api_derived_mark(other, wrt);
    api_differentiate(other, wrt);
    free(wrt);
    return SLT_OK;
}

void fit_share_values(const Share *s, const SltProgram *mine) {
    for (uint32_t k = 0; k < s->nparts; k++) {
        const Param *from = s->part[k].from, *to = s->part[k].to;
        if (memcmp(s->p->floats + to->fbase, mine->floats + from->fbase, to->fcount * sizeof(double)) != 0) {
            memcpy(s->p->floats + to->fbase, mine->floats + from->fbase, to->fcount * sizeof(double));
            api_params_changed(s->p, to->fbase, to->fcount);
        }
        memcpy(s->p->ints + to->ibase, mine->ints + from->ibase, to->icount * sizeof(int32_t));
    }
}

void fit_share_gradient(const Share *s, const double *of_other, double *gradient) {
    for (uint32_t k = 0; k < s->nparts; k++)
        for (uint32_t i = 0; i < s->part[k].to->fcount; i++)
            gradient[s->part[k].from->fbase + i] += of_other[s->part[k].to->fbase + i];
}
