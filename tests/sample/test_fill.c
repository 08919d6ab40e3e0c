/* Samples that vectors make have the bits of those that are made one by one, whatever the instruction set. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "layouts.h"
#include "runtime/sample/walk.h"

static uint32_t state;
static uint32_t word(void) { return state = state * 1664525u + 1013904223u, state ^ state >> 15; }
static uint64_t words(void) { return (uint64_t)word() << 32 | word(); }

enum { MOST = 300, ROOM = 8 * MOST + FILL_OVER };

typedef void Check(const Fill *f);
static void for_all(Check *check) {
    const Fill *all[3];
    for (uint32_t n = fill_all(all); n--;) state = 1, check(all[n]);
}

/* ---- words */
static void check_blocks(const Fill *f) {
    uint32_t lane[MOST + FILL_OVER] = {0}, want[4];
    uint64_t counter[MOST + FILL_OVER] = {0}, low[MOST + FILL_OVER], high[MOST + FILL_OVER];
    for (uint32_t n = 1; n <= MOST; n += 1 + n / 2) {
        uint32_t seed = word(), purpose = word() % 11;
        for (uint32_t i = 0; i < n; i++) lane[i] = i % 3 ? word() : 0, counter[i] = i % 2 ? words() : i;
        f->blocks(seed, purpose, n, lane, counter, (uint64_t *const[]){low, high});
        for (uint32_t i = 0; i < n; i++) {
            rng_block(seed, (RngPurpose)purpose, lane[i], counter[i], want);
            assert_int_equal(low[i], want[0] | (uint64_t)want[1] << 32);
            assert_int_equal(high[i], want[2] | (uint64_t)want[3] << 32);
        }
    }
}
static void test_blocks(void **unused) { (void)unused, for_all(check_blocks); }

static void check_streams(const Fill *f) {
    SltScene s = {.dim = 2, .uses_rand = true};
    for (uint32_t stride = 1; stride <= 4; stride += 3)
        for (uint32_t most = 1; most <= 20; most++) {
            Pattern p[9];
            uint32_t count[9];
            uint64_t owner[9], first[9];
            int32_t to[9 * 20];
            const FillStreams of = {.seed = word(), .lane = word() % 3, .stride = stride, .purpose = RNG_PIXEL};
            for (int r = 0; r < 9; r++) {
                owner[r] = words() >> 24, first[r] = r % 2 ? word() % 9 : 0, count[r] = 1 + word() % most;
                if (r == 8) first[r] = words() >> 20;
                pattern_init(&p[r], &s, of.seed, of.purpose, of.lane, owner[r]);
            }
            fill_streams(f, &of, 9, count, owner, first, to);
            for (int r = 0, at = 0; r < 9; r++)
                for (uint32_t i = 0; i < count[r]; i++)
                    assert_int_equal(to[at++], pattern_stream(&p[r], first[r] + i * stride));
        }
}
static void test_streams(void **unused) { (void)unused, for_all(check_streams); }

/* ---- rows */
static void check_spread(const Fill *f) {
    uint32_t count[MOST], value[MOST], to[ROOM];
    for (uint32_t most = 1; most <= 8; most++) {
        uint32_t step = most % 3;
        for (int r = 0; r < MOST; r++) count[r] = 1 + word() % most, value[r] = word();
        f->spread(MOST, count, value, step, to);
        for (uint32_t r = 0, at = 0; r < MOST; r++)
            for (uint32_t i = 0; i < count[r]; i++) assert_int_equal(to[at++], value[r] + i * step);
    }
}
static void test_spread(void **unused) { (void)unused, for_all(check_spread); }

