/* fill.inc.h for AVX-512; CMakeLists.txt gives this file its -m flags. */
#if defined(__AVX512DQ__)
#include "fill.inc.h"

const Fill fill_avx512 = {blocks,    place,      spread,     sum_f32, sum_f64,   mean,
                          residuals, roots_step, roots_take, zeros,   all_finite};
#endif
