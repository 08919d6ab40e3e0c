/* The verifier: first the lists themselves (nothing else may walk a broken list), then every rule, reporting all
 * that is wrong with the instruction's text. The rules are those that ir.h and ops.def state. */
#include <string.h>

#include "compiler/ir/text.h"
#include "saltus/mesh.h"

enum { MAX_DEPTH = 512 };

typedef struct Verify {
    const Fn *fn;
    Text text;
    uint32_t nproblems;
    Inst **by_id;  /* the instruction that owns each id */
    bool *visible; /* by id: defined before, in this block or around it */
    Vec(const Inst *) pushes, revloops;
} Verify;

__attribute__((format(printf, 3, 4))) static void problem(Verify *v, const Inst *i, const char *fmt, ...) {
    va_list ap;
    v->nproblems++;
    va_start(ap, fmt);
    text_addv(&v->text, fmt, ap);
    va_end(ap);
    text_add(&v->text, ": ");
    if (i) text_inst(&v->text, i);
    text_add(&v->text, "\n");
}

/* ---- lists */

static bool list_is_sound(Verify *v, const Block *b, const Inst *owner, uint32_t depth) {
    uint32_t before = v->nproblems;
    if (depth > MAX_DEPTH) {
        problem(v, owner, "regions nest deeper than %d, or in a circle", MAX_DEPTH);
        return false;
    }
    if (b->owner != owner) problem(v, owner, "the owner of a region is another instruction");
    if (b->first && b->first->prev) problem(v, b->first, "the first instruction has one before it");
    for (uint32_t p = 0; p < b->nparams; p++) {
        const Inst *a = b->params[p];
        if (!a) {
            problem(v, owner, "parameter %u is missing", p);
            continue;
        }
        if (a->op != OP_arg || a->block != b || a->imm.i != p)
            problem(v, a, "parameter %u of a block is not an arg of that block and index", p);
    }
    const Inst *last = NULL;
    for (const Inst *i = b->first; i; last = i, i = i->next) {
        if (i->block != b) problem(v, i, "stands in another block than it says");
        if (i->next && i->next->prev != i) {
            problem(v, i, "the list is broken behind this");
            return false;
        }
        if (i->op >= OP_COUNT) problem(v, i, "no such operation");
        if (i->nregions > 2) {
            problem(v, i, "%d regions", i->nregions);
            return false;
        }
        for (uint32_t a = 0; a < i->nargs; a++)
            if (!i->args[a]) problem(v, i, "operand %u is missing", a);
        for (uint32_t r = 0; r < i->nregions; r++)
            if (!i->region[r]) problem(v, i, "region %u is missing", r);
            else if (!list_is_sound(v, i->region[r], i, depth + 1)) return false;
    }
    if (b->last != last) problem(v, last, "the block's last instruction is another");
    return v->nproblems == before;
}

static void index_block(Verify *v, const Block *b) {
    for (uint32_t p = 0; p < b->nparams; p++) v->by_id[b->params[p]->id] = b->params[p];
    for (Inst *i = b->first; i; i = i->next) {
        v->by_id[i->id] = i;
        for (uint32_t r = 0; r < i->nregions; r++) index_block(v, i->region[r]);
    }
}

/* ---- rules */

static const char *type_name(unsigned t) {
    static const char *const names[] = {"nothing", "bool", "int", "float", "array", "tape mark"};
    return t <= TY_TAPE ? names[t] : "?";
}

static void want(Verify *v, const Inst *i, uint32_t a, IrType t) {
    if (a < i->nargs && i->args[a]->type != t)
        problem(v, i, "operand %u is %s, not %s", a, type_name(i->args[a]->type), type_name(t));
}

static void want_result(Verify *v, const Inst *i, IrType t) {
    if (i->type != t) problem(v, i, "the result is %s, not %s", type_name(i->type), type_name(t));
}

static void want_scalar(Verify *v, const Inst *i, uint32_t a) {
    IrType t = (IrType)i->args[a]->type;
    if (t != TY_BOOL && t != TY_INT && t != TY_FLT && t != TY_TAPE)
        problem(v, i, "operand %u is %s, not a scalar", a, type_name(t));
}

/* rows: as often there may be `size` numbers, and the slot lies in one of these rows. */
static void want_slot(Verify *v, const Inst *i, uint32_t size, uint32_t rows) {
    uint32_t row = size ? i->imm.slot.base / size : 0;
    uint64_t end = (uint64_t)i->imm.slot.base + i->imm.slot.count;
    if (!i->imm.slot.count || row >= rows || end > (row + 1) * (uint64_t)size)
        problem(v, i, "slot outside the %u parameters", size);
}

