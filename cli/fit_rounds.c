/* A fit in rounds: behind each a program gets the parameters, and what the views look like, and gives other parameters:
 * sorted, split, pruned. Where an open array comes back longer or shorter, the shader is compiled again. */
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <jansson.h>

#include "bindings/c/api.h"
#include "cli/child.h"
#include "cli/fit.h"
#include "runtime/base/text.h"

int fit_take_rounds(Fit *f) {
    const Cli *c = f->c;
    Scene *s = &f->scene;
    if (!c->round_command && !c->round_iters) return SLT_OK;
    if (!c->round_command || !c->round_iters) return cli_usage(c, "--round-iters and --round-command want each other");
    s->rounds = cli_need(realloc(s->rounds, sizeof *s->rounds));
    *s->rounds = (Round){c->round_iters, c->round_command, ROUND_SECONDS};
    s->nrounds = 1, s->rounds_repeat = true, s->rounds_dir = NULL;
    return SLT_OK;
}

uint32_t fit_round(const Fit *f, const Round **then) {
    const Scene *s = &f->scene;
    uint32_t left = f->c->iters - f->first, k = f->round;
    const Round *r = s->nrounds && (s->rounds_repeat || k < s->nrounds) ? &s->rounds[k % s->nrounds] : NULL;
    *then = r && r->iters < left ? r : NULL; /* nothing is changed that no iteration would follow */
    return r && r->iters < left ? r->iters : left;
}

/* ---- what the program gets */
static SltStatus write_picture(const Fit *f, const char *path, const float *values, uint32_t channels, SltError *err) {
    const uint32_t *size = f->c->job.size;
    Image im = {.width = (int)size[0], .height = (int)(size[1] * size[2]), .channels = (int)channels};
    im.data = (float *)values;
    return size[2] > 1 ? volume_write(path, &im, (int)size[2], NULL, err) : image_write(path, &im, NULL, err);
}

/* Of every view `image0.npy` and, where the target is known, `target0.npy`, in a folder that is there while the program
 * runs. */
static SltStatus write_views(const Fit *f, const char *folder, FILE *out, SltError *err) {
    char path[4096];
    SltStatus s = SLT_OK;
    fputs("\"views\": [", out);
    for (uint32_t v = 0; v < f->scene.nviews && s == SLT_OK; v++) {
        const View *view = &f->scene.views[v];
        uint32_t channels = slt_channels(view->program ? view->program : f->p);
        const struct {
            const char *name;
            const float *values;
        } files[] = {{"image", f->best[v]}, {"target", view->target}, {"mask", view->mask}};
        fputs(v ? ", {" : "{", out);
        for (int k = 0; k < 3 && s == SLT_OK; k++) {
            snprintf(path, sizeof path, "%s/%s%u.npy", folder, files[k].name, v);
            fprintf(out, "%s\"%s\": ", k ? ", " : "", files[k].name);
            if (files[k].values) json_text(out, path), s = write_picture(f, path, files[k].values, channels, err);
            else fputs("null", out);
        }
        fputc('}', out);
    }
    fputs("], ", out);
    return s;
}

static void remove_views(const Fit *f, const char *folder) {
    static const char *const names[] = {"image", "target", "mask"};
    char path[4096];
    for (uint32_t v = 0; v < 3 * f->scene.nviews; v++) {
        snprintf(path, sizeof path, "%s/%s%u.npy", folder, names[v % 3], v / 3);
        unlink(path);
    }
    rmdir(folder);
}

/* The mean of |dL/dp| over the iterations of the round, in the shape of the parameters. */
static void write_slopes(const Fit *f, FILE *out) {
    uint32_t named = f->c->nwrt;
    ShapeValues v = {.data = f->slopes, .channels = 1, .nfloats = slt_float_count(f->p)};
    f->c->nwrt = 0;
    report_gradient_json(out, f->c, f->p, &v);
    f->c->nwrt = named;
}

