/* [SkipLoop] on a march by equal steps whose result depends on the step.
 *
 * One boundary of all iterations is right where what the loop hands on is continuous in x although the number of steps
 * is not: where each step goes on by what the comparison found, as sphere tracing does. A march by steps that do not
 * ask (the iteration number, t += 0.01) and that hands on something of the step (t, the number, a sum) jumps from one
 * number of steps to the next, inside of what was hit. Then every iteration gets a boundary of its own, as without
 * [SkipLoop], and a warning says so. */
#include <string.h>

#include "compiler/pass/walk.h"

typedef struct Skips {
    Fn *fn;
    Arena *scratch;
    bool *seen; /* by id */
    Vec(Inst *) work;
} Skips;

static void look(Skips *s, Inst *i) {
    if (s->seen[i->id]) return;
    s->seen[i->id] = true;
    vec_push(s->scratch, &s->work, i);
}

/* What the value i is made of, whatever decides between them: operands, the values that an if_ or a loop may hand on.
 */
static void look_behind(Skips *s, const Inst *i) {
    const Block *b = i->block;
    if (i->op == OP_proj) {
        Inst *op = i->args[0];
        uint32_t at = (uint32_t)i->imm.i + (op->op == OP_loop);
        look(s, op->region[0]->last->args[at]);
        if (op->op == OP_if_) look(s, op->region[1]->last->args[at]);
        if (op->op == OP_loop) look(s, op->args[at - 1]);
    } else if (i->op == OP_arg && b->owner && b->owner->op == OP_loop) {
        if (i->imm.i > 0) look(s, b->owner->args[i->imm.i - 1]), look(s, b->last->args[i->imm.i]);
    } else if (i->op == OP_arg && b->owner) {
        if ((uint32_t)i->imm.i < b->owner->nargs) look(s, b->owner->args[i->imm.i]);
    } else {
        for (uint32_t a = 0; a < i->nargs; a++) look(s, i->args[a]);
    }
}

static void clear(Skips *s) {
    memset(s->seen, 0, s->fn->ninsts * sizeof *s->seen);
    s->work.len = 0;
}

static bool is_counter(const Inst *i) {
    return i->op == OP_arg && i->imm.i == 0 && i->block->owner && i->block->owner->op == OP_loop;
}

static bool is_carried(const Inst *i) {
    return i->op == OP_arg && i->imm.i > 0 && i->block->owner && i->block->owner->op == OP_loop;
}

static Inst *next_of(const Inst *carried) { return carried->block->last->args[carried->imm.i]; }

/* The same value in the next iteration, but for what the iteration decides: v itself, or constants instead of it? */
static bool keeps(const Inst *v, const Inst *carried, uint32_t depth) {
    if (v == carried || ir_is_const(v)) return true;
    if (v->op != OP_proj || v->args[0]->op != OP_if_ || !depth) return false;
    const Inst *op = v->args[0];
    for (uint32_t r = 0; r < 2; r++)
        if (!keeps(op->region[r]->last->args[v->imm.i], carried, depth - 1)) return false;
    return true;
}

enum { MOST_DEPTH = 64 };

/* Is the next value made of this one, other than by keeping it? */
static bool accumulates(Skips *s, Inst *next, const Inst *carried, uint32_t depth) {
    if (next == carried) return false;
    if (next->op == OP_proj && next->args[0]->op == OP_if_ && depth) {
        Inst *op = next->args[0];
        return accumulates(s, op->region[0]->last->args[next->imm.i], carried, depth - 1) ||
               accumulates(s, op->region[1]->last->args[next->imm.i], carried, depth - 1);
    }
    clear(s);
    look(s, next);
    while (s->work.len) {
        const Inst *i = s->work.data[--s->work.len];
        if (i == carried) return true;
        if (i->type != TY_BOOL) look_behind(s, i);
    }
    return false;
}

/* Does the result have something of the step in it: the iteration number, or what is carried and made of itself? A bool
 * says whether, not when. Memory: who knows. */
static bool shows_step(Skips *s, Skips *inner) {
    clear(s);
    const Inst *outputs = s->fn->body->last;
    for (uint32_t i = 0; i < outputs->nargs; i++) look(s, outputs->args[i]);
    while (s->work.len) {
        const Inst *i = s->work.data[--s->work.len];
        if (i->type == TY_BOOL) continue;
        if (is_counter(i) || i->op == OP_load) return true;
        if (is_carried(i) && accumulates(inner, next_of(i), i, MOST_DEPTH)) return true;
        look_behind(s, i);
    }
    return false;
}

