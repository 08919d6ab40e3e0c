/* What every public function shares: one user at a time, structs of other versions, a call's own parameters, print().
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bindings/c/api.h"
#include "bindings/c/place.h"
#include "runtime/base/threads.h"

/* ---- one user at a time */
/* An address that no other living thread has. */
static const void *this_thread(void) {
    static _Thread_local char mark;
    return &mark;
}

static bool holds(const SltProgram *p) { return atomic_load(&((SltProgram *)p)->holder) == this_thread(); }
static atomic_bool *claim_of(const SltProgram *p) {
    return holds(p) ? &((SltProgram *)p)->in_fit : &((SltProgram *)p)->in_use;
}

bool api_claim(const SltProgram *p) { return !atomic_exchange(claim_of(p), true); }

void api_release(const SltProgram *p) { atomic_store(claim_of(p), false); }

SltStatus api_enter(const SltProgram *p, SltError *err) {
    if (err) *err = (SltError){0};
    if (!api_claim(p))
        return status_fail(err, SLT_USAGE,
                           "the program is in use: by another thread, or by the call whose callback asks");
    if (p->ready) return SLT_OK;
    api_release(p);
    return status_fail(err, SLT_USAGE, "the program did not compile");
}

SltStatus api_enter_to_set(const SltProgram *p, SltError *err) {
    if (!holds(p)) return api_enter(p, err);
    return status_fail(err, SLT_USAGE, "callbacks of a fit may look at its program, not change it");
}

SltStatus api_hold(SltProgram *p, SltError *err) {
    if (holds(p)) return status_fail(err, SLT_USAGE, "the fit whose callback asks is not done");
    SltStatus s = api_enter(p, err);
    if (s == SLT_OK) atomic_store(&p->holder, this_thread());
    return s;
}

void api_let_go(SltProgram *p) {
    atomic_store(&p->holder, NULL);
    api_release(p);
}

/* ---- structs that begin with their size */
enum { STRUCT_MAX = 4096 }; /* no version has one as large: the size was not set */

bool api_struct_sized(const void *theirs) {
    size_t size;
    memcpy(&size, theirs, sizeof size);
    return size >= sizeof size && size <= STRUCT_MAX;
}

bool api_struct_read(void *mine, size_t known, const void *theirs) {
    size_t size;
    memcpy(&size, theirs, sizeof size);
    if (!api_struct_sized(theirs)) return false;
    for (size_t i = known; i < size; i++)
        if (((const unsigned char *)theirs)[i]) return false;
    memcpy(mine, theirs, size < known ? size : known);
    memcpy(mine, &known, sizeof known);
    return true;
}

void api_struct_write(void *theirs, const void *mine, size_t known) {
    size_t size, head = sizeof size; /* their size stays what it is */
    memcpy(&size, theirs, sizeof size);
    memcpy((char *)theirs + head, (const char *)mine + head, (size < known ? size : known) - head);
}

SltStatus api_struct_unknown(SltError *err, const char *name) {
    return status_fail(err, SLT_USAGE, "%s is not one of this version: start from its _INIT", name);
}

/* ---- a call that samples */
/* `flt` and geometries follow the parameters of the call. The program's own come back only when a call wants them, so
 * that many calls with parameters of their own in a row change only what differs between them. */
static void take_floats(SltProgram *p, const double *floats) {
    if (!floats && !p->flt_lent) return;
    api_flt_from(p, floats ? floats : p->floats, 0, program_floats(p->prog));
    p->flt_lent = floats != NULL;
}

/* Integers of the call's own, with the meshes' behind them; *room: to be freed. */
static SltStatus take_ints(SltProgram *p, const int32_t *ints, int32_t **room, SltError *err) {
    const Program *g = p->prog;
    const size_t own = g->nints - g->ntopology;
    *room = NULL, p->lent_ints = ints;
    if (!ints || !g->ntopology) return SLT_OK;
    p->lent_ints = *room = malloc(g->nints * sizeof **room);
    if (!*room) return status_fail(err, SLT_LIMIT, "out of memory");
    memcpy(*room, ints, own * sizeof **room);
    memcpy(*room + own, p->ints + own, g->ntopology * sizeof **room);
    return SLT_OK;
}

