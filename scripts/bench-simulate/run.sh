#!/usr/bin/env bash
# Simulated federations that are all overhead, ours and those of Flower's simulation engine (PyPI: flwr[simulation]). Ends with one JSON line per
# figure.
#
#   scripts/bench-simulate/run.sh
#
# The same seeded softmax regressions of 10 and of 100 nodes, 20 rounds, and updates of 8 B, 1 MB and 40 MB that do nothing. Run it on a machine
# that does nothing else.
set -euo pipefail
here=$(dirname "$(readlink -f "$0")")
root=$here/../..
cache=$HOME/.cache/zk0/flower-simulation
export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$HOME/.cache/zk0/target} FLWR_TELEMETRY_ENABLED=0 RAY_USAGE_STATS_ENABLED=0

"$root/scripts/python-env" "$cache" "$here/requirements.txt"
(cd "$root" && scripts/with-rust cargo build --release --workspace --locked --example bench_simulate)
bench=$CARGO_TARGET_DIR/release/examples/bench_simulate

folder=$(mktemp -d) results=$(mktemp)
trap 'rm -rf "$folder" "$results"' EXIT
both() {
    name=$1 && shift
    python3 "$here/measured.py" "$name ours" "$bench" "$@" >>"$results"
    python3 "$here/measured.py" "$name flower" "$cache/bin/python" "$here/flower_side.py" "$@" >>"$results"
}
for nodes in 10 100; do
    mkdir "$folder/$nodes"
    "$bench" data "$folder/$nodes" $nodes
    both "softmax of $nodes nodes" softmax "$folder/$nodes" $nodes 20
    "$cache/bin/python" "$here/equal.py" "$folder/$nodes"
done
for bytes in 8 1000000 40000000; do
    both "no-op of $bytes B" noop $bytes 10 5
done
python3 "$here/ratios.py" "$results"
