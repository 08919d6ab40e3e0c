/* Messages in, jobs out. A loop over standard input and the pipes of jobs; nothing here waits for an analysis. */
#include "cli/lsp/server.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "bindings/c/api.h"
#include "cli/lsp/lsp.h"
#include "runtime/base/text.h"

/* The errors of the front end are held back so long where it found none: then warnings, which take longer, come with
 * them, and those on the screen do not go and come back. */
enum { HOLD_MS = 120 };

typedef struct Job {
    pid_t pid;
    int fd;
    char *data;
    size_t len, cap;
    json_t *id; /* of the request; NULL: diagnostics of `uri` */
    char *uri;
    int64_t version;
    double began, arrived; /* arrived: of the line in `held` */
    char *held;            /* what the front end says, while the rest is awaited */
    bool told;             /* and that was published */
    struct Job *next;
} Job;

typedef struct Loop {
    Server s;
    Rpc in;
    Job *jobs;
    bool initialized, shut, done, broken; /* broken: the output is */
    int status;
} Loop;

/* ---- sending */

static void send_text(Loop *l, Text *t) {
    char *text = cli_need(text_close(t));
    if (!rpc_send(text, t->size)) l->broken = true;
    free(text);
}

static FILE *begin(Text *t) { return cli_need(text_open(t)); }

static void put_id(FILE *out, json_t *id) {
    char *text = id ? json_dumps(id, JSON_ENCODE_ANY) : NULL;
    fputs(text ? text : "null", out);
    free(text);
}

static void send_result(Loop *l, json_t *id, const char *result, size_t n) {
    Text t;
    FILE *out = begin(&t);
    fputs("{\"jsonrpc\":\"2.0\",\"id\":", out);
    put_id(out, id);
    fputs(",\"result\":", out);
    fwrite(result, 1, n, out);
    fputc('}', out);
    send_text(l, &t);
}

static void send_error(Loop *l, json_t *id, int code, const char *what) {
    Text t;
    FILE *out = begin(&t);
    fputs("{\"jsonrpc\":\"2.0\",\"id\":", out);
    put_id(out, id);
    fprintf(out, ",\"error\":{\"code\":%d,\"message\":", code);
    json_text(out, what);
    fputs("}}", out);
    send_text(l, &t);
}

static void publish(Loop *l, const char *uri, const Document *d, json_t *list) {
    Text t;
    FILE *out = begin(&t);
    fputs("{\"jsonrpc\":\"2.0\",\"method\":\"textDocument/publishDiagnostics\",\"params\":{\"uri\":", out);
    json_text(out, uri);
    if (d) fprintf(out, ",\"version\":%lld", (long long)d->version);
    char *text = list ? json_dumps(list, JSON_COMPACT) : NULL;
    fprintf(out, ",\"diagnostics\":%s}}", text ? text : "[]");
    free(text);
    send_text(l, &t);
}

/* ---- jobs */

/* NULL: the one behind the last. */
static Job **slot_of(Loop *l, const Job *j) {
    Job **at = &l->jobs;
    while (*at != j) at = &(*at)->next;
    return at;
}

/* Ends a job, which may still run; returns its wait status. */
static int job_end(Loop *l, Job *j, bool kill_it) {
    int status = 0;
    *slot_of(l, j) = j->next;
    if (kill_it) kill(j->pid, SIGKILL);
    close(j->fd);
    while (waitpid(j->pid, &status, 0) < 0 && errno == EINTR) {
    }
    json_decref(j->id);
    free(j->data);
    free(j->held);
    free(j->uri);
    free(j);
    return status;
}

Document *server_document(const Server *s, const char *uri) {
    for (Document *d = s->documents; d; d = d->next)
        if (!strcmp(d->uri, uri)) return d;
    return NULL;
}

static bool has_string(char **list, uint32_t n, const char *text) {
    for (uint32_t i = 0; i < n; i++)
        if (!strcmp(list[i], text)) return true;
    return false;
}

static char **strings(json_t *list, const char *key, uint32_t *n) {
    char **out = cli_need(calloc(json_array_size(list) + 1, sizeof *out));
    *n = 0;
    for (size_t i = 0; i < json_array_size(list); i++) {
        json_t *item = json_array_get(list, i);
        const char *text = json_string_value(key ? json_object_get(item, key) : item);
        if (text) out[(*n)++] = cli_need(strdup(text));
    }
    return out;
}

