/* Counts the instructions of a kernel in the assembly that LLVM writes. With its notes on, it says of every access to
 * the stack whether that is a spill: `movaps %xmm1, 16(%rsp)  # 16-byte Spill`. */
#include <stdlib.h>
#include <string.h>

#include "compiler/back/cost.h"
#include "saltus/status.h"

static bool begins(const char *s, const char *with) { return !strncmp(s, with, strlen(with)); }

/* The mnemonic without the v of AVX. */
static const char *plain(const char *s) { return *s == 'v' ? s + 1 : s; }

/* divps, divsd, sqrtss ...: not div and idiv, which are of integers. */
static bool is_of_floats(const char *s, const char *name) {
    size_t n = strlen(name);
    return begins(s, name) && (s[n] == 'p' || s[n] == 's') && (s[n + 1] == 's' || s[n + 1] == 'd');
}

static void count_call(Session *s, const char *target, size_t n, const char *kernel, Listing *out) {
    const char *name = NULL;
    if (*target != '*') {
        const char *at = memchr(target, '@', n);
        name = arena_printf(&s->session, "%.*s", (int)(at ? at - target : (ptrdiff_t)n), target);
        if (begins(name, kernel) && begins(name + strlen(kernel), ".part")) return; /* its own parts */
    }
    for (uint32_t c = 0; c < out->ncalls; c++)
        if (name ? out->calls[c].name && !strcmp(out->calls[c].name, name) : !out->calls[c].name) {
            out->calls[c].count++;
            return;
        }
    if (out->ncalls < sizeof out->calls / sizeof *out->calls) out->calls[out->ncalls++] = (Call){name, 1};
}

static bool has(const char *line, size_t n, const char *word) {
    size_t w = strlen(word);
    for (size_t i = 0; i + w <= n; i++)
        if (!memcmp(line + i, word, w)) return true;
    return false;
}

static void count_instruction(Session *s, const char *line, size_t n, const char *kernel, Listing *out) {
    const char *note = memchr(line, '#', n), *op = plain(line);
    size_t code = note ? (size_t)(note - line) : n;
    out->instructions++;
    if (note) {
        size_t rest = n - code;
        out->spills += has(note, rest, "Spill");
        out->reloads += has(note, rest, "Reload");
    }
    out->divisions += is_of_floats(op, "div");
    out->roots += is_of_floats(op, "sqrt");
    out->gathers += begins(op, "gather") || begins(op, "pgather");
    out->scatters += begins(op, "scatter") || begins(op, "pscatter");
    size_t word = strcspn(line, " \t\n");
    bool tail = begins(line, "jmp") && note && has(note, n - code, "TAILCALL");
    if (!begins(line, "call") && !tail) return;
    const char *target = line + word + strspn(line + word, " \t");
    count_call(s, target, strcspn(target, " \t\n#"), kernel, out);
}

void back_count_listing(Session *s, const char *text, const char *kernel, Listing *out) {
    *out = (Listing){0};
    for (const char *line = text; *line;) {
        size_t n = strcspn(line, "\n"), skip = strspn(line, "\t ");
        /* Labels begin in the first column, directives with a dot. */
        if (skip && skip < n && line[skip] != '.' && line[skip] != '#')
            count_instruction(s, line + skip, n - skip, kernel, out);
        line += n + (line[n] == '\n');
    }
}

int back_listing(Session *s, const KernelRequest *k, const BackOptions *o, Listing *out, const char **why) {
    unsigned char *bytes;
    size_t size;
    int status = back_emit(s, k, 1, o, 'a', &bytes, &size, why);
    if (status) return status;
    char *text = malloc(size + 1);
    if (text) {
        memcpy(text, bytes, size);
        text[size] = 0;
        back_count_listing(s, text, k->name, out);
    } else {
        *why = "out of memory";
        status = SLT_LIMIT;
    }
    free(text);
    free(bytes);
    return status;
}
