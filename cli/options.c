/* The command line: options.def and verbs.def, from which the help is printed too. */
#include <errno.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "cli/cli.h"
#include "compiler/back/back.h"

static const Verb verbs[] = {
#define VERB(id, name, usage, what, example) {#name, usage, what, example, 1u << VERB_##id, verb_##name},
#include "cli/verbs.def"
#undef VERB
};

static const Verb *find_verb(const char *name) {
    for (int v = 0; name && v < VERB_COUNT; v++)
        if (!strcmp(verbs[v].name, name)) return &verbs[v];
    return NULL;
}

int cli_usage(const Cli *c, const char *fmt, ...) {
    char text[1024];
    va_list ap;
    va_start(ap, fmt);
    vsnprintf(text, sizeof text, fmt, ap);
    va_end(ap);
    return cli_error(SLT_USAGE, "%s (see `saltus %s%s--help`)", text, c->verb ? c->verb->name : "", c->verb ? " " : "");
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
    if (c->nargs_storage == CLI_MAX_KEPT) return NULL;
    return c->args_storage[c->nargs_storage++] = cli_need(strdup(text));
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

int cli_choice(const char *names, const char *text) {
    size_t n = strlen(text);
    for (int i = 0; names; i++) {
        if (strcspn(names, "|") == n && !strncmp(names, text, n)) return i;
        names = strchr(names, '|');
        if (names) names++;
    }
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
    c->size_dims = n;
    return true;
}

/* ---- setters: what a row does with the text behind its option; SLT_OK or SLT_USAGE */
typedef struct Option Option;
typedef int Setter(Cli *c, const Option *o, const char *v);

struct Option {
    const char *name, *arg; /* arg NULL: a flag; "[=V]": a flag that may have a value */
    uint32_t verbs;         /* 1 << VerbId of those that take it */
    const char *help;
    Setter *set;
    size_t at, bytes; /* the member of Cli that takes the value */
    double lo, hi;
    int first;    /* CHOICE */
    size_t given; /* the member that notes that the option was there; 0: none */
};

static bool may_have_value(const Option *o) { return o->arg && !strncmp(o->arg, "[=", 2); }
static void *member(Cli *c, size_t at) { return (char *)c + at; }

static int set_flag(Cli *c, const Option *o, const char *v) {
    (void)v;
    *(bool *)member(c, o->at) = true;
    return SLT_OK;
}

static int set_text(Cli *c, const Option *o, const char *v) {
    *(const char **)member(c, o->at) = v;
    return SLT_OK;
}

static int set_whole(Cli *c, const Option *o, const char *v) {
    uint64_t x;
    if (!parse_whole(v, (uint64_t)o->lo, (uint64_t)o->hi, &x))
        return cli_usage(c, "%s: `%s` is not a whole number from %.0f to %.0f", o->name, v, o->lo, o->hi);
    if (o->bytes == 8) *(uint64_t *)member(c, o->at) = x;
    else *(uint32_t *)member(c, o->at) = (uint32_t)x;
    return SLT_OK;
}

static int set_number(Cli *c, const Option *o, const char *v) {
    if (parse_number(v, o->lo, o->hi, member(c, o->at))) return SLT_OK;
    return cli_usage(c, "%s: `%s` is not a number from %g to %g", o->name, v, o->lo, o->hi);
}

static int set_one_of(Cli *c, const Option *o, const char *v) {
    if (cli_choice(o->arg, v) < 0) return cli_usage(c, "%s: unknown `%s`; known: %s", o->name, v, o->arg);
    return set_text(c, o, v);
}

static int set_choice(Cli *c, const Option *o, const char *v) {
    int pick = cli_choice(o->arg, v);
    if (pick < 0) return cli_usage(c, "%s: unknown `%s`; known: %s", o->name, v, o->arg);
    if (o->bytes == sizeof(bool)) *(bool *)member(c, o->at) = pick;
    else *(int *)member(c, o->at) = o->first + pick;
    return SLT_OK;
}

static int set_wrt(Cli *c, const Option *o, const char *v) { return split_list(c, o->name, v, c->wrt, &c->nwrt); }

static int set_const(Cli *c, const Option *o, const char *v) {
    Assign a;
    if (!split_assign(c, v, &a)) return cli_usage(c, "%s wants NAME=VALUE, not `%s`", o->name, v);
    if (c->nsets == CLI_MAX_LIST) return too_many(c, o->name);
    c->sets[c->nsets++] = (SltSet){a.name, a.value};
    return SLT_OK;
}

static int set_param(Cli *c, const Option *o, const char *v) {
    Assign a;
    if (!split_assign(c, v, &a)) return cli_usage(c, "%s wants NAME=VALUE, not `%s`", o->name, v);
    if (c->nparams == CLI_MAX_LIST) return too_many(c, o->name);
    c->params[c->nparams++] = a;
    if (a.value[0] == '@') c->param_files[c->nparam_files++] = (SltSet){a.name, a.value + 1};
    return SLT_OK;
}

static int set_import_dir(Cli *c, const Option *o, const char *v) {
    if (c->nimport_dirs == CLI_MAX_LIST) return too_many(c, o->name);
    c->import_dirs[c->nimport_dirs++] = v;
    return SLT_OK;
}

static int set_size(Cli *c, const Option *o, const char *v) {
    return parse_size(c, v) ? SLT_OK : cli_usage(c, "%s wants N, WxH or WxHxD, not `%s`", o->name, v);
}

static int set_width(Cli *c, const Option *o, const char *v) {
    uint64_t x;
    if (!parse_whole(v, 1, 64, &x) || x & (x - 1))
        return cli_usage(c, "%s is 1, 2, 4, 8, 16, 32 or 64, not `%s`", o->name, v);
    c->opt.width = (uint32_t)x;
    return SLT_OK;
}

static int set_variant(Cli *c, const Option *o, const char *v) {
    bool *const flags[] = {&c->opt.paper_argmin, &c->opt.paper_forced, &c->opt.path_hash};
    int pick = cli_choice(o->arg, v);
    if (pick < 0) return cli_usage(c, "%s: unknown `%s`; known: %s", o->name, v, o->arg);
    *flags[pick] = true;
    return SLT_OK;
}

static int set_exact(Cli *c, const Option *o, const char *v) {
    (void)o, (void)v;
    c->job.estimator = SLT_EST_QUADRATURE, c->job.interior = SLT_INTERIOR_QUADRATURE;
    c->estimator_given = true;
    return SLT_OK;
}

/* Learning rates or smoothing: "0.1" for all parameters, or "radius=0.1,ink=0.01". */
static int set_rates(Cli *c, const char *name, const char *v, Assign *list, uint32_t *n) {
    const char *parts[CLI_MAX_LIST];
    uint32_t count = 0;
    double x;
    if (split_list(c, name, v, parts, &count) != SLT_OK) return SLT_USAGE;
    for (uint32_t i = 0; i < count; i++) {
        Assign a;
        if (!split_assign(c, parts[i], &a)) a = (Assign){NULL, parts[i]};
        if (!parse_number(a.value, 0, 1e30, &x))
            return cli_usage(c, "%s: `%s` is not a number from 0 to 1e30", name, a.value);
        if (*n == CLI_MAX_LIST) return too_many(c, name);
        list[(*n)++] = a;
    }
    return SLT_OK;
}

static int set_lr(Cli *c, const Option *o, const char *v) {
    int status = set_rates(c, o->name, v, c->lr, &c->nlr);
    for (uint32_t k = 0; k < c->nlr; k++)
        if (!c->lr[k].name) c->plain_lr = c->lr[k].value;
    return status;
}

static int set_smooth(Cli *c, const Option *o, const char *v) {
    return set_rates(c, o->name, v, c->smooth, &c->nsmooth);
}

static int set_pair(Cli *c, const Option *o, const char *v, SltSet *list, uint32_t *n) {
    Assign a;
    if (!split_assign(c, v, &a)) return cli_usage(c, "%s wants %s, not `%s`", o->name, o->arg, v);
    if (*n == CLI_MAX_LIST) return too_many(c, o->name);
    list[(*n)++] = (SltSet){a.name, a.value};
    return SLT_OK;
}

static int set_faces(Cli *c, const Option *o, const char *v) { return set_pair(c, o, v, c->faces, &c->nfaces); }
static int set_grid(Cli *c, const Option *o, const char *v) { return set_pair(c, o, v, c->grids, &c->ngrids); }

static int set_schedule(Cli *c, const Option *o, const char *v) {
    static const char exponential[] = "exponential=";
    bool decays = !strncmp(v, exponential, sizeof exponential - 1);
    c->schedule = decays ? 1 : !strcmp(v, "cosine") ? 2 : strcmp(v, "constant") ? -1 : 0;
    c->schedule_given = true;
    if (c->schedule < 0 || (decays && !parse_number(v + sizeof exponential - 1, 1e-300, 1, &c->decay)))
        return cli_usage(c, "%s: constant, exponential=F (F above 0, at most 1) or cosine is wanted, not `%s`", o->name,
                         v);
    return SLT_OK;
}

static int set_betas(Cli *c, const Option *o, const char *v) {
    char text[64];
    const char *comma = strchr(v, ',');
    snprintf(text, sizeof text, "%.*s", comma ? (int)(comma - v) : 0, v);
    if (!comma || !parse_number(text, 1e-300, 0.999999999999, &c->beta1) ||
        !parse_number(comma + 1, 1e-300, 0.999999999999, &c->beta2))
        return cli_usage(c, "%s: two numbers above 0 and below 1 are wanted, not `%s`", o->name, v);
    return SLT_OK;
}

static int set_seeds(Cli *c, const Option *o, const char *v) {
    char text[32];
    const char *dots = strstr(v, "..");
    uint64_t first = 1, last;
    snprintf(text, sizeof text, "%.*s", dots ? (int)(dots - v < 31 ? dots - v : 31) : 0, v);
    if ((dots && !parse_whole(text, 1, UINT32_MAX, &first)) ||
        !parse_whole(dots ? dots + 2 : v, 1, UINT32_MAX, &last) || last < first || last - first >= 1000)
        return cli_usage(c, "%s: N or A..B is wanted, of at most 1000 whole numbers from 1 on, not `%s`", o->name, v);
    c->first_seed = (uint32_t)first, c->last_seed = (uint32_t)last;
    return SLT_OK;
}

static int set_verify(Cli *c, const Option *o, const char *v) {
    (void)o;
    if (v) c->opt.verify_after = v;
    else c->opt.verify = true;
    return SLT_OK;
}

/* float and rgba8 are what the kernel writes, the others what -o - is. */
static int set_format(Cli *c, const Option *o, const char *v) {
    int pick = cli_choice(o->arg, v);
    bool kernel = pick == 0 || pick == 1, json = !strcmp(v, "json");
    if (pick < 0) return cli_usage(c, "%s: unknown `%s`; known: %s", o->name, v, o->arg);
    if (c->verb->bit == FIT ? !json : json || (pick == 1 && c->verb->bit != RENDER))
        return cli_usage(c, "%s %s is not for `%s`", o->name, v, c->verb->name);
    c->opt.rgba8 = pick == 1;
    c->stream_format = kernel ? NULL : v;
    return SLT_OK;
}

static int set_help(Cli *c, const Option *o, const char *v) {
    (void)o, (void)v;
    cli_help(stdout, c->verb->name, false);
    return CLI_HELPED;
}

static int set_help_all(Cli *c, const Option *o, const char *v) {
    (void)o, (void)v;
    cli_help(stdout, c->verb->name, true);
    return CLI_HELPED;
}

/* ---- the table */
/* Where a member of Cli lies; a warning if its type is another. */
#define MEMBER(type, m) (offsetof(Cli, m) + 0 * sizeof((type *){&((Cli *)0)->m}))
#define BYTES(m) sizeof(((Cli *)0)->m)
#define FLAG(m) .set = set_flag, .at = MEMBER(bool, m)
#define TEXT(m) .set = set_text, .at = MEMBER(const char *, m)
#define ONE_OF(m) .set = set_one_of, .at = MEMBER(const char *, m)
#define NUMBER(m, lowest, highest) .set = set_number, .at = MEMBER(double, m), .lo = lowest, .hi = highest
#define WHOLE(m, lowest, highest)                                                                                      \
    .set = set_whole, .at = offsetof(Cli, m), .lo = lowest, .hi = (double)(highest),                                   \
    .bytes = _Generic(((Cli *)0)->m, uint32_t: 4, uint64_t: 8)
#define CHOICE(m, start) .set = set_choice, .at = offsetof(Cli, m), .bytes = BYTES(m), .first = (int)(start)
#define CALL(function) .set = function
#define GIVEN(m) , .given = MEMBER(bool, m)

static const Option options[] = {
#define OPTION(option, argument, takers, text, setter)                                                                 \
    {.name = option, .arg = argument, .verbs = takers, .help = text, setter},
#include "cli/options.def"
#undef OPTION
};
enum { NOPTIONS = sizeof options / sizeof *options };

/* Text in lines of at most 120 columns behind a margin of 32; on_next: the first line is full. */
static void put_wrapped(FILE *out, const char *text, bool on_next) {
    enum { MARGIN = 33, ROOM = 120 - MARGIN };
    if (on_next) fprintf(out, "\n%*s", MARGIN, "");
    while (strlen(text) > ROOM) {
        int n = ROOM;
        while (n > 0 && text[n] != ' ') n--;
        if (!n) break;
        fprintf(out, "%.*s\n%*s", n, text, MARGIN, "");
        text += n + 1;
    }
    fprintf(out, "%s\n", text);
}

void cli_help(FILE *out, const char *name, bool all) {
    const Verb *verb = find_verb(name);
    if (!verb) {
        fputs(
            "Example:\n  saltus render --expr 'length(x - 0.5) < 0.4 ? 1.0 : 0.1' -o disc.png\n"
            "  saltus grad examples/circle/circle.salt --integral\n\n"
            "Saltus compiles shaders whose branches may jump, and differentiates their integrals, the moving jumps included.\n\n",
            out);
        for (int v = 0; v < VERB_COUNT; v++) fprintf(out, "  saltus %-38s %s\n", verbs[v].usage, verbs[v].what);
        fprintf(out,
                "  saltus %-38s the script that completes command lines\n  saltus %-38s all options with --help-all\n",
                "completions bash|zsh|fish", "--version | --help | COMMAND --help");
        fputs("\nFILE may be - (standard input) or --expr 'EXPRESSION in x'.\n", out);
        return;
    }
    fprintf(out, "Example:\n  %s\n\nUsage: saltus %s\n%s.\n\n", verb->example, verb->usage, verb->what);
    for (int i = 0; i < NOPTIONS; i++) {
        if (!(options[i].verbs & verb->bit) || (!all && options[i].verbs & INNER)) continue;
        char left[128];
        snprintf(left, sizeof left, "%s%s%s", options[i].name,
                 options[i].arg && !may_have_value(&options[i]) ? " " : "", options[i].arg ? options[i].arg : "");
        fprintf(out, strlen(left) > 30 ? "  %s" : "  %-30s ", left);
        put_wrapped(out, options[i].help, strlen(left) > 30);
    }
    fputs("\nExit status: 0 done, 1 a check, fit or assert failed, 2 usage, 3 error in the program, 4 bad input file,\n"
          "5 output not written, 6 a limit was reached, 70 a fault of ours, 130 interrupted.\n",
          out);
}

static const Option *find_option(const Cli *c, const char *text, size_t len, int *status) {
    const char *names[NOPTIONS + 1];
    uint32_t n = 0;
    for (int i = 0; i < NOPTIONS; i++) {
        if (!(options[i].verbs & c->verb->bit)) continue;
        if (strlen(options[i].name) == len && !strncmp(options[i].name, text, len)) return &options[i];
        names[n++] = options[i].name;
    }
    char wanted[128];
    snprintf(wanted, sizeof wanted, "%.*s", (int)(len < 100 ? len : 100), text);
    for (int i = 0; i < NOPTIONS; i++)
        if (!strcmp(options[i].name, wanted)) {
            *status = cli_usage(c, "`%s` is not an option of `%s`", wanted, c->verb->name);
            return NULL;
        }
    const char *near = suggest_nearest(wanted, names, n);
    *status = near ? cli_usage(c, "unknown option `%s`; did you mean `%s`?", wanted, near)
                   : cli_usage(c, "unknown option `%s`", wanted);
    return NULL;
}

/* What asks for cells: it needs an estimator that has them, and without --estimator chooses one. */
static int check_cells(Cli *c) {
    const SltJob *j = &c->job;
    const char *asked = j->error > 0                             ? "--error"
                        : j->abs_error > 0                       ? "--abs-error"
                        : j->gauss                               ? "--gauss"
                        : j->max_evaluations                     ? "--max-evaluations"
                        : j->interior == SLT_INTERIOR_QUADRATURE ? "--interior quadrature"
                                                                 : NULL;
    if (!asked) return SLT_OK;
    if (!c->estimator_given) c->job.estimator = SLT_EST_AUTO;
    /* Samples of an image state no error: it is integrated. */
    if (!c->estimator_given && c->verb->bit == RENDER && (j->error > 0 || j->abs_error > 0))
        c->job.estimator = SLT_EST_QUADRATURE, c->job.interior = SLT_INTERIOR_QUADRATURE;
    if (j->estimator == SLT_EST_AUTO || j->estimator == SLT_EST_QUADRATURE) return SLT_OK;
    return cli_usage(c, "%s is for --estimator quadrature or auto", asked);
}

/* What is asked of the command and not of a program. */
static bool say_of_itself(int argc, char **argv) {
    const char *word = argv[1];
    bool all = !strcmp(word, "--help-all");
    if (all || !strcmp(word, "--help") || !strcmp(word, "-h") || !strcmp(word, "help")) {
        cli_help(stdout, argc > 2 ? argv[2] : NULL, all);
        return true;
    }
    if (strcmp(word, "--version") != 0 && strcmp(word, "version") != 0) return false;
    Target t;
    target_host(&t);
    printf("saltus %s, LLVM %s (%s), targets native avx512 avx2 sse2, SIMD %u bytes (%u lanes of f32), cpu %s\n",
           slt_version(), back_llvm_version(), back_llvm_file(), t.vector_bytes, t.vector_bytes / 4, t.cpu);
    return true;
}

int cli_parse(int argc, char **argv, Cli *c) {
    c->opt = SLT_OPTIONS_INIT;
    c->job = SLT_JOB_INIT;
    c->iters = 200, c->every = 10, c->repeats = 8, c->tolerance = 4, c->loss_timeout = 600;
    c->optimizer = "adam";
    if (argc < 2) {
        cli_help(stderr, NULL, false);
        return SLT_USAGE;
    }
    for (int i = 1; i < argc && strcmp(argv[i], "--") != 0; i++)
        if (!strcmp(argv[i], "--json")) cli_errors_as_json(); /* also those before it */
    if (say_of_itself(argc, argv)) return CLI_HELPED;
    if (!strcmp(argv[1], "completions")) {
        if (argc == 3 && cli_completions(stdout, argv[2])) return CLI_HELPED;
        return cli_usage(c, "completions wants bash, zsh or fish");
    }
    c->verb = find_verb(argv[1]);
    if (!c->verb) {
        const char *names[VERB_COUNT];
        for (int v = 0; v < VERB_COUNT; v++) names[v] = verbs[v].name;
        const char *near = suggest_nearest(argv[1], names, VERB_COUNT);
        return near ? cli_usage(c, "unknown command `%s`; did you mean `%s`?", argv[1], near)
                    : cli_usage(c, "unknown command `%s`", argv[1]);
    }
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
        if (!strcmp(a, "-h")) a = "--help";
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
        if (o->arg && !value && !may_have_value(o)) {
            if (i + 1 >= argc) return cli_usage(c, "%s wants a value: %s", o->name, o->arg);
            value = argv[++i];
        }
        status = o->set(c, o, value);
        if (status != SLT_OK) return status;
        if (o->given) *(bool *)member(c, o->given) = true;
    }
    if (c->verb->bit == LSP) {
        if (c->file) return cli_usage(c, "`lsp` takes no FILE: the editor names them");
        c->quiet = true; /* standard error is a log of the editor */
        return SLT_OK;
    }
    if (!c->file && !c->expr) return cli_usage(c, "a FILE (or - or --expr) is wanted");
    if (c->file && c->expr) return cli_usage(c, "FILE and --expr were both given");
    if (c->expr && c->opt.language == SLT_LANGUAGE_GLSL)
        return cli_usage(c, "--expr is of the language: float3(x, 1.0), not vec3");
    if (c->job.no_interior && c->job.no_boundary)
        return cli_usage(c, "--interior-only and --boundary-only leave nothing");
    int cells = check_cells(c);
    if (cells != SLT_OK) return cells;
    c->opt.seed = c->job.seed, c->job.time_limit = c->max_seconds;
    c->opt.set = c->sets, c->opt.nset = c->nsets;
    c->opt.param_files = c->param_files, c->opt.nparam_files = c->nparam_files;
    c->opt.import_dirs = c->import_dirs, c->opt.nimport_dirs = c->nimport_dirs;
    return SLT_OK;
}
