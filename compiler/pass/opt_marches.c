/* Marches, under --disc auto: `t += h; if (abs(h) < eps) break;`, where each step goes on by what the comparison found.
 *
 * As it stands every step asks a question of its own, and of neighbouring rays no two take the same number of steps: a
 * shell of small jumps in front of every surface, and in front of every outline hundreds. What the program means is
 * where h is 0. So
 *
 *   - the march itself decides nothing: what is asked on the way is asked once more in a last step, from where the
 * march stood before it, and there it is a site like any other;
 *   - the outline is one site: hit or not. Two rays that hit, but not the same thing, are told apart by how far they
 *     came, as on heightfields (variant_ray.c), and g is the largest eps - h of the steps up to halfway between;
 *   - where it hit, the derivative is that of the root: before the last step the place moves by -dh / h' along the
 *     march, a Newton step whose value is 0. h' is h differentiated along the march (ad_along).
 *
 * Only where nothing but the place is carried from step to step: what counts the steps, or sums over them, shows them.
 * A [Disc] of the user's, beside or without [SkipLoop], is taken at its word. */
#include <math.h>
#include <string.h>

#include "compiler/pass/walk.h"

enum { MOST_CARRIED = 64, MOST_CHAIN = 32, MOST_ASKED = 4 };
/* Slower than this h does not fall towards a surface: the ray grazes it, and a root says nothing. */
#define LEAST_SLOPE 1e-3

typedef struct Asked {
    Inst *site;          /* of `h < eps`, or of `eps < h` */
    Inst *h, *magnitude; /* magnitude: abs(h), or h */
    Inst *eps;
} Asked;

typedef struct March {
    Fn *fn;
    Inst *loop;
    Block *body;
    uint32_t ncarried, depth; /* depth: loops around it */
    Asked asked[MOST_ASKED];
    uint32_t nasked;
    bool goes[MOST_CARRIED];             /* carried i is the place: next = this + way * h */
    Inst *way[MOST_CARRIED][MOST_CHAIN]; /* factors of it, from outside of the loop */
    uint32_t nway[MOST_CARRIED];
    bool sees; /* what is behind it, where it ended */
} March;

static bool is_outside(const March *m, const Inst *v) { return ir_is_const(v) || !walk_inside(v->block, m->body); }

static bool is_carried(const March *m, const Inst *v) { return v->op == OP_arg && v->block == m->body && v->imm.i > 0; }

/* What next values are made of, but for ifs that keep the old one. */
static bool is_kept(const March *m, const Inst *v, uint32_t c) { return v == m->body->params[c + 1]; }

/* Is e a product of h, or of a limit of it, and of factors from outside? They go to `way`. */
static bool goes_by(March *m, Inst *e, const Inst *h, uint32_t c, uint32_t room) {
    if (e == h) return true;
    if (!room) return false;
    switch ((Op)e->op) {
    case OP_fneg:
    case OP_fabs: return goes_by(m, e->args[0], h, c, room - 1);
    case OP_fmul:
        for (uint32_t a = 0; a < 2; a++)
            if (is_outside(m, e->args[1 - a]) && goes_by(m, e->args[a], h, c, room - 1)) {
                if (m->nway[c] < MOST_CHAIN) m->way[c][m->nway[c]++] = e->args[1 - a];
                return true;
            }
        return false;
    case OP_fmin:
    case OP_fmax:
    case OP_fsel:
        for (uint32_t a = e->op == OP_fsel; a < e->nargs; a++)
            if (goes_by(m, e->args[a], h, c, room - 1)) return true;
        return false;
    default: return false;
    }
}

