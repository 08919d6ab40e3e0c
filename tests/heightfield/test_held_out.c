/* Gradients of terrain renderers that were written from the language's description alone, by someone who had not seen
 * the compiler: held_out.scenes. Reverse mode at 2^20 samples (2^18 where there are only shadows) and default settings,
 * within 1 % of the largest component of its kind, or four standard errors, of a central difference of the integral.
 *
 * The differences are listed with the scenes, each with its own error; SALTUS_LONG=1 makes them again, from values
 * alone, and compares. An integral of a terrain is only piecewise smooth in the heights: the error holds what
 * halving the step changed, and places where left and right differ are listed as such, with both slopes. Differences
 * known to less than half of what is allowed are not in the list. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "saltus/saltus.h"

enum { CHANNELS = 4, FILLS = 3, WIDE = 2048, ROWS = 64, DEEPEST = 26, PATTERNS = 2 };

typedef struct Fill {
    char name[32], kind[16];
    unsigned seed;
} Fill;

/* A component ("eye[2]", "h[3,4]": column and row) or a direction ("h~0": all of it, up or down at random). */
typedef struct Slope {
    char name[48];
    unsigned channel;
    double value, error, step; /* the central difference, how well it is known, and half its width */
    double left, right;        /* of a kink */
    bool kink, limit;          /* limit: known not to be given */
} Slope;

typedef struct Scene {
    char name[48], *source;
    Fill fill[FILLS];
    unsigned nfill, nslope;
    Slope *slope;
} Scene;

typedef struct Scenes {
    Scene *data;
    unsigned n;
} Scenes;

static uint32_t mix(uint32_t x, uint32_t y, uint32_t seed) {
    uint32_t h = x * 73856093u ^ y * 19349663u ^ (seed + 1) * 83492791u;
    h ^= h >> 16, h *= 0x7feb352du, h ^= h >> 15, h *= 0x846ca68bu;
    return h ^ h >> 16;
}
static double uniform(uint32_t x, uint32_t y, uint32_t seed) { return mix(x, y, seed) / 4294967296.0; }
static double fraction(double x) { return x - floor(x); }

/* ---- terrains */

static double bumps(double x, double y, uint32_t s) {
    double v = 0.02;
    for (uint32_t i = 0; i < 5; i++) {
        double dx = x - 0.15 - 0.7 * uniform(i, 0, s), dy = y - 0.15 - 0.7 * uniform(i, 1, s);
        double r = 0.08 + 0.1 * uniform(i, 2, s), a = 0.08 + 0.14 * uniform(i, 3, s);
        v += a * exp(-0.5 * (dx * dx + dy * dy) / (r * r));
    }
    return v;
}

static double hills(double x, double y, uint32_t s) {
    double v = 0.1;
    for (uint32_t o = 0; o < 6; o++) {
        double a = 6.28 * uniform(o, 0, s);
        v += 0.06 / (1 + o) * sin((3 + 2.5 * o) * (x * cos(a) + y * sin(a)) + 6.28 * uniform(o, 1, s));
    }
    return v;
}

/* Sample (i, j) of w x h, rows from the top, at (x, y). */
static double sample(const Fill *f, double x, double y, uint32_t i, uint32_t j, uint32_t w, uint32_t h) {
    const char *kind = f->kind;
    uint32_t s = f->seed;
    bool rim = i == 0 || j == 0 || i == w - 1 || j == h - 1;
    double start = floor(4 * uniform(0, 9, s));
    if (!strcmp(kind, "bumps")) return bumps(x, y, s);
    if (!strcmp(kind, "hills")) return hills(x, y, s);
    if (!strcmp(kind, "ridge"))
        return 0.14 * (1 - fabs(2 * fraction(2.4 * (0.8 * x + 0.3 * y) + uniform(0, 0, s)) - 1)) + 0.2 * bumps(x, y, s);
    if (!strcmp(kind, "steps")) return 0.07 * (floor(4 * uniform(0, 9, s) + 2.0 * x + 1.7 * y) - start) + 0.05;
    if (!strcmp(kind, "flat")) return 0.1;
    if (!strcmp(kind, "spike")) return i == w / 2 && j == h / 2 ? 0.4 : 0.05;
    if (!strcmp(kind, "spikes")) return 0.02 + (mix(i, j, s) % 37 == 0 ? 0.05 + 0.1 * uniform(i, j, s + 5) : 0);
    if (!strcmp(kind, "random")) return 0.2 * uniform(i, j, s);
    if (!strcmp(kind, "texture")) return uniform(i, j, s);
    if (!strcmp(kind, "rim")) return 0.05 * uniform(i, j, s) + (rim ? 0.15 : 0.02);
    if (!strcmp(kind, "tilt")) return 0.1 + 0.1 * x + 0.06 * y;
    if (!strcmp(kind, "pit")) return 0.3 * fmin(1, 2.2 * hypot(x - 0.5, y - 0.5));
    fail_msg("no terrain is called %s", kind);
    return 0;
}

