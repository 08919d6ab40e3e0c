/* The checker's insides: nobody else includes this.
 *
 * check.c   the program: module tables, functions, call graph, entry points
 * type.c    names of types, array sizes, conversions
 * expr.c    names, operators, fields, assignment
 * call.c    overloads, builtins, methods, constructors, lists
 * const.c   compile-time values
 * param.c   `const` and `param` at file scope: values, assets, attributes
 * stmt.c    statements, scopes, attributes of statements
 * loop.c    trip counts
 * flow.c    definite assignment and returns
 * disc.c    what [Disc] covers
 *
 * The tree is rewritten in place. A declaration at file scope is checked when it is first needed, once, so every module
 * is linear in its size and order of declaration does not matter. T_ERROR absorbs: whatever has it was reported
 * already. */
#ifndef SALTUS_FRONT_CHECK_INTERNAL_H
#define SALTUS_FRONT_CHECK_INTERNAL_H

#include "compiler/front/ast.h"
#include "compiler/front/names.h"

/* ---- file scope */
typedef enum DeclKind { DECL_ERROR, DECL_CONST, DECL_PARAM, DECL_FUNC, DECL_STRUCT, DECL_TYPEDEF } DeclKind;
typedef struct Decl {
    DeclKind kind;
    const char *name;
    Span span;
    Module *module;
    Symbol *sym;
    Func **funcs; /* the overload set */
    uint32_t nfuncs, cap_funcs;
    StructDecl *structure;
    TypedefDecl *type_def;
} Decl;

typedef struct ModuleScope {
    Module *module;
    NameMap names;                /* -> Decl */
    struct ModuleScope **imports; /* without duplicates */
    uint32_t nimports;
    bool incomplete; /* an import was not found: an unknown name may be from there */
} ModuleScope;

/* ---- functions */
typedef struct CallEdge {
    Func *callee;
    Span span;
} CallEdge;
typedef struct CullLoop {
    Stmt *loop;
    Func *func;
} CullLoop;

/* Facts about one function, found at info[func->check_state - 1]. */
typedef struct FuncInfo {
    Func *func;
    ModuleScope *scope;
    Vec(CallEdge) calls;
    Span rand_span; /* first direct call of rand(); file < 0: none */
    Span cull_span; /* first [Cull] in the function or in what it calls */
    uint8_t color;  /* call graph: 0 new, 1 on the stack, 2 done */
    bool signature_ok, duplicate;
    uint8_t jumps;        /* disc.c's own */
    bool looked_for_site; /* first_site is known */
    Expr *first_site;     /* the first jump written in the body, for notes; NULL: none */
} FuncInfo;

typedef struct Binding {
    const char *name;
    Symbol *sym;
    uint32_t depth;
    struct Binding *hidden; /* the binding of the same name further out */
    struct Binding *below;  /* next in the stack of bindings */
} Binding;

/* What changes when checking moves to another declaration; saved and restored as one. */
typedef struct Context {
    ModuleScope *scope;
    FuncInfo *func; /* NULL at file scope */
    NameMap locals; /* -> Binding */
    Binding *stack;
    uint32_t depth;           /* of block scopes */
    uint32_t loops, switches; /* nesting */
} Context;

typedef struct Checker {
    Session *s;
    Arena *arena;
    const FrontOptions *opt;
    Module *main;
    ModuleScope *scopes;
    uint32_t nscopes;
    FuncInfo *info;
    uint32_t ninfo;
    Context at;
    uint32_t depth;        /* of all recursion over expressions and declarations together */
    NameMap builtin_types; /* -> Type */
    NameMap builtin_funcs; /* -> (void *)(uintptr_t)Builtin */
    const char *name_len, *name_pi, *name_tau, *name_infinity, *name_epsilon;
    Type *t_error, *t_void, *t_bool, *t_int, *t_uint, *t_float, *t_hit, *t_silhouette, *t_mesh_hit, *t_beam, *t_piece,
        *t_area_light;
    Decl poison; /* what a name stands for after its error was reported */
    Vec(CullLoop) culls;
} Checker;

#define CHECK_MAX_DEPTH 6000       /* nested expressions and declarations; the parser allows 4096 in one expression */
#define CHECK_MAX_ARRAY (1u << 28) /* scalars in an array of any kind */
#define CHECK_MAX_CONST (1u << 22) /* scalars in an array whose values are expressions: a constant, a list, a zero */
#define CHECK_MAX_LOCAL (1u << 16) /* scalars in a local array: it lives in every lane */
#define CHECK_MAX_TRIPS ((int64_t)1 << 24)   /* iterations of a loop */
#define CHECK_MAX_TEXELS ((uint64_t)1 << 28) /* numbers in a texture or geometry */

