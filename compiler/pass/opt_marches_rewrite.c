/* What opt_marches.c puts in the place of a march. */
#include <math.h>
#include <string.h>

#include "compiler/pass/march.h"

/* Slower than this h does not fall towards a surface: the ray grazes it, and a root says nothing. */
#define LEAST_SLOPE 1e-3
/* Where h falls more slowly a place is evened out by less. */
#define EVEN_SLOPE 0.05
/* A ray that runs out of steps no farther from a surface than so many eps more is of its outline. */
#define RIM 4

/* Is v in the body itself, or in an if_ of it? */
static bool is_near(const March *m, const Inst *v) {
    const Inst *owner = v->block->owner;
    return v->block == m->body || (owner && owner->op == OP_if_ && owner->block == m->body);
}

/* A value that is near, in the body; where it was not computed it is `other`. */
static Inst *in_body(const March *m, Inst *v, double other) {
    if (v->block == m->body || ir_is_const(v) || !walk_inside(v->block, m->body)) return v;
    Inst *op = v->block->owner;
    uint32_t where = v->block == op->region[1];
    Builder end = ir_at_end(m->fn, op->region[1 - where]), behind = ir_after(m->fn, op);
    ir_append_arg(m->fn, op->region[where]->last, v);
    ir_append_arg(m->fn, op->region[1 - where]->last, ir_constf(&end, other));
    return ir_proj(&behind, op, ir_nresults(op) - 1);
}

/* What is known where a march stops: how far it came before its last step; eps - h there, and in the step before, by
 * which it came; where it last came away from something; whether it hit; whether it ended for want of steps alone, and
 * g of what else would have ended it. */
enum { CAME, NEAR, WAS_NEAR, BY, ROSE, HIT, SPENT, LIMIT, STOPS };

/* Sites in [first, last) and below become their decisions; only: those alone. */
static void strip(Fn *fn, Inst *first, const Inst *last, const March *only) {
    for (Inst *i = first, *next; i && i != last; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) strip(fn, i->region[r]->first, NULL, only);
        if (i->op != OP_site && i->op != OP_siten) continue;
        bool asked = !only;
        for (uint32_t a = 0; only && a < only->nasked; a++) asked |= only->asked[a].site->imm.i == i->imm.i;
        if (asked) walk_forward(fn, i, i->args[0]);
    }
}

/* Sites of the last step stand outside of the loop: its number tells nothing apart any more. */
static void move_out(March *m, Inst *first, const Inst *last) {
    for (Inst *i = first; i && i != last; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) move_out(m, i->region[r]->first, NULL);
        if (i->op != OP_site && i->op != OP_siten) continue;
        SiteInfo *s = &m->fn->sites[i->imm.i];
        memmove(i->args + 2 + m->depth, i->args + 3 + m->depth, (i->nargs - 3 - m->depth) * sizeof *i->args);
        i->nargs--, s->depth--;
        if (s->max_events != UINT64_MAX) s->max_events /= m->loop->imm.loop.max_iters;
    }
}

/* What a march counts, its loop counts; a copy of a step, or of the loop, would count it again. */
static void drop_counts(Inst *first, const Inst *last) {
    for (Inst *i = first, *next; i && i != last; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) drop_counts(i->region[r]->first, NULL);
        if (i->op == OP_count) ir_unlink(i);
    }
}

/* The number of a carried value that is added: starts as init; its next value is set by `carry_next`. */
static uint32_t carry(Fn *fn, Inst *loop, Inst *init, Inst **param) {
    ir_append_arg(fn, loop, init);
    *param = ir_block_param(fn, loop->region[0], (IrType)init->type);
    return loop->region[0]->nparams - 2;
}

static void carry_next(Fn *fn, const Inst *loop, Inst *next) { ir_append_arg(fn, loop->region[0]->last, next); }

/* The first instruction behind `before`, or the first of the block. */
static Inst *after(const Block *b, const Inst *before) { return before ? before->next : b->first; }

/* The step, from the carried values `from`, at b: what it makes of the instructions of the body is in map. */
static void clone_step(const March *m, Builder *b, Inst *k, Inst *const *from, const Inst *last, Inst **map) {
    map[m->body->params[0]->id] = k;
    for (uint32_t c = 0; c < m->ncarried; c++) map[m->body->params[c + 1]->id] = from[c];
    Inst *before = b->before ? b->before->prev : b->block->last;
    ir_clone_insts(b, m->body, m->body->first, (Inst *)last, map);
    drop_counts(after(b->block, before), b->before);
}

