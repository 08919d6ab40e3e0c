/* Arenas, unwinding, interning, suggestions, places and both forms of diagnostics. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <cmocka.h>
#include <jansson.h>
#include <stdlib.h>
#include <string.h>

#include "compiler/base/session.h"
#include "tests/printed.h"

static void colour_form(const Session *s, FILE *f) { diag_print_text(s, f, true); }

/* ---- memory ---- */

static void arenas(void **state) {
    (void)state;
    Session *s = session_create(0);
    Arena *a = &s->scratch;
    ArenaMark empty = arena_mark(a);
    char *p = arena_alloc(a, 100);
    for (int i = 0; i < 100; i++) assert_int_equal(p[i], 0);
    assert_int_equal((uintptr_t)p % 16, 0);
    memset(p, 'x', 100);
    ArenaMark mark = arena_mark(a);
    for (size_t n = 1; n < 400000; n = n * 3 + 1) {
        char *q = arena_alloc(a, n);
        assert_int_equal((uintptr_t)q % 16, 0);
        assert_int_equal(q[0] | q[n - 1], 0);
        memset(q, 'y', n);
    }
    size_t used = s->budget.used;
    arena_reset(a, mark);
    assert_true(s->budget.used < used);
    assert_int_equal(p[99], 'x');
    /* Memory that was used before comes zeroed again. */
    char *again = arena_alloc(a, 64);
    for (int i = 0; i < 64; i++) assert_int_equal(again[i], 0);
    arena_reset(a, empty);
    assert_int_equal(s->budget.used, 0);
    assert_string_equal(arena_printf(a, "%d-%s", 7, "seven"), "7-seven");
    assert_string_equal(arena_strndup(a, "abcdef", 3), "abc");
    Vec(int) v = {0};
    for (int i = 0; i < 1000; i++) vec_push(a, &v, i);
    for (int i = 0; i < 1000; i++) assert_int_equal(v.data[i], i);
    session_destroy(s);
    session_destroy(NULL);
}

static void spend(Session *s, void *arg) {
    (void)arg;
    for (;;) arena_alloc(&s->module, 1000);
}
static void ask_too_much(Session *s, void *arg) { arena_alloc(&s->module, *(size_t *)arg); }
static void fault(Session *s, void *arg) { ice(s, "in %s", (const char *)arg); }
static void nested(Session *s, void *arg) {
    arena_alloc(&s->scratch, 1 << 20);
    *(int *)arg = session_protect(s, fault, "the inner");
    session_limit(s, "outer %d", 1);
}
static void fine(Session *s, void *arg) {
    (void)s;
    *(int *)arg = 5;
}

static void unwinding(void **state) {
    (void)state;
    Session *s = session_create(4 << 20);
    int inner = 0;
    assert_int_equal(session_protect(s, fine, &inner), 0);
    assert_int_equal(inner, 5);
    assert_int_equal(session_protect(s, nested, &inner), 6);
    assert_int_equal(inner, 70);
    assert_string_equal(s->unwind_text, "outer 1");
    assert_int_equal(s->budget.used, 0);
    assert_int_equal(session_protect(s, fault, "a pass"), 70);
    assert_string_equal(s->unwind_text, "internal compiler error: in a pass");
    assert_int_equal(session_protect(s, spend, NULL), 6);
    assert_non_null(strstr(s->unwind_text, "more than 4 MiB"));
    /* Nearly the whole budget was usable, and no more. */
    assert_in_range(s->budget.used, (4u << 20) - 70000, 4u << 20);
    size_t sizes[] = {SIZE_MAX, SIZE_MAX - 8, (size_t)1 << 40};
    for (int i = 0; i < 3; i++) assert_int_equal(session_protect(s, ask_too_much, &sizes[i]), 6);
    /* A source that does not fit is refused, not fatal. */
    static char big[1 << 20];
    assert_int_equal(session_add_text(s, "big", NULL, big, sizeof big), -1);
    session_destroy(s);
}

