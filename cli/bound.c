/* saltus bound: what is proven of one box, for people and for programs. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cli/cli.h"

/* "0.1,0.2;0.3,0.4": two numbers for each of `dim` axes. False if that is not it. */
static bool parse_box(const char *s, uint32_t dim, double lo[3], double hi[3]) {
    for (uint32_t d = 0; d < dim; d++) {
        char *end;
        lo[d] = strtod(s, &end);
        if (end == s || *end != ',') return false;
        hi[d] = strtod(s = end + 1, &end);
        if (end == s || *end != (d + 1 < dim ? ';' : 0)) return false;
        s = end + 1;
    }
    return true;
}

static void json_ends(const double v[2]) {
    for (int i = 0; i < 2; i++) {
        fputs(i ? ", " : "[", stdout);
        json_number(stdout, isfinite(v[i]) ? v[i] : NAN);
    }
    fputc(']', stdout);
}

static void json_open(const SltOpenEvent *e, uint32_t dim) {
    printf("{\"site\": %d, \"seam\": %s, \"kind\": ", e->edge, e->seam ? "true" : "false");
    json_text(stdout, e->kind);
    fputs(", \"file\": ", stdout);
    json_text(stdout, e->file);
    printf(", \"line\": %u, \"column\": %u, \"text\": ", e->line, e->column);
    json_text(stdout, e->text);
    fputs(", \"index\": [", stdout);
    for (uint32_t k = 0; k < e->loops; k++) printf("%s%d", k ? ", " : "", e->k[k]);
    fputs("], \"g\": ", stdout);
    json_ends(e->g);
    fputs(", \"dg\": [", stdout);
    for (uint32_t d = 0; d < dim; d++) fputs(d ? ", " : "", stdout), json_ends(e->dg[d]);
    printf("], \"jumps\": %s, \"bends\": %s", e->jumps ? "true" : "false", e->bends ? "true" : "false");
    if (strcmp(e->kind, "compare") != 0) fputs(", \"boundary\": ", stdout), json_ends(e->boundary);
    fputc('}', stdout);
}

static void json_bound(const SltBound *b, SltProgram *p) {
    printf("{\"settled\": %s, \"unknown\": %s, \"rough\": %s, \"count\": %u, \"open\": [",
           b->settled ? "true" : "false", b->unknown ? "true" : "false", b->rough ? "true" : "false", b->count);
    for (uint32_t e = 0; e < b->listed; e++) fputs(e ? ", " : "", stdout), json_open(&b->open[e], slt_dim(p));
    fputs("], \"channels\": [", stdout);
    for (uint32_t c = 0; c < slt_channels(p); c++) {
        fputs(c ? ", " : "", stdout);
        json_ends((double[]){b->lo[c], b->hi[c]});
    }
    fputs("], ", stdout);
    report_warnings_json(stdout, p, NULL);
    fputs("}\n", stdout);
}

static void print_open(const SltOpenEvent *e) {
    printf("%s: %s:%u:%u", e->seam ? "seam" : "open", *e->file ? e->file : "?", e->line, e->column);
    if (*e->text) printf(" %s", e->text);
    for (uint32_t k = 0; k < e->loops; k++) printf("%s%d", k ? "," : ", iteration ", e->k[k]);
    if (e->boundary[0] < e->boundary[1]) printf(", boundaries %.9g to %.9g", e->boundary[0], e->boundary[1]);
    else if (strcmp(e->kind, "compare") != 0) printf(", boundary %.9g", e->boundary[0]);
    printf(", g in [%.6g, %.6g]", e->g[0], e->g[1]);
    if (e->jumps) fputs(", which may jump itself", stdout);
    else if (e->bends) fputs(", with a kink", stdout);
    putchar('\n');
}

static void print_bound(const SltBound *b, uint32_t channels) {
    if (b->settled) puts("settled: nothing jumps or bends here");
    for (uint32_t e = 0; e < b->listed; e++) print_open(&b->open[e]);
    if (b->count > b->listed) printf("... %u events in all may decide either way\n", b->count);
    if (b->unknown) puts("unknown: something decides here that has no boundary function or no bounds");
    if (b->rough) puts("rough: f may be not smooth where nothing decides: a root near 0, a pole");
    fputs("f in", stdout);
    for (uint32_t c = 0; c < channels; c++) printf(" [%.9g, %.9g]", b->lo[c], b->hi[c]);
    putchar('\n');
}

static int bound(Cli *c, SltProgram *p) {
    static const char *const shape[] = {"", "X0,X1", "X0,X1;Y0,Y1", "X0,X1;Y0,Y1;Z0,Z1"};
    double lo[3], hi[3];
    uint32_t dim = slt_dim(p);
    SltError err = {0};
    SltBound b = SLT_BOUND_INIT;
    slt_domain(p, lo, hi);
    if (c->box && !parse_box(c->box, dim, lo, hi))
        return cli_usage(c, "--box wants %s for this %uD domain, not `%s`", shape[dim], dim, c->box);
    SltStatus status = slt_bound(p, &c->job, 1, lo, hi, &b, &err);
    if (status != SLT_OK) return cli_fail(c, &err);
    if (c->json) json_bound(&b, p);
    else print_bound(&b, slt_channels(p));
    return SLT_OK;
}

int verb_bound(Cli *c) {
    SltProgram *p;
    int status = cli_compile(c, &p);
    if (status == SLT_OK) status = bound(c, p);
    slt_program_free(p);
    return status;
}
