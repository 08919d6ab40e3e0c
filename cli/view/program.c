/* Compiling what is shown, and telling what it is. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cli/view/files.h"
#include "cli/view/viewer.h"
#include "runtime/base/text.h"

/* ---- what is told of a program */
static void put_list(FILE *out, const char *key, const double *v, uint32_t n) {
    fprintf(out, "\"%s\": [", key);
    for (uint32_t i = 0; i < n; i++) {
        if (i) json_comma(out);
        json_number(out, v[i]);
    }
    fputs("]", out);
}

static void put_param(FILE *out, const SltParam *q) {
    static const char *const kinds[] = {"float", "bool", "int", "uint", "struct"};
    fputs("{\"name\": ", out);
    json_text(out, q->name);
    fputs(", \"type\": ", out);
    json_text(out, q->type);
    fprintf(out, ", \"kind\": \"%s\", \"shape\": [", kinds[q->kind]);
    for (uint32_t i = 0; i < q->rank; i++) fprintf(out, i ? ", %u" : "%u", q->shape[i]);
    fprintf(out, "], \"numbers\": %u, \"differentiable\": %s, \"color\": %s, \"log\": %s, ", q->fcount + q->icount,
            q->differentiable ? "true" : "false", q->color ? "true" : "false", q->log ? "true" : "false");
    const double range[] = {q->lo, q->hi};
    if (q->has_range) put_list(out, "range", range, 2);
    else fputs("\"range\": null", out);
    fputs(", \"doc\": ", out);
    if (q->doc) json_text(out, q->doc);
    else fputs("null", out);
    fputs(", \"fields\": [", out);
    for (uint32_t i = 0; i < q->nfields; i++) {
        SltParam field = SLT_PARAM_INIT;
        if (!slt_param_field(q, i, &field)) break;
        if (i) json_comma(out);
        put_param(out, &field);
    }
    fputs("]}", out);
}

static void put_sites(FILE *out, const SltProgram *p) {
    const Fn *primal = p->prog->primal;
    fputs("\"sites\": [", out);
    for (uint32_t s = 0; s < primal->nsites && s < VIEW_SITES; s++) {
        const SiteInfo *i = &primal->sites[s];
        uint32_t line = 0, column = 0;
        if (i->span.file >= 0) span_position(p->session, i->span, &line, &column);
        fputs(s ? ", {\"file\": " : "{\"file\": ", out);
        json_text(out, i->span.file >= 0 ? p->session->sources[i->span.file].path : "");
        fprintf(out, ", \"line\": %u, \"column\": %u, \"text\": ", line, column);
        json_text(out, i->text ? i->text : "");
        fputs("}", out);
    }
    fputs("]", out);
}

static Blob *tell_program(const SltProgram *p) {
    Text made;
    FILE *out = cli_need(text_open(&made));
    double lo[3], hi[3];
    slt_domain(p, lo, hi);
    fputs("{\"entry\": ", out);
    json_text(out, slt_entry(p));
    fprintf(out, ", \"dim\": %u, \"channels\": %u, \"display\": %s, \"rand\": %s, ", slt_dim(p), slt_channels(p),
            slt_is_display(p) ? "true" : "false", slt_uses_rand(p) ? "true" : "false");
    put_list(out, "lo", lo, slt_dim(p));
    fputs(", ", out);
    put_list(out, "hi", hi, slt_dim(p));
    fputs(", \"parameters\": [", out);
    for (uint32_t i = 0; i < slt_param_count(p); i++) {
        SltParam q = SLT_PARAM_INIT;
        if (!slt_param(p, i, &q)) break;
        if (i) json_comma(out);
        put_param(out, &q);
    }
    fputs("], ", out);
    put_sites(out, p);
    fputs("}", out);
    char *text = cli_need(text_close(&made));
    Blob *b = cli_need(blob_copy(text, made.size));
    free(text);
    return b;
}

static void put_value(FILE *out, const Shown *s, const SltParam *q, uint32_t axis, uint32_t f, uint32_t i) {
    if (axis < q->rank) {
        uint32_t step = 1;
        for (uint32_t a = axis + 1; a < q->rank; a++) step *= q->shape[a];
        for (uint32_t k = 0; k < q->shape[axis]; k++) {
            fputs(k ? ", " : "[", out);
            put_value(out, s, q, axis + 1, f + k * step * q->fstride, i + k * step * q->istride);
        }
        fputs(q->shape[axis] ? "]" : "[]", out);
        return;
    }
    if (q->kind == SLT_KIND_STRUCT) {
        for (uint32_t k = 0; k < q->nfields; k++) {
            SltParam field = SLT_PARAM_INIT;
            if (!slt_param_field(q, k, &field)) break;
            fputs(k ? ", " : "{", out);
            json_text(out, field.name);
            fputs(": ", out);
            put_value(out, s, &field, 0, f + field.fbase - q->fbase, i + field.ibase - q->ibase);
        }
        fputs("}", out);
    } else if (q->kind == SLT_KIND_FLOAT) {
        if (s->p->opt.f64) json_number(out, slt_floats(s->p)[f]);
        else json_number_f32(out, (float)slt_floats(s->p)[f]); /* as /params has it */
    } else if (q->kind == SLT_KIND_BOOL) {
        fputs(slt_ints(s->p)[i] ? "true" : "false", out);
    } else {
        fprintf(out, q->kind == SLT_KIND_UINT ? "%u" : "%d", slt_ints(s->p)[i]);
    }
}

