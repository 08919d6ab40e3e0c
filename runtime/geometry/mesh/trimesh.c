/* Making, following and freeing meshes; what answers which query. */
#include "trimesh.h"

#include "boxes.h"
#include "light.h"
#include "lit.h"
#include "pieces.h"
#include "walk.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "saltus/mesh.h"

#include "runtime/base/cpu.h"

static TrimeshIsa best_isa(void) {
#if defined(__x86_64__)
    if (cpu_has_avx512()) return TRIMESH_ISA_AVX512;
    if (cpu_has_avx2()) return TRIMESH_ISA_AVX2;
#endif
    return TRIMESH_ISA_PLAIN;
}

/* What is compiled once for each instruction set. */
typedef struct Compiled {
    const BvhSearches *rays;
    const struct FacetSearch *facets;
    const BeamSearch *beam;
    const CrossSearch *cross;
} Compiled;

static Compiled compiled_for(TrimeshIsa isa) {
#if defined(__x86_64__)
    if (isa == TRIMESH_ISA_AVX512) return (Compiled){&bvh_avx512, &facets_avx512, &beam_avx512, &cross_avx512};
    if (isa == TRIMESH_ISA_AVX2) return (Compiled){&bvh_avx2, &facets_avx2, &beam_avx2, &cross_avx2};
#endif
    (void)isa;
    return (Compiled){&bvh_plain, &facets_plain, &beam_plain, &cross_plain};
}

/* ---- queries */

static const uint32_t receivers = 1u << SLT_QUERY_IRRADIANCE | 1u << SLT_QUERY_LTC;
static const uint32_t lighting = 1u << SLT_QUERY_IRRADIANCE | 1u << SLT_QUERY_LTC | 1u << SLT_QUERY_LIT;

static BvhScene scene_of(const SltGeometry *g, const void *values) {
    const Trimesh *m = g->made;
    bool moved = g != &m->base.shared; /* a copy for finite differences */
    return (BvhScene){.bvh = &m->bvh, .moved = moved ? values : NULL, .slack = moved ? (double)g->slack : 0};
}

static void ask(const SltGeometry *g, const void *values, const void *rays, uint64_t mask, uint32_t width, bool any,
                int32_t *witness) {
    const Trimesh *m = g->made;
    const BvhScene s = scene_of(g, values);
    m->rays->by[m->from.f64](&s, rays, mask, width, any, witness);
}

static void trace(const SltGeometry *g, const void *values, const void *rays, uint64_t mask, uint32_t width,
                  int32_t *witness) {
    ask(g, values, rays, mask, width, false, witness);
}

static void occluded(const SltGeometry *g, const void *values, const void *rays, uint64_t mask, uint32_t width,
                     int32_t *witness) {
    ask(g, values, rays, mask, width, true, witness);
}

static void begin(const SltGeometry *g, const void *values, const void *rays, uint64_t mask, uint32_t width,
                  int32_t *witness) {
    (void)g, (void)values, (void)rays, (void)mask;
    pieces_begin();
    for (uint32_t k = 0; k < width; k++) witness[k] = 0;
}

/* Do two lanes ask the same? rows: of a question; `first` is where questions differ. */
static bool same(const void *rays, bool f64, uint32_t width, uint32_t rows, uint32_t first, uint32_t a, uint32_t b) {
    for (size_t k = 0; k < rows; k++) {
        const size_t row = (k + first) % rows * width;
        uint64_t wide[2];
        uint32_t narrow[2];
        if (f64) {
            memcpy(&wide[0], (const double *)rays + row + a, sizeof wide[0]);
            memcpy(&wide[1], (const double *)rays + row + b, sizeof wide[1]);
            if (wide[0] != wide[1]) return false;
        } else {
            memcpy(&narrow[0], (const float *)rays + row + a, sizeof narrow[0]);
            memcpy(&narrow[1], (const float *)rays + row + b, sizeof narrow[1]);
            if (narrow[0] != narrow[1]) return false;
        }
    }
    return true;
}

