#include "runtime/base/side.h"

#include <stddef.h>

static void *work(void *arg) {
    Side *s = arg;
    pthread_mutex_lock(&s->lock);
    for (;;) {
        SideWork *w = s->first;
        if (!w && s->over) break;
        if (!w) {
            pthread_cond_wait(&s->changed, &s->lock);
            continue;
        }
        s->first = w->next, w->state = SIDE_RUNS;
        pthread_mutex_unlock(&s->lock);
        w->run(w->arg);
        pthread_mutex_lock(&s->lock);
        w->state = SIDE_DONE;
        pthread_cond_broadcast(&s->changed);
    }
    pthread_mutex_unlock(&s->lock);
    return NULL;
}

void side_begin(Side *s, bool may) {
    *s = (Side){.may = may};
    pthread_mutex_init(&s->lock, NULL);
    pthread_cond_init(&s->changed, NULL);
}

static SideWork **place_of(Side *s, const SideWork *w) {
    SideWork **at = &s->first;
    while (*at && *at != w) at = &(*at)->next;
    return at;
}

bool side_add(Side *s, SideWork *w) {
    w->state = SIDE_NONE, w->next = NULL;
    if (!s || !s->may) return false;
    pthread_mutex_lock(&s->lock);
    *place_of(s, NULL) = w, w->state = SIDE_WAITS;
    if (!s->lives) s->lives = !pthread_create(&s->thread, NULL, work, s);
    s->may = s->lives;
    if (!s->lives) s->first = NULL, w->state = SIDE_NONE;
    const bool lives = s->lives;
    pthread_cond_broadcast(&s->changed);
    pthread_mutex_unlock(&s->lock);
    return lives;
}

void side_finish(Side *s, SideWork *w) {
    if (!s) return;
    pthread_mutex_lock(&s->lock);
    const bool here = w->state == SIDE_WAITS;
    if (here) *place_of(s, w) = w->next, w->state = SIDE_NONE;
    while (w->state == SIDE_RUNS) pthread_cond_wait(&s->changed, &s->lock);
    w->state = SIDE_NONE;
    pthread_mutex_unlock(&s->lock);
    if (here) w->run(w->arg);
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
