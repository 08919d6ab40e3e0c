/* A mesh that was fitted, as a file that gives the same mesh when it is read. */
#include <stdlib.h>
#include <string.h>

#include "cli/fit.h"
#include "runtime/base/text.h"
#include "saltus/mesh.h"

static double uv_of(const int32_t *at) {
    float part[2];
    memcpy(part, at, sizeof part);
    return (double)part[0] + (double)part[1];
}

static void write_obj(FILE *out, const double *v, uint32_t nvertices, const int32_t *face, uint32_t nfaces,
                      bool has_uv) {
    const int32_t *part = face + (size_t)SLT_MESH_FACE * nfaces, *uv = part + (size_t)SLT_MESH_PART * nfaces;
    bool parts = nfaces && part[nfaces - 1] > 0;
    for (uint32_t i = 0; i < nvertices; i++, v += 3) fprintf(out, "v %.17g %.17g %.17g\n", v[0], v[1], v[2]);
    for (size_t i = 0; has_uv && i < 3 * (size_t)nfaces; i++)
        fprintf(out, "vt %.17g %.17g\n", uv_of(uv + 4 * i), uv_of(uv + 4 * i + 2));
    for (uint32_t i = 0; i < nfaces; i++) {
        if (parts && (!i || part[i] != part[i - 1])) fprintf(out, "g part%d\n", part[i]);
        fputc('f', out);
        for (uint32_t k = 3 * i; k < 3 * i + 3; k++) {
            fprintf(out, " %d", face[k] + 1);
            if (has_uv) fprintf(out, "/%u", k + 1);
        }
        fputc('\n', out);
    }
}

SltStatus fit_write_meshes(Fit *f, SltError *err) {
    char path[4096], name[512];
    for (uint32_t k = 0; k < slt_param_count(f->p); k++) {
        SltParam q = SLT_PARAM_INIT;
        uint32_t nfaces;
        bool has_uv;
        const int32_t *face = slt_mesh(f->p, k, &nfaces, &has_uv);
        slt_param(f->p, k, &q);
        if (!face || !slt_wrt_mask(f->p)[q.fbase]) continue;
        Text text;
        FILE *out = text_open(&text);
        if (out) write_obj(out, slt_floats(f->p) + q.fbase, q.shape[0], face, nfaces, has_uv);
        char *obj = text_close(&text);
        snprintf(name, sizeof name, "%.500s.obj", q.name);
        SltStatus s =
            obj ? fit_join(path, sizeof path, f->c->output, name, err) : status_fail(err, SLT_LIMIT, "out of memory");
        if (s == SLT_OK) s = file_write_atomic(path, obj, text.size, err);
        free(obj);
        if (s != SLT_OK) return s;
    }
    return SLT_OK;
}
