/* Types are interned, named as people write them, and counted. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <cmocka.h>
#include <string.h>

#include "compiler/front/ast.h"

static Type *keyword(const char *name) { return type_keyword(name, strlen(name)); }

static void identity(void **state) {
    (void)state;
    Session *s = session_create(0);
    assert_ptr_equal(type_vector(s, T_FLOAT, 3), type_vector(s, T_FLOAT, 3));
    assert_ptr_not_equal(type_vector(s, T_FLOAT, 3), type_vector(s, T_INT, 3));
    assert_ptr_equal(type_vector(s, T_UINT, 2)->elem, type_scalar(T_UINT));
    Type *a = type_array(s, type_array(s, type_scalar(T_FLOAT), 2), 4);
    assert_ptr_equal(a, type_array(s, type_array(s, type_scalar(T_FLOAT), 2), 4));
    assert_ptr_not_equal(a, type_array(s, type_array(s, type_scalar(T_FLOAT), 4), 2));
    assert_string_equal(a->name, "float[4][2]");
    assert_string_equal(type_array(s, a, 0)->name, "float[][4][2]");
    for (uint32_t i = 1; i < 1000; i++) assert_ptr_equal(type_array(s, a, i), type_array(s, a, i));
    session_destroy(s);
}

static void keywords(void **state) {
    (void)state;
    static const char *const names[] = {"void",     "bool",     "int",       "uint",       "float",
                                        "bool2",    "int3",     "uint4",     "float2",     "float2x2",
                                        "float2x3", "float4x4", "texture2D", "heightfield"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) assert_string_equal(keyword(names[i])->name, names[i]);
    static const char *const others[] = {"",        "float1", "float5", "float2x5", "float44",
                                         "texture", "Float",  "double", "<error>"};
    for (size_t i = 0; i < sizeof others / sizeof *others; i++) assert_null(keyword(others[i]));
    assert_true(type_is_float(keyword("float4x4")));
    assert_true(type_is_float(keyword("float2")));
    assert_false(type_is_float(keyword("uint2")));
    assert_int_equal(keyword("int4")->n, 4);
    assert_int_equal(keyword("texture2D")->kind, T_TEXTURE);
}

static void components(void **state) {
    (void)state;
    Session *s = session_create(0);
    assert_int_equal(type_components(keyword("float3x3")), 9);
    assert_int_equal(type_components(keyword("bool4")), 4);
    assert_int_equal(type_components(keyword("void")), 0);
    Field fields[2] = {{.name = "a", .type = keyword("float3")},
                       {.name = "b", .type = type_array(s, keyword("int2"), 5)}};
    Type leaf = {.kind = T_STRUCT, .name = "Leaf", .fields = fields, .nfields = 2};
    assert_int_equal(type_components(&leaf), 13);
    /* Each level doubles: walking it without a memory would take 2^40 steps, and the count does not fit. */
    static Type level[40];
    static Field pair[40][2];
    for (int i = 0; i < 40; i++) {
        Type *inner = i ? &level[i - 1] : &leaf;
        pair[i][0] = pair[i][1] = (Field){.name = "x", .type = inner};
        level[i] = (Type){.kind = T_STRUCT, .name = "Level", .fields = pair[i], .nfields = 2};
        assert_true(type_components(&level[i]) == (i < 28 ? 13u << (i + 1) : UINT32_MAX));
    }
    assert_true(type_components(type_array(s, type_array(s, type_array(s, keyword("float"), 1 << 20), 1 << 20),
                                           1 << 30)) == UINT32_MAX);
    session_destroy(s);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(identity), cmocka_unit_test(keywords),
                                       cmocka_unit_test(components)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
