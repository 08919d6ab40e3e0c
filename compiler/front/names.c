/* Maps from interned names. */
#include "compiler/front/names.h"

/* By the text, not the address, so that everything that walks a map (suggestions) is the same in every run. */
static uint32_t slot_of(const char *key, uint32_t cap) {
    uint32_t h = 2166136261u;
    for (const char *p = key; *p; p++) h = (h ^ (unsigned char)*p) * 16777619u;
    return (h ^ h >> 15) & (cap - 1);
}

void *map_get(const NameMap *m, const char *key) {
    if (!m->cap) return NULL;
    for (uint32_t i = slot_of(key, m->cap);; i = (i + 1) & (m->cap - 1)) {
        if (!m->keys[i]) return NULL;
        if (m->keys[i] == key) return m->values[i];
    }
}

static void map_insert(NameMap *m, const char *key, void *value) {
    uint32_t i = slot_of(key, m->cap);
    while (m->keys[i] && m->keys[i] != key) i = (i + 1) & (m->cap - 1);
    m->len += !m->keys[i];
    m->keys[i] = key;
    m->values[i] = value;
}

void map_put(Arena *a, NameMap *m, const char *key, void *value) {
    if (m->len * 2 >= m->cap) {
        NameMap old = *m;
        m->cap = old.cap ? old.cap * 2 : 16;
        m->len = 0;
        m->keys = ARENA_ARRAY(a, const char *, m->cap);
        m->values = ARENA_ARRAY(a, void *, m->cap);
        for (uint32_t i = 0; i < old.cap; i++)
            if (old.keys[i]) map_insert(m, old.keys[i], old.values[i]);
    }
    map_insert(m, key, value);
}
