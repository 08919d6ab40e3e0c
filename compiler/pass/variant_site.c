/* site: the boundary function g of one event, as a function of x: (uniform site; k0.., boundary or window; x) -> g. Its
 * gradient in x and its pull-back are made from this function by ad_*.
 *
 * Each site gets the slice of the primal that its g needs. The ifs around it are dropped (g is asked for only where it
 * was executed), and a loop around it that carries nothing into g is replaced by its index, so a disc in a loop of 2000
 * costs one disc. A g that needs carried values or local arrays comes from one shared copy of the whole program that
 * captures g when its event is reached (`capture`); so do slices that would make the kernel grow faster than the
 * program. Slices are leaves of a binary tree over the uniform site number, at most 16 a part, and a part is one Fn:
 * linear in the number of sites, in time and in code, through AD and LLVM as well. */
#include <string.h>

#include "compiler/pass/variant.h"

typedef struct Slicer {
    Fn *fn;             /* new */
    const Fn *from;     /* numbered clone of the primal */
    Inst **map;         /* of the site being sliced: by id in `from` */
    Vec(uint32_t) used; /* ids in map, to clear it */
    Arena *arena;
    const Inst *site;
    uint32_t cost, limit;
    bool failed;
    uint32_t nesting;
} Slicer;

static Inst *slice(Slicer *s, Builder *b, Inst *v);

static Inst *remember(Slicer *s, const Inst *v, Inst *copy) {
    if (!copy) return NULL;
    s->map[v->id] = copy;
    vec_push(s->arena, &s->used, v->id);
    return copy;
}

/* Which enclosing loop of the site (outermost first) is this block the body of? -1: none. */
static int loop_index(const Slicer *s, const Block *body) {
    int index = -1, depth = 0;
    for (const Block *b = s->site->block; b; b = b->owner ? b->owner->block : NULL)
        if (b->owner && b->owner->op == OP_loop) {
            if (b == body) index = depth;
            depth++;
        }
    return index < 0 ? -1 : depth - 1 - index;
}

/* Free values of the regions of i are sliced first, then the whole operation is cloned. */
static void slice_free(Slicer *s, Builder *b, const Inst *root, const Block *body) {
    for (Inst *i = body->first; i && !s->failed; i = i->next) {
        if (i->op == OP_load || i->op == OP_store || i->op == OP_acopy || i->op == OP_alloc) {
            s->failed = true; /* memory: order matters */
            return;
        }
        for (uint32_t a = 0; a < i->nargs; a++) {
            bool inner = false;
            for (uint32_t r = 0; r < root->nregions; r++) inner |= walk_inside(i->args[a]->block, root->region[r]);
            if (!inner) slice(s, b, i->args[a]);
        }
        for (uint32_t r = 0; r < i->nregions; r++) slice_free(s, b, root, i->region[r]);
    }
}

/* What cloning a whole operation has mapped inside it: another site's slice may begin there. */
static void note_inner(Slicer *s, const Block *body) {
    for (uint32_t p = 0; p < body->nparams; p++) vec_push(s->arena, &s->used, body->params[p]->id);
    for (const Inst *i = body->first; i; i = i->next) {
        vec_push(s->arena, &s->used, i->id);
        for (uint32_t r = 0; r < i->nregions; r++) note_inner(s, i->region[r]);
    }
}

static Inst *slice_structured(Slicer *s, Builder *b, Inst *v) {
    Inst *op = v->args[0];
    if (!s->map[op->id]) {
        for (uint32_t a = 0; a < op->nargs; a++) slice(s, b, op->args[a]);
        for (uint32_t r = 0; r < op->nregions; r++) slice_free(s, b, op, op->region[r]);
        if (s->failed) return NULL;
        for (uint32_t r = 0; r < op->nregions; r++) s->cost += walk_size(op->region[r]);
        ir_clone_insts(b, op->block, op, op->next, s->map);
        vec_push(s->arena, &s->used, op->id);
        for (uint32_t r = 0; r < op->nregions; r++) note_inner(s, op->region[r]);
    }
    return remember(s, v, ir_proj(b, s->map[op->id], (uint32_t)v->imm.i));
}

