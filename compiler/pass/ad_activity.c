/* Which values carry derivatives, and what is known of the values themselves.
 *
 * varied: depends differentiably on something differentiated (forward from the parameters); useful: an output depends
 * differentiably on it (backward from the outputs). Only what is both gets a tangent or an adjoint. Arrays are one
 * value each. Both are least fixpoints over the loops. Ranges are plain interval arithmetic in two sweeps: the first
 * knows nothing of what is carried around loops or kept in arrays, the second uses what the first found to be assigned
 * there, so a clamp in a loop is seen. */
#include <math.h>
#include <string.h>

#include "compiler/pass/ad.h"

/* ---- ranges */

static AdRange normal(AdRange r) {
    if (isnan(r.lo)) r.lo = -INFINITY;
    if (isnan(r.hi)) r.hi = INFINITY;
    if (r.lo > -INFINITY && r.hi < INFINITY) r.inf = 0;
    return r;
}
static AdRange range(double lo, double hi, uint8_t inf) { return normal((AdRange){lo, hi, inf}); }
static AdRange join(AdRange a, AdRange b) { return range(fmin(a.lo, b.lo), fmax(a.hi, b.hi), a.inf | b.inf); }

AdRange ad_range_const(double v) {
    return isfinite(v) ? (AdRange){v, v, 0} : isnan(v) ? AD_RANGE_FINITE : (AdRange){v, v, AD_POLE};
}

static double times(double a, double b) { return a == 0 || b == 0 ? 0 : a * b; }

/* A bound this small may underflow to 0 in binary32, so it proves nothing. */
static double solid(double lo) { return fabs(lo) < 1e-37 ? 0 : lo; }

static AdRange product(AdRange a, AdRange b, bool same) {
    uint8_t inf = a.inf | b.inf;
    double p[4] = {times(a.lo, b.lo), times(a.lo, b.hi), times(a.hi, b.lo), times(a.hi, b.hi)};
    if (same) {
        double low = a.lo > 0 ? a.lo * a.lo : a.hi < 0 ? a.hi * a.hi : 0;
        return range(solid(low), fmax(a.lo * a.lo, a.hi * a.hi), inf);
    }
    return range(solid(fmin(fmin(p[0], p[1]), fmin(p[2], p[3]))), solid(fmax(fmax(p[0], p[1]), fmax(p[2], p[3]))), inf);
}

static AdRange quotient(AdRange a, AdRange b) {
    if (!ad_range_nonzero(b)) return AD_RANGE_ANY;
    AdRange inverse = {1 / b.hi, 1 / b.lo, 0};
    return product(a, inverse, false);
}

/* exp and its kin: infinite unless bounded above (80 serves both precisions). */
static AdRange exponential(AdRange a, double base) {
    double scale = log(base), hi = a.hi * scale;
    return range(a.lo * scale > -80 ? pow(base, a.lo) : 0, hi < 80 ? pow(base, a.hi) : INFINITY,
                 hi >= 80 ? AD_OVERFLOW : 0);
}

