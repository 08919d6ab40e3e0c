/* -o -: what the verb writes lies in a folder for temporary files until the verb has ended well. */
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cli/cli.h"

int stream_begin(Stream *s, Cli *c) {
    const char *temporary = getenv("TMPDIR"), *format = c->stream_format;
    *s->folder = 0;
    c->streams = c->output && !strcmp(c->output, "-");
    if (!c->streams) {
        if (!format) return SLT_OK;
        return cli_usage(c, "--format %s is for -o -: other names say by their extension what they are", format);
    }
    if (!(c->verb->bit & (RENDER | GRAD | FIT)))
        return cli_usage(c, "-o - is for render, grad and fit; name a file for `%s`", c->verb->name);
    if (c->json) return cli_usage(c, "-o - and --json would both be written to standard output");
    if (!format) format = c->opt.rgba8 ? "raw" : c->verb->bit == FIT ? "json" : "png";
    if (isatty(1) && strcmp(format, "json") != 0)
        return cli_usage(c, "-o -: standard output is a terminal, and a picture is not for it");
    if (snprintf(s->folder, sizeof s->folder, "%s/saltus-XXXXXX", temporary && *temporary ? temporary : "/tmp") >=
            (int)sizeof s->folder ||
        !mkdtemp(s->folder)) {
        int code = errno;
        cli_error(SLT_OUTPUT, "cannot make the folder %s: %s", s->folder, strerror(code));
        *s->folder = 0;
        return SLT_OUTPUT;
    }
    snprintf(s->file, sizeof s->file, "%s/out.%s", s->folder, format);
    c->output = s->file;
    return SLT_OK;
}

int stream_end(Stream *s, Cli *c, int status) {
    SltError err = {0};
    unsigned char *bytes = NULL;
    size_t size = 0;
    if (!*s->folder) return status;
    if (access(s->file, F_OK) == 0) {
        if (file_read_all(s->file, &file_binary, &bytes, &size, &err) != SLT_OK) status = cli_fail(c, &err);
        else fwrite(bytes, 1, size, stdout); /* main looks whether that could be written */
        free(bytes);
        unlink(s->file);
    }
    rmdir(s->folder);
    return status;
}
