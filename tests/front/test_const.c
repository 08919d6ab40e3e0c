/* Constant expressions: every operator and builtin that folds, at edge values, against plain C in double and int64.
 * The values are read from the program's IR, in f64 and in f32 (rounded once). */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "compiler/front/front.h"

typedef struct Job {
    const char *source;
    Precision precision;
    double *got; /* the stored elements of the program's one array, in order */
    uint32_t n;
} Job;

static void collect(Job *j, const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_store && i->args[1]->op == OP_consti) {
            const Inst *v = i->args[2];
            assert_true(v->op == OP_constf || v->op == OP_consti);
            j->got[j->n++] = v->op == OP_constf ? v->imm.f : (double)(int32_t)v->imm.i;
        }
    }
}

static void compile(Session *s, void *user) {
    Job *j = user;
    int file = session_add_text(s, "const.salt", ".", j->source, strlen(j->source));
    ProgramOptions opt = {.precision = j->precision, .seed = 1};
    Program *p = front_compile(s, file, &opt);
    if (p) collect(j, p->primal->body);
}

/* Compiles `const TYPE K[n] = { entries };` and compares its elements with want. */
static void check(const char *type, const char *entries, const double *want, uint32_t n) {
    size_t room = strlen(entries) + 300;
    char *source = malloc(room);
    snprintf(source, room, "const %s K[%u] = {%s};\nshader float main(float2 x) { return float(K[int(x.x)]); }\n", type,
             n, entries);
    for (int p = PREC_F32; p <= PREC_F64; p++) {
        Session *s = session_create(0);
        Job j = {source, (Precision)p, calloc(n, sizeof(double)), 0};
        int status = session_protect(s, compile, &j);
        if (status != 0 || j.n != n) fail_msg("status %d, %u of %u values: %.500s", status, j.n, n, source);
        for (uint32_t k = 0; k < n; k++) {
            bool is_float = !strcmp(type, "float");
            double w = is_float && p == PREC_F32 ? (double)(float)want[k] : want[k];
            if (memcmp(&w, &j.got[k], sizeof w) != 0 && !(isnan(w) && isnan(j.got[k])))
                fail_msg("element %u is %.17g, not %.17g: %.300s", k, j.got[k], w, source);
        }
        session_destroy(s);
        free(j.got);
    }
    free(source);
}

typedef struct Text {
    char *p;
    size_t at, cap;
} Text;
static void put(Text *t, const char *format, const char *a, const char *b, const char *c) {
    if (t->cap - t->at < 400) t->p = realloc(t->p, t->cap = 2 * t->cap + 1000);
    if (t->at) t->at += (size_t)sprintf(t->p + t->at, ",\n");
    for (; *format; format++) {
        const char *from = *format == '$' ? (format++, *format == 'a' ? a : *format == 'b' ? b : c) : NULL;
        if (from) t->at += (size_t)sprintf(t->p + t->at, "%s", from);
        else t->p[t->at++] = *format;
    }
    t->p[t->at] = 0;
}

/* ---- floats */

static const struct {
    const char *text;
    double v;
} floats[] = {
    {"0.0", 0},
    {"(-0.0)", -0.0},
    {"1.0", 1},
    {"(-1.0)", -1},
    {"0.5", 0.5},
    {"(-2.5)", -2.5},
    {"3.75", 3.75},
    {"1e-30", 1e-30},
    {"(-1e30)", -1e30},
    {"0.1", 0.1},
    {"79.0", 79},
    {"INFINITY", INFINITY},
    {"(-INFINITY)", -INFINITY},
    {"(0.0 / 0.0)", NAN},
    {"2147483647.5", 2147483647.5},
    {"(-2147483649.0)", -2147483649.0},
    {"4294967295.5", 4294967295.5},
    {"(-0.5)", -0.5},
};
enum { FLOATS = sizeof floats / sizeof *floats };

typedef struct FloatCase {
    const char *text; /* $a $b $c: the operands */
    uint32_t arity;
    double (*want)(double a, double b, double c);
} FloatCase;
#define F(name, value)                                                                                                 \
    static double name(double a, double b, double c) {                                                                 \
        (void)a, (void)b, (void)c;                                                                                     \
        return value;                                                                                                  \
    }
