/* What lines do not see: runs of a line between two crossings that are shorter than the spacing hold a vertex by
 * chance alone, with the probability length / spacing. So each that does hold one stands for spacing / length of them
 * (Horvitz and Thompson 1952): the sum of what all of these would weigh, less what was found, estimates what was
 * missed, whatever the shape of the features. Where the near-miss probe may find a run, the probability is that of
 * either, by trying it on lines that are shifted; what was found by following (follow.h) is taken off.
 *
 * A sink collects the crossings beside such runs until the tile is done, and pairs them by the run's vertex. */
#ifndef SALTUS_SAMPLE_THIN_H
#define SALTUS_SAMPLE_THIN_H

#include "runtime/sample/near.h"

/* Segment.thin: 0, or THIN_FOUND (by following), or what thin_edge says. */
enum { THIN_FOUND = 1 };

/* Segment.thin of the edge from vertex v of a line to the next, whose ends differ. The line's `from` and `to` do not
 * matter; n are the vertices known. `axis` keeps runs of lines that cross at a vertex apart. */
uint32_t thin_edge(const Worker *w, const Line *l, uint32_t v, uint32_t axis);
/* Does the edge before the one from v, or the one behind it, have ends that differ, too? */
bool differs_beside(const Worker *w, const Line *l, uint32_t v);
/* Puts what the crossings collected so far stand for into the sums of what is missed, and forgets them. stride: of
 * vertices, by axis. */
void thin_flush(Worker *w, const uint64_t stride[3]);
/* The same of lines through cells, each with its own `lines` vertices an axis between its two ends, which no run is
 * told by: what they stand for goes to the sums that they are in. side: of cell Crossing.owner along each axis. */
void thin_flush_cells(Worker *w, const double (*side)[3], uint32_t lines);

#endif
