/* What a point light sees of visible pieces: closed forms, a reference in long double, both ways of searching, any
 * order of faces; what is degenerate; derivatives against differences of the reference. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

#include "runtime/geometry/mesh/light.h"
#include "runtime/geometry/mesh/lit.h"
#include "runtime/geometry/mesh/pieces.h"
#include "runtime/geometry/mesh/trimesh.h"
#include "tests/trimesh/scene.h"

/* ---- the reference: each triangle less all that is nearer for the eye, then less what hides it from the light */

enum { NUMBERS = SLT_BEAM_ROWS + 3 };

/* All numbers of a scene: beam, light, vertices. */
typedef struct Numbers {
    long double row[NUMBERS], at[SCENE_VERTICES][3];
} Numbers;

static void set_numbers(const Scene *s, const double light[3], Numbers *out) {
    for (int k = 0; k < NUMBERS; k++) out->row[k] = k < SLT_BEAM_ROWS ? s->beam[k] : light[k - SLT_BEAM_ROWS];
    for (uint32_t i = 0; i < s->nvertices; i++)
        for (int a = 0; a < 3; a++) out->at[i][a] = s->at[i][a];
}

static long double dot(const long double a[3], const long double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const long double a[3], const long double b[3], long double out[3]) {
    for (int i = 0; i < 3; i++) out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

/* A triangle seen from a point. */
typedef struct View {
    long double corner[3][3], edge[3][3], normal[3], det;
} View;

static void view(const Numbers *n, const int32_t face[3], const long double from[3], View *out) {
    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++) out->corner[k][a] = n->at[face[k]][a] - from[a];
    for (int k = 0; k < 3; k++) cross(out->corner[k], out->corner[(k + 1) % 3], out->edge[k]);
    for (int a = 0; a < 3; a++) out->normal[a] = out->edge[0][a] + out->edge[1][a] + out->edge[2][a];
    out->det = dot(out->corner[0], out->normal);
}

/* d . x as a function of (s, t) */
static void line_of(const Numbers *n, const long double x[3], long double factor, long double g[3]) {
    long double c[3];
    for (int a = 0; a < 3; a++) c[a] = n->row[SLT_BEAM_CORNER + a] - n->row[SLT_BEAM_EYE + a];
    g[0] += factor * dot(n->row + SLT_BEAM_U, x), g[1] += factor * dot(n->row + SLT_BEAM_V, x);
    g[2] += factor * dot(c, x);
}

/* Takes what is in all the half-planes from each part. */
static bool take_out(Part (*row)[SCENE_PARTS], int *now, uint32_t *n, long double g[][3], int lines) {
    uint32_t kept = 0;
    for (uint32_t i = 0; i < *n; i++) {
        Part in = row[*now][i];
        for (int k = 0; k < lines && in.n; k++) {
            Part rest = part_cut(&in, g[k], -1);
            in = part_cut(&in, g[k], 1);
            if (rest.n && kept == SCENE_PARTS) return false;
            if (rest.n) row[!*now][kept++] = rest;
        }
    }
    *now = !*now, *n = kept;
    return true;
}

static long double sign(long double x) { return x < 0 ? -1 : 1; }

