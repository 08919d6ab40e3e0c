/* Any bytes as an object that the loader of kernels gets, as from a damaged cache. What is loaded is not run. */
#include <stdlib.h>
#include <string.h>

#include "compiler/back/cpu/emit.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const char *why = NULL;
    unsigned char *copy = malloc(size ? size : 1); /* aligned, as the cache's bytes are */
    if (!copy) return 0;
    if (size) memcpy(copy, data, size);
    Loaded *l = load_object(copy, size, &why);
    if (!l && !why) abort();
    free(copy); /* what is loaded stands alone */
    if (l) {
        uint64_t n = 0;
        volatile uint8_t read;
        const uint8_t *at = load_symbol(l, "k_value", &n);
        if (at) read = *at, (void)read;
        load_free(l);
    }
    return 0;
}
