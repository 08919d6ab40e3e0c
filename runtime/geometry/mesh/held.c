/* What windows have seen, kept for whoever looks through them again: the derivative of a loss is asked at the windows
 * that its value was asked at. Windows are the same whose numbers are, bit by bit. */
#include "pieces.h"

#include <stdlib.h>
#include <string.h>

#include "window.h"

enum {
    WINDOWS = 1 << 13, /* at most */
    SLOTS = 2 * WINDOWS,
    UNITS = 1 << 17,           /* from where on nothing more is kept */
    WORDS = 2 * SLT_BEAM_ROWS, /* of 32 bits, of a window in f64 */
    EMPTY = -1
};

/* Open addressing. */
struct HeldWindows {
    int32_t slot[SLOTS];
    struct {
        const void *of; /* what was asked */
        int32_t unit;
    } window[WINDOWS];
    uint32_t word[WINDOWS][WORDS];
};

void held_set(Held *h, bool on) {
    h->n = h->kept = 0, h->full = false;
    if (on && !h->all) h->all = malloc(sizeof *h->all);
    h->on = on && h->all;
    if (h->on) memset(h->all->slot, EMPTY, sizeof h->all->slot);
}

uint32_t held_begin(Held *h, uint32_t units) {
    if (!h->full) h->kept = units;
    h->full |= units > UNITS || h->n + LANES > WINDOWS;
    return h->kept;
}

/* A row of windows as bits. */
typedef struct Rows {
    const unsigned char *at;
    bool f64;
    uint32_t width, words;
} Rows;

static Rows rows_of(const void *rays, bool f64, uint32_t width) {
    return (Rows){rays, f64, width, f64 ? WORDS : WORDS / 2};
}

static inline uint32_t word_of(const Rows *r, uint32_t k, uint32_t i) {
    uint32_t word;
    const size_t at = r->f64 ? 2 * ((size_t)(i / 2) * r->width + k) + i % 2 : (size_t)i * r->width + k;
    memcpy(&word, r->at + at * sizeof word, sizeof word);
    return word;
}

/* Of eye and corner, which tell nearly all windows apart. */
static void hash(const Rows *r, uint32_t out[LANES]) {
    uint64_t wide[LANES];
    uint32_t word[LANES];
    for (uint32_t k = 0; k < r->width; k++) out[k] = 0;
    for (uint32_t i = 0; i < SLT_BEAM_U; i++) {
        if (r->f64) {
            memcpy(wide, r->at + (size_t)i * r->width * sizeof *wide, r->width * sizeof *wide);
            for (uint32_t k = 0; k < r->width; k++) word[k] = (uint32_t)(wide[k] ^ wide[k] >> 32);
        } else {
            memcpy(word, r->at + (size_t)i * r->width * sizeof *word, r->width * sizeof *word);
        }
        for (uint32_t k = 0; k < r->width; k++) {
            const uint32_t h = (out[k] ^ word[k]) * 0x9e3779b1u;
            out[k] = h ^ h >> 15;
        }
    }
}

static bool same(const Held *h, int32_t number, const void *of, const Rows *r, uint32_t k) {
    if (h->all->window[number].of != of) return false;
    for (uint32_t i = 0; i < r->words; i++)
        if (h->all->word[number][i] != word_of(r, k, i)) return false;
    return true;
}

uint64_t held_find(const Held *h, const void *of, const void *rays, bool f64, uint64_t mask, uint32_t width,
                   int32_t *witness) {
    const Rows r = rows_of(rays, f64, width);
    uint32_t key[LANES];
    uint64_t found = 0;
    if (!h->on || !h->n) return 0;
    hash(&r, key);
    for (; mask; mask &= mask - 1) {
        const uint32_t k = (uint32_t)__builtin_ctzll(mask);
        for (uint32_t slot = key[k] % SLOTS; h->all->slot[slot] != EMPTY; slot = (slot + 1) % SLOTS)
            if (same(h, h->all->slot[slot], of, &r, k)) {
                witness[k] = h->all->window[h->all->slot[slot]].unit, found |= (uint64_t)1 << k;
                break;
            }
    }
    return found;
}

void held_add(Held *h, const void *of, const void *rays, bool f64, uint64_t mask, uint32_t width,
              const int32_t *witness) {
    const Rows r = rows_of(rays, f64, width);
    uint32_t key[LANES];
    if (!h->on || h->full || !mask) return;
    hash(&r, key);
    for (; mask && h->n < WINDOWS; mask &= mask - 1) {
        const uint32_t k = (uint32_t)__builtin_ctzll(mask);
        uint32_t slot = key[k] % SLOTS;
        while (h->all->slot[slot] != EMPTY) slot = (slot + 1) % SLOTS;
        h->all->slot[slot] = (int32_t)h->n;
        h->all->window[h->n].of = of, h->all->window[h->n].unit = witness[k];
        for (uint32_t i = 0; i < r.words; i++) h->all->word[h->n][i] = word_of(&r, k, i);
        h->n++;
    }
}
