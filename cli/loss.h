/* A loss computed by another program: fit hands it every image through a pipe and reads the loss and the adjoint image
 * back.
 *
 *   request   {"iteration": 0, "view": 0, "views": 1, "width": 64, "height": 64, "channels": 3, ...
 *             ... "target": null, "mask": null}\n
 *             width * height * channels little-endian f32, interleaved, top row first
 *   answer    {"loss": 0.25}\n
 *             as many f32: the derivative of the loss with respect to every value of the image
 *
 * The program lives as long as the fit, in a process group of its own, so that Ctrl-C ends the fit and not the program;
 * the end of its input is the program's sign to leave. Whatever the program does wrong (ends, says nothing, says too
 * much, says what is no number) is an error with a text, never a hang or a signal here. */
#ifndef SALTUS_CLI_LOSS_H
#define SALTUS_CLI_LOSS_H

#include <stdint.h>

#include "runtime/base/status.h"

typedef struct LossProgram LossProgram;

typedef struct LossRequest {
    uint32_t iteration, view, views, width, height, channels;
    const char *target, *mask; /* paths, for the program to read; may be NULL */
    double deadline;           /* of cli_now(); 0: none */
} LossRequest;

/* Starts `sh -c command` in the folder `dir` (NULL: the current one). timeout: seconds to wait for each answer. Returns
 * NULL with err set on failure; else the caller ends it with loss_stop. */
LossProgram *loss_start(const char *command, const char *dir, double timeout, SltError *err);
/* SLT_CHECK_FAILED: the program failed; SLT_LIMIT: it did not answer in time; SLT_INTERRUPTED. A loss of null is NaN:
 * the optimiser takes the step back. */
SltStatus loss_exchange(LossProgram *l, const LossRequest *q, const float *image, double *loss, float *adjoint,
                        SltError *err);
/* Closes the program's input and waits a moment for the program to leave; then kills it. NULL is fine. */
void loss_stop(LossProgram *l);

#endif
