/* Images, arrays and pictures, and whole files in and out.
 *
 * An Image is floats in interleaved channels, **top row first**:
 *
 *     data[(y * width + x) * channels + c]    0 <= x < width, 0 <= y < height, y = 0 at the top
 *
 * Colours are linear. Values are whatever they are: negative, above one, NaN and infinite numbers
 * survive every float format unchanged. Ownership: `image_free` releases what an Image holds; a
 * caller may also fill the struct with pointers of its own as a *view* for the writers (names and
 * attrs may be NULL), and must then not call image_free.
 *
 * Files: every reader takes untrusted input. A file that is missing, truncated, damaged or too
 * large gives an SltError that names it and the cause, leaves the result empty, and never costs
 * more than 64 MiB + 2048 bytes for each byte of the file. Every writer builds the file in memory
 * and hands it to `file_write_atomic`, so an output appears whole or not at all.
 *
 * Threads: no global state; two threads may read and write different files and Images at once. */
#ifndef SALTUS_RUNTIME_IMAGE_H
#define SALTUS_RUNTIME_IMAGE_H

#include "../base/status.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    IMAGE_NAME_SIZE = 256, /* a channel name with its NUL */
    IMAGE_MAX_CHANNELS = 4096,
    IMAGE_MAX_SAMPLES = 1 << 28, /* width * height * channels: 1 GiB of floats */
    IMAGE_MAX_SIDE = 1 << 20
};

/* A header attribute of an EXR file: a text, or a number when text is NULL. */
typedef struct ImageAttr {
    char *name, *text;
    double number;
} ImageAttr;

typedef struct Image {
    int width, height, channels;
    float *data;
    char (*names)[IMAGE_NAME_SIZE]; /* by channel: "R", "d.radius.G"; NULL: default names */
    ImageAttr *attrs;               /* [attr_count] */
    int attr_count;
    bool incomplete; /* an attribute was lost for want of memory: such an image is not written */
} Image;

/* image.c ------------------------------------------------------------------------------------- */

/* Makes a zero image with default names (1: Y; 2: Y A; 3: R G B; 4: R G B A; else c0 c1 ...). `out`
 * need not be initialised and is empty on failure (SLT_LIMIT when too large or out of memory,
 * SLT_USAGE for a size < 1). */
SltStatus image_create(Image *out, int width, int height, int channels, SltError *err);

/* Frees what the image holds and empties it. NULL and an empty image are fine. */
void image_free(Image *im);

/* Names channel c; a longer name is cut to 255 bytes. The image must own its names. */
void image_set_name(Image *im, int c, const char *name);

/* The name of channel c: its own, or the default one, written to `buf`. Returns buf. */
const char *image_get_name(const Image *im, int c, char buf[IMAGE_NAME_SIZE]);

/* The index of a channel by its exact name, or -1. */
int image_find_channel(const Image *im, const char *name);

/* Adds or replaces an attribute (kept by EXR files, ignored by other formats). False when out of
 * memory. */
bool image_set_text(Image *im, const char *name, const char *text);
bool image_set_number(Image *im, const char *name, double number);
/* The attribute of that name, or NULL. */
const ImageAttr *image_find_attr(const Image *im, const char *name);

/* Copies the channels of one layer ("" is the root, "d.radius" a layer) into a new image whose
 * names have lost the layer's prefix. SLT_INPUT when there is no such layer. */
SltStatus image_extract_layer(const Image *im, const char *layer, Image *out, SltError *err);

/* Makes `out` with exactly `channels` (1 to 4) channels, as a texture or a target needs: grey is
 * spread to colour, colour becomes luminance, a missing alpha is 1, channels beyond the root layer
 * are dropped. */
SltStatus image_convert_channels(const Image *im, int channels, Image *out, SltError *err);
/* The same of an image that is given away, which stays as it is where it has these channels in that order. It is freed
 * where this fails, too. */
SltStatus image_take_channels(Image *im, int channels, Image *out, SltError *err);

/* Resizes: along each axis the mean over the covered area when it shrinks (sums are kept), bilinear
 * with clamped borders when it grows. NaN spreads to the pixels that use it. */
SltStatus image_resize(const Image *im, int width, int height, Image *out, SltError *err);

/* Puts images side by side, `gap` white pixels apart, tops aligned. All must have the same number
 * of channels (1-4). */
SltStatus image_film_strip(const Image *const *images, int count, int gap, Image *out, SltError *err);

/* IEC 61966-2-1. Encoding clamps to [0, 1] (NaN to 0); decoding expects [0, 1]. */
float image_encode_srgb(float linear);
float image_decode_srgb(float encoded);
/* Relative luminance of linear BT.709 colour. */
float image_luminance(float r, float g, float b);

/* format.c: files, by the rows of formats.def ---------------------------------------------------- */

/* Reading, by extension: .exr .png .pfm .npy .f32 (NAME_WxH.f32 or NAME_WxHxC.f32; little-endian,
 * top row first) .hgt (a square of big-endian int16, top row first; voids, -32768, are filled from
 * their surroundings, and refused beyond a quarter). */
