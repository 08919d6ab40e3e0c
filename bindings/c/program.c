/* Compiling: from a file or a string to a program object. */
#include <dlfcn.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <time.h>
#include <unistd.h>

#include "bindings/c/api.h"
#include "bindings/c/values_plain.h"
#include "runtime/base/text.h"

static double now_ms(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e3 * (double)t.tv_sec + 1e-6 * (double)t.tv_nsec;
}

static const char *copy_string(Session *s, const char *text) {
    return text ? arena_strndup(&s->session, text, strlen(text)) : NULL;
}

/* Where the library's code was loaded from: libsaltus.so, or the program that links the archive. NULL if that cannot be
 * told. */
static char *own_file(void) {
    Dl_info info;
    char *exe = realpath("/proc/self/exe", NULL);
    if (dladdr((const void *)own_file, &info) && info.dli_fname && info.dli_fname[0] == '/') {
        char *file = realpath(info.dli_fname, NULL); /* for the program itself this is argv[0], which means little */
        if (file) {
            free(exe);
            return file;
        }
    }
    return exe;
}

/* ../`dir` from the folder of `file`, or from the folder above (lib/x86_64-linux-gnu/libsaltus.so, build/bin/saltus).
 */
static const char *stdlib_beside(Session *s, const char *file, const char *dir) {
    const char *slash = file ? strrchr(file, '/') : NULL;
    int n = slash ? (int)(slash - file) : 0;
    for (int up = 0; slash && up < 2; up++) {
        const char *path = arena_printf(&s->session, "%.*s/%s../%s", n, file, up ? "../" : "", dir);
        if (access(arena_printf(&s->session, "%s/gl.salt", path), R_OK) == 0) return path;
    }
    return NULL;
}

#ifndef SALTUS_STDLIB_BESIDE
#define SALTUS_STDLIB_BESIDE "share/saltus/stdlib" /* below the prefix */
#endif

/* The first there is: what the caller says, what the environment says, what lies beside the library, the tree that the
 * library was built from, also where it has been moved, and where it was meant to be installed. */
const char *api_stdlib(Session *s, const SltOptions *opt) {
    if (opt->stdlib_dir) return opt->stdlib_dir;
    const char *env = getenv("SALTUS_STDLIB");
    if (env && *env) return env;
    char *file = own_file();
    const char *beside = stdlib_beside(s, file, SALTUS_STDLIB_BESIDE);
#ifdef SALTUS_STDLIB_SOURCE
    if (!beside && access(SALTUS_STDLIB_SOURCE, R_OK) == 0) beside = SALTUS_STDLIB_SOURCE;
#endif
    if (!beside) beside = stdlib_beside(s, file, "stdlib");
    free(file);
    if (beside) return beside;
#ifdef SALTUS_STDLIB_INSTALL
    return SALTUS_STDLIB_INSTALL;
#else
    return "stdlib";
#endif
}

static const SltSet *copy_sets(Session *s, const SltSet *list, uint32_t n) {
    SltSet *copy = ARENA_ARRAY(&s->session, SltSet, n + 1);
    for (uint32_t i = 0; i < n; i++) copy[i] = (SltSet){copy_string(s, list[i].name), copy_string(s, list[i].value)};
    return copy;
}

/* Kernels are compiled long after the call that brought the options: nothing in them may point at the caller's memory.
 */
static void copy_options(Session *s, void *user) {
    SltOptions *o = user;
    const char **dirs = ARENA_ARRAY(&s->session, const char *, o->nimport_dirs + 1);
    for (uint32_t i = 0; i < o->nimport_dirs; i++) dirs[i] = copy_string(s, o->import_dirs[i]);
    o->import_dirs = dirs;
    o->set = copy_sets(s, o->set, o->nset);
    o->param_files = copy_sets(s, o->param_files, o->nparam_files);
    o->entry = copy_string(s, o->entry);
    o->target = copy_string(s, o->target);
    o->dump = copy_string(s, o->dump);
    o->verify_after = copy_string(s, o->verify_after);
    o->stop_after = copy_string(s, o->stop_after);
    o->stdlib_dir = copy_string(s, api_stdlib(s, o));
    s->stdlib_dir = o->stdlib_dir, s->import_dirs = o->import_dirs, s->nimport_dirs = o->nimport_dirs;
}

