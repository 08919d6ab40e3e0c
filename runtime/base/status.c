#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* strerror_r that returns the text */
#endif
#include "status.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

SltStatus status_fail(SltError *err, SltStatus status, const char *fmt, ...) {
    if (err) {
        va_list args;
        err->status = status;
        va_start(args, fmt);
        vsnprintf(err->text, sizeof err->text, fmt, args);
        va_end(args);
    }
    return status;
}

SltStatus status_fail_errno(SltError *err, SltStatus status, int code, const char *fmt, ...) {
    if (code == ENOMEM) status = SLT_LIMIT;
    if (err) {
        char buf[128];
        va_list args;
        err->status = status;
        va_start(args, fmt);
        vsnprintf(err->text, sizeof err->text, fmt, args);
        va_end(args);
        size_t at = strlen(err->text);
        const char *why = code == ENOMEM ? "out of memory" : strerror_r(code, buf, sizeof buf);
        snprintf(err->text + at, sizeof err->text - at, ": %s", why);
    }
    return status;
}

const char *status_name(SltStatus status) {
    switch (status) {
    case SLT_OK: return "ok";
    case SLT_CHECK_FAILED: return "check failed";
    case SLT_USAGE: return "usage";
    case SLT_PROGRAM: return "program";
    case SLT_INPUT: return "input";
    case SLT_OUTPUT: return "output";
    case SLT_LIMIT: return "limit";
    case SLT_STOPPED: return "stopped";
    case SLT_INTERNAL: return "internal";
    case SLT_INTERRUPTED: return "interrupted";
    }
    return "unknown";
}
