/* The border of what is lit, from how the silhouettes cross: no piece is cut.
 *
 * How many faces hide a place of the light changes along a silhouette's line alone, by as many as `more` of its segment
 * says (Appel 1967: quantitative invisibility). So along each segment the number left of it is known but for what it
 * begins with, and wherever two segments cross, end at one vertex, or one ends at the light's border, what they begin
 * with hangs together. What hangs together is one part of the arrangement; in it the fewest faces hide somewhere, and
 * one ray to such a place says whether they are none. If they are, all such places are lit, and the stretches of
 * segments and borders beside them are the border of what is lit.
 *
 * Ends that are one vertex have the same bits, so the arrangement is that of segments as they were rounded: it is
 * consistent as long as it is told on which side of a line an end is, which is checked with a margin that rounding does
 * not reach. Where an end is nearer to a line (edges on edges, vertices on the light's border, sheets seen edge-on),
 * and where numbers do not agree on two ways, nothing is said, and pieces are cut (light_pieces.c). */
#include "arrangement.h"

void light_arrangement_free(Arrangement *a) {
    if (!a) return;
    free(a->touch.data), free(a->meeting.data), free(a->step.data), free(a->landing.data), free(a->stretch.data);
    free(a);
}

/* ---- segments */

/* As far as it is above the horizon; false: it is not. A receiver on a face has the face's corners on its horizon,
 * where they stay, as ends of segments that come from there. */
static bool above(Arrangement *a, uint32_t i, const double horizon[3]) {
    double d[2];
    for (int e = 0; e < 2; e++) d[e] = light_at(horizon, a->x[e][i], a->y[e][i]);
    if (d[0] <= CROSS_NEAR && d[1] <= CROSS_NEAR) return false;
    for (int e = 0; e < 2; e++) {
        if (d[e] > CROSS_NEAR) continue;
        a->border[e][i] = LINE_HORIZON;
        if (d[e] >= -CROSS_NEAR) continue;
        a->end[e][i] = -1.0 - (2 * i + (uint32_t)e);
        const double at = d[e] / (d[e] - d[!e]);
        a->x[e][i] += at * (a->x[!e][i] - a->x[e][i]), a->y[e][i] += at * (a->y[!e][i] - a->y[e][i]);
    }
    return true;
}

/* Is the end within the light's borders, by more than rounding? */
static bool is_within(const Arrangement *a, uint32_t i, int e) {
    const double x = a->x[e][i], y = a->y[e][i], near = CROSS_NEAR;
    return x > near && x < 1 - near && y > near && y < 1 - near;
}

/* Number n of the arrangement, if it is above the horizon. False: it cannot be told how it lies. */
static bool take(const Light *l, Arrangement *a, uint32_t line, const double *horizon) {
    const Segment *s = &l->store->segment.data[line];
    const uint32_t i = a->n;
    for (uint32_t e = 0; e < 2; e++) {
        a->x[e][i] = s->end[e][0], a->y[e][i] = s->end[e][1], a->border[e][i] = s->cut[e];
        a->end[e][i] = s->cut[e] == CUT_NOT ? (e ? s->b : s->a) : -1.0 - (2 * i + e);
    }
    if (horizon && !above(a, i, horizon)) return true;
    for (int e = 0; e < 2; e++) {
        if (a->border[e][i] == CUT_DEEP) return false;
        if (a->border[e][i] == CUT_NOT && !is_within(a, i, e)) return false;
        a->next[e][i] = ARRANGED_ALONE;
    }
    const double dx = a->x[1][i] - a->x[0][i], dy = a->y[1][i] - a->y[0][i];
    a->blur[i] = CROSS_NEAR * sqrt(dx * dx + dy * dy);
    a->line[i] = line, a->more[i] = s->more;
    a->n++;
    return true;
}

