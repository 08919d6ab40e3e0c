/* Lists of parts of a tile: listed.h. */
#include "bindings/c/listed.h"

#include "compiler/pass/walk.h"

/* Compiling `bounds` takes about as long as shading so many samples takes, for each instruction of the program. */
static const double worth = 1 << 26;
enum { LEAST = 16 /* iterations, as narrow.c */, LEAST_OF_PIXELS = 8 };

/* To ask about a tile takes as long whatever its size is. */
static bool is_large(const SltJob *job) {
    return job->size[0] % PIXEL_SIDE == 0 && (uint64_t)job->size[0] * job->size[1] >= LISTED_TILE * LISTED_TILE;
}

/* Another value kernel, whose pixels of a row share something or not. */
static void switch_to(SltProgram *p, int lists) {
    p->lists = lists;
    p->tried[K_VALUE] = p->has[K_VALUE] = false, p->fn[K_VALUE] = NULL, p->scene.kernel[K_VALUE] = NULL;
}

bool api_lists_pay(SltProgram *p, double samples) {
    const Block *body = p->prog->primal->body;
    uint64_t n = 0;
    for (uint32_t i = 0; i < p->nlists; i++) n += p->list_counts[i];
    if (n < (p->opt.rgba8 ? LEAST_OF_PIXELS : LEAST) || p->prog->dim != 2 || p->prog->ngeometries || p->scene.chunks ||
        p->opt.interpret || api_too_many_sites(p) || ir_has(body, OP_print) /* which comes row by row */)
        return false;
    p->list_work += samples * p->scene.work;
    return p->list_work >= worth * (p->opt.rgba8 ? variant_written_size(p->prog->primal) : walk_size(body));
}

bool api_wants_lists(SltProgram *p, const SltJob *job) {
    if (p->lists != LISTS_UNASKED) return p->lists == LISTS_USED;
    if (!is_large(job) || !api_lists_pay(p, (double)job->size[0] * job->size[1])) return false;
    switch_to(p, LISTS_USED);
    variant_written_lists(p->prog->primal, p->list_counts, &p->nlists);
    return true;
}

void listed_judge(SltProgram *p, uint64_t all, uint64_t kept) {
    if (kept > all / 8 * 7) switch_to(p, LISTS_USELESS);
}

bool listed_serves(const SltProgram *p, const SltJob *job) {
    const SltScene *s = &p->scene;
    bool noted = false;
    for (uint32_t i = 0; i < s->nlists && s->list_noted; i++) noted |= s->list_noted[i] != 0;
    return p->lists == LISTS_USED && noted && s->kernel[SLT_K_BOUNDS] && is_large(job);
}

bool listed_init(Listed *l, const SltProgram *p, const SltJob *job) {
    bool ok = batch_init(&l->batch, &p->scene, NULL);
    for (uint32_t d = 0; d < 2; d++) l->batch.args.resolution[d] = (int32_t)job->size[d];
    return lists_init(&l->lists, &p->scene) && ok;
}

void listed_free(Listed *l) { batch_free(&l->batch), lists_free(&l->lists); }

static uint32_t cut(const PixelPart *tile, PixelPart *part) {
    uint32_t n = 0;
    for (uint32_t y = 0; y < tile->n[1]; y += LISTED_PART)
        for (uint32_t x = 0; x < tile->n[0]; x += LISTED_PART, n++) {
            const uint32_t at[2] = {x, y};
            for (uint32_t d = 0; d < 2; d++) {
                const uint32_t left = tile->n[d] - at[d];
                part[n].first[d] = tile->first[d] + at[d], part[n].n[d] = left < LISTED_PART ? left : LISTED_PART;
            }
        }
    return n;
}

/* Of loops that are written out the first iteration, which all samples run. */
static void count(Listed *l, uint32_t n, uint32_t nlists) {
    const SltScene *s = l->lists.s;
    for (uint32_t j = 0; j < nlists; j++) {
        if (!s->list_noted[j]) continue;
        l->all += (uint64_t)n * s->list_count[j];
        for (uint32_t i = 0; i < n; i++) l->kept += l->lists.count[(uint64_t)j * SLT_PAD + i];
    }
}

uint32_t listed_tile(Listed *l, const SltProgram *p, const SltJob *job, const PixelPart *tile,
                     PixelPart part[LISTED_PARTS]) {
    Batch *b = &l->batch;
    const uint32_t n = cut(tile, part);
    b->args.cull = NULL; /* all of it is asked about, of each tile */
    lists_enter(&l->lists, b, lists_begin(&l->lists, b));
    if (!lists_note(&l->lists, b)) return 0;
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t d = 0; d < 2; d++) {
            const uint32_t first = part[i].first[d], last = first + part[i].n[d] - 1,
                           least = d ? job->size[d] - 1 - last : first, most = d ? job->size[d] - 1 - first : last;
            batch_set(b, SLT_IN_X0 + d, i, api_middle(p, job, d, least));
            batch_set(b, SLT_IN_H0 + d, i, api_middle(p, job, d, most));
        }
    batch_call(b, SLT_K_BOUNDS, n);
    double f[SLT_MAX_CHANNELS];
    l->flat = 0;
    for (uint32_t i = 0; i < n; i++) l->flat |= (uint32_t)batch_is_constant(b, i, f) << i;
    if (!lists_split(&l->lists, b, n, UINT64_MAX)) return 0;
    for (uint32_t i = 0; i < n; i++) l->of[i] = lists_of(&l->lists, i);
    count(l, n, p->first_lists);
    return n;
}

const SltCullList *listed_part(Listed *l, uint32_t i) {
    lists_enter(&l->lists, &l->batch, l->of[i]);
    return l->lists.current;
}
