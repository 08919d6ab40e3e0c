/* Where gradients go: edges of the primal in one walk, then closures over them. */
#include "compiler/pass/reach.h"

#include <string.h>

#include "compiler/pass/ad.h"
#include "compiler/pass/depend.h"

typedef enum EdgeKind { SMOOTH, VALUE_ONLY, LOST } EdgeKind; /* LOST: of a float whose derivative ends here */
typedef struct Edge {
    uint32_t from, to;
    EdgeKind kind;
} Edge;

typedef struct Table { /* edges by one of their ends: those of id are edge[at[id]] .. edge[at[id + 1] - 1] */
    uint32_t *at, *edge;
} Table;

struct Reach {
    const Program *program;
    Fn *fn;
    Arena *arena;
    uint32_t n;
    const Inst **inst; /* by id */
    Vec(Edge) edges;
    Table out, in;
    uint8_t *flags;             /* by id */
    Vec(const Inst *) controls; /* conditions around the block at hand */
};

static void edge(Reach *r, const Inst *from, const Inst *to, EdgeKind kind) {
    vec_push(r->arena, &r->edges, ((Edge){from->id, to->id, kind}));
}

static void edges_in(Reach *r, const Block *b);

static void into(Reach *r, const Inst *condition, const Block *b) {
    vec_push(r->arena, &r->controls, condition);
    edges_in(r, b);
    r->controls.len--;
}

/* What a region yields becomes a result; of loops the carried value too. */
static void edges_of_results(Reach *r, const Inst *i) {
    for (const Inst *p = i->next; p && p->op == OP_proj && p->args[0] == i; p = p->next) {
        for (uint32_t k = 0; k < i->nregions; k++) {
            if (i->op == OP_custom && k) break; /* the second region is the derivative of the first */
            edge(r, walk_results(i, i->region[k])[p->imm.i], p, SMOOTH);
        }
        if (i->op == OP_if_) edge(r, i->args[0], p, VALUE_ONLY);
        if (i->op == OP_loop) edge(r, i->region[0]->last->args[0], p, VALUE_ONLY);
    }
}

static void edges_of_loop(Reach *r, const Inst *i) {
    const Block *body = i->region[0];
    const Inst *go_on = body->last->args[0];
    for (uint32_t p = 1; p < body->nparams; p++) {
        edge(r, i->args[p - 1], body->params[p], SMOOTH);
        edge(r, body->last->args[p], body->params[p], SMOOTH);
        edge(r, go_on, body->params[p], VALUE_ONLY);
    }
    into(r, go_on, body);
}

static void edges_of_custom(Reach *r, const Inst *i) {
    const Block *body = i->region[0];
    for (uint32_t a = 0; a < i->nargs; a++) {
        edge(r, i->args[a], body->params[a], SMOOTH);
        for (const Inst *p = i->next; p && p->op == OP_proj && p->args[0] == i; p = p->next)
            edge(r, i->args[a], p, i->args[a]->type == TY_FLT ? SMOOTH : VALUE_ONLY);
    }
    edges_in(r, body);
}

static void edges_of_store(Reach *r, const Inst *i) {
    bool copy = i->op == OP_acopy;
    edge(r, i->args[copy ? 1 : 2], i->args[0], SMOOTH);
    if (!copy) edge(r, i->args[1], i->args[0], VALUE_ONLY);
    for (uint32_t k = 0; k < r->controls.len; k++) edge(r, r->controls.data[k], i->args[0], VALUE_ONLY);
}

static void edges_of_row(Reach *r, const Inst *i) {
    for (uint32_t a = 0; a < i->nargs; a++) {
        const Inst *arg = i->args[a];
        bool passes = i->type == TY_FLT && arg->type == TY_FLT && ad_mentions(i, a, NULL, NULL) != UINT32_MAX;
        edge(r, arg, i, passes ? SMOOTH : arg->type == TY_FLT ? LOST : VALUE_ONLY);
    }
}

