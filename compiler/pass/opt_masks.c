/* Untagged jumps that stand still, and on which [Disc] sites hang, become sites: if (x.x > 0.1) { [Disc] if (..) .. }.
 *
 * Their own motion is none, so they add nothing to a derivative. But the search along a line needs to know of them: the
 * piece of a tagged curve between a mask's edge and the next vertex is seen only if the mask is part of the region, and
 * what jumps at the mask's edge is that edge, not the tagged curve. Sites that do not move cost a search where they
 * cross a line, so only those are made on which another site hangs: in its condition or that of a loop around it, or
 * comparisons in its g. In a loop every iteration has its own. Not where a loop without a fixed end hands the place on
 * from step to step, as a march does: each step would have an edge, and none of them shows. */
#include <string.h>

#include "compiler/pass/depend.h"
#include "compiler/pass/slice.h"
#include "compiler/pass/walk.h"

typedef struct Masks {
    Fn *fn;
    Arena *scratch;
    Slice conditions, boundaries; /* what conditions of sites, and their g, come from */
    bool *tagged;                 /* by id: the decision of a site */
} Masks;

static void look_at_sites(Masks *m, Block *b) {
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) look_at_sites(m, i->region[r]);
        if (i->op != OP_site && i->op != OP_siten) continue;
        m->tagged[i->args[0]->id] = true;
        slice_add(&m->boundaries, i->args[1]);
        for (const Block *at = b; at->owner; at = at->owner->block) {
            if (at->owner->op == OP_if_) slice_add(&m->conditions, at->owner->args[0]);
            if (at->owner->op == OP_loop) slice_add(&m->conditions, at->last->args[0]);
        }
    }
}

/* In a [Tangent], where no sites are; or made of what a loop around it carries, which nobody knows when to end. */
static bool is_out_of_reach(const Masks *m, const Untracked *t) {
    ArenaMark mark = arena_mark(m->scratch);
    Slice from = {0};
    bool out = false;
    for (const Block *b = t->at->block; b->owner && !out; b = b->owner->block) {
        out = b->owner->op != OP_if_ && b->owner->op != OP_loop;
        if (b->owner->op != OP_loop || b->owner->imm.loop.exact || b->nparams < 2) continue;
        if (!from.in) {
            from = slice_begin(m->fn, m->scratch, true);
            slice_add(&from, t->g0), slice_add(&from, t->g1), slice_close(&from);
        }
        for (uint32_t p = 1; p < b->nparams; p++) out |= from.in[b->params[p]->id];
    }
    arena_reset(m->scratch, mark);
    return out;
}

/* SITE_COMPARE: a comparison. */
static bool kind_of(const Untracked *t, SiteKind *kind) {
    static const struct {
        uint8_t op, kind;
    } roundings[] = {{OP_ffloor, SITE_FLOOR}, {OP_fceil, SITE_CEIL}, {OP_fround, SITE_ROUND}, {OP_ftrunc, SITE_TRUNC}};
    *kind = SITE_COMPARE;
    if (t->kind == JUMP_COMPARE) return t->g0 && t->g1 && (t->at->op == OP_flt || t->at->op == OP_fle);
    for (size_t k = 0; k < sizeof roundings / sizeof *roundings && t->kind == JUMP_BUILTIN; k++)
        if (t->at->op == roundings[k].op && t->at->args[0] == t->g0 && !t->g1) {
            *kind = (SiteKind)roundings[k].kind;
            return true;
        }
    return false;
}

static bool stands_still(const Masks *m, const Untracked *t, const Depend *dep) {
    uint8_t on = (uint8_t)(dep[t->g0->id].on | (t->g1 ? dep[t->g1->id].on : 0));
    bool decides = m->conditions.in[t->at->id] || (t->kind == JUMP_COMPARE && m->boundaries.in[t->at->id]);
    return decides && (on & DEPENDS_X) && !(on & DEPENDS_PARAM) && !m->tagged[t->at->id] && !is_out_of_reach(m, t);
}

bool opt_masks(PassCtx *ctx, Fn *fn) {
    const Program *p = ctx->program;
    if (!p || !p->nuntracked || !fn->nsites) return false;
    Arena *scratch = &ctx->session->scratch;
    ArenaMark at = arena_mark(scratch);
    uint32_t n = ir_number(fn), before = fn->nsites, count = 0;
    const Depend *dep = depend_values(fn, (DependOptions){.program = p});
    Masks m = {.fn = fn,
               .scratch = scratch,
               .conditions = slice_begin(fn, scratch, true),
               .boundaries = slice_begin(fn, scratch, true),
               .tagged = ARENA_ARRAY(scratch, bool, n + 1)};
    look_at_sites(&m, fn->body);
    slice_close(&m.conditions), slice_close(&m.boundaries);
    const Untracked **chosen = ARENA_ARRAY(scratch, const Untracked *, p->nuntracked);
    SiteKind *kind = ARENA_ARRAY(scratch, SiteKind, p->nuntracked); /* before the first site changes operands */
    for (uint32_t u = 0; u < p->nuntracked; u++)
        if (kind_of(&p->untracked[u], &kind[count]) && stands_still(&m, &p->untracked[u], dep)) {
            m.tagged[p->untracked[u].at->id] = true;
            chosen[count++] = &p->untracked[u];
        }
    SiteInfo *sites = count ? ARENA_ARRAY(fn->arena, SiteInfo, before + count) : NULL;
    if (count) memcpy(sites, fn->sites, before * sizeof *sites), fn->sites = sites;
    for (uint32_t i = 0; i < count; i++) {
        const Untracked *t = chosen[i];
        SiteInfo *info = &sites[fn->nsites];
        *info = (SiteInfo){.kind = kind[i], .span = t->span, .still = true, .text = "untagged, stands still"};
        walk_make_site(fn, t->at, t->g0, t->g1, info);
    }
    bool changed = fn->nsites > before;
    arena_reset(scratch, at);
    return changed;
}
