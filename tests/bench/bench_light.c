/* What an area light past a mesh costs: microseconds a receiver, with all derivatives, over a grid of points on the
 * floor under the mesh, three times as wide as it, and what rays from these points to the light cost, ours and
 * Embree's.
 *
 * bench-light FILE [WIDTH [SUBDIVISIONS]]: the light is WIDTH x 0.8 WIDTH of the mesh's width, above it. Processor time
 * of one thread, best of five. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/geometry/mesh/light.h"
#include "runtime/geometry/mesh/pieces.h"
#include "runtime/geometry/mesh/trimesh.h"
#include "runtime/mesh/mesh.h"
#include "saltus/mesh.h"
#include "tests/bench/rays.h"

enum { GRID = 64, RAYS = 64, REPEATS = 5 };

/* Every triangle becomes four; edges meet at new vertices, which are welded later. */
static bool subdivide(Mesh *m) {
    double *position = malloc(18ull * m->nfaces * 3 * sizeof *position);
    uint32_t *face = malloc(12ull * m->nfaces * sizeof *face), *part = calloc(4ull * m->nfaces, sizeof *part), n = 0;
    if (!position || !face || !part) return false;
    for (uint32_t f = 0; f < m->nfaces; f++) {
        static const int parts[4][3] = {{0, 3, 5}, {3, 1, 4}, {5, 4, 2}, {3, 4, 5}};
        for (int k = 0; k < 6; k++)
            for (int a = 0; a < 3; a++) {
                const double *p = m->position + 3 * m->face[3 * f + (uint32_t)(k % 3)],
                             *q = m->position + 3 * m->face[3 * f + (uint32_t)((k + (k > 2)) % 3)];
                position[3 * (6 * f + (uint32_t)k) + (uint32_t)a] = 0.5 * (p[a] + q[a]);
            }
        for (int i = 0; i < 12; i++) face[n++] = 6 * f + (uint32_t)parts[i / 3][i % 3];
    }
    free(m->position), free(m->face), free(m->part), free(m->face_normal), free(m->face_uv);
    m->face_normal = m->face_uv = NULL;
    m->position = position, m->face = face, m->part = part, m->nvertices = 6 * m->nfaces, m->nfaces *= 4;
    return true;
}

typedef struct Bench {
    Trimesh *mesh;
    double *values, low[3], high[3], wide;
} Bench;

static void set_row(const Bench *b, int i, double row[SLT_LIGHT_ROWS]) {
    const double size[2] = {b->wide * (b->high[0] - b->low[0]), 0.8 * b->wide * (b->high[0] - b->low[0])};
    for (int k = 0; k < SLT_LIGHT_ROWS; k++) row[k] = 0;
    for (int a = 0; a < 3; a += 2) {
        const double part = ((a ? i / GRID : i % GRID) + 0.5) / GRID;
        row[SLT_LIGHT_P + a] = b->low[a] + (3 * part - 1) * (b->high[a] - b->low[a]);
        row[SLT_LIGHT_CORNER + a] = 0.5 * (b->low[a] + b->high[a]) - 0.5 * size[a / 2];
    }
    row[SLT_LIGHT_P + 1] = b->low[1] - 1e-3 * (b->high[1] - b->low[1]), row[SLT_LIGHT_N + 1] = 1;
    row[SLT_LIGHT_CORNER + 1] = b->high[1] + 0.3 * (b->high[1] - b->low[1]);
    row[SLT_LIGHT_U] = size[0], row[SLT_LIGHT_V + 2] = size[1];
}

static void time_way(const Bench *b, LightWay way, const char *name) {
    const LightScene scene = {.tree = {.bvh = &b->mesh->bvh},
                              .adjacency = &b->mesh->adjacency,
                              .search = b->mesh->rays->by[1],
                              .beam = b->mesh->beam,
                              .cross = b->mesh->cross,
                              .cones = &b->mesh->cones,
                              .values = b->values,
                              .way = way};
    double best = HUGE_VAL, edges = 0, sum = 0;
    for (int r = 0; r < REPEATS; r++) {
        const double from = bench_now();
        edges = sum = 0;
        for (int i = 0; i < GRID * GRID; i++) {
            double row[SLT_LIGHT_ROWS];
            int32_t unit;
            set_row(b, i, row);
            pieces_begin();
            light_find(&scene, SLT_QUERY_IRRADIANCE, row, 1, 1, &unit);
            const double *told = (const double *)pieces_told() + (size_t)unit * SLT_TOLD;
            int32_t count;
            memcpy(&count, told + SLT_LIGHT_COUNT, sizeof count);
            sum += told[SLT_LIGHT_VALUE], edges += count;
        }
        best = fmin(best, bench_now() - from);
    }
    printf("%-23s %8.2f, %.1f edges, mean %.15g\n", name, 1e6 * best / (GRID * GRID), edges / (GRID * GRID),
           sum / (GRID * GRID));
}

