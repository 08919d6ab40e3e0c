/* The views of a fit: their targets and masks. */
#include <stdlib.h>
#include <string.h>

#include "cli/fit.h"

/* Without --size the first target decides. */
SltStatus fit_size_of_target(const Fit *f, uint32_t size[2], SltError *err) {
    const char *path = f->c->target ? f->c->target : f->scene.nviews ? f->scene.views[0].target_path : NULL;
    Image im;
    if (!path) return SLT_OK;
    SltStatus status = image_read(path, NULL, &im, err);
    if (status != SLT_OK) return status;
    size[0] = (uint32_t)im.width, size[1] = (uint32_t)im.height;
    image_free(&im);
    return SLT_OK;
}

int fit_read_targets(Fit *f) {
    Cli *c = f->c;
    int status = SLT_OK;
    if (c->target && f->scene.nviews) return cli_usage(c, "--target and the scene's views were both given");
    if (c->minimize && c->loss_command) return cli_usage(c, "--minimize and --loss-command are two losses");
    if (c->loss && (c->minimize || c->loss_command))
        return cli_usage(c, "--loss %s and %s are two losses", c->loss, c->minimize ? "--minimize" : "--loss-command");
    if (c->huber_delta > 0 && (!c->loss || strcmp(c->loss, "huber")))
        return cli_usage(c, "--huber-delta is of --loss huber");
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
    if (!c->size_given) {
        SltError err = {0};
        if (fit_size_of_target(f, c->job.size, &err) != SLT_OK) return cli_fail(c, &err);
        c->job.size[2] = 1;
    }
    for (uint32_t v = 0; v < f->scene.nviews; v++) {
        View *view = &f->scene.views[v];
        status = cli_read_image(c, f->p, view->target_path, true, &view->target);
        if (status == SLT_OK && view->mask_path) status = cli_read_image(c, f->p, view->mask_path, true, &view->mask);
        if (status != SLT_OK) return status;
    }
    return SLT_OK;
}

int fit_collect_views(Fit *f) {
    f->views = cli_need(calloc(f->scene.nviews + 1, sizeof *f->views));
    for (uint32_t v = 0; v < f->scene.nviews; v++) {
        const View *view = &f->scene.views[v];
        f->views[v] = SLT_FIT_VIEW_INIT;
        f->views[v].target = view->target, f->views[v].mask = view->mask;
        f->views[v].values = view->params, f->views[v].nvalues = view->nparams;
    }
    f->opt.views = f->views, f->opt.nviews = f->scene.nviews;
    return SLT_OK;
}
