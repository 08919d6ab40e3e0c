/* The language server: what the files of this folder share.
 *
 * One process reads messages and keeps documents; it never compiles. What must look into a program is a job: a child
 * (fork) that sees the documents as they were, compiles, writes its answer into a pipe and ends. So an analysis that
 * takes too long is ended, and one that crashes is an error message. LLVM is never loaded: jobs stop at the primal.
 *
 *   rpc.c        frames on standard input and output
 *   document.c   documents, edits, places
 *   server.c     messages, jobs
 *   analyse.c    a document's program: errors, warnings, the tree (jobs only, from here on)
 *   names.c      which name stands where, and what it stands for
 *   gradient.c   does a gradient reach it?
 *   hover.c      hover, signatures
 *   complete.c   completion
 *   outline.c    symbols, references
 *   format.c     the formatter
 *   words.c      lines about words: words.def */
#ifndef SALTUS_CLI_LSP_H
#define SALTUS_CLI_LSP_H

#include "cli/cli.h"
#include "compiler/front/front.h"

enum {
    LSP_MOST_MESSAGE = 64 << 20, /* bytes; a longer one is skipped */
    LSP_MOST_HEADER = 1 << 13,
    LSP_MOST_JOBS = 8, /* at once; then messages wait */
    LSP_MOST_DOCUMENTS = 1024,
    LSP_JOB_SECONDS = 10,
    LSP_MEMORY = 512 << 20 /* of a job's session */
};

/* Error codes of JSON-RPC and of the protocol. */
enum {
    RPC_PARSE_ERROR = -32700,
    RPC_INVALID_REQUEST = -32600,
    RPC_METHOD_NOT_FOUND = -32601,
    RPC_INVALID_PARAMS = -32602,
    RPC_INTERNAL_ERROR = -32603,
    RPC_NOT_INITIALIZED = -32002,
    RPC_REQUEST_FAILED = -32803,
    RPC_CANCELLED = -32800
};

/* ---- rpc.c */
typedef struct Rpc {
    char *data;
    size_t len, cap;
    size_t skip; /* bytes of a message that is too long */
} Rpc;
typedef enum RpcTake { RPC_NOTHING, RPC_MESSAGE, RPC_TOO_LONG, RPC_BROKEN, RPC_NO_MEMORY } RpcTake;
/* Reads what is there (once, waiting if need be); false: the end of the input. */
bool rpc_fill(Rpc *r, int fd);
/* The next whole message, malloc'd and ended by a 0. */
RpcTake rpc_take(Rpc *r, char **body, size_t *size);
bool rpc_send(const char *body, size_t size); /* false: nobody reads any more */
void rpc_free(Rpc *r);

/* ---- document.c */
typedef struct Document {
    char *uri, *path; /* path: without links; of what is no file, the uri */
    char *text;
    size_t len;
    int64_t version;
    bool glsl, is_file;
    bool stale;     /* something that it imports has changed */
    char **told;    /* uris that got diagnostics of this document */
    char **imports; /* paths of the sources behind it, as of the last check */
    uint32_t ntold, nimports;
    struct Document *next;
} Document;

char *document_path(const char *uri); /* malloc'd; NULL: no file */
char *document_uri(const char *path); /* malloc'd */
/* The byte of a place: lines end in LF, CR LF or CR; characters are UTF-16 units or, utf8, bytes. Clamped. */
size_t document_offset(const char *text, size_t len, uint32_t line, uint32_t character, bool utf8);
/* Applies one content change of didChange; false: it is not of that form, or memory is out. */
bool document_change(Document *d, json_t *change, bool utf8);
void document_free(Document *d);

/* ---- server.c */
typedef struct Asset { /* what a probe of a file has found */
    char *path;
    int64_t size, seconds, nanoseconds;
    int kind;
    uint32_t dims[4], ndims;
    struct Asset *next;
} Asset;
typedef struct Server {
    const Cli *cli;
    Document *documents;
    Asset *assets;
    bool utf8;
} Server;
Document *server_document(const Server *s, const char *uri);

