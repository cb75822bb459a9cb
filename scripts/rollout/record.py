#!/usr/bin/env python3
"""Records demonstrations of a scripted expert on the simulated arm, as a LeRobotDataset.

    record.py FOLDER [--episodes N] [--seed N] [--shake DEGREES]

The expert is the controller of `lerobot-env-so101`, which is told where the block is. The motors are shaken, so that the recording shows how to come back
to the way; the recorded action is the expert's. An episode ends when the expert has succeeded and held still for half a second.
"""

import argparse
from pathlib import Path

# First, because these say what to do if something is not installed.
import recording
from simulator import FPS, Arm

import numpy as np

LONGEST = 8 * FPS
STILL = FPS // 2


def demonstrate(arm, seed, shake):
    """An episode of the expert, and whether it succeeded."""
    arm.reset(seed)
    draws, frames, held = np.random.default_rng(seed), [], 0
    while len(frames) < LONGEST and held < STILL:
        state, picture, targets = arm.positions(), arm.picture(), arm.expert_targets()
        frames.append((state, picture, targets))
        shaken = targets.copy()
        shaken[:5] += draws.normal(0, shake, 5)
        arm.drive(shaken)
        held = held + 1 if arm.succeeded() and targets[5] < 1 else 0
    return frames, arm.succeeded()


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("folder", type=Path)
    arguments.add_argument("--episodes", type=int, default=60)
    arguments.add_argument("--seed", type=int, default=100_000, help="the seed of the first episode; each further one has the next")
    arguments.add_argument("--shake", type=float, default=0.7, help="standard deviation, in degrees")
    options = arguments.parse_args()

    dataset, arm, kept, frames_kept, seed = recording.create(options.folder), Arm(), 0, 0, options.seed
    while kept < options.episodes:
        frames, succeeded = demonstrate(arm, seed, options.shake)
        seed += 1
        if succeeded:
            recording.add(dataset, frames)
            kept, frames_kept = kept + 1, frames_kept + len(frames)
    dataset.finalize()
    arm.close()
    print(f"{options.folder}: {kept} demonstrations, {frames_kept} frames; the expert failed in {seed - options.seed - kept} more, which were left out")


if __name__ == "__main__":
    main()