typedef struct Compile {
    SltProgram *p;
    const char *path, *text, *shown, *dir; /* path, or text from the folder dir */
    SltStatus status;
} Compile;

/* The points in the pipeline at which to dump, verify and stop. */
static SltStatus find_points(SltProgram *p) {
    const struct {
        const char *option, *text;
        PassPoint *point;
    } wanted[] = {{"--dump", p->opt.dump, &p->passes.dump},
                  {"--verify", p->opt.verify_after, &p->passes.verify},
                  {"--stop-after", p->opt.stop_after, &p->passes.stop_after}};
    if (p->opt.verify) p->passes.verify.pass = PASS_ALL;
    for (size_t i = 0; i < sizeof wanted / sizeof *wanted; i++) {
        if (!wanted[i].text) continue;
        const char *wrong = pass_point(&p->session->session, wanted[i].text, wanted[i].point);
        if (wrong) return status_fail(&p->error, SLT_USAGE, "%s: %s", wanted[i].option, wrong);
    }
    return SLT_OK;
}

/* By the end of its name, whatever its letters are and with a `.txt` behind. */
bool api_is_glsl(const char *path, SltLanguage language) {
    static const char *const ends[] = {".frag", ".fs", ".fsh", ".glsl"};
    if (language != SLT_LANGUAGE_AUTO || !path) return language == SLT_LANGUAGE_GLSL;
    size_t n = strlen(path);
    if (n > 4 && !strcasecmp(path + n - 4, ".txt")) n -= 4;
    for (size_t i = 0; i < sizeof ends / sizeof *ends; i++) {
        size_t m = strlen(ends[i]);
        if (n > m && !strncasecmp(path + n - m, ends[i], m)) return true;
    }
    return false;
}

bool api_looks_like_glsl(const char *text) {
    static const char *const signs[] = {"void mainImage(", "gl_Frag", "#version ", "void main()", "void main(void)"};
    for (size_t i = 0; i < sizeof signs / sizeof *signs; i++)
        if (strstr(text, signs[i])) return true;
    return false;
}

/* Does f read where in a pixel a sample lies, or which one it is? */
static bool reads_sample(const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_input && i->imm.i < SLT_IN_VARYING && i->imm.i != IN_PIXEL0 && i->imm.i != IN_PIXEL1)
            return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (reads_sample(i->region[r])) return true;
    }
    return false;
}

