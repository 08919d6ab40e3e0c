/* A fit in the viewer: its target, and one step after the other between answers. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cli/view/viewer.h"

/* ---- the target: as it came, in linear light unless the program's colours are a screen's */
static void keep_target(Viewer *v, Image *im) {
    image_free(&v->target);
    v->target = *im;
    pthread_mutex_lock(&v->lock);
    v->has_target = true;
    v->serial++;
    pthread_mutex_unlock(&v->lock);
    viewer_wake(v);
}

/* The root layer of a file with many. */
static SltStatus reduce(Image *im, SltError *err) {
    Image root;
    if (im->channels <= 4) return SLT_OK;
    SltStatus status = image_extract_layer(im, "", &root, err);
    image_free(im);
    if (status == SLT_OK) *im = root;
    return status;
}

SltStatus fit_open_target(Viewer *v, const char *path, bool display, SltError *err) {
    Image im;
    ImageReadOptions read = {.raw = display};
    SltStatus status = image_read(path, &read, &im, err);
    if (status == SLT_OK) status = reduce(&im, err);
    if (status == SLT_OK) keep_target(v, &im);
    return status;
}

static SltStatus draw_current(Viewer *v, Image *im, SltError *err) {
    SltJob job = v->shown->job;
    SltStatus status = image_create(im, (int)job.size[0], (int)job.size[1], (int)slt_channels(v->shown->p), err);
    if (status != SLT_OK) return status;
    job.interior = SLT_INTERIOR_SAMPLES;
    job.seed ^= 0x2545f491; /* others than the fit's */
    status = slt_render(v->shown->p, &job, im->data, NULL, err);
    if (status != SLT_OK) image_free(im);
    return status;
}

static void refuse(Viewer *v, const Ask *ask, const SltError *err) {
    viewer_refuse(v, ask, 422, "%s", err->text[0] ? err->text : status_name(err->status));
}

void fit_take_target(Viewer *v, const Ask *ask) {
    Image im;
    SltError err = {0};
    SltStatus status;
    if (slt_dim(v->shown->p) == 3) {
        viewer_refuse(v, ask, 422, "volumes are fitted by `saltus fit`");
        return;
    }
    if (ask->current) {
        status = draw_current(v, &im, &err);
    } else if (!ask->body || !ask->body->size) {
        viewer_refuse(v, ask, 422, "a target is the bytes of a picture, or ?current=1 for what is on show");
        return;
    } else {
        ImageReadOptions read = {.raw = slt_is_display(v->shown->p)};
        status = image_decode(ask->name, ask->body->data, ask->body->size, &read, &im, &err);
        if (status == SLT_OK) status = reduce(&im, &err);
    }
    if (status != SLT_OK) {
        refuse(v, ask, &err);
        return;
    }
    keep_target(v, &im);
    char text[64];
    int n = snprintf(text, sizeof text, "{\"size\": [%d, %d]}\n", v->target.width, v->target.height);
    viewer_answer(v, ask, 200, "application/json", NULL, blob_copy(text, (size_t)n));
}

/* The target at the size of the image, with so many channels. */
static SltStatus fitting_target(const Viewer *v, int channels, Image *out, SltError *err) {
    Image sized;
    SltStatus status = image_resize(&v->target, (int)v->shown->job.size[0], (int)v->shown->job.size[1], &sized, err);
    if (status != SLT_OK) return status;
    status = image_convert_channels(&sized, channels, out, err);
    image_free(&sized);
    return status;
}

void fit_show_target(Viewer *v, const Ask *ask) {
    Image im;
    SltError err = {0};
    uint8_t *bytes = NULL;
    size_t size = 0;
    if (!v->target.data) {
        viewer_refuse(v, ask, 404, "there is no target");
        return;
    }
    ImageWriteOptions png = {.raw = slt_is_display(v->shown->p)};
    SltStatus status = fitting_target(v, 3, &im, &err);
    if (status == SLT_OK) {
        status = image_encode("target.png", &im, &png, &bytes, &size, &err);
        image_free(&im);
    }
    if (status == SLT_OK) viewer_answer(v, ask, 200, "image/png", NULL, blob_copy(bytes, size));
    else refuse(v, ask, &err);
    free(bytes);
}

