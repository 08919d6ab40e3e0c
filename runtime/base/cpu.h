/* What this machine's processor can do. The C library has asked it already: to ask again, as __builtin_cpu_supports
 * does before main(), takes 70 us of a start in a virtual machine, which answers in the processor's place. */
#ifndef SALTUS_RUNTIME_BASE_CPU_H
#define SALTUS_RUNTIME_BASE_CPU_H

#include <stdbool.h>

#if defined(__x86_64__) && defined(__has_include)
#if __has_include(<sys/platform/x86.h>)
#include <sys/platform/x86.h>
#endif
#endif

#if !defined(__x86_64__)
#define CPU_HAS(NAME, name) false
#elif defined(CPU_FEATURE_ACTIVE)
/* The header's own function shifts a 1 into the sign of an int. */
static inline bool cpu_is_active(unsigned index) {
    enum { BITS = 32, REGISTERS = 4 };
    const struct cpuid_feature *leaf = __x86_get_cpuid_feature_leaf(index / (BITS * REGISTERS));
    return leaf->active_array[index / BITS % REGISTERS] >> index % BITS & 1;
}
#define CPU_HAS(NAME, name) cpu_is_active(x86_cpu_##NAME)
#else
#define CPU_HAS(NAME, name) __builtin_cpu_supports(name)
#endif

static inline bool cpu_has_avx2(void) { return CPU_HAS(AVX2, "avx2"); }

static inline bool cpu_has_avx512(void) {
    return CPU_HAS(AVX512F, "avx512f") && CPU_HAS(AVX512VL, "avx512vl") && CPU_HAS(AVX512DQ, "avx512dq") &&
           CPU_HAS(AVX512BW, "avx512bw");
}

#endif
