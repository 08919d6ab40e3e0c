/* The interpreter: one instruction at a time over all lanes of a vector, under masks, as the SPMD kernels run.
 *
 * Every value has a slot of `lanes` elements. Value rows compute all lanes, active or not (as
 * vector code does); what persists (carried values, arrays, counters, adjoints, the tape) is written under the mask.
 * Regions are entered when any lane is active in them. Nothing here is clever: this is what compiled kernels are
 * compared with. */
#include <stdlib.h>
#include <string.h>

#include "compiler/ir/ir.h"
#include "compiler/ir/rows.h"
#include "saltus/kernel.h"
#include "saltus/mesh.h"
#include "saltus/status.h"

enum { MAX_LANES = 64 };
static const uint64_t default_tape_bytes = (uint64_t)256 << 20;
static const uint64_t max_slot_bytes = (uint64_t)4 << 30, max_arena_bytes = (uint64_t)64 << 20;

typedef struct Mask {
    uint8_t on[MAX_LANES];
} Mask;

struct Interp {
    const Fn *fn;
    SltKernelArgs *args;
    uint32_t n, lanes, base; /* samples of the call; lanes of a vector; first sample of this vector */
    uint32_t flt;            /* bytes of a float */
    unsigned char *memory;
    void **slot;          /* by id: lanes elements; arrays: count rows of lanes elements */
    void **next;          /* by id of a loop's parameter: room for the yielded value until all are read; else NULL */
    unsigned char *frame; /* of give and take: frame_places times lanes elements of 8 bytes */
    uint64_t frame_places, frame_bytes;
    uint32_t ids;
    unsigned char *tape;
    uint64_t tape_top, tape_cap, tape_limit;
    uint32_t position[SLT_MAX_CULL]; /* by list: how many iterations its loop has begun before this one */
    int status;                      /* anything but SLT_OK unwinds */
    bool refused;                    /* the system has no memory */
    uint64_t fuel;                   /* instructions left */
    void (*eval)(uint8_t op, uint32_t n, void *dst, const void *a, const void *b, const void *c);
    IrWatch *watch; /* NULL: nobody watches */
    void *watch_user;
    uint32_t first_random;
};

static bool exec_block(Interp *in, const Block *b, const Mask *m);

static bool fail(Interp *in, int status) {
    if (in->status == SLT_OK) in->status = status;
    return false;
}

static bool any(const Interp *in, const Mask *m) {
    for (uint32_t l = 0; l < in->lanes; l++)
        if (m->on[l]) return true;
    return false;
}

static uint32_t type_bytes(const Interp *in, unsigned t) { return t == TY_FLT ? in->flt : t == TY_TAPE ? 8 : 4; }

/* ---- lanes of values */

static void copy_all(const Interp *in, void *to, const void *from, unsigned t) {
    memcpy(to, from, (size_t)in->lanes * type_bytes(in, t));
}

static void copy_masked(const Interp *in, void *to, const void *from, unsigned t, const Mask *m) {
    const uint32_t lanes = in->lanes; /* both sides are read whatever the mask is: so vectors will do */
    const uint8_t *restrict on = m->on;
    if (type_bytes(in, t) == 4) {
        uint32_t *restrict d = to;
        const uint32_t *restrict s = from;
        for (uint32_t l = 0; l < lanes; l++) {
            const uint32_t was = d[l], is = s[l];
            d[l] = on[l] ? is : was;
        }
    } else {
        uint64_t *restrict d = to;
        const uint64_t *restrict s = from;
        for (uint32_t l = 0; l < lanes; l++) {
            const uint64_t was = d[l], is = s[l];
            d[l] = on[l] ? is : was;
        }
    }
}

static double get_flt(const Interp *in, const void *p, uint64_t k) {
    return in->flt == 4 ? (double)((const float *)p)[k] : ((const double *)p)[k];
}

static void set_flt(const Interp *in, void *p, uint64_t k, double v) {
    if (in->flt == 4) ((float *)p)[k] = (float)v;
    else ((double *)p)[k] = v;
}

static uint32_t clamp_index(int32_t index, uint32_t count) {
    return index < 0 ? 0 : (uint32_t)index < count ? (uint32_t)index : count - 1;
}

/* Lanes beyond the call's samples repeat the last one: they run like any other and leave nothing behind. */
static uint32_t sample_of(const Interp *in, uint32_t lane) {
    uint32_t s = in->base + lane;
    return s < in->n ? s : in->n - 1;
}

static bool counts(const Interp *in, const Mask *m, uint32_t lane) {
    return m->on[lane] && in->base + lane < in->args->n_valid && in->base + lane < in->n;
}

