/* What is seen of meshes through windows: it fills the window, is what a reference in long double sees, and hangs on no
 * order of faces and no instruction set; degenerate windows by the thousand, by the million with SALTUS_PIECES_WINDOWS.
 * SALTUS_PIECES_FAR=1 prints errors of far eyes. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/resource.h>

#include <cmocka.h>

#include "runtime/geometry/mesh/trimesh.h"
#include "tests/trimesh/scene.h"

/* What the pieces of each face sum to. */
typedef struct Seen {
    double face[SCENE_FACES][3]; /* area, moments of s and t */
    double area, depth;          /* of all; depth: the integral of 1 / t */
    uint32_t pieces;
} Seen;

/* NULL: not on this machine. */
static SltGeometry *made_for(const Scene *s, bool f64, TrimeshIsa isa) {
    SltGeometry *g;
    SltError err;
    const GeometrySource from = {.kind = SLT_GEOMETRY_MESH,
                                 .f64 = f64,
                                 .nvertices = s->nvertices,
                                 .nfaces = s->nfaces,
                                 .faces = &s->face[0][0],
                                 .queries = 1u << SLT_QUERY_PIECES};
    return trimesh_make(&g, &from, f64 ? (const void *)s->at : s->f32, isa, &err) == SLT_OK ? g : NULL;
}

static SltGeometry *made(const Scene *s, bool f64) {
    SltGeometry *g = made_for(s, f64, TRIMESH_ISA_BEST);
    assert_non_null(g);
    return g;
}

static double told(const SltGeometry *g, bool f64, int32_t unit, uint32_t which) {
    const size_t at = (size_t)unit * SLT_TOLD + which;
    return f64 ? ((const double *)g->told())[at] : (double)((const float *)g->told())[at];
}

static int32_t told_int(const SltGeometry *g, bool f64, int32_t unit, uint32_t which) {
    int32_t v;
    memcpy(&v, (const char *)g->told() + ((size_t)unit * SLT_TOLD + which) * (f64 ? sizeof(double) : sizeof(float)),
           sizeof v);
    return v;
}

static int32_t first_piece(const SltGeometry *g, const Scene *s, bool f64) {
    float narrow[SLT_BEAM_ROWS];
    int32_t unit;
    for (int k = 0; k < SLT_BEAM_ROWS; k++) narrow[k] = (float)s->beam[k];
    g->query[SLT_QUERY_BEGIN](g, NULL, NULL, 1, 1, &unit);
    g->query[SLT_QUERY_PIECES](g, f64 ? (const void *)s->at : s->f32, f64 ? (const void *)s->beam : narrow, 1, 1,
                               &unit);
    return unit;
}

/* What is told from a unit on. */
static void add_up(const SltGeometry *g, const Scene *s, bool f64, int32_t unit, Seen *out) {
    memset(out, 0, sizeof *out);
    for (; unit; unit = told_int(g, f64, unit, SLT_PIECE_NEXT)) {
        const uint32_t face = (uint32_t)told_int(g, f64, unit, SLT_PIECE_TRIANGLE);
        const double area = told(g, f64, unit, SLT_PIECE_AREA),
                     at[2] = {told(g, f64, unit, SLT_PIECE_S), told(g, f64, unit, SLT_PIECE_T)};
        assert_true(face < s->nfaces && area > 0);
        for (int k = 0; k < 2; k++) assert_true(at[k] >= -1e-9 && at[k] <= 1 + 1e-9);
        const Shape shape = shape_of(s, face);
        out->face[face][0] += area, out->face[face][1] += area * at[0], out->face[face][2] += area * at[1];
        out->area += area, out->depth += area * (double)part_at(shape.depth, at[0], at[1]);
        out->pieces++;
    }
}

static void see_through(const SltGeometry *g, const Scene *s, bool f64, Seen *out) {
    add_up(g, s, f64, first_piece(g, s, f64), out);
}

