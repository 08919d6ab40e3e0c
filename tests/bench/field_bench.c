/* Heightfields: our queries beside Embree 3, interleaved in one process, one thread. tests/bench/field.sh runs it.
 *
 *     bench-field [options]                 rays a second, builds, bytes, clearance
 *     bench-field --exact COUNT [options]   COUNT rays a terrain: every structure and width against naive stepping
 *     bench-field --silhouettes [options]   nodes and cells of a silhouette search against stepping
 *
 *     --terrain dem|fbm   --size N   --rounds N   --pixels N   --json FILE
 *     --structures LIST (naive, mipmap, cone and its variants)
 *
 * A round runs every method once; the best of the rounds counts. What is timed: of ours, the queries over blocks of
 * rays that lie ready, as a kernel has them; of Embree, the calls. `trace+t` also computes the distance from the
 * witness, as a kernel does. */
#include <malloc.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "field_bench.h"
#include "runtime/geometry/heightfield/field.h"

enum { MAX_METHODS = 160, SETS = 3, MAX_STRUCTURES = 8 };
static const uint32_t widths[] = {16, 32, 64};
enum { WIDTHS = 3 };

typedef struct Options {
    const char *terrain, *json, *structures;
    uint32_t size, rounds, pixels;
    uint64_t exact;
    bool silhouettes;
} Options;

typedef enum Kind { OURS, OURS_T, EMBREE } Kind;
typedef enum Group { CLOSEST, ANY, CLEAR } Group;
typedef struct Method {
    char name[48];
    Kind kind;
    Group group;
    int structure, what, width; /* ours: index of the structure, the query, index of the width */
    bool window;                /* ours: rays of the interval [1.5, far] instead of [0, far] */
    int scene, call;            /* Embree */
    bool coherent;
    uint32_t every; /* slow ones do not run in every round */
    double best, rate[SETS];
} Method;

typedef struct Bench {
    const Options *o;
    Terrain *t;
    Rays set[SETS];
    float *blocks[WIDTHS], *window[WIDTHS]; /* of the set at hand */
    int32_t *ids;
    float *distance;
    int structures;
    const char *structure_name[MAX_STRUCTURES];
    SltGeometry *field[MAX_STRUCTURES];
    double build[MAX_STRUCTURES];
    double bytes[MAX_STRUCTURES]; /* a texel, without the heights */
    EmbreeScene *scene[2];
    double embree_build[2], embree_bytes[2];
    Method method[MAX_METHODS];
    int methods;
} Bench;

static size_t heap_bytes(void) {
    struct mallinfo2 m = mallinfo2();
    return m.uordblks + m.hblkhd;
}

/* ---- one method over one set */

static void run_ours(Bench *b, const Method *m, const Rays *r) {
    uint32_t width = widths[m->width];
    const SltGeometry *f = b->field[m->structure];
    const float *rays = m->window ? b->window[m->width] : b->blocks[m->width];
    SltQueryFn *query = f->query[m->what];
    uint64_t mask = width == 64 ? ~(uint64_t)0 : ((uint64_t)1 << width) - 1;
    for (uint32_t k = 0; k < r->count; k += width, rays += 8 * width) {
        query(f, b->t->h, rays, mask, width, b->ids + k);
        if (m->kind != OURS_T) continue;
        /* What a kernel computes from a triangle: three heights, its plane, the distance. The other answers are rare; a
         * kernel selects, here they are left as they fall. */
        uint32_t n = b->t->n;
        const float *h = b->t->h;
        for (uint32_t i = 0; i < width; i++) {
            int32_t id = b->ids[k + i] < 0 ? 0 : b->ids[k + i], cell = id >> 1, up = id & 1;
            int32_t x = cell % (int32_t)n, y = cell / (int32_t)n, base = ((int32_t)n - 1 - y) * (int32_t)n + x;
            float h10 = h[base + 1], h01 = h[base - (int32_t)n], corner = h[up ? base - (int32_t)n + 1 : base];
            float gx = up ? corner - h01 : h10 - corner, gy = up ? corner - h10 : h01 - corner;
            float px = (float)(x + up), py = (float)(y + up);
            const float *q = rays + i;
            float above = q[2 * width] - corner - gx * (q[0] - px) - gy * (q[width] - py),
                  slope = q[5 * width] - gx * q[3 * width] - gy * q[4 * width];
            b->distance[k + i] = -above / slope;
        }
    }
}

