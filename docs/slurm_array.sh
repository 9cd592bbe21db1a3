#!/bin/bash
# A SLURM array that makes one dataset: each task makes its share of the shards, wherever it runs.
#
#     array=$(sbatch --parsable --array=0-15 slurm_array.sh OUT [generate's arguments...])
#     sbatch --dependency=afterok:$array --wrap "zbuf-occlude merge OUT"
#
# The tasks write the final files; `merge` writes the lists and the manifest. A shard is a set of whole meshes
# with the files of their clouds; a task without a shard has nothing to do.
#
# OUT must be on a file system that all nodes share. The array must be without gaps (0-15, not 0-15:2); it may be of any
# size, and larger than the number of nodes. Submit the same line again to resume after a failure: what is done
# stays done. `zbuf-occlude status OUT` says how far it is.
#
# What is compiled in the first run is kept beside the package or in ~/.cache/zbuf_occlude. Where nodes can write neither, or to keep
# it out of a shared home, export NUMBA_CACHE_DIR, a folder that nobody but you can write: what lies there is run.
#
#SBATCH --job-name=zbuf-occlude
#SBATCH --cpus-per-task=2
#SBATCH --mem=6G
#SBATCH --time=04:00:00
#SBATCH --requeue
set -euo pipefail
out=$1
shift
# the task finds its number in SLURM_ARRAY_TASK_ID; on nodes with GPUs add --gres=gpu:1 above and --require-gpu below
exec zbuf-occlude generate "$@" --out "$out" --workers "${SLURM_CPUS_PER_TASK:-2}"
