/* What leaves a kernel other than its outputs: print, counters, packed pixels, lists of iterations and what is noted
 * for them, the tape's limit; and the emitted files. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "compiler/back/core/core.h"
#include "runtime/image/image.h"

enum { N = 64 };
static CompiledModule *compile_with(Session *s, Fn *fn, const BackOptions *o) {
    KernelRequest k = {"kernel", fn};
    CompiledModule *m = NULL;
    const char *why = "";
    int status = back_compile(s, &k, 1, o, &m, &why);
    if (status) fprintf(stderr, "%s\n", why);
    assert_int_equal(status, 0);
    assert_true(back_instructions(m, "kernel") > 0 && back_machine_bytes(m, "kernel") > 0);
    assert_null(back_kernel(m, "other"));
    return m;
}
static CompiledModule *compile(Session *s, Fn *fn, uint32_t width, BackPixels pixels) {
    BackOptions o = {.width = width, .no_cache = true, .opt_level = 2, .pixels = pixels};
    target_host(&o.target);
    return compile_with(s, fn, &o);
}

typedef struct Lines {
    char text[4096];
    size_t len;
} Lines;

static void collect(void *user, const char *text, uint32_t len, const double *values, uint32_t n, uint32_t lane) {
    Lines *l = user;
    l->len += (size_t)snprintf(l->text + l->len, sizeof l->text - l->len, "%.*s %u:", (int)len, text, lane);
    for (uint32_t k = 0; k < n; k++)
        l->len += (size_t)snprintf(l->text + l->len, sizeof l->text - l->len, " %g", values[k]);
    l->len += (size_t)snprintf(l->text + l->len, sizeof l->text - l->len, "\n");
}

/* if (x > 40) { print("big", x, k, x > 50); count }; output x */
static Fn *printing(Session *s) {
    Fn *fn = ir_fn(s, &s->module, "p", PREC_F32);
    Builder b = ir_at_end(fn, fn->body);
    Inst *x = ir_input(&b, IN_X0), *k = ir_input(&b, IN_K0);
    Inst *i = ir_if(&b, ir_emit2(&b, OP_flt, ir_constf(&b, 40), x));
    Builder t = ir_at_end(fn, i->region[0]), e = ir_at_end(fn, i->region[1]);
    Inst *values[3] = {x, k, ir_emit2(&t, OP_flt, ir_constf(&t, 50), x)};
    ir_special(&t, OP_print, TY_VOID, 3, values, (Imm){.text = {"big and more", 3}});
    Inst *on = ir_constb(&t, true);
    ir_special(&t, OP_count, TY_VOID, 1, &on, (Imm){.i = COUNTER_ASSERT});
    ir_yield(&t, 0, NULL);
    ir_yield(&e, 0, NULL);
    ir_yield(&b, 1, &x);
    return fn;
}

static void test_print_and_count(void **state) {
    (void)state;
    _Alignas(64) float x[N], out[N];
    _Alignas(64) int32_t k[N];
    for (int i = 0; i < N; i++) x[i] = (float)i, k[i] = -i;
    for (uint32_t w = 1; w <= 64; w *= 2) {
        Session *s = session_create(0);
        CompiledModule *m = compile(s, printing(s), w, BACK_FLOATS);
        Lines lines = {{0}, 0};
        SltKernelArgs a = {
            .in = {[IN_X0] = x, [IN_K0] = k}, .out = {out}, .n_valid = 52, .print = collect, .user = &lines};
        back_kernel(m, "kernel")(&a, N);
        assert_int_equal(a.counters[COUNTER_ASSERT], 11);
        char want[4096];
        size_t len = 0;
        for (int i = 41; i < 52; i++)
            len += (size_t)snprintf(want + len, sizeof want - len, "big %d: %d %d %d\n", i, i, -i, i > 50);
        assert_string_equal(lines.text, want);
        a.print = NULL; /* nobody listens */
        back_kernel(m, "kernel")(&a, N);
        back_free(m);
        session_destroy(s);
    }
}

