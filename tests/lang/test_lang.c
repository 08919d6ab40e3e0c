/* The language, program by program: every *.salt here (and every FOLDER/main.salt) says in comments what it must do;
 * README.md lists the directives. Values are computed by the interpreter and by compiled kernels of widths 1, 8 and 16,
 * in both precisions, and must agree bit for bit. With an argument only files whose path contains it are run. */
#include <ctype.h>
#include <dirent.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <cmocka.h>

#include "bindings/c/api.h"

enum { MAX_POINTS = 64, MAX_EXPECT = 128, MAX_FILES = 2000, SECONDS_PER_FILE = 60 };

typedef struct Point {
    double x[3], v[4];
    int nx, nv, precision; /* 32, 64, or 0: both */
    int line;
} Point;

typedef struct Message {
    int severity; /* 1 error, 2 warning */
    char code[8], text[160], file[64];
    uint32_t line, column; /* column 0: any */
    bool seen;
} Message;

typedef struct Total {
    char name[64]; /* "": the integral */
    double v[4];
    int nv, line;
} Total;

typedef struct Case {
    const char *path;
    Point points[MAX_POINTS];
    Message messages[MAX_EXPECT];
    Total totals[MAX_EXPECT];
    char texts[16][160], params[16][160], set_names[16][64], set_values[16][64];
    char entry[64];
    int npoints, nmessages, ntotals, ntexts, nparams, nsets, status, precision;
    long asserts, truncated, prints, sites, samples, samples_truncated, samples_failed;
    double tol[2], total_tol;
    bool ok, disc_auto;
    bool quadrature; /* the totals by quadrature too */
} Case;

/* ---- results of one file: lines of text for the parent */

static FILE *report;
static int failures;

__attribute__((format(printf, 2, 3))) static void wrong(const Case *c, const char *format, ...) {
    va_list ap;
    va_start(ap, format);
    fprintf(report, "%s: ", c->path);
    vfprintf(report, format, ap);
    fputc('\n', report);
    va_end(ap);
    failures++;
}

/* ---- reading expectations */

static int numbers(const char *s, double *v, int max) {
    int n = 0;
    for (char *end; n < max; s = end) {
        while (*s == ' ' || *s == ',') s++;
        v[n] = strtod(s, &end);
        if (end == s) break;
        n++;
    }
    return n;
}

static void copy(char *to, size_t size, const char *from, size_t n) {
    if (n >= size) n = size - 1;
    memcpy(to, from, n);
    to[n] = 0;
    while (n > 0 && isspace((unsigned char)to[n - 1])) to[--n] = 0;
}

/* The rest of the line behind a directive, NULL if it is another one. */
static const char *directive(const char *s, const char *word) {
    size_t n = strlen(word);
    return strncmp(s, word, n) ? NULL : s + n;
}

static void read_point(Case *c, const char *s, int line) {
    if (c->npoints == MAX_POINTS) {
        wrong(c, "too many points");
        return;
    }
    Point *p = &c->points[c->npoints++];
    p->line = line;
    if (!strncmp(s, "32", 2)) p->precision = 32, s += 2;
    else if (!strncmp(s, "64", 2)) p->precision = 64, s += 2;
    if (*s == '(') p->nx = numbers(s + 1, p->x, 3);
    s = strchr(s, ':');
    if (s) p->nv = numbers(s + 1, p->v, 4);
    if (p->nv == 0) wrong(c, "line %d: a value without numbers", line);
}

/* error E0101 @12:5 part of the message: code, place (line, or :column alone) and text are optional. */
static void read_message(Case *c, const char *s, int severity, int line, const char *file) {
    if (c->nmessages == MAX_EXPECT) {
        wrong(c, "too many messages");
        return;
    }
    Message *m = &c->messages[c->nmessages++];
    m->severity = severity, m->line = (uint32_t)line;
    copy(m->file, sizeof m->file, file, strlen(file));
    while (*s == ' ') s++;
    if ((s[0] == 'E' || s[0] == 'W') && isdigit((unsigned char)s[1])) copy(m->code, sizeof m->code, s, 5), s += 5;
    while (*s == ' ') s++;
    if (*s == '@') {
        char *end;
        s++;
        if (*s != ':') m->line = (uint32_t)strtoul(s, &end, 10), s = end;
        if (*s == ':') m->column = (uint32_t)strtoul(s + 1, &end, 10), s = end;
    }
    while (*s == ' ' || *s == ':') s++;
    const char *next = !strncmp(s, "// ", 3) ? s : strstr(s, " // ");
    copy(m->text, sizeof m->text, s, next ? (size_t)(next - s) : strcspn(s, "\n"));
}

