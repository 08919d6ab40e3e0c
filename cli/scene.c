/* The scene file of `fit`. Unknown keys are errors that name the nearest known one; paths are relative to the file. */
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include <jansson.h>

#include "cli/fit.h"
#include "compiler/base/session.h"

bool scene_is(const char *file) {
    size_t n = file ? strlen(file) : 0;
    return n > 5 && !strcmp(file + n - 5, ".json");
}

typedef struct Reader {
    Cli *c;
    const char *path;
    Scene *s;
} Reader;

static int bad(Reader *r, const char *where, const char *what) {
    return cli_error(SLT_INPUT, "%s: %s%s%s", r->path, where, *where ? ": " : "", what);
}

static int known_keys(Reader *r, json_t *object, const char *where, const char *const *keys, uint32_t n) {
    const char *key;
    json_t *value;
    json_object_foreach(object, key, value) {
        bool known = false;
        for (uint32_t k = 0; k < n; k++) known |= !strcmp(keys[k], key);
        if (known) continue;
        const char *near = suggest_nearest(key, keys, n);
        char text[256];
        if (near) snprintf(text, sizeof text, "unknown key `%s`; did you mean `%s`?", key, near);
        else snprintf(text, sizeof text, "unknown key `%s`", key);
        return bad(r, where, text);
    }
    return SLT_OK;
}
#define KEYS(...) (const char *const[]){__VA_ARGS__}, sizeof((const char *const[]){__VA_ARGS__}) / sizeof(const char *)

char *scene_keep(Scene *s, char *text) {
    s->strings = cli_need(realloc(s->strings, (s->nstrings + 1) * sizeof *s->strings));
    return s->strings[s->nstrings++] = cli_need(text);
}

static char *relative(Reader *r, const char *path) {
    size_t n = strlen(r->s->dir) + strlen(path) + 2;
    char *out = cli_need(malloc(n));
    if (path[0] == '/') snprintf(out, n, "%s", path);
    else snprintf(out, n, "%s%s", r->s->dir, path);
    return scene_keep(r->s, out);
}

typedef struct Slices {
    const char *dir, *why;
} Slices;

static SltStatus refuse_slice(void *user, const char *path, SltError *err) {
    Slices *s = user;
    (void)err;
    s->why = sandbox_refusal(s->dir, "", path);
    return s->why ? SLT_INPUT : SLT_OK;
}

/* NULL: the scene may name the file. */
static const char *refusal(const Reader *r, const char *text, const char *path) {
    if (!r->c->opt.sandbox) return NULL;
    Slices slices = {r->s->dir, sandbox_refusal(r->s->dir, text, path)};
    if (!slices.why && volume_is_stack(path)) volume_each(path, refuse_slice, &slices, NULL); /* each may be a link */
    if (slices.why && errno == ENOMEM) cli_need(NULL);
    return slices.why;
}

static int text_of(Reader *r, json_t *root, const char *key, char **out, bool path) {
    json_t *j = json_object_get(root, key);
    if (!j) return SLT_OK;
    if (!json_is_string(j)) return bad(r, key, "a string is wanted");
    *out = path ? relative(r, json_string_value(j)) : scene_keep(r->s, strdup(json_string_value(j)));
    const char *why = path && *out ? refusal(r, json_string_value(j), *out) : NULL;
    return why ? bad(r, key, why) : SLT_OK;
}

static int number_of(Reader *r, json_t *root, const char *key, double lo, double hi, double *out) {
    json_t *j = json_object_get(root, key);
    if (!j) return SLT_OK;
    if (!json_is_number(j) || !(json_number_value(j) >= lo && json_number_value(j) <= hi)) {
        char text[96];
        snprintf(text, sizeof text, "a number from %g to %g is wanted", lo, hi);
        return bad(r, key, text);
    }
    *out = json_number_value(j);
    return SLT_OK;
}

