/* What hangs on an integer alone that hardly differs between lanes, looked up in a register.
 *
 * Pixels of a row share y, so the hash of a corner of a lattice hangs on the column of its cell alone; and 64 pixels
 * side by side lie in a few cells. Where the integers of all lanes are among as many in a row as a register has lanes,
 * everything that follows from them and from what lanes share is made once, for these integers side by side, and every
 * lane takes what it needs from there, by an instruction a vector. Elsewhere, which one branch tells, each lane does it
 * itself. The bits are the same. What is the same of the next integer, as the hash of a cell's other corner, is one
 * further on in the same table.
 *
 * That holds for the values of a run (emit_value_run), which is emitted twice: only what comes out of it meets again.
 */
#include "compiler/back/cpu/emit.h"

#include <string.h>

enum {
    MOST_ROOTS = 4,
    CHECK = 10, /* instructions: whether the integers are near, and the branch */
    DEPTH = 2   /* of operands that emit_compared_root looks through */
};

typedef enum Role { REST, ROOT, BEFORE /* a root hangs on it */, MEMBER /* hangs on a root alone */ } Role;

typedef struct Value {
    Role role;
    uint32_t root;      /* of a member */
    uint32_t as;        /* a member: the one that is what this is where the root is one more; itself: none is */
    bool looked_up;     /* a member that others read */
    bool leaves;        /* read behind the run */
    Part table, *parts; /* of a member; what leaves: at the end of the first way */
} Value;

typedef struct Root {
    uint32_t at;                  /* in the run */
    Part base;                    /* the first integer of the table, in all lanes */
    bool beside;                  /* some member is looked up in another's table, one further on */
    Part raw[BACK_MAX_PARTS];     /* the integers, where they are near */
    Part from[2][BACK_MAX_PARTS]; /* which element of the table; the one behind it */
} Root;

typedef struct Lookup {
    const EmitRun *run;
    Value *value; /* [run->n] */
    Root *root[MOST_ROOTS];
    uint32_t nroots;
} Lookup;

static bool can_look_up(const Emit *e) {
    return e->fn->same && !e->mask && e->P > 1 && e->fn->precision == PREC_F32 && emit_converts(e) &&
           e->opt->target.vector_bytes >= 32;
}

static uint32_t find(Inst *const *run, uint32_t n, const Inst *i) {
    uint32_t k = 0;
    while (k < n && run[k] != i) k++;
    return k;
}

/* What is read to emit i: its operands, and those of a root that is only compared. */
static uint32_t operands(const Emit *e, const Inst *i, const Inst **out) {
    uint32_t n = 0;
    for (uint32_t j = 0; j < i->nargs; j++)
        if (emit_is_vector(e, i->args[j])) out[n++] = i->args[j];
    const Inst *x = i->op == OP_flt ? i->args[0] : NULL;
    for (uint32_t d = 0; d < DEPTH && x && (x->op == OP_fsqrt || x->op == OP_fsub); d++)
        if (emit_is_vector(e, x = x->args[0])) out[n++] = x;
    return n;
}
enum { MOST_OPERANDS = 3 + DEPTH };

/* A root is not made of what hangs on another. */
static bool claim_before(const Emit *e, Inst *const *run, uint32_t n, Value *v, uint32_t k) {
    const Inst *x[MOST_OPERANDS];
    for (uint32_t j = 0, m = operands(e, run[k], x); j < m; j++) {
        const uint32_t at = find(run, n, x[j]);
        if (at == n || v[at].role == BEFORE) continue;
        if (v[at].role != REST || !claim_before(e, run, n, v, at)) return false;
        v[at].role = BEFORE;
    }
    return true;
}

static void find_members(const Emit *e, Inst *const *run, uint32_t n, Value *v) {
    for (uint32_t k = 0; k < n; k++) {
        if (v[k].role != REST) continue;
        const Inst *x[MOST_OPERANDS];
        const uint32_t m = operands(e, run[k], x);
        uint32_t root = n;
        bool alone = m > 0;
        for (uint32_t j = 0; j < m && alone; j++) {
            const uint32_t at = find(run, n, x[j]), of = at == n                ? n
                                                         : v[at].role == ROOT   ? at
                                                         : v[at].role == MEMBER ? v[at].root
                                                                                : n;
            alone = of < n && (root == n || root == of), root = of;
        }
        if (alone) v[k].role = MEMBER, v[k].root = root;
    }
}