static void read_total(Case *c, const char *name, size_t n, const char *values, int line) {
    if (c->ntotals == MAX_EXPECT) {
        wrong(c, "too many totals");
        return;
    }
    Total *t = &c->totals[c->ntotals++];
    copy(t->name, sizeof t->name, name, n);
    t->nv = numbers(values, t->v, 4), t->line = line;
    if (t->nv == 0) wrong(c, "line %d: a total without numbers", line);
}

static void read_comment(Case *c, const char *s, int line, const char *file) {
    const char *a;
    if ((a = directive(s, "value")) && (*a == '(' || *a == ':' || isdigit((unsigned char)*a))) read_point(c, a, line);
    else if ((a = directive(s, "error")) && (*a == ' ' || *a == ':' || *a == '\n')) read_message(c, a, 1, line, file);
    else if ((a = directive(s, "warning")) && (*a == ' ' || *a == ':' || *a == '\n')) read_message(c, a, 2, line, file);
    else if ((a = directive(s, "quadrature:"))) c->quadrature = strncmp(a, "too", 3) == 0;
    else if ((a = directive(s, "integral:"))) read_total(c, "", 0, a, line);
    else if ((a = directive(s, "grad "))) {
        size_t n = strcspn(a, ":\n");
        if (a[n] == ':') read_total(c, a, n, a + n + 1, line);
    } else if ((a = directive(s, "text: "))) copy(c->texts[c->ntexts++ & 15], sizeof c->texts[0], a, strcspn(a, "\n"));
    else if ((a = directive(s, "param: ")))
        copy(c->params[c->nparams++ & 15], sizeof c->params[0], a, strcspn(a, "\n"));
    else if ((a = directive(s, "set: "))) {
        size_t n = strcspn(a, "=");
        copy(c->set_names[c->nsets & 15], sizeof c->set_names[0], a, n);
        copy(c->set_values[c->nsets++ & 15], sizeof c->set_values[0], a + n + 1, strcspn(a + n + 1, " \n"));
    } else if ((a = directive(s, "entry: "))) copy(c->entry, sizeof c->entry, a, strcspn(a, "\n"));
    else if ((a = directive(s, "tol: ")))
        c->tol[0] = c->tol[1] = 0, c->tol[1] = numbers(a, c->tol, 2) == 2 ? c->tol[1] : c->tol[0];
    else if ((a = directive(s, "grad-tol: "))) c->total_tol = atof(a);
    else if ((a = directive(s, "status: "))) c->status = atoi(a);
    else if ((a = directive(s, "asserts: "))) c->asserts = atol(a);
    else if ((a = directive(s, "truncated: "))) c->truncated = atol(a);
    else if ((a = directive(s, "prints: "))) c->prints = atol(a);
    else if ((a = directive(s, "sites: "))) c->sites = atol(a);
    else if ((a = directive(s, "samples-truncated: "))) c->samples_truncated = atol(a);
    else if ((a = directive(s, "samples-failed: "))) c->samples_failed = atol(a);
    else if ((a = directive(s, "samples: "))) c->samples = atol(a);
    else if ((a = directive(s, "precision: f"))) c->precision = atoi(a);
    else if (directive(s, "disc: auto")) c->disc_auto = true;
    else if (directive(s, "ok\n")) c->ok = true;
}

static void read_file(Case *c, const char *path) {
    FILE *f = fopen(path, "r");
    if (!f) {
        wrong(c, "cannot read %s", path);
        return;
    }
    const char *base = strrchr(path, '/') + 1;
    static char text[1 << 16];
    int line = 0;
    while (fgets(text, sizeof text, f)) {
        line++;
        for (char *s = text; (s = strstr(s, "//"));) {
            s += 2;
            while (*s == ' ') s++;
            read_comment(c, s, line, base);
        }
    }
    fclose(f);
}

/* ---- running */

static bool close_to(double got, double want, double tol) {
    if (isnan(want)) return isnan(got);
    if (isinf(want)) return got == want;
    return fabs(got - want) <= tol * fmax(1.0, fabs(want));
}

