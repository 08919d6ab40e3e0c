/* Components of parameters by name: "discs[3].centre.x", "m[1][2]", "module.name.r". */
#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include "compiler/front/front.h"

typedef struct Counts {
    uint32_t f, i;
} Counts;

static Counts counts(const Type *t) {
    switch (t->kind) {
    case T_FLOAT: return (Counts){1, 0};
    case T_BOOL:
    case T_INT:
    case T_UINT: return (Counts){0, 1};
    case T_VECTOR:
    case T_ARRAY: {
        Counts c = counts(t->elem);
        return (Counts){c.f * t->n, c.i * t->n};
    }
    case T_MATRIX: return (Counts){type_components(t), 0};
    case T_STRUCT: {
        Counts c = {0, 0};
        for (uint32_t k = 0; k < t->nfields; k++) {
            Counts x = counts(t->fields[k].type);
            c.f += x.f, c.i += x.i;
        }
        return c;
    }
    default: return (Counts){0, 0};
    }
}

static bool fail(const Program *p, const char **why, const char *text) {
    Session *s = p->session;
    if (why) *why = p->is_glsl && s->nsources ? glsl_in_words(s, &s->sources[0], text) : text;
    return false;
}

static bool is_name(char c) { return isalnum((unsigned char)c) || c == '_'; }

/* The parameter with the longest name that `name` starts with, up to a `.`, a `[` or the end. */
static const Param *find_param(const Program *p, const char *name, size_t *len) {
    const Param *best = NULL;
    for (uint32_t i = 0; i < p->nparams; i++) {
        size_t n = strlen(p->params[i].name);
        if (strncmp(name, p->params[i].name, n) || is_name(name[n]) || (best && n <= *len)) continue;
        best = &p->params[i];
        *len = n;
    }
    return best;
}

static bool step_index(const Program *p, ParamRef *r, uint32_t n, Type *elem, Counts each, const char **at,
                       const char *start, const char **why) {
    Arena *a = &p->session->session;
    char *end;
    unsigned long v = isdigit((unsigned char)(*at)[1]) ? strtoul(*at + 1, &end, 10) : (end = (char *)*at, 0);
    if (*end != ']') return fail(p, why, arena_printf(a, "`%s`: an index is a number in brackets", start));
    if (v >= n) return fail(p, why, arena_printf(a, "`%s`: index %lu is outside of 0..%u", start, v, n - 1));
    r->fbase += (uint32_t)v * each.f, r->ibase += (uint32_t)v * each.i;
    r->fcount = each.f, r->icount = each.i;
    r->type = elem;
    *at = end + 1;
    return true;
}

static bool step_field(const Program *p, ParamRef *r, const char **at, const char *start, const char **why) {
    Arena *a = &p->session->session;
    const char *name = *at + 1;
    size_t n = 0;
    while (is_name(name[n])) n++;
    Type *t = r->type;
    *at = name + n;
    if (t->kind == T_VECTOR) {
        static const char xyzw[] = "xyzw", rgba[] = "rgba";
        for (uint32_t k = 0; k < t->n && n == 1; k++)
            if (name[0] == xyzw[k] || name[0] == rgba[k]) {
                Counts c = counts(t->elem);
                r->fbase += k * c.f, r->ibase += k * c.i;
                r->fcount = c.f, r->icount = c.i;
                r->type = t->elem;
                return true;
            }
        return fail(p, why, arena_printf(a, "`%s`: %s has no component `%.*s`", start, t->name, (int)n, name));
    }
    if (t->kind != T_STRUCT)
        return fail(p, why, arena_printf(a, "`%s`: %s has no field `%.*s`", start, t->name, (int)n, name));
    for (uint32_t k = 0; k < t->nfields; k++) {
        Counts c = counts(t->fields[k].type);
        if (strlen(t->fields[k].name) == n && !strncmp(t->fields[k].name, name, n)) {
            r->fcount = c.f, r->icount = c.i;
            r->type = t->fields[k].type;
            return true;
        }
        r->fbase += c.f, r->ibase += c.i;
    }
    const char **names = ARENA_ARRAY(a, const char *, t->nfields + 1);
    for (uint32_t k = 0; k < t->nfields; k++) names[k] = t->fields[k].name;
    const char *near = suggest_nearest(arena_strndup(a, name, n), names, t->nfields);
    return fail(p, why,
                arena_printf(a, "`%s`: %s has no field `%.*s`%s%s%s", start, t->name, (int)n, name,
                             near ? ", did you mean `" : "", near ? near : "", near ? "`?" : ""));
}

bool program_find(const Program *p, const char *name, ParamRef *out, const char **why) {
    Arena *a = &p->session->session;
    size_t len = 0;
    const Param *q = find_param(p, name, &len);
    if (!q) {
        const char **names = ARENA_ARRAY(a, const char *, p->nparams + 1);
        for (uint32_t i = 0; i < p->nparams; i++) names[i] = p->params[i].name;
        size_t n = 0;
        while (is_name(name[n]) || (name[n] == '.' && is_name(name[n + 1]))) n++;
        const char *near = suggest_nearest(arena_strndup(a, name, n), names, p->nparams);
        for (n = 0; !near && is_name(name[n]); n++) {
        }
        if (!near) near = suggest_nearest(arena_strndup(a, name, n), names, p->nparams);
        if (p->is_glsl && strstr(name, "esolution") && !strchr(name, '['))
            return fail(p, why,
                        arena_printf(a, "there is no parameter `%s`: --size gives the size of the image", name));
        return fail(p, why,
                    arena_printf(a, "there is no parameter `%s`%s%s%s", name, near ? ", did you mean `" : "",
                                 near ? near : "", near ? "`?" : ""));
    }
    ParamRef r = {q, q->type, q->fbase, q->fcount, q->ibase, q->icount};
    const char *at = name + len;
    uint32_t size[4], dims = param_texel_sizes(q, size), peeled = 0; /* of texels */
    while (*at) {
        Type *t = r.type;
        if (*at == '[') {
            bool ok;
            if (t->kind == T_ARRAY || t->kind == T_VECTOR) {
                ok = step_index(p, &r, t->n, t->elem, counts(t->elem), &at, name, why);
            } else if (t->kind == T_MATRIX) {
                ok = step_index(p, &r, t->n, type_row(t), (Counts){t->columns, 0}, &at, name, why);
            } else if (param_is_image(q)) {
                /* texels in one flat vector; each index peels one dimension */
                if (peeled == dims) return fail(p, why, arena_printf(a, "`%s`: too many indices", name));
                uint32_t n = size[peeled++];
                ok = step_index(p, &r, n, q->type, (Counts){r.fcount / n, 0}, &at, name, why);
            } else {
                return fail(p, why, arena_printf(a, "`%s`: %s cannot be indexed", name, t->name));
            }
            if (!ok) return false;
        } else if (*at == '.') {
            if (!step_field(p, &r, &at, name, why)) return false;
        } else {
            return fail(p, why, arena_printf(a, "`%s`: expected `.` or `[` at `%s`", name, at));
        }
    }
    *out = r;
    return true;
}
