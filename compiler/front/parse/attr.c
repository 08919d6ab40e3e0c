/* Attributes: parsed alike everywhere, then given to what they mark. */
#include "compiler/front/parse/internal.h"

#include <string.h>

enum { ON_PARAM = 1, ON_FUNC = 2, ON_SHADER = 4, ON_STMT = 8, ON_FIELD = 16 };
enum { ARGS_NONE, ARGS_VALUES, ARGS_STRING, ARGS_NAME };

typedef struct AttrRow {
    const char *name;
    int where, args;
    uint32_t nargs;
    const char *usage;
} AttrRow;

typedef enum AttrId {
    A_NODIFF,
    A_RANGE,
    A_DOC,
    A_COLOR,
    A_LOG,
    A_EXTENT,
    A_HEIGHT,
    A_VERTEX,
    A_TANGENT,
    A_DOMAIN,
    A_DISPLAY,
    A_DISC,
    A_NODISC,
    A_SKIPLOOP,
    A_MAXITERS,
    A_CULL,
    A_COUNT
} AttrId;

static const AttrRow table[A_COUNT] = {
    [A_NODIFF] = {"NoDiff", ON_PARAM, ARGS_NONE, 0, "[NoDiff]"},
    [A_RANGE] = {"Range", ON_PARAM | ON_FIELD, ARGS_VALUES, 2, "[Range(lo, hi)]"},
    [A_DOC] = {"Doc", ON_PARAM, ARGS_STRING, 1, "[Doc(\"text\")]"},
    [A_COLOR] = {"Color", ON_PARAM, ARGS_NONE, 0, "[Color]"},
    [A_LOG] = {"Log", ON_PARAM | ON_FIELD, ARGS_NONE, 0, "[Log]"},
    [A_EXTENT] = {"Extent", ON_PARAM, ARGS_VALUES, 4, "[Extent(x0, y0, x1, y1)]"},
    [A_HEIGHT] = {"Height", ON_PARAM, ARGS_VALUES, 2, "[Height(scale, offset)]"},
    [A_VERTEX] = {"Vertex", ON_PARAM, ARGS_NAME, 1, "[Vertex(function)]"},
    [A_TANGENT] = {"Tangent", ON_FUNC, ARGS_NAME, 1, "[Tangent(function)]"},
    [A_DOMAIN] = {"Domain", ON_SHADER, ARGS_VALUES, 2, "[Domain(lo, hi)]"},
    [A_DISPLAY] = {"Display", ON_SHADER, ARGS_NONE, 0, "[Display]"},
    [A_DISC] = {"Disc", ON_STMT, ARGS_NONE, 0, "[Disc]"},
    [A_NODISC] = {"NoDisc", ON_STMT | ON_FUNC | ON_SHADER, ARGS_NONE, 0, "[NoDisc]"},
    [A_SKIPLOOP] = {"SkipLoop", ON_STMT, ARGS_NONE, 0, "[SkipLoop]"},
    [A_MAXITERS] = {"MaxIters", ON_STMT, ARGS_VALUES, 1, "[MaxIters(n)]"},
    [A_CULL] = {"Cull", ON_STMT, ARGS_NAME, 1, "[Cull(function)]"},
};

const char *attribute_usage(uint32_t i, const char **name) {
    if (i >= A_COUNT) return NULL;
    *name = table[i].name;
    return table[i].usage;
}

static Attr parse_attribute(Parser *p) {
    Attr a = {.name = p->tok.text, .span = p->tok.span};
    if (!parse_expect(p, TOK_IDENT, "the name of an attribute")) return a;
    Span open = p->tok.span;
    if (!parse_accept(p, TOK_LPAREN)) return a;
    a.args = parse_arguments(p, open, true, &a.nargs);
    return a;
}

bool parse_attributes(Parser *p, AttrVec *out) {
    *out = (AttrVec){0};
    while (parse_at(p, TOK_LBRACKET) && !p->panic) {
        Span open = p->tok.span;
        parse_advance(p);
        do {
            Attr a = parse_attribute(p);
            if (!p->panic) vec_push(&p->s->module, out, a);
        } while (parse_accept(p, TOK_COMMA));
        parse_close(p, TOK_RBRACKET, "`]` or `,`", open);
        if (p->panic && !p->stopped) parse_skip_to_close(p, TOK_RBRACKET, false);
    }
    return out->len > 0;
}

static const char *place_name(int where) {
    return where & ON_PARAM  ? "a parameter"
           : where & ON_STMT ? "a statement"
           : where & ON_FUNC ? "a function"
                             : "a shader";
}

static bool good_arguments(const Attr *a, const AttrRow *row) {
    if (a->nargs != row->nargs) return false;
    for (uint32_t i = 0; i < a->nargs; i++) {
        const Expr *e = a->args[i];
        bool string = e->kind == E_LITERAL && !e->type;
        if (e->kind == E_ERROR) return false;
        if (string != (row->args == ARGS_STRING)) return false;
        if (row->args == ARGS_NAME && (e->kind != E_NAME || e->parenthesised)) return false;
    }
    return true;
}

