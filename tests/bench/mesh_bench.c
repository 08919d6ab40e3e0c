/* Rays against meshes: our queries beside Embree 3 (robust scenes), interleaved in one process, one thread.
 * tests/bench/mesh.sh runs it.
 *
 *     bench-mesh [--mesh NAME,...] [--pixels N] [--rounds N] [--isa plain|avx2|avx512|all]
 *
 * A round runs every method once; medians of the rounds count. What is timed: of ours, the queries over blocks of rays
 * that lie ready, as a kernel has them; of Embree, the calls. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mesh_bench.h"
#include "runtime/geometry/mesh/trimesh.h"

enum { MAX_METHODS = 64, MAX_ROUNDS = 64, SETS = 4, WIDTHS = 3 };
static const uint32_t widths[WIDTHS] = {16, 32, 64};
static const char *const isa_names[TRIMESH_ISAS] = {"best", "plain", "avx2", "avx512"};

typedef struct Method {
    char name[40];
    bool embree, any, coherent, f64;
    EmbreeCall call;
    int isa, width;
    double seconds[MAX_ROUNDS], rate[SETS];
} Method;

typedef struct Bench {
    Surface surface;
    Rays set[SETS];
    SltGeometry *geometry[TRIMESH_ISAS][2]; /* [f64] */
    EmbreeScene *scene;
    void *block[WIDTHS][2]; /* of the set at hand */
    int32_t *witness;
    Method method[MAX_METHODS];
    int methods;
    uint32_t rounds;
} Bench;

static void ask(Bench *b, const Method *m, const Rays *r, int32_t *witness) {
    const SltGeometry *g = b->geometry[m->isa][m->f64];
    const uint32_t width = widths[m->width];
    SltQueryFn *query = g->query[m->any ? SLT_QUERY_OCCLUDED : SLT_QUERY_TRACE];
    const char *rays = b->block[m->width][m->f64];
    const uint64_t mask = width == 64 ? ~(uint64_t)0 : ((uint64_t)1 << width) - 1;
    const void *values = m->f64 ? (const void *)b->surface.precise : b->surface.vertex;
    for (uint32_t k = 0; k < r->count; k += width, rays += 8 * width * (m->f64 ? sizeof(double) : sizeof(float)))
        query(g, values, rays, mask, width, witness + k);
}

static void list_methods(Bench *b) {
    for (int any = 0; any < 2; any++) {
        for (int isa = 0; isa < TRIMESH_ISAS; isa++)
            for (int f64 = 0; f64 < 2; f64++)
                for (int w = 0; w < WIDTHS; w++) {
                    if (!b->geometry[isa][f64]) continue;
                    Method *m = &b->method[b->methods++];
                    *m = (Method){.any = any, .f64 = f64, .isa = isa, .width = w};
                    snprintf(m->name, sizeof m->name, "%s %s %s, %u", any ? "occluded" : "trace", f64 ? "f64" : "f32",
                             isa_names[isa], widths[w]);
                }
        for (int call = any ? EMBREE_OCC1 : EMBREE_INT1; b->scene && call < (any ? EMBREE_CALLS : EMBREE_OCC1); call++)
            for (int coherent = 0; coherent < 2; coherent++) {
                Method *m = &b->method[b->methods++];
                *m = (Method){.embree = true, .any = any, .call = (EmbreeCall)call, .coherent = coherent};
                snprintf(m->name, sizeof m->name, "Embree %s%s", embree_call_names[call], coherent ? " coherent" : "");
            }
    }
}

static void *widened(const float *narrow, uint32_t count) {
    double *wide = malloc(8 * sizeof *wide * count);
    for (size_t k = 0; k < 8 * (size_t)count; k++) wide[k] = (double)narrow[k];
    return wide;
}

static int upwards(const void *x, const void *y) {
    double a = *(const double *)x, b = *(const double *)y;
    return (a > b) - (a < b);
}

