/* What the documentation shows is true: every ```salt block of README.md and docs/ compiles, every ```c block with a
 * main passes the C compiler, every relative link of every page leads to a
 * file, every verb and option of the command is described.
 *
 * A block that is meant to fail or to warn says so in a comment: `// E0401` or `// W0401` somewhere in it demands
 * exactly this diagnostic; any other block must compile without one. A ```salt block without a shader is a module or an
 * excerpt: it gets an empty shader. */
#include <dirent.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "cli/cli.h"

#define ROOT SALTUS_TEST_DIR "/.."

typedef struct Visit {
    void (*block)(const char *page, int line, const char *language, const char *text, struct Visit *v);
    void (*link)(const char *page, int line, const char *target, struct Visit *v);
    int blocks, links, failures;
} Visit;

static char *read_text(const char *path) {
    FILE *f = fopen(path, "rb");
    assert_non_null(f);
    char *text = NULL;
    size_t n = 0, size = 0;
    do {
        if (n + 4096 > size) assert_non_null(text = realloc(text, size = 2 * size + 8192));
        size_t got = fread(text + n, 1, size - n - 1, f);
        n += got;
        if (!got) break;
    } while (true);
    text[n] = 0;
    fclose(f);
    return text;
}

/* Links of one line outside of code blocks: ](target) and src="target". */
static void links_of(const char *page, int line, const char *from, const char *to, Visit *v) {
    char target[512];
    for (const char *s = from; s < to; s++) {
        char close = !strncmp(s, "](", 2) ? ')' : !strncmp(s, "src=\"", 5) ? '"' : 0;
        if (*s == '`') /* inline code */
            for (s++; s < to && *s != '`'; s++) continue;
        if (!close) continue;
        s += close == ')' ? 2 : 5;
        size_t n = 0;
        while (s < to && *s != close && n + 1 < sizeof target) target[n++] = *s++;
        target[n] = 0;
        v->links++;
        v->link(page, line, target, v);
    }
}

static void visit_page(const char *page, Visit *v) {
    char *text = read_text(page), language[32] = "";
    int line = 1, start = 0;
    char *block = NULL;
    for (char *s = text; *s; line++) {
        char *end = strchr(s, '\n');
        if (!end) end = s + strlen(s);
        if (!strncmp(s, "```", 3) && !block) {
            size_t n = (size_t)(end - s) - 3;
            snprintf(language, sizeof language, "%.*s", (int)(n < 31 ? n : 31), s + 3);
            block = *end ? end + 1 : end;
            start = line + 1;
        } else if (!strncmp(s, "```", 3)) {
            char keep = *s;
            *s = 0;
            v->block(page, start, language, block, v);
            *s = keep;
            block = NULL;
        } else if (!block && v->link) {
            links_of(page, line, s, end, v);
        }
        s = *end ? end + 1 : end;
    }
    if (block) {
        print_error("%s:%d: this block is not closed\n", page, start - 1);
        v->failures++;
    }
    free(text);
}

static void visit_all(Visit *v) {
    char path[1024];
    visit_page(ROOT "/README.md", v);
    DIR *d = opendir(ROOT "/docs");
    assert_non_null(d);
    for (struct dirent *e; (e = readdir(d));) {
        size_t n = strlen(e->d_name);
        if (n < 4 || strcmp(e->d_name + n - 3, ".md")) continue;
        snprintf(path, sizeof path, "%s/docs/%s", ROOT, e->d_name);
        visit_page(path, v);
    }
    closedir(d);
}

/* ---- shaders */
static void compile_block(const char *page, int line, const char *language, const char *text, Visit *v) {
    if (strcmp(language, "salt")) return;
    v->blocks++;
    char code[8] = "", *source = malloc(strlen(text) + 128);
    assert_non_null(source);
    sprintf(source, "%s%s", text, strstr(text, "shader ") ? "" : "shader float unused(float x) { return x; }\n");
    for (const char *s = text; (s = strstr(s, "// ")) && !*code; s += 3)
        if ((s[3] == 'E' || s[3] == 'W') && strspn(s + 4, "0123456789") == 4)
            snprintf(code, sizeof code, "%.5s", s + 3);
    SltOptions opt = SLT_OPTIONS_INIT;
    opt.stdlib_dir = SALTUS_STDLIB_BUILD;
    SltProgram *p = NULL;
    SltStatus s = slt_compile_string(source, "block.salt", &opt, &p);
    bool seen = false, other = false;
    for (uint32_t i = 0; i < slt_diagnostic_count(p); i++) {
        SltDiagnostic d = SLT_DIAGNOSTIC_INIT;
        assert_true(slt_diagnostic(p, i, &d));
        if (d.severity > 2) continue;
        if (*code && !strcmp(d.code, code)) seen = true;
        else other = true;
    }
    bool want_error = *code == 'E';
    if (other || seen != (*code != 0) || (s == SLT_OK) == want_error) {
        print_error("%s:%d: block does not give what it promises (%s)\n%s\n", page, line,
                    *code ? code : "no diagnostic", slt_diagnostics_text(p));
        v->failures++;
    }
    slt_program_free(p);
    free(source);
}

