/* Parameter values from JSON, from files and from text. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <jansson.h>

#include "bindings/c/api.h"
#include "bindings/c/shape.h"
#include "bindings/c/values_plain.h"
#include "runtime/base/decimal.h"
#include "runtime/base/json.h"
#include "runtime/image/image.h"

/* Values go to staging vectors, which replace the program's only if all is well */
typedef struct Stage {
    SltProgram *p;
    double *floats;
    int32_t *ints;
    SltError *err;
    const char *shown;
} Stage;

static SltStatus bad_value(Stage *s, const char *path, const char *wanted) {
    return status_fail(s->err, SLT_INPUT, "%s: `%s` should be %s", s->shown, path, wanted);
}

static SltStatus read_value(Stage *s, json_t *j, const Type *t, ShapeCursor *c, const char *path) {
    char below[256];
    switch (t->kind) {
    case T_FLOAT:
        if (json_is_null(j)) s->floats[c->f++] = NAN;
        else if (json_is_number(j)) s->floats[c->f++] = json_number_value(j);
        else if (json_is_string(j) && !strcmp(json_string_value(j), "inf")) s->floats[c->f++] = INFINITY;
        else if (json_is_string(j) && !strcmp(json_string_value(j), "-inf")) s->floats[c->f++] = -INFINITY;
        else return bad_value(s, path, "a number");
        return SLT_OK;
    case T_BOOL:
        if (!json_is_boolean(j)) return bad_value(s, path, "true or false");
        s->ints[c->i++] = json_is_true(j);
        return SLT_OK;
    case T_INT:
    case T_UINT: {
        json_int_t v = json_integer_value(j);
        if (!json_is_integer(j)) return bad_value(s, path, "a whole number");
        if (t->kind == T_INT ? v < INT32_MIN || v > INT32_MAX : v < 0 || v > UINT32_MAX)
            return bad_value(s, path, "a 32-bit integer");
        s->ints[c->i++] = (int32_t)(uint32_t)v;
        return SLT_OK;
    }
    case T_VECTOR:
    case T_ARRAY:
    case T_MATRIX: {
        char wanted[64];
        snprintf(wanted, sizeof wanted, "a list of %u", t->n);
        if (!json_is_array(j) || json_array_size(j) != t->n) return bad_value(s, path, wanted);
        for (uint32_t k = 0; k < t->n; k++) {
            json_t *e = json_array_get(j, k);
            snprintf(below, sizeof below, "%s[%u]", path, k);
            if (t->kind != T_MATRIX) {
                SltStatus status = read_value(s, e, t->elem, c, below);
                if (status != SLT_OK) return status;
                continue;
            }
            snprintf(wanted, sizeof wanted, "a list of %u", t->columns);
            if (!json_is_array(e) || json_array_size(e) != t->columns) return bad_value(s, below, wanted);
            for (uint32_t m = 0; m < t->columns; m++) {
                SltStatus status = read_value(s, json_array_get(e, m), type_scalar(T_FLOAT), c, below);
                if (status != SLT_OK) return status;
            }
        }
        return SLT_OK;
    }
    case T_STRUCT: {
        if (!json_is_object(j)) return bad_value(s, path, "an object");
        const char *key;
        json_t *e;
        json_object_foreach(j, key, e) {
            bool known = false;
            for (uint32_t k = 0; k < t->nfields; k++) known |= !strcmp(key, t->fields[k].name);
            if (!known) return status_fail(s->err, SLT_INPUT, "%s: `%s` has no field `%s`", s->shown, path, key);
        }
        for (uint32_t k = 0; k < t->nfields; k++) {
            snprintf(below, sizeof below, "%s.%s", path, t->fields[k].name);
            e = json_object_get(j, t->fields[k].name);
            if (!e) return status_fail(s->err, SLT_INPUT, "%s: `%s` is missing", s->shown, below);
            SltStatus status = read_value(s, e, t->fields[k].type, c, below);
            if (status != SLT_OK) return status;
        }
        return SLT_OK;
    }
    default: return bad_value(s, path, "a value that JSON can hold");
    }
}