static void want_params(Verify *v, const Inst *i, uint32_t r, uint32_t n) {
    if (i->region[r]->nparams != n) problem(v, i, "region %u has %u parameters, not %u", r, i->region[r]->nparams, n);
}

static void want_param(Verify *v, const Inst *i, uint32_t r, uint32_t p, IrType t) {
    const Block *b = i->region[r];
    if (p < b->nparams && b->params[p]->type != t)
        problem(v, i, "parameter %u of region %u is %s, not %s", p, r, type_name(b->params[p]->type), type_name(t));
}

static bool regions_are(Verify *v, const Inst *i, uint32_t least, uint32_t most) {
    if (i->nregions >= least && i->nregions <= most) {
        for (uint32_t r = 0; r < i->nregions; r++)
            if (!i->region[r]->last || i->region[r]->last->op != OP_yield) return false; /* reported at the block */
        return true;
    }
    problem(v, i, "%d regions", i->nregions);
    return false;
}

/* The values from `skip` on of region r's yield against the types of other values. */
static void want_yield(Verify *v, const Inst *i, uint32_t r, uint32_t skip, uint32_t n, Inst *const *like) {
    const Inst *y = i->region[r]->last;
    if (y->nargs != skip + n) {
        problem(v, i, "region %u yields %u values, not %u", r, y->nargs, skip + n);
        return;
    }
    for (uint32_t k = 0; k < n; k++)
        if (y->args[skip + k]->type != like[k]->type)
            problem(v, y, "yields %s as value %u, not %s", type_name(y->args[skip + k]->type), skip + k,
                    type_name(like[k]->type));
}

static void check_site(Verify *v, const Inst *i, IrType decision) {
    if (i->nargs < 2) {
        problem(v, i, "a site needs a decision and a function");
        return;
    }
    want(v, i, 0, decision);
    want(v, i, 1, TY_FLT);
    want_result(v, i, decision);
    for (uint32_t a = 2; a < i->nargs; a++) want(v, i, a, TY_INT);
    if (i->imm.i < 0 || i->imm.i >= v->fn->nsites) {
        problem(v, i, "site outside the %u sites", v->fn->nsites);
    } else {
        const SiteInfo *s = &v->fn->sites[i->imm.i];
        if (s->depth > SLT_MAX_K || i->nargs - 2 != s->depth)
            problem(v, i, "%u loop indices at a site of depth %u", i->nargs - 2, s->depth);
    }
}

static void check_proj(Verify *v, const Inst *i) {
    const Inst *owner = i->args[0];
    if (!owner->nregions) {
        problem(v, i, "projects from an instruction without regions");
        return;
    }
    const Inst *p = i->prev;
    if (p != owner && !(p && p->op == OP_proj && p->args[0] == owner && p->imm.i < i->imm.i))
        problem(v, i, "a projection must stand behind its operation, in the order of the results");
    if (i->imm.i < 0 || i->imm.i >= ir_nresults(owner)) {
        problem(v, i, "result outside the %u results", ir_nresults(owner));
        return;
    }
    const Inst *y = owner->region[0]->last;
    want_result(v, i, (IrType)y->args[i->imm.i + (owner->op == OP_loop)]->type);
}

static void check_array(Verify *v, const Inst *i, uint32_t a) {
    want(v, i, a, TY_ARRAY);
    if (i->args[a]->op != OP_alloc) problem(v, i, "operand %u is not an alloc", a);
}

static bool is_ray(QueryRay ray, uint32_t n) {
    switch (ray) {
    case RAY_BOX: return n == SLT_BOX_ROWS;
    case RAY_LINE: return n == SLT_LINE_ROWS;
    case RAY_BEAM: return n == SLT_BEAM_ROWS + 1;
    case RAY_PAIR: return n == SLT_PAIR_ROWS;
    case RAY_LIGHT: return n == SLT_LIGHT_ROWS + 1;
    case RAY_LOBE: return n == SLT_LOBE_ROWS + 1;
    case RAY_PIECE: return n == SLT_LIT_ROWS + 1;
    case RAY_NOTHING: return n == 0;
    case RAY_SEGMENT:
    case RAY_SLICE: break;
    }
    return n == SLT_RAY_POINT_ROWS || n == SLT_RAY_ROWS;
}