/* Do all lanes ask, each with other numbers from row `first` on than the one before? Three are looked at. */
static bool all_apart(const void *rays, bool f64, uint64_t mask, uint32_t width, uint32_t first) {
    const float *x = (const float *)rays + (size_t)first * width, *y = x + width, *z = y + width;
    if (f64 || mask != ~0ull >> (64 - width)) return false;
    int alike = 0;
    for (uint32_t k = 1; k < width; k++) alike |= (x[k] == x[k - 1]) & (y[k] == y[k - 1]) & (z[k] == z[k - 1]);
    return !alike;
}

/* A call is padded with copies of a sample, and what is asked may be the same for all of them. Lanes of `mask` whose
 * question is not that of the lane before; like: where it is, the lane that asks it. */
static uint64_t asking(const void *rays, bool f64, uint64_t mask, uint32_t width, uint32_t rows, uint32_t first,
                       uint32_t like[64]) {
    uint64_t own = mask;
    uint32_t last = 0;
    if (all_apart(rays, f64, mask, width, first)) return own;
    for (uint32_t k = 0; k < width; k++) {
        if (!(mask >> k & 1)) continue;
        bool again = own >> last & 1 && last < k && same(rays, f64, width, rows, first, last, k);
        if (again) own &= ~((uint64_t)1 << k);
        else last = k;
        like[k] = last;
    }
    return own;
}

static void answer_alike(uint64_t lanes, const uint32_t like[64], int32_t *witness) {
    for (; lanes; lanes &= lanes - 1) witness[__builtin_ctzll(lanes)] = witness[like[__builtin_ctzll(lanes)]];
}

static void find(const SltGeometry *g, const void *values, const void *rays, uint64_t mask, uint32_t width, bool sides,
                 int32_t *witness) {
    const Trimesh *m = g->made;
    Held *held = pieces_held();
    sides |= held && m->has_adjacency; /* who asks again may want them */
    const PieceScene s = {.tree = scene_of(g, values),
                          .values = values,
                          .adjacency = sides ? &m->adjacency : NULL,
                          .outlined = m->from.queries >> SLT_QUERY_LIT & 1,
                          .facets = m->facets,
                          .blind = m->blind};
    uint32_t like[64];
    for (uint32_t k = 0; k < width; k++) witness[k] = 0;
    if (pieces_none(&s, rays, width)) return;
    uint64_t own = asking(rays, m->from.f64, mask, width, SLT_BEAM_ROWS, SLT_BEAM_CORNER, like), known = 0;
    if (held) known = held_find(held, g, rays, m->from.f64, own, width, witness);
    if (own != known) {
        if (!pieces_find(&s, rays, own & ~known, width, witness)) atomic_store(m->lost, true);
        else if (held) held_add(held, g, rays, m->from.f64, own & ~known, width, witness);
    }
    answer_alike(mask & ~own, like, witness);
}

static WalkMesh walk_mesh(const Trimesh *m, const void *values) {
    return (WalkMesh){.adjacency = m->has_adjacency ? &m->adjacency : NULL,
                      .face = m->from.faces,
                      .vertex = values,
                      .f64 = m->from.f64};
}

static void between(const SltGeometry *g, const void *values, const void *rays, uint64_t mask, uint32_t width,
                    int32_t *witness) {
    const Trimesh *m = g->made;
    const WalkMesh w = walk_mesh(m, values);
    walk_between(&w, rays, mask, width, witness);
}

static void pieces(const SltGeometry *g, const void *values, const void *rays, uint64_t mask, uint32_t width,
                   int32_t *witness) {
    find(g, values, rays, mask, width, true, witness);
}

static void seen(const SltGeometry *g, const void *values, const void *rays, uint64_t mask, uint32_t width,
                 int32_t *witness) {
    find(g, values, rays, mask, width, false, witness);
}

static LightScene light_scene(const SltGeometry *g, const void *values) {
    const Trimesh *m = g->made;
    return (LightScene){.tree = scene_of(g, values),
                        .adjacency = &m->adjacency,
                        .search = m->rays->by[m->from.f64],
                        .beam = m->beam,
                        .cross = m->cross,
                        .cones = &m->cones,
                        .values = values,
                        .both = (m->from.queries & receivers) == receivers};
}

