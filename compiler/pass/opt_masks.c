/* Untagged jumps that stand still, and on which [Disc] sites hang, become sites: if (x.x > 0.1) { [Disc] if (..) .. }.
 *
 * Their own motion is none, so they add nothing to a derivative. But the search along a line needs to know of them: the
 * piece of a tagged curve between a mask's edge and the next vertex is seen only if the mask is part of the region, and
 * what jumps at the mask's edge is that edge, not the tagged curve. Sites that do not move cost a search where they
 * cross a line, so only those are made on which another site hangs: in its condition, or comparisons in its g; none in
 * loops, and none that would take the program over the limit of the path hash. None either where rays are searched.
 * TODO: with a mask made there, the window of some ray's site is not found (pathtrace.salt); why is not known. */
#include <string.h>

#include "compiler/pass/depend.h"
#include "compiler/pass/slice.h"
#include "compiler/pass/walk.h"

enum { MOST_EVENTS = 64 };

typedef struct Masks {
    Fn *fn;
    Slice conditions, boundaries; /* what conditions of sites, and their g, come from */
    bool *tagged;                 /* by id: the decision of a site */
    uint64_t events;
} Masks;

static void look_at_sites(Masks *m, Block *b) {
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) look_at_sites(m, i->region[r]);
        if (i->op != OP_site && i->op != OP_siten) continue;
        m->events += m->fn->sites[i->imm.i].max_events;
        m->tagged[i->args[0]->id] = true;
        slice_add(&m->boundaries, i->args[1]);
        for (const Block *at = b; at->owner; at = at->owner->block)
            if (at->owner->op == OP_if_) slice_add(&m->conditions, at->owner->args[0]);
    }
}

static bool in_loop(const Inst *i) {
    for (const Block *b = i->block; b; b = b->owner ? b->owner->block : NULL)
        if (b->owner && b->owner->op != OP_if_) return true; /* nor in a [Tangent] */
    return false;
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
    return decides && (on & DEPENDS_X) && !(on & DEPENDS_PARAM) && !m->tagged[t->at->id] && !in_loop(t->at);
}

static void make_site(Fn *fn, const Untracked *t, SiteKind kind, SiteInfo *info) {
    *info = (SiteInfo){.kind = kind,
                       .span = t->span,
                       .path = fn->name,
                       .max_events = 1,
                       .still = true,
                       .text = "untagged, stands still"};
    Builder b = ir_after(fn, t->at);
    b.span = t->span;
    Inst *g = kind == SITE_COMPARE ? ir_emit2(&b, OP_fsub, t->g0, t->g1) : t->g0, *args[2] = {t->at, g};
    bool compares = kind == SITE_COMPARE;
    Inst *site =
        ir_special(&b, compares ? OP_site : OP_siten, compares ? TY_BOOL : TY_FLT, 2, args, (Imm){.i = fn->nsites++});
    walk_replace(fn->body, t->at, site);
    ir_replace_arg(site, 0, t->at);
}

static bool has_rays(const Fn *fn) {
    for (uint32_t i = 0; i < fn->nsites; i++)
        if (ir_site_of_ray(fn->sites[i].kind)) return true;
    return false;
}

bool opt_masks(PassCtx *ctx, Fn *fn) {
    const Program *p = ctx->program;
    if (!p || !p->nuntracked || !fn->nsites || has_rays(fn)) return false;
    Arena *scratch = &ctx->session->scratch;
    ArenaMark at = arena_mark(scratch);
    uint32_t n = ir_number(fn), before = fn->nsites, count = 0;
    const Depend *dep = depend_values(fn, (DependOptions){.program = p});
    Masks m = {.fn = fn,
               .conditions = slice_begin(fn, scratch, true),
               .boundaries = slice_begin(fn, scratch, true),
               .tagged = ARENA_ARRAY(scratch, bool, n + 1)};
    look_at_sites(&m, fn->body);
    slice_close(&m.conditions), slice_close(&m.boundaries);
    const Untracked **chosen = ARENA_ARRAY(scratch, const Untracked *, p->nuntracked);
    SiteKind kind;
    for (uint32_t u = 0; u < p->nuntracked; u++)
        if (kind_of(&p->untracked[u], &kind) && stands_still(&m, &p->untracked[u], dep)) {
            m.tagged[p->untracked[u].at->id] = true;
            chosen[count++] = &p->untracked[u];
        }
    if (m.events + count > MOST_EVENTS) count = 0;
    SiteInfo *sites = count ? ARENA_ARRAY(fn->arena, SiteInfo, before + count) : NULL;
    if (count) memcpy(sites, fn->sites, before * sizeof *sites), fn->sites = sites;
    for (uint32_t i = 0; i < count; i++) {
        kind_of(chosen[i], &kind);
        make_site(fn, chosen[i], kind, &sites[fn->nsites]);
    }
    arena_reset(scratch, at);
    return count > 0;
}
