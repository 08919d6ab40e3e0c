/* saltus format: the formatter of the language server, on a file. */
#include <string.h>

#include "cli/lsp/lsp.h"

typedef struct Formatted {
    const Cli *c;
    const char *text, *why; /* text NULL: errors of syntax, or, with why, a file that cannot be read */
} Formatted;

static void body(Session *s, void *arg) {
    Formatted *f = arg;
    int file = session_add_file(s, f->c->file, &f->why);
    if (file >= 0) f->text = format_source(s, file);
}

static int put(const Cli *c, const char *text) {
    SltError err = {0};
    if (c->output) return file_write_atomic(c->output, text, strlen(text), &err) == SLT_OK ? SLT_OK : cli_fail(c, &err);
    fputs(text, stdout);
    return SLT_OK;
}

int verb_format(Cli *c) {
    Session *s = cli_need(session_create(LSP_MEMORY));
    Formatted f = {.c = c};
    int status = session_protect(s, body, &f);
    if (status) cli_error(status, "%s", s->unwind_text);
    else if (f.why) status = cli_error(SLT_INPUT, "cannot read `%s`: %s", c->file, f.why);
    else if (f.text) status = put(c, f.text);
    else {
        if (c->json) diag_print_json(s, stderr);
        else diag_print_text(s, stderr, false);
        status = SLT_PROGRAM;
    }
    session_destroy(s);
    return status;
}
