/* The abstract syntax tree, before and after checking.
 *
 * parse/ builds it untyped; check/ resolves names, picks overloads, inserts every implicit conversion as an explicit
 * node and fills `type`; gen/ reads only checked trees without errors. Nodes live in the module arena. Types are
 * interned: equal types are equal pointers.
 *
 * After checking:
 *  - every Expr has `type`, and operands already have exactly the type the operation wants (E_CONVERT and E_BROADCAST
 *    nodes do the rest);
 *  - E_NAME has `sym`; E_CALL has `func`; E_BUILTIN has `builtin`; constants are not folded away, but `is_const` and
 *    `cval` are set where the language asks for constants (array sizes, MaxIters, case labels, trip counts) and for all
 *    const globals;
 *  - `a op= b` is E_ASSIGN with `op`, and b is converted; the place is evaluated once;
 *  - a texture call that narrows has an E_CONVERT from float4 to the narrower type around it. */
#ifndef SALTUS_FRONT_AST_H
#define SALTUS_FRONT_AST_H

#include "compiler/base/session.h"
#include "saltus/query.h"

typedef enum TypeKind {
    T_ERROR,
    T_VOID,
    T_BOOL,
    T_INT,
    T_UINT,
    T_FLOAT, /* scalars keep this order */
    T_VECTOR,
    T_MATRIX,
    T_ARRAY,
    T_STRUCT,
    T_TEXTURE,
    T_TEXTURE3D,
    T_GEOMETRY /* last: methods.def counts its objects from here */
} TypeKind;

typedef struct Type Type;
typedef struct ParamAttrs ParamAttrs;
typedef struct Field {
    const char *name;
    Type *type;
    Span span;
    const ParamAttrs *attrs; /* [Range] and [Log] of it; NULL: none */
} Field;
struct Type {
    TypeKind kind;
    Type *elem;       /* of a vector, matrix or array; T_ERROR, T_VOID and scalars: NULL */
    uint32_t n;       /* vector, rows of a matrix: 2..4; array: length (0 while an open `[]` is not resolved);
                         geometry: its SltGeometryKind */
    uint32_t columns; /* of a matrix, 2..4 */
    const char *name; /* as people write it: "float3", "Disc", "float[4][2]" */
    Field *fields;    /* struct; what methods give, as Hit, is predeclared */
    uint32_t nfields;
    Type *next;          /* the checker's own */
    uint32_t components; /* cache of type_components for structs and arrays; 0 until known */
};

typedef struct Expr Expr;
typedef struct Stmt Stmt;
typedef struct Symbol Symbol;
typedef struct Func Func;
typedef struct Module Module;

/* A type as written: the parser leaves names unresolved, the checker resolves them into Type pointers. Names are
 * interned. `float[3] a[2]` has dims {2, 3}: outermost first, the declarator's before the type's own. */
typedef struct TypeRef {
    const char *name; /* "float3", "void", "Disc", a typedef's name, "texture2D" */
    Span span;        /* of the name */
    Expr **dims;      /* NULL entry: open `[]` (only parsed first, and only where a value is given) */
    uint32_t ndims;   /* at most 16 */
} TypeRef;

/* struct Name { fields }; */
typedef struct FieldDecl {
    const char *name;
    Span span; /* of the name */
    TypeRef *type_ref;
    ParamAttrs *attrs; /* as of Field; shared by the fields of one declaration */
} FieldDecl;
typedef struct StructDecl StructDecl;
struct StructDecl {
    const char *name;
    Span span; /* of the name */
    FieldDecl *fields;
    uint32_t nfields;
    Module *module;
    Type *type;           /* filled by the checker */
    uint32_t check_state; /* the checker's own */
    StructDecl *next;     /* in order of declaration */
};
/* typedef T name; (also `typedef float F3[3];` and `typedef float[3] F3;`) */
typedef struct TypedefDecl TypedefDecl;
struct TypedefDecl {
    const char *name;
    Span span; /* of the name */
    TypeRef *type_ref;
    Module *module;
    Type *type;           /* filled by the checker */
    uint32_t check_state; /* the checker's own */
    TypedefDecl *next;    /* in order of declaration */
};

/* A compile-time constant: up to 16 components of a scalar kind (integers as bit patterns widened from 32 bits). */
typedef union ConstNum {
    double f;
    int64_t i; /* int: sign extended, uint: zero extended, bool: 0/1 */
} ConstNum;
typedef struct ConstVal {
    ConstNum v[16];
    uint32_t n;
} ConstVal;

