/* OpenEXR through its C core, from and to memory.
 *
 * The core parses untrusted headers, so everything is bounded twice: the context's limits and an
 * allocator that refuses single blocks out of proportion, and our own checks of windows, tile sizes
 * and channel counts before any pixel memory is taken. Deep data and subsampled channels are
 * refused by name. */
#if defined(__has_include) && __has_include(<openexr.h>)
#include <openexr.h>
#else
#include <OpenEXR/openexr.h>
#endif

#include "internal.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { BLOCK_LIMIT = 256 << 20, TILE_LIMIT = 8192 };

typedef struct Stream {
    const char *name;
    const uint8_t *bytes; /* reading */
    size_t size;
    Bytes out;         /* writing */
    char message[256]; /* the core's first complaint */
} Stream;

/* Zeroed: some decompressors of the core accept a damaged block that fills only a part of its
 * buffer, and what the rest of it holds must not depend on what memory held before. */
static void *alloc_bounded(size_t bytes) { return bytes > BLOCK_LIMIT ? NULL : calloc(1, bytes ? bytes : 1); }

/* The stream that this thread reads or writes. The core complains with its writer locked, and to ask the context for
 * its user data then would wait for that lock for ever. */
static _Thread_local Stream *speaking;

static void keep_message(exr_const_context_t ctx, exr_result_t code, const char *msg) {
    (void)ctx, (void)code;
    if (speaking && !speaking->message[0] && msg) snprintf(speaking->message, sizeof speaking->message, "%s", msg);
}

static int64_t stream_size(exr_const_context_t ctx, void *user) {
    (void)ctx;
    return (int64_t)((Stream *)user)->size;
}

static int64_t stream_read(exr_const_context_t ctx, void *user, void *buffer, uint64_t size, uint64_t offset,
                           exr_stream_error_func_ptr_t fail) {
    Stream *s = user;
    (void)ctx;
    (void)fail;
    if (offset >= s->size) return 0;
    if (size > s->size - offset) { /* the header is read in blocks that may pass the end: the core
                                      checks what it needs */
        size = s->size - offset;
    }
    memcpy(buffer, s->bytes + offset, size);
    return (int64_t)size;
}

static int64_t stream_write(exr_const_context_t ctx, void *user, const void *buffer, uint64_t size, uint64_t offset,
                            exr_stream_error_func_ptr_t fail) {
    Stream *s = user;
    image_bytes_write_at(&s->out, offset, buffer, size);
    if (s->out.failed) {
        fail(ctx, EXR_ERR_OUT_OF_MEMORY, "out of memory");
        return -1;
    }
    return (int64_t)size;
}

static exr_context_initializer_t initializer(Stream *s) {
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
    init.error_handler_fn = keep_message;
    init.alloc_fn = alloc_bounded;
    init.free_fn = free;
    init.user_data = s;
    init.read_fn = stream_read;
    init.size_fn = stream_size;
    init.write_fn = stream_write;
    init.max_image_width = init.max_image_height = IMAGE_MAX_SIDE;
    init.max_tile_width = init.max_tile_height = TILE_LIMIT;
    init.flags = EXR_CONTEXT_FLAG_DISABLE_CHUNK_RECONSTRUCTION;
    return init;
}

static SltStatus fail_core(const Stream *s, exr_result_t code, const char *doing, SltStatus status, SltError *err) {
    /* zlib's failures to allocate come as damaged data, and a block beyond our own limit leaves errno alone */
    if (code == EXR_ERR_OUT_OF_MEMORY || errno == ENOMEM)
        return status_fail(err, SLT_LIMIT, "cannot %s '%s': %s", doing, s->name,
                           errno == ENOMEM ? "out of memory" : "a block of it needs too much memory");
    const char *text = s->message[0] ? s->message : exr_get_default_error_message(code);
    const char *file = strstr(text, s->name); /* the core prefixes some texts with the name */
    if (file == text && text[strlen(s->name)] == ':') {
        text += strlen(s->name) + 1;
        text += *text == ' ';
    }
    return status_fail(err, status, "cannot %s '%s': %s", doing, s->name, text);
}

/* reading ------------------------------------------------------------------------------------- */

