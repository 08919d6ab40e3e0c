/* saltus grad: derivative images (-o), totals (--integral, or without an output), or of a loss (--target, --adjoint).
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bindings/c/warnings.h"
#include "cli/cli.h"

static void json_list(const char *key, const double *v, uint32_t n) {
    printf("\"%s\": [", key);
    for (uint32_t k = 0; k < n; k++) fputs(k ? ", " : "", stdout), json_number(stdout, v[k]);
    fputs("], ", stdout);
}

static void json_shape(const char *key, Cli *c, SltProgram *p, const double *data, uint32_t channels) {
    ShapeValues v = {data, channels, slt_float_count(p)};
    printf("\"%s\": ", key);
    report_gradient_json(stdout, c, p, &v);
    fputs(", ", stdout);
}

/* A number and its error, with as many digits as may be right. */
static void print_number(double v, double se, bool cells) {
    printf(cells ? " %21.14g +- %-9.2g" : " %16.9g +- %-9.2g", v, se);
}

/* The gradient as a table, its first components where there are many. */
static void print_table(Cli *c, SltProgram *p, const double *g, const double *se, uint32_t channels, bool cells) {
    uint32_t *index, nf = slt_float_count(p);
    char **names;
    uint32_t n = report_components(c, p, &names, &index), shown = n < CLI_MAX_COMPONENTS ? n : CLI_MAX_COMPONENTS;
    for (uint32_t i = 0; i < shown; i++) {
        printf("%-28s", names[i]);
        for (uint32_t k = 0; k < channels; k++)
            print_number(g[(size_t)k * nf + index[i]], se[(size_t)k * nf + index[i]], cells);
        putchar('\n');
    }
    if (n > shown) printf("... and %u more components (--json prints all)\n", n - shown);
    report_free_components(names, index, n);
}

/* What the rest can hide of any component, at most; NaN where one is not bounded. */
static double largest_bound(const double *v, size_t n) {
    double largest = 0;
    for (size_t i = 0; i < n; i++) {
        if (isnan(v[i])) return NAN;
        largest = fmax(largest, v[i]);
    }
    return largest;
}

/* Of images and losses: the part that is left is not bounded. */
static double image_bound(const SltStats *s) { return s->left > 0 ? NAN : 0; }

static const char *stderr_kind(const SltStats *stats, bool mixed, bool replicates) {
    if (stats->cells) return mixed ? "mixed" : "quadrature";
    return replicates ? "replicates" : "bound";
}

/* What lines are thought to have missed, where that is most of the error: the component of which most is missed. */
static ReportMore missed_warning(const SltProgram *p, const SltIntegral *r, size_t n) {
    ReportMore more = {.code = "missed"};
    size_t worst = 0;
    double largest = 0;
    for (size_t i = 0; i < n; i++) {
        largest = fmax(largest, fabs(r->gradient[i]));
        if (fabs(r->missed_estimate[i]) > fabs(r->missed_estimate[worst])) worst = i;
    }
    double missed = n ? r->missed_estimate[worst] : 0;
    if (!n || !(fabs(missed) > 0)) return more;
    if (fabs(missed) < 0.5 * r->gradient_stderr[worst] || fabs(missed) < 1e-3 * largest) return more;
    char name[256];
    report_component_name(p, (uint32_t)(worst % slt_float_count(p)), name, sizeof name);
    snprintf(more.text, sizeof more.text,
             "lines miss what is narrower than their spacing: of %s an estimated %.3g beside the %.6g found; more "
             "--segments, or --estimator quadrature (`saltus explain missed`)",
             name, missed, r->gradient[worst]);
    more.said = true;
    return more;
}

