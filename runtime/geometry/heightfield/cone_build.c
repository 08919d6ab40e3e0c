/* Precomputing safety shapes: by rings of maxima (fast, all terrain limits), or triangle by triangle under a quadtree
 * of maxima. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cone.h"

/* The rays of class 0 to 3 run within 45 degrees of +x, -x, +y or -y; those of class 4 anywhere. A ray from cell (i, j)
 * that has come u along its main axis lies in [i - u, i + 1 + u] x [j - u, j + 1 + u], and (class 0) not before i. */
enum { ALL = 4 };

typedef struct Builder {
    float *height; /* rows upwards; NaN, which blocks nothing, is -FLT_MAX */
    int32_t w, h;
    const FieldConeOptions *o;
    const void *heights; /* the caller's, rows downwards */
    bool f64;
    double touch; /* a plane counts where it passes a surface by more than this, which is less than the distance from
                     the surface at which steps are made (cone.inc.h) */
    float *level[32]; /* level[0][j * lw + i]: the maximum over cell (i, j); above it over blocks of 2 x 2 */
    int32_t levels, lw[32], lh[32];
} Builder;

static float at(const Builder *b, int32_t i, int32_t j) { return b->height[(size_t)j * (size_t)b->w + (size_t)i]; }
static double exactly(const Builder *b, int32_t i, int32_t j) {
    size_t at_data = (size_t)(b->h - 1 - j) * (size_t)b->w + (size_t)i;
    return b->f64 ? ((const double *)b->heights)[at_data] : (double)((const float *)b->heights)[at_data];
}
static inline float larger(float a, float b) { /* as the instruction has it, so loops vectorise; nothing here is NaN */
    return b > a ? b : a;
}
static int32_t least(int32_t a, int32_t b) { return a < b ? a : b; }
static int32_t most(int32_t a, int32_t b) { return a > b ? a : b; }

/* ---- rings: maxima over windows, from maxima over squares of 2^k that overlap. A window that the border cuts may be
 * taken larger than it is: that only costs speed. */

typedef struct Squares {
    float *max; /* [j][i]: over [i, i + side) x [j, j + side), cut by the border; j upwards */
    int32_t w, h, side;
} Squares;

static void double_side(Squares *s) {
    int32_t side = s->side;
    for (int32_t j = 0; j < s->h; j++) {
        float *row = s->max + (size_t)j * (size_t)s->w, *up = j + side < s->h ? row + (size_t)side * (size_t)s->w : row;
        for (int32_t i = 0; i < s->w; i++) row[i] = larger(row[i], up[i]);
        for (int32_t i = 0; i + side < s->w; i++) row[i] = larger(row[i], row[i + side]);
    }
    s->side = 2 * side;
}

/* line[i] = the maximum over [i + x0, i + x1] x [y0, y1] for all cells i of a row; x1 - x0 + 1 and y1 - y0 + 1 are at
 * least the side. */
static void window_maxima(const Squares *s, int32_t x0, int32_t x1, int32_t y0, int32_t y1, float *column,
                          float *line) {
    int32_t w = s->w, side = s->side, last = most(least(y1, s->h - 1) - side + 1, 0), first = least(most(y0, 0), last);
    memcpy(column, s->max + (size_t)first * (size_t)w, sizeof *column * (size_t)w);
    for (int32_t y = first; y < last;) {
        y = least(y + side, last);
        const float *row = s->max + (size_t)y * (size_t)w;
        for (int32_t i = 0; i < w; i++) column[i] = larger(column[i], row[i]);
    }
    for (int32_t i = 0; i < w - 1; i++) line[i] = -FLT_MAX;
    for (int32_t x = x0;; x = least(x + side, x1 - side + 1)) {
        int32_t from = most(-x, 0), to = least(w - 1, w - x);
        for (int32_t i = 0; i < least(from, w - 1); i++) line[i] = larger(line[i], column[0]);
        for (int32_t i = from; i < to; i++) line[i] = larger(line[i], column[i + x]);
        if (x >= x1 - side + 1) break;
    }
}

/* The distance of the ring after that at distance u: 1, 2, 3, 4, then a quarter more each time. */
static int32_t next_ring(int32_t u) { return u + most(1, u / 4); }

