/* Which row of ir/ops.def an operator or a builtin function is: what the checker folds with and what generating emits.
 */
#ifndef SALTUS_FRONT_ROWS_H
#define SALTUS_FRONT_ROWS_H

#include "compiler/front/ast.h"
#include "compiler/ir/ir.h"

/* For scalars of kind k: OP_COUNT where no row is the operator (% of floats; == and != of bools). *swap: with its
 * operands exchanged (> and >=). */
Op row_of_operator(Operator op, TypeKind k, bool *swap);
/* For first arguments of kind k: OP_COUNT where it takes several rows. */
Op row_of_builtin(Builtin f, TypeKind k);

#endif
