/* Visible pieces, a beam a pixel, on one thread: the search alone, with sides, in kernels, with the gradient in all
 * vertices, with what a point light sees of them; beside a ray a pixel, ours and Embree's (embree.c), whose best is
 * the unit. Processor time, the least of a few rounds.
 *
 *     bench-pieces FILE.obj [SUBDIVISIONS [SIZE]]         a pixel each
 *     bench-pieces FILE.obj SUBDIVISIONS SIZE q.area      kernels of this term alone
 *     bench-pieces FILE.obj SUBDIVISIONS 1                all of the mesh in one beam */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "rays.h"
#include "runtime/geometry/geometry.h"
#include "runtime/mesh/mesh.h"
#include "saltus/mesh.h"

enum { LANES = 32, ACROSS = 8 /* pixels of a call, as of a kernel's */, ROUNDS = 5 };

typedef struct Model {
    uint32_t nvertices, nfaces;
    float *at;
    int32_t *face;
} Model;

typedef struct View {
    double eye[3], corner[3], u[3], v[3];
    uint32_t size;
} View;

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void *or_die(void *p) {
    if (!p) fprintf(stderr, "out of memory\n"), exit(1);
    return p;
}

static Model read_model(const char *path) {
    Mesh mesh;
    SltError err = {0};
    if (mesh_read(path, &mesh, &err) != SLT_OK) fprintf(stderr, "%s\n", err.text), exit(1);
    uint32_t *part = or_die(malloc(mesh.nvertices * sizeof *part));
    if (!mesh_weld(&mesh, part)) exit(1);
    Model m = {.nvertices = mesh.nvertices, .nfaces = mesh.nfaces};
    m.at = or_die(malloc(3 * (size_t)m.nvertices * sizeof *m.at));
    m.face = or_die(malloc(3 * (size_t)m.nfaces * sizeof *m.face));
    for (size_t i = 0; i < 3 * (size_t)m.nvertices; i++) m.at[i] = (float)mesh.position[i];
    for (size_t i = 0; i < 3 * (size_t)m.nfaces; i++) m.face[i] = (int32_t)mesh.face[i];
    mesh_free(&mesh), free(part);
    return m;
}

typedef struct Edge {
    int32_t low, high;
    uint32_t half;
} Edge;

static int by_ends(const void *x, const void *y) {
    const Edge *a = x, *b = y;
    return a->low != b->low ? (a->low > b->low) - (a->low < b->low) : (a->high > b->high) - (a->high < b->high);
}

/* Each face in four, flat. */
static Model subdivide(const Model *m) {
    const uint32_t halves = 3 * m->nfaces;
    Edge *edge = or_die(malloc(halves * sizeof *edge));
    int32_t *middle = or_die(malloc(halves * sizeof *middle));
    Model out = {.nvertices = m->nvertices, .nfaces = 4 * m->nfaces};
    out.at = or_die(malloc(3 * ((size_t)m->nvertices + halves) * sizeof *out.at));
    out.face = or_die(malloc(12 * (size_t)m->nfaces * sizeof *out.face));
    memcpy(out.at, m->at, 3 * (size_t)m->nvertices * sizeof *m->at);
    for (uint32_t h = 0; h < halves; h++) {
        const int32_t a = m->face[h], b = m->face[h - h % 3 + (h + 1) % 3];
        edge[h] = (Edge){a < b ? a : b, a < b ? b : a, h};
    }
    qsort(edge, halves, sizeof *edge, by_ends);
    for (uint32_t i = 0; i < halves; i++) {
        if (i == 0 || by_ends(&edge[i - 1], &edge[i])) {
            for (int a = 0; a < 3; a++)
                out.at[3 * out.nvertices + (uint32_t)a] =
                    0.5f * m->at[3 * edge[i].low + a] + 0.5f * m->at[3 * edge[i].high + a];
            out.nvertices++;
        }
        middle[edge[i].half] = (int32_t)out.nvertices - 1;
    }
    for (uint32_t f = 0; f < m->nfaces; f++) {
        const int32_t *c = m->face + 3 * f, *d = middle + 3 * f;
        const int32_t faces[12] = {c[0], d[0], d[2], c[1], d[1], d[0], c[2], d[2], d[1], d[0], d[1], d[2]};
        memcpy(out.face + 12 * (size_t)f, faces, sizeof faces);
    }
    free(edge), free(middle);
    return out;
}

