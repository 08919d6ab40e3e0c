/* Trip counts.
 *
 * A loop is bounded if some counter of it moves by a constant towards a bound, and start, step and bound are known as
 * intervals from constants, len() and the counters of the loops around. Where an interval hangs on an argument of the
 * function (or on a local that is assigned more than once) the answer comes only after inlining: such a loop is left
 * with trip_bound 0, and gen decides and reports. Everything else needs [MaxIters]. */
#include "compiler/front/check/internal.h"

#include <math.h>
#include <stdlib.h>

#include "compiler/front/rows.h"
#include "compiler/ir/range.h"

typedef struct Range {
    int64_t lo, hi;
    bool defer; /* inlining may tell more */
} Range;

typedef struct Loops {
    Checker *c;
    Func *func;
    Range *range; /* by Symbol.id */
    bool *known;
    uint32_t *writes;  /* assignments beyond the initialiser */
    Symbol **first;    /* declarations, for the initial value of a counter that the loop does not initialise */
    Symbol *unbounded; /* the last name that was found to have no bound, for the message */
} Loops;

static Range full(TypeKind k, bool defer) {
    return k == T_UINT   ? (Range){0, UINT32_MAX, defer}
           : k == T_BOOL ? (Range){0, 1, defer}
                         : (Range){INT32_MIN, INT32_MAX, defer};
}

static int64_t least(int64_t a, int64_t b) { return a < b ? a : b; }
static int64_t most(int64_t a, int64_t b) { return a > b ? a : b; }

static int64_t times(int64_t a, int64_t b) {
    int64_t p;
    return __builtin_mul_overflow(a, b, &p) ? INT64_MAX : p; /* of two positive numbers */
}

/* An integer that may wrap may be any. */
static Range fit(TypeKind k, double lo, double hi, bool defer) {
    Range all = full(k, defer);
    return lo < all.lo || hi > all.hi ? all : (Range){(int64_t)lo, (int64_t)hi, defer};
}

/* By the range column of ops.def, whose intervals are those of numbers that do not wrap: of uint, numbers that are not
 * negative. */
static Range row_range(Op row, TypeKind k, Range a, Range b) {
    bool defer = a.defer || b.defer;
    if (row == OP_COUNT || ir_ops[row].arg != TY_INT) return full(k, defer);
    IrRange r = ir_range_row(row, (IrRange){(double)a.lo, (double)a.hi, 0}, (IrRange){(double)b.lo, (double)b.hi, 0},
                             IR_RANGE_FINITE, false);
    return fit(k, r.lo, r.hi, defer);
}

static Range eval(Loops *l, const Expr *e);

static Range eval_name(Loops *l, const Expr *e, TypeKind k) {
    const Symbol *sym = e->sym;
    if (sym && (sym->kind == SYM_LOCAL || sym->kind == SYM_ARG)) {
        if (l->known[sym->id]) return l->range[sym->id];
        l->unbounded = e->sym;
        return full(k, true);
    }
    l->unbounded = e->sym;
    return full(k, false);
}

