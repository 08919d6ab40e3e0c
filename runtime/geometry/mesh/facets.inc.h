/* Triangles that windows may see, eight at a time. Include behind sheet.inc.h.
 *
 * What is listed for several windows of one eye does not decide what one of them sees: `survey` asks each triangle
 * again, by arithmetic of the window alone. */
/* A plane through the eye; what is not on its positive side by more than it is off is outside. */
typedef struct Plane {
    double normal[3], off;
    bool high[3]; /* the normal goes up, so that a box's most is at its upper end */
} Plane;

/* Which of a node's boxes are not wholly outside of one of the planes? */
INLINE uint32_t boxes_in(const BvhNode *n, const Plane plane[4]) {
    D8 end[3][2];
    uint32_t in = 255;
    for (int a = 0; a < 3; a++)
        end[a][0] = wide_F8(*(const Narrow *)n->lo[a]), end[a][1] = wide_F8(*(const Narrow *)n->hi[a]);
    in &= upto(end[0][0], end[0][1]);
    for (int p = 0; p < 4; p++) {
        D8 most = all_D8(plane[p].off);
        for (int a = 0; a < 3; a++) most += plane[p].normal[a] * end[a][plane[p].high[a]];
        in &= upto(all_D8(0), most);
    }
    return in;
}

/* The least of d . across in each of a node's boxes. */
INLINE D8 least_along(const BvhNode *n, const double across[3]) {
    D8 least = {0};
    for (int a = 0; a < 3; a++) least += across[a] * wide_F8(*(const Narrow *)(across[a] < 0 ? n->hi[a] : n->lo[a]));
    return least;
}

enum { FEW_LEAVES = 96 };

/* By how far away they are (store->most), so that what hides is met before what is hidden. */
static void nearest_leaves_first(Store *store) {
    for (uint32_t i = 1; i < store->list.n; i++) {
        const double away = store->most.data[i];
        const int32_t leaf = store->list.data[i];
        uint32_t k = i;
        for (; k && store->most.data[k - 1] > away; k--)
            store->most.data[k] = store->most.data[k - 1], store->list.data[k] = store->list.data[k - 1];
        store->most.data[k] = away, store->list.data[k] = leaf;
    }
}

/* Which is read soon. */
INLINE void fetch_leaf(const Search *s, uint32_t leaf) {
    const size_t size = s->f64 ? sizeof(BvhLeaf64) : sizeof(BvhLeaf32);
    const char *from = (const char *)s->scene->tree.bvh->leaf + leaf * size;
    for (size_t at = 0; at < size; at += 64) __builtin_prefetch(from + at);
}

/* across: where it is more, a box is farther from the eye. */
static void list_leaves(Search *s, const Plane plane[4], const double across[3]) {
    const BvhScene *scene = &s->scene->tree;
    const Bvh *b = scene->bvh;
    int32_t stack[BVH_STACK];
    uint32_t depth = 0;
    Store *store = s->store;
    store->list.n = 0;
    stack[depth++] = 0;
    while (depth) {
        const BvhNode *n = &b->node[stack[--depth]];
        uint32_t in = boxes_in(n, plane);
        if (!in) continue;
        double away[8];
        *(Wide *)away = least_along(n, across);
        for (; in; in &= in - 1) {
            const uint32_t i = (uint32_t)__builtin_ctz(in);
            const int32_t child = n->child[i];
            if (child >= 0) {
                if (!child) continue;
                for (size_t at = 0; at < sizeof *b->node; at += 64)
                    __builtin_prefetch((const char *)&b->node[child] + at);
                stack[depth++] = child;
                continue;
            }
            if (!PUSH(store, store->list, ~child) ||
                !window_room(store, &store->most.data, store->list.n, &store->most.room, 1, sizeof *store->most.data))
                return;
            store->most.data[store->list.n - 1] = away[i];
            fetch_leaf(s, (uint32_t)~child);
        }
    }
    if (store->list.n <= FEW_LEAVES) nearest_leaves_first(store);
}

/* Corners of a leaf's triangles from `eye`, a far one's from the origin. The leaf has them, but those of vertices that
 * have been moved; where it has no triangle, any. */
