/* Kernels with the lists that `bounds` makes, down a tree of boxes, against kernels without: f and its derivatives have
 * the same bits at every point of the box; `bounds` itself says the same of f, and keeps no more open. Of a loop that
 * keeps the iteration with the least key lists lack those that took over and were not the last: `bounds` then knows
 * better, and an iteration takes over wherever it did.
 *
 *   test-kernels-lists [rounds]    rounds: ways down the tree a program, 2 by default */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bindings/c/api.h"
#include "runtime/quadrature/lists.h"

enum { SIDE = 4, BOXES = 16, DEPTH = 6, POINTS = 48, FLOATS = 4096 };

static uint32_t rounds = 2;

typedef struct Case {
    const char *name;
    SltProgram *p;
    Batch b;
    Lists lists;
    uint64_t random;
    double length; /* of lists where the ways end, in parts of all iterations */
    uint32_t ends;
} Case;

typedef struct Box {
    double lo[3], hi[3];
} Box;

static double unit(Case *t) {
    t->random = t->random * 6364136223846793005ull + 1442695040888963407ull;
    return (double)(t->random >> 11) * 0x1p-53;
}

static double rounded(const Case *t, double v) { return t->b.f64 ? v : (double)(float)v; }

static void set_boxes(Case *t, const Box *q) {
    for (uint32_t i = 0; i < BOXES; i++)
        for (uint32_t d = 0; d < t->p->scene.dim; d++)
            batch_set(&t->b, SLT_IN_X0 + d, i, q[i].lo[d]), batch_set(&t->b, SLT_IN_H0 + d, i, q[i].hi[d]);
}

static void set_points(Case *t, const Box *q) {
    for (uint32_t i = 0; i < POINTS; i++) {
        for (uint32_t d = 0; d < t->p->scene.dim; d++) {
            double v = q->lo[d] + (i < 4 ? (double)(i >> d & 1) : unit(t)) * (q->hi[d] - q->lo[d]);
            batch_set(&t->b, SLT_IN_X0 + d, i, fmin(fmax(rounded(t, v), q->lo[d]), q->hi[d]));
        }
        for (uint32_t c = 0; c < t->p->scene.channels; c++) batch_set(&t->b, SLT_IN_SEED0 + c, i, 0.5 + 0.01 * i);
        batch_set_stream(&t->b, i, (int32_t)i, 0.3);
    }
}

/* All outputs of a kernel, and what it adds to the adjoints. */
typedef struct Results {
    double out[SLT_OUT_MAX][POINTS], adj[FLOATS];
} Results;

enum { INT, FLT };
static const bool is_float[SLT_ROLES] = {
#define SLT_ROLE(id, text, type, ...) type,
#include "saltus/kernel.def"
};

static void run(Case *t, SltKernelKind kind, uint32_t n, const SltCullList *cull, Results *r) {
    static _Alignas(64) double sums[FLOATS * 64];
    static uint32_t log_index[1 << 16];
    static double log_value[1 << 16];
    const SltScene *s = &t->p->scene;
    memset(r, 0, sizeof *r);
    memset(sums, 0, sizeof sums);
    const SltCullList *before = t->b.args.cull;
    t->b.args.cull = cull, t->b.args.adj = sums;
    t->b.args.log_index = log_index, t->b.args.log_value = log_value;
    t->b.args.log_len = 0, t->b.args.log_cap = (1 << 16) - SLT_PAD;
    batch_call(&t->b, kind, n);
    t->b.args.cull = before;
    assert_true(t->b.args.log_len <= t->b.args.log_cap);
    uint32_t lanes = s->adj_lanes;
    for (uint32_t f = 0; kind == SLT_K_VJP && f < s->nfloats * lanes; f++)
        r->adj[f / lanes] += s->f64 ? sums[f] : (double)((float *)sums)[f];
    for (uint64_t k = 0; k < t->b.args.log_len; k++)
        r->adj[log_index[k]] += s->f64 ? log_value[k] : (double)((float *)log_value)[k];
    for (uint32_t role = 0; role < SLT_ROLES; role++)
        for (uint32_t k = 0; k < s->layout[kind].out[role].count; k++)
            for (uint32_t i = 0; i < n; i++)
                r->out[s->layout[kind].out[role].first + k][i] =
                    is_float[role] ? batch_get(&t->b, (SltRole)role, k, i)
                                   : (double)batch_get_int(&t->b, (SltRole)role, k, i);
}

