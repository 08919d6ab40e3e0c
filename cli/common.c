/* Compiling, sizes, images: what every verb does first. */
#include <dlfcn.h>
#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "bindings/c/api.h"
#include "cli/cli.h"
#include "compiler/back/back.h"
#include "compiler/pass/walk.h"
#include "runtime/base/threads.h"

double cli_now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Not every place that finds an error has the command line at hand. */
static bool json_errors;

void cli_errors_as_json(void) { json_errors = true; }

/* A diagnostic of the Language Server Protocol; no place: at NULL. */
void cli_put_json(FILE *out, int severity, const char *code, const SltPlace *at, const char *text) {
    uint32_t line = at && at->line ? at->line - 1 : 0, column = at && at->column ? at->column - 1 : 0;
    fputs("{\"uri\":", out);
    if (at && at->file) diag_put_uri(out, at->file);
    else fputs("\"\"", out);
    fprintf(out,
            ",\"range\":{\"start\":{\"line\":%u,\"character\":%u},\"end\":{\"line\":%u,\"character\":%u}},"
            "\"severity\":%d,\"code\":",
            line, column, line, column + (uint32_t)(at && at->text ? strlen(at->text) : 0), severity);
    json_text(out, code);
    fputs(",\"source\":\"saltus\",\"message\":", out);
    json_text(out, text);
}

void cli_say(CliSeverity severity, const char *code, const SltPlace *at, const char *fmt, ...) {
    static const char *const words[] = {[CLI_ERROR] = "error", [CLI_WARNING] = "warning", [CLI_NOTE] = "note"};
    char text[2048];
    va_list ap;
    va_start(ap, fmt);
    vsnprintf(text, sizeof text, fmt, ap);
    va_end(ap);
    if (json_errors) {
        cli_put_json(stderr, severity, code, at, text);
        fputs("}\n", stderr);
    } else {
        fprintf(stderr, "saltus: %s: ", words[severity]);
        if (at) report_place(stderr, at);
        fprintf(stderr, "%s\n", text);
    }
}

void cli_put_error(FILE *out, int status, const char *text) {
    if (!json_errors) {
        fprintf(out, "saltus: %s\n", text);
        return;
    }
    cli_put_json(out, CLI_ERROR, status_name((SltStatus)status), NULL, text);
    fprintf(out, ",\"status\":%d}\n", status);
}

int cli_error(int status, const char *fmt, ...) {
    char text[2048];
    va_list ap;
    va_start(ap, fmt);
    vsnprintf(text, sizeof text, fmt, ap);
    va_end(ap);
    cli_put_error(stderr, status, text);
    return status;
}

int cli_unknown_format(const Cli *c) {
    char known[IMAGE_LIST_SIZE];
    return cli_usage(c, "-o %s: the extension is none of %s", c->output, image_list_formats(true, known));
}

int cli_fail(const Cli *c, const SltError *err) {
    SltStatus status = watch_status(err->status);
    const char *text = status != err->status ? "the time limit was reached" : err->text;
    (void)c;
    watch_commit();
    if (status == SLT_STOPPED) return SLT_STOPPED;
    return cli_error(status, "%s", text[0] ? text : status_name(status));
}

void *cli_need(void *p) {
    if (p) return p;
    back_open_end();
    exit(cli_error(SLT_LIMIT, "out of memory"));
}

static char *read_stdin(void) {
    size_t cap = 1 << 16, n = 0;
    char *text = cli_need(malloc(cap + 1));
    for (;;) {
        size_t got = fread(text + n, 1, cap - n, stdin);
        n += got;
        if (got == 0) break;
        if (n == cap) {
            if (cap > 64u << 20) break; /* the front end refuses it with a message */
            text = cli_need(realloc(text, (cap *= 2) + 1));
        }
    }
    text[n] = 0;
    return text;
}

/* An expression becomes a shader of the first of float, float2, float3, float4 that it fits. */
/* Whether another type of the result may help: not where a standard module could not be read. */
static bool errs_in_expr(const SltProgram *p) {
    SltDiagnostic d = SLT_DIAGNOSTIC_INIT;
    for (uint32_t i = 0; slt_diagnostic(p, i, &d); i++)
        if (d.severity == 1 && (strcmp(d.file, "<expr>") != 0 || d.line == 1)) return false;
    return true;
}

