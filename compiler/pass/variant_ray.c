/* What sites of rays add to the variants: the window of a pair, and the signature that tells near hits from far
 * ones.
 *
 * No number per point tells which piece of a geometry a ray sees: around the end of a ridge the two sides are
 * connected. So pairs are compared. `region` and `sides` carry a signature of the depths at which rays hit, continuous
 * as long as no silhouette is passed; where it jumps, `event` decides: of two hits the nearer one must run into
 * something that rises and falls again (its top) before the farther one. The boundary function of such a pair is the
 * clearance over the stretch of the ray around that top: below 0 for the near ray, above 0 for the far one, which
 * passes over everything in front of its hit. Shadow edges are the same, between a blocked and a free ray. See
 * docs/estimators.md. */
#include "compiler/pass/variant.h"

static Inst *find_window(Inst *v, int64_t site, uint32_t stamp) {
    if (v->op == OP_window) return v->imm.i / 2 == site ? v : NULL;
    if (v->tag == stamp) return NULL;
    v->tag = stamp;
    for (uint32_t a = v->nargs; a-- > 0;) {
        if (variant_is_site(v) && a == 1) continue; /* the site's own g looks through this window */
        Inst *w = find_window(v->args[a], site, stamp);
        if (w) return w;
    }
    for (uint32_t r = 0; r < v->nregions; r++) /* a march looks through it in its loop */
        for (Inst *i = v->region[r]->first; i; i = i->next) {
            Inst *w = find_window(i, site, stamp);
            if (w) return w;
        }
    return NULL;
}

Inst *variant_window_of(Fn *fn, Inst *site) {
    walk_clear_tags(fn->body);
    Inst *w = find_window(site->args[1], site->imm.i, 1);
    if (!w) ice(fn->session, "a ray's site without a window");
    return w;
}

static void windows(Fn *fn, Block *b, Inst *(*make)(Builder *, Inst *)) {
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) windows(fn, i->region[r], make);
        if (i->op != OP_window) continue;
        Builder at = ir_before(fn, i);
        at.fold = true;
        walk_forward(fn, i, make(&at, i));
    }
}

static Inst *partner(Builder *b, Inst *v) { return ir_special(b, OP_partner, (IrType)v->type, 1, &v, (Imm){0}); }

typedef struct Pair {
    Inst *near_t, *far_t, *top, *margin; /* t of the two hits; top: of the nearer */
} Pair;

/* The window of a march (opt_marches.c), by its margin: what rises and falls again is not looked for behind the nearer
 * end. The farther ray tells: it has come away from something before it hits. */
static bool of_march(const Inst *w) { return w->args[2]->op == OP_constf && w->args[2]->imm.f < 0; }

/* Where a march would have arrived that a limit ended; INFINITY of all others. */
static Inst *cut_at(Builder *b, Inst *t) {
    Inst *cut = ir_emit2(b, OP_flt, t, ir_constf(b, 0));
    return ir_select(b, cut, ir_emit1(b, OP_fneg, t), ir_constf(b, __builtin_inf()));
}

static Inst *hit_at(Builder *b, Inst *t) {
    return ir_select(b, ir_emit2(b, OP_flt, t, ir_constf(b, 0)), ir_constf(b, __builtin_inf()), t);
}

static Pair pair_of(Builder *b, Inst *w) {
    Inst *t = of_march(w) ? hit_at(b, w->args[0]) : w->args[0], *other = partner(b, t);
    Inst *nearer = of_march(w) ? ir_emit2(b, OP_flt, other, t) : ir_emit2(b, OP_flt, t, other);
    return (Pair){ir_emit2(b, OP_fmin, t, other), ir_emit2(b, OP_fmax, t, other),
                  ir_select(b, nearer, w->args[1], partner(b, w->args[1])),
                  ir_emit2(b, OP_fmax, w->args[2], partner(b, w->args[2]))};
}

/* Of a march: hi is halfway between. Where the farther ray has passed nothing and a limit ended it, both are
 * halfway between where the two arrive. */
