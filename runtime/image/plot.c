/* Line plots as SVG: axes, ticks, grid, legend, error bars; linear or logarithmic. */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* newlocale, uselocale */
#endif
#include "internal.h"

#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_TICKS = 64 };

typedef struct Axis {
    bool log;
    double lo, hi;   /* in plot units: log10 of the value when log */
    double from, to; /* pixels of lo and hi */
    double ticks[MAX_TICKS];
    int tick_count, decade_step;
} Axis;

/* Eight hues that differ in lightness too, so that they survive grey printing and common colour
 * blindness. */
static const char *const palette[] = {"#1f5fa8", "#d1512d", "#2b8a57", "#8a3f9e",
                                      "#b08900", "#0f8fa3", "#c2347a", "#5b5b5b"};

static double to_unit(const Axis *a, double v) { return a->log ? (v > 0 ? log10(v) : NAN) : v; }

static double to_pixel(const Axis *a, double u) { return a->from + (u - a->lo) / (a->hi - a->lo) * (a->to - a->from); }

static void escape(Bytes *b, const char *text) {
    for (; *text; text++) {
        switch (*text) {
        case '&': image_bytes_append(b, "&amp;", 5); break;
        case '<': image_bytes_append(b, "&lt;", 4); break;
        case '>': image_bytes_append(b, "&gt;", 4); break;
        case '"': image_bytes_append(b, "&quot;", 6); break;
        default:
            if ((unsigned char)*text >= 32) /* control characters are not XML */
                image_bytes_append(b, text, 1);
        }
    }
}

static void find_range(Axis *a, const PlotSeries *series, int count, bool y) {
    a->lo = INFINITY;
    a->hi = -INFINITY;
    for (int s = 0; s < count; s++) {
        for (int i = 0; i < series[s].count; i++) {
            double u = to_unit(a, y ? series[s].y[i] : series[s].x[i]);
            if (isfinite(u)) {
                a->lo = fmin(a->lo, u);
                a->hi = fmax(a->hi, u);
            }
        }
    }
    if (!(a->lo <= a->hi)) { /* nothing to show still deserves axes */
        a->lo = 0;
        a->hi = 1;
    }
    double span = a->hi - a->lo;
    if (span <= 1e-12 * fmax(fabs(a->hi), 1e-300)) {
        double pad = a->log ? 0.5 : (a->hi != 0 ? fabs(a->hi) * 0.5 : 0.5);
        a->lo -= pad;
        a->hi += pad;
        span = a->hi - a->lo;
    }
    a->lo -= span * 0.04;
    a->hi += span * 0.04;
}

/* Of few decades 1, 2 and 5 of each: powers of ten alone might leave a curve with one number beside it. */
static void make_ticks_within_decades(Axis *a) {
    static const double parts[] = {1, 2, 5};
    for (int d = (int)floor(a->lo); d <= (int)floor(a->hi); d++) {
        for (int i = 0; i < 3 && a->tick_count < MAX_TICKS; i++) {
            double tick = d + log10(parts[i]);
            if (tick >= a->lo && tick <= a->hi) a->ticks[a->tick_count++] = tick;
        }
    }
}

static void make_ticks(Axis *a, int wanted) {
    a->tick_count = 0;
    if (a->log && a->hi - a->lo >= 2.5) {
        int first = (int)ceil(a->lo), last = (int)floor(a->hi);
        a->decade_step = (last - first) / wanted + 1;
        for (int d = first; d <= last && a->tick_count < MAX_TICKS; d++)
            if (((d % a->decade_step) + a->decade_step) % a->decade_step == 0) a->ticks[a->tick_count++] = d;
        return;
    }
    a->decade_step = 0;
    if (a->log && a->hi - a->lo >= 0.999) {
        make_ticks_within_decades(a);
        return;
    }
    double lo = a->log ? pow(10, a->lo) : a->lo, hi = a->log ? pow(10, a->hi) : a->hi;
    double rough = (hi - lo) / wanted, power = pow(10, floor(log10(rough))), step = 10 * power;
    static const double nice[] = {1, 2, 2.5, 5};
    for (int i = 3; i >= 0; i--) step = rough <= nice[i] * power ? nice[i] * power : step;
    for (double k = ceil(lo / step - 1e-9); k * step <= hi + step * 1e-9 && a->tick_count < MAX_TICKS; k++) {
        double v = fabs(k) < 0.5 ? 0 : k * step;
        a->ticks[a->tick_count++] = a->log ? log10(v) : v;
    }
}

