/* heightfield.salt: light from patches, over the hemisphere and through pixels, against closed forms: a flat ground and
 * one straight ridge, so long that it has no ends. Values and derivatives; the derivative in the ridge's height is the
 * sum over its samples. */
#include "tests/stdlib/fixture.h"

enum { W = 17, H = 3, RIDGE = 10 }; /* the ridge's crest: column RIDGE of 0..W-1 */
static const double crest = RIDGE / (double)(W - 1);

/* Far beyond any light in y, so that the ridge is endless; 1 in x. */
#define GROUND "[Extent(0.0, -60.0, 1.0, 61.0)] param heightfield h = zeros(17, 3);\n"

static void set_ridge(SltProgram *p, double height) {
    double v[W * H] = {0};
    for (int j = 0; j < H; j++) v[j * W + RIDGE] = height;
    set(p, "h", v);
}

typedef struct Mean {
    double value, se, g[3 * 64], gse[3 * 64];
    uint32_t n;
} Mean;

static Mean mean(SltProgram *p, uint32_t samples) {
    Mean m = {0};
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    SltIntegral out = {
        .struct_size = sizeof out, .value = &m.value, .value_stderr = &m.se, .gradient = m.g, .gradient_stderr = m.gse};
    job.integral = true, job.samples = samples, job.threads = 1;
    m.n = slt_float_count(p);
    assert_true(m.n <= sizeof m.g / sizeof *m.g);
    if (slt_grad_integral(p, &job, &out, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
    return m;
}

/* d / d height of the ridge, with a standard error (its parts are of one sign and correlated: their sum bounds it). */
static double by_ridge(SltProgram *p, const Mean *m, double *se) {
    uint32_t base = base_of(p, "h");
    double g = 0;
    *se = 0;
    for (int j = 0; j < H; j++) g += m->g[base + j * W + RIDGE], *se += m->gse[base + j * W + RIDGE];
    return g;
}

static void near_to(const char *what, double a, double b, double tolerance) {
    if (!(fabs(a - b) <= tolerance)) fail_msg("%s: %.9g, wanted %.9g +- %.2g", what, a, b, tolerance);
}

/* ---- the closed form: Lambert's formula for the irradiance of a polygon of radiance 1 on the plane z = 0, clipped to
 * the side of a plane through the origin */

typedef struct V3 {
    double x, y, z;
} V3;
static V3 cross3(V3 a, V3 b) { return (V3){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
static double dot3(V3 a, V3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

static double polygon_irradiance(const V3 *v, int n, V3 keep) {
    V3 c[16];
    int m = 0;
    for (int i = 0; i < n; i++) {
        V3 a = v[i], b = v[(i + 1) % n];
        double da = dot3(a, keep), db = dot3(b, keep);
        if (da >= 0) c[m++] = a;
        if ((da >= 0) != (db >= 0)) {
            double t = da / (da - db);
            c[m++] = (V3){a.x + t * (b.x - a.x), a.y + t * (b.y - a.y), a.z + t * (b.z - a.z)};
        }
    }
    double sum = 0;
    for (int i = 0; i < m; i++) {
        V3 a = c[i], b = c[(i + 1) % m], k = cross3(a, b);
        double s = sqrt(dot3(k, k));
        if (s > 0) sum += atan2(s, dot3(a, b)) * k.z / s;
    }
    return fabs(sum) / 2;
}

typedef struct Scene {
    double x;        /* the receiver: (x, 0, 0) */
    V3 centre, a, b; /* the light */
    double height;   /* of the ridge */
} Scene;

static double scene_irradiance(const Scene *s) {
    V3 v[4];
    for (int i = 0; i < 4; i++) {
        double p = i == 0 || i == 3 ? -1 : 1, q = i < 2 ? -1 : 1;
        v[i] = (V3){s->centre.x - s->x + p * s->a.x + q * s->b.x, s->centre.y + p * s->a.y + q * s->b.y,
                    s->centre.z + p * s->a.z + q * s->b.z};
    }
    /* Above the plane through the receiver and the crest. */
    return polygon_irradiance(v, 4, (V3){-s->height, 0, crest - s->x});
}

#define LIGHT                                                                                                                  \
    "import heightfield;\n" GROUND "param float3 p = float3(0.0);\nparam float3 centre = float3(0.0);\n"                       \
    "param float3 a = float3(0.0);\nparam float3 b = float3(0.0);\n"

/* By ride_light, which sees what is visible, and by ride_patch with a ray to every place. */
static const char *const lights[2] = {
    LIGHT "shader float main(float2 x) {\n"
          "    AreaLight l = { centre, a, b, float3(1.0), false, false };\n"
          "    return PI * area_direct(h, float3(1.0), p, float3(0.0, 0.0, 1.0), l, x, 0.01).x;\n}\n",
    LIGHT "shader float main(float2 x) {\n"
          "    Patch q = light_rectangle(p, centre, a, b);\n    Ride r = ride_patch(h, p, q, 2.0 * x - 1.0, rand2());\n"
          "    [NoDisc] float lit = h.occluded(p, r.d, 0.0, 1.0) ? 0.0 : 1.0;\n"
          "    return lit * r.weight * patch_solid(q, r.d) * max(r.d.z, 0.0) / length(r.d);\n}\n"};

static void test_rectangle(void **state) {
    (void)state;
    static const Scene scenes[] = {
        {0.2, {0.3, 0.2, 0.7}, {0.2, 0, 0}, {0, 0.3, 0}, 0},                 /* overhead, nothing between */
        {0.21, {0.9, 0.05, 0.5}, {0.15, 0, 0.05}, {0, 0.2, 0.02}, 0.25},     /* half behind the ridge */
        {0.21, {0.95, -0.3, 0.3}, {0.02, 0.03, 0.15}, {0.05, 0.3, 0}, 0.22}, /* upright */
        {0.3, {0.31, 0.02, 0.6}, {0.3, 0.1, 0.02}, {-0.1, 0.25, 0}, 0.3},    /* overhead, its far corner hidden */
    };
    for (uint32_t k = 0; k < 2; k++) {
        SltProgram *p = compile(lights[k], NULL);
        for (uint32_t i = 0; i < sizeof scenes / sizeof *scenes; i++) {
            const Scene *s = &scenes[i];
            set(p, "p", (double[]){s->x, 0, 1e-7});
            set(p, "centre", &s->centre.x), set(p, "a", &s->a.x), set(p, "b", &s->b.x);
            set_ridge(p, s->height);
            Mean m = mean(p, 1 << 16);
            char what[64];
            snprintf(what, sizeof what, "estimator %u, scene %u", k, i);
            double wanted = scene_irradiance(s), se, g;
            near_to(what, m.value, wanted, 6 * m.se + 2e-3 * wanted);
            for (int c = 0; c < 4; c++) {
                Scene lo = *s, hi = *s;
                double step = 1e-5;
                if (c < 3) (&lo.centre.x)[c] -= step, (&hi.centre.x)[c] += step;
                else lo.height -= step, hi.height += step;
                wanted = (scene_irradiance(&hi) - scene_irradiance(&lo)) / (2 * step);
                if (c < 3) g = m.g[base_of(p, "centre") + c], se = m.gse[base_of(p, "centre") + c];
                else g = by_ridge(p, &m, &se);
                snprintf(what, sizeof what, "estimator %u, scene %u, slope %d", k, i, c);
                if (c == 3 && s->height == 0) continue; /* a kink */
                near_to(what, g, wanted, 6 * se + 5e-3 * fabs(wanted) + 2e-3);
            }
        }
        slt_program_free(p);
    }
}

/* A sun of any size and a ball: irradiance from the middle times the cosine; for a ball pi sin^2. */
static void test_round(void **state) {
    (void)state;
    SltProgram *p = compile(
        "import heightfield;\n" GROUND "param float elevation = 0.5;\n"
        "shader float main(float2 x) {\n"
        "    AreaLight l = area_sun(float3(-cos(elevation), 0.0, sin(elevation)), float3(2.0), 0.3);\n"
        "    return PI * area_direct(h, float3(1.0), float3(0.4, 0.0, 1e-7), float3(0.0, 0.0, 1.0), l, x, 0.01).x;\n}\n",
        NULL);
    Mean m = mean(p, 1 << 16);
    near_to("sun", m.value, 2 * sin(0.5), 2e-3);
    near_to("sun, slope", m.g[base_of(p, "elevation")], 2 * cos(0.5), 4e-3);
    slt_program_free(p);
    p = compile("import heightfield;\n" GROUND "param float radius = 0.2;\n"
                "shader float main(float2 x) {\n"
                "    float3 o = float3(0.4, 0.0, 1e-7);\n    Patch q = light_ball(o, float3(0.5, 0.3, 0.6), radius);\n"
                "    Ride r = ride_light(h, o, q, sqrt(x.x) * float2(cos(TAU * x.y), sin(TAU * x.y)), 0.01);\n"
                "    return r.weight * patch_solid(q, r.d) * r.d.z / length(r.d);\n}\n",
                NULL);
    m = mean(p, 1 << 16);
    double d2 = 0.01 + 0.09 + 0.36, cosine = 0.6 / sqrt(d2);
    near_to("ball", m.value, M_PI * 0.04 / d2 * cosine, 1e-3);
    near_to("ball, slope", m.g[base_of(p, "radius")], M_PI * 0.4 / d2 * cosine, 4e-3);
    slt_program_free(p);
}

/* How much of a cosine-weighted hemisphere is sky, at a distance from an endless ridge: (1 + cos of its elevation) / 2.
 * With a window, too. */
static void test_hemisphere(void **state) {
    (void)state;
    for (int window = 0; window < 2; window++) {
        char source[1024];
        snprintf(source, sizeof source,
                 "import heightfield;\n" GROUND "param float x0 = 0.25;\nshader float main(float2 x) {\n"
                 "    float3 o = float3(x0, 0.0, 1e-7), n = float3(0.0, 0.0, 1.0);\n"
                 "    Ride r = ride_hemisphere(h, o, n, float4(x, rand2()), %s);\n"
                 "    [NoDisc] Hit v = h.trace(o, r.d, 0.0, 1e9);\n    [NoDisc] float sky = v.hit ? 0.0 : 1.0;\n"
                 "    return sky * r.weight * max(r.d.z, 0.0) / PI;\n}\n",
                 window ? "0.2" : "0.0");
        SltProgram *p = compile(source, NULL);
        set_ridge(p, 0.3);
        Mean m = mean(p, 1 << 18);
        double far = crest - 0.25, r = hypot(far, 0.3), se, g = by_ridge(p, &m, &se);
        near_to("sky", m.value, 0.5 + 0.5 * far / r, 6 * m.se + 1e-3);
        near_to("sky, ridge", g, -0.5 * far * 0.3 / (r * r * r), 6 * se + 5e-3);
        near_to("sky, place", m.g[base_of(p, "x0")], -0.5 * 0.09 / (r * r * r), 6 * m.gse[base_of(p, "x0")] + 5e-3);
        slt_program_free(p);
    }
}

/* The skyline of the ridge in one big pixel, level or not, by one part and by all. The camera looks along +x, turned
 * and pitched; the crest is seen as a straight line. */
static double below_crest(double height, double pitch, double turn, double rise) {
    /* Area of { q in [-1, 1]^2: d(q) is below the plane through the eye (0.1, 0, 0.25 + rise) and the crest }, over 4.
     */
    double f[3] = {cos(turn) * cos(pitch), sin(turn) * cos(pitch), sin(pitch)}, r[3] = {sin(turn), -cos(turn), 0};
    double u[3] = {r[1] * f[2], -r[0] * f[2], r[0] * f[1] - r[1] * f[0]};
    double k = tan(0.3), slope = (height - 0.25 - rise) / (crest - 0.1), area = 0;
    /* d.z < slope d.x, d = f + k (x r + y u): linear in x and y. */
    double a = k * (r[2] - slope * r[0]), b = k * (u[2] - slope * u[0]), c = f[2] - slope * f[0];
    enum { STRIPS = 4000 };
    for (int i = 0; i < STRIPS; i++) {
        double x = -1 + (i + 0.5) * 2 / STRIPS, y = -(c + a * x) / b;
        area += fmin(fmax(y + 1, 0), 2) / STRIPS / 2 * 2;
    }
    return area / 2;
}

static void test_skyline(void **state) {
    (void)state;
    static const double views[][2] = {{0, 0}, {-0.2, 0.3}, {0.15, -0.4}};
#define VIEW                                                                                                                   \
    "import heightfield;\nimport camera;\n" GROUND "param float pitch = 0.0;\nparam float turn = 0.0;\nparam float rise = 0.0;\n" \
    "[Domain(-1.0, 1.0)] shader float main(float2 x) {\n    float3 eye = float3(0.1, 0.0, 0.25 + rise);\n"                     \
    "    Camera c = look_at(eye, eye + float3(cos(turn) * cos(pitch), sin(turn) * cos(pitch), sin(pitch)), float3(0.0, 0.0, 1.0));\n" \
    "    float2 s;\n    Patch q = camera_pixel(c, 0.6, x, float2(-1.0), float2(1.0), s);\n    float sum = 0.0;\n"
    static const char *const ways[2] = {
        VIEW "    Ride r = ride_patch(h, eye, q, s, rand2());\n    [NoDisc] Hit v = h.trace(eye, r.d, 0.0, 1e9);\n"
             "    [NoDisc] if (v.hit) sum = r.weight;\n    return sum / 4.0;\n}\n",
        VIEW
        "    Walk w = walk_patch(q, s);\n    [MaxIters(8)] while (w.more) {\n        Ride r = walk_next(h, eye, q, w, rand());\n"
        "        [NoDisc] Hit v = h.trace(eye, r.d, 0.0, 1e9);\n        [NoDisc] if (v.hit) sum += r.weight;\n    }\n    return sum / 4.0;\n}\n"};
    for (int k = 0; k < 2; k++) {
        SltProgram *p = compile(ways[k], NULL);
        for (uint32_t i = 0; i < sizeof views / sizeof *views; i++) {
            double pitch = views[i][0], turn = views[i][1], height = 0.22, e = 1e-4, se;
            set(p, "pitch", &pitch), set(p, "turn", &turn);
            set_ridge(p, height);
            Mean m = mean(p, 1 << 16);
            char what[64];
            snprintf(what, sizeof what, "way %d, view %u", k, i);
            near_to(what, m.value, below_crest(height, pitch, turn, 0), 6 * m.se + 2e-3);
            double g = by_ridge(p, &m, &se);
            near_to(what, g,
                    (below_crest(height + e, pitch, turn, 0) - below_crest(height - e, pitch, turn, 0)) / (2 * e),
                    6 * se + 0.01);
            const char *const names[3] = {"pitch", "turn", "rise"};
            for (int c = 0; c < 3; c++) {
                double d[3] = {0};
                d[c] = e;
                double wanted = (below_crest(height, pitch + d[0], turn + d[1], d[2]) -
                                 below_crest(height, pitch - d[0], turn - d[1], -d[2])) /
                                (2 * e);
                snprintf(what, sizeof what, "way %d, view %u, %s", k, i, names[c]);
                near_to(what, m.g[base_of(p, names[c])], wanted, 6 * m.gse[base_of(p, names[c])] + 0.01);
            }
        }
        slt_program_free(p);
    }
}

/* ---- the cone of the paper (examples/cone_light): at 16 samples a pixel the derivative images by slices are nearer to
 * the truth than by differences or by sites, and both have the same sum. tests/bench/cone.py has the same at equal
 * time. */

enum { SIZE = 48, PIXELS = SIZE * SIZE, RUNS = 6 };

static SltProgram *compile_example(const char *file) {
    SltOptions opt = SLT_OPTIONS_INIT;
    opt.stdlib_dir = SALTUS_STDLIB_BUILD;
    SltProgram *p = NULL;
    if (slt_compile_file(file, &opt, &p) != SLT_OK) fail_msg("%s%s", slt_diagnostics_text(p), slt_last_error(p));
    assert_int_equal(slt_channels(p), 1);
    return p;
}

static void derivative_image(SltProgram *p, const char *name, uint32_t spp, uint32_t seed, SltEstimator estimator,
                             float *out) {
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    double *direction = calloc(slt_float_count(p), sizeof *direction);
    assert_non_null(direction);
    direction[base_of(p, name)] = 1;
    job.size[0] = job.size[1] = SIZE, job.size[2] = 1, job.spp = spp, job.seed = seed, job.threads = 1,
    job.estimator = estimator;
    const double *directions[1] = {direction};
    float *images[1] = {out};
    if (slt_grad_images(p, &job, 1, directions, images, NULL, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
    free(direction);
}

static void test_cone(void **state) {
    (void)state;
    SltProgram *slices = compile_example(SALTUS_TEST_DIR "/../examples/cone_light/slices.salt"),
               *sites = compile_example(SALTUS_TEST_DIR "/../examples/cone_light/boundary.salt");
    static const char *const names[2] = {"scene.light", "scene.rise"};
    static float image[PIXELS];
    static double truth[PIXELS];
    for (int k = 0; k < 2; k++) {
        memset(truth, 0, sizeof truth);
        for (uint32_t r = 0; r < RUNS; r++) {
            derivative_image(slices, names[k], 256, 100 + r, SLT_EST_LATTICE, image);
            for (int i = 0; i < PIXELS; i++) truth[i] += image[i] / RUNS;
        }
        double error[3] = {0}, sum[3] = {0}, square[3] = {0}, whole = 0;
        for (int i = 0; i < PIXELS; i++) whole += truth[i];
        for (int way = 0; way < 3; way++)
            for (uint32_t r = 0; r < RUNS; r++) {
                double total = 0;
                derivative_image(way ? sites : slices, names[k], 16, 1 + r, way == 2 ? SLT_EST_FD : SLT_EST_LATTICE,
                                 image);
                for (int i = 0; i < PIXELS; i++)
                    error[way] += (image[i] - truth[i]) * (image[i] - truth[i]), total += image[i];
                sum[way] += total / RUNS, square[way] += total * total / RUNS;
            }
        if (getenv("SALTUS_PRINT"))
            printf("  %s: squared errors %g (slices), %g (sites), %g (differences)\n", names[k], error[0], error[1],
                   error[2]);
        if (!(3 * error[0] < error[1] && 5 * error[0] < error[2]))
            fail_msg("%s: squared errors %g (slices), %g (sites), %g (differences)", names[k], error[0], error[1],
                     error[2]);
        for (int way = 0; way < 3; way++) {
            double se = sqrt(fmax(square[way] - sum[way] * sum[way], 0) / (RUNS - 1));
            near_to(names[k], sum[way], whole, 5 * se + 0.01 * fabs(whole));
        }
    }
    slt_program_free(slices), slt_program_free(sites);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_rectangle), cmocka_unit_test(test_round), cmocka_unit_test(test_hemisphere),
        cmocka_unit_test(test_skyline),   cmocka_unit_test(test_cone),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
