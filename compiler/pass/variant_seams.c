/* Seams: the places where f, or a g, may jump or bend though no [Disc] says so, as sites of a clone of the primal.
 *
 * A comparison of floats that decides anything gets a site like a tagged one (g = a - b); a rounding, or the conversion
 * to an integer, a siten. Minima, maxima, absolute values and angles keep their row: a siten of kind COMPARE passes the
 * value on and has the difference as its g, that of an angle y. Numbers begin behind the real sites; where two operands
 * are compared twice, both places have one number, for there is one curve. Only `bounds`, `edge` and `edge_bounds` are
 * cut from this clone: no other kernel knows seams.
 *
 * `edge` has code for each of them, at worst the whole program: above EDGES of them, or COST operations, bends stay
 * what they are, then jumps too. */
#include "compiler/pass/depend.h"
#include "compiler/pass/slice.h"
#include "compiler/pass/variant_bounds.h"

enum { EDGES = 192, COST = 12000 };

typedef enum Class { CLASS_NONE, CLASS_JUMP, CLASS_BEND } Class;

typedef struct Known {
    const Inst *p, *q; /* what is compared */
    const Inst *at;    /* visible where a seam may share its number, */
    uint32_t edge;
    Inst *g; /* and its g, of one sign everywhere */
} Known;

typedef struct Seams {
    Fn *fn;
    Arena *arena;
    const Depend *dep;  /* by id of the clone before seams */
    Boxes facts;        /* likewise: bounds_facts alone */
    uint32_t n;         /* ids then */
    const bool *tagged; /* likewise: a tagged decision comes from it */
    const Program *program;
    bool integers; /* tagged decisions of integers, which are no sites, may come from it */
    bool *decides; /* by id of a comparison or rounding: something else than its own site uses it, */
    bool *turns;   /* and not only to choose between the two that it compares, as a minimum does */
    Inst **seam;   /* by id: what stands for the value from now on */
    Vec(SiteInfo) sites;
    Vec(Known) known;
    Inst *loop_k[SLT_MAX_K];
    uint32_t depth; /* of loops around */
    uint64_t events;
    bool bends, jumps;
    uint32_t count[3]; /* by Class, of candidates */
} Seams;

/* Does it decide by something that changes with the position otherwise than by jumps, and that we know? */
static bool moves(const Seams *s, const Inst *i) {
    return bounds_slopes(&s->facts, i) && !(s->dep[i->id].on & DEPENDS_RAND);
}

static Class class_of(const Seams *s, const Inst *i) {
    switch ((Op)i->op) {
    case OP_flt:
    case OP_fle:
    case OP_f2i:
    case OP_f2u:
    case OP_ffloor:
    case OP_fceil:
    case OP_fround:
    case OP_ftrunc: return s->decides[i->id] && moves(s, i) ? CLASS_JUMP : CLASS_NONE;
    case OP_fatan2: return moves(s, i) ? CLASS_JUMP : CLASS_NONE;
    case OP_fmin:
    case OP_fmax:
    case OP_fabs: return moves(s, i) ? CLASS_BEND : CLASS_NONE;
    default: return CLASS_NONE;
    }
}

/* Is one of them chosen, or nothing? */
static bool chooses_compared(const Inst *cmp, const Inst *yes, const Inst *no) {
    if (cmp->nargs != 2) return false;
    const Inst *p = cmp->args[0], *q = cmp->args[1];
    return yes == no || (yes == p && no == q) || (yes == q && no == p);
}

/* Are the two sides of the branch nothing but values to be chosen from? */
static bool only_chooses(const Inst *cmp, const Inst *i) {
    const Inst *yes = i->region[0]->first, *no = i->region[1]->first;
    if (yes != i->region[0]->last || no != i->region[1]->last || yes->nargs != no->nargs) return false;
    for (uint32_t a = 0; a < yes->nargs; a++)
        if (!chooses_compared(cmp, yes->args[a], no->args[a])) return false;
    return true;
}

static bool jumps_by(const Inst *i, uint32_t a) {
    const Inst *cmp = i->args[a];
    if (a == 0 && i->op == OP_fsel) return !chooses_compared(cmp, i->args[1], i->args[2]);
    return a != 0 || i->op != OP_if_ || !only_chooses(cmp, i);
}

static void find_users(Seams *s, const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t a = 0; a < i->nargs; a++) {
            if (variant_is_site(i) && a == 0) continue;
            s->decides[i->args[a]->id] = true;
            if (jumps_by(i, a)) s->turns[i->args[a]->id] = true;
        }
        for (uint32_t r = 0; r < i->nregions; r++) find_users(s, i->region[r]);
    }
}

