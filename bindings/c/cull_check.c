/* Of programs that are compiled with verify: does a [Cull] loop keep its promise? Around the box that the program's own
 * function gives for an iteration, `bounds` says where that iteration may matter all the same; where it does at a
 * point, and f is another without it, a warning names it. By the interpreter: nothing is compiled. */
#include <math.h>
#include <string.h>

#include "bindings/c/api.h"

enum { STRIPS = 4, ACROSS = 4, POINTS = STRIPS * ACROSS * ACROSS, MOST = 4096 /* iterations looked at in one loop */ };

typedef struct Check {
    SltProgram *p;
    Fn *value, *bounds;
    Arena *arena;
    SltKernelArgs args;
    unsigned char in[4][2 * POINTS * sizeof(double)]; /* near corner, far corner */
    SltCullList *cull;
    SltNote **notes; /* by list; of the loop that is looked at one is read */
} Check;

static void set(Check *c, uint32_t row, uint32_t i, double v) {
    if (c->p->opt.f64) ((double *)c->in[row])[i] = v;
    else ((float *)c->in[row])[i] = (float)v;
}

/* Bits of the boxes in which the one iteration of the list may matter; 0 where that cannot be told. */
static uint64_t may(Check *c, uint32_t loop, uint32_t n) {
    *c->notes[loop] = (SltNote){0, 0};
    c->args.note = c->notes, c->args.n_valid = n;
    int status = ir_interpret(c->bounds, &c->args, n, 16);
    c->args.note = NULL;
    return status == SLT_OK ? c->notes[loop]->may & (n < 64 ? ((uint64_t)1 << n) - 1 : UINT64_MAX) : 0;
}

/* Is f at point i another without iteration k? */
static bool matters(Check *c, uint32_t loop, uint32_t i, int32_t k) {
    double f[2][SLT_MAX_CHANNELS] = {{0}};
    SltKernelArgs a = c->args;
    size_t size = c->p->opt.f64 ? sizeof(double) : sizeof(float);
    uint32_t count = c->p->list_counts[loop], channels = c->p->prog->channels;
    int32_t *others = ARENA_ARRAY(c->arena, int32_t, count + 1), n = 0;
    for (int32_t j = 0; j < (int32_t)count; j++)
        if (j != k) others[n++] = j;
    for (uint32_t d = 0; d < 2; d++) a.in[IN_X0 + d] = c->in[d] + i * size;
    for (int without = 0; without < 2; without++) {
        c->cull[loop] = without ? (SltCullList){others, n} : (SltCullList){NULL, -1};
        for (uint32_t ch = 0; ch < channels; ch++) a.out[ch] = &f[without][ch];
        a.n_valid = 1;
        if (ir_interpret(c->value, &a, 1, 1) != SLT_OK) return false;
    }
    return memcmp(f[0], f[1], sizeof f[0]) != 0;
}

static Span span_of(const Block *b, uint32_t loop) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_loop && i->imm.loop.cull && i->imm.loop.cull_id == loop) return i->span;
        for (uint32_t r = 0; r < i->nregions; r++) {
            Span s = span_of(i->region[r], loop);
            if (s.file >= 0) return s;
        }
    }
    return SPAN_NONE;
}

