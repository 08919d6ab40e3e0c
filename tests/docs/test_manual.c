/* The manual pages of docs/man are made of what says the same elsewhere: verbs and options of the command from its
 * tables, what a verb does and the exit statuses from docs/command.md, the library from the comments of its headers,
 * version and date from the release. BLESS=1 writes them. Of saltus.1 the sections that are not made here are written
 * by hand.
 *
 * What is understood of Markdown: paragraphs, lists, headings, code, **bold**, *italic*, links (their text), tables. */
#include <ctype.h>
#include <dirent.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "cli/cli.h"
#include "tests/blessed.h"

#define ROOT SALTUS_TEST_DIR "/.."

static const struct {
    const char *name, *usage, *what, *example;
} verbs[] = {
#define VERB(id, name, usage, what, example, ...) {#name, usage, what, example},
#include "cli/verbs.def"
#undef VERB
};
static const struct {
    const char *name, *arg;
    unsigned verbs;
    const char *help;
} options[] = {
#define OPTION(name, arg, verbs, help, ...) {name, arg, verbs, help},
#include "cli/options.def"
#undef OPTION
};
enum { NOPTIONS = sizeof options / sizeof *options };

/* Headers with functions: what is behind saltus/, the page, its subject. */
static const struct {
    const char *header, *page, *what;
} headers[] = {{"saltus.h", "saltus", "shaders that jump, compiled, and the derivatives of their integrals"},
               {"fit.h", "slt_fit", "parameters of a shader that make images match, or minimise an integral or a loss"},
               {"image.h", "slt_image", "pictures in files: read, written, encoded"}};
static const char link_line[] = "cc program.c $(pkg-config --cflags --libs saltus)";
enum { NHEADERS = sizeof headers / sizeof *headers };

static char *read_text(const char *path) {
    FILE *f = fopen(path, "rb");
    if (!f) return NULL;
    char *text = NULL;
    size_t size, got;
    FILE *copy = open_memstream(&text, &size);
    assert_non_null(copy);
    for (char part[4096]; (got = fread(part, 1, sizeof part, f));) fwrite(part, 1, got, copy);
    fclose(copy);
    fclose(f);
    return text;
}

/* ---- troff. Hyphens, quotes, carets and tildes are those that are typed. */
static void put_char(FILE *out, char c, bool code) {
    switch (c) {
    case '\\': fputs("\\e", out); break;
    case '-': fputs("\\-", out); break;
    case '^': fputs("\\(ha", out); break;
    case '~': fputs("\\(ti", out); break;
    case '`': fputs("\\(ga", out); break;
    case '\'': fputs(code ? "\\(aq" : "'", out); break;
    default: fputc(c, out);
    }
}

static void put_plain(FILE *out, const char *from, const char *to, bool code) {
    while (from < to) put_char(out, *from++, code);
}

/* A line or more of Markdown, in one line of troff. Comments of C are not `rich`: of all marks they have code alone. */
static void put_inline(FILE *out, const char *from, const char *to, bool rich) {
    for (const char *s = from; s < to;) {
        size_t ticks = strspn(s, "`"), stars = strspn(s, "*");
        const char *end = NULL;
        if (ticks) {
            char fence[8] = "";
            memcpy(fence, s, ticks < sizeof fence ? ticks : sizeof fence - 1);
            if ((end = strstr(s + ticks, fence)) && end < to) {
                const char *first = s + ticks, *last = end;
                if (ticks > 1 && *first == ' ') first++, last--; /* `` `a` `` */
                fputs("\\fB", out);
                put_plain(out, first, last, true);
                fputs("\\fR", out);
                s = end + ticks;
                continue;
            }
        } else if (rich && (stars == 1 || stars == 2) && !isspace((unsigned char)s[stars])) {
            for (end = s + stars;
                 end < to && !(*end == '*' && strspn(end, "*") >= stars && !isspace((unsigned char)end[-1])); end++)
                continue;
            if (end < to) {
                fputs(stars == 2 ? "\\fB" : "\\fI", out);
                put_plain(out, s + stars, end, false);
                fputs("\\fR", out);
                s = end + stars;
                continue;
            }
        } else if (rich && (*s == '[' || (*s == '!' && s[1] == '['))) {
            const char *middle = strstr(s, "](");
            if (middle && middle < to && (end = strchr(middle, ')')) && end < to) {
                if (*s == '[') put_inline(out, s + 1, middle, true);
                s = end + 1;
                continue;
            }
        } else if (rich && *s == '\\' && s + 1 < to && ispunct((unsigned char)s[1])) {
            put_char(out, s[1], false);
            s += 2;
            continue;
        }
        size_t n = ticks ? ticks : stars ? stars : 1;
        put_plain(out, s, s + n, false);
        s += n;
    }
}

