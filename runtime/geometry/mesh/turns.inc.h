/* Rays each for itself, in turns: rays.inc.h includes this behind its tests of single rays. A ray alone waits at every
 * node: for memory, for the test, and for where to go, which no processor guesses well. So in each round every ray goes
 * one step, at a node or at a leaf: no step waits for another, nor branches where numbers can tell as well. */
#define Turns FN(BvhTurns)
#define enter_of FN(enter_of)
#define push_passed FN(push_passed)
#define pop_next FN(pop_next)
#define in_turns FN(in_turns)
#define turns_any FN(turns_any)
#define turns_first FN(turns_first)
#define descend_each FN(descend_each)

/* A child that waits: above where it is entered, as the bits of a float, below its number. Of two the lower is entered
 * first, but before 0, where order matters least. */
#define LAST ((int64_t)0xff800000ffffffff) /* lies below all: -infinity, never passed over; which child does not matter */

typedef struct Turns {
    int64_t waiting[RAYS][1 + BVH_STACK + 2]; /* two more than count are written */
    uint32_t depth[RAYS];                     /* how many wait; 0: the ray is done */
    int32_t at[RAYS];
    uint8_t node[2][RAYS], leaf[2][RAYS]; /* rays that are there, in this round and the next */
    uint32_t nodes, leaves;               /* how many, in the next */
    uintptr_t from[2];                    /* nodes and leaves lie from here, */
    size_t size[2];                       /* so large */
} Turns;

INLINE float enter_of(int64_t wait) {
    const int32_t bits = (int32_t)(wait >> 32);
    float enter;
    memcpy(&enter, &bits, sizeof enter);
    return enter;
}

/* Of what waits ray k goes to the top, if that may still be met. */
INLINE void pop_next(Turns *w, const Rays *r, uint32_t k, uint32_t depth, int next, bool any) {
    int64_t wait = w->waiting[k][--depth];
    while (!any && enter_of(wait) > r->end[k]) wait = w->waiting[k][--depth];
    const int32_t at = (int32_t)(uint32_t)wait;
    const uint32_t leaf = at < 0;
    w->at[k] = at, w->depth[k] = depth;
    w->node[next][w->nodes] = w->leaf[next][w->leaves] = (uint8_t)k;
    w->nodes += !leaf, w->leaves += leaf & (depth > 0);
    /* It is read in the next round. */
    const uintptr_t from = w->from[leaf] + (size_t)(at ^ -(int32_t)leaf) * w->size[leaf];
    for (size_t line = 0; line < sizeof(Leaf); line += 64) __builtin_prefetch((const void *)(from + line));
}

/* Puts the children of a node that ray k has passed on top of what waits for it, the nearest topmost. Most often they
 * are at most two. Returns how many wait. */
INLINE uint32_t push_passed(Turns *w, uint32_t k, const BvhNode *n, uint32_t passed, F8 in, bool any) {
    typedef uint32_t U8 __attribute__((vector_size(32)));
    typedef uint64_t UL8 __attribute__((vector_size(64)));
    enum { NONE = 8 };
    int64_t child[NONE + 1] __attribute__((aligned(64)));
    *(UL8 *)child = __builtin_convertvector((U8)in, UL8) << 32 | __builtin_convertvector(*(const U8 *)n->child, UL8);
    child[NONE] = INT64_MIN;
    int64_t *const to = w->waiting[k] + w->depth[k];
    const uint32_t count = (uint32_t)__builtin_popcount(passed), others = passed & (passed - 1);
    const int64_t one = child[__builtin_ctz(passed | 1 << NONE)], other = child[__builtin_ctz(others | 1 << NONE)];
    to[0] = one > other ? one : other, to[1] = one > other ? other : one;
    uint32_t end = 2;
    for (uint32_t left = others & (others - 1); left; left &= left - 1) {
        const int64_t more = child[__builtin_ctz(left)];
        uint32_t place = end++;
        for (; !any && place > 0 && to[place - 1] < more; place--) to[place] = to[place - 1];
        to[place] = more;
    }
    return w->depth[k] + count;
}

INLINE void in_turns(const BvhScene *s, Rays *r, uint64_t who, int32_t node, bool any) {
    Turns w;
    w.nodes = w.leaves = 0;
    w.from[0] = (uintptr_t)s->bvh->node, w.size[0] = sizeof(BvhNode);
    w.from[1] = (uintptr_t)s->bvh->leaf, w.size[1] = sizeof(Leaf);
    for (; who; who &= who - 1) {
        const uint32_t k = (uint32_t)__builtin_ctzll(who);
        w.waiting[k][0] = LAST, w.depth[k] = 1;
        w.at[k] = node, w.node[0][w.nodes++] = (uint8_t)k;
    }
    for (int now = 0; w.nodes | w.leaves; now = !now) {
        const uint32_t nodes = w.nodes, leaves = w.leaves;
        w.nodes = w.leaves = 0;
        for (uint32_t i = 0; i < nodes; i++) {
            const uint32_t k = w.node[now][i];
            const BvhNode *n = &s->bvh->node[w.at[k]];
            F8 in;
            const uint32_t passed = pass_boxes(n, r, k, &in);
            pop_next(&w, r, k, push_passed(&w, k, n, passed, in, any), !now, any);
        }
        for (uint32_t i = 0; i < leaves; i++) {
            const uint32_t k = w.leaf[now][i];
            meet_each(s, r, (uint64_t)1 << k, ~w.at[k]);
            pop_next(&w, r, k, any && r->triangle[k] >= 0 ? 1 : w.depth[k], !now, any);
        }
    }
}

static void turns_first(const BvhScene *s, Rays *r, uint64_t who, int32_t node) { in_turns(s, r, who, node, false); }

static void turns_any(const BvhScene *s, Rays *r, uint64_t who, int32_t node) { in_turns(s, r, who, node, true); }

/* Rays from a node on, each for itself. */
INLINE void descend_each(const BvhScene *s, Rays *r, uint64_t who, int32_t node, bool any) {
    (any ? turns_any : turns_first)(s, r, who, node);
}
