/* Watches the files of a program. Folders are watched, not files: editors write a new file and rename it. */
#ifndef SALTUS_CLI_VIEW_FILES_H
#define SALTUS_CLI_VIEW_FILES_H

#include <stdbool.h>

typedef struct Files Files;
Files *files_watch(void);                      /* NULL: the system has nothing for it */
int files_fd(const Files *w);                  /* can be read when something happened */
void files_set(Files *w, const char *list);    /* names, each ended by a newline; what it names is copied */
bool files_changed(Files *w, bool any_source); /* one of them was written since; any_source: or another .salt */
void files_free(Files *w);

#endif
