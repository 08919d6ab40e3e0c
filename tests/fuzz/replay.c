/* Feeds every file of the folders named on the command line to the target it is linked with, then the same with bytes
 * changed, cut and doubled (a fixed seed), so that the default test run does a little fuzzing without an engine. */
#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "tests/fuzz/fuzz.h"

static uint64_t state = 0x9E3779B97F4A7C15u;

static uint32_t below(uint32_t n) {
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return (uint32_t)((state >> 20) % n);
}

/* Of processor time, so that a busy machine changes nothing. */
static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* One change to a copy of n bytes in a buffer of twice the room; returns the new size. */
static size_t change(uint8_t *bytes, size_t n) {
    if (!n) return n;
    size_t at = below((uint32_t)n), count = 1 + below(16);
    if (count > n - at) count = n - at;
    switch (below(5)) {
    case 0: bytes[at] = (uint8_t)below(256); return n;
    case 1: bytes[at] ^= (uint8_t)(1u << below(8)); return n;
    case 2: memmove(bytes + at, bytes + at + count, n - at - count); return n - count;
    case 3: memmove(bytes + at + count, bytes + at, n - at); return n + count;
    default: return at;
    }
}

static int replay(const char *path, int rounds) {
    FILE *f = fopen(path, "rb");
    if (!f) return fprintf(stderr, "cannot read %s\n", path), 1;
    enum { MAX = 1 << 18 };
    uint8_t *whole = malloc(MAX), *copy = malloc(2 * MAX);
    size_t n = whole && copy ? fread(whole, 1, MAX, f) : 0;
    fclose(f);
    int failed = 0;
    for (int r = 0; r < rounds && whole && copy; r++) {
        memcpy(copy, whole, n);
        size_t m = n;
        for (uint32_t k = 0, changes = r ? 1 + below(4) : 0; k < changes; k++) m = change(copy, m);
        /* Exactly as long as the input, so that a sanitizer sees a read beyond it. */
        uint8_t *exact = malloc(m ? m : 1);
        if (!exact) break;
        memcpy(exact, copy, m);
        double start = now();
        LLVMFuzzerTestOneInput(exact, m);
        if (now() - start > 20) failed = 1, fprintf(stderr, "%s, round %d: %.1f s\n", path, r, now() - start);
        free(exact);
    }
    free(whole);
    free(copy);
    return failed;
}

int main(int argc, char **argv) {
    int failed = 0, files = 0, rounds = argc > 1 ? atoi(argv[1]) : 1;
    for (int i = 2; i < argc; i++) {
        DIR *d = opendir(argv[i]);
        if (!d) failed |= replay(argv[i], rounds), files++;
        for (struct dirent *e; d && (e = readdir(d));) {
            char path[4096];
            if (e->d_name[0] == '.' || snprintf(path, sizeof path, "%s/%s", argv[i], e->d_name) >= (int)sizeof path)
                continue;
            failed |= replay(path, rounds), files++;
        }
        if (d) closedir(d);
    }
    printf("%d files, %d rounds each\n", files, rounds);
    return failed || !files;
}
