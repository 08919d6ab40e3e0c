/* Derived arrays (compiler/front/front.h): their kernels, compiled when the shader's first are, and their numbers,
 * which follow what they are computed from. */
#include "bindings/c/derived.h"

#include <stdlib.h>
#include <string.h>

static Program *program_of(const SltProgram *p, uint32_t d) { return p->prog->derived[d].of; }

void api_derived_lower(SltProgram *p) {
    Program *prog = p->prog;
    Arena *a = &p->session->module;
    PassCtx passes = p->passes;
    p->derived = ARENA_ARRAY(a, DerivedState, prog->nderived + 1);
    p->derived_scene = ARENA_ARRAY(a, SltDerived, prog->nderived + 1);
    for (uint32_t d = 0; d < prog->nderived; d++) {
        DerivedState *s = &p->derived[d];
        passes.program = program_of(p, d);
        pipeline_primal(&passes, program_of(p, d)->primal);
        s->reaches = ARENA_ARRAY(a, uint8_t, (prog->nfloats + 7) / 8 + 1);
        ad_activity(program_of(p, d)->primal, s->reaches);
        s->stale = true;
    }
}

void api_derived_mark(const SltProgram *p, uint8_t *wrt) {
    for (uint32_t d = 0; d < p->prog->nderived; d++) {
        const Derived *of = &p->prog->derived[d];
        bool moves = false;
        for (uint32_t f = 0; f < of->base && !moves; f++)
            moves = wrt[f] && p->derived[d].reaches[f >> 3] >> (f & 7) & 1;
        memset(wrt + of->base, moves, 3 * (size_t)of->n);
    }
}

/* ---- numbers */

static bool same_bits(const SltProgram *p, const double *values, uint32_t at, uint32_t n) {
    for (uint32_t i = at; i < at + n; i++) {
        float v = (float)values[i];
        if (p->opt.f64 ? memcmp((double *)p->flt + i, &values[i], sizeof *values) != 0
                       : memcmp((float *)p->flt + i, &v, sizeof v) != 0)
            return false;
    }
    return true;
}

void api_derived_watch(SltProgram *p, const double *values, uint32_t base, uint32_t count) {
    for (uint32_t d = 0; p->derived && d < p->prog->nderived; d++) {
        const Derived *of = &p->prog->derived[d];
        for (uint32_t k = 0; k < of->nreads && !p->derived[d].stale; k++) {
            const Param *q = &p->prog->params[of->reads[k]];
            uint32_t from = q->fbase > base ? q->fbase : base,
                     to = q->fbase + q->fcount < base + count ? q->fbase + q->fcount : base + count;
            p->derived[d].stale = from < to && !same_bits(p, values, from, to - from);
        }
    }
}

SltStatus api_derived_follow(SltProgram *p, const int32_t *ints, SltError *err) {
    const Program *g = p->prog;
    for (uint32_t d = 0; d < g->nderived; d++) {
        const Derived *of = &g->derived[d];
        DerivedState *state = &p->derived[d];
        SltScene s = p->scene;
        if (!state->stale && !of->reads_ints) continue;
        s.iparams = ints;
        /* Into numbers of their own: geometries are told by what they differ from those before. */
        void *flt = malloc(((size_t)g->nfloats + 1) * sizeof(double));
        if (flt) memcpy(flt, p->flt, g->nfloats * (p->opt.f64 ? sizeof(double) : sizeof(float)));
        bool ok = flt && derived_value(&s, d, flt);
        for (uint32_t i = of->base; ok && i < of->base + 3 * of->n; i++)
            p->floats[i] = p->opt.f64 ? ((const double *)flt)[i] : (double)((const float *)flt)[i];
        free(flt);
        if (!ok)
            return status_fail(err, SLT_LIMIT, "out of memory for the %s of `%s`", of->what, g->params[of->param].name);
        api_flt_from(p, p->floats, of->base, 3 * of->n);
        state->stale = false, state->computed++;
    }
    return SLT_OK;
}

/* ---- kernels */

typedef struct Request {
    SltProgram *p;
    bool needs[K_KINDS];
    SltError *err;
    SltStatus status;
} Request;

static void interpret(void *user, int kind, SltKernelArgs *args, uint32_t n) {
    const DerivedState *s = user;
    int status = ir_interpret(s->fn[kind], args, n, 16);
    if (status != SLT_OK && s->p->error.status == SLT_OK)
        status_fail(&s->p->error, (SltStatus)status, "the interpreter stopped in a kernel of vertices");
}

static void interpreted(SltKernelArgs *args, uint32_t n) { (void)args, (void)n; }

