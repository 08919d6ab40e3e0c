/* The inside of a program, read once for explain.c. */
#include "bindings/c/derived.h"
#include "cli/explain.h"

#include <math.h>
#include <string.h>

#include "bindings/c/api.h"
#include "compiler/pass/depend.h"
#include "compiler/pass/walk.h"

typedef struct Inside {
    const Cli *c;
    SltProgram *p;
    Arena *arena;
    uint8_t *facts, *alive; /* by site: what it depends on; whether the region kernel sees it */
    uint8_t *reach;         /* by float: some reverse kernel adds to its adjoint */
} Inside;

/* ---- sites */
static const char *site_kind_name(SiteKind k) {
    switch (k) {
    case SITE_COMPARE:
    case SITE_WAVE: return "comparison";
    case SITE_FLOOR: return "floor";
    case SITE_CEIL: return "ceil";
    case SITE_ROUND: return "round";
    case SITE_TRUNC: return "trunc";
    case SITE_FMOD: return "fmod";
    case SITE_SILHOUETTE:
    case SITE_MESH:
    case SITE_MESH_HIT: return "silhouette";
    case SITE_SHADOW:
    case SITE_MESH_SHADOW: return "shadow";
    case SITE_MESH_FACE: return "edge of faces";
    case SITE_MESH_SEAM: return "seam";
    }
    return "?";
}

static void mark_sites(const Block *b, uint8_t *alive) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_site || i->op == OP_siten) alive[i->imm.i] = 1;
        for (uint32_t r = 0; r < i->nregions; r++) mark_sites(i->region[r], alive);
    }
}

static void explain_sites(const Inside *e, Explained *out) {
    const Fn *primal = e->p->prog->primal;
    out->nsites = primal->nsites;
    out->sites = ARENA_ARRAY(e->arena, ExplainedSite, primal->nsites + 1);
    for (uint32_t s = 0; s < primal->nsites; s++) {
        const SiteInfo *i = &primal->sites[s];
        ExplainedSite *site = &out->sites[s];
        *site = (ExplainedSite){.kind = site_kind_name(i->kind),
                                .path = i->path,
                                .text = i->text,
                                .max_events = i->max_events,
                                .skip_loop = i->skip_loop,
                                .is_live = e->alive[s] != 0,
                                .is_static = !(e->facts[s] & DEPENDS_X)};
        if (i->span.file >= 0) site->file = e->p->session->sources[i->span.file].path;
        span_position(e->p->session, i->span, &site->line, &site->column);
    }
}

/* ---- parameters without a gradient */
/* A parameter has a gradient where a reverse kernel adds to its adjoint. That is read off the reverse kernels' IR: in
 * the value kernel the bit tricks of sines and exponentials hide dependences. */
static void add_reach(Inside *e, const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) add_reach(e, i->region[r]);
        if (i->op != OP_adj) continue;
        bool fixed = i->args[0]->op == OP_consti;
        uint32_t base = i->imm.slot.base, count = i->imm.slot.count, at = fixed ? (uint32_t)i->args[0]->imm.i : 0;
        for (uint32_t k = 0; k < count; k++)
            if ((!fixed || k == at) && base + k < e->p->prog->nfloats) e->reach[base + k] = 1;
    }
}

static const char *why_no_gradient(const Inside *e, const Param *q) {
    if (!q->fcount) return "integer or bool";
    if (!q->differentiable) return "marked [NoDiff]";
    bool wanted = false, reaches = false;
    for (uint32_t i = 0; i < q->fcount; i++) {
        wanted |= slt_wrt_mask(e->p)[q->fbase + i] != 0;
        reaches |= e->reach[q->fbase + i] != 0;
    }
    if (!wanted) return "not in --wrt";
    if (!reaches) return "no differentiable path to the output";
    return NULL;
}