static void see(const Scene *s, bool f64, Seen *out) {
    SltGeometry *g = made(s, f64);
    see_through(g, s, f64, out);
    geometry_free(g);
}

/* ---- scenes */

static void set_window(Scene *s, const double eye[3], const double corner[3], const double u[3], const double v[3]) {
    const double *row[] = {eye, corner, u, v};
    for (int k = 0; k < SLT_BEAM_ROWS; k++) s->beam[k] = row[k / 3][k % 3];
}

static void plain_window(Scene *s) {
    set_window(s, (const double[]){0.1, 0.2, 3}, (const double[]){-1, -1, 1}, (const double[]){2, 0.1, 0},
               (const double[]){0, 2, 0.2});
}

/* Far behind everything, larger than any window, whichever way it looks along z. */
static void add_background(Scene *s) {
    for (int z = -50; z <= 50; z += 100) {
        int32_t a = scene_vertex(s, -400, -300, z), b = scene_vertex(s, 500, -350, z), c = scene_vertex(s, 20, 600, z);
        scene_face(s, a, b, c);
    }
}

/* Vertices on a grid with few depths, faces over any three of them, some twice; the window's borders run through them,
 * and now and then the eye is between them or on one. */
static void degenerate(Scene *s, uint64_t *state) {
    enum { GRID = 4, DEPTHS = 3 };
    *s = (Scene){0};
    for (int z = 0; z < DEPTHS; z++)
        for (int y = 0; y <= GRID; y++)
            for (int x = 0; x <= GRID; x++)
                scene_vertex(s, (double)x / GRID * (z + 2), (double)y / GRID * (z + 2), (double)-z);
    const uint32_t n = 2 + (uint32_t)(scene_uniform(state) * 12);
    for (uint32_t i = 0; i < n; i++) {
        int32_t v[3];
        for (int k = 0; k < 3; k++) v[k] = (int32_t)(scene_uniform(state) * s->nvertices);
        if (i && scene_uniform(state) < 0.1) memcpy(v, s->face[i - 1], sizeof v);
        scene_face(s, v[0], v[i % 2 ? 1 : 2], v[i % 2 ? 2 : 1]);
    }
    const double kind = scene_uniform(state), corner = (int)(scene_uniform(state) * 4) / 4.0,
                 size = kind < 0.5 ? 0.25 : 1;
    set_window(s, (const double[]){kind < 0.2 ? 0.5 : 0, kind < 0.2 ? 0.5 : 0, kind < 0.1 ? -0.5 : 2},
               (const double[]){corner, corner, 0}, (const double[]){kind < 0.9 ? size : -size, 0, 0},
               (const double[]){0, size, 0});
}

/* ---- tests */

static void assert_near(double a, double b, double most, const char *what, uint32_t i) {
    if (fabs(a - b) <= most) return;
    fail_msg("%s of %u: %.17g and %.17g, apart by %g", what, i, a, b, fabs(a - b));
}

static void assert_reference(const Scene *s, bool f64, double most) {
    Seen now;
    see(s, f64, &now);
    for (uint32_t f = 0; f < s->nfaces; f++) {
        long double want[3];
        if (!scene_seen(s, f, want)) fail_msg("the reference has too many parts");
        for (int k = 0; k < 3; k++) assert_near(now.face[f][k], (double)want[k], most, "a moment", f);
    }
}

static void test_fills_the_window(void **state) {
    (void)state;
    uint64_t seed = 1;
    static Seen now;
    for (uint32_t round = 0; round < 60; round++) {
        static Scene s;
        s = (Scene){0};
        scene_soup(&s, 1 + 2 * round, round % 2 ? 2.5 : 0.5, &seed);
        add_background(&s);
        plain_window(&s);
        see(&s, true, &now);
        assert_near(now.area, 1, 1e-10, "the area", round);
        see(&s, false, &now);
        assert_near(now.area, 1, 1e-5, "the area in f32", round);
    }
}