/* ---- what is asked for */
typedef struct Wish {
    const char *names[CLI_MAX_LIST];
    SltFitNumber rates[CLI_MAX_LIST];
    SltFitOptions options;
    SltJob job;
} Wish;

static bool whole(json_t *j, uint32_t lo, uint32_t hi, uint32_t *out) {
    json_int_t x = json_is_integer(j) ? json_integer_value(j) : -1;
    *out = (uint32_t)x;
    return x >= (json_int_t)lo && x <= (json_int_t)hi;
}

static SltStatus read_names(json_t *list, Wish *w, uint32_t *n, SltError *err) {
    if (!json_is_array(list) || json_array_size(list) > CLI_MAX_LIST)
        return status_fail(err, SLT_USAGE, "`parameters` is a list of names");
    for (*n = 0; *n < json_array_size(list); (*n)++)
        if (!(w->names[*n] = json_string_value(json_array_get(list, *n))))
            return status_fail(err, SLT_USAGE, "`parameters` is a list of names");
    return SLT_OK;
}

/* One number, or an object of numbers by the names of parameters. */
static SltStatus read_rates(json_t *j, Wish *w, SltError *err) {
    const char *name;
    json_t *rate;
    w->options.rates = w->rates;
    if (json_is_number(j) && json_number_value(j) >= 0) {
        w->rates[w->options.nrates++] = (SltFitNumber){NULL, json_number_value(j)};
        return SLT_OK;
    }
    json_object_foreach(j, name, rate) {
        if (!json_is_number(rate) || w->options.nrates == CLI_MAX_LIST) break;
        w->rates[w->options.nrates++] = (SltFitNumber){name, json_number_value(rate)};
    }
    if (json_is_object(j) && w->options.nrates == json_object_size(j)) return SLT_OK;
    return status_fail(err, SLT_USAGE, "`rate` is a number >= 0, or an object of such numbers by name");
}

static SltStatus read_wish(json_t *root, Wish *w, uint32_t *nnames, SltError *err) {
    const char *key;
    json_t *j;
    json_object_foreach(root, key, j) {
        SltStatus status = SLT_OK;
        if (!strcmp(key, "iterations")) {
            if (!whole(j, 1, VIEW_ITERATIONS, &w->options.iterations))
                return status_fail(err, SLT_USAGE, "`iterations` is a whole number from 1 to %d", VIEW_ITERATIONS);
        } else if (!strcmp(key, "spp")) {
            if (!whole(j, 1, 1024, &w->job.spp))
                return status_fail(err, SLT_USAGE, "`spp` is a whole number from 1 to 1024");
        } else if (!strcmp(key, "optimizer") && json_is_string(j)) {
            w->options.optimizer = json_string_value(j);
        } else if (!strcmp(key, "rate")) {
            status = read_rates(j, w, err);
        } else if (!strcmp(key, "parameters")) {
            status = read_names(j, w, nnames, err);
        } else {
            return status_fail(err, SLT_USAGE,
                               "`%s` is not understood: iterations, spp, optimizer, rate and parameters are", key);
        }
        if (status != SLT_OK) return status;
    }
    return SLT_OK;
}

/* ---- the fit */
static bool iterated(void *user, const SltFitIteration *at) {
    Viewer *v = user;
    pthread_mutex_lock(&v->lock);
    if (v->fit.done < VIEW_ITERATIONS) v->fit.losses[v->fit.done++] = at->loss;
    v->fit.best = at->best;
    v->version++;
    pthread_mutex_unlock(&v->lock);
    return false;
}

