/* Light past meshes in all ways of searching, which must agree: how silhouettes cross, pieces, triangle by triangle;
 * and with every instruction set, to the bit. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "light_answer.h"

static double between(uint64_t *seed, double low, double high) { return low + (high - low) * lit_uniform(seed); }

static void some_blob(LitScene *s, uint64_t *seed, double x, double y, double z, double rough) {
    double o[3] = {x, y, z};
    for (int a = 0; a < 2; a++) o[a] += between(seed, -0.4, 0.4);
    o[2] += between(seed, -0.1, 0.1);
    const uint32_t rings = 3 + (uint32_t)between(seed, 0, 8), columns = 4 + (uint32_t)between(seed, 0, 12);
    lit_blob(s, o, between(seed, 0.05, 0.3), rings, columns, rough);
}

/* Moves the receiver onto a face, whose normal is its. */
static void stand_on(LitScene *s, uint64_t *seed) {
    const int32_t *face = s->face[(uint32_t)between(seed, 0, s->nfaces)];
    double w[3] = {lit_uniform(seed), lit_uniform(seed), 0}, p[3] = {0}, e[2][3], n[3];
    for (int k = 0; k < 2 && w[0] + w[1] > 1; k++) w[k] = 1 - w[k];
    w[2] = 1 - w[0] - w[1];
    for (int a = 0; a < 3; a++) {
        for (int k = 0; k < 3; k++) p[a] += w[k] * s->at[face[k]][a];
        for (int k = 0; k < 2; k++) e[k][a] = s->at[face[k + 1]][a] - s->at[face[0]][a];
    }
    for (int a = 0; a < 3; a++) {
        const int b = (a + 1) % 3, c = (a + 2) % 3;
        n[a] = e[0][b] * e[1][c] - e[0][c] * e[1][b];
    }
    unit_length(n);
    put(s, SLT_LIGHT_P, p[0], p[1], p[2]), put(s, SLT_LIGHT_N, n[0], n[1], n[2]);
}

enum { KINDS = 9 };
static void some_mesh(LitScene *s, int kind, uint64_t *seed) {
    const double *p = s->row + SLT_LIGHT_P;
    switch (kind) {
    case 0: some_blob(s, seed, 0, 0, 0.5, 0); break;
    case 1: /* crumpled, in front of each other */
        for (int k = 0; k < 3; k++) some_blob(s, seed, 0, 0, 0.3 + 0.2 * k, 1);
        break;
    case 2: lit_soup(s, 1 + (uint32_t)between(seed, 0, 20), between(seed, 0.1, 1.1), *seed); break;
    case 3: /* a sheet, flat or not */
        lit_square(s, (double[3]){between(seed, -0.7, 0.3), between(seed, -0.7, 0.3), between(seed, 0.2, 0.7)},
                   (double[3]){0.5, 0.05, 0.1}, (double[3]){0.1, 0.5, -0.1}, 1 + (uint32_t)between(seed, 0, 5));
        for (uint32_t v = 0; *seed & 1 << 20 && v < s->nvertices; v++) s->at[v][2] += between(seed, -0.05, 0.05);
        break;
    case 4: /* through the light's plane */ some_blob(s, seed, 0, 0, 0.95, 0.5); break;
    case 5: /* around the receiver */
        lit_blob(s, (double[3]){p[0], p[1], p[2] + between(seed, -0.4, 0.4)}, between(seed, 0.3, 0.8), 5, 9, 1.4);
        break;
    case 6: /* a low light */
        some_blob(s, seed, 0, 0, 0.5, between(seed, 0, 1));
        put(s, SLT_LIGHT_N, between(seed, -1, 1), between(seed, -1, 1), 0.3);
        unit_length(s->row + SLT_LIGHT_N);
        break;
    case 7: /* on the mesh, of which a part is between */
        some_blob(s, seed, 0, 0, 0.3, between(seed, 0, 0.5)), stand_on(s, seed);
        some_blob(s, seed, 0, 0, 0.7, 0);
        break;
    case 8: /* edges of three faces and of four */
        some_blob(s, seed, 0, 0, 0.5, between(seed, 0, 0.5));
        for (uint32_t k = 0, n = s->nfaces; k < 6; k++) {
            const int32_t *face = s->face[(uint32_t)between(seed, 0, n)];
            const double *at = s->at[face[0]];
            const int32_t far = lit_vertex(s, at[0] + between(seed, -0.2, 0.2), at[1] + 0.1, at[2] + 0.1);
            if (k % 3 == 2) lit_face(s, face[0], face[1], face[2]);
            else lit_face(s, face[0], k % 2 ? face[1] : far, k % 2 ? far : face[1]);
        }
        break;
    }
}

/* Every third mesh has its vertices on a grid, every eleventh light is along the axes: things lie on each other. */
static bool is_on_grid(int n) { return n / KINDS % 3 == 0; }
static bool is_aligned(int n) { return n / KINDS % 11 == 0; }