typedef enum ExprKind {
    E_ERROR,
    E_LITERAL,   /* cval */
    E_NAME,      /* sym */
    E_UNARY,     /* op (- + ! ~) a[0] */
    E_BINARY,    /* op: + - * / % & | ^ << >> == != < <= > >= on equal operand types (shifts: result type of the left);
                    `*` with a matrix keeps its operand types: mat*mat, mat*vec, vec*mat, mat*scalar, scalar*mat */
    E_LOGIC,     /* op: && || , scalar bools, evaluates only what it needs */
    E_COND,      /* a[0] ? a[1] : a[2], evaluates only what it needs */
    E_ASSIGN,    /* a[0] (place) op= a[1]; op == '=' for plain */
    E_INCDEC,    /* op: ++ or --; prefix tells */
    E_CALL,      /* func, args */
    E_BUILTIN,   /* builtin, args */
    E_METHOD,    /* method of a texture or geometry: a[0] object (E_NAME), args */
    E_CONSTRUCT, /* type(args): args already converted to the scalar kind; their components fill the type in order */
    E_CONVERT, /* a[0] to `type`: scalar kind change component-wise (explicit int(v) too: `explicit_cast`), or narrowing
                  of texture results */
    E_BROADCAST, /* scalar a[0] to every component of vector `type` */
    E_INDEX,     /* a[0][a[1]]: array, vector, matrix (gives a row) or parameter array; index is int or uint */
    E_FIELD,     /* a[0].field */
    E_SWIZZLE,   /* a[0].swz[0..n) */
    E_LIST,      /* { ... } initialiser of `type`: one arg per element or field, nested lists already shaped */
    E_COMMA,     /* a[0], a[1] */
    E_LEN,       /* len(a): int constant, cval */
} ExprKind;

typedef enum Builtin {
    B_NONE,
#define BUILTIN(id, ...) B_##id,
#include "compiler/front/check/builtins.def"
#undef BUILTIN
    B_COUNT
} Builtin;

/* Rows of saltus/geometries.def: geometry_types[SltGeometryKind]. */
enum { PLACED_EXTENT = 1, PLACED_HEIGHT = 2, SOFT_NAME = 4 };
typedef enum GeometryForm { FORM_GRID, FORM_MESH } GeometryForm;
typedef struct GeometryType {
    const char *name;
    GeometryForm form;
    uint32_t least;      /* values along each side of its grid; triangles */
    uint32_t attributes; /* PLACED_ bits: which may stand before it; SOFT_NAME */
} GeometryType;
extern const GeometryType geometry_types[SLT_GEOMETRIES];

typedef enum Method {
#define METHOD(id, ...) M_##id,
#include "compiler/front/check/methods.def"
#undef METHOD
    M_COUNT
} Method;
typedef enum MethodKind { METHOD_SMOOTH, METHOD_JUMPS, METHOD_FIXED } MethodKind;
typedef struct MethodInfo {
    const char *name;
    uint32_t object;       /* T_TEXTURE, T_TEXTURE3D, or T_GEOMETRY + SltGeometryKind */
    const char *signature; /* result, then arguments: letters of methods.def */
    MethodKind kind;
    SltQuery query; /* SLT_QUERIES: none */
} MethodInfo;
extern const MethodInfo methods[M_COUNT]; /* rows of methods.def */

/* Operators, shared by the lexer and the tree. */
typedef enum Operator {
    OPR_NONE,
    OPR_ADD,
    OPR_SUB,
    OPR_MUL,
    OPR_DIV,
    OPR_MOD,
    OPR_AND,
    OPR_OR,
    OPR_XOR,
    OPR_SHL,
    OPR_SHR,
    OPR_EQ,
    OPR_NE,
    OPR_LT,
    OPR_LE,
    OPR_GT,
    OPR_GE,
    OPR_LAND,
    OPR_LOR,
    OPR_NOT,
    OPR_COMPL,
    OPR_NEG,
    OPR_PLUS,
    OPR_INC,
    OPR_DEC
} Operator;

struct Expr {
    ExprKind kind;
    Span span;    /* the whole expression */
    Span op_span; /* the operator, field name or callee: where carets point */
    Type *type;
    Operator op;
    Expr *a[3];
    Expr **args;
    uint32_t nargs;
    Symbol *sym;
    Func *func;
    Builtin builtin;
    Method method;
    uint32_t field; /* E_FIELD index */
    uint8_t swz[4], nswz;
    bool prefix, explicit_cast, is_const, parenthesised;
    bool is_builtin; /* E_CALL in GLSL: of ours under its own name there; nothing of the file hides it */
    ConstVal cval;
    const char *other; /* E_CALL in GLSL: the builtin behind a function of the file that has its name */
    TypeRef *of;       /* E_LIST in GLSL: the array that `T[n](…)` makes */
    const char *name;  /* untyped: identifier, callee, field or swizzle text; E_CONSTRUCT: type name */
    uint32_t depth;    /* height of this tree as parsed (a leaf is 1); at most 4096, so recursion over it is safe */
};

