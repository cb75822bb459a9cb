"""A node's side of a round. The program ``zk0 node join`` plays it, and is stopped between the phases: a node that is started again in the same
round goes on where it was.
"""

import os
import subprocess
import time
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from zk0_flower.left_behind import the_only_one
from zk0_flower.messages import Reply, Request
from zk0_flower.program import Program, ProgramError, last_words, not_started

POLL_SECONDS = 0.5
"""How often a running node is looked at."""

STOP_SECONDS = 30.0
"""How long a node may take to end when it is told to."""


class BadSettings(ValueError):
    """The settings of a node do not fit."""


class NodeFailed(RuntimeError):
    """The node did not do what it was asked for. The message says why."""


@dataclass(frozen=True)
class Member:
    """A node of a zk0 network."""

    program: Program
    command: tuple[str, ...]
    """The arguments of the program that take part in rounds, such as ``node join --config FILE``."""
    network: str
    """The network's id, as the node's operator knows it."""
    state: Path
    """The node's state folder. It holds the receipts of whatever the node has put on the ledger."""
    ca: str | None = None

    @classmethod
    def of_settings(cls, file: Path, program: Program) -> "Member":
        """The node of a settings file of ``zk0 node join``. Raises `BadSettings` if the file cannot be used."""
        try:
            settings: dict[str, Any] = tomllib.loads(file.read_text())
        except OSError as error:
            raise BadSettings(f"the settings {file} cannot be read: {error.strerror}") from error
        except tomllib.TOMLDecodeError as error:
            raise BadSettings(f"the settings {file} are not TOML: {error}") from error
        for name in ("network", "state"):
            if not isinstance(settings.get(name), str):
                raise BadSettings(f"the settings {file} do not say `{name}`")
        network = settings["network"]
        return cls(
            program=program,
            # A variable of the environment counts before the file, so the network is named once more.
            command=("node", "join", "--config", str(file), "--network", network),
            network=network,
            state=Path(settings["state"]),
            ca=settings.get("ca"),
        )

    def commit(self, request: Request) -> Reply:
        """Trains, and commits to the update. The node has stopped when this returns.

        Raises `BadSettings` if another network is meant, `ProgramError` if the program cannot be started, and `NodeFailed` if the node ends
        or its time is over before it has committed.
        """
        self._check_network(request)
        started = time.time() - 1
        seen: set[Path] = set()
        with self._running() as node:
            for _ in _until(request.seconds):
                # The node may have committed and ended since the receipts were looked at.
                ended = node.poll() is not None
                reply = self._commitment(request, started, seen)
                if reply:
                    return reply
                if ended:
                    raise NodeFailed(f"the node ended without a commitment: {self._last_words()}")
        raise NodeFailed(f"the node did not commit within {request.seconds:.0f} seconds; the last it said: {self._last_words()}")

    def prove(self, request: Request) -> None:
        """Proves the claim of the round in which the node has committed, and submits it. Returns when the round has closed.

        Raises `BadSettings` if another network is meant, `ProgramError` if the program cannot be started, and `NodeFailed` if the node fails,
        has no proof in time, or its time is over. Only the ledger says whether a contribution was accepted.
        """
        self._check_network(request)
        with self._running() as node:
            for _ in _until(request.seconds):
                code = node.poll()
                if code == 0:
                    if reason := self._no_proof():
                        raise NodeFailed(reason)
                    return
                if code is not None:
                    raise NodeFailed(f"the node ended with exit code {code}: {self._last_words()}")
        raise NodeFailed(
            f"round {request.round} did not close within {request.seconds:.0f} seconds; the last the node said: {self._last_words()}"
        )

    def _check_network(self, request: Request) -> None:
        if request.network != self.network:
            raise BadSettings(
                f"the ServerApp asks for a round of network {request.network}, and this node's settings name network {self.network}"
            )

    def _commitment(self, request: Request, started: float, seen: set[Path]) -> Reply | None:
        """The node's commitment, if a receipt of it was kept since ``started`` and the entry is on the served log."""
        for receipt in self.state.glob("receipts/entry-*.tlog-proof"):
            if receipt in seen or receipt.stat().st_mtime < started:
                continue
            index = receipt.name.removeprefix("entry-").removesuffix(".tlog-proof")
            trust = ["--network", self.network, *(["--ca", self.ca] if self.ca else [])]
            try:
                entry = self.program.json("audit", "show", request.log, index, *trust, "--json")
            except ProgramError:
                # The aggregator publishes an entry after it has given out the receipt.
                continue
            seen.add(receipt)
            if entry["kind"] == "commitment" and entry["round"] >= request.round:
                return Reply(identity=entry["nodes"][0], round=entry["round"])
        return None

    @property
    def _log(self) -> Path:
        return self.state / "flower.log"

    @contextmanager
    def _running(self) -> Iterator[subprocess.Popen[bytes]]:
        """Runs the node for one round. It is stopped at the end. What it says goes to ``flower.log`` in its state folder."""
        self.state.mkdir(parents=True, exist_ok=True)
        with self._log.open("wb") as said, the_only_one(self.state / "flower.lock") as lock:
            try:
                node = subprocess.Popen(
                    [self.program.path, *self.command, "--rounds", "1"],
                    stdin=subprocess.DEVNULL,
                    stdout=said,
                    stderr=said,
                    # The last line becomes a reason that others read.
                    env=os.environ | {"NO_COLOR": "1"},
                    pass_fds=[lock.fileno()],
                )
            except OSError as error:
                raise not_started(self.program.path, error) from error
            lock.write(str(node.pid))
            lock.flush()
            try:
                yield node
            finally:
                node.terminate()
                try:
                    node.wait(STOP_SECONDS)
                except subprocess.TimeoutExpired:
                    node.kill()
                    node.wait()

    def _no_proof(self) -> str | None:
        """Why the node had no proof in time, if it says so. It ends well all the same, when its round has closed."""
        for line in self._log.read_text(errors="replace").splitlines():
            if (at := line.find("the node has no proof in time")) >= 0:
                return line[at:]
        return None

    def _last_words(self) -> str:
        return last_words(self._log.read_text(errors="replace"))


def _until(seconds: float) -> Iterator[None]:
    """Yields again and again, until the time is over."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        yield
        time.sleep(POLL_SECONDS)
