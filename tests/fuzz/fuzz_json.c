/* Any bytes as a file of parameters, as the value of one, and as a name of one. */
#include <stdlib.h>
#include <string.h>

#include "bindings/c/api.h"
#include "tests/fuzz/fuzz.h"

static const char program[] =
    "struct In { float q; int tag; };\nstruct S { float2 c; In inner[2]; };\n"
    "param float a = 1.0;\nparam float3 v = float3(1.0);\nparam float2x2 m = float2x2(1.0, 2.0, 3.0, 4.0);\n"
    "param S s[2] = { { float2(1.0), { { 1.0, 1 }, { 2.0, 2 } } }, { float2(1.0), { { 1.0, 1 }, { 2.0, 2 } } } };\n"
    "param float w[2][3] = { { 1.0, 2.0, 3.0 }, { 4.0, 5.0, 6.0 } };\nparam texture2D t = zeros(3, 2, 2);\n"
    "param int n = 1;\nparam uint u = 1u;\nparam bool on = true;\n[Range(0.0, 1.0)] param float r = 0.5;\n"
    "shader float main(float2 x) { return a + v.x + m[0][1] + s[1].c.y + w[1][2] + t.sample(x).x + n + r; }\n";

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static SltProgram *p;
    if (!p) {
        SltOptions opt = SLT_OPTIONS_INIT;
        opt.interpret = true;
        if (slt_compile_string(program, "json.salt", &opt, &p) != SLT_OK) abort();
    }
    char *text = malloc(size + 1);
    if (!text || size > 1 << 16) return free(text), 0;
    memcpy(text, data, size);
    text[size] = 0;
    SltError err = {0};
    slt_set_params_json(p, text, "fuzz.json", &err);
    static const char *const names[] = {"a",       "v",         "m", "s", "w", "t", "n", "u", "on", "s[1].inner[0].q",
                                        "m[0][1]", "t[1][2][0]"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (text[0] != '@') slt_set_text(p, names[i], text, &err);
    SltParam found = SLT_PARAM_INIT;
    slt_param_find(p, text, &found, &err);
    const char *wrt[] = {text};
    slt_wrt(p, wrt, 1, &err);
    char *back = slt_params_json(p);
    if (!back) abort();
    /* What we write, we read. */
    if (slt_set_params_json(p, back, "back.json", &err) != SLT_OK) abort();
    free(back);
    free(text);
    return 0;
}
