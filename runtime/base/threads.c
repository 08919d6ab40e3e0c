#include "runtime/base/threads.h"

#include <pthread.h>
#include <time.h>
#include <unistd.h>

enum { POOL_MAX = 256 };

typedef struct Pool {
    const PoolOptions *o;
    uint64_t tiles, next, merged; /* under lock */
    PoolWork *work;
    PoolMerge *merge;
    void *user;
    SltStatus status; /* why the tiles stopped: the first reason */
    pthread_mutex_t lock;
    pthread_cond_t turn;
} Pool;

typedef struct Thread {
    Pool *pool;
    uint32_t index;
    pthread_t id;
} Thread;

double pool_now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

uint32_t pool_threads(uint32_t wanted, uint64_t tiles) {
    if (!wanted) {
        long cores = sysconf(_SC_NPROCESSORS_ONLN);
        wanted = cores > 0 ? (uint32_t)cores : 1;
    }
    if (wanted > POOL_MAX) wanted = POOL_MAX;
    if (tiles < wanted) wanted = tiles ? (uint32_t)tiles : 1;
    return wanted;
}

SltStatus pool_stop_reason(const PoolOptions *o) {
    if (o->cancel && *o->cancel) return SLT_INTERRUPTED;
    if (o->deadline > 0 && pool_now() > o->deadline) return SLT_LIMIT;
    return SLT_OK;
}

static void *run(void *arg) {
    Thread *t = arg;
    Pool *p = t->pool;
    pthread_mutex_lock(&p->lock);
    for (;;) {
        if (p->status == SLT_OK && p->next < p->tiles) {
            SltStatus stop = pool_stop_reason(p->o);
            if (stop != SLT_OK) p->status = stop, pthread_cond_broadcast(&p->turn);
        }
        if (p->status != SLT_OK || p->next >= p->tiles) break;
        uint64_t tile = p->next++;
        pthread_mutex_unlock(&p->lock);
        bool ok = p->work(p->user, t->index, tile);
        pthread_mutex_lock(&p->lock);
        if (!ok && p->status == SLT_OK) p->status = SLT_LIMIT, pthread_cond_broadcast(&p->turn);
        while (p->status == SLT_OK && p->merged != tile) pthread_cond_wait(&p->turn, &p->lock);
        if (p->status != SLT_OK) break;
        pthread_mutex_unlock(&p->lock);
        p->merge(p->user, t->index, tile);
        pthread_mutex_lock(&p->lock);
        p->merged = tile + 1;
        if (p->o->progress)
            p->o->progress(p->o->progress_user,
                           p->o->from + (p->o->to - p->o->from) * (double)p->merged / (double)p->tiles);
        pthread_cond_broadcast(&p->turn);
    }
    pthread_mutex_unlock(&p->lock);
    return NULL;
}

SltStatus pool_run(const PoolOptions *o, uint64_t tiles, PoolWork *work, PoolMerge *merge, void *user, SltError *err) {
    Pool p = {.o = o, .tiles = tiles, .work = work, .merge = merge, .user = user, .status = SLT_OK};
    Thread threads[POOL_MAX];
    uint32_t n = o->threads < 1 ? 1 : o->threads > POOL_MAX ? POOL_MAX : o->threads, started = 1;
    pthread_mutex_init(&p.lock, NULL);
    pthread_cond_init(&p.turn, NULL);
    threads[0] = (Thread){.pool = &p, .index = 0};
    /* A thread that cannot be started is done without: slower, not wrong. */
    for (; started < n; started++) {
        threads[started] = (Thread){.pool = &p, .index = started};
        if (pthread_create(&threads[started].id, NULL, run, &threads[started])) break;
    }
    run(&threads[0]);
    for (uint32_t i = 1; i < started; i++) pthread_join(threads[i].id, NULL);
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