static double smooth(double t) {
    t = t < 0 ? 0 : t > 1 ? 1 : t;
    return t * t * (3 - 2 * t);
}
static double bits(double a) {
    float f = (float)a;
    int32_t i;
    memcpy(&i, &f, sizeof i);
    return isnan(a) ? 0 : i; /* which NaN is nobody's promise */
}
/* clang-format off */
F(f_neg, -a) F(f_add, a + b) F(f_sub, a - b) F(f_mul, a * b) F(f_div, a / b) F(f_mod, fmod(a, b))
F(f_lt, a < b) F(f_le, a <= b) F(f_gt, a > b) F(f_ge, a >= b) F(f_eq, a == b) F(f_ne, a != b)
F(f_abs, fabs(a)) F(f_sign, (a > 0) - (a < 0)) F(f_floor, floor(a)) F(f_ceil, ceil(a)) F(f_round, rint(a)) F(f_trunc, trunc(a)) F(f_frac, a - floor(a))
F(f_min, b < a ? b : a) F(f_max, a < b ? b : a) F(f_saturate, a < 0 ? 0 : 1 < a ? 1 : a) F(f_step, b >= a)
F(f_sqrt, sqrt(a)) F(f_rsqrt, 1 / sqrt(a)) F(f_cbrt, cbrt(a)) F(f_pow, pow(a, b)) F(f_exp, exp(a)) F(f_exp2, exp2(a)) F(f_log, log(a)) F(f_log2, log2(a))
F(f_sin, sin(a)) F(f_cos, cos(a)) F(f_tan, tan(a)) F(f_asin, asin(a)) F(f_acos, acos(a)) F(f_atan, atan(a)) F(f_atan2, atan2(a, b))
F(f_sinh, sinh(a)) F(f_cosh, cosh(a)) F(f_tanh, tanh(a)) F(f_erf, erf(a)) F(f_fma, fma(a, b, c))
F(f_clamp, c < (a < b ? b : a) ? c : (a < b ? b : a)) F(f_lerp, a + (b - a) * c) F(f_smoothstep, smooth((c - a) / (b - a)))
F(f_isnan, isnan(a) != 0) F(f_isinf, isinf(a) != 0) F(f_isfinite, isfinite(a) != 0)
F(f_int, isnan(a) ? 0 : a < -2147483648.0 ? -2147483648.0 : a > 2147483647.0 ? 2147483647.0 : trunc(a) + 0.0)
F(f_uint, (double)(int32_t)(uint32_t)(isnan(a) ? 0 : a < 0 ? 0 : a > 4294967295.0 ? 4294967295.0 : a))
F(f_bool, a != 0) F(f_asuint, bits(a))
F(f_dot, 0 + a * b + b * c) F(f_length, sqrt(0 + a * a + b * b)) F(f_distance, sqrt(0 + (a - c) * (a - c) + (b - a) * (b - a)))
F(f_normalize, b / sqrt(0 + a * a + b * b)) F(f_cross, a * c - b * b) F(f_reflect, a - 2 * (0 + a * b + b * c) * b)
F(f_matmul, 0 + a * c + b * a)
static const FloatCase float_cases[] = {
    {"-$a", 1, f_neg}, {"$a + $b", 2, f_add}, {"$a - $b", 2, f_sub}, {"$a * $b", 2, f_mul}, {"$a / $b", 2, f_div}, {"$a % $b", 2, f_mod},
    {"abs($a)", 1, f_abs}, {"sign($a)", 1, f_sign}, {"floor($a)", 1, f_floor}, {"ceil($a)", 1, f_ceil}, {"round($a)", 1, f_round},
    {"trunc($a)", 1, f_trunc}, {"frac($a)", 1, f_frac}, {"fmod($a, $b)", 2, f_mod}, {"min($a, $b)", 2, f_min}, {"max($a, $b)", 2, f_max},
    {"saturate($a)", 1, f_saturate}, {"step($a, $b)", 2, f_step}, {"sqrt($a)", 1, f_sqrt}, {"rsqrt($a)", 1, f_rsqrt}, {"cbrt($a)", 1, f_cbrt},
    {"pow($a, $b)", 2, f_pow}, {"exp($a)", 1, f_exp}, {"exp2($a)", 1, f_exp2}, {"log($a)", 1, f_log}, {"log2($a)", 1, f_log2},
    {"sin($a)", 1, f_sin}, {"cos($a)", 1, f_cos}, {"tan($a)", 1, f_tan}, {"asin($a)", 1, f_asin}, {"acos($a)", 1, f_acos}, {"atan($a)", 1, f_atan},
    {"atan2($a, $b)", 2, f_atan2}, {"sinh($a)", 1, f_sinh}, {"cosh($a)", 1, f_cosh}, {"tanh($a)", 1, f_tanh}, {"erf($a)", 1, f_erf},
    {"fma($a, $b, $c)", 3, f_fma}, {"clamp($a, $b, $c)", 3, f_clamp}, {"lerp($a, $b, $c)", 3, f_lerp}, {"smoothstep($a, $b, $c)", 3, f_smoothstep},
    {"dot(float2($a, $b), float2($b, $c))", 3, f_dot}, {"length(float2($a, $b))", 2, f_length},
    {"distance(float2($a, $b), float2($c, $a))", 3, f_distance}, {"normalize(float2($a, $b)).y", 2, f_normalize},
    {"cross(float3(1.0, $a, $b), float3(1.0, $b, $c)).x", 3, f_cross}, {"reflect(float2($a, $b), float2($b, $c)).x", 3, f_reflect},
    {"(float2x2($a, $b, $b, $c) * float2($c, $a)).x", 3, f_matmul}, {"float($a < $b)", 2, f_lt},
};
static const FloatCase int_results[] = {
    {"$a < $b ? 1 : 0", 2, f_lt}, {"$a <= $b ? 1 : 0", 2, f_le}, {"$a > $b ? 1 : 0", 2, f_gt}, {"$a >= $b ? 1 : 0", 2, f_ge},
    {"$a == $b ? 1 : 0", 2, f_eq}, {"$a != $b ? 1 : 0", 2, f_ne}, {"int(isnan($a))", 1, f_isnan}, {"int(isinf($a))", 1, f_isinf},
    {"int(isfinite($a))", 1, f_isfinite}, {"int($a)", 1, f_int}, {"int(uint($a))", 1, f_uint}, {"int(bool($a))", 1, f_bool}, {"$a == $a ? int(asuint($a)) : 0", 1, f_asuint},
};
/* clang-format on */

