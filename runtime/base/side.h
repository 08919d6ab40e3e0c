/* A second thread beside the one that answers a call: it works off what it is given, in that order, while the first
 * goes on with something else. For pieces of work that are one chain each, and too short for a pool of tiles. */
#ifndef SALTUS_RUNTIME_BASE_SIDE_H
#define SALTUS_RUNTIME_BASE_SIDE_H

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>

/* The caller's, and must stay until side_finish. */
typedef struct SideWork {
    void (*run)(void *arg);
    void *arg;
    bool yields; /* all others go first */
    struct SideWork *next;
    _Atomic enum { SIDE_NONE, SIDE_WAITS, SIDE_RUNS, SIDE_DONE } state; /* written under the lock */
} SideWork;

typedef struct Side {
    size_t room;           /* bytes of the thread's heap that it takes in one go; 0: as they are asked for */
    bool may, lives, over; /* may: there is a core for it; lives: the thread was begun */
    SideWork *first;       /* that waits */
    pthread_t thread;
    pthread_mutex_t lock;
    pthread_cond_t changed;
} Side;

void side_begin(Side *s, bool may, size_t room); /* no thread so far */
/* False: there is no such thread, and the caller does the work. */
bool side_add(Side *s, SideWork *w);
/* Returns once it is done: it is done here if nobody has begun with it. Nothing where it was not added. While the
 * thread is at it, what waits behind it is done here, too. */
void side_finish(Side *s, SideWork *w);
/* Nothing will be added any more, or the caller will do it: the thread ends as soon as there is nothing to do. */
void side_last(Side *s);
/* Waits for the thread; what waits is not done. */
void side_end(Side *s);

#endif
