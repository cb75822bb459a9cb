"""Records with LeRobot, in the settings that it has by default for each codec: make_recordings.py FOLDER

FOLDER/CODEC has two episodes of 300 pictures, 640x480, in one file. FOLDER/files has 60 episodes of 6 pictures, each in a file of its own.
FOLDER/shuffled has the numbers of the frames of the former, out of order.
"""

import random
import sys
from pathlib import Path

import numpy as np
from lerobot.configs.video import RGBEncoderConfig
from lerobot.datasets.lerobot_dataset import LeRobotDataset

CODECS = {"h264": "h264", "av1": "libsvtav1", "hevc": "hevc"}
HEIGHT, WIDTH, CAMERA = 480, 640, "observation.images.top"
VECTOR = {"dtype": "float32", "shape": (6,), "names": [f"joint_{n}" for n in range(6)]}
FEATURES = {
    "observation.state": VECTOR,
    "action": VECTOR,
    CAMERA: {"dtype": "video", "shape": (HEIGHT, WIDTH, 3), "names": ["height", "width", "channels"]},
}


def pictures():
    """A table with the grain of wood, on which an arm moves, as a camera with noise sees it."""
    noise = np.random.default_rng(46)
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    grain = 20 * np.sin(x / 7 + 3 * np.sin(y / 60)) + noise.normal(0, 6, (HEIGHT, WIDTH))
    table = np.stack([150 + grain, 110 + grain, 80 + grain / 2], axis=-1).astype(np.float32)
    sensor = noise.normal(0, 3, (HEIGHT + 64, WIDTH + 64, 3)).astype(np.float32)
    n = 0
    while True:
        picture = table.copy()
        for part in range(4):
            row, column = 300 - 60 * part, 320 + 200 * np.sin(n / 40 + part / 2)
            joint = (y - row) ** 2 + (x - column) ** 2 < (50 - 6 * part) ** 2
            picture[joint] = (220 - 50 * part, 200 - 20 * part, 40 + 60 * part)
        down, right = noise.integers(0, 64, 2)
        picture += sensor[down : down + HEIGHT, right : right + WIDTH]
        yield picture.clip(0, 255).astype(np.uint8)
        n += 1


def record(root, codec, episodes, length, **options):
    dataset = LeRobotDataset.create("zk0/bench", 30, FEATURES, root=root, rgb_encoder=RGBEncoderConfig(vcodec=codec), **options)
    seen = pictures()
    for episode in range(episodes):
        for n in range(length):
            vector = np.full(6, np.sin((episode * length + n) / 40), np.float32)
            dataset.add_frame({"observation.state": vector, "action": vector, CAMERA: next(seen), "task": "Move the arm."})
        dataset.save_episode()
    dataset.finalize()


folder = Path(sys.argv[1])
for name, codec in CODECS.items():
    record(folder / name, codec, 2, 300)
record(folder / "files", "h264", 60, 6, video_files_size_in_mb=1e-6)
shuffled = list(range(600))
random.Random(46).shuffle(shuffled)
(folder / "shuffled").write_text("\n".join(map(str, shuffled)))