static SltProgram *compile(const Case *c, bool f64, uint32_t width, SltStatus *status) {
    SltOptions o = SLT_OPTIONS_INIT;
    SltSet set[16];
    for (int i = 0; i < c->nsets; i++) set[i] = (SltSet){c->set_names[i], c->set_values[i]};
    o.f64 = f64, o.width = width, o.seed = 5, o.verify = true, o.no_cache = true, o.disc_auto = c->disc_auto;
    o.entry = c->entry[0] ? c->entry : NULL, o.set = set, o.nset = (uint32_t)c->nsets;
    o.stdlib_dir = SALTUS_STDLIB_BUILD;
    SltProgram *p = NULL;
    *status = slt_compile_file(c->path, &o, &p);
    for (int i = 0; *status == SLT_OK && i < c->nparams; i++) {
        char name[160];
        SltError err = {0};
        size_t n = strcspn(c->params[i], "=");
        copy(name, sizeof name, c->params[i], n);
        *status = slt_set_text(p, name, c->params[i] + n + 1, &err);
        if (*status != SLT_OK && c->status != (int)*status) wrong(c, "param %s: %s", c->params[i], err.text);
    }
    return p;
}

static void check_messages(Case *c, SltProgram *p) {
    for (uint32_t i = 0; i < slt_diagnostic_count(p); i++) {
        SltDiagnostic d = SLT_DIAGNOSTIC_INIT;
        if (!slt_diagnostic(p, i, &d) || d.severity > 2) continue;
        const char *base = d.file && strrchr(d.file, '/') ? strrchr(d.file, '/') + 1 : d.file ? d.file : "";
        bool found = false;
        for (int k = 0; k < c->nmessages && !found; k++) {
            Message *m = &c->messages[k];
            if (m->seen || m->severity != d.severity || m->line != d.line || strcmp(m->file, base)) continue;
            if (m->code[0] && strcmp(m->code, d.code)) continue;
            if (m->column && m->column != d.column) continue;
            if (m->text[0] && !strstr(d.message, m->text)) continue;
            m->seen = found = true;
        }
        if (!found) wrong(c, "unexpected %s:%u:%u: %s: %s", base, d.line, d.column, d.code, d.message);
        if (d.severity == 1 && d.line == 0 && c->status == SLT_PROGRAM)
            wrong(c, "an error without a place: %s", d.message);
    }
    for (int k = 0; k < c->nmessages; k++)
        if (!c->messages[k].seen)
            wrong(c, "%s:%u: expected %s %s %s", c->messages[k].file, c->messages[k].line,
                  c->messages[k].severity == 1 ? "error" : "warning", c->messages[k].code, c->messages[k].text);
    for (int k = 0; k < c->ntexts; k++)
        if (!strstr(slt_diagnostics_text(p), c->texts[k]) && !strstr(slt_last_error(p), c->texts[k]))
            wrong(c, "nothing says \"%s\"; said is\n%s%s", c->texts[k], slt_diagnostics_text(p), slt_last_error(p));
}

typedef struct Values {
    double v[MAX_POINTS][4];
    long truncated, asserts, prints;
} Values;

static void count_print(void *user, const char *text, uint32_t len, const double *values, uint32_t n, uint32_t lane) {
    (void)text, (void)len, (void)values, (void)n, (void)lane;
    ++*(long *)user;
}

static void put(bool f64, void *a, int i, double v) {
    if (f64) ((double *)a)[i] = v;
    else ((float *)a)[i] = (float)v;
}

