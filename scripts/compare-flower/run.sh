#!/usr/bin/env bash
# Makes tests/fixtures/flower anew: small updates, and what the strategies of Flower (PyPI: flwr) make of them. The test `flower` of the
# verifier compares ours with that. Needs 300 MB of disk for Flower.
set -euo pipefail
here=$(dirname "$(readlink -f "$0")")
root=$here/../..
cache=$HOME/.cache/zk0/flower
export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$HOME/.cache/zk0/target} FLWR_TELEMETRY_ENABLED=0

"$root/scripts/python-env" "$cache" "$here/requirements.txt"
cd "$root"
ZK0_WRITE_FLOWER=1 scripts/with-rust cargo test --release --workspace --locked --test verifier the_files_that_flower_read_are_these
"$cache/bin/python" "$here/strategies.py" tests/fixtures/flower
