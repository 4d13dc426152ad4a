#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Measures what docs/accuracy.md and docs/performance.md say, and writes it there: tables and plots.
#   tests/bench/report.sh [--quick] [--data DATA] [STEP...]
# DATA     the folder of real test input (../shared/data)
# STEP     only these, by the names below; tables of the others stay, with the run they are of
# --quick  the same tables with fewer rows, in minutes; without it an hour and more
# A step that fails is named at the end, exit status 1, and the others go on. CSV, logs and the state of
# the machine at each step stay in build/report.
set -euo pipefail
cd "$(dirname "$0")/../.."

quick=false data=../shared/data only=()
while (($#)); do
    case $1 in
        --quick) quick=true ;;
        --data) data=${2:?a folder} && shift ;;
        -*) sed -n 's/^#   //p' "$0" >&2 && exit 2 ;;
        *) only+=("$1") ;;
    esac
    shift
done
data=$(realpath "$data")
bin=$PWD/build/bench/bin out=$PWD/build/report
sky=$data/environments/kloppenheim_05_1k.hdr overcast=$data/environments/potsdamer_platz_1k.hdr
export ENVBAKE=$bin/envbake
mkdir -p "$out"
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

cmake --preset bench -DENVBAKE_TEST_DATA="$data" >"$out/build.log"
cmake --build --preset bench >>"$out/build.log" || { tail -20 "$out/build.log" >&2; exit 1; }

