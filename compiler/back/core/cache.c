/* The disk cache of compiled kernels, and of facts that make their IR unnecessary. Objects are executable code, and
 * facts are believed, so the folder must be ours alone and every entry proves that it is whole.
 *
 *   magic 8 | key hash 16 | key length 8 | payload length 8 | XXH3-128 of the payload 16 | payload
 *
 * Entries are written beside their place and renamed into it, so readers see all or nothing. */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>
#define XXH_INLINE_ALL /* the header alone: a library more takes 30 us of each start */
#include <xxhash.h>

#include "compiler/back/core/core.h"

enum { CACHE_CAP_MIB = 256, CACHE_KEEP_MIB = 192, CACHE_ENTRY_MIB = 64 };
/* A full folder has thousands of entries, and to ask for the size of each takes as long as to compile a kernel: it is
 * done once for so much that is written, on average, by the bits of the key. */
enum { CACHE_MEASURE_MIB = 1 };

typedef struct EntryHead {
    char magic[8];
    uint64_t key_hi, key_lo, key_len, size, sum_hi, sum_lo;
} EntryHead;

static const char magic[][8] = {[CACHE_OBJECTS] = "SLTOBJ1", [CACHE_FACTS] = "SLTFCT1"};

static bool make_folder(char *path) {
    for (char *p = path + 1; *p; p++)
        if (*p == '/') {
            *p = 0;
            bool ok = !mkdir(path, 0700) || errno == EEXIST;
            *p = '/';
            if (!ok) return false;
        }
    return !mkdir(path, 0700) || errno == EEXIST;
}

/* False: there is none, or its name is too long. */
static bool folder_path(const char *wanted, char path[PATH_MAX]) {
    const char *xdg = getenv("XDG_CACHE_HOME"), *home = getenv("HOME");
    int n = -1;
    if (wanted && *wanted) n = snprintf(path, PATH_MAX, "%s", wanted);
    else if (xdg && *xdg == '/') n = snprintf(path, PATH_MAX, "%s/saltus", xdg);
    else if (home && *home == '/') n = snprintf(path, PATH_MAX, "%s/.cache/saltus", home);
    return n >= 0 && n < PATH_MAX;
}

const char *cache_folder(Arena *arena, const char *wanted) {
    char path[PATH_MAX];
    struct stat st;
    if (!folder_path(wanted, path) || (lstat(path, &st) && !make_folder(path))) return NULL;
    /* somebody else who can write here could run code as us */
    if (lstat(path, &st) || !S_ISDIR(st.st_mode) || st.st_uid != geteuid() || (st.st_mode & 022)) return NULL;
    return arena_printf(arena, "%s", path);
}

static bool is_before(struct timespec a, struct timespec b) {
    return a.tv_sec != b.tv_sec ? a.tv_sec < b.tv_sec : a.tv_nsec < b.tv_nsec;
}

bool cache_is_behind(const char *wanted, const char *source) {
    char folder[PATH_MAX];
    struct stat file, kept;
    if (!folder_path(wanted, folder) || stat(source, &file)) return false;
    if (stat(folder, &kept)) return errno == ENOENT;
    if (!is_before(kept.st_mtim, file.st_mtim)) return false;
    (void)utimensat(AT_FDCWD, folder, NULL, 0); /* where it fails, it is asked again */
    return true;
}

static char *entry_path(Arena *arena, const char *folder, CacheKind kind, const CacheKey *key) {
    return arena_printf(arena, "%s/%016llx%016llx.%s", folder, (unsigned long long)key->hi, (unsigned long long)key->lo,
                        kind == CACHE_FACTS ? "facts" : "o");
}

static bool read_all(int fd, void *to, size_t n) {
    for (size_t done = 0; done < n;) {
        ssize_t r = read(fd, (char *)to + done, n - done);
        if (r <= 0 && !(r < 0 && errno == EINTR)) return false;
        done += r > 0 ? (size_t)r : 0;
    }
    return true;
}

static bool write_all(int fd, const void *from, size_t n) {
    for (size_t done = 0; done < n;) {
        ssize_t r = write(fd, (const char *)from + done, n - done);
        if (r < 0 && errno != EINTR) return false;
        done += r > 0 ? (size_t)r : 0;
    }
    return true;
}