static SltStatus read_texels(Stage *s, json_t *j, const Param *q, ShapeCursor *c) {
    char wanted[96];
    snprintf(wanted, sizeof wanted, "%u rows of %u texels", q->tex_h, q->tex_w);
    if (!json_is_array(j) || json_array_size(j) != q->tex_h) return bad_value(s, q->name, wanted);
    for (uint32_t y = 0; y < q->tex_h; y++) {
        json_t *row = json_array_get(j, y);
        if (!json_is_array(row) || json_array_size(row) != q->tex_w) return bad_value(s, q->name, wanted);
        for (uint32_t x = 0; x < q->tex_w; x++) {
            json_t *texel = json_array_get(row, x);
            if (q->tex_c > 1 && (!json_is_array(texel) || json_array_size(texel) != q->tex_c))
                return bad_value(s, q->name, wanted);
            for (uint32_t k = 0; k < q->tex_c; k++) {
                SltStatus status =
                    read_value(s, q->tex_c > 1 ? json_array_get(texel, k) : texel, type_scalar(T_FLOAT), c, q->name);
                if (status != SLT_OK) return status;
            }
        }
    }
    return SLT_OK;
}

static SltStatus stage_begin(Stage *s) {
    s->floats = malloc((s->p->prog->nfloats + 1) * sizeof(double));
    s->ints = malloc((s->p->prog->nints + 1) * sizeof(int32_t));
    if (!s->floats || !s->ints) return status_fail(s->err, SLT_LIMIT, "out of memory for the parameters");
    memcpy(s->floats, s->p->floats, s->p->prog->nfloats * sizeof(double));
    if (s->p->prog->nints) memcpy(s->ints, s->p->ints, s->p->prog->nints * sizeof(int32_t));
    return SLT_OK;
}

static void stage_end(Stage *s, bool take) {
    if (take) {
        memcpy(s->p->floats, s->floats, s->p->prog->nfloats * sizeof(double));
        if (s->p->prog->nints) memcpy(s->p->ints, s->ints, s->p->prog->nints * sizeof(int32_t));
        api_params_changed(s->p, 0, s->p->prog->nfloats);
    }
    free(s->floats);
    free(s->ints);
}

/* The text may have infinities as 1e999, which the JSON reader refuses: "inf" and "-inf" take their place, which is
 * exactly as long. */
static void quote_infinities(char *text) {
    bool quoted = false;
    for (char *c = text; *c; c++) {
        if (quoted && *c == '\\' && c[1]) c++;
        else if (*c == '"') quoted = !quoted;
        else if (!quoted && !strncmp(c, "1e999", 5) && !strchr("0123456789.eE+-", c[5] ? c[5] : ' ')) {
            bool minus = c > text && c[-1] == '-';
            memcpy(minus ? c - 1 : c, minus ? "\"-inf\"" : "\"inf\"", minus ? 6 : 5);
            c += 4;
        }
    }
}

static json_t *parse_json(const char *text, const char *shown, SltError *err) {
    json_error_t e;
    char *copy = strdup(text);
    if (!copy) return status_fail(err, SLT_LIMIT, "out of memory for %s", shown), NULL;
    quote_infinities(copy);
    json_t *j = json_read(copy, strlen(copy), JSON_DECODE_ANY | JSON_REJECT_DUPLICATES, &e);
    free(copy);
    if (!j && json_no_memory(&e)) status_fail(err, SLT_LIMIT, "%s: out of memory", shown);
    else if (!j) status_fail(err, SLT_INPUT, "%s:%d:%d: %s", shown, e.line, e.column, e.text);
    return j;
}

static SltStatus read_image_param(Stage *s, const Param *q, const char *path);

/* {"file": "dem.exr"} as the value of a texture or a geometry; the path is relative to the folder of the text. */
static SltStatus read_named_file(Stage *s, const Param *q, const char *file) {
    char path[4096];
    const char *slash = strrchr(s->shown, '/');
    if (snprintf(path, sizeof path, "%.*s%s", slash && file[0] != '/' ? (int)(slash + 1 - s->shown) : 0, s->shown,
                 file) >= (int)sizeof path)
        return status_fail(s->err, SLT_INPUT, "%s: the path is too long", s->shown);
    return read_image_param(s, q, path);
}

static SltStatus read_param(Stage *s, const Param *q, json_t *j) {
    ShapeCursor c = {q->fbase, q->ibase};
    json_t *file = param_is_image(q) ? json_object_get(j, "file") : NULL;
    if (json_is_string(file) && json_object_size(j) == 1) return read_named_file(s, q, json_string_value(file));
    return param_is_image(q) ? read_texels(s, j, q, &c) : read_value(s, j, q->type, &c, q->name);
}

