/* The story of one point: saltus explain --at, and the pixel inspector of saltus view. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cli/explain.h"

/* ---- the trace */
typedef struct TraceLog {
    TracedSite *at;
    uint32_t n, cap;
    bool failed; /* memory ran out */
} TraceLog;

/* The interpreter tells every site that it executes through print: the traced Fn prints (site, decision, g, k..). */
static void on_trace(void *user, const char *text, uint32_t len, const double *v, uint32_t n, uint32_t lane) {
    TraceLog *log = user;
    (void)len;
    if (lane != 0 || n < 3 || (text[0] != 's' && text[0] != 'n') || log->failed) return;
    if (log->n == log->cap) {
        uint32_t cap = log->cap ? log->cap * 2 : 64;
        TracedSite *more = realloc(log->at, cap * sizeof *more);
        log->failed = !more;
        if (!more) return;
        log->at = more, log->cap = cap;
    }
    TracedSite *s = &log->at[log->n++];
    *s = (TracedSite){.site = (int32_t)v[0],
                      .g = v[2],
                      .decision = v[1] != 0,
                      .is_rounding = text[0] == 'n',
                      .n = v[1],
                      .loops = n - 3};
    for (uint32_t k = 0; k + 3 < n && k < SLT_MAX_K; k++) s->k[k] = (int32_t)v[3 + k];
}

static void trace_sites(Fn *fn, Block *b) {
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) trace_sites(fn, i->region[r]);
        if (i->op == OP_print) ir_unlink(i);
        if (i->op != OP_site && i->op != OP_siten) continue;
        Builder at = ir_after(fn, i);
        Inst *args[3 + SLT_MAX_K] = {ir_consti(&at, (int32_t)i->imm.i), i, i->args[1]};
        uint32_t n = 3;
        for (uint32_t a = 2; a < i->nargs; a++) args[n++] = i->args[a];
        ir_special(&at, OP_print, TY_VOID, n, args, (Imm){.text = {i->op == OP_site ? "s" : "n", 1}});
    }
}

static Fn *make_traced(SltProgram *p) {
    Fn *fn = ir_clone(p->prog->primal, &p->session->module, "trace");
    lower_custom(&p->passes, fn);
    trace_sites(fn, fn->body);
    lower_rand(&p->passes, fn);
    lower_math(&p->passes, fn);
    return fn;
}

static SltStatus trace(SltProgram *p, const Fn *fn, const double x[3], TraceLog *log, double f[SLT_MAX_CHANNELS],
                       SltError *err) {
    enum { N = 64 };
    _Alignas(64) double flt[4][N] = {0};
    _Alignas(64) double outs[SLT_MAX_CHANNELS][N] = {0};
    static const _Alignas(64) int32_t zero[N];
    api_geometries_want(p, fn);
    SltStatus status = api_geometries(p, err);
    if (status != SLT_OK) return status;
    SltKernelArgs args = {.params = p->flt,
                          .iparams = p->ints,
                          .print = on_trace,
                          .user = log,
                          .n_valid = 1,
                          .geometries = p->geometries};
    for (int i = 0; i < N; i++)
        for (int d = 0; d < 3; d++)
            if (p->opt.f64) flt[d][i] = x[d];
            else ((float *)flt[d])[i] = (float)x[d];
    for (int s = 0; s < SLT_IN_VARYING; s++) args.in[s] = zero;
    for (int d = 0; d < 3; d++) args.in[IN_X0 + d] = flt[d];
    args.in[IN_RAND0] = flt[3];
    for (uint32_t k = 0; k < p->prog->channels; k++) args.out[k] = outs[k];
    status = (SltStatus)ir_interpret(fn, &args, 1, 2);
    for (uint32_t k = 0; k < p->prog->channels; k++) {
        float narrow;
        memcpy(&narrow, outs[k], sizeof narrow);
        f[k] = p->opt.f64 ? outs[k][0] : (double)narrow;
    }
    if (status == SLT_OK && log->failed) status = status_fail(err, SLT_LIMIT, "out of memory for the trace");
    return status;
}

/* The nearest crossing along the axes. */
static void find_crossing(SltProgram *p, ExplainedPoint *out, SltError *err) {
    double lo[3], hi[3], best = INFINITY;
    slt_domain(p, lo, hi);
    for (uint32_t d = 0; d < out->dim && slt_site_count(p); d++)
        for (int side = -1; side <= 1; side += 2) {
            double end[3] = {out->x[0], out->x[1], out->x[2]};
            end[d] += side * (hi[d] - lo[d]) / 8;
            if (end[d] < lo[d]) end[d] = lo[d];
            if (end[d] > hi[d]) end[d] = hi[d];
            SltCrossing t = SLT_CROSSING_INIT;
            if (end[d] == out->x[d] || slt_crossing(p, NULL, out->x, end, 0, &t, err) != SLT_OK || !t.found) continue;
            double distance = fabs(t.x[d] - out->x[d]);
            if (distance < best) best = distance, out->crossing = t, out->axis = d;
        }
}

