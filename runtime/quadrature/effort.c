/* From the error wanted to rules, tolerances and sizes. */
#include <math.h>

#include "runtime/quadrature/effort.h"

enum {
    SWEEPS = 10,
    PARTS_MAX = 16,
    LEFT_MOST = 1 << 21,
    /* Where an error is wanted and no number of evaluations was given: in all, and at first; */
    UNASKED = 1 << 25,
    FIRST_STAGE = 1 << 22,
    CELL_COST = 256, /* or so many for each cell that boxes foretell, if that is more */
    AFFORDS = 8,     /* and in all so many sweeps like the first one, if nothing cut that short: no less is foretold */
    STAGE = 4        /* by how much more the next sweep may spend, */
};
#define FALLS 0.7       /* if its error is less than so much of that of the one before, */
#define FIRST_LEFT 0.25 /* or what the first one leaves over is less than this share of the domain */
/* A formula of thousands of operations has curves of thousands of pieces, whose errors add up. Points along them are
 * cheap beside finding them: rules are finer from the beginning, and the first sweep may do. */
#define MANY_PIECES 0x1p-5
#define USUAL_GOAL 1e-7    /* where no error is asked for: */
#define FIRST_GOAL 1e-2    /* a sweep that is surely paid for comes first, and finer ones while evaluations last */
/* Pieces cost no less where more is allowed than this; a sweep that just misses what is wanted is paid for twice. */
#define LOOSEST 5e-3
#define FILLS 1e-3   /* a share of the domain that is no neighbourhood of curves */
#define DEARER 8.0   /* the next sweep may cost so many times the last one, */
#define CHEAP 1e6    /* or as if that had cost so much */
#define DEEPER 0.25  /* of what a sweep costs, for cutting on what it leaves: at first, */
#define DEEPEST 4.0  /* and at most */
#define LEFT_SHARE 0.25    /* of a budget, for what is left over; more where more will be */
/* Shadows, whose curves are followed through cells that are left: the number of cells, not a budget, is from the
 * segments. Four times what all of them would cost if the whole domain were left, for each segment; of this cells leave
 * so much to the curves. */
#define MARCH_SEGMENT (4 * MARCH_COST)
#define MARCH_SHARE 0.75
#define SLACK 0x1p-8 /* of roots, in parts of the tolerance */
#define SLACK_MOST 0x1p-20
/* Most that the least cell may be, in parts of a usual one: where an error is wanted, in a plane, it is cheaper to cut
 * what is left than to search it. In a solid such cells lie along surfaces, and are many. */
#define LEAST_CELLS 0x1p-3
#define LEAST_WANTED 0x1p-5
#define LEAST_F64 0x1p-34
#define LEAST_F32 0x1p-17

static double clamp(double v, double lo, double hi) { return v < lo ? lo : v > hi ? hi : v; }

static double least_of(const Effort *e) { return e->f64 ? LEAST_F64 : LEAST_F32; }

/* Evaluations of a sweep with so many points a side, as far as boxes tell. */
static double cost_of(uint32_t gauss, uint32_t dim, double cells) {
    double coarse = gauss > 1 ? gauss - 1 : 2;
    return cells * (2 + pow(gauss, dim) + pow(coarse, dim));
}

