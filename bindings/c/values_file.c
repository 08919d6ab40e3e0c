/* Parameter values from files: tables, images, JSON; and what a file's shape is, for sizes that it decides. */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "bindings/c/values_plain.h"
#include "bindings/c/values_read.h"
#include "runtime/base/json.h"
#include "runtime/image/image.h"

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

/* Between the question for its size and that for its values an image is not decoded twice. */
struct ProbedImage {
    char *path;
    bool raw;
    Image image;
};

void api_forget_probed(SltProgram *p) {
    if (!p->probed) return;
    image_free(&p->probed->image);
    free(p->probed->path), free(p->probed);
    p->probed = NULL;
}

/* Takes the image. */
static void keep_probed(SltProgram *p, const char *path, bool raw, Image *im) {
    api_forget_probed(p);
    struct ProbedImage *kept = p->keeps_probed ? malloc(sizeof *kept) : NULL;
    char *name = kept ? strdup(path) : NULL;
    if (name) {
        *kept = (struct ProbedImage){name, raw, *im};
        p->probed = kept;
        return;
    }
    free(kept);
    image_free(im);
}

static bool take_probed(SltProgram *p, const char *path, bool raw, Image *im) {
    struct ProbedImage *kept = p->probed;
    if (!kept || kept->raw != raw || strcmp(kept->path, path) != 0) return false;
    *im = kept->image;
    free(kept->path), free(kept);
    p->probed = NULL;
    return true;
}

static SltStatus read_image(SltProgram *p, bool raw, const char *path, Image *im, SltError *err) {
    const ImageReadOptions opt = {.raw = raw};
    return take_probed(p, path, raw, im) ? SLT_OK : image_read(path, &opt, im, err);
}

/* Of a texture or a geometry: its image, slices below each other. */
static SltStatus read_texels(SltProgram *p, const Param *q, bool raw, const char *path, Image *im, SltError *err) {
    ImageReadOptions opt = {.raw = raw};
    int depth = 0;
    SltStatus status = q->tex_d ? volume_read(path, &opt, im, &depth, err) : read_image(p, raw, path, im, err);
    if (status != SLT_OK) return status;
    uint32_t h = (uint32_t)(im->height / (depth ? depth : 1));
    char deep[32] = "", wanted[32] = "";
    if (q->tex_d) snprintf(deep, sizeof deep, "x%d", depth), snprintf(wanted, sizeof wanted, "x%u", q->tex_d);
    if ((uint32_t)im->width == q->tex_w && h == q->tex_h && (uint32_t)depth == q->tex_d &&
        (uint32_t)im->channels >= q->tex_c)
        return SLT_OK;
    status = status_fail(err, SLT_INPUT, "%s is %dx%u%s with %d channels, but `%s` is %ux%u%s with %u", path, im->width,
                         h, deep, im->channels, q->name, q->tex_w, q->tex_h, wanted, q->tex_c);
    image_free(im);
    return status;
}

