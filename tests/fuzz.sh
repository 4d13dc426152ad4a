#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Fuzzes what reads files, under ASan and UBSan: bundles, scenes, compressed meshes, environments,
# and the decoders of images; and what writes bundles.
#   tests/fuzz.sh [SECONDS [TARGET...]]      default: 30, shared by: bundle write validate scene
#                                            compression environment image; there is also plan,
#                                            which links the whole baker
# What was found on the way is kept in build/fuzz/corpus, so that the next run goes on from there.
# A finding is left in build/fuzz/findings and makes the exit status 1.
set -euo pipefail
cd "$(dirname "$0")/.."

targets=("${@:2}")
[[ ${#targets[@]} -gt 0 ]] || targets=(bundle write validate scene compression environment image)
seconds=$((${1:-30} / ${#targets[@]}))

examples/install_packages.sh --clang
cmake --preset fuzz ${ENVBAKE_CMAKE_ARGS:-}
cmake --build --preset fuzz --target make_meshes "${targets[@]/#/fuzz_}"
seeds=build/fuzz/seeds
build/fuzz/bin/make_meshes $seeds/compression
python3 tests/fuzz/make_corpus.py $seeds
mkdir -p build/fuzz/findings $seeds/bundle $seeds/write $seeds/validate
cp tests/fuzz/corpus/bundle/* $seeds/bundle
cp tests/fuzz/corpus/bundle/* $seeds/validate
if [[ " ${targets[*]} " == *" plan "* ]]; then  # what the others have found is what can be planned
    mkdir -p $seeds/plan build/fuzz/corpus/{scene,environment}
    find {$seeds,build/fuzz/corpus}/{scene,environment} -type f -exec cp -t $seeds/plan {} +
fi

# No more memory than the format lets a bundle of this size ask for, and then some. A scene may
# claim many vertices of a small file. OpenEXR asks for what an attribute claims, up to 2 GB: the
# worker that decodes images has a limit of its own. Draco fills what a few bytes claim for seconds.
declare -A malloc_limit_mb=([bundle]=20 [write]=64 [validate]=64 [scene]=1024 [compression]=1024 [plan]=1024
    [environment]=1024 [image]=4096)
declare -A max_len=([bundle]=65536 [write]=1024 [validate]=65536 [scene]=16384 [compression]=4096 [plan]=16384
    [environment]=8192 [image]=8192)
declare -A timeout=([scene]=100 [compression]=100 [plan]=100)
for target in "${targets[@]}"; do
    mkdir -p "build/fuzz/corpus/$target"
    printf '\n--- %s, %s s\n' "$target" "$seconds"
    build/fuzz/bin/fuzz_"$target" build/fuzz/corpus/"$target" $seeds/"$target" \
        -artifact_prefix=build/fuzz/findings/"$target"- -max_total_time="$seconds" \
        -max_len="${max_len[$target]}" -malloc_limit_mb="${malloc_limit_mb[$target]}" \
        -rss_limit_mb=2048 -timeout="${timeout[$target]:-10}" -print_final_stats=1
done
