/* The lexer: bytes to tokens, one at a time.
 *
 * A Lexer is a position and may be copied to look ahead; `quiet` copies report nothing (the same text is lexed again
 * when it is consumed). Errors are reported here and never end the stream: a bad character is skipped, a bad literal
 * becomes a literal of value 1 (so that nothing else is said about it), and after an unterminated comment the file
 * ends. */
#ifndef SALTUS_FRONT_PARSE_LEX_H
#define SALTUS_FRONT_PARSE_LEX_H

#include "compiler/front/ast.h"

/* KEYWORD(id, "text") */
#define LEX_KEYWORDS(KEYWORD)                                                                                          \
    KEYWORD(IMPORT, "import")                                                                                          \
    KEYWORD(CONST, "const") KEYWORD(PARAM, "param") KEYWORD(STRUCT, "struct") KEYWORD(TYPEDEF, "typedef")              \
        KEYWORD(SHADER, "shader") KEYWORD(IN, "in") KEYWORD(OUT, "out") KEYWORD(INOUT, "inout") KEYWORD(IF, "if")      \
            KEYWORD(ELSE, "else") KEYWORD(FOR, "for") KEYWORD(WHILE, "while") KEYWORD(DO, "do")                        \
                KEYWORD(SWITCH, "switch") KEYWORD(CASE, "case") KEYWORD(DEFAULT, "default") KEYWORD(BREAK, "break")    \
                    KEYWORD(CONTINUE, "continue") KEYWORD(RETURN, "return") KEYWORD(TRUE, "true")                      \
                        KEYWORD(FALSE, "false")

typedef enum TokenKind {
    TOK_EOF,
    TOK_IDENT,  /* text */
    TOK_TYPE,   /* text: float3, void, texture2D … */
    TOK_INT,    /* integer, is_unsigned */
    TOK_FLOAT,  /* number */
    TOK_STRING, /* text: escapes decoded */
    TOK_LPAREN,
    TOK_RPAREN,
    TOK_LBRACKET,
    TOK_RBRACKET,
    TOK_LBRACE,
    TOK_RBRACE,
    TOK_COMMA,
    TOK_SEMICOLON,
    TOK_COLON,
    TOK_QUESTION,
    TOK_DOT,
    TOK_OP,     /* op: + - * / % & | ^ << >> == != < <= > >= && || ! ~ ++ -- */
    TOK_ASSIGN, /* op: OPR_NONE for =, OPR_ADD for += … */
    TOK_HASH,   /* `#`: the preprocessor's, in GLSL only */
#define KEYWORD(id, text) TOK_##id,
    LEX_KEYWORDS(KEYWORD)
#undef KEYWORD
        TOK_COUNT
} TokenKind;

typedef struct Token {
    TokenKind kind;
    Span span;
    bool first_on_line;
    bool is_unsigned;
    bool broken; /* a string without its end: what follows was meant to be inside */
    Operator op;
    uint32_t integer;
    double number;
    const char *text; /* interned */
} Token;

typedef struct Lexer {
    Session *session;
    const char *text;
    int32_t file;
    uint32_t pos, len;
    bool quiet;
    bool glsl;           /* `#`, `^^` and continued lines are tokens and blanks */
    bool cut;            /* an unterminated comment took the rest of the file */
    const Token *tokens; /* not NULL: handed out instead of the text; the last is TOK_EOF */
} Lexer;

/* Starts at the beginning of a source: skips a byte order mark, reports bytes that are not UTF-8 (the first such
 * place). */
Lexer lex_start(Session *s, int file);
Token lex_next(Lexer *lx);
/* "`;`", "`float3`", "end of file" … for messages: a short arena string. */
const char *lex_describe(Session *s, const Token *t);

#endif
