/* The order of everything between the front end and the back end. */
#include <string.h>

#include "compiler/pass/depend.h"
#include "compiler/pass/lower_math.h"
#include "compiler/pass/variant.h"

const char *const kernel_names[SLT_KERNELS] = {
#define SLT_KERNEL(id, text, ...) text,
#include "saltus/kernel.def"
};
_Static_assert(K_CULL == SLT_KERNELS - 1, "K_KINDS counts the kinds before it");
_Static_assert(IN_K7 - IN_K0 + 1 == SLT_MAX_K, "a loop index for each loop around a site");
_Static_assert(IN_SEED3 - IN_SEED0 + 1 == SLT_MAX_CHANNELS, "a seed for each channel");
_Static_assert(SLT_INPUTS <= 64, "SltLayout.reads has a bit for each");
_Static_assert(IN_GIVEN0_K0 - IN_GIVEN0 == SLT_GIVEN, "an input for each event that is given");
_Static_assert(IN_GIVEN2_K1 - IN_GIVEN0_K0 + 1 == SLT_GIVEN * SLT_GIVEN_K, "and for each of its loop indices");
_Static_assert(IN_WITNESS1 - IN_WITNESS0 + 1 == SLT_WITNESSES, "an input for each witness");

#define RUN(pass) pass_run(ctx, stage, fn, PASS_##pass)

void pipeline_warn(PassCtx *ctx, Fn *fn) {
    const PassStage stage = PASS_NEEDS_PRIMAL;
    pass_step(ctx, stage, fn, PASS_front);
    RUN(lower_ddx);
    RUN(opt_marches);
    RUN(opt_skips);
    RUN(opt_masks); /* first these: the front end recorded instructions, which other passes move */
    RUN(warn_jumps);
}

void pipeline_primal(PassCtx *ctx, Fn *fn) {
    const PassStage stage = PASS_NEEDS_PRIMAL;
    pipeline_warn(ctx, fn);
    RUN(opt_fold);
    RUN(opt_induction);
    RUN(opt_dce);
    if (RUN(opt_rotate)) RUN(opt_fold), RUN(opt_dce);
    if (RUN(opt_unroll)) RUN(opt_fold);
    RUN(opt_jam);
    RUN(opt_cse);
    RUN(opt_licm);
    RUN(opt_levels);                     /* before the next, which makes two sites of what it leaves, */
    if (RUN(opt_bands)) RUN(opt_levels); /* each of which may be of such a function: |tanh(u)| < 0.5 */
    RUN(opt_roots);                      /* before the next two make other shapes of powers and of smoothstep */
    RUN(opt_powers);
    RUN(opt_contract); /* these three change floats: no pass does from here on but lower_math */
    RUN(opt_fold);
    RUN(opt_cse);
    RUN(opt_dce);
    RUN(opt_lists); /* last: it marks what the others left */
    variant_mesh_settle(fn);
}

void pipeline_kernel(PassCtx *ctx, Fn *fn) {
    const PassStage stage = PASS_NEEDS_KERNEL;
    pass_step(ctx, stage, fn, PASS_cut);
    RUN(lower_custom);
    RUN(opt_fold);
    RUN(opt_cse);
    RUN(opt_dce);
    RUN(lower_rand);
    RUN(lower_math);
    RUN(opt_lengths);
    RUN(opt_fold);
    RUN(opt_cse);
    RUN(opt_licm);
    RUN(opt_dce);
    if (RUN(opt_fuse)) RUN(opt_cse), RUN(opt_dce);
    RUN(opt_hits);
}

/* Is there a site whose boundary moves with what is differentiated? */
static bool boundary_moves(PassCtx *ctx, Program *p, const uint8_t *wrt) {
    const Fn *primal = p->primal;
    ArenaMark m = arena_mark(&ctx->session->scratch);
    uint8_t *facts = ARENA_ARRAY(&ctx->session->scratch, uint8_t, primal->nsites + 1);
    bool moves = false;
    depend_sites(p->primal, wrt, facts);
    for (uint32_t s = 0; s < primal->nsites; s++) moves |= (facts[s] & DEPENDS_PARAM) != 0;
    arena_reset(&ctx->session->scratch, m);
    return moves;
}