/* red = x, green = y, blue = 0.5 */
static Fn *colours(Session *s, uint32_t channels) {
    Fn *fn = ir_fn(s, &s->module, "p", PREC_F32);
    Builder b = ir_at_end(fn, fn->body);
    Inst *v[3] = {ir_input(&b, IN_X0), ir_input(&b, IN_X1), ir_constf(&b, 0.5)};
    ir_yield(&b, channels, v);
    return fn;
}

static void test_rgba8(void **state) {
    (void)state;
    _Alignas(64) float x[N], y[N];
    _Alignas(64) uint32_t out[N];
    for (int i = 0; i < N; i++) x[i] = (float)i / 32 - 0.5f, y[i] = i == 7 ? __builtin_nanf("") : 1 - (float)i / 63;
    x[3] = HUGE_VALF, x[4] = 1e30f, x[5] = -HUGE_VALF, x[6] = nextafterf(1, 0);
    for (uint32_t w = 1; w <= 32; w *= 4)
        for (uint32_t channels = 1; channels <= 3; channels += 2) {
            Session *s = session_create(0);
            CompiledModule *m = compile(s, colours(s, channels), w, BACK_PIXELS_RAW);
            SltKernelArgs a = {.in = {[IN_X0] = x, [IN_X1] = y}, .out = {out}, .n_valid = N};
            back_kernel(m, "kernel")(&a, N);
            for (int i = 0; i < N; i++) {
                float cx = x[i] > 0 ? x[i] : 0, cy = y[i] > 0 ? y[i] : 0;
                uint32_t r = (uint32_t)((cx < 1 ? cx : 1) * 255 + 0.5f), g = (uint32_t)((cy < 1 ? cy : 1) * 255 + 0.5f);
                assert_int_equal(out[i], channels == 1 ? 0xff000000u | r | r << 8 | r << 16
                                                       : 0xff000000u | 128u << 16 | g << 8 | r);
            }
            back_free(m);
            session_destroy(s);
        }
}

/* Channels that are known to give a byte go without limits: red from 0 to 1 by clamps, green from .1 to .9, blue not,
 * however it looks: sums with 1e8 round to multiples of 8. */
static Fn *bounded(Session *s, Precision precision) {
    Fn *fn = ir_fn(s, &s->module, "p", precision);
    Builder b = ir_at_end(fn, fn->body);
    Inst *x = ir_input(&b, IN_X0), *far = ir_constf(&b, 1e8);
    Inst *unit = ir_emit2(&b, OP_fmin, ir_emit2(&b, OP_fmax, x, ir_constf(&b, 0)), ir_constf(&b, 1));
    Inst *few = ir_constf(&b, 4.5), *sum = ir_emit2(&b, OP_fadd, ir_emit2(&b, OP_fadd, unit, few), far);
    Inst *blue = ir_emit2(&b, OP_fsub, ir_emit2(&b, OP_fsub, sum, far), few);
    Inst *v[3] = {unit, ir_emit3(&b, OP_ffma, unit, ir_constf(&b, 0.8), ir_constf(&b, 0.1)), blue};
    ir_yield(&b, 3, v);
    return fn;
}

