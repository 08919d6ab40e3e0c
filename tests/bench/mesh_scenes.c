/* Meshes and rays of the benchmark of rays against meshes. */
#include "mesh_bench.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/mesh/mesh.h"

/* Each triangle is four in its plane, as well as floats can say so. Vertices of edges are found by hashing. */
static void subdivide(Surface *s) {
    uint32_t room = s->nvertices + 3 * s->nfaces, slots = 1;
    while (slots < 6 * s->nfaces) slots *= 2;
    uint64_t *key = calloc(slots, sizeof *key);
    uint32_t *found = malloc(slots * sizeof *found), *face = malloc(12 * sizeof *face * s->nfaces);
    s->vertex = realloc(s->vertex, 3 * sizeof *s->vertex * room);
    for (uint32_t i = 0; i < s->nfaces; i++) {
        const uint32_t *f = s->face + 3 * (size_t)i;
        uint32_t middle[3];
        for (int k = 0; k < 3; k++) {
            uint64_t a = f[k], b = f[(k + 1) % 3], edge = (a < b ? a << 32 | b : b << 32 | a) + 1;
            uint32_t at = (uint32_t)(edge * 0x9e3779b97f4a7c15u >> 40) & (slots - 1);
            while (key[at] && key[at] != edge) at = (at + 1) & (slots - 1);
            if (!key[at]) {
                key[at] = edge, found[at] = s->nvertices++;
                for (int c = 0; c < 3; c++)
                    s->vertex[3 * (size_t)found[at] + (size_t)c] =
                        0.5f * (s->vertex[3 * a + (size_t)c] + s->vertex[3 * b + (size_t)c]);
            }
            middle[k] = found[at];
        }
        memcpy(face + 12 * (size_t)i,
               (uint32_t[]){f[0], middle[0], middle[2], middle[0], f[1], middle[1], middle[2], middle[1], f[2],
                            middle[0], middle[1], middle[2]},
               12 * sizeof *face);
    }
    free(key), free(found), free(s->face);
    s->face = face, s->nfaces *= 4;
}

static bool spot(Surface *s, int subdivisions) {
    const char *data = getenv("SALTUS_DATA");
    char path[1024];
    Mesh m;
    SltError err;
    snprintf(path, sizeof path, "%s/spot.obj", data ? data : ".");
    if (mesh_read(path, &m, &err) != SLT_OK) return false;
    uint32_t *part = malloc(sizeof *part * m.nvertices);
    mesh_weld(&m, part);
    free(part);
    s->nvertices = m.nvertices, s->nfaces = m.nfaces;
    s->vertex = malloc(3 * sizeof *s->vertex * m.nvertices), s->face = malloc(3 * sizeof *s->face * m.nfaces);
    for (size_t k = 0; k < 3 * (size_t)m.nvertices; k++) s->vertex[k] = (float)m.position[k];
    memcpy(s->face, m.face, 3 * sizeof *s->face * m.nfaces);
    mesh_free(&m);
    while (subdivisions--) subdivide(s);
    return true;
}

/* A cube of n x n squares a side, blown up. Its sides have vertices of their own. */
static void sphere(Surface *s, uint32_t n) {
    uint64_t state = 1;
    s->vertex = malloc(18 * sizeof *s->vertex * (n + 1) * (n + 1)), s->face = malloc(36 * sizeof *s->face * n * n);
    for (int side = 0; side < 6; side++) {
        const uint32_t first = s->nvertices;
        for (uint32_t k = 0; k < (n + 1) * (n + 1); k++) {
            double p[3], u = tan(M_PI / 4 * (2.0 * (k % (n + 1)) / n - 1)),
                         v = tan(M_PI / 4 * (2.0 * (k / (n + 1)) / n - 1)), sign = side < 3 ? 1 : -1;
            p[side % 3] = sign, p[(side + 1) % 3] = u, p[(side + 2) % 3] = sign * v;
            double r = (1 + 0.3 / n * bench_unit(&state)) / sqrt(1 + u * u + v * v);
            for (int a = 0; a < 3; a++) s->vertex[3 * (size_t)s->nvertices + (size_t)a] = (float)(r * p[a]);
            s->nvertices++;
        }
        for (uint32_t k = 0; k < n * n; k++) {
            uint32_t a = first + k / n * (n + 1) + k % n, b = a + 1, c = b + n + 1, d = a + n + 1;
            memcpy(s->face + 3 * (size_t)s->nfaces, (uint32_t[]){a, b, c, a, c, d}, 6 * sizeof *s->face);
            s->nfaces += 2;
        }
    }
}

bool surface_make(Surface *s, const char *name) {
    *s = (Surface){0};
    snprintf(s->name, sizeof s->name, "%s", name);
    if (!strcmp(name, "sphere")) sphere(s, 289);
    else if (!spot(s, !strcmp(name, "spot16") ? 2 : !strcmp(name, "spot4"))) return false;
    s->precise = malloc(3 * sizeof *s->precise * s->nvertices);
    double lo[3] = {HUGE_VAL, HUGE_VAL, HUGE_VAL}, hi[3] = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};
    for (size_t k = 0; k < 3 * (size_t)s->nvertices; k++) {
        s->precise[k] = (double)s->vertex[k];
        lo[k % 3] = fmin(lo[k % 3], s->precise[k]), hi[k % 3] = fmax(hi[k % 3], s->precise[k]);
    }
    for (int a = 0; a < 3; a++)
        s->middle[a] = 0.5 * (lo[a] + hi[a]), s->radius += 0.25 * (hi[a] - lo[a]) * (hi[a] - lo[a]);
    s->radius = sqrt(s->radius);
    return true;
}

