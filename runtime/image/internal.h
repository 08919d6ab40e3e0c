/* Shared by the files of this folder only. */
#ifndef SALTUS_RUNTIME_IMAGE_INTERNAL_H
#define SALTUS_RUNTIME_IMAGE_INTERNAL_H

#include "image.h"

/* A growing byte buffer. `failed` is sticky, so that callers may check once at the end. */
typedef struct Bytes {
    uint8_t *data;
    size_t size, capacity;
    bool failed;
} Bytes;

bool bytes_reserve(Bytes *b, size_t capacity);
void bytes_append(Bytes *b, const void *data, size_t size);
void bytes_write_at(Bytes *b, size_t offset, const void *data,
                    size_t size); /* fills gaps with zeros */
void bytes_printf(Bytes *b, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
void bytes_free(Bytes *b);

/* Refuses an image whose floats are out of all proportion to the file that claims it. */
SltStatus check_claim(const char *name, double width, double height, double channels,
                      size_t file_size, SltError *err);

/* Channel indices of the root layer in picture order (R G B [A], Y [A], or the first ones); returns
 * how many, 1 to 4. */
int root_channels(const Image *im, int index[4]);

/* The extension without its dot, in lower case, "" if there is none. */
const char *path_extension(const char *path, char buf[16]);

SltStatus exr_decode(const char *name, const uint8_t *bytes, size_t size, Image *out,
                     SltError *err);
SltStatus png_decode(const char *name, const uint8_t *bytes, size_t size, bool raw, Image *out,
                     SltError *err);
SltStatus png_encode(const char *name, int width, int height, int channels, int bits,
                     const uint8_t *pixels, Bytes *out, SltError *err);
SltStatus pfm_decode(const char *name, const uint8_t *bytes, size_t size, Image *out,
                     SltError *err);
SltStatus f32_decode(const char *name, const uint8_t *bytes, size_t size, Image *out,
                     SltError *err);
SltStatus pfm_encode(const char *name, const Image *im, Bytes *out, SltError *err);
SltStatus npy_encode(int rank, const size_t *shape, const float *narrow, const double *wide,
                     bool as_double, Bytes *out, SltError *err);
SltStatus npy_decode_image(const char *name, const uint8_t *bytes, size_t size, Image *out,
                           SltError *err);

#endif
