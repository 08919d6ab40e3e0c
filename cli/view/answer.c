/* Answers of the computing thread: values, images, gradients, points, cells. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bindings/c/api.h"
#include "cli/view/viewer.h"
#include "runtime/base/text.h"

/* False: it was interrupted, and is to be asked again. */
static bool fail(Viewer *v, const Ask *ask, const SltError *err) {
    if (err->status == SLT_INTERRUPTED) return false;
    viewer_refuse(v, ask, err->status == SLT_INTERNAL ? 500 : 422, "%s", err->text);
    return true;
}

/* ---- values */
/* Numbers, truths, and lists and objects of these: a text would name a file. */
static bool is_plain(const json_t *j, uint32_t depth) {
    size_t i;
    const char *key;
    json_t *part;
    if (depth > 16) return false;
    if (json_is_array(j)) {
        json_array_foreach(j, i, part) if (!is_plain(part, depth + 1)) return false;
        return true;
    }
    if (json_is_object(j)) {
        json_object_foreach((json_t *)j, key, part) if (!is_plain(part, depth + 1)) return false;
        return true;
    }
    return json_is_number(j) || json_is_boolean(j);
}

static bool is_held(const json_t *j, double most) {
    size_t i;
    const char *key;
    json_t *part;
    if (json_is_array(j)) {
        json_array_foreach(j, i, part) if (!is_held(part, most)) return false;
        return true;
    }
    json_object_foreach((json_t *)j, key, part) if (!is_held(part, most)) return false;
    return !json_is_real(j) || fabs(json_real_value(j)) <= most;
}

static SltStatus set_params(Viewer *v, json_t *params, SltError *err) {
    const char *name;
    json_t *value;
    json_object_foreach(params, name, value) {
        if (!is_plain(value, 0))
            return status_fail(err, SLT_USAGE, "`%s`: numbers are wanted, or lists or objects of numbers", name);
        if (!v->shown->p->opt.f64 && !is_held(value, FLT_MAX))
            return status_fail(err, SLT_USAGE, "`%s`: single precision holds no such number; --precision f64 does",
                               name);
        char *text = cli_need(json_dumps(value, JSON_ENCODE_ANY | JSON_REAL_PRECISION(17)));
        SltStatus status = slt_set_text(v->shown->p, name, text, err);
        free(text);
        if (status != SLT_OK) return status;
    }
    return SLT_OK;
}

/* All of them or none. */
static SltStatus change(Viewer *v, json_t *params, bool reset, SltError *err) {
    SltProgram *p = v->shown->p;
    SltError ignored;
    uint32_t nf = slt_float_count(p), ni = slt_int_count(p);
    double *f = cli_need(malloc((nf + 1) * sizeof *f));
    int32_t *n = cli_need(malloc((ni + 1) * sizeof *n));
    memcpy(f, slt_floats(p), nf * sizeof *f);
    memcpy(n, slt_ints(p), ni * sizeof *n);
    SltStatus status = SLT_OK;
    if (reset && nf) status = slt_set_floats(p, 0, nf, v->shown->floats, err);
    if (reset && ni && status == SLT_OK) status = slt_set_ints(p, 0, ni, v->shown->ints, err);
    if (status == SLT_OK && params) status = set_params(v, params, err);
    if (status == SLT_OK) status = shown_sync(v->shown, err);
    if (status != SLT_OK) {
        if (nf) slt_set_floats(p, 0, nf, f, &ignored);
        if (ni) slt_set_ints(p, 0, ni, n, &ignored);
    }
    free(f);
    free(n);
    return status;
}

static bool take_whole(Viewer *v, const Ask *ask, json_t *j, const char *key, uint32_t lo, uint32_t hi, uint32_t *out) {
    json_int_t x = json_is_integer(j) ? json_integer_value(j) : -1;
    if (x < (json_int_t)lo || x > (json_int_t)hi) {
        viewer_refuse(v, ask, 422, "`%s` is a whole number from %u to %u", key, lo, hi);
        return false;
    }
    *out = (uint32_t)x;
    return true;
}

