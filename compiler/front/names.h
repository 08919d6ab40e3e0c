/* Maps from interned names to whatever they stand for. */
#ifndef SALTUS_FRONT_NAMES_H
#define SALTUS_FRONT_NAMES_H

#include "compiler/base/session.h"

typedef struct NameMap {
    const char **keys;
    void **values;
    uint32_t cap, len;
} NameMap;
void *map_get(const NameMap *m, const char *key);
void map_put(Arena *a, NameMap *m, const char *key, void *value); /* replaces */

#endif
