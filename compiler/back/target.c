/* Targets. A CPU is described by its level of the x86-64 ABI rather than by its name, so the same program gives the
 * same code, and the same cache key, on every machine of a level, and LLVM need not be loaded to ask. */
#include <stdlib.h>
#include <string.h>

#include "compiler/back/emit.h"

static bool host_has(unsigned level) {
    __builtin_cpu_init();
    bool v3 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi") &&
              __builtin_cpu_supports("bmi2");
    if (level == 3) return v3;
    return v3 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
           __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl") &&
           __builtin_cpu_supports("avx512cd");
}

static void set(Target *t, const char *cpu, uint32_t bytes, bool fma) {
    *t = (Target){.vector_bytes = bytes, .has_fma = fma};
    strcpy(t->cpu, cpu);
}

static void set_host(Target *t) {
    if (host_has(4))
        set(t, "x86-64-v4", 64, true);
    else if (host_has(3))
        set(t, "x86-64-v3", 32, true);
    else
        set(t, "x86-64", 16, false);
}

bool target_named(Target *t, const char *name) {
    if (!strcmp(name, "sse2"))
        set(t, "x86-64", 16, false);
    else if (!strcmp(name, "avx2"))
        set(t, "x86-64-v3", 32, true);
    else if (!strcmp(name, "avx512"))
        set(t, "x86-64-v4", 64, true);
    else if (!strcmp(name, "native"))
        set_host(t);
    else
        return false;
    return true;
}

/* The environment may narrow the host, never widen it: kernels of a wider target would not run. */
void target_host(Target *t) {
    set_host(t);
    const char *wanted = getenv("SALTUS_TARGET");
    Target narrow;
    if (wanted && target_named(&narrow, wanted) && narrow.vector_bytes <= t->vector_bytes) *t = narrow;
}

const char *back_llvm_version(void) {
    return LLVM_VERSION_STRING;
}

/* ---- the default width */
typedef struct Pressure {
    uint32_t *last, *def, at; /* by id: position of the last use and of the definition */
    uint32_t ops, calls;
} Pressure;

static void place(Pressure *p, const Block *b) {
    for (uint32_t j = 0; j < b->nparams; j++) p->def[b->params[j]->id] = p->last[b->params[j]->id] = p->at;
    for (const Inst *i = b->first; i; i = i->next) {
        p->def[i->id] = p->last[i->id] = ++p->at;
        uint32_t start = p->at;
        for (uint32_t j = 0; j < i->nargs; j++) p->last[i->args[j]->id] = p->at;
        for (uint32_t r = 0; r < i->nregions; r++) place(p, i->region[r]);
        if (i->op == OP_loop ||
            i->op == OP_revloop) { /* what a loop reads from outside, and what it carries, lives to its end */
            p->at++;
            for (uint32_t j = 0; j < i->region[0]->nparams; j++) p->last[i->region[0]->params[j]->id] = p->at;
            for (uint32_t id = 0; id < i->id; id++)
                if (p->last[id] > start && p->def[id] < start) p->last[id] = p->at;
        }
    }
}

/* The largest number of varying values alive at once; `at` positions. */
static uint32_t peak(const Pressure *p, const uint8_t *varying, uint32_t n, int32_t *delta) {
    memset(delta, 0, (p->at + 2) * sizeof *delta);
    for (uint32_t id = 0; id < n; id++)
        if (varying[id]) {
            delta[p->def[id]]++;
            delta[p->last[id] + 1]--;
        }
    int32_t live = 0, most = 0;
    for (uint32_t k = 0; k <= p->at; k++) {
        live += delta[k];
        most = live > most ? live : most;
    }
    return (uint32_t)most;
}

static void note_varying(const Block *b, uint8_t *varying) {
    for (uint32_t j = 0; j < b->nparams; j++)
        varying[b->params[j]->id] = b->params[j]->flags & BACK_VARYING && b->params[j]->type != TY_BOOL;
    for (const Inst *i = b->first; i; i = i->next) {
        varying[i->id] = (i->flags & BACK_VARYING) && i->type != TY_BOOL && i->type != TY_VOID && i->type != TY_ARRAY;
        for (uint32_t r = 0; r < i->nregions; r++) note_varying(i->region[r], varying);
    }
}

/* Two vectors a value hide the latency of one (1.1x to 1.9x on shaders of few live values); where the values of two do
 * not fit the registers, spills cost more than that. The widest kernel of the set decides, since one width serves all.
 */
uint32_t back_choose_width(const KernelRequest *k, uint32_t n, const Target *t) {
    uint32_t registers = t->vector_bytes >= 64 ? 32 : 16, worst = 0, bytes = 4;
    for (uint32_t j = 0; j < n; j++) {
        Fn *fn = k[j].fn;
        if (fn->precision == PREC_F64) bytes = 8;
        ArenaMark mark = arena_mark(&fn->session->scratch);
        Arena *a = &fn->session->scratch;
        back_analyse_uniform(fn);
        uint32_t count = ir_number(fn);
        if (count > 20000) { /* far beyond the registers, and the analysis of nested loops would be slow */
            worst = UINT32_MAX;
        } else {
            Pressure p = {.last = ARENA_ARRAY(a, uint32_t, count + 1), .def = ARENA_ARRAY(a, uint32_t, count + 1)};
            uint8_t *varying = ARENA_ARRAY(a, uint8_t, count + 1);
            note_varying(fn->body, varying);
            place(&p, fn->body);
            uint32_t most = peak(&p, varying, count, ARENA_ARRAY(a, int32_t, p.at + 2));
            worst = most > worst ? most : worst;
        }
        arena_reset(a, mark);
    }
    uint32_t lanes = t->vector_bytes / bytes;
    return worst != UINT32_MAX && 2 * worst <= registers + registers / 2 ? 2 * lanes : lanes;
}
