/* An object into a shared library, by the system's compiler driver. The linker knows files only: what it reads and
 * writes lies in a folder of its own. */
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "cli/cli.h"

/* No shell sees the names. */
static SltStatus run_driver(const char *object, const char *to, SltError *err) {
    const char *cc = getenv("CC");
    char driver[256];
    snprintf(driver, sizeof driver, "%s", cc && *cc && !strchr(cc, ' ') ? cc : "cc");
    pid_t pid = fork();
    if (pid < 0) return status_fail_errno(err, SLT_OUTPUT, errno, "cannot start `%s` to link", driver);
    if (pid == 0) {
        char *argv[] = {driver, (char *)"-shared", (char *)"-o", (char *)to, (char *)object, (char *)"-lm", NULL};
        execvp(driver, argv);
        _exit(127);
    }
    int status = 0;
    while (waitpid(pid, &status, 0) < 0)
        if (errno != EINTR) return status_fail_errno(err, SLT_OUTPUT, errno, "cannot wait for `%s`", driver);
    if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return SLT_OK;
    return status_fail(err, SLT_OUTPUT, "cannot link: the system's C compiler (%s) failed or is missing", driver);
}

SltStatus cli_link(unsigned char **bytes, size_t *size, SltError *err) {
    char folder[4000], object[4096], library[4096];
    SltStatus made = cli_temporary_folder(folder, sizeof folder, err);
    if (made != SLT_OK) return made;
    snprintf(object, sizeof object, "%s/k.o", folder);
    snprintf(library, sizeof library, "%s/k.so", folder);
    unsigned char *linked = NULL;
    SltStatus status = file_write_atomic(object, *bytes, *size, err);
    if (status == SLT_OK) status = run_driver(object, library, err);
    if (status == SLT_OK) status = file_read_all(library, &file_binary, &linked, size, err);
    unlink(object);
    unlink(library);
    rmdir(folder);
    free(*bytes);
    *bytes = linked;
    return status == SLT_INPUT ? (err->status = SLT_OUTPUT) : status;
}
