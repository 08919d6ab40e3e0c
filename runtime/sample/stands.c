/* Jumps that nothing moves. Where `x.y - 0.1 * floor(5.0 * x.x) < a` decides otherwise on the two sides of x.x = 0.2
 * it is not g that has come to 0 there: floor has jumped over it, untagged, and stands where it is whatever the
 * parameters are. Such a crossing has no weight, as one that cannot be integrated, but it is no loss either. It is told
 * by moving the parameters: the region still is another on its two sides, as near to each other as floats are. A jump
 * that moves, even slowly, is left behind by places so near to each other. */
#include <string.h>

#include "runtime/sample/search.h"
#include "runtime/sample/sink.h"

enum { NEARER = 24 }; /* halvings of the bracket, in which f32 has no floats any more */

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

/* n <= FIND. Sets differs[i] where the regions do. */
static void compare(Batch *b, const Crossing *const *c, Pair *p, uint32_t n, bool *differs) {
    for (uint32_t i = 0; i < 2 * n; i++) put_place(b, i, c[i / 2], p[i / 2].x[i % 2]);
    batch_call(b, SLT_K_REGION, 2 * n);
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t side = 0; side < 2; side++) p[i].hash[side] = batch_get_int(b, SLT_OUT_HASH, 0, 2 * i + side);
        differs[i] |= p[i].hash[0] != p[i].hash[1];
    }
}

void stands_find(Sink *k, const Crossing *const *c, uint32_t n, bool *stands) {
    Batch *b = k->b;
    const Apart *apart = k->coincide.apart;
    Pair pair[FIND];
    const SltCullList *lists = b->args.cull;
    /* Rays are dear, and what stops one says no event. */
    bool can = apart && !k->moved && b->s->kernel[SLT_K_REGION] && !search_has_depth(b->s);
    for (uint32_t i = 0; i < n; i++) {
        stands[i] = can;
        memcpy(pair[i].x, c[i]->side, sizeof pair[i].x);
    }
    if (!n || !can) return;
    bool differs[FIND] = {false};
    compare(b, c, pair, n, differs);
    come_nearer(b, c, pair, n);
    b->args.cull = NULL; /* good where nothing has moved */
    for (uint32_t m = 0; m < UNTIE_WAYS; m++) {
        /* A boundary that ends at the jump may take it along one way, back it does not. */
        if (m % 2 == 0) memset(differs, 0, sizeof differs);
        untie_use(b, &apart->move[m].scene);
        compare(b, c, pair, n, differs);
        for (uint32_t i = 0; i < n && m % 2; i++) stands[i] &= differs[i];
    }
    untie_use(b, b->s);
    b->args.cull = lists;
}
