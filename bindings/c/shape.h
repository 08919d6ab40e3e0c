/* The shape of a parameter: as numbers in SltParam, and as JSON, where a struct is an object, a vector or an array a
 * list, a matrix the list of its rows, a texture rows of texels, top row first, one of three dimensions
 * slices of them. */
#ifndef SALTUS_BINDINGS_C_SHAPE_H
#define SALTUS_BINDINGS_C_SHAPE_H

#include "compiler/front/front.h"
#include "saltus/saltus.h"

/* Where the next scalar of a value lies: in the program's vector of floats, or of integers and bools. */
typedef struct ShapeCursor {
    uint32_t f, i;
} ShapeCursor;

/* Writes one scalar; index: its place in the vector of its kind. */
typedef void ShapeLeaf(void *user, FILE *out, TypeKind kind, uint32_t index);

/* Sets kind, rank, shape, strides and layout of `out`, whose place in the parameter q is set, for a value of type t.
 * within: of a texture, how many indices name the part. */
void shape_describe(const Param *q, const Type *t, uint32_t within, SltParam *out);
void shape_field(SltParam *q, uint32_t index); /* q becomes that field of its first struct */

/* Writes a value of type t, and moves the cursor over all its scalars. With floats_only integers and bools are left out
 * (a gradient has none). */
void shape_write(FILE *out, const Type *t, ShapeCursor *at, bool floats_only, ShapeLeaf *leaf, void *user);
void shape_write_texels(FILE *out, const Param *p, ShapeLeaf *leaf, void *user);

#endif
