/* Statuses shared by the runtime, the library and the command (they are its exit statuses). */
#ifndef SALTUS_BASE_STATUS_H
#define SALTUS_BASE_STATUS_H

typedef enum SltStatus {
    SLT_OK = 0,
    SLT_CHECK_FAILED = 1,  /* a check or a fit failed, an assert of the shader failed */
    SLT_USAGE = 2,
    SLT_PROGRAM = 3,       /* an error in the program */
    SLT_INPUT = 4,         /* an input file is missing or bad */
    SLT_OUTPUT = 5,        /* an output could not be written */
    SLT_LIMIT = 6,         /* a limit of time, memory or size was reached */
    SLT_INTERNAL = 70,     /* a fault of ours */
    SLT_INTERRUPTED = 130
} SltStatus;

typedef struct SltError {
    SltStatus status;
    char text[512];
} SltError;

/* Fills *err (may be NULL) and returns status. */
SltStatus slt_error(SltError *err, SltStatus status, const char *fmt, ...) __attribute__((format(printf, 3, 4)));

#endif
