#!/bin/bash
# A dataset in partitions on a cluster: one partition for each task of a Slurm array, all in one shared folder, joined by a
# last job. Change the line of `imf dataset`, the folder, and the number of partitions, here and in --array.
#
#   jobs=$(sbatch --parsable --array=1-8 docs/slurm/dataset.sh)
#   sbatch --dependency=afterok:"$jobs" --wrap 'imf dataset merge teapot-900'
#
# A task that was cut off is submitted again, alone too (--array=3): finished shards are kept. What never came is named by the merge,
# and `imf dataset finish teapot-900` makes it.
#SBATCH --job-name=imf-dataset
#SBATCH --cpus-per-task=8
#SBATCH --mem=4G
#SBATCH --time=01:00:00
set -euo pipefail
partitions=8

imf dataset teapot --orientations grid:30 --out teapot-900 \
    --shard "${SLURM_ARRAY_TASK_ID:?submit with --array=1-$partitions}/$partitions" \
    --threads "${SLURM_CPUS_PER_TASK:-1}"