/* A paragraph, in lines of about a hundred bytes. */
static void put_filled(FILE *out, const char *from, const char *to, bool rich) {
    char *line = NULL;
    size_t size, column = 0;
    FILE *whole = open_memstream(&line, &size);
    assert_non_null(whole);
    put_inline(whole, from, to, rich);
    fclose(whole);
    for (char *word = strtok(line, " \n"); word; word = strtok(NULL, " \n")) {
        size_t n = strlen(word);
        bool fresh = !column || column + n > 100;
        if (column) fputc(fresh ? '\n' : ' ', out);
        column = fresh ? 0 : column;
        if (fresh && strchr(".'", *word)) fputs("\\&", out); /* no request of troff's */
        fputs(word, out);
        column += n + 1;
    }
    fputc('\n', out);
    free(line);
}

/* One line of a block of code. */
static void put_code(FILE *out, const char *from, const char *to) {
    if (from < to && strchr(".'", *from)) fputs("\\&", out);
    put_plain(out, from, to, true);
    fputc('\n', out);
}

static void begin_code(FILE *out, bool first) { fputs(first ? ".RS 4\n.nf\n" : ".PP\n.RS 4\n.nf\n", out); }
static void end_code(FILE *out) { fputs(".fi\n.RE\n", out); }

static const char *line_end(const char *s, const char *to) {
    const char *end = memchr(s, '\n', (size_t)(to - s));
    return end ? end : to;
}

/* A row of a table as an item: the first cell, then the others. */
static void put_row(FILE *out, const char *s, const char *end) {
    const char *cells[16];
    int n = 0;
    for (const char *c = s; c < end && n < 16; c++)
        if (*c == '|' && c[-(c > s)] != '\\') cells[n++] = c;
    if (n < 3 || strspn(s, "|-: ") == (size_t)(end - s)) return; /* the rule below a head, or an empty head */
    fputs(".TP\n", out);
    for (int i = 0; i + 1 < n; i++) {
        const char *a = cells[i] + 1, *b = cells[i + 1];
        while (a < b && *a == ' ') a++;
        while (a < b && b[-1] == ' ') b--;
        if (a < b) put_filled(out, a, b, true);
    }
}

/* Does a block of Markdown that is no paragraph begin here? */
static bool begins(const char *s) {
    return *s == '\n' || *s == '|' || *s == '#' || !strncmp(s, "- ", 2) || !strncmp(s, "```", 3) ||
           !strncmp(s, "    ", 4);
}

/* `first`: what stands before begins the paragraph. */
static void put_blocks(FILE *out, const char *s, const char *to, bool first, bool rich) {
    while (s < to) {
        const char *end = line_end(s, to);
        if (*s == '\n') {
        } else if (!strncmp(s, "```", 3)) {
            begin_code(out, first);
            for (s = end + 1; s < to && strncmp(s, "```", 3); s = end + 1) put_code(out, s, end = line_end(s, to));
            end_code(out);
            end = line_end(s, to);
        } else if (!strncmp(s, "    ", 4)) {
            begin_code(out, first);
            for (;;) { /* with empty lines in it */
                const char *begin = s + 4 < end ? s + 4 : end, *next = end + 1;
                put_code(out, begin, end);
                while (next < to && *next == '\n') next++;
                if (next >= to || strncmp(next, "    ", 4)) break;
                for (s = end + 1; s < next; s++) put_code(out, s, s);
                end = line_end(s, to);
            }
            end_code(out);
        } else if (*s == '#') {
            fputs(".SS ", out);
            put_inline(out, s + strspn(s, "# "), end, rich);
            fputc('\n', out);
            first = true;
        } else if (*s == '|') {
            put_row(out, s, end);
        } else {
            bool item = !strncmp(s, "- ", 2);
            while (end + 1 < to && !begins(end + 1)) end = line_end(end + 1, to);
            if (item) fputs(".IP \\(bu 2\n", out);
            else if (!first) fputs(".PP\n", out);
            put_filled(out, s + 2 * item, end, rich);
        }
        if (*s != '#' && *s != '\n') first = false;
        s = end + 1;
    }
}

