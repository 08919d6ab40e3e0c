/* A preloaded object that makes allocations and system calls fail, one call site after the other.
 *
 * A site is a call with the addresses that led to it; sites are numbered by their first call. FAULT_SITE=n lets the
 * call of site n fail when it first comes (FAULT_MODE=once), when it comes again (second), and every call of its kind
 * from there on (on) or every third (third), so that what follows a failure runs on, half served; without it nothing
 * fails. FAULT_CALL=n counts the calls for memory themselves, from wherever they come. FAULT_KINDS: m for memory, s for
 * the system. FAULT_LOG names a file that gets the number of sites when the process ends, those that came again, where
 * the failure was injected, and what our own code took and never gave back.
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE
#endif
#include <dirent.h>
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>
#include <unwind.h>

extern void *__libc_malloc(size_t size), *__libc_calloc(size_t n, size_t size), *__libc_realloc(void *p, size_t size);
extern void *__libc_memalign(size_t align, size_t size);
extern void __libc_free(void *p);

enum { DEPTH = 8, SITES = 1 << 16, BLOCKS = 1 << 18 };

typedef struct Trace {
    uintptr_t at[DEPTH + 3];
    int n;
} Trace;

static struct {
    bool ready;
    long wanted, wanted_call, ncalls, stride, since; /* from the failure on every stride-th call fails; 0: none */
    bool second, memory, system;
    const char *log;
    pthread_mutex_t lock;
    uint64_t seen[SITES];
    long number[SITES], nsites; /* of the site at this place */
    bool again[SITES];          /* by number */
    bool fired, fired_memory;
    const char *call;
    Trace where;
    uintptr_t lo, hi; /* the program's own code */
    struct {
        void *p;
        uint64_t size;
        Trace from;
    } blocks[BLOCKS];
} fault = {.lock = PTHREAD_MUTEX_INITIALIZER};

/* Inside the hooks nothing is counted: what they call may allocate. */
static _Thread_local bool busy;

static _Unwind_Reason_Code step(struct _Unwind_Context *c, void *user) {
    Trace *t = user;
    if (t->n == DEPTH + 3) return _URC_END_OF_STACK;
    t->at[t->n++] = (uintptr_t)_Unwind_GetIP(c);
    return _URC_NO_REASON;
}

__attribute__((constructor)) static void start(void) {
    const char *site = getenv("FAULT_SITE"), *mode = getenv("FAULT_MODE"), *kinds = getenv("FAULT_KINDS");
    fault.log = getenv("FAULT_LOG");
    fault.wanted = site ? strtol(site, NULL, 10) : -1;
    const char *call = getenv("FAULT_CALL");
    fault.wanted_call = call ? strtol(call, NULL, 10) : -1;
    fault.stride = !mode ? 0 : !strcmp(mode, "on") ? 1 : !strcmp(mode, "third") ? 3 : 0;
    fault.second = mode && !strcmp(mode, "second");
    fault.memory = !kinds || strchr(kinds, 'm');
    fault.system = !kinds || strchr(kinds, 's');
    FILE *maps = fopen("/proc/self/maps", "re");
    char line[512], exe[256];
    ssize_t n = readlink("/proc/self/exe", exe, sizeof exe - 1);
    exe[n > 0 ? n : 0] = 0;
    while (maps && fgets(line, sizeof line, maps)) {
        unsigned long a, b;
        if (!strstr(line, exe) || sscanf(line, "%lx-%lx", &a, &b) != 2) continue;
        if (!fault.lo) fault.lo = a;
        fault.hi = b;
    }
    if (maps) fclose(maps);
    unsetenv("LD_PRELOAD"); /* the programs that this one starts are not under test */
    fault.ready = n > 0 && (fault.memory || fault.system);
}

static bool is_ours(const Trace *t) {
    for (int i = 0; i < t->n; i++)
        if (t->at[i] >= fault.lo && t->at[i] < fault.hi) return true;
    return false;
}

