/* Building and refreshing the maximum mipmap. The loops over a row are compiled for each instruction set (rows.inc.h).
 */
#include "internal.h"

#include <math.h>
#include <stdlib.h>

static uint32_t nodes(uint32_t vertices, int32_t level) {
    return (uint32_t)(((uint64_t)vertices - 1 + (1u << level) - 1) >> level);
}

static void first_level(Field *f, const void *heights, uint32_t i0, uint32_t i1, uint32_t j0, uint32_t j1,
                        float *scratch) {
    const FieldKernels *k = field_kernels(f->isa);
    Mipmap *m = &f->mip;
    const uint32_t w = f->w, h = f->h, from = 2 * i0;
    const uint32_t count = (2 * i1 + 3 < w ? 2 * i1 + 3 : w) - from; /* vertices; node I reads 2I, 2I + 1, 2I + 2 */
    for (uint32_t j = j0; j <= j1; j++) {
        size_t row[3];
        for (uint32_t n = 0; n < 3; n++) {
            uint32_t y = 2 * j + n < h ? 2 * j + n : h - 1;
            row[n] = (size_t)(h - 1 - y) * w + from;
        }
        float *out = m->data + m->base[1] + (size_t)j * (size_t)m->stride[1] + i0;
        double most;
        if (f->f64) {
            const double *p = heights;
            most = k->first_level64(p + row[0], p + row[1], p + row[2], count, out, scratch);
        } else {
            const float *p = heights;
            most = k->first_level32(p + row[0], p + row[1], p + row[2], count, out, scratch);
        }
        if (most > f->magnitude) f->magnitude = most;
    }
}

static void fill(Field *f, const void *heights, uint32_t i0, uint32_t i1, uint32_t j0, uint32_t j1, float *scratch) {
    const FieldKernels *k = field_kernels(f->isa);
    Mipmap *m = &f->mip;
    first_level(f, heights, i0, i1, j0, j1, scratch);
    for (int32_t l = 2; l <= m->top; l++) {
        const uint32_t w = (uint32_t)m->stride[l - 1], h = (uint32_t)m->rows[l - 1];
        i0 >>= 1, i1 >>= 1, j0 >>= 1, j1 >>= 1;
        const uint32_t count = (2 * i1 + 2 < w ? 2 * i1 + 2 : w) - 2 * i0;
        for (uint32_t j = j0; j <= j1; j++) {
            const float *a = m->data + m->base[l - 1] + (size_t)(2 * j) * w + 2 * i0;
            k->next_level(a, 2 * j + 1 < h ? a + w : a, count,
                          m->data + m->base[l] + (size_t)j * (size_t)m->stride[l] + i0);
        }
    }
    m->max = -INFINITY;
    const float *top = m->data + m->base[m->top];
    for (size_t n = 0; n < (size_t)m->stride[m->top] * (size_t)m->rows[m->top]; n++)
        m->max = top[n] > m->max ? top[n] : m->max;
}

bool mipmap_make(Field *f, const void *heights) {
    Mipmap *m = &f->mip;
    const uint32_t w = f->w, h = f->h, side = (w > h ? w : h) - 1;
    m->top = 1;
    while (m->top < MIP_LEVELS - 1 && side > 1u << m->top) m->top++;
    size_t count = 0;
    for (int32_t l = 1; l < MIP_LEVELS; l++) {
        int32_t from = l < m->top ? l : m->top;
        if (l <= m->top) {
            m->base[l] = (int32_t)count;
            m->stride[l] = (int32_t)nodes(w, l);
            m->rows[l] = (int32_t)nodes(h, l);
            count += (size_t)m->stride[l] * (size_t)m->rows[l];
        } else {
            m->base[l] = m->base[from], m->stride[l] = m->stride[from], m->rows[l] = m->rows[from];
        }
    }
    m->base[0] = m->base[1], m->stride[0] = m->stride[1], m->rows[0] = m->rows[1];
    m->count = count;
    m->data = malloc(count * sizeof *m->data);
    float *scratch = malloc((w + 2) * sizeof *scratch);
    if (m->data && scratch) fill(f, heights, 0, (uint32_t)m->stride[1] - 1, 0, (uint32_t)m->rows[1] - 1, scratch);
    bool ok = m->data && scratch;
    free(scratch);
    return ok;
}

void mipmap_refresh(Field *f, const void *heights, uint32_t x0, uint32_t y0, uint32_t x1, uint32_t y1) {
    const uint32_t w = f->w, h = f->h;
    float stack[2050], *scratch = w + 2 <= 2050 ? stack : malloc((w + 2) * sizeof *scratch);
    /* Vertex i belongs to cells i - 1 and i. */
    uint32_t i0 = (x0 ? x0 - 1 : 0) >> 1, i1 = (x1 - 1 < w - 2 ? x1 - 1 : w - 2) >> 1;
    uint32_t j0 = (y0 ? y0 - 1 : 0) >> 1, j1 = (y1 - 1 < h - 2 ? y1 - 1 : h - 2) >> 1;
    if (scratch) fill(f, heights, i0, i1, j0, j1, scratch);
    else /* no memory for a whole row: one piece after another */
        for (uint32_t i = i0; i <= i1; i += 512) fill(f, heights, i, i + 511 < i1 ? i + 511 : i1, j0, j1, stack);
    if (scratch != stack) free(scratch);
}

void mipmap_free(Mipmap *m) {
    free(m->data);
    m->data = NULL;
}
