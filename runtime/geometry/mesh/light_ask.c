/* Is a place of the light hidden? By a ray, or by all triangles in the beam. */
#include "light_inner.h"

#include <math.h>

bool light_ask_all(Light *l, const double place[2]) {
    if (l->skipped) light_gather(l, false);
    for (uint32_t i = 0; i < l->store->triangle.n; i++)
        if (light_hides(l, l->store->triangle.data[i], place[0], place[1])) return true;
    return false;
}

/* Where p lies on triangles, they do not hide: if it is one of them that the ray meets first, or one that floats alone
 * let it meet, all are asked. */
void light_ask(Light *l, const double (*place)[2], uint32_t n, bool *dark) {
    union {
        double f64[8 * LIGHT_AT_ONCE];
        float f32[8 * LIGHT_AT_ONCE];
    } rays;
    int32_t witness[LIGHT_AT_ONCE];
    memset(dark, 0, n * sizeof *dark);
    if (!n || (!l->store->triangle.n && !l->skipped)) return;
    for (uint32_t k = 0; k < n; k++) {
        const double *m = place[k];
        double size = 0;
        for (uint32_t a = 0; a < 8; a++) {
            const uint32_t i = a % 3;
            double x = l->c[i] + m[0] * l->u[i] + m[1] * l->v[i];
            if (a < 3) x = l->p[a];
            else if (a < 6) size += x * x;
            else x = a == 6 ? l->near / sqrt(size) : l->beyond;
            if (l->f64) rays.f64[a * n + k] = x;
            else rays.f32[a * n + k] = (float)x;
        }
    }
    l->s->search(&l->s->tree, &rays, (1ull << n) - 1, n, !l->touches, witness);
    for (uint32_t k = 0; k < n; k++) {
        const double *m = place[k];
        dark[k] = witness[k] >= 0;
        if (dark[k] && l->touches) dark[k] = light_hides(l, witness[k], m[0], m[1]) || light_ask_all(l, m);
    }
}
