/* Reverse mode: running code again.
 *
 * A segment of a strip-mined loop is cloned into the sweep and pushes there (tape_rerun). One iteration of a replayed
 * loop is cloned into the body of its revloop and pushes nothing of its own: the sweep reads its values directly
 * (tape_replay). Searches of a replayed iteration are not repeated, nor are loops that search: what they found is in
 * the frame. If such a loop carries derivatives, it has frames from the first run, and the sweep of it uses these.
 *
 * What a clone reads from outside is not known before the sweep of it has been emitted: most of it may be dead, a sum
 * for example that no rule mentions. So a clone is made over holes; when the scope is closed, those that something
 * alive reads are filled, and only they cost bytes. */
#include <string.h>

#include "compiler/pass/ad_tape.h"

/* ---- what can be run again */

/* Does i read an array from outside the loop that may have been written since? */
static bool reads_past(const Vjp *v, const Inst *i, const Block *loop) {
    return i->op == OP_load && !v->stable[i->id] && !walk_inside(i->args[0]->block, loop);
}

/* Can this block be run again? held: the frame holds what reads_past, unless an inner loop reads it. */
static bool rerunnable(const Vjp *v, const Block *b, const Block *loop, bool held) {
    for (const Inst *i = b->first; i; i = i->next) {
        if ((i->op == OP_store || i->op == OP_acopy) && !walk_inside(i->args[0]->block, loop)) return false;
        if (i->op == OP_acopy && !walk_inside(i->args[1]->block, loop)) return false;
        if (!held && reads_past(v, i, loop)) return false;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (!rerunnable(v, i->region[r], loop, held && i->op != OP_loop)) return false;
    }
    return true;
}
bool tape_can_rerun(const Vjp *v, const Inst *loop) { return rerunnable(v, loop->region[0], loop->region[0], false); }

bool tape_searches(const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_query) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (tape_searches(i->region[r])) return true;
    }
    return false;
}

static bool writes_outside(const Block *b, const Block *loop) {
    for (const Inst *i = b->first; i; i = i->next) {
        if ((i->op == OP_store || i->op == OP_acopy) && !walk_inside(i->args[0]->block, loop)) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (writes_outside(i->region[r], loop)) return true;
    }
    return false;
}

static bool is_search_loop(const Inst *i) { return i->op == OP_loop && tape_searches(i->region[0]); }

/* Is there a loop, not inside another one, that searches and carries derivatives? */
static bool searches_and_differs(const Vjp *v, const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_loop && v->taped[i->id] && (is_search_loop(i) || v->o->replay == AD_REPLAY_KEEP)) return true;
        for (uint32_t r = 0; i->op != OP_loop && r < i->nregions; r++)
            if (searches_and_differs(v, i->region[r])) return true;
    }
    return false;
}

/* Does the second run leave this loop out? What it found is in the frame then. Of loops without derivatives, those that
 * search. Loops with derivatives push frames, which belong to the run that searched: all of them if `keeps`, or frames
 * of two runs would lie in the wrong order. */
static bool left_out(const Vjp *v, const Inst *i, bool keeps) {
    return i->op == OP_loop && (v->taped[i->id] ? keeps : is_search_loop(i));
}

/* May the loops of this block that left_out names be left out? None may write arrays: what it wrote would be missing.
 */
static bool can_leave_out(const Vjp *v, const Block *b, bool keeps) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (left_out(v, i, keeps) && writes_outside(i->region[0], i->region[0])) return false;
        for (uint32_t r = 0; i->op != OP_loop && r < i->nregions; r++)
            if (!can_leave_out(v, i->region[r], keeps)) return false;
    }
    return true;
}

bool tape_keeps(const Vjp *v, const Inst *loop) { return searches_and_differs(v, loop->region[0]); }

bool tape_can_replay(const Vjp *v, const Inst *loop, const Scope *s) {
    const Block *body = loop->region[0];
    bool keeps = tape_keeps(v, loop);
    if (!rerunnable(v, body, body, true) || !can_leave_out(v, body, keeps)) return false;
    /* with one guard its region is reversed in place, so marks of loops that push in the second run would have to cross
     * an if */
    return keeps || s->guards.len != 1 ||
           !vjp_holds_taped(v, s->guards.data[0].branch->region[s->guards.data[0].region]);
}

