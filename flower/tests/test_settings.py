"""What is wrong with releases, settings and addresses is said."""

from dataclasses import replace
from pathlib import Path

import pytest
from flwr.app import Array, ArrayRecord, ConfigRecord
from local_network import Network

from zk0_flower import Member, Program, ProgramError, Zk0Strategy
from zk0_flower.aggregator import Aggregator
from zk0_flower.flower_release import UnsupportedFlower, check
from zk0_flower.member import BadSettings, NodeFailed
from zk0_flower.messages import Request
from zk0_flower.strategy import OtherWeights


def strategy(network: Network, folder: Path) -> Zk0Strategy:
    return Zk0Strategy(aggregator=network.aggregator, log_address=network.log, network=network.network, folder=folder, program=network.zk0)


def member(network: Network) -> Member:
    return Member.of_settings(network.settings(network.nodes[0]), Program(network.zk0))


def request(network: Network, seconds: float = 60.0) -> Request:
    return Request(network.network, network.log, 0, seconds)


@pytest.mark.parametrize("installed", ["1.39.1", "1.9.0", "0.20"])
def test_flower_may_be_too_old(installed: str) -> None:
    with pytest.raises(UnsupportedFlower, match=rf"needs flwr 1.40 or later, and flwr {installed} is installed"):
        check(installed)


@pytest.mark.parametrize("installed", ["1.40.0", "1.41.0", "2.0.0rc1"])
def test_flower_may_be_newer(installed: str) -> None:
    check(installed)


def test_an_aggregator_of_another_network_is_refused(network: Network) -> None:
    other = Aggregator(Program(network.zk0), network.aggregator, "22" * 32)
    with pytest.raises(ProgramError, match="22" * 32):
        other.status()


def test_no_aggregator_is_an_error(network: Network) -> None:
    with pytest.raises(ProgramError, match="http://127.0.0.1:1"):
        Aggregator(Program(network.zk0), "http://127.0.0.1:1", network.network).next_round()


def test_a_strategy_starts_from_the_weights_of_the_ledger(network: Network, tmp_path: Path) -> None:
    ours = strategy(network, tmp_path)
    arrays = ours.initial_arrays()
    assert arrays == strategy(network, tmp_path).initial_arrays()
    name = next(iter(arrays))
    other = ArrayRecord({**arrays, name: Array(arrays[name].numpy() + 1)})
    # The arrays are looked at before anybody is asked, so no grid is needed.
    with pytest.raises(OtherWeights, match=r"initial_arrays=strategy.initial_arrays\(\)"):
        ours.configure_train(1, other, ConfigRecord(), None)  # type: ignore[arg-type]


def test_a_node_takes_part_in_no_other_network(network: Network) -> None:
    asked = replace(request(network), network="33" * 32)
    for phase in (member(network).commit, member(network).prove):
        with pytest.raises(BadSettings, match=f"asks for a round of network {'33' * 32}, and this node's settings name network"):
            phase(asked)


def test_a_node_whose_prover_is_away_says_so(network: Network, tmp_path: Path) -> None:
    file = tmp_path / "node.toml"
    prover, state = network.prover or "", str(network.out / "node" / "state")
    text = network.settings(network.nodes[0]).read_text()
    file.write_text(text.replace(prover, "http://127.0.0.1:1").replace(state, str(tmp_path / "state")))
    with pytest.raises(NodeFailed, match=r"ended without a commitment: .*zk0 prover serve"):
        Member.of_settings(file, Program(network.zk0)).commit(request(network))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (None, "cannot be read: No such file"),
        ("network = ", "are not TOML"),
        ("state = '/s'", "do not say `network`"),
        ("network = '00'", "do not say `state`"),
    ],
)
def test_settings_that_cannot_be_used(tmp_path: Path, text: str | None, reason: str) -> None:
    file = tmp_path / "node.toml"
    if text is not None:
        file.write_text(text)
    with pytest.raises(BadSettings, match=reason):
        Member.of_settings(file, Program())
