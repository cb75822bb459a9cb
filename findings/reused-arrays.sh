#!/usr/bin/env bash
# What: LeRobot 0.6.1 keeps the arrays that LeRobotDataset.add_frame gets, not their values. It reads them when save_episode is called.
#     A recorder that fills one array again and again, as drivers and simulators may, gets the last values of the episode in every row.
#     The picture of each frame is right, because add_frame writes it at once, unless threads write pictures. There is no error and no
#     warning.
# Version: lerobot 0.6.1, with the packages below, on Python 3.12. Seen on 2026-11-29.
# Seen: an episode of four frames with the states 0, 1, 2, 3 is saved with the states 3, 3, 3, 3 and the pictures 0, 1, 2, 3. The same
#     loop saves 0, 1, 2, 3 when it hands over copies.
# Why it matters: every episode seems to stand still while its pictures move. The values are lost, and a policy trains on what is left.
#
# It takes up to 9 GB in a temporary folder (TMPDIR chooses where), and removes it at the end.
# Environment: PYTHON, a Python 3.12 (default: python3.12).
# Exit code: 0 the behaviour is as stated, 1 it changed, 2 it could not be tried.
set -euo pipefail

stated='reused arrays: states 3 3 3 3, actions 13 13 13 13, pictures 0 1 2 3; copies: states 0 1 2 3, actions 10 11 12 13, pictures 0 1 2 3'
fail() { echo "reused-arrays: $2" >&2; exit "$1"; }

dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export TMPDIR=$dir
"${PYTHON:-python3.12}" -m venv "$dir/venv" || fail 2 "this needs Python 3.12: set PYTHON to one"
pip=("$dir/venv/bin/pip" --disable-pip-version-check --quiet)
torch=(torch==2.11.0 torchvision==0.26.0)
# The builds for CPUs are far smaller; where their index cannot be reached, PyPI has the large ones.
"${pip[@]}" --retries 0 install --index-url https://download.pytorch.org/whl/cpu "${torch[@]}" 2>/dev/null || true
"${pip[@]}" install "${torch[@]}" 'lerobot[dataset]==0.6.1' datasets==4.8.5 pyarrow==26.0.1 pandas==2.3.3 numpy==2.2.6 ||
    fail 2 "the packages could not be installed"

export HF_HOME=$dir/hub HF_HUB_OFFLINE=1
seen=$("$dir/venv/bin/python" - "$dir" 2>"$dir/messages" <<'PYTHON'
import sys
from pathlib import Path

import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset

PICTURE, STATE, ACTION = "observation.images.front", "observation.state", "action"
FEATURES = {
    PICTURE: {"dtype": "image", "shape": (32, 32, 3), "names": ["height", "width", "channels"]},
    STATE: {"dtype": "float32", "shape": (2,), "names": ["shoulder", "wrist"]},
    ACTION: {"dtype": "float32", "shape": (2,), "names": ["shoulder", "wrist"]},
}


def recorded(root, hand_over):
    dataset = LeRobotDataset.create("local/test", fps=10, features=FEATURES, root=root, use_videos=False)
    picture, state, action = np.zeros((32, 32, 3), np.uint8), np.zeros(2, np.float32), np.zeros(2, np.float32)
    for step in range(4):
        picture[:], state[:], action[:] = step, step, 10 + step
        frame = {PICTURE: picture, STATE: state, ACTION: action}
        dataset.add_frame({key: hand_over(value) for key, value in frame.items()} | {"task": "pick the cup"})
    dataset.save_episode()
    dataset.finalize()

    items = [item for item in LeRobotDataset("local/test", root=root)]
    states = " ".join(f"{item[STATE][0]:.0f}" for item in items)
    actions = " ".join(f"{item[ACTION][0]:.0f}" for item in items)
    pictures = " ".join(f"{item[PICTURE].mean() * 255:.0f}" for item in items)
    return f"states {states}, actions {actions}, pictures {pictures}"


folder = Path(sys.argv[1])
print(f"reused arrays: {recorded(folder / 'reused', lambda array: array)}", end="; ")
print(f"copies: {recorded(folder / 'copied', np.copy)}")
PYTHON
) || fail 1 "this changed: LeRobot stops with an error: $(tail -n 1 "$dir/messages")"

[ "$seen" = "$stated" ] || fail 1 "this changed. Seen on 2026-11-29: $stated. Seen now: $seen"
echo "reused-arrays: LeRobot 0.6.1: $seen"
