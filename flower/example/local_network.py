"""A zk0 network on this machine: an aggregator, and the keys and settings of its nodes."""

import json
import socket
import subprocess
import time
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

FIXTURES = Path(__file__).resolve().parents[2] / "tests" / "fixtures"
RECORDINGS = [FIXTURES / "datasets" / name for name in ("so100_pickplace", "so100_stacking", "so100_sorting_two")]

START_SECONDS = 900
"""How long a service may take to listen. The proving service takes minutes on a small machine."""


@dataclass
class Node:
    """A node, and whether its SuperNode is a lazy one."""

    name: str
    recording: Path
    lazy: str | None = None


@dataclass
class Network:
    """A zk0 network. Its processes end with the `with` block."""

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
    rounds: int | None = None
    """How many rounds the aggregator opens; by default there is no limit."""
    environment: dict[str, str] | None = None
    """The environment of the processes; by default that of this one."""

    def __post_init__(self) -> None:
        self._stack = ExitStack()

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

    def program(self, *arguments: str | Path) -> str:
        """Returns what `zk0` prints."""
        done = subprocess.run([self.zk0, *map(str, arguments)], stdout=subprocess.PIPE, text=True, check=True)
        return done.stdout

    def settings(self, node: Node) -> Path:
        """The settings file of a node."""
        return self.out / node.name / "node.toml"

    def _start(self) -> None:
        if self.prover is None:
            self.prover = f"http://{self._listens('prover', [self.zk0, 'prover', 'serve'])}"
        self._found()
        log = free_address()
        serve = [self.zk0, "aggregator", "serve", str(self.out / "ledger"), "--key", str(self.out / "log.key")]
        serve += ["--min-nodes", str(self.members), "--log-listen", log]
        serve += [] if self.rounds is None else ["--rounds", str(self.rounds)]
        self.log = f"http://{log}"
        self.aggregator = f"http://{self._listens('aggregator', serve)}"
        for node in self.nodes:
            self._write_settings(node)

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
        self.program(*ledger, "--rules", self.out / "rules.json", "--rules-never-change", *enrol)
        self.network = json.loads(self.program("audit", "show", self.out / "ledger", "--json"))["network"]["id"]

    def _write_settings(self, node: Node) -> None:
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
        self.settings(node).write_text("\n".join([*lines, "steps = 800", "learning-rate = 0.001", ""]))

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
