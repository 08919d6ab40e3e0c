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
#include "light_inner.h"

#include <limits.h>
#include <math.h>

enum {
    MOST = 2048,           /* segments; more are cut window by window */
    NOWHERE = INT_MAX / 2, /* so many hide what is outside of the light */
    STRIPS = 64,           /* of the light, across u */
    ALONE = -1,            /* of a segment's end: at the light's border, no other */
    SEVERAL = -2           /* more than one other */
};

/* Segments i and k cross. */
typedef struct Meeting {
    uint32_t segment[2];
    double along[2], place[2];
    bool up;         /* k goes from the right of i to its left */
    int32_t left[2]; /* how many hide, left of i before it, of k before it: more than where these begin */
} Meeting;

/* What a segment comes to. */
typedef struct Step {
    double along;
    uint32_t meeting, which;
} Step;

/* Segment `end / 2` is cut at a border, `along` the outline of the light, a side as 1. */
typedef struct Landing {
    double along;
    uint32_t end;
} Landing;

/* A part of a segment, or of the outline, without a crossing in it. left, right: how many hide there, more than where
 * its part of the arrangement begins. */
typedef struct Stretch {
    double from[2], to[2];
    uint32_t part, line;
    int32_t left, right;
} Stretch;

/* The part of the arrangement whose root this segment is. */
typedef struct Part {
    int32_t fewest;
    double length; /* of the longest stretch beside which they are, squared */
    uint32_t stretch;
    bool lit;
} Part;

typedef struct Arrangement {
    uint32_t n; /* segments; number n is the outline */
    double x[2][MOST + CROSS_ROOM], y[2][MOST + CROSS_ROOM], end[2][MOST + CROSS_ROOM], blur[MOST + CROSS_ROOM];
    uint32_t line[MOST];
    uint32_t upto[MOST];              /* the segments before this one begin to the left of where it ends */
    int32_t more[MOST], change[MOST]; /* change: from what hides left of its begin to left of its end */
    int8_t border[2][MOST];           /* line of the border that the end was cut at, or CUT_NOT */
    int32_t next[2][MOST];            /* the end, 2 * segment + which, that is the same vertex */
    uint32_t first[MOST + 1];         /* of its steps */
    uint32_t root[MOST + 1];
    int32_t more_than[MOST + 1]; /* hide left of its begin than left of that of the root */
    Part part[MOST + 1];
    CrossFound found[MOST];
    ROW(uint32_t) touch; /* pairs of ends */
    ROW(Meeting) meeting;
    ROW(Step) step;
    ROW(Landing) landing;
    ROW(Stretch) stretch;
} Arrangement;

void light_arrangement_free(Arrangement *a) {
    if (!a) return;
    free(a->touch.data), free(a->meeting.data), free(a->step.data), free(a->landing.data), free(a->stretch.data);
    free(a);
}

/* ---- segments */

/* As far as it is above the line; false: it is not. */
static bool above(Arrangement *a, uint32_t i, const double g[3]) {
    double d[2];
    for (int e = 0; e < 2; e++) d[e] = light_at(g, a->x[e][i], a->y[e][i]);
    if (d[0] <= 0 && d[1] <= 0) return false;
    for (int e = 0; e < 2; e++) {
        if (d[e] > 0) continue;
        const double at = d[e] / (d[e] - d[!e]);
        a->x[e][i] += at * (a->x[!e][i] - a->x[e][i]), a->y[e][i] += at * (a->y[!e][i] - a->y[e][i]);
        a->border[e][i] = LINE_HORIZON;
    }
    return true;
}

/* Is the end within the light, by more than rounding? */
static bool is_within(const Arrangement *a, uint32_t i, int e, const double *horizon) {
    const double x = a->x[e][i], y = a->y[e][i], near = CROSS_NEAR;
    return x > near && x < 1 - near && y > near && y < 1 - near && (!horizon || light_at(horizon, x, y) > near);
}

