/* What a fragment shader takes for granted: inputs that its host declares, outputs, and somebody who calls it. All of
 * it is written as a source of the language and parsed into the shader's module. */
#include "compiler/front/glsl/glsl.h"

#include <stdarg.h>
#include <string.h>

typedef struct Text {
    Parser *p;
    const char *decls, *body;
} Text;

static void add(Text *t, const char **to, const char *fmt, ...) __attribute__((format(printf, 3, 4)));
static void add(Text *t, const char **to, const char *fmt, ...) {
    va_list ap;
    va_start(ap, fmt);
    const char *line = arena_vprintf(&t->p->s->session, fmt, ap);
    va_end(ap);
    *to = arena_printf(&t->p->s->session, "%s%s", *to, line);
}

static const char *word(Parser *p, const char *text) { return intern(p->s, text, strlen(text)); }

static bool declared(Parser *p, const char *name) {
    for (const Symbol *s = p->module->params; s; s = s->next)
        if (s->name == name) return true;
    for (const Symbol *s = p->module->consts; s; s = s->next)
        if (s->name == name) return true;
    for (uint32_t i = 0; i < p->unit->globals.len; i++)
        if (p->unit->globals.data[i]->name == name) return true;
    return false;
}

/* The source uses the name and leaves its declaration to the host. */
static bool wanted(Parser *p, const char *text) {
    const char *name = word(p, text);
    return map_get(&p->unit->words, name) && !declared(p, name);
}

static void variable(Parser *p, const char *type, const char *name, uint32_t n) {
    Symbol *sym = ARENA_NEW(&p->s->module, Symbol);
    TypeRef *ref = ARENA_NEW(&p->s->module, TypeRef);
    Span at = {p->module->file, 0, 0};
    *ref = (TypeRef){.name = word(p, type), .span = at};
    if (n) {
        Expr *e = ARENA_NEW(&p->s->module, Expr);
        *e = (Expr){.kind = E_LITERAL, .span = at, .op_span = at, .type = type_scalar(T_INT), .depth = 1};
        e->cval = (ConstVal){.v = {{.i = n}}, .n = 1};
        ref->dims = ARENA_NEW(&p->s->module, Expr *);
        ref->dims[0] = e;
        ref->ndims = 1;
    }
    *sym = (Symbol){.kind = SYM_LOCAL, .name = word(p, name), .span = at, .type_ref = ref, .module = p->module};
    vec_push(&p->s->module, &p->unit->globals, sym);
}

/* ---- what hosts declare */

static const char *const numbers[][2] = {{"iTime", "float"},       {"iTimeDelta", "float"}, {"iGlobalTime", "float"},
                                         {"iFrameRate", "float"},  {"iFrame", "int"},       {"iMouse", "float4"},
                                         {"iSampleRate", "float"}, {"iDate", "float4"}};
enum { NUMBERS = sizeof numbers / sizeof *numbers };

bool glsl_host_sets(const char *name) {
    size_t n = strcspn(name, "[.");
    for (size_t i = 0; i < NUMBERS; i++)
        if (strlen(numbers[i][0]) == n && !strncmp(name, numbers[i][0], n)) return true;
    return n == 9 && !strncmp(name, "iChannel", 8) && name[8] >= '0' && name[8] <= '3';
}

static void host_uniforms(Text *t) {
    Parser *p = t->p;
    if (wanted(p, "iResolution"))
        add(t, &t->decls, "const float3 iResolution = float3(%u.0, %u.0, 1.0);\n", p->unit->size[0], p->unit->size[1]);
    for (size_t i = 0; i < NUMBERS; i++)
        if (wanted(p, numbers[i][0]))
            add(t, &t->decls, "param %s %s = %s(0);\n", numbers[i][1], numbers[i][0], numbers[i][1]);
    bool sizes = wanted(p, "iChannelResolution");
    if (wanted(p, "iChannelTime")) variable(p, "float", "iChannelTime", 4);
    if (sizes) variable(p, "float3", "iChannelResolution", 4);
    for (int k = 0; k < 4; k++) {
        const char *name = arena_printf(&p->s->session, "iChannel%d", k);
        bool here = map_get(&p->unit->words, word(p, name)) != NULL;
        if (wanted(p, name)) add(t, &t->decls, "param texture2D %s = zeros(1, 1);\n", name);
        if (here && sizes) add(t, &t->body, "    iChannelResolution[%d] = float3(float2(%s.size()), 1.0);\n", k, name);
    }
}