static double out(const Case *t, const Results *r, SltKernelKind kind, SltRole role, uint32_t k, uint32_t i) {
    return r->out[t->p->scene.layout[kind].out[role].first + k][i];
}

static bool same(double a, double b) { return a == b || (isnan(a) && isnan(b)); }

static void check_points(Case *t, const Box *q) {
    static Results with, without;
    const SltScene *s = &t->p->scene;
    set_points(t, q);
    for (int pass = 0; pass < 2; pass++) {
        SltKernelKind kind = pass ? SLT_K_VJP : SLT_K_VALUE;
        if (!s->kernel[kind]) continue;
        run(t, kind, POINTS, t->b.args.cull, &with);
        run(t, kind, POINTS, NULL, &without);
        for (uint32_t c = 0; c < s->channels; c++)
            for (uint32_t i = 0; i < POINTS; i++)
                if (!same(out(t, &with, kind, SLT_OUT_F, c, i), out(t, &without, kind, SLT_OUT_F, c, i)))
                    fail_msg("%s: %s is %.17g with lists, %.17g without", t->name, pass ? "vjp" : "value",
                             out(t, &with, kind, SLT_OUT_F, c, i), out(t, &without, kind, SLT_OUT_F, c, i));
        for (uint32_t f = 0; pass && f < s->nfloats; f++)
            if (!same(with.adj[f], without.adj[f]))
                fail_msg("%s: derivative %u is %.17g with lists, %.17g without", t->name, f, with.adj[f],
                         without.adj[f]);
    }
}

/* Points that were in one piece still are. */
static void check_regions(Case *t, const Box *q) {
    static Results with, without;
    if (!t->p->scene.kernel[SLT_K_REGION]) return;
    set_points(t, q);
    run(t, SLT_K_REGION, POINTS, t->b.args.cull, &with);
    run(t, SLT_K_REGION, POINTS, NULL, &without);
    const double *a = with.out[t->p->scene.layout[SLT_K_REGION].out[SLT_OUT_HASH].first],
                 *b = without.out[t->p->scene.layout[SLT_K_REGION].out[SLT_OUT_HASH].first];
    for (uint32_t i = 0; i < POINTS; i++)
        for (uint32_t j = 0; j < i; j++)
            if (b[i] == b[j] && a[i] != a[j]) fail_msg("%s: a list makes two pieces of one", t->name);
}

/* The events that `bounds` has told of a box. */
static uint32_t told_events(const Case *t, uint32_t box, Event *e) {
    const SltScene *s = &t->p->scene;
    if (!scene_outputs(s, SLT_K_BOUNDS, SLT_OUT_OPEN)) return 0;
    uint32_t n = (uint32_t)batch_get_int(&t->b, SLT_OUT_OPEN, 0, box),
             told = scene_outputs(s, SLT_K_BOUNDS, SLT_OUT_OPEN_EDGE);
    uint32_t depth = scene_outputs(s, SLT_K_BOUNDS, SLT_OUT_OPEN_K) / told;
    if (n > told) n = 0;
    for (uint32_t i = 0; i < n; i++) {
        e[i] = (Event){.site = batch_get_int(&t->b, SLT_OUT_OPEN_EDGE, i, box)};
        for (uint32_t d = 0; d < depth; d++) e[i].k[d] = batch_get_int(&t->b, SLT_OUT_OPEN_K, i * depth + d, box);
    }
    return n;
}

