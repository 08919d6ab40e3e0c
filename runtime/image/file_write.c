/* Whole files out: all of them or none, also of several that belong together. */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE
#endif
#include "internal.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

/* A file that is whole under a name of its own, and where it belongs. Files that appear together keep the old one under
 * a second name until all are in place. */
typedef struct Staged {
    struct Staged *next;
    int fd, kept_fd; /* open and locked, so that nobody takes them for what a killed run left */
    char *temporary, *target, *kept;
    bool replaces, placed;
} Staged;

/* The group that this thread's outputs go to; NULL: each by itself. */
static _Thread_local FileGroup *group;

/* 0, or an errno value */
static int write_fully(int fd, const uint8_t *p, size_t size) {
    while (size > 0) {
        ssize_t n = write(fd, p, size < (1u << 30) ? size : (1u << 30));
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) return errno;
        if (n == 0) return EIO;
        p += n;
        size -= (size_t)n;
    }
    return 0;
}

static int sync_file(int fd) {
    while (fsync(fd) != 0) {
        if (errno == EINVAL || errno == EROFS || errno == ENOTSUP) return 0; /* this file system has nothing to sync */
        if (errno != EINTR) return errno;
    }
    return 0;
}

static SltStatus write_special(const char *path, const void *data, size_t size, SltError *err) {
    int fd = open(path, O_WRONLY | O_CLOEXEC);
    int code = fd < 0 ? errno : write_fully(fd, data, size);
    if (fd >= 0 && close(fd) != 0 && !code) code = errno;
    return code ? status_fail_errno(err, SLT_OUTPUT, code, "cannot write '%s'", path) : SLT_OK;
}

/* The length of the folder's name with its slash; 0: the current one. */
static size_t folder_length(const char *path) {
    const char *slash = strrchr(path, '/');
    return slash ? (size_t)(slash + 1 - path) : 0;
}

static int open_folder(const char *path) {
    size_t n = folder_length(path);
    char *folder = n ? strndup(path, n) : strdup(".");
    int fd = folder ? open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC) : -1;
    free(folder);
    return fd;
}

static bool is_temporary(const char *name) {
    size_t n = strlen(name);
    return !strncmp(name, ".saltus-", 8) && n > 4 && !strcmp(name + n - 4, ".tmp");
}

