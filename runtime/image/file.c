/* Growing byte buffers, and whole files in. */
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

/* A byte of value 0 would end what follows it unread. */
static SltStatus refuse_zero(const char *path, const uint8_t *data, size_t size, SltError *err) {
    const uint8_t *zero = memchr(data, 0, size);
    size_t line = 1, column = 1;
    if (!zero) return SLT_OK;
    for (const uint8_t *c = data; c < zero; c++) line += *c == '\n', column = *c == '\n' ? 1 : column + 1;
    return status_fail(err, SLT_INPUT, "%s:%zu:%zu: a byte of value 0, which no text has", path, line, column);
}

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
    if (status == SLT_OK && kind == &file_text) status = refuse_zero(path, data, known + got, err);
    if (status != SLT_OK) {
        free(data);
        return status;
    }
    data[known + got] = 0;
    *bytes = data;
    *size = known + got;
    return SLT_OK;
}

SltStatus image_bytes_save(Bytes *b, const char *path, SltStatus filled, SltError *err) {
    SltStatus status = filled;
    if (status == SLT_OK && b->failed) status = status_fail(err, SLT_LIMIT, "cannot write '%s': out of memory", path);
    if (status == SLT_OK) status = file_write_atomic(path, b->data, b->size, err);
    image_bytes_free(b);
    return status;
}
