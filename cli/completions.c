/* Scripts that complete command lines, for three shells, from verbs.def and options.def. Options for work on the
 * compiler are left out, as they are in the help. */
#include <string.h>

#include "cli/cli.h"

typedef struct Row {
    const char *name, *arg; /* as in options.def */
    uint32_t verbs;
    const char *help;
} Row;

static const Row rows[] = {
#define OPTION(option, argument, takers, text, setter) {option, argument, takers, text},
#include "cli/options.def"
#undef OPTION
};
enum { ROWS = sizeof rows / sizeof *rows };

static const struct {
    const char *name, *what;
} verbs[] = {
#define VERB(id, name, usage, what, example) {#name, what},
#include "cli/verbs.def"
#undef VERB
};

/* What an option's value is. */
typedef enum Value { NO_VALUE, A_FILE, A_FOLDER, ONE_OF, ANY } Value;

static bool takes(const Row *r, int verb) { return r->verbs & 1u << verb && !(r->verbs & INNER); }

static Value value_of(const Row *r) {
    if (!r->arg || !strncmp(r->arg, "[=", 2)) return NO_VALUE;
    if (!strcmp(r->arg, "FILE") || !strcmp(r->arg, "IMAGE") || !strncmp(r->arg, "OUT.", 4)) return A_FILE;
    if (!strcmp(r->arg, "DIR")) return A_FOLDER;
    return strchr(r->arg, '|') && r->arg[0] >= 'a' ? ONE_OF : ANY; /* N|WxH is no choice */
}

/* a|b|c with blanks between. */
static void put_choices(FILE *out, const char *arg) {
    for (; *arg; arg++) fputc(*arg == '|' ? ' ' : *arg, out);
}

/* Text inside of single quotes. `special` are the characters that take a backslash before them. */
static void put_quoted(FILE *out, const char *text, const char *special) {
    for (; *text; text++)
        if (*text == '\'') fputs("'\\''", out);
        else if (strchr(special, *text)) fprintf(out, "\\%c", *text);
        else fputc(*text, out);
}

/* ---- bash */
static void bash_values(FILE *out, Value value, const char *line) {
    for (int i = 0, n = 0; i <= ROWS; i++)
        if (i < ROWS && value_of(&rows[i]) == value && !(rows[i].verbs & INNER))
            fprintf(out, "%s%s", n++ ? "|" : "    ", rows[i].name);
        else if (i == ROWS) fprintf(out, ") %s ;;\n", line);
}

static void put_bash(FILE *out) {
    fputs("# bash completion of saltus, made by `saltus completions bash`\n"
          "_saltus() {\n"
          "  local cur=${COMP_WORDS[COMP_CWORD]} prev=${COMP_WORDS[COMP_CWORD - 1]} verb=${COMP_WORDS[1]} words=\n"
          "  COMPREPLY=()\n"
          "  # --option=value is three words here\n"
          "  [[ $cur == '=' ]] && cur=\n"
          "  [[ $prev == '=' ]] && prev=${COMP_WORDS[COMP_CWORD - 2]}\n"
          "  if [[ $COMP_CWORD == 1 ]]; then\n"
          "    COMPREPLY=($(compgen -W '",
          out);
    for (int v = 0; v < VERB_COUNT; v++) fprintf(out, "%s ", verbs[v].name);
    fputs("completions version --version --help' -- \"$cur\"))\n    return\n  fi\n"
          "  if [[ $verb == completions ]]; then\n"
          "    COMPREPLY=($(compgen -W 'bash zsh fish' -- \"$cur\"))\n    return\n  fi\n"
          "  if [[ $cur == @* ]]; then # --param p=@FILE\n"
          "    COMPREPLY=($(compgen -P @ -f -- \"${cur#@}\"))\n    return\n  fi\n"
          "  case $prev in\n",
          out);
    for (int i = 0; i < ROWS; i++) {
        if (rows[i].verbs & INNER || value_of(&rows[i]) != ONE_OF) continue;
        fprintf(out, "    %s) words='", rows[i].name);
        put_choices(out, rows[i].arg);
        fputs("' ;;\n", out);
    }
    bash_values(out, A_FILE, "COMPREPLY=($(compgen -f -- \"$cur\")); return");
    bash_values(out, A_FOLDER, "COMPREPLY=($(compgen -d -- \"$cur\")); return");
    bash_values(out, ANY, "return");
    fputs("  esac\n  if [[ -z $words && $cur == -* ]]; then\n    case $verb in\n", out);
    for (int v = 0; v < VERB_COUNT; v++) {
        fprintf(out, "      %s) words='", verbs[v].name);
        for (int i = 0, n = 0; i < ROWS; i++)
            if (takes(&rows[i], v)) fprintf(out, "%s%s", n++ ? " " : "", rows[i].name);
        fputs("' ;;\n", out);
    }
    fputs("    esac\n  fi\n"
          "  if [[ -n $words ]]; then COMPREPLY=($(compgen -W \"$words\" -- \"$cur\"))\n"
          "  else COMPREPLY=($(compgen -f -- \"$cur\")); fi\n"
          "}\ncomplete -o filenames -F _saltus saltus\n",
          out);
}