/* ---- kernels */
static const char *left_out(const Inside *e, int kind) {
    bool jumps = false;
    for (uint32_t s = 0; s < e->p->prog->primal->nsites; s++) jumps |= e->alive[s] != 0;
    bool boundary = kind == K_REGION || kind == K_EVENT || kind == K_SIDES || kind == K_SITE || kind == K_SITE_GRAD ||
                    kind == K_SITE_JVP || kind == K_SITE_VJP;
    if (boundary && !jumps) return "no discontinuity reaches the output";
    if (boundary && !e->p->fn[K_REGION] && !e->c->job.no_boundary)
        return "no boundary moves with what is differentiated";
    if (kind == K_PRUNE || kind == K_PRUNED) return "no large straight-line program";
    if (kind == K_EDGE || kind == K_EDGE_BOUNDS)
        return e->p->scene.nedges ? "too large to bound its gradient" : "nothing jumps or bends";
    if (kind == K_WRITTEN_BOUNDS) return "only `bound` asks for it";
    if (kind == K_VJP_GUARDED)
        return e->p->scene.kernel[kind] ? "until sums of vjp are not finite" : "vjp has no guards, or keeps them";
    if (kind == K_SITE && e->p->fn[K_SITE_GRAD]) return "served by site_grad: there are many sites";
    if (boundary && e->c->job.no_boundary) return "--interior-only";
    if (!boundary && kind != K_VALUE && e->c->job.no_interior) return "--boundary-only";
    return "not needed";
}

static void explain_kernels(const Inside *e, Explained *out) {
    const SltProgram *p = e->p;
    for (int k = 0; k < K_KINDS; k++) {
        ExplainedKernel *kernel = &out->kernels[k];
        kernel->name = kernel_names[k];
        if (!p->fn[k]) {
            kernel->left_out = left_out(e, k);
            continue;
        }
        kernel->ops = walk_fn_size(p->fn[k]);
        kernel->lanes = p->module_of[k] ? back_width(p->module_of[k], kernel_names[k]) : 1;
        kernel->instructions = p->module_of[k] ? back_instructions(p->module_of[k], kernel_names[k]) : 0;
        kernel->tape_bytes = p->tape[k].bytes_per_lane;
        if (p->tape[k].text && p->tape[k].text[0]) kernel->tape = p->tape[k].text;
    }
}

/* ---- geometries: what is searched, by which kernels, and what for */

static uint32_t geometry_queries(const SltProgram *p, uint32_t f) {
    uint32_t queries = 0;
    for (int k = 0; k < K_KINDS; k++) queries |= api_geometry_queries(p->fn[k], f);
    for (uint32_t c = 0; c < p->prog->ncull; c++) queries |= api_geometry_queries(p->prog->cull_bounds[c], f);
    return queries;
}

static const GeometryInfo *find_geometry(const Program *g, uint32_t param, uint32_t *index) {
    for (uint32_t f = 0; f < g->ngeometries; f++)
        if (g->geometries[f].param == param) return *index = f, &g->geometries[f];
    return NULL;
}

static const char *no_structure(const SltProgram *p, uint32_t param) {
    uint32_t f;
    if (!p->prog->params[param].is_geometry) return NULL;
    if (!find_geometry(p->prog, param, &f)) return "nothing searches it: its numbers are ordinary parameters";
    return geometry_queries(p, f) ? NULL : "no kernel searches it";
}

/* The queries that geometries of this kind answer, as bits. */
static uint32_t answered(SltGeometryKind kind) {
    uint32_t queries = 0;
    for (int q = 0; q < SLT_QUERIES; q++)
        if (query_rows[q].geometries >> kind & 1) queries |= 1u << q;
    return queries;
}

static void explain_geometries(const Inside *e, Explained *out) {
    static const char *const structures[] = {"mipmap", "mipmap", "cone", "naive"};
    const SltProgram *p = e->p;
    const Program *g = p->prog;
    out->ngeometries = g->ngeometries;
    out->geometries = ARENA_ARRAY(e->arena, ExplainedGeometry, g->ngeometries + 1);
    for (uint32_t i = 0; i < g->ngeometries; i++) {
        const GeometryInfo *info = &g->geometries[i];
        ExplainedGeometry *geometry = &out->geometries[i];
        *geometry = (ExplainedGeometry){.name = g->params[info->param].name,
                                        .structure = info->nfaces ? "tree" : structures[p->opt.field],
                                        .vertices = info->nfaces ? info->count / 3 : 0,
                                        .triangles = info->nfaces,
                                        .width = info->size[0],
                                        .height = info->size[1],
                                        .queries = geometry_queries(p, i)};
        geometry->not_asked = answered(info->kind) & ~geometry->queries;
        for (int k = 0; k < K_KINDS; k++) geometry->by_kernel[k] = api_geometry_queries(p->fn[k], i);
        if (!geometry->queries || !p->geometries[i]) continue;
        geometry->description = geometry_describe(p->geometries[i]);
        geometry->bytes = geometry_bytes(p->geometries[i]);
    }
}

