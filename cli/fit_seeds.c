/* fit --seeds: the same fit by several seeds, and what their losses are. */
#include <stdlib.h>
#include <string.h>

#include "cli/fit.h"

static int by_value(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void report(const Cli *c, const double *losses, double seconds) {
    uint32_t n = c->last_seed - c->first_seed + 1;
    double *sorted = cli_need(malloc(n * sizeof *sorted));
    memcpy(sorted, losses, n * sizeof *sorted);
    qsort(sorted, n, sizeof *sorted, by_value);
    double median = (sorted[(n - 1) / 2] + sorted[n / 2]) / 2;
    if (c->json) {
        printf("{\"seeds\": [%u, %u], \"losses\": [", c->first_seed, c->last_seed);
        for (uint32_t k = 0; k < n; k++) fputs(k ? ", " : "", stdout), json_number(stdout, losses[k]);
        const char *const names[] = {"median", "least", "most", "seconds"};
        const double values[] = {median, sorted[0], sorted[n - 1], seconds};
        for (int k = 0; k < 4; k++) printf("%s\"%s\": ", k ? ", " : "], ", names[k]), json_number(stdout, values[k]);
        fputs("}\n", stdout);
    } else {
        printf("loss %.6g, the median of %u seeds; from %.6g to %.6g, %.1f s\n", median, n, sorted[0], sorted[n - 1],
               seconds);
    }
    free(sorted);
}

int fit_seeds(Cli *c, int (*once)(Cli *c, double *loss)) {
    uint32_t n = c->last_seed - c->first_seed + 1;
    if (c->file && !strcmp(c->file, "-"))
        return cli_usage(c, "--seeds reads its program more than once: a file is wanted");
    if (c->checkpoint || c->resume) return cli_usage(c, "--seeds makes several fits, and a checkpoint is of one");
    Cli *given = cli_need(malloc(sizeof *given));
    double *losses = cli_need(calloc(n, sizeof *losses)), start = cli_now();
    int status = SLT_OK;
    *given = *c;
    for (uint32_t k = 0; k < n && status == SLT_OK; k++) {
        *c = *given; /* a scene has written into it */
        c->opt.set = c->sets, c->opt.param_files = c->param_files;
        c->job.seed = c->opt.seed = c->first_seed + k;
        c->quiet |= k > 0; /* what is to be said of the program has been said */
        status = once(c, &losses[k]);
        if (status == SLT_OK && !given->json && !given->quiet)
            fprintf(stderr, "saltus: seed %u: loss %.6g\n", c->job.seed, losses[k]);
    }
    watch_commit();
    if (status == SLT_OK) report(given, losses, cli_now() - start);
    free(losses);
    free(given);
    return status;
}
