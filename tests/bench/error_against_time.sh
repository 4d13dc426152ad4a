#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Error against time of the lighting stages and of the textbook methods: builds, measures for some
# minutes, and leaves measured.csv and an SVG a stage.
#   tests/bench/error_against_time.sh FOLDER [DATA]    DATA: the folder of real test input
set -euo pipefail
cd "$(dirname "$0")/../.."
folder=$(realpath -m "${1:?a folder for the CSV and the plots}")

cmake --preset bench ${2:+-DENVBAKE_TEST_DATA="$(realpath "$2")"}
cmake --build --preset bench --target error_against_time
mkdir -p "$folder"
build/bench/bin/error_against_time | tee "$folder/measured.csv"
tests/bench/plot.py "$folder/measured.csv" "$folder"
