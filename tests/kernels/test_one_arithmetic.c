/* One arithmetic: for the same (x, parameters, stream) every decision, every g and every value is the same, bit for
 * bit, in all variants, at all widths, in both precisions, and in the interpreter. Programs: tests/programs/ and
 * whatever else SALTUS_TEST_PROGRAMS lists. */
#include <dirent.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "bindings/c/api.h"

enum { N = 512, NOUT = 24 };

typedef struct Io {
    void *in[SLT_IN_VARYING], *out[NOUT];
    SltKernelArgs args;
} Io;

static void set(bool f64, void *a, int i, double v) {
    if (f64) ((double *)a)[i] = v;
    else ((float *)a)[i] = (float)v;
}

static void io_make(Io *io, const SltProgram *p) {
    memset(io, 0, sizeof *io);
    for (int i = 0; i < SLT_IN_VARYING; i++) {
        io->in[i] = aligned_alloc(64, (N + 64) * 8);
        memset(io->in[i], 0, (N + 64) * 8);
        io->args.in[i] = io->in[i];
    }
    for (int i = 0; i < NOUT; i++) {
        io->out[i] = aligned_alloc(64, (N + 64) * 8);
        memset(io->out[i], 0, (N + 64) * 8);
        io->args.out[i] = io->out[i];
    }
    io->args.params = p->flt, io->args.iparams = p->ints;
    io->args.resolution[0] = io->args.resolution[1] = 16;
    io->args.n_valid = N;
    srand(7);
    for (int i = 0; i < N + 64; i++) {
        for (int d = 0; d < 3; d++) {
            double u = rand() / (RAND_MAX + 1.0), span = p->prog->hi[d] - p->prog->lo[d];
            /* Ends of a pair lie close together half of the time. */
            if (i % 2 && i % 8 < 4) {
                double before =
                    p->opt.f64 ? ((double *)io->in[IN_X0 + d])[i - 1] : (double)((float *)io->in[IN_X0 + d])[i - 1];
                set(p->opt.f64, io->in[IN_X0 + d], i, before + 0.02 * span * (u - 0.5));
            } else {
                set(p->opt.f64, io->in[IN_X0 + d], i, p->prog->lo[d] + u * span);
            }
        }
        set(p->opt.f64, io->in[IN_RAND0], i, (i / 2 * 37 % 100) / 100.0);
        ((int32_t *)io->in[IN_STREAM])[i] = i / 2;
        ((int32_t *)io->in[IN_PIXEL0])[i] = i % 16;
        ((int32_t *)io->in[IN_PIXEL1])[i] = i / 16;
    }
}

static void io_free(Io *io) {
    for (int i = 0; i < SLT_IN_VARYING; i++) free(io->in[i]);
    for (int i = 0; i < NOUT; i++) free(io->out[i]);
}

static size_t out_bytes(const SltProgram *p, const Fn *fn, uint32_t o) {
    return N * (fn->body->last->args[o]->type == TY_FLT && p->opt.f64 ? 8 : 4);
}

static const int kinds[] = {K_VALUE, K_REGION, K_EVENT, K_SIDES, K_SITE, K_SITE_GRAD};
enum { NKINDS = sizeof kinds / sizeof *kinds };

static void same_bits(const char *file, const SltProgram *p, Io *want, Io *got, const Fn *fn, int kind) {
    for (uint32_t o = 0; o < fn->body->last->nargs; o++) {
        const char *a = want->out[o], *b = got->out[o];
        size_t bytes = out_bytes(p, fn, o), each = bytes / N;
        for (int i = 0; i < N; i++) {
            if (!memcmp(a + (size_t)i * each, b + (size_t)i * each, each)) continue;
            double x = 0, y = 0;
            float fx, fy;
            if (each == 8) memcpy(&x, a + (size_t)i * 8, 8), memcpy(&y, b + (size_t)i * 8, 8);
            else memcpy(&fx, a + (size_t)i * 4, 4), memcpy(&fy, b + (size_t)i * 4, 4), x = fx, y = fy;
            if (isnan(x) && isnan(y)) continue; /* payloads are nobody's business */
            fail_msg("%s %s kernel %s width %u: output %u of sample %d: %.17g (interpreter) and %.17g", file,
                     p->opt.f64 ? "f64" : "f32", kernel_names[kind], p->opt.width, o, i, x, y);
        }
    }
}

static SltProgram *load(const char *path, bool f64, uint32_t width, const char *target) {
    SltOptions o = SLT_OPTIONS_INIT;
    o.f64 = f64, o.width = width, o.seed = 3, o.verify = true, o.no_cache = true, o.target = target;
    SltProgram *p = NULL;
    SltStatus s = slt_compile_file(path, &o, &p);
    if (s != SLT_OK) fail_msg("%s: %s\n%s", path, slt_last_error(p), slt_diagnostics_text(p));
    SltError err = {0};
    bool needs[K_KINDS] = {0};
    for (int k = 0; k < NKINDS; k++) needs[kinds[k]] = true;
    if (api_kernels(p, needs, &err) != SLT_OK) fail_msg("%s: %s", path, err.text);
    return p;
}

static void *output(const SltProgram *p, const Io *io, int kind, SltRole role, uint32_t k) {
    return io->out[p->scene.layout[kind].out[role].first + k];
}

