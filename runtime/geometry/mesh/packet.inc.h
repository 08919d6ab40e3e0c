/* Rays that go alike, together: rays.inc.h includes this behind its tests of triangles.
 *
 * A packet is rays of one octant and one longest axis. A node is first tested for all of them, eight children at a
 * time, by intervals of their origins and inverse directions: rounding is monotone, so the interval of what the test of
 * single rays computes is known exactly, and a child that is left out would be left out for each ray. Then its child
 * next in turn is tested for each ray; few that are left go on alone. In a leaf, triangles are left out eight at a time
 * by the intervals of their sheared corners, which lie on one side of all rays. */
#define Packet FN(BvhPacket)
#define bounds_of FN(bounds_of)
#define packet_set FN(packet_set)
#define before_all FN(before_all)
#define beside_all FN(beside_all)
#define pass_box FN(pass_box)
#define meet_packet FN(meet_packet)
#define descend_packet FN(descend_packet)

typedef struct Packet {
    float near[3], far[3], least[3], most[3]; /* of all rays, those that make boxes largest; of the inverse both ends */
    float begin, end;                         /* the least, and the most of those that go on */
    size_t close[3];                          /* the row of a node's nearer sides, in floats */
    int axis[3];                              /* x, y, z of the sheared space */
    flt o_least[3], o_most[3], s_least[2], s_most[2];
} Packet;

INLINE void bounds_of(const flt *row, uint64_t who, flt *least, flt *most) {
    Group low, high;
    low = high = (Group){0} + row[__builtin_ctzll(who)];
    for (uint32_t k = 0; k < RAYS; k += GROUP)
        if (who >> k & LOW_BITS(GROUP)) {
            const Group v = chosen(who >> k & LOW_BITS(GROUP), *(const Group *)(row + k), low);
            low = lower(v, low), high = higher(v, high);
        }
    *least = least_of(low), *most = -least_of(-high);
}

/* False: their directions are too far apart to gain anything. */
INLINE bool packet_set(Packet *p, const Rays *r, uint64_t who) {
    const uint32_t way = (uint32_t)r->way[__builtin_ctzll(who)];
    bounds_of(r->sx, who, &p->s_least[0], &p->s_most[0]);
    bounds_of(r->sy, who, &p->s_least[1], &p->s_most[1]);
    if (!(p->s_most[0] - p->s_least[0] <= SPREAD) || !(p->s_most[1] - p->s_least[1] <= SPREAD)) return false;
    float least, most;
    for (int a = 0; a < 3; a++) {
        const bool down = way & 4u << a;
        p->close[a] = (down ? 24 : 0) + 8 * (size_t)a;
        bounds_of_floats(r->near[a], who, &least, &most);
        p->near[a] = down ? least : most;
        bounds_of_floats(r->far[a], who, &least, &most);
        p->far[a] = down ? most : least;
        bounds_of_floats(r->inverse[a], who, &p->least[a], &p->most[a]);
        p->axis[a] = (int)((way & 3) + 1 + (uint32_t)a) % 3;
        bounds_of(r->o[p->axis[a]], who, &p->o_least[a], &p->o_most[a]);
    }
    bounds_of_floats(r->begin, who, &p->begin, &most);
    bounds_of_floats(r->end, who, &least, &p->end);
    return true;
}

/* Which of the node's boxes any ray of the packet may pass; *enter: not before where. */
INLINE uint32_t before_all(const BvhNode *n, const Packet *p, F8 *enter) {
    F8 in = (F8){0} + p->begin, out = (F8){0} + p->end;
    for (size_t a = 0; a < 3; a++) {
        const float *box = n->lo[0];
        const F8 from = *(const F8 *)(box + p->close[a]) - p->near[a],
                 to = *(const F8 *)(box + (24 + 16 * a - p->close[a])) - p->far[a];
        in = higher(lower(from * p->least[a], from * p->most[a]), in);
        out = lower(higher(to * p->least[a], to * p->most[a]), out);
    }
    *enter = in;
    return upto(in, out);
}

