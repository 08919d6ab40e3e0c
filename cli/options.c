/* The command line: one table of options, from which the help is printed too. */
#include <errno.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "cli/cli.h"

/* clang-format off */
typedef enum OptionId {
    O_ENTRY, O_SET, O_PARAM, O_PARAMS, O_SIZE, O_SPP, O_SEGMENTS, O_SAMPLES, O_FILTER, O_SEED, O_THREADS, O_PRECISION, O_DISC, O_INTERIOR, O_BOUNDARY,
    O_ESTIMATOR, O_WIDTH, O_INCLUDE, O_JSON, O_QUIET, O_NO_CACHE, O_OUTPUT, O_WRT, O_FORMAT, O_INTEGRAL, O_TARGET, O_ADJOINT, O_ITERS, O_OPTIMIZER, O_LR, O_SMOOTH,
    O_MINIMIZE, O_CHECKPOINT, O_EVERY, O_RESUME, O_KERNELS, O_ESTIMATORS, O_REPEATS, O_MAX_SECONDS, O_AT, O_EXPR, O_DUMP, O_TARGET_CPU, O_INTERPRET, O_NEAR_MISS,
    O_VARIANT, O_TOLERANCE, O_VERIFY, O_LOSS_COMMAND, O_LOSS_TIMEOUT, O_FIELD, O_HELP
} OptionId;

enum { RENDER = 1, GRAD = 2, FIT = 4, CHECK = 8, BENCH = 16, EXPLAIN = 32, BUILD = 64, ALL = 127, RUN = RENDER | GRAD | FIT | CHECK | BENCH };
/* clang-format on */

typedef struct Option {
    OptionId id;
    const char *name, *arg; /* arg NULL: a flag */
    int verbs;
    const char *help;
} Option;