static SltStatus set_params_json(SltProgram *p, const char *text, const char *shown_name, SltError *err) {
    Stage s = {.p = p, .err = err, .shown = shown_name};
    SltStatus status = stage_begin(&s);
    if (status == SLT_OK && plain_params(p->prog, text, s.floats, s.ints)) return stage_end(&s, true), SLT_OK;
    json_t *root = status == SLT_OK ? parse_json(text, shown_name, err) : NULL;
    if (status == SLT_OK && !root) status = SLT_INPUT;
    if (status == SLT_OK && !json_is_object(root))
        status = status_fail(err, SLT_INPUT, "%s: an object of parameter names to values is wanted", shown_name);
    const char *key;
    json_t *j;
    if (status == SLT_OK) json_object_foreach(root, key, j) {
            ParamRef ref;
            status = api_find(p, key, SLT_INPUT, shown_name, &ref, err);
            if (status != SLT_OK) break;
            if (!strcmp(key, ref.param->name)) status = read_param(&s, ref.param, j);
            else {
                ShapeCursor c = {ref.fbase, ref.ibase};
                status = read_value(&s, j, ref.type, &c, key);
            }
            if (status != SLT_OK) break;
        }
    stage_end(&s, status == SLT_OK);
    json_decref(root);
    return status;
}

SltStatus slt_set_params_json(SltProgram *p, const char *text, const char *shown_name, SltError *err) {
    SltStatus status = api_enter_to_set(p, err);
    if (status != SLT_OK) return status;
    status = set_params_json(p, text, shown_name, err);
    api_release(p);
    return status;
}

/* ---- files */
static bool ends_with(const char *s, const char *end) {
    size_t n = strlen(s), m = strlen(end);
    return n >= m && !strcasecmp(s + n - m, end);
}

/* Numbers in order of declaration, from a table or an array file. */
static SltStatus fill_numbers(Stage *s, const Type *t, ShapeCursor *c, const double *v, size_t n, size_t *at) {
    if (t->kind <= T_FLOAT) {
        if (*at >= n) return SLT_INPUT;
        double x = v[(*at)++];
        if (t->kind == T_FLOAT) s->floats[c->f++] = x;
        else if (t->kind == T_BOOL) s->ints[c->i++] = x != 0;
        else s->ints[c->i++] = (int32_t)(int64_t)x;
        return SLT_OK;
    }
    if (t->kind == T_STRUCT) {
        for (uint32_t k = 0; k < t->nfields; k++)
            if (fill_numbers(s, t->fields[k].type, c, v, n, at) != SLT_OK) return SLT_INPUT;
        return SLT_OK;
    }
    uint32_t count = t->kind == T_MATRIX ? type_components(t) : t->n;
    const Type *elem = t->kind == T_MATRIX ? type_scalar(T_FLOAT) : t->elem;
    for (uint32_t k = 0; k < count; k++)
        if (fill_numbers(s, elem, c, v, n, at) != SLT_OK) return SLT_INPUT;
    return SLT_OK;
}

static SltStatus read_image_param(Stage *s, const Param *q, const char *path) {
    Image im;
    ImageReadOptions raw = {.raw = q->is_geometry || s->p->prog->display};
    SltStatus status = image_read(path, &raw, &im, s->err);
    if (status != SLT_OK) return status;
    if ((uint32_t)im.width != q->tex_w || (uint32_t)im.height != q->tex_h || (uint32_t)im.channels < q->tex_c)
        status = status_fail(s->err, SLT_INPUT, "%s is %dx%d with %d channels, but `%s` is %ux%u with %u", path,
                             im.width, im.height, im.channels, q->name, q->tex_w, q->tex_h, q->tex_c);
    for (size_t t = 0; status == SLT_OK && t < (size_t)q->tex_w * q->tex_h; t++)
        for (uint32_t c = 0; status == SLT_OK && c < q->tex_c; c++) {
            double v = (double)im.data[t * (size_t)im.channels + c];
            if (q->is_geometry && !isfinite(v))
                status = status_fail(s->err, SLT_INPUT, "%s: the height in row %zu, column %zu is not finite", path,
                                     t / q->tex_w, t % q->tex_w);
            s->floats[q->fbase + t * q->tex_c + c] = v;
        }
    image_free(&im);
    return status;
}

