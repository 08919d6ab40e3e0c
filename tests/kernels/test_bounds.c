/* The bounds kernel and the edge kernels keep their word: on boxes large and of a few units in the last place, f at
 * every point lies between its bounds, what jumps is an open event of the list or said to be unknown, and g and its
 * gradient lie between theirs; compiled and interpreted kernels agree bit for bit.
 *
 *   test-kernels-bounds [rounds]    rounds: of boxes a program, 1 by default */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "bindings/c/api.h"
#include "compiler/pass/variant.h"

enum { BOXES = 128, POINTS = 16, ROOM = BOXES * POINTS };

static uint32_t rounds = 1;
static uint64_t pairs, jumps;        /* compared: points with bounds; jumps of f with lists */
static uint64_t continuous, jumping; /* boxes on which g is said not to jump, and the others */
static uint64_t seconds;             /* of the first: whose second derivatives are bounded */
static uint64_t given;               /* events that were given */

typedef struct Io {
    void *in[SLT_IN_VARYING], *out[SLT_OUT_MAX];
    SltKernelArgs args;
} Io;

typedef struct Case {
    const char *name;
    SltProgram *p;
    bool f64;
    uint64_t random;
    double lo[ROOM][3], hi[BOXES][3]; /* boxes; lo is the points' too */
    Io box, at;                       /* what kernels of boxes and of points read and write */
} Case;

static double unit(Case *t) {
    t->random = t->random * 6364136223846793005ull + 1442695040888963407ull;
    return (double)(t->random >> 11) * 0x1p-53;
}

static double get(const Case *t, const void *a, uint32_t i) {
    return t->f64 ? ((const double *)a)[i] : (double)((const float *)a)[i];
}

static void set(const Case *t, void *a, uint32_t i, double v) {
    if (t->f64) ((double *)a)[i] = v;
    else ((float *)a)[i] = (float)v;
}

static double rounded(const Case *t, double v) { return t->f64 ? v : (double)(float)v; }

static double step_up(const Case *t, double v, int n) {
    for (int k = 0; k < n; k++) v = t->f64 ? nextafter(v, INFINITY) : (double)nextafterf((float)v, INFINITY);
    return v;
}

static void io_make(Io *io, const SltProgram *p) {
    memset(io, 0, sizeof *io);
    for (int i = 0; i < SLT_IN_VARYING; i++) {
        io->args.in[i] = io->in[i] = aligned_alloc(64, (ROOM + 64) * 8);
        memset(io->in[i], 0, (ROOM + 64) * 8);
    }
    for (int i = 0; i < SLT_OUT_MAX; i++) io->args.out[i] = io->out[i] = aligned_alloc(64, (ROOM + 64) * 8);
    io->args.params = p->flt, io->args.iparams = p->ints;
    io->args.resolution[0] = io->args.resolution[1] = 16;
}

static void io_free(Io *io) {
    for (int i = 0; i < SLT_IN_VARYING; i++) free(io->in[i]);
    for (int i = 0; i < SLT_OUT_MAX; i++) free(io->out[i]);
}

static void *output(const Case *t, const Io *io, int kind, SltRole role, uint32_t k) {
    return io->out[t->p->scene.layout[kind].out[role].first + k];
}

static uint32_t outputs(const Case *t, int kind, SltRole role) { return t->p->scene.layout[kind].out[role].count; }

static void call(Case *t, Io *io, int kind, uint32_t n) {
    io->args.n_valid = n;
    for (int s = 0; s < SLT_IN_VARYING; s++)
        for (uint32_t k = n; k < ((n + SLT_PAD - 1) & ~(uint32_t)(SLT_PAD - 1)); k++) /* the tail repeats the last */
            if (ir_input_type((InputSlot)s) == TY_FLT) set(t, io->in[s], k, get(t, io->in[s], n - 1));
            else ((int32_t *)io->in[s])[k] = ((int32_t *)io->in[s])[n - 1];
    t->p->scene.kernel[kind](&io->args, n);
}

/* ---- boxes and points */

static void make_boxes(Case *t) {
    const Program *g = t->p->prog;
    for (uint32_t i = 0; i < BOXES; i++) {
        double size = pow(2, -(i % 2 ? 20 : 7) * unit(t)), kind = unit(t);
        for (uint32_t d = 0; d < 3; d++) {
            double span = g->hi[d] - g->lo[d], at = g->lo[d] + span * unit(t);
            double side = kind < 0.7 ? size * span : 0;
            if (unit(t) < 0.15) at = g->lo[d] + span * floor(8 * unit(t)) / 8; /* dyadic corners */
            t->lo[i][d] = rounded(t, at);
            t->hi[i][d] =
                kind < 0.85 ? fmax(rounded(t, at + side), t->lo[i][d]) : step_up(t, t->lo[i][d], (int)(4 * unit(t)));
            set(t, t->box.in[IN_X0 + d], i, t->lo[i][d]);
            set(t, t->box.in[IN_H0 + d], i, t->hi[i][d]);
        }
    }
}

/* POINTS points in every box: corners, and others. */
static void make_points(Case *t) {
    for (uint32_t i = 0; i < BOXES; i++)
        for (uint32_t k = 0; k < POINTS; k++)
            for (uint32_t d = 0; d < 3; d++) {
                double lo = t->lo[i][d], hi = t->hi[i][d], v = lo + (hi - lo) * unit(t);
                if (k < 4) v = k >> d & 1 ? hi : lo;
                v = fmin(fmax(rounded(t, v), lo), hi);
                set(t, t->at.in[IN_X0 + d], i * POINTS + k, v);
            }
}

/* ---- checks */

