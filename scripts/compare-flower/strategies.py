"""Combines the weights in a folder with Flower's own strategies, and writes what comes out.

usage: FLWR_TELEMETRY_ENABLED=0 strategies.py tests/fixtures/flower

The folder holds files of weights as zk0 exchanges them: update-N.safetensors, base.safetensors and earlier.safetensors. Flower gets
their numbers as float64 arrays, so that its rounding is far below ours. The results are NAME.safetensors, one for each case below.
The shares that weigh the updates, and the parameters, are those of verifier/tests/flower.rs.
"""

import json
import sys
from pathlib import Path

import numpy as np
from flwr.app import Array, ArrayRecord, Message, MetricRecord, RecordDict
from flwr.serverapp.strategy import (
    DifferentialPrivacyServerSideFixedClipping,
    FedAdam,
    FedAvg,
    FedAvgM,
    FedMedian,
    FedTrimmedAvg,
    Krum,
    MultiKrum,
)
from flwr.supercore.task_identity import TaskIdentity

SHARES = [10000, 20000, 5000, 10000, 3333, 12345, 10000]
EQUAL = [1] * len(SHARES)
# Of 7 contributors, 2857 basis points are 1.9999 and 2900 are 2.03.
MALICIOUS, KEPT, TRIMMED = 2, 4, 0.2
MAX_NORM, SERVER_RATE, MOMENTUM = 0.9, 0.7, 0.9
ADAM = {"eta": 0.1, "beta_1": 0.9, "beta_2": 0.99, "tau": 0.001}


def read(path):
    """The tensors of a file of weights, as numbers."""
    data = path.read_bytes()
    length = int.from_bytes(data[:8], "little")
    header, data = json.loads(data[8 : 8 + length]), data[8 + length :]
    tensor = lambda about: np.frombuffer(data[slice(*about["data_offsets"])], "<i2").reshape(about["shape"])
    bits = tensor(header.pop("fraction_bits"))
    return {name: tensor(about) / 2.0**scale for (name, about), scale in zip(header.items(), bits, strict=True)}


def write(path, tensors):
    """A safetensors file of float64 tensors."""
    header, place = {}, 0
    for name, array in tensors.items():
        header[name] = {"dtype": "F64", "shape": array.shape, "data_offsets": [place, place + array.nbytes]}
        place += array.nbytes
    header = json.dumps(header, separators=(",", ":")).encode()
    header += b" " * (-len(header) % 8)
    path.write_bytes(len(header).to_bytes(8, "little") + header + b"".join(a.astype("<f8").tobytes() for a in tensors.values()))


def record(tensors):
    return ArrayRecord({name: Array(np.asarray(array, np.float64)) for name, array in tensors.items()})


def replies(updates, weights):
    """What Flower's server gets from its nodes."""
    for number, (update, weight) in enumerate(zip(updates, weights, strict=True)):
        asked = Message(content=RecordDict(), dst_node_id=number + 1, message_type="train")
        metrics = MetricRecord({"num-examples": weight})
        yield Message(content=RecordDict({"arrays": record(update), "metrics": metrics}), reply_to=asked)


def combined(strategy, updates, weights):
    arrays, _ = strategy.aggregate_train(1, list(replies(updates, weights)))
    return dict(zip(updates[0], arrays.to_numpy_ndarrays(), strict=True))


def norm(tensors):
    return float(np.sqrt(sum(np.square(array).sum() for array in tensors.values())))


def clipped(base, updates):
    strategy = DifferentialPrivacyServerSideFixedClipping(FedAvg(), 0.0, MAX_NORM * norm(base), len(updates))
    strategy.current_arrays = record(base)
    return combined(strategy, updates, SHARES)


def with_momentum(earlier, base, updates):
    """Flower's second round. Its first one goes from `earlier` to `base`."""
    strategy = FedAvgM(server_learning_rate=SERVER_RATE, server_momentum=MOMENTUM)
    strategy.current_arrays = record(earlier)
    before = {name: earlier[name] + (base[name] - earlier[name]) / SERVER_RATE for name in base}
    combined(strategy, [before], [1])
    return combined(strategy, updates, SHARES)


def adaptive(earlier, base, updates):
    """Flower's second round. Its first one started from `earlier`, and its one update was `base`."""
    strategy = FedAdam(**ADAM)
    strategy.current_arrays = earlier
    strategy.aggregate_train(1, list(replies([base], [1])))
    strategy.current_arrays = base
    arrays, _ = strategy.aggregate_train(2, list(replies(updates, SHARES)))
    return {name: arrays[name].numpy() for name in base}


def main():
    folder = Path(sys.argv[1])
    # A message belongs to a run.
    TaskIdentity.task_id = TaskIdentity.run_id = TaskIdentity.node_id = 1
    updates = [read(folder / f"update-{number}.safetensors") for number in range(len(SHARES))]
    base, earlier = read(folder / "base.safetensors"), read(folder / "earlier.safetensors")
    results = {
        "fed-avg": combined(FedAvg(), updates, SHARES),
        "median": combined(FedMedian(), updates, EQUAL),
        "trimmed-mean": combined(FedTrimmedAvg(beta=TRIMMED), updates, EQUAL),
        "krum": combined(Krum(num_malicious_nodes=MALICIOUS), updates, EQUAL),
        "multi-krum": combined(
            MultiKrum(num_malicious_nodes=MALICIOUS, num_nodes_to_select=KEPT), updates, EQUAL
        ),
        "norm-clipping": clipped(base, updates),
        "fed-avg-m": with_momentum(earlier, base, updates),
        "fed-adam": adaptive(earlier, base, updates),
    }
    for name, tensors in results.items():
        write(folder / f"{name}.safetensors", tensors)


main()