static bool build_rings(float (*shapes)[2], const Builder *b, int32_t k) {
    int32_t w = b->w, h = b->h, reach = most(w, h);
    size_t count = (size_t)w * (size_t)h;
    Squares s = {.max = malloc(sizeof *s.max * count), .w = w, .h = h, .side = 1};
    float *column = malloc(sizeof *column * (size_t)w), *line = malloc(sizeof *line * (size_t)w);
    bool ok = s.max && column && line;
    if (ok) memcpy(s.max, b->height, sizeof *s.max * count);
    for (int32_t near = 0, far = 1; ok && near < reach; near = far, far = next_ring(far)) {
        while (2 * s.side <= least(far + 2, reach)) double_side(&s);
        for (int32_t j = 0; j + 1 < h; j++) {
            window_maxima(&s, k == 0 ? 0 : -far, k == 1 ? 1 : 1 + far, k == 2 ? j : j - far,
                          k == 3 ? j + 1 : j + 1 + far, column, line);
            float(*shape)[2] = shapes + (size_t)j * (size_t)w, scale = 1.0f / (float)most(near, 1);
            if (near == 0)
                for (int32_t i = 0; i + 1 < w; i++) shape[i][0] = line[i], shape[i][1] = 0.0f;
            else
                for (int32_t i = 0; i + 1 < w; i++) shape[i][1] = larger(shape[i][1], (line[i] - shape[i][0]) * scale);
        }
    }
    free(s.max), free(column), free(line);
    return ok;
}

/* ---- triangles, nearest first, under maxima over blocks */

static bool build_levels(Builder *b) {
    b->lw[0] = b->w - 1, b->lh[0] = b->h - 1;
    for (int32_t l = 0;; l++) {
        int32_t w = b->lw[l], h = b->lh[l];
        float *m = b->level[l] = malloc(sizeof *m * (size_t)w * (size_t)h);
        b->levels = l + 1;
        if (!m) return false;
        for (int32_t j = 0; j < h; j++)
            for (int32_t i = 0; i < w; i++) {
                if (l == 0) {
                    m[(size_t)j * (size_t)w + (size_t)i] =
                        larger(larger(at(b, i, j), at(b, i + 1, j)), larger(at(b, i, j + 1), at(b, i + 1, j + 1)));
                    continue;
                }
                const float *fine = b->level[l - 1];
                int32_t fw = b->lw[l - 1], i0 = 2 * i, j0 = 2 * j, i1 = least(i0 + 1, fw - 1),
                        j1 = least(j0 + 1, b->lh[l - 1] - 1);
                m[(size_t)j * (size_t)w + (size_t)i] = larger(
                    larger(fine[(size_t)j0 * (size_t)fw + (size_t)i0], fine[(size_t)j0 * (size_t)fw + (size_t)i1]),
                    larger(fine[(size_t)j1 * (size_t)fw + (size_t)i0], fine[(size_t)j1 * (size_t)fw + (size_t)i1]));
            }
        if (w == 1 && h == 1) return true;
        b->lw[l + 1] = (w + 1) / 2, b->lh[l + 1] = (h + 1) / 2;
    }
}

/* The way along its main axis that a ray of class k needs at least from cell (i, j) to the block of cells [x0, x1) x
 * [y0, y1); -1: no such ray gets there. */
static int32_t way(int32_t k, int32_t i, int32_t j, int32_t x0, int32_t y0, int32_t x1, int32_t y1) {
    int32_t gx = most(most(x0 - i - 1, i - x1), 0), gy = most(most(y0 - j - 1, j - y1), 0);
    switch (k) {
    case 0: return x1 <= i || gy > x1 - i ? -1 : most(gx, gy);
    case 1: return x0 > i || gy > i + 1 - x0 ? -1 : most(gx, gy);
    case 2: return y1 <= j || gx > y1 - j ? -1 : most(gx, gy);
    case 3: return y0 > j || gx > j + 1 - y0 ? -1 : most(gx, gy);
    default: return most(gx, gy);
    }
}

/* Can a ray for which the shapes are made start above cell (i, j) and hit the back of the triangle? The triangle's
 * plane must pass above the surface of the cell somewhere, and along some direction from the cell to the triangle be no
 * steeper than the bound. Only a start that is clearly above (cone.inc.h: by 2^-19, in doubles 2^-30, of the heights'
 * size) makes a step, so a plane that merely touches the surface does not count: else a cell would limit itself. */
