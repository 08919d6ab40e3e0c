#include "bindings/c/shape.h"

#include "runtime/base/json.h"

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
    fputc('[', out);
    for (uint32_t k = 0; k < n; k++) {
        if (k) fputs(", ", out);
        shape_write(out, elem, at, floats_only, leaf, user);
    }
    fputc(']', out);
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
        fputc('[', out);
        for (uint32_t r = 0; r < t->n; r++) {
            if (r) fputs(", ", out);
            write_list(out, type_scalar(T_FLOAT), t->n, at, floats_only, leaf, user);
        }
        fputc(']', out);
        return;
    case T_STRUCT:
        fputc('{', out);
        for (uint32_t k = 0; k < t->nfields; k++) {
            if (floats_only && !has_floats(t->fields[k].type)) continue;
            if (!first) fputs(", ", out);
            first = false;
            json_text(out, t->fields[k].name);
            fputs(": ", out);
            shape_write(out, t->fields[k].type, at, floats_only, leaf, user);
        }
        fputc('}', out);
        return;
    default: fputs("null", out);
    }
}

void shape_write_texels(FILE *out, const Param *p, ShapeLeaf *leaf, void *user) {
    ShapeCursor at = {p->fbase, 0};
    fputc('[', out);
    for (uint32_t y = 0; y < p->tex_h; y++) {
        fputs(y ? ", [" : "[", out);
        for (uint32_t x = 0; x < p->tex_w; x++) {
            if (x) fputs(", ", out);
            if (p->tex_c > 1) write_list(out, type_scalar(T_FLOAT), p->tex_c, &at, true, leaf, user);
            else leaf(user, out, T_FLOAT, at.f++);
        }
        fputc(']', out);
    }
    fputc(']', out);
}
