/* Rays each for itself, in turns: rays.inc.h includes this behind its tests of single rays. A ray alone waits at every
 * node: for memory, for the test, and for where to go, which no processor guesses well. So in each round every ray goes
 * one step, at a node or at a leaf: no step waits for another, nor branches where numbers can tell as well. A round has
 * passes of few instructions, so that many rays are in flight: nodes, leaves, triangles that may be met, then where to.
 */
#define Turns FN(BvhTurns)
#define enter_of FN(enter_of)
#define find_next FN(find_next)
#define go FN(go)
#define go_on FN(go_on)
#define in_turns FN(in_turns)
#define turns_any FN(turns_any)
#define turns_first FN(turns_first)
#define turns_set FN(turns_set)
#define nothing_waits FN(nothing_waits)
#define descend_each FN(descend_each)
#define finish_each FN(finish_each)
#define leave_each FN(leave_each)

/* A child that waits: above where it is entered, as the bits of a float, below its number. Of two the lower is entered
 * first, but before 0, where order matters least. */
#define LAST ((int64_t)0xff800000ffffffff) /* lies below all: -infinity, never passed over; which child does not matter */

typedef struct Turns {
    int64_t waiting[RAYS][WAITS_ATONCE + LATER + BVH_STACK + WAITS_ATONCE]; /* more than count are read and written */
    int64_t child[RAYS][BVH_WIDTH] __attribute__((aligned(64))); /* by place in `node`: those that wait there, */
    uint32_t passed[RAYS];                                       /* and which of them the ray passes */
    uint32_t depth[RAYS];                                        /* how many wait; WAITS_ATONCE - 1: the ray is done */
    int32_t at[RAYS];
    uint8_t node[RAYS], leaf[RAYS], /* rays that are there in this round */
        may[RAYS], met[RAYS];       /* which triangles of its leaf a ray may meet; rays that may */
    uint32_t nodes, leaves;         /* how many */
    uint64_t later;                 /* rays for which something waits */
    uintptr_t from[2];              /* nodes and leaves lie from here, */
    size_t size[2];                 /* so large */
} Turns;

INLINE float enter_of(int64_t wait) {
    const int32_t bits = (int32_t)(wait >> 32);
    float enter;
    memcpy(&enter, &bits, sizeof enter);
    return enter;
}

/* Where in waiting[k], below depth, the topmost lies that may still be met; LAST lies there eight times, so that eight
 * can be read. */
INLINE uint32_t find_next(const Turns *w, const Rays *r, uint32_t k, uint32_t depth, bool any) {
    if (any) return depth - 1;
#if WAITS_BY_LANES
    int32_t end;
    memcpy(&end, &r->end[k], sizeof end);
    const int64_t most = (int64_t)((uint64_t)(uint32_t)(end < 0 ? INT32_MAX : end) << 32 | 0xffffffff);
    for (;; depth -= WAITS_ATONCE) {
        const uint32_t may = waits_upto(w->waiting[k] + depth - WAITS_ATONCE, most);
        if (may) return depth - WAITS_ATONCE + 31 - (uint32_t)__builtin_clz(may);
    }
#else
    while (enter_of(w->waiting[k][depth - 1]) > r->end[k]) depth--;
    return depth - 1;
#endif
}

/* Ray k goes to `wait`, below which `depth` wait. */
INLINE void go(Turns *w, uint32_t k, int64_t wait, uint32_t depth) {
    const int32_t at = (int32_t)(uint32_t)wait;
    const uint32_t leaf = at < 0;
    w->at[k] = at, w->depth[k] = depth;
    w->node[w->nodes] = w->leaf[w->leaves] = (uint8_t)k;
    w->nodes += !leaf, w->leaves += leaf & (depth >= WAITS_ATONCE);
    /* It is read in the next round. */
    const uintptr_t from = w->from[leaf] + (size_t)(at ^ -(int32_t)leaf) * w->size[leaf];
    for (size_t line = 0; line < sizeof(Leaf); line += 64) __builtin_prefetch((const void *)(from + line));
}

/* Puts the children of a node that ray k has passed on top of what waits for it, the nearest topmost, and takes the
 * top. Most often they are at most two, by lanes four come for free. */
INLINE void go_on(Turns *w, const Rays *r, uint32_t k, uint32_t i, bool any) {
    const uint32_t depth = w->depth[k], passed = w->passed[i], count = (uint32_t)__builtin_popcount(passed);
    const uint32_t next = find_next(w, r, k, depth, any);
    int64_t *const to = w->waiting[k] + depth;
#if WAITS_BY_LANES
    if (any) waits_copy(w->child[i], to);
    else {
        waits_sort_four(w->child[i], to);
        for (uint32_t c = 4; c < count; c++) {
            uint32_t place = c;
            const int64_t more = w->child[i][c];
            for (; place > 0 && to[place - 1] < more; place--) to[place] = to[place - 1];
            to[place] = more;
        }
    }
#else
    const int64_t *child = w->child[i];
    const uint32_t others = passed & (passed - 1);
    const int64_t one = child[__builtin_ctz(passed | 1 << 7)],
                  other = others ? child[__builtin_ctz(others | 1 << 7)] : INT64_MIN;
    to[0] = one > other ? one : other, to[1] = one > other ? other : one;
    uint32_t end = 2;
    for (uint32_t left = others & (others - 1); left; left &= left - 1) {
        const int64_t more = child[__builtin_ctz(left)];
        uint32_t place = end++;
        for (; !any && place > 0 && to[place - 1] < more; place--) to[place] = to[place - 1];
        to[place] = more;
    }
#endif
    const uint32_t down = depth + count - 1, below = count ? down : next;
    go(w, k, w->waiting[k][below], below);
}

