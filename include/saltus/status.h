/* Statuses: what the library's functions return, and the exit statuses of the command. */
#ifndef SALTUS_STATUS_H
#define SALTUS_STATUS_H

typedef enum SltStatus {
    SLT_OK = 0,
    SLT_CHECK_FAILED = 1, /* a check or a fit failed */
    SLT_USAGE = 2,        /* wrong arguments */
    SLT_PROGRAM = 3,      /* the shader has errors */
    SLT_INPUT = 4,        /* an input file is missing or bad */
    SLT_OUTPUT = 5,       /* an output could not be written */
    SLT_LIMIT = 6,        /* a limit of time, memory or size was reached */
    SLT_STOPPED = 7,      /* compiling ended where SltOptions.stop_after said: no fault; the command's status is 0 */
    SLT_INTERNAL = 70,    /* a fault of Saltus */
    SLT_INTERRUPTED = 130 /* stopped cleanly on request */
} SltStatus;

/* The caller's; functions of the library fill it, and it owns nothing. */
typedef struct SltError {
    SltStatus status;
    char text[512]; /* one line without a newline; "" when status is SLT_OK */
} SltError;

#endif
