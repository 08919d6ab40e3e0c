/* Twins: two sites whose g are one where some parameters are equal, as those of d < a and d < b are where a = b. The
 * integral has a kink there: the two go apart both ways, in another order each.
 *
 * Both g are sums of terms of which those that change with the position must be the same but for what does not change
 * with it: two circles with two centres are twins, too. Of parameters that are taken from arrays by the number of an
 * iteration, d < p[i] and d < q[i], each iteration is one to ask. Whether the parameters are equal the runtime asks
 * (runtime/sample/twins.c). */
#include "compiler/pass/depend.h"
#include "compiler/pass/walk.h"

enum { MOST_SITES = 64, MOST_TERMS = 8, DEEP = 8, FUEL = 256 /* steps of one comparison */ };

/* factor * a, or factor * a * b */
typedef struct Term {
    double factor;
    const Inst *a, *b;
} Term;

typedef struct Sum {
    uint32_t n, nstill; /* MOST_TERMS + 1: more than are looked at */
    Term term[MOST_TERMS], still[MOST_TERMS];
} Sum;

typedef struct Matcher {
    const Depend *of;
    uint32_t fuel;
    bool moves;   /* parameters are different */
    bool indexed; /* some are of arrays, by the number of an iteration */
} Matcher;

static bool varies(const Matcher *m, const Inst *v) { return m->of[v->id].on & (DEPENDS_X | DEPENDS_RAND); }

static bool match(Matcher *m, const Inst *u, const Inst *v) {
    if (u == v) return true;
    if (!m->fuel || u->type != v->type || varies(m, u) != varies(m, v)) return false;
    m->fuel--;
    if (!varies(m, u)) {
        m->indexed |= walk_is_indexed(u, DEEP) || walk_is_indexed(v, DEEP);
        m->moves |= ((m->of[u->id].on | m->of[v->id].on) & DEPENDS_PARAM) != 0;
        return !ir_is_const(u) || !ir_is_const(v) || u->imm.f == v->imm.f;
    }
    bool same = u->op == v->op && u->nargs == v->nargs && u->imm.i == v->imm.i && walk_is_pure(u) && !u->nregions;
    for (uint32_t a = 0; a < u->nargs && same; a++) same = match(m, u->args[a], v->args[a]);
    return same;
}

static void add_terms(const Matcher *m, const Inst *v, double factor, Sum *s) {
    const Inst *p = v->nargs > 0 ? v->args[0] : NULL, *q = v->nargs > 1 ? v->args[1] : NULL;
    if (s->n > MOST_TERMS || s->nstill > MOST_TERMS) return;
    if (!varies(m, v)) {
        if (s->nstill < MOST_TERMS) s->still[s->nstill] = (Term){factor, v, NULL};
        s->nstill++;
        return;
    }
    switch ((Op)v->op) {
    case OP_fneg: add_terms(m, p, -factor, s); return;
    case OP_fadd:
    case OP_fsub: add_terms(m, p, factor, s), add_terms(m, q, v->op == OP_fsub ? -factor : factor, s); return;
    case OP_fmul:
        if (p->op == OP_constf || q->op == OP_constf) {
            bool first = p->op == OP_constf;
            add_terms(m, first ? q : p, factor * (first ? p : q)->imm.f, s);
            return;
        }
        break;
    case OP_ffma: add_terms(m, v->args[2], factor, s); break;
    default: break;
    }
    bool product = v->op == OP_ffma || v->op == OP_fmul;
    if (s->n < MOST_TERMS) s->term[s->n] = (Term){factor, product ? p : v, product ? q : NULL};
    s->n++;
}

static bool match_terms(Matcher *m, const Term *s, const Term *t) {
    if (!s->b != !t->b) return false;
    if (!s->b) return match(m, s->a, t->a);
    return (match(m, s->a, t->a) && match(m, s->b, t->b)) || (match(m, s->a, t->b) && match(m, s->b, t->a));
}

