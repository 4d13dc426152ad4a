#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The pictures of docs/gallery.md and the errors under them, from build/release.
#   tests/bench/gallery.sh FOLDER [DATA]    DATA: the folder of real test input
set -euo pipefail
cd "$(dirname "$0")/../.."
folder=$(realpath -m "${1:?a folder for the pictures}")
data=$(realpath "${2:-../shared/data}")
envbake=build/release/bin/envbake
mkdir -p "$folder"

error() {  # "3.4 %"
    sed -n 's/.*relative RMSE \([^ ]* %\).*/\1/p'
}

echo "Rough metal turning under a sun: degrees, glossy transport, split sum"
scene=$folder/metal.glb bundle=$folder/metal.envb sky=$data/environments/kloppenheim_05_1k.hdr
tests/bench/with_material.py "$data/meshes/suzanne.glb" "$scene" 0.6 1
"$envbake" bake "$scene" --env "$sky" --glossy auto --extract-lights --force --quiet -o "$bundle"
for degrees in 0 90 180 270; do
    render=("$envbake" render "$bundle" "$scene" --env "$sky" --rotate-light "$degrees" --size 280x210
        --sights 3 --reference --reference-samples 1024 --exposure -0.5 --quiet)
    glossy=$("${render[@]}" -o "$folder/metal_$degrees.png" | error)
    split=$("${render[@]}" --split-sum -o "$folder/metal_${degrees}_split.png" | error)
    rm "$folder"/metal_"$degrees"*.difference.png "$folder/metal_${degrees}_split.reference.png"
    echo "| $degrees | $glossy | $split |"
done
"$envbake" render "$bundle" "$scene" --size 280x210 --fov 44 --exposure -0.5 --turntable 24 --quiet -o "$folder/turntable.gif"
rm "$scene" "$bundle"
