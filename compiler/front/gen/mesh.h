/* What the files of meshes share: mesh.c (rays, visible pieces), mesh_light.c. */
#ifndef SALTUS_FRONT_GEN_MESH_H
#define SALTUS_FRONT_GEN_MESH_H

#include "compiler/front/gen/geometry.h"

/* SLT_QUERY_BEGIN, at the top: what is told of later stays as long as the samples in hand. An argument of each query
 * that tells, so that it comes before. */
Inst *gen_begun(Lower *l, uint32_t geometry, Span span);
Val gen_mesh_light(Lower *l, Expr *e, const Symbol *sym); /* irradiance, ltc, lit */

/* Where a Piece has what, among its parts. */
enum {
    PIECE_P = 4,
    PIECE_NORMAL = 7,
    PIECE_TRI = 10,
    PIECE_PART = 11,
    PIECE_UNIT = 12,
    PIECE_MESH = 13, /* 1 + the number of its geometry */
    PIECE_BEAM = 14
};
/* The unit of a piece; 0 where it is another mesh's. */
Inst *gen_piece_unit(Lower *l, uint32_t geometry, const Val *piece);

#endif