/* ---- operations on the call's arguments */

static bool exec_input(Interp *in, const Inst *i, void *dst) {
    int64_t s = i->imm.i;
    if (s >= SLT_IN_VARYING) {
        int32_t v;
        memcpy(&v, (const char *)in->args + ir_uniform_offset((InputSlot)s), sizeof v);
        for (uint32_t l = 0; l < in->lanes; l++) ((int32_t *)dst)[l] = v;
        return true;
    }
    const void *from = in->args->in[s];
    if (!from) return fail(in, SLT_USAGE);
    if (i->type == TY_FLT && in->flt == 8)
        for (uint32_t l = 0; l < in->lanes; l++) ((double *)dst)[l] = ((const double *)from)[sample_of(in, l)];
    else
        for (uint32_t l = 0; l < in->lanes; l++) ((uint32_t *)dst)[l] = ((const uint32_t *)from)[sample_of(in, l)];
    return true;
}

/* Do all lanes have the same? Mostly so: indices are constants or counters of loops. */
static bool is_same(const Interp *in, const int32_t *v) {
    uint32_t differs = 0;
    for (uint32_t l = 0; l < in->lanes; l++) differs |= (uint32_t)(v[l] ^ v[0]);
    return !differs;
}

static void fill_all(const Interp *in, void *dst, const void *element, uint32_t bytes) {
    if (bytes == 4) {
        uint32_t v;
        memcpy(&v, element, sizeof v);
        for (uint32_t l = 0; l < in->lanes; l++) ((uint32_t *)dst)[l] = v;
    } else {
        uint64_t v;
        memcpy(&v, element, sizeof v);
        for (uint32_t l = 0; l < in->lanes; l++) ((uint64_t *)dst)[l] = v;
    }
}

static bool exec_param(Interp *in, const Inst *i, void *dst, const int32_t *index, const Mask *m) {
    const void *from = i->op == OP_param    ? in->args->params
                       : i->op == OP_dparam ? in->args->dparams
                                            : in->args->iparams;
    if (!from) return fail(in, SLT_USAGE);
    if (is_same(in, index)) {
        const uint32_t bytes = type_bytes(in, i->type), k = i->imm.slot.base + clamp_index(index[0], i->imm.slot.count);
        fill_all(in, dst, (const char *)from + (size_t)k * bytes, bytes);
        return true;
    }
    for (uint32_t l = 0; l < in->lanes; l++) {
        uint32_t k = i->imm.slot.base + (m->on[l] ? clamp_index(index[l], i->imm.slot.count) : 0);
        if (i->op == OP_iparam) ((int32_t *)dst)[l] = ((const int32_t *)from)[k];
        else if (in->flt == 4) ((float *)dst)[l] = ((const float *)from)[k];
        else ((double *)dst)[l] = ((const double *)from)[k];
    }
    return true;
}

static bool exec_adj(Interp *in, const Inst *i, const int32_t *index, const void *value, const Mask *m) {
    void *adj = in->args->adj;
    if (!adj) return fail(in, SLT_USAGE);
    for (uint32_t l = 0; l < in->lanes; l++) {
        if (!m->on[l] || in->base + l >= in->n) continue;
        uint32_t k = i->imm.slot.base + clamp_index(index[l], i->imm.slot.count);
        if (in->flt == 4) ((float *)adj)[k] += ((const float *)value)[l];
        else ((double *)adj)[k] += ((const double *)value)[l];
    }
    return true;
}

static bool exec_rand(Interp *in, void *dst, const int32_t *number) {
    const int32_t *stream = in->args->in[IN_STREAM];
    const void *first = in->args->in[IN_RAND0];
    if (!stream || !first) return fail(in, SLT_USAGE);
    for (uint32_t l = 0; l < in->lanes; l++) {
        uint32_t s = sample_of(in, l);
        uint32_t bits = ir_rand_u32((uint32_t)stream[s], (uint32_t)number[l]);
        set_flt(in, dst, l,
                (uint32_t)number[l] == in->first_random ? get_flt(in, first, s) : (double)(bits >> 8) * 0x1p-24);
    }
    return true;
}

static void exec_print(Interp *in, const Inst *i, const Mask *m) {
    if (!in->args->print) return;
    double *values = malloc(sizeof *values * (i->nargs + 1));
    if (!values) return;
    for (uint32_t l = 0; l < in->lanes; l++) {
        if (!counts(in, m, l)) continue;
        for (uint32_t a = 0; a < i->nargs; a++) {
            const void *v = in->slot[i->args[a]->id];
            values[a] = i->args[a]->type == TY_FLT ? get_flt(in, v, l) : (double)((const int32_t *)v)[l];
        }
        in->args->print(in->args->user, i->imm.text.text, i->imm.text.len, values, i->nargs, in->base + l);
    }
    free(values);
}