static void compile(Request *q, uint32_t d, int kind) {
    SltProgram *p = q->p;
    DerivedState *state = &p->derived[d];
    SltScene *scene = &p->derived_scene[d].scene;
    KernelRequest r = {kernel_names[kind], state->fn[kind]};
    BackOptions bo = {.target = p->target,
                      .width = p->opt.width,
                      .adj = ADJ_FLAT,
                      .no_cache = p->opt.no_cache,
                      .opt_level = 2,
                      .threads = p->threads};
    const char *why = NULL;
    bool cached;
    double emit, llvm;
    int status = back_compile(p->session, &r, 1, &bo, &state->module[kind], &why);
    if (status != SLT_OK) {
        q->status = status_fail(q->err, (SltStatus)status, "%s", why ? why : "the back end failed");
        return;
    }
    back_times(state->module[kind], &emit, &llvm, &cached);
    p->ms_llvm += emit + llvm, p->cached &= cached;
    scene->kernel[kind] = back_kernel(state->module[kind], kernel_names[kind]);
    uint32_t width = back_width(state->module[kind], kernel_names[kind]);
    if (width > scene->widest) scene->widest = width;
}

static void build(Session *s, void *user) {
    Request *q = user;
    SltProgram *p = q->p;
    for (uint32_t d = 0; d < p->prog->nderived && q->status == SLT_OK; d++) {
        DerivedState *state = &p->derived[d];
        SltScene *scene = &p->derived_scene[d].scene;
        const Derived *of = &p->prog->derived[d];
        bool needs[K_KINDS] = {0}, any = false;
        for (int k = 0; k < K_KINDS; k++) {
            bool moves = k == K_VALUE || p->wrt[of->base];
            any |= needs[k] = q->needs[k] && moves && !state->fn[k];
        }
        if (!any) continue;
        KernelSet set;
        AdOptions ad = {.wrt = p->wrt, .guarded = true};
        PassCtx passes = p->passes;
        passes.program = NULL;
        pipeline_kernels(&passes, of->of, needs, NULL, &ad, &set);
        *scene = (SltScene){
            .f64 = p->opt.f64,
            .dim = 1,
            .channels = 3,
            .hi = {1},
            .nfloats = p->prog->nfloats,
            .nints = p->prog->nints,
            .adj_lanes = 1,
            .widest = scene->widest,
            .tape_bytes = scene->tape_bytes,
            .tape_grows = scene->tape_grows,
            .tape_full = &p->tape_full,
            .dense = scene->dense,
            .kernel =
                {[K_VALUE] = scene->kernel[K_VALUE], [K_JVP] = scene->kernel[K_JVP], [K_VJP] = scene->kernel[K_VJP]},
            .layout = {
                [K_VALUE] = scene->layout[K_VALUE], [K_JVP] = scene->layout[K_JVP], [K_VJP] = scene->layout[K_VJP]}};
        if (p->opt.interpret) scene->call = interpret, scene->call_user = state;
        p->derived_scene[d].base = of->base, p->derived_scene[d].n = of->n;
        for (int k = 0; k < K_KINDS && q->status == SLT_OK; k++) {
            if (!needs[k] || !set.fn[k]) continue;
            state->fn[k] = set.fn[k], scene->layout[k] = set.layout[k];
            if (set.tape[k].bytes_per_lane > scene->tape_bytes) scene->tape_bytes = set.tape[k].bytes_per_lane;
            scene->tape_grows |= set.tape[k].grows;
            if (k == K_VJP && !p->opt.interpret) {
                uint8_t *dense = ARENA_ARRAY(&s->module, uint8_t, p->prog->nfloats + 1);
                back_dense_adjoints(set.fn[k], dense);
                scene->dense = dense;
            }
            if (p->opt.interpret) scene->kernel[k] = interpreted;
            else compile(q, d, k);
        }
    }
}

SltStatus api_derived_kernels(SltProgram *p, const bool needs[K_KINDS], SltError *err) {
    Request q = {.p = p, .err = err};
    if (!p->prog->nderived) return SLT_OK;
    q.needs[K_VALUE] = true;
    q.needs[K_JVP] = needs[K_JVP] || needs[K_SITE_JVP], q.needs[K_VJP] = needs[K_VJP] || needs[K_SITE_VJP];
    for (uint32_t d = 0; d < p->prog->nderived; d++) p->derived[d].p = p;
    int unwound = session_protect(p->session, build, &q);
    if (unwound) return status_fail(err, (SltStatus)unwound, "%s", p->session->unwind_text);
    return q.status;
}

static void forget(SltProgram *p, int kind) {
    for (uint32_t d = 0; p->derived && d < p->prog->nderived; d++) {
        DerivedState *s = &p->derived[d];
        back_free(s->module[kind]);
        s->module[kind] = NULL, s->fn[kind] = NULL, p->derived_scene[d].scene.kernel[kind] = NULL;
    }
}

void api_derived_forget(SltProgram *p) { forget(p, K_JVP), forget(p, K_VJP); }

void api_derived_free(SltProgram *p) {
    if (p->prog) api_derived_forget(p), forget(p, K_VALUE);
}