static Inst *mapped(Inst *v, Inst **map) { return v->id != UINT32_MAX && map[v->id] ? map[v->id] : v; }

static Inst *way_of(const March *m, Builder *b, uint32_t c) {
    Inst *way = ir_constf(b, 1);
    for (uint32_t f = 0; f < m->nway[c]; f++) {
        Inst *factor = m->way[c][f];
        way = ir_emit2(b, OP_fmul, way, ir_is_const(factor) ? ir_constf(b, factor->imm.f) : factor);
    }
    return way;
}

/* The largest eps - h of a step, at the end of a body in which h and eps are `map`ped; above 0 where it hits. */
static Inst *nearness(const March *m, Builder *b, Inst **map) {
    Inst *most = NULL;
    for (uint32_t a = 0; a < m->nasked; a++) {
        const Asked *q = &m->asked[a];
        Inst *h = mapped(q->h, map), *eps = ir_is_const(q->eps) ? ir_constf(b, q->eps->imm.f) : mapped(q->eps, map);
        if (q->magnitude != q->h) h = ir_emit1(b, OP_fabs, h);
        Inst *s = ir_emit2(b, OP_fsub, eps, h);
        most = most ? ir_emit2(b, OP_fmax, most, s) : s;
    }
    return most;
}

/* The step at b, from the place `from`, without sites. */
static void try_step(const March *m, Builder *b, Inst *k, Inst *const *from, const Inst *last, Inst **map,
                     uint32_t ninsts) {
    Inst *before = b->before ? b->before->prev : b->block->last;
    memset(map, 0, ninsts * sizeof *map);
    clone_step(m, b, k, from, last, map);
    strip(m->fn, after(b->block, before), b->before, NULL);
}

static Inst *settled(Inst *v) {
    while (v->op == OP_COUNT) v = v->args[0]; /* forwarded */
    return v;
}

/* The place `from`, moved back by `by` along the march. */
static void move_back(const March *m, Builder *b, Inst **from, Inst *by, Inst **to) {
    for (uint32_t c = 0; c < m->ncarried; c++) {
        to[c] = from[c];
        if (!m->goes[c]) continue;
        Inst *way = ir_emit1(b, OP_detach, way_of(m, b, c));
        to[c] = ir_emit2(b, OP_fsub, from[c], ir_emit2(b, OP_fmul, way, by));
    }
}

/* Where jumps are looked for, a place that hit stands where h is half of eps, as nearly as the tangent knows and if it
 * hits there too, and not at the step that happened to be the last one: what begins there, a ray to a light, would jump
 * from one number of steps to the next. */
static void even_out(March *m, Builder *b, Inst *hit, Inst *h, Inst *slope, Inst *k, Inst **from, const Inst *last,
                     Inst **map, uint32_t ninsts) {
    Inst *eps = m->asked[0].eps, *even[MOST_CARRIED];
    eps = ir_is_const(eps) ? ir_constf(b, eps->imm.f) : settled(mapped(eps, map));
    Inst *off = ir_emit2(b, OP_fsub, h, ir_emit2(b, OP_fmul, ir_constf(b, 0.5), eps));
    Inst *over = ir_emit2(b, OP_fadd, ir_emit2(b, OP_fmul, slope, slope), ir_constf(b, EVEN_SLOPE * EVEN_SLOPE));
    move_back(m, b, from, ir_emit1(b, OP_detach, ir_emit2(b, OP_fdiv, ir_emit2(b, OP_fmul, off, slope), over)), even);
    try_step(m, b, k, even, last, map, ninsts);
    for (uint32_t i = 0; i < ninsts; i++)
        if (map[i]) map[i] = settled(map[i]);
    Inst *good = ir_emit2(b, OP_flt, ir_constf(b, 0), nearness(m, b, map));
    Inst *looked = ir_emit2(b, OP_band, ir_special(b, OP_stands, TY_BOOL, 0, NULL, (Imm){0}), hit);
    for (uint32_t c = 0; c < m->ncarried; c++)
        if (m->goes[c]) from[c] = ir_select(b, ir_emit2(b, OP_band, looked, good), even[c], from[c]);
}