void effort_begin(Effort *e, const Run *r, double lattice, Outlook outlook) {
    static const double least_cells[3] = {128, 256, 1728}; /* of the tiles of a sweep */
    const SltJob *j = r->j;
    *e = (Effort){.relative = j->error,
                  .absolute = j->abs_error,
                  .f64 = r->s->f64,
                  .parts = 1,
                  .few = 2,
                  .deeper = DEEPER,
                  .best = INFINITY,
                  .last = INFINITY};
    e->wanted = j->error > 0 || j->abs_error > 0;
    double goal = j->error > 0 ? j->error : e->wanted || j->gauss ? USUAL_GOAL : FIRST_GOAL;
    goal = clamp(goal, e->f64 ? 1e-13 : 1e-7, 1e-2);
    e->fixed = j->gauss > 0;
    double points = ceil(-0.5 * log10(goal)) + (r->s->chunked && e->wanted ? 3 : 2);
    e->gauss = j->gauss ? j->gauss : (uint32_t)clamp(points, 2, SLT_GAUSS_MAX);
    double usual = fmin(outlook.side, pow(least_cells[r->s->dim - 1], -1.0 / r->s->dim)); /* side of a cell */
    /* Components are as large as shapes are: a few cells wide. */
    e->tolerance = fmin(3e-2, 10 * usual) * (e->wanted ? fmin(goal, LOOSEST) : goal);
    if (r->s->chunked && e->wanted) e->tolerance *= MANY_PIECES;
    double least = e->wanted && r->s->dim < 3 ? LEAST_WANTED : LEAST_CELLS;
    e->least = clamp(8 * goal, fmax(least_of(e), 0x1p-24), least * usual);
    e->given = j->max_evaluations > 0;
    double unproven = outlook.unproven, cells = fmax(outlook.cells, least_cells[r->s->dim - 1]);
    e->limit = j->max_evaluations ? j->max_evaluations
               : e->wanted        ? (uint64_t)fmax(UNASKED, CELL_COST * cells)
                                  : (uint64_t)lattice;
    e->stage = e->wanted && !e->given ? (uint64_t)fmax(FIRST_STAGE, CELL_COST * cells) : e->limit;
    if (r->s->chunked && e->stage < e->limit) e->stage = (uint64_t)fmin((double)e->limit, STAGE * (double)e->stage);
    while (!e->fixed && e->gauss > 2 && cost_of(e->gauss, r->s->dim, cells) > 0.5 * (double)e->limit) e->gauss--;
    /* Where nothing can be proven, cells go down to the least size in vain. */
    double paid = fmax(LEFT_SHARE, unproven) * (double)e->limit / LEFT_COST; /* cells that can be left, */
    paid = fmin(paid, LEFT_MOST);                                            /* and held in memory */
    e->left_share = fmax(LEFT_SHARE, unproven);
    e->least = fmax(e->least, fmin(0.25, 4 * pow(unproven / paid, 1.0 / r->s->dim)));
}

void effort_marches(Effort *e, const Sweep *p) {
    e->marches = true;
    if (!e->given && !e->wanted) e->stage = e->limit = (uint64_t)fmax((double)e->limit, MARCH_SEGMENT * p->segments);
    e->left_share = MARCH_SHARE;
    e->least = clamp(1 / sqrt(p->segments), least_of(e), 0x1p-4);
}

void effort_apply(const Effort *e, Sweep *p, uint64_t used) {
    CellOptions *o = &p->options;
    o->gauss = e->gauss, o->few = e->few, o->fixed = e->fixed, o->tolerance = e->tolerance, o->least = e->least;
    double slack = fmin(SLACK * e->tolerance, SLACK_MOST);
    o->slack = e->fixed || slack < (e->f64 ? 0x1p-40 : 0x1p-20) ? 0 : slack;
    /* The coarse rule. Of one point, two tell the error as well. */
    o->coarse = e->gauss > 1 ? e->gauss - 1 : 2;
    p->wanted = e->wanted, p->parts = e->parts, p->left_share = e->left_share, p->least_ever = least_of(e),
    p->deeper = e->deeper;
    p->budget = e->limit > used ? e->limit - used : 1;
    if (p->budget > e->stage) p->budget = e->stage;
}

bool effort_took(Effort *e, double rules, double left) {
    double error = rules + left;
    e->sweeps++;
    e->stalls = error > 0.5 * e->last ? e->stalls + 1 : 0;
    e->fell = error / e->last, e->last = error;
    if (!(error < e->best) && e->sweeps > 1) return false;
    e->best = error;
    return true;
}

static double goal_of(const Effort *e, double scale) {
    double relative = e->wanted ? e->relative : USUAL_GOAL;
    return fmax(relative * scale, e->absolute);
}

/* By how much cells may be smaller in the next sweep: what is left fills a part of the domain, or lies along curves,
 * and should not cost far more than all did. */
static double shrink(const Sweep *p, uint64_t cost) {
    double dim = p->run->s->dim - (p->counts.left > FILLS ? 0 : 1), cells = (double)p->nleft;
    if (!(dim > 0) || !(cells > 0)) return 64;
    return clamp(pow(DEARER * fmax((double)cost, CHEAP) / (LEFT_COST * cells), 1 / dim), 2, 64);
}

/* Can what is left ever be as little as is wanted? Along curves its error falls at best as the cells that are left grow
 * in number, or as slowly as it did from the last sweep to this; around points they do not grow, and cost next to
 * nothing. */
