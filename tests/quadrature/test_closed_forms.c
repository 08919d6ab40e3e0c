/* Quadrature against closed forms: those that the lattice holds to half a per cent are held to a millionth here, and so
 * are some that lines find hard. */
#include "tests/sample/closed_forms.h"

static void make_more(void) {
    /* Near the point of contact rounding decides what lies between: in f32 along 1e-4 of the curve. */
    CASE("a disc less one that touches it inside",
         SHADER2("param float r = 0.3;", UNIT,
                 "float s = max(length(x) - r, -(length(x - float2(0.2, 0.0)) - 0.1)); [Disc] if (s < 0.0) return 1.0; "
                 "return 0.0;"),
         .want = {{"r", 2 * PI * 0.3}});
    CASE("a disc on one that it touches inside",
         SHADER2("param float r = 0.25; param float R = 0.5;", UNIT,
                 "float f = 0.0; [Disc] if (length(x) < R) f = 1.0; [Disc] if (length(x - float2(0.25, 0.0)) < r) f += "
                 "2.0; return f;"),
         .want = {{"r", 4 * PI * 0.25}, {"R", 2 * PI * 0.5}});
    CASE(
        "rotated ellipse with shading",
        SHADER2("param float s = 1.0;", UNIT,
                "float c = cos(0.7), n = sin(0.7); float2 q = float2(c * x.x + n * x.y, c * x.y - n * x.x) / "
                "float2(0.7 * s, 0.3 * s); [Disc] return dot(q, q) < 1.0 ? 1.0 + x.x * x.x : 0.0;"),
        /* area ab pi and moment pi a b (a^2 c^2 + b^2 n^2) / 4, times s^2 and s^4 */
        .want = {{"s", 2 * PI * 0.21 + 4 * PI * 0.21 / 4 * (0.49 * cos(0.7) * cos(0.7) + 0.09 * sin(0.7) * sin(0.7))}});
    CASE("decoys that are hidden",
         SHADER2("param float r = 0.4; param float q = 0.3; param float2 c = float2(0.03, -0.02);", UNIT,
                 "float f = 0.25; [Disc] if (length(x - c) < q) f = 3.0; [Disc] if (length(x) < r) f = 1.0; return f;"),
         .want = {{"r", 0.75 * 2 * PI * 0.4}, {"q", 0}, {"c.x", 0}});
    CASE("quantised ramp",
         SHADER2("param float s = 0.1; param float k = 7.3;", "", "[Disc] return floor(k * x.x + s * x.y) / 7.0;"),
         /* sum over n of the length of k x + s y = n, moved by y / k and x / k: n = 1 .. 7 */
         .want = {{"s", 7 * 0.5 / 7.3 / 7}, {"k", (28 - 7 * 0.05) / (7.3 * 7.3) / 7}});
    CASE("nearest of three",
         SHADER2("param float2 a[3] = { float2(0.2, 0.3), float2(0.8, 0.3), float2(0.5, 0.9) };", "",
                 "float best = 9.0; float f = 0.0; for (int i = 0; i < 3; i++) { float2 d = x - a[i]; float q = "
                 "dot(d, d); [Disc] if (q < best) { best = q; f = float(i); } } return f;"),
         /* between 0 and 1 -0.3 / 0.6 up to y = 0.525, between 1 and 2 2 (0.3^2 - 0.2^2) / (2 * 0.6 * 2) */
         .want = {{"a[1].x", -53.0 / 240}});
    /* The angle jumps by whole periods, along an axis through the middle. */
    CASE(
        "petals by an angle",
        SHADER2("param float2 c = float2(0.03, -0.07); param float r = 0.5; param float a = 0.25; param float s = 0.3;",
                UNIT,
                "float2 d = x - c; [Disc] return length(d) < r * (1.0 + a * cos(5.0 * atan2(d.y, d.x) + s)) ? 1.0 : "
                "0.0;"),
        .want = {{"r", 2 * PI * 0.5 * (1 + 0.25 * 0.25 / 2)}, {"a", PI * 0.25 * 0.25}, {"c.x", 0}, {"s", 0}});
    CASE("petals about the origin",
         SHADER2("param float r = 0.5; param float a = 0.25;", UNIT,
                 "[Disc] return length(x) < r * (1.0 + a * sin(3.0 * atan2(x.x, x.y))) ? 1.0 : 0.0;"),
         .want = {{"r", 2 * PI * 0.5 * (1 + 0.25 * 0.25 / 2)}, {"a", PI * 0.25 * 0.25}});
    CASE(
        "a slice by angles",
        SHADER2("param float2 c = float2(0.1, 0.05); param float r = 0.5; param float lo = -1.0; param float hi = 2.0;",
                UNIT,
                "float2 d = x - c; float t = atan2(d.y, d.x); [Disc] return length(d) < r && t > lo && t < hi ? 1.0 : "
                "0.0;"),
        .want = {{"r", 3 * 0.5}, {"lo", -0.125}, {"hi", 0.125}, {"c.x", 0}});
    /* 16 discs of each; which ink it is no site tells, and so no hash */
    CASE("a table of inks by untagged integers",
         SHADER2("param float a[4] = { 1.0, 2.0, 3.0, 5.0 };", "",
                 "int k = (int(8.0 * x.x) + 3 * int(8.0 * x.y)) & 3; [Disc] if (length(frac(8.0 * x) - 0.5) < 0.3) "
                 "return a[k]; return 0.5;"),
         .want = {{"a[0]", PI * 0.09 / 4}, {"a[1]", PI * 0.09 / 4}, {"a[2]", PI * 0.09 / 4}, {"a[3]", PI * 0.09 / 4}});
    CASE("stiff shading",
         SHADER2("param float r = 0.6; param float k = 40.0;", UNIT,
                 "[Disc] return length(x) < r ? exp(-k * (x.x - 0.2) * (x.x - 0.2)) : 0.0;"),
         .want = {{"r", 0.614520466874609 /* r times the integral over the angle, by the trapezoidal rule */}});
    CASE("a line by a polynomial that cancels",
         SHADER2(
             "param float t = 0.9;", "",
             "float y = x.x + 0.1 * x.y; float v = ((((y - 5.0) * y + 10.0) * y - 10.0) * y + 5.0) * y; [Disc] return "
             "v < t ? 1.0 : 0.0;"),
         .want = {{"t", 1 / (5 * pow(0.1, 0.8)) /* v is 1 - (1 - y)^5 */}});
    CASE("spherical cap",
         SHADER3("param float r = 0.7; param float h = 0.3;", UNIT,
                 "[Disc] return length(x) < r && x.z > h ? 1.0 : 0.0;"),
         .want = {{"r", 2 * PI * 0.7 * 0.4}, {"h", -PI * (0.49 - 0.09)}});
    CASE(
        "a march that a comparison ends",
        SHADER2(
            "param float p = 0.3;", "",
            "float t = 0.0; for (int i = 0; i < 4; i++) { [Disc] if (t * t + x.x * t > x.y) break; t += p; } return t;"),
        /* p times the areas A(t) above y = t^2 + x t, t = 0, p, 2 p, 3 p: 1 - t^2 - t / 2, and (1 - t^2)^2 / (2 t)
         * where the curve leaves through y = 1 */
        .want = {{"p", 1 + 0.76 + 0.34 + 0.19 * 0.19 / 1.8 +
                           0.3 * (-1.1 - 2 * 1.7 - 3 * (2 * 0.19 + 0.19 * 0.19 / (2 * 0.81)))}});
    CASE("union of intervals under [SkipLoop]",
         SHADER1("param float w = 0.3;",
                 "bool hit = false; for (int i = 0; i < 3; i++) { float c = 0.2 + 0.1 * float(i); [Disc] [SkipLoop] if "
                 "(abs(x - c - 0.5 * w) - 0.5 * w < 0.0) hit = true; } return hit ? 1.0 : 0.0;"),
         .want = {{"w", 1}});
    CASE("a straight line that moves as a wave",
         SHADER2("param float t = 0.0;", "", "[Disc] return x.y - 0.513 > t * sin(40.0 * x.x) ? 1.0 : 0.0;"),
         .want = {{"t", (cos(40) - 1) / 40}});
    CASE("product of conditions",
         SHADER2(
             "param float a = 0.5; param float b = 0.4;", UNIT,
             "[Disc] float u = length(x) < a ? 2.0 : 1.0; [Disc] float v = x.x + x.y < b ? 3.0 : 1.0; return u * v;"),
         /* twice the arc where x + y < b, and all of it once */
         .want = {{"a", 0.5 * (6 * PI - 4 * acos(0.4 / (0.5 * sqrt(2))))}});
}

