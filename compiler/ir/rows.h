/* The value rows of ops.def as C loops over lanes: what the interpreter and the constant folder execute.
 *
 * Operands and results are arrays of n elements: float (rows_eval_f32) or double (rows_eval_f64) for TY_FLT, int32_t
 * for TY_INT and TY_BOOL (0 or 1). Unused operands may be NULL; dst may be one of the operands. */
#ifndef SALTUS_IR_ROWS_H
#define SALTUS_IR_ROWS_H

#include <stdint.h>

void rows_eval_f32(uint8_t op, uint32_t n, void *dst, const void *a, const void *b, const void *c);
void rows_eval_f64(uint8_t op, uint32_t n, void *dst, const void *a, const void *b, const void *c);

#endif
