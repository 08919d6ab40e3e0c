/* The formatter: where lines begin, and the blanks inside them. Tokens, comments and the breaks between lines stay as
 * they are, but for blank lines beyond two.
 *
 * A statement on a line of its own is indented by four columns a level. Lines that go on with one keep their distance
 * from its first line. A comment of its own line stands where what follows it stands; one that lines up with a comment
 * at the end of the line above stays with that. */
#include <stdlib.h>
#include <string.h>

#include "cli/lsp/lsp.h"
#include "compiler/front/parse/lex.h"
#include "runtime/base/text.h"

enum { STEP = 4, MOST_BLANK = 2, MOST_DEPTH = 256 };

typedef enum Role { ROLE_INSIDE, ROLE_BEGINS, ROLE_CLOSES, ROLE_GOES_ON } Role;

typedef struct Item { /* a token or a comment */
    uint32_t pos, len;
    bool comment, attribute; /* attribute: in the brackets of one, or one of them */
    Token tok;
    uint32_t breaks; /* lines that end between the item before and this */
    uint32_t blanks; /* columns between them, if none */
    uint32_t column; /* if it is the first of its line */
    Role role;
    uint32_t indent; /* ROLE_BEGINS, ROLE_CLOSES */
    uint32_t line;   /* ROLE_GOES_ON: first item of the line where its statement begins */
    uint32_t new_column;
    bool unary;
    bool begins; /* a statement */
    bool block;  /* a brace of one, not of a list */
    bool choice; /* the colon of one `?` */
    char sign;   /* `+` and `-`, of the steps too; else 0 */
} Item;

typedef struct Format {
    Session *s;
    const Source *src;
    Vec(Item) items;
    Vec(uint32_t) tokens; /* indices of items */
    uint32_t at, line, depth;
} Format;

/* ---- items */

static void add_gap(Format *f, uint32_t from, uint32_t to, Item *next) {
    const char *text = f->src->text;
    Item item = {0};
    uint32_t column = 0;
    for (uint32_t at = from; at <= to; at++) {
        bool comment = at + 1 < to && text[at] == '/' && (text[at + 1] == '/' || text[at + 1] == '*');
        if (at == to || comment) {
            item.pos = at, item.column = item.blanks = column;
            if (at == to) {
                next->breaks = item.breaks, next->column = next->blanks = column;
                return;
            }
            bool block = text[at + 1] == '*';
            uint32_t end = at + 2;
            while (end < to &&
                   (block ? text[end - 1] != '/' || text[end - 2] != '*' || end < at + 4 : text[end] != '\n'))
                end++;
            item.len = end - at, item.comment = true;
            while (
                !block && item.len &&
                (text[at + item.len - 1] == ' ' || text[at + item.len - 1] == '\t' || text[at + item.len - 1] == '\r'))
                item.len--;
            vec_push(&f->s->session, &f->items, item);
            item = (Item){0};
            column = 0;
            at = end - 1;
            continue;
        }
        if (text[at] == '\n') item.breaks++, column = 0;
        else if (text[at] == '\t') column += STEP - column % STEP;
        else if (text[at] != '\r') column++;
    }
}

static void read_items(Format *f, int file) {
    Lexer lx = lex_start(f->s, file);
    lx.quiet = true;
    uint32_t end = lx.pos;
    for (;;) {
        Token t = lex_next(&lx);
        Item item = {.pos = t.span.pos, .len = t.span.len, .tok = t};
        if (t.kind == TOK_EOF) item.pos = f->src->len, item.len = 0;
        add_gap(f, end, item.pos, &item);
        if (!f->items.len) item.breaks = 1;
        vec_push(&f->s->session, &f->tokens, f->items.len);
        vec_push(&f->s->session, &f->items, item);
        end = item.pos + item.len;
        if (t.kind == TOK_EOF) break;
    }
    f->items.data[0].breaks = 1;
}

/* ---- statements */

static Item *here(Format *f) { return &f->items.data[f->tokens.data[f->at]]; }
static TokenKind kind(Format *f) { return here(f)->tok.kind; }
static bool is_first(Format *f) { return here(f)->breaks > 0; }

static uint32_t line_of(const Format *f, uint32_t item) {
    while (item && !f->items.data[item].breaks) item--;
    return item;
}

/* The token at hand goes on with its statement. */
static void go_on(Format *f) {
    Item *i = here(f);
    i->role = i->breaks ? ROLE_GOES_ON : ROLE_INSIDE;
    i->line = f->line;
    if (kind(f) != TOK_EOF) f->at++;
}

static void begin(Format *f, uint32_t indent, Role role) {
    Item *i = here(f);
    i->begins = true;
    if (i->breaks) i->role = role, i->indent = indent;
    f->line = line_of(f, f->tokens.data[f->at]);
}

