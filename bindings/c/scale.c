/* Programs whose lengths are so large or small that single precision cannot hold their squares: of a domain with sides
 * of 1e-30 every length is 0 as rounded, of 1e30 infinite, and what asks about it decides alike everywhere. Nothing in
 * the answer shows that, so the program is interpreted at a few points of the domain: a product of numbers that are not
 * 0 has no digits left, or finite numbers make an infinity, and what comes of it, still such, is the argument of a root
 * or the g of a site; at most of the points, or else it is a tail that vanishes, a ray that hits nothing. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "bindings/c/api.h"
#include "bindings/c/place.h"
#include "compiler/ir/ir.h"
#include "compiler/ir/query.h"

enum {
    LANES = POINT_LANES,
    SEEN_BY = 8,    /* lanes that look at one point where windows are searched, which takes as long as all the rest */
    FUEL = 1 << 13, /* instructions, each on LANES points */
    SEARCHES = 16,  /* of a program: values of parameters change little from call to call */
    FEWEST = 32     /* points at which an instruction has run */
};
#define NEARLY_ALL 0.97
#define MOST 0.75 /* of infinities: rays that hit nothing make some */
#define FAR 1e18  /* where the domain reaches so far, one is enough: they begin with 1.8e19 */

/* Of a value, by lane: it has lost its digits, and why. */
typedef struct Lost {
    uint64_t low, high;
} Lost;

typedef struct Asked {
    uint32_t all, low, high; /* points at which it has run, and of which its argument has lost its digits */
} Asked;

typedef struct Scale {
    SltProgram *p;
    const SltJob *job;
    SltStats *stats;
    Lost *lost;   /* by id */
    Asked *asked; /* by id */
} Scale;

static float of(const void *const *slot, const Inst *i, uint32_t lane) { return ((const float *)slot[i->id])[lane]; }

static bool is_low(float v) { return fabsf(v) < FLT_MIN; }

/* Does it make such a value of others? Quotients and elementary functions do so where they are meant to. */
static void born(const Inst *i, const void *const *slot, uint32_t k, Lost *to) {
    bool product = i->op == OP_fmul || i->op == OP_ffma, sum = i->op == OP_fadd || i->op == OP_fsub;
    if (!product && !sum) return;
    float r = of(slot, i, k);
    bool finite = true;
    for (uint32_t a = 0; a < i->nargs; a++) finite &= (bool)isfinite(of(slot, i->args[a], k));
    if (isinf(r) && finite) to->high |= 1ull << k;
    double exact = product ? (double)of(slot, i->args[0], k) * (double)of(slot, i->args[1], k) : 0;
    if (product && exact != 0 && fabs(exact) < (double)FLT_MIN && is_low(r)) to->low |= 1ull << k;
}

/* Is r in each of the lanes what most numbers are, neither low nor infinite? Then nothing is lost. */
static bool is_usual(const float *r) {
    enum { LEAST = 0x00800000, BEYOND = 0x7f800000 }; /* bits of FLT_MIN and infinity; as integers they go by size */
    uint32_t bits[LANES], unusual = 0;
    memcpy(bits, r, sizeof bits);
    for (uint32_t k = 0; k < LANES; k++) unusual |= (bits[k] & INT32_MAX) - LEAST >= BEYOND - LEAST;
    return !unusual;
}

static uint64_t bits_of(const uint8_t on[LANES]) {
    uint64_t bits = 0;
    for (uint32_t k = 0; k < LANES; k++) bits |= (uint64_t)(on[k] != 0) << k;
    return bits;
}

static uint32_t count(uint64_t bits) { return (uint32_t)__builtin_popcountll(bits); }

static void see(void *user, const Inst *i, const void *const *slot, const uint8_t *on) {
    Scale *s = user;
    const bool asks = i->op == OP_fsqrt || i->op == OP_frsqrt || i->op == OP_site, number = i->type == TY_FLT;
    if (!asks && !number) return;
    const bool usual = !number || is_usual(slot[i->id]); /* in lanes that are off there is some number, too */
    if (!asks && usual) {
        s->lost[i->id] = (Lost){0};
        return;
    }
    Lost from = {0}, to = {0};
    for (uint32_t a = 0; a < i->nargs; a++)
        if (i->args[a]->type == TY_FLT)
            from.low |= s->lost[i->args[a]->id].low, from.high |= s->lost[i->args[a]->id].high;
    if (asks) {
        const uint64_t ran = bits_of(on);
        Asked *asked = &s->asked[i->id];
        asked->all += count(ran), asked->low += count(from.low & ran);
        /* Of a length that is infinite its site will say so. */
        asked->high += i->op == OP_site ? count(from.high & ran) : 0;
    }
    for (uint32_t k = 0; k < LANES && !usual; k++) {
        if (!on[k]) continue;
        float r = of(slot, i, k);
        if (fabsf(r) >= FLT_MIN && isfinite(r)) continue; /* as most are: nothing is lost */
        if (is_low(r)) to.low |= from.low & 1ull << k;
        if (!isfinite(r)) to.high |= from.high & 1ull << k;
        born(i, slot, k, &to);
    }
    s->lost[i->id] = to;
}

