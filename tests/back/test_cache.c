/* The disk cache: a hit is the same code without LLVM; anything doubtful is ignored and rewritten. */
#include <dirent.h>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "tests/scratch.h"

#include "compiler/back/back.h"
#include "compiler/back/core/core.h"
#include "compiler/back/cpu/emit.h"

enum { N = 64 };
static Fn *adding(Session *s, double constant) {
    Fn *fn = ir_fn(s, &s->module, "p", PREC_F32);
    Builder b = ir_at_end(fn, fn->body);
    Inst *sum = ir_emit2(&b, OP_fadd, ir_input(&b, IN_X0), ir_constf(&b, constant));
    ir_yield(&b, 1, &sum);
    return fn;
}

/* Compiles x + constant, checks that it computes that, and says whether it came from the cache. */
static bool compiled_from_cache(double constant, uint32_t width, const char *cache, bool no_cache) {
    Session *s = session_create(0);
    BackOptions o = {.width = width, .opt_level = 2, .cache_dir = cache, .no_cache = no_cache};
    target_host(&o.target);
    KernelRequest k = {"kernel", adding(s, constant)};
    CompiledModule *m = NULL;
    const char *why = "";
    assert_int_equal(back_compile(s, &k, 1, &o, &m, &why), 0);
    _Alignas(64) float x[N], out[N];
    for (int i = 0; i < N; i++) x[i] = (float)i;
    SltKernelArgs a = {.in = {[IN_X0] = x}, .out = {out}, .n_valid = N};
    back_kernel(m, "kernel")(&a, N);
    for (int i = 0; i < N; i++) assert_true(out[i] == (float)i + (float)constant);
    double emit, llvm;
    bool cached;
    back_times(m, &emit, &llvm, &cached);
    assert_true(cached == (llvm == 0));
    assert_true(back_instructions(m, "kernel") > 3);
    back_free(m);
    session_destroy(s);
    return cached;
}

static int entries(char *path, size_t size) {
    DIR *d = opendir(scratch);
    int n = 0;
    if (!d) return 0;
    for (struct dirent *f; (f = readdir(d));)
        if (f->d_name[0] != '.') {
            n++;
            snprintf(path, size, "%s/%s", scratch, f->d_name);
        }
    closedir(d);
    return n;
}

static int teardown(void **state) {
    chmod(scratch, 0700);
    return scratch_drop(state);
}

static void test_hit(void **state) {
    (void)state;
    assert_false(compiled_from_cache(1, 8, scratch, false));
    assert_true(compiled_from_cache(1, 8, scratch, false));
    assert_false(compiled_from_cache(1, 8, scratch, true));
    assert_false(compiled_from_cache(2, 8, scratch, false));  /* another constant */
    assert_false(compiled_from_cache(1, 16, scratch, false)); /* another width */
    char path[512];
    assert_int_equal(entries(path, sizeof path), 3);
    struct stat st;
    assert_int_equal(stat(path, &st), 0);
    assert_int_equal(st.st_mode & 077, 0);
}

static void test_damage(void **state) {
    (void)state;
    char path[512];
    assert_false(compiled_from_cache(1, 8, scratch, false));
    assert_int_equal(entries(path, sizeof path), 1);
    struct stat st;
    assert_int_equal(stat(path, &st), 0);
    for (long at = 0; at < st.st_size; at += st.st_size / 40 + 1) {
        FILE *f = fopen(path, "r+b");
        fseek(f, at, SEEK_SET);
        int c = fgetc(f);
        fseek(f, at, SEEK_SET);
        fputc(c ^ 0x40, f);
        fclose(f);
        assert_false(compiled_from_cache(1, 8, scratch, false)); /* ignored, and made again */
        assert_true(compiled_from_cache(1, 8, scratch, false));
    }
    assert_int_equal(truncate(path, st.st_size - 5), 0);
    assert_false(compiled_from_cache(1, 8, scratch, false));
    assert_int_equal(truncate(path, 10), 0);
    assert_false(compiled_from_cache(1, 8, scratch, false));
    assert_true(compiled_from_cache(1, 8, scratch, false));
}

/* Two modules in one go are two entries: what one of them is missing does not make the other again. */
static void test_together(void **state) {
    (void)state;
    for (int second = 2; second < 4; second++) {
        Session *s = session_create(0);
        KernelRequest k[2] = {{"kernel", adding(s, 1)}, {"kernel", adding(s, second)}};
        BackJob jobs[2] = {{.k = &k[0], .n = 1, .o = {.width = 8, .opt_level = 2, .cache_dir = scratch}}, {0}};
        target_host(&jobs[0].o.target);
        jobs[1] = jobs[0], jobs[1].k = &k[1];
        const char *why = "";
        assert_int_equal(back_compile_all(s, jobs, 2, &why), 0);
        for (int i = 0; i < 2; i++) {
            _Alignas(64) float x[N], out[N];
            for (int j = 0; j < N; j++) x[j] = (float)j;
            SltKernelArgs a = {.in = {[IN_X0] = x}, .out = {out}, .n_valid = N};
            back_kernel(jobs[i].out, "kernel")(&a, N);
            for (int j = 0; j < N; j++) assert_true(out[j] == (float)(j + (i ? second : 1)));
            double emit, llvm;
            bool cached;
            back_times(jobs[i].out, &emit, &llvm, &cached);
            assert_true(cached == (second == 3 && i == 0));
            back_free(jobs[i].out);
        }
        session_destroy(s);
        assert_true(compiled_from_cache(second, 8, scratch, false));
    }
}