/* Appends what was made from a part of the site kernel; returns where the next one goes. */
static Fn **add_part(Fn **end, const Fn *part, Fn *made) {
    made->serves = part->serves;
    made->next_part = NULL;
    *end = made;
    return &made->next_part;
}

static uint64_t reads(const Block *b) {
    uint64_t slots = 0;
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_input) slots |= (uint64_t)1 << i->imm.i;
        for (uint32_t r = 0; r < i->nregions; r++) slots |= reads(i->region[r]);
    }
    return slots;
}

SltLayout pipeline_layout(const Fn *fn) {
    static const struct {
        uint8_t type, most;
    } role[SLT_ROLES] = {
#define SLT_ROLE(id, text, type, most, ...) {TY_##type, most},
#include "saltus/kernel.def"
    };
    SltLayout l = {0};
    for (const Fn *part = fn; part; part = part->next_part) l.reads |= reads(part->body);
    const Inst *yield = fn->body->last;
    for (uint32_t o = 0; o < yield->nargs; o++) {
        const Output *is = &fn->outputs[o];
        if (!l.out[is->role].count) l.out[is->role].first = (uint16_t)o;
        bool fits = is->index == l.out[is->role].count && o == l.out[is->role].first + is->index &&
                    is->index < role[is->role].most && yield->args[o]->type == role[is->role].type;
        if (!fits) ice(fn->session, "output %u of %s is not where its role puts it", o, fn->name);
        l.out[is->role].count++;
    }
    return l;
}

/* Above this size edge_bounds is not made: it would compile for seconds. Nor is edge then, which only cells ask, and
 * they ask both. */
enum { EDGE_BOUNDS_SIZE = 30000 };

/* Up to this size of the edge kernel without derivatives its bounds have second ones: they triple it. Not in f32, where
 * the larger cells that they make are too large for what rounding hides: curves that touch are told apart no more. */
enum { SECOND_SIZE = 400 };

/* A derivative of its own may change with the position where the value does not. */
static bool has_custom(const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_custom || i->op == OP_ghost) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (has_custom(i->region[r])) return true;
    }
    return false;
}

/* edge and edge_bounds of what variant_edge gives, NULL where there is no edge; edge, bounds: where they go, NULL: not
 * needed. */
static void edge_kernels(PassCtx *ctx, const Fn *parts, Fn **edge, Fn **bounds) {
    if (!parts || (bounds && walk_fn_size(parts) > EDGE_BOUNDS_SIZE)) return; /* its bounds are larger still */
    bool second = parts->precision == PREC_F64 && parts->dim > 1 && walk_fn_size(parts) <= SECOND_SIZE;
    Fn **edge_end = edge, **bounds_end = bounds;
    for (const Fn *part = parts; part; part = part->next_part) {
        Fn *graded = ad_grad_x(ctx, part);
        graded->serves = part->serves;
        if (bounds)
            bounds_end = add_part(bounds_end, part, variant_edge_bounds(ctx, second ? ad_grad_x(ctx, graded) : graded));
        if (edge) edge_end = add_part(edge_end, part, graded);
    }
    if (!bounds || !*bounds || walk_fn_size(*bounds) <= EDGE_BOUNDS_SIZE) return;
    *bounds = NULL;
    if (edge) *edge = NULL;
}

bool pipeline_has_bounds(const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_told) return false;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (!pipeline_has_bounds(i->region[r])) return false;
    }
    return true;
}