/* Places are told as people typed them: not those of the shader around the expression. */
static void show_expr_alone(const SltProgram *p, const char *source, const char *expr) {
    const char *at = strstr(source, "return\n") + strlen("return\n");
    for (uint32_t i = 0; p && i < p->session->nsources; i++) {
        Source *s = &p->session->sources[i];
        if (strcmp(s->path, "<expr>") != 0 || s->len < (uint32_t)(at - source) + strlen(expr)) continue;
        s->lead = 2, s->shown_end = (uint32_t)(at - source) + (uint32_t)strlen(expr);
    }
}

static SltStatus compile_expr(Cli *c, SltProgram **out) {
    static const char *const types[] = {"float", "float2", "float3", "float4"};
    SltProgram *first = NULL;
    SltStatus status = SLT_PROGRAM, first_status = SLT_PROGRAM;
    c->opt.disc_auto = true;
    for (int t = 0; t < 4; t++) {
        size_t size = strlen(c->expr) + 256;
        char *source = cli_need(malloc(size));
        snprintf(source, size, "import sdf; import color; import noise;\nshader %s main(float2 x) { return\n%s\n; }\n",
                 types[t], c->expr);
        SltProgram *p = NULL;
        status = slt_compile_string(source, "<expr>", &c->opt, &p);
        bool errs = p && errs_in_expr(p); /* NULL: memory ran out */
        show_expr_alone(p, source, c->expr);
        free(source);
        if (status != SLT_PROGRAM || !errs) {
            slt_program_free(first);
            *out = p;
            return status;
        }
        if (!first) first = p, first_status = status;
        else slt_program_free(p);
    }
    *out = first;
    return first_status;
}

/* print(): a line on standard error, in one piece whatever the threads do. */
static void on_print(void *user, const char *line, const double *values, uint32_t n) {
    char text[1024 + 1];
    (void)user, (void)values, (void)n;
    int length = snprintf(text, sizeof text, "%s\n", line);
    fwrite(text, 1, (size_t)length, stderr);
}

void cli_tell(Cli *c, SltProgram *p) {
    Session *s = p->session;
    Diag *all = s->diags, *first = all;
    for (uint32_t i = 0; i < c->told && first; i++) first = first->next;
    if (!first) return;
    s->diags = first;
    if (c->json) diag_print_json(s, stderr);
    else diag_print_text(s, stderr, isatty(2) && !getenv("NO_COLOR"));
    s->diags = all;
    c->told = slt_diagnostic_count(p);
}

static bool is_same_file(const char *a, const char *b) {
    struct stat x, y;
    return a && b && !stat(a, &x) && !stat(b, &y) && x.st_dev == y.st_dev && x.st_ino == y.st_ino;
}

/* An output that is a source or the scene is a slip of the hand. */
static int refuse_sources(const Cli *c, const SltProgram *p) {
    const char *const outputs[] = {c->output, c->checkpoint, c->cells};
    for (size_t k = 0; k < sizeof outputs / sizeof *outputs; k++) {
        bool same = is_same_file(outputs[k], c->scene);
        for (uint32_t i = 0; i < p->session->nsources; i++)
            same |= is_same_file(outputs[k], p->session->sources[i].path);
        if (!same) continue;
        return cli_error(SLT_OUTPUT, "'%s' is a source of this run, and would be overwritten", outputs[k]);
    }
    return SLT_OK;
}

static const char larger[] = " in single precision; --precision f64 holds larger numbers";

/* NaN and infinities are values like others, as are numbers that single precision takes for infinite; whoever meant
 * something else should hear of it. */
static void warn_not_finite(const Cli *c, const SltProgram *p) {
    for (uint32_t i = 0; i < c->nsets && !c->quiet && !c->opt.f64; i++)
        if (isinf((float)strtod(c->sets[i].value, NULL)))
            cli_say(CLI_WARNING, "not_finite", NULL, "const `%s` is infinite%s", c->sets[i].name, larger);
    for (uint32_t i = 0; i < slt_param_count(p) && !c->quiet; i++) {
        SltParam q = SLT_PARAM_INIT;
        slt_param(p, i, &q);
        if (q.is_texture) continue;
        const double *v = slt_floats(p) + q.fbase;
        for (uint32_t k = 0; k < q.fcount; k++) {
            bool large = isfinite(v[k]) && !c->opt.f64 && isinf((float)v[k]);
            if (isfinite(v[k]) && !large) continue;
            cli_say(CLI_WARNING, "not_finite", NULL, "parameter `%s` is %s%s", q.name, isnan(v[k]) ? "nan" : "infinite",
                    large ? larger : "");
            break;
        }
    }
}

