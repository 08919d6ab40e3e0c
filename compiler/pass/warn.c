/* Discontinuities that nothing integrates.
 *
 * For every untagged comparison of floats and jumping builtin (recorded by front/gen): does its boundary function
 * depend on the position and on a differentiable parameter, and can its outcome reach an output? Then the place is
 * warned about, unless both sides are equal where the boundary is 0. Sites whose boundary does not depend on the
 * position have no curve: they are warned about and taken out; so are, but for being taken out, those whose boundary
 * function changes with the position by untagged jumps alone. */
#include <math.h>
#include <string.h>

#include "compiler/pass/depend.h"
#include "compiler/pass/slice.h"
#include "compiler/pass/warn.h"

enum { PROOF_BUDGET = 600 }; /* instructions looked at for one comparison */

/* Of each jump without a tag, the decision that was reported for it. */
typedef struct Stepping {
    Span jump;
    Diag *diag;
    uint32_t others; /* that change there too */
} Stepping;

typedef struct Warn {
    PassCtx *ctx;
    Fn *fn;
    Arena *scratch;
    const Depend *dep; /* by id */
    bool *live;        /* by id: can reach an output */
    Inst **inst;       /* by id */
    Vec(Stepping) stepping;
} Warn;

/* ---- are both sides equal on the boundary?
 *
 * Values are numbered structurally with a replaced by b, and with the identities that hold there (0*x = 0, x + 0 = x,
 * ...). The signs of zeros do not matter. */

typedef struct Node {
    uint32_t op, narg;
    uint32_t a[3];
    uint64_t imm;
    const Inst *opaque;
} Node;

typedef struct Proof {
    Warn *w;
    Vec(Node) nodes;
    Vec(const Inst *) seen;
    Vec(uint32_t) seen_node;
    uint32_t from, to; /* node `from` becomes `to` */
    bool substitute, failed;
    uint32_t depth;
} Proof;

static uint32_t node(Proof *p, Node n) {
    for (uint32_t i = 0; i < p->nodes.len; i++) {
        const Node *m = &p->nodes.data[i];
        if (m->op == n.op && m->narg == n.narg && m->imm == n.imm && m->opaque == n.opaque &&
            !memcmp(m->a, n.a, sizeof n.a))
            return i;
    }
    vec_push(p->w->scratch, &p->nodes, n);
    return p->nodes.len - 1;
}

static uint32_t number(Proof *p, double v) {
    uint64_t bits;
    v = v == 0 ? 0 : v;
    memcpy(&bits, &v, sizeof bits);
    return node(p, (Node){.op = OP_constf, .imm = bits});
}

static bool is_number(const Proof *p, uint32_t n, double *v) {
    if (p->nodes.data[n].op != OP_constf) return false;
    memcpy(v, &p->nodes.data[n].imm, sizeof *v);
    return true;
}
static bool equals(const Proof *p, uint32_t n, double v) {
    double x;
    return is_number(p, n, &x) && x == v;
}

