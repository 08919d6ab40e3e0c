/* What check.c, its rows and their judgement, and check_difference.c, the finite differences, share. */
#ifndef SALTUS_CLI_CHECK_H
#define SALTUS_CLI_CHECK_H

#include <math.h>

#include "cli/cli.h"

enum { REPLICATES = 8, AD_REPLICATES = 16, AD_FEWEST = 4 };

typedef struct Row {
    char name[256];
    double *dir; /* [nfloats], NULL: the unit vector of `index` */
    uint32_t index;
    double step, ad, ad_se, fd, fd_se, truncation, slope, error, z; /* error: of ad - fd, in units of z */
    double scale;                                                   /* of the parameter */
    double right, left; /* the differences to the two sides, where L bends: they do not meet as the step shrinks */
    bool bends;
    bool cells; /* the values of the difference came from these */
    bool pass, says_nothing;
} Row;

/* L, and its stated error where values come from cells, else 0. */
typedef struct Value {
    double v, error;
} Value;

typedef struct Check {
    Cli *c;
    SltProgram *p;
    Row *rows;
    uint32_t n;
    double weight[4];
    double *moved;            /* [nfloats]: parameters near the program's own */
    double *up;               /* [nfloats]: which way the weighted sum grows; NULL: nobody asked */
    bool cells;               /* values come from cells */
    bool lines;               /* and no more: those state too much */
    Value centre[REPLICATES]; /* at the program's own parameters: the same for all rows */
    SltStats stats;
    SltError err;
    uint64_t samples;
    double each; /* seconds of processor time of a value with these */
} Check;

/* As many samples a value as fit the budget, and L at the program's own parameters with these. */
SltStatus check_centre(Check *k);
/* The difference by the step that leaves the least error. */
SltStatus check_difference(Check *k, Row *row, const double *base);
static inline double check_difference_error(const Row *row) { return hypot(row->fd_se, row->truncation); }

#endif
