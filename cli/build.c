/* saltus build: ahead-of-time code (.o .s .ll .so) and a C header beside it, or the header alone (.h). */
#include <assert.h>
#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "bindings/c/api.h"
#include "cli/cli.h"
#include "runtime/base/text.h"
#include "kernel_text.h" /* include/saltus/kernel.h as a string, made by the build */

static char kind_of(const char *path) {
    const char *dot = strrchr(path, '.');
    if (!dot) return 0;
    if (!strcmp(dot, ".o")) return 'o';
    if (!strcmp(dot, ".s")) return 's';
    if (!strcmp(dot, ".ll")) return 'l';
    if (!strcmp(dot, ".so")) return 'S';
    if (!strcmp(dot, ".h")) return 'h';
    return 0;
}

/* A C identifier from the output's file name. */
static void stem_of(const char *path, char *stem, size_t size) {
    const char *slash = strrchr(path, '/'), *s = slash ? slash + 1 : path;
    size_t n = 0;
    if (isdigit((unsigned char)*s)) stem[n++] = '_';
    for (; *s && *s != '.' && n + 1 < size; s++) stem[n++] = isalnum((unsigned char)*s) ? *s : '_';
    stem[n] = 0;
}

static void identifier(const char *name, char *out, size_t size) {
    size_t n = 0;
    for (; *name && n + 1 < size; name++) out[n++] = isalnum((unsigned char)*name) ? *name : '_';
    out[n] = 0;
}

static void write_number(FILE *h, const char *prefix, const char *id, int value, const char *what) {
    fprintf(h, "    SLT_%s%s = %d,", prefix, id, value);
    if (*what) fprintf(h, " /* %s */", what);
    fputc('\n', h);
}

/* contract.h with its rows written out: the header made here stands alone. */
static void write_contract(FILE *h) {
    fputs("#ifndef SALTUS_CONTRACT_H\n#define SALTUS_CONTRACT_H\n", h);
    fputs("/* SltKernelArgs.in */\ntypedef enum SltInput {\n", h);
#define SLT_INPUT(id, text, type, tail, what) write_number(h, "IN_", #id, SLT_IN_##id, what);
#include "saltus/kernel.def"
    write_number(h, "IN_", "VARYING", SLT_IN_VARYING, "how many");
    fputs("} SltInput;\n/* SltLayout.out */\ntypedef enum SltRole {\n", h);
#define SLT_ROLE(id, text, type, most, what) write_number(h, "OUT_", #id, SLT_OUT_##id, what);
#include "saltus/kernel.def"
    write_number(h, "", "ROLES", SLT_ROLES, "how many");
    fputs("} SltRole;\n/* SltKernelArgs.counters */\ntypedef enum SltCounter {\n", h);
#define SLT_COUNTER(id, text, what) write_number(h, "COUNT_", #id, SLT_COUNT_##id, what);
#include "saltus/kernel.def"
    write_number(h, "", "COUNTERS", SLT_COUNTERS, "how many");
    fputs("} SltCounter;\nenum {\n", h);
#define SLT_LIMIT(id, value, what) write_number(h, "", #id, value, what);
#include "saltus/kernel.def"
    fputs("};\n/* of a box, and of g of one event on a box: bits */\nenum {\n", h);
    write_number(h, "BOX_", "UNKNOWN", SLT_BOX_UNKNOWN, "something else decides");
    write_number(h, "BOX_", "ROUGH", SLT_BOX_ROUGH, "f may be not smooth");
    write_number(h, "EDGE_", "JUMPS", SLT_EDGE_JUMPS, "g may jump");
    write_number(h, "EDGE_", "BENDS", SLT_EDGE_BENDS, "its gradient may");
    fputs("};\n#endif\n", h);
}

/* kernel.h without its include of contract.h. */
static void write_kernel_header(FILE *h) {
    static const char include[] = "#include \"saltus/contract.h\"\n";
    const char *at = strstr(kernel_text, include);
    assert(at);
    fwrite(kernel_text, 1, (size_t)(at - kernel_text), h);
    write_contract(h);
    fputs(at + strlen(include), h);
}

/* The declaration of a kernel, and where its outputs are. */
static void write_kernel(FILE *h, const SltProgram *p, const char *stem, int k) {
    static const char *const names[SLT_ROLES] = {
#define SLT_ROLE(id, ...) #id,
#include "saltus/kernel.def"
    };
    const SltLayout *l = &p->scene.layout[k];
    fprintf(h, "/* outputs:");
    for (int r = 0; r < SLT_ROLES; r++)
        if (l->out[r].count > 1)
            fprintf(h, " %d..%d %s", l->out[r].first, l->out[r].first + l->out[r].count - 1, names[r]);
        else if (l->out[r].count) fprintf(h, " %d %s", l->out[r].first, names[r]);
    fprintf(h, " */\nvoid %s_%s(SltKernelArgs *args, uint32_t n);\n", stem, kernel_names[k]);
}

