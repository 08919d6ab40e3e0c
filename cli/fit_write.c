/* What a fit writes: the parameters, or a folder with pictures as well. */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "cli/fit.h"
#include "runtime/base/text.h"

SltStatus fit_join(char *out, size_t size, const char *dir, const char *name, SltError *err) {
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

/* Every texture and geometry that was optimised: NAME.exr to go on with, NAME.png to look at; of a volume its slices
 * below each other. */
static SltStatus write_grids(Fit *f, SltError *err) {
    char path[4096], name[512];
    for (uint32_t k = 0; k < slt_param_count(f->p); k++) {
        SltParam q = SLT_PARAM_INIT;
        slt_param(f->p, k, &q);
        if ((!q.is_texture && !q.is_heightfield) || !q.fcount || !slt_wrt_mask(f->p)[q.fbase]) continue;
        Image im;
        uint32_t slices = q.tex_d ? q.tex_d : 1;
        SltStatus s = image_create(&im, (int)q.tex_w, (int)(q.tex_h * slices), (int)q.tex_c, err);
        if (s != SLT_OK) return s;
        for (uint32_t i = 0; i < q.fcount; i++) im.data[i] = (float)slt_floats(f->p)[q.fbase + i];
        snprintf(name, sizeof name, "%.500s.exr", q.name);
        s = fit_join(path, sizeof path, f->c->output, name, err);
        if (s == SLT_OK)
            s = q.tex_d ? volume_write(path, &im, (int)slices, NULL, err) : image_write(path, &im, NULL, err);
        snprintf(name, sizeof name, "%.500s.png", q.name);
        if (s == SLT_OK) s = fit_join(path, sizeof path, f->c->output, name, err);
        if (s == SLT_OK) s = q.is_heightfield ? write_relief(path, &q, &im, err) : image_write(path, &im, NULL, err);
        image_free(&im);
        if (s != SLT_OK) return s;
    }
    return SLT_OK;
}

/* The loss over the iterations, with a line where a program changed the parameters; malloc'd. */
static char *plot_losses(const Fit *f, SltError *err) {
    enum { WIDTH = 480, HEIGHT = 300 };
    uint32_t n = f->result.iterations, rounds = f->scene.nrounds ? f->round : 0;
    double *x = cli_need(malloc((n + 6 * rounds + 1) * sizeof *x)), *ends = x + n, *heights = ends + 3 * rounds;
    double least = INFINITY, most = 0;
    for (uint32_t i = 0; i < n; i++) {
        double v = f->result.losses[i];
        x[i] = i + 1;
        if (v > 0 && isfinite(v)) least = fmin(least, v), most = fmax(most, v);
    }
    for (uint32_t k = 0; k < 3 * rounds; k++) { /* what is not finite breaks the line */
        ends[k] = f->round_ends[k / 3] + 0.5;
        heights[k] = k % 3 == 0 ? least : k % 3 == 1 ? most : NAN;
    }
    PlotSeries series[2] = {{.x = x, .y = f->result.losses, .count = (int)n},
                            {.x = ends, .y = heights, .count = (int)(3 * rounds), .dashed = true}};
    PlotOptions plot = {.x_label = "iteration", .y_label = "loss", .log_y = true, .width = WIDTH, .height = HEIGHT};
    char *svg = plot_svg(&plot, series, rounds ? 2 : 1, err);
    free(x);
    return svg;
}

static SltStatus write_text(const char *dir, const char *name, const char *text, size_t size, SltError *err) {
    char path[4096];
    SltStatus s = fit_join(path, sizeof path, dir, name, err);
    return s == SLT_OK ? file_write_atomic(path, text, size, err) : s;
}

static SltStatus write_losses(const Fit *f, SltError *err) {
    Text text;
    FILE *out = text_open(&text);
    if (out) fputs("iteration,loss\n", out);
    for (uint32_t i = 0; out && i < f->result.iterations; i++) fprintf(out, "%u,%.17g\n", i + 1, f->result.losses[i]);
    char *csv = text_close(&text), *svg = f->result.iterations ? plot_losses(f, err) : NULL;
    SltStatus s = csv ? SLT_OK : status_fail(err, SLT_LIMIT, "out of memory");
    if (s == SLT_OK) s = write_text(f->c->output, "loss.csv", csv, text.size, err);
    if (s == SLT_OK && f->result.iterations)
        s = svg ? write_text(f->c->output, "loss.svg", svg, strlen(svg), err) : err->status;
    free(csv);
    free(svg);
    return s;
}

static SltStatus write_folder(Fit *f, const char *json, SltError *err) {
    SltStatus s = write_text(f->c->output, "fitted.json", json, strlen(json), err);
    if (s == SLT_OK) s = write_losses(f, err);
    if (s == SLT_OK) s = write_grids(f, err);
    if (s == SLT_OK) s = fit_write_meshes(f, err);
    return s == SLT_OK && !f->c->minimize ? fit_write_pictures(f, err) : s;
}

/* A folder that a fit has not filled before may hold a file of a name that would be written: somebody else's. */
SltStatus fit_check_folder(const Fit *f, SltError *err) {
    static const char *const usual[] = {"loss.svg", "loss.csv", "image.exr", "image.png", "strip.png", "fit.png"};
    char path[4096], name[512];
    const char *dir = f->c->output;
    if (mkdir(dir, 0777) != 0 && errno != EEXIST)
        return status_fail_errno(err, SLT_OUTPUT, errno, "cannot make the folder %s", dir);
    SltStatus s = fit_join(path, sizeof path, dir, "fitted.json", err);
    if (s != SLT_OK || access(path, F_OK) == 0) return s;
    uint32_t params = slt_param_count(f->p), n = sizeof usual / sizeof *usual + 2 * params;
    for (uint32_t k = 0; k < n; k++) {
        SltParam q = SLT_PARAM_INIT;
        if (k >= 2 * params) snprintf(name, sizeof name, "%s", usual[k - 2 * params]);
        else slt_param(f->p, k / 2, &q);
        bool mesh = k < 2 * params && !(k & 1) && slt_mesh(f->p, k / 2, NULL, NULL);
        if (k < 2 * params) snprintf(name, sizeof name, "%.500s.%s", q.name, mesh ? "obj" : k & 1 ? "png" : "exr");
        if (k < 2 * params && !q.is_texture && !q.is_heightfield && !mesh) continue;
        if ((s = fit_join(path, sizeof path, dir, name, err)) != SLT_OK) return s;
        if (access(path, F_OK) == 0)
            return status_fail(err, SLT_OUTPUT,
                               "'%s' is there, and %s holds no earlier fit: choose another folder for -o", path, dir);
    }
    return SLT_OK;
}

bool fit_wants_folder(const Cli *c) {
    size_t n = c->output ? strlen(c->output) : 0;
    return n && !(n > 5 && !strcmp(c->output + n - 5, ".json"));
}

static const char *const stop_names[] = {
    [SLT_FIT_ITERATIONS] = "iters",        [SLT_FIT_CONVERGED] = "converged",    [SLT_FIT_STOPPED] = "stopped",
    [SLT_FIT_INTERRUPTED] = "interrupted", [SLT_FIT_TIME_LIMIT] = "interrupted", [SLT_FIT_FAILED] = "failed"};

int fit_write_outputs(Fit *f) {
    SltError err = {0};
    char *json = slt_params_json(f->p);
    SltStatus s = json ? SLT_OK : status_fail(&err, SLT_LIMIT, "out of memory");
    if (s == SLT_OK && f->c->output) {
        FileGroup outputs;
        file_group_begin(&outputs);
        if (fit_wants_folder(f->c)) s = write_folder(f, json, &err);
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
        printf(", \"evaluations\": %llu", (unsigned long long)f->stats.evaluations);
        if (f->scene.nrounds) printf(", \"rounds\": %u", f->round + 1);
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