INLINE void corners_of(const Search *s, const double eye[3], uint32_t leaf, const int32_t *triangle, D8 p[3][3]) {
    const Bvh *b = s->scene->tree.bvh;
    double at[3][3][8];
    if (!s->scene->tree.moved) {
        for (int k = 0; k < 3; k++)
            for (int a = 0; a < 3; a++)
                p[k][a] = (s->f64 ? *(const Wide *)((const BvhLeaf64 *)b->leaf)[leaf].at[k][a]
                                  : wide_F8(*(const Narrow *)((const BvhLeaf32 *)b->leaf)[leaf].at[k][a])) -
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

INLINE D8 square_of(const D8 v[3]) { return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]; }

/* Of triangles seen from the eye. Their planes are of differences of corners: products of corners cancel by the square
 * of how far they are, measured in triangles. A line's normal is any of its points times its direction: the nearer end,
 * or the middle where both are as near, so that from the other face it is the same, negated. most: the square of what
 * det is at most. */
INLINE void lines_near(const D8 p[3][3], D8 normal[3][3], D8 plane[3], D8 *det, D8 *most) {
    D8 edge[3][3], square[3], nearest[3];
    for (int k = 0; k < 3; k++) {
        square[k] = square_of(p[k]);
        for (int a = 0; a < 3; a++) edge[k][a] = p[(k + 1) % 3][a] - p[k][a];
    }
    for (int k = 0; k < 3; k++) {
        const int q = (k + 1) % 3;
        const L8 first = under(square[k], square[q]), second = under(square[q], square[k]);
        D8 at[3];
        for (int a = 0; a < 3; a++) at[a] = which(first, p[k][a], which(second, p[q][a], 0.5 * (p[k][a] + p[q][a])));
        cross8(at, edge[k], normal[k]);
    }
    cross8(edge[0], edge[1], plane);
    const L8 second = under(square[1], square[0]), third = under(square[2], lower(square[0], square[1]));
    for (int a = 0; a < 3; a++) nearest[a] = which(third, p[2][a], which(second, p[1][a], p[0][a]));
    *det = nearest[0] * plane[0] + nearest[1] * plane[1] + nearest[2] * plane[2];
    *most = lower(square[2], lower(square[0], square[1])) * square_of(edge[0]) * square_of(edge[1]);
}

/* The same of a far eye and corners from the origin. d = q + own * -eye: what the second part gives is `base`, exact to
 * the last bits however far the eye is. Depths differ little from each other: what all share, d . -eye / eye . eye, is
 * left out of them. depth: times det. */
INLINE void lines_far(const D8 at[3][3], const double eye[3], D8 normal[3][3], D8 depth[3], D8 base[4], D8 *det,
                      D8 *most) {
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
    *most = square * square_of(edge[0]) * square_of(edge[1]);
    base[3] = -own;
    for (int a = 0; a < 3; a++)
        across[a] = eye[(a + 1) % 3] * plane[(a + 2) % 3] - eye[(a + 2) % 3] * plane[(a + 1) % 3];
    for (int a = 0; a < 3; a++)
        depth[a] =
            (across[(a + 1) % 3] * eye[(a + 2) % 3] - across[(a + 2) % 3] * eye[(a + 1) % 3] + eye[a] * own) / square;
}

#define EDGE_ON 1e-10 /* of what det is at most: a triangle that may be seen as a line, or be one */
#define ROUNDED 1e-9  /* more than any rounding of 1 / t at a corner */

/* Triangles that lie in the rectangle, until there are eight. */
typedef struct Waiting {
    double at[3][3][8], lo[2][8], hi[2][8]; /* at: from the eye, for far ones from the origin */
    double nearest[8];
    int32_t triangle[8];
    uint32_t n;
} Waiting;

/* Which of eight triangles may lie in the rectangle, and where; nearest: Near. */
INLINE uint32_t in_rectangle(const Window *w, const Rectangle *r, const D8 at[3][3], D8 lo[2], D8 hi[2], D8 *nearest) {
    uint32_t ahead = 255, outside = 0;
    for (int i = 0; i < 2; i++) lo[i] = all_D8(HUGE_VAL), hi[i] = all_D8(-HUGE_VAL);
    for (int k = 0; k < 3; k++) {
        D8 p[3], along, where;
        for (int a = 0; a < 3; a++) p[a] = w->far ? at[k][a] - w->eye[a] : at[k][a];
        dot8(p, w->plane[2], &along);
        ahead &= less(all_D8(0), along);
        along = 1 / along;
        if (k) keep_max(nearest, &along);
        else *nearest = along;
        for (int i = 0; i < 2; i++) {
            dot8(p, w->plane[i], &where);
            where *= along;
            keep_min(&lo[i], &where), keep_max(&hi[i], &where);
        }
    }
    for (int i = 0; i < 2; i++) {
        D8 above, below;
        size_of(&hi[i], &above), size_of(&lo[i], &below);
        lo[i] -= w->beside[i] * (1 + above + below), hi[i] += w->beside[i] * (1 + above + below);
        outside |= less(all_D8(r->hi[i]), lo[i]) | less(hi[i], all_D8(r->lo[i]));
        lo[i] = chosen(ahead, lo[i], all_D8(-HUGE_VAL)), hi[i] = chosen(ahead, hi[i], all_D8(HUGE_VAL));
    }
    *nearest = chosen(w->far ? 0 : ahead, *nearest * (1 + ROUNDED), all_D8(HUGE_VAL));
    return ~(outside & ahead) & 255;
}

/* Makes of those that wait what windows are asked with. */
static void add_near(Search *s, const Window *w, Waiting *from) {
    typedef struct {
        D8 normal[4][3], spread[4][2], along[4][2], base[4];
    } Columns;
    union {
        Columns column;
        double at[sizeof(Columns) / sizeof(D8)][8];
    } made;
    Columns *c = &made.column;
    Store *store = s->store;
    if (!from->n ||
        !window_room(store, &store->near.data, store->near.n, &store->near.room, 8, sizeof *store->near.data) ||
        !window_room(store, &store->boxes.data, (store->near.n + 7) / 8, &store->boxes.room, 2,
                     sizeof *store->boxes.data)) {
        from->n = 0; /* of which more may come */
        return;
    }
    D8 at[3][3], normal[3][3], det, most, size;
    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++) {
            for (uint32_t i = from->n; i < 8; i++) from->at[k][a][i] = from->at[k][a][0];
            at[k][a] = *(const Wide *)from->at[k][a];
        }
    if (w->far) lines_far((const D8(*)[3])at, w->eye, normal, c->normal[3], c->base, &det, &most);
    else lines_near((const D8(*)[3])at, normal, c->normal[3], &det, &most);
    size_of(&det, &size);
    store->edge_on |= upto(det * det, EDGE_ON * EDGE_ON * most) & ((1u << from->n) - 1);
    const L8 back = under(det, (D8){0});
    const uint32_t good = less(all_D8(0), size) & upto(size, all_D8(DBL_MAX)), turned = bits_D8(back);
    const D8 inverse = 1 / det;
    for (int a = 0; a < 3; a++) {
        c->normal[3][a] *= inverse;
        for (int k = 0; k < 3; k++) c->normal[k][a] = (D8)((L8)normal[k][a] ^ (back & INT64_MIN));
    }
    for (int k = 0; k < 4 && w->far; k++)
        c->base[k] = k < 3 ? (D8)((L8)c->base[k] ^ (back & INT64_MIN)) : c->base[k] * inverse;
    for (int k = 0; k < 4; k++) {
        D8 add[3], least = {0}, most = {0};
        dot8(c->normal[k], w->u, &add[0]), dot8(c->normal[k], w->v, &add[1]);
        add[2] = add[0] + add[1];
        for (int q = 0; q < 3; q++) keep_min(&least, &add[q]), keep_max(&most, &add[q]);
        c->along[k][0] = add[0], c->along[k][1] = add[1];
        c->spread[k][0] = least, c->spread[k][1] = most;
    }
    for (uint32_t left = good & ((1u << from->n) - 1); left; left &= left - 1) {
        const uint32_t i = (uint32_t)__builtin_ctz(left), n = store->near.n++;
        Near *to = &store->near.data[n];
        NearBoxes *box = &store->boxes.data[n / 8];
        const double(*column)[8] = (const double(*)[8])made.at;
        for (int k = 0; k < 4; k++) {
            for (int a = 0; a < 3; a++) to->normal[k][a] = column[3 * k + a][i];
            for (int a = 0; a < 2; a++) to->spread[k][a] = column[12 + 2 * k + a][i];
            for (int a = 0; a < 2; a++) to->along[k][a] = column[20 + 2 * k + a][i];
            if (w->far) to->base[k] = column[28 + k][i];
        }
        to->nearest = box->nearest[n % 8] = from->nearest[i];
        to->triangle = from->triangle[i], to->turned = turned >> i & 1;
        memcpy(to->corner, s->scene->tree.bvh->face + 3 * (size_t)to->triangle, sizeof to->corner);
        for (int k = 0; k < 3; k++) to->edge[k] = window_edge(to->corner[k], to->corner[(k + 1) % 3]);
        for (int a = 0; a < 2; a++) box->lo[a][n % 8] = from->lo[a][i], box->hi[a][n % 8] = from->hi[a][i];
    }
    from->n = 0;
}

