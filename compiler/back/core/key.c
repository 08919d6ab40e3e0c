/* The key of a compilation: a hash of what the emitter reads, of the options and of the build that emits. */
#include <dlfcn.h>
#include <link.h>
#include <string.h>
#include <sys/stat.h>
#include <xxhash.h>

#include "compiler/back/core/core.h"

/* A new build of the compiler may emit other code for the same IR: the file that holds this function names the emitter.
 * Of a program the loader knows no file: dli_fname is what it was called by, and means nothing if a shell searched it
 * in $PATH. NULL: the file is gone. */
static const char *emitter_stamp(Arena *a) {
    Dl_info info;
    struct stat st;
    void *self, *map;
    const char *(*f)(Arena *) = emitter_stamp;
    memcpy(&self, &f, sizeof self);
    if (!dladdr1(self, &info, &map, RTLD_DL_LINKMAP)) return NULL;
    const char *file = ((struct link_map *)map)->l_name;
    if (stat(file[0] ? file : "/proc/self/exe", &st)) return NULL;
    return arena_printf(a, "%lld.%09ld.%lld", (long long)st.st_mtim.tv_sec, st.st_mtim.tv_nsec, (long long)st.st_size);
}

/* The meaning of a block, without names and places: what the emitter reads, and nothing else. Ids are dense and in
 * program order. */
static void hash_block(XXH3_state_t *state, const Block *b, size_t *len) {
    for (uint32_t j = 0; j <= b->nparams; j++) {
        uint32_t w[2] = {j < b->nparams ? b->params[j]->id : UINT32_MAX,
                         j < b->nparams ? b->params[j]->type : b->nparams};
        XXH3_128bits_update(state, w, sizeof w);
        *len += sizeof w;
    }
    for (const Inst *i = b->first; i; i = i->next) {
        uint32_t w[8] = {i->op, i->type, i->nargs, i->nregions};
        const LoopInfo *loop = &i->imm.loop;
        switch (i->op) {
        case OP_loop: w[4] = loop->max_iters, w[5] = loop->exact, w[6] = loop->cull, w[7] = loop->cull_id; break;
        case OP_print:
            w[4] = i->imm.text.len;
            XXH3_128bits_update(state, i->imm.text.text, i->imm.text.len);
            *len += i->imm.text.len;
            break;
        case OP_param:
        case OP_iparam:
        case OP_dparam:
        case OP_adj: w[4] = i->imm.slot.base, w[5] = i->imm.slot.count; break;
        case OP_alloc: w[4] = i->imm.arr.count, w[5] = i->imm.arr.elem; break;
        case OP_give:
        case OP_take: w[4] = i->imm.frame.which, w[5] = i->imm.frame.place, w[6] = i->imm.frame.places; break;
        case OP_query: w[4] = i->imm.query.geometry, w[5] = i->imm.query.what, w[6] = i->imm.query.base; break;
        case OP_constf:
        case OP_consti:
        case OP_constb:
        case OP_if_:
        case OP_input:
        case OP_proj:
        case OP_window:
        case OP_arg:
        case OP_count:
        case OP_live:
        case OP_settled:
        case OP_choice:
        case OP_item:
        case OP_items:
        case OP_note: memcpy(w + 4, &i->imm.i, sizeof i->imm.i); break;
        default: break;
        }
        XXH3_128bits_update(state, w, sizeof w);
        *len += sizeof w;
        for (uint32_t j = 0; j < i->nargs; j++) XXH3_128bits_update(state, &i->args[j]->id, sizeof i->args[j]->id);
        *len += i->nargs * sizeof(uint32_t);
        for (uint32_t r = 0; r < i->nregions; r++) hash_block(state, i->region[r], len);
    }
}

bool cache_key(Session *s, const KernelRequest *k, uint32_t n, const BackOptions *o, uint32_t width,
               const char *emitter, CacheKey *out) {
    Arena *a = &s->scratch;
    XXH3_state_t *state = XXH3_createState();
    const char *stamp = emitter_stamp(a);
    CacheKey key = {0};
    if (!state || !stamp) {
        XXH3_freeState(state);
        return false;
    }
    XXH3_128bits_reset(state);
    char *head =
        arena_printf(a, "saltus %s %s cpu %s features %s vector %u fma %d width %u adj %d opt %u rgba8 %d kernels %u\n",
                     stamp, emitter, o->target.cpu, o->target.features, o->target.vector_bytes, o->target.has_fma,
                     width, (int)o->adj, o->opt_level, o->output_rgba8, n);
    XXH3_128bits_update(state, head, strlen(head));
    key.len = strlen(head);
    for (uint32_t j = 0; j < n; j++) {
        size_t name = strlen(k[j].name) + 1;
        for (Fn *fn = k[j].fn; fn; fn = fn->next_part) {
            uint32_t facts[4] = {fn->precision, fn->nfloats, fn->nints, ir_number(fn)};
            XXH3_128bits_update(state, k[j].name, name);
            XXH3_128bits_update(state, facts, sizeof facts);
            if (fn->serves) XXH3_128bits_update(state, fn->serves, fn->nsites);
            key.len += name + sizeof facts + (fn->serves ? fn->nsites : 0);
            hash_block(state, fn->body, &key.len);
        }
    }
    XXH128_hash_t h = XXH3_128bits_digest(state);
    key.hi = h.high64;
    key.lo = h.low64;
    XXH3_freeState(state);
    *out = key;
    return true;
}
