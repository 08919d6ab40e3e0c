/* What bounds can and cannot do with a program: seams, what nothing bounds, loops with lists, and a trial. */
#include <string.h>

#include "cli/explain.h"
#include "compiler/pass/depend.h"
#include "compiler/pass/walk.h"
#include "saltus/chunks.h"

enum { TRIAL = 4096 /* boxes at most */ };

static ExplainedPlace place_of(const SltProgram *p, Span span, const char *what, const char *text) {
    ExplainedPlace at = {.what = what, .text = text ? text : ""};
    if (span.file < 0) return at;
    at.file = p->session->sources[span.file].path;
    span_position(p->session, span, &at.line, &at.column);
    return at;
}

static bool same_place(const ExplainedPlace *a, const ExplainedPlace *b) {
    return a->file == b->file && a->line == b->line && a->column == b->column && !strcmp(a->what, b->what);
}

/* Code that was inlined at several places is one place in the source. */
static void add_place(ExplainedPlace *list, uint32_t *n, ExplainedPlace at) {
    for (uint32_t i = 0; i < *n; i++)
        if (same_place(&list[i], &at)) return;
    list[(*n)++] = at;
}

/* Minima, maxima and absolute values bend; other seams jump. The seam's text is the name of its operation. */
static const char *seam_kind(const char *text) {
    bool bends = !strcmp(text, "min") || !strcmp(text, "max") || !strcmp(text, "abs");
    return bends ? "kink" : "jump";
}

static void explain_seams(const SltProgram *p, Arena *arena, ExplainedBounds *out) {
    const Fn *fn = p->fn[K_BOUNDS];
    uint32_t sites = p->prog->primal->nsites;
    if (!fn || fn->nsites <= sites) return;
    out->seams = ARENA_ARRAY(arena, ExplainedPlace, fn->nsites - sites);
    for (uint32_t s = sites; s < fn->nsites; s++)
        add_place(out->seams, &out->nseams,
                  place_of(p, fn->sites[s].span, seam_kind(fn->sites[s].text), fn->sites[s].text));
}

/* Why no box settles what depends on this; NULL: it has bounds. */
static const char *why_unbounded(const Inst *i) {
    switch ((Op)i->op) {
    case OP_rand: return "rand() is any number in [0, 1)";
    case OP_query: return "a ray: bounds know at most whether it is blocked";
    case OP_input:
        if (i->imm.i == IN_PIXEL0 || i->imm.i == IN_PIXEL1) return "pixel() is any pixel";
        return i->imm.i == IN_SAMPLE ? "sample_index() is any sample" : NULL;
    default: return NULL; /* all others are the same at every point, or have a row of bounds */
    }
}

static void find_unbounded(const SltProgram *p, const Block *b, ExplainedBounds *out) {
    for (const Inst *i = b->first; i; i = i->next) {
        const char *why = why_unbounded(i);
        if (why) add_place(out->unbounded, &out->nunbounded, place_of(p, i->span, why, NULL));
        if (i->op == OP_loop && !i->imm.loop.exact)
            add_place(out->wide, &out->nwide,
                      place_of(p, i->span, "a loop that ends by a condition: bounds widen from iteration to iteration",
                               NULL));
        if (i->op == OP_loop && i->imm.loop.cull)
            out->lists[out->nlists++] = (ExplainedList){.at = place_of(p, i->span, "loop", NULL),
                                                        .iterations = i->imm.loop.max_iters,
                                                        .cull = i->imm.loop.cull_id < p->prog->ncull};
        for (uint32_t r = 0; r < i->nregions; r++) find_unbounded(p, i->region[r], out);
    }
}

/* Minima, maxima and absolute values that differ within the domain, which would be seams. */
static bool has_bends(const Depend *on, const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        bool bends = i->op == OP_fmin || i->op == OP_fmax || i->op == OP_fabs;
        if (bends && on[i->id].on & DEPENDS_X) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (has_bends(on, i->region[r])) return true;
    }
    return false;
}

/* Seams are given up, kinks first, where the program has too many of them or is too large. */
static bool is_crowded(SltProgram *p, const ExplainedBounds *b) {
    if (!p->fn[K_BOUNDS] || p->prog->ngeometries || p->chunked) return false; /* of chunks choices are seams */
    for (uint32_t i = 0; i < b->nseams; i++)
        if (!strcmp(b->seams[i].what, "kink")) return false;
    Arena *scratch = &p->session->scratch;
    ArenaMark mark = arena_mark(scratch);
    bool crowded = has_bends(depend_values(p->prog->primal, (DependOptions){0}), p->prog->primal->body);
    arena_reset(scratch, mark);
    return crowded;
}

/* Boxes of 1/16 to 1/4096 of each side, by the dimension. */
static SltStatus try_boxes(SltProgram *p, Arena *arena, ExplainedBounds *out, SltError *err) {
    static const uint32_t sides[] = {0, TRIAL, 64, 16};
    uint32_t dim = p->prog->dim, side = sides[dim], n = 1;
    for (uint32_t d = 0; d < dim; d++) n *= side;
    double *lo = ARENA_ARRAY(arena, double, n *dim), *hi = ARENA_ARRAY(arena, double, n *dim);
    SltBound *b = ARENA_ARRAY(arena, SltBound, n);
    for (uint32_t i = 0; i < n; i++) {
        uint32_t rest = i;
        b[i] = SLT_BOUND_INIT;
        for (uint32_t d = 0; d < dim; d++, rest /= side) {
            double step = (p->prog->hi[d] - p->prog->lo[d]) / side;
            lo[i * dim + d] = p->prog->lo[d] + rest % side * step;
            hi[i * dim + d] = p->prog->lo[d] + (rest % side + 1) * step;
        }
    }
    SltStatus status = slt_bound(p, NULL, n, lo, hi, b, err);
    if (status == SLT_USAGE) return SLT_OK; /* kernels for another processor, or of pixels: no trial */
    if (status != SLT_OK) return status;
    out->boxes = n;
    for (uint32_t i = 0; i < n; i++)
        if (b[i].settled) out->settled++;
        else if (b[i].unknown || b[i].rough) out->unknown++;
        else out->open++;
    return SLT_OK;
}

SltStatus explain_bounds(SltProgram *p, ExplainedBounds *out, SltError *err) {
    Arena *arena = &p->session->session;
    uint32_t n = walk_size(p->prog->primal->body) + 1;
    *out = (ExplainedBounds){.unbounded = ARENA_ARRAY(arena, ExplainedPlace, n),
                             .wide = ARENA_ARRAY(arena, ExplainedPlace, n),
                             .lists = ARENA_ARRAY(arena, ExplainedList, n)};
    explain_seams(p, arena, out);
    find_unbounded(p, p->prog->primal->body, out);
    out->crowded = is_crowded(p, out);
    if (p->scene.chunks) out->chunks = p->scene.chunks->nchunks, out->choices = p->scene.chunks->nchoices;
    return p->fn[K_BOUNDS] ? try_boxes(p, arena, out, err) : SLT_OK;
}
