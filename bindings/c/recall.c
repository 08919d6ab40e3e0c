/* Facts of kernels in the cache. Their key is of all that passes read: the text of every source, the options, the
 * program's sizes, which come from files, what is differentiated and what is asked for. */
#include "bindings/c/recall.h"

#include <stdlib.h>
#include <string.h>

uint32_t order_module(const KernelOrder *q, const OrderFacts *f, uint32_t m, const char *names[K_KINDS + SLT_MAX_CULL],
                      uint32_t lanes[K_KINDS + SLT_MAX_CULL]) {
    uint32_t n = 0;
    for (int k = 0; k < K_KINDS; k++)
        if (f->kernel[k].made && !q->late[k] && q->soon[k] == (m == 1))
            names[n] = kernel_names[k], lanes[n++] = f->kernel[k].lanes;
    for (uint32_t c = 0; q->cull && m == 0 && c < q->p->prog->ncull; c++)
        names[n] = arena_printf(&q->p->session->module, "cull%u", c), lanes[n++] = f->cull_lanes[c];
    return n;
}

/* ---- bytes. One function for each thing, which writes it or reads it. */
typedef struct Archive {
    Arena *arena;
    unsigned char *bytes;
    size_t at, size; /* of size bytes; of those that are written, the room */
    bool writes, bad;
} Archive;

static void exchange(Archive *a, void *value, size_t n) {
    if (a->writes && n > a->size - a->at) {
        const size_t size = 2 * (a->size + n) + 4096;
        unsigned char *more = arena_alloc(a->arena, size);
        if (a->at) memcpy(more, a->bytes, a->at);
        a->bytes = more, a->size = size;
    }
    a->bad |= n > a->size - a->at;
    if (a->bad || !n) return;
    if (a->writes) memcpy(a->bytes + a->at, value, n);
    else memcpy(value, a->bytes + a->at, n);
    a->at += n;
}

#define EXCHANGE(a, x) exchange((a), &(x), sizeof(x))

/* An array of n, which reading makes. */
static void *exchange_array(Archive *a, void *array, size_t n, size_t each) {
    if (!a->writes) {
        a->bad |= n > (a->size - a->at) / each;
        array = a->bad ? NULL : arena_alloc(a->arena, n * each + 1);
    }
    exchange(a, array, n * each);
    return array;
}

static void exchange_kernel(Archive *a, KernelFacts *k, uint32_t ngeometries) {
    EXCHANGE(a, k->made);
    if (!k->made) return;
    EXCHANGE(a, k->few), EXCHANGE(a, k->plain), EXCHANGE(a, k->tape_grows);
    EXCHANGE(a, k->lanes), EXCHANGE(a, k->tape_bytes), EXCHANGE(a, k->layout);
    k->queries = exchange_array(a, k->queries, ngeometries, sizeof *k->queries);
}

static void exchange_edge(Archive *a, EdgeFacts *e) {
    EXCHANGE(a, e->line), EXCHANGE(a, e->kind), EXCHANGE(a, e->bends), EXCHANGE(a, e->upsets), EXCHANGE(a, e->argmin);
}

static void exchange_facts(Archive *a, const KernelOrder *q, OrderFacts *f) {
    const Program *prog = q->p->prog;
    bool edges = f->edge != NULL, dense = f->dense != NULL;
    for (int k = 0; k < K_KINDS; k++)
        if (q->needs[k]) exchange_kernel(a, &f->kernel[k], prog->ngeometries);
    if (q->cull) {
        exchange_kernel(a, &f->cull, prog->ngeometries);
        f->cull_lanes = exchange_array(a, f->cull_lanes, prog->ncull, sizeof *f->cull_lanes);
    }
    for (uint32_t m = 0; m < ORDER_MODULES; m++)
        EXCHANGE(a, f->module[m].hi), EXCHANGE(a, f->module[m].lo), EXCHANGE(a, f->module[m].len);
    EXCHANGE(a, f->hides), EXCHANGE(a, f->site_logs), EXCHANGE(a, f->rigid), EXCHANGE(a, f->bare);
    EXCHANGE(a, f->noted), EXCHANGE(a, edges), EXCHANGE(a, dense);
    if (dense) f->dense = exchange_array(a, f->dense, prog->nfloats, 1);
    if (!edges || a->bad) return;
    EXCHANGE(a, f->flat), EXCHANGE(a, f->told), EXCHANGE(a, f->chunked), EXCHANGE(a, f->nedges);
    if (!a->writes) a->bad |= f->nedges > a->size - a->at;
    if (!a->writes && !a->bad) f->edge = ARENA_ARRAY(a->arena, EdgeFacts, f->nedges + 1);
    for (uint32_t e = 0; e < f->nedges && !a->bad; e++) exchange_edge(a, &f->edge[e]);
}

/* ---- the key */
static void add_text(Archive *a, const char *text) {
    exchange(a, (void *)(text ? text : ""), text ? strlen(text) + 1 : 1);
}

