/* Connections: reading requests under limits, writing answers. */
#include "cli/view/http.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/socket.h>
#include <unistd.h>

#include "cli/cli.h"

enum { CONNECTIONS = 64, HEAD = 16 << 10, HEADER_LINES = 100, READ = 64 << 10 };
/* Seconds: for the head of a request, for its body, for a client that reads nothing, for one that asks nothing more,
 * and between signs of life of a stream. */
#define HEAD_SECONDS 10
#define BODY_SECONDS 60
#define WRITE_SECONDS 30
#define IDLE_SECONDS 75
#define ALIVE_SECONDS 15

typedef enum State { FREE, READING, WAITING, WRITING, STREAMING } State;

typedef struct Connection {
    State state;
    int fd;
    uint64_t id;     /* of the request at hand */
    double deadline; /* when it is closed, whatever is under way */
    char *in;        /* [capacity]: of the request, and what follows it */
    size_t got, capacity;
    size_t head, body; /* lengths, once the head is whole */
    bool close;        /* after the answer */
    bool sleeps;       /* nothing of a request has come yet */
    char lead[1024];   /* the head of the answer */
    size_t lead_size, sent;
    Blob *out;
    uint64_t place[4];
    double told; /* when the stream last said something */
} Connection;

struct Http {
    int fd;
    uint32_t port;
    char token[HTTP_TOKEN + 1];
    HttpHandler *handle;
    HttpTeller *tell;
    void *user;
    uint64_t next_id;
    double pause; /* no connection is taken before */
    Connection all[CONNECTIONS];
};

/* ---- blobs */
Blob *blob_new(size_t size) {
    Blob *b = malloc(sizeof *b + size + 1);
    if (!b) return NULL;
    atomic_init(&b->refs, 1);
    b->size = size;
    b->data[size] = 0;
    return b;
}

Blob *blob_copy(const void *data, size_t size) {
    Blob *b = blob_new(size);
    if (b && size) memcpy(b->data, data, size);
    return b;
}

Blob *blob_keep(Blob *b) {
    if (b) atomic_fetch_add(&b->refs, 1);
    return b;
}

void blob_drop(Blob *b) {
    if (b && atomic_fetch_sub(&b->refs, 1) == 1) free(b);
}

/* ---- text */
static int hex(char c) {
    return c >= '0' && c <= '9'   ? c - '0'
           : c >= 'a' && c <= 'f' ? c - 'a' + 10
           : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                  : -1;
}

bool http_query(const char *query, const char *key, char *value, size_t size) {
    size_t n = strlen(key);
    while (*query) {
        size_t len = strcspn(query, "&");
        if (len > n && !strncmp(query, key, n) && query[n] == '=') {
            const char *s = query + n + 1, *end = query + len;
            size_t at = 0;
            while (s < end && at + 1 < size) {
                bool escaped = *s == '%' && end - s > 2 && hex(s[1]) >= 0 && hex(s[2]) >= 0;
                value[at] = escaped ? (char)(hex(s[1]) * 16 + hex(s[2])) : *s == '+' ? ' ' : *s;
                if (!value[at++]) return false;
                s += escaped ? 3 : 1;
            }
            value[at] = 0;
            return s == end;
        }
        query += len;
        if (*query) query++;
    }
    return false;
}

static bool is_token(const Http *h, const char *text) {
    unsigned differs = strlen(text) != HTTP_TOKEN;
    for (size_t i = 0; !differs && i < HTTP_TOKEN; i++) differs |= (unsigned char)(text[i] ^ h->token[i]);
    return !differs;
}

/* A name of this machine for itself, with any port: the far end of a tunnel may have another. */
static bool is_loopback(const char *host) {
    static const char *const names[] = {"127.0.0.1", "localhost", "[::1]"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        size_t n = strlen(names[i]);
        if (strncasecmp(host, names[i], n) != 0) continue;
        if (!host[n]) return true;
        if (host[n] == ':' && strspn(host + n + 1, "0123456789") == strlen(host + n + 1)) return true;
    }
    return false;
}

/* ---- answers */
static void drop(Connection *c) {
    if (c->fd >= 0) close(c->fd);
    free(c->in);
    blob_drop(c->out);
    *c = (Connection){.fd = -1};
}

