/* Results in the shape of the parameters, statistics, warnings, names of components. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bindings/c/api.h"
#include "cli/cli.h"
#include "bindings/c/shape.h"
#include "runtime/base/threads.h"

const char *report_channel(uint32_t channels, uint32_t c) {
    static const char *const rgba[] = {"R", "G", "B", "A"};
    return channels == 1 ? "Y" : rgba[c];
}

static void leaf(void *user, FILE *out, TypeKind kind, uint32_t index) {
    const ShapeValues *v = user;
    (void)kind;
    if (v->channels == 1) {
        json_number(out, v->data[index]);
        return;
    }
    json_put(out, '[');
    for (uint32_t c = 0; c < v->channels; c++) {
        if (c) json_comma(out);
        json_number(out, v->data[(size_t)c * v->nfloats + index]);
    }
    json_put(out, ']');
}

/* A long array: threads write parts of it into memory, which go out in order. */
enum { PART = 1 << 14 }; /* numbers, about */
typedef struct LongArray {
    FILE *out;
    const Type *elem;
    const ShapeValues *values;
    ShapeCursor first, each; /* where the array begins, and what an element takes */
    uint32_t n, part, done;  /* elements: all, of a part, and written */
    struct {
        FILE *text;
        char *bytes;
        size_t size;
    } *worker;
} LongArray;

static void write_elements(FILE *out, const LongArray *a, uint32_t from, uint32_t to) {
    ShapeCursor at = {a->first.f + from * a->each.f, a->first.i + from * a->each.i};
    for (uint32_t k = from; k < to; k++) {
        if (k) json_comma(out);
        shape_write(out, a->elem, &at, true, leaf, (void *)a->values);
    }
}

static bool write_part(void *user, uint32_t worker, uint64_t part) {
    LongArray *a = user;
    FILE **text = &a->worker[worker].text;
    uint32_t from = (uint32_t)part * a->part, to = a->n - from < a->part ? a->n : from + a->part;
    if (!*text) *text = open_memstream(&a->worker[worker].bytes, &a->worker[worker].size);
    if (!*text) return false;
    rewind(*text);
    write_elements(*text, a, from, to);
    return !fflush(*text);
}

static void put_part(void *user, uint32_t worker, uint64_t part) {
    LongArray *a = user;
    (void)part;
    fwrite(a->worker[worker].bytes, 1, a->worker[worker].size, a->out);
    a->done = a->n - a->done < a->part ? a->n : a->done + a->part;
}

static void write_array(FILE *out, const Cli *c, const ParamRef *ref, const ShapeValues *v) {
    const uint32_t n = ref->type->n, floats = ref->fcount / n * v->channels;
    LongArray a = {.out = out,
                   .elem = ref->type->elem,
                   .values = v,
                   .first = {ref->fbase, ref->ibase},
                   .each = {ref->fcount / n, ref->icount / n},
                   .n = n,
                   .part = floats < PART ? PART / floats : 1};
    uint64_t parts = (n + (uint64_t)a.part - 1) / a.part;
    PoolOptions pool = {.threads = pool_threads(c->job.threads, parts)};
    a.worker = calloc(pool.threads, sizeof *a.worker);
    json_put(out, '[');
    if (a.worker) pool_run(&pool, parts, write_part, put_part, &a, NULL);
    write_elements(out, &a, a.done, n); /* where memory ran out */
    json_put(out, ']');
    for (uint32_t i = 0; i < pool.threads && a.worker; i++) {
        if (a.worker[i].text) fclose(a.worker[i].text);
        free(a.worker[i].bytes);
    }
    free(a.worker);
}

void report_gradient_json(FILE *out, const Cli *c, const SltProgram *p, const ShapeValues *v) {
    bool first = true;
    fputc('{', out);
    uint32_t n = c->nwrt ? c->nwrt : p->prog->nparams;
    for (uint32_t i = 0; i < n; i++) {
        ParamRef ref = {0};
        const char *name, *why;
        if (c->nwrt) {
            name = c->wrt[i];
            if (!program_find(p->prog, name, &ref, &why)) continue;
        } else {
            const Param *q = &p->prog->params[i];
            if (!q->differentiable || !q->fcount) continue;
            name = q->name;
            ref = (ParamRef){q, q->type, q->fbase, q->fcount, q->ibase, q->icount};
        }
        if (!first) fputs(", ", out);
        first = false;
        json_text(out, name);
        fputs(": ", out);
        bool whole = !strcmp(name, ref.param->name);
        ShapeCursor at = {ref.fbase, ref.ibase};
        bool array = ref.type->kind == T_ARRAY;
        if (whole && param_is_image(ref.param)) shape_write_texels(out, ref.param, leaf, (void *)v);
        else if (array && (uint64_t)ref.fcount * v->channels > PART) write_array(out, c, &ref, v);
        else shape_write(out, ref.type, &at, true, leaf, (void *)v);
    }
    fputc('}', out);
}

