/* saltus render: the image of a shader, or with --integral the integral over its domain. */
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "cli/cli.h"

static int write_rgba8(Cli *c, SltProgram *p, SltStats *stats) {
    SltError err = {0};
    uint32_t w = c->job.size[0], h = c->job.size[1];
    uint32_t *pixels = malloc((size_t)w * h * sizeof *pixels);
    if (!pixels) return cli_error(SLT_LIMIT, "out of memory");
    SltStatus status = slt_render_rgba8(p, &c->job, pixels, stats, &err);
    if (status == SLT_OK && c->output) {
        if (image_can_write(c->output))
            status = image_write_png8(c->output, (int)w, (int)h, 4, (const uint8_t *)pixels, &err);
        else status = file_write_atomic(c->output, pixels, (size_t)w * h * 4, &err);
    }
    free(pixels);
    return status == SLT_OK ? SLT_OK : cli_fail(c, &err);
}

static void print_result(Cli *c, SltProgram *p, const SltStats *stats, const float *data, uint32_t channels) {
    double mean[4] = {0};
    size_t n = (size_t)c->job.size[0] * c->job.size[1] * c->job.size[2];
    for (size_t i = 0; data && i < n; i++)
        for (uint32_t k = 0; k < channels; k++) mean[k] += (double)data[i * channels + k] / (double)n;
    if (!c->json) {
        char size[40];
        int end = snprintf(size, sizeof size, "%ux%u", c->job.size[0], c->job.size[1]);
        if (c->job.size[2] > 1) snprintf(size + end, sizeof size - (size_t)end, "x%u", c->job.size[2]);
        if (!c->quiet && c->output) cli_wrote(c, ", %s, %.3f s", size, stats->seconds);
        if (data && !c->output) {
            printf("%s", c->job.integral ? "integral" : "mean");
            for (uint32_t k = 0; k < channels; k++) printf(" %.9g", mean[k]);
            putchar('\n');
        }
        return;
    }
    fputs("{", stdout);
    if (data) {
        printf("\"%s\": [", c->job.integral ? "integral" : "mean");
        for (uint32_t k = 0; k < channels; k++) {
            if (k) fputs(", ", stdout);
            json_number(stdout, mean[k]);
        }
        fputs("], ", stdout);
    }
    printf("\"size\": [%u, %u, %u], \"channels\": %u, \"output\": ", c->job.size[0], c->job.size[1], c->job.size[2],
           channels);
    if (c->output) json_text(stdout, c->output);
    else fputs("null", stdout);
    fputs(", ", stdout);
    report_cells_json(stdout, stats, NULL);
    report_stats_json(stdout, stats);
    fputs(", ", stdout);
    report_warnings_json(stdout, p, stats);
    fputs("}\n", stdout);
}

/* The integral, by slt_grad_integral without a gradient: this gives its standard error too. */
static int render_integral(Cli *c, SltProgram *p) {
    SltError err = {0};
    SltStats stats = SLT_STATS_INIT;
    double value[4] = {0}, error[4] = {0};
    SltIntegral out = {.struct_size = sizeof out, .value = value, .value_stderr = error};
    c->job.no_boundary = true;
    SltStatus status = slt_grad_integral(p, &c->job, &out, &stats, &err);
    cli_forget_derivatives(p);
    stats.upset = 0;
    if (status != SLT_OK) return cli_fail(c, &err);
    const ReportMore unknown = report_unknown("values", value, error, slt_channels(p));
    if (c->json) {
        fputs("{\"integral\": [", stdout);
        for (uint32_t k = 0; k < slt_channels(p); k++) fputs(k ? ", " : "", stdout), json_number(stdout, value[k]);
        fputs("], \"integral_stderr\": [", stdout);
        for (uint32_t k = 0; k < slt_channels(p); k++) fputs(k ? ", " : "", stdout), json_number(stdout, error[k]);
        fputs("], ", stdout);
        report_cells_json(stdout, &stats, NULL);
        report_stats_json(stdout, &stats);
        fputs(", ", stdout);
        report_warnings_and(stdout, p, &stats, &unknown, 1);
        fputs("}\n", stdout);
    } else {
        for (uint32_t k = 0; k < slt_channels(p); k++)
            printf("%s%.9g +- %.2g", k ? "  " : "integral ", value[k], error[k]);
        putchar('\n');
    }
    report_cells(c, &stats, NULL);
    report_more(c, &unknown, 1);
    report_dropped(c, &stats);
    return report_status(&stats);
}

