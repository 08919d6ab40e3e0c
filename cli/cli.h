/* The command: options, compiling, reports and progress that the verbs share. One file a verb.
 *
 * Standard output carries results only (with --json one JSON object), everything for people goes to standard error.
 * Functions that return int return an SltStatus, which is the exit status, and have printed the error. */
#ifndef SALTUS_CLI_H
#define SALTUS_CLI_H

#include <stdbool.h>
#include <stdio.h>

#include "runtime/base/json.h"
#include "runtime/base/status.h"
#include "runtime/image/image.h"
#include "saltus/saltus.h"

enum { CLI_MAX_LIST = 256, CLI_MAX_KEPT = 8 * CLI_MAX_LIST, CLI_MAX_COMPONENTS = 64 };
/* Bytes by which heaps grow: addresses alone, of which the system gives pages that are touched. */
enum { CLI_HEAP = 16 << 20 };

typedef struct Assign {
    const char *name, *value;
} Assign;

typedef struct Cli Cli;

/* VERB_RENDER, ...: the rows of verbs.def. */
typedef enum VerbId {
#define VERB(id, ...) VERB_##id,
#include "cli/verbs.def"
#undef VERB
    VERB_COUNT
} VerbId;

/* The same as bits, for options.def: which verbs take an option. */
enum {
#define VERB(id, ...) id = 1u << VERB_##id,
#include "cli/verbs.def"
#undef VERB
    ALL = ((1u << VERB_COUNT) - 1) & ~(FORMAT | LSP), /* which compile no program of their own */
    INNER = 1u << 30, /* for those who work on the compiler, or compare: --help-all alone lists it */
    RUN = RENDER | GRAD | FIT | CHECK | BENCH
};

/* The names of the optimisers and of the estimators, each behind a |. */
static const char cli_optimizers[] =
#define OPTIMISER(id, name, ...) "|" name
#include "runtime/optimise/optimisers.def"
#undef OPTIMISER
    ;
static const char cli_estimators[] =
#define SLT_ESTIMATOR(id, name, ...) "|" name
#define SLT_DIFFERENCES(id, name, ...) "|" name
#define SLT_CELLS(id, name, ...) "|" name
#include "saltus/estimators.def"
    ;

#define CLI_LOSSES "l2|l1|huber" /* by SltFitMetric */

typedef struct Verb {
    const char *name, *usage, *what, *example;
    uint32_t bit; /* 1 << VerbId */
    int (*run)(Cli *c);
} Verb;

#define VERB(id, name, ...) int verb_##name(Cli *c);
#include "cli/verbs.def"
#undef VERB

struct Cli {
    const Verb *verb;
    const char *file, *expr;
    const char *scene; /* the file that `file` was found in */
    SltOptions opt;
    SltJob job;
    bool size_given, spp_given;
    uint32_t size_dims; /* numbers in --size: one is for every axis */
    SltSet sets[CLI_MAX_LIST];
    uint32_t nsets;
    const char *import_dirs[CLI_MAX_LIST];
    uint32_t nimport_dirs;
    Assign params[CLI_MAX_LIST];
    SltSet param_files[CLI_MAX_LIST]; /* those that are @file: they may decide sizes */
    uint32_t nparams, nparam_files;
    const char *params_file, *output;
    const char *stream_format; /* of -o -: "png", ... */
    bool streams;              /* -o - */
    char wrote[160];           /* what is said when that has been written */
    const char *wrt[CLI_MAX_LIST];
    uint32_t nwrt;
    bool json, quiet;
    uint32_t told; /* diagnostics that have been printed */
    /* grad, fit */
    const char *target, *adjoint;
    bool minimize;
    uint32_t iters;
    const char *optimizer, *checkpoint, *resume;
    uint32_t every;
    Assign lr[CLI_MAX_LIST], smooth[CLI_MAX_LIST]; /* name NULL: for all parameters */
    uint32_t nlr, nsmooth;
    const char *plain_lr;       /* of the command line, for all parameters */
    SltSet faces[CLI_MAX_LIST]; /* of --smooth-faces */
    uint32_t nfaces;
    SltSet grids[CLI_MAX_LIST]; /* of --smooth-grid */
    uint32_t ngrids;
    const char *loss;           /* of CLI_LOSSES; NULL: the scene's, or l2 */
    uint32_t views_per_step;    /* 0: all */
    int schedule;               /* SltFitSchedule */
    double decay, beta1, beta2; /* 0: the defaults */
    bool schedule_given;
    uint32_t frames;        /* 0: none */
    const char *loss_entry; /* a function of the shader */
    double huber_delta;     /* 0: the default */
    const char *loss_command;
    bool allow_commands;            /* of scenes */
    uint32_t first_seed, last_seed; /* of --seeds; 0: not given */
    const char *round_command;
    uint32_t round_iters; /* 0: no rounds, or the scene's */
    double loss_timeout;
    bool loss_timeout_given;
    /* bench */
    bool kernels;
    const char *estimators;
    uint32_t repeats;
    int against_evaluations; /* what the plot of bench has along its x axis; 0: seconds */
    double max_seconds, tolerance;
    /* explain */
    const char *at, *cells;
    bool cost;
    /* bound */
    const char *box;
    bool stdio; /* lsp: said, and so anyway */
    /* view */
    uint32_t port;                                                     /* 0: any */
    bool samples_given, iters_given, optimizer_given, estimator_given; /* the option was there */
    char *args_storage[CLI_MAX_KEPT]; /* malloc'd pieces of arguments, which members above point at */
    uint32_t nargs_storage;
};