static Range eval(Loops *l, const Expr *e) {
    TypeKind k = scalar_kind(e->type);
    if (e->is_const && is_scalar(e->type) && k != T_FLOAT) return (Range){e->cval.v[0].i, e->cval.v[0].i, false};
    if (!is_scalar(e->type)) return full(T_INT, false);
    bool swap; /* not used: only comparisons are swapped, and these have no range */
    switch (e->kind) {
    case E_NAME: return eval_name(l, e, k);
    case E_BINARY: {
        if (width_of(e->a[0]->type) != 1 || scalar_kind(e->a[0]->type) != k) return full(k, false);
        Range a = eval(l, e->a[0]), b = eval(l, e->a[1]);
        return row_range(row_of_operator(e->op, k, &swap), k, a, b);
    }
    case E_UNARY: {
        Range a = eval(l, e->a[0]);
        return e->op == OPR_PLUS ? a : row_range(row_of_operator(e->op, k, &swap), k, a, a);
    }
    case E_COND: {
        Range a = eval(l, e->a[1]), b = eval(l, e->a[2]);
        return (Range){least(a.lo, b.lo), most(a.hi, b.hi), a.defer || b.defer};
    }
    case E_CONVERT: {
        TypeKind from = scalar_kind(e->a[0]->type);
        if (from == T_FLOAT || from == T_ERROR || k == T_FLOAT) return full(k, false);
        Range a = eval(l, e->a[0]);
        return fit(k, (double)a.lo, (double)a.hi, a.defer);
    }
    case E_BUILTIN: {
        if ((e->builtin != B_min && e->builtin != B_max && e->builtin != B_clamp && e->builtin != B_abs) ||
            k == T_FLOAT)
            return full(k, false);
        Range a = eval(l, e->args[0]), b = e->nargs > 1 ? eval(l, e->args[1]) : a;
        Op min = row_of_builtin(B_min, k), max = row_of_builtin(B_max, k);
        if (e->builtin == B_min) return row_range(min, k, a, b);
        if (e->builtin == B_max) return row_range(max, k, a, b);
        if (e->builtin == B_abs) return a.lo >= 0 ? a : fit(k, 0, (double)most(-a.lo, a.hi), a.defer);
        return row_range(min, k, row_range(max, k, a, b), eval(l, e->args[2]));
    }
    case E_CALL: return full(k, true); /* after inlining its value may be a constant */
    case E_ASSIGN: return eval(l, e->a[1]);
    case E_INDEX:
    case E_FIELD:
    case E_SWIZZLE: {
        Symbol *root = place_root((Expr *)e);
        l->unbounded = root;
        bool size = !root && e->a[0]->kind == E_METHOD &&
                    methods[e->a[0]->method].kind == METHOD_FIXED; /* known where the resource is, after inlining */
        return full(k, size || (root && (root->kind == SYM_LOCAL || root->kind == SYM_ARG)));
    }
    default: return full(k, false);
    }
}

/* ---- writes */

static void count_write(Expr *e, void *user) {
    Loops *l = user;
    if (e->kind == E_ASSIGN || e->kind == E_INCDEC) {
        Symbol *root = place_root(e->a[0]);
        if (root && (root->kind == SYM_LOCAL || root->kind == SYM_ARG)) l->writes[root->id]++;
    } else if (e->kind == E_CALL && e->func) {
        for (uint32_t i = 0; i < e->nargs; i++)
            if (e->func->args[i]->mode != ARG_IN) {
                Symbol *root = place_root(e->args[i]);
                if (root && (root->kind == SYM_LOCAL || root->kind == SYM_ARG)) l->writes[root->id]++;
            }
    }
}

typedef struct WriteCount {
    const Symbol *sym;
    uint32_t n;
} WriteCount;
static void count_sym(Expr *e, void *user) {
    WriteCount *w = user;
    if ((e->kind == E_ASSIGN || e->kind == E_INCDEC) && place_root(e->a[0]) == w->sym) w->n++;
    if (e->kind == E_CALL && e->func)
        for (uint32_t i = 0; i < e->nargs; i++)
            w->n += e->func->args[i]->mode != ARG_IN && place_root(e->args[i]) == w->sym;
}
static uint32_t writes_in_expr(Expr *e, const Symbol *sym) {
    WriteCount w = {sym, 0};
    visit_expr(e, count_sym, &w);
    return w.n;
}
static uint32_t writes_in_stmt(Stmt *st, const Symbol *sym) {
    WriteCount w = {sym, 0};
    visit_stmt(st, count_sym, &w);
    return w.n;
}

/* ---- the form of a loop */

typedef enum StepKind { STEP_NONE, STEP_ADD, STEP_MUL, STEP_DIV } StepKind;

typedef struct Form {
    Symbol *counter;
    Operator op; /* counter op bound */
    const Expr *bound;
    StepKind step;
    Range by;   /* ADD: signed; MUL, DIV: the factor */
    double fby; /* float counters */
    const Expr *start;
    bool conjunction; /* other conditions may end it earlier: a bound, not a count */
    const char *why;  /* why the loop has no such form */
} Form;

static const Expr *strip(const Expr *e) {
    while (e->kind == E_CONVERT && !e->explicit_cast && e->type->kind != T_ERROR) e = e->a[0];
    return e;
}