static Inst *slice(Slicer *s, Builder *b, Inst *v) {
    if (s->failed) return NULL;
    if (s->map[v->id]) return s->map[v->id];
    if (s->cost > s->limit || s->nesting > 4000) {
        s->failed = true;
        return NULL;
    }
    if (v->op == OP_arg) {
        const Block *body = v->block;
        if (body->owner && body->owner->op == OP_loop && v->imm.i == 0) {
            int k = loop_index(s, body);
            if (k >= 0 && k < SLT_MAX_K) return remember(s, v, ir_input(b, (InputSlot)(IN_K0 + k)));
        }
        if (body->owner && body->owner->op == OP_custom && (uint32_t)v->imm.i < body->owner->nargs)
            return remember(s, v, slice(s, b, body->owner->args[v->imm.i]));
        s->failed = true; /* a carried value: the loop must run */
        return NULL;
    }
    if (v->op == OP_load || v->op == OP_alloc) {
        s->failed = true;
        return NULL;
    }
    if (v->op == OP_window) return remember(s, v, ir_input(b, v->imm.i & 1 ? IN_WINDOW1 : IN_WINDOW0));
    if (variant_asks_line(v)) return remember(s, v, variant_mesh_input(b, v));
    s->nesting++;
    Inst *copy = NULL;
    if (v->op == OP_proj) {
        copy = slice_structured(s, b, v);
    } else {
        for (uint32_t a = 0; a < v->nargs && !s->failed; a++) slice(s, b, v->args[a]);
        if (!s->failed) {
            if (!ir_is_const(v)) s->cost++;
            ir_clone_insts(b, v->block, v, v->next, s->map);
            vec_push(s->arena, &s->used, v->id);
            copy = s->map[v->id];
        }
    }
    s->nesting--;
    return copy;
}

/* Not of a seam around a minimum or its kin. */
static bool has_boundary(const Fn *fn, const Inst *site) {
    return site->op == OP_siten && variant_site_info(fn, site)->kind != SITE_COMPARE;
}

/* g = a - b of a comparison, v - boundary of an integer-valued site. */
static Inst *slice_g(Slicer *s, Builder *b, const Inst *site) {
    Inst *g = slice(s, b, site->args[1]);
    if (g && has_boundary(s->from, site)) g = ir_emit2(b, OP_fsub, g, ir_input(b, IN_BOUNDARY));
    return g;
}

static void forget(Slicer *s) {
    for (uint32_t u = 0; u < s->used.len; u++) s->map[s->used.data[u]] = NULL;
    s->used.len = 0;
}

typedef Vec(Inst *) Sites;
static void find_sites(Arena *a, Block *b, Sites *out) {
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) find_sites(a, i->region[r], out);
        if (variant_is_site(i)) vec_push(a, out, i);
    }
}

/* ---- capture: one pass over the program that keeps g of the event asked for; values: g, captured */
static bool touches_capture(Thread *t, const Inst *i) {
    const uint8_t *wanted = t->user;
    return variant_is_site(i) && wanted[i->imm.i];
}

static bool capture_at(Thread *t, Inst *i) {
    Builder b = ir_after(t->fn, i);
    b.fold = true;
    Inst *match = ir_emit2(&b, OP_ieq, ir_input(&b, IN_SITE), ir_consti(&b, (int32_t)i->imm.i));
    for (uint32_t a = 2; a < i->nargs; a++)
        match =
            ir_emit2(&b, OP_band, match, ir_emit2(&b, OP_ieq, ir_input(&b, (InputSlot)(IN_K0 + a - 2)), i->args[a]));
    Inst *g = i->args[1];
    if (has_boundary(t->fn, i)) g = ir_emit2(&b, OP_fsub, g, ir_input(&b, IN_BOUNDARY));
    t->value[0] = ir_select(&b, match, g, t->value[0]);
    t->value[1] = ir_emit2(&b, OP_bor, t->value[1], match);
    return true;
}

static Inst *stop_when_captured(Thread *t, Builder *b, Inst *flag) {
    return ir_emit2(b, OP_band, flag, ir_emit1(b, OP_bnot, t->value[1]));
}

bool variant_is_uncaptured(const Inst *i) {
    uint64_t bits;
    memcpy(&bits, &i->imm.f, sizeof bits);
    return i->op == OP_constf && bits == VARIANT_UNCAPTURED;
}

