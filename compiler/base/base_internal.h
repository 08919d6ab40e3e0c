/* Shared by the files of this folder only. */
#ifndef SALTUS_BASE_INTERNAL_H
#define SALTUS_BASE_INTERNAL_H

#include "compiler/base/session.h"

/* utf8.c: decodes one code point at text[0..len), len > 0; returns its bytes. A byte that starts no valid sequence
 * gives U+FFFD with one byte. */
uint32_t utf8_decode(const char *text, size_t len, uint32_t *code);
/* Terminal columns of a code point: 0, 1 or 2. */
int utf8_width(uint32_t code);
/* Writes a code point (at most 4 bytes, no terminator); returns the count. */
int utf8_encode(uint32_t code, char out[4]);
/* Controls, and the marks that reorder text on a terminal: never to be printed as they are. */
bool utf8_unprintable(uint32_t code);

/* diag.c: the line (from 0) of a byte, and a line's first byte (behind a byte order mark) and end (before its break).
 */
uint32_t source_line(const Source *src, uint32_t pos);
uint32_t source_shown(const Source *src, uint32_t pos); /* the byte, or the nearest one that people wrote */
uint32_t source_line_start(const Source *src, uint32_t line);
uint32_t source_line_end(const Source *src, uint32_t line);

/* A byte offset as people and editors count it, all from 0: code points and UTF-16 units before it on its line. */
typedef struct Place {
    uint32_t pos, line, column, unit;
} Place;
/* `before` (or NULL) is an earlier place of the same file: on a line of megabytes with many errors, counting goes on
 * from there. */
Place place_find(const Source *src, uint32_t pos, const Place *before);

/* diag.c: the diagnostics sorted by place in a malloc'ed array (NULL when there are none or memory is out). */
Diag **diag_sorted(const Session *s, uint32_t *n);

#endif
