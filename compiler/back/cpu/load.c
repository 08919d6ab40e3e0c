/* A small loader for relocatable ELF objects: what LLVM's JIT linkers do, without LLVM.
 *
 * One private mapping: code first, then read-only data on its own pages, then stubs and addresses of the few external
 * functions. Written while writable, then made executable or read-only; never both writable and executable. Every field
 * of the object is checked against its size: objects also come from the disk. */
#include <elf.h>
#include <math.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "compiler/back/cpu/emit.h"

struct Loaded {
    unsigned char *base;
    size_t size;
    uint32_t nsymbols;
    struct LoadedSymbol {
        char name[64];
        void *at;
        uint64_t size;
    } *symbols;
};

typedef struct Loading {
    const unsigned char *bytes;
    size_t size;
    const Elf64_Ehdr *eh;
    const Elf64_Shdr *sh;
    uint32_t nsections;
    uint64_t *address; /* by section: offset in the mapping, UINT64_MAX: not loaded */
    const Elf64_Sym *sym;
    uint32_t nsym;
    const char *strtab;
    uint64_t strtab_size;
    unsigned char *base;
    size_t mapped, code_end, stubs;
    uint32_t nstubs;
    const char *why;
} Loading;

enum { STUB_BYTES = 16, MAX_STUBS = 8 }; /* jmp *[rip+2]; the address */

static void *external(const char *name) {
    static const struct {
        const char *name;
        void (*f)(void);
    } known[] = {{"fma", (void (*)(void))(double (*)(double, double, double))fma},
                 {"fmaf", (void (*)(void))(float (*)(float, float, float))fmaf},
                 {"memcpy", (void (*)(void))memcpy},
                 {"memmove", (void (*)(void))memmove},
                 {"memset", (void (*)(void))memset}};
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (!strcmp(known[i].name, name)) {
            void *p;
            memcpy(&p, &known[i].f, sizeof p);
            return p;
        }
    return NULL;
}

static bool inside(const Loading *l, uint64_t offset, uint64_t bytes) {
    return offset <= l->size && bytes <= l->size - offset;
}

static bool bad(Loading *l, const char *why) {
    l->why = why;
    return false;
}

static bool read_headers(Loading *l) {
    if (l->size < sizeof(Elf64_Ehdr) || ((uintptr_t)l->bytes & 7)) return bad(l, "object too short");
    l->eh = (const Elf64_Ehdr *)l->bytes;
    if (memcmp(l->eh->e_ident, ELFMAG, SELFMAG) || l->eh->e_ident[EI_CLASS] != ELFCLASS64 ||
        l->eh->e_machine != EM_X86_64 || l->eh->e_type != ET_REL)
        return bad(l, "not an x86-64 object");
    l->nsections = l->eh->e_shnum;
    if (l->eh->e_shentsize != sizeof(Elf64_Shdr) || (l->eh->e_shoff & 7) ||
        !inside(l, l->eh->e_shoff, (uint64_t)l->nsections * sizeof(Elf64_Shdr)))
        return bad(l, "bad section table");
    l->sh = (const Elf64_Shdr *)(l->bytes + l->eh->e_shoff);
    for (uint32_t i = 0; i < l->nsections; i++) {
        const Elf64_Shdr *s = &l->sh[i];
        if (s->sh_type != SHT_NOBITS && s->sh_type != SHT_NULL && !inside(l, s->sh_offset, s->sh_size))
            return bad(l, "section outside the object");
        if (s->sh_type != SHT_SYMTAB) continue;
        if (s->sh_link >= l->nsections || s->sh_entsize != sizeof(Elf64_Sym) || (s->sh_offset & 7))
            return bad(l, "bad symbol table");
        l->sym = (const Elf64_Sym *)(l->bytes + s->sh_offset);
        l->nsym = (uint32_t)(s->sh_size / sizeof(Elf64_Sym));
        const Elf64_Shdr *str = &l->sh[s->sh_link];
        if (!inside(l, str->sh_offset, str->sh_size) || !str->sh_size || l->bytes[str->sh_offset + str->sh_size - 1])
            return bad(l, "bad string table");
        l->strtab = (const char *)l->bytes + str->sh_offset;
        l->strtab_size = str->sh_size;
    }
    return l->sym ? true : bad(l, "no symbols");
}