/* Every vector holds all points, repeated, so that lanes diverge. */
static void evaluate(const Case *c, SltProgram *p, bool f64, bool interpret, Values *out) {
    SltKernelArgs args = {.params = p->flt,
                          .iparams = p->ints,
                          .resolution = {16, 8},
                          .print = count_print,
                          .user = &out->prints,
                          .geometries = p->scene.geometries};
    enum { CAPACITY = MAX_POINTS + SLT_PAD };
    char *memory = aligned_alloc(64, (SLT_IN_VARYING + SLT_OUT_MAX) * CAPACITY * 8);
    memset(memory, 0, (SLT_IN_VARYING + SLT_OUT_MAX) * CAPACITY * 8);
    for (int s = 0; s < SLT_IN_VARYING; s++) args.in[s] = memory + s * CAPACITY * 8;
    for (int s = 0; s < SLT_OUT_MAX; s++) args.out[s] = memory + (SLT_IN_VARYING + s) * CAPACITY * 8;
    for (int i = 0; i < CAPACITY; i++) {
        const Point *q = &c->points[i % c->npoints];
        for (int d = 0; d < 3; d++)
            put(f64, (void *)args.in[IN_X0 + d], i, d < q->nx ? q->x[d] : 0.5 * (p->prog->lo[d] + p->prog->hi[d]));
        put(f64, (void *)args.in[IN_RAND0], i, 0.25);
        ((int32_t *)args.in[IN_STREAM])[i] = i % c->npoints;
        ((int32_t *)args.in[IN_PIXEL0])[i] = 3;
        ((int32_t *)args.in[IN_PIXEL1])[i] = 2;
    }
    uint32_t n = (uint32_t)c->npoints;
    args.n_valid = n;
    if (interpret) ir_interpret(p->fn[K_VALUE], &args, n, 16);
    else p->scene.kernel[SLT_K_VALUE](&args, n);
    for (int i = 0; i < c->npoints; i++)
        for (uint32_t k = 0; k < slt_channels(p); k++)
            out->v[i][k] = f64 ? ((double *)args.out[k])[i] : (double)((float *)args.out[k])[i];
    out->truncated = (long)args.counters[SLT_COUNT_TRUNCATED], out->asserts = (long)args.counters[SLT_COUNT_ASSERT];
    free(memory);
}

static bool same(double a, double b) { return (isnan(a) && isnan(b)) || !memcmp(&a, &b, sizeof a); }

static void check_values(Case *c, bool f64) {
    static const uint32_t widths[] = {1, 8, 16};
    static Values want, got;
    for (size_t w = 0; w < sizeof widths / sizeof *widths; w++) {
        SltStatus s;
        SltError err = {0};
        SltProgram *p = compile(c, f64, widths[w], &s);
        bool needs[K_KINDS] = {[K_VALUE] = true};
        if (s != SLT_OK || api_kernels(p, needs, &err) != SLT_OK) {
            wrong(c, "no value kernel of width %u: %s", widths[w], err.text);
            slt_program_free(p);
            return;
        }
        uint32_t channels = slt_channels(p);
        if (w == 0) {
            want = (Values){0};
            evaluate(c, p, f64, true, &want);
            for (int i = 0; i < c->npoints; i++) {
                const Point *q = &c->points[i];
                if (q->precision && q->precision != (f64 ? 64 : 32)) continue;
                if ((uint32_t)q->nv != channels)
                    wrong(c, "line %d: %d numbers for %u channels", q->line, q->nv, channels);
                for (uint32_t k = 0; k < channels; k++)
                    if (!close_to(want.v[i][k], f64 ? q->v[k] : (double)(float)q->v[k], c->tol[f64]))
                        wrong(c, "line %d: channel %u in %s is %.17g, not %.17g", q->line, k, f64 ? "f64" : "f32",
                              want.v[i][k], q->v[k]);
            }
            if (c->asserts >= 0 && want.asserts != c->asserts)
                wrong(c, "%ld asserts failed, not %ld", want.asserts, c->asserts);
            if (c->truncated >= 0 && want.truncated != c->truncated)
                wrong(c, "%ld loops cut short, not %ld", want.truncated, c->truncated);
            if (c->prints >= 0 && want.prints != c->prints) wrong(c, "%ld prints, not %ld", want.prints, c->prints);
        }
        got = (Values){0};
        evaluate(c, p, f64, false, &got);
        for (int i = 0; i < c->npoints; i++)
            for (uint32_t k = 0; k < channels; k++)
                if (!same(want.v[i][k], got.v[i][k]))
                    wrong(c, "line %d: width %u %s gives %.17g, the interpreter %.17g", c->points[i].line, widths[w],
                          f64 ? "f64" : "f32", got.v[i][k], want.v[i][k]);
        if (got.asserts != want.asserts || got.truncated != want.truncated || got.prints != want.prints)
            wrong(c, "width %u counts %ld asserts, %ld cuts, %ld prints, the interpreter %ld, %ld, %ld", widths[w],
                  got.asserts, got.truncated, got.prints, want.asserts, want.truncated, want.prints);
        slt_program_free(p);
    }
}