static int add(Bench *b, Method m) {
    if (b->methods == MAX_METHODS) abort();
    m.best = INFINITY;
    if (!m.every) m.every = 1;
    b->method[b->methods] = m;
    return b->methods++;
}

static void list_methods(Bench *b) {
    Method m;
    for (int s = 0; s < b->structures; s++)
        for (int w = 0; w < WIDTHS; w++) {
            static const struct {
                const char *name;
                int what;
                Group group;
                Kind kind;
                bool window;
                uint32_t every;
            } list[] = {
                {"trace", SLT_QUERY_TRACE, CLOSEST, OURS, false, 1},
                {"trace+t", SLT_QUERY_TRACE, CLOSEST, OURS_T, false, 1},
                {"occluded", SLT_QUERY_OCCLUDED, ANY, OURS, false, 1},
                {"occluded from 1.5", SLT_QUERY_OCCLUDED, CLEAR, OURS, true, 1},
                {"shadow from 1.5", SLT_QUERY_SHADOW, CLEAR, OURS, true, 1},
                {"clearance from 1.5", SLT_QUERY_CLEARANCE, CLEAR, OURS, true, 4},
            };
            for (size_t k = 0; k < sizeof list / sizeof *list; k++) {
                bool naive = !strcmp(b->structure_name[s], "naive");
                if ((list[k].group == CLEAR && strcmp(b->structure_name[s], "mipmap")) ||
                    !b->field[s]->query[list[k].what])
                    continue;
                if (naive && (w != 0 || list[k].kind == OURS_T)) continue;
                m = (Method){.kind = list[k].kind,
                             .group = list[k].group,
                             .structure = s,
                             .what = list[k].what,
                             .width = w,
                             .window = list[k].window,
                             .every = naive ? 1000 : list[k].every};
                snprintf(m.name, sizeof m.name, "%s %s %u", b->structure_name[s], list[k].name, widths[w]);
                add(b, m);
            }
        }
    for (int g = 0; g < 2 && b->scene[g]; g++)
        for (int c = 0; c < EMBREE_CALLS; c++)
            for (int coherent = 0; coherent < 2; coherent++) {
                if (coherent && (c == EMBREE_INT1 || c == EMBREE_OCC1)) continue; /* the flag is for packets */
                m = (Method){.kind = EMBREE,
                             .group = c < EMBREE_OCC1 ? CLOSEST : ANY,
                             .scene = g,
                             .call = c,
                             .coherent = coherent};
                snprintf(m.name, sizeof m.name, "embree %s %s%s", g ? "grid" : "mesh", embree_call_names[c],
                         coherent ? " coherent" : "");
                add(b, m);
            }
}

static const Method *best_of(const Bench *b, int set, Group group, bool embree, const char *structure,
                             const char *query) {
    const Method *best = NULL;
    for (int k = 0; k < b->methods; k++) {
        const Method *m = &b->method[k];
        if (m->group != group || (m->kind == EMBREE) != embree || m->rate[set] == 0.0) continue;
        if (structure && strcmp(b->structure_name[m->structure], structure)) continue;
        if (query) {
            char name[48];
            snprintf(name, sizeof name, "%s %s %u", b->structure_name[m->structure], query, widths[m->width]);
            if (strcmp(name, m->name)) continue;
        }
        if (!best || m->rate[set] > best->rate[set]) best = m;
    }
    return best;
}