/* Exact, and a constant in every C and C++. */
static void write_float(FILE *h, const char *before, double v) {
    if (isfinite(v)) fprintf(h, "%s%.17g", before, v);
    else fprintf(h, "%s%s", before, isnan(v) ? "(0.0 / 0.0)" : v > 0 ? "(1.0 / 0.0)" : "(-1.0 / 0.0)");
}

static char *make_header(const SltProgram *p, const char *stem) {
    char id[256];
    Text text;
    FILE *h = text_open(&text);
    if (!h) return NULL;
    const char *flt = p->opt.f64 ? "double" : "float";
    fprintf(h, "/* %s: kernels of shader `%s`, made by saltus %s. */\n#ifndef %s_SALTUS_H\n#define %s_SALTUS_H\n\n",
            stem, p->prog->entry, slt_version(), stem, stem);
    write_kernel_header(h);
    fprintf(h, "\n#include <string.h>\n\n#ifdef __cplusplus\nextern \"C\" {\n#endif\n\ntypedef %s %s_flt;\n", flt,
            stem);
    fprintf(h, "enum { %s_DIM = %u, %s_CHANNELS = %u, %s_FLOATS = %u, %s_INTS = %u };\n\n", stem, p->prog->dim, stem,
            p->prog->channels, stem, p->prog->nfloats, stem, p->prog->nints);
    fprintf(h,
            "/* Where parameters lie in SltKernelArgs.params (floats) and .iparams (integers and bools). */\nenum {\n");
    for (uint32_t i = 0; i < p->prog->nparams; i++) {
        const Param *q = &p->prog->params[i];
        identifier(q->name, id, sizeof id);
        if (q->fcount)
            fprintf(h, "    %s_%s = %u, /* %s, %u floats */\n", stem, id, q->fbase, q->type ? q->type->name : "",
                    q->fcount);
        if (q->icount) fprintf(h, "    %s_%s_int = %u, /* %u integers */\n", stem, id, q->ibase, q->icount);
    }
    fprintf(h, "    %s_NONE_\n};\n\n", stem);
    if (p->prog->nfloats <= 65536) {
        fprintf(h, "static const %s_flt %s_params[%u] = {", stem, stem, p->prog->nfloats ? p->prog->nfloats : 1);
        for (uint32_t i = 0; i < p->prog->nfloats; i++)
            write_float(h, i % 8 ? ", " : i ? ",\n    " : "\n    ", p->floats[i]);
        fprintf(h, "%s};\n", p->prog->nfloats ? "\n" : "0");
        fprintf(h, "static const int32_t %s_iparams[%u] = {", stem, p->prog->nints ? p->prog->nints : 1);
        for (uint32_t i = 0; i < p->prog->nints; i++) fprintf(h, "%s%d", i ? ", " : "", p->ints[i]);
        fprintf(h, "%s};\n\n", p->prog->nints ? "" : "0");
    }
    for (int k = 0; k < K_KINDS; k++)
        if (p->fn[k]) write_kernel(h, p, stem, k);
    fprintf(
        h,
        "\n/* f at n points: x[axis] and out[channel] are arrays readable and writable up to n rounded up to 64, 64-byte aligned. */\n"
        "static inline void %s_eval(const %s_flt *params, const int32_t *iparams, const %s_flt *const *x, %s_flt *const *out, uint32_t n) {\n"
        "    static const int32_t zero[64] = {0};\n"
        "    SltKernelArgs args;\n"
        "    int i;\n"
        "    memset(&args, 0, sizeof args);\n"
        "    for (i = 0; i < SLT_IN_VARYING; i++) args.in[i] = n <= 64 ? (const void *)zero : (const void *)x[0];\n"
        "    for (i = 0; i < %s_DIM; i++) args.in[i] = x[i];\n"
        "    for (i = 0; i < %s_CHANNELS; i++) args.out[i] = out[i];\n"
        "    args.params = params;\n    args.iparams = iparams;\n    args.n_valid = n;\n    args.resolution[0] = args.resolution[1] = 1;\n"
        "    %s_value(&args, n);\n}\n",
        stem, stem, stem, stem, stem, stem, stem);
    fprintf(h, "\n#ifdef __cplusplus\n}\n#endif\n#endif\n");
    return text_close(&text);
}

/* SLT_OUTPUT for a header that is there and does not say that it was made here. */
static SltStatus check_header(const char *path, SltError *err) {
    uint8_t *text;
    size_t size;
    if (access(path, F_OK) != 0 && (errno == ENOENT || errno == ENOTDIR)) return SLT_OK;
    SltStatus s = file_read_all(path, &file_text, &text, &size, err);
    if (s != SLT_OK) return s == SLT_LIMIT ? s : (err->status = SLT_OUTPUT);
    if (size > 512) text[512] = 0; /* it says so at its head */
    if (!strstr((char *)text, "made by saltus"))
        s = status_fail(err, SLT_OUTPUT,
                        "'%s' would be overwritten by the header, and was not made by saltus: choose another name",
                        path);
    free(text);
    return s;
}

