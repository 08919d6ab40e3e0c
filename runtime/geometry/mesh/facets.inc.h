/* Triangles that windows may see, eight at a time. Include behind beams.inc.h.
 *
 * What is listed for several windows of one eye does not decide what one of them sees: `survey` asks each triangle
 * again, by arithmetic of the window alone. */
typedef float Narrow __attribute__((vector_size(32), aligned(4)));

/* A plane through the eye; what is not on its positive side by more than `slack` is outside. */
typedef struct Plane {
    double normal[3], slack;
} Plane;

/* Which of a node's boxes are not wholly outside of one of the planes? */
INLINE uint32_t boxes_in(const BvhNode *n, const Plane plane[4], const double eye[3]) {
    D8 lo[3], hi[3];
    for (int a = 0; a < 3; a++) {
        lo[a] = __builtin_convertvector(*(const Narrow *)n->lo[a], D8) - eye[a];
        hi[a] = __builtin_convertvector(*(const Narrow *)n->hi[a], D8) - eye[a];
    }
    L8 in = lo[0] <= hi[0];
    for (int p = 0; p < 4; p++) {
        D8 most = (D8){0} + plane[p].slack;
        for (int a = 0; a < 3; a++) most += plane[p].normal[a] * (plane[p].normal[a] > 0 ? hi[a] : lo[a]);
        in &= most >= 0;
    }
    return bits_D8(in);
}

static void list_leaves(Search *s, const Plane plane[4], const double eye[3]) {
    const BvhScene *scene = &s->scene->tree;
    const Bvh *b = scene->bvh;
    int32_t stack[BVH_STACK];
    uint32_t depth = 0;
    Store *store = s->store;
    store->list.n = 0;
    stack[depth++] = 0;
    while (depth) {
        const BvhNode *n = &b->node[stack[--depth]];
        for (uint32_t in = boxes_in(n, plane, eye); in; in &= in - 1) {
            const int32_t child = n->child[__builtin_ctz(in)];
            if (child >= 0) {
                if (child) stack[depth++] = child;
                continue;
            }
            if (!PUSH(store, store->list, ~child)) return;
        }
    }
}

/* Corners of a leaf's triangles from `eye`, a far one's from the origin. The leaf has them, but those of vertices that
 * have been moved; where it has no triangle, any. */
INLINE void corners_of(const Search *s, const double eye[3], uint32_t leaf, const int32_t *triangle, D8 p[3][3]) {
    const Bvh *b = s->scene->tree.bvh;
    double at[3][3][8];
    if (!s->scene->tree.moved) {
        for (int k = 0; k < 3; k++)
            for (int a = 0; a < 3; a++)
                p[k][a] =
                    (s->f64
                         ? *(const Wide *)((const BvhLeaf64 *)b->leaf)[leaf].at[k][a]
                         : __builtin_convertvector(*(const Narrow *)((const BvhLeaf32 *)b->leaf)[leaf].at[k][a], D8)) -
                    eye[a];
        return;
    }
    for (uint32_t i = 0; i < 8; i++)
        for (int k = 0; k < 3; k++) {
            const size_t from = 3 * (size_t)b->face[3 * (size_t)(triangle[i] < 0 ? 0 : triangle[i]) + (size_t)k];
            for (size_t a = 0; a < 3; a++)
                at[k][a][i] = (s->f64 ? ((const double *)s->scene->values)[from + a]
                                      : (double)((const float *)s->scene->values)[from + a]) -
                              eye[a];
        }
    memcpy(p, at, sizeof at);
}

/* What eight triangles are, before those that are not in the rectangle are left out. */
typedef struct Columns {
    double normal[3][3][8], depth[3][8], base[4][8], lo[2][8], hi[2][8];
    double along[2][4][8];  /* normals and depth times u and v of the window */
    double spread[2][4][8]; /* Near.spread */
} Columns;

INLINE D8 which(L8 m, D8 a, D8 b) { return (D8)((m & (L8)a) | (~m & (L8)b)); }

