/* saltus explain --cells OUT.svg: the tree of cells that quadrature cuts the domain into, over the image. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cli/explain.h"
#include "runtime/base/text.h"
#include "runtime/quadrature/cells.h"

enum {
    PICTURE = 720,      /* pixels along the longer side of the domain */
    UNDERLAY = 360,     /* those of the image below */
    MOST_POINTS = 4000, /* more would hide the curves that they lie on */
    LEGEND = 26,        /* height of a line of text */
    GAUSS = 4,
    BUDGET = 1 << 21 /* evaluations: a program that nothing can be proven of must end too */
};
#define HIDDEN 1e-5   /* jumps below this part of f are rounding */
#define LEAST 0x1p-10 /* side of the least cell, in parts of the domain: less than a pixel of the picture */

typedef struct DrawnCell {
    Box box;
    CellState state;
} DrawnCell;

typedef struct Drawn {
    DrawnCell *cell;
    size_t ncells, cells_cap;
    double (*point)[2];
    size_t npoints, points_cap;
    uint32_t channels;
    bool failed; /* memory ran out */
} Drawn;

static const struct {
    const char *name, *fill, *line;
} looks[] = {[CELL_SETTLED] = {"settled", "#3d7fc4", "#2a5c94"},
             [CELL_CURVED] = {"curve", "#f2a33a", "#a86a10"},
             [CELL_LEFT] = {"left", "#c2257a", "#7d1450"}};

static bool grow(void **list, size_t size, size_t n, size_t *cap) {
    if (n < *cap) return true;
    size_t more = *cap ? 2 * *cap : 1024;
    void *p = realloc(*list, more * size);
    if (!p) return false;
    *list = p, *cap = more;
    return true;
}

static void take_cell(void *user, const Box *cell, CellState state) {
    Drawn *d = user;
    d->failed |= !grow((void **)&d->cell, sizeof *d->cell, d->ncells, &d->cells_cap);
    if (!d->failed) d->cell[d->ncells++] = (DrawnCell){*cell, state};
}

static void take_curve(void *user, Crossing *c, uint32_t n) {
    Drawn *d = user;
    for (uint32_t i = 0; i < n && !d->failed; i++) {
        bool moves = false; /* what is hidden jumps by no more than the two adjacent points differ */
        for (uint32_t k = 0; k < d->channels; k++) moves |= fabs(c[i].jump[k]) > HIDDEN * fabs(c[i].before[k]);
        if (c[i].cls != CELL_FINE || !moves) continue;
        d->failed |= !grow((void **)&d->point, sizeof *d->point, d->npoints, &d->points_cap);
        if (!d->failed) memcpy(d->point[d->npoints++], c[i].x, sizeof *d->point);
    }
}

static void take_left(void *user, const Box *cell, const double *bounds, double apart) {
    (void)user, (void)cell, (void)bounds, (void)apart;
}

static SltStatus cut(SltProgram *p, Drawn *d, CellCounts *counts, SltError *err) {
    static const bool needs[K_KINDS] = {[K_BOUNDS] = true, [K_EDGE] = true,   [K_EDGE_BOUNDS] = true,
                                        [K_SIDES] = true,  [K_REGION] = true, [K_VALUE] = true};
    SltStatus status = api_kernels(p, needs, err);
    if (status != SLT_OK) return status;
    bool edges = p->fn[K_EDGE] && p->fn[K_EDGE_BOUNDS];
    if (!p->fn[K_BOUNDS] || (p->scene.nedges && !edges))
        return status_fail(err, SLT_USAGE, "the program is too large for bounds, so there are no cells");
    Batch batch;
    Box domain = {0};
    for (uint32_t a = 0; a < p->prog->dim; a++) {
        domain.lo[a] = p->prog->lo[a];
        domain.hi[a] = domain.end[a] = p->prog->hi[a];
    }
    CellSink sink = {.curve = take_curve, .left = take_left, .cell = take_cell, .user = d};
    CellOptions o = {.curves = p->fn[K_SIDES] != NULL, /* without: no boundary moves */
                     .gauss = GAUSS,
                     .fixed = true,
                     .least = LEAST,
                     .budget = BUDGET};
    Cells *cells = batch_init(&batch, &p->scene, NULL) ? cells_new(&batch, domain.lo, domain.hi) : NULL;
    bool done = cells && cells_run(cells, &domain, &o, &sink, counts) && !d->failed;
    cells_free(cells);
    batch_free(&batch);
    return done ? SLT_OK : status_fail(err, SLT_LIMIT, "out of memory for the cells");
}

