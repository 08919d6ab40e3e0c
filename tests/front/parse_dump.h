/* Prints a parsed tree as an S-expression, so that tests compare shapes as text. Header-only: each test is one program.
 */
#ifndef SALTUS_TESTS_PARSE_DUMP_H
#define SALTUS_TESTS_PARSE_DUMP_H

#include <stdio.h>
#include <string.h>

#include "compiler/front/ast.h"

static void dump_expr(FILE *out, const Expr *e) {
    static const char *const ops[] = {"=", "+",  "-", "*",  "/",  "%",  "&", "|", "^", "<<", ">>", "==", "!=",
                                      "<", "<=", ">", ">=", "&&", "||", "!", "~", "-", "+",  "++", "--"};
    if (!e) {
        fputs("_", out);
        return;
    }
    switch (e->kind) {
    case E_LITERAL:
        if (!e->type) fprintf(out, "\"%s\"", e->name);
        else if (e->type->kind == T_FLOAT) fprintf(out, "%.9gf", e->cval.v[0].f);
        else if (e->type->kind == T_BOOL) fputs(e->cval.v[0].i ? "true" : "false", out);
        else fprintf(out, "%lld%s", (long long)e->cval.v[0].i, e->type->kind == T_UINT ? "u" : "");
        return;
    case E_NAME: fputs(e->name, out); return;
    case E_ERROR: fputs("ERROR", out); return;
    default: break;
    }
    fputc('(', out);
    switch (e->kind) {
    case E_UNARY:
    case E_BINARY:
    case E_LOGIC: fputs(ops[e->op], out); break;
    case E_ASSIGN: fprintf(out, "%s%s", ops[e->op], e->op ? "=" : ""); break;
    case E_INCDEC: fprintf(out, e->prefix ? "%s_" : "_%s", ops[e->op]); break;
    case E_COND: fputs("?:", out); break;
    case E_CALL: fprintf(out, "call %s", e->name); break;
    case E_CONSTRUCT: fprintf(out, "%s %s", e->explicit_cast ? "cast" : "make", e->name); break;
    case E_METHOD: fprintf(out, "method %s", e->name); break;
    case E_FIELD: fprintf(out, ".%s", e->name); break;
    case E_INDEX: fputs("[]", out); break;
    case E_LIST: fputs("list", out); break;
    case E_COMMA: fputs(",", out); break;
    default: fprintf(out, "kind%d", (int)e->kind); break;
    }
    for (int i = 0; i < 3; i++)
        if (e->a[i]) {
            fputc(' ', out);
            dump_expr(out, e->a[i]);
        }
    for (uint32_t i = 0; i < e->nargs; i++) {
        fputc(' ', out);
        dump_expr(out, e->args[i]);
    }
    fputc(')', out);
}

static void dump_type(FILE *out, const TypeRef *t) {
    fputs(t->name, out);
    for (uint32_t i = 0; i < t->ndims; i++) {
        fputc('[', out);
        if (t->dims[i]) dump_expr(out, t->dims[i]);
        fputc(']', out);
    }
}

static void dump_symbol(FILE *out, const Symbol *s) {
    static const char *const modes[] = {"", "out ", "inout "};
    fprintf(out, "(%s%s", s->is_const && s->kind == SYM_LOCAL ? "const " : "", modes[s->mode]);
    dump_type(out, s->type_ref);
    fprintf(out, " %s", s->name);
    if (s->init) {
        fputc(' ', out);
        dump_expr(out, s->init);
    }
    if (s->init_name) fprintf(out, " init %s", s->init_name);
    if (s->asset_text) fprintf(out, " file \"%s\"", s->asset_text);
    if (s->zeros) {
        fputs(" zeros", out);
        for (uint32_t i = 0; i < s->nzeros_args; i++) {
            fputc(' ', out);
            dump_expr(out, s->zeros_args[i]);
        }
    }
    fputc(')', out);
}

