/* Loops that march along a ray until they are near enough to something:
 *
 *     for (int i = 0; i < 80; i++) { float h = map(ro + rd * t); if (h < 0.001 || t > 20.0) break; t += h; }
 *
 * Where such a loop ends changes from pixel to pixel, by a step that is smaller than the threshold: that is no boundary
 * that anybody sees, and next to a silhouette there are more of them than could be told apart. The boundary lies in
 * what asks afterwards (`if (t < 20.0)`, which material). So the statements that do nothing but end the loop are
 * [NoDisc], as one would write it in the language, and one that says that something was hit (`{ hit = true; break; }`,
 * `return t;`) is [SkipLoop]: one boundary of all steps. Loops that count steps, or hand on what jumps from step to
 * step (`m = h.y`, the number of a material), show where they end, and stay as they are. */
#include "compiler/front/glsl/glsl.h"

/* Thresholds of marches are smaller, radii of escape larger. */
static const double SMALL = 0.05;

typedef struct March {
    Parser *p;
    const char *name; /* whose uses are counted */
    uint32_t uses;
    bool counts, hands_on;
    Vec(const char *) harmless; /* declared in the loop, or what the threshold is for */
} March;

static bool is_small(const March *m, const Expr *e) {
    if (e->kind == E_LITERAL)
        return e->type && e->type->kind == T_FLOAT && e->cval.v[0].f < SMALL && e->cval.v[0].f > 0;
    if (e->kind == E_BINARY && e->op == OPR_MUL) return is_small(m, e->a[0]) || is_small(m, e->a[1]);
    if (e->kind != E_NAME) return false;
    for (const Symbol *s = m->p->module->consts; s; s = s->next)
        if (s->name == e->name) return s->init && s->init->kind == E_LITERAL && is_small(m, s->init);
    return false;
}

static bool is_threshold(const March *m, const Expr *e) {
    if (e->kind == E_LOGIC) return is_threshold(m, e->a[0]) || is_threshold(m, e->a[1]);
    if (e->kind != E_BINARY) return false;
    bool below = e->op == OPR_LT || e->op == OPR_LE, above = e->op == OPR_GT || e->op == OPR_GE;
    return (below && is_small(m, e->a[1])) || (above && is_small(m, e->a[0]));
}

static bool only_breaks(const Stmt *st) {
    if (st->kind == S_BLOCK) return st->nstmts == 1 && only_breaks(st->stmts[0]);
    return st->kind == S_BREAK;
}

/* `{ hit = true; break; }`, `return t;` */
static bool leaves(const Stmt *st) {
    if (st->kind == S_BLOCK) return st->nstmts && leaves(st->stmts[st->nstmts - 1]);
    return st->kind == S_BREAK || st->kind == S_RETURN;
}

static bool is_exit(const Stmt *st) { return st->kind == S_IF && !st->orelse && st->body && only_breaks(st->body); }
static bool is_loop(const Stmt *st) { return st->kind == S_FOR || st->kind == S_WHILE || st->kind == S_DO; }

static bool is_hit(const March *m, const Stmt *st) {
    return st->kind == S_IF && !st->orelse && st->body && leaves(st->body) && st->expr && is_threshold(m, st->expr);
}

static void note_tested(March *m, const Expr *e) {
    if (e->kind == E_NAME) vec_push(&m->p->s->module, &m->harmless, e->name);
    if (e->kind != E_LOGIC && e->kind != E_BINARY && e->kind != E_CALL) return;
    for (int i = 0; i < 2; i++)
        if (e->a[i]) note_tested(m, e->a[i]);
    for (uint32_t i = 0; i < e->nargs; i++) note_tested(m, e->args[i]);
}

/* The statements of a loop's body that belong to this loop. */
static void own(March *m, Stmt *st, void (*visit)(March *m, Stmt *st, bool *found), bool *found) {
    if (!st) return;
    visit(m, st, found);
    for (uint32_t i = 0; i < st->nstmts; i++)
        if (!is_loop(st->stmts[i])) own(m, st->stmts[i], visit, found);
    if (st->kind != S_IF) return;
    own(m, st->body, visit, found);
    own(m, st->orelse, visit, found);
}

static void find_threshold(March *m, Stmt *st, bool *found) {
    for (uint32_t i = 0; i < st->ndecls; i++) vec_push(&m->p->s->module, &m->harmless, st->decls[i]->name);
    if (!is_hit(m, st)) return;
    *found = true;
    note_tested(m, st->expr);
}

