/* The provenance hash: which definitions reached the outputs, instead of which way the path went. It is used above 64
 * events a sample.
 *
 * Every value has the set of hash atoms that its origin depends on. An ordinary operation has the union of its
 * operands' sets; at a join (if_ result or select) under a condition that depends on a jump, the value that comes
 * through is told apart: atom = cond ? key and hash(then) : hash(else). So an opaque disc painted over others forgets
 * them, and a crossing that is hidden changes nothing: in painter's-order discs and Voronoi 61 to 77 % of the crossings
 * that the path hash finds have no jump. Two points with equal hashes compute their outputs by the same chain of
 * definitions, hence one continuous piece of f.
 *
 * Carried values of a loop carry their hash along; those that start alike and are updated alike share one (the channels
 * of a colour). Programs with local arrays keep the path hash. Sites of skipped loops are added by path: their uses lie
 * before them. */
#include <string.h>

#include "compiler/pass/variant.h"

typedef struct Set {
    uint32_t n;
    Inst **atom; /* sorted by first appearance (serial) */
    struct Set *next;
} Set;

typedef struct Join {
    const Inst *at; /* if_, loop or condition */
    const Set *x, *y;
    Set *result;
    struct Join *next;
} Join;

typedef struct Prov {
    Fn *fn;
    Arena *arena;
    Set **of;              /* by id; NULL: empty */
    const Inst **original; /* by id: what was there before this pass; new instructions have no id of their own */
    uint8_t *dep;          /* by id: may depend on a jump */
    uint32_t nids;
    Set *interned;
    Inst *loops[64]; /* k of the enclosing loops */
    uint32_t depth;
    bool changed;
} Prov;

static bool is_original(const Prov *p, const Inst *v) { return v->id < p->nids && p->original[v->id] == v; }
static Set *set_of(Prov *p, const Inst *v) { return is_original(p, v) ? p->of[v->id] : NULL; }

static void note_originals(Prov *p, const Block *b) {
    for (uint32_t a = 0; a < b->nparams; a++) p->original[b->params[a]->id] = b->params[a];
    for (const Inst *i = b->first; i; i = i->next) {
        p->original[i->id] = i;
        for (uint32_t r = 0; r < i->nregions; r++) note_originals(p, i->region[r]);
    }
}

static Set *set_intern(Prov *p, Inst *const *atoms, uint32_t n) {
    if (!n) return NULL;
    for (Set *s = p->interned; s; s = s->next)
        if (s->n == n && !memcmp(s->atom, atoms, n * sizeof *atoms)) return s;
    Set *s = ARENA_NEW(p->arena, Set);
    s->n = n;
    s->atom = arena_copy(p->arena, atoms, n * sizeof *atoms);
    s->next = p->interned;
    return p->interned = s;
}

/* Atoms are ordered by tag, their serial number: equal sets are equal pointers. */
static Set *set_union(Prov *p, Set *a, Set *b) {
    if (!a || a == b) return b;
    if (!b) return a;
    Inst *all[64];
    uint32_t n = 0, i = 0, j = 0;
    while ((i < a->n || j < b->n) && n < 64) {
        Inst *x = i < a->n ? a->atom[i] : NULL, *y = j < b->n ? b->atom[j] : NULL;
        if (x && y && x == y) all[n++] = x, i++, j++;
        else if (x && (!y || x->tag < y->tag)) all[n++] = x, i++;
        else all[n++] = y, j++;
    }
    return set_intern(p, all, n);
}

static Set *set_single(Prov *p, Inst *atom) { return set_intern(p, &atom, 1); }

/* One int for a set. */
static Inst *set_hash(Prov *p, Builder *b, const Set *s) {
    (void)p;
    if (!s) return ir_consti(b, 0);
    Inst *h = s->atom[0];
    for (uint32_t i = 1; i < s->n; i++) h = ir_mix_inst(b, h, s->atom[i]);
    return h;
}

/* ---- which values may depend on a jump: a fixpoint */
static void dep_add(Prov *p, const Inst *i, bool d) {
    if (d && !p->dep[i->id]) p->dep[i->id] = 1, p->changed = true;
}

