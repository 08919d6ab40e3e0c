/* saltus explain: what a program is made of, what was compiled, what was left out and why; or the story of one point;
 * or of one code. */
#include <ctype.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cli/cli.h"
#include "compiler/pass/depend.h"
#include "compiler/pass/walk.h"

static bool is_code(const char *s) {
    return s && (s[0] == 'E' || s[0] == 'W' || s[0] == 'P') && isdigit((unsigned char)s[1]) && strlen(s) == 5;
}

static int explain_code(Cli *c) {
    Severity severity;
    const char *title, *text = diag_explain(c->file, &severity, &title);
    if (!text) return cli_usage(c, "there is no diagnostic `%s`", c->file);
    const char *name = severity == SEV_ERROR ? "error" : severity == SEV_WARNING ? "warning" : "note";
    if (c->json) {
        fputs("{\"code\": ", stdout);
        json_text(stdout, c->file);
        fputs(", \"severity\": ", stdout);
        json_text(stdout, name);
        fputs(", \"title\": ", stdout);
        json_text(stdout, title);
        fputs(", \"explanation\": ", stdout);
        json_text(stdout, text);
        fputs("}\n", stdout);
    } else {
        printf("%s (%s): %s\n\n%s\n", c->file, name, title, text);
    }
    return SLT_OK;
}

static const char *site_kind_name(SiteKind k) {
    switch (k) {
    case SITE_COMPARE: return "comparison";
    case SITE_FLOOR: return "floor";
    case SITE_CEIL: return "ceil";
    case SITE_ROUND: return "round";
    case SITE_TRUNC: return "trunc";
    case SITE_FMOD: return "fmod";
    case SITE_SILHOUETTE: return "silhouette";
    case SITE_SHADOW: return "shadow";
    }
    return "?";
}

/* ---- which sites are alive: those the region kernel would see */
static void mark_sites(const Block *b, uint8_t *alive) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_site || i->op == OP_siten) alive[i->imm.i] = 1;
        for (uint32_t r = 0; r < i->nregions; r++) mark_sites(i->region[r], alive);
    }
}

typedef struct Explain {
    Cli *c;
    SltProgram *p;
    uint8_t *facts, *alive, *reach;
} Explain;

/* What a reverse kernel adds to an adjoint has a derivative. Read off the finished code: the value kernel's own
 * dependences are hidden by the bit tricks of its sines and exponentials. */
static void add_reach(Explain *e, const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) add_reach(e, i->region[r]);
        if (i->op != OP_adj) continue;
        bool fixed = i->args[0]->op == OP_consti;
        uint32_t base = i->imm.slot.base, count = i->imm.slot.count, at = fixed ? (uint32_t)i->args[0]->imm.i : 0;
        for (uint32_t k = 0; k < count; k++)
            if ((!fixed || k == at) && base + k < e->p->prog->nfloats) e->reach[base + k] = 1;
    }
}

