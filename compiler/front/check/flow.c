/* Definite assignment and returns.
 *
 * The state at a point is one bit for every scalar of every local and argument: set if it was assigned on every path to
 * here. Arrays have no bits (they are zero where not written). Behind a return, break or continue the state is `dead`:
 * nothing arrives, everything holds. Joining paths intersects. Conditions have two results, so that `a && f(b)` tells
 * its branches what f assigned. A loop needs no iteration to a fixed point: states only grow along a path, so the first
 * pass through the body sees the least. */
#include "compiler/front/check/internal.h"

#include <string.h>

typedef struct State {
    uint64_t *w;
    bool dead;
} State;

typedef struct Jumps { /* where break and continue of the statement around go */
    State brk, cont;
    bool is_loop;
    struct Jumps *outer;
} Jumps;

typedef struct Flow {
    Checker *c;
    Func *func;
    uint32_t *at, *count; /* bits of each symbol, by id */
    uint32_t words;
    Jumps *jumps;
} Flow;

static uint32_t bits_of(const Type *t) {
    switch (t->kind) {
    case T_VECTOR: return t->n;
    case T_MATRIX: return t->n * t->columns;
    case T_STRUCT: {
        uint32_t n = 0;
        for (uint32_t i = 0; i < t->nfields; i++) n += bits_of(t->fields[i].type);
        return n;
    }
    case T_BOOL:
    case T_INT:
    case T_UINT:
    case T_FLOAT: return 1;
    case T_ERROR:
    case T_VOID:
    case T_ARRAY:
    case T_TEXTURE:
    case T_TEXTURE3D:
    case T_GEOMETRY: return 0;
    }
    return 0;
}

static State copy(Flow *f, const State *s) {
    State r = {ARENA_ARRAY(&f->c->s->scratch, uint64_t, f->words), s->dead};
    memcpy(r.w, s->w, sizeof *r.w * f->words);
    return r;
}

static State dead_state(Flow *f) { return (State){ARENA_ARRAY(&f->c->s->scratch, uint64_t, f->words), true}; }

static void join(Flow *f, State *into, const State *from) {
    if (from->dead) return;
    if (into->dead) memcpy(into->w, from->w, sizeof *into->w * f->words);
    else
        for (uint32_t i = 0; i < f->words; i++) into->w[i] &= from->w[i];
    into->dead = false;
}

static bool is_set(const State *s, uint32_t bit) { return s->dead || (s->w[bit / 64] >> (bit % 64) & 1); }
static void set_bits(State *s, uint32_t at, uint32_t n, bool value) {
    for (uint32_t i = at; i < at + n; i++)
        if (value) s->w[i / 64] |= (uint64_t)1 << (i % 64);
        else s->w[i / 64] &= ~((uint64_t)1 << (i % 64));
}

/* The bits that a place stands for. */
typedef struct Part {
    Symbol *sym; /* NULL: no variable of this function */
    uint32_t at, n;
    uint8_t swz[4], nswz; /* when nswz: components at + swz[i] instead */
    bool some;            /* a computed index: which of the n is not known */
} Part;

static bool is_variable(const Symbol *s) { return s && (s->kind == SYM_LOCAL || s->kind == SYM_ARG); }

static Part part_of(Flow *f, const Expr *e) {
    if (e->kind == E_NAME) {
        if (!is_variable(e->sym)) return (Part){0};
        return (Part){.sym = e->sym, .at = f->at[e->sym->id], .n = f->count[e->sym->id]};
    }
    if (e->kind != E_FIELD && e->kind != E_INDEX && e->kind != E_SWIZZLE) return (Part){0};
    Part p = part_of(f, e->a[0]);
    if (!p.sym || !p.n || p.some) return p;
    const Type *t = e->a[0]->type;
    if (e->kind == E_FIELD && t->kind == T_STRUCT) {
        for (uint32_t i = 0; i < e->field; i++) p.at += bits_of(t->fields[i].type);
        p.n = bits_of(e->type);
    } else if (e->kind == E_SWIZZLE && t->kind == T_VECTOR) {
        memcpy(p.swz, e->swz, sizeof p.swz);
        p.nswz = e->nswz;
    } else if (e->kind == E_INDEX && (t->kind == T_VECTOR || t->kind == T_MATRIX)) {
        uint32_t stride = t->kind == T_MATRIX ? t->columns : 1;
        if (e->a[1]->is_const && !p.nswz) {
            int64_t i = e->a[1]->cval.v[0].i;
            p.at += (uint32_t)(i < 0 ? 0 : i >= t->n ? t->n - 1 : i) * stride;
            p.n = stride;
        } else {
            p.some = true;
        }
    }
    return p;
}

