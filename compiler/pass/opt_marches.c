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
#include <string.h>

#include "compiler/pass/march.h"

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
    if (!find_asked(m, m->body) || !m->nasked) return false;
    m->counts = shows_steps(m, scratch, ninsts);
    if (m->counts) return false;
    m->sees = shows_place(m, scratch, ninsts);
    return true;
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

/* Of those that are left. */
static void warn_counted(PassCtx *ctx, Fn *fn, Block *b, March *m, uint32_t ninsts) {
    for (Inst *i = b->first; i; i = i->next) {
        *m = (March){.fn = fn, .loop = i};
        if (i->op == OP_loop && !is_march(m, &ctx->session->scratch, ninsts) && m->counts)
            diag_emit(ctx->session, DIAG_counted_steps, m->asked[0].site->span);
        for (uint32_t r = 0; r < i->nregions; r++) warn_counted(ctx, fn, i->region[r], m, ninsts);
    }
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
        if (loop) march_rewrite(m, scratch), found = true;
        arena_reset(scratch, at);
        if (!loop) break;
    }
    ArenaMark at = arena_mark(scratch);
    warn_counted(ctx, fn, fn->body, m, ir_number(fn) + 1);
    arena_reset(scratch, at);
    if (found) ad_along(ctx, fn);
    return found;
}
