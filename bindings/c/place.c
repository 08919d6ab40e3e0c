/* Places in the source for what went wrong in a call: the site of a crossing that was dropped, or the decision that
 * differs on its two sides; and the operation that made a result infinite or NaN of numbers that were finite, at a
 * point that is looked for among the samples of the call. Programs are interpreted for that, and only where counters
 * say that there is something to be found. */
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "bindings/c/api.h"
#include "bindings/c/place.h"
#include "runtime/sample/grid.h"

enum {
    LANES = POINT_LANES,
    DECIDE_FUEL = 1 << 24,
    SEARCH_FUEL = 1 << 22, /* instructions, each on LANES points */
    SEARCHES = 4,          /* in vain, of a program: those of a fit would each cost as much */
    EXTRA = 64,            /* samples of a pixel, at least: an exact pixel looked at points of its own */
    TEXT = 60              /* bytes of the source that are shown */
};

/* ---- naming */
void api_name_place(const SltProgram *p, SltPlace *at, Span span) {
    if (span.file < 0) return;
    const Source *source = &p->session->sources[span.file];
    at->file = source->path;
    span_position(p->session, span, &at->line, &at->column);
    uint32_t n = span.len < TEXT ? span.len : TEXT;
    for (uint32_t i = 0; i < n; i++)
        if (source->text[span.pos + i] == '\n') n = i;
    at->text = arena_printf(&p->session->session, "%.*s", (int)n, source->text + span.pos);
}

/* ---- inputs of the interpreter */
static void put(const PointInputs *in, double *array, uint32_t lane, double v) {
    if (in->f64) array[lane] = v;
    else ((float *)array)[lane] = (float)v;
}

static double get(bool f64, const void *array, uint32_t lane) {
    return f64 ? ((const double *)array)[lane] : (double)((const float *)array)[lane];
}

void api_inputs_begin(PointInputs *in, const SltProgram *p, const SltJob *job) {
    memset(in, 0, offsetof(PointInputs, out));
    in->f64 = p->opt.f64;
    in->args = (SltKernelArgs){
        .params = p->flt, .iparams = p->scene.iparams, .geometries = p->scene.geometries, .resolution = {1, 1}};
    for (uint32_t i = 0; i < LANES; i++) put(in, in->ones, i, 1);
    for (uint32_t s = 0; s < SLT_IN_VARYING; s++) in->args.in[s] = in->zero;
    for (uint32_t d = 0; d < 3; d++) in->args.in[SLT_IN_X0 + d] = in->flt[d];
    for (uint32_t c = 0; c < SLT_MAX_CHANNELS; c++) in->args.in[SLT_IN_SEED0 + c] = in->ones;
    for (uint32_t o = 0; o < SLT_OUT_MAX; o++) in->args.out[o] = in->out[o];
    in->args.in[SLT_IN_STREAM] = in->stream, in->args.in[SLT_IN_RAND0] = in->flt[3];
    for (uint32_t d = 0; d < 2; d++) {
        if (job && !job->integral && d < p->scene.dim) in->args.resolution[d] = (int32_t)job->size[d];
        in->lo[d] = p->scene.lo[d], in->side[d] = (p->scene.hi[d] - p->scene.lo[d]) / in->args.resolution[d];
        in->args.in[SLT_IN_PIXEL0 + d] = in->pixel[d];
    }
}

void api_inputs_point(PointInputs *in, uint32_t lane, const double x[3], int32_t stream, double rand0) {
    for (uint32_t d = 0; d < 3; d++) put(in, in->flt[d], lane, x[d]);
    put(in, in->flt[3], lane, rand0);
    in->stream[lane] = stream;
    for (uint32_t d = 0; d < 2; d++) {
        const int32_t last = in->args.resolution[d] - 1;
        const double at = (x[d] - in->lo[d]) / in->side[d];
        const int32_t cell = !(at > 0) ? 0 : at > last ? last : (int32_t)at;
        in->pixel[d][lane] = d ? last - cell : cell; /* rows from the top */
    }
}

/* ---- the first decision that differs between two points */
typedef struct Deciding {
    Span span;
} Deciding;

static void see_decision(void *user, const Inst *i, const void *const *slot, const uint8_t *on) {
    Deciding *t = user;
    bool decides = i->type == TY_BOOL || (i->type == TY_INT && i->nargs && i->args[0]->type == TY_FLT);
    if (t->span.file >= 0 || !on[0] || !on[1] || !decides || ir_is_const(i) || i->span.file < 0) return;
    const int32_t *v = slot[i->id];
    if (v[0] != v[1]) t->span = i->span;
}

