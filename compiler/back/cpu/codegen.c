/* From kernels to bytes: builds the LLVM module, runs a short list of passes, and emits an object, assembly or IR text.
 *
 * Nearly all optimisation is done on our own IR; LLVM gets values in SSA form already and is asked for what only it
 * sees: common addresses and splats, dead masks, machine code. The list was measured: a longer one costs more than it
 * gains. */
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "compiler/back/cpu/emit.h"
#include "saltus/status.h"

static void fail(CodeUnit *u, int status, const char *why) {
    u->status = status;
    u->why = arena_printf(&u->session->session, "%s", why);
}

static const char triple[] = "x86_64-unknown-linux-gnu";

void machines_init(const LlvmApi *ll) {
    ll->InitializeX86TargetInfo();
    ll->InitializeX86Target();
    ll->InitializeX86TargetMC();
    ll->InitializeX86AsmPrinter();
}

/* NULL: the unit has failed. */
static LLVMTargetMachineRef machine_for(Machines *m, CodeUnit *u) {
    static const LLVMCodeGenOptLevel levels[] = {LLVMCodeGenLevelNone, LLVMCodeGenLevelLess, LLVMCodeGenLevelDefault,
                                                 LLVMCodeGenLevelDefault};
    const unsigned level = u->opt_level > 3 ? 3 : u->opt_level;
    const LlvmApi *ll = u->ll;
    LLVMTargetRef target = NULL;
    char *text = NULL;
    if (m->of[level]) return m->of[level];
    if (ll->GetTargetFromTriple(triple, &target, &text)) {
        fail(u, SLT_INTERNAL, text ? text : "LLVM has no x86-64 target");
        ll->DisposeMessage(text);
        return NULL;
    }
    return m->of[level] = ll->CreateTargetMachine(target, triple, u->target->cpu, u->target->features, levels[level],
                                                  LLVMRelocPIC, LLVMCodeModelSmall);
}

void machines_dispose(const LlvmApi *ll, Machines *m) {
    for (unsigned level = 0; level < MACHINE_LEVELS && !guard_broken(); level++)
        if (m->of[level]) ll->DisposeTargetMachine(m->of[level]);
}

/* What types are laid out like. */
static bool open_target(CodeUnit *u, Machines *m) {
    const LLVMTargetMachineRef machine = machine_for(m, u);
    if (!machine) return false;
    u->layout = u->ll->CreateTargetDataLayout(machine);
    u->ll->SetTarget(u->mod, triple);
    u->ll->SetModuleDataLayout(u->mod, u->layout);
    return true;
}

static bool run_passes(CodeUnit *u, LLVMTargetMachineRef machine) {
    static const char *const lists[] = {
        "function(mem2reg)", "function(mem2reg,early-cse)", "function(mem2reg,early-cse)",
        ("function(mem2reg,early-cse,instcombine<no-verify-fixpoint>,gvn,loop-mssa(licm)"
         ",instcombine<no-verify-fixpoint>)")};
    const LlvmApi *ll = u->ll;
    LLVMPassBuilderOptionsRef options = ll->CreatePassBuilderOptions();
    LLVMErrorRef err = ll->RunPasses(u->mod, lists[u->opt_level > 3 ? 3 : u->opt_level], machine, options);
    ll->DisposePassBuilderOptions(options);
    if (err) {
        char *text = ll->GetErrorMessage(err);
        fail(u, SLT_INTERNAL, text);
        ll->DisposeErrorMessage(text);
        return false;
    }
    return true;
}