static void tick_label(Bytes *b, const Axis *a, double tick) {
    if (a->decade_step) {
        int e = (int)lrint(tick);
        if (e >= -2 && e <= 3) {
            image_bytes_printf(b, "%g", pow(10, e));
        } else {
            image_bytes_printf(b, "10<tspan dy=\"-5\" font-size=\"9\">%s%d</tspan>", e < 0 ? "\xe2\x88\x92" : "",
                               abs(e));
        }
        return;
    }
    image_bytes_printf(b, "%.6g", a->log ? pow(10, tick) : tick);
}

static void draw_x_axis(Bytes *b, const Axis *x, const Axis *y, const char *label) {
    for (int i = 0; i < x->tick_count; i++) {
        double px = to_pixel(x, x->ticks[i]);
        image_bytes_printf(b, "<line class=\"g\" x1=\"%.1f\" y1=\"%.1f\" x2=\"%.1f\" y2=\"%.1f\"/>\n", px, y->to, px,
                           y->from);
        image_bytes_printf(b, "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"middle\">", px, y->from + 18);
        tick_label(b, x, x->ticks[i]);
        image_bytes_printf(b, "</text>\n");
    }
    if (label) {
        image_bytes_printf(b, "<text class=\"l\" x=\"%.1f\" y=\"%.1f\" text-anchor=\"middle\">", (x->from + x->to) / 2,
                           y->from + 40);
        escape(b, label);
        image_bytes_printf(b, "</text>\n");
    }
}

static void draw_y_axis(Bytes *b, const Axis *x, const Axis *y, const char *label) {
    for (int i = 0; i < y->tick_count; i++) {
        double py = to_pixel(y, y->ticks[i]);
        image_bytes_printf(b, "<line class=\"g\" x1=\"%.1f\" y1=\"%.1f\" x2=\"%.1f\" y2=\"%.1f\"/>\n", x->from, py,
                           x->to, py);
        image_bytes_printf(b, "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"end\">", x->from - 8, py + 4);
        tick_label(b, y, y->ticks[i]);
        image_bytes_printf(b, "</text>\n");
    }
    if (label) {
        double py = (y->from + y->to) / 2;
        image_bytes_printf(b,
                           "<text class=\"l\" x=\"18\" y=\"%.1f\" text-anchor=\"middle\" "
                           "transform=\"rotate(-90 18 %.1f)\">",
                           py, py);
        escape(b, label);
        image_bytes_printf(b, "</text>\n");
    }
}

static void draw_errors(Bytes *b, const PlotSeries *s, const Axis *x, const Axis *y, const char *colour) {
    for (int i = 0; s->error && i < s->count; i++) {
        double ux = to_unit(x, s->x[i]), lo = to_unit(y, s->y[i] - s->error[i]), hi = to_unit(y, s->y[i] + s->error[i]);
        if (!isfinite(ux) || !isfinite(hi) || !isfinite(to_unit(y, s->y[i]))) continue;
        lo = isfinite(lo) ? fmax(lo, y->lo) : y->lo; /* a bar that reaches zero leaves a log plot at its floor */
        image_bytes_printf(b,
                           "<line x1=\"%.2f\" y1=\"%.2f\" x2=\"%.2f\" y2=\"%.2f\" stroke=\"%s\" "
                           "stroke-opacity=\"0.5\"/>\n",
                           to_pixel(x, ux), to_pixel(y, lo), to_pixel(x, ux), to_pixel(y, fmin(hi, y->hi)), colour);
    }
}

static void draw_series(Bytes *b, const PlotSeries *s, const Axis *x, const Axis *y, const char *colour) {
    bool open = false;
    image_bytes_printf(b, "<path fill=\"none\" stroke=\"%s\" stroke-width=\"%s\"%s d=\"", colour,
                       s->dashed ? "1.2" : "2", s->dashed ? " stroke-dasharray=\"6 4\"" : "");
    for (int i = 0; i < s->count; i++) {
        double ux = to_unit(x, s->x[i]), uy = to_unit(y, s->y[i]);
        if (isfinite(ux) && isfinite(uy)) {
            image_bytes_printf(b, "%s%.2f %.2f", open ? "L" : "M", to_pixel(x, ux), to_pixel(y, uy));
            open = true;
        } else {
            open = false;
        }
    }
    image_bytes_printf(b, "\"/>\n");
    for (int i = 0; !s->dashed && s->count <= 60 && i < s->count; i++) { /* markers only while they can be told apart */
        double ux = to_unit(x, s->x[i]), uy = to_unit(y, s->y[i]);
        if (isfinite(ux) && isfinite(uy)) {
            image_bytes_printf(b, "<circle cx=\"%.2f\" cy=\"%.2f\" r=\"3.2\" fill=\"%s\"/>\n", to_pixel(x, ux),
                               to_pixel(y, uy), colour);
        }
    }
}