static const Option options[] = {
    {O_OUTPUT, "-o", "FILE", ALL, "where the result goes; the extension says what it is"},
    {O_WRT, "--wrt", "P,Q", GRAD | FIT | CHECK | BENCH | EXPLAIN | BUILD,
     "differentiate with respect to these parameters or components only"},
    {O_INTEGRAL, "--integral", NULL, RENDER | GRAD | CHECK | BENCH | EXPLAIN,
     "the integral over the whole domain instead of an image"},
    {O_TARGET, "--target", "IMAGE", GRAD | FIT, "the loss is the mean of (image - target)^2"},
    {O_ADJOINT, "--adjoint", "IMAGE", GRAD, "gradient of the sum of adjoint * image"},
    {O_MINIMIZE, "--minimize", NULL, FIT, "the integral of the entry itself is the loss"},
    {O_ITERS, "--iters", "N", FIT, "optimiser iterations (default 200)"},
    {O_OPTIMIZER, "--optimizer", "adam|sgd|lbfgs", FIT, "default adam"},
    {O_LR, "--lr", "R or P=R,..", FIT, "learning rate, also for single parameters"},
    {O_SMOOTH, "--smooth", "P=LAMBDA", FIT, "Laplacian preconditioning of a grid-shaped parameter"},
    {O_LOSS_COMMAND, "--loss-command", "COMMAND", FIT,
     "a program that gets every image through a pipe and answers with the loss and its adjoint image"},
    {O_LOSS_TIMEOUT, "--loss-timeout", "S", FIT, "seconds to wait for an answer of it (default 600)"},
    {O_CHECKPOINT, "--checkpoint", "FILE", FIT, "save the state of the fit here"},
    {O_EVERY, "--every", "N", FIT, "iterations between checkpoints (default 10)"},
    {O_RESUME, "--resume", "FILE", FIT, "go on from a checkpoint, to the same bits as an unbroken run"},
    {O_KERNELS, "--kernels", NULL, BENCH, "time every compiled kernel instead"},
    {O_ESTIMATORS, "--estimators", "A,B", BENCH, "which to compare (default: all that apply)"},
    {O_REPEATS, "--repeats", "N", BENCH, "independent runs per point (default 8)"},
    {O_MAX_SECONDS, "--max-seconds", "S", RUN, "stop with status 6 after this long"},
    {O_TOLERANCE, "--tolerance", "Z", CHECK, "standard errors allowed (default 4)"},
    {O_AT, "--at", "X,Y", EXPLAIN, "the story of one point"},
    {O_FORMAT, "--format", "rgba8", RENDER, "the kernel itself writes 8-bit pixels"},
    {O_ENTRY, "--entry", "NAME", ALL, "which shader (default main, or the only one)"},
    {O_SET, "--set", "[M.]N=5", ALL, "value of a const at file scope"},
    {O_PARAM, "--param", "P=V", ALL,
     "value of a parameter: a number, [1,2], or @file (.csv .json .exr .npy .png .f32 .hgt)"},
    {O_PARAMS, "--params", "FILE", ALL, "values from a JSON file, as `fit` writes it"},
    {O_SIZE, "--size", "N|WxH|WxHxD", ALL, "pixels (default 512x512)"},
    {O_SPP, "--spp", "N", ALL, "samples a pixel"},
    {O_SAMPLES, "--samples", "N", ALL, "samples in all, with --integral (default 2^18)"},
    {O_SEGMENTS, "--segments", "N", ALL, "boundary segments a pixel, or in all with --integral"},
    {O_FILTER, "--filter", "box|tent|gaussian", RUN, "pixel filter (default box)"},
    {O_SEED, "--seed", "S", ALL, "same seed, same bits"},
    {O_THREADS, "--threads", "T", ALL, "default: all cores"},
    {O_PRECISION, "--precision", "f32|f64", ALL, "of float"},
    {O_DISC, "--disc", "tagged|auto", ALL, "auto: every comparison counts as [Disc]"},
    {O_INTERIOR, "--interior-only", NULL, ALL, "leave the moving jumps out"},
    {O_BOUNDARY, "--boundary-only", NULL, ALL, "only the moving jumps"},
    {O_ESTIMATOR, "--estimator", "NAME", ALL, "one of"
#define SLT_ESTIMATOR(id, name, ...) " " name
#define SLT_DIFFERENCES(id, name, ...) " " name
#include "saltus/estimators.def"
    },
    {O_NEAR_MISS, "--near-miss", "on|off|auto", ALL, "look for features between the samples"},
    {O_VARIANT, "--variant", "argmin|forced|path", ALL,
     "the paper's branch index or two-sided variant, or regions by path, for comparison"},
    {O_FIELD, "--field", "mipmap|cone|naive", ALL,
     "what finds where rays meet a heightfield (default mipmap); the answers are the same"},
    {O_WIDTH, "--width", "W", ALL, "SIMD lanes; 1 is scalar"},
    {O_TARGET_CPU, "--target-cpu", "NAME", ALL, "native, avx512, avx2 or sse2"},
    {O_INTERPRET, "--interpret", NULL, RUN, "run in the interpreter (slow, the oracle)"},
    {O_EXPR, "--expr", "EXPR", ALL, "a shader from one expression in x instead of a file"},
    {O_INCLUDE, "-I", "DIR", ALL, "search imports here too"},
    {O_JSON, "--json", NULL, ALL, "one JSON object on standard output"},
    {O_QUIET, "--quiet", NULL, ALL, "no progress and no notes"},
    {O_NO_CACHE, "--no-cache", NULL, ALL, "compile afresh"},
    {O_DUMP, "--dump", "PASS", ALL, "print the IR after this pass (or all)"},
    {O_VERIFY, "--verify", NULL, ALL, "verify the IR after every pass"},
    {O_HELP, "--help", NULL, ALL, "this text"},
};
enum { NOPTIONS = sizeof options / sizeof *options };

typedef struct Verb {
    const char *name;
    int bit;
    const char *usage, *what, *example;
} Verb;

