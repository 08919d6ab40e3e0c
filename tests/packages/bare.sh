#!/usr/bin/env bash
# bare.sh PACKAGES FOLDER: are the packages in the folder PACKAGES all that a bare Debian 12 needs? As root, with debootstrap
# and the network. FOLDER is kept, so that a second run begins with its base.
set -euo pipefail
packages=$(realpath "$1") root=$(realpath -m "$2")
fail() { echo "packages: $*" >&2; exit 1; }
[ -x "$root/usr/bin/apt-get" ] || debootstrap --variant=minbase bookworm "$root" >/dev/null

inside() { chroot "$root" /usr/bin/env -i PATH=/usr/bin:/bin:/usr/sbin:/sbin HOME=/root LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive \
    http_proxy="${http_proxy:-}" https_proxy="${https_proxy:-}" bash -euc "$1"; }
finish() { umount "$root/proc" 2>/dev/null || true; }
trap finish EXIT
mount -t proc proc "$root/proc"
mkdir -p "$root/packages"
cp "$packages"/*.deb "$packages"/Packages "$root/packages/"
echo 'deb [trusted=yes] file:/packages ./' >"$root/etc/apt/sources.list.d/saltus.list"
inside 'apt-get update -q' >/dev/null
left() { inside "find / -xdev \( -path /proc -o -path /packages -o -path /root -o -path /tmp -o -path /var/cache/apt -o -path /var/cache/man -o -path /var/lib/apt \) -prune \
    -o -iname '*saltus*' -print | grep -v '^/etc/apt/sources.list.d/saltus.list$' || true"; }
[ -z "$(left)" ] || fail "there is something of saltus before anything is installed: $(left)"

echo "packages: apt install ./python3-saltus*.deb"
inside 'cd /packages && apt-get install -q -y --no-install-recommends ./python3-saltus_*.deb' >"$root/tmp/apt.log" 2>&1 || { tail -20 "$root/tmp/apt.log"; fail "python3-saltus"; }
inside 'cd /tmp && python3 -' <<'E2' || fail "the module in Python"
import importlib.metadata
import saltus

p = saltus.compile("""
param float radius = 0.3;
param float2 centre = float2(0.2, -0.1);
[Domain(-1.0, 1.0)] shader float3 main(float2 x) {
    float3 c = float3(0.9);
    [Disc] if (length(x - centre) < radius) c = float3(0.9, 0.3, 0.1);
    return c;
}
""")
target = p.render(64, spp=4)
p["radius"] = 0.5
p["centre"] = [-0.1, 0.1]
p.fit(target, spp=4, iters=150)
target.save("fitted.png")
assert abs(p["radius"] - 0.3) < 0.01 and abs(p["centre"][1] + 0.1) < 0.01, p.params
assert importlib.metadata.version("saltus") == saltus.__version__
p.check()
print("packages: fitted in Python:", float(p["radius"]), p["centre"], saltus.library_path)
E2

echo "packages: the command"
inside 'cd /tmp && saltus render --expr "length(x - 0.5) < 0.4 ? 1.0 : 0.1" -o disc.png && test -s disc.png' || fail "saltus render"
inside 'cd /tmp && echo "import sdf; param float r = 0.4; [Domain(-1.0, 1.0)] shader float main(float2 x) { float f = 0.0; [Disc] if (length(x) < r) f = 1.0; return f; }" >disc.salt
    saltus check disc.salt | tail -1 | grep -qx PASS' || fail "saltus check"
for f in bash-completion/completions/saltus zsh/vendor-completions/_saltus fish/vendor_completions.d/saltus.fish; do
    [ -s "$root/usr/share/$f" ] || fail "no completion $f"
done

echo "packages: libsaltus-dev and manual pages"
inside 'apt-get install -q -y --no-install-recommends libsaltus-dev saltus-examples gcc libc6-dev pkg-config man-db' >"$root/tmp/apt.log" 2>&1 || { tail -20 "$root/tmp/apt.log"; fail "libsaltus-dev"; }
for page in saltus saltus-grad "3 saltus" slt_fit slt_render; do
    inside "man $page | grep -q SYNOPSIS" || fail "man $page"
done
inside 'cd /tmp && cat >p.c && gcc -std=c17 -Wall -Werror p.c $(pkg-config --cflags --libs saltus) -o p && ./p && ldd p | grep -q libsaltus.so.0' <<'E2' || fail "a program in C"
#include <saltus/saltus.h>
int main(void) {
    SltProgram *p;
    SltStatus status = slt_compile_string("import sdf; shader float main(float2 x) { return x.x; }", "line", NULL, &p);
    SltJob job = SLT_JOB_INIT;
    job.size[0] = job.size[1] = 8;
    float image[64];
    SltError err;
    if (status == SLT_OK) status = slt_render(p, &job, image, NULL, &err);
    slt_program_free(p);
    return status;
}
E2
inside 'cp -r /usr/share/doc/saltus-examples/examples /tmp/ && cd /tmp/examples && ./run circle --quick' >"$root/tmp/run.log" 2>&1 || { tail "$root/tmp/run.log"; fail "examples/run circle"; }

# The ten lines that docs/python.md begins with, beside the files that they name.
here=$(cd "$(dirname "$0")" && pwd)
awk '/^## Ten lines/ { there = 1 } there && /^```python/ { on = 1; next } on && /^```/ { exit } on' "$here/../../docs/python.md" >"$root/tmp/ten.py"
[ -s "$root/tmp/ten.py" ] || fail "docs/python.md has no ten lines"
inside 'cd /tmp/examples/painterly_discs && python3 /tmp/ten.py && test -s discs.png' || fail "the ten lines of docs/python.md"

echo "packages: purge"
inside 'apt-get purge -q -y saltus libsaltus0 libsaltus-dev python3-saltus saltus-examples' >"$root/tmp/apt.log" 2>&1 || { tail -20 "$root/tmp/apt.log"; fail "purge"; }
[ -z "$(left)" ] || fail "purge leaves: $(left)"
inside 'dpkg -l | grep -i saltus' && fail "dpkg knows something of saltus still"
echo "packages: all is well"
