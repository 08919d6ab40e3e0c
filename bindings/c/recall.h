/* What an order for kernels comes to beside their code: all that the library needs to know of kernels that it does not
 * show. Made from their IR (kernels.c), and kept in the cache beside the objects (recall.c), so that a process that
 * finds it there runs no pass on any kernel. */
#ifndef SALTUS_BINDINGS_C_RECALL_H
#define SALTUS_BINDINGS_C_RECALL_H

#include "bindings/c/api.h"

/* Kernels that some call lacks. */
typedef struct KernelOrder {
    SltProgram *p;
    bool needs[K_KINDS];
    bool late[K_KINDS], soon[K_KINDS]; /* see api_kernels_late and api_kernels_beside */
    bool cull;                         /* and the bounds of [Cull] loops */
    bool cells;                        /* VariantOptions.cells */
    bool by_facts;                     /* their IR may be left out */
    bool of_images;                    /* bounds, for lists: the scene learns nothing of edges */
    SltStatus status;
    SltError *err;
} KernelOrder;

typedef struct KernelFacts {
    bool made;       /* else the program has no use for it, or it was not asked for */
    bool few, plain; /* of BackOptions */
    bool tape_grows;
    uint32_t lanes;
    uint64_t tape_bytes;
    SltLayout layout;
    uint32_t *queries; /* [ngeometries]: bit (1 << SltQuery) */
} KernelFacts;

typedef struct EdgeFacts {
    uint32_t line;
    uint8_t kind, bends, upsets;
    int8_t argmin;
} EdgeFacts;

enum { ORDER_MODULES = 2 /* what is needed now, and soon */ };

typedef struct OrderFacts {
    KernelFacts kernel[K_KINDS];
    KernelFacts cull; /* of the bounds of [Cull] loops together, but for their lanes */
    uint32_t *cull_lanes;
    CacheKey module[ORDER_MODULES];
    bool hides, site_logs, rigid; /* see SltScene; of region, site_vjp, vjp */
    bool bare;                    /* of vjp: KernelSet.bare */
    bool flat, told, chunked;     /* of edges */
    uint8_t noted[SLT_MAX_CULL];  /* of bounds */
    uint8_t *dense;               /* [nfloats]; NULL: there is no reverse kernel among them */
    uint32_t nedges;
    EdgeFacts *edge; /* NULL: no kernel among them knows edges */
} OrderFacts;

/* Kernels of module m, in the order of its entry: their names (module arena) and lanes; returns how many. */
uint32_t order_module(const KernelOrder *q, const OrderFacts *f, uint32_t m, const char *names[K_KINDS + SLT_MAX_CULL],
                      uint32_t lanes[K_KINDS + SLT_MAX_CULL]);
/* The key of an order's facts; .len 0: they are neither looked for nor kept. */
CacheKey recall_key(const KernelOrder *q);
/* False: they are not there, or an object is not. Else the modules are loaded, NULL where one has no kernels. */
bool recall(const KernelOrder *q, const CacheKey *key, OrderFacts *f, CompiledModule *module[ORDER_MODULES]);
void recall_keep(const KernelOrder *q, const CacheKey *key, OrderFacts *f);

#endif