/* Of segments of one edge the first tells how many more hide left of it, the others 0. */
static void join_many(Segment *segment, uint32_t n) {
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t k = i + 1; segment[i].many && k < n; k++) {
            if (segment[k].a != segment[i].a || segment[k].b != segment[i].b) continue;
            segment[i].more += segment[k].more, segment[k].more = 0;
        }
}

enum { STRIPS = 64 }; /* across u */

static uint32_t strip_of(const double from, double strips, double u) {
    const double at = (u - from) * strips;
    return !(at > 0) ? 0 : at < STRIPS - 1 ? (uint32_t)at : STRIPS - 1;
}

/* Segments by the strip that they begin in. */
static bool collect(const Light *l, Arrangement *a, const Polygon *whole) {
    const LightStore *store = l->store;
    uint32_t first[STRIPS + 1] = {0}, n = store->segment.n - l->nborder;
    double low = 1, high = 0;
    bool rises = false;
    for (uint32_t k = 0; k < whole->n; k++) rises |= whole->side[k] == LINE_HORIZON;
    a->n = 0;
    if (n > ARRANGED_MOST) return false;
    Segment *segment = store->segment.data + l->nborder;
    join_many(segment, n);
    for (uint32_t i = 0; i < n; i++) {
        if (segment[i].kind != SEGMENT_EDGE) return false;
        const double u = light_min(segment[i].end[0][0], segment[i].end[1][0]);
        low = light_min(low, u), high = light_max(high, u);
    }
    const double strips = high > low ? STRIPS / (high - low) : 0;
    for (uint32_t i = 0; i < n; i++)
        first[strip_of(low, strips, light_min(segment[i].end[0][0], segment[i].end[1][0]))]++;
    for (uint32_t k = 0, sum = 0; k <= STRIPS; k++) {
        const uint32_t count = first[k];
        first[k] = sum, sum += count;
    }
    uint32_t *order = a->root; /* free until segments are joined */
    for (uint32_t i = 0; i < n; i++)
        order[first[strip_of(low, strips, light_min(segment[i].end[0][0], segment[i].end[1][0]))]++] = i;
    /* first[k] is now where strip k ends. */
    uint32_t before = 0, end[STRIPS];
    for (uint32_t k = 0; k < STRIPS; k++) {
        for (; before < first[k]; before++) {
            const Segment *s = &segment[order[before]];
            if (s->more && !take(l, a, l->nborder + order[before], rises ? l->clip[0] : NULL)) return false;
        }
        end[k] = a->n;
    }
    for (uint32_t i = 0; i < a->n; i++)
        a->upto[i] = end[strip_of(low, strips, light_max(a->x[0][i], a->x[1][i]) + CROSS_NEAR)];
    return true;
}

/* Loose triangles that lie one behind the other are faster subtracted than all their crossings are found. Of segments
 * anywhere one crosses as many as their length all together is times its own; the bound is measured. */
static bool is_dense(const Arrangement *a) {
    double length = 0;
    for (uint32_t i = 0; i < a->n; i++) length += a->blur[i] / CROSS_NEAR;
    return length * length > 30.0 * a->n;
}

/* ---- where they meet */

static bool note_touch(Arrangement *a, uint32_t i, uint32_t k) {
    uint32_t shared = 0;
    for (uint32_t e = 0; e < 4; e++) {
        const uint32_t one = 2 * i + e / 2, other = 2 * k + e % 2;
        if (a->end[e / 2][i] != a->end[e % 2][k]) continue;
        if (shared++ || arrangement_too_near(a, one, other)) return false;
        if (a->border[e / 2][i] != CUT_NOT) continue; /* a corner on the horizon */
        if (!ROW_ADD(a->touch, one) || !ROW_ADD(a->touch, other)) return false;
        int32_t *of[2] = {&a->next[e / 2][i], &a->next[e % 2][k]};
        for (int s = 0; s < 2; s++) *of[s] = *of[s] == ARRANGED_ALONE ? (int32_t)(s ? one : other) : ARRANGED_SEVERAL;
    }
    return true;
}

