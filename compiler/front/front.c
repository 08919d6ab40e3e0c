/* The whole front end: a source becomes a Program. */
#include "compiler/front/front.h"

Program *front_compile(Session *s, int file, const ProgramOptions *opt) {
    Module *main = load_modules(s, file);
    if (!main || s->nerrors) return NULL;
    Func *entry = check_program(s, main, &opt->front);
    if (!entry || s->nerrors) return NULL;
    Program *p = lower_program(s, main, entry, opt);
    return s->nerrors ? NULL : p;
}