static void exec_note(Interp *in, const Inst *i, const int32_t *may, const int32_t *must, const Mask *m) {
    if (!in->args->note) return;
    SltNote *note = &in->args->note[i->imm.i][in->position[i->imm.i]];
    for (uint32_t l = 0; l < in->lanes && in->base + l < SLT_PAD; l++) {
        uint64_t box = (uint64_t)1 << (in->base + l);
        if (m->on[l] && may[l]) note->may |= box;
        if (m->on[l] && must[l]) note->must |= box;
    }
}

/* ---- straight-line programs: chunks that run, choices that are settled or noted */

static bool is_live(const SltPruned *p, int64_t chunk) {
    const int32_t *c = p->chunks;
    while (*c < chunk) c++;
    return *c == chunk;
}

static bool exec_frame(Interp *in, const Inst *i, const Mask *m) {
    bool gives = i->op == OP_give;
    uint64_t which = gives ? i->imm.frame.which : (uint64_t)in->args->pruned->from[i->imm.frame.which];
    which = which * i->imm.frame.places + i->imm.frame.place;
    if (which >= in->frame_places) return fail(in, SLT_USAGE);
    unsigned char *at = in->frame + which * in->lanes * 8;
    if (gives) copy_masked(in, at, in->slot[i->args[0]->id], i->args[0]->type, m);
    else copy_masked(in, in->slot[i->id], at, i->type, m);
    return true;
}

static void note_choice(Interp *in, const Inst *i, const Mask *m) {
    for (uint32_t w = 0; w < 2 && in->args->choices; w++) {
        uint64_t *bits = &in->args->choices[2 * i->imm.i + w];
        const int32_t *may = in->slot[i->args[w]->id];
        for (uint32_t l = 0; l < in->lanes && in->base + l < in->n; l++) {
            uint64_t bit = (uint64_t)1 << ((in->base + l) % SLT_CHOICE_BOXES);
            if (m->on[l]) *bits = may[l] ? *bits | bit : *bits & ~bit;
        }
    }
}

/* ---- arrays: row e of lanes elements is element e */

static unsigned char *element(const Interp *in, const Inst *alloc, uint32_t e, uint32_t lane, uint32_t bytes) {
    return (unsigned char *)in->slot[alloc->id] + ((uint64_t)e * in->lanes + lane) * bytes;
}

static void exec_alloc(Interp *in, const Inst *i, const Mask *m) {
    uint32_t bytes = type_bytes(in, i->imm.arr.elem);
    for (uint32_t e = 0; e < i->imm.arr.count; e++)
        for (uint32_t l = 0; l < in->lanes; l++)
            if (m->on[l]) memset(element(in, i, e, l, bytes), 0, bytes);
}

static void exec_load(Interp *in, const Inst *i, const Mask *m) {
    const Inst *array = i->args[0];
    uint32_t bytes = type_bytes(in, array->imm.arr.elem);
    const int32_t *index = in->slot[i->args[1]->id];
    unsigned char *dst = in->slot[i->id];
    for (uint32_t l = 0; l < in->lanes; l++)
        if (m->on[l])
            memcpy(dst + (size_t)l * bytes, element(in, array, clamp_index(index[l], array->imm.arr.count), l, bytes),
                   bytes);
}

static void exec_store(Interp *in, const Inst *i, const Mask *m) {
    const Inst *array = i->args[0];
    uint32_t bytes = type_bytes(in, array->imm.arr.elem);
    const int32_t *index = in->slot[i->args[1]->id];
    const unsigned char *src = in->slot[i->args[2]->id];
    for (uint32_t l = 0; l < in->lanes; l++)
        if (m->on[l])
            memcpy(element(in, array, clamp_index(index[l], array->imm.arr.count), l, bytes), src + (size_t)l * bytes,
                   bytes);
}

static void exec_acopy(Interp *in, const Inst *i, const Mask *m) {
    uint32_t bytes = type_bytes(in, i->args[0]->imm.arr.elem);
    for (uint32_t e = 0; e < i->args[0]->imm.arr.count; e++)
        for (uint32_t l = 0; l < in->lanes; l++)
            if (m->on[l]) memcpy(element(in, i->args[0], e, l, bytes), element(in, i->args[1], e, l, bytes), bytes);
}

