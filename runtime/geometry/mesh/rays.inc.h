/* Rays against the tree. Include with F64 set, behind lanes.h; first packet.inc.h takes rays that go alike together.
 *
 * A triangle is tested in the space of the ray (Woop, Benthin, Wald 2013): its corners are moved to the ray's origin
 * and sheared so that the ray is an axis, each rounded once, alike for all triangles that share the corner. The ray is
 * inside where no two of the edge functions, differences of two products, have opposite signs. Rounded products of
 * different size tell the sign exactly, since rounding is monotone: most triangles are left so. For the others
 * products of two floats are taken in double, which is exact: a ray that is inside of one side of an edge is outside of
 * the other, or on both. Of doubles products are rounded, alike seen from both sides of an edge. Then t is a mean of
 * the corners' t, so it lies between them.
 *
 * The first hit does not depend on the tree, nor on which rays go together: boxes are widened by more than all that
 * rounding may move, what leaves out triangles leaves out none that the test takes, and of equal t the lowest triangle
 * wins. Boxes are tested in floats, of rays in double too: there t is scaled so that d is near 1. */
#undef flt
#undef FN
#undef Flt8
#undef Flt4
#undef Part
#undef PART
#define FN_JOIN(a, b) a##_##b
#if F64
#define FN(a) FN_JOIN(a, f64)
#define flt double
#define Flt8 D8
#define Part Some
#define PART(f) f##_some
#define Flt4 D4
#else
#define FN(a) FN_JOIN(a, f32)
#define flt float
#define Flt8 F8
#if defined(__AVX__) || !defined(__SSE2__)
#define Part F8
#define PART(f) f##_F8
#else
#define Part F4
#define PART(f) f##_F4
#endif
#define Flt4 F4
#endif
#define Leaf FN(BvhLeafOf)
#define Group FN(BvhGroup)
#define Whole FN(BvhWhole)
#define Narrow FN(BvhNarrow)
#define GROUP FN(BVH_GROUP)
#define Rays FN(BvhRays)
#define set_group FN(set_group)
#define set_rays FN(set_rays)
#define inside FN(inside)
#define may_meet FN(may_meet)
#define meet_one FN(meet_one)
#define meet_those FN(meet_those)
#define moved_leaf FN(moved_leaf)
#define take FN(take)
#define pass_boxes FN(pass_boxes)
#define pass_many FN(pass_many)
#define meet_rays FN(meet_rays)
#define meet_each FN(meet_each)
#define fetch FN(fetch)
#define all FN(all)
#define wide FN(wide)
#define of_wide FN(of_wide)
#define wide4 FN(wide4)
#define same_way FN(same_way)
#define search FN(search)
#define after FN(after)

/* Group: rays that are worked on at once; Whole: what its comparisons give; Narrow: as many floats. */
#if F64
typedef BvhLeaf64 Leaf;
typedef D8 Group;
typedef L8 Whole;
typedef F8 Narrow;
#else
typedef BvhLeaf32 Leaf;
typedef Many Group;
typedef Whether Whole;
typedef Many Narrow;
#endif
enum { GROUP = sizeof(Group) / sizeof(flt) };

typedef struct Rays {
    flt o[3][RAYS], d[3][RAYS], t0[RAYS], t[RAYS]; /* t: of the first hit so far */
    double wide[RAYS];                             /* the same before it was rounded */
    flt sx[RAYS], sy[RAYS], sz[RAYS], scale[RAYS];
    float near[3][RAYS], far[3][RAYS], inverse[3][RAYS]; /* a box is entered at (its nearer side - near) * inverse */
    float begin[RAYS], end[RAYS];                        /* t0 and t there, outwards */
    int32_t way[RAYS];                                   /* the longest axis of d, 4 << a where axis a is gone down */
    uint32_t down[3][RAYS];                              /* from a node's lower sides to its nearer ones, in bytes */
    int32_t triangle[RAYS];
} __attribute__((aligned(64))) Rays;

/* ---- rays come */

