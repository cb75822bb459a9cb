#!/usr/bin/env bash
# Proves the same small transformer with EZKL and with zk0, as it grows, until one side no longer fits, and prints the
# table. Resumable: outputs/compare-ezkl.jsonl keeps what is finished. Options go to ezkl_side.py, for example
# --memory-limit 20 or --models micro micro-x2. Hours; run it on a machine that does nothing else.
set -euo pipefail

here=$(dirname "$(readlink -f "$0")")
cache=$HOME/.cache/zk0/ezkl

"$here/../python-env" "$cache/venv" "$here/requirements.txt"
results=$here/../../outputs/compare-ezkl.jsonl
python3 "$here/ezkl_side.py" --python "$cache/venv/bin/python" --cache "$cache" --output "$results" "$@"

# zk0 proves the models that EZKL was tried on.
mapfile -t models < <(python3 -c '
import json, sys
print(*(line["model"] for line in map(json.loads, open(sys.argv[1])) if line["side"] == "ezkl"), sep="\n")' "$results")
cd "$here/../.."
export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$HOME/.cache/zk0/target}
scripts/setup.sh
scripts/with-rust cargo build --release --workspace --locked --example prove_sizes
# SP1's own shards: each of these claims fits into one or two that do not fill up. docs/prove.md, "How long does it take?".
export ELEMENT_THRESHOLD=${ELEMENT_THRESHOLD:-402653184} HEIGHT_THRESHOLD=${HEIGHT_THRESHOLD:-4194304}
"$CARGO_TARGET_DIR/release/examples/prove_sizes" "$here/sizes.json" "$results" "${models[@]}"
python3 "$here/table.py" "$results"