static SltStatus read_param_file(Stage *s, const Param *q, const char *path) {
    if (ends_with(path, ".json")) {
        uint8_t *bytes;
        size_t size;
        SltStatus status = file_read_all(path, &file_text, &bytes, &size, s->err);
        if (status != SLT_OK) return status;
        bool all = plain_param(q, (const char *)bytes, s->floats, s->ints);
        json_t *j = all ? NULL : parse_json((const char *)bytes, path, s->err);
        free(bytes);
        if (!j) return all ? SLT_OK : SLT_INPUT;
        s->shown = path;
        /* In a file of `fit` the parameter's value stands under its name. */
        json_t *own =
            json_is_object(j) && (q->is_texture || q->type->kind != T_STRUCT) ? json_object_get(j, q->name) : NULL;
        status = read_param(s, q, own ? own : j);
        json_decref(j);
        return status;
    }
    if (param_is_image(q)) return read_image_param(s, q, path);
    Table t;
    SltStatus status = table_read(path, &t, s->err);
    if (status != SLT_OK) return status;
    ShapeCursor c = {q->fbase, q->ibase};
    size_t at = 0, n = t.rows * t.cols;
    if (fill_numbers(s, q->type, &c, t.data, n, &at) != SLT_OK || at != n)
        status = status_fail(s->err, SLT_INPUT, "%s holds %zu numbers, but `%s` (%s) wants %u", path, n, q->name,
                             q->type->name, q->fcount + q->icount);
    table_free(&t);
    return status;
}

SltStatus api_set_text(SltProgram *p, const char *name, const char *value, SltError *err) {
    ParamRef ref;
    SltStatus status = api_find(p, name, SLT_USAGE, NULL, &ref, err);
    if (status != SLT_OK) return status;
    Stage s = {.p = p, .err = err, .shown = name};
    status = stage_begin(&s);
    if (status == SLT_OK && value[0] == '@') {
        if (strcmp(name, ref.param->name) != 0)
            status = status_fail(err, SLT_USAGE, "`%s`: a file gives a whole parameter", name);
        else status = read_param_file(&s, ref.param, value + 1);
    } else if (status == SLT_OK) {
        json_error_t e;
        json_t *j = json_read(value, strlen(value), JSON_DECODE_ANY, &e);
        char listed[256];
        if (!j && strchr(value, ',') && snprintf(listed, sizeof listed, "[%s]", value) < (int)sizeof listed)
            j = json_read(listed, strlen(listed), JSON_DECODE_ANY, &e);
        if (!j) { /* 1., .5, inf are no JSON */
            const char *end;
            double v = decimal_read(value, &end);
            if (end != value && !*end) j = isfinite(v) ? json_real(v) : NULL;
            if (!j && end != value && !*end && ref.fcount == 1 && ref.icount == 0) {
                s.floats[ref.fbase] = v;
                stage_end(&s, true);
                return SLT_OK;
            }
        }
        if (!j && json_no_memory(&e)) status = status_fail(err, SLT_LIMIT, "`%s`: out of memory", name);
        else if (!j)
            status =
                status_fail(err, SLT_USAGE, "`%s=%s`: a number, a list like [1, 2] or @file is wanted", name, value);
        else {
            ShapeCursor c = {ref.fbase, ref.ibase};
            status =
                !strcmp(name, ref.param->name) ? read_param(&s, ref.param, j) : read_value(&s, j, ref.type, &c, name);
            if (status == SLT_INPUT) status = SLT_USAGE, err ? (void)(err->status = SLT_USAGE) : (void)0;
        }
        json_decref(j);
    }
    stage_end(&s, status == SLT_OK);
    return status;
}

SltStatus slt_set_text(SltProgram *p, const char *name, const char *value, SltError *err) {
    SltStatus status = api_enter_to_set(p, err);
    if (status != SLT_OK) return status;
    status = api_set_text(p, name, value, err);
    api_release(p);
    return status;
}

SltStatus api_load_assets(SltProgram *p, SltError *err) {
    for (uint32_t i = 0; i < p->prog->nparams; i++) {
        const Param *q = &p->prog->params[i];
        if (!q->asset) continue;
        const char *path = q->asset;
        for (uint32_t k = 0; k < p->opt.nparam_files; k++)
            if (!strcmp(p->opt.param_files[k].name, q->name)) path = p->opt.param_files[k].value;
        Stage s = {.p = p, .err = err, .shown = path};
        SltStatus status = stage_begin(&s);
        if (status == SLT_OK) status = read_param_file(&s, q, path);
        stage_end(&s, status == SLT_OK);
        if (status != SLT_OK) return status;
    }
    return SLT_OK;
}

