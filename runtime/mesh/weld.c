/* Vertices that lie at one place become one. */
#include "internal.h"

#include <stdlib.h>
#include <string.h>

/* 0 for both zeros, so that what is equal has equal bits. */
static void key_of(const double p[3], uint32_t part, uint64_t key[4]) {
    for (int a = 0; a < 3; a++) {
        double v = p[a] + 0.0;
        memcpy(&key[a], &v, sizeof v);
    }
    key[3] = part;
}

static uint64_t hash_of(const uint64_t key[4]) {
    uint64_t h = 0x9e3779b97f4a7c15u;
    for (int k = 0; k < 4; k++) h = (h ^ key[k]) * 0xff51afd7ed558ccdu, h ^= h >> 32;
    return h;
}

bool mesh_weld(Mesh *m, uint32_t *vertex_part) {
    size_t size = 16;
    while (size < 2 * (size_t)m->nvertices) size *= 2;
    uint32_t *table = malloc(size * sizeof *table), *to = malloc((m->nvertices + 1u) * sizeof *to), n = 0;
    uint32_t *part = calloc(m->nvertices + 1u, sizeof *part);
    bool *seen = calloc(m->nvertices + 1u, sizeof *seen);
    bool ok = table && to && part && seen;
    if (ok) memset(table, 0xff, size * sizeof *table);
    for (size_t k = 0; ok && k < 3 * (size_t)m->nfaces; k++) { /* of the first face that has it */
        uint32_t v = m->face[k];
        if (!seen[v]) seen[v] = true, part[v] = m->part[k / 3];
    }
    for (uint32_t v = 0; ok && v < m->nvertices; v++) {
        uint64_t key[4], other[4];
        key_of(m->position + 3 * (size_t)v, part[v], key);
        size_t at = hash_of(key) & (size - 1);
        for (; table[at] != UINT32_MAX; at = (at + 1) & (size - 1)) {
            key_of(m->position + 3 * (size_t)table[at], vertex_part[table[at]], other);
            if (!memcmp(key, other, sizeof key)) break;
        }
        if (table[at] == UINT32_MAX) {
            memmove(m->position + 3 * (size_t)n, m->position + 3 * (size_t)v, 3 * sizeof *m->position);
            vertex_part[n] = part[v], table[at] = n++;
        }
        to[v] = table[at];
    }
    for (size_t k = 0; ok && k < 3 * (size_t)m->nfaces; k++) m->face[k] = to[m->face[k]];
    if (ok) m->nvertices = n;
    free(table), free(to), free(part), free(seen);
    return ok;
}