/* Rays k to k + GROUP - 1, whose rows are there. Bits: of those that can meet anything. */
INLINE uint32_t set_group(Rays *r, const BvhScene *s, uint32_t k) {
    const flt huge = F64 ? (flt)1e300 : (flt)1e30;
    const Group none = {0};
    const Whole sign = (Whole)-none;
    const Group t0 = *(const Group *)(r->t0 + k), t1 = *(const Group *)(r->t + k);
    Group d[3], fast[3], size = (Group){0} + (flt)(s->bvh->magnitude + s->slack);
    uint32_t fine = upto(t0, t1);
    for (int a = 0; a < 3; a++) {
        const Group away = (Group)((Whole) * (const Group *)(r->o[a] + k) & ~sign);
        d[a] = *(const Group *)(r->d[a] + k);
        fast[a] = (Group)((Whole)d[a] & ~sign);
        fine &= less(away, none + (flt)1e30) & less(fast[a], none + huge);
        size = higher(away, size);
    }
    const Whole last = under(higher(fast[1], fast[0]), fast[2]), middle = ~last & under(fast[0], fast[1]),
                first = ~(last | middle);
    const Group dz = (Group)((first & (Whole)d[0]) | (middle & (Whole)d[1]) | (last & (Whole)d[2])),
                dx = (Group)((first & (Whole)d[1]) | (middle & (Whole)d[2]) | (last & (Whole)d[0])),
                dy = (Group)((first & (Whole)d[2]) | (middle & (Whole)d[0]) | (last & (Whole)d[1]));
#if F64
    const Group sz = 1 / dz;
#else
    const Group over[3] = {1 / d[0], 1 / d[1], 1 / d[2]};
    const Group sz = (Group)((first & (Whole)over[0]) | (middle & (Whole)over[1]) | (last & (Whole)over[2]));
#endif
    fine &= less(sz, none + huge) & less(none - huge, sz);
    *(Group *)(r->sx + k) = dx / dz, *(Group *)(r->sy + k) = dy / dz, *(Group *)(r->sz + k) = sz;
    /* Corners less origins are rounded, then sheared: a few units in the last place of the longest of them; in floats a
     * few more for the box itself. */
    const Group grown = size * (flt)0x1p-19 + (flt)s->slack,
                wide = lower(grown, (Group){0} + (flt)(0.5f * FLT_MAX)); /* finite: inf - inf would pass empty boxes */
#if F64
    const Whole exponent = (Whole)dz & ((Whole){0} + 0x7ff0000000000000);
    const Group scale = (Group)exponent, against = (Group)(0x7fe0000000000000 - exponent); /* powers of two */
#else
    const Group scale = (Group){0} + 1;
#endif
    *(Group *)(r->scale + k) = scale;
    typedef int32_t Ways __attribute__((vector_size(4 * GROUP)));
    Whole way = (middle & 1) | (last & 2);
    for (int a = 0; a < 3; a++) {
        const Group o = *(const Group *)(r->o[a] + k);
        const Whole down = (Whole)d[a] < 0; /* -0 as well: its inverse is negative */
        const Group outwards = (Group)((Whole)wide ^ (down & sign));
        *(Narrow *)(r->near[a] + k) = __builtin_convertvector(o + outwards, Narrow);
        *(Narrow *)(r->far[a] + k) = __builtin_convertvector(o - outwards, Narrow);
#if F64
        *(Narrow *)(r->inverse[a] + k) = 1 / __builtin_convertvector(d[a] * against, Narrow);
#else
        *(Narrow *)(r->inverse[a] + k) = over[a];
#endif
        way |= down & (4 << a);
        *(Ways *)(r->down[a] + k) = __builtin_convertvector(down & (int)BVH_UPPER, Ways);
    }
    *(Ways *)(r->way + k) = __builtin_convertvector(way, Ways);
    *(Ways *)(r->triangle + k) = (Ways){0} + SLT_WITNESS_NONE;
    const Narrow begin = __builtin_convertvector(t0 * scale, Narrow), end = __builtin_convertvector(t1 * scale, Narrow);
    *(Narrow *)(r->begin + k) = begin - higher(begin, -begin) * 0x1p-22f;
    *(Narrow *)(r->end + k) = end + higher(end, -end) * 0x1p-22f;
    return fine;
}

