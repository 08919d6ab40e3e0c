/* What fit.c, its parts fit_views.c and fit_write.c, and scene.c, the scene file, share. */
#ifndef SALTUS_CLI_FIT_H
#define SALTUS_CLI_FIT_H

#include "cli/cli.h"
#include "cli/loss.h"
#include "saltus/fit.h"

/* A target that another shader draws. */
typedef struct TargetShader {
    char *path, *entry;    /* entry may be NULL */
    SltSet *params, *sets; /* [nparams], values of its parameters; [nsets], of its constants; malloc'd */
    uint32_t nparams, nsets, spp;
} TargetShader;

/* One view: a target with a mask and parameter values of its own. With a loss program only that program reads the two
 * images. */
typedef struct View {
    char *target_path, *mask_path;
    char *entry;          /* of the shader; NULL: the scene's */
    SltProgram *program;  /* of that entry, in Fit.entries; NULL: the fit's own */
    TargetShader *drawn;  /* the target is its image; malloc'd, or NULL */
    float *target, *mask; /* at the job's size; mask may be NULL */
    SltSet *params;       /* [nparams]: name, and JSON text or @file; malloc'd */
    uint32_t nparams;
} View;

/* So many iterations, then a program that changes the parameters. */
typedef struct Round {
    uint32_t iters;
    const char *command;
    double timeout; /* seconds that it may take */
} Round;

typedef struct FitParam {
    char *name, *value, *file; /* value: JSON text; value and file may be NULL */
    int grad;                  /* 0 or 1; -1: not said */
    char *mask;                /* path of an image of the parameter's shape, factors of its learning rate; or NULL */
    char *faces;               /* the parameter with the faces of the mesh whose vertices these are, or NULL */
    double lr, smooth;         /* < 0: not said */
} FitParam;

/* A scene file. Everything is malloc'd, and lives until scene_free; Cli may point at the strings. */
typedef struct Scene {
    char *dir, *shader, *entry, *output, *optimizer, *loss_dir;
    FitParam *params;
    uint32_t nparams;
    View *views;
    uint32_t nviews;
    Round *rounds; /* one after the other, or `rounds_repeat` again and again */
    uint32_t nrounds;
    bool rounds_repeat;
    const char *rounds_dir; /* where their programs run; NULL: the current folder */
    char **strings;
    uint32_t nstrings;
} Scene;

enum { ROUND_SECONDS = 600 }; /* for a program between rounds, if nothing else is said */
enum { STRIP = 5 };           /* pictures of a film strip, without the best and the target */

typedef struct Fit {
    Cli *c;
    SltProgram *p;
    Scene scene;
    SltFitOptions opt;
    SltProgram **entries; /* [nentries]: the shader once more for each other entry of a view */
    uint32_t nentries;
    SltFitView *views;
    SltFitMask *masks; /* their factors are malloc'd */
    SltFitNumber *rates, *smooth;
    LossProgram *loss; /* of --loss-command, while it runs */
    Progress progress;
    uint32_t done; /* evaluations, those before a resume included */
    /* Of a folder only: all views as one picture, spread over the fit; the best of each at its end; and by --frames. */
    Image strip[STRIP];
    uint32_t nstrip;
    float **best; /* [nviews] */
    ImageFrame *frames;
    uint32_t nframes;
    double start;
    uint32_t round, first; /* rounds that are done, and the iterations that they had */
    uint32_t *round_ends;  /* [round]: evaluations up to the end of each */
    bool moves;            /* some derivative was not 0 */
    double *slopes;        /* [floats]: of |dL/dp|, the sum and then the mean over a round; NULL: there are no rounds */
    char *kept;            /* the parameters before the last program changed them; NULL: none has */
    SltFitResult result;   /* of all rounds; `loss` of the last */
    SltStats stats;
    char **texts; /* [ntexts]: strings of its places, of programs that a round has freed */
    uint32_t ntexts;
} Fit;

/* Reads SCENE.json into scene and, where the command line says nothing else, into the options. An SltStatus; the error
 * is printed. */
int scene_read(Cli *c, const char *path, Scene *scene);
void scene_free(Scene *scene);
char *scene_keep(Scene *s, char *text); /* gives text (malloc'd) to the scene; returns it */
bool scene_is(const char *file);        /* is the file a scene, by its extension? */

/* fit_seeds.c: calls `once` by each of the seeds, and reports on the losses. */
int fit_seeds(Cli *c, int (*once)(Cli *c, double *loss));

/* fit.c: what the options and the scene say is optimised. */
SltStatus fit_choose_wrt(Fit *f, SltError *err);

/* fit_rounds.c */
int fit_take_rounds(Fit *f);                          /* those of the command line, in place of the scene's */
uint32_t fit_round(const Fit *f, const Round **then); /* iterations of the next round; what follows it, or NULL */
SltStatus fit_change(Fit *f, const Round *r, SltError *err); /* behind a round: the program changes the parameters */
void fit_revert(Fit *f); /* to those before it: a round that had no iteration leaves none better */

/* fit_views.c */
SltStatus fit_size_of_target(const Fit *f, uint32_t size[3], SltError *err); /* the first target's, without --size */
int fit_check_targets(Fit *f); /* whether the options make one loss; the size, if a target decides it */
int fit_read_targets(Fit *f);  /* images, and what shaders draw; the shaders of views that have entries of their own */
int fit_collect_views(Fit *f);

/* fit_write.c: a file of parameters, or a folder. */
bool fit_wants_folder(const Cli *c);
SltStatus fit_check_folder(const Fit *f, SltError *err); /* before the fit, and not after hours */
int fit_write_outputs(Fit *f);
SltStatus fit_write_meshes(Fit *f, SltError *err); /* NAME.obj of every mesh that was optimised, into the folder */
SltStatus fit_join(char *out, size_t size, const char *dir, const char *name, SltError *err); /* dir/name */

/* fit_pictures.c: pictures of the views, of a folder only; the best of each also for what changes parameters. */
void fit_create_best(Fit *f); /* both before the fit */
SltStatus fit_create_pictures(Fit *f, SltError *err);
SltStatus fit_take_pictures(Fit *f, SltFit *fit, SltError *err); /* behind every step, and before the first */
SltStatus fit_take_best(Fit *f, SltFit *fit, SltError *err);     /* before slt_fit_end */
SltStatus fit_end_frames(Fit *f, SltError *err);                 /* the last one: of the best */
SltStatus fit_write_pictures(Fit *f, SltError *err);
void fit_free_pictures(Fit *f);

#endif