/* Most runs are as long as those beside them. */
static void check_sums(const Fill *f) {
    static float narrow[40 * MOST];
    static double wide[40 * MOST];
    uint32_t count[MOST];
    double want[3 * MOST], sum[3 * MOST], other[3 * MOST];
    for (int i = 0; i < 40 * MOST; i++) wide[i] = narrow[i] = (float)ldexp((int32_t)word(), (int)(word() % 60) - 60);
    for (uint32_t k = 0; k < 78; k++) {
        const uint32_t most = 1 + k / 2, stride = k % 2 ? 3 : 1;
        for (int r = 0; r < MOST; r++) count[r] = word() % 16 ? most : 1 + word() % most;
        for (int i = 0; i < 3 * MOST; i++) want[i] = sum[i] = other[i] = i % 2 ? 0 : (int32_t)word();
        for (uint32_t r = 0, at = 0; r < MOST; r++)
            for (uint32_t i = 0; i < count[r]; i++) want[stride * r] += wide[at++];
        f->sum_f32(narrow, MOST, count, sum, stride), f->sum_f64(wide, MOST, count, other, stride);
        assert_memory_equal(sum, want, sizeof want);
        assert_memory_equal(other, want, sizeof want);
    }
}
static void test_sums(void **unused) { (void)unused, for_all(check_sums); }

/* ---- whole walks */
typedef struct Case {
    uint32_t dim, count, half, classes, pairs;
    bool rand, f64, centred, adjoint;
    SltFilter filter;
} Case;

typedef struct Expected {
    const Case *c;
    const Walk *k;
    Batch *b;
    uint32_t n, at, runs, left; /* lanes of the batch, the next one; runs that are over, samples left of this one */
} Expected;

static double number(const Batch *b, uint32_t slot, uint32_t i) {
    return b->f64 ? ((const double *)b->args.in[slot])[i] : (double)((const float *)b->args.in[slot])[i];
}
static int32_t integer(const Batch *b, uint32_t slot, uint32_t i) { return ((const int32_t *)b->args.in[slot])[i]; }
static double rounded(const Batch *b, double v) { return b->f64 ? v : (double)(float)v; }

static void expect_sample(Expected *e, const uint32_t cell[3], uint64_t pixel, const Pattern *p, uint32_t sample) {
    Batch *b = e->b;
    const Grid *g = b->grid;
    if (e->at == e->n) {
        e->n = walk_fill((Walk *)e->k, b), e->at = e->runs = 0, e->left = e->k->count[0];
        assert_true(e->n > 0);
    }
    uint32_t i = e->at++;
    for (uint32_t d = 0; d < g->dim; d++) {
        double want = e->c->centred ? grid_middle(g, d, cell[d]) : grid_place(g, d, cell[d], pattern_at(p, d, sample));
        assert_true(number(b, SLT_IN_X0 + d, i) == rounded(b, want));
    }
    assert_int_equal(integer(b, SLT_IN_PIXEL0, i), cell[0]);
    assert_int_equal(integer(b, SLT_IN_PIXEL1, i), g->n[1] - 1 - cell[1]);
    assert_int_equal(integer(b, SLT_IN_SAMPLE, i), sample);
    if (e->c->rand) {
        double rand0 = pattern_at(p, g->dim, sample);
        assert_int_equal(integer(b, SLT_IN_STREAM, i), pattern_stream(p, sample));
        assert_true(number(b, SLT_IN_RAND0, i) == rounded(b, rand0 < 0x1.fffffep-1 ? rand0 : 0x1.fffffep-1));
    }
    assert_int_equal(e->k->owner[e->runs], pixel);
    if (!--e->left && ++e->runs < e->k->runs) e->left = e->k->count[e->runs];
}

