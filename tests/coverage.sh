#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds format and runtime_min alone, runs their tests, and says how many lines of what reads bundles
# those reach; fails under 95 %.
#   tests/coverage.sh
set -euo pipefail
cd "$(dirname "$0")/.."

examples/install_packages.sh
folder=build/coverage
cmake -S . -B $folder -G Ninja -DCMAKE_BUILD_TYPE=Debug -DENVBAKE_BUILD_BAKER=OFF \
    -DCMAKE_CXX_FLAGS="--coverage -O0" ${ENVBAKE_CMAKE_ARGS:-} >/dev/null
find $folder -name '*.gcda' -delete
cmake --build $folder
ctest --test-dir $folder --output-on-failure -j "$(nproc)" -E package >/dev/null

report=$folder/lines.txt  # by gcov: "File '...'", then "Lines executed:97.12% of 104"
(cd $folder && find . -path '*/CMakeFiles/envbake_*' -name '*.gcda' -exec gcov --no-output {} +) >$report

status=0
for source in format/src/reader.cpp runtime_min/src/bundle.cpp; do
    awk -v source="$source" '
        /^File/ { found = index($0, source) }
        found && /^Lines/ {
            sub(/.*:/, ""); sub(/%.*/, "")
            printf "%-32s %6.2f %%\n", source, $0
            exit $0 < 95
        }' $report || status=1
done
exit $status