typedef struct Channel {
    char name[IMAGE_NAME_SIZE];
    int part, slot; /* position in the part's own list */
    size_t layer;   /* order of first appearance, the root first */
    int rank;       /* R G B A Y before others */
    int order;
    int target; /* its channel in the Image */
} Channel;

static size_t layer_length(const char *name) {
    const char *dot = strrchr(name, '.');
    return dot ? (size_t)(dot - name) : 0;
}

static int suffix_rank(const char *name) {
    static const char *const usual[] = {"R", "G", "B", "Y", "A"};
    const char *dot = strrchr(name, '.'), *suffix = dot ? dot + 1 : name;
    for (int i = 0; i < 5; i++)
        if (strcmp(suffix, usual[i]) == 0) return i;
    return 5;
}

static int compare_channels(const void *a, const void *b) {
    const Channel *p = a, *q = b;
    if (p->layer != q->layer) return p->layer < q->layer ? -1 : 1;
    if (p->rank != q->rank) return p->rank < q->rank ? -1 : 1;
    return p->order < q->order ? -1 : p->order > q->order;
}

static bool name_taken(const Channel *list, int n, const char *name) {
    for (int i = 0; i < n; i++)
        if (strcmp(list[i].name, name) == 0) return true;
    return false;
}

/* What the parts of a file amount to. */
typedef struct Plan {
    exr_attr_box2i_t data; /* the least window that holds those of all parts */
    exr_attr_box2i_t display;
    Channel *channels;
    int count, parts;
} Plan;

static SltStatus plan_part(exr_context_t ctx, const Stream *s, Plan *plan, int part, SltError *err) {
    exr_storage_t storage;
    exr_attr_box2i_t data;
    const exr_attr_chlist_t *list;
    exr_result_t rc = exr_get_storage(ctx, part, &storage);
    if (rc == EXR_ERR_SUCCESS && (storage == EXR_STORAGE_DEEP_SCANLINE || storage == EXR_STORAGE_DEEP_TILED))
        return status_fail(err, SLT_INPUT, "cannot read '%s': deep images are not supported", s->name);
    rc = rc ? rc : exr_get_data_window(ctx, part, &data);
    rc = rc ? rc : exr_get_channels(ctx, part, &list);
    if (rc) return fail_core(s, rc, "read", SLT_INPUT, err);
    if (part == 0) {
        plan->data = data;
        rc = exr_get_display_window(ctx, part, &plan->display);
        if (rc) return fail_core(s, rc, "read", SLT_INPUT, err);
    }
    exr_attr_box2i_t *all = &plan->data; /* every part has a window of its own; outside it is 0 */
    all->min.x = data.min.x < all->min.x ? data.min.x : all->min.x;
    all->min.y = data.min.y < all->min.y ? data.min.y : all->min.y;
    all->max.x = data.max.x > all->max.x ? data.max.x : all->max.x;
    all->max.y = data.max.y > all->max.y ? data.max.y : all->max.y;
    double width = (double)all->max.x - all->min.x + 1, height = (double)all->max.y - all->min.y + 1;
    SltStatus status =
        image_check_claim(s->name, width, height, (double)plan->count + list->num_channels, s->size, err);
    if (status != SLT_OK) return status;
    if (storage == EXR_STORAGE_TILED) {
        uint32_t tile_x, tile_y;
        exr_tile_level_mode_t level;
        exr_tile_round_mode_t round;
        rc = exr_get_tile_descriptor(ctx, part, &tile_x, &tile_y, &level, &round);
        if (rc) return fail_core(s, rc, "read", SLT_INPUT, err);
        if (tile_x < 1 || tile_y < 1 || tile_x > TILE_LIMIT || tile_y > TILE_LIMIT)
            return status_fail(err, SLT_INPUT, "cannot read '%s': tiles of %u x %u pixels", s->name, tile_x, tile_y);
    }
    Channel *grown = realloc(plan->channels, (size_t)(plan->count + list->num_channels) * sizeof *grown);
    if (!grown) return status_fail(err, SLT_LIMIT, "cannot read '%s': out of memory", s->name);
    plan->channels = grown;
    for (int i = 0; i < list->num_channels; i++) {
        const exr_attr_chlist_entry_t *entry = &list->entries[i];
        Channel *c = &plan->channels[plan->count];
        *c = (Channel){.part = part, .slot = i, .order = plan->count};
        if (entry->x_sampling != 1 || entry->y_sampling != 1) {
            return status_fail(err, SLT_INPUT,
                               "cannot read '%s': channel '%s' is subsampled %d x %d; only full resolution "
                               "is supported",
                               s->name, entry->name.str, entry->x_sampling, entry->y_sampling);
        }
        snprintf(c->name, sizeof c->name, "%s", entry->name.str);
        if (name_taken(plan->channels, plan->count, c->name)) { /* parts may repeat R G B: tell them apart by part */
            const char *part_name = NULL;
            if (exr_get_name(ctx, part, &part_name) != EXR_ERR_SUCCESS || !part_name) part_name = "part";
            snprintf(c->name, sizeof c->name, "%.120s.%.120s", part_name, entry->name.str);
            if (name_taken(plan->channels, plan->count, c->name))
                return status_fail(err, SLT_INPUT, "cannot read '%s': two channels are called '%s'", s->name, c->name);
        }
        plan->count++;
    }
    return SLT_OK;
}

