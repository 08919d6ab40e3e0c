/* One receiver and one light: the query, what it tells. */
#include "light_inner.h"
#include "ltc.h"

#include <math.h>
#include <pthread.h>

#include "pieces.h"
#include "saltus/mesh.h"

#define PI 3.14159265358979323846

/* ---- the store */

static _Thread_local LightStore *own;
static pthread_key_t key;
static pthread_once_t once = PTHREAD_ONCE_INIT;

static void release(void *p) {
    LightStore *s = p;
    free(s->edge.data), free(s->triangle.data), free(s->segment.data), free(s->facet.data), free(s->list.data);
    free(s->piece.data), free(s->lit.data), free(s->shown.data), free(s->near.data), free(s->arc.data), free(s->stamp);
    light_arrangement_free(s->arrangement);
    for (uint32_t k = 0; k < LIGHT_SLOTS; k++) free(s->kept[k].data);
    free(s);
}

static void make_key(void) { (void)pthread_key_create(&key, release); }

LightStore *light_store(void) {
    if (own) return own;
    pthread_once(&once, make_key);
    own = calloc(1, sizeof *own);
    if (own) (void)pthread_setspecific(key, own);
    return own;
}

/* ---- receiver and light */

/* The line of the plane through p with that normal. */
static void set_clip(const Light *l, const double normal[3], double g[3]) {
    g[0] = vec_dot(normal, l->u), g[1] = vec_dot(normal, l->v), g[2] = vec_dot(normal, l->c);
    const double slope = sqrt(g[0] * g[0] + g[1] * g[1]);
    for (int k = 0; k < 3 && slope > 0; k++) g[k] /= slope;
}

/* DARK: nothing shines on p, or nobody sees it; degenerate lights have no inside. UNKNOWN: a number is not finite. */
typedef enum Shine { DARK, UNKNOWN, SHINES } Shine;

static Shine light_set(Light *l, const void *rays, uint32_t width, bool lobe, Ltc *ltc) {
    double row[SLT_LOBE_ROWS] = {0}, product[3], far = 0;
    for (uint32_t k = 0; k < (lobe ? SLT_LOBE_ROWS : SLT_LIGHT_ROWS); k++) {
        row[k] = l->f64 ? ((const double *)rays)[(size_t)k * width] : (double)((const float *)rays)[(size_t)k * width];
        if (!(fabs(row[k]) <= 1e30)) return UNKNOWN;
    }
    for (int a = 0; a < 3; a++) {
        l->p[a] = row[SLT_LIGHT_P + a], l->n[a] = row[SLT_LIGHT_N + a];
        l->c[a] = row[SLT_LIGHT_CORNER + a] - l->p[a];
        l->u[a] = row[SLT_LIGHT_V + a], l->v[a] = row[SLT_LIGHT_U + a];
        far = fmax(far, fabs(l->p[a]));
    }
    memcpy(l->key, row, sizeof l->key);
    vec_cross(l->u, l->v, product);
    const double det = vec_dot(l->c, product);
    if (!(det > 0) || !isfinite(det)) return DARK;
    const double *column[3] = {l->u, l->v, l->c};
    for (int k = 0; k < 3; k++) {
        vec_cross(column[(k + 1) % 3], column[(k + 2) % 3], l->row[k]);
        for (int a = 0; a < 3; a++) l->row[k][a] /= det;
    }
    /* p, the light and vertices are rounded: p lies on a triangle up to a few units in the last place of what it was
     * computed from. */
    l->near = (far + l->s->tree.bvh->magnitude) * (l->f64 ? 0x1p-40 : 0x1p-18);
    l->beyond = 1 - (l->f64 ? 0x1p-40 : 0x1p-20);
    l->lobe = lobe;
    if (lobe && !ltc_lobe(l->n, row + SLT_LIGHT_VIEW, row[SLT_LIGHT_ROUGHNESS], ltc)) return DARK;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) l->map[i][k] = lobe ? ltc->map[i][k].v : i == k;
    set_clip(l, l->n, l->clip[0]);
    vec_back(l->map, l->n, product);
    set_clip(l, product, l->clip[1]);
    return SHINES;
}

/* What follows from T; the segments that no mesh makes. */
static void light_prepare(Light *l) {
    vec_map(l->map, l->c, l->cm);
    vec_map(l->map, l->u, l->um);
    vec_map(l->map, l->v, l->vm);
    vec_cross(l->um, l->vm, l->uv);
    vec_cross(l->cm, l->vm, l->cv);
    vec_cross(l->cm, l->um, l->cu);
    light_borders(l);
}

void light_borders(Light *l) {
    LightStore *s = l->store;
    l->nborder = LINE_MESH;
    s->edge.n = s->triangle.n = s->segment.n = s->facet.n = s->list.n = s->piece.n = s->lit.n = 0;
    static const double border[4][3] = {{0, 1, 0}, {-1, 0, 1}, {0, -1, 1}, {1, 0, 0}};
    for (int k = 0; k < LINE_MESH; k++) {
        Segment segment = {.kind = k < 4 ? SEGMENT_BORDER : k == 4 ? SEGMENT_HORIZON : SEGMENT_FIXED};
        if (k < LINE_HORIZON) memcpy(segment.g, border[k], sizeof segment.g);
        if (k == LINE_HORIZON) memcpy(segment.g, l->clip[0], sizeof segment.g);
        if (!ROW_ADD(s->segment, segment)) l->lost = true;
    }
}

