/* What a call adds to adjoints, taken back where it is not finite. */
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/accum.h"

bool accum_watch(Accum *a, uint32_t which, uint32_t rows) {
    Before *q = &a->before;
    if (a->bytes > ACCUM_WATCHED) return false;
    q->adj = a->buf[which].adj, q->n = a->bytes * rows, q->zero = true;
    for (uint32_t r = 0; r < rows; r++) q->zero &= !a->buf[which + r].dirty;
    if (q->zero) return true;
    if (q->room < q->n) {
        unsigned char *more = realloc(q->bytes, q->n);
        if (!more) return false;
        q->bytes = more, q->room = q->n;
    }
    memcpy(q->bytes, q->adj, q->n);
    return true;
}

void accum_put_back(Accum *a) {
    Before *q = &a->before;
    if (q->zero) memset(q->adj, 0, q->n);
    else memcpy(q->adj, q->bytes, q->n);
}

bool accum_is_finite(const Accum *a) { return a->fill->finite(a->before.adj, a->before.n, a->s->f64); }

bool accum_are_finite(const Accum *a, const void *values, uint64_t n) {
    return a->fill->finite(values, n * (a->s->f64 ? 8 : 4), a->s->f64);
}
