/* What happens when there is no memory inside LLVM, or when it gives up.
 *
 * LLVM does not unwind from either: it ends the process. While this thread generates code, both of its handlers, and
 * that of `new`, jump out to the session's protection instead. What LLVM held is then lost and may be locked, so that
 * this process never calls it again; kernels from the disk cache and the interpreter still run. The handlers of C++
 * have no C interface: they are found by the names that the linker knows them by, and a library without them is used as
 * it is. */
#include "compiler/back/cpu/emit.h"
#include "saltus/status.h"

#include <dlfcn.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

typedef void (*NewHandler)(void);
typedef NewHandler (*SetNewHandler)(NewHandler);
typedef void (*BadAlloc)(void *user, const char *why, _Bool is_crash);
typedef void (*SetBadAlloc)(BadAlloc, void *user);

static _Thread_local Session *working; /* what this thread generates code for */
static _Thread_local bool opening;
static atomic_bool broken, installed;
static _Atomic(SetNewHandler) set_new_handler;
static _Atomic(NewHandler) previous;

_Noreturn static void give_up(void) {
    atomic_store(&broken, true);
    Session *s = working;
    working = NULL;
    session_limit(s, "out of memory while LLVM compiled");
}

/* A return means to try again: with the handler of whoever was there before, or with none, which throws. */
static void on_new(void) {
    static const char text[] = "saltus: out of memory while LLVM was loaded\n";
    if (working) give_up();
    if (opening) { /* under the loader's lock: nothing can be saved */
        ssize_t ignored = write(2, text, sizeof text - 1);
        (void)ignored;
        _exit(SLT_LIMIT);
    }
    atomic_load (&set_new_handler)(atomic_load(&previous));
}

static void on_bad_alloc(void *user, const char *why, _Bool is_crash) {
    (void)user, (void)why, (void)is_crash;
    if (working) give_up();
}

static void on_fatal(const char *why) {
    if (!working) return;
    char text[160];
    snprintf(text, sizeof text, "LLVM gave up: %s", why); /* `why` may lie in LLVM's frames */
    if (strstr(why, "memory")) give_up();
    atomic_store(&broken, true);
    Session *s = working;
    working = NULL;
    ice(s, "%s", text);
}

static void *find(void *library, const char *name) { return library ? dlsym(library, name) : NULL; }

static void watch_new(void) {
    SetNewHandler set = atomic_load(&set_new_handler);
    if (!set) *(void **)&set = find(dlopen("libstdc++.so.6", RTLD_NOW | RTLD_LOCAL), "_ZSt15set_new_handlerPFvvE");
    if (!set) return;
    atomic_store(&set_new_handler, set);
    NewHandler before = set(on_new);
    if (before != on_new) atomic_store(&previous, before);
}

bool back_opens_llvm(void) { return opening; }

bool guard_broken(void) { return atomic_load(&broken); }

void guard_open(bool begins) {
    opening = begins;
    if (begins) watch_new();
}

void guard_begin(const LlvmApi *ll, Session *s) {
    if (!atomic_exchange(&installed, true)) {
        SetBadAlloc set;
        *(void **)&set = find(ll->handle, "_ZN4llvm31install_bad_alloc_error_handlerEPFvPvPKcbES0_");
        if (set) set(on_bad_alloc, NULL);
        ll->InstallFatalErrorHandler(on_fatal);
    }
    watch_new();
    working = s;
}

void guard_end(void) { working = NULL; }