static void dep_block(Prov *p, Block *b) {
    for (Inst *i = b->first; i; i = i->next) {
        bool d = variant_is_site(i);
        for (uint32_t a = 0; a < i->nargs && !variant_is_site(i); a++) d |= p->dep[i->args[a]->id];
        if (i->op == OP_loop)
            for (uint32_t c = 0; c < i->nargs; c++)
                dep_add(p, i->region[0]->params[c + 1],
                        p->dep[i->args[c]->id] | p->dep[i->region[0]->last->args[c + 1]->id]);
        for (uint32_t r = 0; r < i->nregions; r++) dep_block(p, i->region[r]);
        if (i->op == OP_proj) {
            Inst *o = i->args[0];
            d = p->dep[o->op == OP_if_ ? o->args[0]->id : o->region[0]->last->args[0]->id] != 0;
            for (uint32_t r = 0; r < o->nregions; r++) d |= p->dep[walk_results(o, o->region[r])[i->imm.i]->id];
        }
        if (i->op == OP_if_ || i->op == OP_loop) d = false; /* its projections have the flag */
        dep_add(p, i, d);
    }
}

/* ---- building */
static Inst *join_key(Prov *p, Builder *b, const Inst *at, const Inst *cond) {
    if (cond && cond->op == OP_site) return variant_event_key(b, cond);
    Inst *key = ir_consti(b, (int32_t)ir_mix(0x85ebca6bu, at->id + 1u));
    for (uint32_t l = 0; l < p->depth && l < 64; l++) key = ir_mix_inst(b, key, p->loops[l]);
    return key;
}

/* The hash of what comes through a join that was decided by `key`. That key may be in it already, where what hangs on
 * the decision is computed from what hangs on it, too (`h.hit ? f(h.t) : 0`): with xor the two would leave nothing, and
 * both sides would look alike. */
static Inst *taken(Builder *b, Inst *hash, Inst *key) {
    return ir_emit2(b, OP_iadd, ir_emit2(b, OP_imul, hash, ir_consti(b, (int32_t)0x9e3779b1u)), key);
}

/* An untagged comparison of values that depend on jumps (which triangle, which texel) decides nothing that `event`
 * could name: a join under it is no jump of its own, and has the origins of its condition and of both sides. */
static bool compares(const Inst *c) {
    const OpInfo *o = &ir_ops[c->op];
    if (o->compares) return true;
    if (o->arg != TY_BOOL || o->selects) return false;
    return compares(c->args[0]) || (o->nargs > 1 && compares(c->args[1]));
}

static Inst *mark_atom(Inst *i, uint32_t *next) {
    i->id = UINT32_MAX;
    i->tag = ++*next;
    return i;
}

static void prov_block(Prov *p, Block *b, uint32_t *next);

static void prov_if(Prov *p, Inst *i, uint32_t *next) {
    prov_block(p, i->region[0], next);
    prov_block(p, i->region[1], next);
    Inst **x = i->region[0]->last->args, **y = i->region[1]->last->args;
    Set *sc = set_of(p, i->args[0]);
    Join *joins = NULL;
    uint32_t results = ir_nresults(i);
    Inst *last = i;
    while (last->next && last->next->op == OP_proj && last->next->args[0] == i) last = last->next;
    for (Inst *q = i->next; q && q->op == OP_proj && q->args[0] == i && q->imm.i < (int64_t)results; q = q->next) {
        if (!is_original(p, q)) continue;
        uint32_t r = (uint32_t)q->imm.i;
        Set *sx = set_of(p, x[r]), *sy = set_of(p, y[r]);
        if (x[r] == y[r] || (!sc && sx == sy)) {
            p->of[q->id] = sx;
            continue;
        }
        Join *j = joins;
        while (j && !(j->x == sx && j->y == sy)) j = j->next;
        if (!j) {
            Builder bx = ir_before(p->fn, i->region[0]->last), by = ir_before(p->fn, i->region[1]->last);
            bx.fold = by.fold = true;
            Inst *hx = set_hash(p, &bx, sx), *hy = set_hash(p, &by, sy);
            if (sc && !compares(i->args[0])) hx = taken(&bx, hx, join_key(p, &bx, i, i->args[0]));
            ir_append_arg(p->fn, i->region[0]->last, hx);
            ir_append_arg(p->fn, i->region[1]->last, hy);
            x = i->region[0]->last->args, y = i->region[1]->last->args;
            Builder after = ir_after(p->fn, last);
            Inst *atom = mark_atom(ir_proj(&after, i, ir_nresults(i) - 1), next);
            last = atom;
            j = ARENA_NEW(p->arena, Join);
            *j = (Join){i, sx, sy, set_single(p, atom), joins};
            if (sc && compares(i->args[0])) j->result = set_union(p, sc, j->result);
            joins = j;
        }
        p->of[q->id] = j->result;
    }
}

