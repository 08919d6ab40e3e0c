/* Frames: a header with Content-Length, an empty line, the message. */
#include "cli/lsp/lsp.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

bool rpc_fill(Rpc *r, int fd) {
    enum { CHUNK = 1 << 16 };
    if (r->cap - r->len < CHUNK) {
        size_t cap = r->cap ? r->cap * 2 : 2 * CHUNK;
        char *grown = realloc(r->data, cap);
        if (!grown) return false;
        r->data = grown, r->cap = cap;
    }
    ssize_t n;
    do n = read(fd, r->data + r->len, r->cap - r->len);
    while (n < 0 && errno == EINTR);
    if (n <= 0) return false;
    r->len += (size_t)n;
    return true;
}

static void drop(Rpc *r, size_t n) {
    memmove(r->data, r->data + n, r->len - n);
    r->len -= n;
}

/* The number behind Content-Length in a header; false: there is none. */
static bool content_length(const char *head, size_t n, size_t *length) {
    static const char name[] = "content-length:";
    bool found = false;
    for (const char *line = head, *end = head + n; line < end;) {
        const char *stop = memchr(line, '\n', (size_t)(end - line));
        if (!stop) stop = end;
        if ((size_t)(stop - line) > sizeof name - 1 && !strncasecmp(line, name, sizeof name - 1)) {
            const char *at = line + sizeof name - 1;
            while (at < stop && (*at == ' ' || *at == '\t')) at++;
            size_t v = 0;
            const char *first = at;
            while (at < stop && *at >= '0' && *at <= '9' && v < SIZE_MAX / 16) v = v * 10 + (size_t)(*at++ - '0');
            found = at > first && (at == stop || *at == '\r' || *at == ' ');
            *length = v;
        }
        line = stop + 1;
    }
    return found;
}

RpcTake rpc_take(Rpc *r, char **body, size_t *size) {
    if (r->skip) {
        size_t n = r->skip < r->len ? r->skip : r->len;
        drop(r, n);
        r->skip -= n;
        if (r->skip) return RPC_NOTHING;
    }
    const char *end = r->len ? memmem(r->data, r->len, "\r\n\r\n", 4) : NULL;
    if (!end) return r->len > LSP_MOST_HEADER ? RPC_BROKEN : RPC_NOTHING;
    size_t head = (size_t)(end - r->data) + 4, length;
    if (!content_length(r->data, head, &length)) return RPC_BROKEN;
    if (length > LSP_MOST_MESSAGE) {
        drop(r, head);
        r->skip = length;
        return RPC_TOO_LONG;
    }
    if (r->len - head < length) return RPC_NOTHING;
    char *copy = malloc(length + 1);
    if (!copy) return RPC_NO_MEMORY;
    memcpy(copy, r->data + head, length);
    copy[length] = 0;
    drop(r, head + length);
    *body = copy, *size = length;
    return RPC_MESSAGE;
}

bool rpc_send(const char *body, size_t size) {
    return fprintf(stdout, "Content-Length: %zu\r\n\r\n", size) > 0 && fwrite(body, 1, size, stdout) == size &&
           fflush(stdout) == 0;
}

void rpc_free(Rpc *r) { free(r->data); }
