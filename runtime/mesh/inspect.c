/* What is wrong with a mesh, counted: runtime/mesh/mesh.h says what each count is. Edges and faces are sorted; vertices
 * on edges are found in a grid of cells as long as the mean edge, which every edge is followed through. */
#include "mesh.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define NEAR 1e-6 /* of the box's diagonal: files have six digits */

typedef struct Side {
    uint32_t a, b, opposite; /* a < b */
} Side;
typedef struct Face {
    uint32_t v[3]; /* ascending */
} Face;

static int compare(const uint32_t *x, const uint32_t *y, int n) {
    for (int k = 0; k < n; k++)
        if (x[k] != y[k]) return x[k] < y[k] ? -1 : 1;
    return 0;
}
static int by_ends(const void *x, const void *y) { return compare(x, y, 2); }
static int by_corners(const void *x, const void *y) { return compare(x, y, 3); }

static void swap(uint32_t *x, uint32_t *y) {
    if (*x <= *y) return;
    uint32_t t = *x;
    *x = *y, *y = t;
}

/* The box of all vertices that faces have, and what is near in it. */
typedef struct Space {
    const double *position;
    double lo[3], near, cell;
    uint64_t mask; /* of buckets */
    uint32_t *first, *vertex;
} Space;

static const double *at(const Space *s, uint32_t v) { return s->position + 3 * (size_t)v; }

static uint64_t bucket(const Space *s, const int64_t c[3]) {
    uint64_t h = 0x9e3779b97f4a7c15u;
    for (int a = 0; a < 3; a++) h = (h ^ (uint64_t)c[a]) * 0xff51afd7ed558ccdu, h ^= h >> 32;
    return h & s->mask;
}

static int64_t cell_of(const Space *s, double v, int a) { return (int64_t)floor((v - s->lo[a]) / s->cell); }

/* Calls f for each bucket that a vertex, up to what is near, may lie in. */
static void spread(Space *s, uint32_t v, void (*f)(Space *, uint64_t, uint32_t)) {
    int64_t from[3], to[3], c[3];
    for (int a = 0; a < 3; a++)
        from[a] = cell_of(s, at(s, v)[a] - s->near, a), to[a] = cell_of(s, at(s, v)[a] + s->near, a);
    for (c[0] = from[0]; c[0] <= to[0]; c[0]++)
        for (c[1] = from[1]; c[1] <= to[1]; c[1]++)
            for (c[2] = from[2]; c[2] <= to[2]; c[2]++) f(s, bucket(s, c), v);
}
static void count_one(Space *s, uint64_t b, uint32_t v) { (void)v, s->first[b + 1]++; }
static void put_one(Space *s, uint64_t b, uint32_t v) { s->vertex[s->first[b]++] = v; }

static bool fill(Space *s, const uint8_t *used, uint32_t n) {
    s->mask = 16;
    while (s->mask < 2 * (uint64_t)n) s->mask *= 2;
    s->first = calloc(s->mask + 2, sizeof *s->first);
    uint64_t buckets = s->mask--;
    if (!s->first) return false;
    for (uint32_t v = 0; v < n; v++)
        if (used[v]) spread(s, v, count_one);
    for (uint64_t b = 0; b < buckets; b++) s->first[b + 1] += s->first[b];
    s->vertex = malloc((s->first[buckets] + 1u) * sizeof *s->vertex);
    if (!s->vertex) return false;
    for (uint32_t v = 0; v < n; v++)
        if (used[v]) spread(s, v, put_one);
    memmove(s->first + 1, s->first, buckets * sizeof *s->first);
    s->first[0] = 0;
    return true;
}

/* Between the ends, away from both. */
static bool lies_on(const Space *s, const double *p, const double *a, const double *b) {
    double along = 0, length = 0, off = 0;
    for (int k = 0; k < 3; k++) along += (p[k] - a[k]) * (b[k] - a[k]), length += (b[k] - a[k]) * (b[k] - a[k]);
    double t = along / length, margin = s->near / sqrt(length);
    if (!(t > margin && t < 1 - margin)) return false;
    for (int k = 0; k < 3; k++) off += pow(p[k] - a[k] - t * (b[k] - a[k]), 2);
    return off <= s->near * s->near;
}