static const Verb verbs[] = {
    {"render", RENDER, "render FILE [-o out.exr]", "the image (or volume, or curve) of a shader",
     "saltus render examples/circle/circle.salt -o circle.png"},
    {"grad", GRAD, "grad FILE [--wrt p,q]", "derivatives: images, totals, or of a loss",
     "saltus grad examples/circle/circle.salt --integral --wrt radius"},
    {"fit", FIT, "fit FILE|SCENE.json [--target t.exr]", "optimise parameters",
     "saltus fit examples/painterly_discs/discs.salt --target photo.png -o fitted/"},
    {"check", CHECK, "check FILE [--wrt p,q]", "certify the derivatives against finite differences",
     "saltus check examples/circle/circle.salt"},
    {"bench", BENCH, "bench FILE", "error against run time, as a table, JSON and a plot",
     "saltus bench examples/circle/circle.salt --integral -o bench/"},
    {"explain", EXPLAIN, "explain FILE|E0123", "sites, variants, what was left out, what it will cost",
     "saltus explain examples/circle/circle.salt"},
    {"build", BUILD, "build FILE -o out.(o|s|ll|so|h)", "ahead-of-time code with a C header",
     "saltus build shader.salt -o shader.o"},
};
enum { NVERBS = sizeof verbs / sizeof *verbs };

static const Verb *find_verb(const char *name) {
    for (int v = 0; name && v < NVERBS; v++)
        if (!strcmp(verbs[v].name, name)) return &verbs[v];
    return NULL;
}

void cli_help(FILE *out, const char *name) {
    const Verb *verb = find_verb(name);
    if (!verb) {
        fputs(
            "Example:\n  saltus render --expr 'length(x - 0.5) < 0.4 ? 1.0 : 0.1' -o disc.png\n"
            "  saltus grad examples/circle/circle.salt --integral\n\n"
            "Saltus compiles shaders whose branches may jump, and differentiates their integrals, the moving jumps included.\n\n",
            out);
        for (int v = 0; v < NVERBS; v++) fprintf(out, "  saltus %-38s %s\n", verbs[v].usage, verbs[v].what);
        fputs(
            "  saltus --version | --help | COMMAND --help\n\nFILE may be - (standard input) or --expr 'EXPRESSION in x'.\n",
            out);
        return;
    }
    fprintf(out, "Example:\n  %s\n\nUsage: saltus %s\n%s.\n\n", verb->example, verb->usage, verb->what);
    for (int i = 0; i < NOPTIONS; i++) {
        if (!(options[i].verbs & verb->bit)) continue;
        char left[64];
        snprintf(left, sizeof left, "%s%s%s", options[i].name, options[i].arg ? " " : "",
                 options[i].arg ? options[i].arg : "");
        fprintf(out, "  %-30s %s\n", left, options[i].help);
    }
    fputs("\nExit status: 0 done, 1 a check, fit or assert failed, 2 usage, 3 error in the program, 4 bad input file,\n"
          "5 output not written, 6 a limit was reached, 70 a fault of ours, 130 interrupted.\n",
          out);
}

int cli_usage(const Cli *c, const char *fmt, ...) {
    va_list ap;
    va_start(ap, fmt);
    fputs("saltus: ", stderr);
    vfprintf(stderr, fmt, ap);
    va_end(ap);
    fprintf(stderr, " (see `saltus %s%s--help`)\n", c->verb ? c->verb : "", c->verb ? " " : "");
    return SLT_USAGE;
}

static bool parse_number(const char *text, double lo, double hi, double *out) {
    char *end;
    errno = 0;
    *out = strtod(text, &end);
    return end != text && !*end && *out >= lo && *out <= hi;
}

static bool parse_whole(const char *text, uint64_t lo, uint64_t hi, uint64_t *out) {
    char *end;
    errno = 0;
    if (*text < '0' || *text > '9') return false;
    *out = strtoull(text, &end, 10);
    if (*end == '^' && *out == 2) { /* 2^18, as people write it */
        uint64_t power = strtoull(end + 1, &end, 10);
        if (power > 62) return false;
        *out = 1ull << power;
    }
    return !errno && !*end && *out >= lo && *out <= hi;
}

