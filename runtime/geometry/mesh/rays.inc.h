/* One ray at a time against eight boxes or eight triangles. Include with F64 set, behind lanes.h.
 *
 * A triangle is tested in the space of the ray (Woop, Benthin, Wald 2013): its corners are moved to the ray's origin
 * and sheared so that the ray is an axis, each rounded once, alike for all triangles that share the corner. Of floats
 * the edge functions are products of two floats in double: their signs are exact, and a ray that is inside of one side
 * of an edge is outside of the other, or on both. Of doubles they are rounded, alike seen from both sides of an edge.
 * Then t is a mean of the corners' t, so it lies between them.
 *
 * The first hit does not depend on the tree: boxes are widened by more than all that rounding may move, and of equal t
 * the lowest triangle wins. */
#define shear FN(shear)
#define Ray FN(BvhRay)
#define ray_set FN(ray_set)
#define meet_boxes FN(meet_boxes)
#define meet_leaf FN(meet_leaf)
#define meet_moved FN(meet_moved)
#define meet FN(meet)
#define descend FN(descend)
#define search FN(search)
#define Leaf FN(BvhLeafOf)

#if F64
typedef BvhLeaf64 Leaf;
#else
typedef BvhLeaf32 Leaf;
#endif

typedef struct Ray {
    flt o[3], d[3], t0, t1;
    flt near[3], far[3], inverse[3]; /* a box is entered at (its nearer side - near) * inverse */
    bool down[3];                    /* d < 0 */
    int kx, ky, kz;                  /* kz: the longest axis of d */
    flt sx, sy, sz;
} Ray;

/* False: nothing can be met. */
INLINE bool ray_set(Ray *r, const BvhScene *s, const flt *rays, uint32_t width) {
    const flt huge = F64 ? (flt)1e300 : (flt)1e30;
    double size = s->bvh->magnitude + s->slack;
    for (int a = 0; a < 3; a++) {
        r->o[a] = rays[(size_t)a * width], r->d[a] = rays[(size_t)(a + 3) * width];
        if (!(fabs((double)r->o[a]) < (double)huge) || !(fabs((double)r->d[a]) < (double)huge)) return false;
        size = fmax(size, fabs((double)r->o[a]));
    }
    r->t0 = rays[(size_t)6 * width], r->t1 = rays[(size_t)7 * width];
    if (!(r->t0 <= r->t1)) return false;
    /* Corners less origins are rounded, then sheared: a few units in the last place of the longest of them. */
    const flt wide = (flt)(size * (F64 ? 0x1p-48 : 0x1p-20) + s->slack);
    for (int a = 0; a < 3; a++) {
        r->inverse[a] = 1 / r->d[a];
        r->down[a] = r->inverse[a] < 0;
        r->near[a] = r->o[a] + (r->down[a] ? -wide : wide), r->far[a] = r->o[a] - (r->down[a] ? -wide : wide);
    }
    r->kz = fabs((double)r->d[1]) > fabs((double)r->d[0]) ? 1 : 0;
    if (fabs((double)r->d[2]) > fabs((double)r->d[r->kz])) r->kz = 2;
    if (r->d[r->kz] == 0) return false;
    r->kx = (r->kz + 1) % 3, r->ky = (r->kx + 1) % 3;
    r->sx = r->d[r->kx] / r->d[r->kz], r->sy = r->d[r->ky] / r->d[r->kz], r->sz = 1 / r->d[r->kz];
    return r->sz < huge && r->sz > -huge;
}

/* Which of the node's boxes the ray passes before t; *enter: where. */
INLINE uint32_t meet_boxes(const BvhNode *n, const Ray *r, flt t, Flt8 *enter) {
    Flt8 in = (Flt8){0} + r->t0, out = (Flt8){0} + t;
    for (int a = 0; a < 3; a++) {
        typedef float Row __attribute__((vector_size(32), aligned(32)));
        const Row *close = (const Row *)(r->down[a] ? n->hi[a] : n->lo[a]),
                  *away = (const Row *)(r->down[a] ? n->lo[a] : n->hi[a]);
        Flt8 from = (__builtin_convertvector(*close, Flt8) - r->near[a]) * r->inverse[a],
             to = (__builtin_convertvector(*away, Flt8) - r->far[a]) * r->inverse[a];
        keep_max(&in, &from);
        keep_min(&out, &to);
    }
    Int8 pass = in <= out;
    *enter = in;
    return bits(&pass);
}

/* The sheared corner c of eight triangles: x, y across the ray, z its t. */
INLINE void shear(const Leaf *l, int c, const Ray *r, Flt8 *x, Flt8 *y, Flt8 *z) {
    typedef flt Row __attribute__((vector_size(8 * sizeof(flt)), aligned(32)));
    const Flt8 along = *(const Row *)l->at[c][r->kz] - r->o[r->kz];
    *x = (*(const Row *)l->at[c][r->kx] - r->o[r->kx]) - r->sx * along;
    *y = (*(const Row *)l->at[c][r->ky] - r->o[r->ky]) - r->sy * along;
    *z = r->sz * along;
}