static uint32_t build(Proof *p, Op op, uint32_t n, const uint32_t *a, uint64_t imm) {
    double x, y;
    uint32_t c = n > 1 ? a[1] : 0;
    switch (op) {
    case OP_fadd:
        if (equals(p, a[0], 0)) return c;
        if (equals(p, c, 0)) return a[0];
        for (int k = 0; k < 2; k++) { /* u + (v - u) = v */
            const Node *m = &p->nodes.data[a[1 - k]];
            if (m->op == OP_fsub && m->a[1] == a[k]) return m->a[0];
            if (m->op == OP_fneg && m->a[0] == a[k]) return number(p, 0);
        }
        if (is_number(p, a[0], &x) && is_number(p, c, &y)) return number(p, x + y);
        break;
    case OP_fsub:
        if (a[0] == c) return number(p, 0);
        if (equals(p, c, 0)) return a[0];
        if (equals(p, a[0], 0)) return build(p, OP_fneg, 1, &c, 0);
        if (is_number(p, a[0], &x) && is_number(p, c, &y)) return number(p, x - y);
        break;
    case OP_fmul:
        if (equals(p, a[0], 0) || equals(p, c, 0)) return number(p, 0);
        if (equals(p, a[0], 1)) return c;
        if (equals(p, c, 1)) return a[0];
        if (is_number(p, a[0], &x) && is_number(p, c, &y)) return number(p, x * y);
        break;
    case OP_fdiv:
        if (equals(p, a[0], 0)) return a[0];
        if (equals(p, c, 1)) return a[0];
        if (a[0] == c) return number(p, 1);
        if (is_number(p, a[0], &x) && is_number(p, c, &y)) return number(p, x / y);
        break;
    case OP_ffma: {
        uint32_t m = build(p, OP_fmul, 2, a, 0), s[2] = {m, a[2]};
        return build(p, OP_fadd, 2, s, 0);
    }
    case OP_fneg:
        if (is_number(p, a[0], &x)) return number(p, -x);
        if (p->nodes.data[a[0]].op == OP_fneg) return p->nodes.data[a[0]].a[0];
        break;
    case OP_fabs:
        if (is_number(p, a[0], &x)) return number(p, fabs(x));
        break;
    case OP_fsqrt:
        if (is_number(p, a[0], &x) && x >= 0) return number(p, sqrt(x));
        break;
    case OP_fmin:
    case OP_fmax:
        if (a[0] == c) return c;
        if (is_number(p, a[0], &x) && is_number(p, c, &y)) return number(p, op == OP_fmin ? fmin(x, y) : fmax(x, y));
        break;
    case OP_fsin:
    case OP_fatan:
    case OP_fasin:
    case OP_fsinh:
    case OP_ftanh:
    case OP_ftan:
        if (equals(p, a[0], 0)) return a[0];
        break;
    case OP_fexp:
    case OP_fcos:
        if (equals(p, a[0], 0)) return number(p, 1);
        break;
    case OP_fpow:
        if (is_number(p, a[0], &x) && is_number(p, c, &y)) return number(p, pow(x, y));
        break;
    case OP_detach: return a[0];
    case OP_fsel:
    case OP_isel:
    case OP_bsel:
        if (a[1] == a[2]) return a[1];
        break;
    default: break;
    }
    Node m = {.op = op, .narg = n, .imm = imm};
    for (uint32_t i = 0; i < n; i++) m.a[i] = a[i];
    bool commutes = op == OP_fadd || op == OP_fmul || op == OP_fmin || op == OP_fmax || op == OP_iadd || op == OP_imul;
    if (commutes && m.a[1] < m.a[0]) {
        uint32_t t = m.a[0];
        m.a[0] = m.a[1], m.a[1] = t;
    }
    return node(p, m);
}

static uint32_t canon(Proof *p, const Inst *i);

static uint32_t canon_fresh(Proof *p, const Inst *i) {
    if (i->op == OP_constf) return number(p, i->imm.f);
    if (i->op == OP_consti || i->op == OP_constb || i->op == OP_input)
        return node(p, (Node){.op = i->op, .imm = (uint64_t)i->imm.i});
    Node opaque = {.op = OP_COUNT, .opaque = i};
    if (++p->depth > 200 || p->seen.len > PROOF_BUDGET) {
        p->failed = true;
        return node(p, opaque);
    }
    uint32_t out;
    if (i->op == OP_proj && i->args[0]->op == OP_if_) {
        uint32_t x = canon(p, i->args[0]->region[0]->last->args[i->imm.i]),
                 y = canon(p, i->args[0]->region[1]->last->args[i->imm.i]);
        out = x == y ? x : node(p, opaque);
    } else if ((ir_ops[i->op].special && i->op != OP_param && i->op != OP_iparam && i->op != OP_detach &&
                i->op != OP_site && i->op != OP_siten) ||
               i->nargs > 3) {
        out = node(p, opaque);
    } else if (i->op == OP_site || i->op == OP_siten) {
        out = canon(p, i->args[0]);
    } else {
        uint32_t a[3] = {0};
        for (uint32_t k = 0; k < i->nargs; k++) a[k] = canon(p, i->args[k]);
        uint64_t imm =
            i->op == OP_param || i->op == OP_iparam ? (uint64_t)i->imm.slot.base << 32 | i->imm.slot.count : 0;
        out = build(p, (Op)i->op, i->nargs, a, imm);
    }
    p->depth--;
    return out;
}