static const char *where(const Case *t, uint32_t i) {
    static char text[400];
    snprintf(text, sizeof text, "%s %s, box [%a, %a] x [%a, %a] x [%a, %a]", t->name, t->f64 ? "f64" : "f32",
             t->lo[i][0], t->hi[i][0], t->lo[i][1], t->hi[i][1], t->lo[i][2], t->hi[i][2]);
    return text;
}

/* v between ends, of which -inf and NaN, inf and NaN say nothing; a NaN only where both do. */
static bool lies(double v, double lo, double hi) {
    if (isnan(v)) return !(lo > -INFINITY) && !(hi < INFINITY);
    return !(v < lo) && !(v > hi);
}

static void compare_interpreted(Case *t, Io *io, int kind, uint32_t n) {
    Io want;
    io_make(&want, t->p);
    for (int i = 0; i < SLT_IN_VARYING; i++) want.args.in[i] = io->args.in[i];
    want.args.site = io->args.site;
    assert_int_equal(ir_interpret(t->p->fn[kind], &want.args, n, 16), SLT_OK);
    const Fn *fn = t->p->fn[kind];
    while (fn->next_part && !fn->serves[io->args.site]) fn = fn->next_part;
    for (uint32_t o = 0; o < fn->body->last->nargs; o++)
        for (uint32_t i = 0; i < n; i++) {
            bool f = fn->body->last->args[o]->type == TY_FLT;
            double x = f ? get(t, want.out[o], i) : ((int32_t *)want.out[o])[i];
            double y = f ? get(t, io->out[o], i) : ((int32_t *)io->out[o])[i];
            if (x != y && !(isnan(x) && isnan(y)))
                fail_msg("%s: kernel %s, output %u: %.17g interpreted, %.17g compiled", where(t, i), kernel_names[kind],
                         o, x, y);
        }
    io_free(&want);
}

static void check_values(Case *t) {
    call(t, &t->at, K_VALUE, ROOM);
    for (uint32_t i = 0; i < BOXES; i++)
        for (uint32_t c = 0; c < t->p->prog->channels; c++) {
            double lo = get(t, output(t, &t->box, K_BOUNDS, SLT_OUT_F_LO, c), i);
            double hi = get(t, output(t, &t->box, K_BOUNDS, SLT_OUT_F_HI, c), i);
            for (uint32_t k = 0; k < POINTS; k++, pairs++) {
                double v = get(t, output(t, &t->at, K_VALUE, SLT_OUT_F, c), i * POINTS + k);
                if (!lies(v, lo, hi))
                    fail_msg("%s: f is %.17g at (%a, %a), not in [%.17g, %.17g]", where(t, i), v,
                             get(t, t->at.in[IN_X0], i * POINTS + k), get(t, t->at.in[IN_X1], i * POINTS + k), lo, hi);
            }
        }
}

static int32_t state_of(const Case *t, uint32_t i) {
    return ((int32_t *)output(t, &t->box, K_BOUNDS, SLT_OUT_BOX_STATE, 0))[i];
}
static int32_t open_of(const Case *t, uint32_t i) {
    return outputs(t, K_BOUNDS, SLT_OUT_OPEN) ? ((int32_t *)output(t, &t->box, K_BOUNDS, SLT_OUT_OPEN, 0))[i] : 0;
}

static bool has_array(const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_alloc) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (has_array(i->region[r])) return true;
    }
    return false;
}

/* Where nothing is open all points lie in one piece. With arrays the hash is that of the path, in which events count
 * too that later ones hide. */
static uint32_t check_pieces(Case *t) {
    uint32_t settled = 0;
    bool hashes = t->p->fn[K_REGION] && !has_array(t->p->prog->primal->body);
    if (t->p->fn[K_REGION]) call(t, &t->at, K_REGION, ROOM);
    for (uint32_t i = 0; i < BOXES; i++) {
        if (state_of(t, i) || open_of(t, i)) continue;
        settled++;
        if (!hashes) continue;
        const int32_t *h = (int32_t *)output(t, &t->at, K_REGION, SLT_OUT_HASH, 0) + i * POINTS;
        for (uint32_t k = 1; k < POINTS; k++)
            if (h[k] != h[0])
                fail_msg("%s: settled, but (%a, %a) lies in another piece", where(t, i),
                         get(t, t->at.in[IN_X0], i * POINTS + k), get(t, t->at.in[IN_X1], i * POINTS + k));
    }
    return settled;
}

/* Is an event told of box i? */
static bool is_told(const Case *t, uint32_t i, int32_t edge, const int32_t *k, uint32_t depth) {
    uint32_t told = outputs(t, K_BOUNDS, SLT_OUT_OPEN_EDGE),
             most = told ? outputs(t, K_BOUNDS, SLT_OUT_OPEN_K) / told : 0;
    for (uint32_t e = 0; e < told; e++) {
        bool same = ((int32_t *)output(t, &t->box, K_BOUNDS, SLT_OUT_OPEN_EDGE, e))[i] == edge;
        for (uint32_t d = 0; d < depth && d < most; d++)
            same &= ((int32_t *)output(t, &t->box, K_BOUNDS, SLT_OUT_OPEN_K, e * most + d))[i] == k[d];
        if (same) return true;
    }
    return false;
}

/* Does g of another event that is told change its sign between points at and at + 1? A condition that is tested twice
 * is two sites: the first may be hidden while the second jumps. */