static void dump_stmt(FILE *out, const Stmt *st) {
    static const char *const kinds[] = {"",      "decl",     "if",     "for",   "while", "do",    "switch",
                                        "break", "continue", "return", "block", "empty", "print", "assert"};
    if (!st) {
        fputs("_", out);
        return;
    }
    const StmtAttrs *a = &st->attrs;
    if (a->disc) fputs("@Disc ", out);
    if (a->nodisc) fputs("@NoDisc ", out);
    if (a->skip_loop) fputs("@SkipLoop ", out);
    if (a->max_iters) {
        fputs("@MaxIters:", out);
        dump_expr(out, a->max_iters);
        fputc(' ', out);
    }
    if (a->cull_name) fprintf(out, "@Cull:%s ", a->cull_name);
    if (st->kind == S_EXPR) {
        dump_expr(out, st->expr);
        return;
    }
    fprintf(out, "(%s", kinds[st->kind]);
    if (st->kind == S_FOR) {
        fputc(' ', out);
        dump_stmt(out, st->init);
    }
    if (st->expr || st->kind == S_FOR) {
        fputc(' ', out);
        dump_expr(out, st->expr);
    }
    if (st->kind == S_FOR) {
        fputc(' ', out);
        dump_expr(out, st->step);
    }
    for (uint32_t i = 0; i < st->ndecls; i++) {
        fputc(' ', out);
        dump_symbol(out, st->decls[i]);
    }
    for (uint32_t i = 0; i < st->nargs; i++) {
        fputc(' ', out);
        dump_expr(out, st->args[i]);
    }
    for (uint32_t i = 0; i < st->nstmts; i++) {
        fputc(' ', out);
        dump_stmt(out, st->stmts[i]);
    }
    for (uint32_t i = 0; i < st->ncases; i++) {
        fputs(" (", out);
        if (st->cases[i].is_default) fputs("default", out);
        else dump_expr(out, st->cases[i].label_expr);
        for (uint32_t k = 0; k < st->cases[i].nbody; k++) {
            fputc(' ', out);
            dump_stmt(out, st->cases[i].body[k]);
        }
        fputc(')', out);
    }
    if (st->body) {
        fputc(' ', out);
        dump_stmt(out, st->body);
    }
    if (st->orelse) {
        fputs(" else ", out);
        dump_stmt(out, st->orelse);
    }
    fputc(')', out);
}

static void dump_module(FILE *out, const Module *m) {
    for (uint32_t i = 0; i < m->nimports; i++) fprintf(out, "(import %s)\n", m->imports[i].name);
    for (const StructDecl *d = m->struct_decls; d; d = d->next) {
        fprintf(out, "(struct %s", d->name);
        for (uint32_t i = 0; i < d->nfields; i++) {
            fputs(" (", out);
            dump_type(out, d->fields[i].type_ref);
            fprintf(out, " %s)", d->fields[i].name);
        }
        fputs(")\n", out);
    }
    for (const TypedefDecl *d = m->typedefs; d; d = d->next) {
        fprintf(out, "(typedef %s ", d->name);
        dump_type(out, d->type_ref);
        fputs(")\n", out);
    }
    for (const Symbol *s = m->consts; s; s = s->next) {
        fputs("(const ", out);
        dump_symbol(out, s);
        fputs(")\n", out);
    }
    for (const Symbol *s = m->params; s; s = s->next) {
        const ParamAttrs *a = &s->attrs;
        fputs("(param ", out);
        if (a->nodiff) fputs("@NoDiff ", out);
        if (a->color) fputs("@Color ", out);
        if (a->log) fputs("@Log ", out);
        if (a->doc) fprintf(out, "@Doc:%s ", a->doc);
        if (a->has_range) {
            fputs("@Range:", out);
            for (int i = 0; i < 2; i++) dump_expr(out, a->range_args[i]), fputc(' ', out);
        }
        if (a->has_extent) {
            fputs("@Extent:", out);
            for (int i = 0; i < 4; i++) dump_expr(out, a->extent_args[i]), fputc(' ', out);
        }
        if (a->has_height) {
            fputs("@Height:", out);
            for (int i = 0; i < 2; i++) dump_expr(out, a->height_args[i]), fputc(' ', out);
        }
        dump_symbol(out, s);
        fputs(")\n", out);
    }
    for (const Func *f = m->funcs; f; f = f->next) {
        fprintf(out, "(%s ", f->is_shader ? "shader" : "func");
        if (f->nodisc) fputs("@NoDisc ", out);
        if (f->tangent_name) fprintf(out, "@Tangent:%s ", f->tangent_name);
        if (f->has_domain) {
            fputs("@Domain:", out);
            dump_expr(out, f->domain_lo);
            fputc(' ', out);
            dump_expr(out, f->domain_hi);
            fputc(' ', out);
        }
        dump_type(out, f->ret_ref);
        fprintf(out, " %s", f->name);
        for (uint32_t i = 0; i < f->nargs; i++) {
            fputc(' ', out);
            dump_symbol(out, f->args[i]);
        }
        fputc(' ', out);
        dump_stmt(out, f->body);
        fputs(")\n", out);
    }
}

#endif
