/* sides (two-sided): f and the region hash together. The runtime evaluates this kernel at both ends of a
 * verified bracket, so that every predicate that differs jumps, also one that is tested twice, and no branch runs whose
 * guard is false.
 *
 * With paper_forced it is the paper's two-sided variant instead: at the crossing, the decision of the event (site, k..)
 * is forced to IN_SIDE > 0 and everything else follows from x. That form gives NaN where the forced side takes a root
 * of a negative number. */
#include "compiler/pass/variant.h"

static void force(Fn *fn, Block *b) {
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) force(fn, i->region[r]);
        if (i->op != OP_site) continue;
        Builder at = ir_before(fn, i);
        Inst *match = ir_emit2(&at, OP_ieq, ir_input(&at, IN_SITE), ir_consti(&at, (int32_t)i->imm.i));
        for (uint32_t a = 2; a < i->nargs; a++)
            match = ir_emit2(&at, OP_band, match,
                             ir_emit2(&at, OP_ieq, ir_input(&at, (InputSlot)(IN_K0 + a - 2)), i->args[a]));
        Inst *side = ir_emit2(&at, OP_flt, ir_constf(&at, 0), ir_input(&at, IN_SIDE));
        ir_replace_arg(i, 0, ir_select(&at, match, side, i->args[0]));
    }
}

Fn *variant_sides(PassCtx *ctx, const Fn *primal, const VariantOptions *o) {
    Fn *fn = variant_clone(ctx, primal, "sides", true);
    opt_dce(ctx, fn);
    if (o->paper_forced) force(fn, fn->body);
    uint32_t channels = fn->body->last->nargs;
    Inst *search[SLT_WITNESSES];
    uint32_t nsearch = variant_searches(fn, search);
    Inst *faces = variant_faces(fn), *hash = variant_hash(ctx, fn, o);
    Outputs out = {0};
    for (uint32_t c = 0; c < channels; c++) variant_output(&out, SLT_OUT_F, c, fn->body->last->args[c]);
    variant_output(&out, SLT_OUT_HASH, 0, hash);
    if (variant_has_depth(fn)) variant_output(&out, SLT_OUT_DEPTH, 0, variant_depth(fn));
    if (faces) variant_output(&out, SLT_OUT_FACE, 0, faces);
    variant_witnesses(fn, nsearch, search, &out);
    variant_set_outputs(fn, &out);
    variant_drop_sites(fn);
    opt_dce(ctx, fn);
    return fn;
}