static uint32_t canon(Proof *p, const Inst *i) {
    for (uint32_t k = 0; k < p->seen.len; k++)
        if (p->seen.data[k] == i) return p->seen_node.data[k];
    uint32_t n = canon_fresh(p, i);
    if (p->substitute && n == p->from) n = p->to;
    vec_push(p->w->scratch, &p->seen, i);
    vec_push(p->w->scratch, &p->seen_node, n);
    return n;
}

static bool writes(const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_store || i->op == OP_acopy) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (writes(i->region[r])) return true;
    }
    return false;
}

typedef Vec(Inst *) Uses;

/* Uses of the comparison: `uses` has every live instruction that reads it or its negation. */
static bool both_sides_equal(Warn *w, const Untracked *t, const Uses *uses) {
    if (t->kind != JUMP_COMPARE || !t->g1) return false;
    Proof p = {.w = w};
    uint32_t a = canon(&p, t->g0), b = canon(&p, t->g1);
    double v;
    bool swap = is_number(&p, a, &v);
    p.from = swap ? b : a, p.to = swap ? a : b;
    p.substitute = true;
    p.seen.len = p.seen_node.len = 0;
    for (uint32_t u = 0; u < uses->len; u++) {
        const Inst *i = uses->data[u];
        if (i->op == OP_bnot) continue; /* the uses of the negation are in the list as well */
        if (i->op == OP_fsel || i->op == OP_isel || i->op == OP_bsel) {
            for (uint32_t k = 1; k < 3; k++)
                if (i->args[k] == t->at || (i->args[k]->op == OP_bnot && i->args[k]->args[0] == t->at)) return false;
            if (canon(&p, i->args[1]) != canon(&p, i->args[2])) return false;
        } else if (i->op == OP_if_) {
            if (writes(i->region[0]) || writes(i->region[1])) return false;
            for (const Inst *q = i->next; q && q->op == OP_proj && q->args[0] == i; q = q->next)
                if (w->live[q->id] &&
                    canon(&p, i->region[0]->last->args[q->imm.i]) != canon(&p, i->region[1]->last->args[q->imm.i]))
                    return false;
        } else {
            return false;
        }
        if (p.failed) return false;
    }
    return true;
}

/* An if_ uses its condition if one of its results is alive or something inside is stored or alive through a store. */
static bool if_alive(const Warn *w, const Inst *i) {
    for (const Inst *q = i->next; q && q->op == OP_proj && q->args[0] == i; q = q->next)
        if (w->live[q->id]) return true;
    return writes(i->region[0]) || writes(i->region[1]);
}

/* which[id]: index + 1 of the untracked comparison whose value (or negation) the instruction is; 0: of none. */
static void collect_uses(Warn *w, Block *b, uint32_t *which, Uses *uses) {
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t a = 0; a < i->nargs; a++) {
            uint32_t of = which[i->args[a]->id];
            if (!of) continue;
            if (i->op == OP_bnot) which[i->id] = of;
            else if (i->op == OP_if_ ? if_alive(w, i) : i->op == OP_yield || w->live[i->id])
                vec_push(w->scratch, &uses[of - 1], i);
        }
        for (uint32_t r = 0; r < i->nregions; r++) collect_uses(w, i->region[r], which, uses);
    }
}

/* ---- reporting */

