/* LLVM, loaded when it is first needed.
 *
 * libLLVM costs 15-30 ms of relocation at process start; a run whose kernels come from the disk cache must not pay for
 * that, so nothing links against it: its C API is a table of functions filled by dlopen and dlsym. The types come from
 * LLVM's own headers. */
#ifndef SALTUS_BACK_CPU_LLVM_API_H
#define SALTUS_BACK_CPU_LLVM_API_H

#include <llvm-c/Analysis.h>
#include <llvm-c/Core.h>
#include <llvm-c/Error.h>
#include <llvm-c/Target.h>
#include <llvm-c/TargetMachine.h>
#include <llvm-c/Transforms/PassBuilder.h>
#include <llvm/Config/llvm-config.h>

#include <stdbool.h>

typedef struct LlvmApi {
    void *handle;
#define FN(name) __typeof__(LLVM##name) *name;
#include "compiler/back/cpu/llvm_api.def"
#undef FN
} LlvmApi;

bool llvm_is_whole(const char *path); /* an ELF file, with all that would be mapped of it */
/* Fills the table; returns NULL, or why LLVM cannot be used (static text or dlerror's). Thread-safe. The library stays
 * loaded. *no_memory: that is why. */
const char *llvm_open(LlvmApi *api, bool *no_memory);

/* ---- guard.c: memory that is out inside LLVM */
typedef struct Session Session;
bool guard_broken(void);      /* LLVM gave up before: it must not be called again */
void guard_open(bool begins); /* around the loading of the library */
void guard_begin(const LlvmApi *ll,
                 Session *s); /* from here to guard_end this thread calls LLVM under `s`'s protection */
void guard_end(void);

#endif
