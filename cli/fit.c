/* saltus fit: parameters that make the image match its targets, or that minimise the integral. The fit itself is the
 * library's (saltus/fit.h); here are the scene, the images, the pipe to a loss program, and what is written. */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "cli/fit.h"
#include "cli/loss.h"
#include "runtime/base/text.h"
#include "saltus/fit.h"

enum { FRAMES = 6 };

typedef struct Fit {
    Cli *c;
    SltProgram *p;
    Scene scene;
    SltFitOptions opt;
    SltFitView *views;
    SltFitMask *masks; /* their factors are malloc'd */
    SltFitNumber *rates, *smooth;
    LossProgram *loss; /* of --loss-command, while it runs */
    Progress progress;
    Image frames[FRAMES]; /* of the first view, spread over the fit; of a folder only */
    uint32_t nframes;     /* taken so far */
    double start;
    SltFitResult result;
    SltStats stats;
} Fit;

/* ---- set-up */
static bool on_command_line(const Cli *c, const char *name) {
    for (uint32_t k = 0; k < c->nparams; k++)
        if (!strcmp(c->params[k].name, name)) return true;
    return false;
}

/* Wrong usage of the library is a mistake in the scene; other causes keep their status. */
static int fail_scene(Fit *f, SltError *err) {
    if (err->status == SLT_USAGE) err->status = SLT_INPUT;
    return cli_fail(f->c, err);
}

static int apply_scene_params(Fit *f) {
    SltError err = {0};
    const char *names[CLI_MAX_LIST];
    uint32_t nnames = 0;
    bool any_grad = false;
    for (uint32_t k = 0; k < f->scene.nparams; k++) any_grad |= f->scene.params[k].grad == 1;
    for (uint32_t k = 0; k < f->scene.nparams; k++) {
        FitParam *q = &f->scene.params[k];
        SltParam found = SLT_PARAM_INIT;
        if (slt_param_find(f->p, q->name, &found, &err) != SLT_OK) return fail_scene(f, &err);
        bool set = !on_command_line(f->c, q->name);
        if (set && q->value && slt_set_text(f->p, q->name, q->value, &err) != SLT_OK) return fail_scene(f, &err);
        if (set && q->file) {
            char *at = cli_need(malloc(strlen(q->file) + 2));
            sprintf(at, "@%s", q->file);
            SltStatus status = slt_set_text(f->p, q->name, at, &err);
            free(at);
            if (status != SLT_OK) return cli_fail(f->c, &err);
        }
        if (q->grad == 1 && nnames < CLI_MAX_LIST) names[nnames++] = q->name;
    }
    /* Where a parameter has "grad": true, those that have it are optimised; else all but those with false. */
    if (f->c->nwrt) return SLT_OK;
    if (!any_grad)
        for (uint32_t i = 0; i < slt_param_count(f->p); i++) {
            SltParam q = SLT_PARAM_INIT;
            slt_param(f->p, i, &q);
            bool off = !q.differentiable || !q.fcount;
            for (uint32_t k = 0; k < f->scene.nparams; k++)
                off |= f->scene.params[k].grad == 0 && !strcmp(f->scene.params[k].name, q.name);
            if (!off && nnames < CLI_MAX_LIST) names[nnames++] = q.name;
        }
    if (f->scene.nparams && nnames && slt_wrt(f->p, names, nnames, &err) != SLT_OK) return fail_scene(f, &err);
    return SLT_OK;
}

