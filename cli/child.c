#include "cli/child.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "cli/cli.h"

enum { SLICE_MS = 100, MAX_RUNNING = 2, FIRST_ANSWER = 1 << 16 };
#define MAX_ANSWER ((size_t)4 << 30)

/* Process groups, for the end of the process: leaving frees nothing. */
static volatile pid_t running[MAX_RUNNING] = {-1, -1};

void child_abandon(void) {
    for (int k = 0; k < MAX_RUNNING; k++)
        if (running[k] > 0) kill(-running[k], SIGKILL);
}

static void note_running(pid_t old, pid_t new) {
    for (int k = 0; k < MAX_RUNNING; k++)
        if (running[k] == old) {
            running[k] = new;
            return;
        }
}

static void close_fd(int *fd) {
    if (*fd >= 0) close(*fd);
    *fd = -1;
}

void child_close_input(Child *c) { close_fd(&c->to); }

static void become(const char *command, const char *dir, int in, int out) {
    setpgid(0, 0);
    signal(SIGPIPE, SIG_DFL); /* the command ignores it, and that would be inherited */
    signal(SIGINT, SIG_DFL);
    signal(SIGTERM, SIG_DFL);
    if (dup2(in, 0) < 0 || dup2(out, 1) < 0 || (dir && *dir && chdir(dir) != 0)) _exit(126);
    execl("/bin/sh", "sh", "-c", command, (char *)NULL);
    _exit(127);
}

SltStatus child_start(Child *c, const char *what, const char *command, const char *dir, SltError *err) {
    int in[2] = {-1, -1}, out[2] = {-1, -1};
    *c = (Child){.what = what, .pid = -1, .to = -1, .from = -1};
    if (pipe2(in, O_CLOEXEC) == 0 && pipe2(out, O_CLOEXEC) == 0) c->pid = fork();
    if (c->pid == 0) become(command, dir, in[0], out[1]);
    if (c->pid < 0) {
        SltStatus status = status_fail_errno(err, SLT_CHECK_FAILED, errno, "cannot start %s", what);
        for (int i = 0; i < 2; i++) close_fd(&in[i]), close_fd(&out[i]);
        return status;
    }
    note_running(-1, c->pid);
    setpgid(c->pid, c->pid); /* parent and child both do this: it must hold for whichever goes on first */
    c->to = in[1], c->from = out[0];
    close_fd(&in[0]);
    close_fd(&out[1]);
    fcntl(c->to, F_SETFL, O_NONBLOCK);
    fcntl(c->from, F_SETFL, O_NONBLOCK);
    return SLT_OK;
}

bool child_wait(Child *c, double seconds) {
    double until = cli_now() + seconds;
    while (!c->ended) {
        pid_t got = waitpid(c->pid, &c->wait_status, WNOHANG);
        if (got == c->pid || (got < 0 && errno != EINTR)) c->ended = true;
        else if (cli_now() >= until) break;
        else nanosleep(&(struct timespec){.tv_nsec = 5000000}, NULL);
    }
    return c->ended;
}

void child_stop(Child *c) {
    close_fd(&c->to);
    close_fd(&c->from);
    note_running(c->pid, -1);
    if (child_wait(c, 1)) return;
    kill(-c->pid, SIGTERM);
    if (child_wait(c, 1)) return;
    kill(-c->pid, SIGKILL);
    child_wait(c, 5);
}

SltStatus child_fail_ended(Child *c, const char *when, SltError *err) {
    if (!child_wait(c, 1)) return status_fail(err, SLT_CHECK_FAILED, "%s closed its pipe %s", c->what, when);
    if (WIFSIGNALED(c->wait_status))
        return status_fail(err, SLT_CHECK_FAILED, "%s was ended by signal %d %s", c->what, WTERMSIG(c->wait_status),
                           when);
    return status_fail(err, SLT_CHECK_FAILED, "%s ended with status %d %s", c->what, WEXITSTATUS(c->wait_status), when);
}

SltStatus child_fail_answer(const Child *c, const char *answer, size_t n, const char *why, SltError *err) {
    char shown[81];
    size_t m = n < 80 ? n : 80;
    for (size_t i = 0; i < m; i++) shown[i] = answer[i] >= 32 && answer[i] < 127 ? answer[i] : '?';
    shown[m] = 0;
    return status_fail(err, SLT_CHECK_FAILED,
                       "%s answered `%s`: %s (its standard output is the answer; messages go to standard error)",
                       c->what, shown, why);
}

