/* The text form. Readable first, and complete: parse.c reads everything back except places in the source.
 *
 *     fn "value" f32 dim 2 channels 1 floats 3 ints 0
 *     site compare depth 0 events 1 path "main" text "d < 0"
 *     output "f.0"
 *     {
 *       %0 = input:f x0
 *       %1 = constf 0x1p-1 ; 0.5
 *       %2 = flt %0, %1
 *       %3 = if_ %2 {
 *         %4 = constf 0x1p+0 ; 1
 *         yield %4
 *       } {
 *         yield %1
 *       }
 *       %5 = proj:f %3 #0
 *       yield %5
 *     } */
#include <inttypes.h>
#include <math.h>
#include <string.h>

#include "compiler/ir/text.h"

const char *const ir_input_names[SLT_INPUTS] = {
#define SLT_INPUT(id, text, ...) [IN_##id] = text,
#define SLT_UNIFORM(id, text, ...) [IN_##id] = text,
#include "saltus/kernel.def"
};
const OutputText ir_output_texts[SLT_ROLES] = {
#define SLT_ROLE(id, text, type, most, ...) {text, most},
#include "saltus/kernel.def"
};
const char *const ir_site_kinds[SLT_SITE_KINDS] = {
#define SLT_SITE(id, text, ...) text,
#include "saltus/kernel.def"
};
const char *const ir_counter_names[SLT_COUNTERS] = {
#define SLT_COUNTER(id, text, ...) text,
#include "saltus/kernel.def"
};
const char ir_type_letters[TY_TAPE + 1] = {'.', 'b', 'i', 'f', 'a', 't'};

bool ir_spells_type(Op op) {
    static const bool spells[OP_COUNT] = {
#define FOP1(name, ...) false,
#define FOP2(name, ...) false,
#define FOP3(name, ...) false,
#define FCMP2(name, ...) false,
#define FSEL(name, ...) false,
#define IOP1(name, ...) false,
#define IOP2(name, ...) false,
#define ICMP2(name, ...) false,
#define BOP1(name, ...) false,
#define BOP2(name, ...) false,
#define CONV(name, ...) false,
#define SPECIAL(name, signature, ...) (signature)[0] == '?',
#include "compiler/ir/ops.def"
#include "compiler/ir/ops_undef.h"
    };
    return spells[op];
}

/* ---- strings */

static void reserve(Text *t, size_t more) {
    if (t->len + more + 1 <= t->cap) return;
    size_t cap = t->cap ? t->cap * 2 : 1024;
    while (cap < t->len + more + 1) cap *= 2;
    char *data = arena_alloc(t->arena, cap);
    if (t->len) memcpy(data, t->data, t->len);
    t->data = data;
    t->cap = cap;
}

void text_addv(Text *t, const char *fmt, va_list values) {
    va_list again;
    va_copy(again, values);
    int n = vsnprintf(NULL, 0, fmt, values);
    if (n > 0) {
        reserve(t, (size_t)n);
        vsnprintf(t->data + t->len, (size_t)n + 1, fmt, again);
        t->len += (size_t)n;
    }
    va_end(again);
}

void text_add(Text *t, const char *fmt, ...) {
    va_list ap;
    va_start(ap, fmt);
    text_addv(t, fmt, ap);
    va_end(ap);
}

static void add_quoted(Text *t, const char *s, size_t n) {
    text_add(t, "\"");
    for (size_t k = 0; k < n; k++) {
        unsigned char c = (unsigned char)s[k];
        if (c == '"' || c == '\\') text_add(t, "\\%c", c);
        else if (c < 32 || c == 127) text_add(t, "\\x%02x", c);
        else text_add(t, "%c", c);
    }
    text_add(t, "\"");
}

static void add_string(Text *t, const char *s) { add_quoted(t, s ? s : "", s ? strlen(s) : 0); }

/* ---- instructions */

static void add_ref(Text *t, const Inst *v) {
    if (!v) text_add(t, "%%null");
    else if (v->id == UINT32_MAX) text_add(t, "%%new_%s", v->op < OP_COUNT ? ir_ops[v->op].name : "?");
    else text_add(t, "%%%" PRIu32, v->id);
}

static char letter(uint8_t type) { return type <= TY_TAPE ? ir_type_letters[type] : '?'; }

static void add_float(Text *t, double v) {
    if (isfinite(v)) {
        text_add(t, " %a ; %.17g", v, v);
        return;
    }
    uint64_t bits; /* the payload of a NaN matters to bit-exact tests */
    memcpy(&bits, &v, sizeof bits);
    text_add(t, " bits 0x%016" PRIx64 " ; %g", bits, v);
}

