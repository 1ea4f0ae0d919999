#!/usr/bin/env bash
# Divides a run into units, runs them in several processes on this machine, and merges the results:
#
#   xargs_units.sh FOLDER PROCESSES run SCENARIOS --models idm --out RUN
#
# The same command continues after an interruption; finished units take no time. If FOLDER has a plan, that
# plan is run, and the arguments of the run are ignored.

set -euo pipefail
folder=${1:?usage: xargs_units.sh FOLDER PROCESSES run ARGUMENTS --out RUN}
processes=$2
shift 2

[[ -e $folder/plan.json ]] || reactsim shard plan "$folder" --unit "${UNIT:-512}" "$@"
units=$(reactsim shard status "$folder" | sed -E 's/.*"units":([0-9]+).*/\1/')

# Exit code 1: the unit is finished, and scenarios failed in it. The results list them.
seq 0 "$((units - 1))" |
    xargs -P "$processes" -n 1 sh -c 'reactsim shard run "$0" "$1" --jobs 1 || [ $? -eq 1 ]' "$folder"
reactsim shard merge "$folder"