static void free_strings(char **list, uint32_t n) {
    for (uint32_t i = 0; i < n; i++) free(list[i]);
    free(list);
}

/* Diagnostics of a document and of what it imports; an import that is open has its own. */
static void publish_step(Loop *l, Document *d, json_t *step) {
    json_t *files = json_object_get(step, "files");
    uint32_t n;
    char **uris = strings(files, "uri", &n);
    for (size_t i = 0; i < json_array_size(files); i++) {
        json_t *file = json_array_get(files, i);
        const char *uri = json_string_value(json_object_get(file, "uri"));
        if (!uri || (strcmp(uri, d->uri) && server_document(&l->s, uri))) continue;
        publish(l, uri, strcmp(uri, d->uri) ? NULL : d, json_object_get(file, "diagnostics"));
    }
    for (uint32_t i = 0; i < d->ntold; i++)
        if (!has_string(uris, n, d->told[i]) && !server_document(&l->s, d->told[i])) publish(l, d->told[i], NULL, NULL);
    free_strings(d->told, d->ntold);
    d->told = uris, d->ntold = n;
    json_t *imports = json_object_get(step, "imports");
    if (!imports) return;
    free_strings(d->imports, d->nimports);
    d->imports = strings(imports, NULL, &d->nimports);
}

static void keep_assets(Loop *l, json_t *list) {
    for (size_t i = 0; i < json_array_size(list); i++) {
        json_t *item = json_array_get(list, i);
        const char *path;
        json_int_t size, seconds, nanoseconds, kind, n, dims[4];
        if (json_unpack(item, "{s:s, s:I, s:I, s:I, s:I, s:I, s:[IIII]}", "path", &path, "size", &size, "seconds",
                        &seconds, "nanoseconds", &nanoseconds, "kind", &kind, "n", &n, "dims", &dims[0], &dims[1],
                        &dims[2], &dims[3]))
            continue;
        Asset *a = l->s.assets;
        while (a && (strcmp(a->path, path) || a->kind != kind)) a = a->next;
        if (!a) {
            a = cli_need(calloc(1, sizeof *a));
            a->path = cli_need(strdup(path)), a->next = l->s.assets;
            l->s.assets = a;
        }
        a->size = size, a->seconds = seconds, a->nanoseconds = nanoseconds, a->kind = (int)kind;
        a->ndims = (uint32_t)n;
        for (int k = 0; k < 4; k++) a->dims[k] = (uint32_t)dims[k];
    }
}

/* A line that a job of diagnostics wrote. */
static void take_step(Loop *l, Job *j, const char *line) {
    Document *d = server_document(&l->s, j->uri);
    json_t *step = json_loads(line, JSON_ALLOW_NUL, NULL);
    bool last = json_is_true(json_object_get(step, "last"));
    if (step && d && d->version == j->version) {
        keep_assets(l, json_object_get(step, "assets"));
        if (last) {
            publish_step(l, d, step);
            j->told = true;
        } else {
            free(j->held);
            j->held = cli_need(strdup(line));
            j->arrived = cli_now();
        }
    }
    json_decref(step);
}

static void tell_held(Loop *l, Job *j) {
    Document *d = server_document(&l->s, j->uri);
    json_t *step = j->held ? json_loads(j->held, JSON_ALLOW_NUL, NULL) : NULL;
    if (step && d && d->version == j->version) publish_step(l, d, step), j->told = true;
    json_decref(step);
}

static const char *ending(char *buffer, size_t size, int status, bool late) {
    if (late) snprintf(buffer, size, "it took more than %d seconds", LSP_JOB_SECONDS);
    else if (WIFSIGNALED(status))
        snprintf(buffer, size, "the analysis ended by signal %d, a fault of ours", WTERMSIG(status));
    else snprintf(buffer, size, "the analysis ended with status %d, a fault of ours", WEXITSTATUS(status));
    return buffer;
}

/* Of an analysis that did not come to its end: what was known by then, and that. */
static void tell_ending(Loop *l, Document *d, const char *held, const char *what, bool late) {
    json_t *step = held ? json_loads(held, JSON_ALLOW_NUL, NULL) : NULL;
    if (!step) step = json_pack("{s:[{s:s,s:[]}]}", "files", "uri", d->uri, "diagnostics");
    json_t *list = json_object_get(json_array_get(json_object_get(step, "files"), 0), "diagnostics");
    json_array_append_new(list, json_pack("{s:{s:{s:i,s:i},s:{s:i,s:i}},s:i,s:s,s:s,s:s}", "range", "start", "line", 0,
                                          "character", 0, "end", "line", 0, "character", 0, "severity", late ? 3 : 1,
                                          "code", late ? "limit" : "internal", "source", "saltus", "message", what));
    publish_step(l, d, step);
    json_decref(step);
}

