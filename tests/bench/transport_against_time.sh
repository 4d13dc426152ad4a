#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Diffuse transport: error against time beside two textbook bakers (CSV and SVG), rays against a bare
# loop, scaling, and what is stated against what is true. Builds, then measures for a quarter of an
# hour.
#   tests/bench/transport_against_time.sh FOLDER [DATA]    DATA: the folder of real test input
set -euo pipefail
cd "$(dirname "$0")/../.."
folder=$(realpath -m "${1:?a folder for the CSV and the plots}")
data=$(realpath "${2:-../shared/data}")

cmake --preset bench -DENVBAKE_TEST_DATA="$data"
cmake --build --preset bench --target transport_against_time transport_check
mkdir -p "$folder"
for what in ladder bare scaling bounces; do
  build/bench/bin/transport_against_time $what | tee "$folder/transport_$what.csv"
done
for scene in stanford_bunny suzanne shader_ball dungeon_hall japanese_bridge_garden flight_helmet lucy_33k; do
  build/bench/bin/transport_check "$data/meshes/$scene.glb" 3e-2 1e-2 3.5e-3
done | awk 'NR == 1 || !/^scene/' | tee "$folder/transport_check.csv"
tests/bench/plot.py "$folder/transport_ladder.csv" "$folder"
