#!/usr/bin/env bash
# Runs the partitions of a command as a Slurm array job, one per task. On the login node, with a folder on the
# shared file system:
#
#   job=$(sbatch --parsable --array=1-64 slurm_array.sh /shared/parts run /shared/scenarios --models idm)
#   sbatch --dependency="afterok:$job" --wrap "reactsim merge /shared/parts/* --out /shared/runs/idm"
#
# Submit the job again to run lost partitions; finished ones take no time.

#SBATCH --job-name=reactsim
#SBATCH --array=1-64
#SBATCH --cpus-per-task=4
#SBATCH --time=04:00:00

set -euo pipefail
folder=${1:?usage: sbatch slurm_array.sh FOLDER COMMAND ARGUMENTS, without --out}
shift
out=$folder/$SLURM_ARRAY_TASK_ID-of-$SLURM_ARRAY_TASK_COUNT
[[ -e $out/partition.json ]] && exit 0
rm -rf "$out"
mkdir -p "$folder"

# Exit code 1: the partition is finished, and scenarios failed in it. The results list them.
reactsim "$@" --jobs "${SLURM_CPUS_PER_TASK:-1}" --out "$out" \
    --partition "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT" || [[ $? -eq 1 ]]