static void fill(SltProgram *p, const Fill *f) {
    SltParam q = SLT_PARAM_INIT;
    SltError e = {0};
    if (slt_param_find(p, f->name, &q, &e)) fail_msg("%s", e.text);
    double *v = malloc(q.fcount * sizeof *v);
    assert_non_null(v);
    uint32_t channels = q.is_texture ? q.tex_c : 1, n = 0;
    for (uint32_t j = 0; j < q.tex_h; j++)
        for (uint32_t i = 0; i < q.tex_w; i++)
            for (uint32_t c = 0; c < channels; c++)
                v[n++] =
                    (float)sample(f, i / (q.tex_w - 1.0), 1 - j / (q.tex_h - 1.0), i, j + 1000 * c, q.tex_w, q.tex_h);
    assert_int_equal(n, q.fcount);
    assert_int_equal(slt_set_floats(p, q.fbase, n, v, NULL), SLT_OK);
    free(v);
}

/* ---- the file: "== name", "@ parameter terrain seed", the source, then the slopes:
 * "> name channel value error step", at a kink "! name channel left right step", "? ..." where we are known to differ
 */

static Scenes load(void) {
    FILE *f = fopen(SALTUS_TEST_DIR "/heightfield/held_out.scenes", "r");
    if (!f) fail_msg("held_out.scenes is not there");
    Scenes all = {0};
    Scene *s = NULL;
    char line[1024];
    while (fgets(line, sizeof line, f)) {
        if (!strncmp(line, "== ", 3)) {
            all.data = realloc(all.data, (all.n + 1) * sizeof *all.data);
            assert_non_null(all.data);
            s = &all.data[all.n++];
            memset(s, 0, sizeof *s);
            s->source = calloc(1, 8192);
            assert_non_null(s->source);
            assert_int_equal(sscanf(line + 3, "%47s", s->name), 1);
        } else if (!s) {
            continue; /* before the first: what the file is */
        } else if (line[0] == '@') {
            assert_true(s->nfill < FILLS);
            Fill *g = &s->fill[s->nfill++];
            assert_int_equal(sscanf(line + 1, "%31s %15s %u", g->name, g->kind, &g->seed), 3);
        } else if (line[0] && strchr(">!?", line[0])) {
            s->slope = realloc(s->slope, (s->nslope + 1) * sizeof *s->slope);
            assert_non_null(s->slope);
            Slope d = {.kink = line[0] == '!', .limit = line[0] == '?'};
            double *a = d.kink ? &d.left : &d.value, *b = d.kink ? &d.right : &d.error;
            assert_int_equal(sscanf(line + 1, "%47s %u %lf %lf %lf", d.name, &d.channel, a, b, &d.step), 5);
            assert_true(d.channel < CHANNELS);
            s->slope[s->nslope++] = d;
        } else {
            assert_true(strlen(s->source) + strlen(line) < 8192);
            strcat(s->source, line);
        }
    }
    fclose(f);
    return all;
}

static void scenes_free(Scenes *all) {
    for (unsigned i = 0; i < all->n; i++) free(all->data[i].source), free(all->data[i].slope);
    free(all->data);
}

