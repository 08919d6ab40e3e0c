/* Allocating, filling and padding the arrays of kernel calls. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "runtime/sample/cull.h"
#include "saltus/chunks.h"

#define TAPE_ROOM ((uint64_t)1 << 30) /* bytes, of a tape that grows */

enum { POISON = 0xff /* of all bytes: NaN, -1 */ };

/* Of an input or output: of floats, which integers are no longer than. */
static size_t slot_bytes(const Batch *b) {
    return (b->most + (size_t)SLT_PAD) * (b->f64 ? sizeof(double) : sizeof(float));
}

/* A slot for every input that some kernel reads, and for as many outputs as a kernel has; one more takes what is
 * written to inputs that none reads. Inputs are 0: one that nobody writes must still be a valid number. */
static bool make_slots(Batch *b) {
    uint64_t reads = 0;
    uint32_t ninputs = 0, noutputs = 0;
    for (uint32_t kind = 0; kind < SLT_KERNELS; kind++) {
        const SltLayout *layout = &b->s->layout[kind];
        reads |= layout->reads;
        for (uint32_t r = 0; r < SLT_ROLES; r++) {
            uint32_t end = layout->out[r].count ? layout->out[r].first + layout->out[r].count : 0u;
            if (end > noutputs) noutputs = end;
        }
    }
    b->reads = reads, b->streams = reads >> SLT_IN_STREAM & 1 || reads >> SLT_IN_RAND0 & 1;
    assert(noutputs <= SLT_OUT_MAX);
    for (uint32_t i = 0; i < SLT_IN_VARYING; i++) ninputs += reads >> i & 1;
    const size_t slot = slot_bytes(b);
    unsigned char *p = b->memory = aligned_alloc(64, slot * (1 + ninputs + noutputs)), *unread = p;
    if (!p) return false;
    memset(p, 0, slot * (1 + ninputs));
    for (uint32_t i = 0; i < SLT_IN_VARYING; i++) b->args.in[i] = reads >> i & 1 ? (p += slot) : unread;
    for (uint32_t i = 0; i < noutputs; i++) b->args.out[i] = p += slot;
    return true;
}

/* Every chunk of the program runs, no choice is settled, and chunks take what the program says. */
static bool run_all(Batch *b) {
    const SltChunks *c = b->s->chunks;
    if (!c) return true;
    size_t chunks = c->nchunks + 1, operands = 2 * (size_t)c->nchoices, imports = c->nimports + 1;
    b->all_memory = calloc(1, operands * sizeof(uint64_t) + (chunks + operands + imports) * sizeof(int32_t));
    if (!b->all_memory) return false;
    int32_t *list = (int32_t *)((uint64_t *)b->all_memory + operands), *settled = list + chunks;
    int32_t *from = settled + operands;
    for (uint32_t k = 0; k < c->nchunks; k++) list[k] = (int32_t)k;
    list[c->nchunks] = SLT_NO_CHUNK;
    for (uint32_t i = 0; i < c->nimports; i++) from[i] = c->exported[c->import[i]];
    from[c->nimports] = (int32_t)c->nexports;
    b->all = (SltPruned){list, settled, from};
    batch_prune(b, NULL, NULL);
    return true;
}

void batch_prune(Batch *b, const SltPruned *pruned, uint64_t *choices) {
    if (!b->all_memory) return;
    b->args.pruned = pruned ? pruned : &b->all;
    b->args.choices = choices ? choices : b->all_memory;
}

/* A tape that grows has as many addresses as may be; the system gives those pages that are touched. */
static void make_tape(Batch *b, uint64_t bytes) {
    const uint64_t least = bytes;
    if (b->s->tape_grows) bytes += TAPE_ROOM;
    do {
        if (!b->s->tape_grows) b->tape = aligned_alloc(64, bytes);
        else {
            void *p = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
            b->tape = p == MAP_FAILED ? NULL : p;
        }
        b->args.tape = b->tape, b->args.tape_bytes = b->tape ? bytes : 0;
        bytes /= 2;
    } while (!b->tape && bytes > least);
}

bool batch_init(Batch *b, const SltScene *s, const Grid *g) { return batch_init_few(b, s, g, BATCH); }

