/* Kernels ahead of time: object, assembly, LLVM IR, shared library. Files appear whole or not at all. */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "compiler/back/cpu/emit.h"
#include "saltus/status.h"

static bool write_file(int fd, const unsigned char *bytes, size_t size) {
    for (size_t done = 0; done < size;) {
        ssize_t r = write(fd, bytes + done, size - done);
        if (r < 0 && errno != EINTR) return false;
        done += r > 0 ? (size_t)r : 0;
    }
    return true;
}

/* Links `object` into the shared library `to` with the system's compiler driver; no shell sees the names. */
static bool link_shared(const char *object, const char *to) {
    const char *cc = getenv("CC");
    char driver[256];
    snprintf(driver, sizeof driver, "%s", cc && *cc && !strchr(cc, ' ') ? cc : "cc");
    pid_t pid = fork();
    if (pid < 0) return false;
    if (pid == 0) {
        char *argv[] = {driver, (char *)"-shared", (char *)"-o", (char *)to, (char *)object, (char *)"-lm", NULL};
        execvp(driver, argv);
        _exit(127);
    }
    int status = 0;
    while (waitpid(pid, &status, 0) < 0)
        if (errno != EINTR) return false;
    return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

static int write_output(Session *s, const Codegen *g, char kind, const char *path, const char **why) {
    char *temp = arena_printf(&s->scratch, "%s.XXXXXX", path), *linked = NULL;
    int fd = mkostemp(temp, O_CLOEXEC);
    if (fd < 0) {
        *why = arena_printf(&s->session, "cannot write %s: %s", path, strerror(errno));
        return SLT_OUTPUT;
    }
    bool ok = write_file(fd, g->bytes, g->size);
    mode_t mask = umask(0);
    umask(mask);
    ok = !fchmod(fd, 0666 & ~mask) && ok;
    ok = !close(fd) && ok;
    const char *ready = temp;
    if (ok && kind == 'S') {
        linked = arena_printf(&s->scratch, "%s.so", temp);
        if (!link_shared(temp, linked)) {
            unlink(temp);
            unlink(linked);
            *why = arena_printf(&s->session, "cannot link %s: the system's C compiler (cc) failed or is missing", path);
            return SLT_OUTPUT;
        }
        unlink(temp);
        ready = linked;
    }
    ok = ok && !rename(ready, path);
    if (!ok) {
        *why = arena_printf(&s->session, "cannot write %s: %s", path, strerror(errno));
        unlink(ready);
        return SLT_OUTPUT;
    }
    return SLT_OK;
}

int back_emit(Session *s, const KernelRequest *k, uint32_t n, const BackOptions *o, char kind, const char *path,
              const char **why) {
    uint32_t width = o->width ? o->width : back_choose_width(k, n, &o->target);
    int status = back_check_width(s, width, why);
    if (status) return status;
    Codegen g;
    status = back_codegen(s, k, n, o, width, kind == 'S' ? 'o' : kind, &g, why);
    if (status) return status;
    ArenaMark mark = arena_mark(&s->scratch);
    status = write_output(s, &g, kind, path, why);
    arena_reset(&s->scratch, mark);
    free(g.bytes);
    return status;
}