/* ---- holes */

static Inst *new_hole(Vjp *v, Holes *holes, Inst *primal, Inst *forward, Inst *at) {
    if (!at) {
        at = ARENA_NEW(v->fn->arena, Inst);
        *at = (Inst){.op = OP_arg, .type = primal->type, .id = UINT32_MAX, .span = primal->span};
    }
    vec_push(v->scratch, holes, ((Hole){primal, forward, at}));
    return at;
}

/* What a clone reads in place of x from outside: x itself if that is visible everywhere, else a hole. */
static Inst *from_outside(Vjp *v, Holes *holes, Inst *x) {
    if (x->block == v->fn->body) return x;
    return v->memo[x->id] ? v->memo[x->id] : new_hole(v, holes, x, NULL, NULL);
}

static void map_operands(Vjp *v, Holes *holes, const Block *root, Block *b, Inst **map) {
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t a = 0; a < i->nargs; a++) {
            Inst *x = i->args[a];
            if (x->id < v->f.n && !map[x->id] && x->type != TY_ARRAY && !walk_inside(x->block, root))
                map[x->id] = from_outside(v, holes, x);
        }
        for (uint32_t r = 0; r < i->nregions; r++) map_operands(v, holes, root, i->region[r], map);
    }
}

/* keeper: the scope of the replay, or NULL; loops that it keeps, and the ifs around them, push where they did. */
static void note_instances(Vjp *v, Block *b, Inst **map, const Scope *keeper) {
    bool keeps = keeper && keeper->keeps;
    for (uint32_t p = 0; p < b->nparams; p++) v->fwd[b->params[p]->id] = map[b->params[p]->id];
    for (Inst *i = b->first; i; i = i->next) {
        if (keeper && left_out(v, i, keeps)) continue;
        v->run[i->id] =
            keeps && i->op == OP_if_ && (vjp_holds_taped(v, i->region[0]) || vjp_holds_taped(v, i->region[1]))
                ? tape_run(v, i)
                : NULL;
        v->fwd[i->id] = map[i->id];
        for (uint32_t r = 0; r < i->nregions; r++) note_instances(v, i->region[r], map, keeper);
    }
}

/* What the first run did to the world is done: the second run must not count or print again. */
static void drop_effects(Block *b) {
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) drop_effects(i->region[r]);
        if (i->op == OP_count || i->op == OP_print) ir_unlink(i);
    }
}

Inst *tape_rerun(Vjp *v, Scope *s, Inst *loop) {
    Inst **map = ARENA_ARRAY(v->scratch, Inst *, v->f.n + 1);
    for (uint32_t a = 0; a < loop->nargs; a++)
        if (!map[loop->args[a]->id]) map[loop->args[a]->id] = from_outside(v, &s->rerun_holes, loop->args[a]);
    map_operands(v, &s->rerun_holes, loop->region[0], loop->region[0], map);
    Builder b = vjp_builder(v);
    ir_clone_insts(&b, loop->block, loop, loop->next, map);
    Inst *copy = map[loop->id];
    v->fwd[loop->id] = copy;
    note_instances(v, loop->region[0], map, NULL);
    drop_effects(copy->region[0]);
    return copy;
}

static void hold_found(Vjp *v, Scope *s, const Block *body, Block *b) {
    for (Inst *i = b->first; i; i = i->next) {
        bool found =
            i->op == OP_query || reads_past(v, i, body) || (i->op == OP_proj && left_out(v, i->args[0], s->keeps));
        if (found)
            new_hole(v, &s->replay_holes, i, tape_forward(v, i), ir_block_param(v->fn, s->rev_block, (IrType)i->type));
        for (uint32_t r = 0; !left_out(v, i, s->keeps) && r < i->nregions; r++) hold_found(v, s, body, i->region[r]);
    }
}

static void drop_left_out(Vjp *v, const Scope *s, Block *b, Inst **map) {
    for (Inst *i = b->first; i; i = i->next) {
        if (left_out(v, i, s->keeps)) {
            ir_unlink(map[i->id]);
            continue;
        }
        for (uint32_t r = 0; r < i->nregions; r++) drop_left_out(v, s, i->region[r], map);
    }
}