/* options.c */
enum { CLI_HELPED = -1 };                     /* help or version was printed: all is well, and nothing is left to do */
int cli_parse(int argc, char **argv, Cli *c); /* an SltStatus, or CLI_HELPED */
int cli_choice(const char *names, const char *text); /* the number of text in names, a|b|c; -1: it is not among them */
void cli_help(FILE *out, const char *verb, bool all);
int cli_usage(const Cli *c, const char *fmt, ...) __attribute__((format(printf, 2, 3))); /* prints, returns SLT_USAGE */

/* completions.c: the script for bash, zsh or fish that completes what the tables list; false: another shell. */
bool cli_completions(FILE *out, const char *shell);

/* stream.c: -o - is a file of its own until all is well, and then goes to standard output. The verb sees the file's
 * name in c->output. */
typedef struct Stream {
    char folder[4000], file[4096];
} Stream;
/* A new one under TMPDIR, or /tmp; the caller removes it. */
SltStatus cli_temporary_folder(char *folder, size_t size, SltError *err);
int stream_begin(Stream *s, Cli *c);
int stream_end(Stream *s, Cli *c, int status);
/* "saltus: NAME" and the rest, once the output is written: with -o - when standard output has taken it. */
void cli_wrote(Cli *c, const char *fmt, ...) __attribute__((format(printf, 2, 3)));

/* common.c */
/* Compiles the file, standard input or expression, prints diagnostics, sets parameters and wrt. *out must be freed also
 * on failure. */
int cli_compile(Cli *c, SltProgram **out);
/* Does somebody look for memory that is left at the end of the process? A sanitizer does, or who says so by a name of
 * this kind (tests/fault). */
bool cli_frees_all(void);
void cli_end_program(SltProgram *p); /* of a verb that is done: mostly what is its goes with the process */
/* The values of --params and --param again, over others that a scene has set since. */
int cli_set_values(Cli *c, SltProgram *p);
void cli_tell(Cli *c, SltProgram *p);            /* prints the diagnostics that are new since the last time */
int cli_fail(const Cli *c, const SltError *err); /* prints the error, returns its status */
/* Prints an error on standard error and returns its status: `saltus: text`, with --json one object on a line, in the
 * shape of a diagnostic with "status" added. */
