/* Kernels on demand: those that a call needs and that are not there yet go through passes and back end as one module.
 */
#include <stdlib.h>
#include <math.h>
#include <string.h>
#include <time.h>

#include "bindings/c/api.h"
#include "bindings/c/recall.h"
#include "compiler/pass/depend.h"
#include "compiler/pass/walk.h"

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
    s->work = walk_work(g->primal->body);
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

static void find_noted(const Block *b, uint8_t noted[SLT_MAX_CULL]) {
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
    p->first_lists = p->nlists;
}

/* ---- facts of kernels, from their IR */
static uint32_t *queries_of(const SltProgram *p, const Fn *fn) {
    uint32_t *queries = ARENA_ARRAY(&p->session->module, uint32_t, p->prog->ngeometries + 1);
    for (uint32_t g = 0; g < p->prog->ngeometries; g++) queries[g] = api_geometry_queries(fn, g);
    return queries;
}

static void edge_facts(const SltProgram *p, const KernelSet *set, OrderFacts *f) {
    if (!set->edges) return;
    f->edge = ARENA_ARRAY(&p->session->module, EdgeFacts, set->nedges + 1);
    f->nedges = set->nedges, f->flat = set->flat, f->told = set->told, f->chunked = set->chunked;
    for (uint32_t e = 0; e < set->nedges; e++) {
        const SiteInfo *edge = &set->edges[e];
        f->edge[e] = (EdgeFacts){.kind = (uint8_t)edge->kind,
                                 .bends = e >= p->prog->primal->nsites && !edge->jumps,
                                 .upsets = (uint8_t)edge->upsets,
                                 .argmin = edge->kind == SITE_COMPARE ? edge->argmin : (int8_t)0};
        uint32_t column;
        if (edge->upsets) span_position(p->session, edge->span, &f->edge[e].line, &column);
    }
}

/* Lowers the bounds of a [Cull] loop, which have no variants. */
static void bounds_facts(SltProgram *p, Fn *bounds, KernelFacts *f) {
    const uint64_t reads = f->layout.reads;
    pipeline_kernel(&p->passes, bounds);
    f->made = true;
    f->layout = pipeline_layout(bounds);
    f->layout.reads |= reads; /* what any of them reads */
    const uint32_t *queries = queries_of(p, bounds);
    if (!f->queries) f->queries = ARENA_ARRAY(&p->session->module, uint32_t, p->prog->ngeometries + 1);
    for (uint32_t g = 0; g < p->prog->ngeometries; g++) f->queries[g] |= queries[g];
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
                                   uint64_t plain, unsigned level, uint32_t lanes, SltError *err) {
    BackJob job = {.k = req, .n = n, .o = back_options(p, few, plain, level)};
    job.o.lanes = lanes;
    return compile_modules(p, s, &job, 1, err) == SLT_OK ? job.out : NULL;
}

/* Cells are asked about a few at a time (of a tree over lists, seven): one vector a value is enough. Those of a
 * straight-line program are as long as it is and thirty times over, but run a few chunks of that at once: it is
 * compiling them that takes time. */
static bool is_of_boxes(int kind) {
    return kind == K_BOUNDS || kind == K_EDGE || kind == K_EDGE_BOUNDS || kind == K_WRITTEN_BOUNDS;
}

static bool is_long(const KernelSet *set, int kind) { return kind == K_PRUNE || (set->chunked && is_of_boxes(kind)); }

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

static unsigned level_of(const SltProgram *p) { return p->prog->primal->nsites > MANY_SITES ? 0 : 2; }

static VariantOptions variant_options(const SltProgram *p, bool cells) {
    return (VariantOptions){.near_miss = api_near_miss(p),
                            .paper_argmin = p->opt.paper_argmin,
                            .paper_forced = p->opt.paper_forced,
                            .path_hash = p->opt.path_hash || api_near_miss(p),
                            .cells = cells,
                            .written = p->lists == LISTS_USED,
                            .most_site_size = p->most_site_size};
}

static void reverse_facts(SltProgram *p, int kind, Fn *fn, OrderFacts *f) {
    if (!f->dense) f->dense = ARENA_ARRAY(&p->session->module, uint8_t, p->prog->nfloats + 1);
    const bool adds = back_dense_adjoints(fn, f->dense);
    if (kind == K_SITE_VJP) f->site_logs = !adds && !p->opt.interpret;
    else f->rigid = !ir_has(fn->body, OP_adj);
    f->kernel[kind].few &= !adds; /* the order of sums hangs on the lanes */
}

