// The headers are C++ too.
#include <cstring>
#include <saltus/fit.h>

int main() {
    SltOptions options = SLT_OPTIONS_INIT;
    SltProgram *p = nullptr;
    SltStatus status = slt_compile_string("shader float main(float2 x) { return x.x; }", "line", &options, &p);
    bool right = status == SLT_OK && slt_channels(p) == 1 && std::strcmp(slt_entry(p), "main") == 0;
    SltFitOptions fit = SLT_FIT_OPTIONS_INIT;
    fit.minimize = true;
    right = right && slt_fit(p, &fit, nullptr, nullptr) == SLT_USAGE; // it has no parameters
    slt_program_free(p);
    return right ? 0 : 1;
}
