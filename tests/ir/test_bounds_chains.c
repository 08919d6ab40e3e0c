/* Bounds of bounds: random expressions of all value rows, on a box and on its points. What one row leaves unknown,
 * wraps or keeps exact (hashes of points) the next ones take up. ROUNDS=n in the environment: n times as many
 * expressions. */
#include "compiler/back/back.h"
#include "tests/ir/bounds_pairs.h"

enum { FLOATS = 3, INTS = 2, ROWS = 24, WATCHED = 12 };

typedef struct Value {
    Bound is;
    Inst *at;
} Value;

static Value input_of(Builder *b, IrType t, uint32_t k, bool point) {
    Inst *v = argument(b, t, k, 2);
    if (point) return (Value){ir_bound_point(v), v};
    return (Value){{argument(b, t, k, 0), argument(b, t, k, 1)}, v};
}

static Value constant_of(Builder *b, IrType t) {
    Inst *v = t == TY_FLT   ? ir_constf(b, below(2) ? constants[below(11)] : random_float(b->fn->precision, ANY))
                : t == TY_INT ? ir_consti(b, below(2) ? (int32_t)below(40) - 4 : (int32_t)next_random())
                              : ir_constb(b, below(2));
    return (Value){ir_bound_point(v), v};
}

/* One of the values so far, rather a late one, or a constant. */
static Value pick(Builder *b, const Value *v, uint32_t n, IrType t) {
    for (int tries = 0; tries < 30 && below(8); tries++) {
        uint32_t k = below(3) ? n - 1 - below(n < 6 ? n : 6) : below(n);
        if (v[k].at->type == t) return v[k];
    }
    return constant_of(b, t);
}

/* Rows whose arguments have a domain stay out. */
static bool anywhere(Op op) {
    return !ir_ops[op].special && op != OP_fmant && !ir_is_log_part(op) && op != OP_fexpo && op != OP_ftwoi &&
           op != OP_fasuint;
}

typedef struct Chain {
    Fn *fn;
    IrType type[WATCHED];
    uint32_t n; /* outputs: 3 * n */
    bool boxed[FLOATS + INTS];
    bool signs; /* copies them: that of a NaN is nobody's promise */
} Chain;

static Chain chain(Session *s, Precision p, bool ints) {
    Chain c = {.fn = ir_fn(s, &s->module, "f", p)};
    Builder b = ir_at_end(c.fn, c.fn->body);
    Value v[FLOATS + INTS + ROWS];
    uint32_t n = 0;
    for (uint32_t k = 0; k < FLOATS + INTS; k++) {
        c.boxed[k] = below(4) > 0;
        v[n++] = k < FLOATS ? input_of(&b, TY_FLT, k, !c.boxed[k]) : input_of(&b, TY_INT, k - FLOATS, !c.boxed[k]);
    }
    while (n < FLOATS + INTS + ROWS) {
        Op op = (Op)below(OP_COUNT);
        if (!anywhere(op)) continue;
        if ((ir_ops[op].arg == TY_INT) != ints && below(6)) continue;
        Value a[3] = {{{0}, 0}};
        Bound is[3];
        Inst *at[3];
        for (uint32_t k = 0; k < ir_ops[op].nargs; k++) {
            a[k] = k == 1 && ir_ops[op].nargs > 1 && !ir_ops[op].selects && !below(6) ? a[0]
                                                                                      : pick(&b, v, n, type_of(op, k));
            is[k] = a[k].is, at[k] = a[k].at;
        }
        c.signs |= op == OP_fcopysign;
        bool same = ir_ops[op].nargs > 1 && at[0] == at[1];
        v[n].is = ir_bound_row(&b, op, is, ir_ops[op].nargs, same ? BOUND_SAME : 0);
        v[n].at = ir_emit(&b, op, ir_ops[op].nargs, at);
        if (v[n].is.lo->type == TY_FLT && !below(8)) v[n].is = ir_bound_ends(&b, v[n].is);
        n++;
    }
    Inst *out[3 * WATCHED];
    for (uint32_t k = 0; k < WATCHED; k++) {
        Value w = v[n - WATCHED + k];
        c.type[k] = (IrType)w.at->type;
        out[3 * k] = w.is.lo, out[3 * k + 1] = w.is.hi, out[3 * k + 2] = w.at;
    }
    ir_yield(&b, 3 * WATCHED, out);
    PassCtx ctx = {.session = s, .has_fma = true};
    pipeline_kernel(&ctx, c.fn);
    check_sound(c.fn);
    return c;
}

static bool contradicts(IrType t, double lo, double hi, double v) {
    if (t == TY_BOOL) return v != 0 ? hi == 0 : lo != 0;
    if (t == TY_FLT && (isnan(lo) || isnan(hi))) return false;
    if (t == TY_FLT && isnan(v)) return !(lo == -INFINITY && hi == INFINITY);
    return v < lo || v > hi;
}

