/* What the counts of a call say that its results do not, in words. */
#include <stdio.h>
#include <string.h>

#include "bindings/c/api.h"
#include "bindings/c/warnings.h"

#define SINGULAR 0.03

/* A warning may have several lines: `size` is left of buf. */
typedef const SltPlace *Warn(const SltStats *s, char *buf,
                             size_t size); /* the place, which may be none_at; NULL: nothing */
static const SltPlace none_at;

uint64_t api_lost(const SltStats *s) {
    uint64_t lost = 0;
    for (int r = 0; r < SLT_DROP_REASONS; r++) lost += r == SLT_DROP_COINCIDENT ? 0 : s->dropped[r];
    return lost;
}

/* Some were counted as crossings before they were dropped. */
static uint64_t met(const SltStats *s) {
    return s->crossings + api_lost(s) - s->dropped[SLT_DROP_ZERO_GRADIENT] - s->dropped[SLT_DROP_INCONSISTENT];
}

/* (x, y) */
static const char *point_text(const double x[3], char buf[96]) {
    int n = x[2] != 0 ? 3 : 2, at = 0;
    for (int d = 0; d < n; d++) at += snprintf(buf + at, 96 - (size_t)at, "%s%.6g", d ? ", " : "(", x[d]);
    snprintf(buf + at, 96 - (size_t)at, ")");
    return buf;
}

static int most_dropped(const SltStats *s) {
    int most = -1;
    for (int r = 0; r < SLT_DROP_REASONS; r++)
        if (r != SLT_DROP_COINCIDENT && s->dropped[r] && (most < 0 || s->dropped[r] > s->dropped[most])) most = r;
    return most;
}

static const char *title_of(const char *code) {
    static const struct {
        const char *name, *title;
    } codes[] = {
#define CODE(name, title, text) {name, title},
#include "bindings/c/codes.def"
#undef CODE
    };
    for (size_t i = 0; i < sizeof codes / sizeof *codes; i++)
        if (!strcmp(codes[i].name, code)) return codes[i].title;
    return "";
}

/* Why most of them were, where, and what helps. */
const SltPlace *api_lost_text(const SltStats *s, char *buf, size_t size) {
    int most = most_dropped(s),
        at = snprintf(buf, size, "%llu of %llu crossings were dropped:", (unsigned long long)api_lost(s),
                      (unsigned long long)met(s));
    if (most < 0) return &none_at;
    for (int r = 0; r < SLT_DROP_REASONS; r++)
        if (s->dropped[r] && r != SLT_DROP_COINCIDENT)
            at +=
                snprintf(buf + at, size - (size_t)at, " %s %llu", slt_drop_names[r], (unsigned long long)s->dropped[r]);
    const SltPlace *place = &s->dropped_at[most];
    const char *title = title_of(slt_drop_names[most]);
    char x[96];
    if (place->known) at += snprintf(buf + at, size - (size_t)at, "; as at x = %s", point_text(place->x, x));
    if (place->text) at += snprintf(buf + at, size - (size_t)at, ", `%s`", place->text);
    snprintf(buf + at, size - (size_t)at, " (%s: `saltus explain %s`)", title, slt_drop_names[most]);
    return place;
}

static const SltPlace *dropped_text(const SltStats *s, char *buf, size_t size) {
    return api_lost(s) * 1000 <= met(s) ? NULL : api_lost_text(s, buf, size);
}

/* Where boundaries coincide and move apart, the integral has a derivative to each side, and none. */
static const SltPlace *coincident_text(const SltStats *s, char *buf, size_t size) {
    uint64_t n = s->dropped[SLT_DROP_COINCIDENT];
    const char *text = s->dropped_at[SLT_DROP_COINCIDENT].text;
    snprintf(
        buf, size,
        "boundaries coincide and move apart, or one lies on the domain's border: the integral has no derivative there; what is printed lies halfway "
        "between those to the two sides, half their difference is part of the error (%llu places%s%s%s; `saltus explain "
        "coincident`)",
        (unsigned long long)n, text ? ", `" : "", text ? text : "", text ? "`" : "");
    return n ? &s->dropped_at[SLT_DROP_COINCIDENT] : NULL;
}

/* Far from the origin, or with very many lines. */
static const SltPlace *ulps_text(const SltStats *s, char *buf, size_t size) {
    snprintf(buf, size,
             "in single precision coordinates here have %.2g steps from line to line, fewer than %d: errors are larger "
             "than stated; --precision f64, or a domain nearer to the origin",
             s->ulps, SLT_FEW_ULPS);
    return s->ulps > 0 ? &none_at : NULL;
}

