/* How much is done where nobody said: as much as fits into a quarter of a minute. */
#include "bindings/c/api.h"
#include "cli/cli.h"

#include <string.h>

/* More operations than these in what finds boundaries compile for longer than anybody waits unasked: 25 000 take 15 s
 * with everything else. */
enum { SITE_SIZE = 30000 };

static const char *const searching = "searching it would take long";

static bool says_how_much(const Cli *c) {
    const SltJob *j = &c->job;
    return c->samples_given || c->estimator_given || c->max_seconds > 0 || j->segments || j->error > 0 ||
           j->abs_error > 0 || j->max_evaluations || j->no_boundary || j->gauss;
}

static void tell_left_out(const Cli *c, const char *why) {
    if (c->quiet) return;
    cli_say(CLI_WARNING, "left_out", NULL,
            "the boundary is left out, because %s: this is the interior part of the derivative. %s", why,
            why == searching ? "--samples N searches all the same, as long as it takes"
                             : "[NoDisc] before a statement or a function leaves its sites out");
    watch_tell_costs();
}

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
    if (says_how_much(c)) return slt_grad_integral(p, j, out, stats, err);
    SltStatus s = SLT_INTERRUPTED;
    SltError large = {0};
    p->most_site_size = SITE_SIZE;
    uint64_t all = j->samples;
    const SltStats none = *stats;
    for (size_t i = 0; i < sizeof tries / sizeof *tries; i++) {
        j->samples = all / tries[i].share, *stats = none;
        /* Compiling cannot be cut short, and is no reason to do less. */
        s = compile_kernels(c, p, out, &large);
        if (s == SLT_LIMIT) break;
        if (s != SLT_OK) {
            *err = large;
            return s;
        }
        watch_effort(tries[i].seconds);
        s = slt_grad_integral(p, j, out, stats, err);
        bool spent = s == SLT_INTERRUPTED && watch_spent();
        watch_effort(0);
        if (spent) continue;
        if (s == SLT_OK && i && !c->quiet)
            cli_say(CLI_WARNING, "fewer", NULL,
                    "%llu samples and lines instead of %llu, which would take long: --samples %llu for all of them",
                    (unsigned long long)j->samples, (unsigned long long)all, (unsigned long long)all);
        return s;
    }
    j->samples = all, j->no_boundary = true, *stats = none;
    s = slt_grad_integral(p, j, out, stats, err);
    if (s != SLT_OK) return s;
    *without = true;
    if (s == SLT_OK) tell_left_out(c, large.status == SLT_LIMIT ? large.text : searching);
    return s;
}

/* Images of derivatives have no fewer lines to try. */
SltStatus effort_images(Cli *c, SltProgram *p, uint32_t n, const double *const *dir, float *const *out,
                        float *crossings, SltStats *stats, SltError *err) {
    static const double seconds = 20;
    SltJob *j = &c->job;
    if (says_how_much(c) || c->spp_given) return slt_grad_images(p, j, n, dir, out, crossings, stats, err);
    const SltStats none = *stats;
    p->most_site_size = SITE_SIZE;
    watch_effort(seconds);
    SltStatus s = slt_grad_images(p, j, n, dir, out, crossings, stats, err);
    bool spent = s == SLT_INTERRUPTED && watch_spent();
    watch_effort(0);
    if (!spent && s != SLT_LIMIT) return s;
    SltError large = *err;
    j->no_boundary = true, *stats = none, *err = (SltError){0};
    memset(crossings, 0, sizeof *crossings * j->size[0] * j->size[1] * j->size[2]);
    s = slt_grad_images(p, j, n, dir, out, crossings, stats, err);
    if (s == SLT_OK) tell_left_out(c, spent ? searching : large.text);
    return s;
}
