#!/usr/bin/env bash
# Proves the same transformer with EZKL and with zk0, as it grows up to SmolVLA's action expert, and prints the table. EZKL stops at the first
# model that no longer fits. Resumable: outputs/compare-ezkl.jsonl keeps what is finished. Hours; run it on a machine that does nothing else.
#
#   run.sh [--models MODEL…] [--most-cycles N] [--execute-only] [options of ezkl_side.py, for example --memory-limit 20]
#
# --most-cycles and --execute-only go to zk0's side: claims of more guest cycles are executed and not proven, or all of them.
set -euo pipefail

models=() zk0=() ezkl=()
while [ $# -gt 0 ]; do
    option=$1
    shift
    case $option in
    --models) while [ $# -gt 0 ] && [[ $1 != -* ]]; do models+=("$1") && shift; done ;;
    --most-cycles) zk0+=("$option" "${1:?--most-cycles needs a number}") && shift ;;
    --execute-only) zk0+=("$option") ;;
    *) ezkl+=("$option") ;;
    esac
done

here=$(dirname "$(readlink -f "$0")")
cache=$HOME/.cache/zk0/ezkl
results=$here/../../outputs/compare-ezkl.jsonl

"$here/../python-env" "$cache/venv" "$here/requirements.txt"
python3 "$here/ezkl_side.py" --python "$cache/venv/bin/python" --cache "$cache" --output "$results" --models "${models[@]}" "${ezkl[@]}"

cd "$here/../.."
export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$HOME/.cache/zk0/target}
scripts/setup.sh
scripts/with-rust cargo build --release --workspace --locked --example prove_sizes
"$CARGO_TARGET_DIR/release/examples/prove_sizes" "$here/sizes.json" "$results" "${zk0[@]}" "${models[@]}"
python3 "$here/table.py" "$results"
