/* The command: parses the line and runs its verb. */
#include <stdlib.h>
#include <signal.h>

#include "cli/cli.h"

int main(int argc, char **argv) {
    signal(SIGPIPE, SIG_IGN); /* a closed pipe is a failed write, reported as such */
    static Cli c;
    int status = cli_parse(argc, argv, &c);
    if (status == SLT_OK) {
        cli_watch_time(&c);
        status = c.verb->run(&c);
    }
    for (uint32_t i = 0; i < c.nargs_storage; i++) free(c.args_storage[i]);
    if (status == CLI_HELPED || status == SLT_STOPPED) status = SLT_OK;
    if ((fflush(stdout) != 0 || ferror(stdout)) && status == SLT_OK) {
        fputs("saltus: standard output could not be written\n", stderr);
        status = SLT_OUTPUT;
    }
    return status;
}
