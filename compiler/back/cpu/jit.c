/* Kernels in memory: from the disk cache if it has them, else through LLVM; loaded either way by load.c. */
#include <dlfcn.h>
#include <link.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <xxhash.h>

#include "compiler/back/cpu/emit.h"
#include "saltus/status.h"

struct CompiledModule {
    Loaded *code;
    uint32_t n, width;
    char (*names)[64];
    uint32_t *instructions;
    SltKernel **kernels;
    double emit_ms, llvm_ms;
    bool cached;
};

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
        case OP_fieldop: w[4] = i->imm.field.field, w[5] = i->imm.field.what, w[6] = i->imm.field.base; break;
        case OP_constf:
        case OP_consti:
        case OP_constb:
        case OP_if_:
        case OP_input:
        case OP_proj:
        case OP_window:
        case OP_arg:
        case OP_count: memcpy(w + 4, &i->imm.i, sizeof i->imm.i); break;
        default: break;
        }
        XXH3_128bits_update(state, w, sizeof w);
        *len += sizeof w;
        for (uint32_t j = 0; j < i->nargs; j++) XXH3_128bits_update(state, &i->args[j]->id, sizeof i->args[j]->id);
        *len += i->nargs * sizeof(uint32_t);
        for (uint32_t r = 0; r < i->nregions; r++) hash_block(state, i->region[r], len);
    }
}