/* From the front, above and beside; the window is as large as what is seen of the bounds. */
static View view_of(const Model *m, uint32_t size) {
    static const double across[3] = {0.82, 0, 0.57}, up[3] = {-0.17, 0.95, 0.25}, back[3] = {0.54, 0.3, -0.78};
    View v = {.size = size};
    double lo[2] = {HUGE_VAL, HUGE_VAL}, hi[2] = {-HUGE_VAL, -HUGE_VAL}, mean[3] = {0};
    for (size_t i = 0; i < 3 * (size_t)m->nvertices; i++) mean[i % 3] += (double)m->at[i] / m->nvertices;
    for (int a = 0; a < 3; a++) v.eye[a] = mean[a] + 4 * back[a];
    for (uint32_t i = 0; i < m->nvertices; i++) {
        double p[3] = {0};
        for (int a = 0; a < 3; a++) {
            const double d = (double)m->at[3 * i + (uint32_t)a] - v.eye[a];
            p[0] += d * across[a], p[1] += d * up[a], p[2] -= d * back[a];
        }
        for (int k = 0; k < 2; k++) lo[k] = fmin(lo[k], p[k] / p[2]), hi[k] = fmax(hi[k], p[k] / p[2]);
    }
    const double side = 1.05 * fmax(hi[0] - lo[0], hi[1] - lo[1]);
    for (int a = 0; a < 3; a++) {
        v.u[a] = side * across[a], v.v[a] = side * up[a];
        v.corner[a] =
            v.eye[a] - back[a] + (0.5 * (lo[0] + hi[0] - side)) * across[a] + (0.5 * (lo[1] + hi[1] - side)) * up[a];
    }
    return v;
}

static SltGeometry *made(const Model *m) {
    SltGeometry *g;
    SltError err;
    const GeometrySource from = {.kind = SLT_GEOMETRY_MESH,
                                 .nvertices = m->nvertices,
                                 .nfaces = m->nfaces,
                                 .faces = m->face,
                                 .queries = 1u << SLT_QUERY_PIECES | 1u << SLT_QUERY_SEEN | 1u << SLT_QUERY_TRACE};
    if (geometry_make(&g, &from, m->at, &err) != SLT_OK) fprintf(stderr, "%s\n", err.text), exit(1);
    return g;
}

typedef struct Count {
    double seconds, covered;
    uint64_t pieces;
} Count;

static void set_rows(const View *view, SltQuery what, uint32_t x, uint32_t y, uint32_t lanes, float *row) {
    const double n = view->size, middle = what == SLT_QUERY_TRACE ? 0.5 : 0;
    for (uint32_t k = 0; k < lanes; k++)
        for (uint32_t a = 0; a < 3; a++) {
            const double at = view->corner[a] + (x + k % ACROSS + middle) / n * view->u[a] +
                              (y + k / ACROSS + middle) / n * view->v[a];
            row[a * lanes + k] = (float)view->eye[a];
            row[(3 + a) * lanes + k] = (float)(what == SLT_QUERY_TRACE ? at - view->eye[a] : at);
            if (what == SLT_QUERY_TRACE) continue;
            row[(6 + a) * lanes + k] = (float)(view->u[a] / n), row[(9 + a) * lanes + k] = (float)(view->v[a] / n);
        }
    for (uint32_t k = 0; k < lanes && what == SLT_QUERY_TRACE; k++) row[6 * lanes + k] = 0, row[7 * lanes + k] = 1e30f;
}

/* Some lines of pixels at a time: what they look through is not timed. The size is 1 or can be divided by 32. */
static Count ask(const SltGeometry *g, const Model *m, const View *view, SltQuery what) {
    Count best = {.seconds = HUGE_VAL};
    const uint32_t lanes = view->size < LANES ? 1 : LANES, across = lanes < ACROSS ? lanes : ACROSS,
                   calls = view->size / across;
    float(*row)[SLT_BEAM_ROWS * LANES] = or_die(malloc(calls * sizeof *row));
    for (int round = 0; round < ROUNDS; round++) {
        Count now_ = {0};
        for (uint32_t y = 0; y < view->size; y += lanes / across) {
            for (uint32_t i = 0; i < calls; i++) set_rows(view, what, i * across, y, lanes, row[i]);
            const double start = now();
            for (uint32_t i = 0; i < calls; i++) {
                int32_t witness[LANES];
                if (what != SLT_QUERY_TRACE) g->query[SLT_QUERY_BEGIN](g, m->at, NULL, 1, 1, witness);
                g->query[what](g, m->at, row[i], lanes == 32 ? UINT32_MAX : 1, lanes, witness);
                const float *told = g->told();
                for (uint32_t k = 0; k < lanes; k++) {
                    if (what == SLT_QUERY_TRACE) now_.covered += witness[k] >= 0;
                    else
                        for (int32_t unit = witness[k], next; unit; unit = next) {
                            now_.covered += (double)told[SLT_TOLD * (size_t)unit + SLT_PIECE_AREA], now_.pieces++;
                            memcpy(&next, &told[SLT_TOLD * (size_t)unit + SLT_PIECE_NEXT], sizeof next);
                        }
                }
            }
            now_.seconds += now() - start;
        }
        if (now_.seconds < best.seconds) best = now_;
    }
    free(row);
    return best;
}

