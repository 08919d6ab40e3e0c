#include "runtime/base/json.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

static int special(FILE *out, double v) {
    if (v == 0) return fputs(signbit(v) ? "-0" : "0", out), 1; /* what most numbers of large outputs are */
    if (isnan(v)) return fputs("null", out), 1;
    if (isinf(v)) return fputs(v > 0 ? "1e999" : "-1e999", out), 1;
    return 0;
}

void json_number(FILE *out, double v) {
    char text[40];
    if (special(out, v)) return;
    for (int digits = 15; digits <= 17; digits++) {
        snprintf(text, sizeof text, "%.*g", digits, v);
        if (strtod(text, NULL) == v) break;
    }
    fputs(text, out);
}

void json_number_f32(FILE *out, float v) {
    char text[40];
    if (special(out, v)) return;
    for (int digits = 6; digits <= 9; digits++) {
        snprintf(text, sizeof text, "%.*g", digits, (double)v);
        if (strtof(text, NULL) == v) break;
    }
    fputs(text, out);
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