AdRange ad_range_row(Op op, AdRange a, AdRange b, AdRange c, bool same) {
    uint8_t any = a.inf | b.inf;
    switch (op) {
    case OP_fadd: return range(a.lo + b.lo, a.hi + b.hi, any);
    case OP_fsub: return range(a.lo - b.hi, a.hi - b.lo, any);
    case OP_fmul:
    case OP_zmul: {
        AdRange p = product(a, b, same);
        if (op == OP_zmul) p = join(p, ad_range_const(0));
        return p;
    }
    case OP_ffma: {
        AdRange p = product(a, b, same);
        return range(p.lo + c.lo, p.hi + c.hi, p.inf | c.inf);
    }
    case OP_fdiv:
    case OP_zdiv: return quotient(a, b);
    case OP_fneg: return range(-a.hi, -a.lo, a.inf);
    case OP_fabs: return range(a.lo > 0 ? a.lo : a.hi < 0 ? -a.hi : 0, fmax(fabs(a.lo), fabs(a.hi)), a.inf);
    case OP_fmin: return range(fmin(a.lo, b.lo), fmin(a.hi, b.hi), any);
    case OP_fmax: return range(fmax(a.lo, b.lo), fmax(a.hi, b.hi), any);
    case OP_fcopysign: {
        double m = fmax(fabs(a.lo), fabs(a.hi));
        return range(-m, m, a.inf);
    }
    case OP_fsqrt: return range(a.lo > 0 ? sqrt(a.lo) : 0, a.hi > 0 ? sqrt(a.hi) : INFINITY, a.inf);
    case OP_frsqrt:
        return a.lo > 0 ? range(a.hi < INFINITY ? 1 / sqrt(a.hi) : 0, 1 / sqrt(a.lo), 0)
                        : (AdRange){0, INFINITY, AD_POLE};
    case OP_fcbrt: return range(cbrt(a.lo), cbrt(a.hi), a.inf);
    case OP_ffloor:
    case OP_fceil:
    case OP_fround:
    case OP_ftrunc: return range(a.lo - 1, a.hi + 1, a.inf);
    case OP_fexp: return exponential(a, exp(1.0));
    case OP_fexp2: return exponential(a, 2);
    case OP_flog: return a.lo > 0 ? range(log(a.lo), log(a.hi), a.inf) : AD_RANGE_ANY;
    case OP_flog2: return a.lo > 0 ? range(log2(a.lo), log2(a.hi), a.inf) : AD_RANGE_ANY;
    case OP_fsin:
    case OP_fcos:
    case OP_ftanh:
    case OP_ferf: return range(-1.001, 1.001, 0);
    case OP_fasin:
    case OP_facos:
    case OP_fatan:
    case OP_fatan2: return range(-3.2, 3.2, 0);
    case OP_fcosh:
        return range(1, a.lo > -80 && a.hi < 80 ? cosh(fmax(fabs(a.lo), fabs(a.hi))) : INFINITY, AD_OVERFLOW);
    case OP_fsinh: return a.lo > -80 && a.hi < 80 ? range(sinh(a.lo), sinh(a.hi), 0) : AD_RANGE_CARRIED;
    case OP_ftan: return AD_RANGE_ANY;
    case OP_fpow:
        return range(a.lo >= 0 ? 0 : -INFINITY, INFINITY, b.lo >= 0 && b.lo == b.hi ? a.inf : AD_POLE | AD_OVERFLOW);
    case OP_fsel: return join(b, c);
    case OP_i2f:
    case OP_u2f: return range(op == OP_u2f ? 0 : -2147483649.0, 4294967297.0, 0);
    case OP_iasfloat: return AD_RANGE_ANY;
    case OP_ftwoi: return (AdRange){0, INFINITY, AD_OVERFLOW};
    default: return AD_RANGE_FINITE;
    }
}

typedef struct Walk {
    AdFacts *f;
    AdRange *next;  /* by id: what loops assign to a carried parameter, and what is stored in an array, found by the
                       sweep before */
    AdRange *found; /* the same, being found */
    bool changed;
} Walk;

static AdRange range_of(const AdFacts *f, const Inst *v) {
    return v->type == TY_FLT ? f->range[v->id] : AD_RANGE_FINITE;
}

static void ranges_in(Walk *w, Block *b);

static void range_region(Walk *w, Inst *i) {
    AdFacts *f = w->f;
    for (uint32_t r = 0; r < i->nregions; r++) {
        Block *body = i->region[r];
        for (uint32_t p = 0; p < body->nparams; p++) f->range[body->params[p]->id] = AD_RANGE_CARRIED;
        if (i->op == OP_loop)
            for (uint32_t p = 1; p < body->nparams; p++)
                f->range[body->params[p]->id] = join(range_of(f, i->args[p - 1]), w->next[body->params[p]->id]);
        if (i->op == OP_custom)
            for (uint32_t p = 0; p < body->nparams && p < i->nargs; p++)
                f->range[body->params[p]->id] = range_of(f, i->args[p]);
        ranges_in(w, body);
        if (i->op == OP_loop)
            for (uint32_t p = 1; p < body->nparams; p++)
                w->found[body->params[p]->id] = range_of(f, body->last->args[p]);
    }
}

