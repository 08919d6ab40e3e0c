/* What sites of rays that meet meshes add to the variants.
 *
 * A silhouette of a mesh is an edge, known by its two vertices; where surfaces cross, two triangles are. So g needs no
 * window of the ray but two integers, which name its line (saltus/mesh.h). In the program they are answers to
 * SLT_QUERY_BETWEEN of a ray and itself, which nothing parts. `event` asks it of both rays of a pair that hit different
 * faces: where a walk over the mesh leads from one to the other nothing jumps, and there is no event. In `site` they
 * are inputs. `region` and `sides` give a hash of the faces that rays hit beside that of the piece: it tells who is to
 * be asked, and nothing else. */
#include "compiler/pass/variant.h"
#include "saltus/mesh.h"

bool variant_asks_line(const Inst *i) { return i->op == OP_query && query_rows[i->imm.query.what].role == ROLE_LINE; }

static uint32_t which(const Inst *query) { return query->args[SLT_PAIR_WHICH]->imm.f != 0; }

/* What chooses comes first: g asks its numbers what kind of line they name, before it looks at rays, which may hang on
 * other sites' lines. */
static void find_line(Inst *v, MeshLine *line) {
    if (v->tag || (line->number[0] && line->number[1])) return;
    v->tag = 1;
    if (variant_asks_line(v)) {
        line->number[which(v)] = v;
        return;
    }
    for (uint32_t a = 0; a < v->nargs; a++)
        if (!variant_is_site(v) || a != 1) find_line(v->args[a], line);
    for (uint32_t r = 0; r < v->nregions; r++)
        for (Inst *i = v->region[r]->first; i; i = i->next) find_line(i, line);
}

MeshLine variant_mesh_line(Fn *fn, Inst *site) {
    MeshLine line = {0};
    walk_clear_tags(fn->body);
    find_line(site->args[1], &line);
    if (!line.number[0] || !line.number[1]) ice(fn->session, "a mesh's site without a line");
    return line;
}

static bool is_none(const Inst *i) { return i->op == OP_consti && i->imm.i == SLT_WITNESS_NONE; }

/* Does anything use what a ray has met, `found`, but to ask whether there is anything, and (as the number `face`) for a
 * line? */
static bool looks(const Block *b, const Inst *found, const Inst *face) {
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t a = 0; a < i->nargs; a++) {
            bool asks = (i->op == OP_ieq || i->op == OP_ine) && is_none(i->args[1 - a]);
            if (i->args[a] == found && i != face && !asks) return true;
            if (i->args[a] == face && !variant_asks_line(i)) return true;
        }
        for (uint32_t r = 0; r < i->nregions; r++)
            if (looks(i->region[r], found, face)) return true;
    }
    return false;
}

/* Do faces tell the site's sides apart, too? */
static bool is_of_faces(SiteKind kind) { return kind >= SITE_MESH && kind < SITE_MESH_HIT; }

static void settle(Fn *fn, Block *body, bool *alive) {
    for (Inst *i = body->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) settle(fn, i->region[r], alive);
        if (!variant_is_site(i) || !ir_site_of_mesh(variant_site_info(fn, i)->kind)) continue;
        const Inst *face = variant_mesh_line(fn, i).number[0]->args[SLT_PAIR_FACE];
        bool whole = face->op != OP_i2f || looks(fn->body, face->args[0], face);
        alive[i->imm.i] = true;
        if (fn->sites[i->imm.i].kind == SITE_MESH && !whole) fn->sites[i->imm.i].kind = SITE_MESH_HIT;
    }
}

void variant_mesh_settle(Fn *fn) {
    bool *alive = ARENA_ARRAY(fn->arena, bool, fn->nsites + 1);
    settle(fn, fn->body, alive);
    for (uint32_t s = 0; s < fn->nsites; s++)
        if (is_of_faces(fn->sites[s].kind) && !alive[s]) fn->sites[s].kind = SITE_MESH_HIT;
}

static Inst *partner(Builder *b, Inst *v) { return ir_special(b, OP_partner, (IrType)v->type, 1, &v, (Imm){0}); }

/* Do the rays of the pair hit different faces? Of shadows: does one of them hit nothing? */
static Inst *faces_differ(Builder *b, const Inst *query, SiteKind kind) {
    Inst *face = query->args[SLT_PAIR_FACE], *other = partner(b, face), *zero = ir_constf(b, 0);
    if (is_of_faces(kind)) return ir_emit2(b, OP_fne, face, other);
    return ir_emit2(b, OP_bxor, ir_emit2(b, OP_flt, face, zero), ir_emit2(b, OP_flt, other, zero));
}