/* ---- the tape: frames of [values of all lanes][mask][size of all that, 8 bytes], the mask padded to 8 */

static uint64_t frame_bytes(const Interp *in, uint64_t value_bytes) {
    return value_bytes + ((in->lanes + 7u) & ~7u) + 8;
}

static bool exec_tapepush(Interp *in, const Inst *i, const Mask *m) {
    uint64_t bytes = 0;
    for (uint32_t a = 0; a < i->nargs; a++)
        bytes += ((uint64_t)in->lanes * type_bytes(in, i->args[a]->type) + 7) & ~7ull;
    uint64_t size = frame_bytes(in, bytes), end = in->tape_top + size;
    if (end > in->tape_limit) {
        in->args->counters[COUNTER_TAPE_OVERFLOW]++;
        return fail(in, SLT_LIMIT);
    }
    if (end > in->tape_cap) {
        uint64_t cap = in->tape_cap ? in->tape_cap * 2 : 65536;
        while (cap < end) cap *= 2;
        unsigned char *grown = realloc(in->tape, cap);
        if (!grown) {
            in->refused = true;
            return fail(in, SLT_LIMIT);
        }
        in->tape = grown;
        in->tape_cap = cap;
    }
    unsigned char *at = in->tape + in->tape_top;
    for (uint32_t a = 0; a < i->nargs; a++) {
        uint64_t len = (uint64_t)in->lanes * type_bytes(in, i->args[a]->type);
        memcpy(at, in->slot[i->args[a]->id], len);
        at += (len + 7) & ~7ull;
    }
    memcpy(at, m->on, in->lanes);
    memcpy(in->tape + end - 8, &size, 8);
    in->tape_top = end;
    return true;
}

/* Uniform over the active lanes; lanes that never ran may hold anything. */
static uint64_t mark_of(const Interp *in, const Inst *mark, const Mask *m) {
    const uint64_t *marks = in->slot[mark->id];
    for (uint32_t l = 0; l < in->lanes; l++)
        if (m->on[l]) return marks[l];
    return in->tape_top;
}

static bool exec_revloop(Interp *in, const Inst *i, const Mask *m) {
    const Block *body = i->region[0];
    uint32_t ncarried = i->nargs - 1, frame = body->nparams - ncarried;
    const uint64_t mark = mark_of(in, i->args[0], m);
    for (uint32_t c = 0; c < ncarried; c++)
        copy_all(in, in->slot[body->params[frame + c]->id], in->slot[i->args[1 + c]->id], i->args[1 + c]->type);
    uint64_t bytes = 0;
    for (uint32_t p = 0; p < frame; p++)
        bytes += ((uint64_t)in->lanes * type_bytes(in, body->params[p]->type) + 7) & ~7ull;
    while (in->tape_top > mark) {
        uint64_t size;
        memcpy(&size, in->tape + in->tape_top - 8, 8);
        if (size != frame_bytes(in, bytes) || size > in->tape_top - mark) return fail(in, SLT_INTERNAL);
        in->tape_top -= size;
        const unsigned char *at = in->tape + in->tape_top;
        for (uint32_t p = 0; p < frame; p++) {
            uint64_t len = (uint64_t)in->lanes * type_bytes(in, body->params[p]->type);
            memcpy(in->slot[body->params[p]->id], at, len);
            at += (len + 7) & ~7ull;
        }
        Mask active = {{0}};
        for (uint32_t l = 0; l < in->lanes; l++) active.on[l] = at[l] && m->on[l];
        if (!any(in, &active)) continue;
        if (!exec_block(in, body, &active)) return false;
        for (uint32_t c = 0; c < ncarried; c++) {
            const Inst *p = body->params[frame + c];
            copy_masked(in, in->next[p->id], in->slot[body->last->args[c]->id], p->type, &active);
        }
        for (uint32_t c = 0; c < ncarried; c++) {
            const Inst *p = body->params[frame + c];
            copy_masked(in, in->slot[p->id], in->next[p->id], p->type, &active);
        }
    }
    for (const Inst *p = i->next; p && p->op == OP_proj && p->args[0] == i; p = p->next)
        copy_all(in, in->slot[p->id], in->slot[body->params[frame + p->imm.i]->id], p->type);
    return true;
}

/* ---- control flow */

