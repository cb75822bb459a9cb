"""Prints how far LeRobot's own transforms are from the functions that reference.py calls, with the same parameters, and fails if they differ.

usage: same_as_lerobot.py        in an environment with LeRobot, such as that of `make rollout`
"""

import sys

from lerobot.datasets.transforms import ImageTransformConfig, make_transform_from_config
from reference import CASES, picture
from torchvision.transforms.v2 import functional as F


def own(kind, **parameters):
    """A transform of LeRobot with parameters that leave nothing to chance."""
    bounds = {name: (value, value) for name, value in parameters.items()}
    return make_transform_from_config(ImageTransformConfig(type=kind, kwargs=bounds))


def main():
    image, furthest = picture(), 0.0
    for ((name, values), *more) in CASES:
        if more:
            continue
        if name == "affine":
            theirs = own("RandomAffine", degrees=values[0])(image)
            expected = F.affine(image, values[0], [0, 0], 1.0, [0.0, 0.0])
        else:
            kind = "SharpnessJitter" if name == "sharpness" else "ColorJitter"
            theirs = own(kind, **{name: values[0]})(image)
            expected = getattr(F, f"adjust_{name}")(image, values[0])
        difference = (theirs - expected).abs().max().item()
        furthest = max(furthest, difference)
        print(f"{name} {values[0]}: {difference}")
    sys.exit("LeRobot's transforms differ" if furthest > 0 else 0)


main()
