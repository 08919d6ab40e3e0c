/* What is continuous along a surface, on boxes whose rays go over from one of its faces to the next.
 *
 * The face is no one number there, and bounds of its corners, each of which may be that of any face, would say nothing
 * of the point that is met. So all that a value hangs on by the face is evaluated face by face of the patch that the
 * rays meet, each on the whole box, and joined: where a ray meets a face the value is within the bounds of that one.
 * The value bends between them, and jumps nowhere: events of single faces are forgotten. */
#include "compiler/pass/variant_bounds.h"

#include "saltus/mesh.h"

Inst *bounds_is_patch(Builder *b, Inst *answer) {
    return bounds_op2(b, OP_ilt, answer, ir_consti(b, SLT_RAYS_PATCH - 1));
}

/* Rays that jump or bend themselves take what they meet with them. */
static Inst *with_rays(const Boxes *x, Builder *b, const Inst *search, Inst *open) {
    for (uint32_t a = 0; a < search->nargs; a++) open = open_union(b, open, x->value[search->args[a]->id].open);
    return open;
}

Inst *bounds_bends(const Boxes *x, Builder *b, const Inst *search) {
    return with_rays(x, b, search, ir_consti(b, OPEN_BEND));
}

/* The edges at which lines of this search part faces of one surface: none, SLT_EDGES_NONE alone, or others too. */
static void find_edges(const Block *body, const Inst *search, bool *lines, bool *others) {
    for (const Inst *i = body->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) find_edges(i->region[r], search, lines, others);
        if (!variant_asks_line(i)) continue;
        const Inst *face = i->args[SLT_PAIR_FACE], *edges = i->args[SLT_PAIR_EDGES];
        if (face->op != OP_i2f || face->args[0] != search) continue;
        *lines = true, *others |= edges->op != OP_constf || edges->imm.f != SLT_EDGES_NONE;
    }
}

bool bounds_is_surface(const Boxes *x, const Inst *search) {
    bool lines = false, others = false;
    if (bounds_names_face(x, search)) find_edges(x->from->body, search, &lines, &others);
    return lines && !others;
}

/* Of a value along a surface the search that met it; else NULL. */
static const Inst *met_by(const Inst *i) {
    const Inst *held = i->args[0];
    if (i->op != OP_detach || i->imm.i != IR_ALONG_SURFACE || held->op != OP_fsel) return NULL;
    return bounds_search_of(held->args[0]);
}

/* What was evaluated again for a face, and what it was. */
typedef struct Again {
    const Inst *inst;
    Boxed was;
    uint8_t fact;
} Again;

typedef struct Slice {
    Boxes *x;
    const Inst *search;
    Vec(Again) again;
} Slice;

static bool is_passed_on(const Inst *i) { return i->op == OP_site || i->op == OP_siten || i->op == OP_detach; }
static uint32_t narguments(const Inst *i) { return is_passed_on(i) ? 1 : i->nargs; }

enum { HANGS = 1, STANDS = 2 }; /* tags: it hangs on the face; it does not */

/* Which values of the slice hang on the face; false where it is not straight arithmetic. */
static bool mark(Slice *s, Inst *i) {
    if (i == s->search) i->tag = HANGS;
    if (i->tag) return true;
    i->tag = STANDS;
    bool ok = true, hangs = false;
    for (uint32_t a = 0; a < narguments(i); a++) ok &= mark(s, i->args[a]), hangs |= i->args[a]->tag == HANGS;
    if (hangs) i->tag = HANGS;
    bool straight = is_passed_on(i) || i->op == OP_param || i->op == OP_dparam || i->op == OP_iparam ||
                    i->op == OP_ghost || !ir_ops[i->op].special;
    return ok && (!hangs || straight);
}

static void keep(Slice *s, const Inst *i) {
    vec_push(s->x->arena, &s->again, ((Again){i, s->x->value[i->id], s->x->fact[i->id]}));
}

