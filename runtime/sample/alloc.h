/* Zeroed memory; never NULL for want of a size. */
#ifndef SALTUS_SAMPLE_ALLOC_H
#define SALTUS_SAMPLE_ALLOC_H

#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

static inline void *alloc_zero(size_t n, size_t size) { return calloc(n ? n : 1, size ? size : 1); }

/* The same, of what is written from end to end: the system gives its pages in one go. One by one as each is touched
 * takes twice as long, and twice that where it is read first: then it is a page of zeros that all share, until it is
 * written, and other threads are told that it has moved. */
static inline void *alloc_dense(size_t n, size_t size) {
    enum { PAGE = 4096, FEW = 4 * PAGE };
    const size_t bytes = n * size;
    char *p = bytes < FEW ? alloc_zero(n, size) : malloc(bytes);
    if (!p || bytes < FEW) return p;
#ifdef MADV_POPULATE_WRITE
    const uintptr_t from = ((uintptr_t)p + PAGE - 1) / PAGE * PAGE, end = ((uintptr_t)p + bytes) / PAGE * PAGE;
    madvise((void *)from, end - from, MADV_POPULATE_WRITE); /* where the system can */
#endif
    return memset(p, 0, bytes);
}

#endif
