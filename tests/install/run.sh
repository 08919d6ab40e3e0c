#!/usr/bin/env bash
# run.sh BUILD CC: installs, moves what was installed, and uses it as somebody else's project would.
#
# The installed standard library gets one module that the source tree lacks, so that a shader which imports it compiles
# only if the installed copy is found, whether or not the source tree is still there.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
build=$(realpath "$1")
export CC=$2
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
fail() { echo "install: $*" >&2; exit 1; }

cmake --install "$build" --prefix "$scratch/first" >"$scratch/install.log"
mv "$scratch/first" "$scratch/moved"
prefix=$scratch/moved
unset SALTUS_STDLIB LD_LIBRARY_PATH PYTHONPATH
export XDG_CACHE_HOME=$scratch/cache
cat >"$prefix/share/saltus/stdlib/only_installed.salt" <<'SALT'
// The stand-in for a module of an installation.
float disc_of_the_installed(float2 x, float r) { return length(x) - r; }
SALT
for page in man1/saltus.1 man1/saltus-render.1 man3/saltus.3; do
    [ -s "$prefix/share/man/$page" ] || fail "no manual page $page"
done
for f in bash-completion/completions/saltus zsh/site-functions/_saltus fish/vendor_completions.d/saltus.fish; do
    [ -s "$prefix/share/$f" ] || fail "no completion $f"
done

# The command, by its path, through PATH and through a link.
cat >"$scratch/disc.salt" <<'SALT'
import only_installed;
param float radius = 0.5;
[Domain(-1.0, 1.0)] shader float main(float2 x) {
    float f = 0.0;
    [Disc] if (disc_of_the_installed(x, radius) < 0.0) f = 1.0;
    return f;
}
SALT
cd "$scratch"
grad=(grad disc.salt --integral --samples 4096 --json)
"$prefix/bin/saltus" "${grad[@]}" | grep -q '"gradient"' || fail "the command by its path"
PATH="$prefix/bin:$PATH" saltus "${grad[@]}" | grep -q '"gradient"' || fail "the command through PATH"
ln -s "$prefix/bin/saltus" linked
./linked "${grad[@]}" | grep -q '"gradient"' || fail "the command through a link"

# LLVM is loaded to compile, and not when everything comes from the cache.
loads() { LD_DEBUG=files "$@" 2>&1 >/dev/null | grep -c 'calling init: .*libLLVM' || true; }
[ "$(loads "$prefix/bin/saltus" "${grad[@]}")" -eq 0 ] || fail "a cached run loads LLVM"
[ "$(loads "$prefix/bin/saltus" --version)" -eq 0 ] || fail "--version loads LLVM"
[ "$(loads "$prefix/bin/saltus" "${grad[@]}" --no-cache)" -eq 1 ] || fail "a compiling run does not load LLVM, so the two checks above show nothing"

