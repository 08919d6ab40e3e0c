/* The text form back to a Fn (the form is described in print.c). One pass, no recovery: the first error is reported and
 * ends the parse. What was read is verified, so that a Fn that comes out of here is sound whatever the text was. */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "compiler/ir/text.h"

enum { MAX_NESTING = 200, MAX_TOKEN = 400 };
static const uint32_t max_id = 1u << 20;

typedef struct Parser {
    Session *s;
    Fn *fn;
    int file;
    const char *text, *end, *at; /* at: the next token's first byte */
    bool failed;
    Vec(Inst *) values; /* by printed id */
    Vec(SiteInfo) sites;
    Vec(Output) outputs;
    uint32_t depth;
} Parser;

/* ---- tokens */

static void skip_space(Parser *p) {
    while (p->at < p->end) {
        if (*p->at == ';')
            while (p->at < p->end && *p->at != '\n') p->at++;
        else if (*p->at == ' ' || *p->at == '\n' || *p->at == '\t' || *p->at == '\r') p->at++;
        else return;
    }
}

static bool is_word_char(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '+' ||
           c == '-' || c == '.';
}

static size_t word_length(const Parser *p) {
    size_t n = 0;
    while (p->at + n < p->end && is_word_char(p->at[n])) n++;
    return n;
}

/* Returns false so that callers can leave with it. */
static bool expected(Parser *p, const char *what) {
    if (p->failed) return false;
    p->failed = true;
    skip_space(p);
    size_t n = word_length(p);
    if (!n && p->at < p->end) n = 1;
    Span span = {p->file, (uint32_t)(p->at - p->text), (uint32_t)n};
    char message[160];
    if (p->at >= p->end) snprintf(message, sizeof message, "expected %s, found the end of the text", what);
    else snprintf(message, sizeof message, "expected %s, found '%.*s'", what, (int)(n < 40 ? n : 40), p->at);
    diag_emit(p->s, DIAG_syntax, span, message);
    return false;
}

static bool accept_char(Parser *p, char c) {
    skip_space(p);
    if (p->failed || p->at >= p->end || *p->at != c) return false;
    p->at++;
    return true;
}

static bool want_char(Parser *p, char c) {
    if (accept_char(p, c)) return true;
    char what[8] = {'\'', c, '\'', 0};
    return expected(p, what);
}

static bool accept_word(Parser *p, const char *word) {
    skip_space(p);
    size_t n = word_length(p);
    if (p->failed || n != strlen(word) || memcmp(p->at, word, n) != 0) return false;
    p->at += n;
    return true;
}

static bool want_word(Parser *p, const char *word) { return accept_word(p, word) || expected(p, word); }

/* One word out of a list; its index, or -1. */
static int want_name(Parser *p, const char *const *names, int n, const char *what) {
    for (int k = 0; k < n; k++)
        if (accept_word(p, names[k])) return k;
    expected(p, what);
    return -1;
}

/* The next word, NUL-terminated in the buffer; "" if there is none or it is too long. */
static void take_word(Parser *p, char *buffer) {
    skip_space(p);
    size_t n = p->failed ? 0 : word_length(p);
    if (n >= MAX_TOKEN) n = 0;
    memcpy(buffer, p->at, n);
    buffer[n] = 0;
    p->at += n;
}

static bool want_integer(Parser *p, int64_t lo, int64_t hi, int64_t *out) {
    char word[MAX_TOKEN], *stop;
    const char *start = p->at;
    take_word(p, word);
    errno = 0;
    long long v = strtoll(word, &stop, 10);
    if (word[0] && !*stop && !errno && v >= lo && v <= hi) {
        *out = v;
        return true;
    }
    p->at = start;
    return expected(p, "an integer in range");
}

static bool want_u32(Parser *p, uint32_t *out) {
    int64_t v = 0;
    bool ok = want_integer(p, 0, UINT32_MAX, &v);
    *out = (uint32_t)v;
    return ok;
}

static bool want_double(Parser *p, double *out) {
    char word[MAX_TOKEN], *stop;
    bool bits = accept_word(p, "bits");
    const char *start = p->at;
    take_word(p, word);
    if (bits) {
        uint64_t v = strtoull(word, &stop, 16);
        memcpy(out, &v, sizeof v);
    } else {
        *out = plain_strtod(word, &stop);
    }
    if (word[0] && !*stop) return true;
    p->at = start;
    return expected(p, "a number");
}