static int read_set(Reader *r, json_t *root) {
    json_t *set = json_object_get(root, "set"), *value;
    const char *key;
    if (!set) return SLT_OK;
    if (!json_is_object(set)) return bad(r, "set", "an object of constants is wanted");
    json_object_foreach(set, key, value) {
        char *text = json_dumps(value, JSON_ENCODE_ANY | JSON_REAL_PRECISION(17));
        if (!text || r->c->nsets >= CLI_MAX_LIST) {
            free(text);
            return bad(r, "set", "too many constants");
        }
        /* The command line comes after and wins. */
        memmove(r->c->sets + 1, r->c->sets, r->c->nsets++ * sizeof *r->c->sets);
        r->c->sets[0] = (SltSet){scene_keep(r->s, strdup(key)), scene_keep(r->s, text)};
    }
    r->c->opt.nset = r->c->nsets;
    return SLT_OK;
}

static int read_size(Reader *r, json_t *root) {
    json_t *size = json_object_get(root, "size");
    if (!size || r->c->size_given) return SLT_OK;
    size_t n = json_is_array(size) ? json_array_size(size) : 0;
    if (n < 1 || n > 3) return bad(r, "size", "a list of one to three whole numbers is wanted");
    for (size_t d = 0; d < n; d++) {
        json_t *j = json_array_get(size, d);
        if (!json_is_integer(j) || json_integer_value(j) < 1 || json_integer_value(j) > 1 << 20)
            return bad(r, "size", "whole numbers from 1 to 1048576 are wanted");
        r->c->job.size[d] = (uint32_t)json_integer_value(j);
    }
    for (size_t d = n; d < 3; d++) r->c->job.size[d] = 1;
    r->c->size_given = true, r->c->size_dims = (uint32_t)n;
    return SLT_OK;
}

static bool is_spec(json_t *j) {
    return json_is_object(j) &&
           (json_object_get(j, "value") || json_object_get(j, "file") || json_object_get(j, "grad") ||
            json_object_get(j, "lr") || json_object_get(j, "smooth") || json_object_get(j, "mask") ||
            json_object_get(j, "faces") || json_object_get(j, "grid"));
}

/* "grid": [W, H] or [W, H, D]: the parameter is a grid in one list. */
static int read_grid(Reader *r, json_t *spec, const char *name) {
    json_t *grid = json_object_get(spec, "grid"), *side;
    char text[64] = "";
    size_t i, n = json_array_size(grid);
    if (!grid) return SLT_OK;
    if (n != 2 && n != 3) return bad(r, name, "`grid` is a list of two or three whole numbers");
    json_array_foreach(grid, i, side) {
        if (!json_is_integer(side) || json_integer_value(side) < 1 || json_integer_value(side) > 1 << 28)
            return bad(r, name, "`grid` is a list of two or three whole numbers");
        snprintf(text + strlen(text), 16, "%s%d", i ? "x" : "", (int)json_integer_value(side));
    }
    if (r->c->ngrids < CLI_MAX_LIST) r->c->grids[r->c->ngrids++] = (SltSet){name, scene_keep(r->s, strdup(text))};
    return SLT_OK;
}

