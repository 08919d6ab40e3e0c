#include "compiler/back/llvm_api.h"

#include <dlfcn.h>
#include <stddef.h>

#ifndef SALTUS_LLVM_SONAME
#define SALTUS_LLVM_SONAME "libLLVM.so." LLVM_VERSION_SHORT
#endif
#define STRING_(x) #x
#define STRING(x) STRING_(x)
#define LLVM_VERSION_SHORT STRING(LLVM_VERSION_MAJOR) "." STRING(LLVM_VERSION_MINOR)

const char *llvm_open(LlvmApi *api) {
    static const char *const names[] = {SALTUS_LLVM_SONAME, "libLLVM-" STRING(LLVM_VERSION_MAJOR) ".so",
                                        "/usr/lib/llvm-" STRING(LLVM_VERSION_MAJOR) "/lib/" SALTUS_LLVM_SONAME};
    void *h = NULL;
    for (unsigned i = 0; !h && i < sizeof names / sizeof *names; i++) h = dlopen(names[i], RTLD_NOW | RTLD_LOCAL);
    if (!h) return dlerror();
    api->handle = h;
#define FN(name)                                                                                                       \
    *(void **)&api->name = dlsym(h, "LLVM" #name);                                                                     \
    if (!api->name) return "the LLVM library lacks LLVM" #name;
#include "compiler/back/llvm_api.def"
#undef FN
    unsigned major = 0, minor = 0, patch = 0;
    api->GetVersion(&major, &minor, &patch);
    if (major != LLVM_VERSION_MAJOR) return "the LLVM library has another version than the headers it was built with";
    return NULL;
}
