/* Modules: from `import name;` to files, each parsed once, with cycles found and named. */
#include "compiler/front/ast.h"

#include <dirent.h>
#include <errno.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { MAX_IMPORT_DEPTH = 256 };
enum { UNLOADED, LOADING, LOADED };

/* The chain of imports that led here, for cycles. */
typedef struct Frame {
    Module *module;
    const struct Frame *outer;
    Span import_span; /* in the outer module */
    int depth;
} Frame;

typedef struct Loader {
    Session *s;
    Module *main, **end;
} Loader;

static const char *identity(Session *s, const char *path) {
    char full[PATH_MAX];
    if (realpath(path, full)) return intern(s, full, strlen(full));
    return intern(s, path, strlen(path));
}

static const char *join(Session *s, const char *dir, const char *name) {
    if (!strcmp(dir, ".")) return arena_printf(&s->session, "%s.salt", name);
    return arena_printf(&s->session, "%s/%s.salt", dir, name);
}

/* Folder i of the search for an import of `file`, or NULL behind the last. */
static const char *search_dir(const Session *s, int file, uint32_t i) {
    if (i == 0) return s->sources[file].dir;
    if (i <= s->nimport_dirs) return s->import_dirs[i - 1];
    return i == s->nimport_dirs + 1 ? s->stdlib_dir : NULL;
}

/* A file does not find itself while there is another: `csg.salt` may import the library's csg. */
static const char *find(Session *s, const Module *from, const char *name, bool of_stdlib, bool *in_stdlib) {
    const char *dir, *self = NULL;
    int file = from->file;
    for (uint32_t i = of_stdlib && s->stdlib_dir ? s->nimport_dirs + 1 : 0; (dir = search_dir(s, file, i)); i++) {
        const char *path = join(s, dir, name);
        struct stat info;
        if (!session_held(s, path) && (stat(path, &info) || S_ISDIR(info.st_mode))) continue;
        if (from->real_path && identity(s, path) == from->real_path) {
            self = path;
            continue;
        }
        *in_stdlib = s->stdlib_dir && (i == s->nimport_dirs + 1 || !strcmp(dir, s->stdlib_dir));
        return path;
    }
    return self;
}

static void report_missing(Session *s, int file, const Import *im) {
    Vec(const char *) names = {0};
    const char *dir;
    for (uint32_t i = 0; (dir = search_dir(s, file, i)); i++) {
        DIR *d = opendir(dir);
        if (!d) continue;
        /* A folder of thousands of files need not be compared in full; and nothing here may unwind past closedir. */
        char found[64][64];
        uint32_t n = 0;
        for (struct dirent *e; n < 64 && (e = readdir(d));) {
            size_t len = strlen(e->d_name);
            if (len <= 5 || len >= sizeof found[0] || strcmp(e->d_name + len - 5, ".salt")) continue;
            memcpy(found[n], e->d_name, len - 5);
            found[n++][len - 5] = 0;
        }
        closedir(d);
        for (uint32_t k = 0; k < n; k++) vec_push(&s->session, &names, intern(s, found[k], strlen(found[k])));
    }
    const char *near = suggest_nearest(im->name, names.data, names.len);
    const char *hint = im->of_stdlib ? ", which the shader needs of the standard library"
                       : near        ? arena_printf(&s->session, "; did you mean `%s`?", near)
                                     : "";
    Diag *diag = diag_emit(s, DIAG_import_missing, im->span, im->name, hint);
    for (uint32_t i = im->of_stdlib && s->stdlib_dir ? s->nimport_dirs + 1 : 0; (dir = search_dir(s, file, i)); i++)
        diag_note(s, diag, SPAN_NONE, i == 0 ? "searched beside the file, in `%s`" : "searched in `%s`", dir);
    if (!s->stdlib_dir || access(join(s, s->stdlib_dir, "gl"), R_OK) != 0)
        diag_note(s, diag, SPAN_NONE, "the standard library is not there: $SALTUS_STDLIB says in which folder it is");
}