unsigned char *cache_read(Arena *arena, const char *folder, CacheKind kind, const CacheKey *key, size_t *size) {
    int fd = open(entry_path(arena, folder, kind, key), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    if (fd < 0) return NULL;
    EntryHead h;
    struct stat st;
    unsigned char *bytes = NULL;
    bool ok = !fstat(fd, &st) && S_ISREG(st.st_mode) && st.st_uid == geteuid() && read_all(fd, &h, sizeof h) &&
              !memcmp(h.magic, magic[kind], 8) && h.key_hi == key->hi && h.key_lo == key->lo && h.key_len == key->len &&
              h.size <= (uint64_t)CACHE_ENTRY_MIB << 20 && (uint64_t)st.st_size == sizeof h + h.size &&
              (bytes = malloc(h.size + 1)) && read_all(fd, bytes, h.size);
    if (ok) {
        XXH128_hash_t sum = XXH3_128bits(bytes, h.size);
        ok = sum.high64 == h.sum_hi && sum.low64 == h.sum_lo;
        (void)futimens(fd, NULL); /* used lately: kept longer; fails harmlessly on a read-only folder */
    }
    close(fd);
    if (!ok) {
        free(bytes);
        return NULL;
    }
    *size = h.size;
    return bytes;
}

typedef struct Aged {
    char name[64];
    struct timespec used;
    uint64_t size;
} Aged;

static int by_age(const void *x, const void *y) {
    const Aged *a = x, *b = y;
    return is_before(b->used, a->used) - is_before(a->used, b->used);
}

/* A writer holds a lock on its temporary file: one that nobody holds is what a killed run left. */
static bool is_abandoned(int folder, const char *name) {
    int fd = strncmp(name, "tmp-", 4) ? -1 : openat(folder, name, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    bool free_to_lock = fd >= 0 && !flock(fd, LOCK_EX | LOCK_NB);
    if (fd >= 0) close(fd);
    return free_to_lock;
}

/* Removes what killed runs left, and, if it is to measure the folder, the entries unused for longest until it is within
 * its size. */
static void trim(const char *folder, bool measure) {
    DIR *d = opendir(folder);
    if (!d) return;
    Aged *all = NULL;
    size_t n = 0, cap = 0;
    uint64_t total = 0;
    for (struct dirent *f; (f = readdir(d));) {
        struct stat st;
        if (!measure && strncmp(f->d_name, "tmp-", 4) != 0) continue;
        if (strlen(f->d_name) >= sizeof all->name || fstatat(dirfd(d), f->d_name, &st, AT_SYMLINK_NOFOLLOW) ||
            !S_ISREG(st.st_mode))
            continue;
        if (is_abandoned(dirfd(d), f->d_name) && !unlinkat(dirfd(d), f->d_name, 0)) continue;
        if (n == cap) {
            cap = cap ? 2 * cap : 64;
            Aged *more = realloc(all, cap * sizeof *all);
            if (!more) break;
            all = more;
        }
        strcpy(all[n].name, f->d_name);
        all[n].used = st.st_mtim;
        all[n++].size = (uint64_t)st.st_size;
        total += (uint64_t)st.st_size;
    }
    if (total > (uint64_t)CACHE_CAP_MIB << 20) {
        qsort(all, n, sizeof *all, by_age);
        for (size_t i = 0; i < n && total > (uint64_t)CACHE_KEEP_MIB << 20; i++)
            if (!unlinkat(dirfd(d), all[i].name, 0)) total -= all[i].size;
    }
    free(all);
    closedir(d);
}

bool cache_write(Arena *arena, const char *folder, CacheKind kind, const CacheKey *key, const unsigned char *bytes,
                 size_t size) {
    if (size > (size_t)CACHE_ENTRY_MIB << 20) return false;
    XXH128_hash_t sum = XXH3_128bits(bytes, size);
    EntryHead h = {.key_hi = key->hi,
                   .key_lo = key->lo,
                   .key_len = key->len,
                   .size = size,
                   .sum_hi = sum.high64,
                   .sum_lo = sum.low64};
    memcpy(h.magic, magic[kind], 8);
    char *temp = arena_printf(arena, "%s/tmp-XXXXXX", folder);
    int fd = mkostemp(temp, O_CLOEXEC);
    if (fd < 0) return false;
    (void)flock(fd, LOCK_EX); /* ours, as long as we live */
    bool ok = write_all(fd, &h, sizeof h) && write_all(fd, bytes, size);
    ok = !close(fd) && ok;
    ok = ok && !rename(temp, entry_path(arena, folder, kind, key));
    if (!ok) unlink(temp);
    else trim(folder, key->lo % ((size_t)CACHE_MEASURE_MIB << 20) < size);
    return ok;
}