static const char *reason(int status) {
    switch (status) {
    case 200: return "OK";
    case 202: return "Accepted";
    case 400: return "Bad Request";
    case 403: return "Forbidden";
    case 404: return "Not Found";
    case 405: return "Method Not Allowed";
    case 409: return "Conflict";
    case 411: return "Length Required";
    case 413: return "Content Too Large";
    case 422: return "Unprocessable Content";
    case 431: return "Request Header Fields Too Large";
    case 501: return "Not Implemented";
    case 503: return "Service Unavailable";
    default: return "Internal Server Error";
    }
}

static bool write_more(Connection *c) {
    while (c->sent < c->lead_size + (c->out ? c->out->size : 0)) {
        bool lead = c->sent < c->lead_size;
        const void *from =
            lead ? (const void *)(c->lead + c->sent) : (const void *)(c->out->data + c->sent - c->lead_size);
        size_t n = lead ? c->lead_size - c->sent : c->lead_size + c->out->size - c->sent;
        ssize_t wrote = send(c->fd, from, n, MSG_NOSIGNAL | (lead && c->out && c->out->size ? MSG_MORE : 0));
        if (wrote < 0 && errno == EINTR) continue;
        if (wrote < 0) return errno == EAGAIN || errno == EWOULDBLOCK;
        c->sent += (size_t)wrote;
        c->deadline = cli_now() + WRITE_SECONDS;
    }
    blob_drop(c->out);
    c->out = NULL;
    c->lead_size = c->sent = 0;
    return true;
}

static bool unsent(const Connection *c) { return c->sent < c->lead_size + (c->out ? c->out->size : 0); }

static void start_reading(Connection *c) {
    size_t used = c->head + c->body;
    if (used && c->in) memmove(c->in, c->in + used, c->got - used);
    c->got -= used;
    if (!c->got) { /* a large body's memory is not kept */
        free(c->in);
        c->in = NULL, c->capacity = 0;
    }
    c->head = c->body = 0;
    c->state = READING;
    c->sleeps = c->got == 0;
    c->deadline = cli_now() + (c->sleeps ? IDLE_SECONDS : HEAD_SECONDS);
}

static void put_lead(Connection *c, int status, const char *type, const char *headers, size_t size, bool streams) {
    char length[64] = "";
    if (!streams) snprintf(length, sizeof length, "Content-Length: %zu\r\n", size);
    int n = snprintf(
        c->lead, sizeof c->lead,
        "HTTP/1.1 %d %s\r\nContent-Type: %s\r\n%sCache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\n"
        "Referrer-Policy: no-referrer\r\nCross-Origin-Resource-Policy: same-origin\r\n%s%s\r\n",
        status, reason(status), type, length, headers ? headers : "", c->close ? "Connection: close\r\n" : "");
    c->lead_size = (size_t)n < sizeof c->lead ? (size_t)n : sizeof c->lead - 1;
    c->sent = 0;
}

static void answer(Connection *c, int status, const char *type, const char *headers, Blob *body) {
    put_lead(c, body ? status : 500, type, headers, body ? body->size : 0, false);
    c->out = body;
    c->state = WRITING;
    c->deadline = cli_now() + WRITE_SECONDS;
    if (!write_more(c)) drop(c);
}

/* A request that is not served: the connection is not to be trusted with another. */
static void refuse(Connection *c, int status, const char *why) {
    char text[256];
    c->close = true;
    int n = snprintf(text, sizeof text, "{\"error\": \"%s\"}\n", why);
    answer(c, status, "application/json", NULL, blob_copy(text, (size_t)n));
}

static Connection *find(Http *h, uint64_t id) {
    for (int i = 0; i < CONNECTIONS; i++)
        if (h->all[i].state == WAITING && h->all[i].id == id) return &h->all[i];
    return NULL;
}

void http_answer(Http *h, uint64_t id, int status, const char *type, const char *headers, Blob *body) {
    Connection *c = find(h, id);
    if (c) answer(c, status, type, headers, body);
    else blob_drop(body);
}

void http_stream(Http *h, uint64_t id) {
    Connection *c = find(h, id);
    if (!c) return;
    c->close = true; /* a stream ends with its connection */
    put_lead(c, 200, "text/event-stream", NULL, 0, true);
    c->state = STREAMING, c->told = cli_now(), c->deadline = c->told + WRITE_SECONDS;
    if (!write_more(c)) drop(c);
}

void http_tell(Http *h) {
    double now = cli_now();
    for (int i = 0; i < CONNECTIONS; i++) {
        Connection *c = &h->all[i];
        if (c->state != STREAMING || unsent(c)) continue;
        c->out = h->tell(h->user, c->place);
        if (!c->out && now - c->told > ALIVE_SECONDS) c->out = blob_copy(":\n\n", 3);
        if (!c->out) continue;
        c->told = now, c->deadline = now + WRITE_SECONDS;
        if (!write_more(c)) drop(c);
    }
}