/* The other boundary there, where it can be one alone. */
static void name_twin(const SltProgram *p, SltPlace *at) {
    const char *text = NULL;
    uint32_t twins = 0;
    for (uint32_t t = 0; t < p->ntwins; t++)
        for (uint32_t i = 0; i < 2; i++) {
            if (p->twins[t].site[i] + 1 != at->site) continue;
            text = p->prog->primal->sites[p->twins[t].site[!i]].text;
            twins++;
        }
    if (twins == 1 && text && at->text && strcmp(text, at->text) != 0)
        at->text = arena_printf(&p->session->session, "%s` and `%s", at->text, text);
}

static void name_drop(const SltProgram *p, SltPlace *at) {
    if (at->site) {
        api_name_place(p, at, p->prog->primal->sites[at->site - 1].span);
        return;
    }
    PointInputs in;
    uint64_t fuel = DECIDE_FUEL;
    Deciding t = {SPAN_NONE};
    api_inputs_begin(&in, p, NULL);
    api_inputs_point(&in, 0, at->x, at->stream, at->rand0);
    api_inputs_point(&in, 1, at->beyond, at->stream, at->rand0);
    if (ir_interpret_watched(p->prog->primal, &in.args, 2, 2, &fuel, 0, see_decision, &t) == SLT_OK)
        api_name_place(p, at, t.span);
}

typedef struct Naming {
    SltProgram *p;
    SltStats *stats;
    const Blame *blame;
    const SltJob *job;
    const Fn *fn; /* what is interpreted, to find a place */
} Naming;

static void name_drops(Session *s, void *user) {
    Naming *n = user;
    (void)s;
    for (int d = 0; d < SLT_DROP_REASONS; d++) {
        SltPlace *at = &n->stats->dropped_at[d];
        if (!at->known || at->line) continue;
        name_drop(n->p, at);
        if (d == SLT_DROP_COINCIDENT) name_twin(n->p, at);
    }
}

void api_name_drops(SltProgram *p, SltStats *stats) {
    bool any = false;
    for (int d = 0; d < SLT_DROP_REASONS; d++) any |= stats->dropped_at[d].known && !stats->dropped_at[d].line;
    Naming n = {.p = p, .stats = stats};
    if (any) session_protect(p->session, name_drops, &n); /* without memory there is no place, and that is all */
}

/* ---- the operation that is to blame for what is not finite */
typedef struct Seen {
    uint32_t born; /* 1 + when its result was not finite for the first time while its arguments were; 0: never */
    bool bad;      /* its result was not finite */
    uint8_t taken; /* by a choice, while its result was not: bits of its operands */
    bool matters;
} Seen;
typedef struct Origin {
    bool f64;
    Seen *seen; /* by id */
    uint32_t clock;
} Origin;

static bool is_bad(const Origin *o, const Inst *i, const void *const *slot) {
    return i->type == TY_FLT && !isfinite(get(o->f64, slot[i->id], 0));
}

static void see_number(void *user, const Inst *i, const void *const *slot, const uint8_t *on) {
    Origin *o = user;
    o->clock++;
    if (!on[0]) return;
    for (uint32_t k = 0; k < i->nargs; k++) /* results and parameters of loops are written by these */
        if (is_bad(o, i->args[k], slot)) o->seen[i->args[k]->id].bad = true;
    if (!is_bad(o, i, slot)) return;
    Seen *seen = &o->seen[i->id];
    seen->bad = true;
    bool made = i->op != OP_proj && i->op != OP_arg && i->op != OP_load && !i->nregions && !ir_is_const(i);
    for (uint32_t k = 0; k < i->nargs; k++) made &= !is_bad(o, i->args[k], slot);
    if (made && !seen->born) seen->born = o->clock;
    if (ir_ops[i->op].selects && i->args[0]->type == TY_BOOL)
        seen->taken |= ((const int32_t *)slot[i->args[0]->id])[0] ? 2 : 4;
}

typedef struct Chase {
    Origin *o;
    const Inst **stack; /* [fn->ninsts]: each is pushed once */
    uint32_t n;
    const Inst *first; /* of those that matter, the one that was born first */
} Chase;