static SltProgram *compile(const Scene *s, const char *source, bool f64) {
    SltOptions opt = SLT_OPTIONS_INIT;
    SltProgram *p;
    opt.stdlib_dir = SALTUS_STDLIB_BUILD, opt.f64 = f64, opt.no_cache = true;
    if (slt_compile_string(source, s->name, &opt, &p)) fail_msg("%s%s", slt_diagnostics_text(p), slt_last_error(p));
    for (unsigned i = 0; i < s->nfill; i++) fill(p, &s->fill[i]);
    return p;
}

/* The direction of a slope over the floats; the parameter it is of. */
static void direction(SltProgram *p, const char *name, double *dir, SltParam *par) {
    char base[48];
    unsigned a = 0, b = 0;
    size_t n = strcspn(name, "[~");
    snprintf(base, sizeof base, "%.*s", (int)n, name);
    SltError e = {0};
    if (slt_param_find(p, base, par, &e)) fail_msg("%s", e.text);
    memset(dir, 0, slt_float_count(p) * sizeof *dir);
    if (sscanf(name + n, "~%u", &a) == 1) {
        for (uint32_t i = 0; i < par->fcount; i++)
            dir[par->fbase + i] = (mix(i, a, 77) & 1 ? 1 : -1) / sqrt(par->fcount);
        return;
    }
    int found = sscanf(name + n, "[%u,%u]", &a, &b);
    assert_true(found >= 1);
    uint32_t at = found == 2 ? a + b * par->tex_w : a;
    assert_true(at < par->fcount);
    dir[par->fbase + at] = 1;
}

/* ---- the integral, from values alone
 *
 * Along lines through the domain, slanted so that no edge is met by all of them at once, a jump is found by bisection
 * to the last bits; what is smooth goes by Simpson's rule. So a difference of two integrals is a difference of places
 * of jumps, not a count of samples. The points come from a texture. */

typedef struct Wrapped {
    SltProgram *p;
    uint32_t dim, channels, points; /* points: first float of the texture */
    bool rand;
    double volume;
} Wrapped;

/* The scene with its points from a texture: x in [0, 1)^dim, and two numbers for a rand2() written in it. NULL where
 * random numbers are drawn elsewhere. */
static char *wrap(const char *source, bool *rand) {
    static const char *const no[] = {"rand()", "path_radiance", "slice_radiance", "camera_pixel"};
    for (unsigned i = 0; i < sizeof no / sizeof *no; i++)
        if (strstr(source, no[i])) return NULL;
    const char *shader = strstr(source, "shader "), *domain = strstr(source, "[Domain("),
               *entry = strstr(shader, " main(float");
    assert_true(shader && entry);
    char type[16], body[8192], lo[64] = "0.0", hi[64] = "1.0", vec[8];
    snprintf(type, sizeof type, "%.*s", (int)(entry - shader - 7), shader + 7);
    int dim = entry[11] == ' ' ? 1 : entry[11] - '0';
    snprintf(vec, sizeof vec, dim > 1 ? "float%d" : "float", dim);
    if (domain) {
        int depth = 0;
        const char *from = domain + 8, *at = from, *comma = NULL;
        for (; depth > 0 || *at != ')'; at++) {
            depth += (*at == '(') - (*at == ')');
            if (*at == ',' && !depth) comma = at;
        }
        snprintf(lo, sizeof lo, "%.*s", (int)(comma - from), from);
        snprintf(hi, sizeof hi, "%.*s", (int)(at - comma - 1), comma + 1);
    }
    const char *rest = strchr(entry, ')') + 1, *draw = strstr(rest, "rand2()");
    *rand = draw != NULL;
    if (draw) {
        if (strstr(draw + 1, "rand2()")) return NULL;
        snprintf(body, sizeof body, "%.*sdrawn%s", (int)(draw - rest), rest, draw + 7);
    } else snprintf(body, sizeof body, "%s", rest);
    char *out = malloc(16384);
    assert_non_null(out);
    snprintf(out, 16384,
             "%.*s%s scene(%s x, float2 drawn)%s\n[NoDiff] param texture2D points = zeros(%d, %d, 4);\n"
             "shader %s main(float2 y) {\n    float4 q = points.load(pixel());\n    %s lo = %s, hi = %s;\n"
             "    return scene(lo + (hi - lo) * q.%s, q.zw);\n}\n",
             (int)((domain ? domain : shader) - source), source, type, vec, body, WIDE, ROWS, type, vec, lo, hi,
             dim == 1   ? "x"
             : dim == 2 ? "xy"
                        : "xyz");
    return out;
}

