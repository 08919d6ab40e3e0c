/* Rays that meet a geometry: the table of what is searched, the queries, clearances as boundary functions, and which
 * queries may be weaker. What a geometry is made of stays in its own file. */
#include "compiler/front/gen/geometry.h"

Val gen_method(Lower *l, Expr *e) {
    static GeometryMethod *const geometries[] = {
#define GEOMETRY(id, name, ...) gen_##name,
#include "saltus/geometries.def"
#undef GEOMETRY
    };
    const Symbol *sym = gen_resource(l, e->a[0]);
    if (methods[e->method].kind == METHOD_FIXED) {
        Val v = val_new(l, e->type);
        v.c[0] = ki(l, sym->tex_w);
        v.c[1] = ki(l, sym->tex_h);
        if (v.n > 2) v.c[2] = ki(l, sym->tex_d);
        return v;
    }
    return sym->type->kind == T_GEOMETRY ? geometries[sym->type->n](l, e, sym) : gen_texture(l, e, sym);
}

uint32_t gen_geometry_number(Lower *l, Searched of) {
    for (uint32_t g = 0; g < l->geometries.len; g++)
        if (l->geometries.data[g].param == of.sym->param_index) return g;
    const Param *p = &l->program->params[of.sym->param_index];
    GeometryInfo g = {.kind = (SltGeometryKind)of.sym->type->n,
                      .param = of.sym->param_index,
                      .base = p->is_mesh ? gen_placed(l, of.sym) : p->fbase,
                      .count = p->fcount,
                      .size = {p->tex_w, p->tex_h},
                      .nfaces = of.sym->nfaces,
                      .tbase = p->tbase,
                      .band = of.band};
    vec_push(l->arena, &l->geometries, g);
    return l->geometries.len - 1;
}

Inst *gen_query(Lower *l, Searched of, SltQuery what, const Ray *r) {
    uint32_t g = gen_geometry_number(l, of);
    Inst *args[SLT_RAY_ROWS] = {r->x, r->y, r->z, r->dx, r->dy, r->dz, r->t0, r->t1, r->lift, r->lift_of};
    Imm imm = {.query = {g, what, l->geometries.data[g].base}};
    return special(l, OP_query, TY_INT, r->lift ? SLT_RAY_ROWS : SLT_RAY_POINT_ROWS, args, imm);
}

Inst *gen_found(Lower *l, Inst *witness) { return op2(l, OP_ine, witness, ki(l, SLT_WITNESS_NONE)); }

SiteKind gen_site_kind(SltQuery what) { return query_rows[what].role == ROLE_SHADOW ? SITE_SHADOW : SITE_SILHOUETTE; }

void gen_clearance_note(Lower *l, Clearance c) { vec_push(l->arena, &l->clearances, c); }

Inst *gen_clearance_bounded(Lower *l, Inst *value, const Clearance *c) {
    Inst *none = gen_is(l, c->search, SLT_WITNESS_NONE),
         *outside = op2(l, OP_flt, op2(l, OP_fmul, c->cell, kf(l, -0x1p-10)),
                        c->gap); /* or the ray is so little inside that the search missed the box */
    return sel(l, none, sel(l, outside, c->gap, kf(l, __builtin_inf())), op2(l, OP_fmax, value, c->gap));
}

Inst *gen_clearance_compare(Lower *l, Inst *a, Inst *b) {
    for (uint32_t i = l->clearances.len; i-- > 0;) {
        const Clearance *c = &l->clearances.data[i];
        if (a == c->value) return gen_clearance_bounded(l, op2(l, OP_fsub, a, b), c);
        if (b == c->value) return op1(l, OP_fneg, gen_clearance_bounded(l, op2(l, OP_fsub, b, a), c));
    }
    return NULL;
}

/* ---- after the whole entry */

static bool is_zero(const Inst *i) { return i->op == OP_constf && i->imm.f == 0; }

/* Every use but a comparison with 0 or the g of such a comparison forbids the weaker query. */
static void find_uses(const Block *b, const Lower *l, bool *whole) {
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t a = 0; a < i->nargs; a++)
            for (uint32_t c = 0; c < l->clearances.len; c++) {
                if (i->args[a] != l->clearances.data[c].value) continue;
                bool sign = (i->op == OP_flt || i->op == OP_fle) && is_zero(i->args[1 - a]);
                bool boundary = i->op == OP_fmax && i->args[1 - a] == l->clearances.data[c].gap;
                whole[c] |= !sign && !boundary && !(i->op == OP_site && a == 1);
            }
        for (uint32_t r = 0; r < i->nregions; r++) find_uses(i->region[r], l, whole);
    }
}

static void note_queries(const Block *b, GeometryInfo *geometries) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_query) geometries[i->imm.query.geometry].queries |= 1u << i->imm.query.what;
        for (uint32_t r = 0; r < i->nregions; r++) note_queries(i->region[r], geometries);
    }
}

void gen_geometry_finish(Lower *l) {
    bool *whole = ARENA_ARRAY(&l->s->scratch, bool, l->clearances.len + 1);
    if (l->clearances.len) find_uses(l->fn->body, l, whole);
    for (uint32_t c = 0; c < l->clearances.len; c++) {
        Inst *search = l->clearances.data[c].search;
        if (whole[c] || search->op != OP_query || query_rows[search->imm.query.what].when != WEAKER_SIGN) continue;
        search->imm.query.what = query_rows[search->imm.query.what].weaker;
    }
    note_queries(l->fn->body, l->geometries.data);
}