SltStatus child_in_time(const Child *c, double since, double timeout, double deadline, SltError *err) {
    double now = cli_now();
    if (cli_interrupted()) return status_fail(err, SLT_INTERRUPTED, "interrupted");
    if (deadline > 0 && now > deadline)
        return status_fail(err, SLT_LIMIT, "the time limit was reached while %s worked", c->what);
    if (now > since + timeout) return status_fail(err, SLT_LIMIT, "%s did not answer within %g s", c->what, timeout);
    return SLT_OK;
}

/* ---- one question, one answer */
typedef struct Talk {
    Child child;
    size_t sent, got, room;
    char *answer;
} Talk;

static SltStatus send_some(Talk *t, const ChildJob *job, SltError *err) {
    while (t->sent < job->ninput) {
        ssize_t n = write(t->child.to, job->input + t->sent, job->ninput - t->sent);
        if (n > 0) t->sent += (size_t)n;
        else if (errno == EINTR) continue;
        else if (errno == EAGAIN || errno == EWOULDBLOCK) return SLT_OK;
        else if (errno == EPIPE) break; /* it has read enough */
        else return status_fail_errno(err, SLT_CHECK_FAILED, errno, "cannot write to %s", job->what);
    }
    child_close_input(&t->child);
    return SLT_OK;
}

static SltStatus receive_some(Talk *t, bool *end, SltError *err) {
    for (;;) {
        if (t->got + 1 >= t->room) {
            size_t room = t->room ? 2 * t->room : FIRST_ANSWER;
            char *more = room > MAX_ANSWER ? NULL : realloc(t->answer, room);
            if (!more) return status_fail(err, SLT_LIMIT, "no memory for the answer of %s", t->child.what);
            t->answer = more, t->room = room;
        }
        ssize_t n = read(t->child.from, t->answer + t->got, t->room - 1 - t->got);
        if (n < 0 && errno == EINTR) continue;
        if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) return SLT_OK;
        if (n < 0) return status_fail_errno(err, SLT_CHECK_FAILED, errno, "cannot read from %s", t->child.what);
        t->got += (size_t)n;
        *end = n == 0;
        if (*end) return SLT_OK;
    }
}

static SltStatus talk(Talk *t, const ChildJob *job, SltError *err) {
    double since = cli_now();
    bool end = false;
    SltStatus status = SLT_OK;
    while (status == SLT_OK && !end) {
        struct pollfd fd[2] = {{.fd = t->child.from, .events = POLLIN}, {.fd = t->child.to, .events = POLLOUT}};
        if (poll(fd, 2, SLICE_MS) < 0 && errno != EINTR)
            return status_fail_errno(err, SLT_CHECK_FAILED, errno, "cannot wait for %s", job->what);
        if (fd[1].revents && t->child.to >= 0) status = send_some(t, job, err);
        if (status == SLT_OK && fd[0].revents) status = receive_some(t, &end, err);
        if (status == SLT_OK && !end) status = child_in_time(&t->child, since, job->timeout, job->deadline, err);
    }
    /* Its output has ended: soon it has, too. */
    while (status == SLT_OK && !child_wait(&t->child, 0.1))
        status = child_in_time(&t->child, since, job->timeout, job->deadline, err);
    if (status != SLT_OK) return status;
    t->answer[t->got] = 0;
    if (WIFEXITED(t->child.wait_status) && WEXITSTATUS(t->child.wait_status) == 0) return SLT_OK;
    return child_fail_ended(&t->child, t->got ? "behind its answer" : "without an answer", err);
}

SltStatus child_run(const ChildJob *job, char **answer, size_t *size, SltError *err) {
    Talk t = {0};
    *answer = NULL, *size = 0;
    SltStatus status = child_start(&t.child, job->what, job->command, job->dir, err);
    if (status != SLT_OK) return status;
    status = talk(&t, job, err);
    child_stop(&t.child);
    if (status == SLT_OK) *answer = t.answer, *size = t.got;
    else free(t.answer);
    return status;
}
