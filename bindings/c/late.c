/* Kernels compiled when they are first called. The call may come from any thread of an estimate, and until it is over
 * the others find what they call here; then it lies in the scene as all do. While an estimate runs nobody else uses the
 * session. */
#include <string.h>

#include "bindings/c/api.h"

bool api_late_any(const SltProgram *p, const bool needs[K_KINDS]) {
    for (uint32_t i = 0; i < p->late.n; i++)
        if (needs[p->late.kind[i]]) return true;
    return false;
}

static void compile_body(Session *s, void *program) {
    SltProgram *p = program;
    LateKernels *l = &p->late;
    l->module = api_compile_module(p, s, l->request, l->n, l->few, l->plain, l->level, &l->error);
    for (uint32_t i = 0; i < l->n && l->module; i++)
        l->kernel[l->kind[i]] = back_kernel(l->module, kernel_names[l->kind[i]]);
}

/* Under the lock, or where there is one thread. What could not be compiled is not tried again. */
static SltStatus compile(SltProgram *p) {
    LateKernels *l = &p->late;
    if (!l->n) return l->error.status;
    int unwound = session_protect(p->session, compile_body, p);
    if (unwound) status_fail(&l->error, (SltStatus)unwound, "%s", p->session->unwind_text);
    l->n = 0, l->few = l->plain = 0;
    return l->error.status;
}

SltKernel *api_late_make(void *program, int kind) {
    SltProgram *p = program;
    LateKernels *l = &p->late;
    pthread_mutex_lock(&l->lock);
    SltStatus status = compile(p);
    if (status != SLT_OK && p->error.status == SLT_OK) p->error = l->error;
    /* Above many sites `site_grad` serves for `site`. */
    SltKernel *k = l->kernel[kind == K_SITE && !l->kernel[kind] ? K_SITE_GRAD : kind];
    pthread_mutex_unlock(&l->lock);
    return k;
}

void api_late_settle(SltProgram *p) {
    LateKernels *l = &p->late;
    if (!l->module) return;
    for (int k = 0; k < K_KINDS; k++)
        if (l->kernel[k]) p->scene.kernel[k] = l->kernel[k], p->module_of[k] = l->module, l->kernel[k] = NULL;
    if (p->scene.kernel[K_SITE] == slt_kernel_late) p->scene.kernel[K_SITE] = p->scene.kernel[K_SITE_GRAD];
    l->module = NULL;
}

SltStatus api_late_compile(SltProgram *p, SltError *err) {
    SltStatus status = compile(p);
    if (status != SLT_OK) return status_fail(err, status, "%s", p->late.error.text);
    api_late_settle(p);
    return SLT_OK;
}

void api_late_free(SltProgram *p) {
    LateKernels *l = &p->late;
    l->n = 0, l->few = l->plain = 0, l->module = NULL, l->error = (SltError){0};
    memset(l->kernel, 0, sizeof l->kernel);
}
