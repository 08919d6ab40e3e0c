/* Bytes to tokens: blanks, numbers, strings, words, punctuators. */
#include "compiler/front/parse/lex.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "compiler/base/base_internal.h"

static const char *const keyword_text[TOK_COUNT] = {
#define KEYWORD(id, text) [TOK_##id] = text,
    LEX_KEYWORDS(KEYWORD)
#undef KEYWORD
};

const char *keyword_name(uint32_t i) { return i < TOK_COUNT - TOK_IMPORT ? keyword_text[TOK_IMPORT + i] : NULL; }

static bool is_digit(char c) { return c >= '0' && c <= '9'; }
static bool is_letter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; }
static bool is_hex(char c) { return is_digit(c) || (c >= 'a' && c <= 'f') || (c >= 'A' && c <= 'F'); }

static Span span_at(const Lexer *lx, uint32_t pos, uint32_t len) { return (Span){lx->file, pos, len}; }

/* Text is built only when it is going to be seen. */
#define COMPLAIN(lx, code, span, ...)                                                                                  \
    do {                                                                                                               \
        if (!(lx)->quiet)                                                                                              \
            diag_emit((lx)->session, DIAG_##code, span, arena_printf(&(lx)->session->session, __VA_ARGS__));           \
    } while (0)

/* Bytes of so many that are ASCII, before the first that is not. */
static uint32_t ascii_run(const char *text, uint32_t len) {
    const uint64_t high = UINT64_C(0x8080808080808080);
    uint32_t n = 0;
    for (uint64_t eight; n + sizeof eight <= len; n += sizeof eight) {
        memcpy(&eight, text + n, sizeof eight);
        if (eight & high) break;
    }
    while (n < len && !(text[n] & 0x80)) n++;
    return n;
}

Lexer lex_start(Session *s, int file) {
    const Source *src = &s->sources[file];
    Lexer lx = {.session = s, .text = src->text, .file = file, .len = src->len};
    if (lx.len >= 2 && (!memcmp(lx.text, "\xFF\xFE", 2) || !memcmp(lx.text, "\xFE\xFF", 2))) {
        COMPLAIN(&lx, bad_encoding, span_at(&lx, 0, 2), "the source is UTF-16; it must be UTF-8");
        lx.len = 0;
        return lx;
    }
    if (lx.len >= 3 && !memcmp(lx.text, "\xEF\xBB\xBF", 3)) lx.pos = 3;
    for (uint32_t i = lx.pos; i < lx.len;) {
        i += ascii_run(lx.text + i, lx.len - i);
        if (i == lx.len) break;
        uint32_t code, n = utf8_decode(lx.text + i, lx.len - i, &code);
        if (code == 0xFFFD && n == 1 && !s->sources[file].glsl[0]) { /* GLSL's comments may hold any bytes */
            COMPLAIN(&lx, bad_encoding, span_at(&lx, i, 1), "byte 0x%02X is not UTF-8 here", (unsigned char)lx.text[i]);
            break;
        }
        i += n;
    }
    return lx;
}

/* The length of the line break that GLSL's `\` here joins to what stands behind it, in comments too. */
static uint32_t continued(const Lexer *lx) {
    const char *at = lx->text + lx->pos;
    if (!lx->glsl || at[0] != '\\') return 0;
    return at[1] == '\n' ? 1 : at[1] != '\r' ? 0 : at[2] == '\n' ? 2 : 1;
}

/* Skips blanks and comments; true if a line break was among them (or the file starts here). */
static bool skip_blanks(Lexer *lx) {
    bool new_line = lx->pos == 0 || (lx->pos == 3 && lx->text[0] == '\xEF');
    while (lx->pos < lx->len) {
        char c = lx->text[lx->pos];
        if (c == '\n' || c == '\r') new_line = true;
        if (c == ' ' || c == '\t' || c == '\n' || c == '\r' || c == '\f' || c == '\v') {
            lx->pos++;
        } else if (continued(lx)) {
            lx->pos += 1 + continued(lx);
        } else if (c == '/' && lx->text[lx->pos + 1] == '/') {
            const char *const text = lx->text;
            uint32_t pos = lx->pos;
            for (; pos < lx->len && text[pos] != '\n' && text[pos] != '\r'; pos++)
                if (text[pos] == '\\') lx->pos = pos, pos += continued(lx);
            lx->pos = pos;
        } else if (c == '/' && lx->text[lx->pos + 1] == '*') {
            uint32_t open = lx->pos;
            lx->pos += 2;
            while (lx->pos + 1 < lx->len && !(lx->text[lx->pos] == '*' && lx->text[lx->pos + 1] == '/')) {
                if (lx->text[lx->pos] == '\n' || lx->text[lx->pos] == '\r') new_line = true;
                lx->pos++;
            }
            if (lx->pos + 1 < lx->len) {
                lx->pos += 2;
            } else {
                lx->pos = lx->len;
                lx->cut = true;
                COMPLAIN(lx, unterminated, span_at(lx, open, 2), "this comment is never closed");
            }
        } else {
            break;
        }
    }
    return new_line;
}

/* ---- numbers ---- */

/* "1.0.0", "0x", "1e", "12ab": takes everything that a reader would take for one number. */
static uint32_t number_end(const Lexer *lx) {
    uint32_t i = lx->pos;
    bool hex = lx->text[i] == '0' && (lx->text[i + 1] | 32) == 'x';
    while (i < lx->len) {
        char c = lx->text[i];
        bool exponent_sign = (c == '+' || c == '-') && !hex && (lx->text[i - 1] | 32) == 'e';
        if (!is_digit(c) && !is_letter(c) && c != '.' && !(exponent_sign && i > lx->pos)) break;
        i++;
    }
    return i;
}

static void lex_integer(Lexer *lx, Token *t, const char *digits, uint32_t n, uint32_t base) {
    uint64_t value = 0;
    for (uint32_t i = 0; i < n && value <= UINT32_MAX; i++) {
        char c = digits[i];
        value = value * base + (uint32_t)(is_digit(c) ? c - '0' : (c | 32) - 'a' + 10);
    }
    if (value > UINT32_MAX) {
        COMPLAIN(lx, literal_range, t->span, "this integer does not fit in 32 bits");
        value = 1;
    }
    t->kind = TOK_INT;
    t->integer = (uint32_t)value;
}

static void lex_float(Lexer *lx, Token *t, const char *text, uint32_t n) {
    ArenaMark mark = arena_mark(&lx->session->scratch);
    const char *copy = arena_strndup(&lx->session->scratch, text, n);
    t->number = plain_strtod(copy, NULL);
    arena_reset(&lx->session->scratch, mark);
    t->kind = TOK_FLOAT;
    if (isinf(t->number)) {
        COMPLAIN(lx, literal_range, t->span, "this number is too large; `INFINITY` is infinite");
        t->number = 1.0;
    }
}

static void lex_number(Lexer *lx, Token *t) {
    uint32_t end = number_end(lx), n = end - lx->pos;
    const char *s = lx->text + lx->pos, *fault = NULL;
    t->span = span_at(lx, lx->pos, n);
    lx->pos = end;
    if (s[0] == '0' && n > 1 && (s[1] | 32) == 'x') {
        uint32_t i = 2;
        while (i < n && is_hex(s[i])) i++;
        if (i == 2) fault = "hexadecimal digits are missing after `0x`";
        else if (i == n || (i + 1 == n && (s[i] | 32) == 'u')) {
            t->is_unsigned = i < n;
            lex_integer(lx, t, s + 2, i - 2, 16);
            return;
        } else fault = "this is not a hexadecimal integer";
    } else {
        uint32_t i = 0, whole, fraction = 0;
        bool dot = false, exponent = false;
        while (i < n && is_digit(s[i])) i++;
        whole = i;
        if (i < n && s[i] == '.') {
            dot = true;
            i++;
            while (i < n && is_digit(s[i])) i++, fraction++;
        }
        if (i < n && (s[i] | 32) == 'e') {
            exponent = true;
            i++;
            if (i < n && (s[i] == '+' || s[i] == '-')) i++;
            uint32_t digits = i;
            while (i < n && is_digit(s[i])) i++;
            if (i == digits) fault = "digits are missing in the exponent";
        }
        uint32_t body = i;
        if (dot || exponent) {
            if (i < n && (s[i] | 32) == 'f') i++;
            if (!fault && i < n)
                fault = s[i] == '.' ? "a number has one point only"
                        : lx->glsl && (s[i] | 32) == 'l' && i + 2 == n
                            ? "there are no doubles: floats may end in `f` "
                              "(--precision f64 computes all in double)"
                            : "this suffix does not exist; floats may end in `f`";
            if (!fault) {
                lex_float(lx, t, s, body);
                return;
            }
        } else {
            if (i < n && (s[i] | 32) == 'u') t->is_unsigned = true, i++;
            if (i < n)
                fault = (s[i] | 32) == 'f' && i + 1 == n ? "an integer has no suffix `f`: write a point, as in `1.0f`"
                                                         : "this suffix does not exist; integers may end in `u`";
            else if (whole > 1 && s[0] == '0' && lx->glsl) {
                for (i = 1; i < whole; i++)
                    if (s[i] > '7') fault = "an integer that starts with 0 is octal, without 8 and 9";
                if (!fault) {
                    lex_integer(lx, t, s, whole, 8);
                    return;
                }
            } else if (whole > 1 && s[0] == '0')
                fault = "an integer does not start with 0 (there are no octal numbers)";
            else {
                lex_integer(lx, t, s, whole, 10);
                return;
            }
        }
    }
    COMPLAIN(lx, bad_literal, t->span, "%s", fault);
    *t = (Token){.kind = TOK_INT, .span = t->span, .first_on_line = t->first_on_line, .integer = 1};
}

/* ---- strings and characters that are no tokens ---- */

static void lex_string(Lexer *lx, Token *t) {
    uint32_t open = lx->pos, end = open + 1;
    bool closed = false;
    while (end < lx->len && lx->text[end] != '\n' && lx->text[end] != '\r') {
        if (lx->text[end] == '"') {
            closed = true;
            break;
        }
        end += lx->text[end] == '\\' && end + 1 < lx->len && lx->text[end + 1] != '\n' && lx->text[end + 1] != '\r' ? 2
                                                                                                                    : 1;
    }
    ArenaMark mark = arena_mark(&lx->session->scratch);
    char *buf = arena_alloc(&lx->session->scratch, end - open + 1);
    uint32_t n = 0;
    for (uint32_t i = open + 1; i < end; i++) {
        char c = lx->text[i];
        if (c == '\\' && i + 1 < end) {
            switch (lx->text[++i]) {
            case 'n': c = '\n'; break;
            case 't': c = '\t'; break;
            case '"': c = '"'; break;
            case '\\': c = '\\'; break;
            default:
                c = lx->text[i];
                COMPLAIN(lx, bad_literal, span_at(lx, i - 1, 2),
                         "this escape does not exist; there are \\n \\t \\\" \\\\");
            }
        } else if (c == 0) {
            COMPLAIN(lx, bad_literal, span_at(lx, i, 1), "a string cannot hold a NUL byte");
            c = ' ';
        }
        buf[n++] = c;
    }
    t->kind = TOK_STRING;
    t->span = span_at(lx, open, end + closed - open);
    t->text = intern(lx->session, buf, n);
    arena_reset(&lx->session->scratch, mark);
    lx->pos = end + closed;
    t->broken = !closed;
    if (!closed) COMPLAIN(lx, unterminated, span_at(lx, open, 1), "this string is not closed on its line");
}

/* What people paste: the character that was meant. */
static const char *meant(uint32_t code) {
    switch (code) {
    case 0x2212:
    case 0x2013:
    case 0x2014: return "; write `-`";
    case 0xD7:
    case 0x22C5:
    case 0xB7: return "; write `*`";
    case 0x2018:
    case 0x2019:
    case 0x201C:
    case 0x201D: return "; strings are in `\"`";
    case 0xA0:
    case 0x2003:
    case 0x2009: return "; it is a space that is not ASCII";
    case 0x37E:
    case 0xFF1B: return "; write `;`";
    case 0x2264: return "; write `<=`";
    case 0x2265: return "; write `>=`";
    case 0x3C0: return "; write `PI`";
    case '\'': return "; strings are in `\"`";
    case '@':
    case '$':
    case '`':
    case '\\': return "";
    default: return code >= 0x80 ? "; names are made of ASCII letters, digits and `_`" : "";
    }
}

/* One error for a run of bad characters, and none for bytes that lex_start already called no UTF-8. */
static void skip_bad(Lexer *lx) {
    uint32_t start = lx->pos, code, first;
    uint32_t n = utf8_decode(lx->text + start, lx->len - start, &first);
    if (first == '#') {
        while (lx->pos < lx->len && lx->text[lx->pos] != '\n' && lx->text[lx->pos] != '\r') lx->pos++;
        COMPLAIN(lx, bad_character, span_at(lx, start, 1), "there is no preprocessor: use `import` and `const`");
        return;
    }
    bool encoding = first == 0xFFFD && n == 1;
    lx->pos += n;
    while (lx->pos < lx->len) {
        unsigned char c = (unsigned char)lx->text[lx->pos];
        if (first >= 0x80 ? c < 0x80 && !is_letter((char)c) && !is_digit((char)c) : c != (unsigned char)first) break;
        lx->pos += c < 0x80 ? 1 : utf8_decode(lx->text + lx->pos, lx->len - lx->pos, &code);
    }
    if ((encoding && !lx->glsl) || lx->quiet) return;
    char shown[8] = "";
    if (!utf8_unprintable(first)) shown[utf8_encode(first, shown)] = 0;
    Span span = span_at(lx, start, lx->pos - start);
    if (shown[0]) COMPLAIN(lx, bad_character, span, "unexpected character `%s` (U+%04X)%s", shown, first, meant(first));
    else COMPLAIN(lx, bad_character, span, "unexpected character U+%04X%s", first, meant(first));
}

/* ---- tokens ---- */

typedef struct Punctuator {
    char text[4];
    TokenKind kind;
    Operator op;
} Punctuator;

/* Longer ones first. Behind OPERATORS of them those that begin none: every second token is one. */
enum { OPERATORS = 33 };
static const Punctuator punctuators[] = {{"<<=", TOK_ASSIGN, OPR_SHL}, {">>=", TOK_ASSIGN, OPR_SHR},
                                         {"<<", TOK_OP, OPR_SHL},      {">>", TOK_OP, OPR_SHR},
                                         {"==", TOK_OP, OPR_EQ},       {"!=", TOK_OP, OPR_NE},
                                         {"<=", TOK_OP, OPR_LE},       {">=", TOK_OP, OPR_GE},
                                         {"&&", TOK_OP, OPR_LAND},     {"||", TOK_OP, OPR_LOR},
                                         {"++", TOK_OP, OPR_INC},      {"--", TOK_OP, OPR_DEC},
                                         {"+=", TOK_ASSIGN, OPR_ADD},  {"-=", TOK_ASSIGN, OPR_SUB},
                                         {"*=", TOK_ASSIGN, OPR_MUL},  {"/=", TOK_ASSIGN, OPR_DIV},
                                         {"%=", TOK_ASSIGN, OPR_MOD},  {"&=", TOK_ASSIGN, OPR_AND},
                                         {"|=", TOK_ASSIGN, OPR_OR},   {"^=", TOK_ASSIGN, OPR_XOR},
                                         {"=", TOK_ASSIGN, OPR_NONE},  {"+", TOK_OP, OPR_ADD},
                                         {"-", TOK_OP, OPR_SUB},       {"*", TOK_OP, OPR_MUL},
                                         {"/", TOK_OP, OPR_DIV},       {"%", TOK_OP, OPR_MOD},
                                         {"&", TOK_OP, OPR_AND},       {"|", TOK_OP, OPR_OR},
                                         {"^", TOK_OP, OPR_XOR},       {"<", TOK_OP, OPR_LT},
                                         {">", TOK_OP, OPR_GT},        {"!", TOK_OP, OPR_NOT},
                                         {"~", TOK_OP, OPR_COMPL},     {"(", TOK_LPAREN, 0},
                                         {")", TOK_RPAREN, 0},         {"[", TOK_LBRACKET, 0},
                                         {"]", TOK_RBRACKET, 0},       {"{", TOK_LBRACE, 0},
                                         {"}", TOK_RBRACE, 0},         {",", TOK_COMMA, 0},
                                         {";", TOK_SEMICOLON, 0},      {":", TOK_COLON, 0},
                                         {"?", TOK_QUESTION, 0},       {".", TOK_DOT, 0}};

/* By its length and first letter, as most words are none. */
static bool may_be_keyword(const char *word, uint32_t n) {
#define LETTER(id, text) | 1u << (text[0] - 'a')
#define SHORTER(id, text) n == sizeof text - 1 ||
    const uint32_t first = 0 LEX_KEYWORDS(LETTER);
    return *word >= 'a' && *word <= 'z' && first >> (*word - 'a') & 1 && (LEX_KEYWORDS(SHORTER) false);
#undef LETTER
#undef SHORTER
}

static TokenKind keyword(const char *word, uint32_t n) {
    for (TokenKind k = TOK_IMPORT; k < TOK_COUNT; k++)
        if (keyword_text[k][0] == word[0] && strlen(keyword_text[k]) == n && !memcmp(keyword_text[k], word, n))
            return k;
    return TOK_IDENT;
}

static bool is_alone(char c) {
    switch (c) {
    case '(':
    case ')':
    case '[':
    case ']':
    case '{':
    case '}':
    case ',':
    case ';':
    case ':':
    case '?':
    case '.': return true;
    default: return false;
    }
}

static void lex_word(Lexer *lx, Token *t) {
    uint32_t start = lx->pos, end = start;
    while (end < lx->len && (is_letter(lx->text[end]) || is_digit(lx->text[end]))) end++;
    const char *word = lx->text + start;
    uint32_t n = end - start;
    lx->pos = end;
    t->span = span_at(lx, start, n);
    t->kind = may_be_keyword(word, n) ? keyword(word, n) : TOK_IDENT;
    if (t->kind == TOK_IDENT && n >= 3 && n <= 11 && type_keyword(word, n)) t->kind = TOK_TYPE;
    t->text = intern(lx->session, word, n);
}

Token lex_next(Lexer *lx) {
    Token t = {.kind = TOK_EOF};
    if (lx->tokens) return lx->tokens->kind == TOK_EOF ? *lx->tokens : *lx->tokens++;
    for (;;) {
        t.first_on_line |= skip_blanks(lx);
        t.span = span_at(lx, lx->pos, 0);
        if (lx->pos >= lx->len) return t;
        const char *at = lx->text + lx->pos;
        if (is_letter(*at)) {
            lex_word(lx, &t);
            return t;
        }
        if (is_digit(*at) || (*at == '.' && is_digit(at[1]))) {
            lex_number(lx, &t);
            return t;
        }
        if (*at == '"') {
            lex_string(lx, &t);
            return t;
        }
        if (lx->glsl && (*at == '#' || !strncmp(at, "^^", 2))) {
            t.kind = *at == '#' ? TOK_HASH : TOK_OP;
            t.op = *at == '#' ? OPR_NONE : OPR_NE; /* of bools, `^^` is `!=` */
            t.span.len = *at == '#' ? 1 : 2;
            lx->pos += t.span.len;
            return t;
        }
        const size_t all = sizeof punctuators / sizeof *punctuators;
        for (size_t i = is_alone(*at) ? OPERATORS : 0; i < all; i++) {
            const Punctuator *p = &punctuators[i];
            if (*at != p->text[0]) continue;
            uint32_t n = (uint32_t)strlen(p->text);
            if (strncmp(at, p->text, n) != 0) continue;
            t.kind = p->kind;
            t.op = p->op;
            t.span.len = n;
            lx->pos += n;
            return t;
        }
        skip_bad(lx);
    }
}

const char *lex_describe(Session *s, const Token *t) {
    if (t->kind == TOK_EOF) return "the end of the file";
    if (t->kind == TOK_STRING) return "a string";
    const char *text = s->sources[t->span.file].text + t->span.pos;
    uint32_t n = t->span.len < 40 ? t->span.len : 40;
    return arena_printf(&s->session, "`%.*s%s`", (int)n, text, n < t->span.len ? "…" : "");
}
