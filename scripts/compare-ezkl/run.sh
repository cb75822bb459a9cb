#!/usr/bin/env bash
# Proves the same small transformer with EZKL and with zk0, as it grows, until one side no longer fits, and prints the
# table. Resumable: outputs/compare-ezkl.jsonl keeps what is finished. Options go to ezkl_side.py, for example
# --memory-limit 20 or --models micro micro-x2. Hours; run it on a machine that does nothing else.
set -euo pipefail

here=$(dirname "$(readlink -f "$0")")
cache=$HOME/.cache/zk0/ezkl

if ! cmp -s "$here/requirements.txt" "$cache/venv/requirements.txt"; then
    python3 -m venv "$cache/venv"
    pip=("$cache/venv/bin/pip" --disable-pip-version-check --quiet)
    # PyTorch's own index has a build without CUDA; PyPI has not, and brings gigabytes of it along.
    torch=$(grep '^torch==' "$here/requirements.txt")
    "${pip[@]}" --retries 0 install --index-url https://download.pytorch.org/whl/cpu "$torch" 2>/dev/null || true
    "${pip[@]}" install -r "$here/requirements.txt"
    cp "$here/requirements.txt" "$cache/venv/"
fi

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
# SP1's own shards: each of these claims fits into one or two that do not fill up. README, "What proving costs".
export ELEMENT_THRESHOLD=${ELEMENT_THRESHOLD:-402653184} HEIGHT_THRESHOLD=${HEIGHT_THRESHOLD:-4194304}
"$CARGO_TARGET_DIR/release/examples/prove_sizes" "$here/sizes.json" "$results" "${models[@]}"
python3 "$here/table.py" "$results"
