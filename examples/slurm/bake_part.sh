#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# One task of the array job that submit.sh makes.
#   bake_part.sh FOLDER BAKE_ARGUMENTS...
folder=$1
shift
part=$SLURM_ARRAY_TASK_ID of=$SLURM_ARRAY_TASK_COUNT

"${ENVBAKE:-envbake}" bake "$@" --shard "$part/$of" --threads "${SLURM_CPUS_ON_NODE:-0}" --quiet \
    -o "$folder/$part-of-$of.envb"
status=$?

# A signal (out of memory, a kill by hand) says nothing about the input: try again, three times.
if ((status > 128 && ${SLURM_RESTART_COUNT:-0} < 3)); then
    echo "part $part of $of: ended by signal $((status - 128)); queued again"
    scontrol requeue "${SLURM_ARRAY_JOB_ID}_$part"
fi
exit "$status"
