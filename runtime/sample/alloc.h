/* Zeroed memory; never NULL for want of a size. */
#ifndef SALTUS_SAMPLE_ALLOC_H
#define SALTUS_SAMPLE_ALLOC_H

#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

static inline void *alloc_zero(size_t n, size_t size) { return calloc(n ? n : 1, size ? size : 1); }

enum { ALLOC_PAGE = 4096, ALLOC_FEW = 4 * ALLOC_PAGE };

/* Before memory is written from end to end: the system gives its pages in one go. One by one as each is touched takes
 * twice as long, and twice that where it is read first: then it is a page of zeros that all share, until it is written,
 * and other threads are told that it has moved. */
static inline void alloc_pages(void *p, size_t bytes) {
#ifdef MADV_POPULATE_WRITE
    const uintptr_t from = ((uintptr_t)p + ALLOC_PAGE - 1) / ALLOC_PAGE * ALLOC_PAGE,
                    end = ((uintptr_t)p + bytes) / ALLOC_PAGE * ALLOC_PAGE;
    if (bytes >= ALLOC_FEW) madvise((void *)from, end - from, MADV_POPULATE_WRITE); /* where the system can */
#endif
    (void)p, (void)bytes;
}

/* Zeroed memory of which little may be written: its pages are given back to the system, which gives those that are
 * touched. calloc clears all that is not fresh, and takes for used what a heap has in store. */
static inline void *alloc_sparse(size_t n, size_t size) {
    const size_t bytes = n * size;
    unsigned char *p = bytes < ALLOC_FEW ? NULL : malloc(bytes);
    if (!p) return alloc_zero(n, size);
#if defined(__linux__)
    const size_t before = -(uintptr_t)p % ALLOC_PAGE, inner = (bytes - before) / ALLOC_PAGE * ALLOC_PAGE;
    if (!madvise(p + before, inner, MADV_DONTNEED)) {
        memset(p, 0, before), memset(p + before + inner, 0, bytes - before - inner);
        return p;
    }
#endif
    return memset(p, 0, bytes);
}

/* Zeroed memory that is written from end to end. */
static inline void *alloc_dense(size_t n, size_t size) {
    const size_t bytes = n * size;
    if (bytes < ALLOC_FEW) return alloc_zero(n, size);
    void *p = malloc(bytes);
    if (p) alloc_pages(p, bytes), memset(p, 0, bytes);
    return p;
}

#endif
