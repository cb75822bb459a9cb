"""A SuperLink and three SuperNodes on this machine: the phases of a round, and each way to be left out of it."""

from pathlib import Path

from federation import Federation
from full_queue import REASON
from local_network import RECORDINGS, Node
from safetensors.numpy import load_file


def test_who_proves_nothing_is_named_and_left_out(zk0: str, prover: str, tmp_path: Path) -> None:
    nodes = [
        # It commits, but nobody makes its proof.
        Node("unproven", RECORDINGS[0]),
        # It commits to the base weights, and submits the proof of another claim.
        Node("thief", RECORDINGS[1], lazy="stolen-proof"),
        # It only says that it has committed.
        Node("idle", RECORDINGS[2], lazy="idle"),
    ]
    windows = {"commit_window_ms": 300_000, "submit_window_ms": 20_000}
    with Federation(tmp_path / "out", zk0, nodes, prover, windows, members=2) as federation:
        (outcome,) = federation.run(1)
        identities = {node.name: federation.program("audit", "show", federation.log, "--node", node.name) for node in nodes[:2]}
    assert outcome["contributors"] == {}
    known = outcome["ledger_round"]
    assert (len(known["committed"]), known["accepted"], len(known["refused"])) == (2, [], 1)
    assert known["result"] == known["base"]

    reasons = {left["identity"]: left["reason"] for left in outcome["left_out"]}
    assert len(reasons) == 3 and reasons[None].startswith("it says that it is node " + "00" * 32)
    (stolen,) = known["refused"]
    assert stolen[:16] in identities["thief"]
    assert "was refused: the SP1 proof" in reasons.pop(stolen)
    reasons.pop(None)
    ((unproven, reason),) = reasons.items()
    assert unproven[:16] in identities["unproven"]
    assert "it has committed and proven nothing in time; it failed" in reason and REASON in reason

    # The weights stay: they are those that the network was founded with.
    assert load_file(federation.out / "server" / "weights.safetensors")
