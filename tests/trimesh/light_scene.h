/* Meshes, receivers and lights for tests of light, and a reference: in long double, the light less each triangle, one
 * after the other, so that no silhouette, no tree and no ray matters. */
#ifndef SALTUS_TESTS_TRIMESH_LIGHT_SCENE_H
#define SALTUS_TESTS_TRIMESH_LIGHT_SCENE_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "runtime/geometry/mesh/ltc.h"
#include "saltus/mesh.h"

enum { LIT_VERTICES = 4096, LIT_FACES = 8192, LIT_CORNERS = 64, LIT_PARTS = 8192 };

typedef struct LitScene {
    uint32_t nvertices, nfaces;
    double at[LIT_VERTICES][3];
    float f32[LIT_VERTICES][3];
    int32_t face[LIT_FACES][3];
    double row[SLT_LOBE_ROWS];
} LitScene;

static inline double lit_uniform(uint64_t *state) {
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (double)(*state >> 11) * 0x1p-53;
}

static inline int32_t lit_vertex(LitScene *s, double x, double y, double z) {
    double *p = s->at[s->nvertices];
    p[0] = x, p[1] = y, p[2] = z;
    return (int32_t)s->nvertices++;
}

static inline void lit_face(LitScene *s, int32_t a, int32_t b, int32_t c) {
    int32_t *f = s->face[s->nfaces++];
    f[0] = a, f[1] = b, f[2] = c;
}

/* n x n squares of two triangles each, from o along x and y. */
static inline void lit_square(LitScene *s, const double o[3], const double x[3], const double y[3], uint32_t n) {
    const int32_t first = (int32_t)s->nvertices;
    for (uint32_t i = 0; i <= n; i++)
        for (uint32_t k = 0; k <= n; k++) {
            double p[3];
            for (int a = 0; a < 3; a++) p[a] = o[a] + x[a] * k / n + y[a] * i / n;
            lit_vertex(s, p[0], p[1], p[2]);
        }
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t k = 0; k < n; k++) {
            const int32_t a = first + (int32_t)(i * (n + 1) + k), c = a + (int32_t)n + 1;
            lit_face(s, a, a + 1, c + 1), lit_face(s, a, c + 1, c);
        }
}

/* A closed surface around o: rings x columns points between two poles, dented by `rough`. */
static inline void lit_blob(LitScene *s, const double o[3], double radius, uint32_t rings, uint32_t columns,
                            double rough) {
    const int32_t first = (int32_t)s->nvertices;
    uint64_t state = 7;
    for (uint32_t i = 0; i <= rings + 1; i++)
        for (uint32_t k = 0; k < (i == 0 || i == rings + 1 ? 1 : columns); k++) {
            const double u = M_PI * i / (rings + 1), v = 2 * M_PI * (k + 0.37) / columns,
                         r = radius * (1 + rough * lit_uniform(&state));
            lit_vertex(s, o[0] + r * sin(u) * cos(v), o[1] + r * sin(u) * sin(v), o[2] + r * cos(u));
        }
    const int32_t last = (int32_t)s->nvertices - 1;
    for (uint32_t i = 0; i <= rings; i++)
        for (uint32_t k = 0; k < columns; k++) {
            const uint32_t next = (k + 1) % columns, above = 1 + (i - 1) * columns, below = 1 + i * columns;
            const int32_t a = first + (int32_t)(i ? above + k : 0), b = i < rings ? first + (int32_t)(below + k) : last,
                          c = i < rings ? first + (int32_t)(below + next) : last,
                          d = first + (int32_t)(i ? above + next : 0);
            if (b != c) lit_face(s, a, b, c);
            if (a != d) lit_face(s, a, c, d);
        }
}

/* Loose triangles of about that size. */
static inline void lit_soup(LitScene *s, uint32_t n, double size, uint64_t seed) {
    for (uint32_t i = 0; i < n; i++) {
        int32_t v[3];
        double o[3];
        for (int a = 0; a < 3; a++) o[a] = lit_uniform(&seed) - 0.5;
        for (int k = 0; k < 3; k++) {
            double p[3];
            for (int a = 0; a < 3; a++) p[a] = o[a] + size * (lit_uniform(&seed) - 0.5);
            v[k] = lit_vertex(s, p[0], p[1], 0.5 + 0.6 * p[2]);
        }
        lit_face(s, v[0], v[1], v[2]);
    }
}

