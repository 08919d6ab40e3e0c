/* Jumps that nothing moves. Where `x.y - 0.1 * floor(5.0 * x.x) < a` decides otherwise on the two sides of x.x = 0.2
 * it is not g that has come to 0 there: floor has jumped over it, untagged, and stands where it is whatever the
 * parameters are. Such a crossing has no weight, as one that cannot be integrated, but it is no loss either. It is told
 * by moving the parameters: the region still is another on its two sides, as near to each other as floats are. A jump
 * that moves, even slowly, is left behind by places so near to each other. */
#include <math.h>
#include <string.h>

#include "runtime/sample/search.h"
#include "runtime/sample/sink.h"

enum { NEARER = 24 }; /* halvings of the bracket, in which f32 has no floats any more */
#define NEAR 0x1p-4 /* of a move: so near to each other are the two sides, at least */
#define FAR 0x1p-7 /* by so much parameters of size 1 are moved where less makes no difference to g */

typedef struct Pair {
    double x[2][3];
    int32_t hash[2];
} Pair;

static void put_place(Batch *b, uint32_t lane, const Crossing *c, const double x[3]) {
    batch_set_x(b, lane, x);
    batch_set_stream(b, lane, c->stream, c->rand0);
}

/* Bisects on the region. */
static void come_nearer(Batch *b, const Crossing *const *c, Pair *p, uint32_t n) {
    for (uint32_t step = 0; step < NEARER; step++) {
        double x[FIND][3];
        for (uint32_t i = 0; i < n; i++) {
            for (uint32_t d = 0; d < 3; d++) x[i][d] = 0.5 * (p[i].x[0][d] + p[i].x[1][d]);
            put_place(b, i, c[i], x[i]);
        }
        batch_call(b, SLT_K_REGION, n);
        for (uint32_t i = 0; i < n; i++) {
            int side = batch_get_int(b, SLT_OUT_HASH, 0, i) != p[i].hash[0];
            memcpy(p[i].x[side], x[i], sizeof x[i]);
            if (side) p[i].hash[1] = batch_get_int(b, SLT_OUT_HASH, 0, i);
        }
    }
}

static double rounded(const SltScene *s, double x) { return s->f64 ? x : (double)(float)x; }

/* Far from the origin neighbouring floats are farther from each other than anything moves. */
static bool is_near(const SltScene *s, const Pair *p, double step) {
    bool near = true;
    for (uint32_t d = 0; d < s->dim; d++)
        near &= fabs(rounded(s, p->x[1][d]) - rounded(s, p->x[0][d])) <= NEAR * step * (s->hi[d] - s->lo[d]);
    return near;
}

/* n <= FIND. Sets differs[i] where the regions do. */
static void compare(Batch *b, const Crossing *const *c, Pair *p, uint32_t n, bool *differs) {
    for (uint32_t i = 0; i < 2 * n; i++) put_place(b, i, c[i / 2], p[i / 2].x[i % 2]);
    batch_call(b, SLT_K_REGION, 2 * n);
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t side = 0; side < 2; side++) p[i].hash[side] = batch_get_int(b, SLT_OUT_HASH, 0, 2 * i + side);
        differs[i] |= p[i].hash[0] != p[i].hash[1];
    }
}

/* After moves, does the region differ as before? A boundary that ends at the jump may take it along one way, back it
 * does not. */
static void ask_moved(Batch *b, const Apart *apart, const Crossing *const *c, Pair *p, uint32_t n, bool *stands) {
    bool differs[FIND];
    for (uint32_t m = 0; m < UNTIE_WAYS; m++) {
        if (m % 2 == 0) memset(differs, 0, sizeof differs);
        untie_use(b, &apart->move[m].scene);
        compare(b, c, p, n, differs);
        for (uint32_t i = 0; i < n && m % 2; i++) stands[i] &= differs[i];
    }
    untie_use(b, b->s);
}

/* Does g change at all after a move? */
static void find_deaf(Batch *b, const Apart *apart, const Crossing *const *c, const Pair *p, uint32_t n, bool *deaf) {
    double here[2 * FIND];
    for (uint32_t m = 0; m <= UNTIE_WAYS; m++) {
        if (m) untie_use(b, &apart->move[m - 1].scene);
        for (uint32_t i = 0; i < 2 * n; i++)
            put_place(b, i, c[i / 2], p[i / 2].x[i % 2]), batch_set_event(b, i, &c[i / 2]->event);
        batch_call(b, SLT_K_SITE, 2 * n);
        for (uint32_t i = 0; i < 2 * n; i++)
            if (!m) here[i] = batch_get(b, SLT_OUT_G, 0, i);
            else deaf[i / 2] &= batch_get(b, SLT_OUT_G, 0, i) == here[i];
    }
    untie_use(b, b->s);
}

void stands_find(Sink *k, const Crossing *const *c, uint32_t n, bool *stands) {
    Batch *b = k->b;
    const Apart *apart = k->coincide.apart;
    Pair pair[FIND];
    const SltCullList *lists = b->args.cull;
    bool deaf[FIND], far[FIND], still_deaf[FIND], any = false, differs[FIND] = {false};
    /* Rays are dear, and what stops one says no event. */
    bool can = apart && !k->moved && b->s->kernel[SLT_K_REGION] && !search_has_depth(b->s);
    for (uint32_t i = 0; i < n; i++) {
        stands[i] = deaf[i] = far[i] = still_deaf[i] = can;
        memcpy(pair[i].x, c[i]->side, sizeof pair[i].x);
    }
    if (!n || !can) return;
    compare(b, c, pair, n, differs);
    come_nearer(b, c, pair, n);
    for (uint32_t i = 0; i < n; i++) stands[i] &= is_near(b->s, &pair[i], apart->step);
    b->args.cull = NULL; /* good where nothing has moved */
    ask_moved(b, apart, c, pair, n, stands);
    for (uint32_t i = 0; i < n; i++) any |= stands[i];
    if (any) find_deaf(b, apart, c, pair, n, deaf);
    any = false;
    for (uint32_t i = 0; i < n; i++) any |= stands[i] && deaf[i];
    /* Rounding makes steps of g, too, which stand until the parameters have gone as far as one is wide. */
    if (any && !k->far && !apart_new(b->s, apart->seed, FAR, &k->far)) k->failed = true;
    if (any && k->far) ask_moved(b, k->far, c, pair, n, far), find_deaf(b, k->far, c, pair, n, still_deaf);
    for (uint32_t i = 0; i < n; i++) stands[i] &= !deaf[i] || (k->far && far[i] && !still_deaf[i]);
    b->args.cull = lists;
}
