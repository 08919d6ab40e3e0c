/* Kernels compiled when they are first called. The call may come from any thread of an estimate, and until it is over
 * the others find what they call here; then it lies in the scene as all do. While an estimate runs nobody else uses the
 * session. */
#include <string.h>

#include "bindings/c/api.h"

/* Some of those that wait, as one module. */
typedef struct Some {
    SltProgram *p;
    KernelRequest request[K_KINDS];
    SltKernelKind kind[K_KINDS];
    uint32_t n, width; /* width: 0: as all have it */
    uint64_t few, plain;
} Some;

/* What is compiled in one go. */
typedef enum Share { SHARE_LINES, SHARE_VALUE, SHARE_GUARDED, SHARES } Share;
static Share share_of(int kind) {
    return kind == K_VALUE ? SHARE_VALUE : kind == K_VJP_GUARDED ? SHARE_GUARDED : SHARE_LINES;
}

static void compile_body(Session *s, void *some) {
    Some *q = some;
    LateKernels *l = &q->p->late;
    bool missing[K_KINDS] = {false}, any = false;
    for (uint32_t i = 0; i < q->n; i++) any |= missing[q->kind[i]] = !q->request[i].fn;
    /* Lines and values are the same whatever is differentiated. */
    if (any) api_missing(q->p, missing, missing[K_VJP_GUARDED] ? q->p->wrt : NULL);
    for (uint32_t i = 0; i < q->n; i++)
        if (missing[q->kind[i]]) q->request[i].fn = q->p->fn[q->kind[i]];
    CompiledModule *m = api_compile_module(q->p, s, q->request, q->n, q->few, q->plain, l->level, q->width, &l->error);
    for (uint32_t i = 0; i < q->n && m; i++)
        l->kernel[q->kind[i]] = back_kernel(m, kernel_names[q->kind[i]]), l->module[q->kind[i]] = m;
}

/* Takes those of a share out. */
static void take(LateKernels *l, Share share, Some *to) {
    uint32_t left = 0;
    uint64_t few = 0, plain = 0;
    for (uint32_t i = 0; i < l->n; i++) {
        const bool of = share_of((int)l->kind[i]) == share;
        const uint64_t is_few = l->few >> i & 1, is_plain = l->plain >> i & 1;
        if (of) {
            to->few |= is_few << to->n, to->plain |= is_plain << to->n;
            to->kind[to->n] = l->kind[i], to->request[to->n++] = l->request[i];
            continue;
        }
        few |= is_few << left, plain |= is_plain << left;
        l->kind[left] = l->kind[i], l->request[left++] = l->request[i];
    }
    l->n = left, l->few = few, l->plain = plain;
}

/* Under the lock, or where there is one thread. What could not be compiled is not tried again. */
static SltStatus compile(SltProgram *p, Share share) {
    LateKernels *l = &p->late;
    Some some = {.p = p, .width = share == SHARE_GUARDED ? l->guarded_lanes : 0};
    take(l, share, &some);
    if (!some.n) return l->error.status;
    int unwound = session_protect(p->session, compile_body, &some);
    if (unwound) status_fail(&l->error, (SltStatus)unwound, "%s", p->session->unwind_text);
    return l->error.status;
}

SltKernel *api_late_make(void *program, int kind) {
    SltProgram *p = program;
    LateKernels *l = &p->late;
    pthread_mutex_lock(&l->lock);
    SltStatus status = compile(p, share_of(kind));
    if (status != SLT_OK && p->error.status == SLT_OK) p->error = l->error;
    /* Above many sites `site_grad` serves for `site`. */
    SltKernel *k = l->kernel[kind == K_SITE && !l->kernel[kind] ? K_SITE_GRAD : kind];
    pthread_mutex_unlock(&l->lock);
    return k;
}

void api_late_settle(SltProgram *p) {
    LateKernels *l = &p->late;
    bool sites = l->kernel[K_SITE_GRAD] != NULL;
    for (int k = 0; k < K_KINDS; k++)
        if (l->kernel[k]) p->scene.kernel[k] = l->kernel[k], p->module_of[k] = l->module[k], l->kernel[k] = NULL;
    if (sites && p->scene.kernel[K_SITE] == slt_kernel_late) p->scene.kernel[K_SITE] = p->scene.kernel[K_SITE_GRAD];
}

SltStatus api_late_compile(SltProgram *p, const bool needs[K_KINDS], const bool *late, SltError *err) {
    bool any[SHARES] = {false};
    for (uint32_t i = 0; i < p->late.n; i++) {
        const SltKernelKind k = p->late.kind[i];
        any[share_of((int)k)] |= needs[k] && !(late && late[k]);
    }
    for (int share = 0; share < SHARES; share++) {
        SltStatus status = any[share] ? compile(p, (Share)share) : SLT_OK;
        if (status != SLT_OK) return status_fail(err, status, "%s", p->late.error.text);
    }
    api_late_settle(p);
    return SLT_OK;
}

void api_late_drop_guarded(SltProgram *p) {
    Some dropped = {.p = p};
    take(&p->late, SHARE_GUARDED, &dropped);
}

void api_late_free(SltProgram *p) {
    LateKernels *l = &p->late;
    l->n = 0, l->few = l->plain = 0, l->error = (SltError){0};
    memset(l->kernel, 0, sizeof l->kernel);
}