/* ---- the reference */

typedef struct LitPart {
    uint32_t n;
    long double u[LIT_CORNERS], v[LIT_CORNERS];
} LitPart;

static inline long double lit_dot(const long double a[3], const long double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void lit_cross(const long double a[3], const long double b[3], long double out[3]) {
    for (int i = 0; i < 3; i++) {
        const int k = (i + 1) % 3, j = (i + 2) % 3;
        out[i] = a[k] * b[j] - a[j] * b[k];
    }
}

static inline LitPart lit_cut(const LitPart *p, const long double g[3], long double sign) {
    LitPart out = {0};
    for (uint32_t k = 0; k < p->n; k++) {
        const uint32_t next = (k + 1) % p->n;
        const long double d = sign * (g[0] * p->u[k] + g[1] * p->v[k] + g[2]),
                          e = sign * (g[0] * p->u[next] + g[1] * p->v[next] + g[2]);
        if (d >= 0 && out.n < LIT_CORNERS) out.u[out.n] = p->u[k], out.v[out.n++] = p->v[k];
        if (!((d > 0 && e < 0) || (d < 0 && e > 0)) || out.n == LIT_CORNERS) continue;
        out.u[out.n] = p->u[k] + d / (d - e) * (p->u[next] - p->u[k]);
        out.v[out.n++] = p->v[k] + d / (d - e) * (p->v[next] - p->v[k]);
    }
    if (out.n < 3) out.n = 0;
    return out;
}

/* c, u, v as columns: where the light is, from p. at[3] is the light's own; the other a mesh and a receiver. */
typedef struct LitView {
    long double c[3], u[3], v[3], n[3];
    long double map[3][3], scale; /* of the lobe; of irradiance the identity and 1 */
} LitView;

static inline void lit_line(const LitView *w, const long double normal[3], long double g[3]) {
    g[0] = lit_dot(normal, w->u), g[1] = lit_dot(normal, w->v), g[2] = lit_dot(normal, w->c);
}

/* M of the table, written out in a frame, and its inverse (ltc.h): not as ltc.c does it. */
static inline void lit_lobe(LitView *w, const long double view[3], long double roughness) {
    double p[LTC_PARTS], by_roughness[LTC_PARTS], by_cosine[LTC_PARTS];
    long double frame[3][3], cosine = lit_dot(w->n, view), s = 0, alpha = roughness * roughness, r0 = roughness,
                             value[LTC_PARTS];
    /* The table is in double; its line from the nearest double on. */
    ltc_parts((double)roughness, (double)cosine, p, by_roughness, by_cosine);
    for (int k = 0; k < LTC_PARTS; k++)
        value[k] = p[k] + by_roughness[k] * (r0 - (double)roughness) + by_cosine[k] * (cosine - (double)cosine);
    for (int a = 0; a < 3; a++) frame[0][a] = view[a] - cosine * w->n[a], frame[2][a] = w->n[a];
    s = sqrtl(lit_dot(frame[0], frame[0]));
    for (int a = 0; a < 3; a++) frame[0][a] /= s;
    lit_cross(frame[2], frame[0], frame[1]);
    const long double m[3][3] = {{alpha * (value[0] + s * s * value[1]), 0, -s * value[2]},
                                 {0, alpha * value[0], 0},
                                 {alpha * s * value[3], 0, value[4]}};
    const long double det = m[0][0] * m[2][2] - m[0][2] * m[2][0];
    const long double inverse[3][3] = {
        {m[2][2] / det, 0, -m[0][2] / det}, {0, 1 / m[1][1], 0}, {-m[2][0] / det, 0, m[0][0] / det}};
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            w->map[i][k] = 0;
            for (int a = 0; a < 3; a++) w->map[i][k] += inverse[i][a] * frame[a][k];
        }
    w->scale = value[5] / acosl(-1);
}