/* bounds, edge, edge_bounds and written_bounds, which know seams too. */
static void box_kernels(PassCtx *ctx, const Fn *primal, const Fn *chunks, const bool needs[K_KINDS], bool image,
                        KernelSet *out) {
    if (!needs[K_BOUNDS] && !needs[K_EDGE] && !needs[K_EDGE_BOUNDS] && !needs[K_WRITTEN_BOUNDS]) return;
    Fn *seamed = variant_seams(ctx, primal);
    out->edges = seamed->sites, out->nedges = seamed->nsites;
    out->flat = variant_is_flat(ctx, seamed) && !has_custom(primal->body);
    out->told = true;
    for (uint32_t e = primal->nsites; e < seamed->nsites; e++) out->told &= !seamed->sites[e].jumps;
    /* What decides outside the chunks has seams of its own, with which the numbers of choices would get mixed up. */
    if (chunks && (seamed->nsites != primal->nsites || has_custom(primal->body))) chunks = NULL;
    out->chunked = chunks != NULL;
    if (!chunks) variant_waves(ctx, seamed);
    if (!pipeline_has_bounds(primal->body)) return;
    if (needs[K_BOUNDS]) out->fn[K_BOUNDS] = variant_bounds(ctx, chunks ? chunks : seamed, image);
    Fn **edge = needs[K_EDGE] ? &out->fn[K_EDGE] : NULL;
    Fn **edge_bounds = needs[K_EDGE_BOUNDS] ? &out->fn[K_EDGE_BOUNDS] : NULL;
    if (chunks && primal->nsites) {
        Fn *whole = ad_grad_x(ctx, variant_chunk_edges(ctx, chunks, out->chunks));
        if (edge_bounds) *edge_bounds = variant_edge_bounds(ctx, whole);
        if (edge) *edge = whole;
        return;
    }
    if (edge || edge_bounds) edge_kernels(ctx, variant_edge(ctx, seamed, true), edge, edge_bounds);
    if (needs[K_WRITTEN_BOUNDS] && variant_squares(ctx, ir_clone(seamed, seamed->arena, "squares")))
        edge_kernels(ctx, variant_edge(ctx, seamed, false), NULL, &out->fn[K_WRITTEN_BOUNDS]);
}

/* Every kernel is primal -> variant -> slice -> activity -> AD -> slice; what the program has no use for is not made.
 */
/* Of one event: g and its derivatives, in parts where the program has them. */
static void site_kernels(PassCtx *ctx, const Fn *primal, const bool needs[K_KINDS], const VariantOptions *variant,
                         const AdOptions *wrt, KernelSet *out) {
    AdOptions rows = *wrt;
    rows.rows = primal->channels;
    bool asks = needs[K_SITE] || needs[K_SITE_GRAD] || needs[K_SITE_JVP] || needs[K_SITE_VJP];
    Fn *site = asks ? variant_site(ctx, primal) : NULL, **end[K_KINDS];
    if (site && variant->most_site_size && walk_fn_size(site) > variant->most_site_size)
        session_limit(ctx->session, "its %u sites need %u operations, which would take minutes to compile",
                      primal->nsites, walk_fn_size(site));
    for (int k = 0; k < K_KINDS; k++) end[k] = &out->fn[k];
    for (Fn *part = site; part; part = part->next_part) {
        if (needs[K_SITE]) end[K_SITE] = add_part(end[K_SITE], part, ir_clone(part, part->arena, "site"));
        if (needs[K_SITE_GRAD]) end[K_SITE_GRAD] = add_part(end[K_SITE_GRAD], part, ad_grad_x(ctx, part));
        if (needs[K_SITE_JVP]) end[K_SITE_JVP] = add_part(end[K_SITE_JVP], part, ad_jvp(ctx, part, wrt));
        if (needs[K_SITE_VJP]) {
            TapeReport tape = {0}, *all = &out->tape[K_SITE_VJP];
            end[K_SITE_VJP] = add_part(end[K_SITE_VJP], part, ad_vjp(ctx, part, &rows, &tape));
            if (tape.bytes_per_lane >= all->bytes_per_lane) *all = tape;
        }
    }
}

