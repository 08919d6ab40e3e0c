/* A document's program, as far as the primal: parsed, checked, and with all warnings that need no more. */
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "bindings/c/api.h"
#include "cli/lsp/lsp.h"
#include "compiler/pass/pass.h"
#include "runtime/base/text.h"

/* ---- files that parameters name: dimensions that another job has read are still known while the file is the same */

static bool same_file(const Asset *a, const char *path, int kind, const struct stat *st) {
    return a->kind == kind && a->size == st->st_size && a->seconds == st->st_mtim.tv_sec &&
           a->nanoseconds == st->st_mtim.tv_nsec && !strcmp(a->path, path);
}

static bool probe(void *user, const char *path, const Symbol *of, uint32_t dims[4], uint32_t *ndims, const char **why) {
    Analysis *a = user;
    static SltProgram asks; /* all that the probe asks of a program: its options, and a place for texts */
    /* of a mesh positions and faces are different tables: what is there depends on the type */
    int kind = (int)(hash_bytes(of->type->name, strlen(of->type->name)) >> 1);
    struct stat st;
    bool there = stat(path, &st) == 0;
    for (const Asset *k = a->server->assets; there && k; k = k->next)
        if (same_file(k, path, kind, &st)) {
            memcpy(dims, k->dims, sizeof k->dims);
            *ndims = k->ndims;
            return true;
        }
    asks.session = a->s;
    asks.opt = (SltOptions)SLT_OPTIONS_INIT;
    if (!api_probe_asset(&asks, path, of, dims, ndims, why)) return false;
    if (!there) return true;
    Asset *found = ARENA_NEW(&a->s->session, Asset);
    *found = (Asset){.path = arena_strndup(&a->s->session, path, strlen(path)),
                     .size = st.st_size,
                     .seconds = st.st_mtim.tv_sec,
                     .nanoseconds = st.st_mtim.tv_nsec,
                     .kind = kind,
                     .ndims = *ndims,
                     .next = a->probed};
    memcpy(found->dims, dims, sizeof found->dims);
    a->probed = found;
    return true;
}

/* ---- the session */

static void hold_others(Analysis *a) {
    Session *s = a->s;
    uint32_t n = 0;
    for (const Document *d = a->server->documents; d; d = d->next) n++;
    HeldText *held = ARENA_ARRAY(&s->session, HeldText, n + 1);
    for (const Document *d = a->server->documents; d; d = d->next)
        if (d != a->document && d->is_file) held[s->nheld++] = (HeldText){d->path, d->text, d->len};
    s->held = held;
}

static const char *folder(Session *s, const Document *d) {
    const char *slash = d->is_file ? strrchr(d->path, '/') : NULL;
    if (!slash) return ".";
    return slash == d->path ? "/" : arena_strndup(&s->session, d->path, (size_t)(slash - d->path));
}

static void load(Analysis *a) {
    Session *s = a->s;
    const Cli *c = a->server->cli;
    const Document *d = a->document;
    s->stdlib_dir = api_stdlib(s, &c->opt);
    s->import_dirs = c->import_dirs, s->nimport_dirs = c->nimport_dirs;
    hold_others(a);
    a->file = session_add_text(s, d->path, folder(s, d), d->text, d->len);
    ConstOverride *overrides = ARENA_ARRAY(&s->session, ConstOverride, c->nsets + 1);
    for (uint32_t i = 0; i < c->nsets; i++) overrides[i] = (ConstOverride){c->sets[i].name, c->sets[i].value, false};
    FrontOptions *o = &a->options.front;
    *o = (FrontOptions){.overrides = overrides,
                        .noverrides = c->nsets,
                        .disc_auto = c->opt.disc_auto || d->glsl,
                        .probe = probe,
                        .probe_user = a,
                        .f64 = c->opt.f64,
                        .glsl = d->glsl};
    a->options.precision = c->opt.f64 ? PREC_F64 : PREC_F32;
    for (int k = 0; k < 2 && d->glsl; k++) s->sources[a->file].glsl[k] = GLSL_SIZE;
    Func *entry;
    a->main = front_check(s, a->file, o, &entry);
}