/* Evaluates it with what the face is now. */
static void again(Slice *s, Builder *b, Inst *i) {
    Boxes *x = s->x;
    if (i->tag != HANGS) return;
    i->tag = STANDS;
    bool wide = i->op == OP_ghost;
    for (uint32_t a = 0; a < narguments(i); a++) again(s, b, i->args[a]), wide |= bounds_wide(x, i->args[a]);
    keep(s, i);
    if (!wide) x->fact[i->id] &= (uint8_t)~FACT_WIDE;
    if (is_passed_on(i)) x->value[i->id] = x->value[i->args[0]->id];
    else bounds_value(x, b, i);
}

/* Bounds of v, with the search's face given. */
static Bound on_face(Slice *s, Builder *b, Inst *v, Inst *face) {
    Boxes *x = s->x;
    keep(s, s->search);
    x->value[s->search->id] = (Boxed){.is = {face, face}};
    x->fact[s->search->id] &= (uint8_t)~FACT_WIDE;
    ((Inst *)s->search)->tag = STANDS;
    again(s, b, v);
    Bound is = ir_bound_ends(b, x->value[v->id].is);
    while (s->again.len) {
        Again *a = &s->again.data[--s->again.len];
        x->value[a->inst->id] = a->was, x->fact[a->inst->id] = a->fact;
    }
    return is;
}

void bounds_along(Boxes *x, Builder *b, const Inst *i) {
    const Inst *search = met_by(i);
    Inst *of = i->args[0];
    Boxed v = x->value[of->id];
    x->value[i->id] = v;
    if (!search || x->edges || !bounds_names_face(x, search)) return;
    Inst *answer = x->answer[search->id];
    /* What decides on the way to it, on one face, is for rounding alone. */
    v.open = open_where(b, bounds_op2(b, OP_ile, ir_consti(b, SLT_RAYS_FACE), answer),
                        with_rays(x, b, search, ir_consti(b, 0)), v.open);
    x->value[i->id] = v;
    if (!bounds_is_surface(x, search)) return;
    Slice s = {.x = x, .search = search};
    walk_clear_tags(x->from->body);
    if (!mark(&s, of) || of->tag != HANGS) return;
    Inst *br = ir_if(b, bounds_is_patch(b, answer));
    br->imm.i = IR_IF_RARE;
    Builder in = ir_at_end(x->to, br->region[0]), out = ir_at_end(x->to, br->region[1]);
    Inst *one = ir_consti(&in, 1), *last = bounds_op2(&in, OP_isub, ir_consti(&in, SLT_RAYS_PATCH), answer);
    Bound none = bounds_nothing(&in).is;
    Inst *init[] = {one, none.lo, none.hi};
    Inst *loop = ir_loop(&in, 3, init, (LoopInfo){.max_iters = SLT_RAYS_PATCH_MOST});
    Inst **p = loop->region[0]->params + 1;
    Builder body = ir_at_end(x->to, loop->region[0]);
    Inst *named = bounds_ask(x, &body, search, ir_emit1(&body, OP_i2f, p[0])),
         *face = ir_emit2(&body, OP_isub, named, ir_consti(&body, SLT_RAYS_FACE));
    Bound hull = ir_bound_hull(&body, (Bound){p[1], p[2]}, on_face(&s, &body, of, face));
    Inst *next = ir_emit2(&body, OP_iadd, p[0], one);
    ir_yield(&body, 4, (Inst *[]){ir_emit2(&body, OP_ile, next, last), next, hull.lo, hull.hi});
    Inst *found[] = {ir_proj(&in, loop, 1), ir_proj(&in, loop, 2), bounds_bends(x, &in, search)};
    ir_yield(&in, 3, found);
    Bound own = ir_bound_ends(&out, v.is);
    Inst *else_[] = {own.lo, own.hi, v.open ? v.open : ir_consti(&out, 0)};
    ir_yield(&out, 3, else_);
    x->value[i->id] = (Boxed){.is = {ir_proj(b, br, 0), ir_proj(b, br, 1)}, .open = ir_proj(b, br, 2)};
}
