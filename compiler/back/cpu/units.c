/* Kernels shared out to LLVM modules, and modules to threads.
 *
 * LLVM compiles what lies in different contexts at the same time. A kernel is the same code in whatever module it lies,
 * and which module that is follows from the kernels alone: so the bytes are the same for any number of threads. IR is
 * emitted on the caller's thread, since that allocates in its session, the longest first; passes and machine code,
 * which take twenty times as long, begin when the first unit is there and need no session but for what guard.c jumps
 * out to: each thread has one of its own.
 *
 * LLVM may give up on one thread and leave something locked that another then waits for, for ever. So the caller's
 * thread only waits for the others, and leaves those behind that do not end once LLVM is broken: with all they use,
 * which is on the heap for that reason. */
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "compiler/back/cpu/emit.h"
#include "saltus/status.h"

enum { JOB_UNITS = 32, MAX_UNITS = BACK_MAX_JOBS * JOB_UNITS, MAX_THREADS = 32 };
/* A module costs about as much as 40 vector instructions, the frame of a kernel half of that, so that smaller kernels
 * share one. */
enum { KERNEL_COST = 30, UNIT_COST = 240 };
/* Large programs have more modules than the largest kernel asks for, up to EVEN of such a size: what costs are guessed
 * wrong by is then less of the whole, and what waits for the last one. */
enum { EVEN = 8, EVEN_COST = 1400 };
/* As much as a main thread usually has: LLVM recurses. */
enum { STACK_BYTES = 8 << 20 };
enum { LEFT_BEHIND_S = 2 }; /* what the others have to end in when LLVM is broken */

typedef struct Team {
    LlvmApi api;
    Target target; /* of all */
    CodeUnit unit[MAX_UNITS];
    uint64_t load[MAX_UNITS]; /* what a unit that waits will take; 0: it is written, or being so */
    Session *own[MAX_UNITS];  /* of the thread that wrote a unit: has its error; NULL: the caller's */
    uint32_t n, running;
    Machines machines;               /* the caller's */
    bool ready[MAX_UNITS], complete; /* emitted; no more will be */
    pthread_mutex_t lock;
    pthread_cond_t more, ended;
} Team;

static double now_ms(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec * 1e3 + (double)t.tv_nsec * 1e-6;
}

/* ---- which kernel goes where */
static uint32_t count_functions(const KernelRequest *k) {
    uint32_t n = 1;
    for (const Fn *fn = k->fn->next_part ? k->fn : NULL; fn; fn = fn->next_part) n++;
    return n;
}

static uint64_t kernel_cost(const KernelRequest *k, uint32_t width, const Target *t) {
    uint64_t insts = 0, lanes = back_register_lanes(t, k->fn->precision);
    for (const Fn *fn = k->fn; fn; fn = fn->next_part) insts += back_count_insts(fn->body);
    return KERNEL_COST + insts * (width > lanes ? width / lanes : 1);
}

typedef struct Shares {
    uint64_t *cost; /* by kernel; then 0 where it has a unit */
    uint32_t *of;   /* by kernel: its unit, of those of the job, which begin with `first` */
    uint32_t *width;
    bool *plain; /* by kernel: at level 0 */
    uint32_t n, units, first;
    uint64_t load[JOB_UNITS];
} Shares;

/* Those of one level: the costly ones first, each to the unit that has least so far. Of a small program more units than
 * it takes to have the largest kernel alone would end no sooner. */
static void share_level(Shares *s, bool plain) {
    uint64_t total = 0, largest = UNIT_COST;
    uint32_t first = s->units, count = 0;
    for (uint32_t j = 0; j < s->n; j++) {
        if (s->plain[j] != plain) continue;
        total += s->cost[j], count++;
        if (s->cost[j] > largest) largest = s->cost[j];
    }
    uint64_t wanted = (total + largest - 1) / largest, even = total / EVEN_COST;
    if (even > EVEN) even = EVEN;
    if (even > wanted) wanted = even < count ? even : count;
    s->units += wanted > JOB_UNITS / 2 ? JOB_UNITS / 2 : (uint32_t)wanted;
    for (; count; count--) {
        uint32_t most = s->n, least = first;
        for (uint32_t j = 0; j < s->n; j++)
            if (s->plain[j] == plain && s->cost[j] && (most == s->n || s->cost[j] > s->cost[most])) most = j;
        for (uint32_t u = first; u < s->units; u++)
            if (s->load[u] < s->load[least]) least = u;
        s->load[least] += s->cost[most], s->of[most] = least, s->cost[most] = 0;
    }
}