static void evaluate(const Wrapped *w, const double *points, size_t n, double *out) {
    float *image = malloc(sizeof(float) * WIDE * ROWS * w->channels);
    double *padded = calloc((size_t)WIDE * ROWS * 4, sizeof *padded);
    assert_true(image && padded);
    for (size_t at = 0; at < n; at += (size_t)WIDE * ROWS) {
        size_t m = n - at < (size_t)WIDE * ROWS ? n - at : (size_t)WIDE * ROWS;
        SltJob job = SLT_JOB_INIT;
        SltError e = {0};
        job.spp = 1, job.size[0] = WIDE, job.size[1] = (uint32_t)((m + WIDE - 1) / WIDE);
        memcpy(padded, points + 4 * at, m * 4 * sizeof *padded);
        assert_int_equal(slt_set_floats(w->p, w->points, job.size[1] * WIDE * 4, padded, NULL), SLT_OK);
        if (slt_render(w->p, &job, image, NULL, &e)) fail_msg("%s", e.text);
        for (size_t i = 0; i < m * w->channels; i++) out[at * w->channels + i] = image[i];
    }
    free(image), free(padded);
}

typedef struct Piece {
    double a, b, fa[CHANNELS], fb[CHANNELS];
    unsigned line;
} Piece;

static void point(const Wrapped *w, double *q, unsigned line, double s, unsigned pattern) {
    static const double step[3] = {0.8191725133961645, 0.6710436067037893, 0.5497004779019703}; /* R3 */
    double b[3];
    for (unsigned i = 0; i < 3; i++)
        b[i] = fraction(line * (w->dim == 2 && !w->rand ? 0.6180339887498949 : step[i]) + uniform(pattern, i, 3));
    q[0] = s, q[1] = fraction(b[0] + 0.6180339887498949 * s);
    q[2] = w->dim == 3 ? fraction(b[1] + 0.41421356237 * s) : b[1], q[3] = b[2];
}

static void integrate(const Wrapped *w, const double *theta, uint32_t nfloats, unsigned pattern, double out[CHANNELS]) {
    unsigned lines = w->dim == 1 ? 1 : 512, parts = 512, ch = w->channels;
    size_t n = (size_t)lines * parts, nodes = (size_t)lines * (parts + 1);
    assert_int_equal(slt_set_floats(w->p, 0, nfloats, theta, NULL), SLT_OK);
    double *q = malloc(nodes * 4 * sizeof *q), *f = malloc(nodes * ch * sizeof *f), range[CHANNELS];
    Piece *piece = malloc(n * sizeof *piece);
    assert_true(q && f && piece);
    for (size_t i = 0; i < nodes; i++)
        point(w, q + 4 * i, (unsigned)(i / (parts + 1)), (double)(i % (parts + 1)) / parts, pattern);
    evaluate(w, q, nodes, f);
    for (unsigned c = 0; c < ch; c++) {
        double lo = f[c], hi = f[c];
        for (size_t i = 0; i < nodes; i++) lo = fmin(lo, f[i * ch + c]), hi = fmax(hi, f[i * ch + c]);
        range[c] = hi - lo, out[c] = 0;
    }
    for (size_t i = 0; i < n; i++) {
        unsigned line = (unsigned)(i / parts), at = (unsigned)(i % parts);
        piece[i] = (Piece){.a = (double)at / parts, .b = (at + 1.0) / parts, .line = line};
        for (unsigned c = 0; c < ch; c++)
            piece[i].fa[c] = f[(i + line) * ch + c], piece[i].fb[c] = f[(i + line + 1) * ch + c];
    }
    for (int depth = 0; n; depth++) {
        Piece *next = malloc(2 * n * sizeof *next);
        size_t m = 0;
        q = realloc(q, n * 4 * sizeof *q), f = realloc(f, n * ch * sizeof *f);
        assert_true(next && q && f);
        for (size_t i = 0; i < n; i++) point(w, q + 4 * i, piece[i].line, 0.5 * (piece[i].a + piece[i].b), pattern);
        evaluate(w, q, n, f);
        for (size_t i = 0; i < n; i++) {
            const Piece *x = &piece[i];
            const double *mid = f + i * ch, weight = (x->b - x->a) / lines * w->volume;
            bool jumps = false;
            for (unsigned c = 0; c < ch; c++) jumps |= fabs(mid[c] - 0.5 * (x->fa[c] + x->fb[c])) > 3e-4 * range[c];
            if (jumps && depth < DEEPEST) {
                Piece u = *x, v = *x;
                u.b = v.a = 0.5 * (x->a + x->b);
                for (unsigned c = 0; c < ch; c++) u.fb[c] = v.fa[c] = mid[c];
                next[m++] = u, next[m++] = v;
            } else
                for (unsigned c = 0; c < ch; c++)
                    out[c] += weight * (x->fa[c] + (jumps ? 1 : 4) * mid[c] + x->fb[c]) / (jumps ? 3 : 6);
        }
        free(piece), piece = next, n = m;
    }
    free(piece), free(q), free(f);
}