static void names(void **state) {
    (void)state;
    Session *s = session_create(0);
    const char *kept[2000];
    char name[16];
    for (int i = 0; i < 2000; i++) {
        int n = snprintf(name, sizeof name, "n%d", i);
        kept[i] = intern(s, name, (size_t)n);
    }
    for (int i = 0; i < 2000; i++) {
        int n = snprintf(name, sizeof name, "n%d", i);
        assert_ptr_equal(kept[i], intern(s, name, (size_t)n));
        assert_string_equal(kept[i], name);
    }
    assert_ptr_not_equal(intern(s, "abc", 2), intern(s, "abc", 3));
    assert_ptr_equal(intern(s, "", 0), intern(s, "x", 0));
    const char *known[] = {"radius", NULL, "centre", "x", "y", "smoothstep", "Disc", "NoDisc", "NoDiff"};
    enum { N = sizeof known / sizeof *known };
    assert_string_equal(suggest_nearest("radis", known, N), "radius");
    assert_string_equal(suggest_nearest("raidus", known, N), "radius");
    assert_string_equal(suggest_nearest("RADIUS", known, N), "radius");
    assert_string_equal(suggest_nearest("center", known, N), "centre");
    assert_string_equal(suggest_nearest("disc", known, N), "Disc");
    assert_string_equal(suggest_nearest("NoDif", known, N), "NoDiff");
    assert_string_equal(suggest_nearest("smooth_step", known, N), "smoothstep");
    assert_null(suggest_nearest("z", known, N));
    assert_null(suggest_nearest("colour", known, N));
    assert_null(suggest_nearest("", known, N));
    static char endless[100000];
    memset(endless, 'a', sizeof endless - 1);
    assert_null(suggest_nearest(endless, known, N));
    assert_null(suggest_nearest("radius", NULL, 0));
    session_destroy(s);
}

/* ---- places and text ---- */

static Session *with_source(const char *path, const char *text, size_t len) {
    Session *s = session_create(0);
    assert_int_equal(session_add_text(s, path, NULL, text, len), 0);
    return s;
}

static Diag *mark(Session *s, uint32_t pos, uint32_t len, const char *message) {
    return diag_emit(s, DIAG_syntax, (Span){0, pos, len}, message);
}

static void check_text(const char *source, uint32_t pos, uint32_t len, const char *expected) {
    Session *s = with_source("a.salt", source, strlen(source));
    mark(s, pos, len, "here");
    char *text = printed(s, print_text);
    assert_string_equal(text, expected);
    free(text);
    session_destroy(s);
}

static void excerpts(void **state) {
    (void)state;
    check_text("ab cd ef", 3, 2, "a.salt:1:4: error: here [E0001]\n    1 | ab cd ef\n      |    ^^\n");
    check_text("one\ntwo\n", 4, 3, "a.salt:2:1: error: here [E0001]\n    2 | two\n      | ^^^\n");
    check_text("one\r\ntwo", 5, 1, "a.salt:2:1: error: here [E0001]\n    2 | two\n      | ^\n");
    /* At the end of a line and of the file; a span over several lines is marked on its first. */
    check_text("one\ntwo", 3, 0, "a.salt:1:4: error: here [E0001]\n    1 | one\n      |    ^\n");
    check_text("one\n", 4, 0, "a.salt:2:1: error: here [E0001]\n    2 | \n      | ^\n");
    check_text("one\ntwo", 1, 5, "a.salt:1:2: error: here [E0001]\n    1 | one\n      |  ^^\n");
    check_text("one", 99, 5, "a.salt:1:4: error: here [E0001]\n    1 | one\n      |    ^\n");
    /* Tabs are four columns in the excerpt and one in the number; wide characters two; marks above letters none. */
    check_text("\ta\tb", 3, 1, "a.salt:1:4: error: here [E0001]\n    1 |     a   b\n      |         ^\n");
    check_text("\xC3\xA9 \xE4\xBD\xA0 x", 7, 1,
               "a.salt:1:5: error: here [E0001]\n    1 | \xC3\xA9 \xE4\xBD\xA0 x\n      |      ^\n");
    check_text("e\xCC\x81 x", 4, 1, "a.salt:1:4: error: here [E0001]\n    1 | e\xCC\x81 x\n      |   ^\n");
    check_text("\xEF\xBB\xBFx", 3, 1, "a.salt:1:1: error: here [E0001]\n    1 | x\n      | ^\n");
    /* What a terminal would obey, and what is no UTF-8, is never passed on. */
    check_text("a\033[31m\xFF"
               "b",
               7, 1,
               "a.salt:1:8: error: here [E0001]\n    1 | a\xEF\xBF\xBD[31m\xEF\xBF\xBD"
               "b\n      |        ^\n");
}

