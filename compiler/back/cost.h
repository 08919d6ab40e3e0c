/* What compiled kernels cost, for people who want them faster: an estimate from the IR, line by line, and what stands
 * in the machine code. Nothing of it decides anything. */
#ifndef SALTUS_BACK_COST_H
#define SALTUS_BACK_COST_H

#include "compiler/back/back.h"

/* What is dear. A row is COST(id, text, what it is, remedy): `text` is the key in JSON. */
typedef enum CostKind {
#define COST(id, ...) COST_##id,
#include "compiler/back/cost.def"
    COST_KINDS
} CostKind;
typedef struct CostRow {
    const char *key, *one, *many, *remedy; /* remedy: "" where there is none */
} CostRow;
extern const CostRow back_cost_rows[COST_KINDS];

/* Of a line of the source in one kernel, as the kernel's estimate below. */
typedef struct CostLine {
    int32_t file; /* of the session; negative: no place */
    uint32_t line, ops;
    uint64_t times; /* how often a sample runs what is deepest in loops there, at most */
    double cost;
    uint32_t kinds[COST_KINDS]; /* operations of each kind */
} CostLine;

/* Costs are in vector instructions, additions of the same width, for one group of lanes: that of an operation is
 * OpInfo.cost, a gather's and a library call's their own, once for each of its vectors; in a loop as often as the loop
 * runs at most, which may be far more than it does. */
typedef struct KernelCost {
    double cost;
    uint32_t vectors;           /* that a varying value is cut into */
    uint32_t kinds[COST_KINDS]; /* operations of each kind; each is done once a vector */
    uint64_t array_bytes;       /* of local arrays, for one group of lanes */
    CostLine *lines;            /* [nlines], the dearest first; session arena */
    uint32_t nlines;
} KernelCost;
/* ---- core/cost.c: k: one kernel. Leaves its flags and numbers on the IR. */
void back_estimate(Session *s, const KernelRequest *k, const BackOptions *o, KernelCost *out);

/* ---- cpu/listing.c: counts of instructions in the machine code of one kernel, each counted once wherever it stands */
typedef struct Call {
    const char *name; /* NULL: through a pointer: searches, print */
    uint32_t count;
} Call;
typedef struct Listing {
    uint32_t instructions;
    uint32_t spills, reloads;   /* stores of registers to the stack, and reads of what was stored there */
    uint32_t divisions, roots;  /* of floats */
    uint32_t gathers, scatters; /* where the processor has such instructions and LLVM takes them */
    Call calls[16];
    uint32_t ncalls;
} Listing;
/* Compiles it, without the cache. Returns an SltStatus, text in `why` (session arena). */
int back_listing(Session *s, const KernelRequest *k, const BackOptions *o, Listing *out, const char **why);
/* Of assembly as LLVM writes it for x86-64 (AT&T), with its notes on spills. Names are pieces of `text`, copied. */
void back_count_listing(Session *s, const char *text, const char *kernel, Listing *out);

#endif
