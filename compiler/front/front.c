/* The whole front end: a source becomes a Program. */
#include "compiler/front/front.h"

Module *front_check(Session *s, int file, const FrontOptions *opt, Func **entry) {
    Module *main = load_modules(s, file);
    *entry = NULL;
    for (const Module *m = main; m; m = m->next)
        if (m->unusable) return main;
    /* After syntax errors the rest is checked all the same: all errors of a file in one run. */
    *entry = check_program(s, main, opt);
    return main;
}

static Program *compile(Session *s, int file, const ProgramOptions *opt) {
    Func *entry;
    Module *main = front_check(s, file, &opt->front, &entry);
    if (!entry || s->nerrors) return NULL;
    Program *p = gen_program(s, main, entry, opt);
    return s->nerrors ? NULL : p;
}

Program *front_compile(Session *s, int file, const ProgramOptions *opt) {
    if (!opt->front.glsl) return compile(s, file, opt);
    for (int k = 0; k < 2; k++) s->sources[file].glsl[k] = opt->front.size[k] ? opt->front.size[k] : GLSL_SIZE;
    Program *p = compile(s, file, opt);
    glsl_speak(s);
    return p;
}
