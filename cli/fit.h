/* What fit.c and scene.c, the scene file, share. */
#ifndef SALTUS_CLI_FIT_H
#define SALTUS_CLI_FIT_H

#include "cli/cli.h"

/* One view: a target with a mask and parameter values of its own. With a loss program only that program reads the two
 * images. */
typedef struct View {
    char *target_path, *mask_path;
    float *target, *mask; /* at the job's size; mask may be NULL */
    SltSet *params;       /* [nparams]: name, and JSON text or @file; malloc'd */
    uint32_t nparams;
} View;

typedef struct FitParam {
    char *name, *value, *file; /* value: JSON text; value and file may be NULL */
    int grad;                  /* 0 or 1; -1: not said */
    char *mask;                /* path of an image of the parameter's shape, factors of its learning rate; or NULL */
    double lr, smooth;         /* < 0: not said */
} FitParam;

/* A scene file. Everything is malloc'd, and lives until scene_free; Cli may point at the strings. */
typedef struct Scene {
    char *dir, *shader, *entry, *output, *optimizer, *loss_dir;
    FitParam *params;
    uint32_t nparams;
    View *views;
    uint32_t nviews;
    char **strings;
    uint32_t nstrings;
} Scene;

/* Reads SCENE.json into scene and, where the command line says nothing else, into the options. An SltStatus; the error
 * is printed. */
int scene_read(Cli *c, const char *path, Scene *scene);
void scene_free(Scene *scene);
char *scene_keep(Scene *s, char *text);   /* gives text (malloc'd) to the scene; returns it */
bool scene_is(const char *file);          /* is the file a scene, by its extension? */
bool fit_has_optimizer(const char *name); /* fit.c: is there an optimiser of this name? */

#endif