static const char *param_list(Warn *w, const Depend *d) {
    const char *text = "";
    for (uint32_t i = 0; i < d->nnamed; i++)
        text = arena_printf(w->fn->arena, "%s%s`%s`", text,
                            i == 0               ? ""
                            : i + 1 == d->nnamed ? " and "
                                                 : ", ",
                            w->ctx->program->params[d->named[i]].name);
    return text;
}

/* ---- tagged decisions that jumps make which are not tagged */

/* In GLSL what is [NoDisc] is so on purpose, mostly our own (the ends of marches). */
static bool is_silenced(const Warn *w, Span span) {
    const Program *p = w->ctx->program;
    for (uint32_t k = 0; p->is_glsl && k < p->nsilenced; k++)
        if (p->silenced[k].file == span.file && p->silenced[k].pos == span.pos) return true;
    return false;
}

/* The first of the jumps that v hangs on. */
static const Inst *find_jump(Warn *w, Inst *v) {
    Slice from = slice_begin(w->fn, w->scratch, false);
    slice_add(&from, v);
    slice_close(&from);
    const Inst *first = NULL;
    for (uint32_t id = 0; id < w->fn->ninsts; id++)
        if (from.in[id] && w->inst[id] && depend_jumps(w->dep, w->inst[id]) && (!first || id < first->id) &&
            !is_silenced(w, w->inst[id]->span))
            first = w->inst[id];
    return first;
}

/* Nothing crosses 0 where a decision by constants changes, so nothing there is integrated. */
static void report_stepping(Warn *w, Inst *g, Span span) {
    const Depend *d = &w->dep[g->id];
    if (!(d->on & DEPENDS_JUMPS) || d->on & DEPENDS_SLOPE) return;
    /* Sites of skipped loops have their decision used before them: it is tagged, and does not look so. */
    for (uint32_t s = 0; s < w->fn->nsites; s++)
        if (w->fn->sites[s].skip_loop) return;
    const Inst *jump = find_jump(w, g);
    if (!jump && w->ctx->program->is_glsl) return;
    /* One tag is missing however many decisions there are. */
    for (uint32_t k = 0; jump && k < w->stepping.len; k++) {
        Stepping *at = &w->stepping.data[k];
        if (at->jump.file != jump->span.file || at->jump.pos != jump->span.pos) continue;
        at->others++;
        return;
    }
    Diag *diag = diag_emit(w->ctx->session, DIAG_stepping, span, param_list(w, d));
    if (!diag || !jump) return;
    diag_note(w->ctx->session, diag, jump->span, "it jumps here: [Disc] belongs on this statement");
    vec_push(w->scratch, &w->stepping, ((Stepping){jump->span, diag, 0}));
}

static void tell_others(const Warn *w) {
    for (uint32_t k = 0; k < w->stepping.len; k++) {
        const Stepping *at = &w->stepping.data[k];
        if (at->others)
            diag_note(w->ctx->session, at->diag, at->jump, "decisions elsewhere that change here as well: %u",
                      at->others);
    }
}

/* It jumps wherever it changes: no probe is needed. */
static bool is_always(JumpKind kind) { return kind == JUMP_ALWAYS || kind == JUMP_TRACE || kind == JUMP_PIECES; }

