/* Imports: the order of the search, once, cycles, what is missing. */
#include <sys/stat.h>

#include "tests/scratch.h"

#include "tests/front/parse_fixture.h"

/* The three folders of the search: the importing file's, an included one, the standard library. */
static int make_folders(void **state) {
    return scratch_make(state) || mkdir(scratch_path("inc"), 0777) || mkdir(scratch_path("std"), 0777);
}

typedef struct Loaded {
    Session *s;
    Module *main;
    char *text;
    char list[512]; /* module names in order of loading, with `*` behind those of the standard library */
} Loaded;

typedef struct LoadJob {
    const char *path;
    Module *main;
} LoadJob;

static void load_body(Session *s, void *arg) {
    LoadJob *job = arg;
    int file = session_add_file(s, job->path, NULL);
    assert_true(file >= 0);
    job->main = load_modules(s, file);
}

/* Loads FOLDER/main.salt with -I FOLDER/inc and the standard library in FOLDER/std. */
static Loaded load(void) {
    const char *dirs[] = {scratch_path("inc")};
    Loaded l = {.s = session_create(0)};
    l.s->import_dirs = dirs;
    l.s->nimport_dirs = 1;
    l.s->stdlib_dir = scratch_path("std");
    LoadJob job = {.path = scratch_path("main.salt")};
    assert_int_equal(session_protect(l.s, load_body, &job), 0);
    l.main = job.main;
    for (const Module *m = l.main; m; m = m->next) {
        size_t n = strlen(l.list);
        snprintf(l.list + n, sizeof l.list - n, "%s%s%s", n ? " " : "", m->name, m->is_stdlib ? "*" : "");
    }
    l.text = printed(l.s, print_text);
    l.s->import_dirs = NULL;
    l.s->nimport_dirs = 0;
    return l;
}

static void unload(Loaded *l) {
    session_destroy(l->s);
    free(l->text);
}

static void search_order(void **state) {
    (void)state;
    scratch_put("main.salt", "import a; import b; import c; import a;");
    scratch_put("a.salt", "const int where = 1;");
    scratch_put("inc/a.salt", "const int where = 2;");
    scratch_put("inc/b.salt", "const int where = 2; import c;");
    scratch_put("std/a.salt", "const int where = 3;");
    scratch_put("std/b.salt", "const int where = 3;");
    scratch_put("std/c.salt", "const int where = 3; import a; import d;");
    scratch_put("std/d.salt", "");
    Loaded l = load();
    assert_string_equal(l.text, "");
    /* c's own `a` is the one beside it. */
    assert_string_equal(l.list, "main a b c* a* d*");
    assert_true(l.main->is_main);
    assert_int_equal(l.main->nimports, 3);
    const Module *c = l.main->imports[2].module;
    assert_string_equal(c->name, "c");
    assert_int_equal(c->imports[0].module->consts->init->cval.v[0].i, 3);
    assert_int_equal(l.main->imports[0].module->consts->init->cval.v[0].i, 1);
    assert_ptr_equal(l.main->imports[1].module->imports[0].module, c);
    unload(&l);
}

static void once(void **state) {
    (void)state;
    scratch_put("main.salt", "import a; import b;");
    scratch_put("a.salt", "import b; import c;");
    scratch_put("b.salt", "import c;");
    scratch_put("c.salt", "const int n = ;");
    Loaded l = load();
    assert_string_equal(l.list, "main a b c");
    assert_int_equal(l.s->nerrors, 1);
    assert_non_null(strstr(l.text, "/c.salt:1:15: error: expected an expression before `;`"));
    unload(&l);
}