static int hex_digit(char c) {
    return c >= '0' && c <= '9'   ? c - '0'
           : c >= 'a' && c <= 'f' ? c - 'a' + 10
           : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                  : -1;
}

static bool want_string(Parser *p, const char **out, uint32_t *len) {
    if (!want_char(p, '"')) return false;
    const char *stop = p->at;
    while (stop < p->end && *stop != '"') stop += *stop == '\\' && stop + 1 < p->end ? 2 : 1;
    if (stop >= p->end) return expected(p, "a string that ends");
    char *s = arena_alloc(p->fn->arena, (size_t)(stop - p->at) + 1);
    uint32_t n = 0;
    for (const char *c = p->at; c < stop; c++) {
        if (*c != '\\') {
            s[n++] = *c;
        } else if (c[1] == 'x' && c + 3 < stop && hex_digit(c[2]) >= 0 && hex_digit(c[3]) >= 0) {
            s[n++] = (char)(hex_digit(c[2]) * 16 + hex_digit(c[3]));
            c += 3;
        } else {
            s[n++] = *++c;
        }
    }
    p->at = stop + 1;
    *out = s;
    if (len) *len = n;
    return true;
}

static bool want_type(Parser *p, IrType *out) {
    skip_space(p);
    for (int t = TY_BOOL; t <= TY_TAPE && p->at < p->end; t++)
        if (*p->at == ir_type_letters[t] && word_length(p) == 1) {
            p->at++;
            *out = (IrType)t;
            return true;
        }
    return expected(p, "a type: b, i, f, a or t");
}

/* ---- values */

static bool want_id(Parser *p, uint32_t *id) {
    int64_t v = 0;
    if (!want_char(p, '%') || !want_integer(p, 0, max_id, &v)) return false;
    *id = (uint32_t)v;
    return true;
}

static bool define(Parser *p, uint32_t id, Inst *value) {
    while (p->values.len <= id) vec_push(&p->s->scratch, &p->values, NULL);
    if (p->values.data[id]) return expected(p, "an id that is not taken yet");
    p->values.data[id] = value;
    return true;
}

static Inst *want_operand(Parser *p) {
    uint32_t id;
    const char *start = p->at;
    if (!want_id(p, &id)) return NULL;
    if (id < p->values.len && p->values.data[id]) return p->values.data[id];
    p->at = start;
    expected(p, "a value that is defined above");
    return NULL;
}

/* ---- instructions */

static bool want_imm(Parser *p, Op op, Imm *imm) {
    int64_t v = 0;
    switch (op) {
    case OP_constf: return want_double(p, &imm->f);
    case OP_consti: return want_integer(p, INT32_MIN, INT32_MAX, &imm->i);
    case OP_constb: imm->i = accept_word(p, "true"); return imm->i || want_word(p, "false");
    case OP_input: imm->i = want_name(p, ir_input_names, SLT_INPUTS, "the name of an input"); return imm->i >= 0;
    case OP_param:
    case OP_iparam:
    case OP_dparam:
    case OP_adj: {
        uint32_t base, count; /* imm, a union, gets both at once */
        if (!want_char(p, '[') || !want_u32(p, &base) || !want_char(p, ',') || !want_u32(p, &count) ||
            !want_char(p, ']'))
            return false;
        imm->slot.base = base;
        imm->slot.count = count;
        return true;
    }
    case OP_ddx:
    case OP_site:
    case OP_siten:
    case OP_window:
    case OP_proj:
    case OP_live:
    case OP_settled:
    case OP_choice:
    case OP_count:
    case OP_item:
    case OP_items:
    case OP_note:
        if (!want_char(p, '#') || !want_integer(p, 0, UINT32_MAX, &v)) return false;
        imm->i = v;
        return true;
    case OP_alloc:
        return want_type(p, &imm->arr.elem) && want_char(p, '[') && want_u32(p, &imm->arr.count) && want_char(p, ']');
    case OP_loop:
        if (!want_word(p, "max") || !want_u32(p, &imm->loop.max_iters) || !want_word(p, "id") ||
            !want_u32(p, &imm->loop.loop_id))
            return false;
        imm->loop.exact = accept_word(p, "exact");
        imm->loop.told = accept_word(p, "told");
        imm->loop.found = accept_word(p, "list");
        imm->loop.cull = imm->loop.found || accept_word(p, "cull");
        return !imm->loop.cull || want_u32(p, &imm->loop.cull_id);
    case OP_print: return want_string(p, &imm->text.text, &imm->text.len);
    case OP_give:
    case OP_take: {
        uint32_t which, place, places;
        if (!want_char(p, '[') || !want_u32(p, &which) || !want_char(p, ',') || !want_u32(p, &place) ||
            !want_word(p, "of") || !want_u32(p, &places) || !want_char(p, ']'))
            return false;
        imm->frame.which = which, imm->frame.place = place, imm->frame.places = places;
        return true;
    }
    case OP_told:
    case OP_query:
        return want_word(p, "geometry") && want_u32(p, &imm->query.geometry) && want_word(p, "what") &&
               want_u32(p, &imm->query.what) && want_word(p, "base") && want_u32(p, &imm->query.base);
    default: return true;
    }
}

