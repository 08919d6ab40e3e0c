/* Adjoints of the parameters.
 *
 * Within a tile a kernel adds in its own precision, one sum a lane (or one a parameter where they are many); at the end
 * of the tile the lanes are added into doubles, and tiles are added in order. Blocks of parameters that a tile left at
 * zero cost a look, not an addition, and texels and heights, which have the log, not even that. */
#include <assert.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "runtime/sample/accum.h"
#include "runtime/sample/alloc.h"

/* 64-byte aligned, and with `zero` zeros. Of a large block the system gives only the pages that are touched: a
 * heightfield of a million heights has adjoints in the log alone, and of the buffers of a worker many stay empty. A
 * small one comes from the heap, whose pages are there already in the next call. */
enum { FEW_BYTES = 1 << 19 };

enum { FOLD = 1 << 13 }; /* entries of a log, which then still lies in a cache */
/* Entries of one that a call may fill by as much as queries tell, or would have to run twice. The system gives those
 * pages that are touched. */
enum { LONG_LOG = 1 << 22 };
enum { LOOK = 256 }; /* entries that tell how a log goes on */

static void *new_pages(uint64_t bytes, bool zero) {
    if (bytes <= FEW_BYTES) {
        void *few = aligned_alloc(64, (bytes + 63) & ~(uint64_t)63);
        if (few && zero) alloc_pages(few, bytes);
        return few && zero ? memset(few, 0, bytes) : few;
    }
    void *p = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    return p == MAP_FAILED ? NULL : p;
}

static void free_pages(void *p, uint64_t bytes) {
    if (bytes <= FEW_BYTES) free(p);
    else if (p) munmap(p, bytes);
}

/* Of one buffer. */
static uint64_t sums_bytes(const Accum *a) { return a->s->nfloats * sizeof(double); }

bool accum_init(Accum *a, const SltScene *s, uint32_t n) {
    assert(n <= ACCUMS);
    memset(a, 0, sizeof *a);
    a->s = s, a->n = n;
    a->stride = (s->f64 ? 8 : 4) * (uint64_t)s->adj_lanes;
    a->bytes = a->stride * s->nfloats;
    uint32_t blocks = s->nfloats / ACCUM_BLOCK + 1;
    a->adj = new_pages(a->bytes * n + 64, true);
    a->sums = new_pages(n * sums_bytes(a), false);
    if (!a->adj || !a->sums) return false;
    for (uint32_t i = 0; i < n; i++) {
        AdjointBuffer *b = &a->buf[i];
        b->adj = a->adj + i * a->bytes;
        b->sum = (double *)(a->sums + i * sums_bytes(a));
        b->touched = alloc_zero(blocks, sizeof *b->touched);
        if (!b->touched) return false;
    }
    a->fill = fill_best(), a->vjp = SLT_KERNELS;
    a->stretch = alloc_zero(blocks, sizeof *a->stretch);
    if (!a->stretch) return false;
    for (uint32_t p0 = 0, p1; p0 < s->nfloats; p0 = p1) {
        p1 = s->nfloats - p0 < ACCUM_BLOCK ? s->nfloats : p0 + ACCUM_BLOCK;
        if (s->dense && !memchr(s->dense + p0, 1, p1 - p0)) continue;
        if (!a->nstretches || a->stretch[a->nstretches - 1][1] != p0) a->stretch[a->nstretches++][0] = p0;
        a->stretch[a->nstretches - 1][1] = p1;
    }
    return true;
}

void accum_free(Accum *a) {
    if (!a->s) return; /* nothing has begun */
    for (uint32_t i = 0; i < a->n; i++) free(a->buf[i].touched), free(a->buf[i].log_index), free(a->buf[i].log_value);
    free_pages(a->adj, a->bytes * a->n + 64), free_pages(a->scratch, a->bytes * SLT_MAX_CHANNELS + 64);
    free_pages(a->sums, a->n * sums_bytes(a));
    free(a->stretch), free(a->before.bytes), free(a->folded.parameter), free(a->folded.slot), free(a->folded.sum);
    memset(a, 0, sizeof *a);
}

static uint64_t flt_bytes(const Accum *a) { return a->s->f64 ? 8 : 4; }