static int read_params(Reader *r, json_t *root) {
    json_t *params = json_object_get(root, "params"), *j;
    const char *key;
    if (!params) return SLT_OK;
    if (!json_is_object(params)) return bad(r, "params", "an object of parameters is wanted");
    r->s->params = cli_need(calloc(json_object_size(params) + 1, sizeof *r->s->params));
    json_object_foreach(params, key, j) {
        FitParam *p = &r->s->params[r->s->nparams++];
        *p = (FitParam){.name = scene_keep(r->s, strdup(key)), .grad = -1, .lr = -1, .smooth = -1};
        json_t *value = j;
        if (is_spec(j)) {
            int status = known_keys(r, j, key, KEYS("value", "file", "grad", "lr", "smooth", "mask", "faces", "grid"));
            if (status == SLT_OK) status = text_of(r, j, "file", &p->file, true);
            if (status == SLT_OK) status = text_of(r, j, "mask", &p->mask, true);
            if (status == SLT_OK) status = text_of(r, j, "faces", &p->faces, false);
            if (status == SLT_OK && p->faces && r->c->nfaces < CLI_MAX_LIST)
                r->c->faces[r->c->nfaces++] = (SltSet){p->name, p->faces};
            if (status == SLT_OK) status = read_grid(r, j, p->name);
            if (status == SLT_OK) status = number_of(r, j, "lr", 0, 1e30, &p->lr);
            if (status == SLT_OK) status = number_of(r, j, "smooth", 0, 1e30, &p->smooth);
            if (status != SLT_OK) return status;
            json_t *grad = json_object_get(j, "grad");
            if (grad && !json_is_boolean(grad)) return bad(r, key, "`grad` is true or false");
            if (grad) p->grad = json_is_true(grad);
            value = json_object_get(j, "value");
            if (value && p->file) return bad(r, key, "`value` and `file` were both given");
            /* As --param NAME=@FILE: the file may decide the size. The command line wins. */
            bool given = false;
            for (uint32_t k = 0; k < r->c->nparam_files; k++) given |= !strcmp(r->c->param_files[k].name, key);
            if (p->file && !given && r->c->nparam_files < CLI_MAX_LIST)
                r->c->param_files[r->c->nparam_files++] = (SltSet){p->name, p->file};
        }
        if (json_is_null(value)) return bad(r, key, "a value is wanted, not null");
        if (value) p->value = scene_keep(r->s, json_dumps(value, JSON_ENCODE_ANY | JSON_REAL_PRECISION(17)));
    }
    return SLT_OK;
}

/* Values by name, malloc'd: of the parameters of a view or a target, or of constants. */
static int read_values(Reader *r, json_t *root, const char *name, const char *where, SltSet **out, uint32_t *n) {
    json_t *values = json_object_get(root, name), *value;
    const char *key;
    int status = SLT_OK;
    if (!values) return SLT_OK;
    if (!json_is_object(values)) return bad(r, where, "an object is wanted");
    *out = cli_need(calloc(json_object_size(values) + 1, sizeof **out));
    json_object_foreach(values, key, value) {
        char *text = NULL, *file = NULL;
        if (json_is_object(value) && json_object_size(value) == 1 && json_object_get(value, "file")) {
            status = text_of(r, value, "file", &file, true);
            if (status != SLT_OK) return status;
            text = cli_need(malloc(strlen(file) + 2));
            sprintf(text, "@%s", file);
        } else {
            text = json_dumps(value, JSON_ENCODE_ANY | JSON_REAL_PRECISION(17));
        }
        (*out)[(*n)++] = (SltSet){scene_keep(r->s, strdup(key)), scene_keep(r->s, text)};
    }
    return SLT_OK;
}

/* "target": a path, or {"shader": path, "entry": name, "params": {...}, "set": {...}, "spp": n}. */
static int read_target(Reader *r, json_t *root, View *v) {
    json_t *target = json_object_get(root, "target");
    if (!json_is_object(target)) return text_of(r, root, "target", &v->target_path, true);
    TargetShader *t = v->drawn = cli_need(calloc(1, sizeof *v->drawn));
    double spp = 0;
    int status = known_keys(r, target, "target", KEYS("shader", "entry", "params", "set", "spp"));
    if (status == SLT_OK) status = text_of(r, target, "shader", &t->path, true);
    if (status == SLT_OK && !t->path) status = bad(r, "target", "`shader` is missing");
    if (status == SLT_OK) status = text_of(r, target, "entry", &t->entry, false);
    if (status == SLT_OK) status = number_of(r, target, "spp", 1, 1 << 24, &spp);
    if (status == SLT_OK) status = read_values(r, target, "params", "target.params", &t->params, &t->nparams);
    if (status == SLT_OK) status = read_values(r, target, "set", "target.set", &t->sets, &t->nsets);
    t->spp = (uint32_t)spp;
    if (status == SLT_OK && r->c->loss_command) status = bad(r, "target", "a loss program wants a file");
    return status;
}