/* Marks vertices that lie on the edge of sides e[n]. */
static void follow_edge(const Space *s, const Side *e, uint32_t n, uint8_t *on) {
    const double *a = at(s, e->a), *b = at(s, e->b);
    int64_t c[3], end[3];
    int step[3];
    double next[3], each[3];
    for (int k = 0; k < 3; k++) {
        double d = b[k] - a[k];
        c[k] = cell_of(s, a[k], k), end[k] = cell_of(s, b[k], k);
        step[k] = d < 0 ? -1 : 1;
        next[k] = d != 0 ? (s->lo[k] + s->cell * (double)(c[k] + (d > 0)) - a[k]) / d : HUGE_VAL;
        each[k] = d != 0 ? s->cell / fabs(d) : HUGE_VAL;
    }
    for (;;) {
        uint64_t h = bucket(s, c);
        for (uint32_t i = s->first[h]; i < s->first[h + 1]; i++) {
            uint32_t v = s->vertex[i];
            bool own = v == e->a || v == e->b;
            for (uint32_t k = 0; k < n && !own; k++) own = e[k].opposite == v;
            if (!own && lies_on(s, at(s, v), a, b)) on[v] = 1;
        }
        int k = -1; /* rounding may have an end one cell on: no axis goes beyond it */
        for (int i = 0; i < 3; i++)
            if (c[i] != end[i] && (k < 0 || next[i] < next[k])) k = i;
        if (k < 0) return;
        c[k] += step[k], next[k] += each[k];
    }
}

static void count_edges(const Space *s, Side *side, size_t n, uint8_t *on, MeshCounts *out) {
    qsort(side, n, sizeof *side, by_ends);
    for (size_t from = 0, to; from < n; from = to) {
        for (to = from + 1; to < n && !by_ends(&side[from], &side[to]); to++) continue;
        out->edges++, out->open_edges += to - from == 1, out->nonmanifold_edges += to - from > 2;
        if (s->first) follow_edge(s, &side[from], (uint32_t)(to - from), on);
    }
}

/* Faces with the same three corners, by place. */
static uint32_t count_duplicates(Face *face, uint32_t n) {
    uint32_t same = 0;
    qsort(face, n, sizeof *face, by_corners);
    for (uint32_t f = 1; f < n; f++)
        same += !by_corners(&face[f - 1], &face[f]) && face[f].v[0] < face[f].v[1] && face[f].v[1] < face[f].v[2];
    return same;
}

static bool is_degenerate(const double *a, const double *b, const double *c) {
    double p[3], q[3], area = 0, longest = 0;
    for (int k = 0; k < 3; k++) p[k] = b[k] - a[k], q[k] = c[k] - a[k];
    for (int k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        area += pow(p[i] * q[j] - p[j] * q[i], 2);
        longest += p[k] * p[k] + q[k] * q[k];
    }
    return !(area > 0x1p-96 * longest * longest);
}

/* The first vertex at the same place, whatever its part. */
static bool find_places(const double *position, uint32_t n, uint32_t *place) {
    size_t size = 16;
    while (size < 2 * (size_t)n) size *= 2;
    uint32_t *table = malloc(size * sizeof *table);
    if (!table) return false;
    memset(table, 0xff, size * sizeof *table);
    for (uint32_t v = 0; v < n; v++) {
        const double *p = position + 3 * (size_t)v;
        uint64_t h = 0x9e3779b97f4a7c15u, bits;
        for (int a = 0; a < 3; a++) {
            double x = p[a] + 0.0;
            memcpy(&bits, &x, sizeof bits);
            h = (h ^ bits) * 0xff51afd7ed558ccdu, h ^= h >> 32;
        }
        size_t k = h & (size - 1);
        while (table[k] != UINT32_MAX) {
            const double *o = position + 3 * (size_t)table[k];
            if (o[0] == p[0] && o[1] == p[1] && o[2] == p[2]) break;
            k = (k + 1) & (size - 1);
        }
        if (table[k] == UINT32_MAX) table[k] = v;
        place[v] = table[k];
    }
    free(table);
    return true;
}

