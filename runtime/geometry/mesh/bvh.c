/* Making and refitting trees of boxes. */
#include "bvh.h"

#include <float.h>
#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#define FAR 1e29 /* coordinates, of what is met: squares of boxes in single precision and t of rays stay in range */

enum { BINS = 16, PAGE = 1 << 21 /* a huge one */ };

typedef struct Box {
    float lo[3], hi[3];
} Box;

/* What is sorted into a tree. */
typedef struct Item {
    Box box;
    uint32_t triangle;
} Item;

static const Box nothing = {{HUGE_VALF, HUGE_VALF, HUGE_VALF}, {-HUGE_VALF, -HUGE_VALF, -HUGE_VALF}};

static void box_add(Box *b, const Box *o) {
    for (int a = 0; a < 3; a++) {
        if (o->lo[a] < b->lo[a]) b->lo[a] = o->lo[a];
        if (o->hi[a] > b->hi[a]) b->hi[a] = o->hi[a];
    }
}

/* Half of its surface; 0 where it is empty. */
static double box_area(const Box *b) {
    double d[3];
    for (int a = 0; a < 3; a++) {
        if (!(b->hi[a] >= b->lo[a])) return 0;
        d[a] = (double)b->hi[a] - (double)b->lo[a];
    }
    return d[0] * d[1] + d[1] * d[2] + d[2] * d[0];
}

/* Floats on either side of v, at most two units in their last place away; without a decision, unlike nextafterf. */
static inline float below(double v) {
    const float f = (float)v;
    return f - (fabsf(f) * 0x1p-23f + FLT_MIN);
}
static inline float above(double v) { return -below(-v); }

/* The corners of a triangle, and its box. False: one is not finite, or beyond what a float holds. */
static inline bool triangle_box(const Bvh *b, const void *values, uint32_t triangle, bool f64, double at[3][3],
                                Box *out) {
    const int32_t *face = b->face + 3 * (size_t)triangle;
    bool fine = true;
    for (int a = 0; a < 3; a++) {
        for (int c = 0; c < 3; c++) {
            const size_t i = 3 * (size_t)face[c] + (size_t)a;
            at[c][a] = f64 ? ((const double *)values)[i] : (double)((const float *)values)[i];
        }
        const double p = at[0][a], q = at[1][a], r = at[2][a];
        double lo = q < p ? q : p, hi = q > p ? q : p;
        lo = r < lo ? r : lo, hi = r > hi ? r : hi;
        if (!(fabs(p) + fabs(q) + fabs(r) <= 3 * FAR)) fine = false, lo = hi = 0;
        out->lo[a] = f64 ? below(lo) : (float)lo, out->hi[a] = f64 ? above(hi) : (float)hi;
    }
    return fine;
}

/* ---- making */

typedef struct Maker {
    Bvh *b;
    Item *item;
    uint32_t node_room, leaf_room;
    bool failed;
} Maker;

typedef struct Range {
    uint32_t from, to;
    Box box;
} Range;

static float centre(const Item *i, int a) { return 0.5f * i->box.lo[a] + 0.5f * i->box.hi[a]; }

static Box box_of(const Item *item, uint32_t from, uint32_t to) {
    Box b = nothing;
    for (uint32_t i = from; i < to; i++) box_add(&b, &item[i].box);
    return b;
}

static int bin_of(float at, float lo, float scale) {
    float n = (at - lo) * scale;
    return n >= (float)(BINS - 1) ? BINS - 1 : n > 0 ? (int)n : 0;
}

static int by_triangle(const void *x, const void *y) {
    uint32_t a = ((const Item *)x)->triangle, b = ((const Item *)y)->triangle;
    return (a > b) - (a < b);
}

