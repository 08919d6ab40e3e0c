/* Status codes and error texts shared by the runtime and the command.
 *
 * A runtime function that can fail takes an `SltError *` (never NULL unless said) and returns an SltStatus: SLT_OK, or
 * the same code that it left in the error. The codes are the exit statuses of the command. An SltError is plain data,
 * owned by the caller; nothing in it needs freeing; each thread has its own. */
#ifndef SALTUS_RUNTIME_BASE_STATUS_H
#define SALTUS_RUNTIME_BASE_STATUS_H

#include "saltus/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Fills `err` (which may be NULL: then only the status is returned) and returns `status`, so that
 * callers can write `return status_fail(err, SLT_INPUT, "...", ...)`. A text that does not fit is
 * cut. */
SltStatus status_fail(SltError *err, SltStatus status, const char *fmt, ...) __attribute__((format(printf, 3, 4)));

/* The same with ": <errno text>" added; `code` is an errno value. Thread-safe. */
SltStatus status_fail_errno(SltError *err, SltStatus status, int code, const char *fmt, ...)
    __attribute__((format(printf, 4, 5)));

/* A static name: "ok", "check failed", "usage" ... */
const char *status_name(SltStatus status);

#ifdef __cplusplus
}
#endif
#endif