/* Does anything jump there? What chooses between the two that it compares bends. */
static bool jumps(const Seams *s, const Inst *i) {
    bool compares = i->op == OP_flt || i->op == OP_fle;
    return class_of(s, i) == CLASS_JUMP && (!compares || s->turns[i->id]);
}

static void count_block(Seams *s, const Block *b, uint32_t depth) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (depth <= SLT_MAX_K) s->count[class_of(s, i)]++;
        for (uint32_t r = 0; r < i->nregions; r++) count_block(s, i->region[r], depth + (i->op == OP_loop));
    }
}

static bool is_visible(const Inst *v, const Block *from) { return walk_inside(from, v->block); }

/* An edge that compares p with q at the same iteration. */
static const Known *find_known(const Seams *s, const Block *b, const Inst *p, const Inst *q) {
    for (uint32_t k = s->known.len; k-- > 0;) {
        const Known *known = &s->known.data[k];
        bool same = (known->p == p && known->q == q) || (known->p == q && known->q == p);
        if (!same || s->sites.data[known->edge].depth != s->depth || !is_visible(known->at, b)) continue;
        return known;
    }
    return NULL;
}

static const char *name_of(const Inst *i) {
    switch ((Op)i->op) {
    case OP_fmin: return "min";
    case OP_fmax: return "max";
    case OP_fabs: return "abs";
    case OP_flt: return "<";
    case OP_fle: return "<=";
    case OP_f2i: return "int";
    case OP_f2u: return "uint";
    default: return ir_ops[i->op].name + 1; /* ffloor, fceil ... */
    }
}

static SiteKind kind_of(const Inst *i) {
    switch ((Op)i->op) {
    case OP_ffloor: return SITE_FLOOR;
    case OP_fceil: return SITE_CEIL;
    case OP_fround: return SITE_ROUND;
    case OP_ftrunc:
    case OP_f2i:
    case OP_f2u: return SITE_TRUNC;
    default: return SITE_COMPARE;
    }
}

static bool is_silenced(const Seams *s, Span at) {
    for (uint32_t k = 0; s->program && k < s->program->nsilenced; k++) {
        Span o = s->program->silenced[k];
        if (o.file == at.file && o.pos == at.pos && o.len == at.len) return true;
    }
    return false;
}

/* The cut of an angle lies where its y says. */
static bool turns_by_a_parameter(const Seams *s, const Inst *i) {
    uint8_t on = i->op == OP_fatan2 ? s->dep[i->args[0]->id].on : 0;
    return (on & DEPENDS_SLOPE) && (on & DEPENDS_PARAM);
}

/* May f jump where this does, at a place that moves, and nothing be integrated? */
static SeamUpset upset_of(const Seams *s, const Inst *i) {
    if (class_of(s, i) != CLASS_JUMP || !(depend_jumps(s->dep, i) || turns_by_a_parameter(s, i))) return UPSETS_NOTHING;
    if (s->integers || !is_silenced(s, i->span)) return UPSETS_UNSEEN;
    return s->tagged[i->id] ? UPSETS_SITES : UPSETS_NOTHING;
}

static uint32_t new_edge(Seams *s, const Inst *i) {
    SiteInfo info = {.kind = kind_of(i), .span = i->span, .path = "", .depth = s->depth, .max_events = s->events};
    info.text = name_of(i), info.upsets = upset_of(s, i);
    info.jumps = jumps(s, i);
    vec_push(s->arena, &s->sites, info);
    return s->sites.len - 1;
}

/* The site of decision or value `of`; stands for it from now on. */
static Inst *add_site(Seams *s, Builder *b, Op op, Inst *of, Inst *g, uint32_t edge) {
    Inst *args[2 + SLT_MAX_K] = {of, g};
    for (uint32_t d = 0; d < s->depth; d++) args[2 + d] = s->loop_k[d];
    return ir_special(b, op, (IrType)of->type, 2 + s->depth, args, (Imm){.i = edge});
}

static void make_seam(Seams *s, Inst *i) {
    Inst *p = i->args[0], *q = i->nargs > 1 && i->op != OP_fatan2 ? i->args[1] : NULL; /* its cut lies where y is 0 */
    if (i->op == OP_f2i || i->op == OP_f2u) {
        Builder b = ir_before(s->fn, i);
        ir_replace_arg(i, 0, add_site(s, &b, OP_siten, ir_emit1(&b, OP_ftrunc, p), p, new_edge(s, i)));
        return;
    }
    const Known *known = q ? find_known(s, i->block, p, q) : NULL;
    uint32_t edge = known ? known->edge : new_edge(s, i);
    if (known && edge >= s->fn->nsites) {
        SiteInfo *info = &s->sites.data[edge];
        if (upset_of(s, i) > info->upsets) info->upsets = upset_of(s, i);
        info->jumps |= jumps(s, i);
    }
    Builder b = ir_after(s->fn, i);
    Inst *g = known ? known->g : q ? ir_emit2(&b, OP_fsub, p, q) : p;
    if (q && !known) vec_push(s->arena, &s->known, ((Known){p, q, i, edge, g}));
    s->seam[i->id] = add_site(s, &b, i->type == TY_BOOL ? OP_site : OP_siten, i, g, edge);
}

