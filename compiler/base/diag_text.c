/* Diagnostics for people:
 *
 *     disc.salt:3:15: error: expected an expression before `;` [E0002]
 *         3 |     float x = ;
 *           |               ^
 *     disc.salt:1:1: note: …
 */
#include "compiler/base/session.h"

#include <stdlib.h>
#include <string.h>

#include "compiler/base/base_internal.h"

enum { EXCERPT_COLUMNS = 120, TAB = 4, LEAD = 60 };

typedef struct Colours {
    const char *bold, *error, *warning, *perf, *note, *caret, *off;
} Colours;
static const Colours plain = {"", "", "", "", "", "", ""};
static const Colours ansi = {"\033[1m",    "\033[1;31m", "\033[1;35m", "\033[1;34m",
                             "\033[1;36m", "\033[1;32m", "\033[0m"};

static void put_code(FILE *out, uint32_t code) {
    char bytes[4];
    int n = utf8_encode(utf8_unprintable(code) ? 0xFFFD : code, bytes);
    fwrite(bytes, 1, (size_t)n, out);
}

/* Messages may quote the source; what a terminal would obey is replaced. */
static void put_text(FILE *out, const char *text) {
    size_t len = strlen(text);
    for (size_t i = 0; i < len;) {
        uint32_t code;
        i += utf8_decode(text + i, len - i, &code);
        if (code == '\n') fputc('\n', out);
        else put_code(out, code);
    }
}

/* The columns that the code point at `at` takes on the screen, at screen column `col` from the start of the excerpt. */
static int cell_width(uint32_t code, int col) {
    if (code == '\t') return TAB - col % TAB;
    return utf8_unprintable(code) ? 1 : utf8_width(code);
}

static int width_between(const Source *src, uint32_t from, uint32_t to) {
    int col = 0;
    while (from < to) {
        uint32_t code;
        from += utf8_decode(src->text + from, src->len - from, &code);
        col += cell_width(code, col);
    }
    return col;
}

/* A line of the source, cut around the span, and carets under it. Walks only the window, however long the line is. */
static void put_excerpt(FILE *out, const Source *src, Span span, const Colours *c) {
    span.pos = source_shown(src, span.pos);
    uint32_t line = source_line(src, span.pos);
    uint32_t start = source_line_start(src, line), end = source_line_end(src, line);
    uint32_t pos = span.pos < start ? start : span.pos > end ? end : span.pos;
    /* Far from the start of the line: begin LEAD code points before the span, on a code point. */
    uint32_t from = start;
    if (pos - start > LEAD) {
        uint32_t back = pos;
        for (int i = 0; i < LEAD && back > start; i++) {
            uint32_t first = back;
            do back--;
            while (back > start && ((unsigned char)src->text[back] & 0xC0) == 0x80 && first - back < 4);
        }
        /* A short line is shown whole. */
        if (back - start > 0 && end - start > EXCERPT_COLUMNS) from = back;
    }
    /* Tabs and wide characters: the caret has to stay inside the excerpt. */
    while (pos - from <= 4 * LEAD && width_between(src, from, pos) > EXCERPT_COLUMNS - 20) {
        uint32_t code;
        from += utf8_decode(src->text + from, src->len - from, &code);
    }
    bool cut_left = from > start;
    fprintf(out, "%5u | %s", line + 1 - src->lead, cut_left ? "…" : "");
    int col = 0, caret = -1, carets = 0;
    uint32_t at = from;
    uint64_t span_end = (uint64_t)span.pos + (span.len ? span.len : 1);
    while (at < end) {
        uint32_t code, n = utf8_decode(src->text + at, src->len - at, &code);
        int w = cell_width(code, col);
        if (col + w > EXCERPT_COLUMNS) break;
        if (at + n > pos && at < span_end) {
            if (caret < 0) caret = col;
            carets = col + w - caret;
        }
        if (code == '\t') fprintf(out, "%*s", w, "");
        else put_code(out, code);
        col += w;
        at += n;
    }
    fprintf(out, "%s\n", at < end ? "…" : "");
    if (caret < 0) caret = col;
    fprintf(out, "      | %*s%s", caret + cut_left, "", c->caret);
    for (int i = 0; i < (carets > 0 ? carets : 1); i++) fputc('^', out);
    fprintf(out, "%s\n", c->off);
}

static void put_message(const Session *s, FILE *out, Span span, const char *colour, const char *kind, const char *text,
                        const char *code, const Colours *c) {
    const Source *src = span.file >= 0 && (uint32_t)span.file < s->nsources ? &s->sources[span.file] : NULL;
    fputs(c->bold, out);
    if (src) {
        uint32_t line, column;
        span_position(s, span, &line, &column);
        put_text(out, src->path);
        fprintf(out, ":%u:%u: ", line, column);
    }
    fprintf(out, "%s%s%s:%s ", c->off, colour, kind, c->off);
    put_text(out, text);
    if (code) fprintf(out, " [%s]", code);
    fputc('\n', out);
    if (src) put_excerpt(out, src, span, c);
}

void diag_print_text(const Session *s, FILE *out, bool colour) {
    const Colours *c = colour ? &ansi : &plain;
    static const char *const kinds[] = {"error", "warning", "performance", "note"};
    const char *const colours[] = {c->error, c->warning, c->perf, c->note};
    uint32_t n, errors = 0, others = 0, hidden_errors = 0, hidden_others = 0;
    Diag **list = diag_sorted(s, &n);
    for (uint32_t i = 0; i < n; i++) {
        const Diag *d = list[i];
        bool error = d->severity == SEV_ERROR;
        uint32_t *count = error ? &errors : &others;
        if (s->max_errors && *count == s->max_errors) {
            ++*(error ? &hidden_errors : &hidden_others);
            continue;
        }
        ++*count;
        put_message(s, out, d->span, colours[d->severity], kinds[d->severity], d->text, diag_code_name(d->code), c);
        for (const DiagNote *note = d->notes; note; note = note->next)
            put_message(s, out, note->span, c->note, "note", note->text, NULL, c);
    }
    free(list);
    if (hidden_errors) fprintf(out, "%u more error%s\n", hidden_errors, hidden_errors == 1 ? "" : "s");
    if (hidden_others) fprintf(out, "%u more warning%s\n", hidden_others, hidden_others == 1 ? "" : "s");
}
