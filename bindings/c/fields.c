/* Heightfields that kernels search: their acceleration structures, from the first kernel that asks to the end of the
 * program.
 *
 * A structure is made when compiled kernels hold a query on it, and only for the queries that they hold: no query,
 * nothing is built. It follows the heights: a new value that is really another one marks the rectangle around it, and
 * the next estimate refreshes that rectangle first. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bindings/c/api.h"

static uint32_t block_queries(const Block *b, uint32_t field) {
    uint32_t queries = 0;
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_fieldop && i->imm.field.field == field) queries |= 1u << i->imm.field.what;
        for (uint32_t r = 0; r < i->nregions; r++) queries |= block_queries(i->region[r], field);
    }
    return queries;
}

uint32_t api_field_queries(const Fn *fn, uint32_t field) {
    uint32_t queries = 0;
    for (; fn; fn = fn->next_part) queries |= block_queries(fn->body, field);
    return queries;
}

void api_fields_want(SltProgram *p, const Fn *fn) {
    for (uint32_t f = 0; f < p->prog->nfields; f++) p->field_state[f].wanted |= api_field_queries(fn, f);
}

bool api_fields_init(SltProgram *p) {
    uint32_t n = p->prog->nfields;
    p->fields = calloc(n + 1, sizeof *p->fields);
    p->field_base = calloc(n + 1, sizeof *p->field_base);
    p->field_count = calloc(n + 1, sizeof *p->field_count);
    p->field_state = calloc(n + 1, sizeof *p->field_state);
    if (!p->fields || !p->field_base || !p->field_count || !p->field_state) return false;
    for (uint32_t i = 0; i < n; i++)
        p->field_base[i] = p->prog->fields[i].base, p->field_count[i] = p->prog->fields[i].w * p->prog->fields[i].h;
    return true;
}

void api_fields_free(SltProgram *p) {
    for (uint32_t i = 0; p->fields && p->prog && i < p->prog->nfields; i++) field_free((SltField *)p->fields[i]);
    free(p->fields);
    free(p->field_base);
    free(p->field_count);
    free(p->field_state);
}

static bool same_bits(const SltProgram *p, const double *values, uint64_t i) {
    if (p->opt.f64) return !memcmp(&((const double *)p->flt)[i], &values[i], sizeof(double));
    float v = (float)values[i];
    return !memcmp(&((const float *)p->flt)[i], &v, sizeof v);
}

static void mark(FieldState *s, uint32_t x0, uint32_t x1, uint32_t y) {
    if (s->x0 >= s->x1) s->x0 = x0, s->x1 = x1, s->y0 = y, s->y1 = y + 1; /* the first */
    if (x0 < s->x0) s->x0 = x0;
    if (x1 > s->x1) s->x1 = x1;
    if (y < s->y0) s->y0 = y;
    if (y >= s->y1) s->y1 = y + 1;
}

void api_fields_watch(SltProgram *p, const double *values, uint32_t base, uint32_t count) {
    for (uint32_t f = 0; p->field_state && f < p->prog->nfields; f++) {
        const FieldInfo *info = &p->prog->fields[f];
        uint64_t first = info->base, end = first + (uint64_t)info->w * info->h, from = base > first ? base : first,
                 to = (uint64_t)base + count < end ? (uint64_t)base + count : end;
        if (!p->fields[f]) continue; /* it will be made from whatever the heights are then */
        /* Row by row, from both sides to what differs. Rows of the data run downwards, those of the field upwards. */
        for (uint64_t i = from, next; i < to; i = next) {
            uint64_t row = (i - first) / info->w, start = first + row * info->w, last = start + info->w;
            next = last < to ? last : to;
            uint64_t a = i, b = next;
            while (a < b && same_bits(p, values, a)) a++;
            while (b > a && same_bits(p, values, b - 1)) b--;
            if (a < b)
                mark(&p->field_state[f], (uint32_t)(a - start), (uint32_t)(b - start), info->h - 1 - (uint32_t)row);
        }
    }
}

static const void *heights_of(const SltProgram *p, uint32_t f) {
    return (const char *)p->flt + (size_t)p->prog->fields[f].base * (p->opt.f64 ? sizeof(double) : sizeof(float));
}

SltStatus api_fields(SltProgram *p, SltError *err) {
    static const FieldStructure structures[] = {[SLT_STRUCTURE_AUTO] = FIELD_MIPMAP,
                                                [SLT_STRUCTURE_MIPMAP] = FIELD_MIPMAP,
                                                [SLT_STRUCTURE_CONE] = FIELD_CONE,
                                                [SLT_STRUCTURE_NAIVE] = FIELD_NAIVE};
    for (uint32_t f = 0; f < p->prog->nfields; f++) {
        FieldState *s = &p->field_state[f];
        const FieldInfo *info = &p->prog->fields[f];
        if (!s->wanted) continue;
        if (!p->fields[f] || (s->wanted & ~s->built)) {
            FieldOptions o = {.structure = structures[p->opt.field], .queries = s->wanted, .band = (float)info->band};
            SltField *made = NULL;
            SltStatus status = slt_field_make(&made, heights_of(p, f), p->opt.f64, info->w, info->h, &o, err);
            if (status != SLT_OK) return status;
            field_free((SltField *)p->fields[f]);
            p->fields[f] = made;
            s->built = s->wanted;
            s->made++;
        } else if (s->x0 < s->x1) {
            field_refresh((SltField *)p->fields[f], heights_of(p, f), s->x0, s->y0, s->x1, s->y1);
            s->refreshed++, s->refreshed_heights += (uint64_t)(s->x1 - s->x0) * (s->y1 - s->y0);
        }
        s->x0 = s->x1 = s->y0 = s->y1 = 0;
    }
    return SLT_OK;
}