/* Number k of what parts the lane's ray from its partner's. */
static Inst *ask_pair(Builder *b, const Inst *query, uint32_t k) {
    Inst *args[SLT_PAIR_ROWS];
    for (uint32_t a = 0; a < SLT_PAIR_OTHER; a++)
        args[a] = query->args[a], args[SLT_PAIR_OTHER + a] = partner(b, query->args[a]);
    args[SLT_PAIR_FACE] = query->args[SLT_PAIR_FACE];
    args[SLT_PAIR_OTHER_FACE] = partner(b, query->args[SLT_PAIR_FACE]);
    args[SLT_PAIR_EDGES] = query->args[SLT_PAIR_EDGES];
    args[SLT_PAIR_WHICH] = ir_constf(b, k);
    return ir_special(b, OP_query, TY_INT, SLT_PAIR_ROWS, args, query->imm);
}

MeshLine variant_mesh_ask(Fn *fn, Inst *query, SiteKind kind, Inst *unless) {
    Builder b = ir_before(fn, query);
    Inst *both = ir_special(&b, OP_both, TY_BOOL, 0, NULL, (Imm){0}), *none = ir_consti(&b, SLT_WITNESS_NONE),
         *wanted = ir_emit2(&b, OP_band, faces_differ(&b, query, kind), both);
    Inst *br = ir_if(&b, ir_emit2(&b, OP_band, wanted, ir_emit1(&b, OP_bnot, unless)));
    br->imm.i = IR_IF_RARE;
    Builder in = ir_at_end(fn, br->region[0]), out = ir_at_end(fn, br->region[1]);
    Inst *first = ask_pair(&in, query, 0), *found = ir_if(&in, ir_emit2(&in, OP_ile, ir_consti(&in, 0), first));
    Builder yes = ir_at_end(fn, found->region[0]), no = ir_at_end(fn, found->region[1]);
    Inst *second = ask_pair(&yes, query, 1);
    ir_yield(&yes, 1, &second);
    ir_yield(&no, 1, &none);
    Inst *numbers[2] = {first, ir_proj(&in, found, 0)}, *nothing[2] = {none, none};
    ir_yield(&in, 2, numbers);
    ir_yield(&out, 2, nothing);
    return (MeshLine){{ir_proj(&b, br, 0), ir_proj(&b, br, 1)}};
}

Inst *variant_mesh_input(Builder *b, const Inst *query) {
    return ir_emit1(b, OP_f2i, ir_input(b, which(query) ? IN_WINDOW1 : IN_WINDOW0));
}

static void inputs(Fn *fn, Block *body) {
    for (Inst *i = body->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) inputs(fn, i->region[r]);
        if (!variant_asks_line(i)) continue;
        Builder at = ir_before(fn, i);
        walk_forward(fn, i, variant_mesh_input(&at, i));
    }
}

void variant_mesh_inputs(Fn *fn) {
    inputs(fn, fn->body);
    walk_resolve_forwards(fn->body);
}

static bool touches_mesh(Thread *t, const Inst *i) {
    return i->op == OP_site && is_of_faces(variant_site_info(t->fn, i)->kind);
}

static bool face_at(Thread *t, Inst *i) {
    Inst *query = variant_mesh_line(t->fn, i).number[0];
    Builder b = ir_after(t->fn, i);
    b.fold = true;
    Inst *face = ir_mix_inst(&b, variant_event_key(&b, i), ir_emit1(&b, OP_f2i, query->args[SLT_PAIR_FACE]));
    t->value[0] = ir_emit2(&b, OP_ixor, t->value[0], face);
    return true;
}

static bool has_faces(const Fn *fn, const Block *body) {
    for (const Inst *i = body->first; i; i = i->next) {
        if (i->op == OP_site && is_of_faces(variant_site_info(fn, i)->kind)) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (has_faces(fn, i->region[r])) return true;
    }
    return false;
}

Inst *variant_faces(Fn *fn) {
    if (!has_faces(fn, fn->body)) return NULL;
    Builder b = ir_before(fn, fn->body->first);
    Thread t = {.fn = fn, .n = 1, .at = face_at, .touches = touches_mesh};
    t.value[0] = ir_consti(&b, 0);
    thread_block(&t, fn->body);
    return t.value[0];
}