/* The job has written all it will, or its time is over. */
static void job_finish(Loop *l, Job *j, bool late) {
    char text[96];
    Job was = *j;
    json_incref(j->id);
    j->data = j->held = j->uri = NULL; /* these are kept for what follows */
    int status = job_end(l, j, late);
    bool good = !late && WIFEXITED(status) && WEXITSTATUS(status) == 0;
    Document *d = server_document(&l->s, was.uri);
    if (was.id && good && was.len) send_result(l, was.id, was.data, was.len);
    else if (was.id)
        send_error(l, was.id, late ? RPC_REQUEST_FAILED : RPC_INTERNAL_ERROR, ending(text, sizeof text, status, late));
    else if (!good && d && d->version == was.version)
        tell_ending(l, d, was.held, ending(text, sizeof text, status, late), late);
    json_decref(was.id);
    free(was.uri);
    free(was.held);
    free(was.data);
}

/* Reads what a job has written. */
static void job_read(Loop *l, Job *j) {
    if (j->cap - j->len < 1 << 16) {
        j->cap = j->cap ? j->cap * 2 : 1 << 17;
        j->data = cli_need(realloc(j->data, j->cap));
    }
    ssize_t n = read(j->fd, j->data + j->len, j->cap - j->len - 1);
    if (n < 0 && (errno == EINTR || errno == EAGAIN)) return;
    if (n <= 0) {
        job_finish(l, j, false);
        return;
    }
    j->len += (size_t)n;
    for (char *end; !j->id && (end = memchr(j->data, '\n', j->len));) {
        *end = 0;
        take_step(l, j, j->data);
        size_t used = (size_t)(end - j->data) + 1;
        memmove(j->data, j->data + used, j->len - used);
        j->len -= used;
    }
}

static void run_job(const Loop *l, const Document *d, const char *method, json_t *params, uint32_t offset, FILE *out) {
    static const struct {
        const char *method;
        Request *run;
    } requests[] = {{"textDocument/hover", request_hover},
                    {"textDocument/definition", request_definition},
                    {"textDocument/references", request_references},
                    {"textDocument/documentHighlight", request_highlight},
                    {"textDocument/signatureHelp", request_signature},
                    {"textDocument/documentSymbol", request_symbols}};
    if (!method) analyse_check(&l->s, d, out);
    else if (!strcmp(method, "textDocument/completion")) request_complete(&l->s, d, offset, out);
    else if (!strcmp(method, "textDocument/formatting")) request_format(&l->s, d, params, out);
    for (size_t i = 0; method && i < sizeof requests / sizeof *requests; i++) {
        if (strcmp(requests[i].method, method)) continue;
        analyse_request(&l->s, d, requests[i].run, offset, params, out);
    }
}

static void job_start(Loop *l, const Document *d, json_t *id, const char *method, json_t *params, uint32_t offset) {
    int ends[2];
    Job *j = cli_need(calloc(1, sizeof *j));
    j->uri = cli_need(strdup(d->uri));
    if (pipe2(ends, O_CLOEXEC) != 0) ends[0] = ends[1] = -1;
    fflush(stdout);
    pid_t pid = ends[0] >= 0 ? fork() : -1;
    if (pid == 0) {
        const struct rlimit no_core = {0, 0}, cpu = {2 * LSP_JOB_SECONDS, 2 * LSP_JOB_SECONDS};
        setrlimit(RLIMIT_CORE, &no_core);
        setrlimit(RLIMIT_CPU, &cpu);
        signal(SIGINT, SIG_DFL);
        signal(SIGTERM, SIG_DFL);
        FILE *out = fdopen(ends[1], "w");
        if (!out) _exit(SLT_LIMIT);
        run_job(l, d, method, params, offset, out);
        _exit(fflush(out) == 0 ? 0 : SLT_OUTPUT);
    }
    if (ends[1] >= 0) close(ends[1]);
    if (pid < 0) {
        if (ends[0] >= 0) close(ends[0]);
        if (id) send_error(l, id, RPC_INTERNAL_ERROR, strerror(errno));
        free(j->uri);
        free(j);
        return;
    }
    j->pid = pid, j->fd = ends[0], j->id = json_incref(id), j->version = d->version, j->began = cli_now();
    *slot_of(l, NULL) = j; /* behind the others: what is ready together is answered as it was asked */
}

