/* Pictures of a fit: the best image of every view, the film strip, and frames that move. Of a volume a picture shows
 * four slices, the lowest first. */
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "cli/fit.h"

enum { GAP = 4, SLICES = 4, MAX_FRAMES = 2000, FRAME_MS = 80, LAST_MS = 1600 };

static const SltProgram *program_of(const Fit *f, uint32_t view) {
    return f->scene.views[view].program ? f->scene.views[view].program : f->p;
}

/* ---- all views in one picture */
typedef struct Layout {
    uint32_t columns, rows, slices; /* views beside each other and below; slices of each */
    uint32_t width, height;         /* of a slice */
    uint32_t channels;
} Layout;

static Layout layout(const Fit *f, uint32_t columns) {
    const SltJob *job = &f->c->job;
    uint32_t n = f->scene.nviews;
    Layout l = {.columns = columns, .rows = (n + columns - 1) / columns, .channels = slt_channels(program_of(f, 0))};
    l.width = job->size[0], l.height = job->size[1], l.slices = job->size[2] < SLICES ? job->size[2] : SLICES;
    for (uint32_t v = 1; v < n; v++)
        if (slt_channels(program_of(f, v)) != l.channels) l.channels = 3;
    return l;
}

static SltStatus create(const Layout *l, Image *out, SltError *err) {
    uint32_t across = l->columns * l->slices, w = across * (l->width + GAP) - GAP,
             h = l->rows * (l->height + GAP) - GAP;
    SltStatus s = image_create(out, (int)w, (int)h, (int)l->channels, err);
    for (size_t i = 0; s == SLT_OK && i < (size_t)w * h * l->channels; i++) out->data[i] = 1;
    return s;
}

/* Puts the image of a view where it belongs. */
static SltStatus put(const Layout *l, Image *out, uint32_t view, uint32_t channels, uint32_t depth, const float *image,
                     SltError *err) {
    size_t row = (size_t)l->width * l->channels;
    for (uint32_t k = 0; k < l->slices; k++) {
        uint32_t z = l->slices < depth ? (2 * k + 1) * depth / (2 * l->slices) : k;
        Image slice = {.width = (int)l->width, .height = (int)l->height, .channels = (int)channels}, fitted;
        slice.data = (float *)image + (size_t)z * l->width * l->height * channels;
        SltStatus s = image_convert_channels(&slice, (int)l->channels, &fitted, err);
        if (s != SLT_OK) return s;
        size_t x = (size_t)(view % l->columns * l->slices + k) * (l->width + GAP);
        size_t y = (size_t)(view / l->columns) * (l->height + GAP);
        for (uint32_t r = 0; r < l->height; r++)
            memcpy(out->data + ((y + r) * (size_t)out->width + x) * l->channels, fitted.data + r * row,
                   row * sizeof *out->data);
        image_free(&fitted);
    }
    return SLT_OK;
}

static float *view_buffer(const Fit *f) {
    const uint32_t *size = f->c->job.size;
    return cli_need(malloc((size_t)size[0] * size[1] * size[2] * 4 * sizeof(float)));
}

/* A picture is short: an interrupt ends the fit, not the picture. */
static SltJob uninterrupted(const Fit *f) {
    SltJob job = f->c->job;
    job.cancel = NULL, job.time_limit = 0;
    return job;
}

/* All views as they are now. */
static SltStatus draw(const Fit *f, SltFit *fit, const Layout *l, Image *out, SltError *err) {
    float *image = view_buffer(f);
    SltJob job = uninterrupted(f);
    SltStatus s = SLT_OK;
    for (uint32_t v = 0; v < f->scene.nviews && s == SLT_OK; v++) {
        s = slt_fit_image(fit, v, false, &job, image, err);
        if (s == SLT_OK) s = put(l, out, v, slt_channels(program_of(f, v)), f->c->job.size[2], image, err);
    }
    free(image);
    return s;
}

/* The same of images that are there, by view. */
static SltStatus gather(const Fit *f, const Layout *l, float *const *best, Image *out, SltError *err) {
    SltStatus s = create(l, out, err);
    for (uint32_t v = 0; v < f->scene.nviews && s == SLT_OK; v++) {
        const float *image = best ? best[v] : f->scene.views[v].target;
        if (image) s = put(l, out, v, slt_channels(program_of(f, v)), f->c->job.size[2], image, err);
    }
    return s;
}

