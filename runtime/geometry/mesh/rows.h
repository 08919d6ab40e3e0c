/* Rows of things that grow and are used again: of a thread's store, whose memory stays with the thread. */
#ifndef SALTUS_MESH_ROWS_H
#define SALTUS_MESH_ROWS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { ROWS_MOST = 1 << 24 };

#define ROW(type) \
    struct { \
        type *data; \
        uint32_t n, room; \
    }

/* Room for one more; false: there is none. data: points at the pointer. */
static inline bool row_room(void *data, uint32_t n, uint32_t *capacity, size_t size) {
    void *old;
    if (n < *capacity) return true;
    uint32_t want = *capacity ? 2 * *capacity : 64;
    memcpy(&old, data, sizeof old);
    void *fresh = want <= ROWS_MOST ? realloc(old, want * size) : NULL;
    if (!fresh) return false;
    memcpy(data, &fresh, sizeof fresh);
    *capacity = want;
    return true;
}

/* Whether there was memory. */
#define ROW_ADD(row, value) \
    (row_room(&(row).data, (row).n, &(row).room, sizeof *(row).data) ? ((row).data[(row).n++] = (value), true) : false)

#endif