static void check_totals(Case *c, SltProgram *p, bool f64, SltEstimator estimator) {
    SltError err = {0};
    SltStats stats = SLT_STATS_INIT;
    SltJob job = SLT_JOB_INIT;
    job.integral = true, job.samples = job.segments = (uint64_t)c->samples, job.threads = 1, job.seed = 1;
    job.estimator = estimator;
    bool lattice = estimator == SLT_EST_LATTICE;
    const char *by = lattice ? "" : " by quadrature";
    uint32_t n = slt_channels(p), nf = slt_float_count(p);
    double *memory = calloc((size_t)n * (nf + 1) + 1, sizeof *memory);
    SltIntegral r = {.struct_size = sizeof r, .value = memory, .gradient = memory + n};
    if (slt_grad_integral(p, &job, &r, &stats, &err) != SLT_OK)
        wrong(c, "%s: no integral: %s", f64 ? "f64" : "f32", err.text);
    if (lattice && c->samples_truncated >= 0 && (long)stats.truncated != c->samples_truncated)
        wrong(c, "%ld samples cut short in the integral, not %ld", (long)stats.truncated, c->samples_truncated);
    if (lattice && c->samples_failed >= 0 && (long)stats.asserts != c->samples_failed)
        wrong(c, "%ld failed asserts in the integral, not %ld", (long)stats.asserts, c->samples_failed);
    for (int i = 0; i < c->ntotals && !failures; i++) {
        const Total *t = &c->totals[i];
        SltParam q = {.struct_size = sizeof q, .fcount = 1};
        if ((uint32_t)t->nv != n) wrong(c, "line %d: %d numbers for %u channels", t->line, t->nv, n);
        if (t->name[0] && (slt_param_find(p, t->name, &q, &err) != SLT_OK || q.fcount != 1)) {
            wrong(c, "line %d: %s is not one number: %s", t->line, t->name, err.text);
            continue;
        }
        for (uint32_t k = 0; k < n; k++) {
            double got = t->name[0] ? r.gradient[(size_t)k * nf + q.fbase] : r.value[k];
            if (!close_to(got, t->v[k], c->total_tol))
                wrong(c, "line %d: %s: %s%s of channel %u%s is %.9g, not %.9g", t->line, f64 ? "f64" : "f32",
                      t->name[0] ? "derivative by " : "integral", t->name, k, by, got, t->v[k]);
        }
    }
    free(memory);
}

static void run_case(Case *c, const char *path) {
    char dir[512];
    *c = (Case){.path = path,
                .status = -1,
                .asserts = -1,
                .truncated = -1,
                .prints = -1,
                .sites = -1,
                .samples_truncated = -1,
                .samples_failed = -1,
                .samples = 65536,
                .tol = {1e-6, 1e-13},
                .total_tol = 2e-3};
    size_t n = strlen(path);
    if (n > 10 && !strcmp(path + n - 10, "/main.salt")) { /* imported files say what is expected in them */
        copy(dir, sizeof dir, path, n - 10);
        DIR *d = opendir(dir);
        for (struct dirent *e; d && (e = readdir(d));) {
            char file[1024];
            size_t len = strlen(e->d_name);
            snprintf(file, sizeof file, "%s/%s", dir, e->d_name);
            if (len > 5 && !strcmp(e->d_name + len - 5, ".salt")) read_file(c, file);
        }
        closedir(d);
    } else {
        read_file(c, path);
    }
    bool errors = false;
    for (int i = 0; i < c->nmessages; i++) errors |= c->messages[i].severity == 1;
    if (c->status < 0) c->status = errors ? SLT_PROGRAM : SLT_OK;
    if (c->nmessages + c->ntotals + c->npoints + c->ntexts == 0 && !c->ok && c->sites < 0) wrong(c, "expects nothing");
    for (int f64 = 0; f64 < 2; f64++) {
        if (c->precision && c->precision != (f64 ? 64 : 32)) continue;
        SltStatus s;
        struct timespec a, b;
        clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &a);
        SltProgram *p = compile(c, f64, 0, &s);
        clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &b);
        double seconds = (double)(b.tv_sec - a.tv_sec) + 1e-9 * (double)(b.tv_nsec - a.tv_nsec);
        for (int i = 0; i < c->nmessages; i++) c->messages[i].seen = false;
        check_messages(c, p);
        if ((int)s != c->status) wrong(c, "status %d, not %d: %s", (int)s, c->status, slt_last_error(p));
        if (seconds > 5) wrong(c, "the front end took %.1f s", seconds);
        if (s == SLT_OK && c->sites >= 0 && (long)slt_site_count(p) != c->sites)
            wrong(c, "%u sites, not %ld", slt_site_count(p), c->sites);
        if (s == SLT_OK && c->ntotals) {
            check_totals(c, p, f64, SLT_EST_LATTICE);
            if (c->quadrature) check_totals(c, p, f64, SLT_EST_QUADRATURE);
        }
        slt_program_free(p);
        if (s == SLT_OK && c->npoints) check_values(c, f64);
        if (failures) break;
    }
}

