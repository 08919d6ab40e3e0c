/* What the viewer serves: routes from requests to the page, to what is told, and to Asks. docs/view.md describes them.
 */
#ifndef SALTUS_CLI_VIEW_SERVE_H
#define SALTUS_CLI_VIEW_SERVE_H

#include "cli/view/http.h"
#include "cli/view/viewer.h"

typedef struct Served {
    Viewer *viewer;
    Http *http;
    bool over;   /* POST /quit */
    bool untold; /* streams are to be asked */
} Served;
void serve_request(void *user, const HttpRequest *q); /* HttpHandler; user: Served */
Blob *serve_tell(void *user, uint64_t place[4]);      /* HttpTeller */
void serve_replies(Served *s);                        /* sends the answers that are there */

#endif
