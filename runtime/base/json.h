/* Writing JSON: strings escaped, numbers printed so that reading them back gives the same bits. Reading is jansson's.
 */
#ifndef SALTUS_RUNTIME_BASE_JSON_H
#define SALTUS_RUNTIME_BASE_JSON_H

#include <stdint.h>
#include <stdio.h>

/* The shortest decimal that reads back as v. JSON has no NaN and no infinities: they become null and +-1e999 (which
 * every reader takes as infinite or rejects, and none takes as a number). */
void json_number(FILE *out, double v);
/* The shortest decimal that reads back as the same float. */
void json_number_f32(FILE *out, float v);
void json_text(FILE *out, const char *utf8);

#endif
