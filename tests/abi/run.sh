#!/usr/bin/env bash
# run.sh LIBRARY ABIDW ABIDIFF: is the binary interface of the library, as far as include/saltus shows it, the one that is
# committed? BLESS=1 commits to it.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
library=$1 abidw=$2 abidiff=$3
committed=$here/libsaltus.abi
found=$(mktemp)
trap 'rm -f "$found"' EXIT
"$abidw" --headers-dir "$here/../../include/saltus" --drop-private-types --exported-interfaces-only --drop-undefined-syms \
    --no-architecture --no-corpus-path --no-comp-dir-path --no-show-locs --no-elf-needed --type-id-style hash "$library" >"$found"
if [ "${BLESS:-}" = 1 ]; then
    cp "$found" "$committed"
    exit
fi
"$abidiff" "$committed" "$found" || {
    echo "abi: the interface has changed. If it should have, BLESS=1 writes it down; a member that moved or a function that went" \
        "breaks programs that are out there" >&2
    exit 1
}
