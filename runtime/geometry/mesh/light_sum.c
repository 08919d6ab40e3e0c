/* What a lit piece adds: its vector irradiance (Lambert's sum over its sides), and to each segment that its sides lie
 * on J, the integral of (n . w) w along them. */
#include "light_inner.h"

#include <math.h>

/* The angle in [0, pi] whose sine and cosine are as s >= 0 to c: an eighth of it by its series. Own, so that bits do
 * not depend on the C library. */
static double angle_of(double s, double c) {
    double x = s / (sqrt(s * s + c * c) + fabs(c)), sum = 0;
    for (int k = 0; k < 2; k++) x = x / (1 + sqrt(1 + x * x));
    for (int k = 27; k > 0; k -= 2) sum = 1.0 / k - x * x * sum;
    const double angle = 8 * x * sum;
    return c < 0 ? 3.141592653589793 - angle : angle;
}

/* The angle over its sine; square, c: of the sine, and the cosine, both times the same factor, as is the result. */
static double over_sine(double square, double c) {
    if (c > 0 && square < 0.01 * (c * c)) {
        const double x = square / (c * c);
        double sum = 0;
        for (int k = 17; k > 0; k -= 2) sum = 1.0 / k - x * sum;
        return sum / c;
    }
    const double s = sqrt(square);
    return s > 0 ? angle_of(s, c) / s : 0;
}

static void direction(const Light *l, double u, double v, double q[3]) {
    for (int i = 0; i < 3; i++) q[i] = l->cm[i] + u * l->um[i] + v * l->vm[i];
}

/* to += sign * J of the arc between two places of the window. */
static void add_j(const Light *l, const double from[2], const double to[2], double sign, double j[3]) {
    if (l->lit) {
        lit_add_side(l, from, to, sign, j);
        return;
    }
    double q[2][3], e[2][3], normal[3], n[2], length[2];
    direction(l, from[0], from[1], q[0]);
    direction(l, to[0], to[1], q[1]);
    vec_cross(q[0], q[1], normal);
    const double wide = sqrt(vec_dot(normal, normal));
    for (int k = 0; k < 2; k++) length[k] = sqrt(vec_dot(q[k], q[k]));
    if (!(wide > 0)) return;
    const double s = wide / (length[0] * length[1]), c = vec_dot(q[0], q[1]) / (length[0] * length[1]),
                 angle = angle_of(s, c), cc = 0.5 * (angle + s * c), ss = 0.5 * (angle - s * c), cs = 0.5 * s * s;
    for (int i = 0; i < 3; i++) e[0][i] = q[0][i] / length[0];
    vec_cross(normal, e[0], e[1]);
    for (int i = 0; i < 3; i++) e[1][i] /= wide;
    for (int k = 0; k < 2; k++) n[k] = vec_dot(l->n, e[k]);
    vec_add(j, sign * (n[0] * cc + n[1] * cs), e[0]);
    vec_add(j, sign * (n[0] * cs + n[1] * ss), e[1]);
}

/* A side of a piece: its places, and where they are along a segment's line. */
typedef struct Side {
    double at[2][2], along[2];
} Side;

static void add_between(Light *l, const Side *side, double from, double to, Segment *s, double sign) {
    const double low = light_min(side->along[0], side->along[1]), high = light_max(side->along[0], side->along[1]);
    double at[2][2];
    from = light_max(from, low), to = light_min(to, high);
    if (!(to > from)) return;
    for (int k = 0; k < 2; k++) {
        const double want = k ? to : from, part = (want - side->along[0]) / (side->along[1] - side->along[0]);
        for (int i = 0; i < 2; i++)
            at[k][i] = want == side->along[0]   ? side->at[0][i]
                       : want == side->along[1] ? side->at[1][i]
                                                : side->at[0][i] + part * (side->at[1][i] - side->at[0][i]);
    }
    add_j(l, at[0], at[1], sign, s->j);
}

