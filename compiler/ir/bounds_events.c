/* The events column of ops.def as code: what may jump or bend on a box. A NaN among the ends, of which nothing is
 * known, is taken for both. */
#include "compiler/ir/bounds_rules.h"

static Inst *contains_zero(Rule *r, Bound x) {
    Inst *zero = num(r, 0), *apart = either(r, lt(r, zero, x.lo), lt(r, x.hi, zero));
    return not(r, both(r, apart, has_ends(r, x)));
}

static Inst *varies(Rule *r, Bound x) { return not(r, ir_bound_is_point(&r->b, x)); }

static BoundEvents jumps(Inst *i) { return (BoundEvents){.jumps = i}; }
static BoundEvents bends(Inst *i) { return (BoundEvents){.bends = i}; }

/* Both arguments may be the value: a bend, and a jump where the second may be NaN, which the row passes over. */
static BoundEvents meet(Rule *r, Bound x, Bound y) {
    Inst *apart = either(r, lt(r, x.hi, y.lo), lt(r, y.hi, x.lo));
    return (BoundEvents){not(r, bound_is_number(r, y)), not(r, both(r, apart, bound_extreme_known(r, x, y)))};
}

static Inst *corner(Rule *r, Bound x) {
    Inst *zero = num(r, 0), *apart = either(r, le(r, zero, x.lo), le(r, x.hi, zero));
    return not(r, both(r, apart, has_ends(r, x)));
}

static Inst *not_inside_1(Rule *r, Bound x) { return not(r, both(r, lt(r, num(r, -1), x.lo), lt(r, x.hi, num(r, 1)))); }

static Inst *cut(Rule *r) {
    Inst *uncut;
    bound_atan2(r, 0, &uncut);
    return not(r, uncut);
}

/* An exponent that is a positive integer leaves nothing to happen. */
static BoundEvents power_ends(Rule *r, Bound x, Bound y) {
    if (is_constant(y) && y.lo->imm.f > 0 && y.lo->imm.f == floor(y.lo->imm.f)) return (BoundEvents){0};
    Inst *positive = both(r, lt(r, num(r, 0), x.lo), has_ends(r, x));
    Inst *rooted = both(r, both(r, le(r, num(r, 0), x.lo), lt(r, num(r, 0), y.lo)), has_ends(r, x));
    return (BoundEvents){not(r, either(r, positive, rooted)), not(r, positive)};
}

#define SMOOTH (BoundEvents){0}
#define STEPS jumps(varies(r, bound_row(r)))
#define STEPS_UNKNOWN jumps(not(r, has_ends(r, bound_row(r))))
#define POLE(x) jumps(contains_zero(r, x))
#define CORNER(x) bends(corner(r, x))
#define ROOT(x) bends(not(r, both(r, lt(r, num(r, 0), (x).lo), has_ends(r, x))))
#define MEET(x, y) meet(r, x, y)
#define SIGN_OF(x, y) ((BoundEvents){contains_zero(r, y), corner(r, x)})
#define ENDS_AT_1(x) bends(not_inside_1(r, x))
#define CUT(x, y) jumps(cut(r))
#define POWER_ENDS(x, y) power_ends(r, x, y)
#define DECIDES(bound) jumps(varies(r, bound))

static BoundEvents events(Rule *r) {
#define a (r->arg[0])
#define b (r->arg[1])
#define c (r->arg[2])
#define ROW(name, event)                                                                                               \
    case OP_##name:                                                                                                    \
        return event;
#define FOP1(name, value, partials, bounds, events, ...) ROW(name, events)
#define FOP2(name, value, partials, bounds, events, ...) ROW(name, events)
#define FOP3(name, value, partials, bounds, events, ...) ROW(name, events)
#define FCMP2(name, ...) ROW(name, STEPS)
#define FSEL(name, ...) ROW(name, DECIDES(a))
#define IOP1(name, ...) case OP_##name:
#define IOP2(name, ...) case OP_##name:
#define ICMP2(name, ...) case OP_##name:
#define BOP1(name, ...) case OP_##name:
#define BOP2(name, ...) case OP_##name:
#define CONV(name, result, argument, value, bounds, events, ...) ROW(name, events)
#define SPECIAL(name, ...) case OP_##name:
    switch (r->op) {
#include "compiler/ir/ops.def"
#include "compiler/ir/ops_undef.h"
    case OP_COUNT: break;
    }
#undef a
#undef b
#undef c
#undef ROW
    return SMOOTH;
}

/* ---- which rows have any */

#define ANY_SMOOTH false
#define ANY_STEPS true
#define ANY_STEPS_UNKNOWN true
#define ANY_POLE(x) true
#define ANY_CORNER(x) true
#define ANY_ROOT(x) true
#define ANY_MEET(x, y) true
#define ANY_SIGN_OF(x, y) true
#define ANY_ENDS_AT_1(x) true
#define ANY_CUT(x, y) true
#define ANY_POWER_ENDS(x, y) true

bool ir_bound_has_events(Op op) {
    static const bool any[OP_COUNT] = {
#define FOP1(name, value, partials, bounds, events, ...) [OP_##name] = ANY_##events,
#define FOP2(name, value, partials, bounds, events, ...) [OP_##name] = ANY_##events,
#define FOP3(name, value, partials, bounds, events, ...) [OP_##name] = ANY_##events,
#define FCMP2(name, ...) [OP_##name] = true,
#define FSEL(name, ...) [OP_##name] = true,
#define IOP1(...)
#define IOP2(...)
#define ICMP2(...)
#define BOP1(...)
#define BOP2(...)
#define CONV(name, result, argument, value, bounds, events, ...) [OP_##name] = ANY_##events,
#define SPECIAL(...)
#include "compiler/ir/ops.def"
#include "compiler/ir/ops_undef.h"
    };
    return any[op];
}

static bool is_never(const Inst *i) { return i->op == OP_constb && !i->imm.i; }

BoundEvents ir_bound_events(Builder *b, Op op, const Bound *a, uint32_t n, uint32_t known) {
    if (bound_all_points(a, n)) return (BoundEvents){0};
    Rule r = bound_rule(b, op, a, n, known);
    BoundEvents e = events(&r);
    if (e.jumps && is_never(e.jumps)) e.jumps = NULL;
    if (e.bends && is_never(e.bends)) e.bends = NULL;
    return e;
}
