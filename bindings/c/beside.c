/* What is found out beside an estimate, on a thread of its own: the scale of the program, and what lines step over,
 * which are a walk of the interpreter and a search along few lines. Neither can be shared out to threads, and neither
 * needs the estimate. */
#include <pthread.h>

#include "bindings/c/place.h"
#include "runtime/base/threads.h"

static void find(Beside *b) {
    SltProgram *p = b->c->p;
    if (b->scales) {
        pthread_mutex_lock(&p->late.lock); /* whoever compiles a kernel now uses the session as well */
        api_find_scale(p, &b->own);
        pthread_mutex_unlock(&p->late.lock);
    }
    if (b->hidden) slt_estimate_hidden_look(b->hidden);
}

static void *run(void *beside) {
    find(beside);
    return NULL;
}

void api_beside_begin(Beside *b, ApiCall *c, bool hidden) {
    enum { LONG = 1 << 12 }; /* instructions of a program, of which a walk takes longer than a thread to begin */
    const SltProgram *p = c->p;
    const bool threads = pool_threads(c->job.threads, 2) > 1;
    *b = (Beside){.c = c, .own = SLT_STATS_INIT, .scales = c->stats && api_seeks_scale(c->p)};
    if (hidden && threads) b->hidden = slt_estimate_hidden_new(&p->scene, &c->job);
    if (b->hidden || (b->scales && threads && p->scene.work >= LONG))
        b->runs = !pthread_create(&b->thread, NULL, run, b);
    if (b->runs) return;
    slt_estimate_hidden_free(b->hidden);
    b->hidden = NULL;
    find(b);
}

void api_beside_wait(Beside *b) {
    if (b->runs) pthread_join(b->thread, NULL);
    b->runs = false;
    if (!b->scales) return;
    b->c->stats->out_of_range = b->own.out_of_range, b->c->stats->out_of_range_at = b->own.out_of_range_at;
    b->scales = false;
}

void api_beside_end(Beside *b) {
    if (!b->c) return;
    api_beside_wait(b);
    slt_estimate_hidden_free(b->hidden);
    *b = (Beside){0};
}