static void check_floats(const char *type, const FloatCase *cases, size_t ncases) {
    for (size_t c = 0; c < ncases; c++) {
        Text t = {0};
        double want[FLOATS * FLOATS];
        uint32_t n = 0;
        for (int i = 0; i < FLOATS; i++)
            for (int j = 0; j < (cases[c].arity > 1 ? FLOATS : 1); j++) {
                int k = (5 * i + 7 * j) % FLOATS;
                put(&t, cases[c].text, floats[i].text, floats[j].text, floats[k].text);
                want[n++] = cases[c].want(floats[i].v, floats[j].v, floats[k].v);
            }
        check(type, t.p, want, n);
        free(t.p);
    }
}

static void test_floats(void **unused) {
    (void)unused;
    check_floats("float", float_cases, sizeof float_cases / sizeof *float_cases);
    check_floats("int", int_results, sizeof int_results / sizeof *int_results);
    const double eta = 0.7, d = 0.6 * 0.3 + 0.8 * -0.9, k = 1 - eta * eta * (1 - d * d);
    const double values[] = {-(3.0 * (0.5 - 1.0 / 3.0 * 2.0)), 0, eta * 0.6 - (eta * d + sqrt(k)) * 0.3, 0.25, 1};
    Text t = {0};
    double want[20];
    for (int n = 0; n < 20; n += 5) { /* an array that is too long for selects */
        memcpy(want + n, values, sizeof values);
        put(&t, "determinant(float2x2(1.0, 0.5, 3.0, 2.0)) > 0.0 ? -(3.0 * (0.5 - 1.0 / 3.0 * 2.0)) : 0.0", "", "", "");
        put(&t, "refract(float2(1.0, 0.0), float2(0.0, 1.0), 2.0).x", "", "", "");
        put(&t, "refract(float2(0.6, 0.8), float2(0.3, -0.9), 0.7).x", "", "", "");
        put(&t, "inverse(float2x2(4.0, 0.0, 0.0, 1.0))[0].x", "", "", "");
        put(&t,
            "select(any(bool2(false, true)) && !all(bool2(false, true)), transpose(float2x2(3.0, 2.0, 1.0, 4.0))[0].y, 5.0)",
            "", "", "");
    }
    check("float", t.p, want, 20);
    free(t.p);
}

/* ---- integers: int, and uint by their bits */

static const int64_t ints[] = {0, 1, -1, 2, -7, 31, 33, 65536, 2147483647, -2147483647 - 1, 12345};
enum { INTS = sizeof ints / sizeof *ints };