static void long_lines(void **state) {
    (void)state;
    size_t n = 1 << 20;
    char *source = malloc(n);
    memset(source, 'a', n);
    Session *s = with_source("a.salt", source, n);
    mark(s, 500000, 3, "here");
    char *text = printed(s, print_text);
    assert_in_range(strlen(text), 150, 400);
    assert_non_null(strstr(text, "a.salt:1:500001: error"));
    assert_non_null(strstr(text, "^^^\n"));
    /* The caret is under the first column of the span: LEAD columns and the mark of the cut. */
    assert_int_equal(strcspn(strstr(text, "      | ") + 8, "^"), 61);
    free(text);
    /* Two hundred errors on one line of a megabyte are counted on from each other. */
    for (uint32_t i = 0; i < 200; i++) mark(s, i * 5000, 1, "here");
    text = printed(s, diag_print_json);
    assert_non_null(strstr(text, "\"character\":995000}"));
    free(text);
    session_destroy(s);
    free(source);
}

static void order_and_count(void **state) {
    (void)state;
    static char source[1000];
    memset(source, '\n', sizeof source);
    Session *s = with_source("a.salt", source, sizeof source);
    for (int i = 29; i >= 0; i--) {
        mark(s, (uint32_t)i, 1, "here");
        mark(s, (uint32_t)i, 1, "here again"); /* the same code at the same place */
    }
    Diag *twice = mark(s, 3, 1, "third time");
    diag_note(s, twice, SPAN_NONE, "on a copy that nobody prints");
    assert_int_equal(s->nerrors, 30);
    char *text = printed(s, print_text);
    const char *at = text;
    for (int i = 1; i <= 20; i++) {
        char place[64];
        snprintf(place, sizeof place, "a.salt:%d:1: error: here [E0001]\n", i);
        at = strstr(at, place);
        assert_non_null(at);
    }
    assert_null(strstr(text, "a.salt:21:"));
    assert_non_null(strstr(text, "\n10 more errors\n"));
    assert_null(strstr(text, "again"));
    assert_null(strstr(text, "nobody"));
    free(text);
    s->max_errors = 0;
    text = printed(s, print_text);
    assert_non_null(strstr(text, "a.salt:30:1:"));
    assert_null(strstr(text, "more error"));
    free(text);
    session_destroy(s);
}

static void notes(void **state) {
    (void)state;
    Session *s = with_source("a.salt", "first second", 12);
    Diag *d = mark(s, 6, 6, "here");
    diag_note(s, d, (Span){0, 0, 5}, "and %s", "there");
    diag_note(s, d, SPAN_NONE, "nowhere");
    diag_emit(s, DIAG_syntax, SPAN_NONE, "without a place");
    char *text = printed(s, print_text);
    assert_string_equal(text, "error: without a place [E0001]\n"
                              "a.salt:1:7: error: here [E0001]\n    1 | first second\n      |       ^^^^^^\n"
                              "a.salt:1:1: note: and there\n    1 | first second\n      | ^^^^^\nnote: nowhere\n");
    free(text);
    text = printed(s, colour_form);
    assert_non_null(strstr(text, "\033[1;31merror:\033[0m here"));
    free(text);
    session_destroy(s);
}

