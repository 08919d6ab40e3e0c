#include "cli/view/files.h"

#include <limits.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/inotify.h>
#include <unistd.h>

#include "cli/cli.h"

typedef struct Watched {
    int folder; /* the watch's descriptor */
    char *name; /* of the file in it */
} Watched;

struct Files {
    int fd;
    Watched *all;
    uint32_t n;
};

Files *files_watch(void) {
    Files *w = cli_need(calloc(1, sizeof *w));
    w->fd = inotify_init1(IN_NONBLOCK | IN_CLOEXEC);
    if (w->fd >= 0) return w;
    free(w);
    return NULL;
}

int files_fd(const Files *w) { return w->fd; }

static void add(Files *w, const char *path) {
    char folder[PATH_MAX];
    const char *slash = strrchr(path, '/');
    size_t n = slash ? (size_t)(slash - path) : 0;
    if (n >= sizeof folder) return;
    memcpy(folder, path, n);
    strcpy(folder + n, !slash ? "." : n ? "" : "/");
    /* Written and closed, or moved into place: the file is whole then. */
    int id = inotify_add_watch(w->fd, folder, IN_CLOSE_WRITE | IN_MOVED_TO | IN_ONLYDIR);
    if (id < 0) return;
    w->all = cli_need(realloc(w->all, (w->n + 1) * sizeof *w->all));
    w->all[w->n++] = (Watched){id, cli_need(strdup(slash ? slash + 1 : path))};
}

static void forget(Files *w) {
    for (uint32_t i = 0; i < w->n; i++) free(w->all[i].name);
    w->n = 0;
}

void files_set(Files *w, const char *list) {
    forget(w);
    while (*list) {
        char path[PATH_MAX], real[PATH_MAX];
        size_t n = strcspn(list, "\n");
        if (n && n < sizeof path) {
            memcpy(path, list, n);
            path[n] = 0;
            add(w, path);
            if (realpath(path, real) && strcmp(real, path) != 0) add(w, real); /* what a link leads to */
        }
        list += n;
        if (*list) list++;
    }
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
            for (uint32_t i = 0; i < w->n && e->len; i++)
                changed |= w->all[i].folder == e->wd && !strcmp(w->all[i].name, e->name);
        }
    return changed;
}

void files_free(Files *w) {
    if (!w) return;
    forget(w);
    free(w->all);
    close(w->fd);
    free(w);
}
