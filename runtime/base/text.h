/* Text that grows in memory, as a stream. What the system has for it, open_memstream, drops what there is no memory for
 * and says nothing; here the text is whole or there is none. */
#ifndef SALTUS_RUNTIME_BASE_TEXT_H
#define SALTUS_RUNTIME_BASE_TEXT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

typedef struct Text {
    char *data;
    size_t size, capacity;
    bool failed;
    FILE *out; /* to print to; NULL: out of memory */
} Text;

FILE *text_open(Text *t);  /* t stays where it is until text_close; returns t->out */
char *text_close(Text *t); /* malloc'd and ended by a 0, which t->size does not count; NULL: out of memory */

#endif