static int find_op(const char *name) {
    for (int op = 0; op < OP_COUNT; op++)
        if (strcmp(ir_ops[op].name, name) == 0) return op;
    return -1;
}

static bool want_block(Parser *p, Block *b);

static IrType default_type(Op op) { return (IrType)(op == OP_alloc ? TY_ARRAY : ir_ops[op].result); }

static bool want_inst(Parser *p, Builder *b) {
    uint32_t id = 0;
    skip_space(p);
    const char *start = p->at;
    bool named = p->at < p->end && *p->at == '%';
    if (named && (!want_id(p, &id) || !want_char(p, '='))) return false;
    char name[MAX_TOKEN];
    skip_space(p);
    const char *name_at = p->at;
    take_word(p, name);
    int op = find_op(name);
    if (op < 0 || op == OP_arg) {
        p->at = name_at;
        return expected(p, "an operation");
    }
    IrType type = default_type((Op)op);
    if (ir_spells_type((Op)op) && (!want_char(p, ':') || !want_type(p, &type))) return false;
    Vec(Inst *) args = {0};
    while (p->at < p->end && *p->at == ' ') p->at++; /* operands stand on the line: a % on the next is another's name */
    if (p->at < p->end && *p->at == '%') do {
            Inst *v = want_operand(p);
            if (!v) return false;
            vec_push(&p->s->scratch, &args, v);
        } while (accept_char(p, ','));
    if (ir_ops[op].nargs != IR_MANY && args.len != ir_ops[op].nargs) {
        char what[64];
        snprintf(what, sizeof what, "%d operands of %s", ir_ops[op].nargs, ir_ops[op].name);
        return expected(p, what);
    }
    Imm imm;
    memset(&imm, 0, sizeof imm);
    if (!want_imm(p, (Op)op, &imm)) return false;
    if (op == OP_constf && p->fn->precision == PREC_F32 && isfinite(imm.f)) imm.f = (double)(float)imm.f;
    b->span = (Span){p->file, (uint32_t)(start - p->text), (uint32_t)(p->at - start)};
    Inst *i = ir_special(b, (Op)op, type, args.len, args.data, imm);
    bool structured = op == OP_if_ || op == OP_loop || op == OP_revloop || op == OP_custom;
    while (structured && i->nregions < 2 && accept_char(p, '{')) {
        p->at--;
        Block *region = ir_block(p->fn, i);
        if (i->region[i->nregions - 1] != region) return expected(p, "no further region");
        if (!want_block(p, region)) return false;
    }
    if (named != (type != TY_VOID || structured))
        return expected(p, named ? "no name for what has no value" : "a name for the value");
    return !named || define(p, id, i);
}

