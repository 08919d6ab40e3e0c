/* saltus lsp: the language server, which cli/lsp is. */
#include "cli/lsp/lsp.h"
#include "cli/lsp/server.h"

int verb_lsp(Cli *c) { return server_run(c); }
