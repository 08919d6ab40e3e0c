/* Geometries that kernels search: from the first kernel that asks to the end of the program.
 *
 * A geometry is made when compiled kernels hold a query on it, and only for the queries that they hold. It follows its
 * numbers: it hears which of them really change, and is brought up to date before the next estimate. */
#include <stdlib.h>
#include <string.h>

#include "bindings/c/place.h"

static uint32_t block_queries(const Block *b, uint32_t geometry) {
    uint32_t queries = 0;
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_query && i->imm.query.geometry == geometry) queries |= 1u << i->imm.query.what;
        /* What is told may have been asked of another mesh alone. */
        if (i->op == OP_told && i->imm.query.geometry == geometry) queries |= 1u << SLT_QUERY_BEGIN;
        for (uint32_t r = 0; r < i->nregions; r++) queries |= block_queries(i->region[r], geometry);
    }
    return queries;
}

uint32_t api_geometry_queries(const Fn *fn, uint32_t geometry) {
    uint32_t queries = 0;
    for (; fn; fn = fn->next_part) queries |= block_queries(fn->body, geometry);
    return queries;
}

void api_geometries_want(SltProgram *p, const Fn *fn) {
    for (uint32_t g = 0; g < p->prog->ngeometries; g++) p->geometry_state[g].wanted |= api_geometry_queries(fn, g);
}

void api_geometries_ask(SltProgram *p, const uint32_t *queries) {
    for (uint32_t g = 0; g < p->prog->ngeometries; g++) p->geometry_state[g].wanted |= queries[g];
}

bool api_geometries_init(SltProgram *p) {
    uint32_t n = p->prog->ngeometries;
    p->geometries = calloc(n + 1, sizeof *p->geometries);
    p->geometry_base = calloc(n + 1, sizeof *p->geometry_base);
    p->geometry_state = calloc(n + 1, sizeof *p->geometry_state);
    if (!p->geometries || !p->geometry_base || !p->geometry_state) return false;
    for (uint32_t g = 0; g < n; g++) p->geometry_base[g] = p->prog->geometries[g].base;
    return true;
}

void api_geometries_free(SltProgram *p) {
    for (uint32_t g = 0; p->geometries && p->prog && g < p->prog->ngeometries; g++)
        geometry_free((SltGeometry *)p->geometries[g]);
    free(p->geometries);
    free(p->geometry_base);
    free(p->geometry_state);
}

static bool same_bits(const SltProgram *p, const double *values, uint64_t i) {
    if (p->opt.f64) return !memcmp(&((const double *)p->flt)[i], &values[i], sizeof(double));
    float v = (float)values[i];
    return !memcmp(&((const float *)p->flt)[i], &v, sizeof v);
}

void api_geometries_watch(SltProgram *p, const double *values, uint32_t base, uint32_t count) {
    for (uint32_t g = 0; p->geometry_state && g < p->prog->ngeometries; g++) {
        const GeometryInfo *info = &p->prog->geometries[g];
        uint64_t first = info->base, end = first + info->count, at = base > first ? base : first,
                 to = (uint64_t)base + count < end ? (uint64_t)base + count : end;
        if (!p->geometries[g]) continue; /* not made yet: it will be, from the numbers of that time */
        while (at < to) {
            while (at < to && same_bits(p, values, at)) at++;
            uint64_t from = at;
            while (at < to && !same_bits(p, values, at)) at++;
            if (from < at) geometry_changed((SltGeometry *)p->geometries[g], from - first, at - from);
        }
    }
}

static const void *values_of(const SltProgram *p, uint32_t g) {
    return (const char *)p->flt + (size_t)p->prog->geometries[g].base * (p->opt.f64 ? sizeof(double) : sizeof(float));
}

static SltStatus make(SltProgram *p, uint32_t g, SltError *err) {
    const GeometryInfo *info = &p->prog->geometries[g];
    GeometryState *s = &p->geometry_state[g];
    GeometrySource from = {.kind = info->kind,
                           .size = {info->size[0], info->size[1]},
                           .nvertices = info->count / 3,
                           .nfaces = info->nfaces,
                           .faces = p->ints + info->tbase,
                           .f64 = p->opt.f64,
                           .queries = s->wanted,
                           .band = (float)info->band,
                           .structure = p->opt.field};
    SltGeometry *made;
    SltStatus status = geometry_make(&made, &from, values_of(p, g), err);
    if (status != SLT_OK) return status;
    geometry_free((SltGeometry *)p->geometries[g]);
    p->geometries[g] = made;
    s->built = s->wanted;
    s->made++;
    return SLT_OK;
}

bool api_geometries_lost(const SltProgram *p) {
    bool lost = false;
    for (uint32_t g = 0; p->geometries && g < p->prog->ngeometries; g++)
        lost |= p->geometries[g] && geometry_lost(p->geometries[g]);
    return lost;
}

void api_geometries_unmet(const SltProgram *p, SltStats *stats) {
    stats->unmet = 0, stats->unmet_at = (SltPlace){0};
    for (uint32_t g = 0; p->geometries && g < p->prog->ngeometries; g++) {
        const uint64_t n = p->geometries[g] ? geometry_unmet(p->geometries[g]) : 0;
        if (n && !stats->unmet)
            api_name_place(p, &stats->unmet_at, p->prog->params[p->prog->geometries[g].param].sym->span);
        stats->unmet += n;
    }
}

uint32_t api_geometries_blind(const SltProgram *p, SltPlace *at) {
    uint32_t blind = 0;
    for (uint32_t g = 0; p->geometries && g < p->prog->ngeometries; g++) {
        if (!p->geometries[g] || !geometry_blind(p->geometries[g])) continue;
        if (at && !blind) api_name_place(p, at, p->prog->params[p->prog->geometries[g].param].sym->span);
        blind++;
    }
    return blind;
}

SltStatus api_geometries(SltProgram *p, SltError *err) {
    for (uint32_t g = 0; g < p->prog->ngeometries; g++) {
        GeometryState *s = &p->geometry_state[g];
        if (!s->wanted) continue;
        if (!p->geometries[g] || (s->wanted & ~s->built)) {
            SltStatus status = make(p, g, err);
            if (status != SLT_OK) return status;
            continue;
        }
        uint64_t followed = geometry_follow((SltGeometry *)p->geometries[g], values_of(p, g));
        s->followed += followed > 0, s->followed_values += followed;
    }
    return SLT_OK;
}
