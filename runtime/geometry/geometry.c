/* The seam: each function calls the GeometryOps of the geometry's kind. */
#include "runtime/geometry/geometry.h"

#include <assert.h>
#include <math.h>

static const GeometryOps *const kinds[SLT_GEOMETRIES] = {
#define GEOMETRY(id, name, ...) &geometry_##name,
#include "saltus/geometries.def"
#undef GEOMETRY
};

static const GeometryOps *ops(const SltGeometry *g) { return ((const Geometry *)g->made)->ops; }

SltStatus geometry_make(SltGeometry **out, const GeometrySource *from, const void *values, SltError *err) {
    SltStatus status = kinds[from->kind]->make(out, from, values, err);
    for (int q = 0; q < SLT_QUERIES && status == SLT_OK; q++) assert(!(from->queries >> q & 1) || (*out)->query[q]);
    return status;
}

void geometry_free(SltGeometry *g) {
    if (g) ops(g)->free(g);
}

void geometry_changed(SltGeometry *g, uint64_t first, uint64_t count) { ops(g)->changed(g, first, count); }

uint64_t geometry_follow(SltGeometry *g, const void *values) { return ops(g)->follow(g, values); }

SltGeometry geometry_moved(const SltGeometry *g, const void *from, const void *to) {
    SltGeometry moved = *g;
    double slack = (double)g->slack + ops(g)->growth(g, from, to);
    if (slack > (double)g->slack) moved.slack = nextafterf((float)slack, HUGE_VALF);
    return moved;
}

bool geometry_lost(const SltGeometry *g) { return ops(g)->lost && ops(g)->lost(g); }

bool geometry_blind(const SltGeometry *g) { return ops(g)->blind && ops(g)->blind(g); }

void geometry_hold(const SltGeometry *g, bool on) {
    if (ops(g)->hold) ops(g)->hold(on);
}

uint64_t geometry_unmet(const SltGeometry *g) { return ops(g)->unmet ? ops(g)->unmet(g) : 0; }

size_t geometry_bytes(const SltGeometry *g) { return ops(g)->bytes(g); }

const char *geometry_describe(const SltGeometry *g) { return ops(g)->describe(g); }
