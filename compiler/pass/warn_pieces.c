/* Does what is seen jump where a visible piece comes, goes, or is cut in two? It does not where the output is a sum
 * over the pieces whose terms have the factor `area`: a piece comes with area 0, and the parts of one that is cut add
 * up.
 *
 * One walk in program order, repeated until nothing changes, says of every value what it is in the pieces of one query:
 *
 *   STEADY   no piece is in it, or all of them: `base`, where that is known, and the shares of all
 *   ZERO     0, and what is 0 but for its derivative: goes with all others
 *   SHARE    a piece's area times anything
 *   SUM      `base` and shares of some
 *   UNIT     the number of a piece
 *   LIT      of what is told of a light that shines on it
 *   LOOSE    of a piece, otherwise
 *
 * A loop that goes from piece to piece ends all sums: its results are steady. */
#include "compiler/pass/warn.h"
#include "saltus/mesh.h"

typedef enum Kind { UNSEEN, STEADY, ZERO, SHARE, SUM, UNIT, LIT, LOOSE } Kind;

typedef struct Part {
    Kind kind;
    const Inst *base; /* of a SUM, of a STEADY */
} Part;

typedef struct Pieces {
    const Inst *query;
    Part *of; /* by id */
    bool changed;
} Pieces;

/* What no walk has come to, as the next value of a loop's first iteration, is taken to be steady. */
static Part at(const Pieces *p, const Inst *i) {
    Part x = p->of[i->id];
    return x.kind == UNSEEN ? (Part){STEADY, NULL} : x;
}

static void put(Pieces *p, const Inst *i, Part part) {
    Part *old = &p->of[i->id];
    if (old->kind == part.kind && old->base == part.base) return;
    *old = part, p->changed = true;
}

/* What a value adds shares to: itself where it has none. */
static const Inst *base_of(const Pieces *p, const Inst *i) {
    static const Inst zero;
    Part x = at(p, i);
    return x.kind == ZERO ? &zero : x.kind != STEADY && x.kind != SUM ? NULL : x.base ? x.base : i;
}

static bool is_share(Part x) { return x.kind == ZERO || x.kind == SHARE; }

static bool is_chosen(Part by) { return by.kind != STEADY && by.kind != ZERO; }

/* Neither a share nor part of one. */
static bool is_loose(Part x) { return x.kind >= UNIT; }

static Part sum(const Pieces *p, const Inst *self, const Inst *a, const Inst *b) {
    Part x = at(p, a), y = at(p, b);
    if (is_loose(x) || is_loose(y)) return (Part){LOOSE, NULL};
    if (is_share(x) && is_share(y)) return (Part){x.kind == ZERO ? y.kind : SHARE, NULL};
    if (x.kind == STEADY && y.kind == STEADY) return (Part){STEADY, NULL};
    if (x.kind == ZERO && y.kind == STEADY) return y;
    if (y.kind == ZERO && x.kind == STEADY) return x;
    if (is_share(x)) return (Part){SUM, base_of(p, b)};
    if (is_share(y)) return (Part){SUM, base_of(p, a)};
    return (Part){SUM, self}; /* of two sums */
}

static Part product(const Inst *self, Part x, Part y) {
    if (x.kind == ZERO || y.kind == ZERO) return (Part){ZERO, NULL};
    if (x.kind == STEADY && y.kind == STEADY) return (Part){STEADY, NULL};
    if (x.kind > y.kind) {
        Part t = x;
        x = y, y = t;
    }
    if (x.kind == STEADY) return y.kind == SUM ? (Part){SUM, self} : is_loose(y) ? (Part){LOOSE, NULL} : y;
    return (Part){x.kind == SHARE && is_loose(y) ? SHARE : LOOSE, NULL};
}

static Part quotient(const Inst *self, Part x, Part y) {
    if (is_share(x)) return x;
    return y.kind == STEADY ? product(self, x, y) : (Part){LOOSE, NULL};
}

static Part multiply_add(const Pieces *p, const Inst *i) {
    Part x = product(i, at(p, i->args[0]), at(p, i->args[1])), y = at(p, i->args[2]);
    if (x.kind == STEADY && y.kind == STEADY) return x;
    if (is_loose(x) || is_loose(y)) return (Part){LOOSE, NULL};
    if (is_share(x) && is_share(y)) return (Part){SHARE, NULL};
    return (Part){SUM, is_share(x) ? base_of(p, i->args[2]) : i};
}