SltStatus api_call_begin(ApiCall *c, SltProgram *p, const SltJob *job, SltStats *stats, SltError *err) {
    *c = (ApiCall){.job = SLT_JOB_INIT, .own = SLT_STATS_INIT, .err = err};
    SltStatus s = api_enter(p, err);
    if (s != SLT_OK) return s;
    c->p = p;
    p->error = (SltError){0};
    if (job && !api_struct_read(&c->job, sizeof c->job, job)) return api_struct_unknown(err, "SltJob");
    if (stats && !api_struct_read(&c->own, sizeof c->own, stats)) return api_struct_unknown(err, "SltStats");
    if (stats) c->stats = &c->own, c->theirs = stats;
    for (uint32_t d = slt_dim(p); d < 3; d++) c->job.size[d] = 1; /* those axes do not count */
    p->threads = c->job.threads;
    side_begin(&c->side, pool_threads(c->job.threads, 2) > 1, p->side_room);
    p->scene.side = &c->side;
    take_floats(p, c->job.floats);
    return take_ints(p, c->job.ints, &c->ints, err);
}

SltStatus api_call_kernels(ApiCall *c, const bool needs[K_KINDS]) {
    return api_kernels_late(c->p, needs, NULL, c->err);
}

SltStatus api_call_kernels_late(ApiCall *c, const bool needs[K_KINDS], const bool *late) {
    return api_kernels_late(c->p, needs, late, c->err);
}

SltStatus api_call_kernels_beside(ApiCall *c, const bool needs[K_KINDS], const bool soon[K_KINDS]) {
    return api_kernels_beside(c->p, needs, soon, c->err);
}

SltStatus api_call_end(ApiCall *c, SltStatus status) {
    SltProgram *p = c->p;
    if (!p) return status;
    if (p->scene.side) side_end(p->scene.side), p->scene.side = NULL;
    api_late_settle(p);
    if (status == SLT_OK && p->error.status != SLT_OK)
        status = status_fail(c->err, p->error.status, "%s", p->error.text);
    const bool lost = api_geometries_lost(p);
    if (status == SLT_OK && lost)
        status =
            status_fail(c->err, SLT_LIMIT,
                        "out of memory for the visible pieces of a mesh: at most 2^24 pieces and sides are kept for "
                        "the samples that run together, so let windows be smaller, or fewer in a loop");
    if (atomic_exchange(&p->tape_full, false) && status == SLT_OK)
        status = status_fail(c->err, SLT_LIMIT,
                             "out of memory for derivatives of a loop over pieces of a mesh: at most 1 GiB is kept of "
                             "the samples that run together, so let windows be smaller");
    if (c->stats) api_name_drops(p, c->stats), api_geometries_unmet(p, c->stats), c->stats->blind_at = (SltPlace){0};
    const uint32_t blind = api_geometries_blind(p, c->stats ? &c->stats->blind_at : NULL);
    if (c->stats) c->stats->blind = blind;
    if (c->theirs) api_struct_write(c->theirs, c->stats, sizeof *c->stats);
    p->scene.iparams = p->ints, p->lent_ints = NULL;
    free(c->ints);
    api_release(p);
    return status;
}

/* ---- print(): `{}` in the text is the next value */
static void print_line(void *user, const char *text, uint32_t len, const double *values, uint32_t n, uint32_t lane) {
    enum { NUMBER = 40 }; /* bytes: more than a number takes */
    const SltProgram *p = user;
    char line[1024];
    size_t at = 0;
    uint32_t used = 0;
    (void)lane;
    for (uint32_t i = 0; i < len && at + NUMBER < sizeof line; i++) {
        if (text[i] == '{' && i + 1 < len && text[i + 1] == '}' && used < n) {
            at += (size_t)snprintf(line + at, sizeof line - at, p->opt.f64 ? "%.17g" : "%.9g", values[used++]);
            i++;
        } else {
            line[at++] = text[i];
        }
    }
    line[at] = 0;
    p->on_print(p->on_print_user, line, values, n);
}

SltStatus slt_set_print(SltProgram *p, SltPrint *print, void *user, SltError *err) {
    SltStatus s = api_enter(p, err);
    if (s != SLT_OK) return s;
    p->on_print = print, p->on_print_user = user;
    p->print = print ? print_line : NULL, p->print_user = p;
    api_release(p);
    return SLT_OK;
}
