/* Derivatives of visible pieces against differences of the value, in f64 and f32, forwards and backwards; the same bits
 * of values whatever runs the program, of derivatives for any number of threads. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include <cmocka.h>

#include "saltus/saltus.h"
#include "tests/trimesh/scene.h"

enum { MOST_FLOATS = 3 * SCENE_VERTICES + SLT_BEAM_ROWS };

/* Everything a piece has, weighed by what differs between pieces. */
static const char everything[] =
    "    float sum = 0.0;\n"
    "    for (Piece q = m.first(b); q.found; q = m.next(q))\n"
    "        sum += q.area * (1.0 + 0.3 * float(q.tri % 5) + q.centre.x * 0.4 - q.centre.y + q.centre.x * q.centre.y\n"
    "                         + 0.2 * q.p.z + 0.1 * q.p.x * q.p.y + 0.5 * q.normal.x - 0.3 * q.normal.z);\n"
    "    return sum;\n";
static const char fixed_beam[] = "b.eye = eye; b.corner = corner; b.u = u; b.v = v;";
static const char beam_by_pixel[] =
    "b.eye = eye; b.corner = corner + x.x * u + x.y * v; b.u = u / 24.0; b.v = v / 24.0;";
static const char wide_beam[] = "b.eye = eye; b.corner = corner + 0.3 * (x.x * u + x.y * v); b.u = u; b.v = v;";

static void write_mesh(const Scene *s, char path[32]) {
    snprintf(path, 32, "pieces-%ld.obj", (long)getpid());
    FILE *f = fopen(path, "w");
    assert_non_null(f);
    for (uint32_t i = 0; i < s->nvertices; i++)
        fprintf(f, "v %.17g %.17g %.17g\n", s->at[i][0], s->at[i][1], s->at[i][2]);
    for (uint32_t i = 0; i < s->nfaces; i++)
        fprintf(f, "f %d %d %d\n", (int)s->face[i][0] + 1, (int)s->face[i][1] + 1, (int)s->face[i][2] + 1);
    assert_int_equal(fclose(f), 0);
}

static SltProgram *compile(const Scene *s, const char *beam, const char *body, const SltOptions *how) {
    SltOptions opt = *how;
    SltProgram *p;
    char path[32], source[4096];
    static const char *const name[] = {"eye", "corner", "u", "v"};
    write_mesh(s, path);
    int n = snprintf(source, sizeof source, "param mesh m = \"%s\";\n", path);
    for (int k = 0; k < 4; k++)
        n += snprintf(source + n, sizeof source - (size_t)n, "param float3 %s = float3(%.17g, %.17g, %.17g);\n",
                      name[k], s->beam[3 * k], s->beam[3 * k + 1], s->beam[3 * k + 2]);
    snprintf(source + n, sizeof source - (size_t)n, "shader float main(float2 x) {\n    Beam b; %s\n%s}\n", beam, body);
    opt.stdlib_dir = SALTUS_STDLIB_BUILD, opt.no_cache = true;
    SltStatus status = slt_compile_string(source, "t.salt", &opt, &p);
    assert_int_equal(remove(path), 0);
    if (status != SLT_OK) fail_msg("%s%s", slt_diagnostics_text(p), slt_last_error(p));
    return p;
}

static SltOptions precision(bool f64) {
    SltOptions opt = SLT_OPTIONS_INIT;
    opt.f64 = f64;
    return opt;
}