/* Values outside of what [Range] promises; NaN has been warned of. */
static void warn_of_ranges(Session *s, void *user) {
    SltProgram *p = user;
    char name[256];
    for (uint32_t i = 0; i < p->prog->nparams; i++) {
        const Param *q = &p->prog->params[i];
        SltParam is = SLT_PARAM_INIT;
        slt_param(p, i, &is);
        for (uint32_t k = 0; is.has_range && k < q->fcount; k++) {
            double v = p->floats[q->fbase + k];
            if (!(v < is.lo || v > is.hi)) continue;
            report_component_name(p, q->fbase + k, name, sizeof name);
            diag_emit(s, DIAG_out_of_range, q->sym ? q->sym->span : SPAN_NONE, arena_printf(&s->session, "%s", name), v,
                      is.lo, is.hi);
            break; /* one of an array is enough */
        }
    }
}

void cli_forget_derivatives(SltProgram *p) {
    static const DiagCode of_them[] = {DIAG_untracked, DIAG_static_disc, DIAG_stepping,
                                       DIAG_steep,     DIAG_equal_steps, DIAG_counted_steps};
    Session *s = p->session;
    Diag **at = &s->diags;
    while (*at) {
        bool forget = false;
        for (size_t i = 0; i < sizeof of_them / sizeof *of_them; i++) forget |= (*at)->code == of_them[i];
        s->nwarnings -= forget;
        if (forget) *at = (*at)->next;
        else at = &(*at)->next;
    }
    s->diags_end = at;
}

/* For whoever waits: how much there is to search, and where most of it comes from. */
static void tell_costs(const Cli *c, const SltProgram *p) {
    const Fn *primal = p->prog->primal;
    uint64_t all = 0, most = 0;
    uint32_t line = 0, column, worst_line = 0, moving = 0;
    const SiteInfo *worst = NULL;
    if (c->verb->bit & (RENDER | BOUND | VIEW) || c->job.no_boundary) return;
    for (uint32_t s = 0; s < primal->nsites; s++) {
        const SiteInfo *i = &primal->sites[s];
        if (i->still) continue;
        uint64_t here = 0;
        span_position(p->session, i->span, &line, &column);
        /* One statement has as many sites as its function has calls. */
        for (uint32_t t = 0; t < primal->nsites && primal->nsites < 4096; t++) {
            const SiteInfo *k = &primal->sites[t];
            if (!k->still && k->span.file == i->span.file && k->span.pos == i->span.pos) here += k->max_events;
        }
        all += i->max_events, moving++;
        if (here > most) most = here, worst = i, worst_line = line;
    }
    if (!worst) return;
    char text[400], where[200] = "";
    if (worst->span.file >= 0)
        snprintf(where, sizeof where, " at %.150s:%u", p->session->sources[worst->span.file].path, worst_line);
    const char *sampling = c->verb->bit & (EXPLAIN | BUILD) ? "" : ", --interior-only all, fewer --samples are faster";
    snprintf(
        text, sizeof text,
        "%u site%s with at most %llu event%s in a sample, most of them (%llu)%s: [NoDisc] leaves a statement's out%s",
        moving, moving == 1 ? "" : "s", (unsigned long long)all, all == 1 ? "" : "s", (unsigned long long)most, where,
        sampling);
    watch_costs(text);
}

/* One command line, iTime and all, serves many shaders: some do not move. */
static bool is_unread(const Cli *c, const SltProgram *p, const char *name) {
    SltParam q = SLT_PARAM_INIT;
    if (!p->prog->is_glsl || !glsl_host_sets(name) || slt_param_find(p, name, &q, NULL) == SLT_OK) return false;
    if (!c->quiet) cli_say(CLI_NOTE, "unread", NULL, "the shader does not read `%s`", name);
    return true;
}

/* Kernels that will be compiled need LLVM, which takes longer to load than a program to parse. */
static void open_llvm_early(const Cli *c) {
    bool compiles = c->verb->run != verb_explain && !c->opt.interpret && !c->opt.stop_after;
    if (!compiles || pool_threads(c->job.threads, 2) < 2) return;
    back_open_early(c->expr || !strcmp(c->file, "-") ? NULL : c->file, c->opt.no_cache);
}