static bool grow_log(const Accum *a, AdjointBuffer *buf, uint64_t need) {
    uint64_t cap = buf->log_cap ? buf->log_cap : 4096;
    while (cap < need) cap *= 2;
    uint32_t *index = realloc(buf->log_index, (cap + SLT_PAD) * sizeof *index);
    if (index) buf->log_index = index;
    unsigned char *value = realloc(buf->log_value, (cap + SLT_PAD) * flt_bytes(a));
    if (value) buf->log_value = value;
    if (!index || !value) return false;
    buf->log_cap = cap;
    return true;
}

/* The kernel appends behind the entries of earlier calls. */
static void lend_log(const Accum *a, const AdjointBuffer *buf, SltKernelArgs *args) {
    args->log_index = buf->log_index ? buf->log_index + buf->log_len : NULL;
    args->log_value = buf->log_value ? buf->log_value + buf->log_len * flt_bytes(a) : NULL;
    args->log_cap = buf->log_cap - buf->log_len, args->log_len = 0;
}

/* Runs the kernel, and again where the log was too short: the adjoints of the call are in adj then, and the second run
 * is for the log alone. Returns how long the log got. */
static uint64_t run(Accum *a, Batch *b, SltKernelKind kind, uint32_t n, AdjointBuffer *buf) {
    uint64_t counters[SLT_COUNTERS];
    memcpy(counters, b->args.counters, sizeof counters);
    b->args.adj = buf->adj;
    lend_log(a, buf, &b->args);
    batch_call(b, kind, n);
    const uint64_t len = b->args.log_len;
    if (len <= b->args.log_cap) return len;
    if (!a->scratch) a->scratch = new_pages(a->bytes * SLT_MAX_CHANNELS + 64, true);
    if (!a->scratch || !grow_log(a, buf, buf->log_len + len)) {
        a->failed = true;
        return 0;
    }
    memcpy(b->args.counters, counters, sizeof counters);
    b->args.adj = a->scratch;
    lend_log(a, buf, &b->args);
    batch_call(b, kind, n);
    b->evaluations -= n;
    return len;
}

static bool has_guarded(const Accum *a) { return a->s->kernel[SLT_K_VJP_GUARDED] != NULL; }

/* Have calls of VJP not been finite lately? */
static bool is_in_doubt(const Accum *a) {
    SltDoubt *d = a->s->doubt;
    uint32_t left = d ? atomic_load_explicit(&d->left, memory_order_relaxed) : 0;
    while (left && !atomic_compare_exchange_weak_explicit(&d->left, &left, left - 1, memory_order_relaxed,
                                                          memory_order_relaxed)) {
    }
    return left > 0;
}

/* Each time twice as long, and shortly where it went well. */
static void learn(const Accum *a, bool finite) {
    enum { SHORT = 4, LONG = 256 };
    SltDoubt *d = a->s->doubt;
    if (!d) return;
    uint32_t next = finite ? 0 : atomic_load_explicit(&d->next, memory_order_relaxed);
    if (finite && !atomic_load_explicit(&d->next, memory_order_relaxed)) return; /* as ever, and nothing is written */
    if (!finite) next = next < SHORT ? SHORT : next < LONG ? 2 * next : LONG;
    atomic_store_explicit(&d->next, next, memory_order_relaxed);
    atomic_store_explicit(&d->left, next, memory_order_relaxed);
}

void accum_begin(Accum *a, const Batch *b) {
    if (!has_guarded(a)) return;
    a->vjp = is_in_doubt(a) ? SLT_K_VJP_GUARDED : SLT_K_VJP;
    a->suspect = false, a->evaluations = b->evaluations;
    memcpy(a->counters, b->args.counters, sizeof a->counters);
}

bool accum_again(Accum *a, Batch *b) {
    const bool tried = a->vjp == SLT_K_VJP;
    a->vjp = SLT_KERNELS;
    if (!tried || a->failed) return false;
    learn(a, !a->suspect);
    if (!a->suspect) return false;
    for (uint32_t i = 0; i < a->n; i++) a->buf[i].ntouched = 0, a->buf[i].log_len = 0;
    if (a->folded.slot) accum_unfold(a);
    a->vjp = SLT_K_VJP_GUARDED, a->suspect = false, b->evaluations = a->evaluations;
    memcpy(b->args.counters, a->counters, sizeof a->counters);
    return true;
}

/* VJP has no guards against 0 times what is infinite, which take time and are hardly ever needed: where what it gives
 * is not finite, it is taken back, and the guarded kernel runs. Where both are finite they give the same bits. */