/* Decides the order of channels in the Image: the root first, then layers as they come. */
static void order_channels(Plan *plan) {
    for (int i = 0; i < plan->count; i++) {
        Channel *c = &plan->channels[i];
        size_t length = layer_length(c->name);
        c->rank = suffix_rank(c->name);
        c->layer = length ? (size_t)i + 1 : 0;
        for (int j = 0; length && j < i; j++) {
            if (layer_length(plan->channels[j].name) == length && !strncmp(plan->channels[j].name, c->name, length)) {
                c->layer = plan->channels[j].layer;
                break;
            }
        }
    }
    qsort(plan->channels, (size_t)plan->count, sizeof *plan->channels, compare_channels);
    for (int i = 0; i < plan->count; i++) plan->channels[i].target = i;
}

/* Where the pixels of a chunk go. */
typedef struct Aim {
    const Plan *plan;
    Image *im;
    int part;
    int64_t x, y;
} Aim;

static float half_to_float(uint16_t h) {
    uint32_t sign = (uint32_t)(h & 0x8000) << 16, exponent = h >> 10 & 31, mantissa = h & 1023, bits;
    float f;
    if (exponent == 0) {
        f = (float)mantissa * 0x1p-24f; /* exact, also zero */
        memcpy(&bits, &f, sizeof bits);
        bits |= sign;
    } else {
        bits = sign | (exponent == 31 ? 0x7f800000u : (exponent + 112) << 23) | mantissa << 13;
    }
    memcpy(&f, &bits, sizeof f);
    return f;
}

static uint32_t load_bytes(const uint8_t *p, int n) {
    uint32_t v = 0;
    for (int i = 0; i < n; i++) v |= (uint32_t)p[i] << 8 * i;
    return v;
}

static float load_sample(const uint8_t *p, int type) {
    float f;
    if (type == EXR_PIXEL_HALF) return half_to_float((uint16_t)load_bytes(p, 2));
    uint32_t v = load_bytes(p, 4);
    if (type == EXR_PIXEL_UINT) return (float)v;
    memcpy(&f, &v, sizeof f);
    return f;
}

/* Takes the place of the core's own unpacking: with 3.1.5, uncompressed half R G B A into
 * interleaved floats came out as zeros (test exr_layouts). A chunk is lines; a line is its channels
 * in the order of the header; numbers are little-endian. */
