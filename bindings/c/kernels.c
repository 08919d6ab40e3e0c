/* Kernels on demand: those that a call needs and that are not there yet go through passes and back end as one module.
 */
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "bindings/c/api.h"
#include "compiler/pass/depend.h"

/* Up to so many events a sample the near-miss probe is on by default, and regions are told apart by path: then a band
 * between two comparisons that is thinner than the spacing shows in the hash, though f is the same on both sides of it.
 * Above, speed wins; docs/estimators.md has the measurement. */
enum { NEAR_MISS_EVENTS = 64 };
/* Above this many sites `site`, the kernel of g alone, is left out: `site_grad` gives g as well, a little slower, and
 * compiling dominates. */
enum { LONE_SITE_KERNEL = 128 };
/* Each site that is written out makes blocks of its own in several kernels, and what LLVM does with them grows with
 * the square: 1000 discs took 27 s of processor time, 7 s without optimisation. */
enum { MANY_SITES = 512, MOST_SITES = 2048 };
/* Above this many bytes of adjoints with a sum a lane, kernels add the lanes up themselves (ADJ_FLAT). */
enum { LANE_ADJOINT_BYTES = 1 << 17 };

static double now_ms(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e3 * (double)t.tv_sec + 1e-6 * (double)t.tv_nsec;
}

uint64_t api_event_bound(const SltProgram *p) {
    uint64_t n = 0;
    const Fn *primal = p->prog->primal;
    for (uint32_t s = 0; s < primal->nsites; s++) n += primal->sites[s].still ? 0 : primal->sites[s].max_events;
    return n;
}

uint32_t api_adjoint_lanes(const SltProgram *p) {
    if (p->opt.interpret) return 1;
    BackOptions o = {.target = p->target, .width = p->opt.width, .adj = ADJ_LANES};
    uint32_t lanes = back_adjoint_lanes(&o, p->opt.f64 ? PREC_F64 : PREC_F32);
    return (size_t)p->prog->nfloats * lanes * (p->opt.f64 ? 8 : 4) > LANE_ADJOINT_BYTES ? 1 : lanes;
}

BackPixels api_pixels(const SltProgram *p) {
    if (!p->opt.rgba8) return BACK_FLOATS;
    return slt_is_display(p) ? BACK_PIXELS_RAW : BACK_PIXELS_SRGB;
}

bool api_near_miss(const SltProgram *p) {
    const Fn *primal = p->prog->primal;
    bool any = false; /* a site that is not a ray's: g of a ray needs two points, so at one it cannot be near 0 */
    for (uint32_t s = 0; s < primal->nsites; s++) any |= !ir_site_of_ray(primal->sites[s].kind);
    if (!any) return false;
    return p->opt.near_miss < 0 ? api_event_bound(p) <= NEAR_MISS_EVENTS : p->opt.near_miss > 0;
}

static void interpret(void *user, int kind, SltKernelArgs *args, uint32_t n) {
    SltProgram *p = user;
    const Fn *fn = kind == K_SITE && !p->fn[K_SITE] ? p->fn[K_SITE_GRAD] : p->fn[kind];
    int status = ir_interpret(fn, args, n, 16);
    const SltLayout *l = &p->scene.layout[kind];
    /* Whoever asked goes on until the tile ends: with numbers, not with what memory held. */
    for (uint32_t r = 0; r < SLT_ROLES && status != SLT_OK; r++)
        for (uint32_t k = 0; k < l->out[r].count; k++)
            memset(args->out[l->out[r].first + k], 0, n * (p->opt.f64 ? sizeof(double) : sizeof(float)));
    if (status != SLT_OK && p->error.status == SLT_OK)
        status_fail(&p->error, (SltStatus)status, "%sthe interpreter stopped in kernel %s",
                    status == SLT_LIMIT ? "out of memory: " : "", kernel_names[kind]);
}

static void interpreted(SltKernelArgs *args, uint32_t n) { (void)args, (void)n; }

typedef struct Request {
    SltProgram *p;
    bool needs[K_KINDS], late[K_KINDS], soon[K_KINDS], cull, cells;
    SltStatus status;
    SltError *err;
} Request;

