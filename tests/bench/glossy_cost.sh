#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# What glossy transport adds to a bake of a material of roughness 0.6, without and with light between
# surfaces: CPU seconds of whole bakes, the least of five. CSV.
#   tests/bench/glossy_cost.sh [DATA]    DATA: the folder of real test input
# ENVBAKE names another program than build/release has, SCENES other scenes than those below.
set -euo pipefail
cd "$(dirname "$0")/../.."
data=$(realpath "${1:-../shared/data}")
envbake=${ENVBAKE:-build/release/bin/envbake}
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

echo "scene,without_cpu_s,with_cpu_s,ratio,bounces_without_cpu_s,bounces_with_cpu_s,bounces_ratio"
for scene in ${SCENES-stanford_bunny shader_ball dungeon_hall suzanne}; do
    tests/bench/with_material.py "$data/meshes/$scene.glb" "$scratch/x.glb" 0.6 0
    for _ in 1 2 3 4 5; do  # in turn, for the machine is not always as fast
        for option in "" "--glossy all" "--bounces all" "--bounces all --glossy all"; do
            # shellcheck disable=SC2086
            echo "$scene,${option:-none},$("$(dirname "$0")/peak_memory.py" "$envbake" bake "$scratch/x.glb" $option \
                --force --quiet -o "$scratch/x.envb")"  # peak_mb,wall_s,cpu_s
        done
    done | awk -F, '{ t = $5; if (!($2 in least) || t < least[$2]) least[$2] = t }
        END { a = least["none"]; b = least["--glossy all"]
              c = least["--bounces all"]; d = least["--bounces all --glossy all"]
              printf "%s,%.3f,%.3f,%.2f,%.3f,%.3f,%.2f\n", $1, a, b, b / a, c, d, d / c }'
done