/* Which of the rays pass the box of the node's child. */
INLINE uint64_t pass_box(const BvhNode *n, uint32_t child, const Packet *p, const Rays *r, uint64_t who) {
    const float *box = n->lo[0] + child;
    uint64_t pass = 0;
    for (uint32_t k = 0; k < RAYS; k += MANY) {
        if (!(who >> k & LOW_BITS(MANY))) continue;
        Many in = *(const Many *)(r->begin + k), out = *(const Many *)(r->end + k);
        for (size_t a = 0; a < 3; a++) {
            const Many inverse = *(const Many *)(r->inverse[a] + k);
            in = higher((box[p->close[a]] - *(const Many *)(r->near[a] + k)) * inverse, in);
            out = lower((box[24 + 16 * a - p->close[a]] - *(const Many *)(r->far[a] + k)) * inverse, out);
        }
        pass |= (uint64_t)upto(in, out) << k;
    }
    return pass & who;
}

/* Which of a leaf's triangles are beside all rays. */
INLINE uint32_t beside_all(const Leaf *l, const Packet *p) {
    uint32_t below[2] = {255, 255}, above[2] = {255, 255};
    for (int c = 0; c < 3; c++) {
        const Flt8 along = *(const Flt8 *)l->at[c][p->axis[2]], from = along - p->o_most[2], to = along - p->o_least[2];
        for (int a = 0; a < 2; a++) {
            const Flt8 one = from * p->s_least[a], other = from * p->s_most[a], third = to * p->s_least[a],
                       fourth = to * p->s_most[a], across = *(const Flt8 *)l->at[c][p->axis[a]];
            const Flt8 least = lower(lower(one, other), lower(third, fourth)),
                       most = higher(higher(one, other), higher(third, fourth));
            below[a] &= less((across - p->o_least[a]) - least, (Flt8){0});
            above[a] &= less((Flt8){0}, (across - p->o_most[a]) - most);
        }
    }
    return below[0] | above[0] | below[1] | above[1];
}

/* Rays against the triangles of a leaf. */
INLINE void meet_packet(const BvhScene *s, int32_t leaf, const Packet *p, Rays *r, uint64_t who) {
    const Leaf *l = (const Leaf *)s->bvh->leaf + leaf;
    Leaf now;
    if (s->moved) moved_leaf(s, l, &now), l = &now;
    const int kx = p->axis[0], ky = p->axis[1], kz = p->axis[2];
    uint32_t left = ~beside_all(l, p) & 255, lanes = 0;
    for (uint32_t k = 0; k < RAYS; k += GROUP) lanes += who >> k & LOW_BITS(GROUP) ? GROUP : 0;
    /* Few rays are sooner through with eight triangles each than the triangles that are left with all lanes. */
    if (LANES_A_RAY * (uint32_t)__builtin_popcountll(who) <= lanes * (uint32_t)__builtin_popcount(left)) {
        meet_rays(l, r, who);
        return;
    }
    for (; left; left &= left - 1) {
        const int i = __builtin_ctz(left);
        if (l->triangle[i] < 0) continue;
        for (uint32_t k = 0; k < RAYS; k += GROUP) {
            if (!(who >> k & LOW_BITS(GROUP))) continue;
            const Group ox = *(const Group *)(r->o[kx] + k), oy = *(const Group *)(r->o[ky] + k),
                        oz = *(const Group *)(r->o[kz] + k), sx = *(const Group *)(r->sx + k),
                        sy = *(const Group *)(r->sy + k), sz = *(const Group *)(r->sz + k);
            Group x[3], y[3], z[3];
            for (int c = 0; c < 3; c++) {
                const Group along = l->at[c][kz][i] - oz;
                x[c] = (l->at[c][kx][i] - ox) - sx * along;
                y[c] = (l->at[c][ky][i] - oy) - sy * along;
                z[c] = sz * along;
            }
            uint32_t plus = 0, minus = 0;
            for (int c = 0; c < 3; c++) {
                const Group one = x[(c + 1) % 3] * y[(c + 2) % 3], other = y[(c + 1) % 3] * x[(c + 2) % 3];
                plus |= less(other, one), minus |= less(one, other);
            }
            uint32_t may = ~(plus & minus) & (uint32_t)(who >> k & LOW_BITS(GROUP));
            if (!may) continue;
            const Group low = lower(z[2], lower(z[1], z[0])), high = higher(z[2], higher(z[1], z[0]));
            may &= upto(low, *(const Group *)(r->t + k)) & upto(*(const Group *)(r->t0 + k), high);
            for (uint32_t h = 0; h < GROUP && may >> h; h += 8) {
                typedef union {
                    Group all;
                    Flt8 part[GROUP / 8];
                } Parts;
                uint32_t here = may >> h & 255;
                if (!here) continue;
                Flt8 xs[3], ys[3], zs[3], t;
                D8 before;
                for (int c = 0; c < 3; c++)
                    xs[c] = ((Parts){x[c]}).part[h / 8], ys[c] = ((Parts){y[c]}).part[h / 8],
                    zs[c] = ((Parts){z[c]}).part[h / 8];
                here &= inside(xs, ys, zs, ((Parts){low}).part[h / 8], ((Parts){high}).part[h / 8], &t, &before);
                for (; here; here &= here - 1) {
                    const uint32_t ray = (uint32_t)__builtin_ctz(here);
                    take(r, k + h + ray, t[ray], before[ray], l->triangle[i]);
                }
            }
        }
    }
}

