/* A session: one compilation's memory, sources and diagnostics.
 *
 * Everything the compiler allocates lives in the session's arenas and dies with it. Errors of the *program* become
 * Diags and compilation goes on; a spent budget or a fault of ours unwinds with longjmp to `session_protect`, so no
 * function of the compiler returns error codes for them, and nothing leaks. One thread at a time. */
#ifndef SALTUS_BASE_SESSION_H
#define SALTUS_BASE_SESSION_H

#include <setjmp.h>
#include <stdbool.h>
#include <stdio.h>

#include "compiler/base/arena.h"

typedef enum Severity { SEV_ERROR, SEV_WARNING, SEV_PERF, SEV_NOTE } Severity;

/* Codes come from diag.def: DIAG(name, "E0123", SEV_ERROR, "printf format of the message", "long text of `saltus
 * explain E0123`") */
typedef enum DiagCode {
#define DIAG(name, code, severity, format, explanation) DIAG_##name,
#define DIAG_AS(name, code, severity, headline, explanation) DIAG_##name,
#include "compiler/base/diag.def"
#undef DIAG
#undef DIAG_AS
    DIAG_COUNT
} DiagCode;

/* A place in a source: bytes [pos, pos+len) of file `file` (index into Session.sources). file < 0: nowhere. */
typedef struct Span {
    int32_t file;
    uint32_t pos, len;
} Span;
#define SPAN_NONE ((Span){-1, 0, 0})

typedef struct Source {
    const char *path; /* as shown to people: "-" is standard input, "<expr>" the command line */
    const char *dir;  /* folder of the file, for imports and assets */
    const char *text; /* NUL-terminated */
    uint32_t len;
    const uint32_t *lines; /* byte offset of every line start; lines end in LF, CR LF or CR */
    uint32_t nlines;
    uint32_t lead, shown_end; /* shown_end not 0: what people wrote begins with line `lead`, where counting starts, and
                                 ends at that byte; places outside are its ends */
    uint32_t glsl[2];         /* not 0: the text is GLSL, for an image of this size in pixels */
    bool too_large;           /* beyond SOURCE_MAX bytes: text is empty and parse_module reports it */
} Source;

/* A text in place of the file `path`, whether there is one or not; the caller's. */
typedef struct HeldText {
    const char *path; /* without links, where the file is there */
    const char *text;
    size_t len;
} HeldText;

typedef struct DiagNote {
    Span span;
    const char *text;
    struct DiagNote *next;
} DiagNote;
typedef struct Diag {
    DiagCode code;
    Severity severity;
    Span span;
    const char *text;
    DiagNote *notes; /* in order */
    struct Diag *next;
} Diag;

/* Largest source, in bytes. */
#define SOURCE_MAX (16u << 20)

/* Open addressing over pointers in the session arena: interned strings, reported diagnostics, types of arrays. */
typedef struct PtrTable {
    const void **slots;
    uint32_t *hashes;
    uint32_t len, cap; /* cap is 0 or a power of two */
} PtrTable;

typedef struct Session {
    ArenaBudget budget;
    Arena session, module, scratch;
    Source *sources;
    uint32_t nsources, cap_sources;
    Diag *diags, **diags_end; /* in order of report; printed sorted by place */
    uint32_t nerrors, nwarnings;
    uint32_t max_errors; /* printed as text, and as many warnings; default 20, 0: all */
    jmp_buf *unwind;
    int unwind_status; /* once unwound: SLT_LIMIT, SLT_STOPPED or SLT_INTERNAL */
    char unwind_text[256];
    const char *const *import_dirs;
    uint32_t nimport_dirs;
    const char *stdlib_dir;
    const HeldText *held; /* texts that stand for files: what an editor has not saved yet */
    uint32_t nheld;
    const char *sandbox; /* the folder that holds all files which sources may name; NULL: they may name any */
    PtrTable strings, reported, array_types;
    bool bad_input; /* an error is of an input file, */
    bool bad_usage; /* or of the command line: the exit status says so */
} Session;

/* The compiler promises to stay below 512 MiB for any input; the default budget leaves LLVM its part. NULL only if not
 * even the Session can be allocated. Free with session_destroy, which takes NULL. */