static char *keep(Cli *c, const char *text) {
    char *copy = strdup(text);
    if (!copy || c->nargs_storage == CLI_MAX_KEPT) return free(copy), NULL;
    return c->args_storage[c->nargs_storage++] = copy;
}

/* "name=value"; false without an =. */
static bool split_assign(Cli *c, const char *text, Assign *out) {
    const char *eq = strchr(text, '=');
    if (!eq || eq == text) return false;
    char *copy = keep(c, text);
    if (!copy) return false;
    copy[eq - text] = 0;
    *out = (Assign){copy, copy + (eq - text) + 1};
    return true;
}

static int too_many(Cli *c, const char *name) {
    return cli_usage(c, "%s names more than %d things", name, CLI_MAX_LIST);
}

/* A list with commas that are not inside brackets: "discs[3].x,a" */
static int split_list(Cli *c, const char *name, const char *text, const char **list, uint32_t *n) {
    char *copy = keep(c, text);
    if (!copy) return too_many(c, name);
    int depth = 0;
    char *start = copy;
    for (char *s = copy;; s++) {
        if (*s == '[') depth++;
        if (*s == ']') depth--;
        if (*s && !(*s == ',' && depth <= 0)) continue;
        bool last = !*s;
        *s = 0;
        if (*start && *n == CLI_MAX_LIST) return too_many(c, name);
        if (*start) list[(*n)++] = start;
        start = s + 1;
        if (last) return SLT_OK;
    }
}

static int choice(const char *text, const char *const *names, int n) {
    for (int i = 0; i < n; i++)
        if (!strcmp(text, names[i])) return i;
    return -1;
}

static bool parse_size(Cli *c, const char *text) {
    uint32_t n = 0;
    const char *s = text;
    while (n < 3) {
        char *end;
        if (*s < '0' || *s > '9') return false;
        unsigned long v = strtoul(s, &end, 10);
        if (v < 1 || v > 1u << 20) return false;
        c->job.size[n++] = (uint32_t)v;
        if (!*end) break;
        if (*end != 'x' || n == 3) return false;
        s = end + 1;
    }
    for (uint32_t d = n; d < 3; d++) c->job.size[d] = n == 1 ? c->job.size[0] : 1;
    c->size_given = true;
    return true;
}

static int apply_rates(Cli *c, const char *name, const char *v, Assign *list, uint32_t *n) {
    const char *parts[CLI_MAX_LIST];
    uint32_t count = 0;
    double x;
    if (split_list(c, name, v, parts, &count) != SLT_OK) return SLT_USAGE;
    for (uint32_t i = 0; i < count; i++) {
        Assign a;
        if (!split_assign(c, parts[i], &a)) a = (Assign){NULL, parts[i]};
        if (!parse_number(a.value, 0, 1e30, &x)) return cli_usage(c, "%s: `%s` is not a number", name, a.value);
        if (*n == CLI_MAX_LIST) return too_many(c, name);
        list[(*n)++] = a;
    }
    return SLT_OK;
}

