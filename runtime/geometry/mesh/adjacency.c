/* Half-edges sorted by their ends. */
#include "adjacency.h"

#include <stdlib.h>
#include <string.h>

/* A half-edge at its lower vertex. */
typedef struct Half {
    int32_t upper, half;
} Half;

static int by_upper(const void *x, const void *y) {
    const Half *a = x, *b = y;
    if (a->upper != b->upper) return a->upper < b->upper ? -1 : 1;
    return (a->half > b->half) - (a->half < b->half);
}

/* A face of which two corners are one vertex is none: no ray meets it, wherever its vertices go. */
static bool is_face(const int32_t *corner) {
    return corner[0] != corner[1] && corner[1] != corner[2] && corner[2] != corner[0];
}

/* Those of vertex v: row[start[v]], ..., row[start[v + 1] - 1], sorted. */
static void sort_halves(const int32_t *face, uint32_t nfaces, uint32_t nvertices, uint32_t *start, Half *row) {
    for (int fill = 0; fill < 2; fill++) {
        for (uint32_t h = 0; h < 3 * nfaces; h++) {
            if (!is_face(face + (h - h % 3))) continue;
            const int32_t a = face[h], b = face[h - h % 3 + (h + 1) % 3], lower = a < b ? a : b;
            if (fill) row[start[lower]++] = (Half){a < b ? b : a, (int32_t)h};
            else start[lower + 1]++;
        }
        /* Counts become starts; filling moved each to its end, which is where the next one starts. */
        for (uint32_t v = 0; v < nvertices && !fill; v++) start[v + 1] += start[v];
    }
    memmove(start + 1, start, nvertices * sizeof *start);
    start[0] = 0;
    for (uint32_t v = 0; v < nvertices; v++) qsort(row + start[v], start[v + 1] - start[v], sizeof *row, by_upper);
}

static uint32_t same_edge(const Half *row, uint32_t from, uint32_t to) {
    uint32_t n = 1;
    while (from + n < to && row[from + n].upper == row[from].upper) n++;
    return n;
}

static void pair(Adjacency *a, const Half *half, uint32_t n) {
    for (uint32_t k = 0; k < n; k++) a->across[half[k].half] = n == 1 ? ADJACENCY_BORDER : ADJACENCY_MANY;
    if (n == 2) a->across[half[0].half] = half[1].half, a->across[half[1].half] = half[0].half;
}

static void list_ends(Adjacency *a, const uint32_t *start, const Half *row, bool fill) {
    for (uint32_t v = 0; v < a->nvertices; v++)
        for (uint32_t i = start[v], n; i < start[v + 1]; i += n) {
            n = same_edge(row, i, start[v + 1]);
            const uint32_t ends[2] = {v, (uint32_t)row[i].upper};
            if (!fill) pair(a, row + i, n);
            for (int k = 0; k < 2; k++)
                if (fill) a->end[a->first[ends[k]]++] = (int32_t)ends[!k];
                else a->first[ends[k] + 1]++;
        }
}

bool adjacency_make(Adjacency *a, const int32_t *face, uint32_t nfaces, uint32_t nvertices) {
    const size_t halves = 3 * (size_t)nfaces;
    *a = (Adjacency){.nvertices = nvertices, .nfaces = nfaces};
    uint32_t *start = calloc((size_t)nvertices + 1, sizeof *start);
    Half *row = malloc((halves + 1) * sizeof *row);
    a->across = malloc((halves + 1) * sizeof *a->across);
    a->first = calloc((size_t)nvertices + 1, sizeof *a->first);
    bool ok = start && row && a->across && a->first;
    if (ok) {
        sort_halves(face, nfaces, nvertices, start, row);
        for (uint32_t h = 0; h < halves; h++) a->across[h] = ADJACENCY_MANY;
        list_ends(a, start, row, false);
        for (uint32_t v = 0; v < nvertices; v++) a->first[v + 1] += a->first[v];
        a->end = malloc(((size_t)a->first[nvertices] + 1) * sizeof *a->end);
        ok = a->end;
    }
    if (ok) {
        /* Edges to lower vertices come first, in their order, so each list ascends. */
        list_ends(a, start, row, true);
        memmove(a->first + 1, a->first, nvertices * sizeof *a->first);
        a->first[0] = 0;
    }
    free(start), free(row);
    if (!ok) adjacency_free(a);
    return ok;
}

void adjacency_free(Adjacency *a) {
    free(a->across), free(a->first), free(a->end);
    *a = (Adjacency){0};
}

size_t adjacency_bytes(const Adjacency *a) {
    if (!a->first) return 0;
    return 3 * (size_t)a->nfaces * sizeof *a->across + ((size_t)a->nvertices + 1) * sizeof *a->first +
           a->first[a->nvertices] * sizeof *a->end;
}
