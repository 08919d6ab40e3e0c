/* fill.inc.h for AVX2; CMakeLists.txt gives this file its -m flags. */
#if defined(__AVX2__)
#include "fill.inc.h"

const Fill fill_avx2 = {blocks,    place,      spread,     sum_f32, sum_f64,   mean,
                        residuals, roots_step, roots_take, zeros,   all_finite};
#endif
