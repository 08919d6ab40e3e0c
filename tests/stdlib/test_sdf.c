/* Every distance of sdf.salt and bezier.salt.
 *
 * A distance d is exact if and only if it vanishes on the outline alone, has a gradient of length
 * 1, and p - d grad d lies on the outline; the last two are tested at random points, the outline by
 * the area (or volume) inside, whose derivative with respect to a size goes through the boundary
 * term and has a closed form too. */
#include "tests/stdlib/fixture.h"

typedef struct Shape {
    const char *name, *body; /* statements that return the distance, of p and the size s */
    int dim;
    double s;
    double (*measure)(double s); /* area or volume in [-1, 1]^dim; NULL: not tested */
    double exactness;            /* of d; 0: only its outline is */
} Shape;

static double circle(double s) { return M_PI * s * s; }
static double box(double s) { return 4 * s * 0.3; }
static double rounded(double s) { return 4 * 0.6 * 0.4 - (4 - M_PI) * s * s; }
static double capsule(double s) { return M_PI * s * s + 2 * s * hypot(0.7, 0.4); }
static double ring(double s) { return 4 * M_PI * 0.5 * s; }
static double triangle(double s) { return 0.5 * s * 0.9; }
static double hexagon(double s) { return 3 * s * s * sin(M_PI / 3); }
static double pentagon(double s) { return 2.5 * s * s * sin(2 * M_PI / 5); }
static double star(double s) { return 5 * 0.8 * s * sin(M_PI / 5); }
static double ellipse(double s) { return M_PI * s * 0.35; }
static double notched(double s) { return 1.2 - 0.5 * 1.2 * (1 - s); }
static double half_plane(double s) { return 2 * (1 + s); }
static double two_circles(double s) { return 2 * M_PI * s * s; }
static double extruded(double s) { return M_PI * 0.16 * 2 * s; }
static double sphere(double s) { return 4.0 / 3 * M_PI * s * s * s; }
static double box3(double s) { return 8 * s * 0.3 * 0.5; }
static double torus(double s) { return 2 * M_PI * M_PI * 0.6 * s * s; }
static double capsule3(double s) { return M_PI * s * s * 0.8 + 4.0 / 3 * M_PI * s * s * s; }
static double cylinder(double s) { return 2 * M_PI * s * s * 0.5; }
static double cone(double s) { return M_PI / 3 * s * s * 0.9; }
static double slab(double s) { return 4 * (1 + s); }
static double ellipsoid(double s) { return 4.0 / 3 * M_PI * s * 0.4 * 0.6; }
static double tori(double s) { return 2 * M_PI * M_PI * 0.6 * s * s; }
static double lens(double s) { return 2 * s * s * acos(0.3 / s) - 0.6 * sqrt(s * s - 0.09); }
static double crescent(double s) { return M_PI * s * s - lens(s); }

