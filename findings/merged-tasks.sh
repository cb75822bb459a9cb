#!/usr/bin/env bash
# What: LeRobot 0.6.1 does not use the column `task_index` of meta/tasks.parquet when it reads the task of a frame: it takes the row at
#     that position. If the rows are in alphabetical order, frames get the task of others, and `lerobot-edit-dataset` merges the
#     recording with the wrong tasks into a new one. There is no error and no warning.
# Version: lerobot 0.6.1, with the packages below, on Python 3.12. Seen on 2026-11-29.
# Seen: episode 0 is recorded with the task "pick the cup", episode 1 with "open the door". pandas sorts the table of tasks by name; each
#     task keeps its number. Then the frames of episode 0 have the task "open the door". After a merge with another recording they still
#     have it, and now their `task_index` says so, too: the new table of tasks is in order. Only meta/episodes still says "pick the cup".
# Why it matters: policies that follow instructions train on the wrong one. The merged recording looks sound.
#
# It takes up to 9 GB in a temporary folder (TMPDIR chooses where), and removes it at the end.
# Environment: PYTHON, a Python 3.12 (default: python3.12).
# Exit code: 0 the behaviour is as stated, 1 it changed, 2 it could not be tried.
set -euo pipefail

stated='recorded: pick the cup, frames: pick the cup; sorted: pick the cup, frames: open the door; merged: pick the cup, frames: open the door'
fail() { echo "merged-tasks: $2" >&2; exit "$1"; }

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
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from lerobot.datasets.lerobot_dataset import LeRobotDataset

PICTURE, STATE, ACTION = "observation.images.front", "observation.state", "action"
FEATURES = {
    PICTURE: {"dtype": "image", "shape": (32, 32, 3), "names": ["height", "width", "channels"]},
    STATE: {"dtype": "float32", "shape": (2,), "names": ["shoulder", "wrist"]},
    ACTION: {"dtype": "float32", "shape": (2,), "names": ["shoulder", "wrist"]},
}


def record(root):
    dataset = LeRobotDataset.create("local/test", fps=10, features=FEATURES, root=root, use_videos=False)
    for task in ("pick the cup", "open the door"):
        for step in range(4):
            dataset.add_frame(
                {
                    PICTURE: np.full((32, 32, 3), step, np.uint8),
                    STATE: np.full(2, step, np.float32),
                    ACTION: np.full(2, step, np.float32),
                    "task": task,
                }
            )
        dataset.save_episode()
    dataset.finalize()


def episode_0(root):
    """The tasks of episode 0, by meta/episodes and by its frames."""
    dataset = LeRobotDataset("local/test", root=root)
    episode = dataset.meta.episodes[0]
    frames = range(episode["dataset_from_index"], episode["dataset_to_index"])
    of_frames = {dataset[frame]["task"] for frame in frames}
    return f"{', '.join(episode['tasks'])}, frames: {', '.join(sorted(of_frames))}"


folder = Path(sys.argv[1])
mine, other, merged = folder / "mine", folder / "other", folder / "merged"
record(mine)
record(other)
recorded = episode_0(mine)

tasks = mine / "meta/tasks.parquet"
pd.read_parquet(tasks).sort_index().to_parquet(tasks)
by_name = episode_0(mine)

subprocess.run(
    [
        folder / "venv/bin/lerobot-edit-dataset",
        "--new_repo_id=local/merged",
        f"--new_root={merged}",
        "--operation.type=merge",
        "--operation.repo_ids=['local/mine', 'local/other']",
        f"--operation.roots=['{mine}', '{other}']",
    ],
    stdout=sys.stderr,
    check=True,
)
table = pd.read_parquet(merged / "meta/tasks.parquet")
assert list(table["task_index"]) == [0, 1], "the merged table of tasks is not in order"
print(f"recorded: {recorded}; sorted: {by_name}; merged: {episode_0(merged)}")
PYTHON
) || fail 1 "this changed: LeRobot stops with an error: $(tail -n 1 "$dir/messages")"

[ "$seen" = "$stated" ] || fail 1 "this changed. Seen on 2026-11-29: $stated. Seen now: $seen"
echo "merged-tasks: LeRobot 0.6.1: $seen"