/* Removes what killed runs left beside `path`: temporary files that nobody holds. */
static void sweep_folder_of(const char *path) {
    int fd = open_folder(path);
    DIR *d = fd < 0 ? NULL : fdopendir(fd);
    if (!d && fd >= 0) close(fd);
    for (struct dirent *f; d && (f = readdir(d));) {
        if (!is_temporary(f->d_name)) continue;
        int left = openat(fd, f->d_name, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
        if (left >= 0 && !flock(left, LOCK_EX | LOCK_NB)) unlinkat(fd, f->d_name, 0);
        if (left >= 0) close(left);
    }
    if (d) closedir(d);
}

/* -1 with errno EEXIST: the name is taken. */
typedef int Maker(const char *target, const char *name);

/* Makes a file beside the target under a name that no other process has. The name is short, because the target's may be
 * as long as the system allows. */
static int make_beside(const char *target, Maker *make, char **name) {
    size_t folder = folder_length(target), room = folder + 40;
    *name = malloc(room);
    if (!*name) {
        errno = ENOMEM;
        return -1;
    }
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    uint64_t salt = (uint64_t)now.tv_nsec ^ ((uint64_t)getpid() << 32) ^ (uint64_t)(uintptr_t)*name;
    for (int attempt = 0; attempt < 100; attempt++) {
        salt = salt * 6364136223846793005u + 1442695040888963407u;
        snprintf(*name, room, "%.*s.saltus-%08x.tmp", (int)folder, target, (unsigned)(salt >> 32));
        int made = make(target, *name);
        if (made >= 0 || errno != EEXIST) return made;
    }
    return -1;
}

/* Its mode follows the umask, which mkstemp's does not. */
static int open_new(const char *target, const char *name) {
    (void)target;
    int fd = open(name, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (fd >= 0) (void)flock(fd, LOCK_EX); /* where there are no locks, nothing is swept either */
    return fd;
}

static int link_old(const char *target, const char *name) { return link(target, name); }

static void free_staged(Staged *s) {
    if (!s) return;
    if (s->fd >= 0) close(s->fd);
    if (s->kept_fd >= 0) close(s->kept_fd);
    free(s->temporary);
    free(s->target);
    free(s->kept);
    free(s);
}

/* Whole on the disk, under another name. NULL, and an errno value in *code. */
static Staged *stage(const char *path, const struct stat *old, const void *data, size_t size, int *code) {
    Staged *s = calloc(1, sizeof *s);
    if (s) {
        s->fd = s->kept_fd = -1;
        s->replaces = old;
        s->target = old ? realpath(path, NULL) : NULL; /* replaces what a link points to, not the link */
        if (!s->target) s->target = strdup(path);
    }
    if (!s || !s->target) {
        free_staged(s);
        *code = ENOMEM;
        return NULL;
    }
    sweep_folder_of(s->target);
    s->fd = make_beside(s->target, open_new, &s->temporary);
    *code = s->fd < 0 ? errno : 0;
    if (!*code && old) (void)fchmod(s->fd, old->st_mode & 07777); /* some file systems have no modes */
    if (!*code) *code = write_fully(s->fd, data, size);
    if (!*code) *code = sync_file(s->fd);
    if (!*code) return s;
    if (s->fd >= 0) unlink(s->temporary);
    free_staged(s);
    return NULL;
}

static SltStatus put_in_place(Staged *s, SltError *err) {
    s->placed = rename(s->temporary, s->target) == 0;
    return s->placed ? SLT_OK : status_fail_errno(err, SLT_OUTPUT, errno, "cannot write '%s'", s->target);
}

/* The old file under a second name. A file system without hard links keeps none, and what takes its place stays. */
static SltStatus keep_old(Staged *s, SltError *err) {
    if (!s->replaces) return SLT_OK;
    s->kept_fd = open(s->target, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    if (s->kept_fd >= 0) (void)flock(s->kept_fd, LOCK_EX | LOCK_NB); /* whoever cannot read it cannot sweep it either */
    if (make_beside(s->target, link_old, &s->kept) == 0) return SLT_OK;
    bool without = errno == EPERM || errno == EOPNOTSUPP || errno == ENOSYS || errno == EMLINK || errno == EXDEV;
    int code = errno;
    free(s->kept);
    s->kept = NULL;
    return without ? SLT_OK : status_fail_errno(err, SLT_OUTPUT, code, "cannot write '%s'", s->target);
}

/* Removes what is not wanted any longer; if the group `failed`, what was there before takes its place again. */
static void settle(Staged *s, bool failed) {
    if (!s->placed) unlink(s->temporary);
    if (failed && s->placed && s->kept) rename(s->kept, s->target);
    else if (failed && s->placed && !s->replaces) unlink(s->target);
    else if (s->kept) unlink(s->kept);
    free_staged(s);
}

SltStatus file_write_atomic(const char *path, const void *data, size_t size, SltError *err) {
    struct stat st;
    int code;
    bool exists = stat(path, &st) == 0;
    if (exists && S_ISDIR(st.st_mode)) return status_fail(err, SLT_OUTPUT, "cannot write '%s': it is a folder", path);
    if (exists && !S_ISREG(st.st_mode)) return write_special(path, data, size, err);
    Staged *s = stage(path, exists ? &st : NULL, data, size, &code);
    if (!s) return status_fail_errno(err, SLT_OUTPUT, code, "cannot write '%s'", path);
    if (!group) {
        SltStatus status = put_in_place(s, err);
        settle(s, status != SLT_OK);
        return status;
    }
    *group->last = s, group->last = &s->next;
    return SLT_OK;
}

void file_group_begin(FileGroup *g) {
    *g = (FileGroup){.last = &g->first};
    group = g;
}

SltStatus file_group_end(FileGroup *g, SltStatus status, SltError *err) {
    group = NULL;
    for (Staged *s = g->first; s && s->next && status == SLT_OK; s = s->next) status = keep_old(s, err);
    for (Staged *s = g->first; s && status == SLT_OK; s = s->next) status = put_in_place(s, err);
    for (Staged *s = g->first, *next; s; s = next) {
        next = s->next;
        settle(s, status != SLT_OK);
    }
    *g = (FileGroup){0};
    return status;
}