static void light(const SltGeometry *g, SltQuery what, const void *values, const void *rays, uint64_t mask,
                  uint32_t width, int32_t *witness) {
    const Trimesh *m = g->made;
    const LightScene s = light_scene(g, values);
    uint32_t like[64];
    const uint32_t rows = what == SLT_QUERY_LTC ? SLT_LOBE_ROWS : SLT_LIGHT_ROWS;
    const uint64_t own = asking(rays, m->from.f64, mask, width, rows, SLT_LIGHT_P, like);
    if (!light_find(&s, what, rays, own, width, witness)) atomic_store(m->lost, true);
    answer_alike(mask & ~own, like, witness);
}

static void irradiance(const SltGeometry *g, const void *values, const void *rays, uint64_t mask, uint32_t width,
                       int32_t *witness) {
    light(g, SLT_QUERY_IRRADIANCE, values, rays, mask, width, witness);
}

static void ltc(const SltGeometry *g, const void *values, const void *rays, uint64_t mask, uint32_t width,
                int32_t *witness) {
    light(g, SLT_QUERY_LTC, values, rays, mask, width, witness);
}

static void lit(const SltGeometry *g, const void *values, const void *rays, uint64_t mask, uint32_t width,
                int32_t *witness) {
    const Trimesh *m = g->made;
    const LightScene s = light_scene(g, values);
    if (!lit_find(&s, rays, mask, width, witness)) atomic_store(m->lost, true);
}

static void blocked(const SltGeometry *g, const void *values, const void *rays, uint64_t mask, uint32_t width,
                    int32_t *witness) {
    const Trimesh *m = g->made;
    const BvhScene s = scene_of(g, values);
    const WalkMesh w = walk_mesh(m, values);
    boxes_decide(&s, &w, m->rays->by[m->from.f64], rays, mask, width, witness);
}

static void line(const SltGeometry *g, const void *values, const void *rays, uint64_t mask, uint32_t width,
                 int32_t *witness) {
    const Trimesh *m = g->made;
    const BvhScene s = scene_of(g, values);
    const WalkMesh w = walk_mesh(m, values);
    boxes_line(&s, &w, m->rays->by[m->from.f64], rays, mask, width, witness);
}

/* ---- the seam */

static const uint32_t searching = 1u << SLT_QUERY_TRACE | 1u << SLT_QUERY_OCCLUDED | 1u << SLT_QUERY_PIECES |
                                  1u << SLT_QUERY_SEEN | 1u << SLT_QUERY_BLOCKED | 1u << SLT_QUERY_LINE | lighting;

static void release(SltGeometry *g) {
    Trimesh *m = (Trimesh *)g;
    if (!m) return;
    if (m->has_tree) bvh_free(&m->bvh);
    if (m->has_adjacency) adjacency_free(&m->adjacency);
    cones_free(&m->cones);
    free(m);
}

static void describe(Trimesh *m) {
    if (m->has_tree)
        snprintf(m->text, sizeof m->text, "tree of boxes, %u nodes of 8, %u leaves, %s%s", m->bvh.nnodes,
                 m->bvh.nleaves, m->rays->name, m->has_adjacency ? "; neighbours of faces" : "");
    else snprintf(m->text, sizeof m->text, "no tree");
}

