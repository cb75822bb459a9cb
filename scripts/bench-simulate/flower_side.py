"""Flower's side of the comparison: its simulation engine, with FedAvg of the message API.

    flower_side.py softmax FOLDER NODES ROUNDS     the regressions of bench_simulate; writes the weights to FOLDER/flower.f64
    flower_side.py noop BYTES NODES ROUNDS         updates that are what the nodes got
"""

import logging
import os
import sys
from pathlib import Path

os.environ.setdefault("RAY_DEDUP_LOGS", "0")

import numpy as np
from flwr.app import ArrayRecord, ConfigRecord, Context, Message, MetricRecord, RecordDict
from flwr.clientapp import ClientApp
from flwr.serverapp import Grid, ServerApp
from flwr.serverapp.strategy import FedAvg
from flwr.simulation import run_simulation

FEATURES, CLASSES, STEPS, RATE = 32, 10, 5, 0.5
KIND, WHAT = sys.argv[1], sys.argv[2]
NODES, ROUNDS = int(sys.argv[3]), int(sys.argv[4])

client, server = ClientApp(), ServerApp()


def step(weights, features, classes):
    logits = features @ weights[:, :FEATURES].T + weights[:, FEATURES]
    powers = np.exp(logits - logits.max(axis=1, keepdims=True))
    errors = powers / powers.sum(axis=1, keepdims=True)
    errors[np.arange(len(classes)), classes] -= 1
    gradient = np.concatenate([errors.T @ features, errors.sum(axis=0)[:, None]], axis=1)
    return weights - RATE / len(classes) * gradient


@client.train()
def train(message: Message, context: Context):
    weights = message.content["arrays"].to_numpy_ndarrays()[0]
    if KIND == "softmax":
        node = context.node_config["partition-id"]
        data = np.fromfile(f"{WHAT}/node-{node}.f64").reshape(-1, FEATURES + 1)
        features, classes = data[:, :FEATURES], data[:, FEATURES].astype(int)
        for _ in range(STEPS):
            weights = step(weights, features, classes)
    reply = {"arrays": ArrayRecord([weights]), "metrics": MetricRecord({"num-examples": 1})}
    return Message(content=RecordDict(reply), reply_to=message)


@server.main()
def main(grid: Grid, context: Context):
    if KIND == "softmax":
        start = np.zeros((CLASSES, FEATURES + 1))
    else:
        start = np.full(-(-int(WHAT) // 8), 1.5)
    # Without `min_train_nodes`, Flower starts with those nodes that happen to be connected.
    strategy = FedAvg(fraction_train=1.0, fraction_evaluate=0.0, min_train_nodes=NODES, min_available_nodes=NODES)
    result = strategy.start(grid=grid, initial_arrays=ArrayRecord([start]), num_rounds=ROUNDS)
    weights = result.arrays.to_numpy_ndarrays()[0]
    if KIND == "softmax":
        weights.tofile(Path(WHAT) / "flower.f64")
    elif not np.allclose(weights, 1.5):
        raise SystemExit("the mean of equal updates is another value")


if __name__ == "__main__":
    logging.getLogger("flwr").setLevel(logging.WARNING)
    cores = {"client_resources": {"num_cpus": 1, "num_gpus": 0.0}}
    run_simulation(server_app=server, client_app=client, num_supernodes=NODES, backend_config=cores)
