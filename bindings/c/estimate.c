/* Estimating: each call makes sure of its kernels and hands the scene to the runtime. */
#include <math.h>
#include <stdlib.h>

#include "bindings/c/derived.h"
#include "bindings/c/place.h"
#include "compiler/pass/walk.h"
#include "runtime/base/threads.h"

static bool by_cells(const SltJob *j) { return j->estimator == SLT_EST_QUADRATURE || j->estimator == SLT_EST_AUTO; }

/* Where cells integrate these are called for what they leave over, and for little else; regions are always compared. */
static const bool of_lines[K_KINDS] = {[K_VALUE] = true, [K_EVENT] = true, [K_SITE] = true, [K_SITE_GRAD] = true};

static void value_needs(const SltJob *j, bool needs[K_KINDS]) {
    for (int k = 0; k < K_KINDS; k++) needs[k] = k == K_VALUE;
    if (by_cells(j)) needs[K_BOUNDS] = needs[K_EDGE] = needs[K_EDGE_BOUNDS] = needs[K_SIDES] = true;
}

/* Bounds of rays are asked for where shadows may be thinner than the lattice: runtime/sample/prove.h. Not beside
 * silhouettes: which ridge a ray meets is never settled, so bounds would cost and prove nothing. Of meshes, whose
 * bounds cost as much as many lines, and in images only where the near-miss probe is asked for. */
static bool proves_lines(const SltProgram *p, const SltJob *j) {
    const Fn *primal = p->prog->primal;
    bool shadows = false, silhouettes = false, meshes = false;
    for (uint32_t s = 0; s < primal->nsites; s++) {
        const SiteKind kind = primal->sites[s].kind;
        const bool shadow = kind == SITE_SHADOW || kind == SITE_MESH_HIT || kind == SITE_MESH_SHADOW;
        shadows |= shadow, silhouettes |= ir_site_of_ray(kind) && !shadow, meshes |= ir_site_of_mesh(kind);
    }
    bool wanted = j->integral && !meshes ? p->opt.near_miss != 0 : p->opt.near_miss > 0;
    return shadows && !silhouettes && wanted && j->estimator == SLT_EST_LATTICE && primal->dim == 2;
}

/* Over the steps of a fit bounds are worth compiling, where they tell which iterations of a long [Cull] loop a tile can
 * leave out: runtime/sample/narrow.h. Rays would ask them for more than that. */
static bool narrows_lists(const SltProgram *p, const SltJob *j) {
    const Fn *primal = p->prog->primal;
    if (!atomic_load(&p->fitted) || !p->prog->ncull || p->opt.interpret || by_cells(j) || primal->dim != 2)
        return false;
    for (uint32_t s = 0; s < primal->nsites; s++)
        if (ir_site_of_ray(primal->sites[s].kind)) return false;
    return pipeline_has_bounds(primal->body);
}

static void gradient_needs(const SltProgram *p, const SltJob *j, bool forward, bool needs[K_KINDS]) {
    value_needs(j, needs);
    if (slt_estimate_by_differences(j->estimator)) return;
    if (!j->no_interior) needs[forward ? K_JVP : K_VJP] = true;
    if (j->no_boundary) return;
    if (proves_lines(p, j)) needs[K_BOUNDS] = true;
    needs[K_REGION] = needs[K_EVENT] = needs[K_SIDES] = needs[K_SITE] = needs[K_SITE_GRAD] = true;
    needs[forward ? K_SITE_JVP : K_SITE_VJP] = true;
}

/* Before bounds have been asked: is it likely that they will have cells? */
static bool hopes(const ApiCall *c) { return slt_estimate_hopes(&c->p->scene, &c->job, api_event_bound(c->p)); }

/* May the kernels of edges be compiled before it is known that they are needed? Of a small program they take as long as
 * those of bounds; of a large one, ten times as long. Only where it is likely that bounds will ask for them. */
static bool small_edges(const ApiCall *c) {
    enum { SMALL = 64 }; /* instructions */
    return walk_fn_size(c->p->prog->primal) <= SMALL && pool_threads(c->job.threads, 2) > 1 && hopes(c);
}

