/* The integral of a disc and its derivative, through the installed library and a module that only the installed
 * standard library has. */
#include <math.h>
#include <saltus/saltus.h>
#include <stdio.h>

static const char source[] = "import only_installed;\n"
                             "param float radius = 0.5;\n"
                             "[Domain(-1.0, 1.0)] shader float main(float2 x) {\n"
                             "    float f = 0.0;\n"
                             "    [Disc] if (disc_of_the_installed(x, radius) < 0.0) f = 1.0;\n"
                             "    return f;\n"
                             "}\n";

int main(void) {
    SltOptions options = SLT_OPTIONS_INIT;
    SltProgram *p;
    SltError err = {0};
    SltJob job = SLT_JOB_INIT;
    job.integral = true;
    job.samples = 1 << 14;
    job.threads = 1;
    double value = 0, gradient = 0;
    SltIntegral out = {.struct_size = sizeof out, .value = &value, .gradient = &gradient};
    SltStats stats = SLT_STATS_INIT;
    SltStatus status = slt_compile_string(source, "disc", &options, &p);
    if (status == SLT_OK) status = slt_grad_integral(p, &job, &out, &stats, &err);
    if (status != SLT_OK) fprintf(stderr, "%s%s\n", slt_diagnostics_text(p), err.text);
    slt_program_free(p);
    printf("saltus %s: %g, %g\n", slt_version(), value, gradient);
    bool right = fabs(value - 0.25 * M_PI) < 1e-2 && fabs(gradient - M_PI) < 1e-2 * M_PI;
    return status != SLT_OK ? (int)status : right ? 0 : 99;
}