static void walk(Seams *s, Block *b) {
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        Class class = i->id < s->n ? class_of(s, i) : CLASS_NONE;
        bool wanted = class == CLASS_JUMP ? s->jumps : class == CLASS_BEND && s->bends;
        if (wanted && s->depth <= SLT_MAX_K) make_seam(s, i);
        if (i->op == OP_site && ir_ops[i->args[0]->op].compares && i->args[0]->nargs == 2)
            vec_push(s->arena, &s->known,
                     ((Known){i->args[0]->args[0], i->args[0]->args[1], i, (uint32_t)i->imm.i, i->args[1]}));
        uint64_t events = s->events;
        if (i->op == OP_loop) {
            if (s->depth < SLT_MAX_K) s->loop_k[s->depth] = i->region[0]->params[0];
            s->depth++;
            s->events = s->events > (UINT64_MAX >> 32) ? UINT64_MAX >> 1 : s->events * i->imm.loop.max_iters;
        }
        for (uint32_t r = 0; r < i->nregions; r++) walk(s, i->region[r]);
        if (i->op == OP_loop) s->depth--, s->events = events;
    }
}

/* Everybody uses the seam, but a site the decision itself. */
static void use_seams(const Seams *s, Block *b) {
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t a = variant_is_site(i) ? 1 : 0; a < i->nargs; a++) {
            Inst *v = i->args[a];
            if (v->id < s->n && s->seam[v->id] && s->seam[v->id] != i) i->args[a] = s->seam[v->id];
        }
        for (uint32_t r = 0; r < i->nregions; r++) use_seams(s, i->region[r]);
    }
}

static void add_sites(Slice *from, const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (variant_is_site(i))
            for (uint32_t a = 1; a < i->nargs; a++) slice_add(from, i->args[a]);
        for (uint32_t r = 0; r < i->nregions; r++) add_sites(from, i->region[r]);
    }
}

static void find_tagged(Seams *s) {
    Slice from = slice_begin(s->fn, s->arena, false);
    add_sites(&from, s->fn->body);
    slice_close(&from);
    s->tagged = from.in;
}

static bool decides_integers(const Program *p) {
    for (uint32_t u = 0; p && u < p->nuntracked; u++)
        if (p->untracked[u].kind == JUMP_INTEGER) return true;
    return false;
}

Fn *variant_seams(PassCtx *ctx, const Fn *primal) {
    Fn *fn = variant_clone(ctx, primal, "seams", true);
    variant_drop_still(fn);
    opt_dce(ctx, fn);
    Arena *scratch = &ctx->session->scratch;
    ArenaMark mark = arena_mark(scratch);
    Seams s = {.fn = fn, .arena = scratch, .events = 1};
    s.dep = depend_values(fn, (DependOptions){.program = ctx->program});
    s.n = fn->ninsts;
    s.facts = (Boxes){.ctx = ctx, .from = fn, .arena = scratch, .fact = ARENA_ARRAY(scratch, uint8_t, s.n + 1)};
    bounds_facts(&s.facts);
    s.decides = ARENA_ARRAY(scratch, bool, s.n + 1);
    s.turns = ARENA_ARRAY(scratch, bool, s.n + 1);
    s.seam = ARENA_ARRAY(scratch, Inst *, s.n + 1);
    for (uint32_t k = 0; k < fn->nsites; k++) vec_push(scratch, &s.sites, fn->sites[k]);
    s.program = ctx->program, s.integers = decides_integers(ctx->program);
    find_tagged(&s);
    find_users(&s, fn->body);
    count_block(&s, fn->body, 0);
    uint32_t jumps = fn->nsites + s.count[CLASS_JUMP], all = jumps + s.count[CLASS_BEND];
    uint64_t size = walk_size(fn->body);
    s.jumps = jumps <= EDGES && jumps * size <= COST;
    s.bends = s.jumps && all <= EDGES && all * size <= COST;
    walk(&s, fn->body);
    use_seams(&s, fn->body);
    if (s.sites.len) fn->sites = arena_copy(fn->arena, s.sites.data, sizeof *s.sites.data * s.sites.len);
    fn->nsites = s.sites.len;
    arena_reset(scratch, mark);
    variant_find_argmins(ctx, fn);
    return fn;
}
