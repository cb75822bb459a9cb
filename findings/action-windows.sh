#!/usr/bin/env bash
# What: LeRobot 0.6.1 gives the frames of a recording the actions of other frames, if the rows of its table are in another order than
#     when it was recorded. It takes the frame from a row, and its action window by the numbers in the column `index`, as if these were
#     positions of rows. It does so when the whole recording is opened; with a list of episodes, it looks the numbers up in the column.
# Version: lerobot 0.6.1, with the packages below, on Python 3.12. Seen on 2026-11-29.
# Seen: two episodes of four frames have the states 0 to 7 and the actions 100 to 107. Their table is sorted by the latest episode first;
#     all rows are there, and all columns are right. make_dataset, by which lerobot-train opens recordings, opens it for ACT without a
#     warning. The frame with the state 4 gets the actions 100, 101, 102 of the other episode. With `episodes=[0, 1]`, which are all
#     episodes, it gets 104, 105, 106.
# Why it matters: a policy trains on pictures of one episode with the actions of another. Sorting the table is enough.
#
# It takes up to 9 GB in a temporary folder (TMPDIR chooses where), and removes it at the end.
# Environment: PYTHON, a Python 3.12 (default: python3.12).
# Exit code: 0 the behaviour is as stated, 1 it changed, 2 it could not be tried.
set -euo pipefail

stated='whole recording: state 4, picture 4, actions 100 101 102; episodes 0 and 1: state 4, picture 4, actions 104 105 106'
fail() { echo "action-windows: $2" >&2; exit "$1"; }

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
seen=$("$dir/venv/bin/python" - "$dir/recording" 2>"$dir/messages" <<'PYTHON'
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from lerobot.configs.default import DatasetConfig
from lerobot.configs.train import TrainPipelineConfig
from lerobot.datasets.factory import make_dataset
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.policies.act.configuration_act import ACTConfig

PICTURE, STATE, ACTION = "observation.images.front", "observation.state", "action"
FEATURES = {
    PICTURE: {"dtype": "image", "shape": (32, 32, 3), "names": ["height", "width", "channels"]},
    STATE: {"dtype": "float32", "shape": (2,), "names": ["shoulder", "wrist"]},
    ACTION: {"dtype": "float32", "shape": (2,), "names": ["shoulder", "wrist"]},
}


def record(root):
    dataset = LeRobotDataset.create("local/test", fps=10, features=FEATURES, root=root, use_videos=False)
    for first in (0, 4):
        for step in range(first, first + 4):
            dataset.add_frame(
                {
                    PICTURE: np.full((32, 32, 3), step, np.uint8),
                    STATE: np.full(2, step, np.float32),
                    ACTION: np.full(2, 100 + step, np.float32),
                    "task": "pick the cup",
                }
            )
        dataset.save_episode()
    dataset.finalize()


def frame_4(root, episodes):
    """The frame whose column `index` is 4, as lerobot-train gets it for ACT with chunks of three actions."""
    dataset = make_dataset(
        TrainPipelineConfig(
            dataset=DatasetConfig("local/test", root=str(root), episodes=episodes),
            policy=ACTConfig(chunk_size=3, n_action_steps=3, device="cpu", push_to_hub=False),
        )
    )
    item = next(item for item in dataset if item["index"] == 4)
    actions = " ".join(f"{action[0]:.0f}" for action in item[ACTION])
    return f"state {item[STATE][0]:.0f}, picture {item[PICTURE].mean() * 255:.0f}, actions {actions}"


root = Path(sys.argv[1])
record(root)
table = root / "data/chunk-000/file-000.parquet"
latest_first = pq.read_table(table).sort_by([("episode_index", "descending"), ("frame_index", "ascending")])
pq.write_table(latest_first, table)
print(f"whole recording: {frame_4(root, None)}; episodes 0 and 1: {frame_4(root, [0, 1])}")
PYTHON
) || fail 1 "this changed: LeRobot stops with an error: $(tail -n 1 "$dir/messages")"

[ "$seen" = "$stated" ] || fail 1 "this changed. Seen on 2026-11-29: $stated. Seen now: $seen"
echo "action-windows: LeRobot 0.6.1: $seen"
