/* Geometries at run time: the one seam between what kernels ask (saltus/query.h) and what answers.
 *
 * A geometry is made for numbers that live elsewhere, a slice of the parameters of a program, and follows them:
 * geometry_changed says which of the numbers become others, and geometry_follow brings the geometry's own structures up
 * to date before the next kernel runs. A geometry owns these structures and nothing else; the numbers are passed to
 * every query, and must be those of the last make or follow, or those that a moved copy was made for. Queries are
 * thread-safe; everything else is not.
 *
 *   runtime/sample, bindings/c  ->  geometry.h  ->  geometry_NAME, one GeometryOps for each row of
 *                                                   saltus/geometries.def, in runtime/geometry/NAME/ */
#ifndef SALTUS_GEOMETRY_H
#define SALTUS_GEOMETRY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "runtime/base/status.h"
#include "saltus/query.h"
#include "saltus/saltus.h"

/* What a geometry is made from, beside its numbers. */
typedef struct GeometrySource {
    SltGeometryKind kind;
    uint32_t size[2];           /* of its grid: columns, rows */
    uint32_t nvertices, nfaces; /* of a mesh */
    const int32_t *faces;       /* of a mesh: its topology (saltus/mesh.h), which outlives the geometry; else NULL */
    bool f64;                   /* precision of its numbers and of rays */
    uint32_t queries;           /* bit (1 << SltQuery): those that will be asked; nothing is built for others */
    float band;                 /* of SLT_QUERY_SHADOW, in the unit of the numbers */
    SltStructure structure;     /* what searches; never changes the answer */
} GeometrySource;

/* *out is the caller's, for geometry_free; NULL after an error. values: the numbers, float or double as from->f64 says.
 */
SltStatus geometry_make(SltGeometry **out, const GeometrySource *from, const void *values, SltError *err);
void geometry_free(SltGeometry *g); /* NULL: nothing */

/* Notes that `count` numbers of the slice from `first` on will be others at the next geometry_follow. */
void geometry_changed(SltGeometry *g, uint64_t first, uint64_t count);
/* values has the numbers that were noted as changed: updates the structures. Returns for how many numbers it looked; 0:
 * none had been noted. */
uint64_t geometry_follow(SltGeometry *g, const void *values);

/* A copy of g that answers for the numbers `to`, near the numbers `from` that g answers for, with g's structures: for
 * finite differences. The copy owns nothing and lives no longer than g. */
SltGeometry geometry_moved(const SltGeometry *g, const void *from, const void *to);

/* From now on what this thread's windows see of any geometry is kept, and whoever asks the same again need not wait;
 * off: forgotten. No numbers may change in between. */
void geometry_hold(const SltGeometry *g, bool on);

/* Have queries since the last call left out what there was no memory for? They cannot fail. */
bool geometry_lost(const SltGeometry *g);
/* Has a window since the last call had numbers that are not finite, or beyond 1e30? Nothing is seen through it. */
bool geometry_blind(const SltGeometry *g);
/* Of how many parts are the numbers not such that a query can meet them? */
uint64_t geometry_unmet(const SltGeometry *g);

size_t geometry_bytes(const SltGeometry *g);         /* of memory, without the numbers */
const char *geometry_describe(const SltGeometry *g); /* one line for people; lives as long as the geometry */

/* ---- for the implementation of a geometry, whose struct begins with a Geometry; its shared.made points at the struct.
 * The functions are those above for one kind. */
typedef struct GeometryOps {
    SltStatus (*make)(SltGeometry **out, const GeometrySource *from, const void *values, SltError *err);
    void (*free)(SltGeometry *g);
    void (*changed)(SltGeometry *g, uint64_t first, uint64_t count);
    uint64_t (*follow)(SltGeometry *g, const void *values);
    double (*growth)(const SltGeometry *g, const void *from,
                     const void *to);        /* what a copy for `to` adds to slack, >= 0 */
    bool (*lost)(const SltGeometry *g);      /* NULL: never */
    bool (*blind)(const SltGeometry *g);     /* NULL: never */
    uint64_t (*unmet)(const SltGeometry *g); /* NULL: none */
    void (*hold)(bool on);                   /* NULL: nothing is worth it */
    size_t (*bytes)(const SltGeometry *g);
    const char *(*describe)(const SltGeometry *g);
} GeometryOps;
typedef struct Geometry {
    SltGeometry shared; /* what kernels get a pointer to */
    const GeometryOps *ops;
} Geometry;
#define GEOMETRY(id, name, ...) extern const GeometryOps geometry_##name;
#include "saltus/geometries.def"
#undef GEOMETRY

#endif