static void walk_against_loops(const Fill *f, const Case *c) {
    SltScene s = {.dim = c->dim, .channels = 1, .uses_rand = c->rand, .f64 = c->f64, .adj_lanes = 16};
    SltJob j = {.filter = c->filter, .centred = c->centred, .seed = word()};
    Run run = {.s = &s, .j = &j};
    const uint32_t size[3] = {37, c->dim > 1 ? 11 : 1, c->dim > 2 ? 5 : 1};
    float adjoint[37 * 11 * 5];
    for (uint32_t d = 0; d < c->dim; d++) s.lo[d] = -1.25 - d, s.hi[d] = 2.1 + d, j.size[d] = size[d];
    scene_outputs_init(&s);
    assert_int_equal(grid_init(&run.grid, &s, &j, NULL), SLT_OK);
    Batch b;
    assert_true(batch_init(&b, &s, &run.grid));
    b.fill = f;
    for (uint32_t i = 0; i < 37 * 11 * 5; i++) adjoint[i] = word() % 3 ? 1 : 0;
    Interior p = {.run = &run, .half = c->half, .count = c->count, .classes = c->classes, .parts_of.pairs = c->pairs};
    if (c->adjoint) p.adjoint = adjoint;
    TileRect t[2] = {{.lo = {0, 0, 0}, .n = {3, 1, 1}, .pixels = 3}, {.lo = {5, 0, 0}, .n = {32, 1, 1}}};
    if (c->dim > 1) t[0].n[1] = 4, t[1].lo[1] = 2, t[1].n[1] = 9;
    if (c->dim > 2) t[1].lo[2] = 1, t[1].n[2] = 4;
    for (uint32_t cls = 0; cls < c->classes; cls++) {
        Walk k;
        walk_begin(&k, &p, t, 2, cls);
        Expected e = {.c = c, .k = &k, .b = &b};
        for (int r = 0; r < 2; r++)
            for (uint32_t i = 0; i < t[r].n[0] * t[r].n[1] * t[r].n[2]; i++) {
                const uint32_t cell[3] = {t[r].lo[0] + i % t[r].n[0], t[r].lo[1] + i / t[r].n[0] % t[r].n[1],
                                          t[r].lo[2] + i / t[r].n[0] / t[r].n[1]};
                const uint64_t pixel = grid_index(&run.grid, cell[0], cell[1], cell[2]);
                Pattern pattern;
                pattern_init(&pattern, &s, j.seed, RNG_PIXEL, c->half, pixel);
                for (uint32_t n = 0; n < c->count; n++) {
                    uint32_t set = cell[0] + 2 * cell[1] + cell[2] + (c->pairs ? 0 : n);
                    if (c->classes > 1 && (set & (COSETS - 1)) != cls) continue;
                    if (c->adjoint && adjoint[pixel] == 0) continue;
                    expect_sample(&e, cell, pixel, &pattern, n);
                }
            }
        assert_int_equal(e.at, e.n);
        assert_int_equal(walk_fill(&k, &b), 0);
    }
    batch_free(&b), grid_free(&run.grid);
}

static void check_walks(const Fill *f) {
    static const uint32_t counts[] = {1, 2, 3, 4, 5, 16, 37};
    for (uint32_t i = 0; i < 3 * 7 * 3; i++) {
        Case c = {.dim = 1 + i % 3, .count = counts[i / 3 % 7], .classes = 1, .filter = (SltFilter)(i / 21)};
        walk_against_loops(f, &c);
        c.rand = true, c.half = 1 + i % 2, c.f64 = i % 4 == 1;
        walk_against_loops(f, &c);
        c.adjoint = true, c.classes = COSETS, c.f64 = i % 4 == 2, c.rand = i % 5 > 1;
        walk_against_loops(f, &c);
        c.pairs = COSETS;
        walk_against_loops(f, &c);
        c = (Case){.dim = c.dim, .count = 1, .classes = 1, .filter = c.filter, .centred = true, .rand = i % 2};
        walk_against_loops(f, &c);
    }
}
static void test_walks(void **unused) { (void)unused, for_all(check_walks); }

static void check_integrals(const Fill *f) {
    for (uint32_t i = 0; i < 12; i++) {
        SltScene s = {.dim = 1 + i % 3, .channels = 1, .uses_rand = i % 2, .f64 = i / 6, .adj_lanes = 16};
        SltJob j = {.integral = true};
        Grid g;
        Batch b;
        Pattern p;
        for (uint32_t d = 0; d < s.dim; d++) s.lo[d] = -0.7, s.hi[d] = 1.9 + d;
        scene_outputs_init(&s);
        assert_int_equal(grid_init(&g, &s, &j, NULL), SLT_OK);
        assert_true(batch_init(&b, &s, &g));
        b.fill = f;
        pattern_init(&p, &s, word(), RNG_INTEGRAL, 0, i);
        const uint64_t from = i % 4 ? words() >> 24 : 0;
        walk_integral(&b, &p, from, 1000 + i);
        for (uint32_t n = 0; n < 1000 + i; n++) {
            for (uint32_t d = 0; d < s.dim; d++) {
                double want = grid_place(&g, d, 0, pattern_at(&p, d, from + n));
                assert_true(number(&b, SLT_IN_X0 + d, n) == rounded(&b, want));
            }
            assert_int_equal(integer(&b, SLT_IN_SAMPLE, n), (int32_t)(from + n));
            if (s.uses_rand) assert_int_equal(integer(&b, SLT_IN_STREAM, n), pattern_stream(&p, from + n));
        }
        batch_free(&b), grid_free(&g);
    }
}
static void test_integrals(void **unused) { (void)unused, for_all(check_integrals); }