static bool limiting(const Builder *b, int32_t i, int32_t j, int32_t x, int32_t y, int32_t upper) {
    double h10 = exactly(b, x + 1, y), h01 = exactly(b, x, y + 1),
           corner = upper ? exactly(b, x + 1, y + 1) : exactly(b, x, y);
    double dx = upper ? corner - h01 : h10 - corner, dy = upper ? corner - h10 : h01 - corner;
    double plane = corner + dx * (i - x - upper) + dy * (j - y - upper) - b->touch;
    if (plane <= exactly(b, i, j) && plane + dx <= exactly(b, i + 1, j) && plane + dy <= exactly(b, i, j + 1) &&
        plane + dx + dy <= exactly(b, i + 1, j + 1))
        return false;
    float gx = (float)dx, gy = (float)dy;
    if (!b->o->bounded) return true;
    /* directions: from [i, i+1] x [j, j+1] to [x, x+1] x [y, y+1]; the least slope along any */
    float vx0 = (float)(x - i - 1), vx1 = (float)(x - i + 1), vy0 = (float)(y - j - 1), vy1 = (float)(y - j + 1);
    float least_rise = larger(-gx * vx0, -gx * vx1) + larger(-gy * vy0, -gy * vy1),
          nx = larger(larger(vx0, -vx1), 0.0f), ny = larger(larger(vy0, -vy1), 0.0f);
    float fx = larger(fabsf(vx0), fabsf(vx1)), fy = larger(fabsf(vy0), fabsf(vy1));
    float slope =
        -least_rise /
        sqrtf(least_rise > 0.0f ? nx * nx + ny * ny : fx * fx + fy * fy); /* 1/0: not known, so the triangle counts */
    return !(slope > b->o->max_slope + 1e-5f * (1.0f + fabsf(slope)));
}

/* A block of cells on the stack of a search. */
typedef struct Block {
    int32_t level, x, y;
} Block;

/* The cone beyond the cylinder: from `base` at the radius, the least slope that leaves all that counts below. Blocks
 * that cannot raise it are passed over, so near ones go first. */
static float cone_slope(const Builder *b, int32_t k, int32_t i, int32_t j, int32_t radius, float base) {
    Block stack[4 * 32];
    int32_t size = 0;
    float slope = 0.0f;
    stack[size++] = (Block){b->levels - 1, 0, 0};
    while (size) {
        Block at_block = stack[--size];
        int32_t l = at_block.level, x0 = at_block.x << l, y0 = at_block.y << l, x1 = least(x0 + (1 << l), b->w - 1),
                y1 = least(y0 + (1 << l), b->h - 1);
        int32_t d = way(k, i, j, x0, y0, x1, y1);
        if (d < 0 || (l == 0 && d <= radius)) continue;
        float over = b->level[l][(size_t)at_block.y * (size_t)b->lw[l] + (size_t)at_block.x] - base,
              beyond = (float)most(d - radius, 1);
        if (!(over > slope * beyond)) continue;
        if (l == 0) {
            for (int32_t up = 0; up < 2; up++) {
                if (b->o->exact && !limiting(b, i, j, x0, y0, up)) continue;
                float top =
                    larger(up ? at(b, x0 + 1, y0 + 1) : at(b, x0, y0), larger(at(b, x0 + 1, y0), at(b, x0, y0 + 1)));
                slope = larger(slope, (top - base) / beyond);
            }
            continue;
        }
        /* the child on the cell's side is pushed last, so that it is looked at first */
        int32_t cx = 2 * at_block.x, cy = 2 * at_block.y, nx = i >= (cx + 1) << (l - 1), ny = j >= (cy + 1) << (l - 1);
        for (int32_t n = 3; n >= 0; n--) {
            int32_t x = cx + (nx ^ (n & 1)), y = cy + (ny ^ (n >> 1));
            if (x < b->lw[l - 1] && y < b->lh[l - 1]) stack[size++] = (Block){l - 1, x, y};
        }
    }
    return slope;
}

/* Radius and cone of one cell, from triangles. */
static void build_cell(float shape[2], uint8_t *radius_out, const Builder *b, int32_t k, int32_t i, int32_t j) {
    int32_t radius = 0, reach = least(most(b->w, b->h), FIELD_CONE_MAX_RADIUS);
    float limits = -FLT_MAX, all = -FLT_MAX; /* the highest at distance `radius`: of what limits, of everything */
    for (;; radius++) {
        bool found = false;
        all = -FLT_MAX;
        int32_t x0 = most(i - radius - 1, 0), x1 = least(i + radius + 2, b->w - 1), y0 = most(j - radius - 1, 0),
                y1 = least(j + radius + 2, b->h - 1);
        for (int32_t y = y0; y < y1; y++)
            for (int32_t x = x0; x < x1; x++) {
                if (radius > 0 && abs(y - j) <= radius && abs(x - i) <= radius) { /* within the ring: to its far side */
                    x = i + radius;
                    continue;
                }
                if (way(k, i, j, x, y, x + 1, y + 1) != radius) continue;
                for (int32_t up = 0; up < 2; up++) {
                    float top =
                        larger(up ? at(b, x + 1, y + 1) : at(b, x, y), larger(at(b, x + 1, y), at(b, x, y + 1)));
                    all = larger(all, top);
                    if (limiting(b, i, j, x, y, up)) limits = larger(limits, top), found = true;
                }
            }
        if (found || radius == reach) break;
    }
    *radius_out = (uint8_t)radius;
    if (radius == 0 && !b->o->exact) return; /* the cone made from rings stays */
    float base = b->o->exact && limits > -FLT_MAX ? limits : all;
    float slope = cone_slope(b, k, i, j, radius, base);
    shape[1] = slope, shape[0] = base - slope * (float)radius;
}

