/* The range reduction of the logarithm in f32, by a table of nine: what flogm, flogh and flogl of ops.def are.
 *
 * x = 2^e m with m in [1, 2), which is nearest to 1 + k/8 when LOG_OFFSET says where one k ends and the next begins;
 * r[k] is near 1/m, and 1 for k = 0, 1/2 for k = 8, so that near 1 nothing is added that would cancel. r has so few
 * bits that m r - 1, at most 2^-4, is a float. Of ln 2 and of -ln r the high parts are multiples of 2^-17, so that e ln
 * 2 - ln r is one, too, and exact below 2^7. */
#ifndef SALTUS_IR_LOGS_H
#define SALTUS_IR_LOGS_H

enum { LOG_PARTS = 9, LOG_OFFSET = 699051 /* of 2^23: an eighth / 1.5 */ };
static const double log_inverse[LOG_PARTS] = {1, 0.90625, 0.8125, 0.75, 0.6875, 0.625, 0.5625, 0.53125, 0.5};
/* -ln r, and behind it ln 2 (k = 8), each as two numbers; printed by tests/ir/fit_polynomials.py. */
static const double log_table_high[LOG_PARTS] = {0,
                                                 0x1.9330000000000p-4,
                                                 0x1.a93c000000000p-3,
                                                 0x1.2696000000000p-2,
                                                 0x1.7fae000000000p-2,
                                                 0x1.e148000000000p-2,
                                                 0x1.2696000000000p-1,
                                                 0x1.43d9000000000p-1,
                                                 0x1.62e4000000000p-1};
static const double log_table_low[LOG_PARTS] = {0,
                                                0x1.7975660000000p-18,
                                                0x1.69e4560000000p-18,
                                                0x1.089a6e0000000p-21,
                                                0x1.a3bd820000000p-18,
                                                0x1.4344e40000000p-19,
                                                0x1.089a6e0000000p-20,
                                                0x1.fe5f240000000p-18,
                                                0x1.7f7d1c0000000p-20};
static const double log_ln2_high = 0x1.62e4000000000p-1, log_ln2_low = 0x1.7f7d1c0000000p-20;

#endif
