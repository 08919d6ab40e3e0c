#include "cli/view/serve.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "view_page.h" /* made of page.html, page.css and page.js */

static const char as_json[] = "application/json";

static void refuse(Served *s, const HttpRequest *q, int status, const char *why) {
    char text[256];
    int n = snprintf(text, sizeof text, "{\"error\": \"%s\"}\n", why);
    http_answer(s->http, q->id, status, as_json, NULL, blob_copy(text, (size_t)n));
}

/* ---- the page */
typedef struct Part {
    const char *path, *type;
    const unsigned char *data;
    size_t size;
} Part;
static const Part parts[] = {{"/", "text/html; charset=utf-8", page_html, sizeof page_html},
                             {"/page.css", "text/css; charset=utf-8", page_css, sizeof page_css},
                             {"/page.js", "text/javascript; charset=utf-8", page_js, sizeof page_js}};

static bool serve_part(Served *s, const HttpRequest *q) {
    static const char policy[] =
        "Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; connect-src 'self'; "
        "img-src 'self' blob: data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n";
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++) {
        if (q->post || strcmp(q->path, parts[i].path) != 0) continue;
        http_answer(s->http, q->id, 200, parts[i].type, policy, blob_copy(parts[i].data, parts[i].size));
        return true;
    }
    return false;
}

/* ---- what the verb's thread knows */
static void serve_state(Served *s, const HttpRequest *q) {
    http_answer(s->http, q->id, 200, as_json, NULL, viewer_state(s->viewer));
}
static void serve_events(Served *s, const HttpRequest *q) {
    http_stream(s->http, q->id);
    s->untold = true;
}
static void accepted(Served *s, const HttpRequest *q) {
    http_answer(s->http, q->id, 202, as_json, NULL, blob_copy("{}\n", 3));
}
static void serve_stop(Served *s, const HttpRequest *q) {
    viewer_stop_fit(s->viewer);
    accepted(s, q);
}
static void serve_compile(Served *s, const HttpRequest *q) {
    viewer_compile(s->viewer);
    accepted(s, q);
}
static void serve_quit(Served *s, const HttpRequest *q) {
    s->over = true;
    accepted(s, q);
}

/* ---- what the computing thread answers: the query says what of */
static bool read_number(const char *text, double lo, double hi, double *out) {
    char *end;
    *out = strtod(text, &end);
    return end != text && !*end && *out >= lo && *out <= hi;
}

static bool read_point(const char *text, Ask *ask) {
    for (ask->nx = 0; ask->nx < 3;) {
        char *end;
        double x = strtod(text, &end);
        if (end == text || !isfinite(x)) return false;
        ask->x[ask->nx++] = x;
        if (!*end) return true;
        if (*end != ',') return false;
        text = end + 1;
    }
    return false;
}

/* Why the query is not understood; NULL: it is. */
static const char *read_query(const HttpRequest *q, Ask *ask) {
    static const char formats[] = "rgba|png|f32";
    char text[256];
    double number;
    int format = 0;
    if (http_query(q->query, "format", text, sizeof text) && (format = cli_choice(formats, text)) < 0)
        return "format is rgba, png or f32";
    ask->format = (ViewFormat)format, ask->scale = 1, ask->gain = 1;
    if (http_query(q->query, "scale", text, sizeof text)) {
        if (!read_number(text, 1, 64, &number)) return "scale is a number from 1 to 64";
        ask->scale = (uint32_t)number;
    }
    if (http_query(q->query, "gain", text, sizeof text) && !read_number(text, 1e-6, 1e9, &ask->gain))
        return "gain is a number above 0";
    bool named = http_query(q->query, ask->kind == ASK_TARGET ? "name" : "component", ask->name, sizeof ask->name);
    if (ask->kind == ASK_GRADIENT && !named) return "component=NAME is wanted: a parameter, or one number of it";
    if (ask->kind == ASK_TARGET && !named) snprintf(ask->name, sizeof ask->name, "target.png");
    ask->draft = http_query(q->query, "draft", text, sizeof text) && !strcmp(text, "1");
    ask->current = http_query(q->query, "current", text, sizeof text) && !strcmp(text, "1");
    if (ask->kind == ASK_POINT && !(http_query(q->query, "at", text, sizeof text) && read_point(text, ask)))
        return "at=X,Y is wanted";
    return NULL;
}

static void ask(Served *s, const HttpRequest *q, AskKind kind) {
    Ask *a = cli_need(calloc(1, sizeof *a));
    *a = (Ask){.kind = kind, .id = q->id, .body = q->size ? cli_need(blob_copy(q->body, q->size)) : NULL};
    const char *wrong = read_query(q, a);
    if (wrong) {
        viewer_free_ask(a);
        refuse(s, q, 422, wrong);
    } else if (!viewer_ask(s->viewer, a)) {
        refuse(s, q, 503, "too many requests wait");
    }
}

/* ---- routes */
typedef struct Route {
    const char *path;
    bool get, post;
    void (*serve)(Served *s, const HttpRequest *q); /* NULL: an Ask */
    AskKind kind, posted;                           /* of GET, of POST */
} Route;
static const Route routes[] = {
    {.path = "/state", .get = true, .serve = serve_state},
    {.path = "/events", .get = true, .serve = serve_events},
    {.path = "/image", .get = true, .post = true, .kind = ASK_IMAGE, .posted = ASK_IMAGE},
    {.path = "/gradient", .get = true, .kind = ASK_GRADIENT},
    {.path = "/cells", .get = true, .kind = ASK_CELLS},
    {.path = "/point", .get = true, .kind = ASK_POINT},
    {.path = "/params", .get = true, .post = true, .kind = ASK_PARAMS, .posted = ASK_SET},
    {.path = "/target", .get = true, .post = true, .kind = ASK_SHOW_TARGET, .posted = ASK_TARGET},
    {.path = "/fit", .post = true, .posted = ASK_FIT},
    {.path = "/fit/stop", .post = true, .serve = serve_stop},
    {.path = "/compile", .post = true, .serve = serve_compile},
    {.path = "/quit", .post = true, .serve = serve_quit},
};

void serve_request(void *user, const HttpRequest *q) {
    Served *s = user;
    if (serve_part(s, q)) return;
    for (size_t i = 0; i < sizeof routes / sizeof *routes; i++) {
        const Route *r = &routes[i];
        if (strcmp(r->path, q->path) != 0) continue;
        if (!q->trusted) refuse(s, q, 403, "the token is missing or wrong: it stands in the address");
        else if (q->post ? !r->post : !r->get) refuse(s, q, 405, q->post ? "this is for GET" : "this is for POST");
        else if (r->serve) r->serve(s, q);
        else ask(s, q, q->post ? r->posted : r->kind);
        return;
    }
    refuse(s, q, 404, "there is nothing of this name");
}

Blob *serve_tell(void *user, uint64_t place[4]) { return viewer_tell(((Served *)user)->viewer, place); }

void serve_replies(Served *s) {
    for (Reply *r; (r = viewer_reply(s->viewer)); free(r))
        http_answer(s->http, r->id, r->status, r->type, r->headers, r->body);
}
