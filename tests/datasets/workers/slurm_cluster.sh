#!/usr/bin/env bash
# A real SLURM of one node on this machine runs docs/slurm_array.sh and a merge; the dataset must equal a local run's.
#
#     sudo apt-get install slurm-wlm munge
#     sudo ./slurm_cluster.sh [PYTHON [generate's arguments...]]
#
# Root, because SLURM's daemons want it. All ports are on loopback, all state in a temporary folder; everything
# started here is ended here. Exit code 0: the data equal.
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
python=${1:-$root/.venv/bin/python}
for tool in slurmctld slurmd sbatch munged; do
    command -v "$tool" >/dev/null || PATH=$PATH:/usr/sbin
    command -v "$tool" >/dev/null || { echo "error: $tool must be installed: apt-get install slurm-wlm munge"; exit 1; }
done
[ "$(id -u)" = 0 ] || { echo "error: this must run as root; it starts SLURM's daemons"; exit 1; }

scratch=$(mktemp -d)
pids=()
finish() {
    for pid in "${pids[@]}"; do kill "$pid" 2>/dev/null || true; done
    for pid in "${pids[@]}"; do wait "$pid" 2>/dev/null || true; done
    rm -rf "$scratch"
}
trap finish EXIT
chmod 755 "$scratch"

export SLURM_CONF=$scratch/slurm.conf
host=$(hostname -s)
cores=$(nproc)
cat >"$SLURM_CONF" <<CONF
ClusterName=one
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=16817
SlurmdPort=16818
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket=$scratch/munge.socket
CryptoType=crypto/munge
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerType=sched/backfill
ReturnToService=2
MpiDefault=none
StateSaveLocation=$scratch/state
SlurmdSpoolDir=$scratch/spool
SlurmctldPidFile=$scratch/slurmctld.pid
SlurmdPidFile=$scratch/slurmd.pid
SlurmctldLogFile=$scratch/slurmctld.log
SlurmdLogFile=$scratch/slurmd.log
NodeName=$host NodeAddr=127.0.0.1 CPUs=$cores State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
echo "CgroupPlugin=cgroup/v1" >"$scratch/cgroup.conf"  # never used (linuxproc, task/none), but slurmd wants one
mkdir -p "$scratch/state" "$scratch/spool"

dd if=/dev/urandom of="$scratch/munge.key" bs=1 count=1024 status=none
chmod 400 "$scratch/munge.key"
munged --force --foreground --key-file="$scratch/munge.key" --socket="$scratch/munge.socket" --pid-file="$scratch/munged.pid" \
    --seed-file="$scratch/munge.seed" --log-file="$scratch/munged.log" --num-threads=2 &
pids+=($!)
slurmctld -D -c &
pids+=($!)
slurmd -D -N "$host" &
pids+=($!)
for _ in $(seq 60); do
    [ "$(sinfo --noheader -o %T 2>/dev/null)" = idle ] && break
    sleep 1
done
[ "$(sinfo --noheader -o %T)" = idle ] || { echo "error: the node must become idle"; tail -n 20 "$scratch"/*.log; exit 1; }

PATH=$(dirname "$python"):$PATH
export PATH
arguments=("${@:2}")
((${#arguments[@]})) || arguments=(--method exact --views ring:400@30 --points 1000 --sample-size 64 --limit 80)
array=$(sbatch --parsable --array=3-6 --chdir="$scratch" --time=10 --mem=0 --cpus-per-task=1 \
    "$root/docs/slurm_array.sh" "$scratch/made" "${arguments[@]}")
merge=$(sbatch --parsable --dependency=afterok:"$array" --chdir="$scratch" --time=10 --mem=0 --cpus-per-task=1 \
    --wrap "zbuf-occlude merge $scratch/made")
for _ in $(seq 300); do
    [ -z "$(squeue --noheader --jobs="$array,$merge" 2>/dev/null)" ] && break
    sleep 1
done
cat "$scratch"/slurm-*.out
[ -f "$scratch/made/manifest.json" ] || { echo "error: the merge must write a manifest"; tail -n 20 "$scratch"/*.log; exit 1; }

zbuf-occlude generate --out "$scratch/here" "${arguments[@]}" >/dev/null 2>&1
for file in "$scratch"/here/*.h5; do
    cmp "$file" "$scratch/made/$(basename "$file")"
done
echo "A SLURM array of 4 tasks and a merge: $(ls "$scratch"/here/*.h5 | wc -l) files, equal to a local run's"