static void explain_params(const Inside *e, Explained *out) {
    const Program *g = e->p->prog;
    out->no_gradient = ARENA_ARRAY(e->arena, ExplainedLack, g->nparams + 1);
    out->no_structure = ARENA_ARRAY(e->arena, ExplainedLack, g->nparams + 1);
    for (uint32_t i = 0; i < g->nparams; i++) {
        const char *name = g->params[i].name, *why = why_no_gradient(e, &g->params[i]);
        if (why) out->no_gradient[out->nno_gradient++] = (ExplainedLack){name, why};
        why = no_structure(e->p, i);
        if (why) out->no_structure[out->nno_structure++] = (ExplainedLack){name, why};
        out->has_geometry |= g->params[i].is_geometry;
    }
}

SltStatus explain_program(const Cli *c, SltProgram *p, Explained *out, SltError *err) {
    const Program *g = p->prog;
    Arena *arena = &p->session->session;
    Inside e = {c,
                p,
                arena,
                ARENA_ARRAY(arena, uint8_t, g->primal->nsites + 1),
                ARENA_ARRAY(arena, uint8_t, g->primal->nsites + 1),
                ARENA_ARRAY(arena, uint8_t, g->nfloats + 1)};
    bool needs[K_KINDS] = {[K_VALUE] = true, [K_VJP] = !c->job.no_interior, [K_BOUNDS] = true,
                           [K_EDGE] = true,  [K_EDGE_BOUNDS] = true,        [K_PRUNE] = true,
                           [K_PRUNED] = true};
    if (!c->job.no_boundary)
        needs[K_REGION] = needs[K_EVENT] = needs[K_SIDES] = needs[K_SITE] = needs[K_SITE_GRAD] = needs[K_SITE_VJP] =
            true;
    p->threads = c->job.threads;
    SltStatus status = api_kernels_unrun(p, needs, err);
    if (status != SLT_OK) return status;
    depend_sites(g->primal, NULL, e.facts);
    mark_sites(g->primal->body, e.alive);
    if (p->fn[K_VJP]) add_reach(&e, p->fn[K_VJP]->body);
    for (const Fn *part = p->fn[K_SITE_VJP]; part; part = part->next_part) add_reach(&e, part->body);
    for (uint32_t d = g->nderived; d-- > 0;) {
        const Derived *of = &g->derived[d];
        const Fn *fn = p->derived[d].fn[K_VJP];
        if (fn && memchr(e.reach + of->base, 1, 3 * (size_t)of->n)) add_reach(&e, fn->body);
    }
    *out = (Explained){.entry = g->entry,
                       .dim = g->dim,
                       .channels = g->channels,
                       .display = g->display,
                       .nfloats = program_floats(g),
                       .nints = g->nints - g->ntopology,
                       .width = p->scene.widest,
                       .ncull = g->ncull,
                       .f64 = p->opt.f64,
                       .near_miss = api_near_miss(p),
                       .uses_rand = g->uses_rand,
                       .cached = p->cached,
                       .events_bound = api_event_bound(p),
                       .ms_front = p->ms_front,
                       .ms_passes = p->ms_passes,
                       .ms_llvm = p->ms_llvm};
    explain_sites(&e, out);
    explain_kernels(&e, out);
    explain_geometries(&e, out);
    explain_params(&e, out);
    status = explain_meshes(p, arena, out, err);
    if (status != SLT_OK) return status;
    if (c->cost) {
        out->cost = ARENA_NEW(arena, ExplainedCost);
        status = explain_cost(p, out->cost, err);
        if (status != SLT_OK) return status;
    }
    return explain_bounds(p, &out->bounds, err);
}