static const Shape shapes[] = {
    {"circle", "return sd_circle(p - float2(0.1, 0.05), s);", 2, 0.5, circle, 1e-9},
    {"line", "return sd_line(p, float2(1.0, s), float2(-1.0, s));", 2, 0.2, NULL, 1e-9},
    {"line, other way", "return sd_line(p, float2(-1.0, s), float2(1.0, s));", 2, 0.2, half_plane, 1e-9},
    {"capsule", "return sd_capsule(p, float2(-0.3, -0.2), float2(0.4, 0.2), s);", 2, 0.25, capsule, 1e-9},
    {"box", "return sd_box(p, float2(s, 0.3));", 2, 0.6, box, 1e-9},
    {"rounded box", "return sd_rounded_box(p, float2(0.6, 0.4), s);", 2, 0.15, rounded, 1e-9},
    {"ring", "return sd_ring(p, 0.5, s);", 2, 0.12, ring, 1e-9},
    {"triangle", "return sd_triangle(p, float2(-0.5, -0.4), float2(s - 0.5, -0.4), float2(0.1, 0.5));", 2, 0.9,
     triangle, 1e-9},
    {"triangle, clockwise", "return sd_triangle(p, float2(-0.5, -0.4), float2(0.1, 0.5), float2(s - 0.5, -0.4));", 2,
     0.9, triangle, 1e-9},
    {"hexagon", "return sd_ngon(p, s, 6);", 2, 0.7, hexagon, 1e-9},
    {"pentagon", "return sd_ngon(p, s, 5);", 2, 0.7, pentagon, 1e-9},
    {"star", "return sd_star(p, 0.8, s, 5);", 2, 0.35, star, 1e-9},
    {"ellipse", "return sd_ellipse(p, float2(s, 0.35));", 2, 0.7, ellipse, 1e-5},
    {"ellipse, upright", "return sd_ellipse(p.yx, float2(s, 0.35));", 2, 0.7, ellipse, 1e-5},
    {"ellipse, flat", "return sd_ellipse(p, float2(s, 0.04));", 2, 0.9, NULL, 1e-5},
    {"ellipse, round", "return sd_ellipse(p, float2(s, s));", 2, 0.6, circle, 1e-5},
    {"ellipse, fast", "return sd_ellipse_fast(p, float2(s, 0.35));", 2, 0.7, ellipse, 0},
    {"polygon with a notch",
     "float2 v[5] = { float2(-0.6, -0.5), float2(0.6, -0.5), float2(0.6, 0.5), float2(0.1, s - "
     "0.5), float2(-0.6, 0.5) }; Polygon g = polygon_begin(); for (int i = 0; i < 5; i++) "
     "g = polygon_edge(g, p, v[i], v[(i + 1) % 5]); return polygon_end(g);",
     2, 0.4, notched, 1e-9},
    {"rotated box", "return sd_box(op_rotate(op_translate(p, float2(0.1, -0.1)), 0.7), float2(s, 0.3));", 2, 0.6, box,
     1e-9},
    {"mirrored circles", "return sd_circle(op_mirror(p) - float2(0.5, 0.0), s);", 2, 0.3, two_circles, 1e-9},
    {"repeated circles", "return sd_circle(op_repeat(p - float2(0.5, 0.0), float2(1.0, 2.0)), s);", 2, 0.3, two_circles,
     1e-9},
    {"repeated in limits", "return sd_circle(op_repeat(p + float2(0.5, 0.0), float2(1.0, 2.0), float2(1.0, 0.0)), s);",
     2, 0.3, two_circles, 1e-9},
    {"intersection", "return op_intersect(sd_circle(p - float2(0.3, 0.0), s), sd_circle(p + float2(0.3, 0.0), s));", 2,
     0.5, lens, 0},
    {"difference", "return op_subtract(sd_circle(p - float2(0.3, 0.0), s), sd_circle(p + float2(0.3, 0.0), s));", 2,
     0.5, crescent, 0},
    {"onion", "return op_onion(sd_circle(p, 0.5), s);", 2, 0.12, ring, 1e-9},
    {"round", "return op_round(sd_box(p, float2(0.6 - s, 0.4 - s)), s);", 2, 0.15, rounded, 1e-9},
    {"sphere", "return sd_sphere(p, s);", 3, 0.6, sphere, 1e-9},
    {"box3", "return sd_box(p, float3(s, 0.3, 0.5));", 3, 0.6, box3, 1e-9},
    {"torus", "return sd_torus(p, 0.6, s);", 3, 0.25, torus, 1e-9},
    {"revolved circle", "return sd_circle(op_revolve(p, 0.6), s);", 3, 0.25, tori, 1e-9},
    {"capsule3", "return sd_capsule(p, float3(-0.4, 0.1, 0.0), float3(0.4, 0.1, 0.0), s);", 3, 0.3, capsule3, 1e-9},
    {"cylinder", "return sd_cylinder(p, s, 0.5);", 3, 0.6, cylinder, 1e-9},
    {"cone", "return sd_cone(p + float3(0.0, 0.4, 0.0), s, 0.9);", 3, 0.6, cone, 1e-9},
    {"plane", "return sd_plane(p, float3(0.0, 1.0, 0.0), s);", 3, 0.2, slab, 1e-9},
    {"ellipsoid", "return sd_ellipsoid(p, float3(s, 0.4, 0.6));", 3, 0.7, ellipsoid, 0},
    {"extruded", "return op_extrude(sd_circle(p.xy, 0.4), p.z, s);", 3, 0.5, extruded, 1e-9},
    {"turned box", "return sd_box(rotate_x(rotate_y(rotate_z(p, 0.3), 0.5), -0.4), float3(s, 0.3, 0.5));", 3, 0.6, box3,
     1e-9},
};