static bool is_told_otherwise(Case *t, uint32_t i, const Io *ends, uint32_t at) {
    uint32_t told = outputs(t, K_BOUNDS, SLT_OUT_OPEN_EDGE), depth = outputs(t, K_BOUNDS, SLT_OUT_OPEN_K) / told;
    bool changes = false;
    Io io;
    io_make(&io, t->p);
    for (uint32_t e = 0; e < told && (int32_t)e < open_of(t, i) && !changes && t->p->fn[K_EDGE]; e++) {
        io.args.site = ((int32_t *)output(t, &t->box, K_BOUNDS, SLT_OUT_OPEN_EDGE, e))[i];
        if (io.args.site < 0) break;
        for (uint32_t end = 0; end < 2; end++) {
            for (uint32_t d = 0; d < 3; d++) set(t, io.in[IN_X0 + d], end, get(t, ends->in[IN_X0 + d], at + end));
            for (uint32_t d = 0; d < depth; d++)
                ((int32_t *)io.in[IN_K0 + d])[end] =
                    ((int32_t *)output(t, &t->box, K_BOUNDS, SLT_OUT_OPEN_K, e * depth + d))[i];
            if (outputs(t, K_BOUNDS, SLT_OUT_OPEN_FIRST))
                set(t, io.in[IN_BOUNDARY], end, get(t, output(t, &t->box, K_BOUNDS, SLT_OUT_OPEN_FIRST, e), i));
        }
        call(t, &io, K_EDGE, 2);
        const void *g = output(t, &io, K_EDGE, SLT_OUT_G, 0);
        changes = get(t, g, 0) * get(t, g, 1) <= 0;
    }
    io_free(&io);
    return changes;
}

static int32_t hash_at(const Case *t, const Io *io, uint32_t i) {
    return ((int32_t *)output(t, io, K_REGION, SLT_OUT_HASH, 0))[i];
}

/* Between two points in different pieces, brought together as near as numbers allow, one event differs: where f jumps
 * there, the list has it, or the box says that it does not know. */
static void check_list(Case *t) {
    if (!t->p->fn[K_REGION] || !t->p->fn[K_EVENT] || !outputs(t, K_BOUNDS, SLT_OUT_OPEN)) return;
    Io io;
    io_make(&io, t->p);
    uint32_t n = 0, box[BOXES];
    for (uint32_t i = 0; i < BOXES; i++) {
        if ((state_of(t, i) & SLT_BOX_UNKNOWN) || open_of(t, i) > SLT_MAX_OPEN) continue;
        uint32_t a = i * POINTS, c = a + 1;
        while (c < a + POINTS && hash_at(t, &t->at, c) == hash_at(t, &t->at, a)) c++;
        if (c == a + POINTS) continue;
        for (uint32_t d = 0; d < 3; d++)
            set(t, io.in[IN_X0 + d], 2 * n, get(t, t->at.in[IN_X0 + d], a)),
                set(t, io.in[IN_X0 + d], 2 * n + 1, get(t, t->at.in[IN_X0 + d], c));
        box[n++] = i;
    }
    if (!n) {
        io_free(&io);
        return;
    }
    Io middle;
    io_make(&middle, t->p);
    for (uint32_t step = 0; step < 70; step++) {
        for (uint32_t j = 0; j < n; j++)
            for (uint32_t d = 0; d < 3; d++) {
                double a = get(t, io.in[IN_X0 + d], 2 * j), c = get(t, io.in[IN_X0 + d], 2 * j + 1);
                set(t, middle.in[IN_X0 + d], 2 * j, a);
                set(t, middle.in[IN_X0 + d], 2 * j + 1, a + (c - a) / 2);
            }
        call(t, &middle, K_REGION, 2 * n);
        for (uint32_t j = 0; j < n; j++) {
            uint32_t end = 2 * j + (hash_at(t, &middle, 2 * j) != hash_at(t, &middle, 2 * j + 1));
            for (uint32_t d = 0; d < 3; d++) set(t, io.in[IN_X0 + d], end, get(t, middle.in[IN_X0 + d], 2 * j + 1));
        }
    }
    call(t, &io, K_VALUE, 2 * n);
    memcpy(middle.out[0], io.out[0], (size_t)(2 * n) * 8);
    call(t, &io, K_EVENT, 2 * n);
    for (uint32_t j = 0; j < n; j++) {
        double a = get(t, middle.out[0], 2 * j), c = get(t, middle.out[0], 2 * j + 1);
        if (fabs(a - c) < 1e-3) continue; /* not a jump of the first channel */
        int32_t site = ((int32_t *)output(t, &io, K_EVENT, SLT_OUT_SITE, 0))[2 * j], k[SLT_MAX_K] = {0};
        uint32_t depth = outputs(t, K_EVENT, SLT_OUT_K);
        for (uint32_t d = 0; d < depth; d++) k[d] = ((int32_t *)output(t, &io, K_EVENT, SLT_OUT_K, d))[2 * j];
        if (site >= 0) depth = t->p->prog->primal->sites[site].depth;
        pairs++, jumps++;
        if (!is_told(t, box[j], site, k, depth) && !is_told_otherwise(t, box[j], &io, 2 * j))
            fail_msg("%s: f jumps at (%a, %a) by site %d, which is not told", where(t, box[j]),
                     get(t, io.in[IN_X0], 2 * j), get(t, io.in[IN_X1], 2 * j), site);
    }
    io_free(&io);
    io_free(&middle);
}

/* The event does not exist at this point: what an edge kernel gives that ran past it. */
static bool is_uncaptured(double v) {
    uint64_t bits;
    memcpy(&bits, &v, sizeof bits);
    return (bits & ~(1ull << 63)) == VARIANT_UNCAPTURED;
}

/* Between points 0 and k a number changes by no less and no more than what bounds of its slopes allow: role lo and the
 * one behind it, of axis d number which[d]. */
