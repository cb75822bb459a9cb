"""Writes FOLDER/reference.safetensors: a picture, and what torchvision's v2 transforms make of it with the parameters below.

LeRobot transforms pictures as float32 tensors between 0 and 1 (lerobot/datasets/transforms.py), by ColorJitter, RandomAffine and its own
SharpnessJitter. They draw parameters, and then call the functions that are called here. Results are rounded to 16 bits.
"""

import json
import struct
import sys
from pathlib import Path

import torch
from torchvision.transforms.v2 import InterpolationMode
from torchvision.transforms.v2 import functional as F

HEIGHT, WIDTH = 48, 64

# One list per case: transforms, one after another, each with its parameters.
CASES = [
    [("brightness", [0.8])],
    [("brightness", [1.2])],
    [("contrast", [0.8])],
    [("contrast", [1.2])],
    [("saturation", [0.5])],
    [("saturation", [1.5])],
    [("hue", [-0.05])],
    [("hue", [0.05])],
    [("hue", [0.4])],
    [("sharpness", [0.5])],
    [("sharpness", [1.5])],
    # angle, translation along x and y in pixels, scale, shear along x and y
    [("affine", [4.3, 3, -2, 1.0, 0.0, 0.0])],
    [("affine", [-5.0, -1, 2, 1.0, 0.0, 0.0])],
    [("affine", [12.5, 0, 5, 1.3, 8.0, -3.0])],
    [("contrast", [1.13]), ("hue", [-0.031]), ("affine", [2.2, 1, 1, 1.0, 0.0, 0.0])],
]


def picture():
    """Smooth colours, an edge, grey, black and white."""
    y, x = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
    planes = [
        (x * 4 + y) % 256,
        (y * 5 + (x // 8) * 13) % 256,
        (255 - x * 2 - y * 2 + (x * y) % 31).clamp(0, 255),
    ]
    image = torch.stack(planes).to(torch.uint8)
    image[:, 4:12, 4:12] = 128
    image[:, 4:12, 16:20] = 0
    image[:, 4:12, 24:28] = 255
    image[0, 20:30, 40:50] = 255
    image[1:, 20:30, 40:50] = 0
    return image


def apply(image, name, values):
    if name == "affine":
        angle, tx, ty, scale, shear_x, shear_y = values
        return F.affine(
            image, angle=angle, translate=[tx, ty], scale=scale, shear=[shear_x, shear_y],
            interpolation=InterpolationMode.NEAREST, fill=0, center=None,
        )
    return getattr(F, f"adjust_{name}")(image, *values)


def main():
    torch.set_num_threads(1)
    pixels = picture()
    tensors = {"picture": ("U8", list(pixels.shape), bytes(pixels.flatten().tolist()))}
    for number, case in enumerate(CASES):
        image = pixels.to(torch.float32) / 255
        for name, values in case:
            image = apply(image, name, values)
        rounded = (image.double() * 65535).round().to(torch.int64).flatten().tolist()
        tensors[f"case-{number:02}"] = ("U16", list(pixels.shape), struct.pack(f"<{len(rounded)}H", *rounded))
    header, at, body = {}, 0, b""
    for name, (dtype, shape, data) in tensors.items():
        header[name] = {"dtype": dtype, "shape": shape, "data_offsets": [at, at + len(data)]}
        at += len(data)
        body += data
    header["__metadata__"] = {"cases": json.dumps(CASES)}
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    out = Path(sys.argv[1]) / "reference.safetensors"
    out.write_bytes(struct.pack("<Q", len(text)) + text + body)


if __name__ == "__main__":
    main()
