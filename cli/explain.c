/* saltus explain: what a program is made of, what was compiled, what was left out and why; or the story of one point;
 * or of one code. Each is a model that is printed as text or as JSON. */
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cli/explain.h"

/* In lines of 120 columns, whatever the table breaks. */
static void print_wrapped(const char *text) {
    size_t column = 0;
    while (*text) {
        size_t n = strcspn(text, " \n");
        if (column && column + 1 + n > 120) putchar('\n'), column = 0;
        if (column) putchar(' '), column++;
        fwrite(text, 1, n, stdout);
        column += n;
        text += n;
        text += strspn(text, " \n");
    }
    putchar('\n');
}

static void print_code(const Cli *c, const char *code, const char *severity, const char *title, const char *text) {
    if (!c->json) {
        printf("%s (%s)%s%s\n\n", code, severity, *title ? ": " : "", title);
        print_wrapped(text);
        return;
    }
    const char *const pairs[][2] = {{"code", code}, {"severity", severity}, {"title", title}, {"explanation", text}};
    for (size_t i = 0; i < sizeof pairs / sizeof *pairs; i++) {
        printf(i ? ", \"%s\": " : "{\"%s\": ", pairs[i][0]);
        json_text(stdout, pairs[i][1]);
    }
    fputs("}\n", stdout);
}

/* E0401, in upper or lower case; or a name of codes.def, where no file is called so. */
static bool is_code(const char *s) {
    const char *title, *text;
    if (!s) return false;
    if (strlen(s) == 5 && strchr("EWPewp", s[0]) && strspn(s + 1, "0123456789") == 4) return true;
    return sampled_explain(s, &title, &text) && access(s, F_OK) != 0;
}

static int explain_code(Cli *c) {
    DiagTitle title;
    const char *words, *text = diag_explain(c->file, &title), *name;
    if (!text && (name = sampled_explain(c->file, &words, &text))) {
        print_code(c, name, "warning", words, text);
        return SLT_OK;
    }
    if (!text) return cli_usage(c, "there is no diagnostic `%s`", c->file);
    name = title.severity == SEV_ERROR ? "error" : title.severity == SEV_WARNING ? "warning" : "note";
    print_code(c, title.code, name, title.text, text);
    return SLT_OK;
}

/* ---- a program */
static void list_queries(uint32_t queries, bool json) {
    bool first = true;
    for (uint32_t q = 0; q < SLT_QUERIES; q++) {
        if (!(queries >> q & 1)) continue;
        printf(json ? "%s\"%s\"" : "%s%s", first ? "" : ", ", query_rows[q].name);
        first = false;
    }
}

static void print_sites(const Explained *m) {
    printf("sites (%u)\n", m->nsites);
    for (uint32_t s = 0; s < m->nsites; s++) {
        const ExplainedSite *i = &m->sites[s];
        printf("  %3u  %s:%u:%u  %-11s %s  in %s, at most %llu event%s%s%s%s\n", s, i->file ? i->file : "?", i->line,
               i->column, i->kind, i->text ? i->text : "", i->path ? i->path : "", (unsigned long long)i->max_events,
               i->max_events == 1 ? "" : "s", i->skip_loop ? ", [SkipLoop]" : "",
               i->is_live ? "" : ", reaches no output: left out", i->is_static ? ", static: does not depend on x" : "");
    }
}

static void print_kernels(const Explained *m) {
    printf("\nkernels (%s)\n  %-12s %8s %14s %8s\n", m->f64 ? "f64" : "f32", "", "IR", "LLVM", "lanes");
    for (int k = 0; k < K_KINDS; k++)
        if (!m->kernels[k].left_out)
            printf("  %-12s %8u %14u %8u\n", m->kernels[k].name, m->kernels[k].ops, m->kernels[k].instructions,
                   m->kernels[k].lanes);
    for (int k = 0; k < K_KINDS; k++)
        if (m->kernels[k].tape)
            printf("\ntape of %s: at most %llu bytes a lane\n%s\n", m->kernels[k].name,
                   (unsigned long long)m->kernels[k].tape_bytes, m->kernels[k].tape);
}

