/* Frames of the tape. A push and the loop that pops it have the same types in the same order; all pushes with one
 * signature share a layout, which is varying in a slot as soon as one of them is: whole vectors first, then 8-byte,
 * 4-byte and bit values, then the mask. A frame takes at most the sum of its values' bytes and 4 more for each lane:
 * the mask, an iteration number and the padding fit in those. */
#include "compiler/back/core/core.h"

#include <string.h>

static bool same_signature(const FrameClass *c, uint32_t n, Inst *const *values) {
    if (c->n != n) return false;
    for (uint32_t j = 0; j < n; j++)
        if (c->types[j] != values[j]->type) return false;
    return true;
}

FrameClass *back_frame_class(FrameTable *t, Arena *arena, uint32_t n, Inst *const *values) {
    for (uint32_t j = 0; j < t->len; j++)
        if (same_signature(t->data[j], n, values)) return t->data[j];
    FrameClass *c = ARENA_NEW(arena, FrameClass);
    c->n = n;
    c->types = ARENA_ARRAY(arena, uint8_t, n + 1);
    c->varying = ARENA_ARRAY(arena, bool, n + 1);
    c->offset = ARENA_ARRAY(arena, uint32_t, n + 1);
    for (uint32_t j = 0; j < n; j++) c->types[j] = values[j]->type;
    vec_push(arena, t, c);
    return c;
}

unsigned back_type_bytes(const Plan *plan, uint8_t type) {
    return type == TY_FLT ? plan->flt_bytes : type == TY_TAPE ? 8 : 4;
}

uint32_t back_bits_bytes(const Plan *plan) { return plan->P * (plan->L < 8 ? 1 : plan->L / 8); }

void back_layout_frames(Plan *plan) {
    for (uint32_t k = 0; k < plan->frames.len; k++) {
        FrameClass *c = plan->frames.data[k];
        uint32_t at = 0;
        if (plan->W == 1) {
            c->masked = false;
            memset(c->varying, 0, c->n * sizeof *c->varying);
        }
        for (int pass = 0; pass < 4; pass++)
            for (uint32_t j = 0; j < c->n; j++) {
                unsigned bytes = c->types[j] == TY_BOOL ? 1 : back_type_bytes(plan, c->types[j]);
                bool bits = c->types[j] == TY_BOOL, vector = c->varying[j] && !bits;
                int when = vector ? 0 : bits ? 3 : bytes == 8 ? 1 : 2;
                if (when != pass) continue;
                c->offset[j] = at;
                at += vector ? bytes * plan->W : bits && c->varying[j] ? back_bits_bytes(plan) : bytes;
            }
        c->mask_offset = at;
        at += c->masked ? back_bits_bytes(plan) : 0;
        uint32_t align = plan->W * 4 < 64 ? plan->W * 4 : 64;
        c->bytes = at ? (at + align - 1) / align * align : align; /* an empty frame still counts an iteration */
    }
}