/* Is there a piece at all? */
static bool asks_found(const Pieces *p, const Inst *by) {
    return by->op == OP_ine && at(p, by->args[0]).kind == UNIT && by->args[1]->op == OP_consti && !by->args[1]->imm.i;
}

static Part choice(const Pieces *p, const Inst *self, const Inst *by, const Inst *a, const Inst *b) {
    Part x = at(p, a), y = at(p, b);
    const bool steady = (x.kind == STEADY || x.kind == ZERO) && (y.kind == STEADY || y.kind == ZERO);
    if (a == b || (x.kind == UNIT && y.kind == UNIT)) return x;
    if ((x.kind == UNIT && ir_is_const(b)) || (y.kind == UNIT && ir_is_const(a))) return (Part){UNIT, NULL};
    if (is_share(x) && is_share(y)) return (Part){x.kind == ZERO ? y.kind : SHARE, NULL};
    if (is_loose(x) || is_loose(y)) return (Part){LOOSE, NULL};
    const Inst *base = base_of(p, a);
    if (base && base == base_of(p, b) && (!steady || asks_found(p, by))) return (Part){steady ? STEADY : SUM, base};
    if (is_chosen(at(p, by))) return (Part){LOOSE, NULL};
    return (Part){steady ? STEADY : SUM, steady ? NULL : self};
}

/* Of an operation that none of the rules is about. */
static Part other(const Pieces *p, const Inst *i) {
    for (uint32_t a = 0; a < i->nargs; a++) {
        Part x = at(p, i->args[a]);
        if (x.kind != STEADY && x.kind != ZERO) return (Part){LOOSE, NULL};
    }
    return (Part){STEADY, NULL};
}

static Part query(const Pieces *p, const Inst *i) {
    if (i == p->query) return (Part){UNIT, NULL};
    if (i->imm.query.what == SLT_QUERY_LIT && at(p, i->args[SLT_LIT_UNIT]).kind == UNIT) return (Part){LIT, NULL};
    return other(p, i);
}

/* A part of a piece is lit. */
static Part told(const Pieces *p, const Inst *i) {
    if (at(p, i->args[0]).kind == LIT) return (Part){i->imm.query.what == SLT_LIGHT_VALUE ? SHARE : LOOSE, NULL};
    if (at(p, i->args[0]).kind != UNIT) return other(p, i);
    if (i->imm.query.what == SLT_PIECE_NEXT) return (Part){UNIT, NULL};
    return (Part){i->imm.query.what == SLT_PIECE_AREA ? SHARE : LOOSE, NULL};
}

/* An element of an array grows by shares, or the array is loose. */
static void store(Pieces *p, const Inst *i, bool chosen) {
    Part x = at(p, i->args[2]);
    bool grows = x.kind == SUM && x.base && x.base->op == OP_load && x.base->args[0] == i->args[0];
    if (grows || (!chosen && (x.kind == STEADY || x.kind == ZERO))) return;
    put(p, i->args[0], (Part){LOOSE, NULL});
}

static void walk(Pieces *p, const Block *b, bool chosen);

static void enter_loop(Pieces *p, const Inst *i, bool chosen) {
    const Block *body = i->region[0];
    const Inst *exit = body->last->args[0];
    bool counted = !is_chosen(at(p, exit));
    for (uint32_t k = 1; k < body->nparams; k++) {
        const Inst *param = body->params[k], *first = i->args[k - 1], *next = body->last->args[k];
        Part from = at(p, first), to = at(p, next);
        if (at(p, param).kind == LOOSE) continue; /* once and for all, so that this ends */
        bool stays = next == param || p->of[next->id].kind == UNSEEN, adds = to.kind == SUM && to.base == param,
             steady = counted && (to.kind == STEADY || to.kind == ZERO);
        if (from.kind == LOOSE) put(p, param, from);
        else if (from.kind == UNIT || to.kind == UNIT)
            put(p, param,
                (Part){from.kind == UNIT && (to.kind == UNIT || stays || ir_is_const(next)) ? UNIT : LOOSE, NULL});
        else if (from.kind == SHARE || to.kind == SHARE) /* the piece that the loop has come to */
            put(p, param, (Part){is_share(from) && (is_share(to) || stays) ? SHARE : LOOSE, NULL});
        else put(p, param, (Part){stays || adds || steady ? STEADY : LOOSE, NULL});
    }
    walk(p, body, chosen || !counted);
}