static void print_structures(const Explained *m) {
    printf("\nstructures built\n");
    uint32_t built = m->ncull;
    if (m->ncull) printf("  cull lists of %u loop%s: [Cull]\n", m->ncull, m->ncull == 1 ? "" : "s");
    for (uint32_t f = 0; f < m->ngeometries; f++) {
        const ExplainedGeometry *i = &m->geometries[f];
        if (!i->description) continue;
        built++;
        double numbers = i->triangles ? i->triangles : (double)i->width * i->height;
        if (i->triangles) printf("  %s, %u vertices, %u triangles: ", i->name, i->vertices, i->triangles);
        else printf("  %s, %u x %u numbers: ", i->name, i->width, i->height);
        printf("%s\n    %zu bytes, %.2f a %s; asked: ", i->description, i->bytes, (double)i->bytes / numbers,
               i->triangles ? "triangle" : "number");
        list_queries(i->queries, false);
        putchar('\n');
        for (int k = 0; k < K_KINDS; k++) {
            if (!i->by_kernel[k]) continue;
            printf("      %-10s ", m->kernels[k].name);
            list_queries(i->by_kernel[k], false);
            putchar('\n');
        }
    }
    if (!built) puts("  none");
}

static void print_place(const ExplainedPlace *at) {
    printf("  %s:%u:%u  %s%s%s\n", at->file ? at->file : "?", at->line, at->column, at->what, *at->text ? "  " : "",
           at->text);
}

static void print_bounds(const ExplainedBounds *b) {
    printf("\nbounds\n");
    if (b->boxes)
        printf(
            "  of %u equal boxes %.1f %% are settled, %.1f %% have open events alone, %.1f %% are unknown or rough\n",
            b->boxes, 100.0 * b->settled / b->boxes, 100.0 * b->open / b->boxes, 100.0 * b->unknown / b->boxes);
    if (b->nseams) puts("  seams, where f may jump or bend without [Disc]:");
    for (uint32_t i = 0; i < b->nseams; i++) printf("  "), print_place(&b->seams[i]);
    if (b->nunbounded) puts("  without bounds, so that what depends on them is open or unknown:");
    for (uint32_t i = 0; i < b->nunbounded; i++) printf("  "), print_place(&b->unbounded[i]);
    for (uint32_t i = 0; i < b->nwide; i++) print_place(&b->wide[i]);
    if (b->crowded)
        puts("  too many kinks for seams of their own, or too large a program: boxes with a kink are rough or unknown");
    if (b->chunks)
        printf("  pruned: %u chunks of operations, which run where one of %u choices needs them\n", b->chunks,
               b->choices);
    for (uint32_t i = 0; i < b->nlists; i++)
        printf("  list of a loop of %u iterations at %s:%u%s\n", b->lists[i].iterations,
               b->lists[i].at.file ? b->lists[i].at.file : "?", b->lists[i].at.line,
               b->lists[i].cull ? ": [Cull]" : "");
}

static void print_left_out(const Explained *m) {
    printf("\nleft out\n");
    for (int k = 0; k < K_KINDS; k++)
        if (m->kernels[k].left_out) printf("  kernel %s: %s\n", m->kernels[k].name, m->kernels[k].left_out);
    for (uint32_t i = 0; i < m->nno_structure; i++)
        printf("  structure of %s: %s\n", m->no_structure[i].param, m->no_structure[i].why);
    if (!m->has_geometry) puts("  structures for rays: there is no geometry");
    for (uint32_t f = 0; f < m->ngeometries; f++)
        for (uint32_t q = 0; m->geometries[f].queries && q < SLT_QUERIES; q++)
            if (m->geometries[f].not_asked >> q & 1)
                printf("  %s of %s: no kernel asks (%s would)\n", query_rows[q].name, m->geometries[f].name,
                       query_rows[q].asked);
    if (!m->ncull) puts("  cull grid: no [Cull] loop");
    if (!m->uses_rand) puts("  random streams: rand() is not called");
}

static void print_program(const Explained *m) {
    if (m->cost) {
        explain_print_cost(m->cost);
        return;
    }
    printf("%s: %uD, %u channel%s, %u float and %u integer parameter components\n", m->entry, m->dim, m->channels,
           m->channels == 1 ? "" : "s", m->nfloats, m->nints);
    puts(m->display ? "colours: for a screen; what is PNG is written and read as it is\n"
                    : "colours: linear light; a PNG gets them, and is read, through the curve of sRGB\n");
    print_sites(m);
    printf("\nevents bound\n  at most %llu in one sample; near-miss probe %s\n", (unsigned long long)m->events_bound,
           m->near_miss ? "on" : "off");
    print_kernels(m);
    printf("\nparameters without a gradient\n");
    for (uint32_t i = 0; i < m->nno_gradient; i++) printf("  %s: %s\n", m->no_gradient[i].param, m->no_gradient[i].why);
    if (!m->nno_gradient) puts("  none");
    print_bounds(&m->bounds);
    print_structures(m);
    explain_print_meshes(m);
    print_left_out(m);
    printf("\ntime to compile: front end %.1f ms, passes %.1f ms, LLVM %.1f ms%s\n", m->ms_front, m->ms_passes,
           m->ms_llvm, m->cached ? " (cached)" : "");
}

