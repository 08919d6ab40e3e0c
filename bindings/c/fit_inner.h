/* Inside slt_fit: the state of a fit, which the files fit*.c share. */
#ifndef SALTUS_BINDINGS_C_FIT_INNER_H
#define SALTUS_BINDINGS_C_FIT_INNER_H

#include "bindings/c/api.h"
#include "runtime/base/threads.h"
#include "runtime/optimise/optimise.h"
#include "saltus/fit.h"

/* A parameter that has another value in one view: where it lies, and that value. */
typedef struct OwnValue {
    ParamRef at;
    double *floats;
    int32_t *ints;
} OwnValue;

/* What another program has in common with the fit's: parameters of the same name and shape. */
typedef struct SharedParam {
    const Param *from, *to; /* of the fit's program, of the other */
} SharedParam;
typedef struct Share {
    SltProgram *p;
    SharedParam *part;
    uint32_t nparts;
} Share;

typedef struct View {
    const float *target, *mask; /* the caller's */
    OwnValue *values;
    uint32_t nvalues;
    SltProgram *p; /* that draws it: the fit's, or that of `share` */
    Share share;   /* share.p NULL: it is the fit's */
    size_t size;   /* floats of its image */
} View;

/* A loss that is a function of the shader: the program around it. */
typedef struct EntryLoss {
    Share share;
    uint32_t image, target; /* where their texels begin */
    double *gradient;       /* by its floats */
    float *each;            /* of pixels: the loss, and behind it their weights */
} EntryLoss;

struct SltFit {
    SltProgram *p;
    SltFitOptions opt; /* strings and lists in it are read by slt_fit_begin only */
    SltJob job;
    void (*progress)(void *user, double fraction); /* the caller's; that of `job` calls it */
    void *progress_user;
    char *checkpoint, key[256];
    View *views;
    uint32_t nviews;
    Optimiser *optimiser;
    OptimiseMethod method;
    uint32_t n, *index;     /* the active floats */
    double *gradient, *all; /* [n]; [nfloats] of the largest program, with minimize [channels][nfloats] */
    double *joined;         /* [nfloats]: the sum over shared parameters of views with programs of their own */
    EntryLoss *entry;       /* of opt.loss_entry */
    double *own_floats;     /* [nfloats], and own_ints [nints]: values in the view in hand, of the largest program */
    int32_t *own_ints;
    double *losses; /* [losses_cap] */
    double *latest; /* [nviews]: the last loss of each; NaN: not drawn yet */
    bool *drawn;    /* [nviews]: in this iteration */
    size_t losses_cap;
    size_t nvalues;         /* floats of the largest image */
    float *image;           /* of the first view, the latest */
    float *other, *adjoint; /* where fit_wants_adjoint: the image of any other view; what its values weigh */
    uint32_t iteration;     /* how many are done: the length of losses */
    double start;           /* by pool_now() */
    SltFitStop stop;
    char reason[512];
    bool unsaved; /* the checkpoint could not be written, and is not tried again */
};

/* ---- fit.c */
SltStatus fit_out_of_memory(SltError *err);
bool fit_room_for_losses(SltFit *f, size_t n);
/* `what` names the use in the error. */
SltStatus fit_find_param(const SltProgram *p, const char *name, const char *what, ParamRef *at, SltError *err);
void fit_set_active(SltFit *f, const double *x); /* the program's optimised floats */

/* Is the image drawn first, and its adjoint then met with the derivative? Squared differences need no such order. */
static inline bool fit_wants_adjoint(const SltFit *f) {
    return f->opt.loss || f->opt.loss_entry || f->opt.metric != SLT_FIT_L2;
}

/* Its number among those of all rounds. */
static inline uint32_t fit_number(const SltFit *f) { return f->opt.first + f->iteration; }

/* ---- fit_views.c */
SltStatus fit_read_views(SltFit *f, SltError *err);
void fit_free_views(SltFit *f);
/* The calls of a view get the program's parameters with the view's own values among them. */
void fit_use_view(SltFit *f, const View *v, SltJob *job);

/* ---- fit_share.c. Makes a list of what they share, and differentiates the other by what the fit optimises; part is
 * the caller's to free, also after an error. */
SltStatus fit_share_begin(Share *s, const SltProgram *mine, SltProgram *other, SltError *err);
void fit_share_values(const Share *s, const SltProgram *mine);
void fit_share_gradient(const Share *s, const double *of_other, double *gradient); /* adds to gradient */

/* ---- fit_entry.c: the loss that is the function `name`. fit_entry_loss writes the adjoint image into f->adjoint, and
 * into entry->gradient what the function reads of the fit's parameters. */
SltStatus fit_entry_begin(SltFit *f, const char *name, SltError *err);
SltStatus fit_entry_loss(SltFit *f, const View *v, const float *image, double *loss, SltError *err);
void fit_entry_free(SltFit *f);

/* ---- fit_optimiser.c: the optimiser, with rates, bounds, scales and smoothing. */
SltStatus fit_make_optimiser(SltFit *f, SltError *err);

/* ---- fit_resume.c: checkpoints. */
SltStatus fit_prepare_checkpoint(SltFit *f, SltError *err);
SltStatus fit_save(SltFit *f, SltError *err);

/* ---- fit_loss.c: the loss at the optimiser's point, and its derivative into f->gradient. */
SltStatus fit_evaluate(SltFit *f, double *loss, SltError *err);

#endif
