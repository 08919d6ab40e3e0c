/* event (the paper's branch index): which event separates the two ends of a segment.
 *
 * The ends run in lockstep as neighbouring lanes. At every site that both execute, the lanes compare their decisions;
 * the first that differs is the event: before it both ran the same code, so its g is one continuous function on the
 * segment and changes sign. After the event nothing matters, and loops end. Output, per lane: site (-1: none), the
 * lane's own g, its loop indices, the boundary of an integer-valued site and the two ends of a ray's window, or the
 * line of a mesh. Where the rays of a pair hit different faces of a mesh and nobody knows whether a line parts them,
 * the site is -2, and nothing behind is asked. With paper_argmin instead the executed event with the smallest |g| of
 * the lane's own end, as in the paper: wrong up to 83 % of the time where scales differ. */
#include <string.h>

#include "compiler/pass/variant.h"

enum { V_FOUND, V_SITE, V_G, V_BOUNDARY, V_WINDOW, V_K = V_WINDOW + 2 };

typedef struct Event {
    uint32_t depth;
    bool argmin;
    MeshLine *line, *told; /* by site of a mesh: the queries for its line, and what takes their place */
} Event;

/* The window of a ray's site, or NULL. */
static Inst *window_of(Fn *fn, Inst *i) {
    SiteKind kind = variant_site_info(fn, i)->kind;
    return ir_site_of_ray(kind) && !ir_site_of_mesh(kind) ? variant_window_of(fn, i) : NULL;
}

static bool is_mesh(const Fn *fn, const Inst *i) { return ir_site_of_mesh(variant_site_info(fn, i)->kind); }

/* g of the lane's own end at site i, and what its function needs besides x, the same in both lanes: the boundary of the
 * lower integer, or the window. */
static Inst *own_g(Builder *b, Fn *fn, const Event *e, Inst *i, Inst **boundary, Inst *window[2]) {
    *boundary = window[0] = window[1] = ir_constf(b, 0);
    if (is_mesh(fn, i)) {
        for (int k = 0; k < 2; k++) window[k] = ir_emit1(b, OP_i2f, e->told[i->imm.i].number[k]);
        return i->args[1];
    }
    Inst *w = window_of(fn, i);
    for (int end = 0; w && end < 2; end++)
        window[end] = ir_special(b, OP_window, TY_FLT, 3, w->args, (Imm){.i = 2 * i->imm.i + end});
    if (i->op == OP_site) return i->args[1];
    Inst *other = ir_special(b, OP_partner, TY_FLT, 1, &i, (Imm){0});
    *boundary = variant_boundary(b, variant_site_info(fn, i)->kind, ir_emit2(b, OP_fmin, i, other));
    return ir_emit2(b, OP_fsub, i->args[1], *boundary);
}

/* The top behind the nearer hit is looked for only as far as the farther hit (a miss is at infinity): see
 * variant_ridge_between. */
static void climb_to_partner(Thread *t, Inst *i) {
    Builder b = ir_before(t->fn, i);
    Inst *hit = i->args[SLT_RAY_T0], *other = ir_special(&b, OP_partner, TY_FLT, 1, &hit, (Imm){0});
    Inst *farther = ir_emit2(&b, OP_flt, other, hit);
    ir_replace_arg(i, SLT_RAY_T0, ir_select(&b, farther, ir_constf(&b, __builtin_inf()), hit));
    ir_replace_arg(i, SLT_RAY_T1, ir_emit2(&b, OP_fmin, i->args[SLT_RAY_T1], other));
}

static void find_lines(Event *e, Fn *fn, const Block *body) {
    for (Inst *i = body->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) find_lines(e, fn, i->region[r]);
        if (variant_is_site(i) && is_mesh(fn, i)) e->line[i->imm.i] = variant_mesh_line(fn, i);
    }
}

/* A number of a line becomes what the pair is told. */
static bool ask_line(Thread *t, Inst *i) {
    Event *e = t->user;
    MeshLine told = {0};
    uint32_t which = 0;
    for (uint32_t s = 0; s < t->fn->nsites; s++) { /* equal rays are asked once */
        if (e->line[s].number[0] != i && e->line[s].number[1] != i) continue;
        which = e->line[s].number[1] == i;
        if (!e->told[s].number[0])
            e->told[s] = told.number[0] ? told : variant_mesh_ask(t->fn, i, t->fn->sites[s].kind, t->value[V_FOUND]);
        told = e->told[s];
    }
    if (told.number[0]) walk_forward(t->fn, i, told.number[which]);
    return told.number[0];
}

/* Once the pair's event is found, the pair's rays are empty: t0 behind t1. */
static bool stop_search(Thread *t, Inst *i) {
    const Event *e = t->user;
    if (variant_asks_line(i)) return ask_line(t, i);
    if (e->argmin) return false;
    if (query_rows[i->imm.query.what].role == ROLE_TOP) climb_to_partner(t, i);
    if (ir_is_const(t->value[V_FOUND])) return false;
    Builder b = ir_before(t->fn, i);
    ir_replace_arg(i, SLT_RAY_T0,
                   ir_select(&b, t->value[V_FOUND], ir_constf(&b, __builtin_inf()), i->args[SLT_RAY_T0]));
    return false;
}

static bool touches_event(Thread *t, const Inst *i) {
    (void)t;
    return variant_is_site(i) || i->op == OP_query;
}