/* Those of a leaf's triangles that lie in the rectangle. Of a leaf few do, so they are gathered. */
static void add_leaf(Search *s, const Window *w, const Rectangle *r, uint32_t leaf, Waiting *to) {
    typedef struct {
        double at[8];
    } Row;
    const Bvh *b = s->scene->tree.bvh;
    const int32_t *triangle =
        s->f64 ? ((const BvhLeaf64 *)b->leaf)[leaf].triangle : ((const BvhLeaf32 *)b->leaf)[leaf].triangle;
    static const double origin[3];
    D8 p[3][3], lo[2], hi[2], nearest;
    corners_of(s, w->far ? origin : w->eye, leaf, triangle, p);
    uint32_t in = in_rectangle(w, r, (const D8(*)[3])p, lo, hi, &nearest);
    if (!in) return;
    Row at[3][3], where[4], near;
    memcpy(at, p, sizeof at), memcpy(where, lo, sizeof lo), memcpy(where + 2, hi, sizeof hi),
        memcpy(&near, &nearest, sizeof near);
    for (; in; in &= in - 1) {
        const uint32_t i = (uint32_t)__builtin_ctz(in), n = to->n;
        if (triangle[i] < 0) continue;
        __builtin_prefetch(b->face + 3 * (size_t)triangle[i]);
        for (int k = 0; k < 3; k++)
            for (int a = 0; a < 3; a++) to->at[k][a][n] = at[k][a].at[i];
        for (int a = 0; a < 2; a++) to->lo[a][n] = where[a].at[i], to->hi[a][n] = where[2 + a].at[i];
        to->triangle[n] = triangle[i], to->nearest[n] = near.at[i];
        if (++to->n == 8) add_near(s, w, to);
    }
}

