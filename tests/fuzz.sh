#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Fuzzes the reader of bundles under ASan and UBSan, from the corpus in tests/fuzz/corpus.
#   tests/fuzz.sh [SECONDS]      default: 30
# A finding is left in build/fuzz/findings and makes the exit status 1.
set -euo pipefail
cd "$(dirname "$0")/.."

examples/install_packages.sh --clang
cmake --preset fuzz ${ENVBAKE_CMAKE_ARGS:-}
cmake --build --preset fuzz --target fuzz_bundle
mkdir -p build/fuzz/findings build/fuzz/corpus/bundle
# No more memory than the format lets a file of this size ask for, and then some.
build/fuzz/bin/fuzz_bundle build/fuzz/corpus/bundle tests/fuzz/corpus/bundle \
    -artifact_prefix=build/fuzz/findings/ -max_total_time="${1:-30}" -max_len=65536 \
    -malloc_limit_mb=20 -rss_limit_mb=1024 -timeout=10 -print_final_stats=1
