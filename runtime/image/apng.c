/* Animated PNG (APNG, of the PNG specification's third edition): the chunks of still pictures, each frame's data behind
 * a chunk that says how long it is shown. */
#include <stdlib.h>
#include <string.h>

#include "image.h"

static uint32_t crc(const uint8_t *bytes, size_t n) {
    uint32_t c = 0xffffffffu;
    for (size_t i = 0; i < n; i++) {
        c ^= bytes[i];
        for (int k = 0; k < 8; k++) c = c & 1 ? 0xedb88320u ^ c >> 1 : c >> 1;
    }
    return ~c;
}

static void put32(uint8_t *to, uint32_t v) {
    for (int k = 0; k < 4; k++) to[k] = (uint8_t)(v >> (24 - 8 * k));
}

static uint32_t get32(const uint8_t *at) {
    return (uint32_t)at[0] << 24 | (uint32_t)at[1] << 16 | (uint32_t)at[2] << 8 | at[3];
}

enum { HEAD = 8, CHUNK = 12 }; /* bytes: of the signature; of a chunk beside its data */

/* A chunk of that type at `to`, its data in two parts; the place behind it. */
static uint8_t *put_chunk(uint8_t *to, const char *type, const void *a, size_t na, const void *b, size_t nb) {
    put32(to, (uint32_t)(na + nb));
    memcpy(to + 4, type, 4);
    if (na) memcpy(to + 8, a, na);
    if (nb) memcpy(to + 8 + na, b, nb);
    put32(to + 8 + na + nb, crc(to + 4, 4 + na + nb));
    return to + CHUNK + na + nb;
}

static uint8_t *put_control(uint8_t *to, uint32_t *sequence, const uint8_t *header, uint32_t milliseconds) {
    uint8_t v[26] = {0};
    put32(v, (*sequence)++);
    memcpy(v + 4, header + HEAD + 8, 8); /* the size, of IHDR */
    v[20] = (uint8_t)(milliseconds >> 8), v[21] = (uint8_t)milliseconds;
    v[22] = 1000 >> 8, v[23] = 1000 & 255;
    return put_chunk(to, "fcTL", v, sizeof v, NULL, 0);
}

SltStatus image_join_png(const char *name, const ImageFrame *frames, uint32_t count, uint8_t **bytes, size_t *size,
                         SltError *err) {
    enum { HEADER_END = HEAD + CHUNK + 13 };
    size_t room = 64;
    *bytes = NULL, *size = 0;
    for (uint32_t k = 0; k < count; k++) {
        if (frames[k].size < HEADER_END || memcmp(frames[k].png, frames[0].png, HEADER_END) != 0)
            return status_fail(err, SLT_USAGE, "'%s': the frames of an animation are PNG files of one size and kind",
                               name);
        room += 2 * frames[k].size + 64; /* a small chunk grows by 4 bytes */
    }
    uint8_t *out = count ? malloc(room) : NULL, *to = out, v[8];
    if (!out) return status_fail(err, SLT_LIMIT, "'%s': out of memory", name);
    uint32_t sequence = 0;
    memcpy(to, frames[0].png, HEADER_END);
    to += HEADER_END;
    put32(v, count), put32(v + 4, 0); /* plays for ever */
    to = put_chunk(to, "acTL", v, sizeof v, NULL, 0);
    for (uint32_t k = 0; k < count; k++) {
        const uint8_t *at = frames[k].png + HEADER_END, *end = frames[k].png + frames[k].size;
        bool told = false;
        for (uint32_t n; end - at >= CHUNK && (n = get32(at)) <= (size_t)(end - at) - CHUNK; at += CHUNK + n) {
            bool data = !memcmp(at + 4, "IDAT", 4);
            if (data && !told) to = put_control(to, &sequence, frames[0].png, frames[k].milliseconds), told = true;
            if (data && k) {
                put32(v, sequence++);
                to = put_chunk(to, "fdAT", v, 4, at + 8, n);
            } else if (data || (!k && memcmp(at + 4, "IEND", 4) != 0)) {
                memcpy(to, at, CHUNK + n);
                to += CHUNK + n;
            }
        }
    }
    to = put_chunk(to, "IEND", NULL, 0, NULL, 0);
    *bytes = out, *size = (size_t)(to - out);
    return SLT_OK;
}