static void list(Search *s, const Window *w, const Rectangle *r) {
    const BvhScene *scene = &s->scene->tree;
    Plane plane[4];
    for (int p = 0; p < 4; p++) {
        const double sign = p & 1 ? -1 : 1, at = p & 1 ? r->hi[p / 2] : r->lo[p / 2];
        plane[p].off = 0;
        for (int a = 0; a < 3; a++) {
            const double n = sign * (w->plane[p / 2][a] - at * w->plane[2][a]),
                         far = scene->bvh->magnitude + fabs(w->eye[a]) + scene->slack;
            plane[p].normal[a] = n, plane[p].high[a] = n > 0;
            plane[p].off += fabs(n) * (scene->slack + 1e-12 * far) - n * w->eye[a];
        }
    }
    Store *store = s->store;
    store->near.n = 0, store->edge_on = 0;
    list_leaves(s, plane, w->plane[2]);
    Waiting waiting;
    waiting.n = 0;
    for (uint32_t i = 0; i < store->list.n; i++) add_leaf(s, w, r, (uint32_t)store->list.data[i], &waiting);
    add_near(s, w, &waiting);
    for (uint32_t i = store->near.n; i % 8; i++) store->boxes.data[i / 8].lo[0][i % 8] = HUGE_VAL;
}