/* ---- requests */
typedef struct Head {
    char *method, *target;
    const char *host, *origin, *token;
    uint32_t hosts, origins, lengths;
    size_t length;
    bool encoded, close, expects, old;
} Head;

static char *trim(char *s) {
    s += strspn(s, " \t");
    size_t n = strlen(s);
    while (n && (s[n - 1] == ' ' || s[n - 1] == '\t')) s[--n] = 0;
    return s;
}

static bool read_length(const char *text, size_t *out) {
    size_t n = strlen(text);
    if (!n || n > 12 || strspn(text, "0123456789") != n) return false;
    *out = (size_t)strtoull(text, NULL, 10);
    return true;
}

/* One header line; false: malformed. */
static bool read_header(Head *q, char *line) {
    char *colon = strchr(line, ':');
    if (!colon || colon == line || strcspn(line, " \t") < (size_t)(colon - line)) return false;
    *colon = 0;
    char *value = trim(colon + 1);
    if (!strcasecmp(line, "host")) q->host = value, q->hosts++;
    else if (!strcasecmp(line, "origin")) q->origin = value, q->origins++;
    else if (!strcasecmp(line, "x-saltus-token")) q->token = value;
    else if (!strcasecmp(line, "transfer-encoding")) q->encoded = true;
    else if (!strcasecmp(line, "expect")) q->expects = !strcasecmp(value, "100-continue");
    else if (!strcasecmp(line, "connection")) q->close |= !strcasecmp(value, "close");
    else if (!strcasecmp(line, "content-length")) return q->lengths++ == 0 && read_length(value, &q->length);
    return true;
}

/* Cuts the head into pieces, in place. Returns 0, or the status that refuses it. */
static int read_head(Head *q, char *text) {
    char *line = text, *end = strstr(text, "\r\n");
    *q = (Head){0};
    *end = 0;
    char *first = strchr(line, ' '), *second = first ? strchr(first + 1, ' ') : NULL;
    if (!second || first == line || strncmp(second + 1, "HTTP/1.", 7) != 0) return 400;
    if (strcmp(second + 8, "0") != 0 && strcmp(second + 8, "1") != 0) return 400;
    q->old = second[8] == '0';
    *first = *second = 0;
    q->method = line, q->target = first + 1;
    if (*q->target != '/') return 400;
    for (const char *s = q->target; *s; s++)
        if ((unsigned char)*s <= ' ' || *s == 127) return 400;
    for (uint32_t n = 0; (line = end + 2, end = strstr(line, "\r\n")) && end != line; n++) {
        *end = 0;
        if (n == HEADER_LINES) return 431;
        if (*line == ' ' || *line == '\t' || !read_header(q, line)) return 400;
    }
    return q->hosts == 1 && q->origins <= 1 ? 0 : 400;
}

static bool has_origin_of(const Head *q) {
    return !q->origin || (!strncmp(q->origin, "http://", 7) && !strcasecmp(q->origin + 7, q->host));
}

/* Whether the request may go on to its body, or to the handler. */
static bool admit(Connection *c, const Head *q, bool trusted) {
    bool post = !strcmp(q->method, "POST");
    if (!is_loopback(q->host)) return refuse(c, 403, "this Host is no name of the loopback"), false;
    if (!has_origin_of(q)) return refuse(c, 403, "pages of another origin may not ask"), false;
    if (!post && strcmp(q->method, "GET") != 0) return refuse(c, 405, "GET and POST are known"), false;
    if (post && !trusted) return refuse(c, 403, "the token is missing or wrong: it stands in the address"), false;
    if (q->encoded) return refuse(c, 501, "Transfer-Encoding is not known: send Content-Length"), false;
    if (post && !q->lengths) return refuse(c, 411, "Content-Length is missing"), false;
    if (!post && q->length) return refuse(c, 400, "GET has no body"), false;
    if (q->length > HTTP_LARGEST_BODY) return refuse(c, 413, "a body may have 32 MiB"), false;
    return true;
}

static bool reserve(Connection *c, size_t size) {
    if (size + 1 <= c->capacity) return true;
    char *grown = realloc(c->in, size + 1);
    if (!grown) return false;
    c->in = grown, c->capacity = size + 1;
    return true;
}