static void test_reference(void **state) {
    (void)state;
    uint64_t seed = 2;
    for (uint32_t round = 0; round < 30; round++) {
        static Scene s;
        s = (Scene){0};
        scene_soup(&s, 1 + round, 1.7, &seed);
        plain_window(&s);
        if (round % 5 == 1) s.beam[SLT_BEAM_EYE + 2] = 0; /* inside */
        if (round % 5 == 2)
            for (int a = 0; a < 3; a++) s.beam[SLT_BEAM_U + a] = -s.beam[SLT_BEAM_U + a]; /* mirrored, beside */
        if (round % 5 == 3) s.beam[SLT_BEAM_CORNER] = 1, s.beam[SLT_BEAM_U] = -2;         /* mirrored */
        assert_reference(&s, true, 1e-11);
    }
}

/* Two wavy sheets, one behind the other or through it, through small windows: one sheet across a window, a border of
 * it, the corners of faces; mirrored too. */
static void sheets(Scene *s, uint64_t *state) {
    enum { SIDE = 5 };
    const double apart = scene_uniform(state) < 0.3 ? 0.1 : 1, size = scene_uniform(state) < 0.5 ? 0.1 : 0.7;
    *s = (Scene){0};
    for (int32_t layer = 0; layer < 2; layer++) {
        const int32_t first = (int32_t)s->nvertices;
        for (int i = 0; i <= SIDE; i++)
            for (int j = 0; j <= SIDE; j++)
                scene_vertex(s, 2.0 * i / SIDE - 1 + 0.2 * scene_uniform(state),
                             2.0 * j / SIDE - 1 + 0.2 * scene_uniform(state),
                             0.3 * scene_uniform(state) - apart * layer);
        for (int32_t i = 0; i < SIDE; i++)
            for (int32_t j = 0; j < SIDE; j++) {
                const int32_t a = first + i * (SIDE + 1) + j, b = a + SIDE + 1;
                scene_face(s, a, layer ? a + 1 : b, b + 1); /* the other way round behind */
                scene_face(s, a, b + 1, layer ? b : a + 1);
            }
    }
    const double mirrored = scene_uniform(state) < 0.3 ? -size : size, x = 1.8 * scene_uniform(state) - 0.9,
                 y = 1.8 * scene_uniform(state) - 0.9;
    set_window(s, (const double[]){scene_uniform(state), -scene_uniform(state), 4}, (const double[]){x, y, 0.2},
               (const double[]){mirrored, 0.1 * size, 0.05}, (const double[]){-0.2 * size, size, 0});
}

static void test_sheets(void **state) {
    (void)state;
    uint64_t seed = 11;
    static Scene s;
    for (uint32_t round = 0; round < 60; round++) {
        sheets(&s, &seed);
        assert_reference(&s, true, 1e-11);
    }
}

/* A closed body, a box in front of a plate, triangles that cross. */
static void far_scene(Scene *s, uint32_t kind, uint64_t *state) {
    static const int32_t tetrahedron[4][3] = {{0, 1, 2}, {0, 3, 1}, {1, 3, 2}, {2, 3, 0}};
    *s = (Scene){0};
    if (kind == 0) {
        for (int k = 0; k < 4; k++)
            scene_vertex(s, 1.6 * scene_uniform(state) - 0.8, 1.6 * scene_uniform(state) - 0.8,
                         1.6 * scene_uniform(state) - 0.8);
        for (int f = 0; f < 4; f++) scene_face(s, tetrahedron[f][0], tetrahedron[f][1], tetrahedron[f][2]);
    } else if (kind == 1) {
        for (int k = 0; k < 8; k++) scene_vertex(s, k & 1 ? 0.31 : -0.29, k & 2 ? 0.33 : -0.27, k & 4 ? 0.3 : -0.3);
        for (int a = 0; a < 3; a++)
            for (int side = 0; side < 2; side++) {
                const int32_t b = 1 << (a + 1) % 3, c = 1 << (a + 2) % 3, at = side << a;
                scene_face(s, at, at + b, at + b + c), scene_face(s, at, at + b + c, at + c);
            }
        const int32_t a = scene_vertex(s, -3, -2, 0.8), b = scene_vertex(s, 3, -2.5, 0.8),
                      c = scene_vertex(s, 0.2, 4, 0.8);
        scene_face(s, a, b, c);
    } else {
        scene_soup(s, 12, 1.7, state);
    }
    for (uint32_t i = 0; i < s->nvertices; i++)
        for (int a = 0; a < 3; a++) s->at[i][a] = (double)s->f32[i][a];
}

