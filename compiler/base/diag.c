/* Reporting: what is said, once, and where it is. Printing lives in diag_text.c and diag_json.c. */
#include "compiler/base/session.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "compiler/base/base_internal.h"

typedef struct DiagRow {
    const char *name, *code;
    Severity severity;
    const char *format, *explanation, *headline;
} DiagRow;

static const DiagRow rows[DIAG_COUNT] = {
#define DIAG(name, code, severity, format, explanation) {#name, code, severity, format, explanation, NULL},
#define DIAG_AS(name, code, severity, headline, explanation) {#name, code, severity, "%s", explanation, headline},
#include "compiler/base/diag.def"
#undef DIAG
#undef DIAG_AS
};

Diag *diag_emit(Session *s, DiagCode code, Span span, ...) {
    uint32_t key[4] = {code, (uint32_t)span.file, span.pos, span.len};
    uint32_t hash = hash_bytes(key, sizeof key), at = UINT32_MAX;
    if (span.file >= 0) {
        for (const Diag *old; (old = table_next(&s->reported, hash, &at));)
            if (old->code == code && old->span.file == span.file && old->span.pos == span.pos &&
                old->span.len == span.len) {
                /* The caller may attach its notes to a copy that nobody prints. */
                Diag *unseen = ARENA_NEW(&s->session, Diag);
                *unseen = *old;
                unseen->notes = NULL;
                unseen->next = NULL;
                return unseen;
            }
    }
    Diag *d = ARENA_NEW(&s->session, Diag);
    va_list ap;
    va_start(ap, span);
    *d = (Diag){.code = code,
                .severity = rows[code].severity,
                .span = span,
                .text = arena_vprintf(&s->session, rows[code].format, ap)};
    va_end(ap);
    if (span.file >= 0) table_insert(s, &s->reported, d, hash);
    *s->diags_end = d;
    s->diags_end = &d->next;
    if (d->severity == SEV_ERROR) s->nerrors++;
    if (d->severity == SEV_WARNING) s->nwarnings++;
    return d;
}

void diag_note(Session *s, Diag *d, Span span, const char *fmt, ...) {
    DiagNote *note = ARENA_NEW(&s->session, DiagNote);
    va_list ap;
    va_start(ap, fmt);
    *note = (DiagNote){.span = span, .text = arena_vprintf(&s->session, fmt, ap)};
    va_end(ap);
    DiagNote **end = &d->notes;
    while (*end) end = &(*end)->next;
    *end = note;
}

const char *diag_code_name(DiagCode code) { return rows[code].code; }

/* `%s` in backticks is a NAME, one that touches the word before it an addition that may be missing; numbers are N. */
static void put_title(const char *format, char *out, size_t size) {
    size_t n = 0;
    *out = 0;
    for (const char *f = format; *f; f++) {
        char one[2] = {*f, 0};
        const char *word = one;
        if (*f == '%') {
            char before = f > format ? f[-1] : ' ';
            f += 1 + strcspn(f + 1, "sudgxc%");
            word = *f == '%'                      ? "%"
                   : *f != 's'                    ? "N"
                   : before == '`' && f[1] == '`' ? "NAME"
                   : strchr(" ([=", before)       ? "..."
                                                  : "";
        }
        if (n + strlen(word) < size) n += (size_t)snprintf(out + n, size - n, "%s", word);
    }
}

const char *diag_explain(const char *code, DiagTitle *title) {
    for (int i = 0; i < DIAG_COUNT; i++) {
        if (strcasecmp(rows[i].code, code)) continue;
        title->code = rows[i].code, title->severity = rows[i].severity;
        if (rows[i].headline) snprintf(title->text, sizeof title->text, "%s", rows[i].headline);
        else put_title(rows[i].format, title->text, sizeof title->text);
        return rows[i].explanation;
    }
    return NULL;
}

/* ---- places ---- */

uint32_t source_line(const Source *src, uint32_t pos) {
    uint32_t lo = 0, hi = src->nlines;
    while (hi - lo > 1) {
        uint32_t mid = lo + (hi - lo) / 2;
        if (src->lines[mid] <= pos) lo = mid;
        else hi = mid;
    }
    return lo;
}