static const char *why_no_gradient(const Explain *e, const Param *q) {
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

static const char *left_out(const Explain *e, int kind) {
    bool jumps = false;
    for (uint32_t s = 0; s < e->p->prog->primal->nsites; s++) jumps |= e->alive[s] != 0;
    bool boundary = kind == K_REGION || kind == K_EVENT || kind == K_SIDES || kind == K_SITE || kind == K_SITE_GRAD ||
                    kind == K_SITE_JVP || kind == K_SITE_VJP;
    if (boundary && !jumps) return "no discontinuity reaches the output";
    if (boundary && !e->p->fn[K_REGION] && !e->c->job.no_boundary)
        return "no boundary moves with what is differentiated";
    if (kind == K_SITE && e->p->fn[K_SITE_GRAD]) return "served by site_grad: there are many sites";
    if (boundary && e->c->job.no_boundary) return "--interior-only";
    if (!boundary && kind != K_VALUE && e->c->job.no_interior) return "--boundary-only";
    return "not needed";
}

/* ---- geometries: what is searched, by which kernels, and what for */

static uint32_t geometry_queries(const SltProgram *p, uint32_t f) {
    uint32_t queries = 0;
    for (int k = 0; k < K_KINDS; k++) queries |= api_geometry_queries(p->fn[k], f);
    for (uint32_t c = 0; c < p->prog->ncull; c++) queries |= api_geometry_queries(p->prog->cull_bounds[c], f);
    return queries;
}

/* By geometries of this kind. */
static uint32_t answered(const GeometryInfo *info) {
    uint32_t queries = 0;
    for (int w = 0; w < SLT_QUERIES; w++)
        if (query_rows[w].geometries >> info->kind & 1) queries |= 1u << w;
    return queries;
}

static void list_queries(uint32_t queries, bool json) {
    bool first = true;
    for (int w = 0; w < SLT_QUERIES; w++) {
        if (!(queries >> w & 1)) continue;
        printf(json ? "%s\"%s\"" : "%s%s", first ? "" : ", ", query_rows[w].name);
        first = false;
    }
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

static void print_geometries(const SltProgram *p) {
    const Program *g = p->prog;
    for (uint32_t f = 0; f < g->ngeometries; f++) {
        const GeometryInfo *info = &g->geometries[f];
        if (!geometry_queries(p, f) || !p->geometries[f]) continue;
        size_t bytes = geometry_bytes(p->geometries[f]);
        printf("  %s, %u x %u numbers: %s\n    %zu bytes, %.2f a number; asked: ", g->params[info->param].name,
               info->size[0], info->size[1], geometry_describe(p->geometries[f]), bytes, (double)bytes / info->count);
        list_queries(geometry_queries(p, f), false);
        putchar('\n');
        for (int k = 0; k < K_KINDS; k++) {
            uint32_t queries = api_geometry_queries(p->fn[k], f);
            if (!queries) continue;
            printf("      %-10s ", kernel_names[k]);
            list_queries(queries, false);
            putchar('\n');
        }
    }
}

static void print_geometries_left_out(const SltProgram *p) {
    const Program *g = p->prog;
    bool any = false;
    for (uint32_t i = 0; i < g->nparams; i++) {
        const char *why = no_structure(p, i);
        if (why) printf("  structure of %s: %s\n", g->params[i].name, why);
        any |= g->params[i].is_geometry;
    }
    if (!any) puts("  structures for rays: there is no geometry");
    for (uint32_t f = 0; f < g->ngeometries; f++) {
        uint32_t queries = geometry_queries(p, f);
        for (int w = 0; queries && w < SLT_QUERIES; w++)
            if (answered(&g->geometries[f]) & ~queries & 1u << w)
                printf("  %s of %s: no kernel asks (%s would)\n", query_rows[w].name,
                       g->params[g->geometries[f].param].name, query_rows[w].asked);
    }
}

static void json_geometries(const SltProgram *p) {
    const Program *g = p->prog;
    static const char *const structures[] = {"mipmap", "mipmap", "cone", "naive"};
    bool first = true;
    fputs(", \"fields\": [", stdout);
    for (uint32_t f = 0; f < g->ngeometries; f++) {
        const GeometryInfo *info = &g->geometries[f];
        uint32_t queries = geometry_queries(p, f);
        if (!queries || !p->geometries[f]) continue;
        printf("%s{\"name\": ", first ? "" : ", ");
        json_text(stdout, g->params[info->param].name);
        printf(", \"width\": %u, \"height\": %u, \"structure\": \"%s\", \"description\": ", info->size[0],
               info->size[1], structures[p->opt.field]);
        json_text(stdout, geometry_describe(p->geometries[f]));
        printf(", \"bytes\": %zu, \"queries\": [", geometry_bytes(p->geometries[f]));
        list_queries(queries, true);
        fputs("], \"left_out\": [", stdout);
        list_queries(~queries & answered(info), true);
        fputs("], \"kernels\": {", stdout);
        first = true;
        for (int k = 0; k < K_KINDS; k++) {
            if (!api_geometry_queries(p->fn[k], f)) continue;
            printf("%s\"%s\": [", first ? "" : ", ", kernel_names[k]);
            list_queries(api_geometry_queries(p->fn[k], f), true);
            fputs("]", stdout);
            first = false;
        }
        fputs("}}", stdout);
        first = false;
    }
    fputs("]", stdout);
}

static void print_sites(const Explain *e) {
    const Fn *primal = e->p->prog->primal;
    printf("sites (%u)\n", primal->nsites);
    for (uint32_t s = 0; s < primal->nsites; s++) {
        const SiteInfo *i = &primal->sites[s];
        uint32_t line = 0, column = 0;
        span_position(e->p->session, i->span, &line, &column);
        printf("  %3u  %s:%u:%u  %-11s %s  in %s, at most %llu event%s%s%s%s\n", s,
               i->span.file >= 0 ? e->p->session->sources[i->span.file].path : "?", line, column,
               site_kind_name(i->kind), i->text ? i->text : "", i->path ? i->path : "",
               (unsigned long long)i->max_events, i->max_events == 1 ? "" : "s", i->skip_loop ? ", [SkipLoop]" : "",
               e->alive[s] ? "" : ", reaches no output: left out",
               e->facts[s] & DEPENDS_X ? "" : ", static: does not depend on x");
    }
}

static void print_kernels(const Explain *e) {
    SltProgram *p = e->p;
    printf("\nkernels (%u lanes of %s)\n  %-10s %10s %14s\n", p->scene.width, p->opt.f64 ? "f64" : "f32", "", "IR",
           "LLVM");
    for (int k = 0; k < K_KINDS; k++) {
        if (!p->fn[k]) continue;
        printf("  %-10s %10u %14u\n", kernel_names[k], walk_fn_size(p->fn[k]),
               p->module_of[k] ? back_instructions(p->module_of[k], kernel_names[k]) : 0);
    }
    for (int k = 0; k < K_KINDS; k++)
        if (p->fn[k] && p->tape[k].text && p->tape[k].text[0])
            printf("\ntape of %s: at most %llu bytes a lane\n%s\n", kernel_names[k],
                   (unsigned long long)p->tape[k].bytes_per_lane, p->tape[k].text);
}

static void explain_text(const Explain *e) {
    SltProgram *p = e->p;
    Program *g = p->prog;
    printf("%s: %uD, %u channel%s, %u float and %u integer parameter components\n\n", g->entry, g->dim, g->channels,
           g->channels == 1 ? "" : "s", g->nfloats, g->nints);
    print_sites(e);
    printf("\nevents bound\n  at most %llu in one sample; near-miss probe %s\n", (unsigned long long)api_event_bound(p),
           p->scene.near_miss ? "on" : "off");
    print_kernels(e);
    printf("\nparameters without a gradient\n");
    bool any = false;
    for (uint32_t i = 0; i < g->nparams; i++) {
        const char *why = why_no_gradient(e, &g->params[i]);
        if (why) printf("  %s: %s\n", g->params[i].name, why), any = true;
    }
    if (!any) puts("  none");
    printf("\nstructures built\n");
    uint32_t built = g->ncull;
    for (uint32_t f = 0; f < g->ngeometries; f++) built += p->geometries[f] && geometry_queries(p, f);
    if (g->ncull) printf("  cull lists of %u loop%s: [Cull]\n", g->ncull, g->ncull == 1 ? "" : "s");
    print_geometries(p);
    if (!built) puts("  none");
    printf("\nleft out\n");
    for (int k = 0; k < K_KINDS; k++)
        if (!p->fn[k]) printf("  kernel %s: %s\n", kernel_names[k], left_out(e, k));
    print_geometries_left_out(p);
    if (!g->ncull) puts("  cull grid: no [Cull] loop");
    if (!g->uses_rand) puts("  random streams: rand() is not called");
    printf("\ntime to compile: front end %.1f ms, passes %.1f ms, LLVM %.1f ms%s\n", p->ms_front, p->ms_passes,
           p->ms_llvm, p->cached ? " (cached)" : "");
}

static void explain_json(const Explain *e) {
    SltProgram *p = e->p;
    Program *g = p->prog;
    const Fn *primal = g->primal;
    printf("{\"entry\": ");
    json_text(stdout, g->entry);
    printf(", \"dim\": %u, \"channels\": %u, \"sites\": [", g->dim, g->channels);
    for (uint32_t s = 0; s < primal->nsites; s++) {
        const SiteInfo *i = &primal->sites[s];
        uint32_t line = 0, column = 0;
        span_position(p->session, i->span, &line, &column);
        printf("%s{\"id\": %u, \"kind\": \"%s\", \"file\": ", s ? ", " : "", s, site_kind_name(i->kind));
        json_text(stdout, i->span.file >= 0 ? p->session->sources[i->span.file].path : "");
        printf(", \"line\": %u, \"column\": %u, \"path\": ", line, column);
        json_text(stdout, i->path);
        printf(", \"text\": ");
        json_text(stdout, i->text);
        printf(", \"max_events\": %llu, \"skip_loop\": %s, \"live\": %s, \"static\": %s}",
               (unsigned long long)i->max_events, i->skip_loop ? "true" : "false", e->alive[s] ? "true" : "false",
               e->facts[s] & DEPENDS_X ? "false" : "true");
    }
    printf("], \"events_bound\": %llu, \"near_miss\": %s, \"kernels\": {", (unsigned long long)api_event_bound(p),
           p->scene.near_miss ? "true" : "false");
    bool first = true;
    for (int k = 0; k < K_KINDS; k++) {
        if (!p->fn[k]) continue;
        printf("%s\"%s\": {\"ops\": %u, \"instructions\": %u, \"tape_bytes\": %llu}", first ? "" : ", ",
               kernel_names[k], walk_fn_size(p->fn[k]),
               p->module_of[k] ? back_instructions(p->module_of[k], kernel_names[k]) : 0,
               (unsigned long long)p->tape[k].bytes_per_lane);
        first = false;
    }
    fputs("}, \"no_gradient\": {", stdout);
    first = true;
    for (uint32_t i = 0; i < g->nparams; i++) {
        const char *why = why_no_gradient(e, &g->params[i]);
        if (!why) continue;
        if (!first) fputs(", ", stdout);
        first = false;
        json_text(stdout, g->params[i].name);
        fputs(": ", stdout);
        json_text(stdout, why);
    }
    printf("}, \"structures\": {\"cull_lists\": %u", g->ncull);
    json_geometries(p);
    fputs("}, \"left_out\": {", stdout);
    first = true;
    for (uint32_t i = 0; i < g->nparams; i++) {
        const char *why = no_structure(p, i);
        if (!why) continue;
        char key[300];
        snprintf(key, sizeof key, "structure of %.280s", g->params[i].name);
        if (!first) fputs(", ", stdout);
        first = false;
        json_text(stdout, key);
        fputs(": ", stdout);
        json_text(stdout, why);
    }
    for (int k = 0; k < K_KINDS; k++) {
        if (p->fn[k]) continue;
        printf("%s\"%s\": ", first ? "" : ", ", kernel_names[k]);
        json_text(stdout, left_out(e, k));
        first = false;
    }
    printf("}, \"width\": %u, \"compile_ms\": {\"front\": %.3f, \"passes\": %.3f, \"llvm\": %.3f}, \"cached\": %s, ",
           p->scene.width, p->ms_front, p->ms_passes, p->ms_llvm, p->cached ? "true" : "false");
    report_warnings_json(stdout, p);
    fputs("}\n", stdout);
}

/* ---- one point's story */
static void list_numbers(const char *key, const double *v, uint32_t n) {
    printf("\"%s\": [", key);
    for (uint32_t k = 0; k < n; k++) fputs(k ? ", " : "", stdout), json_number(stdout, v[k]);
    fputs("]", stdout);
}

typedef struct SiteLog {
    int32_t site, k[SLT_MAX_K];
    uint32_t depth;
    double g;
    bool decision, integer;
    double n;
} SiteLog;
typedef struct TraceLog {
    SiteLog *at;
    uint32_t n, cap;
} TraceLog;

/* The interpreter tells every site that it executes through print: the trace Fn prints (site, decision, g, k..). */
static void on_trace(void *user, const char *text, uint32_t len, const double *v, uint32_t n, uint32_t lane) {
    TraceLog *log = user;
    (void)len;
    if (lane != 0 || n < 3 || (text[0] != 's' && text[0] != 'n')) return;
    if (log->n == log->cap) {
        uint32_t cap = log->cap ? log->cap * 2 : 64;
        SiteLog *more = realloc(log->at, cap * sizeof *more);
        if (!more) return;
        log->at = more, log->cap = cap;
    }
    SiteLog *s = &log->at[log->n++];
    *s = (SiteLog){
        .site = (int32_t)v[0], .g = v[2], .decision = v[1] != 0, .integer = text[0] == 'n', .n = v[1], .depth = n - 3};
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

static int trace(SltProgram *p, const double x[3], TraceLog *log, double f[4]) {
    Fn *fn = ir_clone(p->prog->primal, &p->session->module, "trace");
    lower_custom(&p->passes, fn);
    trace_sites(fn, fn->body);
    lower_rand(&p->passes, fn);
    lower_math(&p->passes, fn);
    enum { N = 64 };
    static _Alignas(64) double flt[4][N];
    static _Alignas(64) double outs[4][N];
    static _Alignas(64) int32_t zero[N];
    SltError err = {0};
    api_geometries_want(p, fn);
    SltStatus geometries = api_geometries(p, &err);
    if (geometries != SLT_OK) return geometries;
    SltKernelArgs args = {.params = p->flt,
                          .iparams = p->ints,
                          .print = on_trace,
                          .user = log,
                          .n_valid = 1,
                          .geometries = p->geometries};
    memset(flt, 0, sizeof flt);
    for (int i = 0; i < N; i++)
        for (int d = 0; d < 3; d++)
            if (p->opt.f64) flt[d][i] = x[d];
            else ((float *)flt[d])[i] = (float)x[d];
    for (int s = 0; s < SLT_IN_VARYING; s++) args.in[s] = zero;
    for (int d = 0; d < 3; d++) args.in[IN_X0 + d] = flt[d];
    args.in[IN_RAND0] = flt[3];
    for (uint32_t k = 0; k < p->prog->channels; k++) args.out[k] = outs[k];
    int status = ir_interpret(fn, &args, 1, 2);
    for (uint32_t k = 0; k < p->prog->channels; k++) {
        float narrow;
        memcpy(&narrow, outs[k], sizeof narrow);
        f[k] = p->opt.f64 ? outs[k][0] : (double)narrow;
    }
    return status;
}

static int explain_at(Cli *c, SltProgram *p) {
    double x[3] = {0}, f[4] = {0}, lo[3], hi[3];
    uint32_t dim = slt_dim(p), n = 0;
    const char *s = c->at;
    for (char *end; n < 3; n++, s = end + 1) {
        x[n] = strtod(s, &end);
        if (end == s) return cli_usage(c, "--at wants %u numbers with commas, not `%s`", dim, c->at);
        if (*end != ',') {
            n++;
            if (*end) return cli_usage(c, "--at wants %u numbers with commas, not `%s`", dim, c->at);
            break;
        }
    }
    if (n != dim) return cli_usage(c, "--at wants %u number%s for this domain", dim, dim == 1 ? "" : "s");
    TraceLog log = {0};
    int status = trace(p, x, &log, f);
    if (status != SLT_OK) {
        free(log.at);
        fputs("saltus: the point could not be traced\n", stderr);
        return status;
    }
    slt_domain(p, lo, hi);
    SltCrossing cross = {0};
    SltError err = {0};
    uint32_t axis = 0;
    /* The nearest crossing along the axes, on segments of an eighth of the domain to both sides. */
    double best = INFINITY;
    for (uint32_t d = 0; d < dim && slt_site_count(p); d++)
        for (int side = -1; side <= 1; side += 2) {
            double end[3] = {x[0], x[1], x[2]};
            end[d] += side * (hi[d] - lo[d]) / 8;
            if (end[d] < lo[d]) end[d] = lo[d];
            if (end[d] > hi[d]) end[d] = hi[d];
            SltCrossing t;
            if (end[d] == x[d] || slt_crossing(p, x, end, 0, &t, &err) != SLT_OK || !t.found) continue;
            double dist = fabs(t.x[d] - x[d]);
            if (dist < best) best = dist, cross = t, axis = d;
        }
    if (c->json) {
        fputs("{", stdout);
        list_numbers("x", x, dim);
        fputs(", ", stdout);
        list_numbers("f", f, slt_channels(p));
        fputs(", \"trace\": [", stdout);
        for (uint32_t i = 0; i < log.n; i++) {
            printf("%s{\"site\": %d, \"k\": [", i ? ", " : "", log.at[i].site);
            for (uint32_t k = 0; k < log.at[i].depth; k++) printf("%s%d", k ? ", " : "", log.at[i].k[k]);
            printf("], \"g\": ");
            json_number(stdout, log.at[i].g);
            if (log.at[i].integer) printf(", \"n\": "), json_number(stdout, log.at[i].n);
            else printf(", \"decision\": %s", log.at[i].decision ? "true" : "false");
            fputs("}", stdout);
        }
        fputs("], \"crossing\": ", stdout);
        if (!cross.found) {
            fputs("null", stdout);
        } else {
            fputs("{", stdout);
            list_numbers("x", cross.x, dim);
            printf(", \"site\": %d, \"axis\": %u, ", cross.site, axis);
            list_numbers("before", cross.f_before, slt_channels(p));
            fputs(", ", stdout);
            list_numbers("after", cross.f_after, slt_channels(p));
            fputs(", ", stdout);
            list_numbers("normal", cross.dg, dim);
            fputs("}", stdout);
        }
        fputs("}\n", stdout);
    } else {
        printf("f(");
        for (uint32_t d = 0; d < dim; d++) printf("%s%.9g", d ? ", " : "", x[d]);
        printf(") =");
        for (uint32_t k = 0; k < slt_channels(p); k++) printf(" %.9g", f[k]);
        printf("\ntrace of %u site%s\n", log.n, log.n == 1 ? "" : "s");
        for (uint32_t i = 0; i < log.n; i++) {
            printf("  site %d", log.at[i].site);
            for (uint32_t k = 0; k < log.at[i].depth; k++) printf("%s%d", k ? "," : " at ", log.at[i].k[k]);
            if (log.at[i].integer) printf("  v = %.9g  n = %.9g\n", log.at[i].g, log.at[i].n);
            else printf("  g = %.9g  %s\n", log.at[i].g, log.at[i].decision ? "true" : "false");
        }
        if (cross.found) {
            printf("nearest crossing along the axes: site %d at (", cross.site);
            for (uint32_t d = 0; d < dim; d++) printf("%s%.9g", d ? ", " : "", cross.x[d]);
            printf(")\n  f before");
            for (uint32_t k = 0; k < slt_channels(p); k++) printf(" %.9g", cross.f_before[k]);
            printf("\n  f after ");
            for (uint32_t k = 0; k < slt_channels(p); k++) printf(" %.9g", cross.f_after[k]);
            printf("\n  grad g  ");
            for (uint32_t d = 0; d < dim; d++) printf(" %.9g", cross.dg[d]);
            putchar('\n');
        } else {
            puts("no crossing within an eighth of the domain along the axes");
        }
    }
    free(log.at);
    return SLT_OK;
}

static int explain(Cli *c, SltProgram *p) {
    SltError err = {0};
    const Fn *primal = p->prog->primal;
    Explain e = {.c = c, .p = p};
    e.facts = calloc(primal->nsites + 1, 1);
    e.alive = calloc(primal->nsites + 1, 1);
    e.reach = calloc(p->prog->nfloats + 1, 1);
    bool needs[K_KINDS] = {[K_VALUE] = true, [K_VJP] = !c->job.no_interior};
    if (!c->job.no_boundary)
        needs[K_REGION] = needs[K_EVENT] = needs[K_SIDES] = needs[K_SITE] = needs[K_SITE_GRAD] = needs[K_SITE_VJP] =
            true;
    int status = e.facts && e.alive && e.reach ? (int)api_kernels(p, needs, &err) : SLT_LIMIT;
    if (status == SLT_OK) {
        depend_sites(p->prog->primal, NULL, e.facts);
        mark_sites(primal->body, e.alive);
        if (p->fn[K_VJP]) add_reach(&e, p->fn[K_VJP]->body);
        for (const Fn *part = p->fn[K_SITE_VJP]; part; part = part->next_part) add_reach(&e, part->body);
        if (c->json) explain_json(&e);
        else explain_text(&e);
    } else {
        cli_fail(c, &err);
    }
    free(e.facts);
    free(e.alive);
    free(e.reach);
    return status;
}

int verb_explain(Cli *c) {
    if (is_code(c->file)) return explain_code(c);
    SltProgram *p;
    int status = cli_compile(c, &p);
    if (status == SLT_OK) status = c->at ? explain_at(c, p) : explain(c, p);
    slt_program_free(p);
    return status;
}
