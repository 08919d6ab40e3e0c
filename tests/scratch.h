/* A folder for what a test writes, and the command run in it.
 *
 * scratch_make and scratch_drop are a group's set-up and tear-down. The folder lies under $TMPDIR and goes with all
 * that is in it. */
#ifndef SALTUS_TESTS_SCRATCH_H
#define SALTUS_TESTS_SCRATCH_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

static char scratch[256];

static inline int scratch_make(void **state) {
    (void)state;
    snprintf(scratch, sizeof scratch, "%s/saltus-test-XXXXXX", getenv("TMPDIR") ? getenv("TMPDIR") : P_tmpdir);
    return mkdtemp(scratch) ? 0 : -1;
}

static inline int scratch_drop(void **state) {
    (void)state;
    char line[512];
    snprintf(line, sizeof line, "rm -rf '%s'", scratch);
    return system(line);
}

/* The path of a file in the folder; good until the fourth call after this one. */
static inline const char *scratch_path(const char *name) {
    static char path[4][512];
    static unsigned turn;
    char *out = path[turn++ & 3];
    snprintf(out, sizeof path[0], "%s/%s", scratch, name);
    return out;
}

static inline void scratch_put(const char *name, const char *text) {
    FILE *f = fopen(scratch_path(name), "w");
    assert_non_null(f);
    assert_true(fputs(text, f) >= 0);
    fclose(f);
}

/* Runs a line of the shell in the folder, where `saltus` is the command under test. What it printed on both outputs is
 * put into out. Returns the exit status. */
static inline int scratch_run(char *out, size_t size, const char *line) {
    char all[4096];
    int n =
        snprintf(all, sizeof all, "cd '%s' && saltus() { '%s' \"$@\"; } && { %s; } 2>&1", scratch, SALTUS_BIN, line);
    assert_in_range(n, 1, sizeof all - 1);
    FILE *f = popen(all, "r");
    assert_non_null(f);
    out[fread(out, 1, size - 1, f)] = 0;
    while (fgetc(f) != EOF) continue;
    int status = pclose(f);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

/* From what `saltus fit` printed: the first loss and the best one. */
static inline void scratch_fit_losses(const char *out, double *before, double *after) {
    const char *at = strstr(out, "loss ");
    while (at && sscanf(at, "loss %lg -> %lg", before, after) != 2) at = strstr(at + 1, "loss ");
    if (!at) fail_msg("no losses: %s", out);
}

#endif