static int read_view(Reader *r, json_t *j, View *v) {
    if (!json_is_object(j)) return bad(r, "views", "objects are wanted");
    int status = known_keys(r, j, "views", KEYS("target", "mask", "params", "entry"));
    if (status == SLT_OK) status = read_target(r, j, v);
    if (status == SLT_OK) status = text_of(r, j, "mask", &v->mask_path, true);
    if (status == SLT_OK) status = text_of(r, j, "entry", &v->entry, false);
    if (status != SLT_OK) return status;
    if (!v->target_path && !v->drawn && !r->c->loss_command) return bad(r, "views", "every view needs a `target`");
    return read_values(r, j, "params", "views.params", &v->params, &v->nparams);
}

static int read_views(Reader *r, json_t *root) {
    json_t *views = json_object_get(root, "views");
    size_t n = views ? json_array_size(views) : 0;
    if (views && (!json_is_array(views) || n == 0)) return bad(r, "views", "a list of views is wanted");
    if (!views && !json_object_get(root, "target")) return SLT_OK;
    r->s->views = cli_need(calloc(n + 1, sizeof *r->s->views));
    if (!views) {
        View *v = &r->s->views[r->s->nviews++];
        int status = read_target(r, root, v);
        return status == SLT_OK ? text_of(r, root, "mask", &v->mask_path, true) : status;
    }
    for (size_t i = 0; i < n; i++) {
        int status = read_view(r, json_array_get(views, i), &r->s->views[r->s->nviews++]);
        if (status != SLT_OK) return status;
    }
    return SLT_OK;
}

/* "loss": {"command": "...", "timeout": S}; the command runs in the scene's folder. */
static int read_loss_command(Reader *r, json_t *loss) {
    char *command = NULL;
    double timeout = -1;
    int status = known_keys(r, loss, "loss", KEYS("command", "timeout"));
    if (status == SLT_OK) status = text_of(r, loss, "command", &command, false);
    if (status == SLT_OK) status = number_of(r, loss, "timeout", 1e-3, 1e9, &timeout);
    if (status != SLT_OK) return status;
    if (!command || !*command) return bad(r, "loss", "`command` is missing");
    if (timeout > 0 && !r->c->loss_timeout_given) r->c->loss_timeout = timeout;
    if (r->c->loss_command) return SLT_OK;
    if (r->c->opt.sandbox) return bad(r, "loss", "a sandbox starts no commands of scenes");
    if (!r->c->allow_commands)
        return bad(r, "loss",
                   "it wants to start a program: with --allow-commands it may, or type it behind --loss-command");
    r->c->loss_command = command, r->s->loss_dir = r->s->dir;
    return SLT_OK;
}

static int read_round(Reader *r, json_t *j) {
    double iters = 0, timeout = ROUND_SECONDS;
    char *command = NULL;
    if (!json_is_object(j))
        return bad(r, "rounds", "{\"iters\": N, \"command\": \"...\"}, or a list of these, is wanted");
    int status = known_keys(r, j, "rounds", KEYS("iters", "command", "timeout"));
    if (status == SLT_OK) status = number_of(r, j, "iters", 1, 1e8, &iters);
    if (status == SLT_OK) status = text_of(r, j, "command", &command, false);
    if (status == SLT_OK) status = number_of(r, j, "timeout", 1e-3, 1e9, &timeout);
    if (status != SLT_OK) return status;
    if (iters < 1) return bad(r, "rounds", "`iters` is missing");
    if (!command || !*command) return bad(r, "rounds", "`command` is missing");
    r->s->rounds[r->s->nrounds++] = (Round){(uint32_t)iters, command, timeout};
    return SLT_OK;
}

