/* Any bytes as a program, GLSL where the first is `#`: front end, passes and every kernel's IR, verified; then a few
 * samples in the interpreter when the program is small. The back end is left out: tests/back compares it with the
 * interpreter, and LLVM would take most of the time. */
#include <stdlib.h>
#include <string.h>

#include "bindings/c/api.h"
#include "compiler/pass/walk.h"
#include "tests/fuzz/fuzz.h"

/* IR operations times loop trips, roughly: above this the interpreter is not asked. An engine wants many small
 * programs.
 */
#ifdef FUZZ_ENGINE
enum { MAX_WORK = 4000 };
#else
enum { MAX_WORK = 200000 };
#endif

static double work(const Block *b) {
    double sum = 0;
    for (const Inst *i = b->first; i; i = i->next) {
        double inner = 1;
        for (uint32_t r = 0; r < i->nregions; r++) inner += work(i->region[r]);
        sum += i->op == OP_loop ? inner * (1 + i->imm.loop.max_iters) : inner;
    }
    return sum;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (size > 1 << 16) return 0;
    char *text = malloc(size + 1);
    if (!text) return 0;
    memcpy(text, data, size);
    text[size] = 0;
    SltOptions opt = SLT_OPTIONS_INIT;
    opt.interpret = opt.verify = true;
    opt.f64 = size & 1;
    opt.disc_auto = size & 2;
    /* Nothing of the language begins with `#`. */
    opt.language = size && data[0] == '#' ? SLT_LANGUAGE_GLSL : SLT_LANGUAGE_SALTUS;
    SltProgram *p = NULL;
    SltStatus status = slt_compile_string(text, "fuzz.salt", &opt, &p);
    free(text);
    if (status == SLT_INTERNAL) abort();
    if (status == SLT_OK) {
        bool needs[K_KINDS];
        for (int k = 0; k < K_KINDS; k++) needs[k] = true;
        SltError err = {0};
        status = api_kernels(p, needs, &err);
        if (status == SLT_INTERNAL) abort();
        double all = 0;
        for (int k = 0; k < K_KINDS && status == SLT_OK; k++)
            if (p->fn[k]) all += work(p->fn[k]->body);
        if (status == SLT_OK && all < MAX_WORK) {
            SltJob job = SLT_JOB_INIT;
            job.integral = true, job.threads = 1, job.samples = 64;
            job.size[0] = job.size[1] = job.size[2] = 1;
            double value[4], *gradient = calloc((size_t)slt_channels(p) * slt_float_count(p) + 1, sizeof *gradient);
            SltIntegral out = {.struct_size = sizeof out, .value = value, .gradient = gradient};
            SltStats stats = SLT_STATS_INIT;
            if (gradient && slt_grad_integral(p, &job, &out, &stats, &err) == SLT_INTERNAL) abort();
            free(gradient);
        }
    }
    if (p) slt_diagnostics_text(p), slt_diagnostics_json(p);
    slt_program_free(p);
    return 0;
}
