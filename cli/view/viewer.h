/* What the viewer shows: a program, its parameters, and the threads that compile and compute.
 *
 *     the verb's thread     HTTP and the watch on files: never waits for a program
 *     the compiling thread  makes a Shown of the file whenever it is saved, its kernels ready to run
 *     the computing thread  owns the Shown that is on show; answers Asks in turn, and fits
 *
 * A source with errors changes nothing but what is said: the Shown that there is stays on show. Between the threads go
 * Asks and Replies, a new Shown, and what everybody may know, which is kept as text (the program, the values, a fit's
 * losses); one lock guards all of it. */
#ifndef SALTUS_CLI_VIEW_VIEWER_H
#define SALTUS_CLI_VIEW_VIEWER_H

#include <pthread.h>

#include "cli/cli.h"
#include "cli/explain.h"
#include "cli/view/http.h"
#include "saltus/fit.h"

enum {
    VIEW_SIDE = 512,     /* pixels of the longer side of an image */
    VIEW_LARGEST = 4096, /* the same, at most */
    VIEW_SLICES = 64,    /* of a volume */
    VIEW_VALUES = 2048,  /* numbers of parameters that are told; of more a program's first */
    VIEW_ASKS = 256,     /* that may wait */
    VIEW_SITES = 1000,   /* that are told */
    VIEW_ITERATIONS = 100000
};

/* A compiled program, ready to be shown. */
typedef struct Shown {
    SltProgram *p;      /* of floats; NULL: none could be compiled */
    SltProgram *pixels; /* the same with 8-bit pixels; NULL: it has none (3D, rand()) */
    SltJob job;         /* its size */
    double *floats;     /* [slt_float_count]: the values that it began with */
    int32_t *ints;      /* [slt_int_count] */
    Fn *traced;         /* for explain_point */
    char overlay[256];  /* the component that slt_wrt names; "": none yet */
    Blob *text;         /* what is told of it: members of the object that /state is */
    char *files;        /* that it is made of, for files_set */
} Shown;

typedef enum AskKind {
    ASK_SET,
    ASK_IMAGE,
    ASK_GRADIENT,
    ASK_CELLS,
    ASK_POINT,
    ASK_PARAMS,
    ASK_TARGET,
    ASK_SHOW_TARGET,
    ASK_FIT
} AskKind;
typedef enum ViewFormat { FORMAT_RGBA, FORMAT_PNG, FORMAT_F32 } ViewFormat;

typedef struct Ask {
    struct Ask *next;
    AskKind kind;
    uint64_t id; /* of the request */
    ViewFormat format;
    uint32_t scale; /* of an image: every so many pixels one */
    double gain;    /* of a gradient's colours */
    bool draft;     /* of an image: one sample a pixel, in its middle */
    bool current;   /* of a target: what is on show */
    char name[256]; /* of a gradient: the component; of a target: the file */
    double x[3];    /* of a point */
    uint32_t nx;
    Blob *body; /* NULL: none */
} Ask;

typedef struct Reply {
    struct Reply *next;
    uint64_t id;
    int status;
    const char *type;
    char headers[256];
    Blob *body;
} Reply;

typedef struct Viewer {
    Cli *c;           /* the compiling thread's */
    const char *name; /* of the file, as it is told */
    int wake;         /* a byte there wakes the verb's thread */
    pthread_t compiler, computer;
    bool compiler_runs, computer_runs;

    pthread_mutex_t lock;
    pthread_cond_t compile, compute;
    /* Under the lock. */
    bool over, stale; /* stale: the file was saved */
    Shown *fresh;     /* made, not yet on show */
    Ask *first, **last;
    uint32_t asks;
    Reply *replies, **replies_end;
    bool stop_fit;
    char overlay[256];                /* the component that was asked for last */
    uint64_t serial;                  /* counts what happens to the program */
    const char *status;               /* "compiling", "ready", "error" */
    uint32_t generation;              /* counts programs that were shown */
    Blob *program, *message, *values; /* JSON: members on the program; what the compiler says; an object of values */
    char *files;
    uint64_t version, told; /* counts changes of values; the version that `values` is of */
    uint32_t size[3], spp, slice;
    bool has_target;
    struct {
        uint64_t serial; /* counts what happens, iterations apart */
        bool running;
        uint32_t iterations, done;
        double *losses; /* [done], of VIEW_ITERATIONS */
        double best;
        char reason[600];
    } fit;

    /* The computing thread's. */
    int cancel; /* atomic: set by the others to interrupt it */
    Shown *shown;
    Image target;
    SltFit *fitting;
    double next_told;
    float *fit_target;
    struct {
        uint64_t version;
        uint32_t generation, size[2], spp, slice;
        ViewFormat format;
        Blob *body;
    } image; /* the last that was made */
} Viewer;

/* viewer.c. viewer_start compiles the program of `c`, whose status it returns unless the viewer can go on; from then on
 * c is the viewer's, until viewer_end. */
int viewer_start(Viewer *v, Cli *c, int wake);
void viewer_end(Viewer *v);
void viewer_compile(Viewer *v);       /* the file was saved */
bool viewer_ask(Viewer *v, Ask *ask); /* takes it over; false: too many wait */
void viewer_free_ask(Ask *ask);
Reply *viewer_reply(Viewer *v); /* the next, which is the caller's: malloc'd; NULL: none */
void viewer_stop_fit(Viewer *v);
Blob *viewer_state(Viewer *v);                   /* all that is told, as an object */
Blob *viewer_tell(Viewer *v, uint64_t place[4]); /* HttpTeller */
/* The files of the program for files_set, malloc'd, when `seen` is older than they are; else NULL. */
char *viewer_files(Viewer *v, uint64_t *seen, bool *failed);
/* For the other files, on the computing thread. */
void viewer_answer(Viewer *v, const Ask *ask, int status, const char *type, const char *headers, Blob *body);
void viewer_refuse(Viewer *v, const Ask *ask, int status, const char *fmt, ...) __attribute__((format(printf, 4, 5)));
void viewer_changed(Viewer *v); /* values */
void viewer_wake(Viewer *v);

/* program.c */
int shown_compile(Viewer *v, Shown **out, char **text); /* text: what the compiler says, malloc'd, "" if nothing */
void shown_warm(Shown *s, const char *overlay);
void shown_carry(const Shown *from, Shown *to); /* values that were changed */
void shown_free(Shown *s);
Blob *shown_values(const Shown *s);
SltStatus shown_choose(Shown *s, const char *component, SltError *err); /* what is differentiated */
SltStatus shown_sync(Shown *s, SltError *err);                          /* the values of `pixels` are those of p */
SltStatus shown_gradient(Shown *s, const SltJob *job, const char *component, float *out, SltError *err);

/* answer.c: an Ask but for ASK_SET and ASK_IMAGE, whose bodies answer_set takes first, all that wait together. */
bool answer_set(Viewer *v, const Ask *ask); /* false: it was refused */
bool answer_ask(Viewer *v, const Ask *ask); /* false: it was interrupted */

/* fit.c */
SltStatus fit_open_target(Viewer *v, const char *path, bool display, SltError *err); /* before the threads begin */
void fit_take_target(Viewer *v, const Ask *ask);
void fit_show_target(Viewer *v, const Ask *ask);
void fit_begin(Viewer *v, const Ask *ask);
void fit_step(Viewer *v);
void fit_end(Viewer *v, const char *reason); /* reason NULL: the fit's own */

#endif
