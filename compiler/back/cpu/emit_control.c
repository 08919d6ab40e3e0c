/* Structured control flow: if_ and loop, uniform as real branches, varying under masks. Here: what both need.
 *
 * Dead lanes run along and compute garbage: nothing traps (integer operations are total, indices are clamped), stores
 * and effects look at the mask, and values are blended only where lanes with different histories meet. A region is
 * entered only if some lane wants it. */
#include "compiler/back/cpu/emit_control.h"

uint32_t emit_result_parts(Emit *e, const Inst *value, bool vector, Part *out) {
    if (vector) {
        emit_parts(e, value, out);
        return e->P;
    }
    out[0] = emit_scalar(e, value);
    return 1;
}

LLVMTypeRef emit_value_type(Emit *e, const Inst *i) {
    LLVMTypeRef t = emit_scalar_type(e, i->type);
    return emit_is_vector(e, i) ? emit_vector_type(e, t) : t;
}

Part *emit_new_parts(Emit *e) { return ARENA_ARRAY(e->arena, Part, e->P); }

const Inst *emit_next_proj(const Inst *s, const Inst *p) {
    do p = p ? p->next : s->next;
    while (p && p->op == OP_proj && p->args[0] == s && !(p->flags & BACK_READ));
    return p && p->op == OP_proj && p->args[0] == s ? p : NULL;
}

size_t emit_proj_count(const Inst *i) {
    size_t n = 0;
    for (const Inst *p = emit_next_proj(i, NULL); p; p = emit_next_proj(i, p)) n++;
    return n;
}

void emit_control(Emit *e, Inst *i) {
    if (i->op == OP_if_) emit_if(e, i);
    else emit_loop(e, i);
}
