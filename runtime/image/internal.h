/* What the files of this folder share. */
#ifndef SALTUS_RUNTIME_IMAGE_INTERNAL_H
#define SALTUS_RUNTIME_IMAGE_INTERNAL_H

#include "image.h"

/* A growing byte buffer. `failed` is sticky, so that callers may check once at the end. */
typedef struct Bytes {
    uint8_t *data;
    size_t size, capacity;
    bool failed;
} Bytes;

bool image_bytes_reserve(Bytes *b, size_t capacity);
void image_bytes_append(Bytes *b, const void *data, size_t size);
void image_bytes_write_at(Bytes *b, size_t offset, const void *data, size_t size); /* fills gaps with zeros */
void image_bytes_printf(Bytes *b, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
void image_bytes_free(Bytes *b);
/* Writes the buffer to a file if `filled`, the status of what filled it, is SLT_OK; else returns that status. Frees the
 * buffer. */
SltStatus image_bytes_save(Bytes *b, const char *path, SltStatus filled, SltError *err);

/* Refuses (SLT_INPUT) an image whose floats are out of all proportion to the bytes of the file that claims it, and
 * (SLT_LIMIT) one that is too large. */
SltStatus image_check_claim(const char *name, double width, double height, double channels, size_t file_size,
                            SltError *err);

/* exr_header.c: refuses (SLT_LIMIT) headers with so many attributes or channels that reading them would not end. */
SltStatus image_check_exr_headers(const char *name, const uint8_t *bytes, size_t size, SltError *err);

/* Channel indices of the root layer in picture order (R G B [A], Y [A], or the first ones); returns
 * how many, 1 to 4. */
int image_root_channels(const Image *im, int index[4]);

/* The extension without its dot, in lower case, "" if there is none. */
const char *image_path_extension(const char *path, char buf[16]);

/* The functions that formats.def names. A reader gets the whole file and leaves `out` empty on failure; a writer
 * appends to `out`. Both call the file `name` in messages, and their options are never NULL. */
typedef SltStatus ImageReader(const char *name, const uint8_t *bytes, size_t size, const ImageReadOptions *opt,
                              Image *out, SltError *err);
typedef SltStatus ImageWriter(const char *name, const Image *im, const ImageWriteOptions *opt, Bytes *out,
                              SltError *err);

typedef struct ImageFormat {
    const char *extension;
    ImageReader *read;
    ImageWriter *write;
    bool as_table;
    FileKind kind;
} ImageFormat;

/* The format of the name's extension, or NULL. */
const ImageFormat *image_find_format(const char *name);

#define FORMAT_READ(extension, ...) ImageReader image_decode_##extension;
#define FORMAT(extension, ...) FORMAT_READ(extension, __VA_ARGS__) ImageWriter image_encode_##extension;
#include "runtime/image/formats.def"
#undef FORMAT
#undef FORMAT_READ

/* npy.c: a file of float64 (as_double) or float32 from numbers in `narrow` or `wide`, of which one is NULL. */
SltStatus npy_encode(int rank, const size_t *shape, const float *narrow, const double *wide, bool as_double, Bytes *out,
                     SltError *err);

#endif
