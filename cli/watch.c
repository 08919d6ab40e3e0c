/* Interrupts, the time limit and notes on progress: a thread that watches the command's work.
 *
 * Ctrl-C and --max-seconds ask the library to stop, which it does between two calls of a kernel. What does not listen
 * (LLVM has no way to cancel, and one call of a kernel may take long) is left behind: the process ends with the same
 * words and status. No output is half-written then, because results go out behind watch_commit(). */
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

#include "cli/cli.h"

enum { SANDBOX_SECONDS = 60, STACK_BYTES = 256 << 10 };
#define SANDBOX_BYTES ((rlim_t)4 << 30)
#define GRACE 0.5       /* seconds from the wish to stop to leaving */
#define GRACE_KEEPING 8 /* where results would be lost: a fit with iterations */
#define NOTE_EVERY 10.0

/* Process state: a signal handler has nowhere else to write, and the thread looks where it writes. */
static atomic_int interrupted;
static int cancel_flag; /* which other threads read: cancel() */
static int wake[2] = {-1, -1};
static atomic_int also_wakes = -1;
static struct {
    pthread_mutex_t lock;
    bool committed, keeping, is_fit, notes, timed_out, spent;
    double start, limit, next_note;
    double effort, effort_from, effort_cpu; /* of watch_effort: seconds, and the clocks at its beginning */
    double fraction;                        /* below 0: not known */
    const char *what;                       /* the phase */
    char detail[96];
    char costs[400];      /* said once, with the first note */
    char leaving[2][320]; /* what is said when the process ends: interrupted; out of time */
} watched = {.lock = PTHREAD_MUTEX_INITIALIZER, .what = "compiling", .fraction = -1};

static double cpu_seconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void cancel(int flag) {
    int fd = also_wakes;
    __atomic_store_n(&cancel_flag, flag, __ATOMIC_RELAXED);
    if (!flag || fd < 0) return;
    ssize_t ignored = write(fd, "", 1);
    (void)ignored;
}

static void on_interrupt(int sig) {
    (void)sig;
    if (interrupted) _exit(SLT_INTERRUPTED);
    interrupted = 1;
    cancel(1);
    ssize_t ignored = write(wake[1], "", 1);
    (void)ignored;
}

/* Ends the process, unless results are on their way out. */
static void leave(bool timed_out) {
    pthread_mutex_lock(&watched.lock);
    if (!watched.committed) {
        const char *text = watched.leaving[timed_out]; /* standard error may be locked: what holds it is left behind */
        ssize_t ignored = write(2, text, strlen(text));
        (void)ignored;
        child_abandon();
        _exit(timed_out ? SLT_LIMIT : SLT_INTERRUPTED);
    }
    pthread_mutex_unlock(&watched.lock);
}

static void note(double seconds) {
    char text[640], left[48] = "";
    pthread_mutex_lock(&watched.lock);
    if (!watched.committed) {
        int n = snprintf(text, sizeof text, "saltus: note: %s, %.0f s", watched.what, seconds);
        if (watched.fraction > 0.001) snprintf(left, sizeof left, ", %.0f %% done", 100 * fmin(watched.fraction, 1));
        n += snprintf(text + n, sizeof text - (size_t)n, "%s%s%s%s%s\n", left, *watched.detail ? ", " : "",
                      watched.detail, *watched.costs ? "; " : "", watched.costs);
        *watched.costs = 0;
        ssize_t ignored = write(2, text, (size_t)n < sizeof text ? (size_t)n : sizeof text - 1);
        (void)ignored;
    }
    pthread_mutex_unlock(&watched.lock);
}

/* By both clocks: on a busy machine the same work is done as on an idle one. */
static bool effort_spent(double now) {
    return watched.effort > 0 && now - watched.effort_from >= watched.effort &&
           cpu_seconds() - watched.effort_cpu >= 0.9 * watched.effort;
}

static void *watch(void *arg) {
    double stop_by = 0; /* when to leave */
    (void)arg;
    for (;;) {
        double now = cli_now(), next = now + 3600;
        pthread_mutex_lock(&watched.lock);
        bool over = watched.committed;
        double grace = watched.keeping ? GRACE_KEEPING : GRACE, limit = watched.limit;
        /* A fit has its own limit, which begins later, and a result at its end. */
        double asked = limit > 0 ? watched.start + limit + (watched.is_fit ? 2 : 0) : 0;
        if (!interrupted && asked > 0 && now >= asked) watched.timed_out = true, cancel(1);
        if (effort_spent(now)) watched.spent = true, cancel(1);
        bool timed_out = watched.timed_out, notes = watched.notes, trying = watched.effort > 0;
        bool leaving = interrupted || timed_out;
        pthread_mutex_unlock(&watched.lock);
        if (over) return NULL;
        if (leaving && stop_by == 0) stop_by = now + grace;
        if (stop_by > 0 && now >= stop_by) {
            leave(timed_out);
            return NULL;
        }
        if (notes && !leaving && now >= watched.next_note) {
            note(now - watched.start);
            watched.next_note = now + NOTE_EVERY;
        }
        if (stop_by > 0) next = stop_by;
        else if (asked > 0) next = fmin(next, asked);
        if (trying) next = fmin(next, now + 0.1);
        if (notes && !leaving) next = fmin(next, watched.next_note);
        struct pollfd fd = {.fd = stop_by > 0 ? -1 : wake[0], .events = POLLIN};
        char rang[16];
        if (poll(&fd, 1, (int)fmax(1, ceil(1e3 * (next - now)))) > 0)
            while (read(wake[0], rang, sizeof rang) > 0) continue;
    }
}

