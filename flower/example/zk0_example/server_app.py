"""The ServerApp: it runs the rounds, and writes what came of them."""

import json
from dataclasses import asdict
from pathlib import Path

from flwr.app import Context
from flwr.serverapp import Grid, ServerApp
from safetensors.numpy import save_file

from zk0_flower import Zk0Strategy

app = ServerApp()


@app.main()
def main(grid: Grid, context: Context) -> None:
    """Runs the rounds."""
    config = context.run_config
    folder = Path(str(config["folder"]))
    strategy = Zk0Strategy(
        aggregator=str(config["aggregator"]),
        log_address=str(config["log"]),
        network=str(config["network"]),
        folder=folder,
        program=str(config["program"]),
        min_nodes=int(config["nodes"]),
    )
    strategy.start(grid=grid, initial_arrays=strategy.initial_arrays(), num_rounds=int(config["rounds"]))
    weights = {name: array.numpy() for name, array in strategy.initial_arrays().items()}
    save_file(weights, folder / "weights.safetensors")
    outcomes = [asdict(outcome) for outcome in strategy.outcomes]
    # Sets of identities become lists.
    (folder / "outcomes.json").write_text(json.dumps(outcomes, indent=2, default=sorted) + "\n")