/* next = this + way * h, on some way through the iteration, and this on the others. */
static bool steps_by(March *m, Inst *next, const Inst *h, uint32_t c, uint32_t room) {
    if (!room) return false;
    if (next->op == OP_proj && next->args[0]->op == OP_if_) {
        Inst *op = next->args[0],
             *y[2] = {op->region[0]->last->args[next->imm.i], op->region[1]->last->args[next->imm.i]};
        for (uint32_t r = 0; r < 2; r++)
            if (is_kept(m, y[r], c) || ir_is_const(y[r])) return steps_by(m, y[1 - r], h, c, room - 1);
        return steps_by(m, y[0], h, c, room - 1) && steps_by(m, y[1], h, c, room - 1);
    }
    if (next->op == OP_fsel) {
        for (uint32_t a = 1; a < 3; a++)
            if (is_kept(m, next->args[a], c)) return steps_by(m, next->args[3 - a], h, c, room - 1);
        return false;
    }
    if (next->op != OP_fadd && next->op != OP_fsub) return false;
    for (uint32_t a = 0; a < (next->op == OP_fadd ? 2u : 1u); a++)
        if (is_kept(m, next->args[a], c) && goes_by(m, next->args[1 - a], h, c, room - 1)) return true;
    return false;
}

/* Does the loop go on by what v decides? */
static bool decides(const Inst *cont, const Inst *v, uint32_t room) {
    if (cont == v) return true;
    if (!room || cont->type != TY_BOOL) return false;
    if (cont->op == OP_proj && cont->args[0]->op == OP_if_) {
        const Inst *op = cont->args[0];
        return decides(op->args[0], v, room - 1) || decides(op->region[0]->last->args[cont->imm.i], v, room - 1) ||
               decides(op->region[1]->last->args[cont->imm.i], v, room - 1);
    }
    if (ir_ops[cont->op].compares || ir_ops[cont->op].special) return false;
    for (uint32_t a = 0; a < cont->nargs; a++)
        if (decides(cont->args[a], v, room - 1)) return true;
    return false;
}

/* In the body itself, or in what runs while the condition of a loop holds that asks first. */
static bool in_core(const March *m, const Inst *v) {
    const Inst *owner = v->block->owner;
    return v->block == m->body ||
           (owner && owner->op == OP_if_ && owner->block == m->body && v->block == owner->region[0]);
}

/* A value of the core, in the body; where the core did not run it is `other`. */
static Inst *in_body(const March *m, Inst *v, double other) {
    if (v->block == m->body || ir_is_const(v) || is_outside(m, v)) return v;
    Inst *op = v->block->owner;
    Builder end = ir_at_end(m->fn, op->region[1]), behind = ir_after(m->fn, op);
    ir_append_arg(m->fn, op->region[0]->last, v);
    ir_append_arg(m->fn, op->region[1]->last, ir_constf(&end, other));
    return ir_proj(&behind, op, ir_nresults(op) - 1);
}

/* h < eps, where the march goes by h? */
static bool asks(March *m, Inst *site) {
    const Inst *d = site->args[0];
    if (m->nasked == MOST_ASKED || (d->op != OP_flt && d->op != OP_fle)) return false;
    for (uint32_t side = 0; side < 2; side++) {
        Inst *h = d->args[side], *eps = d->args[1 - side], *magnitude = h;
        if (h->op == OP_fabs) h = h->args[0];
        if (!in_core(m, h) || is_carried(m, h) || !(ir_is_const(eps) || in_core(m, eps) || is_outside(m, eps)))
            continue;
        bool any = false;
        for (uint32_t c = 0; c < m->ncarried; c++) {
            Inst *next = m->body->last->args[c + 1];
            if (next == h || next->type != TY_FLT) continue;
            m->nway[c] = 0;
            bool goes = steps_by(m, next, h, c, MOST_CHAIN);
            m->goes[c] |= goes;
            any |= goes;
        }
        if (!any || !decides(m->body->last->args[0], site, MOST_CHAIN)) continue;
        m->asked[m->nasked++] = (Asked){site, h, magnitude, eps};
        return true;
    }
    return false;
}