static void share_out(Shares *s, const CodegenJob *job, bool whole, Arena *arena) {
    const uint32_t n = job->n;
    const BackOptions *o = job->o;
    *s = (Shares){.cost = ARENA_ARRAY(arena, uint64_t, n + 1),
                  .of = ARENA_ARRAY(arena, uint32_t, n + 1),
                  .width = ARENA_ARRAY(arena, uint32_t, n + 1),
                  .plain = ARENA_ARRAY(arena, bool, n + 1),
                  .n = n};
    for (uint32_t j = 0; j < n; j++) {
        s->width[j] = back_choose_width(job->k, j, o);
        s->cost[j] = kernel_cost(&job->k[j], s->width[j], &o->target);
        s->plain[j] = j < 64 && o->plain >> j & 1 && o->opt_level;
    }
    if (!whole) share_level(s, true), share_level(s, false);
    if (!s->units) s->units = 1; /* all */
}

/* ---- one unit */
typedef struct Writing {
    CodeUnit *unit;
    Machines *machines;
} Writing;

static void write_guarded(Session *s, void *arg) {
    const Writing *w = arg;
    guard_begin(w->unit->ll, s);
    unit_write(s, w->unit, w->machines);
    unit_dispose(w->unit);
}

static void write_unit(Session *s, CodeUnit *u, Machines *machines) {
    if (!s || guard_broken()) {
        u->status = SLT_LIMIT, u->why = "out of memory while LLVM compiled";
        return;
    }
    Writing w = {u, machines};
    int status = session_protect(s, write_guarded, &w);
    guard_end();
    if (status && !u->status) u->status = status, u->why = s->unwind_text;
}

/* ---- all of them */
/* Of those that wait, and are emitted or are not, the one that takes longest: small ones fill up what the threads
 * differ by at the end. */
static CodeUnit *longest(Team *t, bool ready) {
    uint32_t most = t->n;
    for (uint32_t u = 0; u < t->n; u++)
        if (t->load[u] && t->ready[u] == ready && (most == t->n || t->load[u] > t->load[most])) most = u;
    return most < t->n ? &t->unit[most] : NULL;
}

static CodeUnit *next_to_emit(Team *t) {
    pthread_mutex_lock(&t->lock);
    CodeUnit *u = longest(t, false);
    pthread_mutex_unlock(&t->lock);
    return u;
}

static void emit_guarded(Session *s, void *arg) {
    Team *t = arg;
    guard_begin(&t->api, s);
    for (CodeUnit *u; (u = next_to_emit(t));) {
        if (guard_broken()) u->status = SLT_LIMIT, u->why = "out of memory while LLVM compiled";
        else unit_emit(s, u, &t->machines);
        if (u->status) return;
        pthread_mutex_lock(&t->lock);
        t->ready[u - t->unit] = true;
        pthread_cond_signal(&t->more);
        pthread_mutex_unlock(&t->lock);
    }
}

/* Under the lock. NULL: there will be no more. */
static CodeUnit *next_unit(Team *t) {
    CodeUnit *u;
    while (!(u = longest(t, true)) && !t->complete) pthread_cond_wait(&t->more, &t->lock);
    if (u) t->load[u - t->unit] = 0;
    return u;
}

static void *run(void *arg) {
    Team *t = arg;
    Machines machines = {0};
    pthread_mutex_lock(&t->lock);
    for (CodeUnit *u; (u = next_unit(t));) {
        pthread_mutex_unlock(&t->lock);
        Session *own = t->own[u - t->unit] = session_create(0);
        write_unit(own, u, &machines);
        pthread_mutex_lock(&t->lock);
    }
    pthread_mutex_unlock(&t->lock);
    machines_dispose(&t->api, &machines);
    pthread_mutex_lock(&t->lock);
    t->running--;
    pthread_cond_signal(&t->ended);
    pthread_mutex_unlock(&t->lock);
    return NULL;
}