/* The text below `heading` of docs/command.md, up to the next of its rank. */
static void put_section(FILE *out, const char *page, const char *heading, bool first) {
    const char *from = strstr(page, heading);
    if (!from) {
        print_error("docs/command.md has no%s", heading);
        fail();
    }
    from += strlen(heading);
    const char *to = strstr(from, "\n## ");
    put_blocks(out, from, to ? to + 1 : from + strlen(from), first, true);
}

/* ---- the command */
static void put_title(FILE *out, const char *name, int section, const char *manual) {
    /* The date is that of the release: the last line of its entry. */
    char *log = read_text(ROOT "/debian/changelog"), day[3] = "", month[4] = "", year[5] = "";
    const char *trailer = log ? strstr(log, "\n -- ") : NULL;
    assert_non_null(trailer);
    assert_int_equal(sscanf(strstr(trailer, ">  "), ">  %*3s, %2[0-9] %3[A-Za-z] %4[0-9]", day, month, year), 3);
    static const char months[] = "JanFebMarAprMayJunJulAugSepOctNovDec";
    const char *found = strstr(months, month);
    assert_non_null(found);
    fprintf(out, ".TH ");
    for (; *name; name++) put_char(out, (char)toupper((unsigned char)*name), true);
    fprintf(out, " %d %s-%02d-%s \"saltus %s\" \"%s\"\n.nh\n", section, year, (int)(found - months) / 3 + 1, day,
            SALTUS_VERSION, manual);
    free(log);
}

static void put_text(FILE *out, const char *text) { put_filled(out, text, text + strlen(text), true); }

static void put_option(FILE *out, int i, bool with_verbs) {
    fputs(".TP\n\\fB", out);
    put_plain(out, options[i].name, options[i].name + strlen(options[i].name), true);
    fputs("\\fR", out);
    if (options[i].arg) {
        fputs(options[i].arg[1] != '=' ? " \\fI" : "\\fI", out);
        put_plain(out, options[i].arg, options[i].arg + strlen(options[i].arg), true);
        fputs("\\fR", out);
    }
    fputc('\n', out);
    put_text(out, options[i].help);
    if (!with_verbs || (options[i].verbs & ALL) == ALL) return;
    fputc('(', out);
    for (int v = 0, n = 0; v < VERB_COUNT; v++)
        if (options[i].verbs & 1u << v) fprintf(out, "%s%s", n++ ? ", " : "", verbs[v].name);
    fputs(")\n", out);
}

static void put_usage(FILE *out, int v) {
    size_t name = strlen(verbs[v].name);
    fprintf(out, "\\fBsaltus %s\\fR", verbs[v].name);
    put_plain(out, verbs[v].usage + name, verbs[v].usage + strlen(verbs[v].usage), true);
}

/* The verb's own options, those of every verb, those for work on the compiler. */
static void put_options(FILE *out, int v) {
    static const char *const titles[] = {"", ".SS Options of every command\n", ".SS For work on the compiler\n"};
    for (int kind = 0; kind < 3; kind++)
        for (int i = 0, n = 0; i < NOPTIONS; i++) {
            bool own = (options[i].verbs & ALL) != ALL, inner = options[i].verbs & INNER;
            if (!(options[i].verbs & 1u << v) || kind != (inner ? 2 : own ? 0 : 1)) continue;
            if (!n++) fputs(titles[kind], out);
            put_option(out, i, false);
        }
}

