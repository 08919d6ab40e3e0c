/* Meshes from OBJ and PLY: what the file says, in its order; errors with their place; the files of other programs. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>

#include "runtime/mesh/mesh.h"

static SltStatus decode(const char *name, const void *bytes, size_t size, Mesh *m, SltError *err) {
    uint8_t *copy = malloc(size + 1); /* of exactly this size, so that a sanitizer sees what reads on */
    memcpy(copy, bytes, size);
    copy[size] = 0;
    SltStatus status = mesh_decode(name, copy, size, m, err);
    free(copy);
    return status;
}

static Mesh must(const char *name, const void *bytes, size_t size) {
    Mesh m;
    SltError err = {0};
    if (decode(name, bytes, size, &m, &err) != SLT_OK) fail_msg("%s", err.text);
    return m;
}

static void test_obj(void **state) {
    (void)state;
    static const char text[] = "# a square and a triangle\r\no first\nv 0 0 0\nv 1 0 0 1 # w\nv\t1 1 0 .5 .5 .5\n"
                               "v 0 1e0 -0.25\nvt 0 0\nvt 1 0\nvt 1 1\nvt .5\nvn 0 0 2\ns off\n"
                               "f 1/1/1 2/2/1 3/3/1 \\\n  4/4/1 # fan\ng second\ng still second\nusemtl red\n"
                               "v 0 0 1\nf -5//1 2 5";
    Mesh m = must("a.OBJ", text, sizeof text - 1);
    static const uint32_t face[] = {0, 1, 2, 0, 2, 3, 0, 1, 4}, part[] = {0, 0, 1},
                          uv[] = {0, 1, 2, 0, 2, 3, MESH_NONE, MESH_NONE, MESH_NONE},
                          normal[] = {0, 0, 0, 0, 0, 0, 0, MESH_NONE, MESH_NONE};
    assert_int_equal(m.nvertices, 5);
    assert_int_equal(m.nfaces, 3);
    assert_int_equal(m.nparts, 2);
    assert_memory_equal(m.face, face, sizeof face);
    assert_memory_equal(m.face_uv, uv, sizeof uv);
    assert_memory_equal(m.face_normal, normal, sizeof normal);
    assert_memory_equal(m.part, part, sizeof part);
    assert_true(m.position[3 * 3 + 1] == 1 && m.position[3 * 3 + 2] == -0.25 && m.uv[6] == 0.5 && m.uv[7] == 0);
    double n[15];
    mesh_vertex_normals(&m, n);
    assert_true(n[2] == 1 && n[3 * 3 + 2] == 1 && n[3 * 4 + 2] == 0); /* the last vertex has none of its own */
    mesh_free(&m);
    static const char early[] = "f 1 2 3\nv 0 0 0\nv 2 0 0\nv 0 2 0\n";
    m = must("b.obj", early, sizeof early - 1); /* faces first; no normals: those of the faces */
    assert_null(m.face_uv);
    assert_null(m.face_normal);
    mesh_vertex_normals(&m, n);
    assert_true(n[0] == 0 && n[1] == 0 && n[2] == 1);
    mesh_free(&m);
}

/* A PLY with a square of two vertex properties that mean nothing here; fmt: a text, '<' or '>'. */
static size_t make_ply(char *out, size_t size, char fmt) {
    static const double position[4][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0.5}, {0, 1, 0}};
    size_t n = (size_t)snprintf(out, size,
                                "ply\r\nformat %s 1.0\ncomment by hand\nelement vertex 4\nproperty double x\n"
                                "property float32 y\nproperty uchar red\nproperty float z\nproperty float u\n"
                                "property float v\nelement edge 1\nproperty list ushort short far\n"
                                "element face 1\nproperty int8 flag\nproperty list uint8 int vertex_indices\n"
                                "end_header\n",
                                fmt == 't'   ? "ascii"
                                : fmt == '<' ? "binary_little_endian"
                                             : "binary_big_endian");
    if (fmt == 't') {
        for (int k = 0; k < 4; k++)
            n += (size_t)snprintf(out + n, size - n, "%g %g 200 %g %g %g\n", position[k][0], position[k][1],
                                  position[k][2], position[k][0], position[k][1]);
        return n + (size_t)snprintf(out + n, size - n, "2 -1 7\n-3 4 0 1 2 3\n");
    }
#define PUT(value)                                                                                                     \
    do {                                                                                                               \
        unsigned char raw[sizeof(value)];                                                                              \
        memcpy(raw, &(value), sizeof raw);                                                                             \
        for (size_t b = 0; b < sizeof raw; b++) out[n++] = (char)raw[fmt == '<' ? b : sizeof raw - 1 - b];             \
    } while (0)
    for (int k = 0; k < 4; k++) {
        float y = (float)position[k][1], z = (float)position[k][2], u = (float)position[k][0];
        uint8_t red = 200;
        PUT(position[k][0]);
        PUT(y);
        PUT(red);
        PUT(z);
        PUT(u);
        PUT(y);
    }
    uint16_t count = 2;
    int16_t far[] = {-1, 7};
    int8_t flag = -3;
    uint8_t corners = 4;
    PUT(count);
    PUT(far[0]);
    PUT(far[1]);
    PUT(flag);
    PUT(corners);
    for (int32_t k = 0; k < 4; k++) PUT(k);
    return n;
}