/* Relations between the kernels of one program, on the interpreter's outputs. */
static void relations(const char *file, SltProgram *p, Io *out) {
    if (!p->fn[K_REGION]) return;
    const int32_t *hash = output(p, &out[1], K_REGION, SLT_OUT_HASH, 0),
                  *site = output(p, &out[2], K_EVENT, SLT_OUT_SITE, 0),
                  *hash2 = output(p, &out[3], K_SIDES, SLT_OUT_HASH, 0);
    const void *g = output(p, &out[2], K_EVENT, SLT_OUT_G, 0);
    size_t each = p->opt.f64 ? 8 : 4;
    for (int i = 0; i < N; i++) {
        if (hash[i] != hash2[i]) fail_msg("%s: region and sides disagree on the hash of sample %d", file, i);
        for (uint32_t c = 0; c < p->prog->channels; c++)
            if (memcmp((char *)out[0].out[c] + (size_t)i * each, (char *)out[3].out[c] + (size_t)i * each, each) != 0)
                fail_msg("%s: value and sides disagree on f of sample %d", file, i);
    }
    int differing = 0;
    for (int i = 0; i < N; i += 2) {
        if (site[i] != site[i + 1]) fail_msg("%s: the ends of pair %d name different sites", file, i / 2);
        if (hash[i] != hash[i + 1] && site[i] < 0) fail_msg("%s: pair %d: hashes differ without an event", file, i / 2);
        if (site[i] < 0) continue;
        differing++;
        double ga = p->opt.f64 ? ((double *)g)[i] : (double)((float *)g)[i];
        double gb = p->opt.f64 ? ((double *)g)[i + 1] : (double)((float *)g)[i + 1];
        if (!(ga * gb <= 0))
            fail_msg("%s: pair %d, site %d: g does not change sign: %g %g", file, i / 2, site[i], ga, gb);
    }
    if (differing == 0) fail_msg("%s: no pair of samples was separated: the test shows nothing", file);
}

/* The site kernel gives, at the ends, the very g that the event kernel reported. */
static void site_agrees(const char *file, SltProgram *p, Io *events) {
    if (!p->fn[K_SITE]) return;
    Io io;
    io_make(&io, p);
    const SltLayout *l = &p->scene.layout[K_EVENT];
    const int32_t *site = output(p, events, K_EVENT, SLT_OUT_SITE, 0);
    const char *g = output(p, events, K_EVENT, SLT_OUT_G, 0);
    size_t each = p->opt.f64 ? 8 : 4;
    for (uint32_t s = 0; s < p->prog->primal->nsites; s++) {
        bool any = false;
        for (int i = 0; i < N; i++) any |= site[i] == (int32_t)s;
        if (!any) continue;
        io.args.site = (int32_t)s;
        if (l->out[SLT_OUT_BOUNDARY].count)
            memcpy(io.in[IN_BOUNDARY], output(p, events, K_EVENT, SLT_OUT_BOUNDARY, 0), N * each);
        for (uint32_t d = 0; d < l->out[SLT_OUT_K].count; d++)
            memcpy(io.in[IN_K0 + d], output(p, events, K_EVENT, SLT_OUT_K, d), N * 4);
        ir_interpret(p->fn[K_SITE], &io.args, N, 16);
        for (int i = 0; i < N; i++)
            if (site[i] == (int32_t)s &&
                memcmp((char *)io.out[0] + (size_t)i * each, g + (size_t)i * each, each) != 0) {
                double x = p->opt.f64 ? ((double *)io.out[0])[i] : (double)((float *)io.out[0])[i],
                       y = p->opt.f64 ? ((const double *)g)[i] : (double)((const float *)g)[i];
                fail_msg("%s: site %u, sample %d: site kernel gives g = %.17g, event %.17g", file, s, i, x, y);
            }
    }
    io_free(&io);
}

static void one_program(const char *path) {
    for (int f64 = 0; f64 < 2; f64++) {
        SltProgram *p = load(path, f64, 16, NULL);
        Io want[NKINDS];
        for (int k = 0; k < NKINDS; k++) {
            io_make(&want[k], p);
            if (p->fn[kinds[k]]) ir_interpret(p->fn[kinds[k]], &want[k].args, N, 16);
        }
        relations(path, p, want);
        site_agrees(path, p, &want[2]);
        slt_program_free(p);
        static const uint32_t widths[] = {1, 4, 8, 16, 32};
        for (size_t w = 0; w < sizeof widths / sizeof *widths; w++) {
            p = load(path, f64, widths[w], NULL);
            for (int k = 0; k < NKINDS; k++) {
                SltKernel *f = p->scene.kernel[kinds[k]];
                if (!f) continue;
                Io io;
                io_make(&io, p);
                f(&io.args, N);
                same_bits(path, p, &want[k], &io, p->fn[kinds[k]], kinds[k]);
                io_free(&io);
            }
            slt_program_free(p);
        }
        for (int k = 0; k < NKINDS; k++) io_free(&want[k]);
    }
}

static void all_programs(void **state) {
    (void)state;
    const char *dir = SALTUS_TEST_DIR "/programs";
    DIR *d = opendir(dir);
    assert_non_null(d);
    int n = 0;
    for (struct dirent *e; (e = readdir(d));) {
        size_t len = strlen(e->d_name);
        if (len < 6 || strcmp(e->d_name + len - 5, ".salt")) continue;
        char path[512];
        snprintf(path, sizeof path, "%s/%s", dir, e->d_name);
        one_program(path);
        n++;
    }
    closedir(d);
    assert_true(n >= 7);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(all_programs)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