static void shaders_compile(void **state) {
    (void)state;
    Visit v = {.block = compile_block};
    visit_all(&v);
    print_message("%d shader blocks\n", v.blocks);
    assert_true(v.blocks >= 15);
    assert_int_equal(v.failures, 0);
}

/* ---- C */
static void check_c_block(const char *page, int line, const char *language, const char *text, Visit *v) {
    if (strcmp(language, "c") || !strstr(text, "int main(")) return;
    v->blocks++;
    FILE *cc = popen("cc -std=c17 -Wall -Wextra -Werror -fsyntax-only -I '" ROOT "/include' -x c -", "w");
    assert_non_null(cc);
    fputs(text, cc);
    if (pclose(cc) != 0) {
        print_error("%s:%d: the C compiler rejects this block\n", page, line);
        v->failures++;
    }
}

static void c_compiles(void **state) {
    (void)state;
    Visit v = {.block = check_c_block};
    visit_all(&v);
    assert_true(v.blocks >= 1);
    assert_int_equal(v.failures, 0);
}

/* ---- links */
static void skip_block(const char *page, int line, const char *language, const char *text, Visit *v) {
    (void)page, (void)line, (void)language, (void)text, (void)v;
}

static void check_link(const char *page, int line, const char *target, Visit *v) {
    if (!strncmp(target, "http", 4) || *target == '#') return;
    char path[2048];
    const char *slash = strrchr(page, '/');
    snprintf(path, sizeof path, "%.*s/%.*s", (int)(slash - page), page, (int)strcspn(target, "#"), target);
    if (access(path, F_OK) == 0) return;
    print_error("%s:%d: %s does not exist\n", page, line, target);
    v->failures++;
}

/* Every page of the tree: those of folders too. */
static void visit_tree(const char *folder, Visit *v) {
    DIR *d = opendir(folder);
    assert_non_null(d);
    for (struct dirent *e; (e = readdir(d));) {
        char path[2048];
        struct stat st;
        size_t n = strlen(e->d_name);
        if (e->d_name[0] == '.' || !strcmp(e->d_name, "build")) continue;
        snprintf(path, sizeof path, "%s/%s", folder, e->d_name);
        if (lstat(path, &st) != 0) continue;
        if (S_ISDIR(st.st_mode)) visit_tree(path, v);
        else if (n > 3 && !strcmp(e->d_name + n - 3, ".md")) visit_page(path, v);
    }
    closedir(d);
}

static void links_lead_somewhere(void **state) {
    (void)state;
    Visit v = {.block = skip_block, .link = check_link};
    visit_tree(ROOT, &v);
    assert_true(v.links >= 100);
    assert_int_equal(v.failures, 0);
}

/* ---- the command: verbs and options, from the tables that it is made of */
static const char *const verbs[] = {
#define VERB(id, name, ...) #name,
#include "cli/verbs.def"
#undef VERB
};
static const char *const options[] = {
#define OPTION(name, ...) name,
#include "cli/options.def"
#undef OPTION
};
enum { NOPTIONS = sizeof options / sizeof *options };

/* Is the word there, and not as the beginning of a longer one? */
static bool mentions(const char *page, const char *word) {
    size_t n = strlen(word);
    for (const char *s = page; (s = strstr(s, word)); s += n)
        if (!strspn(s + n, "abcdefghijklmnopqrstuvwxyz-")) return true;
    return false;
}

static void the_command_is_documented(void **state) {
    (void)state;
    char *page = read_text(ROOT "/docs/command.md"), heading[64];
    int missing = 0;
    for (int v = 0; v < VERB_COUNT; v++) {
        snprintf(heading, sizeof heading, "\n## %s\n", verbs[v]);
        if (strstr(page, heading)) continue;
        print_error("docs/command.md has no section `%s`\n", verbs[v]);
        missing++;
    }
    for (int i = 0; i < NOPTIONS; i++) {
        if (mentions(page, options[i])) continue;
        print_error("docs/command.md does not mention %s\n", options[i]);
        missing++;
    }
    free(page);
    assert_int_equal(missing, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(shaders_compile), cmocka_unit_test(c_compiles),
                                       cmocka_unit_test(links_lead_somewhere),
                                       cmocka_unit_test(the_command_is_documented)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
