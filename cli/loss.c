/* The pipe to a loss program: framing, time limits and every way in which it can fail. */
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <jansson.h>

#include "cli/cli.h"
#include "cli/loss.h"

enum { HEAD_MAX = 1 << 16, SLICE_MS = 100 };

struct LossProgram {
    pid_t pid;
    int to, from; /* our ends of the pipes, not blocking */
    double timeout;
    bool ended; /* the program has ended, and was waited for */
    int wait_status;
    char head[HEAD_MAX]; /* of the answer: up to the end of its line, and what came along behind it */
    size_t nhead;
};

/* Its process group, for the end of the process: leaving frees nothing. */
static volatile pid_t running = -1;

void loss_abandon(void) {
    if (running > 0) kill(-running, SIGKILL);
}

static void close_fd(int *fd) {
    if (*fd >= 0) close(*fd);
    *fd = -1;
}

static void become(const char *command, const char *dir, int in, int out) {
    setpgid(0, 0);
    signal(SIGPIPE, SIG_DFL); /* the command ignores it, and that would be inherited */
    signal(SIGINT, SIG_DFL);
    signal(SIGTERM, SIG_DFL);
    if (dup2(in, 0) < 0 || dup2(out, 1) < 0 || (dir && *dir && chdir(dir) != 0)) _exit(126);
    execl("/bin/sh", "sh", "-c", command, (char *)NULL);
    _exit(127);
}

LossProgram *loss_start(const char *command, const char *dir, double timeout, SltError *err) {
    LossProgram *l = calloc(1, sizeof *l);
    int in[2] = {-1, -1}, out[2] = {-1, -1};
    if (!l) return status_fail(err, SLT_LIMIT, "out of memory"), NULL;
    *l = (LossProgram){.pid = -1, .to = -1, .from = -1, .timeout = timeout};
    if (pipe2(in, O_CLOEXEC) == 0 && pipe2(out, O_CLOEXEC) == 0) l->pid = fork();
    if (l->pid == 0) become(command, dir, in[0], out[1]);
    if (l->pid < 0) {
        status_fail_errno(err, SLT_CHECK_FAILED, errno, "cannot start the loss program");
        for (int i = 0; i < 2; i++) close_fd(&in[i]), close_fd(&out[i]);
        free(l);
        return NULL;
    }
    running = l->pid;
    setpgid(l->pid, l->pid); /* parent and child both do this: it must hold for whichever goes on first */
    l->to = in[1], l->from = out[0];
    close_fd(&in[0]);
    close_fd(&out[1]);
    fcntl(l->to, F_SETFL, O_NONBLOCK);
    fcntl(l->from, F_SETFL, O_NONBLOCK);
    return l;
}

static bool reap(LossProgram *l, double seconds) {
    double until = cli_now() + seconds;
    while (!l->ended) {
        pid_t got = waitpid(l->pid, &l->wait_status, WNOHANG);
        if (got == l->pid || (got < 0 && errno != EINTR)) l->ended = true;
        else if (cli_now() >= until) break;
        else nanosleep(&(struct timespec){.tv_nsec = 5000000}, NULL);
    }
    return l->ended;
}

void loss_stop(LossProgram *l) {
    if (!l) return;
    close_fd(&l->to);
    close_fd(&l->from);
    running = -1;
    if (!reap(l, 1)) {
        kill(-l->pid, SIGTERM);
        if (!reap(l, 1)) {
            kill(-l->pid, SIGKILL);
            reap(l, 5);
        }
    }
    free(l);
}

/* The program's input or output was closed: how did the program end? */
static SltStatus fail_ended(LossProgram *l, const char *when, SltError *err) {
    if (!reap(l, 1)) return status_fail(err, SLT_CHECK_FAILED, "the loss program closed its pipe %s", when);
    if (WIFSIGNALED(l->wait_status))
        return status_fail(err, SLT_CHECK_FAILED, "the loss program was ended by signal %d %s",
                           WTERMSIG(l->wait_status), when);
    return status_fail(err, SLT_CHECK_FAILED, "the loss program ended with status %d %s", WEXITSTATUS(l->wait_status),
                       when);
}

