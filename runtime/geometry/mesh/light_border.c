/* Which parts of an arrangement are lit where fewest faces hide, by a ray each, and the stretches that border that. */
#include "arrangement.h"

/* ---- stretches */

static bool add_stretch(Arrangement *a, uint32_t i, uint32_t line, const double from[2], const double to[2],
                        int32_t left, int32_t right) {
    const uint32_t part = arrangement_root(a, i);
    const int32_t more = part == i ? 0 : a->more_than[i];
    const Stretch s = {.from = {from[0], from[1]},
                       .to = {to[0], to[1]},
                       .part = part,
                       .line = line,
                       .left = left + more,
                       .right = right + more};
    return ROW_ADD(a->stretch, s);
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
            if (!add_stretch(a, a->n, whole->side[k], from, to, inside, ARRANGED_NOWHERE)) return false;
            inside += arrangement_right_out(a, end) - arrangement_left_out(a, end);
            memcpy(from, to, sizeof from);
        }
        const double to[2] = {whole->u[next], whole->v[next]};
        if (!add_stretch(a, a->n, whole->side[k], from, to, inside, ARRANGED_NOWHERE)) return false;
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
            left += arrangement_change(a, m, (int)a->step.data[k].which);
            memcpy(from, m->place, sizeof from);
        }
        if (!add_stretch(a, i, a->line[i], from, end, left, left - a->more[i])) return false;
    }
    return true;
}

/* ---- what is lit */

static int32_t fewest_at(const Stretch *s) { return s->left < s->right ? s->left : s->right; }

static void find_fewest(Arrangement *a) {
    for (uint32_t i = 0; i <= a->n; i++) a->part[i] = (Part){.fewest = ARRANGED_NOWHERE};
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
        if (a->part[i].fewest < ARRANGED_NOWHERE) {
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

bool arrangement_border(Light *l, Arrangement *a, const Polygon *whole) {
    a->stretch.n = 0;
    if (!stretch_outline(a, whole) || !stretch_segments(a)) return false;
    find_fewest(a);
    if (!ask_parts(l, a, whole)) return false;
    add_arcs(l, a);
    return true;
}
