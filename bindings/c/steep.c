/* Warnings of changes of f that neither its slope nor a decision explains (runtime/sample/steep.h), with the operation
 * that makes them: f is interpreted at both ends, and of all operations that differ the one that differs by most for
 * how much its operands do is named. Where a decision differs that has been warned about, or that [NoDisc] says does
 * not matter, nothing is said or added. */
#include <math.h>
#include <string.h>

#include "bindings/c/api.h"
#include "runtime/sample/steep.h"

enum { ENDS = 2, FUEL = 1 << 24, LANES = 64, NUMBERS = 8 /* random numbers of a sample that are varied */ };

typedef struct Tracing {
    const SltProgram *p;
    double most;    /* change of a result / largest change of its operands */
    Span culprit;   /* of that operation */
    bool explained; /* by a decision */
} Tracing;

static double number(const Tracing *t, const Inst *i, const void *values, uint32_t end) {
    if (i->type != TY_FLT) return ((const int32_t *)values)[end];
    return t->p->opt.f64 ? ((const double *)values)[end] : (double)((const float *)values)[end];
}

static bool decides(const Inst *i) {
    if (i->op == OP_site || i->op == OP_siten || i->op == OP_if_ || i->op == OP_loop || i->op == OP_proj) return false;
    return i->type == TY_INT || i->type == TY_BOOL || i->op == OP_ffloor || i->op == OP_fceil || i->op == OP_fround ||
           i->op == OP_ftrunc;
}

static bool same_place(Span a, Span b) { return a.file >= 0 && a.file == b.file && a.pos == b.pos && a.len == b.len; }

static bool spoken_for(const SltProgram *p, Span s) {
    for (uint32_t i = 0; i < p->prog->nsilenced; i++)
        if (same_place(p->prog->silenced[i], s)) return true;
    for (const Diag *d = p->session->diags; d; d = d->next)
        if (d->severity == SEV_WARNING && d->code != DIAG_steep && same_place(d->span, s)) return true;
    return false;
}

static void watch(void *user, const Inst *i, const void *const *slot, const uint8_t *on) {
    Tracing *t = user;
    if (!on[0] || !on[1] || ir_is_const(i) || (i->type != TY_FLT && i->type != TY_INT && i->type != TY_BOOL)) return;
    double a = number(t, i, slot[i->id], 0), b = number(t, i, slot[i->id], 1), operands = 0;
    if (a == b || (isnan(a) && isnan(b))) return;
    if (decides(i)) t->explained |= spoken_for(t->p, i->span);
    for (uint32_t k = 0; k < i->nargs; k++) {
        const Inst *arg = i->args[k];
        if (arg->type != TY_FLT) continue;
        double d = fabs(number(t, arg, slot[arg->id], 1) - number(t, arg, slot[arg->id], 0));
        if (d > operands) operands = d;
    }
    double ratio = operands > 0 ? fabs(b - a) / operands : 0;
    if (isfinite(operands) && !(ratio <= t->most) && i->span.file >= 0)
        t->most = isnan(ratio) ? HUGE_VAL : ratio, t->culprit = i->span;
}

/* f at both ends, under the eye of `watch`. */
static bool trace(Tracing *t, const SteepPlace *at) {
    const SltProgram *p = t->p;
    double in[3][ENDS], zero[ENDS] = {0}, rand[ENDS];
    int32_t stream[ENDS] = {at->stream, at->stream};
    SltKernelArgs a = {
        .params = p->flt, .iparams = p->scene.iparams, .geometries = p->scene.geometries, .resolution = {1, 1}};
    for (uint32_t s = 0; s < SLT_IN_VARYING; s++) a.in[s] = zero;
    for (uint32_t d = 0; d < 3; d++) {
        for (uint32_t e = 0; e < ENDS; e++) {
            double x = e ? at->b[d] : at->a[d];
            if (p->opt.f64) in[d][e] = x, rand[e] = at->rand[e];
            else ((float *)in[d])[e] = (float)x, ((float *)rand)[e] = (float)at->rand[e];
        }
        a.in[IN_X0 + d] = in[d];
    }
    a.in[SLT_IN_STREAM] = stream, a.in[SLT_IN_RAND0] = rand;
    uint64_t fuel = FUEL;
    return ir_interpret_watched(p->prog->primal, &a, ENDS, ENDS, &fuel, at->number, watch, t) == SLT_OK;
}

/* SteepPlace was spoken for. Where there is nothing to speak for it that is cheap to know. */
static bool known(void *user, const SteepPlace *at) {
    const SltProgram *p = user;
    if (!p->prog->nsilenced && !p->session->nwarnings) return false;
    Tracing t = {.p = p, .culprit = SPAN_NONE};
    return trace(&t, at) && t.explained;
}