/* Kernels of cells. Bounds come first: they may say that the others are not needed, which are compiled beside them
 * where a core would wait else. These are a module of their own: what they say decides what comes next, and the cache
 * keeps them whatever is differentiated. `soon`: what both estimators need, compiled in the same go; `lines`: what
 * lines need beside that, likewise where it is likely that they will be the estimator. */
static SltStatus settle(ApiCall *c, const bool soon[K_KINDS], const bool lines[K_KINDS]) {
    static const bool bounds[K_KINDS] = {[K_BOUNDS] = true},
                      cells[K_KINDS] = {[K_BOUNDS] = true, [K_EDGE] = true, [K_EDGE_BOUNDS] = true};
    SltStatus s = SLT_OK;
    /* These variants are for comparison: their sides are not the ones that cells ask for. */
    bool paper = c->p->opt.paper_argmin || c->p->opt.paper_forced;
    if (paper && c->job.estimator == SLT_EST_QUADRATURE)
        return status_fail(c->err, SLT_USAGE,
                           "quadrature has no use for the paper's variants: leave them, or the estimator");
    if (c->job.estimator == SLT_EST_AUTO) s = api_site_facts(c->p, c->err);
    if (s != SLT_OK) return s;
    if (c->job.estimator == SLT_EST_AUTO &&
        (paper || api_too_many_sites(c->p) || !slt_estimate_has_choice(&c->p->scene, &c->job)))
        c->job.estimator = SLT_EST_LATTICE;
    if (c->job.estimator == SLT_EST_AUTO) {
        bool all[K_KINDS];
        const bool likely = pool_threads(c->job.threads, 2) > 1 && !hopes(c);
        for (int k = 0; k < K_KINDS; k++) all[k] = soon[k] || (likely && lines[k]);
        s = api_call_kernels_beside(c, small_edges(c) ? cells : bounds, all);
        if (s == SLT_OK) c->job.estimator = slt_estimate_choose(&c->p->scene, &c->job, c->stats);
    }
    return s == SLT_OK && by_cells(&c->job) ? api_call_kernels_beside(c, cells, soon) : s;
}

/* With opt.rgba8 the value kernel writes pixels, which are no numbers to add up. */
static SltStatus begin(ApiCall *c, SltProgram *p, const SltJob *job, SltStats *stats, SltError *err) {
    SltStatus s = api_call_begin(c, p, job, stats, err);
    if (s != SLT_OK || !p->opt.rgba8 || p->opt.interpret) return s;
    return status_fail(err, SLT_USAGE, "a program compiled with rgba8 has pixels for values: slt_render_rgba8");
}

static SltStatus begin_render(ApiCall *c, SltProgram *p, const SltJob *job, SltStats *stats, SltError *err) {
    bool needs[K_KINDS];
    SltStatus s = begin(c, p, job, stats, err);
    if (s != SLT_OK) return s;
    /* Pixels are sampled unless they are to be exact. */
    if (c->job.estimator == SLT_EST_AUTO && c->job.interior != SLT_INTERIOR_QUADRATURE)
        c->job.estimator = SLT_EST_LATTICE;
    static const bool soon[K_KINDS] = {[K_VALUE] = true}, none[K_KINDS] = {false};
    s = settle(c, soon, none);
    value_needs(&c->job, needs);
    needs[K_PRUNE] = needs[K_PRUNED] = !by_cells(&c->job) && !c->job.integral;
    if (s == SLT_OK && needs[K_PRUNE]) s = api_site_facts(p, err);
    if (s == SLT_OK && needs[K_PRUNE] && api_lists_pay(p, (double)c->job.size[0] * c->job.size[1] * c->job.spp))
        (void)api_lists_begin(p);
    return s != SLT_OK ? s : api_call_kernels(c, needs);
}

/* What a gradient is of. */
typedef enum Gradient { OF_IMAGE, OF_LOSS, OF_INTEGRAL } Gradient;