static uint64_t run_vjp(Accum *a, Batch *b, uint32_t n, uint32_t which, uint32_t rows) {
    AdjointBuffer *buf = &a->buf[which];
    const bool poles = accum_may_leave_out(a), choose = has_guarded(a) && a->vjp == SLT_KERNELS;
    const bool watched = (poles || choose) && accum_watch(a, which, rows);
    SltKernelKind kind = has_guarded(a) ? a->vjp : SLT_K_VJP;
    if (choose) kind = !watched || is_in_doubt(a) ? SLT_K_VJP_GUARDED : SLT_K_VJP;
    uint64_t counters[SLT_COUNTERS];
    memcpy(counters, b->args.counters, sizeof counters);
    for (uint32_t r = 0; r < rows; r++) buf[r].dirty = true;
    uint64_t len = run(a, b, kind, n, buf);
    if (kind == SLT_K_VJP && has_guarded(a)) {
        bool finite = !len || accum_are_finite(a, buf->log_value + buf->log_len * flt_bytes(a), len);
        if (watched) finite = finite && accum_is_finite(a);
        else a->suspect |= !finite;
        if (choose) learn(a, finite);
        if (watched && !finite) {
            if (!choose) learn(a, false), a->vjp = SLT_K_VJP_GUARDED; /* of the rest of the tile, too */
            accum_put_back(a);
            memcpy(b->args.counters, counters, sizeof counters);
            b->evaluations -= n;
            len = run(a, b, kind = SLT_K_VJP_GUARDED, n, buf);
        }
    }
    if (poles && watched && !len) accum_leave_out(a, b, kind, n);
    return len;
}

static void call_rows(Accum *a, Batch *b, SltKernelKind kind, uint32_t n, uint32_t which, uint32_t rows) {
    assert(which + rows <= a->n);
    AdjointBuffer *buf = &a->buf[which];
    if (!n) return;
    a->failed = a->failed || (!buf->log_cap && !grow_log(a, buf, a->s->tape_grows ? LONG_LOG : 0));
    if (a->failed) {
        batch_stop(b, kind);
        return;
    }
    b->args.rows = (int32_t)rows;
    if (kind == SLT_K_VJP) {
        buf->log_len += run_vjp(a, b, n, which, rows);
    } else {
        for (uint32_t r = 0; r < rows && !a->s->site_logs; r++) buf[r].dirty = true;
        buf->log_len += run(a, b, kind, n, buf);
    }
    if (a->folded.slot && buf->log_len > FOLD) a->failed |= !accum_fold_log(a, which);
}

void accum_call(Accum *a, Batch *b, SltKernelKind kind, uint32_t n, uint32_t which) {
    call_rows(a, b, kind, n, which, 1);
}

void accum_site_rows(Accum *a, Batch *b, uint32_t n, uint32_t which) {
    call_rows(a, b, SLT_K_SITE_VJP, n, which, a->s->channels);
}

void accum_rows(Accum *a, Batch *b, const double *weight, uint32_t n, uint32_t which) {
    uint32_t channels = a->s->channels;
    bool together = a->s->layout[SLT_K_VJP].reads >> SLT_IN_ROWS & 1, again = b->again;
    for (uint32_t c = 0; c < (together ? 1 : channels); c++) {
        for (uint32_t seed = 0; seed < channels; seed++)
            for (uint32_t i = 0; i < n; i++)
                batch_set(b, SLT_IN_SEED0 + seed, i, together || seed == c ? weight[i] : 0);
        b->again = again || c > 0;
        call_rows(a, b, SLT_K_VJP, n, which + c, together ? channels : 1);
    }
    b->again = again;
}

/* Parameters p0 .. p1 - 1 of a buffer, a block of which some sum is not 0. */
static void close_block(Accum *a, uint32_t which, uint32_t p0, uint32_t p1) {
    AdjointBuffer *buf = &a->buf[which];
    void *block = buf->adj + a->stride * p0;
    double few[ACCUM_BLOCK], *sums = a->folded.slot ? few : buf->sum + p0;
    uint32_t lanes[ACCUM_BLOCK]; /* of each parameter, which are a run to those that add up samples */
    for (uint32_t p = 0; p < p1 - p0; p++) sums[p] = 0, lanes[p] = a->s->adj_lanes;
    if (a->s->f64) a->fill->sum_f64(block, p1 - p0, lanes, sums, 1);
    else a->fill->sum_f32(block, p1 - p0, lanes, sums, 1);
    memset(block, 0, a->stride * (p1 - p0));
    double zero = 0;
    for (uint32_t p = 0; p < p1 - p0; p++) zero += 0 * sums[p];
    a->suspect |= zero != 0; /* it is not a number, then */
    if (a->folded.slot) a->failed |= !accum_fold(a, which, p0, few, p1 - p0);
    else buf->touched[buf->ntouched++] = p0;
}