/* Rays to places all over the light, 64 from each point. */
static bool make_rays(const Bench *b, Rays *r) {
    r->count = GRID * GRID * RAYS;
    r->ray = malloc(r->count * sizeof *r->ray);
    for (uint32_t i = 0; r->ray && i < r->count; i++) {
        double row[SLT_LIGHT_ROWS];
        Ray *ray = &r->ray[i];
        set_row(b, (int)(i / RAYS), row);
        for (int a = 0; a < 3; a++) {
            ray->o[a] = (float)row[SLT_LIGHT_P + a];
            ray->d[a] = (float)(row[SLT_LIGHT_CORNER + a] + (i % 8 + 0.5) / 8 * row[SLT_LIGHT_U + a] +
                                (i / 8 % 8 + 0.5) / 8 * row[SLT_LIGHT_V + a] - row[SLT_LIGHT_P + a]);
        }
        ray->t0 = 0, ray->t1 = 1;
    }
    return r->ray;
}

static void time_rays(const Bench *b, const Rays *r, EmbreeScene *embree) {
    const BvhScene scene = {.bvh = &b->mesh->bvh};
    float *blocks = rays_blocks(r, RAYS);
    double best[2] = {HUGE_VAL, HUGE_VAL};
    if (embree) embree_prepare(embree, r);
    for (int i = 0; blocks && i < REPEATS; i++) {
        double rays[8 * RAYS], from = bench_now();
        int32_t witness[RAYS];
        for (uint32_t k = 0; k < r->count; k += RAYS) {
            for (uint32_t a = 0; a < 8 * RAYS; a++) rays[a] = (double)blocks[8 * (size_t)k + a];
            b->mesh->rays->by[1](&scene, rays, ~0ull, RAYS, true, witness);
        }
        best[0] = fmin(best[0], bench_now() - from);
        if (!embree) continue;
        from = bench_now();
        embree_run(embree, EMBREE_OCC16, true);
        best[1] = fmin(best[1], bench_now() - from);
    }
    printf("a ray of ours (f64)     %8.4f\n", 1e6 * best[0] / r->count);
    if (embree) printf("a ray of Embree (occ16) %8.4f\n", 1e6 * best[1] / r->count);
    free(blocks);
}

int main(int argc, char **argv) {
    Mesh mesh;
    SltError err = {0};
    SltGeometry *g;
    Bench b = {.wide = argc > 2 ? atof(argv[2]) : 1,
               .low = {HUGE_VAL, HUGE_VAL, HUGE_VAL},
               .high = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL}};
    if (argc < 2 || mesh_read(argv[1], &mesh, &err) != SLT_OK) return fprintf(stderr, "%s\n", err.text), 2;
    for (int i = argc > 3 ? atoi(argv[3]) : 0; i > 0; i--)
        if (!subdivide(&mesh)) return 3;
    uint32_t *part = malloc(mesh.nvertices * sizeof *part);
    int32_t *face = malloc(3ull * mesh.nfaces * sizeof *face);
    if (!part || !face || !mesh_weld(&mesh, part)) return 3;
    for (uint32_t i = 0; i < 3 * mesh.nfaces; i++) face[i] = (int32_t)mesh.face[i];
    for (uint32_t i = 0; i < 3 * mesh.nvertices; i++) {
        b.low[i % 3] = fmin(b.low[i % 3], mesh.position[i]);
        b.high[i % 3] = fmax(b.high[i % 3], mesh.position[i]);
    }
    b.values = mesh.position;
    const GeometrySource from = {.kind = SLT_GEOMETRY_MESH,
                                 .f64 = true,
                                 .nvertices = mesh.nvertices,
                                 .nfaces = mesh.nfaces,
                                 .faces = face,
                                 .queries = 1u << SLT_QUERY_IRRADIANCE};
    if (geometry_make(&g, &from, mesh.position, &err) != SLT_OK) return fprintf(stderr, "%s\n", err.text), 3;
    b.mesh = (Trimesh *)g;
    printf("%u triangles; microseconds a point\n", mesh.nfaces);
    time_way(&b, LIGHT_SILHOUETTES, "by silhouettes");
    time_way(&b, LIGHT_PIECES, "by pieces");
    if (mesh.nfaces < 30000) time_way(&b, LIGHT_TRIANGLES, "by triangles");
    time_way(&b, LIGHT_BY_COUNTS, "by counts");
    Rays rays = {0};
    float *narrow = malloc(3ull * mesh.nvertices * sizeof *narrow);
    if (!narrow || !make_rays(&b, &rays)) return 3;
    for (uint32_t i = 0; i < 3 * mesh.nvertices; i++) narrow[i] = (float)mesh.position[i];
    double seconds;
    size_t bytes;
    EmbreeScene *embree = embree_scene_make(
        &(EmbreeSource){
            .vertex = narrow, .face = mesh.face, .nvertices = mesh.nvertices, .nfaces = mesh.nfaces, .robust = true},
        &seconds, &bytes);
    time_rays(&b, &rays, embree);
    if (embree) embree_scene_free(embree);
    rays_free(&rays), free(narrow);
    geometry_free(g);
    mesh_free(&mesh), free(part), free(face);
    return 0;
}
