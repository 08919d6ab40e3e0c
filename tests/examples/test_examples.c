/* Every example compiles without a warning, renders, and has derivatives that agree with finite
 * differences; the ones that fit something, fit it. Runs the command itself, on few samples. */
#include "tests/scratch.h"

#include <stdbool.h>

#define EXAMPLES SALTUS_TEST_DIR "/../examples"

typedef struct Example {
    const char *file, *options, *size;
    const char *fit; /* options of a fit that at least halves the loss; NULL: it fits nothing */
} Example;

static const Example examples[] = {
    {"circle/circle.salt", "", "48x48", NULL},
    {"implicit_flower/flower.salt", "", "48x48", NULL},
    {"derivative_images/half_plane.salt", "", "48x48", NULL},
    {"derivative_images/triangle.salt", "", "48x48", NULL},
    {"derivative_images/bezier.salt", "", "48x48", NULL},
    {"derivative_images/voronoi.salt", "", "48x48", NULL},
    {"derivative_images/noise_circle.salt", "", "48x48", NULL},
    {"derivative_images/implicit.salt", "", "48x48", NULL},
    {"derivative_images/slit.salt", "", "48x48", NULL},
    {"derivative_images/waves.salt", "", "48x48", NULL},
    {"derivative_images/board.salt", "--set DEPTH=4", "48x48", NULL},
    {"thin_bands/bands.salt", "", "48x48", NULL},
    {"high_frequency/zone_plate.salt", "", "48x48", NULL},
    {"painterly_discs/discs.salt", "--set N=60", "48x32",
     "--target " EXAMPLES "/painterly_discs/photo.png --size 60x40"},
    {"painterly_shapes/ellipses.salt", "--set N=24", "48x32",
     "--target " EXAMPLES "/painterly_shapes/photo.png --size 48x32"},
    {"painterly_shapes/triangles.salt", "--set N=24", "48x32",
     "--target " EXAMPLES "/painterly_shapes/photo.png --size 48x32"},
    {"painterly_shapes/strokes.salt", "--set N=24", "48x32",
     "--target " EXAMPLES "/painterly_shapes/photo.png --size 48x32"},
    {"painterly_shapes/blobs.salt", "--set N=24", "48x32",
     "--target " EXAMPLES "/painterly_shapes/photo.png --size 48x32"},
    {"painterly_shapes/mixed.salt", "--set N=24", "48x32",
     "--target " EXAMPLES "/painterly_shapes/photo.png --size 48x32"},
    {"painterly_shapes/gaussians.salt", "--set N=24", "48x32",
     "--target " EXAMPLES "/painterly_shapes/photo.png --size 48x32"},
    {"occlusion/pile.salt", "", "48x48", "--wrt discs --target " EXAMPLES "/occlusion/wide.png --size 48x48"},
    {"voronoi_mosaic/mosaic.salt", "--set N=24", "48x32",
     "--target " EXAMPLES "/voronoi_mosaic/photo.png --size 60x40"},
    {"warped_mosaic/warped.salt", "--set N=24", "48x32",
     "--wrt seeds --target " EXAMPLES "/warped_mosaic/photo.png --size 60x40"},
    {"warped_mosaic/warped.salt", "--entry bent --set N=24", "48x32",
     "--target " EXAMPLES "/warped_mosaic/photo.png --size 60x40"},
    {"binary_grid/grid.salt", "--set G=9", "48x48", "--target " EXAMPLES "/binary_grid/target.png --size 48x48"},
    {"binary_grid/target.salt", "", "48x48", NULL},
    {"checkerboard_tree/tree.salt", "--set DEPTH=3", "48x48", NULL},
    {"checkerboard_tree/tree.salt", "--set DEPTH=12", "48x48", NULL},
    {"csg/csg.salt", "", "24x24x24", NULL},
    {"csg/tree.salt", "", "24x24x24", NULL},
    {"winding_grid/grid.salt", "--set N=9", "16x16x16", NULL},
    {"swept_brush/sweep.salt", "", "48x48", NULL},
    {"swept_brush/sweep.salt", "--entry guess --set STAMPS=20", "48x48",
     "--target " EXAMPLES "/swept_brush/swept.png --size 48x48"},
    {"swept_brush/grid.salt", "--set G=17", "48x48", "--target " EXAMPLES "/swept_brush/swept.png --size 48x48"},
    {"ellipsoids/dog.salt", "--param azimuth=0.7 --param elevation=0.4", "48x48", NULL},
    {"ellipsoids/ellipsoids.salt", "", "48x48", "--target " EXAMPLES "/binary_grid/target.png --size 48x48"},
    {"shadow_art_3/letters.salt", "--entry b", "48x48", NULL},
    {"shadow_art_3/parts.salt", "--set N=60", "48x48", NULL},
    {"raymarch/raymarch.salt", "", "48x40", NULL},
    {"cel_shading/cel.salt", "", "48x48",
     "--target " EXAMPLES "/cel_shading/target.png --size 64x64 --wrt steps,light --lr light=0.1"},
    {"land_and_water/truth.salt", "", "48x48", NULL},
    {"land_and_water/earth.salt", "", "48x48",
     "--target " EXAMPLES "/land_and_water/target.png --size 48x48 --param at=0,25 --lr level=0.1"},
    {"implicit_views/grid.salt", "", "48x48",
     "--target " EXAMPLES "/implicit_views/target.png --size 32x32 --param at=60,15 --lr level=0.1"},
    {"mesh_views/mesh.salt", "", "48x48",
     "--target " EXAMPLES "/mesh_views/target.png --size 32x32 --wrt v --param at=60,15 --lr v=0.003"},
    {"external_loss/discs.salt", "", "48x48", NULL},
    {"growing_discs/discs.salt", "", "60x40", "--target " EXAMPLES "/growing_discs/photo.png --size 60x40"},
    {"gears/gears.salt", "--precision f64", "48x30", NULL},
    {"tree_shadow/tree.salt", "--precision f64", "48x36", NULL},
    {"kaleidoscope/kaleidoscope.salt", "--precision f64", "48x48", NULL},
    {"kaleidoscope/kaleidoscope.salt", "--entry sites", "48x48", NULL},
    {"displacement/displacement.salt", "--precision f64", "48x48", NULL},
    {"glossy_knot/knot.salt", "--precision f64 --param seen=0.29,0.6,0.05,0.05", "24x18", NULL},
    {"dining_room/room.salt", "--precision f64 --param seen=0.26,0.22,0.01,0.01", "24x15", NULL},
    {"pathtrace/terrain.salt", "--set BOUNCES=1", "24x16", NULL},
    {"pathtrace/soft_sun.salt", "--entry sites --set BOUNCES=0", "24x16", NULL},
    {"pathtrace/soft_sun.salt", "--entry slices --set BOUNCES=0", "24x16", NULL},
    {"fragment/sunset.frag", "", "48x27",
     "--target " EXAMPLES "/fragment/target.png --size 80x45 --wrt sun,radius,hills"},
    {"fragment/spheres.frag", "", "48x27", NULL},
    {"cone_light/boundary.salt", "", "24x24", NULL},
    {"cone_light/slices.salt", "", "24x24", NULL},
};
enum { EXAMPLES_N = sizeof examples / sizeof *examples };