/* Then nothing in the answer tells. */
static const SltPlace *range_text(const SltStats *s, char *buf, size_t size) {
    bool high = s->out_of_range > 0;
    const char *text = s->out_of_range_at.text;
    snprintf(buf, size,
             "squares or products %s in single precision in much of the domain, and what comes of them is "
             "asked%s%s%s: what is printed may be wrong by any amount; --precision f64, or other units",
             high ? "are infinite" : "vanish", text ? ", `" : "", text ? text : "", text ? "`" : "");
    return s->out_of_range ? &s->out_of_range_at : NULL;
}

static const SltPlace *unmet_text(const SltStats *s, char *buf, size_t size) {
    const char *mesh = s->unmet_at.text;
    snprintf(buf, size,
             "triangles%s%s%s that nothing meets: %llu; a corner of each is not finite, or beyond 1e29, where "
             "searches end",
             mesh ? " of `" : "", mesh ? mesh : "", mesh ? "`" : "", (unsigned long long)s->unmet);
    return s->unmet ? &s->unmet_at : NULL;
}

static const SltPlace *blind_text(const SltStats *s, char *buf, size_t size) {
    const char *mesh = s->blind_at.text;
    snprintf(buf, size,
             "a window through which pieces%s%s%s were asked had a number that is not finite, or beyond 1e30: nothing "
             "is seen through it, as if nothing were there%s",
             mesh ? " of `" : "", mesh ? mesh : "", mesh ? "`" : "", s->blind > 1 ? "; of other meshes too" : "");
    return s->blind ? &s->blind_at : NULL;
}

/* Else the certificate would be believed of these jumps too. */
static const SltPlace *upset_text(const SltStats *s, char *buf, size_t size) {
    snprintf(
        buf, size,
        "line %u: f jumps where this decides, or makes a [Disc] decide otherwise, and no [Disc] tags it. The "
        "derivative lacks its motion: tag it. The stated error grows by the size of the jumps, as if they moved by "
        "1; %.2g of the domain is not certified for it",
        s->upset_line, s->upset);
    return s->upset > 0 ? &none_at : NULL;
}

/* Said where it is no small part of what is stated. */
static const SltPlace *singular_text(const SltStats *s, char *buf, size_t size) {
    snprintf(buf, size,
             "a derivative hangs on a few samples or places beside an edge, as it does where f is a small power of the "
             "distance (pow(d, 0.1)): what lies nearer than they do may be %.2g of the largest derivative. Where an "
             "error is stated, that is part of it",
             s->singular);
    return s->singular > SINGULAR ? &none_at : NULL;
}

const SltPlace *api_nonfinite_text(const SltStats *s, char *buf, size_t size) {
    const SltPlace *place = &s->nonfinite_at;
    char x[96];
    int at = snprintf(
        buf, size,
        "results that are not finite: %llu, or samples of a derivative that were left out. f, its integral or a "
        "derivative is infinite or NaN somewhere",
        (unsigned long long)s->nonfinite);
    if (place->in_image)
        at +=
            snprintf(buf + at, size - (size_t)at, "; the first in column %u, row %u", place->pixel[0], place->pixel[1]);
    if (place->line || !place->in_image)
        if (place->known) at += snprintf(buf + at, size - (size_t)at, "; at x = %s", point_text(place->x, x));
    if (place->text) snprintf(buf + at, size - (size_t)at, " by `%s`", place->text);
    return s->nonfinite ? place : NULL;
}

static const SltPlace *truncated_text(const SltStats *s, char *buf, size_t size) {
    snprintf(buf, size, "[MaxIters] cut a loop short %llu times", (unsigned long long)s->truncated);
    return s->truncated ? &none_at : NULL;
}

static const SltPlace *assert_text(const SltStats *s, char *buf, size_t size) {
    snprintf(buf, size, "assert failed %llu times", (unsigned long long)s->asserts);
    return s->asserts ? &none_at : NULL;
}

static const struct {
    const char *code;
    Warn *text;
} rows[] = {{"dropped", dropped_text},     {"coincident", coincident_text}, {"few_ulps", ulps_text},
            {"out_of_range", range_text},  {"upset", upset_text},           {"singular", singular_text},
            {"unmet", unmet_text},         {"blind", blind_text},           {"nonfinite", api_nonfinite_text},
            {"truncated", truncated_text}, {"assert", assert_text}};

bool slt_warning(const SltStats *stats, uint32_t index, SltWarning *out) {
    SltStats s;
    SltWarning w = SLT_WARNING_INIT;
    if (!stats || !out || !api_struct_sized(out) || !api_struct_read(&s, sizeof s, stats)) return false;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        const SltPlace *at = rows[i].text(&s, w.text, sizeof w.text);
        if (!at || index-- > 0) continue;
        w.code = rows[i].code, w.at = *at;
        w.severity = !strcmp(w.code, "assert") ? 1 : 2;
        api_struct_write(out, &w, sizeof w);
        return true;
    }
    return false;
}
