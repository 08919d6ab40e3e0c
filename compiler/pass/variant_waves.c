/* Waves: sites whose g is a sin(u) + b, or of a cosine, with a and b the same at every x, as rings have it.
 *
 * Bounds of sin(u) tell one curve from the next in cells that hold a part of one half wave; u itself rises through all
 * of them. So the edges of such a site are the levels of u: with t = -b / a, g is 0 where u is pi m + (-1)^m asin(t),
 * m an integer, which is the event's boundary. Edge m has the g
 *
 *     a (-1)^m sqrt(1 - t^2) (u - pi m - (-1)^m asin(t))
 *
 * which is 0 where the site's g is, and has its gradient there; elsewhere it knows nothing of the other levels, whose
 * curves it does not meet. Where a wave is flat at its root (t is 1), so is every edge.
 *
 * The site still decides as it did. Its sign is not that of an edge's g: it cannot be given (variant_given.c), so one
 * that another g hangs on stays what it is. */
#include <math.h>

#include "compiler/pass/depend.h"
#include "compiler/pass/slice.h"
#include "compiler/pass/variant.h"

typedef struct Waves {
    Fn *fn;
    const Depend *dep;     /* by id */
    const bool *asked;     /* by id: a g comes from it */
    const uint32_t *times; /* by site: how often it stands there, as a seam of the same number too */
} Waves;

/* scale * of + offset, of being a sine or a cosine; NULL: 1 and 0. */
typedef struct Wave {
    const Inst *of;
    Inst *scale, *offset;
} Wave;

static bool is_still(const Waves *w, const Inst *v) { return !(w->dep[v->id].on & ~(DEPENDS_PARAM | DEPENDS_VALUE)); }

static Inst *plus(Builder *b, Inst *p, Inst *q) { return p ? ir_emit2(b, OP_fadd, p, q) : q; }

static void scale_by(Builder *b, Wave *w, Op op, Inst *by) {
    w->scale = ir_emit2(b, op, w->scale ? w->scale : ir_constf(b, 1), by);
    if (w->offset) w->offset = ir_emit2(b, op, w->offset, by);
}

static void negate(Builder *b, Wave *w) { scale_by(b, w, OP_fmul, ir_constf(b, -1)); }

static bool find_wave(const Waves *s, Builder *b, const Inst *g, Wave *w) {
    Inst *p = g->nargs > 0 ? g->args[0] : NULL, *q = g->nargs > 1 ? g->args[1] : NULL;
    switch ((int)g->op) {
    case OP_fsin:
    case OP_fcos: *w = (Wave){.of = g}; return true;
    case OP_fneg:
        if (!find_wave(s, b, p, w)) return false;
        negate(b, w);
        return true;
    case OP_fadd:
        if (!is_still(s, q) && !is_still(s, p)) return false;
        if (!find_wave(s, b, is_still(s, q) ? p : q, w)) return false;
        w->offset = plus(b, w->offset, is_still(s, q) ? q : p);
        return true;
    case OP_fsub:
        if (is_still(s, q)) {
            if (!find_wave(s, b, p, w)) return false;
            w->offset = w->offset ? ir_emit2(b, OP_fsub, w->offset, q) : ir_emit1(b, OP_fneg, q);
            return true;
        }
        if (!is_still(s, p) || !find_wave(s, b, q, w)) return false;
        negate(b, w);
        w->offset = plus(b, w->offset, p);
        return true;
    case OP_fmul:
    case OP_ffma:
        if (g->op == OP_ffma && !is_still(s, g->args[2])) return false;
        if (!is_still(s, q) && !is_still(s, p)) return false;
        if (!find_wave(s, b, is_still(s, q) ? p : q, w)) return false;
        scale_by(b, w, OP_fmul, is_still(s, q) ? q : p);
        if (g->op == OP_ffma) w->offset = plus(b, w->offset, g->args[2]);
        return true;
    case OP_fdiv:
        if (!is_still(s, q) || !find_wave(s, b, p, w)) return false;
        scale_by(b, w, OP_fdiv, q);
        return true;
    default: return false;
    }
}

static Inst *shift_of(Builder *b, Inst *s, Inst *angle, Inst *phase) {
    return ir_emit2(b, OP_fadd, ir_emit2(b, OP_fmul, s, angle), phase);
}

/* u - pi m, as sines reduce their arguments: pi in two parts, and products that do not round. Else u's own rounding,
 * to which the program decides, would be lost in that of pi m. variant_wave_of takes it apart. */
static Inst *less_turns(Builder *b, Inst *u, Inst *m) {
    double pi = b->fn->precision == PREC_F64 ? M_PI : (double)(float)M_PI;
    double rest = b->fn->precision == PREC_F64 ? 0x1.1a62633145c07p-53 : M_PI - pi;
    return ir_emit3(b, OP_ffma, m, ir_constf(b, -rest), ir_emit3(b, OP_ffma, m, ir_constf(b, -pi), u));
}