/* Lowers *t and *triangle where the leaf has a nearer hit. */
INLINE void meet_leaf(const Leaf *l, const Ray *r, flt *t, int32_t *triangle) {
    typedef double Wide __attribute__((vector_size(64)));
    typedef int64_t Sign __attribute__((vector_size(64)));
    Flt8 x[3], y[3], z[3];
    for (int c = 0; c < 3; c++) shear(l, c, r, &x[c], &y[c], &z[c]);
    Wide e[3], sum = {0}, at = {0};
    Sign plus = {0}, minus = {0};
    for (int c = 0; c < 3; c++) {
        const int p = (c + 1) % 3, q = (c + 2) % 3;
        e[c] = __builtin_convertvector(x[p], Wide) * __builtin_convertvector(y[q], Wide) -
               __builtin_convertvector(y[p], Wide) * __builtin_convertvector(x[q], Wide);
        plus |= e[c] > 0, minus |= e[c] < 0;
    }
    Sign inside = ~(plus & minus) & (plus | minus);
    int64_t any = 0;
    for (int k = 0; k < 8; k++) any |= inside[k];
    if (!any) return;
    for (int c = 0; c < 3; c++) sum += e[c], at += e[c] * __builtin_convertvector(z[c], Wide);
    Flt8 found = __builtin_convertvector(at / sum, Flt8);
    for (int k = 0; k < 8; k++) {
        if (!inside[k]) continue;
        flt f = found[k], low = z[0][k], high = low;
        for (int c = 1; c < 3; c++) low = z[c][k] < low ? z[c][k] : low, high = z[c][k] > high ? z[c][k] : high;
        f = f < low ? low : f > high ? high : f;
        if (f < r->t0 || !(f < *t || (f == *t && (*triangle < 0 || l->triangle[k] < *triangle)))) continue;
        *t = f, *triangle = l->triangle[k];
    }
}

/* The same where vertices are not those of the tree. */
static void meet_moved(const BvhScene *s, const Leaf *l, const Ray *r, flt *t, int32_t *triangle) {
    _Alignas(32) Leaf now = *l;
    const flt *v = s->moved;
    for (int k = 0; k < BVH_LEAF; k++) {
        if (l->triangle[k] < 0) continue;
        bool finite = true;
        for (int c = 0; c < 3; c++)
            for (int a = 0; a < 3; a++) {
                now.at[c][a][k] = v[3 * (size_t)s->bvh->face[3 * (size_t)l->triangle[k] + (size_t)c] + (size_t)a];
                finite &= fabs((double)now.at[c][a][k]) <= (double)FLT_MAX;
            }
        for (int c = 0; c < 9 && !finite; c++) now.at[c / 3][c % 3][k] = 0;
    }
    meet_leaf(&now, r, t, triangle);
}

INLINE void meet(const BvhScene *s, int32_t leaf, const Ray *r, flt *t, int32_t *triangle) {
    const Leaf *l = (const Leaf *)s->bvh->leaf + leaf;
    if (s->moved) meet_moved(s, l, r, t, triangle);
    else meet_leaf(l, r, t, triangle);
}

static int32_t descend(const BvhScene *s, const Ray *r, bool any) {
    struct Waiting {
        flt enter;
        int32_t child;
    } stack[BVH_STACK];
    uint32_t depth = 0;
    int32_t at = 0, triangle = SLT_WITNESS_NONE;
    flt t = r->t1;
    for (;;) {
        if (at >= 0) {
            typedef struct {
                flt at[8];
            } Enters;
            Flt8 enter;
            const BvhNode *n = &s->bvh->node[at];
            uint32_t hit = meet_boxes(n, r, t, &enter);
            if (hit) {
                Enters in;
                memcpy(&in, &enter, sizeof in);
                int k = __builtin_ctz(hit);
                hit &= hit - 1;
                at = n->child[k];
                flt nearest = in.at[k];
                /* The nearest next; the others wait, the nearest of them on top. */
                uint32_t bottom = depth;
                while (hit) {
                    k = __builtin_ctz(hit);
                    hit &= hit - 1;
                    struct Waiting other = {in.at[k], n->child[k]};
                    if (other.enter < nearest) {
                        struct Waiting first = {nearest, at};
                        nearest = other.enter, at = other.child, other = first;
                    }
                    uint32_t i = depth++;
                    for (; i > bottom && stack[i - 1].enter < other.enter; i--) stack[i] = stack[i - 1];
                    stack[i] = other;
                }
                continue;
            }
        } else {
            meet(s, ~at, r, &t, &triangle);
            if (any && triangle >= 0) return triangle;
        }
        do {
            if (!depth) return triangle;
            depth--;
        } while (stack[depth].enter > t);
        at = stack[depth].child;
    }
}

static void search(const BvhScene *s, const void *rays, uint64_t mask, uint32_t width, bool any, int32_t *witness) {
    for (uint32_t k = 0; k < width; k++) {
        Ray r;
        witness[k] = SLT_WITNESS_NONE;
        if (mask >> k & 1 && ray_set(&r, s, (const flt *)rays + k, width)) witness[k] = descend(s, &r, any);
    }
}