static void fill_scene(SltProgram *p) {
    SltScene *s = &p->scene;
    Program *g = p->prog;
    s->f64 = g->primal->precision == PREC_F64;
    if (!s->kernel[K_SITE]) s->kernel[K_SITE] = s->kernel[K_SITE_GRAD], s->layout[K_SITE] = s->layout[K_SITE_GRAD];
    s->dim = g->dim, s->channels = g->channels;
    for (int d = 0; d < 3; d++) s->lo[d] = g->lo[d], s->hi[d] = g->hi[d];
    s->nfloats = g->nfloats, s->nints = g->nints, s->nplaced = g->nplaced;
    s->derived = p->derived_scene, s->nderived = g->nderived;
    s->params = p->flt, s->iparams = p->lent_ints ? p->lent_ints : p->ints, s->active = p->wrt;
    s->dense = p->opt.interpret ? NULL : p->dense;
    s->nsites = g->primal->nsites;
    s->site_kind = p->site_kind, s->site_static = p->site_static, s->site_skips = p->site_skips,
    s->site_ties = p->site_ties, s->twins = p->twins, s->ntwins = p->ntwins;
    s->nedges = p->nedges, s->edge_kind = p->edge_kind, s->flat = p->flat, s->told = p->told, s->chunked = p->chunked;
    s->edge_upsets = p->edge_upsets, s->edge_bends = p->edge_bends, s->edge_line = p->edge_line;
    s->edge_argmin = p->edge_argmin;
    s->still = !p->passes.untracked;
    s->follow = p->opt.near_miss < 0 ? 1 : p->opt.near_miss > 0 ? 2 : 0;
    s->uses_rand = g->uses_rand, s->detached = g->uses_rand && ir_has(g->primal->body, OP_detach);
    s->geometries = p->geometries, s->ngeometries = g->ngeometries, s->geometry_base = p->geometry_base;
    s->print = ir_has(g->primal->body, OP_print) ? p->print : NULL, s->print_user = p->print_user;
    s->ncull = g->ncull;
    s->cull_bounds = p->cull_kernels, s->cull_count = p->list_counts;
    s->nlists = p->nlists, s->list_count = p->list_counts, s->list_noted = p->list_noted;
    s->adj_lanes = api_adjoint_lanes(p);
    s->make = api_late_make, s->make_user = p;
    if (p->opt.interpret) s->call = interpret, s->call_user = p;
}

/* Iterations of the loops with lists; *n becomes how many lists there are. */
static void find_list_counts(const Block *b, uint32_t counts[SLT_MAX_CULL], uint32_t *n) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_loop && i->imm.loop.cull) {
            counts[i->imm.loop.cull_id] = i->imm.loop.max_iters;
            if (i->imm.loop.cull_id >= *n) *n = i->imm.loop.cull_id + 1;
        }
        for (uint32_t r = 0; r < i->nregions; r++) find_list_counts(i->region[r], counts, n);
    }
}

static void find_noted(const Block *b, uint8_t *noted) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_note) noted[i->imm.i] = 1;
        for (uint32_t r = 0; r < i->nregions; r++) find_noted(i->region[r], noted);
    }
}

static void twin_table(SltProgram *p) {
    Twins *twins;
    p->ntwins = depend_twins(p->prog->primal, &p->session->module, &twins);
    p->twins = ARENA_ARRAY(&p->session->module, SltTwins, p->ntwins + 1);
    for (uint32_t t = 0; t < p->ntwins; t++)
        p->twins[t] = (SltTwins){{twins[t].site[0], twins[t].site[1]}, twins[t].times, twins[t].indexed};
}

static void site_tables(SltProgram *p) {
    const Fn *primal = p->prog->primal;
    Arena *a = &p->session->module;
    p->site_kind = ARENA_ARRAY(a, uint8_t, primal->nsites + 1);
    p->site_skips = ARENA_ARRAY(a, uint8_t, primal->nsites + 1);
    p->site_static = ARENA_ARRAY(a, uint8_t, primal->nsites + 1);
    p->site_ties = ARENA_ARRAY(a, uint8_t, primal->nsites + 1);
    uint8_t *facts = ARENA_ARRAY(a, uint8_t, primal->nsites + 1);
    depend_sites(p->prog->primal, NULL, facts);
    for (uint32_t s = 0; s < primal->nsites; s++) {
        p->site_kind[s] = (uint8_t)primal->sites[s].kind;
        p->site_skips[s] = primal->sites[s].skip_loop;
        p->site_static[s] = !(facts[s] & DEPENDS_X);
        p->site_ties[s] = (facts[s] & DEPENDS_TIES) != 0;
    }
    twin_table(p);
    p->list_counts = ARENA_ARRAY(a, uint32_t, SLT_MAX_CULL);
    p->list_noted = ARENA_ARRAY(a, uint8_t, SLT_MAX_CULL);
    p->cull_kernels = ARENA_ARRAY(a, SltKernel *, p->prog->ncull + 1);
    p->nlists = p->prog->ncull;
    find_list_counts(primal->body, p->list_counts, &p->nlists);
}