static void make_source(char *out, size_t size, const Shape *h) {
    snprintf(out, size,
             "import sdf;\nparam float s = %.17g;\nparam float%d at = float%d(0.0);\n"
             "float shape(float%d p) { %s }\n"
             "shader float point(float%d x) { return shape(at); }\n"
             "[Domain(-1.0, 1.0)] shader float inside(float%d x) { float f = 0.0; [Disc] if "
             "(shape(x) < 0.0) f = 1.0; return f; }\n",
             h->s, h->dim, h->dim, h->dim, h->body, h->dim, h->dim);
}

static void test_distances_are_exact(void **state) {
    (void)state;
    for (size_t k = 0; k < sizeof shapes / sizeof *shapes; k++) {
        const Shape *h = &shapes[k];
        char source[2048];
        make_source(source, sizeof source, h);
        SltProgram *p = compile(source, "point");
        uint32_t at = base_of(p, "at"), seed = 1;
        for (int i = 0; i < 150; i++) {
            double x[3], y[3], d, e, g[8], ignored[8], norm = 0, moved[3], fd;
            for (int a = 0; a < h->dim; a++) x[a] = 2.4 * uniform(&seed) - 1.2;
            set(p, "at", x);
            evaluate(p, &d, g);
            for (int a = 0; a < h->dim; a++) norm += g[at + a] * g[at + a];
            norm = sqrt(norm);
            /* The derivative is that of the value, whatever the value is. */
            for (int a = 0; a < h->dim; a++) {
                double up, down;
                memcpy(moved, x, sizeof moved);
                moved[a] = x[a] + 1e-6, set(p, "at", moved), evaluate(p, &up, ignored);
                moved[a] = x[a] - 1e-6, set(p, "at", moved), evaluate(p, &down, ignored);
                fd = (up - down) / 2e-6;
                /* A kink within the step has no derivative to compare with. */
                if (fabs((up + down) / 2 - d) < 1e-9 && fabs(fd - g[at + a]) > 1e-5)
                    fail_msg("%s: d/dx[%d] = %.9g, differences %.9g at (%.9g, %.9g)", h->name, a, g[at + a], fd, x[0],
                             x[1]);
            }
            if (h->exactness > 0) {
                if (fabs(norm - 1) > 1e-6 + h->exactness)
                    fail_msg("%s: |grad| = %.9g at (%.9g, %.9g)", h->name, norm, x[0], x[1]);
                for (int a = 0; a < h->dim; a++) y[a] = x[a] - d * g[at + a];
                set(p, "at", y);
                evaluate(p, &e, ignored);
                if (fabs(e) > 1e-8 + h->exactness)
                    fail_msg("%s: d = %.9g at (%.9g, %.9g), but the foot is %.3g off", h->name, d, x[0], x[1], e);
            }
        }
        slt_program_free(p);
    }
}