static void check_special(Verify *v, const Inst *i) {
    const Inst *a = i->nargs ? i->args[0] : NULL;
    switch ((Op)i->op) {
    case OP_constf: want_result(v, i, TY_FLT); return;
    case OP_consti:
        want_result(v, i, TY_INT);
        if (i->imm.i < INT32_MIN || i->imm.i > INT32_MAX) problem(v, i, "more than 32 bits");
        return;
    case OP_constb: want_result(v, i, TY_BOOL); return;
    case OP_input: {
        if (i->imm.i < 0 || i->imm.i >= SLT_INPUTS) {
            problem(v, i, "no such input");
            return;
        }
        want_result(v, i, ir_input_type((InputSlot)i->imm.i));
        return;
    }
    case OP_param:
    case OP_dparam:
        want(v, i, 0, TY_INT);
        want_result(v, i, TY_FLT);
        want_slot(v, i, v->fn->nfloats, 1);
        return;
    case OP_iparam:
        want(v, i, 0, TY_INT);
        want_result(v, i, TY_INT);
        want_slot(v, i, v->fn->nints, 1);
        return;
    case OP_adj:
        want(v, i, 0, TY_INT);
        want(v, i, 1, TY_FLT);
        want_slot(v, i, v->fn->nfloats, SLT_MAX_CHANNELS);
        return;
    case OP_rand:
        want(v, i, 0, TY_INT);
        want_result(v, i, TY_FLT);
        return;
    case OP_seed: want(v, i, 1, TY_FLT); /* fall through */
    case OP_detach:
    case OP_ghost:
    case OP_along:
    case OP_ddx:
        want(v, i, 0, TY_FLT);
        want_result(v, i, TY_FLT);
        return;
    case OP_site: check_site(v, i, TY_BOOL); return;
    case OP_siten: check_site(v, i, TY_FLT); return;
    case OP_alloc:
        want_result(v, i, TY_ARRAY);
        if (!i->imm.arr.count) problem(v, i, "an empty array");
        if (i->imm.arr.elem != TY_BOOL && i->imm.arr.elem != TY_INT && i->imm.arr.elem != TY_FLT)
            problem(v, i, "elements are %s", type_name(i->imm.arr.elem));
        return;
    case OP_load:
        check_array(v, i, 0);
        want(v, i, 1, TY_INT);
        if (a->op == OP_alloc) want_result(v, i, a->imm.arr.elem);
        return;
    case OP_store:
        check_array(v, i, 0);
        want(v, i, 1, TY_INT);
        if (a->op == OP_alloc) want(v, i, 2, a->imm.arr.elem);
        return;
    case OP_acopy:
        check_array(v, i, 0);
        check_array(v, i, 1);
        if (a->op == OP_alloc && i->args[1]->op == OP_alloc &&
            (a->imm.arr.count != i->args[1]->imm.arr.count || a->imm.arr.elem != i->args[1]->imm.arr.elem))
            problem(v, i, "arrays of different shapes");
        return;
    case OP_if_: {
        want(v, i, 0, TY_BOOL);
        if (!regions_are(v, i, 2, 2)) return;
        want_params(v, i, 0, 0);
        want_params(v, i, 1, 0);
        const Inst *y = i->region[0]->last;
        want_yield(v, i, 1, 0, y->nargs, y->args);
        return;
    }
    case OP_loop:
        if (!i->imm.loop.max_iters) problem(v, i, "no bound on the iterations");
        if (i->imm.loop.cull && i->imm.loop.cull_id >= SLT_MAX_CULL) problem(v, i, "list outside the %d", SLT_MAX_CULL);
        if (!regions_are(v, i, 1, 1)) return;
        want_params(v, i, 0, 1 + i->nargs);
        want_param(v, i, 0, 0, TY_INT);
        for (uint32_t c = 0; c < i->nargs; c++) want_param(v, i, 0, 1 + c, (IrType)i->args[c]->type);
        want_yield(v, i, 0, 1, i->nargs, i->args);
        want(v, i->region[0]->last, 0, TY_BOOL);
        return;
    case OP_revloop: {
        if (!i->nargs) {
            problem(v, i, "no tape mark");
            return;
        }
        vec_push(v->text.arena, &v->revloops, i);
        want(v, i, 0, TY_TAPE);
        if (!regions_are(v, i, 1, 1)) return;
        uint32_t ncarried = i->nargs - 1, nparams = i->region[0]->nparams;
        if (nparams < ncarried) want_params(v, i, 0, ncarried);
        for (uint32_t c = 0; nparams >= ncarried && c < ncarried; c++)
            want_param(v, i, 0, nparams - ncarried + c, (IrType)i->args[1 + c]->type);
        want_yield(v, i, 0, 0, ncarried, i->args + 1);
        return;
    }
    case OP_custom: {
        if (!regions_are(v, i, 1, 2)) return;
        uint32_t floats = 0;
        for (uint32_t k = 0; k < i->nargs; k++) floats += i->args[k]->type == TY_FLT;
        for (uint32_t r = 0; r < i->nregions; r++) {
            want_params(v, i, r, i->nargs + (r ? floats : 0));
            for (uint32_t k = 0; k < i->nargs; k++) want_param(v, i, r, k, (IrType)i->args[k]->type);
            for (uint32_t k = 0; r && k < floats; k++) want_param(v, i, r, i->nargs + k, TY_FLT);
        }
        return;
    }
    case OP_yield:
        if (i->next) problem(v, i, "a yield in the middle of a block");
        for (uint32_t k = 0; k < i->nargs; k++) want_scalar(v, i, k);
        return;
    case OP_proj: check_proj(v, i); return;
    case OP_arg: problem(v, i, "an arg stands in the list"); return;
    case OP_partner:
        want_scalar(v, i, 0);
        want_result(v, i, (IrType)a->type);
        return;
    case OP_stands:
    case OP_any:
    case OP_both: want_result(v, i, TY_BOOL); return;
    case OP_tapemark: want_result(v, i, TY_TAPE); return;
    case OP_tapedrop:
        if (a->type != TY_TAPE) problem(v, i, "operand 0 is no tape mark");
        return;
    case OP_tapepush:
        vec_push(v->text.arena, &v->pushes, i);
        for (uint32_t k = 0; k < i->nargs; k++) want_scalar(v, i, k);
        return;
    case OP_live:
    case OP_settled:
    case OP_choice:
        for (uint32_t k = 0; k < i->nargs; k++) want(v, i, k, TY_BOOL);
        if (i->op != OP_choice) want_result(v, i, TY_BOOL);
        if (i->imm.i < 0 || i->imm.i > IR_MAX_OPS) problem(v, i, "no such chunk or choice");
        return;
    case OP_give:
    case OP_take:
        if (i->nargs) want_scalar(v, i, 0);
        if (i->imm.frame.place >= i->imm.frame.places || i->imm.frame.places > IR_MAX_PLACES ||
            i->imm.frame.which > IR_MAX_OPS)
            problem(v, i, "no such place");
        return;
    case OP_count:
        want(v, i, 0, TY_BOOL);
        if (i->imm.i < 0 || i->imm.i >= SLT_COUNTERS) problem(v, i, "no such counter");
        return;
    case OP_item:
    case OP_items:
        want(v, i, 0, TY_INT);
        want_result(v, i, TY_INT);
        if (i->imm.i < 0 || i->imm.i >= SLT_MAX_CULL) problem(v, i, "no such list");
        return;
    case OP_note: {
        const Inst *loop = i->block->owner;
        want(v, i, 0, TY_BOOL);
        want(v, i, 1, TY_BOOL);
        if (!loop || loop->op != OP_loop || !loop->imm.loop.cull || loop->imm.loop.cull_id != i->imm.i)
            problem(v, i, "stands not in the body of the loop with its list");
        return;
    }
    case OP_print:
        if (i->imm.text.len && !i->imm.text.text) problem(v, i, "no text");
        for (uint32_t k = 0; k < i->nargs; k++) want_scalar(v, i, k);
        return;
    case OP_query:
        for (uint32_t k = 0; k < i->nargs; k++) want(v, i, k, TY_FLT);
        if (i->imm.query.what >= SLT_QUERIES) problem(v, i, "no such query");
        else if (!is_ray(query_rows[i->imm.query.what].ray, i->nargs)) problem(v, i, "not the numbers of a ray");
        return;
    case OP_told:
        want(v, i, 0, TY_INT);
        if (i->type != TY_FLT && i->type != TY_INT) problem(v, i, "told is a number");
        return;
    case OP_window:
        for (uint32_t k = 0; k < i->nargs; k++) want(v, i, k, TY_FLT);
        if (i->imm.i < 0 || i->imm.i / 2 >= (int64_t)v->fn->nsites) problem(v, i, "no such site");
        return;
    default: problem(v, i, "a value row marked special"); return;
    }
}

