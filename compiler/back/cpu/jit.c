/* Kernels in memory: from the disk cache if it has them, else through LLVM; loaded either way by load.c. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "compiler/back/cpu/emit.h"
#include "saltus/status.h"

struct CompiledModule {
    Loaded **code; /* [nobjects] */
    uint32_t nobjects, n, *widths;
    char (*names)[64];
    uint32_t *instructions;
    SltKernel **kernels;
    double emit_ms, llvm_ms;
    bool cached;
    CacheKey key; /* of its entry; .len 0: it has none */
};

static CompiledModule *new_module(uint32_t n) {
    CompiledModule *m = calloc(1, sizeof *m);
    if (!m) return NULL;
    m->n = n;
    m->names = calloc(n + 1, sizeof *m->names);
    m->widths = calloc(n + 1, sizeof *m->widths);
    m->instructions = calloc(n + 1, sizeof *m->instructions);
    m->kernels = calloc(n + 1, sizeof(SltKernel *));
    if (!m->names || !m->widths || !m->instructions || !m->kernels) {
        back_free(m);
        return NULL;
    }
    return m;
}

static CompiledModule *module_of(const KernelRequest *k, uint32_t n, const BackOptions *o) {
    CompiledModule *m = new_module(n);
    for (uint32_t j = 0; j < n && m; j++) strcpy(m->names[j], k[j].name), m->widths[j] = back_choose_width(k, j, o);
    return m;
}

/* The payload of a cache entry: one instruction count a kernel, how many objects there are, padding to 8 bytes, their
 * sizes as 8 bytes each, the objects, each from a multiple of 8 bytes on. */
static size_t round_up(size_t size) { return (size + 7) & ~(size_t)7; }
static size_t sizes_offset(uint32_t n) { return round_up(((size_t)n + 1) * 4); }

static bool load_objects(CompiledModule *m, const unsigned char *payload, size_t size, const char **why) {
    uint32_t count;
    size_t at = sizes_offset(m->n);
    *why = "entry too short";
    if (size < at) return false;
    memcpy(&count, payload + (size_t)m->n * 4, sizeof count);
    if (count > (size - at) / 8 || !(m->code = calloc((size_t)count + 1, sizeof(Loaded *)))) return false;
    at += (size_t)count * 8;
    for (; m->nobjects < count; m->nobjects++) {
        uint64_t bytes;
        memcpy(&bytes, payload + sizes_offset(m->n) + (size_t)m->nobjects * 8, sizeof bytes);
        if (bytes > size - at) return false;
        m->code[m->nobjects] = load_object(payload + at, bytes, why);
        if (!m->code[m->nobjects]) return false;
        at += bytes;
        *why = "entry too short";
        if (m->nobjects + 1 < count && size < (at = round_up(at))) return false;
    }
    return true;
}

static void *find_symbol(const CompiledModule *m, const char *name, uint64_t *size) {
    void *f = NULL;
    for (uint32_t o = 0; o < m->nobjects && !f; o++) f = load_symbol(m->code[o], name, size);
    return f;
}

static void forget_objects(CompiledModule *m) {
    for (uint32_t o = 0; o < m->nobjects; o++) load_free(m->code[o]);
    free(m->code);
    m->code = NULL, m->nobjects = 0;
}

static bool adopt(CompiledModule *m, const unsigned char *payload, size_t size, const char **why) {
    bool ok = load_objects(m, payload, size, why);
    for (uint32_t j = 0; j < m->n && ok; j++) {
        void *f = find_symbol(m, m->names[j], NULL);
        if (!f) *why = "kernel missing in the object";
        memcpy(&m->kernels[j], &f, sizeof f);
        ok = f != NULL;
    }
    if (ok) memcpy(m->instructions, payload, m->n * sizeof(uint32_t));
    else forget_objects(m);
    return ok;
}