SltStatus trimesh_make(SltGeometry **out, const GeometrySource *from, const void *values, TrimeshIsa isa,
                       SltError *err) {
    *out = NULL;
    if (isa < 0 || isa >= TRIMESH_ISAS || isa > best_isa())
        return status_fail(err, SLT_USAGE, "this machine has no such instruction set");
    Trimesh *m = calloc(1, sizeof *m);
    if (!m) return status_fail(err, SLT_LIMIT, "out of memory for a mesh");
    m->from = *from;
    const Compiled c = compiled_for(isa ? isa : best_isa());
    m->rays = c.rays, m->facets = c.facets, m->beam = c.beam, m->cross = c.cross;
    m->lost = &m->lost_, m->blind = &m->blind_;
    m->base.shared.made = m;
    m->base.ops = &geometry_mesh;
    m->has_tree = from->queries & searching;
    if (m->has_tree && !bvh_make(&m->bvh, values, from->f64, from->faces, from->nfaces)) {
        m->has_tree = false;
        release(&m->base.shared);
        return status_fail(err, SLT_LIMIT, "out of memory for the tree of a mesh of %u triangles", from->nfaces);
    }
    m->has_adjacency =
        from->queries & (1u << SLT_QUERY_PIECES | 1u << SLT_QUERY_BETWEEN | 1u << SLT_QUERY_LINE | lighting);
    if (m->has_adjacency && !adjacency_make(&m->adjacency, from->faces, from->nfaces, from->nvertices)) {
        m->has_adjacency = false;
        release(&m->base.shared);
        return status_fail(err, SLT_LIMIT, "out of memory for the edges of a mesh of %u triangles", from->nfaces);
    }
    if (from->queries & receivers) cones_follow(&m->cones, &m->bvh, &m->adjacency, values);
    describe(m);
    if (m->has_adjacency) m->base.shared.query[SLT_QUERY_BETWEEN] = between;
    if (m->has_tree) {
        m->base.shared.query[SLT_QUERY_TRACE] = trace;
        m->base.shared.query[SLT_QUERY_OCCLUDED] = occluded;
        m->base.shared.query[SLT_QUERY_BLOCKED] = blocked;
        m->base.shared.query[SLT_QUERY_LINE] = m->has_adjacency ? line : NULL;
        m->base.shared.query[SLT_QUERY_PIECES] = m->has_adjacency ? pieces : NULL;
        m->base.shared.query[SLT_QUERY_SEEN] = seen;
        m->base.shared.query[SLT_QUERY_IRRADIANCE] = m->has_adjacency ? irradiance : NULL;
        m->base.shared.query[SLT_QUERY_LTC] = m->has_adjacency ? ltc : NULL;
        m->base.shared.query[SLT_QUERY_LIT] = m->has_adjacency ? lit : NULL;
    }
    m->base.shared.query[SLT_QUERY_BEGIN] = begin;
    m->base.shared.told = pieces_told;
    *out = &m->base.shared;
    return SLT_OK;
}

static SltStatus make(SltGeometry **out, const GeometrySource *from, const void *values, SltError *err) {
    return trimesh_make(out, from, values, TRIMESH_ISA_BEST, err);
}

static void changed(SltGeometry *g, uint64_t first, uint64_t count) {
    (void)first;
    if (count) ((Trimesh *)g)->dirty = true;
}

static uint64_t follow(SltGeometry *g, const void *values) {
    Trimesh *m = (Trimesh *)g;
    if (!m->dirty) return 0;
    m->dirty = false;
    if (m->has_tree) bvh_follow(&m->bvh, values); /* without memory for a new tree the old one serves, slower */
    if (m->from.queries & receivers) cones_follow(&m->cones, &m->bvh, &m->adjacency, values);
    describe(m);
    return 3 * (uint64_t)m->from.nvertices;
}

/* The longest way along an axis that a vertex goes. */
static double growth(const SltGeometry *g, const void *from, const void *to) {
    const Trimesh *m = g->made;
    double most = 0;
    for (size_t i = 0; i < 3 * (size_t)m->from.nvertices; i++)
        most = fmax(most, fabs(m->from.f64 ? ((const double *)to)[i] - ((const double *)from)[i]
                                           : (double)((const float *)to)[i] - (double)((const float *)from)[i]));
    return most;
}

static size_t held(const SltGeometry *g) {
    const Trimesh *m = g->made;
    return (m->has_tree ? bvh_bytes(&m->bvh) : 0) + (m->has_adjacency ? adjacency_bytes(&m->adjacency) : 0) +
           m->cones.n * sizeof *m->cones.node;
}

static bool lost(const SltGeometry *g) { return atomic_exchange(((const Trimesh *)g->made)->lost, false); }

static bool blind(const SltGeometry *g) { return atomic_exchange(((const Trimesh *)g->made)->blind, false); }

static uint64_t unmet(const SltGeometry *g) {
    const Trimesh *m = g->made;
    return m->has_tree ? m->bvh.unmet : 0;
}

static const char *text(const SltGeometry *g) { return ((const Trimesh *)g->made)->text; }

const GeometryOps geometry_mesh = {.make = make,
                                   .free = release,
                                   .changed = changed,
                                   .follow = follow,
                                   .growth = growth,
                                   .lost = lost,
                                   .blind = blind,
                                   .hold = pieces_hold,
                                   .unmet = unmet,
                                   .bytes = held,
                                   .describe = text};