static void test_known_bytes(void **state) {
    (void)state;
    static const char *const targets[] = {"native", "avx512", "avx2", "sse2"};
    _Alignas(64) double wide[N];
    _Alignas(64) float x[N];
    _Alignas(64) uint32_t out[N];
    for (int i = 0; i < N; i++) x[i] = (float)i / 32 - 0.5f;
    x[3] = HUGE_VALF, x[4] = 1e30f, x[5] = -HUGE_VALF, x[6] = nextafterf(1, 0), x[7] = __builtin_nanf("");
    for (int i = 0; i < N; i++) wide[i] = (double)x[i];
    for (uint32_t k = 0; k < 4 * 2 * 4; k++) {
        const bool f64 = k & 1;
        BackOptions o = {.width = 1u << (k >> 1 & 3) * 2, .no_cache = true, .opt_level = 2, .pixels = BACK_PIXELS_RAW};
        target_host(&o.target);
        if (!target_named(&o.target, targets[k >> 3])) continue; /* not on this processor */
        Session *s = session_create(0);
        Fn *fn = bounded(s, f64 ? PREC_F64 : PREC_F32);
        CompiledModule *m = compile_with(s, fn, &o);
        SltKernelArgs a = {.in = {[IN_X0] = f64 ? (void *)wide : x}, .out = {out}, .n_valid = N};
        back_kernel(m, "kernel")(&a, N);
        for (int i = 0; i < N; i++) {
            const bool nan = isnan(x[i]);
            const float unit = nan || x[i] < 0 ? 0 : x[i] > 1 ? 1 : x[i];
            const uint32_t green = nan   ? 0
                                   : f64 ? (uint32_t)(fma((double)unit, 0.8, 0.1) * 255 + 0.5)
                                         : (uint32_t)(fmaf(unit, 0.8f, 0.1f) * 255 + 0.5f);
            const float far = f64 || nan ? unit : ((unit + 4.5f) + 1e8f) - 1e8f - 4.5f, blue = far > 1   ? 1
                                                                                               : far < 0 ? 0
                                                                                                         : far;
            assert_int_equal(out[i] >> 24, 255);
            assert_int_equal(out[i] & 255, (uint32_t)(unit * 255 + 0.5f));
            assert_int_equal(out[i] >> 8 & 255, green);
            assert_true(abs((int)(out[i] >> 16 & 255) - (int)(blue * 255 + 0.5f)) <= (f64 ? 1 : 0));
        }
        back_free(m);
        session_destroy(s);
    }
}

/* Of an input that a call shares only the first is read. */
static void test_same(void **state) {
    (void)state;
    _Alignas(64) float x[N], y[N];
    _Alignas(64) uint32_t out[N];
    for (int i = 0; i < N; i++) x[i] = (float)i / N, y[i] = i ? __builtin_nanf("") : 0.75f;
    for (uint32_t w = 1; w <= 32; w *= 4) {
        Session *s = session_create(0);
        Fn *fn = colours(s, 3);
        fn->same = ~(1ull << IN_X0);
        CompiledModule *m = compile(s, fn, w, BACK_PIXELS_RAW);
        SltKernelArgs a = {.in = {[IN_X0] = x, [IN_X1] = y}, .out = {out}, .n_valid = N};
        back_kernel(m, "kernel")(&a, N);
        for (int i = 0; i < N; i++) {
            assert_int_equal(out[i] & 255, (int)(x[i] * 255 + 0.5f));
            assert_int_equal(out[i] >> 8 & 255, 191);
        }
        back_free(m);
        session_destroy(s);
    }
}

/* Through the curve of sRGB: the byte of the picture files, or its neighbour where that rounds from the middle. */
static void test_srgb8(void **state) {
    (void)state;
    _Alignas(64) float x[N], y[N];
    _Alignas(64) uint32_t out[N];
    uint32_t moved = 0, shades = 0;
    for (uint32_t w = 1; w <= 32; w *= 4) {
        Session *s = session_create(0);
        CompiledModule *m = compile(s, colours(s, 3), w, BACK_PIXELS_SRGB);
        for (int block = 0; block < 256; block++) {
            for (int i = 0; i < N; i++) {
                x[i] = (float)(block * N + i - 100) / (256 * N - 200);
                y[i] = x[i] * x[i] * x[i] * x[i];
            }
            if (block == 0) y[3] = __builtin_nanf("");
            SltKernelArgs a = {.in = {[IN_X0] = x, [IN_X1] = y}, .out = {out}, .n_valid = N};
            back_kernel(m, "kernel")(&a, N);
            for (int i = 0; i < N; i++) {
                int want[3] = {(int)lrintf(255 * image_encode_srgb(x[i])), (int)lrintf(255 * image_encode_srgb(y[i])),
                               188};
                for (int c = 0; c < 3; c++, shades++) {
                    int apart = abs((int)(out[i] >> 8 * c & 255) - want[c]);
                    assert_true(apart <= 1);
                    moved += apart != 0;
                }
            }
        }
        back_free(m);
        session_destroy(s);
    }
    assert_true(moved * 25 < shades);
}

