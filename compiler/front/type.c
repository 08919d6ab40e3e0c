/* Types are interned: equal types are equal pointers. What does not depend on a program is a constant table here;
 * arrays live in the session, found by element type and length. */
#include "compiler/front/ast.h"

#include <string.h>

#define SIMPLE(k, text) [k] = {.kind = k, .name = text}
static const Type simple[] = {SIMPLE(T_ERROR, "<error>"),     SIMPLE(T_VOID, "void"),          SIMPLE(T_BOOL, "bool"),
                              SIMPLE(T_INT, "int"),           SIMPLE(T_UINT, "uint"),          SIMPLE(T_FLOAT, "float"),
                              SIMPLE(T_TEXTURE, "texture2D"), SIMPLE(T_TEXTURE3D, "texture3D")};
static const Type geometries[] = {
#define GEOMETRY(id, text, ...) {.kind = T_GEOMETRY, .n = SLT_GEOMETRY_##id, .name = #text},
#include "saltus/geometries.def"
#undef GEOMETRY
};

const GeometryType geometry_types[SLT_GEOMETRIES] = {
#define GEOMETRY(id, text, form, least, attributes) {#text, FORM_##form, least, attributes},
#include "saltus/geometries.def"
#undef GEOMETRY
};

enum {
    OBJECT_TEXTURE = T_TEXTURE,
    OBJECT_TEXTURE3D = T_TEXTURE3D,
#define GEOMETRY(id, ...) OBJECT_##id = T_GEOMETRY + SLT_GEOMETRY_##id,
#include "saltus/geometries.def"
#undef GEOMETRY
    SLT_QUERY_NONE = SLT_QUERIES
};
const MethodInfo methods[M_COUNT] = {
#define METHOD(id, object, text, signature, kind, query)                                                               \
    {text, OBJECT_##object, signature, METHOD_##kind, (SltQuery)SLT_QUERY_##query},
#include "compiler/front/check/methods.def"
#undef METHOD
};

#define ELEM(k) ((Type *)&simple[k])
#define VECTOR(k, text, width) {.kind = T_VECTOR, .elem = ELEM(k), .n = width, .name = text #width}
#define VECTORS(k, text) {VECTOR(k, text, 2), VECTOR(k, text, 3), VECTOR(k, text, 4)}
static const Type vectors[4][3] = {VECTORS(T_BOOL, "bool"), VECTORS(T_INT, "int"), VECTORS(T_UINT, "uint"),
                                   VECTORS(T_FLOAT, "float")};
#define MATRIX(r, c) {.kind = T_MATRIX, .elem = ELEM(T_FLOAT), .n = r, .columns = c, .name = "float" #r "x" #c}
#define MATRICES(r) {MATRIX(r, 2), MATRIX(r, 3), MATRIX(r, 4)}
static const Type matrices[3][3] = {MATRICES(2), MATRICES(3), MATRICES(4)};

_Static_assert(T_FLOAT - T_BOOL == 3, "vectors are indexed by scalar kind");

/* Types are passed around as Type * because struct types are filled in while checking; a write to one of these
 * constants is a fault. */
Type *type_scalar(TypeKind k) { return (Type *)&simple[k]; }
Type *type_geometry(SltGeometryKind k) { return (Type *)&geometries[k]; }
bool type_is_texture(const Type *t) { return t->kind == T_TEXTURE || t->kind == T_TEXTURE3D; }
bool type_is_mesh(const Type *t) { return t->kind == T_GEOMETRY && geometry_types[t->n].form == FORM_MESH; }
bool type_is_resource(const Type *t) { return type_is_texture(t) || t->kind == T_GEOMETRY; }

Type *type_vector(Session *s, TypeKind elem, uint32_t n) {
    if (elem < T_BOOL || elem > T_FLOAT || n < 2 || n > 4) ice(s, "no vector of %u elements of kind %d", n, (int)elem);
    return (Type *)&vectors[elem - T_BOOL][n - 2];
}

Type *type_matrix(Session *s, uint32_t rows, uint32_t columns) {
    if (rows < 2 || rows > 4 || columns < 2 || columns > 4) ice(s, "no matrix of %ux%u", rows, columns);
    return (Type *)&matrices[rows - 2][columns - 2];
}

Type *type_row(const Type *matrix) { return (Type *)&vectors[T_FLOAT - T_BOOL][matrix->columns - 2]; }

Type *type_keyword(const char *name, size_t len) {
#define TRY(t)                                                                                                         \
    if ((t).name[0] == *name && strlen((t).name) == len && !memcmp((t).name, name, len)) return (Type *)&(t)
    for (TypeKind k = T_VOID; k <= T_FLOAT; k++) TRY(simple[k]);
    TRY(simple[T_TEXTURE]);
    TRY(simple[T_TEXTURE3D]);
    for (int k = 0; k < SLT_GEOMETRIES; k++)
        if (!(geometry_types[k].attributes & SOFT_NAME)) TRY(geometries[k]);
    for (int k = 0; k < 4; k++)
        for (int n = 0; n < 3; n++) TRY(vectors[k][n]);
    for (int r = 0; r < 3; r++)
        for (int k = 0; k < 3; k++) TRY(matrices[r][k]);
#undef TRY
    return NULL;
}

Type *type_array(Session *s, Type *elem, uint32_t n) {
    struct {
        Type *elem;
        uint64_t n;
    } key = {elem, n};
    uint32_t hash = hash_bytes(&key, sizeof key), at = UINT32_MAX;
    for (const Type *t; (t = table_next(&s->array_types, hash, &at));)
        if (t->elem == elem && t->n == n) return (Type *)t;
    Type *t = ARENA_NEW(&s->session, Type);
    /* Dimensions read outermost first, as they are written: an array of 4 `float[2]` is `float[4][2]`. */
    size_t stem = strcspn(elem->name, "[");
    char length[16] = "";
    if (n) snprintf(length, sizeof length, "%u", n);
    *t = (Type){.kind = T_ARRAY,
                .elem = elem,
                .n = n,
                .name = arena_printf(&s->session, "%.*s[%s]%s", (int)stem, elem->name, length, elem->name + stem)};
    table_insert(s, &s->array_types, t, hash);
    return t;
}

bool type_is_float(const Type *t) {
    return t->kind == T_FLOAT || t->kind == T_MATRIX || (t->kind == T_VECTOR && t->elem->kind == T_FLOAT);
}

uint32_t type_components(const Type *t) {
    uint64_t n = 0;
    if (t->components) return t->components;
    switch (t->kind) {
    case T_ERROR:
    case T_VOID:
    case T_TEXTURE:
    case T_TEXTURE3D:
    case T_GEOMETRY: return 0;
    case T_BOOL:
    case T_INT:
    case T_UINT:
    case T_FLOAT: return 1;
    case T_VECTOR: return t->n;
    case T_MATRIX: return t->n * t->columns;
    case T_ARRAY: n = (uint64_t)t->n * type_components(t->elem); break;
    case T_STRUCT:
        for (uint32_t i = 0; i < t->nfields && n < UINT32_MAX; i++) n += type_components(t->fields[i].type);
        break;
    }
    /* Structs of structs may double at every level: without the cache the walk would, too. Constant types, which must
     * not be written to, never get here. */
    ((Type *)t)->components = n < UINT32_MAX ? (uint32_t)n : UINT32_MAX;
    return t->components;
}
