/* Uniformity: which values are the same in all lanes that execute them, and which structured operations let lanes part.
 *
 * A fixpoint from below: everything starts uniform and is marked varying when a reason appears. The facts are about the
 * lanes that are active at a value, so a value computed under a varying mask may still be uniform, and a carried value
 * of a loop stays uniform while lanes leave: those still inside agree. Where lanes of different histories meet (results
 * of a diverging if_ or loop) the value varies. */
#include <string.h>

#include "compiler/back/core/core.h"

typedef struct Analysis {
    bool changed;
    FrameTable frames;
} Analysis;

static void mark(Analysis *a, Inst *i, uint8_t flag) {
    if ((i->flags & flag) != flag) {
        i->flags |= flag;
        a->changed = true;
    }
}

static void mark_if(Analysis *a, Inst *i, bool varying) {
    if (varying && i->type != TY_TAPE) /* the tape has one top for all lanes */
        mark(a, i, BACK_VARYING);
}

static bool varies(const Inst *i) { return i->flags & BACK_VARYING; }

bool back_diverges_between(const Block *inner, const Block *outer) {
    for (const Block *b = inner; b != outer && b->owner; b = b->owner->block)
        if (b->owner->flags & BACK_DIVERGES) return true;
    return false;
}

static void note_push(Analysis *a, Fn *fn, const Inst *i, bool masked) {
    FrameClass *c = back_frame_class(&a->frames, &fn->session->scratch, i->nargs, i->args);
    if (masked && !c->masked) c->masked = a->changed = true;
    for (uint32_t j = 0; j < i->nargs; j++)
        if (varies(i->args[j]) && !c->varying[j]) c->varying[j] = a->changed = true;
}

static void visit(Analysis *a, Fn *fn, Block *b, bool masked);

static void visit_loop(Analysis *a, Fn *fn, Inst *i, bool masked) {
    Block *body = i->region[0];
    visit(a, fn, body, masked || (i->flags & BACK_DIVERGES));
    const Inst *y = ir_yield_of(body);
    if (varies(y->args[0])) mark(a, i, BACK_DIVERGES);
    for (uint32_t j = 1; j < body->nparams; j++)
        mark_if(a, body->params[j], varies(i->args[j - 1]) || varies(y->args[j]));
}

static void visit_revloop(Analysis *a, Fn *fn, Inst *i, bool masked) {
    Block *body = i->region[0];
    uint32_t carried = i->nargs - 1, nframe = body->nparams - carried;
    FrameClass *c = back_frame_class(&a->frames, &fn->session->scratch, nframe, body->params);
    if (c->masked) mark(a, i, BACK_DIVERGES);
    for (uint32_t j = 0; j < nframe; j++) mark_if(a, body->params[j], c->varying[j]);
    visit(a, fn, body, masked || (i->flags & BACK_DIVERGES));
    const Inst *y = ir_yield_of(body);
    for (uint32_t j = 0; j < carried; j++)
        mark_if(a, body->params[nframe + j],
                varies(i->args[1 + j]) || varies(y->args[j]) || (i->flags & BACK_DIVERGES));
}

static void visit_proj(Analysis *a, Inst *i) {
    const Inst *s = i->args[0];
    uint32_t r = (uint32_t)i->imm.i;
    bool parts = s->flags & BACK_DIVERGES;
    switch (s->op) {
    case OP_if_: {
        const Inst *x = ir_yield_of(s->region[0])->args[r], *y = ir_yield_of(s->region[1])->args[r];
        mark_if(a, i, varies(x) || varies(y) || (parts && x != y));
        break;
    }
    case OP_loop:
        mark_if(a, i,
                parts || varies(ir_yield_of(s->region[0])->args[r + 1]) || (s->imm.loop.cull && varies(s->args[r])));
        break;
    case OP_revloop: mark_if(a, i, varies(s->region[0]->params[s->region[0]->nparams - (s->nargs - 1) + r])); break;
    default: mark(a, i, BACK_VARYING);
    }
}