static void measure(Bench *b, int set) {
    const Rays *r = &b->set[set];
    for (int w = 0; w < WIDTHS; w++) {
        b->blocks[w] = rays_blocks(r, widths[w]);
        b->window[w] = rays_blocks(r, widths[w]);
        for (uint32_t k = 0; k < r->count; k++)
            b->window[w][(size_t)(k / widths[w]) * 8 * widths[w] + 6 * widths[w] + k % widths[w]] = 1.5f;
    }
    for (int g = 0; g < 2 && b->scene[g]; g++) embree_prepare(b->scene[g], r);
    for (int k = 0; k < b->methods; k++) b->method[k].best = INFINITY;
    for (uint32_t round = 0; round < b->o->rounds; round++)
        for (int k = 0; k < b->methods; k++) {
            Method *m = &b->method[k];
            if (round % m->every || (set == 0 && m->group == CLEAR)) continue;
            double start = bench_now();
            if (m->kind == EMBREE) embree_run(b->scene[m->scene], m->call, m->coherent);
            else run_ours(b, m, r);
            m->best = fmin(m->best, bench_now() - start);
        }
    for (int k = 0; k < b->methods; k++)
        b->method[k].rate[set] = isfinite(b->method[k].best) ? r->count / b->method[k].best * 1e-6 : 0.0;
    for (int w = 0; w < WIDTHS; w++) free(b->blocks[w]), free(b->window[w]);
}

/* ---- the check that the methods answer the same question: hits of every method on the set, distances against Embree's
 * single rays */
static void compare(Bench *b, int set) {
    const Rays *r = &b->set[set];
    int32_t *first = malloc(sizeof *first * r->count);
    for (int w = 0; w < WIDTHS; w++) b->blocks[w] = rays_blocks(r, widths[w]);
    bool have = false;
    for (int k = 0; k < b->methods; k++) {
        const Method *m = &b->method[k];
        if (m->kind != OURS || m->window) continue;
        run_ours(b, m, r);
        uint32_t differ = 0;
        if (!have) memcpy(first, b->ids, sizeof *first * r->count);
        else
            for (uint32_t i = 0; i < r->count; i++)
                differ += m->what == SLT_QUERY_TRACE
                              ? b->ids[i] != first[i]
                              : (b->ids[i] == SLT_WITNESS_NONE) != (first[i] == SLT_WITNESS_NONE);
        if (differ) printf("  %s: %u of %u answers differ from %s\n", m->name, differ, r->count, b->method[0].name);
        have = true;
    }
    for (int g = 0; g < 2 && b->scene[g]; g++) {
        embree_prepare(b->scene[g], r);
        embree_run(b->scene[g], EMBREE_INT1, false);
        uint32_t hits = 0, differ = 0, apart = 0;
        for (uint32_t i = 0; i < r->count; i++) {
            double ours = terrain_distance(b->t, &r->ray[i], first[i]),
                   theirs = embree_result(b->scene[g], EMBREE_INT1, i);
            hits += isfinite(ours);
            if (isfinite(ours) != isfinite(theirs)) differ++;
            else if (isfinite(ours) && fabs(ours - theirs) > 2e-3 + 2e-5 * ours) apart++;
        }
        b->set[set].hits = (double)hits / r->count;
        printf("  %s: against Embree's %s %u hit or miss otherwise, %u at another distance, of %u (%u cut)\n", r->name,
               g ? "grid" : "mesh", differ, apart, r->count, r->cut);
    }
    for (int w = 0; w < WIDTHS; w++) free(b->blocks[w]);
    free(first);
}

/* ---- tables */