/* The byte that is not 0 lies anywhere, or nowhere: no more is told than the lines before it. */
static void check_zeros(const Fill *f) {
    enum { MOST = 3000 };
    unsigned char v[MOST] = {0};
    for (uint32_t i = 0; i < 4000; i++) {
        const uint64_t from = words() >> 60, bytes = (words() >> 32) % (MOST - 16), at = (words() >> 32) % MOST;
        v[at] = 1 + i % 255;
        const bool within = at >= from && at < from + bytes;
        assert_int_equal(f->zeros(v + from, bytes), within ? (at - from) / 64 * 64 : bytes);
        v[at] = 0;
    }
}
static void test_zeros(void **unused) { (void)unused, for_all(check_zeros); }

/* One number that is not finite, anywhere or nowhere, among finite ones up to the largest. */
static void check_finite(const Fill *f) {
    enum { MOST = 700 };
    static const double not_finite[] = {INFINITY, -INFINITY, NAN};
    for (uint32_t i = 0; i < 4000; i++) {
        float narrow[MOST];
        double wide[MOST];
        const uint32_t from = word() % 3, n = word() % (MOST - 3), at = word() % MOST;
        const bool within = at >= from && at < from + n;
        for (uint32_t k = 0; k < MOST; k++) {
            narrow[k] = k % 5 ? (float)rng_unit(word()) : k % 2 ? -FLT_MAX : FLT_MIN / 8;
            wide[k] = k % 5 ? rng_unit(word()) : k % 2 ? -DBL_MAX : DBL_MIN / 8;
        }
        wide[at] = not_finite[i % 3], narrow[at] = (float)wide[at];
        assert_int_equal(f->finite(narrow + from, n * sizeof *narrow, false), !within);
        assert_int_equal(f->finite(wide + from, n * sizeof *wide, true), !within);
    }
}
static void test_finite(void **unused) { (void)unused, for_all(check_finite); }

/* Sums and adjoints number by number, with a mask and without, of halves and of one image. */
static void check_residuals(const Fill *f) {
    enum { MOST = 100 };
    for (uint32_t k = 0; k < 400; k++) {
        float half[2][MOST], was[2][MOST], target[MOST], mask[MOST];
        const uint64_t n = words() % MOST;
        const bool masked = k & 1, halves = k & 2;
        const double numbers = 3 * (1 + words() % 1000);
        for (uint32_t i = 0; i < MOST; i++) {
            for (int h = 0; h < 2; h++) half[h][i] = was[h][i] = (float)rng_unit(word());
            target[i] = (float)rng_unit(word()), mask[i] = (float)rng_unit(word());
        }
        const double got = f->residuals(half[0], halves ? half[1] : NULL, target, masked ? mask : NULL, n, numbers);
        double sum = 0;
        for (uint32_t i = 0; i < MOST; i++) {
            const double m = masked ? (double)mask[i] : 1, a = (double)was[0][i] - (double)target[i],
                         b = halves ? (double)was[1][i] - (double)target[i] : a;
            const bool beyond = i >= n;
            if (!beyond) sum += m * a * b;
            assert_true(half[0][i] == (beyond ? was[0][i] : (float)(2 * m * b / numbers)));
            assert_true(half[1][i] == (beyond || !halves ? was[1][i] : (float)(2 * m * a / numbers)));
        }
        assert_true(got == sum);
    }
}
static void test_residuals(void **unused) { (void)unused, for_all(check_residuals); }

/* ---- roots: Chandrupatla's method one bracket at a time */
typedef struct Bracket {
    double x1, x2, x3, f1, f2, f3, tol, next;
    uint32_t left;
    bool exact;
} Bracket;

