#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* fwrite_unlocked */
#endif
#include "runtime/base/json.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/base/decimal.h"

static bool special(FILE *out, double v) {
    if (v == 0) { /* what most numbers of large outputs are */
        if (signbit(v)) putc_unlocked('-', out);
        return putc_unlocked('0', out), true;
    }
    if (isnan(v)) return fputs("null", out), true;
    if (isinf(v)) return fputs(v > 0 ? "1e999" : "-1e999", out), true;
    return false;
}

void json_number(FILE *out, double v) {
    char text[DECIMAL_SIZE];
    if (!special(out, v)) fwrite_unlocked(text, 1, decimal_print(text, v), out);
}

void json_number_f32(FILE *out, float v) {
    char text[DECIMAL_SIZE];
    if (!special(out, v)) fwrite_unlocked(text, 1, decimal_print_f32(text, v), out);
}

void json_text(FILE *out, const char *utf8) {
    fputc('"', out);
    for (const unsigned char *s = (const unsigned char *)(utf8 ? utf8 : ""); *s; s++)
        if (*s == '"' || *s == '\\') fprintf(out, "\\%c", *s);
        else if (*s == '\n') fputs("\\n", out);
        else if (*s == '\t') fputs("\\t", out);
        else if (*s < 0x20) fprintf(out, "\\u%04x", *s);
        else fputc(*s, out);
    fputc('"', out);
}

/* jansson takes its memory here, unless its user has given it other functions. */
static _Thread_local bool refused;

static void *take(size_t bytes) {
    void *p = malloc(bytes);
    if (!p) refused = true;
    return p;
}

static void watch_memory(void) {
    json_malloc_t take_now;
    json_free_t give_now;
    json_get_alloc_funcs(&take_now, &give_now);
    if (take_now == malloc && give_now == free) json_set_alloc_funcs(take, free);
}

bool json_no_memory(const json_error_t *e) { return json_error_code(e) == json_error_out_of_memory; }

json_t *json_read(const char *text, size_t size, size_t flags, json_error_t *e) {
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, watch_memory);
    refused = false;
    json_t *j = json_loadb(text, size, flags, e);
    if (!refused) return j;
    json_decref(j);
    e->text[JSON_ERROR_TEXT_LENGTH - 1] = json_error_out_of_memory; /* where json_error_code finds it */
    return NULL;
}