static uint32_t count_threads(uint32_t wanted, uint32_t units) {
    long cores = wanted ? (long)wanted : sysconf(_SC_NPROCESSORS_ONLN);
    uint32_t n = cores < 1 ? 1 : cores > MAX_THREADS ? MAX_THREADS : (uint32_t)cores;
    return n < units ? n : units;
}

/* False: threads that may never end are left behind, and use the team. */
static bool wait_for_all(Team *t) {
    struct timespec until;
    double broken_at = 0;
    pthread_mutex_lock(&t->lock);
    while (t->running) {
        clock_gettime(CLOCK_REALTIME, &until);
        until.tv_nsec += 50000000;
        if (until.tv_nsec >= 1000000000) until.tv_nsec -= 1000000000, until.tv_sec++;
        pthread_cond_timedwait(&t->ended, &t->lock, &until);
        if (!guard_broken()) continue;
        if (!broken_at) broken_at = now_ms();
        if (now_ms() - broken_at > 1e3 * LEFT_BEHIND_S) break;
    }
    bool all = !t->running;
    pthread_mutex_unlock(&t->lock);
    return all;
}

static uint32_t start_threads(Team *t, uint32_t threads, pthread_t thread[MAX_THREADS]) {
    pthread_attr_t attr;
    uint32_t started = 0;
    if (threads < 2 || pthread_attr_init(&attr)) return 0;
    pthread_attr_setstacksize(&attr, STACK_BYTES);
    pthread_mutex_lock(&t->lock);
    while (started < threads && !pthread_create(&thread[started], &attr, run, t)) started++;
    t->running = started;
    pthread_mutex_unlock(&t->lock);
    pthread_attr_destroy(&attr);
    return started;
}

/* An SltStatus of emission, which goes on beside the threads; *all: false, where some of these are left behind. */
static int emit_and_write(Session *s, Team *t, uint32_t threads, double *emit_ms, bool *all) {
    pthread_t thread[MAX_THREADS];
    const double start = now_ms();
    machines_init(&t->api);
    const uint32_t started = start_threads(t, threads, thread);
    const int status = session_protect(s, emit_guarded, t);
    guard_end();
    *emit_ms = now_ms() - start;
    pthread_mutex_lock(&t->lock);
    const bool emitted = !status && !longest(t, false);
    t->complete = true;
    pthread_cond_broadcast(&t->more);
    for (CodeUnit *u; emitted && !started && (u = next_unit(t));) write_unit(s, u, &t->machines);
    pthread_mutex_unlock(&t->lock);
    *all = wait_for_all(t);
    for (uint32_t i = 0; i < started; i++)
        if (*all) pthread_join(thread[i], NULL);
        else pthread_detach(thread[i]);
    return status;
}

static void free_team(Team *t) {
    for (uint32_t u = 0; u < t->n; u++) {
        unit_dispose(&t->unit[u]); /* what our own limits left */
        unit_free(&t->unit[u]);
        session_destroy(t->own[u]);
    }
    if (t->api.handle) machines_dispose(&t->api, &t->machines);
    pthread_cond_destroy(&t->more);
    pthread_cond_destroy(&t->ended);
    pthread_mutex_destroy(&t->lock);
    free(t);
}

static bool make_units(Team *t, const CodegenJob *job, const Shares *s, char kind, bool whole) {
    bool ok = true;
    for (uint32_t u = 0; u < s->units; u++) {
        CodeUnit *unit = &t->unit[s->first + u];
        uint32_t count = 0, functions = 0;
        for (uint32_t j = 0; j < s->n; j++)
            if (s->of[j] == u) count++, functions += count_functions(&job->k[j]);
        t->load[s->first + u] = s->load[u] ? s->load[u] : 1; /* nobody counts where it is the whole */
        *unit =
            (CodeUnit){.ll = &t->api, .o = job->o, .target = &t->target, .opt_level = job->o->opt_level, .kind = kind};
        if (!unit_init(unit, count, functions)) {
            ok = false;
            continue;
        }
        for (uint32_t j = 0; j < s->n; j++) {
            if (s->of[j] != u) continue;
            if (!whole && s->plain[j]) unit->opt_level = 0;
            unit->width[unit->n] = s->width[j], unit->k[unit->n++] = job->k[j];
        }
    }
    return ok;
}