/* "key": "text", behind what came before. */
static void json_pair(bool *first, const char *key, const char *text) {
    if (!*first) fputs(", ", stdout);
    *first = false;
    json_text(stdout, key);
    fputs(": ", stdout);
    json_text(stdout, text);
}

static void json_sites(const Explained *m) {
    for (uint32_t s = 0; s < m->nsites; s++) {
        const ExplainedSite *i = &m->sites[s];
        printf("%s{\"id\": %u, \"kind\": \"%s\", \"file\": ", s ? ", " : "", s, i->kind);
        json_text(stdout, i->file ? i->file : "");
        printf(", \"line\": %u, \"column\": %u, \"path\": ", i->line, i->column);
        json_text(stdout, i->path);
        printf(", \"text\": ");
        json_text(stdout, i->text);
        printf(", \"max_events\": %llu, \"skip_loop\": %s, \"live\": %s, \"static\": %s}",
               (unsigned long long)i->max_events, i->skip_loop ? "true" : "false", i->is_live ? "true" : "false",
               i->is_static ? "true" : "false");
    }
}

static void json_kernels(const Explained *m) {
    bool first = true;
    for (int k = 0; k < K_KINDS; k++) {
        const ExplainedKernel *i = &m->kernels[k];
        if (i->left_out) continue;
        printf("%s\"%s\": {\"ops\": %u, \"instructions\": %u, \"lanes\": %u, \"tape_bytes\": %llu}", first ? "" : ", ",
               i->name, i->ops, i->instructions, i->lanes, (unsigned long long)i->tape_bytes);
        first = false;
    }
}

static void json_geometries(const Explained *m) {
    bool first = true;
    for (uint32_t f = 0; f < m->ngeometries; f++) {
        const ExplainedGeometry *i = &m->geometries[f];
        if (!i->description) continue;
        printf("%s{\"name\": ", first ? "" : ", ");
        json_text(stdout, i->name);
        if (i->triangles) printf(", \"vertices\": %u, \"triangles\": %u", i->vertices, i->triangles);
        else printf(", \"width\": %u, \"height\": %u", i->width, i->height);
        printf(", \"structure\": \"%s\", \"description\": ", i->structure);
        json_text(stdout, i->description);
        printf(", \"bytes\": %zu, \"queries\": [", i->bytes);
        list_queries(i->queries, true);
        fputs("], \"left_out\": [", stdout);
        list_queries(i->not_asked, true);
        fputs("], \"kernels\": {", stdout);
        first = true;
        for (int k = 0; k < K_KINDS; k++) {
            if (!i->by_kernel[k]) continue;
            printf("%s\"%s\": [", first ? "" : ", ", m->kernels[k].name);
            list_queries(i->by_kernel[k], true);
            fputs("]", stdout);
            first = false;
        }
        fputs("}}", stdout);
        first = false;
    }
}

static void json_places(const char *key, const ExplainedPlace *list, uint32_t n) {
    printf("\"%s\": [", key);
    for (uint32_t i = 0; i < n; i++) {
        printf("%s{\"file\": ", i ? ", " : "");
        json_text(stdout, list[i].file ? list[i].file : "");
        printf(", \"line\": %u, \"column\": %u, \"what\": ", list[i].line, list[i].column);
        json_text(stdout, list[i].what);
        fputs(", \"text\": ", stdout);
        json_text(stdout, list[i].text);
        fputs("}", stdout);
    }
    fputs("], ", stdout);
}

static void json_bounds(const ExplainedBounds *b) {
    printf("\"bounds\": {\"boxes\": %u, \"settled\": %u, \"open\": %u, \"unknown\": %u, ", b->boxes, b->settled,
           b->open, b->unknown);
    json_places("seams", b->seams, b->nseams);
    json_places("unbounded", b->unbounded, b->nunbounded);
    json_places("wide", b->wide, b->nwide);
    printf("\"crowded\": %s, \"chunks\": %u, \"choices\": %u, ", b->crowded ? "true" : "false", b->chunks, b->choices);
    fputs("\"lists\": [", stdout);
    for (uint32_t i = 0; i < b->nlists; i++)
        printf("%s{\"line\": %u, \"iterations\": %u, \"cull\": %s}", i ? ", " : "", b->lists[i].at.line,
               b->lists[i].iterations, b->lists[i].cull ? "true" : "false");
    fputs("]}, ", stdout);
}