/* What others read: of members, and of all behind the run. */
static void find_readers(Emit *e, Inst *const *run, uint32_t n, Value *v) {
    const uint32_t *uses = emit_uses(e);
    uint32_t *within = ARENA_ARRAY(e->arena, uint32_t, n + 1);
    const Inst *x[MOST_OPERANDS];
    for (uint32_t k = 0; k < n; k++) v[k].looked_up = v[k].leaves = false;
    for (uint32_t k = 0; k < n; k++)
        for (uint32_t j = 0; j < run[k]->nargs; j++) within[find(run, n, run[k]->args[j])]++;
    for (uint32_t k = n; k-- > 0;) {
        v[k].leaves |= uses[run[k]->id] > within[k];
        const bool looked_through = run[k]->op == OP_fsqrt || run[k]->op == OP_fsub || run[k]->op == OP_zmul;
        const uint32_t m = operands(e, run[k], x);
        for (uint32_t j = 0; j < m; j++) {
            const uint32_t at = find(run, n, x[j]);
            if (at == n) continue;
            if (v[k].role != MEMBER) v[at].looked_up = true;
            if (v[k].leaves && looked_through) v[at].leaves = true;
        }
        v[k].looked_up |= v[k].leaves;
    }
}

/* ---- corners of one cell: f(i + 1) is looked up where f(i) is */
typedef struct Match {
    Inst *const *run;
    uint32_t n, root, steps;
    const Value *v;
} Match;

/* Is b what a is where the root is one more? */
static bool is_next(const Emit *e, Match *m, const Inst *a, const Inst *b) {
    if (!m->steps) return false;
    m->steps--;
    if (a == m->run[m->root])
        return b->op == OP_iadd && b->args[0] == a && b->args[1]->op == OP_consti && b->args[1]->imm.i == 1;
    const uint32_t at = find(m->run, m->n, a);
    if (at == m->n || m->v[at].role != MEMBER || m->v[at].root != m->root || a->op != b->op || a->nargs != b->nargs)
        return false;
    for (uint32_t j = 0; j < a->nargs; j++)
        if (emit_is_vector(e, a->args[j]) ? !is_next(e, m, a->args[j], b->args[j]) : a->args[j] != b->args[j])
            return false;
    return true;
}

static void find_next(const Emit *e, Inst *const *run, uint32_t n, Value *v) {
    enum { STEPS = 4096, LANES = 16 /* where registers are fewer and shorter it is no gain */ };
    for (uint32_t k = 0; k < n; k++) v[k].as = k;
    if (e->L < LANES) return;
    for (uint32_t b = 0; b < n; b++)
        for (uint32_t a = 0; a < b && v[b].role == MEMBER && v[b].looked_up && v[b].as == b; a++) {
            Match m = {run, n, v[b].root, STEPS, v};
            if (v[a].role == MEMBER && v[a].looked_up && v[a].as == a && v[a].root == v[b].root &&
                is_next(e, &m, run[a], run[b]))
                v[b].as = a;
        }
}

/* Is one table of the members of this root worth it? */
static bool pays(const Emit *e, Inst *const *run, uint32_t n, const Value *v, uint32_t root) {
    uint32_t cost = 0, looked_up = 0;
    for (uint32_t k = 0; k < n; k++) {
        if (v[k].role != MEMBER || v[k].root != root) continue;
        if (v[k].looked_up && run[k]->type == TY_BOOL) return false;
        cost += ir_ops[run[k]->op].cost, looked_up += v[k].looked_up;
    }
    return 3 * (cost + CHECK + e->P * (looked_up + 1)) < 2 * e->P * cost;
}

/* The roles of the values of a run; false: nothing in it is worth a table. */
static bool find_roles(Emit *e, Inst *const *run, uint32_t n, Value *v) {
    uint32_t roots = 0;
    memset(v, 0, n * sizeof *v);
    for (uint32_t k = 0; k < n; k++)
        if (ir_is_guarded_twice(run[k])) return false;
    for (uint32_t k = 0; k < n && roots < MOST_ROOTS; k++) {
        if (run[k]->op != OP_f2i || v[k].role != REST) continue;
        v[k].role = ROOT;
        if (!claim_before(e, run, n, v, k)) {
            v[k].role = REST; /* what was claimed for it comes before the others, too */
            continue;
        }
        roots++;
    }
    for (uint32_t again = roots; again;) {
        again = 0;
        for (uint32_t k = 0; k < n; k++)
            if (v[k].role == MEMBER) v[k].role = REST;
        find_members(e, run, n, v);
        find_readers(e, run, n, v);
        for (uint32_t k = 0; k < n && !again; k++)
            if (v[k].role == ROOT && !pays(e, run, n, v, k)) v[k].role = REST, roots--, again = roots;
    }
    find_next(e, run, n, v);
    return roots > 0;
}