/* g of an event, of one that needs what the loop carries too: NaN where the loop does not come to it. */
static void check_event(Case *t, const Box *q, const Event *e) {
    static Results with, without;
    const SltScene *s = &t->p->scene;
    if (!s->kernel[SLT_K_EDGE]) return;
    set_points(t, q);
    t->b.args.site = e->site;
    for (uint32_t i = 0; i < POINTS; i++)
        for (uint32_t d = 0; d < SLT_MAX_K; d++) batch_set_int(&t->b, SLT_IN_K0 + d, i, e->k[d]);
    run(t, SLT_K_EDGE, POINTS, t->b.args.cull, &with);
    run(t, SLT_K_EDGE, POINTS, NULL, &without);
    for (uint32_t i = 0; i < POINTS; i++)
        for (uint32_t d = 0; d <= s->dim; d++) {
            double a = out(t, &with, SLT_K_EDGE, d ? SLT_OUT_G_DX : SLT_OUT_G, d ? d - 1 : 0, i),
                   b = out(t, &without, SLT_K_EDGE, d ? SLT_OUT_G_DX : SLT_OUT_G, d ? d - 1 : 0, i);
            int takes = s->edge_argmin ? s->edge_argmin[e->site] : 0;
            if (takes && (d || !(takes * b > 0) || takes * a > 0)) continue;
            if (!same(a, b)) fail_msg("%s: g is %.17g with lists, %.17g without", t->name, a, b);
        }
}

/* Two bits that the state may have; more open with a list would be a contradiction. */
static void check_boxes(Case *t) {
    static Results with, without;
    const SltScene *s = &t->p->scene;
    run(t, SLT_K_BOUNDS, BOXES, NULL, &without);
    t->b.args.note = NULL;
    run(t, SLT_K_BOUNDS, BOXES, t->b.args.cull, &with);
    bool open = scene_outputs(s, SLT_K_BOUNDS, SLT_OUT_OPEN);
    for (uint32_t i = 0; i < BOXES; i++) {
        for (uint32_t c = 0; c < s->channels; c++)
            for (int end = 0; end < 2; end++) {
                SltRole role = end ? SLT_OUT_F_HI : SLT_OUT_F_LO;
                double a = out(t, &with, SLT_K_BOUNDS, role, c, i), b = out(t, &without, SLT_K_BOUNDS, role, c, i);
                if (s->edge_argmin && (end ? a < b : a > b)) continue;
                if (!same(a, b)) fail_msg("%s: a bound of f is %.17g with lists, %.17g without", t->name, a, b);
            }
        uint32_t a = (uint32_t)out(t, &with, SLT_K_BOUNDS, SLT_OUT_BOX_STATE, 0, i),
                 b = (uint32_t)out(t, &without, SLT_K_BOUNDS, SLT_OUT_BOX_STATE, 0, i);
        if (a & ~b) fail_msg("%s: state %u with lists, %u without", t->name, a, b);
        if (!open) continue;
        double few = out(t, &with, SLT_K_BOUNDS, SLT_OUT_OPEN, 0, i),
               n = out(t, &without, SLT_K_BOUNDS, SLT_OUT_OPEN, 0, i);
        if (n <= SLT_MAX_OPEN && few > n) fail_msg("%s: %g are open with lists, %g without", t->name, few, n);
    }
}

static void walk_down(Case *t, const Box *domain) {
    const SltScene *s = &t->p->scene;
    Box q = *domain;
    t->b.args.cull = NULL;
    lists_enter(&t->lists, &t->b, lists_begin(&t->lists, &t->b));
    for (int depth = 0; depth < DEPTH; depth++) {
        Box box[BOXES];
        for (uint32_t i = 0; i < BOXES; i++)
            for (uint32_t d = 0; d < s->dim; d++) {
                double side = (q.hi[d] - q.lo[d]) / SIDE, lo = q.lo[d] + (d ? i / SIDE : i % SIDE) * side;
                box[i].lo[d] = fmin(fmax(rounded(t, lo), q.lo[d]), q.hi[d]);
                box[i].hi[d] = fmin(rounded(t, lo + side), q.hi[d]);
            }
        set_boxes(t, box);
        if (depth) check_boxes(t);
        assert_true(lists_note(&t->lists, &t->b));
        batch_call(&t->b, SLT_K_BOUNDS, BOXES);
        Event event[SLT_MAX_OPEN];
        uint32_t into = (uint32_t)(unit(t) * BOXES), told = told_events(t, into, event);
        assert_true(lists_split(&t->lists, &t->b, BOXES, UINT64_MAX));
        /* Of events with the list by which they were found: where nothing changes whichever way one goes, the box's own
         * list can do without it. */
        for (uint32_t e = 0; e < told; e++) check_event(t, &box[into], &event[e]);
        lists_enter(&t->lists, &t->b, lists_of(&t->lists, into));
        q = box[into];
        check_points(t, &q);
        check_regions(t, &q);
    }
    uint64_t left = 0, all = 0;
    for (uint32_t i = 0; i < s->nlists; i++) left += (uint64_t)t->b.args.cull[i].count, all += s->list_count[i];
    t->length += (double)left / (double)all, t->ends++;
}

