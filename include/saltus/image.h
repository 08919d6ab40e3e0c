/* Pictures in files, as the command reads and writes them: .exr .png .pfm .npy, and to read .f32 and .hgt too.
 *
 * Pixels are float[height][width][channels], top row first, 1 to 4 channels; size is {width, height}. Colours are
 * linear: those of a PNG go through the curve of sRGB, unless `raw` says that its numbers are taken as they are, from 0
 * to 1. Every file that is read may be hostile; one that is written appears whole or not at all. What comes back by
 * pointer is malloc'd and the caller's to free. */
#ifndef SALTUS_IMAGE_H
#define SALTUS_IMAGE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "saltus/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* size and *channels are both wish and answer: 0 takes what the file has, of an EXR with more than 4 channels those of
 * its root layer. Else the picture is resized: the mean over the covered area where it shrinks, bilinear where it
 * grows. Grey is spread to colour, colour becomes luminance, a missing alpha is 1. SLT_INPUT: there is no such file, or
 * it is damaged. */
SltStatus slt_image_read(const char *path, bool raw, uint32_t size[2], uint32_t *channels, float **pixels,
                         SltError *err);
/* By the extension of path. SLT_USAGE: an unknown one, or a format that lacks these channels. */
SltStatus slt_image_write(const char *path, bool raw, const uint32_t size[2], uint32_t channels, const float *pixels,
                          SltError *err);
/* The same file in memory; format is ".png" or another extension. */
SltStatus slt_image_encode(const char *format, bool raw, const uint32_t size[2], uint32_t channels, const float *pixels,
                           uint8_t **bytes, size_t *nbytes, SltError *err);
/* A PNG file in memory of signed values, the mean of the colour channels: blue below 0, red above. What full colour
 * stands for is `scale`, 0: the largest magnitude there is, and is printed below, behind `title` (may be NULL). */
SltStatus slt_image_encode_signed(double scale, const char *title, const uint32_t size[2], uint32_t channels,
                                  const float *pixels, uint8_t **bytes, size_t *nbytes, SltError *err);

#ifdef __cplusplus
}
#endif
#endif