void tape_replay(Vjp *v, Scope *s, Block *body) {
    Inst **map = ARENA_ARRAY(v->scratch, Inst *, v->f.n + 1);
    s->k = map[body->params[0]->id] = ir_block_param(v->fn, s->rev_block, TY_INT);
    for (uint32_t p = 1; p < body->nparams; p++) {
        Inst *param = body->params[p];
        map[param->id] = new_hole(v, &s->replay_holes, param, tape_forward(v, param),
                                  ir_block_param(v->fn, s->rev_block, (IrType)param->type));
        v->memo[param->id] = map[param->id];
    }
    v->memo[body->params[0]->id] = s->k;
    uint32_t first = s->replay_holes.len;
    hold_found(v, s, body, body);
    uint32_t last = s->replay_holes.len;
    map_operands(v, &s->replay_holes, body, body, map);
    Builder b = {.fn = v->fn, .block = s->rev_block, .span = s->owner->span};
    ir_clone_insts(&b, body, body->first, body->last, map);
    note_instances(v, body, map, s);
    drop_left_out(v, s, body, map);
    for (uint32_t h = first; h < last; h++) {
        const Hole *w = &s->replay_holes.data[h];
        walk_forward(v->fn, map[w->primal->id], w->at);
        v->fwd[w->primal->id] = v->memo[w->primal->id] = w->at;
    }
    walk_resolve_forwards(s->rev_block);
    drop_effects(s->rev_block);
    if (s->guards.len == 1) { /* in every iteration that is visited the guard was taken */
        Guard g = s->guards.data[0];
        Builder top = {.fn = v->fn, .block = s->rev_block, .before = s->rev_block->first, .span = s->owner->span};
        ir_replace_arg(tape_forward(v, g.branch), 0, ir_constb(&top, g.region == 0));
    }
}

/* ---- what of a clone is alive. Only instructions inside the block are marked; ids do not help here, most of this code
 * is new. */

enum { LIVE = 1, INSIDE = 2 };

typedef struct Live {
    Vjp *v;
    Vec(Inst *) work, writes;
} Live;

static void mark(Live *l, Inst *i) {
    if ((i->flags & (LIVE | INSIDE)) != INSIDE) return;
    i->flags |= LIVE;
    vec_push(l->v->scratch, &l->work, i);
}

static void enter(Live *l, Inst *i);
static void enter_block(Live *l, Block *b) {
    for (uint32_t p = 0; p < b->nparams; p++) b->params[p]->flags = INSIDE;
    for (Inst *i = b->first; i; i = i->next) enter(l, i);
}
static void enter(Live *l, Inst *i) {
    i->flags = INSIDE;
    if (i->op == OP_store || i->op == OP_acopy) vec_push(l->v->scratch, &l->writes, i);
    for (uint32_t r = 0; r < i->nregions; r++) enter_block(l, i->region[r]);
}

static void mark_roots(Live *l, Block *b) {
    for (Inst *i = b->first; i; i = i->next) {
        bool outside = (i->op == OP_store || i->op == OP_acopy) && !(i->args[0]->flags & INSIDE);
        if (i->op == OP_adj || i->op == OP_tapepush || i->op == OP_revloop || outside) mark(l, i);
        for (uint32_t r = 0; r < i->nregions; r++) mark_roots(l, i->region[r]);
    }
}

static void mark_param(Live *l, const Inst *i) {
    const Inst *owner = i->block ? i->block->owner : NULL; /* a hole is in no block */
    if (!owner || !(owner->flags & INSIDE)) return;
    mark(l, (Inst *)owner);
    uint32_t index = (uint32_t)i->imm.i, frame = owner->op == OP_revloop ? i->block->nparams - (owner->nargs - 1) : 0;
    if (owner->op == OP_loop && index > 0) {
        mark(l, owner->args[index - 1]);
        mark(l, i->block->last->args[index]);
    } else if (owner->op == OP_revloop && index >= frame) {
        mark(l, owner->args[1 + index - frame]);
        mark(l, i->block->last->args[index - frame]);
    }
}