static void ranges_in(Walk *w, Block *b) {
    AdFacts *f = w->f;
    for (Inst *i = b->first; i; i = i->next) {
        AdRange r = AD_RANGE_FINITE;
        switch ((Op)i->op) {
        case OP_constf: r = ad_range_const(i->imm.f); break;
        case OP_rand: r = range(0, 1, 0); break;
        case OP_detach:
        case OP_siten: r = range_of(f, i->args[0]); break;
        case OP_load: r = w->next[i->args[0]->id]; break;
        case OP_partner:
        case OP_query: r = AD_RANGE_ANY; break;
        case OP_alloc: w->found[i->id] = ad_range_const(0); break;
        case OP_store: w->found[i->args[0]->id] = join(w->found[i->args[0]->id], range_of(f, i->args[2])); break;
        case OP_acopy: w->found[i->args[0]->id] = join(w->found[i->args[0]->id], w->next[i->args[1]->id]); break;
        case OP_if_:
        case OP_loop:
        case OP_revloop:
        case OP_custom: range_region(w, i); break;
        case OP_proj: {
            const Inst *o = i->args[0];
            if (i->type != TY_FLT) break;
            r = range_of(f, walk_results(o, o->region[0])[i->imm.i]);
            if (o->op == OP_if_) r = join(r, range_of(f, walk_results(o, o->region[1])[i->imm.i]));
            break;
        }
        default:
            if (!ir_ops[i->op].special && i->type == TY_FLT) {
                AdRange a[3] = {AD_RANGE_FINITE, AD_RANGE_FINITE, AD_RANGE_FINITE};
                for (uint32_t k = 0; k < i->nargs && k < 3; k++) a[k] = range_of(f, i->args[k]);
                r = ad_range_row((Op)i->op, a[0], a[1], a[2], i->nargs > 1 && i->args[0] == i->args[1]);
            }
        }
        f->range[i->id] = r;
    }
}

/* ---- activity */

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
    for (uint32_t k = 0; k < count; k++)
        if (o->wrt[base + k]) return true;
    return false;
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
        case OP_detach: on = i->tag && v[f->links[i->tag - 1]->id]; break;
        case OP_load: on = i->type == TY_FLT && v[i->args[0]->id]; break;
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
        else if (i->op == OP_detach && i->tag) useful_arg(w, f->links[i->tag - 1]);
        else if (!ir_ops[i->op].special)
            for (uint32_t a = 0; a < i->nargs; a++)
                if (i->args[a]->type == TY_FLT && ad_mentions(i, a, NULL, NULL) != UINT32_MAX)
                    useful_arg(w, i->args[a]);
    }
}

void ad_facts(AdFacts *f, Fn *fn, Arena *arena, const AdOptions *o, Inst **links) {
    uint32_t n = ir_number(fn);
    *f = (AdFacts){.fn = fn, .arena = arena, .n = n, .o = o, .links = links};
    f->varied = ARENA_ARRAY(arena, uint8_t, n + 1);
    f->useful = ARENA_ARRAY(arena, uint8_t, n + 1);
    f->range = ARENA_ARRAY(arena, AdRange, n + 1);
    Walk w = {.f = f, .next = ARENA_ARRAY(arena, AdRange, n + 1), .found = ARENA_ARRAY(arena, AdRange, n + 1)};
    for (uint32_t k = 0; k < n; k++) w.next[k] = w.found[k] = AD_RANGE_CARRIED;
    ranges_in(&w, fn->body);
    AdRange *first = w.found;
    w.found = w.next;
    w.next = first;
    ranges_in(&w, fn->body);
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

const char *ad_output_name(Fn *fn, const Fn *from, uint32_t index, const char *prefix) {
    return from->outputs && from->outputs[index] ? arena_printf(fn->arena, "%s%s", prefix, from->outputs[index])
                                                 : arena_printf(fn->arena, "%sf.%u", prefix, index);
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
    ad_facts(&f, copy, scratch, &(AdOptions){0}, NULL);
    memset(active, 0, (fn->nfloats + 7) / 8);
    collect_params(&f, copy->body, active);
    arena_reset(scratch, m);
}
