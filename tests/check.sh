#!/usr/bin/env bash
# What is checked of the sources beside the tests: ./bootstrap check [WHAT ...], without an argument `format memory`.
#
#   format    the sources are as .clang-format breaks them
#   memory    the quick tests under the sanitizers of addresses, leaks and undefined behaviour, in build/memory
#   threads   the tests that share work between threads under the sanitizer of threads, in build/threads
#   fuzz      tests/fuzz with clang's engine and sanitizers, in build/fuzz: each target SECONDS_EACH (default 600) long
#   tidy      clang-tidy over everything: minutes of every core
#   all       these but `fuzz`, and under `memory` all tests but the examples
#
# Builds stay, so a second run compiles what changed. JOBS=n: so many at once (default: all cores). Sanitizers are clang's
# where it is installed. TESTS=REGEX: those tests instead of the chosen ones.
set -euo pipefail
cd "$(dirname "$0")/.."

jobs=${JOBS:-$(nproc)}
quick='^(api|back|base|docs|front|fuzz|golden|image|ir|optimise|pass)\.|^kernels\.witness|^lang\.nasty|^sample\.(coincide|estimate)|^quadrature\.(boxes|cells|images|lists)|^cli\.(shaders\.quadrature|grad\.(bits|explain)|render\.basics)'
threaded='^(base|api|optimise)\.|^sample\.(coincide|estimate|images)|^quadrature\.(images|quadrature)|^cli\.(grad\.bits|watched)|^view\.viewer'

configure() { # folder, options of cmake
    cmake -S . -B "$1" -G Ninja "${@:2}" >/dev/null
}

configure_sanitized() { # folder, options of cmake
    local clang
    clang=$(command -v clang-19 || true)
    configure "$1" ${clang:+-DCMAKE_C_COMPILER="$clang"} "${@:2}"
}

# Builds what the tests that match need, and runs them: folder, pattern, options of ctest.
run_tests() {
    local targets
    targets=$(ctest --test-dir "$1" -N -R "$2" | sed -nE 's/^ *Test +#[0-9]+: (fuzz)\.(.*)/\1-\2/p; s/^ *Test +#[0-9]+: ([a-z]+)\.([a-z_]+)$/test-\1-\2/p' | grep -v '^test-fuzz')
    # shellcheck disable=SC2086 # one word a target
    cmake --build "$1" -j "$jobs" --target saltus-cli $targets
    ctest --test-dir "$1" -R "$2" -j "$jobs" --output-on-failure --timeout 3600 "${@:3}"
}

check_format() {
    configure build
    cmake --build build --target check-format
}

check_memory() { # all tests, or those of a pattern
    configure_sanitized build/memory -DSALTUS_SANITIZE=address,undefined
    if [ -n "${1:-}" ]; then
        run_tests build/memory "$1"
    else
        cmake --build build/memory -j "$jobs"
        ctest --test-dir build/memory -j "$jobs" --output-on-failure --timeout 3600 -E '^(examples|install)\.'
    fi
}

check_threads() {
    configure_sanitized build/threads -DSALTUS_SANITIZE=thread
    run_tests build/threads "${TESTS:-$threaded}"
}

# What the engine adds to the corpus stays in build/fuzz/corpus, what it finds lies in build/fuzz/found.
check_fuzz() {
    configure_sanitized build/fuzz -DSALTUS_FUZZ=ON -DSALTUS_SANITIZE=address,undefined
    local name failed=0
    for name in source json scene image mesh object; do
        cmake --build build/fuzz -j "$jobs" --target "fuzz-$name"
        mkdir -p "build/fuzz/corpus/$name" build/fuzz/found
        local options=(-max_total_time="${SECONDS_EACH:-600}" -rss_limit_mb=1024 -timeout=60 -close_fd_mask=3 -artifact_prefix="build/fuzz/found/$name-")
        local seeds=("tests/fuzz/corpus/$name")
        [ "$name" = source ] && options+=(-dict=tests/fuzz/salt.dict) && seeds+=(tests/lang tests/programs)
        echo "fuzz-$name"
        "build/fuzz/tests/fuzz-$name" "${options[@]}" "build/fuzz/corpus/$name" "${seeds[@]}" || failed=1
    done
    return $failed
}

check_tidy() {
    configure build
    cmake --build build --target tidy
}

[ $# -gt 0 ] || set -- format memory
for what in "$@"; do
    case "$what" in
    format) check_format ;;
    memory) check_memory "${TESTS:-$quick}" ;;
    threads) check_threads ;;
    fuzz) check_fuzz ;;
    tidy) check_tidy ;;
    all)
        check_format
        check_memory
        check_threads
        check_tidy
        ;;
    *)
        sed -n '2,13s/^# \{0,1\}//p' "$0"
        echo "check: unknown \`$what\`" >&2
        exit 2
        ;;
    esac
done