static bool exec_if(Interp *in, const Inst *i, const Mask *m) {
    const int32_t *cond = in->slot[i->args[0]->id];
    for (uint32_t r = 0; r < 2; r++) {
        Mask side = {{0}};
        for (uint32_t l = 0; l < in->lanes; l++) side.on[l] = m->on[l] & ((cond[l] != 0) == (r == 0));
        if (!any(in, &side)) continue;
        if (!exec_block(in, i->region[r], &side)) return false;
        Inst *const *values = i->region[r]->last->args;
        for (const Inst *p = i->next; p && p->op == OP_proj && p->args[0] == i; p = p->next)
            copy_masked(in, in->slot[p->id], in->slot[values[p->imm.i]->id], p->type, &side);
    }
    return true;
}

static bool exec_loop(Interp *in, const Inst *i, const Mask *m) {
    const Block *body = i->region[0];
    const SltCullList *list = i->imm.loop.cull && in->args->cull ? &in->args->cull[i->imm.loop.cull_id] : NULL;
    if (list && list->count < 0) list = NULL;
    int32_t *k = in->slot[body->params[0]->id];
    Inst *const *values = body->last->args + 1;
    const int32_t *go_on = in->slot[body->last->args[0]->id];
    for (uint32_t c = 0; c < i->nargs; c++)
        copy_all(in, in->slot[body->params[1 + c]->id], in->slot[i->args[c]->id], i->args[c]->type);
    /* The bound is the front end's promise; far beyond it, the IR is broken and would not end. */
    uint64_t guard = 2 * (uint64_t)i->imm.loop.max_iters + 1024;
    Mask active = *m;
    for (uint64_t trip = 0; any(in, &active); trip++) {
        if (list && trip >= (uint64_t)list->count) break;
        if (trip > guard) return fail(in, SLT_INTERNAL);
        if (i->imm.loop.cull) in->position[i->imm.loop.cull_id] = (uint32_t)trip;
        for (uint32_t l = 0; l < in->lanes; l++) k[l] = list ? list->items[trip] : (int32_t)trip;
        if (!exec_block(in, body, &active)) return false;
        for (uint32_t c = 0; c < i->nargs; c++) { /* a value may be another parameter: read all before writing any */
            const Inst *p = body->params[1 + c];
            copy_masked(in, in->next[p->id], in->slot[values[c]->id], p->type, &active);
        }
        for (uint32_t l = 0; l < in->lanes; l++) {
            /* The flag may be an outer value, or a parameter about to be overwritten: keep it with the old mask. */
            active.on[l] = active.on[l] ? (go_on[l] ? 3 : 2) : 0;
        }
        for (uint32_t c = 0; c < i->nargs; c++) {
            const Inst *p = body->params[1 + c];
            copy_masked(in, in->slot[p->id], in->next[p->id], p->type, &active);
        }
        for (uint32_t l = 0; l < in->lanes; l++) active.on[l] &= 1;
    }
    for (const Inst *p = i->next; p && p->op == OP_proj && p->args[0] == i; p = p->next)
        copy_all(in, in->slot[p->id], in->slot[body->params[1 + p->imm.i]->id], p->type);
    return true;
}

static bool exec_custom(Interp *in, const Inst *i, const Mask *m) {
    const Block *body = i->region[0];
    for (uint32_t a = 0; a < i->nargs; a++)
        copy_all(in, in->slot[body->params[a]->id], in->slot[i->args[a]->id], i->args[a]->type);
    if (!exec_block(in, body, m)) return false;
    for (const Inst *p = i->next; p && p->op == OP_proj && p->args[0] == i; p = p->next)
        copy_all(in, in->slot[p->id], in->slot[body->last->args[p->imm.i]->id], p->type);
    return true;
}

/* Rays of all lanes, one call, as the compiled kernels do. */
static bool exec_query(Interp *in, const Inst *i, const Mask *m, void *dst) {
    const SltKernelArgs *args = in->args;
    if (!args->geometries || !args->geometries[i->imm.query.geometry] || !args->params) return fail(in, SLT_USAGE);
    const SltGeometry *g = args->geometries[i->imm.query.geometry];
    /* A geometry answers what compiled kernels ask, and another function may ask more. */
    if (!g->query[i->imm.query.what]) return fail(in, SLT_USAGE);
    _Alignas(64) unsigned char rays[SLT_LINE_ROWS * 64 * sizeof(double)];
    uint64_t on = 0;
    for (uint32_t l = 0; l < in->lanes; l++) on |= (uint64_t)(m->on[l] != 0) << l;
    size_t row = (size_t)in->lanes * in->flt;
    for (uint32_t a = 0; a < i->nargs; a++) memcpy(rays + a * row, in->slot[i->args[a]->id], row);
    g->query[i->imm.query.what](g, (const char *)args->params + (size_t)i->imm.query.base * in->flt, rays, on,
                                in->lanes, dst);
    return true;
}

