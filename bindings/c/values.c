/* Parameter values: the vectors, parameters by name, values as JSON, what is differentiated. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bindings/c/api.h"
#include "bindings/c/shape.h"
#include "runtime/base/json.h"
#include "runtime/base/text.h"

/* ---- the flat vectors */
void api_flt_from(SltProgram *p, const double *values, uint32_t base, uint32_t count) {
    api_derived_watch(p, values, base, count);
    api_geometries_watch(p, values, base, count);
    for (uint32_t i = base; i < base + count; i++)
        if (p->opt.f64) ((double *)p->flt)[i] = values[i];
        else ((float *)p->flt)[i] = (float)values[i];
}

void api_params_changed(SltProgram *p, uint32_t base, uint32_t count) {
    if (!p->flt_lent) api_flt_from(p, p->floats, base, count); /* else the next call without its own copies them all */
}

uint32_t slt_float_count(const SltProgram *p) { return p->prog ? program_floats(p->prog) : 0; }
uint32_t slt_int_count(const SltProgram *p) { return p->prog ? p->prog->nints - p->prog->ntopology : 0; }
const double *slt_floats(const SltProgram *p) { return p->floats; }
const int32_t *slt_ints(const SltProgram *p) { return p->ints; }
uint32_t slt_param_count(const SltProgram *p) { return p->prog ? p->prog->nparams : 0; }
const uint8_t *slt_wrt_mask(const SltProgram *p) { return p->wrt; }

static void describe(const Param *q, SltParam *out) {
    *out = (SltParam){.struct_size = sizeof *out,
                      .name = q->name,
                      .type = q->is_mesh ? q->sym->type->name
                              : q->type  ? q->type->name
                                         : "",
                      .fbase = q->fbase,
                      .fcount = q->fcount,
                      .ibase = q->ibase,
                      .icount = q->icount,
                      .differentiable = q->differentiable,
                      .is_texture = q->is_texture,
                      .is_heightfield = q->type == type_geometry(SLT_GEOMETRY_HEIGHTFIELD),
                      .has_range = q->attrs.has_range,
                      .log = q->attrs.log,
                      .color = q->attrs.color,
                      .lo = q->attrs.lo,
                      .hi = q->attrs.hi,
                      .has_extent = q->attrs.has_extent,
                      .extent = {q->attrs.extent[0], q->attrs.extent[1], q->attrs.extent[2], q->attrs.extent[3]},
                      .height_scale = q->attrs.has_height ? q->attrs.height_scale : 1,
                      .height_offset = q->attrs.has_height ? q->attrs.height_offset : 0,
                      .doc = q->attrs.doc,
                      .tex_w = q->tex_w,
                      .tex_h = q->tex_h,
                      .tex_c = q->tex_c,
                      .tex_d = q->tex_d};
    shape_describe(q, q->type, 0, out);
}

const int32_t *slt_mesh(const SltProgram *p, uint32_t index, uint32_t *nfaces, bool *has_uv) {
    if (index >= slt_param_count(p) || !p->prog->params[index].is_mesh) return NULL;
    const Param *q = &p->prog->params[index];
    if (nfaces) *nfaces = q->sym->nfaces;
    if (has_uv) *has_uv = q->sym->has_uv;
    return p->ints + q->tbase;
}

bool slt_param(const SltProgram *p, uint32_t index, SltParam *out) {
    if (index >= slt_param_count(p) || !api_struct_sized(out)) return false;
    SltParam q;
    describe(&p->prog->params[index], &q);
    api_struct_write(out, &q, sizeof q);
    return true;
}

bool slt_param_field(const SltParam *of, uint32_t index, SltParam *out) {
    SltParam q = SLT_PARAM_INIT;
    if (!api_struct_sized(out) || !api_struct_read(&q, sizeof q, of) || index >= q.nfields) return false;
    shape_field(&q, index);
    api_struct_write(out, &q, sizeof q);
    return true;
}

typedef struct Find {
    const SltProgram *p;
    const char *name, *why;
    ParamRef *out;         /* either */
    ParamPattern *pattern; /* or */
    bool found;
} Find;

