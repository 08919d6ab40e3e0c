/* What readers of parameter values share: values_read.c (JSON and text) and values_file.c (files). */
#ifndef SALTUS_BINDINGS_C_VALUES_READ_H
#define SALTUS_BINDINGS_C_VALUES_READ_H

#include <jansson.h>

#include "bindings/c/api.h"
#include "bindings/c/shape.h"

/* Values go to staging vectors, which replace the program's only if all is well. */
typedef struct Stage {
    SltProgram *p;
    double *floats;
    int32_t *ints;
    SltError *err;
    const char *shown; /* the file or the name that messages begin with */
} Stage;

SltStatus stage_begin(Stage *s);
void stage_end(Stage *s, bool take); /* frees the vectors; take: the program has their values now */

/* values_read.c */
json_t *values_parse_json(const char *text, const char *shown, SltError *err);
SltStatus values_read_param(Stage *s, const Param *q, json_t *j);

/* values_file.c */
SltStatus values_read_image(Stage *s, const Param *q, const char *path); /* of a texture or a geometry */
/* Numbers in order of declaration; `path` had them. */
SltStatus values_fill(Stage *s, const Param *q, const char *path, const double *v, size_t n);
SltStatus values_read_file(Stage *s, const Param *q, const char *path);

/* values_mesh.c: paths like "spot.obj" and "spot.obj:normals" */
bool values_is_mesh(const char *path);
SltStatus values_read_mesh(Stage *s, const Param *q, const char *path);
/* Of a parameter that is a mesh: dims gets vertices, triangles, and whether they have places in a texture. */
SltStatus values_probe_geometry(const char *path, uint32_t dims[4], uint32_t *ndims, SltError *err);
SltStatus values_probe_mesh(const char *path, const Type *t, uint32_t dims[4], uint32_t *ndims, SltError *err);

#endif