void surface_free(Surface *s) { free(s->vertex), free(s->precise), free(s->face); }

static void corners(const Surface *s, int32_t triangle, double c[3][3], double normal[3]) {
    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++)
            c[k][a] = s->precise[3 * (size_t)s->face[3 * (size_t)triangle + (size_t)k] + (size_t)a];
    for (int a = 0; a < 3; a++) {
        int x = (a + 1) % 3, y = (a + 2) % 3;
        normal[a] = (c[1][x] - c[0][x]) * (c[2][y] - c[0][y]) - (c[1][y] - c[0][y]) * (c[2][x] - c[0][x]);
    }
}

double surface_distance(const Surface *s, const Ray *r, int32_t triangle) {
    double c[3][3], n[3], up = 0, down = 0;
    if (triangle < 0) return HUGE_VAL;
    corners(s, triangle, c, n);
    for (int a = 0; a < 3; a++) up += n[a] * (c[0][a] - (double)r->o[a]), down += n[a] * (double)r->d[a];
    return up / down;
}

Rays rays_primary(const Surface *s, uint32_t size) {
    Rays rays = {.name = "primary", .count = size * size, .ray = malloc(sizeof(Ray) * size * size)};
    const double look[3] = {-0.48, -0.36, -0.8}, right[3] = {0.857492925712544, 0, -0.514495755427527},
                 up[3] = {-0.185218471953910, 0.932937785397471, -0.308697453256516};
    for (uint32_t k = 0; k < rays.count; k++) {
        uint32_t x, y;
        rays_pixel(k, size, &x, &y);
        double u = 0.4 * (2 * (x + 0.5) / size - 1), v = 0.4 * (1 - 2 * (y + 0.5) / size);
        Ray *r = &rays.ray[k];
        for (int a = 0; a < 3; a++)
            r->o[a] = (float)(s->middle[a] - 2.6 * s->radius * look[a]),
            r->d[a] = (float)(look[a] + u * right[a] + v * up[a]);
        r->t0 = 0, r->t1 = 1e9f;
    }
    return rays;
}

/* The rays of `from` that hit, in their order, again and again; where each hit, and the normal there, towards it. */
typedef struct Starts {
    const Surface *s;
    const Rays *from;
    const int32_t *witness;
    uint32_t next;
} Starts;

static void next_start(Starts *t, double at[3], double normal[3]) {
    double c[3][3], length = 0, facing = 0;
    while (t->witness[t->next] < 0) t->next = (t->next + 1) % t->from->count;
    const Ray *r = &t->from->ray[t->next];
    const double far = surface_distance(t->s, r, t->witness[t->next]);
    corners(t->s, t->witness[t->next], c, normal);
    t->next = (t->next + 1) % t->from->count;
    for (int a = 0; a < 3; a++) length += normal[a] * normal[a], facing += normal[a] * (double)r->d[a];
    for (int a = 0; a < 3; a++) {
        normal[a] *= (facing > 0 ? -1 : 1) / sqrt(length);
        at[a] = (double)r->o[a] + far * (double)r->d[a] + 1e-4 * t->s->radius * normal[a];
    }
}

Rays rays_shadow(const Surface *s, const Rays *from, const int32_t *witness) {
    Rays rays = {.name = "shadow", .count = from->count, .ray = malloc(sizeof(Ray) * from->count)};
    Starts t = {s, from, witness, 0};
    for (uint32_t k = 0; k < rays.count; k++) {
        static const double light[3] = {0.6, 2.1, 0.7};
        double at[3], normal[3];
        next_start(&t, at, normal);
        for (int a = 0; a < 3; a++)
            rays.ray[k].o[a] = (float)at[a], rays.ray[k].d[a] = (float)(s->middle[a] + s->radius * light[a] - at[a]);
        rays.ray[k].t0 = 0, rays.ray[k].t1 = 1;
    }
    return rays;
}

static void direction(uint64_t *state, double d[3]) {
    double z = 2 * bench_unit(state) - 1, turn = 2 * M_PI * bench_unit(state), r = sqrt(1 - z * z);
    d[0] = r * cos(turn), d[1] = r * sin(turn), d[2] = z;
}

Rays rays_scattered(const Surface *s, const Rays *from, const int32_t *witness) {
    Rays rays = {.name = "hemisphere", .count = from->count, .ray = malloc(sizeof(Ray) * from->count)};
    Starts t = {s, from, witness, 0};
    uint64_t state = 5;
    for (uint32_t k = 0; k < rays.count; k++) {
        double at[3], normal[3], d[3];
        next_start(&t, at, normal);
        direction(&state, d);
        for (int a = 0; a < 3; a++)
            rays.ray[k].o[a] = (float)at[a], rays.ray[k].d[a] = (float)(normal[a] + 0.999 * d[a]);
        rays.ray[k].t0 = 0, rays.ray[k].t1 = 1e9f;
    }
    return rays;
}

Rays rays_through(const Surface *s, uint32_t count) {
    Rays rays = {.name = "random", .count = count, .ray = malloc(sizeof(Ray) * count)};
    uint64_t state = 9;
    for (uint32_t k = 0; k < count; k++) {
        double p[3], q[3];
        direction(&state, p), direction(&state, q);
        for (int a = 0; a < 3; a++)
            rays.ray[k].o[a] = (float)(s->middle[a] + s->radius * p[a]),
            rays.ray[k].d[a] = (float)(s->radius * (q[a] - p[a]));
        rays.ray[k].t0 = 0, rays.ray[k].t1 = 1;
    }
    return rays;
}
