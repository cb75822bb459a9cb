#!/usr/bin/env bash
# Reading the pictures of recordings, LeRobot's reader (torchcodec) and ours, side by side on this machine. Ends with one JSON line per figure;
# ratios above 1 are in our favour.
#
#   scripts/bench-decode/run.sh [RUNS]      default: 3 runs of each, in turn
#
# LeRobot records 640x480 pictures as H.264, AV1 and HEVC, which takes minutes and is kept in ~/.cache/zk0. Both sides run on one core, and their
# frames are counted per second of the processor, child processes included, so that other load matters little. ZK0_BENCH_VENV names a virtual
# environment with LeRobot 0.6.1, ZK0_BENCH_RECORDINGS the folder of its recordings, and ZK0_BENCH_PROGRAM the built example.
set -euo pipefail
here=$(dirname "$(readlink -f "$0")")
root=$here/../..
venv=${ZK0_BENCH_VENV:-$HOME/.cache/zk0/lerobot-0.6.1}
recordings=${ZK0_BENCH_RECORDINGS:-$HOME/.cache/zk0/bench-decode}
export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$HOME/.cache/zk0/target} HF_HUB_OFFLINE=1 OMP_NUM_THREADS=1
bench=${ZK0_BENCH_PROGRAM:-$CARGO_TARGET_DIR/release/examples/bench_decode}
runs=${1:-3}

[ -n "${ZK0_BENCH_VENV:-}" ] || "$root/scripts/python-env" "$venv" "$here/requirements.txt"
[ -n "${ZK0_BENCH_PROGRAM:-}" ] || (cd "$root" && scripts/setup.sh && scripts/setup.sh video &&
    scripts/with-rust cargo build --release --workspace --locked --example bench_decode)
if [ ! -f "$recordings/shuffled" ]; then
    mkdir -p "$(dirname "$recordings")"
    made=$(mktemp -d "$recordings.XXXXXX")
    "$venv/bin/python" "$here/make_recordings.py" "$made"
    mv -T "$made" "$recordings"
fi

results=$(mktemp)
trap 'rm -f "$results"' EXIT
# measured.py looks on, and notes the memory of all processes of a side.
on_one_core="taskset -c 0"
measured() {
    python3 "$here/../bench-simulate/measured.py" "$@" >>"$results" 2>&1 || { cat "$results" >&2 && exit 1; }
}
# torchcodec gives another picture than the one asked for when HEVC is read out of order, and LeRobot refuses it.
both=(files:open {h264,av1}:{in-order,shuffled} hevc:in-order)
for ((run = 0; run < runs; run++)); do
    measured lerobot $on_one_core "$venv/bin/python" "$here/lerobot_side.py" "$recordings" "${both[@]}"
    for case in "${both[@]}" {h264,av1,hevc}:validate; do
        measured "$case" $on_one_core "$bench" "$recordings" "$case"
    done
done
python3 "$here/ratios.py" "$results"
