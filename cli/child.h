/* A program that the command starts and talks to through two pipes: `sh -c COMMAND`, in a process group of its own, so
 * that Ctrl-C ends the command and not the program. Whatever it does wrong is an error with a text, never a hang or a
 * signal here; and it does not outlive the command. One thread uses a child. */
#ifndef SALTUS_CLI_CHILD_H
#define SALTUS_CLI_CHILD_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/types.h>

#include "runtime/base/status.h"

typedef struct Child {
    const char *what; /* "the loss program" */
    pid_t pid;
    int to, from; /* our ends of the pipes, not blocking; -1: closed */
    bool ended;   /* it has ended, and was waited for */
    int wait_status;
} Child;

/* In the folder dir, NULL or "": the current one. After an error there is nothing to stop. */
SltStatus child_start(Child *c, const char *what, const char *command, const char *dir, SltError *err);
/* Closes its input, waits a moment for it to leave, then ends it with its group. */
void child_stop(Child *c);
void child_close_input(Child *c);
bool child_wait(Child *c, double seconds); /* true: it has ended */
/* Its input or output was closed: how did it end? */
SltStatus child_fail_ended(Child *c, const char *when, SltError *err);
/* "... answered `line`: why", of n bytes. */
SltStatus child_fail_answer(const Child *c, const char *answer, size_t n, const char *why, SltError *err);
/* SLT_OK while there is time: since when (cli_now) it works, how long it may, and when everything is over (0: never).
 */
SltStatus child_in_time(const Child *c, double since, double timeout, double deadline, SltError *err);

typedef struct ChildJob {
    const char *what, *command, *dir;
    double timeout, deadline; /* seconds for all of it; of cli_now(), 0: none */
    const char *input;
    size_t ninput;
} ChildJob;
/* Starts it, sends the input and its end, takes what it says until its output ends (malloc'd, with a 0 behind) and
 * waits for it: it must end with status 0. It need not read its input. */
SltStatus child_run(const ChildJob *job, char **answer, size_t *size, SltError *err);

#endif
