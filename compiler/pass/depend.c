/* A forward data flow: one walk in program order, repeated until nothing changes. */
#include "compiler/pass/depend.h"

#include "compiler/pass/walk.h"

typedef struct Flow {
    DependOptions options;
    Depend *of;               /* by id */
    bool changed, comes_back; /* to what the walk has passed: by loops and stores */
} Flow;

bool depend_merge(Depend *to, const Depend *from) {
    bool changed = (from->on & ~to->on) != 0;
    to->on |= from->on;
    for (uint32_t i = 0; i < from->nnamed && to->nnamed < DEPEND_NAMED; i++) {
        bool known = false;
        for (uint32_t j = 0; j < to->nnamed; j++) known |= to->named[j] == from->named[i];
        if (!known) to->named[to->nnamed++] = from->named[i], changed = true;
    }
    return changed;
}

/* Does it name all that `from` names, or as many as it may? */
static bool knows(const Depend *d, const Depend *from) {
    for (uint32_t i = 0; i < from->nnamed && d->nnamed < DEPEND_NAMED; i++) {
        bool known = false;
        for (uint32_t j = 0; j < d->nnamed; j++) known |= d->named[j] == from->named[i];
        if (!known) return false;
    }
    return true;
}

static void add(Flow *f, const Inst *to, const Depend *from) {
    Depend *d = &f->of[to->id];
    if ((from->on & ~d->on) || !knows(d, from)) f->changed |= depend_merge(d, from); /* most walks find nothing new */
}

static void add_flags(Flow *f, const Inst *to, uint8_t on) { add(f, to, &(Depend){.on = on}); }

static void add_value(Flow *f, const Inst *to, const Inst *from) { add(f, to, &f->of[from->id]); }

static bool differentiated(const Flow *f, const Inst *param) {
    return !f->options.wrt || walk_any_marked(f->options.wrt, param);
}

/* What a derived array is computed from. */
static void add_derived(Flow *f, const Inst *i) {
    const Program *p = f->options.program;
    const Derived *d = p->derived;
    while (i->imm.slot.base - d->base >= 3 * d->n) d++;
    for (uint32_t k = 0; k < d->nreads; k++)
        if (p->params[d->reads[k]].differentiable)
            add(f, i, &(Depend){.on = DEPENDS_PARAM | DEPENDS_VALUE, .nnamed = 1, .named = {d->reads[k]}});
}

static void add_param(Flow *f, const Inst *i) {
    const Program *p = f->options.program;
    uint32_t index = 0;
    if (!differentiated(f, i)) return;
    if (p && i->imm.slot.base >= program_floats(p)) {
        add_derived(f, i);
        return;
    }
    if (p) { /* the last parameter that starts at or before the slot and is not empty */
        for (uint32_t end = p->nparams; index < end;) {
            uint32_t middle = (index + end) / 2;
            if (p->params[middle].fbase + p->params[middle].fcount <= i->imm.slot.base) index = middle + 1;
            else end = middle;
        }
        if (index >= p->nparams || !p->params[index].differentiable) return;
    }
    add(f, i, &(Depend){.on = DEPENDS_PARAM | DEPENDS_VALUE, .nnamed = 1, .named = {index}});
}

static bool chooses(const Inst *i) {
    Op op = (Op)i->op;
    if (op == OP_fsel) return i->args[0]->op != OP_feq && i->args[0]->op != OP_fne; /* not on an area, as in `length` */
    return op == OP_fmin || op == OP_fmax || op == OP_proj || op == OP_load || op == OP_ffloor || op == OP_fceil ||
           op == OP_fround || op == OP_ftrunc || op == OP_i2f || op == OP_u2f || op == OP_iasfloat;
}

/* Do parameters choose, the same everywhere? */
static bool ties(const Flow *f, const Inst *i) {
    Op op = (Op)i->op;
    uint8_t on = 0;
    if (op == OP_fmin || op == OP_fmax || op == OP_fabs)
        for (uint32_t a = 0; a < i->nargs; a++) on |= f->of[i->args[a]->id].on;
    else if (op == OP_fsel) on = f->of[i->args[0]->id].on;
    else if (op == OP_proj && i->args[0]->op == OP_if_ && i->type == TY_FLT) on = f->of[i->args[0]->args[0]->id].on;
    return on & DEPENDS_PARAM && !(on & (DEPENDS_X | DEPENDS_RAND));
}

/* Operations of floats whose results are constant between jumps. A site's own jumps are tagged. */
static bool steps(const Inst *i) {
    Op op = (Op)i->op;
    if (op == OP_site || op == OP_siten || op == OP_query || op == OP_told || op == OP_window) return false;
    return op == OP_ffloor || op == OP_fceil || op == OP_fround || op == OP_ftrunc ||
           (i->nargs && (i->type == TY_INT || i->type == TY_BOOL));
}

/* An equality is no boundary that a tag could mark: on an area it holds where pieces meet (`length` asks whether it is
 * 0), and then the comparison itself is reported. */
bool depend_jumps(const Depend *of, const Inst *i) {
    uint8_t on = 0;
    if (i->op == OP_feq || i->op == OP_fne || !steps(i)) return false;
    for (uint32_t a = 0; a < i->nargs; a++) on |= of[i->args[a]->id].on;
    return (on & DEPENDS_SLOPE) && (on & DEPENDS_PARAM);
}