/* Embree's rays through the middles of the same pixels, in squares, which its packets like best. */
typedef struct Theirs {
    EmbreeScene *scene; /* NULL: it was not there when this was built, or there is one pixel */
    Rays rays;
    const char *name; /* of the best call */
    double seconds;
} Theirs;

static Theirs theirs_made(const Model *m, const View *view) {
    Theirs t = {.seconds = HUGE_VAL};
    double seconds;
    size_t bytes;
    if (view->size < LANES) return t;
    const EmbreeSource from = {.vertex = m->at,
                               .face = (const uint32_t *)m->face,
                               .nvertices = m->nvertices,
                               .nfaces = m->nfaces,
                               .robust = true};
    t.scene = embree_scene_make(&from, &seconds, &bytes);
    t.rays.count = t.scene ? view->size * view->size : 0;
    if (!t.scene) return t;
    t.rays.ray = or_die(malloc(t.rays.count * sizeof *t.rays.ray));
    for (uint32_t k = 0; k < t.rays.count; k++) {
        uint32_t x, y;
        float row[SLT_BEAM_ROWS];
        rays_pixel(k, view->size, &x, &y);
        set_rows(view, SLT_QUERY_TRACE, x, y, 1, row);
        t.rays.ray[k] = (Ray){{row[0], row[1], row[2]}, {row[3], row[4], row[5]}, 0, HUGE_VALF};
    }
    embree_prepare(t.scene, &t.rays);
    return t;
}

static void theirs_run(Theirs *t) {
    for (int round = 0; t->scene && round < ROUNDS; round++)
        for (int call = EMBREE_INT1; call <= EMBREE_INT16; call++)
            for (int coherent = 0; coherent < 2; coherent++) {
                const double start = now();
                embree_run(t->scene, (EmbreeCall)call, coherent);
                const double seconds = now() - start;
                if (seconds < t->seconds) t->seconds = seconds, t->name = embree_call_names[call];
            }
}

static void theirs_free(Theirs *t) {
    if (t->scene) embree_scene_free(t->scene);
    rays_free(&t->rays);
}

static void write_obj(const Model *m, const char *path) {
    FILE *f = or_die(fopen(path, "w"));
    for (uint32_t i = 0; i < m->nvertices; i++)
        fprintf(f, "v %.9g %.9g %.9g\n", (double)m->at[3 * i], (double)m->at[3 * i + 1], (double)m->at[3 * i + 2]);
    for (uint32_t i = 0; i < m->nfaces; i++)
        fprintf(f, "f %d %d %d\n", (int)m->face[3 * i] + 1, (int)m->face[3 * i + 1] + 1, (int)m->face[3 * i + 2] + 1);
    fclose(f);
}

static SltProgram *program(const Model *m, const View *v, const char *of_piece, const char *path) {
    char source[2048];
    snprintf(source, sizeof source,
             "param mesh m = \"%s\";\n"
             "shader float main(float2 x) {\n"
             "    float n = %u.0;\n"
             "    float3 u = float3(%.9g, %.9g, %.9g), v = float3(%.9g, %.9g, %.9g);\n"
             "    Beam b;\n"
             "    b.eye = float3(%.9g, %.9g, %.9g);\n"
             "    b.corner = float3(%.9g, %.9g, %.9g) + floor(x.x * n) / n * u + floor(x.y * n) / n * v;\n"
             "    b.u = u / n; b.v = v / n;\n"
             "    float3 light = b.eye + float3(2.5, 2.4, 1.7);\n"
             "    float sum = 0.0;\n"
             "    for (Piece q = m.first(b); q.found; q = m.next(q)) sum += %s * (0.6 + 0.4 * q.normal.y);\n"
             "    return sum;\n"
             "}\n",
             path, v->size, v->u[0], v->u[1], v->u[2], v->v[0], v->v[1], v->v[2], v->eye[0], v->eye[1], v->eye[2],
             v->corner[0], v->corner[1], v->corner[2], of_piece);
    write_obj(m, path);
    SltProgram *p;
    SltOptions opt = SLT_OPTIONS_INIT;
    if (slt_compile_string(source, "pieces.salt", &opt, &p) != SLT_OK)
        fprintf(stderr, "%s%s\n", slt_diagnostics_text(p), slt_last_error(p)), exit(1);
    remove(path);
    return p;
}