# libsaltus.so exports the public functions, all of them, and nothing else.
library=$(find "$prefix" -name libsaltus.so)
nm -D --defined-only "$library" | awk '{print $3}' | sort >exported
grep -v '^slt_' exported && fail "exported beside slt_*"
grep -ohE '\bslt_[a-z0-9_]+\(' "$prefix"/include/saltus/*.h | tr -d '(' | sort -u >declared
[ -s declared ] || fail "no declarations found"
comm -23 declared exported | grep . && fail "declared and not exported"

# So does libsaltus.a, which is one object: other archives may have names that its inside has too.
archive=$(find "$prefix" -name libsaltus.a)
nm -g --defined-only "$archive" | awk 'NF == 3 { print $3 }' | sort >global
diff exported global >&2 || fail "libsaltus.a and libsaltus.so export different names"
nm -g --defined-only "$build/libsaltus.a" 2>/dev/null | awk 'NF == 3 && $3 !~ /^slt_/ { print $3 }' | sort -u >inside
[ -s inside ] || fail "no names inside: the next check shows nothing"
awk '{ printf "int %s(void) { return 0; }\n", $1 } END { print "int clash(void) { return 0; }" }' inside >clash.c
cat >clash_main.c <<'C'
#include <saltus/saltus.h>
int clash(void);
int main(void) {
    SltOptions options = SLT_OPTIONS_INIT;
    SltProgram *p;
    SltStatus status = slt_compile_string("shader float main(float2 x) { return x.x; }", "line", &options, &p);
    slt_program_free(p);
    return clash() + (int)status;
}
C
$CC -fno-builtin -w -c clash.c && ar rcs libclash.a clash.o
for order in "$archive libclash.a" "libclash.a $archive" "-Wl,--whole-archive libclash.a $archive -Wl,--no-whole-archive"; do
    $CC clash_main.c -I "$prefix/include" $order -lOpenEXRCore -lpng -ljansson -lpthread -ldl -lm -o clashing || fail "clashing names: $order"
    SALTUS_STDLIB=$prefix/share/saltus/stdlib ./clashing || fail "clashing names, run: $order"
done

# find_package, shared and static.
cmake -S "$here/consumer" -B consumer -DCMAKE_PREFIX_PATH="$prefix" >cmake.log || { cat cmake.log; fail "find_package"; }
cmake --build consumer >build.log 2>&1 || { cat build.log; fail "building against the package"; }
consumer/shared || fail "the shared consumer"
consumer/cxx || fail "the C++ consumer"
# A program that holds the archive may lie anywhere, so it is told where the standard library is.
SALTUS_STDLIB=$prefix/share/saltus/stdlib consumer/static || fail "the static consumer"

# pkg-config.
export PKG_CONFIG_PATH=$(dirname "$(find "$prefix" -name saltus.pc)")
needs_library() { readelf -d "$1" | grep -q 'NEEDED.*libsaltus'; }
$CC "$here/consumer/consumer.c" -o by_pkg_config $(pkg-config --cflags --libs saltus) -lm
needs_library by_pkg_config || fail "pkg-config links libsaltus.a"
LD_LIBRARY_PATH=$(dirname "$library") ./by_pkg_config || fail "the pkg-config consumer"
$CC "$here/consumer/consumer.c" -o by_archive $(pkg-config --static --cflags --libs saltus) -lm
needs_library by_archive && fail "pkg-config --static links libsaltus.so"
SALTUS_STDLIB=$prefix/share/saltus/stdlib ./by_archive || fail "the pkg-config --static consumer"

# The lines that the installation ends with make a shell, the linker and pkg-config find it.
sed -n "s|$scratch/first|$prefix|; /^ *export /p" install.log >lines
python_dir=$(sed -n 's/^SALTUS_PYTHON_DIR:[^=]*=//p' "$build/CMakeCache.txt")
[ "$(wc -l <lines)" -eq $((3 + (${#python_dir} > 0))) ] || { cat install.log; fail "not the lines that a prefix elsewhere needs"; }
(
    unset PKG_CONFIG_PATH
    . ./lines
    [ "$(command -v saltus)" = "$prefix/bin/saltus" ] || fail "PATH, as the installation gives it"
    $CC "$here/consumer/consumer.c" -o by_lines $(pkg-config --cflags --libs saltus) -lm || fail "PKG_CONFIG_PATH, as the installation gives it"
    ./by_lines || fail "LD_LIBRARY_PATH, as the installation gives it"
    if [ -n "$python_dir" ] && python3 -c 'import numpy' 2>/dev/null; then
        found=$(python3 -c 'import saltus; saltus.compile("import only_installed; shader float main(float2 x) { return x.x; }"); print(saltus.library_path)') ||
            fail "PYTHONPATH, as the installation gives it"
        [[ $(realpath "$found") == "$(realpath "$prefix")"/* ]] || fail "the module of the installation loads $found"
    fi
)

# The program with a loss of its own in docs/library.md does what the page says it prints.
root=$here/../..
awk '/^```c$/ { n++; on = n == 2; next } /^```$/ { on = 0 } on' "$root/docs/library.md" >own_loss.c
awk '/^```salt$/ && !done { on = 1; next } /^```$/ { if (on) done = 1; on = 0 } on' "$root/README.md" >disc_of_readme.salt
$CC -std=c17 -Wall -Wextra -Werror own_loss.c -o own_loss $(pkg-config --cflags --libs saltus)
said=$(LD_LIBRARY_PATH=$(dirname "$library") ./own_loss disc_of_readme.salt) || fail "the loss of its own"
radius() { sed -n 's/.*loss .* at radius \([0-9.]*\).*/\1/p'; }
shown=$(grep '^    loss .* at radius' "$root/docs/library.md" | radius)
awk -v a="$(echo "$said" | radius)" -v b="$shown" 'BEGIN { exit !(a > 0.5 && a - b < 0.01 && b - a < 0.01) }' || fail "a loss of its own: \`$said\`, the page shows $shown"

# And the one that fits.
awk '/^```c$/ { on = 1; text = ""; next } /^```$/ { if (on && index(text, "slt_fit(")) { printf "%s", text; exit } on = 0 } on { text = text $0 "\n" }' "$root/docs/library.md" >fit.c
$CC -std=c17 -Wall -Wextra -Werror fit.c -o fit $(pkg-config --cflags --libs saltus)
said=$(LD_LIBRARY_PATH=$(dirname "$library") ./fit disc_of_readme.salt 2>fit.log) || { cat fit.log; fail "the fit"; }
grep -qF "    $said" "$root/docs/library.md" || fail "the fit: \`$said\` is not what the page shows"