/* Goes on with what has come; false: more must come, or the connection is done with requests. */
static bool take_request(Http *h, Connection *c) {
    if (!c->head) {
        char *end = c->got ? memmem(c->in, c->got, "\r\n\r\n", 4) : NULL;
        if (!end && c->got >= HEAD) return refuse(c, 431, "the head of a request may have 16 KiB"), false;
        if (!end) return false;
        c->head = (size_t)(end - c->in) + 4;
        if (c->head > HEAD) return refuse(c, 431, "the head of a request may have 16 KiB"), false;
    }
    /* A copy is cut into pieces: the head is looked at again when the body is there. */
    char text[HEAD + 1], none[1] = "", token[HTTP_TOKEN + 2];
    memcpy(text, c->in, c->head);
    text[c->head] = 0;
    Head q;
    int wrong = strlen(text) == c->head ? read_head(&q, text) : 400;
    if (wrong)
        return refuse(c, wrong, wrong == 431 ? "too many headers" : "this is no request that is understood"), false;
    char *query = strchr(q.target, '?');
    if (query) *query++ = 0;
    if (!q.token && query && http_query(query, "token", token, sizeof token)) q.token = token;
    bool trusted = q.token && is_token(h, q.token);
    c->close = q.close || q.old;
    bool fresh = !c->body;
    if (fresh && !admit(c, &q, trusted)) return false;
    c->body = q.length;
    if (c->got < c->head + c->body) {
        if (!fresh) return false;
        c->deadline = cli_now() + BODY_SECONDS;
        if (!reserve(c, c->head + c->body)) return refuse(c, 503, "out of memory"), false;
        static const char go_on[] = "HTTP/1.1 100 Continue\r\n\r\n";
        if (q.expects && send(c->fd, go_on, sizeof go_on - 1, MSG_NOSIGNAL) < 0) drop(c);
        return false;
    }
    c->state = WAITING, c->id = ++h->next_id, c->deadline = 0;
    char after = c->in[c->head + c->body];
    c->in[c->head + c->body] = 0;
    HttpRequest request = {.id = c->id,
                           .post = *q.method == 'P',
                           .trusted = trusted,
                           .path = q.target,
                           .query = query ? query : none,
                           .body = c->in + c->head,
                           .size = c->body};
    h->handle(h->user, &request);
    if (c->in) c->in[c->head + c->body] = after;
    return true;
}

static void read_more(Connection *c) {
    size_t room = c->head ? c->head + c->body : HEAD;
    size_t want = c->got < room ? room : c->got;
    if (want > c->got + READ) want = c->got + READ; /* memory grows with what comes */
    if (want == c->got) return;                     /* the rest waits in the system */
    if (!reserve(c, want)) {
        drop(c);
        return;
    }
    ssize_t n = recv(c->fd, c->in + c->got, want - c->got, 0);
    if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR)) return;
    if (n <= 0) {
        drop(c);
        return;
    }
    if (c->sleeps) c->sleeps = false, c->deadline = cli_now() + HEAD_SECONDS;
    c->got += (size_t)n;
}

static void go_on(Http *h, Connection *c) {
    for (;;) {
        if (c->state == READING && (!c->got || !take_request(h, c))) {
            if (c->state == READING) return;
        }
        if (c->state != WRITING || unsent(c)) return;
        if (c->close) {
            /* What is still unread would make the system reset the connection under the answer. */
            char rest[4096];
            shutdown(c->fd, SHUT_WR);
            for (int i = 0; i < 64 && recv(c->fd, rest, sizeof rest, 0) > 0;) i++;
            drop(c);
            return;
        }
        start_reading(c);
        if (!c->got) return;
    }
}

/* ---- connections */
static void take_connection(Http *h) {
    int fd = accept4(h->fd, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK), on = 1;
    if (fd < 0) {
        if (errno == EMFILE || errno == ENFILE || errno == ENOMEM || errno == ENOBUFS) h->pause = cli_now() + 0.5;
        return;
    }
    Connection *place = NULL, *oldest = NULL;
    for (int i = 0; i < CONNECTIONS; i++) {
        Connection *c = &h->all[i];
        if (c->state == FREE && !place) place = c;
        if (c->state == READING && c->sleeps && (!oldest || c->deadline < oldest->deadline)) oldest = c;
    }
    if (!place && oldest) drop(oldest), place = oldest;
    if (!place) {
        static const char full[] = "HTTP/1.1 503 Service Unavailable\r\nContent-Length: 0\r\nConnection: close\r\n\r\n";
        ssize_t ignored = send(fd, full, sizeof full - 1, MSG_NOSIGNAL);
        (void)ignored;
        close(fd);
        return;
    }
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    *place = (Connection){.fd = fd, .state = READING, .sleeps = true, .deadline = cli_now() + HEAD_SECONDS};
}

