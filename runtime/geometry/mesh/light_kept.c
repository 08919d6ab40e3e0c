/* What is lit of a light past a mesh hangs on receiver and light alone, not on the lobe: a shader that asks for both
 * kinds of light of a place searches once. Kept by lane and light, until the next vector of samples begins. */
#include "light_inner.h"

#include "pieces.h"
#include "saltus/mesh.h"

_Static_assert((int)SLT_LIGHT_ROWS == (int)LIGHT_KEY, "the key is the rows that both queries have");

static Kept *slot(const Light *l, uint32_t lane) {
    uint64_t bits = 0;
    for (int k = SLT_LIGHT_CORNER; k < LIGHT_KEY; k++) {
        uint64_t of;
        memcpy(&of, &l->key[k], sizeof of);
        bits = (bits ^ of) * 0x9e3779b97f4a7c15u;
    }
    return &l->store->kept[lane * (LIGHT_SLOTS / 64) + (bits >> 32) % (LIGHT_SLOTS / 64)];
}

static size_t corners_bytes(uint32_t n) { return n * (2 * sizeof(double) + sizeof(uint32_t)); }

static void put(unsigned char **to, const void *from, size_t bytes) {
    if (bytes) memcpy(*to, from, bytes);
    *to += bytes;
}

static void take(void *to, const unsigned char **from, size_t bytes) {
    if (bytes) memcpy(to, *from, bytes);
    *from += bytes;
}

void light_keep(Light *l, uint32_t lane) {
    const LightStore *s = l->store;
    Kept *kept = slot(l, lane);
    size_t bytes =
        s->segment.n * sizeof *s->segment.data + s->near.n * sizeof *s->near.data + s->arc.n * sizeof *s->arc.data;
    for (uint32_t i = 0; i < s->shown.n; i++) bytes += 3 * sizeof(uint32_t) + corners_bytes(s->shown.data[i].p.n);
    kept->bvh = NULL;
    if (kept->room < bytes) {
        free(kept->data);
        kept->data = malloc(2 * bytes), kept->room = kept->data ? 2 * bytes : 0;
        if (!kept->data) return; /* the other query searches */
    }
    unsigned char *at = kept->data;
    put(&at, s->segment.data, s->segment.n * sizeof *s->segment.data);
    put(&at, s->arc.data, s->arc.n * sizeof *s->arc.data);
    put(&at, s->near.data, s->near.n * sizeof *s->near.data);
    for (uint32_t i = 0; i < s->shown.n; i++) {
        const Shown *shown = &s->shown.data[i];
        const uint32_t n = shown->p.n, head[3] = {n, shown->from, shown->n};
        put(&at, head, sizeof head);
        put(&at, shown->p.u, n * sizeof *shown->p.u);
        put(&at, shown->p.v, n * sizeof *shown->p.v);
        put(&at, shown->p.side, n * sizeof *shown->p.side);
    }
    kept->bvh = l->s->tree.bvh, kept->values = l->s->values, kept->begun = pieces_begun();
    kept->nsegments = s->segment.n, kept->nshown = s->shown.n, kept->nnear = s->near.n, kept->narcs = s->arc.n;
    memcpy(kept->key, l->key, sizeof kept->key);
}

#define ROOM(row, count)                                                                                               \
    for ((row).n = 0; (row).n < (count); (row).n++)                                                                    \
        if (!row_room(&(row).data, (row).n, &(row).room, sizeof *(row).data)) return l->lost = true

bool light_recall(Light *l, uint32_t lane) {
    LightStore *s = l->store;
    const Kept *kept = slot(l, lane);
    if (!kept->bvh || kept->bvh != l->s->tree.bvh || kept->values != l->s->values || kept->begun != pieces_begun() ||
        memcmp(kept->key, l->key, sizeof kept->key) != 0)
        return false;
    ROOM(s->segment, kept->nsegments);
    ROOM(s->near, kept->nnear);
    ROOM(s->shown, kept->nshown);
    ROOM(s->arc, kept->narcs);
    const unsigned char *at = kept->data;
    take(s->segment.data, &at, kept->nsegments * sizeof *s->segment.data);
    take(s->arc.data, &at, kept->narcs * sizeof *s->arc.data);
    take(s->near.data, &at, kept->nnear * sizeof *s->near.data);
    for (uint32_t i = 0; i < kept->nshown; i++) {
        Shown *shown = &s->shown.data[i];
        uint32_t head[3];
        take(head, &at, sizeof head);
        shown->p.n = head[0], shown->from = head[1], shown->n = head[2];
        take(shown->p.u, &at, head[0] * sizeof *shown->p.u);
        take(shown->p.v, &at, head[0] * sizeof *shown->p.v);
        take(shown->p.side, &at, head[0] * sizeof *shown->p.side);
    }
    return true;
}
