#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# A plain material of every roughness: glossy transport and the split sum, each against the traced
# reference of the same view (CSV and SVG).
#   tests/bench/glossy_against_split_sum.sh FOLDER [DATA]    DATA: the folder of real test input
# ENVBAKE names another program than build/release has; SCENES, ENVIRONMENTS, ROUGHNESS and
# SAMPLES others than those below.
set -euo pipefail
cd "$(dirname "$0")/../.."
folder=$(realpath -m "${1:?a folder for the CSV and the plots}")
data=$(realpath "${2:-../shared/data}")
envbake=${ENVBAKE:-build/release/bin/envbake}
mkdir -p "$folder"

rmse() {  # the picture's relative rms error and the reference's noise, per cent
    "$envbake" render "$folder/x.envb" "$folder/x.glb" --env "$data/environments/$2.hdr" --quiet \
        --size 400x300 --sights 2 --reference --reference-samples "${SAMPLES:-256}" -o "$1" "${@:3}" |
        sed -n 's/.*relative RMSE \([^ ]*\) %.*reference noise \([^ ]*\) %.*/\1 \2/p'
}

echo "scene,environment,metallic,roughness,glossy_percent,split_sum_percent,noise_percent" |
    tee "$folder/glossy.csv"
for scene in ${SCENES-suzanne shader_ball}; do
    for environment in ${ENVIRONMENTS-kloppenheim_05_1k lebombo_1k}; do
        for metallic in 1 0; do
            for roughness in ${ROUGHNESS-0.2 0.3 0.4 0.5 0.6 0.8 1}; do
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