static void compile_body(Session *s, void *arg) {
    Compile *c = arg;
    SltProgram *p = c->p;
    double start = now_ms();
    int file;
    c->status = find_points(p);
    if (c->status != SLT_OK) return;
    if (c->path) {
        const char *why = NULL;
        file = session_add_file(s, c->path, &why);
        if (file < 0) {
            c->status = status_fail(&p->error, SLT_INPUT, "cannot read `%s`: %s", c->path, why ? why : "unknown cause");
            return;
        }
    } else {
        file = session_add_text(s, c->shown, c->dir, c->text, strlen(c->text));
    }
    p->source = file;
    if (p->opt.sandbox && file >= 0) s->sandbox = s->sources[file].dir;
    ConstOverride *overrides = ARENA_ARRAY(&s->session, ConstOverride, p->opt.nset + 1);
    for (uint32_t i = 0; i < p->opt.nset; i++)
        overrides[i] = (ConstOverride){p->opt.set[i].name, p->opt.set[i].value, false};
    ParamFile *files = ARENA_ARRAY(&s->session, ParamFile, p->opt.nparam_files + 1);
    for (uint32_t i = 0; i < p->opt.nparam_files; i++)
        files[i] = (ParamFile){.name = p->opt.param_files[i].name, .path = p->opt.param_files[i].value};
    bool glsl = api_is_glsl(c->path, p->opt.language);
    ProgramOptions po = {.front = {.entry = p->opt.entry,
                                   .f64 = p->opt.f64,
                                   .files = files,
                                   .nfiles = p->opt.nparam_files,
                                   .overrides = overrides,
                                   .noverrides = p->opt.nset,
                                   .disc_auto = p->opt.disc_auto || glsl, /* GLSL has no tags */
                                   .glsl = glsl,
                                   .size = {p->opt.size[0], p->opt.size[1]},
                                   .probe = api_probe_asset,
                                   .given = p->opt.lengths ? api_given_sizes : NULL,
                                   .probe_user = p},
                         .precision = p->opt.f64 ? PREC_F64 : PREC_F32,
                         .seed = p->opt.seed};
    p->keeps_probed = true;
    Program *prog = front_compile(s, file, &po);
    if (!p->has_lengths) p->opt.lengths = NULL; /* the caller's */
    p->ms_front = now_ms() - start;
    if (!prog || s->nerrors) {
        c->status = s->bad_usage ? SLT_USAGE : s->bad_input ? SLT_INPUT : SLT_PROGRAM;
        status_fail(&p->error, c->status, "the program has errors");
        if (s->diags && !glsl && p->opt.language == SLT_LANGUAGE_AUTO && api_looks_like_glsl(s->sources[file].text))
            diag_note(s, s->diags, s->diags->span, "the source looks like GLSL, which `--lang glsl` says it is");
        return;
    }
    for (uint32_t i = 0; i < p->opt.nset; i++)
        if (!overrides[i].used) {
            c->status = status_fail(&p->error, SLT_USAGE, "--set %s: there is no constant of this name at file scope",
                                    overrides[i].name);
            return;
        }
    p->prog = prog;
    p->passes.session = s, p->passes.program = prog, p->passes.has_fma = p->target.has_fma;
    start = now_ms();
    pipeline_primal(&p->passes, prog->primal);
    p->scene.tape_full = &p->tape_full, p->scene.doubt = &p->doubt;
    p->scene.pixelwise = !prog->uses_rand && !reads_sample(prog->primal->body);
    p->scene.boundless = !pipeline_has_bounds(prog->primal->body);
    api_derived_lower(p);
    p->ms_passes = now_ms() - start;
}

static SltStatus fill_program(SltProgram *p) {
    Program *prog = p->prog;
    size_t nf = prog->nfloats ? prog->nfloats : 1, ni = prog->nints ? prog->nints : 1;
    p->floats = calloc(nf, sizeof(double));
    p->flt = calloc(nf, sizeof(double));
    p->ints = calloc(ni, sizeof(int32_t));
    p->wrt = calloc(nf, 1);
    p->asset_loaded = calloc(prog->nparams + 1, sizeof(bool));
    if (!p->floats || !p->flt || !p->ints || !p->wrt || !p->asset_loaded || !api_geometries_init(p))
        return status_fail(&p->error, SLT_LIMIT, "out of memory for %u parameters", prog->nfloats);
    if (prog->nfloats) memcpy(p->floats, prog->init_floats, prog->nfloats * sizeof(double));
    if (prog->nints) memcpy(p->ints, prog->init_ints, prog->nints * sizeof(int32_t));
    api_params_changed(p, 0, program_floats(prog));
    SltStatus status = api_load_assets(p, &p->error);
    api_forget_probed(p);
    if (status != SLT_OK) return status;
    status = api_wrt(p, NULL, 0, &p->error);
    p->ready = status == SLT_OK;
    return status;
}

