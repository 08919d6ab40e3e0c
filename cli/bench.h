/* The two halves of `bench`. */
#ifndef SALTUS_CLI_BENCH_H
#define SALTUS_CLI_BENCH_H

#include "cli/cli.h"

/* bench_kernels.c: nanoseconds a sample of every compiled kernel, one thread. */
int bench_kernels(Cli *c, SltProgram *p);

#endif