/* Number n of the arrangement, if it is above the horizon. False: it cannot be told how it lies. */
static bool take(const Light *l, Arrangement *a, uint32_t line, const double *horizon) {
    const Segment *s = &l->store->segment.data[line];
    const uint32_t i = a->n;
    for (int e = 0; e < 2; e++) a->x[e][i] = s->end[e][0], a->y[e][i] = s->end[e][1], a->border[e][i] = s->cut[e];
    if (horizon && !above(a, i, horizon)) return true;
    for (int e = 0; e < 2; e++) {
        if (a->border[e][i] == CUT_DEEP) return false;
        if (a->border[e][i] == CUT_NOT && !is_within(a, i, e, horizon)) return false;
        a->end[e][i] = a->border[e][i] == CUT_NOT ? (e ? s->b : s->a) : -1.0 - (2 * i + (uint32_t)e);
        a->next[e][i] = ALONE;
    }
    const double dx = a->x[1][i] - a->x[0][i], dy = a->y[1][i] - a->y[0][i];
    a->blur[i] = CROSS_NEAR * sqrt(dx * dx + dy * dy);
    a->line[i] = line, a->more[i] = s->more;
    a->n++;
    return true;
}

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
    if (n > MOST) return false;
    const Segment *segment = store->segment.data + l->nborder;
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
    uint32_t *order = a->root; /* for now */
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

/* ---- where they meet */

/* The way out of a segment's end. */
static void way_out(const Arrangement *a, uint32_t end, double way[2]) {
    const uint32_t i = end / 2, e = end % 2;
    way[0] = a->x[!e][i] - a->x[e][i], way[1] = a->y[!e][i] - a->y[e][i];
}

/* Do they leave their vertex so nearly in one direction that rounding hides which is left of which? */
static bool too_near(const Arrangement *a, uint32_t one, uint32_t other) {
    double p[2], q[2];
    way_out(a, one, p), way_out(a, other, q);
    return p[0] * q[0] + p[1] * q[1] > 0 &&
           fabs(p[0] * q[1] - p[1] * q[0]) <= light_max(a->blur[one / 2], a->blur[other / 2]);
}

static bool note_touch(Arrangement *a, uint32_t i, uint32_t k) {
    uint32_t shared = 0;
    for (uint32_t e = 0; e < 4; e++) {
        const uint32_t one = 2 * i + e / 2, other = 2 * k + e % 2;
        if (a->end[e / 2][i] != a->end[e % 2][k]) continue;
        if (shared++ || too_near(a, one, other) || !ROW_ADD(a->touch, one) || !ROW_ADD(a->touch, other)) return false;
        int32_t *of[2] = {&a->next[e / 2][i], &a->next[e % 2][k]};
        for (int s = 0; s < 2; s++) *of[s] = *of[s] == ALONE ? (int32_t)(s ? one : other) : SEVERAL;
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
            if (a->next[e][i] == ALONE && a->border[e][i] == CUT_NOT) return false;
    return true;
}

/* How the number left of segment s changes where it crosses the other. */
static int32_t change_at(const Arrangement *a, const Meeting *m, int which) {
    const int32_t more = a->more[m->segment[!which]];
    return m->up == !which ? -more : more;
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
    uint32_t *filled = a->root; /* for now */
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
            m->left[which] = left, left += change_at(a, m, which);
        }
        a->change[i] = left;
    }
    return true;
}

/* ---- what hangs together */

static uint32_t root_of(Arrangement *a, uint32_t i) {
    uint32_t root = i;
    int32_t more = 0;
    while (a->root[root] != root) more += a->more_than[root], root = a->root[root];
    while (a->root[i] != root) {
        const uint32_t next = a->root[i];
        const int32_t own = a->more_than[i];
        a->root[i] = root, a->more_than[i] = more;
        more -= own, i = next;
    }
    return root;
}

/* Left of the begin of k `more` hide than of that of i. False: it has been told otherwise. */
static bool tie(Arrangement *a, uint32_t i, uint32_t k, int32_t more) {
    const uint32_t p = root_of(a, i), q = root_of(a, k);
    const int32_t of_i = p == i ? 0 : a->more_than[i], of_k = q == k ? 0 : a->more_than[k];
    if (p == q) return of_k == of_i + more;
    a->root[q] = p, a->more_than[q] = of_i + more - of_k;
    return true;
}

/* Left and right of the way out of a segment's end, more than left of its begin. */
static int32_t left_out(const Arrangement *a, uint32_t end) {
    return end & 1 ? a->change[end / 2] - a->more[end / 2] : 0;
}
static int32_t right_out(const Arrangement *a, uint32_t end) {
    return end & 1 ? a->change[end / 2] : -a->more[end / 2];
}