/* From an opening bracket past the one that closes it. */
static void group(Format *f, bool attribute) {
    uint32_t depth = 0;
    do {
        TokenKind k = kind(f);
        if (k == TOK_LPAREN || k == TOK_LBRACKET || k == TOK_LBRACE) depth++;
        if (k == TOK_RPAREN || k == TOK_RBRACKET || k == TOK_RBRACE) depth--;
        here(f)->attribute |= attribute;
        go_on(f);
    } while (depth && kind(f) != TOK_EOF);
}

static void statement(Format *f, uint32_t indent);

static void block(Format *f, uint32_t indent, bool cases) {
    uint32_t line = f->line;
    here(f)->block = true;
    f->at++;
    while (kind(f) != TOK_RBRACE && kind(f) != TOK_EOF) {
        bool label = kind(f) == TOK_CASE || kind(f) == TOK_DEFAULT;
        /* what stands behind a label on its line is indented as the label is */
        statement(f, cases && (label || !is_first(f)) ? indent : indent + STEP);
    }
    f->line = line;
    if (kind(f) == TOK_EOF) return;
    begin(f, indent, ROLE_CLOSES);
    here(f)->block = true;
    f->at++;
    f->line = line;
}

/* What a header governs. */
static void governed(Format *f, uint32_t indent, bool cases) {
    if (kind(f) == TOK_LBRACE) {
        if (is_first(f)) begin(f, indent, ROLE_BEGINS);
        block(f, indent, cases);
    } else {
        statement(f, is_first(f) ? indent + STEP : indent);
    }
}

static void simple(Format *f, uint32_t indent) {
    uint32_t depth = 0;
    bool structure = kind(f) == TOK_STRUCT;
    TokenKind before = TOK_EOF;
    for (;;) {
        TokenKind k = kind(f);
        if (k == TOK_EOF || (k == TOK_RBRACE && !depth)) return;
        if (k == TOK_LBRACE && !depth && (before == TOK_RPAREN || structure)) {
            if (is_first(f)) begin(f, indent, ROLE_BEGINS);
            block(f, indent, false);
            if (!structure) return;
            before = TOK_RBRACE;
            continue;
        }
        if (k == TOK_LPAREN || k == TOK_LBRACKET || k == TOK_LBRACE) depth++;
        if ((k == TOK_RPAREN || k == TOK_RBRACKET || k == TOK_RBRACE) && depth) depth--;
        before = k;
        Role role = here(f)->role;
        uint32_t at = f->at;
        go_on(f);
        if (role == ROLE_BEGINS) f->items.data[f->tokens.data[at]].role = role;
        if (k == TOK_SEMICOLON && !depth) return;
    }
}

/* The token at hand, which begins something. */
static void take(Format *f) {
    if (kind(f) != TOK_EOF) f->at++;
}

static void statement(Format *f, uint32_t indent) {
    if (++f->depth > MOST_DEPTH) session_limit(f->s, "statements nest deeper than %d", MOST_DEPTH);
    begin(f, indent, ROLE_BEGINS);
    while (kind(f) == TOK_LBRACKET) {
        here(f)->attribute = true;
        Role role = here(f)->role;
        uint32_t at = f->at;
        group(f, true);
        f->items.data[f->tokens.data[at]].role = role;
        begin(f, indent, ROLE_BEGINS);
    }
    switch (kind(f)) {
    case TOK_LBRACE: block(f, indent, false); break;
    case TOK_IF:
        take(f);
        if (kind(f) == TOK_LPAREN) group(f, false);
        governed(f, indent, false);
        while (kind(f) == TOK_ELSE) {
            begin(f, indent, ROLE_BEGINS);
            take(f);
            governed(f, indent, false);
        }
        break;
    case TOK_FOR:
    case TOK_WHILE:
    case TOK_SWITCH: {
        bool cases = kind(f) == TOK_SWITCH;
        take(f);
        if (kind(f) == TOK_LPAREN) group(f, false);
        governed(f, indent, cases);
        break;
    }
    case TOK_DO:
        take(f);
        governed(f, indent, false);
        if (kind(f) == TOK_WHILE) {
            begin(f, indent, ROLE_BEGINS);
            take(f);
            simple(f, indent);
        }
        break;
    case TOK_CASE:
    case TOK_DEFAULT:
        take(f);
        while (kind(f) != TOK_COLON && kind(f) != TOK_EOF && kind(f) != TOK_RBRACE) go_on(f);
        if (kind(f) == TOK_COLON) go_on(f);
        break;
    default: simple(f, indent);
    }
    f->depth--;
}

/* ---- columns */