static unsigned char *make_payload(const Codegen *g, uint32_t n, size_t *size) {
    size_t at = sizes_offset(n) + (size_t)g->n * 8;
    *size = at;
    for (uint32_t o = 0; o < g->n; o++) *size += round_up(g->object[o].size);
    unsigned char *p = calloc(1, *size);
    if (!p) return NULL;
    memcpy(p, g->instructions, n * sizeof(uint32_t));
    memcpy(p + (size_t)n * 4, &g->n, sizeof g->n);
    for (uint32_t o = 0; o < g->n; o++) {
        uint64_t bytes = g->object[o].size;
        memcpy(p + sizes_offset(n) + (size_t)o * 8, &bytes, sizeof bytes);
        memcpy(p + at, g->object[o].bytes, bytes);
        at += round_up(bytes);
    }
    return p;
}

static int check_request(Session *s, const KernelRequest *k, uint32_t n, uint32_t width, const char **why) {
    for (uint32_t j = 0; j < n; j++)
        if (strlen(k[j].name) >= 64) {
            *why = arena_printf(&s->session, "kernel name %s is too long", k[j].name);
            return SLT_USAGE;
        }
    return back_check_width(s, width, why);
}

/* A module on its way. */
typedef struct Making {
    BackJob *job;
    CompiledModule *m;
    const char *folder; /* of the cache; NULL: not kept */
    CacheKey key;
} Making;

static void look_up(Session *s, Making *k) {
    const BackJob *j = k->job;
    const char *bad = NULL;
    size_t size = 0;
    k->folder = j->o.no_cache ? NULL : cache_folder(&s->scratch, j->o.cache_dir);
    if (k->folder && !cache_key(s, j->k, j->n, &j->o, "llvm " LLVM_VERSION_STRING, &k->key)) k->folder = NULL;
    if (!k->folder) return;
    unsigned char *payload = cache_read(&s->scratch, k->folder, CACHE_OBJECTS, &k->key, &size);
    k->m->cached = payload && adopt(k->m, payload, size, &bad);
    if (k->m->cached) k->m->key = k->key;
    free(payload);
}

static int load(Session *s, Making *k, Codegen *g, const char **why) {
    const char *bad = NULL;
    size_t size = 0;
    k->m->emit_ms = g->emit_ms;
    k->m->llvm_ms = g->llvm_ms;
    errno = 0;
    unsigned char *payload = make_payload(g, k->job->n, &size);
    if (!payload || !adopt(k->m, payload, size, &bad)) {
        bool no_memory = !payload || errno == ENOMEM, refused = errno == EACCES || errno == EPERM;
        free(payload);
        *why = arena_printf(&s->session, "cannot load the compiled kernels: %s", no_memory ? "out of memory" : bad);
        return no_memory || refused ? SLT_LIMIT : SLT_INTERNAL;
    }
    /* A cache that cannot be written costs time only. */
    if (k->folder && cache_write(&s->scratch, k->folder, CACHE_OBJECTS, &k->key, payload, size)) k->m->key = k->key;
    free(payload);
    return SLT_OK;
}

static int compile(Session *s, Making *makings, uint32_t n, const char **why) {
    Making *lacks[BACK_MAX_JOBS];
    CodegenJob job[BACK_MAX_JOBS];
    uint32_t count = 0;
    for (uint32_t i = 0; i < n; i++) {
        look_up(s, &makings[i]);
        if (makings[i].m->cached) continue;
        lacks[count] = &makings[i];
        job[count++] = (CodegenJob){.k = makings[i].job->k, .n = makings[i].job->n, .o = &makings[i].job->o};
    }
    if (!count) return SLT_OK;
    int status = back_codegen(s, job, count, 'o', false, why);
    if (status) return status;
    for (uint32_t i = 0; i < count; i++) {
        if (!status) status = load(s, lacks[i], &job[i].out, why);
        back_codegen_free(&job[i].out);
    }
    return status;
}

