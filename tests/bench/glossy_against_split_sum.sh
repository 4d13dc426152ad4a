#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# A plain material of every roughness: glossy transport and the split sum, each against the traced
# reference of the same view (CSV and SVG); and what glossy transport adds to the time of a bake.
#   tests/bench/glossy_against_split_sum.sh FOLDER [DATA]    DATA: the folder of real test input
set -euo pipefail
cd "$(dirname "$0")/../.."
folder=$(realpath -m "${1:?a folder for the CSV and the plots}")
data=$(realpath "${2:-../shared/data}")
cmake --preset release
cmake --build --preset release --target envbake
envbake=build/release/bin/envbake
mkdir -p "$folder"

rmse() {  # the picture's relative rms error and the reference's noise, per cent
    "$envbake" render "$folder/x.envb" "$folder/x.glb" --env "$data/environments/$2.hdr" --quiet \
        --size 400x300 --sights 2 --reference --reference-samples 256 -o "$1" "${@:3}" |
        sed -n 's/.*relative RMSE \([^ ]*\) %.*reference noise \([^ ]*\) %.*/\1 \2/p'
}

echo "scene,environment,metallic,roughness,glossy_percent,split_sum_percent,noise_percent" |
    tee "$folder/glossy.csv"
for scene in suzanne shader_ball; do
    for environment in kloppenheim_05_1k lebombo_1k; do
        for metallic in 1 0; do
            for roughness in 0.2 0.3 0.4 0.5 0.6 0.8 1; do
                tests/bench/with_material.py "$data/meshes/$scene.glb" "$folder/x.glb" "$roughness" "$metallic"
                "$envbake" bake "$folder/x.glb" --env "$data/environments/$environment.hdr" --glossy all \
                    --extract-lights --force --quiet -o "$folder/x.envb"
                name=$folder/$scene-$environment-$metallic-$roughness
                read -r glossy noise < <(rmse "$name.png" "$environment")
                read -r split _ < <(rmse "$name-split-sum.png" "$environment" --split-sum)
                echo "$scene,$environment,$metallic,$roughness,$glossy,$split,$noise"
            done
        done
    done
done | tee -a "$folder/glossy.csv"
rm "$folder/x.glb" "$folder/x.envb"
tests/bench/plot_glossy.py "$folder/glossy.csv" "$folder/glossy_against_split_sum.svg"

echo "scene,without_cpu_s,with_cpu_s,ratio" | tee "$folder/glossy_cost.csv"
for scene in stanford_bunny shader_ball dungeon_hall suzanne; do
    tests/bench/with_material.py "$data/meshes/$scene.glb" "$folder/x.glb" 0.6 0
    for run in 1 2 3 4 5; do  # in turn, for the machine is not always as fast
        for option in "" "--glossy all"; do
            # shellcheck disable=SC2086
            /usr/bin/time -f "$scene,${option:-none},%U,%S" "$envbake" bake "$folder/x.glb" $option --force --quiet \
                -o "$folder/x.envb" 2>&1
        done
    done | awk -F, '{ t = $3 + $4; if (!($2 in least) || t < least[$2]) least[$2] = t }
        END { a = least["none"]; b = least["--glossy all"]; printf "%s,%.2f,%.2f,%.2f\n", $1, a, b, b / a }'
done | tee -a "$folder/glossy_cost.csv"
rm "$folder/x.glb" "$folder/x.envb"
