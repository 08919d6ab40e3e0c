/* What the geometries of the language share when their methods are written out, and what each has to give.
 *
 * A method that asks a query is a search and an evaluation. The search is one operation, `query`, whose result, the
 * witness, is an integer; the evaluation is ordinary arithmetic on the numbers of the geometry that the witness names,
 * differentiable in them and in the ray. The derivative of a minimum over the ray holds the witness fixed, by the
 * envelope theorem. */
#ifndef SALTUS_FRONT_GEN_GEOMETRY_H
#define SALTUS_FRONT_GEN_GEOMETRY_H

#include "compiler/front/gen/internal.h"
#include "compiler/ir/query.h"

/* Each row of saltus/geometries.def has one, which generates all its methods but the FIXED ones. */
typedef Val GeometryMethod(Lower *l, Expr *e, const Symbol *sym);
#define GEOMETRY(id, name, ...) GeometryMethod gen_##name;
#include "saltus/geometries.def"
#undef GEOMETRY

/* A ray in the geometry's coordinates; of a slice (queries.def), t0 and t1 are the slopes kmin and kmax. lift and
 * lift_of: of SltRayRow; NULL: not known. */
typedef struct Ray {
    Inst *x, *y, *z, *dx, *dy, *dz, *t0, *t1, *lift, *lift_of;
} Ray;

/* A parameter that is searched, with its band (GeometryInfo). */
typedef struct Searched {
    const Symbol *sym;
    double band;
} Searched;

/* The number of the geometry in Program.geometries, a new one where nothing has searched it yet. */
uint32_t gen_geometry_number(Lower *l, Searched of);
/* Returns the witness. */
Inst *gen_query(Lower *l, Searched of, SltQuery what, const Ray *r);
Inst *gen_found(Lower *l, Inst *witness); /* the witness is not SLT_WITNESS_NONE */
static inline Inst *gen_is(Lower *l, Inst *i, int32_t what) { return op2(l, OP_ieq, i, ki(l, what)); }

SiteKind gen_site_kind(SltQuery what); /* what [Disc] makes of a query, by its role */

/* The result of a method: should only its sign be used, the weaker query will do. */
void gen_clearance_note(Lower *l, Clearance c);
/* `value`, the clearance or what it exceeds something by, as a boundary function: where the box ends, the way to the
 * border takes over. */
Inst *gen_clearance_bounded(Lower *l, Inst *value, const Clearance *c);

#endif