/* Words of Slang and HLSL that ask for what is done anyway. */
static bool is_needless(const char *name) {
    static const char *const words[] = {"unroll",
                                        "ForceUnroll",
                                        "loop",
                                        "branch",
                                        "flatten",
                                        "Differentiable",
                                        "BackwardDifferentiable",
                                        "ForwardDifferentiable",
                                        "PreferRecompute"};
    for (size_t i = 0; i < sizeof words / sizeof *words; i++)
        if (!strcmp(words[i], name)) return true;
    return false;
}

/* Looks one attribute up for a place; A_COUNT after reporting. `seen` has a bit an attribute. */
static AttrId understand(Parser *p, const Attr *a, int where, const char *what, uint32_t *seen) {
    const char *names[A_COUNT];
    AttrId id = A_COUNT;
    for (int i = 0; i < A_COUNT; i++) {
        names[i] = table[i].name;
        if (!strcmp(table[i].name, a->name)) id = (AttrId)i;
    }
    if (id == A_COUNT) {
        const char *near = is_needless(a->name) ? NULL : suggest_nearest(a->name, names, A_COUNT);
        if (is_needless(a->name) && !p->stopped)
            diag_emit(p->s, DIAG_unknown_attribute, a->span, a->name, "; leave it out: nothing here needs to be told");
        else if (!p->stopped)
            diag_emit(p->s, DIAG_unknown_attribute, a->span, a->name,
                      near ? arena_printf(&p->s->session, "; did you mean `%s`?", near) : "");
        return A_COUNT;
    }
    const AttrRow *row = &table[id];
    if (!(row->where & where)) {
        parse_complain(p, DIAG_bad_attribute, a->span, "`[%s]` marks %s, not %s", row->name, place_name(row->where),
                       what);
        return A_COUNT;
    }
    if (*seen & 1u << id) {
        parse_complain(p, DIAG_bad_attribute, a->span, "`[%s]` is given twice", row->name);
        return A_COUNT;
    }
    *seen |= 1u << id;
    if (!good_arguments(a, row)) {
        parse_complain(p, DIAG_bad_attribute, a->span, "`[%s]` is written `%s`", row->name, row->usage);
        return A_COUNT;
    }
    return id;
}

void attrs_none(Parser *p, const AttrVec *attrs, const char *what) {
    uint32_t seen = 0;
    for (uint32_t i = 0; i < attrs->len; i++) understand(p, &attrs->data[i], 0, what, &seen);
}

void attrs_to_param(Parser *p, const AttrVec *attrs, ParamAttrs *out, bool field) {
    uint32_t seen = 0;
    for (uint32_t i = 0; i < attrs->len; i++) {
        const Attr *a = &attrs->data[i];
        switch (understand(p, a, field ? ON_FIELD : ON_PARAM, field ? "a field" : "a parameter", &seen)) {
        case A_NODIFF: out->nodiff = true, out->nodiff_span = a->span; break;
        case A_COLOR: out->color = true, out->color_span = a->span; break;
        case A_LOG: out->log = true, out->log_span = a->span; break;
        case A_DOC: out->doc = a->args[0]->name; break;
        case A_RANGE:
            out->has_range = true, out->range_span = a->span;
            memcpy(out->range_args, a->args, sizeof out->range_args);
            break;
        case A_EXTENT:
            out->has_extent = true, out->extent_span = a->span;
            memcpy(out->extent_args, a->args, sizeof out->extent_args);
            break;
        case A_HEIGHT:
            out->has_height = true, out->height_span = a->span;
            memcpy(out->height_args, a->args, sizeof out->height_args);
            break;
        case A_VERTEX: out->vertex_name = a->args[0]->name, out->vertex_span = a->args[0]->span; break;
        default: break;
        }
    }
}

void attrs_to_func(Parser *p, const AttrVec *attrs, Func *f) {
    uint32_t seen = 0;
    for (uint32_t i = 0; i < attrs->len; i++) {
        const Attr *a = &attrs->data[i];
        switch (understand(p, a, f->is_shader ? ON_FUNC | ON_SHADER : ON_FUNC, f->is_shader ? "a shader" : "a function",
                           &seen)) {
        case A_NODISC: f->nodisc = true, f->nodisc_span = a->span; break;
        case A_TANGENT: f->tangent_name = a->args[0]->name, f->tangent_span = a->args[0]->span; break;
        case A_DOMAIN:
            f->has_domain = true, f->domain_span = a->span;
            f->domain_lo = a->args[0];
            f->domain_hi = a->args[1];
            break;
        case A_DISPLAY: f->display = true; break;
        default: break;
        }
    }
}

void attrs_to_stmt(Parser *p, const AttrVec *attrs, StmtAttrs *out) {
    uint32_t seen = 0;
    for (uint32_t i = 0; i < attrs->len; i++) {
        const Attr *a = &attrs->data[i];
        switch (understand(p, a, ON_STMT, "a statement", &seen)) {
        case A_DISC: out->disc = true, out->disc_span = a->span; break;
        case A_NODISC: out->nodisc = true, out->nodisc_span = a->span; break;
        case A_SKIPLOOP: out->skip_loop = true, out->skip_span = a->span; break;
        case A_MAXITERS: out->max_iters = a->args[0], out->max_iters_span = a->span; break;
        case A_CULL: out->cull_name = a->args[0]->name, out->cull_span = a->args[0]->span; break;
        default: break;
        }
    }
}