/* Around their vertex nothing is between the ways out of `one` and, counter-clockwise, `other`. */
static bool tie_around(Arrangement *a, uint32_t one, uint32_t other) {
    return tie(a, one / 2, other / 2, left_out(a, one) - right_out(a, other));
}

/* By its angle, or what grows with it: from 0 to 4. */
static double turn_of(const Arrangement *a, uint32_t end) {
    double way[2];
    way_out(a, end, way);
    const double part = way[1] / (fabs(way[0]) + fabs(way[1]));
    return way[0] < 0 ? 2 - part : way[1] < 0 ? 4 + part : part;
}

/* A vertex at which several end: all that touch this end, in turn. */
static bool tie_fan(Arrangement *a, uint32_t end) {
    enum { FAN = 32 };
    uint32_t fan[FAN] = {end}, n = 1;
    for (uint32_t t = 0; t < a->touch.n; t++) {
        if (a->touch.data[t] != end) continue;
        const uint32_t other = a->touch.data[t ^ 1];
        if (other < end) return true; /* that one has told */
        if (n == FAN) return false;
        uint32_t to = n++;
        for (; to > 0 && turn_of(a, fan[to - 1]) > turn_of(a, other); to--) fan[to] = fan[to - 1];
        fan[to] = other;
    }
    for (uint32_t k = 0; k < n; k++)
        if (!tie_around(a, fan[k], fan[(k + 1) % n])) return false;
    return true;
}

static bool tie_ends(Arrangement *a) {
    for (uint32_t end = 0; end < 2 * a->n; end++) {
        const int32_t other = a->next[end % 2][end / 2];
        if (other == SEVERAL && !tie_fan(a, end)) return false;
        if (other < (int32_t)end) continue;
        if (!tie_around(a, end, (uint32_t)other) || !tie_around(a, (uint32_t)other, end)) return false;
    }
    return true;
}

static bool tie_meetings(Arrangement *a) {
    for (uint32_t k = 0; k < a->meeting.n; k++) {
        const Meeting *m = &a->meeting.data[k];
        const uint32_t i = m->segment[0], other = m->segment[1];
        const int32_t more = m->up ? -a->more[i] : a->more[other];
        if (!tie(a, i, other, m->left[0] + more - m->left[1])) return false;
    }
    return true;
}

/* ---- the outline of the light */

static bool land(Arrangement *a, const Polygon *whole, uint32_t end) {
    const double x = a->x[end % 2][end / 2], y = a->y[end % 2][end / 2];
    const int8_t border = a->border[end % 2][end / 2];
    for (uint32_t k = 0; k < whole->n; k++) {
        if (whole->side[k] != (uint32_t)border) continue;
        const uint32_t next = k + 1 < whole->n ? k + 1 : 0;
        const double dx = whole->u[next] - whole->u[k], dy = whole->v[next] - whole->v[k], square = dx * dx + dy * dy,
                     part = ((x - whole->u[k]) * dx + (y - whole->v[k]) * dy) / square,
                     near = CROSS_NEAR / sqrt(square);
        if (!(part > near) || !(part < 1 - near)) return false;
        const Landing here = {.along = k + part, .end = end};
        if (!ROW_ADD(a->landing, here)) return false;
        uint32_t to = a->landing.n - 1;
        for (; to > 0 && a->landing.data[to - 1].along > here.along; to--)
            a->landing.data[to] = a->landing.data[to - 1];
        a->landing.data[to] = here;
        for (uint32_t i = to ? to - 1 : to; i <= to && i + 1 < a->landing.n; i++)
            if (a->landing.data[i + 1].along - a->landing.data[i].along <= near) return false;
        return true;
    }
    return false;
}

static bool add_stretch(Arrangement *a, uint32_t i, uint32_t line, const double from[2], const double to[2],
                        int32_t left, int32_t right) {
    const uint32_t part = root_of(a, i);
    const int32_t more = part == i ? 0 : a->more_than[i];
    const Stretch s = {.from = {from[0], from[1]},
                       .to = {to[0], to[1]},
                       .part = part,
                       .line = line,
                       .left = left + more,
                       .right = right + more};
    return ROW_ADD(a->stretch, s);
}