/* From the general to the particular: a rate for all, the scene's, the command line's by name. */
static int collect_numbers(Fit *f) {
    Cli *c = f->c;
    SltFitOptions *o = &f->opt;
    f->rates = cli_need(calloc(c->nlr + f->scene.nparams + 1, sizeof *f->rates));
    f->smooth = cli_need(calloc(c->nsmooth + f->scene.nparams + 1, sizeof *f->smooth));
    f->masks = cli_need(calloc(f->scene.nparams + 1, sizeof *f->masks));
    o->rates = f->rates, o->smooth = f->smooth, o->rate_masks = f->masks;
    for (uint32_t k = 0; k < c->nlr; k++)
        if (!c->lr[k].name) f->rates[o->nrates++].value = strtod(c->lr[k].value, NULL);
    for (uint32_t k = 0; k < f->scene.nparams; k++) {
        const FitParam *q = &f->scene.params[k];
        bool given = false;
        for (uint32_t s = 0; s < c->nsmooth; s++) given |= c->smooth[s].name && !strcmp(c->smooth[s].name, q->name);
        if (q->lr >= 0) f->rates[o->nrates++] = (SltFitNumber){q->name, q->lr};
        if (q->smooth > 0 && !given) f->smooth[o->nsmooth++] = (SltFitNumber){q->name, q->smooth};
    }
    for (uint32_t k = 0; k < c->nlr; k++)
        if (c->lr[k].name) f->rates[o->nrates++] = (SltFitNumber){c->lr[k].name, strtod(c->lr[k].value, NULL)};
    for (uint32_t k = 0; k < c->nsmooth; k++) {
        if (!c->smooth[k].name) return cli_usage(c, "--smooth wants P=LAMBDA");
        f->smooth[o->nsmooth++] = (SltFitNumber){c->smooth[k].name, strtod(c->smooth[k].value, NULL)};
    }
    for (uint32_t k = 0; k < f->scene.nparams; k++) {
        const FitParam *q = &f->scene.params[k];
        if (!q->mask) continue;
        SltError err = {0};
        Image im;
        ImageReadOptions raw = {.raw = true};
        if (image_read(q->mask, &raw, &im, &err) != SLT_OK) return cli_fail(c, &err);
        size_t cells = (size_t)im.width * (size_t)im.height;
        float *factors = cli_need(malloc((cells + 1) * sizeof *factors));
        for (size_t i = 0; i < cells; i++) factors[i] = im.data[i * (size_t)im.channels];
        f->masks[o->nrate_masks++] = (SltFitMask){q->name, (uint32_t)im.width, (uint32_t)im.height, factors};
        image_free(&im);
    }
    return SLT_OK;
}

/* Without --size the first target decides. */
static SltStatus size_of_target(const Fit *f, uint32_t size[2], SltError *err) {
    const char *path = f->c->target ? f->c->target : f->scene.nviews ? f->scene.views[0].target_path : NULL;
    Image im;
    if (!path) return SLT_OK;
    SltStatus status = image_read(path, NULL, &im, err);
    if (status != SLT_OK) return status;
    size[0] = (uint32_t)im.width, size[1] = (uint32_t)im.height;
    image_free(&im);
    return SLT_OK;
}

static int read_targets(Fit *f) {
    Cli *c = f->c;
    int status = SLT_OK;
    if (c->target && f->scene.nviews) return cli_usage(c, "--target and the scene's views were both given");
    if (c->minimize && c->loss_command) return cli_usage(c, "--minimize and --loss-command are two losses");
    if (c->loss && (c->minimize || c->loss_command))
        return cli_usage(c, "--loss %s and %s are two losses", c->loss, c->minimize ? "--minimize" : "--loss-command");
    if (c->huber_delta > 0 && (!c->loss || strcmp(c->loss, "huber")))
        return cli_usage(c, "--huber-delta is of --loss huber");
    if (c->target || (c->loss_command && !f->scene.nviews)) {
        f->scene.views = cli_need(calloc(1, sizeof *f->scene.views));
        f->scene.nviews = 1;
        f->scene.views[0].target_path = (char *)c->target;
    }
    if (!f->scene.nviews && !c->minimize)
        return cli_usage(c, "fit wants --target IMAGE, --minimize, --loss-command PROGRAM, or a scene with views");
    if (f->scene.nviews && c->minimize) return cli_usage(c, "--minimize has no target");
    if (c->loss_command && slt_dim(f->p) == 3) return cli_usage(c, "a loss program is for 1D and 2D domains");
    if (c->minimize || c->loss_command) return SLT_OK;
    if (!c->size_given) {
        SltError err = {0};
        if (size_of_target(f, c->job.size, &err) != SLT_OK) return cli_fail(c, &err);
        c->job.size[2] = 1;
    }
    for (uint32_t v = 0; v < f->scene.nviews; v++) {
        View *view = &f->scene.views[v];
        status = cli_read_image(c, f->p, view->target_path, true, &view->target);
        if (status == SLT_OK && view->mask_path) status = cli_read_image(c, f->p, view->mask_path, true, &view->mask);
        if (status != SLT_OK) return status;
    }
    return SLT_OK;
}