/* False: nothing may be kept under a key that does not name what made it. */
static bool make_key(Session *s, const KernelRequest *k, uint32_t n, const BackOptions *o, uint32_t width,
                     CacheKey *out) {
    Arena *a = &s->scratch;
    XXH3_state_t *state = XXH3_createState();
    const char *stamp = emitter_stamp(a);
    CacheKey key = {0};
    if (!state || !stamp) {
        XXH3_freeState(state);
        return false;
    }
    XXH3_128bits_reset(state);
    char *head = arena_printf(a,
                              "saltus %s llvm " LLVM_VERSION_STRING
                              " cpu %s features %s vector %u fma %d width %u adj %d opt %u rgba8 %d kernels %u\n",
                              stamp, o->target.cpu, o->target.features, o->target.vector_bytes, o->target.has_fma,
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

static CompiledModule *new_module(const KernelRequest *k, uint32_t n, uint32_t width) {
    CompiledModule *m = calloc(1, sizeof *m);
    if (!m) return NULL;
    m->n = n;
    m->width = width;
    m->names = calloc(n + 1, sizeof *m->names);
    m->instructions = calloc(n + 1, sizeof *m->instructions);
    m->kernels = calloc(n + 1, sizeof(SltKernel *));
    if (!m->names || !m->instructions || !m->kernels) {
        back_free(m);
        return NULL;
    }
    for (uint32_t j = 0; j < n; j++) strcpy(m->names[j], k[j].name);
    return m;
}

/* The payload of a cache entry: one instruction count a kernel, padding to 8 bytes, the object. */
static size_t object_offset(uint32_t n) { return ((size_t)n * 4 + 7) & ~(size_t)7; }

static bool adopt(CompiledModule *m, const unsigned char *payload, size_t size, const char **why) {
    size_t at = object_offset(m->n);
    if (size < at) {
        *why = "entry too short";
        return false;
    }
    memcpy(m->instructions, payload, m->n * sizeof(uint32_t));
    m->code = load_object(payload + at, size - at, why);
    if (!m->code) return false;
    for (uint32_t j = 0; j < m->n; j++) {
        void *f = load_symbol(m->code, m->names[j], NULL);
        if (!f) {
            *why = "kernel missing in the object";
            load_free(m->code);
            m->code = NULL;
            return false;
        }
        memcpy(&m->kernels[j], &f, sizeof f);
    }
    return true;
}

static unsigned char *make_payload(const Codegen *g, uint32_t n, size_t *size) {
    size_t at = object_offset(n);
    unsigned char *p = calloc(1, at + g->size);
    if (!p) return NULL;
    memcpy(p, g->instructions, n * sizeof(uint32_t));
    memcpy(p + at, g->bytes, g->size);
    *size = at + g->size;
    return p;
}

static int check_request(Session *s, const KernelRequest *k, uint32_t n, uint32_t width, const char **why) {
    for (uint32_t j = 0; j < n; j++)
        if (strlen(k[j].name) >= 64) {
            *why = arena_printf(&s->session, "kernel name %s is too long", k[j].name);
            return SLT_USAGE;
        }
    if (width == 0 || width > BACK_MAX_WIDTH || (width & (width - 1))) {
        *why = arena_printf(&s->session, "width %u is not a power of two from 1 to %d", width, BACK_MAX_WIDTH);
        return SLT_USAGE;
    }
    return SLT_OK;
}

static int compile(Session *s, const KernelRequest *k, uint32_t n, const BackOptions *o, uint32_t width,
                   CompiledModule *m, const char **why) {
    const char *folder = o->no_cache ? NULL : cache_folder(&s->scratch, o->cache_dir), *bad = NULL;
    CacheKey key = {0};
    size_t size = 0;
    if (folder && !make_key(s, k, n, o, width, &key)) folder = NULL;
    if (folder) {
        unsigned char *payload = cache_read(&s->scratch, folder, &key, &size);
        m->cached = payload && adopt(m, payload, size, &bad);
        free(payload);
        if (m->cached) return SLT_OK;
    }
    Codegen g;
    int status = back_codegen(s, k, n, o, width, 'o', &g, why);
    if (status) return status;
    m->emit_ms = g.emit_ms;
    m->llvm_ms = g.llvm_ms;
    unsigned char *payload = make_payload(&g, n, &size);
    free(g.bytes);
    if (!payload || !adopt(m, payload, size, &bad)) {
        free(payload);
        *why = arena_printf(&s->session, "cannot load the compiled kernels: %s", bad ? bad : "out of memory");
        return SLT_INTERNAL;
    }
    if (folder)
        (void)cache_write(&s->scratch, folder, &key, payload,
                          size); /* a cache that cannot be written costs time only */
    free(payload);
    return SLT_OK;
}

int back_compile(Session *s, const KernelRequest *k, uint32_t n, const BackOptions *o, CompiledModule **out,
                 const char **why) {
    *out = NULL;
    uint32_t width = o->width ? o->width : back_choose_width(k, n, &o->target);
    int status = check_request(s, k, n, width, why);
    if (status) return status;
    CompiledModule *m = new_module(k, n, width);
    if (!m) {
        *why = "out of memory";
        return SLT_LIMIT;
    }
    ArenaMark mark = arena_mark(&s->scratch);
    status = compile(s, k, n, o, width, m, why);
    arena_reset(&s->scratch, mark);
    if (status) {
        back_free(m);
        return status;
    }
    *out = m;
    return SLT_OK;
}

static int find(const CompiledModule *m, const char *name) {
    for (uint32_t j = 0; j < m->n; j++)
        if (!strcmp(m->names[j], name)) return (int)j;
    return -1;
}

SltKernel *back_kernel(const CompiledModule *m, const char *name) {
    int j = find(m, name);
    return j < 0 ? NULL : m->kernels[j];
}

uint32_t back_width(const CompiledModule *m) { return m->width; }

uint32_t back_instructions(const CompiledModule *m, const char *name) {
    int j = find(m, name);
    return j < 0 ? 0 : m->instructions[j];
}

uint32_t back_machine_bytes(const CompiledModule *m, const char *name) {
    uint64_t size = 0;
    return load_symbol(m->code, name, &size) ? (uint32_t)size : 0;
}

void back_times(const CompiledModule *m, double *emit_ms, double *llvm_ms, bool *cached) {
    *emit_ms = m->emit_ms;
    *llvm_ms = m->llvm_ms;
    *cached = m->cached;
}

void back_free(CompiledModule *m) {
    if (!m) return;
    load_free(m->code);
    free(m->names);
    free(m->instructions);
    free(m->kernels);
    free(m);
}