/* What one assignment does to the counter. */
static bool step_of(Loops *l, const Expr *e, Form *f) {
    const Symbol *sym = f->counter;
    bool flt = sym->type->kind == T_FLOAT;
    if (e->kind == E_COMMA) {
        bool left = writes_in_expr(e->a[0], sym), right = writes_in_expr(e->a[1], sym);
        return left != right && step_of(l, left ? e->a[0] : e->a[1], f);
    }
    if ((e->kind != E_INCDEC && e->kind != E_ASSIGN) || e->a[0]->kind != E_NAME || e->a[0]->sym != sym) return false;
    if (e->kind == E_INCDEC) {
        int64_t one = e->op == OPR_INC ? 1 : -1;
        f->step = STEP_ADD;
        f->by = (Range){one, one, false};
        f->fby = (double)one;
        return true;
    }
    Operator op = e->op;
    const Expr *v = e->a[1];
    if (op == OPR_NONE) { /* i = i + c */
        if (v->kind != E_BINARY) return false;
        op = v->op;
        if (v->a[0]->kind == E_NAME && v->a[0]->sym == sym) v = v->a[1];
        else if ((op == OPR_ADD || op == OPR_MUL) && v->a[1]->kind == E_NAME && v->a[1]->sym == sym) v = v->a[0];
        else return false;
    }
    if (writes_in_expr((Expr *)v, sym)) return false;
    if (flt) {
        if ((op != OPR_ADD && op != OPR_SUB) || !v->is_const) return false;
        f->step = STEP_ADD;
        f->fby = op == OPR_SUB ? -v->cval.v[0].f : v->cval.v[0].f;
        return true;
    }
    f->by = eval(l, v);
    switch (op) {
    case OPR_ADD: f->step = STEP_ADD; break;
    case OPR_SUB:
        f->step = STEP_ADD;
        f->by = (Range){-f->by.hi, -f->by.lo, f->by.defer};
        break;
    case OPR_MUL: f->step = STEP_MUL; break;
    case OPR_DIV: f->step = STEP_DIV; break;
    case OPR_SHL:
    case OPR_SHR:
        f->step = op == OPR_SHL ? STEP_MUL : STEP_DIV;
        if (f->by.lo < 1 || f->by.hi > 30) return false;
        f->by = (Range){(int64_t)1 << f->by.lo, (int64_t)1 << f->by.hi, f->by.defer};
        break;
    default: return false;
    }
    return true;
}

static bool has_continue(const Stmt *st) {
    if (!st || st->kind == S_FOR || st->kind == S_WHILE || st->kind == S_DO) return false;
    if (st->kind == S_CONTINUE || has_continue(st->body) || has_continue(st->orelse)) return true;
    for (uint32_t i = 0; i < st->nstmts; i++)
        if (has_continue(st->stmts[i])) return true;
    for (uint32_t i = 0; i < st->ncases; i++)
        for (uint32_t j = 0; j < st->cases[i].nbody; j++)
            if (has_continue(st->cases[i].body[j])) return true;
    return false;
}

/* Of `while` and `for (;;)` bodies: the one statement of the body that steps the counter and runs in every iteration.
 */
static const Expr *step_in_body(const Stmt *body, const Symbol *sym) {
    if (body->kind == S_EXPR) return body->expr;
    if (body->kind != S_BLOCK) return NULL;
    for (uint32_t i = 0; i < body->nstmts; i++) {
        Stmt *st = body->stmts[i];
        if (st->kind == S_EXPR && st->expr && writes_in_expr(st->expr, sym)) return st->expr;
        if (has_continue(st)) return NULL;
    }
    return NULL;
}

static const Expr *start_in(const Stmt *init, const Symbol *sym) {
    if (!init) return NULL;
    if (init->kind == S_DECL)
        for (uint32_t i = 0; i < init->ndecls; i++)
            if (init->decls[i] == sym) return init->decls[i]->init;
    if (init->kind == S_EXPR)
        for (const Expr *e = init->expr; e; e = e->kind == E_COMMA ? e->a[0] : NULL) {
            const Expr *last = e->kind == E_COMMA ? e->a[1] : e;
            if (last->kind == E_ASSIGN && last->op == OPR_NONE && last->a[0]->kind == E_NAME && last->a[0]->sym == sym)
                return last->a[1];
        }
    return NULL;
}