static int collect_views(Fit *f) {
    f->views = cli_need(calloc(f->scene.nviews + 1, sizeof *f->views));
    for (uint32_t v = 0; v < f->scene.nviews; v++) {
        const View *view = &f->scene.views[v];
        f->views[v] = SLT_FIT_VIEW_INIT;
        f->views[v].target = view->target, f->views[v].mask = view->mask;
        f->views[v].values = view->params, f->views[v].nvalues = view->nparams;
    }
    f->opt.views = f->views, f->opt.nviews = f->scene.nviews;
    return SLT_OK;
}

/* ---- while it runs */
static SltStatus ask_program(void *user, const SltFitRequest *request, double *loss, float *adjoint, SltError *err) {
    Fit *f = user;
    const View *v = &f->scene.views[request->view];
    LossRequest q = {.iteration = request->iteration,
                     .view = request->view,
                     .views = request->views,
                     .width = request->pixels[0],
                     .height = request->pixels[1],
                     .channels = request->channels,
                     .target = v->target_path,
                     .mask = v->mask_path,
                     .deadline = f->c->max_seconds > 0 ? f->start + f->c->max_seconds : 0};
    return loss_exchange(f->loss, &q, request->image, loss, adjoint, err);
}

/* Before the fit: a picture that there is no memory for is no reason to lose hours of work, nor to leave it out. */
static SltStatus create_frames(Fit *f, SltError *err) {
    const uint32_t *size = f->c->job.size;
    SltStatus s = SLT_OK;
    for (uint32_t k = 0; k < FRAMES - 1 && k < f->c->iters && s == SLT_OK; k++)
        s = image_create(&f->frames[k], (int)size[0], (int)size[1], (int)slt_channels(f->p), err);
    return s;
}

static void keep_frame(Fit *f, const float *image) {
    Image *im = &f->frames[f->nframes];
    if (!im->data) return;
    memcpy(im->data, image, (size_t)im->width * (size_t)im->height * (size_t)im->channels * sizeof(float));
    f->nframes++;
}

static bool iterated(void *user, const SltFitIteration *at) {
    Fit *f = user;
    uint32_t iters = f->c->iters;
    if (at->image && f->nframes < FRAMES - 1 &&
        (at->iteration - 1) * (uint64_t)(FRAMES - 1) >= (uint64_t)f->nframes * iters)
        keep_frame(f, at->image);
    char detail[96];
    snprintf(detail, sizeof detail, "iteration %u of %u, loss %.6g", at->iteration, iters, at->loss);
    progress_update(&f->progress, (double)at->iteration / iters, detail);
    watch_keep();
    return false;
}

/* ---- outputs */
static SltStatus join(char *out, size_t size, const char *dir, const char *name, SltError *err) {
    if (snprintf(out, size, "%s/%s", dir, name) >= (int)size)
        return status_fail(err, SLT_OUTPUT, "%s/%s: the path is too long", dir, name);
    return SLT_OK;
}

