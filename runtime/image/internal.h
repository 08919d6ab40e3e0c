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

bool image_bytes_reserve(Bytes *b, size_t capacity);
void image_bytes_append(Bytes *b, const void *data, size_t size);
void image_bytes_write_at(Bytes *b, size_t offset, const void *data, size_t size); /* fills gaps with zeros */
void image_bytes_printf(Bytes *b, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
void image_bytes_free(Bytes *b);
/* Writes the file if what filled the buffer went well, passes its status on otherwise. Frees the buffer. */
SltStatus image_bytes_save(Bytes *b, const char *path, SltStatus filled, SltError *err);

/* Refuses an image whose floats are out of all proportion to the file that claims it. */
SltStatus image_check_claim(const char *name, double width, double height, double channels, size_t file_size,
                            SltError *err);

/* Channel indices of the root layer in picture order (R G B [A], Y [A], or the first ones); returns
 * how many, 1 to 4. */
int image_root_channels(const Image *im, int index[4]);

/* The extension without its dot, in lower case, "" if there is none. */
const char *image_path_extension(const char *path, char buf[16]);

SltStatus image_decode_exr(const char *name, const uint8_t *bytes, size_t size, Image *out, SltError *err);
SltStatus image_decode_png(const char *name, const uint8_t *bytes, size_t size, bool raw, Image *out, SltError *err);
SltStatus image_encode_png(const char *name, int width, int height, int channels, int bits, const uint8_t *pixels,
                           Bytes *out, SltError *err);
SltStatus image_decode_pfm(const char *name, const uint8_t *bytes, size_t size, Image *out, SltError *err);
SltStatus image_decode_f32(const char *name, const uint8_t *bytes, size_t size, Image *out, SltError *err);
SltStatus image_decode_hgt(const char *name, const uint8_t *bytes, size_t size, Image *out, SltError *err);
SltStatus image_encode_pfm(const char *name, const Image *im, Bytes *out, SltError *err);
SltStatus image_encode_npy(int rank, const size_t *shape, const float *narrow, const double *wide, bool as_double,
                           Bytes *out, SltError *err);
SltStatus image_decode_npy(const char *name, const uint8_t *bytes, size_t size, Image *out, SltError *err);

#endif