static void end_checks(Loop *l, const char *uri) {
    for (Job *j = l->jobs, *next; j; j = next) {
        next = j->next;
        if (!j->id && !strcmp(j->uri, uri)) job_end(l, j, true);
    }
}

/* ---- waiting */

static uint32_t count_jobs(const Loop *l) {
    uint32_t n = 0;
    for (const Job *j = l->jobs; j; j = j->next) n++;
    return n;
}

/* Waits for input, if wanted, and for jobs; true: there is input. */
static bool wait_for(Loop *l, bool input, int timeout) {
    struct pollfd fds[LSP_MOST_JOBS + LSP_MOST_DOCUMENTS + 1];
    uint32_t n = 0;
    double now = cli_now();
    for (Job *j = l->jobs; j && n < sizeof fds / sizeof *fds - 1; j = j->next) {
        double left = j->began + LSP_JOB_SECONDS - now,
               held = j->held && !j->told ? j->arrived + 1e-3 * HOLD_MS - now : left;
        int ms = (int)(1e3 * (held < left ? held : left)) + 1;
        if (ms < 0) ms = 0;
        if (timeout < 0 || ms < timeout) timeout = ms;
        fds[n++] = (struct pollfd){.fd = j->fd, .events = POLLIN};
    }
    fds[n] = (struct pollfd){.fd = input ? 0 : -1, .events = POLLIN};
    if (poll(fds, n + 1, timeout) < 0) return false;
    bool ready = fds[n].revents != 0;
    uint32_t at = 0;
    for (Job *j = l->jobs, *next; j && at < n; j = next, at++) {
        next = j->next;
        if (fds[at].revents) job_read(l, j);
    }
    now = cli_now();
    for (Job *j = l->jobs, *next; j; j = next) {
        next = j->next;
        if (j->held && !j->told && now >= j->arrived + 1e-3 * HOLD_MS) tell_held(l, j);
        if (now >= j->began + LSP_JOB_SECONDS) job_finish(l, j, true);
    }
    return ready;
}

/* ---- documents */

static const char *text_at(json_t *o, const char *key) { return json_string_value(json_object_get(o, key)); }

static void touched(Loop *l, Document *changed) {
    for (Document *d = l->s.documents; d; d = d->next)
        if (d == changed || has_string(d->imports, d->nimports, changed->path)) d->stale = true;
}

static void did_open(Loop *l, json_t *params) {
    json_t *item = json_object_get(params, "textDocument"), *text = json_object_get(item, "text");
    const char *uri = text_at(item, "uri"), *language = text_at(item, "languageId");
    if (!uri || !json_is_string(text) || json_string_length(text) > LSP_MOST_MESSAGE) return;
    uint32_t n = 0;
    for (Document *d = l->s.documents; d; d = d->next) n++;
    Document *d = server_document(&l->s, uri);
    if (!d && n >= LSP_MOST_DOCUMENTS) return;
    if (!d) {
        d = cli_need(calloc(1, sizeof *d));
        d->uri = cli_need(strdup(uri));
        d->path = document_path(uri);
        d->is_file = d->path != NULL;
        if (!d->path) d->path = cli_need(strdup(uri));
        d->next = l->s.documents;
        l->s.documents = d;
    }
    d->glsl = (language && !strcmp(language, "glsl")) || api_is_glsl(d->path, SLT_LANGUAGE_AUTO);
    d->version = json_integer_value(json_object_get(item, "version"));
    free(d->text);
    d->len = json_string_length(text);
    d->text = cli_need(malloc(d->len + 1));
    memcpy(d->text, json_string_value(text), d->len);
    d->text[d->len] = 0;
    touched(l, d);
}

static void did_change(Loop *l, json_t *params) {
    json_t *item = json_object_get(params, "textDocument"), *changes = json_object_get(params, "contentChanges");
    const char *uri = text_at(item, "uri");
    Document *d = uri ? server_document(&l->s, uri) : NULL;
    if (!d) return;
    for (size_t i = 0; i < json_array_size(changes); i++)
        if (!document_change(d, json_array_get(changes, i), l->s.utf8)) break;
    json_t *version = json_object_get(item, "version");
    d->version = json_is_integer(version) ? json_integer_value(version) : d->version + 1;
    touched(l, d);
}