static SltStatus begin_gradient(ApiCall *c, SltProgram *p, const SltJob *job, Gradient of, SltStats *stats,
                                SltError *err) {
    const bool forward = of == OF_IMAGE;
    bool needs[K_KINDS], soon[K_KINDS], lines[K_KINDS];
    SltStatus s = begin(c, p, job, stats, err);
    if (s != SLT_OK) return s;
    SltJob by_lines = c->job;
    by_lines.estimator = SLT_EST_LATTICE;
    gradient_needs(p, &by_lines, forward, soon);
    const bool f_comes_along = of == OF_INTEGRAL && soon[K_VJP]; /* so that its kernel may wait */
    for (int k = 0; k < K_KINDS; k++) {
        lines[k] = soon[k] && of_lines[k] && !(k == K_VALUE && f_comes_along);
        soon[k] &= !of_lines[k] && k != K_BOUNDS;
    }
    s = settle(c, soon, lines);
    if (s != SLT_OK) return s;
    gradient_needs(p, &c->job, forward, needs);
    const bool narrows = !needs[K_BOUNDS] && narrows_lists(p, &c->job);
    needs[K_BOUNDS] |= narrows;
    if (by_cells(&c->job)) return api_call_kernels_late(c, needs, of_lines);
    bool late[K_KINDS] = {[K_BOUNDS] = narrows, [K_VALUE] = of == OF_INTEGRAL && needs[K_VJP]};
    return api_call_kernels_late(c, needs, late);
}

/* Where single precision tells too few places apart, the caller is told. */
static void note_places(ApiCall *c, bool integral) {
    c->job.integral |= integral;
    double ulps = slt_estimate_ulps(&c->p->scene, &c->job);
    c->stats->ulps = ulps < SLT_FEW_ULPS ? ulps : 0;
}

/* And where it cannot hold their squares. */
static void note_ulps(ApiCall *c, bool integral) {
    if (!c->stats) return;
    note_places(c, integral);
    api_find_scale(c->p, &c->job, c->stats);
}

/* What is infinite or NaN stays so in the result; it is counted, and the first one's place is looked for. So are
 * samples that were left out because a derivative is infinite there: if they are not few, it is on an area. */
static void count_nonfinite(ApiCall *c, double *v, size_t n, bool derivative) {
    enum { FEW = 64 }; /* one in so many */
    if (!v || !c->stats) return;
    uint64_t bad = 0, left_out = derivative ? c->stats->nonfinite : 0;
    for (size_t i = 0; i < n && left_out * FEW > c->stats->evaluations; i++)
        if (v[i] != 0) v[i] = NAN;
    for (size_t i = 0; i < n; i++) bad += !isfinite(v[i]);
    c->stats->nonfinite += bad;
    Blame blame = {.derivative = derivative};
    if (bad || left_out) api_find_nonfinite(c->p, &c->job, &blame, c->stats);
}

/* The same of an image, or of one of derivatives in a direction. */
static void count_nonfinite_pixels(ApiCall *c, const float *image, const double *direction) {
    if (!image || !c->stats) return;
    bool one = c->job.integral;
    size_t w = one ? 1 : c->job.size[0], h = one ? 1 : c->job.size[1], d = one ? 1 : c->job.size[2];
    size_t channels = c->p->prog->channels, n = w * h * d * channels, first = n;
    uint64_t bad = 0;
    for (size_t i = 0; i < n; i++) {
        if (isfinite(image[i])) continue;
        if (!bad++) first = i / channels;
    }
    c->stats->nonfinite += bad;
    uint32_t pixel[3] = {(uint32_t)(first % w), (uint32_t)(first / w % h), (uint32_t)(first / w / h)};
    Blame blame = {.pixel = one ? NULL : pixel, .derivative = direction != NULL, .direction = direction};
    if (bad) api_find_nonfinite(c->p, &c->job, &blame, c->stats);
}

SltStatus slt_render(SltProgram *p, const SltJob *job, float *image, SltStats *stats, SltError *err) {
    ApiCall c;
    SltStatus s = begin_render(&c, p, job, stats, err);
    if (s == SLT_OK) s = slt_estimate_render(&p->scene, &c.job, 0, image, c.stats, err);
    if (c.p) api_lists_end(p);
    if (s == SLT_OK) count_nonfinite_pixels(&c, image, NULL);
    return api_call_end(&c, s);
}