static void json_program(const Explained *m, SltProgram *p) {
    printf("{\"entry\": ");
    json_text(stdout, m->entry);
    printf(", \"dim\": %u, \"channels\": %u, \"display\": %s, \"sites\": [", m->dim, m->channels,
           m->display ? "true" : "false");
    json_sites(m);
    printf("], \"events_bound\": %llu, \"near_miss\": %s, \"kernels\": {", (unsigned long long)m->events_bound,
           m->near_miss ? "true" : "false");
    json_kernels(m);
    fputs("}, ", stdout);
    if (m->cost) explain_json_cost(m->cost);
    fputs("\"no_gradient\": {", stdout);
    bool first = true;
    for (uint32_t i = 0; i < m->nno_gradient; i++) json_pair(&first, m->no_gradient[i].param, m->no_gradient[i].why);
    fputs("}, ", stdout);
    json_bounds(&m->bounds);
    explain_json_meshes(m);
    printf("\"structures\": {\"cull_lists\": %u, \"fields\": [", m->ncull);
    json_geometries(m);
    fputs("]}, \"left_out\": {", stdout);
    first = true;
    for (uint32_t i = 0; i < m->nno_structure; i++) {
        char key[300];
        snprintf(key, sizeof key, "structure of %.280s", m->no_structure[i].param);
        json_pair(&first, key, m->no_structure[i].why);
    }
    for (int k = 0; k < K_KINDS; k++)
        if (m->kernels[k].left_out) json_pair(&first, m->kernels[k].name, m->kernels[k].left_out);
    printf("}, \"width\": %u, \"compile_ms\": {\"front\": %.3f, \"passes\": %.3f, \"llvm\": %.3f}, \"cached\": %s, ",
           m->width, m->ms_front, m->ms_passes, m->ms_llvm, m->cached ? "true" : "false");
    report_warnings_json(stdout, p, NULL);
    fputs("}\n", stdout);
}

/* ---- a point */
static int explain_at(Cli *c, SltProgram *p) {
    double x[3] = {0};
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
    ExplainedPoint m;
    SltError err = {0};
    Fn *traced = NULL;
    int status = explain_point(p, &traced, x, &m, &err);
    if (status != SLT_OK) return cli_error(status, "the point could not be traced");
    if (c->json) {
        explain_json_point(stdout, &m);
        fputs("\n", stdout);
    } else {
        explain_print_point(&m);
    }
    explain_free_point(&m);
    return SLT_OK;
}

static int explain_all(Cli *c, SltProgram *p) {
    Explained m;
    SltError err = {0};
    SltStatus status = explain_program(c, p, &m, &err);
    if (status != SLT_OK) return cli_fail(c, &err);
    watch_commit();
    if (c->json) json_program(&m, p);
    else print_program(&m);
    return SLT_OK;
}

static int explain_tree(Cli *c, SltProgram *p) {
    SltError err = {0};
    SltStatus status = explain_cells(c, p, &err);
    return status == SLT_OK ? SLT_OK : cli_fail(c, &err);
}

typedef struct Explaining {
    Cli *c;
    SltProgram *p;
    int status;
} Explaining;

/* What is explained lies in the session's memory. */
static void explain(Session *s, void *user) {
    Explaining *e = user;
    (void)s;
    e->status = e->c->at ? explain_at(e->c, e->p) : e->c->cells ? explain_tree(e->c, e->p) : explain_all(e->c, e->p);
}

int verb_explain(Cli *c) {
    if (c->cost && (is_code(c->file) || c->at || c->cells))
        return cli_usage(c, "--cost is of a program's kernels: leave out %s",
                         c->at      ? "--at"
                         : c->cells ? "--cells"
                                    : c->file);
    if (is_code(c->file)) return explain_code(c);
    SltProgram *p;
    int status = cli_compile(c, &p);
    watch_phase("explain: compiling every kernel", -1, NULL);
    Explaining e = {c, p, SLT_OK};
    if (status == SLT_OK && (status = session_protect(p->session, explain, &e)) != SLT_OK)
        cli_error(status, "%s", p->session->unwind_text);
    else if (status == SLT_OK) status = e.status;
    slt_program_free(p);
    return status;
}