static void visit(Analysis *a, Fn *fn, Block *b, bool masked) {
    for (Inst *i = b->first; i; i = i->next) {
        switch (i->op) {
        case OP_constf:
        case OP_consti:
        case OP_constb:
        case OP_any:
        case OP_tapemark:
        case OP_tapedrop:
        case OP_alloc:
        case OP_yield:
        case OP_arg:
        case OP_count:
        case OP_choice:
        case OP_give:
        case OP_live:
        case OP_print:
        case OP_note:
        case OP_adj: break;
        case OP_input: mark_if(a, i, i->imm.i < SLT_IN_VARYING && !(fn->same >> i->imm.i & 1)); break;
        case OP_store:
            mark_if(a, i->args[0],
                    varies(i->args[1]) || varies(i->args[2]) || back_diverges_between(b, i->args[0]->block));
            break;
        case OP_acopy: mark_if(a, i->args[0], varies(i->args[1]) || back_diverges_between(b, i->args[0]->block)); break;
        case OP_detach:
        case OP_site:
        case OP_siten:
        case OP_partner: mark_if(a, i, varies(i->args[0])); break;
        case OP_settled: /* it picks vectors: a mask costs one load */
        case OP_take: mark_if(a, i, true); break;
        case OP_both: mark_if(a, i, masked); break;
        case OP_tapepush: note_push(a, fn, i, masked); break;
        case OP_if_:
            if (varies(i->args[0])) mark(a, i, BACK_DIVERGES);
            visit(a, fn, i->region[0], masked || (i->flags & BACK_DIVERGES));
            visit(a, fn, i->region[1], masked || (i->flags & BACK_DIVERGES));
            break;
        case OP_loop: visit_loop(a, fn, i, masked); break;
        case OP_revloop: visit_revloop(a, fn, i, masked); break;
        case OP_proj: visit_proj(a, i); break;
        default:
            for (uint32_t j = 0; j < i->nargs; j++) mark_if(a, i, varies(i->args[j]));
        }
    }
}

static void clear(Block *b) {
    for (uint32_t j = 0; j < b->nparams; j++) b->params[j]->flags = 0;
    for (Inst *i = b->first; i; i = i->next) {
        i->flags = 0;
        for (uint32_t r = 0; r < i->nregions; r++) clear(i->region[r]);
    }
}

static void mark_reads(Block *b) {
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t j = 0; j < i->nargs; j++) i->args[j]->flags |= BACK_READ;
        for (uint32_t r = 0; r < i->nregions; r++) mark_reads(i->region[r]);
    }
}

void back_analyse_frames(Fn *fn, FrameTable *frames) {
    Analysis a = {0};
    clear(fn->body);
    mark_reads(fn->body);
    do {
        a.changed = false;
        visit(&a, fn, fn->body, false);
    } while (a.changed);
    *frames = a.frames;
}

static void analyse_uniform(Fn *fn) {
    ArenaMark m = arena_mark(&fn->session->scratch);
    FrameTable frames;
    back_analyse_frames(fn, &frames);
    arena_reset(&fn->session->scratch, m);
}

static bool mark_dense(const Fn *fn, const Block *b, uint8_t *dense) {
    bool any = false;
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) any |= mark_dense(fn, i->region[r], dense);
        if (i->op != OP_adj || varies(i->args[0])) continue;
        const Inst *at = i->args[0];
        uint32_t from = 0, to = i->imm.slot.count;
        if (at->op == OP_consti && at->imm.i >= 0 && at->imm.i < (int64_t)to) from = (uint32_t)at->imm.i, to = from + 1;
        if (from >= to) continue;
        memset(dense + i->imm.slot.base % fn->nfloats + from, 1, to - from); /* in any row */
        any = true;
    }
    return any;
}

bool back_dense_adjoints(Fn *fn, uint8_t *dense) {
    bool any = false;
    for (Fn *part = fn; part; part = part->next_part) {
        analyse_uniform(part);
        any |= mark_dense(part, part->body, dense);
    }
    return any;
}