/* Whether this call is to fail. Failures begin once the program's own code runs: the loader's are not ours to mend. */
static bool fails(const char *call, bool memory) {
    if (!fault.ready || busy || !(memory ? fault.memory : fault.system)) return false;
    if (memory && fault.wanted_call >= 0) {
        long at = __atomic_fetch_add(&fault.ncalls, 1, __ATOMIC_RELAXED);
        return at == fault.wanted_call ||
               (fault.stride && at > fault.wanted_call && (at - fault.wanted_call) % fault.stride == 0);
    }
    busy = true;
    Trace t = {.n = 0};
    _Unwind_Backtrace(step, &t);
    uint64_t h = (uintptr_t)call * 0x9e3779b97f4a7c15u;
    for (int i = 2; i < t.n; i++) h = (h ^ t.at[i]) * 0x9e3779b97f4a7c15u, h ^= h >> 29;
    h |= 1;
    pthread_mutex_lock(&fault.lock);
    bool follows = fault.stride && fault.fired && fault.fired_memory == memory;
    bool now = follows && ++fault.since % fault.stride == 0;
    if (!follows && is_ours(&t)) {
        uint64_t at = h % SITES;
        while (fault.seen[at] && fault.seen[at] != h) at = (at + 1) % SITES;
        bool first = !fault.seen[at];
        if (first) fault.seen[at] = h, fault.number[at] = fault.nsites++;
        now = fault.number[at] == fault.wanted && first != fault.second && !fault.fired;
        if (!first) fault.again[fault.number[at]] = true;
        if (now) {
            fault.fired = true;
            fault.fired_memory = memory;
            fault.call = call;
            fault.where = t;
        }
    }
    pthread_mutex_unlock(&fault.lock);
    busy = false;
    return now;
}

static void note(void *p, size_t size) {
    if (!p || !fault.ready || busy || fault.wanted_call >= 0) return;
    busy = true;
    Trace t = {.n = 0};
    _Unwind_Backtrace(step, &t);
    if (is_ours(&t)) {
        pthread_mutex_lock(&fault.lock);
        uint64_t at = ((uintptr_t)p >> 4) * 0x9e3779b97f4a7c15u >> 46;
        while (fault.blocks[at].p && fault.blocks[at].p != (void *)1) at = (at + 1) % BLOCKS;
        fault.blocks[at].p = p;
        fault.blocks[at].size = size;
        fault.blocks[at].from = t;
        pthread_mutex_unlock(&fault.lock);
    }
    busy = false;
}

static void forget(void *p) {
    if (!p || !fault.ready) return;
    pthread_mutex_lock(&fault.lock);
    uint64_t at = ((uintptr_t)p >> 4) * 0x9e3779b97f4a7c15u >> 46;
    while (fault.blocks[at].p && fault.blocks[at].p != p) at = (at + 1) % BLOCKS;
    if (fault.blocks[at].p) fault.blocks[at].p = (void *)1; /* a grave: the search goes on past it */
    pthread_mutex_unlock(&fault.lock);
}

static void print_trace(FILE *f, const Trace *t) {
    for (int i = 2; i < t->n; i++) {
        Dl_info d = {0};
        bool known = dladdr((void *)t->at[i], &d) && d.dli_fname;
        const char *slash = known ? strrchr(d.dli_fname, '/') : NULL;
        fprintf(f, " %s+%lx",
                slash   ? slash + 1
                : known ? d.dli_fname
                        : "?",
                (unsigned long)(t->at[i] - (uintptr_t)d.dli_fbase));
    }
    fputc('\n', f);
}

const char saltus_frees_all = 1; /* for the command: what is kept at the end is lost */

__attribute__((destructor)) static void end(void) {
    if (!fault.ready || !fault.log) return;
    fault.ready = false;
    busy = true;
    FILE *f = fopen(fault.log, "we");
    if (!f) return;
    fprintf(f, "sites %ld\ncalls %ld\n", fault.nsites, fault.ncalls);
    for (long i = 0; fault.wanted < 0 && i < fault.nsites; i++)
        if (fault.again[i]) fprintf(f, "again %ld\n", i);
    if (fault.fired) fprintf(f, "failed %s", fault.call), print_trace(f, &fault.where);
    for (int i = 0; i < BLOCKS; i++)
        if (fault.blocks[i].p && fault.blocks[i].p != (void *)1) {
            fprintf(f, "kept %lu", (unsigned long)fault.blocks[i].size);
            print_trace(f, &fault.blocks[i].from);
        }
    fclose(f);
}

/* ---- memory */
#define NO_MEMORY(call) \
    if (fails(call, true)) return errno = ENOMEM, NULL

