/* Lists by cell: what `bounds` noted for many boxes, sorted by box. */
#include "runtime/quadrature/lists.h"

#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"

enum { NONE = -1, ROOT = -2 }; /* in the place of a count: all iterations; as the root has it */

bool lists_init(Lists *l, const SltScene *s) {
    memset(l, 0, sizeof *l);
    l->s = s;
    for (uint32_t i = 0; i < s->nlists && s->list_noted; i++) l->any |= s->list_noted[i] != 0;
    if (!l->any) return true;
    l->current = alloc_zero(s->nlists, sizeof *l->current);
    l->root = alloc_zero(s->nlists, sizeof *l->root);
    l->note = alloc_zero(s->nlists, sizeof *l->note);
    l->count = alloc_zero((uint64_t)s->nlists * SLT_PAD, sizeof *l->count);
    l->from = alloc_zero((uint64_t)s->nlists * SLT_PAD, sizeof *l->from);
    return l->current && l->root && l->note && l->count && l->from;
}

void lists_free(Lists *l) {
    free(l->current), free(l->root), free(l->items), free((void *)l->note), free(l->notes), free(l->count),
        free(l->from);
    memset(l, 0, sizeof *l);
}

static bool room(Lists *l, uint64_t need) {
    if (need <= l->cap) return true;
    uint64_t cap = need + need / 2 + 256;
    int32_t *items = realloc(l->items, cap * sizeof *items);
    if (!items) return false;
    l->items = items, l->cap = cap;
    return true;
}

/* How many iterations the loop runs in the current node. */
static uint32_t length(const Lists *l, uint32_t loop) {
    return l->current[loop].count < 0 ? l->s->list_count[loop] : (uint32_t)l->current[loop].count;
}

static bool is_root(ListsAt at) { return at.first == UINT64_MAX; }

ListsAt lists_begin(Lists *l, Batch *b) {
    l->top = 0;
    for (uint32_t i = 0; i < l->s->nlists && l->any; i++)
        l->root[i] = b->args.cull ? b->args.cull[i] : (SltCullList){NULL, NONE};
    return (ListsAt){UINT64_MAX, 0};
}

/* Makes `current` those of l->node. */
static void find_current(Lists *l) {
    memcpy(l->current, l->root, l->s->nlists * sizeof *l->current);
    if (is_root(l->node)) return;
    const int32_t *item = l->items + l->node.first;
    for (uint32_t i = 0; i < l->s->nlists; i++) {
        int32_t n = *item++;
        if (n == ROOT) continue;
        l->current[i] = (SltCullList){item, n};
        item += n;
    }
}

void lists_enter(Lists *l, Batch *b, ListsAt at) {
    if (!l->any) return;
    b->args.cull = l->current;
    l->node = at;
    l->top = at.end;
    find_current(l);
}

bool lists_note(Lists *l, Batch *b) {
    if (!l->any) return true;
    uint64_t n = 0;
    for (uint32_t i = 0; i < l->s->nlists; i++) n += l->s->list_noted[i] ? length(l, i) : 0;
    if (n > l->note_cap) {
        free(l->notes);
        l->note_cap = n + n / 2;
        if (!(l->notes = malloc(l->note_cap * sizeof *l->notes))) {
            l->note_cap = 0;
            return false;
        }
    }
    if (n) memset(l->notes, 0, n * sizeof *l->notes);
    for (uint32_t i = 0, at = 0; i < l->s->nlists; i++) {
        l->note[i] = n ? l->notes + at : NULL;
        at += l->s->list_noted[i] ? length(l, i) : 0;
    }
    b->args.note = l->note;
    return true;
}

/* Leaves in `may` what counts: what no later iteration overwrites. Adds up the items of each box. */
static void settle(SltNote *note, uint32_t n, uint64_t wanted, uint64_t *count) {
    uint64_t hidden = ~wanted;
    for (uint32_t j = n; j-- > 0;) {
        uint64_t keep = note[j].may & ~hidden;
        hidden |= note[j].must;
        note[j].may = keep;
        for (; keep; keep &= keep - 1) count[__builtin_ctzll(keep)]++;
    }
}

static void distribute(const SltNote *note, uint32_t n, const int32_t *item, int32_t *items, uint64_t *from) {
    for (uint32_t j = 0; j < n; j++)
        for (uint64_t keep = note[j].may; keep; keep &= keep - 1)
            items[from[__builtin_ctzll(keep)]++] = item ? item[j] : (int32_t)j;
}

bool lists_narrow(Lists *l, Batch *b, uint32_t n) {
    b->args.note = NULL;
    if (!l->any || !n) return true;
    uint64_t need = l->top, first = l->top;
    for (uint32_t i = 0; i < l->s->nlists; i++) need += 1 + (l->s->list_noted[i] ? length(l, i) : 0);
    if (!room(l, need)) return false;
    find_current(l); /* the array may have moved */
    for (uint32_t i = 0; i < l->s->nlists; i++) {
        int32_t *count = &l->items[l->top++];
        *count = l->s->list_noted[i] ? 0 : ROOT;
        if (*count == ROOT) continue;
        settle(l->note[i], length(l, i), n < 64 ? ((uint64_t)1 << n) - 1 : UINT64_MAX, l->count);
        for (uint32_t j = 0; j < length(l, i); j++)
            if (l->note[i][j].may)
                l->items[l->top++] = l->current[i].items ? l->current[i].items[j] : (int32_t)j, ++*count;
    }
    l->node.first = first;
    find_current(l);
    return true;
}

bool lists_split(Lists *l, Batch *b, uint32_t n, uint64_t wanted) {
    b->args.note = NULL;
    if (!l->any) return true;
    if (n < 64) wanted &= ((uint64_t)1 << n) - 1;
    memset(l->count, 0, (uint64_t)l->s->nlists * SLT_PAD * sizeof *l->count);
    for (uint32_t i = 0; i < l->s->nlists; i++)
        if (l->s->list_noted[i]) settle(l->note[i], length(l, i), wanted, l->count + (uint64_t)i * SLT_PAD);
    uint64_t top = l->top;
    for (uint32_t box = 0; box < n; box++) {
        l->at[box].first = wanted >> box & 1 ? top : l->node.first;
        if (!(wanted >> box & 1)) continue;
        for (uint32_t i = 0; i < l->s->nlists; i++) top += 1 + l->count[(uint64_t)i * SLT_PAD + box];
    }
    if (!room(l, top)) return false;
    find_current(l); /* the array may have moved, and the node's lists with it */
    top = l->top;
    for (uint32_t box = 0; box < n; box++) {
        if (!(wanted >> box & 1)) continue;
        for (uint32_t i = 0; i < l->s->nlists; i++) {
            uint64_t count = l->count[(uint64_t)i * SLT_PAD + box];
            l->items[top++] = l->s->list_noted[i] ? (int32_t)count : ROOT;
            l->from[(uint64_t)i * SLT_PAD + box] = top;
            top += count;
        }
    }
    for (uint32_t i = 0; i < l->s->nlists; i++)
        if (l->s->list_noted[i])
            distribute(l->note[i], length(l, i), l->current[i].items, l->items, l->from + (uint64_t)i * SLT_PAD);
    for (uint32_t box = 0; box < n; box++) l->at[box].end = top;
    l->top = top;
    return true;
}