/* ---- zsh */
static void zsh_option(FILE *out, const Row *r) {
    Value value = value_of(r);
    /* -o FILE and -oFILE, --size N and --size=N */
    fprintf(out, " \\\n        '%s%s[", r->name, value == NO_VALUE ? "" : r->name[1] == '-' ? "=" : "+");
    put_quoted(out, r->help, "[]:\\");
    fputc(']', out);
    if (value != NO_VALUE) {
        fputc(':', out);
        put_quoted(out, value == ONE_OF ? "one of" : r->arg, "[]:\\");
        fputc(':', out);
    }
    if (value == A_FILE) fputs("_files", out);
    if (value == A_FOLDER) fputs("_files -/", out);
    if (value == ONE_OF) fputc('(', out), put_choices(out, r->arg), fputc(')', out);
    fputc('\'', out);
}

static void put_zsh(FILE *out) {
    fputs("#compdef saltus\n# zsh completion of saltus, made by `saltus completions zsh`\n"
          "_saltus() {\n  if (( CURRENT == 2 )); then\n    local -a verbs=(\n",
          out);
    for (int v = 0; v < VERB_COUNT; v++) {
        fprintf(out, "      '%s:", verbs[v].name);
        put_quoted(out, verbs[v].what, ":\\");
        fputs("'\n", out);
    }
    fputs("      'completions:the script that completes command lines'\n      'version:what this is'\n    )\n"
          "    _describe command verbs\n    return\n  fi\n"
          "  local verb=$words[2]\n  shift words\n  (( CURRENT-- ))\n  case $verb in\n"
          "    completions) _arguments '1:shell:(bash zsh fish)' ;;\n",
          out);
    for (int v = 0; v < VERB_COUNT; v++) {
        fprintf(out, "    %s)\n      _arguments", verbs[v].name);
        for (int i = 0; i < ROWS; i++)
            if (takes(&rows[i], v)) zsh_option(out, &rows[i]);
        fputs(" \\\n        '*:file:_files' ;;\n", out);
    }
    /* Read from fpath the file is the function; sourced it only tells of it. */
    fputs("  esac\n}\nif [[ $funcstack[1] == _saltus ]]; then _saltus \"$@\"; else compdef _saltus saltus; fi\n", out);
}

/* ---- fish */
static void put_fish(FILE *out) {
    fputs("# fish completion of saltus, made by `saltus completions fish`\n", out);
    for (int v = 0; v < VERB_COUNT; v++) {
        fprintf(out, "complete -c saltus -n __fish_use_subcommand -f -a %s -d '", verbs[v].name);
        put_quoted(out, verbs[v].what, "\\");
        fputs("'\n", out);
    }
    fputs("complete -c saltus -n __fish_use_subcommand -f -a completions -d 'the script that completes command lines'\n"
          "complete -c saltus -n '__fish_seen_subcommand_from completions' -f -a 'bash zsh fish'\n",
          out);
    for (int i = 0; i < ROWS; i++) {
        const Row *r = &rows[i];
        if (r->verbs & INNER) continue;
        fputs("complete -c saltus -n '__fish_seen_subcommand_from", out);
        for (int v = 0; v < VERB_COUNT; v++)
            if (takes(r, v)) fprintf(out, " %s", verbs[v].name);
        fprintf(out, "' -%c %s", r->name[1] == '-' ? 'l' : 's', r->name + (r->name[1] == '-' ? 2 : 1));
        Value value = value_of(r);
        if (value == A_FILE || value == A_FOLDER) fputs(" -r", out);
        if (value == ANY) fputs(" -x", out);
        if (value == ONE_OF) fputs(" -x -a '", out), put_choices(out, r->arg), fputc('\'', out);
        fputs(" -d '", out);
        for (const char *h = r->help; *h; h++) { /* quotes of fish know \' */
            if (*h == '\'' || *h == '\\') fputc('\\', out);
            fputc(*h, out);
        }
        fputs("'\n", out);
    }
}

bool cli_completions(FILE *out, const char *shell) {
    static void (*const put[])(FILE *out) = {put_bash, put_zsh, put_fish};
    int pick = cli_choice("bash|zsh|fish", shell);
    if (pick >= 0) put[pick](out);
    return pick >= 0;
}
