/* The viewer's threads, and what they tell each other. */
#include "cli/view/viewer.h"

#include <math.h>
#include <signal.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "runtime/base/text.h"

#define TELL_SECONDS 0.03

void viewer_wake(Viewer *v) {
    ssize_t ignored = write(v->wake, "", 1); /* a full pipe wakes too */
    (void)ignored;
}

static void interrupt(Viewer *v, int flag) { __atomic_store_n(&v->cancel, flag, __ATOMIC_RELAXED); }

/* ---- asks and replies */
void viewer_free_ask(Ask *ask) {
    if (ask) blob_drop(ask->body);
    free(ask);
}

bool viewer_ask(Viewer *v, Ask *ask) {
    pthread_mutex_lock(&v->lock);
    bool room = v->asks < VIEW_ASKS;
    if (room) {
        ask->next = NULL;
        *v->last = ask, v->last = &ask->next, v->asks++;
        pthread_cond_signal(&v->compute);
    }
    pthread_mutex_unlock(&v->lock);
    if (!room) viewer_free_ask(ask);
    return room;
}

Reply *viewer_reply(Viewer *v) {
    pthread_mutex_lock(&v->lock);
    Reply *r = v->replies;
    if (r) v->replies = r->next;
    if (!v->replies) v->replies_end = &v->replies;
    pthread_mutex_unlock(&v->lock);
    return r;
}

void viewer_answer(Viewer *v, const Ask *ask, int status, const char *type, const char *headers, Blob *body) {
    Reply *r = cli_need(calloc(1, sizeof *r));
    *r = (Reply){.id = ask->id, .status = status, .type = type, .body = body};
    if (headers) snprintf(r->headers, sizeof r->headers, "%s", headers);
    pthread_mutex_lock(&v->lock);
    *v->replies_end = r, v->replies_end = &r->next;
    pthread_mutex_unlock(&v->lock);
    viewer_wake(v);
}

void viewer_refuse(Viewer *v, const Ask *ask, int status, const char *fmt, ...) {
    char text[2048];
    va_list ap;
    va_start(ap, fmt);
    vsnprintf(text, sizeof text, fmt, ap);
    va_end(ap);
    Text made;
    FILE *out = cli_need(text_open(&made));
    fputs("{\"error\": ", out);
    json_text(out, text);
    fputs("}\n", out);
    char *json = text_close(&made);
    viewer_answer(v, ask, status, "application/json", NULL, json ? blob_copy(json, made.size) : NULL);
    free(json);
}

/* ---- what is told */
void viewer_changed(Viewer *v) {
    double now = cli_now();
    if (!v->shown || v->told == v->version || (v->fitting && now < v->next_told)) return;
    v->next_told = now + TELL_SECONDS; /* iterations are faster than eyes */
    Blob *values = shown_values(v->shown);
    pthread_mutex_lock(&v->lock);
    blob_drop(v->values);
    v->values = values, v->told = v->version;
    pthread_mutex_unlock(&v->lock);
    viewer_wake(v);
}

static void put_blob(FILE *out, const Blob *b, const char *none) {
    if (b) fwrite(b->data, 1, b->size, out);
    else fputs(none, out);
}

static Blob *close_blob(Text *t) {
    char *text = text_close(t);
    Blob *b = text ? blob_copy(text, t->size) : NULL;
    free(text);
    return b;
}

/* The losses from `first` on; under the lock. */
static void put_fit(FILE *out, const Viewer *v, uint64_t first) {
    fprintf(out, "{\"running\": %s, \"iterations\": %u, \"done\": %u, \"first\": %llu, \"losses\": [",
            v->fit.running ? "true" : "false", v->fit.iterations, v->fit.done, (unsigned long long)first);
    for (uint64_t i = first; i < v->fit.done; i++) {
        if (i > first) json_comma(out);
        if (isfinite(v->fit.losses[i])) json_number(out, v->fit.losses[i]);
        else fputs("null", out);
    }
    fputs("], \"best\": ", out);
    if (v->fit.done && isfinite(v->fit.best)) json_number(out, v->fit.best);
    else fputs("null", out);
    fputs(", \"reason\": ", out);
    json_text(out, v->fit.reason);
    fputs("}", out);
}

Blob *viewer_state(Viewer *v) {
    Text made;
    FILE *out = text_open(&made);
    if (!out) return NULL;
    fputs("{\"file\": ", out);
    json_text(out, v->name);
    pthread_mutex_lock(&v->lock);
    fprintf(out, ", \"status\": \"%s\", \"generation\": %u, \"version\": %llu, \"message\": ", v->status, v->generation,
            (unsigned long long)v->told);
    json_text(out, v->message ? (const char *)v->message->data : "");
    fprintf(out, ", \"size\": [%u, %u, %u], \"spp\": %u, \"slice\": %u, \"target\": %s, \"program\": ", v->size[0],
            v->size[1], v->size[2], v->spp, v->slice, v->has_target ? "true" : "false");
    put_blob(out, v->program, "null");
    fputs(", \"values\": ", out);
    put_blob(out, v->values, "{}");
    fputs(", \"fit\": ", out);
    put_fit(out, v, 0);
    pthread_mutex_unlock(&v->lock);
    fputs("}\n", out);
    return close_blob(&made);
}

