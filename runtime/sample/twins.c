/* Sites whose g are one at these parameters, though others move them: those of d < a and d < b where a = b. Which may
 * be the compiler says (compiler/pass/twins.c); here their g are compared, at a few places of the domain, whatever the
 * program decides there. What is one boundary everywhere the program may ask for in one order only, and then neither
 * hashes nor f tell of the other: so crossings of such sites are untied all the same (coincide.c). */
#include <float.h>
#include <math.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/run.h"

enum { PLACES = 4 };
#define ROUNDING 16 /* units in the last place of the largest g */

static void take(Batch *b, uint32_t site, double g[PLACES]) {
    static const double part[3] = {0.7548776662466927, 0.5698402909980532, 0.3819660112501051};
    Event e = {.site = (int32_t)site};
    b->args.site = e.site;
    for (uint32_t i = 0; i < PLACES; i++) {
        double x[3] = {0};
        for (uint32_t d = 0; d < b->s->dim; d++)
            x[d] = b->s->lo[d] + (b->s->hi[d] - b->s->lo[d]) * fmod(part[d] * (1 + i), 1);
        batch_set_x(b, i, x);
        batch_set_stream(b, i, 0, 0);
        batch_set_event(b, i, &e);
    }
    batch_call(b, SLT_K_SITE, PLACES);
    for (uint32_t i = 0; i < PLACES; i++) g[i] = batch_get(b, SLT_OUT_G, 0, i);
}

/* At all places where they are numbers? */
static bool are_one(const double g[PLACES], const double h[PLACES], double times, double unit) {
    double size = 0, apart = 0;
    bool any = false;
    for (uint32_t i = 0; i < PLACES; i++) {
        double by = fabs(h[i] - times * g[i]);
        if (!isfinite(by)) continue;
        any = true, apart = fmax(apart, by), size = fmax(size, fabs(h[i]));
    }
    return any && apart <= ROUNDING * unit * size;
}

bool twins_begin(Run *r) {
    const SltScene *s = r->s;
    Batch *b = &r->worker[0].batch;
    const SltCullList *lists = b->args.cull;
    if (r->tied_known || !s->ntwins) return true;
    double g[PLACES] = {0}, h[PLACES] = {0}, unit = s->f64 ? DBL_EPSILON : (double)FLT_EPSILON;
    uint8_t *tied = alloc_zero(s->nsites, 1);
    bool any = false;
    if (!tied) return false;
    b->args.cull = NULL;
    for (uint32_t t = 0, of = UINT32_MAX; t < s->ntwins; t++) {
        const SltTwins *w = &s->twins[t];
        if (w->site[1] != of) take(b, of = w->site[1], h);
        take(b, w->site[0], g);
        if (!are_one(g, h, w->times, unit)) continue;
        any = true;
        for (int i = 0; i < 2; i++) tied[w->site[i]] |= w->times > 0 ? TWINS_ALIKE : TWINS_OPPOSED;
    }
    b->args.cull = lists;
    if (any) r->tied = tied;
    else free(tied);
    r->tied_known = true;
    return true;
}
