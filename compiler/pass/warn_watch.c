/* Running a program and noting what some of its instructions decide. Watched are the jumps in question, and guides:
 * comparisons, minima and maxima of what depends on the position, integers too, tagged or not. A jump may matter only
 * where one of these decides as it hardly ever does: `int(50 * d) == 3`, `min(floor(64 * r), 3)`, `x.y > 0.99 ? ..`. */
#include <math.h>
#include <string.h>

#include "compiler/pass/depend.h"
#include "compiler/pass/warn_watch.h"
#include "saltus/status.h"

enum { GUIDES = 48 };

static bool rounds(Op op) {
    return op == OP_ffloor || op == OP_fceil || op == OP_fround || op == OP_ftrunc || op == OP_f2i || op == OP_f2u;
}

static bool orders(const Inst *i) {
    Op op = (Op)i->op;
    return ir_ops[op].compares || op == OP_fmin || op == OP_fmax || op == OP_imin || op == OP_imax || op == OP_umin ||
           op == OP_umax;
}

static void add(Probe *p, Watched w) {
    p->watched[p->n++] = w;
    p->which[w.at->id] = p->n;
}

static void add_guides(Probe *p, const Depend *dep, const Block *b, bool of_jumps) {
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) add_guides(p, dep, i->region[r], of_jumps);
        if (!orders(i) || i->nargs != 2 || p->which[i->id] || p->n == p->nlist + GUIDES) continue;
        uint8_t on = dep[i->args[0]->id].on | dep[i->args[1]->id].on;
        if ((on & DEPENDS_X) && ((on & DEPENDS_JUMPS) != 0) == of_jumps)
            add(p, (Watched){i, i->args[0], i->args[1], WATCH_ORDER});
    }
}

void watch_init(Probe *p, PassCtx *ctx, const Fn *fn, const Depend *dep, const Untracked **list, uint32_t n) {
    Arena *scratch = &ctx->session->scratch;
    p->program = ctx->program, p->fn = *fn, p->fn.precision = PREC_F64;
    p->which = ARENA_ARRAY(scratch, uint32_t, fn->ninsts + 1);
    p->watched = ARENA_ARRAY(scratch, Watched, n + GUIDES);
    p->nlist = n;
    for (uint32_t k = 0; k < n; k++) {
        const Untracked *t = list[k];
        WatchKind kind = rounds((Op)t->at->op)                           ? WATCH_ROUNDING
                         : t->at->type == TY_FLT && t->at->op != OP_fsel ? WATCH_SIGN
                                                                         : WATCH_VALUE;
        add(p, (Watched){t->at, t->g0, t->g1, kind});
    }
    add_guides(p, dep, fn->body, true);
    add_guides(p, dep, fn->body, false);
    p->interp = ir_interp(scratch, &p->fn, WARN_LANES);
    size_t cells = (size_t)p->n * WARN_LANES;
    p->seen = ARENA_ARRAY(scratch, uint32_t, cells);
    p->value = ARENA_ARRAY(scratch, double, cells), p->argument = ARENA_ARRAY(scratch, double, cells);
    p->near = ARENA_ARRAY(scratch, double, cells);
    p->params = ARENA_ARRAY(scratch, double, ctx->program->nfloats + 1);
}

static double number(const Inst *i, const void *const *slot, uint32_t lane) {
    if (i->type == TY_FLT) return ((const double *)slot[i->id])[lane];
    int32_t v = ((const int32_t *)slot[i->id])[lane];
    return v;
}

/* All that is not a number is alike. */
static uint32_t bits_of(double v) { return (uint32_t)(int32_t)(isnan(v) ? -2e9 : fmin(fmax(v, -1e9), 1e9)); }

static void watch(void *user, const Inst *i, const void *const *slot, const uint8_t *on) {
    Probe *p = user;
    uint32_t k = p->which[i->id];
    if (!k--) return;
    const Watched *w = &p->watched[k];
    for (uint32_t l = 0; l < WARN_LANES; l++) {
        if (!on[l]) continue;
        uint32_t at = watch_at(k, l), value = 0;
        double a = w->a ? number(w->a, slot, l) : 0, b = w->b ? number(w->b, slot, l) : 0;
        switch (w->kind) {
        case WATCH_VALUE:
            value = i->type == TY_FLT ? bits_of(number(i, slot, l)) : ((const uint32_t *)slot[i->id])[l];
            break;
        case WATCH_SIGN: value = a < 0; break;
        case WATCH_ROUNDING: value = bits_of(number(i, slot, l)); break;
        case WATCH_ORDER: value = a < b ? 0 : a > b ? 2 : 1; break;
        }
        if (w->b) p->near[at] = fmin(p->near[at], fabs(a - b));
        if (w->kind == WATCH_ROUNDING) p->value[at] += number(i, slot, l), p->argument[at] += a;
        p->seen[at] = ir_mix(p->seen[at], value + 1);
    }
}

void watch_place(Probe *p, uint32_t lane, const double x[PLACE]) {
    for (uint32_t d = 0; d < 3; d++) p->x[d][lane] = x[d];
    p->stream[lane] = (int32_t)x[PLACE_RANDOM];
    p->first[lane] = fmod(0.5 + 0.61803398874989485 * x[PLACE_RANDOM], 1);
}

bool watch_run(Probe *p) {
    static const double zero[WARN_LANES];
    size_t cells = (size_t)p->n * WARN_LANES;
    SltKernelArgs a = {
        .params = p->params, .iparams = p->program->init_ints, .resolution = {512, 512}, .n_valid = WARN_LANES};
    for (uint32_t s = 0; s < SLT_IN_VARYING; s++) a.in[s] = zero;
    for (uint32_t d = 0; d < 3; d++) a.in[IN_X0 + d] = p->x[d];
    a.in[SLT_IN_RAND0] = p->first, a.in[SLT_IN_STREAM] = p->stream;
    for (uint32_t c = 0; c < p->program->channels; c++) a.out[c] = p->f[c];
    memset(p->seen, 0, cells * sizeof *p->seen);
    memset(p->value, 0, cells * sizeof *p->value), memset(p->argument, 0, cells * sizeof *p->argument);
    for (size_t i = 0; i < cells; i++) p->near[i] = HUGE_VAL;
    p->failed |= !p->interp || ir_interp_run(p->interp, &a, WARN_LANES, &p->fuel, 0, watch, p) != SLT_OK;
    return !p->failed;
}
