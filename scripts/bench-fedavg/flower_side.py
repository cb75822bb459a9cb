"""Averages updates with Flower's FedAvg, from files to the new weights, and prints one JSON line.

usage: FLWR_TELEMETRY_ENABLED=0 flower_side.py make FOLDER COPIES   writes the updates of FOLDER to COPIES as float32
       FLWR_TELEMETRY_ENABLED=0 flower_side.py average COPIES       averages these

FOLDER holds files of weights as zk0 exchanges them. Flower gets the same numbers as float32, because its records hold float32. The time is that
of mapping the files, making the messages that Flower's server gets from its nodes, and averaging. The peak of memory is that of all.
"""

import json
import resource
import sys
import time
from pathlib import Path

import numpy as np
from flwr.app import Array, ArrayRecord, Message, MetricRecord, RecordDict
from flwr.serverapp.strategy import FedAvg
from flwr.supercore.task_identity import TaskIdentity


def make(path, copies):
    """Writes the tensors of a file of weights one after the other as float32, and a list of them beside."""
    data = np.memmap(path, np.uint8, "r")
    length = int(data[:8].view("<u8")[0])
    header, data = json.loads(data[8 : 8 + length].tobytes()), data[8 + length :]
    tensor = lambda about: data[slice(*about["data_offsets"])].view("<i2").reshape(about["shape"])
    bits = tensor(header.pop("fraction_bits"))
    copy = copies / path.name
    with open(copy.with_suffix(".f32"), "wb") as file:
        for about, scale in zip(header.values(), bits, strict=True):
            np.ldexp(tensor(about).astype(np.float32), -int(scale)).tofile(file)
    shapes = {name: about["shape"] for name, about in header.items()}
    copy.with_suffix(".json").write_text(json.dumps(shapes))


def update(path):
    """The tensors of an update, as Flower holds them."""
    values, at, arrays = np.memmap(path, np.float32, "r"), 0, {}
    for name, shape in json.loads(path.with_suffix(".json").read_text()).items():
        size = int(np.prod(shape))
        arrays[name] = Array(values[at : at + size].reshape(shape))
        at += size
    return ArrayRecord(arrays)


def replies(paths):
    for number, path in enumerate(paths):
        asked = Message(content=RecordDict(), dst_node_id=number + 1, message_type="train")
        content = {"arrays": update(path), "metrics": MetricRecord({"num-examples": 1})}
        yield Message(content=RecordDict(content), reply_to=asked)


def average(folder):
    TaskIdentity.task_id = TaskIdentity.run_id = TaskIdentity.node_id = 1
    paths = sorted(folder.glob("update-*.f32"))
    strategy = FedAvg()
    started = time.perf_counter()
    messages = list(replies(paths))
    made = time.perf_counter()
    arrays, _ = strategy.aggregate_train(1, messages)
    ended = time.perf_counter()
    line = {
        "side": "flower",
        "updates": len(paths),
        "seconds": ended - started,
        "averaging_seconds": ended - made,
        "peak_memory_bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
        "tensors": len(arrays),
    }
    print(json.dumps(line))


def main():
    what, folder = sys.argv[1], Path(sys.argv[2])
    if what == "average":
        return average(folder)
    for path in sorted(folder.glob("update-*.safetensors")):
        make(path, Path(sys.argv[3]))


main()
