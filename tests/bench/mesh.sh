#!/usr/bin/env bash
# Rays against meshes beside Embree 3 (libembree-dev, where installed): tests/bench/mesh.sh BUILD_DIR [options of bench-mesh]. SALTUS_DATA has spot.obj.
set -euo pipefail
build=${1:?usage: tests/bench/mesh.sh BUILD_DIR [--mesh spot,spot4,spot16,sphere] [--pixels N] [--rounds N] [--isa best|plain|avx2|avx512|all]}
shift
cmake --build "$build" --target bench-mesh >/dev/null
exec "$build/tests/bench-mesh" "$@"
