/* slt_bound: what bounds know of boxes, with the places in the source. */
#include <math.h>
#include <string.h>

#include "bindings/c/api.h"
#include "runtime/quadrature/boxes.h"

_Static_assert((int)SLT_MAX_OPEN == SLT_BOUND_OPEN && SLT_MAX_K == 8 && SLT_MAX_CHANNELS == 4, "SltBound's arrays");

static const char *const site_kinds[SLT_SITE_KINDS] = {
#define SLT_SITE(id, text, ...) text,
#include "saltus/kernel.def"
};

typedef struct Asked {
    SltProgram *p;
    char *out;     /* SltBound[n] of the caller's version */
    size_t stride; /* bytes of each */
} Asked;

/* Sites and seams are those of the Fn that bounds were made from. */
static void describe_edge(const SltProgram *p, SltOpenEvent *out) {
    const Fn *fn = p->fn[K_BOUNDS];
    const SiteInfo *info = &fn->sites[out->edge];
    uint32_t sites = p->prog->primal->nsites;
    out->seam = (uint32_t)out->edge >= sites;
    out->kind = site_kinds[info->kind];
    out->file = "", out->text = info->text ? info->text : "";
    out->loops = info->depth;
    if (info->span.file < 0) return;
    out->file = p->session->sources[info->span.file].path;
    span_position(p->session, info->span, &out->line, &out->column);
}

static void take(void *user, uint64_t i, const BoxFacts *f) {
    const Asked *a = user;
    SltBound b = {.struct_size = sizeof b,
                  .unknown = (f->state & SLT_BOX_UNKNOWN) != 0,
                  .rough = (f->state & SLT_BOX_ROUGH) != 0,
                  .count = f->open,
                  .listed = f->listed};
    b.settled = !f->open && !f->state;
    for (uint32_t c = 0; c < a->p->prog->channels; c++) b.lo[c] = f->f[c][0], b.hi[c] = f->f[c][1];
    for (uint32_t e = 0; e < f->listed; e++) {
        const BoxEvent *event = &f->event[e];
        SltOpenEvent *open = &b.open[e];
        *open = (SltOpenEvent){.edge = event->edge,
                               .jumps = (event->state & SLT_EDGE_JUMPS) != 0,
                               .bends = (event->state & SLT_EDGE_BENDS) != 0,
                               .boundary = {event->first, event->last}};
        memcpy(open->k, event->k, sizeof open->k);
        memcpy(open->g, event->g, sizeof open->g);
        memcpy(open->dg, event->dg, sizeof open->dg);
        describe_edge(a->p, open);
    }
    api_struct_write(a->out + i * a->stride, &b, sizeof b);
}

/* A number as the program has it. */
static double rounded(const SltProgram *p, double v) { return p->opt.f64 ? v : (double)(float)v; }

static SltStatus check_boxes(const SltProgram *p, uint32_t n, const double *lo, const double *hi, SltError *err) {
    uint32_t dim = p->prog->dim;
    for (size_t i = 0; i < (size_t)n * dim; i++) {
        if (!isfinite(rounded(p, lo[i])) || !isfinite(rounded(p, hi[i])))
            return status_fail(err, SLT_USAGE, "box %zu, axis %zu: [%g, %g] is not finite in %s", i / dim, i % dim,
                               lo[i], hi[i], p->opt.f64 ? "f64" : "f32");
        if (lo[i] > hi[i])
            return status_fail(err, SLT_USAGE, "box %zu, axis %zu: %g lies above %g", i / dim, i % dim, lo[i], hi[i]);
    }
    return SLT_OK;
}

static SltStatus check_results(uint32_t n, SltBound *out, SltError *err) {
    if (n && !api_struct_sized(out)) return api_struct_unknown(err, "SltBound");
    for (uint32_t i = 1; i < n; i++)
        if (memcmp((char *)out + i * out->struct_size, &out->struct_size, sizeof out->struct_size) != 0)
            return api_struct_unknown(err, "SltBound");
    return SLT_OK;
}

SltStatus slt_bound(SltProgram *p, const SltJob *job, uint32_t n, const double *lo, const double *hi, SltBound *out,
                    SltError *err) {
    static const bool needs[K_KINDS] = {[K_BOUNDS] = true, [K_EDGE_BOUNDS] = true, [K_WRITTEN_BOUNDS] = true};
    SltStatus s = check_results(n, out, err);
    if (s != SLT_OK) return s;
    ApiCall c;
    s = api_call_begin(&c, p, job, NULL, err);
    if (s == SLT_OK && p->opt.rgba8 && !p->opt.interpret)
        s = status_fail(err, SLT_USAGE, "a program compiled with rgba8 has pixels for values, which have no bounds");
    if (s == SLT_OK) s = check_boxes(p, n, lo, hi, err);
    if (s == SLT_OK) s = api_kernels(p, needs, err); /* sites are named from its IR */
    Asked a = {p, (char *)out, n ? out->struct_size : 0};
    if (s == SLT_OK) s = slt_estimate_boxes(&p->scene, &c.job, n, lo, hi, take, &a, NULL, err);
    return api_call_end(&c, s);
}
