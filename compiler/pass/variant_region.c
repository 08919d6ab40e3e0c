/* region (the paper's piecewise-constant variant): a hash of the decisions, so that two points with equal hashes see
 * one continuous piece of f.
 *
 * The hash is one of the path or of provenance. Path (VariantOptions.path_hash, which is set up to 64 events a sample;
 * and programs with local arrays): the keys of the events whose decision is true, combined by xor; integer-valued sites
 * mix their integer in. Provenance, above: variant_provenance.c. All colour arithmetic dies in the slice. With
 * `near_miss` the kernel also outputs the executed event with the smallest |g|: the runtime's probe for features
 * thinner than the spacing looks at it on neighbouring samples. */
#include <string.h>

#include "compiler/pass/variant.h"

static Inst *site_hash(Builder *b, Inst *site) {
    Inst *key = variant_event_key(b, site);
    if (site->op == OP_site) return ir_select(b, site, key, ir_consti(b, 0));
    return ir_mix_inst(b, key, ir_emit1(b, OP_f2i, site));
}

static bool hash_at(Thread *t, Inst *i) {
    Builder b = ir_after(t->fn, i);
    b.fold = true;
    t->value[0] = ir_emit2(&b, OP_ixor, t->value[0], site_hash(&b, i));
    return true;
}

/* Only sites of skipped loops: their decision is used before them, so no provenance leads through them. */
static bool touches_skipped(Thread *t, const Inst *i) {
    return variant_is_site(i) && variant_site_info(t->fn, i)->skip_loop;
}

static bool has_skipped(const Fn *fn) {
    for (uint32_t s = 0; s < fn->nsites; s++)
        if (fn->sites[s].skip_loop) return true;
    return false;
}

bool variant_tells_origin(const Fn *fn, const VariantOptions *o) {
    return !o->path_hash && !has_skipped(fn) && variant_has_provenance(fn);
}

Inst *variant_hash(PassCtx *ctx, Fn *fn, const VariantOptions *o) {
    Inst *origin = o->path_hash ? NULL : variant_provenance(ctx, fn);
    if (origin && !has_skipped(fn)) return origin;
    Builder b = fn->body->first ? ir_before(fn, fn->body->first) : ir_at_end(fn, fn->body);
    Thread t = {.fn = fn, .n = 1, .at = hash_at, .touches = origin ? touches_skipped : variant_touches_site};
    t.value[0] = ir_consti(&b, 0);
    thread_block(&t, fn->body);
    if (!origin) return t.value[0];
    b = ir_before(fn, fn->body->last);
    return ir_emit2(&b, OP_ixor, origin, t.value[0]);
}

/* ---- near miss: best |g|, signed g there, site, k0.. */
typedef struct Near {
    uint32_t depth;
} Near;

static Inst *near_g(Builder *b, const Fn *fn, const Inst *site) {
    if (site->op == OP_site) return site->args[1];
    /* The nearer of the two boundaries of the integer's interval. */
    SiteKind kind = variant_site_info(fn, site)->kind;
    Inst *n = (Inst *)site, *v = site->args[1];
    Inst *up = ir_emit2(b, OP_fsub, v, variant_boundary(b, kind, n));
    Inst *down = ir_emit2(b, OP_fsub, v, variant_boundary(b, kind, ir_emit2(b, OP_fsub, n, ir_constf(b, 1))));
    return ir_select(b, ir_emit2(b, OP_flt, ir_emit1(b, OP_fabs, up), ir_emit1(b, OP_fabs, down)), up, down);
}

/* The g of a ray's site belongs to a pair of lanes, so such a site is never near. Nor is one that stands still: what is
 * thin beside it weighs nothing. */
static bool touches_near(Thread *t, const Inst *i) {
    if (!variant_is_site(i)) return false;
    const SiteInfo *info = variant_site_info(t->fn, i);
    return !ir_site_of_ray(info->kind) && !info->still;
}

static bool near_at(Thread *t, Inst *i) {
    if (!touches_near(t, i)) return false;
    Near *near = t->user;
    Builder b = ir_after(t->fn, i);
    b.fold = true;
    Inst *g = near_g(&b, t->fn, i), *mag = ir_emit1(&b, OP_fabs, g);
    Inst *closer = ir_emit2(&b, OP_flt, mag, t->value[0]);
    t->value[0] = ir_select(&b, closer, mag, t->value[0]);
    t->value[1] = ir_select(&b, closer, g, t->value[1]);
    t->value[2] = ir_select(&b, closer, ir_consti(&b, (int32_t)i->imm.i), t->value[2]);
    for (uint32_t d = 0; d < near->depth; d++)
        t->value[3 + d] = ir_select(&b, closer, d + 2 < i->nargs ? i->args[d + 2] : ir_consti(&b, 0), t->value[3 + d]);
    return true;
}

Fn *variant_region(PassCtx *ctx, const Fn *primal, const VariantOptions *o) {
    Fn *fn = variant_clone(ctx, primal, "region", true);
    opt_dce(ctx, fn); /* sites that reach no output are no events */
    Inst *search[SLT_WITNESSES];
    uint32_t nsearch = variant_searches(fn, search);
    Outputs out = {0};
    Inst *faces = variant_faces(fn), *hash = variant_hash(ctx, fn, o),
         *depth = variant_has_depth(fn) ? variant_depth(fn) : NULL;
    variant_output(&out, SLT_OUT_HASH, 0, hash);
    if (depth) variant_output(&out, SLT_OUT_DEPTH, 0, depth);
    if (faces) variant_output(&out, SLT_OUT_FACE, 0, faces);
    variant_witnesses(fn, nsearch, search, &out);
    if (o->near_miss) {
        Near near = {variant_site_depth(fn->body)};
        Builder b = fn->body->first ? ir_before(fn, fn->body->first) : ir_at_end(fn, fn->body);
        Thread t = {.fn = fn, .n = 3 + near.depth, .at = near_at, .touches = touches_near, .user = &near};
        t.value[0] = ir_constf(&b, __builtin_inf());
        t.value[1] = ir_constf(&b, 0);
        t.value[2] = ir_consti(&b, -1);
        for (uint32_t d = 0; d < near.depth; d++) t.value[3 + d] = ir_consti(&b, 0);
        thread_block(&t, fn->body);
        variant_output(&out, SLT_OUT_NEAR_SITE, 0, t.value[2]);
        variant_output(&out, SLT_OUT_NEAR_G, 0, t.value[1]);
        for (uint32_t d = 0; d < near.depth; d++) variant_output(&out, SLT_OUT_NEAR_K, d, t.value[3 + d]);
    }
    variant_set_outputs(fn, &out);
    variant_drop_sites(fn);
    opt_dce(ctx, fn);
    return fn;
}