static bool take_settings(Viewer *v, const Ask *ask, json_t *root) {
    const char *key;
    json_t *j, *params = NULL;
    bool reset = false;
    uint32_t spp = v->spp, slice = v->slice;
    json_object_foreach(root, key, j) {
        if (!strcmp(key, "params") && json_is_object(j)) params = j;
        else if (!strcmp(key, "reset") && json_is_boolean(j)) reset = json_is_true(j);
        else if (!strcmp(key, "spp")) {
            if (!take_whole(v, ask, j, key, 1, 1024, &spp)) return false;
        } else if (!strcmp(key, "slice")) {
            if (!take_whole(v, ask, j, key, 0, v->size[2] - 1, &slice)) return false;
        } else {
            viewer_refuse(v, ask, 422,
                          "`%s` is not understood: params (an object), reset (true or false), spp and slice are", key);
            return false;
        }
    }
    if ((params || reset) && v->fitting) {
        viewer_refuse(v, ask, 409, "a fit is running: its parameters are not to be set; POST /fit/stop ends it");
        return false;
    }
    SltError err = {0};
    if ((params || reset) && change(v, params, reset, &err) != SLT_OK) {
        fail(v, ask, &err);
        return false;
    }
    pthread_mutex_lock(&v->lock);
    v->spp = spp, v->slice = slice;
    v->version++;
    pthread_mutex_unlock(&v->lock);
    return true;
}

bool answer_set(Viewer *v, const Ask *ask) {
    json_error_t e;
    if (!ask->body || !ask->body->size) return true;
    if (!v->shown) {
        viewer_refuse(v, ask, 409, "there is no program yet: the source has errors");
        return false;
    }
    json_t *root = json_read((const char *)ask->body->data, ask->body->size, JSON_REJECT_DUPLICATES, &e);
    bool ok = json_is_object(root);
    if (root && !ok) viewer_refuse(v, ask, 400, "an object is wanted");
    if (!root) viewer_refuse(v, ask, 400, "this is no JSON: line %d: %s", e.line, e.text);
    ok = ok && take_settings(v, ask, root);
    json_decref(root);
    return ok;
}

/* ---- images */
static void to_bytes(const float *from, size_t pixels, uint32_t channels, bool display, uint8_t *to) {
    for (size_t i = 0; i < pixels; i++, from += channels, to += 4) {
        for (uint32_t k = 0; k < 3; k++) {
            float value = channels == 1 ? from[0] : k < channels ? from[k] : 0;
            value = display ? fminf(fmaxf(value, 0), 1) : image_encode_srgb(value);
            to[k] = (uint8_t)(255 * value + 0.5f);
        }
        to[3] = 255;
    }
}

static Blob *encode_png(const Blob *rgba, uint32_t w, uint32_t h, SltError *err) {
    uint8_t *bytes;
    size_t size;
    if (image_encode_png8("image.png", (int)w, (int)h, 4, rgba->data, &bytes, &size, err) != SLT_OK) return NULL;
    Blob *b = cli_need(blob_copy(bytes, size));
    free(bytes);
    return b;
}

/* A slice of a volume, one sample in the middle of each pixel: of the others nothing is computed. */
static SltStatus render_slice(Viewer *v, const SltJob *job, float *image, SltError *err) {
    SltProgram *p = v->shown->p;
    uint32_t w = job->size[0], h = job->size[1], channels = slt_channels(p);
    size_t n = (size_t)w * h;
    double lo[3], hi[3], *x = cli_need(malloc(3 * n * sizeof *x)), *out = cli_need(malloc(channels * n * sizeof *out));
    slt_domain(p, lo, hi);
    for (uint32_t row = 0; row < h; row++)
        for (uint32_t column = 0; column < w; column++) {
            double *at = x + 3 * ((size_t)row * w + column);
            at[0] = lo[0] + (column + 0.5) * ((hi[0] - lo[0]) / w);
            at[1] = lo[1] + (h - row - 0.5) * ((hi[1] - lo[1]) / h);
            at[2] = lo[2] + (v->slice + 0.5) * ((hi[2] - lo[2]) / v->size[2]);
        }
    SltStatus status = slt_eval(p, job, n, x, NULL, out, NULL, err);
    for (size_t i = 0; status == SLT_OK && i < channels * n; i++) image[i] = (float)out[i];
    free(x);
    free(out);
    return status;
}

