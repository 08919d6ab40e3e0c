/* beam.h, eight boxes or triangles at a time, in parts of what a register holds. Include behind lanes.h. */
#define OUTSIDE -1e-12     /* of what is added up: rounding */
#define CONE_MARGIN 1e-4 /* of the way to what is looked at: rounding is far below */

static uint32_t beam_boxes(const BvhNode *n, const BeamPlane *plane, int planes, const double from[3], double slack) {
    uint32_t bits = 0;
    for (int k = 0; k < BVH_WIDTH; k += SOME) {
        Some lo[3], hi[3];
        for (int a = 0; a < 3; a++) lo[a] = some_floats(n->lo[a] + k), hi[a] = some_floats(n->hi[a] + k);
        uint32_t in = upto_some(lo[0], hi[0]);
        for (int a = 0; a < 3; a++) lo[a] = (lo[a] - from[a]) - slack, hi[a] = (hi[a] - from[a]) + slack;
        for (int p = 0; p < planes; p++) {
            Some most = (Some){0} + plane[p].off, size = (Some){0} + fabs(plane[p].off);
            for (int a = 0; a < 3; a++) {
                const double by = plane[p].normal[a];
                const Some part = by * (by > 0 ? hi[a] : lo[a]);
                most += part, size += size_some(part);
            }
            in &= ~less_some(most, OUTSIDE * size);
        }
        bits |= in << k;
    }
    for (int k = 0; k < BVH_WIDTH; k++) bits &= ~((uint32_t)!n->child[k] << k);
    return bits;
}

/* The corners of triangles k to k + SOME - 1 of a leaf, from a point. */
INLINE void beam_corners(const Bvh *b, int32_t leaf, int k, const double from[3], Some at[3][3]) {
    for (int c = 0; c < 3; c++)
        for (int a = 0; a < 3; a++) {
            if (b->f64) at[c][a] = some_doubles(((const BvhLeaf64 *)b->leaf)[leaf].at[c][a] + k);
            else at[c][a] = some_floats(((const BvhLeaf32 *)b->leaf)[leaf].at[c][a] + k);
            at[c][a] -= from[a];
        }
}

static uint32_t beam_triangles(const Bvh *b, int32_t leaf, const BeamPlane *plane, int planes, const double from[3]) {
    uint32_t bits = 0;
    for (int k = 0; k < BVH_LEAF; k += SOME) {
        Some at[3][3];
        uint32_t in = ~0u >> (32 - SOME);
        beam_corners(b, leaf, k, from, at);
        for (int p = 0; p < planes; p++) {
            Some most = {0}, size = (Some){0} + fabs(plane[p].off);
            for (int c = 0; c < 3; c++) {
                Some sum = (Some){0} + plane[p].off;
                for (int a = 0; a < 3; a++) {
                    const Some part = plane[p].normal[a] * at[c][a];
                    sum += part, size += size_some(part);
                }
                most = c ? higher_some(sum, most) : sum;
            }
            in &= ~less_some(most, OUTSIDE * size);
        }
        bits |= in << k;
    }
    return bits;
}

/* Are all before the light's plane? */
INLINE uint32_t boxes_before(const BvhNode *n, int k, const BeamSight *s) {
    Some most = {0};
    for (int a = 0; a < 3; a++) {
        const double by = s->along[a];
        most += by * (some_floats((by > 0 ? n->hi[a] : n->lo[a]) + k) - s->p[a]);
    }
    return less_some(most, (Some){0} + s->beyond);
}

static uint32_t beam_alike(const BvhNode *n, const ConeNode *c, const BeamSight *s) {
    uint32_t bits = 0;
    for (int k = 0; k < BVH_WIDTH; k += SOME) {
        Some way[3], axis[3], along = {0}, square = {0};
        for (int a = 0; a < 3; a++) {
            way[a] = s->p[a] - some_floats(c->middle[a] + k), axis[a] = some_floats(c->axis[a] + k);
            along += way[a] * axis[a];
        }
        for (int a = 0; a < 3; a++) {
            const int b = a < 2 ? a + 1 : 0;
            const Some part = way[a] * axis[b] - way[b] * axis[a];
            square += part * part;
        }
        /* n . way of all normals is at least |along| cosine - |across| sine, or at most as much less than 0. */
        const Some cosine = some_floats(c->cosine + k) - CONE_MARGIN, sine = some_floats(c->sine + k) + CONE_MARGIN,
                   more = size_some(along) * cosine - (some_floats(c->off + k) + s->near);
        uint32_t alike = less_some((Some){0}, more) & less_some(square * (sine * sine), more * more);
        if (alike && s->beyond < (double)HUGE_VALF) alike &= boxes_before(n, k, s);
        bits |= alike << k;
    }
    return bits;
}

/* The same operations as light_facing. */
static BeamFacings beam_facings(const Bvh *b, int32_t leaf, const BeamSight *s) {
    BeamFacings of = {0};
    for (int k = 0; k < BVH_LEAF; k += SOME) {
        Some at[3][3], way[2][3], normal[3], det, square, least = {0};
        beam_corners(b, leaf, k, s->p, at);
        for (int i = 0; i < 2; i++)
            for (int a = 0; a < 3; a++) way[i][a] = at[i + 1][a] - at[0][a];
        for (int a = 0; a < 3; a++) {
            const int p = a < 2 ? a + 1 : 0, q = p < 2 ? p + 1 : 0;
            normal[a] = way[0][p] * way[1][q] - way[0][q] * way[1][p];
        }
        det = at[0][0] * normal[0] + at[0][1] * normal[1] + at[0][2] * normal[2];
        square = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2];
        const uint32_t hides = less_some(s->near * s->near * square, det * det) & upto_some(det - det, (Some){0}),
                       away = hides & ~less_some(det, (Some){0});
        uint32_t before = ~0u;
        if (s->beyond < (double)HUGE_VALF) {
            for (int c = 0; c < 3; c++) {
                const Some h = s->along[0] * at[c][0] + s->along[1] * at[c][1] + s->along[2] * at[c][2];
                least = c ? lower_some(h, least) : h;
            }
            before = less_some(least, (Some){0} + s->beyond);
        }
        of.low |= ((hides & ~before) | (away & before)) << k, of.high |= (hides & before) << k;
    }
    return of;
}