/* ---- the picture. x and y of the domain become pixels; y goes up there and down here. */
typedef struct Frame {
    double x0, y1, scale, width, height;
} Frame;

static Frame make_frame(const Program *g) {
    double w = g->hi[0] - g->lo[0], h = g->dim > 1 ? g->hi[1] - g->lo[1] : w / 8;
    double scale = PICTURE / (w > h ? w : h);
    return (Frame){g->lo[0], g->dim > 1 ? g->hi[1] : h, scale, w * scale, h * scale};
}

static void write_base64(FILE *out, const uint8_t *bytes, size_t n) {
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    for (size_t i = 0; i < n; i += 3) {
        uint32_t v = (uint32_t)bytes[i] << 16;
        if (i + 1 < n) v |= (uint32_t)bytes[i + 1] << 8;
        if (i + 2 < n) v |= bytes[i + 2];
        for (size_t k = 0; k < 4; k++) fputc(i + k <= n ? digits[v >> (18 - 6 * k) & 63] : '=', out);
    }
}

/* What the shader draws, pale, below the cells. */
static SltStatus write_underlay(FILE *out, SltProgram *p, const Frame *f, SltError *err) {
    SltJob job = SLT_JOB_INIT;
    Image im, colour;
    uint8_t *bytes;
    size_t size;
    job.size[0] = (uint32_t)fmax(1, ceil(UNDERLAY * f->width / PICTURE));
    job.size[1] = p->prog->dim > 1 ? (uint32_t)fmax(1, ceil(UNDERLAY * f->height / PICTURE)) : 1;
    job.estimator = SLT_EST_LATTICE;
    SltStatus status = image_create(&im, (int)job.size[0], (int)job.size[1], (int)slt_channels(p), err);
    if (status != SLT_OK) return status;
    status = slt_render(p, &job, im.data, NULL, err);
    if (status == SLT_OK) status = image_convert_channels(&im, 3, &colour, err);
    image_free(&im);
    if (status != SLT_OK) return status;
    status = image_encode("image.png", &colour, NULL, &bytes, &size, err);
    image_free(&colour);
    if (status != SLT_OK) return status;
    fprintf(
        out,
        "<image width=\"%.3f\" height=\"%.3f\" preserveAspectRatio=\"none\" opacity=\"0.55\" href=\"data:image/png;base64,",
        f->width, f->height);
    write_base64(out, bytes, size);
    fputs("\"/>\n", out);
    free(bytes);
    return SLT_OK;
}

static void write_cells(FILE *out, const Drawn *d, const Frame *f, uint32_t dim, CellState state) {
    fprintf(out, "<path fill=\"%s\" fill-opacity=\"%s\" stroke=\"%s\" stroke-width=\"0.5\" stroke-opacity=\"0.7\" d=\"",
            looks[state].fill, state == CELL_SETTLED ? "0.08" : "0.6", looks[state].line);
    for (size_t i = 0; i < d->ncells; i++) {
        const Box *b = &d->cell[i].box;
        if (d->cell[i].state != state) continue;
        double x = (b->lo[0] - f->x0) * f->scale, w = (b->end[0] - b->lo[0]) * f->scale;
        double y = dim > 1 ? (f->y1 - b->end[1]) * f->scale : 0,
               h = dim > 1 ? (b->end[1] - b->lo[1]) * f->scale : f->height;
        fprintf(out, "M%.2f %.2fh%.2fv%.2fh%.2fz", x, y, w, h, -w);
    }
    fputs("\"/>\n", out);
}

static void write_points(FILE *out, const Drawn *d, const Frame *f, uint32_t dim) {
    if (d->npoints > MOST_POINTS) return;
    fputs("<g fill=\"#1c1c1c\">", out);
    for (size_t i = 0; i < d->npoints; i++)
        fprintf(out, "<circle cx=\"%.2f\" cy=\"%.2f\" r=\"1.1\"/>", (d->point[i][0] - f->x0) * f->scale,
                dim > 1 ? (f->y1 - d->point[i][1]) * f->scale : f->height / 2);
    fputs("</g>\n", out);
}