static bool exec_told(Interp *in, const Inst *i, void *dst, const int32_t *unit) {
    const SltKernelArgs *args = in->args;
    if (!args->geometries || !args->geometries[i->imm.query.geometry]) return fail(in, SLT_USAGE);
    const SltGeometry *g = args->geometries[i->imm.query.geometry];
    if (!g->told) return fail(in, SLT_USAGE);
    const char *row = g->told();
    uint32_t last;
    memcpy(&last, row - SLT_TOLD_LAST, sizeof last);
    for (uint32_t l = 0; l < in->lanes; l++) {
        const uint32_t of = (uint32_t)unit[l] < last ? (uint32_t)unit[l] : last;
        const char *at = row + ((size_t)of * SLT_TOLD + i->imm.query.what) * in->flt;
        if (i->type == TY_INT) memcpy((int32_t *)dst + l, at, sizeof(int32_t));
        else set_flt(in, dst, l, get_flt(in, at, 0));
    }
    return true;
}

static void exec_item(Interp *in, const Inst *i, int32_t *dst, const int32_t *a) {
    const SltCullList *list = in->args->cull ? &in->args->cull[i->imm.i] : NULL;
    int32_t n = list ? list->count : -1;
    for (uint32_t l = 0; l < in->lanes; l++)
        if (i->op == OP_items) dst[l] = n < 0 ? a[l] : n ? n : 1;
        else dst[l] = n > 0 && a[l] >= 0 ? list->items[a[l] < n ? a[l] : n - 1] : a[l];
}

static bool exec_special(Interp *in, const Inst *i, const Mask *m) {
    void *dst = in->slot[i->id];
    void *a = i->nargs ? in->slot[i->args[0]->id] : NULL;
    switch ((Op)i->op) {
    case OP_constf:
    case OP_consti:
    case OP_constb: /* filled once */
    case OP_proj:   /* written by its operation */
    case OP_arg:
    case OP_yield: return true;
    case OP_input: return exec_input(in, i, dst);
    case OP_param:
    case OP_iparam:
    case OP_dparam: return exec_param(in, i, dst, a, m);
    case OP_adj: return exec_adj(in, i, a, in->slot[i->args[1]->id], m);
    case OP_rand: return exec_rand(in, dst, a);
    case OP_detach:
    case OP_site:
    case OP_siten: copy_all(in, dst, a, i->type); return true;
    case OP_alloc: exec_alloc(in, i, m); return true;
    case OP_load: exec_load(in, i, m); return true;
    case OP_store: exec_store(in, i, m); return true;
    case OP_acopy: exec_acopy(in, i, m); return true;
    case OP_if_: return exec_if(in, i, m);
    case OP_loop: return exec_loop(in, i, m);
    case OP_revloop: return exec_revloop(in, i, m);
    case OP_custom: return exec_custom(in, i, m);
    case OP_partner: {
        uint32_t bytes = type_bytes(in, i->type);
        for (uint32_t l = 0; l < in->lanes; l++) {
            uint32_t other = (l ^ 1) < in->lanes ? l ^ 1 : l;
            memcpy((unsigned char *)dst + (size_t)l * bytes, (unsigned char *)a + (size_t)other * bytes, bytes);
        }
        return true;
    }
    case OP_both:
        for (uint32_t l = 0; l < in->lanes; l++) ((int32_t *)dst)[l] = m->on[l] && (l ^ 1) < in->lanes && m->on[l ^ 1];
        return true;
    case OP_any: {
        int32_t on = 0;
        for (uint32_t l = 0; l < in->lanes; l++) on |= m->on[l] && ((const int32_t *)a)[l];
        for (uint32_t l = 0; l < in->lanes; l++) ((int32_t *)dst)[l] = on;
        return true;
    }
    case OP_tapemark:
        for (uint32_t l = 0; l < in->lanes; l++) ((uint64_t *)dst)[l] = in->tape_top;
        return true;
    case OP_tapepush: return exec_tapepush(in, i, m);
    case OP_tapedrop: in->tape_top = mark_of(in, i->args[0], m); return true;
    case OP_count:
        for (uint32_t l = 0; l < in->lanes; l++)
            if (((const int32_t *)a)[l] && counts(in, m, l)) in->args->counters[i->imm.i]++;
        return true;
    case OP_give:
    case OP_take: return exec_frame(in, i, m);
    case OP_live:
        for (uint32_t l = 0; l < in->lanes; l++) ((int32_t *)dst)[l] = is_live(in->args->pruned, i->imm.i);
        return true;
    case OP_stands:
        for (uint32_t l = 0; l < in->lanes; l++) ((int32_t *)dst)[l] = 0;
        return true;
    case OP_settled:
        for (uint32_t l = 0; l < in->lanes; l++) ((int32_t *)dst)[l] = in->args->pruned->settled[i->imm.i] != 0;
        return true;
    case OP_choice: note_choice(in, i, m); return true;
    case OP_print: exec_print(in, i, m); return true;
    case OP_item:
    case OP_items: exec_item(in, i, dst, a); return true;
    case OP_note: exec_note(in, i, a, in->slot[i->args[1]->id], m); return true;
    case OP_query: return exec_query(in, i, m, dst);
    case OP_told: return exec_told(in, i, dst, a);
    case OP_ghost: memset(dst, 0, (size_t)in->lanes * in->flt); return true;
    case OP_window: { /* lanes form no pairs here: from each ray's own t, top and margin */
        for (uint32_t l = 0; l < in->lanes; l++)
            set_flt(in, dst, l,
                    i->imm.i & 1 ? get_flt(in, in->slot[i->args[1]->id], l) + get_flt(in, in->slot[i->args[2]->id], l)
                                 : get_flt(in, a, l) - get_flt(in, in->slot[i->args[2]->id], l));
        return true;
    }
    default: return fail(in, SLT_INTERNAL);
    }
}