static int apply(Cli *c, const Option *o, const char *v) {
    static const char *const filters[] = {"box", "tent", "gaussian"},
                             *const estimators[] =
                                 {
#define SLT_ESTIMATOR(id, name, ...) name,
#define SLT_DIFFERENCES(id, name, ...) name,
#include "saltus/estimators.def"
                                 },
                             *const optimizers[] = {"adam", "sgd", "lbfgs"},
                             *const structures[] = {"mipmap", "cone", "naive"};
    uint64_t whole = 0;
    double number = 0;
    int pick;
    Assign assign;
#define WHOLE(lo, hi)                                                                                                  \
    if (!parse_whole(v, lo, hi, &whole)) return cli_usage(c, "%s: `%s` is not a whole number from %llu to %llu", o->name, v, (unsigned long long)(lo), (unsigned long long)(hi))
#define CHOICE(list)                                                                                                   \
    if ((pick = choice(v, list, (int)(sizeof list / sizeof *list))) < 0) return cli_usage(c, "%s: unknown `%s`; known: %s", o->name, v, o->arg)
    switch (o->id) {
    case O_ENTRY: c->opt.entry = v; break;
    case O_SET:
        if (!split_assign(c, v, &assign)) return cli_usage(c, "--set wants NAME=VALUE, not `%s`", v);
        if (c->nsets == CLI_MAX_LIST) return too_many(c, o->name);
        c->sets[c->nsets++] = (SltSet){assign.name, assign.value};
        break;
    case O_PARAM:
        if (!split_assign(c, v, &assign)) return cli_usage(c, "--param wants NAME=VALUE, not `%s`", v);
        if (c->nparams == CLI_MAX_LIST) return too_many(c, o->name);
        c->params[c->nparams++] = assign;
        if (assign.value[0] == '@') c->param_files[c->nparam_files++] = (SltSet){assign.name, assign.value + 1};
        break;
    case O_PARAMS: c->params_file = v; break;
    case O_SIZE:
        if (!parse_size(c, v)) return cli_usage(c, "--size wants N, WxH or WxHxD, not `%s`", v);
        break;
    case O_SPP:
        WHOLE(1, 1u << 24);
        c->job.spp = (uint32_t)whole, c->spp_given = true;
        break;
    case O_SEGMENTS:
        WHOLE(1, 1ull << 40);
        c->job.segments = whole;
        break;
    case O_SAMPLES:
        WHOLE(1, 1ull << 40);
        c->job.samples = whole, c->samples_given = true;
        break;
    case O_FILTER:
        CHOICE(filters);
        c->job.filter = (SltFilter)pick;
        break;
    case O_SEED:
        WHOLE(0, UINT32_MAX);
        c->job.seed = c->opt.seed = (uint32_t)whole;
        break;
    case O_THREADS:
        WHOLE(0, 1024);
        c->job.threads = (uint32_t)whole;
        break;
    case O_PRECISION:
        if (strcmp(v, "f32") && strcmp(v, "f64")) return cli_usage(c, "--precision is f32 or f64, not `%s`", v);
        c->opt.f64 = !strcmp(v, "f64");
        break;
    case O_DISC:
        if (strcmp(v, "tagged") && strcmp(v, "auto")) return cli_usage(c, "--disc is tagged or auto, not `%s`", v);
        c->opt.disc_auto = !strcmp(v, "auto");
        break;
    case O_INTERIOR: c->job.no_boundary = true; break;
    case O_BOUNDARY: c->job.no_interior = true; break;
    case O_ESTIMATOR:
        CHOICE(estimators);
        c->job.estimator = (SltEstimator)pick, c->estimator_given = true;
        break;
    case O_WIDTH:
        WHOLE(1, 64);
        if (whole & (whole - 1)) return cli_usage(c, "--width is 1, 2, 4, 8, 16, 32 or 64, not %s", v);
        c->opt.width = (uint32_t)whole;
        break;
    case O_INCLUDE:
        if (c->nimport_dirs == CLI_MAX_LIST) return too_many(c, o->name);
        c->import_dirs[c->nimport_dirs++] = v;
        break;
    case O_JSON: c->json = true; break;
    case O_QUIET: c->quiet = true; break;
    case O_NO_CACHE: c->opt.no_cache = true; break;
    case O_OUTPUT: c->output = v; break;
    case O_WRT: return split_list(c, o->name, v, c->wrt, &c->nwrt);
    case O_FORMAT:
        if (strcmp(v, "rgba8") && strcmp(v, "float")) return cli_usage(c, "--format is rgba8 or float, not `%s`", v);
        c->rgba8 = c->opt.rgba8 = !strcmp(v, "rgba8");
        break;
    case O_INTEGRAL: c->job.integral = true; break;
    case O_TARGET: c->target = v; break;
    case O_ADJOINT: c->adjoint = v; break;
    case O_MINIMIZE: c->minimize = true; break;
    case O_ITERS:
        WHOLE(0, 100000000);
        c->iters = (uint32_t)whole, c->iters_given = true;
        break;
    case O_OPTIMIZER:
        CHOICE(optimizers);
        c->optimizer = optimizers[pick], c->optimizer_given = true;
        break;
    case O_LR: return apply_rates(c, "--lr", v, c->lr, &c->nlr);
    case O_SMOOTH: return apply_rates(c, "--smooth", v, c->smooth, &c->nsmooth);
    case O_CHECKPOINT: c->checkpoint = v; break;
    case O_EVERY:
        WHOLE(1, 100000000);
        c->every = (uint32_t)whole;
        break;
    case O_RESUME: c->resume = v; break;
    case O_KERNELS: c->kernels = true; break;
    case O_ESTIMATORS: c->estimators = v; break;
    case O_REPEATS:
        WHOLE(1, 10000);
        c->repeats = (uint32_t)whole;
        break;
    case O_MAX_SECONDS:
        if (!parse_number(v, 1e-3, 1e9, &number))
            return cli_usage(c, "--max-seconds: `%s` is not a time in seconds", v);
        c->max_seconds = c->job.time_limit = number;
        break;
    case O_TOLERANCE:
        if (!parse_number(v, 0.1, 100, &number))
            return cli_usage(c, "--tolerance: `%s` is not a number from 0.1 to 100", v);
        c->tolerance = number;
        break;
    case O_LOSS_COMMAND: c->loss_command = v; break;
    case O_LOSS_TIMEOUT:
        if (!parse_number(v, 1e-3, 1e9, &number))
            return cli_usage(c, "--loss-timeout: `%s` is not a time in seconds", v);
        c->loss_timeout = number, c->loss_timeout_given = true;
        break;
    case O_FIELD:
        CHOICE(structures);
        c->opt.field = (SltStructure)(SLT_STRUCTURE_MIPMAP + pick);
        break;
    case O_AT: c->at = v; break;
    case O_EXPR: c->expr = v; break;
    case O_DUMP: c->opt.dump = v; break;
    case O_VERIFY: c->opt.verify = true; break;
    case O_TARGET_CPU: c->opt.target = v; break;
    case O_INTERPRET: c->opt.interpret = true; break;
    case O_NEAR_MISS:
        if (strcmp(v, "on") && strcmp(v, "off") && strcmp(v, "auto"))
            return cli_usage(c, "--near-miss is on, off or auto, not `%s`", v);
        c->opt.near_miss = !strcmp(v, "on") ? 1 : !strcmp(v, "off") ? 0 : -1;
        break;
    case O_VARIANT:
        if (!strcmp(v, "argmin")) c->opt.paper_argmin = true;
        else if (!strcmp(v, "forced")) c->opt.paper_forced = true;
        else if (!strcmp(v, "path")) c->opt.path_hash = true;
        else return cli_usage(c, "--variant is argmin, forced or path, not `%s`", v);
        break;
    case O_HELP: break;
    }
    return SLT_OK;
}

