/* Rays that go apart, together as long as they meet the same nodes: rays.inc.h includes this behind its tests of single
 * rays. One ray after the other is tested against a node's eight boxes, or many rays against one box after the other,
 * without a decision in between; then the node's children in turn are entered by the rays that pass them. A child that
 * few rays pass waits until the others are done. */
#define near_each_other FN(near_each_other)
#define descend_mixed FN(descend_mixed)

/* Do they begin so near each other that they meet the same nodes at first? */
INLINE bool near_each_other(const BvhScene *s, const Rays *r, uint64_t who) {
    const float apart = (float)(s->bvh->magnitude * NEAR);
    for (int a = 0; a < 3; a++) {
        float least, most;
        bounds_of_floats(r->near[a], who, &least, &most);
        if (!(most - least <= apart)) return false;
    }
    return true;
}

static void descend_mixed(const BvhScene *s, Rays *r, Turns *w, uint64_t who, int32_t at, bool any) {
    struct Branch {
        uint64_t who;
        int32_t child;
        float enter;
    } stack[BVH_STACK];
    uint32_t depth = 0;
    uint64_t here = who;
    for (;;) {
        const BvhNode *n = &s->bvh->node[at];
        uint64_t passed[BVH_WIDTH];
        float enter[8] __attribute__((aligned(32)));
        if (__builtin_popcountll(here) >= MANY_MIXED) pass_many(n, r, here, passed, enter, any);
        else {
            uint8_t pass[RAYS] __attribute__((aligned(64))) = {0};
            F8 nearest = all_F8(HUGE_VALF);
            for (uint64_t k = here; k; k &= k - 1) {
                F8 in;
                const uint32_t ray = (uint32_t)__builtin_ctzll(k), boxes = pass_boxes(n, r, ray, &in);
                pass[ray] = (uint8_t)boxes;
                if (!any) nearest = lower(chosen(boxes, in, nearest), nearest);
            }
            *(F8 *)enter = nearest;
            for (uint32_t child = 0; child < BVH_WIDTH; child++) passed[child] = column(pass, child);
        }
        const uint32_t bottom = depth;
        uint32_t some = 0;
        for (uint32_t child = 0; child < BVH_WIDTH; child++) some |= (uint32_t)(passed[child] != 0) << child;
        for (; some; some &= some - 1) {
            const uint32_t child = (uint32_t)__builtin_ctz(some);
            const struct Branch b = {passed[child], n->child[child], enter[child]};
            fetch(s, b.child);
            uint32_t i = depth++;
            for (; i > bottom && stack[i - 1].enter < b.enter; i--) stack[i] = stack[i - 1];
            stack[i] = b;
        }
        /* Until another node is entered. */
        for (;;) {
            if (!depth) return;
            depth--;
            here = stack[depth].who & who;
            at = stack[depth].child;
            if (!here) continue;
            if (at < 0) meet_each(s, r, here, ~at);
            else if (__builtin_popcountll(here) > FEW_MIXED) break;
            else {
                leave_each(s, r, w, here, at, stack[depth].enter, any);
                continue;
            }
            for (uint64_t k = any ? here : 0; k; k &= k - 1)
                if (r->triangle[__builtin_ctzll(k)] >= 0) who &= ~(k & -k);
            if (!who) return;
        }
    }
}