static void assign_part(State *s, const Part *p) {
    if (!p->sym || s->dead || p->some) return;
    if (!p->nswz) set_bits(s, p->at, p->n, true);
    for (int i = 0; i < p->nswz; i++) set_bits(s, p->at + p->swz[i], 1, true);
}

static void read_part(Flow *f, State *s, const Part *p, Span at) {
    if (!p->sym || s->dead) return;
    bool all = true;
    if (!p->nswz)
        for (uint32_t i = 0; i < p->n; i++) all &= is_set(s, p->at + i);
    for (int i = 0; i < p->nswz; i++) all &= is_set(s, p->at + p->swz[i]);
    if (all) return;
    uint32_t first = f->at[p->sym->id], n = f->count[p->sym->id];
    bool any = false;
    for (uint32_t i = 0; i < n; i++) any |= is_set(s, first + i);
    Diag *d = diag_emit(f->c->s, DIAG_uninitialised, at, p->sym->name,
                        n == 1 ? "it is assigned on every path"
                        : any  ? "every component of it is assigned"
                               : "it is assigned on every path");
    diag_note(f->c->s, d, p->sym->span, "`%s` is declared here", p->sym->name);
    set_bits(s, first, n, true); /* once is enough */
}

static void flow_expr(Flow *f, State *s, Expr *e);

/* The indices inside a place are read, whatever happens to the place. */
static void flow_indices(Flow *f, State *s, Expr *e) {
    for (; e && (e->kind == E_INDEX || e->kind == E_FIELD || e->kind == E_SWIZZLE); e = e->a[0])
        if (e->kind == E_INDEX) flow_expr(f, s, e->a[1]);
}

static void read_place(Flow *f, State *s, Expr *e) {
    flow_indices(f, s, e);
    Part p = part_of(f, e);
    read_part(f, s, &p, e->span);
}

static void assign_place(Flow *f, State *s, Expr *e) {
    Part p = part_of(f, e);
    assign_part(s, &p);
}

/* Afterwards *s is the state where e is true, *no that where it is false. */
static void flow_condition(Flow *f, State *s, State *no, Expr *e) {
    if (e->kind == E_LOGIC) {
        State first_no;
        flow_condition(f, s, &first_no, e->a[0]);
        if (e->op == OPR_LAND) {
            flow_condition(f, s, no, e->a[1]);
            join(f, no, &first_no);
        } else {
            State yes = copy(f, s);
            *s = first_no;
            flow_condition(f, s, no, e->a[1]);
            join(f, s, &yes);
        }
        return;
    }
    if (e->kind == E_UNARY && e->op == OPR_NOT && e->type->kind == T_BOOL) {
        State yes;
        flow_condition(f, s, &yes, e->a[0]); /* *s: a[0] true, yes: a[0] false */
        *no = *s;
        *s = yes;
        return;
    }
    flow_expr(f, s, e);
    *no = copy(f, s);
}

static void flow_call(Flow *f, State *s, Expr *e) {
    for (uint32_t i = 0; i < e->nargs; i++) {
        Expr *arg = e->args[i];
        bool place = is_variable(place_root(arg));
        if (e->func && e->func->args[i]->mode == ARG_OUT) flow_indices(f, s, arg);
        else if (!e->func && place && e->kind == E_CALL)
            flow_indices(f, s, arg); /* the call was reported: this argument may have been an `out` */
        else flow_expr(f, s, arg);
    }
    for (uint32_t i = 0; i < e->nargs; i++)
        if (e->func ? e->func->args[i]->mode != ARG_IN : e->kind == E_CALL) assign_place(f, s, e->args[i]);
}