static void write_legend(FILE *out, const Drawn *d, const CellCounts *n, const Frame *f) {
    const double share[] = {n->settled, n->curved, n->left};
    double y = f->height + LEGEND;
    for (int s = CELL_SETTLED; s <= CELL_LEFT; s++) {
        size_t count = 0;
        for (size_t i = 0; i < d->ncells; i++) count += (int)d->cell[i].state == s;
        double x = f->width * s / 3;
        fprintf(
            out,
            "<rect x=\"%.1f\" y=\"%.1f\" width=\"13\" height=\"13\" fill=\"%s\" fill-opacity=\"%s\" stroke=\"%s\"/>",
            x + 1, y - 11, looks[s].fill, s == CELL_SETTLED ? "0.15" : "0.6", looks[s].line);
        fprintf(out, "<text x=\"%.1f\" y=\"%.1f\">%s %.4g %%, %zu cells</text>\n", x + 20, y, looks[s].name,
                100 * share[s], count);
    }
}

/* The picture as text, malloc'd. */
static SltStatus draw(SltProgram *p, const Drawn *d, const CellCounts *counts, char **svg, size_t *size,
                      SltError *err) {
    Text made;
    FILE *out = text_open(&made);
    if (!out) return status_fail(err, SLT_LIMIT, "out of memory");
    Frame f = make_frame(p->prog);
    fprintf(
        out,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"-8 -8 %.1f %.1f\" width=\"%.0f\" font-family=\"sans-serif\" font-size=\"14\">\n",
        f.width + 16, f.height + LEGEND + 24, f.width + 16);
    fprintf(out, "<rect x=\"-8\" y=\"-8\" width=\"%.1f\" height=\"%.1f\" fill=\"#ffffff\"/>\n", f.width + 16,
            f.height + LEGEND + 24);
    SltStatus status = write_underlay(out, p, &f, err);
    for (int s = CELL_SETTLED; s <= CELL_LEFT; s++) write_cells(out, d, &f, p->prog->dim, (CellState)s);
    write_points(out, d, &f, p->prog->dim);
    write_legend(out, d, counts, &f);
    fputs("</svg>\n", out);
    *svg = text_close(&made);
    *size = made.size;
    if (status == SLT_OK && !*svg) status = status_fail(err, SLT_LIMIT, "out of memory");
    if (status != SLT_OK) free(*svg), *svg = NULL;
    return status;
}

SltStatus explain_draw_cells(SltProgram *p, ExplainedCells *out, SltError *err) {
    *out = (ExplainedCells){0};
    if (p->prog->dim > 2) return status_fail(err, SLT_USAGE, "cells are drawn of domains of one and two dimensions");
    Drawn d = {.channels = p->prog->channels};
    SltStatus status = cut(p, &d, &out->counts, err);
    out->ncells = d.ncells;
    if (status == SLT_OK) status = draw(p, &d, &out->counts, &out->svg, &out->size, err);
    free(d.cell), free(d.point);
    return status;
}

SltStatus explain_cells(const Cli *c, SltProgram *p, SltError *err) {
    ExplainedCells m;
    SltStatus status = explain_draw_cells(p, &m, err);
    if (status == SLT_OK) status = file_write_atomic(c->cells, m.svg, m.size, err);
    if (status == SLT_OK && c->json) {
        fputs("{\"outputs\": [", stdout);
        json_text(stdout, c->cells);
        printf("], \"settled\": %.17g, \"curved\": %.17g, \"left\": %.17g, \"cells\": %zu, \"boxes\": %llu}\n",
               m.counts.settled, m.counts.curved, m.counts.left, m.ncells, (unsigned long long)m.counts.boxes);
    } else if (status == SLT_OK)
        printf("%zu cells: %.4g %% settled, %.4g %% curves, %.4g %% left; %llu boxes, %llu points\n", m.ncells,
               100 * m.counts.settled, 100 * m.counts.curved, 100 * m.counts.left, (unsigned long long)m.counts.boxes,
               (unsigned long long)m.counts.points);
    free(m.svg);
    return status;
}