int cli_error(int status, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
void cli_put_error(FILE *out, int status, const char *text);
void cli_errors_as_json(void);
typedef enum CliSeverity { CLI_ERROR = 1, CLI_WARNING, CLI_NOTE } CliSeverity; /* numbers of the protocol */
/* On standard error, beside results: `saltus: warning: FILE:1:2: text`, with --json an object as above; at may be NULL.
 */
void cli_say(CliSeverity severity, const char *code, const SltPlace *at, const char *fmt, ...)
    __attribute__((format(printf, 4, 5)));
/* Such an object without its last brace. */
void cli_put_json(FILE *out, int severity, const char *code, const SltPlace *at, const char *text);
/* Images, values and integrals: what is known of derivatives alone is not said. */
void cli_forget_derivatives(SltProgram *p);
/* `p`, what an allocation returned. Where that is nothing the command says so and ends with status 6: it has nothing to
 * tidy up that the system does not, as long as no output is staged. */
void *cli_need(void *p);
int cli_unknown_format(const Cli *c); /* prints that -o has no known extension, returns SLT_USAGE */
/* Completes the job's sizes for this program (dimension, defaults), and checks them. */
int cli_prepare_job(Cli *c, SltProgram *p);
/* The size of an image, or of a volume. */
SltStatus cli_size_of_image(const char *path, bool volume, uint32_t size[3], SltError *err);
/* params_size.c: are there textures and the like that `values`, the text of --params, give another size? Then a program
 * compiled again has it. */
bool cli_params_resize(Cli *c, const SltProgram *p, const char *values);
/* Reads a target or adjoint image at the job's size with the program's channels; malloc'd. */
int cli_read_image(Cli *c, SltProgram *p, const char *path, bool resize, float **out);
double cli_now(void); /* seconds, monotonic */

/* watch.c: interrupts, --max-seconds, --sandbox, and notes every ten seconds where standard error is no terminal */
void watch_begin(Cli *c);
void watch_commit(void); /* results go out: from now on only a second Ctrl-C ends the process */
void watch_keep(void);   /* there are results that leaving would lose */
/* What is being done; what NULL: the same as before, fraction below 0: not known, detail may be NULL. */
void watch_phase(const char *what, double fraction, const char *detail);
void watch_costs(const char *text);       /* said once if it takes long: what of the program costs */
void watch_tell_costs(void);              /* now, if it was not said yet */
SltStatus watch_status(SltStatus status); /* SLT_LIMIT in place of SLT_INTERRUPTED where time was up */
/* From now on the job's cancel flag is set behind so many seconds of work, in which nothing else is; 0: no more. */
void watch_effort(double seconds);
bool watch_spent(void);     /* and that was why a call was interrupted */
bool cli_interrupted(void); /* by a signal */
/* A byte is written to fd (-1: to none) when a signal or the limit of time asks for an end. */
void watch_wakes(int fd);
bool watch_ended(void);   /* one of them has */
void child_abandon(void); /* child.c: the process is about to end: so do the programs that it started */

/* effort.c: slt_grad_integral within a quarter of a minute unless an option says how much is to be done: with fewer
 * lines, which is said, or at last *without the boundary. */
SltStatus effort_integral(Cli *c, SltProgram *p, SltIntegral *out, SltStats *stats, bool *without, SltError *err);
SltStatus effort_images(Cli *c, SltProgram *p, uint32_t n, const double *const *dir, float *const *out,
                        float *crossings, SltStats *stats, SltError *err);

/* link.c: replaces the malloc'd bytes of an object by those of the shared library that it was linked into; none on
 * failure. */
SltStatus cli_link(unsigned char **bytes, size_t *size, SltError *err);

/* progress.c: a bar with time left on a terminal, for watch.c elsewhere; silent with --quiet and --json */
typedef struct Progress {
    bool on;
    double start, last;
    const char *what;
} Progress;
void progress_begin(Progress *pr, const Cli *c, const char *what);
void progress_update(Progress *pr, double fraction, const char *detail); /* detail may be NULL */
void progress_end(Progress *pr);
void progress_job(void *user, double fraction); /* for SltJob.progress, user: Progress */

/* report.c: values in the shape of the parameters */
typedef struct ShapeValues {
    const double *data; /* [channels][nfloats], or [1][nfloats] */
    uint32_t channels;  /* 1: a leaf is a number; else a list */
    uint32_t nfloats;
} ShapeValues;
/* {"radius": X, "centre": [X, Y], ...} of what is differentiated: parameters, or the components named by --wrt. */
void report_gradient_json(FILE *out, const Cli *c, const SltProgram *p, const ShapeValues *v);
void report_stats_json(FILE *out, const SltStats *stats);
/* Of estimators with cells: shares of the domain, what is left and what it can hide, why refining stopped, each pair
 * followed by ", "; nothing for the others. derivative: what the rest can hide of a derivative at most, NaN where that
 * is not bounded; NULL: only values were wanted. */
void report_cells_json(FILE *out, const SltStats *stats, const double *derivative);
/* The same for people, in a line or two on standard error. */
void report_cells(const Cli *c, const SltStats *stats, const double *derivative);
/* The exit status of an estimate that succeeded: of failed asserts, or of a refinement that stopped early. */
int report_status(const SltStats *stats);
/* Of the compiler, and of what was sampled; stats: NULL where nothing was. */
void report_warnings_json(FILE *out, SltProgram *p, const SltStats *stats);
/* A warning that a result earns by its numbers. */
typedef struct ReportMore {
    bool said; /* false: there is nothing to be said */
    const char *code;
    char text[640];
} ReportMore;
/* The same, and these. */
void report_warnings_and(FILE *out, SltProgram *p, const SltStats *stats, const ReportMore *more, size_t nmore);
void report_more(const Cli *c, const ReportMore *more, size_t n); /* for people, on standard error */
/* Errors that are infinite beside values that are not. */
ReportMore report_unknown(const char *what, const double *value, const double *error, size_t n);
/* ---- sampled.c */
void report_dropped(
    const Cli *c, const SltStats *stats); /* warnings for people: dropped crossings, truncated loops, failed asserts */
void report_place(FILE *out, const SltPlace *at);      /* "file:line:column: ", or nothing */
void report_place_json(FILE *out, const SltPlace *at); /* null where nothing is known */
/* Of a name in codes.def, in upper or lower case: the name as it stands there; NULL: there is none. */
const char *sampled_explain(const char *name, const char **title, const char **text);
/* The components that --wrt names: returns how many, and their names and float indices in malloc'd arrays (of malloc'd
 * strings), for report_free_components. */
uint32_t report_components(const Cli *c, const SltProgram *p, char ***names, uint32_t **index);
void report_free_components(char **names, uint32_t *index, uint32_t n);
/* The name of the float `index`: "discs[3].centre.x". */
void report_component_name(const SltProgram *p, uint32_t index, char *buf, size_t size);
/* The EXR layer of the derivative image of the float `index`: d.radius, d.centre.1 */
void report_layer_name(const Cli *c, const SltProgram *p, uint32_t index, char *buf, size_t size);
void report_metadata(Image *im, const Cli *c, const SltProgram *p);
/* The name of channel c of an image of so many: Y, R G, R G B, R G B A. */
const char *report_channel(uint32_t channels, uint32_t c);

#endif