static SltStatus fail_line(const char *line, size_t n, const char *what, SltError *err) {
    char shown[81];
    size_t m = n < 80 ? n : 80;
    for (size_t i = 0; i < m; i++) shown[i] = line[i] >= 32 && line[i] < 127 ? line[i] : '?';
    shown[m] = 0;
    return status_fail(
        err, SLT_CHECK_FAILED,
        "the loss program answered `%s`: %s (its standard output is the answer; messages go to standard error)", shown,
        what);
}

static SltStatus read_head(const char *line, size_t n, double *loss, SltError *err) {
    json_error_t e;
    json_t *j = json_read(line, n, JSON_REJECT_DUPLICATES, &e), *value, *error;
    if (!j && json_no_memory(&e)) return status_fail(err, SLT_LIMIT, "out of memory");
    if (!j) return fail_line(line, n, e.text, err);
    value = json_object_get(j, "loss");
    error = json_object_get(j, "error");
    SltStatus status = SLT_OK;
    if (json_is_string(error))
        status = status_fail(err, SLT_CHECK_FAILED, "the loss program says: %s", json_string_value(error));
    else if (json_is_null(value)) *loss = NAN;
    else if (!json_is_number(value)) status = fail_line(line, n, "{\"loss\": NUMBER} is wanted", err);
    else *loss = json_number_value(value);
    json_decref(j);
    return status;
}

/* What is being sent and received: both at once, so that a program which answers while it still reads cannot block us.
 */
typedef struct Exchange {
    const char *part[2]; /* request: its line, the image */
    size_t size[2], sent[2];
    size_t line; /* bytes of the answer's line with its end; 0: not there yet */
    char *body;
    size_t want, got;
} Exchange;

static SltStatus send_some(LossProgram *l, Exchange *x, SltError *err) {
    for (int k = 0; k < 2; k++)
        while (x->sent[k] < x->size[k]) {
            ssize_t n = write(l->to, x->part[k] + x->sent[k], x->size[k] - x->sent[k]);
            if (n > 0) x->sent[k] += (size_t)n;
            else if (errno == EINTR) continue;
            else if (errno == EAGAIN || errno == EWOULDBLOCK) return SLT_OK;
            else if (errno == EPIPE) return fail_ended(l, "while it was sent an image", err);
            else return status_fail_errno(err, SLT_CHECK_FAILED, errno, "cannot write to the loss program");
        }
    return SLT_OK;
}

static SltStatus take_head(LossProgram *l, Exchange *x, double *loss, SltError *err) {
    char *end = memchr(l->head, '\n', l->nhead);
    if (!end) return l->nhead == HEAD_MAX ? fail_line(l->head, l->nhead, "no end of line in 64 KiB", err) : SLT_OK;
    x->line = (size_t)(end - l->head) + 1;
    SltStatus status = read_head(l->head, x->line - 1, loss, err);
    size_t rest = l->nhead - x->line;
    if (status == SLT_OK && rest > x->want)
        return status_fail(err, SLT_CHECK_FAILED, "the loss program wrote more than the %zu bytes of its adjoint image",
                           x->want);
    if (status == SLT_OK) memcpy(x->body, end + 1, rest), x->got = rest;
    return status;
}

