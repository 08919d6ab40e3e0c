/* Whole files in and out. */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE
#endif
#include "internal.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

enum { HOLE_LIMIT = 64 << 20 }; /* bytes of a file that may be holes */

bool image_bytes_reserve(Bytes *b, size_t capacity) {
    if (b->failed) return false;
    if (capacity > b->capacity) {
        size_t grown = b->capacity + b->capacity / 2 + 256;
        grown = grown < capacity ? capacity : grown;
        uint8_t *p = realloc(b->data, grown);
        if (!p) {
            b->failed = true;
            return false;
        }
        b->data = p;
        b->capacity = grown;
    }
    return true;
}

void image_bytes_write_at(Bytes *b, size_t offset, const void *data, size_t size) {
    if (size > SIZE_MAX - offset || !image_bytes_reserve(b, offset + size)) {
        b->failed = true;
        return;
    }
    if (offset > b->size) memset(b->data + b->size, 0, offset - b->size);
    if (size) memcpy(b->data + offset, data, size);
    if (offset + size > b->size) b->size = offset + size;
}

void image_bytes_append(Bytes *b, const void *data, size_t size) { image_bytes_write_at(b, b->size, data, size); }

void image_bytes_printf(Bytes *b, const char *fmt, ...) {
    char small[256];
    va_list args, again;
    va_start(args, fmt);
    va_copy(again, args);
    int n = vsnprintf(small, sizeof small, fmt, args);
    va_end(args);
    if (n < 0) {
        b->failed = true;
    } else if ((size_t)n < sizeof small) {
        image_bytes_append(b, small, (size_t)n);
    } else if (image_bytes_reserve(b, b->size + (size_t)n + 1)) {
        vsnprintf((char *)b->data + b->size, (size_t)n + 1, fmt, again);
        b->size += (size_t)n;
    }
    va_end(again);
}

void image_bytes_free(Bytes *b) {
    free(b->data);
    *b = (Bytes){0};
}

/* What a path names that is no file of bytes; NULL for a regular file. */
static const char *describe_kind(mode_t mode) {
    return S_ISREG(mode)    ? NULL
           : S_ISDIR(mode)  ? "it is a folder"
           : S_ISFIFO(mode) ? "it is a pipe, and a file is wanted"
           : S_ISSOCK(mode) ? "it is a socket, and a file is wanted"
                            : "it is a device, and a file is wanted";
}

/* 0, or an errno value; *got: how much there was. */
static int read_fully(int fd, uint8_t *to, size_t size, size_t *got) {
    *got = 0;
    while (*got < size) {
        ssize_t n = read(fd, to + *got, size - *got);
        if (n == 0) break;
        if (n > 0) *got += (size_t)n;
        else if (errno != EINTR) return errno;
    }
    return 0;
}

int file_open_regular(const char *path, size_t *size, const char **why) {
    struct stat st;
    /* The other end of a pipe may never come: to open it must not wait either. */
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
    *why = NULL;
    if (fd < 0 || fstat(fd, &st) != 0) {
        *why = errno == ENXIO ? describe_kind(S_IFSOCK) : strerror(errno);
    } else {
        *why = describe_kind(st.st_mode);
        double stored = 512.0 * (double)st.st_blocks;
        if (!*why && (double)st.st_size - stored > HOLE_LIMIT)
            *why = "it is sparse: most of the bytes that it claims are not there";
        *size = *why ? 0 : (size_t)st.st_size;
    }
    if (!*why) return fd;
    if (fd >= 0) close(fd);
    return -1;
}

const FileKind file_binary = {.limit = INT_MAX};
const FileKind file_text = {.limit = 64 << 20};