/* Windows of eight lanes, what hides what they may see, and what may be all that one sees. */
typedef struct Row {
    D8 q[3], own, u[3], v[3];
    D8 hidden;                /* 1 / t of what fills the window is at least this */
    D8 filling, most, others; /* of what that is: its number, the most of its 1 / t, and that of all others */
    D8 facing[2];             /* the most of 1 / t of those which are not turned, and of those which are */
} Row;

/* Of d . n at the corners of the windows of eight lanes; spread: Near. */
INLINE void range_of(const double n[3], const double *base, const double spread[2], const Row *row, bool alike,
                     D8 *first, D8 *least, D8 *most) {
    D8 c, s, t;
    dot8(row->q, n, &c);
    if (base) c += row->own * *base;
    *first = c;
    if (alike) {
        *least = c + spread[0], *most = c + spread[1];
        return;
    }
    *least = *most = c;
    dot8(row->u, n, &s), dot8(row->v, n, &t);
    D8 at[3] = {s + c, t + c, s + t + c};
    for (int q = 0; q < 3; q++) keep_min(least, &at[q]), keep_max(most, &at[q]);
}

/* Adds what the windows may see of a triangle. Whether they see any is hard to predict, so nothing hangs on it but how
 * many are found. */
INLINE void meet_row(Store *store, const Places *lie, const Close *close, uint32_t i, uint32_t k, uint32_t on,
                     bool alike, bool far, Row *row) {
    const uint32_t near = close->near[i];
    const Near *t = &store->near.data[near];
    const NearBoxes *box = &close->box;
    const D8 zero = {0};
    uint32_t some = on & upto(*(const Wide *)&lie->lo[0][k], all_D8(box->hi[0][i])) &
                    upto(all_D8(box->lo[0][i]), *(const Wide *)&lie->hi[0][k]) &
                    upto(*(const Wide *)&lie->lo[1][k], all_D8(box->hi[1][i])) &
                    upto(all_D8(box->lo[1][i]), *(const Wide *)&lie->hi[1][k]);
    D8 least, most, first[4], of_edges[2];
    for (int e = 0; e < 4; e++) {
        range_of(t->normal[e], far ? &t->base[e] : NULL, t->spread[e], row, alike, &first[e], &least, &most);
        if (e == 0) of_edges[0] = least, of_edges[1] = most;
        else if (e < 3) of_edges[0] = lower(least, of_edges[0]), of_edges[1] = lower(most, of_edges[1]);
    }
    some &= less(zero, of_edges[1]) & upto(all_D8(-DBL_MAX), least) & upto(most, all_D8(DBL_MAX));
    /* Its plane may come nearer than it does. */
    const D8 nearest = *(const Wide *)&lie->far[k] * t->nearest;
    least = lower(least, nearest), most = lower(most, nearest);
    const uint32_t turned = some & (0 - t->turned), seen = some & upto(row->hidden, most),
                   filling = some & less(zero, of_edges[0]) & less(row->hidden, least);
    row->others = chosen(some, higher(chosen(filling, row->most, most), row->others), row->others);
    row->facing[0] = chosen(some & ~turned, higher(most, row->facing[0]), row->facing[0]);
    row->facing[1] = chosen(turned, higher(most, row->facing[1]), row->facing[1]);
    row->hidden = chosen(filling, least, row->hidden), row->most = chosen(filling, most, row->most);
    row->filling = chosen(filling, all_D8(near), row->filling);
    store->met.data[store->found.n] = (uint8_t)seen;
    Found *to = &store->found.data[store->found.n];
    *(Wide *)to->least = least, *(Wide *)to->most = most;
    for (int e = 0; e < 3; e++) *(Wide *)to->c[e] = first[e];
    to->near = near, to->turned = t->turned;
    store->found.n += seen != 0;
}

