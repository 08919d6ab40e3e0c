/* custom ([Tangent] functions) -> its primal region in place, ghost -> 0. AD takes derivatives from the tangent regions
 * and through ghosts before; what is left here needs only values. */
#include "compiler/pass/pass.h"

typedef struct Lower {
    Fn *fn;
    Inst **map;      /* by id: the value that stands for a region's parameter or a projection */
    bool only_sites; /* the others keep their derivative */
    uint32_t n;      /* of the map: constants that are made here have no number */
    bool changed;
} Lower;

/* Definitions come before uses, so one walk in program order resolves chains too. */
static void remap(const Lower *lo, Inst *i) {
    for (uint32_t a = 0; a < i->nargs; a++)
        if (i->args[a]->id < lo->n && lo->map[i->args[a]->id]) i->args[a] = lo->map[i->args[a]->id];
}

static void lower_block(Lower *lo, Block *b);

static Inst *inline_region(Lower *lo, Inst *c) {
    Block *body = c->region[0];
    for (uint32_t p = 0; p < body->nparams; p++) lo->map[body->params[p]->id] = c->args[p];
    lower_block(lo, body); /* custom inside custom */
    Inst *yield = body->last;
    for (Inst *i = body->first, *next; i != yield; i = next) {
        next = i->next;
        ir_move_before(i, c);
    }
    Inst *behind = c->next;
    while (behind && behind->op == OP_proj && behind->args[0] == c) {
        Inst *proj = behind;
        behind = proj->next;
        lo->map[proj->id] = yield->args[proj->imm.i];
        ir_unlink(proj);
    }
    ir_unlink(c);
    lo->changed = true;
    return behind;
}

static bool holds_site(const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_site || i->op == OP_siten) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (holds_site(i->region[r])) return true;
    }
    return false;
}

static void lower_block(Lower *lo, Block *b) {
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        remap(lo, i);
        if (i->op == OP_ghost && !lo->only_sites) {
            Builder at = ir_before(lo->fn, i);
            lo->map[i->id] = ir_constf(&at, 0);
            ir_unlink(i);
            lo->changed = true;
            continue;
        }
        if (i->op == OP_custom && (!lo->only_sites || holds_site(i->region[0]))) {
            next = inline_region(lo, i);
            continue;
        }
        for (uint32_t r = 0; r < i->nregions; r++) lower_block(lo, i->region[r]);
    }
}

static bool lower(PassCtx *ctx, Fn *fn, bool only_sites) {
    Arena *scratch = &ctx->session->scratch;
    ArenaMark m = arena_mark(scratch);
    uint32_t n = ir_number(fn);
    Lower lo = {.fn = fn, .n = n, .map = ARENA_ARRAY(scratch, Inst *, n + 1), .only_sites = only_sites};
    lower_block(&lo, fn->body);
    arena_reset(scratch, m);
    return lo.changed;
}

bool lower_custom(PassCtx *ctx, Fn *fn) { return lower(ctx, fn, false); }

bool lower_custom_sites(PassCtx *ctx, Fn *fn) { return lower(ctx, fn, true); }
