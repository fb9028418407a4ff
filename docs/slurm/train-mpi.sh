#!/bin/bash
# One training on several machines: every rank has its rows of each batch. Needs `imf` built with
# `cargo build --release --features mpi` against the cluster's MPI. Change the line of `imf train`.
#
#   sbatch docs/slurm/train-mpi.sh
#
# A job that reached its time limit is submitted again as it is, with as many tasks as you like: it goes on from the
# checkpoint. Slurm's signal comes two minutes before the limit, and the checkpoint is written at the next report.
#SBATCH --job-name=imf-train
#SBATCH --ntasks=8
#SBATCH --cpus-per-task=8
#SBATCH --mem-per-cpu=1G
#SBATCH --time=04:00:00
#SBATCH --signal=B:TERM@120
set -euo pipefail

resume=()
if [ -e teapot-model/checkpoint.safetensors ]; then resume=(--resume); fi

# Open MPI kills ranks one second after it told them to stop: give them a minute to save.
export OMPI_MCA_odls_base_sigkill_timeout=60
mpirun --map-by "slot:PE=${SLURM_CPUS_PER_TASK:-1}" --bind-to core \
    imf train siren5 teapot-900 --out teapot-model --batch 8192 --rate 5e-4 --mpi \
    --threads "${SLURM_CPUS_PER_TASK:-1}" "${resume[@]}" &
mpirun=$!
trap 'kill -TERM "$mpirun"' TERM
wait "$mpirun" || wait "$mpirun"