INLINE void cross8(const D8 a[3], const D8 b[3], D8 out[3]) {
    for (int i = 0; i < 3; i++) out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

/* Of triangles seen from the eye. Their planes are of differences of corners: products of corners cancel by the square
 * of how far they are, measured in triangles. A line's normal is any of its points times its direction: the nearer end,
 * or the middle where both are as near, so that from the other face it is the same, negated. */
INLINE void lines_near(const D8 p[3][3], D8 normal[3][3], D8 plane[3], D8 *det) {
    D8 edge[3][3], square[3], nearest[3];
    for (int k = 0; k < 3; k++) {
        square[k] = p[k][0] * p[k][0] + p[k][1] * p[k][1] + p[k][2] * p[k][2];
        for (int a = 0; a < 3; a++) edge[k][a] = p[(k + 1) % 3][a] - p[k][a];
    }
    for (int k = 0; k < 3; k++) {
        const int q = (k + 1) % 3;
        const L8 first = square[k] < square[q], second = square[q] < square[k];
        D8 at[3];
        for (int a = 0; a < 3; a++) at[a] = which(first, p[k][a], which(second, p[q][a], 0.5 * (p[k][a] + p[q][a])));
        cross8(at, edge[k], normal[k]);
    }
    cross8(edge[0], edge[1], plane);
    const L8 second = square[1] < square[0], third = square[2] < lower(square[0], square[1]);
    for (int a = 0; a < 3; a++) nearest[a] = which(third, p[2][a], which(second, p[1][a], p[0][a]));
    *det = nearest[0] * plane[0] + nearest[1] * plane[1] + nearest[2] * plane[2];
}

/* The same of a far eye and corners from the origin. d = q + own * -eye: what the second part gives is `base`, exact to
 * the last bits however far the eye is. Depths differ little from each other: what all share, d . -eye / eye . eye, is
 * left out of them. depth: times det. */
INLINE void lines_far(const D8 at[3][3], const double eye[3], D8 normal[3][3], D8 depth[3], D8 base[4], D8 *det) {
    const double square = window_dot(eye, eye);
    D8 edge[3][3], across[3], plane[3], own, along;
    for (int k = 0; k < 3; k++) {
        const int q = (k + 1) % 3;
        D8 middle[3];
        for (int a = 0; a < 3; a++) edge[k][a] = at[q][a] - at[k][a], middle[a] = 0.5 * (at[k][a] + at[q][a]);
        cross8(middle, edge[k], normal[k]);
        dot8(normal[k], eye, &base[k]);
        base[k] = -base[k];
        for (int a = 0; a < 3; a++) {
            const int j = (a + 1) % 3, l = (a + 2) % 3;
            normal[k][a] -= eye[j] * edge[k][l] - eye[l] * edge[k][j];
        }
    }
    cross8(edge[0], edge[1], plane);
    own = at[0][0] * plane[0] + at[0][1] * plane[1] + at[0][2] * plane[2];
    dot8(plane, eye, &along);
    *det = own - along;
    base[3] = -own;
    for (int a = 0; a < 3; a++)
        across[a] = eye[(a + 1) % 3] * plane[(a + 2) % 3] - eye[(a + 2) % 3] * plane[(a + 1) % 3];
    for (int a = 0; a < 3; a++)
        depth[a] =
            (across[(a + 1) % 3] * eye[(a + 2) % 3] - across[(a + 2) % 3] * eye[(a + 1) % 3] + eye[a] * own) / square;
}

INLINE void make_columns(const Window *w, const Rectangle *r, const D8 at[3][3], Columns *out, uint32_t *in,
                         uint32_t *turned) {
    D8 p[3][3], sum[3], base[4], det, size;
    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++) p[k][a] = w->far ? at[k][a] - w->eye[a] : at[k][a];
    D8 lo[2] = {(D8){0} + HUGE_VAL, (D8){0} + HUGE_VAL}, hi[2] = {-lo[0], -lo[1]};
    L8 ahead = ~(L8){0}, outside = {0};
    for (int k = 0; k < 3; k++) {
        D8 along, where;
        dot8(p[k], w->plane[2], &along);
        ahead &= along > 0;
        along = 1 / along;
        for (int i = 0; i < 2; i++) {
            dot8(p[k], w->plane[i], &where);
            where *= along;
            keep_min(&lo[i], &where), keep_max(&hi[i], &where);
        }
    }
    for (int i = 0; i < 2; i++) {
        D8 above, below;
        size_of(&hi[i], &above), size_of(&lo[i], &below);
        lo[i] -= w->beside[i] * (1 + above + below), hi[i] += w->beside[i] * (1 + above + below);
        outside |= (lo[i] > r->hi[i]) | (hi[i] < r->lo[i]);
        lo[i] = (D8)((ahead & (L8)lo[i]) | (~ahead & (L8)((D8){0} - HUGE_VAL)));
        hi[i] = (D8)((ahead & (L8)hi[i]) | (~ahead & (L8)((D8){0} + HUGE_VAL)));
    }
    outside &= ahead;
    *in &= ~bits_D8(outside);
    if (!*in) return;
    D8 normal[3][3];
    if (w->far) lines_far(at, w->eye, normal, sum, base, &det);
    else lines_near((const D8(*)[3])p, normal, sum, &det);
    size_of(&det, &size);
    const L8 back = det < 0, good = (size > 0) & (size <= DBL_MAX);
    *in &= bits_D8(good), *turned = bits_D8(back);
    const D8 inverse = 1 / det;
    for (int a = 0; a < 3; a++) {
        *(Wide *)out->depth[a] = sum[a] *= inverse;
        for (int k = 0; k < 3; k++)
            *(Wide *)out->normal[k][a] = normal[k][a] = (D8)((L8)normal[k][a] ^ (back & INT64_MIN));
    }
    for (int k = 0; k < 4 && w->far; k++)
        *(Wide *)out->base[k] = k < 3 ? (D8)((L8)base[k] ^ (back & INT64_MIN)) : base[k] * inverse;
    for (int k = 0; k < 4; k++) {
        D8 add[3], least = {0}, most = {0};
        dot8(k < 3 ? normal[k] : sum, w->u, &add[0]);
        dot8(k < 3 ? normal[k] : sum, w->v, &add[1]);
        add[2] = add[0] + add[1];
        for (int q = 0; q < 3; q++) keep_min(&least, &add[q]), keep_max(&most, &add[q]);
        *(Wide *)out->along[0][k] = add[0], *(Wide *)out->along[1][k] = add[1];
        *(Wide *)out->spread[0][k] = least, *(Wide *)out->spread[1][k] = most;
    }
    for (int i = 0; i < 2; i++) *(Wide *)out->lo[i] = lo[i], *(Wide *)out->hi[i] = hi[i];
}