typedef struct ImageReadOptions {
    bool raw; /* PNG: samples are data (heights), value / maximum, not sRGB colour */
} ImageReadOptions;

/* `opt` may be NULL. EXR: all flat parts of equal windows; half, uint and float become float; root
 * channels come first, each layer in the order R G B A (or Y A); pixels are those of the display
 * window. PNG: 1-4 channels, linear. NPY: rows x columns [x channels], numbers as they are, also
 * integers. */
SltStatus image_read(const char *path, const ImageReadOptions *opt, Image *out, SltError *err);

/* The same from memory; `name` is used for the format (its extension) and in messages. */
SltStatus image_decode(const char *name, const void *bytes, size_t size, const ImageReadOptions *opt, Image *out,
                       SltError *err);

typedef struct ImageWriteOptions {
    bool raw;  /* PNG: write values in [0, 1] as they are instead of sRGB */
    int bits;  /* PNG: 8 (0 means 8) or 16 */
    bool wide; /* NPY: float64 instead of float32 */
} ImageWriteOptions;

/* Writes by extension: .exr (float32, ZIP, all channels and attributes), .png (root layer, 1-4
 * channels), .pfm (root layer, 1 or 3 channels; an alpha is dropped), .npy (rows x columns x
 * channels, all channels). `opt` may be NULL. SLT_USAGE for an unknown extension, SLT_OUTPUT with
 * the system's reason when the file cannot be written. */
SltStatus image_write(const char *path, const Image *im, const ImageWriteOptions *opt, SltError *err);

/* The same into memory: a malloc'd file in *bytes, for the caller to free. `name` is used for the format and in
 * messages. */
SltStatus image_encode(const char *name, const Image *im, const ImageWriteOptions *opt, uint8_t **bytes, size_t *size,
                       SltError *err);

/* True when image_write knows the extension. */
bool image_can_write(const char *path);

enum { IMAGE_LIST_SIZE = 128 };
/* The extensions that image_read or image_write knows, ".exr .png ...". Returns buf. */
const char *image_list_formats(bool written, char buf[IMAGE_LIST_SIZE]);

/* png.c --------------------------------------------------------------------------------------- */

/* Writes already encoded 8-bit pixels, 1 (grey), 2 (grey, alpha), 3 or 4 channels, top row first,
 * no padding. */
SltStatus image_write_png8(const char *path, int width, int height, int channels, const uint8_t *pixels, SltError *err);

/* The same into memory: a malloc'd PNG file in *bytes, for the caller to free. `name` is used in
 * messages. */
SltStatus image_encode_png8(const char *name, int width, int height, int channels, const uint8_t *pixels,
                            uint8_t **bytes, size_t *size, SltError *err);

/* apng.c -------------------------------------------------------------------------------------- */

typedef struct ImageFrame {
    uint8_t *png; /* a PNG file */
    size_t size;
    uint32_t milliseconds; /* how long it is shown; at most 65535 */
} ImageFrame;
/* One animated PNG of still ones, which must be of one size and kind (SLT_USAGE): a malloc'd file in *bytes, for the
 * caller to free. Readers that do not know animations show the first frame. */
SltStatus image_join_png(const char *name, const ImageFrame *frames, uint32_t count, uint8_t **bytes, size_t *size,
                         SltError *err);

/* npy.c --------------------------------------------------------------------------------------- */

typedef struct NumArray {
    int rank;        /* 1 to 4; a 0-dimensional file is read as one element of rank 1 */
    size_t shape[4]; /* unused entries are 1 */
    double *data;    /* C order, malloc'd */
} NumArray;

/* Reads floats (16, 32, 64 bits), integers (8 to 64) and bools, either byte order, C or Fortran
 * order. */
SltStatus npy_read(const char *path, NumArray *out, SltError *err);
SltStatus npy_decode(const char *name, const void *bytes, size_t size, NumArray *out, SltError *err);
void npy_free(NumArray *a);
/* Writes C-ordered data of rank 1 to 4 as float64 (wide) or float32. */
SltStatus npy_write(const char *path, int rank, const size_t *shape, const double *data, bool wide, SltError *err);

/* volume.c ------------------------------------------------------------------------------------ */

/* A volume is an Image of its slices below each other, z = 0 first: depth * rows rows. Read from a .npy (slices x rows
 * x columns [x channels]), a folder (its .exr files by name, a slice each), a pattern (slice%04d.exr, from 0 or 1 on),
 * or an EXR that volume_write made. */
SltStatus volume_read(const char *path, const ImageReadOptions *opt, Image *out, int *depth, SltError *err);
/* By the same names: a folder (one that is there, or a name that ends in `/`: 0000.exr and on), a pattern, a .npy, or
 * one picture, which gets the attribute `slices`. */
SltStatus volume_write(const char *path, Image *im, int depth, const ImageWriteOptions *opt, SltError *err);
bool volume_can_write(const char *path);
/* Does the path name several files, a folder or a pattern? */
bool volume_is_stack(const char *path);
/* Calls visit with every file of a stack, the lowest slice first, until one fails. */
typedef SltStatus VolumeVisit(void *user, const char *path, SltError *err);
SltStatus volume_each(const char *path, VolumeVisit *visit, void *user, SltError *err);