/* What of the face is seen by the eye and the light. */
static long double reference(const Scene *s, const Numbers *n, uint32_t face) {
    static Part row[2][SCENE_PARTS];
    const long double *eye = n->row + SLT_BEAM_EYE, *light = n->row + SLT_BEAM_ROWS;
    long double g[4][3], sum[3] = {0}, way[3];
    View own, lit, other;
    uint32_t parts = 1;
    int now = 0;
    view(n, s->face[face], eye, &own);
    view(n, s->face[face], light, &lit);
    if (own.det == 0 || lit.det == 0) return 0;
    row[0][0] = (Part){4, {0, 1, 1, 0}, {0, 0, 1, 1}};
    for (int k = 0; k < 3; k++) {
        memset(g, 0, sizeof g);
        line_of(n, own.edge[k], sign(own.det), g[0]);
        row[0][0] = part_cut(&row[0][0], g[0], 1);
    }
    for (uint32_t f = 0; f < s->nfaces; f++) {
        if (f == face) continue;
        view(n, s->face[f], eye, &other);
        memset(g, 0, sizeof g);
        for (int k = 0; k < 3; k++) line_of(n, other.edge[k], sign(other.det), g[k]);
        line_of(n, other.normal, 1 / other.det, g[3]), line_of(n, own.normal, -1 / own.det, g[3]);
        if (other.det != 0 && !take_out(row, &now, &parts, g, 4)) fail_msg("the reference has too many parts");
        /* X - L is (E - L) + d det / (d . n), and d . n has the sign of det. */
        view(n, s->face[f], light, &other);
        if (other.det == 0) continue;
        memset(g, 0, sizeof g);
        for (int a = 0; a < 3; a++) way[a] = eye[a] - light[a];
        for (int k = 0; k < 3; k++) {
            const long double by = sign(own.det) * sign(other.det);
            line_of(n, own.normal, by * dot(way, other.edge[k]), g[k]), line_of(n, other.edge[k], by * own.det, g[k]);
        }
        /* X lies on the other side of the plane than the light. */
        const long double by = sign(own.det) * sign(other.det);
        for (int a = 0; a < 3; a++) way[a] = eye[a] - n->at[s->face[f][0]][a];
        line_of(n, own.normal, by * dot(way, other.normal), g[3]), line_of(n, other.normal, by * own.det, g[3]);
        if (!take_out(row, &now, &parts, g, 4)) fail_msg("the reference has too many parts");
    }
    for (uint32_t i = 0; i < parts; i++) part_add(&row[now][i], sum);
    return sum[0];
}

/* ---- what is asked */

static int32_t parts_of_a_face = 1; /* that have one weight */

static double weight_of(int32_t face) { return 1 + 0.3 * (face / parts_of_a_face % 5); }

/* Of each face what is seen and lit; of the sum of the latter, weighed, the derivatives. */
typedef struct Answer {
    double seen[SCENE_FACES], lit[SCENE_FACES], row[NUMBERS], vertex[SCENE_VERTICES][3];
    double all_seen, all_lit, most; /* most: by which what is lit of a piece is more than it */
} Answer;

static double told(bool f64, int32_t unit, uint32_t which) {
    const size_t at = (size_t)unit * SLT_TOLD + which;
    return f64 ? ((const double *)pieces_told())[at] : (double)((const float *)pieces_told())[at];
}

static int32_t told_int(bool f64, int32_t unit, uint32_t which) {
    int32_t n;
    memcpy(&n, (const char *)pieces_told() + ((size_t)unit * SLT_TOLD + which) * (f64 ? sizeof(double) : sizeof(float)),
           sizeof n);
    return n;
}

static void ask(const Scene *s, const double light[3], bool f64, LightWay way, Answer *out) {
    SltGeometry *g;
    SltError err;
    const GeometrySource from = {.kind = SLT_GEOMETRY_MESH,
                                 .f64 = f64,
                                 .nvertices = s->nvertices,
                                 .nfaces = s->nfaces,
                                 .faces = &s->face[0][0],
                                 .queries = 1u << SLT_QUERY_PIECES | 1u << SLT_QUERY_LIT};
    const void *values = f64 ? (const void *)s->at : s->f32;
    assert_int_equal(geometry_make(&g, &from, values, &err), SLT_OK);
    const Trimesh *m = (Trimesh *)g;
    const LightScene scene = {.tree = {.bvh = &m->bvh},
                              .adjacency = &m->adjacency,
                              .search = m->rays->by[f64],
                              .beam = m->beam,
                              .cross = m->cross,
                              .values = values,
                              .way = way};
    double wide[SLT_LIT_ROWS];
    float narrow[SLT_LIT_ROWS];
    int32_t unit, piece;
    memset(out, 0, sizeof *out);
    for (int k = 0; k < SLT_LIT_UNIT; k++) {
        wide[k] = k < SLT_BEAM_ROWS ? s->beam[k] : light[k - SLT_LIT_LIGHT];
        narrow[k] = (float)wide[k];
    }
    pieces_begin();
    g->query[SLT_QUERY_PIECES](g, values, f64 ? (const void *)wide : narrow, 1, 1, &piece);
    for (; piece; piece = told_int(f64, piece, SLT_PIECE_NEXT)) {
        const int32_t face = told_int(f64, piece, SLT_PIECE_TRIANGLE);
        wide[SLT_LIT_UNIT] = narrow[SLT_LIT_UNIT] = (float)piece;
        assert_true(lit_find(&scene, f64 ? (const void *)wide : narrow, 1, 1, &unit));
        const double area = told(f64, piece, SLT_PIECE_AREA), lit = told(f64, unit, SLT_LIGHT_VALUE);
        if (isnan(light[0] + light[1] + light[2])) {
            assert_true(isnan(lit));
            continue;
        }
        assert_true(lit >= 0 && lit <= area * (1 + 1e-13) + 1e-300);
        out->seen[face] += area, out->lit[face] += lit, out->all_seen += area, out->all_lit += lit;
        if (!unit) continue;
        for (uint32_t k = 0; k < NUMBERS; k++) out->row[k] += weight_of(face) * told(f64, unit, SLT_LIGHT_SLOPES + k);
        const int32_t n = told_int(f64, unit, SLT_LIGHT_COUNT);
        for (int32_t i = 0; i < n; i++)
            for (uint32_t k = 0; k < 2; k++) {
                const int32_t of = unit + SLT_LIGHT_EDGES + i, v = told_int(f64, of, SLT_LIGHT_A + k);
                for (uint32_t a = 0; a < 3; a++)
                    out->vertex[v][a] += weight_of(face) * told(f64, of, (k ? SLT_LIGHT_D_B : SLT_LIGHT_D_A) + a);
            }
    }
    geometry_free(g);
}