static void chase_push(Chase *c, const Inst *i) {
    Seen *s = &c->o->seen[i->id];
    if (i->type != TY_VOID && i->type != TY_ARRAY && !s->bad) return;
    if (s->matters) return;
    s->matters = true, c->stack[c->n++] = i;
}

static void push_yields(Chase *c, const Inst *i) {
    for (uint32_t r = 0; r < i->nregions; r++)
        for (uint32_t k = 0; k < i->region[r]->last->nargs; k++) chase_push(c, i->region[r]->last->args[k]);
}

/* Stores to an array are not followed to their places: all of the function are. */
static void push_stores(Chase *c, const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_store || i->op == OP_acopy) chase_push(c, i);
        for (uint32_t r = 0; r < i->nregions; r++) push_stores(c, i->region[r]);
    }
}

static void push_roots(Chase *c, const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_adj) chase_push(c, i->args[1]);
        for (uint32_t r = 0; r < i->nregions; r++) push_roots(c, i->region[r]);
    }
}

static void chase(Chase *c, const Fn *fn) {
    while (c->n) {
        const Inst *i = c->stack[--c->n];
        const Seen *s = &c->o->seen[i->id];
        if (s->born && i->span.file >= 0 && (!c->first || s->born < c->o->seen[c->first->id].born)) c->first = i;
        if (i->op == OP_load) push_stores(c, fn->body);
        if (i->op == OP_arg) continue; /* its loop was pushed with what it hands out, below */
        for (uint32_t k = 0; k < i->nargs; k++)
            if (!s->taken || s->taken >> k & 1) chase_push(c, i->args[k]);
        push_yields(c, i);
        for (const Inst *o = i->block->owner; o; o = o->block->owner) chase_push(c, o);
    }
}

/* Which operation of fn, at the point of lane 0? */
static Span find_origin(const SltProgram *p, const Fn *fn, PointInputs *in) {
    Arena *scratch = &p->session->scratch;
    Origin o = {.f64 = p->opt.f64, .seen = ARENA_ARRAY(scratch, Seen, fn->ninsts + 1)};
    Chase c = {.o = &o, .stack = ARENA_ARRAY(scratch, const Inst *, fn->ninsts + 1)};
    uint64_t fuel = DECIDE_FUEL;
    memset(o.seen, 0, sizeof *o.seen * (fn->ninsts + 1));
    if (ir_interpret_watched(fn, &in->args, 1, 1, &fuel, 0, see_number, &o) != SLT_OK) return SPAN_NONE;
    const Inst *results = fn->body->last;
    for (uint32_t k = 0; k < results->nargs; k++) chase_push(&c, results->args[k]);
    push_roots(&c, fn->body);
    chase(&c, fn);
    return c.first ? c.first->span : SPAN_NONE;
}

/* ---- the point */
typedef struct Looking {
    SltProgram *p;
    const Fn *fn;
    const SltJob *job;
    Grid grid;
    PointInputs in;
    void *adjoint; /* of the parameters, for reverse kernels */
    void *direction;
    uint64_t fuel;
    SltPlace at[LANES];
    uint32_t n;
    SltPlace *out;
    bool found;
} Looking;

static bool run_is_bad(Looking *l, uint32_t n) {
    const SltProgram *p = l->p;
    uint64_t before = l->fuel, fuel = before;
    memset(l->adjoint, 0, sizeof(double) * (p->prog->nfloats + 1));
    l->in.args.n_valid = n;
    if (ir_interpret_within(l->fn, &l->in.args, n, n > 1 ? LANES : 1, &fuel) != SLT_OK) {
        l->fuel = 0;
        return false;
    }
    l->fuel = fuel;
    const Inst *results = l->fn->body->last;
    bool bad = false;
    for (uint32_t k = 0; k < results->nargs && k < SLT_OUT_MAX; k++)
        for (uint32_t i = 0; i < n && results->args[k]->type == TY_FLT; i++)
            bad |= !isfinite(get(p->opt.f64, l->in.out[k], i));
    for (uint32_t f = 0; f < p->prog->nfloats; f++) bad |= !isfinite(get(p->opt.f64, l->adjoint, f));
    return bad;
}