static void kernel_facts(SltProgram *p, int kind, const KernelSet *set, OrderFacts *f) {
    KernelFacts *k = &f->kernel[kind];
    Fn *fn = set->fn[kind];
    *k = (KernelFacts){.made = true,
                       .few = p->few_samples || (is_of_boxes(kind) && !is_long(set, kind)),
                       .plain = is_long(set, kind),
                       .tape_grows = set->tape[kind].grows,
                       .tape_bytes = set->tape[kind].bytes_per_lane,
                       .layout = set->layout[kind],
                       .queries = queries_of(p, fn)};
    if (kind == K_BOUNDS) find_noted(fn->body, f->noted);
    if (kind == K_VJP || kind == K_SITE_VJP) reverse_facts(p, kind, fn, f);
}

/* ---- a program's own tables, from facts */
static void adopt_edges(SltProgram *p, const OrderFacts *f) {
    if (!f->edge || p->edge_kind) return; /* the same ones each time */
    Arena *a = &p->session->module;
    const uint32_t n = f->nedges;
    p->edge_kind = ARENA_ARRAY(a, uint8_t, n + 1), p->edge_bends = ARENA_ARRAY(a, uint8_t, n + 1);
    p->nedges = n, p->flat = f->flat, p->told = f->told, p->chunked = f->chunked;
    for (uint32_t e = 0; e < n; e++) {
        const EdgeFacts *edge = &f->edge[e];
        p->edge_kind[e] = edge->kind, p->edge_bends[e] = edge->bends;
        if (edge->argmin) {
            if (!p->edge_argmin) p->edge_argmin = ARENA_ARRAY(a, int8_t, n + 1);
            p->edge_argmin[e] = edge->argmin;
        }
        if (!edge->upsets) continue;
        if (!p->edge_upsets)
            p->edge_upsets = ARENA_ARRAY(a, uint8_t, n + 1), p->edge_line = ARENA_ARRAY(a, uint32_t, n + 1);
        p->edge_upsets[e] = edge->upsets, p->edge_line[e] = edge->line;
    }
}

static void adopt_kernel(SltProgram *p, int kind, const KernelFacts *k) {
    SltScene *scene = &p->scene;
    p->has[kind] = true;
    scene->layout[kind] = k->layout;
    api_geometries_ask(p, k->queries);
    if (k->tape_bytes > scene->tape_bytes) scene->tape_bytes = k->tape_bytes;
    scene->tape_grows |= k->tape_grows;
    p->compiled_few[kind] = k->few, p->compiled_level[kind] = k->plain ? 0 : (uint8_t)level_of(p);
}

static void adopt(const KernelOrder *q, const OrderFacts *f) {
    SltProgram *p = q->p;
    if (!q->of_images) adopt_edges(p, f);
    for (int k = 0; k < K_KINDS; k++) {
        p->tried[k] |= q->needs[k];
        if (f->kernel[k].made) adopt_kernel(p, k, &f->kernel[k]);
    }
    if (f->kernel[K_REGION].made) p->scene.hides = f->hides;
    if (f->kernel[K_SITE_VJP].made) p->scene.site_logs = f->site_logs;
    if (f->kernel[K_VJP].made) p->scene.rigid = f->rigid;
    for (uint32_t l = 0; l < SLT_MAX_CULL; l++) p->list_noted[l] |= f->noted[l];
    if (f->dense && !p->dense) p->dense = ARENA_ARRAY(&p->session->module, uint8_t, p->prog->nfloats + 1);
    for (uint32_t i = 0; f->dense && i < p->prog->nfloats; i++) p->dense[i] |= f->dense[i];
    if (!f->cull.made) return;
    p->scene.layout[SLT_K_CULL] = f->cull.layout;
    api_geometries_ask(p, f->cull.queries);
}

/* Kernels that are compiled take their places. */
static void adopt_modules(const KernelOrder *q, const OrderFacts *f, CompiledModule *const module[ORDER_MODULES]) {
    SltProgram *p = q->p;
    for (int k = 0; k < K_KINDS; k++) {
        CompiledModule *m = module[q->soon[k]];
        if (!f->kernel[k].made) continue;
        if (p->opt.interpret) p->scene.kernel[k] = interpreted;
        else if (q->late[k]) p->scene.kernel[k] = slt_kernel_late;
        else p->scene.kernel[k] = back_kernel(m, kernel_names[k]), p->module_of[k] = m;
        const uint32_t lanes = f->kernel[k].lanes;
        if (lanes > p->scene.widest) p->scene.widest = lanes;
        if (lanes > p->scene.lanes[k]) p->scene.lanes[k] = lanes;
    }
    for (uint32_t c = 0; q->cull && module[0] && c < p->prog->ncull; c++)
        p->cull_kernels[c] = back_kernel(module[0], arena_printf(&p->session->module, "cull%u", c));
}