bool light_wants_triangles(const Light *l) {
    const LightStore *s = l->store;
    if (l->s->way != LIGHT_BY_COUNTS) return l->s->way == LIGHT_TRIANGLES;
    return !l->skipped && s->segment.n - l->nborder > s->triangle.n;
}

/* What n, view and roughness change by T and by the amplitude. */
static void add_lobe(const Light *l, const Ltc *ltc, const LightSlopes *s, double *slope) {
    const double value = vec_dot(l->n, l->flux) / PI;
    double by[LTC_SLOPES];
    for (int k = 0; k < LTC_SLOPES; k++) {
        by[k] = ltc->amplitude.d[k] * value;
        for (int i = 0; i < 3; i++)
            for (int a = 0; a < 3; a++) by[k] += ltc->amplitude.v / PI * s->map[i][a] * ltc->map[i][a].d[k];
    }
    for (int i = 0; i < 3; i++) slope[SLT_LIGHT_N + i] += by[LTC_N + i], slope[SLT_LIGHT_VIEW + i] = by[LTC_VIEW + i];
    slope[SLT_LIGHT_ROUGHNESS] = by[LTC_ROUGHNESS];
}

int32_t light_tell(const Light *l, const double *head, const LightEdge *edge, uint32_t n, double scale) {
    int32_t first = 0;
    for (uint32_t k = 0; k < SLT_LIGHT_EDGES; k++) {
        const uint32_t unit = pieces_tell(l->f64, head + k * SLT_TOLD, k == 0 ? SLT_LIGHT_COUNT + 1 : 0);
        if (!unit) return 0;
        if (!k) first = (int32_t)unit;
    }
    for (uint32_t i = 0; i < n; i++) {
        double number[SLT_TOLD] = {edge[i].vertex[0], edge[i].vertex[1]};
        for (int a = 0; a < 3; a++)
            number[SLT_LIGHT_D_A + a] = scale * edge[i].d[0][a], number[SLT_LIGHT_D_B + a] = scale * edge[i].d[1][a];
        if (!pieces_tell(l->f64, number, SLT_LIGHT_D_A)) return 0;
    }
    return first;
}

/* What shines on the receiver: the same for both queries. */
static void search(Light *l) {
    LightStore *s = l->store;
    s->shown.n = s->near.n = s->arc.n = 0;
    const LightWay way = l->s->way;
    light_gather(l, way == LIGHT_BY_COUNTS || way == LIGHT_SILHOUETTES);
    if (way != LIGHT_TRIANGLES && !l->lost) light_edges(l);
    if (way != LIGHT_PIECES && way != LIGHT_TRIANGLES && !l->lost && light_arrange(l)) return;
    if (l->skipped && !l->lost) light_gather(l, false);
    const bool facets = light_wants_triangles(l);
    if (facets) s->segment.n = LINE_MESH, light_facets(l);
    if (!l->lost) light_look(l, facets);
}

/* ltc: NULL without a lobe. */
static int32_t answer(Light *l, const Ltc *ltc, uint32_t lane) {
    LightStore *s = l->store;
    const double scale = ltc ? ltc->amplitude.v / PI : 1;
    double head[SLT_LIGHT_EDGES * SLT_TOLD] = {0}, *slope = head + SLT_LIGHT_SLOPES;
    if (!l->s->both || !light_recall(l, lane)) {
        search(l);
        if (l->s->both && !l->lost) light_keep(l, lane);
    }
    LightSlopes slopes = {0};
    if (!l->lost) light_shine(l);
    if (!l->lost) light_turn(l, &slopes);
    if (l->lost) return 0;
    head[SLT_LIGHT_VALUE] = scale * vec_dot(l->n, l->flux);
    head[SLT_LIGHT_COUNT] = s->edge.n;
    for (int i = 0; i < 3; i++) {
        slope[SLT_LIGHT_P + i] = -scale * (slopes.moved[i] + slopes.corner[i]);
        slope[SLT_LIGHT_N + i] = scale * (slopes.n[i] + l->flux[i]);
        slope[SLT_LIGHT_CORNER + i] = scale * slopes.corner[i];
        slope[SLT_LIGHT_U + i] = scale * slopes.v[i];
        slope[SLT_LIGHT_V + i] = scale * slopes.u[i];
    }
    if (ltc) add_lobe(l, ltc, &slopes, slope);
    const int32_t unit = light_tell(l, head, s->edge.data, s->edge.n, scale);
    l->lost = !unit;
    return unit;
}

bool light_find(const LightScene *s, SltQuery what, const void *rays, uint64_t mask, uint32_t width, int32_t *witness) {
    static const double unknown[SLT_LIGHT_EDGES * SLT_TOLD] = {[SLT_LIGHT_VALUE] = NAN};
    const bool f64 = s->tree.bvh->f64, lobe = what == SLT_QUERY_LTC;
    bool all = true;
    for (uint32_t k = 0; k < width; k++) {
        Light l = {.s = s, .store = light_store(), .own = -1, .f64 = f64};
        Ltc ltc;
        witness[k] = 0;
        if (!(mask >> k & 1)) continue;
        switch (light_set(&l, (const char *)rays + k * (f64 ? sizeof(double) : sizeof(float)), width, lobe, &ltc)) {
        case DARK: continue;
        case UNKNOWN: witness[k] = light_tell(&l, unknown, NULL, 0, 1); break;
        case SHINES:
            if (l.store) light_prepare(&l), witness[k] = answer(&l, lobe ? &ltc : NULL, k);
            break;
        }
        all &= witness[k] != 0;
    }
    return all;
}