static void check_value(Verify *v, const Inst *i) {
    const OpInfo *info = &ir_ops[i->op];
    bool select = info->selects;
    for (uint32_t a = 0; a < i->nargs; a++) want(v, i, a, select && a == 0 ? TY_BOOL : (IrType)info->arg);
    want_result(v, i, (IrType)info->result);
}

static void check_inst(Verify *v, const Inst *i) {
    const OpInfo *info = &ir_ops[i->op];
    if (info->nargs != IR_MANY && i->nargs != info->nargs) {
        problem(v, i, "%u operands, not %d", i->nargs, info->nargs);
        return;
    }
    bool usable = true;
    for (uint32_t a = 0; a < i->nargs; a++) {
        const Inst *x = i->args[a];
        bool structured = i->op == OP_proj && x->nregions;
        if (x->id >= v->fn->ninsts || v->by_id[x->id] != x) {
            problem(v, i, "operand %u (%s) is not in the function", a, ir_ops[x->op < OP_COUNT ? x->op : OP_arg].name);
            usable = false;
        } else if (!v->visible[x->id]) {
            problem(v, i, "operand %u is not defined before this, here or around", a);
        } else if (x->type == TY_VOID && !structured) {
            problem(v, i, "operand %u has no value", a);
        }
    }
    if (!usable) return;
    bool structured = i->op == OP_if_ || i->op == OP_loop || i->op == OP_revloop || i->op == OP_custom;
    if (i->nregions && !structured) problem(v, i, "has regions");
    if (info->special) check_special(v, i);
    else check_value(v, i);
    bool void_op = structured || i->op == OP_adj || i->op == OP_store || i->op == OP_acopy || i->op == OP_yield ||
                   i->op == OP_tapepush || i->op == OP_tapedrop || i->op == OP_count || i->op == OP_print ||
                   i->op == OP_note;
    if (void_op && i->type != TY_VOID) problem(v, i, "has a type");
}

