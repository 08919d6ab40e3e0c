/* Kernels of derivatives follow what is differentiated, and callers take turns: a derivative in one parameter, the
 * gradient in all. What was compiled for the last few is kept, so that turns compile nothing and cost no memory. */
#include <stdlib.h>
#include <string.h>

#include "bindings/c/api.h"

enum { KINDS = 5, KEPT = 4 };
static const int kinds[KINDS] = {K_JVP, K_VJP, K_SITE_JVP, K_SITE_VJP, K_VJP_GUARDED};

struct GradientKernels {
    uint8_t *wrt;  /* [nfloats]: what they differentiate; NULL: there are none here */
    uint64_t used; /* when they were put here: the oldest go first */
    bool tried[K_KINDS];
    bool has[KINDS];
    Fn *fn[KINDS];
    TapeReport tape[KINDS];
    SltKernel *kernel[KINDS];
    SltLayout layout[KINDS];
    CompiledModule *module[KINDS];
    uint8_t few[KINDS], level[KINDS];
    uint64_t tape_bytes;
    bool tape_grows, site_logs, rigid;
};

/* Those of the program now. Where memory is out they are not kept, and compiled again. */
static void keep(SltProgram *p) {
    GradientKernels *to = NULL;
    if (!p->turns) p->turns = calloc(KEPT, sizeof *p->turns);
    for (int i = 0; i < KEPT && p->turns; i++)
        if (!to || p->turns[i].used < to->used) to = &p->turns[i];
    if (to && !to->wrt) to->wrt = malloc(p->prog->nfloats + 1);
    if (!to || !to->wrt) return;
    memcpy(to->wrt, p->wrt, p->prog->nfloats);
    memcpy(to->tried, p->tried, sizeof to->tried);
    to->used = ++p->turn;
    for (int i = 0; i < KINDS; i++) {
        const int k = kinds[i];
        to->has[i] = p->has[k], to->fn[i] = p->fn[k], to->tape[i] = p->tape[k], to->kernel[i] = p->scene.kernel[k];
        to->layout[i] = p->scene.layout[k], to->module[i] = p->module_of[k];
        to->few[i] = p->compiled_few[k], to->level[i] = p->compiled_level[k];
    }
    to->tape_bytes = p->scene.tape_bytes, to->tape_grows = p->scene.tape_grows;
    to->site_logs = p->scene.site_logs, to->rigid = p->scene.rigid;
}

static void take(SltProgram *p, const GradientKernels *from) {
    for (int k = 0; k < K_KINDS; k++) p->tried[k] |= from->tried[k];
    for (int i = 0; i < KINDS; i++) {
        const int k = kinds[i];
        p->has[k] = from->has[i], p->fn[k] = from->fn[i], p->tape[k] = from->tape[i],
        p->scene.kernel[k] = from->kernel[i];
        p->scene.layout[k] = from->layout[i], p->module_of[k] = from->module[i];
        p->compiled_few[k] = from->few[i], p->compiled_level[k] = from->level[i];
    }
    p->scene.tape_bytes = from->tape_bytes, p->scene.tape_grows = from->tape_grows;
    p->scene.site_logs = from->site_logs, p->scene.rigid = from->rigid;
    if (p->scene.kernel[K_VJP_GUARDED] == slt_kernel_late) api_put_off_guarded(p);
}

void api_differentiate(SltProgram *p, const uint8_t *wrt) {
    const size_t n = p->prog->nfloats;
    GradientKernels *found = NULL;
    if (!memcmp(wrt, p->wrt, n)) return;
    for (int i = 0; i < KEPT && p->turns; i++)
        if (p->turns[i].used && !memcmp(p->turns[i].wrt, wrt, n)) found = &p->turns[i];
    GradientKernels back = found ? *found : (GradientKernels){0};
    if (found) found->used = 0;
    /* Arrays that are computed have derivatives of their own, which are not kept. */
    bool any = false;
    for (int i = 0; i < KINDS; i++) any |= p->has[kinds[i]];
    if (any && !p->prog->nderived) keep(p);
    api_forget_gradients(p);
    if (found) take(p, &back);
    memcpy(p->wrt, wrt, n);
}

void api_turns_forget(SltProgram *p) {
    for (int i = 0; i < KEPT && p->turns; i++) p->turns[i].used = 0;
}

void api_turns_free(SltProgram *p) {
    for (int i = 0; i < KEPT && p->turns; i++) free(p->turns[i].wrt);
    free(p->turns);
    p->turns = NULL;
}