static void test_measures_and_their_derivatives(void **state) {
    (void)state;
    for (size_t k = 0; k < sizeof shapes / sizeof *shapes; k++) {
        const Shape *h = &shapes[k];
        if (!h->measure) continue;
        char source[2048];
        make_source(source, sizeof source, h);
        SltProgram *p = compile(source, "inside");
        SltJob job = SLT_JOB_INIT;
        SltError err = {0};
        SltStats stats = SLT_STATS_INIT;
        double value, value_se, g[8] = {0}, se[8] = {0};
        SltIntegral out = {.struct_size = sizeof out,
                           .value = &value,
                           .value_stderr = &value_se,
                           .gradient = g,
                           .gradient_stderr = se};
        job.integral = true, job.samples = 1 << 16, job.threads = 1;
        if (slt_grad_integral(p, &job, &out, &stats, &err) != SLT_OK) fail_msg("%s: %s", h->name, err.text);
        uint32_t s = base_of(p, "s");
        double want = h->measure(h->s), slope = (h->measure(h->s + 1e-6) - h->measure(h->s - 1e-6)) / 2e-6;
        if (fabs(value - want) > 6 * value_se + 2e-3 * want)
            fail_msg("%s: measure %.6g +- %.2g, wanted %.6g", h->name, value, value_se, want);
        if (fabs(g[s] - slope) > 6 * se[s] + 4e-3 * fabs(slope))
            fail_msg("%s: derivative %.6g +- %.2g, wanted %.6g", h->name, g[s], se[s], slope);
        uint64_t dropped = 0;
        for (int r = 0; r < SLT_DROP_REASONS; r++) dropped += stats.dropped[r];
        if (dropped * 1000 > stats.crossings)
            fail_msg("%s: %llu of %llu crossings dropped", h->name, (unsigned long long)dropped,
                     (unsigned long long)stats.crossings);
        slt_program_free(p);
    }
}

/* Smooth operators: C1 (the derivative at the seam is one half each and the blend ends without a
 * kink), and never more than k/4 away. */
static void test_smooth_operators(void **state) {
    (void)state;
    SltProgram *p = compile("import sdf;\nparam float a = 0.0;\nparam float b = 0.0;\n"
                            "shader float3 main(float2 x) { return float3(op_smooth_union(a, b, 0.3), "
                            "op_smooth_intersect(a, b, 0.3), op_smooth_subtract(a, b, 0.3)); }\n",
                            NULL);
    uint32_t ia = base_of(p, "a"), ib = base_of(p, "b"), seed = 5;
    for (int i = 0; i < 200; i++) {
        double a = uniform(&seed) - 0.5, b = i % 4 ? uniform(&seed) - 0.5 : a, v[3], g[6];
        set(p, "a", &a), set(p, "b", &b);
        evaluate(p, v, g);
        double hard[3] = {fmin(a, b), fmax(a, b), fmax(a, -b)}, sign[3] = {-1, 1, 1},
               gap[3] = {fabs(a - b), fabs(a - b), fabs(a + b)};
        for (int k = 0; k < 3; k++) {
            double blend = gap[k] < 0.3 ? (0.3 - gap[k]) * (0.3 - gap[k]) / 1.2 : 0;
            assert_true(fabs(v[k] - (hard[k] + sign[k] * blend)) < 1e-12);
        }
        if (a == b) assert_true(fabs(g[ia] - 0.5) < 1e-12 && fabs(g[ib] - 0.5) < 1e-12);
    }
    slt_program_free(p);
}

/* ---- Bezier curves against a dense search */
typedef struct P2 {
    double x, y;
} P2;

static P2 curve(const double *c, int n, double t) {
    double w = 1 - t, b[4];
    if (n == 3) b[0] = w * w, b[1] = 2 * w * t, b[2] = t * t;
    else b[0] = w * w * w, b[1] = 3 * w * w * t, b[2] = 3 * w * t * t, b[3] = t * t * t;
    P2 r = {0, 0};
    for (int i = 0; i < n; i++) r.x += b[i] * c[2 * i], r.y += b[i] * c[2 * i + 1];
    return r;
}