static void add_options(Archive *a, const SltProgram *p) {
    SltOptions o = p->opt;
    const uint8_t flags[] = {o.f64,
                             o.disc_auto,
                             o.rgba8,
                             o.paper_argmin,
                             o.paper_forced,
                             o.path_hash,
                             o.near_miss < 0 ? 2 : o.near_miss > 0};
    const uint32_t numbers[] = {o.seed,
                                o.width,
                                o.size[0],
                                o.size[1],
                                (uint32_t)o.language,
                                p->target.vector_bytes,
                                p->target.has_fma,
                                p->target.slow_divider,
                                p->most_site_size,
                                api_adjoint_lanes(p)};
    exchange(a, (void *)flags, sizeof flags), exchange(a, (void *)numbers, sizeof numbers);
    add_text(a, p->target.cpu), add_text(a, p->target.features), add_text(a, o.entry);
    for (uint32_t i = 0; i < o.nset; i++) add_text(a, o.set[i].name), add_text(a, o.set[i].value);
}

static void add_program(Archive *a, const SltProgram *p) {
    const Program *g = p->prog;
    for (uint32_t i = 0; i < p->session->nsources; i++) {
        const Source *s = &p->session->sources[i];
        uint32_t facts[] = {s->len, s->lead, s->shown_end, s->glsl[0], s->glsl[1]};
        EXCHANGE(a, facts), exchange(a, (void *)s->text, s->len);
    }
    for (uint32_t i = 0; i < g->nparams; i++) {
        const Param *q = &g->params[i];
        uint32_t facts[] = {q->fbase,        q->fcount, q->ibase, q->icount, q->tbase, q->tcount,
                            q->vertex_parts, q->rings,  q->tex_w, q->tex_h,  q->tex_d, q->tex_c};
        EXCHANGE(a, facts);
    }
    for (uint32_t i = 0; i < g->ngeometries; i++) {
        const GeometryInfo *q = &g->geometries[i];
        uint32_t facts[] = {(uint32_t)q->kind, q->base, q->count, q->size[0], q->size[1], q->nfaces, q->tbase};
        EXCHANGE(a, facts);
    }
}

CacheKey recall_key(const KernelOrder *q) {
    SltProgram *p = q->p;
    const SltOptions *o = &p->opt;
    CacheKey key = {0};
    const bool shown = o->dump || o->stop_after || o->verify || o->verify_after;
    if (!q->by_facts || o->no_cache || o->interpret || o->rgba8 || shown) return key; /* what pixels share, IR tells */
    Arena *scratch = &p->session->scratch;
    ArenaMark mark = arena_mark(scratch);
    Archive a = {.arena = scratch, .writes = true};
    const char version[] = "facts 2";
    exchange(&a, (void *)version, sizeof version);
    exchange(&a, (void *)q->needs, sizeof q->needs), exchange(&a, (void *)q->late, sizeof q->late);
    exchange(&a, (void *)q->soon, sizeof q->soon);
    const bool asks[] = {q->cull, q->cells, q->of_images, p->few_samples, p->guarded};
    exchange(&a, (void *)asks, sizeof asks);
    add_options(&a, p), add_program(&a, p);
    exchange(&a, p->wrt, p->prog->nfloats);
    if (!back_facts_key(a.bytes, a.at, p->prog->primal, &key)) key.len = 0;
    arena_reset(scratch, mark);
    return key;
}

/* ---- looking up */
static bool find_modules(const KernelOrder *q, const BackOptions *o, OrderFacts *f,
                         CompiledModule *module[ORDER_MODULES]) {
    const char *names[K_KINDS + SLT_MAX_CULL];
    uint32_t lanes[K_KINDS + SLT_MAX_CULL];
    bool all = true;
    for (uint32_t m = 0; m < ORDER_MODULES; m++) {
        const uint32_t n = order_module(q, f, m, names, lanes);
        module[m] = n && all ? back_find(q->p->session, o, &f->module[m], n, names, lanes) : NULL;
        all &= module[m] || !n;
    }
    for (uint32_t m = 0; m < ORDER_MODULES && !all; m++) back_free(module[m]), module[m] = NULL;
    return all;
}

bool recall(const KernelOrder *q, const CacheKey *key, OrderFacts *f, CompiledModule *module[ORDER_MODULES]) {
    Session *s = q->p->session;
    const BackOptions o = {0};
    Archive a = {.arena = &s->module};
    *f = (OrderFacts){0};
    if (!key->len || !(a.bytes = back_recall(s, &o, key, &a.size))) return false;
    exchange_facts(&a, q, f);
    free(a.bytes);
    return !a.bad && a.at == a.size && find_modules(q, &o, f, module);
}

void recall_keep(const KernelOrder *q, const CacheKey *key, OrderFacts *f) {
    Session *s = q->p->session;
    const BackOptions o = {0};
    ArenaMark mark = arena_mark(&s->scratch);
    Archive a = {.arena = &s->scratch, .writes = true};
    exchange_facts(&a, q, f);
    back_keep(s, &o, key, a.bytes, a.at);
    arena_reset(&s->scratch, mark);
}
