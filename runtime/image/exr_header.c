/* The headers of an EXR file, counted before OpenEXR's core reads them: its time goes by the square of the number of
 * attributes, and of channels. What is damaged ends the count here as it ends the reading there. */
#include "internal.h"

#include <stdlib.h>
#include <string.h>

enum { ATTRIBUTES_MAX = 1 << 14, NAME_MAX_SIZE = 256, CHANNEL_BYTES = 16 };

typedef struct Cursor {
    const uint8_t *at, *end;
} Cursor;

/* The text at the cursor, which is put behind it; NULL where none ends soon enough. */
static const char *take_text(Cursor *c) {
    size_t left = (size_t)(c->end - c->at);
    const char *text = (const char *)c->at;
    const uint8_t *zero = left ? memchr(c->at, 0, left < NAME_MAX_SIZE ? left : NAME_MAX_SIZE) : NULL;
    if (!zero) return NULL;
    c->at = zero + 1;
    return text;
}

static int count_channels(Cursor c) {
    int n = 0;
    for (const char *name; (name = take_text(&c)) && *name && c.end - c.at >= CHANNEL_BYTES; n++) c.at += CHANNEL_BYTES;
    return n;
}

SltStatus image_check_exr_headers(const char *name, const uint8_t *bytes, size_t size, SltError *err) {
    enum { FLAGS = 5, SEVERAL_PARTS = 0x10, VERSION_END = 8 };
    if (size < VERSION_END) return SLT_OK;
    Cursor c = {bytes + VERSION_END, bytes + size};
    int attributes = 0, channels = 0;
    bool several = bytes[FLAGS] & SEVERAL_PARTS, in_part = false;
    for (const char *attribute; (attribute = take_text(&c));) {
        if (!*attribute) { /* a header ends; of several the last is empty */
            if (!several || !in_part) break;
            in_part = false;
            continue;
        }
        in_part = true;
        const char *type = take_text(&c);
        if (!type || c.end - c.at < 4) break;
        uint32_t claimed =
            (uint32_t)c.at[0] | (uint32_t)c.at[1] << 8 | (uint32_t)c.at[2] << 16 | (uint32_t)c.at[3] << 24;
        c.at += 4;
        if (claimed > (size_t)(c.end - c.at)) break;
        if (!strcmp(type, "chlist")) channels += count_channels((Cursor){c.at, c.at + claimed});
        if (++attributes > ATTRIBUTES_MAX)
            return status_fail(err, SLT_LIMIT, "'%s' has more than %d attributes", name, ATTRIBUTES_MAX);
        if (channels > IMAGE_MAX_CHANNELS)
            return status_fail(err, SLT_LIMIT, "'%s' has more than %d channels", name, IMAGE_MAX_CHANNELS);
        c.at += claimed;
    }
    return SLT_OK;
}
