"""What the strategy and the nodes say to each other. Weights and proofs never travel by Flower: nodes exchange them with the aggregator."""

from dataclasses import dataclass
from typing import Self, TypeVar

from flwr.app import ConfigRecord, Message, RecordDict

KEY = "zk0"
"""Under this key, the record of each message has what is said here."""

COMMIT = "train.commit"
"""The message that asks a node to train and to commit to its update."""

PROVE = "train.prove"
"""The message that asks a node to prove its claim for the challenge, and to submit it."""


_Value = TypeVar("_Value", str, int, float)


class MalformedMessage(ValueError):
    """A message does not say what it has to say."""


@dataclass(frozen=True)
class Request:
    """Asks a node to take part in a round."""

    network: str
    """The network's id. The node takes part in no other network than its own settings name."""
    log: str
    """The address of the served log."""
    round: int
    """The round, or the first one that is meant where nodes are to commit."""
    seconds: float
    """How long the node may take."""

    def message(self, node: int, kind: str) -> Message:
        """The message to a Flower node. It lives a minute longer than the node may take."""
        return Message(
            content=_record(**vars(self)),
            dst_node_id=node,
            message_type=kind,
            ttl=self.seconds + 60,
        )

    @classmethod
    def read(cls, message: Message) -> Self:
        """Reads a message. Raises `MalformedMessage`."""
        said = _said(message)
        return cls(
            network=_of_type(said, "network", str),
            log=_of_type(said, "log", str),
            round=_of_type(said, "round", int),
            seconds=_of_type(said, "seconds", float),
        )


@dataclass(frozen=True)
class Reply:
    """What a node says of itself. The strategy looks on the ledger whether it is true."""

    identity: str
    """The node's identity in the zk0 network: its public key, in hexadecimal digits."""
    round: int
    """The round in which it has committed."""

    def message(self, request: Message) -> Message:
        """The message that answers ``request``."""
        return Message(content=_record(**vars(self)), reply_to=request)

    @classmethod
    def read(cls, message: Message) -> Self:
        """Reads a message. Raises `MalformedMessage`."""
        said = _said(message)
        return cls(
            identity=_of_type(said, "identity", str),
            round=_of_type(said, "round", int),
        )


def _record(**said: str | int | float) -> RecordDict:
    return RecordDict({KEY: ConfigRecord(dict(said))})


def _said(message: Message) -> ConfigRecord:
    said = message.content.config_records.get(KEY)
    if said is None:
        raise MalformedMessage(f"the message has no record `{KEY}`")
    return said


def _of_type(said: ConfigRecord, name: str, kind: type[_Value]) -> _Value:
    value = said.get(name)
    if not isinstance(value, kind) or isinstance(value, bool):
        raise MalformedMessage(f"`{name}` of the record `{KEY}` is {value!r} instead of a value of type {kind.__name__}")
    return value