Blob *viewer_tell(Viewer *v, uint64_t place[4]) {
    Text made;
    FILE *out = text_open(&made);
    if (!out) return NULL;
    pthread_mutex_lock(&v->lock);
    if (v->serial != place[0])
        fprintf(out, "event: program\ndata: {\"status\": \"%s\", \"generation\": %u}\n\n", v->status, v->generation);
    if (v->told != place[1]) {
        fprintf(out, "event: values\ndata: {\"version\": %llu, \"values\": ", (unsigned long long)v->told);
        put_blob(out, v->values, "{}");
        fputs("}\n\n", out);
    }
    if (v->fit.serial != place[2] || v->fit.done != place[3]) {
        fputs("event: fit\ndata: ", out);
        put_fit(out, v, v->fit.serial != place[2] ? 0 : place[3]);
        fputs("\n\n", out);
    }
    const uint64_t now[4] = {v->serial, v->told, v->fit.serial, v->fit.done};
    pthread_mutex_unlock(&v->lock);
    memcpy(place, now, sizeof now);
    Blob *b = close_blob(&made);
    if (b && !b->size) blob_drop(b), b = NULL;
    return b;
}

char *viewer_files(Viewer *v, uint64_t *seen, bool *failed) {
    char *files = NULL;
    pthread_mutex_lock(&v->lock);
    *failed = !strcmp(v->status, "error");
    if (v->serial != *seen && v->files) files = cli_need(strdup(v->files));
    *seen = v->serial;
    pthread_mutex_unlock(&v->lock);
    return files;
}

/* ---- the compiling thread */
static void set_message(Viewer *v, const char *text) {
    blob_drop(v->message);
    v->message = blob_copy(text, strlen(text));
}

/* Files are watched as before where a source with errors does not name them all. */
static void publish(Viewer *v, Shown *s, int status, char *text) {
    pthread_mutex_lock(&v->lock);
    set_message(v, text);
    if (status == SLT_OK || !v->files) {
        free(v->files);
        v->files = s && s->files ? cli_need(strdup(s->files)) : NULL;
    }
    if (status == SLT_OK) {
        shown_free(v->fresh); /* nobody has seen it */
        v->fresh = s, s = NULL;
        interrupt(v, 1); /* what is computed is of the old one */
        pthread_cond_signal(&v->compute);
    } else {
        v->status = "error";
        v->serial++;
    }
    pthread_mutex_unlock(&v->lock);
    shown_free(s);
    free(text);
    viewer_wake(v);
}

static void *compile(void *user) {
    Viewer *v = user;
    pthread_mutex_lock(&v->lock);
    while (!v->over) {
        if (!v->stale) {
            pthread_cond_wait(&v->compile, &v->lock);
            continue;
        }
        char overlay[sizeof v->overlay];
        memcpy(overlay, v->overlay, sizeof overlay);
        v->stale = false, v->status = "compiling", v->serial++;
        pthread_mutex_unlock(&v->lock);
        viewer_wake(v);
        Shown *s;
        char *text;
        int status = shown_compile(v, &s, &text);
        if (status == SLT_OK) shown_warm(s, overlay);
        publish(v, s, status, text);
        pthread_mutex_lock(&v->lock);
    }
    pthread_mutex_unlock(&v->lock);
    return NULL;
}

void viewer_compile(Viewer *v) {
    pthread_mutex_lock(&v->lock);
    v->stale = true;
    pthread_cond_signal(&v->compile);
    pthread_mutex_unlock(&v->lock);
}

/* ---- the computing thread */
static void show(Viewer *v, Shown *fresh) {
    if (v->fitting) fit_end(v, "the program was compiled anew");
    if (v->shown) shown_carry(v->shown, fresh);
    shown_free(v->shown);
    v->shown = fresh;
    SltError ignored;
    shown_sync(fresh, &ignored);
    Blob *values = shown_values(fresh);
    pthread_mutex_lock(&v->lock);
    blob_drop(v->values), blob_drop(v->program);
    v->told = ++v->version;
    v->values = values, v->program = blob_keep(fresh->text);
    memcpy(v->size, fresh->job.size, sizeof v->size);
    if (v->generation == 0) v->slice = v->size[2] / 2;
    if (v->slice >= v->size[2]) v->slice = v->size[2] - 1;
    v->status = v->stale ? "compiling" : "ready";
    v->generation++, v->serial++;
    pthread_mutex_unlock(&v->lock);
    viewer_wake(v);
}