static bool loads(const Elf64_Shdr *s) { return (s->sh_flags & SHF_ALLOC) && s->sh_type != SHT_NULL && s->sh_size; }

static bool place_sections(Loading *l) {
    uint64_t page = (uint64_t)sysconf(_SC_PAGESIZE), at = 0;
    for (int pass = 0; pass < 2; pass++) {
        for (uint32_t i = 0; i < l->nsections; i++) {
            const Elf64_Shdr *s = &l->sh[i];
            bool code = s->sh_flags & SHF_EXECINSTR;
            if (!loads(s) || code != (pass == 0)) continue;
            uint64_t align = s->sh_addralign ? s->sh_addralign : 1;
            if (align > 4096 || (align & (align - 1)) || s->sh_size > (1u << 30)) return bad(l, "bad section");
            at = (at + align - 1) & ~(align - 1);
            l->address[i] = at;
            at += s->sh_size;
            if (at > (1u << 30)) return bad(l, "object too large");
        }
        if (pass == 0) {
            l->stubs = (at + 15) & ~(uint64_t)15;
            at = l->stubs + MAX_STUBS * STUB_BYTES;
            at = (at + page - 1) & ~(page - 1);
            l->code_end = at;
        }
    }
    l->mapped = (at + page - 1) & ~(page - 1);
    void *p = mmap(NULL, l->mapped, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (p == MAP_FAILED) return bad(l, "no memory for code");
    l->base = p;
    for (uint32_t i = 0; i < l->nsections; i++)
        if (l->address[i] != UINT64_MAX && l->sh[i].sh_type != SHT_NOBITS)
            memcpy(l->base + l->address[i], l->bytes + l->sh[i].sh_offset, l->sh[i].sh_size);
    return true;
}

/* The stub of an external function: code jumps to it; its last 8 bytes are the address itself, which serves as the
 * entry of an offset table. */
static unsigned char *stub_for(Loading *l, void *target) {
    for (uint32_t i = 0; i < l->nstubs; i++) {
        unsigned char *s = l->base + l->stubs + i * STUB_BYTES;
        if (!memcmp(s + 8, &target, 8)) return s;
    }
    if (l->nstubs == MAX_STUBS) return NULL;
    unsigned char *s = l->base + l->stubs + l->nstubs++ * STUB_BYTES;
    static const unsigned char jump[8] = {0xff, 0x25, 0x02, 0, 0, 0, 0x90, 0x90};
    memcpy(s, jump, 8);
    memcpy(s + 8, &target, 8);
    return s;
}

/* Address of symbol `index` in the mapping; for an external one its stub. */
static unsigned char *symbol_address(Loading *l, uint32_t index, bool *is_external) {
    const Elf64_Sym *s = &l->sym[index];
    *is_external = s->st_shndx == SHN_UNDEF;
    if (*is_external) {
        void *f = s->st_name < l->strtab_size ? external(l->strtab + s->st_name) : NULL;
        return f ? stub_for(l, f) : NULL;
    }
    if (s->st_shndx >= l->nsections || l->address[s->st_shndx] == UINT64_MAX ||
        s->st_value > l->sh[s->st_shndx].sh_size)
        return NULL;
    return l->base + l->address[s->st_shndx] + s->st_value;
}

static bool relocate_one(Loading *l, const Elf64_Rela *r, uint32_t section) {
    uint32_t type = (uint32_t)ELF64_R_TYPE(r->r_info), index = (uint32_t)ELF64_R_SYM(r->r_info);
    unsigned bytes = type == R_X86_64_64 || type == R_X86_64_PC64 ? 8 : 4;
    if (index >= l->nsym || r->r_offset > l->sh[section].sh_size || bytes > l->sh[section].sh_size - r->r_offset)
        return bad(l, "relocation outside its section");
    bool is_external;
    unsigned char *where = l->base + l->address[section] + r->r_offset,
                  *target = symbol_address(l, index, &is_external);
    if (!target) return bad(l, "unknown external symbol");
    /* addresses as integers: the addend of a damaged object may point anywhere */
    uint64_t to = (uintptr_t)target + (uint64_t)r->r_addend, here = (uintptr_t)where;
    int64_t value;
    switch (type) {
    case R_X86_64_64: value = (int64_t)to; break;
    case R_X86_64_PC32:
    case R_X86_64_PLT32:
    case R_X86_64_PC64: value = (int64_t)(to - here); break;
    case R_X86_64_GOTPCREL:
    case R_X86_64_GOTPCRELX:
    case R_X86_64_REX_GOTPCRELX:
        if (!is_external) return bad(l, "unexpected relocation");
        value = (int64_t)(to + 8 - here);
        break;
    default: return bad(l, "unsupported relocation");
    }
    if (bytes == 4 && value != (int32_t)value) return bad(l, "relocation out of range");
    memcpy(where, &value, bytes);
    return true;
}

static bool relocate(Loading *l) {
    for (uint32_t i = 0; i < l->nsections; i++) {
        const Elf64_Shdr *s = &l->sh[i];
        if (s->sh_type == SHT_REL) return bad(l, "unsupported relocation section");
        if (s->sh_type != SHT_RELA || s->sh_info >= l->nsections || l->address[s->sh_info] == UINT64_MAX) continue;
        if (s->sh_entsize != sizeof(Elf64_Rela) || (s->sh_offset & 7)) return bad(l, "bad relocation section");
        const Elf64_Rela *r = (const Elf64_Rela *)(l->bytes + s->sh_offset);
        for (uint64_t k = 0; k < s->sh_size / sizeof *r; k++)
            if (!relocate_one(l, &r[k], s->sh_info)) return false;
    }
    return true;
}

static bool collect_symbols(Loading *l, Loaded *out) {
    out->symbols = calloc(l->nsym + 1, sizeof *out->symbols);
    if (!out->symbols) return bad(l, "out of memory");
    for (uint32_t i = 0; i < l->nsym; i++) {
        const Elf64_Sym *s = &l->sym[i];
        bool is_external;
        if (ELF64_ST_TYPE(s->st_info) != STT_FUNC || s->st_shndx == SHN_UNDEF || s->st_name >= l->strtab_size) continue;
        const char *name = l->strtab + s->st_name;
        unsigned char *at = symbol_address(l, i, &is_external);
        if (!at || strlen(name) >= sizeof out->symbols->name) continue;
        struct LoadedSymbol *d = &out->symbols[out->nsymbols++];
        strcpy(d->name, name);
        d->at = at;
        d->size = s->st_size;
    }
    return true;
}

Loaded *load_object(const unsigned char *bytes, size_t size, const char **why) {
    Loading l = {.bytes = bytes, .size = size};
    Loaded *out = calloc(1, sizeof *out);
    bool ok = out && read_headers(&l);
    if (ok) {
        l.address = malloc((l.nsections + 1) * sizeof *l.address);
        for (uint32_t i = 0; l.address && i < l.nsections; i++) l.address[i] = UINT64_MAX;
        ok = l.address && place_sections(&l) && relocate(&l) && collect_symbols(&l, out);
    }
    if (ok && (mprotect(l.base, l.code_end, PROT_READ | PROT_EXEC) ||
               (l.mapped > l.code_end && mprotect(l.base + l.code_end, l.mapped - l.code_end, PROT_READ))))
        ok = bad(&l, "the system refuses executable memory, which --interpret does without");
    free(l.address);
    if (!ok) {
        int code = errno; /* tells what the system refused from what is wrong with the object */
        if (l.base) munmap(l.base, l.mapped);
        if (out) free(out->symbols);
        free(out);
        errno = code;
        *why = l.why ? l.why : "out of memory";
        return NULL;
    }
    out->base = l.base;
    out->size = l.mapped;
    return out;
}

void *load_symbol(const Loaded *l, const char *name, uint64_t *size) {
    for (uint32_t i = 0; i < l->nsymbols; i++)
        if (!strcmp(l->symbols[i].name, name)) {
            if (size) *size = l->symbols[i].size;
            return l->symbols[i].at;
        }
    return NULL;
}

void load_free(Loaded *l) {
    if (!l) return;
    munmap(l->base, l->size);
    free(l->symbols);
    free(l);
}