static SltStatus begin(Viewer *v, json_t *root, SltError *err) {
    Shown *s = v->shown;
    SltFitView view = SLT_FIT_VIEW_INIT;
    Wish w = {.options = SLT_FIT_OPTIONS_INIT, .job = s->job};
    uint32_t nnames = 0;
    Image target;
    w.job.cancel = &v->cancel;
    if (slt_dim(s->p) == 3) return status_fail(err, SLT_USAGE, "volumes are fitted by `saltus fit`");
    if (!v->target.data)
        return status_fail(err, SLT_USAGE, "there is no target: POST one to /target, or start with --target");
    SltStatus status = read_wish(root, &w, &nnames, err);
    if (status != SLT_OK) return status;
    s->overlay[0] = 0;
    status = slt_wrt(s->p, w.names, nnames, err);
    if (status == SLT_OK) status = fitting_target(v, (int)slt_channels(s->p), &target, err);
    if (status != SLT_OK) return status;
    size_t n = (size_t)target.width * (size_t)target.height * (size_t)target.channels;
    v->fit_target = cli_need(malloc((n + 1) * sizeof *v->fit_target));
    memcpy(v->fit_target, target.data, n * sizeof *v->fit_target);
    image_free(&target);
    view.target = v->fit_target;
    w.options.job = &w.job, w.options.views = &view, w.options.nviews = 1;
    w.options.iterated = iterated, w.options.iterated_user = v;
    double *losses = cli_need(malloc(VIEW_ITERATIONS * sizeof *losses));
    pthread_mutex_lock(&v->lock);
    free(v->fit.losses);
    v->fit.losses = losses;
    v->fit.serial++, v->fit.running = true, v->fit.iterations = w.options.iterations, v->fit.done = 0;
    v->fit.best = INFINITY, v->fit.reason[0] = 0;
    pthread_mutex_unlock(&v->lock);
    status = slt_fit_begin(s->p, &w.options, &v->fitting, err);
    if (status == SLT_OK) return SLT_OK;
    free(v->fit_target);
    v->fit_target = NULL;
    pthread_mutex_lock(&v->lock);
    v->fit.serial++, v->fit.running = false;
    snprintf(v->fit.reason, sizeof v->fit.reason, "%s", err->text);
    pthread_mutex_unlock(&v->lock);
    return status;
}

void fit_begin(Viewer *v, const Ask *ask) {
    json_error_t e;
    SltError err = {0};
    bool empty = !ask->body || !ask->body->size;
    json_t *root =
        empty ? json_object() : json_read((const char *)ask->body->data, ask->body->size, JSON_REJECT_DUPLICATES, &e);
    if (!json_is_object(root)) viewer_refuse(v, ask, 400, "an object in JSON is wanted");
    else if (begin(v, root, &err) != SLT_OK) refuse(v, ask, &err);
    else viewer_answer(v, ask, 202, "application/json", NULL, blob_copy("{\"running\": true}\n", 18));
    json_decref(root);
}

void fit_step(Viewer *v) {
    SltFitStop stop = SLT_FIT_RUNNING;
    SltError err = {0};
    SltStatus status = slt_fit_step(v->fitting, &stop, &err);
    SltError ignored;
    shown_sync(v->shown, &ignored);
    if (status == SLT_INTERRUPTED || stop == SLT_FIT_INTERRUPTED) fit_end(v, "stopped");
    else if (status != SLT_OK) fit_end(v, err.text);
    else if (stop != SLT_FIT_RUNNING) fit_end(v, NULL);
}

void fit_end(Viewer *v, const char *reason) {
    static const char *const words[] = {
        [SLT_FIT_RUNNING] = "stopped",     [SLT_FIT_ITERATIONS] = "all iterations are done",
        [SLT_FIT_CONVERGED] = "converged", [SLT_FIT_STOPPED] = "stopped",
        [SLT_FIT_INTERRUPTED] = "stopped", [SLT_FIT_TIME_LIMIT] = "the time is up",
        [SLT_FIT_FAILED] = "failed"};
    SltFitResult result = SLT_FIT_RESULT_INIT;
    SltError err = {0};
    slt_fit_end(v->fitting, &result, &err);
    v->fitting = NULL;
    free(result.losses);
    free(v->fit_target);
    v->fit_target = NULL;
    shown_sync(v->shown, &err);
    if (!reason) reason = result.reason[0] ? result.reason : words[result.stop];
    Blob *values = shown_values(v->shown);
    pthread_mutex_lock(&v->lock);
    blob_drop(v->values);
    v->values = values, v->told = ++v->version; /* whoever sees that it ended sees what it found */
    v->fit.serial++, v->fit.running = false;
    snprintf(v->fit.reason, sizeof v->fit.reason, "%s", reason);
    pthread_mutex_unlock(&v->lock);
    viewer_wake(v);
}