/* Of the n numbers most[], from the greatest on, of equal ones the lower triangle first, which place has number i? */
INLINE uint32_t place_of(const Store *store, uint32_t n, uint32_t i) {
    const D8 mine = all_D8(store->most.data[i]);
    uint32_t before = 0;
    for (uint32_t k = 0; k < n; k += 8) {
        const D8 its = *(const Wide *)&store->most.data[k];
        uint32_t equal_ = upto(mine, its);
        const uint32_t greater = less(mine, its);
        before += (uint32_t)__builtin_popcount(greater), equal_ &= ~greater;
        if (k == i / 8 * 8) equal_ &= ~(1u << i % 8);
        for (; equal_; equal_ &= equal_ - 1) {
            const uint32_t a = store->found.data[store->order.data[i]].near,
                           b = store->found.data[store->order.data[k + (uint32_t)__builtin_ctz(equal_)]].near;
            before += store->near.data[b].triangle < store->near.data[a].triangle;
        }
    }
    return before;
}

/* Makes what the window of lane i of the row has met the candidates of lane k, behind the places of all others. */
INLINE void add_candidates(Search *s, Neighbours *group, uint32_t k, uint32_t i) {
    Store *store = s->store;
    uint32_t n = 0;
    memset(store->met.data + store->found.n, 0, 64);
    for (uint32_t at = 0; at < store->found.n; at += 64)
        for (uint64_t who = column(&store->met.data[at], i); who; who &= who - 1) {
            const uint32_t number = at + (uint32_t)__builtin_ctzll(who);
            store->order.data[n] = number, store->most.data[n++] = store->found.data[number].most[i];
        }
    for (uint32_t at = n; at % 8; at++) store->most.data[at] = -HUGE_VAL;
    group->first[k] = OTHER_CANDIDATES, group->count[k] = 0;
    if (!n || !window_room(store, &store->candidate.data, OTHER_CANDIDATES, &store->candidate.room, n,
                           sizeof *store->candidate.data))
        return;
    Candidate *to = store->candidate.data + OTHER_CANDIDATES;
    for (uint32_t at = 0; at < n; at++) {
        const Found *f = &store->found.data[store->order.data[at]];
        to[n <= FEW_FACETS ? place_of(store, n, at) : at] = (Candidate){.least = f->least[i],
                                                                        .most = f->most[i],
                                                                        .triangle = store->near.data[f->near].triangle,
                                                                        .near = f->near,
                                                                        .turned = f->turned};
    }
    group->count[k] = n;
}

/* Puts what the windows `who` of the row from lane k on have met of a triangle among their candidates, each nearest
 * first, and behind the *n parts that are measured later. */
INLINE void add_pairs(Store *store, Neighbours *group, const Row *row, const Found *f, uint32_t k, uint32_t who,
                      bool alike, uint32_t *n) {
    const Near *near = &store->near.data[f->near];
    __builtin_prefetch(near->edge);
    add_parts(store, near, f, row->u, row->v, who, alike, *n);
    for (; who; who &= who - 1, ++*n) {
        const uint32_t i = (uint32_t)__builtin_ctz(who), lane = k + i;
        Candidate *all = store->candidate.data + (size_t)lane * FEW_FACETS;
        const Candidate own = {.least = f->least[i],
                               .most = f->most[i],
                               .triangle = near->triangle,
                               .near = f->near,
                               .part = *n,
                               .turned = f->turned};
        uint32_t at = group->count[lane];
        if (at >= FEW_FACETS) { /* all are looked for again */
            group->count[lane] = FEW_FACETS + 1;
            continue;
        }
        group->count[lane] = at + 1;
        for (; at &&
               (all[at - 1].most < own.most || (all[at - 1].most == own.most && all[at - 1].triangle > own.triangle));
             at--)
            all[at] = all[at - 1];
        all[at] = own;
    }
}

/* Around windows of a row. */
INLINE void around(const Places *lie, uint32_t k, uint32_t who, double lo[2], double hi[2]) {
    const D8 none = all_D8(HUGE_VAL);
    double least[4];
    least_of_four(chosen(who, *(const Wide *)&lie->lo[0][k], none), chosen(who, *(const Wide *)&lie->lo[1][k], none),
                  chosen(who, -*(const Wide *)&lie->hi[0][k], none), chosen(who, -*(const Wide *)&lie->hi[1][k], none),
                  least);
    for (int a = 0; a < 2; a++) lo[a] = least[a], hi[a] = -least[2 + a];
}

