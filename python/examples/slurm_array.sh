#!/usr/bin/env bash
# Runs the units of a plan as a Slurm array job. On the login node, with a folder on the shared file system:
#
#   reactsim shard plan /shared/units run /shared/scenarios --models idm --out /shared/runs/idm
#   job=$(sbatch --parsable --array=0-63 slurm_array.sh /shared/units)
#   sbatch --dependency="afterany:$job" --wrap "reactsim shard merge /shared/units"
#
# The array may have fewer tasks than the plan has units: task k runs units k, k + tasks, k + 2 tasks, ...
# Submit the job again to run missing units; finished units take no time.

#SBATCH --job-name=reactsim
#SBATCH --array=0-63
#SBATCH --cpus-per-task=4
#SBATCH --time=04:00:00

set -euo pipefail
folder=${1:?usage: sbatch slurm_array.sh FOLDER}
tasks=${SLURM_ARRAY_TASK_COUNT:-1} least=${SLURM_ARRAY_TASK_MIN:-0}
if ((${SLURM_ARRAY_TASK_MAX:-$least} - least + 1 != tasks)); then
    echo "error: units are divided among consecutive tasks: give --array=0-$((tasks - 1))" >&2
    exit 2
fi

units=$(reactsim shard status "$folder" | sed -E 's/.*"units":([0-9]+).*/\1/')
mapfile -t numbers < <(seq "$((SLURM_ARRAY_TASK_ID - least))" "$tasks" "$((units - 1))")
[[ ${#numbers[@]} -gt 0 ]] || exit 0 # more tasks than units

# Exit code 1: all units are finished, and scenarios failed in them. The results list them.
reactsim shard run "$folder" "${numbers[@]}" --jobs "${SLURM_CPUS_PER_TASK:-1}" || [[ $? -eq 1 ]]
