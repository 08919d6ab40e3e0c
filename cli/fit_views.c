/* The views of a fit: their targets and masks, and the programs that draw them. */
#include <stdlib.h>
#include <string.h>

#include "cli/fit.h"

/* Without --size the first target decides. */
SltStatus fit_size_of_target(const Fit *f, uint32_t size[3], SltError *err) {
    const char *path = f->c->target;
    for (uint32_t v = 0; v < f->scene.nviews && !path; v++) path = f->scene.views[v].target_path;
    return path ? cli_size_of_image(path, f->p && slt_dim(f->p) == 3, size, err) : SLT_OK;
}

/* What --loss, --loss-entry, --loss-command and --minimize ask for is one loss. */
static int check_loss(const Fit *f) {
    const Cli *c = f->c;
    const struct {
        bool given;
        const char *name;
    } loss[] = {{c->minimize, "--minimize"},
                {c->loss_command, "--loss-command"},
                {c->loss, "--loss"},
                {c->loss_entry, "--loss-entry"}};
    const char *first = NULL;
    for (size_t k = 0; k < sizeof loss / sizeof *loss; k++) {
        if (loss[k].given && first) return cli_usage(c, "%s and %s are two losses", first, loss[k].name);
        if (loss[k].given) first = loss[k].name;
    }
    if (c->huber_delta > 0 && (!c->loss || strcmp(c->loss, "huber")))
        return cli_usage(c, "--huber-delta is of --loss huber");
    return SLT_OK;
}

int fit_check_targets(Fit *f) {
    Cli *c = f->c;
    int status = check_loss(f);
    if (status != SLT_OK) return status;
    if (c->target && f->scene.nviews) return cli_usage(c, "--target and the scene's views were both given");
    if (c->target || (c->loss_command && !f->scene.nviews)) {
        f->scene.views = cli_need(calloc(1, sizeof *f->scene.views));
        f->scene.nviews = 1;
        f->scene.views[0].target_path = (char *)c->target;
    }
    if (!f->scene.nviews && !c->minimize)
        return cli_usage(c, "fit wants --target IMAGE, --minimize, --loss-command PROGRAM, or a scene with views");
    if (f->scene.nviews && c->minimize) return cli_usage(c, "--minimize has no target");
    if (c->loss_command && slt_dim(f->p) == 3) return cli_usage(c, "a loss program is for 1D and 2D domains");
    if (c->minimize || c->loss_command) return SLT_OK;
    SltError err = {0};
    uint32_t size[3] = {0, 0, 1};
    if (!c->size_given && fit_size_of_target(f, size, &err) != SLT_OK) return cli_fail(c, &err);
    if (size[0]) memcpy(c->job.size, size, sizeof size);
    c->size_given |= size[0] > 0;
    return SLT_OK;
}

/* The shader with another entry; views of the same one share it. */
static int compile_entry(Fit *f, View *view) {
    Cli *c = f->c;
    if (!view->entry || !strcmp(view->entry, slt_entry(f->p))) return SLT_OK;
    for (uint32_t k = 0; k < f->nentries; k++)
        if (!strcmp(view->entry, slt_entry(f->entries[k]))) view->program = f->entries[k];
    if (view->program) return SLT_OK;
    const char *entry = c->opt.entry;
    uint32_t told = c->told;
    f->entries = cli_need(realloc(f->entries, (f->nentries + 1) * sizeof(SltProgram *)));
    c->opt.entry = view->entry;
    int status = cli_compile(c, &f->entries[f->nentries]);
    c->opt.entry = entry, c->told = told;
    view->program = f->entries[f->nentries++];
    return status;
}

/* Wrong usage of the library is a mistake in the scene. */
static int fail(const Cli *c, SltError *err) {
    if (err->status == SLT_USAGE) err->status = SLT_INPUT;
    return cli_fail(c, err);
}

enum { TARGET_SPP = 256, TARGET_SEED = 0x2545f491 };

static int draw(Cli *c, SltProgram *p, const TargetShader *t, const SltProgram *view, float **out) {
    SltError err = {0};
    for (uint32_t k = 0; k < t->nparams; k++)
        if (slt_set_text(p, t->params[k].name, t->params[k].value, &err) != SLT_OK) return fail(c, &err);
    if (slt_dim(p) != slt_dim(view) || slt_channels(p) != slt_channels(view))
        return cli_error(SLT_INPUT, "%s: `%s` is of %uD and %u channels, but its view of %uD and %u", t->path,
                         slt_entry(p), slt_dim(p), slt_channels(p), slt_dim(view), slt_channels(view));
    SltJob job = c->job;
    job.spp = t->spp ? t->spp : TARGET_SPP, job.seed ^= TARGET_SEED;
    *out = cli_need(malloc((size_t)job.size[0] * job.size[1] * job.size[2] * slt_channels(p) * sizeof **out));
    return slt_render(p, &job, *out, NULL, &err) == SLT_OK ? SLT_OK : cli_fail(c, &err);
}

/* The target that another shader draws: once, with many samples and other random numbers than the fit's. */
static int draw_target(Fit *f, View *view) {
    Cli *c = f->c;
    const TargetShader *t = view->drawn;
    SltOptions opt = c->opt;
    SltSet files[CLI_MAX_LIST];
    SltProgram *p;
    uint32_t told = c->told;
    opt.entry = t->entry, opt.set = t->sets, opt.nset = t->nsets, opt.param_files = files, opt.nparam_files = 0;
    for (uint32_t k = 0; k < t->nparams && opt.nparam_files < CLI_MAX_LIST; k++)
        if (t->params[k].value[0] == '@')
            files[opt.nparam_files++] = (SltSet){t->params[k].name, t->params[k].value + 1};
    SltStatus status = slt_compile_file(t->path, &opt, &p);
    cli_need(p);
    if (status == SLT_OK) {
        status = (SltStatus)draw(c, p, t, view->program ? view->program : f->p, &view->target);
    } else {
        c->told = 0;
        cli_tell(c, p);
        if (status == SLT_USAGE) status = SLT_INPUT;
        cli_error(status, "%s: %s", t->path, slt_last_error(p));
        c->told = told;
    }
    slt_program_free(p);
    return status;
}

int fit_read_targets(Fit *f) {
    Cli *c = f->c;
    int status = SLT_OK;
    for (uint32_t v = 0; v < f->scene.nviews && status == SLT_OK; v++) {
        View *view = &f->scene.views[v];
        status = compile_entry(f, view);
        SltProgram *p = view->program ? view->program : f->p;
        if (c->loss_command || status != SLT_OK) continue;
        status = view->drawn ? draw_target(f, view) : cli_read_image(c, p, view->target_path, true, &view->target);
        if (status == SLT_OK && view->mask_path) status = cli_read_image(c, p, view->mask_path, true, &view->mask);
    }
    return status;
}

int fit_collect_views(Fit *f) {
    f->views = cli_need(calloc(f->scene.nviews + 1, sizeof *f->views));
    for (uint32_t v = 0; v < f->scene.nviews; v++) {
        const View *view = &f->scene.views[v];
        f->views[v] = SLT_FIT_VIEW_INIT;
        f->views[v].target = view->target, f->views[v].mask = view->mask, f->views[v].program = view->program;
        f->views[v].values = view->params, f->views[v].nvalues = view->nparams;
    }
    f->opt.views = f->views, f->opt.nviews = f->scene.nviews;
    return SLT_OK;
}