Blob *shown_values(const Shown *s) {
    Text made;
    FILE *out = cli_need(text_open(&made));
    uint32_t told = 0;
    fputs("{", out);
    for (uint32_t i = 0; i < slt_param_count(s->p); i++) {
        SltParam q = SLT_PARAM_INIT;
        if (!slt_param(s->p, i, &q) || told + q.fcount + q.icount > VIEW_VALUES) continue;
        if (told) json_comma(out);
        told += q.fcount + q.icount;
        json_text(out, q.name);
        fputs(": ", out);
        put_value(out, s, &q, 0, q.fbase, q.ibase);
    }
    fputs("}", out);
    char *text = cli_need(text_close(&made));
    Blob *b = cli_need(blob_copy(text, made.size));
    free(text);
    return b;
}

/* ---- compiling */
static void list_files(Shown *s, const Cli *c) {
    Text made;
    FILE *out = cli_need(text_open(&made));
    for (uint32_t i = 0; i < s->p->session->nsources; i++) {
        const Source *source = &s->p->session->sources[i];
        if (*source->path == '<') continue;
        fprintf(out, "%llx %s\n", (unsigned long long)files_hash(source->text, source->len), source->path);
    }
    for (uint32_t i = 0; i < c->nparam_files; i++) fprintf(out, "0 %s\n", c->param_files[i].value);
    if (c->params_file) fprintf(out, "0 %s\n", c->params_file);
    s->files = cli_need(text_close(&made));
}

/* Without --size the longer side has VIEW_SIDE pixels, the other as many as the domain is wide. */
static int choose_size(Cli *c, Shown *s) {
    const SltJob before = c->job;
    int status = cli_prepare_job(c, s->p);
    s->job = c->job;
    c->job = before;
    if (status != SLT_OK) return status;
    uint32_t dim = slt_dim(s->p), *size = s->job.size;
    double lo[3], hi[3];
    slt_domain(s->p, lo, hi);
    if (!c->size_given && dim == 3) size[0] = size[1] = 256, size[2] = VIEW_SLICES;
    if (!c->size_given && dim == 1) size[0] = VIEW_SIDE;
    if (!c->size_given && dim == 2) {
        double w = hi[0] - lo[0], h = hi[1] - lo[1], longer = fmax(w, h);
        size[0] = (uint32_t)fmax(1, round(VIEW_SIDE * w / longer));
        size[1] = (uint32_t)fmax(1, round(VIEW_SIDE * h / longer));
    }
    if (size[0] > VIEW_LARGEST || size[1] > VIEW_LARGEST)
        return cli_error(SLT_LIMIT, "--size: the viewer shows at most %d pixels along a side", VIEW_LARGEST);
    s->job.integral = false;
    if (!c->estimator_given) s->job.estimator = SLT_EST_LATTICE; /* what is on show must keep up with a hand */
    return SLT_OK;
}

static int compile_both(Cli *c, Shown *s) {
    c->told = 0;
    int status = cli_compile(c, &s->p);
    if (status == SLT_OK) status = choose_size(c, s), slt_set_print(s->p, NULL, NULL, NULL);
    if (status != SLT_OK || slt_dim(s->p) == 3 || slt_uses_rand(s->p) || c->opt.interpret) return status;
    bool quiet = c->quiet;
    c->opt.rgba8 = c->quiet = true; /* all has been said */
    status = cli_compile(c, &s->pixels);
    c->opt.rgba8 = false, c->quiet = quiet;
    slt_set_print(s->pixels, NULL, NULL, NULL); /* of every step of a slider */
    return status;
}

int shown_compile(Viewer *v, Shown **out, char **text) {
    Shown *s = *out = cli_need(calloc(1, sizeof *s));
    int status = compile_both(v->c, s);
    const char *said = slt_diagnostics_text(s->p);
    if (status != SLT_OK && !*said) said = slt_last_error(s->p);
    if (status != SLT_OK && !*said)
        said = "the program is not what the options of the command ask for: the terminal says more";
    *text = cli_need(strdup(said));
    list_files(s, v->c);
    if (status != SLT_OK) return status;
    s->text = tell_program(s->p);
    size_t nf = slt_float_count(s->p), ni = slt_int_count(s->p);
    s->floats = cli_need(malloc((nf + 1) * sizeof *s->floats));
    s->ints = cli_need(malloc((ni + 1) * sizeof *s->ints));
    memcpy(s->floats, slt_floats(s->p), nf * sizeof *s->floats);
    memcpy(s->ints, slt_ints(s->p), ni * sizeof *s->ints);
    return SLT_OK;
}