SltStatus slt_eval(SltProgram *p, const SltJob *job, uint64_t n, const double *x, const uint32_t *streams, double *out,
                   SltStats *stats, SltError *err) {
    static const bool needs[K_KINDS] = {[K_VALUE] = true};
    ApiCall c;
    SltStatus s = begin(&c, p, job, stats, err);
    if (s == SLT_OK) s = api_call_kernels(&c, needs);
    if (s == SLT_OK) s = slt_estimate_points(&p->scene, &c.job, n, x, streams, out, c.stats, err);
    return api_call_end(&c, s);
}

/* What `after` has counted more than `before`; without counts, what the job's samples take at least. */
static uint64_t spent(const ApiCall *c, uint64_t before) {
    if (c->stats) return c->stats->evaluations - before;
    return c->job.samples;
}
static uint64_t counted(const ApiCall *c) { return c->stats ? c->stats->evaluations : 0; }

SltStatus slt_grad_images(SltProgram *p, const SltJob *job, uint32_t ndir, const double *const *dirs, float *const *out,
                          float *crossings, SltStats *stats, SltError *err) {
    ApiCall c;
    SltStatus s = begin_gradient(&c, p, job, OF_IMAGE, stats, err);
    if (s == SLT_OK) note_ulps(&c, false);
    uint64_t before = counted(&c);
    double **wide = NULL;
    if (s == SLT_OK) s = wide_directions(p, ndir, dirs, &wide, err);
    if (s == SLT_OK)
        s = slt_estimate_forward(&p->scene, &c.job, ndir, (const double *const *)wide, out, crossings, c.stats, err);
    for (uint32_t k = 0; s == SLT_OK && k < ndir; k++) count_nonfinite_pixels(&c, out[k], wide[k]);
    wide_directions_free(ndir, wide);
    if (s == SLT_OK) s = api_steep(&c, NULL, spent(&c, before));
    return api_call_end(&c, s);
}

/* The gradient of one image or loss, and its errors. */
typedef struct OneRow {
    Wide gradient, error;
    bool failed;
} OneRow;

static SltStatus row_begin(const SltProgram *p, OneRow *r, double **gradient, double **error, SltError *err) {
    *r = (OneRow){0};
    *gradient = wide_begin(p, &r->gradient, *gradient, 1, &r->failed);
    *error = wide_begin(p, &r->error, *error, 1, &r->failed);
    return r->failed ? status_fail(err, SLT_LIMIT, "out of memory") : SLT_OK;
}

static SltStatus row_end(const SltProgram *p, OneRow *r, SltStatus s, SltError *err) {
    wide_end(p, &r->gradient, false, s == SLT_OK, &r->failed);
    wide_end(p, &r->error, true, s == SLT_OK, &r->failed);
    return s == SLT_OK && r->failed ? status_fail(err, SLT_LIMIT, "out of memory") : s;
}

SltStatus slt_grad_adjoint(SltProgram *p, const SltJob *job, const float *adjoint, double *gradient,
                           double *stderr_bound, SltStats *stats, SltError *err) {
    const float *both[2] = {adjoint, adjoint};
    ApiCall c;
    SltStatus s = begin_gradient(&c, p, job, OF_LOSS, stats, err);
    if (s == SLT_OK) note_ulps(&c, false);
    uint64_t before = counted(&c);
    if (s == SLT_OK) {
        OneRow row;
        double *all = gradient, *errors = stderr_bound;
        s = row_begin(p, &row, &all, &errors, err);
        if (s == SLT_OK) s = slt_estimate_reverse(&p->scene, &c.job, both, all, errors, c.stats, err);
        s = row_end(p, &row, s, err);
    }
    if (s == SLT_OK) s = api_steep(&c, NULL, spent(&c, before));
    if (s == SLT_OK) count_nonfinite(&c, gradient, program_floats(p->prog), true);
    return api_call_end(&c, s);
}

