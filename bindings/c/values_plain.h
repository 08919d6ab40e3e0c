/* The quick reader of parameter values: true where all of the text was read. Where not, some of the values that the
 * text is about may have been written, and values_read.c has to read all of them. */
#ifndef SALTUS_BINDINGS_C_VALUES_PLAIN_H
#define SALTUS_BINDINGS_C_VALUES_PLAIN_H

#include "bindings/c/shape.h"

bool plain_param(const Param *q, const char *text, double *floats, int32_t *ints);
/* How many elements the list under `name` has in the object that the text is, how many its first one, and so on while
 * these are lists, at most `most` sizes. Returns how many; 0: there is no such list. Nothing is checked: whoever reads
 * the values does. */
uint32_t plain_sizes(const char *text, const char *name, uint32_t most, uint64_t *sizes);
bool plain_params(const Program *p, const char *text, double *floats, int32_t *ints);

#endif
