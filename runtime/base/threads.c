#include "runtime/base/threads.h"

#include <pthread.h>
#include <sched.h>
#include <time.h>
#include <unistd.h>

enum { POOL_MAX = 256 };

/* Of the tiles from `merged` on, which are worked on or wait for their turn, each has a worker of its own: there are no
 * more of them than workers, and their numbers modulo that tell them apart. */
typedef struct Pool {
    const PoolOptions *o;
    uint64_t tiles, next, merged; /* under lock, as is all below */
    PoolWork *work;
    PoolMerge *merge;
    void *user;
    SltStatus status; /* why the tiles stopped: the first reason */
    uint32_t workers, nfree;
    uint32_t free[POOL_MAX]; /* [nfree]: workers without a tile, the next one last */
    uint32_t by[POOL_MAX];   /* by tile: the worker that has worked on it, */
    bool done[POOL_MAX];     /* if it waits for its turn */
    bool merging;            /* some thread is */
    pthread_mutex_t lock;
    pthread_cond_t turn;
} Pool;

double pool_now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Those that the process may run on, which the system knows at once; to count those that are there takes a file. */
static uint32_t cores(void) {
    cpu_set_t set;
    if (!sched_getaffinity(0, sizeof set, &set)) return (uint32_t)CPU_COUNT(&set);
    const long n = sysconf(_SC_NPROCESSORS_ONLN);
    return n > 0 ? (uint32_t)n : 1;
}

uint32_t pool_threads(uint32_t wanted, uint64_t tiles) {
    if (tiles <= 1) return 1;
    if (!wanted) wanted = cores();
    if (wanted > POOL_MAX) wanted = POOL_MAX;
    if (tiles < wanted) wanted = (uint32_t)tiles;
    return wanted;
}

SltStatus pool_stop_reason(const PoolOptions *o) {
    if (o->cancel && __atomic_load_n(o->cancel, __ATOMIC_RELAXED)) return SLT_INTERRUPTED;
    if (o->deadline > 0 && pool_now() > o->deadline) return SLT_LIMIT;
    return SLT_OK;
}

static void fail(Pool *p, SltStatus status) {
    if (p->status != SLT_OK) return;
    p->status = status;
    pthread_cond_broadcast(&p->turn);
}

/* Merges the tiles whose turn it is, unless another thread is at it, which then looks for more. */
static void merge_done(Pool *p) {
    while (p->status == SLT_OK && !p->merging && p->done[p->merged % p->workers]) {
        uint64_t tile = p->merged;
        uint32_t worker = p->by[tile % p->workers];
        p->merging = true;
        pthread_mutex_unlock(&p->lock);
        p->merge(p->user, worker, tile);
        pthread_mutex_lock(&p->lock);
        p->merging = p->done[tile % p->workers] = false;
        p->free[p->nfree++] = worker, p->merged = tile + 1;
        if (p->o->progress)
            p->o->progress(p->o->progress_user,
                           p->o->from + (p->o->to - p->o->from) * (double)p->merged / (double)p->tiles);
        pthread_cond_broadcast(&p->turn);
    }
}

static void *run(void *arg) {
    Pool *p = arg;
    pthread_mutex_lock(&p->lock);
    while (p->status == SLT_OK && p->next < p->tiles) {
        SltStatus stop = pool_stop_reason(p->o);
        if (stop != SLT_OK) {
            fail(p, stop);
        } else if (!p->nfree) {
            pthread_cond_wait(&p->turn, &p->lock);
        } else {
            uint64_t tile = p->next++;
            uint32_t worker = p->free[--p->nfree];
            pthread_mutex_unlock(&p->lock);
            bool ok = p->work(p->user, worker, tile);
            pthread_mutex_lock(&p->lock);
            if (!ok) fail(p, SLT_LIMIT);
            p->by[tile % p->workers] = worker, p->done[tile % p->workers] = true;
            merge_done(p);
        }
    }
    pthread_mutex_unlock(&p->lock);
    return NULL;
}

SltStatus pool_run(const PoolOptions *o, uint64_t tiles, PoolWork *work, PoolMerge *merge, void *user, SltError *err) {
    Pool p = {.o = o, .tiles = tiles, .work = work, .merge = merge, .user = user, .status = SLT_OK};
    pthread_t thread[POOL_MAX];
    uint32_t n = o->threads < 1 ? 1 : o->threads > POOL_MAX ? POOL_MAX : o->threads, started = 1;
    p.workers = o->workers > n ? o->workers : n;
    if (p.workers > POOL_MAX) p.workers = POOL_MAX;
    for (uint32_t i = p.workers; i-- > 0;) p.free[p.nfree++] = i;
    pthread_mutex_init(&p.lock, NULL);
    pthread_cond_init(&p.turn, NULL);
    /* A thread that cannot be started is done without: slower, not wrong. */
    while (started < n && !pthread_create(&thread[started], NULL, run, &p)) started++;
    run(&p);
    for (uint32_t i = 1; i < started; i++) pthread_join(thread[i], NULL);
    pthread_cond_destroy(&p.turn);
    pthread_mutex_destroy(&p.lock);
    if (p.status == SLT_OK) p.status = pool_stop_reason(o); /* the last tile may have been cut short */
    if (p.status == SLT_INTERRUPTED) return status_fail(err, p.status, "interrupted");
    if (p.status == SLT_LIMIT)
        return status_fail(err, p.status,
                           o->deadline > 0 && pool_now() > o->deadline ? "the time limit was reached"
                                                                       : "out of memory");
    return SLT_OK;
}