either() {  # the first list of words with --quick, the second without
    if $quick; then echo "$1"; else echo "$2"; fi
}
run=$(tests/bench/machine.py "$(either quick full)")
failed=() names=()
step() {  # NAME COMMAND...: what the command prints becomes NAME.csv where it ends well
    local name=$1
    shift
    names+=("$name")
    [[ ${#only[@]} == 0 || " ${only[*]} " == *" $name "* ]] || return 0
    local begin=$SECONDS
    rm -f "$out/$name.csv"
    # In the background, for "set -e" counts for nothing inside a condition.
    (set -e; "$@") >"$out/$name.part" 2>"$out/$name.log" &
    if wait $!; then
        mv "$out/$name.part" "$out/$name.csv"
        echo "$run; load $(cut -d' ' -f2 /proc/loadavg)" >"$out/$name.run"
        echo "$name: $((SECONDS - begin)) s" >&2
    else
        failed+=("$name")
        echo "$name: failed, $out/$name.log: $(tail -1 "$out/$name.log")" >&2
    fi
}
without_headers() {  # of all CSVs but the first
    awk 'NR == 1 { header = $0 } NR == 1 || $0 != header'
}
bake() {
    "$ENVBAKE" bake "$@" --force --quiet
}
google_benchmark() {  # SECONDS PROGRAM [FILTER]
    "$bin/$2" --benchmark_format=csv --benchmark_min_time="$1" --benchmark_filter="${3:-.}" | sed -n '/^name,/,$p'
}

# ---- error ----

transport_check() {
    local scene
    for scene in $(either "stanford_bunny suzanne" \
        "stanford_bunny suzanne shader_ball dungeon_hall japanese_bridge_garden flight_helmet lucy_33k"); do
        "$bin/transport_check" "$data/meshes/$scene.glb" 3e-2 1e-2 3.5e-3
    done | without_headers
}
brdf_tables() {
    local axes size distribution
    echo "distribution,axes,size,texel_error,lookup_error,lookup_rms"
    for axes in roots linear; do
        for size in 64 128; do
            bake --env "$overcast" --distribution both --table-size "$size" --table-axes "$axes" --mip-size 16 \
                -o "$scratch/x.envb"
            "$ENVBAKE" dump "$scratch/x.envb" --json | python3 -c '
import json, sys
for name, b in json.load(sys.stdin)["metadata"]["brdf"].items():
    print(name, *sys.argv[1:], b["texel_error"], b["lookup_error"], b["lookup_error_rms"], sep=",")' "$axes" "$size"
        done
    done
}
glossy_check() {
    local scene
    for scene in $(either "suzanne stanford_bunny" "stanford_bunny suzanne shader_ball dungeon_hall"); do
        "$bin/glossy_check" "$data/meshes/$scene.glb"
    done | without_headers
}
glossy_bounces() {  # white metals among plain dielectrics
    local mesh roughness
    for mesh in $(either cornell_box "cornell_box dungeon_hall flight_helmet shader_ball"); do
        for roughness in 0.5 0.8; do
            tests/bench/with_material.py "$data/meshes/$mesh.glb" "$scratch/$mesh.glb" "$roughness" both
            bake "$scratch/$mesh.glb" --env "$sky" --glossy all --bounces all -o "$scratch/x.envb"
            "$bin/glossy_bounces" "$scratch/$mesh.glb" "$scratch/x.envb" "$(either 50 200)"
        done
    done | without_headers
}
wavelets() {
    local scene size
    for scene in $(either stanford_bunny "stanford_bunny lucy_33k japanese_bridge_garden"); do
        for size in 32 64; do
            "$bin/wavelet_check" "$data/meshes/$scene.glb" "$size" "$sky" \
                "$data/environments/studio_small_03_1k.hdr" "$data/environments/lebombo_1k.hdr"
        done
    done
}
pictures() {  # white paper, by transport alone
    local environment scene
    "$bin/envbake-sample" "$scratch" >/dev/null
    echo "scene,environment,rmse,noise,rmse_in_bands,noise_in_bands"
    for environment in "$overcast" "$sky"; do
        for scene in "$data/meshes/suzanne.glb" "$data/meshes/shader_ball.glb" "$scratch/scene.glb"; do
            bake "$scene" --env "$environment" -o "$scratch/x.envb"
            "$ENVBAKE" render "$scratch/x.envb" "$scene" --env "$environment" -o "$scratch/x.png" --quiet --white \
                --size "$(either 240x135 480x270)" --sights 2 --reference --reference-samples "$(either 512 1024)" |
                sed 's/.*relative RMSE \([^ ]*\) %.*noise[^0-9]*\([^ ]*\) %.*/\1,\2/' | paste -sd, |
                sed "s|^|$(basename "$scene" .glb),$(basename "$environment" .hdr),|"
        done
    done
}

# ---- time and memory ----

memory_map() {
    local height
    echo "width,height,texels_mb,peak_mb,wall_s,cpu_s"
    for height in $(either "1024 2048 4096" "512 1024 2048 4096"); do
        tests/bench/large_inputs.py map "$scratch/map.hdr" "$height"
        echo "$((2 * height)),$height,$((height * height * 24 / 1000000)),$(tests/bench/peak_memory.py \
            "$ENVBAKE" bake --env "$scratch/map.hdr" --force --quiet -o "$scratch/x.envb")"
        rm "$scratch/map.hdr"
    done
}
memory_vertices() {
    local vertices
    echo "vertices,output_mb,peak_mb,wall_s,cpu_s"
    for vertices in $(either "10000 100000 1000000" "10000 100000 1000000 10000000"); do
        tests/bench/large_inputs.py ground "$scratch/ground.glb" "$vertices"
        usage=$(tests/bench/peak_memory.py "$ENVBAKE" bake "$scratch/ground.glb" --rays 48 --force --quiet \
            -o "$scratch/x.envb")
        echo "$vertices,$(($(stat -c %s "$scratch/x.envb") / 1000000)),$usage"
        rm "$scratch/ground.glb"
    done
}
for_both() {  # PROGRAM [FILTER]: built for any x86-64, and for this machine
    cmake --preset bench -B "$out/native" -DCMAKE_CXX_FLAGS=-march=native -DENVBAKE_TEST_DATA="$data" >&2
    cmake --build "$out/native" --target "$1" >&2
    google_benchmark "$(either 0.1 1)" "$@" | sed '1s/^/build,/; 2,$s/^/any x86-64,/'
    bin=$out/native/bin google_benchmark "$(either 0.1 1)" "$@" | sed '1d; s/^/-march=native,/'
}
least_of_5() {  # COMMAND...: peak_mb,wall_s,cpu_s of the run of least CPU time
    local run
    for run in 1 2 3 4 5; do tests/bench/peak_memory.py "$@"; done | sort -t, -k3,3g | sed -n 1p
}
start_up() {
    local bundle=$scratch/suzanne.envb scene=$data/meshes/suzanne.glb
    bake "$scene" --env "$sky" -o "$bundle"
    echo "command,peak_mb,wall_s,cpu_s"
    echo "version,$(least_of_5 "$ENVBAKE" version)"
    echo "dump,$(least_of_5 "$ENVBAKE" dump "$bundle")"
    echo "validate,$(least_of_5 "$ENVBAKE" validate "$bundle")"
    echo "plan,$(least_of_5 "$ENVBAKE" plan "$scene" --env "$sky" -o "$scratch/none.envb")"
    echo "bake,$(least_of_5 "$ENVBAKE" bake "$scene" --env "$sky" -o "$bundle" --quiet --force)"
}
rebuilds() {  # each from the same older bundle
    local bundle=$scratch/x.envb scene=$data/meshes/stanford_bunny.glb
    bake "$scene" --env "$sky" -o "$scratch/older.envb"
    again() {
        local what=$1
        shift
        for _ in 1 2 3; do
            cp -p "$scratch/older.envb" "$bundle"
            tests/bench/peak_memory.py "$ENVBAKE" bake "$@" -o "$bundle" --quiet
        done | sort -t, -k3,3g | sed -n "1s/^/$what,/p"
    }
    echo "change,peak_mb,wall_s,cpu_s"
    again "everything (--force)" "$scene" --env "$sky" --force
    again "nothing" "$scene" --env "$sky"
    again "another environment" "$scene" --env "$overcast"
    again "--mip-size 128" "$scene" --env "$sky" --mip-size 128
    again "--table-size 128" "$scene" --env "$sky" --table-size 128
    again "--tolerance 2e-2" "$scene" --env "$sky" --tolerance 2e-2
}

# shellcheck disable=SC2046
{
    step lighting "$bin/error_against_time" $(either "quick kloppenheim_05_1k" "")
    step brdf_tables brdf_tables
    step transport "$bin/transport_against_time" ladder $(either stanford_bunny "")
    step transport_check transport_check
    step encodings env MESHES="$(either "stanford_bunny suzanne" "stanford_bunny suzanne shader_ball dungeon_hall")" \
        tests/bench/encodings.sh "$data"
    step bounces "$bin/transport_against_time" bounces $(either suzanne \
        "stanford_bunny dungeon_hall japanese_bridge_garden")
    step glossy_pictures env SCENES="$(either suzanne "suzanne shader_ball")" SAMPLES="$(either 128 256)" \
        ENVIRONMENTS="$(either lebombo_1k "kloppenheim_05_1k lebombo_1k")" \
        ROUGHNESS="$(either "0.3 0.6 1" "0.2 0.3 0.4 0.5 0.6 0.8 1")" \
        tests/bench/glossy_against_split_sum.sh "$out/glossy" "$data"
    step glossy_check glossy_check
    step glossy_bounces glossy_bounces
    step wavelets wavelets
    step pictures pictures
    step glossy_cost env SCENES="$(either "stanford_bunny suzanne" "stanford_bunny shader_ball dungeon_hall suzanne")" \
        tests/bench/glossy_cost.sh "$data"
    step bare "$bin/transport_against_time" bare $(either "stanford_bunny suzanne" "")
    step scaling "$bin/transport_against_time" scaling $(either 50000 1000000)
    step runtime for_both runtime_bench /2000000
    step glossy_runtime for_both glossy_runtime_bench
    step memory_map memory_map
    step memory_vertices memory_vertices
    step start_up start_up
    step rebuilds rebuilds
}
for name in "${only[@]}"; do
    [[ " ${names[*]} " == *" $name "* ]] || { echo "no step $name; there are: ${names[*]}" >&2; exit 2; }
done

draw() {  # of single steps there is not everything that is drawn and written
    "${@:2}" || ((${#only[@]})) || failed+=("$1")
}
draw "plots of lighting" tests/bench/plot.py "$out/lighting.csv" docs/images
draw "plot of transport" tests/bench/plot.py "$out/transport.csv" docs/images
draw "plot of glossy transport" tests/bench/plot_glossy.py "$out/glossy_pictures.csv" \
    docs/images/glossy_against_split_sum.svg
draw "plots of wavelets, scaling, memory and runtime" tests/bench/plot_curves.py "$out" docs/images
draw tables tests/bench/write_tables.py "$out" docs/accuracy.md docs/performance.md

((${#failed[@]} == 0)) || { printf 'failed: %s\n' "${failed[*]}" >&2; exit 1; }
