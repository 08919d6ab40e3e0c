/* -o -: what the verb writes lies in a folder for temporary files until the verb has ended well. */
#include <errno.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cli/cli.h"

SltStatus cli_temporary_folder(char *folder, size_t size, SltError *err) {
    const char *in = getenv("TMPDIR");
    int n = snprintf(folder, size, "%s/saltus-XXXXXX", in && *in ? in : "/tmp");
    if (n > 0 && (size_t)n < size && mkdtemp(folder)) return SLT_OK;
    return status_fail_errno(err, SLT_OUTPUT, errno, "cannot make the folder %s", folder);
}

int stream_begin(Stream *s, Cli *c) {
    const char *format = c->stream_format;
    SltError err = {0};
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
    if (cli_temporary_folder(s->folder, sizeof s->folder, &err) != SLT_OK) {
        *s->folder = 0;
        return cli_fail(c, &err);
    }
    snprintf(s->file, sizeof s->file, "%s/out.%s", s->folder, format);
    c->output = s->file;
    return SLT_OK;
}

void cli_wrote(Cli *c, const char *fmt, ...) {
    va_list ap;
    va_start(ap, fmt);
    vsnprintf(c->wrote, sizeof c->wrote, fmt, ap);
    va_end(ap);
    if (!c->streams) fprintf(stderr, "saltus: %s%s\n", c->output, c->wrote);
}

int stream_end(Stream *s, Cli *c, int status) {
    SltError err = {0};
    unsigned char *bytes = NULL;
    size_t size = 0;
    if (!*s->folder) return status;
    if (access(s->file, F_OK) == 0) {
        if (file_read_all(s->file, &file_binary, &bytes, &size, &err) != SLT_OK) status = cli_fail(c, &err);
        else {
            fwrite(bytes, 1, size, stdout);
            bool sent = fflush(stdout) == 0 && !ferror(stdout); /* main says so where not */
            if (sent && *c->wrote) fprintf(stderr, "saltus: standard output%s\n", c->wrote);
        }
        free(bytes);
        unlink(s->file);
    }
    rmdir(s->folder);
    return status;
}
