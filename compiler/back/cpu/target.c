/* Targets. A CPU is described by its level of the x86-64 ABI rather than by its name, so the same program gives the
 * same code, and the same cache key, on every machine of a level, and LLVM need not be loaded to ask. Only `native`
 * also asks whether the divider is slow, which changes no bit of what kernels give. */
#include <stdlib.h>
#include <string.h>

#include "compiler/back/cpu/emit.h"

/* As in runtime/base/cpu.h. */
#if defined(__has_include)
#if __has_include(<sys/platform/x86.h>)
#include <sys/platform/x86.h>
#endif
#endif
#if defined(CPU_FEATURE_ACTIVE)
static bool is_active(unsigned index) {
    enum { BITS = 32, REGISTERS = 4 };
    const struct cpuid_feature *leaf = __x86_get_cpuid_feature_leaf(index / (BITS * REGISTERS));
    return leaf->active_array[index / BITS % REGISTERS] >> index % BITS & 1;
}
#define HAS(NAME, name) is_active(x86_cpu_##NAME)
#else
#define HAS(NAME, name) __builtin_cpu_supports(name)
#endif

static bool host_has(unsigned level) {
    const bool v3 = HAS(AVX2, "avx2") && HAS(FMA, "fma") && HAS(BMI1, "bmi") && HAS(BMI2, "bmi2");
    if (level == 3) return v3;
    return v3 && HAS(AVX512F, "avx512f") && HAS(AVX512BW, "avx512bw") && HAS(AVX512DQ, "avx512dq") &&
           HAS(AVX512VL, "avx512vl") && HAS(AVX512CD, "avx512cd");
}

/* Intel's servers from Sapphire Rapids on, which are told by vectors of half floats, and from AMD's by a set that these
 * alone have: measured there. Not by their names, which virtual machines give them as they like; and not those that add
 * and multiply 64 bytes in two halves, too. */
static bool host_divides_slowly(void) { return HAS(AVX512_FP16, "avx512fp16") && !HAS(SSE4A, "sse4a"); }

static void set(Target *t, const char *cpu, uint32_t bytes, bool fma) {
    *t = (Target){.vector_bytes = bytes, .has_fma = fma};
    strcpy(t->cpu, cpu);
}

static void set_host(Target *t) {
    if (host_has(4)) set(t, "x86-64-v4", 64, true), t->slow_divider = host_divides_slowly();
    else if (host_has(3)) set(t, "x86-64-v3", 32, true);
    else set(t, "x86-64", 16, false);
}

bool target_named(Target *t, const char *name) {
    if (!strcmp(name, "sse2")) set(t, "x86-64", 16, false);
    else if (!strcmp(name, "avx2")) set(t, "x86-64-v3", 32, true);
    else if (!strcmp(name, "avx512")) set(t, "x86-64-v4", 64, true);
    else if (!strcmp(name, "native")) set_host(t);
    else return false;
    return true;
}

bool target_runs(const Target *t, const Target *here) {
    return t->vector_bytes <= here->vector_bytes && (here->has_fma || !t->has_fma);
}

/* The environment may narrow the host, never widen it: kernels of a wider target would not run. */
void target_host(Target *t) {
    set_host(t);
    const char *wanted = getenv("SALTUS_TARGET");
    Target narrow;
    if (wanted && target_named(&narrow, wanted) && narrow.vector_bytes <= t->vector_bytes) *t = narrow;
}

const char *back_llvm_version(void) { return LLVM_VERSION_STRING; }