/* Most blocks of most tiles are zero, and cost a look. */
void accum_close(Accum *a) {
    for (uint32_t i = 0; i < a->n; i++) {
        AdjointBuffer *buf = &a->buf[i];
        buf->ntouched = 0;
        for (uint32_t k = 0; k < a->nstretches && buf->dirty; k++)
            for (uint32_t p0 = a->stretch[k][0], end = a->stretch[k][1];;) {
                uint64_t bytes = a->stride * (end - p0), clear = a->fill->zeros(buf->adj + a->stride * p0, bytes);
                if (clear == bytes) break;
                p0 += (uint32_t)(clear / a->stride) / ACCUM_BLOCK * ACCUM_BLOCK;
                uint32_t p1 = end - p0 < ACCUM_BLOCK ? end : p0 + ACCUM_BLOCK;
                close_block(a, i, p0, p1);
                p0 = p1;
            }
        if (a->folded.slot) a->failed |= !accum_fold_log(a, i);
        buf->dirty = false;
    }
    a->infinite = false;
}

/* Where an entry of the log goes. Behind the last buffer are no rows: an index there is none. */
static double *target_of(const Accum *a, uint32_t which, double *const *targets, uint32_t index, double *none) {
    uint32_t row = which;
    for (; index >= a->s->nfloats && row < a->n; row++) index -= a->s->nfloats;
    return row < a->n ? &targets[row][index] : none;
}

/* Are neighbouring entries mostly of one parameter? As its beginning goes, so goes the log. */
static bool comes_in_runs(const AdjointBuffer *buf) {
    const uint64_t n = buf->log_len < LOOK ? buf->log_len : LOOK;
    uint64_t like = 0;
    for (uint64_t e = 1; e < n; e++) like += buf->log_index[e] == buf->log_index[e - 1];
    return 2 * like > n;
}

/* In their order either way. Where they come in runs a sum is not put down in between; else to ask whether it must be
 * costs more than to do it. */
#define ADD_LOG(name, T)                                                                                               \
    static void name(const Accum *a, uint32_t which, double *const *targets) {                                         \
        const AdjointBuffer *buf = &a->buf[which];                                                                     \
        const T *value = (const T *)buf->log_value;                                                                    \
        double none = 0, *to = &none, sum = 0, *first = targets[which];                                                \
        const uint32_t own = a->s->nfloats;                                                                            \
        if (!comes_in_runs(buf)) {                                                                                     \
            for (uint64_t e = 0; e < buf->log_len; e++) {                                                              \
                const uint32_t index = buf->log_index[e];                                                              \
                *(index < own ? &first[index] : target_of(a, which, targets, index, &none)) += (double)value[e];       \
            }                                                                                                          \
            return;                                                                                                    \
        }                                                                                                              \
        for (uint64_t e = 0; e < buf->log_len; e++) {                                                                  \
            if (!e || buf->log_index[e] != buf->log_index[e - 1]) {                                                    \
                *to = sum;                                                                                             \
                to = target_of(a, which, targets, buf->log_index[e], &none);                                           \
                sum = *to;                                                                                             \
            }                                                                                                          \
            sum += (double)value[e];                                                                                   \
        }                                                                                                              \
        *to = sum;                                                                                                     \
    }
ADD_LOG(add_log_f32, float)
ADD_LOG(add_log_f64, double)

void accum_merge(Accum *a, double *const *targets) {
    for (uint32_t i = 0; i < a->n; i++) {
        AdjointBuffer *buf = &a->buf[i];
        double *to = targets[i];
        for (uint32_t t = 0; t < buf->ntouched; t++) {
            uint32_t p0 = buf->touched[t], p1 = p0 + ACCUM_BLOCK < a->s->nfloats ? p0 + ACCUM_BLOCK : a->s->nfloats;
            for (uint32_t p = p0; p < p1; p++) to[p] += buf->sum[p];
        }
        if (a->s->f64) add_log_f64(a, i, targets);
        else add_log_f32(a, i, targets);
        buf->ntouched = 0, buf->log_len = 0;
    }
}