/* Tries the comparison `e` as the one that bounds the loop. */
static bool try_form(Loops *l, Stmt *st, Expr *e, bool flip, Form *f) {
    static const Operator mirror[] = {
        [OPR_LT] = OPR_GT, [OPR_LE] = OPR_GE, [OPR_GT] = OPR_LT, [OPR_GE] = OPR_LE, [OPR_NE] = OPR_NE};
    const Expr *i = strip(e->a[flip]);
    if (i->kind != E_NAME || !i->sym || (i->sym->kind != SYM_LOCAL && i->sym->kind != SYM_ARG) || !is_scalar(i->type))
        return false;
    if (e->a[flip]->type->kind == T_UINT && i->type->kind == T_INT) f->why = "it compares an int counter as a uint";
    Symbol *sym = i->sym;
    Form g = {.counter = sym,
              .op = flip ? mirror[e->op] : e->op,
              .bound = e->a[!flip],
              .why = f->why,
              .conjunction = f->conjunction};
    uint32_t in_body = writes_in_stmt(st->body, sym), in_cond = writes_in_expr(st->expr, sym),
             in_step = st->step ? writes_in_expr(st->step, sym) : 0;
    const char *name = sym->name;
    Session *s = l->c->s;
    if (!in_body && !in_cond && !in_step) return false; /* the other side may be the counter */
    if (in_cond || in_body + in_step != 1) {
        f->why = arena_printf(&s->session, "`%s` is changed in more than one place", name);
        return false;
    }
    const Expr *step = in_step ? st->step : step_in_body(st->body, sym);
    if (!step || !step_of(l, step, &g)) {
        f->why = arena_printf(&s->session, "`%s` does not move by a constant in every iteration", name);
        return false;
    }
    g.start = start_in(st->init, sym);
    if (!g.start && sym->kind == SYM_LOCAL && l->writes[sym->id] == 1 && l->first[sym->id])
        g.start = l->first[sym->id]->init; /* only this loop moves the counter */
    *f = g;
    return true;
}

static bool find_form(Loops *l, Stmt *st, Expr *cond, Form *f) {
    if (cond->kind == E_LOGIC && cond->op == OPR_LAND) {
        f->conjunction = true;
        return find_form(l, st, cond->a[0], f) || find_form(l, st, cond->a[1], f);
    }
    if (cond->kind != E_BINARY || cond->op < OPR_NE || cond->op > OPR_GE || !is_scalar(cond->a[0]->type)) {
        if (!f->why) f->why = "its condition does not compare a counter with a bound";
        return false;
    }
    if (try_form(l, st, cond, false, f) || try_form(l, st, cond, true, f)) return true;
    if (!f->why) f->why = "its condition does not compare a counter with a bound";
    return false;
}

/* ---- counting */

#define ENDLESS INT64_MAX
#define UNKNOWN (INT64_MAX - 1)

/* Most trips of an integer form from start a to bound b. */
static int64_t int_trips(const Form *f, Range a, Range b, Range type) {
    if (f->op == OPR_NE) {
        if (f->step == STEP_DIV && a.lo >= 0 && b.lo == 0 && b.hi == 0) {
            Form g = *f;
            g.op = OPR_GT;
            return int_trips(&g, a, b, type);
        }
        if (f->step != STEP_ADD || f->by.lo != f->by.hi || !f->by.lo) return UNKNOWN;
        int64_t c = f->by.lo;
        if (a.lo == a.hi && b.lo == b.hi)
            return (b.lo - a.lo) % c == 0 && (b.lo - a.lo) / c >= 0 ? (b.lo - a.lo) / c : ENDLESS;
        if (c == 1 && a.hi <= b.lo) return b.hi - a.lo;
        if (c == -1 && b.hi <= a.lo) return a.hi - b.lo;
        return UNKNOWN;
    }
    bool up = f->op == OPR_LT || f->op == OPR_LE, closed = f->op == OPR_LE || f->op == OPR_GE;
    int64_t limit = up ? b.hi + closed : b.lo - closed; /* runs while i < limit, i > limit */
    if (up ? a.lo >= limit : a.hi <= limit) return 0;
    if (f->step == STEP_ADD) {
        if (up ? f->by.lo < 1 : f->by.hi > -1) return f->by.defer ? UNKNOWN : ENDLESS;
        if (up ? limit - 1 + f->by.hi > type.hi : limit + 1 + f->by.lo < type.lo)
            return b.lo == b.hi ? ENDLESS : UNKNOWN; /* the counter wraps around before the loop ends */
        return up ? (limit - a.lo + f->by.lo - 1) / f->by.lo : (a.hi - limit - f->by.hi - 1) / -f->by.hi;
    }
    if (f->by.lo < 2) return UNKNOWN;
    int64_t n = 0;
    if (f->step == STEP_MUL) {
        if (!up || a.lo < 1) return UNKNOWN;
        if (times(limit - 1, f->by.hi) > type.hi) return UNKNOWN; /* so that v stays within the type below */
        for (int64_t v = a.lo; v < limit; v *= f->by.lo) n++;
        return n;
    }
    if (up || limit < 0) return UNKNOWN;
    for (int64_t v = a.hi; v > limit; v /= f->by.lo) n++;
    return n;
}

