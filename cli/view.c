/* saltus view: a shader in the browser, on a server of its own for this machine. The threads: cli/view/viewer.h. */
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <unistd.h>

#include "cli/view/files.h"
#include "cli/view/serve.h"

enum { TELL_MILLISECONDS = 30, IDLE_MILLISECONDS = 5000, LOOK_MILLISECONDS = 400 };

static bool make_token(char token[HTTP_TOKEN + 1]) {
    uint8_t bytes[HTTP_TOKEN / 2];
    if (getrandom(bytes, sizeof bytes, 0) != (ssize_t)sizeof bytes) return false;
    for (size_t i = 0; i < sizeof bytes; i++) snprintf(token + 2 * i, 3, "%02x", bytes[i]);
    return true;
}

static int say_address(const Cli *c, uint32_t port, const char *token) {
    if (c->json)
        printf("{\"url\": \"http://127.0.0.1:%u/?token=%s\", \"port\": %u, \"token\": \"%s\"}\n", port, token, port,
               token);
    else printf("http://127.0.0.1:%u/?token=%s\n", port, token);
    if (fflush(stdout) || ferror(stdout))
        return cli_error(SLT_OUTPUT, "standard output could not be written, which says where the page is");
    if (!c->quiet && !c->json) fputs("saltus: the page is for this machine alone; Ctrl-C ends it\n", stderr);
    return SLT_OK;
}

static void drain(int fd) {
    char bytes[256];
    while (read(fd, bytes, sizeof bytes) > 0) continue;
}

static void follow(Served *s, Files *files, uint64_t *seen, bool *failed) {
    char *lines = viewer_files(s->viewer, seen, failed);
    if (lines && files_set(files, lines)) viewer_compile(s->viewer);
    free(lines);
}

static void serve(Served *s, Files *files, int woken) {
    const int fds[] = {woken, files ? files_fd(files) : -1};
    uint64_t seen = 0;
    double next_tell = 0; /* at once: a save may have been missed already */
    double next_look = 0;
    bool failed = false;
    while (!s->over && !watch_ended()) {
        double wait = 1e3 * (next_tell - cli_now()) + (s->untold ? 0 : IDLE_MILLISECONDS);
        if (files) wait = fmin(wait, 1e3 * (next_look - cli_now()));
        uint32_t ready = http_poll(s->http, fds, files ? 2 : 1, wait > 0 ? (int)wait + 1 : 0);
        if (ready & 1) drain(woken), s->untold = true;
        serve_replies(s);
        if (files) follow(s, files, &seen, &failed);
        if (ready & 2 && files_changed(files, failed)) viewer_compile(s->viewer);
        double now = cli_now();
        if (files && now >= next_look) {
            if (files_look(files)) viewer_compile(s->viewer);
            next_look = now + 1e-3 * LOOK_MILLISECONDS;
        }
        if (now >= next_tell + (s->untold ? 0 : 1e-3 * IDLE_MILLISECONDS)) {
            http_tell(s->http);
            s->untold = false, next_tell = now + 1e-3 * TELL_MILLISECONDS;
        }
    }
}

static int view(Cli *c, Viewer *v, Served *s, const int pipe_ends[2]) {
    char token[HTTP_TOKEN + 1];
    SltError err = {0};
    if (!make_token(token)) return cli_error(SLT_LIMIT, "the system has no random numbers for a token");
    /* Before anything is compiled: a port that is taken is known at once. */
    SltStatus status = http_open(&s->http, c->port, token, serve_request, serve_tell, s, &err);
    if (status != SLT_OK) return cli_fail(c, &err);
    int started = viewer_start(v, c, pipe_ends[1]);
    if (started != SLT_OK) return started;
    Files *files = c->expr ? NULL : files_watch();
    if (!c->expr && !files && !c->quiet)
        cli_say(CLI_WARNING, "watch", NULL, "the file cannot be watched: POST /compile does it");
    watch_wakes(pipe_ends[1]);
    int said = say_address(c, http_port(s->http), token);
    if (said == SLT_OK) serve(s, files, pipe_ends[0]);
    watch_wakes(-1);
    files_free(files);
    if (said != SLT_OK) return said;
    return s->over ? SLT_OK : SLT_INTERRUPTED;
}

int verb_view(Cli *c) {
    int ends[2];
    if (c->file && !strcmp(c->file, "-")) return cli_usage(c, "view watches a FILE, which standard input is not");
    if (pipe2(ends, O_CLOEXEC | O_NONBLOCK) != 0)
        return cli_error(SLT_LIMIT, "no pipe could be had: %s", strerror(errno));
    static Viewer v; /* too large for a stack */
    Served s = {.viewer = &v};
    int status = view(c, &v, &s, ends);
    http_close(s.http);
    viewer_end(&v);
    close(ends[0]);
    close(ends[1]);
    SltError ended = {.status = SLT_INTERRUPTED, .text = "interrupted"};
    return status == SLT_INTERRUPTED ? cli_fail(c, &ended) : status;
}