/* A height map as a person reads one: its relief under a sun in the north west, tinted by height. */
static SltStatus write_relief(const char *path, const SltParam *q, const Image *h, SltError *err) {
    int w = h->width, n = h->height;
    double wide = q->has_extent ? q->extent[2] - q->extent[0] : 1,
           high = q->has_extent ? q->extent[3] - q->extent[1] : 1;
    double scale = q->height_scale, lo = INFINITY, hi = -INFINITY;
    uint8_t *rgb = malloc((size_t)w * (size_t)n * 3);
    if (!rgb) return status_fail(err, SLT_LIMIT, "out of memory");
    for (size_t i = 0; i < (size_t)w * (size_t)n; i++)
        lo = fmin(lo, (double)h->data[i]), hi = fmax(hi, (double)h->data[i]);
    for (int y = 0; y < n; y++)
        for (int x = 0; x < w; x++) {
            int x0 = x > 0 ? x - 1 : 0, x1 = x + 1 < w ? x + 1 : x, y0 = y > 0 ? y - 1 : 0, y1 = y + 1 < n ? y + 1 : y;
            const float *v = h->data;
            double at = (double)v[(size_t)y * (size_t)w + (size_t)x];
            double gx =
                scale *
                ((double)v[(size_t)y * (size_t)w + (size_t)x1] - (double)v[(size_t)y * (size_t)w + (size_t)x0]) /
                (x1 - x0) * (w - 1) / wide;
            double gy =
                scale *
                ((double)v[(size_t)y0 * (size_t)w + (size_t)x] - (double)v[(size_t)y1 * (size_t)w + (size_t)x]) /
                (y1 - y0) * (n - 1) / high;
            double light = (gx * 0.5 - gy * 0.5 + 0.7071) / sqrt(gx * gx + gy * gy + 1);
            uint8_t tint[3];
            colormap_sequential(hi > lo ? (at - lo) / (hi - lo) : 0.5, tint);
            for (int k = 0; k < 3; k++)
                rgb[((size_t)y * (size_t)w + (size_t)x) * 3 + (size_t)k] =
                    (uint8_t)(fmin(fmax(light, 0) + 0.15, 1) * tint[k] + 0.5);
        }
    SltStatus s = image_write_png8(path, w, n, 3, rgb, err);
    free(rgb);
    return s;
}

/* Every texture and geometry that was optimised: NAME.exr to go on with, NAME.png to look at. */
static SltStatus write_grids(Fit *f, SltError *err) {
    char path[4096], name[512];
    for (uint32_t k = 0; k < slt_param_count(f->p); k++) {
        SltParam q = SLT_PARAM_INIT;
        slt_param(f->p, k, &q);
        if ((!q.is_texture && !q.is_heightfield) || !q.fcount || !slt_wrt_mask(f->p)[q.fbase]) continue;
        Image im;
        SltStatus s = image_create(&im, (int)q.tex_w, (int)q.tex_h, (int)q.tex_c, err);
        if (s != SLT_OK) return s;
        for (uint32_t i = 0; i < q.fcount; i++) im.data[i] = (float)slt_floats(f->p)[q.fbase + i];
        snprintf(name, sizeof name, "%.500s.exr", q.name);
        s = join(path, sizeof path, f->c->output, name, err);
        if (s == SLT_OK) s = image_write(path, &im, NULL, err);
        snprintf(name, sizeof name, "%.500s.png", q.name);
        if (s == SLT_OK) s = join(path, sizeof path, f->c->output, name, err);
        if (s == SLT_OK) s = q.is_heightfield ? write_relief(path, &q, &im, err) : image_write(path, &im, NULL, err);
        image_free(&im);
        if (s != SLT_OK) return s;
    }
    return SLT_OK;
}

/* The image of the best parameters as the first view sees them, whose values the program keeps. */
static SltStatus render_first_view(Fit *f, const SltJob *job, float *image, SltError *err) {
    const View *v = &f->scene.views[0];
    SltStatus s = SLT_OK;
    for (uint32_t k = 0; s == SLT_OK && k < v->nparams; k++)
        s = slt_set_text(f->p, v->params[k].name, v->params[k].value, err);
    return s == SLT_OK ? slt_render(f->p, job, image, NULL, err) : s;
}