/* Trips of a float counter with constant start, bound and step. Each sum is rounded, so the bound allows steps to be
 * 1/16 shorter, which holds while the step is above 2^-20 of the largest value (in binary32; binary64 is far inside).
 */
static int64_t float_trips(const Form *f, double a, double b) {
    double c = f->fby;
    bool up = f->op == OPR_LT || f->op == OPR_LE;
    if (f->op == OPR_NE || !isfinite(a) || !isfinite(b) || !isfinite(c)) return UNKNOWN;
    if (up ? a > b : a < b) return 0;
    if (up ? c <= 0 : c >= 0) return ENDLESS;
    double size = fmax(fabs(a), fabs(b)) + fabs(c);
    if (fabs(c) < size / 1048576) return UNKNOWN;
    double n = floor(fabs(b - a) / (fabs(c) * 15 / 16)) + 2;
    return n > 1e15 ? UNKNOWN : (int64_t)n;
}

typedef struct Trips {
    int64_t most; /* or ENDLESS, UNKNOWN */
    bool exact;   /* always exactly `most`, unless the body breaks */
    bool defer;
    Range counter; /* values inside the body */
    Symbol *sym;
    const char *why;
} Trips;

static const char *unbounded_text(Loops *l) {
    const Symbol *sym = l->unbounded;
    Session *s = l->c->s;
    if (sym && sym->kind == SYM_PARAM)
        return arena_printf(&s->session, "`%s` is a parameter, which has no bound", sym->name);
    if (sym) return arena_printf(&s->session, "`%s` has no constant bound", sym->name);
    return "its trip count is not bounded by constants";
}

/* q = m.next(q) */
static bool takes_next(const Expr *e, const Symbol *q) {
    return e && e->kind == E_ASSIGN && e->op == OPR_NONE && e->a[0]->kind == E_NAME && e->a[0]->sym == q &&
           e->a[1]->kind == E_METHOD && e->a[1]->method == M_MESH_NEXT && e->a[1]->nargs == 1 &&
           e->a[1]->args[0]->kind == E_NAME && e->a[1]->args[0]->sym == q;
}

/* How many pieces a window sees of a mesh, at most: faces that cross each other can make more, and a loop that is cut
 * short is counted. */
enum { PIECES_A_FACE = 64, PIECES_LEAST = 4096 };

/* Does the loop go over the pieces of a mesh, `for (Piece q = m.first(b); q.found; q = m.next(q))`? Then *most is how
 * often it runs at most. */
static bool visits_pieces(Loops *l, const Stmt *st, int64_t *most) {
    const Expr *e = strip(st->expr);
    if (e->kind != E_FIELD || e->field || e->a[0]->kind != E_NAME || e->a[0]->type != l->c->t_piece) return false;
    const Symbol *q = e->a[0]->sym;
    const Expr *step = st->step ? st->step : step_in_body(st->body, q);
    if (!takes_next(step, q)) return false;
    const Expr *mesh = step->a[1]->a[0];
    const int64_t faces = mesh->kind == E_NAME && mesh->sym && mesh->sym->kind == SYM_PARAM ? mesh->sym->nfaces : 0;
    *most = faces ? PIECES_A_FACE * faces + PIECES_LEAST : CHECK_MAX_TRIPS;
    if (*most > CHECK_MAX_TRIPS) *most = CHECK_MAX_TRIPS;
    return true;
}

