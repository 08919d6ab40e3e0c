/* explain --cost: what every compiled kernel costs, and which lines are dear. The estimate and the counts are those of
 * compiler/back/cost.h. */
#include <stdlib.h>
#include <string.h>

#include "cli/explain.h"
#include "compiler/pass/walk.h"

enum { MOST_LINES = 10 };
static const double LEAST_SHARE = 0.005; /* what is printed as 1 % */

/* Those that run for a box, not for a sample, are measured but not ranked: a program is slow by its samples. */
static bool is_of_samples(int kind) {
    return kind != K_BOUNDS && kind != K_EDGE && kind != K_EDGE_BOUNDS && kind != K_WRITTEN_BOUNDS && kind != K_PRUNE &&
           kind != K_PRUNED;
}

static const char *width_key(WidthWhy why) {
    static const char *const keys[] = {
        [WIDTH_GIVEN] = "given",         [WIDTH_FEW] = "few_samples",     [WIDTH_MOST_CODE] = "most_code",
        [WIDTH_MUCH_CODE] = "much_code", [WIDTH_STRAIGHT] = "no_loop",    [WIDTH_NEIGHBOURS] = "neighbours",
        [WIDTH_LONG_LOOP] = "long_loop", [WIDTH_MUCH_KEPT] = "much_kept", [WIDTH_MANY_MASKS] = "many_masks",
        [WIDTH_IMAGE] = "image",         [WIDTH_CHAIN] = "chain",         [WIDTH_SHORT_LOOP] = "short_loop"};
    return keys[why];
}

static const char *width_text(Arena *a, WidthChoice c) {
    switch (c.why) {
    case WIDTH_GIVEN: return "given by --width";
    case WIDTH_FEW: return "a call has few samples";
    case WIDTH_MOST_CODE:
    case WIDTH_MUCH_CODE: return arena_printf(a, "%u operations and constants, more than %u", c.found, c.limit);
    case WIDTH_STRAIGHT: return "no loop";
    case WIDTH_NEIGHBOURS: return "it compares neighbouring samples";
    case WIDTH_LONG_LOOP:
        return arena_printf(a, "a loop of %u operations and constants, more than %u", c.found, c.limit);
    case WIDTH_MUCH_KEPT:
        return arena_printf(a, "a loop that keeps %u values, where registers hold four vectors of %u", c.found,
                            c.limit);
    case WIDTH_MANY_MASKS:
        return arena_printf(a, "a loop that four vectors would take %u masks for, where registers hold %u", c.found,
                            c.limit);
    case WIDTH_IMAGE: return "of images, whose calls are full, and no short loop";
    case WIDTH_CHAIN:
        return arena_printf(a, "of images, and iterations of a loop wait for %u quotients and roots in a row", c.found);
    case WIDTH_SHORT_LOOP:
        return arena_printf(a, "a short loop that keeps %u value%s: registers hold four vectors of %u", c.found,
                            c.found == 1 ? "" : "s", c.limit);
    }
    return "";
}

static int dearer(const void *a, const void *b) {
    const DearLine *x = a, *y = b;
    if (x->share != y->share) return x->share < y->share ? 1 : -1;
    if (x->file != y->file) return x->file < y->file ? -1 : 1;
    return (x->line > y->line) - (x->line < y->line);
}

/* A line's share is that of all kernels together, each run once for a sample. */
static void rank(const SltProgram *p, Arena *a, ExplainedCost *out) {
    uint32_t room = 0, n = 0;
    double total = 0;
    for (int k = 0; k < K_KINDS; k++) room += out->kernels[k].estimate.nlines;
    DearLine *all = ARENA_ARRAY(a, DearLine, room + 1);
    for (int k = 0; k < K_KINDS; k++) {
        const ExplainedKernelCost *c = &out->kernels[k];
        const KernelCost *e = &c->estimate;
        if (!c->compiled || !is_of_samples(k)) continue;
        total += e->cost / c->lanes;
        for (uint32_t l = 0; l < e->nlines; l++) {
            const CostLine *line = &e->lines[l];
            if (line->file < 0) continue;
            uint32_t at = 0;
            while (at < n && !(all[at].file == line->file && all[at].line == line->line)) at++;
            DearLine *d = &all[at];
            if (at == n)
                all[n++] =
                    (DearLine){.file = line->file, .line = line->line, .path = p->session->sources[line->file].path};
            if (!d->in[d->dearest] || line->cost / c->lanes > d->in[d->dearest]->cost / out->kernels[d->dearest].lanes)
                d->dearest = k;
            d->in[k] = line;
            d->share += line->cost / c->lanes;
        }
    }
    for (uint32_t i = 0; i < n; i++) all[i].share /= total > 0 ? total : 1;
    qsort(all, n, sizeof *all, dearer);
    out->lines = all;
    while (out->nlines < n && out->nlines < MOST_LINES && all[out->nlines].share >= LEAST_SHARE) out->nlines++;
}

