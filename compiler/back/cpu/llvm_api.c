/* Finds libLLVM and fills the table of its functions, once a process. */
#include "compiler/back/cpu/llvm_api.h"
#include "compiler/back/core/core.h"

#include <dlfcn.h>
#include <elf.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define STRING_(x) #x
#define STRING(x) STRING_(x)
#define MAJOR STRING(LLVM_VERSION_MAJOR)

/* What was linked for us (cmake/llvm.cmake), the file that was there when this was built, then whatever the loader
 * knows by its names. */
static const char *const files[] = {
#ifdef SALTUS_LLVM_INSTALLED
    SALTUS_LLVM_INSTALLED,
#endif
#ifdef SALTUS_LLVM_BUILT
    SALTUS_LLVM_BUILT,
#endif
#ifdef SALTUS_LLVM_LIBRARY
    SALTUS_LLVM_LIBRARY,
#endif
    "libLLVM.so." MAJOR "." STRING(LLVM_VERSION_MINOR),
    "libLLVM-" MAJOR ".so",
    "libLLVM-" MAJOR ".so.1"};

bool llvm_is_whole(const char *path) {
    const int fd = open(path, O_RDONLY | O_CLOEXEC);
    struct stat st;
    Elf64_Ehdr e;
    bool ok = fd >= 0 && !fstat(fd, &st) && S_ISREG(st.st_mode) && pread(fd, &e, sizeof e, 0) == (ssize_t)sizeof e &&
              !memcmp(e.e_ident, ELFMAG, SELFMAG) && e.e_phentsize == sizeof(Elf64_Phdr);
    for (unsigned i = 0; ok && i < e.e_phnum; i++) {
        Elf64_Phdr p;
        ok = pread(fd, &p, sizeof p, (off_t)(e.e_phoff + i * sizeof p)) == (ssize_t)sizeof p &&
             (p.p_type != PT_LOAD ||
              (p.p_offset <= (uint64_t)st.st_size && p.p_filesz <= (uint64_t)st.st_size - p.p_offset));
    }
    if (fd >= 0) close(fd);
    return ok;
}

/* Where a library may lie: one that was copied by half would end the process, once a page is read that is not there. */
static bool may_be(const char *file) { return file[0] != '/' || llvm_is_whole(file); }

const char *back_llvm_file(void) {
    const char *const *f = files;
    while (!may_be(*f)) f++; /* the last ones are names */
    return *f;
}

const char *llvm_open(LlvmApi *api, bool *no_memory) {
    void *h = NULL;
    const char *why = NULL;
    *no_memory = guard_broken();
    if (*no_memory) return "it ran out of memory in this process before";
    guard_open(true);
    for (unsigned i = 0; !h && i < sizeof files / sizeof *files; i++) {
        if (!may_be(files[i])) continue;
        errno = 0;
        h = dlopen(files[i], RTLD_NOW | RTLD_LOCAL);
        *no_memory = !h && errno == ENOMEM;
        why = h ? NULL : dlerror();
        /* The loader keeps the error of its own mmap to itself. */
        if (why && strstr(why, "failed to map")) *no_memory = true, why = "out of memory: it could not be mapped";
        else if (*no_memory) why = "out of memory";
        if (*no_memory) break; /* of the file that is there: others would only be said to be missing */
    }
    guard_open(false);
    if (!h) return why ? why : "the loader gives no reason";
    api->handle = h;
#define FN(name)                                                                                                       \
    *(void **)&api->name = dlsym(h, "LLVM" #name);                                                                     \
    if (!api->name) return "the LLVM library lacks LLVM" #name;
#include "compiler/back/cpu/llvm_api.def"
#undef FN
    unsigned major = 0, minor = 0, patch = 0;
    api->GetVersion(&major, &minor, &patch);
    if (major != LLVM_VERSION_MAJOR) return "the LLVM library has another version than the headers it was built with";
    return NULL;
}

/* ---- before it is needed */
static struct {
    pthread_t thread;
    bool runs;
} early;

static void *open_alone(void *unused) {
    LlvmApi api;
    bool no_memory;
    (void)unused, (void)llvm_open(&api, &no_memory); /* the library stays, and the next one to open it finds it */
    return NULL;
}

void back_open_early(const char *source, bool no_cache) {
    if (early.runs || (!no_cache && !(source && cache_is_behind(NULL, source)))) return;
    early.runs = !pthread_create(&early.thread, NULL, open_alone, NULL);
}

void back_open_end(void) {
    if (early.runs) pthread_join(early.thread, NULL);
    early.runs = false;
}
