/* Volumes: slices of one size, z = 0 first, below each other in one Image. A file is a NumPy array of three or four
 * dimensions, a picture that says how many slices it holds, or a stack: one picture a slice, in a folder or by a
 * pattern with the slice's number in it. */
#include "internal.h"

#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

enum { PATH_SIZE = 4096 };
static const char slices_name[] = "slices"; /* attribute of an EXR that holds a volume */

static bool is_folder(const char *path) {
    struct stat s;
    size_t n = strlen(path);
    return (n && path[n - 1] == '/') || (stat(path, &s) == 0 && S_ISDIR(s.st_mode));
}

/* Where the number of a slice stands in a path: `%d` or `%04d`, once. */
typedef struct Pattern {
    const char *at; /* NULL: nowhere */
    int digits;
    size_t length;
} Pattern;

static Pattern pattern_in(const char *path) {
    const char *at = strchr(path, '%');
    if (!at || strchr(at + 1, '%')) return (Pattern){0};
    bool padded = at[1] == '0' && at[2] >= '1' && at[2] <= '9';
    Pattern p = {at, padded ? at[2] - '0' : 0, padded ? 4 : 2};
    return at[p.length - 1] == 'd' ? p : (Pattern){0};
}

static bool slice_path(const char *pattern, int slice, char path[PATH_SIZE]) {
    Pattern p = pattern_in(pattern);
    return snprintf(path, PATH_SIZE, "%.*s%0*d%s", (int)(p.at - pattern), pattern, p.digits, slice, p.at + p.length) <
           PATH_SIZE;
}

bool volume_is_stack(const char *path) { return pattern_in(path).at || is_folder(path); }

/* ---- reading */

static SltStatus read_npy(const char *path, Image *out, int *depth, SltError *err) {
    NumArray a;
    SltStatus status = npy_read(path, &a, err);
    if (status != SLT_OK) return status;
    if (a.rank < 3)
        status = status_fail(err, SLT_INPUT,
                             "cannot read '%s' as a volume: it has %d dimension%s (slices, rows, columns and perhaps "
                             "channels are wanted)",
                             path, a.rank, a.rank == 1 ? "" : "s");
    else if (a.shape[3] > IMAGE_MAX_CHANNELS || a.shape[2] > IMAGE_MAX_SIDE || a.shape[0] * a.shape[1] > IMAGE_MAX_SIDE)
        status = status_fail(err, SLT_LIMIT, "'%s' is too large: slices x rows are at most 2^20", path);
    else status = image_create(out, (int)a.shape[2], (int)(a.shape[0] * a.shape[1]), (int)a.shape[3], err);
    size_t n = a.shape[0] * a.shape[1] * a.shape[2] * a.shape[3];
    for (size_t i = 0; status == SLT_OK && i < n; i++) out->data[i] = (float)a.data[i];
    *depth = (int)a.shape[0];
    npy_free(&a);
    return status;
}

/* Puts the next slice below those that `out` has; frees it. */
static SltStatus add_slice(Image *out, int *depth, Image *slice, const char *path, SltError *err) {
    size_t each = (size_t)slice->width * (size_t)slice->height * (size_t)slice->channels;
    SltStatus status = SLT_OK;
    if (!*depth) {
        *out = *slice, *depth = 1;
        return status;
    }
    int rows = out->height / *depth;
    if (slice->width != out->width || slice->height != rows || slice->channels != out->channels)
        status = status_fail(err, SLT_INPUT, "%s is %dx%d with %d channels, but the slices before it are %dx%d with %d",
                             path, slice->width, slice->height, slice->channels, out->width, rows, out->channels);
    else if ((double)each * (*depth + 1) > IMAGE_MAX_SAMPLES || out->height + rows > IMAGE_MAX_SIDE)
        status = status_fail(err, SLT_LIMIT, "%s: with it the volume is too large (at most 2^28 numbers)", path);
    /* Room doubles: a stack of n slices is not copied n times. */
    bool full = !(*depth & (*depth - 1));
    float *data = status == SLT_OK && full ? realloc(out->data, 2 * (size_t)*depth * each * sizeof *data) : out->data;
    if (!data) status = status_fail(err, SLT_LIMIT, "%s: out of memory", path);
    else out->data = data;
    if (status == SLT_OK) {
        memcpy(out->data + (size_t)*depth * each, slice->data, each * sizeof *data);
        out->height += rows, ++*depth;
    }
    image_free(slice);
    return status;
}

static SltStatus each_of_pattern(const char *pattern, VolumeVisit *visit, void *user, SltError *err) {
    char path[PATH_SIZE];
    struct stat s;
    SltStatus status = SLT_OK;
    for (int k = 0, seen = 0; status == SLT_OK; k++) {
        if (!slice_path(pattern, k, path)) return status_fail(err, SLT_INPUT, "'%s': the path is too long", pattern);
        if (stat(path, &s) != 0) {
            if (k == 0) continue; /* they may begin at 1 */
            if (seen) return SLT_OK;
            return status_fail(err, SLT_INPUT, "cannot read '%s': there is no slice 0 or 1 ('%s')", pattern, path);
        }
        status = visit(user, path, err), seen++;
    }
    return status;
}