static void fill_inputs(Data *d, const Chain *c, Precision p) {
    for (uint32_t k = 0; k < FLOATS + INTS; k++) {
        IrType t = k < FLOATS ? TY_FLT : TY_INT;
        uint32_t j = k < FLOATS ? k : k - FLOATS;
        for (uint32_t n = 0; n < N; n++) {
            Sample s =
                t == TY_FLT ? float_sample(p, ANY, !c->boxed[k]) : int_sample(p, below(2) ? COUNT : ANY, !c->boxed[k]);
            put(d->in[slot_of(t, j, 0)], t, p, n, s.lo);
            put(d->in[slot_of(t, j, 1)], t, p, n, s.hi);
            put(d->in[slot_of(t, j, 2)], t, p, n, s.v);
        }
    }
}

/* Compiled, the chain gives the same bits. */
static bool same_compiled(Session *s, const Chain *c, Data *d, void *const *out, Precision p) {
    BackOptions o = {.width = 1u << below(7), .no_cache = true, .opt_level = 2};
    target_named(&o.target, "native");
    if (!o.target.has_fma || c->signs) return true; /* they were lowered for a target that has it */
    KernelRequest k = {"f", c->fn};
    CompiledModule *module = NULL;
    const char *why = "";
    if (back_compile(s, &k, 1, &o, &module, &why)) fail_msg("%s", why);
    SltKernelArgs a = {.n_valid = N};
    memcpy(a.in, d->in, sizeof a.in);
    for (int j = 0; j < 3 * WATCHED; j++) a.out[j] = aligned_alloc(64, (N + SLT_PAD) * 8);
    back_kernel(module, "f")(&a, N);
    back_free(module);
    bool same = true;
    for (uint32_t j = 0; j < 3 * WATCHED; j++) {
        IrType t = c->type[j / 3];
        for (uint32_t n = 0; n < N; n++) {
            double x = get(out[j], t, p, n), y = get(a.out[j], t, p, n);
            if ((isnan(x) && isnan(y)) || (x == y && !signbit(x) == !signbit(y))) continue;
            if (same) printf("output %u of sample %u: %.17g, compiled %.17g\n", j, n, x, y);
            same = false;
        }
        free(a.out[j]);
    }
    return same;
}

static void test_chains(void **state) {
    (void)state;
    rng = getenv("SEED") ? strtoull(getenv("SEED"), NULL, 10) : 5;
    Session *s = session_create(0);
    Data *d = make_data();
    void *out[3 * WATCHED];
    for (int j = 0; j < 3 * WATCHED; j++) out[j] = malloc((N + SLT_PAD) * 8);
    uint64_t pairs = 0, known = 0, bad = 0;
    for (uint32_t program = 0; program < 300 * rounds(1); program++) {
        ArenaMark m = arena_mark(&s->module);
        Precision p = program & 1 ? PREC_F64 : PREC_F32;
        Chain c = chain(s, p, program % 3 == 0);
        fill_inputs(d, &c, p);
        SltKernelArgs a = {.n_valid = N};
        memcpy(a.in, d->in, sizeof a.in);
        for (int j = 0; j < 3 * WATCHED; j++) a.out[j] = out[j];
        assert_int_equal(run(c.fn, &a, N, WIDTH), SLT_OK);
        if (program % 4 == 0) bad += !same_compiled(s, &c, d, out, p);
        bool told = false;
        for (uint32_t k = 0; k < WATCHED; k++)
            for (uint32_t n = 0; n < N; n++, pairs++) {
                double lo = get(out[3 * k], c.type[k], p, n), hi = get(out[3 * k + 1], c.type[k], p, n),
                       v = get(out[3 * k + 2], c.type[k], p, n);
                known += c.type[k] == TY_BOOL ? lo == hi : c.type[k] == TY_FLT ? hi - lo < INFINITY : hi - lo < 4e9;
                if (!contradicts(c.type[k], lo, hi, v)) continue;
                bad++;
                if (told) continue;
                told = true;
                printf("program %u, value %u, sample %u: %.17g is not in [%.17g, %.17g]\n", program, k, n, v, lo, hi);
                if (getenv("SHOW")) ir_print(c.fn, stdout);
            }
        arena_reset(&s->module, m);
    }
    printf("%llu pairs, something known of %.1f %%\n", (unsigned long long)pairs,
           100.0 * (double)known / (double)pairs);
    for (int j = 0; j < 3 * WATCHED; j++) free(out[j]);
    free_data(d);
    session_destroy(s);
    assert_true(known > pairs / 4); /* else nothing was tried */
    assert_int_equal(bad, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_chains)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
