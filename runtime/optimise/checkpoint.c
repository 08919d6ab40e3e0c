/* Checkpoints: the whole state in one file, checked before any of it is believed.
 *
 *     "SALTCKPT"  version  byte order  config hash  sizes  | key | Numbers | doubles | blob | XXH64 of all before
 *
 * The hash of the config covers what decides the next steps (method, rates, bounds, grids), not
 * tolerances, so that a resumed run may be given another stopping rule. */
#include "internal.h"

#include "../image/image.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#define XXH_INLINE_ALL /* the header alone: a library more takes 30 us of each start */
#include <xxhash.h>

typedef struct Head {
    char magic[8];
    uint32_t version, byte_order;
    uint64_t config;
    uint64_t key_size, numbers_size, double_count, blob_size;
} Head;

static const char MAGIC[8] = {'S', 'A', 'L', 'T', 'C', 'K', 'P', 'T'};
enum { VERSION = 2, BYTE_ORDER_MARK = 0x01020304 };

static uint64_t hash_config(const Optimiser *o) {
    const OptimiseConfig *c = &o->config;
    XXH64_hash_t h = 0;
    const double numbers[] = {c->beta1, c->beta2, c->epsilon, c->momentum};
    const uint64_t counts[] = {c->n, (uint64_t)c->method, (uint64_t)c->history, (uint64_t)c->grid_count};
    h = XXH64(numbers, sizeof numbers, h);
    h = XXH64(counts, sizeof counts, h);
    h = XXH64(c->learning_rate, c->n * sizeof(double), h);
    h = XXH64(c->lo, c->n * sizeof(double), h);
    h = XXH64(c->hi, c->n * sizeof(double), h);
    h = XXH64(c->log, c->n, h);
    for (int k = 0; k < c->grid_count; k++) { /* field by field: the struct has padding */
        const OptimiseGrid *g = &c->grids[k];
        const uint64_t f[] = {g->offset,   (uint64_t)g->width, (uint64_t)g->height, (uint64_t)g->channels,
                              g->stride_x, g->stride_y,        g->stride_c};
        h = XXH64(f, sizeof f, h);
        h = XXH64(&g->lambda, sizeof g->lambda, h);
        if (o->graphs[k]) h = graph_hash(o->graphs[k], h);
    }
    return h;
}

SltStatus optimise_save(const Optimiser *o, const char *path, const char *key, const void *blob, size_t blob_size,
                        SltError *err) {
    Head head;
    memset(&head, 0, sizeof head);
    memcpy(head.magic, MAGIC, sizeof MAGIC);
    head.version = VERSION;
    head.byte_order = BYTE_ORDER_MARK;
    head.config = hash_config(o);
    head.key_size = strlen(key);
    head.numbers_size = sizeof(Numbers);
    head.double_count = o->persistent;
    head.blob_size = blob_size;
    size_t size = sizeof head + head.key_size + sizeof(Numbers) + o->persistent * sizeof(double) + blob_size;
    uint8_t *bytes = malloc(size + 8), *p = bytes;
    if (!bytes) return status_fail(err, SLT_LIMIT, "cannot write '%s': out of memory", path);
    const struct {
        const void *data;
        size_t size;
    } parts[] = {{&head, sizeof head},
                 {key, head.key_size},
                 {&o->now, sizeof o->now},
                 {o->block, o->persistent * sizeof(double)},
                 {blob, blob_size}};
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++) {
        if (parts[i].size) {
            memcpy(p, parts[i].data, parts[i].size);
            p += parts[i].size;
        }
    }
    uint64_t sum = XXH64(bytes, size, 0);
    memcpy(p, &sum, 8);
    SltStatus status = file_write_atomic(path, bytes, size + 8, err);
    free(bytes);
    return status;
}

/* Everything that can be wrong, before anything is taken over. */
static SltStatus check_file(const Optimiser *o, const char *path, const char *key, const uint8_t *bytes, size_t size,
                            Head *head, SltError *err) {
    if (size < 8 || memcmp(bytes, MAGIC, sizeof MAGIC) != 0)
        return status_fail(err, SLT_INPUT, "cannot resume from '%s': it is not a checkpoint", path);
    if (size < sizeof *head + 8)
        return status_fail(err, SLT_INPUT, "cannot resume from '%s': the file ends too early", path);
    memcpy(head, bytes, sizeof *head);
    if (head->version != VERSION || head->byte_order != BYTE_ORDER_MARK || head->numbers_size != sizeof(Numbers)) {
        return status_fail(err, SLT_INPUT, "cannot resume from '%s': it was written by another version or machine",
                           path);
    }
    uint64_t room = size - sizeof *head - 8, sum;
    if (head->key_size > room || head->blob_size > room || head->double_count > room / sizeof(double) ||
        head->key_size + sizeof(Numbers) + head->double_count * sizeof(double) + head->blob_size != room) {
        return status_fail(err, SLT_INPUT, "cannot resume from '%s': the file is damaged (its size is wrong)", path);
    }
    memcpy(&sum, bytes + size - 8, 8);
    if (sum != XXH64(bytes, size - 8, 0)) {
        return status_fail(err, SLT_INPUT, "cannot resume from '%s': the file is damaged (its checksum is wrong)",
                           path);
    }
    if (head->key_size != strlen(key) || memcmp(bytes + sizeof *head, key, head->key_size) != 0) {
        return status_fail(err, SLT_INPUT, "cannot resume from '%s': it belongs to '%.*s', this is '%.150s'", path,
                           (int)(head->key_size < 150 ? head->key_size : 150), (const char *)bytes + sizeof *head, key);
    }
    if (head->double_count != o->persistent || head->config != hash_config(o)) {
        return status_fail(err, SLT_INPUT,
                           "cannot resume from '%s': the optimiser, its rates, bounds or parameters have changed",
                           path);
    }
    return SLT_OK;
}

SltStatus optimise_load(Optimiser *o, const char *path, const char *key, void **blob, size_t *blob_size,
                        SltError *err) {
    uint8_t *bytes;
    size_t size;
    Head head;
    Numbers now;
    if (blob) *blob = NULL;
    if (blob_size) *blob_size = 0;
    SltStatus status = file_read_all(path, &file_binary, &bytes, &size, err);
    if (status != SLT_OK) return status;
    status = check_file(o, path, key, bytes, size, &head, err);
    const uint8_t *p = bytes + sizeof head;
    if (status == SLT_OK) {
        p += head.key_size;
        memcpy(&now, p, sizeof now);
        p += sizeof now;
        /* a correct checksum is no proof against a forged file: indices must be in range whatever
         * it says */
        int64_t history = o->method->pairs ? o->config.history : 1;
        if (now.pairs < 0 || now.pairs > history || now.newest < 0 || now.newest >= history ||
            now.state < OPTIMISE_EVALUATE || now.state > OPTIMISE_FAILED || !memchr(now.reason, 0, sizeof now.reason)) {
            status = status_fail(err, SLT_INPUT, "cannot resume from '%s': its state makes no sense", path);
        }
    }
    if (status == SLT_OK && blob && head.blob_size) {
        char *copy = malloc(head.blob_size + 1);
        if (copy) {
            memcpy(copy, p + head.double_count * sizeof(double), head.blob_size);
            copy[head.blob_size] = 0;
            *blob = copy;
        } else {
            status = status_fail(err, SLT_LIMIT, "cannot resume from '%s': out of memory", path);
        }
    }
    if (status == SLT_OK) {
        o->now = now;
        memcpy(o->block, p, head.double_count * sizeof(double));
        if (blob_size) *blob_size = head.blob_size;
    }
    free(bytes);
    return status;
}