/* Every site in b and below; false: one is the user's. */
static bool find_asked(March *m, Block *b) {
    for (Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_site || i->op == OP_siten) {
            const SiteInfo *s = &m->fn->sites[i->imm.i];
            if (!s->by_auto || s->skip_loop || ir_site_of_ray(s->kind)) return false;
            bool here = true;
            for (const Block *at = b; at != m->body; at = at->owner->block) here &= at->owner->op == OP_if_;
            if (i->op == OP_site && here) asks(m, i);
        }
        if (ir_ops[i->op].kind == KIND_EFFECT && i->op != OP_if_ && i->op != OP_loop && i->op != OP_count) return false;
        if (i->op == OP_rand || i->op == OP_alloc || i->op == OP_store || i->op == OP_custom || i->op == OP_query)
            return false;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (!find_asked(m, i->region[r])) return false;
    }
    return true;
}

/* Is v made of the place where the march stands; or, not of_place, of anything else that it carries, its number of
 * steps among them? */
static bool shows(const March *m, const Inst *v, bool of_place, bool *seen) {
    if (is_outside(m, v) || seen[v->id]) return false;
    seen[v->id] = true;
    /* What is chosen shows the place, unless by whether the march goes on. */
    if (v->type == TY_BOOL && (!of_place || decides(m->body->last->args[0], v, MOST_CHAIN))) return false;
    if (v->op == OP_arg && v->block == m->body) return of_place == (v->imm.i > 0 && m->goes[v->imm.i - 1]);
    if (v->op == OP_arg || v->op == OP_load) return v->op == OP_load;
    if (v->op == OP_proj) {
        const Inst *op = v->args[0];
        for (uint32_t a = 0; a < op->nargs; a++)
            if (shows(m, op->args[a], of_place, seen)) return true;
        for (uint32_t r = 0; r < op->nregions; r++)
            if (shows(m, op->region[r]->last->args[v->imm.i + (op->op == OP_loop)], of_place, seen)) return true;
        return false;
    }
    for (uint32_t a = 0; a < v->nargs; a++)
        if (shows(m, v->args[a], of_place, seen)) return true;
    return false;
}

static bool is_used(const Fn *fn, const Block *b, const Inst *v) {
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t a = 0; a < i->nargs; a++)
            if (i->args[a] == v) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (is_used(fn, i->region[r], v)) return true;
    }
    return false;
}

/* Does the next value of carried c, v or a part of it, have the number of steps in it? Not where it is the old value
 * itself, or the smaller or larger of it and something that has not. */
static bool adds_steps(const March *m, const Inst *v, uint32_t c, bool *seen, uint32_t room) {
    if (is_kept(m, v, c)) return false;
    if (room && (v->op == OP_fmin || v->op == OP_fmax || v->op == OP_fsel)) {
        for (uint32_t a = v->op == OP_fsel; a < v->nargs; a++)
            if (adds_steps(m, v->args[a], c, seen, room - 1)) return true;
        return false;
    }
    if (room && v->op == OP_proj && v->args[0]->op == OP_if_) {
        for (uint32_t r = 0; r < 2; r++)
            if (adds_steps(m, v->args[0]->region[r]->last->args[v->imm.i], c, seen, room - 1)) return true;
        return false;
    }
    return shows(m, v, false, seen);
}

/* Does anything behind the loop see how many steps there were? */
static bool shows_steps(const March *m, Arena *scratch, uint32_t ninsts) {
    bool *seen = ARENA_ARRAY(scratch, bool, ninsts);
    for (const Inst *p = m->loop->next; p && p->op == OP_proj && p->args[0] == m->loop; p = p->next) {
        uint32_t c = (uint32_t)p->imm.i;
        if (p->type == TY_BOOL || m->goes[c] || !is_used(m->fn, m->fn->body, p)) continue;
        memset(seen, 0, ninsts * sizeof *seen);
        if (adds_steps(m, m->body->last->args[c + 1], c, seen, MOST_CHAIN)) return true;
    }
    return false;
}

/* Does anything behind the loop see where it ended, or only whether it hit? */
static bool shows_place(const March *m, Arena *scratch, uint32_t ninsts) {
    bool *seen = ARENA_ARRAY(scratch, bool, ninsts);
    for (const Inst *p = m->loop->next; p && p->op == OP_proj && p->args[0] == m->loop; p = p->next) {
        if (p->type == TY_BOOL || !is_used(m->fn, m->fn->body, p)) continue;
        memset(seen, 0, ninsts * sizeof *seen);
        if (shows(m, m->body->last->args[p->imm.i + 1], true, seen)) return true;
    }
    return false;
}