static bool exec_block(Interp *in, const Block *b, const Mask *m) {
    void **slot = in->slot;
    for (const Inst *i = b->first; i; i = i->next) {
        if (in->fuel-- == 0) return fail(in, SLT_LIMIT);
        if (ir_ops[i->op].special) {
            if (!exec_special(in, i, m)) return false;
            if (in->watch) in->watch(in->watch_user, i, (const void *const *)slot, m->on);
            continue;
        }
        const void *x = slot[i->args[0]->id];
        const void *y = i->nargs > 1 ? slot[i->args[1]->id] : NULL, *z = i->nargs > 2 ? slot[i->args[2]->id] : NULL;
        in->eval(i->op, in->lanes, slot[i->id], x, y, z);
        if (in->watch) in->watch(in->watch_user, i, (const void *const *)slot, m->on);
    }
    return true;
}

/* ---- memory for all values; a call, vector after vector */

static uint64_t slot_bytes(const Interp *in, const Inst *i) {
    uint64_t one = i->type == TY_ARRAY  ? (uint64_t)type_bytes(in, i->imm.arr.elem) * i->imm.arr.count
                   : i->type == TY_VOID ? 0
                                        : type_bytes(in, i->type);
    return (one * in->lanes + 63) & ~(uint64_t)63;
}

typedef struct Layout {
    Interp *in;
    uint64_t top; /* bytes so far */
    bool place;   /* second round: memory is there */
} Layout;

static void layout_value(Layout *y, const Inst *i) {
    if (y->place) y->in->slot[i->id] = y->in->memory + y->top;
    y->top += slot_bytes(y->in, i);
}

static void fill_const(const Interp *in, const Inst *i) {
    for (uint32_t l = 0; l < in->lanes; l++)
        if (i->op == OP_constf) set_flt(in, in->slot[i->id], l, i->imm.f);
        else ((int32_t *)in->slot[i->id])[l] = (int32_t)i->imm.i;
}

static void layout_block(Layout *y, const Block *b) {
    for (uint32_t p = 0; p < b->nparams; p++) {
        layout_value(y, b->params[p]);
        if (!b->owner || (b->owner->op != OP_loop && b->owner->op != OP_revloop)) continue;
        if (y->place) y->in->next[b->params[p]->id] = y->in->memory + y->top;
        y->top += slot_bytes(y->in, b->params[p]);
    }
    for (const Inst *i = b->first; i; i = i->next) {
        layout_value(y, i);
        uint64_t places = i->op == OP_give ? (i->imm.frame.which + 1ull) * i->imm.frame.places : 0;
        if (places > y->in->frame_places) y->in->frame_places = places;
        if (y->place && ir_is_const(i)) fill_const(y->in, i);
        for (uint32_t r = 0; r < i->nregions; r++) layout_block(y, i->region[r]);
    }
}

/* What a Fn's values take at so many lanes; the memory is the caller's, all zero. */
static uint64_t measure(Interp *in, const Fn *fn, uint32_t lanes) {
    bool f32 = fn->precision == PREC_F32;
    *in = (Interp){.fn = fn, .lanes = lanes, .flt = f32 ? 4 : 8, .eval = f32 ? rows_eval_f32 : rows_eval_f64};
    in->ids = (ir_is_numbered(fn) ? fn->ninsts : ir_number((Fn *)fn)) + 1;
    Layout y = {.in = in};
    layout_block(&y, fn->body);
    in->frame_bytes = (in->frame_places * lanes + 1) * 8;
    return y.top + 64;
}

