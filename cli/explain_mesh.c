/* What `saltus explain` says of meshes and of what is computed from parameters. */
#include <stdlib.h>

#include "bindings/c/derived.h"
#include "cli/explain.h"

/* Where rays see its vertices; those of the file where none looks. */
static const double *positions(const SltProgram *p, uint32_t param) {
    const Program *g = p->prog;
    for (uint32_t i = 0; i < g->ngeometries; i++)
        if (g->geometries[i].param == param) return p->floats + g->geometries[i].base;
    return p->floats + g->params[param].fbase;
}

static const char *names_of(const SltProgram *p, const Derived *d, Arena *arena) {
    const char *text = "";
    for (uint32_t k = 0; k < d->nreads; k++)
        text = arena_printf(arena, "%s%s%s", text, k ? ", " : "", p->prog->params[d->reads[k]].name);
    return text;
}

SltStatus explain_meshes(const SltProgram *p, Arena *arena, Explained *out, SltError *err) {
    const Program *g = p->prog;
    out->meshes = ARENA_ARRAY(arena, ExplainedMesh, g->nparams + 1);
    out->derived = ARENA_ARRAY(arena, ExplainedDerived, g->nderived + 1);
    for (uint32_t k = 0; k < g->nparams; k++) {
        const Param *q = &g->params[k];
        if (!q->is_mesh) continue;
        const int32_t *face = p->ints + q->tbase;
        ExplainedMesh *m = &out->meshes[out->nmeshes++];
        m->name = q->name;
        if (!mesh_inspect(positions(p, k), q->sym->nvertices, face, face + 3 * (size_t)q->sym->nfaces, q->sym->nfaces,
                          &m->counts))
            return status_fail(err, SLT_LIMIT, "out of memory to count what `%s` is made of", q->name);
    }
    for (uint32_t k = 0; k < g->nderived; k++) {
        const Derived *d = &g->derived[k];
        out->derived[out->nderived++] = (ExplainedDerived){.what = d->what,
                                                           .mesh = g->params[d->param].name,
                                                           .from = names_of(p, d, arena),
                                                           .n = d->n,
                                                           .differentiated = p->wrt[d->base] != 0};
    }
    return SLT_OK;
}

static void print_count(uint32_t n, const char *one, const char *many, const char *note) {
    if (n) printf("    %u %s%s\n", n, n == 1 ? one : many, note);
}

void explain_print_meshes(const Explained *m) {
    if (m->nmeshes) printf("\nmeshes\n");
    for (uint32_t k = 0; k < m->nmeshes; k++) {
        const MeshCounts *c = &m->meshes[k].counts;
        printf("  %s: %u vertices, %u triangles, %u edges, %u part%s\n", m->meshes[k].name, c->vertices, c->triangles,
               c->edges, c->parts, c->parts == 1 ? "" : "s");
        print_count(c->open_edges, "open edge", "open edges", "");
        print_count(c->nonmanifold_edges, "edge of more than two triangles", "edges of more than two triangles", "");
        print_count(c->degenerate, "triangle without an area", "triangles without an area", ": never hit");
        print_count(c->lone, "vertex of no triangle", "vertices of no triangle", "");
        print_count(c->duplicates, "triangle that lies on another", "triangles that lie on others",
                    ": no derivative where they come apart");
        print_count(c->on_edges, "vertex on an edge of others", "vertices on edges of others",
                    ": no derivative where they leave it");
    }
    if (m->nderived) printf("\ncomputed from parameters\n");
    for (uint32_t k = 0; k < m->nderived; k++)
        printf("  %s of %s, %u, from %s%s\n", m->derived[k].what, m->derived[k].mesh, m->derived[k].n,
               m->derived[k].from, m->derived[k].differentiated ? "" : ": not differentiated");
}

void explain_json_meshes(const Explained *m) {
    fputs("\"meshes\": [", stdout);
    for (uint32_t k = 0; k < m->nmeshes; k++) {
        const MeshCounts *c = &m->meshes[k].counts;
        printf("%s{\"name\": ", k ? ", " : "");
        json_text(stdout, m->meshes[k].name);
        printf(", \"vertices\": %u, \"triangles\": %u, \"edges\": %u, \"parts\": %u, \"open_edges\": %u, "
               "\"nonmanifold_edges\": %u, \"duplicates\": %u, \"degenerate\": %u, \"coincident\": %u, \"lone\": %u}",
               c->vertices, c->triangles, c->edges, c->parts, c->open_edges, c->nonmanifold_edges, c->duplicates,
               c->degenerate, c->on_edges, c->lone);
    }
    fputs("], \"derived\": [", stdout);
    for (uint32_t k = 0; k < m->nderived; k++) {
        printf("%s{\"what\": \"%s\", \"mesh\": ", k ? ", " : "", m->derived[k].what);
        json_text(stdout, m->derived[k].mesh);
        printf(", \"count\": %u, \"from\": ", m->derived[k].n);
        json_text(stdout, m->derived[k].from);
        printf(", \"differentiated\": %s}", m->derived[k].differentiated ? "true" : "false");
    }
    fputs("], ", stdout);
}