static const Option *find_option(const Cli *c, const char *text, size_t len, int *status) {
    const char *names[NOPTIONS + 1];
    uint32_t n = 0;
    const Verb *verb = find_verb(c->verb);
    for (int i = 0; i < NOPTIONS; i++) {
        if (!(options[i].verbs & verb->bit)) continue;
        if (strlen(options[i].name) == len && !strncmp(options[i].name, text, len)) return &options[i];
        names[n++] = options[i].name;
    }
    char wanted[128];
    snprintf(wanted, sizeof wanted, "%.*s", (int)(len < 100 ? len : 100), text);
    for (int i = 0; i < NOPTIONS; i++)
        if (!strcmp(options[i].name, wanted)) {
            *status = cli_usage(c, "`%s` is not an option of `%s`", wanted, c->verb);
            return NULL;
        }
    const char *near = suggest_nearest(wanted, names, n);
    *status = near ? cli_usage(c, "unknown option `%s`; did you mean `%s`?", wanted, near)
                   : cli_usage(c, "unknown option `%s`", wanted);
    return NULL;
}

int cli_parse(int argc, char **argv, Cli *c) {
    memset(c, 0, sizeof *c);
    c->opt = SLT_OPTIONS_INIT;
    c->job = SLT_JOB_INIT;
    c->iters = 200, c->every = 10, c->repeats = 8, c->tolerance = 4, c->loss_timeout = 600;
    c->optimizer = "adam";
    if (argc < 2) {
        cli_help(stderr, NULL);
        return SLT_USAGE;
    }
    if (!strcmp(argv[1], "--help") || !strcmp(argv[1], "-h") || !strcmp(argv[1], "help")) {
        cli_help(stdout, argc > 2 ? argv[2] : NULL);
        return -1;
    }
    if (!strcmp(argv[1], "--version")) {
        Target t;
        target_host(&t);
        printf("saltus %s, LLVM %s (%s), targets native avx512 avx2 sse2, SIMD %u bytes (%u lanes of f32), cpu %s\n",
               slt_version(), back_llvm_version(), back_llvm_file(), t.vector_bytes, t.vector_bytes / 4, t.cpu);
        return -1;
    }
    if (!find_verb(argv[1])) {
        const char *names[NVERBS];
        for (int v = 0; v < NVERBS; v++) names[v] = verbs[v].name;
        const char *near = suggest_nearest(argv[1], names, NVERBS);
        return near ? cli_usage(c, "unknown command `%s`; did you mean `%s`?", argv[1], near)
                    : cli_usage(c, "unknown command `%s`", argv[1]);
    }
    c->verb = argv[1];
    bool options_end = false;
    for (int i = 2; i < argc; i++) {
        const char *a = argv[i];
        if (!options_end && !strcmp(a, "--")) {
            options_end = true;
            continue;
        }
        if (options_end || a[0] != '-' || !strcmp(a, "-")) {
            if (c->file) return cli_usage(c, "one FILE is wanted; `%s` and `%s` were given", c->file, a);
            c->file = a;
            continue;
        }
        if (!strcmp(a, "--help") || !strcmp(a, "-h")) {
            cli_help(stdout, c->verb);
            return -1;
        }
        const char *value = NULL;
        size_t len = strlen(a);
        if (a[1] == '-' && strchr(a, '=')) {
            value = strchr(a, '=') + 1;
            len = (size_t)(value - 1 - a);
        } else if (a[1] != '-' && len > 2 && (a[1] == 'I' || a[1] == 'o')) {
            value = a + 2;
            len = 2;
        }
        int status = SLT_OK;
        const Option *o = find_option(c, a, len, &status);
        if (!o) return status;
        if (!o->arg && value) return cli_usage(c, "%s takes no value", o->name);
        if (o->arg && !value) {
            if (i + 1 >= argc) return cli_usage(c, "%s wants a value: %s", o->name, o->arg);
            value = argv[++i];
        }
        status = apply(c, o, value);
        if (status != SLT_OK) return status;
    }
    if (!c->file && !c->expr) return cli_usage(c, "a FILE (or - or --expr) is wanted");
    if (c->file && c->expr) return cli_usage(c, "FILE and --expr were both given");
    if (c->job.no_interior && c->job.no_boundary)
        return cli_usage(c, "--interior-only and --boundary-only leave nothing");
    c->opt.set = c->sets, c->opt.nset = c->nsets;
    c->opt.param_files = c->param_files, c->opt.nparam_files = c->nparam_files;
    c->opt.import_dirs = c->import_dirs, c->opt.nimport_dirs = c->nimport_dirs;
    return SLT_OK;
}