static void place_comments(Format *f) {
    for (uint32_t i = f->items.len; i-- > 0;) {
        Item *c = &f->items.data[i];
        if (!c->comment || !c->breaks || i + 1 >= f->items.len) continue;
        uint32_t n = i + 1;
        while (f->items.data[n].comment && n + 1 < f->items.len) n++;
        const Item *next = &f->items.data[n];
        c->role = next->breaks || next->tok.kind == TOK_EOF ? next->role : ROLE_GOES_ON;
        c->indent = next->indent + (next->role == ROLE_CLOSES ? STEP : 0);
        c->line = next->line;
        if (c->role == ROLE_CLOSES) c->role = ROLE_BEGINS;
        if (next->tok.kind == TOK_EOF) c->role = ROLE_BEGINS, c->indent = 0;
    }
}

static bool closes(const Item *i) {
    return !i->comment && (i->tok.kind == TOK_RPAREN || i->tok.kind == TOK_RBRACKET || i->tok.kind == TOK_RBRACE);
}

static uint32_t new_column(const Format *f, const Item *i) {
    if (i->role != ROLE_GOES_ON) return i->indent;
    const Item *first = &f->items.data[i->line];
    int64_t off = (int64_t)i->column - first->column;
    if (off <= 0) off = closes(i) ? 0 : STEP;
    return first->new_column + (uint32_t)off;
}

/* ---- blanks inside a line */

static bool ends_operand(const Item *i) {
    TokenKind k = i->tok.kind;
    return k == TOK_IDENT || k == TOK_TYPE || k == TOK_INT || k == TOK_FLOAT || k == TOK_STRING || k == TOK_RPAREN ||
           (k == TOK_RBRACKET && !i->attribute) || k == TOK_TRUE || k == TOK_FALSE;
}

static bool is_step(const Item *i) { return i->tok.kind == TOK_OP && (i->tok.op == OPR_INC || i->tok.op == OPR_DEC); }

static void find_unary(Format *f) {
    uint32_t choices = 0;
    for (uint32_t t = 0; t < f->tokens.len; t++) {
        Item *i = &f->items.data[f->tokens.data[t]], *before = t ? &f->items.data[f->tokens.data[t - 1]] : NULL;
        bool operand = before && !i->begins && (ends_operand(before) || (is_step(before) && !before->unary));
        /* unary of ++ and --: it stands before its place */
        i->unary = i->tok.kind == TOK_OP && !operand;
        const char c = f->src->text[i->pos];
        i->sign = i->tok.kind == TOK_OP && (c == '+' || c == '-') ? c : 0;
        if (i->tok.kind == TOK_QUESTION) choices++;
        if (i->tok.kind == TOK_SEMICOLON) choices = 0;
        if (i->tok.kind == TOK_COLON && choices) choices--, i->choice = true;
        /* a cast: `(float)-x` */
        if (t >= 3 && before->tok.kind == TOK_RPAREN && f->items.data[f->tokens.data[t - 2]].tok.kind == TOK_TYPE &&
            f->items.data[f->tokens.data[t - 3]].tok.kind == TOK_LPAREN && i->tok.kind == TOK_OP)
            i->unary = true;
    }
}

static uint32_t kept(const Item *i) { return i->blanks > 1 ? 1 : i->blanks; }

static uint32_t blanks(const Item *p, const Item *i) {
    TokenKind a = p->tok.kind, b = i->tok.kind;
    if (b == TOK_SEMICOLON || b == TOK_COMMA || b == TOK_DOT || a == TOK_DOT) return 0;
    if (b == TOK_RPAREN || b == TOK_RBRACKET || a == TOK_LPAREN || a == TOK_LBRACKET) return 0;
    if (a == TOK_COMMA || a == TOK_SEMICOLON) return 1;
    if (a == TOK_LBRACE && b == TOK_RBRACE) return kept(i);
    if (a == TOK_LBRACE || b == TOK_RBRACE) return (a == TOK_LBRACE ? p : i)->block ? 1 : kept(i);
    if (b == TOK_LBRACE || a == TOK_RBRACE) return 1;
    if (a == TOK_RBRACKET && p->attribute) return 1;
    if (b == TOK_LBRACKET) return i->attribute ? 1 : 0;
    if (p->unary) return p->sign && p->sign == i->sign; /* `- -x` is no step */
    if (is_step(i) && !i->unary) return 0;
    if (a == TOK_OP || b == TOK_OP || a == TOK_ASSIGN || b == TOK_ASSIGN || a == TOK_QUESTION || b == TOK_QUESTION)
        return is_step(p) && b == TOK_LPAREN ? 0 : 1;
    if (b == TOK_COLON) return i->choice ? 1 : kept(i);
    if (b == TOK_LPAREN)
        return a == TOK_IDENT || a == TOK_TYPE ? 0 : a == TOK_RPAREN || a == TOK_RBRACKET ? kept(i) : 1;
    if (a == TOK_RPAREN) return i->begins ? 1 : kept(i); /* else it may be a cast */
    return 1;
}

/* ---- the text */