/* Asks about the points that wait; true: there is no need for more. */
static bool look(Looking *l) {
    uint32_t n = l->n;
    l->n = 0;
    if (!n || l->found || !l->fuel) return l->found || !l->fuel;
    for (uint32_t i = 0; i < n; i++) api_inputs_point(&l->in, i, l->at[i].x, l->at[i].stream, l->at[i].rand0);
    if (!run_is_bad(l, n)) return !l->fuel;
    for (uint32_t i = 0; i < n && !l->found; i++) {
        api_inputs_point(&l->in, 0, l->at[i].x, l->at[i].stream, l->at[i].rand0);
        if (!run_is_bad(l, 1)) continue;
        l->found = true;
        *l->out = l->at[i];
        memset(l->adjoint, 0, sizeof(double) * (l->p->prog->nfloats + 1));
        api_name_place(l->p, l->out, find_origin(l->p, l->fn, &l->in));
    }
    return l->found || !l->fuel;
}

static bool add_point(Looking *l, const SltPlace *at) {
    l->at[l->n++] = *at;
    return l->n == LANES && look(l);
}

static bool add_sample(Looking *l, const Pattern *q, const uint32_t cell[3], uint64_t i, SltPlace at) {
    const Grid *g = &l->grid;
    for (uint32_t d = 0; d < g->dim; d++)
        at.x[d] = l->job->centred ? grid_middle(g, d, cell[d]) : grid_place(g, d, cell[d], pattern_at(q, d, i));
    memcpy(at.beyond, at.x, sizeof at.x);
    if (l->p->scene.uses_rand) at.stream = pattern_stream(q, i), at.rand0 = pattern_at(q, g->dim, i);
    return add_point(l, &at);
}

static bool look_in_pixel(Looking *l, const uint32_t pixel[3], uint32_t half, uint64_t samples) {
    const Grid *g = &l->grid;
    uint32_t cell[3] = {pixel[0], g->n[1] - 1 - pixel[1], pixel[2]};
    SltPlace at = {.known = true, .in_image = true, .pixel = {pixel[0], pixel[1], pixel[2]}};
    Pattern q;
    pattern_init(&q, &l->p->scene, l->job->seed, RNG_PIXEL, half, grid_index(g, cell[0], cell[1], cell[2]));
    for (uint64_t i = 0; i < samples; i++)
        if (add_sample(l, &q, cell, i, at)) return true;
    return false;
}

/* All pixels: which of them made a derivative of a sum over them what it is, nobody knows. */
static void look_in_image(Looking *l) {
    for (uint32_t half = 1; half <= 3; half++)
        for (uint64_t i = 0; i < l->grid.pixels; i++) {
            uint32_t w = l->grid.n[0], h = l->grid.n[1];
            uint32_t pixel[3] = {(uint32_t)(i % w), (uint32_t)(i / w % h), (uint32_t)(i / w / h)};
            if (look_in_pixel(l, pixel, half % 3, l->job->spp ? l->job->spp : 1)) return;
        }
}

/* Where functions like to have their poles: halves of the domain, again and again. Cells have Gauss points near. */
static bool look_at_lattice(Looking *l) {
    const Grid *g = &l->grid;
    for (uint32_t steps = 2; steps <= 16; steps *= 2)
        for (uint32_t i = 0, n = steps + 1, all = g->dim == 1 ? n : g->dim == 2 ? n * n : n * n * n; i < all; i++) {
            SltPlace at = {.known = true};
            uint32_t rest = i;
            for (uint32_t d = 0; d < g->dim; d++, rest /= n)
                at.x[d] = g->lo[d] + g->side[d] * g->n[d] * (rest % n) / steps;
            memcpy(at.beyond, at.x, sizeof at.x);
            if (add_point(l, &at)) return true;
        }
    return false;
}

/* The two points of lanes 0 and 1: do they decide alike? */
static bool decide_alike(Looking *l, const double a[3], const double b[3]) {
    Deciding t = {SPAN_NONE};
    api_inputs_point(&l->in, 0, a, 0, 0);
    api_inputs_point(&l->in, 1, b, 0, 0);
    l->in.args.n_valid = 2;
    if (ir_interpret_watched(l->p->prog->primal, &l->in.args, 2, 2, &l->fuel, 0, see_decision, &t) != SLT_OK)
        l->fuel = 0;
    return t.span.file < 0;
}

/* Where something decides otherwise, down to neighbouring numbers of the program's precision: there lies the 0 of a
 * root that is thrown away beyond it. */
