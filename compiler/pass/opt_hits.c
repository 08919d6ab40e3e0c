/* Queries become their weaker ones (queries.def). Where only the hit of a ray counts, not the point, any blocked point
 * will do (WEAKER_FOUND): both agree on whether there is a hit, to the bit. Where nobody reads the sides of pieces,
 * they are not told (WEAKER_SIDES); what the light sees of a piece moves with them too. And what only boxes of rays are
 * asked with goes: the kernels' own rays are points.
 */
#include "compiler/pass/walk.h"
#include "saltus/mesh.h"

static bool may_weaken(const Inst *i) {
    return i->op == OP_query && query_rows[i->imm.query.what].when == WEAKER_FOUND;
}

static bool tells_sides(const Inst *i) {
    return i->op == OP_query && query_rows[i->imm.query.what].when == WEAKER_SIDES;
}

/* How many sides a piece has is what all ask before they read one. Of what is lit of it the derivatives are read
 * through its answer, the value alone by it. */
static bool reads_sides(const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        const bool value = i->op == OP_told && i->imm.query.what == SLT_LIGHT_VALUE;
        if (i->op == OP_told && i->imm.query.what == SLT_PIECE_SIDES) return true;
        for (uint32_t a = 0; a < i->nargs && !value; a++)
            if (i->args[a]->op == OP_query && i->args[a]->imm.query.what == SLT_QUERY_LIT) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (reads_sides(i->region[r])) return true;
    }
    return false;
}

static bool is_none(const Inst *i) { return i->op == OP_consti && i->imm.i == SLT_WITNESS_NONE; }

/* whole[id]: something asks more of this query's witness than whether it is NONE. */
static void find_uses(const Block *b, bool *whole) {
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t a = 0; a < i->nargs; a++)
            if (may_weaken(i->args[a]))
                whole[i->args[a]->id] |= !((i->op == OP_ieq || i->op == OP_ine) && is_none(i->args[1 - a]));
        for (uint32_t r = 0; r < i->nregions; r++) find_uses(i->region[r], whole);
    }
}

static bool replace(Block *b, const bool *whole, bool sides) {
    bool changed = false;
    for (Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_query && i->nargs == SLT_RAY_ROWS) i->nargs = SLT_RAY_POINT_ROWS, changed = true;
        if ((may_weaken(i) && !whole[i->id]) || (tells_sides(i) && !sides))
            i->imm.query.what = query_rows[i->imm.query.what].weaker, changed = true;
        for (uint32_t r = 0; r < i->nregions; r++) changed |= replace(i->region[r], whole, sides);
    }
    return changed;
}

bool opt_hits(PassCtx *ctx, Fn *fn) {
    Arena *scratch = &ctx->session->scratch;
    ArenaMark m = arena_mark(scratch);
    bool *whole = ARENA_ARRAY(scratch, bool, ir_number(fn) + 1);
    find_uses(fn->body, whole);
    bool changed = replace(fn->body, whole, reads_sides(fn->body));
    arena_reset(scratch, m);
    return changed;
}