/* Streams are one dimension more than cells have. */
static bool random_program(const Case *c) { return strstr(c->source, "rand()") != NULL; }
/* What cells are not up to yet: a root of f at the curve in single precision. */
static bool beyond(const Case *c, bool f64) { return !f64 && strstr(c->name, "square root guarded"); }

/* Jumps of both signs that lines in what is left may step over all at once. */
static bool understated(const Case *c) { return strstr(c->name, "own cut"); }

static void run(const Case *c, bool f64) {
    SltJob job = SLT_JOB_INIT;
    job.integral = true, job.threads = 2, job.estimator = SLT_EST_QUADRATURE;
    job.error = f64 ? 1e-7 : 1e-5, job.max_evaluations = 1u << 25;
    /* In single precision a strip of a hundred units in the last place is known no better than it says. */
    SltStats s = run_case(c, &job, f64, f64 ? 1e-6 : 1e-5, f64 ? 0 : 1);
    /* Cells are cut at the jump of an angle. */
    if (f64 && strstr(c->name, "petals") && !(s.left < 1e-20 && s.evaluations < 50000))
        fail_msg("%s: %g left after %llu evaluations", c->name, s.left, (unsigned long long)s.evaluations);
    if (getenv("SALTUS_PRINT"))
        printf("    %llu evaluations, settled %.4f curved %.4f left %.2g, %.4f s\n", (unsigned long long)s.evaluations,
               s.settled, s.curved, s.left, s.seconds);
}
/* What is stated is true, whatever was asked for. Of the cap 4096 samples leave a sixteenth of the domain to lines that
 * meet 140 crossings: their two sets tell the error of their mean to a half. */