static void print_tables(const Bench *b) {
    printf("\n| Mrays/s, one thread, %s %u |", b->t->name, b->t->n);
    for (int s = 0; s < SETS; s++) printf(" %s (%.0f %% hit) |", b->set[s].name, 100.0 * b->set[s].hits);
    printf("\n|---|---|---|---|\n");
    for (int k = 0; k < b->methods; k++) {
        printf("| %s |", b->method[k].name);
        for (int s = 0; s < SETS; s++)
            if (b->method[k].rate[s] > 0.0) printf(" %.2f |", b->method[k].rate[s]);
            else printf(" |");
        printf("\n");
    }
    printf("\n| ratio |");
    for (int s = 0; s < SETS; s++) printf(" %s |", b->set[s].name);
    printf("\n|---|---|---|---|\n");
    for (int s = 0; s < b->structures; s++)
        for (int q = 0; q < 3; q++) {
            static const char *const queries[] = {"trace", "trace+t", "occluded"};
            printf("| %s %s / best of Embree |", b->structure_name[s], queries[q]);
            for (int k = 0; k < SETS; k++) {
                Group g = q < 2 ? CLOSEST : ANY;
                const Method *e = best_of(b, k, g, true, NULL, NULL),
                             *m = best_of(b, k, g, false, b->structure_name[s], queries[q]);
                if (e && m) printf(" %.2f |", m->rate[k] / e->rate[k]);
                else printf(" |");
            }
            printf("\n");
        }
    static const char *const clear[] = {"shadow from 1.5", "clearance from 1.5"};
    for (int s = 0; s < b->structures; s++)
        for (int q = 0; q < 2; q++)
            for (int whole = 0; whole < 2; whole++) {
                if (!best_of(b, 1, CLEAR, false, b->structure_name[s], clear[q])) continue;
                printf("| %s %s: cost in units of occluded%s |", b->structure_name[s], clear[q],
                       whole ? "" : " from 1.5");
                for (int k = 0; k < SETS; k++) {
                    const Method *m = best_of(b, k, CLEAR, false, b->structure_name[s], clear[q]);
                    const Method *o = whole ? best_of(b, k, ANY, false, b->structure_name[s], "occluded")
                                            : best_of(b, k, CLEAR, false, b->structure_name[s], "occluded from 1.5");
                    if (m && o) printf(" %.2f |", o->rate[k] / m->rate[k]);
                    else printf(" |");
                }
                printf("\n");
            }
    printf("\n| structure | build, ms | bytes a texel, heights apart |\n|---|---|---|\n");
    for (int s = 0; s < b->structures; s++)
        printf("| %s | %.3f | %.2f |\n", b->structure_name[s], 1e3 * b->build[s], b->bytes[s]);
    for (int g = 0; g < 2 && b->scene[g]; g++)
        printf("| Embree %s | %.3f | %.2f |\n", g ? "grid" : "mesh", 1e3 * b->embree_build[g], b->embree_bytes[g]);
    for (int s = 0; s < b->structures; s++)
        if (b->scene[1] && b->build[s] > 0.0)
            printf("%s is built %.1f times as fast as Embree's grid\n", b->structure_name[s],
                   b->embree_build[1] / b->build[s]);
}

static void print_json(const Bench *b, FILE *f, bool first) {
    fprintf(f, "%s{\"terrain\": \"%s\", \"n\": %u, \"sets\": [", first ? "" : ",\n", b->t->name, b->t->n);
    for (int s = 0; s < SETS; s++)
        fprintf(f, "%s{\"name\": \"%s\", \"rays\": %u, \"hits\": %.4f, \"cut\": %u}", s ? ", " : "", b->set[s].name,
                b->set[s].count, b->set[s].hits, b->set[s].cut);
    fprintf(f, "], \"mrays\": {");
    for (int k = 0; k < b->methods; k++) {
        fprintf(f, "%s\"%s\": [", k ? ", " : "", b->method[k].name);
        for (int s = 0; s < SETS; s++) fprintf(f, "%s%.4f", s ? ", " : "", b->method[k].rate[s]);
        fprintf(f, "]");
    }
    fprintf(f, "}, \"structures\": {");
    for (int s = 0; s < b->structures; s++)
        fprintf(f, "%s\"%s\": {\"build\": %.6f, \"bytes_a_texel\": %.3f}", s ? ", " : "", b->structure_name[s],
                b->build[s], b->bytes[s]);
    for (int g = 0; g < 2 && b->scene[g]; g++)
        fprintf(f, ", \"embree %s\": {\"build\": %.6f, \"bytes_a_texel\": %.3f}", g ? "grid" : "mesh",
                b->embree_build[g], b->embree_bytes[g]);
    fprintf(f, "}}");
}

/* ---- structures: what runtime/geometry/heightfield offers, by name */