static int by_name(const struct dirent **a, const struct dirent **b) { return strcmp((*a)->d_name, (*b)->d_name); }

static int is_exr(const struct dirent *e) {
    char extension[16];
    return e->d_name[0] != '.' && !strcmp(image_path_extension(e->d_name, extension), "exr");
}

static SltStatus each_of_folder(const char *folder, VolumeVisit *visit, void *user, SltError *err) {
    struct dirent **list = NULL;
    char path[PATH_SIZE];
    SltStatus status = SLT_OK;
    int n = scandir(folder, &list, is_exr, by_name);
    if (n < 0) return status_fail_errno(err, SLT_INPUT, errno, "cannot read the folder '%s'", folder);
    if (n == 0) status = status_fail(err, SLT_INPUT, "there are no slices in '%s': .exr files are wanted", folder);
    for (int k = 0; k < n; k++) {
        if (status == SLT_OK && snprintf(path, sizeof path, "%s/%s", folder, list[k]->d_name) >= (int)sizeof path)
            status = status_fail(err, SLT_INPUT, "'%s': the path is too long", folder);
        if (status == SLT_OK) status = visit(user, path, err);
        free(list[k]);
    }
    free(list);
    return status;
}

SltStatus volume_each(const char *path, VolumeVisit *visit, void *user, SltError *err) {
    return (pattern_in(path).at ? each_of_pattern : each_of_folder)(path, visit, user, err);
}

typedef struct Stack {
    const ImageReadOptions *opt;
    Image *out;
    int *depth;
} Stack;

static SltStatus read_slice(void *user, const char *path, SltError *err) {
    Stack *s = user;
    Image slice;
    SltStatus status = image_read(path, s->opt, &slice, err);
    return status == SLT_OK ? add_slice(s->out, s->depth, &slice, path, err) : status;
}

/* A picture of slices below each other. */
static SltStatus read_picture(const char *path, const ImageReadOptions *opt, Image *out, int *depth, SltError *err) {
    SltStatus status = image_read(path, opt, out, err);
    if (status != SLT_OK) return status;
    const ImageAttr *a = image_find_attr(out, slices_name);
    double slices = a && !a->text ? a->number : 0;
    if (slices >= 1 && slices <= out->height && out->height % (int)slices == 0) return *depth = (int)slices, SLT_OK;
    return status_fail(err, SLT_INPUT,
                       "%s is one picture: a volume is a .npy of three dimensions, a folder of slices (.exr), or a "
                       "pattern like slice%%04d.exr",
                       path);
}

SltStatus volume_read(const char *path, const ImageReadOptions *opt, Image *out, int *depth, SltError *err) {
    char extension[16];
    SltStatus status;
    *out = (Image){0}, *depth = 0;
    Stack stack = {opt, out, depth};
    if (volume_is_stack(path)) status = volume_each(path, read_slice, &stack, err);
    else if (!strcmp(image_path_extension(path, extension), "npy")) status = read_npy(path, out, depth, err);
    else status = read_picture(path, opt, out, depth, err);
    if (status != SLT_OK) image_free(out), *depth = 0;
    return status;
}

/* ---- writing */

bool volume_can_write(const char *path) {
    return is_folder(path) || (image_can_write(path) && (!strchr(path, '%') || pattern_in(path).at));
}

static SltStatus write_stack(const char *pattern, const Image *im, int depth, const ImageWriteOptions *opt,
                             SltError *err) {
    char path[PATH_SIZE];
    Image slice = *im;
    SltStatus status = SLT_OK;
    FileGroup files;
    slice.height = im->height / depth;
    file_group_begin(&files);
    for (int k = 0; status == SLT_OK && k < depth; k++) {
        slice.data = im->data + (size_t)k * (size_t)slice.height * (size_t)im->width * (size_t)im->channels;
        status = slice_path(pattern, k, path) ? image_write(path, &slice, opt, err)
                                              : status_fail(err, SLT_OUTPUT, "'%s': the path is too long", pattern);
    }
    return file_group_end(&files, status, err);
}

SltStatus volume_write(const char *path, Image *im, int depth, const ImageWriteOptions *opt, SltError *err) {
    char extension[16], pattern[PATH_SIZE];
    if (is_folder(path)) {
        if (mkdir(path, 0777) != 0 && errno != EEXIST)
            return status_fail_errno(err, SLT_OUTPUT, errno, "cannot make the folder %s", path);
        if (strchr(path, '%') || snprintf(pattern, sizeof pattern, "%s/%%04d.exr", path) >= (int)sizeof pattern)
            return status_fail(err, SLT_OUTPUT, "'%s' cannot be the folder of a volume", path);
        return write_stack(pattern, im, depth, opt, err);
    }
    if (pattern_in(path).at) return write_stack(path, im, depth, opt, err);
    if (!strcmp(image_path_extension(path, extension), "npy")) {
        size_t shape[4] = {(size_t)depth, (size_t)(im->height / depth), (size_t)im->width, (size_t)im->channels};
        Bytes b = {0};
        return image_bytes_save(&b, path, npy_encode(4, shape, im->data, NULL, false, &b, err), err);
    }
    if (!image_set_number(im, slices_name, depth)) return status_fail(err, SLT_LIMIT, "out of memory");
    return image_write(path, im, opt, err);
}