/* Bits: of the rays that can meet anything. */
INLINE uint64_t set_rays(Rays *r, const BvhScene *s, const flt *rays, uint64_t mask, uint32_t width) {
    flt *const row[8] = {r->o[0], r->o[1], r->o[2], r->d[0], r->d[1], r->d[2], r->t0, r->t};
    uint64_t fine = 0;
    for (size_t line = 0; line < 8 * width * sizeof(flt); line += 64) __builtin_prefetch((const char *)rays + line);
    for (uint32_t k = 0; k < width; k += GROUP) {
        if (!(mask >> k & LOW_BITS(GROUP))) continue;
        for (uint32_t c = 0; c < 8; c++) {
            const flt *from = rays + (size_t)c * width + k;
            if (k + GROUP <= width) memcpy(row[c] + k, from, sizeof(Group));
            else
                for (uint32_t i = 0; i < GROUP; i++) row[c][k + i] = k + i < width ? from[i] : 0;
        }
        fine |= (uint64_t)set_group(r, s, k) << k;
    }
    return fine & mask & LOW_BITS(width);
}

/* ---- triangles */

/* Looked up: of rays that go apart nobody guesses it. */
static const uint8_t after[3] = {1, 2, 0};

/* What is under a child will be read soon. */
INLINE void fetch(const BvhScene *s, int32_t child) {
    const char *from =
        child >= 0 ? (const char *)&s->bvh->node[child] : (const char *)((const Leaf *)s->bvh->leaf + ~child);
    for (size_t line = 0; line < (child >= 0 ? sizeof(BvhNode) : sizeof(Leaf)); line += 64)
        __builtin_prefetch(from + line);
}

#if F64
INLINE D8 wide(D8 v) { return v; }
INLINE D8 of_wide(D8 v) { return v; }
INLINE D4 wide4(D4 v) { return v; }
#else
INLINE D8 wide(F8 v) { return wide_F8(v); }
INLINE F8 of_wide(D8 v) { return narrow_D8(v); }
INLINE D4 wide4(F4 v) { return wide_F4(v); }
#endif
INLINE Flt8 all(flt v) { return (Flt8){v, v, v, v, v, v, v, v}; }

/* Which of eight pairs of a ray and a triangle meet, and where: x, y across the ray, z the t of corners. */
INLINE uint32_t inside(const Flt8 x[3], const Flt8 y[3], const Flt8 z[3], Flt8 low, Flt8 high, Flt8 *t, D8 *before) {
    D8 e[3], sum = {0}, at = {0};
    uint32_t plus = 0, minus = 0;
    for (int c = 0; c < 3; c++) {
        const int p = (c + 1) % 3, q = (c + 2) % 3;
        e[c] = wide(x[p]) * wide(y[q]) - wide(y[p]) * wide(x[q]);
        plus |= less((D8){0}, e[c]), minus |= less(e[c], (D8){0});
        sum += e[c], at += e[c] * wide(z[c]);
    }
    *before = at / sum;
    *t = lower(high, higher(low, of_wide(*before)));
    return plus ^ minus;
}

/* Ray k has been found to meet a triangle at t. Beside an edge at which a surface turns away, the back is as near as
 * single precision tells; double precision of the same corners tells them apart. */
INLINE void take(Rays *r, uint32_t k, flt t, double before, int32_t triangle) {
    if (t < r->t0[k] || t > r->t[k]) return;
    const bool nearer = t < r->t[k] || r->triangle[k] < 0 || before < r->wide[k] ||
                        (!(before > r->wide[k]) && triangle < r->triangle[k]);
    if (!nearer) return;
    r->t[k] = t, r->wide[k] = before, r->triangle[k] = triangle;
    r->end[k] = outwards_of(t * r->scale[k]);
}

/* Which of eight triangles ray k may meet: as many at once as a register holds. */
INLINE uint32_t may_meet(const Leaf *l, const Rays *r, uint32_t k) {
    const int kz = r->way[k] & 3, kx = after[kz], ky = after[kx];
    const flt sx = r->sx[k], sy = r->sy[k], sz = r->sz[k];
    uint32_t may = 0;
    for (uint32_t i = 0; i < BVH_LEAF; i += sizeof(Part) / sizeof(flt)) {
        Part x[3], y[3], z[3];
        for (int c = 0; c < 3; c++) {
            const Part along = *(const Part *)(l->at[c][kz] + i) - r->o[kz][k];
            x[c] = (*(const Part *)(l->at[c][kx] + i) - r->o[kx][k]) - sx * along;
            y[c] = (*(const Part *)(l->at[c][ky] + i) - r->o[ky][k]) - sy * along;
            z[c] = sz * along;
        }
        uint32_t plus = 0, minus = 0;
        for (int c = 0; c < 3; c++) {
            const Part one = x[(c + 1) % 3] * y[(c + 2) % 3], other = y[(c + 1) % 3] * x[(c + 2) % 3];
            plus |= PART(less)(other, one), minus |= PART(less)(one, other);
        }
        const Part low = PART(lower)(z[2], PART(lower)(z[1], z[0])),
                   high = PART(higher)(z[2], PART(higher)(z[1], z[0]));
        may |= (~(plus & minus) & PART(upto)(low, PART(all)(r->t[k])) & PART(upto)(PART(all)(r->t0[k]), high)) << i;
    }
    return may;
}