static void edge_table(SltProgram *p, const KernelSet *set) {
    if (!set->edges || p->edge_kind) return; /* the same ones each time */
    p->edge_kind = ARENA_ARRAY(&p->session->module, uint8_t, set->nedges + 1);
    p->edge_bends = ARENA_ARRAY(&p->session->module, uint8_t, set->nedges + 1);
    p->nedges = set->nedges, p->flat = set->flat, p->told = set->told, p->chunked = set->chunked;
    for (uint32_t e = 0; e < set->nedges; e++) {
        p->edge_kind[e] = (uint8_t)set->edges[e].kind;
        p->edge_bends[e] = e >= p->prog->primal->nsites && !set->edges[e].jumps;
        if (set->edges[e].argmin && set->edges[e].kind == SITE_COMPARE) {
            if (!p->edge_argmin) p->edge_argmin = ARENA_ARRAY(&p->session->module, int8_t, set->nedges + 1);
            p->edge_argmin[e] = set->edges[e].argmin;
        }
        if (!set->edges[e].upsets) continue;
        if (!p->edge_upsets) {
            p->edge_upsets = ARENA_ARRAY(&p->session->module, uint8_t, set->nedges + 1);
            p->edge_line = ARENA_ARRAY(&p->session->module, uint32_t, set->nedges + 1);
        }
        uint32_t column;
        span_position(p->session, set->edges[e].span, &p->edge_line[e], &column);
        p->edge_upsets[e] = (uint8_t)set->edges[e].upsets;
    }
}

/* The bounds of a [Cull] loop, which have no variants. */
static void finish_bounds(SltProgram *p, Fn *bounds) {
    SltLayout *layout = &p->scene.layout[SLT_K_CULL];
    uint64_t reads = layout->reads;
    pipeline_kernel(&p->passes, bounds);
    *layout = pipeline_layout(bounds);
    layout->reads |= reads; /* what any of them reads */
    api_geometries_want(p, bounds);
}

static BackOptions back_options(const SltProgram *p, uint64_t few, uint64_t plain, unsigned opt_level) {
    return (BackOptions){.target = p->target,
                         .width = p->opt.width,
                         .few = few,
                         .plain = plain,
                         .adj = api_adjoint_lanes(p) == 1 ? ADJ_FLAT : ADJ_LANES,
                         .no_cache = p->opt.no_cache,
                         .opt_level = opt_level,
                         .pixels = api_pixels(p),
                         .threads = p->threads};
}

BackOptions api_compiled_with(const SltProgram *p, int kind) {
    return back_options(p, p->compiled_few[kind], 0, p->compiled_level[kind]);
}

static SltStatus compile_modules(SltProgram *p, Session *s, BackJob *jobs, uint32_t n, SltError *err) {
    const char *why = NULL;
    double start = now_ms(), emit, llvm;
    int status = back_compile_all(s, jobs, n, &why);
    p->ms_llvm += now_ms() - start;
    if (status != SLT_OK) return status_fail(err, (SltStatus)status, "%s", why ? why : "the back end failed");
    for (uint32_t i = 0; i < n; i++) {
        bool cached;
        p->modules[p->nmodules++] = jobs[i].out;
        back_times(jobs[i].out, &emit, &llvm, &cached);
        p->cached &= cached;
    }
    return SLT_OK;
}

CompiledModule *api_compile_module(SltProgram *p, Session *s, const KernelRequest *req, uint32_t n, uint64_t few,
                                   uint64_t plain, unsigned level, SltError *err) {
    BackJob job = {.k = req, .n = n, .o = back_options(p, few, plain, level)};
    return compile_modules(p, s, &job, 1, err) == SLT_OK ? job.out : NULL;
}