static bool is_march(March *m, Arena *scratch, uint32_t ninsts) {
    m->body = m->loop->region[0];
    m->ncarried = m->body->nparams - 1;
    if (!m->ncarried || m->ncarried > MOST_CARRIED) return false;
    for (const Block *b = m->loop->block; b->owner; b = b->owner->block) {
        if (b->owner->op != OP_loop && b->owner->op != OP_if_) return false;
        m->depth += b->owner->op == OP_loop;
    }
    if (!find_asked(m, m->body) || !m->nasked || shows_steps(m, scratch, ninsts)) return false;
    m->sees = shows_place(m, scratch, ninsts);
    return true;
}

/* ---- rebuilding */

/* What is known where a march stops: how far it came before its last step; eps - h there, and in the step before, by
 * which it came; where it last came away from something; whether it hit. */
enum { CAME, NEAR, WAS_NEAR, BY, ROSE, HIT, STOPS };

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

/* Moves the place `from` by what the root of h does: a Newton step whose value is 0. */
static void follow_root(March *m, Builder *b, Inst *hit, Inst *k, Inst **from, const Inst *last, uint32_t ninsts,
                        Arena *scratch) {
    Inst *seeded[MOST_CARRIED], *h[2], **map = ARENA_ARRAY(scratch, Inst *, ninsts);
    for (uint32_t c = 0; c < m->ncarried; c++)
        seeded[c] =
            m->goes[c] ? ir_special(b, OP_seed, TY_FLT, 2, (Inst *[]){from[c], way_of(m, b, c)}, (Imm){0}) : from[c];
    for (uint32_t copy = 0; copy < 2; copy++) { /* one to be differentiated along the march, one for the derivative */
        Inst *before = b->before ? b->before->prev : b->block->last;
        memset(map, 0, ninsts * sizeof *map);
        clone_step(m, b, k, copy ? from : seeded, last, map);
        strip(m->fn, after(b->block, before), b->before, NULL);
        h[copy] = mapped(m->asked[0].h, map);
        if (h[copy]->op == OP_COUNT) h[copy] = h[copy]->args[0];
    }
    Inst *slope = ir_special(b, OP_along, TY_FLT, 1, h, (Imm){0});
    Inst *falls = ir_emit2(b, OP_flt, ir_constf(b, LEAST_SLOPE), ir_emit1(b, OP_fabs, slope));
    Inst *over = ir_select(b, ir_emit2(b, OP_band, hit, falls), slope, ir_constf(b, INFINITY));
    Inst *moved =
        ir_emit2(b, OP_fdiv, ir_emit2(b, OP_fsub, h[1], ir_emit1(b, OP_detach, h[1])), ir_emit1(b, OP_detach, over));
    for (uint32_t c = 0; c < m->ncarried; c++)
        if (m->goes[c])
            from[c] =
                ir_emit2(b, OP_fsub, from[c], ir_emit2(b, OP_fmul, ir_emit1(b, OP_detach, way_of(m, b, c)), moved));
}

/* How far it comes until h is eps, by a secant through the last two steps. */
static Inst *arrival(Builder *b, Inst *const stopped[STOPS]) {
    Inst *rise = ir_emit2(b, OP_fsub, stopped[WAS_NEAR], stopped[NEAR]);
    return ir_emit2(b, OP_fadd, stopped[CAME],
                    ir_emit2(b, OP_fmul, stopped[BY], ir_emit2(b, OP_fdiv, stopped[NEAR], rise)));
}

/* g of the outline: the march again, up to `hi`. Not where a limit ends a ray on its way to what its neighbour hits:
 * of those the nearest step is now this one and now that, and g would be a saw. They are told apart by where they
 * arrive, before `cut` or behind it. */
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