static void report_untracked(Warn *w) {
    const Program *program = w->ctx->program;
    uint32_t n = program->nuntracked;
    if (!n) return;
    uint32_t *which = ARENA_ARRAY(w->scratch, uint32_t, w->fn->ninsts + 1);
    Uses *uses = ARENA_ARRAY(w->scratch, Uses, n);
    const Untracked **ask = ARENA_ARRAY(w->scratch, const Untracked *, n),
                    **probe = ARENA_ARRAY(w->scratch, const Untracked *, n);
    Depend *of = ARENA_ARRAY(w->scratch, Depend, n);
    uint32_t asked = 0;
    for (uint32_t i = 0; i < n; i++) which[program->untracked[i].at->id] = i + 1;
    collect_uses(w, w->fn->body, which, uses);
    for (uint32_t i = 0; i < n; i++) {
        const Untracked *t = &program->untracked[i];
        if (!w->live[t->at->id] || t->kind == JUMP_SKIPPED) continue;
        if (t->kind == JUMP_INTEGER) {
            report_stepping(w, t->at, t->span);
            continue;
        }
        const bool pieces = t->kind == JUMP_PIECES;
        if (pieces && !warn_pieces(w->fn, t->at, program->geometries[t->at->imm.query.geometry].nfaces > 1)) continue;
        Depend d = {0};
        if (t->g0) depend_merge(&d, &w->dep[t->g0->id]);
        if (t->g1) depend_merge(&d, &w->dep[t->g1->id]);
        if (is_always(t->kind)) depend_merge(&d, &w->dep[t->at->id]);
        if (t->kind == JUMP_EQUALITY && !(d.on & DEPENDS_PIECES)) continue; /* the equality holds on a curve at most */
        if (!(d.on & DEPENDS_PARAM) || !(pieces || program->of_elements || d.on & (DEPENDS_X | DEPENDS_RAND)) ||
            both_sides_equal(w, t, &uses[i]))
            continue;
        /* What changes by jumps alone changes where they do: those are asked themselves, or tagged. */
        if (!program->of_elements && !(d.on & (DEPENDS_SLOPE | DEPENDS_RAND)) &&
            ((d.on & DEPENDS_JUMPS) || !(d.on & DEPENDS_VALUE)))
            continue;
        if (!(d.on & DEPENDS_X)) {
            diag_emit(w->ctx->session, DIAG_static_disc, t->span, param_list(w, &d));
            continue;
        }
        of[asked] = d, ask[asked++] = t;
    }
    /* A value that cannot be a site changes everywhere: nothing can be told by where it does. */
    bool *shows = ARENA_ARRAY(w->scratch, bool, asked + 1);
    uint32_t probed = 0;
    for (uint32_t i = 0; i < asked; i++)
        if (!is_always(ask[i]->kind)) probe[probed++] = ask[i];
    warn_probe(w->ctx, w->fn, w->dep, probe, probed, shows);
    for (uint32_t i = 0, at = 0; i < asked; i++) {
        const Untracked *t = ask[i];
        if (!is_always(t->kind) && !shows[at++]) continue;
        const char *what = t->kind == JUMP_COMPARE || t->kind == JUMP_EQUALITY ? "this comparison"
                           : t->kind == JUMP_PIECES ? "what counts visible pieces otherwise than by `area`"
                           : t->kind == JUMP_BUILTIN || t->kind == JUMP_TRACE ? "the argument of this jumping function"
                                                                              : "this value, which cannot be a site,";
        w->ctx->untracked = true;
        diag_emit(w->ctx->session, DIAG_untracked, t->span, what, param_list(w, &of[i]));
    }
}

/* A static site whose decision can change. */
static void report_static(Warn *w, const Inst *site, Span span) {
    const Depend *d = &w->dep[site->args[1]->id];
    if (!w->ctx->program || !w->live[site->id]) return;
    if (d->on & DEPENDS_PARAM) diag_emit(w->ctx->session, DIAG_static_disc, span, param_list(w, d));
    else if (d->on & DEPENDS_RAND) diag_emit(w->ctx->session, DIAG_static_disc, span, "random numbers");
}

static void report_decisions(Warn *w, const Block *b) {
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) report_decisions(w, i->region[r]);
        if ((i->op == OP_site || i->op == OP_siten) && w->live[i->id] && !ir_site_of_ray(w->fn->sites[i->imm.i].kind))
            report_stepping(w, i->args[1], w->fn->sites[i->imm.i].span);
    }
}