/* One attempt at a loop with the given groups: group[c] is the carried hash of value c, or none (UINT32_MAX). False if
 * members of a group part. */
static bool prov_loop_try(Prov *p, Inst *loop, uint32_t *group, uint32_t ngroups, Set **init, uint32_t carried,
                          uint32_t *next) {
    Block *body = loop->region[0];
    uint32_t base = loop->nargs;
    Inst **param = ARENA_ARRAY(p->arena, Inst *, ngroups + 1);
    Builder before = ir_before(p->fn, loop);
    before.fold = true;
    for (uint32_t g = 0; g < ngroups; g++) {
        ir_append_arg(p->fn, loop, set_hash(p, &before, init[g]));
        param[g] = mark_atom(ir_block_param(p->fn, body, TY_INT), next);
    }
    for (uint32_t c = 0; c < carried; c++)
        p->of[body->params[c + 1]->id] = group[c] == UINT32_MAX ? NULL : set_single(p, param[group[c]]);
    if (p->depth < 64) p->loops[p->depth] = body->params[0];
    p->depth++;
    prov_block(p, body, next);
    p->depth--;
    Set **out = ARENA_ARRAY(p->arena, Set *, ngroups + 1);
    bool *seen = ARENA_ARRAY(p->arena, bool, ngroups + 1), fits = true;
    for (uint32_t c = 0; c < carried; c++) {
        if (group[c] == UINT32_MAX) continue;
        Set *s = set_of(p, body->last->args[c + 1]);
        if (!seen[group[c]]) seen[group[c]] = true, out[group[c]] = s;
        else fits &= out[group[c]] == s;
    }
    /* Even a failed attempt must leave a sound loop; the hashes that it carries die in the slice. */
    Builder end = ir_before(p->fn, body->last);
    end.fold = true;
    for (uint32_t g = 0; g < ngroups; g++) ir_append_arg(p->fn, body->last, set_hash(p, &end, out[g]));
    if (!fits) return false;
    /* Where the exit depends on a jump, so do the results: the iteration of the exit joins them. */
    Set *leaves = set_of(p, body->last->args[0]), *exit = NULL;
    Inst *last = loop;
    while (last->next && last->next->op == OP_proj && last->next->args[0] == loop) last = last->next;
    uint32_t first = base;
    Builder after = ir_after(p->fn, last);
    if (leaves) {
        Inst *k = ir_mix_inst(&end, join_key(p, &end, loop, NULL), body->params[0]);
        ir_append_arg(p->fn, loop, ir_consti(&before, 0));
        ir_block_param(p->fn, body, TY_INT);
        ir_append_arg(p->fn, body->last, k);
        exit = set_single(p, mark_atom(ir_proj(&after, loop, ir_nresults(loop) - 1), next));
    }
    Set **result = ARENA_ARRAY(p->arena, Set *, ngroups + 1);
    for (uint32_t g = 0; g < ngroups; g++) result[g] = set_single(p, mark_atom(ir_proj(&after, loop, first + g), next));
    for (Inst *q = loop->next; q && q->op == OP_proj && q->args[0] == loop; q = q->next)
        if (is_original(p, q) && q->imm.i < (int64_t)carried) {
            Set *s = group[q->imm.i] == UINT32_MAX ? NULL : result[group[q->imm.i]];
            bool moves = body->last->args[q->imm.i + 1] != body->params[q->imm.i + 1];
            if (p->dep[q->id] == 0) moves = false;
            p->of[q->id] = moves ? set_union(p, s, exit) : s;
        }
    return true;
}