/* No number, and of the edge kernels the gradient is none either. */
static Inst *uncaptured(Builder *b, bool edges) {
    if (!edges) return ir_constf(b, __builtin_nan(""));
    uint64_t bits = VARIANT_UNCAPTURED;
    double nan;
    memcpy(&nan, &bits, sizeof nan);
    Inst *sum = NULL;
    for (uint32_t d = 0; d < b->fn->dim; d++) {
        Inst *term = ir_emit2(b, OP_fmul, ir_input(b, (InputSlot)(IN_X0 + d)), ir_constf(b, nan));
        sum = sum ? ir_emit2(b, OP_fadd, sum, term) : term;
    }
    return sum;
}

/* The captured g, emitted at the end of `into`. */
static Inst *emit_capture(PassCtx *ctx, Builder *into, const Fn *primal, const uint8_t *wanted, bool edges) {
    Fn *copy = ir_clone(primal, primal->arena, "capture");
    if (edges) variant_lead_to_events(copy, wanted);
    Builder b = copy->body->first ? ir_before(copy, copy->body->first) : ir_at_end(copy, copy->body);
    Thread t = {.fn = copy,
                .n = 2,
                .at = capture_at,
                .touches = touches_capture,
                .cont = stop_when_captured,
                .user = (void *)wanted};
    t.value[0] = uncaptured(&b, edges);
    t.value[1] = ir_constb(&b, false);
    thread_block(&t, copy->body);
    Outputs g = {0};
    variant_output(&g, SLT_OUT_G, 0, t.value[0]);
    variant_set_outputs(copy, &g);
    variant_windows_of_inputs(copy);
    variant_mesh_inputs(copy);
    variant_drop_sites(copy);
    opt_dce(ctx, copy);
    uint32_t n = ir_number(copy);
    Inst **map = ARENA_ARRAY(&ctx->session->scratch, Inst *, n + 1);
    ir_clone_insts(into, copy->body, copy->body->first, copy->body->last, map);
    Inst *out = copy->body->last->args[0];
    return map[out->id] ? map[out->id] : out;
}

typedef struct Leaf {
    uint32_t site;
    const Inst *inst;
} Leaf;

/* A binary tree of ifs on the uniform site number; yields g. */
static Inst *tree(Slicer *s, Builder *b, const Leaf *leaves, uint32_t n) {
    if (n == 1) {
        s->site = leaves[0].inst;
        s->cost = 0, s->failed = false;
        Inst *g = slice_g(s, b, leaves[0].inst);
        forget(s);
        return g ? g : ir_constf(b, __builtin_nan(""));
    }
    uint32_t half = n / 2;
    Inst *low = ir_emit2(b, OP_ilt, ir_input(b, IN_SITE), ir_consti(b, (int32_t)leaves[half].site));
    Inst *br = ir_if(b, low);
    Builder x = ir_at_end(s->fn, br->region[0]), y = ir_at_end(s->fn, br->region[1]);
    x.fold = y.fold = b->fold;
    Inst *gx = tree(s, &x, leaves, half);
    ir_yield(&x, 1, &gx);
    Inst *gy = tree(s, &y, leaves + half, n - half);
    ir_yield(&y, 1, &gy);
    return ir_proj(b, br, 0);
}

enum { PART = 16 };

static Fn *new_part(PassCtx *ctx, const Fn *primal) {
    Fn *fn = ir_fn(ctx->session, primal->arena, "site", primal->precision);
    fn->dim = primal->dim, fn->channels = primal->channels;
    fn->nfloats = primal->nfloats, fn->nints = primal->nints;
    fn->sites = primal->sites, fn->nsites = primal->nsites;
    return fn;
}

static void finish_part(Fn *fn, Builder *b, Inst *g, const uint8_t *serves) {
    ir_yield(b, 1, &g);
    ir_name_outputs(fn, SLT_OUT_G);
    fn->serves = serves;
    variant_drop_sites(fn);
}