static void propagate(Live *l, Inst *i) {
    if (i->op == OP_arg) {
        mark_param(l, i);
        return;
    }
    if (i->block->owner) mark(l, i->block->owner);
    switch (i->op) {
    case OP_proj: {
        Inst *owner = i->args[0];
        uint32_t index = (uint32_t)i->imm.i;
        mark(l, owner);
        for (uint32_t r = 0; r < owner->nregions; r++) mark(l, walk_results(owner, owner->region[r])[index]);
        if (owner->op != OP_if_) mark(l, owner->args[index + (owner->op == OP_revloop)]);
        return;
    }
    case OP_loop: mark(l, i->region[0]->last->args[0]); return; /* the flag to go on */
    case OP_revloop: mark(l, i->args[0]); return;
    case OP_alloc:
        for (uint32_t w = 0; w < l->writes.len; w++)
            if (l->writes.data[w]->args[0] == i) mark(l, l->writes.data[w]);
        return;
    default:
        for (uint32_t a = 0; a < i->nargs; a++) mark(l, i->args[a]);
    }
}

static void find_live(Vjp *v, const Holes *holes, Block *root, Inst *owner) {
    Live l = {.v = v};
    for (uint32_t h = 0; h < holes->len; h++) holes->data[h].at->flags = INSIDE;
    if (owner) enter(&l, owner);
    else enter_block(&l, root);
    mark_roots(&l, root);
    if (!owner)
        for (uint32_t a = 0; a < root->last->nargs; a++) mark(&l, root->last->args[a]);
    for (uint32_t n = 0; n < l.work.len; n++) propagate(&l, l.work.data[n]);
}

/* ---- filling the holes */

static void forward_hole(Vjp *v, const Hole *h, Inst *to) {
    h->at->op = OP_COUNT;
    h->at->args = ARENA_ARRAY(v->fn->arena, Inst *, 1);
    h->at->nargs = 1;
    h->at->args[0] = to;
}

static Inst *zero_like(Builder *b, Inst *zeros[], const Inst *like) {
    Inst **z = &zeros[like->type];
    if (!*z) *z = ir_zero(b, (IrType)like->type);
    return *z;
}

void tape_fill_replay(Vjp *v, Scope *s) {
    Block *b = s->rev_block;
    find_live(v, &s->replay_holes, b, NULL);
    Inst *zeros[TY_TAPE + 1] = {0};
    Builder top = {.fn = v->fn, .block = b, .before = b->first, .span = s->owner->span};
    if (!(s->k->flags & LIVE)) {
        walk_replace(b, s->k, ir_consti(&top, 0));
        s->k = NULL;
    }
    for (uint32_t n = 0; n < s->replay_holes.len; n++) {
        Hole *h = &s->replay_holes.data[n];
        if (!(h->at->flags & LIVE)) forward_hole(v, h, zero_like(&top, zeros, h->at));
        else if (h->forward) tape_store(v, s, h->forward, h->at, h->primal);
        else forward_hole(v, h, tape_value(v, h->primal));
    }
    walk_resolve_forwards(b);
}

void tape_fill_rerun(Vjp *v, Scope *s, Inst *mark_of_tape, Inst *rev) {
    Inst *copy = tape_forward(v, s->owner);
    find_live(v, &s->rerun_holes, copy->region[0], copy);
    Inst *zeros[TY_TAPE + 1] = {0};
    Builder before = {.fn = v->fn, .block = rev->block, .before = rev, .span = s->owner->span};
    for (uint32_t n = 0; n < s->rerun_holes.len; n++) {
        Hole *h = &s->rerun_holes.data[n];
        forward_hole(v, h, h->at->flags & LIVE ? tape_value(v, h->primal) : zero_like(&before, zeros, h->at));
    }
    for (uint32_t a = 0; a < copy->nargs; a++)
        while (copy->args[a]->op == OP_COUNT) copy->args[a] = copy->args[a]->args[0];
    walk_resolve_forwards(copy->region[0]);
    /* what fills the holes was emitted here */
    if (mark_of_tape) ir_move_before(mark_of_tape, rev);
    if (copy->flags & LIVE) ir_move_before(copy, rev);
    else ir_unlink(copy);
}
