#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Bakes on a Slurm cluster: an array job of parts, and a merge that waits for all of them.
#   submit.sh PARTS OUT.envb [SCENE] BAKE_OPTIONS...     prints the number of the merge's job
#
# Inputs, output and envbake (in PATH, or named by ENVBAKE) are on a file system that every node
# sees. Options of the cluster, as partition or account, go into SBATCH_... variables (man sbatch).
# A part that a node or a signal killed is queued again. To go on after what cannot be helped so,
# call this again: parts that are there and up to date are not baked again.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
parts=${1:?how many parts} output=${2:?the bundle to write}
shift 2
scene=()
[[ ${1:--} == -* ]] || scene=(--scene "$1")

folder=$output.parts
mkdir -p "$folder"
export ENVBAKE=${ENVBAKE:-envbake}
bake=$(sbatch --parsable --array="1-$parts" --requeue --open-mode=append \
    --job-name="bake ${output##*/}" --output="$folder/%a.log" \
    "$here/bake_part.sh" "$folder" "$@")
sbatch --parsable --dependency="afterok:$bake" --kill-on-invalid-dep=yes \
    --job-name="merge ${output##*/}" --output="$folder/merge.log" \
    "$here/merge_parts.sh" "$folder" "$output" "${scene[@]}"