static SltStatus render_floats(Viewer *v, SltJob *job, float *image, SltError *err) {
    if (slt_dim(v->shown->p) == 3) return render_slice(v, job, image, err);
    job->interior = SLT_INTERIOR_SAMPLES, job->centred = job->spp == 1;
    return slt_render(v->shown->p, job, image, NULL, err);
}

static SltJob job_of(Viewer *v, uint32_t scale) {
    SltJob job = v->shown->job;
    for (int d = 0; d < 2; d++) job.size[d] = job.size[d] / scale ? job.size[d] / scale : 1;
    job.spp = v->spp;
    job.cancel = &v->cancel;
    return job;
}

static Blob *make_image(Viewer *v, SltJob *job, ViewFormat format, SltError *err) {
    uint32_t w = job->size[0], h = job->size[1], channels = slt_channels(v->shown->p);
    size_t pixels = (size_t)w * h;
    SltStatus status;
    Blob *b;
    if (format != FORMAT_F32 && v->shown->pixels && job->spp == 1) {
        b = cli_need(blob_new(4 * pixels));
        status = slt_render_rgba8(v->shown->pixels, job, (uint32_t *)(void *)b->data, NULL, err);
    } else {
        Blob *floats = cli_need(blob_new(pixels * channels * sizeof(float)));
        status = render_floats(v, job, (float *)(void *)floats->data, err);
        b = format == FORMAT_F32 ? blob_keep(floats) : cli_need(blob_new(4 * pixels));
        if (format != FORMAT_F32 && status == SLT_OK)
            to_bytes((const float *)(const void *)floats->data, pixels, channels, slt_is_display(v->shown->p), b->data);
        blob_drop(floats);
    }
    Blob *png = status == SLT_OK && format == FORMAT_PNG ? encode_png(b, w, h, err) : NULL;
    if (status != SLT_OK || format == FORMAT_PNG) blob_drop(b), b = png;
    return b;
}

static const char *type_of(ViewFormat format) {
    return format == FORMAT_PNG ? "image/png" : "application/octet-stream";
}

static bool answer_image(Viewer *v, const Ask *ask) {
    SltJob job = job_of(v, ask->scale);
    SltError err = {0};
    if (ask->draft) job.spp = 1;
    bool same = v->image.body && v->image.version == v->version && v->image.generation == v->generation &&
                v->image.spp == job.spp && v->image.slice == v->slice && v->image.format == ask->format &&
                v->image.size[0] == job.size[0] && v->image.size[1] == job.size[1];
    if (!same) {
        blob_drop(v->image.body);
        v->image.version = v->version, v->image.generation = v->generation;
        v->image.size[0] = job.size[0], v->image.size[1] = job.size[1];
        v->image.spp = job.spp, v->image.slice = v->slice, v->image.format = ask->format;
        v->image.body = make_image(v, &job, ask->format, &err);
    }
    if (!v->image.body) return fail(v, ask, &err);
    char headers[200];
    snprintf(headers, sizeof headers,
             "X-Saltus-Width: %u\r\nX-Saltus-Height: %u\r\nX-Saltus-Channels: %u\r\nX-Saltus-Version: %llu\r\n"
             "X-Saltus-Generation: %u\r\n",
             job.size[0], job.size[1], ask->format == FORMAT_F32 ? slt_channels(v->shown->p) : 4,
             (unsigned long long)v->version, v->generation);
    viewer_answer(v, ask, 200, type_of(ask->format), headers, blob_keep(v->image.body));
    return true;
}

