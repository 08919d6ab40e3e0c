/* Numbers of sources: strtod obeys the locale of the process, which is not ours to know. */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* strtod_l, newlocale */
#endif
#include <locale.h>
#include <stdlib.h>

#include "compiler/base/session.h"

double plain_strtod(const char *text, char **end) {
    locale_t plain = newlocale(LC_ALL_MASK, "C", (locale_t)0); /* allocates nothing */
    double v = plain ? strtod_l(text, end, plain) : strtod(text, end);
    if (plain) freelocale(plain);
    return v;
}
