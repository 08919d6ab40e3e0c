/* Functions of the library by table: an expression of the numbers v[], and the same in C. Values to 1e-9, derivatives
 * against differences of the C function, at points of v's own box. */
#ifndef TESTS_STDLIB_TABLE_H
#define TESTS_STDLIB_TABLE_H

#include "tests/stdlib/fixture.h"

enum { TABLE_NUMBERS = 16, TABLE_POINTS = 60 };

typedef struct Case {
    const char *body; /* an expression, or statements with a return, of v[0] .. v[15] */
    double (*want)(const double *v);
    double lo, hi; /* of each number; both 0: -1 to 1 */
    int used;      /* numbers to differentiate by; 0: all 16 */
} Case;

static inline SltProgram *table_program(const char *module, const Case *c) {
    char source[4096];
    const char *form = strstr(c->body, "return") ? "%s" : "return %s;";
    int n = snprintf(source, sizeof source,
                     "import %s;\nfloat zero(int i) { return 0.0; }\nparam float v[16] = init(zero);\n"
                     "shader float main(float2 ignored) { ",
                     module);
    n += snprintf(source + n, sizeof source - (size_t)n, form, c->body);
    snprintf(source + n, sizeof source - (size_t)n, " }\n");
    return compile(source, NULL);
}

static inline void table_run(const char *module, const Case *cases, size_t n) {
    for (size_t k = 0; k < n; k++) {
        const Case *c = &cases[k];
        SltProgram *p = table_program(module, c);
        assert_int_equal(slt_site_count(p), 0);
        uint32_t seed = 7;
        double lo = c->lo, hi = c->hi;
        if (lo == 0 && hi == 0) lo = -1, hi = 1;
        for (int i = 0; i < TABLE_POINTS; i++) {
            double v[TABLE_NUMBERS], got, g[TABLE_NUMBERS];
            for (int a = 0; a < TABLE_NUMBERS; a++) v[a] = lo + (hi - lo) * uniform(&seed);
            set(p, "v", v);
            evaluate(p, &got, g);
            double want = c->want(v);
            if (!(fabs(got - want) <= 1e-9 * (1 + fabs(want))))
                fail_msg("%s = %.12g, wanted %.12g", c->body, got, want);
            for (int a = 0; a < (c->used ? c->used : TABLE_NUMBERS); a++) {
                double at = v[a], h = 1e-5;
                v[a] = at + h;
                double up = c->want(v);
                v[a] = at - h;
                double down = c->want(v);
                v[a] = at;
                double fd = (up - down) / (2 * h), bent = fabs(up + down - 2 * want) / h;
                /* At a kink within the step there is nothing to compare with. */
                if (!(fabs(fd - g[a]) <= 1e-5 * (1 + fabs(fd)) + bent))
                    fail_msg("%s: derivative %d is %.9g, differences %.9g", c->body, a, g[a], fd);
            }
        }
        slt_program_free(p);
    }
}

#define TABLE_RUN(module, cases) table_run(module, cases, sizeof(cases) / sizeof *(cases))

/* ---- vectors for the closed forms */
typedef struct V3 {
    double x, y, z;
} V3;
static inline V3 v3(const double *v) { return (V3){v[0], v[1], v[2]}; }
static inline V3 sub3(V3 a, V3 b) { return (V3){a.x - b.x, a.y - b.y, a.z - b.z}; }
static inline V3 add3(V3 a, V3 b) { return (V3){a.x + b.x, a.y + b.y, a.z + b.z}; }
static inline V3 mul3(double s, V3 a) { return (V3){s * a.x, s * a.y, s * a.z}; }
static inline double dot3(V3 a, V3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline V3 cross3(V3 a, V3 b) {
    return (V3){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
static inline double len3(V3 a) { return sqrt(dot3(a, a)); }
static inline V3 unit3(V3 a) { return mul3(1 / len3(a), a); }
/* In the language, of v from index i on. */
#define VEC2(i) "float2(v[" #i "], v[" #i " + 1])"
#define VEC3(i) "float3(v[" #i "], v[" #i " + 1], v[" #i " + 2])"
#define VEC4(i) "float4(v[" #i "], v[" #i " + 1], v[" #i " + 2], v[" #i " + 3])"

#endif
