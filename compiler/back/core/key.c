#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* dl_iterate_phdr */
#endif
/* The key of a compilation: a hash of what the emitter reads, of the options and of the build that emits. */
#include <elf.h>
#include <link.h>
#include <string.h>
#define XXH_INLINE_ALL /* the header alone: a library more takes 30 us of each start */
#include <xxhash.h>

#include "compiler/back/core/core.h"

/* A new build of the compiler may emit other code for the same IR, and nothing outside its own bytes says so: builds
 * may share times, sizes and version numbers. The linker's build id is a hash of them; an object without one (a static
 * library in a program that is linked without) is hashed where it lies in memory, as far as nobody writes there. */
typedef struct Emitter {
    const void *self; /* an address of the object that emits */
    XXH3_state_t *state;
    bool found;
} Emitter;

static bool holds(const struct dl_phdr_info *o, const void *p) {
    for (unsigned i = 0; i < o->dlpi_phnum; i++) {
        const ElfW(Phdr) *h = &o->dlpi_phdr[i];
        uintptr_t at = (uintptr_t)p - o->dlpi_addr - h->p_vaddr;
        if (h->p_type == PT_LOAD && at < h->p_memsz) return true;
    }
    return false;
}

/* The GNU build id among the notes of one segment; its length, 0 if it is not there. */
static size_t find_build_id(const unsigned char *note, size_t size, const unsigned char **id) {
    while (size >= sizeof(ElfW(Nhdr))) {
        ElfW(Nhdr) h;
        memcpy(&h, note, sizeof h);
        size_t name = (h.n_namesz + 3) & ~(size_t)3, whole = sizeof h + name + ((h.n_descsz + 3) & ~(size_t)3);
        if (whole > size) break;
        *id = note + sizeof h + name;
        if (h.n_type == NT_GNU_BUILD_ID && h.n_namesz == 4 && !memcmp(note + sizeof h, "GNU", 4)) return h.n_descsz;
        note += whole, size -= whole;
    }
    return 0;
}

static int hash_emitter(struct dl_phdr_info *o, size_t size, void *user) {
    Emitter *e = user;
    (void)size;
    if (!holds(o, e->self)) return 0;
    for (int whole = 0; whole < 2 && !e->found; whole++)
        for (unsigned i = 0; i < o->dlpi_phnum; i++) {
            const ElfW(Phdr) *h = &o->dlpi_phdr[i];
            const unsigned char *at = (const unsigned char *)(o->dlpi_addr + h->p_vaddr), *id = at;
            size_t n = 0;
            if (!whole && h->p_type == PT_NOTE) n = find_build_id(at, h->p_memsz, &id);
            if (whole && h->p_type == PT_LOAD && h->p_flags & PF_R && !(h->p_flags & PF_W)) n = h->p_filesz;
            if (!n) continue;
            XXH3_128bits_update(e->state, id, n);
            e->found = true;
        }
    return 1;
}

static bool hash_build(XXH3_state_t *state) {
    static const char self;
    Emitter e = {&self, state, false};
    dl_iterate_phdr(hash_emitter, &e);
    return e.found;
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
        enum { FACTS = 8, ROOM = 16 }; /* most operands go along in one piece */
        uint32_t w[ROOM] = {i->op, i->type, i->nargs, i->nregions}, n = FACTS;
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
        case OP_told:
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
        for (uint32_t j = 0; j < i->nargs; j++) {
            if (n == ROOM) XXH3_128bits_update(state, w, sizeof w), n = 0;
            w[n++] = i->args[j]->id;
        }
        XXH3_128bits_update(state, w, n * sizeof *w);
        *len += (FACTS + i->nargs) * sizeof *w;
        for (uint32_t r = 0; r < i->nregions; r++) hash_block(state, i->region[r], len);
    }
}

/* NULL: the build cannot be told, or memory is out. */
static XXH3_state_t *begin_key(void) {
    XXH3_state_t *state = XXH3_createState();
    if (state) XXH3_128bits_reset(state);
    if (state && hash_build(state)) return state;
    XXH3_freeState(state);
    return NULL;
}

static void end_key(XXH3_state_t *state, CacheKey *key) {
    const XXH128_hash_t h = XXH3_128bits_digest(state);
    key->hi = h.high64, key->lo = h.low64;
    XXH3_freeState(state);
}

bool back_facts_key(const void *text, size_t size, const Fn *primal, CacheKey *out) {
    XXH3_state_t *state = begin_key();
    if (!state) return false;
    CacheKey key = {.len = size};
    XXH3_128bits_update(state, text, size);
    hash_block(state, primal->body, &key.len);
    end_key(state, &key);
    *out = key;
    return true;
}

bool cache_key(Session *s, const KernelRequest *k, uint32_t n, const BackOptions *o, const char *emitter,
               CacheKey *out) {
    Arena *a = &s->scratch;
    XXH3_state_t *state = begin_key();
    CacheKey key = {0};
    if (!state) return false;
    char *head =
        arena_printf(a, "saltus %s cpu %s features %s vector %u fma %d divider %d adj %d opt %u pixels %d kernels %u\n",
                     emitter, o->target.cpu, o->target.features, o->target.vector_bytes, o->target.has_fma,
                     o->target.slow_divider, (int)o->adj, o->opt_level, (int)o->pixels, n);
    XXH3_128bits_update(state, head, strlen(head));
    key.len = strlen(head);
    for (uint32_t j = 0; j < n; j++) {
        size_t name = strlen(k[j].name) + 1;
        const uint32_t width = back_choose_width(k, j, o);
        for (Fn *fn = k[j].fn; fn; fn = fn->next_part) {
            uint64_t facts[8] = {fn->precision, fn->nfloats,
                                 fn->nints,     ir_number(fn),
                                 width,         back_adjoint_lanes(o, (Precision)fn->precision),
                                 fn->same,      j < 64 && o->plain >> j & 1};
            XXH3_128bits_update(state, k[j].name, name);
            XXH3_128bits_update(state, facts, sizeof facts);
            if (fn->serves) XXH3_128bits_update(state, fn->serves, fn->nsites);
            key.len += name + sizeof facts + (fn->serves ? fn->nsites : 0);
            hash_block(state, fn->body, &key.len);
        }
    }
    end_key(state, &key);
    *out = key;
    return true;
}
