/* Cones of normals, from the leaves up. */
#include "cones.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "vec.h"

#define WIDER 1e-6 /* than numbers in floats may be off by rounding */
#define LEAST 0.1  /* cosine of a cone that is of use */

typedef struct Made {
    const Bvh *b;
    const Adjacency *adjacency;
    const void *values;
    bool one_way;
    double (*plane)[4]; /* of each face: its normal, of unit length, and n . x on it; NaN where it has none */
} Made;

static void corner_of(const Made *m, uint32_t face, uint32_t k, double at[3]) {
    const size_t from = 3 * (size_t)m->b->face[3 * (size_t)face + k];
    for (size_t a = 0; a < 3; a++)
        at[a] = m->b->f64 ? ((const double *)m->values)[from + a] : (double)((const float *)m->values)[from + a];
}

static void find_planes(const Made *m) {
    for (uint32_t f = 0; f < m->b->nfaces; f++) {
        double at[3][3], way[2][3], normal[3];
        for (uint32_t k = 0; k < 3; k++) corner_of(m, f, k, at[k]);
        for (int k = 0; k < 2; k++) vec_minus(at[k + 1], at[0], way[k]);
        vec_cross(way[0], way[1], normal);
        const double length = sqrt(vec_dot(normal, normal));
        for (int a = 0; a < 3; a++) m->plane[f][a] = length > 0 ? normal[a] / length : (double)NAN;
        m->plane[f][3] = vec_dot(m->plane[f], at[0]);
    }
}

/* One child's, in doubles. */
typedef struct Cone {
    double axis[3], middle[3], cosine, sine, off;
} Cone;

static void set_cosine(Cone *c, double cosine) {
    c->cosine = cosine - WIDER, c->sine = sqrt(fmax(0, 1 - cosine * cosine)) + WIDER;
}

/* What is kept is in floats, and what follows is computed from that. */
static void set_axis(Cone *c, const double sum[3]) {
    const double length = sqrt(vec_dot(sum, sum));
    for (int a = 0; a < 3; a++) c->axis[a] = (double)(float)(sum[a] / length);
}

/* Faces whose normals count, of a leaf: its own and those across their edges. 0: a shadow may end at their edges from
 * wherever they are seen. */
static uint32_t faces_of(const Made *m, int32_t leaf, uint32_t face[4 * BVH_LEAF]) {
    const int32_t *own =
        m->b->f64 ? ((const BvhLeaf64 *)m->b->leaf)[leaf].triangle : ((const BvhLeaf32 *)m->b->leaf)[leaf].triangle;
    uint32_t n = 0;
    for (int k = 0; k < BVH_LEAF; k++) {
        if (own[k] < 0) continue;
        face[n++] = (uint32_t)own[k];
        for (size_t e = 0; e < 3; e++) {
            const size_t half = 3 * (size_t)own[k] + e;
            const int32_t other = m->adjacency->across[half];
            if (other < 0 || (!m->one_way && m->b->face[other] == m->b->face[half])) return 0;
            face[n++] = (uint32_t)other / 3;
        }
    }
    return n;
}

static void cone_of_leaf(const Made *m, int32_t leaf, Cone *c) {
    uint32_t face[4 * BVH_LEAF];
    const uint32_t n = faces_of(m, leaf, face);
    double sum[3] = {0}, least = 1;
    if (!n) {
        c->off = HUGE_VAL;
        return;
    }
    for (uint32_t k = 0; k < n; k++) vec_add(sum, 1, m->plane[face[k]]);
    set_axis(c, sum);
    c->off = 0;
    for (uint32_t k = 0; k < n; k++) {
        const double *plane = m->plane[face[k]], cosine = vec_dot(plane, c->axis),
                     off = fabs(vec_dot(plane, c->middle) - plane[3]);
        if (!(cosine > LEAST)) {
            c->off = HUGE_VAL;
            return;
        }
        least = cosine < least ? cosine : least, c->off = off > c->off ? off : c->off;
    }
    set_cosine(c, least);
}