/* Moves the place `from` by what the root of h does: a Newton step whose value is 0. */
static void follow_root(March *m, Builder *b, Inst *hit, Inst *k, Inst **from, const Inst *last, uint32_t ninsts,
                        Arena *scratch) {
    Inst *seeded[MOST_CARRIED], *h[2], **map = ARENA_ARRAY(scratch, Inst *, ninsts);
    for (uint32_t c = 0; c < m->ncarried; c++)
        seeded[c] =
            m->goes[c] ? ir_special(b, OP_seed, TY_FLT, 2, (Inst *[]){from[c], way_of(m, b, c)}, (Imm){0}) : from[c];
    for (uint32_t copy = 0; copy < 2; copy++) { /* one to be differentiated along the march, one for the derivative */
        try_step(m, b, k, copy ? from : seeded, last, map, ninsts);
        h[copy] = settled(mapped(m->asked[0].h, map));
    }
    Inst *slope = ir_special(b, OP_along, TY_FLT, 1, h, (Imm){0});
    Inst *falls = ir_emit2(b, OP_flt, ir_constf(b, LEAST_SLOPE), ir_emit1(b, OP_fabs, slope));
    Inst *over = ir_select(b, ir_emit2(b, OP_band, hit, falls), slope, ir_constf(b, INFINITY));
    Inst *moved =
        ir_emit2(b, OP_fdiv, ir_emit2(b, OP_fsub, h[1], ir_emit1(b, OP_detach, h[1])), ir_emit1(b, OP_detach, over));
    move_back(m, b, from, moved, from);
    even_out(m, b, hit, h[1], slope, k, from, last, map, ninsts);
}

/* How far it comes until h is eps, by a secant through the last two steps. */
static Inst *arrival(Builder *b, Inst *const stopped[STOPS]) {
    Inst *rise = ir_emit2(b, OP_fsub, stopped[WAS_NEAR], stopped[NEAR]);
    return ir_emit2(b, OP_fadd, stopped[CAME],
                    ir_emit2(b, OP_fmul, stopped[BY], ir_emit2(b, OP_fdiv, stopped[NEAR], rise)));
}

/* g of the outline: the march again, up to `hi`. Not where a limit ends a ray on its way to what its neighbour hits:
 * of those the nearest step is now this one and now that, and g would be a saw. They are told apart by where they
 * arrive, before `cut`, which lies between the two, or behind it. */
static Inst *outline(March *m, Builder *b, Inst *cut, Inst *hi, const Inst *at, const uint32_t stop[STOPS],
                     Arena *scratch) {
    Fn *fn = m->fn;
    Inst **map = ARENA_ARRAY(scratch, Inst *, ir_number(fn) + 1), *least = ir_constf(b, -INFINITY);
    ir_clone_insts(b, m->loop->block, m->loop, m->loop->next, map);
    Inst *loop = map[m->loop->id], *end, *g;
    drop_counts(loop->region[0]->first, NULL);
    carry(fn, loop, hi, &end);
    uint32_t index = carry(fn, loop, least, &g);
    Builder in = ir_before(fn, loop->region[0]->last);
    Inst *here = map[at->id], *within = ir_emit2(&in, OP_fle, here, end);
    Inst *most = ir_select(&in, within, ir_emit2(&in, OP_fmax, g, nearness(m, &in, map)), g);
    ir_replace_arg(loop->region[0]->last, 0, ir_emit2(&in, OP_band, loop->region[0]->last->args[0], within));
    carry_next(fn, loop, end);
    carry_next(fn, loop, most);
    Inst *nearest = ir_proj(b, loop, index), *stopped[STOPS];
    for (uint32_t v = 0; v < STOPS; v++) stopped[v] = ir_proj(b, loop, stop[v]);
    return ir_select(b, ir_emit2(b, OP_flt, cut, ir_constf(b, INFINITY)),
                     ir_emit2(b, OP_fsub, cut, arrival(b, stopped)), nearest);
}

typedef struct Rewrite {
    March *m;
    Arena *scratch;
    Inst *none, *least, *never;         /* 0, -infinity, infinity */
    uint32_t old, step, stop[STOPS];    /* numbers of carried values: the place before the last step, its number */
    uint32_t place[MOST_CARRIED], room; /* where it passed something, and how much nearer than RIM */
    Inst *far;                          /* how far it has come, in the body */
    bool rims, ends;                    /* rays without steps left are known; something else ends rays too */
    Inst *last;                         /* the end of the step in the body, behind which they are made */
} Rewrite;

