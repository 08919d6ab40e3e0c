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
        lo[a] = __builtin_convertvector(*(const Narrow *)n->lo[a], D8);
        hi[a] = __builtin_convertvector(*(const Narrow *)n->hi[a], D8);
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
            else at[c][a] = __builtin_convertvector(*(const Narrow *)((const BvhLeaf32 *)b->leaf)[leaf].at[c][a], D8);
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

/* Of the way to what is looked at: rounding is far below. */
#define CONE_MARGIN 1e-4

static uint32_t beam_alike(const BvhNode *n, const ConeNode *c, const BeamSight *s) {
    D8 way[3], axis[3], along = {0}, square = {0};
    for (int a = 0; a < 3; a++) {
        way[a] = s->p[a] - __builtin_convertvector(*(const Narrow *)c->middle[a], D8);
        axis[a] = __builtin_convertvector(*(const Narrow *)c->axis[a], D8);
        along += way[a] * axis[a];
    }
    for (int a = 0; a < 3; a++) {
        const int b = a < 2 ? a + 1 : 0;
        const D8 part = way[a] * axis[b] - way[b] * axis[a];
        square += part * part;
    }
    /* n . way of all normals is at least |along| cosine - |across| sine, or at most as much less than 0. */
    const D8 cosine = __builtin_convertvector(*(const Narrow *)c->cosine, D8) - CONE_MARGIN,
             sine = __builtin_convertvector(*(const Narrow *)c->sine, D8) + CONE_MARGIN,
             off = __builtin_convertvector(*(const Narrow *)c->off, D8) + s->near;
    size_of(&along, &along);
    const D8 more = along * cosine - off;
    uint32_t bits = less((D8){0}, more) & less(square * (sine * sine), more * more);
    if (!bits || !(s->beyond < (double)HUGE_VALF)) return bits;
    D8 most = {0};
    for (int a = 0; a < 3; a++) {
        const double by = s->along[a];
        const float *side = by > 0 ? n->hi[a] : n->lo[a];
        most += by * (__builtin_convertvector(*(const Narrow *)side, D8) - s->p[a]);
    }
    return bits & less(most, all_D8(s->beyond));
}

INLINE void cross_D8(const D8 a[3], const D8 b[3], D8 out[3]) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* The same operations as light_facing. */
static BeamFacings beam_facings(const Bvh *b, int32_t leaf, const BeamSight *s) {
    D8 at[3][3], way[2][3], normal[3], det, square;
    for (int c = 0; c < 3; c++)
        for (int a = 0; a < 3; a++) {
            if (b->f64) at[c][a] = *(const Wide *)((const BvhLeaf64 *)b->leaf)[leaf].at[c][a];
            else at[c][a] = __builtin_convertvector(*(const Narrow *)((const BvhLeaf32 *)b->leaf)[leaf].at[c][a], D8);
            at[c][a] -= s->p[a];
        }
    for (int k = 0; k < 2; k++)
        for (int a = 0; a < 3; a++) way[k][a] = at[k + 1][a] - at[0][a];
    cross_D8(way[0], way[1], normal);
    det = at[0][0] * normal[0] + at[0][1] * normal[1] + at[0][2] * normal[2];
    square = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2];
    const uint32_t hides = less(s->near * s->near * square, det * det) & bits_D8(det - det == (D8){0});
    const uint32_t away = hides & ~less(det, (D8){0});
    if (!(s->beyond < (double)HUGE_VALF)) return (BeamFacings){.low = away, .high = hides};
    D8 least;
    for (int c = 0; c < 3; c++) {
        const D8 h = s->along[0] * at[c][0] + s->along[1] * at[c][1] + s->along[2] * at[c][2];
        least = c ? lower(h, least) : h;
    }
    const uint32_t before = less(least, all_D8(s->beyond));
    return (BeamFacings){.low = (hides & ~before) | (away & before), .high = hides & before};
}
