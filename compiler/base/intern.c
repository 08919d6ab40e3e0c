/* Interned strings, the hash table beneath them (also used for reported diagnostics), and the search for the nearest
 * name. */
#include "compiler/base/session.h"

#include <string.h>
#include <strings.h>

#include "compiler/base/base_internal.h"

uint32_t hash_bytes(const void *data, size_t len) {
    /* FNV-1a with a final mix: names are short, and the low bits pick the slot. */
    const unsigned char *p = data;
    uint32_t h = 2166136261u;
    for (size_t i = 0; i < len; i++) h = (h ^ p[i]) * 16777619u;
    h ^= h >> 15;
    h *= 0x2c1b3c6du;
    return h ^ (h >> 13);
}

static void table_place(PtrTable *t, const void *item, uint32_t hash) {
    uint32_t i = hash & (t->cap - 1);
    while (t->slots[i]) i = (i + 1) & (t->cap - 1);
    t->slots[i] = item;
    t->hashes[i] = hash;
}

void table_insert(Session *s, PtrTable *t, const void *item, uint32_t hash) {
    if (t->len * 4 >= t->cap * 3) {
        PtrTable old = *t, grown = {.len = old.len, .cap = old.cap ? old.cap * 2 : 256};
        grown.slots = ARENA_ARRAY(&s->session, const void *, grown.cap);
        grown.hashes = ARENA_ARRAY(&s->session, uint32_t, grown.cap);
        for (uint32_t i = 0; i < old.cap; i++)
            if (old.slots[i]) table_place(&grown, old.slots[i], old.hashes[i]);
        *t = grown;
    }
    table_place(t, item, hash);
    t->len++;
}

const void *table_next(const PtrTable *t, uint32_t hash, uint32_t *at) {
    if (!t->cap) return NULL;
    for (uint32_t i = *at == UINT32_MAX ? hash & (t->cap - 1) : (*at + 1) & (t->cap - 1); t->slots[i];
         i = (i + 1) & (t->cap - 1)) {
        if (t->hashes[i] != hash) continue;
        *at = i;
        return t->slots[i];
    }
    return NULL;
}

const char *intern(Session *s, const char *text, size_t len) {
    uint32_t hash = hash_bytes(text, len), at = UINT32_MAX;
    for (const char *known; (known = table_next(&s->strings, hash, &at));)
        if (strlen(known) == len && !memcmp(known, text, len)) return known;
    char *copy = arena_strndup(&s->session, text, len);
    table_insert(s, &s->strings, copy, hash);
    return copy;
}

/* ---- suggestions ---- */

enum { SUGGEST_MAX = 48 };

static char lower(char c) { return c >= 'A' && c <= 'Z' ? (char)(c + 32) : c; }

/* Twice the Damerau-Levenshtein distance (adjacent swaps count as one edit); a difference of case costs half an edit.
 */
static int distance(const char *a, int n, const char *b, int m) {
    int row[3][SUGGEST_MAX + 1];
    for (int j = 0; j <= m; j++) row[0][j] = 2 * j;
    for (int i = 1; i <= n; i++) {
        int *now = row[i % 3], *up = row[(i + 2) % 3], *up2 = row[(i + 1) % 3];
        now[0] = 2 * i;
        for (int j = 1; j <= m; j++) {
            int replace = a[i - 1] == b[j - 1] ? 0 : lower(a[i - 1]) == lower(b[j - 1]) ? 1 : 2;
            int best = up[j - 1] + replace;
            if (up[j] + 2 < best) best = up[j] + 2;
            if (now[j - 1] + 2 < best) best = now[j - 1] + 2;
            if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] && up2[j - 2] + 2 < best)
                best = up2[j - 2] + 2;
            now[j] = best;
        }
    }
    return row[n % 3][m];
}

const char *suggest_nearest(const char *name, const char *const *names, uint32_t n) {
    size_t len = strnlen(name, SUGGEST_MAX + 1);
    if (len == 0 || len > SUGGEST_MAX) return NULL;
    int limit = len <= 2 ? 2 : len <= 4 ? 3 : len <= 7 ? 4 : 6; /* in half edits */
    const char *best = NULL;
    for (uint32_t i = 0; i < n; i++) {
        if (!names[i]) continue;
        size_t m = strnlen(names[i], SUGGEST_MAX + 1);
        if (m == 0 || m > SUGGEST_MAX) continue;
        int d = !strcmp(name, names[i])       ? 0
                : !strcasecmp(name, names[i]) ? 1
                                              : distance(name, (int)len, names[i], (int)m);
        /* Two names that share nothing are not near, however short. */
        size_t shorter = len < m ? len : m;
        if (d > limit || d >= 2 * (int)shorter) continue;
        if (d == 0) return names[i];
        best = names[i];
        limit = d - 1;
    }
    return best;
}