SltStatus slt_grad_loss(SltProgram *p, const SltJob *job, const float *target, const float *mask, double *loss,
                        double *gradient, double *stderr_bound, float *image, SltStats *stats, SltError *err) {
    ApiCall c;
    SltStatus s = begin_gradient(&c, p, job, OF_LOSS, stats, err);
    if (s == SLT_OK) note_ulps(&c, false);
    uint64_t before = counted(&c);
    if (s == SLT_OK) {
        OneRow row;
        double *all = gradient, *errors = stderr_bound;
        s = row_begin(p, &row, &all, &errors, err);
        if (s == SLT_OK) s = slt_estimate_loss(&p->scene, &c.job, target, mask, loss, all, errors, image, c.stats, err);
        s = row_end(p, &row, s, err);
    }
    if (s == SLT_OK) s = api_steep(&c, NULL, spent(&c, before));
    if (s == SLT_OK) count_nonfinite(&c, gradient, program_floats(p->prog), true);
    return api_call_end(&c, s);
}

/* What lines have stepped over, and small things that no line has met: bounds find them. They are compiled for nothing
 * else, where that is no matter, or a site has no crossing at all. */
static SltStatus add_hidden(ApiCall *c, const SltHidden *seen, SltIntegral *out) {
    enum { SMALL = 1000 };
    static const bool bounds[K_KINDS] = {[K_BOUNDS] = true};
    const SltScene *scene = &c->p->scene;
    if (c->job.no_boundary || !out->gradient_stderr || !slt_estimate_by_lines(scene)) return SLT_OK;
    if (!slt_estimate_has_unmet(scene) && !scene->kernel[SLT_K_BOUNDS] && walk_fn_size(c->p->prog->primal) > SMALL)
        return SLT_OK;
    SltStatus s = seen ? SLT_OK : api_call_kernels(c, bounds);
    return s == SLT_OK ? slt_estimate_hidden(scene, &c->job, seen, out, c->stats, c->err) : s;
}

static void look(void *hidden) { slt_estimate_hidden_look(hidden); }

/* Begins with the first of these, on the call's second thread, where bounds are compiled and it is likely that lines
 * will be asked; NULL: not begun. */
static SltHidden *begin_hidden(const ApiCall *c, SideWork *work) {
    Side *side = c->p->scene.side;
    SltHidden *h = side->may && !c->job.no_boundary ? slt_estimate_hidden_new(&c->p->scene, &c->job) : NULL;
    *work = (SideWork){.run = look, .arg = h};
    if (!h || side_add(side, work)) return h;
    slt_estimate_hidden_free(h);
    return NULL;
}

/* note_ulps of an integral, whose second part runs on the call's other thread. */
typedef struct Noted {
    ApiCall *c;
    SltJob job;
    SltStats own; /* what it finds, until notes_end */
    SideWork work;
} Noted;

static void find_scale(void *arg) {
    Noted *n = arg;
    api_find_scale(n->c->p, &n->job, &n->own);
}

/* beside: that thread lives. Nothing else uses the session until notes_end but kernels that are compiled late, which
 * wait; what geometries say of their queries is for one thread at a time. */
static void notes_begin(Noted *n, ApiCall *c, bool beside) {
    *n = (Noted){.c = c};
    n->work = (SideWork){.run = find_scale, .arg = n, .yields = true}; /* nothing waits for it until the end */
    if (!c->stats) return;
    note_places(c, true);
    n->job = c->job;
    if (beside && !c->p->prog->ngeometries && side_add(&c->side, &n->work)) return;
    api_find_scale(c->p, &c->job, c->stats);
}

static void notes_end(Noted *n) {
    const bool beside = n->work.state != SIDE_NONE;
    side_finish(&n->c->side, &n->work);
    if (beside) n->c->stats->out_of_range = n->own.out_of_range, n->c->stats->out_of_range_at = n->own.out_of_range_at;
}

/* The arrays of an integral by parameter, as the runtime fills them. */
enum { INTEGRAL_ROWS = 6 };
typedef struct IntegralRows {
    Wide row[INTEGRAL_ROWS];
    bool failed;
} IntegralRows;

static void integral_rows(SltIntegral *v, double **of[INTEGRAL_ROWS], bool errors[INTEGRAL_ROWS]) {
    double **const all[INTEGRAL_ROWS] = {&v->gradient,        &v->interior,        &v->boundary,
                                         &v->missed_estimate, &v->gradient_stderr, &v->left_bound};
    for (int k = 0; k < INTEGRAL_ROWS; k++) of[k] = all[k], errors[k] = k >= 4;
}