/* Ray k against triangle i. */
INLINE void meet_one(const Leaf *l, Rays *r, uint32_t k, uint32_t i) {
    const int kz = r->way[k] & 3, kx = after[kz], ky = after[kx];
#define CORNERS(axis) ((Flt4){l->at[0][axis][i], l->at[1][axis][i], l->at[2][axis][i], 0} - r->o[axis][k])
    const Flt4 along = CORNERS(kz), z = r->sz[k] * along;
    const D4 x = wide4(CORNERS(kx) - r->sx[k] * along), y = wide4(CORNERS(ky) - r->sy[k] * along);
#undef CORNERS
    const D4 e = __builtin_shufflevector(x, x, 1, 2, 0, 3) * __builtin_shufflevector(y, y, 2, 0, 1, 3) -
                 __builtin_shufflevector(y, y, 1, 2, 0, 3) * __builtin_shufflevector(x, x, 2, 0, 1, 3);
    if (any_over(e) == any_over(-e)) return;
    const D4 parts = e * wide4(z);
    const double sum = (e[0] + e[1]) + e[2], at = (parts[0] + parts[1]) + parts[2];
    const double before = at / sum;
    flt low = z[1] < z[0] ? z[1] : z[0], high = z[1] > z[0] ? z[1] : z[0], t = (flt)before;
    low = z[2] < low ? z[2] : low, high = z[2] > high ? z[2] : high;
    t = low > t ? low : t;
    take(r, k, high < t ? high : t, before, l->triangle[i]);
}

/* Ray k against the triangles `may`, seldom more than one. */
INLINE void meet_those(const Leaf *l, Rays *r, uint32_t k, uint32_t may) {
    for (; may; may &= may - 1) meet_one(l, r, k, (uint32_t)__builtin_ctz(may));
}

/* The same triangles where vertices are not those of the tree. */
static void moved_leaf(const BvhScene *s, const Leaf *l, Leaf *now) {
    const flt *v = s->moved;
    *now = *l;
    for (int k = 0; k < BVH_LEAF; k++) {
        if (l->triangle[k] < 0) continue;
        bool finite = true;
        for (int c = 0; c < 3; c++)
            for (int a = 0; a < 3; a++) {
                now->at[c][a][k] = v[3 * (size_t)s->bvh->face[3 * (size_t)l->triangle[k] + (size_t)c] + (size_t)a];
                finite &= fabs((double)now->at[c][a][k]) <= (double)FLT_MAX;
            }
        for (int c = 0; c < 9 && !finite; c++) now->at[c / 3][c % 3][k] = (flt)NAN;
    }
}

/* Rays against eight triangles, one after the other. */
INLINE void meet_rays(const Leaf *l, Rays *r, uint64_t who) {
    uint8_t met[RAYS], may[RAYS];
    uint32_t mets = 0;
    for (; who; who &= who - 1) {
        const uint32_t k = (uint32_t)__builtin_ctzll(who), these = may_meet(l, r, k);
        met[mets] = (uint8_t)k, may[mets] = (uint8_t)these;
        mets += these != 0;
    }
    for (uint32_t i = 0; i < mets; i++) meet_those(l, r, met[i], may[i]);
}

INLINE void meet_each(const BvhScene *s, Rays *r, uint64_t who, int32_t leaf) {
    const Leaf *l = (const Leaf *)s->bvh->leaf + leaf;
    Leaf now;
    if (s->moved) moved_leaf(s, l, &now), l = &now;
    meet_rays(l, r, who);
}

