/* [Vertex(place)]: the function that places the vertices of a mesh. */
#include "compiler/front/check/internal.h"

static bool fits(Checker *c, const Func *f) {
    Type *point = type_vector(c->s, T_FLOAT, 3), *of[3] = {c->t_int, point, c->t_int};
    if (f->is_shader || f->nargs != 3 || f->ret != point) return false;
    for (uint32_t i = 0; i < 3; i++)
        if (f->args[i]->type != of[i] || f->args[i]->mode != ARG_IN) return false;
    return true;
}

void check_vertex(Checker *c, Symbol *sym) {
    Session *s = c->s;
    const ParamAttrs *a = &sym->attrs;
    Decl *d = scope_find(c, a->vertex_name, a->vertex_span);
    if (d && d->kind == DECL_ERROR) return;
    for (uint32_t i = 0; d && d->kind == DECL_FUNC && i < d->nfuncs; i++) {
        Func *f = d->funcs[i];
        func_signature(c, f);
        if (!func_info(c, f)->signature_ok) return;
        if (!fits(c, f)) continue;
        sym->place = f;
        return;
    }
    Diag *diag =
        diag_emit(s, DIAG_bad_vertex, a->vertex_span,
                  arena_printf(&s->session, "[Vertex(%s)] needs a function `float3 %s(int i, float3 p, int part)`%s",
                               a->vertex_name, a->vertex_name, d ? "" : suggest(c, a->vertex_name, false)));
    for (uint32_t i = 0; d && d->kind == DECL_FUNC && i < d->nfuncs && i < 8; i++)
        diag_note(s, diag, d->funcs[i]->name_span, "candidate: `%s`", func_text(c, d->funcs[i]));
    if (d && d->kind != DECL_FUNC) diag_note(s, diag, d->span, "`%s` is declared here", d->name);
}