/* Strips around the box, half as wide as it is; then points in them. True: a warning was given. */
static bool check_iteration(Check *c, uint32_t loop, int32_t k, const double box[4]) {
    const Program *g = c->p->prog;
    double lo[STRIPS][2], hi[STRIPS][2];
    for (uint32_t s = 0; s < STRIPS; s++)
        for (uint32_t d = 0; d < 2; d++) {
            double wide = 0.5 * (box[2 + d] - box[d]), a = box[d] - wide, b = box[2 + d] + wide;
            double gap = 1e-5 * (fabs(box[d]) + fabs(box[2 + d]) + wide); /* rounding of the box itself */
            if (s / 2 == d) a = s & 1 ? box[2 + d] + gap : a, b = s & 1 ? b : box[d] - gap;
            lo[s][d] = fmin(fmax(a, g->lo[d]), g->hi[d]), hi[s][d] = fmin(fmax(b, lo[s][d]), g->hi[d]);
            set(c, d, s, lo[s][d]), set(c, 2 + d, s, hi[s][d]);
            if (!(a <= b)) return false;
        }
    c->cull[loop] = (SltCullList){&k, 1};
    if (!may(c, loop, STRIPS)) return false;
    for (uint32_t i = 0; i < POINTS; i++)
        for (uint32_t d = 0; d < 2; d++) {
            uint32_t s = i / (ACROSS * ACROSS), at = d ? i / ACROSS % ACROSS : i % ACROSS;
            double v = lo[s][d] + (at + 0.37) / ACROSS * (hi[s][d] - lo[s][d]);
            set(c, d, i, v), set(c, 2 + d, i, v);
        }
    uint64_t where = may(c, loop, POINTS);
    for (uint32_t i = 0; i < POINTS; i++) {
        uint32_t s = i / (ACROSS * ACROSS), a = s / 2;
        if (!(where >> i & 1) || !(hi[s][a] > lo[s][a]) || !matters(c, loop, i, k)) continue;
        double x[2];
        for (uint32_t d = 0; d < 2; d++)
            x[d] = c->p->opt.f64 ? ((double *)c->in[d])[i] : (double)((float *)c->in[d])[i];
        diag_emit(c->p->session, DIAG_cull_misses, span_of(g->primal->body, loop), (int)k, x[0], x[1]);
        return true;
    }
    return false;
}

static void check_loop(Check *c, uint32_t loop) {
    uint32_t count = c->p->list_counts[loop], step = count / MOST + 1;
    for (uint32_t k = 0; k < count; k += step) {
        double out[4], box[4];
        int32_t number = (int32_t)k;
        SltKernelArgs a = c->args;
        a.in[IN_ITERATION] = &number, a.n_valid = 1;
        for (uint32_t e = 0; e < 4; e++) a.out[e] = &out[e];
        if (ir_interpret(c->p->prog->cull_bounds[loop], &a, 1, 1) != SLT_OK) return;
        for (uint32_t e = 0; e < 4; e++) {
            float narrow;
            memcpy(&narrow, &out[e], sizeof narrow);
            box[e] = c->p->opt.f64 ? out[e] : (double)narrow;
            if (!isfinite(box[e])) return;
        }
        ArenaMark m = arena_mark(c->arena);
        bool told = check_iteration(c, loop, number, box);
        arena_reset(c->arena, m);
        if (told) return;
    }
}

static bool notes(const Block *b, uint32_t loop) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_note && i->imm.i == loop) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (notes(i->region[r], loop)) return true;
    }
    return false;
}

void api_check_cull(SltProgram *p) {
    Arena *scratch = &p->session->scratch;
    ArenaMark m = arena_mark(scratch);
    Check *c = ARENA_NEW(scratch, Check);
    bool needs[K_KINDS] = {[K_VALUE] = true, [K_BOUNDS] = true};
    KernelSet set;
    pipeline_kernels(&p->passes, p->prog, needs, NULL, NULL, &set);
    *c = (Check){.p = p, .value = set.fn[K_VALUE], .bounds = set.fn[K_BOUNDS], .arena = scratch};
    c->cull = ARENA_ARRAY(scratch, SltCullList, p->nlists + 1);
    c->notes = ARENA_ARRAY(scratch, SltNote *, p->nlists + 1);
    for (uint32_t i = 0; i < p->nlists; i++)
        c->cull[i].count = -1, c->notes[i] = ARENA_ARRAY(scratch, SltNote, p->list_counts[i] + 1);
    c->args = (SltKernelArgs){.params = p->flt, .iparams = p->ints, .cull = c->cull};
    for (uint32_t d = 0; d < 2; d++) c->args.in[IN_X0 + d] = c->in[d], c->args.in[IN_H0 + d] = c->in[2 + d];
    for (uint32_t loop = 0; loop < p->prog->ncull && c->bounds && c->value; loop++) {
        if (notes(c->bounds->body, loop)) check_loop(c, loop);
        c->cull[loop].count = -1;
    }
    arena_reset(scratch, m);
}
