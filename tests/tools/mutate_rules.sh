#!/bin/sh
# Spoils every partial of compiler/ir/ops.def in turn (negated, doubled, dropped) and checks that the comparison with finite differences fails each time.
# The spoiling is a hook in ad_rules.c that only this build compiles, so two files are rebuilt, not one a rule.
#   tests/tools/mutate_rules.sh BUILD_DIR      a configured and built tree
set -eu
build=${1:?usage: mutate_rules.sh BUILD_DIR}
exec cmake --build "$build" --target mutation
