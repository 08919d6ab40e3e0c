/* Any bytes as a scene of `fit`: read into the options of a command line that says nothing. Its files are not opened.
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* memfd_create */
#endif
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "cli/fit.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static Cli c;
    if (size > 1 << 16) return 0;
    int fd = memfd_create("scene.json", MFD_CLOEXEC);
    if (fd < 0 || write(fd, data, size) != (ssize_t)size) abort();
    char path[40];
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    memset(&c, 0, sizeof c);
    Scene scene;
    int status = scene_read(&c, path, &scene);
    if (status != SLT_OK && status != SLT_INPUT && status != SLT_LIMIT) abort();
    if (c.nsets > CLI_MAX_LIST || c.nlr > CLI_MAX_LIST || c.nparam_files > CLI_MAX_LIST) abort();
    scene_free(&scene);
    close(fd);
    return 0;
}