static void set_time(const char *path, time_t seconds) {
    struct timespec both[2] = {{.tv_sec = seconds}, {.tv_sec = seconds}};
    assert_int_equal(utimensat(AT_FDCWD, path, both, 0), 0);
}

/* A file saved after the last entry was written will probably be compiled: said once, and of no file that is not there.
 */
static void test_behind(void **state) {
    (void)state;
    char folder[512], source[512];
    snprintf(folder, sizeof folder, "%s/kept", scratch), snprintf(source, sizeof source, "%s/p.salt", scratch);
    assert_false(cache_is_behind(folder, source));
    FILE *f = fopen(source, "w");
    assert_non_null(f);
    fclose(f);
    assert_true(cache_is_behind(folder, source)); /* no folder */
    assert_int_not_equal(access(folder, F_OK), 0);
    assert_false(compiled_from_cache(1, 8, folder, false));
    set_time(source, 1000), set_time(folder, 1001);
    assert_false(cache_is_behind(folder, source));
    set_time(source, 1002);
    assert_true(cache_is_behind(folder, source));
    assert_false(cache_is_behind(folder, source));
    set_time(folder, 1001);
    assert_false(compiled_from_cache(2, 8, folder, false));
    assert_false(cache_is_behind(folder, source));
}

/* What stands in an entry's place is never waited for, and what killed writers left is swept away; a temporary file
 * that somebody still writes is not. */
static void test_bystanders(void **state) {
    (void)state;
    char path[512], left[512], held[512];
    struct stat st;
    assert_false(compiled_from_cache(1, 8, scratch, false));
    assert_int_equal(entries(path, sizeof path), 1);
    assert_int_equal(unlink(path), 0);
    assert_int_equal(mkfifo(path, 0600), 0);
    snprintf(left, sizeof left, "%s/tmp-abcdef", scratch);
    snprintf(held, sizeof held, "%s/tmp-ghijkl", scratch);
    int fd = open(held, O_CREAT | O_WRONLY, 0600);
    assert_int_equal(flock(fd, LOCK_EX), 0);
    assert_int_equal(close(open(left, O_CREAT | O_WRONLY, 0600)), 0);
    assert_false(compiled_from_cache(1, 8, scratch, false));
    assert_true(compiled_from_cache(1, 8, scratch, false));
    assert_true(stat(left, &st) && !stat(held, &st));
    close(fd);
    assert_false(compiled_from_cache(2, 8, scratch, false));
    assert_true(stat(held, &st));
}

/* What lies there longest goes when all is too large, though few writers look how large it is. */
static void test_size(void **state) {
    (void)state;
    enum { OLD = 70, MIB = 1 << 20, SMALL = 16 << 10, FEW = 512 };
    char path[512];
    struct stat st;
    for (int i = 0; i < OLD; i++) { /* without a block on the disk */
        snprintf(path, sizeof path, "%s/%032d.o", scratch, i);
        assert_int_equal(close(open(path, O_CREAT | O_WRONLY, 0600)), 0);
        assert_int_equal(truncate(path, 4 * MIB), 0);
        const struct timespec used[2] = {{.tv_sec = 1000 + i}, {.tv_sec = 1000 + i}};
        assert_int_equal(utimensat(AT_FDCWD, path, used, 0), 0);
    }
    Session *s = session_create(0);
    unsigned char *bytes = calloc(1, SMALL);
    CacheKey key = {.len = 1};
    int trimmed = -1;
    for (int i = 0; i < FEW; i++) {
        key.hi = (uint64_t)i, key.lo = (key.lo + (uint64_t)i + 1) * UINT64_C(0x9e3779b97f4a7c15);
        assert_true(cache_write(&s->scratch, scratch, CACHE_OBJECTS, &key, bytes, SMALL));
        snprintf(path, sizeof path, "%s/%032d.o", scratch, 0);
        if (trimmed < 0 && stat(path, &st)) trimmed = i;
    }
    assert_in_range(trimmed, 1, FEW - 1); /* 64 on average */
    int left = 0;
    for (int i = 0; i < OLD; i++) {
        snprintf(path, sizeof path, "%s/%032d.o", scratch, i);
        bool here = !stat(path, &st);
        assert_true(here >= (left > 0)); /* by age */
        left += here;
    }
    assert_in_range(left, 40, 48); /* with the rest, 192 MiB */
    size_t size;
    unsigned char *back = cache_read(&s->scratch, scratch, CACHE_OBJECTS, &key, &size);
    assert_non_null(back);
    assert_int_equal(size, SMALL);
    free(back);
    free(bytes);
    session_destroy(s);
}