/* ---- analyse.c */
typedef struct Analysis {
    const Server *server;
    const Document *document;
    Session *s;
    ProgramOptions options;
    int file;
    Module *main;
    FILE *out;       /* where a request's result goes */
    bool has_errors; /* of this file or of an import */
    Asset *probed;   /* files that this job has looked at */
} Analysis;
/* What a request writes into a->out, under the session's protection: its result. */
typedef void Request(Analysis *a, uint32_t offset, json_t *params);
/* A job: the document parsed and checked, then `run`; "null" where a limit was reached. */
void analyse_request(const Server *server, const Document *d, Request *run, uint32_t offset, json_t *params, FILE *out);
/* A job: diagnostics, a line of JSON for each step: {"files": [{"uri", "diagnostics"}], "imports", "assets", "last"}.
 */
void analyse_check(const Server *server, const Document *d, FILE *out);
/* The program of one shader of the main file as gen makes it; NULL after an error. */
Program *analyse_program(Analysis *a, Func *shader);
/* "range":{...}, and "uri":...,"range":{...}. */
void put_range(const Analysis *a, const char *key, Span span);
void put_location(const Analysis *a, Span span);

/* ---- names.c */
typedef enum NameKind {
    NAME_SYMBOL, /* a variable, constant or parameter */
    NAME_FUNC,
    NAME_STRUCT,
    NAME_TYPEDEF,
    NAME_FIELD,
    NAME_BUILTIN,
    NAME_METHOD,
    NAME_MODULE,
    NAME_TYPE,   /* a word of the language */
    NAME_VALUE,  /* no name: an operator, a number */
    NAME_UNKNOWN /* behind a dot, and not a field of that type */
} NameKind;
typedef struct Name {
    NameKind kind;
    Span span;
    bool declares;
    const char *text;
    Symbol *sym;
    Func *func;
    const StructDecl *structure;
    const TypedefDecl *type_def;
    const Type *type, *owner; /* of the value; of a field: the struct */
    uint32_t field;
    Builtin builtin;
    Method method;
    Module *module; /* NAME_MODULE: the one imported */
    Expr *expr;     /* the expression that it is or calls */
} Name;
typedef Vec(Name) Names;
Names names_of(Analysis *a, bool imports_too);
const Name *name_at(const Analysis *a, const Names *names, uint32_t offset);
/* Where it is declared; SPAN_NONE: nowhere. */
Span name_declared(const Name *n);
bool name_same(const Name *a, const Name *b);
/* ---- gradient.c: a sentence or two about whether a gradient reaches it; NULL: the question has no sense. */
const char *gradient_text(Analysis *a, const Name *n);

/* ---- hover.c, complete.c, outline.c, format.c */
Request request_hover, request_definition, request_references, request_highlight, request_signature, request_symbols;
void request_complete(const Server *server, const Document *d, uint32_t offset, FILE *out);
void request_format(const Server *server, const Document *d, json_t *params, FILE *out);
/* The comment above a declaration or behind it, without its marks; NULL: none. In the session. */
const char *comment_of(Analysis *a, Span declaration);
const char *func_head(Analysis *a, const Func *f); /* "float f(float2 p, out int n)" */
/* The source formatted, in the session; NULL: it has errors of syntax. */
const char *format_source(Session *s, int file);

/* ---- words.c */
typedef enum WordKind { WORD_BUILTIN, WORD_METHOD, WORD_ATTRIBUTE, WORD_KEYWORD, WORD_OTHER, WORD_TYPE } WordKind;
typedef struct Word {
    WordKind kind;
    const char *name, *written, *line; /* written: its signature, NULL where there is none; line may be NULL */
    int id;                            /* of the Builtin or Method */
} Word;
/* All words, malloc'd once. */
const Word *words_all(uint32_t *n);
const Word *word_find(WordKind kind, const char *name);
const Word *word_of(WordKind kind, int id);

#endif
