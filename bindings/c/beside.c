/* What is found out beside an estimate, by the call's second thread: what lines step over, which is a search along few
 * lines, or the scale of the program, a walk of the interpreter. Neither can be shared out to threads, and neither
 * needs the estimate. */
#include "bindings/c/place.h"

static void find_scale(void *beside) {
    Beside *b = beside;
    SltProgram *p = b->c->p;
    pthread_mutex_lock(&p->late.lock); /* whoever compiles a kernel now uses the session as well */
    api_find_scale(p, &b->own);
    pthread_mutex_unlock(&p->late.lock);
}

static void look(void *hidden) { slt_estimate_hidden_look(hidden); }

void api_beside_begin(Beside *b, ApiCall *c, bool hidden) {
    enum { LONG = 1 << 12 }; /* instructions of a program, of which a walk takes longer than a thread to begin */
    const SltScene *s = &c->p->scene;
    *b = (Beside){.c = c, .own = SLT_STATS_INIT, .scales = c->stats && api_seeks_scale(c->p)};
    if (hidden && s->side->may) b->hidden = slt_estimate_hidden_new(s, &c->job);
    if (b->hidden) b->look = (SideWork){.run = look, .arg = b->hidden};
    if (b->hidden && !side_add(s->side, &b->look)) slt_estimate_hidden_free(b->hidden), b->hidden = NULL;
    b->scale = (SideWork){.run = find_scale, .arg = b};
    const bool aside = b->scales && !b->hidden && s->work >= LONG && side_add(s->side, &b->scale);
    if (b->scales && !aside) find_scale(b);
}

void api_beside_wait(Beside *b) {
    if (!b->c) return;
    side_finish(b->c->p->scene.side, &b->scale), side_finish(b->c->p->scene.side, &b->look);
    if (b->scales)
        b->c->stats->out_of_range = b->own.out_of_range, b->c->stats->out_of_range_at = b->own.out_of_range_at;
    b->scales = false;
}

void api_beside_end(Beside *b) {
    api_beside_wait(b);
    slt_estimate_hidden_free(b->hidden);
    *b = (Beside){0};
}
