/* What fit.c (the loop) and scene.c (the scene file) share. */
#ifndef SALTUS_CLI_FIT_H
#define SALTUS_CLI_FIT_H

#include "cli/cli.h"

/* One view: a target with a mask and parameter values of its own. */
typedef struct View {
    char *target_path, *mask_path;
    float *target, *mask;      /* at the job's size; mask may be NULL */
    Assign *params;            /* set before the view is evaluated: name, JSON text (malloc'd) */
    uint32_t nparams;
} View;

typedef struct FitParam {
    char *name, *value, *file; /* value: JSON text */
    int grad;                  /* -1: not said */
    double lr, smooth;         /* < 0: not said */
} FitParam;

/* A scene file: everything malloc'd; strings that Cli points to live here. */
typedef struct Scene {
    char *dir, *shader, *entry, *output, *optimizer;
    FitParam *params;
    uint32_t nparams;
    View *views;
    uint32_t nviews;
    char **strings;
    uint32_t nstrings;
} Scene;

/* Reads SCENE.json into scene and, where the command line says nothing else, into the options. An SltStatus, reported. */
int scene_read(Cli *c, const char *path, Scene *scene);
void scene_free(Scene *scene);
bool scene_is(const char *file); /* by its extension */

#endif