/* Compiles what the command line names; lengths: of open arrays, SltOptions. */
static SltStatus compile(Cli *c, const char *lengths, SltProgram **out) {
    SltStatus status;
    if (c->size_given) c->opt.size[0] = c->job.size[0], c->opt.size[1] = c->job.size[1];
    c->opt.lengths = lengths;
    open_llvm_early(c);
    if (c->expr) {
        status = compile_expr(c, out);
    } else if (!strcmp(c->file, "-")) {
        char *text = read_stdin(); /* which has no extension */
        if (c->opt.language == SLT_LANGUAGE_AUTO && api_looks_like_glsl(text)) c->opt.language = SLT_LANGUAGE_GLSL;
        status = slt_compile_string(text, "-", &c->opt, out);
        free(text);
    } else {
        status = slt_compile_file(c->file, &c->opt, out);
    }
    c->opt.lengths = NULL;
    cli_need(*out);
    return status;
}

/* The values of --params, which no values were if they could not be read: `read` says so behind the errors of the
 * program itself. */
static SltStatus set_values(Cli *c, SltProgram *p, const char *values, const SltError *read, SltError *err) {
    SltStatus status = read->status;
    if (status != SLT_OK) *err = *read;
    else if (values) status = slt_set_params_json(p, values, c->params_file, err);
    for (uint32_t i = 0; i < c->nparams && status == SLT_OK; i++)
        if (!is_unread(c, p, c->params[i].name)) status = slt_set_text(p, c->params[i].name, c->params[i].value, err);
    return status;
}

int cli_set_values(Cli *c, SltProgram *p) {
    SltError err = {0}, read = {0};
    uint8_t *values = NULL;
    size_t size;
    if (c->params_file) file_read_all(c->params_file, &file_text, &values, &size, &read);
    SltStatus status = set_values(c, p, (const char *)values, &read, &err);
    free(values);
    return status == SLT_OK ? SLT_OK : cli_fail(c, &err);
}

bool cli_frees_all(void) {
#ifdef SALTUS_SANITIZE
    return true;
#else
    return dlsym(RTLD_DEFAULT, "saltus_frees_all") != NULL;
#endif
}

void cli_end_program(SltProgram *p) {
    if (cli_frees_all()) slt_program_free(p);
}

int cli_compile(Cli *c, SltProgram **out) {
    SltError err = {0}, read = {0};
    uint8_t *values = NULL;
    size_t size;
    if (c->params_file) file_read_all(c->params_file, &file_text, &values, &size, &read);
    *out = NULL;
    SltStatus status = compile(c, (const char *)values, out);
    if (status == SLT_OK && values && cli_params_resize(c, *out, (const char *)values)) {
        slt_program_free(*out);
        status = compile(c, (const char *)values, out);
    }
    SltProgram *p = *out;
    if (c->verb->bit == RENDER) cli_forget_derivatives(p);
    bool told = slt_diagnostic_count(p) > 0;
    if (told && !(c->quiet && status == SLT_OK)) cli_tell(c, p);
    c->told = slt_diagnostic_count(p);
    if (status != SLT_OK) {
        free(values);
        bool listed = told && p->session->nerrors && status != SLT_LIMIT;
        /* A file that cannot be opened has no diagnostics: the library's last error says so. */
        if (!listed && status != SLT_STOPPED) cli_error(status, "%s", slt_last_error(p));
        return status;
    }
    status = (SltStatus)refuse_sources(c, p);
    if (status == SLT_OK) slt_set_print(p, on_print, NULL, NULL);
    bool refused = status != SLT_OK;
    if (!refused) status = set_values(c, p, (const char *)values, &read, &err);
    free(values);
    if (refused) return status;
    if (status != SLT_OK) return cli_fail(c, &err);
    warn_not_finite(c, p);
    if (c->nparams || c->params_file) session_protect(p->session, warn_of_ranges, p);
    if (!c->quiet) cli_tell(c, p);
    for (uint32_t i = 0; i < c->nwrt && c->verb->bit != FIT; i++)
        if (strstr(c->wrt[i], "[*]")) return cli_usage(c, "--wrt %s: many at once are for `fit`", c->wrt[i]);
    if (c->nwrt && slt_wrt(p, c->wrt, c->nwrt, &err) != SLT_OK) return cli_fail(c, &err);
    tell_costs(c, p);
    return SLT_OK;
}

/* Will compiling take longer than running, even if loops run to their ends? Then kernels are compiled in less time for
 * running more slowly. The process is over behind the job: nobody will run them on more. */
