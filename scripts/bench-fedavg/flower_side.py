"""Averages the updates in a folder with Flower's FedAvg, and prints one JSON line.

usage: FLWR_TELEMETRY_ENABLED=0 flower_side.py FOLDER

The folder holds files of weights as zk0 exchanges them. Flower gets the same numbers as float32 arrays, in the messages that its server
gets from its nodes. Only the averaging is timed: neither reading the files nor making the messages. The peak of memory is that of all.
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


def update(path):
    """The tensors of a file of weights, as Flower holds them."""
    data = np.memmap(path, np.uint8, "r")
    length = int(data[:8].view("<u8")[0])
    header, data = json.loads(data[8 : 8 + length].tobytes()), data[8 + length :]
    tensor = lambda about: data[slice(*about["data_offsets"])].view("<i2").reshape(about["shape"])
    bits = tensor(header.pop("fraction_bits"))
    array = lambda about, scale: Array(np.ldexp(tensor(about).astype(np.float32), -int(scale)))
    tensors = zip(header.items(), bits, strict=True)
    return ArrayRecord({name: array(about, scale) for (name, about), scale in tensors})


def replies(paths):
    for number, path in enumerate(paths):
        asked = Message(content=RecordDict(), dst_node_id=number + 1, message_type="train")
        content = {"arrays": update(path), "metrics": MetricRecord({"num-examples": 1})}
        yield Message(content=RecordDict(content), reply_to=asked)


def main():
    TaskIdentity.task_id = TaskIdentity.run_id = TaskIdentity.node_id = 1
    paths = sorted(Path(sys.argv[1]).glob("update-*.safetensors"))
    messages = list(replies(paths))
    strategy = FedAvg()
    started = time.perf_counter()
    arrays, _ = strategy.aggregate_train(1, messages)
    seconds = time.perf_counter() - started
    print(
        json.dumps(
            {
                "side": "flower",
                "updates": len(paths),
                "seconds": seconds,
                "peak_memory_bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
                "tensors": len(arrays),
            }
        )
    )


main()
