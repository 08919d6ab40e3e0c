/* How many faces hide beside segments, from those beside others that they cross or end with: all that hangs together is
 * known but for one number, that of its root. */
#include "arrangement.h"

/* ---- what hangs together */

uint32_t arrangement_root(Arrangement *a, uint32_t i) {
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
    const uint32_t p = arrangement_root(a, i), q = arrangement_root(a, k);
    const int32_t of_i = p == i ? 0 : a->more_than[i], of_k = q == k ? 0 : a->more_than[k];
    if (p == q) return of_k == of_i + more;
    a->root[q] = p, a->more_than[q] = of_i + more - of_k;
    return true;
}

/* Around their vertex nothing is between the ways out of `one` and, counter-clockwise, `other`. */
static bool tie_around(Arrangement *a, uint32_t one, uint32_t other) {
    return tie(a, one / 2, other / 2, arrangement_left_out(a, one) - arrangement_right_out(a, other));
}

/* By its angle, or what grows with it: from 0 to 4. */
static double turn_of(const Arrangement *a, uint32_t end) {
    double way[2];
    arrangement_way_out(a, end, way);
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
        if (other == ARRANGED_SEVERAL && !tie_fan(a, end)) return false;
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

/* Is the end before the other on the way along the outline? What comes from one corner of a face, which lies on the
 * horizon, is passed from its left to its right. */
static bool lands_before(const Arrangement *a, const Landing *one, const Landing *other) {
    double p[2], q[2];
    if (one->along != other->along) return one->along < other->along;
    arrangement_way_out(a, one->end, p), arrangement_way_out(a, other->end, q);
    return p[0] * q[1] - p[1] * q[0] < 0;
}

static bool lands_apart(const Arrangement *a, const Landing *one, const Landing *other, double near) {
    if (other->along - one->along > near) return true;
    const uint32_t p = one->end, q = other->end;
    return a->x[p % 2][p / 2] == a->x[q % 2][q / 2] && a->y[p % 2][p / 2] == a->y[q % 2][q / 2] &&
           !arrangement_too_near(a, p, q);
}

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
        Landing *row = a->landing.data;
        uint32_t to = a->landing.n - 1;
        for (; to > 0 && lands_before(a, &here, &row[to - 1]); to--) row[to] = row[to - 1];
        row[to] = here;
        return (to == 0 || lands_apart(a, &row[to - 1], &here, near)) &&
               (to + 1 == a->landing.n || lands_apart(a, &here, &row[to + 1], near));
    }
    return false;
}

/* Ties what lands on it. */
static bool tie_outline(Arrangement *a, const Polygon *whole) {
    int32_t inside = 0;
    a->landing.n = 0;
    for (uint32_t end = 0; end < 2 * a->n; end++)
        if (a->border[end % 2][end / 2] != CUT_NOT && !land(a, whole, end)) return false;
    for (uint32_t k = 0; k < a->landing.n; k++) {
        const uint32_t end = a->landing.data[k].end;
        if (!tie(a, a->n, end / 2, inside - arrangement_left_out(a, end))) return false;
        inside += arrangement_right_out(a, end) - arrangement_left_out(a, end);
    }
    return inside == 0;
}

bool arrangement_tie(Arrangement *a, const Polygon *whole) {
    for (uint32_t i = 0; i <= a->n; i++) a->root[i] = i;
    return tie_meetings(a) && tie_ends(a) && tie_outline(a, whole);
}
