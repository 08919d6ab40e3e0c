/* value: f(x). Also what all variants share. */
#include <string.h>

#include "compiler/pass/variant.h"

static void drop_silent(Block *b) {
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) drop_silent(i->region[r]);
        if (i->op == OP_print || i->op == OP_count) ir_unlink(i);
    }
}

Fn *variant_clone(PassCtx *ctx, const Fn *primal, const char *name, bool silent) {
    Fn *fn = ir_clone(primal, primal->arena, name);
    lower_custom(ctx, fn);
    if (silent) drop_silent(fn->body);
    return fn;
}

static void drop_sites(Fn *fn, Block *b, bool only_still) {
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) drop_sites(fn, i->region[r], only_still);
        if (variant_is_site(i) && (!only_still || variant_site_info(fn, i)->still)) walk_forward(fn, i, i->args[0]);
    }
}

static void set_standing(Fn *fn, Block *b, bool stands) {
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) set_standing(fn, i->region[r], stands);
        if (i->op != OP_stands) continue;
        Builder at = ir_before(fn, i);
        walk_forward(fn, i, ir_constb(&at, stands));
    }
}

static bool has_standing(const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_stands) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (has_standing(i->region[r])) return true;
    }
    return false;
}

const Fn *variant_standing(const Fn *primal, bool stands) {
    if (!has_standing(primal->body)) return primal;
    Fn *fn = ir_clone(primal, primal->arena, primal->name);
    set_standing(fn, fn->body, stands);
    walk_resolve_forwards(fn->body);
    return fn;
}

void variant_drop_sites(Fn *fn) {
    drop_sites(fn, fn->body, false);
    walk_resolve_forwards(fn->body);
}

void variant_drop_still(Fn *fn) {
    drop_sites(fn, fn->body, true);
    walk_resolve_forwards(fn->body);
}

bool variant_has_site(const Fn *fn, SiteKind from, SiteKind to) {
    for (uint32_t s = 0; s < fn->nsites; s++)
        if (fn->sites[s].kind >= from && fn->sites[s].kind <= to) return true;
    return false;
}

uint32_t variant_site_depth(const Block *b) {
    uint32_t depth = 0;
    for (const Inst *i = b->first; i; i = i->next) {
        if (variant_is_site(i) && i->nargs - 2 > depth) depth = i->nargs - 2;
        for (uint32_t r = 0; r < i->nregions; r++) {
            uint32_t below = variant_site_depth(i->region[r]);
            depth = below > depth ? below : depth;
        }
    }
    return depth;
}

bool variant_touches_site(Thread *t, const Inst *i) {
    (void)t;
    return variant_is_site(i);
}

Inst *variant_event_key(Builder *b, const Inst *site) {
    Inst *key = ir_consti(b, (int32_t)ir_mix(0x9e3779b9u, (uint32_t)site->imm.i + 1u));
    for (uint32_t a = 2; a < site->nargs; a++) key = ir_mix_inst(b, key, site->args[a]);
    return key;
}

Inst *variant_boundary(Builder *b, SiteKind kind, Inst *n) {
    switch (kind) {
    case SITE_FLOOR: return ir_emit2(b, OP_fadd, n, ir_constf(b, 1));
    case SITE_ROUND: return ir_emit2(b, OP_fadd, n, ir_constf(b, 0.5));
    case SITE_CEIL: return n;
    case SITE_TRUNC:
    case SITE_FMOD:
        return ir_select(b, ir_emit2(b, OP_flt, n, ir_constf(b, 0)), n, ir_emit2(b, OP_fadd, n, ir_constf(b, 1)));
    case SITE_COMPARE:
    case SITE_WAVE:
    case SITE_SILHOUETTE:
    case SITE_SHADOW:
    case SITE_MESH:
    case SITE_MESH_FACE:
    case SITE_MESH_SEAM:
    case SITE_MESH_HIT:
    case SITE_MESH_SHADOW: break;
    }
    return ir_constf(b, 0);
}

void variant_output(Outputs *o, SltRole role, uint32_t index, Inst *value) {
    o->name[o->n] = (Output){role, index};
    o->value[o->n++] = value;
}

void variant_set_outputs(Fn *fn, const Outputs *o) {
    Inst *y = fn->body->last;
    y->args = arena_copy(fn->arena, o->value, sizeof *o->value * (o->n ? o->n : 1));
    y->nargs = o->n;
    fn->outputs = arena_copy(fn->arena, o->name, sizeof *o->name * (o->n ? o->n : 1));
}

Fn *variant_differentiable_clone(PassCtx *ctx, const Fn *primal, const char *name) {
    Fn *fn = ir_clone(primal, primal->arena, name);
    lower_custom_sites(ctx, fn);
    drop_silent(fn->body);
    return fn;
}

/* jvp and vjp are made from this kernel: [Tangent] regions stay until pipeline_kernel. */
Fn *variant_value(PassCtx *ctx, const Fn *primal) {
    Fn *fn = ir_clone(primal, primal->arena, "value");
    variant_drop_sites(fn);
    variant_drop_choices(fn);
    opt_dce(ctx, fn);
    return fn;
}