typedef struct Emitted {
    const Cli *c;
    SltProgram *p;
    const char *stem;
    char kind;
    SltStatus status;
    const char *why;
    unsigned char *code;
    size_t size;
} Emitted;

static void emit(Session *s, void *user) {
    Emitted *e = user;
    KernelRequest req[K_KINDS];
    uint32_t n = 0;
    for (int k = 0; k < K_KINDS; k++)
        if (e->p->fn[k])
            req[n++] = (KernelRequest){arena_printf(&s->module, "%s_%s", e->stem, kernel_names[k]), e->p->fn[k]};
    BackOptions bo = {.target = e->p->target,
                      .width = e->c->opt.width,
                      .adj = api_adjoint_lanes(e->p) == 1 ? ADJ_FLAT : ADJ_LANES,
                      .opt_level = 2,
                      .pixels = api_pixels(e->p)};
    e->status = (SltStatus)back_emit(s, req, n, &bo, e->kind == 'S' ? 'o' : e->kind, &e->code, &e->size, &e->why);
}

static int build(Cli *c, SltProgram *p) {
    if (!c->output) return cli_usage(c, "build wants -o out.o, .s, .ll, .so or .h");
    char kind = kind_of(c->output), stem[128];
    if (!kind) return cli_usage(c, "-o %s: the extension should be .o, .s, .ll, .so or .h", c->output);
    stem_of(c->output, stem, sizeof stem);
    SltError err = {0};
    bool needs[K_KINDS];
    for (int k = 0; k < K_KINDS; k++) needs[k] = true;
    if (c->job.no_boundary)
        needs[K_REGION] = needs[K_EVENT] = needs[K_SIDES] = needs[K_SITE] = needs[K_SITE_GRAD] = needs[K_SITE_JVP] =
            needs[K_SITE_VJP] = false;
    if (c->job.no_interior) needs[K_JVP] = needs[K_VJP] = false;
    p->threads = c->job.threads, p->guarded = true;
    SltStatus status = api_kernels_unrun(p, needs, &err);
    if (status != SLT_OK) return cli_fail(c, &err);
    if (p->prog->nderived)
        return cli_usage(
            c, "`%s` has %s, which the library computes whenever parameters change: what `build` makes stands alone",
            p->prog->params[p->prog->derived[0].param].name, p->prog->derived[0].what);
    for (uint32_t f = 0; f < p->prog->ngeometries; f++)
        for (int k = 0; k < K_KINDS; k++)
            if (api_geometry_queries(p->fn[k], f))
                return cli_usage(
                    c, "kernel %s searches `%s`, which needs the library's structures: what `build` makes stands alone",
                    kernel_names[k], p->prog->params[p->prog->geometries[f].param].name);
    char *header = make_header(p, stem);
    if (!header) return cli_error(SLT_LIMIT, "out of memory");
    char *header_path = cli_need(malloc(strlen(c->output) + 4));
    strcpy(header_path, c->output);
    strcpy(strrchr(header_path, '.'), ".h");
    unsigned char *code = NULL;
    size_t size = 0;
    if (kind != 'h') status = check_header(header_path, &err);
    if (kind != 'h' && status == SLT_OK) {
        Emitted e = {.c = c, .p = p, .stem = stem, .kind = kind};
        int unwound = session_protect(p->session, emit, &e);
        code = e.code, size = e.size;
        if (unwound) status = status_fail(&err, (SltStatus)unwound, "%s", p->session->unwind_text);
        else if (e.status != SLT_OK)
            status = status_fail(&err, e.status, "%s", e.why ? e.why : "the object could not be made");
        else if (kind == 'S') status = cli_link(&code, &size, &err);
    }
    FileGroup outputs;
    file_group_begin(&outputs);
    if (status == SLT_OK && code) status = file_write_atomic(c->output, code, size, &err);
    if (status == SLT_OK) status = file_write_atomic(header_path, header, strlen(header), &err);
    status = file_group_end(&outputs, status, &err);
    free(code);
    if (status == SLT_OK && c->json) {
        fputs("{\"outputs\": [", stdout);
        json_text(stdout, c->output);
        if (kind != 'h') fputs(", ", stdout), json_text(stdout, header_path);
        fputs("], \"prefix\": ", stdout);
        json_text(stdout, stem);
        fputs(", ", stdout);
        report_warnings_json(stdout, p, NULL);
        fputs("}\n", stdout);
    }
    free(header);
    free(header_path);
    return status == SLT_OK ? SLT_OK : cli_fail(c, &err);
}

int verb_build(Cli *c) {
    SltProgram *p;
    int status = cli_compile(c, &p);
    if (status == SLT_OK) status = build(c, p);
    slt_program_free(p);
    return status;
}
