/* Estimators with cells: integrals, images and their derivatives by quadrature where bounds prove what happens, by
 * lines and samples in what is left over. The functions are those of runtime/sample/estimate.h, which calls them;
 * arguments are the same.
 *
 * Everything is integrated by two rules, whose distance is the stated error; with an error wanted the sweep over the
 * domain is repeated with more points and smaller cells until it is reached. docs/estimators.md says more. */
#ifndef SALTUS_QUADRATURE_QUADRATURE_H
#define SALTUS_QUADRATURE_QUADRATURE_H

#include "runtime/sample/estimate.h"

/* Can there be cells? Never with rand(), whose numbers are a dimension more, nor with [SkipLoop] boundaries. */
bool quadrature_may(const SltScene *s);
/* And has the scene the kernels that they need? */
bool quadrature_can(const SltScene *s);
/* False where SLT_EST_AUTO is the lattice whatever bounds say. */
bool quadrature_hopes(const SltScene *s, const SltJob *j);
/* Before there is any kernel: is it likely that cells will pay, where a sample decides about so many events? Each takes
 * some cells, of which an integral of few samples has none to spare. */
bool quadrature_likely(const SltScene *s, const SltJob *j, uint64_t events);
/* SLT_EST_QUADRATURE or SLT_EST_LATTICE for a job: what SLT_EST_AUTO means there. quadrature_choose asks the program's
 * bounds alone; if they look well, quadrature_try makes cells of a few tiles, with all kernels. */
SltEstimator quadrature_choose(const SltScene *s, const SltJob *j, SltStats *stats);
SltEstimator quadrature_try(const SltScene *s, const SltJob *j, SltStats *stats);

/* turned (may be NULL): set, with nothing in `out`, where the first cells show that the lattice does better. */
SltStatus quadrature_integral(const SltScene *s, const SltJob *j, SltIntegral *out, bool *turned, SltStats *stats,
                              SltError *err);
SltStatus quadrature_render(const SltScene *s, const SltJob *j, float *out, SltStats *stats, SltError *err);
SltStatus quadrature_forward(const SltScene *s, const SltJob *j, uint32_t ndir, const double *const *dirs,
                             float *const *out, float *crossings, SltStats *stats, SltError *err);
SltStatus quadrature_reverse(const SltScene *s, const SltJob *j, const float *adjoint, double *gradient,
                             double *stderr_bound, SltStats *stats, SltError *err);
/* Under the box filter alone. */
SltStatus quadrature_loss(const SltScene *s, const SltJob *j, const float *target, const float *mask, double *loss,
                          double *gradient, float *image, SltStats *stats, SltError *err);

#endif
