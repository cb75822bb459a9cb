#!/usr/bin/env bash
# Training steps of SmolVLA, LeRobot's on PyTorch and ours, side by side on this machine; then where a step of ours goes, kernel by
# kernel against what the machine could do at best. Ends with one JSON line per figure.
# Run it on a machine that does nothing else: twenty minutes, 8 GB of memory at batch 8, 10 GB of disk for PyTorch.
#
#   scripts/bench-train/run.sh [--gpu] [PROFILE:BATCH …]      default: tiny:1 tiny:8 full:1 full:8
#
# With --gpu both run on the first NVIDIA GPU, the frozen half in bf16 (PyTorch: all of it under autocast), without the kernels one by
# one. That has not been run yet.
set -euo pipefail
here=$(dirname "$(readlink -f "$0")")
root=$here/../..
cache=$HOME/.cache/zk0/lerobot
device=cpu target=$HOME/.cache/zk0/target
if [ "${1:-}" = --gpu ]; then
    device=cuda cache+=-cuda target+=-cuda
    shift
fi
export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$target}
[ $# -gt 0 ] || set -- tiny:1 tiny:8 full:1 full:8

"$root/scripts/python-env" "$cache" "$here/requirements.txt" $device
if [ $device = cuda ]; then
    (cd "$root" && scripts/setup.sh cuda &&
        scripts/with-rust scripts/with-cuda cargo build --release -p zk0-smolvla --locked --features cuda --example train_step)
else
    (cd "$root" && scripts/setup.sh && scripts/with-rust cargo build --release --workspace --locked --example train_step --example step_floors --example made_ahead)
fi

results=$(mktemp)
trap 'rm -f "$results"' EXIT
for case in "$@"; do
    profile=${case%:*} batch=${case#*:}
    [ "$profile" = full ] && steps=5 || steps=100
    # In turn, and the medians compared: machines get slower and faster by themselves.
    for what in lerobot whole lerobot whole lerobot whole cached cached-state; do
        echo "$profile, batch $batch: $what" >&2
        if [ "$what" = lerobot ]; then
            "$cache/bin/python" "$here/lerobot_side.py" "$root/tests/fixtures/smolvla_tiny" "$profile" "$batch" "$steps" "$device"
        else
            "$CARGO_TARGET_DIR/release/examples/train_step" "$profile" "$batch" "$what" "$steps" "$device"
        fi | tee -a "$results" >&2
    done
done
[ $device = cuda ] || "$CARGO_TARGET_DIR/release/examples/step_floors" full 1
python3 "$here/ratios.py" "$results"
# Steps whose samples have to be made: one after another, and in the background.
[ $device = cuda ] || "$CARGO_TARGET_DIR/release/examples/made_ahead" "$root/tests/fixtures/datasets/so100_pickplace" tiny 8 60
