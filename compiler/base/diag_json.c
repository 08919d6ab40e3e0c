/* Diagnostics for programs: one Language Server Protocol Diagnostic a line, with `uri`. The output is valid JSON and
 * valid UTF-8 whatever bytes the source, its path or a message hold. */
#include "compiler/base/session.h"

#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "compiler/base/base_internal.h"

static void put_string(FILE *out, const char *text) {
    size_t len = strlen(text);
    fputc('"', out);
    for (size_t i = 0; i < len;) {
        uint32_t code;
        i += utf8_decode(text + i, len - i, &code);
        if (code == '"' || code == '\\') fprintf(out, "\\%c", (int)code);
        else if (code == '\n') fputs("\\n", out);
        else if (code == '\t') fputs("\\t", out);
        else if (code < 0x20 || code == 0x7F) fprintf(out, "\\u%04x", code);
        else {
            char bytes[4];
            fwrite(bytes, 1, (size_t)utf8_encode(code, bytes), out);
        }
    }
    fputc('"', out);
}

static void put_escaped(FILE *out, const char *path) {
    for (; *path; path++)
        if (strchr("/-._~", *path) || (*path >= '0' && *path <= '9') || ((*path | 32) >= 'a' && (*path | 32) <= 'z'))
            fputc(*path, out);
        else fprintf(out, "%%%02X", (unsigned char)*path);
}

/* "-" and "<expr>" are no files; editors name such texts `untitled:`. */
void diag_put_uri(FILE *out, const char *path) {
    char full[PATH_MAX];
    fputc('"', out);
    if (!strcmp(path, "-") || path[0] == '<') {
        fputs("untitled:", out);
        put_escaped(out, path[0] == '-' ? "stdin" : path);
    } else {
        fputs("file://", out);
        if (realpath(path, full)) path = full;
        else if (path[0] != '/' && getcwd(full, sizeof full)) {
            put_escaped(out, full);
            fputc('/', out);
        }
        put_escaped(out, path);
    }
    fputc('"', out);
}

/* Prints `"uri":…,"range":…`; returns the place of the start, to count on from. */
static Place put_location(const Session *s, FILE *out, Span span, const Place *before) {
    const Source *src = span.file >= 0 && (uint32_t)span.file < s->nsources ? &s->sources[span.file] : NULL;
    Place a = {0}, b = {0};
    fputs("\"uri\":", out);
    if (src) {
        diag_put_uri(out, src->path);
        a = place_find(src, span.pos, before);
        uint64_t end = (uint64_t)span.pos + span.len;
        b = place_find(src, end < src->len ? (uint32_t)end : src->len, &a);
    } else {
        fputs("\"\"", out);
    }
    fprintf(out, ",\"range\":{\"start\":{\"line\":%u,\"character\":%u},\"end\":{\"line\":%u,\"character\":%u}}", a.line,
            a.unit, b.line, b.unit);
    return a;
}

void diag_print_json(const Session *s, FILE *out) {
    static const int severities[] = {1, 2, 3, 3};
    uint32_t n;
    Diag **list = diag_sorted(s, &n);
    Place last = {0};
    int32_t last_file = -1;
    for (uint32_t i = 0; i < n; i++) {
        const Diag *d = list[i];
        fputc('{', out);
        last = put_location(s, out, d->span, d->span.file == last_file ? &last : NULL);
        last_file = d->span.file;
        fprintf(out, ",\"severity\":%d,\"code\":\"%s\",\"source\":\"saltus\",\"message\":", severities[d->severity],
                diag_code_name(d->code));
        put_string(out, d->text);
        if (d->notes) {
            fputs(",\"relatedInformation\":[", out);
            for (const DiagNote *note = d->notes; note; note = note->next) {
                /* The protocol wants a place for every note. */
                fputs("{\"location\":{", out);
                put_location(s, out, note->span.file >= 0 ? note->span : d->span, NULL);
                fputs("},\"message\":", out);
                put_string(out, note->text);
                fprintf(out, "}%s", note->next ? "," : "");
            }
            fputc(']', out);
        }
        fputs("}\n", out);
    }
    free(list);
}