/* table.c ------------------------------------------------------------------------------------- */

typedef struct Table {
    size_t rows, cols;
    double *data; /* data[row * cols + col], malloc'd */
} Table;

/* Reads a table of numbers: .csv .tsv .txt (comma, semicolon, tab or blanks; `#` comments; one
 * header line of words is skipped; every row must have as many numbers), .npy (rows = first
 * dimension, columns = the others), or an image (rows = its rows, columns = width x channels, PNG
 * as raw data). */
SltStatus table_read(const char *path, Table *out, SltError *err);
SltStatus table_decode_csv(const char *name, const void *bytes, size_t size, Table *out, SltError *err);
void table_free(Table *t);

/* file.c -------------------------------------------------------------------------------------- */

/* What a file must be to be read at all. Nothing is allocated for one that is not. */
typedef struct FileKind {
    size_t limit;     /* bytes */
    const char *name; /* "a PNG file"; wanted with `magic` */
    char magic[9];    /* its first bytes, none of them 0; "": any */
} FileKind;

extern const FileKind file_binary; /* at most 2 GiB */
extern const FileKind file_text;   /* at most 64 MiB: numbers as text take many times their length in memory */

/* Opens a regular file for reading; -1 and the reason (of static life or strerror's) if there is none, or if it is a
 * folder, a pipe, a device, a socket or mostly holes. Never waits. */
int file_open_regular(const char *path, size_t *size, const char **why);

/* Reads a whole regular file into malloc'd memory with a NUL added after it. */
SltStatus file_read_all(const char *path, const FileKind *kind, uint8_t **bytes, size_t *size, SltError *err);

/* file_write.c -------------------------------------------------------------------------------- */

/* Writes a file whole or not at all: a temporary file in the same folder, fsync, rename. The folder is not waited for:
 * should the power fail just then, what was at `path` is there, whole. On any failure the temporary file is removed and
 * what was at `path` stays; what a killed process left is removed by the next one that writes there. A symbolic link is
 * followed; what is not a regular file (a device, a pipe) is written directly. */
SltStatus file_write_atomic(const char *path, const void *data, size_t size, SltError *err);

/* What this thread writes between begin and end appears together: each file is whole on the disk before the first takes
 * its place, and with a `status` other than SLT_OK none does. Where one place cannot be taken, what was there before is
 * put back in the others; a file system without hard links keeps no old file to put back, and a process that is killed
 * between two places leaves them different. Returns the status, or why a place could not be taken. */
typedef struct FileGroup {
    struct Staged *first, **last;
} FileGroup;

void file_group_begin(FileGroup *g);
SltStatus file_group_end(FileGroup *g, SltStatus status, SltError *err);

/* colormap.c ---------------------------------------------------------------------------------- */

/* Encoded sRGB in [0, 255]. Diverging: t in [-1, 1], blue - near white - red; sequential: t in [0,
 * 1], dark to light. Outside is clamped; NaN is magenta, which neither map contains. */
void colormap_diverging(double t, uint8_t rgb[3]);
void colormap_sequential(double t, uint8_t rgb[3]);

/* Draws one channel (or, with channel = -1, the mean of the root R G B) as a signed diverging map
 * with a colour bar, the scale in numbers and `title` (may be NULL) printed below, and writes a
 * PNG. `scale` > 0 is the value of full colour; 0 takes the largest finite magnitude. Pictures
 * narrower than 256 pixels are enlarged by whole factors. */
SltStatus image_write_diverging(const char *path, const Image *im, int channel, double scale, const char *title,
                                SltError *err);
/* The same, as an 8-bit RGB picture in memory (malloc'd pixels, 3 channels). */
SltStatus image_draw_diverging(const Image *im, int channel, double scale, const char *title, uint8_t **pixels,
                               int *width, int *height, SltError *err);

/* font.c: a built-in 5x7 bitmap font ---------------------------------------------------------- */

/* Pixels of the text's width at whole-number `zoom`; the height is 7 * zoom (9 with descenders). */
int font_measure(const char *text, int zoom);
/* Draws into 8-bit RGB, clipped; (x, y) is the top left. Characters without a glyph are a box. */
void font_draw(uint8_t *rgb, int width, int height, int x, int y, const char *text, int zoom, const uint8_t colour[3]);

/* plot.c -------------------------------------------------------------------------------------- */

typedef struct PlotSeries {
    const char *name;
    const double *x, *y;
    const double *error; /* NULL, or a standard error for each point, drawn as a bar */
    int count;
    bool dashed; /* a reference line, without markers */
} PlotSeries;

typedef struct PlotOptions {
    const char *title, *x_label, *y_label; /* NULL for none */
    bool log_x, log_y;
    int width, height; /* 0: 760 x 480 */
} PlotOptions;

/* A self-contained SVG document as a malloc'd string, NULL with `err` set on failure. Points that
 * are not finite, or not positive on a logarithmic axis, are left out and break the line. */
char *plot_svg(const PlotOptions *opt, const PlotSeries *series, int count, SltError *err);

#ifdef __cplusplus
}
#endif
#endif
