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
 * The parameters that slt_wrt names are optimised, within [Range], on the scale of [Log], starting from the program's
 * values. `saltus fit` is made of these functions: the same problem gives the same bits there and here, on any number
 * of threads, in one go or resumed from a checkpoint.
 *
 * Until slt_fit_end nobody else may set the optimised parameters; slt_wrt and another fit are refused, and
 * slt_program_free does nothing. Callbacks run on the calling thread between estimates and may look at the program
 * (slt_render, slt_floats). Structs begin with their size, as job.h explains; those without a size never change. */
#ifndef SALTUS_FIT_H
#define SALTUS_FIT_H

#include "saltus/saltus.h"

#ifdef __cplusplus
extern "C" {
#endif

/* An image to match. */
typedef struct SltFitView {
    size_t struct_size;   /* in an array of views also the distance in bytes from one to the next */
    const float *target;  /* the image to match, at the job's size. NULL where SltFitOptions.loss is set */
    const float *mask;    /* of the same shape: weights of the differences; NULL: 1 */
    const SltSet *values; /* [nvalues]: values, as slt_set_text takes them, that parameters have in this view alone */
    uint32_t nvalues;
    /* Another program, often the same source with another entry, draws this view: its parameters of the same name have
     * the fit's values, the others keep their own, and `values` are of it. Of the same dimension; NULL: the fit's own.
     * Until slt_fit_end it may not be freed, and slt_wrt of it is the fit's. */
    SltProgram *program;
} SltFitView;
#define SLT_FIT_VIEW_INIT ((SltFitView){.struct_size = sizeof(SltFitView)})

/* A number for a parameter or component ("discs[3].centre"), or in rates for many ("discs[*].centre"). */
typedef struct SltFitNumber {
    const char *name; /* NULL in `rates`: for all parameters */
    double value;
} SltFitNumber;

/* Factors of a parameter's learning rate, one for each cell of its grid: 0 holds the cell, 1 moves it, between is
 * slower. The grid of a texture or heightfield is its width and height (of a
 * texture3D its slices below each other); of any other parameter the rows and columns of
 * its elements. */
typedef struct SltFitMask {
    const char *name; /* of the parameter */
    uint32_t width, height;
    const float *factors; /* [height][width], top row first; finite and >= 0 */
} SltFitMask;

/* An image whose loss is wanted. Valid during the call. */
typedef struct SltFitRequest {
    size_t struct_size;
    uint32_t iteration, view;     /* both from 0 */
    uint32_t views;               /* how many views there are */
    uint32_t pixels[3], channels; /* the image's size along x, y, z; 1 beyond the program's dimension */
    const float *image;           /* as slt_render draws it */
} SltFitRequest;
/* Sets *loss and the adjoint image, the derivative of the loss with respect to every value of the image. The fit's loss
 * is the mean over the views. A loss of NaN makes the optimiser step back (no adjoint is wanted then); any status but
 * SLT_OK ends the fit, which returns it with this err. */
typedef SltStatus SltFitLoss(void *user, const SltFitRequest *request, double *loss, float *adjoint, SltError *err);

/* One evaluation: at which parameters, and what came out. Valid during the call. */
typedef struct SltFitIteration {
    size_t struct_size;
    uint32_t iteration; /* evaluations done with this one, those before it in earlier rounds (first) or before a resume
                           included */
    uint32_t count;     /* floats that are optimised */
    const uint32_t *index;               /* [count]: where each lies in slt_floats, ascending */
    const double *parameters, *gradient; /* [count] */
    double loss;                         /* of this evaluation */
    double best;        /* the least loss so far, this one included, or where losses are noisy the last of those that
                           noise does not tell from it; infinite while all were NaN */
    const float *image; /* of the first view; NULL with minimize */
} SltFitIteration;
typedef bool SltFitIterated(void *user, const SltFitIteration *at); /* true: stop here */

/* What a difference d between image and target weighs. */
typedef enum SltFitMetric {
    SLT_FIT_L2,   /* d^2 */
    SLT_FIT_L1,   /* |d| */
    SLT_FIT_HUBER /* d^2 / 2 up to |d| = delta, from there on delta (|d| - delta / 2) */
} SltFitMetric;

typedef enum SltFitSchedule { SLT_FIT_CONSTANT, SLT_FIT_EXPONENTIAL, SLT_FIT_COSINE } SltFitSchedule;

typedef struct SltFitOptions {
    size_t struct_size;
    /* Size, samples, filter, seed, threads, estimator of every estimate. time_limit and cancel hold for the whole fit,
     * and so does what progress, called while estimates run, says: the part of the iterations that is done. floats and
     * ints do not count. NULL: SLT_JOB_INIT. */
    const SltJob *job;
    /* The loss is one of three. With views alone: the mean of slt_grad_loss over them, or of `metric`. With `loss`: the
     * mean of what it says of every view's image (without views, of the one image of the program). With minimize: the
     * integral of the entry, its channels added (job.samples 0: 2^18). */
    const SltFitView *views; /* [nviews] */
    uint32_t nviews;
    SltFitLoss *loss;
    void *loss_user;
    const char *loss_name; /* identifies `loss` in checkpoints; may be NULL */
    bool minimize;
    /* The optimiser: a name that slt_fit_optimizer gives; NULL: "adam". A 0 in the numbers below means the default that
     * follows the colon. */
    const char *optimizer;
    uint32_t iterations;       /* evaluations in all, those before a resume included, of earlier rounds not; 0: none */
    const SltFitNumber *rates; /* [nrates]: learning rates, 0 holds; later ones override. 0.01, L-BFGS 0.1 */
    uint32_t nrates;
    const SltFitMask *rate_masks; /* [nrate_masks]: factors of the rates */
    uint32_t nrate_masks;
    const SltFitNumber *smooth; /* [nsmooth]: lambda >= 0 of the Laplacian preconditioning of a texture, heightfield or
                                   array */
    uint32_t nsmooth;
    double beta1, beta2, epsilon; /* Adam: 0.9, 0.999, 1e-8 */
    double momentum;              /* SGD, below 1: 0 */
    uint32_t history;             /* L-BFGS, pairs kept: 10 */
    double gradient_tolerance;    /* converged when no component of the gradient is larger: exactly zero */
    double loss_tolerance;        /* converged when the best loss fell by less than this part of itself ... */
    uint32_t patience;            /* ... in so many iterations: never; L-BFGS 1e-12 in 3 */
    uint32_t max_failures;        /* evaluations in a row that are not finite before the fit fails: 10 */
    /* Files. */
    const char *checkpoint; /* where the state is saved, at the end and as `every` says; NULL: nowhere */
    uint32_t every;         /* iterations between saves; 0: only at the end */
    const char *resume; /* a checkpoint of the same problem to go on from; NULL: from the start. Where it has as many
                           iterations as wanted, or more, nothing is left to do */
    SltFitIterated *iterated; /* called after every evaluation, before the optimiser's step; may be NULL */
    void *iterated_user;
    SltStats *stats; /* the caller's until slt_fit_end: counts of all estimates are added to it; may be NULL */
    /* Of views alone: the mean over pixels and channels of mask * metric(image - target). The derivatives of L1 and
     * Huber are of other samples than the image that they weigh. */
    SltFitMetric metric;
    double huber_delta; /* > 0: 0.1 */
    /* A function `float NAME(floatC image, floatC target)` of the program, C its channels: the loss is its mean over
     * pixels, weighed by the masks. It is differentiated as it is between its jumps. NULL: the metric is the loss. */
    const char *loss_entry;
    /* How the learning rates change: of first-order optimisers. SLT_FIT_EXPONENTIAL: times `decay` an iteration;
     * SLT_FIT_COSINE: half a cosine, from the rate to 0 over all iterations. */
    SltFitSchedule schedule;
    uint32_t views_per_step; /* so many views an iteration, chosen by the seed, none twice; 0: all. The loss is then the
                                mean over the views seen so far of the last loss of each. First-order optimisers only */
    double decay;            /* above 0, at most 1 */
    /* Of parameters in `smooth` that are vertices of a mesh: `value` is the name of an integer parameter with three
     * numbers of vertices a face, whose edges are the neighbours. The others are grids, of up to three dimensions. */
    const SltSet *smooth_faces; /* [nsmooth_faces] */
    uint32_t nsmooth_faces;
    /* Of a fit that is one of several rounds, between which the caller changes parameters: how many evaluations the
     * rounds before had, from where numbers of iterations, random numbers and the schedule go on; and how many all
     * rounds have for the schedule, 0: no more than these and this fit's. */
    uint32_t first, planned;
    /* Of parameters in `smooth` that are grids in one list, `param float g[N * N * N]`: "WxH" or "WxHxD", the fastest
     * index first. */
    const SltSet *smooth_grids; /* [nsmooth_grids] */
    uint32_t nsmooth_grids;
} SltFitOptions;
#define SLT_FIT_OPTIONS_INIT ((SltFitOptions){.struct_size = sizeof(SltFitOptions), .iterations = 200, .every = 10})

typedef enum SltFitStop {
    SLT_FIT_RUNNING,
    SLT_FIT_ITERATIONS, /* all were done */
    SLT_FIT_CONVERGED,
    SLT_FIT_STOPPED,     /* by `iterated`, or by slt_fit_end before the fit was over */
    SLT_FIT_INTERRUPTED, /* job.cancel; status SLT_INTERRUPTED */
    SLT_FIT_TIME_LIMIT,  /* job.time_limit; status SLT_LIMIT */
    SLT_FIT_FAILED       /* with the status of what failed; a loss that stays non-finite: SLT_CHECK_FAILED */
} SltFitStop;

typedef struct SltFitResult {
    size_t struct_size;
    SltFitStop stop;
    uint32_t iterations;       /* evaluations, those before a resume included */
    double initial_loss, loss; /* the first and the best (infinite if none was finite); NaN without iterations */
    double *losses;            /* [iterations], malloc'd: the caller frees it */
    char reason[512];          /* why the fit stopped, in words; may be "" */
} SltFitResult;
#define SLT_FIT_RESULT_INIT ((SltFitResult){.struct_size = sizeof(SltFitResult)})

/* The name of optimiser `index` ("adam", "sgd", "lbfgs"); NULL beyond the last. */
const char *slt_fit_optimizer(uint32_t index);

/* The whole fit; afterwards the program has the best parameters that were found. SLT_OK also when the fit converged or
 * `iterated` stopped it. The result is filled whatever the status. result and err may be NULL.
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
/* Checks everything, and resumes. *out is the caller's, for slt_fit_end; NULL after an error. Targets and masks of
 * views and what job.cancel points at must live until slt_fit_end; all else is copied. */
SltStatus slt_fit_begin(SltProgram *p, const SltFitOptions *options, SltFit **out, SltError *err);
/* One evaluation and one step of the optimiser; *stop is SLT_FIT_RUNNING while there is another to do. After the last,
 * or after an error, does nothing and returns SLT_OK. */
SltStatus slt_fit_step(SltFit *fit, SltFitStop *stop, SltError *err);
/* Between steps: the image of a view, at the parameters of the next evaluation, or with `best` at the best so far. Of
 * the view's size and channels; job NULL: that of the fit, and of any other floats and ints do not count. */
SltStatus slt_fit_image(SltFit *fit, uint32_t view, bool best, const SltJob *job, float *image, SltError *err);
/* Saves the checkpoint, gives the program the best parameters found, and frees the fit (NULL: does nothing). SLT_USAGE:
 * the program is in use; the fit is still there. */
SltStatus slt_fit_end(SltFit *fit, SltFitResult *result, SltError *err);

#ifdef __cplusplus
}
#endif
#endif