/* Result k of a loop. */
static Part loop_result(const Pieces *p, const Inst *self, const Inst *i, uint32_t k) {
    const Block *body = i->region[0];
    const Inst *param = body->params[k + 1], *first = i->args[k], *next = body->last->args[k + 1];
    bool over_pieces = false, counted = !is_chosen(at(p, body->last->args[0]));
    for (uint32_t a = 1; a < body->nparams; a++) over_pieces |= at(p, body->params[a]).kind == UNIT;
    Part to = at(p, next);
    if (next == param) return at(p, first);
    if (at(p, param).kind == LOOSE || is_loose(to)) return (Part){to.kind == UNIT ? UNIT : LOOSE, NULL};
    if (to.kind == SUM && to.base == param && !over_pieces && is_share(at(p, first))) return (Part){SHARE, NULL};
    if (to.kind == SUM && to.base == param)
        return (Part){over_pieces ? STEADY : SUM, base_of(p, first) ? base_of(p, first) : self};
    if (counted && (to.kind == STEADY || to.kind == ZERO)) return (Part){STEADY, NULL};
    return (Part){LOOSE, NULL};
}

static Part result(const Pieces *p, const Inst *i) {
    const Inst *owner = i->args[0];
    const uint32_t k = (uint32_t)i->imm.i;
    if (owner->op == OP_loop) return loop_result(p, i, owner, k);
    if (owner->op == OP_if_)
        return choice(p, i, owner->args[0], owner->region[0]->last->args[k], owner->region[1]->last->args[k]);
    return other(p, owner); /* a function with a derivative of its own */
}

static void walk(Pieces *p, const Block *b, bool chosen) {
    for (const Inst *i = b->first; i; i = i->next) {
        Inst *const *a = i->args;
        switch ((Op)i->op) {
        case OP_query: put(p, i, query(p, i)); break;
        case OP_i2f: put(p, i, at(p, a[0]).kind == UNIT ? at(p, a[0]) : other(p, i)); break;
        case OP_told: put(p, i, told(p, i)); break;
        case OP_ghost: put(p, i, (Part){ZERO, NULL}); break;
        case OP_constf:
        case OP_consti: put(p, i, (Part){i->op == OP_constf && i->imm.f == 0 ? ZERO : STEADY, NULL}); break;
        case OP_fadd:
        case OP_fsub: put(p, i, sum(p, i, a[0], a[1])); break;
        case OP_fmul:
        case OP_zmul: put(p, i, product(i, at(p, a[0]), at(p, a[1]))); break;
        case OP_fdiv: put(p, i, quotient(i, at(p, a[0]), at(p, a[1]))); break;
        case OP_ffma: put(p, i, multiply_add(p, i)); break;
        case OP_fneg:
        case OP_fabs:
        case OP_detach:
            put(p, i, at(p, a[0]).kind == SUM ? product(i, at(p, a[0]), (Part){STEADY, NULL}) : at(p, a[0]));
            break;
        case OP_fsel:
        case OP_isel:
        case OP_bsel: put(p, i, choice(p, i, a[0], a[1], a[2])); break;
        case OP_if_:
            walk(p, i->region[0], chosen || is_chosen(at(p, a[0])));
            walk(p, i->region[1], chosen || is_chosen(at(p, a[0])));
            break;
        case OP_loop: enter_loop(p, i, chosen); break;
        case OP_proj: put(p, i, result(p, i)); break;
        case OP_store: store(p, i, chosen); break;
        case OP_acopy:
            if (at(p, a[1]).kind == LOOSE || chosen) put(p, a[0], (Part){LOOSE, NULL});
            break;
        case OP_load: put(p, i, (Part){at(p, a[0]).kind == LOOSE ? LOOSE : STEADY, NULL}); break;
        case OP_alloc:
        case OP_yield: break;
        default: put(p, i, other(p, i));
        }
    }
}

bool warn_pieces(Fn *fn, const Inst *query) {
    enum { MOST_WALKS = 64 };
    Arena *scratch = &fn->session->scratch;
    ArenaMark mark = arena_mark(scratch);
    Pieces p = {.query = query, .of = ARENA_ARRAY(scratch, Part, fn->ninsts + 1), .changed = true};
    for (uint32_t n = 0; p.changed && n < MOST_WALKS; n++) p.changed = false, walk(&p, fn->body, false);
    bool jumps = p.changed;
    for (uint32_t k = 0; k < fn->body->last->nargs; k++) jumps |= is_loose(at(&p, fn->body->last->args[k]));
    arena_reset(scratch, mark);
    return jumps;
}