static int set_up(void **state) { return access(SALTUS_BIN, X_OK) == 0 ? scratch_make(state) : -1; }

static void test_render(void **state) {
    (void)state;
    for (int i = 0; i < EXAMPLES_N; i++) {
        const Example *e = &examples[i];
        char line[1024], out[8192];
        snprintf(line, sizeof line, "saltus render " EXAMPLES "/%s %s --size %s --spp 2 -o image.npy", e->file,
                 e->options, e->size);
        if (scratch_run(out, sizeof out, line) != 0 || strstr(out, "warning")) fail_msg("%s: %s", e->file, out);
    }
}

static void test_check(void **state) {
    (void)state;
    for (int i = 0; i < EXAMPLES_N; i++) {
        const Example *e = &examples[i];
        /* no parameters */
        if (!strcmp(e->file, "binary_grid/target.salt") || !strcmp(e->file, "land_and_water/truth.salt")) continue;
        char line[1024], out[8192];
        /* Of the integral of a zone plate fewer say nothing: it hardly changes. */
        bool fine = !strcmp(e->file, "high_frequency/zone_plate.salt");
        /* A difference along 16 641 heights at once has a truncation that no number of samples makes smaller. */
        const char *which = strstr(e->options, "--entry slices") ? "--wrt elevation,albedo " : "";
        snprintf(line, sizeof line, "saltus check " EXAMPLES "/%s %s %s--samples %d", e->file, e->options, which,
                 fine ? 1 << 20 : 1 << 16);
        if (scratch_run(out, sizeof out, line) != 0 || !strstr(out, "PASS"))
            fail_msg("%s %s: %s", e->file, e->options, out);
    }
}

static void test_fit(void **state) {
    (void)state;
    for (int i = 0; i < EXAMPLES_N; i++) {
        const Example *e = &examples[i];
        if (!e->fit) continue;
        char line[1024], out[16384];
        double before = 0, after = 0;
        snprintf(line, sizeof line, "saltus fit " EXAMPLES "/%s %s %s --iters 60 -o fit", e->file, e->options, e->fit);
        if (scratch_run(out, sizeof out, line) != 0) fail_msg("%s: %s", e->file, out);
        scratch_fit_losses(out, &before, &after);
        if (!(after < 0.5 * before) || !(before > 0)) fail_msg("%s: %s", e->file, out);
    }
}

/* What a page says of its scene, at less than its size: by how much the loss falls at least. */
static const struct {
    const char *scene;
    double falls;
} scenes[] = {
    {"binary_grid/scene.json --size 64 --spp 8 --interior samples --set G=33", 1000},
    {"csg/scene.json --size 12x12x12", 25},
    {"ellipsoids/scene.json --size 24 --iters 40 --set N=80", 25},
    {"gears/scene.json --size 80x48 --precision f64 --iters 25", 1e9},
    {"tree_shadow/scene.json --size 64x48 --precision f64 --iters 12", 1e6},
    {"kaleidoscope/scene.json --size 48 --precision f64", 1e9},
    {"displacement/scene.json --size 32 --precision f64 --iters 60", 1e4},
    {"mesh_views/scene.json --size 24 --spp 2 --iters 40", 50}, /* 30 do with some orders of the sums only */
    {"shadow_art_3/scene.json --size 32 --iters 40 --set N=100", 25},
};

static void test_scenes(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof scenes / sizeof *scenes; i++) {
        char line[1024], out[16384];
        double before = 0, after = 0;
        snprintf(line, sizeof line, "saltus fit " EXAMPLES "/%s -o fit", scenes[i].scene);
        if (scratch_run(out, sizeof out, line) != 0) fail_msg("%s: %s", scenes[i].scene, out);
        scratch_fit_losses(out, &before, &after);
        if (!(after * scenes[i].falls < before)) fail_msg("%s: %s", scenes[i].scene, out);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_render),
        cmocka_unit_test(test_check),
        cmocka_unit_test(test_fit),
        cmocka_unit_test(test_scenes),
    };
    return cmocka_run_group_tests(tests, set_up, scratch_drop);
}