static void check_change(Case *t, const Io *box, const Io *at, uint32_t i, uint32_t k, const void *of, SltRole role,
                         const uint32_t which[3], double error, const char *name) {
    double lo = 0, hi = 0, change = get(t, of, k) - get(t, of, 0);
    for (uint32_t d = 0; d < t->p->prog->dim; d++) {
        double step = get(t, at->in[IN_X0 + d], k) - get(t, at->in[IN_X0 + d], 0);
        double from = get(t, output(t, box, K_EDGE_BOUNDS, role, which[d]), 0);
        double to = get(t, output(t, box, K_EDGE_BOUNDS, (SltRole)(role + 1), which[d]), 0);
        if (step == 0) continue;
        lo += step > 0 ? step * from : step * to, hi += step > 0 ? step * to : step * from;
    }
    double slack = 2 * error + 1e-12 * (fabs(lo) + fabs(hi));
    if (!lies(change, lo - slack, hi + slack) && !isnan(lo) && !isnan(hi))
        fail_msg("%s: %s of edge %d changes by %.17g, its slopes allow [%.17g, %.17g], its rounding %g", where(t, i),
                 name, box->args.site, change, lo, hi, error);
}

/* Where g is said not to jump, it changes between two points by what its gradient allows, and its gradient by what
 * second derivatives do: the mean value theorem, on which cells rely. Rounded g may be off at either point. */
static void check_mean_value(Case *t, const Io *box, const Io *at, uint32_t i) {
    static const uint32_t all[3] = {0, 1, 2}, rows[2][3][3] = {{{0, 1}, {1, 2}}, {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}}};
    if (((int32_t *)output(t, box, K_EDGE_BOUNDS, SLT_OUT_G_STATE, 0))[0] & SLT_EDGE_JUMPS) {
        jumping++;
        return;
    }
    continuous++;
    if (outputs(t, K_EDGE_BOUNDS, SLT_OUT_DDG_LO))
        seconds += isfinite(get(t, output(t, box, K_EDGE_BOUNDS, SLT_OUT_DDG_LO, 0), 0));
    double error = get(t, output(t, box, K_EDGE_BOUNDS, SLT_OUT_G_ERROR, 0), 0);
    const void *g = output(t, at, K_EDGE, SLT_OUT_G, 0);
    for (uint32_t k = 1; k < POINTS; k++) {
        if (is_uncaptured(get(t, g, k)) || is_uncaptured(get(t, g, 0))) continue;
        check_change(t, box, at, i, k, g, SLT_OUT_DG_LO, all, error, "g");
        for (uint32_t d = 0; d < t->p->prog->dim && outputs(t, K_EDGE_BOUNDS, SLT_OUT_DDG_LO); d++) {
            double rounding = get(t, output(t, box, K_EDGE_BOUNDS, SLT_OUT_DG_ERROR, d), 0);
            if (!isnan(rounding)) /* then nothing is known */
                check_change(t, box, at, i, k, output(t, at, K_EDGE, SLT_OUT_G_DX, d), SLT_OUT_DDG_LO,
                             rows[t->p->prog->dim > 2][d], rounding, "a slope");
        }
    }
}

/* Is entry e of the list of box i the same event as an earlier one? */
static bool is_told_before(const Case *t, uint32_t i, uint32_t e) {
    uint32_t told = outputs(t, K_BOUNDS, SLT_OUT_OPEN_EDGE), depth = outputs(t, K_BOUNDS, SLT_OUT_OPEN_K) / told;
    for (uint32_t f = 0; f < e; f++) {
        bool same = ((int32_t *)output(t, &t->box, K_BOUNDS, SLT_OUT_OPEN_EDGE, e))[i] ==
                    ((int32_t *)output(t, &t->box, K_BOUNDS, SLT_OUT_OPEN_EDGE, f))[i];
        for (uint32_t d = 0; d < depth; d++)
            same &= ((int32_t *)output(t, &t->box, K_BOUNDS, SLT_OUT_OPEN_K, e * depth + d))[i] ==
                    ((int32_t *)output(t, &t->box, K_BOUNDS, SLT_OUT_OPEN_K, f * depth + d))[i];
        if (same) return true;
    }
    return false;
}

/* Gives the edge kernels some of the events that are told of box i, with signs by chance: whatever they are, g is a
 * function of its own. */
static void give_some(Case *t, Io *box, Io *at, uint32_t i, uint32_t told, uint32_t depth, bool any) {
    for (uint32_t j = 0; j < SLT_GIVEN; j++) {
        uint32_t e = (uint32_t)(unit(t) * fmin(told, open_of(t, i)));
        int32_t edge = ((int32_t *)output(t, &t->box, K_BOUNDS, SLT_OUT_OPEN_EDGE, e))[i];
        bool gives = any && edge >= 0 && unit(t) < 0.7;
        int32_t code = gives ? 2 * (edge + 1) + (unit(t) < 0.5) : 0;
        ((int32_t *)box->in[IN_GIVEN0 + j])[0] = code;
        for (uint32_t k = 0; k < POINTS; k++) ((int32_t *)at->in[IN_GIVEN0 + j])[k] = code;
        for (uint32_t d = 0; d < depth && d < SLT_GIVEN_K; d++) {
            uint32_t slot = IN_GIVEN0_K0 + SLT_GIVEN_K * j + d;
            int32_t index = ((int32_t *)output(t, &t->box, K_BOUNDS, SLT_OUT_OPEN_K, e * depth + d))[i];
            ((int32_t *)box->in[slot])[0] = index;
            for (uint32_t k = 0; k < POINTS; k++) ((int32_t *)at->in[slot])[k] = index;
        }
        if (depth < SLT_GIVEN_K) { /* of a rounding it is the boundary */
            uint32_t slot = IN_GIVEN0_K0 + SLT_GIVEN_K * j + SLT_GIVEN_K - 1;
            int32_t boundary = (int32_t)(8 * unit(t)) - 4;
            ((int32_t *)box->in[slot])[0] = boundary;
            for (uint32_t k = 0; k < POINTS; k++) ((int32_t *)at->in[slot])[k] = boundary;
        }
        given += gives;
    }
}