static Trips count_trips(Loops *l, Stmt *st) {
    Trips t = {.most = UNKNOWN};
    Form f = {0};
    if (!st->expr) {
        t.most = ENDLESS;
        t.why = "it has no condition";
        return t;
    }
    if (st->expr->type->kind == T_ERROR) {
        t.most = 1; /* reported already */
        return t;
    }
    if (st->expr->is_const) {
        bool runs = st->expr->cval.v[0].i;
        t.most = runs ? ENDLESS : st->kind == S_DO;
        t.exact = !runs;
        t.why = "its condition is always true";
        return t;
    }
    if (visits_pieces(l, st, &t.most)) {
        st->trip_told = true;
        return t;
    }
    if (!find_form(l, st, st->expr, &f)) {
        t.why = f.why;
        return t;
    }
    l->unbounded = NULL;
    Symbol *sym = f.counter;
    TypeKind k = sym->type->kind;
    if (k == T_FLOAT) {
        if (!f.start || !f.start->is_const || !f.bound->is_const) {
            t.defer = f.start && f.bound->kind == E_NAME && f.bound->sym && f.bound->sym->kind == SYM_ARG;
            t.why = "a float counter needs a constant start and bound";
            return t;
        }
        t.most = float_trips(&f, f.start->cval.v[0].f, f.bound->cval.v[0].f);
        t.why =
            t.most == ENDLESS ? "its counter moves away from the bound" : "its trip count is not bounded by constants";
        return t;
    }
    Range type = full(k, false), a = f.start ? eval(l, f.start) : full(k, true), b;
    if (f.bound->type->kind == T_FLOAT) { /* an int counter against a float: only a constant helps */
        if (!f.bound->is_const) {
            const Expr *bound = strip(f.bound);
            b = bound->type->kind == T_FLOAT
                    ? full(T_INT, bound->kind == E_NAME && bound->sym && bound->sym->kind == SYM_ARG)
                    : eval(l, bound);
            if (bound->kind == E_NAME) l->unbounded = bound->sym;
        } else {
            double v = f.bound->cval.v[0].f;
            v = fmin(fmax(isnan(v) ? 0 : v, -4e9), 4e9);
            /* i < v and i >= v turn at the next integer above, i <= v and i > v at the one below */
            int64_t n = (int64_t)(f.op == OPR_LT || f.op == OPR_GE ? ceil(v) : floor(v));
            b = (Range){n, n, false};
        }
    } else {
        b = eval(l, strip(f.bound));
    }
    t.most = f.why ? UNKNOWN : int_trips(&f, a, b, type);
    if (f.why && a.lo >= 0 && f.step == STEP_ADD && f.by.lo > 0)
        t.most = int_trips(&f, a, b, type); /* never negative: the comparison is the same */
    t.exact = !f.conjunction && a.lo == a.hi && b.lo == b.hi && f.by.lo == f.by.hi && t.most < UNKNOWN;
    t.defer = a.defer || b.defer || f.by.defer;
    t.sym = sym;
    /* Inside the body the condition held when the iteration began (conjunctions too). */
    bool up = f.op == OPR_LT || f.op == OPR_LE;
    if (f.op == OPR_NE || f.step == STEP_NONE) t.counter = (Range){least(a.lo, b.lo), most(a.hi, b.hi), t.defer};
    else if (up) t.counter = (Range){a.lo, most(a.lo, b.hi - (f.op == OPR_LT)), t.defer};
    else t.counter = (Range){least(a.hi, b.lo + (f.op == OPR_GT)), a.hi, t.defer};
    /* [MaxIters] bounds the counter too */
    int64_t n = st->attrs.max_iters && st->attrs.max_iters->is_const ? st->attrs.max_iters->cval.v[0].i : 0;
    if (n > 0 && n <= CHECK_MAX_TRIPS && f.step == STEP_ADD && llabs(f.by.lo) < 1 << 24 && llabs(f.by.hi) < 1 << 24) {
        if (up) t.counter.hi = least(t.counter.hi, a.hi + f.by.hi * (n - 1));
        else if (f.op != OPR_NE) t.counter.lo = most(t.counter.lo, a.lo + f.by.lo * (n - 1));
    }
    if (st->kind == S_DO) {
        t.most = t.most < 1 ? 1 : t.most;
        t.sym = NULL; /* the body may run once although the condition never holds */
    }
    if (!st->step) t.sym = NULL; /* stepped in the body: the counter's range there is one step wider */
    if (t.most == ENDLESS) t.why = arena_printf(&l->c->s->session, "`%s` never reaches the bound", sym->name);
    else if (t.most > CHECK_MAX_TRIPS) t.why = unbounded_text(l);
    return t;
}

