/* Sessions: making and unwinding them, and their sources with the lines. */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE
#endif
#include "compiler/base/session.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "saltus/status.h"

static void budget_spent(void *user) {
    Session *s = user;
    if (s->budget.refused) session_limit(s, "out of memory");
    session_limit(s, "out of memory: the program needs more than %zu MiB to compile", s->budget.limit >> 20);
}

Session *session_create(size_t budget_bytes) {
    Session *s = calloc(1, sizeof *s);
    if (!s) return NULL;
    s->budget =
        (ArenaBudget){.limit = budget_bytes ? budget_bytes : (size_t)1024 << 20, .fail = budget_spent, .user = s};
    arena_init(&s->session, "session", &s->budget);
    arena_init(&s->module, "module", &s->budget);
    arena_init(&s->scratch, "scratch", &s->budget);
    s->diags_end = &s->diags;
    s->max_errors = 20;
    return s;
}

void session_destroy(Session *s) {
    if (!s) return;
    arena_free_all(&s->session);
    arena_free_all(&s->module);
    arena_free_all(&s->scratch);
    free(s);
}

int session_protect(Session *s, void (*body)(Session *, void *), void *arg) {
    jmp_buf here;
    jmp_buf *volatile outer = s->unwind;
    const ArenaMark scratch = arena_mark(&s->scratch);
    if (setjmp(here) == 0) {
        s->unwind = &here;
        body(s, arg);
        s->unwind = outer;
        return 0;
    }
    s->unwind = outer;
    arena_reset(&s->scratch, scratch);
    return s->unwind_status;
}

_Noreturn static void unwind(Session *s, int status) {
    s->unwind_status = status;
    if (s->unwind) longjmp(*s->unwind, 1);
    /* Nobody protects this call, which session.h forbids: there is no caller that could be told. */
    fprintf(stderr, "saltus: %s\n", s->unwind_text);
    __builtin_trap();
}

void session_limit(Session *s, const char *fmt, ...) {
    va_list ap;
    va_start(ap, fmt);
    vsnprintf(s->unwind_text, sizeof s->unwind_text, fmt, ap);
    va_end(ap);
    unwind(s, SLT_LIMIT);
}

void session_stop(Session *s) {
    snprintf(s->unwind_text, sizeof s->unwind_text, "stopped as asked");
    unwind(s, SLT_STOPPED);
}

void ice(Session *s, const char *fmt, ...) {
    char text[200];
    va_list ap;
    va_start(ap, fmt);
    vsnprintf(text, sizeof text, fmt, ap);
    va_end(ap);
    snprintf(s->unwind_text, sizeof s->unwind_text, "internal compiler error: %s", text);
    unwind(s, SLT_INTERNAL);
}

/* ---- sources ---- */

static const char *folder_of(Session *s, const char *path) {
    const char *slash = strrchr(path, '/');
    if (!slash) return ".";
    if (slash == path) return "/";
    return arena_strndup(&s->session, path, (size_t)(slash - path));
}

/* Also finds lines that end in a lone CR, which editors and the Language Server Protocol count. */
static void index_lines(Session *s, Source *src) {
    const bool plain = !memchr(src->text, '\r', src->len);
    for (int pass = 0; pass < 2; pass++) {
        uint32_t *starts = pass ? ARENA_ARRAY(&s->session, uint32_t, src->nlines) : NULL;
        uint32_t n = 0;
        if (starts) starts[0] = 0;
        n++;
        for (uint32_t i = 0; i < src->len; i++) {
            if (plain) { /* without \r */
                const char *next = memchr(src->text + i, '\n', src->len - i);
                if (!next) break;
                i = (uint32_t)(next - src->text);
            }
            char c = src->text[i];
            if (c != '\n' && c != '\r') continue;
            if (c == '\r' && src->text[i + 1] == '\n') continue;
            if (starts) starts[n] = i + 1;
            n++;
        }
        src->nlines = n;
        src->lines = starts;
    }
}

static int add_source(Session *s, const char *path, const char *dir, const char *text, size_t len) {
    if (s->nsources == s->cap_sources) {
        uint32_t cap = s->cap_sources ? s->cap_sources * 2 : 8;
        Source *grown = ARENA_ARRAY(&s->session, Source, cap);
        if (s->nsources) memcpy(grown, s->sources, sizeof(Source) * s->nsources);
        s->sources = grown;
        s->cap_sources = cap;
    }
    Source src = {.path = arena_strndup(&s->session, path, strlen(path)),
                  .dir = arena_strndup(&s->session, dir, strlen(dir)),
                  .too_large = len > SOURCE_MAX};
    src.len = src.too_large ? 0 : (uint32_t)len;
    src.text = arena_strndup(&s->session, text, src.len);
    index_lines(s, &src);
    s->sources[s->nsources] = src;
    return (int)s->nsources++;
}

typedef struct AddArgs {
    const char *path, *dir, *text;
    size_t len;
    int result, error;
    const char *refused, *why;
} AddArgs;

static void add_text_body(Session *s, void *arg) {
    AddArgs *a = arg;
    a->result = add_source(s, a->path, a->dir ? a->dir : ".", a->text, a->len);
}