/* A limit is no mistake of the program: it ends the compilation. */
static bool cannot_probe(SltProgram *p, const SltError *err, const char **why) {
    if (err->status == SLT_LIMIT) session_limit(p->session, "%s", err->text);
    *why = arena_printf(&p->session->session, "%s", err->text);
    return false;
}

/* How many numbers and bools a value holds; a text, as a null or "inf" written by `fit`, is one. */
static uint32_t count_scalars(const json_t *j) {
    uint32_t n = 0;
    size_t i;
    const char *key;
    json_t *value;
    if (json_is_array(j)) json_array_foreach(j, i, value) n += count_scalars(value);
    else if (json_is_object(j)) json_object_foreach((json_t *)j, key, value) n += count_scalars(value);
    else n = 1;
    return n;
}

/* A list, or an object (a file of `fit`) that holds it under the name of the parameter that `path` was given for: of
 * texels in rows, or of an array's elements, of which the first tells how many numbers each has. */
static bool probe_json(SltProgram *p, const char *path, bool texels, uint32_t dims[4], uint32_t *ndims,
                       const char **why) {
    SltError err = {0};
    uint8_t *bytes = NULL;
    size_t size;
    json_t *root = NULL, *rows;
    if (file_read_all(path, &file_text, &bytes, &size, &err) == SLT_OK)
        root = parse_json((const char *)bytes, path, &err);
    free(bytes);
    if (!root) return cannot_probe(p, &err, why);
    rows = root;
    for (uint32_t k = 0; k < p->opt.nparam_files && json_is_object(root); k++)
        if (!strcmp(p->opt.param_files[k].value, path)) rows = json_object_get(root, p->opt.param_files[k].name);
    json_t *first = json_array_get(rows, 0), *texel = json_array_get(first, 0);
    bool ok = texels ? json_is_number(texel) || (json_is_array(texel) && json_array_size(texel)) : json_is_array(rows);
    if (ok && !texels) {
        bool nested = json_is_array(first) || json_is_object(first);
        dims[0] = (uint32_t)json_array_size(rows), dims[1] = nested ? count_scalars(first) : 1;
        *ndims = nested ? 2 : 1;
    } else if (ok) {
        dims[0] = (uint32_t)json_array_size(json_array_get(rows, 0)), dims[1] = (uint32_t)json_array_size(rows),
        dims[2] = json_is_array(texel) ? (uint32_t)json_array_size(texel) : 1;
        *ndims = 3;
    } else {
        *why = texels ? "rows of texels are wanted" : "a JSON list is wanted";
    }
    json_decref(root);
    return ok;
}

/* The dimensions of an asset, for the front end; *why on failure. */
bool api_probe_asset(void *user, const char *path, char kind, uint32_t dims[4], uint32_t *ndims, const char **why) {
    SltProgram *p = user;
    SltError err = {0};
    bool texels = kind == 't' || kind == 'g';
    if (ends_with(path, ".json")) return probe_json(p, path, texels, dims, ndims, why);
    if (texels) {
        Image im;
        ImageReadOptions raw = {.raw = kind == 'g'};
        if (image_read(path, &raw, &im, &err) != SLT_OK) return cannot_probe(p, &err, why);
        dims[0] = (uint32_t)im.width, dims[1] = (uint32_t)im.height,
        dims[2] = kind == 'g' ? 1 : (uint32_t)(im.channels > 4 ? 4 : im.channels);
        *ndims = 3;
        image_free(&im);
        return true;
    }
    if (ends_with(path, ".npy")) {
        NumArray a;
        if (npy_read(path, &a, &err) != SLT_OK) return cannot_probe(p, &err, why);
        *ndims = (uint32_t)a.rank;
        for (int d = 0; d < a.rank; d++) dims[d] = (uint32_t)a.shape[d];
        npy_free(&a);
        return true;
    }
    Table t;
    if (table_read(path, &t, &err) != SLT_OK) return cannot_probe(p, &err, why);
    *ndims = 2;
    dims[0] = (uint32_t)t.rows, dims[1] = (uint32_t)t.cols;
    table_free(&t);
    return true;
}