/* Cells are asked about a few at a time (of a tree over lists, seven): one vector a value is enough. Those of a
 * straight-line program are as long as it is and thirty times over, but run a few chunks of that at once: it is
 * compiling them that takes time. */
static bool is_of_boxes(int kind) {
    return kind == K_BOUNDS || kind == K_EDGE || kind == K_EDGE_BOUNDS || kind == K_WRITTEN_BOUNDS;
}

static bool is_long(const KernelSet *set, int kind) { return kind == K_PRUNE || (set->chunked && is_of_boxes(kind)); }

static void put_off(SltProgram *p, int kind, const KernelRequest *req, bool few, bool plain, unsigned level) {
    LateKernels *l = &p->late;
    l->few |= (uint64_t)few << l->n, l->plain |= (uint64_t)plain << l->n, l->level = level;
    l->kind[l->n] = (SltKernelKind)kind, l->request[l->n++] = *req;
    p->scene.kernel[kind] = slt_kernel_late;
    BackOptions o = back_options(p, few, plain, level);
    uint32_t width = back_width_choice(req, 0, &o).lanes;
    if (width > p->scene.widest) p->scene.widest = width;
}

/* Kernels of a module, in the order of their kinds. */
typedef struct Group {
    KernelRequest req[K_KINDS + SLT_MAX_CULL];
    uint32_t n;
    uint64_t few, plain;
    CompiledModule *made;
} Group;

static void add_kernel(Group *m, KernelRequest k, bool few, bool plain) {
    m->few |= (uint64_t)few << m->n, m->plain |= (uint64_t)plain << m->n;
    m->req[m->n++] = k;
}

/* Compiles those of the two that have kernels. */
static SltStatus make_modules(SltProgram *p, Session *s, Group group[2], unsigned level, SltError *err) {
    BackJob jobs[2];
    Group *of[2];
    uint32_t n = 0;
    for (uint32_t i = 0; i < 2; i++) {
        const Group *m = &group[i];
        if (!m->n) continue;
        of[n] = &group[i];
        jobs[n++] = (BackJob){.k = m->req, .n = m->n, .o = back_options(p, m->few, m->plain, level)};
    }
    SltStatus status = n ? compile_modules(p, s, jobs, n, err) : SLT_OK;
    for (uint32_t i = 0; i < n && status == SLT_OK; i++) of[i]->made = jobs[i].out;
    return status;
}