static void edges_in(Reach *r, const Block *b) {
    for (uint32_t p = 0; p < b->nparams; p++) r->inst[b->params[p]->id] = b->params[p];
    for (const Inst *i = b->first; i; i = i->next) {
        r->inst[i->id] = i;
        switch ((Op)i->op) {
        case OP_if_:
            into(r, i->args[0], i->region[0]);
            into(r, i->args[0], i->region[1]);
            edges_of_results(r, i);
            break;
        case OP_loop:
            edges_of_loop(r, i);
            edges_of_results(r, i);
            break;
        case OP_custom:
            edges_of_custom(r, i);
            edges_of_results(r, i);
            break;
        case OP_store:
        case OP_acopy: edges_of_store(r, i); break;
        case OP_load:
            edge(r, i->args[0], i, SMOOTH);
            edge(r, i->args[1], i, VALUE_ONLY);
            break;
        case OP_ddx:
        case OP_seed:
        case OP_along:
        case OP_ghost: edge(r, i->args[0], i, SMOOTH); break;
        case OP_proj:
        case OP_yield:
        case OP_print:
        case OP_count: break;
        default:
            if (!ir_ops[i->op].special) {
                edges_of_row(r, i);
                break;
            }
            for (uint32_t a = 0; a < i->nargs; a++) /* of a site: its boundary function is asked for on its own */
                edge(r, i->args[a], i,
                     i->args[a]->type == TY_FLT && i->op != OP_site && i->op != OP_siten ? LOST : VALUE_ONLY);
        }
    }
}

static Table table(const Reach *r, bool by_from) {
    Table t = {ARENA_ARRAY(r->arena, uint32_t, r->n + 2), ARENA_ARRAY(r->arena, uint32_t, r->edges.len + 1)};
    for (uint32_t e = 0; e < r->edges.len; e++) t.at[(by_from ? r->edges.data[e].from : r->edges.data[e].to) + 2]++;
    for (uint32_t i = 2; i < r->n + 2; i++) t.at[i] += t.at[i - 1];
    for (uint32_t e = 0; e < r->edges.len; e++)
        t.edge[t.at[(by_from ? r->edges.data[e].from : r->edges.data[e].to) + 1]++] = e;
    return t;
}

typedef Vec(uint32_t) Ids;

static void mark(Reach *r, Ids *pending, uint32_t id, uint8_t flag) {
    if (r->flags[id] & flag) return;
    r->flags[id] |= flag;
    vec_push(r->arena, pending, id);
}

/* Spreads the flag from `pending` along the edges, or against them. */
static void close(Reach *r, Ids *pending, uint8_t flag, bool forward, bool smooth) {
    const Table *t = forward ? &r->out : &r->in;
    while (pending->len) {
        uint32_t id = pending->data[--pending->len];
        for (uint32_t k = t->at[id]; k < t->at[id + 1]; k++) {
            const Edge *e = &r->edges.data[t->edge[k]];
            if (!smooth || e->kind == SMOOTH) mark(r, pending, forward ? e->to : e->from, flag);
        }
    }
}

/* Is a number that this reads of a parameter that has a gradient? Of a derived array: of what it is computed from. */
static bool reads_differentiable(const Program *p, const Inst *i) {
    uint32_t base = i->imm.slot.base;
    for (uint32_t d = 0; d < p->nderived; d++) {
        const Derived *of = &p->derived[d];
        if (base < of->base || base - of->base >= 3 * of->n) continue;
        for (uint32_t k = 0; k < of->nreads; k++)
            if (p->params[of->reads[k]].differentiable) return true;
    }
    for (uint32_t k = 0; k < p->nparams; k++)
        if (p->params[k].differentiable && base >= p->params[k].fbase &&
            base - p->params[k].fbase < p->params[k].fcount)
            return true;
    return false;
}