/* ---- all files, each in a process of its own: a crash is one failure. A few at a time. */

static const char *only;
static char *files[MAX_FILES];
static int nfiles;

static int by_name(const void *a, const void *b) { return strcmp(*(char *const *)a, *(char *const *)b); }

static void collect(const char *dir, bool top) {
    DIR *d = opendir(dir);
    assert_non_null(d);
    for (struct dirent *e; (e = readdir(d));) {
        char path[1024];
        size_t n = strlen(e->d_name);
        snprintf(path, sizeof path, "%s/%s", dir, e->d_name);
        if (e->d_name[0] == '.') continue;
        if (n > 5 && !strcmp(e->d_name + n - 5, ".salt")) {
            if ((top || !strcmp(e->d_name, "main.salt")) && (!only || strstr(path, only))) {
                assert_true(nfiles < MAX_FILES);
                files[nfiles++] = strdup(path);
            }
        } else if (top && e->d_type == DT_DIR) {
            collect(path, false);
        }
    }
    closedir(d);
}

typedef struct Child {
    pid_t pid;
    FILE *out;
    int file;
} Child;

static pid_t start(Child *child, int file) {
    child->file = file;
    child->out = tmpfile();
    fflush(stdout);
    child->pid = fork();
    if (child->pid == 0) {
        static Case c;
        report = child->out;
        /* Of processor time; the alarm is for what sleeps for ever. */
        setrlimit(RLIMIT_CPU, &(struct rlimit){SECONDS_PER_FILE, RLIM_INFINITY});
        alarm(30 * SECONDS_PER_FILE);
        run_case(&c, files[file]);
        fflush(report);
        _exit(failures > 0);
    }
    return child->pid;
}

static bool finish(Child *child, int status) {
    char line[4096];
    rewind(child->out);
    while (fgets(line, sizeof line, child->out)) fputs(line, stdout);
    if (WIFSIGNALED(status)) printf("%s: ended by signal %d\n", files[child->file], WTERMSIG(status));
    fclose(child->out);
    child->pid = 0;
    return status == 0;
}

/* LLVM's library is loaded, which takes as long as a file, before there are processes: each has it then. */
static void open_compiler(void) {
    SltOptions o = SLT_OPTIONS_INIT;
    SltProgram *p = NULL;
    SltError err = {0};
    o.no_cache = true, o.stdlib_dir = SALTUS_STDLIB_BUILD;
    bool needs[K_KINDS] = {[K_VALUE] = true};
    assert_int_equal(slt_compile_string("shader float main(float x) { return x; }", "open", &o, &p), SLT_OK);
    assert_int_equal(api_kernels(p, needs, &err), SLT_OK);
    slt_program_free(p);
}

static void all_files(void **state) {
    (void)state;
    open_compiler();
    collect(SALTUS_TEST_DIR "/lang", true);
    qsort(files, (size_t)nfiles, sizeof *files, by_name);
    long cores = sysconf(_SC_NPROCESSORS_ONLN);
    int jobs = cores < 1 ? 1 : cores > 4 ? 4 : (int)cores, bad = 0, next = 0, running = 0;
    Child children[4] = {0};
    while (next < nfiles || running) {
        for (int i = 0; i < jobs && next < nfiles; i++)
            if (!children[i].pid && start(&children[i], next) > 0) next++, running++;
        int status;
        pid_t pid = wait(&status);
        for (int i = 0; i < jobs; i++)
            if (children[i].pid == pid && pid > 0) bad += !finish(&children[i], status), running--;
    }
    printf("%d files, %d wrong\n", nfiles, bad);
    if (!only) assert_true(nfiles >= 220);
    assert_int_equal(bad, 0);
}

int main(int argc, char **argv) {
    only = argc > 1 ? argv[1] : NULL;
    const struct CMUnitTest tests[] = {cmocka_unit_test(all_files)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