/* check.c */
/* The module's own name, else an imported one; NULL: none. Ambiguity is reported and gives &c->poison. */
Decl *scope_find(Checker *c, const char *name, Span use);
bool name_lost(const Checker *c, const char *name); /* does the name stand in what the parser skipped? */
ModuleScope *scope_of(Checker *c, const Module *m);
FuncInfo *func_info(Checker *c, const Func *f);
bool in_glsl(const Checker *c);                                        /* what is being checked is written in GLSL */
Context context_enter(Checker *c, ModuleScope *scope, FuncInfo *func); /* returns the old one */
void context_leave(Checker *c, Context old);
const char *suggest(Checker *c, const char *name, bool types_only); /* ", did you mean `x`?" or "" */
const char *decl_what(const Decl *d);
void func_signature(Checker *c, Func *f);         /* resolves argument and result types, once */
const char *func_text(Checker *c, const Func *f); /* "float f(float2, out int)" */
void enter_depth(Checker *c);

/* type.c */
Type *resolve_type(Checker *c, TypeRef *ref, bool allow_open, uint32_t limit);
TypeKind scalar_kind(const Type *t); /* of scalars, vectors, matrices; else T_ERROR */
uint32_t width_of(const Type *t);    /* 1 for scalars, n for vectors, 0 for the rest */
bool is_scalar(const Type *t);
bool is_numeric(const Type *t);   /* scalar or vector, not bool */
bool is_aggregate(const Type *t); /* struct or array */
bool is_place(Expr *e);
Symbol *place_root(Expr *e); /* the variable a place belongs to, or NULL */
Type *with_width(Checker *c, TypeKind kind, uint32_t width);
Type *unify(Checker *c, Type *a, Type *b); /* the common type of two operands, or NULL */
enum { CONV_BROADCAST = 1, CONV_NARROW = 2 };
int conversion_cost(Expr *e, const Type *to, unsigned flags); /* 0 none needed, 1, or -1 impossible */
/* e as a node of type `to`; reports where that cannot be, and returns one of T_ERROR. */
Expr *convert(Checker *c, Expr *e, Type *to, unsigned flags);
Expr *convert_scalar_kind(Checker *c, Expr *e, TypeKind kind, bool explicit_cast);
/* Of a name that nothing declares: a type of the language whose name is no keyword; NULL. */
Type *soft_type(Checker *c, const char *name);
bool is_texture_result(const Expr *e);
Expr *new_expr(Checker *c, ExprKind kind, const Expr *at, Type *type);
Expr *fail(Checker *c, Expr *e); /* marks e as T_ERROR */

/* expr.c */
Expr *check_expr(Checker *c, Expr *e);
Expr *check_value(Checker *c, Expr *e);            /* not void, not a resource */
Expr *check_init(Checker *c, Expr *e, Type *type); /* value or list, converted as an initialiser */
Expr *check_condition(Checker *c, Expr *e, const char *what);
Expr *check_binary_typed(Checker *c, Expr *e); /* operands checked */

/* call.c */
Expr *check_call(Checker *c, Expr *e);
Expr *check_construct(Checker *c, Expr *e, Type *type); /* args not yet checked */
Expr *check_method(Checker *c, Expr *e);
Expr *check_list(Checker *c, Expr *e, Type *type);
Expr *check_zero(Checker *c, Span at, Type *t); /* the zero of any type, for `(Disc)0` */
const char *types_text(Checker *c, Expr **args, uint32_t n);

/* const.c */
void const_fold(Checker *c, Expr *e); /* sets is_const and cval where the operands are constant */
Expr *const_list(Expr *e);            /* the E_LIST behind a constant of array or struct type, or NULL */
/* A checked expression as an integer constant; false after reporting that it is none. */
bool const_int(Checker *c, Expr *e, const char *what, int64_t *out);
int64_t const_wrap(TypeKind k, int64_t v); /* to the 32 bits of int or uint */

/* param.c */
void check_const_decl(Checker *c, Symbol *sym, ModuleScope *scope);
void check_param_decl(Checker *c, Symbol *sym, ModuleScope *scope);
void check_field_attrs(Checker *c, ParamAttrs *a, const Type *t, Span at); /* of a field of type t */

/* vertex.c */
void check_vertex(Checker *c, Symbol *sym); /* of a mesh with [Vertex] */

/* stmt.c */
void check_body(Checker *c, Func *f);
/* f for every node, children first, in order of evaluation; of a statement, for those of nested ones too. */
void visit_expr(Expr *e, void (*f)(Expr *, void *), void *user);
void visit_stmt(Stmt *s, void (*f)(Expr *, void *), void *user);

/* loop.c, flow.c, disc.c: passes over a typed body */
void check_loops(Checker *c, Func *f);
void check_flow(Checker *c, Func *f);
void check_discs(Checker *c, Func *f);

#endif