void pipeline_kernels(PassCtx *ctx, Program *p, const bool needs[K_KINDS], const VariantOptions *vo,
                      const AdOptions *ad, KernelSet *out) {
    const Fn *primal = variant_standing(p->primal, true), *shown = variant_standing(p->primal, false);
    VariantOptions variant = vo ? *vo : (VariantOptions){0};
    const Fn *pictured = variant.written ? variant_written(ctx, shown) : shown;
    AdOptions wrt = ad ? *ad : (AdOptions){0};
    bool jumps = boundary_moves(ctx, p, wrt.wrt);
    memset(out, 0, sizeof *out);

    Fn *value = variant_value(ctx, shown);
    if (needs[K_VALUE]) out->fn[K_VALUE] = pictured == shown ? value : variant_value(ctx, pictured);
    bool boxes = needs[K_BOUNDS] || needs[K_EDGE] || needs[K_EDGE_BOUNDS] || needs[K_WRITTEN_BOUNDS];
    Fn *chunks = needs[K_PRUNED] || needs[K_PRUNE] || boxes ? variant_chunks(ctx, shown, &out->chunks) : NULL;
    if (chunks && needs[K_PRUNED]) out->fn[K_PRUNED] = variant_value(ctx, chunks);
    if (chunks && needs[K_PRUNE]) out->fn[K_PRUNE] = variant_prune(ctx, chunks);
    if (needs[K_JVP]) out->fn[K_JVP] = ad_jvp(ctx, value, &wrt);
    /* Over pieces the sweep runs each of them again: f, which images do not ask it for, would be a second time. */
    AdOptions of_value = wrt;
    of_value.no_value = ir_has(value->body, OP_told);
    for (int k = 0; k < K_KINDS; k++) {
        if (!needs[k] || (k != K_VJP && k != K_VJP_GUARDED)) continue;
        Fn *swept = ir_clone(value, value->arena, value->name);
        pass_run(ctx, PASS_NEEDS_PRIMAL, swept, PASS_opt_idle);
        out->fn[k] = ad_vjp(ctx, swept, &of_value, &out->tape[k]);
        ad_part_rows(out->fn[k]);
    }
    if (jumps) {
        if (needs[K_REGION]) out->fn[K_REGION] = variant_region(ctx, primal, &variant);
        out->hides = variant_tells_origin(primal, &variant);
        if (needs[K_EVENT]) out->fn[K_EVENT] = variant_event(ctx, primal, &variant);
        if (needs[K_SIDES]) out->fn[K_SIDES] = variant_sides(ctx, primal, &variant);
        site_kernels(ctx, primal, needs, &variant, &wrt, out);
    }
    box_kernels(ctx, variant.image && variant.written ? pictured : primal, chunks, needs, variant.image, out);
    if (needs[K_SIDES] && variant.cells && !out->fn[K_SIDES] && (out->nedges || !needs[K_EDGE]))
        out->fn[K_SIDES] = variant_sides(ctx, primal, &variant);
    for (int k = 0; k < K_KINDS; k++) {
        if (!out->fn[k]) continue;
        /* AD may have been given a Fn that is a kernel of its own too: each is finished once. */
        if (k == K_VALUE) out->fn[k] = ir_clone(out->fn[k], out->fn[k]->arena, kernel_names[k]);
        for (Fn *part = out->fn[k]; part; part = part->next_part) {
            part->name = kernel_names[k];
            pipeline_kernel(ctx, part);
            if (k == K_EVENT && variant_has_windows(primal)) /* the searches behind g, for pairs that have an event */
                pass_run(ctx, PASS_NEEDS_KERNEL, part, PASS_opt_sink);
            if (k != K_VJP || wrt.guarded || !pass_run(ctx, PASS_NEEDS_KERNEL, part, PASS_opt_bare)) continue;
            pass_run(ctx, PASS_NEEDS_KERNEL, part, PASS_opt_dce);
            out->bare = true;
        }
        out->layout[k] = pipeline_layout(out->fn[k]);
    }
}