/* "rounds": {"iters": N, "command": "...", "timeout": S} again and again, or a list of such, one after the other; the
 * commands run in the scene's folder. */
static int read_rounds(Reader *r, json_t *root) {
    json_t *rounds = json_object_get(root, "rounds");
    size_t n = json_is_array(rounds) ? json_array_size(rounds) : 1;
    int status = SLT_OK;
    if (!rounds || r->c->round_command) return SLT_OK;
    r->s->rounds = cli_need(calloc(n + 1, sizeof *r->s->rounds));
    r->s->rounds_dir = r->s->dir, r->s->rounds_repeat = !json_is_array(rounds);
    for (size_t i = 0; i < n && status == SLT_OK; i++)
        status = read_round(r, r->s->rounds_repeat ? rounds : json_array_get(rounds, i));
    if (status != SLT_OK || !n) return status;
    if (r->c->opt.sandbox) return bad(r, "rounds", "a sandbox starts no commands of scenes");
    if (r->c->allow_commands) return SLT_OK;
    return bad(r, "rounds",
               "it wants to start a program: with --allow-commands it may, or type it behind --round-command");
}

/* "loss": "l2", "l1", "huber", {"huber": delta}, {"entry": name} or a command. */
static int read_loss(Reader *r, json_t *root) {
    json_t *loss = json_object_get(root, "loss");
    char *name = NULL;
    if (!loss || r->c->loss || r->c->loss_entry) return SLT_OK;
    if (json_is_object(loss) && json_object_get(loss, "huber")) {
        double delta = 0;
        int status = known_keys(r, loss, "loss", KEYS("huber"));
        if (status == SLT_OK) status = number_of(r, loss, "huber", 1e-30, 1e30, &delta);
        if (status != SLT_OK) return status;
        if (!(r->c->huber_delta > 0)) r->c->huber_delta = delta;
        r->c->loss = "huber";
        return SLT_OK;
    }
    if (json_is_object(loss) && json_object_get(loss, "entry")) {
        int status = known_keys(r, loss, "loss", KEYS("entry"));
        if (status == SLT_OK) status = text_of(r, loss, "entry", &name, false);
        if (status == SLT_OK && !r->c->loss_command) r->c->loss_entry = name;
        return status;
    }
    if (json_is_object(loss)) return read_loss_command(r, loss);
    int status = text_of(r, root, "loss", &name, false);
    if (status == SLT_OK && cli_choice(CLI_LOSSES, name) < 0)
        return bad(r, "loss",
                   "`l2`, `l1`, `huber`, {\"huber\": delta}, {\"entry\": name} or {\"command\": text} is wanted");
    if (status == SLT_OK && !r->c->loss_command) r->c->loss = name;
    return status;
}

/* "constant", "cosine" or {"exponential": factor}. */
static int read_schedule(Reader *r, json_t *root) {
    json_t *j = json_object_get(root, "schedule");
    const char *name = json_string_value(j);
    double decay = 0;
    int status = SLT_OK;
    if (!j || r->c->schedule_given) return SLT_OK;
    if (json_is_object(j)) {
        status = known_keys(r, j, "optimizer.schedule", KEYS("exponential"));
        if (status == SLT_OK) status = number_of(r, j, "exponential", 1e-300, 1, &decay);
    }
    if (status != SLT_OK) return status;
    if (!(decay > 0) && (!name || (strcmp(name, "constant") && strcmp(name, "cosine"))))
        return bad(r, "optimizer.schedule", "\"constant\", \"cosine\" or {\"exponential\": factor} is wanted");
    r->c->schedule = decay > 0 ? SLT_FIT_EXPONENTIAL : strcmp(name, "cosine") ? SLT_FIT_CONSTANT : SLT_FIT_COSINE;
    r->c->decay = decay;
    return SLT_OK;
}