typedef struct IntCase {
    const char *text;
    int64_t (*want)(int64_t a, int64_t b, int64_t c);
} IntCase;
#define N(name, value)                                                                                                 \
    static int64_t name(int64_t a, int64_t b, int64_t c) {                                                             \
        (void)a, (void)b, (void)c;                                                                                     \
        return value;                                                                                                  \
    }
#define LEAST(a, b) ((b) < (a) ? (b) : (a))
#define MOST(a, b) ((a) < (b) ? (b) : (a))
/* clang-format off */
N(n_neg, -a) N(n_not, ~a) N(n_add, a + b) N(n_sub, a - b) N(n_mul, (int64_t)((uint64_t)a * (uint64_t)b)) N(n_div, b ? a / b : 0) N(n_mod, b ? a % b : 0)
N(n_and, a & b) N(n_or, a | b) N(n_xor, a ^ b) N(n_shl, (int64_t)((uint64_t)a << (b & 31))) N(n_shr, a >> (b & 31))
N(n_lt, a < b) N(n_le, a <= b) N(n_gt, a > b) N(n_ge, a >= b) N(n_eq, a == b) N(n_ne, a != b)
N(n_abs, a < 0 ? -a : a) N(n_sign, (a > 0) - (a < 0)) N(n_min, LEAST(a, b)) N(n_max, MOST(a, b)) N(n_clamp, LEAST(MOST(a, b), c)) N(n_bool, a != 0)
N(n_both, a && b) N(n_either, a || b) N(n_differ, !a != !b) N(n_agree, !a == !b)
N(n_lacking, !(a && b)) N(n_bits, MOST((int32_t)a, 7))
static const IntCase int_cases[] = {
    {"-$a", n_neg}, {"~$a", n_not}, {"$a + $b", n_add}, {"$a - $b", n_sub}, {"$a * $b", n_mul}, {"$a / $b", n_div}, {"$a % $b", n_mod}, {"$a & $b", n_and},
    {"$a | $b", n_or}, {"$a ^ $b", n_xor}, {"$a << $b", n_shl}, {"$a >> $b", n_shr}, {"$a < $b ? 1 : 0", n_lt}, {"$a <= $b ? 1 : 0", n_le},
    {"$a > $b ? 1 : 0", n_gt}, {"$a >= $b ? 1 : 0", n_ge}, {"$a == $b ? 1 : 0", n_eq}, {"$a != $b ? 1 : 0", n_ne}, {"abs($a)", n_abs}, {"sign($a)", n_sign},
    {"min($a, $b)", n_min}, {"max($a, $b)", n_max}, {"clamp($a, $b, $c)", n_clamp}, {"int(bool($a))", n_bool}, {"int(bool($a) & bool($b))", n_both},
    {"int(bool($a) | bool($b))", n_either}, {"int(bool($a) ^ bool($b))", n_differ}, {"int(bool($a) == bool($b))", n_agree},
    {"int(bool($a) != bool($b))", n_differ}, {"int(!(bool($a) && bool($b)))", n_lacking}, {"max(int(asuint(asfloat($a))), 7)", n_bits},
};
/* clang-format on */

static void check_ints(bool is_unsigned) {
    for (size_t c = 0; c < sizeof int_cases / sizeof *int_cases; c++) {
        Text t = {0};
        double want[INTS * INTS];
        uint32_t n = 0;
        for (int i = 0; i < INTS; i++)
            for (int j = 0; j < INTS; j++) {
                char text[3][40];
                int64_t v[3] = {ints[i], ints[j], ints[(3 * i + 5 * j) % INTS]};
                for (int k = 0; k < 3; k++) {
                    if (is_unsigned) v[k] = (uint32_t)v[k];
                    snprintf(text[k], sizeof text[k],
                             is_unsigned ? "%lldu"
                             : v[k] < 0  ? "(%lld)"
                                         : "%lld",
                             (long long)v[k]);
                }
                char e[300];
                snprintf(e, sizeof e, is_unsigned ? "int(%s)" : "%s", int_cases[c].text);
                put(&t, e, text[0], text[1], text[2]);
                want[n++] = (double)(int32_t)(uint32_t)int_cases[c].want(v[0], v[1], v[2]);
            }
        check("int", t.p, want, n);
        free(t.p);
    }
}

static void test_ints(void **unused) {
    (void)unused;
    check_ints(false);
    check_ints(true);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_floats), cmocka_unit_test(test_ints)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