static inline long double lit_sum(const LitView *w, const LitPart *p, bool lobe) {
    long double sum = 0;
    for (uint32_t k = 0; k < p->n; k++) {
        long double q[2][3], c[3];
        for (uint32_t e = 0; e < 2; e++) {
            const uint32_t at = (k + e) % p->n;
            long double d[3];
            for (int a = 0; a < 3; a++) d[a] = w->c[a] + p->u[at] * w->u[a] + p->v[at] * w->v[a];
            for (int a = 0; a < 3; a++) q[e][a] = lobe ? lit_dot(w->map[a], d) : d[a];
        }
        lit_cross(q[0], q[1], c);
        const long double size = sqrtl(lit_dot(c, c));
        /* Seen from p, (u, v) turn the other way. */
        if (size > 0) sum -= (lobe ? c[2] : lit_dot(w->n, c)) / size * atan2l(size, lit_dot(q[0], q[1])) / 2;
    }
    return sum;
}

/* What of the light reaches the receiver: row as of SltLightRow, at: the vertices. For the lobe n and view are made of
 * unit length. NAN: too many parts. */
static inline long double lit_value(const LitScene *s, const long double row[SLT_LOBE_ROWS], const long double (*at)[3],
                                    bool lobe) {
    static LitPart part[2][LIT_PARTS];
    LitView w = {.scale = 1};
    long double g[3], normal[3], sum = 0;
    for (int a = 0; a < 3; a++) {
        w.c[a] = row[SLT_LIGHT_CORNER + a] - row[SLT_LIGHT_P + a];
        w.u[a] = row[SLT_LIGHT_U + a], w.v[a] = row[SLT_LIGHT_V + a], w.n[a] = row[SLT_LIGHT_N + a];
    }
    lit_cross(w.u, w.v, normal);
    const long double whole = lit_dot(w.c, normal);
    if (!(whole < 0)) return 0;
    if (lobe) {
        long double view[3];
        memcpy(view, row + SLT_LIGHT_VIEW, sizeof view);
        const long double length[2] = {sqrtl(lit_dot(w.n, w.n)), sqrtl(lit_dot(view, view))};
        for (int a = 0; a < 3; a++) w.n[a] /= length[0], view[a] /= length[1];
        if (!(lit_dot(w.n, view) > 0)) return 0;
        lit_lobe(&w, view, row[SLT_LIGHT_ROUGHNESS]);
    }
    uint32_t n = 1, now = 0;
    part[0][0] = (LitPart){4, {0, 1, 1, 0}, {0, 0, 1, 1}};
    lit_line(&w, w.n, g);
    part[0][0] = lit_cut(&part[0][0], g, 1);
    if (lobe) lit_line(&w, w.map[2], g), part[0][0] = lit_cut(&part[0][0], g, 1);
    for (uint32_t f = 0; f < s->nfaces; f++) {
        long double p[3][3], line[4][3], sides[3][3], total[3] = {0};
        for (int k = 0; k < 3; k++)
            for (int a = 0; a < 3; a++) p[k][a] = at[s->face[f][k]][a] - row[SLT_LIGHT_P + a];
        for (int k = 0; k < 3; k++) {
            lit_cross(p[k], p[(k + 1) % 3], sides[k]);
            for (int a = 0; a < 3; a++) total[a] += sides[k][a];
        }
        const long double det = lit_dot(p[0], sides[1]);
        if (det == 0 || !isfinite(det)) continue;
        for (int k = 0; k < 3; k++) {
            lit_line(&w, sides[k], line[k]);
            for (int i = 0; i < 3 && det < 0; i++) line[k][i] = -line[k][i];
        }
        lit_line(&w, total, line[3]);
        for (int i = 0; i < 3; i++) line[3][i] = line[3][i] / det - (i == 2);
        uint32_t kept = 0;
        for (uint32_t i = 0; i < n; i++) {
            LitPart in = part[now][i];
            for (int k = 0; k < 4 && in.n; k++) in = lit_cut(&in, line[k], 1);
            if (!in.n) {
                if (kept == LIT_PARTS) return NAN;
                part[!now][kept++] = part[now][i];
                continue;
            }
            in = part[now][i];
            for (int k = 0; k < 4 && in.n; k++) {
                const LitPart rest = lit_cut(&in, line[k], -1);
                in = lit_cut(&in, line[k], 1);
                if (rest.n && kept == LIT_PARTS) return NAN;
                if (rest.n) part[!now][kept++] = rest;
            }
        }
        now = !now, n = kept;
    }
    for (uint32_t i = 0; i < n; i++) sum += lit_sum(&w, &part[now][i], lobe);
    return w.scale * sum;
}

#endif
