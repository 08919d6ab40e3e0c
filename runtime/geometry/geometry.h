/* Geometries at run time: the one seam between what kernels ask (saltus/query.h) and what answers.
 *
 * A geometry is made for numbers that live elsewhere, a slice of the parameters of a program, and follows them: it is
 * told which of them become others, and brings what it keeps beside them up to date before the next kernel runs. It
 * owns what it keeps and nothing else; the numbers are passed to every query, and must be those of the last make or
 * follow, or those that a moved copy was made for. Queries are thread-safe; everything else is not.
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
    uint32_t size[2];       /* of its grid */
    bool f64;               /* precision of its numbers and of rays */
    uint32_t queries;       /* bit (1 << SltQuery): those that will be asked; nothing is built for others */
    float band;             /* SLT_QUERY_SHADOW, in the unit of its numbers */
    SltStructure structure; /* what answers; never changes the answer */
} GeometrySource;

/* The geometry is the caller's: geometry_free. */
SltStatus geometry_make(SltGeometry **out, const GeometrySource *from, const void *values, SltError *err);
void geometry_free(SltGeometry *g); /* NULL: nothing */

/* The numbers `first` and on of its slice become others; */
void geometry_changed(SltGeometry *g, uint64_t first, uint64_t count);
/* they have: what is kept beside them follows. Returns how many numbers it was looked at for; 0: nothing had changed.
 */
uint64_t geometry_follow(SltGeometry *g, const void *values);

/* A copy that answers for the numbers `to`, near those that `g` answers for (`from`), without making anything: finite
 * differences. It lives no longer than `g`, and owns nothing. */
SltGeometry geometry_moved(const SltGeometry *g, const void *from, const void *to);

size_t geometry_bytes(const SltGeometry *g);         /* held, without the numbers */
const char *geometry_describe(const SltGeometry *g); /* one line for people; lives as long as the geometry */

/* ---- for those who implement one: it begins with a Geometry, whose `shared.made` points to itself */
typedef struct GeometryOps {
    SltStatus (*make)(SltGeometry **out, const GeometrySource *from, const void *values, SltError *err);
    void (*free)(SltGeometry *g);
    void (*changed)(SltGeometry *g, uint64_t first, uint64_t count);
    uint64_t (*follow)(SltGeometry *g, const void *values);
    double (*growth)(const SltGeometry *g, const void *from, const void *to); /* by how much slack must rise; >= 0 */
    size_t (*bytes)(const SltGeometry *g);
    const char *(*describe)(const SltGeometry *g);
} GeometryOps;
typedef struct Geometry {
    SltGeometry shared; /* the kernels' pointer is this one */
    const GeometryOps *ops;
} Geometry;
#define GEOMETRY(id, name, ...) extern const GeometryOps geometry_##name;
#include "saltus/geometries.def"
#undef GEOMETRY

#endif
