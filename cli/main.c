#include <stdlib.h>
#include <string.h>
#include <signal.h>

#include "cli/cli.h"

int main(int argc, char **argv) {
    static const struct {
        const char *name;
        int (*run)(Cli *);
    } verbs[] = {{"render", verb_render}, {"grad", verb_grad},       {"fit", verb_fit},    {"check", verb_check},
                 {"bench", verb_bench},   {"explain", verb_explain}, {"build", verb_build}};
    signal(SIGPIPE, SIG_IGN); /* a closed pipe is a failed write, reported as such */
    static Cli c;
    int status = cli_parse(argc, argv, &c);
    if (status == SLT_OK) cli_watch_time(&c);
    if (status == SLT_OK)
        for (size_t v = 0; v < sizeof verbs / sizeof *verbs; v++)
            if (!strcmp(c.verb, verbs[v].name)) status = verbs[v].run(&c);
    for (uint32_t i = 0; i < c.nargs_storage; i++) free(c.args_storage[i]);
    if (status == -1 || status == SLT_STOPPED) status = SLT_OK;
    if ((fflush(stdout) != 0 || ferror(stdout)) && status == SLT_OK) {
        fputs("saltus: standard output could not be written\n", stderr);
        status = SLT_OUTPUT;
    }
    return status;
}