static SltStatus write_folder(Fit *f, const char *json, SltError *err) {
    char path[4096];
    const char *dir = f->c->output;
    uint32_t ch = slt_channels(f->p);
    SltStatus s = join(path, sizeof path, dir, "fitted.json", err);
    if (s == SLT_OK) s = file_write_atomic(path, json, strlen(json), err);
    double *x = malloc((f->result.iterations + 1) * sizeof *x);
    for (uint32_t i = 0; x && i < f->result.iterations; i++) x[i] = i + 1;
    PlotSeries series = {.name = "loss", .x = x, .y = f->result.losses, .count = (int)f->result.iterations};
    PlotOptions plot = {.title = "loss", .x_label = "iteration", .y_label = "loss", .log_y = true};
    char *svg = s == SLT_OK && x && f->result.iterations ? plot_svg(&plot, &series, 1, err) : NULL;
    if (s == SLT_OK && !svg && f->result.iterations) s = x ? err->status : status_fail(err, SLT_LIMIT, "out of memory");
    if (svg && (s = join(path, sizeof path, dir, "loss.svg", err)) == SLT_OK)
        s = file_write_atomic(path, svg, strlen(svg), err);
    free(svg);
    free(x);
    Text text;
    FILE *out = text_open(&text);
    if (out) fputs("iteration,loss\n", out);
    for (uint32_t i = 0; out && i < f->result.iterations; i++) fprintf(out, "%u,%.17g\n", i + 1, f->result.losses[i]);
    char *csv = text_close(&text);
    if (s == SLT_OK && !csv) s = status_fail(err, SLT_LIMIT, "out of memory");
    if (s == SLT_OK && (s = join(path, sizeof path, dir, "loss.csv", err)) == SLT_OK)
        s = file_write_atomic(path, csv, text.size, err);
    free(csv);
    if (s == SLT_OK) s = write_grids(f, err);
    if (s != SLT_OK || f->c->minimize) return s;
    Image im;
    if ((s = image_create(&im, (int)f->c->job.size[0], (int)f->c->job.size[1], (int)ch, err)) != SLT_OK) return s;
    SltJob job = f->c->job;
    job.cancel = NULL;
    for (uint32_t k = 0; k < ch; k++) image_set_name(&im, (int)k, report_channel(ch, k));
    report_metadata(&im, f->c, f->p); /* before the values of a view replace the common ones */
    s = render_first_view(f, &job, im.data, err);
    if (s == SLT_OK && (s = join(path, sizeof path, dir, "image.exr", err)) == SLT_OK)
        s = image_write(path, &im, NULL, err);
    ImageWriteOptions png = {.raw = slt_is_display(f->p)};
    if (s == SLT_OK && (s = join(path, sizeof path, dir, "image.png", err)) == SLT_OK)
        s = image_write(path, &im, &png, err);
    const Image *strip[FRAMES + 2];
    int n = 0;
    for (uint32_t k = 0; k < f->nframes; k++) strip[n++] = &f->frames[k];
    strip[n++] = &im;
    Image target = {.width = im.width, .height = im.height, .channels = im.channels, .data = f->scene.views[0].target},
          film;
    if (target.data) strip[n++] = &target;
    if (s == SLT_OK && (s = image_film_strip(strip, n, 4, &film, err)) == SLT_OK) {
        if ((s = join(path, sizeof path, dir, "strip.png", err)) == SLT_OK) s = image_write(path, &film, &png, err);
        image_free(&film);
    }
    image_free(&im);
    return s;
}

/* A folder that a fit has not filled before may hold a file of a name that would be written: somebody else's. */
static SltStatus check_folder(const Fit *f, SltError *err) {
    static const char *const usual[] = {"loss.svg", "loss.csv", "image.exr", "image.png", "strip.png"};
    char path[4096], name[512];
    const char *dir = f->c->output;
    if (mkdir(dir, 0777) != 0 && errno != EEXIST)
        return status_fail_errno(err, SLT_OUTPUT, errno, "cannot make the folder %s", dir);
    SltStatus s = join(path, sizeof path, dir, "fitted.json", err);
    if (s != SLT_OK || access(path, F_OK) == 0) return s;
    uint32_t params = slt_param_count(f->p), n = sizeof usual / sizeof *usual + 2 * params;
    for (uint32_t k = 0; k < n; k++) {
        SltParam q = SLT_PARAM_INIT;
        if (k >= 2 * params) snprintf(name, sizeof name, "%s", usual[k - 2 * params]);
        else slt_param(f->p, k / 2, &q), snprintf(name, sizeof name, "%.500s.%s", q.name, k & 1 ? "png" : "exr");
        if (k < 2 * params && !q.is_texture && !q.is_heightfield) continue;
        if ((s = join(path, sizeof path, dir, name, err)) != SLT_OK) return s;
        if (access(path, F_OK) == 0)
            return status_fail(err, SLT_OUTPUT,
                               "'%s' is there, and %s holds no earlier fit: choose another folder for -o", path, dir);
    }
    return SLT_OK;
}

