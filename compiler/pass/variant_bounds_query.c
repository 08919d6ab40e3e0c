/* Bounds of queries: the geometry is asked about the box of rays (SLT_QUERY_BLOCKED, SLT_QUERY_LINE).
 *
 * A witness names a place, and is one number only where no ray meets anything. Whether a ray meets anything, the
 * comparison with SLT_WITNESS_NONE, is known where all rays of the box do. The place may jump from one ridge to the
 * next though all rays meet one: what depends on it stays open. */
#include "compiler/pass/variant_bounds.h"

#include <math.h>

static bool is_search(const Inst *i) {
    if (i->op != OP_query || query_rows[i->imm.query.what].ray != RAY_SEGMENT) return false;
    QueryRole role = query_rows[i->imm.query.what].role;
    return role == ROLE_SILHOUETTE || role == ROLE_SHADOW;
}

/* Of a comparison "does this ray meet anything": the query; else NULL. */
static const Inst *search_of(const Inst *i) {
    if (i->op != OP_ine && i->op != OP_ieq) return NULL;
    for (uint32_t a = 0; a < 2; a++) {
        const Inst *none = i->args[1 - a];
        if (is_search(i->args[a]) && none->op == OP_consti && none->imm.i == SLT_WITNESS_NONE) return i->args[a];
    }
    return NULL;
}

/* A query of the box of a query's rays; which: of a LINE alone. */
static Inst *ask(Boxes *x, Builder *b, const Inst *i, SltQuery what, uint32_t which) {
    Inst *args[SLT_LINE_ROWS];
    for (uint32_t a = 0; a < SLT_RAY_ROWS; a++) {
        Bound v = {0};
        if (a < i->nargs) v = ir_bound_ends(b, x->value[i->args[a]->id].is);
        args[a] = v.lo ? v.lo : ir_constf(b, NAN);
        args[a + SLT_RAY_ROWS] = v.hi ? v.hi : ir_constf(b, NAN);
    }
    Imm imm = i->imm;
    imm.query.what = what;
    args[SLT_LINE_WHICH] = ir_constf(b, which);
    return ir_special(b, OP_query, TY_INT, what == SLT_QUERY_LINE ? SLT_LINE_ROWS : SLT_BOX_ROWS, args, imm);
}

static Inst *is(Builder *b, Inst *answer, int32_t what) { return bounds_op2(b, OP_ieq, answer, ir_consti(b, what)); }

void bounds_query(Boxes *x, Builder *b, const Inst *i) {
    Bound whole = ir_bound_whole(b, TY_INT);
    Boxed *v = &x->value[i->id];
    *v = (Boxed){.is = whole, .open = ir_consti(b, OPEN_JUMP)};
    if (!is_search(i)) return;
    /* The answer is found again behind the witness's ends (bounds_found). */
    Inst *answer = ask(x, b, i, SLT_QUERY_BLOCKED, 0), *free = is(b, answer, SLT_RAYS_FREE),
         *none = ir_consti(b, SLT_WITNESS_NONE);
    x->answer[i->id] = answer;
    v->is.lo = bounds_choose(b, free, none, whole.lo);
    v->is.hi = bounds_choose(b, free, none, whole.hi);
    v->open = open_where(b, free, NULL, v->open);
}

bool bounds_found(Boxes *x, Builder *b, const Inst *i) {
    const Inst *search = search_of(i);
    if (!search) return false;
    Inst *answer = x->answer[search->id], *all = is(b, answer, SLT_RAYS_BLOCKED),
         *some = bounds_not(b, is(b, answer, SLT_RAYS_FREE));
    Boxed v = {.is = {all, some}};
    if (i->op == OP_ieq) v.is = (Bound){bounds_not(b, some), bounds_not(b, all)};
    v.open = open_where(b, bounds_undecided(b, v.is), ir_consti(b, OPEN_JUMP), NULL);
    x->value[i->id] = v;
    return true;
}

const Inst *bounds_searched(const Boxes *x, const Inst *site) {
    const Inst *search = search_of(site->args[0]);
    return search && x->answer[search->id] ? search : NULL;
}

Inst *bounds_line(Boxes *x, Builder *b, const Inst *search, uint32_t which) {
    return ask(x, b, search, SLT_QUERY_LINE, which);
}
