/* Tiles on threads.
 *
 * A call runs tiles 0 .. n-1: `work` on any thread, `merge` one at a time in the order of the tiles, so what is added
 * up in `merge` has the same bits for any number of threads. Results live in the worker between the two: memory is
 * bounded by the number of workers, not of tiles. Tiles are handed out in order; a thread whose tile's turn has not
 * come leaves it to whoever merges the one before and goes on with another worker, or waits where there is none. */
#ifndef SALTUS_RUNTIME_BASE_THREADS_H
#define SALTUS_RUNTIME_BASE_THREADS_H

#include <stdbool.h>
#include <stdint.h>

#include "runtime/base/status.h"

typedef struct PoolOptions {
    uint32_t threads;           /* 1 or more */
    uint32_t workers;           /* worker indices are 0 .. workers - 1, or threads - 1 if that is more */
    double deadline;            /* by pool_now(); 0: none. Status SLT_LIMIT */
    volatile const int *cancel; /* may be NULL; non-zero: stop before the next tile. Status SLT_INTERRUPTED */
    void (*progress)(void *user, double fraction);
    void *progress_user;
    double from, to; /* what `progress` gets as this call begins and ends: parts of the whole job */
} PoolOptions;

/* false: memory ran out; pool_run ends with SLT_LIMIT. */
typedef bool PoolWork(void *user, uint32_t worker, uint64_t tile);
typedef void PoolMerge(void *user, uint32_t worker, uint64_t tile);

/* Seconds on a clock that never goes back. */
double pool_now(void);
/* Threads to use when `wanted` are asked for (0: one a core), at most one a tile. */
uint32_t pool_threads(uint32_t wanted, uint64_t tiles);
/* Why the tiles must stop now; SLT_OK: they need not. For work that may be long: what it leaves undone is not asked
 * for, since the pool ends with this status. */
SltStatus pool_stop_reason(const PoolOptions *o);
/* Runs all tiles, some on the calling thread. err may be NULL. Returns after every thread has ended, whatever
 * happened. */
SltStatus pool_run(const PoolOptions *o, uint64_t tiles, PoolWork *work, PoolMerge *merge, void *user, SltError *err);

#endif