/* if (k0 > 9) a loop over list 1 of twelve: notes (k0 + k) % 4 == 0 and k0 + 2 k > 70; output: the sum of k. An
 * even number of operations that change nothing besides. */
static Fn *noting(Session *s, int idle) {
    Fn *fn = ir_fn(s, &s->module, "p", PREC_F32);
    Builder b = ir_at_end(fn, fn->body);
    Inst *k0 = ir_input(&b, IN_K0), *zero = ir_consti(&b, 0);
    Inst *i = ir_if(&b, ir_emit2(&b, OP_ilt, ir_consti(&b, 9), k0));
    Builder t = ir_at_end(fn, i->region[0]), e = ir_at_end(fn, i->region[1]);
    Inst *loop =
        ir_loop(&t, 1, &zero, (LoopInfo){.max_iters = 12, .exact = true, .cull = true, .found = true, .cull_id = 1});
    Inst *k = loop->region[0]->params[0], *sum = loop->region[0]->params[1];
    Builder in = ir_at_end(fn, loop->region[0]);
    Inst *place = ir_emit2(&in, OP_iadd, k0, k), *low = ir_emit2(&in, OP_iand, place, ir_consti(&in, 3));
    for (int n = 0; n < idle; n++) place = ir_emit2(&in, OP_ixor, place, k0);
    Inst *what[2] = {ir_emit2(&in, OP_ieq, low, zero),
                     ir_emit2(&in, OP_ilt, ir_consti(&in, 70), ir_emit2(&in, OP_iadd, place, k))};
    ir_special(&in, OP_note, TY_VOID, 2, what, (Imm){.i = 1});
    ir_yield(&in, 2, (Inst *[]){ir_emit2(&in, OP_ilt, k, ir_consti(&in, 11)), ir_emit2(&in, OP_iadd, sum, k)});
    ir_yield(&t, 1, (Inst *[]){ir_proj(&t, loop, 0)});
    ir_yield(&e, 1, &zero);
    ir_yield(&b, 1, (Inst *[]){ir_proj(&b, i, 0)});
    ir_number(fn);
    return fn;
}

/* Compiled kernels of every width and the interpreter, a loop that is emitted once and one that is emitted twice, with
 * a list and without. */
static void test_notes(void **state) {
    (void)state;
    static const int32_t items[5] = {1, 2, 6, 7, 11};
    _Alignas(64) int32_t k0[N], out[N];
    for (int i = 0; i < N; i++) k0[i] = i;
    for (uint32_t w = 1; w <= 64; w *= 2)
        for (int idle = 0; idle <= 100; idle += 100) {
            Session *s = session_create(0);
            Fn *fn = noting(s, idle);
            CompiledModule *m = compile(s, fn, w, BACK_FLOATS);
            for (int count = -1; count <= 5; count += 2) {
                SltCullList lists[2] = {{NULL, -1}, {items, count}};
                int32_t n = count < 0 ? 12 : count, sum = 0;
                for (int32_t j = 0; j < n; j++) sum += count < 0 ? j : items[j];
                for (int interpreted = 0; interpreted < 2; interpreted++) {
                    SltNote notes[13] = {{0}}, *of[2] = {NULL, notes};
                    SltKernelArgs a = {
                        .in = {[IN_K0] = k0}, .out = {out}, .n_valid = N, .cull = count < 0 ? NULL : lists, .note = of};
                    if (interpreted) assert_int_equal(ir_interpret(fn, &a, N, w), 0);
                    else back_kernel(m, "kernel")(&a, N);
                    for (int32_t j = 0; j < 13; j++) {
                        int32_t k = count < 0 ? j : j < n ? items[j] : 0;
                        uint64_t may = 0, must = 0;
                        for (int32_t i = 10; i < N && j < n; i++) {
                            may |= (uint64_t)((i + k) % 4 == 0) << i;
                            must |= (uint64_t)(i + 2 * k > 70) << i;
                        }
                        assert_true(notes[j].may == may && notes[j].must == must);
                    }
                    for (int i = 0; i < N; i++) assert_int_equal(out[i], i > 9 ? sum : 0);
                    a.note = NULL; /* nobody wants them */
                    if (!interpreted) back_kernel(m, "kernel")(&a, N);
                }
            }
            back_free(m);
            session_destroy(s);
        }
}