/* What the parser leaves in an Expr (everything else is zero), names interned:
 *  E_LITERAL    type (bool, int, uint or float) and cval with n == 1; a string: type NULL, `name` its decoded text
 *  E_NAME       name
 *  E_CALL       name, args; also a constructor of a user's type (`Disc(a, b)`), a builtin, `len`
 *  E_CONSTRUCT  name of a type keyword, args: `float3(1.0)`, `int(v)`; explicit_cast: a C cast, `(float)v`, `(Disc)0`
 *  E_METHOD     a[0], name, args: `t.sample(uv)`
 *  E_FIELD      a[0], name: `a.b`; also a swizzle
 *  E_ASSIGN     a[0], a[1], op: OPR_NONE for plain `=`, OPR_ADD and so on for `+=` ...
 *  E_LIST       args; stands only in initialisers
 *  E_INDEX, E_UNARY, E_BINARY, E_LOGIC, E_COND, E_INCDEC, E_COMMA as above
 *  E_ERROR      nothing: a syntax error was reported */

typedef enum SymbolKind { SYM_LOCAL, SYM_ARG, SYM_CONST, SYM_PARAM } SymbolKind;
typedef enum ArgMode { ARG_IN, ARG_OUT, ARG_INOUT } ArgMode;

/* Attributes of parameters ([Range] and friends), and of fields ([Range], [Log]). */
struct ParamAttrs {
    /* as parsed: constant expressions, which the checker evaluates into the numbers below and sets the has_ flag */
    Expr *range_args[2], *extent_args[4], *height_args[2];
    Span range_span, extent_span, height_span, color_span, log_span, nodiff_span, vertex_span;
    const char *vertex_name; /* [Vertex(place)]: the name */
    bool nodiff, color, log, has_range, has_extent, has_height;
    double lo, hi;
    const char *doc;
    double extent[4], height_scale, height_offset;
};

struct Symbol {
    SymbolKind kind;
    const char *name;
    Type *type;
    Span span;
    ArgMode mode;     /* SYM_ARG */
    bool was_out;     /* GLSL's `out`, which need not be assigned, and so is an `inout` */
    Module *module;   /* SYM_CONST, SYM_PARAM */
    Expr *init;       /* local initialiser, const value, param value (NULL where open) */
    ConstVal cval;    /* SYM_CONST of scalar, vector or matrix type */
    Expr *array_init; /* SYM_CONST of array or struct type: its checked E_LIST */
    uint32_t id;      /* dense within the function (locals, arguments); at file scope how far its check is (param.c) */
    /* parameters */
    ParamAttrs attrs;
    Func *init_func;   /* = init(f) */
    Func *place;       /* of a mesh: [Vertex(place)] */
    const char *asset; /* = "file", resolved path */
    bool zeros;        /* = zeros(w, h[, d][, channels]) */
    bool open;         /* an array whose first size is `[]` */
    bool sized;        /* an open array or a texture with the size of values that the caller sets; zeros till then */
    uint32_t tex_w, tex_h, tex_d, tex_c; /* of textures and geometries that are grids, known at compile time; tex_d:
                                            slices of a texture3D, else 0 */
    uint32_t nvertices, nfaces, valence; /* of a mesh, known at compile time; valence: most faces of a vertex */
    bool has_uv;                         /* of a mesh: its topology has places in a texture */
    uint32_t param_index;                /* in Program.params */
    const char *doc_name;                /* "radius" or "module.name" */
    /* as parsed */
    TypeRef *type_ref;
    bool is_const;          /* `const` local: it has an init and is never assigned */
    bool hidden;            /* SYM_ARG: a variable of the file in GLSL, which its functions hand on */
    bool starts_zero;       /* no value is written: zero (GLSL's uniforms) */
    const char *init_name;  /* = init(f): the name f; `init` is NULL then, as for the next two */
    const char *asset_text; /* = "file": the text as written (decoded), `asset` is what the checker resolves it to */
    Expr **zeros_args;      /* = zeros(…): 2 to 4 expressions, `zeros` is set */
    uint32_t nzeros_args;
    Span value_span; /* of the f, the string or the whole zeros(...) */
    Symbol *next;    /* consts and params of a module, in order */
};

