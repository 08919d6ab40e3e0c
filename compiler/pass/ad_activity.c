/* Which values carry derivatives.
 *
 * varied: depends differentiably on something differentiated (forward from the parameters); useful: an output depends
 * differentiably on it (backward from the outputs). Only a value that is both gets a tangent or an adjoint. Arrays are
 * one value each. Both are least fixpoints over the loops. */
#include <string.h>

#include "compiler/pass/ad.h"

typedef struct Walk {
    AdFacts *f;
    bool changed;
} Walk;

bool ad_slot_in_wrt(const AdOptions *o, const Inst *param) {
    if (o->wrt_none) return false;
    if (!o->wrt) return true;
    const Inst *index = param->args[0];
    uint32_t base = param->imm.slot.base, count = param->imm.slot.count;
    if (index->op == OP_consti) {
        int64_t k = (int32_t)index->imm.i;
        k = k < 0 ? 0 : k >= (int64_t)count ? (int64_t)count - 1 : k;
        return o->wrt[base + k] != 0;
    }
    return walk_any_marked(o->wrt, param);
}

bool ad_makes_infinite(const AdFacts *f, const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++)
            if (ad_makes_infinite(f, i->region[r])) return true;
        if (i->op == OP_custom) return true;
        if (ir_ops[i->op].special || i->type != TY_FLT || !ad_active(f, i)) continue;
        for (uint32_t a = 0; a < i->nargs; a++) {
            bool inf = false;
            if (i->args[a]->type == TY_FLT && ad_active(f, i->args[a]) &&
                ad_mentions(i, a, f->range, &inf) != UINT32_MAX && inf)
                return true;
        }
    }
    return false;
}

static void set(Walk *w, uint8_t *bits, const Inst *v) {
    if (!bits[v->id]) bits[v->id] = 1, w->changed = true;
}

static bool row_varied(const AdFacts *f, const Inst *i) {
    for (uint32_t a = 0; a < i->nargs; a++)
        if (i->args[a]->type == TY_FLT && f->varied[i->args[a]->id] && ad_mentions(i, a, NULL, NULL) != UINT32_MAX)
            return true;
    return false;
}

static void varied_in(Walk *w, Block *b) {
    AdFacts *f = w->f;
    uint8_t *v = f->varied;
    for (Inst *i = b->first; i; i = i->next) {
        bool on = false;
        switch ((Op)i->op) {
        case OP_param: on = ad_slot_in_wrt(f->o, i); break;
        case OP_input: on = f->o->wrt_x && i->imm.i >= IN_X0 && i->imm.i <= IN_X2; break;
        case OP_seed: on = f->o->wrt_seeds || v[i->args[0]->id]; break;
        case OP_ghost: on = v[i->args[0]->id]; break;
        case OP_detach: on = i->tag && v[f->links[i->tag - 1]->id]; break;
        case OP_load: on = i->type == TY_FLT && v[i->args[0]->id]; break;
        case OP_take: on = i->type == TY_FLT; break; /* of which chunk is not known */
        case OP_store:
            if (v[i->args[2]->id]) set(w, v, i->args[0]);
            break;
        case OP_acopy:
            if (v[i->args[1]->id]) set(w, v, i->args[0]);
            break;
        case OP_if_:
            for (uint32_t r = 0; r < 2; r++) varied_in(w, i->region[r]);
            break;
        case OP_loop: {
            Block *body = i->region[0];
            for (uint32_t p = 1; p < body->nparams; p++)
                if (v[i->args[p - 1]->id] || (body->last && v[body->last->args[p]->id])) set(w, v, body->params[p]);
            varied_in(w, body);
            break;
        }
        case OP_proj: {
            const Inst *o = i->args[0];
            if (o->op == OP_custom) {
                for (uint32_t a = 0; a < o->nargs; a++) on |= o->args[a]->type == TY_FLT && v[o->args[a]->id];
                break;
            }
            for (uint32_t r = 0; r < o->nregions; r++) on |= v[walk_results(o, o->region[r])[i->imm.i]->id] != 0;
            break;
        }
        default:
            if (!ir_ops[i->op].special && i->type == TY_FLT) on = row_varied(f, i);
        }
        if (on && (i->type == TY_FLT)) set(w, v, i);
    }
}

static void useful_arg(Walk *w, const Inst *v) {
    if (v->type == TY_FLT) set(w, w->f->useful, v);
}

