/* Lists of the iterations that can matter in a cell, made by `bounds` itself, from cell to cell of a tree.
 *
 * A call of `bounds` notes for each iteration of a listable loop, and each box, whether it may change anything there
 * and whether it overwrites all that came before (SltNote). What may change something, and is not overwritten in all of
 * the box, is the box's list: it serves every kernel at every point of the box, and `bounds` on parts of it. A loop
 * over thousands of discs so costs the few that reach the cell.
 *
 * Of a tree that is walked depth first, with a stack of nodes:
 *
 *     lists_begin(l, b)                     args.cull of the batch as it stands is the root's
 *     lists_enter(l, b, at)                 the node's lists go into args.cull; those of nodes done with are dropped
 *     lists_note(l, b)                      before the one call of `bounds` on the boxes of the node
 *     lists_split(l, b, n, wanted)          behind it: makes the lists of those of the n boxes whose bit is set; the
 *                                           others keep the node's
 *     lists_narrow(l, b, n)                 or: the n boxes are all of the node, which gets the list of what may matter
 *                                           in one of them
 *     at = lists_of(l, box)                 a name for them, which a child node keeps until it is entered
 *
 * Memory: a number an iteration and box that it may matter in, on the way from the root to the node. A worker has one
 * Lists, and owns it. Where the program has no such loops all of this does nothing. */
#ifndef SALTUS_QUADRATURE_LISTS_H
#define SALTUS_QUADRATURE_LISTS_H

#include "runtime/sample/batch.h"

/* Where the lists of a node lie. */
typedef struct ListsAt {
    uint64_t first; /* Lists.items[first ..]: for each loop how many, then these */
    uint64_t end;   /* behind those of all its siblings */
} ListsAt;

typedef struct Lists {
    const SltScene *s;
    SltCullList *current; /* [s->nlists]: the node's; those that `bounds` does not make are the root's */
    SltCullList *root;
    int32_t *items; /* of all nodes that wait, by ListsAt */
    uint64_t top, cap;
    SltNote **note; /* [s->nlists]: into `notes` */
    SltNote *notes; /* of one call */
    uint64_t note_cap;
    uint64_t *count, *from; /* [nlists * SLT_PAD]: of one call, by loop and box: items, and where the next one goes */
    ListsAt node, at[SLT_PAD]; /* the current node; the boxes split last */
    bool any;                  /* the program has listable loops */
} Lists;

/* The scene outlives the Lists. False when memory runs out (lists_free all the same). */
bool lists_init(Lists *l, const SltScene *s);
void lists_free(Lists *l);
ListsAt lists_begin(Lists *l, Batch *b);
void lists_enter(Lists *l, Batch *b, ListsAt at);
bool lists_note(Lists *l, Batch *b);
bool lists_split(Lists *l, Batch *b, uint32_t n, uint64_t wanted);
bool lists_narrow(Lists *l, Batch *b, uint32_t n);
static inline ListsAt lists_of(const Lists *l, uint32_t box) { return l->at[box]; }
/* For a child that is no box of the split: what its parent has. */
static inline ListsAt lists_of_node(const Lists *l) { return (ListsAt){l->node.first, l->top}; }

#endif
