/* Derived arrays: what a mesh has beside its positions, computed whenever these or other parameters change.
 *
 * Placed vertices are what [Vertex(place)] makes of the positions; normals are the mean of the faces around a vertex by
 * area, of the placed ones. An array is there when the shader asks for it. Its program is cut into kernels like the
 * shader's, of one element: an ordinary function of parameters, so a derivative in the array's numbers becomes one in
 * the parameters by the kernel that reverse mode makes of it (runtime/sample/derived.h). */
#include "compiler/front/gen/internal.h"
#include "saltus/mesh.h"

static const char *const placed_vertices = "placed vertices", *const vertex_normals = "normals of vertices";

/* Its number in l->derived, a new one where nobody has asked for it yet. */
static const Derived *find(const Lower *l, const Symbol *mesh, const char *what) {
    for (uint32_t k = 0; k < l->derived.len; k++)
        if (l->derived.data[k].param == mesh->param_index && l->derived.data[k].what == what)
            return &l->derived.data[k];
    return NULL;
}

static uint32_t add_array(Lower *l, const Symbol *mesh, const char *what) {
    Program *p = l->program;
    const Derived d = {.what = what, .param = mesh->param_index, .base = p->nfloats, .n = mesh->nvertices};
    gen_reserve(l, &p->nfloats, 3 * (uint64_t)d.n, mesh->span);
    p->nplaced += 3 * d.n;
    vec_push(l->arena, &l->derived, d);
    return d.base;
}

/* Integers of the mesh behind its topology. */
static void add_table(Lower *l, const Symbol *mesh, uint32_t *base, uint64_t n) {
    Program *p = l->program;
    if (*base) return;
    *base = p->nints;
    gen_reserve(l, &p->nints, n, mesh->span);
    p->ntopology += (uint32_t)n;
}

uint32_t gen_placed(Lower *l, const Symbol *mesh) {
    Param *q = &l->program->params[mesh->param_index];
    if (!mesh->place) return q->fbase;
    const Derived *known = find(l, mesh, placed_vertices);
    if (known) return known->base;
    add_table(l, mesh, &q->vertex_parts, mesh->nvertices);
    return add_array(l, mesh, placed_vertices);
}

uint32_t gen_normals(Lower *l, const Symbol *mesh) {
    Param *q = &l->program->params[mesh->param_index];
    const Derived *known = find(l, mesh, vertex_normals);
    if (known) return known->base;
    gen_placed(l, mesh);
    add_table(l, mesh, &q->rings, SLT_MESH_RINGS(mesh->nvertices, mesh->nfaces));
    return add_array(l, mesh, vertex_normals);
}

/* ---- what an element is */

static Inst *element(Lower *l, const Derived *d) {
    Inst *i = ir_input(&l->b, IN_K0);
    range_set(l, i, 0, (int64_t)d->n - 1);
    return i;
}

static void three(Lower *l, uint32_t base, Inst *vertex, uint32_t n, Inst *out[3]) {
    Inst *at = op2(l, OP_imul, vertex, ki(l, 3));
    for (uint32_t a = 0; a < 3; a++) out[a] = slice_float(l, base + a, at, 3 * (n - 1));
}

static void place_vertex(Lower *l, const Derived *d, Inst *out[3]) {
    const Param *q = &l->program->params[d->param];
    Func *f = q->sym->place;
    Inst *i = element(l, d), *p[3], *part = slice_int(l, q->vertex_parts, i, d->n - 1);
    three(l, q->fbase, i, d->n, p);
    Bind bind[3];
    for (uint32_t a = 0; a < 3; a++)
        bind[a] = (Bind){.kind = BIND_VARS, .vars = var_new(l, a == 1 ? TY_FLT : TY_INT, a == 1 ? 3 : 1)};
    bind[0].vars->value = i, bind[2].vars->value = part;
    for (uint32_t a = 0; a < 3; a++) bind[1].vars[a].value = p[a];
    Val v = gen_inline(l, f, bind, f->name_span);
    for (uint32_t a = 0; a < 3; a++) out[a] = v.c[a];
}

