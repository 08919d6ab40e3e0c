/* An HTTP/1.1 server for one page on the loopback: requests in, answers out, streams of server-sent events.
 *
 * Everything here runs on the thread that calls http_poll, which never waits for a client. What a client can make the
 * server keep is bounded: connections, the sizes and the times of requests, and of an event stream one unsent event. A
 * request reaches the handler only if it was asked of this machine by name (Host, so that no foreign name was made to
 * point here), by no page of another origin (Origin), and, with a body, by somebody who knows the token.
 *
 * A Blob is bytes that several owners share; whoever has a pointer to one holds a reference. */
#ifndef SALTUS_CLI_VIEW_HTTP_H
#define SALTUS_CLI_VIEW_HTTP_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "runtime/base/status.h"

typedef struct Blob {
    atomic_uint refs;
    size_t size;
    uint8_t data[]; /* a 0 follows, which size does not count */
} Blob;
Blob *blob_new(size_t size); /* one reference; NULL: out of memory */
Blob *blob_copy(const void *data, size_t size);
Blob *blob_keep(Blob *b); /* another reference; NULL gives NULL */
void blob_drop(Blob *b);  /* takes NULL */

typedef struct Http Http;

typedef struct HttpRequest {
    uint64_t id;              /* for http_answer */
    bool post;                /* else GET */
    bool trusted;             /* the token was there */
    const char *path, *query; /* path "/image"; query "" where there is none */
    const char *body;         /* ended by a 0 that size does not count */
    size_t size;
} HttpRequest;
/* Answers the request with http_answer or http_stream, now or later. */
typedef void HttpHandler(void *user, const HttpRequest *q);
/* What a stream says next: a blob of whole events, or NULL; `place` is the stream's own, 0 at first. Called when all
 * that was said before has been sent. */
typedef Blob *HttpTeller(void *user, uint64_t place[4]);

enum { HTTP_TOKEN = 32, HTTP_LARGEST_BODY = 32 << 20, HTTP_WATCHED = 4 };

/* Listens on 127.0.0.1; port 0: one that is free. SLT_USAGE: the port is taken. */
SltStatus http_open(Http **out, uint32_t port, const char token[HTTP_TOKEN + 1], HttpHandler *handle, HttpTeller *tell,
                    void *user, SltError *err);
uint32_t http_port(const Http *h);
/* Serves for at most so many milliseconds. Returns early when one of fds[n], n <= HTTP_WATCHED, can be read: bit i is
 * set for fds[i]. */
uint32_t http_poll(Http *h, const int *fds, uint32_t n, int milliseconds);
/* Takes over the reference to body, which may be NULL (memory was out: status 500). headers: further lines, each ended
 * by \r\n. What has no client any more is dropped. */
void http_answer(Http *h, uint64_t id, int status, const char *type, const char *headers, Blob *body);
void http_stream(Http *h, uint64_t id);
void http_tell(Http *h); /* asks every stream that has sent all for more */
void http_close(Http *h);

/* The value of `key` in a query or a form, decoded; false: there is none, or it does not fit. */
bool http_query(const char *query, const char *key, char *value, size_t size);

#endif