/* most: how long lists may be where the ways end, in parts of all iterations. */
static void check_lists(const char *name, const char *source, double most) {
    for (int k = 0; k < 4; k++) {
        static const uint32_t widths[4] = {0, 1, 4, 16};
        static Case t;
        t = (Case){.name = name, .random = 11 + (uint64_t)k};
        SltOptions o = SLT_OPTIONS_INIT;
        o.f64 = k & 1, o.width = widths[k], o.seed = 3, o.verify = true, o.no_cache = true, o.near_miss = 0;
        SltStatus st = source ? slt_compile_string(source, name, &o, &t.p) : slt_compile_file(name, &o, &t.p);
        if (st != SLT_OK) fail_msg("%s: %s\n%s", name, slt_last_error(t.p), slt_diagnostics_text(t.p));
        SltError err = {0};
        bool needs[K_KINDS] = {[K_VALUE] = true, [K_VJP] = true, [K_REGION] = true, [K_BOUNDS] = true, [K_EDGE] = true};
        if (api_kernels(t.p, needs, &err) != SLT_OK) fail_msg("%s: %s", name, err.text);
        const SltScene *s = &t.p->scene;
        assert_true(s->nfloats <= FLOATS && s->nlists && s->list_noted[0]);
        assert_true(batch_init(&t.b, s, NULL) && lists_init(&t.lists, s));
        Box domain;
        for (int d = 0; d < 3; d++) domain.lo[d] = rounded(&t, s->lo[d]), domain.hi[d] = rounded(&t, s->hi[d]);
        for (uint32_t r = 0; r < rounds; r++) walk_down(&t, &domain);
        if (getenv("SHOW")) printf("%-24s %.4f\n", name, t.length / t.ends);
        if (t.length / t.ends > most) fail_msg("%s: %.3f of all iterations run", name, t.length / t.ends);
        lists_free(&t.lists);
        batch_free(&t.b);
        slt_program_free(t.p);
    }
}

#define SCATTER                                                                                                        \
    "struct Dot { float2 at; float r; float3 ink; };\n"                                                                \
    "Dot scatter(int i) { Dot d; d.at = rand2(); d.r = 0.02 + 0.1 * rand(); d.ink = float3(rand(), rand(), rand());\n" \
    "  return d; }\n"                                                                                                  \
    "param Dot dots[80] = init(scatter);\n"

/* Painted in order, opaque: the last that covers hides all before. */
static const char opaque[] =
    SCATTER "shader float3 main(float2 x) { float3 c = float3(0.1);\n"
            "  for (int i = 0; i < 80; i++) { [Disc] if (length(x - dots[i].at) < dots[i].r) c = dots[i].ink; }\n"
            "  return c; }";
/* Blended: nothing hides. */
static const char blended[] = SCATTER
    "shader float3 main(float2 x) { float3 c = float3(0.1);\n"
    "  for (int i = 0; i < 80; i++) { [Disc] if (length(x - dots[i].at) < dots[i].r) c = lerp(c, dots[i].ink, 0.7); }\n"
    "  return c; }";
static const char nearest[] =
    SCATTER "shader float3 main(float2 x) { float best = 1e9; float3 c = float3(0.0);\n"
            "  for (int i = 0; i < 80; i++) { float2 v = x - dots[i].at; float d = dot(v, v);\n"
            "    [Disc] if (d < best) { best = d; c = dots[i].ink; } }\n"
            "  return c + best; }";
/* The farthest, in rows, the last of equals: found by what others look up. Clustered, so that few are near. */
static const char farthest[] =
    SCATTER "shader float3 main(float2 x) { float most = -1.0; float3 c = float3(0.0); int k = 0;\n"
            "  for (int j = 0; j < 20; j++) for (int i = 0; i < 4; i++) {\n"
            "    float2 v = x - dots[4 * j + i].at * float2(0.25 * float(i), 1.0); float d = dot(v, v);\n"
            "    [Disc] if (most <= d) { most = d; c = dots[4 * j + i].ink * x.x; k = j; } }\n"
            "  return c + most + float(k); }";