static void check_block(Verify *v, const Block *b) {
    uint32_t lo = v->fn->ninsts, hi = 0;
    for (uint32_t p = 0; p < b->nparams; p++) {
        const Inst *a = b->params[p];
        v->visible[a->id] = true;
        if (a->id < lo) lo = a->id;
        if (a->id + 1 > hi) hi = a->id + 1;
        if (a->type == TY_VOID || a->type == TY_ARRAY) problem(v, a, "a parameter of type %s", type_name(a->type));
    }
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) check_block(v, i->region[r]);
        check_inst(v, i); /* after its regions: their yields are known to be there or reported */
        v->visible[i->id] = true;
        if (i->id < lo) lo = i->id;
        if (i->id + 1 > hi) hi = i->id + 1;
    }
    if (!b->last || b->last->op != OP_yield)
        problem(v, b->last ? b->last : b->owner, "a block without a yield at its end");
    if (hi > lo) memset(v->visible + lo, 0, (hi - lo) * sizeof *v->visible); /* out of sight outside the block */
}

/* A frame that no push makes cannot be popped. Which push meets which loop, the tests of ad_vjp check. */
static void check_frames(Verify *v) {
    for (uint32_t k = 0; k < v->revloops.len; k++) {
        const Inst *i = v->revloops.data[k];
        if (!i->nregions || !i->region[0] || i->region[0]->nparams + 1 < i->nargs) continue;
        const Block *body = i->region[0];
        uint32_t frame = body->nparams - (i->nargs - 1);
        bool found = false;
        for (uint32_t p = 0; p < v->pushes.len && !found; p++) {
            const Inst *push = v->pushes.data[p];
            found = push->nargs == frame;
            for (uint32_t a = 0; found && a < frame; a++) found = push->args[a]->type == body->params[a]->type;
        }
        if (!found) problem(v, i, "no tapepush makes frames of this shape");
    }
}

bool ir_verify(const Fn *fn, Arena *arena, const char **text) {
    Verify v = {.fn = fn, .text.arena = arena};
    if (!fn->body) problem(&v, NULL, "no body");
    if (fn->body && list_is_sound(&v, fn->body, NULL, 0)) {
        uint32_t n = ir_number((Fn *)fn);
        v.by_id = ARENA_ARRAY(arena, Inst *, n + 1);
        v.visible = ARENA_ARRAY(arena, bool, n + 1);
        index_block(&v, fn->body);
        check_block(&v, fn->body);
        if (fn->body->nparams) problem(&v, fn->body->first, "the top block has parameters");
        check_frames(&v);
    }
    if (text) *text = v.nproblems ? v.text.data : "";
    return !v.nproblems;
}

void ir_require(const Fn *fn, const char *when) {
    Arena *scratch = &fn->session->scratch;
    ArenaMark m = arena_mark(scratch);
    const char *problems;
    if (!ir_verify(fn, scratch, &problems)) {
        uint32_t n = 0;
        for (const char *c = problems; *c; c++) n += *c == '\n';
        fprintf(stderr, "; %s of %s\n%s", when, fn->name, problems);
        ice(fn->session, "%s of %s: broken IR, %u problem%s", when, fn->name, n, n == 1 ? "" : "s");
    }
    arena_reset(scratch, m);
}