static bool has_few_samples(const Cli *c, const SltProgram *p) {
    enum { FEW = 1 << 25 }; /* instructions of all samples: a few milliseconds */
    const SltJob *j = &c->job;
    if (!(c->verb->bit & (RENDER | GRAD)) || j->error > 0 || j->abs_error > 0 || j->estimator == SLT_EST_FD)
        return false;
    double times = j->integral ? 1 : (double)j->size[0] * j->size[1] * j->size[2],
           samples = j->integral ? (double)j->samples : times * j->spp;
    if (c->verb->bit == GRAD && !j->integral && !c->target && !c->adjoint) { /* one parameter at a time */
        uint32_t wanted = 1;
        for (uint32_t i = 0; i < slt_float_count(p); i++) wanted += p->wrt[i];
        times *= wanted, samples *= wanted;
    }
    return fmax(samples, times * (double)j->segments) * walk_work(p->prog->primal->body) <= FEW;
}

int cli_prepare_job(Cli *c, SltProgram *p) {
    uint32_t dim = slt_dim(p);
    for (uint32_t d = dim; d < 3; d++) {
        if (c->size_dims > dim && c->job.size[d] > 1)
            return cli_usage(c, "--size has more dimensions than the %uD domain of `%s`", dim, slt_entry(p));
        c->job.size[d] = 1;
    }
    if (!c->size_given && dim == 3) c->job.size[0] = c->job.size[1] = c->job.size[2] = 64;
    if (c->job.integral) {
        c->job.size[0] = c->job.size[1] = c->job.size[2] = 1;
        if (!c->samples_given) c->job.samples = 1u << 18;
    }
    double values = (double)c->job.size[0] * c->job.size[1] * c->job.size[2] * slt_channels(p);
    if (values > (double)(1u << 28)) {
        return cli_error(SLT_LIMIT, "an image of %ux%ux%u with %u channels is larger than the limit of 2^28 values",
                         c->job.size[0], c->job.size[1], c->job.size[2], slt_channels(p));
    }
    p->few_samples = has_few_samples(c, p);
    p->side_room = CLI_HEAP;
    return SLT_OK;
}

SltStatus cli_size_of_image(const char *path, bool volume, uint32_t size[3], SltError *err) {
    Image im;
    int depth = 1;
    SltStatus status = volume ? volume_read(path, NULL, &im, &depth, err) : image_read(path, NULL, &im, err);
    if (status != SLT_OK) return status;
    size[0] = (uint32_t)im.width, size[1] = (uint32_t)(im.height / depth);
    if (volume) size[2] = (uint32_t)depth;
    image_free(&im);
    return SLT_OK;
}

int cli_read_image(Cli *c, SltProgram *p, const char *path, bool resize, float **out) {
    SltError err = {0};
    Image im, root, sized, fitted;
    *out = NULL;
    ImageReadOptions read = {.raw = slt_is_display(p)};
    bool volume = slt_dim(p) == 3;
    int depth = 1;
    if ((volume ? volume_read(path, &read, &im, &depth, &err) : image_read(path, &read, &im, &err)) != SLT_OK)
        return cli_fail(c, &err);
    if (volume && (uint32_t)depth != c->job.size[2]) {
        image_free(&im);
        return cli_error(SLT_INPUT, "%s has %d slices, but the volume is %ux%ux%u", path, depth, c->job.size[0],
                         c->job.size[1], c->job.size[2]);
    }
    /* The root layer of a file with many. */
    SltStatus status = im.channels > 4 ? image_extract_layer(&im, "", &root, &err) : SLT_OK;
    if (im.channels > 4) image_free(&im);
    else root = im;
    if (status != SLT_OK) return cli_fail(c, &err);
    int w = (int)c->job.size[0], h = (int)c->job.size[1] * depth;
    if (root.width != w || root.height != h) {
        if (volume || !resize) {
            cli_error(SLT_INPUT, "%s is %dx%d, but the image is %dx%d; give --size %dx%d", path, root.width,
                      root.height, w, h, root.width, root.height);
            image_free(&root);
            return SLT_INPUT;
        }
        if (!c->quiet)
            cli_say(CLI_NOTE, "resized", NULL, "%s is resized from %dx%d to %dx%d", path, root.width, root.height, w,
                    h);
        status = image_resize(&root, w, h, &sized, &err);
        image_free(&root);
        if (status != SLT_OK) return cli_fail(c, &err);
        root = sized;
    }
    status = image_take_channels(&root, (int)slt_channels(p), &fitted, &err);
    if (status != SLT_OK) return cli_fail(c, &err);
    *out = fitted.data, fitted.data = NULL;
    image_free(&fitted);
    return SLT_OK;
}