/* Which boxes of the node ray k passes. */
INLINE uint32_t pass_boxes(const BvhNode *n, const Rays *r, uint32_t k, F8 *enter) {
    F8 in = all_F8(r->begin[k]), out = all_F8(r->end[k]);
    for (int a = 0; a < 3; a++) {
        /* Added, not chosen: of rays that go apart nobody guesses which way the next one goes. */
        const char *lo = (const char *)n->lo[a], *hi = (const char *)n->hi[a];
        const size_t down = r->down[a][k];
        const F8 inverse = all_F8(r->inverse[a][k]);
        in = higher((*(const F8 *)(lo + down) - all_F8(r->near[a][k])) * inverse, in);
        out = lower((*(const F8 *)(hi - down) - all_F8(r->far[a][k])) * inverse, out);
    }
    *enter = in;
    return upto(in, out);
}

/* Which of the rays pass which of the node's boxes, MANY rays at a time, and, unless any will do, where the first
 * enters. */
INLINE void pass_many(const BvhNode *n, const Rays *r, uint64_t who, uint64_t passed[BVH_WIDTH],
                      float nearest[BVH_WIDTH], bool any) {
    union {
        Bits some[BVH_WIDTH][RAYS / MANY];
        uint64_t all[BVH_WIDTH];
    } pass = {.all = {0}};
    Many first[BVH_WIDTH];
    for (int c = 0; c < BVH_WIDTH; c++) first[c] = (Many){0} + HUGE_VALF;
    for (uint32_t k = 0; k < RAYS; k += MANY) {
        const uint64_t these = who >> k & LOW_BITS(MANY);
        if (!these) continue;
        Lanes down[3];
        Many near[3], far[3], inverse[3];
        for (int a = 0; a < 3; a++) {
            down[a] = lanes_not_0(r->down[a] + k), inverse[a] = *(const Many *)(r->inverse[a] + k);
            near[a] = *(const Many *)(r->near[a] + k), far[a] = *(const Many *)(r->far[a] + k);
        }
        /* The others pass nothing. */
        const Many begin = chosen(these, *(const Many *)(r->begin + k), (Many){0} + HUGE_VALF),
                   end = chosen(these, *(const Many *)(r->end + k), (Many){0} - HUGE_VALF);
        for (int c = 0; c < BVH_WIDTH; c++) {
            Many in = begin, out = end;
            for (int a = 0; a < 3; a++) {
                const Many lo = all_Many(n->lo[a][c]), hi = all_Many(n->hi[a][c]);
                in = higher((either(down[a], hi, lo) - near[a]) * inverse[a], in);
                out = lower((either(down[a], lo, hi) - far[a]) * inverse[a], out);
            }
            const Bits m = (Bits)upto(in, out);
            pass.some[c][k / MANY] = m;
            if (!any) first[c] = chosen(m, lower(in, first[c]), first[c]);
        }
    }
    for (int c = 0; c < BVH_WIDTH; c++) {
        passed[c] = pass.all[c];
        nearest[c] = any ? HUGE_VALF : least_of(first[c]);
    }
}

#include "turns.inc.h"

#include "mixed.inc.h"
#include "packet.inc.h"

/* Which rays of `left` go the same way as ray k. */
INLINE uint64_t same_way(const Rays *r, uint32_t k, uint64_t left) {
    uint64_t same = 0;
    for (uint32_t i = 0; i < RAYS; i += MANY)
        if (left >> i & LOW_BITS(MANY)) same |= (uint64_t)equal(*(const Whether *)(r->way + i), r->way[k]) << i;
    return same & left;
}

static void search(const BvhScene *s, const void *rays, uint64_t mask, uint32_t width, bool any, int32_t *witness) {
    Rays r;
    Turns w;
    turns_set(&w, s);
    const uint64_t fine = set_rays(&r, s, rays, mask, width);
    uint64_t apart = 0, left = fine;
    for (int tries = 0; __builtin_popcountll(left) >= PACKET && tries < TRIES; tries++) {
        const uint64_t same = same_way(&r, (uint32_t)__builtin_ctzll(left), left);
        if (__builtin_popcountll(same) < PACKET || !descend_packet(s, &r, &w, same, any)) apart |= same;
        left &= ~same;
    }
    apart |= left;
    if (__builtin_popcountll(apart) >= PACKET && near_each_other(s, &r, apart)) descend_mixed(s, &r, &w, apart, 0, any);
    else if (apart) descend_each(s, &r, &w, apart, any);
    if (w.later) finish_each(s, &r, &w, w.later, any);
    for (uint32_t k = 0; k < width; k++)
        witness[k] = !(fine >> k & 1) || r.triangle[k] < 0 ? SLT_WITNESS_NONE : any ? 0 : r.triangle[k];
}
