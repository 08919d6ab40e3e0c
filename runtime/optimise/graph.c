/* I + lambda L of any graph, L its Laplacian: of a mesh's vertices, joined by the edges of its faces, or of a grid of
 * three dimensions. Solved by conjugate gradients: with eigenvalues from 1 to 1 + 2 lambda (most neighbours) some
 * hundred products suffice, and the answer is a preconditioner, which wants no last digits. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "internal.h"

enum { MAX_CELLS = 1 << 24, MAX_PRODUCTS = 2000 };
#define ENOUGH 1e-9 /* of the residual, relative to the right-hand side */

struct Graph {
    uint32_t n, *first, *neighbour; /* of cell i: neighbour[first[i] .. first[i + 1] - 1], ascending */
    double lambda, *x, *r, *p, *q;  /* [n] each */
};

static int by_number(const void *a, const void *b) {
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

/* Each pair once, whatever the faces that share it: rows are filled, sorted and thinned. */
static void make_rows(Graph *g, const uint32_t *edges, size_t nedges) {
    for (size_t e = 0; e < 2 * nedges; e++) g->first[edges[e] + 1]++;
    for (uint32_t i = 0; i < g->n; i++) g->first[i + 1] += g->first[i];
    for (size_t e = 0; e < nedges; e++)
        for (int end = 0; end < 2; end++) g->neighbour[g->first[edges[2 * e + end]]++] = edges[2 * e + 1 - end];
    uint32_t to = 0, from = 0;
    for (uint32_t i = 0; i < g->n; i++) { /* first[i] is the end of row i now */
        uint32_t end = g->first[i], start = to;
        qsort(g->neighbour + from, end - from, sizeof *g->neighbour, by_number);
        for (uint32_t k = from; k < end; k++)
            if (g->neighbour[k] != i && (to == start || g->neighbour[to - 1] != g->neighbour[k]))
                g->neighbour[to++] = g->neighbour[k];
        g->first[i] = start, from = end;
    }
    g->first[g->n] = to;
}

Graph *graph_create(uint32_t cells, const uint32_t *edges, size_t nedges, double lambda, SltError *err) {
    if (cells < 1 || cells > MAX_CELLS || nedges > UINT32_MAX / 2 || !(lambda >= 0) || isinf(lambda)) {
        status_fail(err, cells > MAX_CELLS ? SLT_LIMIT : SLT_USAGE,
                    "a graph Laplacian of %u cells (at most 2^24) and %zu edges with lambda %g", cells, nedges, lambda);
        return NULL;
    }
    for (size_t e = 0; e < 2 * nedges; e++)
        if (edges[e] >= cells) {
            status_fail(err, SLT_USAGE, "an edge of a graph goes to cell %u, and there are %u", edges[e], cells);
            return NULL;
        }
    Graph *g = calloc(1, sizeof *g);
    if (g) {
        g->n = cells, g->lambda = lambda;
        g->first = calloc((size_t)cells + 1, sizeof *g->first);
        g->neighbour = malloc((2 * nedges + 1) * sizeof *g->neighbour);
        g->x = malloc(4 * (size_t)cells * sizeof *g->x);
        if (g->first && g->neighbour && g->x) {
            g->r = g->x + cells, g->p = g->r + cells, g->q = g->p + cells;
            make_rows(g, edges, nedges);
            return g;
        }
    }
    graph_free(g);
    status_fail(err, SLT_LIMIT, "out of memory for a graph Laplacian of %u cells", cells);
    return NULL;
}

void graph_free(Graph *g) {
    if (!g) return;
    free(g->first), free(g->neighbour), free(g->x);
    free(g);
}

/* q := (I + lambda L) p, and p . q */
static double product(const Graph *g) {
    double dot = 0;
    for (uint32_t i = 0; i < g->n; i++) {
        double sum = 0;
        uint32_t end = g->first[i + 1];
        for (uint32_t k = g->first[i]; k < end; k++) sum += g->p[g->neighbour[k]];
        g->q[i] = g->p[i] + g->lambda * ((end - g->first[i]) * g->p[i] - sum);
        dot += g->p[i] * g->q[i];
    }
    return dot;
}

void graph_solve(Graph *g, double *data, size_t stride) {
    double size = 0;
    for (uint32_t i = 0; i < g->n; i++) {
        g->x[i] = 0, g->r[i] = g->p[i] = data[i * stride];
        size += g->r[i] * g->r[i];
    }
    double now = size;
    for (int k = 0; k < MAX_PRODUCTS && now > ENOUGH * ENOUGH * size; k++) {
        double along = now / product(g), next = 0;
        for (uint32_t i = 0; i < g->n; i++) {
            g->x[i] += along * g->p[i], g->r[i] -= along * g->q[i];
            next += g->r[i] * g->r[i];
        }
        for (uint32_t i = 0; i < g->n; i++) g->p[i] = g->r[i] + next / now * g->p[i];
        now = next;
    }
    for (uint32_t i = 0; i < g->n; i++) data[i * stride] = g->x[i];
}

uint64_t graph_hash(const Graph *g, uint64_t h) {
    uint64_t v = h;
    for (uint32_t i = 0; i <= g->n; i++) v = (v ^ g->first[i]) * 0x100000001b3u;
    for (uint32_t k = 0; k < g->first[g->n]; k++) v = (v ^ g->neighbour[k]) * 0x100000001b3u;
    return v;
}
