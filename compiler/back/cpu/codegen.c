/* From kernels to bytes: builds the LLVM module, runs a short list of passes, and emits an object, assembly or IR text.
 *
 * Nearly all optimisation is done on our own IR; LLVM gets values in SSA form already and is asked for what only it
 * sees: common addresses and splats, dead masks, machine code. The list was measured: a longer one costs more than it
 * gains. */
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "compiler/back/cpu/emit.h"
#include "saltus/status.h"

typedef struct Job {
    Session *session;
    const KernelRequest *k;
    uint32_t n;
    const BackOptions *o;
    char kind;
    Codegen *out;
    const char *why;
    int status;
    LlvmApi api;
    LLVMContextRef ctx;
    LLVMModuleRef mod;
    LLVMTargetMachineRef tm;
    LLVMTargetDataRef layout;
} Job;

static double now_ms(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec * 1e3 + (double)t.tv_nsec * 1e-6;
}

static void fail(Job *j, int status, const char *why) {
    j->status = status;
    j->why = arena_printf(&j->session->session, "%s", why);
}

static bool open_target(Job *j) {
    static const char triple[] = "x86_64-unknown-linux-gnu";
    const LlvmApi *ll = &j->api;
    ll->InitializeX86TargetInfo();
    ll->InitializeX86Target();
    ll->InitializeX86TargetMC();
    ll->InitializeX86AsmPrinter();
    LLVMTargetRef target = NULL;
    char *text = NULL;
    if (ll->GetTargetFromTriple(triple, &target, &text)) {
        fail(j, SLT_INTERNAL, text ? text : "LLVM has no x86-64 target");
        ll->DisposeMessage(text);
        return false;
    }
    static const LLVMCodeGenOptLevel levels[] = {LLVMCodeGenLevelNone, LLVMCodeGenLevelLess, LLVMCodeGenLevelDefault,
                                                 LLVMCodeGenLevelDefault};
    j->tm =
        ll->CreateTargetMachine(target, triple, j->o->target.cpu, j->o->target.features,
                                levels[j->o->opt_level > 3 ? 3 : j->o->opt_level], LLVMRelocPIC, LLVMCodeModelSmall);
    j->layout = ll->CreateTargetDataLayout(j->tm);
    ll->SetTarget(j->mod, triple);
    ll->SetModuleDataLayout(j->mod, j->layout);
    return true;
}

static bool run_passes(Job *j) {
    static const char *const lists[] = {
        "function(mem2reg)", "function(mem2reg,early-cse)", "function(mem2reg,early-cse)",
        ("function(mem2reg,early-cse,instcombine<no-verify-fixpoint>,gvn,loop-mssa(licm)"
         ",instcombine<no-verify-fixpoint>)")};
    const LlvmApi *ll = &j->api;
    LLVMPassBuilderOptionsRef options = ll->CreatePassBuilderOptions();
    LLVMErrorRef err = ll->RunPasses(j->mod, lists[j->o->opt_level > 3 ? 3 : j->o->opt_level], j->tm, options);
    ll->DisposePassBuilderOptions(options);
    if (err) {
        char *text = ll->GetErrorMessage(err);
        fail(j, SLT_INTERNAL, text);
        ll->DisposeErrorMessage(text);
        return false;
    }
    return true;
}

static uint32_t count_instructions(const LlvmApi *ll, LLVMValueRef f) {
    uint32_t n = 0;
    for (LLVMBasicBlockRef b = ll->GetFirstBasicBlock(f); b; b = ll->GetNextBasicBlock(b))
        for (LLVMValueRef i = ll->GetFirstInstruction(b); i; i = ll->GetNextInstruction(i)) n++;
    return n;
}

static void keep_bytes(Job *j, const void *bytes, size_t size) {
    j->out->bytes = malloc(size ? size : 1);
    if (!j->out->bytes) {
        fail(j, SLT_LIMIT, "out of memory");
        return;
    }
    memcpy(j->out->bytes, bytes, size);
    j->out->size = size;
}

