/* Light past a mesh. The search finds the value and all derivatives, in f64 whatever the program's precision is: both
 * are constant here, and the value has as its derivative the ghost (OP_ghost) of a sum, of the derivatives times what
 * they are in. So reverse mode reads what was found and never searches. */
#include "compiler/front/gen/mesh.h"
#include "saltus/mesh.h"

static Inst *told(Lower *l, uint32_t geometry, uint32_t which, Inst *unit, IrType t) {
    return special(l, OP_told, t, 1, &unit, (Imm){.query = {geometry, which, 0}});
}

static Inst *add(Lower *l, Inst *sum, Inst *a, Inst *b) { return op2(l, OP_fadd, sum, op2(l, OP_fmul, a, b)); }

/* The part of the sum that is of vertices: two in each unit. */
static Inst *of_vertices(Lower *l, const Symbol *sym, uint32_t geometry, Inst *answer) {
    Var *sum = var_new(l, TY_FLT, 1);
    VarList carried = {0};
    IfCtx some;
    LoopCtx c = {0};
    Inst *units = told(l, geometry, SLT_LIGHT_COUNT, answer, TY_INT);
    sum->value = kf(l, 0);
    if_begin(l, &some, op2(l, OP_ilt, ki(l, 0), units));
    vec_push(l->arena, &carried, sum);
    loop_begin(l, &c, &carried, (LoopInfo){.max_iters = SLT_LIGHT_MAX_COUNT, .told = true});
    Inst *unit = op2(l, OP_iadd, op2(l, OP_iadd, answer, c.k), ki(l, SLT_LIGHT_EDGES));
    for (uint32_t k = 0; k < 2; k++) {
        Inst *vertex = clamp_index(l, told(l, geometry, SLT_LIGHT_A + k, unit, TY_INT), false, sym->nvertices),
             *at = op2(l, OP_imul, vertex, ki(l, 3));
        for (uint32_t a = 0; a < 3; a++)
            var_set(l, sum,
                    add(l, var_get(l, sum), told(l, geometry, (k ? SLT_LIGHT_D_B : SLT_LIGHT_D_A) + a, unit, TY_FLT),
                        slice_float(l, gen_placed(l, sym) + a, at, 3 * (sym->nvertices - 1))));
    }
    loop_end(l, &c, op2(l, OP_ilt, c.k, op2(l, OP_isub, units, ki(l, 1))));
    if_else(l, &some);
    if_end(l, &some);
    return var_get(l, sum);
}

/* What is asked: the number of each argument of the query, and how many have derivatives. */
typedef struct Asked {
    SltQuery what;
    uint32_t rows, slopes;
    Inst *args[SLT_LOBE_ROWS + 1];
} Asked;

static void put(Asked *asked, uint32_t row, Inst *const *c, uint32_t n) {
    for (uint32_t k = 0; k < n; k++) asked->args[row + k] = c[k];
}

static void ask_light(Lower *l, Expr *e, Asked *asked) {
    static const uint32_t first[2][5] = {
        {SLT_LIGHT_P, SLT_LIGHT_N, SLT_LIGHT_CORNER},
        {SLT_LIGHT_P, SLT_LIGHT_N, SLT_LIGHT_VIEW, SLT_LIGHT_ROUGHNESS, SLT_LIGHT_CORNER}};
    const bool lobe = e->method == M_MESH_LTC;
    asked->what = lobe ? SLT_QUERY_LTC : SLT_QUERY_IRRADIANCE;
    asked->rows = asked->slopes = lobe ? SLT_LOBE_ROWS : SLT_LIGHT_ROWS;
    for (uint32_t a = 0; a < e->nargs; a++) {
        const Val v = gen_expr(l, e->args[a]);
        put(asked, first[lobe][a], v.c, v.n);
    }
}

static void ask_lit(Lower *l, Expr *e, uint32_t geometry, Asked *asked) {
    const Val piece = gen_expr(l, e->args[0]), light = gen_expr(l, e->args[1]);
    asked->what = SLT_QUERY_LIT, asked->rows = SLT_LIT_ROWS, asked->slopes = SLT_LIT_UNIT;
    put(asked, SLT_LIT_BEAM, piece.c + PIECE_BEAM, SLT_BEAM_ROWS);
    put(asked, SLT_LIT_LIGHT, light.c, light.n);
    asked->args[SLT_LIT_UNIT] = op1(l, OP_i2f, gen_piece_unit(l, geometry, &piece));
}

Val gen_mesh_light(Lower *l, Expr *e, const Symbol *sym) {
    const uint32_t geometry = gen_geometry_number(l, (Searched){.sym = sym});
    Asked asked;
    if (e->method == M_MESH_LIT) ask_lit(l, e, geometry, &asked);
    else ask_light(l, e, &asked);
    asked.args[asked.rows] = gen_begun(l, geometry, e->span);
    Inst *answer = special(l, OP_query, TY_INT, asked.rows + 1, asked.args,
                           (Imm){.query = {geometry, asked.what, l->geometries.data[geometry].base}}),
         *sum = of_vertices(l, sym, geometry, answer);
    Inst *unit[SLT_LIGHT_EDGES] = {answer};
    for (uint32_t k = 1; k < SLT_LIGHT_EDGES; k++)
        unit[k] = sel(l, gen_is(l, answer, 0), answer, op2(l, OP_iadd, answer, ki(l, k)));
    for (uint32_t k = 0; k < asked.slopes; k++) {
        const uint32_t at = SLT_LIGHT_SLOPES + k;
        sum = add(l, sum, told(l, geometry, at % SLT_TOLD, unit[at / SLT_TOLD], TY_FLT), asked.args[k]);
    }
    Val v = val_new(l, e->type);
    v.c[0] = op2(l, OP_fadd, told(l, geometry, SLT_LIGHT_VALUE, answer, TY_FLT), op1(l, OP_ghost, sum));
    return v;
}