bool batch_init_few(Batch *b, const SltScene *s, const Grid *g, uint32_t most) {
    memset(b, 0, sizeof *b);
    b->most = most <= BATCH ? (most + SLT_PAD - 1) / SLT_PAD * SLT_PAD : BATCH;
    b->s = s, b->f64 = s->f64, b->grid = g, b->fill = fill_best();
    b->pixels = g && !g->integral;
    assert(s->channels <= SLT_MAX_CHANNELS && scene_outputs(s, SLT_K_REGION, SLT_OUT_WITNESS) <= SLT_WITNESSES);
    assert(scene_outputs(s, SLT_K_EVENT, SLT_OUT_K) <= SLT_MAX_K);
    if (!make_slots(b)) return false;
    bool image = b->pixels;
    b->pixels &= (b->reads >> SLT_IN_PIXEL0 & 3) != 0;
    b->args.params = s->params, b->args.iparams = s->iparams;
    b->args.print = s->print, b->args.user = s->print_user;
    b->args.geometries = s->geometries;
    b->args.resolution[0] = b->args.resolution[1] = 1;
    if (image) b->args.resolution[0] = (int32_t)g->n[0], b->args.resolution[1] = (int32_t)g->n[1];
    uint64_t lanes = SLT_PAD;
    make_tape(b, (s->tape_bytes * lanes + 4096 + 63) & ~(uint64_t)63);
    if (!run_all(b)) return false;
#ifndef NDEBUG
    b->poison = aligned_alloc(64, slot_bytes(b));
    if (!b->poison) return false;
    memset(b->poison, POISON, slot_bytes(b));
#endif
    return b->tape != NULL;
}

void batch_free(Batch *b) {
    if (b->s && b->s->tape_grows && b->tape) munmap(b->tape, b->args.tape_bytes), b->tape = NULL;
    free(b->memory), free(b->tape), free(b->poison), free(b->all_memory);
    b->memory = b->all_memory = NULL, b->tape = b->poison = NULL;
}

void batch_collect(Batch *b, SltStats *t) {
    uint64_t *c = b->args.counters;
    t->evaluations += b->evaluations, b->evaluations = 0;
    t->truncated += c[SLT_COUNT_TRUNCATED], t->asserts += c[SLT_COUNT_ASSERT], t->nonfinite += c[SLT_COUNT_NONFINITE];
    memset(c, 0, sizeof b->args.counters);
}

bool batch_is_constant(const Batch *b, uint32_t i, double *value) {
    for (uint32_t c = 0; c < b->s->channels; c++) {
        const double lo = value[c] = batch_get(b, SLT_OUT_F_LO, c, i);
        if (!(lo == batch_get(b, SLT_OUT_F_HI, c, i)) || !isfinite(lo)) return false;
    }
    return true;
}

void batch_set_pixel(Batch *b, uint32_t i, const double x[3]) {
    batch_set_int(b, SLT_IN_PIXEL0, i, (int32_t)grid_cell(b->grid, 0, x[0]));
    batch_set_int(b, SLT_IN_PIXEL1, i, b->s->dim > 1 ? (int32_t)(b->grid->n[1] - 1 - grid_cell(b->grid, 1, x[1])) : 0);
}

void batch_read_line(const Batch *b, uint32_t e, uint32_t i, Event *event) {
    event->line = scene_is_of_mesh(b->s, event->site);
    for (uint32_t end = 0; end < 2 && event->line; end++)
        event->window[end] = batch_get(b, SLT_OUT_OPEN_LINE, 2 * e + end, i);
}

enum { INT, FLT, COPY, ZERO };
static const struct {
    uint8_t type, tail;
} input_row[SLT_IN_VARYING] = {
#define SLT_INPUT(id, text, type, tail, ...) {type, tail},
#include "saltus/kernel.def"
};
static const uint8_t role_type[SLT_ROLES] = {
#define SLT_ROLE(id, text, type, ...) type,
#include "saltus/kernel.def"
};

static int64_t element_bytes(const Batch *b, uint8_t type) { return type == FLT && b->f64 ? 8 : 4; }

/* Samples n .. end - 1 of every input that the kernel reads. */
static void pad(Batch *b, uint32_t n, uint32_t end) {
    for (uint64_t left = b->layout->reads & ((1ull << SLT_IN_VARYING) - 1); left; left &= left - 1) {
        uint32_t slot = (uint32_t)__builtin_ctzll(left);
        bool zero = input_row[slot].tail == ZERO;
        void *v = (void *)b->args.in[slot];
        if (input_row[slot].type == FLT && b->f64) {
            uint64_t *to = v, last = zero ? 0 : to[n - 1];
            for (uint32_t i = n; i < end; i++) to[i] = last;
        } else {
            uint32_t *to = v, last = zero ? 0 : to[n - 1];
            for (uint32_t i = n; i < end; i++) to[i] = last;
        }
    }
}

/* In builds with asserts: inputs that the kernel does not read are NaN to it, and so are outputs until it has written
 * them. `in` has room for the inputs that come back. */
static void poison(Batch *b, const void *in[SLT_IN_VARYING]) {
#ifndef NDEBUG
    memcpy(in, b->args.in, sizeof b->args.in);
    for (uint32_t slot = 0; slot < SLT_IN_VARYING; slot++)
        if (!(b->layout->reads >> slot & 1)) b->args.in[slot] = b->poison;
    for (uint32_t r = 0; r < SLT_ROLES; r++)
        for (uint32_t k = 0; k < b->layout->out[r].count; k++)
            memset(b->args.out[b->layout->out[r].first + k], POISON, slot_bytes(b));
#else
    (void)b, (void)in;
#endif
}