/* Against the reference, of an eye `far` away; near: the window is a step before the eye and not where the mesh is. */
static double far_error(double far, bool near, bool f64) {
    static Scene s;
    static Seen now;
    uint64_t seed = 8;
    double most = 0;
    for (uint32_t round = 0; round < 30; round++) {
        far_scene(&s, round % 3, &seed);
        double eye[3] = {0.3 * far, -0.2 * far, -far}, corner[3] = {-1, -1, -0.5}, u[3] = {2, 0.1, 0},
               v[3] = {0, 2, 0.2};
        if (round % 2) eye[0] = (1 - 2 * scene_uniform(&seed)) * far, eye[1] = (1 - 2 * scene_uniform(&seed)) * far;
        for (int a = 0; a < 3; a++) {
            if (near) u[a] /= far, v[a] /= far, corner[a] = eye[a] + (corner[a] - eye[a]) / far;
            if (!f64) eye[a] = (float)eye[a], corner[a] = (float)corner[a], u[a] = (float)u[a], v[a] = (float)v[a];
        }
        set_window(&s, eye, corner, u, v);
        see(&s, f64, &now);
        for (uint32_t f = 0; f < s.nfaces; f++) {
            long double want[3];
            if (!scene_seen(&s, f, want)) fail_msg("the reference has too many parts");
            for (int k = 0; k < 3; k++) most = fmax(most, fabs(now.face[f][k] - (double)want[k]));
        }
    }
    return most;
}

static void test_far_eye(void **state) {
    (void)state;
    const bool print = getenv("SALTUS_PIECES_FAR") != NULL;
    for (int k = 1; k <= 12; k++) {
        const double far = pow(10, k);
        double error[3];
        for (int how = 0; how < 3; how++) error[how] = k > 8 && how == 1 ? 0 : far_error(far, how == 1, how != 2);
        if (print) printf("1e%d: %.2g, window at the eye %.2g, f32 %.2g\n", k, error[0], error[1], error[2]);
        if (print) continue;
        assert_near(error[0], 0, 1e-11 + 16 * far * 0x1p-53, "the window at the mesh", (uint32_t)k);
        assert_near(error[1], 0, 1e-11 + 16 * far * 0x1p-53, "the window at the eye", (uint32_t)k);
        assert_near(error[2], 0, 4e-6, "f32", (uint32_t)k);
    }
}

static void test_any_order(void **state) {
    (void)state;
    uint64_t seed = 3;
    static Scene s, turned;
    static Seen one, other;
    for (uint32_t round = 0; round < 40; round++) {
        s = (Scene){0};
        scene_soup(&s, 150, round % 2 ? 1.5 : 0.4, &seed);
        add_background(&s);
        plain_window(&s);
        turned = s;
        for (uint32_t f = 0; f < s.nfaces; f++) memcpy(turned.face[s.nfaces - 1 - f], s.face[f], sizeof s.face[0]);
        see(&s, true, &one);
        see(&turned, true, &other);
        for (uint32_t f = 0; f < s.nfaces; f++)
            for (int k = 0; k < 3; k++)
                assert_near(one.face[f][k], other.face[s.nfaces - 1 - f][k], 1e-11, "a moment", f);
    }
}