/* k < n, or !(k == n): the iterations that there may be. */
static bool counts(const March *m, const Inst *v) {
    if (v->op == OP_bnot) return v->args[0]->op == OP_ieq && counts(m, v->args[0]);
    return (v->op == OP_ilt || v->op == OP_ieq) && v->args[0] == m->body->params[0] && ir_is_const(v->args[1]);
}

/* cont without what counts iterations; NULL: nothing else. */
static Inst *uncounted(const March *m, Builder *b, Inst *cont, bool *counted) {
    if (counts(m, cont)) {
        *counted = true;
        return NULL;
    }
    if (cont->op != OP_band) return cont;
    Inst *x = uncounted(m, b, cont->args[0], counted), *y = uncounted(m, b, cont->args[1], counted);
    return !x ? y : !y ? x : ir_emit2(b, OP_band, x, y);
}

static bool is_asked(const March *m, const Inst *v) {
    for (uint32_t a = 0; a < m->nasked; a++)
        if (m->asked[a].site == v) return true;
    return false;
}

/* Does what is asked, and at most one other site, far, alone decide v, besides the number of the iteration? */
static bool ends_by(const March *m, Inst *v, Inst **far, uint32_t room) {
    if (!room) return false;
    if (ir_is_const(v) || counts(m, v) || is_asked(m, v) || v == *far) return true;
    if (v->op == OP_site && !*far && is_near(m, v->args[1])) {
        *far = v;
        return true;
    }
    if (v->op == OP_arg && v->block == m->body) return v->type == TY_BOOL;
    if (v->op == OP_proj && v->args[0]->op == OP_if_) {
        Inst *op = v->args[0];
        return ends_by(m, op->args[0], far, room - 1) &&
               ends_by(m, op->region[0]->last->args[v->imm.i], far, room - 1) &&
               ends_by(m, op->region[1]->last->args[v->imm.i], far, room - 1);
    }
    if (v->op != OP_band && v->op != OP_bor && v->op != OP_bnot) return false;
    for (uint32_t a = 0; a < v->nargs; a++)
        if (!ends_by(m, v->args[a], far, room - 1)) return false;
    return true;
}

/* Would the loop go on, if it had steps left? NULL: who knows. far: the site that ends it elsewhere, or NULL. */
static Inst *would_go_on(const March *m, Builder *b, Inst **far) {
    bool counted = false;
    Inst *cont = m->body->last->args[0];
    *far = NULL;
    if (!ends_by(m, cont, far, MOST_CHAIN)) return NULL;
    Inst *on = uncounted(m, b, cont, &counted);
    return !counted ? NULL : on ? on : ir_constb(b, true);
}

/* Carries besides: where the march stood before its last step, that step's number, what is known of it, and where the
 * march came nearest. */