typedef struct StructureSpec {
    const char *name;
    FieldOptions options;
} StructureSpec;
static const StructureSpec specs[] = {
    {"naive", {.structure = SLT_STRUCTURE_NAIVE, .band = 1.0f}},
    {"mipmap", {.structure = SLT_STRUCTURE_MIPMAP, .band = 1.0f}},
    {"cone", {.structure = SLT_STRUCTURE_CONE, .band = 1.0f}},
    {"cone-directional", {.structure = SLT_STRUCTURE_CONE, .band = 1.0f, .cone_directional = true}},
    {"cone-exact", {.structure = SLT_STRUCTURE_CONE, .band = 1.0f, .cone_exact = true}},
    {"cone-exact-directional",
     {.structure = SLT_STRUCTURE_CONE, .band = 1.0f, .cone_exact = true, .cone_directional = true}},
    {"cone-bounded", {.structure = SLT_STRUCTURE_CONE, .band = 1.0f, .cone_exact = true, .max_slope = -0.5f}},
};
static SltGeometry *make_field(const Terrain *t, const StructureSpec *s) {
    SltGeometry *f;
    SltError err;
    FieldOptions options = s->options;
    if (options.structure == SLT_STRUCTURE_CONE)
        options.queries = 1u << SLT_QUERY_TRACE | 1u << SLT_QUERY_OCCLUDED; /* the others have the mipmap there too */
    if (field_make(&f, t->h, false, t->n, t->n, &options, &err) == SLT_OK) return f;
    fprintf(stderr, "%s: %s\n", s->name, err.text);
    exit(1);
}
static bool named(const char *list, const char *name) {
    size_t n = strlen(name);
    for (const char *p = list; p; p = strchr(p, ',') ? strchr(p, ',') + 1 : NULL)
        if (!strncmp(p, name, n) && (p[n] == ',' || !p[n])) return true;
    return false;
}
static void make_structures(Bench *b, uint32_t rounds) {
    for (size_t k = 0; k < sizeof specs / sizeof *specs; k++) {
        if (!named(b->o->structures, specs[k].name)) continue;
        int s = b->structures++;
        b->structure_name[s] = specs[k].name;
        b->build[s] = INFINITY;
        for (uint32_t r = 0; r < rounds; r++) {
            size_t before = heap_bytes();
            double start = bench_now();
            SltGeometry *f = make_field(b->t, &specs[k]);
            double seconds = bench_now() - start;
            b->build[s] = fmin(b->build[s], seconds);
            b->bytes[s] = (double)(heap_bytes() - before) / ((double)b->t->n * b->t->n);
            if (b->field[s]) field_free(b->field[s]);
            b->field[s] = f;
            if (seconds > 0.5) break;
        }
    }
}

static void prepare(Bench *b, const Options *o, Terrain *t) {
    *b = (Bench){.o = o, .t = t, .embree_build = {INFINITY, INFINITY}};
    size_t count = (size_t)o->pixels * o->pixels;
    b->ids = malloc(sizeof *b->ids * count);
    b->distance = calloc(count, sizeof *b->distance);
    make_structures(b, o->rounds);
}
static void finish(Bench *b) {
    for (int s = 0; s < SETS; s++) rays_free(&b->set[s]);
    for (int s = 0; s < b->structures; s++) field_free(b->field[s]);
    for (int g = 0; g < 2; g++) embree_scene_free(b->scene[g]);
    free(b->ids), free(b->distance);
}

static void bench_terrain(const Options *o, Terrain *t, FILE *json, bool first) {
    Bench b;
    prepare(&b, o, t);
    for (int g = 0; g < 2; g++)
        for (uint32_t r = 0; r < (g ? o->rounds : 1); r++) {
            double seconds;
            size_t bytes;
            embree_scene_free(b.scene[g]);
            if (!(b.scene[g] = terrain_embree(t, g, &seconds, &bytes))) break;
            b.embree_build[g] = fmin(b.embree_build[g], seconds),
            b.embree_bytes[g] = (double)bytes / ((double)t->n * t->n);
        }
    list_methods(&b);
    printf("\n## %s %u (heights %.1f to %.1f)\n\n", t->name, t->n, t->lowest, t->highest);
    b.set[0] = rays_camera(t, o->pixels);
    float *blocks = rays_blocks(&b.set[0], 16);
    double *where = malloc(sizeof *where * b.set[0].count);
    for (uint32_t k = 0; k < b.set[0].count; k += 16)
        b.field[0]->query[SLT_QUERY_TRACE](b.field[0], t->h, blocks + 8 * (size_t)k, 0xffff, 16, b.ids + k);
    for (uint32_t k = 0; k < b.set[0].count; k++) where[k] = terrain_distance(t, &b.set[0].ray[k], b.ids[k]);
    b.set[1] = rays_sun(t, &b.set[0], where, 20.0);
    b.set[2] = rays_hemisphere(t, &b.set[0], where);
    free(blocks), free(where);
    for (int s = 0; s < SETS; s++) {
        compare(&b, s);
        measure(&b, s);
    }
    print_tables(&b);
    if (json) print_json(&b, json, first);
    finish(&b);
}