/* Parts r into two by the axis and the plane of least cost; where centres coincide, by number. */
static uint32_t part(Maker *m, const Range *r, bool halve) {
    Box centres = nothing;
    for (uint32_t i = r->from; i < r->to; i++)
        for (int a = 0; a < 3; a++) {
            float c = centre(&m->item[i], a);
            if (c < centres.lo[a]) centres.lo[a] = c;
            if (c > centres.hi[a]) centres.hi[a] = c;
        }
    double least = HUGE_VAL;
    int axis = -1, plane = 0;
    for (int a = 0; a < 3 && !halve; a++) {
        float width = centres.hi[a] - centres.lo[a], scale = (float)BINS / width;
        if (!(width > 0) || !(scale < HUGE_VALF)) continue;
        Box bin[BINS], right[BINS], left = nothing;
        uint32_t count[BINS] = {0}, n = 0;
        for (int k = 0; k < BINS; k++) bin[k] = nothing;
        for (uint32_t i = r->from; i < r->to; i++) {
            int k = bin_of(centre(&m->item[i], a), centres.lo[a], scale);
            box_add(&bin[k], &m->item[i].box), count[k]++;
        }
        right[BINS - 1] = bin[BINS - 1];
        for (int k = BINS - 1; k-- > 0;) right[k] = right[k + 1], box_add(&right[k], &bin[k]);
        for (int k = 0; k + 1 < BINS; k++) {
            box_add(&left, &bin[k]), n += count[k];
            double cost = box_area(&left) * n + box_area(&right[k + 1]) * (r->to - r->from - n);
            if (n && n < r->to - r->from && cost < least) least = cost, axis = a, plane = k;
        }
    }
    uint32_t middle = r->from;
    if (axis >= 0) {
        float scale = (float)BINS / (centres.hi[axis] - centres.lo[axis]);
        for (uint32_t i = r->from; i < r->to; i++) {
            if (bin_of(centre(&m->item[i], axis), centres.lo[axis], scale) > plane) continue;
            Item x = m->item[i];
            m->item[i] = m->item[middle], m->item[middle++] = x;
        }
        return middle;
    }
    qsort(m->item + r->from, r->to - r->from, sizeof *m->item, by_triangle);
    return r->from + (r->to - r->from) / 2;
}

static bool room(void **data, uint32_t n, uint32_t *capacity, size_t size) {
    if (n < *capacity) return true;
    uint32_t want = n ? 2 * n : 64;
    const size_t align = want * size < PAGE ? 64 : PAGE, bytes = (want * size + align - 1) / align * align;
    void *fresh = aligned_alloc(align, bytes);
    if (!fresh) return false;
#if defined(MADV_HUGEPAGE)
    if (align == PAGE) madvise(fresh, bytes, MADV_HUGEPAGE); /* rays jump: a large tree has more pages than are known */
#endif
    if (*data) memcpy(fresh, *data, n * size);
    free(*data);
    *data = fresh, *capacity = want;
    return true;
}

static size_t leaf_size(const Bvh *b) { return b->f64 ? sizeof(BvhLeaf64) : sizeof(BvhLeaf32); }

static int32_t *leaf_triangles(const Bvh *b, uint32_t leaf) {
    return b->f64 ? ((BvhLeaf64 *)b->leaf)[leaf].triangle : ((BvhLeaf32 *)b->leaf)[leaf].triangle;
}

static int32_t make_leaf(Maker *m, const Range *r) {
    Bvh *b = m->b;
    if (!room(&b->leaf, b->nleaves, &m->leaf_room, leaf_size(b))) return m->failed = true, -1;
    int32_t *triangle = leaf_triangles(b, b->nleaves);
    for (uint32_t k = 0; k < BVH_LEAF; k++)
        triangle[k] = r->from + k < r->to ? (int32_t)m->item[r->from + k].triangle : -1;
    return ~(int32_t)b->nleaves++;
}

static int32_t make_node(Maker *m, const Range *whole, uint32_t depth) {
    Bvh *b = m->b;
    void *nodes = b->node;
    if (!room(&nodes, b->nnodes, &m->node_room, sizeof *b->node)) return m->failed = true, 0;
    b->node = nodes;
    uint32_t number = b->nnodes++, n = 1;
    Range child[BVH_WIDTH] = {*whole};
    /* Deep down halves are equal, so that the tree ends: 8^10 leaves of 8 are more than there are triangles. */
    bool halve = depth >= BVH_DEPTH - 12;
    while (n < BVH_WIDTH) {
        int best = -1;
        double most = -1;
        for (uint32_t k = 0; k < n; k++) {
            uint32_t count = child[k].to - child[k].from;
            double size = halve ? count : box_area(&child[k].box);
            if (count > BVH_LEAF && size > most) most = size, best = (int)k;
        }
        if (best < 0) break;
        Range *r = &child[best], *other = &child[n++];
        uint32_t middle = part(m, r, halve);
        *other = (Range){middle, r->to, box_of(m->item, middle, r->to)};
        *r = (Range){r->from, middle, box_of(m->item, r->from, middle)};
    }
    for (uint32_t k = 0; k < BVH_WIDTH; k++) {
        int32_t made = 0;
        if (k < n && child[k].to > child[k].from && !m->failed)
            made =
                child[k].to - child[k].from <= BVH_LEAF ? make_leaf(m, &child[k]) : make_node(m, &child[k], depth + 1);
        const Box *box = k < n ? &child[k].box : &nothing;
        for (int a = 0; a < 3; a++) b->node[number].lo[a][k] = box->lo[a], b->node[number].hi[a][k] = box->hi[a];
        b->node[number].child[k] = made;
    }
    return (int32_t)number;
}

