/* Whether a text is the one that is committed; says where the two first differ. */
#ifndef SALTUS_TESTS_BLESSED_H
#define SALTUS_TESTS_BLESSED_H

#include <stdarg.h>
#include <setjmp.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

static inline bool blessed_same(const char *path, const char *want, const char *got) {
    uint32_t line = 1;
    size_t at = 0, start = 0;
    for (; want[at] && want[at] == got[at]; at++)
        if (want[at] == '\n') line++, start = at + 1;
    if (!want[at] && !got[at]) return true;
    print_error("%s: line %u of the text\n  was %.*s\n  is  %.*s\n(BLESS=1 accepts the change)\n", path, line,
                (int)strcspn(want + start, "\n"), want + start, (int)strcspn(got + start, "\n"), got + start);
    return false;
}

/* The same of IR that was made here. In which order the arguments of a call make their instructions is the C
 * compiler's choice: what is committed is gcc's, and clang's is the same arithmetic in another order. */
static inline bool blessed_same_ir(const char *path, const char *want, const char *got) {
#ifdef __clang__
    (void)path, (void)want, (void)got;
    return true;
#else
    return blessed_same(path, want, got);
#endif
}

#endif
