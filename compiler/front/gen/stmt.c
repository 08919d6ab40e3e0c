/* Statements. break, continue and early return become flags, or no flag at all where one branch of an if always jumps:
 * then the rest of the list is the other branch. */
#include <string.h>

#include "compiler/front/gen/internal.h"

/* ---- which jumps leave a statement, and can it fall through? */

static Jumps then_jumps(Jumps a, Jumps b) {
    if (!a.falls) return a;
    return (Jumps){b.falls, a.brk | b.brk, a.cnt | b.cnt, a.ret | b.ret};
}

static Jumps list_jumps(Stmt *const *stmts, uint32_t n) {
    Jumps j = {.falls = true};
    for (uint32_t i = 0; i < n && j.falls; i++) j = then_jumps(j, stmt_jumps(stmts[i]));
    return j;
}

Jumps stmt_jumps(const Stmt *s) {
    Jumps j = {.falls = true};
    if (!s) return j;
    switch (s->kind) {
    case S_BREAK: return (Jumps){.brk = true};
    case S_CONTINUE: return (Jumps){.cnt = true};
    case S_RETURN: return (Jumps){.ret = true};
    case S_BLOCK: return list_jumps(s->stmts, s->nstmts);
    case S_IF: {
        Jumps a = stmt_jumps(s->body), b = stmt_jumps(s->orelse);
        return (Jumps){a.falls | b.falls, a.brk | b.brk, a.cnt | b.cnt, a.ret | b.ret};
    }
    case S_FOR:
    case S_WHILE:
    case S_DO: j.ret = stmt_jumps(s->body).ret; return j;
    case S_SWITCH:
        for (uint32_t c = 0; c < s->ncases; c++) {
            Jumps b = list_jumps(s->cases[c].body, s->cases[c].nbody);
            j.cnt |= b.cnt, j.ret |= b.ret;
        }
        return j;
    case S_EXPR:
    case S_DECL:
    case S_EMPTY:
    case S_PRINT:
    case S_ASSERT: break;
    }
    return j;
}

/* Is some jump that s may take still undecided here? NULL: certainly none; else "we are still here". */
static Inst *still_here(Lower *l, Jumps j) {
    Inst *gone = NULL;
    Var *flags[3] = {j.brk ? l->frame->brk : NULL, j.cnt ? l->frame->cnt : NULL, j.ret ? l->frame->ret_flag : NULL};
    for (int i = 0; i < 3; i++) {
        if (!flags[i]) continue;
        Inst *f = flags[i]->value;
        if (!f || is_false(f)) continue;
        gone = gone ? op2(l, OP_bor, gone, f) : f;
    }
    return gone ? op1(l, OP_bnot, gone) : NULL;
}

/* ---- lists */

static Stmt **joined(Lower *l, Stmt *first, Stmt **rest, uint32_t n, uint32_t *len) {
    Stmt **out = ARENA_ARRAY(l->arena, Stmt *, n + 1);
    uint32_t at = 0;
    if (first) out[at++] = first;
    for (uint32_t i = 0; i < n; i++) out[at++] = rest[i];
    *len = at;
    return out;
}

static Inst *if_condition(Lower *l, Stmt *s) {
    Tag tag = l->tag;
    l->tag = tag_for(l, s);
    Inst *c;
    if (s->attrs.skip_loop && l->frame->first_loop && !l->quiet && !l->in_tangent)
        c = gen_skip_condition(l, s->expr, l->frame->first_loop);
    else c = gen_scalar(l, s->expr);
    l->tag = tag;
    return c;
}

/* The two branches; then_list and else_list may hold what follows the statement. */
static void gen_if(Lower *l, Stmt *s, Stmt **then_list, uint32_t nthen, Stmt **else_list, uint32_t nelse) {
    Inst *c = if_condition(l, s);
    Tag tag = l->tag;
    bool skip = s->attrs.skip_loop && l->frame->first_loop && !l->quiet && !l->in_tangent;
    if (ir_is_const(c)) {
        if (c->imm.i) gen_list(l, then_list, nthen);
        else gen_list(l, else_list, nelse);
        return;
    }
    IfCtx ctx;
    if_begin(l, &ctx, c);
    if (skip && nthen && then_list[0] == s->body) { /* only the guarded statement belongs to the skipped site */
        l->tag.skip = l->frame->first_loop;
        gen_list(l, then_list, 1);
        l->tag = tag;
        if (nthen > 1) gen_list(l, then_list + 1, nthen - 1);
    } else {
        gen_list(l, then_list, nthen);
    }
    if_else(l, &ctx);
    gen_list(l, else_list, nelse);
    if_end(l, &ctx);
}