/* Are the parts that do not change with the position made of different parameters? */
static bool parts(Matcher *m, const Sum *s, const Sum *t, double ratio) {
    bool same = s->nstill == t->nstill, moves = false;
    for (uint32_t i = 0; i < s->nstill; i++) {
        m->indexed |= walk_is_indexed(s->still[i].a, DEEP);
        moves |= (m->of[s->still[i].a->id].on & DEPENDS_PARAM) != 0;
        same &= i < t->nstill && s->still[i].a == t->still[i].a && ratio * s->still[i].factor == t->still[i].factor;
    }
    for (uint32_t i = 0; i < t->nstill; i++) {
        m->indexed |= walk_is_indexed(t->still[i].a, DEEP);
        moves |= (m->of[t->still[i].a->id].on & DEPENDS_PARAM) != 0;
    }
    return moves && !same;
}

/* g of q is so many times that of p; 0: they are no twins. */
static double ratio_of(const Depend *of, const Inst *p, const Inst *q, bool *indexed) {
    Matcher m = {.of = of, .fuel = FUEL};
    Sum s = {0}, t = {0};
    double ratio = 0;
    uint32_t taken = 0;
    add_terms(&m, p, 1, &s), add_terms(&m, q, 1, &t);
    if (s.n != t.n || !s.n || s.n > MOST_TERMS || s.nstill > MOST_TERMS || t.nstill > MOST_TERMS) return 0;
    for (uint32_t i = 0; i < s.n; i++) {
        uint32_t k = 0;
        for (; k < t.n; k++) {
            double by = t.term[k].factor / s.term[i].factor;
            if (taken >> k & 1 || (ratio != 0 && by != ratio) || !match_terms(&m, &s.term[i], &t.term[k])) continue;
            taken |= 1u << k, ratio = by;
            break;
        }
        if (k == t.n) return 0;
    }
    bool twins = parts(&m, &s, &t, ratio) || m.moves;
    *indexed = m.indexed;
    return twins ? ratio : 0;
}

typedef struct Found {
    const Inst *site[MOST_SITES];
    uint32_t n;
} Found;

static void find_sites(const Fn *fn, const Block *b, Found *to) {
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) find_sites(fn, i->region[r], to);
        if (i->op != OP_site || fn->sites[i->imm.i].kind != SITE_COMPARE) continue;
        if (fn->sites[i->imm.i].skip_loop || fn->sites[i->imm.i].still) continue;
        if (to->n < MOST_SITES) to->site[to->n] = i;
        to->n++;
    }
}

/* Of the same iterations of the same loops? */
static bool is_beside(const Inst *p, const Inst *q) {
    bool is = p->nargs == q->nargs;
    for (uint32_t a = 2; a < p->nargs && is; a++) is = p->args[a] == q->args[a];
    return is;
}

uint32_t depend_twins(Fn *fn, Arena *arena, Twins **out) {
    ArenaMark mark = arena_mark(&fn->session->scratch);
    const Depend *of = depend_values(fn, (DependOptions){0});
    Found f = {.n = 0};
    uint32_t n = 0;
    find_sites(fn, fn->body, &f);
    if (f.n > MOST_SITES) f.n = 0;
    *out = ARENA_ARRAY(arena, Twins, f.n * f.n / 2 + 1);
    for (uint32_t i = 1; i < f.n; i++)
        for (uint32_t k = 0; k < i; k++) {
            const Inst *p = f.site[k], *q = f.site[i];
            bool indexed = false;
            double times = is_beside(p, q) ? ratio_of(of, p->args[1], q->args[1], &indexed) : 0;
            if (times == 0) continue;
            (*out)[n++] = (Twins){{(uint32_t)p->imm.i, (uint32_t)q->imm.i}, times, indexed};
        }
    arena_reset(&fn->session->scratch, mark);
    return n;
}
