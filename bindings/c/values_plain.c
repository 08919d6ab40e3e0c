/* Parameter values in the form in which slt_params_json writes them, read straight into the vectors: files have
 * millions of numbers, and a tree of them takes ten times as long. This reads nothing that values_read.c would read
 * otherwise, and says nothing: what is spelled, ordered or wrong in any other way is left to it. */
#include <math.h>
#include <string.h>

#include "bindings/c/values_plain.h"
#include "runtime/base/decimal.h"

typedef struct Plain {
    const char *at;
    double *floats;
    int32_t *ints;
} Plain;

static bool is_digit(char c) { return (unsigned char)(c - '0') < 10; }

static void skip_blanks(Plain *r) {
    while (*r->at == ' ' || *r->at == '\n' || *r->at == '\t' || *r->at == '\r') r->at++;
}

static bool take(Plain *r, char c) {
    skip_blanks(r);
    if (*r->at != c) return false;
    return r->at++, true;
}

static bool take_word(Plain *r, const char *word) {
    size_t n = strlen(word);
    skip_blanks(r);
    if (strncmp(r->at, word, n) != 0) return false;
    return r->at += n, true;
}

static bool take_name(Plain *r, const char *name) {
    size_t n = strlen(name);
    if (!take(r, '"') || strncmp(r->at, name, n) != 0 || r->at[n] != '"') return false;
    r->at += n + 1;
    return take(r, ':');
}

/* JSON has fewer forms than strtod, no infinities, and in the other reader no whole number of more than 64 bits, nor
 * one that is minus zero. */
static bool take_float(Plain *r, double *out) {
    skip_blanks(r);
    const char *first = r->at + (*r->at == '-'), *c = first;
    while (is_digit(*c)) c++;
    if (c == first || (c - first > 1 && *first == '0') || c - first > 18) return false;
    bool whole = *c != '.' && (*c | 32) != 'e';
    if (*c == 'x' || *c == 'X' || (*c == '.' && !is_digit(c[1]))) return false;
    *out = decimal_read(r->at, &r->at);
    return isfinite(*out) && !(whole && *out == 0 && signbit(*out));
}

static bool take_int(Plain *r, TypeKind kind, int32_t *out) {
    skip_blanks(r);
    bool minus = *r->at == '-';
    const char *first = r->at += minus;
    int64_t v = 0;
    for (; is_digit(*r->at); r->at++) {
        if (r->at - first >= 10) return false;
        v = 10 * v + (*r->at - '0');
    }
    if (r->at == first || (r->at - first > 1 && *first == '0') || *r->at == '.' || (*r->at | 32) == 'e') return false;
    if (minus) v = -v;
    if (kind == T_INT ? v < INT32_MIN || v > INT32_MAX : v < 0 || v > UINT32_MAX) return false;
    return *out = (int32_t)(uint32_t)v, true;
}

static bool take_floats(Plain *r, uint32_t n, ShapeCursor *c) {
    if (!take(r, '[')) return false;
    for (uint32_t k = 0; k < n; k++)
        if ((k && !take(r, ',')) || !take_float(r, &r->floats[c->f++])) return false;
    return take(r, ']');
}

static bool take_value(Plain *r, const Type *t, ShapeCursor *c) {
    switch (t->kind) {
    case T_FLOAT: return take_float(r, &r->floats[c->f++]);
    case T_INT:
    case T_UINT: return take_int(r, t->kind, &r->ints[c->i++]);
    case T_BOOL: r->ints[c->i] = take_word(r, "true"); return r->ints[c->i++] || take_word(r, "false");
    case T_VECTOR:
    case T_ARRAY:
        if (t->elem->kind == T_FLOAT) return take_floats(r, t->n, c);
        if (!take(r, '[')) return false;
        for (uint32_t k = 0; k < t->n; k++)
            if ((k && !take(r, ',')) || !take_value(r, t->elem, c)) return false;
        return take(r, ']');
    case T_MATRIX:
        if (!take(r, '[')) return false;
        for (uint32_t k = 0; k < t->n; k++)
            if ((k && !take(r, ',')) || !take_floats(r, t->columns, c)) return false;
        return take(r, ']');
    case T_STRUCT:
        if (!take(r, '{')) return false;
        for (uint32_t k = 0; k < t->nfields; k++)
            if ((k && !take(r, ',')) || !take_name(r, t->fields[k].name) || !take_value(r, t->fields[k].type, c))
                return false;
        return take(r, '}');
    default: return false;
    }
}

static bool take_texels(Plain *r, const uint32_t *n, uint32_t dims, ShapeCursor *c) {
    if (dims == 1) return take_floats(r, *n, c);
    if (!take(r, '[')) return false;
    for (uint32_t k = 0; k < *n; k++)
        if ((k && !take(r, ',')) || !take_texels(r, n + 1, dims - 1, c)) return false;
    return take(r, ']');
}

static bool take_param(Plain *r, const Param *q) {
    ShapeCursor c = {q->fbase, q->ibase};
    uint32_t n[4];
    return param_is_image(q) ? take_texels(r, n, param_texel_sizes(q, n), &c) : take_value(r, q->type, &c);
}

static bool at_end(Plain *r) {
    skip_blanks(r);
    return !*r->at;
}

/* Behind one value, whatever it is: to the comma or bracket that ends it. */
static void skip_value(Plain *r) {
    for (uint64_t depth = 0; *r->at; r->at++) {
        char c = *r->at;
        if (c == '[' || c == '{') depth++;
        if (!depth && (c == ',' || c == ']' || c == '}')) return;
        if (c == ']' || c == '}') depth--;
        if (c != '"') continue;
        for (r->at++; *r->at && *r->at != '"'; r->at++)
            if (*r->at == '\\' && r->at[1]) r->at++;
        if (!*r->at) return;
    }
}

/* Behind the bracket that begins a list: its size and those of its first elements. 0: it does not end. */
static uint32_t take_sizes(Plain *r, uint32_t most, uint64_t *sizes) {
    uint32_t inner = 0;
    *sizes = 0;
    if (take(r, ']')) return 1;
    do {
        Plain first = *r;
        if (!*sizes && most > 1 && take(&first, '[')) inner = take_sizes(&first, most - 1, sizes + 1);
        ++*sizes, skip_value(r);
    } while (take(r, ','));
    return take(r, ']') ? 1 + inner : 0;
}

uint32_t plain_sizes(const char *text, const char *name, uint32_t most, uint64_t *sizes) {
    Plain r = {.at = text};
    if (!take(&r, '{')) return 0;
    for (bool first = true; first || take(&r, ','); first = false) {
        skip_blanks(&r);
        const char *here = r.at;
        if (take_name(&r, name) && take(&r, '[')) return take_sizes(&r, most, sizes);
        r.at = here;
        skip_value(&r);
    }
    return 0;
}

bool plain_param(const Param *q, const char *text, double *floats, int32_t *ints) {
    Plain r = {text, floats, ints};
    return take_param(&r, q) && at_end(&r);
}

bool plain_params(const Program *p, const char *text, double *floats, int32_t *ints) {
    Plain r = {text, floats, ints};
    bool seen[1024] = {false};
    if (!take(&r, '{') || p->nparams > sizeof seen) return false;
    for (bool first = true; !take(&r, '}'); first = false) {
        if (!first && !take(&r, ',')) return false;
        const char *here = r.at;
        uint32_t k = 0;
        while (k < p->nparams && !take_name(&r, p->params[k].name)) r.at = here, k++;
        if (k == p->nparams || seen[k] || !take_param(&r, &p->params[k])) return false;
        seen[k] = true;
    }
    return at_end(&r);
}