/* Where along its line a segment that lies on the line of s has its ends, growing `way` goes; false: it does not. */
static bool lies_on(const Segment *s, const Segment *other, double way, double *low, double *high) {
    double end[2];
    for (int i = 0; i < 2; i++) {
        if (!(fabs(light_at(s->g, other->end[i][0], other->end[i][1])) <= LIGHT_CONTINUES)) return false;
        end[i] = way * (s->g[0] * other->end[i][1] - s->g[1] * other->end[i][0]);
    }
    *low = light_min(end[0], end[1]), *high = light_max(end[0], end[1]);
    return true;
}

/* Beyond its end an edge's line belongs to the edge that continues it, if there is one, and to that one's continuation:
 * where a face is subdivided, the cut by an edge runs on along the next, which then cuts nothing. Where none begins, to
 * the next that lies there: what leads to it may be out of the window. By edges and never by the sides of pieces, so
 * that the two sides of a cut always agree. up: towards larger numbers along the line. */
static void add_beyond(Light *l, const Side *side, uint32_t line, bool up, const uint32_t *list, uint32_t n,
                       double sign) {
    const Segment *s = &l->store->segment.data[line];
    const double way = up ? 1 : -1,
                 far = up ? light_max(side->along[0], side->along[1]) : -light_min(side->along[0], side->along[1]);
    double at = up ? s->to : -s->from;
    while (at < far) {
        Segment *next = NULL;
        double first = far, end = far, low, high;
        for (uint32_t k = 0; k < n; k++) {
            Segment *other = &l->store->segment.data[list[k]];
            if (list[k] == line || !lies_on(s, other, way, &low, &high) || !(high > at + LIGHT_ON_LINE)) continue;
            if (!(low < first)) continue;
            next = other, first = low, end = high;
            if (low <= at + LIGHT_CONTINUES) break;
        }
        if (!next) return;
        if (first <= at + LIGHT_CONTINUES) first = at;
        const bool same = s->g[0] * next->g[0] + s->g[1] * next->g[1] > 0;
        if (up) add_between(l, side, first, end, next, same ? sign : -sign);
        else add_between(l, side, -end, -first, next, same ? sign : -sign);
        at = end;
    }
}

static void add_side(Light *l, const double from[2], const double to[2], uint32_t line, const uint32_t *list,
                     uint32_t n) {
    Segment *s = &l->store->segment.data[line];
    if (s->kind == SEGMENT_FIXED || (s->kind == SEGMENT_HORIZON && !l->lobe)) return;
    Side side;
    for (int i = 0; i < 2; i++) {
        side.at[0][i] = from[i], side.at[1][i] = to[i];
        const double *at = i ? to : from;
        side.along[i] = s->g[0] * at[1] - s->g[1] * at[0];
    }
    const double sign = side.along[1] < side.along[0] ? 1 : -1;
    if (s->kind == SEGMENT_BORDER || s->kind == SEGMENT_HORIZON || (s->kind == SEGMENT_PIECE && !s->b)) {
        add_j(l, from, to, sign, s->j);
        return;
    }
    if (s->kind == SEGMENT_PIECE) {
        for (const Segment *last = s + s->b; s <= last; s++) add_between(l, &side, s->from, s->to, s, sign);
        return;
    }
    add_between(l, &side, s->from, s->to, s, sign);
    if (light_max(side.along[0], side.along[1]) > s->to + LIGHT_ON_LINE)
        add_beyond(l, &side, line, true, list, n, sign);
    if (light_min(side.along[0], side.along[1]) < s->from - LIGHT_ON_LINE)
        add_beyond(l, &side, line, false, list, n, sign);
}

/* The way between two places, of the border of what is lit. To the vector irradiance; and J to `j`, unless it is NULL.
 */
