/* The driver of passes: runs a row of passes.def, and dumps, verifies and stops where it was asked to. */
#include "compiler/pass/pass.h"

#include <string.h>

enum { NOTHING = 0, CUSTOM = 1, CUSTOM_SITES = 2, RAND = 4, MATH = 8, DDX = 16 };
enum { FLOATS = PASS_KEEPS_FLOATS, SITES = PASS_KEEPS_SITES, SETTLES = PASS_SETTLES, MAKES = PASS_MAKES_SITES };

const PassInfo pass_info[PASS_ALL] = {
#define PASS(name, needs, ends, keeps, what) [PASS_##name] = {#name, what, name, PASS_NEEDS_##needs, ends, keeps},
#define STEP(name, what) [PASS_##name] = {#name, what, NULL, PASS_NEEDS_ANY, NOTHING, FLOATS | SITES | SETTLES},
#include "compiler/pass/passes.def"
#undef PASS
#undef STEP
};

/* ---- contracts */

/* What a Fn has of the things that contracts speak of. */
typedef struct Census {
    uint32_t sites;
    uint8_t kinds; /* CUSTOM, RAND ... */
} Census;

static Census take_census(const Block *b) {
    Census c = {0};
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_site || i->op == OP_siten) c.sites++;
        if (i->op == OP_rand) c.kinds |= RAND;
        if (i->op == OP_ghost) c.kinds |= CUSTOM;
        if (i->op == OP_ddx) c.kinds |= DDX;
        if (ir_ops[i->op].math) c.kinds |= MATH;
        for (uint32_t r = 0; r < i->nregions; r++) {
            Census below = take_census(i->region[r]);
            c.sites += below.sites;
            c.kinds |= below.kinds;
            if (i->op == OP_custom && r == 0) c.kinds |= below.sites ? CUSTOM | CUSTOM_SITES : CUSTOM;
        }
    }
    return c;
}

static void check_contract(const PassInfo *pass, const Fn *fn, Census before) {
    Census after = take_census(fn->body);
    const char *broken = NULL;
    if (after.kinds & pass->ends) broken = "leaves what it should end";
    else if (after.kinds & ~before.kinds) broken = "brings rand, [Tangent] regions or elementary functions";
    else if ((pass->keeps & SITES) && after.sites < before.sites) broken = "does not keep the sites";
    else if (!(pass->keeps & MAKES) && after.sites > before.sites) broken = "doubles a site";
    if (broken) ice(fn->session, "%s of %s %s", pass->name, fn->name, broken);
}

/* ---- points */

static bool at(PassPoint point, PassStage stage, PassId pass, const Fn *fn) {
    if (point.pass != pass && point.pass != PASS_ALL) return false;
    return !point.kernel || !strcmp(point.kernel, stage == PASS_NEEDS_PRIMAL ? "primal" : fn->name);
}

void pass_step(PassCtx *ctx, PassStage stage, Fn *fn, PassId step) {
    const char *name = pass_info[step].name;
    if (at(ctx->verify, stage, step, fn)) {
        char when[64];
        snprintf(when, sizeof when, "after %s", name);
        ir_require(fn, when);
    }
    if (at(ctx->dump, stage, step, fn)) {
        fprintf(stderr, "; after %s of %s\n", name, fn->name);
        ir_print(fn, stderr);
    }
    if (at(ctx->stop_after, stage, step, fn)) {
        printf("; after %s of %s\n", name, fn->name);
        ir_print(fn, stdout);
        session_stop(ctx->session);
    }
}

bool pass_run(PassCtx *ctx, PassStage stage, Fn *fn, PassId id) {
    const PassInfo *pass = &pass_info[id];
    if (pass->needs && pass->needs != stage) ice(ctx->session, "%s of %s runs at the wrong time", pass->name, fn->name);
    bool verify = at(ctx->verify, stage, id, fn);
    Census before = verify ? take_census(fn->body) : (Census){0};
    bool changed = pass->run(ctx, fn);
    if (verify) check_contract(pass, fn, before);
    pass_step(ctx, stage, fn, id);
    return changed;
}

/* ---- names */

static const char *unknown(Arena *a, const char *what, const char *name, const char *const *names, uint32_t n) {
    const char *near = suggest_nearest(name, names, n);
    return near ? arena_printf(a, "unknown %s `%s`; did you mean `%s`?", what, name, near)
                : arena_printf(a, "unknown %s `%s`", what, name);
}

const char *pass_point(Arena *a, const char *text, PassPoint *out) {
    const char *names[PASS_ALL + 1], *kernels[K_KINDS + 1];
    for (uint32_t k = 0; k < K_KINDS; k++) kernels[k] = kernel_names[k];
    kernels[K_KINDS] = "primal";
    names[PASS_NONE] = "all";
    for (uint32_t p = PASS_NONE + 1; p < PASS_ALL; p++) names[p] = pass_info[p].name;
    const char *colon = strchr(text, ':'), *name = colon ? colon + 1 : text;
    *out = (PassPoint){PASS_NONE, NULL};
    if (colon) {
        const char *kernel = arena_strndup(a, text, (size_t)(colon - text));
        for (uint32_t k = 0; k <= K_KINDS; k++)
            if (!strcmp(kernel, kernels[k])) out->kernel = kernels[k];
        if (!out->kernel) return unknown(a, "kernel", kernel, kernels, K_KINDS + 1);
    }
    if (!strcmp(name, "all")) out->pass = PASS_ALL;
    for (uint32_t p = PASS_NONE + 1; p < PASS_ALL; p++)
        if (!strcmp(name, names[p])) out->pass = (PassId)p;
    return out->pass == PASS_NONE ? unknown(a, "pass", name, names, PASS_ALL) : NULL;
}