/* Four trips that push x; then the sum of what is popped. */
static Fn *taping(Session *s) {
    Fn *fn = ir_fn(s, &s->module, "p", PREC_F32);
    Builder b = ir_at_end(fn, fn->body);
    Inst *x = ir_input(&b, IN_X0), *mark = ir_special(&b, OP_tapemark, TY_TAPE, 0, NULL, (Imm){0});
    Inst *loop = ir_loop(&b, 1, &x, (LoopInfo){.max_iters = 4});
    Block *body = loop->region[0];
    Builder t = ir_at_end(fn, body);
    ir_special(&t, OP_tapepush, TY_VOID, 1, &body->params[1], (Imm){0});
    Inst *y[2] = {ir_emit2(&t, OP_ilt, body->params[0], ir_consti(&t, 3)),
                  ir_emit2(&t, OP_fadd, body->params[1], ir_constf(&t, 1))};
    ir_yield(&t, 2, y);
    Inst *init[2] = {mark, ir_constf(&b, 0)};
    Inst *rev = ir_special(&b, OP_revloop, TY_VOID, 2, init, (Imm){0});
    Block *rb = ir_block(fn, rev);
    Inst *frame = ir_block_param(fn, rb, TY_FLT), *sum = ir_block_param(fn, rb, TY_FLT);
    Builder r = ir_at_end(fn, rb);
    Inst *next = ir_emit2(&r, OP_fadd, frame, sum);
    ir_yield(&r, 1, &next);
    Inst *out = ir_proj(&b, rev, 0);
    ir_yield(&b, 1, &out);
    return fn;
}

static void test_tape_limit(void **state) {
    (void)state;
    _Alignas(64) float x[N], out[N];
    _Alignas(64) unsigned char tape[4096 + 64];
    for (int i = 0; i < N; i++) x[i] = (float)i;
    for (uint32_t w = 1; w <= 64; w *= 2) {
        Session *s = session_create(0);
        CompiledModule *m = compile(s, taping(s), w, BACK_FLOATS);
        for (uint32_t frames = 0; frames <= 4; frames++) {
            memset(tape, 0xa5, sizeof tape);
            SltKernelArgs a = {
                .in = {[IN_X0] = x}, .out = {out}, .n_valid = N, .tape = tape, .tape_bytes = frames * 4 * w};
            back_kernel(m, "kernel")(&a, N);
            assert_int_equal(a.counters[COUNTER_TAPE_OVERFLOW], (4 - frames) * (N / w));
            for (uint32_t k = frames * 4 * w; k < sizeof tape; k++) assert_int_equal(tape[k], 0xa5);
            for (int i = 0; i < N; i++) {
                float want = 0;
                for (uint32_t f = 0; f < frames; f++) want += (float)i + (float)f;
                assert_true(out[i] == want);
            }
        }
        back_free(m);
        session_destroy(s);
    }
}

static void test_files(void **state) {
    (void)state;
    Session *s = session_create(0);
    BackOptions o = {.width = 8, .opt_level = 2};
    target_host(&o.target);
    KernelRequest k = {"kernel", colours(s, 3)};
    static const char kinds[] = "osl";
    const char *why = "";
    unsigned char *bytes;
    size_t size;
    for (int j = 0; kinds[j]; j++) {
        assert_int_equal(back_emit(s, &k, 1, &o, kinds[j], &bytes, &size, &why), 0);
        assert_true(size > 100);
        if (kinds[j] == 'o') assert_memory_equal(bytes, "\177ELF", 4);
        else assert_non_null(memmem(bytes, size, "kernel", 6));
        free(bytes);
    }
    session_destroy(s);
}

/* More values at once than there are registers: each is stored and read back as one cache line has it, not across two
 * as chance places the stack. */