static int read_betas(Reader *r, json_t *root) {
    json_t *j = json_object_get(root, "betas");
    if (!j || r->c->beta1 > 0) return SLT_OK;
    double b[2] = {json_number_value(json_array_get(j, 0)), json_number_value(json_array_get(j, 1))};
    if (json_array_size(j) != 2 || !(b[0] > 0 && b[0] < 1 && b[1] > 0 && b[1] < 1))
        return bad(r, "optimizer.betas", "a list of two numbers between 0 and 1 is wanted");
    r->c->beta1 = b[0], r->c->beta2 = b[1];
    return SLT_OK;
}

static int read_optimizer(Reader *r, json_t *root) {
    json_t *o = json_object_get(root, "optimizer");
    if (!o) return SLT_OK;
    if (!json_is_object(o)) return bad(r, "optimizer", "an object is wanted");
    int status = known_keys(r, o, "optimizer", KEYS("type", "iters", "lr", "schedule", "betas", "views_per_step"));
    double iters = -1, lr = -1, views = 0;
    if (status == SLT_OK) status = read_schedule(r, o);
    if (status == SLT_OK) status = read_betas(r, o);
    if (status == SLT_OK) status = number_of(r, o, "views_per_step", 1, 1e6, &views);
    if (status == SLT_OK) status = text_of(r, o, "type", &r->s->optimizer, false);
    if (status == SLT_OK) status = number_of(r, o, "iters", 0, 1e8, &iters);
    if (status == SLT_OK) status = number_of(r, o, "lr", 0, 1e30, &lr);
    if (status != SLT_OK) return status;
    if (r->s->optimizer) {
        if (cli_choice(cli_optimizers + 1, r->s->optimizer) < 0) {
            char text[128];
            snprintf(text, sizeof text, "unknown `%.40s`; known: %.60s", r->s->optimizer, cli_optimizers + 1);
            return bad(r, "optimizer.type", text);
        }
        if (!r->c->optimizer_given) r->c->optimizer = r->s->optimizer;
    }
    if (!r->c->views_per_step) r->c->views_per_step = (uint32_t)views;
    if (iters >= 0 && !r->c->iters_given) r->c->iters = (uint32_t)iters;
    if (lr >= 0 && r->c->nlr < CLI_MAX_LIST) {
        char text[40];
        snprintf(text, sizeof text, "%.17g", lr);
        memmove(r->c->lr + 1, r->c->lr, r->c->nlr++ * sizeof *r->c->lr);
        r->c->lr[0] = (Assign){NULL, scene_keep(r->s, strdup(text))};
    }
    return SLT_OK;
}