static double share_in(const ExplainedCost *m, const DearLine *d, int kernel) {
    double cost = m->kernels[kernel].estimate.cost;
    return d->in[kernel] && cost > 0 ? d->in[kernel]->cost / cost : 0;
}

SltStatus explain_cost(SltProgram *p, ExplainedCost *out, SltError *err) {
    Arena *a = &p->session->session;
    *out = (ExplainedCost){.target = p->target.cpu};
    for (int k = 0; k < K_KINDS; k++) {
        if (!p->fn[k] || !p->module_of[k]) continue;
        ExplainedKernelCost *c = &out->kernels[k];
        KernelRequest r = {kernel_names[k], p->fn[k]};
        BackOptions o = api_compiled_with(p, k);
        const char *why = NULL;
        int status = back_listing(p->session, &r, &o, &c->listing, &why);
        if (status != SLT_OK) return status_fail(err, (SltStatus)status, "%s", why ? why : "the back end failed");
        back_estimate(p->session, &r, &o, &c->estimate);
        WidthChoice width = back_width_choice(&r, 0, &o);
        c->compiled = true;
        c->lanes = back_width(p->module_of[k], r.name);
        c->width_key = width_key(width.why);
        c->width_text = width_text(a, width);
        c->ops = walk_fn_size(p->fn[k]);
        c->instructions = back_instructions(p->module_of[k], r.name);
        c->machine_bytes = back_machine_bytes(p->module_of[k], r.name);
        c->tape_bytes = p->tape[k].bytes_per_lane;
        c->tape = p->tape[k].text && p->tape[k].text[0] ? p->tape[k].text : NULL;
    }
    rank(p, a, out);
    return SLT_OK;
}

/* ---- text */
/* "%L" of a row's text is how many lanes a vector has. */
static void print_row(const char *text, uint32_t lanes) {
    for (; *text; text++)
        if (text[0] == '%' && text[1] == 'L') printf("%u", lanes), text++;
        else putchar(*text);
}

static uint32_t vector_lanes(const ExplainedKernelCost *k) {
    return k->estimate.vectors ? k->lanes / k->estimate.vectors : k->lanes;
}

/* remedies: those that were told; NULL: none is wanted */
static void print_kinds(const uint32_t kinds[COST_KINDS], uint32_t lanes, bool *remedies) {
    for (int i = 0; i < COST_KINDS; i++) {
        if (!kinds[i]) continue;
        printf("      %u ", kinds[i]);
        print_row(kinds[i] == 1 ? back_cost_rows[i].one : back_cost_rows[i].many, lanes);
        putchar('\n');
        if (!remedies || remedies[i] || !*back_cost_rows[i].remedy) continue;
        printf("        %s\n", back_cost_rows[i].remedy);
        remedies[i] = true;
    }
}

/* A report of several lines, indented. */
static void print_report(const char *text) {
    while (*text) {
        size_t n = strcspn(text, "\n");
        printf("        %.*s\n", (int)n, text);
        text += n + (text[n] == '\n');
    }
}

static void print_kernel(const char *name, const ExplainedKernelCost *k) {
    const Listing *l = &k->listing;
    printf("  %-12s %7u %7u %9u %9u %7u %7u %6u\n", name, k->ops, k->instructions, l->instructions, k->machine_bytes,
           l->spills, l->reloads, k->lanes);
}

static void print_details(const char *name, const ExplainedKernelCost *k) {
    const Listing *l = &k->listing;
    uint32_t vectors = k->estimate.vectors;
    printf("\n  %s: %u lane%s, %u vector%s of %u: %s\n", name, k->lanes, k->lanes == 1 ? "" : "s", vectors,
           vectors == 1 ? "" : "s", vector_lanes(k), k->width_text);
    print_kinds(k->estimate.kinds, vector_lanes(k), NULL);
    if (l->divisions || l->roots || l->gathers || l->scatters)
        printf("      machine code: %u divisions, %u square roots, %u gathers, %u scatters\n", l->divisions, l->roots,
               l->gathers, l->scatters);
    for (uint32_t c = 0; c < l->ncalls; c++)
        printf("      %u call%s %s%s\n", l->calls[c].count, l->calls[c].count == 1 ? "" : "s",
               l->calls[c].name ? "of " : "into the runtime", l->calls[c].name ? l->calls[c].name : "");
    if (k->estimate.array_bytes)
        printf("      %llu bytes of local arrays\n", (unsigned long long)k->estimate.array_bytes);
    if (!k->tape) return;
    printf("      tape: at most %llu bytes a lane\n", (unsigned long long)k->tape_bytes);
    print_report(k->tape);
}