static void carry_stops(Rewrite *r) {
    March *m = r->m;
    Fn *fn = m->fn;
    Inst *loop = m->loop, *yield = m->body->last, *param;
    Builder before = ir_before(fn, loop), in = ir_before(fn, yield);
    r->none = ir_constf(&before, 0), r->never = ir_constf(&before, INFINITY), r->least = ir_constf(&before, -INFINITY);
    r->old = m->ncarried;
    for (uint32_t a = 0; a < m->nasked; a++) {
        Asked *q = &m->asked[a];
        bool magnitude = q->magnitude != q->h;
        q->h = in_body(m, q->h, INFINITY), q->eps = in_body(m, q->eps, 0);
        q->magnitude = magnitude ? NULL : q->h;
    }
    Inst **same = ARENA_ARRAY(r->scratch, Inst *, ir_number(fn) + 1), *before_these = yield->prev;
    for (uint32_t c = 0; c < m->ncarried; c++)
        carry(fn, loop, loop->args[c], &param), carry_next(fn, loop, m->body->params[c + 1]);
    r->step = carry(fn, loop, ir_consti(&before, 0), &param);
    carry_next(fn, loop, m->body->params[0]);
    carry(fn, loop, r->none, &r->far);
    Inst *by = ir_emit1(&in, OP_fabs, m->asked[0].h), *near = nearness(m, &in, same), *old_by, *old_near, *rise, *room;
    carry_next(fn, loop, ir_emit2(&in, OP_fadd, r->far, by));
    r->stop[CAME] = carry(fn, loop, r->none, &param), carry_next(fn, loop, r->far);
    r->stop[NEAR] = carry(fn, loop, r->least, &old_near), carry_next(fn, loop, near);
    r->stop[WAS_NEAR] = carry(fn, loop, r->least, &param), carry_next(fn, loop, old_near);
    carry(fn, loop, r->none, &old_by), carry_next(fn, loop, by);
    r->stop[BY] = carry(fn, loop, r->none, &param), carry_next(fn, loop, old_by);
    r->stop[ROSE] = carry(fn, loop, r->never, &rise);
    carry_next(fn, loop, ir_select(&in, ir_emit2(&in, OP_flt, near, old_near), r->far, rise));
    r->stop[HIT] = carry(fn, loop, ir_constb(&before, false), &param);
    carry_next(fn, loop, ir_emit2(&in, OP_flt, r->none, near));
    Inst *far, *on = would_go_on(m, &in, &far);
    r->rims = on != NULL, r->ends = far != NULL;
    r->stop[SPENT] = carry(fn, loop, ir_constb(&before, false), &param);
    Inst *last = ir_consti(&in, (int32_t)loop->imm.loop.max_iters - 1);
    carry_next(fn, loop, on ? on : ir_emit2(&in, OP_ieq, m->body->params[0], last));
    r->stop[LIMIT] = carry(fn, loop, r->none, &param);
    carry_next(fn, loop, far ? in_body(m, far->args[1], 0) : r->none);
    Inst *eps = m->asked[0].eps;
    eps = ir_is_const(eps) ? ir_constf(&in, eps->imm.f) : eps;
    r->room = carry(fn, loop, r->least, &room);
    Inst *now = ir_emit2(&in, OP_fadd, old_near, ir_emit2(&in, OP_fmul, eps, ir_constf(&in, RIM)));
    Inst *past = ir_emit2(&in, OP_band, ir_emit2(&in, OP_flt, near, old_near), ir_emit2(&in, OP_flt, room, now));
    past = ir_emit2(&in, OP_band, past, ir_emit2(&in, OP_fle, room, r->none));
    carry_next(fn, loop, ir_select(&in, past, now, room));
    for (uint32_t c = 0; c < m->ncarried; c++) {
        if (!m->goes[c]) continue;
        r->place[c] = carry(fn, loop, loop->args[c], &param);
        carry_next(fn, loop, ir_select(&in, past, m->body->params[r->old + c + 1], param));
    }
    r->last = after(m->body, before_these);
}

/* A site behind the march, of what it decides; in the loops around it. */
static void behind_march(Rewrite *r, Builder *b, SiteKind kind, Inst *decision, Inst *g) {
    March *m = r->m;
    Fn *fn = m->fn;
    const SiteInfo *asked = &fn->sites[m->asked[0].site->imm.i];
    SiteInfo *sites = ARENA_ARRAY(fn->arena, SiteInfo, fn->nsites + 1);
    memcpy(sites, fn->sites, fn->nsites * sizeof *sites);
    SiteInfo *info = &sites[fn->nsites];
    *info = (SiteInfo){.kind = kind,
                       .span = asked->span,
                       .path = asked->path,
                       .depth = m->depth,
                       .max_events = 1,
                       .skip_loop = true,
                       .by_auto = true,
                       .text = asked->text};
    Inst *args[2 + SLT_MAX_K] = {decision, g};
    uint32_t outer = m->depth;
    for (const Block *o = m->loop->block; o->owner; o = o->owner->block) {
        if (o->owner->op != OP_loop) continue;
        args[2 + --outer] = o->params[0];
        uint64_t iters = o->owner->imm.loop.max_iters;
        info->max_events = info->max_events > UINT64_MAX / iters ? UINT64_MAX : info->max_events * iters;
    }
    fn->sites = sites;
    ir_special(b, OP_site, TY_BOOL, 2 + m->depth, args, (Imm){.i = fn->nsites++});
}

/* How far a ray came before h was eps: by that, and not by where the last step went, neighbours differ little. Of one
 * that a limit ended while it came nearer, minus how far it would have come. */