static void prov_loop(Prov *p, Inst *loop, uint32_t *next) {
    uint32_t carried = 0, ngroups = 0; /* hashes that an earlier attempt of an outer loop added do not count */
    while (carried < loop->nargs && is_original(p, loop->region[0]->params[carried + 1])) carried++;
    uint32_t *group = ARENA_ARRAY(p->arena, uint32_t, carried + 1);
    Set **init = ARENA_ARRAY(p->arena, Set *, carried + 1);
    Block *body = loop->region[0];
    for (uint32_t c = 0; c < carried; c++) {
        group[c] = UINT32_MAX;
        if (!p->dep[body->params[c + 1]->id] && !p->dep[body->last->args[c + 1]->id]) continue;
        Set *s = set_of(p, loop->args[c]);
        for (uint32_t g = 0; g < ngroups; g++)
            if (init[g] == s) group[c] = g;
        if (group[c] == UINT32_MAX) init[ngroups] = s, group[c] = ngroups++;
    }
    if (prov_loop_try(p, loop, group, ngroups, init, carried, next)) return;
    ngroups = 0;
    for (uint32_t c = 0; c < carried; c++)
        if (group[c] != UINT32_MAX) init[ngroups] = set_of(p, loop->args[c]), group[c] = ngroups++;
    prov_loop_try(p, loop, group, ngroups, init, carried, next);
}

static void prov_select(Prov *p, Inst *i, uint32_t *next) {
    Set *sc = set_of(p, i->args[0]), *sx = set_of(p, i->args[1]), *sy = set_of(p, i->args[2]);
    if (!sc && sx == sy) {
        p->of[i->id] = sx;
        return;
    }
    if (compares(i->args[0])) {
        p->of[i->id] = set_union(p, sc, set_union(p, sx, sy));
        return;
    }
    Builder b = ir_after(p->fn, i);
    b.fold = true;
    Inst *hx = set_hash(p, &b, sx), *hy = set_hash(p, &b, sy);
    if (sc) hx = taken(&b, hx, join_key(p, &b, i->args[0], i->args[0]));
    Inst *atom = ir_select(&b, i->args[0], hx, hy);
    p->of[i->id] =
        ir_is_const(atom) ? NULL : set_single(p, atom->tag && atom->id == UINT32_MAX ? atom : mark_atom(atom, next));
}

static void prov_block(Prov *p, Block *b, uint32_t *next) {
    for (Inst *i = b->first, *following; i; i = following) {
        following = i->next;
        if (!is_original(p, i) || i->op == OP_proj || i->op == OP_yield)
            continue; /* made by this pass, or set by its owner */
        if (i->op == OP_if_) {
            prov_if(p, i, next);
            continue;
        }
        if (i->op == OP_loop) {
            prov_loop(p, i, next);
            continue;
        }
        p->of[i->id] = NULL;
        if (!p->dep[i->id]) continue;
        if (variant_is_site(i)) {
            Builder at = ir_after(p->fn, i);
            Inst *key = variant_event_key(&at, i);
            Inst *atom = i->op == OP_site ? ir_select(&at, i, key, ir_consti(&at, 0))
                                          : ir_mix_inst(&at, key, ir_emit1(&at, OP_f2i, i));
            p->of[i->id] = set_single(p, mark_atom(atom, next));
        } else if (ir_ops[i->op].selects) {
            prov_select(p, i, next);
        } else {
            Set *s = NULL;
            for (uint32_t a = 0; a < i->nargs; a++) s = set_union(p, s, set_of(p, i->args[a]));
            p->of[i->id] = s;
        }
    }
}

static bool has_arrays(const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_alloc) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (has_arrays(i->region[r])) return true;
    }
    return false;
}

bool variant_has_provenance(const Fn *fn) { return !has_arrays(fn->body); }

Inst *variant_provenance(PassCtx *ctx, Fn *fn) {
    if (!variant_has_provenance(fn)) return NULL;
    Prov p = {.fn = fn, .arena = &ctx->session->module, .changed = true};
    p.nids = ir_number(fn) + 1;
    p.of = ARENA_ARRAY(p.arena, Set *, p.nids);
    p.dep = ARENA_ARRAY(p.arena, uint8_t, p.nids);
    p.original = ARENA_ARRAY(p.arena, const Inst *, p.nids);
    note_originals(&p, fn->body);
    while (p.changed) {
        p.changed = false;
        dep_block(&p, fn->body);
    }
    uint32_t next = 0;
    prov_block(&p, fn->body, &next);
    Set *all = NULL;
    for (uint32_t o = 0; o < fn->body->last->nargs; o++) all = set_union(&p, all, set_of(&p, fn->body->last->args[o]));
    Builder end = ir_before(fn, fn->body->last);
    end.fold = true;
    return set_hash(&p, &end, all);
}
