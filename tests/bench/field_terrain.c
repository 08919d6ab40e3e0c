/* Terrains of the heightfield benchmark. `dem` is a real elevation model (SALTUS_DATA), exaggerated three times: its
 * middle at 256, above that its largest square upsampled (Catmull-Rom) with octaves of noise below its own grid, so
 * that finer grids have finer detail. `fbm` is a ridged multifractal of height 0.16 n. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "field_bench.h"

enum { DEM_W = 403, DEM_H = 344 };
static const double DEM_CELL = 84.0; /* metres: 3 arc-seconds are 75 m by 93 m there */
static const double EXAGGERATION = 3.0;

static double gradient_noise(double x, double y, uint32_t seed) {
    int32_t i = (int32_t)floor(x), j = (int32_t)floor(y);
    double fx = x - i, fy = y - j, sum = 0.0;
    for (int c = 0; c < 4; c++) {
        uint32_t h =
            (uint32_t)(i + (c & 1)) * 0x9e3779b1u ^ (uint32_t)(j + (c >> 1)) * 0x85ebca6bu ^ seed * 0xc2b2ae35u;
        h ^= h >> 15, h *= 0x2c1b3c6du, h ^= h >> 12, h *= 0x297a2d39u, h ^= h >> 15;
        double a = (double)h * (6.283185307179586 * 0x1p-32), u = fx - (c & 1), v = fy - (c >> 1);
        double wx = 1.0 - fabs(u), wy = 1.0 - fabs(v);
        sum += wx * wx * wx * (wx * (wx * 6.0 - 15.0) + 10.0) * wy * wy * wy * (wy * (wy * 6.0 - 15.0) + 10.0) *
               (cos(a) * u + sin(a) * v);
    }
    return 1.4142135623730951 * sum; /* about -1 to 1 */
}

static float *read_dem(void) {
    const char *folder = getenv("SALTUS_DATA");
    char path[4096];
    snprintf(path, sizeof path, "%s/jacksboro_%dx%d.f32", folder ? folder : ".", DEM_W, DEM_H);
    FILE *f = fopen(path, "rb");
    if (!f) return NULL;
    float *data = malloc(sizeof(float) * DEM_W * DEM_H);
    size_t got = data ? fread(data, sizeof(float), (size_t)DEM_W * DEM_H, f) : 0;
    fclose(f);
    if (got == (size_t)DEM_W * DEM_H) return data;
    free(data);
    return NULL;
}

static double catmull(const double p[4], double f) {
    return p[1] + 0.5 * f *
                      (p[2] - p[0] +
                       f * (2.0 * p[0] - 5.0 * p[1] + 4.0 * p[2] - p[3] + f * (3.0 * (p[1] - p[2]) + p[3] - p[0])));
}

static bool make_dem(Terrain *t) {
    float *dem = read_dem();
    if (!dem) return false;
    uint32_t n = t->n;
    double metre = EXAGGERATION / DEM_CELL;
    if (n <= 256) {
        uint32_t x0 = (DEM_W - n) / 2, y0 = (DEM_H - n) / 2;
        for (uint32_t y = 0; y < n; y++)
            for (uint32_t x = 0; x < n; x++) t->h[y * n + x] = (float)(dem[(y0 + y) * DEM_W + x0 + x] * metre);
        free(dem);
        return true;
    }
    /* The octaves go on from the model's own roughness: how far a sample lies from the mean of its neighbours. */
    double rough = 0.0;
    for (uint32_t y = 1; y + 1 < DEM_H; y++)
        for (uint32_t x = 1; x + 1 < DEM_W; x++) {
            const float *c = dem + y * DEM_W + x;
            double d = (*c - 0.25 * ((double)c[1] + c[-1] + c[DEM_W] + c[-DEM_W])) * metre;
            rough += d * d;
        }
    rough = sqrt(rough / ((DEM_W - 2.0) * (DEM_H - 2.0)));
    uint32_t side = DEM_H - 1, x0 = (DEM_W - side) / 2;
    double step = (side - 1.0) / (n - 1.0);
    for (uint32_t y = 0; y < n; y++)
        for (uint32_t x = 0; x < n; x++) {
            double u = x * step, v = y * step, column[4];
            int32_t i = (int32_t)fmin(floor(u), side - 2.0), j = (int32_t)fmin(floor(v), side - 2.0);
            for (int a = 0; a < 4; a++) {
                double row[4];
                int32_t jj = j + a - 1 < 0 ? 0 : j + a - 1 >= (int32_t)side ? (int32_t)side - 1 : j + a - 1;
                for (int b = 0; b < 4; b++) {
                    int32_t ii = i + b - 1 < 0 ? 0 : i + b - 1 >= (int32_t)side ? (int32_t)side - 1 : i + b - 1;
                    row[b] = dem[jj * DEM_W + (int32_t)x0 + ii] * metre;
                }
                column[a] = catmull(row, u - i);
            }
            double h = catmull(column, v - j);
            uint32_t octave = 0;
            for (double wave = 1.0; wave >= 2.0 * step; wave *= 0.5, octave++)
                h += 2.0 * rough * pow(wave, 0.9) * gradient_noise(u / wave, v / wave, 7 + octave);
            t->h[y * n + x] = (float)(h / step); /* from cells of the model to cells of the grid */
        }
    free(dem);
    return true;
}

