/* Does what is seen jump where a visible piece comes, goes, or is cut in two? It does not where the output is a sum
 * over all pieces whose terms have the factor `area` once: a piece comes with area 0, and the parts of one that is cut
 * add up.
 *
 * One walk in program order, repeated until nothing changes, says of every value what it is in the pieces of one query:
 *
 *   STEADY   no piece is in it, or all of them: `base`, where that is known, and the shares of all
 *   ZERO     0, and what is 0 but for its derivative: goes with all others
 *   SHARE    a piece's area times what is its own
 *   SUM      `base` and shares of some
 *   FOUND    whether there is a piece
 *   UNIT     the number of a piece
 *   LIT      of what is told of a light that shines on it
 *   OWN      of a piece, the same of its parts where it is cut
 *   BROKEN   the rest: what depends on the order of pieces, on how many there are, on an area otherwise
 *
 * A loop that goes from piece to piece until there is none ends all sums: its results are steady. */
#include <string.h>

#include "compiler/pass/warn.h"
#include "saltus/mesh.h"

typedef enum Kind { UNSEEN, STEADY, ZERO, SHARE, SUM, FOUND, UNIT, LIT, OWN, BROKEN } Kind;

typedef struct Part {
    Kind kind;
    const Inst *base; /* of a SUM, of a STEADY */
} Part;

typedef struct Pieces {
    const Inst *query;
    Part *of; /* by id */
    bool changed;
} Pieces;

static Part just(Kind kind) { return (Part){kind, NULL}; }

