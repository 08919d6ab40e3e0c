/* What every target here exports; replay.c feeds it the corpus, an engine (libFuzzer, AFL++, honggfuzz) feeds it
 * anything. */
#ifndef SALTUS_TESTS_FUZZ_H
#define SALTUS_TESTS_FUZZ_H

#include <stddef.h>
#include <stdint.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#endif