static void rebuild(March *m, Arena *scratch, uint32_t ninsts) {
    Fn *fn = m->fn;
    Inst *loop = m->loop, *yield = m->body->last, *last = yield;
    Builder before = ir_before(fn, loop), in = ir_before(fn, yield);
    Inst *none = ir_constf(&before, 0), *never = ir_constf(&before, INFINITY), *least = ir_constf(&before, -INFINITY);
    Inst *results[MOST_CARRIED] = {0}, *from[MOST_CARRIED], *param;
    for (Inst *p = loop->next; p && p->op == OP_proj && p->args[0] == loop; p = p->next) results[p->imm.i] = p;

    /* Carried besides: where the march stood before its last step, that step's number, and what is known of it. */
    uint32_t old = m->ncarried;
    for (uint32_t a = 0; a < m->nasked; a++) {
        Asked *q = &m->asked[a];
        bool magnitude = q->magnitude != q->h;
        q->h = in_body(m, q->h, INFINITY), q->eps = in_body(m, q->eps, 0);
        q->magnitude = magnitude ? NULL : q->h;
    }
    ninsts = ir_number(fn) + 1;
    for (uint32_t c = 0; c < m->ncarried; c++)
        carry(fn, loop, loop->args[c], &param), carry_next(fn, loop, m->body->params[c + 1]);
    uint32_t step = carry(fn, loop, ir_consti(&before, 0), &param);
    carry_next(fn, loop, m->body->params[0]);
    Inst **map = ARENA_ARRAY(scratch, Inst *, ninsts), *far;
    Inst *first = last->prev;
    carry(fn, loop, none, &far);
    Inst *by = ir_emit1(&in, OP_fabs, m->asked[0].h), *near = nearness(m, &in, map), *old_by, *old_near, *rise;
    carry_next(fn, loop, ir_emit2(&in, OP_fadd, far, by));
    uint32_t stop[STOPS];
    stop[CAME] = carry(fn, loop, none, &param), carry_next(fn, loop, far);
    stop[NEAR] = carry(fn, loop, least, &old_near), carry_next(fn, loop, near);
    stop[WAS_NEAR] = carry(fn, loop, least, &param), carry_next(fn, loop, old_near);
    carry(fn, loop, none, &old_by), carry_next(fn, loop, by);
    stop[BY] = carry(fn, loop, none, &param), carry_next(fn, loop, old_by);
    stop[ROSE] = carry(fn, loop, never, &rise);
    carry_next(fn, loop, ir_select(&in, ir_emit2(&in, OP_flt, near, old_near), far, rise));
    stop[HIT] = carry(fn, loop, ir_constb(&before, false), &param);
    carry_next(fn, loop, ir_emit2(&in, OP_flt, none, near));
    last = first->next;

    Inst *behind = loop->next;
    while (behind && behind->op == OP_proj && behind->args[0] == loop) behind = behind->next;
    Builder b = ir_before(fn, behind);
    b.span = loop->span;
    for (uint32_t c = 0; c < m->ncarried; c++) from[c] = ir_proj(&b, loop, old + c);
    Inst *k = ir_proj(&b, loop, step), *stopped[STOPS];
    for (uint32_t v = 0; v < STOPS; v++) stopped[v] = ir_proj(&b, loop, stop[v]);
    Inst *hit = stopped[HIT];
    b = ir_before(fn, behind);
    follow_root(m, &b, hit, k, from, last, ninsts, scratch);

    /* The last step once more, with its sites: what the march hands on. */
    Inst *mark = behind->prev;
    clone_step(m, &b, k, from, last, map);
    Inst *next[MOST_CARRIED];
    for (uint32_t c = 0; c < m->ncarried; c++) next[c] = mapped(yield->args[c + 1], map);
    Inst *copy = mark->next;
    strip(fn, m->body->first, NULL, NULL);
    if (copy != behind) strip(fn, copy, behind, m), move_out(m, mark->next, behind);

    /* The outline's site. */
    b = ir_before(fn, mark->next);
    b.span = loop->span;
    const SiteInfo *asked = &fn->sites[m->asked[0].site->imm.i];
    SiteInfo *sites = ARENA_ARRAY(fn->arena, SiteInfo, fn->nsites + 1);
    memcpy(sites, fn->sites, fn->nsites * sizeof *sites);
    SiteInfo *info = &sites[fn->nsites];
    *info = (SiteInfo){.kind = m->sees ? SITE_SILHOUETTE : SITE_SHADOW,
                       .span = asked->span,
                       .path = asked->path,
                       .depth = m->depth,
                       .max_events = 1,
                       .skip_loop = true,
                       .by_auto = true,
                       .text = asked->text};
    Inst *args[2 + SLT_MAX_K] = {hit};
    uint32_t outer = m->depth;
    for (const Block *o = loop->block; o->owner; o = o->owner->block) {
        if (o->owner->op != OP_loop) continue;
        args[2 + --outer] = o->params[0];
        uint64_t iters = o->owner->imm.loop.max_iters;
        info->max_events = info->max_events > UINT64_MAX / iters ? UINT64_MAX : info->max_events * iters;
    }
    fn->sites = sites;
    /* How far it came before h was eps: by that, and not by where the last step went, neighbours differ little. Of a
     * ray that a limit ended while it came nearer, minus where that was. */
    Inst *ended = ir_emit2(&b, OP_ilt, k, ir_consti(&b, (int32_t)loop->imm.loop.max_iters - 1)),
         *falls = ir_emit2(&b, OP_flt, stopped[WAS_NEAR], stopped[NEAR]);
    Inst *missed = ir_select(&b, ir_emit2(&b, OP_band, ended, falls), ir_emit1(&b, OP_fneg, stopped[CAME]),
                             ir_constf(&b, INFINITY));
    Inst *pair[3] = {ir_select(&b, hit, arrival(&b, stopped), missed), stopped[ROSE], ir_constf(&b, -1)};
    Inst *window[2];
    for (uint32_t w = 0; w < 2; w++)
        window[w] = ir_special(&b, OP_window, TY_FLT, 3, pair, (Imm){.i = 2 * (int64_t)fn->nsites + w});
    walk_resolve_forwards(fn->body);
    args[1] = outline(m, &b, window[0], window[1], far, stop, scratch);
    ir_special(&b, OP_site, TY_BOOL, 2 + m->depth, args, (Imm){.i = fn->nsites++});

    for (uint32_t c = 0; c < m->ncarried; c++) {
        if (!results[c]) continue;
        while (next[c]->op == OP_COUNT) next[c] = next[c]->args[0];
        for (Inst *i = behind; i; i = i->next) { /* all behind, wherever */
            for (uint32_t a = 0; a < i->nargs; a++)
                if (i->args[a] == results[c]) i->args[a] = next[c];
            for (uint32_t r = 0; r < i->nregions; r++) walk_replace(i->region[r], results[c], next[c]);
        }
    }
}