/* The least that GLSL ES 3.00 lets an implementation have, and one output. */
static const struct {
    const char *name;
    int value;
} limits[] = {{"gl_MaxDrawBuffers", 1},           {"gl_MaxVertexAttribs", 16},
              {"gl_MaxVaryingVectors", 15},       {"gl_MaxVertexUniformVectors", 256},
              {"gl_MaxVertexOutputVectors", 16},  {"gl_MaxVertexTextureImageUnits", 16},
              {"gl_MaxTextureImageUnits", 16},    {"gl_MaxCombinedTextureImageUnits", 32},
              {"gl_MaxFragmentInputVectors", 15}, {"gl_MaxFragmentUniformVectors", 224},
              {"gl_MinProgramTexelOffset", -8},   {"gl_MaxProgramTexelOffset", 7}};
enum { LIMITS = sizeof limits / sizeof *limits };

static void fragment_variables(Text *t) {
    Parser *p = t->p;
    if (wanted(p, "gl_FragCoord")) {
        variable(p, "float4", "gl_FragCoord", 0);
        add(t, &t->body, "    gl_FragCoord = float4(gl_point, 0.5, 1.0);\n");
    }
    if (wanted(p, "gl_FragColor")) variable(p, "float4", "gl_FragColor", 0);
    if (wanted(p, "gl_FragData")) variable(p, "float4", "gl_FragData", 1);
    if (wanted(p, "gl_FrontFacing")) add(t, &t->decls, "const bool gl_FrontFacing = true;\n");
    for (size_t i = 0; i < LIMITS; i++)
        if (wanted(p, limits[i].name)) add(t, &t->decls, "const int %s = %d;\n", limits[i].name, limits[i].value);
    if (wanted(p, "gl_PointCoord")) add(t, &t->decls, "const float2 gl_PointCoord = float2(0.0);\n");
    if (map_get(&p->unit->words, word(p, "discard"))) variable(p, "bool", "gl_discard", 0);
    for (uint32_t i = 0; i < p->unit->inputs.len; i++) {
        Symbol *in = p->unit->inputs.data[i];
        vec_push(&p->s->module, &p->unit->globals, in);
        if (strcmp(in->type_ref->name, "float2") != 0 || in->type_ref->ndims) {
            diag_emit(p->s, DIAG_glsl_unsupported, in->span,
                      arena_printf(&p->s->session,
                                   "there is no vertex shader that would give `%s` its value: a vec2 is taken for the "
                                   "place in the image, 0 to 1; make this a uniform",
                                   in->name));
            continue;
        }
        add(t, &t->body, "    %s = gl_point / float2(%u.0, %u.0);\n", in->name, p->unit->size[0], p->unit->size[1]);
    }
    for (uint32_t i = 0; i < p->unit->outputs.len; i++)
        vec_push(&p->s->module, &p->unit->globals, p->unit->outputs.data[i]);
}

/* ---- the entry */

static const Func *function(Parser *p, const char *text, uint32_t nargs) {
    const char *name = word(p, text);
    for (const Func *f = p->module->funcs; f; f = f->next)
        if (f->name == name && f->nargs == nargs) return f;
    return NULL;
}