static void flow_expr(Flow *f, State *s, Expr *e) {
    if (!e) return;
    switch (e->kind) {
    case E_NAME: read_place(f, s, e); return;
    case E_INDEX:
    case E_FIELD:
    case E_SWIZZLE:
        if (place_root(e)) {
            read_place(f, s, e);
        } else {
            flow_expr(f, s, e->a[0]);
            flow_expr(f, s, e->a[1]);
        }
        return;
    case E_ASSIGN:
        if (e->op == OPR_NONE) flow_indices(f, s, e->a[0]);
        else flow_expr(f, s, e->a[0]);
        flow_expr(f, s, e->a[1]);
        assign_place(f, s, e->a[0]);
        return;
    case E_LOGIC: {
        State no;
        flow_condition(f, s, &no, e);
        join(f, s, &no);
        return;
    }
    case E_COND: {
        State no;
        flow_condition(f, s, &no, e->a[0]);
        flow_expr(f, s, e->a[1]);
        flow_expr(f, &no, e->a[2]);
        join(f, s, &no);
        return;
    }
    case E_CALL: flow_call(f, s, e); return;
    case E_LEN: return; /* asks for the type only */
    case E_ERROR:
    case E_LITERAL:
    case E_UNARY:
    case E_BINARY:
    case E_INCDEC:
    case E_BUILTIN:
    case E_METHOD:
    case E_CONSTRUCT:
    case E_CONVERT:
    case E_BROADCAST:
    case E_LIST:
    case E_COMMA:
        for (int i = 0; i < 3; i++) flow_expr(f, s, e->a[i]);
        for (uint32_t i = 0; i < e->nargs; i++) flow_expr(f, s, e->args[i]);
    }
}

/* ---- statements */

static void flow_stmt(Flow *f, State *s, Stmt *st);

static void kill_state(State *s) { s->dead = true; }

static void check_outs(Flow *f, const State *s, Span at) {
    if (s->dead) return;
    for (uint32_t i = 0; i < f->func->nargs; i++) {
        Symbol *a = f->func->args[i];
        if (a->mode != ARG_OUT) continue;
        bool all = true;
        for (uint32_t b = 0; b < f->count[a->id]; b++) all &= is_set(s, f->at[a->id] + b);
        if (all) continue;
        Diag *d = diag_emit(f->c->s, DIAG_out_unassigned, at, a->name);
        diag_note(f->c->s, d, a->span, "`%s` is declared here", a->name);
    }
}

static void flow_loop(Flow *f, State *s, Stmt *st) {
    Jumps j = {.brk = dead_state(f), .cont = dead_state(f), .is_loop = true, .outer = f->jumps};
    if (st->init) flow_stmt(f, s, st->init);
    State no = dead_state(f);
    bool endless = !st->expr || (st->expr->is_const && st->expr->type->kind == T_BOOL && st->expr->cval.v[0].i);
    if (st->kind != S_DO && st->expr) {
        flow_condition(f, s, &no, st->expr);
        if (endless) no.dead = true;
    }
    f->jumps = &j;
    flow_stmt(f, s, st->body);
    f->jumps = j.outer;
    join(f, s, &j.cont);
    if (st->step) flow_expr(f, s, st->step);
    bool cut = !st->trip_exact;
    if (st->kind == S_DO) {
        State end = copy(f, s);
        flow_condition(f, s, &no, st->expr);
        if (endless) no.dead = true;
        *s = no;
        if (cut) join(f, s, &end);
    } else if (st->trip_count < 1) {
        if (cut) join(f, &no, s); /* [MaxIters] may end the loop behind the body */
        *s = no;
    } /* else: the body ran, *s is its end */
    join(f, s, &j.brk);
}

static void flow_switch(Flow *f, State *s, Stmt *st) {
    Jumps j = {.brk = dead_state(f), .cont = dead_state(f), .outer = f->jumps};
    flow_expr(f, s, st->expr);
    State entry = copy(f, s), cur = dead_state(f);
    bool fallback = false;
    f->jumps = &j;
    for (uint32_t i = 0; i < st->ncases; i++) {
        join(f, &cur, &entry);
        fallback |= st->cases[i].is_default;
        for (uint32_t k = 0; k < st->cases[i].nbody; k++) flow_stmt(f, &cur, st->cases[i].body[k]);
    }
    f->jumps = j.outer;
    if (!fallback) join(f, &cur, &entry);
    join(f, &cur, &j.brk);
    *s = cur;
}