bool emit_looks_up(Emit *e, Inst *const *run, uint32_t n) {
    if (!can_look_up(e)) return false;
    uint32_t roots = 0;
    for (uint32_t k = 0; k < n; k++) roots += run[k]->op == OP_f2i;
    if (!roots) return false;
    emit_uses(e); /* stays */
    ArenaMark m = arena_mark(e->arena);
    const bool wants = find_roles(e, run, n, ARENA_ARRAY(e->arena, Value, n + 1));
    arena_reset(e->arena, m);
    return wants;
}

/* ---- what is emitted */
static Part permuted(Emit *e, Part table, Part from) {
    const bool floats = LL(GetTypeKind)(LL(GetElementType)(LL(TypeOf)(table))) == LLVMFloatTypeKind;
    const char *name = e->L == 16 ? floats ? "llvm.x86.avx512.permvar.sf.512" : "llvm.x86.avx512.permvar.si.512"
                       : floats   ? "llvm.x86.avx2.permps"
                                  : "llvm.x86.avx2.permd";
    Part x[2] = {table, from};
    return emit_intrinsic(e, name, NULL, x, 2);
}

static Part everywhere(Emit *e, Part v, uint32_t lane) {
    Part lanes[BACK_MAX_WIDTH];
    for (uint32_t l = 0; l < e->L; l++) lanes[l] = emit_int(e, e->t_i32, lane);
    return LL(BuildShuffleVector)(e->b, v, LL(GetPoison)(LL(TypeOf)(v)), LL(ConstVector)(lanes, e->L), "");
}

/* Are the integers of all lanes less than L apart? The lesser of the first and the last lane's is where the table
 * begins, since columns go one way. Integers that do not fit are 2^31 here: the table must not reach them. */
static Part is_near(Emit *e, const Lookup *l, Root *r) {
    Part one = emit_splat(e, emit_int(e, e->t_i32, 1));
    const Inst *of = l->run->at[r->at]->args[0];
    Part x[BACK_MAX_PARTS], any = NULL;
    emit_parts(e, of, x);
    for (uint32_t p = 0; p < e->P; p++) r->raw[p] = emit_converted(e, x[p], NULL, true);
    Part first = everywhere(e, r->raw[0], 0), last = everywhere(e, r->raw[e->P - 1], e->L - 1);
    r->base = LL(BuildSelect)(e->b, LL(BuildICmp)(e->b, LLVMIntSLT, first, last, ""), first, last, "");
    for (uint32_t p = 0; p < e->P; p++) {
        r->from[0][p] = LL(BuildSub)(e->b, r->raw[p], r->base, "");
        any = any ? LL(BuildOr)(e->b, any, r->from[0][p], "") : r->from[0][p];
        if (!r->beside) continue;
        r->from[1][p] = LL(BuildAdd)(e->b, r->from[0][p], one, "");
        any = LL(BuildOr)(e->b, any, r->from[1][p], "");
    }
    LLVMTypeRef bits = LL(IntTypeInContext)(e->ctx, e->L);
    Part high = LL(BuildAnd)(e->b, any, emit_splat(e, emit_int(e, e->t_i32, ~(e->L - 1) & UINT32_MAX)), "");
    Part far = LL(BuildICmp)(e->b, LLVMIntNE, high, LL(ConstNull)(LL(TypeOf)(high)), "");
    Part near = LL(BuildICmp)(e->b, LLVMIntEQ, LL(BuildBitCast)(e->b, far, bits, ""), LL(ConstNull)(bits), "");
    Part least = LL(BuildExtractElement)(e->b, r->base, emit_int(e, e->t_i32, 0), "");
    Part shifted = LL(BuildAdd)(e->b, least, emit_int(e, e->t_i32, INT32_MAX), "");
    Part fits = LL(BuildICmp)(e->b, LLVMIntULE, shifted, emit_int(e, e->t_i32, UINT32_MAX - e->L), "");
    return LL(BuildAnd)(e->b, near, fits, "");
}

static Part next_to(Emit *e, Part base) {
    Part lanes[BACK_MAX_WIDTH];
    for (uint32_t l = 0; l < e->L; l++) lanes[l] = emit_int(e, e->t_i32, l);
    return LL(BuildAdd)(e->b, base, LL(ConstVector)(lanes, e->L), "");
}

