"""Times LeRobot's own reader, and prints one JSON line for each case: lerobot_side.py RECORDINGS NAME:WHAT…

WHAT is `open`, `in-order` or `shuffled`. One picture is asked for at a time, as LeRobot's dataset does. Pictures are left 8-bit, as ours are, which
spares LeRobot a division. The reader's decoder is made before the clock starts. The seconds are those of the processor.
"""

import json
import sys
import time
from pathlib import Path

from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.datasets.video_utils import decode_video_frames

OPENINGS = 20


def opened(folder):
    return LeRobotDataset("zk0/bench", root=folder, return_uint8=True)


recordings = Path(sys.argv[1])
for case in sys.argv[2:]:
    name, what = case.split(":")
    dataset = opened(recordings / name)
    if what == "open":
        began = time.process_time()
        for _ in range(OPENINGS):
            opened(recordings / name)
        each = (time.process_time() - began) / OPENINGS
    else:
        frames = range(dataset.num_frames)
        if what == "shuffled":
            frames = [int(line) for line in (recordings / "shuffled").read_text().split()]
        (camera,) = dataset.meta.video_keys
        video = dataset.root / dataset.meta.get_video_file_path(0, camera)  # All episodes are in one file.

        def read(frame):
            decode_video_frames(video, [frame / dataset.fps], dataset.tolerance_s, "torchcodec", return_uint8=True)

        read(0)
        began = time.process_time()
        for frame in frames:
            read(frame)
        each = (time.process_time() - began) / len(frames)
    print(json.dumps({"side": "lerobot", "case": case, "each": each}), flush=True)
