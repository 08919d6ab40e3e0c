/* beam.h, eight boxes or triangles at a time. Include behind facets.inc.h. */
#define OUTSIDE -1e-12 /* of what is added up: rounding */

INLINE void add_size(const D8 *x, D8 *sum) {
    D8 size;
    size_of(x, &size);
    *sum += size;
}

static uint32_t beam_boxes(const BvhNode *n, const BeamPlane *plane, int planes, const double from[3], double slack) {
    D8 lo[3], hi[3];
    for (int a = 0; a < 3; a++) {
        lo[a] = wide_F8(*(const Narrow *)n->lo[a]);
        hi[a] = wide_F8(*(const Narrow *)n->hi[a]);
    }
    L8 in = lo[0] <= hi[0];
    for (int a = 0; a < 3; a++) lo[a] = (lo[a] - from[a]) - slack, hi[a] = (hi[a] - from[a]) + slack;
    for (int p = 0; p < planes; p++) {
        D8 most = (D8){0} + plane[p].off, size = (D8){0} + fabs(plane[p].off);
        for (int a = 0; a < 3; a++) {
            const double by = plane[p].normal[a];
            const D8 part = by * (by > 0 ? hi[a] : lo[a]);
            most += part, add_size(&part, &size);
        }
        in &= ~(most < OUTSIDE * size);
    }
    uint32_t bits = bits_D8(in);
    for (int k = 0; k < BVH_WIDTH; k++) bits &= ~((uint32_t)!n->child[k] << k);
    return bits;
}

static uint32_t beam_triangles(const Bvh *b, int32_t leaf, const BeamPlane *plane, int planes, const double from[3]) {
    D8 at[3][3];
    L8 in = ~(L8){0};
    for (int c = 0; c < 3; c++)
        for (int a = 0; a < 3; a++) {
            if (b->f64) at[c][a] = *(const Wide *)((const BvhLeaf64 *)b->leaf)[leaf].at[c][a];
            else at[c][a] = wide_F8(*(const Narrow *)((const BvhLeaf32 *)b->leaf)[leaf].at[c][a]);
            at[c][a] -= from[a];
        }
    for (int p = 0; p < planes; p++) {
        D8 most, size = (D8){0} + fabs(plane[p].off);
        for (int c = 0; c < 3; c++) {
            D8 sum = (D8){0} + plane[p].off;
            for (int a = 0; a < 3; a++) {
                const D8 part = plane[p].normal[a] * at[c][a];
                sum += part, add_size(&part, &size);
            }
            if (c) keep_max(&most, &sum);
            else most = sum;
        }
        in &= ~(most < OUTSIDE * size);
    }
    return bits_D8(in);
}