static void test_wrong_key(void **state) {
    (void)state;
    char one[512], two[512];
    assert_false(compiled_from_cache(1, 8, scratch, false));
    entries(one, sizeof one);
    char moved[520];
    snprintf(moved, sizeof moved, "%s.kept", one);
    assert_int_equal(rename(one, moved), 0);
    assert_false(compiled_from_cache(2, 8, scratch, false));
    DIR *d = opendir(scratch);
    two[0] = 0;
    for (struct dirent *f; (f = readdir(d));)
        if (f->d_name[0] != '.' && !strstr(f->d_name, ".kept")) snprintf(two, sizeof two, "%s/%s", scratch, f->d_name);
    closedir(d);
    assert_int_equal(rename(moved, two), 0); /* the code of 1 under the name of 2 */
    assert_false(compiled_from_cache(2, 8, scratch, false));
}

static void test_unusable_folder(void **state) {
    (void)state;
    chmod(scratch, 0777); /* others could plant code */
    assert_false(compiled_from_cache(1, 8, scratch, false));
    assert_false(compiled_from_cache(1, 8, scratch, false));
    char path[512];
    assert_int_equal(entries(path, sizeof path), 0);
    chmod(scratch, 0700);
    assert_false(compiled_from_cache(1, 8, "/proc/nowhere/saltus", false));
    snprintf(path, sizeof path, "%s/a/b", scratch); /* made as needed */
    assert_false(compiled_from_cache(1, 8, path, false));
    assert_true(compiled_from_cache(1, 8, path, false));
    struct stat st;
    assert_int_equal(stat(path, &st), 0);
    assert_int_equal(st.st_mode & 0777, 0700);
    char command[600];
    snprintf(command, sizeof command, "rm -r '%s/a'", scratch);
    assert_int_equal(system(command), 0);
}

/* Whatever bytes the loader is given, it refuses or loads them; it never reads outside. (Run under a sanitizer to mean
 * it.) */
static void test_loader_on_damaged_objects(void **state) {
    (void)state;
    Session *s = session_create(0);
    BackOptions o = {.width = 8, .opt_level = 2};
    target_host(&o.target);
    KernelRequest k = {"kernel", adding(s, 1)};
    const char *why = NULL;
    static unsigned char bytes[65536];
    unsigned char *whole;
    size_t size;
    assert_int_equal(back_emit(s, &k, 1, &o, 'o', &whole, &size, &why), 0);
    assert_true(size <= sizeof bytes);
    unsigned char *copy = aligned_alloc(64, 65536);
    Loaded *l = load_object(memcpy(copy, whole, size), size, &why);
    assert_non_null(l);
    assert_non_null(load_symbol(l, "kernel", NULL));
    assert_null(load_symbol(l, "nothing", NULL));
    load_free(l);
    uint32_t x = 1;
    int refused = 0;
    for (int round = 0; round < 4000; round++) {
        memcpy(bytes, whole, size);
        for (int j = 0; j < 3; j++) {
            x = x * 1664525u + 1013904223u;
            size_t at = round & 1 ? (x >> 8) % 64 : (x >> 8) % size;
            bytes[at] = (unsigned char)(x >> 24);
        }
        size_t n = round % 5 ? size : (x >> 4) % size;
        memcpy(copy, bytes, n);
        l = load_object(copy, n, &why);
        refused += !l;
        load_free(l);
    }
    assert_true(refused > 400);
    free(copy);
    free(whole);
    session_destroy(s);
}

/* A library that was copied by half is passed over: mapped, it would end the process. */
static void test_half_a_library(void **state) {
    (void)state;
    char out[256];
    assert_int_equal(scratch_run(out, sizeof out,
                                 "cp \"$(command -v sh)\" whole; size=$(wc -c < whole); : > empty; "
                                 "head -c $((size / 2)) whole > half; head -c 40 whole > head; "
                                 "echo 'INPUT(libLLVM.so.1)' > text; mkdir folder"),
                     0);
    assert_true(llvm_is_whole(scratch_path("whole")));
    static const char *const others[] = {"half", "head", "empty", "text", "folder", "none"};
    for (size_t i = 0; i < sizeof others / sizeof *others; i++) assert_false(llvm_is_whole(scratch_path(others[i])));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_hit, scratch_make, teardown),
        cmocka_unit_test_setup_teardown(test_damage, scratch_make, teardown),
        cmocka_unit_test_setup_teardown(test_together, scratch_make, teardown),
        cmocka_unit_test_setup_teardown(test_behind, scratch_make, teardown),
        cmocka_unit_test_setup_teardown(test_bystanders, scratch_make, teardown),
        cmocka_unit_test_setup_teardown(test_size, scratch_make, teardown),
        cmocka_unit_test_setup_teardown(test_wrong_key, scratch_make, teardown),
        cmocka_unit_test_setup_teardown(test_unusable_folder, scratch_make, teardown),
        cmocka_unit_test_setup_teardown(test_loader_on_damaged_objects, scratch_make, teardown),
        cmocka_unit_test_setup_teardown(test_half_a_library, scratch_make, teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
