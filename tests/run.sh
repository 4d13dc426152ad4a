#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs what is missing, builds and runs every test.
#   tests/run.sh [PRESET]     a preset of CMakePresets.json; default: release
set -euo pipefail
cd "$(dirname "$0")/.."

preset=${1:-release}
case $preset in
    *clang* | tsan) examples/install_packages.sh --clang ;;
    *) examples/install_packages.sh ;;
esac
cmake --preset "$preset" ${ENVBAKE_CMAKE_ARGS:-}
cmake --build --preset "$preset"
ctest --preset "$preset" -j "$(nproc)" ${ENVBAKE_CTEST_ARGS:-}