static SltStatus receive_some(LossProgram *l, Exchange *x, double *loss, SltError *err) {
    while (!x->line || x->got < x->want) {
        char *to = x->line ? x->body + x->got : l->head + l->nhead;
        ssize_t n = read(l->from, to, x->line ? x->want - x->got : HEAD_MAX - l->nhead);
        if (n < 0 && errno == EINTR) continue;
        if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) return SLT_OK;
        if (n < 0) return status_fail_errno(err, SLT_CHECK_FAILED, errno, "cannot read from the loss program");
        if (n == 0) {
            char when[96];
            snprintf(when, sizeof when, x->line ? "after %zu of %zu bytes of its adjoint image" : "before it answered",
                     x->got, x->want);
            return fail_ended(l, when, err);
        }
        if (x->line) {
            x->got += (size_t)n;
        } else {
            l->nhead += (size_t)n;
            SltStatus status = take_head(l, x, loss, err);
            if (status != SLT_OK) return status;
        }
    }
    return SLT_OK;
}

static char *request_line(const LossRequest *q) {
    json_t *j = json_pack("{s:i,s:i,s:i,s:i,s:i,s:i,s:s?,s:s?}", "iteration", (int)q->iteration, "view", (int)q->view,
                          "views", (int)q->views, "width", (int)q->width, "height", (int)q->height, "channels",
                          (int)q->channels, "target", q->target, "mask", q->mask);
    char *text = j ? json_dumps(j, JSON_COMPACT) : NULL, *line = text ? malloc(strlen(text) + 2) : NULL;
    if (line) sprintf(line, "%s\n", text);
    free(text);
    json_decref(j);
    return line;
}

static SltStatus converse(LossProgram *l, Exchange *x, double deadline, double *loss, SltError *err) {
    double limit = cli_now() + l->timeout;
    for (;;) {
        bool sending = x->sent[1] < x->size[1];
        if (!sending && x->line && x->got == x->want) return SLT_OK;
        if (cli_interrupted()) return status_fail(err, SLT_INTERRUPTED, "interrupted");
        double now = cli_now();
        if (deadline > 0 && now > deadline)
            return status_fail(err, SLT_LIMIT, "the time limit was reached while the loss program worked");
        if (now > limit) return status_fail(err, SLT_LIMIT, "the loss program did not answer within %g s", l->timeout);
        struct pollfd fd[2] = {{.fd = x->line && x->got == x->want ? -1 : l->from, .events = POLLIN},
                               {.fd = sending ? l->to : -1, .events = POLLOUT}};
        if (poll(fd, 2, SLICE_MS) < 0) {
            if (errno == EINTR) continue;
            return status_fail_errno(err, SLT_CHECK_FAILED, errno, "cannot wait for the loss program");
        }
        /* Read before looking for errors: a program that explains itself and leaves should be heard. */
        SltStatus status = fd[0].revents ? receive_some(l, x, loss, err) : SLT_OK;
        if (status == SLT_OK && fd[1].revents) status = send_some(l, x, err);
        if (status != SLT_OK) return status;
    }
}

SltStatus loss_exchange(LossProgram *l, const LossRequest *q, const float *image, double *loss, float *adjoint,
                        SltError *err) {
    size_t n = (size_t)q->width * q->height * q->channels;
    char extra;
    l->nhead = 0;
    if (read(l->from, &extra, 1) > 0)
        return status_fail(
            err, SLT_CHECK_FAILED,
            "the loss program wrote more than its answer: %zu values of 4 bytes behind one line are wanted", n);
    char *line = request_line(q);
    if (!line) return status_fail(err, SLT_LIMIT, "out of memory");
    Exchange x = {.part = {line, (const char *)image},
                  .size = {strlen(line), n * sizeof *image},
                  .body = (char *)adjoint,
                  .want = n * sizeof *adjoint};
    SltStatus status = converse(l, &x, q->deadline, loss, err);
    free(line);
    for (size_t i = 0; status == SLT_OK && !isnan(*loss) && i < n; i++)
        if (!isfinite(adjoint[i]))
            status = status_fail(err, SLT_CHECK_FAILED,
                                 "the loss program's adjoint image is not finite in row %zu, column %zu, channel %zu",
                                 i / q->channels / q->width, i / q->channels % q->width, i % q->channels);
    return status;
}