/* fn: NULL, where its IR is made when it is called. */
static void put_off(SltProgram *p, int kind, Fn *fn, const KernelFacts *k) {
    LateKernels *l = &p->late;
    l->few |= (uint64_t)k->few << l->n, l->plain |= (uint64_t)k->plain << l->n, l->level = level_of(p);
    l->kind[l->n] = (SltKernelKind)kind, l->request[l->n++] = (KernelRequest){kernel_names[kind], fn};
}

void api_put_off_guarded(SltProgram *p) {
    SltScene *s = &p->scene;
    const KernelFacts facts = {.few = p->compiled_few[K_VJP]};
    p->compiled_few[K_VJP_GUARDED] = p->compiled_few[K_VJP];
    p->compiled_level[K_VJP_GUARDED] = p->compiled_level[K_VJP];
    p->late.guarded_lanes = back_width(p->module_of[K_VJP], kernel_names[K_VJP]);
    s->layout[K_VJP_GUARDED] = s->layout[K_VJP], s->kernel[K_VJP_GUARDED] = slt_kernel_late;
    put_off(p, K_VJP_GUARDED, NULL, &facts);
}

/* From IR: compiles kernels, and says what there is to know of them. */
static SltStatus compile_order(KernelOrder *q, const KernelSet *set, OrderFacts *f,
                               CompiledModule *module[ORDER_MODULES]) {
    SltProgram *p = q->p;
    const unsigned level = level_of(p);
    Group group[ORDER_MODULES] = {0};
    for (int k = 0; k < K_KINDS; k++) {
        const KernelRequest this = {kernel_names[k], set->fn[k]};
        KernelFacts *facts = &f->kernel[k];
        if (!set->fn[k]) continue;
        p->fn[k] = set->fn[k], p->tape[k] = set->tape[k];
        kernel_facts(p, k, set, f);
        const BackOptions o = back_options(p, facts->few, facts->plain, level);
        if (k == K_VALUE && p->opt.rgba8 && p->lists != LISTS_USED)
            back_share_row(set->fn[k], &p->target, back_width_choice(&this, 0, &o).lanes);
        if (p->opt.interpret) continue;
        if (q->late[k]) facts->lanes = back_width_choice(&this, 0, &o).lanes;
        else add_kernel(&group[q->soon[k]], this, facts->few, facts->plain);
    }
    for (uint32_t c = 0; q->cull && c < p->prog->ncull; c++)
        add_kernel(&group[0], (KernelRequest){arena_printf(&p->session->module, "cull%u", c), p->prog->cull_bounds[c]},
                   p->few_samples, false);
    SltStatus status = make_modules(p, p->session, group, level, q->err);
    for (uint32_t m = 0; m < ORDER_MODULES; m++) {
        module[m] = group[m].made;
        if (module[m]) f->module[m] = back_key(module[m]);
    }
    for (int k = 0; k < K_KINDS; k++)
        if (f->kernel[k].made && !q->late[k] && module[q->soon[k]])
            f->kernel[k].lanes = back_width(module[q->soon[k]], kernel_names[k]);
    for (uint32_t c = 0; q->cull && module[0] && c < p->prog->ncull; c++)
        f->cull_lanes[c] = back_width(module[0], arena_printf(&p->session->module, "cull%u", c));
    return status;
}

/* Where nobody looks at sums. */
static bool keeps_guards(const SltProgram *p) { return p->opt.interpret || p->guarded; }

static void make_ir(KernelOrder *q, KernelSet *set, OrderFacts *f) {
    SltProgram *p = q->p;
    VariantOptions vo = variant_options(p, q->cells);
    const AdOptions ad = {.wrt = p->wrt, .guarded = keeps_guards(p)};
    const double start = now_ms();
    vo.image = q->of_images;
    pipeline_kernels(&p->passes, p->prog, q->needs, &vo, &ad, set);
    edge_facts(p, set, f);
    f->hides = set->hides, f->bare = set->bare;
    if (q->cull) {
        f->cull_lanes = ARENA_ARRAY(&p->session->module, uint32_t, p->prog->ncull + 1);
        for (uint32_t c = 0; c < p->prog->ncull; c++) bounds_facts(p, p->prog->cull_bounds[c], &f->cull);
        if (p->opt.verify) api_check_cull(p);
    }
    p->ms_passes += now_ms() - start;
}

