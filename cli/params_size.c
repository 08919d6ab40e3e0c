/* Textures and heightfields that --params gives: their values decide the size, as files of --param do. */
#include <jansson.h>
#include <stdlib.h>
#include <string.h>

#include "bindings/c/api.h"
#include "bindings/c/values_read.h"
#include "cli/cli.h"

/* Rows of texels, or slices of rows: of another size than the parameter's? */
static bool differs(const Param *q, const json_t *rows) {
    const json_t *slice = q->tex_d ? json_array_get(rows, 0) : rows, *first = json_array_get(slice, 0),
                 *texel = json_array_get(first, 0);
    if (!texel) return false;
    size_t channels = json_is_array(texel) ? json_array_size(texel) : 1;
    return (q->tex_d && json_array_size(rows) != q->tex_d) || json_array_size(slice) != q->tex_h ||
           json_array_size(first) != q->tex_w || channels != q->tex_c;
}

/* The file that says the size: the one that is named, relative to the parameters' own; else that itself. */
static char *sizing_file(const Cli *c, const json_t *value) {
    const char *name = json_string_value(json_object_get(value, "file")), *slash = strrchr(c->params_file, '/');
    if (!name) return cli_need(strdup(c->params_file));
    size_t folder = slash && name[0] != '/' ? (size_t)(slash + 1 - c->params_file) : 0;
    char *path = cli_need(malloc(folder + strlen(name) + 1));
    memcpy(path, c->params_file, folder);
    strcpy(path + folder, name);
    return path;
}

bool cli_params_resize(Cli *c, const SltProgram *p, const char *values) {
    uint32_t before = c->nparam_files;
    json_t *root = NULL;
    SltError ignored = {0};
    for (uint32_t i = 0; i < p->prog->nparams; i++) {
        const Param *q = &p->prog->params[i];
        bool given = !param_is_image(q);
        for (uint32_t k = 0; k < before; k++) given |= !strcmp(c->param_files[k].name, q->name);
        if (given || !values) continue;
        if (!root && !(root = values_parse_json(values, c->params_file, &ignored))) break;
        json_t *value = json_object_get(root, q->name);
        if (json_is_array(value) ? !differs(q, value) : !json_is_string(json_object_get(value, "file"))) continue;
        if (c->nparam_files < CLI_MAX_LIST)
            c->param_files[c->nparam_files++] = (SltSet){cli_need(strdup(q->name)), sizing_file(c, value)};
    }
    json_decref(root);
    c->opt.nparam_files = c->nparam_files;
    return c->nparam_files > before;
}