static SltStatus compile(const char *path, const char *text, const char *shown, const char *dir, const SltOptions *opt,
                         SltProgram **out) {
    *out = NULL;
    SltProgram *p = calloc(1, sizeof *p);
    if (!p) return SLT_LIMIT;
    p->session = session_create(0);
    if (!p->session) {
        free(p);
        return SLT_LIMIT;
    }
    *out = p;
    pthread_mutex_init(&p->late.lock, NULL);
    SltOptions *o = &p->opt;
    *o = SLT_OPTIONS_INIT;
    if (opt && !api_struct_read(o, sizeof *o, opt)) return api_struct_unknown(&p->error, "SltOptions");
    p->cached = true;
    Session *s = p->session;
    int unwound = session_protect(s, copy_options, o);
    if (unwound) return status_fail(&p->error, (SltStatus)unwound, "%s", s->unwind_text);
    if (o->target) {
        if (!target_named(&p->target, o->target))
            return status_fail(&p->error, SLT_USAGE, "unknown target `%s`: native, avx512, avx2 or sse2", o->target);
    } else {
        target_host(&p->target);
    }
    if ((unsigned)o->field > SLT_STRUCTURE_NAIVE)
        return status_fail(&p->error, SLT_USAGE, "unknown structure of geometries %d", (int)o->field);
    Compile c = {.p = p, .path = path, .text = text, .shown = shown, .dir = dir};
    unwound = session_protect(s, compile_body, &c);
    if (unwound) return status_fail(&p->error, (SltStatus)unwound, "%s", s->unwind_text);
    if (c.status != SLT_OK) return c.status;
    return fill_program(p);
}

SltStatus slt_compile_file(const char *path, const SltOptions *opt, SltProgram **out) {
    return compile(path, NULL, path, NULL, opt, out);
}

SltStatus slt_compile_string(const char *source, const char *shown_name, const SltOptions *opt, SltProgram **out) {
    return compile(NULL, source, shown_name ? shown_name : "<string>", ".", opt, out);
}

/* The source of p again, with more text behind it. */
static SltStatus compile_again(const SltProgram *p, const char *more, SltOptions *opt, SltProgram **out) {
    const Source *s = &p->session->sources[p->source];
    opt->rgba8 = false;
    opt->dump = opt->verify_after = opt->stop_after = NULL;
    size_t n = strlen(more);
    char *text = malloc(s->len + n + 1);
    *out = NULL;
    if (!text) return SLT_LIMIT;
    memcpy(text, s->text, s->len);
    memcpy(text + s->len, more, n + 1);
    SltStatus status = compile(NULL, text, s->path, s->dir, opt, out);
    free(text);
    return status;
}

SltStatus api_compile_beside(const SltProgram *p, const char *more, const char *entry, SltProgram **out) {
    SltOptions opt = p->opt;
    opt.entry = entry;
    return compile_again(p, more, &opt, out);
}

SltStatus api_compile_resized(const SltProgram *p, const char *lengths, SltProgram **out) {
    SltOptions opt = p->opt;
    SltSet *files = malloc((opt.nparam_files + 1) * sizeof *files);
    uint32_t n = 0;
    uint64_t ignored[1];
    *out = NULL;
    if (!files) return SLT_LIMIT;
    /* A file says the length no more where the values do. */
    for (uint32_t k = 0; k < opt.nparam_files; k++) {
        bool open = false;
        for (uint32_t i = 0; i < p->prog->nparams; i++) {
            const Symbol *sym = p->prog->params[i].sym;
            open |= !strcmp(p->prog->params[i].name, opt.param_files[k].name) && sym->open;
        }
        if (!open || !plain_sizes(lengths, opt.param_files[k].name, 1, ignored)) files[n++] = opt.param_files[k];
    }
    opt.param_files = files, opt.nparam_files = n;
    opt.lengths = lengths, opt.entry = p->prog->entry;
    SltStatus status = compile_again(p, "", &opt, out);
    free(files);
    return status;
}