static void test_ply(void **state) {
    (void)state;
    char bytes[2048];
    static const uint32_t face[] = {0, 1, 2, 0, 2, 3};
    for (const char *fmt = "t<>"; *fmt; fmt++) {
        size_t n = make_ply(bytes, sizeof bytes, *fmt);
        Mesh m = must("a.ply", bytes, n);
        assert_int_equal(m.nvertices, 4);
        assert_int_equal(m.nfaces, 2);
        assert_int_equal(m.nuvs, 4);
        assert_memory_equal(m.face, face, sizeof face);
        assert_memory_equal(m.face_uv, face, sizeof face);
        assert_null(m.face_normal);
        assert_true(m.position[6] == 1 && m.position[7] == 1 && m.position[8] == 0.5 && m.uv[5] == 1);
        mesh_free(&m);
        for (size_t cut = 0; cut < n - (*fmt == 't'); cut++) { /* the last newline may be missing */
            SltError err = {0};
            if (decode("a.ply", bytes, cut, &m, &err) == SLT_OK) fail_msg("%c cut at %zu of %zu", *fmt, cut, n);
            assert_null(m.position);
        }
    }
}

static void test_errors(void **state) {
    (void)state;
    static const struct {
        const char *name, *text, *expected;
    } rows[] = {
        {"a.obj", "", "no vertices"},
        {"a.obj", "v 0 0 0\n\nf 1 1 2\n", "line 3: there is no vertex 2"},
        {"a.obj", "v 0 0 0\nf 1 1 0\n", "line 2: `0` is no corner"},
        {"a.obj", "v 0 0 0\nf 1 1 -2\n", "line 2: `-2` is no corner"},
        {"a.obj", "v 0 0 0\nf 1/2 1 1\n", "there is no texture coordinate 2"},
        {"a.obj", "v 0 0 0\nf 1 1 1//\n", ""},
        {"a.obj", "v 0 0 0\nf 1 1\n", "line 2: a face of 2 corners"},
        {"a.obj", "v 0 0 0\nf 1 1 4294967296\n", "line 2: `4294967296`"},
        {"a.obj", "v 0 0\n", "line 1: `v` wants 3 numbers, there are 2"},
        {"a.obj", "v 0 0 x\n", "line 1: `v` wants numbers"},
        {"a.obj", "v 0 0 0x10\n", "line 1: `v` wants numbers"},
        {"a.obj", "\xef\xbb\xbfv 0 0 0\nf 1 1 2\n", "line 2: there is no vertex 2: the file has 1 vertices"},
        {"a.obj", "\n\nv 0 0 inf\n", "line 3: a number is not finite"},
        {"a.obj", "v 0 1 \\\n\\\nz\n", "line 1: `v` wants numbers"},
        {"a.ply", "plY\n", "line 1: it is no PLY file"},
        {"a.ply", "ply\nend_header\n", "no format"},
        {"a.ply", "ply\nformat ebcdic 1.0\n", "line 2: unknown format `ebcdic`"},
        {"a.ply", "ply\nformat ascii 1.0\nproperty float x\n", "line 3: a property before"},
        {"a.ply", "ply\nformat ascii 1.0\nelement vertex -1\n", "line 3: `-1` is no number"},
        {"a.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty half x\n", "line 4: unknown type `half`"},
        {"a.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty int x\n",
         "line 5: `x` is there twice"},
        {"a.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n", "no x, y and z"},
        {"a.ply",
         "ply\nformat binary_big_endian 1.0\nelement vertex 4000000000\nproperty float x\nproperty float y\nproperty float z\nend_header\n",
         "4000000000 elements are more than the file holds"},
        {"a.ply",
         "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list char int vertex_index\nend_header\n1 2 3\n-1\n",
         "line 11: -1 is no length"},
        {"a.ply",
         "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list char int vertex_index\nend_header\n1 2 3\n3 0 0 1\n",
         "line 11: there is no vertex 1: the file has 1 vertices, from 0 on"},
    };
    for (size_t k = 0; k < sizeof rows / sizeof *rows; k++) {
        Mesh m;
        SltError err = {0};
        SltStatus status = decode(rows[k].name, rows[k].text, strlen(rows[k].text), &m, &err);
        if (!*rows[k].expected) {
            if (status != SLT_OK) fail_msg("%s: %s", rows[k].text, err.text);
            mesh_free(&m);
        } else if (status == SLT_OK || !strstr(err.text, rows[k].expected)) {
            fail_msg("%s: `%s` and not `%s`", rows[k].text, err.text, rows[k].expected);
        }
    }
}

/* A closed surface of one piece: every edge has two faces, and V - E + F = 2. */
static void test_spot(void **state) {
    (void)state;
    const char *folder = getenv("SALTUS_DATA");
    char path[4096];
    Mesh m;
    SltError err = {0};
    if (!folder) skip();
    snprintf(path, sizeof path, "%s/spot.obj", folder);
    if (mesh_read(path, &m, &err) != SLT_OK) fail_msg("%s", err.text);
    assert_int_equal(3 * m.nfaces % 2, 0);
    assert_int_equal((int)m.nvertices - (int)(3 * m.nfaces / 2) + (int)m.nfaces, 2);
    double volume = 0;
    for (size_t f = 0; f < m.nfaces; f++) {
        const double *a = m.position + 3 * (size_t)m.face[3 * f], *b = m.position + 3 * (size_t)m.face[3 * f + 1],
                     *c = m.position + 3 * (size_t)m.face[3 * f + 2];
        volume += (a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
                   a[2] * (b[0] * c[1] - b[1] * c[0])) /
                  6;
    }
    assert_true(volume > 0); /* faces look outwards */
    mesh_free(&m);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_obj), cmocka_unit_test(test_ply),
                                       cmocka_unit_test(test_errors), cmocka_unit_test(test_spot)};
    return cmocka_run_group_tests_name("mesh.mesh", tests, NULL, NULL);
}
