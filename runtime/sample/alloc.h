/* Zeroed memory; never NULL for want of a size. */
#ifndef SALTUS_SAMPLE_ALLOC_H
#define SALTUS_SAMPLE_ALLOC_H

#include <stdlib.h>

static inline void *alloc_zero(size_t n, size_t size) { return calloc(n ? n : 1, size ? size : 1); }

#endif