static void assert_near(double a, double b, double most, const char *what, uint32_t i) {
    if (fabs(a - b) <= most) return;
    fail_msg("%s of %u: %.17g and %.17g, apart by %g", what, i, a, b, fabs(a - b));
}

static const double *light_at(double x, double y, double z) {
    static double at[3];
    at[0] = x, at[1] = y, at[2] = z;
    return at;
}

/* ---- values */

/* What hides the floor z = 0 of 20 x 20, seen from below through a window that maps to [-5, 5]^2 of it. */
static void floor_scene(Scene *s) {
    *s = (Scene){0};
    const int32_t a = scene_vertex(s, -10, -10, 0), b = scene_vertex(s, 10, -10, 0), c = scene_vertex(s, 10, 10, 0),
                  d = scene_vertex(s, -10, 10, 0);
    scene_face(s, a, b, c), scene_face(s, a, c, d);
    const double beam[SLT_BEAM_ROWS] = {0, 0, -3, -5. / 3, -5. / 3, -2, 10. / 3, 0, 0, 0, 10. / 3, 0};
    memcpy(s->beam, beam, sizeof beam);
}

static void add_box(Scene *s, double half, double low, double high) {
    int32_t v[8];
    for (int i = 0; i < 8; i++) v[i] = scene_vertex(s, i & 1 ? half : -half, i & 2 ? half : -half, i & 4 ? high : low);
    static const int quad[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
    for (int q = 0; q < 6; q++) {
        scene_face(s, v[quad[q][0]], v[quad[q][1]], v[quad[q][2]]);
        scene_face(s, v[quad[q][0]], v[quad[q][2]], v[quad[q][3]]);
    }
}

static void test_closed_forms(void **state) {
    (void)state;
    static Scene s;
    static Answer now;
    for (LightWay way = LIGHT_BY_COUNTS; way <= LIGHT_TRIANGLES; way++) {
        floor_scene(&s);
        ask(&s, light_at(0.3, 0.2, 4), true, way, &now);
        assert_near(now.all_seen, 1, 1e-12, "the window", way);
        assert_near(now.all_lit, 1, 1e-12, "what is lit of the bare floor", way);
        ask(&s, light_at(0.3, 0.2, -1), true, way, &now);
        assert_near(now.all_lit, 1, 1e-12, "the same from below", way);
        /* Below the light the top of the box, 1 x 1 at 2, hides twice its width. */
        add_box(&s, 0.5, 1, 2);
        ask(&s, light_at(0.1, -0.2, 4), true, way, &now);
        assert_near(now.all_lit, 1 - 4 / 100.0, 1e-12, "the box in the air", way);
        ask(&s, light_at(0.1, -0.2, 1.5), true, way, &now);
        assert_near(now.all_lit, 0, 1e-12, "the light in the box", way);
        ask(&s, light_at(0.1, -0.2, 0.5), true, way, &now);
        assert_near(now.all_lit, 1, 1e-12, "the light below the box", way);
        /* Standing on the floor: the hull of its foot and of its top, seen from the light. */
        floor_scene(&s);
        add_box(&s, 0.5, 0, 1);
        ask(&s, light_at(3, 0.2, 2), true, way, &now);
        static const double hull[6][2] = {{-4, -1.2}, {-2, -1.2}, {0.5, -0.5}, {0.5, 0.5}, {-2, 0.8}, {-4, 0.8}};
        double area = 0;
        for (int k = 0; k < 6; k++)
            area += 0.5 * (hull[k][0] * hull[(k + 1) % 6][1] - hull[k][1] * hull[(k + 1) % 6][0]);
        assert_near(now.all_seen, 1, 1e-12, "the window", way);
        assert_near(now.all_lit, 1 - area / 100, 1e-12, "the box on the floor", way);
        /* Through the floor: the part above counts. */
        floor_scene(&s);
        add_box(&s, 0.5, -0.5, 2);
        ask(&s, light_at(0.1, -0.2, 4), true, way, &now);
        double floor = now.lit[0] + now.lit[1];
        assert_near(floor, 1 - 4 / 100.0, 1e-12, "the box through the floor", way);
    }
    floor_scene(&s);
    for (int k = 0; k < 2; k++) {
        ask(&s, light_at(2, 1, k ? 1e-17 : 0), true, LIGHT_BY_COUNTS, &now);
        assert_true(now.all_lit == 0); /* a light in the plane */
    }
}

static void set_scene(Scene *s, uint32_t round, uint32_t triangles, uint64_t *seed) {
    *s = (Scene){0};
    scene_soup(s, triangles, 1.6, seed);
    scene_beam(s, round % 4 == 3 ? 0 : 3, round % 4 == 2 ? 1 : -1,
               round % 4 == 2 ? -2 : 2); /* 3: inside, 2: mirrored */
}

static const double *some_light(uint64_t *seed) {
    double at[3];
    for (int a = 0; a < 3; a++) at[a] = 4 * scene_uniform(seed) - 2;
    return light_at(at[0], at[1], at[2]);
}

static void test_reference(void **state) {
    (void)state;
    uint64_t seed = 21;
    static Scene s;
    static Answer now;
    static Numbers n;
    double hidden = 0;
    for (uint32_t round = 0; round < 40; round++) {
        set_scene(&s, round, 2 + round / 2, &seed);
        const double *light = some_light(&seed);
        set_numbers(&s, light, &n);
        for (LightWay way = LIGHT_BY_COUNTS; way <= LIGHT_TRIANGLES; way++) {
            ask(&s, light, true, way, &now);
            for (uint32_t f = 0; f < s.nfaces; f++)
                assert_near(now.lit[f], (double)reference(&s, &n, f), 1e-11, "what is lit", 100 * round + f);
            hidden += now.all_seen - now.all_lit;
        }
    }
    assert_true(hidden > 5);
}

/* Vertices on a grid with few depths, faces over any of them; the light on it as well, often. */
static void degenerate(Scene *s, double light[3], uint64_t *state) {
    enum { GRID = 4, DEPTHS = 3 };
    *s = (Scene){0};
    for (int z = 0; z < DEPTHS; z++)
        for (int y = 0; y <= GRID; y++)
            for (int x = 0; x <= GRID; x++)
                scene_vertex(s, (double)x / GRID * (z + 2), (double)y / GRID * (z + 2), (double)-z);
    const uint32_t n = 2 + (uint32_t)(scene_uniform(state) * 10);
    for (uint32_t i = 0; i < n; i++) {
        int32_t v[3];
        for (int k = 0; k < 3; k++) v[k] = (int32_t)(scene_uniform(state) * s->nvertices);
        scene_face(s, v[0], v[1], v[2]);
    }
    const double kind = scene_uniform(state), corner = (int)(scene_uniform(state) * 4) / 4.0,
                 beam[SLT_BEAM_ROWS] = {
                     0, 0, 2, corner, corner, 0, kind < 0.5 ? 0.25 : 1, 0, 0, 0, kind < 0.5 ? 0.25 : 1, 0};
    memcpy(s->beam, beam, sizeof beam);
    for (int a = 0; a < 3; a++) light[a] = (int)(scene_uniform(state) * 9) / (kind < 0.3 ? 2.7 : 2) - 1;
}

static void test_degenerate(void **state) {
    (void)state;
    uint64_t seed = 22;
    const char *wanted = getenv("SALTUS_PIECES_WINDOWS");
    const uint32_t windows = wanted ? (uint32_t)strtoul(wanted, NULL, 10) : 6000;
    static Scene s;
    static Answer one, other;
    for (uint32_t round = 0; round < windows; round++) {
        double light[3];
        degenerate(&s, light, &seed);
        ask(&s, light, true, LIGHT_SILHOUETTES, &one);
        for (uint32_t f = 0; f < s.nfaces / 2; f++) {
            int32_t face[3];
            memcpy(face, s.face[f], sizeof face);
            memcpy(s.face[f], s.face[s.nfaces - 1 - f], sizeof face);
            memcpy(s.face[s.nfaces - 1 - f], face, sizeof face);
        }
        ask(&s, light, true, LIGHT_TRIANGLES, &other);
        assert_near(one.all_lit, other.all_lit, 1e-10, "what is lit", round);
    }
}

/* ---- derivatives */

static long double weighed(const Scene *s, const Numbers *n) {
    long double sum = 0;
    for (uint32_t f = 0; f < s->nfaces; f++) sum += weight_of((int32_t)f) * reference(s, n, f);
    return sum;
}

static double difference(const Scene *s, Numbers *n, long double *x, long double step) {
    const long double was = *x;
    long double f[4];
    for (int k = 0; k < 4; k++) *x = was + step * (k < 2 ? k - 2 : k - 1), f[k] = weighed(s, n);
    *x = was;
    return (double)((f[0] - f[3] + 8 * (f[2] - f[1])) / (12 * step));
}

/* size: of the window */
static void assert_differences(const Scene *s, const double light[3], double size, double most, uint32_t round) {
    static Answer now;
    static Numbers n;
    static double want[NUMBERS], in_vertex[SCENE_VERTICES][3];
    double scale = 1e-3;
    set_numbers(s, light, &n);
    for (int k = 0; k < NUMBERS; k++)
        want[k] = difference(s, &n, &n.row[k], 1e-3L * size), scale = fmax(scale, fabs(want[k]));
    for (uint32_t i = 0; i < s->nvertices; i++)
        for (int a = 0; a < 3; a++)
            in_vertex[i][a] = difference(s, &n, &n.at[i][a], 1e-3L * size), scale = fmax(scale, fabs(in_vertex[i][a]));
    for (LightWay way = LIGHT_SILHOUETTES; way <= LIGHT_TRIANGLES; way++) {
        ask(s, light, true, way, &now);
        for (uint32_t k = 0; k < NUMBERS; k++)
            assert_near(now.row[k], want[k], most * scale, "a derivative in a number", 100 * round + k);
        for (uint32_t i = 0; i < s->nvertices; i++)
            for (int a = 0; a < 3; a++)
                assert_near(now.vertex[i][a], in_vertex[i][a], most * scale, "a derivative in a vertex",
                            100 * round + i);
    }
}

static void test_differences(void **state) {
    (void)state;
    uint64_t seed = 23;
    static Scene s;
    for (uint32_t round = 0; round < 12; round++) {
        set_scene(&s, round, 3 + round, &seed);
        assert_differences(&s, some_light(&seed), 1e-3, 1e-8, round);
    }
    scene_ball_and_plate(&s);
    assert_differences(&s, light_at(0.7, 0.9, 2.5), 1e-3, 1e-8, 1000);
}

/* A crumpled sheet. */
static void sheet(Scene *s, uint64_t *seed) {
    enum { SIDE = 4 };
    *s = (Scene){0};
    for (int i = 0; i < SIDE * SIDE; i++) {
        double at[3] = {(double)(i % SIDE) - 1.5, (double)(i / SIDE) - 1.5, 0};
        for (int a = 0; a < 3; a++) at[a] += 0.5 * (scene_uniform(seed) - 0.5) * (1 + a);
        scene_vertex(s, at[0], at[1], at[2]);
    }
    for (int32_t i = 0; i < SIDE - 1; i++)
        for (int32_t j = 0; j < SIDE - 1; j++) {
            const int32_t a = i * SIDE + j, b = a + SIDE;
            scene_face(s, a, a + 1, b + 1), scene_face(s, a, b + 1, b);
        }
}

/* Around a vertex. */
static void look_at(Scene *s, const double at[3], double size) {
    const double beam[SLT_BEAM_ROWS] = {
        0.3, -0.2,         3,    at[0] - 0.47 * size, at[1] - 0.52 * size, at[2], size, 0.1 * size,
        0,   -0.05 * size, size, 0.2 * size};
    memcpy(s->beam, beam, sizeof beam);
}

static void test_sheets(void **state) {
    (void)state;
    uint64_t seed = 27;
    static Scene s;
    static Answer now;
    double hidden = 0;
    for (uint32_t round = 0; round < 6; round++) {
        const double size = round % 2 ? 2e-5 : 0.7;
        sheet(&s, &seed);
        look_at(&s, s.at[round % 4 < 2 ? 5 : 10], size);
        ask(&s, light_at(2.1, 1.2, 0.8), true, LIGHT_BY_COUNTS, &now);
        hidden += now.all_seen - now.all_lit;
        assert_differences(&s, (const double[]){2.1, 1.2, 0.8}, size, 1e-8, round);
    }
    assert_true(hidden > 0.5 && hidden < 5.5);
}

/* Neighbours rise before pieces and hide up to their sides, where rounding must not cut slivers off: of what is wholly
 * lit, in tiny windows, any light gives the same derivatives. */
static void test_neighbours(void **state) {
    (void)state;
    uint64_t seed = 28;
    static Scene s;
    static Answer one, other;
    uint32_t lit = 0;
    for (uint32_t round = 0; round < 400; round++) {
        double scale = 0;
        sheet(&s, &seed);
        look_at(&s, s.at[round % 2 ? 5 : 10], round % 4 < 2 ? 2e-4 : 2e-2);
        const LightWay way = round % 3 ? LIGHT_TRIANGLES : LIGHT_SILHOUETTES;
        ask(&s, light_at(0.3, 0.2, 5), true, way, &one);
        ask(&s, light_at(-0.4, 0.1, 6), true, way, &other);
        if (one.all_lit < 1 - 1e-9 || other.all_lit < 1 - 1e-9) continue;
        lit++;
        for (uint32_t i = 0; i < s.nvertices; i++)
            for (int a = 0; a < 3; a++) scale = fmax(scale, fabs(one.vertex[i][a]));
        for (uint32_t k = 0; k < NUMBERS; k++)
            assert_near(one.row[k], other.row[k], 1e-8 * scale, "a derivative in a number", 100 * round + k);
        for (uint32_t i = 0; i < s.nvertices; i++)
            for (int a = 0; a < 3; a++)
                assert_near(one.vertex[i][a], other.vertex[i][a], 1e-8 * scale, "a derivative in a vertex",
                            100 * round + i);
    }
    assert_true(lit > 200);
}

/* A shadow's side that leaves its edge where the next one begins. */
static void test_subdivided(void **state) {
    (void)state;
    static Scene level[3];
    static int32_t between[2][SCENE_VERTICES][2];
    static Answer want, got;
    const double light[3] = {0.7, 0.9, 2.5};
    scene_ball_and_plate(&level[0]);
    for (int k = 1; k < 3; k++) {
        scene_subdivide(&level[k - 1], &level[k], between[k - 1]);
        for (LightWay way = LIGHT_SILHOUETTES; way <= LIGHT_TRIANGLES; way++) {
            double scale = 0;
            parts_of_a_face = 1;
            ask(&level[0], light, true, way, &want);
            parts_of_a_face = k == 1 ? 4 : 16;
            ask(&level[k], light, true, way, &got);
            parts_of_a_face = 1;
            assert_near(got.all_lit, want.all_lit, 1e-11, "what is lit", 10 * (uint32_t)k + way);
            /* Back to the vertices that those of the finer mesh are made from. */
            for (int fine = k; fine > 0; fine--)
                for (uint32_t v = level[fine].nvertices; v-- > level[fine - 1].nvertices;)
                    for (int a = 0; a < 3; a++) {
                        const int32_t *of = between[fine - 1][v - level[fine - 1].nvertices];
                        for (int i = 0; i < 2; i++) got.vertex[of[i]][a] += 0.5 * got.vertex[v][a];
                    }
            for (int i = 0; i < NUMBERS; i++) scale = fmax(scale, fabs(want.row[i]));
            for (uint32_t i = 0; i < NUMBERS; i++)
                assert_near(got.row[i], want.row[i], 1e-6 * scale, "a derivative in a number", i);
            for (uint32_t i = 0; i < level[0].nvertices; i++)
                for (int a = 0; a < 3; a++)
                    assert_near(got.vertex[i][a], want.vertex[i][a], 1e-6 * scale, "a derivative in a vertex", i);
        }
    }
}

/* More edges than are looked at in one window, more triangles than are asked one by one. */
static void test_many(void **state) {
    (void)state;
    uint64_t seed = 26;
    static Scene s;
    static Answer one, other, narrow;
    for (uint32_t round = 0; round < 6; round++) {
        floor_scene(&s);
        scene_soup(&s, 130, round % 2 ? 0.3 : 1.2, &seed);
        for (uint32_t i = 4; i < s.nvertices; i++) {
            s.at[i][2] += 1.5;
            for (int a = 0; a < 3; a++) s.at[i][a] = (double)(s.f32[i][a] = (float)s.at[i][a]);
        }
        for (int k = 0; k < SLT_BEAM_ROWS; k++) s.beam[k] = (double)(float)s.beam[k];
        ask(&s, light_at(0.25, 0.5, 5), true, LIGHT_SILHOUETTES, &one);
        ask(&s, light_at(0.25, 0.5, 5), true, LIGHT_TRIANGLES, &other);
        ask(&s, light_at(0.25, 0.5, 5), false, LIGHT_SILHOUETTES, &narrow);
        double scale = 0;
        for (int k = 0; k < NUMBERS; k++) scale = fmax(scale, fabs(one.row[k]));
        assert_near(one.all_lit, other.all_lit, 1e-11, "what is lit", round);
        assert_near(one.all_lit, narrow.all_lit, 1e-5, "what is lit in f32", round);
        for (uint32_t k = 0; k < NUMBERS; k++) {
            assert_near(one.row[k], other.row[k], 1e-9 * scale, "a derivative", k);
            assert_near(one.row[k], narrow.row[k], 1e-4 * scale, "a derivative in f32", k);
        }
    }
}

/* ---- what is not there */

static void test_nothing(void **state) {
    (void)state;
    uint64_t seed = 24;
    static Scene s;
    static Answer now;
    set_scene(&s, 0, 9, &seed);
    ask(&s, light_at(NAN, 0, 0), true, LIGHT_BY_COUNTS, &now);
}

static void test_single(void **state) {
    (void)state;
    uint64_t seed = 25;
    static Scene s;
    static Answer wide, narrow;
    for (uint32_t round = 0; round < 20; round++) {
        set_scene(&s, round, 4 + round, &seed);
        for (uint32_t i = 0; i < s.nvertices; i++)
            for (int a = 0; a < 3; a++) s.at[i][a] = (double)s.f32[i][a];
        double light[3], scale = 0;
        const double *at = some_light(&seed);
        for (int a = 0; a < 3; a++) light[a] = (double)(float)at[a];
        ask(&s, light, true, LIGHT_BY_COUNTS, &wide);
        ask(&s, light, false, LIGHT_BY_COUNTS, &narrow);
        for (uint32_t f = 0; f < s.nfaces; f++)
            assert_near(wide.lit[f], narrow.lit[f], 1e-5, "what is lit", 100 * round + f);
        for (int k = 0; k < NUMBERS; k++) scale = fmax(scale, fabs(wide.row[k]));
        for (uint32_t k = 0; k < NUMBERS; k++)
            assert_near(wide.row[k], narrow.row[k], 1e-4 * scale, "a derivative", 100 * round + k);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_closed_forms), cmocka_unit_test(test_reference),
                                       cmocka_unit_test(test_degenerate),   cmocka_unit_test(test_differences),
                                       cmocka_unit_test(test_subdivided),   cmocka_unit_test(test_many),
                                       cmocka_unit_test(test_sheets),       cmocka_unit_test(test_neighbours),
                                       cmocka_unit_test(test_nothing),      cmocka_unit_test(test_single)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