static void measure(Bench *b, int set) {
    const Rays *r = &b->set[set];
    for (int w = 0; w < WIDTHS; w++)
        b->block[w][0] = rays_blocks(r, widths[w]), b->block[w][1] = widened(b->block[w][0], r->count);
    if (b->scene) embree_prepare(b->scene, r);
    for (uint32_t round = 0; round < b->rounds; round++)
        for (int k = 0; k < b->methods; k++) {
            Method *m = &b->method[k];
            double start = bench_now();
            if (m->embree) embree_run(b->scene, m->call, m->coherent);
            else ask(b, m, r, b->witness);
            m->seconds[round] = bench_now() - start;
        }
    for (int k = 0; k < b->methods; k++) {
        Method *m = &b->method[k];
        qsort(m->seconds, b->rounds, sizeof *m->seconds, upwards);
        m->rate[set] = r->count / m->seconds[b->rounds / 2] * 1e-6;
    }
}

/* Do all methods of ours agree, and what does Embree's single ray say? Leaves the witnesses. */
static void compare(Bench *b, int set) {
    Rays *r = &b->set[set];
    int32_t *first = malloc(sizeof *first * r->count);
    uint32_t hits = 0, differ = 0, apart = 0;
    for (int f64 = 1; f64 >= 0; f64--) {
        const Method *reference = NULL;
        for (int k = 0; k < b->methods; k++) {
            const Method *m = &b->method[k];
            if (m->embree || m->f64 != f64) continue;
            ask(b, m, r, reference ? b->witness : first);
            if (!reference) reference = m;
            uint32_t unlike = 0;
            for (uint32_t i = 0; i < r->count && m != reference; i++)
                unlike += m->any ? (b->witness[i] < 0) != (first[i] < 0) : b->witness[i] != first[i];
            if (unlike) printf("  %s: %u answers are not those of %s\n", m->name, unlike, reference->name);
        }
    }
    if (b->scene) embree_run(b->scene, EMBREE_INT1, false);
    for (uint32_t i = 0; i < r->count; i++) {
        double ours = surface_distance(&b->surface, &r->ray[i], first[i]),
               theirs = b->scene ? (double)embree_result(b->scene, EMBREE_INT1, i) : ours;
        hits += first[i] >= 0;
        if (isfinite(theirs) != (first[i] >= 0)) differ++;
        else if (first[i] >= 0 && fabs(ours - theirs) > 1e-4 * fabs(ours) + 1e-5 * b->surface.radius) apart++;
    }
    r->hits = (double)hits / r->count;
    if (b->scene)
        printf("  %s: Embree's single rays hit or miss otherwise %u times, at another distance %u times, of %u\n",
               r->name, differ, apart, r->count);
    memcpy(b->witness, first, sizeof *first * r->count);
    for (int w = 0; w < WIDTHS; w++) free(b->block[w][0]), free(b->block[w][1]);
    free(first);
}

static double best(const Bench *b, int set, bool any, bool embree, bool f64, int isa) {
    double most = 0;
    for (int k = 0; k < b->methods; k++) {
        const Method *m = &b->method[k];
        if (m->any == any && m->embree == embree && (embree || (m->f64 == f64 && m->isa == isa)))
            most = fmax(most, m->rate[set]);
    }
    return most;
}

static void print_rates(const Bench *b) {
    printf("\n| Mrays/s, %s |", b->surface.name);
    for (int s = 0; s < SETS; s++) printf(" %s (%.0f %% hit) |", b->set[s].name, 100 * b->set[s].hits);
    printf("\n|---|---|---|---|---|\n");
    for (int k = 0; k < b->methods; k++) {
        printf("| %s |", b->method[k].name);
        for (int s = 0; s < SETS; s++) printf(" %.2f |", b->method[k].rate[s]);
        printf("\n");
    }
    for (int isa = 0; b->scene && isa < TRIMESH_ISAS; isa++)
        for (int f64 = 0; f64 < 2; f64++)
            for (int any = 0; any < 2; any++) {
                if (!b->geometry[isa][f64]) continue;
                printf("| **%s %s %s / best of Embree** |", any ? "occluded" : "trace", f64 ? "f64" : "f32",
                       isa_names[isa]);
                for (int s = 0; s < SETS; s++)
                    printf(" %.2f |", best(b, s, any, false, f64, isa) / best(b, s, any, true, f64, isa));
                printf("\n");
            }
}

