/* Watches the files of a program. Folders are watched, not files: editors write a new file and rename it. What the
 * system does not tell of (a file that goes, a link that is laid, a folder that is moved or made anew, a disk of
 * another machine) is found by looking at the files from time to time. */
#ifndef SALTUS_CLI_VIEW_FILES_H
#define SALTUS_CLI_VIEW_FILES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct Files Files;
Files *files_watch(void);     /* NULL: the system has nothing for it */
int files_fd(const Files *w); /* can be read when something happened */
/* A line for each file: the hash of what was read of it as files_hash has it, 0 where that is not known, and its name.
 * True: one that was not watched before holds something else by now. */
bool files_set(Files *w, const char *lines);
uint64_t files_hash(const void *data, size_t size); /* never 0 */
bool files_changed(Files *w, bool any_source);      /* one of them was written since; any_source: or another .salt */
bool files_look(Files *w); /* to be called from time to time: one of them is another since two looks, or has gone */
void files_free(Files *w);

#endif