SltStatus file_read_all(const char *path, const FileKind *kind, uint8_t **bytes, size_t *size, SltError *err) {
    size_t claimed = 0;
    const char *why;
    *bytes = NULL;
    *size = 0;
    int fd = file_open_regular(path, &claimed, &why);
    if (fd < 0) return status_fail(err, SLT_INPUT, "cannot read '%s': %s", path, why);
    if (claimed > kind->limit) {
        close(fd);
        return status_fail(err, SLT_LIMIT, "cannot read '%s': larger than %zu MiB", path, (kind->limit >> 20) + 1);
    }
    uint8_t head[sizeof kind->magic], *data = NULL;
    size_t known = strlen(kind->magic), got = 0;
    int code = read_fully(fd, head, known, &got);
    SltStatus status = SLT_OK;
    if (code) {
        status = status_fail_errno(err, SLT_INPUT, code, "cannot read '%s'", path);
    } else if (got < known || memcmp(head, kind->magic, known) != 0) {
        status = status_fail(err, SLT_INPUT, "cannot read '%s': it is not %s", path, kind->name);
    } else if (!(data = malloc(claimed + 1))) {
        status = status_fail(err, SLT_LIMIT, "cannot read '%s': out of memory", path);
    } else {
        memcpy(data, head, known);
        code = read_fully(fd, data + known, claimed - known, &got); /* what is added meanwhile is not read */
        if (code) status = status_fail_errno(err, SLT_INPUT, code, "cannot read '%s'", path);
    }
    close(fd);
    if (status != SLT_OK) {
        free(data);
        return status;
    }
    data[known + got] = 0;
    *bytes = data;
    *size = known + got;
    return SLT_OK;
}

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

/* A file beside the target that no other process has; its mode follows the umask, which mkstemp's
 * does not. */
static int open_temporary(const char *target, char **name) {
    size_t room = strlen(target) + 40;
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
        snprintf(*name, room, "%s.%08x.tmp", target, (unsigned)(salt >> 32));
        int fd = open(*name, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
        if (fd >= 0 || errno != EEXIST) return fd;
    }
    return -1;
}

static void sync_folder_of(const char *target) {
    char *folder = strdup(target);
    if (!folder) return;
    char *slash = strrchr(folder, '/');
    if (slash == folder) slash[1] = 0;
    else if (slash) *slash = 0;
    int fd = open(slash ? folder : ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd >= 0) {
        sync_file(fd); /* the file is already whole; a folder that cannot be synced is no reason to
                          fail */
        close(fd);
    }
    free(folder);
}

SltStatus file_write_atomic(const char *path, const void *data, size_t size, SltError *err) {
    struct stat st;
    bool exists = stat(path, &st) == 0;
    if (exists && S_ISDIR(st.st_mode)) return status_fail(err, SLT_OUTPUT, "cannot write '%s': it is a folder", path);
    if (exists && !S_ISREG(st.st_mode)) return write_special(path, data, size, err);
    char *real = exists ? realpath(path, NULL) : NULL; /* replace what a link points to, not the link */
    const char *target = real ? real : path;
    char *temporary = NULL;
    int fd = open_temporary(target, &temporary);
    int code = fd < 0 ? errno : 0;
    if (!code && exists && fchmod(fd, st.st_mode & 07777) != 0) code = 0; /* some file systems have no modes */
    if (!code) code = write_fully(fd, data, size);
    if (!code) code = sync_file(fd);
    if (fd >= 0 && close(fd) != 0 && !code) code = errno;
    if (!code && rename(temporary, target) != 0) code = errno;
    if (code && fd >= 0) unlink(temporary);
    if (!code) sync_folder_of(target);
    free(temporary);
    free(real);
    return code ? status_fail_errno(err, SLT_OUTPUT, code, "cannot write '%s'", path) : SLT_OK;
}

SltStatus image_bytes_save(Bytes *b, const char *path, SltStatus filled, SltError *err) {
    SltStatus status = filled;
    if (status == SLT_OK && b->failed) status = status_fail(err, SLT_LIMIT, "cannot write '%s': out of memory", path);
    if (status == SLT_OK) status = file_write_atomic(path, b->data, b->size, err);
    image_bytes_free(b);
    return status;
}
