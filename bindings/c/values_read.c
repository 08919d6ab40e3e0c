/* Parameter values from JSON and from text. */
#include <ctype.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <jansson.h>

#include "bindings/c/values_plain.h"
#include "bindings/c/values_read.h"
#include "runtime/base/decimal.h"
#include "runtime/base/json.h"

static SltStatus bad_value(Stage *s, const char *path, const char *wanted) {
    return status_fail(s->err, SLT_INPUT, "%s: `%s` should be %s", s->shown, path, wanted);
}

static SltStatus read_value(Stage *s, json_t *j, const Type *t, ShapeCursor *c, const char *path);

/* A list of numbers where lists or objects are usual: all scalars of the value in order, as a line of a table. */
static bool is_line(const json_t *j, const Type *t) {
    const json_t *first = json_array_get(j, 0);
    bool parts = t->kind == T_MATRIX || t->kind == T_STRUCT || (t->kind == T_ARRAY && t->elem->kind > T_FLOAT);
    return parts && first && !json_is_array(first) && !json_is_object(first) &&
           json_array_size(j) == type_components(t);
}

static SltStatus read_line(Stage *s, json_t *line, size_t *at, const Type *t, ShapeCursor *c, const char *path) {
    uint32_t n = t->kind == T_STRUCT ? t->nfields : t->kind == T_MATRIX ? type_components(t) : t->n;
    if (t->kind <= T_FLOAT) return read_value(s, json_array_get(line, (*at)++), t, c, path);
    for (uint32_t k = 0; k < n; k++) {
        const Type *part = t->kind == T_STRUCT ? t->fields[k].type : t->elem;
        SltStatus status = read_line(s, line, at, part, c, path);
        if (status != SLT_OK) return status;
    }
    return SLT_OK;
}

static SltStatus read_value(Stage *s, json_t *j, const Type *t, ShapeCursor *c, const char *path) {
    char below[256];
    if (is_line(j, t)) return read_line(s, j, &(size_t){0}, t, c, path);
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

static SltStatus read_texels(Stage *s, json_t *j, const Param *q, const uint32_t *n, uint32_t dims, ShapeCursor *c) {
    if (!dims) return read_value(s, j, type_scalar(T_FLOAT), c, q->name);
    if (!json_is_array(j) || json_array_size(j) != *n) {
        char wanted[96];
        int at = q->tex_d ? snprintf(wanted, sizeof wanted, "%u slices of ", q->tex_d) : 0;
        snprintf(wanted + at, sizeof wanted - (size_t)at, "%u rows of %u texels", q->tex_h, q->tex_w);
        return bad_value(s, q->name, wanted);
    }
    SltStatus status = SLT_OK;
    for (uint32_t k = 0; status == SLT_OK && k < *n; k++)
        status = read_texels(s, json_array_get(j, k), q, n + 1, dims - 1, c);
    return status;
}

SltStatus stage_begin(Stage *s) {
    s->floats = malloc((s->p->prog->nfloats + 1) * sizeof(double));
    s->ints = malloc((s->p->prog->nints + 1) * sizeof(int32_t));
    if (!s->floats || !s->ints) return status_fail(s->err, SLT_LIMIT, "out of memory for the parameters");
    memcpy(s->floats, s->p->floats, s->p->prog->nfloats * sizeof(double));
    if (s->p->prog->nints) memcpy(s->ints, s->p->ints, s->p->prog->nints * sizeof(int32_t));
    return SLT_OK;
}

void stage_end(Stage *s, bool take) {
    if (take) {
        memcpy(s->p->floats, s->floats, s->p->prog->nfloats * sizeof(double));
        if (s->p->prog->nints) memcpy(s->p->ints, s->ints, s->p->prog->nints * sizeof(int32_t));
        api_params_changed(s->p, 0, program_floats(s->p->prog));
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

json_t *values_parse_json(const char *text, const char *shown, SltError *err) {
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

/* {"file": "dem.exr"} as the value of a texture or a geometry; the path is relative to the folder of the text. */
static SltStatus read_named_file(Stage *s, const Param *q, const char *file) {
    char path[4096];
    const char *slash = strrchr(s->shown, '/');
    if (snprintf(path, sizeof path, "%.*s%s", slash && file[0] != '/' ? (int)(slash + 1 - s->shown) : 0, s->shown,
                 file) >= (int)sizeof path)
        return status_fail(s->err, SLT_INPUT, "%s: the path is too long", s->shown);
    return q->is_mesh ? values_read_mesh(s, q, path) : values_read_image(s, q, path);
}

SltStatus values_read_param(Stage *s, const Param *q, json_t *j) {
    ShapeCursor c = {q->fbase, q->ibase};
    json_t *file = q->is_texture || q->is_geometry ? json_object_get(j, "file") : NULL;
    if (json_is_string(file) && json_object_size(j) == 1) return read_named_file(s, q, json_string_value(file));
    uint32_t n[4];
    return param_is_image(q) ? read_texels(s, j, q, n, param_texel_sizes(q, n), &c)
                             : read_value(s, j, q->type, &c, q->name);
}

static SltStatus set_params_json(SltProgram *p, const char *text, const char *shown_name, SltError *err) {
    Stage s = {.p = p, .err = err, .shown = shown_name};
    SltStatus status = stage_begin(&s);
    if (status == SLT_OK && plain_params(p->prog, text, s.floats, s.ints)) return stage_end(&s, true), SLT_OK;
    json_t *root = status == SLT_OK ? values_parse_json(text, shown_name, err) : NULL;
    if (status == SLT_OK && !root) status = SLT_INPUT;
    if (status == SLT_OK && !json_is_object(root))
        status = status_fail(err, SLT_INPUT, "%s: an object of parameter names to values is wanted", shown_name);
    const char *key;
    json_t *j;
    if (status == SLT_OK) json_object_foreach(root, key, j) {
            ParamRef ref;
            status = api_find(p, key, SLT_INPUT, shown_name, &ref, err);
            if (status != SLT_OK) break;
            if (!strcmp(key, ref.param->name)) status = values_read_param(&s, ref.param, j);
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

/* What is typed on a command line, as JSON: also lists without brackets, and .5 and 1., which are no numbers there. */
static json_t *read_typed(const char *value, json_error_t *e) {
    json_t *j = json_read(value, strlen(value), JSON_DECODE_ANY, e);
    char text[1024], *at = text;
    if (j || !strpbrk(value, ",.") || 3 * strlen(value) + 2 > sizeof text) return j;
    bool list = value[0] != '[' && value[0] != '{' && strchr(value, ',');
    if (list) *at++ = '[';
    for (const char *c = value; *c; c++) {
        bool dot = *c == '.';
        if (dot && (c == value || !isdigit((unsigned char)c[-1]))) *at++ = '0';
        *at++ = *c;
        if (dot && !isdigit((unsigned char)c[1])) *at++ = '0';
    }
    if (list) *at++ = ']';
    return json_read(text, (size_t)(at - text), JSON_DECODE_ANY, e);
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
        else status = values_read_file(&s, ref.param, value + 1);
    } else if (status == SLT_OK) {
        json_error_t e;
        json_t *j = read_typed(value, &e);
        if (!j) { /* inf and nan are no JSON */
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
            status = !strcmp(name, ref.param->name) ? values_read_param(&s, ref.param, j)
                                                    : read_value(&s, j, ref.type, &c, name);
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
