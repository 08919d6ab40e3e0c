/* Parses a text and gives back its dump and its diagnostics as strings. Header-only. */
#ifndef SALTUS_TESTS_PARSE_FIXTURE_H
#define SALTUS_TESTS_PARSE_FIXTURE_H

#include <stdlib.h>

#include "tests/front/parse_dump.h"
#include "tests/printed.h"

typedef struct Parsed {
    Session *s;
    Module *module;
    char *dump;  /* S-expressions, one declaration a line */
    char *text;  /* diagnostics as printed, all of them */
    char *brief; /* "line:column code" of every diagnostic, in order, separated by "; " */
    int status;
} Parsed;

typedef struct ParseJob {
    const char *text;
    size_t len;
    Module *module;
} ParseJob;

static inline void parse_body(Session *s, void *arg) {
    ParseJob *job = arg;
    int file = session_add_text(s, "t.salt", NULL, job->text, job->len);
    if (file < 0) session_limit(s, "%s", s->unwind_text);
    job->module = parse_module(s, file, "t");
}

/* From the text form, so that the order printed is the order tested. */
static inline char *brief_of(const char *text) {
    char *brief = NULL;
    size_t len;
    FILE *f = open_memstream(&brief, &len);
    const char *between = "";
    for (const char *line = text; *line;) {
        const char *end = strchr(line, '\n');
        unsigned row, column;
        char kind[16];
        if (sscanf(line, "t.salt:%u:%u: %15[a-z]:", &row, &column, kind) == 3 && strcmp(kind, "note")) {
            const char *last = end;
            while (last > line && *last != '[') last--;
            fprintf(f, "%s%u:%u %.5s", between, row, column, last + 1);
            between = "; ";
        }
        line = end + 1;
    }
    fclose(f);
    return brief;
}

static inline Parsed parse_bytes(const char *text, size_t len) {
    Parsed out = {.s = session_create(0)};
    ParseJob job = {.text = text, .len = len};
    out.status = session_protect(out.s, parse_body, &job);
    out.module = job.module;
    out.s->max_errors = 0;
    size_t n;
    FILE *f = open_memstream(&out.dump, &n);
    if (job.module) dump_module(f, job.module);
    fclose(f);
    out.text = printed(out.s, print_text);
    out.brief = brief_of(out.text);
    return out;
}

static inline Parsed parse_text(const char *text) { return parse_bytes(text, strlen(text)); }

static inline void parsed_free(Parsed *p) {
    session_destroy(p->s);
    free(p->dump);
    free(p->text);
    free(p->brief);
}

#endif