/* Appends those of a leaf's triangles that lie in the rectangle. */
static void add_leaf(Search *s, const Window *w, const Rectangle *r, uint32_t leaf) {
    const Bvh *b = s->scene->tree.bvh;
    const int32_t *triangle =
        s->f64 ? ((const BvhLeaf64 *)b->leaf)[leaf].triangle : ((const BvhLeaf32 *)b->leaf)[leaf].triangle;
    Columns c;
    uint32_t in = 0, turned;
    Store *store = s->store;
    D8 p[3][3];
    for (uint32_t i = 0; i < BVH_LEAF; i++) in |= (uint32_t)(triangle[i] >= 0) << i;
    static const double origin[3];
    corners_of(s, w->far ? origin : w->eye, leaf, triangle, p);
    make_columns(w, r, (const D8(*)[3])p, &c, &in, &turned);
    if (!in || !window_room(store, &store->near.data, store->near.n, &store->near.room, 8, sizeof *store->near.data))
        return;
    for (; in; in &= in - 1) {
        const uint32_t i = (uint32_t)__builtin_ctz(in);
        Near *to = &store->near.data[store->near.n++];
        for (int a = 0; a < 3; a++) {
            to->depth[a] = c.depth[a][i];
            for (int k = 0; k < 3; k++) to->normal[k][a] = c.normal[k][a][i];
        }
        for (int k = 0; k < 4 && w->far; k++) to->base[k] = c.base[k][i];
        for (int a = 0; a < 2; a++) {
            to->lo[a] = c.lo[a][i], to->hi[a] = c.hi[a][i];
            for (int k = 0; k < 4; k++) to->along[a][k] = c.along[a][k][i], to->spread[a][k] = c.spread[a][k][i];
        }
        to->triangle = triangle[i], to->turned = turned >> i & 1;
    }
}

static void list(Search *s, const Window *w, const Rectangle *r) {
    const BvhScene *scene = &s->scene->tree;
    Plane plane[4];
    for (int p = 0; p < 4; p++) {
        const double sign = p & 1 ? -1 : 1, at = p & 1 ? r->hi[p / 2] : r->lo[p / 2];
        plane[p].slack = 0;
        for (int a = 0; a < 3; a++) {
            const double n = sign * (w->plane[p / 2][a] - at * w->plane[2][a]),
                         far = scene->bvh->magnitude + fabs(w->eye[a]) + scene->slack;
            plane[p].normal[a] = n, plane[p].slack += fabs(n) * (scene->slack + 1e-12 * far);
        }
    }
    Store *store = s->store;
    store->near.n = 0;
    list_leaves(s, plane, w->eye);
    for (uint32_t i = 0; i < store->list.n; i++) add_leaf(s, w, r, (uint32_t)store->list.data[i]);
}

/* Of d . n at the corners of the windows of eight lanes. */
INLINE void range_of(const double n[3], const double *base, const Beams *b, uint32_t k, bool alike, double below,
                     double above, D8 *first, D8 *least, D8 *most) {
    D8 row[3], c, s, t;
    for (int a = 0; a < 3; a++) row[a] = *(const Wide *)&b->row[BEAM_Q + a][k];
    dot8(row, n, &c);
    if (base) c += *(const Wide *)&b->row[BEAM_OWN][k] * *base;
    *first = c;
    *least = *most = c;
    if (alike) {
        *least = c + below, *most = c + above;
        return;
    }
    for (int a = 0; a < 3; a++) row[a] = *(const Wide *)&b->row[SLT_BEAM_U + a][k];
    dot8(row, n, &s);
    for (int a = 0; a < 3; a++) row[a] = *(const Wide *)&b->row[SLT_BEAM_V + a][k];
    dot8(row, n, &t);
    D8 at[3] = {s + c, t + c, s + t + c};
    for (int q = 0; q < 3; q++) keep_min(least, &at[q]), keep_max(most, &at[q]);
}