/* What stopped an addition for want of memory stops the compilation as well, where there is one. */
static int added(Session *s, int status, const AddArgs *a) {
    if (status && s->unwind) unwind(s, status);
    return status ? -1 : a->result;
}

int session_add_text(Session *s, const char *shown_path, const char *dir, const char *text, size_t len) {
    AddArgs a = {.path = shown_path, .dir = dir, .text = text, .len = len, .result = -1};
    return added(s, session_protect(s, add_text_body, &a), &a);
}

static void add_file_body(Session *s, void *arg) {
    AddArgs *a = arg;
    if (a->error == ENOMEM) session_limit(s, "cannot read `%s`: out of memory", a->path);
    if (a->refused) a->why = arena_printf(&s->session, "%s", a->refused);
    else a->result = add_source(s, a->path, strcmp(a->path, "-") ? folder_of(s, a->path) : ".", a->text, a->len);
}

/* A pipe or a device may never answer, and opening one must not wait either: only files are sources, and standard input
 * by its own name. */
static FILE *open_source(const char *path, const char **why) {
    struct stat st;
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
    if (fd < 0 || fstat(fd, &st)) *why = strerror(errno);
    else if (S_ISDIR(st.st_mode)) *why = strerror(EISDIR);
    else if (!S_ISREG(st.st_mode)) *why = "it is a pipe or a device, and a file is wanted (`-` reads standard input)";
    FILE *f = *why ? NULL : fdopen(fd, "rb");
    if (!f && !*why) *why = strerror(errno);
    if (!f && fd >= 0) close(fd);
    return f;
}

const HeldText *session_held(const Session *s, const char *path) {
    char *full = s->nheld ? realpath(path, NULL) : NULL;
    const HeldText *found = NULL;
    for (uint32_t i = 0; i < s->nheld && !found; i++)
        if (!strcmp(s->held[i].path, full ? full : path)) found = &s->held[i];
    free(full);
    return found;
}

/* Reads at most SOURCE_MAX + 1 bytes, so that an input without an end is a limit and not a hang. Returns an errno
 * value. */
static int read_all(FILE *f, char **text, size_t *len) {
    size_t cap = 1 << 16;
    char *buf = malloc(cap);
    *len = 0;
    while (buf) {
        *len += fread(buf + *len, 1, cap - *len, f);
        if (*len < cap || cap > SOURCE_MAX) break;
        cap = cap * 2 > SOURCE_MAX ? (size_t)SOURCE_MAX + 1 : cap * 2;
        char *grown = realloc(buf, cap);
        if (!grown) free(buf);
        buf = grown;
    }
    *text = buf;
    if (!buf) return ENOMEM;
    return ferror(f) ? (errno ? errno : EIO) : 0;
}

int session_add_file(Session *s, const char *path, const char **why) {
    AddArgs a = {.path = path, .result = -1};
    char *text = NULL;
    const HeldText *held = session_held(s, path);
    if (held) {
        a.text = held->text, a.len = held->len;
        return added(s, session_protect(s, add_file_body, &a), &a);
    }
    bool standard_input = !strcmp(path, "-");
    const char *refused = NULL;
    errno = 0; /* a stream that there is no memory for has no words of its own */
    FILE *f = standard_input ? stdin : open_source(path, &refused);
    a.error = f ? read_all(f, &text, &a.len) : errno;
    a.refused = f && a.error ? strerror(a.error) : refused;
    if (f && !standard_input) fclose(f);
    a.text = text;
    int status = session_protect(s, add_file_body, &a);
    free(text);
    if (why) *why = status ? s->unwind_text : a.why;
    return added(s, status, &a);
}

static bool climbs(const char *text) {
    for (const char *at = text; (at = strstr(at, "..")); at += 2)
        if ((at == text || at[-1] == '/') && (!at[2] || at[2] == '/')) return true;
    return false;
}

const char *sandbox_refusal(const char *folder, const char *text, const char *path) {
    errno = 0;
    if (text[0] == '/') return "a sandbox allows no absolute paths";
    if (climbs(text)) return "a sandbox allows no `..` in paths";
    char *root = realpath(*folder ? folder : ".", NULL), *real = root ? realpath(path, NULL) : NULL;
    int code = real ? 0 : errno;
    size_t n = root ? strlen(root) : 0;
    bool inside = real && !strncmp(real, root, n) && (real[n] == '/' || (n && root[n - 1] == '/'));
    bool missing = root && (code == ENOENT || code == ENOTDIR); /* whoever opens it says so */
    free(root);
    free(real);
    errno = code;
    /* What cannot be resolved is refused: it may be opened all the same. */
    return inside || missing ? NULL : code ? strerror(code) : "a link leads out of the sandbox";
}

bool session_allows(Session *s, const char *text, const char *path, const char **why) {
    *why = s->sandbox ? sandbox_refusal(s->sandbox, text, path) : NULL;
    if (*why && errno == ENOMEM) session_limit(s, "cannot read `%s`: out of memory", path);
    return !*why;
}