/* Every structure and width against naive stepping, and occlusion against the trace; prints the first rays that differ.
 */
static uint64_t exact_terrain(const Options *o, Terrain *t) {
    Bench b;
    prepare(&b, o, t);
    uint64_t differ = 0, done = 0, hits = 0, shown = 0;
    uint32_t batch = o->pixels * o->pixels;
    int32_t *truth = malloc(sizeof *truth * batch);
    Rays camera = rays_camera(t, o->pixels);
    double *where = malloc(sizeof *where * batch);
    for (uint32_t part = 0; done < o->exact; part++) {
        Rays r;
        switch (part < 3 ? part : 3) { /* the benchmark's own rays once, then any */
        case 0: r = rays_camera(t, o->pixels); break;
        case 1: r = rays_sun(t, &camera, where, 20.0); break;
        case 2: r = rays_hemisphere(t, &camera, where); break;
        default: r = rays_any(t, batch, part);
        }
        float *block[WIDTHS];
        for (int w = 0; w < WIDTHS; w++) block[w] = rays_blocks(&r, widths[w]);
        for (uint32_t k = 0; k < r.count; k += 16)
            b.field[0]->query[SLT_QUERY_TRACE](b.field[0], t->h, block[0] + 8 * (size_t)k, 0xffff, 16, truth + k);
        for (uint32_t k = 0; k < r.count; k++) hits += truth[k] != SLT_WITNESS_NONE;
        if (part == 0)
            for (uint32_t k = 0; k < r.count; k++) where[k] = terrain_distance(t, &r.ray[k], truth[k]);
        for (int s = 0; s < b.structures; s++)
            for (int what = SLT_QUERY_TRACE; what <= SLT_QUERY_OCCLUDED; what++) {
                int w = (int)((part + (uint32_t)what) % WIDTHS);
                uint32_t width = widths[w];
                if (s == 0 && what == SLT_QUERY_TRACE && w == 0) continue;
                for (uint32_t k = 0; k < r.count; k += width)
                    b.field[s]->query[what](b.field[s], t->h, block[w] + 8 * (size_t)k,
                                            width == 64 ? ~(uint64_t)0 : ((uint64_t)1 << width) - 1, width, b.ids + k);
                for (uint32_t k = 0; k < r.count; k++) {
                    if (what == SLT_QUERY_TRACE ? b.ids[k] == truth[k]
                                                : (b.ids[k] == SLT_WITNESS_NONE) == (truth[k] == SLT_WITNESS_NONE))
                        continue;
                    differ++;
                    const Ray *q = &r.ray[k];
                    if (shown++ < 10)
                        printf("  %s %s: %d, naive %d: {%a,%a,%a, %a,%a,%a, %a,%a}\n", b.structure_name[s],
                               what ? "occluded" : "trace", b.ids[k], truth[k], q->o[0], q->o[1], q->o[2], q->d[0],
                               q->d[1], q->d[2], q->t0, q->t1);
                }
            }
        done += r.count;
        for (int w = 0; w < WIDTHS; w++) free(block[w]);
        rays_free(&r);
    }
    printf("%s %u: %llu rays (%.0f %% hit), %s, trace and occluded: %llu answers differ from naive stepping\n", t->name,
           t->n, (unsigned long long)done, 100.0 * (double)hits / (double)done, o->structures,
           (unsigned long long)differ);
    rays_free(&camera);
    free(truth), free(where);
    finish(&b);
    return differ;
}

/* What one slice costs: from points of the surface over all slopes, and from a viewpoint a tenth of the side above the
 * ground over the window of one pixel (0.00077 rad). */