/* ---- one number a shape, so that a query gathers once: the base in 65535 steps of the range of heights, rounded up,
 * below the upper half of the slope's float, rounded up */
static uint32_t pack(const FieldCones *c, const float shape[2]) {
    double steps = c->step > 0.0f ? ceil(((double)shape[0] - c->lowest) / c->step) : 0.0,
           slope = shape[1] * (1.0 + 1e-6) + 1e-30;
    uint32_t base = steps < 0.0 ? 0 : steps > 65535.0 ? 65535 : (uint32_t)steps, bits;
    if (steps > 65535.5) slope = FLT_MAX; /* above all finite heights: no step from here */
    float s = slope < 3e38 ? (float)slope : 3e38f;
    memcpy(&bits, &s, sizeof bits);
    bits = bits + 0xffff < 0x7f7fffff ? bits + 0xffff : 0x7f7fffff;
    return (bits & 0xffff0000u) | base;
}

bool cone_build(FieldCones *c, const void *heights, bool f64, uint32_t w, uint32_t h, const FieldConeOptions *options) {
    size_t count = (size_t)w * h;
    *c = (FieldCones){.w = w, .h = h, .classes = options->directional ? 4 : 1, .options = *options};
    Builder b = {.height = malloc(sizeof *b.height * count),
                 .w = (int32_t)w,
                 .h = (int32_t)h,
                 .o = options,
                 .heights = heights,
                 .f64 = f64};
    float(*shape)[2] = calloc(count, sizeof *shape);
    bool finite = true, ok = b.height && shape;
    c->packed = calloc(count * c->classes, sizeof *c->packed);
    ok = ok && c->packed;
    double low = INFINITY, high = -INFINITY;
    for (size_t k = 0; ok && k < count; k++) {
        size_t at_data = (h - 1 - k / w) * w + k % w;
        double v = f64 ? ((const double *)heights)[at_data] : ((const float *)heights)[at_data];
        float up = (float)v;
        if (up < v) up = nextafterf(up, INFINITY);
        b.height[k] = up;
        if (isfinite(up)) low = fmin(low, up), high = fmax(high, up);
        else finite = false;
    }
    if (!(low <= high)) low = high = 0.0;
    c->magnitude = fmax(fabs(low), fabs(high));
    b.touch = c->magnitude * 0x1p-32;
    for (size_t k = 0; ok && k < count; k++) /* NaN blocks nothing */
        if (!isfinite(b.height[k])) b.height[k] = b.height[k] > 0.0f ? FLT_MAX : (float)low;
    c->lowest = (float)low;
    c->step = nextafterf((float)((high - low) / 65535.0), INFINITY);
    /* A surface with holes is not crossed in turn from above and below: no step may pass through it. */
    c->relaxed = finite && (options->exact || options->bounded);
    if (c->relaxed) {
        c->radius = calloc(count * c->classes, 1);
        ok = ok && c->radius && build_levels(&b);
    }
    for (uint32_t k = 0; ok && k < c->classes; k++) {
        int32_t class = c->classes == 4 ? (int32_t)k : ALL;
        if (!c->relaxed || !options->exact) ok = build_rings(shape, &b, class);
        for (size_t n = 0; ok && c->relaxed && n < count; n++) {
            int32_t i = (int32_t)(n % w), j = (int32_t)(n / w);
            if (i + 1 < b.w && j + 1 < b.h) build_cell(shape[n], &c->radius[k * count + n], &b, class, i, j);
        }
        for (size_t n = 0; ok && n < count; n++) c->packed[k * count + n] = pack(c, shape[n]);
    }
    for (int32_t l = 0; l < b.levels; l++) free(b.level[l]);
    free(b.height), free(shape);
    if (!ok) cone_free(c);
    return ok;
}
void cone_free(FieldCones *c) {
    free(c->packed), free(c->radius);
    *c = (FieldCones){0};
}
size_t cone_bytes(const FieldCones *c) {
    return (size_t)c->w * c->h * c->classes * (sizeof *c->packed + (c->radius != NULL));
}