/* g of every event that is told lies between its bounds, and its gradient where it is known; of some with the decisions
 * of others given. */
static void check_edges(Case *t) {
    if (!outputs(t, K_BOUNDS, SLT_OUT_OPEN) || !t->p->fn[K_EDGE] || !t->p->fn[K_EDGE_BOUNDS]) return;
    uint32_t told = outputs(t, K_BOUNDS, SLT_OUT_OPEN_EDGE), depth = outputs(t, K_BOUNDS, SLT_OUT_OPEN_K) / told;
    Io box, at;
    io_make(&box, t->p);
    io_make(&at, t->p);
    bool checked = false;
    for (uint32_t i = 0; i < BOXES; i++)
        for (uint32_t way = 0, e = 0; e < told && (int32_t)e < open_of(t, i); way++, e += way % 2 == 0) {
            int32_t edge = ((int32_t *)output(t, &t->box, K_BOUNDS, SLT_OUT_OPEN_EDGE, e))[i];
            if (edge < 0) break;
            give_some(t, &box, &at, i, told, depth, way % 2 == 1);
            if (is_told_before(t, i, e)) fail_msg("%s: an event of edge %d is told twice", where(t, i), edge);
            for (uint32_t d = 0; d < 3; d++) {
                set(t, box.in[IN_X0 + d], 0, t->lo[i][d]);
                set(t, box.in[IN_H0 + d], 0, t->hi[i][d]);
                for (uint32_t k = 0; k < POINTS; k++)
                    set(t, at.in[IN_X0 + d], k, get(t, t->at.in[IN_X0 + d], i * POINTS + k));
            }
            for (uint32_t d = 0; d < depth; d++) {
                int32_t k = ((int32_t *)output(t, &t->box, K_BOUNDS, SLT_OUT_OPEN_K, e * depth + d))[i];
                ((int32_t *)box.in[IN_K0 + d])[0] = k;
                for (uint32_t j = 0; j < POINTS; j++) ((int32_t *)at.in[IN_K0 + d])[j] = k;
            }
            double boundary = outputs(t, K_BOUNDS, SLT_OUT_OPEN_FIRST)
                                  ? get(t, output(t, &t->box, K_BOUNDS, SLT_OUT_OPEN_FIRST, e), i)
                                  : 0;
            for (uint32_t j = 0; j < POINTS; j++) set(t, at.in[IN_BOUNDARY], j, boundary);
            set(t, box.in[IN_BOUNDARY], 0, boundary);
            box.args.site = at.args.site = edge;
            call(t, &box, K_EDGE_BOUNDS, 1);
            call(t, &at, K_EDGE, POINTS);
            if (!checked || unit(t) < 0.02) compare_interpreted(t, &box, K_EDGE_BOUNDS, 1), checked = true;
            double lo = get(t, output(t, &box, K_EDGE_BOUNDS, SLT_OUT_G_LO, 0), 0);
            double hi = get(t, output(t, &box, K_EDGE_BOUNDS, SLT_OUT_G_HI, 0), 0);
            check_mean_value(t, &box, &at, i);
            for (uint32_t k = 0; k < POINTS; k++, pairs++) {
                double g = get(t, output(t, &at, K_EDGE, SLT_OUT_G, 0), k);
                if (is_uncaptured(g)) continue;
                if (!lies(g, lo, hi))
                    fail_msg("%s: g of edge %d is %.17g, not in [%.17g, %.17g]", where(t, i), edge, g, lo, hi);
                for (uint32_t d = 0; d < t->p->prog->dim; d++) {
                    double slope = get(t, output(t, &at, K_EDGE, SLT_OUT_G_DX, d), k);
                    double from = get(t, output(t, &box, K_EDGE_BOUNDS, SLT_OUT_DG_LO, d), 0);
                    double to = get(t, output(t, &box, K_EDGE_BOUNDS, SLT_OUT_DG_HI, d), 0);
                    if (!lies(slope, from, to))
                        fail_msg("%s: slope %u of edge %d is %.17g, not in [%.17g, %.17g]", where(t, i), d, edge, slope,
                                 from, to);
                }
            }
        }
    io_free(&box);
    io_free(&at);
}

static SltProgram *compile(const char *name, const char *source, bool f64, uint32_t width) {
    SltOptions o = SLT_OPTIONS_INIT;
    o.f64 = f64, o.width = width, o.seed = 3, o.verify = true, o.no_cache = true, o.near_miss = 0;
    SltProgram *p = NULL;
    SltStatus s = source ? slt_compile_string(source, name, &o, &p) : slt_compile_file(name, &o, &p);
    if (s != SLT_OK) fail_msg("%s: %s\n%s", name, slt_last_error(p), slt_diagnostics_text(p));
    SltError err = {0};
    bool needs[K_KINDS] = {[K_VALUE] = true, [K_REGION] = true,      [K_EVENT] = true,         [K_BOUNDS] = true,
                           [K_EDGE] = true,  [K_EDGE_BOUNDS] = true, [K_WRITTEN_BOUNDS] = true};
    if (api_kernels(p, needs, &err) != SLT_OK) fail_msg("%s: %s", name, err.text);
    return p;
}

