#!/usr/bin/env bash
# Heightfields beside Embree 3 (libembree-dev, where installed): tests/bench/field.sh BUILD_DIR [options of bench-field]. SALTUS_DATA has the real elevations.
set -euo pipefail
build=${1:?usage: tests/bench/field.sh BUILD_DIR [--terrain dem|fbm] [--size N] [--json FILE] [--exact COUNT]}
shift
cmake --build "$build" --target bench-field >/dev/null
exec "$build/tests/bench-field" "$@"