/* What it depends on for its operands' sake. */
static void flow_operands(Flow *f, const Inst *i) {
    const bool site = i->op == OP_site || i->op == OP_siten;
    const Depend *own = &f->of[i->id];
    bool known = true;
    uint8_t on = 0;
    for (uint32_t a = 0; a < i->nargs; a++) {
        const Depend *arg = &f->of[i->args[a]->id];
        on |= arg->on, known = known && knows(own, arg);
    }
    if (known && !(on & ~own->on) && !depend_jumps(f->of, i)) return; /* as most walks find it */
    Depend d = {0};
    for (uint32_t a = 0; a < i->nargs; a++) {
        Depend arg = f->of[i->args[a]->id];
        if (site && a == 0) arg.on &= (uint8_t)~DEPENDS_JUMPS;
        depend_merge(&d, &arg);
    }
    if (steps(i) || site) d.on &= (uint8_t)~(DEPENDS_SLOPE | DEPENDS_VALUE);
    if (depend_jumps(f->of, i)) d.on |= DEPENDS_JUMPS;
    add(f, i, &d);
}

/* control: what the conditions around the block depend on; exits: those of them that end loops, if whole_loops. */
static void flow(Flow *f, Block *b, Depend control, Depend exits);

static void flow_loop(Flow *f, Inst *i, Depend control, Depend exits) {
    Block *body = i->region[0];
    const Inst *exit = body->last->args[0];
    f->comes_back = true;
    for (uint32_t p = 1; p < body->nparams; p++) {
        add_value(f, body->params[p], i->args[p - 1]);
        add_value(f, body->params[p], body->last->args[p]);
        add_value(f, body->params[p], exit);
    }
    depend_merge(&control, &f->of[exit->id]);
    if (f->options.whole_loops) depend_merge(&exits, &f->of[exit->id]);
    flow(f, body, control, exits);
}

static void flow_proj(Flow *f, const Inst *i) {
    const Inst *owner = i->args[0];
    uint32_t at = (uint32_t)i->imm.i + (owner->op == OP_loop ? 1 : 0);
    add_value(f, i, owner->region[0]->last->args[at]);
    if (owner->op == OP_if_) {
        add_value(f, i, owner->region[1]->last->args[at]);
        add_value(f, i, owner->args[0]);
    }
    if (owner->op == OP_loop) {
        add_value(f, i, owner->region[0]->last->args[0]);
        for (uint32_t a = 0; f->options.whole_loops && a < owner->nargs; a++) add_value(f, i, owner->args[a]);
    }
}

static void flow(Flow *f, Block *b, Depend control, Depend exits) {
    for (Inst *i = b->first; i; i = i->next) {
        switch ((Op)i->op) {
        case OP_input:
            if (i->imm.i <= IN_X2) add_flags(f, i, DEPENDS_X | DEPENDS_SLOPE);
            break;
        case OP_rand: add_flags(f, i, DEPENDS_RAND); break;
        case OP_param:
            add_param(f, i);
            add_value(f, i, i->args[0]);
            break;
        case OP_detach: {
            Depend d = f->of[i->args[0]->id];
            d.nnamed = 0, d.on &= (uint8_t)~(DEPENDS_PARAM | DEPENDS_VALUE); /* detach says that this is a constant */
            add(f, i, &d);
            break;
        }
        case OP_store:
            f->comes_back = true;
            add_value(f, i->args[0], i->args[1]);
            add_value(f, i->args[0], i->args[2]);
            add(f, i->args[0], &control);
            break;
        case OP_acopy:
            f->comes_back = true;
            add_value(f, i->args[0], i->args[1]);
            add(f, i->args[0], &control);
            break;
        case OP_if_: {
            Depend inner = control;
            depend_merge(&inner, &f->of[i->args[0]->id]);
            flow(f, i->region[0], inner, exits);
            flow(f, i->region[1], inner, exits);
            break;
        }
        case OP_loop: flow_loop(f, i, control, exits); break;
        case OP_custom:
            for (uint32_t a = 0; a < i->nargs; a++) add_value(f, i->region[0]->params[a], i->args[a]);
            flow(f, i->region[0], control, exits);
            break;
        case OP_proj: flow_proj(f, i); break;
        case OP_yield: break;
        default: flow_operands(f, i);
        }
        if (exits.on) add(f, i, &exits);
        if (ties(f, i)) add_flags(f, i, DEPENDS_TIES);
        if (chooses(i) && (f->of[i->id].on & DEPENDS_X)) add_flags(f, i, DEPENDS_PIECES);
    }
}

const Depend *depend_values(Fn *fn, DependOptions options) {
    Flow f = {.options = options, .of = ARENA_ARRAY(&fn->session->scratch, Depend, ir_number(fn) + 1)};
    do {
        f.changed = false;
        flow(&f, fn->body, (Depend){0}, (Depend){0});
    } while (f.changed && f.comes_back);
    return f.of;
}

static void find_sites(const Block *b, const Depend *of, uint8_t *site) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_site || i->op == OP_siten) site[i->imm.i] |= of[i->args[1]->id].on;
        for (uint32_t r = 0; r < i->nregions; r++) find_sites(i->region[r], of, site);
    }
}

void depend_sites(Fn *fn, const uint8_t *wrt, uint8_t *site) {
    ArenaMark m = arena_mark(&fn->session->scratch);
    for (uint32_t s = 0; s < fn->nsites; s++) site[s] = 0;
    find_sites(fn->body, depend_values(fn, (DependOptions){.wrt = wrt, .whole_loops = true}), site);
    arena_reset(&fn->session->scratch, m);
}
