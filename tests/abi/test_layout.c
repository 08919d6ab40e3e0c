/* Where the members of the public structs lie and what the public enums are worth, compared with layout.txt; BLESS=1
 * writes it anew. What is committed there may grow at the end of a struct or an enum, and change in no other way.
 *
 * tests/abi/run.sh compares more, where its tools are; this runs anywhere with 64-bit pointers. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "saltus/fit.h"

/* A struct's end so far: the next member begins at the next multiple of its alignment, or one is missing here. */
static size_t end_of;

static size_t up(size_t at, size_t to) { return (at + to - 1) / to * to; }

#define ENUM(type) fprintf(out, "enum %s\n", #type)
#define VALUE(name) fprintf(out, "    %-24s %d\n", #name, (int)(name))
#define STRUCT(type) fprintf(out, "struct %s: %zu bytes\n", #type, sizeof(type)), end_of = 0
#define MEMBER(type, name)                                                                                             \
    do {                                                                                                               \
        size_t at = offsetof(type, name), size = sizeof(((type *)0)->name);                                            \
        if (at != up(end_of, __alignof__(((type *)0)->name))) fail_msg("a member is missing before %s.%s", #type, #name); \
        fprintf(out, "    %-24s at %3zu, %3zu bytes\n", #name, at, size);                                              \
        end_of = at + size;                                                                                            \
    } while (0)
#define END(type)                                                                                                      \
    if (sizeof(type) != up(end_of, __alignof__(type))) fail_msg("members are missing at the end of %s", #type)

static void write_layout(FILE *out) {
    ENUM(SltStatus);
    VALUE(SLT_OK);
    VALUE(SLT_CHECK_FAILED);
    VALUE(SLT_USAGE);
    VALUE(SLT_PROGRAM);
    VALUE(SLT_INPUT);
    VALUE(SLT_OUTPUT);
    VALUE(SLT_LIMIT);
    VALUE(SLT_STOPPED);
    VALUE(SLT_INTERNAL);
    VALUE(SLT_INTERRUPTED);
    ENUM(SltEstimator);
    VALUE(SLT_EST_LATTICE);
    VALUE(SLT_EST_SCANLINE);
    VALUE(SLT_EST_SNAP_KNN);
    VALUE(SLT_EST_SNAP_CROFTON);
    VALUE(SLT_EST_FD);
    VALUE(SLT_EST_QUADRATURE);
    VALUE(SLT_EST_AUTO);
    ENUM(SltLanguage);
    VALUE(SLT_LANGUAGE_AUTO);
    VALUE(SLT_LANGUAGE_SALTUS);
    VALUE(SLT_LANGUAGE_GLSL);
    ENUM(SltFilter);
    VALUE(SLT_FILTER_BOX);
    VALUE(SLT_FILTER_TENT);
    VALUE(SLT_FILTER_GAUSSIAN);
    ENUM(SltInterior);
    VALUE(SLT_INTERIOR_AUTO);
    VALUE(SLT_INTERIOR_SAMPLES);
    VALUE(SLT_INTERIOR_QUADRATURE);
    ENUM(SltStop);
    VALUE(SLT_STOP_NONE);
    VALUE(SLT_STOP_EVALUATIONS);
    VALUE(SLT_STOP_ROUNDING);
    ENUM(SltDrop);
    VALUE(SLT_DROP_ZERO_GRADIENT);
    VALUE(SLT_DROP_NOT_FINITE);
    VALUE(SLT_DROP_INCONSISTENT);
    VALUE(SLT_DROP_NO_EVENT);
    VALUE(SLT_DROP_NO_ROOT);
    VALUE(SLT_DROP_STATIC);
    VALUE(SLT_DROP_HALVINGS);
    VALUE(SLT_DROP_COINCIDENT);
    VALUE(SLT_DROP_REASONS);
    ENUM(SltStructure);
    VALUE(SLT_STRUCTURE_AUTO);
    VALUE(SLT_STRUCTURE_MIPMAP);
    VALUE(SLT_STRUCTURE_CONE);
    VALUE(SLT_STRUCTURE_NAIVE);
    ENUM(SltKind);
    VALUE(SLT_KIND_FLOAT);
    VALUE(SLT_KIND_BOOL);
    VALUE(SLT_KIND_INT);
    VALUE(SLT_KIND_UINT);
    VALUE(SLT_KIND_STRUCT);
    STRUCT(SltError);
    MEMBER(SltError, status);
    MEMBER(SltError, text);
    END(SltError);
    STRUCT(SltJob);
    MEMBER(SltJob, struct_size);
    MEMBER(SltJob, integral);
    MEMBER(SltJob, size);
    MEMBER(SltJob, spp);
    MEMBER(SltJob, samples);
    MEMBER(SltJob, segments);
    MEMBER(SltJob, filter);
    MEMBER(SltJob, seed);
    MEMBER(SltJob, threads);
    MEMBER(SltJob, estimator);
    MEMBER(SltJob, no_interior);
    MEMBER(SltJob, no_boundary);
    MEMBER(SltJob, replicates);
    MEMBER(SltJob, fd_step);
    MEMBER(SltJob, time_limit);
    MEMBER(SltJob, cancel);
    MEMBER(SltJob, progress);
    MEMBER(SltJob, progress_user);
    MEMBER(SltJob, floats);
    MEMBER(SltJob, ints);
    MEMBER(SltJob, interior);
    MEMBER(SltJob, gauss);
    MEMBER(SltJob, error);
    MEMBER(SltJob, abs_error);
    MEMBER(SltJob, max_evaluations);
    MEMBER(SltJob, centred);
    END(SltJob);
    STRUCT(SltPlace);
    MEMBER(SltPlace, known);
    MEMBER(SltPlace, in_image);
    MEMBER(SltPlace, site);
    MEMBER(SltPlace, line);
    MEMBER(SltPlace, column);
    MEMBER(SltPlace, pixel);
    MEMBER(SltPlace, file);
    MEMBER(SltPlace, text);
    MEMBER(SltPlace, x);
    MEMBER(SltPlace, beyond);
    MEMBER(SltPlace, stream);
    MEMBER(SltPlace, rand0);
    STRUCT(SltStats);
    MEMBER(SltStats, struct_size);
    MEMBER(SltStats, samples);
    MEMBER(SltStats, segments);
    MEMBER(SltStats, crossings);
    MEMBER(SltStats, evaluations);
    MEMBER(SltStats, dropped);
    MEMBER(SltStats, truncated);
    MEMBER(SltStats, asserts);
    MEMBER(SltStats, nonfinite);
    MEMBER(SltStats, seconds);
    MEMBER(SltStats, seconds_interior);
    MEMBER(SltStats, seconds_boundary);
    MEMBER(SltStats, cells);
    MEMBER(SltStats, certified);
    MEMBER(SltStats, settled);
    MEMBER(SltStats, curved);
    MEMBER(SltStats, left);
    MEMBER(SltStats, left_bound);
    MEMBER(SltStats, boxes);
    MEMBER(SltStats, stopped);
    MEMBER(SltStats, upset);
    MEMBER(SltStats, upset_line);
    MEMBER(SltStats, ulps);
    MEMBER(SltStats, dropped_at);
    MEMBER(SltStats, nonfinite_at);
    MEMBER(SltStats, singular);
    MEMBER(SltStats, out_of_range);
    MEMBER(SltStats, out_of_range_at);
    MEMBER(SltStats, unmet);
    MEMBER(SltStats, unmet_at);
    MEMBER(SltStats, blind);
    MEMBER(SltStats, blind_at);
    END(SltStats);
    STRUCT(SltIntegral);
    MEMBER(SltIntegral, struct_size);
    MEMBER(SltIntegral, value);
    MEMBER(SltIntegral, value_stderr);
    MEMBER(SltIntegral, gradient);
    MEMBER(SltIntegral, gradient_stderr);
    MEMBER(SltIntegral, interior);
    MEMBER(SltIntegral, boundary);
    MEMBER(SltIntegral, missed_estimate);
    MEMBER(SltIntegral, replicates);
    MEMBER(SltIntegral, mixed);
    MEMBER(SltIntegral, left_bound);
    END(SltIntegral);
    STRUCT(SltCrossing);
    MEMBER(SltCrossing, struct_size);
    MEMBER(SltCrossing, found);
    MEMBER(SltCrossing, x);
    MEMBER(SltCrossing, t);
    MEMBER(SltCrossing, g);
    MEMBER(SltCrossing, dg);
    MEMBER(SltCrossing, f_before);
    MEMBER(SltCrossing, f_after);
    MEMBER(SltCrossing, site);
    MEMBER(SltCrossing, k);
    MEMBER(SltCrossing, drop);
    END(SltCrossing);
    STRUCT(SltWarning);
    MEMBER(SltWarning, struct_size);
    MEMBER(SltWarning, severity);
    MEMBER(SltWarning, code);
    MEMBER(SltWarning, at);
    MEMBER(SltWarning, text);
    END(SltWarning);
    STRUCT(SltOpenEvent);
    MEMBER(SltOpenEvent, edge);
    MEMBER(SltOpenEvent, loops);
    MEMBER(SltOpenEvent, k);
    MEMBER(SltOpenEvent, kind);
    MEMBER(SltOpenEvent, file);
    MEMBER(SltOpenEvent, text);
    MEMBER(SltOpenEvent, line);
    MEMBER(SltOpenEvent, column);
    MEMBER(SltOpenEvent, g);
    MEMBER(SltOpenEvent, dg);
    MEMBER(SltOpenEvent, boundary);
    MEMBER(SltOpenEvent, seam);
    MEMBER(SltOpenEvent, jumps);
    MEMBER(SltOpenEvent, bends);
    END(SltOpenEvent);
    STRUCT(SltBound);
    MEMBER(SltBound, struct_size);
    MEMBER(SltBound, settled);
    MEMBER(SltBound, unknown);
    MEMBER(SltBound, rough);
    MEMBER(SltBound, count);
    MEMBER(SltBound, listed);
    MEMBER(SltBound, open);
    MEMBER(SltBound, lo);
    MEMBER(SltBound, hi);
    END(SltBound);
    STRUCT(SltSet);
    MEMBER(SltSet, name);
    MEMBER(SltSet, value);
    END(SltSet);
    STRUCT(SltOptions);
    MEMBER(SltOptions, struct_size);
    MEMBER(SltOptions, entry);
    MEMBER(SltOptions, set);
    MEMBER(SltOptions, nset);
    MEMBER(SltOptions, param_files);
    MEMBER(SltOptions, nparam_files);
    MEMBER(SltOptions, import_dirs);
    MEMBER(SltOptions, nimport_dirs);
    MEMBER(SltOptions, stdlib_dir);
    MEMBER(SltOptions, f64);
    MEMBER(SltOptions, disc_auto);
    MEMBER(SltOptions, seed);
    MEMBER(SltOptions, width);
    MEMBER(SltOptions, interpret);
    MEMBER(SltOptions, no_cache);
    MEMBER(SltOptions, target);
    MEMBER(SltOptions, near_miss);
    MEMBER(SltOptions, rgba8);
    MEMBER(SltOptions, paper_argmin);
    MEMBER(SltOptions, paper_forced);
    MEMBER(SltOptions, path_hash);
    MEMBER(SltOptions, dump);
    MEMBER(SltOptions, verify);
    MEMBER(SltOptions, field);
    MEMBER(SltOptions, verify_after);
    MEMBER(SltOptions, stop_after);
    MEMBER(SltOptions, sandbox);
    MEMBER(SltOptions, language);
    MEMBER(SltOptions, size);
    MEMBER(SltOptions, lengths);
    END(SltOptions);
    STRUCT(SltDiagnostic);
    MEMBER(SltDiagnostic, struct_size);
    MEMBER(SltDiagnostic, severity);
    MEMBER(SltDiagnostic, code);
    MEMBER(SltDiagnostic, message);
    MEMBER(SltDiagnostic, file);
    MEMBER(SltDiagnostic, line);
    MEMBER(SltDiagnostic, column);
    END(SltDiagnostic);
    STRUCT(SltParam);
    MEMBER(SltParam, struct_size);
    MEMBER(SltParam, name);
    MEMBER(SltParam, type);
    MEMBER(SltParam, fbase);
    MEMBER(SltParam, fcount);
    MEMBER(SltParam, ibase);
    MEMBER(SltParam, icount);
    MEMBER(SltParam, differentiable);
    MEMBER(SltParam, is_texture);
    MEMBER(SltParam, is_heightfield);
    MEMBER(SltParam, has_range);
    MEMBER(SltParam, log);
    MEMBER(SltParam, color);
    MEMBER(SltParam, lo);
    MEMBER(SltParam, hi);
    MEMBER(SltParam, doc);
    MEMBER(SltParam, tex_w);
    MEMBER(SltParam, tex_h);
    MEMBER(SltParam, tex_c);
    MEMBER(SltParam, kind);
    MEMBER(SltParam, rank);
    MEMBER(SltParam, shape);
    MEMBER(SltParam, fstride);
    MEMBER(SltParam, istride);
    MEMBER(SltParam, nfields);
    MEMBER(SltParam, layout);
    MEMBER(SltParam, has_extent);
    MEMBER(SltParam, extent);
    MEMBER(SltParam, height_scale);
    MEMBER(SltParam, height_offset);
    MEMBER(SltParam, tex_d);
    END(SltParam);
    ENUM(SltFitMetric);
    VALUE(SLT_FIT_L2);
    VALUE(SLT_FIT_L1);
    VALUE(SLT_FIT_HUBER);
    ENUM(SltFitSchedule);
    VALUE(SLT_FIT_CONSTANT);
    VALUE(SLT_FIT_EXPONENTIAL);
    VALUE(SLT_FIT_COSINE);
    STRUCT(SltFitView);
    MEMBER(SltFitView, struct_size);
    MEMBER(SltFitView, target);
    MEMBER(SltFitView, mask);
    MEMBER(SltFitView, values);
    MEMBER(SltFitView, nvalues);
    MEMBER(SltFitView, program);
    END(SltFitView);
    STRUCT(SltFitNumber);
    MEMBER(SltFitNumber, name);
    MEMBER(SltFitNumber, value);
    END(SltFitNumber);
    STRUCT(SltFitMask);
    MEMBER(SltFitMask, name);
    MEMBER(SltFitMask, width);
    MEMBER(SltFitMask, height);
    MEMBER(SltFitMask, factors);
    END(SltFitMask);
    STRUCT(SltFitRequest);
    MEMBER(SltFitRequest, struct_size);
    MEMBER(SltFitRequest, iteration);
    MEMBER(SltFitRequest, view);
    MEMBER(SltFitRequest, views);
    MEMBER(SltFitRequest, pixels);
    MEMBER(SltFitRequest, channels);
    MEMBER(SltFitRequest, image);
    END(SltFitRequest);
    STRUCT(SltFitIteration);
    MEMBER(SltFitIteration, struct_size);
    MEMBER(SltFitIteration, iteration);
    MEMBER(SltFitIteration, count);
    MEMBER(SltFitIteration, index);
    MEMBER(SltFitIteration, parameters);
    MEMBER(SltFitIteration, gradient);
    MEMBER(SltFitIteration, loss);
    MEMBER(SltFitIteration, best);
    MEMBER(SltFitIteration, image);
    END(SltFitIteration);
    STRUCT(SltFitOptions);
    MEMBER(SltFitOptions, struct_size);
    MEMBER(SltFitOptions, job);
    MEMBER(SltFitOptions, views);
    MEMBER(SltFitOptions, nviews);
    MEMBER(SltFitOptions, loss);
    MEMBER(SltFitOptions, loss_user);
    MEMBER(SltFitOptions, loss_name);
    MEMBER(SltFitOptions, minimize);
    MEMBER(SltFitOptions, optimizer);
    MEMBER(SltFitOptions, iterations);
    MEMBER(SltFitOptions, rates);
    MEMBER(SltFitOptions, nrates);
    MEMBER(SltFitOptions, rate_masks);
    MEMBER(SltFitOptions, nrate_masks);
    MEMBER(SltFitOptions, smooth);
    MEMBER(SltFitOptions, nsmooth);
    MEMBER(SltFitOptions, beta1);
    MEMBER(SltFitOptions, beta2);
    MEMBER(SltFitOptions, epsilon);
    MEMBER(SltFitOptions, momentum);
    MEMBER(SltFitOptions, history);
    MEMBER(SltFitOptions, gradient_tolerance);
    MEMBER(SltFitOptions, loss_tolerance);
    MEMBER(SltFitOptions, patience);
    MEMBER(SltFitOptions, max_failures);
    MEMBER(SltFitOptions, checkpoint);
    MEMBER(SltFitOptions, every);
    MEMBER(SltFitOptions, resume);
    MEMBER(SltFitOptions, iterated);
    MEMBER(SltFitOptions, iterated_user);
    MEMBER(SltFitOptions, stats);
    MEMBER(SltFitOptions, metric);
    MEMBER(SltFitOptions, huber_delta);
    MEMBER(SltFitOptions, loss_entry);
    MEMBER(SltFitOptions, schedule);
    MEMBER(SltFitOptions, views_per_step);
    MEMBER(SltFitOptions, decay);
    MEMBER(SltFitOptions, smooth_faces);
    MEMBER(SltFitOptions, nsmooth_faces);
    MEMBER(SltFitOptions, first);
    MEMBER(SltFitOptions, planned);
    MEMBER(SltFitOptions, smooth_grids);
    MEMBER(SltFitOptions, nsmooth_grids);
    END(SltFitOptions);
    ENUM(SltFitStop);
    VALUE(SLT_FIT_RUNNING);
    VALUE(SLT_FIT_ITERATIONS);
    VALUE(SLT_FIT_CONVERGED);
    VALUE(SLT_FIT_STOPPED);
    VALUE(SLT_FIT_INTERRUPTED);
    VALUE(SLT_FIT_TIME_LIMIT);
    VALUE(SLT_FIT_FAILED);
    STRUCT(SltFitResult);
    MEMBER(SltFitResult, struct_size);
    MEMBER(SltFitResult, stop);
    MEMBER(SltFitResult, iterations);
    MEMBER(SltFitResult, initial_loss);
    MEMBER(SltFitResult, loss);
    MEMBER(SltFitResult, losses);
    MEMBER(SltFitResult, reason);
    END(SltFitResult);
}

static char *read_text(const char *path) {
    static char text[1 << 16];
    FILE *f = fopen(path, "r");
    if (!f) fail_msg("cannot read %s", path);
    text[fread(text, 1, sizeof text - 1, f)] = 0;
    fclose(f);
    return text;
}

static char *layout_text(void) {
    char *text = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    assert_non_null(out);
    write_layout(out);
    fclose(out);
    return text;
}

static void layout(void **state) {
    (void)state;
    static const char path[] = SALTUS_TEST_DIR "/abi/layout.txt";
    char *text = layout_text();
    const char *bless = getenv("BLESS");
    if (bless && !strcmp(bless, "1")) {
        FILE *f = fopen(path, "w");
        assert_non_null(f);
        fputs(text, f);
        fclose(f);
    }
    assert_string_equal(text, read_text(path));
    free(text);
}

/* Nothing that the headers of the library define is left out above. */
static void complete(void **state) {
    (void)state;
    static const char *const headers[] = {"status.h", "job.h", "saltus.h", "fit.h"};
    static const char *const kinds[] = {"struct", "enum"};
    char *text = layout_text();
    for (size_t h = 0; h < sizeof headers / sizeof *headers; h++)
        for (int k = 0; k < 2; k++) {
            char path[512], begin[32], name[64], line[96];
            snprintf(path, sizeof path, "%s/../include/saltus/%s", SALTUS_TEST_DIR, headers[h]);
            snprintf(begin, sizeof begin, "typedef %s ", kinds[k]);
            for (const char *at = read_text(path); (at = strstr(at, begin)); at++) {
                char brace = 0;
                if (sscanf(at + strlen(begin), "%63s %c", name, &brace) != 2 || brace != '{') continue; /* opaque */
                snprintf(line, sizeof line, "%s %s%s", kinds[k], name, k ? "\n" : ":");
                if (!strstr(text, line)) fail_msg("%s %s of %s has no rows", kinds[k], name, headers[h]);
            }
        }
    free(text);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(layout), cmocka_unit_test(complete)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
