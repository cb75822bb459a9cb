"""Episodes of the simulated arm as a LeRobotDataset."""

import os

from simulator import CAMERA, FPS, JOINTS, SIDE, TASK

# The video encoder then prints errors alone.
os.environ.setdefault("SVT_LOG", "1")

try:
    from lerobot.datasets.lerobot_dataset import LeRobotDataset
except ImportError as missing:
    raise SystemExit(
        f"error: LeRobot is not installed: {missing}. Run `make rollout`, which installs scripts/rollout/requirements.txt into ~/.cache/zk0/rollout, and "
        "start this script with the Python of that folder"
    ) from missing

STATE, ACTION, IMAGE = "observation.state", "action", f"observation.images.{CAMERA}"
VECTOR = {"dtype": "float32", "shape": (len(JOINTS),), "names": [f"{name}.pos" for name in JOINTS]}
FEATURES = {
    STATE: VECTOR,
    ACTION: VECTOR,
    IMAGE: {"dtype": "video", "shape": (SIDE, SIDE, 3), "names": ["height", "width", "channels"]},
}


def create(folder):
    """An empty dataset in the new folder `folder`."""
    if folder.exists():
        raise SystemExit(f"error: {folder} exists already: choose another folder, or remove it")
    return LeRobotDataset.create(repo_id=f"zk0/{folder.name}", root=folder, fps=FPS, features=FEATURES, robot_type="so101_follower")


def add(dataset, frames):
    """Adds an episode: a list of (joint positions, picture, targets)."""
    for state, picture, action in frames:
        dataset.add_frame({STATE: state, IMAGE: picture, ACTION: action, "task": TASK})
    dataset.save_episode()