/* ---- refitting */

/* Copies the corners of a leaf's triangles. */
static inline Box fill_leaf(Bvh *b, uint32_t leaf, const void *values, bool f64) {
    Box box = nothing;
    const int32_t *triangle = leaf_triangles(b, leaf);
    for (int k = 0; k < BVH_LEAF; k++) {
        Box own;
        double at[3][3];
        const bool is = triangle[k] >= 0 && triangle_box(b, values, (uint32_t)triangle[k], f64, at, &own);
        if (is) box_add(&box, &own);
        else b->unmet += triangle[k] >= 0;
        for (int c = 0; c < 3; c++)
            for (int a = 0; a < 3; a++) {
                const double v = is ? at[c][a] : (double)NAN;
                if (f64) ((BvhLeaf64 *)b->leaf)[leaf].at[c][a][k] = v;
                else ((BvhLeaf32 *)b->leaf)[leaf].at[c][a][k] = (float)v;
            }
    }
    return box;
}

static Box node_box(const BvhNode *n) {
    Box b = nothing;
    for (int k = 0; k < BVH_WIDTH; k++)
        for (int a = 0; a < 3; a++) {
            if (n->lo[a][k] < b.lo[a]) b.lo[a] = n->lo[a][k];
            if (n->hi[a][k] > b.hi[a]) b.hi[a] = n->hi[a][k];
        }
    return b;
}

static bool has_child(const BvhNode *n, int k) { return n->child[k]; } /* the root, node 0, is no child */

static inline void fit_as(Bvh *b, const void *values, bool f64) {
    double cost = 0;
    b->unmet = 0;
    for (uint32_t i = b->nnodes; i-- > 0;) {
        BvhNode *n = &b->node[i];
        for (int k = 0; k < BVH_WIDTH; k++) {
            if (!has_child(n, k)) continue;
            Box box =
                n->child[k] < 0 ? fill_leaf(b, (uint32_t)~n->child[k], values, f64) : node_box(&b->node[n->child[k]]);
            for (int a = 0; a < 3; a++) n->lo[a][k] = box.lo[a], n->hi[a][k] = box.hi[a];
            cost += box_area(&box) * (n->child[k] < 0 ? 2 : 1);
        }
    }
    Box all = node_box(&b->node[0]);
    double area = box_area(&all);
    b->cost = area > 0 ? cost / area : 0;
    b->magnitude = 0;
    for (int a = 0; a < 3; a++)
        if (all.hi[a] >= all.lo[a])
            b->magnitude = fmax(b->magnitude, fmax(fabs((double)all.lo[a]), fabs((double)all.hi[a])));
}

static void fit(Bvh *b, const void *values) {
    static atomic_uint_fast64_t versions;
    b->version = 1 + atomic_fetch_add(&versions, 1);
    if (b->f64) fit_as(b, values, true);
    else fit_as(b, values, false);
}

bool bvh_make(Bvh *b, const void *values, bool f64, const int32_t *face, uint32_t nfaces) {
    *b = (Bvh){.f64 = f64, .face = face, .nfaces = nfaces};
    Maker m = {.b = b, .item = malloc((nfaces ? nfaces : 1) * sizeof *m.item)};
    if (!m.item) return false;
    for (uint32_t i = 0; i < nfaces; i++) {
        m.item[i].triangle = i;
        double at[3][3];
        if (!triangle_box(b, values, i, f64, at, &m.item[i].box))
            m.item[i].box = (Box){0}; /* it may be finite later on */
    }
    make_node(&m, &(Range){0, nfaces, box_of(m.item, 0, nfaces)}, 0);
    free(m.item);
    if (m.failed) return bvh_free(b), false;
    fit(b, values);
    b->made = b->cost;
    return true;
}

bool bvh_follow(Bvh *b, const void *values) {
    fit(b, values);
    if (b->cost <= 4.0 / 3.0 * b->made) return true;
    Bvh fresh;
    if (!bvh_make(&fresh, values, b->f64, b->face, b->nfaces)) return false;
    bvh_free(b);
    *b = fresh;
    return true;
}

void bvh_free(Bvh *b) {
    free(b->node), free(b->leaf);
    b->node = NULL, b->leaf = NULL, b->nnodes = b->nleaves = 0;
}

size_t bvh_bytes(const Bvh *b) { return b->nnodes * sizeof *b->node + b->nleaves * leaf_size(b); }