static exr_result_t unpack(exr_decode_pipeline_t *pipe) {
    const Aim *aim = pipe->decoding_user_data;
    const exr_chunk_info_t *chunk = &pipe->chunk;
    const uint8_t *from = pipe->unpacked_buffer;
    int target[IMAGE_MAX_CHANNELS];
    uint64_t need = 0;
    for (int i = 0; i < aim->plan->count; i++) {
        const Channel *c = &aim->plan->channels[i];
        if (c->part == aim->part && c->slot < pipe->channel_count) target[c->slot] = c->target;
    }
    for (int k = 0; k < pipe->channel_count; k++) {
        need +=
            (uint64_t)chunk->width * (uint64_t)chunk->height * (pipe->channels[k].data_type == EXR_PIXEL_HALF ? 2 : 4);
    }
    if (!from || need > chunk->unpacked_size) return EXR_ERR_CORRUPT_CHUNK;
    for (int y = 0; y < chunk->height; y++) {
        float *line = aim->im->data +
                      ((size_t)(aim->y + y) * (size_t)aim->im->width + (size_t)aim->x) * (size_t)aim->im->channels;
        for (int k = 0; k < pipe->channel_count; k++) {
            int type = pipe->channels[k].data_type, bytes = type == EXR_PIXEL_HALF ? 2 : 4;
            for (int x = 0; x < chunk->width; x++, from += bytes)
                line[(size_t)x * (size_t)aim->im->channels + (size_t)target[k]] = load_sample(from, type);
        }
    }
    return EXR_ERR_SUCCESS;
}

typedef struct Decoder {
    exr_decode_pipeline_t pipe;
    bool started;
} Decoder;

static SltStatus decode_chunk(exr_context_t ctx, const Stream *s, const Plan *plan, int part, Decoder *d,
                              const exr_chunk_info_t *info, int64_t x, int64_t y, Image *im, SltError *err) {
    exr_result_t rc;
    if (info->packed_size > s->size || info->unpacked_size > BLOCK_LIMIT) {
        return status_fail(err, SLT_INPUT, "cannot read '%s': a block claims %llu bytes", s->name,
                           (unsigned long long)info->packed_size);
    }
    if (x < 0 || y < 0 || info->width < 1 || info->height < 1 || x + info->width > im->width ||
        y + info->height > im->height) { /* the core checks indices, but the pixels are ours to defend */
        return status_fail(err, SLT_INPUT, "cannot read '%s': a block lies outside of the image", s->name);
    }
    Aim aim = {.plan = plan, .im = im, .part = part, .x = x, .y = y};
    rc = d->started ? exr_decoding_update(ctx, part, info, &d->pipe)
                    : exr_decoding_initialize(ctx, part, info, &d->pipe);
    if (rc == EXR_ERR_SUCCESS) {
        bool first = !d->started;
        d->started = true;
        if (first) { /* for reading and decompressing; no channel has a pointer, so nothing is
                        unpacked by it */
            rc = exr_decoding_choose_default_routines(ctx, part, &d->pipe);
        }
        d->pipe.decoding_user_data = &aim;
        d->pipe.unpack_and_convert_fn = unpack;
    }
    rc = rc ? rc : exr_decoding_run(ctx, part, &d->pipe);
    return rc ? fail_core(s, rc, "read", SLT_INPUT, err) : SLT_OK;
}

static SltStatus decode_part(exr_context_t ctx, const Stream *s, const Plan *plan, int part, Image *im, SltError *err) {
    exr_storage_t storage;
    exr_chunk_info_t info;
    exr_attr_box2i_t own;
    Decoder d = {.pipe = EXR_DECODE_PIPELINE_INITIALIZER};
    SltStatus status = SLT_OK;
    exr_result_t rc = exr_get_storage(ctx, part, &storage);
    rc = rc ? rc : exr_get_data_window(ctx, part, &own);
    if (rc) return fail_core(s, rc, "read", SLT_INPUT, err);
    int64_t width = (int64_t)own.max.x - own.min.x + 1, height = (int64_t)own.max.y - own.min.y + 1;
    int64_t left = (int64_t)own.min.x - plan->data.min.x, top = (int64_t)own.min.y - plan->data.min.y;
    if (storage == EXR_STORAGE_SCANLINE) {
        int32_t lines;
        rc = exr_get_scanlines_per_chunk(ctx, part, &lines);
        for (int64_t y = 0; !rc && !status && lines > 0 && y < height; y += lines) {
            rc = exr_read_scanline_chunk_info(ctx, part, (int)(y + own.min.y), &info);
            if (!rc) {
                status = decode_chunk(ctx, s, plan, part, &d, &info, left, (int64_t)info.start_y - plan->data.min.y, im,
                                      err);
            }
        }
    } else {
        int32_t tile_w, tile_h;
        rc = exr_get_tile_sizes(ctx, part, 0, 0, &tile_w, &tile_h);
        for (int64_t ty = 0; !rc && !status && ty * tile_h < height; ty++) {
            for (int64_t tx = 0; !rc && !status && tx * tile_w < width; tx++) {
                rc = exr_read_tile_chunk_info(ctx, part, (int)tx, (int)ty, 0, 0, &info);
                if (!rc)
                    status =
                        decode_chunk(ctx, s, plan, part, &d, &info, left + tx * tile_w, top + ty * tile_h, im, err);
            }
        }
    }
    if (d.started) exr_decoding_destroy(ctx, &d.pipe);
    return rc ? fail_core(s, rc, "read", SLT_INPUT, err) : status;
}

