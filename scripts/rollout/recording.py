"""Episodes of the simulated arm as a LeRobotDataset."""

from lerobot.datasets.lerobot_dataset import LeRobotDataset
from simulator import CAMERA, FPS, JOINTS, SIDE, TASK

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