uint32_t source_line_start(const Source *src, uint32_t line) {
    uint32_t at = src->lines[line];
    if (at == 0 && src->len >= 3 && !memcmp(src->text, "\xEF\xBB\xBF", 3)) return 3;
    return at;
}

uint32_t source_line_end(const Source *src, uint32_t line) {
    uint32_t end = line + 1 < src->nlines ? src->lines[line + 1] : src->len, start = src->lines[line];
    while (end > start && (src->text[end - 1] == '\n' || src->text[end - 1] == '\r')) end--;
    return end;
}

uint32_t source_shown(const Source *src, uint32_t pos) {
    uint32_t end = src->shown_end ? src->shown_end : src->len, start = src->shown_end ? src->lines[src->lead] : 0;
    return pos < start ? start : pos > end ? end : pos;
}

Place place_find(const Source *src, uint32_t pos, const Place *before) {
    pos = source_shown(src, pos);
    uint32_t line = source_line(src, pos), at = source_line_start(src, line);
    Place p = {.line = line - src->lead};
    if (before && before->line == p.line && before->pos >= at && before->pos <= pos) {
        p = *before;
        at = p.pos;
    }
    while (at < pos) {
        uint32_t code, n = utf8_decode(src->text + at, src->len - at, &code);
        /* An offset inside a sequence belongs to the sequence. */
        if (at + n > pos) break;
        at += n;
        p.column++;
        p.unit += code >= 0x10000 ? 2 : 1;
    }
    p.pos = at;
    return p;
}

void span_position(const Session *s, Span span, uint32_t *line, uint32_t *column) {
    *line = *column = 0;
    if (span.file < 0 || (uint32_t)span.file >= s->nsources) return;
    Place p = place_find(&s->sources[span.file], span.pos, NULL);
    *line = p.line + 1;
    *column = p.column + 1;
}

void span_ends(const Session *s, Span span, bool utf8, SpanEnds ends[2]) {
    ends[0] = ends[1] = (SpanEnds){0};
    if (span.file < 0 || (uint32_t)span.file >= s->nsources) return;
    const Source *src = &s->sources[span.file];
    Place last = {0};
    for (int k = 0; k < 2; k++) {
        uint64_t pos = (uint64_t)span.pos + (k ? span.len : 0);
        Place p = place_find(src, pos < src->len ? (uint32_t)pos : src->len, k ? &last : NULL);
        /* a byte order mark is a character of the document, if an editor has left it there */
        uint32_t line = p.line + src->lead, mark = source_line_start(src, line) > src->lines[line];
        ends[k] = (SpanEnds){p.line, utf8 ? p.pos - src->lines[line] : p.unit + mark};
        last = p;
    }
}

typedef struct Sortable {
    Diag *diag;
    uint32_t order;
} Sortable;

static int by_place(const void *pa, const void *pb) {
    const Sortable *a = pa, *b = pb;
    if (a->diag->span.file != b->diag->span.file) return a->diag->span.file < b->diag->span.file ? -1 : 1;
    if (a->diag->span.file >= 0 && a->diag->span.pos != b->diag->span.pos)
        return a->diag->span.pos < b->diag->span.pos ? -1 : 1;
    return a->order < b->order ? -1 : a->order > b->order;
}

Diag **diag_sorted(const Session *s, uint32_t *count) {
    uint32_t n = 0;
    for (Diag *d = s->diags; d; d = d->next) n++;
    *count = n;
    if (n == 0) return NULL;
    Diag **out = malloc(n * sizeof *out);
    Sortable *items = malloc(n * sizeof *items);
    if (!out || !items) {
        free(out);
        free(items);
        *count = 0;
        return NULL;
    }
    uint32_t i = 0;
    for (Diag *d = s->diags; d; d = d->next, i++) items[i] = (Sortable){d, i};
    qsort(items, n, sizeof *items, by_place);
    for (i = 0; i < n; i++) out[i] = items[i].diag;
    free(items);
    return out;
}