/* The largest slope listed of the same parameter. */
static double largest_listed(const Scene *s, const Slope *d) {
    size_t n = strcspn(d->name, "[~") + 1;
    double most = 0;
    for (unsigned i = 0; i < s->nslope; i++)
        if (s->slope[i].channel == d->channel && !strncmp(s->slope[i].name, d->name, n - 1))
            most = fmax(most, fabs(s->slope[i].value));
    return most;
}

/* The slope again, from the scene's values: whether it is what is listed. Two patterns say little of their spread, and
 * features thinner than a line's parts are missed: five per cent of it besides, and half a per cent of the largest. */
static bool difference(const Wrapped *w, const double *theta, const double *dir, uint32_t nfloats, const Slope *d,
                       const Scene *scene) {
    double at[PATTERNS], mean = 0, spread = 0, f[3][CHANNELS], *moved = malloc(nfloats * sizeof *moved);
    assert_non_null(moved);
    for (unsigned k = 0; k < PATTERNS; k++) {
        for (int side = -1; side <= 1; side += 2) {
            for (uint32_t i = 0; i < nfloats; i++) moved[i] = theta[i] + side * d->step * dir[i];
            integrate(w, moved, nfloats, k, f[side + 1]);
        }
        at[k] = (f[2][d->channel] - f[0][d->channel]) / (2 * d->step);
        mean += at[k] / PATTERNS;
    }
    for (unsigned k = 0; k < PATTERNS; k++) spread += (at[k] - mean) * (at[k] - mean) / (PATTERNS * (PATTERNS - 1));
    double listed = d->kink ? 0.5 * (d->left + d->right) : d->value,
           error = d->kink ? fabs(d->left - d->right) / 4 : d->error;
    free(moved);
    double besides = 0.05 * fabs(listed) + 0.005 * largest_listed(scene, d);
    if (fabs(mean - listed) <= 4 * (error + sqrt(spread)) + besides) return true;
    print_error("%s, %s: the difference is %g +- %g, listed is %g +- %g\n", scene->name, d->name, mean, sqrt(spread),
                listed, error);
    return false;
}