static bool want_block(Parser *p, Block *b) {
    if (++p->depth > MAX_NESTING) return expected(p, "fewer nested regions");
    if (!want_char(p, '{')) return false;
    if (accept_char(p, '(')) {
        do {
            uint32_t id;
            IrType t;
            if (!want_id(p, &id) || !want_char(p, ':') || !want_type(p, &t)) return false;
            if (!define(p, id, ir_block_param(p->fn, b, t))) return false;
        } while (accept_char(p, ','));
        if (!want_char(p, ')')) return false;
    }
    Builder builder = {.fn = p->fn, .block = b};
    while (!accept_char(p, '}'))
        if (!want_inst(p, &builder)) return false;
    p->depth--;
    return true;
}

/* ---- the head */

static bool find_output(const char *name, Output *out) {
    for (int r = 0; r < SLT_ROLES; r++) {
        const OutputText *role = &ir_output_texts[r];
        size_t len = strlen(role->text);
        if (strncmp(name, role->text, len) != 0) continue;
        size_t digits = strspn(name + len, "0123456789");
        if (name[len + digits] || digits > 4 || (digits > 0) != (role->most > 1)) continue;
        *out = (Output){(SltRole)r, digits ? (uint32_t)strtoul(name + len, NULL, 10) : 0};
        return true;
    }
    return false;
}

static bool want_output(Parser *p, Output *out) {
    const char *name;
    if (!want_string(p, &name, NULL)) return false;
    return find_output(name, out) || expected(p, "the name of an output");
}

static bool want_site(Parser *p) {
    SiteInfo site = {.span = SPAN_NONE};
    int kind = want_name(p, ir_site_kinds, SLT_SITE_KINDS, "a kind of site");
    int64_t events = 0;
    if (kind < 0 || !want_word(p, "depth") || !want_u32(p, &site.depth) || !want_word(p, "events") ||
        !want_integer(p, 0, INT64_MAX, &events))
        return false;
    site.kind = (SiteKind)kind;
    site.max_events = (uint64_t)events;
    site.skip_loop = accept_word(p, "skip");
    site.by_auto = accept_word(p, "auto");
    site.still = accept_word(p, "still");
    if (!want_word(p, "path") || !want_string(p, &site.path, NULL) || !want_word(p, "text") ||
        !want_string(p, &site.text, NULL))
        return false;
    vec_push(p->fn->arena, &p->sites, site);
    return true;
}

static bool want_fn(Parser *p) {
    static const char *const precisions[] = {"f32", "f64"};
    Fn *fn = p->fn;
    if (!want_word(p, "fn") || !want_string(p, &fn->name, NULL)) return false;
    int precision = want_name(p, precisions, 2, "f32 or f64");
    if (precision < 0 || !want_word(p, "dim") || !want_u32(p, &fn->dim) || !want_word(p, "channels") ||
        !want_u32(p, &fn->channels) || !want_word(p, "floats") || !want_u32(p, &fn->nfloats) || !want_word(p, "ints") ||
        !want_u32(p, &fn->nints))
        return false;
    fn->precision = (Precision)precision;
    while (accept_word(p, "site"))
        if (!want_site(p)) return false;
    fn->sites = p->sites.data;
    fn->nsites = p->sites.len;
    while (accept_word(p, "output")) {
        Output out;
        if (!want_output(p, &out)) return false;
        vec_push(fn->arena, &p->outputs, out);
    }
    if (!want_block(p, fn->body)) return false;
    skip_space(p);
    if (p->at < p->end) return expected(p, "the end of the text");
    if (p->outputs.len && (!fn->body->last || fn->body->last->nargs != p->outputs.len))
        return expected(p, "as many outputs as the last yield has values");
    fn->outputs = p->outputs.data;
    return true;
}

Fn *ir_parse(Session *s, Arena *arena, int file) {
    const Source *source = &s->sources[file];
    ArenaMark m = arena_mark(&s->scratch);
    Parser p = {.s = s, .file = file, .text = source->text, .at = source->text, .end = source->text + source->len};
    p.fn = ir_fn(s, arena, "", PREC_F32);
    bool ok = want_fn(&p);
    const char *why = "";
    if (ok && !ir_verify(p.fn, arena, &why)) {
        diag_emit(s, DIAG_syntax, (Span){file, 0, 1}, why);
        ok = false;
    }
    if (arena != &s->scratch) arena_reset(&s->scratch, m);
    return ok ? p.fn : NULL;
}