/* least: share of the boxes that must come out settled. */
static void run(const char *name, const char *source, double least) {
    static const uint32_t widths[] = {8, 4, 1, 16, 0, 32}; /* 0: the machine's */
    static uint32_t programs_run;
    for (int f64 = 0; f64 < 2; f64++) {
        static Case t;
        t = (Case){.name = name, .p = compile(name, source, f64, widths[programs_run++ % 6]), .f64 = f64, .random = 1};
        io_make(&t.box, t.p);
        io_make(&t.at, t.p);
        uint32_t settled = 0;
        for (uint32_t r = 0; r < rounds; r++) {
            make_boxes(&t);
            make_points(&t);
            call(&t, &t.box, K_BOUNDS, BOXES);
            if (!r) compare_interpreted(&t, &t.box, K_BOUNDS, BOXES);
            check_values(&t);
            settled += check_pieces(&t);
            check_list(&t);
            check_edges(&t);
        }
        double share = settled / (double)(rounds * BOXES);
        if (getenv("SHOW")) printf("%-40s %s settled %.3f\n", name, f64 ? "f64" : "f32", share);
        if (share < least) fail_msg("%s: %.3f of the boxes are settled", name, share);
        io_free(&t.box);
        io_free(&t.at);
        slt_program_free(t.p);
    }
}

/* g in binary64: as it is written, which edge makes that of a square of a length, is what it is on a box of one point.
 */
static double exact_g(Case *t, uint32_t k) {
    return t->p->fn[K_WRITTEN_BOUNDS] ? get(t, output(t, &t->at, K_WRITTEN_BOUNDS, SLT_OUT_G_LO, 0), k)
                                      : get(t, output(t, &t->at, K_EDGE, SLT_OUT_G, 0), k);
}

/* g in binary32 differs from g in binary64, which stands for the exact one, by no more than the error that is stated.
 * Constants and parameters of the source are numbers of binary32. */
static void rounding(const char *name, const char *source) {
    static Case t, wide;
    t = (Case){.name = name, .p = compile(name, source, false, 8), .random = 5};
    wide = (Case){.name = name, .p = compile(name, source, true, 4), .f64 = true};
    io_make(&t.box, t.p);
    io_make(&t.at, t.p);
    io_make(&wide.at, wide.p);
    double ratio = 0;
    uint32_t compared = 0;
    for (uint32_t edge = 0; edge < t.p->nedges; edge++) {
        make_boxes(&t);
        make_points(&t);
        for (uint32_t k = 0; k < ROOM; k++)
            for (uint32_t d = 0; d < 3; d++)
                for (int end = IN_X0; end <= IN_H0; end += IN_H0 - IN_X0)
                    set(&wide, wide.at.in[end + d], k, get(&t, t.at.in[IN_X0 + d], k));
        t.box.args.site = t.at.args.site = wide.at.args.site = (int32_t)edge;
        for (uint32_t k = 0; k < ROOM; k++)
            set(&t, t.at.in[IN_BOUNDARY], k, 1), set(&wide, wide.at.in[IN_BOUNDARY], k, 1);
        for (uint32_t k = 0; k < BOXES; k++) set(&t, t.box.in[IN_BOUNDARY], k, 1);
        for (uint32_t k = 0; k < ROOM; k++)
            ((int32_t *)t.at.in[IN_K0])[k] = ((int32_t *)wide.at.in[IN_K0])[k] = ((int32_t *)t.box.in[IN_K0])[k] = 2;
        call(&t, &t.box, K_EDGE_BOUNDS, BOXES);
        call(&t, &t.at, K_EDGE, ROOM);
        call(&wide, &wide.at, wide.p->fn[K_WRITTEN_BOUNDS] ? K_WRITTEN_BOUNDS : K_EDGE, ROOM);
        for (uint32_t i = 0; i < BOXES; i++) {
            if (((int32_t *)output(&t, &t.box, K_EDGE_BOUNDS, SLT_OUT_G_STATE, 0))[i] & SLT_EDGE_JUMPS) continue;
            double error = get(&t, output(&t, &t.box, K_EDGE_BOUNDS, SLT_OUT_G_ERROR, 0), i);
            for (uint32_t k = i * POINTS; k < (i + 1) * POINTS; k++, compared++) {
                double near = get(&t, output(&t, &t.at, K_EDGE, SLT_OUT_G, 0), k);
                if (is_uncaptured(near)) continue;
                double exact = exact_g(&wide, k), off = fabs(near - exact);
                if (!(off <= error)) fail_msg("%s: g of edge %u is off by %g, not %g", where(&t, i), edge, off, error);
                if (error > 0) ratio = fmax(ratio, off / error);
            }
        }
    }
    if (getenv("SHOW")) printf("%-20s at most %.3f of the stated error\n", name, ratio);
    assert_true(compared > 1000);
    if (ratio < 0.02) fail_msg("%s: the stated error is %g times too large", name, 1 / ratio);
    io_free(&t.box);
    io_free(&t.at);
    io_free(&wide.at);
    slt_program_free(t.p);
    slt_program_free(wide.p);
}