static SltStatus read_attributes(exr_context_t ctx, const Stream *s, Image *im, SltError *err) {
    int32_t count = 0;
    bool ok = true;
    if (exr_get_attribute_count(ctx, 0, &count) != EXR_ERR_SUCCESS) return SLT_OK;
    for (int32_t i = 0; i < count && ok; i++) {
        const exr_attribute_t *a;
        if (exr_get_attribute_by_index(ctx, 0, EXR_ATTR_LIST_FILE_ORDER, i, &a) != EXR_ERR_SUCCESS) continue;
        if (a->type == EXR_ATTR_STRING && a->string->str) ok = image_set_text(im, a->name, a->string->str);
        else if (a->type == EXR_ATTR_FLOAT) ok = image_set_number(im, a->name, a->f);
        else if (a->type == EXR_ATTR_DOUBLE) ok = image_set_number(im, a->name, a->d);
        else if (a->type == EXR_ATTR_INT) ok = image_set_number(im, a->name, a->i);
    }
    return ok ? SLT_OK : status_fail(err, SLT_LIMIT, "cannot read '%s': out of memory", s->name);
}

/* Moves pixels from the data window into the display window: what is missing is 0, what sticks out
 * is cut. */
static SltStatus fit_display(const Stream *s, const Plan *plan, Image *im, SltError *err) {
    const exr_attr_box2i_t *d = &plan->data, *v = &plan->display;
    if (memcmp(d, v, sizeof *d) == 0) return SLT_OK;
    double width = (double)v->max.x - v->min.x + 1, height = (double)v->max.y - v->min.y + 1;
    SltStatus status = image_check_claim(s->name, width, height, im->channels, s->size, err);
    Image out = {0};
    if (status == SLT_OK) status = image_create(&out, (int)width, (int)height, im->channels, err);
    if (status != SLT_OK) return status;
    int64_t dx = (int64_t)d->min.x - v->min.x, dy = (int64_t)d->min.y - v->min.y; /* of the data in the display */
    int64_t x0 = dx > 0 ? dx : 0, x1 = dx + im->width < out.width ? dx + im->width : out.width;
    if (x0 >= x1 || dy >= out.height || dy + im->height <= 0) {
        image_free(&out);
        return status_fail(err, SLT_INPUT, "cannot read '%s': its pixels lie outside of its display window", s->name);
    }
    for (int64_t y = 0; y < out.height; y++) {
        if (y - dy >= 0 && y - dy < im->height) {
            memcpy(out.data + (size_t)(y * out.width + x0) * (size_t)im->channels,
                   im->data + (size_t)((y - dy) * im->width + x0 - dx) * (size_t)im->channels,
                   (size_t)(x1 - x0) * (size_t)im->channels * sizeof(float));
        }
    }
    free(im->data);
    free(out.names);
    im->data = out.data;
    im->width = out.width;
    im->height = out.height;
    return SLT_OK;
}

static SltStatus read_parts(exr_context_t ctx, const Stream *s, Plan *plan, Image *im, SltError *err) {
    exr_result_t rc = exr_get_count(ctx, &plan->parts);
    SltStatus status = rc ? fail_core(s, rc, "read", SLT_INPUT, err) : SLT_OK;
    if (!status && plan->parts < 1)
        return status_fail(err, SLT_INPUT, "cannot read '%s': the file has no image in it", s->name);
    for (int part = 0; part < plan->parts && !status; part++) status = plan_part(ctx, s, plan, part, err);
    if (status != SLT_OK) return status;
    order_channels(plan);
    int width = (int)((int64_t)plan->data.max.x - plan->data.min.x + 1);
    int height = (int)((int64_t)plan->data.max.y - plan->data.min.y + 1);
    status = image_create(im, width, height, plan->count, err);
    for (int i = 0; i < plan->count && !status; i++) image_set_name(im, i, plan->channels[i].name);
    for (int part = 0; part < plan->parts && !status; part++) status = decode_part(ctx, s, plan, part, im, err);
    status = status ? status : fit_display(s, plan, im, err);
    return status ? status : read_attributes(ctx, s, im, err);
}

