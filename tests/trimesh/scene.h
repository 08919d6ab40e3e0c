/* Meshes and windows for tests of pieces, and a reference: in long double, each triangle less all that is nearer, one
 * after the other, so that no order of faces and no piece of another triangle matters. */
#ifndef SALTUS_TESTS_TRIMESH_SCENE_H
#define SALTUS_TESTS_TRIMESH_SCENE_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "saltus/mesh.h"

enum { SCENE_VERTICES = 512, SCENE_FACES = 512, SCENE_CORNERS = 64, SCENE_PARTS = 4096 };

typedef struct Scene {
    uint32_t nvertices, nfaces;
    double at[SCENE_VERTICES][3];
    float f32[SCENE_VERTICES][3];
    int32_t face[SCENE_FACES][3];
    double beam[SLT_BEAM_ROWS];
} Scene;

static inline double scene_uniform(uint64_t *state) {
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (double)(*state >> 11) * 0x1p-53;
}

static inline int32_t scene_vertex(Scene *s, double x, double y, double z) {
    double *p = s->at[s->nvertices];
    p[0] = x, p[1] = y, p[2] = z;
    for (int a = 0; a < 3; a++) s->f32[s->nvertices][a] = (float)p[a];
    return (int32_t)s->nvertices++;
}

static inline void scene_face(Scene *s, int32_t a, int32_t b, int32_t c) {
    int32_t *f = s->face[s->nfaces++];
    f[0] = a, f[1] = b, f[2] = c;
}

/* Triangles anywhere, of any size, which cross. */
static inline void scene_soup(Scene *s, uint32_t n, double size, uint64_t *state) {
    for (uint32_t i = 0; i < n; i++) {
        double at[3];
        int32_t v[3];
        for (int a = 0; a < 3; a++) at[a] = 2 * scene_uniform(state) - 1;
        for (int k = 0; k < 3; k++) {
            double p[3];
            for (int a = 2; a >= 0; a--) p[a] = at[a] + size * (scene_uniform(state) - 0.5);
            v[k] = scene_vertex(s, p[0], p[1], p[2]);
        }
        scene_face(s, v[0], v[1], v[2]);
    }
}

/* ---- scenes */

static inline void scene_beam(Scene *s, double eye_z, double corner_x, double u_x) {
    const double beam[SLT_BEAM_ROWS] = {0.1, 0.2, eye_z, corner_x, -1, eye_z - 2, u_x, 0.1, 0, 0.05, 2, 0.2};
    memcpy(s->beam, beam, sizeof beam);
}

/* Each face in four, each new vertex in the middle of two: between[k] are those of vertex before + k. */
static inline void scene_subdivide(const Scene *s, Scene *out, int32_t (*between)[2]) {
    *out = *s;
    out->nfaces = 0;
    uint32_t n = 0;
    for (uint32_t f = 0; f < s->nfaces; f++) {
        const int32_t *corner = s->face[f];
        int32_t middle[3];
        for (int k = 0; k < 3; k++) {
            const int32_t a = corner[k], b = corner[(k + 1) % 3];
            uint32_t i = 0;
            while (i < n && !((between[i][0] == a && between[i][1] == b) || (between[i][0] == b && between[i][1] == a)))
                i++;
            middle[k] = (int32_t)(s->nvertices + i);
            if (i < n) continue;
            between[n][0] = a, between[n][1] = b, n++;
            scene_vertex(out, 0.5 * (s->at[a][0] + s->at[b][0]), 0.5 * (s->at[a][1] + s->at[b][1]),
                         0.5 * (s->at[a][2] + s->at[b][2]));
        }
        for (int k = 0; k < 3; k++) scene_face(out, corner[k], middle[k], middle[(k + 2) % 3]);
        scene_face(out, middle[0], middle[1], middle[2]);
    }
}

/* A ball before a plate of two faces, one through the other at its border. */
static inline void scene_ball_and_plate(Scene *s) {
    static const double corner[6][3] = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
    *s = (Scene){0};
    for (int i = 0; i < 6; i++)
        scene_vertex(s, 0.7 * corner[i][0] + 0.03 * corner[i][1], 0.6 * corner[i][1] + 0.1 * corner[i][2],
                     0.5 * corner[i][2] - 0.1 * corner[i][0]);
    for (int i = 0; i < 8; i++) {
        const int32_t x = i & 1, y = 2 + (i >> 1 & 1), z = 4 + (i >> 2 & 1);
        const bool odd = ((x + y + z) & 1) != 0;
        scene_face(s, x, odd ? z : y, odd ? y : z);
    }
    const int32_t a = scene_vertex(s, -0.9, -0.8, -0.5), b = scene_vertex(s, 1.1, -0.85, -0.3),
                  c = scene_vertex(s, 0.95, 0.9, -0.6), d = scene_vertex(s, -0.85, 0.8, 0.2);
    scene_face(s, a, b, c), scene_face(s, a, c, d);
    scene_beam(s, 3, -1, 2);
}

/* ---- the reference */

typedef struct Part {
    uint32_t n;
    long double s[SCENE_CORNERS], t[SCENE_CORNERS];
} Part;

/* Half-planes g >= 0 and the depth of a triangle in the window. */
typedef struct Shape {
    bool seen;
    long double edge[3][3], depth[3], beyond[3]; /* beyond: the depth less what it has of all faces of a far eye */
} Shape;

static inline long double part_at(const long double g[3], long double s, long double t) {
    return g[0] * s + g[1] * t + g[2];
}