static const Inst *find(const Scale *s, const Block *b, double most, bool *high) {
    for (const Inst *i = b->first; i; i = i->next) {
        const Asked *a = &s->asked[i->id];
        bool enough = a->all >= FEWEST, low = enough && a->low >= NEARLY_ALL * a->all;
        *high = enough && a->high > most * a->all;
        if (low || *high) return i;
        for (uint32_t r = 0; r < i->nregions; r++) {
            const Inst *inner = find(s, i->region[r], most, high);
            if (inner) return inner;
        }
    }
    return NULL;
}

/* Are windows looked through, or light that comes past a mesh? */
static bool searches(const Program *prog) {
    bool any = false;
    for (uint32_t g = 0; g < prog->ngeometries; g++)
        for (uint32_t q = 0; q < SLT_QUERIES; q++)
            any |= prog->geometries[g].queries >> q & 1 && query_rows[q].witness == WITNESS_UNIT;
    return any;
}

static void look(Session *session, void *user) {
    static const double golden[3] = {0.8191725133961645, 0.6710436067037893, 0.5497004779019703};
    Scale *s = user;
    SltProgram *p = s->p;
    ArenaMark m = arena_mark(&session->scratch);
    const Fn *fn = p->prog->primal;
    PointInputs *in = ARENA_ARRAY(&session->scratch, PointInputs, 1);
    s->lost = ARENA_ARRAY(&session->scratch, Lost, fn->ninsts + 1);
    s->asked = ARENA_ARRAY(&session->scratch, Asked, fn->ninsts + 1);
    memset(s->lost, 0, sizeof *s->lost * (fn->ninsts + 1));
    memset(s->asked, 0, sizeof *s->asked * (fn->ninsts + 1));
    api_inputs_begin(in, p, s->job);
    const uint32_t by = searches(p->prog) ? SEEN_BY : 1;
    for (uint32_t k = 0; k < LANES; k++) {
        double x[3] = {0};
        for (uint32_t d = 0; d < p->scene.dim; d++) {
            double u = (k / by + 0.5) * golden[d];
            x[d] = p->scene.lo[d] + (u - floor(u)) * (p->scene.hi[d] - p->scene.lo[d]);
        }
        api_inputs_point(in, k, x, (int32_t)(k / by), 0.5);
    }
    uint64_t fuel = FUEL;
    bool high = false;
    /* Where the fuel is out, what has run until then tells. */
    ir_interpret_watched(fn, &in->args, LANES, LANES, &fuel, 0, see, s);
    (void)api_geometries_lost(p), (void)api_geometries_blind(p, NULL); /* that was no answer */
    double far = 0;
    for (uint32_t d = 0; d < p->scene.dim; d++) far = fmax(far, fmax(fabs(p->scene.lo[d]), fabs(p->scene.hi[d])));
    const Inst *i = find(s, fn->body, far > FAR ? 0 : MOST, &high);
    if (i) {
        s->stats->out_of_range = high ? 1 : -1;
        Span span = i->op == OP_site ? fn->sites[i->imm.i].span : i->span;
        if (span.file >= 0) api_name_place(p, &s->stats->out_of_range_at, span);
    }
    arena_reset(&session->scratch, m);
}

void api_find_scale(SltProgram *p, const SltJob *job, SltStats *stats) {
    Scale s = {.p = p, .job = job, .stats = stats};
    stats->out_of_range = 0;
    if (p->opt.f64 || p->scales_sought++ >= SEARCHES) return;
    pthread_mutex_lock(&p->late.lock);     /* whoever compiles a kernel now uses the session as well */
    session_protect(p->session, look, &s); /* without memory nothing is said */
    pthread_mutex_unlock(&p->late.lock);
}