/* ---- gradients */
/* Colour by sign, opaque by size. The scale is the largest magnitude, of the mean over channels. */
static double draw_gradient(const float *from, size_t pixels, uint32_t channels, double gain, uint8_t *to) {
    double scale = 0;
    uint32_t shown = channels > 3 ? 3 : channels; /* opacity is no colour */
    for (int pass = 0; pass < 2; pass++)
        for (size_t i = 0; i < pixels; i++) {
            double value = 0;
            for (uint32_t k = 0; k < shown; k++) value += (double)from[i * channels + k] / shown;
            if (!pass) {
                if (isfinite(value)) scale = fmax(scale, fabs(value));
                continue;
            }
            double t = scale > 0 ? gain * value / scale : 0;
            colormap_diverging(t, to + 4 * i);
            to[4 * i + 3] = isnan(t) ? 255 : (uint8_t)(255 * fmin(1, sqrt(fabs(t))) + 0.5);
        }
    return scale;
}

static bool answer_gradient(Viewer *v, const Ask *ask) {
    SltJob job = job_of(v, ask->scale);
    SltError err = {0};
    uint32_t channels = slt_channels(v->shown->p), dim = slt_dim(v->shown->p), depth = dim == 3 ? job.size[2] : 1;
    size_t pixels = (size_t)job.size[0] * job.size[1];
    job.spp = v->shown->job.spp;
    if ((double)pixels * depth * channels > 1u << 28) {
        viewer_refuse(v, ask, 422, "a volume of %ux%ux%u is too large for a gradient", job.size[0], job.size[1], depth);
        return true;
    }
    pthread_mutex_lock(&v->lock);
    snprintf(v->overlay, sizeof v->overlay, "%s", ask->name);
    pthread_mutex_unlock(&v->lock);
    float *image = cli_need(malloc((pixels * depth * channels + 1) * sizeof *image));
    SltStatus status = shown_gradient(v->shown, &job, ask->name, image, &err);
    const float *slice = image + (dim == 3 ? v->slice * pixels * channels : 0);
    Blob *b = cli_need(blob_new(ask->format == FORMAT_F32 ? pixels * channels * sizeof(float) : 4 * pixels));
    double scale = 0;
    if (status == SLT_OK && ask->format == FORMAT_F32) memcpy(b->data, slice, pixels * channels * sizeof(float));
    else if (status == SLT_OK) scale = draw_gradient(slice, pixels, channels, ask->gain, b->data);
    Blob *png = status == SLT_OK && ask->format == FORMAT_PNG ? encode_png(b, job.size[0], job.size[1], &err) : NULL;
    if (ask->format == FORMAT_PNG) blob_drop(b), b = png;
    bool done = true;
    if (status != SLT_OK || !b) {
        done = fail(v, ask, &err);
        blob_drop(b);
    } else {
        char headers[200];
        snprintf(headers, sizeof headers,
                 "X-Saltus-Width: %u\r\nX-Saltus-Height: %u\r\nX-Saltus-Channels: %u\r\nX-Saltus-Scale: %.9g\r\n"
                 "X-Saltus-Version: %llu\r\n",
                 job.size[0], job.size[1], ask->format == FORMAT_F32 ? channels : 4, scale,
                 (unsigned long long)v->version);
        viewer_answer(v, ask, 200, type_of(ask->format), headers, b);
    }
    free(image);
    return done;
}

/* ---- what looks into the program, inside session_protect */
typedef struct Looking {
    Viewer *v;
    const Ask *ask;
    SltStatus status;
    ExplainedPoint point;
    ExplainedCells cells;
    SltError err;
} Looking;