static Inst *of_march_pair(Builder *b, Inst *w) {
    Pair p = pair_of(b, w);
    Inst *cut = cut_at(b, w->args[0]), *end = ir_emit2(b, OP_fmin, cut, partner(b, cut));
    Inst *passed = ir_emit2(b, OP_band, ir_emit2(b, OP_fle, p.near_t, p.top), ir_emit2(b, OP_flt, p.top, end));
    Inst *between = ir_emit2(b, OP_fmul, ir_constf(b, 0.5), ir_emit2(b, OP_fadd, p.near_t, end));
    end = ir_select(b, passed, ir_constf(b, __builtin_inf()), between);
    if (!(w->imm.i & 1)) return end;
    Inst *half =
        ir_emit2(b, OP_fmul, ir_constf(b, 0.5),
                 ir_emit2(b, OP_fadd, ir_select(b, ir_emit2(b, OP_flt, p.top, p.far_t), p.top, p.near_t), p.far_t));
    return ir_emit2(b, OP_fmin, half, end);
}

/* lo = near - margin; hi = top + margin, but well before the far hit, where the far ray touches ground. Without a top
 * before the far hit there is nothing to look through. */
static Inst *of_pair(Builder *b, Inst *w) {
    if (of_march(w)) return of_march_pair(b, w);
    Pair p = pair_of(b, w);
    if (!(w->imm.i & 1))
        return ir_select(b, ir_emit2(b, OP_fle, p.top, p.far_t), ir_emit2(b, OP_fsub, p.near_t, p.margin),
                         ir_constf(b, __builtin_inf()));
    return ir_emit2(b, OP_fmin, ir_emit2(b, OP_fadd, p.top, p.margin),
                    ir_emit2(b, OP_fmul, ir_constf(b, 0.5), ir_emit2(b, OP_fadd, p.top, p.far_t)));
}

static Inst *of_input(Builder *b, Inst *w) { return ir_input(b, w->imm.i & 1 ? IN_WINDOW1 : IN_WINDOW0); }

void variant_windows_of_pairs(Fn *fn) {
    windows(fn, fn->body, of_pair);
    walk_resolve_forwards(fn->body);
}

void variant_windows_of_inputs(Fn *fn) {
    windows(fn, fn->body, of_input);
    walk_resolve_forwards(fn->body);
}

bool variant_has_windows(const Fn *fn) { return variant_has_site(fn, SITE_SILHOUETTE, SITE_MESH_SHADOW); }

bool variant_has_depth(const Fn *fn) { return variant_has_site(fn, SITE_SILHOUETTE, SITE_SILHOUETTE); }

/* About log2 of t, linear between powers of two: only comparisons matter. Events are weighted by their keys, so that
 * the changes of two do not cancel. */
static Inst *depth_of(Builder *b, Inst *site, Inst *t) {
    Inst *bits = ir_emit2(b, OP_isub, ir_emit1(b, OP_fasuint, t), ir_consti(b, 0x3f800000));
    Inst *weight =
        ir_emit2(b, OP_fadd, ir_constf(b, 0.5),
                 ir_emit2(b, OP_fmul, ir_emit1(b, OP_u2f, variant_event_key(b, site)), ir_constf(b, 0x1p-33)));
    return ir_emit2(b, OP_fmul, ir_emit1(b, OP_i2f, bits), ir_emit2(b, OP_fmul, weight, ir_constf(b, 0x1p-23)));
}

static bool touches_silhouette(Thread *t, const Inst *i) {
    return i->op == OP_site && variant_site_info(t->fn, i)->kind == SITE_SILHOUETTE;
}

static bool depth_at(Thread *t, Inst *i) {
    Inst *w = variant_window_of(t->fn, i);
    Builder b = ir_after(t->fn, i);
    b.fold = true;
    Inst *sum = ir_emit2(&b, OP_fadd, t->value[0], depth_of(&b, i, w->args[0]));
    t->value[0] = ir_select(&b, i, sum, t->value[0]);
    return true;
}

Inst *variant_depth(Fn *fn) {
    Builder b = fn->body->first ? ir_before(fn, fn->body->first) : ir_at_end(fn, fn->body);
    Thread t = {.fn = fn, .n = 1, .at = depth_at, .touches = touches_silhouette};
    t.value[0] = ir_constf(&b, 0);
    thread_block(&t, fn->body);
    return t.value[0];
}

