/* What the files of structured control flow share: results side by side with what they stand for.
 * Only the files of ifs and loops include this. */
#ifndef SALTUS_BACK_CPU_EMIT_CONTROL_H
#define SALTUS_BACK_CPU_EMIT_CONTROL_H

#include "compiler/back/cpu/emit.h"

/* The parts of a value as a result of a structured operation: vectors if the result varies. Returns how many. */
uint32_t emit_result_parts(Emit *e, const Inst *value, bool vector, Part *out);
LLVMTypeRef emit_value_type(Emit *e, const Inst *i); /* of one part */
Part *emit_new_parts(Emit *e);                       /* room for P of them */

/* The results of s that something reads, one after the other: the first for p == NULL, NULL after the last. */
const Inst *emit_next_proj(const Inst *s, const Inst *p);
size_t emit_proj_count(const Inst *i);

void emit_if(Emit *e, Inst *i);
void emit_loop(Emit *e, Inst *i);

#endif