static void useful_in(Walk *w, Block *b) {
    AdFacts *f = w->f;
    uint8_t *u = f->useful;
    for (Inst *i = b->last; i; i = i->prev) {
        switch ((Op)i->op) {
        case OP_give:
        case OP_along:
        case OP_ddx: useful_arg(w, i->args[0]); continue;
        case OP_store:
            if (u[i->args[0]->id]) useful_arg(w, i->args[2]);
            continue;
        case OP_acopy:
            if (u[i->args[0]->id]) set(w, u, i->args[1]);
            continue;
        case OP_if_:
            for (Inst *p = i->next; p && p->op == OP_proj && p->args[0] == i; p = p->next)
                for (uint32_t r = 0; r < 2 && u[p->id]; r++) useful_arg(w, i->region[r]->last->args[p->imm.i]);
            for (uint32_t r = 2; r-- > 0;) useful_in(w, i->region[r]);
            continue;
        case OP_loop: {
            Block *body = i->region[0];
            for (Inst *p = i->next; p && p->op == OP_proj && p->args[0] == i; p = p->next)
                if (u[p->id]) useful_arg(w, body->last->args[p->imm.i + 1]);
            useful_in(w, body);
            for (uint32_t p = 1; p < body->nparams; p++)
                if (u[body->params[p]->id]) useful_arg(w, i->args[p - 1]), useful_arg(w, body->last->args[p]);
            continue;
        }
        case OP_custom:
            for (Inst *p = i->next; p && p->op == OP_proj && p->args[0] == i; p = p->next)
                for (uint32_t a = 0; a < i->nargs && u[p->id]; a++) useful_arg(w, i->args[a]);
            continue;
        default: break;
        }
        if (!u[i->id] || i->type != TY_FLT) continue;
        if (i->op == OP_load) set(w, u, i->args[0]);
        else if (i->op == OP_seed || i->op == OP_ghost) useful_arg(w, i->args[0]);
        else if (i->op == OP_detach && i->tag) useful_arg(w, f->links[i->tag - 1]);
        else if (!ir_ops[i->op].special)
            for (uint32_t a = 0; a < i->nargs; a++)
                if (i->args[a]->type == TY_FLT && ad_mentions(i, a, NULL, NULL) != UINT32_MAX)
                    useful_arg(w, i->args[a]);
    }
}

void ad_facts(AdFacts *f, Fn *fn, Arena *arena, const AdOptions *o, Inst **links, const uint8_t *told) {
    uint32_t n = ir_number(fn);
    *f = (AdFacts){.fn = fn, .arena = arena, .n = n, .o = o, .links = links};
    f->varied = ARENA_ARRAY(arena, uint8_t, n + 1);
    f->useful = ARENA_ARRAY(arena, uint8_t, n + 1);
    f->range = ARENA_ARRAY(arena, IrRange, n + 1);
    ir_ranges(fn, arena, told, f->range);
    Walk w = {.f = f};
    do {
        w.changed = false;
        varied_in(&w, fn->body);
    } while (w.changed);
    for (uint32_t k = 0; k < fn->body->last->nargs; k++) useful_arg(&w, fn->body->last->args[k]);
    do {
        w.changed = false;
        useful_in(&w, fn->body);
    } while (w.changed);
}

void ad_clear_tags(Block *b) {
    for (uint32_t p = 0; p < b->nparams; p++) b->params[p]->tag = b->params[p]->flags = 0;
    for (Inst *i = b->first; i; i = i->next) {
        i->tag = i->flags = 0;
        for (uint32_t r = 0; r < i->nregions; r++) ad_clear_tags(i->region[r]);
    }
}

Output ad_output(const Fn *fn, uint32_t index) { return fn->outputs ? fn->outputs[index] : (Output){SLT_OUT_F, index}; }

Output ad_tangent_output(const Fn *fn, uint32_t index) {
    Output of = ad_output(fn, index);
    return (Output){of.role == SLT_OUT_G ? SLT_OUT_DG : SLT_OUT_DF, of.index};
}

static void collect_params(const AdFacts *f, const Block *b, uint8_t *active) {
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) collect_params(f, i->region[r], active);
        if (i->op != OP_param || !f->useful[i->id]) continue;
        uint32_t lo = 0, hi = i->imm.slot.count;
        if (i->args[0]->op == OP_consti) {
            int64_t k = (int32_t)i->args[0]->imm.i;
            lo = k < 0 ? 0 : k >= (int64_t)hi ? hi - 1 : (uint32_t)k;
            hi = lo + 1;
        }
        for (uint32_t k = i->imm.slot.base + lo; k < i->imm.slot.base + hi; k++)
            active[k >> 3] |= (uint8_t)(1u << (k & 7));
    }
}

void ad_activity(const Fn *fn, uint8_t *active) {
    Arena *scratch = &fn->session->scratch;
    ArenaMark m = arena_mark(scratch);
    Fn *copy = ir_clone(fn, scratch, fn->name);
    ad_clear_tags(copy->body);
    AdFacts f;
    ad_facts(&f, copy, scratch, &(AdOptions){0}, NULL, NULL);
    memset(active, 0, (fn->nfloats + 7) / 8);
    collect_params(&f, copy->body, active);
    arena_reset(scratch, m);
}
