/* What bench.c and bench_kernels.c, the two halves of `bench`, share. */
#ifndef SALTUS_CLI_BENCH_H
#define SALTUS_CLI_BENCH_H

#include "cli/cli.h"

/* bench_kernels.c: prints nanoseconds a sample of every compiled kernel on one thread. An SltStatus. */
int bench_kernels(Cli *c, SltProgram *p);

#endif
