"""The ClientApp. Every SuperNode gets the same app; in this example, the configuration of a SuperNode can make it a lazy one."""

import tomllib
from dataclasses import replace
from pathlib import Path

from flwr.app import Context

from zk0_flower import Member, client_app, member_of
from zk0_flower.messages import Reply, Request


class Idle(Member):
    """A node that does nothing, and says that it has."""

    def commit(self, request: Request) -> Reply:
        """Replies at once with an invented identity."""
        return Reply(identity="00" * 32, round=request.round)


def member(context: Context) -> Member:
    """The node of this SuperNode: an honest one, unless the configuration says `lazy`.

    - `lazy="stolen-proof"`: the node commits to the base weights, and submits the proof of another claim, the file `stolen-proof`;
    - `lazy="idle"`: the node only says that it has committed.
    """
    node = member_of(context)
    match context.node_config.get("lazy"):
        case None:
            return node
        case "idle":
            return Idle(**vars(node))
        case "stolen-proof":
            settings = tomllib.loads(Path(str(context.node_config["zk0-node"])).read_text())
            given = [word for name in ("aggregator", "network", "key", "dataset", "state") for word in (f"--{name}", settings[name])]
            stolen = str(context.node_config["stolen-proof"])
            return replace(node, command=("demo-lazy-node", *given, "--stolen-proof", stolen))
        case other:
            raise ValueError(f"lazy is {other!r}; it can be 'idle' or 'stolen-proof'")


app = client_app(member)