static double fraction(const Bracket *k, double width) {
    const double least = 0.75 * k->tol / width;
    if (least >= 0.5 || width > ldexp(1, k->left < 1023 ? (int)k->left : 1023) * k->tol) return 0.5;
    if (isinf(k->f1) || isinf(k->f2)) return 0.5;
    double t = 0.5;
    if (k->x3 == k->x2 || k->f3 == k->f2) {
        t = k->f1 / (k->f1 - k->f2);
    } else {
        double xi = (k->x1 - k->x2) / (k->x3 - k->x2), phi = (k->f1 - k->f2) / (k->f3 - k->f2);
        if (phi * phi < xi && (1 - phi) * (1 - phi) < 1 - xi)
            t = k->f1 / (k->f2 - k->f1) * k->f3 / (k->f2 - k->f3) +
                (k->x3 - k->x1) / (k->x2 - k->x1) * k->f1 / (k->f3 - k->f1) * k->f2 / (k->f3 - k->f2);
    }
    if (!isfinite(t)) t = 0.5;
    return t < least ? least : t > 1 - least ? 1 - least : t;
}

static bool step_bracket(Bracket *k) {
    const double width = fabs(k->x2 - k->x1);
    if (k->exact || width <= k->tol || !k->left) return false;
    k->next = k->x1 + fraction(k, width) * (k->x2 - k->x1);
    if (k->next == k->x1 || k->next == k->x2) return false;
    k->left--;
    return true;
}

static void take_bracket(Bracket *k, double g) {
    if (g == 0) {
        k->x1 = k->next, k->f1 = 0, k->exact = true;
        return;
    }
    if ((g < 0) == (k->f1 < 0)) k->x3 = k->x1, k->f3 = k->f1;
    else k->x3 = k->x2, k->f3 = k->f2, k->x2 = k->x1, k->f2 = k->f1;
    k->x1 = k->next, k->f1 = g;
}

/* Of straight, bent, flat and endless g, and of those that are 0 or NaN somewhere. */
static double g_of(uint32_t kind, double x) {
    switch (kind % 6) {
    case 0: return x - 0.3;
    case 1: return x * x * x - 0.1;
    case 2: return pow(x - 0.5, 5);
    case 3: return x < 0.4 ? -HUGE_VAL : x - 0.4;
    case 4: return x < 0.25 ? -1 : x < 0.6 ? 0 : 1;
    default: return x > 0.2 && x < 0.5 ? NAN : x - 0.35;
    }
}

static void check_roots(const Fill *f) {
    enum { MOST = 21 };
    static Roots r;
    for (uint32_t round = 0; round < 300; round++) {
        const uint32_t n = 1 + word() % MOST;
        const bool f64 = round & 1;
        Bracket want[MOST];
        bool going = true;
        for (uint32_t i = 0; i < n; i++) {
            const double a = 0.1 * rng_unit(word()), b = 1 - 0.1 * rng_unit(word());
            Bracket *k = &want[i];
            *k = (Bracket){.x1 = a, .x2 = b, .x3 = b, .f1 = g_of(i, a), .f2 = g_of(i, b), .f3 = g_of(i, b)};
            k->tol = ldexp(1, -(int)(word() % 40)), k->left = word() % 60, k->exact = word() % 8 == 0;
            r.x1[i] = k->x1, r.x2[i] = k->x2, r.x3[i] = k->x3, r.f1[i] = k->f1, r.f2[i] = k->f2, r.f3[i] = k->f3;
            r.tol[i] = k->tol, r.left[i] = k->left, r.exact[i] = -(int64_t)k->exact;
        }
        for (uint32_t steps = 0; going; steps++) {
            double g[MOST + FILL_OVER] = {0};
            float narrow[MOST + FILL_OVER] = {0};
            bool go[MOST];
            going = false;
            assert_true(steps < 100);
            f->roots_step(&r, n);
            for (uint32_t i = 0; i < n; i++) {
                go[i] = step_bracket(&want[i]), going |= go[i];
                assert_int_equal(r.go[i], -(int64_t)go[i]);
                if (go[i]) assert_true(r.next[i] == want[i].next);
                else want[i].next = r.next[i]; /* what is done is taken, too, here: its answer does not matter */
                g[i] = f64 ? g_of(i, want[i].next) : (double)(float)g_of(i, want[i].next), narrow[i] = (float)g[i];
            }
            f->roots_take(&r, n, f64 ? (const void *)g : narrow, f64);
            for (uint32_t i = 0; i < n; i++) {
                Bracket *k = &want[i];
                take_bracket(k, g[i]);
                assert_true(r.x1[i] == k->x1 && r.x2[i] == k->x2 && r.x3[i] == k->x3);
                assert_memory_equal(&r.f1[i], &k->f1, sizeof k->f1),
                    assert_memory_equal(&r.f2[i], &k->f2, sizeof k->f2);
                assert_memory_equal(&r.f3[i], &k->f3, sizeof k->f3);
                assert_true(r.left[i] == k->left && r.exact[i] == -(int64_t)k->exact);
            }
        }
    }
}
static void test_roots(void **unused) { (void)unused, for_all(check_roots); }