static int find_error(Session *s, const Team *t, const char **why) {
    for (uint32_t u = 0; u < t->n; u++) {
        const CodeUnit *unit = &t->unit[u];
        if (!unit->status) continue;
        *why = arena_printf(&s->session, "%s", unit->why);
        return unit->status;
    }
    return SLT_OK;
}

static void give(Team *t, const Shares *s, Codegen *out) {
    CodeUnit *unit = &t->unit[s->first];
    uint32_t at[JOB_UNITS] = {0};
    out->n = s->units;
    for (uint32_t j = 0; j < s->n; j++) out->instructions[j] = unit[s->of[j]].instructions[at[s->of[j]]++];
    for (uint32_t u = 0; u < s->units; u++) {
        out->object[u] = (CodeObject){unit[u].bytes, unit[u].size};
        unit[u].bytes = NULL;
    }
}

int back_codegen(Session *s, CodegenJob *jobs, uint32_t njobs, char kind, bool whole, const char **why) {
    Shares shares[BACK_MAX_JOBS];
    uint32_t units = 0;
    for (uint32_t j = 0; j < njobs; j++) {
        jobs[j].out = (Codegen){.object = ARENA_ARRAY(&s->session, CodeObject, JOB_UNITS),
                                .instructions = ARENA_ARRAY(&s->session, uint32_t, jobs[j].n + 1)};
        share_out(&shares[j], &jobs[j], whole, &s->session);
        shares[j].first = units, units += shares[j].units;
    }
    Team *t = calloc(1, sizeof *t);
    if (!t) {
        *why = "out of memory";
        return SLT_LIMIT;
    }
    t->n = units;
    t->target = jobs[0].o->target;
    pthread_mutex_init(&t->lock, NULL);
    pthread_cond_init(&t->more, NULL);
    pthread_cond_init(&t->ended, NULL);
    bool no_memory;
    const char *missing = llvm_open(&t->api, &no_memory);
    int status = missing ? (no_memory ? SLT_LIMIT : SLT_INPUT) : SLT_OK;
    if (missing) *why = arena_printf(&s->session, "cannot load LLVM: %s", missing);
    for (uint32_t j = 0; j < njobs && !missing; j++)
        if (!make_units(t, &jobs[j], &shares[j], kind, whole)) status = SLT_LIMIT, *why = "out of memory";
    const double start = now_ms();
    double emit_ms = 0;
    bool all = true;
    if (!status) {
        status = emit_and_write(s, t, count_threads(jobs[0].o->threads, t->n), &emit_ms, &all);
        if (status) *why = arena_printf(&s->session, "%s", s->unwind_text);
    }
    for (uint32_t j = 0; j < njobs; j++)
        jobs[j].out.emit_ms = emit_ms, jobs[j].out.llvm_ms = now_ms() - start - emit_ms;
    if (!all) {
        *why = "out of memory while LLVM compiled";
        return SLT_LIMIT;
    }
    if (!status) status = find_error(s, t, why);
    for (uint32_t j = 0; j < njobs && !status; j++) give(t, &shares[j], &jobs[j].out);
    free_team(t);
    return status;
}

void back_codegen_free(Codegen *g) {
    for (uint32_t u = 0; u < g->n; u++) free(g->object[u].bytes);
    g->n = 0;
}

int back_emit(Session *s, const KernelRequest *k, uint32_t n, const BackOptions *o, char kind, unsigned char **bytes,
              size_t *size, const char **why) {
    *bytes = NULL, *size = 0;
    int status = back_check_width(s, o->width, why);
    if (status) return status;
    CodegenJob job = {.k = k, .n = n, .o = o};
    status = back_codegen(s, &job, 1, kind, true, why);
    if (status) return status;
    *bytes = job.out.object[0].bytes, *size = job.out.object[0].size;
    return SLT_OK;
}