static void stated(void **state) {
    const Case *c = *state;
    double times = strcmp(c->name, "spherical cap") ? 1 : 1.5;
    for (int i = 0; i < 4; i++) {
        SltJob job = SLT_JOB_INIT;
        job.integral = true, job.threads = 2, job.estimator = SLT_EST_QUADRATURE;
        job.samples = i < 2 ? 1 << 12 : 1 << 16;
        if (i & 1) job.error = i < 2 ? 1e-2 : 1e-4, job.max_evaluations = 1u << 22;
        run_case(c, &job, true, 1e-12, times);
    }
}
/* Evaluations that end within a sweep leave a cell or two to a few samples, whose two sets may agree by chance: 1.7e-10
 * was stated of 8e-6. */
static void ends_within(void **state) {
    (void)state;
    const Case *c = NULL;
    for (int i = 0; i < ncases; i++)
        if (strstr(cases[i].name, "table of inks")) c = &cases[i];
    assert_non_null(c);
    for (uint64_t samples = 60000; samples < 76000; samples += 1500) {
        SltJob job = SLT_JOB_INIT;
        job.integral = true, job.estimator = SLT_EST_QUADRATURE, job.samples = samples;
        run_case(c, &job, true, 1e-12, 1);
    }
}

/* Evaluations that end when all curves are integrated, but not all of the volume: the value says so. */
static void volume_that_is_sampled(void **state) {
    (void)state;
    static const char source[] = "param float r = 0.5; param float h = 0.6; [Domain(-1.0, 1.0)] shader float "
                                 "main(float3 x) { [Disc] return length(x.xy) < r && abs(x.z) < h ? 1.0 : 0.0; }";
    SltOptions o = SLT_OPTIONS_INIT;
    SltProgram *p = NULL;
    SltError err = {0};
    uint32_t coarse = 0, stopped = 0;
    o.f64 = true;
    assert_int_equal(slt_compile_string(source, "cylinder", &o, &p), SLT_OK);
    for (double most = 1e5; most < 2e6; most *= 1.15) {
        SltJob job = SLT_JOB_INIT;
        SltIntegral out = SLT_INTEGRAL_INIT;
        SltStats s = SLT_STATS_INIT;
        double value, error, gradient[2];
        job.integral = true, job.threads = 2, job.estimator = SLT_EST_QUADRATURE;
        job.max_evaluations = (uint64_t)most;
        out.value = &value, out.value_stderr = &error, out.gradient = gradient;
        if (slt_grad_integral(p, &job, &out, &s, &err) != SLT_OK) fail_msg("%s", err.text);
        double off = fabs(value - PI * 0.25 * 1.2);
        if (s.left > 0) continue;
        if (!(off <= error && off <= s.left_bound + 1e-6))
            fail_msg("%g evaluations: off by %g, stated %g", most, off, error);
        coarse += off > 1e-6;
        stopped += s.stopped == SLT_STOP_EVALUATIONS;
    }
    assert_true(coarse > 0 && stopped > 0);
    slt_program_free(p);
}