static inline void scene_cross(const long double a[3], const long double b[3], long double out[3]) {
    for (int i = 0; i < 3; i++) out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

static inline Shape shape_of(const Scene *scene, uint32_t face) {
    long double p[3][3], c[3], n[3][3], side[3][3], plane[3];
    const double *b = scene->beam;
    Shape out = {0};
    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++) {
            p[k][a] = (long double)scene->at[scene->face[face][k]][a] - (long double)b[SLT_BEAM_EYE + a];
            c[a] = (long double)b[SLT_BEAM_CORNER + a] - (long double)b[SLT_BEAM_EYE + a];
        }
    /* Products of differences: of the corners themselves they would cancel where the eye is far. */
    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++) side[k][a] = p[(k + 1) % 3][a] - p[k][a];
    for (int k = 0; k < 3; k++) scene_cross(p[k], side[k], n[k]);
    scene_cross(side[0], side[1], plane);
    long double det = 0;
    for (int a = 0; a < 3; a++) det += p[0][a] * plane[a];
    if (det == 0 || !isfinite(det)) return out;
    out.seen = true;
    /* A window far from the eye is seen from the mesh, whose origin is near: d . n is (d - p) . n. */
    long double away = 0, near = 0;
    for (int a = 0; a < 3; a++) away += fabsl(c[a]), near += fabsl((long double)b[SLT_BEAM_CORNER + a]);
    const bool apart = near < away / 4;
    for (int a = 0; a < 3; a++) {
        long double sum = plane[a] / det, along[3] = {b[SLT_BEAM_U + a], b[SLT_BEAM_V + a], c[a]};
        for (int i = 0; i < 3; i++) {
            out.depth[i] += sum * along[i];
            out.beyond[i] += sum * (i == 2 && apart ? along[i] - p[0][a] : along[i]);
            for (int k = 0; k < 3; k++)
                out.edge[k][i] += (det > 0 ? n[k][a] : -n[k][a]) * (i == 2 && apart ? along[i] - p[k][a] : along[i]);
        }
    }
    return out;
}

/* What is left of p where sign * g >= 0. */
static inline Part part_cut(const Part *p, const long double g[3], long double sign) {
    Part out = {0};
    for (uint32_t k = 0; k < p->n; k++) {
        const uint32_t next = (k + 1) % p->n;
        const long double d = sign * part_at(g, p->s[k], p->t[k]), e = sign * part_at(g, p->s[next], p->t[next]);
        if (d >= 0 && out.n < SCENE_CORNERS) out.s[out.n] = p->s[k], out.t[out.n++] = p->t[k];
        if (!((d > 0 && e < 0) || (d < 0 && e > 0)) || out.n == SCENE_CORNERS) continue;
        out.s[out.n] = p->s[k] + d / (d - e) * (p->s[next] - p->s[k]);
        out.t[out.n++] = p->t[k] + d / (d - e) * (p->t[next] - p->t[k]);
    }
    if (out.n < 3) out.n = 0;
    return out;
}

/* Area, and with it the moments of s and t. */
static inline void part_add(const Part *p, long double sum[3]) {
    for (uint32_t k = 1; k + 1 < p->n; k++) {
        long double area =
            ((p->s[k] - p->s[0]) * (p->t[k + 1] - p->t[0]) - (p->t[k] - p->t[0]) * (p->s[k + 1] - p->s[0])) / 2;
        sum[0] += area;
        sum[1] += area * (p->s[0] + p->s[k] + p->s[k + 1]) / 3;
        sum[2] += area * (p->t[0] + p->t[k] + p->t[k + 1]) / 3;
    }
}

/* Area and moments of what is seen of the face. Of equal depth the lower number is seen. false: too many parts. */
static inline bool scene_seen(const Scene *s, uint32_t face, long double sum[3]) {
    static Part row[2][SCENE_PARTS];
    Shape own = shape_of(s, face);
    uint32_t n = 1, now = 0;
    sum[0] = sum[1] = sum[2] = 0;
    if (!own.seen) return true;
    row[0][0] = (Part){4, {0, 1, 1, 0}, {0, 0, 1, 1}};
    for (int k = 0; k < 3; k++) row[0][0] = part_cut(&row[0][0], own.edge[k], 1);
    for (uint32_t f = 0; f < s->nfaces; f++) {
        Shape other = shape_of(s, f);
        long double nearer[3], size = 0;
        if (f == face || !other.seen) continue;
        for (int i = 0; i < 3; i++)
            nearer[i] = other.beyond[i] - own.beyond[i], size += fabsl(other.beyond[i]) + fabsl(own.beyond[i]);
        bool same = fabsl(nearer[0]) + fabsl(nearer[1]) + fabsl(nearer[2]) < 1e-13L * size;
        if (same && f > face) continue;
        uint32_t kept = 0;
        for (uint32_t i = 0; i < n; i++) {
            Part in = row[now][i];
            for (int k = 0; k < 4 && in.n; k++) {
                if (k == 3 && same) break;
                const long double *g = k < 3 ? other.edge[k] : nearer;
                Part rest = part_cut(&in, g, -1);
                in = part_cut(&in, g, 1);
                if (rest.n && kept == SCENE_PARTS) return false;
                if (rest.n) row[!now][kept++] = rest;
            }
        }
        now = !now, n = kept;
    }
    for (uint32_t i = 0; i < n; i++) part_add(&row[now][i], sum);
    return true;
}

#endif