/* Have all kernels been put where the cache has them? */
static bool are_kept(const OrderFacts *f, CompiledModule *const module[ORDER_MODULES]) {
    for (uint32_t m = 0; m < ORDER_MODULES; m++)
        if (module[m] && !f->module[m].len) return false;
    return true;
}

static void build_body(Session *s, void *order) {
    KernelOrder *q = order;
    SltProgram *p = q->p;
    OrderFacts f = {0};
    KernelSet set = {0};
    CompiledModule *module[ORDER_MODULES] = {NULL};
    (void)s;
    if (!p->site_kind) site_tables(p);
    const CacheKey key = recall_key(q);
    if (recall(q, &key, &f, module)) {
        for (uint32_t m = 0; m < ORDER_MODULES; m++)
            if (module[m]) p->modules[p->nmodules++] = module[m];
    } else {
        f = (OrderFacts){0};
        make_ir(q, &set, &f);
        q->status = compile_order(q, &set, &f, module);
        if (q->status != SLT_OK) return;
        if (key.len && !set.chunks /* which are tables of their own */ && are_kept(&f, module))
            recall_keep(q, &key, &f);
    }
    adopt(q, &f);
    if (set.chunks) p->scene.chunks = set.chunks;
    for (int k = 0; k < K_KINDS; k++)
        if (f.kernel[k].made && q->late[k] && !p->opt.interpret) put_off(p, k, set.fn[k], &f.kernel[k]);
    adopt_modules(q, &f, module);
    if (f.kernel[K_VJP].made && f.bare) api_put_off_guarded(p);
}

/* ---- IR of kernels that were recalled */
typedef struct Missing {
    SltProgram *p;
    bool kinds[K_KINDS];
} Missing;

void api_missing(SltProgram *p, const bool kinds[K_KINDS], const uint8_t *wrt) {
    const VariantOptions vo = variant_options(p, true);
    const AdOptions ad = {.wrt = wrt, .guarded = keeps_guards(p)};
    KernelSet set;
    pipeline_kernels(&p->passes, p->prog, kinds, &vo, &ad, &set);
    for (int k = 0; k < K_KINDS; k++)
        if (kinds[k] && set.fn[k]) p->fn[k] = set.fn[k], p->tape[k] = set.tape[k];
}

static void missing_body(Session *s, void *missing) {
    const Missing *m = missing;
    (void)s;
    api_missing(m->p, m->kinds, m->p->wrt);
}

static SltStatus make_missing(SltProgram *p, const bool needs[K_KINDS], SltError *err) {
    Missing m = {.p = p};
    bool any = false;
    for (int k = 0; k < K_KINDS; k++) any |= m.kinds[k] = needs[k] && p->has[k] && !p->fn[k];
    const int unwound = any ? session_protect(p->session, missing_body, &m) : SLT_OK;
    return unwound ? status_fail(err, (SltStatus)unwound, "%s", p->session->unwind_text) : SLT_OK;
}

