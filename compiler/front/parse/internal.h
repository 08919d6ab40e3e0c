/* The parser's own header, shared by parse.c (tokens, errors, recovery), expr.c, stmt.c, attr.c and decl.c.
 *
 * Recovery. The first error of a construct sets `panic`; while it is set nothing is reported and parse_expect consumes
 * nothing, so the functions of the descent simply return. Four places end the panic by skipping tokens: a parenthesised
 * header (to its `)`), a braced list (to its `}`), a statement (to `;`, `}` or a word that starts a statement on a new
 * line) and a declaration at file scope. A limit sets `stopped`: the token is then the end of the file for ever, and
 * nothing more is reported.
 *
 * Depth. `expr_nest` and `stmt_nest` bound the descent itself; Expr.depth and `stmt_depth` bound the height of the
 * tree, which chains built by loops would otherwise grow without limit. Everything that later walks the tree by
 * recursion relies on this. */
#ifndef SALTUS_FRONT_PARSE_INTERNAL_H
#define SALTUS_FRONT_PARSE_INTERNAL_H

#include "compiler/front/parse/lex.h"

enum {
    MAX_NEST = 256,        /* brackets, unary operators, nested statements */
    MAX_EXPR_DEPTH = 4096, /* Expr.depth */
    MAX_STMT_DEPTH = 1024, /* nested statements, counting every link of an `else if` chain */
    MAX_DIMS = 16,
    MAX_FILE_ERRORS = 1000
};

typedef Vec(Expr *) ExprVec;
typedef Vec(Stmt *) StmtVec;
typedef Vec(Symbol *) SymbolVec;

/* One attribute as written; attr.c gives it its meaning. */
typedef struct Attr {
    const char *name;
    Span span; /* of the name */
    Expr **args;
    uint32_t nargs;
} Attr;
typedef Vec(Attr) AttrVec;

typedef struct GlslUnit GlslUnit;

typedef struct Parser {
    Session *s;
    Lexer lx;
    Token tok;
    Module *module;
    uint32_t ntaken;   /* tokens taken: whether a step got on, which positions do not tell where macros were expanded */
    uint32_t prev_end; /* end of the token before `tok` */
    bool panic, stopped;
    bool to_file_scope;   /* with panic: a `}` is missing and `tok` begins a declaration of file scope; blocks end */
    bool unclosed;        /* the missing `}` was reported: a stray one at file scope follows from it */
    bool end_reported;    /* an error at the end of the file was: the others there follow from it */
    uint32_t first_error; /* s->nerrors when this file was begun */
    uint32_t expr_nest, stmt_nest, stmt_depth;
    uint64_t reserved_reported; /* a bit for each keyword that was reported as used for a name */
    StmtVec prints;             /* print and assert statements, in case the file declares functions of these names */
    Symbol **consts_end, **params_end;
    Func **funcs_end;
    StructDecl **structs_end;
    TypedefDecl **typedefs_end;
    bool glsl; /* what is being parsed is GLSL */
    GlslUnit *unit;
    Vec(Import) imports;
    Vec(Span) skipped; /* each from the line of an error to where its panic ended */
} Parser;

/* parse.c */
void parse_advance(Parser *p);
Token parse_peek(const Parser *p, uint32_t n); /* the n-th token after `tok`, n >= 1 */
bool parse_at(const Parser *p, TokenKind k);
bool parse_accept(Parser *p, TokenKind k);
/* Consumes a token of this kind, or reports "expected WHAT before FOUND" and panics. */
bool parse_expect(Parser *p, TokenKind k, const char *what);
/* A `)`, `]` or `}` that closes `open`: the error has a note there. */
bool parse_close(Parser *p, TokenKind k, const char *what, Span open);
/* A missing `;` is reported behind the previous token; parsing goes on without panic where a new line starts. */
void parse_semicolon(Parser *p, const char *after);
/* A name; reserved words are reported as such and serve as names. NULL after an error. */
const char *parse_name(Parser *p, const char *what, Span *span);
/* Reports and panics; returns the Diag for notes, or NULL where nothing is to be said (panic, stopped). */
Diag *parse_error(Parser *p, DiagCode code, Span span, const char *fmt, ...) __attribute__((format(printf, 4, 5)));
/* The same without a panic: what is wrong does not disturb the grammar. */
Diag *parse_complain(Parser *p, DiagCode code, Span span, const char *fmt, ...) __attribute__((format(printf, 4, 5)));
void parse_unexpected(Parser *p, const char *what);
/* A keyword stands where a value or a name should: says so once a file for each word. */
void parse_reserved(Parser *p, const Token *t);
/* Ends the parse of this file. */
void parse_stop(Parser *p);
/* Skips to the token that closes a bracket just opened, and past it; stops before `{`, `}` (and `;`, unless asked).
 * Ends the panic. */
void parse_skip_to_close(Parser *p, TokenKind close, bool past_semicolons);
Span parse_join(Span a, Span b);
Span parse_span_from(const Parser *p, Span first); /* from `first` to the last token consumed */

/* expr.c. All return an Expr, E_ERROR after an error. */
Expr *parse_expr(Parser *p);        /* with assignment, without comma */
Expr *parse_comma_expr(Parser *p);  /* with comma: statements and `for` */
Expr *parse_cond_expr(Parser *p);   /* without assignment: constants, labels, sizes */
Expr *parse_initialiser(Parser *p); /* an expression or a { list } */
/* After `(`: arguments and the `)`. Strings are allowed where asked. */
Expr **parse_arguments(Parser *p, Span open, bool strings, uint32_t *n);
Expr *parse_string(Parser *p);
int parse_precedence(const Token *t); /* of a binary operator, 1 the loosest; 0: it is none */

/* attr.c */
bool parse_attributes(Parser *p, AttrVec *out); /* [A, B(x)] [C] …; false when there are none */
void attrs_to_param(Parser *p, const AttrVec *attrs, ParamAttrs *out, bool field); /* or of a field of a struct */
void attrs_to_func(Parser *p, const AttrVec *attrs, Func *f);
void attrs_to_stmt(Parser *p, const AttrVec *attrs, StmtAttrs *out);
void attrs_none(Parser *p, const AttrVec *attrs, const char *what);

/* stmt.c */
Stmt *parse_block(Parser *p); /* at `{` */
Stmt *parse_statement(Parser *p);
/* `float f(float x) …`, told from `float3 c(1.0);` by what stands in the brackets. */
bool parse_at_function(const Parser *p);
/* At a `struct` or `typedef` where none may stand: skips it, body and all. */
void parse_skip_struct(Parser *p);

/* decl.c */
TypeRef *parse_type(Parser *p, const char *what);               /* name and [dims] before the declared name */
TypeRef *parse_declarator_dims(Parser *p, const TypeRef *base); /* [dims] behind it, joined with those of the type */
/* `static float x`, `uniform const int n`: says that the word means nothing here, and goes on behind it. */
void parse_skip_foreign_words(Parser *p);
void parse_file_scope(Parser *p);

#endif
