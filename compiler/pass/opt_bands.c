/* Bands: |u| < b under [Disc] becomes u < b && -u < b, a site for each of its two faces; so does u*u < b*b
 * where b does not change with the position.
 *
 * A band much thinner than the spacing of samples lies between two that decide alike: by one comparison nothing tells
 * that they are on different sides of it, and both faces are one g that bends between them. By two their regions
 * differ, so lines look between them, and each face is a smooth curve of its own, of which a cell may hold both. The
 * decision is the same for every number. Only while a sample has no more events than paths are told apart by: above
 * that both outsides look alike again, and events cost.
 *
 * Of squares the decision is the same but for rounding, as in opt_roots.c. */
#include <string.h>

#include "compiler/ir/range.h"
#include "compiler/pass/depend.h"
#include "compiler/pass/pass.h"
#include "compiler/pass/walk.h"

enum { MOST_EVENTS = 64 }; /* as many as region hashes follow paths for (variant_region.c) */

typedef struct Bands {
    Fn *fn;
    uint64_t events;      /* of all sites */
    const IrRange *range; /* by id, of what was there before, */
    const Depend *on;     /* likewise */
} Bands;

/* |u| beside b, in a comparison or in the difference from 0 that stands for one. */
typedef struct Band {
    Inst *u, *b;
    bool inside;  /* asks whether |u| is the smaller one */
    bool squares; /* they are compared: b may be negative */
} Band;

static bool is_zero(const Inst *i) { return i->op == OP_constf && i->imm.f == 0; }

static bool is_square(const Inst *i) { return i->op == OP_fmul && i->args[0] == i->args[1]; }

static bool is_signed(const Bands *s, const Inst *i) { return s->range[i->id].lo < 0; }

/* u*u beside b*b, where b does not change with the position; or fourth powers. That of a length is one boundary as it
 * stands. */
static bool find_squares(const Bands *s, Inst *less, Inst *more, Band *band) {
    if (!is_square(less) || !is_square(more)) return false;
    Inst *p = less->args[0], *q = more->args[0];
    if (!is_signed(s, p) && !is_signed(s, q)) return find_squares(s, p, q, band);
    bool left = s->on[p->id].on & DEPENDS_X, right = s->on[q->id].on & DEPENDS_X;
    if (left == right || !is_signed(s, left ? p : q)) return false;
    *band = (Band){left ? p : q, left ? q : p, left, true};
    return true;
}

static bool find(const Bands *s, const Inst *cmp, Band *band) {
    Inst *less = cmp->args[0], *more = cmp->args[1];
    bool flip = is_zero(less);
    if (is_zero(more) || flip) { /* |u| - b < 0, or b - |u| < 0 */
        const Inst *d = flip ? more : less;
        if (d->op != OP_fsub) return false;
        less = d->args[flip], more = d->args[!flip];
    }
    bool left = less->op == OP_fabs, right = more->op == OP_fabs;
    if (left == right) return find_squares(s, less, more, band);
    *band = (Band){.u = left ? less->args[0] : more->args[0], .b = left ? more : less, .inside = left};
    return true;
}

/* What is never negative, whatever b is. */
static Inst *root_of(Builder *b, const Band *band) { return band->squares ? ir_emit1(b, OP_fabs, band->b) : band->b; }

/* Is g positive where the comparison does not hold, rather than where it does? */
static bool rises_outside(const Inst *cmp, const Inst *g, bool *known) {
    const Inst *p = cmp->args[0], *q = cmp->args[1];
    *known = true;
    if (g->op == OP_fsub && g->args[0] == p && g->args[1] == q) return true;
    if (g->op == OP_fsub && g->args[0] == q && g->args[1] == p) return false;
    if (g == p && is_zero(q)) return true;
    if (g == q && is_zero(p)) return false;
    *known = false;
    return false;
}

/* One face: u beside b, of which the comparison and g are made as they were of |u|. */
static void face(Builder *b, Op compare, Inst *u, const Band *band, bool outside, Inst *face[2]) {
    Inst *less = band->inside ? u : band->b, *more = band->inside ? band->b : u;
    face[0] = ir_emit2(b, compare, less, more);
    face[1] = outside ? ir_emit2(b, OP_fsub, less, more) : ir_emit2(b, OP_fsub, more, less);
}

static bool split(Bands *s, Inst *site) {
    Fn *fn = s->fn;
    Inst *cmp = site->args[0], *args[2 + SLT_MAX_K], *near[2], *far[2];
    const SiteInfo *info = &fn->sites[site->imm.i];
    Band band;
    bool known, outside;
    if ((cmp->op != OP_flt && cmp->op != OP_fle) || info->skip_loop || info->still || !find(s, cmp, &band))
        return false;
    outside = rises_outside(cmp, site->args[1], &known);
    if (!known || s->events + info->max_events > MOST_EVENTS) return false;
    s->events += info->max_events;
    SiteInfo *sites = ARENA_ARRAY(fn->arena, SiteInfo, fn->nsites + 1);
    memcpy(sites, fn->sites, fn->nsites * sizeof *sites);
    sites[fn->nsites] = *info, fn->sites = sites;
    Builder b = ir_before(fn, site);
    b.span = site->span;
    band.b = root_of(&b, &band);
    face(&b, (Op)cmp->op, band.u, &band, outside, near);
    face(&b, (Op)cmp->op, ir_emit1(&b, OP_fneg, band.u), &band, outside, far);
    memcpy(args, site->args, site->nargs * sizeof *args);
    args[0] = far[0], args[1] = far[1];
    ir_replace_arg(site, 0, near[0]), ir_replace_arg(site, 1, near[1]);
    Builder after = ir_after(fn, site);
    after.span = site->span;
    Inst *other = ir_special(&after, OP_site, TY_BOOL, site->nargs, args, (Imm){.i = fn->nsites++});
    Inst *both = ir_emit2(&after, band.inside ? OP_band : OP_bor, other, other);
    walk_replace(fn->body, site, both);
    ir_replace_arg(both, 0, site);
    return true;
}

static bool bands_in(Bands *s, Block *b) {
    bool changed = false;
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) changed |= bands_in(s, i->region[r]);
        if (i->op == OP_site) changed |= split(s, i);
    }
    return changed;
}

bool opt_bands(PassCtx *ctx, Fn *fn) {
    Arena *scratch = &ctx->session->scratch;
    ArenaMark m = arena_mark(scratch);
    uint32_t n = ir_number(fn);
    IrRange *range = ARENA_ARRAY(scratch, IrRange, n + 1);
    ir_ranges(fn, scratch, NULL, range);
    Bands s = {.fn = fn, .range = range, .on = depend_values(fn, (DependOptions){0})};
    for (uint32_t i = 0; i < fn->nsites; i++)
        s.events += fn->sites[i].max_events > MOST_EVENTS ? MOST_EVENTS + 1 : fn->sites[i].max_events;
    bool changed = bands_in(&s, fn->body);
    arena_reset(scratch, m);
    return changed;
}