/* Ties what lands on it. */
static bool tie_outline(Arrangement *a, const Polygon *whole) {
    int32_t inside = 0;
    a->landing.n = 0;
    for (uint32_t end = 0; end < 2 * a->n; end++)
        if (a->border[end % 2][end / 2] != CUT_NOT && !land(a, whole, end)) return false;
    for (uint32_t k = 0; k < a->landing.n; k++) {
        const uint32_t end = a->landing.data[k].end;
        if (!tie(a, a->n, end / 2, inside - left_out(a, end))) return false;
        inside += right_out(a, end) - left_out(a, end);
    }
    return inside == 0;
}

static bool stretch_outline(Arrangement *a, const Polygon *whole) {
    int32_t inside = 0;
    uint32_t n = 0;
    for (uint32_t k = 0; k < whole->n; k++) {
        const uint32_t next = k + 1 < whole->n ? k + 1 : 0;
        double from[2] = {whole->u[k], whole->v[k]};
        for (; n < a->landing.n && a->landing.data[n].along < k + 1; n++) {
            const uint32_t end = a->landing.data[n].end;
            const double to[2] = {a->x[end % 2][end / 2], a->y[end % 2][end / 2]};
            if (!add_stretch(a, a->n, whole->side[k], from, to, inside, NOWHERE)) return false;
            inside += right_out(a, end) - left_out(a, end);
            memcpy(from, to, sizeof from);
        }
        const double to[2] = {whole->u[next], whole->v[next]};
        if (!add_stretch(a, a->n, whole->side[k], from, to, inside, NOWHERE)) return false;
    }
    return true;
}

static bool stretch_segments(Arrangement *a) {
    for (uint32_t i = 0; i < a->n; i++) {
        double from[2] = {a->x[0][i], a->y[0][i]};
        const double end[2] = {a->x[1][i], a->y[1][i]};
        int32_t left = 0;
        for (uint32_t k = a->first[i]; k < a->first[i + 1]; k++) {
            const Meeting *m = &a->meeting.data[a->step.data[k].meeting];
            if (!add_stretch(a, i, a->line[i], from, m->place, left, left - a->more[i])) return false;
            left += change_at(a, m, (int)a->step.data[k].which);
            memcpy(from, m->place, sizeof from);
        }
        if (!add_stretch(a, i, a->line[i], from, end, left, left - a->more[i])) return false;
    }
    return true;
}

/* ---- what is lit */

static int32_t fewest_at(const Stretch *s) { return s->left < s->right ? s->left : s->right; }

static void find_fewest(Arrangement *a) {
    for (uint32_t i = 0; i <= a->n; i++) a->part[i] = (Part){.fewest = NOWHERE};
    for (uint32_t k = 0; k < a->stretch.n; k++) {
        const Stretch *s = &a->stretch.data[k];
        Part *p = &a->part[s->part];
        const double dx = s->to[0] - s->from[0], dy = s->to[1] - s->from[1], length = dx * dx + dy * dy;
        if (fewest_at(s) > p->fewest || (fewest_at(s) == p->fewest && length <= p->length)) continue;
        p->fewest = fewest_at(s), p->length = length, p->stretch = k;
    }
}

typedef struct Way {
    double from[2], by[2];
} Way;

/* How far from its begin the way meets the line between two places, at most `far`. */
static double free_to(const Way *w, double x0, double y0, double x1, double y1, double far) {
    const double d0 = w->by[0] * (y0 - w->from[1]) - w->by[1] * (x0 - w->from[0]),
                 d1 = w->by[0] * (y1 - w->from[1]) - w->by[1] * (x1 - w->from[0]);
    if ((d0 > 0) == (d1 > 0)) return far;
    const double part = d0 / (d0 - d1), x = x0 + part * (x1 - x0), y = y0 + part * (y1 - y0),
                 at = w->by[0] * (x - w->from[0]) + w->by[1] * (y - w->from[1]);
    return at > 0 && at < far ? at : far;
}

static double distance_to(const double at[2], double x0, double y0, double x1, double y1) {
    const double dx = x1 - x0, dy = y1 - y0, part = ((at[0] - x0) * dx + (at[1] - y0) * dy) / (dx * dx + dy * dy),
                 on = light_max(0, light_min(1, part)), x = x0 + on * dx - at[0], y = y0 + on * dy - at[1];
    return sqrt(x * x + y * y);
}

/* A place beside this part of the stretch, where fewest hide: as far from it as from what is behind. How far it is from
 * all segments. */