static bool wants_folder(const Cli *c) {
    size_t n = c->output ? strlen(c->output) : 0;
    return n && !(n > 5 && !strcmp(c->output + n - 5, ".json"));
}

static const char *const stop_names[] = {
    [SLT_FIT_ITERATIONS] = "iters",        [SLT_FIT_CONVERGED] = "converged",    [SLT_FIT_STOPPED] = "stopped",
    [SLT_FIT_INTERRUPTED] = "interrupted", [SLT_FIT_TIME_LIMIT] = "interrupted", [SLT_FIT_FAILED] = "failed"};

static int write_outputs(Fit *f) {
    SltError err = {0};
    char *json = slt_params_json(f->p);
    SltStatus s = json ? SLT_OK : status_fail(&err, SLT_LIMIT, "out of memory");
    if (s == SLT_OK && f->c->output) {
        FileGroup outputs;
        file_group_begin(&outputs);
        if (wants_folder(f->c)) s = write_folder(f, json, &err);
        else s = file_write_atomic(f->c->output, json, strlen(json), &err);
        s = file_group_end(&outputs, s, &err);
    }
    if (s == SLT_OK && f->c->json) {
        fputs("{\"initial_loss\": ", stdout);
        json_number(stdout, f->result.initial_loss);
        fputs(", \"loss\": ", stdout);
        json_number(stdout, f->result.loss);
        fputs(", \"losses\": [", stdout);
        for (uint32_t i = 0; i < f->result.iterations; i++)
            fputs(i ? ", " : "", stdout), json_number(stdout, f->result.losses[i]);
        printf("], \"iterations\": %u, \"seconds\": ", f->result.iterations);
        json_number(stdout, cli_now() - f->start);
        printf(", \"stopped\": \"%s\", \"params\": %s, \"outputs\": [", stop_names[f->result.stop], json);
        if (f->c->output) json_text(stdout, f->c->output);
        fputs("], ", stdout);
        report_warnings_json(stdout, f->p, &f->stats);
        fputs("}\n", stdout);
    } else if (s == SLT_OK) {
        FILE *out = f->c->streams ? stderr : stdout;
        if (!f->result.iterations) fputs("no iteration: the parameters as they are, and no loss\n", out);
        else
            fprintf(out, "loss %.6g -> %.6g in %u iterations, %.1f s (%s)\n", f->result.initial_loss, f->result.loss,
                    f->result.iterations, cli_now() - f->start, stop_names[f->result.stop]);
        if (!f->c->output) fputs(json, stdout);
    }
    free(json);
    return s == SLT_OK ? SLT_OK : cli_fail(f->c, &err);
}

/* ---- the fit */
static void absolute(Scene *s, char **path) {
    char *full = *path ? realpath(*path, NULL) : NULL;
    if (full) *path = scene_keep(s, full);
}

static int report(Fit *f, const SltError *err) {
    return err->status == SLT_USAGE ? cli_usage(f->c, "%s", err->text) : cli_fail(f->c, err);
}

/* Whether there is anything to write: not after a fault, nor when the first loss failed. */
static bool has_outcome(const Fit *f, SltStatus status) {
    if (f->result.stop == SLT_FIT_FAILED && !f->result.iterations) return false;
    return status == SLT_OK || status == SLT_INTERRUPTED || status == SLT_CHECK_FAILED || status == SLT_LIMIT;
}