const Fn *api_fn(SltProgram *p, int kind) {
    bool needs[K_KINDS] = {false};
    SltError err;
    needs[kind] = true;
    return make_missing(p, needs, &err) == SLT_OK ? p->fn[kind] : NULL;
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

/* late, soon: of those; NULL: none. by_facts: nobody wants to see their IR. */
static SltStatus make_kernels(SltProgram *p, const bool needs[K_KINDS], const bool *late, const bool *soon,
                              bool by_facts, SltError *err) {
    SltError own;
    if (!err) err = &own;
    if (!p->prog) return status_fail(err, SLT_USAGE, "the program did not compile");
    SltStatus refused = refuse_many_sites(p, needs, err);
    if (refused != SLT_OK) return refused;
    KernelOrder q = {.p = p, .by_facts = by_facts, .err = err};
    bool any = false;
    q.cells = needs[K_EDGE] && !(p->tried[K_EDGE] && !p->nedges); /* without an edge no cell has two sides */
    for (int k = 0; k < K_KINDS; k++) {
        q.needs[k] = needs[k] && k != K_VJP_GUARDED /* which comes with vjp */ &&
                     (!p->tried[k] || (k == K_SIDES && q.cells && !p->has[k]));
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
    SltStatus status = by_facts ? SLT_OK : make_missing(p, needs, err);
    if (status == SLT_OK) status = api_late_compile(p, needs, late, err);
    if (status != SLT_OK) return status;
    fill_scene(p);
    status = api_derived_kernels(p, needs, err);
    if (status == SLT_OK && runs_here(p)) status = api_derived_follow(p, p->scene.iparams, err);
    if (status == SLT_OK) status = api_geometries(p, err);
    if (status != SLT_OK) return status;
    return SLT_OK;
}

/* Whether `bounds` is there, and what is known of edges, decides how much is looked for in derivatives, and in which
 * order they are summed: these must not hang on the images that were made before. */
bool api_lists_begin(SltProgram *p) {
    SltScene *s = &p->scene;
    if (s->kernel[K_BOUNDS]) return true;
    if (!p->image_bounds) {
        SltError err;
        KernelOrder q = {.p = p, .by_facts = true, .of_images = true, .err = &err};
        if (p->nmodules + 4 >= sizeof p->modules / sizeof *p->modules) return false;
        q.needs[K_BOUNDS] = true;
        const bool made = !session_protect(p->session, build_body, &q) && q.status == SLT_OK;
        p->image_bounds = made ? s->kernel[K_BOUNDS] : NULL, p->image_layout = s->layout[K_BOUNDS];
        p->tried[K_BOUNDS] = p->has[K_BOUNDS] = false, p->fn[K_BOUNDS] = NULL;
        if (!p->image_bounds) p->list_work = -INFINITY; /* nor will it be the next time */
    }
    s->kernel[K_BOUNDS] = p->image_bounds, s->layout[K_BOUNDS] = p->image_layout;
    return p->image_bounds;
}

void api_lists_end(SltProgram *p) {
    if (!p->has[K_BOUNDS]) p->scene.kernel[K_BOUNDS] = NULL;
}

SltStatus api_kernels_unrun(SltProgram *p, const bool needs[K_KINDS], SltError *err) {
    return make_kernels(p, needs, NULL, NULL, false, err);
}

static SltStatus make_to_run(SltProgram *p, const bool needs[K_KINDS], const bool *late, const bool *soon,
                             bool by_facts, SltError *err) {
    if (!runs_here(p)) {
        Target here;
        target_named(&here, "native");
        return status_fail(err, SLT_USAGE, "kernels for the target `%s` do not run on this processor (%s): use native",
                           p->opt.target, here.cpu);
    }
    return make_kernels(p, needs, late, soon, by_facts, err);
}

SltStatus api_kernels_late(SltProgram *p, const bool needs[K_KINDS], const bool *late, SltError *err) {
    return make_to_run(p, needs, late, NULL, true, err);
}

SltStatus api_kernels_beside(SltProgram *p, const bool needs[K_KINDS], const bool soon[K_KINDS], SltError *err) {
    bool both[K_KINDS], apart[K_KINDS];
    for (int k = 0; k < K_KINDS; k++) both[k] = needs[k] || soon[k], apart[k] = !needs[k] && soon[k];
    return make_to_run(p, both, NULL, apart, true, err);
}

SltStatus api_kernels(SltProgram *p, const bool needs[K_KINDS], SltError *err) {
    return make_to_run(p, needs, NULL, NULL, false, err);
}

void api_forget_gradients(SltProgram *p) {
    static const int kinds[] = {K_JVP, K_VJP, K_SITE_JVP, K_SITE_VJP, K_VJP_GUARDED};
    api_late_drop_guarded(p);
    for (int k = 0; k < K_KINDS; k++) p->tried[k] = p->has[k]; /* kernels that were left out may be needed now */
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++) {
        p->fn[kinds[i]] = NULL;
        p->tried[kinds[i]] = p->has[kinds[i]] = false;
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
    memset(p->has, 0, sizeof p->has);
    memset(p->module_of, 0, sizeof p->module_of);
    memset(p->tried, 0, sizeof p->tried);
    memset(p->scene.kernel, 0, sizeof p->scene.kernel);
    p->image_bounds = NULL;
    if (p->cull_kernels) memset(p->cull_kernels, 0, p->prog->ncull * sizeof *p->cull_kernels);
}