/* Of coplanar faces another is seen in another order, at the same depth. */
static void test_degenerate(void **state) {
    (void)state;
    uint64_t seed = 4;
    const char *wanted = getenv("SALTUS_PIECES_WINDOWS");
    const uint32_t windows = wanted ? (uint32_t)strtoul(wanted, NULL, 10) : 40000;
    static Scene s;
    static Seen one, other;
    for (uint32_t round = 0; round < windows; round++) {
        degenerate(&s, &seed);
        add_background(&s);
        see(&s, true, &one);
        for (uint32_t f = 0; f < s.nfaces / 2; f++) {
            int32_t face[3];
            memcpy(face, s.face[f], sizeof face);
            memcpy(s.face[f], s.face[s.nfaces - 1 - f], sizeof face);
            memcpy(s.face[s.nfaces - 1 - f], face, sizeof face);
        }
        see(&s, true, &other);
        assert_near(one.area, 1, 1e-10, "the area", round);
        assert_near(other.area, 1, 1e-10, "the area", round);
        assert_near(one.depth, other.depth, 1e-10 * (1 + fabs(one.depth)), "the depth", round);
    }
}

/* Two boxes behind another, a wall of many small faces: more than are looked at in one window. */
static void test_same_bits(void **state) {
    (void)state;
    uint64_t seed = 7;
    static Scene s;
    static Seen plain, now;
    for (uint32_t round = 0; round < 400; round++) {
        s = (Scene){0};
        if (round % 8 > 4) {
            sheets(&s, &seed);
        } else if (round % 8) {
            degenerate(&s, &seed);
        } else {
            scene_soup(&s, 1 + round / 4, round % 16 ? 1.5 : 0.4, &seed);
            plain_window(&s);
        }
        for (TrimeshIsa isa = TRIMESH_ISA_PLAIN; isa < TRIMESH_ISAS; isa++) {
            SltGeometry *g = made_for(&s, round % 2, isa);
            if (!g) continue;
            Seen *to = isa == TRIMESH_ISA_PLAIN ? &plain : &now;
            memset(to, 0, sizeof *to);
            see_through(g, &s, round % 2, to);
            geometry_free(g);
            assert_memory_equal(to, &plain, sizeof plain);
        }
    }
}

enum { ACROSS = 8, BLOCK = 32, BLOCKS = 6, WINDOWS = BLOCK * BLOCKS };

/* Windows side by side, a block of them a call, from left to right or upwards, or back. */
static void see_blocks(const SltGeometry *g, const Scene *s, bool f64, bool upwards, bool back, Scene *window,
                       Seen *out) {
    static double row[SLT_BEAM_ROWS][BLOCK];
    static float narrow[SLT_BEAM_ROWS][BLOCK];
    int32_t witness[BLOCK];
    for (uint32_t i = 0; i < BLOCKS; i++) {
        const uint32_t block = back ? BLOCKS - 1 - i : i;
        for (uint32_t k = 0; k < BLOCK; k++) {
            const double x = k % ACROSS + (upwards ? 0 : ACROSS * block),
                         y = k / ACROSS + (upwards ? BLOCK / ACROSS * block : 0);
            double *beam = window[BLOCK * block + k].beam;
            memcpy(beam, s->beam, sizeof s->beam);
            for (int a = 0; a < 3; a++)
                beam[SLT_BEAM_CORNER + a] += x * beam[SLT_BEAM_U + a] + y * beam[SLT_BEAM_V + a];
            for (int r = 0; r < SLT_BEAM_ROWS; r++) row[r][k] = beam[r], narrow[r][k] = (float)beam[r];
        }
        g->query[SLT_QUERY_BEGIN](g, NULL, NULL, 1, BLOCK, witness);
        g->query[SLT_QUERY_PIECES](g, f64 ? (const void *)s->at : s->f32, f64 ? (const void *)row : narrow, UINT32_MAX,
                                   BLOCK, witness);
        for (uint32_t k = 0; k < BLOCK; k++) add_up(g, s, f64, witness[k], &out[BLOCK * block + k]);
    }
}

