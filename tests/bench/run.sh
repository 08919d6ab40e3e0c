#!/usr/bin/env bash
# Side-by-side benchmarks: tests/bench/run.sh BUILD_DIR. Forward shading needs SALTUS_BENCH (a folder with shade/kernels.c); what is not there is skipped.
set -euo pipefail
build=${1:?usage: tests/bench/run.sh BUILD_DIR}
here=$(cd "$(dirname "$0")" && pwd)
cmake --build "$build" --target bench-shade saltus-cli >/dev/null
tmp=$(mktemp -d)
trap 'rm -rf "$tmp"' EXIT
if [ -n "${SALTUS_BENCH:-}" ] && [ -f "$SALTUS_BENCH/shade/kernels.c" ]; then
    clang-19 -O3 -fno-vectorize -fno-slp-vectorize -DSUF=scalar -shared -fPIC -std=gnu11 -march=native "$SALTUS_BENCH/shade/kernels.c" -o "$tmp/scalar.so" -lm
    "$build/tests/bench-shade" "$here" "$tmp/scalar.so:scalar"
else
    echo "SALTUS_BENCH is not set: the comparison with scalar C is skipped"
fi
for k in 1 2 3 4 5; do
    echo "ad_k$k"
    "$build/bin/saltus" bench --kernels "$here/ad_k$k.salt" --quiet
done
echo "2000 opaque discs, 256x256, 4 samples a pixel, one thread: gradient against forward"
"$build/bin/saltus" render "$here/discs_2000.salt" --size 256 --spp 4 --threads 1 -o "$tmp/image.exr" --quiet
for i in 1 2 3; do
    "$build/bin/saltus" render "$here/discs_2000.salt" --size 256 --spp 4 --threads 1 --json --quiet | python3 -c 'import json,sys; print("forward  %.4f s" % json.load(sys.stdin)["seconds"])'
    "$build/bin/saltus" grad "$here/discs_2000.salt" --size 256 --spp 4 --threads 1 --adjoint "$tmp/image.exr" --json --quiet | python3 -c 'import json,sys; print("gradient %.4f s" % json.load(sys.stdin)["seconds"])'
done
