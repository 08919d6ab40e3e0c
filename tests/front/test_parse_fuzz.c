/* Broken programs: valid sources are mutated, cut and spliced with a fixed seed. Whatever comes out, the parser ends,
 * stays in its limits, leaves a tree that can be walked, and reports only places inside the source, in JSON that is
 * JSON. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <cmocka.h>
#include <jansson.h>

#include "tests/front/parse_fixture.h"

static const char *const seeds[] = {
    "import sdf;\nconst int N = 3;\n[Range(0.05, 0.9)] param float radius = 0.4;\n[Domain(-1.0, 1.0)]\nshader float3 "
    "main(float2 x) {\n"
    "  float3 c = float3(1.0);\n  for (int i = 0; i < N; i++) {\n    float d = sd_circle(x - float2(0.2 * i, 0.0), "
    "radius);\n"
    "    [Disc] if (d < 0.0) c = lerp(c, float3(0.9, 0.3, 0.1), 0.5);\n  }\n  return c;\n}\n",
    "struct Disc { float2 centre; float r, w[2]; };\nparam Disc discs[4] = init(make);\nDisc make(int i) { Disc d = { "
    "float2(0.1 * i, 0.2), 0.3, { 1.0, 2.0 } }; return d; }\n",
    "float f(float a, in int b, out float2 c, inout float d[2]) { c = float2(a, b); d[1] += a; return (float)b * -a; "
    "}\n",
    "void f() { switch (n) { case 0: case 1: a = 1; break; case 2: { b(); } default: return; } }\n",
    "[Tangent(df)] float f(float a, float b) { return a * b; }\nfloat df(float a, float b, float da, float db) { "
    "return da * b + a * db; }\n",
    "[NoDiff, Doc(\"how \\\"wide\\\"\")] param float3 c = float3(1.0, 2.0, 3.0);\nparam texture2D t = zeros(4, 4, "
    "3);\nparam float verts[][3] = \"mesh.npy\";\n",
    "[Extent(0.0, 0.0, 2.0, 2.0)] [Height(100.0, -5.0)] param heightfield h = \"dem.exr\";\nshader float main(float2 "
    "p) { [Disc] Hit v = h.trace(o, d, 0.0, 1e9); return v.hit ? v.t : 0.0; }\n",
    "void g() { do { a = b ? c : d ? e : f; } while (a < b && !(c >= d) || e != f); for (;;) { if (a) break; else "
    "continue; } }\n",
    "const float w[2][3] = { { 1.0, .5, 1e-3 }, { 0x1F, 1u, 2.5e+3f } };\ntypedef float3 Ink;\ntypedef float "
    "M[2][3];\n",
    "void h() { [MaxIters(N * 2)] while (a > b) { a -= 1; a *= 2; b <<= 3; b ^= ~c | d & e; } [Disc, SkipLoop] if (x) "
    "{ } else if (y) z++; else --w; }\n",
    "void k() { print(\"x {} y {}\\n\", x, y.zyx); assert(x > 0.0, \"positive\"); float2x2 m = float2x2(1, 2, 3, 4); "
    "m[0][1] = m[1].x; }\n",
    "/* caf\xC3\xA9 */ // \xE4\xBD\xA0\xE5\xA5\xBD\r\nconst int a = 1; const int b = -2147483648; const uint c = "
    "4294967295;\r",
    "[NoDisc] shader float main(float x) { [Cull(box)] for (int i = 0, j = 9; i < j; i++, j--) x = "
    "t.sample(float2(x)).r + t.load(int2(i, j)).a; return x; }\n",
    "static float x = 1.0;\n#define X\nvoid f( { a = ; b[1 = 2; } }\nstruct S { float a b; }\n[Rnge(1)] param float "
    "q;\n",
};
enum { NSEEDS = sizeof seeds / sizeof *seeds, ROUNDS = 6000 };

static uint64_t rng = 0x9E3779B97F4A7C15u;
static uint32_t below(uint32_t n) {
    rng ^= rng << 13;
    rng ^= rng >> 7;
    rng ^= rng << 17;
    return (uint32_t)((rng >> 20) % n);
}

static size_t remove_at(char *text, size_t n, size_t at, size_t count) {
    memmove(text + at, text + at + count, n - at - count);
    return n - count;
}

static size_t insert_at(char *text, size_t n, size_t cap, size_t at, const char *what, size_t count) {
    if (n + count > cap) return n;
    memmove(text + at + count, text + at, n - at);
    memcpy(text + at, what, count);
    return n + count;
}

