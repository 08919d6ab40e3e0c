/* What cli/lsp.c asks of the server. */
#ifndef SALTUS_CLI_LSP_SERVER_H
#define SALTUS_CLI_LSP_SERVER_H

#include "cli/cli.h"

/* Serves standard input until it ends or the client says exit; an SltStatus, or 1 where no shutdown came before. */
int server_run(const Cli *c);

#endif