/* (-1)^m, chosen rather than computed: sums would be thought to round (variant_bounds_error.c). */
static Inst *sign_of(Builder *b, Inst *m) {
    Inst *half = ir_emit1(b, OP_ffloor, ir_emit2(b, OP_fmul, m, ir_constf(b, 0.5)));
    Inst *even = ir_emit2(b, OP_feq, ir_emit2(b, OP_fadd, half, half), m);
    return ir_select(b, even, ir_constf(b, 1), ir_constf(b, -1));
}

static Inst *level_of(Builder *b, const Wave *w) {
    Inst *m = ir_input(b, IN_BOUNDARY), *s = sign_of(b, m), *angle = ir_constf(b, 0), *steep = s;
    if (w->offset) {
        Inst *t = ir_emit1(b, OP_fneg, w->offset), *one = ir_constf(b, 1);
        if (w->scale) t = ir_emit2(b, OP_fdiv, t, w->scale);
        angle = ir_emit1(b, OP_fasin, t);
        Inst *square = ir_emit2(b, OP_fmul, ir_emit2(b, OP_fsub, one, t), ir_emit2(b, OP_fadd, one, t));
        steep = ir_emit2(b, OP_fmul, s, ir_emit1(b, OP_fsqrt, square));
    }
    if (w->scale) steep = ir_emit2(b, OP_fmul, steep, w->scale);
    Inst *phase = ir_constf(b, w->of->op == OP_fcos ? -M_PI_2 : 0), *u = w->of->args[0];
    return ir_emit2(b, OP_fmul, steep, ir_emit2(b, OP_fsub, less_turns(b, u, m), shift_of(b, s, angle, phase)));
}

static void waves_in(const Waves *s, Block *body) {
    for (Inst *i = body->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) waves_in(s, i->region[r]);
        SiteInfo *info = i->op == OP_site ? &s->fn->sites[i->imm.i] : NULL;
        if (!info || info->kind != SITE_COMPARE || info->skip_loop) continue;
        if (s->asked[i->id] || s->times[i->imm.i] > 1) continue;
        Builder b = ir_before(s->fn, i);
        b.span = i->span;
        Wave w;
        if (is_still(s, i->args[1]) || !find_wave(s, &b, i->args[1], &w)) continue;
        ir_replace_arg(i, 1, level_of(&b, &w));
        info->kind = SITE_WAVE;
    }
}

static void find_asked(Slice *from, uint32_t *times, const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t a = 1; variant_is_site(i) && a < i->nargs; a++) slice_add(from, i->args[a]);
        if (variant_is_site(i)) times[i->imm.i]++;
        for (uint32_t r = 0; r < i->nregions; r++) find_asked(from, times, i->region[r]);
    }
}

void variant_waves(PassCtx *ctx, Fn *seamed) {
    Arena *scratch = &ctx->session->scratch;
    ArenaMark mark = arena_mark(scratch);
    Waves s = {.fn = seamed, .dep = depend_values(seamed, (DependOptions){0})};
    Slice from = slice_begin(seamed, scratch, false);
    uint32_t *times = ARENA_ARRAY(scratch, uint32_t, seamed->nsites + 1);
    find_asked(&from, times, seamed->body);
    slice_close(&from);
    s.asked = from.in, s.times = times;
    waves_in(&s, seamed->body);
    arena_reset(scratch, mark);
}

void variant_wave_of(const Inst *site, const Inst **u, const Inst **angle, const Inst **phase) {
    const Inst *far = site->args[1]->args[1], *shift = far->args[1];
    *u = far->args[0]->args[2]->args[2], *angle = shift->args[0]->args[1], *phase = shift->args[1];
}

void variant_wave_levels(Builder *b, Inst *lo, Inst *hi, Inst *angle, Inst *phase, Inst **first, Inst **last) {
    /* What is so near to an end that rounding tells no side of it counts as inside. */
    double slack = b->fn->precision == PREC_F64 ? 0x1p-44 : 0x1p-16;
    Inst *size = ir_emit2(b, OP_fadd, ir_emit1(b, OP_fabs, lo), ir_emit1(b, OP_fabs, hi));
    size = ir_emit2(b, OP_fmul, ir_emit2(b, OP_fadd, size, ir_constf(b, 4)), ir_constf(b, slack));
    for (int end = 0; end < 2; end++) {
        Inst *u = end ? ir_emit2(b, OP_fadd, hi, size) : ir_emit2(b, OP_fsub, lo, size), *one = ir_constf(b, 1);
        Inst *turns = ir_emit2(b, OP_fmul, ir_emit2(b, OP_fsub, u, phase), ir_constf(b, M_1_PI));
        /* The only level within a quarter of a wave of pi m is m. */
        Inst *m = ir_emit1(b, OP_ffloor, ir_emit2(b, OP_fadd, turns, ir_constf(b, 0.5)));
        Inst *over = less_turns(b, u, m), *place = shift_of(b, sign_of(b, m), angle, phase);
        if (end) *last = ir_select(b, ir_emit2(b, OP_flt, over, place), ir_emit2(b, OP_fsub, m, one), m);
        else *first = ir_select(b, ir_emit2(b, OP_flt, place, over), ir_emit2(b, OP_fadd, m, one), m);
    }
    /* Where bounds of the wave itself leave its sign open there is one to be asked for. */
    *last = ir_emit2(b, OP_fmax, *last, *first);
}