/* ---- random numbers after the first */
static void mark_numbers(const Block *b, uint32_t *numbers) {
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) mark_numbers(i->region[r], numbers);
        if (i->op != OP_rand) continue;
        bool is_const = i->args[0]->op == OP_consti; /* of a loop it is any */
        for (int32_t n = 1; n < NUMBERS; n++)
            if (!is_const || i->args[0]->imm.i == n) *numbers |= 1u << n;
    }
}

static void mix_decisions(void *user, const Inst *i, const void *const *slot, const uint8_t *on) {
    uint32_t *hash = user;
    if (i->op != OP_site && i->op != OP_siten) return;
    const int32_t *v = slot[i->id];
    for (uint32_t l = 0; l < LANES; l++)
        if (on[l]) hash[l] = ir_mix(hash[l], (uint32_t)v[l] ^ (uint32_t)i->imm.i << 20);
}

/* The program itself, interpreted, in the place of the kernel of its value, or of its sides. */
static void vary(void *user, int kind, SltKernelArgs *args, uint32_t n) {
    const Steep *steep = user;
    const SltProgram *p = steep->user;
    const SltLayout *layout = &p->scene.layout[kind];
    size_t bytes = p->opt.f64 ? sizeof(double) : sizeof(float);
    for (uint32_t from = 0; from < n; from += LANES) {
        SltKernelArgs a = *args;
        uint32_t hash[LANES] = {0}, count = n - from < LANES ? n - from : LANES;
        uint64_t fuel = FUEL;
        a.print = NULL, a.n_valid = count;
        memset(a.out, 0, sizeof a.out);
        for (uint32_t s = 0; s < SLT_IN_VARYING; s++)
            a.in[s] = (const char *)args->in[s] + from * (s == SLT_IN_STREAM ? sizeof(int32_t) : bytes);
        for (uint32_t c = 0; c < layout->out[SLT_OUT_F].count; c++)
            a.out[c] = (char *)args->out[layout->out[SLT_OUT_F].first + c] + from * bytes;
        if (ir_interpret_watched(p->prog->primal, &a, count, LANES, &fuel, steep->number, mix_decisions, hash) !=
            SLT_OK)
            memset(a.out[0], 0, count * bytes); /* too long: nothing is said of it */
        if (layout->out[SLT_OUT_HASH].count)
            memcpy((uint32_t *)args->out[layout->out[SLT_OUT_HASH].first] + from, hash, count * sizeof *hash);
    }
}

typedef struct Telling {
    SltProgram *p;
    const Steep *steep;
} Telling;

static void tell(Session *s, void *user) {
    Telling *q = user;
    SltProgram *p = q->p;
    Arena *scratch = &s->scratch;
    ArenaMark m = arena_mark(scratch);
    for (uint32_t i = 0; i < q->steep->n; i++) {
        const SteepPlace *at = &q->steep->place[i];
        Tracing t = {.p = p, .culprit = SPAN_NONE};
        trace(&t, at);
        if (p->steep_told && t.culprit.file < 0) continue;
        p->steep_told |= t.culprit.file < 0;
        const char *x = "", *how;
        for (uint32_t d = 0; d < p->prog->dim; d++) x = arena_printf(scratch, "%s%s%.7g", x, d ? ", " : "", at->a[d]);
        double apart = 0;
        for (uint32_t d = 0; d < 3; d++) apart = fmax(apart, fabs(at->b[d] - at->a[d]));
        how = at->peak                     ? "f has a narrow peak, larger than what was sampled"
              : at->rand[0] != at->rand[1] ? "with rand() f jumps"
              : at->jump                   ? "f jumps"
                                           : arena_printf(scratch, "f changes within %.1g", apart);
        diag_emit(s, DIAG_steep, t.culprit, how, fabs(at->change), p->prog->dim > 1 ? "(" : "", x,
                  p->prog->dim > 1 ? ")" : "");
    }
    arena_reset(scratch, m);
}

SltStatus api_steep(ApiCall *c, SltIntegral *out, uint64_t spent) {
    SltProgram *p = c->p;
    Steep steep = {.known = known, .call = vary, .user = p};
    SltStats own = SLT_STATS_INIT;
    if (slt_estimate_by_differences(c->job.estimator) || (!out && p->steep_looked)) return SLT_OK;
    p->steep_looked |= !out;
    if (p->prog->uses_rand) mark_numbers(p->prog->primal->body, &steep.numbers);
    SltStatus s = slt_estimate_steep(&p->scene, &c->job, out, spent, &steep, &own, c->err);
    if (c->stats) c->stats->evaluations += own.evaluations, c->stats->seconds += own.seconds;
    if (s != SLT_OK || !steep.n) return s;
    Telling q = {.p = p, .steep = &steep};
    int unwound = session_protect(p->session, tell, &q);
    if (unwound) return status_fail(c->err, (SltStatus)unwound, "%s", p->session->unwind_text);
    if (c->stats && c->stats->cells) c->stats->certified = fmin(c->stats->certified, 1 - steep.share);
    return SLT_OK;
}
