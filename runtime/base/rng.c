#include "runtime/base/rng.h"

#include <Random123/philox.h>

void rng_block(uint32_t seed, RngPurpose purpose, uint32_t lane, uint64_t counter, uint32_t out[4]) {
    philox4x32_ctr_t c = {{(uint32_t)counter, (uint32_t)(counter >> 32), lane, 0}};
    philox4x32_key_t k = {{seed, (uint32_t)purpose}};
    philox4x32_ctr_t r = philox4x32_R(10, c, k);
    for (int i = 0; i < 4; i++) out[i] = r.v[i];
}

/* Powers of 1/phi_d, phi_d the positive root of x^(d+1) = x + 1, as fractions of 2^64. Integer arithmetic keeps index
 * 10^9 as exact as index 1. */
const uint64_t rng_ratio[4][4] = {
    {0x9e3779b97f4a7c15u, 0, 0, 0},
    {0xc13fa9a902a6328fu, 0x91e10da5c79e7b1cu, 0, 0},
    {0xd1b54a32d192ed03u, 0xabc98388fb8fac02u, 0x8cb92ba72f3d8dd7u, 0},
    {0xdb4f0b9175ae2165u, 0xbbe0563303a4615fu, 0xa0f2ec75a1fe1575u, 0x89e182857d9ed688u},
};
