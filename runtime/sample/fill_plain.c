/* fill.inc.h for the machine that all have. */
#include "fill.inc.h"

const Fill fill_plain = {blocks,    place,      spread,     sum_f32, sum_f64,   mean,
                         residuals, roots_step, roots_take, zeros,   all_finite};