typedef enum StmtKind {
    S_EXPR,
    S_DECL,
    S_IF,
    S_FOR,
    S_WHILE,
    S_DO,
    S_SWITCH,
    S_BREAK,
    S_CONTINUE,
    S_RETURN,
    S_BLOCK,
    S_EMPTY,
    S_PRINT,
    S_ASSERT
} StmtKind;

/* Attributes of a statement, as written. */
typedef struct StmtAttrs {
    bool disc, nodisc, skip_loop;
    Span disc_span, skip_span, nodisc_span, max_iters_span;
    Expr *max_iters; /* checked: constant int, value in max_iters->cval */
    Func *cull;      /* [Cull(bounds)] */
    Span cull_span;
    const char *cull_name;
} StmtAttrs;

typedef struct SwitchCase {
    bool is_default;
    int64_t label; /* checked */
    Expr *label_expr;
    Span span;
    Stmt **body; /* falls through to the next case unless it breaks */
    uint32_t nbody;
} SwitchCase;

struct Stmt {
    StmtKind kind;
    bool open_ended; /* a loop of GLSL: where nothing bounds it, GLSL_MAX_ITERS does */
    Span span; /* compound statements: the header, from the keyword to its `)`; blocks: the `{`; others: the whole */
    StmtAttrs attrs;
    Expr *expr;     /* S_EXPR, S_RETURN (or NULL), condition of S_IF S_FOR S_WHILE S_DO, value of S_SWITCH, S_ASSERT
                       condition */
    Symbol **decls; /* S_DECL: one per declarator, `init` in the symbol */
    uint32_t ndecls;
    Stmt *init;          /* S_FOR: S_DECL, S_EXPR or NULL */
    Expr *step;          /* S_FOR */
    Stmt *body, *orelse; /* S_IF both; loops: body */
    Stmt **stmts;        /* S_BLOCK */
    uint32_t nstmts;
    SwitchCase *cases;
    uint32_t ncases;
    Expr **args; /* S_PRINT: values and strings (E_LITERAL with name set, type NULL); S_ASSERT: its text, if any */
    uint32_t nargs;
    /* loops, filled by the checker */
    int64_t trip_bound; /* most iterations that can run: [MaxIters], or proven from constants, len and outer counters;
                           gen may find fewer */
    bool trip_exact;    /* the bound is proven, no [MaxIters] cut is needed */
    bool trip_told;     /* it goes over the pieces of a mesh, which are far fewer */
    int64_t trip_count; /* the trip count where it is one constant (break and return may shorten it), else 0; for
                           definite assignment */
};

struct Func {
    const char *name;
    Span span, name_span;
    Module *module;
    Type *ret;
    Symbol **args;
    uint32_t nargs;
    Stmt *body;
    bool is_shader;
    const char *tangent_name; /* [Tangent(df)] */
    Span tangent_span;
    Func *tangent;
    bool nodisc; /* [NoDisc] covers the whole body */
    bool jumps;  /* of the standard library: [Disc] at a call makes sites in it, as of a jumping builtin */
    bool uses_rand;
    /* shaders */
    uint32_t dim; /* 1..3 */
    bool has_domain;
    bool display; /* [Display]: what it returns is meant for a screen as it is */
    double lo[3], hi[3];
    Expr *domain_lo, *domain_hi;
    uint32_t nlocals; /* size of the Symbol.id space */
    uint32_t check_state;
    /* as parsed */
    TypeRef *ret_ref;
    Span domain_span, nodisc_span, end_span; /* end_span: the closing brace */
    Func *next;                              /* in order of declaration */
};

typedef struct Import {
    const char *name;
    Span span;
    bool of_stdlib; /* not of the source's own: looked for nowhere else */
    Module *module; /* never NULL after load_modules; an empty stand-in with `missing` set where the import failed
                       (reported) */
} Import;

struct Module {
    const char *name; /* file name without .salt */
    int32_t file;     /* index into Session.sources */
    Import *imports;
    uint32_t nimports;
    Symbol *consts, *params; /* in order of declaration */
    Func *funcs;
    Type **structs;
    uint32_t nstructs;
    StructDecl *struct_decls; /* as parsed, in order of declaration */
    TypedefDecl *typedefs;
    bool is_main, is_stdlib;
    bool glsl;             /* written in GLSL: glsl/glsl.h has what differs */
    bool missing;          /* stands for a module that could not be loaded: unknown names may come from it */
    const char *real_path; /* what identifies the module */
    uint32_t load_state;   /* parse/module.c's own */
    const char **lost;     /* names in what the parser skipped after syntax errors: not reported as unknown */
    uint32_t nlost;
    bool unusable; /* so broken that checking the rest would say nothing */
    Module *next;  /* every loaded module, in order of loading */
};

