#!/usr/bin/env bash
# Measures the prototype: proves every case natively, runs its verifier in SP1's executor, prints JSON lines.
#
#   research/succinct/measure.sh [LARGEST]    LARGEST: binary logarithm of the largest commitment, 20 to 25 (default 24)
#
# Needs the guest toolchain that circuits/build-guest.sh names, and 6 GB of memory. Proves nothing with SP1.
# Environment: CARGO_TARGET_DIR, where the prototype is built (default: target beside this script); ZK0_TARGET_DIR, where
# the main workspace is (default: its own target); ZK0_MEASURE_DIR, where proofs are left (default: a temporary folder).
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd -P)
work=${ZK0_MEASURE_DIR:-$(mktemp -d)}
elf=$("$here/build-guest.sh")
(cd "$here" && cargo run --release --locked --bin prove -- cases "$work" "${1:-24}") >&2
(cd "$here/../.." && env ${ZK0_TARGET_DIR:+CARGO_TARGET_DIR="$ZK0_TARGET_DIR"} \
    cargo build --release --workspace --example execute_elf) >&2
"${ZK0_TARGET_DIR:-${CARGO_TARGET_DIR:-$here/../../target}}/release/examples/execute_elf" "$elf" "$work"/*/ >&2
(cd "$here" && cargo run --release --locked --bin prove -- report "$work")
