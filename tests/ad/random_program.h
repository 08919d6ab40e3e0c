/* Random programs over the value operations, ifs, loops and arrays: typed, terminating, and made by the seed alone.
 *
 * The float outputs depend on x0, x1 and on `nfloats` parameters (read at constant and at computed indices). Values
 * stay moderate (everything carried or stored goes through a bounded function), so differences make sense. Used by the
 * tests of differentiation; fit for any test that compares two ways to run a Fn. Include random_program.c in one file
 * of the test. */
#ifndef SALTUS_TESTS_RANDOM_PROGRAM_H
#define SALTUS_TESTS_RANDOM_PROGRAM_H

#include "compiler/ir/ir.h"

typedef struct RandomShape {
    uint32_t statements; /* in a block, 0: 8 */
    uint32_t depth;      /* of regions, 0: 3 */
    uint32_t nfloats;    /* parameters, 0: 12 */
    uint32_t outputs;    /* 1..4, 0: 2 */
    bool no_arrays, no_loops, no_ifs;
} RandomShape;

/* Everything is allocated in `arena`; the Fn is verified by the caller if it wants to. */
Fn *random_program(Session *s, Arena *arena, Precision precision, uint64_t seed, RandomShape shape);

#endif
