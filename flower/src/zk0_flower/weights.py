"""Weights as Flower's arrays.

The ledger's files of weights hold int16 numbers, and how many fraction bits the numbers of each tensor have: the tensor ``fraction_bits`` has
those of the others, in the order of the file. Each number is exact in float32.
"""

import json
from pathlib import Path

import numpy as np
from flwr.app import Array, ArrayRecord
from safetensors.numpy import load

SCALES = "fraction_bits"
_LENGTH_BYTES = 8


def read(path: Path) -> ArrayRecord:
    """The tensors of a file of weights in float32, under the names that LeRobot gives them, in the order of the file.

    ``path`` is a file that an audit has checked. Raises `OSError` if it cannot be read.
    """
    content = path.read_bytes()
    tensors = load(content)
    scales = tensors.pop(SCALES)
    names = [name for name in _names_in_order(content) if name != SCALES]
    return ArrayRecord(
        {name: Array(np.ldexp(tensors[name].astype(np.float32), -int(bits))) for name, bits in zip(names, scales, strict=True)}
    )


def _names_in_order(content: bytes) -> list[str]:
    """The names of a safetensors file in the order of their places. `load` returns them in another order."""
    length = int.from_bytes(content[:_LENGTH_BYTES], "little")
    header = json.loads(content[_LENGTH_BYTES : _LENGTH_BYTES + length])
    header.pop("__metadata__", None)
    return sorted(header, key=lambda name: header[name]["data_offsets"])
