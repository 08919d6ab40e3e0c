/* Writing JSON: strings escaped, numbers printed so that reading them back gives the same bits. Reading is jansson's,
 * which goes on with a shorter number or string where there is no memory for the whole of it: here there is none then.
 */
#ifndef SALTUS_RUNTIME_BASE_JSON_H
#define SALTUS_RUNTIME_BASE_JSON_H

#include <jansson.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

/* Lists and numbers are millions: a stream takes them from one thread, without locks. */
static inline void json_put(FILE *out, char c) { putc_unlocked(c, out); }
static inline void json_comma(FILE *out) {
    putc_unlocked(',', out);
    putc_unlocked(' ', out);
}

/* The shortest decimal that reads back as v. JSON has no NaN and no infinities: they become null and +-1e999 (which
 * every reader takes as infinite or rejects, and none takes as a number). */
void json_number(FILE *out, double v);
/* The shortest decimal that reads back as the same float. */
void json_number_f32(FILE *out, float v);
void json_text(FILE *out, const char *utf8);

/* json_loadb; NULL where the memory was out at any time, of which the error then knows. */
json_t *json_read(const char *text, size_t size, size_t flags, json_error_t *e);
bool json_no_memory(const json_error_t *e);

#endif