INLINE uint32_t in_boxes(const NearBoxes *box, const double lo[2], const double hi[2]) {
    uint32_t in = 255;
    for (int a = 0; a < 2; a++)
        in &= upto(all_D8(lo[a]), *(const Wide *)box->hi[a]) & upto(*(const Wide *)box->lo[a], all_D8(hi[a]));
    return in;
}

/* Finds what is close and may lie in the row's windows; false: out of memory. */
INLINE bool meet_close(Store *store, const Places *lie, uint32_t k, uint32_t on, bool alike, bool far, Row *to) {
    Row row = *to;
    /* Of windows that are filled what lies behind the nearest place that all of them have in front is hidden. */
    uint32_t filled = 0;
    double lo[2], hi[2], open_lo[2], open_hi[2], hidden = -HUGE_VAL;
    const double away = -least_of(-chosen(on, *(const Wide *)&lie->far[k], all_D8(-HUGE_VAL)));
    around(lie, k, on, lo, hi);
    for (uint32_t at = 0; at < store->close.n; at += 8) {
        const Close *close = &store->close.data[at / 8];
        uint32_t in = in_boxes(&close->box, lo, hi);
        if (filled)
            in &= in_boxes(&close->box, open_lo, open_hi) |
                  upto(all_D8(hidden), away * *(const Wide *)close->box.nearest);
        if (!in) continue;
        if (!window_room(store, &store->found.data, store->found.n, &store->found.room, 8, sizeof *store->found.data) ||
            !window_room(store, &store->met.data, store->found.n, &store->met.room, 128, 1))
            return false;
        for (; in; in &= in - 1) meet_row(store, lie, close, (uint32_t)__builtin_ctz(in), k, on, alike, far, &row);
        const uint32_t now = less(all_D8(-HUGE_VAL), row.hidden) & on;
        if (now == 0 || at + 8 >= store->close.n) continue;
        hidden = least_of(chosen(now, row.hidden, all_D8(HUGE_VAL)));
        if (now != filled) around(lie, k, on & ~now, open_lo, open_hi);
        filled = now;
    }
    *to = row;
    return true;
}

/* Packs what is listed and lies in a rectangle; false: out of memory. */
static bool find_close(Store *store, const Rectangle *r) {
    uint32_t n = 0;
    store->close.n = 0;
    if (!window_room(store, &store->close.data, 0, &store->close.room, (store->near.n + 7) / 8,
                     sizeof *store->close.data))
        return false;
    for (uint32_t near = 0; near < store->near.n; near += 8) {
        const NearBoxes *box = &store->boxes.data[near / 8];
        for (uint32_t in = in_boxes(box, r->lo, r->hi); in; in &= in - 1) {
            const uint32_t i = (uint32_t)__builtin_ctz(in);
            Close *to = &store->close.data[n / 8];
            for (int a = 0; a < 2; a++) to->box.lo[a][n % 8] = box->lo[a][i], to->box.hi[a][n % 8] = box->hi[a][i];
            to->box.nearest[n % 8] = box->nearest[i];
            to->near[n++ % 8] = near + i;
        }
    }
    for (uint32_t i = n; i % 8; i++) store->close.data[i / 8].box.lo[0][i % 8] = HUGE_VAL;
    store->close.n = n;
    return true;
}