static void time_kernels(const Model *m, const View *view, const char *of_piece) {
    SltProgram *p = program(m, view, of_piece, "bench-pieces.obj");
    const size_t pixels = (size_t)view->size * view->size;
    float *image = or_die(malloc(pixels * sizeof *image)), *ones = or_die(malloc(pixels * sizeof *ones));
    double *gradient = or_die(malloc(slt_float_count(p) * sizeof *gradient)), least[2] = {HUGE_VAL, HUGE_VAL};
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    job.size[0] = job.size[1] = view->size, job.spp = 1, job.threads = 1, job.centred = true;
    job.estimator = SLT_EST_LATTICE;
    for (size_t i = 0; i < pixels; i++) ones[i] = 1;
    for (int round = 0; round <= ROUNDS; round++) {
        double start = now();
        if (slt_render(p, &job, image, NULL, &err) != SLT_OK) fprintf(stderr, "%s\n", err.text), exit(1);
        if (round) least[0] = fmin(least[0], now() - start);
        start = now();
        if (slt_grad_adjoint(p, &job, ones, gradient, NULL, NULL, &err) != SLT_OK)
            fprintf(stderr, "%s\n", err.text), exit(1);
        if (round) least[1] = fmin(least[1], now() - start);
    }
    printf("  image by %-20s %9.1f ns a pixel\n  gradient in all vertices %14.1f ns a pixel, %.2f of the image\n",
           of_piece, 1e9 * least[0] / (double)pixels, 1e9 * least[1] / (double)pixels, least[1] / least[0]);
    free(image), free(ones), free(gradient);
    slt_program_free(p);
}

int main(int argc, char **argv) {
    if (argc < 2) return 2;
    Model m = read_model(argv[1]);
    for (int level = argc > 2 ? atoi(argv[2]) : 0; level > 0; level--) {
        Model finer = subdivide(&m);
        free(m.at), free(m.face);
        m = finer;
    }
    const View view = view_of(&m, argc > 3 ? (uint32_t)atoi(argv[3]) : 1024);
    SltGeometry *g = made(&m);
    static const struct {
        SltQuery what;
        const char *name;
    } row[] = {{SLT_QUERY_TRACE, "rays"}, {SLT_QUERY_SEEN, "pieces"}, {SLT_QUERY_PIECES, "pieces and sides"}};
    printf("%u triangles, %u x %u\n", m.nfaces, view.size, view.size);
    const double pixels = (double)view.size * view.size;
    Count count[3];
    Theirs theirs = theirs_made(&m, &view);
    for (int k = 0; k < 3; k++) theirs_run(&theirs), count[k] = ask(g, &m, &view, row[k].what);
    if (theirs.scene) printf("  rays of Embree %24.1f ns a pixel, %s\n", 1e9 * theirs.seconds / pixels, theirs.name);
    for (int k = 0; k < 3; k++) {
        const Count c = count[k];
        printf("  %-16s %22.1f ns a pixel, %.1f %% covered, %.2f pieces a pixel", row[k].name, 1e9 * c.seconds / pixels,
               100 * c.covered / pixels, (double)c.pieces / pixels);
        if (theirs.scene) printf(", %.2f Embree rays", c.seconds / theirs.seconds);
        if (view.size == 1) printf(", %.3f us a triangle", 1e6 * c.seconds / m.nfaces);
        printf("\n");
    }
    geometry_free(g), theirs_free(&theirs);
    if (argc > 4) time_kernels(&m, &view, argv[4]);
    else if (view.size > 1) time_kernels(&m, &view, "q.area"), time_kernels(&m, &view, "m.lit(q, light)");
    free(m.at), free(m.face);
    return 0;
}