static bool look_between(Looking *l, uint32_t axis, double a[3], double b[3]) {
    for (bool apart = true; apart && l->fuel;) {
        double middle = (a[axis] + b[axis]) / 2, was = a[axis];
        if (!l->p->opt.f64) middle = (float)middle;
        apart = middle != a[axis] && middle != b[axis];
        a[axis] = middle;
        if (!decide_alike(l, a, b)) continue;
        b[axis] = middle, a[axis] = was;
    }
    SltPlace at = {.known = true};
    for (int side = 0; side < 2; side++) {
        memcpy(at.x, side ? b : a, sizeof at.x);
        memcpy(at.beyond, at.x, sizeof at.x);
        if (add_point(l, &at)) return true;
    }
    return false;
}

static bool look_at_edges(Looking *l) {
    enum { LINES = 8, STEPS = 16 };
    const Grid *g = &l->grid;
    for (uint32_t i = 0, lines = g->dim > 1 ? LINES : 1; i < lines * g->dim; i++)
        for (uint32_t k = 0; k < STEPS && l->fuel; k++) {
            double a[3] = {0}, b[3];
            for (uint32_t d = 0; d < g->dim; d++)
                a[d] = g->lo[d] + g->side[d] * g->n[d] * (i / g->dim + 0.5 + 0.1 * d) / LINES;
            memcpy(b, a, sizeof b);
            uint32_t axis = i % g->dim;
            double step = g->side[axis] * g->n[axis] / STEPS;
            a[axis] = g->lo[axis] + k * step, b[axis] = a[axis] + step;
            if (!decide_alike(l, a, b) && look_between(l, axis, a, b)) return true;
        }
    return look(l);
}

static void look_in_integral(Looking *l) {
    enum { REPLICATES = 4 };
    static const uint32_t cell[3];
    SltPlace at = {.known = true};
    uint64_t samples = l->job->samples ? l->job->samples : 1u << 18;
    for (uint64_t i = 0; i < samples; i++)
        for (uint32_t r = 0; r < REPLICATES; r++) {
            Pattern q;
            pattern_init(&q, &l->p->scene, l->job->seed, RNG_INTEGRAL, 0, r);
            if (add_sample(l, &q, cell, i, at)) return;
        }
}

static void find_place(Session *s, void *user) {
    Naming *n = user;
    const Blame *b = n->blame;
    SltProgram *p = n->p;
    ArenaMark m = arena_mark(&s->scratch);
    Looking *l = ARENA_ARRAY(&s->scratch, Looking, 1);
    memset(l, 0, sizeof *l);
    l->p = p, l->job = n->job, l->fuel = SEARCH_FUEL, l->out = &n->stats->nonfinite_at;
    l->fn = n->fn;
    if (l->fn && grid_init(&l->grid, &p->scene, n->job, NULL) == SLT_OK) {
        uint32_t nf = p->prog->nfloats;
        l->adjoint = ARENA_ARRAY(&s->scratch, double, nf + 1);
        l->direction = ARENA_ARRAY(&s->scratch, double, nf + 1);
        api_inputs_begin(&l->in, p, n->job);
        for (uint32_t f = 0; f < nf; f++) put(&l->in, l->direction, f, b->direction ? b->direction[f] : 1);
        l->in.args.adj = l->adjoint, l->in.args.dparams = l->direction;
        if (b->pixel) look_in_pixel(l, b->pixel, 0, n->job->spp > EXTRA ? n->job->spp : EXTRA);
        else if (!n->job->integral) look_in_image(l);
        else if (!look_at_lattice(l) && !look_at_edges(l)) look_in_integral(l);
        look(l);
        grid_free(&l->grid);
    }
    arena_reset(&s->scratch, m);
}

void api_find_nonfinite(SltProgram *p, const SltJob *job, const Blame *blame, SltStats *stats) {
    if (stats->nonfinite_at.known || p->nonfinite_sought >= SEARCHES) return;
    Naming n = {.p = p, .stats = stats, .blame = blame, .job = job, .fn = p->prog->primal};
    if (blame->derivative) n.fn = api_fn(p, p->has[K_VJP] ? K_VJP : K_JVP);
    session_protect(p->session, find_place, &n); /* without memory there is no place, and that is all */
    if (stats->nonfinite_at.known) return;
    p->nonfinite_sought++;
    if (!blame->pixel) return;
    stats->nonfinite_at = (SltPlace){.known = true, .in_image = true};
    memcpy(stats->nonfinite_at.pixel, blame->pixel, sizeof stats->nonfinite_at.pixel);
}
