/* Lines without gaps: parts of a segment whose ends look alike are proven to hold no jump, or halved.
 *
 * Where a scene has the kernel `bounds`, a part between alike ends is a box; where bounds leave a decision open on it,
 * the region is evaluated in its middle, and both halves are looked at again, down to `least`. So a feature is missed
 * only where it is narrower than that, however wide the lattice. The finder owns the stack. */
#ifndef SALTUS_SAMPLE_PROVE_H
#define SALTUS_SAMPLE_PROVE_H

#include "runtime/sample/finder.h"

/* The least part of a segment that is halved no more. */
#define PROVE_LEAST 0x1p-9

/* Are there sites of rays, and all of them shadows? */
bool prove_only_shadows(const SltScene *s);
/* Are there sites of rays, and do bounds settle boxes of all of them? */
bool prove_settles_rays(const SltScene *s);
/* Can bounds prove lines of this scene? Its sites of rays are shadows: which ridge a ray meets is never settled, so
 * beside silhouettes bounds would cost and prove nothing. */
bool prove_serves(const SltScene *s);
/* Is nothing open on box i that a site could jump at, after a call of the kernel bounds? */
bool prove_is_settled(const Batch *b, uint32_t i);
/* Sets box i: from x(ta) to x(tb) of the segment. */
void prove_set_box(Batch *b, uint32_t i, const Segment *s, double ta, double tb);
/* Adds the part of s from ta to tb, with marks a and b that do not differ. */
void prove_add(Finder *f, const Segment *s, double ta, double tb, Mark a, Mark b);
/* Works off full batches of such parts; with `all` everything. What differs goes to the finder's stack. */
void prove_run(Finder *f, bool all);

#endif