static SltStatus write_question(const Fit *f, const char *folder, char **text, SltError *err) {
    Text made;
    char *params = slt_params_json(f->p);
    FILE *out = params ? text_open(&made) : NULL;
    SltStatus s = out ? SLT_OK : status_fail(err, SLT_LIMIT, "out of memory");
    *text = NULL;
    if (out) {
        fprintf(out, "{\"round\": %u, \"iteration\": %u, \"iterations\": %u, \"loss\": ", f->round + 1, f->first,
                f->c->iters);
        json_number(out, f->result.loss);
        fputs(", ", out);
        s = write_views(f, folder, out, err);
        fputs("\"slopes\": ", out);
        write_slopes(f, out);
        fprintf(out, ", \"params\": %s}\n", params);
        *text = text_close(&made);
        if (s == SLT_OK && !*text) s = status_fail(err, SLT_LIMIT, "out of memory");
    }
    free(params);
    return s;
}

/* ---- what it answers */
static const char what[] = "the round program";

typedef struct Lengths {
    bool differ;
    char text[400];
} Lengths;

/* Does a list have another length than the array of its name? Which do: "discs 50 -> 71". */
static bool resizes(const SltProgram *p, const json_t *params, char *text, size_t size) {
    size_t n = 0;
    *text = 0;
    for (uint32_t i = 0; i < p->prog->nparams; i++) {
        const Param *q = &p->prog->params[i];
        const json_t *j = json_object_get(params, q->name);
        if (q->type->kind != T_ARRAY || !json_is_array(j) || json_array_size(j) == q->type->n) continue;
        if (n < size)
            n += (size_t)snprintf(text + n, size - n, "%s%.100s %u -> %zu", n ? ", " : "", q->name, q->type->n,
                                  json_array_size(j));
    }
    return n > 0;
}

/* All parameters, as JSON, malloc'd: as they were in `before`, but for those that the answer has. */
static SltStatus read_answer(const Fit *f, const char *before, const char *answer, size_t n, char **params,
                             Lengths *lengths, SltError *err) {
    Child said = {.what = what};
    json_error_t e;
    json_t *j = json_read(answer, n, JSON_REJECT_DUPLICATES, &e);
    *params = NULL;
    if (!j && json_no_memory(&e)) return status_fail(err, SLT_LIMIT, "out of memory");
    if (!j) return child_fail_answer(&said, answer, n, e.text, err);
    json_t *values = json_object_get(j, "params"), *error = json_object_get(j, "error");
    json_t *all = json_read(before, strlen(before), 0, &e);
    SltStatus s = SLT_OK;
    if (json_is_string(error)) s = status_fail(err, SLT_CHECK_FAILED, "%s says: %s", what, json_string_value(error));
    else if (!json_is_object(values)) s = child_fail_answer(&said, answer, n, "{\"params\": {...}} is wanted", err);
    else if (!all || json_object_update(all, values) != 0 ||
             !(*params = json_dumps(all, JSON_COMPACT | JSON_REAL_PRECISION(17))))
        s = status_fail(err, SLT_LIMIT, "out of memory");
    lengths->differ = s == SLT_OK && resizes(f->p, values, lengths->text, sizeof lengths->text);
    json_decref(all);
    json_decref(j);
    return s;
}

/* The places of the counts name files and texts of a program, which is about to be freed: the fit's own copies instead.
 */
static void keep_text(Fit *f, const char **text) {
    if (!*text) return;
    for (uint32_t k = 0; k < f->ntexts; k++)
        if (!strcmp(f->texts[k], *text)) {
            *text = f->texts[k];
            return;
        }
    f->texts = cli_need(realloc(f->texts, (f->ntexts + 1) * sizeof *f->texts));
    *text = f->texts[f->ntexts++] = cli_need(strdup(*text));
}

static void keep_places(Fit *f) {
    for (int d = 0; d < SLT_DROP_REASONS; d++)
        keep_text(f, &f->stats.dropped_at[d].file), keep_text(f, &f->stats.dropped_at[d].text);
    keep_text(f, &f->stats.nonfinite_at.file), keep_text(f, &f->stats.nonfinite_at.text);
}