static void silhouettes_terrain(Terrain *t) {
    StructureSpec naive = {"naive", {.structure = SLT_STRUCTURE_NAIVE}},
                  mipmap = {"mipmap", {.structure = SLT_STRUCTURE_MIPMAP}};
    SltGeometry *brute = make_field(t, &naive), *mip = make_field(t, &mipmap);
    enum { SLICES = 4000, CAP = 4096 };
    static int32_t id[2][CAP];
    for (int window = 0; window < 2; window++) {
        FieldCounts counts[2] = {0};
        uint64_t state = 99, peaks = 0, differ = 0;
        double seconds[2] = {0};
        for (int n = 0; n < SLICES; n++) {
            double side = t->n - 1.0, x = side * bench_unit(&state), y = side * bench_unit(&state),
                   phi = 2.0 * 3.141592653589793 * bench_unit(&state), k = tan(-0.6 * bench_unit(&state) - 0.02);
            float o[3] = {(float)x, (float)y, (float)(terrain_height(t, x, y, NULL) + (window ? 0.1 * t->n : 0.01))},
                  d[2] = {(float)cos(phi), (float)sin(phi)};
            double low = window ? k : -1e9, high = window ? k + 0.00077 * (1.0 + k * k) : 1e9;
            uint32_t found[2];
            for (int s = 0; s < 2; s++) {
                double start = bench_now();
                found[s] = field_silhouettes(s ? mip : brute, t->h, o, d, low, high, id[s], CAP, &counts[s]);
                seconds[s] += bench_now() - start;
            }
            peaks += found[0];
            differ += found[0] != found[1] || memcmp(id[0], id[1], sizeof **id * found[0]);
        }
        double steps[2] = {(double)counts[0].cells / SLICES, (double)(counts[1].nodes + counts[1].cells) / SLICES};
        printf("| %s %u | %s | %.2f | %.1f, %.2f us | %.1f, %.2f us | %.1f | %llu |\n", t->name, t->n,
               window ? "viewpoint, a pixel's window" : "surface, all slopes", (double)peaks / SLICES, steps[0],
               1e6 * seconds[0] / SLICES, steps[1], 1e6 * seconds[1] / SLICES, steps[0] / steps[1],
               (unsigned long long)differ);
    }
    field_free(brute), field_free(mip);
}

int main(int argc, char **argv) {
    Options o = {.structures = "naive,mipmap,cone", .rounds = 9, .pixels = 512};
    for (int i = 1; i < argc; i++) {
        const char *a = argv[i], *v = i + 1 < argc ? argv[i + 1] : "";
        if (!strcmp(a, "--terrain")) o.terrain = v, i++;
        else if (!strcmp(a, "--json")) o.json = v, i++;
        else if (!strcmp(a, "--structures")) o.structures = v, i++;
        else if (!strcmp(a, "--size")) o.size = (uint32_t)atoi(v), i++;
        else if (!strcmp(a, "--rounds")) o.rounds = (uint32_t)atoi(v), i++;
        else if (!strcmp(a, "--pixels")) o.pixels = (uint32_t)atoi(v) & ~7u, i++;
        else if (!strcmp(a, "--exact")) o.exact = strtoull(v, NULL, 10), i++;
        else if (!strcmp(a, "--silhouettes")) o.silhouettes = true;
        else return fprintf(stderr, "unknown option %s\n", a), 2;
    }
    static const char *const names[] = {"dem", "fbm"};
    static const uint32_t sizes[] = {256, 1024, 2048};
    FILE *json = o.json ? fopen(o.json, "w") : NULL;
    uint64_t wrong = 0;
    bool first = true;
    printf("Embree %s\n", embree_config());
    if (json) fprintf(json, "[");
    if (o.silhouettes)
        printf(
            "| terrain | slices | peaks | stepping: cells, time | mipmap: nodes and cells, time | ratio of steps | slices that differ |\n|---|---|---|---|---|---|---|\n");
    for (int k = 0; k < 2; k++)
        for (int s = 0; s < 3; s++) {
            if ((o.terrain && strcmp(o.terrain, names[k])) || (o.size && o.size != sizes[s])) continue;
            Terrain t;
            if (!terrain_make(&t, names[k], sizes[s])) {
                printf("%s %u: SALTUS_DATA has no elevations; skipped\n", names[k], sizes[s]);
                continue;
            }
            if (o.silhouettes) silhouettes_terrain(&t);
            else if (o.exact) wrong += exact_terrain(&o, &t);
            else bench_terrain(&o, &t, json, first);
            first = false;
            terrain_free(&t);
            fflush(stdout);
        }
    if (json) fprintf(json, "]\n"), fclose(json);
    return wrong != 0;
}