void report_stats_json(FILE *out, const SltStats *s) {
    fprintf(out, "\"samples\": %llu, \"segments\": %llu, \"crossings\": %llu, \"evaluations\": %llu, \"dropped\": {",
            (unsigned long long)s->samples, (unsigned long long)s->segments, (unsigned long long)s->crossings,
            (unsigned long long)s->evaluations);
    for (int r = 0; r < SLT_DROP_REASONS; r++)
        fprintf(out, "%s\"%s\": %llu", r ? ", " : "", slt_drop_names[r], (unsigned long long)s->dropped[r]);
    fprintf(out, "}, \"truncated\": %llu, \"asserts_failed\": %llu, \"nonfinite\": %llu, \"seconds\": ",
            (unsigned long long)s->truncated, (unsigned long long)s->asserts, (unsigned long long)s->nonfinite);
    json_number(out, s->seconds);
    fputs(", \"nonfinite_at\": ", out);
    report_place_json(out, &s->nonfinite_at);
}

/* NaN, which JSON has as null, where it is not finite. */
static double bounded(double v) { return isfinite(v) ? v : NAN; }

void report_cells_json(FILE *out, const SltStats *s, const double *derivative) {
    static const char *const stops[] = {"null", "\"evaluations\"", "\"rounding\""};
    if (!s->cells && !derivative) return;
    double left = s->cells ? s->left : 1, unknown = NAN; /* without cells nothing is proven */
    const struct {
        const char *key;
        double v;
    } list[] = {{"certified", s->certified},
                {"settled", s->settled},
                {"curved", s->curved},
                {"left", left},
                {"left_bound", s->cells ? bounded(derivative ? *derivative : s->left_bound) : unknown},
                {"value_left_bound", s->cells ? bounded(s->left_bound) : unknown}};
    for (size_t i = 0; i < sizeof list / sizeof *list; i++) {
        fprintf(out, "\"%s\": ", list[i].key);
        json_number(out, list[i].v);
        fputs(", ", out);
    }
    fprintf(out, "\"boxes\": %llu, \"stopped\": %s, ", (unsigned long long)s->boxes, stops[s->stopped]);
}

static void report_stop(const SltStats *s) {
    if (s->stopped == SLT_STOP_EVALUATIONS)
        fputs("saltus: warning: the error asked for was not reached: the evaluations ran out\n", stderr);
    if (s->stopped == SLT_STOP_ROUNDING)
        fputs("saltus: warning: the error asked for was not reached: rounding is larger\n", stderr);
}

void report_cells(const Cli *c, const SltStats *s, const double *derivative) {
    if (c->quiet || c->json) return;
    report_stop(s);
    if (!s->cells) {
        if (c->job.estimator == SLT_EST_QUADRATURE)
            fputs("saltus: note: no cells, nothing is certified: `saltus explain` says what has no bounds\n", stderr);
        return;
    }
    fprintf(stderr, "saltus: %.4g %% certified (%.4g %% settled, %.4g %% curves), %llu evaluations, %.3f s\n",
            100 * s->certified, 100 * s->settled, 100 * s->curved, (unsigned long long)s->evaluations, s->seconds);
    if (s->left > 0) {
        fprintf(stderr, "saltus: note: nothing is proven on the rest, %.2g of the domain; it hides ", s->left);
        if (isfinite(s->left_bound)) fprintf(stderr, "at most %.2g of a value", s->left_bound);
        else fputs("an unbounded part of a value", stderr);
        if (derivative && isfinite(*derivative)) fprintf(stderr, ", at most %.2g of a derivative", *derivative);
        else if (derivative) fputs("; of a derivative its part is estimated, not bounded", stderr);
        fputc('\n', stderr);
    }
}

int report_status(const SltStats *s) {
    if (s->asserts) return SLT_CHECK_FAILED;
    return s->stopped != SLT_STOP_NONE ? SLT_LIMIT : SLT_OK;
}

ReportMore report_unknown(const char *what, const double *value, const double *error, size_t n) {
    ReportMore more = {.code = "unknown_errors"};
    size_t unknown = 0;
    for (size_t i = 0; i < n; i++) unknown += isinf(error[i]) && isfinite(value[i]);
    more.said = unknown > 0;
    snprintf(more.text, sizeof more.text,
             "the errors of %zu %s are not known: too few samples or lines, or no crossing could be integrated",
             unknown, what);
    return more;
}

void report_more(const Cli *c, const ReportMore *more, size_t n) {
    for (size_t i = 0; i < n && !c->quiet; i++)
        if (more[i].said) cli_say(CLI_WARNING, more[i].code, NULL, "%s", more[i].text);
}