static size_t mutate(char *text, size_t n, size_t cap) {
    static const char *const words[] = {
        "(",      ")",      "[",     "]",      "{",      "}",          ";",  ",",      "=",      "?",
        ":",      ".",      "\"",    "/*",     "*/",     "//",         "\n", "else",   "if",     "for",
        "case",   "shader", "param", "struct", "float",  "float3",     "in", "[Disc]", "import", "typedef",
        "return", "switch", "0x",    "1e",     "1.0.0",  "4294967296", "-",  "++",     "<<=",    "\xFF",
        "\xC3",   "#",      "\0",    "{{{{{{", "((((((", "const",      "do", "while"};
    uint32_t steps = 1 + below(4);
    while (steps-- && n > 0) {
        size_t at = below((uint32_t)n);
        size_t count = 1 + below(12);
        if (count > n - at) count = n - at;
        const char *word = words[below(sizeof words / sizeof *words)];
        char piece[16];
        switch (below(7)) {
        case 0: text[at] = (char)below(256); break;
        case 1: n = remove_at(text, n, at, count); break;
        case 2: n = at; break;
        case 3: n = insert_at(text, n, cap, at, word, *word ? strlen(word) : 1); break;
        case 4:
            memcpy(piece, text + at, count);
            n = insert_at(text, n, cap, at, piece, count);
            break;
        case 5: {
            memcpy(piece, text + at, count);
            n = remove_at(text, n, at, count);
            n = insert_at(text, n, cap, below((uint32_t)n + 1), piece, count);
            break;
        }
        default: {
            const char *other = seeds[below(NSEEDS)];
            size_t start = below((uint32_t)strlen(other)), len = strlen(other) - start;
            n = insert_at(text, n, cap, at, other + start, len > 80 ? 80 : len);
        }
        }
    }
    return n;
}

static void check_json(const Parsed *p, size_t len) {
    char *json = printed(p->s, diag_print_json);
    uint32_t lines = 0;
    for (char *line = json, *end; *line; line = end + 1, lines++) {
        end = strchr(line, '\n');
        *end = 0;
        json_error_t error;
        json_t *object = json_loads(line, 0, &error);
        if (!object) print_message("%s\n%s\n", error.text, line);
        assert_non_null(object);
        assert_non_null(json_object_get(object, "uri"));
        assert_true(json_is_string(json_object_get(object, "message")));
        json_decref(object);
    }
    assert_int_equal(lines, p->s->nerrors);
    for (const Diag *d = p->s->diags; d; d = d->next) assert_in_range(d->span.pos, 0, len);
    free(json);
}

static void mutations(void **state) {
    (void)state;
    enum { CAP = 4096 };
    uint32_t clean = 0, broken = 0;
    for (int round = 0; round < ROUNDS; round++) {
        /* An exact allocation, so that a sanitizer sees a read beyond it. */
        char buf[CAP];
        const char *seed = seeds[round % NSEEDS];
        size_t n = strlen(seed);
        memcpy(buf, seed, n);
        n = mutate(buf, n, CAP);
        char *text = malloc(n ? n : 1);
        memcpy(text, buf, n);
        Parsed p = parse_bytes(text, n);
        assert_int_equal(p.status, 0);
        /* No error hides: a tree with an error node comes with a report. */
        if (strstr(p.dump, "ERROR")) assert_true(p.s->nerrors > 0);
        if (p.s->nerrors) broken++;
        else clean++;
        check_json(&p, n);
        parsed_free(&p);
        free(text);
    }
    /* The mutations neither leave everything whole nor break everything. */
    assert_true(clean > ROUNDS / 50);
    assert_true(broken > ROUNDS / 2);
}

/* Every prefix of every seed: the end of the file in every state of the parser. */
static void prefixes(void **state) {
    (void)state;
    for (int i = 0; i < NSEEDS; i++)
        for (size_t n = 0; n <= strlen(seeds[i]); n++) {
            Parsed p = parse_bytes(seeds[i], n);
            assert_int_equal(p.status, 0);
            if (i != NSEEDS - 1 && p.s->nerrors > 2) print_message("%.*s\n%s", (int)n, seeds[i], p.text);
            if (i != NSEEDS - 1) assert_in_range(p.s->nerrors, 0, 2);
            parsed_free(&p);
        }
}

/* Bytes that were never a program. */
static void noise(void **state) {
    (void)state;
    for (int round = 0; round < 500; round++) {
        char buf[300];
        size_t n = below(sizeof buf);
        for (size_t i = 0; i < n; i++)
            buf[i] = round % 2 ? (char)below(256) : "(){}[];,.=+-<>?:\"/*# \nabc019"[below(28)];
        Parsed p = parse_bytes(buf, n);
        assert_int_equal(p.status, 0);
        check_json(&p, n);
        parsed_free(&p);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(mutations), cmocka_unit_test(prefixes),
                                       cmocka_unit_test(noise)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