/* Until no ray is at a node or leaf. */
INLINE void in_turns(const BvhScene *s, Rays *r, Turns *w, bool any) {
    while (w->nodes | w->leaves) {
        const uint32_t nodes = w->nodes, leaves = w->leaves;
        for (uint32_t i = 0; i < nodes; i++) {
            const uint32_t k = w->node[i];
            const BvhNode *n = &s->bvh->node[w->at[k]];
            F8 in;
            const uint32_t passed = pass_boxes(n, r, k, &in);
            w->passed[i] = passed;
            waits_of(in, n->child, passed, w->child[i]);
        }
        uint32_t mets = 0;
        if (s->moved)
            for (uint32_t i = 0; i < leaves; i++) meet_each(s, r, (uint64_t)1 << w->leaf[i], ~w->at[w->leaf[i]]);
        else
            for (uint32_t i = 0; i < leaves; i++) {
                const uint32_t k = w->leaf[i], may = may_meet((const Leaf *)s->bvh->leaf + ~w->at[k], r, k);
                w->met[mets] = (uint8_t)k, w->may[mets] = (uint8_t)may;
                mets += may != 0;
            }
        for (uint32_t i = 0; i < mets; i++)
            meet_those((const Leaf *)s->bvh->leaf + ~w->at[w->met[i]], r, w->met[i], w->may[i]);
        uint8_t now[2 * RAYS];
        memcpy(now, w->node, RAYS);
        memcpy(now + nodes, w->leaf, RAYS);
        w->nodes = w->leaves = 0;
        for (uint32_t i = 0; i < nodes; i++) go_on(w, r, now[i], i, any);
        for (uint32_t i = nodes; i < nodes + leaves; i++) {
            const uint32_t k = now[i], depth = any && r->triangle[k] >= 0 ? WAITS_ATONCE : w->depth[k];
            const uint32_t next = find_next(w, r, k, depth, any);
            go(w, k, w->waiting[k][next], next);
        }
    }
}

static void turns_first(const BvhScene *s, Rays *r, Turns *w) { in_turns(s, r, w, false); }

static void turns_any(const BvhScene *s, Rays *r, Turns *w) { in_turns(s, r, w, true); }

INLINE void turns_set(Turns *w, const BvhScene *s) {
    w->nodes = w->leaves = 0, w->later = 0;
    w->from[0] = (uintptr_t)s->bvh->node, w->size[0] = sizeof(BvhNode);
    w->from[1] = (uintptr_t)s->bvh->leaf, w->size[1] = sizeof(Leaf);
}

INLINE void nothing_waits(Turns *w, uint32_t k) {
    for (int i = 0; i < WAITS_ATONCE; i++) w->waiting[k][i] = LAST;
    w->depth[k] = WAITS_ATONCE;
}

/* Rays from the root on, each for itself. */
INLINE void descend_each(const BvhScene *s, Rays *r, Turns *w, uint64_t who, bool any) {
    /* Of many most may pass nothing. */
    if (__builtin_popcountll(who) >= MANY_EACH) {
        uint64_t passed[BVH_WIDTH];
        float nearest[BVH_WIDTH];
        pass_many(&s->bvh->node[0], r, who, passed, nearest, true);
        who = 0;
        for (int c = 0; c < BVH_WIDTH; c++) who |= passed[c];
    }
    for (; who; who &= who - 1) {
        const uint32_t k = (uint32_t)__builtin_ctzll(who);
        nothing_waits(w, k);
        w->at[k] = 0, w->node[w->nodes++] = (uint8_t)k;
    }
    (any ? turns_any : turns_first)(s, r, w);
}

/* What waits for the rays `who`, each for itself. */
INLINE void finish_each(const BvhScene *s, Rays *r, Turns *w, uint64_t who, bool any) {
    w->later &= ~who;
    for (; who; who &= who - 1) {
        const uint32_t k = (uint32_t)__builtin_ctzll(who), next = find_next(w, r, k, w->depth[k], any);
        if (!any || r->triangle[k] < 0) go(w, k, w->waiting[k][next], next);
    }
    (any ? turns_any : turns_first)(s, r, w);
}

/* Rays will go on at a child that they enter there, each for itself. */
INLINE void leave_each(const BvhScene *s, Rays *r, Turns *w, uint64_t who, int32_t child, float enter, bool any) {
    int32_t bits;
    memcpy(&bits, &enter, sizeof bits);
    const int64_t wait = (int64_t)((uint64_t)(uint32_t)bits << 32 | (uint32_t)child);
    for (; who; who &= who - 1) {
        const uint32_t k = (uint32_t)__builtin_ctzll(who);
        if (!(w->later >> k & 1)) nothing_waits(w, k), w->later |= (uint64_t)1 << k;
        w->waiting[k][w->depth[k]++] = wait;
        if (w->depth[k] == WAITS_ATONCE + LATER) finish_each(s, r, w, (uint64_t)1 << k, any);
    }
}