static int run(Fit *f) {
    Cli *c = f->c;
    SltFit *fit;
    SltError err = {0}, end_err = {0};
    SltFitStop stop = SLT_FIT_RUNNING;
    SltStatus status = wants_folder(c) ? check_folder(f, &err) : SLT_OK; /* now, and not after hours */
    if (status == SLT_OK && wants_folder(c) && !c->minimize) status = create_frames(f, &err);
    if (status == SLT_OK) status = slt_fit_begin(f->p, &f->opt, &fit, &err);
    if (status != SLT_OK) return report(f, &err);
    f->start = cli_now();
    /* The loss program may run in another folder than the command. */
    for (uint32_t v = 0; c->loss_command && f->scene.loss_dir && v < f->scene.nviews; v++)
        absolute(&f->scene, &f->scene.views[v].target_path), absolute(&f->scene, &f->scene.views[v].mask_path);
    if (c->loss_command && !(f->loss = loss_start(c->loss_command, f->scene.loss_dir, c->loss_timeout, &err))) {
        slt_fit_end(fit, NULL, NULL);
        return report(f, &err);
    }
    progress_begin(&f->progress, c, "fit");
    while (status == SLT_OK && stop == SLT_FIT_RUNNING) status = slt_fit_step(fit, &stop, &err);
    progress_end(&f->progress);
    loss_stop(f->loss);
    SltStatus ended = slt_fit_end(fit, &f->result, &end_err);
    /* A fit that ends at its time limit, with a result, is no error. */
    if (status != SLT_OK && stop != SLT_FIT_INTERRUPTED && (stop != SLT_FIT_TIME_LIMIT || !f->result.iterations))
        report(f, &err);
    if (ended != SLT_OK) return report(f, &end_err);
    if (!has_outcome(f, status)) return status;
    if (!c->quiet) cli_tell(c, f->p);
    report_dropped(c, &f->stats);
    int written = write_outputs(f);
    if (written == SLT_OK) written = status;
    return written == SLT_OK && f->stats.asserts ? SLT_CHECK_FAILED : written;
}

static int fit(Fit *f) {
    Cli *c = f->c;
    if (c->minimize) c->job.integral = true;
    int status = apply_scene_params(f);
    if (status == SLT_OK) status = read_targets(f);
    if (status == SLT_OK) status = cli_prepare_job(c, f->p);
    if (status == SLT_OK) status = collect_views(f);
    if (status == SLT_OK) status = collect_numbers(f);
    if (status != SLT_OK) return status;
    f->opt.job = &c->job, f->opt.stats = &f->stats, f->opt.minimize = c->minimize;
    f->opt.optimizer = c->optimizer, f->opt.iterations = c->iters;
    f->opt.checkpoint = c->checkpoint ? c->checkpoint : c->resume, f->opt.every = c->every, f->opt.resume = c->resume;
    f->opt.iterated = iterated, f->opt.iterated_user = f;
    f->opt.metric = c->loss ? (SltFitMetric)cli_choice(CLI_LOSSES, c->loss) : SLT_FIT_L2;
    f->opt.huber_delta = c->huber_delta;
    if (c->loss_command) f->opt.loss = ask_program, f->opt.loss_user = f, f->opt.loss_name = c->loss_command;
    return run(f);
}

int verb_fit(Cli *c) {
    Fit f = {.c = c, .opt = SLT_FIT_OPTIONS_INIT, .result = SLT_FIT_RESULT_INIT, .stats = SLT_STATS_INIT};
    int status = SLT_OK;
    const char *scene_file = c->file;
    if (scene_is(c->file)) {
        c->scene = scene_file;
        status = scene_read(c, scene_file, &f.scene);
        if (status == SLT_OK) c->file = f.scene.shader;
    }
    SltError later = {0}; /* a target that cannot be read is reported behind the shader's own errors */
    if (status == SLT_OK) size_of_target(&f, c->opt.size, &later);
    if (status == SLT_OK) status = cli_compile(c, &f.p);
    if (status == SLT_OK) status = fit(&f);
    for (uint32_t k = 0; k < FRAMES; k++) image_free(&f.frames[k]);
    for (uint32_t k = 0; k < f.opt.nrate_masks; k++) free((void *)f.masks[k].factors);
    free(f.views);
    free(f.masks);
    free(f.rates);
    free(f.smooth);
    free(f.result.losses);
    slt_program_free(f.p);
    if (c->file == f.scene.shader) c->file = scene_file;
    scene_free(&f.scene);
    return status;
}