/* A file without a shader is a module, and one with several has several programs: both are well here. */
static bool is_said(const Diag *d) { return d->code != DIAG_no_entry && d->code != DIAG_several_entries; }

static bool any_error(const Session *s) {
    for (const Diag *d = s->diags; d; d = d->next)
        if (d->severity == SEV_ERROR && is_said(d)) return true;
    return false;
}

Program *analyse_program(Analysis *a, Func *shader) {
    if (a->has_errors || !shader->dim || !shader->body) return NULL;
    return gen_program(a->s, a->main, shader, &a->options);
}

/* ---- diagnostics */

void put_range(const Analysis *a, const char *key, Span span) {
    SpanEnds e[2];
    span_ends(a->s, span, a->server->utf8, e);
    fprintf(a->out, "\"%s\":{\"start\":{\"line\":%u,\"character\":%u},\"end\":{\"line\":%u,\"character\":%u}}", key,
            e[0].line, e[0].character, e[1].line, e[1].character);
}

static const char *uri_of(const Analysis *a, int32_t file) {
    if (file < 0 || file == a->file) return a->document->uri;
    char *full = realpath(a->s->sources[file].path, NULL);
    const char *path = full ? full : a->s->sources[file].path, *uri = NULL;
    for (const Document *d = a->server->documents; d && !uri; d = d->next)
        if (!strcmp(d->path, path)) uri = d->uri;
    char *made = uri ? NULL : cli_need(document_uri(path));
    if (made) uri = arena_strndup(&a->s->session, made, strlen(made));
    free(full);
    free(made);
    return uri;
}

void put_location(const Analysis *a, Span span) {
    fputs("\"uri\":", a->out);
    json_text(a->out, uri_of(a, span.file));
    fputc(',', a->out);
    put_range(a, "range", span);
}

static void put_diag(const Analysis *a, const Diag *d) {
    static const int severities[] = {1, 2, 3, 3};
    Span at = d->span.file >= 0 ? d->span : (Span){a->file, 0, 0};
    fputc('{', a->out);
    put_range(a, "range", at);
    fprintf(a->out, ",\"severity\":%d,\"code\":\"%s\",\"source\":\"saltus\",\"message\":", severities[d->severity],
            diag_code_name(d->code));
    json_text(a->out, d->text);
    for (const DiagNote *n = d->notes; n; n = n->next) {
        fputs(n == d->notes ? ",\"relatedInformation\":[{\"location\":{" : ",{\"location\":{", a->out);
        put_location(a, n->span.file >= 0 ? n->span : at);
        fputs("},\"message\":", a->out);
        json_text(a->out, n->text);
        fputs(n->next ? "}" : "}]", a->out);
    }
    fputc('}', a->out);
}

enum { MOST_TOLD = 1000 }; /* of one file */

static void put_file(const Analysis *a, int32_t file) {
    uint32_t n = 0;
    fputs("{\"uri\":", a->out);
    json_text(a->out, uri_of(a, file));
    fputs(",\"diagnostics\":[", a->out);
    for (const Diag *d = a->s->diags; d && n < MOST_TOLD; d = d->next) {
        if (!is_said(d) || (d->span.file < 0 ? a->file : d->span.file) != file) continue;
        if (n++) fputc(',', a->out);
        put_diag(a, d);
    }
    fputs("]}", a->out);
}

static bool speaks_of(const Analysis *a, int32_t file) {
    for (const Diag *d = a->s->diags; d; d = d->next)
        if (is_said(d) && d->span.file == file) return true;
    return false;
}