/* next = carried + step, along every way through the iteration that changes it: adds the steps to `work`. */
static bool adds_steps(Skips *s, Inst *next, const Inst *carried, uint32_t depth) {
    if (next == carried) return true;
    if (!depth) return false;
    if (next->op == OP_proj && next->args[0]->op == OP_if_) {
        Inst *op = next->args[0];
        return adds_steps(s, op->region[0]->last->args[next->imm.i], carried, depth - 1) &&
               adds_steps(s, op->region[1]->last->args[next->imm.i], carried, depth - 1);
    }
    bool sum = next->op == OP_fadd || next->op == OP_iadd, difference = next->op == OP_fsub || next->op == OP_isub;
    for (uint32_t a = 0; (sum && a < 2) || (difference && a < 1); a++)
        if (adds_steps(s, next->args[a], carried, depth - 1)) {
            look(s, next->args[1 - a]);
            return true;
        }
    return false;
}

/* Is g, of an iteration, that of a place which the number of the iteration gives? */
static bool equal_steps(Skips *s, Inst *g0, Inst *g1) {
    Vec(const Inst *) carried = {0};
    clear(s);
    look(s, g0), look(s, g1);
    while (s->work.len) {
        const Inst *i = s->work.data[--s->work.len];
        if (i->op == OP_load || i->op == OP_query) return false;
        if (is_carried(i)) vec_push(s->scratch, &carried, i);
        else look_behind(s, i);
    }
    for (uint32_t c = 0; c < carried.len; c++) {
        clear(s);
        Inst *next = next_of(carried.data[c]);
        if (keeps(next, carried.data[c], MOST_DEPTH)) continue;
        if (!adds_steps(s, next, carried.data[c], MOST_DEPTH)) return false;
        while (s->work.len) {
            const Inst *i = s->work.data[--s->work.len];
            if (is_carried(i) || i->op == OP_load || i->op == OP_query) return false;
            look_behind(s, i);
        }
    }
    return true;
}

static void drop_skipped(Fn *fn, Block *b) {
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) drop_skipped(fn, i->region[r]);
        if (i->op == OP_site && fn->sites[i->imm.i].skip_loop) ir_unlink(i);
    }
}

bool opt_skips(PassCtx *ctx, Fn *fn) {
    const Program *p = ctx->program;
    uint32_t count = 0;
    for (uint32_t u = 0; p && u < p->nuntracked; u++) count += p->untracked[u].kind == JUMP_SKIPPED;
    if (!count) return false;
    Arena *scratch = &ctx->session->scratch;
    ArenaMark at = arena_mark(scratch);
    uint32_t n = ir_number(fn) + 1;
    Skips s = {.fn = fn, .scratch = scratch, .seen = ARENA_ARRAY(scratch, bool, n)},
          inner = {.fn = fn, .scratch = scratch, .seen = ARENA_ARRAY(scratch, bool, n)};
    const Untracked *equal = NULL;
    bool shows = shows_step(&s, &inner);
    for (uint32_t u = 0; u < p->nuntracked && shows && !equal; u++) {
        const Untracked *t = &p->untracked[u];
        if (t->kind == JUMP_SKIPPED && equal_steps(&s, t->g0, t->g1)) equal = t;
    }
    if (equal) {
        diag_emit(ctx->session, DIAG_equal_steps, equal->span);
        SiteInfo *sites = ARENA_ARRAY(fn->arena, SiteInfo, fn->nsites + count);
        memcpy(sites, fn->sites, fn->nsites * sizeof *sites);
        drop_skipped(fn, fn->body);
        fn->sites = sites;
        for (uint32_t u = 0; u < p->nuntracked; u++) {
            const Untracked *t = &p->untracked[u];
            if (t->kind != JUMP_SKIPPED) continue;
            sites[fn->nsites] = (SiteInfo){.kind = SITE_COMPARE, .span = t->span, .text = "every step"};
            walk_make_site(fn, t->at, t->g0, t->g1, &sites[fn->nsites]);
        }
    }
    arena_reset(scratch, at);
    return equal != NULL;
}