void shown_free(Shown *s) {
    if (!s) return;
    slt_program_free(s->pixels);
    slt_program_free(s->p);
    blob_drop(s->text);
    free(s->floats);
    free(s->ints);
    free(s->files);
    free(s);
}

/* ---- kernels, before somebody waits for them */
enum { SMALL = 16 };

static void *warm_pixels(void *user) {
    Shown *s = user;
    uint32_t pixels[SMALL * SMALL];
    SltJob job = s->job;
    job.size[0] = SMALL, job.size[1] = slt_dim(s->pixels) > 1 ? SMALL : 1, job.threads = 1, job.cancel = NULL;
    SltError ignored;
    slt_render_rgba8(s->pixels, &job, pixels, NULL, &ignored);
    return NULL;
}

void shown_warm(Shown *s, const char *overlay) {
    pthread_t other;
    bool both = s->pixels && *overlay && pthread_create(&other, NULL, warm_pixels, s) == 0;
    if (s->pixels && !both) warm_pixels(s);
    if (*overlay) {
        float *out = cli_need(malloc(SMALL * SMALL * sizeof(float) * slt_channels(s->p)));
        SltJob job = s->job;
        SltError ignored; /* a component that there is no more, too */
        job.size[0] = SMALL, job.size[1] = slt_dim(s->p) > 1 ? SMALL : 1, job.size[2] = 1, job.cancel = NULL;
        if (slt_dim(s->p) < 3) shown_gradient(s, &job, overlay, out, &ignored);
        free(out);
    }
    if (both) pthread_join(other, NULL);
}

/* ---- values */
static bool same_layout(const SltParam *a, const SltParam *b) {
    bool same = a->kind == b->kind && a->rank == b->rank && a->nfields == b->nfields && a->fcount == b->fcount &&
                a->icount == b->icount && !memcmp(a->shape, b->shape, a->rank * sizeof *a->shape);
    for (uint32_t i = 0; same && i < a->nfields; i++) {
        SltParam x = SLT_PARAM_INIT, y = SLT_PARAM_INIT;
        same = slt_param_field(a, i, &x) && slt_param_field(b, i, &y) && !strcmp(x.name, y.name) && same_layout(&x, &y);
    }
    return same;
}

void shown_carry(const Shown *from, Shown *to) {
    SltError ignored;
    for (uint32_t i = 0; i < slt_param_count(from->p); i++) {
        SltParam a = SLT_PARAM_INIT, b = SLT_PARAM_INIT;
        if (!slt_param(from->p, i, &a)) continue;
        const double *f = slt_floats(from->p) + a.fbase;
        const int32_t *n = slt_ints(from->p) + a.ibase;
        bool moved = memcmp(f, from->floats + a.fbase, a.fcount * sizeof *f) != 0 ||
                     memcmp(n, from->ints + a.ibase, a.icount * sizeof *n) != 0;
        if (!moved || slt_param_find(to->p, a.name, &b, &ignored) != SLT_OK || !same_layout(&a, &b)) continue;
        if (a.fcount) slt_set_floats(to->p, b.fbase, b.fcount, f, &ignored);
        if (a.icount) slt_set_ints(to->p, b.ibase, b.icount, n, &ignored);
    }
}

SltStatus shown_sync(Shown *s, SltError *err) {
    uint32_t nf = slt_float_count(s->p), ni = slt_int_count(s->p);
    if (!s->pixels) return SLT_OK;
    SltStatus status = nf ? slt_set_floats(s->pixels, 0, nf, slt_floats(s->p), err) : SLT_OK;
    return status == SLT_OK && ni ? slt_set_ints(s->pixels, 0, ni, slt_ints(s->p), err) : status;
}

SltStatus shown_choose(Shown *s, const char *component, SltError *err) {
    if (!strcmp(s->overlay, component)) return SLT_OK;
    s->overlay[0] = 0;
    SltStatus status = slt_wrt(s->p, &component, 1, err);
    if (status == SLT_OK) snprintf(s->overlay, sizeof s->overlay, "%s", component);
    return status;
}

SltStatus shown_gradient(Shown *s, const SltJob *job, const char *component, float *out, SltError *err) {
    SltParam q = SLT_PARAM_INIT;
    SltStatus status = slt_param_find(s->p, component, &q, err);
    if (status != SLT_OK) return status;
    if (q.kind != SLT_KIND_FLOAT && q.kind != SLT_KIND_STRUCT)
        return status_fail(err, SLT_USAGE, "`%s` is no float: it has no derivative", component);
    if (q.fcount != 1 || q.icount)
        return status_fail(err, SLT_USAGE, "`%s` is %u numbers: name one of them", component, q.fcount + q.icount);
    status = shown_choose(s, component, err);
    if (status != SLT_OK) return status;
    double *direction = cli_need(calloc(slt_float_count(s->p) + 1, sizeof *direction));
    const double *const directions[] = {direction};
    float *const images[] = {out};
    direction[q.fbase] = 1;
    status = slt_grad_images(s->p, job, 1, directions, images, NULL, NULL, err);
    free(direction);
    return status;
}