static void did_close(Loop *l, json_t *params) {
    const char *uri = text_at(json_object_get(params, "textDocument"), "uri");
    for (Document **at = &l->s.documents; uri && *at; at = &(*at)->next) {
        Document *d = *at;
        if (strcmp(d->uri, uri)) continue;
        end_checks(l, uri);
        touched(l, d); /* what imports it reads the file again */
        *at = d->next;
        publish(l, d->uri, NULL, NULL);
        for (uint32_t i = 0; i < d->ntold; i++)
            if (strcmp(d->told[i], d->uri) && !server_document(&l->s, d->told[i])) publish(l, d->told[i], NULL, NULL);
        document_free(d);
        return;
    }
}

static void did_save(Loop *l, json_t *params) {
    const char *uri = text_at(json_object_get(params, "textDocument"), "uri");
    Document *d = uri ? server_document(&l->s, uri) : NULL;
    if (d) touched(l, d);
}

/* Files have changed beside the editor: anything may have been read from them. */
static void all_touched(Loop *l) {
    for (Document *d = l->s.documents; d; d = d->next) d->stale = true;
}

static void start_checks(Loop *l) {
    for (Document *d = l->s.documents; d; d = d->next) {
        if (!d->stale) continue;
        end_checks(l, d->uri);
        if (count_jobs(l) >= LSP_MOST_JOBS) return; /* the others when a job has ended */
        d->stale = false;
        job_start(l, d, NULL, NULL, NULL, 0);
    }
}

/* ---- requests */

static void initialize(Loop *l, json_t *id, json_t *params) {
    json_t *general = json_object_get(json_object_get(params, "capabilities"), "general");
    json_t *encodings = json_object_get(general, "positionEncodings");
    for (size_t i = 0; i < json_array_size(encodings); i++) {
        const char *name = json_string_value(json_array_get(encodings, i));
        if (name && !strcmp(name, "utf-8")) l->s.utf8 = true;
    }
    Text t;
    FILE *out = begin(&t);
    fprintf(out,
            "{\"capabilities\":{\"positionEncoding\":\"%s\","
            "\"textDocumentSync\":{\"openClose\":true,\"change\":2,\"save\":{\"includeText\":false}},"
            "\"hoverProvider\":true,\"definitionProvider\":true,\"referencesProvider\":true,"
            "\"documentHighlightProvider\":true,\"documentSymbolProvider\":true,\"documentFormattingProvider\":true,"
            "\"completionProvider\":{\"triggerCharacters\":[\".\",\"[\"]},"
            "\"signatureHelpProvider\":{\"triggerCharacters\":[\"(\",\",\"]}},"
            "\"serverInfo\":{\"name\":\"saltus\",\"version\":\"%s\"}}",
            l->s.utf8 ? "utf-8" : "utf-16", slt_version());
    char *text = cli_need(text_close(&t));
    send_result(l, id, text, t.size);
    free(text);
    l->initialized = true;
}

static void analysed(Loop *l, json_t *id, const char *method, json_t *params) {
    const char *uri = text_at(json_object_get(params, "textDocument"), "uri");
    Document *d = uri ? server_document(&l->s, uri) : NULL;
    json_t *position = json_object_get(params, "position");
    uint32_t offset = 0;
    if (!d) {
        send_error(l, id, RPC_INVALID_PARAMS, "this document is not open");
        return;
    }
    if (position) {
        json_int_t line = json_integer_value(json_object_get(position, "line")),
                   character = json_integer_value(json_object_get(position, "character"));
        if (line < 0 || character < 0) line = character = 0;
        offset = (uint32_t)document_offset(d->text, d->len, line > UINT32_MAX ? UINT32_MAX : (uint32_t)line,
                                           character > INT32_MAX ? INT32_MAX : (uint32_t)character, l->s.utf8);
    }
    while (count_jobs(l) >= LSP_MOST_JOBS) wait_for(l, false, -1);
    job_start(l, d, id, method, params, offset);
}

static void cancel(Loop *l, json_t *params) {
    json_t *id = json_object_get(params, "id");
    for (Job *j = l->jobs; id && j; j = j->next)
        if (j->id && json_equal(j->id, id)) {
            send_error(l, id, RPC_CANCELLED, "cancelled");
            job_end(l, j, true);
            return;
        }
}

