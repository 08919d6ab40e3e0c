/* Any bytes as an image, an array or a table. The first byte chooses the format. What was read is written and read
 * again. */
#include <stdlib.h>
#include <string.h>

#include "runtime/image/image.h"
#include "tests/fuzz/fuzz.h"

/* What was written is read, of the same size; PNG and PFM leave out channels that are no colour. */
static void write_and_read(const char *name, const Image *im) {
    SltError err = {0};
    Image again;
    uint8_t *bytes;
    size_t n;
    if (image_encode(name, im, NULL, &bytes, &n, &err) != SLT_OK) return;
    if (image_decode(name, bytes, n, NULL, &again, &err) != SLT_OK) abort();
    if (again.width != im->width || again.height != im->height) abort();
    if ((!strcmp(name, "b.exr") || !strcmp(name, "b.npy")) && again.channels != im->channels) abort();
    image_free(&again);
    free(bytes);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const char *const names[] = {
#define FORMAT(extension, ...) "a_4x3." #extension,
#define FORMAT_READ FORMAT
#include "runtime/image/formats.def"
#undef FORMAT
#undef FORMAT_READ
        "a_2x2x3.f32",
    };
    enum { NAMES = sizeof names / sizeof *names };
    if (size < 1 || size > 1 << 18) return 0;
    SltError err = {0};
    uint32_t kind = data[0] % (NAMES + 2);
    data++, size--;
    if (kind == NAMES) {
        NumArray a;
        if (npy_decode("a.npy", data, size, &a, &err) == SLT_OK) npy_free(&a);
        return 0;
    }
    if (kind == NAMES + 1) {
        Table t;
        if (table_decode_csv("a.csv", data, size, &t, &err) == SLT_OK) table_free(&t);
        return 0;
    }
    Image im, part, small;
    ImageReadOptions raw = {.raw = size & 1};
    if (image_decode(names[kind], data, size, &raw, &im, &err) != SLT_OK) return 0;
    if ((double)im.width * im.height * im.channels < 1 << 16) {
        if (image_extract_layer(&im, "", &part, &err) == SLT_OK) {
            if (image_convert_channels(&part, 3, &small, &err) == SLT_OK) image_free(&small);
            image_free(&part);
        }
        if (image_resize(&im, 3, 2, &small, &err) == SLT_OK) image_free(&small);
        static const char *const written[] = {
#define FORMAT(extension, ...) "b." #extension,
#define FORMAT_READ(...)
#include "runtime/image/formats.def"
#undef FORMAT
#undef FORMAT_READ
        };
        for (size_t i = 0; i < sizeof written / sizeof *written; i++) write_and_read(written[i], &im);
    }
    image_free(&im);
    return 0;
}