/* A smooth solid: what is wanted is reached; and evaluations that do not do for it leave cells whose
 * rules differ, not cells that nobody has looked at. */
static void smooth_solid(void **state) {
    (void)state;
    static const char source[] =
        "param float r = 0.6; param float c = 0.07; [Domain(-1.0, 1.0)] shader float main(float3 x) {"
        "float3 q = (x - float3(0.02, c, -0.03)) / r; q = q * q; [Disc] if (dot(q, q) < 1.0) return 1.0 + x.y;"
        "return 0.0; }";
    static const struct {
        double most, bar;
        SltStop stop;
    } run[] = {{2.2e6, 1e-9, SLT_STOP_NONE}, {8e5, 1e-4, SLT_STOP_EVALUATIONS}};
    SltOptions o = SLT_OPTIONS_INIT;
    SltProgram *p = NULL;
    SltError err = {0};
    double volume = 8 * pow(tgamma(1.25), 3) / tgamma(1.75) * 0.216, want[2] = {3 * volume / 0.6 * 1.07, volume};
    o.f64 = true;
    assert_int_equal(slt_compile_string(source, "solid", &o, &p), SLT_OK);
    for (int i = 0; i < 2; i++) {
        SltJob job = SLT_JOB_INIT;
        SltIntegral out = SLT_INTEGRAL_INIT;
        SltStats s = SLT_STATS_INIT;
        double gradient[2], error[2];
        job.integral = true, job.threads = 2, job.estimator = SLT_EST_QUADRATURE;
        job.error = 1e-9, job.max_evaluations = (uint64_t)run[i].most;
        out.gradient = gradient, out.gradient_stderr = error;
        if (slt_grad_integral(p, &job, &out, &s, &err) != SLT_OK) fail_msg("%s", err.text);
        for (int k = 0; k < 2; k++)
            if (!(fabs(gradient[k] - want[k]) <= error[k] && error[k] <= run[i].bar * want[0]))
                fail_msg("%g evaluations: off by %g, stated %g", run[i].most, gradient[k] - want[k], error[k]);
        assert_int_equal(s.stopped, run[i].stop);
        if (s.left > 0 || (double)s.evaluations > 1.25 * run[i].most)
            fail_msg("%g evaluations: %g, left %g", run[i].most, (double)s.evaluations, s.left);
    }
    slt_program_free(p);
}

/* Where cells do not pay, SLT_EST_AUTO is the lattice, bit for bit: a march whose steps bounds cannot follow. */
static void auto_turns(void **state) {
    (void)state;
    static const char source[] =
        "param float r = 0.4; param float h = 0.3; [Domain(-1.0, 1.0)] shader float main(float2 x) { float t = 0.0; "
        "for (int i = 0; i < 40; i++) { float3 p = float3(x, t - 2.0); float d = min(length(p) - r, p.y + h + 0.1 * "
        "sin(9.0 * p.x) * sin(7.0 * p.z)); t += 0.7 * d; } [Disc] return t < 3.0 ? t : 0.0; }";
    for (int f64 = 0; f64 < 2; f64++) {
        SltOptions o = SLT_OPTIONS_INIT;
        SltJob job = SLT_JOB_INIT;
        SltError err = {0};
        double gradient[2][2], value[2];
        o.f64 = f64 != 0;
        job.integral = true, job.samples = 1 << 12, job.threads = 2;
        for (int i = 0; i < 2; i++) {
            SltProgram *p = NULL;
            SltIntegral out = SLT_INTEGRAL_INIT;
            SltStats stats = SLT_STATS_INIT;
            job.estimator = i ? SLT_EST_AUTO : SLT_EST_LATTICE;
            out.value = &value[i], out.gradient = gradient[i];
            assert_int_equal(slt_compile_string(source, "march", &o, &p), SLT_OK);
            if (slt_grad_integral(p, &job, &out, &stats, &err) != SLT_OK) fail_msg("%s", err.text);
            assert_false(stats.cells);
            slt_program_free(p);
        }
        assert_memory_equal(&value[1], &value[0], sizeof value[0]);
        assert_memory_equal(gradient[1], gradient[0], sizeof gradient[0]);
    }
}