static bool note_meeting(Arrangement *a, uint32_t i, const CrossFound *f) {
    const Meeting m = {
        .segment = {i, f->other},
        .along = {f->at, f->other_at},
        .place = {a->x[0][i] + f->at * (a->x[1][i] - a->x[0][i]), a->y[0][i] + f->at * (a->y[1][i] - a->y[0][i])},
        .up = f->up};
    return ROW_ADD(a->meeting, m);
}

static bool meet(const Light *l, Arrangement *a) {
    const CrossRows rows = {
        .x = {a->x[0], a->x[1]}, .y = {a->y[0], a->y[1]}, .end = {a->end[0], a->end[1]}, .blur = a->blur};
    a->touch.n = a->meeting.n = 0;
    for (uint32_t i = 0; i < a->n; i++) {
        uint32_t n = 0;
        if (i + 1 < a->upto[i] && !l->s->cross->row(&rows, i, i + 1, a->upto[i], a->found, &n)) return false;
        for (uint32_t k = 0; k < n; k++)
            if (!(a->found[k].shares ? note_touch(a, i, a->found[k].other) : note_meeting(a, i, &a->found[k])))
                return false;
    }
    /* An end at which nothing goes on. */
    for (uint32_t i = 0; i < a->n; i++)
        for (int e = 0; e < 2; e++)
            if (a->next[e][i] == ARRANGED_ALONE && a->border[e][i] == CUT_NOT) return false;
    return true;
}

/* Along each segment: its steps in their order, and how many hide. */
static bool follow(Arrangement *a) {
    a->step.n = 0;
    for (uint32_t i = 0; i <= a->n; i++) a->first[i] = 0;
    for (uint32_t m = 0; m < a->meeting.n; m++)
        for (int s = 0; s < 2; s++) a->first[a->meeting.data[m].segment[s]]++;
    uint32_t sum = 0;
    for (uint32_t i = 0; i <= a->n; i++) {
        const uint32_t count = a->first[i];
        a->first[i] = sum, sum += count;
    }
    while (a->step.n < sum)
        if (!ROW_ADD(a->step, ((Step){.along = 0}))) return false;
    uint32_t *filled = a->root; /* likewise */
    for (uint32_t i = 0; i < a->n; i++) filled[i] = a->first[i];
    for (uint32_t m = 0; m < a->meeting.n; m++)
        for (uint32_t s = 0; s < 2; s++) {
            const Meeting *of = &a->meeting.data[m];
            const uint32_t i = of->segment[s];
            uint32_t to = filled[i]++;
            for (; to > a->first[i] && a->step.data[to - 1].along > of->along[s]; to--)
                a->step.data[to] = a->step.data[to - 1];
            a->step.data[to] = (Step){.along = of->along[s], .meeting = m, .which = s};
        }
    for (uint32_t i = 0; i < a->n; i++) {
        int32_t left = 0;
        for (uint32_t k = a->first[i]; k < a->first[i + 1]; k++) {
            Meeting *m = &a->meeting.data[a->step.data[k].meeting];
            const int which = (int)a->step.data[k].which;
            m->left[which] = left, left += arrangement_change(a, m, which);
        }
        a->change[i] = left;
    }
    return true;
}

bool light_arrange(Light *l) {
    LightStore *store = l->store;
    const Window window = {{0, 0}, {1, 1}};
    Polygon whole;
    store->arc.n = 0;
    if (!store->arrangement) store->arrangement = calloc(1, sizeof *store->arrangement);
    Arrangement *a = store->arrangement;
    if (!a) return false;
    light_above(l, &window, &whole);
    if (whole.n < 3) return true;
    if (!collect(l, a, &whole) || (light_wants_triangles(l) && is_dense(a))) return false;
    return meet(l, a) && follow(a) && arrangement_tie(a, &whole) && arrangement_border(l, a, &whole);
}
