/* Following fingers: what is thinner than the lattice is seen by few of its lines, and lost on the others.
 *
 * Where a finger (of shadow, of a near ridge, of light between two) holds a vertex, the line through that vertex finds
 * the finger's two borders, with their directions. These point to where the borders lie on the next line; if they have
 * not met before, and the vertices there know of nothing, the region is evaluated once between the two: a probe. What a
 * probe finds is followed on, to the tip and over gaps. Following asks nothing of the kernels, works for every kind of
 * site, and costs a few evaluations a finger. A finger that holds no vertex at all is not seen.
 *
 * A tile follows fingers on its own lines. Those that leave it are handed to the tiles that they go to, when all tiles
 * are done: such a visit knows no vertices, and evaluates the two ends of an edge with the probe. It does not look
 * again for what the tile has found by itself. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/depth.h"
#include "runtime/sample/follow.h"
#include "runtime/sample/thin.h"
#include "runtime/sample/run.h"

enum {
    WIDEST = 3,  /* vertices of the longest run that counts as a finger */
    NONE = -1,   /* slot of an edge: its crossings are not wanted */
    WANTED = -2, /* they are, but there is none yet */
    HELD = -3,   /* they are not, and the edge has some, though its ends differ in the face alone: no probe there */
    LOOK = 256,  /* probes of a call */
    ALONG = 3    /* edges by which a finger may move from line to line: lines along the other axis see steeper ones */
};

/* The first and the last crossing of one edge. */
typedef struct Border {
    double at[2];    /* positions along the line */
    double slope[2]; /* how far each moves along the line per length that the line moves aside */
    uint32_t n;      /* crossings */
} Border;

typedef struct Finger {
    uint32_t line;
    uint32_t left, right; /* the edges that hold its borders, by first vertex; the same where a probe found it */
    uint8_t axis;
    int8_t from, to; /* the steps to go from its line: -1 and 1, or one of them */
} Finger;

typedef struct Probe {
    uint32_t line, edge;
    uint8_t axis;
    int8_t step; /* of the finger that asks */
    double at;   /* position along the line */
} Probe;

struct Follow {
    const FollowTile *tile;
    FollowExit *out;   /* fingers that leave the tile */
    FollowFound *seen; /* edges in which probes found something */
    uint32_t nout, out_cap, nseen, seen_cap;
    int32_t *slot; /* [2][vertices], by axis and first vertex of the edge: NONE to HELD, or number of its Border */
    uint64_t cap;
    Border *border;
    Finger *finger[2]; /* to be followed in this round, and in the next */
    Probe *probe;
    uint32_t nborder, border_cap, nfinger[2], finger_cap[2], nprobe, probe_cap;
    uint64_t vertices;
    bool failed;
};

Follow *follow_new(void) { return alloc_zero(1, sizeof(Follow)); }

void follow_free(Follow *f) {
    if (!f) return;
    free(f->slot), free(f->border), free(f->finger[0]), free(f->finger[1]), free(f->probe), free(f->out), free(f->seen);
    free(f);
}

static bool room(Follow *f, void **v, uint32_t n, uint32_t *cap, size_t size) {
    if (n < *cap) return true;
    uint32_t more = *cap ? 2 * *cap : 256;
    void *p = realloc(*v, more * size);
    if (!p) {
        f->failed = true;
        return false;
    }
    *v = p, *cap = more;
    return true;
}

bool follow_begin(Follow *f, const FollowTile *t, uint64_t vertices) {
    if (vertices > f->cap) {
        free(f->slot);
        f->slot = malloc(2 * vertices * sizeof *f->slot);
        f->cap = f->slot ? vertices : 0;
        if (!f->slot) return false;
    }
    f->tile = t, f->vertices = vertices;
    f->nborder = f->nfinger[0] = f->nfinger[1] = f->nprobe = f->nout = f->nseen = 0;
    for (uint64_t i = 0; i < 2 * vertices; i++) f->slot[i] = NONE;
    return true;
}

static int32_t *slot_of(Follow *f, uint32_t axis, uint64_t vertex) { return &f->slot[axis * f->vertices + vertex]; }

void follow_note(Follow *f, const Crossing *c) {
    int32_t *slot = slot_of(f, (uint32_t)c->axis, c->edge - 1);
    if (*slot == NONE && f->tile->faces) *slot = HELD;
    if (*slot == NONE || *slot == HELD) return;
    double at = c->x[c->axis], slope = -c->dg[1 - c->axis] / c->dg[c->axis];
    if (*slot == WANTED) {
        if (!room(f, (void **)&f->border, f->nborder, &f->border_cap, sizeof *f->border)) return;
        *slot = (int32_t)f->nborder++;
        f->border[*slot] = (Border){{at, at}, {slope, slope}, 1};
        return;
    }
    Border *b = &f->border[*slot];
    b->n++;
    if (at < b->at[0]) b->at[0] = at, b->slope[0] = slope;
    if (at > b->at[1]) b->at[1] = at, b->slope[1] = slope;
}

