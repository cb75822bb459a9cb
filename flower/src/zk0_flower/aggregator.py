"""What the zk0 aggregator says of its rounds. Nothing here is believed of a contribution: the ledger decides that."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from logging import WARNING

from flwr.common.logger import log

from zk0_flower.program import Program, ProgramError

POLL_SECONDS = 1.0
"""How often the aggregator is asked how far a round is."""

PATIENCE_SECONDS = 300.0
"""How long the aggregator may be away before a round that goes on is given up."""


class NoMoreRounds(RuntimeError):
    """The aggregator has opened as many rounds as its operator wants."""


@dataclass(frozen=True)
class Status:
    """How far an aggregator is."""

    round: int
    """The open round, or the next one."""
    phase: str
    """``waiting``, ``committing``, ``drawing``, ``submitting`` or ``closing``."""
    seconds_left: float | None
    """Until the phase ends at the latest; `None` where that is not known."""
    committed: int
    """How many nodes have committed in the open round."""
    rounds: int | None
    """How many rounds the aggregator runs in all; `None` for no limit."""

    @property
    def has_commitments(self) -> bool:
        """Whether the commitments of the open round are closed, and there are some."""
        return self.phase in ("drawing", "submitting", "closing") and self.committed > 0

    def takes_commitments(self, number: int) -> bool:
        """Whether nodes can commit in this round, now or later."""
        return self.round < number or (self.round == number and self.phase in ("waiting", "committing"))


@dataclass(frozen=True)
class Aggregator:
    """An aggregator of one network."""

    program: Program
    address: str
    network: str
    ca: str | None = None

    def status(self) -> Status:
        """Asks the aggregator. Raises `ProgramError` if it does not answer, or if it is of another network."""
        trust = ["--ca", self.ca] if self.ca else []
        network = ["--aggregator", self.address, "--network", self.network]
        said = self.program.json("status", *network, *trust, "--json")
        deadline = said["deadline_ms"]
        return Status(
            round=said["round"],
            phase=said["phase"],
            seconds_left=None if deadline is None else max(0.0, (deadline - said["now_ms"]) / 1000),
            committed=said["committed"],
            rounds=said["rounds"],
        )

    def wait(self, until: Callable[[Status], bool]) -> Status:
        """Asks until the answer is as wanted, and returns it.

        Raises `ProgramError` if the aggregator has been away for longer than `PATIENCE_SECONDS`.
        """
        answered = time.monotonic()
        while True:
            try:
                status = self.status()
            except ProgramError as error:
                if time.monotonic() - answered > PATIENCE_SECONDS:
                    raise
                log(WARNING, "zk0: the aggregator is asked again: %s", error)
            else:
                answered = time.monotonic()
                if until(status):
                    return status
            time.sleep(POLL_SECONDS)

    def next_round(self) -> int:
        """Waits until nodes can commit in a round, now or as soon as it opens, and returns its number.

        Raises `NoMoreRounds` if the aggregator opens no further one.
        """
        first = self.status()
        status = first if first.takes_commitments(first.round) else self.wait(lambda now: now.takes_commitments(now.round))
        if status.rounds is not None and status.round >= status.rounds:
            raise NoMoreRounds(
                f"the aggregator has opened all of its {status.rounds} rounds: start it with a larger --rounds, or without it"
            )
        return status.round