/* ---- the walk */

static void walk(Loops *l, Stmt *st);

static void walk_list(Loops *l, Stmt **list, uint32_t n) {
    for (uint32_t i = 0; i < n; i++) walk(l, list[i]);
}

static void walk_loop(Loops *l, Stmt *st) {
    Session *s = l->c->s;
    if (st->init) walk(l, st->init);
    Trips t = count_trips(l, st);
    const Expr *mi = st->attrs.max_iters;
    int64_t n = 0;
    if (mi)
        n = mi->is_const && (mi->type->kind == T_INT || mi->type->kind == T_UINT) ? mi->cval.v[0].i
                                                                                  : 1; /* a bad n was reported */
    if (mi && (n < 1 || n > CHECK_MAX_TRIPS)) n = 1;
    bool proven = t.most <= CHECK_MAX_TRIPS;
    if (proven) {
        st->trip_bound = mi && n < t.most ? n : t.most > 0 ? t.most : 1;
        st->trip_exact = !mi || n >= t.most;
        st->trip_count = t.exact ? least(t.most, mi ? n : t.most) : 0;
    } else if (mi) {
        st->trip_bound = n;
        st->trip_exact = false;
        /* `while (true)` cut by [MaxIters] runs its body at least once */
        st->trip_count = st->expr && st->expr->is_const && st->expr->cval.v[0].i ? n : !st->expr ? n : 0;
    } else if (t.exact && t.most < UNKNOWN) {
        diag_emit(s, DIAG_loop_too_long, st->span, arena_printf(&s->session, "%lld", (long long)t.most));
        st->trip_bound = 1;
    } else if (t.defer && t.most != ENDLESS) {
        st->trip_bound = 0;
        st->trip_exact = false;
    } else if (st->open_ended) {
        st->trip_bound = GLSL_MAX_ITERS;
        st->trip_exact = false;
    } else {
        diag_emit(s, DIAG_loop_needs_max, st->span, t.why ? t.why : "its trip count is not bounded by constants");
        st->trip_bound = 1;
    }
    bool was_known = false;
    Range was = {0};
    if (t.sym) {
        was_known = l->known[t.sym->id];
        was = l->range[t.sym->id];
        l->known[t.sym->id] = true;
        l->range[t.sym->id] = t.counter;
    }
    walk(l, st->body);
    if (t.sym) {
        l->known[t.sym->id] = was_known;
        l->range[t.sym->id] = was;
    }
}

static void walk(Loops *l, Stmt *st) {
    if (!st) return;
    switch (st->kind) {
    case S_DECL:
        for (uint32_t i = 0; i < st->ndecls; i++) {
            Symbol *sym = st->decls[i];
            l->first[sym->id] = sym;
            if (!sym->init || l->writes[sym->id] || (sym->type->kind != T_INT && sym->type->kind != T_UINT)) continue;
            l->range[sym->id] = eval(l, sym->init);
            l->known[sym->id] = true;
        }
        break;
    case S_FOR:
    case S_WHILE:
    case S_DO: walk_loop(l, st); break;
    case S_IF:
        walk(l, st->body);
        walk(l, st->orelse);
        break;
    case S_BLOCK: walk_list(l, st->stmts, st->nstmts); break;
    case S_SWITCH:
        for (uint32_t i = 0; i < st->ncases; i++) walk_list(l, st->cases[i].body, st->cases[i].nbody);
        break;
    case S_EXPR:
    case S_BREAK:
    case S_CONTINUE:
    case S_RETURN:
    case S_EMPTY:
    case S_PRINT:
    case S_ASSERT: break;
    }
}

void check_loops(Checker *c, Func *f) {
    if (!f->nlocals && !f->body) return;
    ArenaMark mark = arena_mark(&c->s->scratch);
    Loops l = {.c = c, .func = f};
    uint32_t n = f->nlocals + 1;
    l.range = ARENA_ARRAY(&c->s->scratch, Range, n);
    l.known = ARENA_ARRAY(&c->s->scratch, bool, n);
    l.writes = ARENA_ARRAY(&c->s->scratch, uint32_t, n);
    l.first = ARENA_ARRAY(&c->s->scratch, Symbol *, n);
    visit_stmt(f->body, count_write, &l);
    walk(&l, f->body);
    arena_reset(&c->s->scratch, mark);
}