static int grad_integral(Cli *c, SltProgram *p) {
    SltError err = {0};
    SltStats stats = SLT_STATS_INIT;
    uint32_t ch = slt_channels(p);
    size_t n = (size_t)ch * slt_float_count(p) + 1;
    double *all = calloc((c->json ? 6 : 4) * n, sizeof *all), value[4] = {0}, value_se[4] = {0};
    if (!all) return cli_error(SLT_LIMIT, "out of memory");
    SltIntegral out = {.struct_size = sizeof out,
                       .value = value,
                       .value_stderr = value_se,
                       .gradient = all,
                       .gradient_stderr = all + n,
                       .missed_estimate = all + 2 * n,
                       .left_bound = all + 3 * n,
                       .interior = c->json ? all + 4 * n : NULL,
                       .boundary = c->json ? all + 5 * n : NULL};
    Progress pr;
    progress_begin(&pr, c, "grad");
    c->job.progress = progress_job, c->job.progress_user = &pr;
    bool without = false;
    SltStatus status = effort_integral(c, p, &out, &stats, &without, &err);
    progress_end(&pr);
    if (status != SLT_OK) {
        free(all);
        return cli_fail(c, &err);
    }
    double left = largest_bound(out.left_bound, n - 1);
    const ReportMore more[] = {missed_warning(p, &out, n - 1), report_unknown("values", value, value_se, ch),
                               report_unknown("derivatives", out.gradient, out.gradient_stderr, n - 1)};
    const size_t nmore = sizeof more / sizeof *more;
    if (c->json) {
        fputs("{", stdout);
        json_list("integral", value, ch);
        json_list("integral_stderr", value_se, ch);
        json_shape("gradient", c, p, out.gradient, ch);
        json_shape("stderr", c, p, out.gradient_stderr, ch);
        printf("\"stderr_kind\": \"%s\", ", stderr_kind(&stats, out.mixed, out.replicates));
        if (without) fputs("\"left_out\": \"boundary\", ", stdout);
        json_shape("interior", c, p, out.interior, ch);
        json_shape("boundary", c, p, out.boundary, ch);
        json_shape("missed_estimate", c, p, out.missed_estimate, ch);
        json_shape("gradient_left_bound", c, p, out.left_bound, ch);
        report_cells_json(stdout, &stats, &left);
        report_stats_json(stdout, &stats);
        fputs(", ", stdout);
        report_warnings_and(stdout, p, &stats, more, nmore);
        fputs("}\n", stdout);
    } else {
        printf("%-28s", "integral");
        for (uint32_t k = 0; k < ch; k++) print_number(value[k], value_se[k], stats.cells);
        putchar('\n');
        print_table(c, p, out.gradient, out.gradient_stderr, ch, stats.cells);
        if (!c->quiet && !stats.cells)
            fprintf(stderr, "saltus: %llu samples, %llu crossings, %.3f s\n", (unsigned long long)stats.samples,
                    (unsigned long long)stats.crossings, stats.seconds);
    }
    report_cells(c, &stats, &left);
    report_more(c, more, nmore);
    if (!c->quiet) cli_tell(c, p);
    report_dropped(c, &stats);
    free(all);
    return report_status(&stats);
}

static int grad_loss(Cli *c, SltProgram *p) {
    SltError err = {0};
    SltStats stats = SLT_STATS_INIT;
    float *image = NULL;
    int read = cli_read_image(c, p, c->target ? c->target : c->adjoint, c->target != NULL, &image);
    if (read != SLT_OK) return read;
    size_t n = slt_float_count(p) + 1;
    double *g = calloc(2 * n, sizeof *g), loss = 0;
    if (!g) {
        free(image);
        return cli_error(SLT_LIMIT, "out of memory");
    }
    Progress pr;
    progress_begin(&pr, c, "grad");
    c->job.progress = progress_job, c->job.progress_user = &pr;
    SltStatus status;
    if (c->target) {
        status = slt_grad_loss(p, &c->job, image, NULL, &loss, g, g + n, NULL, &stats, &err);
    } else {
        status = slt_grad_adjoint(p, &c->job, image, g, g + n, &stats, &err);
        /* The loss is the sum itself: the primal costs one more image. */
        size_t values = (size_t)c->job.size[0] * c->job.size[1] * c->job.size[2] * slt_channels(p);
        float *primal = malloc(values * sizeof *primal);
        if (status == SLT_OK && !primal) status = status_fail(&err, SLT_LIMIT, "out of memory");
        if (status == SLT_OK) status = slt_render(p, &c->job, primal, NULL, &err);
        for (size_t i = 0; status == SLT_OK && i < values; i++) loss += (double)image[i] * (double)primal[i];
        free(primal);
    }
    progress_end(&pr);
    free(image);
    if (status != SLT_OK) {
        free(g);
        return cli_fail(c, &err);
    }
    double left = image_bound(&stats);
    const ReportMore unknown = report_unknown("derivatives", g, g + n, n - 1);
    if (c->json) {
        fputs("{\"loss\": ", stdout);
        json_number(stdout, loss);
        fputs(", ", stdout);
        json_shape("gradient", c, p, g, 1);
        json_shape("stderr", c, p, g + n, 1);
        bool mixed = stats.left > 0 || c->job.interior == SLT_INTERIOR_SAMPLES;
        printf("\"stderr_kind\": \"%s\", ", stderr_kind(&stats, mixed, false));
        report_cells_json(stdout, &stats, &left);
        report_stats_json(stdout, &stats);
        fputs(", ", stdout);
        report_warnings_and(stdout, p, &stats, &unknown, 1);
        fputs("}\n", stdout);
    } else {
        printf("%-28s %16.9g\n", "loss", loss);
        print_table(c, p, g, g + n, 1, stats.cells);
    }
    report_cells(c, &stats, &left);
    report_more(c, &unknown, 1);
    if (!c->quiet) cli_tell(c, p);
    report_dropped(c, &stats);
    free(g);
    return report_status(&stats);
}