int back_compile_all(Session *s, BackJob *jobs, uint32_t n, const char **why) {
    Making makings[BACK_MAX_JOBS] = {0};
    int status = SLT_OK;
    for (uint32_t i = 0; i < n; i++) jobs[i].out = NULL;
    for (uint32_t i = 0; i < n && !status; i++) {
        status = check_request(s, jobs[i].k, jobs[i].n, jobs[i].o.width, why);
        if (status) break;
        makings[i] = (Making){.job = &jobs[i], .m = module_of(jobs[i].k, jobs[i].n, &jobs[i].o)};
        if (!makings[i].m) status = SLT_LIMIT, *why = "out of memory";
    }
    ArenaMark mark = arena_mark(&s->scratch);
    if (!status) status = compile(s, makings, n, why);
    arena_reset(&s->scratch, mark);
    for (uint32_t i = 0; i < n; i++)
        if (status) back_free(makings[i].m);
        else jobs[i].out = makings[i].m;
    return status;
}

int back_compile(Session *s, const KernelRequest *k, uint32_t n, const BackOptions *o, CompiledModule **out,
                 const char **why) {
    BackJob job = {.k = k, .n = n, .o = *o};
    int status = back_compile_all(s, &job, 1, why);
    *out = job.out;
    return status;
}

static unsigned char *find_entry(Session *s, const BackOptions *o, CacheKind kind, const CacheKey *key, size_t *size) {
    ArenaMark mark = arena_mark(&s->scratch);
    const char *folder = o->no_cache ? NULL : cache_folder(&s->scratch, o->cache_dir);
    unsigned char *bytes = folder ? cache_read(&s->scratch, folder, kind, key, size) : NULL;
    arena_reset(&s->scratch, mark);
    return bytes;
}

unsigned char *back_recall(Session *s, const BackOptions *o, const CacheKey *key, size_t *size) {
    return find_entry(s, o, CACHE_FACTS, key, size);
}

void back_keep(Session *s, const BackOptions *o, const CacheKey *key, const void *bytes, size_t size) {
    ArenaMark mark = arena_mark(&s->scratch);
    const char *folder = o->no_cache ? NULL : cache_folder(&s->scratch, o->cache_dir);
    if (folder) (void)cache_write(&s->scratch, folder, CACHE_FACTS, key, bytes, size);
    arena_reset(&s->scratch, mark);
}

CacheKey back_key(const CompiledModule *m) { return m->key; }

CompiledModule *back_find(Session *s, const BackOptions *o, const CacheKey *key, uint32_t n, const char *const *names,
                          const uint32_t *lanes) {
    size_t size = 0;
    const char *bad = NULL;
    unsigned char *payload = find_entry(s, o, CACHE_OBJECTS, key, &size);
    CompiledModule *m = payload ? new_module(n) : NULL;
    for (uint32_t j = 0; j < n && m; j++)
        snprintf(m->names[j], sizeof *m->names, "%s", names[j]), m->widths[j] = lanes[j];
    if (m && adopt(m, payload, size, &bad)) m->cached = true, m->key = *key;
    else back_free(m), m = NULL;
    free(payload);
    return m;
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

uint32_t back_width(const CompiledModule *m, const char *name) {
    int j = find(m, name);
    return j < 0 ? 0 : m->widths[j];
}

uint32_t back_instructions(const CompiledModule *m, const char *name) {
    int j = find(m, name);
    return j < 0 ? 0 : m->instructions[j];
}

uint32_t back_machine_bytes(const CompiledModule *m, const char *name) {
    uint64_t size = 0, sum = 0;
    if (find_symbol(m, name, &size)) sum = size;
    for (uint32_t part = 0;; part++) {
        char text[96];
        snprintf(text, sizeof text, "%s.part%u", name, part);
        if (!find_symbol(m, text, &size)) return (uint32_t)sum;
        sum += size;
    }
}

void back_times(const CompiledModule *m, double *emit_ms, double *llvm_ms, bool *cached) {
    *emit_ms = m->emit_ms;
    *llvm_ms = m->llvm_ms;
    *cached = m->cached;
}

void back_free(CompiledModule *m) {
    if (!m) return;
    forget_objects(m);
    free(m->names);
    free(m->widths);
    free(m->instructions);
    free(m->kernels);
    free(m);
}