static void rounding_of_g(void **state) {
    (void)state;
    rounding("circle", "param float r = 0.375; [Domain(-1.0, 1.0)] shader float main(float2 x) {\n"
                       "  [Disc] return length(x - 0.125) < r ? 1.0 : 0.0; }");
    rounding("nearest of far", /* what best was before it was set at all brings no error along */
             "param float2 p[3] = {float2(0.25, 0.5), float2(-0.5, 0.125), float2(0.0, -0.625)};\n"
             "[Domain(-1.0, 1.0)] shader float main(float2 x) {\n"
             "  float best = 1e9; float f = 0.0;\n"
             "  for (int i = 0; i < 3; i++) { float2 v = x - p[i]; float d = dot(v, v);\n"
             "    [Disc] if (d < best) { best = d; f = float(i); } }\n"
             "  return f; }");
    rounding("balls", "param float2 p[3] = {float2(0.25, 0.5), float2(-0.5, 0.125), float2(0.0, -0.625)};\n"
                      "[Domain(-1.0, 1.0)] shader float main(float2 x) { float s = 0.0;\n"
                      "  for (int i = 0; i < 3; i++) { float2 d = x - p[i]; s += 0.0625 / (dot(d, d) + 0.03125); }\n"
                      "  [Disc] return s < 1.5 ? 1.0 : 0.0; }");
    rounding("waves",
             "param float w = 5.0; [Domain(-1.0, 1.0)] shader float main(float2 x) {\n"
             "  float g = sin(w * x.x + exp(x.y)) * cos(3.0 * x.y) + pow(x.x + 1.25, 1.5) - atan2(x.y, x.x + 2.0);\n"
             "  g += log(x.y + 1.5) * tanh(x.x) + sqrt(x.x + 1.125); [Disc] return g < 0.25 ? 1.0 : 0.0; }");
    rounding("zone plate", "param float w = 64.0; [Domain(0.25, 1.0)] shader float main(float2 x) {\n"
                           "  [Disc] return sin(w * dot(x, x)) < 0.0 ? 1.0 : 0.0; }");
    rounding("nearest",
             "param float2 p[4] = {float2(0.25, 0.5), float2(-0.5, 0.125), float2(0.0, -0.625), float2(1.0)};\n"
             "[Domain(-1.0, 1.0)] shader float main(float2 x) { float best = 16.0, c = 0.0;\n"
             "  for (int i = 0; i < 4; i++) { float2 d = x - p[i]; float q = dot(d, d);\n"
             "    [Disc] if (q < best) { best = q; c = float(i); } } return c; }");
}

static void circle(void **state) {
    (void)state;
    run("circle",
        "param float r = 0.4; [Domain(-1.0, 1.0)] shader float main(float2 x) {\n"
        "  [Disc] if (length(x) < r) return 1.0 + 0.5 * sin(3.0 * x.x) * cos(2.0 * x.y); return 0.25; }",
        0.5);
}

static void examples(void **state) {
    (void)state;
    run(SALTUS_TEST_DIR "/../examples/circle/circle.salt", NULL, 0.3);
    run(SALTUS_TEST_DIR "/../examples/csg/csg.salt", NULL, 0.3);
    run(SALTUS_TEST_DIR "/../examples/painterly_discs/discs.salt", NULL, 0.2);
    run(SALTUS_TEST_DIR "/../examples/voronoi_mosaic/mosaic.salt", NULL, 0.2);
}

static void other_examples(void **state) {
    (void)state;
    run(SALTUS_TEST_DIR "/../examples/implicit_flower/flower.salt", NULL, 0.1);
    run(SALTUS_TEST_DIR "/../examples/raymarch/raymarch.salt", NULL, 0.1);
    run(SALTUS_TEST_DIR "/../examples/binary_grid/grid.salt", NULL, 0.1);
    run(SALTUS_TEST_DIR "/../examples/checkerboard_tree/tree.salt", NULL, 0.1);
    run(SALTUS_TEST_DIR "/../examples/high_frequency/zone_plate.salt", NULL, 0.1);
    run(SALTUS_TEST_DIR "/../examples/thin_bands/bands.salt", NULL, 0.1);
}

static void programs(void **state) {
    (void)state;
    static const char *const names[] = {"circle", "discs",  "grid_of_waves", "line", "many",
                                        "march",  "nested", "random",        "stops"};
    for (size_t k = 0; k < sizeof names / sizeof *names; k++) {
        char path[400];
        snprintf(path, sizeof path, SALTUS_TEST_DIR "/programs/%s.salt", names[k]);
        run(path, NULL, 0);
    }
}

/* x and floor(x / y) go together: what is left of a division keeps to its period, however wide the box is, and whatever
 * rounding makes of the quotient. */
static void remainders(void **state) {
    (void)state;
    run("remainders",
        "param float w = 0.3; param float v = -0.07; [Domain(-4.0, 4.0)] shader float3 main(float2 x) {\n"
        "  float a = x.x - w * floor(x.x / w), b = x.y - w * round(x.y / w), c = x.x - v * floor(x.x / v);\n"
        "  float d = x.y - 0.7 * ceil(x.y / 0.7), e = frac(x.x * 3.7 + w), s = x.y - floor(x.y / w) * w;\n"
        "  [Disc] float n = floor(x.y / w); float t = x.y - w * n;\n"
        "  float3 f = float3(a + e, b - c, d + s);\n"
        "  [Disc] if (a + b < 0.2) f = float3(t, e, 1.0); return f; }",
        0);
    run("periods", /* f hangs on remainders by whether they exceed what they never do, and is settled everywhere */
        "param float w = 0.3; [Domain(-4.0, 4.0)] shader float main(float2 x) {\n"
        "  float a = x.x - w * floor(x.x / w), b = x.y - w * round(x.y / w), f = 0.0;\n"
        "  [Disc] if (a < -0.001) f = 1.0; [Disc] if (a > w + 0.001) f = 2.0;\n"
        "  [Disc] if (abs(b) > 0.5 * w + 0.001) f = 3.0; return f; }",
        1);
    run("fractions",
        "[Domain(-4.0, 4.0)] shader float main(float2 x) {\n"
        "  [Disc] if (frac(3.0 * x.x + x.y) < 0.0) return 1.0; return 0.0; }",
        1);
}

/* Structure hides nothing: behind guards that are open, in loops that may have been left, in arrays, functions and
 * structs g is known with its gradient. */