/* Signed maps of every component side by side. */
static SltStatus write_maps(const char *path, const Image *layers, uint32_t ncomp, uint32_t channels, char **names,
                            SltError *err) {
    if (ncomp == 1) {
        Image one;
        SltStatus status = image_extract_layer(layers, names[0], &one, err);
        if (status != SLT_OK) return status;
        status = image_write_diverging(path, &one, channels == 1 ? 0 : -1, 0, names[0], err);
        image_free(&one);
        return status;
    }
    uint8_t **maps = calloc(ncomp, sizeof *maps), *out = NULL;
    int *w = calloc(ncomp, sizeof *w), *h = calloc(ncomp, sizeof *h), width = 0, height = 0;
    SltStatus status = maps && w && h ? SLT_OK : status_fail(err, SLT_LIMIT, "out of memory");
    for (uint32_t k = 0; status == SLT_OK && k < ncomp; k++) {
        Image one;
        status = image_extract_layer(layers, names[k], &one, err);
        if (status != SLT_OK) break;
        status = image_draw_diverging(&one, channels == 1 ? 0 : -1, 0, names[k], &maps[k], &w[k], &h[k], err);
        image_free(&one);
        width += w[k];
        height = h[k] > height ? h[k] : height;
    }
    if (status == SLT_OK) {
        out = malloc((size_t)width * (size_t)height * 3);
        if (!out) status = status_fail(err, SLT_LIMIT, "out of memory");
    }
    if (status == SLT_OK) {
        memset(out, 255, (size_t)width * (size_t)height * 3);
        size_t x = 0;
        for (uint32_t k = 0; k < ncomp; k++) {
            for (int y = 0; y < h[k]; y++)
                memcpy(out + ((size_t)y * (size_t)width + x) * 3, maps[k] + (size_t)y * (size_t)w[k] * 3,
                       (size_t)w[k] * 3);
            x += (size_t)w[k];
        }
        status = image_write_png8(path, width, height, 3, out, err);
    }
    for (uint32_t k = 0; maps && k < ncomp; k++) free(maps[k]);
    free(maps);
    free(w);
    free(h);
    free(out);
    return status;
}

/* In an integral the stated error grows by what was dropped; an image has none to grow. */
static void note_missing_in_image(const Cli *c, const SltStats *s) {
    double lost = (double)api_lost(s), share = lost / ((double)s->crossings + lost);
    if (c->quiet || !(share > 1e-3)) return;
    cli_say(
        CLI_NOTE, "dropped", NULL,
        "derivative images state no errors: pixels with dropped crossings, %.2g %% of all crossings, lack their part",
        100 * share);
}