/* A grid of doubles: of equals the first counts. */
static const char doubles[] =
    SCATTER "shader float3 main(float2 x) { float best = 1e9; float3 c = float3(0.0);\n"
            "  for (int i = 0; i < 80; i++) { float2 v = x - float2(0.25 * float(i % 5), 0.125 * float(i / 5 % 8));\n"
            "    float d = abs(v.x) + abs(v.y); [Disc] if (d < best) { best = d; c = dots[i].ink; } }\n"
            "  return c + best; }";
/* What keeps one and is no argmin: by a key of what is carried; with a sum beside it, or what was kept before; the
 * second nearest; under a condition. */
#define KEEP(loop, what) "  for (int i = 0; i < 80; i++) { float2 v = x - dots[i].at; float d = dot(v, v)" loop what " }\n"
static const char keepers[] = SCATTER
    "shader float3 main(float2 x) { float a = 9.0; float b = 9.0; float c = 9.0; float e = 9.0; float m = 9.0;\n"
    "  float n = 0.0; float old = 0.0; float next = 9.0; float3 p = float3(0.0); float3 q = p; float3 r = p;\n" KEEP(
        " + 0.01 * p.x; ", "[Disc] if (d < a) { a = d; p = dots[i].ink; }")
        KEEP("; ", "[Disc] if (d < b) { b = d; q = dots[i].ink; n += 1.0; }") KEEP(
            "; ", "[Disc] if (d < c) { old = c; c = d; }")
            KEEP("; ", "[Disc] if (d < e) { next = e; e = d; } else { [Disc] if (d < next) next = d; }") KEEP(
                "; ",
                "if (dots[i].ink.x < 0.5) { [Disc] if (d < m) { m = d; r = dots[i].ink; } }") "  return p + q + r + n + next - e + old; }";
/* A union by a minimum, and a maximum; a colour and a number by a choice. */
static const char extremes[] =
    SCATTER "shader float3 main(float2 x) { float d = 9.0; float far = -1.0; float g = 0.25; int top = -1;\n"
            "  for (int i = 0; i < 80; i++) { float e = length(x - dots[i].at) - dots[i].r; d = min(d, e);\n"
            "    far = max(0.3 - e, far); g = e < 0.0 ? dots[i].ink.x : g; top = e < 0.0 ? max(top, i) : top; }\n"
            "  return float3(d, far, g + float(top)); }";
/* In any of them, out of all others: by || and &&. */
static const char flags[] =
    SCATTER "shader float3 main(float2 x) { bool hit = false; bool off = true;\n"
            "  for (int i = 0; i < 40; i++) { float e = length(x - dots[i].at) - dots[i].r; hit = hit || e < -0.01; }\n"
            "  for (int i = 40; i < 80; i++) { float e = length(x - dots[i].at) - dots[i].r; off = e > 0.02 && off; }\n"
            "  return float3(hit ? 1.0 : 0.0, off ? 1.0 : 0.0, 0.5); }";
/* Paint under conditions of the program's own, two ways, and some of it through others. */
static const char nested[] =
    SCATTER "shader float3 main(float2 x) { float3 c = float3(0.1); float n = 0.0;\n"
            "  for (int i = 0; i < 80; i++) {\n"
            "    if (dots[i].ink.x > 0.5) { if (x.x > dots[i].at.x - dots[i].r) {\n"
            "        [Disc] if (length(x - dots[i].at) < dots[i].r) { c = dots[i].ink; n = 1.0; } } }\n"
            "    else { [Disc] if (abs(x.y - dots[i].at.y) < 0.2 * dots[i].r) c = c.zxy; } }\n"
            "  return c + n; }";
/* The first that holds: a break. */
static const char first[] = SCATTER
    "shader float3 main(float2 x) { float3 c = float3(0.1);\n"
    "  for (int i = 0; i < 80; i++) { [Disc] if (length(x - dots[i].at) < dots[i].r) { c = dots[i].ink; break; } }\n"
    "  return c; }";
/* As many as a parameter says. */
static const char counted[] = SCATTER
    "param int n = 61;\n"
    "shader float3 main(float2 x) { float3 c = float3(0.1);\n"
    "  [MaxIters(80)] for (int i = 0; i < n; i++) { [Disc] if (length(x - dots[i].at) < dots[i].r) c = dots[i].ink; }\n"
    "  return c; }";
