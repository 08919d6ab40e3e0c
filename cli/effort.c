/* How much is done where nobody said: as much as fits into a quarter of a minute. */
#include "cli/cli.h"

/* Makes the kernels: the call is interrupted before it estimates anything. */
static SltStatus compile_kernels(const Cli *c, SltProgram *p, SltIntegral *out, SltError *err) {
    static const volatile int at_once = 1;
    SltJob job = c->job;
    SltStats ignored = SLT_STATS_INIT;
    job.cancel = &at_once, job.progress = NULL;
    SltStatus s = slt_grad_integral(p, &job, out, &ignored, err);
    return s == SLT_INTERRUPTED ? SLT_OK : s;
}

/* Without a word about effort nobody wants to wait for minutes: what is not there by then is tried with fewer lines,
 * and at last without the boundary. More is done where --samples, an error or a limit say so. */
SltStatus effort_integral(Cli *c, SltProgram *p, SltIntegral *out, SltStats *stats, bool *without, SltError *err) {
    static const struct {
        double seconds;
        uint32_t share; /* of the lines: one in so many */
    } tries[] = {{8, 1}, {4, 64}, {2, 1024}};
    SltJob *j = &c->job;
    bool wanted = c->samples_given || c->estimator_given || c->max_seconds > 0 || j->segments || j->error > 0 ||
                  j->abs_error > 0 || j->max_evaluations || j->no_boundary || j->gauss;
    if (wanted) return slt_grad_integral(p, j, out, stats, err);
    SltStatus s = SLT_INTERRUPTED;
    uint64_t all = j->samples;
    const SltStats none = *stats;
    for (size_t i = 0; i < sizeof tries / sizeof *tries; i++) {
        j->samples = all / tries[i].share, *stats = none;
        /* Compiling cannot be cut short, and is no reason to do less. */
        s = compile_kernels(c, p, out, err);
        if (s != SLT_OK) return s;
        watch_effort(tries[i].seconds);
        s = slt_grad_integral(p, j, out, stats, err);
        bool spent = s == SLT_INTERRUPTED && watch_spent();
        watch_effort(0);
        if (spent) continue;
        if (s == SLT_OK && i && !c->quiet)
            fprintf(stderr,
                    "saltus: warning: %llu samples and lines instead of %llu, which would take long: --samples %llu "
                    "for all of them\n",
                    (unsigned long long)j->samples, (unsigned long long)all, (unsigned long long)all);
        return s;
    }
    j->samples = all, j->no_boundary = true, *stats = none;
    s = slt_grad_integral(p, j, out, stats, err);
    if (s != SLT_OK) return s;
    *without = true;
    if (c->quiet) return s;
    fputs(
        "saltus: warning: the boundary is left out, because searching it would take long: this is the interior part of "
        "the derivative. --samples N searches all the same, as long as it takes\n",
        stderr);
    watch_tell_costs();
    return s;
}