static int grad_images(Cli *c, SltProgram *p) {
    SltError err = {0};
    SltStats stats = SLT_STATS_INIT;
    char **names;
    uint32_t *index, ch = slt_channels(p), n = report_components(c, p, &names, &index), nf = slt_float_count(p);
    int status = SLT_OK;
    if (slt_dim(p) == 3 ? !volume_can_write(c->output) : !image_can_write(c->output)) {
        report_free_components(names, index, n);
        return cli_unknown_format(c);
    }
    if (n > CLI_MAX_COMPONENTS) {
        report_free_components(names, index, n);
        return cli_error(
            SLT_LIMIT,
            "%u components are more than %d derivative images; choose some with --wrt, or use --integral, --target or --adjoint for all at once",
            n, CLI_MAX_COMPONENTS);
    }
    size_t pixels = (size_t)c->job.size[0] * c->job.size[1] * c->job.size[2];
    uint32_t planes = ch + n * ch + 1;
    Image im = {0};
    float **out = calloc(n + 2, sizeof *out);
    double *dirs = calloc((size_t)n * nf + 1, sizeof *dirs);
    const double **dir = calloc(n + 1, sizeof *dir);
    float *block = malloc(((size_t)(n + 1) * ch + 1) * pixels * sizeof *block);
    if (!out || !dirs || !dir || !block)
        status = status_fail(&err, SLT_LIMIT, "out of memory for %u derivative images", n);
    if (status == SLT_OK)
        status = image_create(&im, (int)c->job.size[0], (int)(c->job.size[1] * c->job.size[2]), (int)planes, &err);
    if (status == SLT_OK) {
        for (uint32_t k = 0; k < n; k++) {
            dirs[(size_t)k * nf + index[k]] = 1;
            dir[k] = dirs + (size_t)k * nf;
            out[k] = block + (size_t)k * ch * pixels;
        }
        float *primal = block + (size_t)n * ch * pixels, *crossings = primal + (size_t)ch * pixels;
        Progress pr;
        progress_begin(&pr, c, "grad");
        c->job.progress = progress_job, c->job.progress_user = &pr;
        memset(crossings, 0, pixels * sizeof *crossings);
        /* Derivatives first: they compile the kernel of values beside their own, which a render would compile alone. */
        status = effort_images(c, p, n, dir, out, crossings, &stats, &err);
        if (status == SLT_OK) status = slt_render(p, &c->job, primal, NULL, &err);
        progress_end(&pr);
        for (uint32_t k = 0; k < ch; k++) image_set_name(&im, (int)k, report_channel(ch, k));
        for (uint32_t d = 0; d < n; d++)
            for (uint32_t k = 0; k < ch; k++) {
                char layer[IMAGE_NAME_SIZE - 4], name[IMAGE_NAME_SIZE];
                report_layer_name(c, p, index[d], layer, sizeof layer);
                snprintf(name, sizeof name, "%s.%s", layer, report_channel(ch, k));
                image_set_name(&im, (int)(ch + d * ch + k), name);
            }
        image_set_name(&im, (int)planes - 1, "crossings.Y");
        for (size_t i = 0; i < pixels; i++) {
            for (uint32_t k = 0; k < ch; k++) im.data[i * planes + k] = primal[i * ch + k];
            for (uint32_t d = 0; d < n; d++)
                for (uint32_t k = 0; k < ch; k++) im.data[i * planes + ch + d * ch + k] = out[d][i * ch + k];
            im.data[i * planes + planes - 1] = crossings[i];
        }
        report_metadata(&im, c, p);
        const char *dot = strrchr(c->output, '.');
        char **layers = calloc(n + 1, sizeof *layers);
        for (uint32_t d = 0; layers && d < n; d++) {
            char layer[IMAGE_NAME_SIZE - 4];
            report_layer_name(c, p, index[d], layer, sizeof layer);
            layers[d] = strdup(layer);
        }
        if (status == SLT_OK && dot && !strcmp(dot, ".png") && layers)
            status = write_maps(c->output, &im, n, ch, layers, &err);
        else if (status == SLT_OK && slt_dim(p) == 3)
            status = volume_write(c->output, &im, (int)c->job.size[2], NULL, &err);
        else if (status == SLT_OK) status = image_write(c->output, &im, NULL, &err);
        for (uint32_t d = 0; layers && d < n; d++) free(layers[d]);
        free(layers);
    }
    if (status != SLT_OK) cli_fail(c, &err);
    double left = image_bound(&stats);
    if (status == SLT_OK && c->json) {
        fputs("{\"outputs\": [", stdout);
        json_text(stdout, c->output);
        fputs("], \"components\": [", stdout);
        for (uint32_t k = 0; k < n; k++) fputs(k ? ", " : "", stdout), json_text(stdout, names[k]);
        fputs("], ", stdout);
        report_cells_json(stdout, &stats, &left);
        report_stats_json(stdout, &stats);
        fputs(", ", stdout);
        report_warnings_json(stdout, p, &stats);
        fputs("}\n", stdout);
    } else if (status == SLT_OK && !c->quiet) {
        cli_wrote(c, ": %u derivative image%s, %llu crossings, %.3f s", n, n == 1 ? "" : "s",
                  (unsigned long long)stats.crossings, stats.seconds);
    }
    if (status == SLT_OK) {
        report_cells(c, &stats, &left);
        if (!c->quiet) cli_tell(c, p);
        report_dropped(c, &stats);
        note_missing_in_image(c, &stats);
        status = report_status(&stats);
    }
    free(out);
    free(dirs);
    free(dir);
    free(block);
    image_free(&im);
    report_free_components(names, index, n);
    return status;
}

/* Without --size the target decides, or the image of adjoints. */
static int take_size(Cli *c, const SltProgram *p) {
    SltError err = {0};
    if (c->size_given) return SLT_OK;
    uint32_t size[3] = {1, 1, 1};
    if (cli_size_of_image(c->target ? c->target : c->adjoint, slt_dim(p) == 3, size, &err) != SLT_OK)
        return cli_fail(c, &err);
    memcpy(c->job.size, size, sizeof size);
    c->size_given = true;
    return SLT_OK;
}

int verb_grad(Cli *c) {
    SltProgram *p;
    int status = cli_compile(c, &p);
    if (status == SLT_OK && c->target && c->adjoint) status = cli_usage(c, "--target and --adjoint were both given");
    if (status == SLT_OK && c->job.integral && (c->target || c->adjoint))
        status = cli_usage(c, "--integral has no image to compare with");
    bool image = c->output && !c->target && !c->adjoint && !c->job.integral;
    if (!image && !c->target && !c->adjoint) c->job.integral = true;
    if (status == SLT_OK && !image && !c->job.integral) status = take_size(c, p);
    if (status == SLT_OK) status = cli_prepare_job(c, p);
    if (status == SLT_OK) status = image ? grad_images(c, p) : c->job.integral ? grad_integral(c, p) : grad_loss(c, p);
    cli_end_program(p);
    return status;
}