static void cure(Batch *b, const void *in[SLT_IN_VARYING]) {
#ifndef NDEBUG
    memcpy(b->args.in, in, sizeof b->args.in);
#else
    (void)b, (void)in;
#endif
}

static void run(Batch *b, SltKernelKind kind, SltKernel *kernel, uint32_t n) {
    if (b->s->call) b->s->call(b->s->call_user, (int)kind, &b->args, n);
    else kernel(&b->args, n);
}

/* Where the next samples of all that the kernel reads and writes are: n further on. */
static void advance(Batch *b, int64_t n) {
    for (uint64_t left = b->layout->reads & ((1ull << SLT_IN_VARYING) - 1); left; left &= left - 1) {
        const uint32_t slot = (uint32_t)__builtin_ctzll(left);
        b->args.in[slot] = (const char *)b->args.in[slot] + n * element_bytes(b, input_row[slot].type);
    }
    for (uint32_t r = 0; r < SLT_ROLES; r++)
        for (uint32_t k = 0; k < b->layout->out[r].count; k++) {
            void **out = &b->args.out[b->layout->out[r].first + k];
            *out = (char *)*out + n * element_bytes(b, role_type[r]);
        }
}

/* The same a few samples at a time, each with the iterations of [Cull] loops that may reach them: neighbours in a batch
 * mostly lie on one line, and a tile may be all of the domain. */
static void run_by_parts(Batch *b, SltKernelKind kind, SltKernel *kernel, uint32_t n, uint32_t lanes) {
    enum { FEW = 16 }; /* samples that are worth a list */
    const uint32_t valid = b->args.n_valid, part = lanes > FEW ? lanes : FEW;
    const SltCullList *whole = b->args.cull;
    uint32_t from = 0;
    for (; from < n; from += part, advance(b, part)) {
        const uint32_t left = n - from < part ? n - from : part;
        b->args.n_valid = valid - from < left ? valid - from : left;
        cull_part(b, left, kind == SLT_K_BOUNDS);
        run(b, kind, kernel, left);
    }
    advance(b, -(int64_t)from);
    b->args.cull = whole, b->args.n_valid = valid;
}

void batch_stop(Batch *b, SltKernelKind kind) {
    b->layout = &b->s->layout[kind];
    for (uint32_t r = 0; r < SLT_ROLES; r++)
        for (uint32_t k = 0; k < b->layout->out[r].count; k++)
            memset(b->args.out[b->layout->out[r].first + k], 0, slot_bytes(b));
}

void slt_kernel_late(SltKernelArgs *args, uint32_t n) { (void)args, (void)n; }

/* Whether lines are searched by it, whose samples lie side by side. */
static bool searches(SltKernelKind kind) {
    return kind == SLT_K_REGION || kind == SLT_K_EVENT || kind == SLT_K_SIDES || kind == SLT_K_BOUNDS;
}

static void call(Batch *b, SltKernelKind kind, SltKernel *kernel, uint32_t n) {
    assert(kernel && n <= b->most);
    if (kernel == slt_kernel_late && !(kernel = b->s->make(b->s->make_user, (int)kind))) {
        batch_stop(b, kind);
        return;
    }
    uint32_t step = b->s->lanes[kind] ? b->s->lanes[kind] : b->s->widest;
    if (b->s->call || !step) step = SLT_PAD;
    const uint32_t end = (n + step - 1) / step * step;
    b->layout = &b->s->layout[kind];
    b->args.n_valid = n;
    const void *in[SLT_IN_VARYING];
    if (end != n) pad(b, n, end);
    poison(b, in);
    if (searches(kind) && cull_may_part(b)) run_by_parts(b, kind, kernel, n, step);
    else run(b, kind, kernel, n);
    cure(b, in);
}

void batch_call(Batch *b, SltKernelKind kind, uint32_t n) {
    if (!n) return;
    if (b->pool && pool_stop_reason(b->pool) != SLT_OK) {
        batch_stop(b, kind);
        return;
    }
    b->evaluations += n;
    uint64_t truncated = b->args.counters[SLT_COUNT_TRUNCATED], asserts = b->args.counters[SLT_COUNT_ASSERT];
    b->args.print = kind == SLT_K_VALUE || kind == SLT_K_PRUNED
                        ? b->s->print
                        : NULL; /* derivatives run at the same samples as the value */
    call(b, kind, b->s->kernel[kind], n);
    if (b->args.counters[SLT_COUNT_TAPE_OVERFLOW] && b->s->tape_full) atomic_store(b->s->tape_full, true);
    if (b->again) b->args.counters[SLT_COUNT_TRUNCATED] = truncated, b->args.counters[SLT_COUNT_ASSERT] = asserts;
}

void batch_call_cull(Batch *b, uint32_t cull_id, uint32_t n) {
    if (n) call(b, SLT_K_CULL, b->s->cull_bounds[cull_id], n);
}
