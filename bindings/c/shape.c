#include "bindings/c/shape.h"

#include <string.h>

#include "runtime/base/json.h"

/* ---- as numbers */
static void add_dimension(SltParam *out, uint32_t n) {
    if (out->rank < SLT_MAX_RANK) out->shape[out->rank++] = n;
    else out->shape[SLT_MAX_RANK - 1] *= n;
}

void shape_describe(const Param *q, const Type *t, uint32_t within, SltParam *out) {
    out->rank = out->nfields = out->fstride = out->istride = 0, out->layout = NULL;
    memset(out->shape, 0, sizeof out->shape);
    if (param_is_image(q)) {
        uint32_t n[4], dims = param_texel_sizes(q, n);
        out->kind = SLT_KIND_FLOAT, out->fstride = 1;
        for (uint32_t k = within; k < dims; k++) add_dimension(out, n[k]);
        return;
    }
    uint32_t elements = 1;
    for (; t->kind == T_ARRAY || t->kind == T_VECTOR || t->kind == T_MATRIX; t = t->elem) {
        add_dimension(out, t->n), elements *= t->n;
        if (t->kind != T_MATRIX) continue;
        add_dimension(out, t->columns), elements *= t->columns;
        t = type_scalar(T_FLOAT);
        break;
    }
    switch (t->kind) {
    case T_BOOL: out->kind = SLT_KIND_BOOL; break;
    case T_INT: out->kind = SLT_KIND_INT; break;
    case T_UINT: out->kind = SLT_KIND_UINT; break;
    case T_STRUCT: out->kind = SLT_KIND_STRUCT, out->nfields = t->nfields, out->layout = t; break;
    default: out->kind = SLT_KIND_FLOAT;
    }
    if (elements) out->fstride = out->fcount / elements, out->istride = out->icount / elements;
}

static void count(const Type *t, uint32_t *floats, uint32_t *ints) {
    uint32_t n = t->kind == T_MATRIX ? type_components(t) : t->n, f = 0, i = 0;
    switch (t->kind) {
    case T_STRUCT:
        for (uint32_t k = 0; k < t->nfields; k++) count(t->fields[k].type, floats, ints);
        return;
    case T_VECTOR:
    case T_ARRAY: count(t->elem, &f, &i); break;
    case T_MATRIX: f = 1; break;
    case T_FLOAT: f = n = 1; break;
    default: i = n = 1;
    }
    *floats += n * f, *ints += n * i;
}

void shape_field(SltParam *q, uint32_t index) {
    const Type *t = q->layout;
    const Field *field = &t->fields[index];
    static const Param plain; /* a field is never a texture */
    for (uint32_t k = 0; k < index; k++) count(t->fields[k].type, &q->fbase, &q->ibase);
    q->fcount = q->icount = 0;
    count(field->type, &q->fcount, &q->icount);
    if (field->attrs) {
        q->log |= field->attrs->log;
        if (field->attrs->has_range) q->has_range = true, q->lo = field->attrs->lo, q->hi = field->attrs->hi;
    }
    q->name = field->name, q->type = field->type->name;
    q->differentiable &= q->fcount > 0;
    shape_describe(&plain, field->type, 0, q);
}

/* ---- as JSON */
static bool has_floats(const Type *t) {
    if (t->kind == T_STRUCT) {
        for (uint32_t k = 0; k < t->nfields; k++)
            if (has_floats(t->fields[k].type)) return true;
        return false;
    }
    if (t->kind == T_ARRAY || t->kind == T_VECTOR) return has_floats(t->elem);
    return t->kind == T_FLOAT || t->kind == T_MATRIX;
}

static void write_list(FILE *out, const Type *elem, uint32_t n, ShapeCursor *at, bool floats_only, ShapeLeaf *leaf,
                       void *user) {
    json_put(out, '[');
    for (uint32_t k = 0; k < n; k++) {
        if (k) json_comma(out);
        shape_write(out, elem, at, floats_only, leaf, user);
    }
    json_put(out, ']');
}

void shape_write(FILE *out, const Type *t, ShapeCursor *at, bool floats_only, ShapeLeaf *leaf, void *user) {
    bool first = true;
    switch (t->kind) {
    case T_FLOAT: leaf(user, out, T_FLOAT, at->f++); return;
    case T_BOOL:
    case T_INT:
    case T_UINT: leaf(user, out, t->kind, at->i++); return;
    case T_VECTOR:
    case T_ARRAY: write_list(out, t->elem, t->n, at, floats_only, leaf, user); return;
    case T_MATRIX:
        json_put(out, '[');
        for (uint32_t r = 0; r < t->n; r++) {
            if (r) json_comma(out);
            write_list(out, type_scalar(T_FLOAT), t->columns, at, floats_only, leaf, user);
        }
        json_put(out, ']');
        return;
    case T_STRUCT:
        json_put(out, '{');
        for (uint32_t k = 0; k < t->nfields; k++) {
            if (floats_only && !has_floats(t->fields[k].type)) continue;
            if (!first) json_comma(out);
            first = false;
            json_text(out, t->fields[k].name);
            fputs(": ", out);
            shape_write(out, t->fields[k].type, at, floats_only, leaf, user);
        }
        json_put(out, '}');
        return;
    default: fputs("null", out);
    }
}

static void write_texels(FILE *out, const uint32_t *n, uint32_t dims, ShapeCursor *at, ShapeLeaf *leaf, void *user) {
    if (dims == 1) {
        write_list(out, type_scalar(T_FLOAT), *n, at, true, leaf, user);
        return;
    }
    json_put(out, '[');
    for (uint32_t k = 0; k < *n; k++) {
        if (k) json_comma(out);
        write_texels(out, n + 1, dims - 1, at, leaf, user);
    }
    json_put(out, ']');
}

void shape_write_texels(FILE *out, const Param *p, ShapeLeaf *leaf, void *user) {
    ShapeCursor at = {p->fbase, 0};
    uint32_t n[4], dims = param_texel_sizes(p, n);
    write_texels(out, n, dims, &at, leaf, user);
}
