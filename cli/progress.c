/* Progress on a terminal: a bar, the share done and the time left, at most ten times a second. */
#include <string.h>
#include <unistd.h>

#include "cli/cli.h"

void progress_begin(Progress *pr, const Cli *c, const char *what) {
    *pr = (Progress){.on = !c->quiet && !c->json && isatty(2), .start = cli_now(), .what = what};
    watch_phase(what, -1, NULL);
}

static void show_time(char *buf, size_t size, double s) {
    if (s < 60) snprintf(buf, size, "%.0f s", s);
    else if (s < 3600) snprintf(buf, size, "%.0f min %02d s", (double)(int)(s / 60), (int)s % 60);
    else snprintf(buf, size, "%.1f h", s / 3600);
}

void progress_update(Progress *pr, double fraction, const char *detail) {
    watch_phase(NULL, fraction, detail);
    if (!pr->on) return;
    double now = cli_now();
    if (now - pr->start < 0.5 || now - pr->last < 0.1) return; /* short work shows nothing */
    pr->last = now;
    if (fraction < 0) fraction = 0;
    if (fraction > 1) fraction = 1;
    char bar[31], left[32] = "?";
    for (int i = 0; i < 30; i++) bar[i] = i < fraction * 30 ? '#' : '.';
    bar[30] = 0;
    if (fraction > 0.001) show_time(left, sizeof left, (now - pr->start) * (1 - fraction) / fraction);
    fprintf(stderr, "\r%s [%s] %3.0f%%  %s left  %s\033[K", pr->what, bar, 100 * fraction, left, detail ? detail : "");
    fflush(stderr);
}

void progress_end(Progress *pr) {
    if (pr->on && pr->last > 0) fputs("\r\033[K", stderr);
    pr->on = false;
    watch_commit();
}

void progress_job(void *user, double fraction) { progress_update(user, fraction, NULL); }
