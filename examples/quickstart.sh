#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# From a fresh Debian 12 to a baked and rendered scene: installs what is missing, builds, makes a
# sample sky and scene, bakes them, and looks at the result.
#   examples/quickstart.sh [FOLDER]     where the files go; default: out/quickstart
set -euo pipefail
cd "$(dirname "$0")/.."

out=${1:-out/quickstart}
examples/install_packages.sh
cmake --preset quickstart >/dev/null
cmake --build --preset quickstart
bin=build/quickstart/bin
mkdir -p "$out"

say() { printf '\n--- %s\n' "$*"; }

say "sample sky and scene"
"$bin/envbake-sample" "$out"

say "what will be baked, and why"
"$bin/envbake" plan "$out/scene.glb" --env "$out/sky.hdr" --extract-lights

say "bake"
"$bin/envbake" bake "$out/scene.glb" --env "$out/sky.hdr" --extract-lights -o "$out/scene.envb"

say "what is in the bundle"
"$bin/envbake" dump "$out/scene.envb"
"$bin/envbake" validate "$out/scene.envb"

say "render through the runtime"
"$bin/envbake" render "$out/scene.envb" "$out/scene.glb" -o "$out/scene.png"

say "done"
for file in sky.hdr scene.glb scene.envb scene.png; do
    printf '%s/%s\n' "$(realpath "$out")" "$file"
done