Reach *reach_of(const Program *p, Arena *arena) {
    Reach *r = ARENA_NEW(arena, Reach);
    r->program = p, r->fn = p->primal, r->arena = arena;
    r->n = ir_number(p->primal);
    r->inst = ARENA_ARRAY(arena, const Inst *, r->n + 1);
    r->flags = ARENA_ARRAY(arena, uint8_t, r->n + 1);
    uint8_t *sites = ARENA_ARRAY(arena, uint8_t, p->primal->nsites + 1);
    depend_sites(p->primal, NULL, sites);
    edges_in(r, p->primal->body);
    r->out = table(r, true), r->in = table(r, false);
    Ids pending = {0};
    const Inst *outputs = p->primal->body->last;
    for (uint32_t k = 0; k < outputs->nargs; k++) mark(r, &pending, outputs->args[k]->id, REACH_USED);
    close(r, &pending, REACH_USED, false, false);
    for (uint32_t k = 0; k < outputs->nargs; k++) mark(r, &pending, outputs->args[k]->id, REACH_OUTPUT);
    close(r, &pending, REACH_OUTPUT, false, true);
    for (uint32_t id = 0; id < r->n; id++) {
        const Inst *i = r->inst[id];
        bool site = i && (i->op == OP_site || i->op == OP_siten);
        /* A skipped site stands behind its loop, and nothing uses it: its decision does. */
        bool used = site && (r->flags[id] & REACH_USED || p->primal->sites[i->imm.i].skip_loop);
        if (used && sites[i->imm.i] & DEPENDS_X) mark(r, &pending, i->args[1]->id, REACH_BOUNDARY);
    }
    close(r, &pending, REACH_BOUNDARY, false, true);
    for (int smooth = 0; smooth < 2; smooth++) {
        uint8_t flag = smooth ? REACH_VARIED : REACH_MOVES;
        for (uint32_t id = 0; id < r->n; id++)
            if (r->inst[id] && r->inst[id]->op == OP_param && reads_differentiable(p, r->inst[id]))
                mark(r, &pending, id, flag);
        close(r, &pending, flag, true, smooth);
    }
    return r;
}

uint8_t reach_flags(const Reach *r, const Inst *i) { return i->id < r->n && r->inst[i->id] == i ? r->flags[i->id] : 0; }

const Inst *reach_lost_at(Reach *r, const Inst *i) {
    if (!reach_flags(r, i)) return NULL;
    Ids seen = {0};
    uint8_t *known = ARENA_ARRAY(r->arena, uint8_t, r->n + 1);
    vec_push(r->arena, &seen, i->id);
    known[i->id] = 1;
    for (uint32_t at = 0; at < seen.len; at++)
        for (uint32_t k = r->out.at[seen.data[at]]; k < r->out.at[seen.data[at] + 1]; k++) {
            const Edge *e = &r->edges.data[r->out.edge[k]];
            if (!(r->flags[e->to] & REACH_USED) || known[e->to]) continue;
            if (e->kind == LOST) return r->inst[e->to];
            if (e->kind != SMOOTH) continue;
            known[e->to] = 1;
            vec_push(r->arena, &seen, e->to);
        }
    return NULL;
}

static void slot_range(const Inst *param, uint32_t *base, uint32_t *end) {
    const Inst *index = param->args[0];
    *base = param->imm.slot.base, *end = *base + param->imm.slot.count;
    if (index->op != OP_consti) return;
    int64_t k = (int32_t)index->imm.i, n = param->imm.slot.count;
    *base += (uint32_t)(k < 0 ? 0 : k >= n ? n - 1 : k);
    *end = *base + 1;
}

uint8_t reach_of_param(const Reach *r, uint32_t base, uint32_t count, const Inst **read) {
    uint8_t flags = 0;
    *read = NULL;
    for (uint32_t id = 0; id < r->n; id++) {
        const Inst *i = r->inst[id];
        uint32_t lo, hi;
        if (!i || i->op != OP_param) continue;
        slot_range(i, &lo, &hi);
        if (lo >= base + count || hi <= base) continue;
        flags |= r->flags[id];
        if ((r->flags[id] & (REACH_USED | REACH_OUTPUT | REACH_BOUNDARY)) == REACH_USED) *read = i;
    }
    return flags;
}

static void add_reads(const Reach *r, uint8_t *reached) {
    for (uint32_t id = 0; id < r->n; id++) {
        const Inst *i = r->inst[id];
        if (!i || i->op != OP_param || !(r->flags[id] & (REACH_OUTPUT | REACH_BOUNDARY))) continue;
        uint32_t lo, hi;
        slot_range(i, &lo, &hi);
        memset(reached + lo, 1, hi - lo);
    }
}

void reach_params(Reach *r, uint8_t *reached) {
    const Program *p = r->program;
    memset(reached, 0, p->nfloats);
    add_reads(r, reached);
    for (uint32_t d = p->nderived; d-- > 0;) {
        const Derived *of = &p->derived[d];
        if (!memchr(reached + of->base, 1, 3 * (size_t)of->n)) continue;
        add_reads(reach_of(of->of, r->arena), reached);
    }
}