static void find_body(Session *s, void *user) {
    (void)s;
    Find *f = user;
    f->found = f->out ? program_find(f->p->prog, f->name, f->out, &f->why)
                      : program_find_pattern(f->p->prog, f->name, f->pattern, &f->why);
}

static SltStatus look_up(Find f, SltStatus wrong, const char *what, SltError *err) {
    Session *s = f.p->session;
    ArenaMark mark = arena_mark(&s->session);
    int unwound = session_protect(s, find_body, &f);
    SltStatus status = SLT_OK;
    if (unwound) status = status_fail(err, (SltStatus)unwound, "%s", s->unwind_text);
    else if (!f.found) status = status_fail(err, wrong, "%s%s%s", what ? what : "", what ? ": " : "", f.why);
    arena_reset(&s->session, mark);
    return status;
}

SltStatus api_find(const SltProgram *p, const char *name, SltStatus wrong, const char *what, ParamRef *out,
                   SltError *err) {
    return look_up((Find){.p = p, .name = name, .out = out}, wrong, what, err);
}

SltStatus api_find_pattern(const SltProgram *p, const char *name, const char *what, ParamPattern *out, SltError *err) {
    return look_up((Find){.p = p, .name = name, .pattern = out}, SLT_USAGE, what, err);
}

static SltStatus find(const SltProgram *p, const char *name, SltParam *out, SltError *err) {
    ParamRef ref;
    SltStatus status = api_find(p, name, SLT_USAGE, NULL, &ref, err);
    if (status != SLT_OK) return status;
    describe(ref.param, out);
    out->name = name;
    out->type = ref.type ? ref.type->name : out->type;
    out->fbase = ref.fbase, out->fcount = ref.fcount, out->ibase = ref.ibase, out->icount = ref.icount;
    uint32_t within = 0; /* a slice, a row, a texel: as many as there are indices, and a channel may have a letter */
    for (const char *c = name + strlen(ref.param->name); *c; c++) within += *c == '[' || *c == '.';
    shape_describe(ref.param, ref.type, within, out);
    return SLT_OK;
}

SltStatus slt_param_find(const SltProgram *p, const char *name, SltParam *out, SltError *err) {
    if (!api_struct_sized(out)) return api_struct_unknown(err, "SltParam");
    SltStatus status = api_enter(p, err);
    if (status != SLT_OK) return status;
    SltParam q;
    status = find(p, name, &q, err);
    if (status == SLT_OK) api_struct_write(out, &q, sizeof q);
    api_release(p);
    return status;
}

SltStatus slt_set_floats(SltProgram *p, uint32_t base, uint32_t count, const double *values, SltError *err) {
    SltStatus status = api_enter_to_set(p, err);
    if (status != SLT_OK) return status;
    const uint32_t n = program_floats(p->prog);
    if (count > n || base > n - count) {
        status = status_fail(err, SLT_USAGE, "floats %u..%u are outside the program's %u", base, base + count, n);
    } else if (count) {
        memmove(p->floats + base, values, count * sizeof *values);
        api_params_changed(p, base, count);
    }
    api_release(p);
    return status;
}

SltStatus slt_set_ints(SltProgram *p, uint32_t base, uint32_t count, const int32_t *values, SltError *err) {
    SltStatus status = api_enter_to_set(p, err);
    if (status != SLT_OK) return status;
    const uint32_t n = p->prog->nints - p->prog->ntopology;
    if (count > n || base > n - count)
        status = status_fail(err, SLT_USAGE, "integers %u..%u are outside the program's %u", base, base + count, n);
    else if (count) memmove(p->ints + base, values, count * sizeof *values);
    api_release(p);
    return status;
}

