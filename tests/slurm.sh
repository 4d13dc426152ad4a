#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs examples/slurm against a real Slurm, one node on loopback: the bundle is that of one bake,
# also where a task was killed. Needs root, and Debian's slurm-wlm and munge; takes a minute.
#   tests/slurm.sh BUILD_FOLDER [SCENE ENVIRONMENT]    default: what envbake-sample writes
set -euo pipefail
source=$(cd "$(dirname "$0")/.." && pwd)
build=$(cd "${1:?a build folder}" && pwd)

for program in slurmctld slurmd munged sbatch; do
    if ! command -v "$program" >/dev/null; then
        echo "slurm.sh: SKIPPED: there is no $program (apt-get install slurm-wlm munge)" >&2
        exit 77
    fi
done
if ((EUID != 0)); then
    echo "slurm.sh: SKIPPED: needs root, to start munged, slurmctld and slurmd" >&2
    exit 77
fi

work=$(mktemp -d)
chmod 755 "$work"
daemons=()
stop() {
    for process in "${daemons[@]}"; do kill "$process" 2>/dev/null || true; done
    wait 2>/dev/null || true
    rm -rf "$work"
}
trap stop EXIT
fail() {
    printf 'slurm.sh: %s\n' "$*" >&2
    tail -n 20 "$work"/*.log "$work"/*.parts/*.log >&2 || true
    exit 1
}

host=$(hostname -s)
mkdir "$work/munge" "$work/state" "$work/spool"
dd if=/dev/urandom of="$work/munge/key" bs=1024 count=1 status=none
chmod 600 "$work/munge/key"
# The pause before a task that was requeued begins again is cred_expire; Slurm's own is 2 minutes.
cat >"$work/slurm.conf" <<CONF
ClusterName=test
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=16817
SlurmdPort=16818
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket=$work/munge/socket,cred_expire=10
CredType=cred/munge
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool
SlurmctldPidFile=$work/slurmctld.pid
SlurmdPidFile=$work/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SwitchType=switch/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
JobCompType=jobcomp/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
ReturnToService=2
NodeName=$host NodeAddr=127.0.0.1 CPUs=2 State=UNKNOWN
PartitionName=all Nodes=$host Default=YES MaxTime=INFINITE State=UP
CONF
export SLURM_CONF=$work/slurm.conf

munged --foreground --force --key-file="$work/munge/key" --socket="$work/munge/socket" \
    --pid-file="$work/munge/pid" --log-file="$work/munge/munged.log" \
    --seed-file="$work/munge/seed" >"$work/munged.log" 2>&1 &
daemons+=($!)
for _ in {1..50}; do [[ -S $work/munge/socket ]] && break; sleep 0.1; done
slurmctld -D >"$work/slurmctld.log" 2>&1 &
daemons+=($!)
slurmd -D >"$work/slurmd.log" 2>&1 &
daemons+=($!)
for _ in {1..100}; do
    [[ $(sinfo -h -o %t 2>/dev/null) == idle ]] && break
    sleep 0.2
done
[[ $(sinfo -h -o %t) == idle ]] || fail "the node does not come up"

export ENVBAKE=$build/bin/envbake
cd "$work"
if (($# >= 3)); then
    scene=$2 sky=$3
else
    "$build/bin/envbake-sample" "$work" >/dev/null
    scene=$work/scene.glb sky=$work/sky.hdr
fi
arguments=("$scene" --env "$sky" --rays 4096 --glossy all --bounces all --encoding auto)
"$ENVBAKE" bake "${arguments[@]}" -o whole.envb --quiet

wait_for() {  # JOB: until no job is left, then whether this one made its bundle
    for _ in {1..600}; do
        [[ -z $(squeue -h) ]] && return
        sleep 0.2
    done
    fail "jobs are left: $(squeue)"
}
submit() { "$source/examples/slurm/submit.sh" "$@"; }

echo "an array job of 5 parts, and a merge"
submit 5 plain.envb "${arguments[@]}" >/dev/null
wait_for
cmp whole.envb plain.envb || fail "the merged bundle is not that of one bake"

echo "a task whose process is killed is queued again"
submit 3 killed.envb "${arguments[@]}" >/dev/null
for _ in {1..400}; do
    victim=$(pgrep -P "$(pgrep -d, -f 'slurm_script .*killed.envb.parts' || echo 0)" -x envbake | head -n 1) || true
    [[ -n $victim ]] && break
    sleep 0.02
done
[[ -n $victim ]] || fail "no task of envbake was seen running"
kill -KILL "$victim"
wait_for
grep -qs "queued again" killed.envb.parts/*.log || fail "no task was queued again"
cmp whole.envb killed.envb || fail "after a kill the merged bundle is not that of one bake"

echo "a task that is cancelled leaves no bundle; submitted again, what is there is kept"
submit 4 cancelled.envb "${arguments[@]}" >/dev/null
scancel --state=PENDING --name="bake cancelled.envb" "$(squeue -h -r -t PENDING -o %i -n 'bake cancelled.envb' | tail -n 1)"
wait_for
[[ ! -e cancelled.envb ]] || fail "a bundle was merged of a part that was never baked"
submit 4 cancelled.envb "${arguments[@]}" >/dev/null
wait_for
cmp whole.envb cancelled.envb || fail "submitted again, the merged bundle is not that of one bake"
echo "slurm.sh: all bundles are those of one bake, $(stat -c %s whole.envb) bytes"
