/* A growing string in an arena, and the text of instructions: what print.c and verify.c share. */
#ifndef SALTUS_IR_TEXT_H
#define SALTUS_IR_TEXT_H

#include <stdarg.h>

#include "compiler/ir/ir.h"

typedef struct Text {
    Arena *arena;
    char *data; /* NUL-terminated once anything was added */
    size_t len, cap;
} Text;

void text_add(Text *t, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
void text_addv(Text *t, const char *fmt, va_list values) __attribute__((format(printf, 2, 0)));
/* One instruction without its regions and without a newline. Safe on broken IR. */
void text_inst(Text *t, const Inst *i);

/* Names that print.c writes and parse.c reads. */
extern const char *const ir_input_names[SLT_INPUTS];
extern const char *const ir_site_kinds[SLT_SITE_KINDS];
extern const char *const ir_counter_names[SLT_COUNTERS];
/* The name of an output: its role's text, with its number behind where the role may have several ("f.0", "hash"). */
typedef struct OutputText {
    const char *text;
    uint32_t most; /* outputs of this role in one Fn */
} OutputText;
extern const OutputText ir_output_texts[SLT_ROLES];
extern const char ir_type_letters[TY_TAPE + 1]; /* . b i f a t */
/* Special rows whose result type the text spells out: the signature begins with '?'. */
bool ir_spells_type(Op op);

#endif
