#include "runtime/base/json.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static int special(FILE *out, double v) {
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
