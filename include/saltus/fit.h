/* Fitting: parameters that make images match targets, or that minimise an integral or a loss of the caller's.
 *
 *     SltFitView view = SLT_FIT_VIEW_INIT;
 *     view.target = pixels;                                  // [height][width][channels], as slt_render draws it
 *     SltFitOptions fit = SLT_FIT_OPTIONS_INIT;
 *     fit.job = &job, fit.views = &view, fit.nviews = 1;
 *     SltFitResult result = SLT_FIT_RESULT_INIT;
 *     status = slt_fit(p, &fit, &result, &err);              // p has the best parameters that were found
 *     free(result.losses);
 *
 * What is optimised is what slt_wrt names, within [Range], on the scale of [Log]; it starts from the values that the
 * program has. `saltus fit` is made of these functions: the same problem gives the same bits there and here, on any
 * number of threads, in one go or resumed from a checkpoint.
 *
 * The program is used throughout: until slt_fit_end nobody else may set what is optimised or change slt_wrt. Callbacks
 * run on the calling thread between estimates and may use the program to look (slt_render, slt_floats). Structs begin
 * with their size, as in job.h; those without one never change. */
#ifndef SALTUS_FIT_H
#define SALTUS_FIT_H

#include "saltus/saltus.h"

#ifdef __cplusplus
extern "C" {
#endif

/* An image to match. */
typedef struct SltFitView {
    size_t struct_size;   /* in an array also from one view to the next */
    const float *target;  /* at the job's size: [pixels][channels], top row first. NULL with a loss of the caller's */
    const float *mask;    /* the same shape: weights of the squared differences; NULL: 1 */
    const SltSet *values; /* parameters that this view sees with a value of its own, as slt_set_text takes it */
    uint32_t nvalues;
} SltFitView;
#define SLT_FIT_VIEW_INIT ((SltFitView){.struct_size = sizeof(SltFitView)})

/* A number for a parameter or component ("discs[3].centre"); name NULL: for all. */
typedef struct SltFitNumber {
    const char *name;
    double value;
} SltFitNumber;

/* Factors of a parameter's learning rate, one for each cell of its grid: 0 holds the cell, 1 moves it, between is
 * slower. Of a texture or heightfield: its width and height; of anything else: rows and columns of its elements. */
typedef struct SltFitMask {
    const char *name;
    uint32_t width, height;
    const float *factors; /* [height][width], top row first; finite and not negative */
} SltFitMask;

/* An image whose loss is wanted. */
typedef struct SltFitRequest {
    size_t struct_size;
    uint32_t iteration, view, views; /* from 0; how many views */
    uint32_t pixels[3], channels;    /* the image's size; 1 beyond the program's dimension */
    const float *image;              /* as slt_render draws it */
} SltFitRequest;
/* Sets *loss and the adjoint image, the derivative of the loss with respect to every value of the image. The fit's loss
 * is the mean over the views. A loss of NaN makes the optimiser step back (no adjoint is wanted then); any status but
 * SLT_OK ends the fit, which returns it with this err. */
typedef SltStatus SltFitLoss(void *user, const SltFitRequest *request, double *loss, float *adjoint, SltError *err);

/* One evaluation: where, and what came out. Valid during the call. */
typedef struct SltFitIteration {
    size_t struct_size;
    uint32_t iteration;                  /* how many are done with this one, also before a resume */
    uint32_t count;                      /* floats that are optimised */
    const uint32_t *index;               /* [count] where each lies in slt_floats, ascending */
    const double *parameters, *gradient; /* [count] */
    double loss, best;                   /* of this one; the least so far with it (infinite while all were NaN) */
    const float *image;                  /* of the first view; NULL with minimize */
} SltFitIteration;
typedef bool SltFitIterated(void *user, const SltFitIteration *at); /* true: stop here */

typedef struct SltFitOptions {
    size_t struct_size;
    /* Size, samples, filter, seed, threads, estimator. time_limit and cancel are of the whole fit; progress, floats and
     * ints do not count. NULL: SLT_JOB_INIT. */
    const SltJob *job;
    /* The loss, one of three: the mean over the views of slt_grad_loss; `loss` of every view's image (no views: of one
     * as the program is); with minimize the integral of the entry, its channels added (samples 0: 2^18). */
    const SltFitView *views;
    uint32_t nviews;
    SltFitLoss *loss;
    void *loss_user;
    const char *loss_name; /* says in checkpoints which loss it is; may be NULL */
    bool minimize;
    /* The optimiser: one of slt_fit_optimizer; NULL: "adam". Zeros below mean the defaults named. */
    const char *optimizer;
    uint32_t iterations;       /* evaluations, with those before a resume */
    const SltFitNumber *rates; /* learning rates; what comes later overrides. Default 0.01, L-BFGS 0.1 */
    uint32_t nrates;
    const SltFitMask *rate_masks; /* applied to the rates */
    uint32_t nrate_masks;
    const SltFitNumber *smooth; /* lambda of the Laplacian preconditioning of a texture, heightfield or array */
    uint32_t nsmooth;
    double beta1, beta2, epsilon; /* Adam: 0.9, 0.999, 1e-8 */
    double momentum;              /* SGD: 0 */
    uint32_t history;             /* L-BFGS, pairs: 10 */
    double gradient_tolerance;    /* converged when no component is larger: only when all are zero */
    double loss_tolerance;        /* converged when the best loss fell by less than this part of itself over ... */
    uint32_t patience;            /* ... so many iterations: off, L-BFGS 1e-12 over 3 */
    uint32_t max_failures;        /* evaluations in a row that are not finite before the fit fails: 10 */
    /* Files. */
    const char *checkpoint;   /* the state is saved here after every `every` iterations and at the end; NULL: not */
    uint32_t every;           /* 0: only at the end */
    const char *resume;       /* a checkpoint of the same problem to go on from; NULL: from the start */
    SltFitIterated *iterated; /* after every evaluation, before the optimiser's step; may be NULL */
    void *iterated_user;
    SltStats *stats; /* gets what the estimates count, added up; may be NULL. The caller's, until slt_fit_end */
} SltFitOptions;
#define SLT_FIT_OPTIONS_INIT ((SltFitOptions){.struct_size = sizeof(SltFitOptions), .iterations = 200, .every = 10})

typedef enum SltFitStop {
    SLT_FIT_RUNNING,
    SLT_FIT_ITERATIONS, /* all were done */
    SLT_FIT_CONVERGED,
    SLT_FIT_STOPPED,     /* by `iterated`, or slt_fit_end before it was over */
    SLT_FIT_INTERRUPTED, /* job.cancel; status SLT_INTERRUPTED */
    SLT_FIT_TIME_LIMIT,  /* job.time_limit; status SLT_LIMIT */
    SLT_FIT_FAILED       /* with the status of what failed; a loss that stays non-finite: SLT_CHECK_FAILED */
} SltFitStop;

typedef struct SltFitResult {
    size_t struct_size;
    SltFitStop stop;
    uint32_t iterations;       /* evaluations, with those before a resume */
    double initial_loss, loss; /* the first and the best (infinite if none was finite); NaN without iterations */
    double *losses;            /* [iterations], malloc'd: the caller frees it */
    char reason[512];          /* why it stopped, in words; may be "" */
} SltFitResult;
#define SLT_FIT_RESULT_INIT ((SltFitResult){.struct_size = sizeof(SltFitResult)})

/* Names of optimisers, in the order of their rows; NULL beyond the last. */
const char *slt_fit_optimizer(uint32_t index);

/* The whole fit. SLT_OK also when it converged or was stopped by `iterated`. The result is filled whatever the status.
 * result and err may be NULL.
 *
 * SLT_USAGE: options that contradict each other, an unknown parameter or optimiser, nothing to optimise; SLT_INPUT: a
 * view's values, a mask or the checkpoint do not fit the program; SLT_OUTPUT: the checkpoint could not be written. */
SltStatus slt_fit(SltProgram *p, const SltFitOptions *options, SltFitResult *result, SltError *err);

/* The same in steps, for callers with a loop of their own:
 *
 *     status = slt_fit_begin(p, &options, &fit, &err);
 *     while (status == SLT_OK && stop == SLT_FIT_RUNNING) status = slt_fit_step(fit, &stop, &err);
 *     ended = slt_fit_end(fit, &result, &err);
 */
typedef struct SltFit SltFit;
/* Checks everything, and resumes. NULL in *out after an error. Targets and masks of views must live until slt_fit_end;
 * all else is copied. */
SltStatus slt_fit_begin(SltProgram *p, const SltFitOptions *options, SltFit **out, SltError *err);
/* One evaluation and one step of the optimiser; *stop says whether there is another to do. When there is none, or after
 * an error, it does nothing and returns SLT_OK. */
SltStatus slt_fit_step(SltFit *fit, SltFitStop *stop, SltError *err);
/* Saves the checkpoint, gives the program the best parameters found, and frees the fit (NULL: does nothing). */
SltStatus slt_fit_end(SltFit *fit, SltFitResult *result, SltError *err);

#ifdef __cplusplus
}
#endif
#endif