SltStatus explain_point(SltProgram *p, Fn **traced, const double x[3], ExplainedPoint *out, SltError *err) {
    *out = (ExplainedPoint){.dim = slt_dim(p), .channels = slt_channels(p), .crossing = SLT_CROSSING_INIT};
    memcpy(out->x, x, sizeof out->x);
    TraceLog log = {0};
    if (!*traced) *traced = make_traced(p);
    SltStatus status = trace(p, *traced, x, &log, out->f, err);
    out->trace = log.at, out->ntrace = log.n;
    if (status == SLT_OK) find_crossing(p, out, err);
    else explain_free_point(out);
    return status;
}

void explain_free_point(ExplainedPoint *m) {
    free(m->trace);
    m->trace = NULL, m->ntrace = 0;
}

/* ---- what is said of it */
static void list_numbers(FILE *out, const char *key, const double *v, uint32_t n) {
    fprintf(out, "\"%s\": [", key);
    for (uint32_t k = 0; k < n; k++) fputs(k ? ", " : "", out), json_number(out, v[k]);
    fputs("]", out);
}

void explain_json_point(FILE *out, const ExplainedPoint *m) {
    fputs("{", out);
    list_numbers(out, "x", m->x, m->dim);
    fputs(", ", out);
    list_numbers(out, "f", m->f, m->channels);
    fputs(", \"trace\": [", out);
    for (uint32_t i = 0; i < m->ntrace; i++) {
        fprintf(out, "%s{\"site\": %d, \"k\": [", i ? ", " : "", m->trace[i].site);
        for (uint32_t k = 0; k < m->trace[i].loops; k++) fprintf(out, "%s%d", k ? ", " : "", m->trace[i].k[k]);
        fputs("], \"g\": ", out);
        json_number(out, m->trace[i].g);
        if (m->trace[i].is_rounding) fputs(", \"n\": ", out), json_number(out, m->trace[i].n);
        else fprintf(out, ", \"decision\": %s", m->trace[i].decision ? "true" : "false");
        fputs("}", out);
    }
    fputs("], \"crossing\": ", out);
    if (!m->crossing.found) {
        fputs("null", out);
    } else {
        fputs("{", out);
        list_numbers(out, "x", m->crossing.x, m->dim);
        fprintf(out, ", \"site\": %d, \"axis\": %u, ", m->crossing.site, m->axis);
        list_numbers(out, "before", m->crossing.f_before, m->channels);
        fputs(", ", out);
        list_numbers(out, "after", m->crossing.f_after, m->channels);
        fputs(", ", out);
        list_numbers(out, "normal", m->crossing.dg, m->dim);
        fputs("}", out);
    }
    fputs("}", out);
}

void explain_print_point(const ExplainedPoint *m) {
    printf("f(");
    for (uint32_t d = 0; d < m->dim; d++) printf("%s%.9g", d ? ", " : "", m->x[d]);
    printf(") =");
    for (uint32_t k = 0; k < m->channels; k++) printf(" %.9g", m->f[k]);
    printf("\ntrace of %u site%s\n", m->ntrace, m->ntrace == 1 ? "" : "s");
    for (uint32_t i = 0; i < m->ntrace; i++) {
        printf("  site %d", m->trace[i].site);
        for (uint32_t k = 0; k < m->trace[i].loops; k++) printf("%s%d", k ? "," : " at ", m->trace[i].k[k]);
        if (m->trace[i].is_rounding) printf("  v = %.9g  n = %.9g\n", m->trace[i].g, m->trace[i].n);
        else printf("  g = %.9g  %s\n", m->trace[i].g, m->trace[i].decision ? "true" : "false");
    }
    if (m->crossing.found) {
        printf("nearest crossing along the axes: site %d at (", m->crossing.site);
        for (uint32_t d = 0; d < m->dim; d++) printf("%s%.9g", d ? ", " : "", m->crossing.x[d]);
        printf(")\n  f before");
        for (uint32_t k = 0; k < m->channels; k++) printf(" %.9g", m->crossing.f_before[k]);
        printf("\n  f after ");
        for (uint32_t k = 0; k < m->channels; k++) printf(" %.9g", m->crossing.f_after[k]);
        printf("\n  grad g  ");
        for (uint32_t d = 0; d < m->dim; d++) printf(" %.9g", m->crossing.dg[d]);
        putchar('\n');
    } else {
        puts("no crossing within an eighth of the domain along the axes");
    }
}