static void build_body(Session *s, void *arg) {
    Request *q = arg;
    SltProgram *p = q->p;
    const unsigned level = p->prog->primal->nsites > MANY_SITES ? 0 : 2;
    if (!p->site_kind) site_tables(p);
    VariantOptions vo = {.near_miss = api_near_miss(p),
                         .paper_argmin = p->opt.paper_argmin,
                         .paper_forced = p->opt.paper_forced,
                         .path_hash = p->opt.path_hash || api_near_miss(p),
                         .cells = q->cells,
                         .most_site_size = p->most_site_size};
    AdOptions ad = {.wrt = p->wrt};
    KernelSet set;
    double start = now_ms();
    pipeline_kernels(&p->passes, p->prog, q->needs, &vo, &ad, &set);
    edge_table(p, &set);
    if (q->cull)
        for (uint32_t c = 0; c < p->prog->ncull; c++) finish_bounds(p, p->prog->cull_bounds[c]);
    if (q->cull && p->opt.verify) api_check_cull(p);
    p->ms_passes += now_ms() - start;

    if (set.chunks) p->scene.chunks = set.chunks;
    if (set.fn[K_REGION]) p->scene.hides = set.hides;
    for (int k = 0; k < K_KINDS; k++) p->tried[k] |= q->needs[k];
    Group group[2] = {0}; /* what is needed now, and soon */
    for (int k = 0; k < K_KINDS; k++) {
        if (!set.fn[k]) continue;
        p->fn[k] = set.fn[k];
        p->tape[k] = set.tape[k];
        p->scene.layout[k] = set.layout[k];
        api_geometries_want(p, set.fn[k]);
        if (k == K_BOUNDS) find_noted(set.fn[k]->body, p->list_noted);
        if (k == K_VJP || k == K_SITE_VJP) {
            if (!p->dense) p->dense = ARENA_ARRAY(&s->module, uint8_t, p->prog->nfloats + 1);
            bool adds = back_dense_adjoints(set.fn[k], p->dense);
            if (k == K_SITE_VJP) p->scene.site_logs = !adds && !p->opt.interpret;
        }
        if (k == K_VJP) p->scene.rigid = !ir_has(set.fn[k]->body, OP_adj);
        if (set.tape[k].bytes_per_lane > p->scene.tape_bytes) p->scene.tape_bytes = set.tape[k].bytes_per_lane;
        p->scene.tape_grows |= set.tape[k].grows;
        p->compiled_few[k] = is_of_boxes(k) && !is_long(&set, k);
        p->compiled_level[k] = is_long(&set, k) ? 0 : (uint8_t)level;
        const KernelRequest this = {kernel_names[k], set.fn[k]};
        if (k == K_VALUE && p->opt.rgba8) {
            const BackOptions o = back_options(p, 0, 0, level);
            back_share_row(set.fn[k], &p->target, back_width_choice(&this, 0, &o).lanes);
        }
        if (p->opt.interpret) p->scene.kernel[k] = interpreted;
        else if (q->late[k]) put_off(p, k, &this, p->compiled_few[k], is_long(&set, k), level);
        else add_kernel(&group[q->soon[k]], this, p->compiled_few[k], is_long(&set, k));
    }
    if (q->cull)
        for (uint32_t c = 0; c < p->prog->ncull; c++)
            add_kernel(&group[0], (KernelRequest){arena_printf(&s->module, "cull%u", c), p->prog->cull_bounds[c]},
                       false, false);
    q->status = make_modules(p, s, group, level, q->err);
    if (q->status != SLT_OK) return;
    for (int k = 0; k < K_KINDS; k++) {
        const CompiledModule *m = group[q->soon[k]].made;
        if (!set.fn[k] || q->late[k] || !m) continue;
        p->scene.kernel[k] = back_kernel(m, kernel_names[k]);
        p->module_of[k] = group[q->soon[k]].made;
        uint32_t width = back_width(m, kernel_names[k]);
        if (width > p->scene.widest) p->scene.widest = width;
    }
    if (q->cull && group[0].made)
        for (uint32_t c = 0; c < p->prog->ncull; c++)
            p->cull_kernels[c] = back_kernel(group[0].made, arena_printf(&s->module, "cull%u", c));
}

static void site_tables_body(Session *s, void *program) {
    SltProgram *p = program;
    (void)s;
    if (!p->site_kind) site_tables(p);
}

SltStatus api_site_facts(SltProgram *p, SltError *err) {
    if (!p->prog) return status_fail(err, SLT_USAGE, "the program did not compile");
    int unwound = session_protect(p->session, site_tables_body, p);
    if (unwound) return status_fail(err, (SltStatus)unwound, "%s", p->session->unwind_text);
    fill_scene(p);
    return SLT_OK;
}

bool api_too_many_sites(const SltProgram *p) { return !p->opt.interpret && p->prog->primal->nsites > MOST_SITES; }

/* Where boundaries are looked for; images, and f's own derivative, take any number of sites. */
static SltStatus refuse_many_sites(const SltProgram *p, const bool needs[K_KINDS], SltError *err) {
    if (!api_too_many_sites(p) || !(needs[K_REGION] || needs[K_BOUNDS])) return SLT_OK;
    return status_fail(err, SLT_LIMIT,
                       "%u decisions under [Disc] are written out one by one, and boundaries are looked for between at "
                       "most %d: put them into a loop over an array of what differs",
                       p->prog->primal->nsites, (int)MOST_SITES);
}

static bool runs_here(const SltProgram *p) {
    Target here;
    target_named(&here, "native");
    return p->opt.interpret || target_runs(&p->target, &here);
}

