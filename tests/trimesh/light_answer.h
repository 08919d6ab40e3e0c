/* Asks a mesh for the light past it, for tests. Include behind cmocka. */
#ifndef SALTUS_TESTS_TRIMESH_LIGHT_ANSWER_H
#define SALTUS_TESTS_TRIMESH_LIGHT_ANSWER_H

#include "light_scene.h"
#include "runtime/geometry/mesh/light.h"
#include "runtime/geometry/mesh/pieces.h"
#include "runtime/geometry/mesh/trimesh.h"

/* What is told: the value, its derivatives in rows and in vertices. */
typedef struct Answer {
    double value, row[SLT_LOBE_ROWS], vertex[LIT_VERTICES][3];
} Answer;

/* isa: TRIMESH_ISA_BEST or one that the machine may lack; then NULL. */
static inline Trimesh *make_for(LitScene *s, bool f64, TrimeshIsa isa) {
    SltGeometry *g;
    SltError err;
    for (uint32_t i = 0; i < s->nvertices; i++)
        for (int a = 0; a < 3; a++) s->f32[i][a] = (float)s->at[i][a];
    const GeometrySource from = {.kind = SLT_GEOMETRY_MESH,
                                 .f64 = f64,
                                 .nvertices = s->nvertices,
                                 .nfaces = s->nfaces,
                                 .faces = &s->face[0][0],
                                 .queries = 1u << SLT_QUERY_IRRADIANCE};
    const SltStatus made = trimesh_make(&g, &from, f64 ? (const void *)s->at : s->f32, isa, &err);
    if (isa != TRIMESH_ISA_BEST && made == SLT_USAGE) return NULL;
    assert_int_equal(made, SLT_OK);
    return (Trimesh *)g;
}

static inline Trimesh *make(LitScene *s, bool f64) { return make_for(s, f64, TRIMESH_ISA_BEST); }

static inline double told(bool f64, int32_t unit, uint32_t which) {
    const size_t at = (size_t)unit * SLT_TOLD + which;
    return f64 ? ((const double *)pieces_told())[at] : (double)((const float *)pieces_told())[at];
}

static inline int32_t told_whole(bool f64, int32_t unit, uint32_t which) {
    int32_t n;
    memcpy(&n, (const char *)pieces_told() + ((size_t)unit * SLT_TOLD + which) * (f64 ? sizeof(double) : sizeof(float)),
           sizeof n);
    return n;
}

static inline double ask(const Trimesh *m, const LitScene *s, bool lobe, LightWay way, Answer *out) {
    const bool f64 = m->from.f64;
    const LightScene scene = {.tree = {.bvh = &m->bvh},
                              .adjacency = &m->adjacency,
                              .search = m->rays->by[f64],
                              .beam = m->beam,
                              .cross = m->cross,
                              .cones = &m->cones,
                              .values = f64 ? (const void *)s->at : s->f32,
                              .way = way};
    float narrow[SLT_LOBE_ROWS];
    int32_t unit;
    for (int k = 0; k < SLT_LOBE_ROWS; k++) narrow[k] = (float)s->row[k];
    pieces_begin();
    assert_true(light_find(&scene, lobe ? SLT_QUERY_LTC : SLT_QUERY_IRRADIANCE, f64 ? (const void *)s->row : narrow, 1,
                           1, &unit));
    const double value = told(f64, unit, SLT_LIGHT_VALUE);
    if (!out) return value;
    memset(out, 0, sizeof *out);
    out->value = value;
    for (uint32_t k = 0; k < SLT_LOBE_ROWS; k++) out->row[k] = unit ? told(f64, unit, SLT_LIGHT_SLOPES + k) : 0;
    const int32_t n = told_whole(f64, unit, SLT_LIGHT_COUNT);
    for (int32_t i = 0; i < n; i++)
        for (uint32_t k = 0; k < 2; k++) {
            const int32_t of = unit + SLT_LIGHT_EDGES + i, v = told_whole(f64, of, SLT_LIGHT_A + k);
            for (uint32_t a = 0; a < 3; a++)
                out->vertex[v][a] += told(f64, of, (k ? SLT_LIGHT_D_B : SLT_LIGHT_D_A) + a);
        }
    return value;
}

static inline void unit_length(double v[3]) {
    const double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (int a = 0; a < 3; a++) v[a] /= length;
}

static inline void put(LitScene *s, int at, double x, double y, double z) {
    s->row[at] = x, s->row[at + 1] = y, s->row[at + 2] = z;
}

/* A receiver near (x, y, 0) and a light of 1 x 0.8 at height 1 that shines down, all a little turned. */
static inline void place(LitScene *s, double x, double y) {
    put(s, SLT_LIGHT_P, x, y, -0.03);
    put(s, SLT_LIGHT_N, 0.1, -0.07, 1);
    put(s, SLT_LIGHT_CORNER, -0.52, -0.37, 1.03);
    put(s, SLT_LIGHT_U, 0.04, 0.81, 0.02);
    put(s, SLT_LIGHT_V, 1.02, 0.03, -0.06);
    put(s, SLT_LIGHT_VIEW, 0.6, 0.3, 0.9);
    s->row[SLT_LIGHT_ROUGHNESS] = 0.43;
    unit_length(s->row + SLT_LIGHT_N);
    unit_length(s->row + SLT_LIGHT_VIEW);
}

#endif