static SltStatus rows_begin(const SltProgram *p, IntegralRows *r, SltIntegral *v, SltError *err) {
    double **of[INTEGRAL_ROWS];
    bool errors[INTEGRAL_ROWS];
    *r = (IntegralRows){0};
    integral_rows(v, of, errors);
    for (int k = 0; k < INTEGRAL_ROWS; k++) *of[k] = wide_begin(p, &r->row[k], *of[k], p->prog->channels, &r->failed);
    return r->failed ? status_fail(err, SLT_LIMIT, "out of memory") : SLT_OK;
}

static SltStatus rows_end(const SltProgram *p, IntegralRows *r, SltIntegral *v, SltStatus s, SltError *err) {
    double **of[INTEGRAL_ROWS];
    bool errors[INTEGRAL_ROWS];
    integral_rows(v, of, errors);
    for (int k = 0; k < INTEGRAL_ROWS; k++) {
        wide_end(p, &r->row[k], errors[k], s == SLT_OK, &r->failed);
        *of[k] = r->row[k].theirs;
    }
    return s == SLT_OK && r->failed ? status_fail(err, SLT_LIMIT, "out of memory") : s;
}

SltStatus slt_grad_integral(SltProgram *p, const SltJob *job, SltIntegral *out, SltStats *stats, SltError *err) {
    SltIntegral wanted = SLT_INTEGRAL_INIT;
    if (!api_struct_read(&wanted, sizeof wanted, out)) return api_struct_unknown(err, "SltIntegral");
    ApiCall c;
    SltStatus s = begin_gradient(&c, p, job, OF_INTEGRAL, stats, err);
    uint8_t *met = s == SLT_OK ? calloc(p->scene.nsites + 1, 1) : NULL;
    double followed = 0;
    SideWork work = {0};
    Noted noted;
    if (s == SLT_OK) p->scene.met = met, p->scene.followed = &followed; /* without memory nobody asks */
    SltHidden *hidden = met && wanted.gradient_stderr ? begin_hidden(&c, &work) : NULL;
    if (s == SLT_OK) notes_begin(&noted, &c, hidden != NULL);
    uint64_t before = counted(&c);
    bool derives = wanted.gradient || wanted.gradient_stderr;
    if (s == SLT_OK) {
        IntegralRows rows;
        s = rows_begin(p, &rows, &wanted, err);
        if (s == SLT_OK) s = slt_estimate_integral(&p->scene, &c.job, &wanted, c.stats, err);
        side_finish(&c.side, &work), notes_end(&noted);
        if (s == SLT_OK) s = add_hidden(&c, hidden, &wanted);
        p->scene.met = NULL, p->scene.followed = NULL;
        if (s == SLT_OK && derives) s = api_steep(&c, &wanted, spent(&c, before));
        s = rows_end(p, &rows, &wanted, s, err);
    }
    free(met), slt_estimate_hidden_free(hidden);
    c.job.integral = true;
    if (s == SLT_OK) count_nonfinite(&c, wanted.value, p->prog->channels, false);
    if (s == SLT_OK) count_nonfinite(&c, wanted.gradient, (size_t)p->prog->channels * program_floats(p->prog), true);
    if (s == SLT_OK) api_struct_write(out, &wanted, sizeof wanted);
    return api_call_end(&c, s);
}

SltStatus slt_crossing(SltProgram *p, const SltJob *job, const double a[3], const double b[3], uint32_t stream,
                       SltCrossing *out, SltError *err) {
    SltJob own = SLT_JOB_INIT, values = SLT_JOB_INIT;
    if (!api_struct_sized(out)) return api_struct_unknown(err, "SltCrossing");
    if (job && !api_struct_read(&own, sizeof own, job)) return api_struct_unknown(err, "SltJob");
    values.floats = own.floats, values.ints = own.ints, values.estimator = SLT_EST_LATTICE;
    ApiCall c;
    SltCrossing found = SLT_CROSSING_INIT;
    SltStatus s = begin_gradient(&c, p, &values, OF_IMAGE, NULL, err);
    if (s == SLT_OK) s = slt_estimate_crossing(&p->scene, a, b, stream, &found, err);
    if (s == SLT_OK) api_struct_write(out, &found, sizeof found);
    return api_call_end(&c, s);
}