static ImageWriteOptions png_options(const Fit *f) { return (ImageWriteOptions){.raw = slt_is_display(f->p)}; }

static uint32_t square(uint32_t n) {
    uint32_t side = 1;
    while (side * side < n) side++;
    return side;
}

/* ---- while it runs */
void fit_create_best(Fit *f) {
    f->best = cli_need(calloc(f->scene.nviews + 1, sizeof *f->best));
    for (uint32_t v = 0; v < f->scene.nviews; v++) f->best[v] = view_buffer(f);
}

SltStatus fit_create_pictures(Fit *f, SltError *err) {
    Layout l = layout(f, 1);
    SltStatus s = SLT_OK;
    /* Now: a picture that there is no memory for is no reason to lose hours of work, nor to leave it out. */
    for (uint32_t k = 0; k < STRIP && k < f->c->iters && s == SLT_OK; k++) s = create(&l, &f->strip[k], err);
    if (s == SLT_OK && f->c->frames && f->c->iters / f->c->frames >= MAX_FRAMES)
        return status_fail(err, SLT_USAGE, "a picture every %u of %u iterations are more than %d", f->c->frames,
                           f->c->iters, MAX_FRAMES);
    if (f->c->frames) f->frames = cli_need(calloc(MAX_FRAMES + 2, sizeof *f->frames));
    return s;
}

static SltStatus add_frame(Fit *f, const Image *im, uint32_t milliseconds, SltError *err) {
    ImageWriteOptions png = png_options(f);
    ImageFrame *frame = &f->frames[f->nframes];
    SltStatus s = image_encode("fit.png", im, &png, &frame->png, &frame->size, err);
    frame->milliseconds = milliseconds;
    if (s == SLT_OK) f->nframes++;
    return s;
}

SltStatus fit_take_pictures(Fit *f, SltFit *fit, SltError *err) {
    uint64_t done = f->done;
    SltStatus s = SLT_OK;
    if (done < f->c->iters && f->nstrip < STRIP && done * STRIP >= (uint64_t)f->nstrip * f->c->iters) {
        Layout l = layout(f, 1);
        s = draw(f, fit, &l, &f->strip[f->nstrip], err);
        if (s == SLT_OK) f->nstrip++;
    }
    if (s == SLT_OK && f->c->frames && done % f->c->frames == 0 && f->nframes < MAX_FRAMES) {
        Layout l = layout(f, square(f->scene.nviews));
        Image im;
        s = create(&l, &im, err);
        if (s == SLT_OK) s = draw(f, fit, &l, &im, err);
        if (s == SLT_OK) s = add_frame(f, &im, FRAME_MS, err);
        image_free(&im);
    }
    return s;
}

SltStatus fit_take_best(Fit *f, SltFit *fit, SltError *err) {
    SltJob job = uninterrupted(f);
    SltStatus s = SLT_OK;
    for (uint32_t v = 0; v < f->scene.nviews && s == SLT_OK; v++)
        s = slt_fit_image(fit, v, true, &job, f->best[v], err);
    return s;
}

SltStatus fit_end_frames(Fit *f, SltError *err) {
    Layout l = layout(f, square(f->scene.nviews));
    Image im;
    SltStatus s = gather(f, &l, f->best, &im, err);
    if (s == SLT_OK) s = add_frame(f, &im, LAST_MS, err);
    image_free(&im);
    return s;
}

/* ---- at the end */
static SltStatus write_image(Fit *f, const char *name, const Image *im, SltError *err) {
    char path[4096];
    ImageWriteOptions png = png_options(f);
    SltStatus s = fit_join(path, sizeof path, f->c->output, name, err);
    return s == SLT_OK ? image_write(path, im, &png, err) : s;
}

