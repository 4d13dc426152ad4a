#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The job that submit.sh lets wait for all parts.
#   merge_parts.sh FOLDER OUT.envb [--scene SCENE]
set -euo pipefail
folder=$1 output=$2
shift 2
parts=("$folder"/*-of-*.envb)
"${ENVBAKE:-envbake}" merge "${parts[@]}" "$@" --threads "${SLURM_CPUS_ON_NODE:-0}" --quiet \
    -o "$output"
rm "${parts[@]}"