static void find_insts(Warn *w, Block *b) {
    for (Inst *i = b->first; i; i = i->next) {
        w->inst[i->id] = i;
        for (uint32_t r = 0; r < i->nregions; r++) find_insts(w, i->region[r]);
    }
}

typedef struct Renumber {
    Inst **map;      /* by id: the decision that stands for a dropped site, the bound for its window */
    SiteInfo *infos; /* of the sites kept */
    uint32_t kept;
    int32_t *number; /* by old number: the new one; -1: dropped */
} Renumber;

static void drop_static(Warn *w, Block *b, Renumber *to) {
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) drop_static(w, i->region[r], to);
        if (i->op != OP_site && i->op != OP_siten) continue;
        const SiteInfo *info = &w->fn->sites[i->imm.i];
        if (w->dep[i->args[1]->id].on & DEPENDS_X) {
            to->infos[to->kept] = *info;
            to->number[i->imm.i] = (int32_t)to->kept;
            i->imm.i = to->kept++;
            continue;
        }
        report_static(w, i, info->span);
        to->map[i->id] = i->args[0];
        ir_unlink(i);
    }
}

/* Windows go by the number of their site; those of a dropped one are dead. */
static void number_windows(Block *b, const Renumber *to) {
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) number_windows(i->region[r], to);
        if (i->op != OP_window) continue;
        int32_t site = to->number[i->imm.i / 2];
        if (site >= 0) {
            i->imm.i = 2 * site + (i->imm.i & 1);
            continue;
        }
        to->map[i->id] = i->args[0];
        ir_unlink(i);
    }
}

static void keep_skipped(const Fn *fn, Slice *live, const Block *b) {
    for (Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_site && fn->sites[i->imm.i].skip_loop) slice_add(live, i);
        for (uint32_t r = 0; r < i->nregions; r++) keep_skipped(fn, live, i->region[r]);
    }
}

static void find_live(Warn *w) {
    Inst *outputs = w->fn->body->last;
    Slice live = slice_begin(w->fn, w->scratch, true);
    keep_skipped(w->fn, &live, w->fn->body);
    for (uint32_t i = 0; i < outputs->nargs; i++) slice_add(&live, outputs->args[i]);
    slice_close(&live);
    w->live = live.in;
}

bool warn_jumps(PassCtx *ctx, Fn *fn) {
    Arena *scratch = &ctx->session->scratch;
    ArenaMark at = arena_mark(scratch);
    uint32_t n = ir_number(fn);
    Warn w = {.ctx = ctx, .fn = fn, .scratch = scratch};
    w.dep = depend_values(fn, (DependOptions){.program = ctx->program});
    w.inst = ARENA_ARRAY(scratch, Inst *, n + 1);
    find_insts(&w, fn->body);
    find_live(&w);
    if (ctx->program) report_untracked(&w), report_decisions(&w, fn->body), tell_others(&w);

    Renumber to = {.map = ARENA_ARRAY(scratch, Inst *, n + 1),
                   .infos = ARENA_ARRAY(fn->arena, SiteInfo, fn->nsites + 1),
                   .number = ARENA_ARRAY(scratch, int32_t, fn->nsites + 1)};
    for (uint32_t i = 0; i < fn->nsites; i++) to.number[i] = -1;
    drop_static(&w, fn->body, &to);
    /* Numbers go by the order of the program, which a pass that makes sites leaves to this one. */
    bool changed = false;
    for (uint32_t i = 0; i < fn->nsites; i++) changed |= to.number[i] != (int32_t)i;
    if (changed) {
        number_windows(fn->body, &to);
        for (uint32_t i = 0; i < n; i++) /* a decision may be that of another dropped site */
            while (to.map[i] && to.map[i]->id < n && to.map[to.map[i]->id]) to.map[i] = to.map[to.map[i]->id];
        ir_replace_all(fn, to.map);
    }
    fn->sites = to.infos;
    fn->nsites = to.kept;
    arena_reset(scratch, at);
    return changed;
}
