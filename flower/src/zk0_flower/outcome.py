"""Which Flower node stands for which contribution. A node's reply only says who it is; the ledger says what it did."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from flwr.app import Message

from zk0_flower.ledger import LedgerRound
from zk0_flower.messages import MalformedMessage, Reply

NO_REPLY = "it did not reply in time"


@dataclass(frozen=True)
class LeftOut:
    """A Flower node that nothing was taken from in a round."""

    node: int
    """Its number in Flower."""
    identity: str | None
    """Who it is in the zk0 network, if it has shown a commitment."""
    reason: str


@dataclass(frozen=True)
class RoundOutcome:
    """What came of a round."""

    server_round: int
    """Flower's number of the round, counted from 1."""
    ledger_round: LedgerRound | None
    """The round on the ledger; `None` if no node has committed."""
    contributors: Mapping[str, int | None]
    """The identities of the nodes whose contributions were accepted, with their numbers in Flower. A node that takes part in the zk0 network
    without Flower has none."""
    left_out: tuple[LeftOut, ...]


def errors(replies: Iterable[Message]) -> dict[int, str]:
    """What the nodes said that replied with an error."""
    failed = (reply for reply in replies if reply.has_error())
    return {reply.metadata.src_node_id: f"it failed: {reply.error.reason}" for reply in failed}


def claims(asked: Iterable[int], replies: Iterable[Message]) -> tuple[dict[int, Reply], dict[int, str]]:
    """Who the asked nodes say they are, and for the others why they say nothing."""
    said: dict[int, Reply] = {}
    silent = dict.fromkeys(asked, NO_REPLY) | errors(replies := list(replies))
    for reply in replies:
        node = reply.metadata.src_node_id
        if not reply.has_error():
            try:
                said[node] = Reply.read(reply)
                silent.pop(node, None)
            except MalformedMessage as error:
                silent[node] = f"it replied with something else than its commitment: {error}"
    return said, silent


def committed(said: Mapping[int, Reply], rounds: Mapping[int, LedgerRound]) -> tuple[LedgerRound | None, dict[int, str], dict[int, str]]:
    """Compares what nodes say with the rounds that are meant, as they are on the ledger.

    Returns the last round in which one of the nodes has committed, the identities of the nodes that have committed in it, and the reasons for
    which the others are left out.
    """
    true = {node: reply for node, reply in said.items() if reply.round in rounds and reply.identity in rounds[reply.round].committed}
    number = max((reply.round for reply in true.values()), default=None)
    members = {node: reply.identity for node, reply in true.items() if reply.round == number}
    reasons = {
        node: f"it says that it is node {reply.identity} and has committed in round {reply.round}, and the ledger has no such commitment"
        if node not in true
        else f"it has committed in round {reply.round}, and the others in round {number}"
        for node, reply in said.items()
        if node not in members
    }
    return (None if number is None else rounds[number]), members, reasons


def judged(
    server_round: int,
    ledger_round: LedgerRound | None,
    members: Mapping[int, str],
    reasons: Mapping[int, str],
    failed: Mapping[int, str],
) -> RoundOutcome:
    """What came of a round. ``members`` have committed in it, ``reasons`` say why others did not, and ``failed`` is what members said that
    could not prove.
    """
    left_out = [LeftOut(node, None, reason) for node, reason in reasons.items()]
    accepted = ledger_round.accepted if ledger_round else frozenset()
    contributors: dict[str, int | None] = dict.fromkeys(sorted(accepted))
    names = Counter(members.values())
    for node, identity in members.items():
        if names[identity] > 1:
            why = f"{names[identity]} Flower nodes say that they are node {identity}, and at most one of them is"
            left_out.append(LeftOut(node, identity, why))
        elif identity in accepted:
            contributors[identity] = node
        else:
            refused = ledger_round.refused.get(identity) if ledger_round else None
            silence = failed.get(node, "it said nothing about it")
            why = refused or f"it has committed and proven nothing in time; {silence}"
            left_out.append(LeftOut(node, identity, why))
    return RoundOutcome(server_round, ledger_round, contributors, tuple(left_out))