uint32_t http_poll(Http *h, const int *fds, uint32_t n, int milliseconds) {
    struct pollfd p[CONNECTIONS + 1 + HTTP_WATCHED];
    double now = cli_now(), next = now + 1e-3 * milliseconds;
    uint32_t ready = 0;
    for (int i = 0; i < CONNECTIONS; i++) {
        Connection *c = &h->all[i];
        if (c->state != FREE) go_on(h, c); /* answered since */
        short events = c->state == READING   ? POLLIN
                       : c->state == WRITING ? POLLOUT
                       : c->state == WAITING ? POLLRDHUP
                                             : (short)(POLLRDHUP | (unsent(c) ? POLLOUT : 0));
        p[i] = (struct pollfd){.fd = c->state == FREE ? -1 : c->fd, .events = events};
        bool limited = c->state == READING || (c->state != FREE && unsent(c));
        if (limited && c->deadline < next) next = c->deadline;
    }
    p[CONNECTIONS] = (struct pollfd){.fd = now >= h->pause ? h->fd : -1, .events = POLLIN};
    for (uint32_t i = 0; i < n; i++) p[CONNECTIONS + 1 + i] = (struct pollfd){.fd = fds[i], .events = POLLIN};
    double wait = 1e3 * (next - now);
    if (poll(p, CONNECTIONS + 1 + n, wait > 0 ? (int)wait + 1 : 0) <= 0)
        for (uint32_t i = 0; i < CONNECTIONS + 1 + n; i++) p[i].revents = 0;
    now = cli_now();
    for (int i = 0; i < CONNECTIONS; i++) {
        Connection *c = &h->all[i];
        short got = p[i].revents;
        if (c->state == FREE) continue;
        if (got & (POLLERR | POLLHUP | POLLNVAL) || got & POLLRDHUP) {
            drop(c);
            continue;
        }
        if (got & POLLIN && c->state == READING) read_more(c);
        if (got & POLLOUT && c->state != FREE && !write_more(c)) drop(c);
        if (c->state != FREE) go_on(h, c);
        bool limited = c->state == READING || (c->state != FREE && unsent(c));
        if (limited && now > c->deadline) drop(c);
    }
    if (p[CONNECTIONS].revents & POLLIN) take_connection(h);
    for (uint32_t i = 0; i < n; i++) ready |= (uint32_t)(p[CONNECTIONS + 1 + i].revents != 0) << i;
    return ready;
}

/* ---- the server */
SltStatus http_open(Http **out, uint32_t port, const char token[HTTP_TOKEN + 1], HttpHandler *handle, HttpTeller *tell,
                    void *user, SltError *err) {
    struct sockaddr_in at = {.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
    socklen_t size = sizeof at;
    int on = 1;
    *out = NULL;
    Http *h = calloc(1, sizeof *h);
    if (!h) return status_fail(err, SLT_LIMIT, "out of memory");
    h->handle = handle, h->tell = tell, h->user = user;
    snprintf(h->token, sizeof h->token, "%s", token);
    for (int i = 0; i < CONNECTIONS; i++) h->all[i].fd = -1;
    at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    h->fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    bool ok = h->fd >= 0 && setsockopt(h->fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) == 0 &&
              bind(h->fd, (struct sockaddr *)&at, sizeof at) == 0 && listen(h->fd, 64) == 0 &&
              getsockname(h->fd, (struct sockaddr *)&at, &size) == 0;
    if (!ok) {
        int code = errno;
        http_close(h);
        if (code == EADDRINUSE || code == EACCES)
            return status_fail_errno(err, SLT_USAGE, code, "port %u: choose another with --port, or leave it out",
                                     port);
        return status_fail_errno(err, SLT_LIMIT, code, "cannot listen on 127.0.0.1");
    }
    h->port = ntohs(at.sin_port);
    *out = h;
    return SLT_OK;
}

uint32_t http_port(const Http *h) { return h->port; }

void http_close(Http *h) {
    if (!h) return;
    for (int i = 0; i < CONNECTIONS; i++) drop(&h->all[i]);
    if (h->fd >= 0) close(h->fd);
    free(h);
}
