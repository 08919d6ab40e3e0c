/* saltus/image.h: pictures of callers, who have no Image. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/image/image.h"
#include "saltus/image.h"

enum { CHANNELS = 4 };

/* A view of the caller's pixels, for the writers. */
static SltStatus view(Image *out, const uint32_t size[2], uint32_t channels, const float *pixels, SltError *err) {
    if (err) *err = (SltError){0};
    if (!size || !pixels) return status_fail(err, SLT_USAGE, "no picture was given");
    if (channels < 1 || channels > CHANNELS)
        return status_fail(err, SLT_USAGE, "a picture has 1 to %d channels, not %u", CHANNELS, channels);
    for (int d = 0; d < 2; d++)
        if (size[d] < 1 || size[d] > IMAGE_MAX_SIDE)
            return status_fail(err, SLT_USAGE, "a picture of %ux%u: sides are 1 to %d", size[0], size[1],
                               IMAGE_MAX_SIDE);
    if ((uint64_t)size[0] * size[1] * channels > IMAGE_MAX_SAMPLES)
        return status_fail(err, SLT_LIMIT,
                           "a picture of %ux%u with %u channels is larger than the limit of 2^28 values", size[0],
                           size[1], channels);
    *out = (Image){
        .width = (int)size[0], .height = (int)size[1], .channels = (int)channels, .data = (float *)(uintptr_t)pixels};
    return SLT_OK;
}

/* Puts the result of a step, if it is one, in the place of what it was made from. */
static SltStatus replace(Image *im, Image *made, SltStatus status) {
    image_free(im);
    if (status == SLT_OK) *im = *made;
    return status;
}

static SltStatus fit(Image *im, const uint32_t size[2], uint32_t channels, SltError *err) {
    Image made;
    SltStatus s = SLT_OK;
    int width = size[0] ? (int)size[0] : im->width, height = size[1] ? (int)size[1] : im->height;
    if (im->channels > CHANNELS) s = replace(im, &made, image_extract_layer(im, "", &made, err));
    if (s == SLT_OK && (width != im->width || height != im->height))
        s = replace(im, &made, image_resize(im, width, height, &made, err));
    int want = channels ? (int)channels : im->channels < CHANNELS ? im->channels : CHANNELS;
    if (s == SLT_OK && want != im->channels) s = replace(im, &made, image_convert_channels(im, want, &made, err));
    return s;
}

SltStatus slt_image_read(const char *path, bool raw, uint32_t size[2], uint32_t *channels, float **pixels,
                         SltError *err) {
    Image im;
    if (err) *err = (SltError){0};
    if (!path || !size || !channels || !pixels)
        return status_fail(err, SLT_USAGE, "no place for the picture was given");
    *pixels = NULL;
    if (size[0] > IMAGE_MAX_SIDE || size[1] > IMAGE_MAX_SIDE || *channels > CHANNELS)
        return status_fail(err, SLT_USAGE, "a picture of %ux%u with %u channels: sides are at most %d, channels %d",
                           size[0], size[1], *channels, IMAGE_MAX_SIDE, CHANNELS);
    SltStatus s = image_read(path, &(ImageReadOptions){.raw = raw}, &im, err);
    if (s != SLT_OK) return s;
    s = fit(&im, size, *channels, err);
    if (s != SLT_OK) return s;
    size[0] = (uint32_t)im.width, size[1] = (uint32_t)im.height, *channels = (uint32_t)im.channels;
    *pixels = im.data, im.data = NULL;
    image_free(&im);
    return SLT_OK;
}

SltStatus slt_image_write(const char *path, bool raw, const uint32_t size[2], uint32_t channels, const float *pixels,
                          SltError *err) {
    Image im;
    SltStatus s = view(&im, size, channels, pixels, err);
    if (s == SLT_OK && !path) s = status_fail(err, SLT_USAGE, "no path was given");
    return s == SLT_OK ? image_write(path, &im, &(ImageWriteOptions){.raw = raw}, err) : s;
}

SltStatus slt_image_encode(const char *format, bool raw, const uint32_t size[2], uint32_t channels, const float *pixels,
                           uint8_t **bytes, size_t *nbytes, SltError *err) {
    Image im;
    char name[32];
    SltStatus s = view(&im, size, channels, pixels, err);
    if (s == SLT_OK && (!format || !bytes || !nbytes))
        s = status_fail(err, SLT_USAGE, "no format, or no place for the file");
    if (s != SLT_OK) return s;
    snprintf(name, sizeof name, "picture%s", format);
    return image_encode(name, &im, &(ImageWriteOptions){.raw = raw}, bytes, nbytes, err);
}

SltStatus slt_image_encode_signed(double scale, const char *title, const uint32_t size[2], uint32_t channels,
                                  const float *pixels, uint8_t **bytes, size_t *nbytes, SltError *err) {
    Image im;
    uint8_t *rgb;
    int width, height;
    SltStatus s = view(&im, size, channels, pixels, err);
    if (s == SLT_OK && (!bytes || !nbytes)) s = status_fail(err, SLT_USAGE, "no place for the file");
    if (s == SLT_OK) s = image_draw_diverging(&im, channels > 1 ? -1 : 0, scale, title, &rgb, &width, &height, err);
    if (s != SLT_OK) return s;
    s = image_encode_png8("picture.png", width, height, 3, rgb, bytes, nbytes, err);
    free(rgb);
    return s;
}
