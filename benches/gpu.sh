#!/usr/bin/env bash
# Measures networks on a graphics processor, next to all cores of the same machine: speed of rollouts for several sizes of
# batches, steps of a training per second, and agreement of the rollouts. Prints Markdown.
#
#     benches/gpu.sh [cuda|wgpu] > gpu.md
#
# Builds the program with the backend, unless PROGRAM names one. Other variables:
#   WEIGHTS    folder with the shipped weights, for a program without the feature `weights`
#   OUT        folder for scenarios, vocabularies and trainings [default: a temporary one, which is removed]
#   PARTS      parts to run [default: "first small diffusion train large"]
#   BATCHES    sizes of batches [default: 1,4,16,64,256]
#   AGREEMENT  smallest share of positions within 1 mm of those of flex [default: 0.99]
#   LIMIT      time limit of a command, seconds [default: 600]
#
# Exit codes: 0 done; 1 the backends differ by more than AGREEMENT allows; 2 the backend or a command does not work.
set -uo pipefail

backend=${1:-cuda}
parts=${PARTS:-first small diffusion train large}
batches=${BATCHES:-1,4,16,64,256}
agreement=${AGREEMENT:-0.99}
limit=${LIMIT:-600}
status=0

say() { printf '%s\n' "$*" >&2; }
give_up() { say "error: $*"; exit 2; }

case $backend in
cuda | wgpu) ;;
*) give_up "backend \`$backend\`: expected cuda or wgpu" ;;
esac

if [ -z "${OUT:-}" ]; then
    OUT=$(mktemp -d)
    trap 'rm -rf "$OUT"' EXIT
fi
mkdir -p "$OUT" || give_up "$OUT cannot be written"

if [ -z "${PROGRAM:-}" ]; then
    cd "$(dirname "$0")/.." || give_up "no repository next to this script"
    cargo build --locked --release --features "$backend" || give_up "the program cannot be built with \`--features $backend\`"
    PROGRAM=${CARGO_TARGET_DIR:-target}/release/reactsim
fi

# Runs the program within the time limit. A difference of backends is remembered, other failures end the script.
reactsim() {
    local code=0
    timeout --foreground "$limit" "$PROGRAM" "$@" || code=$?
    case $code in
    0) ;;
    1) status=1 ;;
    124) say "warning: stopped after $limit s: reactsim $*"; status=2 ;;
    *) give_up "exit code $code: reactsim $*" ;;
    esac
}

# Prints the options that give a network its weights, if the program does not contain them.
weights() {
    if [ -n "${WEIGHTS:-}" ]; then
        for id in "$@"; do printf -- '--model-weights\n%s=%s/%s.safetensors\n' "$id" "$WEIGHTS" "$id"; done
    fi
}

# Measures networks, separated by commas, with further options.
speed() {
    local models=$1 given
    shift
    mapfile -t given < <(weights ${models//,/ })
    reactsim --quiet speed --backends "flex,$backend" --models "$models" "${given[@]}" --agreement "$agreement" "$@"
    echo
}

# Steps per second of a training, from its log, without the first third, in which kernels are compiled.
steps_per_second() {
    sed -n 's/.*"row":"step","step":\([0-9]*\),.*"seconds":\([0-9.e+-]*\),.*/\1 \2/p' "$1/log.jsonl" |
        awk '{ step[NR] = $1; time[NR] = $2 }
             END { k = int(NR / 3) + 1; if (NR > k) printf "%.2f", (step[NR] - step[k]) / (time[NR] - time[k]); else printf "-" }'
}

part_first() {
    echo "- program: $("$PROGRAM" --version)"
    if command -v nvidia-smi >/dev/null; then
        echo "- graphics processor: $(nvidia-smi --query-gpu=name,memory.total,driver_version --format=csv,noheader | head -n 1)"
    fi
    echo "- processor: $(sed -n 's/^model name[^:]*: //p' /proc/cpuinfo 2>/dev/null | head -n 1), $(nproc) threads"
    local state
    state=$("$PROGRAM" list backends | awk -v name="$backend" '$1 == name { $1 = ""; print }')
    [ -n "$state" ] || give_up "the program does not contain the backend \`$backend\`: build it with \`--features $backend\`"
    case $state in
    *works) ;;
    *) give_up "${state# }" ;;
    esac
    echo
    # The smallest run, so that whatever does not work shows at once.
    speed smart-small --batches 1 --rounds 1
}

part_small() {
    echo "## Networks of 1 million weights"
    echo
    speed ntp-reactive,smart-small --batches "$batches"
    echo "With the likeliest token of every agent (greedy):"
    echo
    speed ntp-reactive,smart-small --batches 16 --rounds 1 --set ntp-reactive.sampling.top_k=1 \
        --set smart-small.sampling.top_k=1
}

part_diffusion() {
    echo "## VBD, 0.6 million weights"
    echo
    speed vbd --batches 1,16,64 --rounds 2
}

# Makes scenarios and vocabularies for a training.
training_data() {
    [ -e "$OUT/logs.parquet" ] || reactsim --quiet generate --preset train --count "${SCENARIOS:-200}" --out "$OUT/logs.parquet"
    [ -e "$OUT/tokens.safetensors" ] || reactsim --quiet train vocabulary "$OUT/logs.parquet" --method k-disks \
        --out "$OUT/tokens.safetensors" --map-out "$OUT/curves.safetensors"
}

# Trains the network of 7 million weights on a backend, for some epochs, with as many scenarios per forward pass.
train() {
    local folder=$OUT/training-$1-$3
    rm -rf "$folder"
    reactsim --quiet train smart "$OUT/logs.parquet" --recipe 7m --input "vocabulary=$OUT/tokens.safetensors" \
        --input "map-vocabulary=$OUT/curves.safetensors" --set "learning.epochs=$2" --set "learning.together=$3" \
        --set network.separate_heads=true --set learning.held_out=0 --backend "$1" --out "$folder" --cache "$OUT/cache" >&2
    local loss
    loss=$(sed -n 's/.*"row":"step","step":5,.*"loss":\([0-9.]*\),.*/\1/p' "$folder/log.jsonl" | cut -c1-6)
    echo "| $1 | $3 | $(steps_per_second "$folder") | $loss |"
}

part_train() {
    echo "## Training of SMART, 7 million weights, 10 scenarios per step"
    echo
    training_data >&2
    echo "| Backend | Scenarios per forward pass | Steps per second | Loss of step 5 |"
    echo "|---|--:|--:|--:|"
    train "$backend" "${EPOCHS:-2}" 10
    train "$backend" "${EPOCHS:-2}" 1
    train flex "${EPOCHS_FLEX:-0.3}" 1
    echo
}

part_large() {
    echo "## SMART, 7 million weights, after the training above"
    echo
    training_data >&2
    [ -e "$OUT/training-$backend-10/weights.safetensors" ] || train "$backend" 0.3 10 >&2
    WEIGHTS='' speed smart --model-weights "smart=$OUT/training-$backend-10/weights.safetensors" --batches "$batches" --rounds 2
}

for part in $parts; do
    declare -F "part_$part" >/dev/null || give_up "part \`$part\`: expected some of first small diffusion train large"
    "part_$part"
done
exit "$status"
