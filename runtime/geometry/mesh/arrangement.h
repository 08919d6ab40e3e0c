/* How the silhouettes of a light's window lie: for light_arrange.c, which makes it, light_tie.c, which finds how many
 * faces hide beside each, and light_border.c, which finds what is lit. Of a thread's store; used again for each
 * receiver. */
#ifndef SALTUS_MESH_ARRANGEMENT_H
#define SALTUS_MESH_ARRANGEMENT_H

#include <limits.h>
#include <math.h>

#include "light_inner.h"

enum {
    ARRANGED_MOST = 8192,           /* segments; more are cut window by window */
    ARRANGED_NOWHERE = INT_MAX / 2, /* so many hide what is outside of the light */
    ARRANGED_ALONE = -1,            /* of a segment's end: at the light's border, no other */
    ARRANGED_SEVERAL = -2           /* more than one other */
};

/* Segments i and k cross. */
typedef struct Meeting {
    uint32_t segment[2];
    double along[2], place[2];
    bool up;         /* k goes from the right of i to its left */
    int32_t left[2]; /* how many hide, left of i before it, of k before it: more than where these begin */
} Meeting;

/* What a segment comes to. */
typedef struct Step {
    double along;
    uint32_t meeting, which;
} Step;

/* Segment `end / 2` is cut at a border, `along` the outline of the light, a side as 1. */
typedef struct Landing {
    double along;
    uint32_t end;
} Landing;

/* A part of a segment, or of the outline, without a crossing in it. left, right: how many hide there, more than where
 * its part of the arrangement begins. */
typedef struct Stretch {
    double from[2], to[2];
    uint32_t part, line;
    int32_t left, right;
} Stretch;

/* The part of the arrangement whose root this segment is. */
typedef struct Part {
    int32_t fewest;
    double length; /* of the longest stretch beside which they are, squared */
    uint32_t stretch;
    bool lit;
} Part;

typedef struct Arrangement {
    uint32_t n; /* segments; number n is the outline */
    double x[2][ARRANGED_MOST + CROSS_ROOM], y[2][ARRANGED_MOST + CROSS_ROOM], end[2][ARRANGED_MOST + CROSS_ROOM],
        blur[ARRANGED_MOST + CROSS_ROOM];
    uint32_t line[ARRANGED_MOST];
    uint32_t upto[ARRANGED_MOST]; /* the segments before this one begin to the left of where it ends */
    int32_t more[ARRANGED_MOST],
        change[ARRANGED_MOST];         /* change: from what hides left of its begin to left of its end */
    int8_t border[2][ARRANGED_MOST];   /* line of the border that the end was cut at, or CUT_NOT */
    int32_t next[2][ARRANGED_MOST];    /* the end, 2 * segment + which, that is the same vertex */
    uint32_t first[ARRANGED_MOST + 1]; /* of its steps */
    uint32_t root[ARRANGED_MOST + 1];
    int32_t more_than[ARRANGED_MOST + 1]; /* hide left of its begin than left of that of the root */
    Part part[ARRANGED_MOST + 1];
    CrossFound found[ARRANGED_MOST];
    ROW(uint32_t) touch; /* pairs of ends */
    ROW(Meeting) meeting;
    ROW(Step) step;
    ROW(Landing) landing;
    ROW(Stretch) stretch;
} Arrangement;

/* light_tie.c */
/* All that hangs together, by a root. False: numbers do not agree, or rounding hides what lies where. */
bool arrangement_tie(Arrangement *a, const Polygon *whole);
uint32_t arrangement_root(Arrangement *a, uint32_t segment);

/* light_border.c */
/* The row of arcs. False: rounding hides what is lit. */
bool arrangement_border(Light *l, Arrangement *a, const Polygon *whole);

/* Of numbers, inline. */
/* The way out of a segment's end. */
static inline void arrangement_way_out(const Arrangement *a, uint32_t end, double way[2]) {
    const uint32_t i = end / 2, e = end % 2;
    way[0] = a->x[!e][i] - a->x[e][i], way[1] = a->y[!e][i] - a->y[e][i];
}

/* Do they leave their vertex so nearly in one direction that rounding hides which is left of which? */
static inline bool arrangement_too_near(const Arrangement *a, uint32_t one, uint32_t other) {
    double p[2], q[2];
    arrangement_way_out(a, one, p), arrangement_way_out(a, other, q);
    return p[0] * q[0] + p[1] * q[1] > 0 &&
           fabs(p[0] * q[1] - p[1] * q[0]) <= light_max(a->blur[one / 2], a->blur[other / 2]);
}

/* How the number left of segment s changes where it crosses the other. */
static inline int32_t arrangement_change(const Arrangement *a, const Meeting *m, int which) {
    const int32_t more = a->more[m->segment[!which]];
    return m->up == !which ? -more : more;
}

/* Left and right of the way out of a segment's end, more than left of its begin. */
static inline int32_t arrangement_left_out(const Arrangement *a, uint32_t end) {
    return end & 1 ? a->change[end / 2] - a->more[end / 2] : 0;
}
static inline int32_t arrangement_right_out(const Arrangement *a, uint32_t end) {
    return end & 1 ? a->change[end / 2] : -a->more[end / 2];
}

#endif
