"""What the tests share: the program, the committed ledger as a served log, and small networks."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from full_queue import FullProver
from local_network import RECORDINGS, Network, Node
from served_log import fixture_copy, serving

from zk0_flower import Program
from zk0_flower.ledger import Ledger


@pytest.fixture(scope="session")
def zk0() -> str:
    """The program. It is an error if it is not built."""
    target = os.environ.get("CARGO_TARGET_DIR", str(Path.home() / ".cache/zk0/target"))
    path = Path(os.environ.get("ZK0", f"{target}/release/zk0"))
    assert path.exists(), f"{path} does not exist: run `make build`, or name the program by the variable ZK0"
    return str(path)


@pytest.fixture(scope="session")
def prover() -> Iterator[str]:
    """The address of a proving service that has no room."""
    with FullProver() as full:
        yield full.address


@pytest.fixture(scope="session")
def network(zk0: str, prover: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Network]:
    """A network of one node, whose aggregator opens one round."""
    out = tmp_path_factory.mktemp("network") / "out"
    nodes = [Node("node", RECORDINGS[0])]
    with Network(out, zk0, nodes, prover, {"submit_window_ms": 5000}, members=1, rounds=1) as network:
        yield network


@pytest.fixture
def ledger(zk0: str, tmp_path: Path) -> Iterator[Ledger]:
    """The committed ledger, served as a log and audited once. Its round has two proven contributions and a refused one."""
    copy = fixture_copy(tmp_path / "ledger")
    program = Program(zk0)
    network = program.json("audit", "show", str(copy), "--json")["network"]["id"]
    with serving(zk0, copy) as address:
        ledger = Ledger(program, address, network, tmp_path / "mirror")
        ledger.audit()
        yield ledger