/* A loop in a loop: the outer has the list. */
static const char rows[] =
    SCATTER "shader float3 main(float2 x) { float3 c = float3(0.1);\n"
            "  for (int j = 0; j < 20; j++) for (int i = 0; i < 4; i++) {\n"
            "    [Disc] if (length(x - dots[4 * j + i].at) < dots[4 * j + i].r) c = dots[4 * j + i].ink; }\n"
            "  return c; }";
/* The inner loop has it: the sum around it changes in every iteration. */
static const char inner[] =
    SCATTER "shader float3 main(float2 x) { float3 s = float3(0.0);\n"
            "  for (int j = 0; j < 3; j++) { float3 c = float3(0.1); float2 y = x + 0.1 * float(j);\n"
            "    for (int i = 0; i < 80; i++) { [Disc] if (length(y - dots[i].at) < dots[i].r) c = dots[i].ink; }\n"
            "    s += c; }\n"
            "  return s; }";
/* Two loops, the second in a branch, over what the first has left. */
static const char layers[] =
    SCATTER "shader float3 main(float2 x) { float3 c = float3(0.1);\n"
            "  for (int i = 0; i < 40; i++) { [Disc] if (length(x - dots[i].at) < dots[i].r) c = dots[i].ink; }\n"
            "  [Disc] if (x.x > 0.4) { for (int i = 40; i < 80; i++) {\n"
            "    [Disc] if (length(x - dots[i].at) < dots[i].r) c = 0.5 * c + dots[i].ink; } }\n"
            "  return c; }";
/* What is carried changes places: it passes through nowhere else. */
static const char swapped[] = SCATTER
    "shader float3 main(float2 x) { float3 a = float3(0.1); float3 b = float3(0.9);\n"
    "  for (int i = 0; i < 80; i++) { [Disc] if (length(x - dots[i].at) < dots[i].r) { float3 t = a; a = b; b = t; } }\n"
    "  return a - 0.5 * b; }";
/* Random numbers of each iteration, and an array that is only read. */
static const char scattered[] = SCATTER
    "shader float3 main(float2 x) { float3 c = float3(0.1); float w[4]; for (int j = 0; j < 4; j++) w[j] = x.x * float(j);\n"
    "  for (int i = 0; i < 80; i++) { float u = rand();\n"
    "    [Disc] if (length(x - dots[i].at) < dots[i].r) c = dots[i].ink * (u + w[i & 3]); }\n"
    "  return c; }";

/* So many that the reverse sweep cuts the loop into segments; of the second nothing is stored, it counts backwards. */
static const char many[] =
    "param float r = 0.004; param float3 ink = float3(0.3, 0.2, 0.9);\n"
    "float2 place(int i) { return float2(frac(0.618034 * float(i)), frac(0.754878 * float(i))); }\n"
    "shader float3 main(float2 x) { float3 c = float3(0.1); float d = 1.0;\n"
    "  for (int i = 0; i < 12000; i++) { [Disc] if (length(x - place(i)) < r) c = sin(c.zxy + ink * float(i)); }\n"
    "  for (int i = 0; i < 3000; i++) d = abs(place(i).x - x.x) < 0.002 ? r * float(i) : d;\n"
    "  return c + d; }";

static void programs(void **state) {
    (void)state;
    check_lists("opaque", opaque, 0.03);
    check_lists("blended", blended, 0.05);
    check_lists("nearest", nearest, 0.02);
    check_lists("farthest", farthest, 0.25);
    check_lists("doubles", doubles, 0.05);
    check_lists("extremes", extremes, 0.12);
    check_lists("flags", flags, 0.05);
    check_lists("nested", nested, 0.05);
    check_lists("first", first, 0.04);
    check_lists("counted", counted, 0.06);
    check_lists("rows", rows, 0.15);
    check_lists("inner", inner, 0.1);
    check_lists("layers", layers, 0.04);
    check_lists("swapped", swapped, 0.05);
    check_lists("many", many, 0.01);
    check_lists("scattered", scattered, 0.05);
}

