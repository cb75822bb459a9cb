"""The strategy for Flower's ServerApp."""

import time
from collections.abc import Iterable
from logging import INFO, WARNING
from pathlib import Path

from flwr.app import ArrayRecord, ConfigRecord, Message, MetricRecord
from flwr.common.logger import log
from flwr.serverapp import Grid
from flwr.serverapp.strategy import Strategy

from zk0_flower import weights
from zk0_flower.aggregator import POLL_SECONDS, Aggregator
from zk0_flower.ledger import Ledger, LedgerRound, NotVerified
from zk0_flower.messages import COMMIT, PROVE, Request
from zk0_flower.outcome import RoundOutcome, claims, committed, errors, judged
from zk0_flower.program import Program

LATE_SECONDS = 15.0
"""How long to wait for further replies when the commitments of a round are closed."""

DECIDING_SECONDS = 120.0
"""How long a node may wait for the decision on its claim after the last moment for submissions, and how long an entry may take until it is on
the served log."""


class OtherWeights(ValueError):
    """The arrays that a round should start from are not those of the ledger."""


class Zk0Strategy(Strategy):
    """Takes proven contributions only, and records them on a zk0 ledger.

    One Flower round is one zk0 round. `configure_train` has the nodes *commit* to their updates, waits for the *challenge*, and asks those that
    have committed for the *proof*. `aggregate_train` waits until the aggregator has closed the round, audits the ledger, and returns the global
    weights that the audit has verified. Nothing that a node replies is averaged.
    """

    def __init__(
        self,
        *,
        aggregator: str,
        log_address: str,
        network: str,
        folder: Path | str,
        program: str = Program.path,
        ca: str | None = None,
        min_nodes: int = 1,
        commit_seconds: float = 3600.0,
        evaluation: Strategy | None = None,
    ) -> None:
        """Makes a strategy for one network.

        Args:
            aggregator: The aggregator's address, such as ``https://aggregator.example:7071``.
            log_address: Where it serves its log, which the nodes read, too.
            network: The network's id, from somebody you trust. No other network is accepted.
            folder: Where the mirror of the ledger is kept, so that each audit reads only what is new.
            program: The file of the program ``zk0``, if another one than the installed is meant.
            ca: A PEM file of the authority that has signed the certificate of aggregator and log, if the system does not trust it.
            min_nodes: Begin when so many SuperNodes are connected.
            commit_seconds: How long nodes may take at most to prepare their recordings, to train and to commit.
            evaluation: The strategy that configures and aggregates Flower's evaluation. Without it, nodes evaluate nothing.
        """
        zk0 = Program(program)
        self.aggregator = Aggregator(zk0, aggregator, network, ca)
        self.ledger = Ledger(zk0, log_address, network, Path(folder), ca)
        self.min_nodes = min_nodes
        self.commit_seconds = commit_seconds
        self.evaluation = evaluation
        self.outcomes: list[RoundOutcome] = []
        """What came of the rounds so far."""
        self._arrays: ArrayRecord | None = None
        self._round: LedgerRound | None = None
        self._members: dict[int, str] = {}
        self._reasons: dict[int, str] = {}

    def summary(self) -> None:
        """Logs what the strategy does."""
        log(INFO, "\t├──> zk0 network %s", self.ledger.network)
        log(INFO, "\t├──> Aggregator %s, log %s", self.aggregator.address, self.ledger.address)
        log(INFO, "\t└──> Only contributions are taken that the audit of the ledger has verified")

    def initial_arrays(self) -> ArrayRecord:
        """The network's global weights: those that the last closed round ended with, or the initial ones.

        Raises `NotVerified` if the ledger does not pass its audit, and `ProgramError` if it cannot be read.
        """
        self.ledger.audit()
        self._arrays = weights.read(self.ledger.blob(self.ledger.weights_in_force()))
        return self._arrays

    def configure_train(self, server_round: int, arrays: ArrayRecord, config: ConfigRecord, grid: Grid) -> Iterable[Message]:
        """Has the nodes commit, waits for the challenge, and returns the requests for proofs.

        Raises `OtherWeights` if ``arrays`` are not the ledger's, `ProgramError` if the aggregator does not answer, and `NoMoreRounds` if it opens
        no further round.
        """
        if arrays != (self.initial_arrays() if self._arrays is None else self._arrays):
            raise OtherWeights(
                "the rounds of this network start from the weights on its ledger: "
                "start the strategy with initial_arrays=strategy.initial_arrays()"
            )
        first = self.aggregator.next_round()
        asked = self._connected(grid)
        log(INFO, "zk0: round %d, commitments: %d nodes are asked", first, len(asked))
        request = self._request(first, self.commit_seconds)
        replies = self._until_committed(grid, [request.message(node, COMMIT) for node in asked])
        said, silent = claims(asked, replies)
        self.ledger.audit()
        rounds = {
            number: self.ledger.round(number)
            for number in {reply.round for reply in said.values()}
            if first <= number < self.ledger.opened()
        }
        self._round, self._members, untrue = committed(said, rounds)
        self._reasons = silent | untrue
        if self._round is None:
            return []
        return self._requests_for_proofs(self._round.number)

    def aggregate_train(self, server_round: int, replies: Iterable[Message]) -> tuple[ArrayRecord | None, MetricRecord | None]:
        """Waits until the round has closed, and returns the global weights and what is proven of them.

        If nothing was accepted, these are the weights that the round started from. Raises `NotVerified` if the ledger does not pass its audit.
        """
        if self._round is not None:
            self._round = self._closed(self._round.number)
        outcome = judged(server_round, self._round, self._members, self._reasons, errors(replies))
        self.outcomes.append(outcome)
        self._tell(outcome)
        if self._round is None:
            return self._arrays, None
        if self._round.result is not None:
            self._arrays = weights.read(self.ledger.blob(self._round.result))
        return self._arrays, metrics(self._round, len(outcome.left_out))

    def configure_evaluate(self, server_round: int, arrays: ArrayRecord, config: ConfigRecord, grid: Grid) -> Iterable[Message]:
        """Returns the messages of the strategy for the evaluation, without those to nodes that were left out of the round."""
        if self.evaluation is None:
            return []
        messages = self.evaluation.configure_evaluate(server_round, arrays, config, grid)
        left_out = {left.node for left in self.outcomes[-1].left_out}
        return [message for message in messages if message.metadata.dst_node_id not in left_out]

    def aggregate_evaluate(self, server_round: int, replies: Iterable[Message]) -> MetricRecord | None:
        """Returns what the strategy for the evaluation makes of the replies. These metrics are not proven."""
        if self.evaluation is None:
            return None
        return self.evaluation.aggregate_evaluate(server_round, replies)

    def _request(self, number: int, seconds: float) -> Request:
        return Request(self.ledger.network, self.ledger.address, number, float(seconds))

    def _connected(self, grid: Grid) -> list[int]:
        """Waits until enough nodes are connected, and returns all that are."""
        told = False
        while len(nodes := list(grid.get_node_ids())) < self.min_nodes:
            if not told:
                log(INFO, "zk0: %d of %d nodes are connected", len(nodes), self.min_nodes)
                told = True
            time.sleep(POLL_SECONDS)
        return nodes

    def _until_committed(self, grid: Grid, messages: list[Message]) -> list[Message]:
        """Sends requests for commitments, and returns the replies that come before the round goes on. A node that does not reply holds up
        nobody.
        """
        open_ids = set(grid.push_messages(messages))
        replies: list[Message] = []
        end = time.monotonic() + self.commit_seconds
        closed = False
        while open_ids and time.monotonic() < end:
            come = list(grid.pull_messages(open_ids))
            replies += come
            open_ids -= {reply.metadata.reply_to_message_id for reply in come}
            if not closed and self.aggregator.wait(lambda _: True).has_commitments:
                closed = True
                end = min(end, time.monotonic() + LATE_SECONDS)
            time.sleep(POLL_SECONDS)
        return replies

    def _requests_for_proofs(self, number: int) -> list[Message]:
        """Waits for the challenge of a round, and returns the requests for proofs. There are none if the round has closed before."""
        log(INFO, "zk0: round %d, challenge: %d nodes have committed", number, len(self._members))
        status = self.aggregator.wait(lambda now: now.round > number or now.phase == "submitting")
        if status.round > number:
            return []
        log(INFO, "zk0: round %d, proofs: the challenge is drawn", number)
        seconds = (status.seconds_left or 0.0) + DECIDING_SECONDS
        request = self._request(number, seconds)
        return [request.message(node, PROVE) for node in self._members]

    def _closed(self, number: int) -> LedgerRound:
        """Waits until a round has closed, and returns it as the audited ledger has it.

        Raises `NotVerified` if the log does not show within `DECIDING_SECONDS` that it has closed.
        """
        self.aggregator.wait(lambda now: now.round > number)
        end = time.monotonic() + DECIDING_SECONDS
        while True:
            self.ledger.audit()
            found = self.ledger.round(number)
            if found.result is not None:
                return found
            # The aggregator publishes an entry after it has recorded it.
            if time.monotonic() > end:
                raise NotVerified(f"the aggregator says that round {number} has closed, and its log does not show that")
            time.sleep(POLL_SECONDS)

    def _tell(self, outcome: RoundOutcome) -> None:
        for identity, node in outcome.contributors.items():
            where = "a node outside of Flower" if node is None else f"Flower node {node}"
            log(INFO, "zk0: accepted: the contribution of node %s (%s)", identity, where)
        for left in outcome.left_out:
            log(WARNING, "zk0: left out: Flower node %d: %s", left.node, left.reason)
        if outcome.ledger_round is None:
            log(WARNING, "zk0: no node has committed, so the global weights stay")
        elif not outcome.contributors:
            log(WARNING, "zk0: nothing was proven, so the global weights stay")
        elif outcome.ledger_round.verdict:
            log(INFO, "zk0: on the public samples: %s", outcome.ledger_round.verdict)


def metrics(known: LedgerRound, left_out: int) -> MetricRecord:
    """What the ledger says of a round that has closed, and how many Flower nodes were left out, as Flower's metrics."""
    said = MetricRecord(
        {
            "zk0-round": known.number,
            "committed": len(known.committed),
            "accepted": len(known.accepted),
            "refused": len(known.refused),
            "left-out": left_out,
        }
    )
    if known.losses is not None:
        said["proven-loss-before"] = known.losses.before
        said["proven-loss-after"] = known.losses.after
    return said