/* What a window sees hangs on it alone, not on those beside it nor on what was asked before. */
static void test_side_by_side(void **state) {
    (void)state;
    uint64_t seed = 11;
    static Scene s, window[WINDOWS];
    static Seen together[WINDOWS], alone;
    uint32_t pieces = 0;
    for (uint32_t round = 0; round < 40; round++) {
        const bool f64 = round % 2, upwards = round % 4 > 1;
        if (round % 3) {
            sheets(&s, &seed);
        } else {
            s = (Scene){0};
            scene_soup(&s, 100, 0.5, &seed);
            plain_window(&s);
        }
        for (int k = SLT_BEAM_U; k < SLT_BEAM_ROWS; k++) s.beam[k] *= 0.07;
        SltGeometry *g = made(&s, f64);
        for (int moved = 0; moved < 2; moved++) {
            see_blocks(g, &s, f64, upwards, moved, window, together);
            for (uint32_t k = 0; k < WINDOWS; k += 1 + (k + round) % 3) {
                SltGeometry *other = made(&s, f64);
                memcpy(s.beam, window[k].beam, sizeof s.beam);
                see_through(other, &s, f64, &alone);
                geometry_free(other);
                together[k].depth = alone.depth = 0; /* that is measured in s.beam */
                assert_memory_equal(&together[k], &alone, sizeof alone);
                pieces += alone.pieces;
            }
            memcpy(s.beam, window[0].beam, sizeof s.beam);
            /* The windows that were looked through last once more, when the vertices are elsewhere. */
            see_blocks(g, &s, f64, upwards, false, window, together);
            for (uint32_t i = 0; i < s.nvertices; i++)
                for (int a = 0; a < 3; a++) s.at[i][a] *= 0.9, s.f32[i][a] = (float)s.at[i][a];
            geometry_changed(g, 0, 3 * (uint64_t)s.nvertices);
            (void)geometry_follow(g, f64 ? (const void *)s.at : s.f32);
        }
        geometry_free(g);
    }
    assert_true(pieces > 5000);
}

/* Over a mesh from where there is none, and away from it: what is known to be empty ends where the mesh begins. Windows
 * that are the last to see nothing touch it nearly. */
static void test_from_nothing(void **state) {
    (void)state;
    static Scene s, window[WINDOWS];
    static Seen together[WINDOWS], alone;
    uint32_t pieces = 0, empty = 0;
    for (uint32_t round = 0; round < 16; round++) {
        const bool f64 = round % 2, upwards = round / 2 % 2, back = round / 4 % 2;
        scene_ball_and_plate(&s);
        const double size = round < 8 ? 0.07 : 0.011,
                     before = 0.5 * BLOCKS * (upwards ? BLOCK / ACROSS : ACROSS) + 0.1 * round, beside = 0.45 / size;
        for (int k = SLT_BEAM_U; k < SLT_BEAM_ROWS; k++) s.beam[k] *= size;
        for (int a = 0; a < 3; a++) {
            const double u = s.beam[SLT_BEAM_U + a], v = s.beam[SLT_BEAM_V + a];
            s.beam[SLT_BEAM_CORNER + a] += upwards ? beside * u - before * v : beside * v - before * u;
        }
        SltGeometry *g = made(&s, f64);
        see_blocks(g, &s, f64, upwards, back, window, together);
        see_blocks(g, &s, f64, upwards, !back, window, together);
        for (uint32_t k = 0; k < WINDOWS; k++) {
            SltGeometry *other = made(&s, f64);
            memcpy(s.beam, window[k].beam, sizeof s.beam);
            see_through(other, &s, f64, &alone);
            geometry_free(other);
            together[k].depth = alone.depth = 0;
            assert_memory_equal(&together[k], &alone, sizeof alone);
            pieces += alone.pieces, empty += !alone.pieces;
        }
        geometry_free(g);
    }
    assert_true(pieces > 300 && empty > 300);
}