/* By which edges a loop keeps one iteration: theirs is a sign of g. */
static uint32_t argmins(const char *source) {
    SltOptions o = SLT_OPTIONS_INIT;
    SltProgram *p = NULL;
    SltError err = {0};
    bool needs[K_KINDS] = {[K_BOUNDS] = true};
    o.interpret = true;
    assert_int_equal(slt_compile_string(source, "argmins", &o, &p), SLT_OK);
    assert_int_equal(api_kernels(p, needs, &err), SLT_OK);
    uint32_t n = 0;
    for (uint32_t e = 0; e < p->scene.nedges && p->scene.edge_argmin; e++) n += p->scene.edge_argmin[e] != 0;
    slt_program_free(p);
    return n;
}

static void keep_one(void **state) {
    (void)state;
    assert_int_equal(argmins(nearest), 1);
    assert_int_equal(argmins(farthest), 1);
    assert_int_equal(argmins(doubles), 1);
    assert_int_equal(argmins(keepers), 0);
    assert_int_equal(argmins(opaque), 0);
    assert_int_equal(argmins(swapped), 0);
}

static void examples(void **state) {
    (void)state;
    check_lists(SALTUS_TEST_DIR "/../examples/voronoi_mosaic/mosaic.salt", NULL, 0.06);
    check_lists(SALTUS_TEST_DIR "/../examples/painterly_discs/discs.salt", NULL, 0.07);
    check_lists(SALTUS_TEST_DIR "/../examples/shadow_art/face.salt", NULL, 0.5);
}

/* ---- loops by chance: conditions under conditions, values and flags that pass, swap, join and overwrite */
typedef struct Text {
    Case *t; /* whose random numbers these are */
    char *at, *end;
} Text;

__attribute__((format(printf, 2, 3))) static void say(Text *w, const char *fmt, ...) {
    va_list ap;
    va_start(ap, fmt);
    w->at += vsnprintf(w->at, (size_t)(w->end - w->at), fmt, ap);
    va_end(ap);
    assert_true(w->at < w->end);
}
static uint32_t below(Text *w, uint32_t n) { return (uint32_t)(unit(w->t) * n); }

static void say_number(Text *w) {
    static const char *const e[] = {"e", "a", "b", "dots[i].ink.y", "0.5 * a + e", "x.y", "dots[i].r", "-b", "0.25"};
    say(w, "%s", e[below(w, sizeof e / sizeof *e)]);
}

static void say_condition(Text *w) {
    static const char *const c[] = {
        "e < 0.0",    "e < 0.05",          "h", "!g", "a < b", "e < a", "dots[i].ink.x < 0.4", "x.x < 0.5",
        "i % 3 == 1", "dots[i].at.y < x.y"};
    uint32_t n = sizeof c / sizeof *c;
    if (below(w, 3)) say(w, "%s", c[below(w, n)]);
    else say(w, "%s %s %s", c[below(w, n)], below(w, 2) ? "&&" : "||", c[below(w, n)]);
}

static void say_statements(Text *w, uint32_t depth) {
    for (uint32_t n = 1 + below(w, 2); n; n--) {
        uint32_t kind = below(w, depth ? 9 : 5);
        if (kind == 0) say(w, "a = "), say_number(w), say(w, ";\n");
        else if (kind == 1) say(w, "b = %s(b, ", below(w, 2) ? "min" : "max"), say_number(w), say(w, ");\n");
        else if (kind == 2) say(w, "h = %s ", below(w, 2) ? "h ||" : "h &&"), say_condition(w), say(w, ";\n");
        else if (kind == 3) say(w, "%s", below(w, 2) ? "{ float s = a; a = b; b = s; }\n" : "g = !g;\n");
        else if (kind == 4) say(w, "a = ("), say_condition(w), say(w, ") ? "), say_number(w), say(w, " : a;\n");
        else {
            say(w, "%s", below(w, 2) ? "if (" : "[Disc] if (e < 0.01 && "), say_condition(w), say(w, ") {\n"),
                say_statements(w, depth - 1), say(w, "}\n");
            if (!below(w, 3)) say(w, "else {\n"), say_statements(w, depth - 1), say(w, "}\n");
        }
    }
}