static void put_step(const Analysis *a, bool last) {
    fputs("{\"files\":[", a->out);
    put_file(a, a->file);
    for (uint32_t f = 0; f < a->s->nsources; f++) {
        if ((int32_t)f == a->file || !speaks_of(a, (int32_t)f)) continue;
        fputc(',', a->out);
        put_file(a, (int32_t)f);
    }
    fputs("],\"imports\":[", a->out);
    for (uint32_t f = 0, n = 0; f < a->s->nsources; f++) {
        if ((int32_t)f == a->file) continue;
        char *full = realpath(a->s->sources[f].path, NULL);
        if (n++) fputc(',', a->out);
        json_text(a->out, full ? full : a->s->sources[f].path);
        free(full);
    }
    fputs("],\"assets\":[", a->out);
    for (const Asset *k = a->probed; k; k = k->next) {
        fputs("{\"path\":", a->out);
        json_text(a->out, k->path);
        fprintf(a->out,
                ",\"size\":%lld,\"seconds\":%lld,\"nanoseconds\":%lld,\"kind\":%d,\"n\":%u,\"dims\":[%u,%u,%u,%u]}%s",
                (long long)k->size, (long long)k->seconds, (long long)k->nanoseconds, k->kind, k->ndims, k->dims[0],
                k->dims[1], k->dims[2], k->dims[3], k->next ? "," : "");
    }
    fprintf(a->out, "],\"last\":%s}\n", last ? "true" : "false");
    fflush(a->out);
}

/* Warnings of every shader of the file. */
static void warn(Analysis *a) {
    for (Func *f = a->main->funcs; f; f = f->next) {
        Program *p = f->is_shader ? analyse_program(a, f) : NULL;
        PassCtx ctx = {.session = a->s, .program = p, .has_fma = true};
        if (p) pipeline_warn(&ctx, p->primal);
    }
}

static void check_body(Session *s, void *arg) {
    Analysis *a = arg;
    load(a);
    a->has_errors = any_error(s);
    if (!a->has_errors) {
        if (!a->document->glsl) put_step(a, false); /* messages in GLSL's words are made once, at the end */
        warn(a);
    }
    if (a->document->glsl) glsl_speak(s);
    put_step(a, true);
}

void analyse_check(const Server *server, const Document *d, FILE *out) {
    Analysis a = {.server = server, .document = d, .out = out, .s = cli_need(session_create(LSP_MEMORY))};
    int status = session_protect(a.s, check_body, &a);
    if (status == SLT_INTERNAL) _exit(SLT_INTERNAL);
    if (!status) return;
    fputs("{\"files\":[{\"uri\":", out);
    json_text(out, d->uri);
    fputs(",\"diagnostics\":[{\"range\":{\"start\":{\"line\":0,\"character\":0},\"end\":{\"line\":0,\"character\":0}},"
          "\"severity\":1,\"code\":\"limit\",\"source\":\"saltus\",\"message\":",
          out);
    json_text(out, a.s->unwind_text);
    fputs("}]}],\"last\":true}\n", out);
}

/* ---- requests */

typedef struct Call {
    Analysis *a;
    Request *run;
    uint32_t offset;
    json_t *params;
} Call;

static void request_body(Session *s, void *arg) {
    Call *c = arg;
    load(c->a);
    c->a->has_errors = any_error(s);
    c->run(c->a, c->offset, c->params);
}

void analyse_request(const Server *server, const Document *d, Request *run, uint32_t offset, json_t *params,
                     FILE *out) {
    Text result;
    Analysis a = {.server = server, .document = d, .s = cli_need(session_create(LSP_MEMORY))};
    a.out = cli_need(text_open(&result));
    Call c = {&a, run, offset, params};
    int status = session_protect(a.s, request_body, &c);
    char *text = cli_need(text_close(&result));
    if (status == SLT_INTERNAL) _exit(SLT_INTERNAL);
    if (status) fputs("null", out);
    else fwrite(text, 1, result.size, out);
    free(text);
}