SltStatus image_decode_exr(const char *name, const uint8_t *bytes, size_t size, const ImageReadOptions *opt, Image *out,
                           SltError *err) {
    (void)opt;
    Stream s = {.name = name, .bytes = bytes, .size = size};
    exr_context_initializer_t init = initializer(&s);
    exr_context_t ctx = NULL;
    Plan plan = {0};
    *out = (Image){0};
    if (size < 8 || memcmp(bytes, "\x76\x2f\x31\x01", 4) != 0)
        return status_fail(err, SLT_INPUT, "cannot read '%s': it is not an OpenEXR file", name);
    SltStatus status = image_check_exr_headers(name, bytes, size, err);
    if (status != SLT_OK) return status;
    speaking = &s;
    errno = 0;
    exr_result_t rc = exr_start_read(&ctx, name, &init);
    status = rc ? fail_core(&s, rc, "read", SLT_INPUT, err) : read_parts(ctx, &s, &plan, out, err);
    if (ctx) exr_finish(&ctx);
    speaking = NULL;
    free(plan.channels);
    if (status != SLT_OK) image_free(out);
    return status;
}

/* writing ------------------------------------------------------------------------------------- */

static exr_result_t write_header(exr_context_t ctx, const Image *im) {
    int part = 0;
    char name[IMAGE_NAME_SIZE];
    exr_result_t rc = exr_set_longname_support(ctx, 1);
    rc = rc ? rc : exr_add_part(ctx, "saltus", EXR_STORAGE_SCANLINE, &part);
    rc = rc ? rc : exr_initialize_required_attr_simple(ctx, part, im->width, im->height, EXR_COMPRESSION_ZIP);
    for (int c = 0; c < im->channels && !rc; c++)
        rc = exr_add_channel(ctx, part, image_get_name(im, c, name), EXR_PIXEL_FLOAT, EXR_PERCEPTUALLY_LINEAR, 1, 1);
    for (int i = 0; i < im->attr_count && !rc; i++) {
        const ImageAttr *a = &im->attrs[i];
        const exr_attribute_t *old;
        if (exr_get_attribute_by_name(ctx, part, a->name, &old) == EXR_ERR_SUCCESS)
            continue; /* what the format itself defines is written from the image */
        rc = a->text ? exr_attr_set_string(ctx, part, a->name, a->text)
                     : exr_attr_set_double(ctx, part, a->name, a->number);
    }
    return rc ? rc : exr_write_header(ctx);
}

/* A block that compression does not make smaller is stored as it is, and known by its size. 3.1.5
 * keeps the compressed bytes of a block that comes out exactly as long, and reads them back as
 * pixels: about one noisy block in a thousand. */
typedef struct Compressor {
    exr_result_t (*run)(exr_encode_pipeline_t *);
} Compressor;

static exr_result_t compress_or_store(exr_encode_pipeline_t *pipe) {
    const Compressor *core = pipe->encoding_user_data;
    exr_result_t rc = core->run(pipe);
    if (!rc && pipe->compressed_bytes == pipe->packed_bytes)
        memcpy(pipe->compressed_buffer, pipe->packed_buffer, pipe->packed_bytes);
    return rc;
}

