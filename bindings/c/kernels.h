/* Kernels that are compiled and not run: for objects of another machine, and to be shown. api_kernels (api.h) refuses a
 * target that this processor lacks; this does not. Nothing may call what it made for such a target: a call that runs
 * kernels goes through api_kernels first, whether or not they are there already. */
#ifndef SALTUS_BINDINGS_C_KERNELS_H
#define SALTUS_BINDINGS_C_KERNELS_H

#include "bindings/c/api.h"

SltStatus api_kernels_unrun(SltProgram *p, const bool needs[K_KINDS], SltError *err);

#endif
