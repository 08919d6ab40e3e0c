/* Documents: uris and paths, places, edits. */
#include "cli/lsp/lsp.h"

#include <limits.h>
#include <stdlib.h>
#include <string.h>

static int hex(char c) {
    return c >= '0' && c <= '9' ? c - '0' : (c | 32) >= 'a' && (c | 32) <= 'f' ? (c | 32) - 'a' + 10 : -1;
}

char *document_path(const char *uri) {
    if (strncmp(uri, "file://", 7)) return NULL;
    const char *at = strchr(uri + 7, '/'); /* behind the host, which is this one */
    if (!at) return NULL;
    char *path = malloc(strlen(at) + 1), *out = path;
    if (!path) return NULL;
    while (*at) {
        int high = at[0] == '%' ? hex(at[1]) : -1, low = high >= 0 ? hex(at[2]) : -1;
        if (low >= 0 && high * 16 + low > 0) *out++ = (char)(high * 16 + low), at += 3;
        else *out++ = *at++;
    }
    *out = 0;
    char *full = realpath(path, NULL);
    if (full) free(path);
    return full ? full : path;
}

char *document_uri(const char *path) {
    char *uri = malloc(3 * strlen(path) + 8), *out = uri;
    if (!uri) return NULL;
    out += sprintf(out, "file://");
    for (; *path; path++)
        if (strchr("/-._~", *path) || (*path >= '0' && *path <= '9') || ((*path | 32) >= 'a' && (*path | 32) <= 'z'))
            *out++ = *path;
        else out += sprintf(out, "%%%02X", (unsigned char)*path);
    *out = 0;
    return uri;
}

/* Bytes of the code point at `at`, and the UTF-16 units that it takes. The text came as JSON, so it is UTF-8. */
static size_t step(const char *text, size_t len, size_t at, uint32_t *units) {
    unsigned char c = (unsigned char)text[at];
    size_t n = c < 0x80 ? 1 : c < 0xE0 ? 2 : c < 0xF0 ? 3 : 4;
    *units = n == 4 ? 2 : 1;
    return n < len - at ? n : len - at;
}

size_t document_offset(const char *text, size_t len, uint32_t line, uint32_t character, bool utf8) {
    size_t at = 0;
    while (line && at < len) {
        if (text[at] == '\n' || (text[at] == '\r' && (at + 1 == len || text[at + 1] != '\n'))) line--;
        at++;
    }
    if (line) return len;
    uint32_t units = 0;
    while (at < len && text[at] != '\n' && text[at] != '\r') {
        uint32_t u;
        size_t n = step(text, len, at, &u);
        if (utf8) u = (uint32_t)n;
        if (units + u > character) break;
        units += u;
        at += n;
    }
    return at;
}

static bool place(json_t *position, uint32_t *line, uint32_t *character) {
    json_t *l = json_object_get(position, "line"), *c = json_object_get(position, "character");
    if (!json_is_integer(l) || !json_is_integer(c)) return false;
    json_int_t a = json_integer_value(l), b = json_integer_value(c);
    *line = a < 0 ? 0 : a > UINT32_MAX ? UINT32_MAX : (uint32_t)a;
    *character = b < 0 ? 0 : b > INT32_MAX ? INT32_MAX : (uint32_t)b;
    return true;
}

bool document_change(Document *d, json_t *change, bool utf8) {
    json_t *text = json_object_get(change, "text"), *range = json_object_get(change, "range");
    if (!json_is_string(text)) return false;
    size_t from = 0, to = d->len, n = json_string_length(text);
    if (range && !json_is_null(range)) {
        uint32_t line[2], character[2];
        if (!place(json_object_get(range, "start"), &line[0], &character[0]) ||
            !place(json_object_get(range, "end"), &line[1], &character[1]))
            return false;
        from = document_offset(d->text, d->len, line[0], character[0], utf8);
        to = document_offset(d->text, d->len, line[1], character[1], utf8);
        if (to < from) to = from;
    }
    size_t len = d->len - (to - from) + n;
    if (len > LSP_MOST_MESSAGE) return false;
    char *made = malloc(len + 1);
    if (!made) return false;
    memcpy(made, d->text, from);
    memcpy(made + from, json_string_value(text), n);
    memcpy(made + from + n, d->text + to, d->len - to);
    made[len] = 0;
    free(d->text);
    d->text = made, d->len = len;
    return true;
}

void document_free(Document *d) {
    for (uint32_t i = 0; i < d->ntold; i++) free(d->told[i]);
    for (uint32_t i = 0; i < d->nimports; i++) free(d->imports[i]);
    free(d->told);
    free(d->imports);
    free(d->uri);
    free(d->path);
    free(d->text);
    free(d);
}
