"""What is on a network's ledger. Each look at it is an audit: ``zk0 audit replay`` verifies all signatures, proofs, refusals and averages first."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from zk0_flower.program import Program


class NotVerified(RuntimeError):
    """The audit of a ledger found something wrong, or could not check something. Nothing of such a ledger is used."""


@dataclass(frozen=True)
class Losses:
    """The mean losses of a round's accepted claims, as their proofs show them."""

    before: float
    after: float


@dataclass(frozen=True)
class LedgerRound:
    """A round, as the ledger has it. Nodes are named by their identities: public keys, in hexadecimal digits."""

    number: int
    base: str
    """SHA-256 of the weights that the round starts from."""
    committed: frozenset[str]
    """The nodes that committed to an update."""
    accepted: frozenset[str]
    """The nodes whose contributions were accepted."""
    refused: Mapping[str, str]
    """The nodes whose contributions were refused, with what the ledger says of each."""
    result: str | None
    """SHA-256 of the global weights that the round ended with; `None` while it is open."""
    losses: Losses | None
    """`None` where nothing was accepted, and where the network's rules hide losses."""
    verdict: str | None
    """What the evaluation on public samples came to; `None` where the network has none, or while the round is open."""


@dataclass(frozen=True)
class Ledger:
    """A network's ledger, mirrored from its served log."""

    program: Program
    address: str
    """Where the log is served (``zk0 aggregator serve --log-listen``)."""
    network: str
    folder: Path
    """Where the mirror and the state of the audit are kept, so that each audit reads only what is new."""
    ca: str | None = None

    @property
    def _mirror(self) -> Path:
        return self.folder / "mirror"

    def audit(self) -> None:
        """Brings the mirror up to date, and audits it.

        Raises `NotVerified` if the verdict is not VERIFIED, and `ProgramError` if the log cannot be read.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        trust = ["--network", self.network, *(["--ca", self.ca] if self.ca else [])]
        kept = [
            "--mirror",
            str(self._mirror),
            "--state",
            str(self.folder / "audit-state"),
        ]
        report = self.program.json("audit", "replay", self.address, *trust, *kept, "--json", codes=(0, 1, 3))
        if report["verdict"] != "verified":
            reasons = [finding["text"] for finding in report["findings"]]
            reasons += [str(what) for what in report["not_checked"]]
            raise NotVerified(
                f"the ledger at {self.address} is not used, because its audit says {report['verdict'].upper()}: "
                + ("; ".join(reasons) or "it gives no reason")
            )

    def round(self, number: int) -> LedgerRound:
        """A round as of the last audit. Raises `ProgramError` if there is no such round."""
        said = self._show("--round", str(number))
        return read_round(number, said)

    def opened(self) -> int:
        """How many rounds have been opened, as of the last audit. They are counted from 0."""
        return len(self._show()["rounds"])

    def weights_in_force(self) -> str:
        """SHA-256 of the global weights as of the last audit: those that the last closed round ended with, or the initial ones."""
        closed = [known["global"] for known in self._show()["rounds"] if known["global"]]
        if closed:
            return str(closed[-1])
        return detail(self._show("0"), "initial weights")

    def blob(self, digest: str) -> Path:
        """The file of weights with this SHA-256."""
        return self._mirror / "blobs" / "sha256" / digest

    def _show(self, *what: str) -> Any:
        return self.program.json("audit", "show", str(self._mirror), *what, "--json")


def read_round(number: int, said: Mapping[str, Any]) -> LedgerRound:
    """Reads what ``zk0 audit show --round --json`` says."""
    entries, known = said["entries"], said["round"]
    of = {
        kind: {node: entry["states"] for entry in entries if entry["kind"] == kind for node in entry["nodes"]}
        for kind in ("commitment", "accepted", "refused")
    }
    opened = next(entry for entry in entries if entry["kind"] == "round opened")
    losses, public = known["losses"], known["public"]
    return LedgerRound(
        number=number,
        base=detail(opened, "base weights"),
        committed=frozenset(of["commitment"]),
        accepted=frozenset(of["accepted"]),
        refused=of["refused"],
        result=known["global"],
        losses=losses and Losses(losses["before"], losses["after"]),
        verdict=public and public["outcome"],
    )


def detail(entry: Mapping[str, Any], label: str) -> str:
    """What an entry says under this label."""
    return next(str(found["value"]) for found in entry["details"] if found["label"] == label)
