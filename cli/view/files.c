#include "cli/view/files.h"

#include <limits.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/inotify.h>
#include <sys/stat.h>
#include <unistd.h>
#define XXH_INLINE_ALL /* the header alone: a library more takes 30 us of each start */
#include <xxhash.h>

#include "cli/cli.h"

typedef struct Watched {
    int folder; /* the watch's descriptor */
    char *name; /* of the file in it */
} Watched;

/* What a file is, without reading it: all zero while there is none. */
typedef struct Mark {
    dev_t disk;
    ino_t inode;
    off_t size;
    struct timespec written;
} Mark;

typedef struct Looked {
    char *path;
    Mark mark; /* of what is known */
    Mark last; /* at the last look: what stays so for two of them is no file that is being written */
} Looked;

struct Files {
    int fd;
    Watched *all;
    uint32_t n;
    Looked *looked;
    uint32_t nlooked;
};

Files *files_watch(void) {
    Files *w = cli_need(calloc(1, sizeof *w));
    w->fd = inotify_init1(IN_NONBLOCK | IN_CLOEXEC);
    if (w->fd >= 0) return w;
    free(w);
    return NULL;
}

int files_fd(const Files *w) { return w->fd; }

static bool is_watched(const Watched *all, uint32_t n, int folder, const char *name) {
    for (uint32_t i = 0; i < n; i++)
        if (all[i].folder == folder && !strcmp(all[i].name, name)) return true;
    return false;
}

static bool holds_else(const char *path, uint64_t hash) {
    uint8_t *bytes;
    size_t size;
    SltError ignored;
    if (!hash || file_read_all(path, &file_text, &bytes, &size, &ignored) != SLT_OK) return false;
    bool other = files_hash(bytes, size) != hash;
    free(bytes);
    return other;
}

static void forget(Watched *all, uint32_t n) {
    for (uint32_t i = 0; i < n; i++) free(all[i].name);
    free(all);
}

static Mark mark_of(const char *path) {
    struct stat s;
    if (stat(path, &s) != 0) return (Mark){0};
    return (Mark){s.st_dev, s.st_ino, s.st_size, s.st_mtim};
}

/* Whoever opens a pipe waits for its writer. */
static bool is_pipe(const char *path) {
    struct stat s;
    return stat(path, &s) == 0 && !S_ISREG(s.st_mode) && !S_ISDIR(s.st_mode);
}

static bool same_mark(const Mark *a, const Mark *b) {
    return a->disk == b->disk && a->inode == b->inode && a->size == b->size && a->written.tv_sec == b->written.tv_sec &&
           a->written.tv_nsec == b->written.tv_nsec;
}

static void forget_looked(Looked *all, uint32_t n) {
    for (uint32_t i = 0; i < n; i++) free(all[i].path);
    free(all);
}

/* What was changed up to now is known: a program is compiled of it. */
static void mark_all(Files *w) {
    for (uint32_t i = 0; i < w->nlooked; i++) w->looked[i].mark = w->looked[i].last = mark_of(w->looked[i].path);
}

/* What was looked at before is known as it was then: it may have changed since. */
static void look_at(Files *w, const char *path, const Looked *before, uint32_t nbefore) {
    Looked l = {.path = cli_need(strdup(path)), .mark = mark_of(path)};
    l.last = l.mark;
    for (uint32_t i = 0; i < nbefore; i++)
        if (!strcmp(before[i].path, path)) l.mark = before[i].mark, l.last = before[i].last;
    w->looked = cli_need(realloc(w->looked, (w->nlooked + 1) * sizeof *w->looked));
    w->looked[w->nlooked++] = l;
}

bool files_look(Files *w) {
    bool changed = false;
    for (uint32_t i = 0; i < w->nlooked; i++) {
        Looked *l = &w->looked[i];
        if (is_pipe(l->path)) continue;
        Mark now = mark_of(l->path);
        changed |= same_mark(&now, &l->last) && !same_mark(&now, &l->mark);
        l->last = now;
    }
    if (changed) mark_all(w);
    return changed;
}

/* The folder's watch, or -1. */
static int add(Files *w, const char *path) {
    char folder[PATH_MAX];
    const char *slash = strrchr(path, '/');
    size_t n = slash ? (size_t)(slash - path) : 0;
    if (n >= sizeof folder) return -1;
    memcpy(folder, path, n);
    strcpy(folder + n, !slash ? "." : n ? "" : "/");
    /* Written and closed, or moved into place: the file is whole then. */
    int id = inotify_add_watch(w->fd, folder, IN_CLOSE_WRITE | IN_MOVED_TO | IN_ONLYDIR);
    if (id < 0) return -1;
    w->all = cli_need(realloc(w->all, (w->n + 1) * sizeof *w->all));
    w->all[w->n++] = (Watched){id, cli_need(strdup(slash ? slash + 1 : path))};
    return id;
}

uint64_t files_hash(const void *data, size_t size) { return XXH64(data, size, 0) | 1; }

bool files_set(Files *w, const char *lines) {
    Watched *before = w->all;
    Looked *looked = w->looked;
    const uint32_t nbefore = w->n, nlooked = w->nlooked;
    bool missed = false;
    w->all = NULL, w->n = 0, w->looked = NULL, w->nlooked = 0;
    while (*lines) {
        char path[PATH_MAX], real[PATH_MAX], *name;
        uint64_t hash = strtoull(lines, &name, 16);
        size_t n = strcspn(++name, "\n");
        if (n && n < sizeof path) {
            memcpy(path, name, n);
            path[n] = 0;
            look_at(w, path, looked, nlooked);
            if (add(w, path) >= 0 && !is_watched(before, nbefore, w->all[w->n - 1].folder, w->all[w->n - 1].name))
                missed |= holds_else(path, hash);
            if (realpath(path, real) && strcmp(real, path) != 0) add(w, real); /* what a link leads to */
        }
        lines = name + n + 1;
    }
    forget(before, nbefore);
    forget_looked(looked, nlooked);
    return missed;
}

static bool is_source(const char *name) {
    size_t n = strlen(name);
    return n > 5 && !strcmp(name + n - 5, ".salt");
}

bool files_changed(Files *w, bool any_source) {
    _Alignas(struct inotify_event) char buffer[4096];
    bool changed = false;
    for (ssize_t n; (n = read(w->fd, buffer, sizeof buffer)) > 0;)
        for (char *at = buffer; at < buffer + n;) {
            const struct inotify_event *e = (const void *)at;
            at += sizeof *e + e->len;
            changed |= (e->mask & IN_Q_OVERFLOW) || (any_source && e->len && is_source(e->name));
            changed |= e->len && is_watched(w->all, w->n, e->wd, e->name);
        }
    if (changed) mark_all(w);
    return changed;
}

void files_free(Files *w) {
    if (!w) return;
    forget(w->all, w->n);
    forget_looked(w->looked, w->nlooked);
    close(w->fd);
    free(w);
}