Inst *variant_depths_apart(Builder *b, Inst *site, Inst *w) {
    Inst *mine = depth_of(b, site, w->args[0]);
    Inst *jump = ir_emit1(b, OP_fabs, ir_emit2(b, OP_fsub, mine, partner(b, mine)));
    Inst *hits = ir_emit2(b, OP_band, site, partner(b, site));
    return ir_emit2(b, OP_band, hits, ir_emit2(b, OP_flt, ir_input(b, IN_THRESHOLD), jump));
}

Inst *variant_ridge_between(Builder *b, Inst *w) {
    Pair p = pair_of(b, w);
    Inst *between = ir_emit2(b, OP_flt, p.top, p.far_t);
    return of_march(w) ? ir_emit2(b, OP_band, between, ir_emit2(b, OP_fle, p.near_t, p.top)) : between;
}

/* A query that a site asks. */
static bool finds_hits(const Inst *i) {
    return i->op == OP_query &&
           (query_rows[i->imm.query.what].role == ROLE_SILHOUETTE || query_rows[i->imm.query.what].role == ROLE_SHADOW);
}

static uint32_t collect(Block *b, uint32_t n, Inst **search) {
    for (Inst *i = b->first; i && n < SLT_WITNESSES; i = i->next) {
        if (finds_hits(i)) search[n++] = i;
        for (uint32_t r = 0; i->op != OP_loop && r < i->nregions; r++) n = collect(i->region[r], n, search);
    }
    return n;
}

uint32_t variant_searches(const Fn *fn, Inst *search[SLT_WITNESSES]) {
    return variant_has_windows(fn) ? collect(fn->body, 0, search) : 0;
}

static uint32_t number_of(const Thread *t, const Inst *i) {
    Inst *const *search = t->user;
    for (uint32_t k = 0; k < t->n; k++)
        if (search[k] == i) return k;
    return t->n;
}

static bool touches_search(Thread *t, const Inst *i) { return number_of(t, i) < t->n; }

static bool note_witness(Thread *t, Inst *i) {
    uint32_t k = number_of(t, i);
    if (k == t->n) return false;
    Builder b = ir_after(t->fn, i);
    t->value[k] = ir_emit2(&b, OP_iadd, i, ir_consti(&b, VARIANT_FOUND));
    return true;
}

void variant_witnesses(Fn *fn, uint32_t n, Inst *const *search, Outputs *o) {
    Builder b = ir_before(fn, fn->body->first);
    Thread t = {.fn = fn, .n = n, .at = note_witness, .touches = touches_search, .user = (void *)search};
    for (uint32_t k = 0; k < n; k++) t.value[k] = ir_consti(&b, 0);
    if (n) thread_block(&t, fn->body);
    for (uint32_t k = 0; k < n; k++) variant_output(o, SLT_OUT_WITNESS, k, t.value[k]);
}

void variant_use_witnesses(Fn *fn) {
    Inst *search[SLT_WITNESSES];
    uint32_t n = variant_searches(fn, search);
    for (uint32_t k = 0; k < n; k++) {
        Inst *i = search[k];
        Builder b = ir_before(fn, i);
        Inst *found = ir_input(&b, (InputSlot)(IN_WITNESS0 + k)),
             *id = ir_emit2(&b, OP_isub, found, ir_consti(&b, VARIANT_FOUND));
        Inst *br = ir_if(&b, ir_emit2(&b, OP_ieq, found, ir_consti(&b, 0)));
        br->imm.i = IR_IF_RARE;
        Builder in = ir_at_end(fn, br->region[0]), out = ir_at_end(fn, br->region[1]);
        Inst *again = ir_special(&in, OP_query, TY_INT, i->nargs, i->args, i->imm);
        ir_yield(&in, 1, &again);
        ir_yield(&out, 1, &id);
        walk_forward(fn, i, ir_proj(&b, br, 0));
    }
    if (n) walk_resolve_forwards(fn->body);
}