/* Packed pixels have no header: of the picture files only .png can hold them. */
static int check_rgba8(const Cli *c) {
    if (c->job.integral) return cli_usage(c, "--format rgba8 is for images: leave it out to have the integral");
    if (c->job.interior == SLT_INTERIOR_QUADRATURE)
        return cli_usage(c, "--format rgba8 takes the middle of each pixel: leave it out to have pixels integrated");
    const char *slash = c->output ? strrchr(c->output, '/') : NULL;
    const char *dot = c->output ? strrchr(slash ? slash : c->output, '.') : NULL;
    if (!dot || !strcasecmp(dot, ".png") || !strcmp(dot, ".raw")) return SLT_OK;
    return cli_usage(c, "-o %s: --format rgba8 writes .png, or bare pixels as .raw%s", c->output,
                     image_can_write(c->output) ? "; leave it out for this format" : "");
}

static int render(Cli *c, SltProgram *p) {
    int status = cli_prepare_job(c, p);
    if (status != SLT_OK) return status;
    if (c->job.centred && (c->job.integral || c->job.interior == SLT_INTERIOR_QUADRATURE))
        return cli_usage(c, "--centres is for images that are sampled: leave out %s",
                         c->job.integral ? "--integral" : "--exact and --interior quadrature");
    status = c->opt.rgba8 ? check_rgba8(c) : SLT_OK;
    if (status != SLT_OK) return status;
    bool known = c->output && (slt_dim(p) == 3 ? volume_can_write(c->output) : image_can_write(c->output));
    if (c->output && !known && !c->opt.rgba8) return cli_unknown_format(c);
    if (c->job.integral) return render_integral(c, p);
    SltStats stats = SLT_STATS_INIT;
    uint32_t channels = slt_channels(p), w = c->job.size[0], h = c->job.size[1], d = c->job.size[2];
    if (c->opt.rgba8) {
        status = write_rgba8(c, p, &stats);
        if (status == SLT_OK) print_result(c, p, &stats, NULL, 4);
        return status;
    }
    SltError err = {0};
    Image im = {0};
    /* A volume is its slices below each other, the first z on top. */
    if (image_create(&im, (int)w, (int)(h * d), (int)channels, &err) != SLT_OK) return cli_fail(c, &err);
    Progress pr;
    progress_begin(&pr, c, "render");
    c->job.progress = progress_job, c->job.progress_user = &pr;
    status = slt_render(p, &c->job, im.data, &stats, &err);
    progress_end(&pr);
    stats.upset = 0; /* of derivatives, as the warnings that cli_compile has left out */
    if (status == SLT_OK && c->output) {
        for (uint32_t k = 0; k < channels; k++) image_set_name(&im, (int)k, report_channel(channels, k));
        report_metadata(&im, c, p);
        ImageWriteOptions png = {.raw = slt_is_display(p)};
        status = slt_dim(p) == 3 ? volume_write(c->output, &im, (int)d, &png, &err)
                                 : image_write(c->output, &im, &png, &err);
    }
    if (status == SLT_OK) {
        print_result(c, p, &stats, im.data, channels);
        report_cells(c, &stats, NULL);
        report_dropped(c, &stats);
        status = report_status(&stats);
    } else {
        cli_fail(c, &err);
    }
    image_free(&im);
    return status;
}

int verb_render(Cli *c) {
    SltProgram *p;
    int status = cli_compile(c, &p);
    if (status == SLT_OK) status = render(c, p);
    cli_end_program(p);
    return status;
}
