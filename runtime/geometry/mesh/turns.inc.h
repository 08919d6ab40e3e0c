/* Rays each for itself, in turns: rays.inc.h includes this behind its tests of single rays. Where a tree is larger than
 * the caches a ray waits for memory at every node. So all rays that are at nodes are tested against their boxes,
 * without a decision in between, and memory serves many at once; then each ray decides where it goes. */
#define Turns FN(BvhTurns)
#define next_waiting FN(next_waiting)
#define choose FN(choose)
#define in_turns FN(in_turns)
#define turns_any FN(turns_any)
#define turns_first FN(turns_first)

typedef struct Turns {
    struct {
        float enter;
        int32_t child;
    } waiting[RAYS][BVH_STACK];
    uint32_t depth[RAYS];
    int32_t at[RAYS];
    float enter[RAYS][BVH_WIDTH] __attribute__((aligned(64)));
    uint8_t pass[RAYS];
} Turns;

/* Ray k goes to what waits on top and may still be met. False: nothing waits. */
INLINE bool next_waiting(Turns *w, const Rays *r, uint32_t k, bool any) {
    do {
        if (!w->depth[k]) return false;
        w->depth[k]--;
    } while (!any && w->waiting[k][w->depth[k]].enter > r->end[k]);
    w->at[k] = w->waiting[k][w->depth[k]].child;
    return true;
}

/* Ray k goes to the nearest child that it has met; the others wait, the nearest of them on top. */
INLINE void choose(const BvhScene *s, Turns *w, uint32_t k, bool any) {
    const BvhNode *n = &s->bvh->node[w->at[k]];
    const float *enter = w->enter[k];
    uint32_t hit = w->pass[k], i = (uint32_t)__builtin_ctz(hit), depth = w->depth[k], bottom = depth;
    float nearest = enter[i];
    int32_t at = n->child[i];
    while (hit &= hit - 1) {
        i = (uint32_t)__builtin_ctz(hit);
        float far = enter[i];
        int32_t other = n->child[i];
        fetch(s, other);
        if (far < nearest) {
            const float f = nearest;
            const int32_t c = at;
            nearest = far, at = other, far = f, other = c;
        }
        uint32_t place = depth++;
        for (; !any && place > bottom && w->waiting[k][place - 1].enter < far; place--)
            w->waiting[k][place] = w->waiting[k][place - 1];
        w->waiting[k][place].enter = far, w->waiting[k][place].child = other;
    }
    w->at[k] = at, w->depth[k] = depth;
}

INLINE void in_turns(const BvhScene *s, Rays *r, uint64_t who, uint32_t node, bool any) {
    Turns w;
    for (uint64_t left = who; left; left &= left - 1) {
        const uint32_t k = (uint32_t)__builtin_ctzll(left);
        w.at[k] = (int32_t)node, w.depth[k] = 0;
    }
    for (uint64_t nodes = who, leaves = 0; nodes | leaves;) {
        for (uint64_t left = nodes; left; left &= left - 1) {
            const uint32_t k = (uint32_t)__builtin_ctzll(left);
            F8 in;
            w.pass[k] = (uint8_t)pass_boxes(&s->bvh->node[w.at[k]], r, k, &in);
            *(F8 *)w.enter[k] = in;
        }
        for (uint64_t left = leaves; left; left &= left - 1)
            meet_each(s, r, left & -left, ~w.at[__builtin_ctzll(left)]);
        uint64_t go_on = 0, to_leaf = 0;
        for (uint64_t left = nodes | leaves; left; left &= left - 1) {
            const uint32_t k = (uint32_t)__builtin_ctzll(left);
            if (nodes >> k & 1 && w.pass[k]) choose(s, &w, k, any);
            else if ((any && r->triangle[k] >= 0) || !next_waiting(&w, r, k, any)) continue;
            go_on |= (uint64_t)1 << k;
            to_leaf |= (uint64_t)(w.at[k] < 0) << k;
        }
        nodes = go_on & ~to_leaf, leaves = go_on & to_leaf;
    }
}

static void turns_first(const BvhScene *s, Rays *r, uint64_t who, uint32_t node) { in_turns(s, r, who, node, false); }

static void turns_any(const BvhScene *s, Rays *r, uint64_t who, uint32_t node) { in_turns(s, r, who, node, true); }
