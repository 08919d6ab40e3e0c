/* The table between its nodes, T and its derivatives. */
#include "ltc.h"

#include <math.h>

#include "vec.h"

const double ltc_table[LTC_ROUGHNESSES][LTC_COSINES][LTC_PARTS] = {
#include "ltc_table.inc"
};

/* ---- the table */

/* Of Catmull and Rom's cubic between nodes 1 and 2 of four: the weights of the nodes at t in [0, 1] and their slopes.
 */
static void weights(double t, double w[4], double slope[4]) {
    const double t2 = t * t, t3 = t2 * t;
    w[0] = 0.5 * (-t + 2 * t2 - t3), slope[0] = 0.5 * (-1 + 4 * t - 3 * t2);
    w[1] = 0.5 * (2 - 5 * t2 + 3 * t3), slope[1] = 0.5 * (-10 * t + 9 * t2);
    w[2] = 0.5 * (t + 4 * t2 - 3 * t3), slope[2] = 0.5 * (1 + 8 * t - 9 * t2);
    w[3] = 0.5 * (-t2 + t3), slope[3] = 0.5 * (-2 * t + 3 * t2);
}

/* The cell of x in [0, 1] among n nodes, four nodes and their weights: beyond an end the line goes on. */
typedef struct Cell {
    int node[4];
    double w[4], slope[4];
} Cell;

static void cell_set(Cell *c, double x, int n) {
    const double at = fmin(fmax(x, 0), 1) * (n - 1);
    const int k = at < n - 2 ? (int)at : n - 2;
    weights(at - k, c->w, c->slope);
    for (int i = 0; i < 4; i++) c->node[i] = k - 1 + i, c->slope[i] *= n - 1;
    if (k == 0) {
        c->node[0] = 0;
        c->w[1] += c->w[0], c->slope[1] += c->slope[0]; /* node -1 is 2 node 0 - node 1 */
        c->w[2] -= c->w[0], c->slope[2] -= c->slope[0];
    }
    if (k == n - 2) {
        c->node[3] = n - 1;
        c->w[2] += c->w[3], c->slope[2] += c->slope[3];
        c->w[1] -= c->w[3], c->slope[1] -= c->slope[3];
    }
}

void ltc_parts(double roughness, double cosine, double p[LTC_PARTS], double by_roughness[LTC_PARTS],
               double by_cosine[LTC_PARTS]) {
    Cell r, c;
    cell_set(&r, (roughness - LTC_LEAST) / (1 - LTC_LEAST), LTC_ROUGHNESSES);
    cell_set(&c, cosine, LTC_COSINES);
    for (int k = 0; k < LTC_PARTS; k++) {
        p[k] = by_roughness[k] = by_cosine[k] = 0;
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < 4; j++) {
                const double v = ltc_table[r.node[i]][c.node[j]][k];
                p[k] += r.w[i] * c.w[j] * v;
                by_roughness[k] += r.slope[i] * c.w[j] * v / (1 - LTC_LEAST);
                by_cosine[k] += r.w[i] * c.slope[j] * v;
            }
    }
}

/* ---- numbers with derivatives */

static LtcNumber sum(LtcNumber a, double by, LtcNumber b) {
    a.v += by * b.v;
    for (int i = 0; i < LTC_SLOPES; i++) a.d[i] += by * b.d[i];
    return a;
}

static LtcNumber product(LtcNumber a, LtcNumber b) {
    LtcNumber out = {.v = a.v * b.v};
    for (int i = 0; i < LTC_SLOPES; i++) out.d[i] = a.d[i] * b.v + a.v * b.d[i];
    return out;
}

static LtcNumber quotient(LtcNumber a, LtcNumber b) {
    LtcNumber out = {.v = a.v / b.v};
    for (int i = 0; i < LTC_SLOPES; i++) out.d[i] = (a.d[i] - out.v * b.d[i]) / b.v;
    return out;
}

static LtcNumber input(double v, int which) {
    LtcNumber out = {.v = v};
    out.d[which] = 1;
    return out;
}

bool ltc_lobe(const double normal[3], const double towards[3], double roughness, Ltc *out) {
    LtcNumber n[3], view[3], across[3], p[LTC_PARTS], cosine = {0}, square = {0};
    double value[LTC_PARTS], by_roughness[LTC_PARTS], by_cosine[LTC_PARTS];
    const double r = fmin(fmax(roughness, LTC_LEAST), 1);
    for (int i = 0; i < 3; i++) {
        n[i] = input(normal[i], LTC_N + i), view[i] = input(towards[i], LTC_VIEW + i);
        cosine = sum(cosine, 1, product(n[i], view[i]));
    }
    if (!(cosine.v > 0)) return false;
    for (int i = 0; i < 3; i++) {
        across[i] = sum(view[i], -1, product(cosine, n[i]));
        square = sum(square, 1, product(across[i], across[i]));
    }
    ltc_parts(r, cosine.v, value, by_roughness, by_cosine);
    for (int k = 0; k < LTC_PARTS; k++) {
        p[k] = (LtcNumber){.v = value[k]};
        for (int i = 0; i < LTC_SLOPES && cosine.v < 1; i++) p[k].d[i] = by_cosine[k] * cosine.d[i];
        if (r == roughness) p[k].d[LTC_ROUGHNESS] += by_roughness[k];
    }
    LtcNumber rough = {.v = r};
    if (r == roughness) rough.d[LTC_ROUGHNESS] = 1;
    const LtcNumber alpha = product(rough, rough), b_d = product(p[2], p[3]),
                    a = sum(p[0], 1, product(square, p[1])), /* by alpha */
        whole = quotient(sum(product(a, p[4]), 1, product(square, b_d)), p[0]),
                    bend = quotient(sum(product(p[4], p[1]), 1, b_d), p[0]), sheared = product(alpha, p[3]),
                    along = sum(product(alpha, a), -1, whole);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            LtcNumber t = product(along, product(n[i], n[k]));
            t = sum(t, -1, product(bend, product(across[i], across[k])));
            t = sum(t, 1, product(p[2], product(across[i], n[k])));
            t = sum(t, -1, product(sheared, product(n[i], across[k])));
            out->map[i][k] = i == k ? sum(t, 1, whole) : t;
        }
    out->amplitude = p[5];
    return true;
}