static void cycles(void **state) {
    (void)state;
    scratch_put("main.salt", "import a;");
    scratch_put("a.salt", "\nimport b;");
    scratch_put("b.salt", "import c;");
    scratch_put("c.salt", "import d;\n  import a;");
    scratch_put("d.salt", "");
    Loaded l = load();
    assert_int_equal(l.s->nerrors, 1);
    assert_non_null(strstr(l.text, "/c.salt:2:10: error: import cycle: a -> b -> c -> a [E0021]"));
    assert_non_null(strstr(l.text, "/a.salt:2:8: note: `a` imports `b` here"));
    assert_non_null(strstr(l.text, "/b.salt:1:8: note: `b` imports `c` here"));
    unload(&l);
    scratch_put("main.salt", "import main;");
    l = load();
    assert_non_null(strstr(l.text, "/main.salt:1:8: error: import cycle: main -> main [E0021]"));
    assert_true(l.main->imports[0].module->missing);
    unload(&l);
    /* A file of the name of a module of the library finds the library's. */
    scratch_put("std/main.salt", "const int where = 3;");
    l = load();
    assert_string_equal(l.text, "");
    assert_string_equal(l.list, "main main*");
    unload(&l);
}

static void missing(void **state) {
    (void)state;
    scratch_put("main.salt", "import nois;\nimport a;\nimport zzzzzz;");
    scratch_put("a.salt", "import gone;");
    scratch_put("inc/x.salt", "");
    scratch_put("std/noise.salt", "");
    Loaded l = load();
    assert_int_equal(l.s->nerrors, 3);
    assert_non_null(strstr(l.text, "/main.salt:1:8: error: no module `nois`; did you mean `noise`? [E0020]"));
    assert_non_null(strstr(l.text, "/main.salt:3:8: error: no module `zzzzzz` [E0020]"));
    assert_non_null(strstr(l.text, "/a.salt:1:8: error: no module `gone` [E0020]"));
    char note[512];
    snprintf(note, sizeof note, "note: searched in `%s/inc`", scratch);
    assert_non_null(strstr(l.text, note));
    snprintf(note, sizeof note, "note: searched in `%s/std`", scratch);
    assert_non_null(strstr(l.text, note));
    assert_non_null(l.main->imports[0].module);
    assert_true(l.main->imports[0].module->missing);
    unload(&l);
}

static void identity(void **state) {
    (void)state;
    scratch_put("main.salt", "import a; import b;");
    scratch_put("a.salt", "");
    assert_int_equal(symlink(scratch_path("a.salt"), scratch_path("b.salt")), 0);
    Loaded l = load();
    /* Two names for one file are one module, in the list and among the imports. */
    assert_string_equal(l.list, "main a");
    assert_int_equal(l.main->nimports, 1);
    unload(&l);
}

static void deep(void **state) {
    (void)state;
    scratch_put("main.salt", "import m0;");
    for (int i = 0; i < 300; i++) {
        char name[32], text[32];
        snprintf(name, sizeof name, "m%d.salt", i);
        snprintf(text, sizeof text, "import m%d;", i + 1);
        scratch_put(name, text);
    }
    scratch_put("m300.salt", "");
    Loaded l = load();
    assert_int_equal(l.s->nerrors, 1);
    assert_non_null(strstr(l.text, "imports are nested deeper than 256 [E0524]"));
    unload(&l);
}

static void unreadable(void **state) {
    (void)state;
    const char *why = NULL;
    Session *s = session_create(0);
    assert_int_equal(session_add_file(s, "/nonexistent/file.salt", &why), -1);
    assert_string_equal(why, "No such file or directory");
    assert_int_equal(session_add_file(s, "/tmp", &why), -1);
    assert_string_equal(why, "Is a directory");
    session_destroy(s);
}

int main(void) {
#define IN_FOLDER(test) cmocka_unit_test_setup_teardown(test, make_folders, scratch_drop)
    const struct CMUnitTest tests[] = {IN_FOLDER(search_order),     IN_FOLDER(once),     IN_FOLDER(cycles),
                                       IN_FOLDER(missing),          IN_FOLDER(identity), IN_FOLDER(deep),
                                       cmocka_unit_test(unreadable)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