static void gen_guarded(Lower *l, Jumps j, Stmt **rest, uint32_t n) {
    Inst *here = still_here(l, j);
    if (!here) {
        gen_list(l, rest, n);
    } else if (ir_is_const(here)) {
        if (here->imm.i) gen_list(l, rest, n);
    } else {
        IfCtx c;
        if_begin(l, &c, here);
        gen_list(l, rest, n);
        if_else(l, &c);
        if_end(l, &c);
    }
}

/* Many jumps in one list: instead of nesting the rest in each, every piece between two of them is guarded by itself. */
enum { MANY_JUMPS = 24 };

/* What is declared in one piece is used in later ones, so it must exist outside of the guards. */
static void declare_outside(Lower *l, Stmt **stmts, uint32_t n) {
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t k = 0; stmts[i]->kind == S_DECL && k < stmts[i]->ndecls; k++) {
            Symbol *sym = stmts[i]->decls[k];
            *gen_bind(l, sym) = (Bind){.kind = BIND_VARS, .vars = vars_for(l, sym->type), .ready = true};
        }
}

static void gen_flat(Lower *l, Stmt **stmts, uint32_t n) {
    Jumps so_far = {.falls = true};
    for (uint32_t i = 0; i < n && so_far.falls;) {
        uint32_t end = i;
        Jumps j = {.falls = true};
        while (end < n && !j.brk && !j.cnt && !j.ret) j = then_jumps(j, stmt_jumps(stmts[end++]));
        if (end - i > 1 && (j.brk || j.cnt || j.ret)) end--, j = (Jumps){.falls = true};
        declare_outside(l, stmts + i, end - i);
        gen_guarded(l, so_far, stmts + i, end - i);
        so_far = then_jumps(so_far, j);
        i = end;
    }
}

void gen_list(Lower *l, Stmt **stmts, uint32_t n) {
    if (n > MANY_JUMPS) {
        uint32_t jumping = 0;
        for (uint32_t i = 0; i < n; i++) {
            Jumps j = stmt_jumps(stmts[i]);
            jumping += j.brk || j.cnt || j.ret;
        }
        if (jumping > MANY_JUMPS) {
            gen_flat(l, stmts, n);
            return;
        }
    }
    for (uint32_t i = 0; i < n; i++) {
        Stmt *s = stmts[i];
        if (!s) continue;
        Jumps j = stmt_jumps(s);
        bool jumps = j.brk || j.cnt || j.ret;
        if (!jumps) {
            gen_stmt(l, s);
            continue;
        }
        Stmt **rest = stmts + i + 1;
        uint32_t nrest = j.falls ? n - i - 1 : 0, na, nb;
        if (s->kind == S_BLOCK) {
            Stmt **all = ARENA_ARRAY(l->arena, Stmt *, s->nstmts + nrest + 1);
            for (uint32_t k = 0; k < s->nstmts; k++) all[k] = s->stmts[k];
            for (uint32_t k = 0; k < nrest; k++) all[s->nstmts + k] = rest[k];
            gen_list(l, all, s->nstmts + nrest);
            return;
        }
        if (s->kind == S_IF) {
            bool then_falls = stmt_jumps(s->body).falls, else_falls = stmt_jumps(s->orelse).falls;
            if (!then_falls || !else_falls || !nrest) {
                Stmt **a = joined(l, s->body, rest, then_falls && !else_falls ? nrest : 0, &na);
                Stmt **b = joined(l, s->orelse, rest, else_falls && !then_falls ? nrest : 0, &nb);
                gen_if(l, s, a, na, b, nb);
                return;
            }
        }
        gen_stmt(l, s);
        if (nrest) gen_guarded(l, j, rest, nrest);
        return;
    }
}

/* ---- tags */

Tag tag_for(Lower *l, const Stmt *s) {
    Tag t = l->tag;
    const Frame *f = l->frame;
    bool library = f && f->library, hushed = library && f->quiet;
    t.nodisc = s->attrs.nodisc || (f && f->func->nodisc) || hushed;
    t.own = s->attrs.disc && !hushed;
    t.disc = t.own || ((library ? f->asked : l->opt->front.disc_auto) && !t.nodisc);
    t.by_auto = !t.own && (!library || f->by_auto);
    if (s->kind == S_PRINT || s->kind == S_ASSERT) t.disc = false, t.nodisc = true;
    return t;
}

/* ---- switch */

typedef struct Group {
    Inst *match;
    Stmt **body;
    uint32_t n;
    bool is_default;
} Group;