static bool event_at(Thread *t, Inst *i) {
    Event *e = t->user;
    if (i->op == OP_query) return stop_search(t, i);
    Builder b = ir_after(t->fn, i);
    b.fold = true;
    Inst *hit, *certain = NULL, *line = is_mesh(t->fn, i) ? e->told[i->imm.i].number[0] : NULL;
    if (e->argmin) {
        Inst *boundary, *window[2], *g = own_g(&b, t->fn, e, i, &boundary, window);
        hit = ir_emit2(&b, OP_flt, ir_emit1(&b, OP_fabs, g), ir_emit1(&b, OP_fabs, t->value[V_G]));
        if (line) hit = ir_emit2(&b, OP_band, hit, ir_emit2(&b, OP_ile, ir_consti(&b, 0), line));
    } else if (line) { /* asked of pairs that differ and have no event yet */
        hit = ir_emit2(&b, OP_ine, line, ir_consti(&b, SLT_WITNESS_NONE));
    } else {
        Inst *other = ir_special(&b, OP_partner, (IrType)i->type, 1, &i, (Imm){0});
        Inst *differ = ir_emit2(&b, i->op == OP_site ? OP_bxor : OP_fne, i, other);
        if (variant_site_info(t->fn, i)->kind == SITE_SILHOUETTE) {
            /* Where depths differ, the branch looks for a ridge between. */
            certain = differ;
            differ = ir_emit2(&b, OP_bor, differ, variant_depths_apart(&b, i, variant_window_of(t->fn, i)));
        }
        Inst *both = ir_special(&b, OP_both, TY_BOOL, 0, NULL, (Imm){0});
        hit = ir_emit2(&b, OP_band, ir_emit2(&b, OP_band, differ, both), ir_emit1(&b, OP_bnot, t->value[V_FOUND]));
    }
    /* Rare, so a real branch: g and the indices cost nothing elsewhere. */
    Inst *br = ir_if(&b, hit);
    br->imm.i = IR_IF_RARE;
    Builder in = ir_at_end(t->fn, br->region[0]), out = ir_at_end(t->fn, br->region[1]);
    Inst *yes[V_K + SLT_MAX_K];
    in.fold = true;
    yes[V_FOUND] = ir_constb(&in, true);
    yes[V_SITE] = ir_consti(&in, (int32_t)i->imm.i);
    if (line)
        yes[V_SITE] = ir_select(&in, ir_emit2(&in, OP_ile, ir_consti(&in, 0), line), yes[V_SITE],
                                ir_consti(&in, SLT_EVENT_UNKNOWN));
    yes[V_G] = own_g(&in, t->fn, e, i, &yes[V_BOUNDARY], &yes[V_WINDOW]);
    for (uint32_t d = 0; d < e->depth; d++) yes[V_K + d] = d + 2 < i->nargs ? i->args[d + 2] : ir_consti(&in, 0);
    if (certain) {
        Inst *sure = ir_emit2(&in, OP_bor, certain, variant_ridge_between(&in, variant_window_of(t->fn, i)));
        for (uint32_t v = 0; v < t->n; v++) yes[v] = ir_select(&in, sure, yes[v], t->value[v]);
    }
    ir_yield(&in, t->n, yes);
    ir_yield(&out, t->n, t->value);
    for (uint32_t v = 0; v < t->n; v++) t->value[v] = ir_proj(&b, br, v);
    return true;
}

static Inst *stop_when_found(Thread *t, Builder *b, Inst *flag) {
    Event *e = t->user;
    if (e->argmin) return NULL;
    return ir_emit2(b, OP_band, flag, ir_emit1(b, OP_bnot, t->value[V_FOUND]));
}

Fn *variant_event(PassCtx *ctx, const Fn *primal, const VariantOptions *o) {
    Fn *fn = variant_clone(ctx, primal, "event", true);
    opt_dce(ctx, fn);
    if (!o->paper_argmin) variant_use_witnesses(fn);
    Event e = {.depth = variant_site_depth(fn->body),
               .argmin = o->paper_argmin,
               .line = ARENA_ARRAY(fn->arena, MeshLine, fn->nsites + 1),
               .told = ARENA_ARRAY(fn->arena, MeshLine, fn->nsites + 1)};
    find_lines(&e, fn, fn->body);
    Builder b = fn->body->first ? ir_before(fn, fn->body->first) : ir_at_end(fn, fn->body);
    Thread t = {
        .fn = fn, .n = V_K + e.depth, .at = event_at, .touches = touches_event, .cont = stop_when_found, .user = &e};
    t.value[V_FOUND] = ir_constb(&b, false);
    t.value[V_SITE] = ir_consti(&b, -1);
    t.value[V_G] = ir_constf(&b, e.argmin ? __builtin_inf() : 0);
    t.value[V_BOUNDARY] = t.value[V_WINDOW] = t.value[V_WINDOW + 1] = ir_constf(&b, 0);
    for (uint32_t d = 0; d < e.depth; d++) t.value[V_K + d] = ir_consti(&b, 0);
    thread_block(&t, fn->body);
    Outputs out = {0};
    variant_output(&out, SLT_OUT_SITE, 0, t.value[V_SITE]);
    variant_output(&out, SLT_OUT_G, 0, t.value[V_G]);
    if (variant_has_site(fn, SITE_FLOOR, SITE_FMOD)) variant_output(&out, SLT_OUT_BOUNDARY, 0, t.value[V_BOUNDARY]);
    for (uint32_t d = 0; d < e.depth; d++) variant_output(&out, SLT_OUT_K, d, t.value[V_K + d]);
    for (uint32_t end = 0; variant_has_windows(fn) && end < 2; end++)
        variant_output(&out, SLT_OUT_WINDOW, end, t.value[V_WINDOW + end]);
    variant_set_outputs(fn, &out);
    variant_windows_of_pairs(fn);
    variant_drop_sites(fn);
    opt_dce(ctx, fn);
    return fn;
}