SltStatus values_read_image(Stage *s, const Param *q, const char *path) {
    Image im;
    SltStatus status = read_texels(s->p, q, q->is_geometry || s->p->prog->display, path, &im, s->err);
    if (status != SLT_OK) return status;
    for (size_t t = 0; status == SLT_OK && t < (size_t)im.width * (size_t)im.height; t++)
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

SltStatus values_fill(Stage *s, const Param *q, const char *path, const double *v, size_t n) {
    ShapeCursor c = {q->fbase, q->ibase};
    size_t at = 0;
    if (fill_numbers(s, q->type, &c, v, n, &at) == SLT_OK && at == n) return SLT_OK;
    return status_fail(s->err, SLT_INPUT, "%s holds %zu numbers, but `%s` (%s) wants %u", path, n, q->name,
                       q->type->name, q->fcount + q->icount);
}

SltStatus values_read_file(Stage *s, const Param *q, const char *path) {
    if (ends_with(path, ".json")) {
        uint8_t *bytes;
        size_t size;
        SltStatus status = file_read_all(path, &file_text, &bytes, &size, s->err);
        if (status != SLT_OK) return status;
        bool all = plain_param(q, (const char *)bytes, s->floats, s->ints);
        json_t *j = all ? NULL : values_parse_json((const char *)bytes, path, s->err);
        free(bytes);
        if (!j) return all ? SLT_OK : SLT_INPUT;
        s->shown = path;
        /* In a file of `fit` the parameter's value stands under its name. */
        json_t *own =
            json_is_object(j) && (q->is_texture || q->type->kind != T_STRUCT) ? json_object_get(j, q->name) : NULL;
        status = values_read_param(s, q, own ? own : j);
        json_decref(j);
        return status;
    }
    if (param_is_image(q)) return values_read_image(s, q, path);
    if (values_is_mesh(path)) return values_read_mesh(s, q, path);
    Table t;
    SltStatus status = table_read(path, &t, s->err);
    if (status != SLT_OK) return status;
    status = values_fill(s, q, path, t.data, t.rows * t.cols);
    table_free(&t);
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
        if (status == SLT_OK) status = values_read_file(&s, q, path);
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

/* A list, or an object (a file of `fit`) that holds it under the parameter's name: of texels in rows, or of an array's
 * elements, of which the first tells how many numbers each has. */
static bool probe_json(SltProgram *p, const char *path, const Symbol *of, uint32_t dims[4], uint32_t *ndims,
                       const char **why) {
    SltError err = {0};
    uint8_t *bytes = NULL;
    size_t size;
    json_t *root = NULL, *rows;
    if (file_read_all(path, &file_text, &bytes, &size, &err) == SLT_OK)
        root = values_parse_json((const char *)bytes, path, &err);
    free(bytes);
    if (!root) return cannot_probe(p, &err, why);
    rows = json_is_object(root) ? json_object_get(root, of->doc_name) : root;
    bool texels = type_is_resource(of->type), volume = of->type->kind == T_TEXTURE3D, ok = json_is_array(rows);
    json_t *slice = volume ? json_array_get(rows, 0) : rows, *first = json_array_get(slice, 0),
           *texel = json_array_get(first, 0);
    if (texels) ok = json_is_number(texel) || (json_is_array(texel) && json_array_size(texel));
    if (ok && !texels) {
        bool nested = json_is_array(first) || json_is_object(first);
        dims[0] = (uint32_t)json_array_size(rows), dims[1] = nested ? count_scalars(first) : 1;
        *ndims = nested ? 2 : 1;
    } else if (ok) {
        dims[0] = (uint32_t)json_array_size(first), dims[1] = (uint32_t)json_array_size(slice);
        if (volume) dims[2] = (uint32_t)json_array_size(rows);
        dims[volume ? 3 : 2] = json_is_array(texel) ? (uint32_t)json_array_size(texel) : 1;
        *ndims = volume ? 4 : 3;
    } else {
        *why = volume   ? "slices of rows of texels are wanted"
               : texels ? "rows of texels are wanted"
                        : "a JSON list is wanted";
    }
    json_decref(root);
    return ok;
}

static SltStatus allow_slice(void *user, const char *path, SltError *err) {
    const char *why = sandbox_refusal(user, "", path);
    return why ? status_fail(err, errno == ENOMEM ? SLT_LIMIT : SLT_INPUT, "%s: %s", path, why) : SLT_OK;
}

/* Each slice of a stack may be a link that leads out of the sandbox. What the caller names is the caller's matter. */
static bool allows_stack(const SltProgram *p, const char *path, const Symbol *of, SltError *err) {
    bool own = p->session->sandbox && volume_is_stack(path);
    for (uint32_t k = 0; k < p->opt.nparam_files; k++) own &= strcmp(p->opt.param_files[k].name, of->doc_name) != 0;
    return !own || volume_each(path, allow_slice, (void *)p->session->sandbox, err) == SLT_OK;
}

uint32_t api_given_sizes(void *user, const char *name, uint32_t most, uint64_t *sizes) {
    SltProgram *p = user;
    uint32_t n = p->opt.lengths ? plain_sizes(p->opt.lengths, name, most, sizes) : 0;
    if (!n) return 0;
    /* Another entry of the source may be compiled later on. */
    if (!p->has_lengths) p->opt.lengths = arena_strndup(&p->session->session, p->opt.lengths, strlen(p->opt.lengths));
    p->has_lengths = true;
    return n;
}

/* The dimensions of an asset, for the front end; *why on failure. */
bool api_probe_asset(void *user, const char *path, const Symbol *of, uint32_t dims[4], uint32_t *ndims,
                     const char **why) {
    SltProgram *p = user;
    SltError err = {0};
    if (type_is_mesh(of->type))
        return values_probe_geometry(path, dims, ndims, &err) == SLT_OK || cannot_probe(p, &err, why);
    bool geometry = of->type->kind == T_GEOMETRY, texels = type_is_resource(of->type);
    if (ends_with(path, ".json")) return probe_json(p, path, of, dims, ndims, why);
    if (texels) {
        Image im;
        ImageReadOptions raw = {.raw = geometry};
        int depth = 0;
        bool volume = of->type->kind == T_TEXTURE3D;
        if (volume && !allows_stack(p, path, of, &err)) return cannot_probe(p, &err, why);
        SltStatus status = volume ? volume_read(path, &raw, &im, &depth, &err) : image_read(path, &raw, &im, &err);
        if (status != SLT_OK) return cannot_probe(p, &err, why);
        *ndims = volume ? 4 : 3;
        dims[0] = (uint32_t)im.width, dims[1] = (uint32_t)(im.height / (volume ? depth : 1));
        if (volume) dims[2] = (uint32_t)depth;
        dims[volume ? 3 : 2] = geometry ? 1 : (uint32_t)(im.channels > 4 ? 4 : im.channels);
        if (volume) image_free(&im);
        else keep_probed(p, path, raw.raw, &im);
        return true;
    }
    if (values_is_mesh(path))
        return values_probe_mesh(path, of->type, dims, ndims, &err) == SLT_OK || cannot_probe(p, &err, why);
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