/* What the windows of the row may see; false: nothing, or out of memory. */
static bool find_in_row(Store *store, const Beams *b, const Places *lie, uint32_t k, uint32_t on, bool alike, bool far,
                        Row *row) {
    for (int a = 0; a < 3; a++) {
        row->q[a] = *(const Wide *)&b->row[BEAM_Q + a][k];
        row->u[a] = *(const Wide *)&b->row[SLT_BEAM_U + a][beam_lane(b, k)];
        row->v[a] = *(const Wide *)&b->row[SLT_BEAM_V + a][beam_lane(b, k)];
    }
    row->own = *(const Wide *)&b->row[BEAM_OWN][k];
    row->hidden = row->most = row->others = row->facing[0] = row->facing[1] = all_D8(-HUGE_VAL);
    row->filling = all_D8(0);
    store->found.n = 0;
    if (!(alike && !far ? meet_close(store, lie, k, on, true, false, row)
                        : meet_close(store, lie, k, on, alike, far, row)) ||
        !store->found.n)
        return false;
    const uint32_t n = store->found.n;
    return window_room(store, &store->order.data, 0, &store->order.room, n, sizeof *store->order.data) &&
           window_room(store, &store->most.data, 0, &store->most.room, n + 8, sizeof *store->most.data);
}

static void survey(Search *s, const Beams *b, const Places *lie, Neighbours *group) {
    Store *store = s->store;
    const bool far = b->far >> group->base & 1; /* they share their eye */
    const uint32_t end = group->last + 1;
    const uint64_t who = b->mask & LOW_BITS(end) & ~0ull << group->base;
    uint32_t parts = 0;
    store->lines.measured = 0;
    group->whole = group->open = 0;
    if (!find_close(store, &group->all) || !window_room(store, &store->candidate.data, 0, &store->candidate.room,
                                                        OTHER_CANDIDATES, sizeof *store->candidate.data))
        return;
    for (uint32_t k = group->base / 8 * 8; k < end; k += 8) {
        const uint32_t on = (uint32_t)(who >> k) & 255;
        Row row;
        for (uint32_t i = 0; i < 8; i++) group->count[k + i] = 0;
        if (!on || !find_in_row(store, b, lie, k, on, group->alike, far, &row)) continue;
        const uint32_t whole = less(row.others, row.hidden) & on;
        group->whole |= (uint64_t)whole << k;
        if (whole) {
            double filling[8];
            memcpy(filling, &row.filling, sizeof filling);
            for (uint32_t left = whole; left; left &= left - 1) {
                const uint32_t i = (uint32_t)__builtin_ctz(left), number = (uint32_t)filling[i];
                group->triangle[k + i] = store->near.data[number].triangle;
            }
        }
        if (whole == on) continue;
        const uint32_t facing[2] = {less(row.facing[1], row.facing[0]), less(row.facing[0], row.facing[1])};
        const uint32_t open = on & ~whole;
        const D8 others = chosen(facing[1], row.facing[0], row.facing[1]);
        /* Where none is nearest, as the others reach as far, it is no sheet: any will do. */
        *(Wide *)&group->others[k] = chosen(open & ~(facing[0] | facing[1]), all_D8(HUGE_VAL),
                                            chosen(less(others, row.hidden), all_D8(-HUGE_VAL), others));
        for (uint32_t i = 0; i < store->found.n; i++) {
            const Found *f = &store->found.data[i];
            const uint32_t met =
                store->met.data[i] & open & ~facing[!f->turned] & ~less(*(const Wide *)f->most, row.hidden);
            if (!met) continue;
            if (parts - store->lines.measured + 8 > LINES && !measure_sheets(s, &parts)) return;
            add_pairs(store, group, &row, f, k, met, group->alike, &parts);
        }
        for (uint32_t left = open; left; left &= left - 1) {
            const uint32_t lane = k + (uint32_t)__builtin_ctz(left);
            group->first[lane] = lane * FEW_FACETS, group->open |= (uint64_t)(group->count[lane] > 0) << lane;
        }
    }
    (void)measure_sheets(s, &parts);
}

static void survey_all(Search *s, const Beams *b, const Places *lie, Neighbours *group, uint32_t lane) {
    Store *store = s->store;
    const uint32_t k = lane / 8 * 8, i = lane % 8;
    Row row;
    group->count[lane] = 0;
    if (!find_in_row(store, b, lie, k, 1u << i, group->alike, b->far >> lane & 1, &row)) return;
    for (uint32_t f = 0; f < store->found.n; f++)
        store->met.data[f] &= (uint8_t)~less(*(const Wide *)store->found.data[f].most, row.hidden);
    add_candidates(s, group, lane, i);
}
