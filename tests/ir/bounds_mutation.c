/* Mistakes in the rules of bounds (SPOILED in ir/bounds_rules.h): wherever one changes the code of a row, some pair
 * must contradict. Built with those rules once more, spoiled by a number. */
#include "tests/ir/bounds_pairs.h"

extern int bound_mutation;

typedef struct Mutation {
    Run run;
    const char *text[4096]; /* of each case without a mistake */
    uint32_t n;
    bool differs[OP_COUNT][2], noticed[OP_COUNT][2];
} Mutation;

static bool mutated(const Case *c, void *user) {
    Mutation *m = user;
    Session *s = m->run.s;
    uint32_t at = m->n++;
    ArenaMark mark = arena_mark(&s->module);
    if (bound_mutation == 0) {
        m->text[at] = strdup(ir_print_string(row_fn(s, c, false), &s->module));
        arena_reset(&s->module, mark);
        return true;
    }
    if (m->noticed[c->op][c->p]) return true;
    Fn *fn = row_fn(s, c, false);
    if (strcmp(m->text[at], ir_print_string(fn, &s->module))) {
        m->differs[c->op][c->p] = true;
        fn = lowered(s, c, true, false);
        for (uint32_t k = 0; k < m->run.rounds && !m->noticed[c->op][c->p]; k++) {
            fill(m->run.d, c);
            SltKernelArgs a = args_of(m->run.d, 0, N);
            assert_int_equal(run(fn, &a, N, WIDTH), SLT_OK);
            m->noticed[c->op][c->p] = contradictions(m->run.d, c, 0, N, false) > 0;
        }
    }
    arena_reset(&s->module, mark);
    return true;
}

/* Mistakes that make nothing wrong. Of elementary functions only these fall, close by, where they should rise
 * (bounds-walk); the others are widened for what nobody has proven. Ends in the wrong order are caught by the check of
 * a pole, or by shifting them back. Points of ftwoi, fmant and fexpo are in their domains. */
static bool harmless(int mistake, Op op, Precision p) {
    switch (mistake) {
    case SPOIL_WIDENING: return !(op == OP_fcbrt || op == OP_ferf || op == OP_fsin || op == OP_fcos);
    case SPOIL_ENDS: return op == OP_ftan || op == OP_ishl;
    case SPOIL_WHERE: return op == OP_ftwoi;
    case SPOIL_FAR: return p == PREC_F64 || op == OP_ftan; /* nobody has seen that reduction fail */
    case SPOIL_NAN: return op == OP_ftan || op == OP_fmant || op == OP_fexpo;
    default: return false;
    }
}

static void test_mistakes(void **state) {
    (void)state;
    static Mutation m;
    m.run = (Run){.s = session_create(0), .d = make_data(), .rounds = rounds(16)};
    uint32_t made = 0, missed = 0;
    for (bound_mutation = SPOIL_NOTHING; bound_mutation < SPOIL_KINDS; bound_mutation++) {
        m.n = 0;
        memset(m.differs, 0, sizeof m.differs);
        memset(m.noticed, 0, sizeof m.noticed);
        rng = 3;
        each_case(mutated, &m);
        for (int op = 0; op < OP_COUNT; op++)
            for (int p = 0; p < 2; p++) {
                made += m.differs[op][p];
                if (!m.differs[op][p] || m.noticed[op][p] || harmless(bound_mutation, (Op)op, (Precision)p)) continue;
                missed++;
                printf("mistake %d in %s %s is not noticed\n", bound_mutation, ir_ops[op].name,
                       p == PREC_F32 ? "f32" : "f64");
            }
    }
    printf("%u mistakes\n", made);
    bound_mutation = SPOIL_NOTHING;
    free_data(m.run.d);
    session_destroy(m.run.s);
    assert_true(made > 200);
    assert_int_equal(missed, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_mistakes)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
