/* Warnings of what was sampled (slt_warning), as text and as JSON, and what `saltus explain` says of each. */
#include <string.h>
#include <strings.h>

#include "bindings/c/api.h"
#include "cli/cli.h"

static const SltPlace none_at;

/* The counts of these have keys of their own. */
static bool has_key(const SltWarning *w) { return !strcmp(w->code, "truncated") || !strcmp(w->code, "assert"); }

void report_warnings_json(FILE *out, SltProgram *p, const SltStats *s) { report_warnings_and(out, p, s, NULL, 0); }

void report_warnings_and(FILE *out, SltProgram *p, const SltStats *s, const ReportMore *more, size_t nmore) {
    const char *lines = slt_diagnostics_json(p);
    bool first = true;
    fputs("\"warnings\": [", out);
    while (*lines) {
        const char *end = strchr(lines, '\n');
        size_t n = end ? (size_t)(end - lines) : strlen(lines);
        if (n) fprintf(out, "%s%.*s", first ? "" : ", ", (int)n, lines);
        first = false;
        lines += n + (end != NULL);
    }
    SltWarning w = SLT_WARNING_INIT;
    for (uint32_t i = 0; slt_warning(s, i, &w); i++) {
        if (has_key(&w)) continue;
        if (!first) fputs(", ", out);
        cli_put_json(out, CLI_WARNING, w.code, &w.at, w.text);
        fputc('}', out);
        first = false;
    }
    for (size_t i = 0; i < nmore; i++) {
        if (!more[i].said) continue;
        if (!first) fputs(", ", out);
        cli_put_json(out, CLI_WARNING, more[i].code, &none_at, more[i].text);
        fputc('}', out);
        first = false;
    }
    fputc(']', out);
}

void report_place(FILE *out, const SltPlace *at) {
    if (at->file) fprintf(out, "%s:%u:%u: ", at->file, at->line, at->column);
}

void report_dropped(const Cli *c, const SltStats *s) {
    SltWarning w = SLT_WARNING_INIT;
    for (uint32_t i = 0; slt_warning(s, i, &w); i++)
        if (w.severity == CLI_ERROR) cli_say(CLI_ERROR, w.code, NULL, "%s", w.text);
        else if (c->quiet) continue;
        else if (strstr(w.text, "`saltus explain ")) cli_say(CLI_WARNING, w.code, &w.at, "%s", w.text);
        else cli_say(CLI_WARNING, w.code, &w.at, "%s (`saltus explain %s`)", w.text, w.code);
}

void report_place_json(FILE *out, const SltPlace *at) {
    if (!at->known) {
        fputs("null", out);
        return;
    }
    fputs("{\"pixel\": ", out);
    if (at->in_image) fprintf(out, "[%u, %u, %u]", at->pixel[0], at->pixel[1], at->pixel[2]);
    else fputs("null", out);
    fputs(", \"x\": ", out);
    if (at->line || !at->in_image) {
        for (int d = 0; d < 3; d++) fputs(d ? ", " : "[", out), json_number(out, at->x[d]);
        fputc(']', out);
    } else {
        fputs("null", out);
    }
    fprintf(out, ", \"line\": %u, \"column\": %u, \"text\": ", at->line, at->column);
    json_text(out, at->text ? at->text : "");
    fputc('}', out);
}

/* ---- codes */
static const struct {
    const char *name, *title, *text;
} codes[] = {
#define CODE(name, title, text) {name, title, text},
#include "bindings/c/codes.def"
#undef CODE
};

const char *sampled_explain(const char *name, const char **title, const char **text) {
    for (size_t i = 0; i < sizeof codes / sizeof *codes; i++) {
        if (strcasecmp(codes[i].name, name)) continue;
        *title = codes[i].title, *text = codes[i].text;
        return codes[i].name;
    }
    return NULL;
}