static void print_line(const ExplainedCost *m, const DearLine *d, bool *remedies) {
    const CostLine *l = d->in[d->dearest];
    bool first = true;
    printf("  %s:%u  %.0f %%:", d->path, d->line, 100 * d->share);
    for (int k = 0; k < K_KINDS; k++) {
        bool shown = k == K_VALUE || k == K_VJP || k == d->dearest;
        if (!shown || share_in(m, d, k) < LEAST_SHARE) continue;
        printf("%s %.0f %% of %s", first ? "" : ",", 100 * share_in(m, d, k), kernel_names[k]);
        first = false;
    }
    printf("\n    in %s %u operation%s", kernel_names[d->dearest], l->ops, l->ops == 1 ? "" : "s");
    if (l->times > 1) printf(", up to %llu times", (unsigned long long)l->times);
    putchar('\n');
    print_kinds(l->kinds, vector_lanes(&m->kernels[d->dearest]), remedies);
}

void explain_print_cost(const ExplainedCost *m) {
    bool remedies[COST_KINDS] = {false}; /* each is told once */
    printf("cost of kernels, for %s\n  %-12s %7s %7s %9s %9s %7s %7s %6s\n", m->target, "", "IR", "LLVM", "machine",
           "bytes", "spills", "reloads", "lanes");
    for (int k = 0; k < K_KINDS; k++)
        if (m->kernels[k].compiled) print_kernel(kernel_names[k], &m->kernels[k]);
    for (int k = 0; k < K_KINDS; k++)
        if (m->kernels[k].compiled) print_details(kernel_names[k], &m->kernels[k]);
    puts("\nlines that cost most, by an estimate: of all kernels, each run once a sample");
    for (uint32_t i = 0; i < m->nlines; i++) print_line(m, &m->lines[i], remedies);
    if (!m->nlines) puts("  none");
}

/* ---- JSON */
static void json_kinds(const uint32_t kinds[COST_KINDS]) {
    for (int i = 0; i < COST_KINDS; i++) printf(", \"%s\": %u", back_cost_rows[i].key, kinds[i]);
}

static void json_kernel(const ExplainedKernelCost *k) {
    const Listing *l = &k->listing;
    printf("{\"ops\": %u, \"llvm\": %u, \"machine\": {\"instructions\": %u, \"bytes\": %u, \"spills\": %u, "
           "\"reloads\": %u, \"divisions\": %u, \"square_roots\": %u, \"gathers\": %u, \"scatters\": %u, \"calls\": {",
           k->ops, k->instructions, l->instructions, k->machine_bytes, l->spills, l->reloads, l->divisions, l->roots,
           l->gathers, l->scatters);
    for (uint32_t c = 0; c < l->ncalls; c++) {
        if (c) fputs(", ", stdout);
        json_text(stdout, l->calls[c].name ? l->calls[c].name : "runtime");
        printf(": %u", l->calls[c].count);
    }
    printf("}}, \"lanes\": %u, \"vectors\": %u, \"width_reason\": \"%s\", \"width_text\": ", k->lanes,
           k->estimate.vectors, k->width_key);
    json_text(stdout, k->width_text);
    json_kinds(k->estimate.kinds);
    printf(", \"array_bytes\": %llu, \"tape_bytes\": %llu, \"tape\": ", (unsigned long long)k->estimate.array_bytes,
           (unsigned long long)k->tape_bytes);
    json_text(stdout, k->tape ? k->tape : "");
    fputs("}", stdout);
}

void explain_json_cost(const ExplainedCost *m) {
    bool first = true;
    printf("\"cost\": {\"target\": ");
    json_text(stdout, m->target);
    fputs(", \"kernels\": {", stdout);
    for (int k = 0; k < K_KINDS; k++) {
        if (!m->kernels[k].compiled) continue;
        printf("%s\"%s\": ", first ? "" : ", ", kernel_names[k]);
        json_kernel(&m->kernels[k]);
        first = false;
    }
    fputs("}, \"lines\": [", stdout);
    for (uint32_t i = 0; i < m->nlines; i++) {
        const DearLine *d = &m->lines[i];
        const CostLine *l = d->in[d->dearest];
        printf("%s{\"file\": ", i ? ", " : "");
        json_text(stdout, d->path);
        printf(", \"line\": %u, \"share\": ", d->line);
        json_number(stdout, d->share);
        fputs(", \"shares\": {", stdout);
        first = true;
        for (int k = 0; k < K_KINDS; k++) {
            if (!d->in[k]) continue;
            printf("%s\"%s\": ", first ? "" : ", ", kernel_names[k]);
            json_number(stdout, share_in(m, d, k));
            first = false;
        }
        printf("}, \"kernel\": \"%s\", \"ops\": %u, \"times\": %llu", kernel_names[d->dearest], l->ops,
               (unsigned long long)l->times);
        json_kinds(l->kinds);
        fputs("}", stdout);
    }
    fputs("], \"remedies\": {", stdout);
    first = true;
    for (int i = 0; i < COST_KINDS; i++) {
        if (!*back_cost_rows[i].remedy) continue;
        printf("%s\"%s\": ", first ? "" : ", ", back_cost_rows[i].key);
        json_text(stdout, back_cost_rows[i].remedy);
        first = false;
    }
    fputs("}}, ", stdout);
}