static void gen_groups(Lower *l, Group *g, uint32_t n) {
    if (!n) return;
    if (n == 1 && g->is_default) {
        gen_list(l, g->body, g->n);
        return;
    }
    if (ir_is_const(g->match)) {
        if (g->match->imm.i) gen_list(l, g->body, g->n);
        else gen_groups(l, g + 1, n - 1);
        return;
    }
    IfCtx c;
    if_begin(l, &c, g->match);
    gen_list(l, g->body, g->n);
    if_else(l, &c);
    gen_groups(l, g + 1, n - 1);
    if_end(l, &c);
}

static void gen_switch(Lower *l, Stmt *s) {
    Tag tag = l->tag;
    l->tag = tag_for(l, s);
    Inst *v = gen_scalar(l, s->expr);
    l->tag = tag;
    Var *outer = l->frame->brk;
    Var *brk = var_new(l, TY_BOOL, 1);
    brk->value = kb(l, false);
    l->frame->brk = brk;
    /* Cases without a body share the next one's. */
    Group *groups = ARENA_ARRAY(l->arena, Group, s->ncases + 1);
    uint32_t n = 0;
    bool chain = true;
    Inst *any = kb(l, false), *match = kb(l, false);
    bool is_default = false;
    for (uint32_t c = 0; c < s->ncases; c++) {
        SwitchCase *sc = &s->cases[c];
        if (sc->is_default) {
            is_default = true;
        } else {
            Inst *hit = op2(l, OP_ieq, v, ki(l, (int32_t)(uint32_t)sc->label));
            match = op2(l, OP_bor, match, hit);
            any = op2(l, OP_bor, any, hit);
        }
        if (!sc->nbody && c + 1 < s->ncases) continue;
        groups[n++] = (Group){match, sc->body, sc->nbody, is_default};
        if (c + 1 < s->ncases && list_jumps(sc->body, sc->nbody).falls) chain = false;
        match = kb(l, false);
        is_default = false;
    }
    Inst *none = op1(l, OP_bnot, any);
    for (uint32_t g = 0; g < n; g++)
        if (groups[g].is_default && (g + 1 < n || !chain))
            groups[g].match = op2(l, OP_bor, groups[g].match, none), groups[g].is_default = false;
    if (chain && n <= 48) {
        gen_groups(l, groups, n);
    } else {
        /* Falling through: a group runs if it matches or the one before fell into it. */
        Inst *fell = kb(l, false);
        for (uint32_t g = 0; g < n; g++) {
            Jumps j = list_jumps(groups[g].body, groups[g].n);
            Inst *enter = groups[g].is_default ? op2(l, OP_bor, none, groups[g].match) : groups[g].match;
            enter = op2(l, OP_bor, enter, fell);
            Var *through = var_new(l, TY_BOOL, 1);
            through->value = kb(l, false);
            IfCtx c;
            if_begin(l, &c, enter);
            gen_list(l, groups[g].body, groups[g].n);
            if (j.falls) {
                Inst *here = still_here(l, j);
                var_set(l, through, here ? here : kb(l, true));
            }
            if_else(l, &c);
            if_end(l, &c);
            fell = through->value;
        }
    }
    l->frame->brk = outer;
}

/* ---- print and assert */

typedef struct TextBuffer {
    char *data;
    uint32_t len, cap;
} TextBuffer;
static void text_add(Lower *l, TextBuffer *t, const char *s, uint32_t n) {
    if (t->len + n + 1 > t->cap) {
        uint32_t cap = (t->len + n + 1) * 2;
        char *data = arena_alloc(l->arena, cap);
        if (t->len) memcpy(data, t->data, t->len);
        t->data = data, t->cap = cap;
    }
    memcpy(t->data + t->len, s, n);
    t->len += n;
    t->data[t->len] = 0;
}

typedef struct PrintList {
    TextBuffer text;
    Vec(Inst *) values;
} PrintList;

static void print_value(Lower *l, PrintList *p, Expr *e) {
    Val v = gen_expr(l, e);
    text_add(l, &p->text, v.n > 1 ? "(" : "", v.n > 1);
    for (uint32_t i = 0; i < v.n; i++) {
        if (v.c[i]->type == TY_ARRAY) continue;
        if (i) text_add(l, &p->text, ", ", 2);
        text_add(l, &p->text, "{}", 2);
        Inst *x = v.c[i];
        if (x->type == TY_INT && scalar_of(v.type)->kind == T_UINT) x = op1(l, OP_u2f, x);
        vec_push(l->arena, &p->values, x);
    }
    text_add(l, &p->text, v.n > 1 ? ")" : "", v.n > 1);
}

