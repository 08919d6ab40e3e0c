/* The shaders of the estimator tests, with their exact answers beside them. */
#ifndef SALTUS_TESTS_SAMPLE_SHADERS_H
#define SALTUS_TESTS_SAMPLE_SHADERS_H

#include "oracle.h"

#define PI 3.141592653589793

/* Disc: p = r, cx, cy. Channels: 1 inside; 1 + x inside. */
static inline double circle_g(const Point *p, int site, int k) {
    return (void)site, (void)k, hypot(p->x[0] - p->p[1], p->x[1] - p->p[2]) - p->p[0];
}
static inline void circle_f(Ctx *c, double *f) {
    bool in = disc(c, 0, 0);
    f[0] = in, f[1] = in ? 1 + c->at.x[0] : 0;
}
/* d/dr, d/dcx, d/dcy by channel: 2 pi r, 0, 0; 2 pi r (1 + cx), pi r^2, 0 */

/* The same with a smooth part that the parameters move: inside, p[3] * x + p[0]. */
static inline void shaded_f(Ctx *c, double *f) {
    f[0] = disc(c, 0, 0) ? c->at.p[3] * c->at.x[0] + c->at.p[0] : 0.25 * c->at.p[3];
}

/* One predicate tested twice: the jump is 3. */
static inline void twice_f(Ctx *c, double *f) {
    f[0] = disc(c, 0, 0) ? 1 : 0;
    if (disc(c, 0, 1)) f[0] += 2;
}

/* Two discs in painter's order: p = r0, x0, y0, r1, x1, y1; colours 1 and 3 on 0. */
static inline double discs_g(const Point *p, int site, int k) {
    return (void)site, hypot(p->x[0] - p->p[3 * k + 1], p->x[1] - p->p[3 * k + 2]) - p->p[3 * k];
}
static inline void discs_f(Ctx *c, double *f) {
    f[0] = 0;
    for (int k = 0; k < 2; k++)
        if (disc(c, 0, k)) f[0] = 1 + 2 * k;
}
/* Length of circle (r, at distance d of the other's centre) inside the other disc (q). */
static inline double arc_inside(double r, double q, double d) {
    if (d + r <= q) return 2 * PI * r;
    if (d >= r + q || d + q <= r) return 0;
    return 2 * r * acos((d * d + r * r - q * q) / (2 * d * r));
}

/* Ring of half width w: p = R, w. d/dw = 4 pi R */
static inline double ring_g(const Point *p, int site, int k) {
    return (void)site, (void)k, fabs(hypot(p->x[0] - 0.5, p->x[1] - 0.5) - p->p[0]) - p->p[1];
}
static inline void one_f(Ctx *c, double *f) { f[0] = disc(c, 0, 0); }

/* floor(s (x + 0.3 y)): p = s */
static inline double stairs_g(const Point *p, int site, int k) {
    return (void)site, (void)k, p->p[0] * (p->x[0] + 0.3 * p->x[1]);
}
static inline void stairs_f(Ctx *c, double *f) { f[0] = disc_floor(c, 0, 0); }
static inline double stairs_exact(double s) {
    double sum = 0;
    for (int n = 1; n < s * 1.3; n++) {
        /* y with 0 <= n/s - 0.3 y <= 1 */
        double lo = fmax(0, (n / s - 1) / 0.3), hi = fmin(1, n / s / 0.3);
        if (hi > lo) sum += (hi - lo) * n / (s * s);
    }
    return sum;
}

/* 1D: f = 2 x beyond p: d/dp = -2 p */
static inline double step_g(const Point *p, int site, int k) { return (void)site, (void)k, p->p[0] - p->x[0]; }
static inline void step_f(Ctx *c, double *f) { f[0] = disc(c, 0, 0) ? 2 * c->at.x[0] : 0; }

/* 3D ball: p = r; 4 pi r^2 */
static inline double ball_g(const Point *p, int site, int k) {
    return (void)site, (void)k, sqrt(pow(p->x[0] - 0.47, 2) + pow(p->x[1] - 0.52, 2) + pow(p->x[2] - 0.5, 2)) - p->p[0];
}

/* Disc of random radius p (0.5 + u): d/dp = 2 pi p 13/12 */
static inline double random_g(const Point *p, int site, int k) {
    return (void)site, (void)k, hypot(p->x[0] - 0.5, p->x[1] - 0.5) - p->p[0] * (0.5 + p->rand0);
}

/* Edge a x + y < p: through two borders; d/dp = its length across x, where 0 < p - a x < 1 */
static inline double edge_g(const Point *p, int site, int k) {
    return (void)site, (void)k, 0.37 * p->x[0] + p->x[1] - p->p[0];
}

/* Flower r0 (1 + 0.3 cos 5 phi): p = r0: 2 pi r0 (1 + 0.045) */
static inline double flower_g(const Point *p, int site, int k) {
    double x = p->x[0] - 0.5, y = p->x[1] - 0.5;
    return (void)site, (void)k, hypot(x, y) - p->p[0] * (1 + 0.3 * cos(5 * atan2(y, x)));
}

/* A disc only left of an edge: p = r, edge. Beyond the edge g of the disc is not executed. */
static inline double guarded_g(const Point *p, int site, int k) {
    return (void)k, site == 0 ? p->x[0] - p->p[1] : hypot(p->x[0] - 0.5, p->x[1] - 0.5) - p->p[0];
}
static inline void guarded_f(Ctx *c, double *f) { f[0] = disc(c, 0, 0) && disc(c, 1, 0); }

/* g whose slope is nothing: sign-like, jumps itself */
static inline double broken_g(const Point *p, int site, int k) {
    return (void)site, (void)k, p->x[0] < p->p[0] ? -1 : 1;
}

#endif