static void place_values(Interp *in) {
    Layout y = {.in = in, .place = true};
    layout_block(&y, in->fn->body);
}

static bool write_outputs(Interp *in) {
    const Inst *yield = in->fn->body->last;
    if (yield->nargs > SLT_OUT_MAX) return fail(in, SLT_INTERNAL);
    uint32_t n = in->n - in->base < in->lanes ? in->n - in->base : in->lanes;
    for (uint32_t o = 0; o < yield->nargs; o++) {
        unsigned char *to = in->args->out[o];
        if (!to) continue; /* not wanted */
        uint32_t bytes = type_bytes(in, yield->args[o]->type);
        memcpy(to + (size_t)in->base * bytes, in->slot[yield->args[o]->id], (size_t)n * bytes);
    }
    return true;
}

int ir_interpret(const Fn *fn, SltKernelArgs *args, uint32_t n, uint32_t lanes) {
    uint64_t fuel = UINT64_MAX;
    return ir_interpret_within(fn, args, n, lanes, &fuel);
}

int ir_interpret_within(const Fn *fn, SltKernelArgs *args, uint32_t n, uint32_t lanes, uint64_t *fuel) {
    return ir_interpret_watched(fn, args, n, lanes, fuel, 0, NULL, NULL);
}

/* Values left over from the call before are never looked at: what a lane reads it has written. */
int ir_interp_run(Interp *in, SltKernelArgs *args, uint32_t n, uint64_t *fuel, uint32_t first, IrWatch *watch,
                  void *user) {
    if (!n) return SLT_OK;
    if (in->frame_places && !args->pruned) return SLT_USAGE;
    in->args = args, in->n = n, in->fuel = *fuel, in->status = SLT_OK, in->refused = false;
    in->watch = watch, in->watch_user = user, in->first_random = first;
    in->tape_limit = args->tape_bytes ? args->tape_bytes : default_tape_bytes;
    Mask all = {{0}};
    memset(all.on, 1, in->lanes);
    for (in->base = 0; in->base < n && in->status == SLT_OK; in->base += in->lanes) {
        in->tape_top = 0;
        if (exec_block(in, in->fn->body, &all)) write_outputs(in);
        if (n - in->base <= in->lanes) break; /* base + lanes may wrap */
    }
    free(in->tape);
    in->tape = NULL, in->tape_cap = 0;
    *fuel = in->status == SLT_LIMIT && !in->refused ? 0 : in->fuel;
    return in->status;
}

Interp *ir_interp(Arena *arena, const Fn *fn, uint32_t lanes) {
    Interp *in = ARENA_NEW(arena, Interp);
    uint64_t bytes = measure(in, fn, lanes);
    if (bytes > max_arena_bytes) return NULL;
    in->slot = ARENA_ARRAY(arena, void *, in->ids), in->next = ARENA_ARRAY(arena, void *, in->ids);
    in->memory = ARENA_ARRAY(arena, unsigned char, bytes + 63);
    in->memory += -(uintptr_t)in->memory & 63;
    in->frame = (unsigned char *)ARENA_ARRAY(arena, uint64_t, in->frame_bytes / 8);
    place_values(in);
    return in;
}

int ir_interpret_watched(const Fn *fn, SltKernelArgs *args, uint32_t n, uint32_t lanes, uint64_t *fuel, uint32_t first,
                         IrWatch *watch, void *user) {
    if (!lanes || lanes > MAX_LANES || (lanes & (lanes - 1))) return SLT_USAGE;
    if (!n) return SLT_OK;
    while (fn->next_part && !(args->site >= 0 && (uint32_t)args->site < fn->nsites && fn->serves[args->site]))
        fn = fn->next_part;
    Interp in;
    uint64_t bytes = measure(&in, fn, lanes);
    int status = SLT_LIMIT;
    if (bytes <= max_slot_bytes) {
        in.slot = calloc(in.ids, sizeof *in.slot), in.next = calloc(in.ids, sizeof *in.next);
        in.memory = calloc(bytes, 1), in.frame = calloc(in.frame_bytes, 1);
    } else *fuel = 0;
    if (in.slot && in.next && in.memory && in.frame) {
        place_values(&in);
        status = ir_interp_run(&in, args, n, fuel, first, watch, user);
    }
    free(in.frame);
    free(in.memory);
    free(in.next);
    free(in.slot);
    return status;
}