static void test_many(void **state) {
    (void)state;
    static Scene s;
    static Seen now;
    s = (Scene){0};
    enum { SIDE = 15 };
    for (int i = 0; i <= SIDE; i++)
        for (int j = 0; j <= SIDE; j++) scene_vertex(&s, 4.0 * i / SIDE - 2, 4.0 * j / SIDE - 2, 0.3 * sin(i + 2 * j));
    for (int32_t i = 0; i < SIDE; i++)
        for (int32_t j = 0; j < SIDE; j++) {
            const int32_t a = i * (SIDE + 1) + j, b = a + SIDE + 1;
            scene_face(&s, a, b, b + 1), scene_face(&s, a, b + 1, a + 1);
        }
    plain_window(&s);
    see(&s, true, &now);
    assert_near(now.area, 1, 1e-10, "the area", 0);
    assert_reference(&s, true, 1e-11);
}

/* Windows and meshes of which nothing is seen. */
static void test_nothing(void **state) {
    (void)state;
    static Scene s;
    static Seen now;
    uint64_t seed = 5;
    scene_soup(&s, 20, 1, &seed);
    plain_window(&s);
    const Scene whole = s;
    for (int broken = 0; broken < 6; broken++) {
        s = whole;
        if (broken == 0) s.beam[SLT_BEAM_U] = NAN;
        if (broken == 1) s.beam[SLT_BEAM_EYE + 1] = HUGE_VAL;
        if (broken == 2) memset(s.beam + SLT_BEAM_V, 0, 3 * sizeof *s.beam); /* the window is a line */
        if (broken == 3)
            for (int a = 0; a < 3; a++) s.beam[SLT_BEAM_EYE + a] = s.beam[SLT_BEAM_CORNER + a]; /* seen edge-on */
        if (broken == 4) s.beam[SLT_BEAM_CORNER + 2] = 5;                                       /* looks away */
        if (broken == 5)
            for (uint32_t i = 0; i < s.nvertices; i++) s.at[i][i % 3] = i % 2 ? NAN : HUGE_VAL;
        see(&s, true, &now);
        assert_int_equal(now.pieces, 0);
    }
    s = whole;
    s.at[s.face[0][1]][0] = NAN; /* the others are seen */
    see(&s, true, &now);
    assert_true(now.pieces > 0 && now.face[0][0] == 0);
}

/* Queries do not fail; what there was no memory for is known afterwards. */
static void test_no_memory(void **state) {
    (void)state;
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    static Scene s;
    struct rlimit was, now;
    bool lost = false;
    uint64_t seed = 6;
    scene_soup(&s, 100, 1, &seed);
    plain_window(&s);
    SltGeometry *g = made(&s, true);
    (void)first_piece(g, &s, true);
    assert_false(geometry_lost(g));
    assert_int_equal(getrlimit(RLIMIT_AS, &was), 0);
    now = was, now.rlim_cur = 1;
    assert_int_equal(setrlimit(RLIMIT_AS, &now), 0);
    for (uint32_t i = 0; i < 200000 && !lost; i++) {
        int32_t unit;
        g->query[SLT_QUERY_PIECES](g, s.at, s.beam, 1, 1, &unit); /* nothing is forgotten in between */
        lost = geometry_lost(g);
    }
    assert_int_equal(setrlimit(RLIMIT_AS, &was), 0);
    assert_true(lost);
    static Seen after;
    see_through(g, &s, true, &after);
    assert_false(geometry_lost(g));
    assert_true(after.pieces > 50);
    geometry_free(g);
#endif
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_fills_the_window), cmocka_unit_test(test_reference),
                                       cmocka_unit_test(test_sheets),           cmocka_unit_test(test_far_eye),
                                       cmocka_unit_test(test_any_order),        cmocka_unit_test(test_degenerate),
                                       cmocka_unit_test(test_same_bits),        cmocka_unit_test(test_side_by_side),
                                       cmocka_unit_test(test_from_nothing),     cmocka_unit_test(test_many),
                                       cmocka_unit_test(test_nothing),          cmocka_unit_test(test_no_memory)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
