/* What fit.c (the loop) and scene.c (the scene file) share. */
#ifndef SALTUS_CLI_FIT_H
#define SALTUS_CLI_FIT_H

#include "cli/cli.h"

/* One view: a target with a mask and parameter values of its own. With an external loss both images are the loss
 * program's to read. */
typedef struct View {
    char *target_path, *mask_path;
    float *target, *mask; /* at the job's size; mask may be NULL */
    SltSet *params;       /* name, JSON text or @file (malloc'd) */
    uint32_t nparams;
} View;

typedef struct FitParam {
    char *name, *value, *file; /* value: JSON text */
    int grad;                  /* -1: not said */
    char *mask;                /* an image of the parameter's shape: factors of the learning rate, 0 holds */
    double lr, smooth;         /* < 0: not said */
} FitParam;

/* A scene file: everything malloc'd; strings that Cli points to live here. */
typedef struct Scene {
    char *dir, *shader, *entry, *output, *optimizer, *loss_dir;
    FitParam *params;
    uint32_t nparams;
    View *views;
    uint32_t nviews;
    char **strings;
    uint32_t nstrings;
} Scene;

/* Reads SCENE.json into scene and, where the command line says nothing else, into the options. An SltStatus, reported.
 */
int scene_read(Cli *c, const char *path, Scene *scene);
void scene_free(Scene *scene);
char *scene_keep(Scene *s, char *text);   /* freed with the scene; returns text */
bool scene_is(const char *file);          /* by its extension */
bool fit_has_optimizer(const char *name); /* fit.c */

#endif
