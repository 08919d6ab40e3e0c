/* The table of queries. */
#include "compiler/ir/query.h"

const QueryRow query_rows[SLT_QUERIES] = {
#define QUERY(id, name, geometries, ray, witness, evaluation, weaker, when, role, asked)                               \
    {name,                 geometries,   RAY_##ray,  WITNESS_##witness, EVALUATE_##evaluation, SLT_QUERY_##weaker,     \
     WEAKER_##when, ROLE_##role, asked},
#include "saltus/queries.def"
#undef QUERY
};