/* Interpreted: compiling would take most of the time. */
static void random_loops(void **state) {
    (void)state;
    uint32_t listed = 0;
    for (uint64_t seed = 1; seed <= 60 * (uint64_t)rounds; seed++) {
        static Case t;
        static char source[1 << 14];
        t = (Case){.name = source, .random = seed * 0x9e3779b97f4a7c15u};
        Text w = {&t, source, source + sizeof source};
        say(&w, "%s",
            SCATTER "shader float3 main(float2 x) { float a = 0.5; float b = 0.7; bool h = false; bool g = true;\n"
                    "for (int i = 0; i < 80; i++) { float e = length(x - dots[i].at) - dots[i].r;\n"
                    "[Disc] if (e < 0.02) {\n");
        say_statements(&w, 3);
        say(&w, "}\n");
        if (!below(&w, 4))
            say(&w, "[Disc] if (e < -0.02) { %s}\n",
                below(&w, 2) ? "break; " : "a = e; b = 1.0; h = true; g = false; ");
        say(&w, "}\nreturn float3(a, b, (h ? 1.0 : 0.0) + (g ? 0.5 : 0.0)); }");
        SltOptions o = SLT_OPTIONS_INIT;
        o.f64 = seed & 1, o.seed = 3, o.verify = true, o.near_miss = 0, o.interpret = true;
        SltStatus st = slt_compile_string(source, "random.salt", &o, &t.p);
        if (st != SLT_OK) fail_msg("%s\n%s", source, slt_diagnostics_text(t.p));
        SltError err = {0};
        bool needs[K_KINDS] = {[K_VALUE] = true, [K_VJP] = true, [K_REGION] = true, [K_BOUNDS] = true};
        if (api_kernels(t.p, needs, &err) != SLT_OK) fail_msg("%s\n%s", source, err.text);
        const SltScene *s = &t.p->scene;
        if (s->nlists && s->list_noted[0]) {
            listed++;
            assert_true(batch_init(&t.b, s, NULL) && lists_init(&t.lists, s));
            Box domain = {{0, 0}, {1, 1}};
            walk_down(&t, &domain);
            lists_free(&t.lists);
            batch_free(&t.b);
        }
        slt_program_free(t.p);
    }
    if (getenv("SHOW")) printf("%u loops have lists\n", listed);
    assert_true(listed > 20 * rounds);
}

/* [Cull] is a promise; under verify a box that is too small is told, and one that is not is not. */
static void promises(void **state) {
    (void)state;
    static const char *const reach[2] = {"dots[i].r", "0.8 * dots[i].r"};
    for (int wrong = 0; wrong < 2; wrong++) {
        char source[2048];
        snprintf(source, sizeof source,
                 "%sfloat4 box(int i) { return float4(dots[i].at - %s, dots[i].at + %s); }\n"
                 "shader float3 main(float2 x) { float3 c = float3(0.1);\n"
                 "  [Cull(box)] for (int i = 0; i < 80; i++) {\n"
                 "    [Disc] if (length(x - dots[i].at) < dots[i].r) c = lerp(c, dots[i].ink, 0.5); }\n"
                 "  return c; }",
                 SCATTER, reach[wrong], reach[wrong]);
        for (int f64 = 0; f64 < 2; f64++) {
            SltOptions o = SLT_OPTIONS_INIT;
            o.f64 = f64, o.verify = true, o.no_cache = true;
            SltProgram *p = NULL;
            SltError err = {0};
            bool needs[K_KINDS] = {[K_VALUE] = true};
            assert_int_equal(slt_compile_string(source, "promise.salt", &o, &p), SLT_OK);
            assert_int_equal(api_kernels(p, needs, &err), SLT_OK);
            uint32_t told = 0;
            for (uint32_t i = 0; i < slt_diagnostic_count(p); i++) {
                SltDiagnostic d = SLT_DIAGNOSTIC_INIT;
                assert_true(slt_diagnostic(p, i, &d));
                if (!strcmp(d.code, "W0403")) told++, assert_int_equal(d.line, 7);
            }
            assert_int_equal(told, wrong);
            slt_program_free(p);
        }
    }
}

int main(int argc, char **argv) {
    if (argc > 1) rounds = (uint32_t)atoi(argv[1]);
    const struct CMUnitTest tests[] = {cmocka_unit_test(programs), cmocka_unit_test(keep_one),
                                       cmocka_unit_test(examples), cmocka_unit_test(random_loops),
                                       cmocka_unit_test(promises)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