static void look(Session *s, void *user) {
    Looking *l = user;
    Shown *shown = l->v->shown;
    (void)s;
    if (l->ask->kind == ASK_CELLS) l->status = explain_draw_cells(shown->p, &l->cells, &l->err);
    else l->status = explain_point(shown->p, &shown->traced, l->ask->x, &l->point, &l->err);
}

static bool answer_look(Viewer *v, const Ask *ask) {
    Looking l = {.v = v, .ask = ask};
    SltProgram *p = v->shown->p;
    double f[4];
    uint32_t dim = slt_dim(p);
    if (ask->kind == ASK_POINT && ask->nx != dim) {
        viewer_refuse(v, ask, 422, "at wants %u number%s for this domain", dim, dim == 1 ? "" : "s");
        return true;
    }
    /* An evaluation brings what is computed from parameters up to date. */
    if (slt_eval(p, NULL, 1, ask->x, NULL, f, NULL, &l.err) != SLT_OK) return fail(v, ask, &l.err);
    int unwound = session_protect(p->session, look, &l);
    if (unwound) status_fail(&l.err, l.status = (SltStatus)unwound, "%s", p->session->unwind_text);
    bool done = true;
    if (l.status != SLT_OK) {
        done = fail(v, ask, &l.err);
    } else if (ask->kind == ASK_CELLS) {
        char headers[200];
        snprintf(headers, sizeof headers,
                 "X-Saltus-Cells: %zu\r\nX-Saltus-Settled: %.9g\r\nX-Saltus-Curved: %.9g\r\nX-Saltus-Left: %.9g\r\n",
                 l.cells.ncells, l.cells.counts.settled, l.cells.counts.curved, l.cells.counts.left);
        viewer_answer(v, ask, 200, "image/svg+xml", headers, blob_copy(l.cells.svg, l.cells.size));
    } else {
        Text made;
        FILE *out = cli_need(text_open(&made));
        explain_json_point(out, &l.point);
        fputs("\n", out);
        char *text = cli_need(text_close(&made));
        viewer_answer(v, ask, 200, "application/json", NULL, blob_copy(text, made.size));
        free(text);
    }
    explain_free_point(&l.point);
    free(l.cells.svg);
    return done;
}

/* ---- */
static void answer_version(Viewer *v, const Ask *ask) {
    char text[64];
    int n = snprintf(text, sizeof text, "{\"version\": %llu}\n", (unsigned long long)v->version);
    viewer_answer(v, ask, 200, "application/json", NULL, blob_copy(text, (size_t)n));
}

static void answer_params(Viewer *v, const Ask *ask) {
    char *text = cli_need(slt_params_json(v->shown->p));
    viewer_answer(v, ask, 200, "application/json", "Content-Disposition: attachment; filename=\"params.json\"\r\n",
                  blob_copy(text, strlen(text)));
    free(text);
}

bool answer_ask(Viewer *v, const Ask *ask) {
    if (!v->shown) {
        viewer_refuse(v, ask, 409, "there is no program yet: the source has errors");
        return true;
    }
    bool uses = ask->kind == ASK_GRADIENT || ask->kind == ASK_CELLS || ask->kind == ASK_POINT || ask->kind == ASK_FIT;
    if (uses && v->fitting) {
        viewer_refuse(v, ask, 409, "a fit is running, which has the program: POST /fit/stop ends it");
        return true;
    }
    switch (ask->kind) {
    case ASK_SET: answer_version(v, ask); break;
    case ASK_IMAGE: return answer_image(v, ask);
    case ASK_GRADIENT: return answer_gradient(v, ask);
    case ASK_CELLS:
    case ASK_POINT: return answer_look(v, ask);
    case ASK_PARAMS: answer_params(v, ask); break;
    case ASK_TARGET: fit_take_target(v, ask); break;
    case ASK_SHOW_TARGET: fit_show_target(v, ask); break;
    case ASK_FIT: fit_begin(v, ask); break;
    }
    return true;
}
