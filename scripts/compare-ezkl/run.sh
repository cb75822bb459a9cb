#!/usr/bin/env bash
# EZKL's side of the comparison, resumable: outputs/compare-ezkl.jsonl keeps what is finished. Options go to
# ezkl_side.py, for example --memory-limit 20 or --models micro.
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

exec python3 "$here/ezkl_side.py" --python "$cache/venv/bin/python" --cache "$cache" \
    --output "$here/../../outputs/compare-ezkl.jsonl" "$@"