/* Appends what the windows of eight lanes may see of a triangle, in no order. */
INLINE void meet_lanes(Store *store, const Beams *b, const Places *lie, uint32_t number, uint32_t k, uint32_t on,
                       bool alike, bool far, D8 *hidden) {
    typedef struct {
        double at[8];
    } Row;
    const Near *t = &store->near.data[number];
    const D8 zero = {0};
    uint32_t some = on & upto(*(const Wide *)&lie->lo[0][k], all_D8(t->hi[0])) &
                    upto(all_D8(t->lo[0]), *(const Wide *)&lie->hi[0][k]) &
                    upto(*(const Wide *)&lie->lo[1][k], all_D8(t->hi[1])) &
                    upto(all_D8(t->lo[1]), *(const Wide *)&lie->hi[1][k]);
    if (!some) return;
    uint32_t filling = some;
    D8 least, most, first[4];
    for (int e = 0; e < 3; e++) {
        range_of(t->normal[e], far ? &t->base[e] : NULL, b, k, alike, t->spread[0][e], t->spread[1][e], &first[e],
                 &least, &most);
        some &= less(zero, most), filling &= less(zero, least);
    }
    range_of(t->depth, far ? &t->base[3] : NULL, b, k, alike, t->spread[0][3], t->spread[1][3], &first[3], &least,
             &most);
    some &= upto(*hidden, most) & upto(all_D8(-DBL_MAX), least) & upto(most, all_D8(DBL_MAX));
    if (!some) return;
    filling &= some;
    D8 nearest = chosen(filling, least, *hidden);
    keep_max(hidden, &nearest);
    Row low, high, c[3];
    memcpy(&low, &least, sizeof low), memcpy(&high, &most, sizeof high), memcpy(c, first, sizeof c);
    for (; some; some &= some - 1) {
        const uint32_t i = (uint32_t)__builtin_ctz(some);
        store->found.data[store->found.n++] = (Candidate){.least = low.at[i],
                                                          .most = high.at[i],
                                                          .c = {c[0].at[i], c[1].at[i], c[2].at[i]},
                                                          .triangle = t->triangle,
                                                          .near = number,
                                                          .lane = (uint8_t)(k + i),
                                                          .fills = filling >> i & 1};
    }
}

static void survey(Search *s, const Beams *b, const Places *lie, Neighbours *group) {
    Store *store = s->store;
    const bool far = b->far >> group->base & 1; /* they share their eye */
    D8 hidden[LANES / 8];
    double nearest[LANES];
    uint32_t *first = group->first, count[LANES];
    const uint32_t end = group->last + 1;
    const uint64_t who = b->mask & LOW_BITS(end) & ~0ull << group->base;
    for (uint32_t k = group->base / 8; k <= group->last / 8; k++) hidden[k] = all_D8(-HUGE_VAL);
    for (uint32_t k = group->base; k < end; k++) first[k] = count[k] = 0;
    store->found.n = store->candidate.n = first[end] = 0;
    if (!store->near.n) return;
    for (uint32_t i = 0; i < store->near.n; i++) {
        if (!window_room(store, &store->found.data, store->found.n, &store->found.room, LANES,
                         sizeof *store->found.data))
            return;
        for (uint32_t k = group->base / 8 * 8; k <= group->last; k += 8) {
            const uint32_t on = (uint32_t)(who >> k) & 255;
            if (on) meet_lanes(store, b, lie, i, k, on, group->alike, far, &hidden[k / 8]);
        }
    }
    if (!window_room(store, &store->candidate.data, 0, &store->candidate.room, store->found.n,
                     sizeof *store->candidate.data))
        return;
    for (uint32_t k = group->base / 8; k <= group->last / 8; k++) memcpy(&nearest[8 * k], &hidden[k], sizeof hidden[k]);
    /* By lane, less what is hidden. */
    for (uint32_t i = 0; i < store->found.n; i++) {
        const Candidate *c = &store->found.data[i];
        count[c->lane] += !(c->most < nearest[c->lane]);
    }
    for (uint32_t k = group->base; k < end; k++) first[k + 1] = first[k] + count[k], count[k] = first[k];
    for (uint32_t i = 0; i < store->found.n; i++) {
        const Candidate *c = &store->found.data[i];
        if (!(c->most < nearest[c->lane])) store->candidate.data[count[c->lane]++] = *c;
    }
    store->candidate.n = first[end];
}
