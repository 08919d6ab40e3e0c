/* Tables of numbers, for parameters that come from files. */
#include "internal.h"

#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/base/decimal.h"

void table_free(Table *t) {
    if (t) {
        free(t->data);
        *t = (Table){0};
    }
}

static bool is_separator(char c) { return c == ',' || c == ';' || c == '\t' || c == ' ' || c == '\r'; }

typedef struct Line {
    size_t numbers;    /* appended to the table */
    bool words;        /* some field is not a number */
    bool any;          /* some field at all */
    size_t bad_column; /* 1-based column of the first field that is not a number */
    char bad[40];      /* and its text */
} Line;

/* Reads one line's fields. Blanks separate; between two commas there must be a number. */
static Line read_line(const char *p, const char *end, Bytes *numbers) {
    Line line = {0};
    for (;;) {
        while (p < end && (*p == ' ' || *p == '\t' || *p == '\r')) p++;
        if (p >= end || *p == '#') break;
        line.any = true;
        size_t column = line.numbers + 1;
        const char *after = NULL;
        double v = 0;
        bool hex = p + 1 < end && p[0] == '0' && (p[1] == 'x' || p[1] == 'X');
        if (*p != ',' && *p != ';' && !hex) v = decimal_read(p, &after);
        if (!after || after == p || after > end || (after < end && !is_separator(*after) && *after != '#')) {
            size_t n = 0;
            const char *q = p;
            while (q < end && !is_separator(*q) && n < sizeof line.bad - 1) line.bad[n++] = *q++;
            line.bad[n] = 0;
            line.words = true;
            line.bad_column = column;
            return line;
        }
        image_bytes_append(numbers, &v, sizeof v);
        line.numbers++;
        p = after;
        while (p < end && (*p == ' ' || *p == '\t' || *p == '\r')) p++;
        if (p < end && (*p == ',' || *p == ';')) p++;
    }
    return line;
}

/* True when no field of the line is a number: a line of column names. */
static bool is_header(const char *p, const char *end) {
    bool any = false;
    while (p < end) {
        while (p < end && (is_separator(*p) || *p == '"')) p++;
        if (p >= end) break;
        const char *after;
        decimal_read(p, &after);
        if (after > p && after <= end && (after == end || is_separator(*after) || *after == '"')) return false;
        any = true;
        while (p < end && !is_separator(*p)) p++;
    }
    return any;
}

/* `text` is NUL-terminated at text[size]. */
static SltStatus parse_csv(const char *name, const char *text, size_t size, Table *out, SltError *err) {
    const char *p = text, *end = text + size;
    Bytes numbers = {0};
    size_t rows = 0, cols = 0, line_number = 0;
    SltStatus status = SLT_OK;
    if (memchr(text, 0, size)) return status_fail(err, SLT_INPUT, "cannot read '%s': it is not a text file", name);
    if (size >= 3 && memcmp(text, "\xef\xbb\xbf", 3) == 0) p += 3;
    bool first = true;
    while (p < end && !status) {
        const char *stop = memchr(p, '\n', (size_t)(end - p));
        stop = stop ? stop : end;
        line_number++;
        Line line = read_line(p, stop, &numbers);
        if (line.words && first && line.numbers == 0 && is_header(p, stop)) {
            first = false;
        } else if (line.words) {
            status = status_fail(err, SLT_INPUT, "cannot read '%s': line %zu, column %zu: '%s' is not a number", name,
                                 line_number, line.bad_column, line.bad);
        } else if (line.any) {
            first = false;
            if (rows > 0 && line.numbers != cols) {
                status =
                    status_fail(err, SLT_INPUT, "cannot read '%s': line %zu has %zu numbers, the lines before have %zu",
                                name, line_number, line.numbers, cols);
            }
            cols = line.numbers;
            rows++;
        }
        if (numbers.failed || numbers.size / sizeof(double) > IMAGE_MAX_SAMPLES)
            status = status_fail(err, SLT_LIMIT, "cannot read '%s': too many numbers", name);
        p = stop < end ? stop + 1 : end;
    }
    if (!status && rows == 0)
        status = status_fail(err, SLT_INPUT, "cannot read '%s': there are no numbers in it", name);
    if (status != SLT_OK) {
        image_bytes_free(&numbers);
        return status;
    }
    *out = (Table){.rows = rows, .cols = cols, .data = (double *)(void *)numbers.data};
    return SLT_OK;
}

SltStatus table_decode_csv(const char *name, const void *bytes, size_t size, Table *out, SltError *err) {
    *out = (Table){0};
    char *text = malloc(size + 1); /* numbers need an end */
    if (!text) return status_fail(err, SLT_LIMIT, "cannot read '%s': out of memory", name);
    if (size) memcpy(text, bytes, size);
    text[size] = 0;
    SltStatus status = parse_csv(name, text, size, out, err);
    free(text);
    return status;
}

static SltStatus table_from_image(const char *path, Table *out, SltError *err) {
    Image im;
    const ImageReadOptions raw = {.raw = true};
    SltStatus status = image_read(path, &raw, &im, err);
    if (status != SLT_OK) return status;
    size_t rows = (size_t)im.height, cols = (size_t)im.width * (size_t)im.channels;
    double *data = malloc(rows * cols * sizeof *data);
    if (!data) {
        image_free(&im);
        return status_fail(err, SLT_LIMIT, "cannot read '%s': out of memory", path);
    }
    for (size_t i = 0; i < rows * cols; i++) data[i] = im.data[i];
    image_free(&im);
    *out = (Table){.rows = rows, .cols = cols, .data = data};
    return SLT_OK;
}

SltStatus table_read(const char *path, Table *out, SltError *err) {
    char ext[16];
    *out = (Table){0};
    image_path_extension(path, ext);
    if (strcmp(ext, "npy") == 0) {
        NumArray a;
        SltStatus status = npy_read(path, &a, err);
        if (status == SLT_OK)
            *out = (Table){.rows = a.shape[0], .cols = a.shape[1] * a.shape[2] * a.shape[3], .data = a.data};
        return status;
    }
    if (!strcmp(ext, "csv") || !strcmp(ext, "tsv") || !strcmp(ext, "txt")) {
        uint8_t *bytes;
        size_t size;
        SltStatus status = file_read_all(path, &file_text, &bytes, &size, err);
        status = status ? status : table_decode_csv(path, bytes, size, out, err);
        free(bytes);
        return status;
    }
    const ImageFormat *format = image_find_format(path);
    if (format && format->as_table) return table_from_image(path, out, err);
    return status_fail(err, SLT_INPUT, "cannot read '%s': a table is .csv, .tsv, .txt, .npy or an image", path);
}
