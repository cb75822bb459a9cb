"""Runs the example: a zk0 network, and a SuperLink with three SuperNodes on this machine, two honest and one lazy.

    python flower/example/federation.py --out outputs/flower

The honest nodes prove for real, which takes 20 GiB of memory and minutes for each. The lazy node submits the base weights with a stolen proof.
"""

import argparse
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from local_network import FIXTURES, RECORDINGS, Network, Node, free_address, wait_for

from zk0_flower import Program

HERE = Path(__file__).resolve().parent
STOLEN_PROOF = FIXTURES / "proof.bin"


@dataclass
class Federation(Network):
    """A zk0 network, and a Flower federation of its nodes."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.environment = os.environ | {
            "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")]),
            "FLWR_HOME": str(self.out / "flwr"),
            "FLWR_TELEMETRY_ENABLED": "0",
            "FLWR_DISABLE_UPDATE_CHECK": "1",
        }

    def run(self, rounds: int) -> list[dict[str, Any]]:
        """Has the SuperLink run the app, and returns what came of its rounds. Raises `RuntimeError` if the run fails."""
        folder = self.out / "server"
        config: dict[str, Any] = {
            "rounds": rounds,
            "aggregator": self.aggregator,
            "log": self.log,
            "network": self.network,
            "nodes": len(self.nodes),
            "folder": str(folder),
            "program": self.zk0,
        }
        words = " ".join(f"{name}={json.dumps(value)}" for name, value in config.items())
        subprocess.run(["flwr", "run", str(HERE), "zk0", "--run-config", words, "--stream"], env=self.environment, check=True)
        results = folder / "outcomes.json"
        if not results.exists():
            raise RuntimeError("the run failed: the log above says why")
        outcomes: list[dict[str, Any]] = json.loads(results.read_text())
        return outcomes

    def _start(self) -> None:
        super()._start()
        superlink = free_address()
        host, port = superlink.split(":")
        # The app's dependencies are installed where this script runs.
        start = ["flower-superlink", "--insecure", "--disable-runtime-dependency-installation", "--host", host, "--port", port]
        self._process("superlink", start)
        wait_for(superlink)
        home = self.out / "flwr"
        home.mkdir(exist_ok=True)
        (home / "config.toml").write_text(f'[superlink]\ndefault = "zk0"\n\n[superlink.zk0]\naddress = "{superlink}"\ninsecure = true\n')
        for node in self.nodes:
            self._start_supernode(node, superlink)

    def _start_supernode(self, node: Node, superlink: str) -> None:
        config = {"zk0-node": str(self.settings(node)), "zk0-program": self.zk0}
        if node.lazy:
            config |= {"lazy": node.lazy, "stolen-proof": str(STOLEN_PROOF)}
        words = " ".join(f"{name}={json.dumps(value)}" for name, value in config.items())
        host, port = free_address().split(":")
        start = ["flower-supernode", "--insecure", "--superlink", superlink, "--host", host, "--port", port]
        self._process(node.name, [*start, "--node-config", words])


def main() -> None:
    """Runs the example, and checks what came of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="a new folder for the network, the logs and the results")
    parser.add_argument("--zk0", default=Program.path, help="the program [default: the installed one]")
    parser.add_argument("--rounds", type=int, default=1, help="run this many rounds [default: 1]")
    options = parser.parse_args()
    nodes = [Node(f"node-{number}", recording) for number, recording in enumerate(RECORDINGS, 1)]
    nodes[-1].lazy = "stolen-proof"
    # As in `zk0 demo`: fewer samples than a network should ask for, because each makes a proof longer.
    rules = {"min_eval_samples": 6, "confidence": "95%", "participation": {"present": {"min_nodes": 3, "fraction_bps": 0}}}
    with Federation(options.out.resolve(), options.zk0, nodes, rules=rules) as federation:
        outcomes = federation.run(options.rounds)
        federation.program("audit", "replay", federation.log, "--network", federation.network)
    print(json.dumps(outcomes, indent=2))
    for outcome in outcomes:
        if len(outcome["contributors"]) != 2 or len(outcome["left_out"]) != 1:
            sys.exit("the two honest nodes should have contributed, and the lazy one should have been left out")


if __name__ == "__main__":
    main()