static void put_columns(FILE *out, uint32_t n) { fprintf(out, "%*s", (int)n, ""); }

static char *write_out(Format *f) {
    const char *text = f->src->text, *first = memchr(text, '\n', f->src->len);
    const char *line_end = first && first > text && first[-1] == '\r' ? "\r\n" : "\n";
    Text made;
    FILE *out = text_open(&made);
    if (!out) return NULL;
    const Item *trailing = NULL; /* the last comment behind something on its line, or lined up with one */
    if (f->items.data[0].pos >= 3 && !memcmp(text, "\xEF\xBB\xBF", 3)) fwrite(text, 1, 3, out);
    uint32_t column = 0;
    for (uint32_t k = 0; k < f->items.len; k++) {
        Item *i = &f->items.data[k];
        const Item *p = k ? i - 1 : NULL;
        if (!i->len) break; /* the end */
        if (i->breaks) {
            uint32_t breaks = !k ? 0 : i->breaks > 1 + MOST_BLANK ? 1 + MOST_BLANK : i->breaks;
            for (uint32_t b = 0; b < breaks; b++) fputs(line_end, out);
            i->new_column = new_column(f, i);
            if (i->comment && trailing && i->breaks == 1 && i->column == trailing->column && i->column > i->new_column)
                i->new_column = trailing->new_column;
            else trailing = NULL;
            if (i->comment && trailing) trailing = i;
            put_columns(out, i->new_column);
            column = i->new_column;
        } else {
            uint32_t n = i->comment || p->comment ? (i->blanks ? i->blanks : 1) : blanks(p, i);
            if (p->comment && n > 1) n = 1;
            put_columns(out, n);
            column += n;
            i->new_column = column;
        }
        fwrite(text + i->pos, 1, i->len, out);
        column += i->len;
        if (i->comment && !i->breaks) {
            /* its column as it was */
            uint32_t start = i->pos;
            while (start && text[start - 1] != '\n') start--;
            i->column = 0;
            for (uint32_t at = start; at < i->pos; at++) i->column += text[at] == '\t' ? STEP - i->column % STEP : 1;
            trailing = i;
        }
    }
    if (f->items.len > 1) fputs(line_end, out);
    return text_close(&made);
}

/* The same tokens, in the same order? */
static bool same_tokens(Format *f, int file, const char *made) {
    int other = session_add_text(f->s, "<formatted>", NULL, made, strlen(made));
    Lexer a = lex_start(f->s, file), b = lex_start(f->s, other);
    a.quiet = b.quiet = true;
    for (;;) {
        Token x = lex_next(&a), y = lex_next(&b);
        if (x.kind != y.kind || x.span.len != y.span.len) return false;
        if (x.kind == TOK_EOF) return true;
        if (memcmp(f->s->sources[file].text + x.span.pos, made + y.span.pos, x.span.len)) return false;
    }
}

const char *format_source(Session *s, int file) {
    if (memchr(s->sources[file].text, 0, s->sources[file].len)) return NULL;
    parse_module(s, file, "formatted");
    if (s->nerrors) return NULL;
    Format f = {.s = s, .src = &s->sources[file]};
    read_items(&f, file);
    if (f.items.len == 1) return "";
    while (kind(&f) != TOK_EOF) {
        uint32_t before = f.at;
        statement(&f, 0);
        if (f.at == before) f.at++; /* a stray bracket, which the parser would have told */
    }
    place_comments(&f);
    find_unary(&f);
    char *made = write_out(&f);
    if (!made) session_limit(s, "out of memory");
    const char *text = arena_strndup(&s->session, made, strlen(made));
    free(made);
    f.src = &s->sources[file];
    if (!same_tokens(&f, file, text)) ice(s, "the formatter would change the tokens");
    return text;
}

/* ---- the request */

typedef struct Job {
    const Document *d;
    const Server *server;
    FILE *out;
    const char *text;
} Job;

static void format_body(Session *s, void *arg) {
    Job *j = arg;
    int file = session_add_text(s, j->d->path, NULL, j->d->text, j->d->len);
    j->text = format_source(s, file);
    if (!j->text || !strcmp(j->text, s->sources[file].text)) {
        fputs("[]", j->out);
        return;
    }
    Analysis a = {.server = j->server, .document = j->d, .s = s, .file = file, .out = j->out};
    fputs("[{", j->out);
    put_range(&a, "range", (Span){file, 0, s->sources[file].len});
    fputs(",\"newText\":", j->out);
    json_text(j->out, j->text);
    fputs("}]", j->out);
}

void request_format(const Server *server, const Document *d, json_t *params, FILE *out) {
    (void)params;
    Session *s = cli_need(session_create(LSP_MEMORY));
    Job j = {.d = d, .server = server, .out = out};
    if (d->glsl || session_protect(s, format_body, &j)) fputs("[]", out);
}