static exr_result_t write_lines(exr_context_t ctx, const Image *im, const int *slots) {
    exr_encode_pipeline_t pipe = EXR_ENCODE_PIPELINE_INITIALIZER;
    Compressor core = {0};
    exr_chunk_info_t info;
    bool started = false;
    int32_t lines = 0;
    exr_result_t rc = exr_get_scanlines_per_chunk(ctx, 0, &lines);
    for (int64_t y = 0; !rc && y < im->height; y += lines) {
        rc = exr_write_scanline_chunk_info(ctx, 0, (int)y, &info);
        rc = rc        ? rc
             : started ? exr_encoding_update(ctx, 0, &info, &pipe)
                       : exr_encoding_initialize(ctx, 0, &info, &pipe);
        for (int k = 0; !rc && k < pipe.channel_count; k++) {
            exr_coding_channel_info_t *c = &pipe.channels[k];
            c->user_bytes_per_element = 4;
            c->user_data_type = EXR_PIXEL_FLOAT;
            c->user_pixel_stride = (int32_t)sizeof(float) * im->channels;
            c->user_line_stride = (int32_t)((size_t)im->width * (size_t)im->channels * sizeof(float));
            c->encode_from_ptr =
                (const uint8_t *)(im->data + (size_t)y * (size_t)im->width * (size_t)im->channels + slots[k]);
        }
        if (!rc && !started) {
            rc = exr_encoding_choose_default_routines(ctx, 0, &pipe);
            core.run = pipe.compress_fn;
            pipe.compress_fn = core.run ? compress_or_store : NULL;
            pipe.encoding_user_data = &core;
        }
        started = true;
        rc = rc ? rc : exr_encoding_run(ctx, 0, &pipe);
    }
    if (started) exr_encoding_destroy(ctx, &pipe);
    return rc;
}

/* The core keeps its channels sorted by name; slots[k] is the Image's channel of the core's k-th.
 * False for a duplicate. */
static bool map_slots(exr_context_t ctx, const Image *im, int *slots) {
    const exr_attr_chlist_t *list;
    if (exr_get_channels(ctx, 0, &list) != EXR_ERR_SUCCESS || list->num_channels != im->channels) return false;
    for (int k = 0; k < im->channels; k++) {
        slots[k] = image_find_channel(im, list->entries[k].name.str);
        if (slots[k] < 0) return false;
    }
    return true;
}

static SltStatus check_names(const char *name, const Image *im, SltError *err) {
    char a[IMAGE_NAME_SIZE];
    for (int i = 0; i < im->channels; i++) {
        image_get_name(im, i, a);
        if (!a[0]) return status_fail(err, SLT_USAGE, "cannot write '%s': channel %d has no name", name, i);
        if (image_find_channel(im, a) != i)
            return status_fail(err, SLT_USAGE, "cannot write '%s': two channels are called '%s'", name, a);
    }
    return SLT_OK;
}

SltStatus image_encode_exr(const char *name, const Image *im, const ImageWriteOptions *opt, Bytes *out, SltError *err) {
    (void)opt;
    Stream s = {.name = name};
    SltStatus status = check_names(name, im, err);
    if (status != SLT_OK) return status;
    if ((double)im->width * im->channels * sizeof(float) > INT32_MAX)
        return status_fail(err, SLT_LIMIT, "cannot write '%s': too wide for %d channels", name, im->channels);
    exr_context_initializer_t init = initializer(&s);
    exr_context_t ctx = NULL;
    int *slots = malloc((size_t)im->channels * sizeof *slots);
    speaking = &s;
    errno = 0;
    /* never a real path: the core would unlink it after an error */
    exr_result_t rc =
        slots ? exr_start_write(&ctx, "/dev/null/saltus.exr", EXR_WRITE_FILE_DIRECTLY, &init) : EXR_ERR_OUT_OF_MEMORY;
    rc = rc ? rc : write_header(ctx, im);
    if (!rc && !map_slots(ctx, im, slots)) rc = EXR_ERR_INVALID_ARGUMENT;
    rc = rc ? rc : write_lines(ctx, im, slots);
    if (ctx) {
        exr_result_t end = exr_finish(&ctx);
        rc = rc ? rc : end;
    }
    speaking = NULL;
    if (rc && errno == ENOMEM) rc = EXR_ERR_OUT_OF_MEMORY;
    free(slots);
    if (rc || s.out.failed) {
        image_bytes_free(&s.out);
        return fail_core(&s, s.out.failed ? EXR_ERR_OUT_OF_MEMORY : rc, "write", SLT_OUTPUT, err);
    }
    *out = s.out;
    return SLT_OK;
}
