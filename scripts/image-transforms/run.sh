#!/usr/bin/env bash
# Makes tests/fixtures/image_transforms anew: a picture, and what torchvision's transforms make of it. The test `image_transforms` compares
# ours with that. Needs 8 GB of disk for PyTorch where its own index cannot be reached.
set -euo pipefail
here=$(dirname "$(readlink -f "$0")")
cache=$HOME/.cache/zk0/image-transforms

"$here/../python-env" "$cache" "$here/requirements.txt"
"$cache/bin/python" "$here/reference.py" "$here/../../tests/fixtures/image_transforms"