static void flow_stmt(Flow *f, State *s, Stmt *st) {
    if (!st) return;
    switch (st->kind) {
    case S_EXPR:
    case S_ASSERT: flow_expr(f, s, st->expr); break;
    case S_PRINT:
        for (uint32_t i = 0; i < st->nargs; i++) flow_expr(f, s, st->args[i]);
        break;
    case S_DECL:
        for (uint32_t i = 0; i < st->ndecls; i++) {
            Symbol *sym = st->decls[i];
            if (!s->dead) set_bits(s, f->at[sym->id], f->count[sym->id], false);
            if (!sym->init) continue;
            flow_expr(f, s, sym->init);
            if (!s->dead) set_bits(s, f->at[sym->id], f->count[sym->id], true);
        }
        break;
    case S_IF: {
        State no;
        flow_condition(f, s, &no, st->expr);
        flow_stmt(f, s, st->body);
        flow_stmt(f, &no, st->orelse);
        join(f, s, &no);
        break;
    }
    case S_FOR:
    case S_WHILE:
    case S_DO: flow_loop(f, s, st); break;
    case S_SWITCH: flow_switch(f, s, st); break;
    case S_BREAK:
        if (f->jumps) join(f, &f->jumps->brk, s);
        kill_state(s);
        break;
    case S_CONTINUE:
        for (Jumps *j = f->jumps; j; j = j->outer)
            if (j->is_loop) {
                join(f, &j->cont, s);
                break;
            }
        kill_state(s);
        break;
    case S_RETURN:
        flow_expr(f, s, st->expr);
        check_outs(f, s, st->span);
        kill_state(s);
        break;
    case S_BLOCK:
        for (uint32_t i = 0; i < st->nstmts; i++) flow_stmt(f, s, st->stmts[i]);
        break;
    case S_EMPTY: break;
    }
}

/* Numbers the bits of every declaration, in any order. */
static void number_symbol(Flow *f, const Symbol *sym) {
    f->at[sym->id] = f->words; /* bits while numbering */
    f->count[sym->id] = bits_of(sym->type);
    f->words += f->count[sym->id];
}

static void number_stmt(Flow *f, const Stmt *st) {
    if (!st) return;
    for (uint32_t i = 0; i < st->ndecls; i++) number_symbol(f, st->decls[i]);
    number_stmt(f, st->init);
    number_stmt(f, st->body);
    number_stmt(f, st->orelse);
    for (uint32_t i = 0; i < st->nstmts; i++) number_stmt(f, st->stmts[i]);
    for (uint32_t i = 0; i < st->ncases; i++)
        for (uint32_t j = 0; j < st->cases[i].nbody; j++) number_stmt(f, st->cases[i].body[j]);
}

void check_flow(Checker *c, Func *func) {
    Arena *scratch = &c->s->scratch;
    ArenaMark mark = arena_mark(scratch);
    Flow f = {.c = c, .func = func};
    f.at = ARENA_ARRAY(scratch, uint32_t, func->nlocals + 1);
    f.count = ARENA_ARRAY(scratch, uint32_t, func->nlocals + 1);
    for (uint32_t i = 0; i < func->nargs; i++) number_symbol(&f, func->args[i]);
    number_stmt(&f, func->body);
    f.words = f.words / 64 + 1;
    State s = {ARENA_ARRAY(scratch, uint64_t, f.words), false};
    for (uint32_t i = 0; i < func->nargs; i++)
        if (func->args[i]->mode != ARG_OUT) set_bits(&s, f.at[func->args[i]->id], f.count[func->args[i]->id], true);
    flow_stmt(&f, &s, func->body);
    if (!s.dead) {
        if (func->ret->kind != T_VOID && func->ret->kind != T_ERROR)
            diag_emit(c->s, DIAG_missing_return, func->name_span, func->name);
        else check_outs(&f, &s, func->end_span.len ? func->end_span : func->name_span);
    }
    arena_reset(scratch, mark);
}