/* The expression that is the colour after main(), NULL where nothing holds one. */
static const char *output(Parser *p) {
    if (p->unit->outputs.len) {
        const Symbol *out = p->unit->outputs.data[0];
        static const char *const parts[] = {"float3(%s)", "float3(%s, 0.0)", "%s", "%s.xyz"};
        const char *type = out->type_ref->name;
        if (strncmp(type, "float", 5) != 0 || out->type_ref->ndims > 1) return NULL;
        int n = type[5] ? type[5] - '0' : 1;
        const char *form = parts[n - 1], *at = strstr(form, "%s"), *first = out->type_ref->ndims ? "[0]" : "";
        return arena_printf(&p->s->session, "%.*s%s%s%s", (int)(at - form), form, out->name, first, at + 2);
    }
    if (map_get(&p->unit->words, word(p, "gl_FragColor"))) return "gl_FragColor.xyz";
    return map_get(&p->unit->words, word(p, "gl_FragData")) ? "gl_FragData[0].xyz" : NULL;
}

/* `void mainImage(out vec4, vec2)`, or the call of it below would not fit. */
static bool is_entry(Parser *p, const Func *f) {
    const Symbol *color = f->args[0], *point = f->args[1];
    bool fits = color->mode == ARG_INOUT && !color->type_ref->ndims && !strcmp(color->type_ref->name, "float4") &&
                point->mode == ARG_IN && !point->type_ref->ndims && !strcmp(point->type_ref->name, "float2") &&
                !strcmp(f->ret_ref->name, "void");
    if (!fits)
        diag_emit(
            p->s, DIAG_glsl_entry, f->name_span,
            "`mainImage` gives its colour by its first argument: `void mainImage(out vec4 color, in vec2 point)`");
    return fits;
}

static bool entry_text(Text *t) {
    Parser *p = t->p;
    Span top = {p->module->file, 0, 0};
    const char *colour = "gl_color.xyz";
    const Func *toy = function(p, "mainImage", 2);
    if (toy) {
        if (!is_entry(p, toy)) return false;
        add(t, &t->body, "    float4 gl_color = float4(0.0);\n    mainImage(gl_color, gl_point);\n");
    } else if (function(p, "main", 0)) {
        colour = output(p);
        add(t, &t->body, "    main();\n");
        if (!colour)
            diag_emit(p->s, DIAG_glsl_entry, top,
                      "`main` writes to no output: `gl_FragColor`, or `out vec4 color;` at file scope");
    } else {
        diag_emit(p->s, DIAG_glsl_entry, top,
                  "there is no `void mainImage(out vec4 color, in vec2 point)` and no `void main()`");
        return false;
    }
    if (!colour) return false;
    if (map_get(&p->unit->words, word(p, "discard"))) add(t, &t->body, "    if (gl_discard) return float3(0.0);\n");
    add(t, &t->body, "    return %s;\n", colour);
    return true;
}

/* Parses a text of the language into the module. */
static void parse_text(Parser *p, const char *text) {
    int file = session_add_text(p->s, "<host>", ".", text, strlen(text));
    Lexer lx = p->lx;
    Token tok = p->tok;
    p->glsl = false;
    p->lx = lex_start(p->s, file);
    p->stopped = p->panic = false;
    parse_advance(p);
    parse_file_scope(p);
    p->glsl = true;
    p->lx = lx;
    p->tok = tok;
}

void glsl_complete(Parser *p) {
    Text t = {p, "", ""};
    if (p->s->nerrors > p->first_error) { /* what is missing may have been skipped */
        p->module->unusable = true;
        return;
    }
    glsl_find_constants(p);
    host_uniforms(&t);
    fragment_variables(&t);
    if (!entry_text(&t)) return;
    const char *name = map_get(&p->unit->words, word(p, "image")) ? "gl_image" : "image";
    parse_text(p,
               arena_printf(
                   &p->s->session,
                   "%s[Display] [Domain(float2(0.0), float2(%u.0, %u.0))]\nshader float3 %s(float2 gl_point) {\n%s}\n",
                   t.decls, p->unit->size[0], p->unit->size[1], name, t.body));
    Func *entry = NULL;
    for (Func *f = p->module->funcs; f; f = f->next)
        if (f->is_shader) entry = f;
    if (entry) glsl_pass_globals(p, entry);
    glsl_rename_calls(p);
}