static void put_verb(FILE *out, int v, const char *page) {
    char name[64], heading[64], what[256];
    snprintf(name, sizeof name, "saltus-%s", verbs[v].name);
    put_title(out, name, 1, "User Commands");
    fprintf(out, ".SH NAME\nsaltus\\-%s \\- ", verbs[v].name);
    put_plain(out, verbs[v].what, verbs[v].what + strlen(verbs[v].what), true);
    fputs("\n.SH SYNOPSIS\n", out);
    put_usage(out, v);
    fputs(" [\\fIOPTION\\fR ...]\n.SH DESCRIPTION\n", out);
    snprintf(what, sizeof what, "%c%s.", toupper((unsigned char)*verbs[v].what), verbs[v].what + 1);
    put_text(out, what);
    snprintf(heading, sizeof heading, "\n## %s\n", verbs[v].name);
    put_section(out, page, heading, false);
    fputs(".SH OPTIONS\n", out);
    put_options(out, v);
    fputs(".SH EXIT STATUS\n", out);
    put_section(out, page, "\n## Exit status\n", true);
    fputs(".SH EXAMPLES\n", out);
    begin_code(out, true);
    put_code(out, verbs[v].example, verbs[v].example + strlen(verbs[v].example));
    end_code(out);
    fputs(".SH SEE ALSO\n.BR saltus (1)", out);
    for (int other = 0; other < VERB_COUNT; other++)
        if (other != v) fprintf(out, ",\n.BR saltus\\-%s (1)", verbs[other].name);
    fputc('\n', out);
}

/* saltus.1: its sections COMMANDS, OPTIONS, EXIT STATUS and SEE ALSO, and its title. */
static void put_command(FILE *out, const char *page, const char *old) {
    const char *name = strstr(old, ".SH NAME\n"), *commands = strstr(old, ".SH COMMANDS\n");
    const char *environment = strstr(old, ".SH ENVIRONMENT\n"), *also = strstr(old, ".SH SEE ALSO\n");
    assert_true(name && commands && environment && also && name < commands && commands < environment &&
                environment < also);
    put_title(out, "saltus", 1, "User Commands");
    fprintf(out, "%.*s.SH COMMANDS\n", (int)(commands - name), name);
    for (int v = 0; v < VERB_COUNT; v++) {
        fputs(".TP\n", out);
        put_usage(out, v);
        fputc('\n', out);
        put_text(out, verbs[v].what);
        fprintf(out, "(see\n.BR saltus\\-%s (1))\n", verbs[v].name);
    }
    fputs(".SH OPTIONS\n", out);
    for (int i = 0; i < NOPTIONS; i++) put_option(out, i, true);
    fputs(".SH EXIT STATUS\n", out);
    put_section(out, page, "\n## Exit status\n", true);
    fprintf(out, "%.*s.SH SEE ALSO\n", (int)(also - environment), environment);
    for (int v = 0; v < VERB_COUNT; v++) fprintf(out, ".BR saltus\\-%s (1),\n", verbs[v].name);
    fputs(".BR saltus (3)\n", out);
}

/* ---- the library */
/* The text of a comment without its frame; *after is behind it. */
static char *comment_text(const char *s, const char **after) {
    const char *end = strstr(s, "*/");
    char *text = NULL;
    size_t size;
    FILE *out = open_memstream(&text, &size);
    assert_true(end && out);
    *after = end + 2;
    while (end > s && end[-1] == ' ') end--;
    for (s += 2 + (s[2] == ' '); s < end;) {
        const char *stop = line_end(s, end);
        fprintf(out, "%.*s\n", (int)(stop - s), s);
        if (stop == end) break;
        s = stop + 1;
        s += strspn(s, " ");
        if (*s == '*') s += 1 + (s[1] == ' ');
    }
    fclose(out);
    return text;
}

/* The end of a declaration that begins at s: behind its semicolon outside of braces. */
static const char *declaration_end(const char *s) {
    for (int depth = 0; *s; s++) {
        if (!strncmp(s, "/*", 2)) s = strstr(s, "*/") + 1;
        depth += (*s == '{') - (*s == '}');
        if (*s == ';' && !depth) return s + 1;
    }
    return s;
}

/* The name of the function that is declared; NULL where something else is. Its length goes to *n. */
static const char *function_name(const char *s, const char *end, size_t *n) {
    const char *open = memchr(s, '(', (size_t)(end - s)), *name = open;
    while (name && name > s && (isalnum((unsigned char)name[-1]) || name[-1] == '_')) name--;
    *n = (size_t)(open - name);
    return open && !strncmp(name, "slt_", 4) ? name : NULL;
}

/* A word of English, not of C, gets a capital. */
static void capitalise(char *text) {
    size_t n = strcspn(text, " \n");
    if (n == strspn(text, "abcdefghijklmnopqrstuvwxyz")) *text = (char)toupper((unsigned char)*text);
}