static void emit_tables(Emit *e, Lookup *l) {
    const EmitRun *run = l->run;
    for (uint32_t r = 0; r < l->nroots; r++) emit_slot(e, run->at[l->root[r]->at])[0] = next_to(e, l->root[r]->base);
    for (uint32_t k = 0; k < run->n; k++) {
        if (l->value[k].role != MEMBER) continue;
        emit_run_part(e, run, k, 0);
        l->value[k].table = emit_slot(e, run->at[k])[0];
    }
    for (uint32_t r = 0; r < l->nroots; r++)
        memcpy(emit_slot(e, run->at[l->root[r]->at]), l->root[r]->raw, e->P * sizeof(Part));
}

static const Root *root_of(const Lookup *l, const Value *v) {
    uint32_t r = 0;
    while (l->root[r]->at != v->root) r++;
    return l->root[r];
}

/* Members are looked up where the first value reads them: they live in few registers. */
static void emit_rest(Emit *e, Lookup *l, uint32_t p, bool *there) {
    const EmitRun *run = l->run;
    const Inst *x[MOST_OPERANDS];
    memset(there, 0, run->n * sizeof *there);
    for (uint32_t k = 0; k <= run->n; k++) {
        if (k < run->n && l->value[k].role != REST) continue;
        const uint32_t m = k < run->n ? operands(e, run->at[k], x) : run->n;
        for (uint32_t j = 0; j < m; j++) {
            const uint32_t at = k < run->n ? find(run->at, run->n, x[j]) : j;
            if (at == run->n || there[at] || l->value[at].role != MEMBER) continue;
            if (k == run->n && !l->value[at].leaves) continue;
            const Value *v = &l->value[at];
            emit_slot(e, run->at[at])[p] = permuted(e, l->value[v->as].table, root_of(l, v)->from[v->as != at][p]);
            there[at] = true;
        }
        if (k < run->n) emit_run_part(e, run, k, p);
    }
}

/* Both ways give what leaves the run. */
static bool meets(const Value *v) { return v->leaves && v->role != BEFORE; }

bool emit_lookup(Emit *e, const EmitRun *run) {
    if (!emit_looks_up(e, run->at, run->n)) return false;
    Lookup l = {.run = run, .value = ARENA_ARRAY(e->arena, Value, run->n + 1)};
    bool *there = ARENA_ARRAY(e->arena, bool, run->n + 1);
    find_roles(e, run->at, run->n, l.value);
    for (uint32_t p = 0; p < e->P; p++)
        for (uint32_t k = 0; k < run->n; k++)
            if (l.value[k].role == BEFORE) emit_run_part(e, run, k, p);
    Part near = NULL;
    for (uint32_t k = 0; k < run->n; k++) {
        if (l.value[k].role != ROOT) continue;
        Root *r = l.root[l.nroots++] = ARENA_NEW(e->arena, Root);
        r->at = k;
        for (uint32_t j = 0; j < run->n; j++)
            r->beside |= l.value[j].role == MEMBER && l.value[j].root == k && l.value[j].as != j;
        Part is = is_near(e, &l, r);
        near = near ? LL(BuildAnd)(e->b, near, is, "") : is;
    }
    LLVMBasicBlockRef way[2] = {emit_new_block(e, "near"), emit_new_block(e, "far")}, end[2],
                      join = emit_new_block(e, "join");
    LL(BuildCondBr)(e->b, near, way[0], way[1]);
    emit_at(e, way[0]);
    emit_tables(e, &l);
    for (uint32_t p = 0; p < e->P; p++) emit_rest(e, &l, p, there);
    for (uint32_t k = 0; k < run->n; k++) {
        if (!meets(&l.value[k])) continue;
        l.value[k].parts = arena_alloc(e->arena, e->P * sizeof(Part));
        memcpy(l.value[k].parts, emit_slot(e, run->at[k]), e->P * sizeof(Part));
    }
    end[0] = emit_here(e);
    LL(BuildBr)(e->b, join);
    emit_at(e, way[1]);
    for (uint32_t p = 0; p < e->P; p++)
        for (uint32_t k = 0; k < run->n; k++)
            if (l.value[k].role != BEFORE) emit_run_part(e, run, k, p);
    end[1] = emit_here(e);
    LL(BuildBr)(e->b, join);
    emit_at(e, join);
    for (uint32_t k = 0; k < run->n; k++)
        for (uint32_t p = 0; p < e->P && meets(&l.value[k]); p++) {
            Part *slot = emit_slot(e, run->at[k]), phi = emit_phi(e, LL(TypeOf)(slot[p]), "");
            emit_incoming(e, phi, l.value[k].parts[p], end[0]), emit_incoming(e, phi, slot[p], end[1]);
            slot[p] = phi;
        }
    return true;
}