/* Cells as long as the mean side; none where that is nothing. */
static void measure(Space *s, const uint8_t *used, uint32_t nvertices, const Side *side, size_t n) {
    double hi[3] = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL}, diagonal = 0, length = 0;
    for (int a = 0; a < 3; a++) s->lo[a] = HUGE_VAL;
    for (uint32_t v = 0; v < nvertices; v++)
        for (int a = 0; a < 3 && used[v]; a++) s->lo[a] = fmin(s->lo[a], at(s, v)[a]), hi[a] = fmax(hi[a], at(s, v)[a]);
    for (int a = 0; a < 3; a++) diagonal += pow(hi[a] - s->lo[a], 2);
    for (size_t k = 0; k < n; k++) {
        double square = 0;
        for (int a = 0; a < 3; a++) square += pow(at(s, side[k].b)[a] - at(s, side[k].a)[a], 2);
        length += sqrt(square) / (double)n;
    }
    s->near = NEAR * sqrt(diagonal), s->cell = fmax(length, 4 * s->near);
}

bool mesh_inspect(const double *position, uint32_t nvertices, const int32_t *face, const int32_t *part, uint32_t nfaces,
                  MeshCounts *out) {
    *out = (MeshCounts){.vertices = nvertices, .triangles = nfaces};
    size_t nsides = 0;
    Side *side = malloc((3 * (size_t)nfaces + 1) * sizeof *side);
    Face *sorted = malloc((nfaces + 1u) * sizeof *sorted);
    uint8_t *used = calloc(2 * ((size_t)nvertices + 1), 1), *on = used ? used + nvertices + 1 : NULL;
    uint32_t *place = malloc((nvertices + 1u) * sizeof *place);
    Space s = {.position = position};
    bool ok = side && sorted && used && place && find_places(position, nvertices, place), finite = true;
    for (uint32_t f = 0; ok && f < nfaces; f++) {
        const int32_t *v = face + 3 * (size_t)f;
        for (int k = 0; k < 3; k++) {
            uint32_t a = (uint32_t)v[k], b = (uint32_t)v[(k + 1) % 3];
            used[a] = 1, sorted[f].v[k] = place[a];
            swap(&a, &b);
            /* One with a corner twice is no face: its sides are nobody's edges. */
            if (v[0] != v[1] && v[1] != v[2] && v[2] != v[0]) side[nsides++] = (Side){a, b, (uint32_t)v[(k + 2) % 3]};
        }
        swap(&sorted[f].v[0], &sorted[f].v[1]), swap(&sorted[f].v[1], &sorted[f].v[2]);
        swap(&sorted[f].v[0], &sorted[f].v[1]);
        out->degenerate +=
            is_degenerate(position + 3 * (size_t)v[0], position + 3 * (size_t)v[1], position + 3 * (size_t)v[2]);
        if ((uint32_t)part[f] >= out->parts) out->parts = (uint32_t)part[f] + 1;
    }
    for (size_t k = 0; ok && k < 3 * (size_t)nvertices; k++) finite &= fabs(position[k]) < 1e150;
    if (ok) measure(&s, used, nvertices, side, nsides);
    if (ok && finite && s.cell > 0) ok = fill(&s, used, nvertices);
    if (ok) {
        count_edges(&s, side, nsides, on, out);
        out->duplicates = count_duplicates(sorted, nfaces);
        for (uint32_t v = 0; v < nvertices; v++) out->on_edges += on[v], out->lone += !used[v];
    }
    free(side), free(sorted), free(used), free(place), free(s.first), free(s.vertex);
    return ok;
}