/* What was interrupted, as there is a new program or a fit is to stop. Its values are set. */
static void ask_again(Viewer *v, Ask *ask) {
    blob_drop(ask->body);
    ask->body = NULL;
    pthread_mutex_lock(&v->lock);
    ask->next = v->first;
    if (!v->first) v->last = &ask->next;
    v->first = ask, v->asks++;
    pthread_mutex_unlock(&v->lock);
}

/* What asks for values or an image is answered when all such asks that wait have set theirs: the last wins, and no
 * image is made that is old already. */
static void answer_all(Viewer *v, Ask *list) {
    for (Ask *a = list; a; a = a->next)
        if (a->kind <= ASK_IMAGE && !answer_set(v, a)) a->id = 0; /* refused, and answered */
    viewer_changed(v);                                            /* whoever is answered finds the new values */
    while (list) {
        Ask *next = list->next;
        if (!list->id || answer_ask(v, list)) viewer_free_ask(list);
        else ask_again(v, list);
        list = next;
    }
}

static void *compute(void *user) {
    Viewer *v = user;
    pthread_mutex_lock(&v->lock);
    while (!v->over) {
        if (!v->first && !v->fresh && !v->fitting) {
            pthread_cond_wait(&v->compute, &v->lock);
            continue;
        }
        Shown *fresh = v->fresh;
        Ask *list = v->first;
        v->fresh = NULL, v->first = NULL, v->last = &v->first, v->asks = 0;
        bool stop = v->stop_fit;
        v->stop_fit = false;
        interrupt(v, 0); /* who interrupts from now on means what follows */
        pthread_mutex_unlock(&v->lock);
        if (fresh) show(v, fresh);
        if (v->fitting && stop) fit_end(v, "stopped");
        answer_all(v, list);
        if (v->fitting) fit_step(v);
        viewer_changed(v);
        pthread_mutex_lock(&v->lock);
    }
    pthread_mutex_unlock(&v->lock);
    if (v->fitting) fit_end(v, "the viewer ended");
    return NULL;
}

void viewer_stop_fit(Viewer *v) {
    pthread_mutex_lock(&v->lock);
    if (v->fit.running) {
        v->stop_fit = true;
        interrupt(v, 1);
    }
    pthread_mutex_unlock(&v->lock);
}

/* ---- beginning and end */
static bool start_threads(Viewer *v) {
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_BLOCK, &all, &before); /* signals are the verb's thread's */
    v->compiler_runs = pthread_create(&v->compiler, NULL, compile, v) == 0;
    v->computer_runs = v->compiler_runs && pthread_create(&v->computer, NULL, compute, v) == 0;
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return v->computer_runs;
}

int viewer_start(Viewer *v, Cli *c, int wake) {
    SltError err = {0};
    Shown *s;
    char *text;
    *v = (Viewer){.c = c,
                  .name = c->expr ? c->expr : c->file,
                  .wake = wake,
                  .status = "compiling",
                  .serial = 1,
                  .version = 1,
                  .size = {VIEW_SIDE, VIEW_SIDE, 1},
                  .spp = c->job.spp};
    v->last = &v->first, v->replies_end = &v->replies;
    pthread_mutex_init(&v->lock, NULL);
    pthread_cond_init(&v->compile, NULL);
    pthread_cond_init(&v->compute, NULL);
    int status = shown_compile(v, &s, &text);
    bool waits = status == SLT_PROGRAM && !c->expr; /* for the source to be mended */
    if (status != SLT_OK && !waits) {
        shown_free(s);
        free(text);
        return status;
    }
    bool display = slt_is_display(s->p);
    publish(v, s, status, text);
    if (c->target && fit_open_target(v, c->target, display, &err) != SLT_OK) return cli_fail(c, &err);
    if (v->fresh) {
        show(v, v->fresh);
        v->fresh = NULL;
    }
    return start_threads(v) ? SLT_OK : cli_error(SLT_LIMIT, "no threads could be had");
}

void viewer_end(Viewer *v) {
    pthread_mutex_lock(&v->lock);
    v->over = true;
    interrupt(v, 1);
    pthread_cond_signal(&v->compile);
    pthread_cond_signal(&v->compute);
    pthread_mutex_unlock(&v->lock);
    if (v->compiler_runs) pthread_join(v->compiler, NULL);
    if (v->computer_runs) pthread_join(v->computer, NULL);
    for (Reply *r; (r = viewer_reply(v)); free(r)) blob_drop(r->body);
    while (v->first) {
        Ask *next = v->first->next;
        viewer_free_ask(v->first);
        v->first = next;
    }
    shown_free(v->fresh);
    shown_free(v->shown);
    image_free(&v->target);
    blob_drop(v->program), blob_drop(v->message), blob_drop(v->values), blob_drop(v->image.body);
    free(v->files);
    free(v->fit.losses);
    pthread_cond_destroy(&v->compute);
    pthread_cond_destroy(&v->compile);
    pthread_mutex_destroy(&v->lock);
}
