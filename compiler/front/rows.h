/* Which row of ir/ops.def an operator or a builtin function is: check folds by it, gen emits it. */
#ifndef SALTUS_FRONT_ROWS_H
#define SALTUS_FRONT_ROWS_H

#include "compiler/front/ast.h"
#include "compiler/ir/ir.h"

/* The row of an operator on scalars of kind k; OP_COUNT where there is none (% of floats; == and != of bools). *swap:
 * the row takes the operands exchanged (> and >=). */
Op row_of_operator(Operator op, TypeKind k, bool *swap);
/* The row of a builtin whose first argument is of kind k; OP_COUNT where several make it. */
Op row_of_builtin(Builtin f, TypeKind k);

#endif