static unsigned differences(const Scene *s) {
    Wrapped w = {0};
    char *source = wrap(s->source, &w.rand);
    if (!source) return 0;
    unsigned bad = 0;
    SltProgram *plain = compile(s, s->source, false);
    double lo[3], hi[3];
    slt_domain(plain, lo, hi);
    w.dim = slt_dim(plain), w.volume = 1, w.channels = slt_channels(plain), w.p = compile(s, source, true);
    for (uint32_t i = 0; i < w.dim; i++) w.volume *= hi[i] - lo[i];
    SltParam q = SLT_PARAM_INIT;
    assert_int_equal(slt_param_find(w.p, "points", &q, NULL), SLT_OK);
    w.points = q.fbase;
    uint32_t n = slt_float_count(plain); /* the texture comes behind */
    assert_int_equal(w.points, n);
    double *theta = malloc(n * sizeof *theta), *dir = malloc(n * sizeof *dir);
    assert_true(theta && dir);
    memcpy(theta, slt_floats(w.p), n * sizeof *theta);
    for (unsigned i = 0; i < s->nslope; i++) {
        direction(plain, s->slope[i].name, dir, &q);
        bad += !difference(&w, theta, dir, n, &s->slope[i], s);
    }
    free(theta), free(dir), free(source);
    slt_program_free(w.p), slt_program_free(plain);
    return bad;
}

/* ---- the gradient */

static unsigned check(const Scene *s) {
    SltProgram *p = compile(s, s->source, false);
    uint32_t n = slt_float_count(p), ch = slt_channels(p);
    double *g = calloc(n * ch, sizeof *g), *se = calloc(n * ch, sizeof *se), *dir = calloc(n, sizeof *dir);
    assert_true(g && se && dir);
    SltIntegral out = {.struct_size = sizeof out, .gradient = g, .gradient_stderr = se};
    SltJob job = SLT_JOB_INIT;
    SltError e = {0};
    job.integral = true, job.spp = 0, job.size[0] = job.size[1] = job.size[2] = 1;
    /* Where there are shadows alone lines have no gaps: they cost more, and need not be as many. */
    job.samples = strstr(s->source, "trace(") ? 1u << 20 : 1u << 18;
    if (slt_grad_integral(p, &job, &out, NULL, &e)) fail_msg("%s: %s", s->name, e.text);
    unsigned bad = 0;
    for (unsigned k = 0; k < s->nslope; k++) {
        const Slope *d = &s->slope[k];
        const double *gc = g + (size_t)d->channel * n, *sc = se + (size_t)d->channel * n;
        SltParam q = SLT_PARAM_INIT;
        direction(p, d->name, dir, &q);
        double largest = 0, value = 0, variance = 0;
        for (uint32_t i = 0; i < q.fcount; i++) largest = fmax(largest, fabs(gc[q.fbase + i]));
        for (uint32_t i = 0; i < n; i++) value += dir[i] * gc[i], variance += dir[i] * dir[i] * sc[i] * sc[i];
        double allowed = fmax(0.01 * largest, 4 * sqrt(variance)), off;
        if (d->kink) /* one of the slopes, or between them */
            off = fmax(0, fmax(fmin(d->left, d->right) - value, value - fmax(d->left, d->right)));
        else off = fmax(0, fabs(value - d->value) - 2 * d->error);
        if (d->limit) {
            print_message("%s, %s: %g, difference %g: a limit\n", s->name, d->name, value, d->value);
        } else if (!(off <= allowed)) {
            print_error(
                "%s, %s, channel %u: %g, difference %g +- %g; 1 %% of the largest is %g, 4 standard errors %g\n",
                s->name, d->name, d->channel, value, d->kink ? 0.5 * (d->left + d->right) : d->value, d->error,
                0.01 * largest, 4 * sqrt(variance));
            bad++;
        }
    }
    free(g), free(se), free(dir);
    slt_program_free(p);
    return bad;
}

static void test_gradients(void **state) {
    (void)state;
    Scenes all = load();
    unsigned bad = 0, slopes = 0;
    for (unsigned i = 0; i < all.n; i++) bad += check(&all.data[i]), slopes += all.data[i].nslope;
    print_message("%u scenes, %u slopes\n", all.n, slopes);
    assert_true(all.n >= 20 && slopes >= 200);
    scenes_free(&all);
    assert_int_equal(bad, 0);
}

/* Those listed are what central differences give. */
static void test_differences(void **state) {
    (void)state;
    if (!getenv("SALTUS_LONG")) skip();
    Scenes all = load();
    unsigned bad = 0;
    for (unsigned i = 0; i < all.n; i++) bad += differences(&all.data[i]);
    scenes_free(&all);
    assert_int_equal(bad, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_gradients), cmocka_unit_test(test_differences)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