/* Programs whose open arrays have the lengths of the values, in place of the fit's and of its views'. */
static SltStatus compile_again(Fit *f, const char *values, SltError *err) {
    SltProgram **all = cli_need(calloc(f->nentries + 1, sizeof(SltProgram *)));
    SltStatus s = SLT_OK;
    for (uint32_t k = 0; k <= f->nentries && s == SLT_OK; k++) {
        const SltProgram *old = k ? f->entries[k - 1] : f->p;
        s = api_compile_resized(old, values, &all[k]);
        cli_need(all[k]);
        if (s == SLT_OK) slt_set_print(all[k], old->on_print, old->on_print_user, NULL);
        else status_fail(err, s, "%s: %s%s", what, slt_diagnostics_text(all[k]), slt_last_error(all[k]));
    }
    if (s == SLT_OK) keep_places(f);
    for (uint32_t k = 0; k <= f->nentries; k++) {
        SltProgram **own = k ? &f->entries[k - 1] : &f->p, *old = *own;
        for (uint32_t v = 0; v < f->scene.nviews && s == SLT_OK; v++)
            if (f->scene.views[v].program == old) f->scene.views[v].program = f->views[v].program = all[k];
        if (s == SLT_OK) *own = all[k];
        slt_program_free(s == SLT_OK ? old : all[k]);
    }
    free(all);
    return s;
}

static SltStatus set(Fit *f, const char *values, bool resized, SltError *err) {
    SltStatus s = resized ? compile_again(f, values, err) : SLT_OK;
    if (s == SLT_OK) s = slt_set_params_json(f->p, values, what, err);
    return s == SLT_OK && resized ? fit_choose_wrt(f, err) : s;
}

void fit_revert(Fit *f) {
    SltError ignored;
    if (f->kept && slt_set_params_json(f->p, f->kept, what, &ignored) != SLT_OK) set(f, f->kept, true, &ignored);
}

static SltStatus ask(const Fit *f, const Round *r, char **answer, size_t *n, SltError *err) {
    char folder[4000], *question;
    SltStatus s = cli_temporary_folder(folder, sizeof folder, err);
    if (s != SLT_OK) return s;
    s = write_question(f, folder, &question, err);
    if (s == SLT_OK) {
        ChildJob job = {.what = what, .command = r->command, .dir = f->scene.rounds_dir, .timeout = r->timeout};
        job.deadline = f->c->max_seconds > 0 ? f->start + f->c->max_seconds : 0;
        job.input = question, job.ninput = strlen(question);
        watch_phase("the round program", (double)f->first / f->c->iters, NULL);
        s = child_run(&job, answer, n, err);
        watch_phase("fit", (double)f->first / f->c->iters, NULL);
    }
    free(question);
    remove_views(f, folder);
    return s;
}

static void tell(Fit *f, const char *lengths) {
    if (f->c->quiet || f->c->json) return;
    if (f->progress.on) fputs("\r\033[K", stderr);
    cli_say(CLI_NOTE, "round", NULL, "round %u: loss %.6g after %u iterations%s%s", f->round + 1, f->result.loss,
            f->result.iterations, *lengths ? "; " : "", lengths);
}

SltStatus fit_change(Fit *f, const Round *r, SltError *err) {
    char *answer = NULL, *values = NULL;
    size_t n;
    Lengths lengths = {0};
    free(f->kept);
    f->kept = slt_params_json(f->p);
    SltStatus s = f->kept ? ask(f, r, &answer, &n, err) : status_fail(err, SLT_LIMIT, "out of memory");
    if (s == SLT_OK) s = read_answer(f, f->kept, answer, n, &values, &lengths, err);
    if (s == SLT_OK) s = set(f, values, lengths.differ, err);
    if (s != SLT_OK && s != SLT_LIMIT && s != SLT_INTERRUPTED) s = err->status = SLT_CHECK_FAILED;
    if (s == SLT_OK) tell(f, lengths.text);
    free(answer);
    free(values);
    return s;
}
