/* The command: parses the line and runs its verb. */
#include <stdlib.h>
#include <malloc.h>
#include <signal.h>
#include <unistd.h>

#include "cli/cli.h"
#include "compiler/back/back.h"

/* Nothing of ours aborts, but C++ behind LLVM does. */
static void on_abort(int sig) {
    static const char memory[] = "saltus: out of memory while LLVM was loaded\n", fault[] = "saltus: internal fault\n";
    bool opens = back_opens_llvm();
    (void)sig;
    ssize_t ignored = opens ? write(2, memory, sizeof memory - 1) : write(2, fault, sizeof fault - 1);
    (void)ignored;
    _exit(opens ? SLT_LIMIT : SLT_INTERNAL);
}

/* Workers come and go several times a call. What they free stays ours: pages that go back to the system come as new
 * ones, mapped and zeroed again. */
static void keep_memory(void) {
#if defined(__GLIBC__)
    mallopt(M_MMAP_THRESHOLD, 32 << 20); /* the most that it takes */
    mallopt(M_TRIM_THRESHOLD, 1 << 30);
    mallopt(M_TOP_PAD, CLI_HEAP);
#endif
}

int main(int argc, char **argv) {
    keep_memory();
    signal(SIGPIPE, SIG_IGN); /* a closed pipe is a failed write, reported as such */
    signal(SIGABRT, on_abort);
    signal(SIGXFSZ, SIG_IGN);    /* and so is a file beyond the system's limit */
    static char output[1 << 16]; /* nothing to be out of memory for */
    setvbuf(stdout, output, isatty(1) ? _IOLBF : _IOFBF, sizeof output);
    static Cli c;
    int status = cli_parse(argc, argv, &c);
    if (status == SLT_OK) {
        watch_begin(&c);
        Stream stream;
        status = stream_begin(&stream, &c);
        if (status == SLT_OK) status = stream_end(&stream, &c, watch_status((SltStatus)c.verb->run(&c)));
        watch_commit();
    }
    back_open_end();
    for (uint32_t i = 0; i < c.nargs_storage; i++) free(c.args_storage[i]);
    if (status == CLI_HELPED || status == SLT_STOPPED) status = SLT_OK;
    if ((fflush(stdout) != 0 || ferror(stdout)) && status == SLT_OK)
        status = cli_error(SLT_OUTPUT, "standard output could not be written");
    if (!cli_frees_all()) _exit(status); /* what else is done at the end of a process, as by LLVM, is to free memory */
    return status;
}
