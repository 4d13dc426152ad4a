#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# What each encoding of diffuse transport takes and costs: bytes a vertex (with ranges, and basis of
# the clusters), and the error that it adds, as bundles of build/release state it. CSV.
#   tests/bench/encodings.sh [DATA] [BAKE OPTIONS]    DATA: the folder of real test input
# ENVBAKE names another program than build/release has, MESHES other meshes than those below.
set -euo pipefail
cd "$(dirname "$0")/../.."
data=$(realpath "${1:-../shared/data}")
envbake=${ENVBAKE:-build/release/bin/envbake}
bundle=$(mktemp --suffix=.envb)
trap 'rm -f "$bundle"' EXIT

echo "mesh,encoding,bytes_a_vertex,encoding_rms,encoding_worst,whole_rms"
for mesh in ${MESHES-stanford_bunny suzanne shader_ball dungeon_hall}; do
    for encoding in f32 f16 unorm16 unorm8 cpca auto; do
        "$envbake" bake "$data/meshes/$mesh.glb" --encoding "$encoding" --force --quiet -o "$bundle" "${@:2}"
        "$envbake" dump "$bundle" --json | python3 -c '
import json, math, sys
d = json.load(sys.stdin)
meshes = [m for m in d["metadata"]["meshes"] if "diffuse" in m]
vertices = sum(m["vertex_count"] for m in meshes)
def rms(of):
    return math.sqrt(sum(m["vertex_count"] * of(m) ** 2 for m in meshes) / vertices)
encoded = [m["diffuse"]["encoding"] for m in meshes if "encoding" in m["diffuse"]]
size = sum(a["bytes"] for a in d["arrays"] if a["name"].startswith("mesh/") and "/diffuse" in a["name"])
print(sys.argv[1], sys.argv[2], f"{size / vertices:.1f}",
      "%.2g" % rms(lambda m: m["diffuse"].get("encoding", {}).get("error_rms", 0)),
      "%.2g" % max([e["error_worst"] for e in encoded], default=0),
      "%.2g" % rms(lambda m: m["diffuse"]["error_rms"]), sep=",")' "$mesh" "$encoding"
    done
done