/* Strings and values in order; `{}` in a string takes the next value. */
static void gen_print(Lower *l, Stmt *s) {
    PrintList p = {0};
    bool *used = ARENA_ARRAY(l->arena, bool, s->nargs + 1);
    text_add(l, &p.text, "", 0);
    for (uint32_t i = 0; i < s->nargs; i++) {
        Expr *e = s->args[i];
        if (used[i]) continue;
        if (e->type || !e->name) {
            if (p.text.len && p.text.data[p.text.len - 1] != ' ' && p.text.data[p.text.len - 1] != '=')
                text_add(l, &p.text, " ", 1);
            print_value(l, &p, e);
            continue;
        }
        for (const char *c = e->name; *c; c++) {
            if (c[0] == '{' && c[1] == '}') {
                uint32_t next = i + 1;
                while (next < s->nargs && (used[next] || !s->args[next]->type)) next++;
                if (next < s->nargs) {
                    used[next] = true;
                    print_value(l, &p, s->args[next]);
                    c++;
                    continue;
                }
            }
            text_add(l, &p.text, c, 1);
        }
    }
    special(l, OP_print, TY_VOID, p.values.len, p.values.data, (Imm){.text = {p.text.data, p.text.len}});
    l->program->uses_prints = true;
}

/* ---- statements */

static void gen_decl(Lower *l, Symbol *sym) {
    Bind *b = gen_bind(l, sym);
    const Layout *layout = gen_layout(l, sym->type);
    if (b->ready) {
        b->ready = false;
        if (sym->init) vars_store(l, sym->type, b->vars, gen_expr(l, sym->init), false);
        return;
    }
    if (!sym->init) {
        *b = (Bind){.kind = BIND_VARS, .vars = vars_for(l, sym->type)};
        return;
    }
    if (expr_assigns(sym->init)) { /* to itself, perhaps: `int a = a = 1;` */
        *b = (Bind){.kind = BIND_VARS, .vars = vars_for(l, sym->type)};
        vars_store(l, sym->type, b->vars, gen_expr(l, sym->init), false);
        return;
    }
    Val v = gen_expr(l, sym->init);
    bool fresh = !gen_is_place(sym->init) && sym->init->kind != E_COND && sym->init->kind != E_COMMA &&
                 sym->init->kind != E_ASSIGN;
    Var *vars = var_new(l, TY_VOID, layout->n);
    for (uint32_t i = 0; i < layout->n; i++) {
        vars[i].type = layout->leaf[i].count ? TY_ARRAY : layout->leaf[i].type;
        vars[i].value = v.c[i];
        if (!layout->leaf[i].count || fresh) continue;
        Inst *args[2] = {alloc_array(l, layout->leaf[i].type, layout->leaf[i].count), v.c[i]};
        special(l, OP_acopy, TY_VOID, 2, args, (Imm){0});
        vars[i].value = args[0];
    }
    *b = (Bind){.kind = BIND_VARS, .vars = vars};
}

static void gen_simple(Lower *l, Stmt *s) {
    switch (s->kind) {
    case S_EXPR:
        if (s->expr) gen_expr(l, s->expr);
        break;
    case S_DECL:
        for (uint32_t i = 0; i < s->ndecls; i++) gen_decl(l, s->decls[i]);
        break;
    case S_RETURN:
        if (s->expr) vars_store(l, l->frame->func->ret, l->frame->ret, gen_expr(l, s->expr), false);
        var_set(l, l->frame->ret_flag, kb(l, true));
        break;
    case S_BREAK: var_set(l, l->frame->brk, kb(l, true)); break;
    case S_CONTINUE: var_set(l, l->frame->cnt, kb(l, true)); break;
    case S_PRINT: gen_print(l, s); break;
    case S_ASSERT: {
        Inst *fails = op1(l, OP_bnot, gen_scalar(l, s->expr));
        if (!is_false(fails)) special(l, OP_count, TY_VOID, 1, &fails, (Imm){.i = COUNTER_ASSERT});
        break;
    }
    default: break;
    }
}

void gen_stmt(Lower *l, Stmt *s) {
    l->b.span = gen_shown(l, s->span);
    switch (s->kind) {
    case S_BLOCK: {
        Tag tag = l->tag;
        gen_list(l, s->stmts, s->nstmts);
        l->tag = tag;
        break;
    }
    case S_IF: gen_if(l, s, &s->body, s->body ? 1 : 0, &s->orelse, s->orelse ? 1 : 0); break;
    case S_FOR:
    case S_WHILE:
    case S_DO: gen_loop(l, s); break;
    case S_SWITCH: gen_switch(l, s); break;
    case S_EMPTY: break;
    default: {
        Tag tag = l->tag;
        l->tag = tag_for(l, s);
        gen_simple(l, s);
        l->tag = tag;
    }
    }
}
