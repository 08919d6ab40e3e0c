#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* fopencookie */
#endif
#include "runtime/base/text.h"

#include <stdlib.h>
#include <string.h>

static ssize_t append(void *user, const char *bytes, size_t n) {
    Text *t = user;
    if (t->failed) return 0;
    if (n >= t->capacity - t->size) {
        size_t capacity = 2 * t->capacity + n + 256;
        char *grown = realloc(t->data, capacity);
        t->failed = !grown;
        if (!grown) return 0;
        t->data = grown, t->capacity = capacity;
    }
    memcpy(t->data + t->size, bytes, n);
    t->size += n;
    t->data[t->size] = 0;
    return (ssize_t)n;
}

FILE *text_open(Text *t) {
    *t = (Text){0};
    t->data = calloc(1, 1);
    t->capacity = t->data ? 1 : 0;
    t->out = t->data ? fopencookie(t, "w", (cookie_io_functions_t){.write = append}) : NULL;
    if (!t->out) free(t->data), t->data = NULL;
    return t->out;
}

char *text_close(Text *t) {
    if (t->out && fclose(t->out) == 0 && !t->failed) return t->data;
    free(t->data);
    return t->data = NULL;
}