void *malloc(size_t size) {
    NO_MEMORY("malloc");
    void *p = __libc_malloc(size);
    note(p, size);
    return p;
}
void *calloc(size_t n, size_t size) {
    NO_MEMORY("calloc");
    void *p = __libc_calloc(n, size);
    note(p, n * size);
    return p;
}
void *realloc(void *old, size_t size) {
    NO_MEMORY("realloc");
    forget(old);
    void *p = __libc_realloc(old, size);
    note(p, size);
    return p;
}
void *memalign(size_t align, size_t size) {
    NO_MEMORY("memalign");
    void *p = __libc_memalign(align, size);
    note(p, size);
    return p;
}
void *aligned_alloc(size_t align, size_t size) { return memalign(align, size); }
int posix_memalign(void **out, size_t align, size_t size) {
    *out = memalign(align, size);
    return *out ? 0 : ENOMEM;
}
void free(void *p) {
    forget(p);
    __libc_free(p);
}

/* ---- the system */
#define REAL(type, name, ...) \
    static type (*real)(__VA_ARGS__); \
    if (!real) { \
        bool was = busy; \
        busy = true; \
        *(void **)&real = dlsym(RTLD_NEXT, name); \
        busy = was; \
    }

void *mmap(void *at, size_t size, int prot, int flags, int fd, off_t offset) {
    REAL(void *, "mmap", void *, size_t, int, int, int, off_t)
    if (fails("mmap", true)) return errno = ENOMEM, MAP_FAILED;
    return real(at, size, prot, flags, fd, offset);
}
int mprotect(void *at, size_t size, int prot) {
    REAL(int, "mprotect", void *, size_t, int)
    return fails("mprotect", false) ? (errno = EACCES, -1) : real(at, size, prot);
}
int open(const char *path, int flags, ...) {
    va_list ap;
    va_start(ap, flags);
    mode_t mode = flags & O_CREAT ? va_arg(ap, mode_t) : 0;
    va_end(ap);
    REAL(int, "open", const char *, int, ...)
    return fails("open", false) ? (errno = EMFILE, -1) : real(path, flags, mode);
}
int openat(int dir, const char *path, int flags, ...) {
    va_list ap;
    va_start(ap, flags);
    mode_t mode = flags & O_CREAT ? va_arg(ap, mode_t) : 0;
    va_end(ap);
    REAL(int, "openat", int, const char *, int, ...)
    return fails("openat", false) ? (errno = EMFILE, -1) : real(dir, path, flags, mode);
}
#define CALL(result, name, arguments, forward, code, bad) \
    result name arguments { \
        REAL(result, #name, ) \
        return fails(#name, false) ? (errno = code, bad) : ((result(*) arguments)real)forward; \
    }
CALL(FILE *, fopen, (const char *path, const char *mode), (path, mode), EMFILE, NULL)
CALL(FILE *, fdopen, (int fd, const char *mode), (fd, mode), EMFILE, NULL)
CALL(FILE *, open_memstream, (char **p, size_t *n), (p, n), ENOMEM, NULL)
CALL(DIR *, fdopendir, (int fd), (fd), EMFILE, NULL)
CALL(ssize_t, read, (int fd, void *p, size_t n), (fd, p, n), EIO, -1)
CALL(ssize_t, pread, (int fd, void *p, size_t n, off_t at), (fd, p, n, at), EIO, -1)
CALL(ssize_t, write, (int fd, const void *p, size_t n), (fd, p, n), ENOSPC, -1)
CALL(int, fsync, (int fd), (fd), EIO, -1)
CALL(int, rename, (const char *a, const char *b), (a, b), EACCES, -1)
CALL(int, mkdir, (const char *path, mode_t mode), (path, mode), EACCES, -1)
CALL(int, fstat, (int fd, struct stat *st), (fd, st), EIO, -1)
CALL(int, fchmod, (int fd, mode_t mode), (fd, mode), EPERM, -1)
CALL(int, pipe2, (int fd[2], int flags), (fd, flags), EMFILE, -1)
CALL(pid_t, fork, (void), (), EAGAIN, -1)
CALL(char *, realpath, (const char *path, char *to), (path, to), EACCES, NULL)
CALL(void *, dlopen, (const char *path, int flags), (path, flags), ENOMEM, NULL)

int close(int fd) { /* the descriptor is gone all the same, as on Linux */
    REAL(int, "close", int)
    int result = real(fd);
    return fails("close", false) ? (errno = EIO, -1) : result;
}
int fclose(FILE *f) {
    REAL(int, "fclose", FILE *)
    int result = real(f);
    return fails("fclose", false) ? (errno = ENOSPC, EOF) : result;
}
int pthread_create(pthread_t *t, const pthread_attr_t *a, void *(*run)(void *), void *user) {
    REAL(int, "pthread_create", pthread_t *, const pthread_attr_t *, void *(*)(void *), void *)
    return fails("pthread_create", false) ? EAGAIN : real(t, a, run, user);
}