/* By quadrature; error: absolute. */
static void integral_of(const char *source, bool f64, double error, SltIntegral *out) {
    SltOptions o = SLT_OPTIONS_INIT;
    o.f64 = f64;
    SltProgram *p = NULL;
    if (slt_compile_string(source, "integral", &o, &p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(p));
    SltJob job = SLT_JOB_INIT;
    job.integral = true, job.estimator = SLT_EST_QUADRATURE, job.abs_error = error;
    SltStats stats = SLT_STATS_INIT;
    SltError err = {0};
    if (slt_grad_integral(p, &job, out, &stats, &err) != SLT_OK) fail_msg("%s", err.text);
    slt_program_free(p);
}

/* Where three regions of a nearest seed meet, the g of the last one bends on the curve between the other two. */
static void three_regions(void **state) {
    (void)state;
    for (int turn = 0; turn < 12; turn++) {
        const double vertex[2] = {0.1, 0.05}, value[3] = {0, 1, 3}, angle[3] = {0.17, 1.9, 2.6};
        double at[3][2], want = 0;
        for (int i = 0; i < 3; i++) {
            double a = angle[i] + 0.5 * turn;
            at[i][0] = vertex[0] + 0.5 * cos(a), at[i][1] = vertex[1] + 0.5 * sin(a);
        }
        for (int i = 0; i < 3; i += 2) { /* the edges of region 1 move by w / (2 |p - q|) */
            double a = 0.5 * (angle[1] + angle[i]) + 0.5 * turn;
            double far = fmin(fabs(((cos(a) > 0 ? 1 : -1) - vertex[0]) / cos(a)),
                              fabs(((sin(a) > 0 ? 1 : -1) - vertex[1]) / sin(a)));
            want += (value[1] - value[i]) * far / (2 * hypot(at[1][0] - at[i][0], at[1][1] - at[i][1]));
        }
        char source[900];
        snprintf(source, sizeof source,
                 "param float w = 0.0; param float2 p[3] = {float2(%.17g, %.17g), float2(%.17g, %.17g), "
                 "float2(%.17g, %.17g)};\n" UNIT "shader float main(float2 x) { float best = 1e9, f = 0.0;\n"
                 "for (int i = 0; i < 3; i++) { float2 v = x - p[i]; float d = dot(v, v) - (i == 1 ? w : 0.0);\n"
                 "[Disc] if (d < best) { best = d; f = float(i == 2 ? 3 : i); } } return f; }",
                 at[0][0], at[0][1], at[1][0], at[1][1], at[2][0], at[2][1]);
        SltOptions o = SLT_OPTIONS_INIT;
        o.f64 = true;
        SltProgram *p = NULL;
        if (slt_compile_string(source, "three regions", &o, &p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(p));
        SltJob job = SLT_JOB_INIT;
        job.integral = true, job.estimator = SLT_EST_QUADRATURE, job.error = 1e-6;
        double g[7] = {0};
        SltIntegral out = {.struct_size = sizeof out, .gradient = g};
        SltStats stats = SLT_STATS_INIT;
        SltError err = {0};
        if (slt_grad_integral(p, &job, &out, &stats, &err) != SLT_OK) fail_msg("%s", err.text);
        if (!(fabs(g[0] - want) < 1e-6)) fail_msg("turn %d: %.12g, exact %.12g", turn, g[0], want);
        if (stats.left > 0 || stats.evaluations > 20000)
            fail_msg("turn %d: left %g, %llu evaluations", turn, stats.left, (unsigned long long)stats.evaluations);
        slt_program_free(p);
    }
}

/* Edges that are parallel to an axis but for a little, as those of a regular polygon written with cos and sin are: one
 * of the two axes is no axis to see them as a graph over. */
static void nearly_parallel(void **state) {
    static const double tilt[] = {0, 6e-17, 1e-14, 1e-12, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1};
    (void)state;
    for (int i = 0; i < 4 * (int)(sizeof tilt / sizeof *tilt); i++) {
        char source[400];
        bool f64 = i & 1, across = i & 2;
        double e = tilt[i / 4], c[3] = {0, across ? 1 : e, across ? e : 1};
        snprintf(source, sizeof source,
                 "param float r = 0.6;\n" UNIT "shader float main(float2 x) { "
                 "[Disc] return x.x * %.17g + x.y * %.17g < r ? 1.0 : 0.0; }",
                 c[1], c[2]);
        double gradient = 0, bar = 0;
        SltIntegral out = {.struct_size = sizeof out, .gradient = &gradient, .gradient_stderr = &bar};
        integral_of(source, f64, 0, &out);
        if (!(fabs(gradient - 2) <= 4 * bar + (f64 ? 1e-9 : 1e-5)) || !(bar < (f64 ? 1e-6 : 1e-3)))
            fail_msg("%g x + %g y, %s: %.12g +- %g, 2 is true", c[1], c[2], f64 ? "f64" : "f32", gradient, bar);
    }
}

static void regular_polygons(void **state) {
    (void)state;
    for (int n = 4; n <= 16; n += 4)
        for (int f64 = 0; f64 < 2; f64++) {
            char source[500];
            snprintf(source, sizeof source,
                     "param float r = 0.6;\n" UNIT "shader float main(float2 x) { bool out_of = false; for (int i = 0; "
                     "i < %d; i++) { float a = TAU * float(i) / %d.0; [Disc] if (dot(x, float2(cos(a), sin(a))) > r) "
                     "out_of = true; } return out_of ? 0.0 : 1.0; }",
                     n, n);
            double gradient = 0, bar = 0, want = 2 * n * 0.6 * tan(PI / n);
            SltIntegral out = {.struct_size = sizeof out, .gradient = &gradient, .gradient_stderr = &bar};
            integral_of(source, f64, 1e-5, &out);
            if (!(fabs(gradient - want) <= 4 * bar + (f64 ? 1e-9 : 1e-5)) || !(bar < 1e-4))
                fail_msg("%d sides, %s: %.12g +- %g, %.12g is true", n, f64 ? "f64" : "f32", gradient, bar, want);
        }
}

/* f is periodic and goes through whole periods: its integral stands still. Kinks, and the wrap of frac, lie in what is
 * left over; where the samples there fell the same in all cells, the error was thirty million times what was stated. */
static void hue_wheel(void **state) {
    (void)state;
    for (int i = 0; i < 8; i++) {
        char source[400];
        snprintf(source, sizeof source,
                 "param float r = %.17g;\n" UNIT "shader float main(float2 x) { float h = frac(x.x * 0.5 + 0.5 + r) * "
                 "6.0; return saturate(2.0 - abs(h - 2.0)) + 0.25 * saturate(2.0 - abs(h - 4.0)); }",
                 0.1 + 0.1 * i);
        double gradient = 0, bar = 0;
        SltIntegral out = {.struct_size = sizeof out, .gradient = &gradient, .gradient_stderr = &bar};
        integral_of(source, true, 1e-2, &out);
        if (!(fabs(gradient) <= 3 * bar + 1e-9) || !(bar < 0.02)) fail_msg("turn %d: %g +- %g", i, gradient, bar);
    }
}

/* A g that is flat on a side, and that no rule knows, leaves all of its curve over, or all of that side: what --error
 * asks for is out of reach, which one or two sweeps tell. Nothing may take as long as there are numbers. */
static void out_of_reach(void **state) {
    (void)state;
    static const struct {
        const char *g;
        double wanted, error;
        uint64_t most;
    } row[] = {{"v > 0.0 ? v * v : 0.0", 1e-5, 0.2, 20000000}, {"(v > 0.0 ? v : -v) + v", 1e-6, 3, 25000000}};
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
        SltOptions o = SLT_OPTIONS_INIT;
        o.f64 = true;
        SltProgram *p = NULL;
        char source[512];
        snprintf(source, sizeof source,
                 SHADER2("param float r = 0.5;", UNIT,
                         "float v = r * r - dot(x, x); float g = %s; [Disc] if (g > 0.0) return 1.0; return 0.0;"),
                 row[i].g);
        if (slt_compile_string(source, "flat", &o, &p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(p));
        SltJob job = SLT_JOB_INIT;
        job.integral = true, job.estimator = SLT_EST_QUADRATURE, job.error = row[i].wanted;
        double g = 0, error = 0;
        SltIntegral out = {.struct_size = sizeof out, .gradient = &g, .gradient_stderr = &error};
        SltStats stats = SLT_STATS_INIT;
        SltError err = {0};
        if (slt_grad_integral(p, &job, &out, &stats, &err) != SLT_OK) fail_msg("%s", err.text);
        if (stats.stopped != SLT_STOP_EVALUATIONS || stats.evaluations > row[i].most)
            fail_msg("%s: stopped %d, %llu evaluations", row[i].g, (int)stats.stopped,
                     (unsigned long long)stats.evaluations);
        if (!(fabs(g - PI) <= 2 * error) || !(error < row[i].error))
            fail_msg("%s: %.9g +- %.2g, exact %.9g", row[i].g, g, error, PI);
        slt_program_free(p);
    }
}

/* What is left over costs what it costs: a crossing here, or hundreds in one cell, some of them tied. However few
 * evaluations there are, what comes out is a number with a bar that holds. */
static void budget_of(SltProgram *p, SltEstimator estimator, uint64_t most, double want, double floor) {
    SltJob job = SLT_JOB_INIT;
    job.integral = true, job.samples = 1 << 18;
    job.estimator = estimator, job.error = 1e-9, job.max_evaluations = most;
    double g = NAN, error = NAN;
    SltIntegral out = {.struct_size = sizeof out, .gradient = &g, .gradient_stderr = &error};
    SltStats stats = SLT_STATS_INIT;
    SltError err = {0};
    if (slt_grad_integral(p, &job, &out, &stats, &err) != SLT_OK) fail_msg("%s", err.text);
    double spent = (double)stats.evaluations;
    print_message("%g of %g evaluations, %.6g +- %.2g\n", spent, (double)most, g, error);
    if (spent > fmax(floor, 1.02 * (double)most)) fail_msg("too many evaluations");
    if (!isfinite(g) || !(fabs(g - want) <= 2 * error)) fail_msg("%.9g is right", want);
    assert_int_equal(stats.stopped, SLT_STOP_EVALUATIONS);
}

static void budgets(void **state) {
    (void)state;
    static const struct {
        const char *source;
        double want;
    } row[] = {{SHADER2("param float r = 0.5;", UNIT,
                        "float v = r * r - dot(x, x); float g = v > 0.0 ? v * v : 0.0; [Disc] if (g > 0.0) return 1.0; "
                        "return 0.0;"),
                PI},
               {SHADER2("param float r = 0.5;", UNIT,
                        "float v = r * r - dot(x, x); float g = (v > 0.0 ? v : -v) + v; [Disc] if (g > 0.0) return "
                        "1.0; return 0.0;"),
                PI},
               {SHADER2("param float r = 0.2;", "",
                        "[Disc] float k = frac(200.0 * x.x); [Disc] if (k < r && x.y < 0.5 + 0.3 * x.x) return 1.0; "
                        "return 0.0;"),
                0.64955}};
    static const uint64_t most[] = {1, 100, 10000, 300000, 1000000};
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
        SltOptions o = SLT_OPTIONS_INIT;
        o.f64 = true;
        SltProgram *p = NULL;
        if (slt_compile_string(row[i].source, "budget", &o, &p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(p));
        for (size_t k = 0; k < sizeof most / sizeof *most; k++) {
            budget_of(p, SLT_EST_QUADRATURE, most[k], row[i].want, 100000);
            if (most[k] > 1) budget_of(p, SLT_EST_LATTICE, most[k], row[i].want, 100000);
        }
        slt_program_free(p);
    }
}

/* The halves of the disc's edge cancel: what --error asks for is beside them, not beside their sum. */
static void derivatives_of_0(void **state) {
    (void)state;
    SltOptions o = SLT_OPTIONS_INIT;
    o.f64 = true;
    SltProgram *p = NULL;
    const char *source =
        SHADER2("param float2 c = float2(0.1, 0.05);", UNIT, "[Disc] return length(x - c) < 0.5 ? 1.0 : 0.0;");
    if (slt_compile_string(source, "centre", &o, &p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(p));
    SltJob job = SLT_JOB_INIT;
    job.integral = true, job.estimator = SLT_EST_QUADRATURE, job.error = 1e-4;
    double g[2] = {0}, error[2] = {0};
    SltIntegral out = {.struct_size = sizeof out, .gradient = g, .gradient_stderr = error};
    SltStats stats = SLT_STATS_INIT;
    SltError err = {0};
    if (slt_grad_integral(p, &job, &out, &stats, &err) != SLT_OK) fail_msg("%s", err.text);
    if (stats.stopped != SLT_STOP_NONE || stats.evaluations > 6000)
        fail_msg("stopped %d, %llu evaluations", (int)stats.stopped, (unsigned long long)stats.evaluations);
    for (int i = 0; i < 2; i++)
        if (!(fabs(g[i]) <= error[i]) || !(error[i] < 1e-6)) fail_msg("%.3g +- %.2g, exact 0", g[i], error[i]);
    slt_program_free(p);
}

static void run_f32(void **state) { run(*state, false); }
static void run_f64(void **state) { run(*state, true); }

int main(void) {
    make_cases(), make_more();
    static struct CMUnitTest tests[256];
    static char names[256][96];
    int n = 0;
    for (int i = 0; i < ncases; i++)
        for (int f64 = 0; f64 < 2; f64++) {
            if ((cases[i].f64_only && !f64) || random_program(&cases[i]) || beyond(&cases[i], f64)) continue;
            snprintf(names[n], sizeof names[n], "%s, %s", cases[i].name, f64 ? "f64" : "f32");
            tests[n] = (struct CMUnitTest){names[n], f64 ? run_f64 : run_f32, NULL, NULL, &cases[i]};
            n++;
        }
    for (int i = 0; i < ncases; i++) {
        if (random_program(&cases[i]) || understated(&cases[i])) continue;
        snprintf(names[n], sizeof names[n], "%s, what is stated", cases[i].name);
        tests[n] = (struct CMUnitTest){names[n], stated, NULL, NULL, &cases[i]};
        n++;
    }
    tests[n++] = (struct CMUnitTest){"edges nearly parallel to an axis", nearly_parallel, NULL, NULL, NULL};
    tests[n++] = (struct CMUnitTest){"regular polygons", regular_polygons, NULL, NULL, NULL};
    tests[n++] = (struct CMUnitTest){"hue wheel", hue_wheel, NULL, NULL, NULL};
    tests[n++] = (struct CMUnitTest){"ends within", ends_within, NULL, NULL, NULL};
    tests[n++] = (struct CMUnitTest){"volume that is sampled", volume_that_is_sampled, NULL, NULL, NULL};
    tests[n++] = (struct CMUnitTest){"smooth solid", smooth_solid, NULL, NULL, NULL};
    tests[n++] = (struct CMUnitTest){"three regions", three_regions, NULL, NULL, NULL};
    tests[n++] = (struct CMUnitTest){"out of reach", out_of_reach, NULL, NULL, NULL};
    tests[n++] = (struct CMUnitTest){"budgets", budgets, NULL, NULL, NULL};
    tests[n++] = (struct CMUnitTest){"derivatives of 0", derivatives_of_0, NULL, NULL, NULL};
    tests[n++] = (struct CMUnitTest){"auto turns to the lattice", auto_turns, NULL, NULL, NULL};
    return _cmocka_run_group_tests("closed forms", tests, (size_t)n, NULL, NULL);
}