/* A comment that begins a section of the header: its title ends at a stop or a colon. Whether there is more of it. */
static bool put_heading(FILE *out, char *text) {
    size_t n = strcspn(text, ".:;");
    if (!text[n]) n = strcspn(text, "\n");
    capitalise(text);
    fputs(".SS ", out);
    put_plain(out, text, text + n, false);
    fputc('\n', out);
    text += n;
    text += strspn(text, ".:; \n");
    capitalise(text);
    put_blocks(out, text, text + strlen(text), true, false);
    return *text != 0;
}

/* The functions of a header, in its order, each below the comment that stands there; into `names` how they are called.
 * Types are left to the header. */
static int put_functions(FILE *out, FILE *names, const char *page, const char *s) {
    char *comment = NULL; /* of what follows */
    bool in_code = false, fresh = true;
    int count = 0;
    while (*s) {
        const char *end = *s == '#' || !strncmp(s, "extern \"C\"", 10) ? strchr(s, '\n') : declaration_end(s);
        if (isspace((unsigned char)*s) || *s == '}') {
            s++;
            continue;
        }
        if (!strncmp(s, "/*", 2)) {
            free(comment);
            comment = comment_text(s, &end);
            if (in_code) end_code(out);
            in_code = false;
            if (!strncmp(comment, "---- ", 5)) {
                fresh = !put_heading(out, comment + 5);
                free(comment);
                comment = NULL;
            }
        } else if (*s != '#' && *s != 'e') {
            size_t n;
            const char *name = function_name(s, end, &n);
            bool wanted = name != NULL;
            if (wanted && (n != strlen(page) || strncmp(name, page, n))) fprintf(names, ", %.*s", (int)n, name);
            if (wanted && comment) put_blocks(out, comment, comment + strlen(comment), fresh, false);
            if (wanted && !in_code) begin_code(out, fresh && !comment);
            if (wanted) fresh = false, in_code = true, count++;
            free(comment);
            comment = NULL;
            if (wanted && !strncmp(end + strspn(end, " "), "/*", 2))
                end = strstr(end, "*/") + 2; /* a remark behind it */
            for (const char *line = s; wanted && line < end;) {
                const char *stop = line_end(line, end);
                put_code(out, line, stop);
                line = stop + 1;
            }
        }
        s = end;
    }
    if (in_code) end_code(out);
    free(comment);
    return count;
}

static void put_header(FILE *out, int h) {
    char path[512];
    snprintf(path, sizeof path, "%s/include/saltus/%s", ROOT, headers[h].header);
    char *text = read_text(path);
    assert_non_null(text);
    const char *behind;
    char *about = comment_text(text, &behind);
    char *functions = NULL, *names = NULL;
    size_t size;
    FILE *part = open_memstream(&functions, &size), *list = open_memstream(&names, &size);
    assert_true(part && list);
    fprintf(list, "%s", headers[h].page);
    int count = put_functions(part, list, headers[h].page, behind);
    fclose(part);
    fclose(list);
    assert_true(count > 0);
    put_title(out, headers[h].page, 3, "Library Functions");
    fputs(".SH NAME\n", out); /* of all functions: `man slt_render` finds the page by it */
    put_filled(out, names, names + strlen(names), false);
    fprintf(out, "\\- %s\n.SH SYNOPSIS\n.nf\n\\fB#include <saltus/%s>\\fR\n\n", headers[h].what, headers[h].header);
    put_code(out, link_line, link_line + strlen(link_line));
    fputs(".fi\n.SH DESCRIPTION\n", out);
    put_blocks(out, about, about + strlen(about), true, false);
    fprintf(out, ".SH FUNCTIONS\n%s.SH SEE ALSO\n.BR saltus (1)", functions);
    for (int other = 0; other < NHEADERS; other++)
        if (other != h) fprintf(out, ",\n.BR %s (3)", headers[other].page);
    fputs("\n.PP\nThe structs and enums are in the header, with a comment on each member.\n", out);
    free(functions);
    free(names);
    free(about);
    free(text);
}

/* ---- the pages: that of the command, of every verb, of headers */
enum { PAGES = 1 + VERB_COUNT + NHEADERS };

static void page_name(char name[32], int page) {
    if (!page) strcpy(name, "saltus.1");
    else if (page <= VERB_COUNT) snprintf(name, 32, "saltus-%s.1", verbs[page - 1].name);
    else snprintf(name, 32, "%s.3", headers[page - 1 - VERB_COUNT].page);
}