static void test_spills_are_aligned(void **state) {
    (void)state;
    enum { VALUES = 80 };
    static const char *const target[] = {"avx512", "avx2", "sse2"}, *const align[] = {"andq\t$-64, %rsp",
                                                                                      "andq\t$-32, %rsp", NULL};
    for (int t = 0; t < 3; t++) {
        Session *s = session_create(0);
        Fn *fn = ir_fn(s, &s->module, "p", PREC_F32);
        Builder b = ir_at_end(fn, fn->body);
        Inst *x = ir_input(&b, IN_X0), *v[VALUES], *sum = x;
        for (int i = 0; i < VALUES; i++) v[i] = x = ir_emit1(&b, OP_fsqrt, x);
        for (int i = 0; i < VALUES; i++) sum = ir_emit2(&b, OP_fdiv, sum, v[i]);
        ir_yield(&b, 1, &sum);
        BackOptions o = {.width = 16, .opt_level = 2};
        assert_true(target_named(&o.target, target[t]));
        KernelRequest k = {"kernel", fn};
        const char *why = "";
        unsigned char *bytes;
        size_t size;
        assert_int_equal(back_emit(s, &k, 1, &o, 's', &bytes, &size, &why), 0);
        if (align[t]) assert_non_null(memmem(bytes, size, align[t], strlen(align[t])));
        else assert_null(memmem(bytes, size, "andq\t$-", 7));
        free(bytes);
        session_destroy(s);
    }
}

static void test_bad_requests(void **state) {
    (void)state;
    Session *s = session_create(0);
    BackOptions o = {.width = 12, .no_cache = true, .opt_level = 2};
    target_host(&o.target);
    KernelRequest k = {"kernel", colours(s, 1)};
    CompiledModule *m = NULL;
    const char *why = NULL;
    assert_int_equal(back_compile(s, &k, 1, &o, &m, &why), 2);
    assert_non_null(why);
    /* local arrays beyond the stack's share */
    Fn *fn = ir_fn(s, &s->module, "p", PREC_F32);
    Builder b = ir_at_end(fn, fn->body);
    Inst *x = ir_input(&b, IN_X0), *n = ir_input(&b, IN_K0);
    Inst *array = ir_special(&b, OP_alloc, TY_ARRAY, 0, NULL, (Imm){.arr = {1 << 20, TY_FLT}}),
         *store[3] = {array, n, x};
    ir_special(&b, OP_store, TY_VOID, 3, store, (Imm){0});
    Inst *load = ir_special(&b, OP_load, TY_FLT, 2, store, (Imm){0});
    ir_yield(&b, 1, &load);
    o.width = 16;
    k.fn = fn;
    assert_int_equal(back_compile(s, &k, 1, &o, &m, &why), 6);
    assert_non_null(strstr(why, "local arrays"));
    session_destroy(s);
}

/* A processor runs its own target and what is narrower. */
static void test_target_runs(void **state) {
    (void)state;
    static const char *const names[3] = {"sse2", "avx2", "avx512"};
    Target t, here;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            assert_true(target_named(&t, names[i]) && target_named(&here, names[k]));
            assert_int_equal(target_runs(&t, &here), i <= k);
        }
    Target no_fma = here;
    no_fma.has_fma = false;
    assert_false(target_runs(&here, &no_fma));
    assert_true(target_runs(&no_fma, &here));
    target_host(&t), target_named(&here, "native");
    assert_true(target_runs(&t, &here) && target_runs(&here, &here));
}

/* The width depends on program and target alone: two vectors a value, one in very large kernels and in those of few
 * samples, where no width is given. */
/* x * x * x ..., whose steps wait for each other. */
static Fn *waits(Session *s) {
    Fn *fn = ir_fn(s, &s->module, "w", PREC_F32);
    Builder b = ir_at_end(fn, fn->body);
    Inst *x = ir_input(&b, IN_X0), *loop = ir_loop(&b, 1, &x, (LoopInfo){.max_iters = 9, .exact = true});
    Builder t = ir_at_end(fn, loop->region[0]);
    Inst *y[2] = {ir_emit2(&t, OP_ilt, loop->region[0]->params[0], ir_consti(&t, 8)),
                  ir_emit2(&t, OP_fmul, loop->region[0]->params[1], x)};
    ir_yield(&t, 2, y);
    Inst *out = ir_proj(&b, loop, 0);
    ir_yield(&b, 1, &out);
    return fn;
}