/* The cross product of two sides of each face around the vertex, which is as long as the face is large. */
static void mean_normal(Lower *l, const Derived *d, uint32_t positions, Inst *out[3]) {
    const Param *q = &l->program->params[d->param];
    const Symbol *mesh = q->sym;
    const uint32_t faces = q->rings + mesh->nvertices + 1, corners = 3 * mesh->nfaces;
    Func f = {.name = vertex_normals};
    Frame frame = {.func = &f};
    Inst *i = element(l, d), *from = slice_int(l, q->rings, i, d->n - 1), *to = slice_int(l, q->rings + 1, i, d->n - 1);
    Var *sum = var_new(l, TY_FLT, 3);
    IfCtx some;
    LoopCtx c = {0};
    VarList carried = {0};
    l->frame = &frame;
    for (uint32_t a = 0; a < 3; a++) {
        sum[a].value = kf(l, 0);
        vec_push(l->arena, &carried, &sum[a]);
    }
    if_begin(l, &some, op2(l, OP_ilt, from, to));
    loop_begin(l, &c, &carried, (LoopInfo){.max_iters = mesh->valence ? mesh->valence : 1});
    Inst *face = slice_int(l, faces, clamp_index(l, op2(l, OP_iadd, from, c.k), false, corners), corners - 1),
         *first = op2(l, OP_imul, clamp_index(l, face, false, mesh->nfaces), ki(l, 3)), *p[3][3], *s[2][3];
    for (uint32_t k = 0; k < 3; k++) {
        Inst *vertex = slice_int(l, q->tbase + k, first, 3 * (mesh->nfaces - 1));
        three(l, positions, clamp_index(l, vertex, false, mesh->nvertices), mesh->nvertices, p[k]);
    }
    for (uint32_t a = 0; a < 3; a++)
        for (uint32_t k = 0; k < 2; k++) s[k][a] = op2(l, OP_fsub, p[k + 1][a], p[0][a]);
    for (uint32_t a = 0; a < 3; a++) {
        const uint32_t j = (a + 1) % 3, k = (a + 2) % 3;
        Inst *area = op2(l, OP_fsub, op2(l, OP_fmul, s[0][j], s[1][k]), op2(l, OP_fmul, s[0][k], s[1][j]));
        var_set(l, &sum[a], op2(l, OP_fadd, var_get(l, &sum[a]), area));
    }
    loop_end(l, &c, op2(l, OP_ilt, op2(l, OP_iadd, from, op2(l, OP_iadd, c.k, ki(l, 1))), to));
    if_else(l, &some);
    if_end(l, &some);
    Inst *n[3];
    for (uint32_t a = 0; a < 3; a++) n[a] = var_get(l, &sum[a]);
    Inst *square = dot_n(l, n, n, 3), *real = op2(l, OP_flt, kf(l, 0), square),
         *length = op1(l, OP_fsqrt, sel(l, real, square, kf(l, 1)));
    for (uint32_t a = 0; a < 3; a++) out[a] = sel(l, real, op2(l, OP_fdiv, n[a], length), kf(l, 0));
    l->frame = NULL;
}

/* ---- what it reads */

static void note_read(Lower *l, Derived *d, uint32_t param) {
    for (uint32_t k = 0; k < d->nreads; k++)
        if (d->reads[k] == param) return;
    uint32_t *more = ARENA_ARRAY(l->arena, uint32_t, d->nreads + 1);
    for (uint32_t k = 0; k < d->nreads; k++) more[k] = d->reads[k];
    more[d->nreads++] = param, d->reads = more;
}

static void find_reads(Lower *l, Derived *d, const Block *b) {
    const Program *p = l->program;
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) find_reads(l, d, i->region[r]);
        if (i->op == OP_iparam) d->reads_ints |= i->imm.slot.base < p->nints - p->ntopology;
        if (i->op != OP_param) continue;
        for (uint32_t q = 0; q < p->nparams; q++)
            if (i->imm.slot.base - p->params[q].fbase < p->params[q].fcount) note_read(l, d, q);
        for (const Derived *of = l->derived.data; of < d; of++) {
            if (i->imm.slot.base - of->base >= 3 * of->n) continue;
            d->reads_ints |= of->reads_ints;
            for (uint32_t k = 0; k < of->nreads; k++) note_read(l, d, of->reads[k]);
        }
    }
}

/* An element knows its number alone. */
static void check_inputs(Lower *l, const Func *f, const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) check_inputs(l, f, i->region[r]);
        if (i->op != OP_input || i->imm.i == IN_K0) continue;
        diag_emit(l->s, DIAG_bad_vertex, i->span.file >= 0 ? i->span : f->name_span,
                  arena_printf(&l->s->session, "`%s` places vertices: it knows no pixel and no sample", f->name));
        gen_giveup(l);
    }
}

static void write_out(Lower *outer, Derived *d) {
    Lower fresh = gen_fresh(outer, d->what), *l = &fresh;
    const Symbol *mesh = l->program->params[d->param].sym;
    const bool placed = d->what == placed_vertices;
    Inst *out[3];
    if (placed && gen_facts(outer, mesh->place)->rand) {
        diag_emit(l->s, DIAG_bad_vertex, mesh->attrs.vertex_span,
                  arena_printf(&l->s->session, "`%s` places vertices: it may not call `rand()`", mesh->place->name));
        gen_giveup(l);
    }
    l->fn->dim = 1, l->fn->channels = 3, l->records = true;
    if (placed) place_vertex(l, d, out);
    else mean_normal(l, d, gen_placed(outer, mesh), out);
    ir_yield(&l->b, 3, out);
    ir_name_outputs(l->fn, SLT_OUT_F);
    gen_prune_loops(l);
    if (placed) check_inputs(l, mesh->place, l->fn->body);
    ir_require(l->fn, "lowering");
    find_reads(outer, d, l->fn->body);
    Program *of = d->of = ARENA_NEW(l->arena, Program);
    const Program *p = outer->program;
    *of = (Program){.session = p->session, .entry = d->what, .dim = 1, .channels = 3, .params = p->params};
    of->nparams = p->nparams, of->nfloats = p->nfloats, of->nints = p->nints, of->ntopology = p->ntopology;
    of->primal = l->fn, of->hi[0] = 1, of->of_elements = true;
    of->untracked = l->untracked.data, of->nuntracked = l->untracked.len;
}

void gen_derived_finish(Lower *l) {
    Program *p = l->program;
    l->fn->nfloats = p->nfloats, l->fn->nints = p->nints;
    for (uint32_t c = 0; c < l->culls.len; c++)
        l->culls.data[c]->nfloats = p->nfloats, l->culls.data[c]->nints = p->nints;
    for (uint32_t k = 0; k < l->derived.len; k++) write_out(l, &l->derived.data[k]);
    p->derived = l->derived.data, p->nderived = l->derived.len;
}