static void report_cycle(Session *s, const Frame *frame, const Import *im, const Module *closed) {
    const char *text = closed->name;
    const Frame *f = frame;
    const Frame *chain[MAX_IMPORT_DEPTH + 1];
    int n = 0;
    while (f && n <= MAX_IMPORT_DEPTH) {
        chain[n++] = f;
        if (f->module == closed) break;
        f = f->outer;
    }
    /* chain[n - 1] is the module that the import closes the circle to. */
    for (int i = n - 2; i >= 0; i--) text = arena_printf(&s->session, "%s -> %s", text, chain[i]->module->name);
    Diag *d = diag_emit(s, DIAG_import_cycle, im->span, arena_printf(&s->session, "%s -> %s", text, closed->name));
    for (int i = n - 2; i >= 0; i--)
        diag_note(s, d, chain[i]->import_span, "`%s` imports `%s` here", chain[i + 1]->module->name,
                  chain[i]->module->name);
}

static Module *stand_in(Session *s, const Import *im) {
    Module *m = ARENA_NEW(&s->module, Module);
    m->name = im->name;
    m->file = im->span.file;
    m->missing = true;
    return m;
}

static Module *add_module(Loader *l, int file, const char *name, const char *real_path) {
    Module *m = parse_module(l->s, file, name);
    m->real_path = real_path;
    *l->end = m;
    l->end = &m->next;
    return m;
}

static void load_imports(Loader *l, const Frame *frame);

static Module *resolve(Loader *l, const Frame *frame, const Import *im) {
    Session *s = l->s;
    Module *m;
    bool in_stdlib = false;
    const char *path = find(s, frame->module, im->name, im->of_stdlib, &in_stdlib);
    if (!path) {
        report_missing(s, frame->module->file, im);
        return stand_in(s, im);
    }
    const char *real_path = identity(s, path);
    for (m = l->main; m; m = m->next)
        if (m->real_path == real_path) break;
    if (m && m->load_state == LOADING) {
        report_cycle(s, frame, im, m);
        return stand_in(s, im);
    }
    if (m) return m;
    if (frame->depth + 1 > MAX_IMPORT_DEPTH) {
        diag_emit(s, DIAG_import_limit, im->span, MAX_IMPORT_DEPTH);
        return stand_in(s, im);
    }
    const char *why;
    int file = in_stdlib || session_allows(s, im->name, path, &why) ? session_add_file(s, path, &why) : -1;
    if (file < 0) {
        diag_emit(s, DIAG_import_unreadable, im->span, path, why);
        return stand_in(s, im);
    }
    m = add_module(l, file, im->name, real_path);
    m->is_stdlib = in_stdlib;
    Frame inner = {.module = m, .outer = frame, .import_span = im->span, .depth = frame->depth + 1};
    load_imports(l, &inner);
    return m;
}

static void load_imports(Loader *l, const Frame *frame) {
    Module *m = frame->module;
    uint32_t kept = 0;
    m->load_state = LOADING;
    for (uint32_t i = 0; i < m->nimports; i++) {
        Import im = m->imports[i];
        bool again = false;
        im.module = resolve(l, frame, &im);
        for (uint32_t k = 0; k < kept; k++) again |= m->imports[k].module == im.module;
        if (!again) m->imports[kept++] = im;
    }
    m->nimports = kept;
    m->load_state = LOADED;
}

static const char *module_name(Session *s, const char *path) {
    if (!strcmp(path, "-")) return "stdin";
    if (path[0] == '<') return "expr";
    const char *slash = strrchr(path, '/');
    const char *base = slash ? slash + 1 : path;
    size_t n = strlen(base);
    if (n > 5 && !strcmp(base + n - 5, ".salt")) n -= 5;
    return intern(s, base, n);
}

Module *load_modules(Session *s, int file) {
    Loader l = {.s = s, .end = &l.main};
    const char *path = s->sources[file].path;
    Module *m = add_module(&l, file, module_name(s, path), identity(s, path));
    m->is_main = true;
    Frame frame = {.module = m, .import_span = SPAN_NONE};
    load_imports(&l, &frame);
    return m;
}