static void leave_out(March *m, Stmt *st, bool *found) {
    StmtAttrs *a = &st->attrs;
    (void)found;
    if (a->disc || a->nodisc) return;
    if (is_exit(st)) a->nodisc = true;
    else if (is_hit(m, st)) a->disc = a->skip_loop = true, a->disc_span = a->skip_span = st->span;
}

/* `p = ro + rd * t` goes on where it was; what a function or a component says may jump. */
static bool is_arithmetic(const Expr *e) {
    if (!e) return true;
    if (e->kind != E_NAME && e->kind != E_LITERAL && e->kind != E_BINARY && e->kind != E_UNARY) return false;
    return is_arithmetic(e->a[0]) && is_arithmetic(e->a[1]);
}

static bool hands_on(const March *m, const Expr *set) {
    const Expr *to = set->a[0];
    bool whole = to->kind == E_NAME;
    while (to->kind == E_FIELD || to->kind == E_INDEX) to = to->a[0];
    for (uint32_t i = 0; to->kind == E_NAME && i < m->harmless.len; i++)
        if (m->harmless.data[i] == to->name) return false;
    return !whole || !is_arithmetic(set->a[1]);
}

static void count_expr(March *m, const Expr *e) {
    if (!e) return;
    m->hands_on |= e->kind == E_ASSIGN && e->op == OPR_NONE && hands_on(m, e);
    m->uses += e->kind == E_NAME && e->name == m->name;
    m->counts |= e->kind == E_INCDEC || (e->kind == E_ASSIGN && e->op == OPR_ADD && e->a[1]->kind == E_LITERAL);
    for (int i = 0; i < 3; i++) count_expr(m, e->a[i]);
    for (uint32_t i = 0; i < e->nargs; i++) count_expr(m, e->args[i]);
}

static void count(March *m, const Stmt *st) {
    if (!st) return;
    if (is_hit(m, st)) { /* what happens there happens once */
        count_expr(m, st->expr);
        return;
    }
    for (uint32_t i = 0; i < st->ndecls; i++) count_expr(m, st->decls[i]->init);
    count(m, st->init);
    count_expr(m, st->expr);
    if (st->step) { /* a loop's own counter is looked at by name */
        bool before = m->counts;
        count_expr(m, st->step);
        m->counts = before;
    }
    for (uint32_t i = 0; i < st->nargs; i++) count_expr(m, st->args[i]);
    count(m, st->body);
    count(m, st->orelse);
    for (uint32_t i = 0; i < st->nstmts; i++) count(m, st->stmts[i]);
    for (uint32_t c = 0; c < st->ncases; c++)
        for (uint32_t i = 0; i < st->cases[c].nbody; i++) count(m, st->cases[c].body[i]);
}

/* Does what the loop leaves behind tell at which step it ended? */
static bool shows_steps(March *m, const Func *f, const Stmt *loop) {
    m->counts = m->hands_on = false, m->name = NULL;
    count(m, loop->body);
    if (m->counts || m->hands_on) return true;
    if (loop->kind != S_FOR || !loop->init || loop->init->kind != S_EXPR) return false;
    const Expr *set = loop->init->expr; /* `for (i = 0; …)`: i lives on */
    if (!set || set->kind != E_ASSIGN || set->a[0]->kind != E_NAME) return true;
    m->name = set->a[0]->name;
    m->uses = 0, count(m, loop);
    uint32_t inside = m->uses;
    m->uses = 0, count(m, f->body);
    return m->uses > inside;
}

static void mark(March *m, const Func *f, Stmt *st) {
    if (!st) return;
    if (is_loop(st)) {
        bool marches = false;
        m->harmless.len = 0;
        own(m, st->body, find_threshold, &marches);
        if (marches && !shows_steps(m, f, st)) own(m, st->body, leave_out, &marches);
    }
    mark(m, f, st->body);
    mark(m, f, st->orelse);
    for (uint32_t i = 0; i < st->nstmts; i++) mark(m, f, st->stmts[i]);
    for (uint32_t c = 0; c < st->ncases; c++)
        for (uint32_t i = 0; i < st->cases[c].nbody; i++) mark(m, f, st->cases[c].body[i]);
}

void glsl_mark_marches(Parser *p) {
    March m = {.p = p};
    for (Func *f = p->module->funcs; f; f = f->next) mark(&m, f, f->body);
}