/* False, and nothing done, where they are too far apart. */
static bool descend_packet(const BvhScene *s, Rays *r, Turns *w, uint64_t who, bool any) {
    typedef struct {
        float at[8];
    } Enters;
    struct Branch {
        float enter;
        uint32_t node, child;
        uint64_t who;
    } stack[BVH_STACK];
    Packet p;
    if (!packet_set(&p, r, who)) return false;
    uint32_t depth = 0, at = 0;
    uint64_t here = who;
    for (;;) {
        const BvhNode *n = &s->bvh->node[at];
        F8 in;
        Enters enter;
        uint32_t hit = before_all(n, &p, &in), bottom = depth;
        memcpy(&enter, &in, sizeof enter);
        for (; hit; hit &= hit - 1) {
            const struct Branch b = {enter.at[__builtin_ctz(hit)], at, (uint32_t)__builtin_ctz(hit), here};
            fetch(s, n->child[b.child]);
            uint32_t i = depth++;
            for (; i > bottom && stack[i - 1].enter < b.enter; i--) stack[i] = stack[i - 1];
            stack[i] = b;
        }
        /* Until another node is entered. */
        for (;;) {
            if (!depth) return true;
            const struct Branch *b = &stack[--depth];
            if (b->enter > p.end) continue;
            n = &s->bvh->node[b->node];
            const int32_t child = n->child[b->child];
            here = pass_box(n, b->child, &p, r, b->who & who);
            if (!here) continue;
            const int many = __builtin_popcountll(here);
            if (child < 0) {
                if (many <= FEW_IN_LEAF) meet_each(s, r, here, ~child);
                else meet_packet(s, ~child, &p, r, here);
            } else if (many > FEW) {
                at = (uint32_t)child;
                break;
            } else if (many > 1) descend_mixed(s, r, w, here, child, any);
            else {
                leave_each(s, r, w, here, child, b->enter, any);
                continue;
            }
            for (uint64_t k = any ? here : 0; k; k &= k - 1)
                if (r->triangle[__builtin_ctzll(k)] >= 0) who &= ~(k & -k);
            if (!who) return true;
            float least;
            bounds_of_floats(r->end, who, &least, &p.end);
        }
    }
}