static void make_geometries(Bench *b, const char *isa) {
    const Surface *s = &b->surface;
    printf("\n## %s: %u triangles\n\n", s->name, s->nfaces);
    for (int f64 = 0; f64 < 2; f64++) {
        const GeometrySource from = {.kind = SLT_GEOMETRY_MESH,
                                     .f64 = f64,
                                     .nvertices = s->nvertices,
                                     .nfaces = s->nfaces,
                                     .faces = (const int32_t *)s->face,
                                     .queries = 1u << SLT_QUERY_TRACE | 1u << SLT_QUERY_OCCLUDED};
        const void *values = f64 ? (const void *)s->precise : s->vertex;
        for (int k = 0; k < TRIMESH_ISAS; k++) {
            SltGeometry *g;
            SltError err;
            double start = bench_now();
            if (strcmp(isa, isa_names[k]) && (strcmp(isa, "all") || k == TRIMESH_ISA_BEST)) continue;
            if (trimesh_make(&g, &from, values, (TrimeshIsa)k, &err) != SLT_OK) continue;
            double made = bench_now() - start, refit = HUGE_VAL;
            for (uint32_t round = 0; round < b->rounds; round++) {
                geometry_changed(g, 0, 3);
                start = bench_now();
                geometry_follow(g, values);
                refit = fmin(refit, bench_now() - start);
            }
            b->geometry[k][f64] = g;
            printf("  %s: %s, %.1f bytes a triangle, made in %.1f ms, refitted in %.2f ms\n", f64 ? "f64" : "f32",
                   geometry_describe(g), (double)geometry_bytes(g) / s->nfaces, 1e3 * made, 1e3 * refit);
        }
    }
    double seconds;
    size_t bytes;
    b->scene = embree_scene_make(
        &(EmbreeSource){
            .vertex = s->vertex, .face = s->face, .nvertices = s->nvertices, .nfaces = s->nfaces, .robust = true},
        &seconds, &bytes);
    if (b->scene)
        printf("  Embree %s: %.1f bytes a triangle, made in %.1f ms\n", embree_config(), (double)bytes / s->nfaces,
               1e3 * seconds);
    else printf("  without Embree (libembree-dev was not there when this was built)\n");
}

static void bench(const char *name, uint32_t pixels, uint32_t rounds, const char *isa) {
    Bench *b = calloc(1, sizeof *b);
    b->rounds = rounds;
    if (!surface_make(&b->surface, name)) {
        printf("%s: skipped, SALTUS_DATA has no spot.obj\n", name);
        free(b);
        return;
    }
    make_geometries(b, isa);
    list_methods(b);
    if (!b->methods || b->method[0].embree) {
        fprintf(stderr, "this machine has no such instruction set\n");
        exit(2);
    }
    b->witness = malloc(sizeof *b->witness * pixels * pixels);
    b->set[0] = rays_primary(&b->surface, pixels);
    measure(b, 0);
    compare(b, 0);
    b->set[1] = rays_shadow(&b->surface, &b->set[0], b->witness);
    b->set[2] = rays_scattered(&b->surface, &b->set[0], b->witness);
    b->set[3] = rays_through(&b->surface, b->set[0].count);
    for (int s = 1; s < SETS; s++) {
        measure(b, s);
        compare(b, s);
    }
    print_rates(b);
    for (int s = 0; s < SETS; s++) rays_free(&b->set[s]);
    for (int k = 0; k < TRIMESH_ISAS; k++) geometry_free(b->geometry[k][0]), geometry_free(b->geometry[k][1]);
    embree_scene_free(b->scene);
    surface_free(&b->surface);
    free(b->witness), free(b);
}

int main(int argc, char **argv) {
    const char *meshes = "spot,spot4,spot16,sphere", *isa = "best";
    uint32_t pixels = 1024, rounds = 5;
    for (int k = 1; k + 1 < argc; k += 2)
        if (!strcmp(argv[k], "--mesh")) meshes = argv[k + 1];
        else if (!strcmp(argv[k], "--pixels")) pixels = (uint32_t)atoi(argv[k + 1]) / 8 * 8;
        else if (!strcmp(argv[k], "--rounds")) rounds = (uint32_t)atoi(argv[k + 1]);
        else if (!strcmp(argv[k], "--isa")) isa = argv[k + 1];
        else return fprintf(stderr, "unknown option %s\n", argv[k]), 2;
    if (rounds < 1 || rounds > MAX_ROUNDS || pixels < 8) return fprintf(stderr, "rounds: 1 to 64; pixels: from 8\n"), 2;
    for (char *list = strdup(meshes), *name = strtok(list, ","); name; name = strtok(NULL, ","))
        bench(name, pixels, rounds, isa);
    return 0;
}
