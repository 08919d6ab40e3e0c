/* The pipe to a loss program: framing, time limits and every way in which it can fail. */
#include <errno.h>
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <jansson.h>

#include "cli/child.h"
#include "cli/cli.h"
#include "cli/loss.h"

enum { HEAD_MAX = 1 << 16, SLICE_MS = 100 };

struct LossProgram {
    Child child;
    double timeout;
    char head[HEAD_MAX]; /* of the answer: up to the end of its line, and what came along behind it */
    size_t nhead;
};

LossProgram *loss_start(const char *command, const char *dir, double timeout, SltError *err) {
    LossProgram *l = calloc(1, sizeof *l);
    if (!l) return status_fail(err, SLT_LIMIT, "out of memory"), NULL;
    l->timeout = timeout;
    if (child_start(&l->child, "the loss program", command, dir, err) == SLT_OK) return l;
    free(l);
    return NULL;
}

void loss_stop(LossProgram *l) {
    if (!l) return;
    child_stop(&l->child);
    free(l);
}

static SltStatus read_head(const LossProgram *l, const char *line, size_t n, double *loss, SltError *err) {
    json_error_t e;
    json_t *j = json_read(line, n, JSON_REJECT_DUPLICATES, &e), *value, *error;
    if (!j && json_no_memory(&e)) return status_fail(err, SLT_LIMIT, "out of memory");
    if (!j) return child_fail_answer(&l->child, line, n, e.text, err);
    value = json_object_get(j, "loss");
    error = json_object_get(j, "error");
    SltStatus status = SLT_OK;
    if (json_is_string(error))
        status = status_fail(err, SLT_CHECK_FAILED, "the loss program says: %s", json_string_value(error));
    else if (json_is_null(value)) *loss = NAN;
    else if (!json_is_number(value))
        status = child_fail_answer(&l->child, line, n, "{\"loss\": NUMBER} is wanted", err);
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
            ssize_t n = write(l->child.to, x->part[k] + x->sent[k], x->size[k] - x->sent[k]);
            if (n > 0) x->sent[k] += (size_t)n;
            else if (errno == EINTR) continue;
            else if (errno == EAGAIN || errno == EWOULDBLOCK) return SLT_OK;
            else if (errno == EPIPE) return child_fail_ended(&l->child, "while it was sent an image", err);
            else return status_fail_errno(err, SLT_CHECK_FAILED, errno, "cannot write to the loss program");
        }
    return SLT_OK;
}

static SltStatus take_head(LossProgram *l, Exchange *x, double *loss, SltError *err) {
    char *end = memchr(l->head, '\n', l->nhead);
    if (!end)
        return l->nhead == HEAD_MAX ? child_fail_answer(&l->child, l->head, l->nhead, "no end of line in 64 KiB", err)
                                    : SLT_OK;
    x->line = (size_t)(end - l->head) + 1;
    SltStatus status = read_head(l, l->head, x->line - 1, loss, err);
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
        ssize_t n = read(l->child.from, to, x->line ? x->want - x->got : HEAD_MAX - l->nhead);
        if (n < 0 && errno == EINTR) continue;
        if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) return SLT_OK;
        if (n < 0) return status_fail_errno(err, SLT_CHECK_FAILED, errno, "cannot read from the loss program");
        if (n == 0) {
            char when[96];
            snprintf(when, sizeof when, x->line ? "after %zu of %zu bytes of its adjoint image" : "before it answered",
                     x->got, x->want);
            return child_fail_ended(&l->child, when, err);
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
    double since = cli_now();
    SltStatus status = SLT_OK;
    for (;;) {
        bool sending = x->sent[1] < x->size[1];
        if (!sending && x->line && x->got == x->want) return SLT_OK;
        status = child_in_time(&l->child, since, l->timeout, deadline, err);
        if (status != SLT_OK) return status;
        struct pollfd fd[2] = {{.fd = x->line && x->got == x->want ? -1 : l->child.from, .events = POLLIN},
                               {.fd = sending ? l->child.to : -1, .events = POLLOUT}};
        if (poll(fd, 2, SLICE_MS) < 0) {
            if (errno == EINTR) continue;
            return status_fail_errno(err, SLT_CHECK_FAILED, errno, "cannot wait for the loss program");
        }
        /* Read before looking for errors: a program that explains itself and leaves should be heard. */
        status = fd[0].revents ? receive_some(l, x, loss, err) : SLT_OK;
        if (status == SLT_OK && fd[1].revents) status = send_some(l, x, err);
        if (status != SLT_OK) return status;
    }
}

SltStatus loss_exchange(LossProgram *l, const LossRequest *q, const float *image, double *loss, float *adjoint,
                        SltError *err) {
    size_t n = (size_t)q->width * q->height * q->channels;
    char extra;
    l->nhead = 0;
    if (read(l->child.from, &extra, 1) > 0)
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