static void add_finger(Follow *f, uint32_t which, Finger g) {
    if (room(f, (void **)&f->finger[which], f->nfinger[which], &f->finger_cap[which], sizeof g))
        f->finger[which][f->nfinger[which]++] = g;
}

static bool differ(const FollowTile *t, uint64_t a, uint64_t b, uint32_t axis) {
    return t->hash[a] != t->hash[b] || (t->depth && depth_differs(t->depth[a], t->depth[b], t->threshold[axis]));
}

/* A finger is a run of at most WIDEST vertices of a line that differ from the vertices beside it, which are alike. */
void follow_line(Follow *f, uint32_t axis, uint32_t line, const uint32_t *edge, uint32_t n) {
    const FollowTile *t = f->tile;
    uint64_t first = line * t->stride[1 - axis], stride = t->stride[axis];
    for (uint32_t i = 1; i < n; i++) {
        const uint32_t last = edge[i - 1], e = edge[i];
        if (e - last > WIDEST || differ(t, first + last * stride, first + (e + 1) * stride, axis)) continue;
        *slot_of(f, axis, first + last * stride) = *slot_of(f, axis, first + e * stride) = WANTED;
        add_finger(f, 0, (Finger){line, last, e, (uint8_t)axis, -1, 1});
    }
}

static void add_seen(Follow *f, uint32_t axis, uint64_t edge) {
    if (room(f, (void **)&f->seen, f->nseen, &f->seen_cap, sizeof *f->seen))
        f->seen[f->nseen++] = (FollowFound){(uint32_t)edge, (uint8_t)axis};
}

void follow_found(Follow *f, uint32_t axis, uint32_t edge) {
    const FollowTile *t = f->tile;
    uint32_t row = (uint32_t)t->stride[1], at[2] = {(edge - 1) % row, (edge - 1) / row}, e = at[axis],
             line = at[1 - axis];
    *slot_of(f, axis, edge - 1) = WANTED;
    add_seen(f, axis, edge - 1);
    add_finger(f, 0, (Finger){line, e, e, (uint8_t)axis, -1, 1});
}

/* The crossing of an edge that faces the finger: side 1, the last, of an edge on its left; side 0, the first, on its
 * right. */
static bool border(Follow *f, uint32_t axis, uint64_t edge, int side, double *at, double *slope) {
    int32_t slot = *slot_of(f, axis, edge);
    if (slot < 0) return false;
    *at = f->border[slot].at[side], *slope = f->border[slot].slope[side];
    return true;
}

/* A probe between positions l and r of a line of the tile; e: an edge near by. False where they lie beyond the edges
 * that the tile owns. */
static bool add_probe(Follow *f, uint32_t axis, uint32_t line, uint32_t e, int step, double l, double r) {
    const FollowTile *t = f->tile;
    const double *pos = t->pos[axis];
    double at = 0.5 * (l + r);
    while (e > t->from[axis] && pos[e] > at) e--;
    while (e + 1 < t->to[axis] && pos[e + 1] <= at) e++;
    if (!(pos[e] < at && at < pos[e + 1])) return false;
    at = 0.5 * (fmax(l, pos[e]) + fmin(r, pos[e + 1]));
    uint64_t v = line * t->stride[1 - axis] + e * t->stride[axis];
    if (*slot_of(f, axis, v) != NONE || (t->hash && differ(t, v, v + t->stride[axis], axis))) return true;
    *slot_of(f, axis, v) = WANTED;
    if (room(f, (void **)&f->probe, f->nprobe, &f->probe_cap, sizeof *f->probe))
        f->probe[f->nprobe++] = (Probe){line, e, (uint8_t)axis, (int8_t)step, at};
    return true;
}

/* Where the finger lies on the next line: a probe there, or an exit. */
static void aim(Follow *f, const Finger *g, int step) {
    const FollowTile *t = f->tile;
    uint32_t axis = g->axis, other = 1 - axis, line = g->line, next = line + (uint32_t)step;
    uint64_t first = line * t->stride[other], stride = t->stride[axis];
    double l, r, sl, sr;
    bool one = g->left == g->right;
    if (!border(f, axis, first + g->left * stride, one ? 0 : 1, &l, &sl) ||
        !border(f, axis, first + g->right * stride, one ? 1 : 0, &r, &sr))
        return;
    double by = step * t->spacing[other], most = ALONG * t->spacing[axis];
    if (!(fabs(sl * by) < most) || !(fabs(sr * by) < most)) return;
    l += sl * by, r += sr * by;
    if (!(l < r)) return; /* they have met */
    if (next >= t->line_from[other] && next < t->line_to[other] && add_probe(f, axis, next, g->left, step, l, r))
        return;
    uint32_t to = t->first[other] + next; /* number in the lattice */
    if (to < 1 || to > t->lines[other]) return;
    if (room(f, (void **)&f->out, f->nout, &f->out_cap, sizeof *f->out))
        f->out[f->nout++] = (FollowExit){to, (uint8_t)axis, (int8_t)step, l, r};
}