static bool is_hopeless(const Effort *e, const Sweep *p, double left, double goal, uint64_t used) {
    double work = LEFT_COST * (double)p->nleft, falls = 1, more;
    if (e->left > left && work > e->work && e->work > 0) falls = fmin(1, log(e->left / left) / log(work / e->work));
    if (e->sweeps > 1 && !(e->left > left) && work > e->work) falls = 0.25;
    more = work * pow(left / goal, 1 / falls);
    return left > goal && (double)used + more > (double)e->limit;
}

/* A sweep has spent what its stage allows: should the next one spend more? Not where nothing fills the domain but cells
 * that get ever smaller in vain. */
static bool next_stage(Effort *e, const Sweep *p, uint64_t used) {
    bool falls = e->sweeps > 1 ? e->fell < FALLS : p->counts.left < FIRST_LEFT;
    e->stage *= STAGE;
    return falls && used < e->limit;
}

/* Rules that are better by what they are too far apart. False: there are none. */
static bool make_finer(Effort *e, double rules, double goal) {
    e->tolerance = fmax(e->tolerance * clamp(0.1 * goal / rules, 1e-4, 0.1), e->f64 ? 1e-17 : 1e-9);
    /* How a curve bends does not tell how what is integrated along it varies. */
    e->few += e->stalls ? e->gauss : 2;
    if (!e->fixed && e->gauss < SLT_GAUSS_MAX) e->gauss += e->gauss + 2 > SLT_GAUSS_MAX ? 1 : 2;
    else if (e->parts < PARTS_MAX) e->parts *= 2;
    else return false;
    return true;
}

/* By how much the next sweep will cost more if its rules have two more points. Where f is constant between curves these
 * are along curves alone, few beside what finding them costs; in a solid planes are more. */
static double dearer(const Effort *e, const SltScene *s) {
    uint32_t axes = !s->flat ? s->dim : s->dim > 2 ? 1 : 0;
    return e->fixed ? 1 : pow(1 + 2.0 / e->gauss, axes);
}

bool effort_more(Effort *e, const Sweep *p, double rules, double left, double scale, uint64_t used, uint64_t cost,
                 SltStop *stop) {
    double goal = goal_of(e, scale);
    bool changed = false;
    *stop = SLT_STOP_NONE;
    if (e->best <= goal) { /* of the gradient; of the value something may be left */
        if (!e->wanted && p->short_of_volume && e->given) *stop = SLT_STOP_EVALUATIONS;
        return false;
    }
    if (e->wanted && !e->given && e->sweeps == 1 && !p->counts.spent) {
        e->limit = (uint64_t)fmax((double)e->limit, AFFORDS * (double)cost);
        e->stage = (uint64_t)fmax((double)e->stage, STAGE * (double)cost);
    }
    bool rougher = left > 0.25 * goal, finer = rules > 0.25 * goal; /* what there is too much of */
    if (p->counts.spent && e->stage < e->limit) {
        if (e->wanted || e->given) *stop = SLT_STOP_EVALUATIONS;
        if (finer) make_finer(e, rules, goal);
        return next_stage(e, p, used);
    }
    double next = (double)cost * (finer ? dearer(e, p->run->s) : 1);
    bool spent = p->counts.spent && !p->cells_budget;
    *stop = spent || (double)used + next > (double)e->limit ? SLT_STOP_EVALUATIONS : SLT_STOP_ROUNDING;
    if (e->stalls >= 2 && left > rules) *stop = SLT_STOP_EVALUATIONS; /* no number of them seems to be enough */
    if (e->wanted && !e->given && is_hopeless(e, p, left, goal, used)) *stop = SLT_STOP_EVALUATIONS;
    e->left = left, e->work = LEFT_COST * (double)p->nleft;
    bool over = *stop == SLT_STOP_EVALUATIONS || e->stalls >= 2 || e->sweeps >= SWEEPS;
    if (!e->wanted && !(spent && e->given)) *stop = SLT_STOP_NONE; /* what ends it was not asked for */
    if (over || ((e->fixed || e->marches) && !e->wanted)) return false;
    if (p->counts.spent) return true; /* the next one may spend more */
    if (rougher && e->least > least_of(e)) {
        changed = true;
        e->least = fmax(e->least / (e->marches ? 4 : shrink(p, cost)), least_of(e)),
        e->deeper = fmin(4 * e->deeper, DEEPEST);
    }
    if (finer) changed = make_finer(e, rules, goal);
    return changed;
}