static int read_root(Reader *r, json_t *root) {
    if (!json_is_object(root)) return bad(r, "", "an object is wanted");
    int status = known_keys(r, root, "",
                            KEYS("shader", "entry", "set", "size", "spp", "segments", "samples", "seed", "params",
                                 "views", "target", "mask", "optimizer", "output", "filter", "minimize", "precision",
                                 "loss", "frames", "rounds"));
    double spp = -1, segments = -1, samples = -1, seed = -1, frames = 0;
    char *filter = NULL, *precision = NULL;
    if (status == SLT_OK) status = text_of(r, root, "shader", &r->s->shader, true);
    if (status == SLT_OK && !r->s->shader) status = bad(r, "", "`shader` is missing");
    if (status == SLT_OK) status = text_of(r, root, "entry", &r->s->entry, false);
    if (status == SLT_OK) status = text_of(r, root, "output", &r->s->output, true);
    if (status == SLT_OK) status = text_of(r, root, "filter", &filter, false);
    if (status == SLT_OK) status = text_of(r, root, "precision", &precision, false);
    if (status == SLT_OK) status = number_of(r, root, "spp", 1, 1 << 24, &spp);
    if (status == SLT_OK) status = number_of(r, root, "segments", 1, 1e12, &segments);
    if (status == SLT_OK) status = number_of(r, root, "samples", 1, 1e12, &samples);
    if (status == SLT_OK) status = number_of(r, root, "seed", 0, 4294967295.0, &seed);
    if (status == SLT_OK) status = number_of(r, root, "frames", 1, 1e8, &frames);
    if (status == SLT_OK) status = read_set(r, root);
    if (status == SLT_OK) status = read_size(r, root);
    if (status == SLT_OK) status = read_params(r, root);
    if (status == SLT_OK) status = read_loss(r, root);
    if (status == SLT_OK) status = read_rounds(r, root);
    if (status == SLT_OK) status = read_views(r, root);
    if (status == SLT_OK) status = read_optimizer(r, root);
    if (status != SLT_OK) return status;
    if (filter) {
        if (!strcmp(filter, "tent")) r->c->job.filter = SLT_FILTER_TENT;
        else if (!strcmp(filter, "gaussian")) r->c->job.filter = SLT_FILTER_GAUSSIAN;
        else if (strcmp(filter, "box")) return bad(r, "filter", "box, tent or gaussian is wanted");
    }
    if (precision) {
        if (strcmp(precision, "f32") && strcmp(precision, "f64")) return bad(r, "precision", "f32 or f64 is wanted");
        r->c->opt.f64 = !strcmp(precision, "f64");
    }
    if (spp > 0 && !r->c->spp_given) r->c->job.spp = (uint32_t)spp, r->c->spp_given = true;
    if (segments > 0 && !r->c->job.segments) r->c->job.segments = (uint64_t)segments;
    if (samples > 0 && !r->c->samples_given) r->c->job.samples = (uint64_t)samples, r->c->samples_given = true;
    if (seed >= 0 && !r->c->job.seed) r->c->job.seed = r->c->opt.seed = (uint32_t)seed;
    if (!r->c->frames) r->c->frames = (uint32_t)frames;
    json_t *minimize = json_object_get(root, "minimize");
    if (minimize && !json_is_boolean(minimize)) return bad(r, "minimize", "true or false is wanted");
    if (json_is_true(minimize)) r->c->minimize = true;
    /* Views that all name their own entry leave nothing to choose. */
    bool all = r->s->nviews > 0;
    for (uint32_t v = 0; v < r->s->nviews; v++) all &= r->s->views[v].entry != NULL;
    if (!r->s->entry && all) r->s->entry = r->s->views[0].entry;
    if (!r->c->opt.entry) r->c->opt.entry = r->s->entry;
    if (!r->c->output) r->c->output = r->s->output;
    return SLT_OK;
}

int scene_read(Cli *c, const char *path, Scene *scene) {
    *scene = (Scene){0};
    Reader r = {c, path, scene};
    SltError err = {0};
    uint8_t *bytes;
    size_t size;
    if (file_read_all(path, &file_text, &bytes, &size, &err) != SLT_OK) return cli_fail(c, &err);
    const char *slash = strrchr(path, '/');
    scene->dir = scene_keep(scene, strndup(path, slash ? (size_t)(slash + 1 - path) : 0));
    json_error_t e;
    json_t *root = json_read((const char *)bytes, size, JSON_REJECT_DUPLICATES, &e);
    free(bytes);
    if (!root && json_no_memory(&e)) cli_need(NULL);
    if (!root) return cli_error(SLT_INPUT, "%s:%d:%d: %s", path, e.line, e.column, e.text);
    int status = read_root(&r, root);
    json_decref(root);
    c->opt.param_files = c->param_files, c->opt.nparam_files = c->nparam_files;
    return status;
}

void scene_free(Scene *s) {
    for (uint32_t v = 0; v < s->nviews; v++) {
        free(s->views[v].target);
        free(s->views[v].mask);
        free(s->views[v].params);
        if (s->views[v].drawn) free(s->views[v].drawn->params), free(s->views[v].drawn->sets);
        free(s->views[v].drawn);
    }
    free(s->views);
    free(s->params);
    free(s->rounds);
    for (uint32_t i = 0; i < s->nstrings; i++) free(s->strings[i]);
    free(s->strings);
    *s = (Scene){0};
}