static void set_scene(LitScene *s, int n, uint64_t *seed) {
    static const double scale[5] = {10, 0.1, 1, 1, 1}; /* of the light */
    memset(s, 0, sizeof *s);
    place(s, between(seed, -1.5, 1.5), between(seed, -1.5, 1.5));
    some_mesh(s, n % KINDS, seed);
    for (uint32_t v = 0; is_on_grid(n) && v < s->nvertices; v++)
        for (int a = 0; a < 3; a++) s->at[v][a] = round(s->at[v][a] * 16) / 16;
    if (is_aligned(n)) {
        for (int a = 0; a < 3; a++) s->row[SLT_LIGHT_P + a] = round(s->row[SLT_LIGHT_P + a] * 8) / 8;
        put(s, SLT_LIGHT_CORNER, -0.5, -0.375, 1);
        put(s, SLT_LIGHT_U, 0, 0.75, 0), put(s, SLT_LIGHT_V, 1, 0, 0);
    }
    const double by = scale[n / KINDS % 5];
    for (int a = 0; a < 3; a++) {
        double *u = &s->row[SLT_LIGHT_U + a], *v = &s->row[SLT_LIGHT_V + a];
        s->row[SLT_LIGHT_CORNER + a] += 0.5 * (1 - by) * (*u + *v);
        *u *= by, *v *= by;
    }
}

static void test_ways(void **state) {
    (void)state;
    LitScene *s = calloc(1, sizeof *s);
    uint64_t seed = 5;
    double lit = 0, dark = 0;
    for (int n = 0; n < 3000; n++) {
        set_scene(s, n, &seed);
        for (int f64 = 0; f64 < 2; f64++) {
            Trimesh *m = make(s, f64);
            for (int lobe = 0; lobe < 2; lobe++) {
                const double want = ask(m, s, lobe, LIGHT_TRIANGLES, NULL), near = f64 ? 1e-12 : 2e-6;
                assert_float_equal(ask(m, s, lobe, LIGHT_SILHOUETTES, NULL), want, near);
                assert_float_equal(ask(m, s, lobe, LIGHT_PIECES, NULL), want, near);
                assert_float_equal(ask(m, s, lobe, LIGHT_BY_COUNTS, NULL), want, near);
                lit += want > 0, dark += want == 0;
            }
            geometry_free(&m->base.shared);
        }
    }
    assert_true(lit > 5000 && dark > 500);
    free(s);
}

/* Of the largest. Where edges lie on each other there is no derivative, and each way has its own. */
static void test_derivatives(void **state) {
    (void)state;
    LitScene *s = calloc(1, sizeof *s);
    Answer *a = calloc(2, sizeof *a);
    uint64_t seed = 9;
    for (int n = 1; n < 1200; n++) {
        set_scene(s, n, &seed);
        if (is_on_grid(n) || is_aligned(n)) continue;
        Trimesh *m = make(s, true);
        for (int lobe = 0; lobe < 2; lobe++) {
            double most = 0, off = 0;
            ask(m, s, lobe, LIGHT_SILHOUETTES, &a[0]), ask(m, s, lobe, LIGHT_PIECES, &a[1]);
            for (uint32_t k = 0; k < SLT_LOBE_ROWS + 3 * s->nvertices; k++) {
                double d[2];
                for (int i = 0; i < 2; i++)
                    d[i] =
                        k < SLT_LOBE_ROWS ? a[i].row[k] : a[i].vertex[(k - SLT_LOBE_ROWS) / 3][(k - SLT_LOBE_ROWS) % 3];
                most = fmax(most, fabs(d[0])), off = fmax(off, fabs(d[0] - d[1]));
            }
            assert_true(off <= 1e-9 * most);
        }
        geometry_free(&m->base.shared);
    }
    free(s), free(a);
}

static void test_instruction_sets(void **state) {
    (void)state;
    LitScene *s = calloc(1, sizeof *s);
    Answer *a = calloc(2, sizeof *a);
    uint64_t seed = 3;
    for (int n = 0; n < 300; n++) {
        set_scene(s, n, &seed);
        for (int f64 = 0; f64 < 2; f64++)
            for (int lobe = 0; lobe < 2; lobe++)
                for (TrimeshIsa isa = TRIMESH_ISA_PLAIN; isa < TRIMESH_ISAS; isa++) {
                    Trimesh *m = make_for(s, f64, isa);
                    if (!m) continue;
                    ask(m, s, lobe, LIGHT_SILHOUETTES, &a[isa != TRIMESH_ISA_PLAIN]);
                    if (isa != TRIMESH_ISA_PLAIN) assert_memory_equal(&a[0], &a[1], sizeof a[0]);
                    geometry_free(&m->base.shared);
                }
    }
    free(s), free(a);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_ways),
        cmocka_unit_test(test_derivatives),
        cmocka_unit_test(test_instruction_sets),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
