/* Which local arrays must be cleared. An array is 0 where nothing was stored; most are filled before they are read, in
 * a loop over all elements or one after the other, and clearing those would be stores that nobody sees. */
#include "compiler/back/core/core.h"

static bool mentions(const Inst *i, const Inst *array);

static bool mentions_in(const Block *b, const Inst *array) {
    for (const Inst *i = b->first; i; i = i->next)
        if (mentions(i, array)) return true;
    return false;
}

static bool mentions(const Inst *i, const Inst *array) {
    for (uint32_t j = 0; j < i->nargs; j++)
        if (i->args[j] == array) return true;
    for (uint32_t r = 0; r < i->nregions; r++)
        if (mentions_in(i->region[r], array)) return true;
    return false;
}

/* Does the loop store element k in iteration k, of all elements, and do nothing else with the array? */
static bool fills(const Inst *loop, const Inst *array) {
    const Block *body = loop->region[0];
    if (loop->op != OP_loop || !loop->imm.loop.exact || loop->imm.loop.cull) return false;
    if (loop->imm.loop.max_iters < array->imm.arr.count) return false;
    uint32_t stores = 0;
    for (const Inst *i = body->first; i; i = i->next) {
        if (!mentions(i, array)) continue;
        if (i->op != OP_store || i->args[0] != array || i->args[1] != body->params[0]) return false;
        stores++;
    }
    return stores > 0;
}

bool back_needs_zeros(const Inst *array) {
    enum { MOST = 64 };
    uint32_t count = array->imm.arr.count, filled = 0;
    uint64_t done = 0; /* elements below MOST stored so far */
    for (const Inst *i = array->next; i; i = i->next) {
        if (!mentions(i, array)) continue;
        if (fills(i, array)) return false;
        bool stores = i->op == OP_store && i->args[0] == array && i->args[1]->op == OP_consti;
        if (!stores || count > MOST) return true;
        int64_t at = i->args[1]->imm.i;
        at = at < 0 ? 0 : at >= count ? count - 1 : at; /* indices are clamped */
        filled += !(done >> at & 1);
        done |= (uint64_t)1 << at;
        if (filled == count) return false;
    }
    return true;
}
