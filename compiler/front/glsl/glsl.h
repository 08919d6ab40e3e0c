/* GLSL as a dialect of the front end: fragment shaders and Shadertoy images as people have them.
 *
 *   preprocess.c   directives and macros: bytes to the tokens that remain
 *   words.c        GLSL's words become ours: vec3 is float3, qualifiers go, what is not accepted says so
 *   flatten.c      structs and blocks of uniforms are taken out of what declares them
 *   decl.c         declarations at file scope, array constructors: called by the parser
 *   walk.c         over what was parsed, with the names that are local at each place
 *   calls.c        builtin functions under GLSL's names
 *   globals.c      variables at file scope become hidden `inout` arguments
 *   complete.c     what the host of a shader declares for it, and the entry point
 *
 * The parser, the checker and gen are the same for both languages; what GLSL means otherwise they ask of
 * Module.glsl: matrices are stored by their columns where ours are stored by rows, so a product takes its operands
 * exchanged and everything else (constructors, indices) stays. */
#ifndef SALTUS_FRONT_GLSL_H
#define SALTUS_FRONT_GLSL_H

#include "compiler/front/names.h"
#include "compiler/front/parse/internal.h"

typedef Vec(Token) TokenVec;

/* What a file has beside functions, structs and parameters. */
struct GlslUnit {
    uint32_t size[2];  /* of the image, pixels */
    NameMap words;     /* every name in the source */
    SymbolVec globals; /* variables and constants, in order; `init` may be NULL */
    SymbolVec inputs;  /* `in`, `varying` */
    SymbolVec outputs; /* `out` */
};

/* The tokens of a source behind its preprocessor, TOK_EOF last. Reports what it does not understand. */
TokenVec glsl_preprocess(Session *s, int file);
/* In place: types, qualifiers, words that are ours and not GLSL's. */
void glsl_words(Session *s, TokenVec *tokens, NameMap *words);
/* Structs where the language has them, blocks of uniforms as uniforms. */
void glsl_flatten(Session *s, TokenVec *tokens);

/* decl.c. At file scope: a declaration that is no function and no struct; false: it is one. */
bool glsl_declaration(Parser *p);
/* At `T[n](`: an array's constructor, which becomes a list. */
bool glsl_at_array(const Parser *p);
Expr *glsl_array(Parser *p);
/* `T a[] = T[](…)`: the list gives the size. */
void glsl_size_open(Parser *p, Symbol *sym);
/* `a.length()`, parsed as a method: `len(a)`. */
void glsl_length(Parser *p, Expr *e);
/* At `discard`: remembers it and leaves the function. */
Stmt *glsl_discard(Parser *p);

/* visit for every expression of a function, before its parts. */
typedef struct GlslWalk GlslWalk;
struct GlslWalk {
    Parser *p;
    Func *func;
    Vec(const char *) locals;
    void (*visit)(GlslWalk *w, Expr *e);
    void *user;
};
void glsl_walk(GlslWalk *w, Func *f);
void glsl_walk_expr(GlslWalk *w, Expr *e);
bool glsl_is_local(const GlslWalk *w, const char *name);

void glsl_rename_calls(Parser *p);
/* GLSL's name of one of ours, of n bytes, in messages; NULL: it is the same. */
const char *glsl_function_behind(const char *ours, size_t n);
/* A builtin function of GLSL that is none of the language, and so not folded in constants. */
bool glsl_is_function_of_module(const char *name);
/* Gives unit->globals that nothing changes and whose value is constant to the module's constants; the others become
 * variables of `entry` and arguments of the functions that use them, through calls. */
void glsl_find_constants(Parser *p);
void glsl_pass_globals(Parser *p, Func *entry);
/* Behind the parser: adds what is missing, and the entry `image` over [0, width] x [0, height], to the module. */
void glsl_complete(Parser *p);

#endif