static double place_beside(const Arrangement *a, const Polygon *whole, uint32_t number, double part, double place[2]) {
    const Stretch *s = &a->stretch.data[number];
    const double dx = s->to[0] - s->from[0], dy = s->to[1] - s->from[1],
                 length = (s->left < s->right ? 1 : -1) * sqrt(dx * dx + dy * dy);
    const Way w = {{s->from[0] + part * dx, s->from[1] + part * dy}, {-dy / length, dx / length}};
    double far = 2, clear = HUGE_VAL;
    for (uint32_t i = 0; i < a->n; i++)
        if (a->line[i] != s->line) far = free_to(&w, a->x[0][i], a->y[0][i], a->x[1][i], a->y[1][i], far);
    for (uint32_t k = 0; k < whole->n; k++) {
        const uint32_t next = k + 1 < whole->n ? k + 1 : 0;
        if (whole->side[k] != s->line) far = free_to(&w, whole->u[k], whole->v[k], whole->u[next], whole->v[next], far);
    }
    for (int i = 0; i < 2; i++) place[i] = w.from[i] + 0.5 * far * w.by[i];
    for (uint32_t i = 0; i < a->n; i++)
        clear = light_min(clear, distance_to(place, a->x[0][i], a->y[0][i], a->x[1][i], a->y[1][i]));
    return clear;
}

/* How far from where it is said to go a ray may go, on the light. */
static double ray_blur(const Light *l) {
    const double u = sqrt(vec_dot(l->u, l->u)), v = sqrt(vec_dot(l->v, l->v)), c = sqrt(vec_dot(l->c, l->c));
    return (l->f64 ? 0x1p-44 : 0x1p-19) * (c + u + v) / light_min(u, v);
}

/* One that is clear of all segments by more than `blur`, or the clearest: how far it is. */
static double find_place(const Arrangement *a, const Polygon *whole, uint32_t stretch, double blur, double place[2]) {
    static const double part[] = {0.5, 0.29, 0.83, 0.11};
    double most = -1;
    for (int k = 0; k < 4 && most <= blur; k++) {
        double at[2];
        const double clear = place_beside(a, whole, stretch, part[k], at);
        if (clear > most) most = clear, memcpy(place, at, sizeof at);
    }
    return most;
}

/* False: no place is clear of segments. */
static bool ask_parts(Light *l, Arrangement *a, const Polygon *whole) {
    double place[LIGHT_AT_ONCE][2];
    uint32_t who[LIGHT_AT_ONCE], n = 0;
    const double blur = ray_blur(l);
    for (uint32_t i = 0; i <= a->n; i++) {
        if (a->part[i].fewest < NOWHERE) {
            const double clear = find_place(a, whole, a->part[i].stretch, blur, place[n]);
            if (!(clear > CROSS_NEAR)) return false;
            if (clear > blur) who[n++] = i;
            else a->part[i].lit = !light_ask_all(l, place[n]);
        }
        if (n < LIGHT_AT_ONCE && i < a->n) continue;
        bool dark[LIGHT_AT_ONCE];
        light_ask(l, (const double(*)[2])place, n, dark);
        for (uint32_t k = 0; k < n; k++) a->part[who[k]].lit = !dark[k];
        n = 0;
    }
    return true;
}

static void add_arcs(Light *l, const Arrangement *a) {
    for (uint32_t k = 0; k < a->stretch.n; k++) {
        const Stretch *s = &a->stretch.data[k];
        const Part *p = &a->part[s->part];
        if (!p->lit || fewest_at(s) != p->fewest) continue;
        Arc arc = {.line = s->line, .sign = s->left < s->right ? 1 : -1};
        memcpy(arc.from, s->left < s->right ? s->from : s->to, sizeof arc.from);
        memcpy(arc.to, s->left < s->right ? s->to : s->from, sizeof arc.to);
        if (!ROW_ADD(l->store->arc, arc)) l->lost = true;
    }
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
    if (!collect(l, a, &whole) || !meet(l, a) || !follow(a)) return false;
    for (uint32_t i = 0; i <= a->n; i++) a->root[i] = i;
    if (!tie_meetings(a) || !tie_ends(a) || !tie_outline(a, &whole)) return false;
    a->stretch.n = 0;
    if (!stretch_outline(a, &whole) || !stretch_segments(a)) return false;
    find_fewest(a);
    if (!ask_parts(l, a, &whole)) return false;
    add_arcs(l, a);
    return true;
}