/* Whether it is the text that is there, or becomes it. */
static bool settle(const char *path, const char *old, const char *made) {
    if (getenv("BLESS") && (!old || strcmp(old, made))) {
        FILE *f = fopen(path, "w");
        assert_non_null(f);
        fputs(made, f);
        fclose(f);
        return true;
    }
    if (old) return blessed_same(path, old, made);
    print_error("%s is missing: BLESS=1 writes it\n", path);
    return false;
}

static void pages_are_those_of_their_sources(void **state) {
    (void)state;
    char *guide = read_text(ROOT "/docs/command.md");
    assert_non_null(guide);
    int failures = 0;
    for (int page = 0; page < PAGES; page++) {
        char name[32], path[512], *made = NULL;
        size_t size;
        page_name(name, page);
        snprintf(path, sizeof path, "%s/docs/man/%s", ROOT, name);
        char *old = read_text(path);
        assert_true(old || page);
        FILE *out = open_memstream(&made, &size);
        assert_non_null(out);
        if (!page) put_command(out, guide, old);
        else if (page <= VERB_COUNT) put_verb(out, page - 1, guide);
        else put_header(out, page - 1 - VERB_COUNT);
        fclose(out);
        failures += !settle(path, old, made);
        free(made);
        free(old);
    }
    free(guide);
    assert_int_equal(failures, 0);
}

static void there_are_no_others(void **state) {
    (void)state;
    int unknown = 0;
    DIR *d = opendir(ROOT "/docs/man");
    assert_non_null(d);
    for (struct dirent *e; (e = readdir(d));) {
        bool known = *e->d_name == '.';
        for (int page = 0; page < PAGES; page++) {
            char name[32];
            page_name(name, page);
            known |= !strcmp(name, e->d_name);
        }
        if (!known) print_error("docs/man/%s is of no verb and no header: remove it\n", e->d_name);
        unknown += !known;
    }
    closedir(d);
    assert_int_equal(unknown, 0);
}

static void headers_with_functions_have_pages(void **state) {
    (void)state;
    int missing = 0, found = 0;
    DIR *d = opendir(ROOT "/include/saltus");
    FILE *nowhere = fopen("/dev/null", "w");
    assert_true(d && nowhere);
    for (struct dirent *e; (e = readdir(d));) {
        char path[1024];
        size_t n = strlen(e->d_name);
        bool known = false;
        if (n < 2 || strcmp(e->d_name + n - 2, ".h")) continue;
        snprintf(path, sizeof path, "%s/include/saltus/%s", ROOT, e->d_name);
        char *text = read_text(path);
        assert_non_null(text);
        for (int h = 0; h < NHEADERS; h++) known |= !strcmp(headers[h].header, e->d_name);
        bool functions = put_functions(nowhere, nowhere, "", text) > 0;
        if (functions && !known) print_error("saltus/%s declares functions and has no row in this test\n", e->d_name);
        missing += functions && !known;
        found += functions;
        free(text);
    }
    closedir(d);
    fclose(nowhere);
    assert_int_equal(missing, 0);
    assert_int_equal(found, NHEADERS);
}

/* Formatters have nothing to say about them. */
static void formatters_are_content(void **state) {
    (void)state;
    static const char *const checks[][2] = {
        {"man",
         "for p in '" ROOT
         "'/docs/man/*; do LC_ALL=C.UTF-8 MANWIDTH=80 man --warnings -E UTF-8 -l -Tutf8 -Z \"$p\" 2>&1 >/dev/null; done"},
        {"mandoc", "mandoc -Tlint -W warning '" ROOT "'/docs/man/* 2>&1"}};
    for (int i = 0; i < 2; i++) {
        char command[512], line[512];
        snprintf(command, sizeof command, "command -v %s >/dev/null", checks[i][0]);
        if (system(command) != 0) {
            print_message("%s is not installed\n", checks[i][0]);
            continue;
        }
        FILE *said = popen(checks[i][1], "r");
        assert_non_null(said);
        int lines = 0;
        while (fgets(line, sizeof line, said)) lines++, print_error("%s", line);
        pclose(said);
        assert_int_equal(lines, 0);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pages_are_those_of_their_sources), cmocka_unit_test(there_are_no_others),
        cmocka_unit_test(headers_with_functions_have_pages), cmocka_unit_test(formatters_are_content)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
