/* Files that belong together: all of them are the new ones, or what was there is there. */
#include "tests/scratch.h"

#include <dirent.h>
#include <sys/stat.h>

#include "runtime/image/image.h"

static void must(SltStatus s, const SltError *err) {
    if (s != SLT_OK) fail_msg("%s", err->text);
}

static void holds(const char *name, const char *text) {
    SltError err = {0};
    uint8_t *bytes;
    size_t size;
    must(file_read_all(scratch_path(name), &file_text, &bytes, &size, &err), &err);
    assert_string_equal((char *)bytes, text);
    free(bytes);
}

static int count_entries(void) {
    DIR *d = opendir(scratch);
    int n = 0;
    while (d && readdir(d)) n++;
    if (d) closedir(d);
    return n;
}

static void write_new(const char *name) {
    SltError err = {0};
    must(file_write_atomic(scratch_path(name), "new", 3, &err), &err);
}

static void appear_together(void **state) {
    (void)state;
    SltError err = {0};
    FileGroup g;
    scratch_put("one", "old one");
    scratch_put("two", "old two");
    int before = count_entries();
    file_group_begin(&g);
    write_new("one"), write_new("three"), write_new("two");
    holds("one", "old one");
    must(file_group_end(&g, SLT_OK, &err), &err);
    holds("one", "new"), holds("two", "new"), holds("three", "new");
    assert_int_equal(count_entries(), before + 1);
    assert_int_equal(remove(scratch_path("three")), 0);
}

/* The place of one of four files, each in turn, is taken when all are ready. */
static void give_way_together(void **state) {
    (void)state;
    static const char *const names[] = {"a", "b", "c", "d"};
    for (int bad = 0; bad < 4; bad++) {
        SltError err = {0};
        FileGroup g;
        struct stat was, is;
        scratch_put("a", "old a");
        scratch_put("c", "old c");
        assert_int_equal(chmod(scratch_path("a"), 0600), 0);
        assert_int_equal(stat(scratch_path("a"), &was), 0);
        int before = count_entries();
        file_group_begin(&g);
        for (int k = 0; k < 4; k++) write_new(names[k]);
        remove(scratch_path(names[bad])); /* what is in its place from here on is no file */
        assert_int_equal(mkdir(scratch_path(names[bad]), 0700), 0);
        assert_int_equal(file_group_end(&g, SLT_OK, &err), SLT_OUTPUT);
        assert_non_null(strstr(err.text, names[bad]));
        assert_int_equal(rmdir(scratch_path(names[bad])), 0);
        if (bad != 0) {
            holds("a", "old a");
            assert_int_equal(stat(scratch_path("a"), &is), 0);
            assert_true(is.st_ino == was.st_ino && is.st_mode == was.st_mode);
        }
        if (bad != 2) holds("c", "old c");
        assert_int_not_equal(access(scratch_path("b"), F_OK), 0);
        assert_int_not_equal(access(scratch_path("d"), F_OK), 0);
        assert_int_equal(count_entries(), before - (bad == 0 || bad == 2));
    }
}

/* One file whose bytes cannot be written: none takes its place. */
static void none_is_written(void **state) {
    (void)state;
    SltError err = {0};
    FileGroup g;
    scratch_put("one", "old one");
    int before = count_entries();
    file_group_begin(&g);
    write_new("one");
    SltStatus s = file_write_atomic(scratch_path("nowhere/two"), "new", 3, &err);
    assert_int_equal(file_group_end(&g, s, &err), SLT_OUTPUT);
    holds("one", "old one");
    assert_int_equal(count_entries(), before);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(appear_together),
        cmocka_unit_test(give_way_together),
        cmocka_unit_test(none_is_written),
    };
    return cmocka_run_group_tests(tests, scratch_make, scratch_drop);
}
