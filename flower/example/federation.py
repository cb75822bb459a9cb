"""Runs the example: a zk0 network, and a SuperLink with three SuperNodes on this machine, two honest and one lazy.

    python flower/example/federation.py --out outputs/flower

The honest nodes prove for real, which takes 20 GiB of memory and minutes for each. The lazy node submits the base weights with a stolen proof.
"""

import argparse
import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

HERE = Path(__file__).resolve().parent
FIXTURES = HERE.parents[1] / "tests" / "fixtures"
RECORDINGS = [FIXTURES / "datasets" / name for name in ("so100_pickplace", "so100_stacking", "so100_sorting_two")]
STOLEN_PROOF = FIXTURES / "proof.bin"

START_SECONDS = 900
"""How long a service may take to listen. The proving service takes minutes on a small machine."""


@dataclass
class Node:
    """A SuperNode and its zk0 node."""

    name: str
    recording: Path
    lazy: str | None = None


@dataclass
class Federation:
    """A zk0 network and a Flower federation on this machine. All of it ends with the `with` block."""

    out: Path
    """A new folder for everything."""
    zk0: str
    """The program."""
    nodes: list[Node]
    prover: str | None = None
    """The address of the proving service; by default one is started."""
    rules: Mapping[str, Any] = field(default_factory=dict)
    """What differs from the rules of `zk0 aggregator rules`."""
    members: int = 3
    """How many nodes a round needs."""

    def __post_init__(self) -> None:
        self._stack = ExitStack()
        self.environment = os.environ | {
            "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")]),
            "FLWR_HOME": str(self.out / "flwr"),
            "FLWR_TELEMETRY_ENABLED": "0",
            "FLWR_DISABLE_UPDATE_CHECK": "1",
        }

    def __enter__(self) -> Self:
        self.out.mkdir(parents=True)
        try:
            self._start()
        except BaseException:
            self._stack.close()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._stack.close()

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

    def program(self, *arguments: str | Path) -> str:
        """Returns what `zk0` prints."""
        done = subprocess.run([self.zk0, *map(str, arguments)], stdout=subprocess.PIPE, text=True, check=True)
        return done.stdout

    def _start(self) -> None:
        if self.prover is None:
            self.prover = f"http://{self._listens('prover', [self.zk0, 'prover', 'serve'])}"
        self._found()
        log = free_address()
        serve = [self.zk0, "aggregator", "serve", str(self.out / "ledger"), "--key", str(self.out / "log.key")]
        serve += ["--min-nodes", str(self.members), "--log-listen", log]
        self.log = f"http://{log}"
        self.aggregator = f"http://{self._listens('aggregator', serve)}"
        self._start_flower()

    def _found(self) -> None:
        self.program("aggregator", "keygen", self.out / "log.key")
        enrol: list[str] = []
        for node in self.nodes:
            folder = self.out / node.name
            folder.mkdir()
            identity = self.program("node", "keygen", folder / "node.key").strip()
            enrol += ["--node", f"{node.name}={identity}"]
        rules = json.loads(self.program("aggregator", "rules")) | dict(self.rules)
        (self.out / "rules.json").write_text(json.dumps(rules))
        ledger = ["aggregator", "init", self.out / "ledger", "--name", "zk0-flower", "--key", self.out / "log.key"]
        self.program(*ledger, "--rules", self.out / "rules.json", *enrol)
        self.network = json.loads(self.program("audit", "show", self.out / "ledger", "--json"))["network"]["id"]

    def _start_flower(self) -> None:
        superlink = free_address()
        host, port = superlink.split(":")
        # This app's dependencies are installed already, where this script runs.
        self._process(
            "superlink", ["flower-superlink", "--insecure", "--disable-runtime-dependency-installation", "--host", host, "--port", port]
        )
        wait_for(superlink)
        home = self.out / "flwr"
        home.mkdir(exist_ok=True)
        (home / "config.toml").write_text(f'[superlink]\ndefault = "zk0"\n\n[superlink.zk0]\naddress = "{superlink}"\ninsecure = true\n')
        for node in self.nodes:
            self._start_supernode(node, superlink)

    def _start_supernode(self, node: Node, superlink: str) -> None:
        folder = self.out / node.name
        settings = {
            "aggregator": self.aggregator,
            "network": self.network,
            "key": str(folder / "node.key"),
            "dataset": str(node.recording),
            "state": str(folder / "state"),
            "prover": self.prover,
        }
        lines = [f"{name} = {json.dumps(value)}" for name, value in settings.items()]
        (folder / "node.toml").write_text("\n".join([*lines, "steps = 800", "learning-rate = 0.001", ""]))
        config = {"zk0-node": str(folder / "node.toml"), "zk0-program": self.zk0}
        if node.lazy:
            config |= {"lazy": node.lazy, "stolen-proof": str(STOLEN_PROOF)}
        words = " ".join(f"{name}={json.dumps(value)}" for name, value in config.items())
        host, port = free_address().split(":")
        supernode = ["flower-supernode", "--insecure", "--superlink", superlink, "--host", host, "--port", port]
        self._process(node.name, [*supernode, "--node-config", words])

    def _listens(self, name: str, command: list[str]) -> str:
        """Starts a service of zk0, and returns its address when it listens."""
        address = free_address()
        self._process(name, [*command, "--listen", address])
        wait_for(address)
        return address

    def _process(self, name: str, command: list[str]) -> None:
        """Starts a process. Its log goes to a file that has its name."""
        log = self._stack.enter_context((self.out / f"{name}.log").open("wb"))
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=self.environment)
        self._stack.callback(stop, process)


def stop(process: subprocess.Popen[bytes]) -> None:
    """Ends a process."""
    process.terminate()
    try:
        process.wait(20)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def free_address() -> str:
    """An address of this machine whose port is free now."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        host, port = listener.getsockname()
    return f"{host}:{port}"


def wait_for(address: str) -> None:
    """Waits until somebody listens. Raises `TimeoutError` if nobody does."""
    host, port = address.split(":")
    end = time.monotonic() + START_SECONDS
    while time.monotonic() < end:
        try:
            socket.create_connection((host, int(port)), timeout=5).close()
            return
        except OSError:
            time.sleep(0.2)
    raise TimeoutError(f"nobody listens on {address}: the logs say why")


def main() -> None:
    """Runs the example, and checks what came of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    target = os.environ.get("CARGO_TARGET_DIR", str(Path.home() / ".cache/zk0/target"))
    parser.add_argument("--out", type=Path, required=True, help="a new folder for the network, the logs and the results")
    parser.add_argument("--zk0", default=f"{target}/release/zk0", help="the program [default: that of `make build`]")
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
