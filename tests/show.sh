#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Shows on real data what no unit test shows: every environment with three meshes baked, validated and
# rendered; the pictures against the traced truth; start-up; damaged files. Figures on stdout,
# pictures in the folder.
#   tests/show.sh DATA [FOLDER]     DATA holds environments/, meshes/, malformed/; uses build/release
set -euo pipefail
data=$(realpath "$1")
out=${2:-out/show}
bin=$(dirname "$0")/../build/release/bin
mkdir -p "$out"

echo "== every environment, three meshes: bake, validate, render"
for environment in "$data"/environments/*.{hdr,exr} "$data"/environments/*/*.{hdr,exr}; do
    for mesh in suzanne shader_ball cesium_milk_truck; do
        name=$(basename "${environment%.*}")-$mesh
        "$bin/envbake" bake "$data/meshes/$mesh.glb" --env "$environment" -o "$out/$name.envb" --quiet
        "$bin/envbake" validate "$out/$name.envb" >/dev/null
        "$bin/envbake" render "$out/$name.envb" "$data/meshes/$mesh.glb" -o "$out/$name.png" \
            --size 480x360 --quiet
        echo "$name: $("$bin/envbake" dump "$out/$name.envb" | sed -n 's/^got *//p')"
    done
done

echo "== white paper against the traced truth"
"$bin/envbake-sample" "$out" >/dev/null
for environment in potsdamer_platz_1k kloppenheim_05_1k; do
    for scene in "$data/meshes/suzanne.glb" "$data/meshes/shader_ball.glb" "$out/scene.glb"; do
        name=$environment-$(basename "$scene" .glb)-white
        "$bin/envbake" bake "$scene" --env "$data/environments/$environment.hdr" -o "$out/$name.envb" --quiet
        echo "$name"
        "$bin/envbake" render "$out/$name.envb" "$scene" --env "$data/environments/$environment.hdr" \
            -o "$out/$name.png" --size 480x270 --sights 2 --white --reference --reference-samples 1024 --quiet
    done
done

echo "== a sun in SH and mips, and extracted: materials against the traced truth"
for scene in "$data/meshes/suzanne.glb" "$data/meshes/shader_ball.glb" "$out/scene.glb"; do
    environment=$data/environments/kloppenheim_05_1k.hdr
    for option in "" --extract-lights; do
        name=$(basename "$scene" .glb)-sun${option#-}
        # shellcheck disable=SC2086
        "$bin/envbake" bake "$scene" --env "$environment" -o "$out/$name.envb" --quiet $option
        echo "$name: $("$bin/envbake" render "$out/$name.envb" "$scene" --env "$environment" \
            -o "$out/$name.png" --size 480x270 --sights 2 --reference --reference-samples 1024 --quiet)"
    done
done

echo "== start-up: seconds, kB resident"
bundle=$out/kloppenheim_05_1k-suzanne.envb
for command in version --help "dump $bundle" "validate $bundle" \
    "plan $data/meshes/suzanne.glb --env $data/environments/kloppenheim_05_1k.hdr -o $bundle"; do
    # shellcheck disable=SC2086
    /usr/bin/time -f "%e %M  $command" "$bin/envbake" $command 2>&1 >/dev/null
done

echo "== damaged files: exit status, lines, output left, seconds, kB resident"
cd "$data/malformed"
find . -type f \( -name '*.exr' -o -name '*.hdr' -o -name '*.glb' -o -name '*.gltf' \) | sort |
    while read -r file; do
        option=
        case $file in *.exr | *.hdr) option=--env ;; esac
        rm -f "$OLDPWD/$out/x.envb"
        status=0
        # shellcheck disable=SC2086
        usage=$(/usr/bin/time -f "%e %M" -o /dev/stdout "$OLDPWD/$bin/envbake" bake $option "$file" \
            -o "$OLDPWD/$out/x.envb" --quiet 2>"$OLDPWD/$out/x.err" | tail -1) || status=$?
        left=no
        [[ -e $OLDPWD/$out/x.envb ]] && left=yes
        echo "$status $(wc -l <"$OLDPWD/$out/x.err") $left $usage $file"
    done