static void add_imm(Text *t, const Inst *i) {
    switch ((Op)i->op) {
    case OP_constf: add_float(t, i->imm.f); break;
    case OP_consti: text_add(t, " %" PRId32, (int32_t)i->imm.i); break;
    case OP_constb: text_add(t, i->imm.i ? " true" : " false"); break;
    case OP_input:
        if (i->imm.i >= 0 && i->imm.i < SLT_INPUTS) text_add(t, " %s", ir_input_names[i->imm.i]);
        else text_add(t, " #%" PRId64, i->imm.i);
        break;
    case OP_param:
    case OP_iparam:
    case OP_dparam:
    case OP_adj: text_add(t, " [%" PRIu32 ", %" PRIu32 "]", i->imm.slot.base, i->imm.slot.count); break;
    case OP_ddx:
    case OP_site:
    case OP_siten:
    case OP_proj:
    case OP_arg:
    case OP_count:
    case OP_live:
    case OP_settled:
    case OP_choice:
    case OP_item:
    case OP_items:
    case OP_note: text_add(t, " #%" PRId64, i->imm.i); break;
    case OP_alloc: text_add(t, " %c[%" PRIu32 "]", letter((uint8_t)i->imm.arr.elem), i->imm.arr.count); break;
    case OP_loop:
        text_add(t, " max %" PRIu32 " id %" PRIu32, i->imm.loop.max_iters, i->imm.loop.loop_id);
        if (i->imm.loop.exact) text_add(t, " exact");
        if (i->imm.loop.told) text_add(t, " told");
        if (i->imm.loop.cull) text_add(t, " %s %" PRIu32, i->imm.loop.found ? "list" : "cull", i->imm.loop.cull_id);
        break;
    case OP_print:
        text_add(t, " ");
        add_quoted(t, i->imm.text.text ? i->imm.text.text : "", i->imm.text.text ? i->imm.text.len : 0);
        break;
    case OP_give:
    case OP_take:
        text_add(t, " [%" PRIu32 ", %" PRIu32 " of %" PRIu32 "]", i->imm.frame.which, i->imm.frame.place,
                 i->imm.frame.places);
        break;
    case OP_told:
    case OP_query:
        text_add(t, " geometry %" PRIu32 " what %" PRIu32 " base %" PRIu32, i->imm.query.geometry, i->imm.query.what,
                 i->imm.query.base);
        break;
    case OP_window: text_add(t, " #%" PRId64, i->imm.i); break;
    default: break; /* nothing else has an imm */
    }
}

void text_inst(Text *t, const Inst *i) {
    if (i->op >= OP_COUNT) {
        text_add(t, "<operation %d>", i->op);
        return;
    }
    bool named = i->type != TY_VOID || i->nregions;
    if (named) {
        add_ref(t, i);
        text_add(t, " = ");
    }
    text_add(t, "%s", ir_ops[i->op].name);
    if (ir_spells_type((Op)i->op)) text_add(t, ":%c", letter(i->type));
    for (uint32_t a = 0; a < i->nargs; a++) {
        text_add(t, a ? ", " : " ");
        add_ref(t, i->args[a]);
    }
    add_imm(t, i);
}

static void add_block(Text *t, const Block *b, uint32_t depth) {
    text_add(t, "{");
    for (uint32_t p = 0; p < b->nparams; p++) {
        text_add(t, p ? ", " : " (");
        add_ref(t, b->params[p]);
        text_add(t, ":%c", letter(b->params[p]->type));
    }
    text_add(t, b->nparams ? ")\n" : "\n");
    for (const Inst *i = b->first; i; i = i->next) {
        text_add(t, "%*s", (int)(2 * depth + 2), "");
        text_inst(t, i);
        for (uint32_t r = 0; r < i->nregions; r++) {
            text_add(t, " ");
            if (i->region[r]) add_block(t, i->region[r], depth + 1);
            else text_add(t, "{}");
        }
        text_add(t, "\n");
    }
    text_add(t, "%*s}", (int)(2 * depth), "");
}

char *ir_print_string(const Fn *fn, Arena *arena) {
    if (!ir_is_numbered(fn)) ir_number((Fn *)fn);
    Text t = {.arena = arena};
    text_add(&t, "fn ");
    add_string(&t, fn->name);
    text_add(&t, " %s dim %" PRIu32 " channels %" PRIu32 " floats %" PRIu32 " ints %" PRIu32 "\n",
             fn->precision == PREC_F32 ? "f32" : "f64", fn->dim, fn->channels, fn->nfloats, fn->nints);
    for (uint32_t s = 0; s < fn->nsites; s++) {
        const SiteInfo *site = &fn->sites[s];
        text_add(&t, "site %s depth %" PRIu32 " events %" PRIu64, ir_site_kinds[site->kind], site->depth,
                 site->max_events);
        if (site->skip_loop) text_add(&t, " skip");
        if (site->by_auto) text_add(&t, " auto");
        if (site->still) text_add(&t, " still");
        text_add(&t, " path ");
        add_string(&t, site->path);
        text_add(&t, " text ");
        add_string(&t, site->text);
        text_add(&t, "\n");
    }
    const Inst *yield = fn->body->last;
    for (uint32_t o = 0; fn->outputs && yield && yield->op == OP_yield && o < yield->nargs; o++) {
        const Output *out = &fn->outputs[o];
        text_add(&t, "output \"%s", ir_output_texts[out->role].text);
        if (ir_output_texts[out->role].most > 1) text_add(&t, "%u", out->index);
        text_add(&t, "\"\n");
    }
    add_block(&t, fn->body, 0);
    text_add(&t, "\n");
    return t.data;
}

void ir_print(const Fn *fn, FILE *out) {
    Arena *scratch = &fn->session->scratch;
    ArenaMark m = arena_mark(scratch);
    fputs(ir_print_string(fn, scratch), out);
    arena_reset(scratch, m);
}
