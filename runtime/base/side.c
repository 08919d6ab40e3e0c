#include "runtime/base/side.h"

#include <stdlib.h>

#include "runtime/base/threads.h"

/* Seconds for which a thread looks again and again whether the other one is done, before it lets the system wake it:
 * that takes some 50 us of a virtual machine, whose processor has stopped. */
#define LOOKS 1e-4

/* One piece of work that waits, or its end; the lock is held, but not meanwhile. */
static void do_one(Side *s, SideWork *w) {
    s->first = w->next, w->state = SIDE_RUNS;
    pthread_mutex_unlock(&s->lock);
    w->run(w->arg);
    pthread_mutex_lock(&s->lock);
    w->state = SIDE_DONE;
}

/* A heap that grows locks the map of memory, which the other thread waits for at every new page. */
static void make_room(size_t bytes) {
    void *volatile p = bytes ? malloc(bytes) : NULL; /* or the compiler knows better */
    free(p);
}

static void *work(void *arg) {
    Side *s = arg;
    make_room(s->room);
    pthread_mutex_lock(&s->lock);
    for (;;) {
        SideWork *w = s->first;
        if (!w && s->over) break;
        if (!w) {
            pthread_cond_wait(&s->changed, &s->lock);
            continue;
        }
        do_one(s, w);
        pthread_cond_broadcast(&s->changed);
    }
    pthread_mutex_unlock(&s->lock);
    return NULL;
}

void side_begin(Side *s, bool may, size_t room) {
    *s = (Side){.may = may, .room = room};
    pthread_mutex_init(&s->lock, NULL);
    pthread_cond_init(&s->changed, NULL);
}

static SideWork **place_of(Side *s, const SideWork *w) {
    SideWork **at = &s->first;
    while (*at && *at != w) at = &(*at)->next;
    return at;
}

static void put(Side *s, SideWork *w) {
    SideWork **at = &s->first;
    while (*at && (*at)->yields <= w->yields) at = &(*at)->next;
    w->next = *at, *at = w;
    w->state = SIDE_WAITS;
}

bool side_add(Side *s, SideWork *w) {
    w->state = SIDE_NONE;
    if (!s || !s->may) return false;
    pthread_mutex_lock(&s->lock);
    put(s, w);
    if (!s->lives) s->lives = !pthread_create(&s->thread, NULL, work, s);
    s->may = s->lives;
    if (!s->lives) s->first = NULL, w->state = SIDE_NONE;
    const bool lives = s->lives;
    pthread_cond_broadcast(&s->changed);
    pthread_mutex_unlock(&s->lock);
    return lives;
}

static void pause_shortly(void) {
#if defined(__x86_64__)
    __builtin_ia32_pause();
#endif
}

/* The lock is held, but not meanwhile. */
static void look_for(Side *s, const SideWork *w) {
    pthread_mutex_unlock(&s->lock);
    for (const double until = pool_now() + LOOKS; w->state == SIDE_RUNS && pool_now() < until;) pause_shortly();
    pthread_mutex_lock(&s->lock);
}

void side_finish(Side *s, SideWork *w) {
    if (!s) return;
    pthread_mutex_lock(&s->lock);
    const bool here = w->state == SIDE_WAITS;
    if (here) *place_of(s, w) = w->next, w->state = SIDE_NONE;
    while (w->state == SIDE_RUNS && s->first) do_one(s, s->first);
    if (w->state == SIDE_RUNS) look_for(s, w);
    while (w->state == SIDE_RUNS) pthread_cond_wait(&s->changed, &s->lock);
    w->state = SIDE_NONE;
    pthread_mutex_unlock(&s->lock);
    if (here) w->run(w->arg);
}

void side_last(Side *s) {
    if (!s || !s->lives) return;
    pthread_mutex_lock(&s->lock);
    s->may = false, s->over = true;
    pthread_cond_broadcast(&s->changed);
    pthread_mutex_unlock(&s->lock);
}

void side_end(Side *s) {
    if (s->lives) {
        pthread_mutex_lock(&s->lock);
        s->over = true, s->first = NULL;
        pthread_cond_broadcast(&s->changed);
        pthread_mutex_unlock(&s->lock);
        pthread_join(s->thread, NULL);
    }
    pthread_cond_destroy(&s->changed);
    pthread_mutex_destroy(&s->lock);
}
