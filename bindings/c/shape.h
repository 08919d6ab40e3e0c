/* Values in the shape of a parameter, as JSON: a struct is an object, a vector or an array a list, a matrix its rows, a
 * texture rows of texels, top first. */
#ifndef SALTUS_BINDINGS_C_SHAPE_H
#define SALTUS_BINDINGS_C_SHAPE_H

#include "compiler/front/front.h"
#include "saltus/saltus.h"

/* Where the next scalar of a value lies in the two flat vectors of the program. */
typedef struct ShapeCursor {
    uint32_t f, i;
} ShapeCursor;

/* Writes one scalar: `index` counts floats, or integers and bools. */
typedef void ShapeLeaf(void *user, FILE *out, TypeKind kind, uint32_t index);

/* Kind, rank, shape, strides and layout of `out` for a value of type t at its place in the parameter q. */
void shape_describe(const Param *q, const Type *t, SltParam *out);
void shape_field(SltParam *q, uint32_t index); /* q becomes that field of its first struct */

/* Advances the cursor over all scalars of t. With floats_only integers and bools are left out (they have no gradient,
 * so no key and no place). */
void shape_write(FILE *out, const Type *t, ShapeCursor *at, bool floats_only, ShapeLeaf *leaf, void *user);
void shape_write_texels(FILE *out, const Param *p, ShapeLeaf *leaf, void *user);

#endif