static void write_module(Job *j) {
    const LlvmApi *ll = &j->api;
    char *text = NULL;
    if (j->kind == 'l') {
        text = ll->PrintModuleToString(j->mod);
        keep_bytes(j, text, strlen(text));
        ll->DisposeMessage(text);
        return;
    }
    LLVMMemoryBufferRef buffer = NULL;
    const bool text_wanted = j->kind == 's' || j->kind == 'a';
    if (j->kind == 'a') ll->SetTargetMachineAsmVerbosity(j->tm, true);
    if (ll->TargetMachineEmitToMemoryBuffer(j->tm, j->mod, text_wanted ? LLVMAssemblyFile : LLVMObjectFile, &text,
                                            &buffer)) {
        fail(j, SLT_INTERNAL, text ? text : "LLVM could not emit the module");
        ll->DisposeMessage(text);
        return;
    }
    keep_bytes(j, ll->GetBufferStart(buffer), ll->GetBufferSize(buffer));
    ll->DisposeMemoryBuffer(buffer);
}

/* The name of a part: an internal function. */
static const char *part_name(Job *j, const char *name, uint32_t part) {
    return arena_printf(&j->session->session, "%s.part%u", name, part);
}

/* A kernel over many sites is one function a part, and one that switches on the uniform site number: LLVM's time stays
 * linear. */
static const char *emit_in_parts(Job *j, const KernelRequest *k, uint32_t width) {
    const LlvmApi *ll = &j->api;
    uint32_t part = 0;
    for (Fn *fn = k->fn; fn; fn = fn->next_part) {
        KernelRequest one = {part_name(j, k->name, part++), fn};
        const char *why = back_emit_kernel(ll, j->ctx, j->mod, &one, j->o, width);
        if (why) return why;
        ll->SetLinkage(ll->GetNamedFunction(j->mod, one.name), LLVMInternalLinkage);
    }
    LLVMTypeRef i32 = ll->Int32TypeInContext(j->ctx), i64 = ll->Int64TypeInContext(j->ctx),
                i8 = ll->Int8TypeInContext(j->ctx);
    LLVMTypeRef types[2] = {ll->PointerTypeInContext(j->ctx, 0), i32};
    LLVMTypeRef type = ll->FunctionType(ll->VoidTypeInContext(j->ctx), types, 2, false);
    LLVMValueRef f = ll->AddFunction(j->mod, k->name, type);
    LLVMBuilderRef b = ll->CreateBuilderInContext(j->ctx);
    LLVMBasicBlockRef entry = ll->AppendBasicBlockInContext(j->ctx, f, "entry"),
                      done = ll->AppendBasicBlockInContext(j->ctx, f, "done");
    ll->PositionBuilderAtEnd(b, done);
    ll->BuildRetVoid(b);
    ll->PositionBuilderAtEnd(b, entry);
    LLVMValueRef args[2] = {ll->GetParam(f, 0), ll->GetParam(f, 1)},
                 offset = ll->ConstInt(i64, offsetof(SltKernelArgs, site), false);
    LLVMValueRef site = ll->BuildLoad2(b, i32, ll->BuildGEP2(b, i8, args[0], &offset, 1, ""), "site");
    LLVMValueRef pick = ll->BuildSwitch(b, site, done, k->fn->nsites);
    part = 0;
    for (Fn *fn = k->fn; fn; fn = fn->next_part) {
        LLVMBasicBlockRef at = ll->AppendBasicBlockInContext(j->ctx, f, "part");
        ll->PositionBuilderAtEnd(b, at);
        ll->BuildCall2(b, type, ll->GetNamedFunction(j->mod, part_name(j, k->name, part++)), args, 2, "");
        ll->BuildBr(b, done);
        for (uint32_t s = 0; s < fn->nsites; s++)
            if (fn->serves[s]) ll->AddCase(pick, ll->ConstInt(i32, s, false), at);
    }
    ll->DisposeBuilder(b);
    return NULL;
}