static void add_way(Light *l, const double from[2], const double to[2], double sign, double j_sign, double *j) {
    const double du = to[0] - from[0], dv = to[1] - from[1], turn = from[0] * dv - from[1] * du;
    double q[2][3], c[3], e[2][3];
    direction(l, from[0], from[1], q[0]);
    direction(l, to[0], to[1], q[1]);
    for (int i = 0; i < 3; i++) c[i] = turn * l->uv[i] + dv * l->cv[i] + du * l->cu[i];
    const double square = vec_dot(c, c), dot = vec_dot(q[0], q[1]), wide = sqrt(square);
    if (!(wide > 0)) return;
    const double angle = angle_of(wide, dot);
    vec_add(l->flux, sign * 0.5 * angle / wide, c);
    if (!j) return;
    const double length[2] = {sqrt(vec_dot(q[0], q[0])), sqrt(vec_dot(q[1], q[1]))}, both = length[0] * length[1],
                 sine = wide / both, cc = 0.5 * (angle + sine * (dot / both)), ss = angle - cc, cs = 0.5 * sine * sine;
    double n[2];
    for (int i = 0; i < 3; i++) e[0][i] = q[0][i] / length[0];
    vec_cross(c, e[0], e[1]);
    for (int i = 0; i < 3; i++) e[1][i] /= wide;
    for (int k = 0; k < 2; k++) n[k] = vec_dot(l->n, e[k]);
    vec_add(j, j_sign * (n[0] * cc + n[1] * cs), e[0]);
    vec_add(j, j_sign * (n[0] * cs + n[1] * ss), e[1]);
}

/* Where the border goes below the lobe's horizon and where it comes up again, the sides along the horizon between are
 * what is missing: from the first such place to each, added up. */
void light_add_arcs(Light *l) {
    double first[2];
    bool crosses = false;
    for (uint32_t k = 0; k < l->store->arc.n; k++) {
        Arc a = l->store->arc.data[k];
        Segment *s = &l->store->segment.data[a.line];
        if (l->lobe) {
            const double d[2] = {light_at(l->clip[1], a.from[0], a.from[1]), light_at(l->clip[1], a.to[0], a.to[1])};
            if (!(d[0] > 0) && !(d[1] > 0)) continue;
            if (!(d[0] > 0) || !(d[1] > 0)) {
                const double part = d[0] / (d[0] - d[1]), at[2] = {a.from[0] + part * (a.to[0] - a.from[0]),
                                                                   a.from[1] + part * (a.to[1] - a.from[1])};
                if (!crosses) memcpy(first, at, sizeof first);
                else add_way(l, first, at, d[1] > 0 ? 1 : -1, 0, NULL);
                crosses = true;
                memcpy(d[1] > 0 ? a.from : a.to, at, sizeof at);
            }
        }
        add_way(l, a.from, a.to, 1, a.sign, s->kind != SEGMENT_HORIZON || l->lobe ? s->j : NULL);
    }
}

void light_add(Light *l, const Polygon *p, const uint32_t *list, uint32_t n) {
    double q[LIGHT_CORNERS][3];
    if (l->lit) {
        lit_add(l, p);
        for (uint32_t k = 0; k < p->n; k++) {
            const uint32_t next = k + 1 < p->n ? k + 1 : 0;
            add_side(l, (double[2]){p->u[k], p->v[k]}, (double[2]){p->u[next], p->v[next]}, p->side[k], list, n);
        }
        return;
    }
    for (uint32_t k = 0; k < p->n; k++) direction(l, p->u[k], p->v[k], q[k]);
    for (uint32_t k = 0; k < p->n; k++) {
        const uint32_t next = k + 1 < p->n ? k + 1 : 0;
        const double du = p->u[next] - p->u[k], dv = p->v[next] - p->v[k], turn = p->u[k] * dv - p->v[k] * du;
        double c[3];
        for (int i = 0; i < 3; i++) c[i] = turn * l->uv[i] + dv * l->cv[i] + du * l->cu[i];
        vec_add(l->flux, 0.5 * over_sine(vec_dot(c, c), vec_dot(q[k], q[next])), c);
        add_side(l, (double[2]){p->u[k], p->v[k]}, (double[2]){p->u[next], p->v[next]}, p->side[k], list, n);
    }
}