static void test_choose_width(void **state) {
    (void)state;
    Session *s = session_create(0);
    KernelRequest few = {"kernel", colours(s, 3)};
    static const struct {
        const char *name;
        uint32_t lanes;
    } targets[3] = {{"sse2", 4}, {"avx2", 8}, {"avx512", 16}};
    Fn *fn = ir_fn(s, &s->module, "p", PREC_F32);
    Builder b = ir_at_end(fn, fn->body);
    static Inst *v[2200];
    Inst *sum = ir_input(&b, IN_X0);
    for (int i = 0; i < 2200; i++) v[i] = ir_emit2(&b, OP_fmul, i ? v[i - 1] : sum, ir_constf(&b, i));
    for (int i = 0; i < 2200; i++) sum = ir_emit2(&b, OP_fadd, sum, v[i]);
    ir_yield(&b, 1, &sum);
    KernelRequest many = {"kernel", fn}, two[2] = {few, few}, loop = {"kernel", waits(s)};
    KernelRequest image = {"kernel", ir_clone(few.fn, &s->module, "value")};
    BackOptions o = {0};
    for (int i = 0; i < 3; i++) {
        assert_true(target_named(&o.target, targets[i].name));
        assert_int_equal(back_choose_width(&few, 0, &o), 2 * targets[i].lanes);
        assert_int_equal(back_choose_width(&many, 0, &o), targets[i].lanes);
        assert_int_equal(back_choose_width(&loop, 0, &o), 4 * targets[i].lanes);
        assert_int_equal(back_width_choice(&few, 0, &o).why, WIDTH_STRAIGHT);
        assert_int_equal(back_choose_width(&image, 0, &o), 4 * targets[i].lanes);
        assert_int_equal(back_width_choice(&image, 0, &o).why, WIDTH_IMAGE);
        WidthChoice c = back_width_choice(&many, 0, &o);
        assert_true(c.why == WIDTH_MOST_CODE && c.vectors == 1 && c.found > 4400 && c.limit == 4096);
        c = back_width_choice(&loop, 0, &o); /* it keeps the product, and x where registers are many */
        assert_true(c.why == WIDTH_SHORT_LOOP && c.vectors == 4 && c.found == (i == 2 ? 2 : 1));
        assert_int_equal(c.limit, i == 2 ? 8 : 3);
        assert_int_equal(back_adjoint_lanes(&o, PREC_F32), 16);
        assert_int_equal(back_adjoint_lanes(&o, PREC_F64), 8);
    }
    o.few = 2;
    assert_int_equal(back_choose_width(two, 0, &o), 32);
    assert_int_equal(back_choose_width(two, 1, &o), 16);
    assert_int_equal(back_width_choice(two, 1, &o).why, WIDTH_FEW);
    o.width = 4;
    assert_int_equal(back_width_choice(two, 1, &o).why, WIDTH_GIVEN);
    assert_int_equal(back_choose_width(two, 1, &o), 4);
    assert_int_equal(back_adjoint_lanes(&o, PREC_F32), 4);
    o.adj = ADJ_FLAT;
    assert_int_equal(back_adjoint_lanes(&o, PREC_F32), 1);
    Target t;
    assert_false(target_named(&t, "pdp11"));
    session_destroy(s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_print_and_count),    cmocka_unit_test(test_rgba8),
        cmocka_unit_test(test_known_bytes),        cmocka_unit_test(test_same),
        cmocka_unit_test(test_spills_are_aligned), cmocka_unit_test(test_srgb8),
        cmocka_unit_test(test_tape_limit),         cmocka_unit_test(test_files),
        cmocka_unit_test(test_bad_requests),       cmocka_unit_test(test_target_runs),
        cmocka_unit_test(test_choose_width),       cmocka_unit_test(test_notes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