/* Overrides from the command line, applied while checking (values of `--set`; sizes of open arrays come from `--param
 * x=@file` too). */
typedef struct ConstOverride {
    const char *name; /* "N" or "module.N" */
    const char *text; /* a literal of the constant's type */
    bool used;
} ConstOverride;

/* Tells the dimensions of an asset before any value is read. Supplied by the caller, so that the compiler does not read
 * images. `of` is the parameter, with its type: of a texture dims are w, h, c (3D: w, h, d, c), of a geometry w, h, of
 * an array those of the table, outermost first. Returns false with *why set. */
typedef bool AssetProbe(void *user, const char *path, const Symbol *of, uint32_t dims[4], uint32_t *ndims,
                        const char **why);

/* A file from the command line in place of a parameter's own value (`--param discs=@values.csv`): gives open sizes and
 * those of textures. */
typedef struct ParamFile {
    const char *name; /* "discs" or "module.discs" */
    const char *path; /* as given, relative to the working folder */
    bool used;
} ParamFile;

/* Of the list under this name among values that the caller is going to set: how many elements it has, how many its
 * first one, and so on while these are lists, at most `most` sizes. Returns how many; 0: there is no such list. */
typedef uint32_t GivenSizes(void *user, const char *name, uint32_t most, uint64_t *sizes);

typedef struct FrontOptions {
    const char *entry; /* NULL: main, or the only one */
    ConstOverride *overrides;
    uint32_t noverrides;
    bool disc_auto; /* --disc=auto */
    AssetProbe *probe;
    GivenSizes *given; /* of open arrays and textures that no file gives; NULL: the source alone says it */
    void *probe_user;  /* of both */
    ParamFile *files;
    uint32_t nfiles;
    bool f64;         /* EPSILON is that of binary64 */
    bool glsl;        /* the main source is GLSL */
    uint32_t size[2]; /* of the image that a GLSL shader is for, in pixels; 0: GLSL_SIZE */
} FrontOptions;
enum { GLSL_SIZE = 512, GLSL_MAX_ITERS = 4096 };

/* parse/parse.c: every syntax error of a file is reported; never NULL; never crashes. Nesting deeper than 256 is an
 * error, and so is a chain (a + b + …, a.b.c…, else if …) that would make a tree deeper than 4096 expressions or 1024
 * statements. */
Module *parse_module(Session *s, int file, const char *name);
/* parse/attr.c: how attribute number i is written, "[Range(lo, hi)]", and its name; NULL behind the last. */
const char *attribute_usage(uint32_t i, const char **name);
/* parse/lex.c: keyword number i; NULL behind the last. */
const char *keyword_name(uint32_t i);
/* parse/module.c: parses `file` and all it imports (imports resolved beside the file, in -I folders, in the standard
 * library). Returns the main module, the head of the list by `next`; a module imported twice is one entry of `imports`.
 * Never NULL. */
Module *load_modules(Session *s, int file);
/* check/call.c: a builtin as it is called, and its signature in the letters of builtins.def. */
const char *builtin_name(Builtin b);
const char *builtin_signature(Builtin b);
/* check/check.c: types, names, constants, definite assignment, returns, recursion, loops, attributes of all modules.
 * Returns the entry shader, or NULL after reporting (also when the errors are elsewhere: look at s->nerrors). */
Func *check_program(Session *s, Module *main, const FrontOptions *opt);
/* type.c: every type but structs (the checker makes those, once each). Scalars (T_ERROR and T_VOID too), vectors,
 * matrices and resources are constants of the library and must not be written to; arrays are interned in the session.
 */
Type *type_scalar(TypeKind k); /* also T_TEXTURE, T_TEXTURE3D */
Type *type_geometry(SltGeometryKind k);
bool type_is_texture(const Type *t);  /* of two or three dimensions */
bool type_is_mesh(const Type *t);     /* a geometry whose numbers are positions of vertices */
bool type_is_resource(const Type *t); /* a texture or a geometry */
/* The type of a keyword ("float3", "void", "texture2D"), or NULL. */
Type *type_keyword(const char *name, size_t len);
Type *type_vector(Session *s, TypeKind elem, uint32_t n);
Type *type_matrix(Session *s, uint32_t rows, uint32_t columns);
Type *type_row(const Type *matrix); /* the vector that m[i] is */
Type *type_array(Session *s, Type *elem, uint32_t n);
bool type_is_float(const Type *t); /* float, its vectors and matrices */
/* Scalars in a value of this type, arrays and structs included; UINT32_MAX if it does not fit; 0 for what has none. */
uint32_t type_components(const Type *t);

#endif
