/* Files of pictures: the rows of formats.def, found by extension. */
#include "internal.h"

#include <ctype.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static const ImageFormat formats[] = {
#define ROW(extension, write, as_table, name, magic) \
    {#extension, image_decode_##extension, write, as_table, {INT_MAX, name, magic}},
#define FORMAT(extension, ...) ROW(extension, image_encode_##extension, __VA_ARGS__)
#define FORMAT_READ(extension, ...) ROW(extension, NULL, __VA_ARGS__)
#include "formats.def"
#undef FORMAT
#undef FORMAT_READ
#undef ROW
};
enum { FORMATS = sizeof formats / sizeof *formats };

const char *image_path_extension(const char *path, char buf[16]) {
    const char *slash = strrchr(path, '/'), *base = slash ? slash + 1 : path, *dot = strrchr(base, '.');
    size_t n = 0;
    if (dot && strlen(dot + 1) < 16)
        for (; dot[1 + n]; n++) buf[n] = (char)tolower((unsigned char)dot[1 + n]);
    buf[n] = 0;
    return buf;
}

const ImageFormat *image_find_format(const char *name) {
    char ext[16];
    image_path_extension(name, ext);
    for (int k = 0; k < FORMATS; k++)
        if (!strcmp(formats[k].extension, ext)) return &formats[k];
    return NULL;
}

const char *image_list_formats(bool written, char buf[IMAGE_LIST_SIZE]) {
    size_t n = 0;
    buf[0] = 0;
    for (int k = 0; k < FORMATS; k++)
        if (n < IMAGE_LIST_SIZE && (!written || formats[k].write))
            n += (size_t)snprintf(buf + n, IMAGE_LIST_SIZE - n, "%s.%s", n ? " " : "", formats[k].extension);
    return buf;
}

static SltStatus refuse(const char *name, bool written, SltError *err) {
    char known[IMAGE_LIST_SIZE];
    return status_fail(err, written ? SLT_USAGE : SLT_INPUT, "cannot %s '%s': the extension is none of %s",
                       written ? "write" : "read", name, image_list_formats(written, known));
}

SltStatus image_decode(const char *name, const void *bytes, size_t size, const ImageReadOptions *opt, Image *out,
                       SltError *err) {
    static const ImageReadOptions usual = {0};
    const ImageFormat *format = image_find_format(name);
    *out = (Image){0};
    if (!format) return refuse(name, false, err);
    return format->read(name, bytes, size, opt ? opt : &usual, out, err);
}

SltStatus image_read(const char *path, const ImageReadOptions *opt, Image *out, SltError *err) {
    uint8_t *bytes;
    size_t size;
    *out = (Image){0};
    const ImageFormat *format = image_find_format(path);
    if (!format) {
        const char *why;
        int fd = file_open_regular(path, &size, &why);
        if (fd < 0) return status_fail(err, SLT_INPUT, "cannot read '%s': %s", path, why);
        close(fd);
        return refuse(path, false, err);
    }
    SltStatus status = file_read_all(path, &format->kind, &bytes, &size, err);
    if (status == SLT_OK) status = image_decode(path, bytes, size, opt, out, err);
    free(bytes);
    return status;
}

bool image_can_write(const char *path) {
    const ImageFormat *format = image_find_format(path);
    return format && format->write;
}

static SltStatus encode(const char *name, const Image *im, const ImageWriteOptions *opt, Bytes *out, SltError *err) {
    static const ImageWriteOptions usual = {0};
    const ImageFormat *format = image_find_format(name);
    if (!format || !format->write) return refuse(name, true, err);
    return format->write(name, im, opt ? opt : &usual, out, err);
}

SltStatus image_encode(const char *name, const Image *im, const ImageWriteOptions *opt, uint8_t **bytes, size_t *size,
                       SltError *err) {
    Bytes b = {0};
    SltStatus status = encode(name, im, opt, &b, err);
    if (status == SLT_OK && b.failed) status = status_fail(err, SLT_LIMIT, "cannot write '%s': out of memory", name);
    if (status != SLT_OK) image_bytes_free(&b);
    *bytes = b.data;
    *size = b.size;
    return status;
}

SltStatus image_write(const char *path, const Image *im, const ImageWriteOptions *opt, SltError *err) {
    Bytes b = {0};
    if (im->incomplete) return status_fail(err, SLT_LIMIT, "cannot write '%s': out of memory", path);
    return image_bytes_save(&b, path, encode(path, im, opt, &b, err), err);
}