/* What no walk has come to, as the next value of a loop's first iteration, is taken to be steady. */
static Part at(const Pieces *p, const Inst *i) {
    Part x = p->of[i->id];
    return x.kind == UNSEEN ? just(STEADY) : x;
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

static bool is_steady(Part x) { return x.kind == STEADY || x.kind == ZERO; }
static bool is_share(Part x) { return x.kind == ZERO || x.kind == SHARE; }
static bool is_own(Part x) { return x.kind == FOUND || x.kind == UNIT || x.kind == OWN; }

static Part share_of(Part x, Part y) { return x.kind == ZERO ? y : x; }

static Part sum(const Pieces *p, const Inst *self, const Inst *a, const Inst *b) {
    Part x = at(p, a), y = at(p, b);
    if (x.kind == BROKEN || y.kind == BROKEN) return just(BROKEN);
    if (is_share(x) && is_share(y)) return share_of(x, y);
    if (is_own(x) || is_own(y)) return just((is_own(x) || is_steady(x)) && (is_own(y) || is_steady(y)) ? OWN : BROKEN);
    if (x.kind == STEADY && y.kind == STEADY) return just(STEADY);
    if (x.kind == ZERO && y.kind == STEADY) return y;
    if (y.kind == ZERO && x.kind == STEADY) return x;
    if (is_share(x)) return (Part){SUM, base_of(p, b)};
    if (is_share(y)) return (Part){SUM, base_of(p, a)};
    return (Part){SUM, self}; /* of two sums */
}

static Part product(const Inst *self, Part x, Part y) {
    if (x.kind == ZERO || y.kind == ZERO) return just(ZERO);
    if (y.kind == STEADY || is_own(x)) {
        Part t = x;
        x = y, y = t;
    }
    if (x.kind == STEADY)
        return y.kind == STEADY ? just(STEADY) : y.kind == SUM ? (Part){SUM, self} : just(is_own(y) ? OWN : y.kind);
    if (is_own(y)) return just(x.kind == SHARE || is_own(x) ? (is_own(x) ? OWN : SHARE) : BROKEN);
    return just(BROKEN);
}

static Part quotient(const Inst *self, Part x, Part y) {
    if (is_own(y) && is_share(x)) return x;
    return y.kind == STEADY || is_own(y) ? product(self, x, y) : just(BROKEN);
}

static Part multiply_add(const Pieces *p, const Inst *i) {
    Part x = product(i, at(p, i->args[0]), at(p, i->args[1])), y = at(p, i->args[2]);
    if (is_share(x) && is_share(y)) return share_of(x, y);
    if (is_share(x) && (y.kind == STEADY || y.kind == SUM)) return (Part){SUM, base_of(p, i->args[2])};
    if (x.kind == STEADY && is_steady(y)) return x;
    return just((is_own(x) || is_steady(x)) && (is_own(y) || is_steady(y)) ? OWN : BROKEN);
}

/* Is there a piece at all? */
static bool asks_found(const Pieces *p, const Inst *i) {
    return i->op == OP_ine && at(p, i->args[0]).kind == UNIT && i->args[1]->op == OP_consti && !i->args[1]->imm.i;
}

static Part choice(const Pieces *p, const Inst *self, const Inst *by, const Inst *a, const Inst *b) {
    Part x = at(p, a), y = at(p, b), c = at(p, by);
    if (a == b) return x;
    if (x.kind == BROKEN || y.kind == BROKEN || !(is_steady(c) || is_own(c))) return just(BROKEN);
    if (x.kind == y.kind && (x.kind == UNIT || x.kind == FOUND)) return x;
    if ((x.kind == UNIT && ir_is_const(b)) || (y.kind == UNIT && ir_is_const(a))) return just(UNIT);
    if (is_share(x) && is_share(y)) return share_of(x, y);
    if (is_own(x) || is_own(y)) return just((is_own(x) || is_steady(x)) && (is_own(y) || is_steady(y)) ? OWN : BROKEN);
    const bool steady = is_steady(x) && is_steady(y);
    const Inst *base = base_of(p, a);
    if (base && base == base_of(p, b) && (!steady || c.kind == FOUND)) return (Part){steady ? STEADY : SUM, base};
    if (is_own(c)) return just(steady ? OWN : BROKEN);
    return steady ? just(STEADY) : (Part){SUM, self};
}

/* Of an operation that none of the rules is about. */
static Part other(const Pieces *p, const Inst *i) {
    bool own = false, broken = false,
         empty = i->nargs == 2 && i->type == TY_BOOL; /* is an area 0? as good as `found` */
    for (uint32_t a = 0; a < i->nargs; a++) {
        Part x = at(p, i->args[a]);
        own |= is_own(x), broken |= !is_own(x) && !is_steady(x), empty &= is_share(x);
    }
    return just(broken && !empty ? BROKEN : own || broken ? OWN : STEADY);
}

static Part query(const Pieces *p, const Inst *i) {
    if (i == p->query) return just(UNIT);
    if (i->imm.query.what != SLT_QUERY_LIT || at(p, i->args[SLT_LIT_UNIT]).kind != UNIT) return other(p, i);
    for (uint32_t a = 0; a < SLT_LIT_UNIT; a++)
        if (!is_steady(at(p, i->args[a])) && !is_own(at(p, i->args[a]))) return just(BROKEN);
    return just(LIT);
}

/* A part of a piece is lit. */
static Part told(const Pieces *p, const Inst *i) {
    if (at(p, i->args[0]).kind == LIT) return just(i->imm.query.what == SLT_LIGHT_VALUE ? SHARE : BROKEN);
    if (at(p, i->args[0]).kind != UNIT) return other(p, i);
    if (i->imm.query.what == SLT_PIECE_NEXT) return just(UNIT);
    return just(i->imm.query.what == SLT_PIECE_AREA ? SHARE : OWN);
}

/* An element of an array grows by shares, or is a piece's own. */
static void store(Pieces *p, const Inst *i, bool chosen) {
    Part x = at(p, i->args[2]), was = at(p, i->args[0]);
    bool grows = x.kind == SUM && x.base && x.base->op == OP_load && x.base->args[0] == i->args[0];
    if (was.kind == BROKEN || grows || (!chosen && is_steady(x))) return;
    put(p, i->args[0], just(is_own(x) || is_steady(x) ? OWN : BROKEN));
}

static bool goes_over_pieces(const Pieces *p, const Inst *loop) {
    for (uint32_t a = 0; a < loop->nargs; a++)
        if (at(p, loop->args[a]).kind == UNIT) return true;
    return false;
}

/* Does the loop go on as long as there is a piece? The bound of its iterations is never met. */
static bool ends_with_pieces(const Pieces *p, const Inst *loop) {
    const Inst *exit = loop->region[0]->last->args[0], *k = loop->region[0]->params[0];
    if (at(p, exit).kind == FOUND) return true;
    if (exit->op != OP_band || !loop->imm.loop.told) return false;
    for (uint32_t a = 0; a < 2; a++)
        if (at(p, exit->args[a]).kind == FOUND && exit->args[1 - a]->op == OP_ilt && exit->args[1 - a]->args[0] == k)
            return true;
    return false;
}

static bool same_constant(const Inst *a, const Inst *b) {
    return a == b || (ir_is_const(a) && a->op == b->op && !memcmp(&a->imm.i, &b->imm.i, sizeof a->imm.i));
}

static Part carried(const Pieces *p, const Inst *loop, uint32_t k) {
    const Block *body = loop->region[0];
    const Inst *param = body->params[k + 1], *first = loop->args[k], *next = body->last->args[k + 1];
    Part from = at(p, first), to = at(p, next);
    const bool counted = is_steady(at(p, body->last->args[0])), over = goes_over_pieces(p, loop);
    if (at(p, param).kind == BROKEN || from.kind == BROKEN || to.kind == BROKEN) return just(BROKEN);
    if (next == param || p->of[next->id].kind == UNSEEN) return is_steady(from) ? just(STEADY) : from;
    if (from.kind == to.kind && (from.kind == UNIT || from.kind == FOUND)) return from;
    if (to.kind == SUM && to.base == param) return to;
    if (is_share(from) && is_share(to) && (from.kind == SHARE || to.kind == SHARE)) return just(SHARE);
    if (is_own(from) && is_own(to)) return just(OWN);
    if (is_steady(from) && is_steady(to)) return just(counted || same_constant(first, next) ? STEADY : BROKEN);
    return just((is_steady(from) || is_own(from)) && (is_steady(to) || is_own(to)) && counted && !over ? OWN : BROKEN);
}

static Part loop_result(const Pieces *p, const Inst *self, const Inst *loop, uint32_t k) {
    const Block *body = loop->region[0];
    const Inst *param = body->params[k + 1], *first = loop->args[k], *next = body->last->args[k + 1];
    Part to = at(p, next), exit = at(p, body->last->args[0]);
    const bool over = goes_over_pieces(p, loop), adds = to.kind == SUM && to.base == param;
    if (next == param) return at(p, first);
    if (to.kind == UNIT) return to;
    if (over) {
        const Inst *base = base_of(p, first);
        return ends_with_pieces(p, loop) && adds && base ? (Part){STEADY, base} : just(BROKEN);
    }
    if (!is_steady(exit) || at(p, param).kind == BROKEN) return just(BROKEN);
    if (!adds) return to.kind == SUM ? (Part){SUM, self} : to;
    return is_share(at(p, first)) ? just(SHARE) : (Part){SUM, base_of(p, first) ? base_of(p, first) : self};
}

static void walk(Pieces *p, const Block *b, bool chosen);

static void walk_loop(Pieces *p, const Inst *loop, bool chosen) {
    const Block *body = loop->region[0];
    const bool counted = is_steady(at(p, body->last->args[0]));
    put(p, body->params[0], just(counted && !goes_over_pieces(p, loop) ? STEADY : BROKEN));
    for (uint32_t k = 0; k < loop->nargs; k++) put(p, body->params[k + 1], carried(p, loop, k));
    walk(p, body, chosen || !counted);
}

static Part result(const Pieces *p, const Inst *i) {
    const Inst *owner = i->args[0];
    const uint32_t k = (uint32_t)i->imm.i;
    if (owner->op == OP_loop) return loop_result(p, i, owner, k);
    if (owner->op == OP_if_)
        return choice(p, i, owner->args[0], owner->region[0]->last->args[k], owner->region[1]->last->args[k]);
    return other(p, owner); /* a function with a derivative of its own */
}

static Part value_of(const Pieces *p, const Inst *i) {
    Inst *const *a = i->args;
    switch ((Op)i->op) {
    case OP_query: return query(p, i);
    case OP_i2f: return at(p, a[0]).kind == UNIT ? just(UNIT) : other(p, i);
    case OP_told: return told(p, i);
    case OP_ghost: return just(ZERO);
    case OP_constf: return just(i->imm.f == 0 ? ZERO : STEADY);
    case OP_fadd:
    case OP_fsub: return sum(p, i, a[0], a[1]);
    case OP_fmul:
    case OP_zmul: return product(i, at(p, a[0]), at(p, a[1]));
    case OP_fdiv: return quotient(i, at(p, a[0]), at(p, a[1]));
    case OP_ffma: return multiply_add(p, i);
    case OP_fneg:
    case OP_detach: return at(p, a[0]).kind == SUM ? (Part){SUM, i} : at(p, a[0]);
    case OP_fsel:
    case OP_isel:
    case OP_bsel: return choice(p, i, a[0], a[1], a[2]);
    case OP_proj: return result(p, i);
    case OP_load: return at(p, a[0]).kind == STEADY ? just(STEADY) : at(p, a[0]);
    default: return asks_found(p, i) ? just(FOUND) : other(p, i);
    }
}

static void walk(Pieces *p, const Block *b, bool chosen) {
    for (const Inst *i = b->first; i; i = i->next) switch ((Op)i->op) {
        case OP_if_:
            for (uint32_t r = 0; r < 2; r++) walk(p, i->region[r], chosen || !is_steady(at(p, i->args[0])));
            break;
        case OP_loop: walk_loop(p, i, chosen); break;
        case OP_store: store(p, i, chosen); break;
        case OP_acopy:
            if (chosen || at(p, i->args[1]).kind != STEADY) put(p, i->args[0], just(BROKEN));
            break;
        case OP_alloc:
        case OP_yield: break;
        default: put(p, i, value_of(p, i));
        }
}

bool warn_pieces(Fn *fn, const Inst *query, bool many) {
    enum { MOST_WALKS = 64 };
    Arena *scratch = &fn->session->scratch;
    ArenaMark mark = arena_mark(scratch);
    Pieces p = {.query = query, .of = ARENA_ARRAY(scratch, Part, fn->ninsts + 1), .changed = true};
    for (uint32_t n = 0; p.changed && n < MOST_WALKS; n++) p.changed = false, walk(&p, fn->body, false);
    bool jumps = p.changed;
    for (uint32_t k = 0; k < fn->body->last->nargs; k++) {
        Part x = at(&p, fn->body->last->args[k]);
        jumps |= !is_steady(x) && (many || (x.kind != SHARE && x.kind != SUM));
    }
    arena_reset(scratch, mark);
    return jumps;
}