static void draw_legend(Bytes *b, const PlotSeries *series, int count, double left, double top) {
    for (int s = 0; s < count; s++) {
        const char *colour = palette[s % 8];
        double py = top + 10 + s * 20;
        image_bytes_printf(b,
                           "<line x1=\"%.1f\" y1=\"%.1f\" x2=\"%.1f\" y2=\"%.1f\" stroke=\"%s\" "
                           "stroke-width=\"2\"%s/>\n",
                           left, py, left + 22, py, colour, series[s].dashed ? " stroke-dasharray=\"6 4\"" : "");
        if (!series[s].dashed)
            image_bytes_printf(b, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"3.2\" fill=\"%s\"/>\n", left + 11, py, colour);
        image_bytes_printf(b, "<text x=\"%.1f\" y=\"%.1f\">", left + 28, py + 4);
        escape(b, series[s].name ? series[s].name : "");
        image_bytes_printf(b, "</text>\n");
    }
}

static void draw_plot(Bytes *b, const PlotOptions *opt, const PlotSeries *series, int count) {
    int width = opt->width > 0 ? opt->width : 760, height = opt->height > 0 ? opt->height : 480;
    size_t longest = 0;
    for (int s = 0; s < count; s++) {
        size_t n = series[s].name ? strlen(series[s].name) : 0;
        longest = n > longest ? n : longest;
    }
    double legend = count > 1 && longest ? 48 + 6.6 * (double)(longest > 30 ? 30 : longest) : 12;
    Axis x = {.log = opt->log_x, .from = 76, .to = width - legend - 12};
    Axis y = {.log = opt->log_y, .from = height - 54, .to = opt->title ? 44 : 20};
    x.to = x.to < x.from + 60 ? x.from + 60 : x.to;
    y.to = y.to > y.from - 40 ? y.from - 40 : y.to;
    find_range(&x, series, count, false);
    find_range(&y, series, count, true);
    make_ticks(&x, (int)((x.to - x.from) / 80) + 1);
    make_ticks(&y, (int)((y.from - y.to) / 45) + 1);
    image_bytes_printf(b,
                       "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%d\" height=\"%d\" viewBox=\"0 "
                       "0 %d %d\">\n"
                       "<style>text{font:12px system-ui,-apple-system,'Segoe "
                       "UI',sans-serif;fill:#333}.l{font-size:13px}"
                       ".t{font-size:15px;font-weight:600;fill:#111}.g{stroke:#e4e4e4}</style>\n"
                       "<rect width=\"%d\" height=\"%d\" fill=\"#fff\"/>\n",
                       width, height, width, height, width, height);
    if (opt->title) {
        image_bytes_printf(b, "<title>");
        escape(b, opt->title);
        image_bytes_printf(b, "</title>\n<text class=\"t\" x=\"%.1f\" y=\"26\" text-anchor=\"middle\">",
                           (x.from + x.to) / 2);
        escape(b, opt->title);
        image_bytes_printf(b, "</text>\n");
    }
    draw_x_axis(b, &x, &y, opt->x_label);
    draw_y_axis(b, &x, &y, opt->y_label);
    image_bytes_printf(b,
                       "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\" fill=\"none\" "
                       "stroke=\"#888\"/>\n",
                       x.from, y.to, x.to - x.from, y.from - y.to);
    for (int s = 0; s < count; s++) {
        draw_errors(b, &series[s], &x, &y, palette[s % 8]);
        draw_series(b, &series[s], &x, &y, palette[s % 8]);
    }
    if (count > 1 && longest) draw_legend(b, series, count, x.to + 14, y.to);
    image_bytes_printf(b, "</svg>\n");
}

char *plot_svg(const PlotOptions *opt, const PlotSeries *series, int count, SltError *err) {
    Bytes b = {0};
    locale_t plain = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    if (!plain) {
        status_fail(err, SLT_LIMIT, "out of memory for a plot");
        return NULL;
    }
    locale_t before = uselocale(plain); /* of this thread only: a comma in a number would break the SVG */
    draw_plot(&b, opt, series, count);
    uselocale(before);
    freelocale(plain);
    image_bytes_append(&b, "", 1);
    if (b.failed) {
        image_bytes_free(&b);
        status_fail(err, SLT_LIMIT, "out of memory for a plot");
        return NULL;
    }
    return (char *)b.data;
}