void watch_begin(Cli *c) {
    if (c->opt.sandbox) {
#ifndef SALTUS_SANITIZE /* which keep books of terabytes */
        const struct rlimit memory = {SANDBOX_BYTES, SANDBOX_BYTES};
        setrlimit(RLIMIT_DATA, &memory);
#endif
        if (c->max_seconds <= 0) c->max_seconds = SANDBOX_SECONDS;
    }
    watched.start = cli_now(), watched.limit = c->max_seconds;
    watched.is_fit = c->verb->bit == FIT;
    watched.notes = !c->quiet && !c->json && !isatty(2) && c->verb->bit != VIEW; /* which works when asked */
    watched.next_note = watched.start + NOTE_EVERY;
    c->job.cancel = &cancel_flag;
    for (int late = 0; late < 2; late++) {
        FILE *out = fmemopen(watched.leaving[late], sizeof watched.leaving[late], "w");
        if (!out) continue;
        cli_put_error(out, late ? SLT_LIMIT : SLT_INTERRUPTED, late ? "the time limit was reached" : "interrupted");
        fclose(out);
    }
    if (pipe2(wake, O_CLOEXEC | O_NONBLOCK) != 0) return;
    pthread_t id;
    pthread_attr_t small;
    pthread_attr_init(&small);
    pthread_attr_setstacksize(&small, STACK_BYTES);
    pthread_attr_setdetachstate(&small, PTHREAD_CREATE_DETACHED);
    struct sigaction sa = {.sa_handler = on_interrupt, .sa_flags = SA_RESTART};
    /* Without the thread what does not listen cannot be left: then a signal ends the process as it always would. */
    if (pthread_create(&id, &small, watch, NULL) == 0) {
        sigaction(SIGINT, &sa, NULL);
        sigaction(SIGTERM, &sa, NULL);
    }
    pthread_attr_destroy(&small);
}

void watch_effort(double seconds) {
    pthread_mutex_lock(&watched.lock);
    watched.effort = seconds, watched.effort_from = cli_now(), watched.effort_cpu = cpu_seconds();
    watched.spent = false;
    if (!watched.timed_out && !interrupted) cancel(0);
    pthread_mutex_unlock(&watched.lock);
    if (interrupted) cancel(1); /* a signal came in between */
    if (wake[1] >= 0 && seconds > 0) {
        ssize_t ignored = write(wake[1], "", 1);
        (void)ignored;
    }
}

bool watch_spent(void) {
    pthread_mutex_lock(&watched.lock);
    bool spent = watched.spent && !watched.timed_out && !interrupted;
    pthread_mutex_unlock(&watched.lock);
    return spent;
}

void watch_commit(void) {
    pthread_mutex_lock(&watched.lock);
    watched.committed = true;
    pthread_mutex_unlock(&watched.lock);
}

void watch_keep(void) {
    pthread_mutex_lock(&watched.lock);
    watched.keeping = true;
    pthread_mutex_unlock(&watched.lock);
}

void watch_phase(const char *what, double fraction, const char *detail) {
    pthread_mutex_lock(&watched.lock);
    if (what) watched.what = what;
    watched.fraction = fraction;
    snprintf(watched.detail, sizeof watched.detail, "%s", detail ? detail : "");
    pthread_mutex_unlock(&watched.lock);
}

void watch_costs(const char *text) {
    pthread_mutex_lock(&watched.lock);
    snprintf(watched.costs, sizeof watched.costs, "%s", text);
    pthread_mutex_unlock(&watched.lock);
}

void watch_tell_costs(void) {
    pthread_mutex_lock(&watched.lock);
    if (*watched.costs) cli_say(CLI_NOTE, "costs", NULL, "%s", watched.costs);
    *watched.costs = 0;
    pthread_mutex_unlock(&watched.lock);
}

void watch_wakes(int fd) { also_wakes = fd; }

bool watch_ended(void) { return __atomic_load_n(&cancel_flag, __ATOMIC_RELAXED) != 0; }

bool cli_interrupted(void) { return interrupted != 0; }

SltStatus watch_status(SltStatus status) { return status == SLT_INTERRUPTED && !interrupted ? SLT_LIMIT : status; }