static void make_fbm(Terrain *t) {
    uint32_t n = t->n;
    double low = 1e30, high = -1e30, *h = malloc(sizeof *h * n * n);
    for (uint32_t y = 0; y < n; y++)
        for (uint32_t x = 0; x < n; x++) {
            double u = 3.0 * x / (n - 1.0), v = 3.0 * y / (n - 1.0), weight = 1.0, sum = 0.0, gain = 1.0;
            uint32_t octave = 0;
            for (double wave = n / 3.0; wave >= 2.0; wave *= 0.5, octave++) {
                double s = 1.0 - fabs(gradient_noise(u, v, 100 + octave));
                s *= s * weight;
                weight = fmin(1.0, fmax(0.0, 2.0 * s));
                sum += s * gain, gain *= 0.5, u *= 2.0, v *= 2.0;
            }
            h[y * n + x] = sum;
            low = fmin(low, sum), high = fmax(high, sum);
        }
    for (uint32_t k = 0; k < n * n; k++) t->h[k] = (float)((h[k] - low) / (high - low) * 0.16 * n);
    free(h);
}

bool terrain_make(Terrain *t, const char *name, uint32_t n) {
    *t = (Terrain){.n = n, .lowest = INFINITY, .highest = -INFINITY, .h = malloc(sizeof(float) * n * n)};
    snprintf(t->name, sizeof t->name, "%s", name);
    if (!strcmp(name, "dem")) {
        if (!make_dem(t)) {
            terrain_free(t);
            return false;
        }
    } else {
        make_fbm(t);
    }
    for (uint32_t k = 0; k < n * n; k++) t->lowest = fminf(t->lowest, t->h[k]), t->highest = fmaxf(t->highest, t->h[k]);
    return true;
}
void terrain_free(Terrain *t) {
    free(t->h);
    t->h = NULL;
}

/* The plane of a triangle: z = h + gx (x - i) + gy (y - j) from one of its corners. */
static void plane(const Terrain *t, uint32_t i, uint32_t j, bool upper, double *px, double *py, double *pz, double *gx,
                  double *gy) {
    double h10 = terrain_at(t, i + 1, j), h01 = terrain_at(t, i, j + 1);
    if (upper) {
        double h11 = terrain_at(t, i + 1, j + 1);
        *px = i + 1.0, *py = j + 1.0, *pz = h11, *gx = h11 - h01, *gy = h11 - h10;
    } else {
        double h00 = terrain_at(t, i, j);
        *px = i, *py = j, *pz = h00, *gx = h10 - h00, *gy = h01 - h00;
    }
}

double terrain_height(const Terrain *t, double x, double y, double normal[3]) {
    double top = t->n - 2.0, px, py, pz, gx, gy;
    uint32_t i = (uint32_t)fmin(fmax(floor(x), 0.0), top), j = (uint32_t)fmin(fmax(floor(y), 0.0), top);
    plane(t, i, j, x - i + (y - j) > 1.0, &px, &py, &pz, &gx, &gy);
    if (normal) {
        double s = 1.0 / sqrt(1.0 + gx * gx + gy * gy);
        normal[0] = -gx * s, normal[1] = -gy * s, normal[2] = s;
    }
    return pz + gx * (x - px) + gy * (y - py);
}

double terrain_distance(const Terrain *t, const Ray *r, int32_t id) {
    double side = t->n - 1.0, px, py, pz, gx, gy;
    if (id == SLT_WITNESS_NONE) return INFINITY;
    if (id == SLT_WITNESS_AT_T0) return r->t0;
    if (id <= SLT_HEIGHTFIELD_WALL) {
        int axis = (SLT_HEIGHTFIELD_WALL - id) / 2;
        return ((SLT_HEIGHTFIELD_WALL - id) % 2 ? side - r->o[axis] : -(double)r->o[axis]) / r->d[axis];
    }
    uint32_t cell = (uint32_t)id / 2;
    plane(t, cell % t->n, cell / t->n, id & 1, &px, &py, &pz, &gx, &gy);
    double f = r->o[2] - pz - gx * (r->o[0] - px) - gy * (r->o[1] - py), slope = r->d[2] - gx * r->d[0] - gy * r->d[1];
    return -f / slope;
}

EmbreeScene *terrain_embree(const Terrain *t, bool grid, double *seconds, size_t *bytes) {
    const uint32_t n = t->n, nvertices = n * n, nfaces = 2 * (n - 1) * (n - 1);
    float *vertex = malloc(3 * sizeof *vertex * nvertices);
    uint32_t *face = grid ? NULL : malloc(3 * sizeof *face * nfaces), *at = face;
    for (uint32_t k = 0; k < nvertices; k++) {
        const uint32_t i = k % n, j = k / n;
        vertex[3 * k] = (float)i, vertex[3 * k + 1] = (float)j, vertex[3 * k + 2] = terrain_at(t, i, j);
        if (grid || i + 1 == n || j + 1 == n) continue;
        memcpy(at, (uint32_t[]){k, k + 1, k + n, k + 1, k + n + 1, k + n}, 6 * sizeof *face);
        at += 6;
    }
    EmbreeScene *s = embree_scene_make(
        &(EmbreeSource){.vertex = vertex, .face = face, .nvertices = nvertices, .nfaces = nfaces, .side = n}, seconds,
        bytes);
    free(vertex), free(face);
    return s;
}
