"""Flower federations whose updates count only if they are proven.

A zk0 aggregator runs beside the SuperLink and keeps the ledger. `Zk0Strategy` goes in the ServerApp, and `client_app` makes the ClientApp of
the nodes. A short tour:

- `strategy`: one Flower round is one zk0 round with its phases commit, challenge and proof.
- `commitments`, `outcome`: which Flower node stands for which contribution, and who is left out, with the reason.
- `member`, `client`: a node's side. They run ``zk0 node join``. `left_behind`: what becomes of it when Flower kills the ClientApp.
- `messages`: what the strategy and the nodes say to each other. `flower_release`: which releases of Flower will do.
- `aggregator`, `ledger`, `weights`: what the aggregator says, and what the audited ledger says.
- `program`: runs the program ``zk0``, which decides everything: nothing is verified in Python.
"""

from zk0_flower.flower_release import check_installed

check_installed()

# Flower may be imported only after its release is checked.
from zk0_flower.client import client_app, member_of  # noqa: E402
from zk0_flower.ledger import NotVerified  # noqa: E402
from zk0_flower.member import Member  # noqa: E402
from zk0_flower.outcome import LeftOut, RoundOutcome  # noqa: E402
from zk0_flower.program import Program, ProgramError  # noqa: E402
from zk0_flower.strategy import Zk0Strategy  # noqa: E402

__all__ = [
    "LeftOut",
    "Member",
    "NotVerified",
    "Program",
    "ProgramError",
    "RoundOutcome",
    "Zk0Strategy",
    "client_app",
    "member_of",
]