static void read_cone(const ConeNode *n, int k, Cone *c) {
    for (int a = 0; a < 3; a++) c->axis[a] = n->axis[a][k], c->middle[a] = n->middle[a][k];
    c->cosine = n->cosine[k], c->sine = n->sine[k], c->off = n->off[k];
}

static void cone_of_node(const BvhNode *n, const ConeNode *below, Cone *c) {
    double sum[3] = {0}, least = 1;
    Cone of[BVH_WIDTH];
    c->off = 0;
    for (int k = 0; k < BVH_WIDTH; k++) {
        if (!n->child[k]) continue;
        read_cone(below, k, &of[k]);
        vec_add(sum, 1, of[k].axis);
        if (!(of[k].off < HUGE_VAL)) c->off = HUGE_VAL;
    }
    if (!(c->off < HUGE_VAL)) return;
    set_axis(c, sum);
    for (int k = 0; k < BVH_WIDTH; k++) {
        if (!n->child[k]) continue;
        /* The angle between both axes, and of both cones' own. Planes: by how far middles are apart, along n. */
        double product[3], way[3];
        const double between = vec_dot(c->axis, of[k].axis);
        vec_cross(c->axis, of[k].axis, product);
        const double cosine = between * of[k].cosine - sqrt(vec_dot(product, product)) * of[k].sine;
        vec_minus(of[k].middle, c->middle, way);
        vec_cross(way, of[k].axis, product);
        const double off = of[k].off + fabs(vec_dot(way, of[k].axis)) + sqrt(vec_dot(product, product)) * of[k].sine;
        if (!(cosine > LEAST)) {
            c->off = HUGE_VAL;
            return;
        }
        least = cosine < least ? cosine : least, c->off = off > c->off ? off : c->off;
    }
    set_cosine(c, least);
}

static void set_child(const Made *m, ConeNode *node, uint32_t i, int k) {
    const BvhNode *n = &m->b->node[i];
    Cone c = {.cosine = 1};
    for (int a = 0; a < 3; a++) c.middle[a] = (double)(0.5f * n->lo[a][k] + 0.5f * n->hi[a][k]);
    if (n->child[k] < 0) cone_of_leaf(m, ~n->child[k], &c);
    else cone_of_node(&m->b->node[n->child[k]], &node[n->child[k]], &c);
    for (int a = 0; a < 3; a++) node[i].axis[a][k] = (float)c.axis[a], node[i].middle[a][k] = (float)c.middle[a];
    node[i].cosine[k] = (float)c.cosine, node[i].sine[k] = (float)c.sine;
    node[i].off[k] = c.off < (double)1e30f ? (float)(c.off * (1 + WIDER)) : HUGE_VALF; /* also of NaN */
}

static bool all_one_way(const Bvh *b, const Adjacency *a) {
    for (size_t half = 0; half < 3 * (size_t)b->nfaces; half++)
        if (a->across[half] >= 0 && b->face[a->across[half]] == b->face[half]) return false;
    return true;
}

void cones_follow(Cones *c, const Bvh *b, const Adjacency *a, const void *values) {
    if (c->n != b->nnodes) {
        cones_free(c);
        c->node = calloc(b->nnodes, sizeof *c->node);
        c->n = c->node ? b->nnodes : 0;
        c->one_way = all_one_way(b, a);
    }
    const Made m = {.b = b,
                    .adjacency = a,
                    .values = values,
                    .one_way = c->one_way,
                    .plane = malloc((b->nfaces ? b->nfaces : 1) * sizeof *m.plane)};
    if (!m.plane || !c->node) {
        free(m.plane), cones_free(c);
        return;
    }
    find_planes(&m);
    for (uint32_t i = b->nnodes; i-- > 0;)
        for (int k = 0; k < BVH_WIDTH; k++)
            if (b->node[i].child[k]) set_child(&m, c->node, i, k);
            else c->node[i].off[k] = HUGE_VALF;
    free(m.plane);
}

void cones_free(Cones *c) {
    free(c->node);
    *c = (Cones){0};
}
