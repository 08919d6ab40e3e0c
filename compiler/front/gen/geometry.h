/* What the geometries of the language share when their methods are written out, and what each has to give.
 *
 * A method that asks a query is a search and an evaluation. The search is one operation, `query`, whose result, the
 * witness, is an integer; the evaluation is ordinary arithmetic on the numbers of the geometry that the witness names,
 * differentiable in them and in the ray. At a minimum over the ray the witness is held fixed, which is the envelope
 * theorem. */
#ifndef SALTUS_FRONT_GEN_GEOMETRY_H
#define SALTUS_FRONT_GEN_GEOMETRY_H

#include "compiler/front/gen/internal.h"
#include "compiler/ir/query.h"

/* One for each row of saltus/geometries.def: any method but the fixed ones. */
typedef Val GeometryMethod(Lower *l, Expr *e, const Symbol *sym);
#define GEOMETRY(id, name, ...) GeometryMethod gen_##name;
#include "saltus/geometries.def"
#undef GEOMETRY

/* In the geometry's coordinates; of a slice, t0 and t1 are the slopes kmin and kmax. */
typedef struct Ray {
    Inst *x, *y, *z, *dx, *dy, *dz, *t0, *t1;
} Ray;

/* A parameter that is searched, with its band (GeometryInfo). */
typedef struct Searched {
    const Symbol *sym;
    double band;
} Searched;

/* The witness. */
Inst *gen_query(Lower *l, Searched of, SltQuery what, const Ray *r);
Inst *gen_found(Lower *l, Inst *witness); /* it names something */
static inline Inst *gen_is(Lower *l, Inst *i, int32_t what) { return op2(l, OP_ieq, i, ki(l, what)); }

SiteKind gen_site_kind(SltQuery what); /* under [Disc], by its role */

/* The result of a method: should only its sign be used, the weaker query will do. */
void gen_clearance_note(Lower *l, Clearance c);
/* `value`, the clearance or what it exceeds something by, as a boundary function: where the box ends, the way to the
 * border takes over. */
Inst *gen_clearance_bounded(Lower *l, Inst *value, const Clearance *c);

#endif
