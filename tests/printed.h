/* What a session's diagnostics print, as a text to be freed. */
#ifndef SALTUS_TESTS_PRINTED_H
#define SALTUS_TESTS_PRINTED_H

#include <stdio.h>
#include <stdlib.h>

#include "compiler/base/session.h"

static inline char *printed(const Session *s, void (*print)(const Session *, FILE *)) {
    FILE *f = tmpfile();
    if (!f) abort();
    print(s, f);
    long size = ftell(f);
    char *text = calloc((size_t)size + 1, 1);
    fseek(f, 0, SEEK_SET);
    if (!text || fread(text, 1, (size_t)size, f) != (size_t)size) abort();
    fclose(f);
    return text;
}

static inline void print_text(const Session *s, FILE *f) { diag_print_text(s, f, false); }

#endif