static json_int_t number(json_t *range, const char *end, const char *key) {
    return json_integer_value(json_object_get(json_object_get(range, end), key));
}

static void json_form(void **state) {
    (void)state;
    /* U+1F600 is two UTF-16 units, é one, a byte that is no UTF-8 one. */
    const char *source = "x\n\xF0\x9F\x98\x80\xC3\xA9\xFFz";
    Session *s = with_source("/a b/\xC3\xA9%.salt", source, strlen(source));
    Diag *d = mark(s, 9, 1, "quote \" slash \\ tab \t byte \x01 \xFF end");
    diag_note(s, d, (Span){0, 0, 1}, "first");
    diag_note(s, d, SPAN_NONE, "second");
    char *text = printed(s, diag_print_json);
    assert_int_equal(text[strlen(text) - 1], '\n');
    json_error_t error;
    json_t *o = json_loads(text, 0, &error);
    assert_non_null(o);
    assert_string_equal(json_string_value(json_object_get(o, "uri")), "file:///a%20b/%C3%A9%25.salt");
    assert_string_equal(json_string_value(json_object_get(o, "code")), "E0001");
    assert_string_equal(json_string_value(json_object_get(o, "source")), "saltus");
    assert_string_equal(json_string_value(json_object_get(o, "message")),
                        "quote \" slash \\ tab \t byte \x01 \xEF\xBF\xBD end");
    assert_int_equal(json_integer_value(json_object_get(o, "severity")), 1);
    json_t *range = json_object_get(o, "range");
    assert_int_equal(number(range, "start", "line"), 1);
    assert_int_equal(number(range, "start", "character"), 4);
    assert_int_equal(number(range, "end", "character"), 5);
    json_t *related = json_object_get(o, "relatedInformation");
    assert_int_equal(json_array_size(related), 2);
    json_t *first = json_array_get(related, 0);
    assert_string_equal(json_string_value(json_object_get(first, "message")), "first");
    range = json_object_get(json_object_get(first, "location"), "range");
    assert_int_equal(number(range, "start", "line"), 0);
    assert_int_equal(number(range, "end", "character"), 1);
    json_decref(o);
    free(text);
    session_destroy(s);
    s = with_source("-", "x", 1);
    mark(s, 0, 1, "here");
    text = printed(s, diag_print_json);
    assert_non_null(strstr(text, "\"uri\":\"untitled:stdin\""));
    free(text);
    session_destroy(s);
}

static void codes(void **state) {
    (void)state;
    DiagTitle title;
    assert_non_null(diag_explain("E0001", &title));
    assert_int_equal(title.severity, SEV_ERROR);
    assert_non_null(diag_explain("e0501", &title));
    assert_string_equal(title.code, "E0501");
    assert_string_equal(title.text, "the program has more than N operations with every call inlined");
    assert_non_null(diag_explain("E0101", &title));
    assert_string_equal(title.text, "unknown name `NAME`");
    assert_non_null(diag_explain("W0401", &title));
    assert_string_equal(title.text, "untracked discontinuity: ... depends on the position and on ...");
    assert_null(diag_explain("E9999", &title));
    /* Codes are unique, have the shape of codes, and every one is explained. */
    for (int i = 0; i < DIAG_COUNT; i++) {
        const char *code = diag_code_name((DiagCode)i);
        assert_int_equal(strlen(code), 5);
        assert_non_null(strchr("EWPN", code[0]));
        assert_true(strlen(diag_explain(code, &title)) > 20);
        assert_null(strchr(title.text, '%'));
        for (int k = 0; k < i; k++) assert_string_not_equal(code, diag_code_name((DiagCode)k));
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(arenas),   cmocka_unit_test(unwinding),  cmocka_unit_test(names),
        cmocka_unit_test(excerpts), cmocka_unit_test(long_lines), cmocka_unit_test(order_and_count),
        cmocka_unit_test(notes),    cmocka_unit_test(json_form),  cmocka_unit_test(codes)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
