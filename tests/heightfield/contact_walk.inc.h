/* The search for the first silhouette of a ray, cell by cell, that also tells where it is: t and the slope. Included
 * behind leaf.h, once for each precision. */
#define contact_walk FN(contact_walk)

static bool contact_walk(const flt *heights, int w, int h, const flt ray[8], flt *at, flt *slope) {
    Ray r = {.ox = ray[0], .oy = ray[1], .oz = ray[2], .dx = ray[3], .dy = ray[4], .te = 0, .t1 = FLT_BIG};
    Search s = {.best = ray[6], .limit = ray[7], .id = SLT_WITNESS_NONE};
    Leaf l;
    int i, j, id;
    if (!(ray[6] < ray[7]) || !ray_setup(&r, w, h, -1)) return false;
    ray_locate(&r, r.te, -1, w, h, &i, &j);
    flt start = ray_start(&r, heights, w, h, i, j, -1, &id), t = r.te;
    search_start(&s, SLT_QUERY_SILHOUETTE, &r, start, id, -1);
    *at = t;
    for (int n = 0; n < w + h && !s.done; n++) {
        int before = s.id;
        leaf_test(&l, &r, heights, w, h, i, j, t, line_x(&r, i + r.sx), line_y(&r, j + r.sy), -1);
        search_leaf(&s, SLT_QUERY_SILHOUETTE, &r, &l, w, i, j, -1);
        if (s.id != before) *at = s.id % 4 == 2 ? l.td : l.te;
        t = l.te;
        if (t >= r.tl) break;
        if (l.xexit) i += 2 * r.sx - 1;
        else j += 2 * r.sy - 1;
    }
    *slope = s.best;
    return s.id != SLT_WITNESS_NONE;
}