SltStatus api_wrt(SltProgram *p, const char *const *names, uint32_t n, SltError *err) {
    uint8_t *mask = calloc(p->prog->nfloats + 1, 1);
    if (!names) n = 0;
    if (!mask) return status_fail(err, SLT_LIMIT, "out of memory");
    for (uint32_t i = 0; i < p->prog->nparams && n == 0; i++) {
        const Param *q = &p->prog->params[i];
        if (q->differentiable) memset(mask + q->fbase, 1, q->fcount);
    }
    for (uint32_t i = 0; i < n; i++) {
        ParamPattern q;
        SltStatus status = api_find_pattern(p, names[i], NULL, &q, err);
        if (status == SLT_OK && (!q.at.param->differentiable || !q.at.fcount))
            status = status_fail(err, SLT_USAGE, "`%s` has no gradient: it is %s", names[i],
                                 q.at.fcount ? "marked [NoDiff]" : "an integer");
        if (status != SLT_OK) {
            free(mask);
            return status;
        }
        program_mark(&q, mask);
    }
    api_derived_mark(p, mask);
    api_differentiate(p, mask);
    free(mask);
    return SLT_OK;
}

SltStatus api_wrt_without(SltProgram *p, const char *const *names, uint32_t n, SltError *err) {
    uint8_t *off = calloc(p->prog->nfloats + 1, 1);
    if (!off) return status_fail(err, SLT_LIMIT, "out of memory");
    SltStatus status = SLT_OK;
    for (uint32_t i = 0; i < n && status == SLT_OK; i++) {
        ParamPattern q;
        status = api_find_pattern(p, names[i], NULL, &q, err);
        if (status == SLT_OK) program_mark(&q, off);
    }
    bool changed = false;
    for (uint32_t i = 0; i < p->prog->nfloats && status == SLT_OK; i++)
        if (off[i]) changed |= p->wrt[i], p->wrt[i] = 0;
    api_derived_mark(p, p->wrt);
    if (changed) api_forget_gradients(p);
    free(off);
    return status;
}

SltStatus slt_wrt(SltProgram *p, const char *const *names, uint32_t n, SltError *err) {
    SltStatus status = api_enter_to_set(p, err);
    if (status != SLT_OK) return status;
    status = atomic_load(&p->fitted)
                 ? status_fail(err, SLT_USAGE, "a fit of this program is under way: slt_fit_end first")
                 : api_wrt(p, names, n, err);
    api_release(p);
    return status;
}

/* ---- JSON out */
static void write_scalar(void *user, FILE *out, TypeKind kind, uint32_t index) {
    const SltProgram *p = user;
    switch (kind) {
    case T_BOOL: fputs(p->ints[index] ? "true" : "false", out); return;
    case T_UINT: fprintf(out, "%u", (uint32_t)p->ints[index]); return;
    case T_INT: fprintf(out, "%d", p->ints[index]); return;
    default: {
        double v = p->opt.f64 ? p->floats[index] : (double)(float)p->floats[index];
        /* JSON has no infinities, and readers refuse numbers that overflow: parameters have "inf" and "-inf". A whole
         * number, as the reader takes "-0", has no sign at 0. */
        if (isinf(v)) fputs(v > 0 ? "\"inf\"" : "\"-inf\"", out);
        else if (v == 0 && signbit(v)) fputs("-0.0", out);
        else if (p->opt.f64) json_number(out, v);
        else json_number_f32(out, (float)v);
    }
    }
}

char *slt_params_json(const SltProgram *p) {
    Text text;
    if (api_enter(p, NULL) != SLT_OK) return NULL;
    FILE *out = text_open(&text);
    if (!out) return api_release(p), NULL;
    fputs("{\n", out);
    for (uint32_t i = 0; i < p->prog->nparams; i++) {
        const Param *q = &p->prog->params[i];
        ShapeCursor c = {q->fbase, q->ibase};
        fputs("  ", out);
        json_text(out, q->name);
        fputs(": ", out);
        if (param_is_image(q)) shape_write_texels(out, q, write_scalar, (void *)p);
        else shape_write(out, q->type, &c, false, write_scalar, (void *)p);
        fputs(i + 1 < p->prog->nparams ? ",\n" : "\n", out);
    }
    fputs("}\n", out);
    api_release(p);
    return text_close(&text);
}
