#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Which bakes give the same bytes. Builds envbake four times: twice with GCC in different folders, with
# clang, and with GCC for a processor of ten years ago; bakes one scene with each, on 1, 2 and 7
# threads, whole and in parts, with every instruction set that Embree can be held to.
#   tests/determinism.sh [SCENE ENVIRONMENT [BAKE_OPTIONS...]]     default: what envbake-sample writes
# One compiler must give the same bytes: if not, the exit status is 1. Of the others it says what
# differs, by `envbake diff`. Takes a quarter of an hour on two cores; with BUILDS=FOLDER the builds are
# kept there for the next time.
set -euo pipefail
source=$(cd "$(dirname "$0")/.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
builds=${BUILDS:-$work}
mkdir -p "$builds"

build() {  # FOLDER CMAKE_ARGUMENTS...: from sources that lie there
    echo "build in $1: ${*:2}"
    [[ -e $builds/$1/out ]] && return
    mkdir -p "$builds/$1"
    (cd "$source" && git ls-files -z | xargs -0 cp --parents -t "$builds/$1")
    { cmake -S "$builds/$1" -B "$builds/$1/out" -G Ninja -DCMAKE_BUILD_TYPE=Release \
        -DENVBAKE_BUILD_TESTS=OFF "${@:2}" && CCACHE_DISABLE=1 cmake --build "$builds/$1/out"; } \
        >"$work/log" 2>&1 || { tail -n 20 "$work/log" >&2; exit 1; }
}
build one -DCMAKE_CXX_COMPILER=g++
build another/folder -DCMAKE_CXX_COMPILER=g++
build clang -DCMAKE_CXX_COMPILER=clang++-14
build older -DCMAKE_CXX_COMPILER=g++ -DENVBAKE_ARCH=x86-64-v3

if (($# >= 2)); then
    scene=$1 sky=$2
    shift 2
else
    "$builds/one/out/bin/envbake-sample" "$work" >/dev/null
    scene=$work/scene.glb sky=$work/sky.hdr
fi
options=(--glossy all --bounces all --encoding auto --wavelet 16 "$@")
bake() {  # FOLDER OUT MORE...
    "$builds/$1/out/bin/envbake" bake "$scene" --env "$sky" "${options[@]}" -o "$work/$2" --quiet "${@:3}"
}
failed=0
same() {  # OUT WHAT
    if cmp -s "$work/first.envb" "$work/$1"; then
        echo "same bytes: $2"
    else
        echo "OTHER BYTES: $2"
        failed=1
    fi
}

bake one first.envb --threads 1
for threads in 2 7; do
    bake one "$threads.envb" --threads "$threads"
    same "$threads.envb" "$threads threads as 1"
done
bake another/folder folder.envb
same folder.envb "built in another folder"
for part in 1 2 3; do bake one "part$part.envb" --shard "$part/3" --threads "$part"; done
"$builds/one/out/bin/envbake" merge "$work"/part?.envb --scene "$scene" -o "$work/merged.envb" --quiet
same merged.envb "3 parts, merged"

# Without an encoding: what clusters make of a last bit says nothing of the bits.
options=("${options[@]/auto/f32}")
bake one first.envb
compare() {  # OUT WHAT: of each kind of array that differs how many do, and the largest relative rms
    echo "--- $2"
    { "$builds/one/out/bin/envbake" diff "$work/first.envb" "$work/$1" || true; } | awk '
        / relative rms / {
            name = $1
            sub(/:$/, "", name)
            gsub(/\/[0-9]+/, "/*", name)
            count[name]++
            if ($NF > most[name]) most[name] = $NF
        }
        END { for (name in count) printf "%-28s %3d  %s\n", name, count[name], most[name] }' | sort
}
bake clang clang.envb
compare clang.envb "clang"
bake older older.envb
compare older.envb "GCC, -march=x86-64-v3"
for isa in sse4.2 avx avx2 avx512; do
    bake one "$isa.envb" --isa "$isa" || continue
    compare "$isa.envb" "--isa $isa"
done
exit $failed