static Inst *find_march(Fn *fn, Block *b, March *m, Arena *scratch, uint32_t ninsts) {
    for (Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_loop) {
            *m = (March){.fn = fn, .loop = i};
            if (is_march(m, scratch, ninsts)) return i;
        }
        for (uint32_t r = 0; r < i->nregions; r++) {
            Inst *found = find_march(fn, i->region[r], m, scratch, ninsts);
            if (found) return found;
        }
    }
    return NULL;
}

static bool any_by_auto(const Fn *fn) {
    for (uint32_t s = 0; s < fn->nsites; s++)
        if (fn->sites[s].by_auto) return true;
    return false;
}

bool opt_marches(PassCtx *ctx, Fn *fn) {
    if (!any_by_auto(fn)) return false;
    Arena *scratch = &ctx->session->scratch;
    March *m = ARENA_ARRAY(fn->arena, March, 1);
    bool found = false;
    for (;;) {
        ArenaMark at = arena_mark(scratch);
        uint32_t n = ir_number(fn) + 1;
        Inst *loop = find_march(fn, fn->body, m, scratch, n);
        if (loop) rebuild(m, scratch, n), found = true;
        arena_reset(scratch, at);
        if (!loop) break;
    }
    if (found) ad_along(ctx, fn);
    return found;
}