static Fn *cut(PassCtx *ctx, const Fn *primal, bool edges) {
    Arena *scratch = &ctx->session->scratch;
    ArenaMark mark = arena_mark(scratch);
    Fn *from = ir_clone(primal, primal->arena, "site.from");
    /* Prints and counters are not evaluated again at crossings; [Tangent] regions stay for the derivative of g unless a
     * site lies inside one. */
    opt_dce(ctx, from);
    uint32_t n = ir_number(from);
    Sites sites = {0};
    find_sites(scratch, from->body, &sites);
    if (!sites.len) {
        arena_reset(scratch, mark);
        return NULL;
    }
    Slicer s = {.from = from, .arena = scratch};
    s.map = ARENA_ARRAY(scratch, Inst *, n + 1);
    uint8_t *captured = ARENA_ARRAY(scratch, uint8_t, primal->nsites + 1);
    Leaf *leaves = ARENA_ARRAY(scratch, Leaf, sites.len);
    uint32_t nleaves = 0, ncaptured = 0, total = 0, budget = 4 * n + 4096;

    /* Dry run: which slices are independent, and do they stay linear in the program? */
    Fn *trial = ir_fn(ctx->session, scratch, "trial", primal->precision);
    for (uint32_t i = 0; i < sites.len; i++) {
        bool again = captured[sites.data[i]->imm.i]; /* seams may share a number, and with it g */
        for (uint32_t k = 0; k < nleaves && !again; k++) again = leaves[k].site == sites.data[i]->imm.i;
        if (again) continue;
        s.fn = trial, s.site = sites.data[i], s.cost = 0, s.failed = false;
        s.limit = total < budget ? budget - total : 0;
        Builder b = ir_at_end(trial, trial->body);
        slice_g(&s, &b, sites.data[i]);
        forget(&s);
        if (s.failed) {
            captured[sites.data[i]->imm.i] = 1, ncaptured++;
        } else {
            total += s.cost;
            leaves[nleaves++] = (Leaf){(uint32_t)sites.data[i]->imm.i, sites.data[i]};
        }
    }
    for (uint32_t i = 1; i < nleaves; i++) /* nearly sorted: sites are numbered in program order */
        for (uint32_t j = i; j > 0 && leaves[j].site < leaves[j - 1].site; j--) {
            Leaf l = leaves[j];
            leaves[j] = leaves[j - 1], leaves[j - 1] = l;
        }
    s.limit = UINT32_MAX;
    /* Parts of at most PART slices; the captured sites share one more. */
    Fn *first = NULL, **end = &first;
    for (uint32_t from = 0; from < nleaves; from += PART) {
        uint32_t count = nleaves - from < PART ? nleaves - from : PART;
        Fn *fn = new_part(ctx, primal);
        s.fn = fn;
        Builder b = ir_at_end(fn, fn->body);
        b.fold = true;
        Inst *g = tree(&s, &b, leaves + from, count);
        uint8_t *serves = ARENA_ARRAY(fn->arena, uint8_t, primal->nsites + 1);
        for (uint32_t i = 0; i < count; i++) serves[leaves[from + i].site] = 1;
        finish_part(fn, &b, g, serves);
        *end = fn, end = &fn->next_part;
    }
    if (ncaptured) {
        Fn *fn = new_part(ctx, primal);
        Builder b = ir_at_end(fn, fn->body);
        b.fold = true;
        Inst *g = emit_capture(ctx, &b, variant_differentiable_clone(ctx, primal, "capture"), captured, edges);
        finish_part(fn, &b, g, arena_copy(fn->arena, captured, primal->nsites + 1));
        *end = fn;
    }
    arena_reset(scratch, mark);
    for (Fn *fn = first; fn; fn = fn->next_part) opt_dce(ctx, fn);
    return first;
}

Fn *variant_site(PassCtx *ctx, const Fn *primal) { return cut(ctx, primal, false); }

/* One part that serves all sites and choices. */
Fn *variant_chunk_edges(PassCtx *ctx, const Fn *chunks, const SltChunks *table) {
    Fn *from = ir_clone(chunks, chunks->arena, "edge.from"), *fn = new_part(ctx, chunks);
    variant_take_given(from);
    variant_give_differences(from, table);
    uint8_t *all = ARENA_ARRAY(fn->arena, uint8_t, chunks->nsites + 1);
    memset(all, 1, chunks->nsites);
    Builder b = ir_at_end(fn, fn->body);
    b.fold = true;
    Inst *g = emit_capture(ctx, &b, from, all, true);
    finish_part(fn, &b, variant_take_difference(&b, table, g), all);
    opt_dce(ctx, fn);
    return fn;
}

Fn *variant_edge(PassCtx *ctx, const Fn *seamed, bool squares) {
    Fn *taking = ir_clone(seamed, seamed->arena, "edge.from");
    variant_take_given(taking);
    if (squares) variant_squares(ctx, taking);
    return cut(ctx, taking, true);
}