static void put(Batch *b, uint32_t lane, uint32_t axis, double at, double line) {
    double x[3] = {0};
    x[axis] = at, x[1 - axis] = line;
    batch_set_x(b, lane, x);
    batch_set_stream(b, lane, 0, 0);
}

/* Is m, between a and e, which differ in the face at most, something else than both? */
static bool stands_out(Mark m, Mark a, Mark e, double threshold) {
    return m.hash != a.hash || depth_differs(m.depth, a.depth, threshold) || (m.face != a.face && m.face != e.face);
}

/* Evaluates the region at n probes, and on a visit at the ends of their edges. */
static void look(Follow *f, Worker *w, const Probe *probe, uint32_t n) {
    const FollowTile *t = f->tile;
    Batch *b = &w->batch;
    Mark mark[LOOK][3];
    uint32_t each = t->hash ? 1 : 3;
    for (uint32_t i = 0; i < n; i++) {
        const Probe *p = &probe[i];
        double line = t->pos[1 - p->axis][p->line];
        put(b, each * i, p->axis, p->at, line);
        for (uint32_t end = 0; end + 1 < each; end++)
            put(b, each * i + 1 + end, p->axis, t->pos[p->axis][p->edge + end], line);
    }
    batch_call(b, SLT_K_REGION, each * n);
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t k = 0; k < each; k++) mark[i][k] = batch_mark(b, each * i + k);
    for (uint32_t i = 0; i < n; i++) {
        const Probe *p = &probe[i];
        uint32_t axis = p->axis, line = p->line, other = 1 - axis;
        uint64_t v = line * t->stride[other] + p->edge * t->stride[axis], v1 = v + t->stride[axis];
        Mark m = mark[i][0], a = t->hash ? worker_mark(w, v) : mark[i][1],
             e = t->hash ? worker_mark(w, v1) : mark[i][2];
        double threshold = t->threshold[axis];
        if (!t->hash && (a.hash != e.hash || a.face != e.face || depth_differs(a.depth, e.depth, threshold)))
            continue; /* the tile has searched this edge by itself */
        if (!stands_out(m, a, e, threshold)) continue;
        Segment s = {.base = t->base[axis],
                     .axis = (int8_t)axis,
                     .cls = t->classes > 1 ? (uint8_t)((line + t->first[other]) & 3) : 0,
                     .edge = (uint32_t)v + 1,
                     .thin = THIN_FOUND};
        s.a[other] = s.b[other] = t->pos[other][line];
        s.a[axis] = t->pos[axis][p->edge], s.b[axis] = p->at;
        finder_add(&w->finder, &s, a, m, threshold);
        s.a[axis] = p->at, s.b[axis] = t->pos[axis][p->edge + 1];
        finder_add(&w->finder, &s, m, e, threshold);
        add_seen(f, axis, v);
        add_finger(f, 1, (Finger){line, p->edge, p->edge, p->axis, p->step, p->step});
    }
}

void follow_enter(Follow *f, const FollowExit *in) {
    const FollowTile *t = f->tile;
    uint32_t line = in->line - t->first[1 - in->axis];
    add_probe(f, in->axis, line, t->from[in->axis], in->step, in->l, in->r);
}

void follow_known(Follow *f, const FollowFound *known) { *slot_of(f, known->axis, known->edge) = WANTED; }

const FollowExit *follow_exits(const Follow *f, uint32_t *n) {
    *n = f->nout;
    return f->out;
}

const FollowFound *follow_seen(const Follow *f, uint32_t *n) {
    *n = f->nseen;
    return f->seen;
}

bool follow_run(Worker *w) {
    Follow *f = w->follow;
    while ((f->nfinger[0] || f->nprobe) && !f->failed) {
        f->nfinger[1] = 0;
        for (uint32_t i = 0; i < f->nfinger[0]; i++) {
            const Finger *g = &f->finger[0][i];
            for (int step = g->from; step <= g->to; step += 2) aim(f, g, step);
        }
        for (uint32_t i = 0; i < f->nprobe; i += LOOK)
            look(f, w, f->probe + i, f->nprobe - i < LOOK ? f->nprobe - i : LOOK);
        f->nprobe = 0;
        if (f->nfinger[1]) finder_run(&w->finder, true);
        Finger *now = f->finger[0];
        uint32_t cap = f->finger_cap[0];
        f->finger[0] = f->finger[1], f->nfinger[0] = f->nfinger[1], f->finger_cap[0] = f->finger_cap[1];
        f->finger[1] = now, f->finger_cap[1] = cap;
    }
    return !f->failed;
}