static bool is_analysed(const char *method) {
    static const char *const names[] = {"textDocument/hover",          "textDocument/definition",
                                        "textDocument/references",     "textDocument/documentHighlight",
                                        "textDocument/completion",     "textDocument/signatureHelp",
                                        "textDocument/documentSymbol", "textDocument/formatting"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (!strcmp(names[i], method)) return true;
    return false;
}

static void request(Loop *l, json_t *id, const char *method, json_t *params) {
    if (!strcmp(method, "initialize")) {
        if (l->initialized) send_error(l, id, RPC_INVALID_REQUEST, "`initialize` comes once");
        else initialize(l, id, params);
    } else if (!l->initialized) {
        send_error(l, id, RPC_NOT_INITIALIZED, "`initialize` comes first");
    } else if (l->shut) {
        send_error(l, id, RPC_INVALID_REQUEST, "after `shutdown` only `exit` may come");
    } else if (!strcmp(method, "shutdown")) {
        l->shut = true;
        while (l->jobs) job_end(l, l->jobs, true);
        send_result(l, id, "null", 4);
    } else if (is_analysed(method)) {
        analysed(l, id, method, params);
    } else {
        send_error(l, id, RPC_METHOD_NOT_FOUND, "this method is not supported");
    }
}

static void notification(Loop *l, const char *method, json_t *params) {
    if (!strcmp(method, "exit")) {
        l->done = true;
        l->status = l->shut ? SLT_OK : 1;
        return;
    }
    if (!l->initialized || l->shut) return;
    if (!strcmp(method, "textDocument/didOpen")) did_open(l, params);
    else if (!strcmp(method, "textDocument/didChange")) did_change(l, params);
    else if (!strcmp(method, "textDocument/didClose")) did_close(l, params);
    else if (!strcmp(method, "textDocument/didSave")) did_save(l, params);
    else if (!strcmp(method, "workspace/didChangeWatchedFiles")) all_touched(l);
    else if (!strcmp(method, "$/cancelRequest")) cancel(l, params);
}

static void message(Loop *l, const char *body, size_t size) {
    json_error_t e;
    json_t *m = json_loadb(body, size, JSON_ALLOW_NUL, &e);
    const char *method = text_at(m, "method");
    json_t *id = json_object_get(m, "id"), *params = json_object_get(m, "params");
    if (!m) send_error(l, NULL, RPC_PARSE_ERROR, e.text);
    else if (method && id) request(l, id, method, params);
    else if (method) notification(l, method, params);
    else if (!json_object_get(m, "result") &&
             !json_object_get(m, "error")) /* answers to what nobody asked are skipped */
        send_error(l, id, RPC_INVALID_REQUEST, "a message has a `method`");
    json_decref(m);
}

/* All whole messages that have arrived. */
static void messages(Loop *l) {
    for (;;) {
        char *body = NULL;
        size_t size = 0;
        switch (l->done || l->broken ? RPC_NOTHING : rpc_take(&l->in, &body, &size)) {
        case RPC_NOTHING: return;
        case RPC_MESSAGE:
            message(l, body, size);
            free(body);
            break;
        case RPC_TOO_LONG: send_error(l, NULL, RPC_INVALID_REQUEST, "the message is longer than 64 MiB"); break;
        case RPC_BROKEN:
            send_error(l, NULL, RPC_PARSE_ERROR, "a header with Content-Length is wanted before each message");
            l->done = true;
            l->status = SLT_INPUT;
            break;
        case RPC_NO_MEMORY: cli_need(NULL);
        }
    }
}

int server_run(const Cli *c) {
    Loop l = {.s = {.cli = c}, .status = 1};
    while (!l.done && !l.broken) {
        if (wait_for(&l, true, -1) && !rpc_fill(&l.in, 0)) {
            l.status = l.shut ? SLT_OK : 1; /* the client is gone, with an `exit` or without */
            break;
        }
        messages(&l);
        if (!l.done) start_checks(&l);
    }
    while (l.jobs) job_end(&l, l.jobs, true);
    while (l.s.documents) {
        Document *d = l.s.documents;
        l.s.documents = d->next;
        document_free(d);
    }
    while (l.s.assets) {
        Asset *a = l.s.assets;
        l.s.assets = a->next;
        free(a->path);
        free(a);
    }
    rpc_free(&l.in);
    return l.broken ? SLT_OUTPUT : l.status;
}