static bool widen_masks(CodeUnit *u) {
    if (u->target->vector_bytes >= 64) return true;
    for (uint32_t i = 0; i < u->nfunctions; i++)
        if (!masks_widen(u->ll, u->ctx, u->functions[i].f, u->target->vector_bytes)) {
            fail(u, SLT_LIMIT, "out of memory");
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

static void keep_bytes(CodeUnit *u, const void *bytes, size_t size) {
    u->bytes = malloc(size ? size : 1);
    if (!u->bytes) {
        fail(u, SLT_LIMIT, "out of memory");
        return;
    }
    memcpy(u->bytes, bytes, size);
    u->size = size;
}

static void write_module(CodeUnit *u, LLVMTargetMachineRef machine) {
    const LlvmApi *ll = u->ll;
    char *text = NULL;
    if (u->kind == 'l') {
        text = ll->PrintModuleToString(u->mod);
        keep_bytes(u, text, strlen(text));
        ll->DisposeMessage(text);
        return;
    }
    LLVMMemoryBufferRef buffer = NULL;
    const bool text_wanted = u->kind == 's' || u->kind == 'a';
    if (u->kind == 'a') ll->SetTargetMachineAsmVerbosity(machine, true);
    if (ll->TargetMachineEmitToMemoryBuffer(machine, u->mod, text_wanted ? LLVMAssemblyFile : LLVMObjectFile, &text,
                                            &buffer)) {
        fail(u, SLT_INTERNAL, text ? text : "LLVM could not emit the module");
        ll->DisposeMessage(text);
        return;
    }
    keep_bytes(u, ll->GetBufferStart(buffer), ll->GetBufferSize(buffer));
    ll->DisposeMemoryBuffer(buffer);
}

/* The name of a part: an internal function. */
static const char *part_name(CodeUnit *u, const char *name, uint32_t part) {
    return arena_printf(&u->session->session, "%s.part%u", name, part);
}

static const char *emit_function(CodeUnit *u, const KernelRequest *k, uint32_t kernel, uint32_t width) {
    const char *why = back_emit_kernel(u->ll, u->ctx, u->mod, k, u->o, width);
    if (!why) u->functions[u->nfunctions++] = (struct UnitFunction){u->ll->GetNamedFunction(u->mod, k->name), kernel};
    return why;
}

/* A kernel over many sites is one function a part, and one that switches on the uniform site number: LLVM's time stays
 * linear. */
static const char *emit_in_parts(CodeUnit *u, uint32_t kernel, uint32_t width) {
    const LlvmApi *ll = u->ll;
    const KernelRequest *k = &u->k[kernel];
    uint32_t part = 0, first = u->nfunctions;
    for (Fn *fn = k->fn; fn; fn = fn->next_part) {
        KernelRequest one = {part_name(u, k->name, part++), fn};
        const char *why = emit_function(u, &one, kernel, width);
        if (why) return why;
        ll->SetLinkage(u->functions[u->nfunctions - 1].f, LLVMInternalLinkage);
    }
    LLVMTypeRef i32 = ll->Int32TypeInContext(u->ctx), i64 = ll->Int64TypeInContext(u->ctx),
                i8 = ll->Int8TypeInContext(u->ctx);
    LLVMTypeRef types[2] = {ll->PointerTypeInContext(u->ctx, 0), i32};
    LLVMTypeRef type = ll->FunctionType(ll->VoidTypeInContext(u->ctx), types, 2, false);
    LLVMValueRef f = ll->AddFunction(u->mod, k->name, type);
    u->functions[u->nfunctions++] = (struct UnitFunction){f, kernel};
    LLVMBuilderRef b = ll->CreateBuilderInContext(u->ctx);
    LLVMBasicBlockRef entry = ll->AppendBasicBlockInContext(u->ctx, f, "entry"),
                      done = ll->AppendBasicBlockInContext(u->ctx, f, "done");
    ll->PositionBuilderAtEnd(b, done);
    ll->BuildRetVoid(b);
    ll->PositionBuilderAtEnd(b, entry);
    LLVMValueRef args[2] = {ll->GetParam(f, 0), ll->GetParam(f, 1)},
                 offset = ll->ConstInt(i64, offsetof(SltKernelArgs, site), false);
    LLVMValueRef site = ll->BuildLoad2(b, i32, ll->BuildGEP2(b, i8, args[0], &offset, 1, ""), "site");
    LLVMValueRef pick = ll->BuildSwitch(b, site, done, k->fn->nsites);
    part = 0;
    for (Fn *fn = k->fn; fn; fn = fn->next_part) {
        LLVMBasicBlockRef at = ll->AppendBasicBlockInContext(u->ctx, f, "part");
        ll->PositionBuilderAtEnd(b, at);
        ll->BuildCall2(b, type, u->functions[first + part++].f, args, 2, "");
        ll->BuildBr(b, done);
        for (uint32_t s = 0; s < fn->nsites; s++)
            if (fn->serves[s]) ll->AddCase(pick, ll->ConstInt(i32, s, false), at);
    }
    ll->DisposeBuilder(b);
    return NULL;
}

bool unit_init(CodeUnit *u, uint32_t n, uint32_t nfunctions) {
    u->k = calloc(n + 1, sizeof *u->k);
    u->width = calloc(n + 1, sizeof *u->width);
    u->instructions = calloc(n + 1, sizeof *u->instructions);
    u->functions = calloc(nfunctions + 1, sizeof *u->functions);
    return u->k && u->width && u->instructions && u->functions;
}

static void verify(CodeUnit *u) {
#ifndef NDEBUG
    char *text = NULL;
    if (u->ll->VerifyModule(u->mod, LLVMReturnStatusAction, &text)) fail(u, SLT_INTERNAL, text);
    u->ll->DisposeMessage(text);
#else
    (void)u;
#endif
}

void unit_emit(Session *s, CodeUnit *u, Machines *m) {
    const LlvmApi *ll = u->ll;
    u->session = s;
    u->ctx = ll->ContextCreate();
    u->mod = ll->ModuleCreateWithNameInContext("saltus", u->ctx);
    if (!open_target(u, m)) return;
    for (uint32_t k = 0; k < u->n; k++) {
        ArenaMark mark = arena_mark(&s->scratch);
        const char *why =
            u->k[k].fn->next_part ? emit_in_parts(u, k, u->width[k]) : emit_function(u, &u->k[k], k, u->width[k]);
        if (why) fail(u, SLT_LIMIT, arena_printf(&s->session, "kernel %s: %s", u->k[k].name, why));
        arena_reset(&s->scratch, mark);
        if (why) return;
    }
    verify(u);
}

void unit_write(Session *s, CodeUnit *u, Machines *m) {
    u->session = s;
    const LLVMTargetMachineRef machine = machine_for(m, u);
    if (!machine || !run_passes(u, machine) || !widen_masks(u)) return;
    verify(u);
    if (u->status) return;
    for (uint32_t i = 0; i < u->nfunctions; i++)
        u->instructions[u->functions[i].kernel] += count_instructions(u->ll, u->functions[i].f);
    write_module(u, machine);
}

void unit_dispose(CodeUnit *u) {
    if (guard_broken()) return; /* it may be locked for ever */
    if (u->layout) u->ll->DisposeTargetData(u->layout);
    if (u->mod) u->ll->DisposeModule(u->mod);
    if (u->ctx) u->ll->ContextDispose(u->ctx);
    u->layout = NULL, u->mod = NULL, u->ctx = NULL;
}

void unit_free(CodeUnit *u) {
    free(u->k);
    free(u->width);
    free(u->instructions);
    free(u->functions);
    free(u->bytes);
}