void slt_program_free(SltProgram *p) {
    if (!p || atomic_load(&p->fitted) || !api_claim(p)) return;
    api_free_kernels(p);
    api_turns_free(p);
    api_derived_free(p);
    api_geometries_free(p);
    free(p->floats);
    free(p->flt);
    free(p->ints);
    free(p->wrt);
    free(p->asset_loaded);
    api_forget_probed(p);
    for (size_t i = 0; i < sizeof p->text / sizeof *p->text; i++) free(p->text[i]);
    session_destroy(p->session);
    pthread_mutex_destroy(&p->late.lock);
    free(p);
}

const char *slt_version(void) { return SALTUS_VERSION; }
const char *slt_last_error(const SltProgram *p) { return p ? p->error.text : "out of memory"; }

/* ---- diagnostics: a call that compiles kernels may add some. Compiling left no program, NULL, when memory ran out. */
uint32_t slt_diagnostic_count(const SltProgram *p) {
    uint32_t n = 0;
    if (!p || !api_claim(p)) return 0;
    for (const Diag *d = p->session->diags; d; d = d->next) n++;
    api_release(p);
    return n;
}

static SltDiagnostic described(const Session *s, const Diag *d) {
    SltDiagnostic q = SLT_DIAGNOSTIC_INIT;
    q.severity = d->severity == SEV_ERROR ? 1 : d->severity == SEV_WARNING ? 2 : 3;
    q.code = diag_code_name(d->code), q.message = d->text, q.file = "";
    if (d->span.file >= 0) {
        q.file = s->sources[d->span.file].path;
        span_position(s, d->span, &q.line, &q.column);
    }
    return q;
}

bool slt_diagnostic(const SltProgram *p, uint32_t index, SltDiagnostic *out) {
    if (!p || !api_struct_sized(out) || !api_claim(p)) return false;
    const Diag *d = p->session->diags;
    for (; d && index; index--) d = d->next;
    if (d) {
        SltDiagnostic q = described(p->session, d);
        api_struct_write(out, &q, sizeof q);
    }
    api_release(p);
    return d != NULL;
}

/* Diagnostics as a string that lives until the next of this slot; "" while the program is in use. */
static const char *printed(SltProgram *p, int slot, void (*print)(const Session *, FILE *)) {
    Text made;
    if (!api_claim(p)) return "";
    FILE *f = text_open(&made);
    if (f) print(p->session, f);
    char *text = text_close(&made);
    if (text) {
        free(p->text[slot]);
        p->text[slot] = text;
    }
    api_release(p);
    return text ? text : "";
}
static void print_text(const Session *s, FILE *f) { diag_print_text(s, f, false); }
const char *slt_diagnostics_text(SltProgram *p) { return p ? printed(p, 0, print_text) : "error: out of memory\n"; }
const char *slt_diagnostics_json(SltProgram *p) {
    static const char no_memory[] =
        "{\"uri\":\"\",\"range\":{\"start\":{\"line\":0,\"character\":0},\"end\":{\"line\":0,\"character\":0}},"
        "\"severity\":1,\"code\":\"limit\",\"source\":\"saltus\",\"message\":\"out of memory\"}\n";
    return p ? printed(p, 1, diag_print_json) : no_memory;
}

/* ---- facts: 0 and "" where the program did not compile */
uint32_t slt_dim(const SltProgram *p) { return p->prog ? p->prog->dim : 0; }
uint32_t slt_channels(const SltProgram *p) { return p->prog ? p->prog->channels : 0; }
bool slt_is_display(const SltProgram *p) { return p->prog && p->prog->display; }
const char *slt_entry(const SltProgram *p) { return p->prog ? p->prog->entry : ""; }
void slt_domain(const SltProgram *p, double lo[3], double hi[3]) {
    for (int d = 0; d < 3; d++) lo[d] = p->prog ? p->prog->lo[d] : 0, hi[d] = p->prog ? p->prog->hi[d] : 0;
}
uint32_t slt_site_count(const SltProgram *p) { return p->prog ? p->prog->primal->nsites : 0; }
bool slt_uses_rand(const SltProgram *p) { return p->prog && p->prog->uses_rand; }
