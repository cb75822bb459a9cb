#!/usr/bin/env bash
# FedAvg of many updates, ours and that of Flower (PyPI: flwr), on the same numbers. Ends with one JSON line per figure.
#
#   scripts/bench-fedavg/run.sh [UPDATES [PROFILE]]      default: 16 full
#
# Both begin with files in the page cache and end with the new weights. Needs 600 MB of disk for each update of full size, where temporary files go,
# and 20 GiB of free memory for Flower's 16 updates. Run it on a machine that does nothing else. Three runs of each, in turn; three minutes.
set -euo pipefail
here=$(dirname "$(readlink -f "$0")")
root=$here/../..
cache=$HOME/.cache/zk0/flower
updates=${1:-16} profile=${2:-full}
export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$HOME/.cache/zk0/target} FLWR_TELEMETRY_ENABLED=0

"$root/scripts/python-env" "$cache" "$root/scripts/compare-flower/requirements.txt"
(cd "$root" && scripts/with-rust cargo build --release --workspace --locked --example bench_fedavg)
bench=$CARGO_TARGET_DIR/release/examples/bench_fedavg

folder=$(mktemp -d) copies=$(mktemp -d) results=$(mktemp)
trap 'rm -rf "$folder" "$copies" "$results"' EXIT
"$bench" make "$profile" "$updates" "$folder" >&2
"$cache/bin/python" "$here/flower_side.py" make "$folder" "$copies"
for _ in 1 2 3; do
    "$bench" average "$profile" "$folder" | tee -a "$results" >&2
    "$bench" bandwidth "$profile" "$folder" | tee -a "$results" >&2
    "$cache/bin/python" "$here/flower_side.py" average "$copies" 2>/dev/null | tee -a "$results" >&2
done
python3 "$here/ratios.py" "$results"