static void generate(Session *s, void *arg) {
    Job *j = arg;
    const LlvmApi *ll = &j->api;
    double start = now_ms();
    j->ctx = ll->ContextCreate();
    j->mod = ll->ModuleCreateWithNameInContext("saltus", j->ctx);
    if (!open_target(j)) return;
    for (uint32_t k = 0; k < j->n; k++) {
        ArenaMark mark = arena_mark(&s->scratch);
        uint32_t width = back_choose_width(j->k, k, j->o);
        const char *why = j->k[k].fn->next_part ? emit_in_parts(j, &j->k[k], width)
                                                : back_emit_kernel(ll, j->ctx, j->mod, &j->k[k], j->o, width);
        if (why) fail(j, SLT_LIMIT, arena_printf(&s->session, "kernel %s: %s", j->k[k].name, why));
        arena_reset(&s->scratch, mark);
        if (why) return;
    }
#ifndef NDEBUG
    char *text = NULL;
    if (ll->VerifyModule(j->mod, LLVMReturnStatusAction, &text)) {
        fail(j, SLT_INTERNAL, text);
        ll->DisposeMessage(text);
        return;
    }
    ll->DisposeMessage(text);
#endif
    j->out->emit_ms = now_ms() - start;
    start = now_ms();
    if (!run_passes(j)) return;
    j->out->instructions = ARENA_ARRAY(&s->session, uint32_t, j->n + 1);
    for (uint32_t k = 0; k < j->n; k++) {
        j->out->instructions[k] = count_instructions(ll, ll->GetNamedFunction(j->mod, j->k[k].name));
        uint32_t part = 0;
        for (Fn *fn = j->k[k].fn->next_part ? j->k[k].fn : NULL; fn; fn = fn->next_part)
            j->out->instructions[k] +=
                count_instructions(ll, ll->GetNamedFunction(j->mod, part_name(j, j->k[k].name, part++)));
    }
    write_module(j);
    j->out->llvm_ms = now_ms() - start;
}

static void dispose(Job *j) {
    if (guard_broken()) return; /* it may be locked for ever */
    if (j->tm) j->api.DisposeTargetMachine(j->tm);
    if (j->layout) j->api.DisposeTargetData(j->layout);
    if (j->mod) j->api.DisposeModule(j->mod);
    if (j->ctx) j->api.ContextDispose(j->ctx);
    j->tm = NULL, j->layout = NULL, j->mod = NULL, j->ctx = NULL;
}

static void generate_guarded(Session *s, void *arg) {
    Job *j = arg;
    guard_begin(&j->api, s);
    generate(s, j);
    dispose(j);
}

int back_codegen(Session *s, const KernelRequest *k, uint32_t n, const BackOptions *o, char kind, Codegen *out,
                 const char **why) {
    Job j = {.session = s, .k = k, .n = n, .o = o, .kind = kind, .out = out};
    *out = (Codegen){0};
    bool no_memory;
    const char *missing = llvm_open(&j.api, &no_memory);
    if (missing) {
        *why = arena_printf(&s->session, "cannot load LLVM: %s", missing);
        return no_memory ? SLT_LIMIT : SLT_INPUT;
    }
    int status = session_protect(s, generate_guarded, &j);
    guard_end();
    if (status && !j.status) {
        j.status = status;
        j.why = arena_printf(&s->session, "%s", s->unwind_text);
    }
    dispose(&j); /* what our own limits left */
    if (j.status) {
        free(out->bytes);
        out->bytes = NULL;
        *why = j.why;
    }
    return j.status;
}

int back_emit(Session *s, const KernelRequest *k, uint32_t n, const BackOptions *o, char kind, unsigned char **bytes,
              size_t *size, const char **why) {
    *bytes = NULL, *size = 0;
    int status = back_check_width(s, o->width, why);
    if (status) return status;
    Codegen g;
    status = back_codegen(s, k, n, o, kind, &g, why);
    if (status) return status;
    *bytes = g.bytes, *size = g.size;
    return SLT_OK;
}