static void structure(void **state) {
    (void)state;
    jumping = continuous = seconds = 0;
    run("structure",
        "struct Ball { float2 at; float r; };\n"
        "param Ball balls[6] = init(place);\n"
        "Ball place(int i) { Ball b; b.at = 0.2 + 0.6 * rand2(); b.r = 0.1 + 0.1 * rand(); return b; }\n"
        "float inside(float2 x, Ball b) { return b.r - length(x - b.at); }\n"
        "shader float main(float2 x) {\n"
        "  float d[6], f = 0.1, m = -9.0; int best = 0;\n"
        "  for (int i = 0; i < 6; i++) d[i] = inside(x, balls[i]);\n"
        "  for (int i = 0; i < 6; i++) {\n"
        "    [Disc] if (d[i] > 0.0) {\n"
        "      [Disc] if (d[i] > 0.05) f += 0.5; else f = 0.2 * float(i);\n"
        "      [Disc] if (x.x + x.y * 0.3 > 0.8) { f += 1.0; break; } } }\n"
        "  for (int i = 0; i < 6; i++) { [Disc] if (d[i] > m) { m = d[i]; best = i; } }\n"
        "  return f + balls[best].r; }",
        0.5);
    assert_int_equal(jumping, 0);
    run(SALTUS_TEST_DIR "/programs/nested.salt", NULL, 0.5);
    assert_int_equal(jumping, 0);
    assert_true(continuous > 100 && seconds > 20);
}

/* Boundary functions that jump where no site says so: gradients know nothing of it. */
static void jumping_g(void **state) {
    (void)state;
    static const struct {
        const char *name, *g;
    } tricks[] = {
        {"floor", "x.y - p * floor(4.0 * x.x + 0.137)"},
        {"int", "x.y - p * float(int(4.0 * x.x + 0.137))"},
        {"uint", "x.y - p * float(uint(4.0 * x.x + 0.137))"},
        {"choice", "x.y - (x.x < 0.3 ? p : 2.0 * p)"},
        {"min hides", "x.y - min(p, sqrt(x.x - 0.4))"},
        {"max hides", "x.y - p * max(0.5, log(x.x - 0.4))"},
        {"pole", "x.y - clamp(p / (x.x - 0.43), 0.1, 0.6)"},
        {"narrowed", "x.y - (bits(x.x) > 0.3 ? p : bits(x.x))"},
        {"infinite", "x.y - 1.0 / (1.0 + p / abs(x.x - 0.5))"},
        {"not a number", "x.y - (isnan(sqrt(x.x - 0.4)) ? p : 2.0 * p)"},
        {"overflow", "x.y - min(p, exp(exp(exp(9.0 * x.x))) - exp(exp(exp(9.0 * x.x))))"},
        {"tangent", "x.y - clamp(tan(4.0 * x.x), 0.1, 0.3)"},
        {"angle", "x.y - p * atan2(x.x - 0.5, x.y - 2.0)"},
        {"sign", "x.y - p * sign(x.x - 0.4)"},
        {"frac", "x.y - p * frac(3.0 * x.x)"},
        {"fmod", "x.y - fmod(x.x, p)"},
        {"round", "x.y - p * round(5.0 * x.x)"},
        {"ceil", "x.y - p * ceil(5.0 * x.x)"},
        {"step", "x.y - p * step(0.37, x.x)"},
        {"bits", "x.y - p * float(asuint(x.x) & 255u) / 255.0"},
        {"parameter", "x.y - list[int(4.0 * x.x)]"},
        {"array", "x.y - table(x.x, p)"},
        {"loop", "x.y - count(x.x, p)"},
        {"left", "x.y - leave(x.x, p)"},
        {"integers", "x.y - p * float((int(16.0 * x.x) * 7 + 3) % 5 / 2)"},
        {"remainder", "x.y - p * float(hash(uint(9.0 * x.x)) % 3u)"},
        {"power", "x.y - p * pow(x.x - 0.5, -1.0)"},
        {"and", "x.y - (x.x > 0.3 && x.x < 0.7 || x.y > 0.9 ? p : 0.1)"},
        {"logarithm", "x.y - p * min(log(x.x - 0.2), 0.5)"},
        {"refracted", "x.y - p * refract(normalize(float2(x.x, -0.4)), float2(0.0, 1.0), 1.4).x"},
    };
    for (size_t k = 0; k < sizeof tricks / sizeof *tricks; k++) {
        char source[2000];
        snprintf(
            source, sizeof source,
            "param float p = 0.21; param float list[5] = {0.1, 0.4, 0.2, 0.7, 0.3};\n"
            "float table(float u, float v) { float t[4]; t[0] = v; t[1] = 0.1; t[2] = 2.0 * v;\n"
            "  t[int(3.0 * u)] = 0.55; return t[int(4.0 * u)]; }\n"
            "float count(float u, float v) { float s = 0.0; [MaxIters(9)] for (int i = 0; i < int(6.0 * u); i++) s += 0.5 * v; return s; }\n"
            "float leave(float u, float v) { float s = 0.0; for (int i = 0; i < 9; i++) {\n"
            "  s += 0.1; if (s > u) break; } return s * v * 5.0; }\n"
            "float bits(float u) { return asfloat(0x7f700000u + uint(2.0e6 * u)); }\n"
            "[Domain(0.0, 1.0)] shader float main(float2 x) {\n"
            "  [NoDisc] float g = %s;\n"
            "  float f = 0.25; [Disc] if (g < 0.0) f = 1.0; return f; }",
            tricks[k].g);
        run(tricks[k].name, source, 0);
    }
    assert_true(jumping > 300 && continuous > 300 && seconds > 100);
}

int main(int argc, char **argv) {
    if (argc > 1) rounds = (uint32_t)atoi(argv[1]);
    const struct CMUnitTest tests[] = {cmocka_unit_test(circle),     cmocka_unit_test(rounding_of_g),
                                       cmocka_unit_test(examples),   cmocka_unit_test(other_examples),
                                       cmocka_unit_test(programs),   cmocka_unit_test(structure),
                                       cmocka_unit_test(remainders), cmocka_unit_test(jumping_g)};
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    printf("%llu pairs, %llu jumps, %llu given\n", (unsigned long long)pairs, (unsigned long long)jumps,
           (unsigned long long)given);
    return failed;
}
