/* Kernels ahead of time: object, assembly, LLVM IR, shared library, as bytes. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "compiler/back/cpu/emit.h"
#include "saltus/status.h"

static bool write_file(const char *path, const unsigned char *bytes, size_t size) {
    FILE *f = fopen(path, "wbe");
    bool ok = f && fwrite(bytes, 1, size, f) == size;
    return f && !fclose(f) && ok;
}

static bool read_file(const char *path, unsigned char **bytes, size_t *size) {
    FILE *f = fopen(path, "rbe");
    struct stat st;
    *bytes = f && !fstat(fileno(f), &st) ? malloc((size_t)st.st_size + 1) : NULL;
    *size = *bytes ? (size_t)st.st_size : 0;
    bool ok = *bytes && fread(*bytes, 1, *size, f) == *size;
    if (f) fclose(f);
    if (!ok) free(*bytes), *bytes = NULL;
    return ok;
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

/* The linker knows files only: what it reads and writes lies in a folder of its own. Replaces the object by what it
 * was linked into. */
static int link_bytes(Session *s, unsigned char **bytes, size_t *size, const char **why) {
    const char *temporary = getenv("TMPDIR");
    char *folder = arena_printf(&s->scratch, "%s/saltus-XXXXXX", temporary && *temporary ? temporary : "/tmp");
    if (!mkdtemp(folder)) {
        *why = arena_printf(&s->session, "cannot make the folder %s: %s", folder, strerror(errno));
        return SLT_OUTPUT;
    }
    const char *object = arena_printf(&s->scratch, "%s/k.o", folder);
    const char *library = arena_printf(&s->scratch, "%s/k.so", folder);
    unsigned char *linked = NULL;
    bool written = write_file(object, *bytes, *size);
    if (!written) *why = arena_printf(&s->session, "cannot write %s: %s", object, strerror(errno));
    else if (!link_shared(object, library) || !read_file(library, &linked, size))
        *why = "cannot link: the system's C compiler (cc) failed or is missing";
    unlink(object);
    unlink(library);
    rmdir(folder);
    free(*bytes);
    *bytes = linked;
    return linked ? SLT_OK : SLT_OUTPUT;
}

int back_emit(Session *s, const KernelRequest *k, uint32_t n, const BackOptions *o, char kind, unsigned char **bytes,
              size_t *size, const char **why) {
    *bytes = NULL, *size = 0;
    uint32_t width = o->width ? o->width : back_choose_width(k, n, &o->target);
    int status = back_check_width(s, width, why);
    if (status) return status;
    Codegen g;
    status = back_codegen(s, k, n, o, width, kind == 'S' ? 'o' : kind, &g, why);
    if (status) return status;
    *bytes = g.bytes, *size = g.size;
    if (kind != 'S') return SLT_OK;
    ArenaMark mark = arena_mark(&s->scratch);
    status = link_bytes(s, bytes, size, why);
    arena_reset(&s->scratch, mark);
    return status;
}