/* late, soon: of those; NULL: none. */
static SltStatus make_kernels(SltProgram *p, const bool needs[K_KINDS], const bool *late, const bool *soon,
                              SltError *err) {
    SltError own;
    if (!err) err = &own;
    if (!p->prog) return status_fail(err, SLT_USAGE, "the program did not compile");
    SltStatus refused = refuse_many_sites(p, needs, err);
    if (refused != SLT_OK) return refused;
    Request q = {.p = p, .err = err};
    bool any = false;
    q.cells = needs[K_EDGE] && !(p->tried[K_EDGE] && !p->nedges); /* without an edge no cell has two sides */
    for (int k = 0; k < K_KINDS; k++) {
        q.needs[k] = needs[k] && (!p->tried[k] || (k == K_SIDES && q.cells && !p->fn[k]));
        if (k == K_SITE && p->prog->primal->nsites > LONE_SITE_KERNEL) q.needs[k] = false;
        q.late[k] = q.needs[k] && late && late[k];
        any |= q.needs[k];
    }
    /* The two adjoint kernels share a layout: they are compiled together. */
    if (q.needs[K_VJP] != q.needs[K_SITE_VJP] && needs[K_VJP] && needs[K_SITE_VJP])
        q.needs[K_VJP] = q.needs[K_SITE_VJP] = true;
    if (any && p->nmodules + 4 >= sizeof p->modules / sizeof *p->modules)
        api_free_kernels(p), memcpy(q.needs, needs, sizeof q.needs);
    for (int k = 0; k < K_KINDS; k++) q.soon[k] = soon && soon[k];
    if (any) {
        q.cull = p->prog->ncull > 0 && (!p->cull_kernels || !p->cull_kernels[0]) && !p->opt.interpret;
        int unwound = session_protect(p->session, build_body, &q);
        if (unwound) return status_fail(err, (SltStatus)unwound, "%s", p->session->unwind_text);
        if (q.status != SLT_OK) return q.status;
    }
    SltStatus status = api_late_compile(p, needs, late, err);
    if (status != SLT_OK) return status;
    fill_scene(p);
    status = api_derived_kernels(p, needs, err);
    if (status == SLT_OK && runs_here(p)) status = api_derived_follow(p, p->scene.iparams, err);
    if (status == SLT_OK) status = api_geometries(p, err);
    if (status != SLT_OK) return status;
    return SLT_OK;
}

SltStatus api_kernels_unrun(SltProgram *p, const bool needs[K_KINDS], SltError *err) {
    return make_kernels(p, needs, NULL, NULL, err);
}

static SltStatus make_to_run(SltProgram *p, const bool needs[K_KINDS], const bool *late, const bool *soon,
                             SltError *err) {
    if (!runs_here(p)) {
        Target here;
        target_named(&here, "native");
        return status_fail(err, SLT_USAGE, "kernels for the target `%s` do not run on this processor (%s): use native",
                           p->opt.target, here.cpu);
    }
    return make_kernels(p, needs, late, soon, err);
}

SltStatus api_kernels_late(SltProgram *p, const bool needs[K_KINDS], const bool *late, SltError *err) {
    return make_to_run(p, needs, late, NULL, err);
}

SltStatus api_kernels_beside(SltProgram *p, const bool needs[K_KINDS], const bool soon[K_KINDS], SltError *err) {
    bool both[K_KINDS], apart[K_KINDS];
    for (int k = 0; k < K_KINDS; k++) both[k] = needs[k] || soon[k], apart[k] = !needs[k] && soon[k];
    return make_to_run(p, both, NULL, apart, err);
}

SltStatus api_kernels(SltProgram *p, const bool needs[K_KINDS], SltError *err) {
    return api_kernels_late(p, needs, NULL, err);
}

void api_forget_gradients(SltProgram *p) {
    static const int kinds[] = {K_JVP, K_VJP, K_SITE_JVP, K_SITE_VJP};
    for (int k = 0; k < K_KINDS; k++) p->tried[k] = p->fn[k] != NULL; /* kernels that were left out may be needed now */
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++) {
        p->fn[kinds[i]] = NULL;
        p->tried[kinds[i]] = false;
        p->scene.kernel[kinds[i]] = NULL;
    }
    p->scene.tape_bytes = 0, p->scene.tape_grows = false;
    api_derived_forget(p);
}

void api_free_kernels(SltProgram *p) {
    api_late_free(p);
    api_turns_forget(p);
    for (uint32_t m = 0; m < p->nmodules; m++) back_free(p->modules[m]);
    p->nmodules = 0;
    memset(p->fn, 0, sizeof p->fn);
    memset(p->module_of, 0, sizeof p->module_of);
    memset(p->tried, 0, sizeof p->tried);
    memset(p->scene.kernel, 0, sizeof p->scene.kernel);
    if (p->cull_kernels) memset(p->cull_kernels, 0, p->prog->ncull * sizeof *p->cull_kernels);
}