/* Of an image that is the same everywhere no image is needed: not a bit is another. */
static void test_gather(void **unused) {
    (void)unused;
    enum { SIDE = 9, CHANNELS = 3 };
    static const SltFilter filter[] = {SLT_FILTER_BOX, SLT_FILTER_TENT, SLT_FILTER_GAUSSIAN};
    for (uint32_t k = 0; k < 3; k++) {
        SltScene s = {.dim = 2, .channels = CHANNELS, .hi = {3, 1.7, 1}};
        SltJob j = SLT_JOB_INIT;
        SltError err;
        Grid g;
        j.size[0] = j.size[1] = SIDE, j.filter = filter[k];
        assert_int_equal(grid_init(&g, &s, &j, &err), SLT_OK);
        for (uint32_t i = 0; i < 1000; i++) {
            const float v = (float)rng_unit(word());
            const double x[3] = {3 * rng_unit(word()), 1.7 * rng_unit(word())};
            float image[SIDE * SIDE * CHANNELS];
            double want[CHANNELS], all = grid_gather_all(&g, v, x);
            for (uint32_t p = 0; p < SIDE * SIDE * CHANNELS; p++) image[p] = v;
            grid_gather(&g, image, CHANNELS, x, want);
            for (uint32_t c = 0; c < CHANNELS; c++) assert_true(all == want[c] && all > 0);
        }
        grid_free(&g);
    }
}

/* ---- the Gaussian filter */
/* The part of the filter up to where a sample lies is what it was drawn by, to the last places of what erf gives. */
static void test_gaussian(void **unused) {
    (void)unused;
    enum { MIDDLE = 8, PLACES = 100000 };
    SltScene s = {.dim = 1, .channels = 1, .hi = {1, 1, 1}};
    SltJob j = SLT_JOB_INIT;
    SltError err;
    Grid g;
    j.size[0] = 2 * MIDDLE + 1, s.hi[0] = 2 * MIDDLE + 1, j.filter = SLT_FILTER_GAUSSIAN;
    assert_int_equal(grid_init(&g, &s, &j, &err), SLT_OK);
    double worst = 0, last = -3;
    for (int i = 0; i <= PLACES; i++) {
        const double q = (double)i / PLACES, u = grid_place_filtered(&g, 0, MIDDLE, q) - (MIDDLE + 0.5),
                     part = 0.5 * (1 + erf(u * sqrt(2)) / erf(4 / sqrt(2)));
        assert_true(u >= last);
        worst = fmax(worst, fabs(part - q)), last = u;
    }
    assert_true(worst < 1e-15);
    grid_free(&g);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_blocks), cmocka_unit_test(test_streams), cmocka_unit_test(test_spread),
        cmocka_unit_test(test_sums),   cmocka_unit_test(test_walks),   cmocka_unit_test(test_integrals),
        cmocka_unit_test(test_zeros),  cmocka_unit_test(test_finite),  cmocka_unit_test(test_residuals),
        cmocka_unit_test(test_roots),  cmocka_unit_test(test_gather),  cmocka_unit_test(test_gaussian)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
