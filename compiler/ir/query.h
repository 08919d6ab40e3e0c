/* The rows of saltus/queries.def, which explains the columns, as the compiler reads them: nothing else here tells one
 * query from another. */
#ifndef SALTUS_IR_QUERY_H
#define SALTUS_IR_QUERY_H

#include "saltus/query.h"

typedef enum QueryRay {
    RAY_SEGMENT,
    RAY_SLICE,
    RAY_BOX,
    RAY_LINE,
    RAY_BEAM,
    RAY_PAIR,
    RAY_LIGHT,
    RAY_LOBE,
    RAY_PIECE,
    RAY_NOTHING
} QueryRay;
typedef enum QueryWitness { WITNESS_FACE, WITNESS_EDGE, WITNESS_FOUND, WITNESS_RAYS, WITNESS_UNIT } QueryWitness;
typedef enum QueryEvaluation { EVALUATE_NOTHING, EVALUATE_HIT, EVALUATE_NEAREST, EVALUATE_PEAK } QueryEvaluation;
typedef enum QueryWhen { WEAKER_NEVER, WEAKER_FOUND, WEAKER_SIGN, WEAKER_SIDES } QueryWhen;
typedef enum QueryRole { ROLE_PLAIN, ROLE_SILHOUETTE, ROLE_SHADOW, ROLE_TOP, ROLE_LINE } QueryRole;

typedef struct QueryRow {
    const char *name;
    uint32_t geometries; /* that answer it: bits (1 << SltGeometryKind) */
    QueryRay ray;
    QueryWitness witness;
    QueryEvaluation evaluation;
    SltQuery weaker;
    QueryWhen when; /* `weaker` serves as well */
    QueryRole role;
    const char *asked; /* by what in the language */
} QueryRow;
extern const QueryRow query_rows[SLT_QUERIES];

#endif
