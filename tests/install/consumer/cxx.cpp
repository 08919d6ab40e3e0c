// The headers are C++ too.
#include <cstring>
#include <saltus/fit.h>

int main() {
    SltOptions options = SLT_OPTIONS_INIT;
    SltJob job = SLT_JOB_INIT;
    SltStats stats = SLT_STATS_INIT;
    SltIntegral integral = SLT_INTEGRAL_INIT;
    SltCrossing crossing = SLT_CROSSING_INIT;
    SltParam param = SLT_PARAM_INIT;
    SltDiagnostic diagnostic = SLT_DIAGNOSTIC_INIT;
    SltProgram *p = nullptr;
    SltStatus status = slt_compile_string("param float a = 2.0; shader float main(float2 x) { return a * x.x; }", "line", &options, &p);
    bool right = status == SLT_OK && slt_channels(p) == 1 && std::strcmp(slt_entry(p), "main") == 0;
    const double at[2] = {3, 4}, zero[3] = {0, 0, 0};
    double f = 0, value = 0;
    integral.value = &value, job.integral = true, job.samples = 64;
    right = right && slt_eval(p, &job, 1, at, nullptr, &f, &stats, nullptr) == SLT_OK && f == 6 && stats.samples == 1;
    right = right && slt_grad_integral(p, &job, &integral, &stats, nullptr) == SLT_OK;
    right = right && slt_crossing(p, &job, zero, zero, 0, &crossing, nullptr) == SLT_OK && !crossing.found;
    right = right && slt_param(p, 0, &param) && param.rank == 0 && !slt_diagnostic(p, 1000, &diagnostic);
    SltFitOptions fit = SLT_FIT_OPTIONS_INIT;
    SltFitView view = SLT_FIT_VIEW_INIT;
    SltFitResult result = SLT_FIT_RESULT_INIT;
    fit.views = &view, fit.nviews = 1;
    right = right && slt_fit(p, &fit, &result, nullptr) == SLT_USAGE && result.stop == SLT_FIT_FAILED; // it has no target
    slt_program_free(p);
    return right ? 0 : 1;
}