static double value_at(SltProgram *p, const double *floats) {
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    double out;
    job.floats = floats;
    if (slt_eval(p, &job, 1, (const double[]){0.5, 0.5}, NULL, &out, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
    return out;
}

static void gradient_at(SltProgram *p, const double *floats, double *gradient) {
    SltJob job = SLT_JOB_INIT;
    SltIntegral out = SLT_INTEGRAL_INIT;
    SltError err = {0};
    job.samples = 4, job.estimator = SLT_EST_LATTICE, job.floats = floats;
    out.gradient = gradient;
    if (slt_grad_integral(p, &job, &out, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
}

static void gradient_of(SltProgram *p, double *gradient) { gradient_at(p, NULL, gradient); }

/* Central, of the fourth order. */
static double difference(SltProgram *p, double *floats, uint32_t i, double step) {
    const double was = floats[i];
    double f[4];
    for (int k = 0; k < 4; k++) {
        floats[i] = was + step * (k < 2 ? k - 2 : k - 1);
        f[k] = value_at(p, floats);
    }
    floats[i] = was;
    return (f[0] - f[3] + 8 * (f[2] - f[1])) / (12 * step);
}

/* Largest |derivative - difference| over the largest |difference|; that in the eye, which is `far` away, times `far`.
 */
static double worst_far(const Scene *s, const char *body, double step, double far) {
    SltOptions opt = precision(true);
    SltProgram *p = compile(s, fixed_beam, body, &opt);
    const uint32_t n = slt_float_count(p);
    static double floats[MOST_FLOATS], gradient[MOST_FLOATS];
    assert_true(n <= MOST_FLOATS);
    memcpy(floats, slt_floats(p), n * sizeof *floats);
    gradient_of(p, gradient);
    double most = 0, scale = 0;
    for (uint32_t i = 0; i < n; i++) {
        const bool of_eye = i >= 3 * s->nvertices && i < 3 * s->nvertices + 3;
        const double by = of_eye ? far : 1, d = by * difference(p, floats, i, by * step);
        most = fmax(most, fabs(d - by * gradient[i])), scale = fmax(scale, fabs(d));
    }
    slt_program_free(p);
    assert_true(scale > 1e-3);
    return most / scale;
}

static double worst(const Scene *s, const char *body) { return worst_far(s, body, 2e-5, 1); }

static void test_differences(void **state) {
    (void)state;
    uint64_t seed = 11;
    for (uint32_t round = 0; round < 8; round++) {
        static Scene s;
        s = (Scene){0};
        scene_soup(&s, 3 + 2 * round, 1.6, &seed);
        scene_beam(&s, round % 4 == 3 ? 0 : 3, round % 4 == 2 ? 1 : -1,
                   round % 4 == 2 ? -2 : 2); /* 3: inside, 2: mirrored */
        double error = worst(&s, everything);
        if (!(error < 1e-8)) fail_msg("scene %u: %g", round, error);
    }
}

/* A tetrahedron and a triangle through it, from ever farther away. */
static void far_tetrahedron(Scene *s, double far) {
    static const int32_t face[4][3] = {{0, 1, 2}, {0, 3, 1}, {1, 3, 2}, {2, 3, 0}};
    static const double at[7][3] = {{0.197, 0.387, 0.472},  {0.708, 0.384, 0.676},  {-0.754, -0.055, 0.709},
                                    {0.238, 0.641, -0.619}, {-0.81, -0.65, -0.377}, {0.92, 0.13, 0.15},
                                    {-0.13, 0.87, 0.41}};
    *s = (Scene){0};
    for (int k = 0; k < 7; k++) scene_vertex(s, at[k][0], at[k][1], at[k][2]);
    for (int f = 0; f < 4; f++) scene_face(s, face[f][0], face[f][1], face[f][2]);
    scene_face(s, 4, 5, 6);
    const double beam[SLT_BEAM_ROWS] = {0.3 * far, -0.2 * far, -far, -1, -1, -0.5, 2, 0.1, 0, 0.05, 2, 0.2};
    memcpy(s->beam, beam, sizeof beam);
}

static const char areas[] =
    "    float sum = 0.0;\n"
    "    for (Piece q = m.first(b); q.found; q = m.next(q))\n"
    "        sum += q.area * (1.0 + 0.3 * float(q.tri % 5) + q.centre.x * 0.4 - q.centre.y + 0.5 * q.normal.x);\n"
    "    return sum;\n";

static void test_far_eye(void **state) {
    (void)state;
    static Scene s;
    for (int k = 1; k <= 9; k++) {
        const double far = pow(10, k);
        far_tetrahedron(&s, far);
        const double error = worst_far(&s, areas, 2e-4, far);
        if (getenv("SALTUS_PIECES_FAR")) printf("1e%d: %.2g\n", k, error);
        else if (!(error < 1e-9)) fail_msg("1e%d: %g", k, error);
    }
}

static void test_single(void **state) {
    (void)state;
    uint64_t seed = 12;
    static Scene s;
    s = (Scene){0};
    scene_soup(&s, 9, 1.6, &seed);
    scene_beam(&s, 3, -1, 2);
    static double wide[MOST_FLOATS], narrow[MOST_FLOATS];
    for (int f64 = 0; f64 < 2; f64++) {
        SltOptions opt = precision(f64);
        SltProgram *p = compile(&s, fixed_beam, everything, &opt);
        gradient_of(p, f64 ? wide : narrow);
        slt_program_free(p);
    }
    double most = 0, scale = 0;
    for (uint32_t i = 0; i < 3 * s.nvertices + SLT_BEAM_ROWS; i++)
        most = fmax(most, fabs(wide[i] - narrow[i])), scale = fmax(scale, fabs(wide[i]));
    if (!(most < 1e-4 * scale)) fail_msg("%g", most / scale);
}

/* ---- flat subdivision: an edge's line goes on along the next edge */

/* Linear in the centre, so that no subdivision changes the value. */
static const char linear[] = "    float sum = 0.0;\n"
                             "    for (Piece q = m.first(b); q.found; q = m.next(q))\n"
                             "        sum += q.area * (1.0 + 0.3 * float((q.tri / FACES) % 5) + q.centre.x * 0.4\n"
                             "                         - q.centre.y + 0.5 * q.normal.x - 0.3 * q.normal.z);\n"
                             "    return sum;\n";

static const char *linear_of(int faces, char body[1024]) {
    memcpy(body, linear, sizeof linear);
    memcpy(strstr(body, "FACES"), faces == 1 ? "    1" : faces == 4 ? "    4" : "   16", 5);
    return body;
}

static uint32_t gradient_of_linear(const Scene *s, int faces, double *gradient) {
    SltOptions opt = precision(true);
    char body[1024];
    SltProgram *p = compile(s, fixed_beam, linear_of(faces, body), &opt);
    const uint32_t n = slt_float_count(p);
    gradient_of(p, gradient);
    slt_program_free(p);
    return n;
}

static void test_subdivided(void **state) {
    (void)state;
    static Scene level[3];
    static int32_t between[2][SCENE_VERTICES][2];
    static double want[MOST_FLOATS], got[MOST_FLOATS];
    scene_ball_and_plate(&level[0]);
    const uint32_t n = gradient_of_linear(&level[0], 1, want);
    double scale = 0;
    for (uint32_t i = 0; i < n; i++) scale = fmax(scale, fabs(want[i]));
    for (int k = 1; k < 3; k++) {
        scene_subdivide(&level[k - 1], &level[k], between[k - 1]);
        gradient_of_linear(&level[k], k == 1 ? 4 : 16, got);
        if (k == 1) { /* a vertex between two edges that are one line moves them apart */
            double error = worst(&level[k], linear_of(4, (char[1024]){0}));
            if (!(error < 1e-6)) fail_msg("%g", error);
        }
        /* Back to the vertices that those of the finer mesh are made from. */
        for (int fine = k; fine > 0; fine--)
            for (uint32_t v = level[fine].nvertices; v-- > level[fine - 1].nvertices;)
                for (int a = 0; a < 3; a++) {
                    const int32_t *of = between[fine - 1][v - level[fine - 1].nvertices];
                    for (int i = 0; i < 2; i++) got[3 * of[i] + a] += 0.5 * got[3 * v + (uint32_t)a];
                }
        memmove(got + 3 * level[0].nvertices, got + 3 * level[k].nvertices, SLT_BEAM_ROWS * sizeof *got);
        for (uint32_t i = 0; i < n; i++)
            if (!(fabs(got[i] - want[i]) < 1e-6 * scale))
                fail_msg("level %d, component %u: %.12g, %.12g", k, i, got[i], want[i]);
    }
}

/* ---- triangles around the eye */

/* Linear in the centre, of one window or of its nine parts: the same sum. */
static const char of_parts[] =
    "    float sum = 0.0;\n"
    "    for (int j = 0; j < PARTS; j++)\n"
    "        for (int i = 0; i < PARTS; i++) {\n"
    "            b.corner = corner + (float(i) * u + float(j) * v) / PARTS.0; b.u = u / PARTS.0; b.v = v / PARTS.0;\n"
    "            for (Piece q = m.first(b); q.found; q = m.next(q))\n"
    "                sum += WHAT * (1.0 + 0.3 * float(q.tri)) / (PARTS.0 * PARTS.0);\n"
    "        }\n"
    "    return sum;\n";
static const char area_and_centre[] =
    "q.area * (1.0 + (float(i) + q.centre.x - 2.0 * (float(j) + q.centre.y)) / PARTS.0)";
static const char lit_area[] = "m.lit(q, float3(0.3, 0.2, -0.1))";

static SltProgram *compile_parts(const Scene *s, const char *what, int parts) {
    SltOptions opt = precision(true);
    char body[2048];
    size_t n = 0;
    for (const char *c = of_parts; *c; c++)
        if (strncmp(c, "WHAT", 4)) body[n++] = *c;
        else n += (size_t)sprintf(body + n, "%s", what), c += 3;
    body[n] = 0;
    for (char *c = body; (c = strstr(c, "PARTS"));)
        c[0] = (char)('0' + parts), memmove(c + 1, c + 5, strlen(c + 5) + 1);
    return compile(s, fixed_beam, body, &opt);
}

/* Lines of edges that end behind the eye go through a window and cut what hides them: what is on either side of the cut
 * moves alike, so that a window's derivative is the sum of those of its parts. */
static void parts_agree(const char *what, uint64_t seed, uint32_t rounds) {
    static Scene s;
    static double floats[MOST_FLOATS], whole[MOST_FLOATS], parts[MOST_FLOATS];
    uint32_t scenes = 0;
    s = (Scene){0};
    scene_soup(&s, 4, 1.6, &seed);
    scene_beam(&s, 0, -1, 2);
    SltProgram *one = compile_parts(&s, what, 1), *nine = compile_parts(&s, what, 3);
    const uint32_t n = slt_float_count(one), beam = 3 * s.nvertices;
    assert_true(n == slt_float_count(nine) && n <= MOST_FLOATS && n == beam + SLT_BEAM_ROWS);
    for (uint32_t round = 0; round < rounds; round++) {
        double most = 0, scale = 0;
        for (uint32_t i = 0; i < beam; i++) floats[i] = 3 * (scene_uniform(&seed) - 0.5);
        for (uint32_t a = 0; a < 3; a++) {
            floats[beam + SLT_BEAM_EYE + a] = scene_uniform(&seed) - 0.5;
            floats[beam + SLT_BEAM_U + a] = 2 * (scene_uniform(&seed) - 0.5);
            floats[beam + SLT_BEAM_V + a] = 2 * (scene_uniform(&seed) - 0.5);
        }
        for (uint32_t a = 0; a < 3; a++) /* a step before the eye, whose foot is in the window */
            floats[beam + SLT_BEAM_CORNER + a] = floats[beam + SLT_BEAM_EYE + a] + scene_uniform(&seed) - 0.5 -
                                                 0.5 * (floats[beam + SLT_BEAM_U + a] + floats[beam + SLT_BEAM_V + a]);
        gradient_at(one, floats, whole), gradient_at(nine, floats, parts);
        for (uint32_t i = 0; i < n; i++)
            most = fmax(most, fabs(whole[i] - parts[i])), scale = fmax(scale, fabs(whole[i]));
        if (!(most <= 1e-6 * scale + 1e-9)) fail_msg("%s, %u: %g of %g", what, round, most, scale);
        scenes += scale > 1e-2;
    }
    slt_program_free(one), slt_program_free(nine);
    assert_true(scenes > rounds / 2);
}

static void test_around_eye(void **state) {
    (void)state;
    parts_agree(area_and_centre, 16, 400);
    parts_agree(lit_area, 17, 200);
}

/* Of an edge with an end behind the eye, opposite a place of the window. */
static void test_opposite_end(void **state) {
    (void)state;
    static Scene s;
    static const double at[6][3] = {{-0.421, 0.29, 1.456},  {-0.077, 0.387, -1.941}, {-5.527, 4.614, -4.485},
                                    {1.273, -0.811, 0.641}, {-0.5, -0.205, 1.284},   {-1.629, 6.533, -3.697}};
    static const double beam[SLT_BEAM_ROWS] = {0, 0, 0, -0.5, -0.5, 1, 1, 0, 0, 0, 1, 0};
    s = (Scene){0};
    for (int k = 0; k < 6; k++) scene_vertex(&s, at[k][0], at[k][1], at[k][2]);
    scene_face(&s, 0, 1, 2), scene_face(&s, 3, 4, 5);
    memcpy(s.beam, beam, sizeof beam);
    const double error = worst(&s, everything);
    if (!(error < 1e-8)) fail_msg("%g", error);
}

/* Of an edge in parts, of which the first is out of the window that the light looks through: the next one's line. */
static void test_edge_from_outside(void **state) {
    (void)state;
    static Scene whole, s;
    static int32_t between[SCENE_VERTICES][2];
    static const double at[12][3] = {{-2.042, 1.175, -2.782}, {-1.72, 1.097, 3.265},   {-1.257, -1.232, -4.126},
                                     {2.55, -0.12, -1.928},   {-1.853, -0.348, 1.102}, {2.808, -0.085, -3.116},
                                     {-3.723, -1.873, 3.67},  {2.683, 0.438, 2.459},   {2.9, -0.628, -3.673},
                                     {-3.614, 1.435, 4.284},  {-2.455, 1.712, 0.675},  {-1.46, -1.029, -0.283}};
    static const double beam[SLT_BEAM_ROWS] = {-0.409, -0.603, 1.296,  -2.134, -0.124, -0.194,
                                               2.937,  0.35,   -0.317, 0.468,  -2.434, 1.645};
    whole = (Scene){0};
    for (int k = 0; k < 12; k++) scene_vertex(&whole, at[k][0], at[k][1], at[k][2]);
    for (int f = 0; f < 4; f++) scene_face(&whole, 3 * f, 3 * f + 1, 3 * f + 2);
    memcpy(whole.beam, beam, sizeof beam);
    scene_subdivide(&whole, &s, between);
    for (uint32_t f = 0; f < s.nfaces; f++) { /* which corner is first decides which edges cut */
        const int32_t *face = s.face[f], turned[3][3] = {{face[0], face[1], face[2]},
                                                         {face[2], face[0], face[1]},
                                                         {face[1], face[2], face[0]}};
        if (f % 4 < 3) memcpy(s.face[f], turned[f % 4], sizeof turned[0]);
    }
    const double error = worst(&s, "    float sum = 0.0;\n"
                                   "    for (Piece q = m.first(b); q.found; q = m.next(q))\n"
                                   "        sum += m.lit(q, float3(0.3, 0.6, -0.7)) * (1.0 + 0.3 * float(q.tri / 4));\n"
                                   "    return sum;\n");
    if (!(error < 1e-6)) fail_msg("%g", error);
}

/* ---- what runs it */

enum { SIZE = 24 };

static void image_and_gradient(SltProgram *p, uint32_t threads, float *image, double *gradient) {
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    static float ones[SIZE * SIZE];
    for (int i = 0; i < SIZE * SIZE; i++) ones[i] = 1 + 0.01f * (float)i;
    job.size[0] = job.size[1] = SIZE, job.spp = 1, job.threads = threads, job.centred = true;
    job.estimator = SLT_EST_LATTICE;
    if (slt_render(p, &job, image, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
    if (slt_grad_adjoint(p, &job, ones, gradient, NULL, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
}

static void test_same_bits(void **state) {
    (void)state;
    uint64_t seed = 13;
    static Scene s;
    s = (Scene){0};
    scene_soup(&s, 40, 0.9, &seed);
    scene_beam(&s, 3, -1, 2);
    for (int f64 = 0; f64 < 2; f64++) {
        static float image[2][SIZE * SIZE];
        static double gradient[2][MOST_FLOATS];
        static const uint32_t width[] = {1, 4, 8, 16, 32, 64, 16};
        for (uint32_t k = 0; k < 7; k++) {
            SltOptions opt = precision(f64);
            opt.width = width[k], opt.interpret = k == 6;
            SltProgram *p = compile(&s, beam_by_pixel, everything, &opt);
            const size_t n = slt_float_count(p) * sizeof(double);
            image_and_gradient(p, 1, image[k > 0], gradient[0]);
            assert_memory_equal(image[0], image[k > 0], sizeof image[0]);
            for (uint32_t threads = 2; threads <= 7 && k == 4; threads++) {
                image_and_gradient(p, threads, image[1], gradient[1]);
                assert_memory_equal(image[0], image[1], sizeof image[0]);
                assert_memory_equal(gradient[0], gradient[1], n);
            }
            slt_program_free(p);
        }
    }
}

/* In the vertices alone, pieces of all lanes run together, of many those that come next, and so do their sides; and
 * those side by side that see one triangle are added up. */
static void test_widths(void **state) {
    (void)state;
    uint64_t seed = 15;
    static Scene s;
    s = (Scene){0};
    scene_soup(&s, 40, 0.9, &seed);
    scene_beam(&s, 3, -1, 2);
    for (int of = 0; of < 4; of++) {
        const bool f64 = of & 1, many = of & 2;
        static float image[SIZE * SIZE];
        static double gradient[2][MOST_FLOATS];
        static const uint32_t width[] = {16, 1, 4, 8, 16, 32, 64};
        for (uint32_t k = 0; k < 7; k++) {
            SltOptions opt = precision(f64);
            opt.width = width[k], opt.interpret = k == 0;
            SltProgram *p = compile(&s, many ? wide_beam : beam_by_pixel, everything, &opt);
            SltError err = {0};
            if (slt_wrt(p, (const char *[]){"m"}, 1, &err) != SLT_OK) fail_msg("%s", err.text);
            image_and_gradient(p, 1, image, gradient[k > 0]);
            double most = 0;
            for (uint32_t i = 0; i < slt_float_count(p); i++) most = fmax(most, fabs(gradient[0][i]));
            assert_true(most > 0);
            for (uint32_t i = 0; i < slt_float_count(p) && k; i++)
                if (!(fabs(gradient[0][i] - gradient[1][i]) <= (f64 ? 1e-12 : 1e-5) * most))
                    fail_msg("width %u, %u: %.17g, interpreter %.17g", width[k], i, gradient[1][i], gradient[0][i]);
            slt_program_free(p);
        }
    }
}

static void test_forwards(void **state) {
    (void)state;
    uint64_t seed = 14;
    static Scene s;
    s = (Scene){0};
    scene_soup(&s, 30, 0.9, &seed);
    scene_beam(&s, 3, -1, 2);
    SltOptions opt = precision(true);
    SltProgram *p = compile(&s, beam_by_pixel, everything, &opt);
    static float image[SIZE * SIZE], tangent[SIZE * SIZE];
    static double gradient[MOST_FLOATS], direction[MOST_FLOATS];
    image_and_gradient(p, 2, image, gradient);
    double backwards = 0, forwards = 0, size = 0;
    for (uint32_t i = 0; i < slt_float_count(p); i++)
        direction[i] = scene_uniform(&seed) - 0.5, backwards += gradient[i] * direction[i];
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    job.size[0] = job.size[1] = SIZE, job.spp = 1, job.centred = true, job.estimator = SLT_EST_LATTICE;
    if (slt_grad_images(p, &job, 1, (const double *[]){direction}, (float *[]){tangent}, NULL, NULL, &err) != SLT_OK)
        fail_msg("%s", err.text);
    for (int i = 0; i < SIZE * SIZE; i++) {
        double part = (1 + 0.01f * (float)i) * (double)tangent[i];
        forwards += part, size += fabs(part);
    }
    if (!(fabs(forwards - backwards) < 1e-6 * size)) fail_msg("%.17g %.17g", forwards, backwards);
    slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_differences),  cmocka_unit_test(test_far_eye),
                                       cmocka_unit_test(test_single),       cmocka_unit_test(test_subdivided),
                                       cmocka_unit_test(test_same_bits),    cmocka_unit_test(test_widths),
                                       cmocka_unit_test(test_forwards),     cmocka_unit_test(test_around_eye),
                                       cmocka_unit_test(test_opposite_end), cmocka_unit_test(test_edge_from_outside)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