static double nearest(const double *c, int n, const double *x, double w0, double w1) {
    double best = INFINITY, at = 0;
    for (int i = 0; i <= 4000; i++) {
        P2 q = curve(c, n, i / 4000.0);
        double d = hypot(q.x - x[0], q.y - x[1]);
        if (d < best) best = d, at = i / 4000.0;
    }
    for (double h = 1 / 4000.0; h > 1e-12; h /= 2)
        for (int side = -1; side <= 1; side += 2) {
            double t = fmin(fmax(at + side * h, 0), 1);
            P2 q = curve(c, n, t);
            double d = hypot(q.x - x[0], q.y - x[1]);
            if (d < best) best = d, at = t;
        }
    return best - 0.5 * ((1 - at) * w0 + at * w1);
}

static void test_bezier(void **state) {
    (void)state;
    SltProgram *p = compile("import bezier;\nparam float2 at = float2(0.0);\nparam float2 c[4] = { "
                            "float2(0.0), float2(0.0), float2(0.0), float2(0.0) };\n"
                            "shader float4 main(float2 x) { return float4(sd_bezier(at, c[0], c[1], c[2]), "
                            "sd_bezier(at, c[0], c[1], c[2], c[3]), sd_stroke(at, c[0], c[1], c[2], 0.2), "
                            "sd_stroke_tapered(at, c[0], c[1], c[2], 0.1, 0.3)); }\n",
                            NULL);
    uint32_t nf = slt_float_count(p), seed = 77, wrong_cubic = 0, compared = 0;
    assert_int_equal(nf, 10);
    for (int i = 0; i < 200; i++) {
        double c[8], x[2], v[4], g[40], up[4], down[4], ignored[40];
        for (int k = 0; k < 8; k++) c[k] = 2 * uniform(&seed) - 1;
        x[0] = 2 * uniform(&seed) - 1, x[1] = 2 * uniform(&seed) - 1;
        /* Straight and nearly straight quadratics, evenly and unevenly travelled. */
        if (i % 5 == 0)
            for (int a = 0; a < 2; a++) c[2 + a] = c[a] + (c[4 + a] - c[a]) * (i % 2 ? 0.5 : 0.3) + (i % 3 ? 0 : 1e-4);
        set(p, "c", c), set(p, "at", x);
        evaluate(p, v, g);
        double want[4] = {nearest(c, 3, x, 0, 0), nearest(c, 4, x, 0, 0), nearest(c, 3, x, 0.2, 0.2),
                          nearest(c, 3, x, 0.1, 0.3)};
        for (int k = 0; k < 4; k++)
            if (k == 1 && fabs(v[k] - want[k]) > 1e-6) wrong_cubic++;
            else if (fabs(v[k] - want[k]) > 2e-5) fail_msg("case %d, %d: %.9g, wanted %.9g", i, k, v[k], want[k]);
        double *q = malloc(nf * sizeof *q);
        for (uint32_t f = 0; f < nf; f++) {
            memcpy(q, slt_floats(p), nf * sizeof *q);
            double keep = q[f];
            q[f] = keep + 1e-6, slt_set_floats(p, f, 1, &q[f], NULL), evaluate(p, up, ignored);
            q[f] = keep - 1e-6, slt_set_floats(p, f, 1, &q[f], NULL), evaluate(p, down, ignored);
            slt_set_floats(p, f, 1, &keep, NULL);
            for (int k = 0; k < 4; k++) {
                if (fabs((up[k] + down[k]) / 2 - v[k]) > 1e-9) continue; /* a kink */
                compared++;
                double fd = (up[k] - down[k]) / 2e-6;
                if (fabs(fd - g[k * nf + f]) > 2e-4 * (1 + fabs(fd)))
                    fail_msg("case %d, %d: d/d[%u] %.9g, differences %.9g", i, k, f, g[k * nf + f], fd);
            }
        }
        free(q);
    }
    assert_true(wrong_cubic <= 2);
    assert_true(compared > 7000);
    slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_distances_are_exact),
        cmocka_unit_test(test_measures_and_their_derivatives),
        cmocka_unit_test(test_smooth_operators),
        cmocka_unit_test(test_bezier),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