Session *session_create(size_t budget_bytes /* 0: 384 MiB */);
void session_destroy(Session *s);

/* Runs body(s, arg); returns 0, or the SltStatus of the unwinding (text in s->unwind_text). Nests. On unwinding the
 * scratch arena goes back to where it was at the call. Everything that allocates in the session runs inside, except
 * session_add_file and session_add_text, which protect themselves. */
int session_protect(Session *s, void (*body)(Session *, void *), void *arg);
_Noreturn void session_limit(Session *s, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
/* Ends the body of session_protect where the user asked to stop (--stop-after): SLT_STOPPED. */
_Noreturn void session_stop(Session *s);
/* A fault of ours: never for bad input. */
_Noreturn void ice(Session *s, const char *fmt, ...) __attribute__((format(printf, 2, 3)));

/* Reads a file ("-" is standard input) or takes text (copied; dir may be NULL: "."); returns the index in s->sources,
 * or -1 with the system's text in *why (arena string; `why` may be NULL) or, for text, when the memory budget is spent.
 * A source beyond SOURCE_MAX bytes is added empty with too_large set. */
int session_add_file(Session *s, const char *path, const char **why);
int session_add_text(Session *s, const char *shown_path, const char *dir, const char *text, size_t len);

/* The text that the session holds in place of this file; NULL: none. */
const HeldText *session_held(const Session *s, const char *path);

double plain_strtod(const char *text, char **end); /* number.c: whatever the locale */

/* May a source that wrote `text` read the file `path`? If not, *why (of static life) says so. What does not exist may
 * be read. Without memory to tell, session_limit. */
bool session_allows(Session *s, const char *text, const char *path, const char **why);
/* The same for any folder. NULL: allowed; errno: what the system said. */
const char *sandbox_refusal(const char *folder, const char *text, const char *path);

/* Reports; the same code at the same span is reported once. Returns the Diag so that notes can be attached (never
 * NULL). */
Diag *diag_emit(Session *s, DiagCode code, Span span, ...);
void diag_note(Session *s, Diag *d, Span span, const char *fmt, ...) __attribute__((format(printf, 4, 5)));
/* 1-based line and column (columns count code points) of a byte offset. */
void span_position(const Session *s, Span span, uint32_t *line, uint32_t *column);
/* The start and the end of a span as editors count, from 0, of a line in UTF-16 units or, utf8, in bytes. */
typedef struct SpanEnds {
    uint32_t line, character;
} SpanEnds;
void span_ends(const Session *s, Span span, bool utf8, SpanEnds ends[2]);
/* Text form with source line and caret (colour if asked), and one LSP Diagnostic object (with uri) per line. Both are
 * sorted by place. The text form stops after max_errors errors (and as many warnings) and says how many more there are;
 * JSON has all of them. */
void diag_print_text(const Session *s, FILE *out, bool colour);
void diag_print_json(const Session *s, FILE *out);
const char *diag_code_name(DiagCode code);
void diag_put_uri(FILE *out, const char *path); /* as JSON, of a source's path */
/* The explanation of "E0123" (any case), or NULL; The title is the message
 * with words for what differs from case to case, "" where that is all of it. */
typedef struct DiagTitle {
    const char *code;
    Severity severity;
    char text[256];
} DiagTitle;
const char *diag_explain(const char *code, DiagTitle *title);
/* The nearest of n names within an edit distance fit for a suggestion, or NULL. The first of equals; NULL entries are
 * skipped; allocates nothing. */
const char *suggest_nearest(const char *name, const char *const *names, uint32_t n);

/* A table gives candidates, which the caller compares: start with *at == UINT32_MAX, and table_next gives every item of
 * this hash, then NULL. Nothing may be inserted in between. Items are not NULL. */
uint32_t hash_bytes(const void *data, size_t len);
void table_insert(Session *s, PtrTable *t, const void *item, uint32_t hash);
const void *table_next(const PtrTable *t, uint32_t hash, uint32_t *at);

/* Interned strings: equal text, equal pointer. Live in the session arena. */
const char *intern(Session *s, const char *text, size_t len);

#endif