static void outline_site(Rewrite *r, Builder *b, Inst *const stopped[STOPS]) {
    Fn *fn = r->m->fn;
    Inst *hit = stopped[HIT], *short_of = ir_emit1(b, OP_bnot, stopped[SPENT]),
         *falls = ir_emit2(b, OP_flt, stopped[WAS_NEAR], stopped[NEAR]);
    Inst *missed =
        ir_select(b, ir_emit2(b, OP_band, short_of, falls), ir_emit1(b, OP_fneg, arrival(b, stopped)), r->never);
    Inst *pair[3] = {ir_select(b, hit, arrival(b, stopped), missed), stopped[ROSE], ir_constf(b, -1)}, *window[2];
    for (uint32_t w = 0; w < 2; w++)
        window[w] = ir_special(b, OP_window, TY_FLT, 3, pair, (Imm){.i = 2 * (int64_t)fn->nsites + w});
    walk_resolve_forwards(fn->body);
    Inst *g = outline(r->m, b, window[0], window[1], r->far, r->stop, r->scratch);
    behind_march(r, b, r->m->sees ? SITE_SILHOUETTE : SITE_SHADOW, hit, g);
}

void march_rewrite(March *m, Arena *scratch) {
    Fn *fn = m->fn;
    Inst *loop = m->loop, *results[MOST_CARRIED] = {0}, *from[MOST_CARRIED], *nearest[MOST_CARRIED], *stopped[STOPS];
    for (Inst *p = loop->next; p && p->op == OP_proj && p->args[0] == loop; p = p->next) results[p->imm.i] = p;
    Rewrite r = {.m = m, .scratch = scratch};
    carry_stops(&r);
    uint32_t ninsts = ir_number(fn) + 1;
    Inst **map = ARENA_ARRAY(scratch, Inst *, ninsts), *behind = loop->next;
    while (behind && behind->op == OP_proj && behind->args[0] == loop) behind = behind->next;
    Builder b = ir_before(fn, behind);
    b.span = loop->span;
    for (uint32_t c = 0; c < m->ncarried; c++)
        from[c] = ir_proj(&b, loop, r.old + c), nearest[c] = m->goes[c] ? ir_proj(&b, loop, r.place[c]) : from[c];
    Inst *k = ir_proj(&b, loop, r.step), *room = ir_proj(&b, loop, r.room);
    for (uint32_t v = 0; v < STOPS; v++) stopped[v] = ir_proj(&b, loop, r.stop[v]);
    b = ir_before(fn, behind);
    Inst *hit = stopped[HIT];
    Inst *rim = ir_emit2(&b, OP_band, stopped[SPENT], ir_emit2(&b, OP_flt, r.none, room));
    follow_root(m, &b, hit, k, from, r.last, ninsts, scratch);

    /* The step where it came nearest, which asks nothing. */
    Inst *mark = behind->prev, *shown[MOST_CARRIED], *seen[MOST_CARRIED];
    try_step(m, &b, k, nearest, r.last, map, ninsts);
    for (uint32_t c = 0; c < m->ncarried; c++) seen[c] = mapped(m->body->last->args[c + 1], map);

    /* The last step once more, with its sites: what the march hands on. */
    mark = behind->prev;
    memset(map, 0, ninsts * sizeof *map);
    clone_step(m, &b, k, from, r.last, map);
    for (uint32_t c = 0; c < m->ncarried; c++) shown[c] = mapped(m->body->last->args[c + 1], map);
    strip(fn, m->body->first, NULL, NULL);
    if (mark->next != behind) strip(fn, mark->next, behind, m), move_out(m, mark->next, behind);
    b = ir_before(fn, mark->next);
    b.span = loop->span;
    outline_site(&r, &b, stopped);

    b = ir_before(fn, behind);
    b.span = loop->span;
    if (r.rims && r.ends) behind_march(&r, &b, SITE_COMPARE, stopped[SPENT], stopped[LIMIT]);
    if (r.rims) behind_march(&r, &b, SITE_COMPARE, rim, room);
    Inst *beside = ir_special(&b, OP_stands, TY_BOOL, 0, NULL, (Imm){0});
    for (uint32_t c = 0; c < m->ncarried; c++) {
        if (!results[c]) continue;
        shown[c] = settled(shown[c]), seen[c] = settled(seen[c]);
        Inst *next = shown[c];
        if (r.rims && seen[c] != shown[c]) {
            if (next->type == TY_FLT) next = ir_select(&b, rim, ir_emit1(&b, OP_detach, next), next);
            next = ir_select(&b, ir_emit2(&b, OP_band, beside, rim), seen[c], next);
        }
        for (Inst *i = behind; i; i = i->next) { /* all behind, wherever */
            for (uint32_t a = 0; a < i->nargs; a++)
                if (i->args[a] == results[c]) i->args[a] = next;
            for (uint32_t g = 0; g < i->nregions; g++) walk_replace(i->region[g], results[c], next);
        }
    }
}
