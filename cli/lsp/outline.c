/* Symbols of a document, and where a name stands. */
#include <string.h>

#include "cli/lsp/lsp.h"

enum {
    KIND_FIELD = 8,
    KIND_FUNCTION = 12,
    KIND_VARIABLE = 13,
    KIND_CONSTANT = 14,
    KIND_STRUCT = 23,
    KIND_EVENT = 24,
    KIND_TYPE = 26
};

static void put_symbol(Analysis *a, const char *name, const char *detail, int kind, Span whole, Span at, uint32_t *n) {
    if (at.file != a->file || !name || !*name) return;
    if ((*n)++) fputc(',', a->out);
    fputs("{\"name\":", a->out);
    json_text(a->out, name);
    if (detail) {
        fputs(",\"detail\":", a->out);
        json_text(a->out, detail);
    }
    fprintf(a->out, ",\"kind\":%d,", kind);
    put_range(a, "range", whole);
    fputc(',', a->out);
    put_range(a, "selectionRange", at);
}

static Span until(Span from, Span to) {
    uint32_t end = to.pos + to.len;
    return to.file == from.file && end > from.pos + from.len ? (Span){from.file, from.pos, end - from.pos} : from;
}

static void values(Analysis *a, const Symbol *s, int kind, uint32_t *n) {
    for (; s; s = s->next) {
        uint32_t before = *n;
        put_symbol(a, s->name, s->type && s->type->kind != T_ERROR ? s->type->name : NULL, kind,
                   until(s->span, s->value_span.len ? s->value_span : s->span), s->span, n);
        if (*n > before) fputc('}', a->out);
    }
}

void request_symbols(Analysis *a, uint32_t offset, json_t *params) {
    (void)offset, (void)params;
    uint32_t n = 0;
    fputc('[', a->out);
    for (const StructDecl *d = a->main->struct_decls; d; d = d->next) {
        uint32_t fields = 0, before = n;
        put_symbol(a, d->name, NULL, KIND_STRUCT, until(d->span, d->nfields ? d->fields[d->nfields - 1].span : d->span),
                   d->span, &n);
        if (n == before) continue;
        fputs(",\"children\":[", a->out);
        for (uint32_t i = 0; i < d->nfields; i++) {
            uint32_t had = fields;
            put_symbol(a, d->fields[i].name, d->fields[i].type_ref->name, KIND_FIELD, d->fields[i].span,
                       d->fields[i].span, &fields);
            if (fields > had) fputc('}', a->out);
        }
        fputs("]}", a->out);
    }
    for (const TypedefDecl *d = a->main->typedefs; d; d = d->next) {
        uint32_t before = n;
        put_symbol(a, d->name, d->type ? d->type->name : NULL, KIND_TYPE, d->span, d->span, &n);
        if (n > before) fputc('}', a->out);
    }
    values(a, a->main->consts, KIND_CONSTANT, &n);
    values(a, a->main->params, KIND_VARIABLE, &n);
    for (const Func *f = a->main->funcs; f; f = f->next) {
        uint32_t before = n;
        Span head = f->span.len && f->span.pos <= f->name_span.pos ? f->span : f->name_span;
        put_symbol(a, f->name, func_head(a, f), f->is_shader ? KIND_EVENT : KIND_FUNCTION,
                   until(head, f->end_span.len ? f->end_span : f->name_span), f->name_span, &n);
        if (n > before) fputc('}', a->out);
    }
    fputc(']', a->out);
}

void request_definition(Analysis *a, uint32_t offset, json_t *params) {
    (void)params;
    Names names = names_of(a, false);
    const Name *n = name_at(a, &names, offset);
    Span at = n ? name_declared(n) : SPAN_NONE;
    if (at.file < 0) {
        fputs("null", a->out);
        return;
    }
    fputc('{', a->out);
    put_location(a, at);
    fputc('}', a->out);
}

static void same_names(Analysis *a, uint32_t offset, bool imports, bool declaration) {
    Names names = names_of(a, imports);
    const Name *of = name_at(a, &names, offset);
    uint32_t n = 0;
    fputc('[', a->out);
    for (uint32_t i = 0; of && i < names.len; i++) {
        const Name *k = &names.data[i];
        if (!name_same(of, k) || (k->declares && !declaration)) continue;
        fputs(n++ ? ",{" : "{", a->out);
        if (imports) put_location(a, k->span);
        else put_range(a, "range", k->span);
        fputc('}', a->out);
    }
    fputc(']', a->out);
}

void request_references(Analysis *a, uint32_t offset, json_t *params) {
    json_t *context = json_object_get(params, "context");
    same_names(a, offset, true, !json_is_false(json_object_get(context, "includeDeclaration")));
}

void request_highlight(Analysis *a, uint32_t offset, json_t *params) {
    (void)params;
    same_names(a, offset, false, true);
}
