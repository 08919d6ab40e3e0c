/* Outlines of visible pieces: what `lit` needs of a piece that kernels were told of. Kept in the thread's store, of
 * meshes that are asked it, until the store is emptied (told.c). */
#ifndef SALTUS_MESH_OUTLINE_H
#define SALTUS_MESH_OUTLINE_H

#include <stdbool.h>
#include <stdint.h>

/* A place of the camera's window. */
typedef struct OutlinePlace {
    double s, t;
} OutlinePlace;

/* The part of a side that moves with a line: named as sides are told (SLT_SIDE_A). */
typedef struct OutlinePart {
    OutlinePlace from, to;
    int32_t a, b;
    uint32_t side; /* from this corner to the next */
    bool outside;  /* the piece is where the line's g is negative */
} OutlinePart;

typedef struct OutlineBeam {
    double eye[3], c[3], u[3], v[3]; /* c: of the window's first corner, from the eye */
} OutlineBeam;

/* What was told of a light. */
typedef struct OutlineAnswer {
    double light[3];
    int32_t unit;
    uint32_t before; /* 1 + the number of another of the same piece; 0: none */
} OutlineAnswer;

/* A piece in the rows of the store. */
typedef struct OutlineRow {
    uint32_t unit, beam, corner, ncorners, part, nparts;
    uint32_t answer; /* 1 + the number of the last, 0: none; of this kernel alone (pieces_begun) */
    int32_t triangle;
    uint64_t begun;
} OutlineRow;

typedef struct Outline {
    const OutlineBeam *beam;
    const OutlinePlace *corner; /* counter-clockwise in (s, t) */
    const OutlinePart *part;    /* by sides */
    uint32_t ncorners, nparts;
    int32_t triangle;
    uint32_t row; /* its number */
} Outline;

/* Of a piece by its unit; false: it has none. It points into the store. */
bool outline_find(uint32_t unit, Outline *out);
/* Reverse mode runs loops again: what was told of a piece and a light is told again, without a search. */
bool outline_recall(const Outline *o, const double light[3], int32_t *unit);
void outline_remember(const Outline *o, const double light[3], int32_t unit);

#endif