/* ---- names of components */
static uint32_t floats_in(const Type *t) {
    uint32_t n = 0;
    switch (t->kind) {
    case T_FLOAT: return 1;
    case T_VECTOR:
    case T_ARRAY: return t->n * floats_in(t->elem);
    case T_MATRIX: return type_components(t);
    case T_STRUCT:
        for (uint32_t k = 0; k < t->nfields; k++) n += floats_in(t->fields[k].type);
        return n;
    default: return 0;
    }
}

/* Appends where in t float `index` is, of floats_in(t). */
static void name_in(const Type *t, uint32_t index, char *buf, size_t size) {
    const size_t at = strlen(buf);
    const uint32_t each = t->kind == T_VECTOR || t->kind == T_ARRAY ? floats_in(t->elem) : 1;
    uint32_t field = 0;
    switch (t->kind) {
    case T_VECTOR:
    case T_ARRAY:
        if (t->kind == T_ARRAY) snprintf(buf + at, size - at, "[%u]", index / each);
        else snprintf(buf + at, size - at, ".%c", "xyzw"[index / each]);
        name_in(t->elem, index % each, buf, size);
        break;
    case T_MATRIX: snprintf(buf + at, size - at, "[%u][%u]", index / t->columns, index % t->columns); break;
    case T_STRUCT:
        for (uint32_t n; (n = floats_in(t->fields[field].type)) <= index; field++) index -= n;
        snprintf(buf + at, size - at, ".%s", t->fields[field].name);
        name_in(t->fields[field].type, index, buf, size);
        break;
    default: break;
    }
}

void report_component_name(const SltProgram *p, uint32_t index, char *buf, size_t size) {
    for (uint32_t i = 0; i < p->prog->nparams; i++) {
        const Param *q = &p->prog->params[i];
        if (index < q->fbase || index >= q->fbase + q->fcount) continue;
        uint32_t rest = index - q->fbase;
        if (param_is_image(q)) {
            uint32_t n[4], dims = param_texel_sizes(q, n), inner = q->fcount;
            int at = snprintf(buf, size, "%s", q->name);
            for (uint32_t k = 0; k < dims && at >= 0 && (size_t)at < size; k++, rest %= inner) {
                inner /= n[k];
                at += snprintf(buf + at, size - (size_t)at, "[%u]", rest / inner);
            }
            return;
        }
        snprintf(buf, size, "%s", q->name);
        name_in(q->type, rest, buf, size);
        return;
    }
    snprintf(buf, size, "?");
}

void report_layer_name(const Cli *c, const SltProgram *p, uint32_t index, char *buf, size_t size) {
    uint32_t n = c->nwrt ? c->nwrt : p->prog->nparams;
    for (uint32_t i = 0; i < n; i++) {
        ParamRef ref = {0};
        const char *name = c->nwrt ? c->wrt[i] : p->prog->params[i].name, *why;
        if (!program_find(p->prog, name, &ref, &why) || index < ref.fbase || index >= ref.fbase + ref.fcount) continue;
        if (ref.fcount == 1) snprintf(buf, size, "d.%s", name);
        else snprintf(buf, size, "d.%s.%u", name, index - ref.fbase);
        return;
    }
    snprintf(buf, size, "d.%u", index);
}

uint32_t report_components(const Cli *c, const SltProgram *p, char ***names, uint32_t **index) {
    uint32_t n = 0, cap = slt_float_count(p);
    *names = cli_need(calloc(cap + 1, sizeof **names));
    *index = cli_need(calloc(cap + 1, sizeof **index));
    const uint8_t *mask = slt_wrt_mask(p);
    (void)c;
    for (uint32_t i = 0; i < cap; i++) {
        if (!mask[i]) continue;
        if (n < CLI_MAX_COMPONENTS) {
            char buf[512];
            report_component_name(p, i, buf, sizeof buf);
            (*names)[n] = cli_need(strdup(buf));
        }
        (*index)[n++] = i;
    }
    return n;
}

void report_free_components(char **names, uint32_t *index, uint32_t n) {
    for (uint32_t i = 0; names && i < n && i < CLI_MAX_COMPONENTS; i++) free(names[i]);
    free(names);
    free(index);
}

void report_metadata(Image *im, const Cli *c, const SltProgram *p) {
    char version[64];
    snprintf(version, sizeof version, "saltus %s", slt_version());
    image_set_text(im, "saltus:version", version);
    image_set_text(im, "saltus:shader", c->expr ? c->expr : c->file);
    image_set_text(im, "saltus:entry", slt_entry(p));
    image_set_number(im, "saltus:seed", c->job.seed);
    image_set_number(im, "saltus:spp", c->job.spp);
    if (slt_float_count(p) <= 4096) {
        char *params = slt_params_json(p);
        if (params) image_set_text(im, "saltus:params", params);
        else im->incomplete = true;
        free(params);
    }
}