/* image.exr and image.png of the first view, image_1 of the next; of a volume the picture shows four slices. */
static SltStatus write_best(Fit *f, uint32_t view, SltError *err) {
    uint32_t channels = slt_channels(program_of(f, view));
    const uint32_t *size = f->c->job.size;
    char path[4096], name[64], number[32] = "";
    Image im;
    if (view) snprintf(number, sizeof number, "_%u", view);
    SltStatus s = image_create(&im, (int)size[0], (int)(size[1] * size[2]), (int)channels, err);
    if (s != SLT_OK) return s;
    memcpy(im.data, f->best[view], (size_t)size[0] * size[1] * size[2] * channels * sizeof(float));
    for (uint32_t k = 0; k < channels; k++) image_set_name(&im, (int)k, report_channel(channels, k));
    report_metadata(&im, f->c, f->p);
    snprintf(name, sizeof name, "image%s.exr", number);
    s = fit_join(path, sizeof path, f->c->output, name, err);
    if (s == SLT_OK)
        s = size[2] > 1 ? volume_write(path, &im, (int)size[2], NULL, err) : image_write(path, &im, NULL, err);
    snprintf(name, sizeof name, "image%s.png", number);
    if (s == SLT_OK && size[2] > 1) {
        Layout l = {.columns = 1, .rows = 1, .slices = size[2] < SLICES ? size[2] : SLICES, .width = size[0]};
        l.height = size[1], l.channels = channels;
        image_free(&im);
        s = create(&l, &im, err);
        if (s == SLT_OK) s = put(&l, &im, 0, channels, size[2], f->best[view], err);
    }
    if (s == SLT_OK) s = write_image(f, name, &im, err);
    image_free(&im);
    return s;
}

/* From left to right the fit as it went, the best and the target; a view a row. */
static SltStatus write_strip(Fit *f, SltError *err) {
    const Image *list[STRIP + 2];
    Image best = {0}, target = {0}, film = {0};
    Layout l = layout(f, 1);
    bool targets = false;
    int n = 0;
    for (uint32_t k = 0; k < f->nstrip; k++) list[n++] = &f->strip[k];
    SltStatus s = gather(f, &l, f->best, &best, err);
    list[n++] = &best;
    for (uint32_t v = 0; v < f->scene.nviews; v++) targets |= f->scene.views[v].target != NULL;
    if (s == SLT_OK && targets) s = gather(f, &l, NULL, &target, err), list[n++] = &target;
    if (s == SLT_OK) s = image_film_strip(list, n, GAP, &film, err);
    if (s == SLT_OK) s = write_image(f, "strip.png", &film, err);
    image_free(&film), image_free(&best), image_free(&target);
    return s;
}

static SltStatus write_frames(Fit *f, SltError *err) {
    char path[4096], name[64];
    uint8_t *bytes;
    size_t size;
    SltStatus s = image_join_png("fit.png", f->frames, f->nframes, &bytes, &size, err);
    if (s == SLT_OK && (s = fit_join(path, sizeof path, f->c->output, "fit.png", err)) == SLT_OK)
        s = file_write_atomic(path, bytes, size, err);
    free(bytes);
    if (s == SLT_OK && (s = fit_join(path, sizeof path, f->c->output, "frames", err)) == SLT_OK) mkdir(path, 0777);
    for (uint32_t k = 0; k < f->nframes && s == SLT_OK; k++) {
        snprintf(name, sizeof name, "frames/%04u.png", k);
        s = fit_join(path, sizeof path, f->c->output, name, err);
        if (s == SLT_OK) s = file_write_atomic(path, f->frames[k].png, f->frames[k].size, err);
    }
    return s;
}

SltStatus fit_write_pictures(Fit *f, SltError *err) {
    SltStatus s = SLT_OK;
    for (uint32_t v = 0; v < f->scene.nviews && s == SLT_OK; v++) s = write_best(f, v, err);
    if (s == SLT_OK) s = write_strip(f, err);
    return s == SLT_OK && f->c->frames ? write_frames(f, err) : s;
}

void fit_free_pictures(Fit *f) {
    for (uint32_t k = 0; k < STRIP; k++) image_free(&f->strip[k]);
    for (uint32_t v = 0; f->best && v < f->scene.nviews; v++) free(f->best[v]);
    free(f->best);
    for (uint32_t k = 0; k < f->nframes; k++) free(f->frames[k].png);
    free(f->frames);
}
